// Amplitude spectrum of the shown runs: named lines, array mode, measured reference lines, linear and logarithmic axes.

import { excited, fillChannels, has } from "./channels.js";
import { addCursors } from "./cursors.js";
import { announce, debounce, h, number, unitText } from "./dom.js";
import { keep, kept } from "./kept.js";
import { modeNames, together } from "./labels.js";
import { latest } from "./latest.js";
import { amplitudeAxis, onUnits } from "./measures.js";
import { basesOf, orderTicks } from "./orders.js";
import { bounds, draw, ink, onZoom, pointsFor, stretch } from "./plots.js";
import * as runs from "./runs.js";
import { limitCurve, limitLine, limitName, namesOfLines, scaled, seen } from "./spectrum_marks.js";
import { verdictOf } from "./limit.js";

const HIGHEST = 200;
const LOWEST = 0.1; // of a logarithmic axis, unless the first bin is lower [Hz]
const NAMES = 3; // of curves, beyond which the runs' list alone has them
const MANY = 8; // of curves, beyond which the chosen run alone has dots at its lines
const SIZE = 10.5; // of names
const AROUND = [87, 90]; // margins of the plot, before it has been drawn

const view = { channel: "T_d", window: [0, HIGHEST], logX: false, logY: true, orders: "", y: null, ...kept("spectrum", {}) };
const plot = h("div", { class: "plot tall", id: "spectrum-plot", role: "img", "aria-label": "Amplitude spectrum of the runs" });
const channel = h("select", { id: "spectrum-channel", onchange: () => set({ channel: channel.value }) });
const logX = button("log f", () => set({ logX: !view.logX }));
const logY = button("log amplitude", () => set({ logY: !view.logY }));
const note = h("span", { class: "soft note" });
const bases = () => basesOf(runs.selected()?.result);
const ordersOf = h(
  "select",
  { id: "spectrum-orders", "aria-label": "Axis of frequencies", onchange: () => set({ orders: ordersOf.value }) },
  h("option", { value: "" }, "Hz"),
  ["microstep rate", "electrical frequency"].map((name) => h("option", { value: name }, `× ${name}`)),
);

export const card = h(
  "section",
  { class: "card" },
  h(
    "div",
    { class: "bar" },
    h("h2", {}, "Spectrum"),
    h("label", { for: "spectrum-channel", class: "away" }, "Channel"),
    channel,
    logY,
    logX,
    ordersOf,
    button("0–200 Hz", () => set({ window: [0, HIGHEST] })),
    button("Array mode", () => set({ window: arrayWindow(), logX: false })),
    button("All", () => set({ window: null })),
    note,
  ),
  plot,
);

function button(text, action) {
  return h("button", { type: "button", onclick: action }, text);
}

function set(changes) {
  Object.assign(view, { y: null }, changes);
  keep("spectrum", view);
  return update().catch((error) => announce(error.message, { error: true }));
}

function arrayWindow() {
  const mode = excited(runs.selected()?.result);
  return mode ? [0, 4 * mode.frequency] : [0, 5];
}

onUnits(() => (view.y = null));

addCursors(plot, "frequency", bases);

let listening = false;
const asking = latest();

/** What the window shows of each of so many runs. */
function query(curves) {
  return { channel: view.channel, window: "hann", ...stretch(view.window), points: pointsFor(plot, curves), log: view.logX };
}

runs.onReady((run) => run.visible && runs.prefetch(run, "spectrum", query(runs.shown().length + 1)));

/** Ask for what the window shows of each run, and draw it. */
export async function update() {
  fillChannels(channel, runs.shown(), view.channel);
  const shown = runs.shown().filter((run) => has(run, view.channel));
  const wanted = query(shown.length);
  await asking(
    (signal) => Promise.all(shown.map((run) => runs.ask(run, "spectrum", wanted, { signal }))),
    (spectra) => show(shown, spectra),
  );
}

let last = null; // what is drawn
let axis = amplitudeAxis("N*m"); // in which unit

async function show(shown, spectra) {
  last = [shown, spectra];
  axis = amplitudeAxis(spectra[0]?.unit ?? "N*m");
  logY.hidden = axis.dB;
  logX.setAttribute("aria-pressed", view.logX);
  logY.setAttribute("aria-pressed", view.logY);
  const named = shown.length <= NAMES;
  const dotted = view.channel === "T_d" ? shown.slice(shown.length > MANY ? -1 : 0) : [];
  const traces = shown.flatMap((run, k) => [{ ...curve(run, spectra[k]), showlegend: named }, ...(dotted.includes(run) ? [dots(run)] : [])]);
  if (view.channel === "T_d") traces.push(...referenceDots(shown));
  traces.push(...limitCurve(view.channel === "T_d" ? verdictOf(shown.at(-1)) : null, axis));
  const measured = String(area());
  await draw(plot, traces, layout(shown, spectra));
  if (measured !== String(area())) await draw(plot, traces, layout(shown, spectra)); // names have their places in pixels
  if (!listening) onZoom(plot, ({ x, y = view.y }) => set({ window: x === undefined ? view.window : fromAxis(x), y }));
  listening = true;
}

/** Width and height of the plot within its axes. */
function area() {
  const size = plot._fullLayout?._size;
  return size ? [Math.round(size.w), Math.round(size.h)] : [plot.clientWidth - AROUND[0], plot.clientHeight - AROUND[1]];
}

new ResizeObserver(debounce(() => last && plot.clientWidth && show(...last), 200)).observe(plot);

