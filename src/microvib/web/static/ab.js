// Two runs line by line: amplitudes of A and B, and B over A in percent and dB.

import { fixed, h, number } from "./dom.js";
import * as limit from "./limit.js";
import { amplitudeAxis, onUnits } from "./measures.js";
import * as runs from "./runs.js";
import { table } from "./tables.js";
import * as verdict from "./ab_verdict.js";

const choice = (label) => h("select", { "aria-label": `Run ${label}`, onchange: () => show() });
const [first, second] = [choice("A"), choice("B")];
const place = h("div", {});
export const card = h(
  "section",
  { class: "card", id: "ab", hidden: true },
  h("div", { class: "bar" }, h("h2", {}, "A and B"), h("label", {}, "A ", first), h("label", {}, "B ", second), h("button", { type: "button", onclick: swap }, "Swap")),
  verdict.place,
  place,
);

let filled = ""; // what stands in the table
const state = () => JSON.stringify([first.value, second.value, limit.query()]);
const ended = () => runs.all().filter((run) => run.result && run.state === "done");

/** Offer the runs that have ended; B is the chosen one where nothing else was asked for. */
export function update() {
  const there = ended();
  card.hidden = there.length < 2;
  if (card.hidden) return;
  const [a, b] = [first.value, second.value];
  for (const select of [first, second]) select.replaceChildren(...there.map((run) => h("option", { value: run.id }, run.name)));
  const known = (id) => there.some((run) => run.id === id);
  second.value = known(b) && card.dataset.asked ? b : runs.selected()?.id;
  if (!known(second.value)) second.value = there.at(-1).id;
  const other = there.filter((run) => run.id !== second.value).at(-1).id;
  first.value = known(a) && a !== second.value ? a : other;
  if (filled !== state()) fill();
}

function show() {
  card.dataset.asked = "yes";
  fill();
}

function swap() {
  [first.value, second.value] = [second.value, first.value];
  show();
}

const seen = (run) => new Map(run.result.lines.filter((line) => line.amplitude_n_m !== null && line.status !== "below the floor").map((line) => [line.line, line]));

/** Lines of `b` called as those of `a` at the same frequency, where only their frequency has a meaning: "other" lines. */
export function alike(a, b, resolution) {
  const found = new Map();
  const others = [...a.values()].filter((line) => line.kind === "other");
  for (const [name, line] of b) {
    if (line.kind !== "other") found.set(name, line);
    else {
      const same = others.find((one) => Math.abs(one.frequency_hz - line.frequency_hz) < resolution && !found.has(one.line));
      found.set(same?.line ?? `${name} of B`, line);
    }
  }
  return found;
}

/** Rows of the lines that A or B has, the largest first: B over A, less one, and in dB. */
export function compared(a, b) {
  const names = [...new Set([...a.keys(), ...b.keys()])];
  const rows = names.map((line) => {
    const [one, other] = [a.get(line), b.get(line)];
    const ratio = one && other ? other.amplitude_n_m / one.amplitude_n_m : null;
    return {
      line,
      a_hz: one?.frequency_hz ?? null,
      b_hz: other?.frequency_hz ?? null,
      a: one?.amplitude_n_m ?? null,
      b: other?.amplitude_n_m ?? null,
      percent: ratio === null ? null : 100 * (ratio - 1),
      decibel: ratio === null ? null : 20 * Math.log10(ratio),
    };
  });
  return rows.sort((x, y) => Math.max(y.a, y.b) - Math.max(x.a, x.b));
}

function fill() {
  const [a, b] = [first, second].map((select) => ended().find((run) => run.id === select.value));
  filled = state();
  if (!a || !b) return place.replaceChildren();
  verdict.update(a, b);
  const resolution = 1 / Math.min(...[a, b].map(({ result }) => result.t1 - result.t0));
  const axis = amplitudeAxis("N*m");
  const amplitude = (value) => (value === null ? number(null) : number(axis.y(value), 4));
  const change = (digits) => (value) => (value > 0 ? "+" : "") + fixed(value, digits);
  const columns = [
    { key: "line", title: "line" },
    { key: "a_hz", title: "A", unit: "Hz", show: (value) => number(value, 6) },
    { key: "b_hz", title: "B", unit: "Hz", show: (value) => number(value, 6) },
    { key: "a", title: `A, ${axis.words}`, unit: axis.printed, show: amplitude },
    { key: "b", title: `B, ${axis.words}`, unit: axis.printed, show: amplitude },
    { key: "percent", title: "B over A", unit: "%", show: change(2) },
    { key: "decibel", title: "B over A", unit: "dB", show: change(2) },
  ];
  place.replaceChildren(table(columns, compared(seen(a), alike(seen(a), seen(b), resolution)), { caption: "Lines of A and B" }));
}

onUnits(() => card.hidden || fill());
