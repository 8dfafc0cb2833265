// The Recording tab: a test's file, what is in it, beside the current run, and parameters from it.

import { makeAcceptance } from "./acceptance.js";
import { get, post, upload } from "./api.js";
import { announce, h, number, onDrop, quantity } from "./dom.js";
import { makeFit } from "./fit.js";
import { makeHammer } from "./hammer.js";
import { keep, kept } from "./kept.js";
import { latest } from "./latest.js";
import { makeBands } from "./band_histories.js";
import { makePreparation } from "./preparation.js";
import { makeProcessing } from "./processing.js";
import { makeTask, progressRow } from "./progress.js";
import * as recorded from "./recorded.js";
import { makeHistory } from "./recorded_history.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import { makeSeveral } from "./several.js";
import { factList } from "./study.js";
import { partContent } from "./tables.js";
import { makeTracking } from "./tracking.js";
import { makeWaterfall } from "./waterfall.js";

const KEPT = "recording.file";
const LONG = 3_000_000; // samples from which a recording is shown first, and processed when it is asked for
const MB = 1e6;
const NO_LINES = "None: lines are looked for in the torque about the drive axis of the scenario on the left.";
const file = h("input", { type: "file", id: "recording-file", class: "away", multiple: true });
const zone = h(
  "div",
  { class: "dropzone" },
  h("p", {}, "Drop recordings here, or ", h("label", { class: "button" }, "choose files…", file)),
  h("p", { class: "soft note" }, "It stays on this machine. Lines are looked for where the scenario on the left expects them."),
);
const state = h("div", { "aria-live": "polite" });
const found = h("div", { class: "figures", hidden: true });
const channel = h("select", { id: "recording-channel", onchange: () => analyse() });
const facts = h("p", { class: "soft" });
const working = h("div", {});
const lines = h("div", {});
const comparing = h("div", {});
const comparison = h("div", {});
const reading = latest();
const analysing = makeTask("analysis", working, showAnalysis);
const comparisons = makeTask("comparison", comparing, showComparison);
let recording = null;
let fit = null;
const outcome = h("div", { class: "figures", hidden: true }); // what the analysis gave
const history = makeHistory(processSection);
const processing = makeProcessing((section) => recording && history.mark(section));
const preparation = makePreparation();
const waterfall = makeWaterfall("waterfall", "Waterfall");
const bands = makeBands();
const tracking = makeTracking(() => ({
  recording: recording?.id,
  channel: channel.value,
  channels: recording?.channels.map(({ name }) => name) ?? [],
  section: { ...processing.section(), ...preparation.asked() },
}));
const several = makeSeveral(
  () => ({ channel: channel.value || "Mz", processing: processing.asked(), limited: processing.limited(), preparing: preparation.asked() }),
  (recordings) => [hammer, acceptance].forEach((one) => one.offer(recordings)),
);
const hammer = makeHammer(preparation.correctBy);
const acceptance = makeAcceptance(() => ({ channel: channel.value || "Mz", tests: several.ticked(), preparing: preparation.asked(), hammer: hammer.asked() }));

const grouped = (count) => String(count).replace(/\B(?=(\d{3})+$)/g, "\u202f"); // 10 000 000
const card = (title, ...content) => h("section", { class: "card" }, h("h2", {}, title), ...content);

