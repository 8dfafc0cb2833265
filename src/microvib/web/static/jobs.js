// Computations on the server, each followed to its end.
// A question names the jobs that it is about: an answer says nothing of a job that was started after it was asked,
// and of one that was asked about, its silence means that the server has it no more.

import { getSurely } from "./api.js";

const ENDED = ["done", "failed", "cancelled"];
const PART = 0.05; // of the time that the youngest computation has taken: so long the server may wait for its end
const WAITS = [100, 250]; // ms, least and most of it
const GONE = { state: "gone", error: "The server no longer has this computation: it was restarted, or dropped it to make room for newer ones." };

const followed = new Map();
let asking = false;

/**
 * Follow a job to its end: {state: "done", result}, or {state: "failed", "cancelled" or "gone", error}. `onStep` gets each state
 * on the way; `onDone` is called when the job is done, before its result has come.
 */
export async function follow(id, onStep = () => {}, onDone = () => {}) {
  const end = await new Promise((resolve) => {
    followed.set(id, { onStep, resolve, since: performance.now() });
    ask();
  });
  if (end.state !== "done") return end;
  onDone();
  try {
    return { state: "done", result: await getSurely(`/api/jobs/${id}/result`) };
  } catch {
    return GONE;
  }
}

// One question for all jobs: a stream for each would use up the six connections that a browser's tabs share. The server answers
// when one of them has ended, or after a moment with how far they are.
async function ask() {
  if (asking) return;
  asking = true;
  while (followed.size) {
    const ids = [...followed.keys()];
    const jobs = await getSurely("/api/jobs", { ids: ids.join(","), wait: waitFor() }).catch(() => []);
    for (const id of ids) step(id, jobs.find((job) => job.id === id) ?? GONE);
  }
  asking = false;
}

function waitFor() {
  const youngest = performance.now() - Math.max(...[...followed.values()].map(({ since }) => since));
  const [least, most] = WAITS;
  return Math.round(Math.min(Math.max(PART * youngest, least), most));
}

function step(id, job) {
  const { onStep, resolve } = followed.get(id) ?? {};
  if (!resolve) return;
  if (job !== GONE && !ENDED.includes(job.state)) return onStep(job);
  followed.delete(id);
  resolve(job);
}

