// The Mode shapes tab: modes of the scenario's array, or of its craft with locked hinges, as a list and in motion.

import { post } from "./api.js";
import { announce, h, number } from "./dom.js";
import { addCraft, takeReferenceArray } from "./form.js";
import { keep, kept } from "./kept.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { movingShapes } from "./shapes.js";
import { table } from "./tables.js";

const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("modes", place, show, { remedies: wayOn });

export function makeModes(tab) {
  const button = (of, words) => h("button", { type: "button", onclick: () => find(of) }, words);
  const words =
    "Arrays from finite elements (array.fem) show their mesh; an array of which only mass properties are known moves as a rigid box," +
    " one of which only the drive axis is known as a panel about it.";
  tab.append(
    h(
      "section",
      { class: "card" },
      h("h2", {}, "Mode shapes of the scenario"),
      h("div", { class: "bar" }, button("array", "Array, interface clamped"), button("craft", "Craft, hinges locked")),
      h("p", { class: "soft note" }, words),
      place,
    ),
    result,
  );
  task.restore();
}

/** Shapes of the library. */
export const openModes = ({ id, title, asked }) => task.open({ id, name: title, context: { of: asked.of } });

/** What can be done about a scenario that has no such modes. */
function wayOn(sentence) {
  const button = (words, action, of) => h("button", { type: "button", onclick: () => lead(action, of) }, words);
  if (sentence.startsWith("array.modes"))
    return [
      h(
        "div",
        { class: "bar" },
        button("Give the array one mode at 1 Hz", giveMode, "array"),
        button("Take the reference array, from finite elements", takeReferenceArray, "array"),
      ),
    ];
  if (/^(spacecraft|array):/.test(sentence))
    return [h("div", { class: "bar" }, button("Put the reference array, from finite elements, on an example craft", craftWithArray, "craft"))];
  return [];
}

/** Half of the array's inertia behind a mode. */
function giveMode() {
  const [, inertia, unit] = /^(\S+) (.*)$/.exec(scenario.checked().values["array.inertia"] ?? "") ?? [];
  const modes = `[{frequency: 1 Hz, damping: 0.5 percent, effective_inertia: ${Number((inertia / 2).toPrecision(4))} ${unit}}]`;
  return scenario.changeAll({ "array.rigid_inertia": "", "array.modes": modes });
}

async function craftWithArray() {
  await takeReferenceArray();
  await addCraft();
}

/** Change the scenario, and ask again. */
async function lead(action, of) {
  try {
    await action();
    announce("The form has it; Undo all takes it back.");
    await find(of);
  } catch (error) {
    announce(error.message, { error: true });
  }
}

const find = (of) => task.start("Mode shapes", () => post("/api/shapes", { scenario: scenario.current(), of }), { of });

function show({ header, rows, words, moving }, { of }, id) {
  const { element, choose } = movingShapes(moving);
  const buttons = rows.map((_, k) =>
    h("button", { type: "button", class: "quiet", "aria-label": `Show mode ${k + 1}`, onclick: () => pick(k) }, `mode ${k + 1}`),
  );
  const columns = header.map((title) => ({ key: title, title, show: (value) => (typeof value === "number" ? number(value, 4) : value) }));
  const list = rows.map((row, k) => ({ mode: k + 1, ...Object.fromEntries(header.map((title, c) => [title, row[c]])) }));

  function pick(k) {
    buttons.forEach((button, j) => button.setAttribute("aria-pressed", String(j === k)));
    keep("modes.shown", { id, k });
    choose(k);
  }

  const title = of === "craft" ? "Modes of the craft, hinges locked" : "Modes of the array, interface clamped";
  result.replaceChildren(
    h("section", { class: "card" }, h("h2", {}, title), element),
    h(
      "section",
      { class: "card" },
      table([{ key: "mode", title: "mode", show: (mode) => buttons[mode - 1] }, ...columns], list, { caption: "Modes" }),
      h("p", { class: "soft note" }, words),
    ),
  );
  const last = kept("modes.shown");
  pick(last?.id === id && last.k < rows.length ? last.k : 0);
}
