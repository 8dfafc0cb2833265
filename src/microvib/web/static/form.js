// The scenario as a form: groups as the drive is built, each field with symbol, meaning, unit, range and source.

import { $, h, symbol } from "./dom.js";
import { moveLive } from "./live.js";
import * as scenario from "./scenario.js";
import { sweepOver } from "./sweep.js";

const LONG = 60; // characters of a meaning, of which the label then shows the beginning
const rows = new Map();
const groups = new Map();
const TITLES = {
  slip_ring: "slip ring",
  transmission_error: "transmission error",
  microstep_shape: "part of a microstep",
  compensation: "compensation",
  flux_harmonics: "flux harmonic",
  detent: "detent harmonic",
  modes: "mode",
  train: "stage",
  profile: "leg",
  friction: "friction",
};

/** A spacecraft to begin with, of examples/spacecraft.yaml: assumed, of no mission. */
const CRAFT =
  "{hub: {mass: 420 kg, inertia: [180 kg*m^2, 150 kg*m^2, 210 kg*m^2, 4 kg*m^2, -6 kg*m^2, 3 kg*m^2]}, array_angle: 30 deg," +
  " interface: {position: [0.35 m, 0.9 m, -0.2 m], drive_axis: [0, 1, 0], reference: [1, 0, 0]}, attitude_control: {bandwidth: 0.02 Hz, damping: 0.7}," +
  " line_of_sight: {boresight: [0, 0, 1], windows: [1 ms, 10 ms, 100 ms, 1 s], pixel: 0.5 urad}}";

const NO_GAINS = { "driver.proportional_gain": "0 V/A", "driver.integral_gain": "0 V/(A*s)", "driver.derivative_gain": "0 V*s/A" };
/** What `driver.drive` leaves no choice of. */
const BY_DRIVE = {
  voltage: { words: "Set all gains to 0, as voltages need", values: NO_GAINS },
  pulse: { words: "Set whole steps and all gains to 0, as pulses need", values: { "driver.microsteps": "1", ...NO_GAINS } },
};

/** Put the scenario on an example craft. */
export const addCraft = () => scenario.changeAll({ spacecraft: CRAFT });

/** Take an array whose modes have all six components, from finite elements of the catalog. */
export const takeReferenceArray = () => scenario.changeAll({ array: "{fem: reference-array}" });

export function makeForm() {
  $("#search").addEventListener("input", filter);
  $("#only-changed").addEventListener("change", filter);
  $("#undo-all").addEventListener("click", scenario.undoAll);
  scenario.onCheck(show);
}

/** Bring the form in line with what the server said; fields keep focus and what is being typed. */
function show(seen) {
  const keys = keysOf(seen);
  if (keys.length && (keys.length !== rows.size || keys.some((key) => !rows.has(key)))) build(keys);
  const errors = new Map(seen.errors.map((item) => [item.key, item.error]));
  const changes = scenario.current().changes;
  for (const [key, row] of rows) showRow(key, row, seen, changes, errors);
  for (const [name, group] of groups) showGroup(name, group, errors, changes);
  const rest = seen.errors.filter((item) => !rows.has(item.key)).map((item) => item.error);
  $("#form-error").hidden = !rest.length;
  $("#form-error").textContent = rest.join(" ");
  $("#title").textContent = seen.title;
  const count = Object.keys(changes).length;
  $("#changed-count").textContent = count || "";
  $("#undo-all").disabled = !count;
  const unusual = $("#unusual");
  if (unusual) {
    unusual.hidden = !seen.unusual.length;
    unusual.textContent = seen.unusual.join(". ");
  }
  showWhole(changes, seen, errors);
  showByDrive(changes, seen);
  $("#derived")?.replaceChildren(...seen.derived.map((text) => h("li", {}, text)));
  if ($("#only-changed").checked) filter();
}

/** Parts that were replaced as a whole, each with its way back, and a spacecraft where there is none. */
function showWhole(changes, { values }, errors) {
  const whole = Object.keys(changes).filter((key) => !key.includes("."));
  const button = (words, action) => h("button", { type: "button", class: "quiet", onclick: action }, words);
  const none = Object.keys(values).length > 0 && !Object.keys(values).some((key) => key.startsWith("spacecraft.")) && !("spacecraft" in changes);
  $("#whole")?.replaceChildren(
    ...whole.map((key) => button(`↶ ${key} is replaced: back to the base's`, () => scenario.undo(key))),
    ...(none ? [button("Add a spacecraft (an example, assumed)…", addCraft)] : []),
    ...(errors.has("array") ? [button("Take the reference array, from finite elements, instead of this one", takeReferenceArray)] : []),
  );
}

/** What the kind of drive leaves no choice of, where it is set otherwise. */
function showByDrive(changes, seen) {
  const text = (key) => changes[key] ?? seen.values[key] ?? "";
  const { words, values = {} } = BY_DRIVE[text("driver.drive")] ?? {};
  const other = Object.entries(values).filter(([key, wanted]) => Number.parseFloat(text(key)) !== Number.parseFloat(wanted));
  const set = () => scenario.changeAll(Object.fromEntries(other));
  $("#by-drive")?.replaceChildren(...(other.length ? [h("button", { type: "button", onclick: set }, words)] : []));
}

