// The page: starts its parts, and what stands around them (tabs, scenario choice, run button, link).

import { $, announce, h, onDrop, save } from "./dom.js";
import { makeForm } from "./form.js";
import { makeRates } from "./rates.js";
import { makeRecording } from "./recording.js";
import { makeRun } from "./run.js";
import * as runs from "./runs.js";
import { makeSas } from "./sas.js";
import * as scenario from "./scenario.js";

const tabs = [...document.querySelectorAll("[role=tab]")];

function openTab(tab) {
  for (const other of tabs) {
    other.setAttribute("aria-selected", String(other === tab));
    other.tabIndex = other === tab ? 0 : -1;
    $(`#${other.getAttribute("aria-controls")}`).hidden = other !== tab;
  }
  window.dispatchEvent(new Event("resize")); // plots that were hidden take their size
}

function makeTabs() {
  for (const tab of tabs) tab.addEventListener("click", () => openTab(tab));
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
  onDrop($("#scenario"), open);
  scenario.onCheck(() => {
    const name = scenario.baseName();
    $("option[data-uploaded]", select)?.remove();
    if (name === null) select.append(h("option", { value: "", "data-uploaded": true }, "uploaded file"));
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

async function go() {
  await scenario.remember();
  await scenario.check();
  const [first] = scenario.checked().errors;
  if (first) return wrong(first.error, first.key);
  openTab(tabs[0]);
  await begin(scenario.current(), scenario.shortName());
  if (matchMedia("(max-width: 900px)").matches) $("#results").scrollIntoView();
}

function wrong(sentence, key) {
  document.getElementById(`field-${key}`)?.focus();
  announce(sentence, { error: true });
}

async function begin(what, name) {
  const steady = $("#steady").checked;
  try {
    await runs.start(what, steady ? `${name}, steady` : name, steady);
  } catch (error) {
    wrong(error.message, error.key);
  }
}

async function five() {
  openTab(tabs[0]);
  for (const { name } of scenario.catalog.filter((item) => /^state-[1-5]$/.test(item.name))) {
    await begin({ base: name, text: null, changes: {} }, name);
  }
}

async function copy() {
  const link = await scenario.link();
  if (link === null) return announce("This scenario is too long for a link; save it as a file instead.", { error: true });
  try {
    await navigator.clipboard.writeText(link);
    announce("Link copied.");
  } catch {
    announce("The browser does not let the page copy; the address bar holds the same link.", { error: true });
  }
}

function saveScenario() {
  const { yaml, errors } = scenario.checked();
  if (yaml) save(yaml, `${scenario.baseName() ?? "scenario"}.yaml`);
  else announce(errors[0]?.error ?? "The scenario has errors.", { error: true });
}

makeTabs();
await scenario.load().catch((error) => {
  announce(error.message, { error: true });
  throw error;
});
makeBase();
makeForm();
makeRun($("#run"));
makeRecording($("#recording"));
makeRates($("#rates"));
makeSas($("#sas"));
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
await scenario.restore();
await runs.restore();
document.documentElement.dataset.ready = "";