export function makeRecording(place) {
  file.addEventListener("change", () => {
    const chosen = [...file.files];
    file.value = "";
    takeAll(chosen);
  });
  onDrop(zone, takeAll);
  fit = makeFit(() => ({ ...preparation.asked(), recordings: [recording.id], channel: channel.value }));
  const beside = "The run's scenario is simulated at the clock that the recording shows, then both are read the same way.";
  outcome.append(
    recorded.spectrum.card,
    card("Lines with uncertainty", lines),
    bands.card,
    waterfall.card,
    recorded.density.card,
  );
  found.append(
    card(
      "Recording",
      facts,
      h(
        "div",
        { class: "bar" },
        h("label", { for: "recording-channel" }, "Channel"),
        channel,
        h("button", { type: "button", class: "primary", onclick: analyse }, "Process"),
      ),
      processing.element,
      preparation.element,
      working,
    ),
    history.card,
    outcome,
    ...tracking.cards,
    card(
      "Beside the current run",
      h("p", { class: "soft" }, beside),
      h("button", { type: "button", onclick: compare }, "Compare with the current run"),
      comparing,
      comparison,
    ),
    card("Identification", fit.element),
  );
  place.append(zone, state, found, several.card, ...hammer.elements, ...acceptance.elements);
  processing.choose(async () => {
    await several.fill();
    return several.choices().filter(({ id }) => id !== recording?.id);
  });
  several.fill();
  hammer.restore();
  acceptance.restore();
  runs.onChange((what) => what === "runs" && recorded.spectrum.update());
  restore();
}

/** Send files one after the other; the last is shown and processed. One that is refused or stopped ends it. */
async function takeAll(files) {
  for (const [k, one] of files.entries()) {
    if (!(await take(one, k === files.length - 1 ? begin : store))) return;
  }
}

/** A recording that the server has read, and that another one follows. */
function store(answer) {
  announce(`${answer.name} is read.`);
  return several.fill();
}

/** Send a file, with how much of it has gone; then the server reads it, and `onRead` gets it. Whether it was read. */
async function take(chosen, onRead) {
  const size = Math.round(chosen.size / MB);
  const row = progressRow(chosen.name, () => {
    reading.forget();
    state.replaceChildren();
  });
  const onSent = (bytes) => {
    const sending = { done: Math.round(bytes / MB), total: size, unit: "MB", text: "sending" };
    row.show({ state: "running", progress: bytes < chosen.size ? sending : { text: "the server reads it" } });
  };
  state.replaceChildren(row.element);
  onSent(0);
  try {
    return await reading((signal) => upload("/api/recordings", { name: chosen.name }, chosen, { signal, onSent }), onRead);
  } catch (error) {
    state.replaceChildren(h("p", { class: "error block", role: "alert" }, error.message));
    return false;
  }
}

/** A recording that the server has read. */
function begin(answer) {
  announce(`${answer.name} is read.`);
  comparisons.leave();
  fit.leave();
  tracking.leave();
  comparison.replaceChildren();
  processing.state([null, null]); // a section belongs to its recording
  show(answer, usual(answer.channels));
  if (answer.samples <= LONG) return analyse();
  analysing.leave();
  nothingYet();
}

/** A long recording is there: what may take minutes begins when it is asked for. */
function nothingYet() {
  keep(KEPT, { recording, channel: channel.value });
  outcome.hidden = true;
  state.replaceChildren(h("p", { class: "soft" }, "This recording is long. Mark a section of it, or press Process for all of it, which takes minutes."));
}

const usual = (channels) =>
  (channels.find((item) => item.name === "Mz") ?? channels.find((item) => item.unit === "N*m") ?? channels[0])?.name;

function show(answer, chosen) {
  recording = answer;
  state.replaceChildren();
  facts.textContent = `${recording.name}: ${recording.channels.length} channel${recording.channels.length === 1 ? "" : "s"}, ${grouped(recording.samples)} samples at ${number(recording.sample_rate, 6)} Hz, ${number(recording.duration, 4)} s. ${(recording.notes ?? []).join(" ")}`;
  channel.replaceChildren(
    ...recording.channels.map((item) => h("option", { value: item.name }, `${item.name}, ${quantity(item.rms, item.unit)} RMS`)),
  );
  channel.value = chosen;
  found.hidden = false;
  history.open(recording, chosen, processing.stated());
  tracking.refresh();
  processing.fill();
}

/** The recording of before a reload, and what was made of it. */
function restore() {
  const before = kept(KEPT);
  if (!before) return;
  show(before.recording, before.channel);
  analysing.restore();
  comparisons.restore();
  tracking.restore();
  several.restore();
  fit.restore();
}

