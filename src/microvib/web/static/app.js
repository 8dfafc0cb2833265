// The page: starts its parts, and what stands around them (tabs, scenario choice, run button, link).

import { knock, onServer } from "./api.js";
import { loaded, restored } from "./begin.js";
import { $, announce, h, onDrop, save } from "./dom.js";
import { makeForm } from "./form.js";
import { keep, keepFields, kept } from "./kept.js";
import { makeKeys } from "./keys.js";
import { loadPlotly } from "./plots.js";
import { makeRun } from "./run.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import { makeUnitSwitch } from "./unit_switch.js";

const HEARTBEAT = 5000;
const tabs = [...document.querySelectorAll("[role=tab]")];

function openTab(tab) {
  for (const other of tabs) {
    other.setAttribute("aria-selected", String(other === tab));
    other.tabIndex = other === tab ? 0 : -1;
    $(`#${other.getAttribute("aria-controls")}`).hidden = other !== tab;
  }
  keep("tab", tab.id);
  window.dispatchEvent(new Event("resize")); // plots that were hidden take their size
}

/** On a narrow screen results lie below the form, where a tab, or a run, would seem to do nothing. */
function showResults() {
  if (matchMedia("(max-width: 900px)").matches) $("#results").scrollIntoView();
}

function makeTabs() {
  for (const tab of tabs) tab.addEventListener("click", () => (openTab(tab), showResults()));
  $("#tabs").addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = tabs[(tabs.indexOf(document.activeElement) + step + tabs.length) % tabs.length];
    next.focus();
    openTab(next);
  });
}

function makeBase() {
  const select = $("#base");
  select.append(...scenario.catalog.map((item) => h("option", { value: item.name, title: item.source }, item.name)));
  select.addEventListener("change", () => scenario.startFrom({ base: select.value }));
  $("#upload").addEventListener("change", (event) => {
    if (event.target.files.length) open(event.target.files[0]);
    event.target.value = "";
  });
  onDrop($("#scenario"), ([file]) => open(file));
  scenario.onCheck(() => {
    const name = scenario.baseName();
    $("option[data-uploaded]", select)?.remove();
    if (name === null) select.append(h("option", { value: "", "data-uploaded": true }, "my file"));
    select.value = name ?? "";
  });
}

async function open(file) {
  try {
    await scenario.startFrom({ text: await file.text() });
    const wrong = scenario.checked().errors.length;
    announce(`${file.name} is open${wrong ? `; to correct: ${wrong}` : ""}.`);
  } catch (error) {
    announce(`${file.name}: ${error.message}`, { error: true });
  }
}

/** Run what the form says at the click, whatever is typed or answered afterwards. */
async function go(event) {
  if (event.detail > 1) return; // the second click of a double click
  const wanted = wish(scenario.current(), scenario.shortName());
  scenario.remember();
  openTab(tabs[0]);
  showResults();
  await begin(wanted);
}

function wish(what, name) {
  const steady = $("#steady").checked;
  const seeds = $("#seeds").value.trim() || null;
  return { scenario: what, name: [name, steady && "steady", seeds && `${seeds} seeds`].filter(Boolean).join(", "), steady, seeds };
}

function wrong(sentence, key) {
  (document.getElementById(`field-${key}`) ?? document.getElementById(key))?.focus();
  if (key === "seeds") $("#seeds-error").textContent = sentence;
  announce(sentence, { error: true });
}

async function begin(wanted) {
  $("#seeds-error").textContent = "";
  try {
    await runs.start(wanted);
  } catch (error) {
    wrong(error.message, error.key);
  }
}

async function five(event) {
  if (event.detail > 1) return;
  openTab(tabs[0]);
  const states = scenario.catalog.filter((item) => /^state-[1-5]$/.test(item.name));
  for (const wanted of states.map(({ name }) => wish({ base: name, text: null, changes: {} }, name))) await begin(wanted);
}

async function copy() {
  const link = scenario.link();
  if (link === null) return announce("This scenario is too long for a link; save it as a file instead.", { error: true });
  try {
    await navigator.clipboard.writeText(link);
    announce("Link copied.");
  } catch {
    announce("The browser does not let the page copy; the address bar holds the same link.", { error: true });
  }
}

