// The Quieter drive tab: which levers may be changed and what a search makes small, or a table of currents to judge; what came out, into
// the form or as two runs.

import { post } from "./api.js";
import { describedField } from "./described.js";
import { announce, h, save } from "./dom.js";
import { keep, keepFields, kept } from "./kept.js";
import { latest } from "./latest.js";
import { makeTask } from "./progress.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import { factList } from "./study.js";
import { card, partCards, partContent } from "./tables.js";

const LEVERS = "quiet.levers";
const FIRST = ["ramp"]; // levers that are asked for in the beginning
const LONGEST = 20_000; // characters of a change that the server takes
const FIRST_FILES = ["scenario.yaml", "table.csv"];
const [BAND, CURVE, REQUIREMENT] = ["band", "limit curve", "requirement"];
const OBJECTIVES = [
  ["rms", "RMS of all lines"],
  [BAND, "largest line in a band"],
  [CURVE, "lines over a limit curve"],
  [REQUIREMENT, "requirements on the line of sight"],
];
const JUDGE = "judge";
const YAML = ".yaml,.yml,text/yaml";
const CSV = ".csv,.txt,text/csv";
const STUDY = "scenario: my-drive.yaml\nvary:\n  motor.detent_torque: {distribution: uniform, within: 20 percent}\n  reducer.stiffness: {distribution: uniform, within: 30 percent}";

const objective = h("select", { id: "quiet-objective", name: "objective", onchange: showAsked });
const band = h("input", { type: "text", id: "quiet-band", name: BAND, value: "0.5:150 Hz", spellcheck: "false" });
const bandLabel = h("label", { hidden: true }, "band", band);
const curve = describedField("quiet-curve", "Limit of a line over frequency (CSV)", { placeholder: "frequency_hz,t_mnm\n0.5,8\n10,20", rows: 4, accept: CSV });
const requirement = describedField("quiet-requirement", "Requirements (YAML)", { placeholder: "requirements:\n  - {name: P-1, metric: rpe, window: 10 ms, limit: 0.02 urad}", rows: 4, accept: YAML });
const unseen = h("p", { class: "soft", role: "status", hidden: true }, "Requirements are on a line of sight, which the scenario on the left does not have: spacecraft.line_of_sight is expected in its file.");
const action = h("select", { id: "quiet-action", name: "action", onchange: showAsked }, h("option", { value: "search" }, "search for a setting"), h("option", { value: JUDGE }, "judge a table of currents"));
const check = describedField("quiet-check", "Table of currents (CSV)", { placeholder: "i_a,i_b\n1,0\n0.99,0.098", rows: 4, accept: CSV, title: "A row for each microstep of an electrical turn, currents over I; whole numbers as i_a_of_511,i_b_of_511; or an angle correction" });
const NUMBERS = [
  ["effort", "settings tried (effort)", "24", "Settings that are tried over the cases of the search"],
  ["cases", "cases", "24", "Drawn cases that judge the result; 72 or more bound a 95 % quantile"],
  ["bits", "bits of the table", "", "Bits of the driver's converter, to which a table is rounded"],
];
const inputs = Object.fromEntries(
  NUMBERS.map(([key, , value]) => [
    key,
    h("input", { type: "text", inputmode: "numeric", class: "short", id: `quiet-${key}`, name: key, value }),
  ]),
);
const limit = h("input", { type: "text", id: "quiet-limit", name: "limit", placeholder: "such as 3 mN*m", spellcheck: "false" });
const limitLabel = h("label", { title: "Largest value allowed to 95 % of the cases" }, "limit for 95 % of cases", limit);
const study = describedField("quiet-study", "How drives scatter: a study file of a campaign (YAML)", { placeholder: STUDY, rows: 4, accept: YAML, title: "Its variations are those of the cases; without one a spread is assumed" });
const text = (name, placeholder, more = {}) => h("input", { type: "text", id: `quiet-${name}`, name, placeholder, spellcheck: "false", ...more });
const CONSTRAINTS = {
  margin: ["least torque margin", "With the factors; 0 if nothing is given", text("margin", "0", { class: "short" })],
  factor: ["motorisation factors", "inertia, spring, detent, friction, harness or total, separated by commas", text("factor", "friction=1.5")],
  lag: ["largest lag of the array", "Largest angle of the array behind its command", text("lag", "such as 0.01 deg")],
  table_rows: ["rows of the driver's table", "Rows that the driver's table can hold", text("table_rows", "16384", { class: "short", inputmode: "numeric" })],
};
const constraints = Object.fromEntries(Object.entries(CONSTRAINTS).map(([key, [, , input]]) => [key, input]));
const more = h(
  "details",
  { class: "more" },
  h("summary", {}, "Scatter and constraints"),
  h("div", { class: "descriptions" }, study.element),
  h("div", { class: "ask" }, Object.values(CONSTRAINTS).map(([words, title, input]) => h("label", { title }, words, input))),
);
const levers = h("div", { class: "levers", role: "group", "aria-label": "Levers" });
const wrong = h("p", { class: "soft", role: "status" });
const search = h("button", { class: "primary" }, "Search");
const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("quiet", place, show);
const asking = latest();
let panel = null;
let asked = null; // the scenario whose lines and levers are shown
let seesPointing = true; // whether it has a line of sight

