// The runs that are kept: started, followed, shown over each other, chosen, removed.

import { drop, follow, get, post } from "./api.js";
import { announce } from "./dom.js";

// Okabe and Ito's colours, which colour-blind people can tell apart, and a dash for those who see none.
const STYLES = [
  ["#0072B2", "solid"],
  ["#D55E00", "dash"],
  ["#009E73", "dot"],
  ["#E69F00", "dashdot"],
  ["#CC79A7", "longdash"],
  ["#56B4E9", "longdashdot"],
  ["#8c8c8c", "solid"],
];
const KEPT = "microvib.runs";

const runs = [];
let chosen = null;
const listeners = new Set();

export const all = () => runs;
/** Runs that are drawn; the chosen one last, so that it lies on top. */
export const shown = () =>
  runs.filter((run) => run.state === "done" && run.visible).sort((a, b) => (a === chosen) - (b === chosen));
export const selected = () => chosen;
export const onChange = (listener) => listeners.add(listener);
const tell = (what) => listeners.forEach((listener) => listener(what));

/** Start a run, which is followed to its end. Refused where the server does not take it. */
export async function start(scenario, name, steady) {
  const { id } = await post("/api/runs", { scenario, name: name.slice(0, 200), steady });
  keep({ id, name, scenario });
}

function keep({ id, name, scenario }) {
  const style = STYLES.findIndex((_, k) => runs.every((run) => run.style !== k));
  const run = { id, name, scenario, style: Math.max(style, 0), state: "queued", progress: {}, visible: true, result: null };
  [run.colour, run.dash] = STYLES[run.style];
  runs.push(run);
  store();
  choose(run);
  finish(run);
}

async function finish(run) {
  try {
    const parameters = post("/api/scenario", run.scenario);
    run.result = await follow(run.id, (job) => step(run, job));
    run.values = (await parameters).values;
    performance.mark("run-done");
    run.state = "done";
    announce(`${run.name}: done.`);
  } catch (error) {
    if (!runs.includes(run)) return;
    run.state = run.cancelled ? "cancelled" : "failed";
    run.error = error.message;
    announce(`${run.name}: ${run.state}.`);
  }
  tell("runs");
}

function step(run, job) {
  const began = run.state === "queued" && job.state === "running";
  if (job.state !== "done") run.state = job.state;
  run.progress = job.progress ?? {};
  if (began) announce(`${run.name}: running.`);
  tell("progress");
}

/** Runs of this tab that the server still has, after a reload. */
export async function restore() {
  for (const kept of JSON.parse(sessionStorage.getItem(KEPT) ?? "[]")) {
    const job = await get(`/api/jobs/${kept.id}`).catch(() => null);
    if (job && job.state !== "cancelled") keep(kept);
  }
  store();
}

function store() {
  sessionStorage.setItem(KEPT, JSON.stringify(runs.map(({ id, name, scenario }) => ({ id, name, scenario }))));
}

export function choose(run) {
  chosen = run;
  if (run) run.visible = true;
  tell("runs");
}

export function toggle(run) {
  run.visible = !run.visible;
  tell("runs");
}

export const going = (run) => run.state === "queued" || run.state === "running";

export async function cancel(run) {
  run.cancelled = true;
  await drop(run.id).catch((error) => announce(error.message, { error: true }));
}

export async function remove(run) {
  if (going(run)) run.cancelled = true;
  runs.splice(runs.indexOf(run), 1);
  store();
  if (chosen === run) chosen = runs.at(-1) ?? null;
  tell("runs");
  await drop(run.id).catch(() => null);
}
