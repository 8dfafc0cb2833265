// The Recording tab: a test's file, what is in it, beside the current run, and parameters from it.

import { get, post, upload } from "./api.js";
import { announce, h, number, onDrop, quantity, unitText } from "./dom.js";
import { makeFit } from "./fit.js";
import { draw } from "./plots.js";
import { work } from "./progress.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import { shortTable } from "./tables.js";

let recording = null;
const file = h("input", { type: "file", id: "recording-file", class: "away", accept: ".uff,.unv,.mat,.tdms,.csv,.txt" });
const zone = h(
  "div",
  { class: "dropzone" },
  h("p", {}, "Drop a recording here (UFF, MATLAB, TDMS, CSV), or ", h("label", { class: "button" }, "choose a file…", file)),
  h("p", { class: "soft note" }, "It stays on this machine. Lines are looked for where the scenario on the left expects them."),
);
const state = h("div", { "aria-live": "polite" });
const found = h("div", { hidden: true });
const channel = h("select", { id: "recording-channel", onchange: () => analyse() });
const facts = h("p", { class: "soft" });
const notes = h("p", { class: "soft note" });
const spectrumPlot = h("div", {
  class: "plot tall",
  id: "recording-plot",
  role: "img",
  "aria-label": "Amplitude spectrum of the recording",
});
const densityPlot = h("div", {
  class: "plot",
  id: "density-plot",
  role: "img",
  "aria-label": "Power spectral density of the recording",
});
const logY = h("button", { type: "button", "aria-pressed": "true", onclick: () => turn() }, "log amplitude");
const working = h("div", {});
const lines = h("div", {});
const comparison = h("div", {});
let analysis = null;

const card = (title, ...content) => h("section", { class: "card" }, h("h2", {}, title), ...content);

export function makeRecording(place) {
  file.addEventListener("change", () => {
    if (file.files.length) take(file.files[0]);
    file.value = "";
  });
  onDrop(zone, take);
  const fit = makeFit(() => ({ recordings: [recording.id], channel: channel.value }));
  found.append(
    card(
      "Recording",
      facts,
      h(
        "div",
        { class: "bar" },
        h("label", { for: "recording-channel" }, "Channel"),
        channel,
        h("button", { type: "button", onclick: analyse }, "Analyse again"),
      ),
      working,
    ),
    h("section", { class: "card" }, h("div", { class: "bar" }, h("h2", {}, "Spectrum"), logY, notes), spectrumPlot),
    card("Lines with uncertainty", lines),
    card(
      "Beside the current run",
      h(
        "p",
        { class: "soft" },
        "The run's scenario is simulated at the clock that the recording shows, then both are read the same way.",
      ),
      h("button", { type: "button", onclick: compare }, "Compare with the current run"),
      comparison,
    ),
    card("Identification", fit),
    card("Power spectral density", densityPlot),
  );
  found.className = "figures";
  place.append(zone, state, found);
}

async function take(chosen) {
  state.replaceChildren(h("p", { class: "soft" }, `Reading ${chosen.name} …`));
  try {
    recording = await upload("/api/recordings", { name: chosen.name }, chosen);
  } catch (error) {
    state.replaceChildren(h("p", { class: "error block", role: "alert" }, error.message));
    return;
  }
  state.replaceChildren();
  announce(`${chosen.name} is read.`);
  facts.textContent = `${recording.name}: ${recording.channels.length} channels, ${recording.samples} samples at ${number(recording.sample_rate, 6)} Hz, ${number(recording.duration, 4)} s. ${(recording.notes ?? []).join(" ")}`;
  channel.replaceChildren(
    ...recording.channels.map((item) => h("option", { value: item.name }, `${item.name}, ${quantity(item.rms, item.unit)} RMS`)),
  );
  channel.value = (
    recording.channels.find((item) => item.name === "Mz") ??
    recording.channels.find((item) => item.unit === "N*m") ??
    recording.channels[0]
  )?.name;
  found.hidden = false;
  comparison.replaceChildren();
  await analyse();
}

async function analyse() {
  const body = { recording: recording.id, channel: channel.value, scenario: scenario.current() };
  const answer = await work(working, `Analysis of ${channel.value}`, () => post("/api/analyses", body));
  if (!answer) return;
  analysis = answer;
  notes.textContent = answer.clock_ratio
    ? `step clock at ${number(answer.clock_ratio, 6)} of its nominal rate`
    : "no line of the step clock is seen";
  lines.replaceChildren(linesTable(answer));
  await Promise.all([drawSpectrum(), drawDensity()]);
}

function turn() {
  logY.setAttribute("aria-pressed", String(logY.getAttribute("aria-pressed") !== "true"));
  drawSpectrum();
}

const seen = () => analysis.lines.filter((line) => line.amplitude_n_m !== null && line.status !== "below the floor");