export function makeQuiet(tab) {
  panel = tab;
  const ask = h(
    "form",
    { onsubmit: start },
    h("div", { class: "ask" }, h("label", {}, "do", action), h("label", {}, "make small", objective), bandLabel),
    h("div", { class: "descriptions" }, curve.element, requirement.element, unseen, check.element),
    levers,
    wrong,
    more,
    h("div", { class: "ask" }, NUMBERS.map(([key, words, , title]) => h("label", { title }, words, inputs[key])), limitLabel, search),
  );
  const words =
    "Settings of the levers are tried over drawn cases of the drive, each from several starts; the best is judged on other cases, as is a table of currents that somebody made. The spread of the cases is assumed unless a study states it. More effort and cases take longer: the first answer is a coarse one.";
  tab.append(h("section", { class: "card" }, h("h2", {}, "Quieter drive"), h("p", { class: "soft" }, words), ask, place), result);
  objective.append(...OBJECTIVES.map(([value, words]) => h("option", { value }, words)));
  objective.value = kept("quiet.objective", "rms");
  keepFields("quiet.asked", { ...inputs, ...constraints, band, limit, action });
  for (const field of [curve, requirement, check, study]) keepFields(`quiet.${field.input.name}`, { text: field.input });
  more.open = [study.input, ...Object.values(constraints)].some(({ value }) => value.trim());
  showAsked();
  levers.addEventListener("input", storeLevers);
  scenario.onCheck(askChoices);
  document.getElementById("tab-quiet").addEventListener("click", askChoices);
  document.getElementById("tabs").addEventListener("keyup", askChoices);
  task.restore();
}

// ---- What can be asked ----

/** Ask which lines and levers the scenario has, once for each that is looked at. */
async function askChoices() {
  const now = scenario.current();
  const of = JSON.stringify(now);
  if (panel.hidden || of === asked) return;
  asked = of;
  try {
    await asking((signal) => post("/api/quiet/choices", now, { signal }), showChoices);
  } catch (error) {
    asked = null;
    search.disabled = true;
    wrong.textContent = error.message;
  }
}

function showChoices({ lines, levers: found, line_of_sight }) {
  search.disabled = false;
  seesPointing = line_of_sight;
  wrong.textContent = found.length ? "" : "This scenario has none of the levers.";
  showLines(lines);
  const given = { ...kept(LEVERS, {}) };
  levers.replaceChildren(...found.map((lever) => leverRow(lever, given[lever.name])));
}

function showLines(lines) {
  const wanted = kept("quiet.objective", "rms");
  for (const option of objective.querySelectorAll("[data-line]")) option.remove();
  objective.append(...lines.map((name) => h("option", { value: name, "data-line": true }, `line ${name}`)));
  objective.value = OBJECTIVES.some(([value]) => value === wanted) || lines.includes(wanted) ? wanted : "rms";
  showAsked();
}

/** The fields of what is chosen, and no others. */
function showAsked() {
  keep("quiet.objective", objective.value);
  const judges = action.value === JUDGE;
  bandLabel.hidden = objective.value !== BAND;
  curve.element.hidden = objective.value !== CURVE;
  requirement.element.hidden = objective.value !== REQUIREMENT || !seesPointing;
  unseen.hidden = objective.value !== REQUIREMENT || seesPointing;
  limitLabel.hidden = [CURVE, REQUIREMENT].includes(objective.value); // which have their own
  check.element.hidden = !judges;
  levers.hidden = judges;
  for (const input of [inputs.effort, inputs.bits]) input.parentElement.hidden = judges;
  search.textContent = judges ? "Judge" : "Search";
}

function leverRow({ name, span, meaning, example }, given) {
  const box = h("input", { type: "checkbox", id: `quiet-lever-${name}`, name: "lever", value: name });
  const range = h("input", {
    type: "text",
    id: `quiet-range-${name}`,
    "aria-label": `Range of ${name}`,
    value: given?.range ?? span,
    placeholder: span || example,
    spellcheck: "false",
    "data-usual": span,
  });
  box.checked = given?.on ?? FIRST.includes(name);
  range.addEventListener("input", () => (box.checked = true));
  return h("div", { class: "lever" }, h("label", { class: "check" }, box, name), range, h("span", { class: "soft note", title: meaning }, meaning.split(";")[0]));
}

const rows = () =>
  [...levers.children].map((row) => {
    const [box, range] = row.querySelectorAll("input");
    return { name: box.value, on: box.checked, range: range.value.trim(), usual: range.dataset.usual };
  });

