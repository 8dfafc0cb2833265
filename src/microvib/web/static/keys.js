// Keys that work everywhere on the page, and the list of all of them.

import { $, h } from "./dom.js";
import * as runs from "./runs.js";

const LIST = [
  ["Ctrl + Enter", "run the scenario; Enter does in a field of the form"],
  ["1 … 9", "open a tab; ← and → move between tabs"],
  ["/", "search the parameters"],
  ["Esc", "in a field of the form: back to the base's value"],
  ["[ and ]", "choose the run before, the run after"],
  ["h", "hide the chosen run in the plots, or show it"],
  ["F2", "on a run's name: rename it"],
  ["Delete", "on a run's name: close it"],
  ["c", "on a plot: the next kind of cursor; Esc: none"],
  ["← and →", "on a plot: the cursor to the next point; with Shift to the next peak"],
  ["d", "on a plot: move the other of two cursors"],
  ["+ and −", "on a recording's time history: less or more time; PageUp and PageDown: earlier, later; Home: all"],
  ["?", "this list"],
];

const dialog = h(
  "dialog",
  { class: "keys", "aria-labelledby": "keys-title" },
  h("h2", { id: "keys-title" }, "Keys"),
  h("dl", {}, LIST.map(([key, words]) => h("div", {}, h("dt", {}, key), h("dd", {}, words)))),
  h("form", { method: "dialog", onsubmit: (event) => (event.preventDefault(), dialog.close()) }, h("button", { class: "primary" }, "Close")),
);

export function makeKeys(place) {
  document.body.append(dialog);
  place.append(h("button", { type: "button", class: "quiet", title: "Keys (?)", "aria-label": "List of keys", onclick: () => dialog.showModal() }, "?"));
  document.addEventListener("keydown", press);
}

const types = (target) => target.closest("input, textarea, select, [contenteditable], dialog") !== null;

function press(event) {
  if (event.key === "Enter" && event.ctrlKey) return act(event, () => $("#go").click());
  if (types(event.target) || event.ctrlKey || event.altKey || event.metaKey) return;
  const tab = /^[1-9]$/.test(event.key) && document.querySelectorAll("[role=tab]")[Number(event.key) - 1];
  if (tab) return act(event, () => (tab.click(), tab.focus()));
  const action = { "/": () => $("#search").focus(), "?": () => dialog.showModal(), h: hide, "[": () => step(-1), "]": () => step(1) }[event.key];
  if (action) act(event, action);
  const chip = event.key === "Delete" && event.target.closest(".chip");
  if (chip) act(event, () => chip.querySelector(".close").click());
}

function act(event, action) {
  event.preventDefault();
  action();
}

const hide = () => runs.selected() && runs.toggle(runs.selected());

function step(by) {
  const there = runs.all();
  const next = there[there.indexOf(runs.selected()) + by];
  if (next) runs.choose(next);
}
