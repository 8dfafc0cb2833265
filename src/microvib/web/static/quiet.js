// The Quieter drive tab: which levers may be changed, and what a search makes small; what came out, into the form or as two runs.

import { post } from "./api.js";
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
const BAND = "band";

const objective = h("select", { id: "quiet-objective", name: "objective", onchange: showBand });
const band = h("input", { type: "text", id: "quiet-band", name: BAND, value: "0.5:150 Hz", spellcheck: "false" });
const bandLabel = h("label", { hidden: true }, "band", band);
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
const levers = h("div", { class: "levers", role: "group", "aria-label": "Levers" });
const wrong = h("p", { class: "soft", role: "status" });
const search = h("button", { class: "primary" }, "Search");
const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("quiet", place, show);
const asking = latest();
let panel = null;
let asked = null; // the scenario whose lines and levers are shown

export function makeQuiet(tab) {
  panel = tab;
  const ask = h(
    "form",
    { onsubmit: start },
    h("div", { class: "ask" }, h("label", {}, "make small", objective), bandLabel),
    levers,
    wrong,
    h(
      "div",
      { class: "ask" },
      NUMBERS.map(([key, words, , title]) => h("label", { title }, words, inputs[key])),
      h("label", { title: "Largest value allowed to 95 % of the cases" }, "limit for 95 % of cases", limit),
      search,
    ),
  );
  const words =
    "Settings of the levers are tried over drawn cases of the drive, each from several starts; the best is judged on other cases. The spread of the cases is assumed. More effort and cases take longer: the first answer is a coarse one.";
  tab.append(h("section", { class: "card" }, h("h2", {}, "Quieter drive"), h("p", { class: "soft" }, words), ask, place), result);
  objective.append(h("option", { value: "rms" }, "RMS of all lines"), h("option", { value: BAND }, "largest line in a band"));
  objective.value = kept("quiet.objective", "rms");
  keepFields("quiet.asked", { ...inputs, band, limit });
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

function showChoices({ lines, levers: found }) {
  search.disabled = false;
  wrong.textContent = found.length ? "" : "This scenario has none of the levers.";
  showLines(lines);
  const given = { ...kept(LEVERS, {}) };
  levers.replaceChildren(...found.map((lever) => leverRow(lever, given[lever.name])));
}

function showLines(lines) {
  const wanted = kept("quiet.objective", "rms");
  for (const option of objective.querySelectorAll("[data-line]")) option.remove();
  objective.append(...lines.map((name) => h("option", { value: name, "data-line": true }, `line ${name}`)));
  objective.value = wanted === BAND || lines.includes(wanted) ? wanted : "rms";
  showBand();
}

function showBand() {
  keep("quiet.objective", objective.value);
  bandLabel.hidden = objective.value !== BAND;
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
  const text = (input) => input.value.trim();
  const now = scenario.current();
  const body = {
    scenario: now,
    objective: objective.value === BAND ? text(band) : objective.value,
    levers: rows()
      .filter(({ on }) => on)
      .map(({ name, range, usual }) => (range === usual || !range ? name : `${name}=${range}`)),
    effort: Number(text(inputs.effort)),
    cases: Number(text(inputs.cases)),
    bits: text(inputs.bits) ? Number(text(inputs.bits)) : undefined,
    limit: text(limit) || undefined,
  };
  if (!body.levers.length) return announce("Choose one lever or more.", { error: true });
  await task.start("Search", () => post("/api/quiet", body), { scenario: now, name: scenario.shortName() });
}

/** A search of the library. */
export const openQuiet = ({ id, title, asked }) =>
  task.open({ id, name: title, context: { scenario: asked.scenario, name: title.replace(/^quieter drive for /, "") } });

// ---- What came out ----

function show({ summary, facts, parts, files, scenario_changes: changes }, { scenario: before, name }) {
  const [first, ...others] = parts;
  const found = quieter(before, changes, files);
  const use = h("button", { type: "button", class: "primary", onclick: () => over(found) }, "Use this drive");
  const both = h("button", { type: "button", onclick: () => overlay(before, found, name) }, "Run before and after");
  const names = [...FIRST_FILES.filter((file) => file in files), ...Object.keys(files).filter((file) => !FIRST_FILES.includes(file))];
  const links = names.map((file) => h("button", { type: "button", onclick: () => save(files[file], file) }, file));
  result.replaceChildren(
    card("What to change", summary, factList(facts), ...partContent(first), h("div", { class: "bar" }, use, both)),
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
    announce("The levers are in the form; run to see the drive.");
  } catch (error) {
    announce(error.message, { error: true });
  }
}

/** Both drives as runs in their steady state, where they have one, whose spectra lie over each other; one that is there already is not run again. */
async function overlay(before, found, name) {
  document.getElementById("tab-run").click();
  try {
    await runOnce(before, name);
    await runOnce(found, `quieter: ${name}`);
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
