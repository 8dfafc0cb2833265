// The menu of a run's formats of other tools, with their options as the server declares them.

import * as api from "./api.js";
import { announce, h, save } from "./dom.js";

const menus = new WeakMap(); // by result: drawn again, a menu stays as it was left

/** The run in the formats of other tools; what cannot be had says why. */
export function exportMenu(run) {
  if (!menus.has(run.result)) menus.set(run.result, made(run));
  return menus.get(run.result);
}

function made(run) {
  const items = (run.result.exports ?? []).flatMap((target) => itemsOf(run, target));
  return h("details", { class: "menu exports" }, h("summary", { class: "button" }, "Export"), h("div", {}, items));
}

/** Files of a format, and its options beneath them. */
function itemsOf(run, { target, gives, files, missing, options = [] }) {
  const words = (file) => `${target} (${file.slice(target.length)})`;
  if (missing) return files.map((file) => h("span", { class: "none", title: missing }, words(file), h("small", {}, missing)));
  const fields = options.map(fieldOf);
  const address = (file) => {
    const given = fields.map((field) => field.given()).filter(Boolean);
    const search = new URLSearchParams(given.map((text) => ["option", text])).toString();
    return `/api/runs/${run.id}/exports/${file}${search && `?${search}`}`;
  };
  const write = (file) => async (event) => {
    event.preventDefault();
    try {
      save(await api.file(address(file)), file);
    } catch (error) {
      announce(error.message, { error: true });
    }
  };
  const links = files.map((file) => h("a", { href: address(file), download: file, title: gives, onclick: write(file) }, words(file)));
  if (!fields.length) return links;
  const name = `Options of ${target}`;
  const rows = fields.map((field) => field.row);
  return [...links, h("details", { class: "options" }, h("summary", { "aria-label": name }, "options"), h("div", { role: "group", "aria-label": name }, rows))];
}

/** A field of an option: its row, and KEY=VALUE of it where it is not the default. */
function fieldOf(option) {
  const field = (option.kind === "choices" ? boxesOf : inputOf)(option);
  const row = h("div", { class: "option" }, field.control, h("small", {}, option.meaning));
  const given = () => {
    const text = field.text();
    return text && text !== option.default ? `${option.key}=${text}` : null;
  };
  return { row, given };
}

function inputOf({ key, kind, choices, default: usual }) {
  const control =
    kind === "choice"
      ? h("select", { name: key }, choices.map((choice) => h("option", { value: choice, selected: choice === usual }, choice)))
      : h("input", { type: "text", name: key, inputmode: kind === "number" ? "numeric" : null, placeholder: usual || "none" });
  return { control: h("label", {}, h("span", {}, key), control), text: () => control.value.trim() };
}

/** A box for each choice; without any, the default. */
function boxesOf({ key, choices }) {
  const boxes = choices.map((choice) => h("input", { type: "checkbox", name: key, value: choice }));
  const labels = boxes.map((box) => h("label", { class: "check" }, box, box.value));
  const text = () => {
    const chosen = boxes.filter((box) => box.checked).map((box) => box.value);
    return chosen.length ? `[${chosen.join(", ")}]` : "";
  };
  return { control: h("fieldset", {}, h("legend", {}, key), labels), text };
}
