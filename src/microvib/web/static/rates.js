// The Rate map tab: lines over rate (Campbell diagram), where they meet modes, which rates a limit forbids.

import { post } from "./api.js";
import { describedField } from "./described.js";
import { announce, h, number } from "./dom.js";
import { amplitudeAxis, onUnits, shown } from "./measures.js";
import { draw, ground, ink } from "./plots.js";
import { keepFields } from "./kept.js";
import { modeNames, together } from "./labels.js";
import { makeTask } from "./progress.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import { LIMIT, style } from "./styles.js";
import { card, partCards, partContent } from "./tables.js";

const FAINTEST = 1e-3;
const PANEL = 250; // height of one diagram
const NAME = 14; // and of a name in it, in pixels
const deg = (rate) => (180 / Math.PI) * rate;

const ASKED = [
  ["from", "from", "0.01 deg/s"],
  ["to", "to", "0.3 deg/s"],
  ["count", "rates", "60"],
  ["microsteps", "microsteps", "16, 32"],
  ["band", "band of lines", ""],
];
const HINTS = { band: "such as 0.5:5 Hz" };
const inputs = Object.fromEntries(
  ASKED.map(([key, , value]) => [
    key,
    h("input", {
      type: "text",
      id: `rates-${key}`,
      name: key,
      value,
      placeholder: HINTS[key] ?? "",
      class: key === "count" ? "short" : "",
    }),
  ]),
);
const limit = describedField("rates-limit", "Limit of a line: a torque, or a curve over frequency (CSV)", { placeholder: "30 mN*m, or the lines of a table: frequency_hz,t_mnm …", rows: 2, accept: ".csv,.txt,text/csv" });
const linear = h("input", { type: "checkbox", id: "rates-linear" });
const place = h("div", {});
const result = h("div", { class: "figures" });
const narrow = matchMedia("(max-width: 600px)");
let redraw = () => {};
narrow.addEventListener("change", () => redraw());
onUnits(() => redraw());
const task = makeTask("rates", place, show);

export function makeRates(tab) {
  const ask = h(
    "form",
    { onsubmit: plan },
    limit.element,
    h(
      "div",
      { class: "ask" },
      ASKED.map(([key, words]) => h("label", {}, words, inputs[key])),
      h("label", { class: "check", title: "Driving lines only, in closed form" }, linear, "linearised drive (instant)"),
      h("button", { class: "primary" }, "Map"),
    ),
  );
  tab.append(h("section", { class: "card" }, h("h2", {}, "Rate map of the scenario"), ask, place), result);
  keepFields("rates.asked", { ...inputs, limit: limit.input, linear });
  task.restore();
}

/** A map of the library. */
export const openRates = ({ id, title, asked }) => task.open({ id, name: title, context: { scenario: asked.scenario } });

async function plan(event) {
  event.preventDefault();
  const text = (key) => inputs[key].value.trim();
  const body = {
    scenario: scenario.current(),
    from: text("from"),
    to: text("to"),
    count: Number(text("count")),
    linear: linear.checked,
    microsteps: text("microsteps")
      .split(/[\s,]+/)
      .filter(Boolean)
      .map(Number),
    limit: limit.input.value.trim() || undefined,
    band: text("band") || undefined,
  };
  await task.start("Rate map", () => post("/api/rates", body), { scenario: body.scenario });
}

const clicked = new WeakSet(); // diagrams that are listened to

/** A point of the diagram as a run: its rate and microstep count in the scenario of the map. */
function letClick(place, offer, of) {
  if (clicked.has(place) || !of) return;
  clicked.add(place);
  place.on("plotly_click", ({ points: [point] }) => {
    const [rate, microsteps] = point.customdata ?? [];
    if (rate === undefined) return;
    const text = `${Number(rate.toPrecision(6))} deg/s`;
    const changes = { ...of.changes, "tracking.rate": text, "driver.microsteps": String(microsteps) };
    const begin = () => {
      document.getElementById("tab-run").click();
      return runs.start({ scenario: { ...of, changes }, name: `${text}, ${microsteps} microsteps`, steady: true, seeds: null });
    };
    const run = () => begin().catch((error) => announce(error.message, { error: true }));
    offer.replaceChildren(`${text}, ${microsteps} microsteps: `, h("button", { type: "button", onclick: run }, "Run it in its steady state"));
  });
}

async function show(plan, context) {
  const counts = [...new Set(plan.cases.map((item) => item.microsteps))];
  const campbell = h("div", { class: "plot", id: "campbell-plot", role: "img", "aria-label": "Campbell diagram" });
  const largest = h("div", { class: "plot", id: "largest-plot", role: "img", "aria-label": "Largest line over rate" });
  const offer = h("p", { class: "offer", role: "status" });
  const [first, ...others] = plan.parts;
  result.replaceChildren(
    card("Best rates", plan.summary, ...partContent(first)),
    card("Campbell diagram", "Dashed: modes through the drive; rings: where a line meets one. A click on a point offers its run.", offer, campbell),
    card(byCurve(plan) ? "Line nearest to the limit over rate" : "Largest line over rate", byCurve(plan) ? "Red: what the limit allows at the frequency of that line." : "", largest),
    ...partCards(others),
  );
  redraw = () => Promise.all([drawCampbell(campbell, plan, counts), drawLargest(largest, plan, counts)]);
  await redraw();
  for (const diagram of [campbell, largest]) letClick(diagram, offer, context?.scenario);
}

