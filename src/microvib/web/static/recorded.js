// Pictures of an analysed recording. Each zoom asks the server for that stretch, so that it is seen bin by bin.

import { get } from "./api.js";
import { has } from "./channels.js";
import { addCursors } from "./cursors.js";
import { basesOf } from "./orders.js";
import { announce, debounce, h, unitText } from "./dom.js";
import { keep, kept } from "./kept.js";
import { textWidth, together } from "./labels.js";
import { latest } from "./latest.js";
import { amplitudeAxis, densityAxis, onUnits } from "./measures.js";
import { bounds, draw, ground, onZoom, stretch } from "./plots.js";
import { limitCurve, limitLine, limitName, namesOfLines, scaled, seen } from "./spectrum_marks.js";
import * as runs from "./runs.js";
import { BACKGROUND, LINE, RECORDED } from "./styles.js";

const HIGHEST = 200;
const LOWEST = 0.1; // of a logarithmic axis of frequencies, unless the second bin is higher [Hz]

/** A card with one picture; `ask(analysis, window)` gets its data, `paint(analysis, view, data)` makes traces and layout of it. */
function picture(key, title, { ask, paint, log = true, more = [] }) {
  const view = { window: [0, HIGHEST], y: null, log, logX: false, ...kept(key, {}) };
  const plot = h("div", { class: "plot tall", id: `${key}-plot`, role: "img", "aria-label": `${title} of the recording` });
  const note = h("span", { class: "soft note" });
  const logY = h("button", { type: "button", onclick: () => set({ log: !view.log, y: null }) }, "log amplitude");
  const logX = h("button", { type: "button", onclick: () => set({ logX: !view.logX, y: null }) }, "log f");
  const all = h("button", { type: "button", onclick: () => set({ window: null, y: null }) }, "All");
  const low = h("button", { type: "button", onclick: () => set({ window: [0, HIGHEST], y: null }) }, `0–${HIGHEST} Hz`);
  const bar = h("div", { class: "bar" }, h("h2", {}, title), logY, logX, low, all, more, note);
  const asking = latest();
  let shown = null;
  let last = null; // what is drawn
  let listening = false;

  function set(changes) {
    Object.assign(view, changes);
    keep(key, view);
    return update();
  }

  async function update() {
    if (!shown) return;
    const analysis = shown;
    await asking(
      (signal) => ask(analysis, { ...stretch(view.window), points: 4000, log: view.logX }, { signal }),
      async (data) => {
        logY.setAttribute("aria-pressed", String(view.log));
        logX.setAttribute("aria-pressed", String(view.logX));
        await repaint(analysis, data);
        if (!listening) onZoom(plot, ({ x, y = view.y }) => set({ window: x === undefined ? view.window : fromAxis(x), y }));
        listening = true;
      },
    ).catch((error) => announce(error.message, { error: true }));
  }

  // A logarithmic axis speaks in decades.
  function fromAxis(window) {
    if (window === null) return [0, HIGHEST];
    return view.logX ? window.map((decade) => 10 ** decade) : window;
  }

  async function repaint(analysis, data) {
    last = [analysis, data];
    const area = areaOf(plot);
    await draw(plot, ...paint(analysis, view, data, area));
    if (String(area) !== String(areaOf(plot))) await draw(plot, ...paint(analysis, view, data, areaOf(plot))); // names have their places in pixels
  }

  new ResizeObserver(debounce(() => last && plot.clientWidth && repaint(...last), 200)).observe(plot);
  onUnits(() => set({ y: null }));
  const card = h("section", { class: "card" }, bar, plot);
  addCursors(plot, "frequency", () => basesOf(runs.selected()?.result));
  return {
    card,
    update,
    show: (analysis, words) => {
      shown = analysis;
      note.textContent = words;
      return update();
    },
  };
}

const AROUND = 76; // margins of a plot, before it has been drawn

/** Width and height of a plot within its axes. */
function areaOf(plot) {
  const size = plot._fullLayout?._size;
  return size ? [Math.round(size.w), Math.round(size.h)] : [plot.clientWidth - AROUND, plot.clientHeight - AROUND];
}

/** The axis of frequencies of what is shown, and its ends in its own units; a logarithmic one begins at the second bin. */
function frequencies(view, f) {
  const [low, high] = view.window ?? [0, f.at(-1)];
  if (!view.logX) return { title: { text: "frequency [Hz]" }, type: "linear", range: [low, high] };
  const first = f.find((x) => x > 0) ?? LOWEST;
  const lowest = Math.max(low, first, Math.min(LOWEST, high / 10));
  return { title: { text: "frequency [Hz]" }, type: "log", range: [Math.log10(lowest), Math.log10(high)] };
}

