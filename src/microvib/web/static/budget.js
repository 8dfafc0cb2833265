// The Pointing budget tab: what drive and other sources do to the line of sight, against requirements.

import { post } from "./api.js";
import { describedField, sentTables } from "./described.js";
import { announce, h } from "./dom.js";
import { keepFields } from "./kept.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { studyCards } from "./study.js";

const YAML = ".yaml,.yml,text/yaml";
const REQUIREMENT = "requirements:\n  - {name: P-1, metric: rpe, window: 10 ms, limit: 0.02 urad}";
const SOURCES = "sources:\n  - name: alignment\n    constant: {distribution: uniform, spread_x: 0.3 urad, spread_y: 0.2 urad}";
const RULES = [
  ["rss", "as mean squares (rss)"],
  ["coherent", "with their phases (coherent)"],
  ["bound", "with the worst phases (bound)"],
];

const requirement = describedField("budget-requirement", "Requirements (YAML)", { placeholder: REQUIREMENT, accept: YAML });
const sources = describedField("budget-sources", "Other sources (YAML), if there are any", { placeholder: SOURCES, accept: YAML });
const tables = sentTables("budget.tables", "budget-tables", "Tables that the sources name (CSV)");
const other = describedField("budget-other", "Design B: a second scenario (YAML)", { placeholder: "Both are judged by the same requirements.", rows: 3, accept: YAML });
const otherSources = describedField("budget-other_sources", "Other sources of design B", { placeholder: "those above", rows: 3, accept: YAML });
const rule = h("select", { id: "budget-rule", name: "rule" }, RULES.map(([value, words]) => h("option", { value }, words)));
const angles = h("input", { type: "text", id: "budget-angles", name: "angles", placeholder: "as in the form", spellcheck: "false" });
const box = (name, title, words) => {
  const input = h("input", { type: "checkbox", id: `budget-${name}`, name });
  return { input, label: h("label", { class: "check", title }, input, words) };
};
const orbit = box("orbit", "Judge each requirement at the worst angle of one revolution, or between the first and the last that are given", "over an orbit");
const clock = box("one_clock", "All drives step from one clock: their lines keep their phases to each other", "one clock");
const steady = box("steady", "Start in the periodic steady state, without settling", "steady");
const second = h(
  "details",
  { class: "more" },
  h("summary", {}, "Two designs"),
  h("div", { class: "bar" }, h("button", { type: "button", onclick: keepAsSecond }, "Keep the scenario on the left as design B"), h("span", { class: "soft note" }, "Design A is the scenario on the left when Assess is pressed.")),
  h("div", { class: "descriptions" }, other.element, otherSources.element),
);
const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("budget", place, (found, context, id) => result.replaceChildren(...studyCards("Pointing budget", found, id)));

export function makeBudget(tab) {
  const words =
    "The line of sight of the craft on the left, with its drive or drives and whatever other sources are given. Requirements and sources are written as in the files of microvib budget; no file is opened that is not chosen here. Without requirements nothing is judged.";
  const ask = h(
    "form",
    { onsubmit: assess },
    h("div", { class: "descriptions" }, requirement.element, h("div", {}, sources.element, tables.element)),
    second,
    h(
      "div",
      { class: "ask" },
      h("label", { title: "Lines of one frequency in several sources" }, "lines of one frequency add", rule),
      h("label", { title: "FIRST:LAST:STEP in degrees, or a list such as 0, 45, 90: each requirement at the worst" }, "array angles [deg]", angles),
      orbit.label,
      clock.label,
      steady.label,
      h("button", { class: "primary" }, "Assess"),
    ),
  );
  tab.append(h("section", { class: "card" }, h("h2", {}, "Pointing budget"), h("p", { class: "soft" }, words), ask, place), result);
  keepFields("budget.other", { other: other.input, other_sources: otherSources.input });
  second.open = Boolean(other.input.value.trim() || otherSources.input.value.trim());
  keepFields("budget.asked", { requirement: requirement.input, sources: sources.input, rule, angles, orbit: orbit.input, one_clock: clock.input, steady: steady.input });
  task.restore();
}

/** A budget of the library. */
export const openBudget = ({ id, title }) => task.open({ id, name: title });

/** The scenario of the form becomes design B; what is changed in the form then is design A. */
async function keepAsSecond() {
  try {
    const { yaml } = await scenario.asFile();
    if (!yaml) return announce("The scenario on the left has errors; mend them first.", { error: true });
    other.input.value = yaml;
    other.input.dispatchEvent(new Event("input", { bubbles: true }));
    announce("The scenario on the left is design B.");
  } catch (error) {
    announce(error.message, { error: true });
  }
}

async function assess(event) {
  event.preventDefault();
  const body = {
    scenario: scenario.current(),
    requirement: requirement.input.value,
    sources: sources.input.value,
    tables: tables.texts(),
    rule: rule.value,
    angles: angles.value.trim() || undefined,
    orbit: orbit.input.checked,
    one_clock: clock.input.checked,
    steady: steady.input.checked,
    other: other.input.value.trim() ? { text: other.input.value } : undefined,
    other_sources: otherSources.input.value.trim() ? otherSources.input.value : undefined,
  };
  await task.start("Budget", () => post("/api/budgets", body));
}