function drawCampbell(place, plan, counts) {
  const columns = Math.min(counts.length, narrow.matches ? 1 : 2);
  place.style.height = `${(PANEL + 80) * Math.ceil(counts.length / columns) + 40}px`;
  const top = plan.cases.flatMap((item) => item.lines).reduce((most, line) => Math.max(most, line.amplitude), 1e-12);
  const seen = frequencies(plan, top);
  const decades = (f) => Math.log10(f / seen[0]) / Math.log10(seen[1] / seen[0]);
  const traces = [];
  const layout = {
    grid: { rows: Math.ceil(counts.length / columns), columns, pattern: "independent", xgap: 0.2, ygap: 0.24 },
    shapes: [],
    annotations: [],
    showlegend: false,
    coloraxis: scale(top),
    margin: { l: 60, r: 10, t: 30, b: 44 },
  };
  counts.forEach((n, k) => {
    const tail = k ? String(k + 1) : "";
    traces.push(...panel(plan, n, tail, top));
    layout[`xaxis${tail}`] = { title: { text: "rate of the array [deg/s]", standoff: 4 }, hoverformat: ".5g" };
    layout[`yaxis${tail}`] = { title: { text: "frequency [Hz]" }, type: "log", dtick: 1, range: seen.map(Math.log10) };
    layout.annotations.push({
      text: `<b>${n} microsteps per full step</b>`,
      xref: `x${tail} domain`,
      yref: `y${tail} domain`,
      x: 0,
      y: 1.01,
      yanchor: "bottom",
      xanchor: "left",
      showarrow: false,
    });
    for (const mode of plan.modes)
      layout.shapes.push({
        type: "line",
        xref: `x${tail} domain`,
        yref: `y${tail}`,
        x0: 0,
        x1: 1,
        y0: mode.frequency,
        y1: mode.frequency,
        line: { color: ink(), width: 0.9, dash: "dash" },
        opacity: 0.6,
      });
    for (const group of together(plan.modes, (mode) => decades(mode.frequency) * PANEL, NAME))
      layout.annotations.push({
        text: `${modeNames(group)} ${span(group)}`,
        xref: `x${tail} domain`,
        yref: `y${tail}`,
        x: 1,
        y: Math.log10(group.at(-1).frequency),
        xanchor: "right",
        yanchor: "bottom",
        showarrow: false,
        font: { size: 10 },
        bgcolor: ground(),
        borderpad: 0,
      });
    layout.shapes.push(...bands(plan, n, tail));
  });
  return draw(place, traces, layout);
}

/** Lowest and highest frequency of what is shown, with room for a name above. */
function frequencies(plan, top) {
  const shown = plan.cases.flatMap((item) => item.lines.filter((line) => line.amplitude >= FAINTEST * top));
  const all = [...shown, ...plan.modes].map((item) => item.frequency).filter((f) => f > 0);
  return [Math.min(...all) / 1.3, Math.max(...all) * 1.6];
}

function span(modes) {
  const [low, high] = [modes[0], modes.at(-1)].map((mode) => number(mode.frequency, 3));
  return low === high ? `${low} Hz` : `${low}–${high} Hz`;
}

function scale(top) {
  const decades = [0, -1, -2, -3].map((k) => Math.floor(Math.log10(top)) + k).filter((k) => k >= Math.log10(FAINTEST * top));
  return {
    colorscale: "Viridis",
    reversescale: true,
    cmin: Math.log10(FAINTEST * top),
    cmax: Math.log10(top),
    colorbar: {
      title: { text: `amplitude, ${amplitudeAxis("N*m").words}`, side: "right" },
      thickness: 12,
      tickvals: decades,
      ticktext: decades.map((k) => shown(10 ** k, "N*m", 1)),
    },
  };
}

