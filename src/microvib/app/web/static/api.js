// The server's side of the page: requests, and jobs that are followed to their end.

/** What the server says is wrong, in its own sentence; `key` names the field where it knows one. */
export class Refused extends Error {
  constructor(sentence, key = null) {
    super(sentence);
    this.key = key;
  }
}

/** Beside the cookie, which browsers send to every port of a host, the key that was left here on the way in. */
const key = () => localStorage.getItem("microvib.key") ?? "";

async function request(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { ...options, headers: { ...options.headers, "X-Microvib-Key": key() } });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused("The server does not answer; is microvib serve still running?");
  }
  if (!answer.ok) {
    const body = await answer.json().catch(() => ({}));
    throw new Refused(body.error ?? `The server answers ${answer.status} ${answer.statusText}.`, body.key);
  }
  return answer;
}

export const get = async (path, query = {}, options = {}) => {
  const given = Object.entries(query).filter(([, value]) => value !== undefined && value !== null);
  const text = new URLSearchParams(given).toString();
  return (await request(path + (text && `?${text}`), options)).json();
};

export const post = async (path, data, options = {}) => {
  const body = JSON.stringify(data);
  return (await request(path, { ...options, method: "POST", headers: { "Content-Type": "application/json" }, body })).json();
};

export const upload = async (path, query, body) => {
  const headers = { "Content-Type": "application/octet-stream" };
  return (await request(`${path}?${new URLSearchParams(query)}`, { method: "POST", headers, body })).json();
};

export const drop = (id) => request(`/api/jobs/${id}`, { method: "DELETE" });

const ENDED = ["done", "failed", "cancelled"];
const PAUSE = 100;
const watched = new Map();
let looking = false;

/** Follow a job to its end; its result, or Refused with the reason. `onStep` gets each state on the way. */
export async function follow(id, onStep = () => {}) {
  const state = await new Promise((resolve) => {
    watched.set(id, { onStep, resolve });
    look();
  });
  if (state === "done") return get(`/api/jobs/${id}/result`);
  if (state === "cancelled") throw new Refused("Cancelled.");
  throw new Refused((await get(`/api/jobs/${id}`)).error ?? "The job failed.");
}

// One question for all jobs: a stream for each would use up the six connections that a browser's tabs share.
async function look() {
  if (looking) return;
  looking = true;
  while (watched.size) {
    const jobs = await get("/api/jobs").catch(() => null);
    for (const job of jobs ?? []) tell(job);
    for (const id of jobs ? watched.keys() : []) if (!jobs.some((job) => job.id === id)) end(id, "cancelled");
    await new Promise((resolve) => setTimeout(resolve, jobs ? PAUSE : 10 * PAUSE));
  }
  looking = false;
}

function tell(job) {
  watched.get(job.id)?.onStep(job);
  if (ENDED.includes(job.state)) end(job.id, job.state);
}

function end(id, state) {
  watched.get(id)?.resolve(state);
  watched.delete(id);
}
