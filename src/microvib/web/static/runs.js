// The runs that are kept: started, followed, shown over each other, chosen, removed.
// A run's state is what the server said of its id; what a person asks for (cancel) is asked of the server, and shown when it is so.

import { drop, get, getSurely, onServer, patch, post } from "./api.js";
import { announce } from "./dom.js";
import { follow } from "./jobs.js";
import { keep, kept } from "./kept.js";
import { keeps } from "./scenario.js";
import { style } from "./styles.js";

const KEPT = "runs";

const runs = [];
let chosen = null;
const listeners = new Set();

export const all = () => runs;
/** Runs that are drawn; the chosen one last, so that it lies on top. */
export const shown = () =>
  runs.filter((run) => run.state === "done" && run.visible).sort((a, b) => (a === chosen) - (b === chosen));
export const selected = () => chosen;
export const going = (run) => ["asked", "queued", "running"].includes(run.state);
/** Listeners hear "runs" where there are others, or other results; "names"; "state" and "progress" of those that go on. */
export const onChange = (listener) => listeners.add(listener);
/** Listeners hear of a run whose samples are there, before its result has come. */
export const onReady = (listener) => readyListeners.add(listener);
const readyListeners = new Set();
const ready = (run) => readyListeners.forEach((listener) => listener(run));
const tell = (what) => listeners.forEach((listener) => listener(what));

/** Start a run of {scenario, name, steady, seeds}, which is then followed to its end. Refused where the server does not take it. */
export async function start({ name, ...wanted }) {
  const run = add({ name: unlike(name), ...wanted });
  choose(run);
  try {
    await launch(run);
  } catch (error) {
    take(run);
    throw error;
  }
}

async function launch(run) {
  const { scenario, name, steady, seeds } = run;
  ({ id: run.id } = await post("/api/runs", { scenario, name: name.slice(0, 200), steady, seeds }));
  store();
  if (run.unwanted) drop(run.id).catch(() => null);
  finish(run);
}

/** Start again what the server has no more. */
export async function again(run) {
  Object.assign(run, { state: "asked", id: null, progress: {}, unwanted: false });
  tell("runs");
  try {
    await launch(run);
  } catch (error) {
    run.state = "gone";
    tell("runs");
    throw error;
  }
}

function add({ id = null, name, scenario, steady = false, seeds = null, look, visible = true }) {
  const taken = runs.map((run) => run.look);
  const run = { id, name, scenario, steady, seeds, visible, state: "asked", progress: {}, result: null, error: null, unwanted: false };
  run.look = look ?? style.free(taken);
  [run.colour, run.dash] = style(run.look);
  runs.push(run);
  return run;
}

/** The name, with a number where another run has it already. */
function unlike(name) {
  const names = runs.map((run) => run.name);
  for (let k = 1; ; k++) {
    const tried = k === 1 ? name : `${name} (${k})`;
    if (!names.includes(tried)) return tried;
  }
}

async function finish(run) {
  const end = await follow(run.id, (job) => step(run, job), () => ready(run));
  if (!runs.includes(run)) return;
  Object.assign(run, end.state === "gone" && run.unwanted ? { state: "cancelled" } : end);
  if (run.state === "done") performance.mark("run-done");
  announce(`${run.name}: ${run.state}.`);
  pass(run);
  tell("runs");
}

function step(run, { state, progress }) {
  const what = run.state === state ? "progress" : "state";
  Object.assign(run, { state, progress });
  if (what === "state" && state === "running") announce(`${run.name}: running.`);
  tell(what);
}

/** Runs of this tab, after a reload; of those that the server has no more their scenarios. */
export function restore() {
  const found = kept(KEPT, []);
  const again = found.map(add);
  choose(again[found.findIndex((one) => one.chosen)] ?? again.at(-1) ?? null);
  return Promise.all(again.map(finish));
}

function store() {
  const known = runs.filter((run) => run.id !== null);
  const facts = known.map(({ id, name, scenario, steady, seeds, look, visible }, k) => ({
    id,
    name,
    scenario,
    steady,
    seeds,
    look,
    visible,
    chosen: known[k] === chosen,
  }));
  // Long texts of scenarios may be more than the browser keeps; then the runs come back, but cannot be started again.
  if (!keep(KEPT, facts)) keep(KEPT, facts.map((one) => ({ ...one, scenario: null }))); // prettier-ignore
}

