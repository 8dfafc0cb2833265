// The limit that lines are held against, and what the server says of the chosen run.

import { h } from "./dom.js";
import { keepFields } from "./kept.js";
import { latest } from "./latest.js";
import * as runs from "./runs.js";

const limit = h("textarea", {
  id: "limit",
  rows: 1,
  placeholder: "such as 30 mN*m",
  title: "A torque, or the lines of a table of a limit over frequency (CSV), pasted",
  spellcheck: "false",
  oninput: () => fit(),
  onkeydown: (event) => {
    if (event.key !== "Enter" || event.shiftKey || limit.value.includes("\n")) return;
    event.preventDefault();
    update();
  },
});
const band = h("input", { type: "text", id: "limit-band", placeholder: "all frequencies", spellcheck: "false" });
const words = h("output", { for: "limit limit-band", class: "verdict" });
const gaps = h("details", { class: "gaps soft", hidden: true });
export const KINDS = { pass: "pass", fail: "fail", "not judged": "unclear" };
const ROWS = 4; // of a table that are seen at once
const asking = latest();
const listeners = new Set();
let found = null; // {run, verdict}

export const bar = h(
  "form",
  { class: "limit", onsubmit: (event) => event.preventDefault() },
  h("label", { for: "limit" }, "Limit of a line"),
  limit,
  h("label", { for: "limit-band" }, "in band"),
  band,
  words,
  gaps,
);

/** As many rows as a table has, up to some. */
function fit() {
  limit.rows = Math.min(limit.value.trim().split("\n").length, ROWS);
  limit.scrollTop = 0;
}

/** The query that says which limit holds; nothing where there is none. */
export const query = () => ({ limit: limit.value.trim() || undefined, band: band.value.trim() || undefined });

/** What was said of a run against the limit as it is now; null where nothing was. */
export const verdictOf = (run) => (found?.run === run ? found.verdict : null);

export function makeLimit(listener) {
  listeners.add(listener);
  keepFields("limit", { limit, band });
  fit();
  for (const input of [limit, band]) input.addEventListener("change", update);
}

/** Ask what the chosen run's lines are against the limit; listeners hear when that has changed. */
export async function update() {
  const run = runs.selected();
  bar.hidden = !run?.result;
  if (run?.state !== "done" || !query().limit) {
    asking.forget();
    return say(null, run?.state === "done" ? "Enter a limit: its verdict then appears here and in the report." : "");
  }
  try {
    await asking(
      (signal) => runs.ask(run, "verdict", query(), { signal }),
      (verdict) => say({ run, verdict }, verdict.text, KINDS[verdict.verdict]),
    );
  } catch (error) {
    say(null, error.message, "error");
  }
}

function say(next, text, kind = "soft") {
  const changed = JSON.stringify(next?.verdict) !== JSON.stringify(found?.verdict) || next?.run !== found?.run;
  found = next;
  const [head, ...rest] = text.replaceAll(/(?<=\s)-(?=\d)/g, "−").split(" Not judged: ");
  words.replaceChildren(head);
  gaps.hidden = !rest.length;
  gaps.replaceChildren(
    h("summary", {}, `Not judged: ${next?.verdict.gaps.length}`),
    h("ul", {}, ...(next?.verdict.gaps ?? []).map((gap) => h("li", {}, gap))),
  );
  words.className = `verdict ${kind}`;
  if (changed) listeners.forEach((listener) => listener());
}
