// Identification: which parameters, within which ranges; what came out, and taking it over into the form.

import { post } from "./api.js";
import { announce, h } from "./dom.js";
import { keep, kept } from "./kept.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { partContent } from "./tables.js";

const KEPT = "fit.asked";
const FIRST = ["reducer.stiffness", "motor.friction.viscous", "array.rigid_inertia"];

const chosen = h("div", { class: "fits" });
const starts = h("input", { type: "text", class: "short", id: "fit-starts", value: "96", inputmode: "numeric" });
const place = h("div", {});
const result = h("div", {});
const task = makeTask("fit", place, (answer) => result.replaceChildren(...shown(answer)));

/** The part of the page; `evidence` gives recordings and channel when asked. */
export function makeFit(evidence) {
  const { rows = [{ key: FIRST[0] }], count } = kept(KEPT, {});
  if (count) starts.value = count;
  scenario.onCheck(() => chosen.children.length || rows.forEach(add));
  const element = h(
    "div",
    {},
    h(
      "p",
      { class: "soft" },
      "Parameters are searched for from several starts and refined until the lines of complete simulations agree with the recording's. Without a range: a factor of four each way, ten per cent for a frequency.",
    ),
    chosen,
    h(
      "div",
      { class: "ask" },
      h("button", { type: "button", onclick: () => add({ key: next() }) }, "Add a parameter"),
      h("label", {}, "starts", starts),
      h("button", { type: "button", class: "primary", onclick: () => identify(evidence()) }, "Identify"),
    ),
    place,
    result,
  );
  for (const event of ["input", "click"]) element.addEventListener(event, store);
  const leave = () => {
    task.leave();
    result.replaceChildren();
  };
  return { element, leave, restore: task.restore, open: task.open };
}

const store = () => keep(KEPT, { rows: rowsNow(), count: starts.value });

const rowsNow = () =>
  [...chosen.children].map((row) => {
    const [low, high] = [...row.querySelectorAll("input")].map((input) => input.value.trim());
    return { key: row.querySelector("select").value, low, high };
  });

const used = () => [...chosen.querySelectorAll("select")].map((select) => select.value);
const next = () => FIRST.find((key) => !used().includes(key)) ?? numbers().find((key) => !used().includes(key));

function numbers() {
  return Object.keys(scenario.checked().values).filter(
    (key) => scenario.fieldOf(key)?.kind === "quantity" && !/^(solver|record)\./.test(key),
  );
}

function add({ key, low: from = "", high: to = "" }) {
  if (!key || !numbers().includes(key)) return;
  const select = h(
    "select",
    { "aria-label": "Parameter to identify", onchange: () => hint() },
    numbers().map((name) => h("option", { value: name }, name)),
  );
  const low = h("input", { type: "text", "aria-label": "From", placeholder: "from", value: from });
  const high = h("input", { type: "text", "aria-label": "To", placeholder: "to", value: to });
  const now = h("span", { class: "soft note" });
  const hint = () => (now.textContent = `now ${scenario.checked().values[select.value]}`);
  const row = h(
    "div",
    { class: "fit" },
    select,
    low,
    high,
    now,
    h("button", { type: "button", class: "quiet", "aria-label": "Take this parameter out", onclick: () => row.remove() }, "×"),
  );
  select.value = key;
  hint();
  chosen.append(row);
}

const wanted = () => rowsNow().map(({ key, low, high }) => key + (low || high ? `=${low}:${high}` : ""));

async function identify(evidence) {
  const body = { ...evidence, scenario: scenario.current(), fit: wanted(), starts: Number(starts.value) || undefined };
  await task.start("Identification", () => post("/api/identifications", body));
}

function shown({ summary, parts: [first, ...others], scenario_changes: changes, usable }) {
  const take = h("button", { type: "button", class: "primary", disabled: !usable, onclick: () => over(changes) }, "Take over into the form");
  return [
    h("p", { class: "soft" }, summary),
    ...partContent(first),
    take,
    ...others.filter(({ items }) => items.length).map((part) => h("details", {}, h("summary", {}, part.title), ...partContent(part))),
  ];
}

async function over(changes) {
  await scenario.changeAll(changes);
  announce(`${Object.keys(changes).length} values are in the form; run to see them.`);
}