/** A run of the library, {id, name, scenario, steady, seeds}; one that is here already is chosen. */
export function open({ id, name, ...wanted }) {
  const here = runs.find((run) => run.id === id);
  if (here) return choose(here);
  const run = add({ id, name: unlike(name), ...wanted });
  choose(run);
  return finish(run);
}

/** Give a run another name, here and in the library. */
export async function rename(run, name) {
  const wanted = name.trim();
  if (!wanted || wanted === run.name) return;
  run.name = unlike(wanted);
  store();
  tell("names");
  run.renamed = true;
  await pass(run);
}

/** The library calls a run as the page does, from when it has it. */
async function pass(run) {
  if (!run.renamed || run.state !== "done" || !keeps) return;
  await patch(`/api/library/${run.id}`, { title: run.name.slice(0, 200) }).catch((error) => announce(error.message, { error: true }));
}

/** A run has another name in the library. */
export function called(id, name) {
  const run = runs.find((one) => one.id === id);
  if (!run) return;
  run.name = name;
  store();
  tell("names");
}

export function choose(run) {
  chosen = run;
  if (run) run.visible = true;
  store();
  tell("runs");
}

export function toggle(run) {
  run.visible = !run.visible;
  store();
  tell("runs");
}

/** Ask the server to cancel a run; it is cancelled when the server says so. */
export async function cancel(run) {
  run.unwanted = true;
  tell("progress");
  if (run.id) await drop(run.id).catch((error) => announce(error.message, { error: true }));
}

function take(run) {
  const place = runs.indexOf(run);
  runs.splice(place, 1);
  if (chosen === run) chosen = runs[Math.min(place, runs.length - 1)] ?? null;
  store();
  tell("runs");
}

/** Take a run off the page; one that goes on is cancelled, one that has ended stays in the library. */
export async function remove(run) {
  const goesOn = going(run);
  run.unwanted = true;
  take(run);
  if (run.id && goesOn) await drop(run.id).catch(() => null);
}

/** A run that was deleted is on the page no more. */
export function deleted(id) {
  const run = runs.find((one) => one.id === id);
  if (run) take(run);
}

/** What the server says of a run's samples; a run that it has no more is gone from now on. */
export async function ask(run, what, query, options) {
  const question = questionOf(run, what, query);
  if (LASTING.includes(what) && answers.has(question)) return answers.get(question);
  const fetched = await prefetching.get(question);
  if (fetched) return fetched;
  try {
    const answer = await get(`/api/runs/${run.id}/${what}`, query, options);
    if (LASTING.includes(what)) remember(question, answer);
    return answer;
  } catch (error) {
    if (error.status === 404 && run.state === "done") lose([run]);
    throw error;
  }
}

const questionOf = (run, what, query) => `${run.id} ${what} ${JSON.stringify(query)}`;

/** Fetch what will be drawn as soon as the result is there. */
export function prefetch(run, what, query) {
  const answer = ask(run, what, query).catch(() => null); // who draws it asks again, and hears why
  const question = questionOf(run, what, query);
  prefetching.set(question, answer.finally(() => prefetching.delete(question)));
}

const prefetching = new Map();

// Samples of a run do not change: what was asked once, of runs that lie below a new one, is not asked again.
const LASTING = ["spectrum", "series"];
const MOST = 200;
const answers = new Map();

function remember(question, answer) {
  answers.set(question, answer);
  if (answers.size > MOST) answers.delete(answers.keys().next().value);
}

function lose(lost) {
  for (const run of lost) run.state = "gone";
  tell("runs");
}

/** Of runs that ended before the server was restarted, those that its library does not have are lost. */
async function look() {
  const done = runs.filter((run) => run.state === "done" && run.id);
  if (!done.length) return;
  const there = await getSurely("/api/jobs", { ids: done.map((run) => run.id).join(",") }).catch(() => null);
  if (there === null) return; // this browser is not let in yet
  const lost = done.filter((run) => !there.some((job) => job.id === run.id));
  if (lost.length) lose(lost);
}

onServer((what) => ["restarted", "open"].includes(what) && look());