async function saveScenario() {
  const name = `${scenario.baseName() ?? "scenario"}.yaml`;
  try {
    const { yaml, errors } = await scenario.asFile();
    if (yaml) save(yaml, name);
    else announce(errors[0]?.error ?? "The scenario has errors.", { error: true });
  } catch (error) {
    announce(error.message, { error: true });
  }
}

/** How the server stands, above everything until it is well again or has been read. */
function makeNotice() {
  const place = $("#server");
  const words = {
    silent: "The server does not answer. Is microvib serve still running? The page asks again every second.",
    restarted: "The server was restarted. What had ended is in its library; of what had not, the scenarios are still here.",
    shut: "This browser has no access: open the address that microvib serve printed last, then come back to this tab.",
  };
  const told = new Set();
  const close = h("button", { type: "button", onclick: () => show(told.clear()) }, "Close");
  function show() {
    place.replaceChildren(...[...told].map((what) => h("span", {}, words[what])), close);
    place.hidden = !told.size;
  }
  onServer((what) => {
    if (words[what]) told.add(what);
    told.delete({ answers: "silent", open: "shut" }[what]);
    show();
  });
  for (const event of ["focus", "online"]) window.addEventListener(event, knock);
  setInterval(() => document.hidden || knock(), HEARTBEAT);
}

/** The other tabs: their scripts are not needed before a scenario can be run. */
async function makeOthers() {
  const [angles, budget, campaign, sheet, envelope, library, modes, quiet, rates, recording, sas] = await Promise.all([
    import("./angles.js"),
    import("./budget.js"),
    import("./campaign.js"),
    import("./datasheet.js"),
    import("./envelope.js"),
    import("./library.js"),
    import("./modes.js"),
    import("./quiet.js"),
    import("./rates.js"),
    import("./recording.js"),
    import("./sas.js"),
  ]);
  sheet.makeSheet($("#sheet")).catch((error) => announce(error.message, { error: true }));
  recording.makeRecording($("#recording"));
  rates.makeRates($("#rates"));
  quiet.makeQuiet($("#quiet"));
  angles.makeAngles($("#angles"));
  budget.makeBudget($("#budget"));
  envelope.makeEnvelope($("#envelope"));
  campaign.makeCampaign($("#campaign"));
  modes.makeModes($("#modes"));
  sas.makeSas($("#sas"));
  library.makeLibrary($("#library"));
}

function listen() {
  keepFields("run.asked", { seeds: $("#seeds") });
  $("#go").addEventListener("click", go);
  $("#five").addEventListener("click", five);
  $("#copy").addEventListener("click", copy);
  $("#save").addEventListener("click", saveScenario);
  window.addEventListener("popstate", () => {
    document.activeElement?.blur(); // a field that is being typed in would keep its text
    scenario.restore();
  });
  document.addEventListener("click", (event) => {
    for (const menu of document.querySelectorAll("details.menu[open]"))
      menu.open = menu.contains(event.target) && !event.target.closest("a");
  });
}

makeTabs();
makeUnitSwitch($("header"));
makeKeys($("header"));
makeNotice();
await loaded.catch((error) => {
  announce(error.message, { error: true });
  throw error;
});
await restored.catch((error) => {
  announce(`The scenario in the address cannot be read: ${error.message}`, { error: true });
  return scenario.startFrom({ base: scenario.catalog[0].name });
});
makeBase();
makeForm();
makeRun($("#run"));
listen();
scenario.tell(); // what was heard before there was a form
runs.restore(); // before another can be started, which is then chosen and kept beside them
for (const button of [$("#go"), $("#five")]) button.disabled = false; // until now there was nothing to run
await new Promise((painted) => requestAnimationFrame(() => setTimeout(painted)));
await makeOthers();
scenario.tell();
openTab(tabs.find((tab) => tab.id === kept("tab")) ?? tabs[0]);
document.documentElement.dataset.ready = "";
(window.requestIdleCallback ?? setTimeout)(() => loadPlotly().catch((error) => announce(error.message, { error: true })));
