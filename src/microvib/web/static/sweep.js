// Lines over one value of the scenario, from one end to another: of steady states, or of the linearised drive.

import { post } from "./api.js";
import { announce, h } from "./dom.js";
import { keepFields } from "./kept.js";
import { parts } from "./live.js";
import { amplitudeAxis, onUnits } from "./measures.js";
import { draw, ink } from "./plots.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { style } from "./styles.js";

const SHOWN = 5; // lines that are drawn at first; the others stand in the legend
const LISTED = 15;
const WIDTH = 0.2; // each way, in the beginning
const key = h("select", { id: "sweep-key", name: "key", onchange: () => ends() });
const low = h("input", { type: "text", id: "sweep-from", name: "from", spellcheck: "false" });
const high = h("input", { type: "text", id: "sweep-to", name: "to", spellcheck: "false" });
const count = h("input", { type: "text", id: "sweep-count", name: "count", class: "short", inputmode: "numeric", value: "11" });
const way = h("select", { id: "sweep-way", "aria-label": "Answer" }, h("option", { value: "steady" }, "steady states"), h("option", { value: "linear" }, "linearised drive"));
const go = h("button", { class: "primary" }, "Sweep");
const place = h("div", {});
const offer = h("p", { class: "offer", role: "status" });
const plot = h("div", { class: "plot", id: "sweep-plot", role: "img", "aria-label": "Lines over the value", hidden: true });
const task = makeTask("sweep", place, show);
let found = null;
let listens = false;
let mine = ["", ""]; // the ends that stand in the fields unless somebody has typed others

export const card = h(
  "details",
  { class: "card live" },
  h("summary", {}, h("h2", {}, "Sweep: lines over one value")),
  h("form", { class: "ask", onsubmit: begin }, h("label", {}, "value", key), h("label", {}, "from", low), h("label", {}, "to", high), h("label", {}, "points", count), h("label", {}, "of", way), go),
  place,
  offer,
  plot,
);

export function makeSweep() {
  keepFields("sweep", { count, way });
  scenario.onCheck(fill);
  onUnits(() => found && redraw());
  task.restore();
}

/** Offer a sweep of a value of the form. */
export function sweepOver(name) {
  document.getElementById("tab-run").click();
  card.open = true;
  fill();
  key.value = name;
  ends();
  card.scrollIntoView({ block: "nearest" });
  low.focus();
}

/** A sweep of the library. */
export function openSweep({ id, title, asked }) {
  card.open = true;
  return task.open({ id, name: title, context: { scenario: asked.scenario } });
}

function fill() {
  const { values } = scenario.checked();
  const keys = Object.keys(values).filter((name) => scenario.fieldOf(name)?.kind === "quantity" && !/^(solver|record)\./.test(name) && parts(values[name]));
  const wanted = key.value || "motor.current";
  if ([...key.options].map((option) => option.value).join() !== keys.join()) key.replaceChildren(...keys.map((name) => h("option", { value: name }, name)));
  key.value = keys.includes(wanted) ? wanted : keys[0];
  if (low.value === mine[0] && high.value === mine[1]) ends();
  if (found) redraw();
}

const current = (name) => scenario.current().changes[name] ?? scenario.checked().values[name];

function ends() {
  const start = parts(current(key.value));
  const text = (factor) => (start ? `${Number((start.value * factor).toPrecision(5))} ${start.unit}`.trim() : "");
  mine = [text(1 - WIDTH), text(1 + WIDTH)];
  [low.value, high.value] = mine;
}

async function begin(event) {
  event.preventDefault();
  const body = { scenario: scenario.current(), key: key.value, from: low.value.trim(), to: high.value.trim(), count: Number(count.value), linear: way.value === "linear" };
  await task.start(`Sweep of ${key.value}`, () => post("/api/sweeps", body), { scenario: body.scenario });
}

async function show(answer) {
  found = answer;
  card.open = true;
  plot.hidden = false;
  const failed = answer.points.filter(({ error }) => error);
  const timed = answer.points.filter(({ reason }) => reason);
  offer.replaceChildren(
    "A click on a point takes its value into the form; the names switch lines on and off. ",
    timed.length ? `${timed.length} of ${answer.points.length} points have no steady state and are runs in time: ${timed[0].reason} ` : "",
    failed.length ? `${failed.length} of ${answer.points.length} points have no lines: ${failed[0].error}` : "",
  );
  await redraw();
  if (!listens) plot.on("plotly_click", ({ points: [point] }) => point.customdata !== undefined && take(point.customdata));
  listens = true;
}

/** Amplitudes of each line over the points, the largest line first; null where a point has no such line. */
function curves({ points }) {
  const names = [...new Set(points.flatMap(({ lines }) => lines.map(({ line }) => line)))].filter((name) => !name.startsWith("other_"));
  const over = (name) => points.map(({ lines }) => lines.find(({ line }) => line === name)?.amplitude ?? null);
  const found = names.map((name) => ({ name, y: over(name) }));
  return found.sort((a, b) => Math.max(...b.y) - Math.max(...a.y)).slice(0, LISTED);
}

function redraw() {
  const axis = amplitudeAxis("N*m");
  const { values, unit } = found;
  const now = parts(current(found.key)); // marked where it is written in the unit of the axis
  const traces = curves(found).map(({ name, y }, k) => {
    const [color, dash] = style(k);
    return {
      name,
      x: values,
      y: y.map((amplitude) => (amplitude ? axis.y(amplitude) : null)),
      customdata: found.points.map(({ value }) => value),
      mode: "lines+markers",
      visible: k < SHOWN || "legendonly",
      line: { color, dash, width: 1.4 },
      marker: { size: 5 },
      hovertemplate: `%{customdata}<br>%{y:.4g} ${axis.printed}<extra>${name}</extra>`,
    };
  });
  const marked = now?.unit === unit ? [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: now.value, x1: now.value, line: { color: ink(), width: 1.2, dash: "dash" } }] : [];
  return draw(plot, traces, {
    xaxis: { title: { text: `${found.key}${unit ? ` [${unit}]` : ""}${marked.length ? "; dashed: in the form" : ""}` } },
    yaxis: { title: { text: `amplitude [${axis.printed}], ${axis.words}` }, ...(axis.dB ? {} : { type: "log", dtick: "D2" }) },
    showlegend: true,
    shapes: marked,
  });
}

async function take(value) {
  await scenario.changeAll({ [found.key]: value });
  announce(`${found.key} is ${value} in the form; run to see it in time.`);
}