// What is at 0 Hz has no place on a logarithmic axis; the curve would go on level from it.
const beyondZero = (view, f, values) => {
  const kept = f.map((x) => x > 0 || !view.logX);
  return { x: f.filter((_, k) => kept[k]), y: values.filter((_, k) => kept[k]) };
};

const recorded = ({ id }, of, query, options) => get(`/api/analyses/${id}/spectrum`, { of, ...query }, options);

const CHOSEN = "";
const NONE = "none";
const beneath = h("select", {
  id: "recording-beneath",
  "aria-label": "Run beneath the recording",
  onchange: () => {
    keep("recording.beneath", beneath.value);
    spectrum.update();
  },
});

/** Offer the runs that have ended; the one that was asked for stays. */
function fillBeneath() {
  const there = runs.all().filter((run) => run.state === "done");
  const options = [[CHOSEN, "beneath: the chosen run"], [NONE, "nothing beneath"], ...there.map((run) => [run.id, `beneath: ${run.name}`])]; // prettier-ignore
  beneath.replaceChildren(...options.map(([value, words]) => h("option", { value }, words)));
  const wanted = kept("recording.beneath", CHOSEN);
  beneath.value = options.some(([value]) => value === wanted) ? wanted : CHOSEN;
}

const runBeneath = () => (beneath.value === CHOSEN ? runs.selected() : runs.all().find((run) => run.id === beneath.value));

export const spectrum = picture("recording", "Spectrum", {
  more: [beneath],
  ask: (analysis, query, options) =>
    Promise.all([
      recorded(analysis, "amplitude", query, options),
      beside(analysis, query, options),
      analysis.background ? recorded(analysis, "background", query, options) : null,
    ]),
  paint: paintSpectrum,
});

export const density = picture("density", "Power spectral density", {
  ask: (analysis, query, options) => recorded(analysis, "density", query, options),
  paint: paintDensity,
});

/** The same load of the chosen run under the recording's: its torque T_d, or a component of what its hub feels. */
async function beside({ run_channel: channel }, query, options) {
  fillBeneath();
  const run = runBeneath();
  if (run?.state !== "done" || !has(run, channel)) return null;
  const found = await runs.ask(run, "spectrum", { channel, ...query }, options).catch(() => null);
  return found && { run, channel, ...found };
}

function paintSpectrum(analysis, view, [{ f, values }, other, off], area) {
  const axis = amplitudeAxis(analysis.unit);
  const unit = axis.printed ?? unitText(analysis.unit);
  const log = view.log && !axis.dB;
  const { limit } = analysis;
  const largest = Math.max(...values, ...seen(analysis).map((line) => line.amplitude_n_m), limit?.torque ?? 0, 1e-15);
  const xaxis = frequencies(view, f);
  const y = view.y ?? bounds(axis.y(largest), view.log, axis.dB);
  const axes = scaled({ x: xaxis.range, y, axis: { ...axis, printed: unit }, logX: view.logX, logY: view.log, area });
  const mains = mainsOf(analysis, axes);
  const curve = {
    ...beyondZero(view, f, values.map(axis.y)),
    mode: "lines",
    name: analysis.channel,
    line: { color: RECORDED, width: 1.1 },
    hovertemplate: `%{x:.6g} Hz<br>%{y:.4g} ${unit}<extra></extra>`,
  };
  return [
    [
      ...(other ? [under(other, view, axis)] : []),
      ...(off ? background(off, analysis, view, unit, axis) : []),
      curve,
      marks(seen(analysis), unit, axis),
      ...limitCurve(limit, axes.axis),
    ],
    {
      xaxis,
      yaxis: {
        title: { text: `amplitude [${unit}], ${axis.words}` },
        type: log ? "log" : "linear",
        dtick: log ? 1 : undefined,
        range: y,
      },
      shapes: [...mains.shapes, ...limitLine(limit, axes)],
      annotations: [
        ...mains.annotations,
        ...namesOfLines(seen(analysis), axes, limit, { unit: analysis.unit, kept: mains.boxes }),
        ...limitName(limit, axes, analysis.unit),
      ],
    },
  ];
}

