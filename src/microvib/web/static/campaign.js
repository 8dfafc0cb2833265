// The Campaign tab: what varies and how, the cases as they are computed, percentiles, worst cases, and any parameter over any line.

import * as api from "./api.js";
import { announce, DASH, h, number, save } from "./dom.js";
import { keep, keepFields, kept } from "./kept.js";
import { amplitudeAxis, onUnits, shown } from "./measures.js";
import { draw, ink } from "./plots.js";
import { makeTask } from "./progress.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import { LIMIT } from "./styles.js";
import { card, partCards, partContent, table } from "./tables.js";

const ROWS = "campaign.vary";
const LARGEST = "any line";
const CASES = "#0072B2";
const CHOSEN = "#D55E00";
const SO_FAR_EVERY = 2000; // ms between two looks at what is known so far
const FILES = ["study.yaml", "scenario.yaml", "results.nc", "report.html", "report.pdf"];

/** Sorts of variation: their fields as a study file has them, with what stands in them at first. */
const SORTS = {
  normal: { words: "normal", fields: [["mean", "mean", (value) => value], ["relative_deviation", "deviation", () => "3 percent"]] },
  uniform: { words: "uniform", fields: [["low", "from", (value) => scaled(value, 0.95)], ["high", "to", (value) => scaled(value, 1.05)]] },
  triangular: {
    words: "triangular",
    fields: [["low", "from", (value) => scaled(value, 0.95)], ["peak", "peak", (value) => value], ["high", "to", (value) => scaled(value, 1.05)]],
  },
  "log-normal": { words: "log-normal", fields: [["median", "median", (value) => value], ["factor", "factor", () => "1.2"]] },
  grid: {
    words: "levels from, to",
    fields: [["from", "from", (value) => scaled(value, 0.9)], ["to", "to", (value) => scaled(value, 1.1)], ["count", "levels", () => "5"]],
  },
  list: { words: "list of levels", fields: [["list", "values", (value) => value]] },
};
const METHODS = [
  ["sobol", "Sobol points"],
  ["latin-hypercube", "Latin hypercube"],
  ["random", "random"],
  ["one-at-a-time", "one at a time"],
  ["sobol-indices", "Sobol indices"],
];

const select = (id, options) => h("select", { id: `campaign-${id}`, name: id }, options.map(([value, words]) => h("option", { value }, words)));
const text = (id, value, more = {}) => h("input", { type: "text", id: `campaign-${id}`, name: id, value, spellcheck: "false", ...more });
const inputs = {
  method: select("method", METHODS),
  count: text("count", "80", { class: "short", inputmode: "numeric" }),
  seed: text("seed", "1", { class: "short", inputmode: "numeric" }),
  noise: select("noise", [["one", "one draw"], ["each", "a draw each"]]),
  solve: select("solve", [["steady", "steady state"], ["record", "record in time"]]),
  limit: h("textarea", { id: "campaign-limit", name: "limit", rows: 1, placeholder: "such as 30 mN*m", spellcheck: "false", title: "A torque, or the lines of a table of a limit over frequency (CSV), pasted" }),
  band: text("band", "", { placeholder: "all frequencies" }),
};
const LABELS = {
  method: ["cases", "How the distributions are sampled"],
  count: ["number", "Points of the sample; 72 or more bound a 95 % percentile, 368 or more one of 99 %"],
  seed: ["seed", "The same seed gives the same cases"],
  noise: ["noise", "Draws of the friction's noise"],
  solve: ["study", "Each case in its steady state, or settled and recorded in time"],
  limit: ["limit of a line", "Cases above it are counted"],
  band: ["in band", "Lines outside of it are not counted"],
};
const rows = h("div", { class: "vary", role: "group", "aria-label": "What varies" });
const add = h("button", { type: "button", onclick: () => addRow() }, "Vary another");
const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("campaign", place, show, { remedies: goOn, watch, goesOn: true });
let looked = 0; // when what is known so far was asked for last

