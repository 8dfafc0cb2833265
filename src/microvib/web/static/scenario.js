// The scenario that is edited: a base (catalog name or uploaded text) and changes. Kept in the address, so that a link,
// a reload and the browser's own back and forward restore it.

import { get, post } from "./api.js";
import { debounce } from "./dom.js";
import { latest } from "./latest.js";

const DELAY = 200;
const LONGEST_LINK = 30_000;

const state = { base: "state-1", text: null, packed: null, changes: {} };
let seen = { values: {}, base_values: {}, sources: {}, changed: [], errors: [], derived: [], unusual: [], title: "", yaml: null, of: null };
let answered = null;
const checking = latest();
const opening = latest();
const listeners = new Set();

export let catalog = [];
export let schema = [];
/** Whether the server keeps what has ended. */
export let keeps = false;
let fields = new Map();

/** Ask the server for its catalog and what it says of each field. */
export async function load() {
  [catalog, { groups: schema, keeps }] = await Promise.all([get("/api/catalog"), get("/api/schema")]);
  fields = new Map(schema.flatMap((group) => group.fields.map((field) => [field.key, field])));
}

/** The scenario as the server wants it. */
export const current = () => ({ base: state.text === null ? state.base : null, text: state.text, changes: { ...state.changes } });
/** The server's last word on it. */
export const checked = () => seen;
export const onCheck = (listener) => listeners.add(listener);

/** Declaration of a key; of an item of a list (array.modes.1.frequency) that of the list's items. */
export function fieldOf(key) {
  const [, list, item] = /^(.*)\.\d+\.(.*)$/.exec(key) ?? [];
  return fields.get(key) ?? fields.get(list)?.items?.find((field) => field.key === item);
}

/** What a group or a list's item is made of, as declarations; empty where it is a single value. */
export function partsOf(key) {
  const list = fields.get(key)?.items;
  const inside = [...fields.keys()].filter((name) => name.startsWith(`${key}.`));
  return list ?? inside.map((name) => ({ ...fields.get(name), key: name.slice(key.length + 1) }));
}

/** A short name: the base, and what was changed last. */
export function shortName() {
  const base = state.text === null ? state.base : (seen.of === origin() && seen.title) || "uploaded";
  const changes = Object.entries(state.changes).map(([key, text]) => `${key.split(".").slice(-2).join(" ")} ${text}`);
  const more = changes.length > 2 ? ` and ${changes.length - 2} more` : "";
  return [base, ...changes.slice(-2).reverse()].join(", ") + more;
}

/** What the server's last word was about: another base has other values. */
const origin = () => state.text ?? state.base;

/** Change one key; the text of the base takes the change back. */
export function change(key, text) {
  delete state.changes[key]; // what is changed last stands last
  if (seen.of !== origin() || text !== seen.base_values[key]) state.changes[key] = text;
  soon();
}

/** Take over several changes at once, as a step of its own in the browser's history. */
export async function changeAll(changes) {
  Object.assign(state.changes, changes);
  remember();
  await check();
}

export async function undo(key) {
  delete state.changes[key];
  remember();
  await check();
}

export async function undoAll() {
  state.changes = {};
  remember();
  await check();
}

/** Start from a catalog scenario, or from a text, which may have values to correct. One that cannot be read changes nothing. */
export function startFrom({ base = null, text = null, changes = {} }) {
  return opening(async (signal) => (text === null ? null : (await readable(text, signal), packed(text))), (packed) => {
    Object.assign(state, { base, text, packed, changes: { ...changes } });
    remember();
    return check();
  });
}

async function readable(text, signal) {
  const answer = await post("/api/scenario", { base: null, text, changes: {} }, { signal });
  if (!Object.keys(answer.values).length) throw new Error(answer.errors.map((item) => item.error).join(" "));
}

const soon = debounce(() => check(), DELAY);

/** Ask the server what it thinks of the scenario as it is now; done when its newest answer is there. */
export function check() {
  answered = ask();
  return answered;
}

async function ask() {
  const of = origin();
  try {
    const question = (signal) => post("/api/scenario", current(), { signal });
    const newest = await checking(question, (answer) => hear({ ...answer, of }));
    if (!newest) await answered;
  } catch (error) {
    hear({ ...seen, errors: [{ key: null, error: error.message }] });
  }
}

/** The scenario as a file's text, and what is wrong with it: as it is now, not as it was when the server last spoke. */
export const asFile = () => post("/api/scenario", current());

function hear(answer) {
  seen = answer;
  tell();
}

/** Let all listeners hear the server's last word. */
export function tell() {
  for (const listener of listeners) listener(seen);
}

/** Put the scenario into the address, as a step that the browser can go back. */
export function remember() {
  if (fragment() !== location.hash.slice(1)) history.pushState(null, "", `#${fragment()}`);
}

/** Address that restores the scenario; null where its text is too long for one. */
export const link = () => (fragment().length > LONGEST_LINK ? null : `${location.origin}${location.pathname}#${fragment()}`);

function fragment() {
  const parts = state.text === null ? [["base", state.base]] : [["text", state.packed]];
  return new URLSearchParams([...parts, ...Object.entries(state.changes)]).toString();
}

/** Read the scenario from the address. */
export function restore() {
  const { base, text: packed, ...changes } = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  return opening(
    () => (packed ? unpacked(packed) : null),
    (text) => {
      Object.assign(state, { base: base ?? catalog[0].name, text, packed: packed ?? null, changes });
      return check();
    },
  );
}

export const baseName = () => (state.text === null ? state.base : null);

async function packed(text) {
  const stream = new Blob([text]).stream().pipeThrough(new CompressionStream("deflate-raw"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""))
    .replaceAll("+", "-")
    .replaceAll("/", "_");
}

async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"))).text();
}
