// What is seen as a file or on the clipboard: plots and pictures as PNG, SVG and CSV, tables as CSV, SVG and PNG.

import { announce, h, save } from "./dom.js";
import { textWidth } from "./labels.js";

const SHARP = 2; // pixels of a PNG for one of the screen

/** Buttons; `ways` is {name: function that gives a text or blob}, "Copy" goes to the clipboard. `name()` is the file's. */
export function exportBar(name, ways) {
  const buttons = Object.entries(ways).map(([way, make]) =>
    h("button", { type: "button", class: "quiet", "aria-label": `${way} of ${name()}`, onclick: () => give(way, make, name()) }, way),
  );
  return h("div", { class: "export", role: "group", "aria-label": `Export ${name()}` }, buttons);
}

async function give(way, make, name) {
  try {
    const content = await make();
    if (way === "Copy") await copy(content);
    else save(content, `${name.toLowerCase().replace(/[^\w.-]+/g, "-")}.${way.toLowerCase()}`);
  } catch (error) {
    announce(error.message, { error: true });
  }
}

export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    throw new Error("The browser does not let the page copy.");
  }
  announce("Copied.");
}

// A cell that begins so would be a formula in a spreadsheet.
const FORMULA = /^[=+@\t\r]|^-(?![\d.])/;

const cell = (value) => {
  const text = String(value ?? "").replaceAll("−", "-");
  const safe = FORMULA.test(text) && !Number.isFinite(Number(text)) ? `'${text}` : text;
  return /[",\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
};

export const csvOf = (rows) => rows.map((row) => row.map(cell).join(",")).join("\n") + "\n";
export const tsvOf = (rows) => rows.map((row) => row.map((value) => String(value ?? "").replaceAll("−", "-").replace(/[\t\n]/g, " ")).join("\t")).join("\n");

// ---- Plots ----

/** Rows of all curves of a plot: name, x, y. */
export function plotRows({ data, layout }) {
  const title = (axis, otherwise) => layout[axis]?.title?.text || otherwise;
  const rows = [["curve", title("xaxis", "x"), title("yaxis", "y")]];
  for (const { x = [], y = [], name = "", visible, customdata, type } of data) {
    if (visible === false) continue;
    if (type === "heatmap") {
      if (rows[0].length === 3) rows[0].push("value");
      customdata.forEach((row, r) => row.forEach((value, c) => rows.push([name || "map", x[c], y[r], value])));
      continue;
    }
    for (let k = 0; k < y.length; k++) rows.push([name, x[k], y[k]]);
  }
  return rows;
}

/** Buttons of a plot; in its picture stand the names of its curves, which the page may show elsewhere. */
export function plotExports(place, background) {
  const image = (format) => async () => {
    const { data, layout } = place;
    const named = data.filter((curve) => curve.name && curve.showlegend !== false).length > 1;
    const figure = { data, layout: { ...layout, showlegend: named, paper_bgcolor: background(), width: undefined, height: undefined } };
    const size = { width: Math.max(place.clientWidth, 700), height: Math.max(place.clientHeight, 350) };
    const address = await window.Plotly.toImage(figure, { format, ...size, scale: format === "png" ? SHARP : 1 });
    return format === "svg" ? decodeURIComponent(address.slice(address.indexOf(",") + 1)) : blobOf(address);
  };
  return exportBar(() => place.getAttribute("aria-label") ?? "plot", {
    PNG: image("png"),
    SVG: image("svg"),
    CSV: () => csvOf(plotRows(place)),
    Copy: () => tsvOf(plotRows(place)),
  });
}

function blobOf(address) {
  const [head, content] = address.split(",");
  const bytes = Uint8Array.from(atob(content), (c) => c.charCodeAt(0));
  return new Blob([bytes], { type: /data:([^;]+)/.exec(head)[1] });
}

// ---- Tables ----

/** Texts of a table as it is shown, its head first. */
export const tableRows = (table) => [...table.rows].map((row) => [...row.cells].map((one) => one.innerText.replace(/ [↑↓]$/, "").trim()));

/** Buttons of a table. */
export function tableExports(table, name) {
  const svg = () => tableSvg(tableRows(table));
  return exportBar(() => name, {
    CSV: () => csvOf(tableRows(table)),
    Copy: () => tsvOf(tableRows(table)),
    SVG: svg,
    PNG: () => pngOf(svg()),
  });
}

const SIZE = 13;
const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

/** A table as a picture. */
function tableSvg(rows) {
  const widths = rows[0].map((_, c) => Math.max(...rows.map((row) => textWidth(row[c] ?? "", SIZE, 650))) + 18);
  const left = widths.map((_, c) => widths.slice(0, c).reduce((a, b) => a + b, 8));
  const [width, height] = [left.at(-1) + widths.at(-1), 24 * rows.length + 12];
  const texts = rows.flatMap((row, r) =>
    row.map((text, c) => `<text x="${left[c]}" y="${24 * r + 22}"${r ? "" : ' font-weight="650"'}>${escaped(text)}</text>`),
  );
  const rules = rows.map((_, r) => `<path d="M8 ${24 * r + 30}H${width - 8}" stroke="#d5dae1"/>`);
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" font-family="system-ui, sans-serif" font-size="${SIZE}" fill="#1c2330">` +
    `<rect width="100%" height="100%" fill="#fff"/>${rules.join("")}${texts.join("")}</svg>`
  );
}