// A logarithmic axis speaks in decades.
function fromAxis(window) {
  if (window === null) return [0, HIGHEST];
  return view.logX ? window.map((decade) => 10 ** decade) : [Math.max(window[0], 0), window[1]];
}

// What is not above zero has no place on a logarithmic axis; the picture would go on level from it.
function positive({ f, amplitude }) {
  const keep = f.map((x, k) => (x > 0 || !view.logX) && (amplitude[k] > 0 || !(view.logY || axis.dB)));
  return { x: f.filter((_, k) => keep[k]), y: amplitude.filter((_, k) => keep[k]).map(axis.y) };
}

function curve(run, spectrum) {
  return {
    ...positive(spectrum),
    name: run.name,
    mode: "lines",
    line: { color: run.colour, dash: run.dash, width: 1.2 },
    hovertemplate: `%{x:.5g} Hz<br>%{y:.4g} ${axis.printed ?? unitText(spectrum.unit)}<extra>%{fullData.name}</extra>`,
  };
}

function dots(run) {
  const [low, high] = view.window ?? [0, Infinity];
  const lines = seen(run.result).filter((line) => line.frequency_hz >= low && line.frequency_hz <= high);
  return {
    x: lines.map((line) => line.frequency_hz),
    y: lines.map((line) => axis.y(line.amplitude_n_m)),
    mode: "markers",
    showlegend: false,
    marker: { color: run.colour, size: 6, line: { color: "#fff", width: 0.8 } },
    text: lines.map((line) => `${line.line}<br>${line.origin}`),
    hovertemplate: `<b>%{text}</b><br>%{x:.7g} Hz<br>%{y:.5g} ${axis.printed}<extra>%{fullData.name}</extra>`,
  };
}

function referenceDots(shown) {
  const rows = shown.find((run) => run.result.measured.length)?.result.measured ?? [];
  if (!rows.length) return [];
  return [
    {
      x: rows.map((row) => row.measured_hz),
      y: rows.map((row) => axis.y(row.measured_n_m)),
      name: "measured",
      mode: "markers",
      marker: { symbol: "diamond-open", size: 11, color: ink(), line: { width: 1.8 } },
      text: rows.map((row) => row.line),
      hovertemplate: `measured, %{text}<br>%{x:.6g} Hz<br>%{y:.4g} ${axis.printed}<extra></extra>`,
    },
  ];
}

function layout(shown, spectra) {
  const run = shown.at(-1);
  const limit = view.channel === "T_d" ? verdictOf(run) : null;
  const largest = Math.max(...spectra.map((one) => one.amplitude.reduce((a, b) => Math.max(a, b), 0)), limit?.torque ?? 0, 1e-12);
  const [low, high] = view.window ?? [0, spectra[0]?.f.at(-1) ?? HIGHEST];
  const lowest = Math.max(low, Math.min(...spectra.map((one) => one.resolution), LOWEST));
  const x = view.logX ? [Math.log10(lowest), Math.log10(high)] : [low, high];
  const y = view.y ?? bounds(axis.y(largest), view.logY, axis.dB);
  const axes = scaled({ x, y, axis, logX: view.logX, logY: view.logY, area: area() });
  note.textContent = spectra.length ? `${axis.words}, Hann window` : "";
  return {
    xaxis: { ...frequencies(lowest, low, high), type: view.logX ? "log" : "linear", range: x },
    yaxis: {
      title: { text: `amplitude [${axis.printed ?? unitText(spectra[0]?.unit ?? "N*m")}]` },
      type: view.logY && !axis.dB ? "log" : "linear",
      range: y,
      dtick: view.logY && !axis.dB ? 1 : undefined,
    },
    annotations: [
      ...(run && view.channel === "T_d" ? namesOfLines(seen(run.result), axes, limit) : []),
      ...namesOfModes(run, axes),
      ...limitName(limit, axes),
    ],
    shapes: [...modes(run, axes), ...limitLine(limit, axes)],
  };
}

/** Title and ticks: frequencies, or orders of the chosen run's clock. */
function frequencies(lowest, low, high) {
  const base = bases()[view.orders];
  ordersOf.value = base ? view.orders : "";
  if (!base) return { title: { text: "frequency [Hz]" } };
  const title = { text: `order, multiples of the ${view.orders}, ${number(base, 5)} Hz` };
  return { title, ...orderTicks(view.logX ? lowest : low, high, base, view.logX) };
}

const modesIn = (run, axes) => (run?.result?.modes ?? []).filter((mode) => axes.sees(mode.frequency) && mode.damping < 0.3);

/** Names at the modes' lines; those that lie too close to be read have one name together. */
function namesOfModes(run, axes) {
  return together(modesIn(run, axes), (mode) => axes.right(mode.frequency), 1.4 * SIZE).map((group) => ({
    x: axes.onX(group[0].frequency),
    yref: "paper",
    y: 0.02,
    yanchor: "bottom",
    xanchor: "left",
    textangle: -90,
    showarrow: false,
    text: modeNames(group),
    font: { size: 10 },
    opacity: 0.75,
  }));
}

// A shape stands at a frequency even where the axis is logarithmic; an annotation, at its decade.
function modes(run, axes) {
  return modesIn(run, axes).map((mode) => ({
    type: "line",
    x0: mode.frequency,
    x1: mode.frequency,
    yref: "paper",
    y0: 0,
    y1: 1,
    line: { color: ink(), width: 0.8, dash: "dot" },
    opacity: 0.6,
  }));
}