async function drawSpectrum() {
  const { f, amplitude } = analysis.spectrum;
  const unit = unitText(analysis.unit);
  const log = logY.getAttribute("aria-pressed") === "true";
  const largest = Math.max(
    ...seen().map((line) => line.amplitude_n_m),
    amplitude.slice(1).reduce((a, b) => Math.max(a, b), 1e-12),
  );
  const curve = {
    x: f,
    y: amplitude,
    mode: "lines",
    name: analysis.channel,
    line: { color: "#0072B2", width: 1.1 },
    hovertemplate: `%{x:.6g} Hz<br>%{y:.4g} ${unit}<extra></extra>`,
  };
  const marks = {
    x: seen().map((line) => line.frequency_hz),
    y: seen().map((line) => line.amplitude_n_m),
    mode: "markers",
    name: "lines",
    text: seen().map((line) => line.line),
    error_y: {
      type: "data",
      array: seen().map((line) => line.amplitude_uncertainty_n_m ?? 0),
      visible: true,
      color: "#D55E00",
      thickness: 1.5,
      width: 4,
    },
    marker: { color: "#D55E00", size: 7, line: { color: "#fff", width: 0.8 } },
    hovertemplate: `<b>%{text}</b><br>%{x:.7g} Hz<br>%{y:.5g} ${unit}<extra></extra>`,
  };
  return draw(spectrumPlot, [...(await beside()), curve, marks], {
    xaxis: { title: { text: "frequency [Hz]" }, range: [0, Math.min(200, f.at(-1))] },
    yaxis: {
      title: { text: `amplitude [${unit}]` },
      type: log ? "log" : "linear",
      dtick: log ? 1 : undefined,
      range: log ? [Math.log10(largest) - 4.5, Math.log10(largest) + 0.4] : [0, 1.1 * largest],
    },
  });
}

/** The chosen run's torque under the recording's, where both are torques. */
async function beside() {
  const run = runs.selected();
  if (run?.state !== "done" || unitText(analysis.unit) !== "N m") return [];
  const { f, amplitude } = await get(`/api/runs/${run.id}/spectrum`, { channel: "T_d", points: 6000 }).catch(() => ({
    f: [],
    amplitude: [],
  }));
  return [
    {
      x: f,
      y: amplitude,
      mode: "lines",
      name: `T_d of ${run.name}`,
      line: { color: "#E69F00", width: 2.2 },
      opacity: 0.75,
      hovertemplate: "%{x:.6g} Hz<br>%{y:.4g} N m<extra></extra>",
    },
  ];
}

function drawDensity() {
  const { f, psd } = analysis.density;
  const curve = {
    x: f,
    y: psd,
    mode: "lines",
    line: { color: "#009E73", width: 1.1 },
    hovertemplate: `%{x:.5g} Hz<br>%{y:.4g} (${unitText(analysis.unit)})²/Hz<extra></extra>`,
  };
  return draw(densityPlot, [curve], {
    xaxis: { title: { text: "frequency [Hz]" }, range: [0, Math.min(200, f.at(-1))] },
    yaxis: { title: { text: `density [(${unitText(analysis.unit)})²/Hz]` }, type: "log" },
  });
}

const hz = (value) => number(value, 7);
const milli = (digits) => (value) => number(value === null ? null : 1e3 * value, digits);

function linesTable({ lines: rows, notable, unit }) {
  const small = `m${unitText(unit)}`;
  return shortTable(
    [
      { key: "line", title: "line" },
      { key: "frequency_hz", title: "frequency", unit: "Hz", show: hz },
      { key: "frequency_uncertainty_hz", title: "±", unit: "Hz", show: (value) => number(value, 2) },
      { key: "amplitude_n_m", title: "amplitude", unit: small, show: milli(4) },
      { key: "amplitude_uncertainty_n_m", title: "±", unit: small, show: milli(2) },
      { key: "floor_n_m", title: "floor", unit: small, show: milli(2) },
      { key: "origin", title: "what it is" },
      { key: "status", title: "status" },
    ],
    rows,
    (line) => notable.includes(line.line),
    { caption: "Lines of the recording" },
  );
}

async function compare() {
  const run = runs.selected();
  if (run?.state !== "done") {
    comparison.replaceChildren(
      h("p", { class: "error", role: "alert" }, "There is no finished run to compare with; start one first."),
    );
    return;
  }
  const result = h("div", {});
  const place = h("div", {});
  comparison.replaceChildren(place, result);
  const answer = await work(place, `Comparison with ${run.name}`, () =>
    post("/api/comparisons", { recording: recording.id, run: run.id, channel: channel.value }),
  );
  if (!answer) return;
  const { a, b, rows } = answer;
  result.replaceChildren(
    h("p", { class: "soft" }, `${a.name} (${a.kind}) and ${b.name} (${b.kind}).`),
    shortTable(
      [
        { key: "line", title: "line" },
        { key: "a_hz", title: "recording", unit: "Hz", show: hz },
        { key: "b_hz", title: "run", unit: "Hz", show: hz },
        { key: "a_n_m", title: "recording", unit: "mN m", show: milli(4) },
        { key: "b_n_m", title: "run", unit: "mN m", show: milli(4) },
        {
          key: "error",
          title: "run against recording",
          show: (value) => (value === null ? "–" : `${value > 0 ? "+" : ""}${number(100 * value, 3)} %`),
        },
      ],
      rows,
      (row) => analysis.notable.includes(row.line),
      { caption: "Recording beside run" },
    ),
  );
}
