// A job under way: bar, words, cancel.

import { drop, follow } from "./api.js";
import { announce, h, number } from "./dom.js";

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
    const count = total ? `, ${number(done, 3)} of ${number(total, 3)} ${unit ?? ""}` : done ? `, ${done} ${unit ?? ""}` : "";
    words.textContent = state === "queued" ? text || "waits for its turn" : `${text || "working"}${count}`;
  }
}

/** Start a job and show it in `place` until it ends; its result, or null where it failed (which is then said there, at the field it is about). */
export async function work(place, name, begin) {
  let id = null;
  let cancelled = false;
  const row = progressRow(name, () => {
    cancelled = true;
    if (id) drop(id).catch(() => null);
  });
  place.replaceChildren(row.element);
  announce(`${name} …`);
  try {
    ({ id } = await begin());
    if (cancelled) await drop(id);
    const result = await follow(id, row.show);
    place.replaceChildren();
    announce(`${name}: done.`);
    return result;
  } catch (error) {
    place.replaceChildren(
      h("p", { class: cancelled ? "soft" : "error block", role: "alert" }, cancelled ? `${name} was cancelled.` : error.message),
    );
    const field = error.key && place.parentElement.querySelector(`[name="${CSS.escape(error.key)}"]`);
    field?.focus();
    return null;
  }
}
