// Elements, numbers and messages: what all parts of the page share.

const SVG = "http://www.w3.org/2000/svg";

/** An element with attributes and children; `on*` are listeners, `css` goes through the style object (the page's policy allows no style attributes). */
export function h(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/** The same for SVG. */
export function s(tag, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "css") for (const [key, item] of Object.entries(value)) element.style.setProperty(key, item);
    else if (name === "value") element.value = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const $ = (selector, root = document) => root.querySelector(selector);

/** A symbol such as K_m or T_f,m as an element with its index set low. */
export function symbol(text) {
  const [head, ...rest] = text.split("_");
  return h("i", { class: "symbol" }, GREEK[head] ?? head, rest.length ? h("sub", {}, rest.join(",")) : null);
}

const GREEK = { omega: "ω", mu: "μ", sigma: "σ", delta: "δ", xi: "ξ", gamma: "γ", "Omega/2pi": "Ω/2π", "H^2": "H²" };

export const DASH = "–";

/** A number with `digits` significant digits. */
export function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  if (value === 0) return "0";
  const size = Math.abs(Number(value.toPrecision(digits)));
  const text =
    size < 1e-4
      ? value.toExponential(digits - 1)
      : size >= 10 ** digits && size < 1e9
        ? value.toFixed(0)
        : value.toPrecision(digits);
  return text.replaceAll("-", "−");
}

/** A relative difference in per cent, to a tenth of one, or below ten a hundredth, as in reports. */
export function percent(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const text = (100 * value).toFixed(Math.abs(value) >= 0.1 ? 1 : 2);
  const shown = Number(text) === 0 ? "0.00" : text;
  return `${shown.startsWith("-") ? "" : "+"}${shown} %`.replace("-", "−");
}

export const fixed = (value, digits) => (value === null || value === undefined ? DASH : value.toFixed(digits).replace("-", "−"));

const PRINTED = { "^0.5": "^½", "^-1": "⁻¹", "^2": "²", "^3": "³", "*": " ", deg: "°", ohm: "Ω", percent: "%" };

/** Units as print shows them, in the same characters as reports: N*m to N m, kg*m^2 to kg m². */
export function unitText(unit) {
  if (!unit || unit === "1") return "";
  return Object.entries(PRINTED).reduce((text, [plain, printed]) => text.replaceAll(plain, printed), unit);
}

const PREFIXES = [
  [1, ""],
  [1e-3, "m"],
  [1e-6, "µ"],
  [1e-9, "n"],
];

const BARE = /^(N|V|A|W|J|C|m|s|rad|Hz|Pa)(?![A-Za-z])/; // units that have no prefix yet

/** A value in its unit with a prefix that leaves digits before the point: 0.0366 N*m is 36.6 mN m. Others, such as mV, stay. */
export function quantity(value, unit, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const prefixes = BARE.test(unit) ? PREFIXES : PREFIXES.slice(0, 1);
  const [scale, prefix] = value === 0 ? prefixes[0] : (prefixes.find(([scale]) => Math.abs(value) >= scale) ?? prefixes.at(-1));
  return `${number(value / scale, digits)} ${prefix}${unitText(unit)}`;
}

export function debounce(action, delay) {
  let timer;
  return (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => action(...values), delay);
  };
}

/** Say something to those who hear the page, and show it for a while to those who see it. */
export function announce(text, { error = false } = {}) {
  const place = $(error ? "#alert" : "#status");
  place.textContent = text;
  place.classList.add("fresh");
  clearTimeout(announce.timers?.[place.id]);
  announce.timers = { ...announce.timers, [place.id]: setTimeout(() => place.classList.remove("fresh"), error ? 9000 : 3500) };
}

/** Hand a text or blob to the user as a file. */
export function save(content, name) {
  const address = URL.createObjectURL(content instanceof Blob ? content : new Blob([content]));
  h("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** Let files be dropped on an element. */
export function onDrop(element, action) {
  element.addEventListener("dragover", (event) => {
    event.preventDefault();
    element.classList.add("over");
  });
  element.addEventListener("dragleave", () => element.classList.remove("over"));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    element.classList.remove("over");
    if (event.dataTransfer.files.length) action([...event.dataTransfer.files]);
  });
}
