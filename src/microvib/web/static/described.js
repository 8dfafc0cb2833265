// A description that is typed, pasted or read from a file of the browser's machine, and tables that it names.

import { announce, h } from "./dom.js";
import { keep, kept } from "./kept.js";

/** A field for a text with a button that fills it from a file; `input` is the field. */
export function describedField(id, words, { placeholder = "", rows = 7, accept = "", title = "" } = {}) {
  const input = h("textarea", { id, name: id.replace(/^.*-/, ""), rows, placeholder, title, spellcheck: "false" });
  const file = h("input", { type: "file", id: `${id}-file`, class: "away", accept });
  file.addEventListener("change", () => fill(input, file));
  const choose = h("label", { class: "button", title: `Fill this field from a file: ${words}` }, "Choose a file…", file);
  return { input, element: h("div", { class: "described" }, h("label", { for: id }, words), choose, input) };
}

async function fill(input, file) {
  const [chosen] = file.files;
  file.value = "";
  if (!chosen) return;
  input.value = await chosen.text();
  input.dispatchEvent(new Event("input", { bubbles: true }));
  announce(`${chosen.name} is in the field.`);
}

/** A list of tables that were chosen, each with a button that takes it away; `texts()` are their contents by name, `add(name, text)` puts one there. */
export function sentTables(key, id, words) {
  const list = h("ul", { class: "sent", "aria-label": "Tables that were chosen" });
  const file = h("input", { type: "file", id, name: "tables", class: "away", accept: ".csv,.txt,text/csv", multiple: true });
  let tables = kept(key, {});
  file.addEventListener("change", async () => {
    const chosen = [...file.files];
    file.value = "";
    const texts = await Promise.all(chosen.map((one) => one.text()));
    set({ ...tables, ...Object.fromEntries(chosen.map(({ name }, k) => [name, texts[k]])) });
  });
  const choose = h("label", { class: "button" }, "Choose tables…", file);
  show();
  return { texts: () => tables, add: (name, text) => set({ ...tables, [name]: text }), element: h("div", { class: "described" }, h("span", {}, words), choose, list) };

  function set(next) {
    tables = next;
    if (!keep(key, tables)) announce("The tables are too large to be kept over a reload.");
    show();
  }

  function show() {
    const names = Object.keys(tables);
    list.hidden = !names.length;
    list.replaceChildren(...names.map((name) => h("li", {}, name, h("button", { type: "button", class: "quiet", "aria-label": `Leave ${name} out`, onclick: () => leave(name) }, "×"))));
  }

  function leave(name) {
    set(Object.fromEntries(Object.entries(tables).filter(([other]) => other !== name)));
    file.focus();
  }
}
