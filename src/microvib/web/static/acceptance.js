// An acceptance report of several recordings: each judged against a limit, all for repeatability, written by a template.

import { post } from "./api.js";
import { describedField } from "./described.js";
import { announce, h } from "./dom.js";
import { keepFields } from "./kept.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { studyCards } from "./study.js";

const TEMPLATE = "# Acceptance test of {{ data.drive }}\n\nVerdict: **{{ test.verdict }}** ({{ test.limit }}).\n\n{{ test.verdicts }}\n{{ test.conclusion }}\n\n## Repeatability\n\n{{ test.repeatability }}\n";

/** The card, and what came out; `evidence()` gives {channel, tests, preparing, hammer} when it is asked. */
export function makeAcceptance(evidence) {
  const template = describedField("acceptance-template", "Template of the report (Markdown)", { rows: 8, accept: ".md,.txt,text/markdown" });
  const data = describedField("acceptance-data", "Words of the template, as data.KEY (YAML)", { placeholder: "drive: SADA, FM 2", rows: 3, accept: ".yaml,.yml,text/yaml" });
  const limit = describedField("acceptance-limit", "Limit: a torque, or a curve (CSV)", { placeholder: "60 mN*m, or\nfrequency_hz,t_mnm\n0.5,8\n10,20", rows: 4, accept: ".csv,.txt,text/csv" });
  const band = h("input", { type: "text", id: "acceptance-band", name: "band", placeholder: "all of the limit", spellcheck: "false" });
  const reference = h("select", { id: "acceptance-reference", name: "reference" });
  const hit = h("input", { type: "checkbox", id: "acceptance-hammer", name: "hammer" });
  const place = h("div", {});
  const result = h("div", { class: "figures" });
  const task = makeTask("acceptance", place, (found, _, id) => result.replaceChildren(...studyCards("Acceptance", found, id)));
  const words = "Of the recordings that are ticked under Several recordings, with their units, prepared as stated above. Without a limit nothing is judged. The report is what the template makes of it.";
  const ask = h(
    "form",
    { onsubmit: start },
    h("div", { class: "descriptions" }, template.element, h("div", {}, data.element, limit.element)),
    h(
      "div",
      { class: "ask" },
      h("label", { title: "Part of the limit that counts, such as 1.5:120 Hz" }, "band of the limit", band),
      h("label", { title: "What the first recording is compared with" }, "compare with", reference),
      h("label", { class: "check", title: "With the hammer test as it is stated above" }, hit, "with the hammer test"),
      h("button", { class: "primary" }, "Make the report"),
    ),
  );
  const card = h("section", { class: "card", id: "acceptance" }, h("h2", {}, "Acceptance report"), h("p", { class: "soft" }, words), ask, place);
  template.input.value = TEMPLATE;
  keepFields("acceptance.asked", { template: template.input, data: data.input, limit: limit.input, band, hammer: hit });
  offer([]);

  /** Recordings that the first one may be compared with. */
  function offer(recordings) {
    const chosen = reference.value;
    const options = [["", "nothing"], ["scenario", "the scenario on the left"], ...recordings.map(({ id, name }) => [id, name])]; // prettier-ignore
    reference.replaceChildren(...options.map(([value, text]) => h("option", { value }, text)));
    reference.value = options.some(([value]) => value === chosen) ? chosen : "";
  }

  async function start(event) {
    event.preventDefault();
    const { channel, tests, preparing, hammer } = evidence();
    if (!tests.length) return announce("Tick one recording or more under Several recordings.", { error: true });
    if (hit.checked && !hammer) return announce("Tick the recordings of blows under Hammer test of the table.", { error: true });
    const given = (input) => input.value.trim() || undefined;
    const body = {
      ...preparing,
      tests: tests.map(({ id, unit }) => ({ recording: id, unit })),
      channel,
      scenario: scenario.current(),
      template: template.input.value,
      data: data.input.value,
      limit: given(limit.input),
      band: given(band),
      reference: reference.value,
      hammer: hit.checked ? hammer : undefined,
    };
    await task.start("Acceptance report", () => post("/api/acceptances", body));
  }

  return { elements: [card, result], offer, restore: task.restore, open: task.open };
}