/** What was chosen; a range that is the usual one is not kept, since another scenario has another. */
function storeLevers() {
  const chosen = rows().map(({ name, on, range, usual }) => [name, range === usual ? { on } : { on, range }]);
  keep(LEVERS, { ...kept(LEVERS, {}), ...Object.fromEntries(chosen) });
}

// ---- The search ----

async function start(event) {
  event.preventDefault();
  const now = scenario.current();
  const judges = action.value === JUDGE;
  const body = {
    scenario: now,
    ...whatIsSmall(),
    ...(judges ? { check: check.input.value } : whatIsSearched()),
    cases: Number(typed(inputs.cases)),
    study: study.input.value,
    margin: typed(constraints.margin),
    factor: typed(constraints.factor)?.split(/\s*,\s*/).filter(Boolean),
    lag: typed(constraints.lag),
    table_rows: typed(constraints.table_rows) && Number(typed(constraints.table_rows)),
  };
  const missing = whatIsMissing(body, judges);
  if (missing) return announce(missing, { error: true });
  await task.start(search.textContent, () => post("/api/quiet", body), { scenario: now, name: scenario.shortName() });
}

/** What stands in a field; nothing where it is empty. */
const typed = (input) => input.value.trim() || undefined;

/** The objective as the server takes it: a curve is the text of its table. */
function whatIsSmall() {
  if (objective.value === REQUIREMENT) return { requirement: requirement.input.value };
  if (objective.value === CURVE) return { objective: curve.input.value.trim() };
  return { objective: objective.value === BAND ? band.value.trim() : objective.value, limit: typed(limit) };
}

function whatIsSearched() {
  const chosen = rows()
    .filter(({ on }) => on)
    .map(({ name, range, usual }) => (range === usual || !range ? name : `${name}=${range}`));
  return { levers: chosen, effort: Number(typed(inputs.effort)), bits: typed(inputs.bits) && Number(typed(inputs.bits)) };
}

/** What a person has to give yet, a sentence; empty where nothing lacks. */
function whatIsMissing(body, judges) {
  if (judges && !body.check.trim()) return "Paste the table of currents, or choose its file.";
  if (!judges && !body.levers.length) return "Choose one lever or more.";
  if (objective.value === CURVE && !body.objective.includes("\n")) return "Paste the table of the limit, or choose its file.";
  if (objective.value === REQUIREMENT && !seesPointing) return unseen.textContent;
  if (objective.value === REQUIREMENT && !body.requirement.trim()) return "Write the requirements, or choose their file.";
  return "";
}

/** A search of the library. */
export const openQuiet = ({ id, title, asked }) =>
  task.open({ id, name: title, context: { scenario: asked.scenario, name: title.replace(/^(quieter drive for|table of currents in) /, "") } });

// ---- What came out ----

function show({ summary, facts, parts, files, scenario_changes: changes, searched = true }, { scenario: before, name }) {
  const [first, ...others] = parts;
  const found = quieter(before, changes, files);
  const use = h("button", { type: "button", class: "primary", onclick: () => over(found) }, "Use this drive");
  const both = h("button", { type: "button", onclick: () => overlay(before, found, name, searched) }, "Run before and after");
  const names = [...FIRST_FILES.filter((file) => file in files), ...Object.keys(files).filter((file) => !FIRST_FILES.includes(file))];
  const links = names.map((file) => h("button", { type: "button", onclick: () => save(files[file], file) }, file));
  result.replaceChildren(
    card(searched ? "What to change" : "The table over the cases", summary, factList(facts), ...partContent(first), h("div", { class: "bar" }, use, both)),
    ...partCards(others),
    card("Download", "", h("div", { class: "bar" }, links)),
  );
}

/** The scenario that was searched with the levers set: as changes of it, or as a text where they are too long. */
function quieter(before, changes, files) {
  if (Object.values(changes).some((text) => text.length > LONGEST)) return { base: null, text: files["scenario.yaml"], changes: {} };
  const kept = Object.entries(before.changes).filter(([key]) => !Object.keys(changes).some((set) => key === set || key.startsWith(`${set}.`)));
  return { ...before, changes: { ...Object.fromEntries(kept), ...changes } };
}

async function over(found) {
  try {
    await scenario.startFrom(found);
    announce("The drive is in the form; run to see it.");
  } catch (error) {
    announce(error.message, { error: true });
  }
}

/** Both drives as runs in their steady state, where they have one, whose spectra lie over each other; one that is there already is not run again. */
async function overlay(before, found, name, searched) {
  document.getElementById("tab-run").click();
  try {
    await runOnce(before, name);
    await runOnce(found, `${searched ? "quieter" : "with the table"}: ${name}`);
  } catch (error) {
    announce(error.message, { error: true });
  }
}

async function runOnce(what, name) {
  const text = JSON.stringify(what);
  const same = runs.all().find((run) => JSON.stringify(run.scenario) === text && run.steady && !run.seeds && (run.result || runs.going(run)));
  if (same) return runs.choose(same);
  await runs.start({ scenario: what, name, steady: true, seeds: null });
}
