// The Library tab: runs, studies and recordings that the server keeps, with names and attributes; opened, renamed, deleted, brought back.

import { openAngles } from "./angles.js";
import { openBudget } from "./budget.js";
import { openCampaign } from "./campaign.js";
import { get, patch, post, remove } from "./api.js";
import { openRanking } from "./datasheet.js";
import { announce, h } from "./dom.js";
import { openEnvelope } from "./envelope.js";
import { openModes } from "./modes.js";
import { openQuiet } from "./quiet.js";
import { openRates } from "./rates.js";
import { openRecording } from "./recording.js";
import * as runs from "./runs.js";
import { openSas } from "./sas.js";
import { openSweep } from "./sweep.js";

const openRun = ({ id, title, asked }) => runs.open({ id, name: title, scenario: asked.scenario, steady: asked.steady, seeds: asked.seeds });
const KINDS = {
  run: ["run", "tab-run", openRun],
  recording: ["recording", "tab-recording", openRecording],
  analysis: ["analysis", "tab-recording", openRecording],
  comparison: ["comparison", "tab-recording", openRecording],
  tracking: ["orders", "tab-recording", openRecording],
  batch: ["several recordings", "tab-recording", openRecording],
  repeated: ["repeatability", "tab-recording", openRecording],
  hammer: ["hammer test", "tab-recording", openRecording],
  acceptance: ["acceptance report", "tab-recording", openRecording],
  identification: ["fit", "tab-recording", openRecording],
  rates: ["rate map", "tab-rates", openRates],
  campaign: ["campaign", "tab-campaign", openCampaign],
  sweep: ["sweep", "tab-run", openSweep],
  angles: ["angles", "tab-angles", openAngles],
  envelope: ["envelope", "tab-envelope", openEnvelope],
  budget: ["pointing budget", "tab-budget", openBudget],
  quiet: ["quieter drive", "tab-quiet", openQuiet],
  shapes: ["mode shapes", "tab-modes", openModes],
  sensitivity: ["ranking", "tab-sheet", openRanking],
  sas: ["SAS sizing", "tab-sas", openSas],
};
const search = h("input", { type: "search", id: "library-search", placeholder: "Search names, kinds, attributes", oninput: () => show() });
const list = h("div", {});
const removed = h("div", { role: "status" });
let entries = [];

export function makeLibrary(tab) {
  const words =
    "What has ended, and recordings, stay here when the server is restarted. The one not used for longest makes room for new ones, unless it is to stay.";
  tab.append(
    h(
      "section",
      { class: "card" },
      h("div", { class: "bar" }, h("h2", {}, "Library"), h("label", { for: "library-search", class: "away" }, "Search the library"), search),
      h("p", { class: "soft note" }, words),
      removed,
      list,
    ),
  );
  new MutationObserver(() => tab.hidden || update()).observe(tab, { attributes: true, attributeFilter: ["hidden"] });
  if (!tab.hidden) update();
}

async function update() {
  try {
    const found = await get("/api/library");
    entries = found.entries;
    if (found.there) show();
    else list.replaceChildren(h("p", {}, "This server keeps nothing: it was started without a library, or another server has it."));
  } catch (error) {
    announce(error.message, { error: true });
  }
}

const wordsOf = (attributes) => Object.entries(attributes).map(([name, text]) => `${name}: ${text}`).join(", ");

/** Attributes from "unit: 2, axis: +Z". */
function attributesOf(text) {
  const pairs = text.split(",").map((pair) => pair.split(":").map((part) => part.trim()));
  return Object.fromEntries(pairs.filter(([name]) => name).map(([name, ...value]) => [name, value.join(":")]));
}

function show() {
  const wanted = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  const text = ({ title, kind, attributes }) => `${title} ${KINDS[kind]?.[0] ?? kind} ${wordsOf(attributes)}`.toLowerCase();
  const found = entries.filter((entry) => wanted.every((word) => text(entry).includes(word)));
  if (!found.length) return list.replaceChildren(h("p", {}, entries.length ? "Nothing is called so." : "Nothing is here yet."));
  const heads = ["name", "kind", "attributes", "made", "MB", "stays", ""].map((head) => h("th", { scope: "col" }, head));
  list.replaceChildren(
    h(
      "div",
      { class: "wide", tabindex: "0", role: "region", "aria-label": "Entries of the library" },
      h("table", { class: "library" }, h("thead", {}, h("tr", {}, heads)), h("tbody", {}, found.map(row))),
    ),
  );
}

function row(entry) {
  const { id, kind, title, attributes, created, size, kept } = entry;
  const field = (value, label, change) =>
    h("input", { type: "text", value, "aria-label": `${label} of ${title}`, maxlength: 200, onchange: (event) => save(entry, change(event.target.value)) });
  const stays = h("input", { type: "checkbox", "aria-label": `${title} stays`, onchange: () => save(entry, { kept: stays.checked }) });
  stays.checked = kept;
  const cells = [
    ["name", field(title, "Name", (text) => ({ title: text.trim() }))],
    ["kind", KINDS[kind]?.[0] ?? kind],
    ["attributes", field(wordsOf(attributes), "Attributes", (text) => ({ attributes: attributesOf(text) }))],
    ["made", new Date(created).toLocaleString([], { dateStyle: "short", timeStyle: "short" })],
    ["MB", (size / 1e6).toFixed(1)],
    ["stays", stays],
    ["", [h("button", { type: "button", onclick: () => open(entry) }, "Open"), h("button", { type: "button", onclick: () => take(entry) }, "Delete")]],
  ];
  return h("tr", { "data-id": id, "data-title": title }, cells.map(([label, content]) => h("td", { "data-label": label }, content)));
}

async function save(entry, changes) {
  try {
    Object.assign(entry, await patch(`/api/library/${entry.id}`, changes));
    if (changes.title) runs.called(entry.id, entry.title);
  } catch (error) {
    announce(error.message, { error: true });
  }
  show();
}

async function open({ id, kind }) {
  try {
    const whole = await get(`/api/library/${id}`);
    const [, tab, show] = KINDS[kind];
    document.getElementById(tab).click();
    await show(whole);
  } catch (error) {
    announce(error.message, { error: true });
  }
}

async function take(entry) {
  try {
    await remove(`/api/library/${entry.id}`);
  } catch (error) {
    return announce(error.message, { error: true });
  }
  runs.deleted(entry.id);
  removed.replaceChildren(
    h("p", {}, `${entry.title} is deleted. `, h("button", { type: "button", onclick: () => bringBack(entry) }, "Undo")),
  );
  removed.querySelector("button").focus();
  await update();
}

async function bringBack(entry) {
  try {
    await post(`/api/library/${entry.id}/restore`, {});
    removed.replaceChildren(h("p", {}, `${entry.title} is back.`));
    await update();
  } catch (error) {
    announce(error.message, { error: true });
  }
}