function panel(plan, n, tail, top) {
  const points = plan.cases
    .filter((item) => item.microsteps === n)
    .flatMap((item) =>
      item.lines.filter((line) => line.amplitude >= FAINTEST * top).map((line) => ({ rate: deg(item.rate), ...line })),
    )
    .sort((a, b) => a.amplitude - b.amplitude);
  const met = plan.resonances.filter((item) => item.microsteps === n);
  const axes = { xaxis: `x${tail}`, yaxis: `y${tail}`, mode: "markers" };
  return [
    {
      ...axes,
      x: points.map((p) => p.rate),
      y: points.map((p) => p.frequency),
      customdata: points.map((p) => [p.rate, n]),
      text: points.map((p) => `<b>${p.line}</b>, ${shown(p.amplitude, "N*m", 4)}`),
      marker: { color: points.map((p) => Math.log10(p.amplitude)), coloraxis: "coloraxis", size: 4.5 },
      hovertemplate: "%{text}<br>%{x:.4g} deg/s, %{y:.4g} Hz<extra></extra>",
    },
    {
      ...axes,
      x: met.map((r) => deg(r.rate)),
      y: met.map((r) => r.frequency),
      customdata: met.map((r) => [deg(r.rate), n]),
      text: met.map((r) => `<b>${r.line}</b> on ${r.mode.replaceAll("_", " ")}, ${shown(r.amplitude, "N*m")}`),
      marker: { symbol: "circle-open", size: 11, color: "#D55E00", line: { width: 1.6 } },
      hovertemplate: "%{text}<br>%{x:.4g} deg/s, %{y:.4g} Hz<extra></extra>",
    },
  ];
}

const bands = (plan, n, tail) =>
  plan.forbidden
    .filter((band) => band.microsteps === n)
    .map((band) => ({
      type: "rect",
      xref: `x${tail}`,
      yref: `y${tail} domain`,
      x0: deg(band.low),
      x1: deg(band.high),
      y0: 0,
      y1: 1,
      fillcolor: LIMIT,
      opacity: 0.13,
      line: { width: 0 },
      layer: "below",
    }));

/** A logarithmic axis; within a decade the ticks are whole numbers, for a lone digit between powers of ten would be read as one. */
function logarithmic(axis, traces) {
  if (axis.dB) return {};
  const all = traces.flatMap(({ y }) => y).filter((value) => value > 0);
  return { type: "log", ...(Math.max(...all) > 10 * Math.min(...all) ? { dtick: "D2" } : { tickformat: ".3~g", nticks: 6 }) };
}

/** Whether a map was judged by a limit over frequency. */
const byCurve = (plan) => plan.cases.some(({ nearest }) => nearest);

function drawLargest(place, plan, counts) {
  const axis = amplitudeAxis("N*m");
  if (byCurve(plan)) return drawNearest(place, plan, counts, axis);
  const [low, high] = plan.band?.map((edge) => edge ?? Infinity) ?? [0, Infinity];
  const top = (item) =>
    item.lines
      .filter((line) => line.frequency >= low && line.frequency <= high)
      .reduce((most, line) => Math.max(most, line.amplitude), 0) || null;
  const traces = counts.map((n, k) => {
    const cases = plan.cases.filter((item) => item.microsteps === n);
    const [color, dash] = style(k);
    return {
      x: cases.map((item) => deg(item.rate)),
      y: cases.map((item) => top(item) && axis.y(top(item))),
      customdata: cases.map((item) => [deg(item.rate), n]),
      name: `${n} microsteps`,
      mode: "lines+markers",
      line: { color, dash, width: 1.4 },
      marker: { size: 4 },
      hovertemplate: `%{x:.4g} deg/s<br>%{y:.4g} ${axis.printed}<extra>${n} microsteps</extra>`,
    };
  });
  const limit =
    plan.limit === null
      ? []
      : [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: axis.y(plan.limit), y1: axis.y(plan.limit), line: { color: LIMIT, width: 2 } }];
  return draw(place, traces, {
    xaxis: { title: { text: "rate of the array [deg/s]" } },
    yaxis: { title: { text: `largest line [${axis.printed}]` }, ...logarithmic(axis, traces) },
    shapes: limit,
  });
}

/** Of each rate the line with the smallest margin to a limit over frequency, and what that allows it. */
function drawNearest(place, plan, counts, axis) {
  const traces = counts.flatMap((n, k) => {
    const cases = plan.cases.filter((item) => item.microsteps === n && item.nearest);
    const [color, dash] = style(k);
    const along = {
      x: cases.map((item) => deg(item.rate)),
      customdata: cases.map((item) => [deg(item.rate), n]),
      text: cases.map(({ nearest }) => nearest.line),
    };
    const hover = `<b>%{text}</b><br>%{x:.4g} deg/s<br>%{y:.4g} ${axis.printed}`;
    return [
      { ...along, y: cases.map(({ nearest }) => axis.y(nearest.amplitude)), name: `${n} microsteps`, mode: "lines+markers", line: { color, dash, width: 1.4 }, marker: { size: 4 }, hovertemplate: `${hover}<extra>${n} microsteps</extra>` },
      { ...along, y: cases.map(({ nearest }) => axis.y(nearest.allowed)), name: `limit, ${n} microsteps`, mode: "lines", line: { color: LIMIT, dash, width: 1.6, shape: "hv" }, hovertemplate: `${hover}<extra>limit</extra>` },
    ];
  });
  return draw(place, traces, {
    xaxis: { title: { text: "rate of the array [deg/s]" } },
    yaxis: { title: { text: `line nearest to the limit [${axis.printed}]` }, ...logarithmic(axis, traces) },
  });
}
