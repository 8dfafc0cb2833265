// A slider on one parameter: lines of the steady state, or of the linearised drive, while it moves, over those of the form's value.

import { post } from "./api.js";
import { announce, debounce, h, number } from "./dom.js";
import { keepFields } from "./kept.js";
import { latest } from "./latest.js";
import { amplitudeAxis, onUnits } from "./measures.js";
import { draw, ink } from "./plots.js";
import * as scenario from "./scenario.js";

const FACTOR = 2; // each way
const STEPS = 100;
const NOW = "#0072B2";
const plot = h("div", { class: "plot", id: "live-plot", role: "img", "aria-label": "Lines while the slider moves" });
const key = h("select", { id: "live-key", onchange: () => begin() });
const way = h("select", { id: "live-way", "aria-label": "Answer", onchange: () => begin() }, h("option", { value: "steady" }, "steady state"), h("option", { value: "linear" }, "linearised drive"));
const slider = h("input", { type: "range", id: "live-slider", min: -STEPS, max: STEPS, value: 0, "aria-label": "Value", oninput: () => move() });
const said = h("output", { for: "live-slider", class: "soft" });
const use = h("button", { type: "button", onclick: () => take() }, "Put into the form");
const note = h("p", { class: "soft note", role: "status" });
const asking = latest();
let start = null; // {value, unit} at the slider's middle
let atForm = null; // lines at the slider's middle
let first = null; // when these are there
let now = null;
let isMoving = false;

export const card = h(
  "details",
  { class: "card live", ontoggle: () => card.open && begin() },
  h("summary", {}, h("h2", {}, "Live: lines while one value moves")),
  h("div", { class: "bar" }, h("label", { for: "live-key" }, "Value"), key, way, slider, said, use),
  note,
  plot,
);

/** The number and unit of a value as the form has it; null where it is none. */
export function parts(text) {
  const [, figure, unit] = /^\s*([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(.*)$/i.exec(text ?? "") ?? [];
  const value = Number(figure);
  return figure !== undefined && Number.isFinite(value) && value !== 0 ? { value, unit } : null;
}

const value = () => start.value * FACTOR ** (slider.value / STEPS);
const text = () => `${Number(value().toPrecision(5))} ${start.unit}`.trim();

export function makeLive() {
  keepFields("live", { way });
  scenario.onCheck(fill);
  slider.addEventListener("change", () => (isMoving = false));
  onUnits(() => now && show());
}

/** Let a value of the form be moved. */
export function moveLive(name) {
  document.getElementById("tab-run").click();
  card.open = true;
  key.value = name;
  card.scrollIntoView({ block: "nearest" });
  slider.focus();
  return begin();
}

function fill() {
  const { values } = scenario.checked();
  const keys = Object.keys(values).filter((name) => scenario.fieldOf(name)?.kind === "quantity" && !/^(solver|record)\./.test(name) && parts(values[name]));
  const wanted = key.value || "motor.current";
  if ([...key.options].map((option) => option.value).join() !== keys.join()) key.replaceChildren(...keys.map((name) => h("option", { value: name }, name)));
  key.value = keys.includes(wanted) ? wanted : keys[0];
  if (card.open && !isMoving) begin();
}

/** The slider's middle is what the form says. */
function begin() {
  start = parts(scenario.checked().values[key.value]);
  use.disabled = slider.disabled = !start;
  if (!start || !card.open) return;
  slider.value = 0;
  atForm = null;
  first = ask();
  return first;
}

function move() {
  isMoving = true;
  said.textContent = text();
  soon();
}

const soon = debounce(async () => {
  await first; // what lies beneath comes before what is laid over it
  return ask();
}, 40);

async function ask() {
  said.textContent = text();
  const current = scenario.current();
  const changes = Number(slider.value) === 0 ? current.changes : { ...current.changes, [key.value]: text() };
  try {
    await asking((signal) => post("/api/lines", { scenario: { ...current, changes }, linear: way.value === "linear" }, { signal }), ({ lines, reason }) => {
      now = lines;
      if (Object.is(changes, current.changes)) atForm = lines;
      note.textContent = reason ? `A run in time, no steady state: ${reason}` : "";
      return show();
    });
  } catch (error) {
    note.textContent = error.message;
  }
}

/** Stems from the axis' lower end to each line. */
function stems(lines, axis, low, look) {
  const seen = lines.filter((line) => line.amplitude > 0);
  return {
    x: seen.flatMap(({ frequency }) => [frequency, frequency, null]),
    y: seen.flatMap(({ amplitude }) => [low, axis.y(amplitude), null]),
    text: seen.flatMap(({ line, amplitude }) => [line, `${line}, ${number(axis.y(amplitude), 4)} ${axis.printed}`, ""]),
    mode: "lines+markers",
    hovertemplate: "%{text}<br>%{x:.5g} Hz<extra></extra>",
    ...look,
  };
}

function show() {
  const axis = amplitudeAxis("N*m");
  const beneath = now === atForm ? null : atForm;
  const largest = Math.max(...[...(beneath ?? []), ...now].map((line) => line.amplitude), 1e-12);
  const low = axis.y(largest * 1e-4);
  const range = axis.dB ? [low, axis.y(largest) + 10] : [Math.log10(low), Math.log10(axis.y(largest)) + 0.4];
  const ghost = beneath ? [stems(beneath, axis, low, { name: `form: ${start.value} ${start.unit}`.trim(), line: { color: ink(), width: 5 }, marker: { color: ink(), size: 8 }, opacity: 0.25 })] : [];
  return draw(plot, [...ghost, stems(now, axis, low, { name: text(), line: { color: NOW, width: 1.6 }, marker: { color: NOW, size: 5 } })], {
    xaxis: { title: { text: "frequency [Hz]" }, rangemode: "tozero" },
    yaxis: { title: { text: `amplitude [${axis.printed}], ${axis.words}` }, ...(axis.dB ? {} : { type: "log", dtick: 1 }), range },
    showlegend: true,
  });
}

async function take() {
  await scenario.changeAll({ [key.value]: text() });
  announce(`${key.value} is ${text()} in the form; run to see it in time.`);
}
