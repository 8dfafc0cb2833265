// Cursors of a plot: single, delta, harmonic, sideband; by mouse or keys, on one plot or on all with the same axis; a list of peaks.
// What they read are the points that are drawn, in the units of the plot's axes.

import { announce, h, number, s } from "./dom.js";
import { copy, tsvOf } from "./downloads.js";
import { keep, kept } from "./kept.js";
import { table } from "./tables.js";

const MODES = { none: "none", single: "single", delta: "delta", harmonic: "harmonics", sideband: "sidebands" };
const FREQUENCY = ["none", "single", "delta", "harmonic", "sideband"];
const TIME = ["none", "single", "delta"];
const TWO = ["delta", "sideband"]; // cursors that have two positions
const HARMONICS = 12;
const SIDEBANDS = 4; // on each side
const PEAKS = 12;
const STILL = 4; // pixels that a click may move
const NEAR = 0.01; // of a harmonic's spacing, within which its peak is looked for
const all = [];

/** Put cursors on a plot; `kind` is "frequency" or "time", `orders()` gives {name: frequency} that orders are multiples of. */
export function addCursors(plot, kind, orders = () => ({})) {
  const key = `cursors.${plot.id}`;
  const cursor = { mode: "none", at: [null, null], moves: 0, coupled: true, ...kept(key, {}) };
  const layer = s("svg", { class: "cursors", "aria-hidden": "true" });
  const holder = h("div", { class: "cursor-holder", tabindex: "0", role: "group", "aria-label": `Cursors of: ${plot.getAttribute("aria-label")}` });
  plot.replaceWith(holder);
  holder.append(plot, layer);
  const mode = h(
    "select",
    { "aria-label": "Cursor", onchange: () => set({ mode: mode.value }) },
    (kind === "time" ? TIME : FREQUENCY).map((name) => h("option", { value: name }, MODES[name])),
  );
  const coupled = h("input", { type: "checkbox", onchange: () => set({ coupled: coupled.checked }) });
  const read = h("output", { class: "reading" });
  const peaks = h("div", { class: "peaks" });
  const controls = h(
    "div",
    { class: "bar cursor-bar" },
    h("label", { class: "check" }, "Cursor", mode),
    h("label", { class: "check", title: "The cursors of all plots with this axis move together" }, coupled, "coupled"),
    kind === "frequency" && h("button", { type: "button", "aria-pressed": "false", onclick: (event) => togglePeaks(event.target) }, "Peaks"),
    h("button", { type: "button", onclick: copyReading }, "Copy values"),
  );
  const own = { kind, cursor, refresh, take };
  all.push(own);
  holder.after(controls, read, peaks);
  let pressed = null;
  let listens = false;
  holder.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]), true);
  window.addEventListener("pointerup", release, true); // which the plot keeps to itself
  holder.addEventListener("keydown", keys);
  refresh();
  return { refresh };

  /** Change the cursor here, and where it is coupled on the others. */
  function set(changes) {
    Object.assign(cursor, changes);
    if (cursor.mode !== "none" && cursor.at[0] === null) cursor.at = first();
    if (TWO.includes(cursor.mode) && cursor.at[1] === null) cursor.at[1] = second();
    store();
    if (cursor.coupled) all.filter((other) => other !== own && other.kind === kind && other.cursor.coupled).forEach((other) => other.take(cursor));
  }

  function take({ mode: name, at, moves }) {
    Object.assign(cursor, { mode: name, at: [...at], moves });
    store();
  }

  function store() {
    keep(key, cursor);
    refresh();
  }

  /** The largest point that is seen, and a place beside it. */
  function first() {
    const points = seen(top());
    const largest = points.reduce((best, one) => (one.y > best.y ? one : best), points[0] ?? { x: 0, y: 0 });
    return [largest.x, cursor.at[1]];
  }

  function second() {
    const [from, to] = span();
    return Math.min(cursor.at[0] + 0.1 * (to - from), to);
  }

  function release(event) {
    const axis = axes();
    const from = pressed;
    pressed = null;
    if (!axis || cursor.mode === "none" || !from) return;
    if (Math.hypot(event.clientX - from[0], event.clientY - from[1]) > STILL) return;
    const box = plot.getBoundingClientRect();
    const [across, down] = [event.clientX - box.left - axis.left, event.clientY - box.top - axis.top];
    if (across < 0 || across > axis.width || down < 0 || down > axis.height) return;
    const { moves, at } = cursor;
    const place = at.slice();
    place[TWO.includes(cursor.mode) ? moves : 0] = peakBy(axis.x.p2d(across), axis.x.p2d(across + 6) - axis.x.p2d(across));
    set({ at: place, moves: TWO.includes(cursor.mode) ? 1 - moves : 0 });
  }

  /** The drawn point near a place, the highest within a few pixels; in time the nearest. */
  function peakBy(x, within) {
    const points = top();
    if (!points) return x;
    const near = kind === "time" ? [] : pointsOf(points).filter((one) => Math.abs(one.x - x) <= within);
    return near.length ? near.reduce((best, one) => (one.y > best.y ? one : best)).x : points.x[nearest(points.x, x)];
  }

  function keys(event) {
    if (event.target !== holder) return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const names = kind === "time" ? TIME : FREQUENCY;
    if (event.key === "c") set({ mode: names[(names.indexOf(cursor.mode) + 1) % names.length] });
    else if (event.key === "d") set({ moves: 1 - cursor.moves });
    else if (event.key === "Escape") set({ mode: "none" });
    else if (step && cursor.mode !== "none") move(step, event.shiftKey);
    else return;
    event.preventDefault();
  }

  /** To the next point, or the next peak, of the curve on top. */
  function move(step, toPeak) {
    const curve = top();
    if (!curve) return;
    const which = TWO.includes(cursor.mode) ? cursor.moves : 0;
    let k = nearest(curve.x, cursor.at[which]) + step;
    while (toPeak && k > 0 && k < curve.x.length - 1 && !isPeak(curve, k)) k += step;
    const at = cursor.at.slice();
    at[which] = curve.x[Math.min(Math.max(k, 0), curve.x.length - 1)];
    set({ at });
  }

  function refresh() {
    mode.value = cursor.mode;
    coupled.checked = cursor.coupled;
    if (!listens && plot.on) {
      plot.on("plotly_afterplot", refresh);
      listens = true;
    }
    drawMarks();
    const rows = cursor.mode === "none" || !plot.data ? [] : reading();
    read.hidden = !rows.length;
    read.replaceChildren(...(rows.length ? [h("table", {}, rows.map((row, r) => h("tr", {}, row.map((cell) => h(r ? "td" : "th", {}, cell)))))] : []));
    if (peaks.childElementCount) showPeaks();
  }

  function drawMarks() {
    const axis = axes();
    layer.replaceChildren();
    if (!axis || cursor.mode === "none") return;
    layer.setAttribute("width", plot.clientWidth);
    layer.setAttribute("height", plot.clientHeight);
    for (const [x, words, strong] of marks()) {
      const across = axis.left + axis.x.d2p(x);
      if (!(across >= axis.left - 1 && across <= axis.left + axis.width + 1)) continue;
      layer.append(s("path", { class: strong ? "strong" : "", d: `M${across} ${axis.top}V${axis.top + axis.height}` }));
      layer.append(s("text", { x: across + 3, y: axis.top + axis.height - 4 }, words));
    }
  }

  /** Places of the marks with their names, and whether they are the cursor itself. */
  function marks() {
    const [a, b] = cursor.at;
    if (a === null) return [];
    if (cursor.mode === "single") return [[a, "", true]];
    if (cursor.mode === "delta") return [[a, "A", true], [b, "B", true]]; // prettier-ignore
    return places().map(([name, x]) => [x, name, x === a]);
  }

  /** Names and frequencies of a comb. */
  function places() {
    const [a, b] = cursor.at;
    if (cursor.mode === "harmonic") return Array.from({ length: HARMONICS }, (_, k) => [`${k + 1}`, (k + 1) * a]);
    const spacing = Math.abs(b - a);
    return Array.from({ length: 2 * SIDEBANDS + 1 }, (_, k) => k - SIDEBANDS)
      .map((k) => [k ? `${k > 0 ? "+" : "−"}${Math.abs(k)}` : "0", a + k * spacing])
      .filter(([, x]) => x > 0);
  }

  /** What the cursor reads, as rows of texts, the head first. */
  function reading() {
    const curves = drawn();
    const unit = kind === "time" ? "s" : "Hz";
    const bases = Object.entries(orders());
    const order = (x) => bases.map(([, base]) => number(x / base, 5));
    const head = ["", unit, ...bases.map(([name]) => `× ${name}`)];
    const values = (x, within = 0) => curves.map((curve) => number(curve.y[found(curve, x, within)], 5));
    const names = curves.map((curve) => `${curve.name || "curve"} [${unitOf(curve)}]`);
    const [a, b] = cursor.at;
    if (a === null) return [];
    if (cursor.mode === "single") return [[...head, ...names], ["", number(a, 7), ...order(a), ...values(a)]];
    if (cursor.mode === "delta")
      return [
        [...head, ...names],
        ["A", number(a, 7), ...order(a), ...values(a)],
        ["B", number(b, 7), ...order(b), ...values(b)],
        ["B − A", number(b - a, 7), ...order(b - a), ...curves.map((curve) => difference(curve, a, b))],
        ...(kind === "time" ? [["1/(B − A) [Hz]", number(1 / Math.abs(b - a), 5)]] : []),
      ];
    const within = NEAR * (cursor.mode === "harmonic" ? a : Math.abs(b - a));
    const inside = places().filter(([, x]) => curves[0] && x <= curves[0].x.at(-1));
    return [[...head, ...names], ...inside.map(([name, x]) => [name, number(x, 7), ...order(x), ...values(x, within)])];
  }

  function difference(curve, a, b) {
    const [low, high] = [a, b].map((x) => curve.y[found(curve, x, 0)]);
    if (unitOf(curve).startsWith("dB")) return `${number(high - low, 4)} dB`;
    if (kind === "time") return number(high - low, 5);
    return `${number(100 * (high / low - 1), 4)} %, ${number(20 * Math.log10(high / low), 4)} dB`;
  }

  async function copyReading() {
    if (cursor.mode === "none") return announce("There is no cursor; choose one first.");
    await copy(tsvOf(reading())).catch((error) => announce(error.message, { error: true }));
  }

  function togglePeaks(button) {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    peaks.replaceChildren();
    if (on) showPeaks();
  }

  /** The largest peaks that are seen, of the curve on top. */
  function showPeaks() {
    const curve = top();
    if (!curve) return;
    const bases = Object.entries(orders());
    const [from, to] = span();
    const found = curve.x
      .map((x, k) => ({ x, y: curve.y[k], k }))
      .filter(({ x, k }) => x >= from && x <= to && isPeak(curve, k))
      .sort((one, other) => other.y - one.y)
      .slice(0, PEAKS);
    const columns = [
      { key: "x", title: "frequency", unit: "Hz", show: (x) => h("button", { type: "button", class: "quiet", onclick: () => pick(x) }, number(x, 7)) },
      ...bases.map(([name]) => ({ key: name, title: `× ${name}`, show: (value) => number(value, 5) })),
      { key: "y", title: "value", unit: unitOf(curve), show: (value) => number(value, 4) },
    ];
    const rows = found.map(({ x, y }) => ({ x, y, ...Object.fromEntries(bases.map(([name, base]) => [name, x / base])) }));
    peaks.replaceChildren(table(columns, rows, { caption: `Peaks of ${curve.name || "the curve"}` }));
  }

  function pick(x) {
    set({ mode: cursor.mode === "none" ? "single" : cursor.mode, at: [x, cursor.at[1]] });
  }

  // ---- What is drawn ----

  function axes() {
    const { xaxis, _size: size } = plot._fullLayout ?? {};
    return xaxis?.d2p ? { x: xaxis, left: size.l, top: size.t, width: size.w, height: size.h } : null;
  }

  function drawn() {
    return (plot.data ?? []).filter((curve) => curve.mode === "lines" && curve.x?.length && (curve.xaxis ?? "x") === "x");
  }

  /** The curve that lies on top: of runs the chosen one. */
  function top() {
    const curves = drawn().filter((curve) => !["y2", "y3"].includes(curve.yaxis));
    return curves.at(-1);
  }

  function span() {
    const { type, range } = plot._fullLayout?.xaxis ?? { range: [0, 1] };
    return type === "log" ? range.map((decade) => 10 ** decade) : range;
  }

  function seen(curve) {
    const [from, to] = span();
    return curve ? pointsOf(curve).filter(({ x }) => x >= from && x <= to) : [];
  }

  function unitOf(curve) {
    const axis = plot._fullLayout?.[(curve.yaxis ?? "y").replace("y", "yaxis")];
    const title = axis?.title?.text || plot._fullLayout?.yaxis?.title?.text || "";
    return /\[(.*?)\]/.exec(title)?.[1] ?? "";
  }
}

const pointsOf = (curve) => curve.x.map((x, k) => ({ x, y: curve.y[k] }));

/** Index of the value next to `x` in ascending values. */
export function nearest(values, x) {
  let [low, high] = [0, values.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] < x) low = middle;
    else high = middle;
  }
  return x - values[low] < values[high] - x ? low : high;
}

/** Whether a point is higher than those beside it. */
export const isPeak = ({ y }, k) => k > 0 && k < y.length - 1 && y[k] > y[k - 1] && y[k] >= y[k + 1];

/** Index of the largest point within some distance of `x`, or of the nearest one. */
export function found({ x: places, y }, x, within) {
  let best = nearest(places, x);
  for (const way of [-1, 1])
    for (let k = nearest(places, x); k >= 0 && k < places.length && Math.abs(places[k] - x) <= within; k += way) if (y[k] > y[best]) best = k;
  return best;
}
