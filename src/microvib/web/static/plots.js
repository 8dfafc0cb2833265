// What all plots share: look, behaviour, and the window that is asked from the server on zoom.

import { debounce, h } from "./dom.js";
import { plotExports } from "./downloads.js";

// Plotly is large: it is fetched when the form is there, or when something is to be drawn before that. Its first drawing, which
// is its slowest, is of nothing.
let loaded = null;
export const loadPlotly = () => (loaded ??= fetchPlotly());

async function fetchPlotly() {
  await new Promise((resolve, reject) => {
    const src = new URL("./plotly.min.js", import.meta.url).href;
    document.head.append(h("script", { src, onload: resolve, onerror: () => reject(new Error("The plots' script did not load.")) }));
  });
  const place = h("div", { class: "away plot" });
  document.body.append(place);
  await window.Plotly.newPlot(place, [{ y: [1, 2] }], { yaxis: { type: "log" } });
  window.Plotly.purge(place);
  place.remove();
  return window.Plotly;
}

const plots = new Map();

export const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => plots.forEach(({ data, layout }, place) => draw(place, data, layout)));

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const ink = () => colour("--ink");

/** The page's ground, under words that stand on curves; part of what is below shows through. */
export const ground = () => `${colour("--paper").replace(/^#(.)(.)(.)$/, "#$1$1$2$2$3$3")}c4`;

/** Draw or redraw a plot; texts and lines take the page's colours. */
export async function draw(place, data, layout) {
  if (!plots.has(place)) place.after(plotExports(place, () => colour("--paper")));
  plots.set(place, { data, layout });
  const plotly = await loadPlotly();
  await plotly.react(place, harmless(data), harmless(themed(layout, place)), {
    responsive: true,
    displaylogo: false,
    showTips: false,
    scrollZoom: false,
    doubleClick: "reset",
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]], // none that would send data away
  });
}

// Plotly takes markup in any text, links among it, and names in scenarios and recordings are other people's. Names are texts;
// elsewhere these tags remain, which lead nowhere.
const MARKUP = /<(?!\/?(?:b|br|i|sub|sup|extra)>)/g;

function harmless(value, key) {
  if (typeof value === "string" && key === "name") return value.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
  if (typeof value === "string") return value.replace(MARKUP, "&lt;");
  if (Array.isArray(value)) return typeof value[0] === "number" ? value : value.map((item) => harmless(item));
  if (value?.constructor !== Object) return value;
  return Object.fromEntries(Object.entries(value).map(([name, item]) => [name, harmless(item, name)]));
}

const NARROW = 560; // pixels, up to which names of curves lie below their plot

function themed(layout, place) {
  const below = place.clientWidth < NARROW;
  const axis = {
    gridcolor: colour("--grid"),
    linecolor: colour("--rule"),
    zerolinecolor: colour("--rule"),
    automargin: true,
    exponentformat: "power",
    hoverformat: ".5~g",
  };
  const axes = Object.fromEntries(
    Object.entries(layout)
      .filter(([key]) => /^[xy]axis\d*$/.test(key))
      .map(([key, own]) => [key, { ...axis, ...own }]),
  );
  return {
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    hovermode: "closest",
    font: { family: "system-ui, sans-serif", size: 12, color: colour("--ink") },
    margin: { l: 62, r: 14, t: 12, b: 40 },
    hoverlabel: { bgcolor: colour("--paper"), bordercolor: colour("--rule"), font: { color: colour("--ink") } },
    legend: { orientation: "h", x: 0, y: below ? -0.32 : 1.02, yanchor: below ? "top" : "bottom", bgcolor: "rgba(0,0,0,0)" },
    modebar: { color: colour("--soft"), activecolor: colour("--accent"), bgcolor: "rgba(0,0,0,0)" },
    ...layout,
    ...axes,
  };
}

/** Call `action` with what a person zoomed to: {x: [from, to]}, {y: [low, high]} or both; nulls are the whole. */
export function onZoom(place, action) {
  const later = debounce(action, 60);
  place.on("plotly_relayout", (event) => {
    const range = (axis) =>
      event[`${axis}.range[0]`] !== undefined && [Number(event[`${axis}.range[0]`]), Number(event[`${axis}.range[1]`])];
    const [x, y] = [range("xaxis"), range("yaxis")];
    if (x || y) later({ ...(x && { x }), ...(y && { y }) });
    else if (event["xaxis.autorange"] || event["xaxis.range"]) later({ x: null, y: null }); // a double click, or the button for it
  });
}

/** The query for a stretch of an axis: a little more than is shown, so that the curve goes on to the edge. */
export function stretch(window) {
  if (window === null) return {};
  const more = 0.01 * (window[1] - window[0]);
  return { from: Math.max(window[0] - more, 0), to: window[1] + more };
}

const FEWEST = 800;
const FINEST = 4000;

/** Points that are worth asking for, of each of so many curves: two for a pixel, and fewer where many curves lie over each other. */
export function pointsFor(place, curves) {
  const width = place.clientWidth || place.closest("[hidden]")?.parentElement.clientWidth || 0;
  const pixels = Math.max(width, FEWEST) * (window.devicePixelRatio > 1 ? 2 : 1);
  const step = curves > 8 ? 1 : 2;
  return Math.min(step * 500 * Math.ceil(pixels / 500), FINEST); // in steps, so that a window's width does not ask anew
}

/** Range of an axis of amplitudes up to the largest, in its unit, with room for names above it. */
export function bounds(largest, log, dB = false) {
  if (dB) return [largest - 88, largest + 20];
  return log ? [Math.log10(largest) - 4.4, Math.log10(largest) + 1] : [0, 1.25 * largest];
}

/** A line through a min/max envelope, so that no peak is lost; where each sample is there, through the samples. */
export function envelopeTrace(t, channel, exact) {
  if (exact) return { x: t, y: channel.min };
  const x = new Array(2 * t.length);
  const y = new Array(2 * t.length);
  for (let k = 0; k < t.length; k++) {
    x[2 * k] = x[2 * k + 1] = t[k];
    y[2 * k] = channel.min[k];
    y[2 * k + 1] = channel.max[k];
  }
  return { x, y };
}