export function makeCampaign(tab) {
  const fields = Object.entries(inputs).map(([key, input]) => h("label", { title: LABELS[key][1] }, LABELS[key][0], input));
  const ask = h("form", { onsubmit: begin }, rows, h("div", { class: "ask" }, add, fields, h("button", { class: "primary" }, "Start")));
  const words =
    "Many cases of the scenario, whose values are drawn: percentiles of the lines with their confidence, worst cases, and what they depend on. The spread is assumed. A campaign can be stopped and gone on with.";
  tab.append(h("section", { class: "card" }, h("h2", {}, "Campaign"), h("p", { class: "soft" }, words), ask, place), result);
  keepFields("campaign.asked", inputs);
  for (const row of kept(ROWS, [])) addRow(row);
  if (!rows.children.length) addRow({ key: "motor.torque_constant" });
  rows.addEventListener("input", storeRows);
  scenario.onCheck(fillKeys);
  fillKeys();
  task.restore();
}

/** A campaign of the library, whole or not. */
export const openCampaign = ({ id, title, asked }) => task.open({ id, name: title, context: { scenario: asked.scenario } });

// ---- What varies ----

/** Values of the form that can vary. */
function keysOf() {
  const { values } = scenario.checked();
  const varies = (key) => values[key] && ["quantity", "count"].includes(scenario.fieldOf(key)?.kind) && !/^(solver|record)\./.test(key);
  return Object.keys(values).filter(varies);
}

const valueOf = (key) => scenario.current().changes[key] ?? scenario.checked().values[key] ?? "";

