// Tables that can be sorted, and whose values can be selected and copied.

import { DASH, h } from "./dom.js";

const words = ({ title, unit }) => (unit ? `${title} [${unit}]` : title);

/** A table. `columns`: {key, title, unit?, show?, note?}; numbers sort as numbers and stand right. */
export function table(columns, rows, { caption, sort } = {}) {
  const numeric = new Set(columns.filter((c) => rows.some((row) => typeof row[c.key] === "number")).map((c) => c.key));
  const body = h("tbody");
  const order = { key: sort?.key ?? null, down: sort?.down ?? false };
  const heads = columns.map((column) => {
    return h(
      "th",
      { class: numeric.has(column.key) ? "n" : null, scope: "col", title: column.note },
      h("button", { type: "button", onclick: () => by(column.key) }, words(column), h("span", { "aria-hidden": "true", class: "way" })),
    );
  });

  function by(key) {
    order.down = order.key === key ? !order.down : numeric.has(key);
    order.key = key;
    fill();
  }

  function fill() {
    const sorted =
      order.key === null ? rows : [...rows].sort((a, b) => compare(a[order.key], b[order.key]) * (order.down ? -1 : 1));
    body.replaceChildren(
      ...sorted.map((row) =>
        h(
          "tr",
          {},
          columns.map((column) => cell(column, row)),
        ),
      ),
    );
    columns.forEach((column, k) => {
      const way = column.key !== order.key ? "none" : order.down ? "descending" : "ascending";
      heads[k].setAttribute("aria-sort", way);
      heads[k].querySelector(".way").textContent = way === "none" ? "" : order.down ? " ↓" : " ↑";
    });
  }

  function cell(column, row) {
    const value = row[column.key];
    const shown = column.show ? column.show(value, row) : (value ?? DASH);
    return h("td", { class: numeric.has(column.key) ? "n" : null, "data-key": column.key, "data-label": words(column) }, shown);
  }

  fill();
  return h(
    "div",
    { class: "wide", tabindex: "0", role: "region", "aria-label": caption },
    h("table", {}, h("caption", { class: "away" }, caption), h("thead", {}, h("tr", {}, heads)), body),
  );
}

/** What stands in one part of a study's outcome, as `page_answer` gives it. */
export const partContent = ({ title, texts, tables, pictures }) => [
  ...pictures.map(picture),
  ...texts.map((text) => h("p", {}, text)),
  ...tables.filter(({ rows }) => rows.length).map(({ columns, rows }) => textTable(columns, rows, title)),
];

/** Parts that are not empty, a card each. */
export const partCards = (parts) =>
  parts
    .map((part) => [part.title, partContent(part)])
    .filter(([, content]) => content.length)
    .map(([title, content]) => card(title, "", ...content));

export const card = (title, words, ...content) =>
  h("section", { class: "card" }, h("h2", {}, title), words && h("p", { class: "soft" }, words), ...content);

const picture = ({ title, caption, source }) => [
  h("div", { class: "wide" }, h("img", { src: source, alt: title })),
  caption && h("p", { class: "soft" }, caption),
];

/** A table whose cells are texts by the columns' keys; those that are numbers sort as numbers. */
function textTable(columns, rows, caption) {
  const values = rows.map((row) =>
    Object.fromEntries(columns.map(({ key }) => [key, isNumber(row[key]) ? Number(row[key]) : row[key]])),
  );
  const texts = new Map(values.map((value, k) => [value, rows[k]]));
  return table(
    columns.map((column) => ({ ...column, show: (value, row) => minus(value, texts.get(row)[column.key]) })),
    values,
    { caption },
  );
}

const minus = (value, text) => (typeof value === "number" ? text.replaceAll("-", "−") : text);
const isNumber = (text) => text.trim() !== "" && Number.isFinite(Number(text));

/** The rows that matter, with a button that shows all. */
export function shortTable(columns, rows, matters, options) {
  const place = h("div", {});
  const few = rows.filter(matters);
  const all = () => place.replaceChildren(table(columns, rows, options));
  const more =
    few.length < rows.length && h("button", { type: "button", class: "quiet", onclick: all }, `Show all ${rows.length} lines`);
  place.append(table(columns, few, options), more || "");
  return place;
}

// What is not known stands last, whichever way.
function compare(a, b) {
  if (a === null || a === undefined) return 1;
  if (b === null || b === undefined) return -1;
  return typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), undefined, { numeric: true });
}
