// Several recordings at once: two compared, repeated tests of units, all processed alike.

import { get, post } from "./api.js";
import { addCursors } from "./cursors.js";
import { announce, h, number, unitText } from "./dom.js";
import { amplitudeAxis, onUnits } from "./measures.js";
import { bounds, draw } from "./plots.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { style } from "./styles.js";
import { partContent } from "./tables.js";

const HIGHEST = 200;

/** The card; `evidence()` gives {channel, processing, preparing} when it is asked, `onList(recordings)` hears what there is. */
export function makeSeveral(evidence, onList = () => {}) {
  const list = h("div", { class: "several" });
  const place = h("div", {});
  const words = h("div", {});
  const plot = h("div", { class: "plot tall", id: "several-plot", role: "img", "aria-label": "Spectra of the recordings" });
  const picture = h("div", { hidden: true }, plot);
  const button = (text, action) => h("button", { type: "button", onclick: action }, text);
  const card = h(
    "section",
    { class: "card", id: "several" },
    h("h2", {}, "Several recordings"),
    h("p", { class: "soft" }, "Of the recordings that the server has. Runs of one unit are repetitions; the channel is the one above. Process alike takes section, averages, background, bands and limit from there, too; Compare two, the limit."),
    list,
    h("div", { class: "bar" }, button("Compare two", compare), button("Repeatability", repeat), button("Process alike", alike)),
    place,
    picture,
    words,
  );
  const tasks = {
    comparison: makeTask("several.comparison", place, show),
    repeated: makeTask("several.repeated", place, show),
    batch: makeTask("several.batch", place, show),
  };
  let there = [];
  let shown = null;
  addCursors(plot, "frequency");
  onUnits(() => update());

  async function fill() {
    there = (await get("/api/recordings")).sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
    const chosen = new Map(ticked().map(({ id, unit }) => [id, unit]));
    list.replaceChildren(...there.map((one) => row(one, chosen)));
    onList(there);
  }

  function row({ id, name, duration, channels }, chosen) {
    const box = h("input", { type: "checkbox", value: id });
    box.checked = chosen.has(id);
    const unit = h("input", { type: "text", class: "short", placeholder: "unit", "aria-label": `Unit of ${name}`, value: chosen.get(id) ?? "" });
    return h("div", { class: "one", "data-id": id }, h("label", { class: "check" }, box, name), h("span", { class: "soft note" }, `${number(duration, 4)} s, ${channels.length} channel${channels.length === 1 ? "" : "s"}`), unit);
  }

  const ticked = () =>
    [...list.children]
      .filter((row) => row.querySelector("[type=checkbox]").checked)
      .map((row) => ({ id: row.dataset.id, unit: row.querySelector("[type=text]").value.trim() }));

  function leave() {
    Object.values(tasks).forEach((task) => task.leave());
  }

  function compare() {
    const two = ticked();
    if (two.length !== 2) return announce("Tick two recordings: the first is A, the second B.", { error: true });
    leave();
    const { channel, limited, preparing } = evidence();
    const body = { ...preparing, ...limited, recording: two[0].id, other: two[1].id, channel, scenario: scenario.current() };
    return tasks.comparison.start("Comparison of two recordings", () => post("/api/comparisons", body));
  }

  function repeat() {
    leave();
    const { channel, preparing } = evidence();
    const body = { ...preparing, tests: ticked().map(({ id, unit }) => ({ recording: id, unit })), channels: [channel], scenario: scenario.current() };
    return tasks.repeated.start("Repeatability", () => post("/api/repeated", body));
  }

  function alike() {
    leave();
    const { channel, processing, preparing } = evidence();
    const body = { ...processing, ...preparing, recordings: ticked().map(({ id }) => id), channel, scenario: scenario.current() };
    return tasks.batch.start("Processing", () => post("/api/batches", body));
  }

  function show(answer) {
    shown = answer.spectra ? answer : null;
    picture.hidden = !shown;
    words.replaceChildren(h("p", { class: "soft" }, answer.summary), ...answer.parts.flatMap((part) => titled(part)));
    return update();
  }

  /** Spectra of all that were processed alike, over each other. */
  function update() {
    if (!shown) return;
    const axis = amplitudeAxis(shown.unit);
    const unit = axis.printed ?? unitText(shown.unit);
    const largest = Math.max(...shown.spectra.map(({ amplitude }) => amplitude.reduce((a, b) => Math.max(a, b), 0)), 1e-15);
    const traces = shown.spectra.map(({ name, f, amplitude }, k) => {
      const [color, dash] = style(k);
      return { x: f, y: amplitude.map(axis.y), mode: "lines", name, line: { color, dash, width: 1.2 }, hovertemplate: `%{x:.6g} Hz<br>%{y:.4g} ${unit}<extra>%{fullData.name}</extra>` };
    });
    return draw(plot, traces, {
      xaxis: { title: { text: "frequency [Hz]" }, range: [0, Math.min(HIGHEST, shown.spectra[0].f.at(-1))] },
      yaxis: { title: { text: `amplitude of ${shown.channel} [${unit}], ${axis.words}` }, ...(axis.dB ? {} : { type: "log", dtick: 1 }), range: bounds(axis.y(largest), true, axis.dB) },
      showlegend: true,
    });
  }

  return {
    card,
    fill: () => fill().catch((error) => announce(error.message, { error: true })),
    choices: () => there,
    /** Those that are ticked, with their units: {id, unit}. */
    ticked,
    restore: () => Object.values(tasks).forEach((task) => task.restore()),
    open: (kind, job) => {
      leave();
      return tasks[kind].open(job);
    },
  };
}

const titled = (part) => {
  const content = partContent(part);
  return content.length ? [part.title && h("h3", {}, part.title), ...content].filter(Boolean) : [];
};