function scaled(value, factor) {
  const [, figure, unit] = /^\s*([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(.*)$/i.exec(value) ?? [];
  return figure === undefined ? value : `${Number((factor * Number(figure)).toPrecision(5))} ${unit}`.trim();
}

function addRow({ key = "motor.current", sort = "normal", given = {} } = {}) {
  const keys = h("select", { "aria-label": "Parameter", name: "vary", onchange: () => fill({}) }, h("option", { value: key }, key));
  const sorts = h("select", { "aria-label": "Distribution or levels", onchange: () => fill({}) }, Object.entries(SORTS).map(([name, { words }]) => h("option", { value: name }, words)));
  const fields = h("span", { class: "fields" });
  const out = h("button", { type: "button", class: "quiet", "aria-label": "Leave out", onclick: () => (row.remove(), storeRows()) }, "×");
  const row = h("div", { class: "varied" }, keys, sorts, fields, out);
  sorts.value = sort;
  rows.append(row);
  fill(given);
  fillKeys();

  function fill(known) {
    const value = valueOf(keys.value);
    const input = ([name, words, first]) =>
      h("label", {}, words, " ", h("input", { type: "text", name, value: known[name] ?? first(value), spellcheck: "false", "data-first": first(value) }));
    fields.replaceChildren(...SORTS[sorts.value].fields.map(input));
    storeRows();
  }
}

function partsOf(row) {
  const [keys, sorts] = row.querySelectorAll("select");
  const given = Object.fromEntries([...row.querySelectorAll("input")].map((input) => [input.name, input.value.trim()]));
  return { key: keys.value, sort: sorts.value, given };
}

const storeRows = () => keep(ROWS, [...rows.children].map(partsOf));

/** The form's quantities as what may vary; a row keeps its own. What was not typed over follows the form. */
function fillKeys() {
  const keys = keysOf();
  for (const row of rows.children) {
    const choice = row.querySelector("select");
    const own = choice.value;
    const wanted = keys.includes(own) ? keys : [own, ...keys];
    if ([...choice.options].map(({ value }) => value).join() !== wanted.join()) choice.replaceChildren(...wanted.map((key) => h("option", { value: key }, key)));
    choice.value = own;
    const { sort } = partsOf(row);
    for (const input of row.querySelectorAll("input")) {
      const first = SORTS[sort].fields.find(([name]) => name === input.name)[2](valueOf(own));
      if (input.value === input.dataset.first && input !== document.activeElement) input.value = first;
      input.dataset.first = first;
    }
  }
}

function spec({ sort, given }) {
  if (sort === "list") return given.list.split(/\s*[,;]\s*/).filter(Boolean);
  return sort === "grid" ? given : { distribution: sort, ...given };
}

// ---- Start, watch, go on ----

async function begin(event) {
  event.preventDefault();
  const varied = [...rows.children].map(partsOf);
  const twice = varied.find(({ key }, k) => varied.findIndex((other) => other.key === key) !== k);
  if (twice) return announce(`${twice.key} varies twice; one row is expected.`, { error: true });
  const value = (key) => inputs[key].value.trim();
  const body = {
    scenario: scenario.current(),
    vary: Object.fromEntries(varied.map((one) => [one.key, spec(one)])),
    method: value("method"),
    count: Number(value("count")),
    seed: Number(value("seed")),
    noise: value("noise"),
    solve: value("solve"),
    limit: value("limit") || undefined,
    band: value("band") || undefined,
  };
  result.replaceChildren();
  await task.start("Campaign", () => api.post("/api/campaigns", body), { scenario: body.scenario });
}

/** What is known so far, while it is computed. */
async function watch(job, { id, context }) {
  const now = Date.now();
  if (job.state !== "running" || now - looked < SO_FAR_EVERY || result.contains(document.activeElement)) return;
  looked = now;
  const found = await api.get(`/api/campaigns/${id}/so-far`).catch(() => null);
  if (found?.cases && task.isNow(id) && !shownWhole(id)) await show(found, context, id);
}

const shownWhole = (id) => result.dataset.whole === id;

/** A campaign that has ended before it was through: what is known, and a way on. */
function goOn(sentence, { id, name, context } = {}) {
  if (!id) return [];
  api
    .get(`/api/campaigns/${id}/so-far`)
    .then((found) => found.cases && show(found, context, id))
    .catch(() => null);
  const resume = () => task.start(name, () => api.post(`/api/campaigns/${id}/resume`, {}), context);
  return [h("button", { type: "button", class: "primary", onclick: resume }, "Go on")];
}

// ---- What came out ----

let now = null; // {found, context, id, view}
onUnits(() => now && show(now.found, now.context, now.id));

async function show(found, context, id) {
  const before = now?.id === id ? now.view : null;
  const whole = found.computed === found.cases && found.parts.some(({ items }) => items.some(({ kind }) => kind === "picture"));
  result.dataset.whole = whole ? id : "";
  const view = before ?? { x: found.scatter.keys[0]?.key, line: LARGEST, case: found.worst[0]?.case ?? null };
  now = { found, context, id, view };
  const [first, ...others] = found.parts;
  const { element, update } = scatter(found, view, context, id);
  result.replaceChildren(
    card("Lines over all cases", found.summary, verdictFacts(found), percentiles(found), ...partContent(first)),
    element,
    card("Worst cases", "By the largest line, or against a curve by the smallest margin, the worst first. A case opens as a run, or goes into the form.", worst(found, view, update, context, id)),
    ...partCards(others),
    card("Download", whole ? "" : "What is computed so far.", downloads(found, id)),
  );
  await update();
}

const VERDICTS = { pass: "pass", fail: "fail", "not judged": "unclear" };

function verdictFacts({ verdict, facts }) {
  const fact = ({ value, label, status }) => h("div", { class: status, title: label }, h("b", {}, value.replaceAll("-", "−")), h("span", {}, label));
  const first = verdict ? [h("div", { class: VERDICTS[verdict] }, h("b", {}, verdict), h("span", {}, "against the limit"))] : [];
  return h("div", { class: "facts" }, first, facts.map(fact));
}

/** Percentiles of the largest line with their 95 % confidence, level by level. */
function percentiles(found) {
  const figure = (value) => (value === null ? DASH : shown(value, "N*m", 4));
  const span = ({ low, high, why }) => (low === null ? why : `${figure(low)} to ${figure(high)}`);
  const columns = [
    ...(found.percentiles.some(({ level }) => level) ? [{ key: "level", title: "level" }] : []),
    { key: "draws", title: "draws" },
    ...["median", "P95", "P99"].flatMap((name) => [
      { key: name, title: name, show: figure },
      { key: `${name}_span`, title: "95 % confidence" },
    ]),
    { key: "largest", title: "largest", show: figure },
    { key: "case", title: "case" },
  ];
  const cells = found.percentiles.map(({ median, p95, p99, largest, ...row }) => ({
    ...row,
    largest,
    ...Object.fromEntries([["median", median], ["P95", p95], ["P99", p99]].flatMap(([name, x]) => [[name, x.value], [`${name}_span`, span(x)]])),
  }));
  return table(columns, cells, { caption: "Percentiles of the largest line" });
}

function worst(found, view, update, context, id) {
  const keys = found.scatter.keys.map(({ key }) => key);
  const button = (words, action) => h("button", { type: "button", onclick: () => action().catch((error) => announce(error.message, { error: true })) }, words);
  const columns = [
    { key: "case", title: "case" },
    { key: "amplitude", title: "largest line", show: (value) => shown(value, "N*m", 4) },
    ...keys.map((key) => ({ key, title: key })),
    {
      key: "open",
      title: "open",
      show: (_, row) => [
        button("Lines", () => choose(view, row.case, update)),
        " ",
        button("Run", () => runCase(id, row.case, context)),
        " ",
        button("Into the form", () => takeCase(id, row.case, context)),
      ],
    },
  ];
  const cells = found.worst.map(({ labels, ...row }) => ({ ...row, ...labels, open: null }));
  return table(columns, cells, { caption: "Worst cases" });
}

const choose = async (view, number, update) => {
  view.case = number;
  await update();
  document.getElementById("campaign-scatter").closest(".card").scrollIntoView({ block: "nearest" });
};

async function changed(id, number, of) {
  const { changes, steady } = await api.get(`/api/campaigns/${id}/cases/${number}`);
  return { what: { ...of.scenario, changes: { ...of.scenario.changes, ...changes } }, steady };
}

async function runCase(id, number, of) {
  const { what, steady } = await changed(id, number, of);
  document.getElementById("tab-run").click();
  await runs.start({ scenario: what, name: `case ${number}`, steady, seeds: null });
}

async function takeCase(id, number, of) {
  const { what } = await changed(id, number, of);
  await scenario.startFrom(what);
  announce(`Case ${number} is in the form.`);
}

// ---- Any parameter over any line, and the lines of a case ----

function scatter({ scatter: data, limit, cases }, view, context, id) {
  const lines = data.lines.map(({ line }) => line).filter((name) => !name.startsWith("other_"));
  const xs = h("select", { id: "campaign-x", "aria-label": "Parameter", onchange: () => ((view.x = xs.value), update()) }, data.keys.map(({ key }) => h("option", { value: key }, key)));
  const ys = h("select", { id: "campaign-y", "aria-label": "Line", onchange: () => ((view.line = ys.value), update()) }, [LARGEST, ...lines].map((line) => h("option", { value: line }, line)));
  const plot = h("div", { class: "plot", id: "campaign-scatter", role: "img", "aria-label": "Cases: a line over a parameter" });
  const stems = h("div", { class: "plot", id: "campaign-lines", role: "img", "aria-label": "Lines of the chosen case" });
  const numbers = h("input", { type: "number", id: "campaign-case", min: 0, max: cases - 1, onchange: () => ((view.case = Number(numbers.value)), update()) });
  const said = h("span", { class: "soft", role: "status" });
  const ask = (action) => () => action(id, view.case, context).catch((error) => announce(error.message, { error: true }));
  const element = h(
    "section",
    { class: "card" },
    h("div", { class: "bar" }, h("h2", {}, "Cases"), h("label", {}, "line ", ys), h("label", {}, "over ", xs)),
    h("p", { class: "soft note" }, "A point is a case; a click on it shows its lines below."),
    plot,
    h(
      "div",
      { class: "bar" },
      h("h2", {}, "Lines of case"),
      numbers,
      h("button", { type: "button", onclick: ask(runCase) }, "Run"),
      h("button", { type: "button", onclick: ask(takeCase) }, "Into the form"),
      said,
    ),
    stems,
  );
  let heard = false;
  return { element, update };

  async function update() {
    const known = data.keys.find(({ key }) => key === view.x) ?? data.keys[0];
    xs.value = known?.key ?? "";
    ys.value = view.line = [LARGEST, ...lines].includes(view.line) ? view.line : LARGEST;
    numbers.value = view.case ?? "";
    said.textContent = data.keys.map(({ key, unit, values }) => `${key} ${valueText(values[view.case], unit)}`).join(", ") + reason();
    await drawScatter(plot, data, known, view, limit);
    await drawLines(stems, data, view);
    if (!heard) plot.on("plotly_click", ({ points: [point] }) => point.customdata !== undefined && ((view.case = point.customdata), update()));
    heard = true;
  }

  function reason() {
    const why = data.reasons[view.case];
    return why ? `; failed: ${why}` : "";
  }
}

const valueText = (value, unit) => (typeof value === "number" ? `${number(value, 5)} ${unit}`.trim() : (value ?? DASH));

function drawScatter(plot, data, known, view, limit) {
  const axis = amplitudeAxis("N*m");
  const values = view.line === LARGEST ? data.largest : data.lines.find(({ line }) => line === view.line).amplitude;
  const there = [...values.keys()].filter((k) => values[k] !== null && (!axis.dB || values[k] > 0));
  const points = (these, look) => ({
    x: these.map((k) => known?.values[k] ?? k),
    y: these.map((k) => axis.y(values[k])),
    customdata: these,
    mode: "markers",
    hovertemplate: `case %{customdata}<br>%{x}${known?.unit ? ` ${known.unit}` : ""}<br>%{y:.4g} ${axis.printed}<extra></extra>`,
    ...look,
  });
  const bound = view.line === LARGEST && limit !== null ? [limit] : [];
  return draw(
    plot,
    [
      points(there, { name: "cases", marker: { color: CASES, size: 6, opacity: 0.75 } }),
      points(there.filter((k) => k === view.case), { name: `case ${view.case}`, marker: { color: CHOSEN, size: 12, symbol: "circle-open", line: { width: 2.5 } } }),
    ],
    {
      xaxis: { title: { text: known ? `${known.key}${known.unit ? ` [${known.unit}]` : ""}` : "case" } },
      yaxis: { title: { text: `${view.line} [${axis.printed}], ${axis.words}` } },
      showlegend: false,
      shapes: bound.map((y) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: axis.y(y), y1: axis.y(y), line: { color: LIMIT, width: 2 } })),
    },
  );
}

