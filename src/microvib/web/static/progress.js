// A job under way: bar, words, cancel.

import { drop, remove } from "./api.js";
import { announce, h, number } from "./dom.js";
import { follow } from "./jobs.js";
import { keep, kept } from "./kept.js";

/** What is done of a job: things that are counted as they are, a time to three digits. */
const amount = (value) => (Number.isInteger(value) ? String(value) : number(value, 3));

/** A row with a bar; `show` takes each state of the job. */
export function progressRow(name, cancel) {
  const bar = h("progress", { "aria-label": `Progress of ${name}` });
  const words = h("span", { class: "words soft" }, "starts");
  const element = h(
    "div",
    { class: "job" },
    h("b", {}, name),
    bar,
    words,
    h("button", { type: "button", class: "cancel", "aria-label": `Cancel ${name}`, onclick: cancel }, "Cancel"),
  );
  return { element, show };

  function show({ state, progress }) {
    const { done, total, unit, text } = progress ?? {};
    if (state === "running" && total) Object.assign(bar, { max: total, value: done ?? 0 });
    else bar.removeAttribute("value");
    const count = total ? `, ${amount(done)} of ${amount(total)} ${unit ?? ""}` : done ? `, ${done} ${unit ?? ""}` : "";
    words.textContent = { asked: "asks the server", queued: text || "waits for its turn" }[state] ?? `${text || "working"}${count}`;
  }
}

/**
 * A place for one job at a time: one that the server accepts takes the place of the last, whose end then counts no more. It is
 * found again after a reload. `remedies(sentence, job)` are elements that lead on from an error, or from a job that ended before it was
 * through; `watch(state, job)` hears each state on the way; with `goesOn` a job that is cancelled still counts. `show(result, context, id)` gets what came out, and what `start` was told.
 */
export function makeTask(key, place, show, { remedies = () => [], watch = () => {}, goesOn = false } = {}) {
  const stop = goesOn ? cancel : forget;
  const rows = h("div", { class: "going" });
  const words = h("div", {});
  place.append(rows, words);
  let asked = 0; // how often the server was asked to start one
  let mine = null; // the job that counts

  async function start(name, begin, context = {}) {
    const turn = ++asked;
    const row = addRow(name, () => turn === asked && asked++);
    try {
      const { id } = await begin();
      if (turn !== asked) return forget(id);
      leave();
      await finish({ id, name, context });
    } catch (error) {
      if (turn === asked) refuse(error);
    } finally {
      row.element.remove();
    }
  }

  function addRow(name, cancel) {
    const row = progressRow(name, () => {
      cancel();
      row.element.remove();
      const [best] = /best so far.*/.exec(row.element.querySelector(".words").textContent) ?? []; // which a search would lose otherwise
      say(`${name} was cancelled${best ? `; ${best}` : ""}.`);
    });
    words.replaceChildren();
    rows.append(row.element);
    return row;
  }

  async function finish(job) {
    mine = job;
    keep(key, job);
    rows.replaceChildren();
    const row = addRow(job.name, () => (goesOn ? stop(job.id) : leave()));
    announce(`${job.name} …`);
    const end = await follow(job.id, (state) => (row.show(state), watch(state, job)));
    row.element.remove();
    job.ended = true;
    if (job !== mine) return;
    if (end.state !== "done") {
      say(end.error ?? `${job.name} was cancelled.`, end.state !== "cancelled");
      words.append(...remedies(end.error ?? "", job));
      return;
    }
    announce(`${job.name}: done.`);
    await show(end.result, job.context, job.id);
  }

  /** What is under way, or shown, counts no more; what has ended stays in the library. */
  function leave() {
    if (mine && !mine.ended) stop(mine.id);
    mine = null;
    keep(key, null);
    words.replaceChildren();
  }

  function refuse(error) {
    say(error.message, true);
    words.append(...remedies(error.message));
    const field = error.key && place.parentElement.querySelector(`[name="${CSS.escape(error.key)}"]`);
    field?.focus();
  }

  function say(sentence, wrong = false) {
    words.replaceChildren(h("p", { class: wrong ? "error block" : "soft", role: "alert" }, sentence));
  }

  return {
    start,
    leave,
    isNow: (id) => mine?.id === id,
    /** Show what ended before, {id, name, context}. */
    open: (job) => {
      leave();
      return finish(job);
    },
    /** The job of before a reload. */
    restore: () => kept(key) && finish(kept(key)),
  };
}

const forget = (id) => drop(id).catch(() => null);
/** Stop a job that may be gone on with, of which is asked again. */
const cancel = (id) => remove(`/api/jobs/${id}`).catch(() => null);