/** All keys that are set; a list or group that was changed as one stands before its items. */
function keysOf({ values }) {
  const keys = Object.keys(values);
  if (!keys.length) return keys;
  for (const whole of Object.keys(scenario.current().changes).filter((key) => !(key in values))) {
    const first = keys.findIndex((key) => key.startsWith(`${whole}.`));
    keys.splice(first < 0 ? keys.length : first, 0, whole);
  }
  return keys;
}

function showRow(key, row, seen, changes, errors) {
  const text = changes[key] ?? seen.values[key] ?? "";
  if (row.input !== document.activeElement && row.input.value !== text) row.input.value = text;
  const changed = key in changes;
  row.element.classList.toggle("changed", changed);
  row.undo.hidden = !changed;
  row.undo.title = `Back to ${seen.base_values[key] || "nothing"}`;
  row.undo.setAttribute("aria-label", `Undo ${key}: back to ${seen.base_values[key] || "nothing"}`);
  const error = errors.get(key);
  row.input.setAttribute("aria-invalid", error ? "true" : "false");
  if (row.error.textContent !== (error ?? "")) row.error.textContent = error ?? "";
  row.source.textContent = changed ? "set by you" : (seen.sources[key] ?? "");
  const status = changed ? "" : (/^(assumed|identified)/.exec(seen.sources[key] ?? "")?.[0] ?? "");
  row.status.textContent = status;
}

function showGroup(name, group, errors, changes) {
  const inside = (keys) => [...keys].filter((key) => typeof key === "string" && key.startsWith(`${name}.`)).length;
  const wrong = inside(errors.keys());
  group.mark.className = `mark ${wrong ? "wrong" : inside(Object.keys(changes)) ? "changed" : ""}`;
  group.mark.textContent = wrong ? `${wrong} to correct` : inside(Object.keys(changes)) || "";
  if (wrong) group.element.open = true;
}

function build(keys) {
  const wasTyping = typing();
  const open = new Set([...groups].filter(([, group]) => group.element.open).map(([name]) => name));
  rows.clear();
  groups.clear();
  const known = scenario.schema.map((group) => [group.key, group.title]);
  for (const [name, title] of known) {
    const inside = keys.filter((key) => key.startsWith(`${name}.`));
    const single = (key) => key.split(".").length === 2;
    const own = [...inside.filter(single), ...inside.filter((key) => !single(key))]; // what has a heading of its own comes last
    if (own.length) groups.set(name, makeGroup(name, title, own, open.size ? open.has(name) : name === "motor"));
  }
  const derived = h("details", { class: "group" }, h("summary", {}, "What follows from it"), h("ul", { id: "derived" }));
  const unusual = h("p", { id: "unusual", class: "help", role: "status", hidden: true });
  const whole = h("div", { id: "whole" });
  $("#form").replaceChildren(unusual, ...[...groups.values()].map((group) => group.element), whole, derived);
  const again = rows.get(wasTyping?.key)?.input;
  if (!again) return;
  again.value = wasTyping.text; // what is being typed goes on
  again.focus();
  again.setSelectionRange?.(wasTyping.from, wasTyping.to);
}

/** The field that has the focus, with what stands in it and where the cursor is. */
function typing() {
  const { name, form, value, selectionStart, selectionEnd } = document.activeElement ?? {};
  return form === $("#form") ? { key: name, text: value, from: selectionStart, to: selectionEnd } : null;
}

function makeGroup(name, title, keys, open) {
  const mark = h("span", { class: "mark" });
  const element = h("details", { class: "group", open, "data-group": name }, h("summary", {}, title, mark));
  let part = "";
  for (const key of keys) {
    const inner = key.split(".").slice(1, -1).join(".");
    if (inner !== part && inner) element.append(h("h3", {}, partTitle(inner)));
    part = inner;
    rows.set(key, makeRow(key));
    element.append(rows.get(key).element);
    if (key === "driver.drive") element.append(h("div", { id: "by-drive" }));
  }
  for (const list of new Set(keys.flatMap((key) => /^(.*)\.\d+\./.exec(key)?.[1] ?? []))) {
    if (!keys.includes(list)) element.append(wholeButton(list));
  }
  return { element, mark };
}

/** Turns the items of a list into one text, in which items can be added and taken out. */
function wholeButton(list) {
  const name = list.split(".").at(-1).replaceAll("_", " ");
  return h("button", { type: "button", class: "quiet", onclick: () => editWhole(list) }, `Add or take out ${name}…`);
}

