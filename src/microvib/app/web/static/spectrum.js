// Amplitude spectrum of the shown runs: named lines, array mode, the paper's test values, linear and logarithmic axes.

import { announce, h, number, quantity, unitText } from "./dom.js";
import { latest } from "./latest.js";
import { draw, ink, onZoom } from "./plots.js";
import { fillChannels, has } from "./channels.js";
import * as runs from "./runs.js";

const HIGHEST = 200;
const NAMED = 7;
const APART = 38; // pixels

const view = { channel: "T_d", window: [0, HIGHEST], logX: false, logY: true, y: null };
const plot = h("div", { class: "plot tall", id: "spectrum-plot", role: "img", "aria-label": "Amplitude spectrum of the runs" });
const channel = h("select", { id: "spectrum-channel", onchange: () => set({ channel: channel.value }) });
const logX = button("log f", () => set({ logX: !view.logX }));
const logY = button("log amplitude", () => set({ logY: !view.logY }));
const note = h("span", { class: "soft note" });

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
  return update().catch((error) => announce(error.message, { error: true }));
}

function arrayWindow() {
  const mode = runs.selected()?.result?.modes.find((item) => item.name.startsWith("array_mode"));
  return mode ? [0, 4 * mode.frequency] : [0, 5];
}

let listening = false;
const asking = latest();

/** Ask for what the window shows of each run, and draw it. */
export async function update() {
  fillChannels(channel, runs.shown(), view.channel);
  const shown = runs.shown().filter((run) => has(run, view.channel));
  const [from, to] = view.window ?? [undefined, undefined];
  const query = { channel: view.channel, window: "hann", from, to, points: 4000 };
  await asking(
    (signal) => Promise.all(shown.map((run) => runs.ask(run, "spectrum", query, { signal }))),
    (spectra) => show(shown, spectra),
  );
}

async function show(shown, spectra) {
  logX.setAttribute("aria-pressed", view.logX);
  logY.setAttribute("aria-pressed", view.logY);
  const traces = shown.flatMap((run, k) => [curve(run, spectra[k]), ...(view.channel === "T_d" ? [dots(run)] : [])]);
  if (view.channel === "T_d") traces.push(...paperDots(shown));
  await draw(plot, traces, layout(shown, spectra));
  if (!listening) onZoom(plot, ({ x, y = view.y }) => set({ window: x === undefined ? view.window : fromAxis(x), y }));
  listening = true;
}

// A logarithmic axis speaks in decades.
function fromAxis(window) {
  if (window === null) return [0, HIGHEST];
  return view.logX ? window.map((decade) => 10 ** decade) : [Math.max(window[0], 0), window[1]];
}

function curve(run, spectrum) {
  return {
    x: spectrum.f,
    y: spectrum.amplitude,
    name: run.name,
    mode: "lines",
    line: { color: run.colour, dash: run.dash, width: 1.2 },
    hovertemplate: `%{x:.5g} Hz<br>%{y:.4g} ${unitText(spectrum.unit)}<extra>%{fullData.name}</extra>`,
  };
}

const seenLines = (run) => run.result.lines.filter((line) => line.amplitude_n_m !== null && line.status !== "below the floor");

function dots(run) {
  const lines = seenLines(run);
  return {
    x: lines.map((line) => line.frequency_hz),
    y: lines.map((line) => line.amplitude_n_m),
    mode: "markers",
    showlegend: false,
    marker: { color: run.colour, size: 6, line: { color: "#fff", width: 0.8 } },
    text: lines.map((line) => `${line.line}<br>${line.origin}`),
    hovertemplate: `<b>%{text}</b><br>%{x:.7g} Hz<br>%{y:.5g} N m<extra>%{fullData.name}</extra>`,
  };
}

