// Tables that can be sorted, and whose values can be selected and copied.

import { DASH, h } from "./dom.js";
import { pictureExports, tableExports } from "./downloads.js";
import { onUnits, shownColumn, shownWords } from "./measures.js";

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
  const element = h("table", {}, h("caption", { class: "away" }, caption), h("thead", {}, h("tr", {}, heads)), body);
  return h(
    "div",
    {},
    h("div", { class: "wide", tabindex: "0", role: "region", "aria-label": caption }, element),
    tableExports(element, caption ?? "table"),
  );
}

const ITEMS = {
  text: ({ text, note }) => [h("p", { class: note ? "soft" : null }, text)],
  pairs: ({ rows }) => [h("dl", {}, ...rows.map(([name, words]) => h("div", {}, h("dt", {}, name), h("dd", {}, words))))],
  picture: ({ title, caption, source, points }) => [
    ...picture(source, title, points),
    caption && h("p", { class: "soft" }, caption),
  ],
  table: (item, title) => (item.rows.length ? [textTable(item, title)] : []),
};

/** A picture that the server drew, with the points of its curves where it sent them, and what to take it away as. */
export function picture(source, title, points) {
  const image = h("img", { src: source, alt: title });
  return [h("div", { class: "wide" }, image), pictureExports(image, title || "picture", points)];
}

/** What stands in one part of a study's outcome, as `page_part` gives it. */
export const partContent = ({ title, items }) => items.flatMap((item) => ITEMS[item.kind](item, title)).filter(Boolean);

/** Parts that are not empty, a card each. */
export const partCards = (parts) =>
  parts
    .map((part) => [part.title, partContent(part)])
    .filter(([, content]) => content.length)
    .map(([title, content]) => card(title, "", ...content));

export const card = (title, words, ...content) =>
  h("section", { class: "card" }, h("h2", {}, title), words && h("p", { class: "soft" }, words), ...content);

const MARKS = { pass: "pass", fail: "fail", off: "unclear" };

/** A table whose cells are texts by the columns' keys, with a button for the rows that it leaves out. */
function textTable({ columns, rows, all_rows: all, caption: words }, caption) {
  const place = h("div", {});
  const every = h("button", { type: "button", class: "quiet", onclick: () => show(all) }, `Show all ${all?.length} rows`);
  let shown = rows;
  function show(wanted) {
    shown = wanted;
    const inUnits = columns.map((column) => [column, shownColumn(column)]);
    const texts = (row) => Object.fromEntries(inUnits.map(([{ key }, unit]) => [key, textIn(row[key], unit)]));
    const heads = inUnits.map(([column, unit]) => textColumn(unit ? { ...column, unit: unit.unit } : column));
    const made = table(
      heads,
      shown.map((row) => valuesOf(texts(row))),
      { caption },
    );
    place.replaceChildren(made, ...(all && shown !== all ? [every] : []), ...(words ? [h("p", { class: "soft" }, shownWords(words))] : []));
  }
  show(rows);
  const follows = new WeakRef(place); // a table that is gone follows no more
  onUnits(() => follows.deref()?.isConnected && show(shown));
  return place;
}

/** A cell's number in another unit, with as many digits as it has; words stay. */
function textIn(text, unit) {
  if (!unit || !isNumber(text)) return text;
  const value = unit.of(Number(text));
  if (!Number.isFinite(value)) return DASH;
  if (unit.dB) return value.toFixed(1);
  const digits = Math.max(text.replace(/e.*/, "").replace(/^[-+0.]+/, "").replace(/\D/g, "").length, 1);
  const written = value.toPrecision(digits);
  return (text.startsWith("+") && value >= 0 ? "+" : "") + (/e\+/.test(written) ? String(Number(written)) : written);
}

/** A row of texts; those that are numbers sort as numbers. */
const valuesOf = (texts) => ({
  ...Object.fromEntries(Object.entries(texts).map(([key, text]) => [key, isNumber(text) ? Number(text) : text])),
  texts,
});

/** A column of texts; words of verdicts are coloured by their marks. */
const textColumn = (column) => ({
  ...column,
  show: (value, { texts }) => {
    const text = texts[column.key];
    if (typeof value === "number") return text.replaceAll("-", "−");
    return MARKS[column.marks[text]] ? h("span", { class: MARKS[column.marks[text]] }, text) : text;
  },
});

const isNumber = (text) => text.trim() !== "" && Number.isFinite(Number(text));

// What is not known stands last, whichever way.
function compare(a, b) {
  if (a === null || a === undefined) return 1;
  if (b === null || b === undefined) return -1;
  return typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), undefined, { numeric: true });
}
