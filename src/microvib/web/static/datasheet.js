// The Data sheet tab: what a data sheet says becomes the scenario; what it does not say is assumed, and ranked by what it does.

import { get, post } from "./api.js";
import { announce, debounce, h, save } from "./dom.js";
import { keepFields } from "./kept.js";
import { latest } from "./latest.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { partContent, table } from "./tables.js";

const DELAY = 250;
const rows = new Map(); // of the entries: {input, error}
const asking = latest();
const rest = h("p", { class: "error", role: "alert" });
const assumed = h("div", {});
const place = h("div", {});
const ranking = h("div", {});
const task = makeTask("ranking", place, (found) => ranking.replaceChildren(...ranked(found)));

export async function makeSheet(tab) {
  const fields = await get("/api/datasheet");
  const form = h("form", { class: "sheet", autocomplete: "off", novalidate: true, onsubmit: use }, fields.map(entry));
  form.append(
    h(
      "div",
      { class: "ask" },
      h("button", { class: "primary" }, "Use as the scenario"),
      h("button", { type: "button", onclick: download }, "Download (YAML)"),
      h("button", { type: "button", onclick: empty }, "Empty all"),
    ),
  );
  const why = "Each value of the scenario on the left whose source notes a range is moved through that range, with the others unchanged.";
  tab.append(
    card("What the data sheet says", "Leave empty what it does not say.", form, rest),
    card("What is assumed", "Typical values with their ranges, not measurements; friction, array and tracking are examples.", assumed),
    card("Which assumed value matters most", why, h("button", { type: "button", onclick: rank }, "Rank"), place, ranking),
  );
  keepFields("sheet", Object.fromEntries([...rows].map(([key, { input }]) => [key, input])));
  const soon = debounce(check, DELAY);
  form.addEventListener("input", soon);
  task.restore();
  check();
}

/** A ranking of the library. */
export const openRanking = ({ id, title }) => task.open({ id, name: title });

const card = (title, words, ...content) =>
  h("section", { class: "card" }, h("h2", {}, title), h("p", { class: "soft" }, words), ...content);

function entry({ key, meaning, example, unit, range, choices }) {
  const id = `sheet-${key}`;
  const facts = [range && `${range}.`, unit && `Unit: ${unit}, or a compatible one.`].filter(Boolean).join(" ");
  const common = { id, name: key, title: facts, "aria-describedby": `${id}-error` };
  const input = choices
    ? h("select", common, ["", ...choices].map((choice) => h("option", { value: choice }, choice || "not stated")))
    : h("input", { ...common, type: "text", spellcheck: "false", placeholder: example && `e.g. ${example}` });
  const error = h("p", { class: "error", id: `${id}-error`, role: "alert" });
  rows.set(key, { input, error });
  return h("div", { class: "field" }, h("label", { for: id }, meaning), input, error);
}

const entries = () =>
  Object.fromEntries([...rows].map(([key, { input }]) => [key, input.value.trim()]).filter(([, text]) => text));

const question = (signal) => post("/api/datasheet", { entries: entries() }, { signal });
const fail = (error) => (rest.textContent = error.message);

/** Show what is assumed, or what is wrong with what is typed. */
const check = () => asking(question, show).catch(fail);

function show(answer) {
  const wrong = new Map(answer.errors.map(({ key, error }) => [key, error]));
  for (const [key, { input, error }] of rows) {
    input.setAttribute("aria-invalid", String(wrong.has(key)));
    error.textContent = wrong.get(key) ?? "";
    wrong.delete(key);
  }
  rest.textContent = [...wrong.values()].join(" ");
  assumed.hidden = answer.errors.length > 0;
  assumed.replaceChildren(
    answer.assumed.length
      ? table(
          [
            { key: "key", title: "value" },
            { key: "value", title: "assumed" },
            { key: "why", title: "why, and range" },
          ],
          answer.assumed,
          { caption: "Assumed values" },
        )
      : h("p", {}, "The data sheet defines the drive completely; nothing is assumed."),
  );
}

/** Do something with the file of what is typed at the click; where it is wrong, the first wrong entry has the focus. */
async function withFile(action) {
  try {
    const answer = await question();
    show(answer);
    if (answer.text) await action(answer.text);
    else [...rows.values()].find(({ input }) => input.getAttribute("aria-invalid") === "true")?.input.focus();
  } catch (error) {
    fail(error);
  }
}

function use(event) {
  event.preventDefault();
  return withFile(async (text) => {
    await scenario.startFrom({ text });
    announce("The data sheet is the scenario now; Run simulates it.");
  });
}

const download = () => withFile((text) => save(text, "my-drive.yaml"));

function empty() {
  for (const { input } of rows.values()) input.value = "";
  rows.values().next().value.input.dispatchEvent(new Event("input", { bubbles: true }));
}

const rank = () => task.start("Ranking", () => post("/api/sensitivity", { scenario: scenario.current() }));

/** What each line depends on most, the effects on each, the largest line's open, and what was not ranked. */
function ranked({ parts: [first, ...others] }) {
  const each = others.map((part, k) => h("details", { open: k === 0 }, h("summary", {}, part.title), ...partContent(part)));
  return [...partContent(first), ...each];
}