function paperDots(shown) {
  const rows = shown.find((run) => run.result.paper.length)?.result.paper ?? [];
  if (!rows.length) return [];
  return [
    {
      x: rows.map((row) => row.test_hz),
      y: rows.map((row) => row.test_n_m),
      name: "paper's test",
      mode: "markers",
      marker: { symbol: "diamond-open", size: 11, color: ink(), line: { width: 1.8 } },
      text: rows.map((row) => row.line),
      hovertemplate: "paper's test, %{text}<br>%{x:.6g} Hz<br>%{y:.4g} N m<extra></extra>",
    },
  ];
}

function layout(shown, spectra) {
  const largest = Math.max(...spectra.map((spectrum) => spectrum.amplitude.reduce((a, b) => Math.max(a, b), 0)), 1e-12);
  const run = shown.at(-1);
  const [low, high] = view.window ?? [0, spectra[0]?.f.at(-1) ?? HIGHEST];
  const x = view.logX ? [Math.log10(Math.max(low, 0.05)), Math.log10(high)] : [low, high];
  const y = view.logY ? [Math.log10(largest) - 4.4, Math.log10(largest) + 0.8] : [0, 1.22 * largest];
  const named = run && view.channel === "T_d" ? names(run, [low, high], largest) : [];
  note.textContent = spectra.length ? "0-to-peak, Hann window" : "";
  return {
    xaxis: { title: { text: "frequency [Hz]" }, type: view.logX ? "log" : "linear", range: x },
    yaxis: {
      title: { text: `amplitude [${unitText(spectra[0]?.unit ?? "N*m")}]` },
      type: view.logY ? "log" : "linear",
      range: view.y ?? y,
      dtick: view.logY ? 1 : undefined,
    },
    annotations: [...named, ...modeNames(run, [low, high], view.logX)],
    shapes: modes(run, [low, high]),
  };
}

function seenAt(amplitude, largest) {
  const y = view.logY ? Math.log10(amplitude) : amplitude;
  return view.y ? y > view.y[0] && y < view.y[1] : amplitude > 4e-4 * largest;
}

/** Names of the strongest lines in the window that stand clear of each other. */
function names(run, [low, high], largest) {
  const place = (f) =>
    view.logX ? Math.log10(f / Math.max(low, 0.05)) / Math.log10(high / Math.max(low, 0.05)) : (f - low) / (high - low);
  const inside = seenLines(run).filter(
    (line) => line.frequency_hz >= low && line.frequency_hz <= high && seenAt(line.amplitude_n_m, largest),
  );
  inside.sort((a, b) => (b.kind === "array mode") - (a.kind === "array mode") || b.amplitude_n_m - a.amplitude_n_m);
  const taken = [];
  for (const line of inside) {
    const x = place(line.frequency_hz);
    if (taken.length < NAMED && taken.every((other) => Math.abs(other.x - x) * plot.clientWidth > APART)) taken.push({ x, line });
  }
  return taken.map(({ line }) => ({
    x: view.logX ? Math.log10(line.frequency_hz) : line.frequency_hz,
    y: view.logY ? Math.log10(line.amplitude_n_m) : line.amplitude_n_m,
    text: `<b>${line.line}</b><br>${number(line.frequency_hz, 4)} Hz · ${quantity(line.amplitude_n_m, "N*m", 3)}`,
    showarrow: true,
    arrowhead: 0,
    arrowwidth: 0.8,
    arrowcolor: ink(),
    ax: 6,
    ay: -18,
    xanchor: "left",
    yanchor: "bottom",
    align: "left",
    font: { size: 10.5 },
  }));
}

const modesIn = (run, [low, high]) =>
  (run?.result?.modes ?? []).filter((mode) => mode.frequency >= low && mode.frequency <= high && mode.damping < 0.3);

function modeNames(run, window, log) {
  return modesIn(run, window).map((mode) => ({
    x: log ? Math.log10(mode.frequency) : mode.frequency,
    yref: "paper",
    y: 0.02,
    yanchor: "bottom",
    xanchor: "left",
    textangle: -90,
    showarrow: false,
    text: mode.name.replaceAll("_", " "),
    font: { size: 10 },
    opacity: 0.75,
  }));
}

function modes(run, window) {
  return modesIn(run, window).map((mode) => ({
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