/** What is there with the drive off: its spectrum, and its lines. */
function background({ f, values }, { background_lines: lines }, view, unit, axis) {
  const spectrum = { ...beyondZero(view, f, values.map(axis.y)), mode: "lines", name: "background, drive off", line: { color: BACKGROUND, width: 1 } };
  const marked = {
    x: lines.map((line) => line.frequency_hz),
    y: lines.map((line) => axis.y(line.amplitude_n_m)),
    text: lines.map(({ line, mains }) => [line && `beside ${line}`, mains && `mains? ${mains}`].filter(Boolean).join("<br>") || "line of the background"),
    mode: "markers",
    name: "lines of the background",
    marker: { color: BACKGROUND, size: 7, symbol: "x-thin", line: { color: BACKGROUND, width: 1.6 } },
    hovertemplate: `<b>%{text}</b><br>%{x:.7g} Hz<br>%{y:.5g} ${unit}<extra></extra>`,
  };
  return [{ ...spectrum, hovertemplate: `%{x:.6g} Hz<br>%{y:.4g} ${unit}<extra></extra>` }, ...(lines.length ? [marked] : [])];
}

const SIZE = 10; // of the mains' names
const UP = 0.06; // of their places, over the lower edge

/** Places of lines that may be pick-up of the mains, their names at the foot of the picture, and the boxes that these take. */
function mainsOf({ mains: found = [], background_lines: off = [] }, axes) {
  const marked = [...found, ...off.filter((line) => line.mains).map((line) => ({ frequency: line.frequency_hz, mains: line.mains }))];
  const places = [...new Map(marked.map((one) => [one.mains, one])).values()].filter(({ frequency }) => axes.sees(frequency));
  const named = together(places, ({ frequency }) => axes.right(frequency), 1.4 * SIZE).map(([first, ...others]) => ({
    frequency: first.frequency,
    words: ["mains?", [first, ...others].map(({ mains }) => mains).join(", ")].join(" "),
  }));
  const foot = (1 - UP) * axes.height;
  return {
    shapes: places.map(({ frequency: x }) => ({ type: "line", x0: x, x1: x, yref: "paper", y0: 0, y1: 1, line: { color: BACKGROUND, width: 0.9, dash: "dot" } })),
    annotations: named.map(({ frequency, words: text }) => ({ x: axes.onX(frequency), yref: "paper", y: UP, yanchor: "bottom", xanchor: "left", textangle: -90, showarrow: false, text, font: { size: SIZE, color: BACKGROUND }, bgcolor: ground() })),
    boxes: named.map(({ frequency, words }) => {
      const left = axes.right(frequency);
      return { left, right: left + 1.6 * SIZE, top: foot - textWidth(words, SIZE), bottom: foot };
    }),
  };
}

const under = ({ run, channel, f, amplitude }, view, axis) => ({
  ...beyondZero(view, f, amplitude.map(axis.y)),
  mode: "lines",
  name: `${channel} of ${run.name}`,
  line: { color: run.colour, width: 2.2 },
  opacity: 0.75,
  hovertemplate: `%{x:.6g} Hz<br>%{y:.4g}<extra></extra>`,
});

const marks = (lines, unit, axis) => ({
  x: lines.map((line) => line.frequency_hz),
  y: lines.map((line) => axis.y(line.amplitude_n_m)),
  mode: "markers",
  name: "lines, with their standard uncertainty",
  text: lines.map((line) => line.line),
  error_y: {
    type: "data",
    array: lines.map((line) => upTo(line, axis)),
    visible: true,
    color: LINE,
    thickness: 1.5,
    width: 4,
  },
  marker: { color: LINE, size: 6, line: { color: "#fff", width: 0.8 } },
  hovertemplate: `<b>%{text}</b><br>%{x:.7g} Hz<br>%{y:.5g} ${unit}<extra></extra>`,
});

/** From a line's amplitude to that and its uncertainty, on the axis. */
const upTo = ({ amplitude_n_m: amplitude, amplitude_uncertainty_n_m: spread }, { y }) => y(amplitude + (spread ?? 0)) - y(amplitude);

function paintDensity(analysis, view, { f, values }) {
  const axis = densityAxis(analysis.unit);
  const unit = axis.printed ?? `(${unitText(analysis.unit)})²/Hz`;
  const log = view.log && !axis.dB;
  const curve = {
    ...beyondZero(view, f, values.map(axis.y)),
    mode: "lines",
    line: { color: RECORDED, width: 1.1 },
    hovertemplate: `%{x:.5g} Hz<br>%{y:.4g} ${unit}<extra></extra>`,
  };
  return [
    [curve],
    {
      xaxis: frequencies(view, f),
      yaxis: {
        title: { text: `density [${unit}]` },
        type: log ? "log" : "linear",
        dtick: log ? 1 : undefined,
        range: view.y ?? undefined,
      },
      showlegend: false,
    },
  ];
}
