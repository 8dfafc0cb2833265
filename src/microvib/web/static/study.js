// A study with a verdict as the server gives it: leading figures and verdict first, its parts, its files.

import * as api from "./api.js";
import { announce, h, save } from "./dom.js";
import { card, partCards, partContent } from "./tables.js";

/** Cards of a study that is done. */
export function studyCards(title, { summary, facts, parts, files, reports }, id) {
  const [first, ...others] = parts;
  return [
    card(title, "", h("p", {}, summary.replaceAll(/(?<=\s)-(?=\d)/g, "−")), factList(facts), ...partContent(first)),
    ...partCards(others),
    card("Download", "", h("div", { class: "bar" }, reports.map((name) => reportButton(id, name)), texts(files))),
  ];
}

/** Leading figures, each with what it is. */
export const factList = (facts) => h("div", { class: "facts" }, facts.map(fact));

const fact = ({ value, label, status }) => h("div", { class: status, title: label }, h("b", {}, value.replaceAll("-", "−")), h("span", {}, label));

const texts = (files) => Object.entries(files).map(([name, text]) => h("button", { type: "button", onclick: () => save(text, name) }, name));

function reportButton(id, name) {
  const take = async () => {
    try {
      save(await api.file(`/api/studies/${id}/files/${name}`), name);
    } catch (error) {
      announce(error.message, { error: true });
    }
  };
  return h("button", { type: "button", onclick: take }, name);
}