/** Lines of the chosen case as stems, over the range of each line in all cases. */
function drawLines(plot, data, view) {
  const axis = amplitudeAxis("N*m");
  const top = Math.max(1e-12, ...data.largest.filter((value) => value !== null));
  const low = axis.y(top * 1e-4);
  const own = data.lines.map(({ line, frequency, amplitude }) => ({ line, f: frequency[view.case], a: amplitude[view.case] })).filter(({ f, a }) => f !== null && a > top * 1e-4);
  const all = data.lines.flatMap(({ line, frequency, amplitude }) => amplitude.map((a, k) => ({ line, f: frequency[k], a, k }))).filter(({ f, a, k }) => f !== null && a > top * 1e-4 && k !== view.case);
  return draw(
    plot,
    [
      { name: "other cases", x: all.map(({ f }) => f), y: all.map(({ a }) => axis.y(a)), customdata: all.map(({ k }) => k), mode: "markers", marker: { color: ink(), size: 3, opacity: 0.18 }, hoverinfo: "skip" },
      {
        name: `case ${view.case}`,
        x: own.flatMap(({ f }) => [f, f, null]),
        y: own.flatMap(({ a }) => [low, axis.y(a), null]),
        text: own.flatMap(({ line, a }) => [line, `${line}, ${shown(a, "N*m", 4)}`, ""]),
        mode: "lines+markers",
        line: { color: CHOSEN, width: 1.6 },
        marker: { color: CHOSEN, size: own.flatMap(() => [0, 5, 0]) },
        hovertemplate: "%{text}<br>%{x:.5g} Hz<extra></extra>",
      },
    ],
    {
      xaxis: { title: { text: "frequency [Hz]" }, rangemode: "tozero" },
      yaxis: { title: { text: `amplitude [${axis.printed}], ${axis.words}` }, ...(axis.dB ? {} : { type: "log", dtick: 1 }), range: axis.dB ? [low, axis.y(top) + 10] : [Math.log10(low), Math.log10(axis.y(top)) + 0.4] },
      showlegend: true,
    },
  );
}

function downloads({ files }, id) {
  const texts = Object.entries(files).map(([name, content]) => h("button", { type: "button", onclick: () => save(content, name) }, name));
  const others = FILES.map((name) => {
    const take = async () => {
      try {
        save(await api.file(`/api/campaigns/${id}/files/${name}`), name);
      } catch (error) {
        announce(error.message, { error: true });
      }
    };
    return h("button", { type: "button", onclick: take }, name);
  });
  return h("div", { class: "bar" }, others, texts);
}
