// How a recording is processed: which section, which averages, beside which background, in which bands, against which limit. The fields are those of
// `microvib analyse`, and so are the refusals.

import { describedField } from "./described.js";
import { h } from "./dom.js";
import { keepFields } from "./kept.js";

const AVERAGES = { none: "one spectrum of all samples", linear: "linear averages", "peak-hold": "peak hold", exponential: "exponential averages" };
const WINDOWS = { hann: "Hann", "flat-top": "flat-top", rectangular: "rectangular" };
const LIMIT = "60 mN*m";
const BANDS = "low_hz,high_hz,limit_mn_m\n2,20,15\n20,80,70";

const text = (name, placeholder, title) => h("input", { type: "text", name, class: "short", id: `processing-${name}`, placeholder, title, spellcheck: "false" });
const choice = (name, words) => h("select", { name, id: `processing-${name}` }, Object.entries(words).map(([value, label]) => h("option", { value }, label)));
const labelled = (words, field) => h("label", {}, words, field);

/** The form; `onSection([from, to])` hears which part of the record it states [s], null for what it does not. */
export function makeProcessing(onSection) {
  const limit = describedField("processing-limit", "a torque, or a curve over frequency (CSV)", { rows: 3, placeholder: LIMIT, accept: ".csv,.txt,text/csv" });
  const fields = {
    from: text("from", "start"),
    to: text("to", "end"),
    trigger: h("input", { type: "text", name: "trigger", id: "processing-trigger", placeholder: "Mz > 5 mN*m", spellcheck: "false", title: "The section begins where the channel first rises (>) or falls (<) through the level" }),
    pre_trigger: text("pre_trigger", "0 s"),
    unit: text("unit", "as read", "Unit of the channel where the file has none, or has another: mN*m, or 20 N*m for full scale"),
    window: choice("window", WINDOWS),
    average: choice("average", AVERAGES),
    resolution: h("input", { type: "text", name: "resolution", id: "processing-resolution", placeholder: "8 / length", title: "Distance between bins of averages, density and waterfall, such as 0.5 Hz", spellcheck: "false" }),
    overlap: text("overlap", "0.5"),
    background: h("select", { name: "background", id: "processing-background", onfocus: () => fill() }),
    bands: h("textarea", { name: "bands", id: "processing-bands", rows: 3, placeholder: BANDS, spellcheck: "false" }),
    roll_off: text("roll_off", "0.2 or less"),
    limit: limit.input,
    limit_band: h("input", { type: "text", name: "limit_band", id: "processing-limit_band", placeholder: "everywhere", spellcheck: "false" }),
  };
  let choices = async () => [];
  const element = h(
    "div",
    { class: "processing" },
    h("div", { class: "ask" }, labelled("section from", fields.from), labelled("to", fields.to), labelled("or from a trigger", fields.trigger), labelled("time before it", fields.pre_trigger), labelled("channel's unit", fields.unit), h("button", { type: "button", class: "quiet", onclick: () => state([null, null]) }, "Whole record")),
    h("div", { class: "ask" }, labelled("window", fields.window), labelled("average", fields.average), labelled("resolution", fields.resolution), labelled("overlap", fields.overlap), labelled("background (drive off)", fields.background)),
    h(
      "details",
      { class: "bands-asked" },
      h("summary", {}, "Bands with a limit each"),
      h("div", { class: "ask" }, labelled("a row for each band: its ends and the largest magnitude that its time history may have (CSV)", fields.bands), labelled("roll-off", fields.roll_off)),
    ),
    h("details", { class: "limit-asked" }, h("summary", {}, "Limit of the lines"), h("div", { class: "ask" }, limit.element, labelled("in band", fields.limit_band))),
  );
  keepFields("processing", Object.fromEntries(Object.entries(fields).filter(([name]) => name !== "background")));
  for (const name of ["from", "to", "trigger"]) fields[name].addEventListener("input", () => onSection(stated()));
  unfold();
  offer([]);

  /** Open what has something in it. */
  function unfold() {
    for (const name of ["bands", "limit"]) if (fields[name].value.trim()) fields[name].closest("details").open = true;
  }

  /** Ends of the section in seconds, where they are stated in a unit that is known here. */
  function stated() {
    if (fields.trigger.value.trim()) return null; // only the record tells where that is
    const [from, to] = [fields.from, fields.to].map(({ value }) => seconds(value));
    return from === null && to === null ? null : [from, to];
  }

  function state([from, to]) {
    fields.from.value = from === null ? "" : `${rounded(from)} s`;
    fields.to.value = to === null ? "" : `${rounded(to)} s`;
    fields.trigger.value = fields.pre_trigger.value = "";
    fields.from.dispatchEvent(new Event("input"));
  }

  async function fill() {
    offer(await choices());
  }

  function offer(recordings) {
    const chosen = fields.background.value;
    const options = [["", "none"], ...recordings.map(({ id, name }) => [id, name])]; // prettier-ignore
    const before = [...fields.background.options].map(({ value, text: words }) => [value, words]);
    if (JSON.stringify(before) === JSON.stringify(options)) return; // a list that is open stays so
    fields.background.replaceChildren(...options.map(([value, words]) => h("option", { value }, words)));
    fields.background.value = options.some(([value]) => value === chosen) ? chosen : "";
  }

  const given = (name) => fields[name].value.trim() || undefined;
  const figure = (name) => (Number.isFinite(Number(given(name))) ? Number(given(name)) : given(name)); // the server refuses what is none
  const limited = () => ({ limit: given("limit"), limit_band: given("limit_band") });
  const section = () => Object.fromEntries(["from", "to", "trigger", "pre_trigger", "unit"].map((name) => [name, given(name)]));

  return {
    element,
    section,
    /** What a request says. */
    asked: () => ({
      ...section(),
      window: fields.window.value,
      average: fields.average.value,
      resolution: given("resolution"),
      overlap: figure("overlap"),
      background: given("background"),
      bands: fields.bands.value.trim() ? fields.bands.value : undefined,
      roll_off: figure("roll_off"),
      ...limited(),
    }),
    /** The limit of a request that processes nothing. */
    limited,
    state,
    stated,
    /** Put into the fields what a request of before said. */
    take: (asked) => {
      for (const [name, field] of Object.entries(fields)) if (name !== "background") field.value = asked[name] ?? USUAL[name] ?? "";
      unfold();
      onSection(stated());
    },
    /** Where recordings that may be the background come from. */
    choose: (from) => (choices = from),
    /** Offer those that there are now. */
    fill,
  };
}

const USUAL = { window: "hann", average: "none" };
const rounded = (value) => Number(value.toPrecision(7));

function seconds(words) {
  const [, figure, unit] = /^\s*([\d.]+(?:e[-+]?\d+)?)\s*(s|ms|min)\s*$/i.exec(words) ?? [];
  return figure === undefined ? null : Number(figure) * { s: 1, ms: 1e-3, min: 60 }[unit];
}