async function editWhole(list) {
  const items = [];
  for (const [key, text] of Object.entries({ ...scenario.checked().values, ...scenario.current().changes })) {
    const [, n, name] = key.startsWith(`${list}.`) ? /^(\d+)\.(.*)$/.exec(key.slice(list.length + 1)) : [];
    if (name && text) (items[n] ??= []).push(`${name}: ${text}`);
  }
  await scenario.changeAll({ [list]: `[${items.map((item) => `{${item.join(", ")}}`).join(", ")}]` });
  rows.get(list)?.input.focus();
}

function partTitle(inner) {
  const words = inner
    .split(".")
    .map((word) => (/^\d+$/.test(word) ? String(Number(word) + 1) : (TITLES[word] ?? word.replaceAll("_", " "))));
  return words.join(" ");
}

/** The beginning of a meaning, whole words of it, for a label; up to what it says further behind a semicolon or comma. */
function brief(meaning) {
  if (meaning.length <= LONG) return meaning;
  const [first] = meaning.split(/[;,] /);
  return first.length <= LONG ? first : `${meaning.slice(0, meaning.lastIndexOf(" ", LONG))}…`;
}

function makeRow(key) {
  const field = scenario.fieldOf(key) ?? { meaning: "", kind: "text", optional: true };
  const id = `field-${key}`;
  const input = makeInput(field, id, key);
  const undo = h("button", { type: "button", class: "undo", hidden: true, onclick: () => back(key, input) }, "↶");
  const error = h("p", { class: "error", id: `${id}-error`, role: "alert" });
  const source = h("span", { class: "source" });
  const status = h("span", { class: "tag" });
  const name = key.split(".").at(-1).replaceAll("_", " ");
  const label = h(
    "label",
    { for: id, title: `${key}: ${field.meaning}` },
    field.symbol ? symbol(field.symbol) : null,
    h("span", {}, brief(field.meaning) || name),
    status,
  );
  // Tab gets to the same from the field, by "Sweep it" below it: a stop at every label would double the way through the form.
  const over = h("button", { type: "button", class: "over", tabindex: "-1", title: `Lines over ${key}`, "aria-label": `Sweep ${key}`, onclick: () => sweepOver(key) }, "⇢");
  const named = field.kind === "quantity" ? h("span", { class: "named" }, label, over) : label;
  const parts = scenario.partsOf(key);
  const facts = [
    brief(field.meaning) === field.meaning ? "" : `${field.meaning}. `,
    h("code", {}, key),
    field.range ? ` ${field.range}.` : "",
    field.unit ? ` Unit: ${field.unit}, or a compatible one.` : "",
    parts.length ? ` Written as ${field.items ? "a list of " : ""}{${parts.map((item) => `${item.key}: …`).join(", ")}}.` : "",
    " ",
    field.kind === "quantity" && h("button", { type: "button", class: "quiet", onclick: () => moveLive(key) }, "Move it live"),
    " ",
    field.kind === "quantity" && h("button", { type: "button", class: "quiet", onclick: () => sweepOver(key) }, "Sweep it"),
    " ",
    source,
  ];
  const help = h("p", { class: "help", id: `${id}-help` }, ...facts);
  const element = h("div", { class: field.items ? "field long" : "field", "data-key": key }, named, input, undo, error, help);
  return { element, input, undo, error, source, status, words: `${key} ${field.meaning} ${field.symbol ?? ""}`.toLowerCase() };
}

function makeInput(field, id, key) {
  const common = { id, name: key, "aria-describedby": `${id}-error ${id}-help`, onchange: () => scenario.remember() };
  const edit = (event) => scenario.change(key, event.target.value);
  if (field.kind === "choice" || field.kind === "flag") {
    const choices = field.choices ?? ["true", "false"];
    return h("select", { ...common, oninput: edit }, ...choices.map((choice) => h("option", { value: choice }, choice)));
  }
  if (field.items) return h("textarea", { ...common, rows: 3, spellcheck: "false", placeholder: "none", oninput: edit });
  return h("input", {
    ...common,
    type: "text",
    spellcheck: "false",
    placeholder: field.optional ? "none" : null,
    oninput: edit,
    onkeydown: (event) => keys(event, key),
  });
}

async function back(key, input) {
  input.focus();
  await scenario.undo(key);
  input.value = scenario.checked().values[key] ?? "";
}

function keys(event, key) {
  if (event.key === "Enter") {
    event.preventDefault();
    scenario.remember();
    $("#go").click();
  }
  if (event.key === "Escape" && key in scenario.current().changes) back(key, event.target);
}

function filter() {
  const wanted = $("#search").value.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const changes = scenario.current().changes;
  const only = $("#only-changed").checked;
  for (const [key, row] of rows) {
    const found = wanted.every((word) => row.words.includes(word)) && (!only || key in changes);
    row.element.hidden = !found;
  }
  for (const group of groups.values()) {
    const some = $(".field:not([hidden])", group.element) !== null;
    group.element.hidden = !some;
    for (const title of group.element.querySelectorAll("h3")) title.hidden = wanted.length > 0 || only;
    if (some && (wanted.length || only)) group.element.open = true;
  }
}
