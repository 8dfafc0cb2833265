// Requests to the server, and how it stands: whether it answers, and whether it is still the one that was asked first.

/** What the server says is wrong, in its own sentence; `key` names the field where it knows one. */
export class Refused extends Error {
  constructor(sentence, key = null, status = 0) {
    super(sentence);
    this.key = key;
    this.status = status;
  }
}

/** No answer came; what was asked may or may not have been done. */
export class Silent extends Error {}

const NO_ANSWER = "The server does not answer; is microvib serve still running?";
const ANSWER_WITHIN = 20_000;
const AGAIN = 1000;
const TOO_MUCH = 429;
const NOT_LET_IN = 401;
const server = { name: null, past: new Set(), silent: false, shut: false };
const listeners = new Set();

// A computation that was dropped is asked about no more: what is under way ends before the server hears of it, for an answer
// that came later would be a refusal.
const DROPPED = "This computation was dropped.";
const GONE = 410;
const QUESTION = /^\/api\/(?:jobs|runs|analyses)\/([^/?]+)\//;
const wanted = new Map();

/** Listeners hear "silent", "answers", "restarted", and "shut" and "open": whether this browser is let in. */
export const onServer = (listener) => listeners.add(listener);
const tell = (what) => listeners.forEach((listener) => listener(what));
export const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Beside the cookie, which browsers send to every port of a host, the key that was left here on the way in. */
const key = () => localStorage.getItem("microvib.key") ?? "";

async function request(path, options = {}) {
  const { answer, text } = await fetched(path, options);
  return read(answer.status, answer.statusText, text, answer.headers.get("microvib-server"));
}

/** What an answer says, and that of the server; Refused where it is a refusal. */
function read(status, words, text, name) {
  hear(name);
  if (server.shut !== (status === NOT_LET_IN)) {
    server.shut = !server.shut;
    tell(server.shut ? "shut" : "open");
  }
  if (status < 200 || status > 299) {
    const { error, key } = parsed(text) ?? {};
    throw new Refused(error ?? `The server answers ${status} ${words}.`, key, status);
  }
  return parsed(text);
}

async function fetched(path, { limited, signal, ...options }) {
  const waiting = limited ? patience() : { heard: () => {} };
  const dropped = whileWanted(QUESTION.exec(path)?.[1]);
  try {
    const headers = { ...options.headers, "X-Microvib-Key": key() };
    const ends = AbortSignal.any([signal, waiting.signal, dropped].filter(Boolean));
    const answer = await fetch(path, { ...options, headers, signal: ends });
    return { answer, text: await whole(answer, waiting.heard) };
  } catch (error) {
    if (signal?.aborted) throw error; // nobody wants it any more
    if (dropped?.aborted) throw new Refused(DROPPED, null, GONE);
    hearNothing();
    throw new Silent(NO_ANSWER);
  } finally {
    waiting.end?.();
  }
}

/** A signal that ends questions about the computation of this id when it is dropped. */
function whileWanted(id) {
  if (id === undefined) return null;
  if (!wanted.has(id)) wanted.set(id, new AbortController());
  return wanted.get(id).signal;
}

/** A signal that ends what has not been heard of for some time; a long answer over a slow line is heard of all the while. */
function patience() {
  const control = new AbortController();
  let timer = null;
  const end = () => clearTimeout(timer);
  const heard = () => {
    end();
    timer = setTimeout(() => control.abort(), ANSWER_WITHIN);
  };
  heard();
  return { signal: control.signal, heard, end };
}

async function whole(answer, heard) {
  if (!answer.body) return answer.text();
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    heard();
    const { value, done } = await reader.read();
    if (done) return text;
    text += value;
  }
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

// Each start of the server has a name of its own; one that was followed by another is past, and what still comes from it is not heard.
function hear(name) {
  if (server.silent) {
    server.silent = false;
    tell("answers");
  }
  if (name === null || name === server.name || server.past.has(name)) return;
  const restarted = server.name !== null;
  if (restarted) server.past.add(server.name);
  server.name = name;
  if (restarted) tell("restarted");
}

async function hearNothing() {
  if (server.silent) return;
  server.silent = true;
  tell("silent");
  while (server.silent) {
    await pause(AGAIN);
    await knock();
  }
}

/** Ask whether the server is there; listeners hear what has changed. */
export const knock = () => get("/api/jobs", { ids: "" }, { limited: true }).catch(() => null);

export const get = (path, query = {}, options = {}) => {
  const given = Object.entries(query).filter(([, value]) => value !== undefined && value !== null);
  const text = new URLSearchParams(given).toString();
  return request(path + (text && `?${text}`), options);
};

/** The same, asked until it is answered: for what must not be missed because nobody answered, or all were busy, for a moment. */
export async function getSurely(path, query = {}) {
  for (;;) {
    try {
      return await get(path, query, { limited: true });
    } catch (error) {
      if (error instanceof Refused && error.status < 500 && error.status !== TOO_MUCH) throw error;
    }
    await pause(AGAIN);
  }
}

export const post = (path, data, options = {}) => {
  const body = JSON.stringify(data);
  return request(path, { ...options, method: "POST", headers: { "Content-Type": "application/json" }, body });
};

export const patch = (path, data) =>
  request(path, { method: "PATCH", headers: { "Content-Type": "application/json" }, body: JSON.stringify(data) });

export const remove = (path) => request(path, { method: "DELETE" });

/** Send a file; `onSent(bytes)` hears how much of it has gone. Fetch does not tell that. */
export function upload(path, query, body, { signal, onSent = () => {} } = {}) {
  const sending = new XMLHttpRequest();
  return new Promise((resolve, reject) => {
    sending.open("POST", `${path}?${new URLSearchParams(query)}`);
    sending.setRequestHeader("Content-Type", "application/octet-stream");
    sending.setRequestHeader("X-Microvib-Key", key());
    sending.upload.onprogress = ({ loaded }) => onSent(loaded);
    sending.onload = () => {
      try {
        resolve(read(sending.status, sending.statusText, sending.responseText, sending.getResponseHeader("microvib-server")));
      } catch (error) {
        reject(error);
      }
    };
    sending.onabort = () => reject(new DOMException("aborted", "AbortError"));
    sending.onerror = () => {
      hearNothing();
      reject(new Silent(NO_ANSWER));
    };
    signal?.addEventListener("abort", () => sending.abort());
    sending.send(body);
  });
}

/** A file of the server as a blob. */
export async function file(path) {
  const answer = await fetch(path, { headers: { "X-Microvib-Key": key() } }).catch(() => {
    hearNothing();
    throw new Silent(NO_ANSWER);
  });
  if (answer.ok) return answer.blob();
  const { error, key: field } = parsed(await answer.text()) ?? {};
  throw new Refused(error ?? `The server answers ${answer.status} ${answer.statusText}.`, field, answer.status);
}

/** Cancel a computation that goes on, forget one that has ended. */
export async function drop(id) {
  whileWanted(id);
  wanted.get(id).abort();
  try {
    return await request(`/api/jobs/${id}`, { method: "DELETE" });
  } catch (error) {
    if (error instanceof Silent) wanted.delete(id); // it may not have been heard
    throw error;
  }
}