/** A picture of an SVG's text. */
export async function pngOf(svg) {
  const address = URL.createObjectURL(new Blob([svg], { type: "image/svg+xml" }));
  try {
    const image = new Image();
    image.src = address;
    await image.decode();
    const canvas = h("canvas", { width: SHARP * image.width, height: SHARP * image.height });
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  } finally {
    URL.revokeObjectURL(address);
  }
}

// ---- Pictures that the server drew ----

/** Buttons of an image whose address is an SVG's content; `points` are those of its curves: what is shown, curve, x, y. */
export function pictureExports(image, name, points = []) {
  const svg = () => textOf(image.src);
  const rows = [["shown", "curve", "x", "y"], ...points];
  const figures = points.length ? { CSV: () => csvOf(rows), Copy: () => tsvOf(rows) } : {};
  return exportBar(() => name, { PNG: () => pngOf(svg()), SVG: svg, ...figures });
}

const LOOKS = ["fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "font-size", "font-weight", "font-style", "font-family"];

/** Buttons of a drawing of the page; its looks, which come from the page, go along. */
export function drawingExports(drawing, name) {
  const svg = () => {
    const original = drawing();
    const copied = original.cloneNode(true);
    const pairs = [original, ...original.querySelectorAll("*")].map((one, k) => [one, [copied, ...copied.querySelectorAll("*")][k]]);
    for (const [one, other] of pairs) for (const look of LOOKS) other.style.setProperty(look, getComputedStyle(one).getPropertyValue(look));
    const { width, height } = original.viewBox.baseVal;
    for (const [key, value] of Object.entries({ width, height, xmlns: "http://www.w3.org/2000/svg" })) copied.setAttribute(key, value);
    copied.style.background = getComputedStyle(document.documentElement).getPropertyValue("--paper");
    return new XMLSerializer().serializeToString(copied);
  };
  return exportBar(() => name, { PNG: () => pngOf(svg()), SVG: svg });
}

/** Text of a data address, which the page's policy lets nobody fetch. */
function textOf(address) {
  const [head, content] = [address.slice(0, address.indexOf(",")), address.slice(address.indexOf(",") + 1)];
  if (!head.includes(";base64")) return decodeURIComponent(content);
  return new TextDecoder().decode(Uint8Array.from(atob(content), (c) => c.charCodeAt(0)));
}
