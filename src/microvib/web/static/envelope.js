// The Envelope tab: statistics of lines over runs, maps, campaigns and recordings of the page, and their verdict.

import { get, post } from "./api.js";
import { describedField } from "./described.js";
import { announce, h } from "./dom.js";
import { keep, keepFields, kept } from "./kept.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { studyCards } from "./study.js";

const TICKED = "envelope.members";
const KINDS = { run: "run", rates: "rate map", campaign: "campaign", angles: "angles" };
const STATISTICS = [
  ["max", "maximum"],
  ["mean", "mean"],
  ["p95", "P95"],
  ["p99", "P99"],
];

const list = h("div", { class: "several", role: "group", "aria-label": "Members" });
const boxes = STATISTICS.map(([value, words]) => {
  const input = h("input", { type: "checkbox", id: `envelope-${value}`, name: "statistics", value });
  return { value, input, label: h("label", { class: "check" }, input, words) };
});
const text = (name, value, placeholder) => h("input", { type: "text", id: `envelope-${name}`, name, value, placeholder, spellcheck: "false" });
const inputs = {
  channels: text("channels", "", "the limit's"),
  bandwidth: text("bandwidth", "1/3 octave"),
  resolution: text("resolution", "1 Hz"),
  band: text("band", "", "all of the limit"),
};
const limit = describedField("envelope-limit", "Limit of a line: a torque, or a table over frequency (CSV)", {
  placeholder: "30 mN*m, or\nfrequency_hz,t_mnm\n0.5,8\n10,20",
  rows: 4,
  accept: ".csv,.txt,text/csv",
});
const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("envelope", place, (found, context, id) => result.replaceChildren(...studyCards("Envelope", found, id)));

export function makeEnvelope(tab) {
  const words =
    "Statistics over the members, band by band: what has ended on this page or stands in its library. A rate map, a campaign and a sweep over angles have a member for each rate, case or angle. Nothing is simulated again. Recordings take the names of their lines from the scenario on the left.";
  boxes[0].input.checked = true;
  const ask = h(
    "form",
    { onsubmit: start },
    list,
    h("div", { class: "bar", role: "group", "aria-label": "Statistics over the members" }, boxes.map(({ label }) => label)),
    limit.element,
    h(
      "div",
      { class: "ask" },
      h("label", { title: "Part of the limit that counts, such as 0.5:150 Hz" }, "band of the limit", inputs.band),
      h("label", { title: "T_d, the torque about the drive axis, or loads, Fx to Mz, separated by commas" }, "channels", inputs.channels),
      h("label", { title: "A part of an octave, a width such as 2 Hz, or 5 percent" }, "bands", inputs.bandwidth),
      h("label", { title: "Noise bandwidth of the amplitude spectra" }, "resolution", inputs.resolution),
      h("button", { class: "primary" }, "Find the envelope"),
    ),
  );
  tab.append(h("section", { class: "card" }, h("h2", {}, "Envelope"), h("p", { class: "soft" }, words), ask, place), result);
  keepFields("envelope.asked", { ...inputs, limit: limit.input, ...Object.fromEntries(boxes.map(({ value, input }) => [value, input])) });
  list.addEventListener("input", () => keep(TICKED, ticked()));
  new MutationObserver(() => tab.hidden || fill()).observe(tab, { attributes: true, attributeFilter: ["hidden"] });
  if (!tab.hidden) fill();
  task.restore();
}

/** An envelope of the library. */
export const openEnvelope = ({ id, title }) => task.open({ id, name: title });

const ticked = () => [...list.querySelectorAll("input:checked")].map(({ value }) => value);

/** What may be a member, the newest first. */
async function fill() {
  try {
    const [jobs, recordings] = await Promise.all([get("/api/jobs"), get("/api/recordings")]);
    const done = jobs.filter(({ kind, state }) => KINDS[kind] && (state === "done" || (kind === "campaign" && state === "cancelled")));
    const found = [...done.reverse().map(({ id, kind, title }) => [id, title, KINDS[kind]]), ...recordings.map(({ id, name }) => [id, name, "recording"])];
    const chosen = new Set(kept(TICKED, []));
    list.replaceChildren(...found.map((one) => row(one, chosen)));
    if (!found.length) list.replaceChildren(h("p", { class: "soft" }, "Nothing is here yet: run the scenario, map rates, or load a recording."));
  } catch (error) {
    announce(error.message, { error: true });
  }
}

function row([id, title, kind], chosen) {
  const box = h("input", { type: "checkbox", name: "members", value: id });
  box.checked = chosen.has(id);
  return h("div", { class: "one" }, h("label", { class: "check" }, box, title), h("span", { class: "soft note" }, kind));
}

async function start(event) {
  event.preventDefault();
  const members = ticked();
  if (!members.length) return announce("Tick one member or more.", { error: true });
  const given = (input) => input.value.trim() || undefined;
  const body = {
    members,
    statistics: boxes.filter(({ input }) => input.checked).map(({ value }) => value),
    channels: inputs.channels.value.split(",").map((name) => name.trim()).filter(Boolean),
    bandwidth: given(inputs.bandwidth),
    resolution: given(inputs.resolution),
    limit: given(limit.input),
    band: given(inputs.band),
    scenario: scenario.current(),
  };
  await task.start("Envelope", () => post("/api/envelopes", body));
}
