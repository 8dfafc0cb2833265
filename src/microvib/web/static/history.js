// Time history: a channel of all shown runs; below it the phase currents and the stick of the chosen one, on the same time.
// Each zoom asks the server for that window, as an envelope, so that peaks survive and a microstep is seen sample by sample.

import { fillChannels, has } from "./channels.js";
import { addCursors } from "./cursors.js";
import { announce, h, unitText } from "./dom.js";
import { keep, kept } from "./kept.js";
import { latest } from "./latest.js";
import { sampleAxis } from "./measures.js";
import { draw, envelopeTrace, ink, onZoom } from "./plots.js";
import * as runs from "./runs.js";
import { PHASE, STICK } from "./styles.js";

const view = { channel: "T_d", window: null, y: null, ...kept("history", {}) };
const BELOW = [...Object.keys(PHASE), ...Object.keys(STICK)];

const plot = h("div", { class: "plot taller", id: "history-plot", role: "img", "aria-label": "Time history of the runs" });
const channel = h("select", { id: "history-channel", onchange: () => set({ channel: channel.value }) });
const note = h("span", { class: "soft note" });
const button = (text, action, title) => h("button", { type: "button", onclick: action, title, "aria-label": title }, text);

export const card = h(
  "section",
  { class: "card" },
  h(
    "div",
    { class: "bar" },
    h("h2", {}, "Time history"),
    h("label", { for: "history-channel", class: "away" }, "Channel"),
    channel,
    button("Whole record", () => set({ window: null })),
    button("One second", () => set({ window: stretch(1) })),
    button("Full step", () => set({ window: stretch(microstep() * microsteps()) })),
    button("4 microsteps", () => set({ window: stretch(4 * microstep()) })),
    button("‹", () => shift(-0.5), "Earlier"),
    button("›", () => shift(0.5), "Later"),
    note,
  ),
  plot,
);

function set(changes) {
  Object.assign(view, { y: null }, changes);
  keep("history", view);
  return update().catch((error) => announce(error.message, { error: true }));
}

const result = () => runs.shown().at(-1)?.result;
const microstep = () => 1 / (result()?.drivetrain.f_d || 50);
const microsteps = () => Number(result()?.values["driver.microsteps"]) || 16;

function stretch(length) {
  const { t0, t1 } = result() ?? { t0: 0, t1: 1 };
  const from = view.window ? Math.max((view.window[0] + view.window[1] - length) / 2, t0) : t0;
  return [from, Math.min(from + length, t1)];
}

const reaches = ({ result: { t0, t1 } }) => view.window[0] < t1 && view.window[1] > t0;

/** Move the window by a part of its length, within the record. */
function shift(part) {
  const { t0, t1 } = result() ?? {};
  if (!view.window || t0 === undefined) return;
  const length = view.window[1] - view.window[0];
  const from = Math.min(Math.max(view.window[0] + part * length, t0), t1 - length);
  set({ window: [from, from + length] });
}

addCursors(plot, "time");

let listening = false;
const asking = latest();

/** Ask for the window of each run, and draw it. */
export async function update() {
  fillChannels(channel, runs.shown(), view.channel);
  const all = runs.shown().filter((run) => has(run, view.channel));
  const shown = all.slice(-STRIPS);
  const chosen = shown.at(-1);
  if (view.window && !shown.some(reaches)) view.window = null; // it was another run's
  const [from, to] = view.window ?? [undefined, undefined];
  const channels = (run) => (run === chosen ? [...new Set([view.channel, ...BELOW])] : [view.channel]).join(",");
  await asking(
    (signal) =>
      Promise.all(shown.map((run) => runs.ask(run, "series", { channels: channels(run), from, to, points: 1500 }, { signal }))),
    (series) => show(shown, series, chosen, all.length),
  );
}

async function show(shown, series, chosen, of) {
  // Envelopes fill their place: over each other only the last would be seen, so each run has a strip of its own.
  const strips = shown.length > 1 && series.some((one) => !one.exact) ? shown.length : 1;
  const place = places(strips);
  plot.style.height = `${place.height}px`;
  const traces = shown.map((run, k) => curve(run, series[k], strips > 1 ? axisOf(k) : ""));
  if (chosen) traces.push(...below(series.at(-1)));
  await draw(plot, traces, layout(shown, series, strips, place));
  note.textContent = words(series, strips, of);
  if (!listening) onZoom(plot, ({ x = view.window, y = view.y }) => set({ window: x, y }));
  listening = true;
}