/** A recording of the library, or what was made of one or several: {kind, id, title, asked}. */
export async function openRecording({ kind, id, title, asked }) {
  const job = { id, name: title };
  if (kind === "acceptance") return acceptance.open(job);
  if (kind === "hammer") return hammer.open({ ...job, asked });
  if (kind === "batch" || kind === "repeated" || asked.other) return several.open(kind, job);
  const of = { recording: id, identification: asked.recordings?.[0] }[kind] ?? asked.recording;
  const answer = await get(`/api/recordings/${of}`);
  if (kind === "recording") return begin(answer);
  if (["analysis", "tracking"].includes(kind)) processing.take(asked);
  if (kind !== "recording") preparation.take(asked);
  if (recording?.id !== answer.id) show(answer, asked.channel);
  return { analysis: analysing.open, comparison: comparisons.open, identification: fit.open, tracking: tracking.open }[kind](job);
}

/** A section that was marked is processed, unless that takes long. */
function processSection([from, to]) {
  processing.state([from, to]);
  if ((to - from) * recording.sample_rate <= LONG) return analyse();
}

function analyse() {
  keep(KEPT, { recording, channel: channel.value });
  const body = { ...processing.asked(), ...preparation.asked(), recording: recording.id, channel: channel.value, scenario: scenario.current() };
  state.replaceChildren();
  return analysing.start(`Analysis of ${channel.value}`, () => post("/api/analyses", body));
}

function showAnalysis(answer, _, id) {
  const analysis = { ...answer, id };
  const clock = answer.clock_ratio
    ? `step clock at ${number(answer.clock_ratio, 6)} of its nominal rate`
    : answer.lines.length && "no line of the step clock is seen";
  const found = answer.parts.find((part) => part.title === "Lines");
  const others = answer.parts.filter(({ title }) => ["Orders of the electrical period", "Other lines", "Lines with the drive off"].includes(title));
  lines.replaceChildren(
    ...spoken(answer.parts[0]),
    ...judged(answer),
    ...(found ? partContent(found) : [h("p", { class: "soft" }, NO_LINES)]),
    ...others.flatMap((part) => [h("h3", {}, part.title), ...partContent(part)]),
  );
  outcome.hidden = false;
  const [from, to] = analysis.section;
  const whole = recording && to - from > recording.duration - 0.5 / recording.sample_rate;
  if (!whole) history.mark(analysis.section); // also where a trigger has found it
  const section = whole ? "" : `${number(from, 6)} to ${number(to, 6)} s`;
  return Promise.all([
    recorded.spectrum.show(analysis, [section, clock].filter(Boolean).join("; ")),
    recorded.density.show(analysis, section),
    waterfall.show(analysis, analysis.waterfall),
    bands.show(analysis),
  ]);
}

/** What the limit says: leading figures, the sentence, and the lines that are nearest to it. */
function judged({ facts, limit, parts }) {
  if (!limit) return [];
  const part = parts.find(({ title }) => title === "Against the limit");
  return [h("h3", {}, "Against the limit"), factList(facts.filter(({ status }) => status)), ...partContent(part)];
}

/** Notes on the recording, as the report's first part has them. */
function spoken(first) {
  const pairs = first?.items.find(({ kind }) => kind === "pairs");
  const notes = (pairs?.rows ?? []).filter(([name]) => ["Note", "Resolution"].includes(name));
  return notes.length ? partContent({ title: "", items: [{ kind: "pairs", rows: notes }] }) : [];
}

function compare() {
  const run = runs.selected();
  if (run?.state !== "done") {
    const missing = "There is no finished run to compare with; start one first.";
    comparison.replaceChildren(h("p", { class: "error", role: "alert" }, missing));
    return;
  }
  const body = { ...preparation.asked(), ...processing.limited(), recording: recording.id, run: run.id, channel: channel.value };
  comparisons.start(`Comparison with ${run.name}`, () => post("/api/comparisons", body));
}

/** The recording is A, the run B. */
function showComparison({ summary, parts }) {
  comparison.replaceChildren(h("p", { class: "soft" }, summary), ...parts.flatMap(partContent));
}