const STRIPS = 8; // runs at most, of which the chosen is one
const STRIP = 92; // pixels of a run's strip, of which a tenth is its gap
const ALONE = 220;
const UNDER = 190; // currents and sticking below
const AROUND = 90; // legend and time axis

/** Number of the axis of the k-th strip; the second and third belong to currents and sticking. */
const axisOf = (k) => (k ? String(k + 3) : "");

/** Where the axes lie, as parts of the height from below. */
function places(strips) {
  const upper = strips > 1 ? strips * STRIP : ALONE;
  const inner = upper + UNDER;
  const part = (pixels) => pixels / inner;
  return {
    height: inner + AROUND,
    sticks: [0, part(46)],
    currents: [part(66), part(UNDER - 22)],
    strip: (k) => {
      const top = 1 - part((k * upper) / strips);
      return [top - part((strips > 1 ? 0.88 * upper : upper) / strips), top];
    },
  };
}

function curve(run, series, axis) {
  const data = series.channels[view.channel];
  const { factor, printed } = sampleAxis(data.unit);
  const { x, y } = envelopeTrace(series.t, data, series.exact);
  return {
    x,
    y: factor === 1 ? y : y.map((value) => factor * value),
    name: run.name,
    mode: "lines",
    yaxis: `y${axis}`,
    line: { color: run.colour, dash: series.exact ? run.dash : "solid", width: series.exact ? 1.6 : 1 },
    hovertemplate: `%{x:.6g} s<br>${view.channel} %{y:.4g} ${printed ?? unitText(data.unit)}<extra>%{fullData.name}</extra>`,
  };
}

function below(series) {
  const currents = Object.entries(PHASE).map(([name, [color, dash]]) => ({
    ...envelopeTrace(series.t, series.channels[name], series.exact),
    name,
    mode: "lines",
    yaxis: "y2",
    line: { color, dash, width: 1.2 },
    hovertemplate: `%{x:.6g} s<br>${name} %{y:.4g} A<extra></extra>`,
  }));
  const stick = Object.entries(STICK).map(([name, [color, words]], k) => ({
    ...envelopeTrace(series.t, series.channels[name], series.exact),
    name: words,
    mode: "lines",
    yaxis: "y3",
    fill: k ? undefined : "tozeroy",
    line: { color, width: 1.2, dash: k ? "dash" : "solid" },
    hovertemplate: `%{x:.6g} s<br>${words}: %{y:.3g} of the sample<extra></extra>`,
  }));
  return [...currents, ...stick];
}

/** What is drawn: every sample or not, and of which runs. */
function words(series, strips, of) {
  if (!series.length) return "";
  const sort = series.every((one) => one.exact) ? "every sample" : "smallest and largest of each stretch";
  const some = of > series.length ? `; the chosen and ${series.length - 1} others of ${of} runs` : "";
  return `${sort}${strips > 1 ? "; one strip for each run" : ""}${some}`;
}

function layout(shown, series, strips, place) {
  const plain = series[0]?.channels[view.channel].unit;
  const unit = sampleAxis(plain).printed ?? unitText(plain);
  const title = `${view.channel}${unit ? ` [${unit}]` : ""}`;
  const [t0, t1] = view.window ?? spanOf(shown);
  const upper = Array.from({ length: strips }, (_, k) => [
    `yaxis${axisOf(k)}`,
    {
      title: { text: k === (strips - 1) >> 1 ? title : "" },
      domain: place.strip(k),
      range: view.y ?? undefined,
      matches: k ? "y" : undefined,
      nticks: strips > 1 ? 4 : undefined,
    },
  ]);
  return {
    height: place.height,
    xaxis: { title: { text: "time [s]" }, range: [t0, t1], anchor: "y3", hoverformat: ".6f" },
    ...Object.fromEntries(upper),
    yaxis2: { title: { text: "currents [A]" }, domain: place.currents },
    yaxis3: {
      title: { text: "sticks" },
      domain: place.sticks,
      range: [-0.08, 1.08],
      tickvals: [0, 1],
      ticktext: ["no", "yes"],
      fixedrange: true,
    },
    legend: { orientation: "h", x: 0, y: 1.01, yanchor: "bottom", font: { size: 11, color: ink() } },
  };
}

const spanOf = (shown) =>
  shown.length
    ? [Math.min(...shown.map((run) => run.result.t0)), Math.max(...shown.map((run) => run.result.t1))]
    : [0, 1];
