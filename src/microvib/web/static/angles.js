// The Angles tab: lines of the line of sight over the angle of the array on its craft.

import { post } from "./api.js";
import { describedField } from "./described.js";
import { h, save } from "./dom.js";
import { keepFields } from "./kept.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { card, partCards, partContent } from "./tables.js";

const angles = h("input", { type: "text", id: "angles-angles", name: "angles", value: "0:180:15", spellcheck: "false" });
const steady = h("input", { type: "checkbox", id: "angles-steady" });
const limit = describedField("angles-limit", "Limit of a line, or of loads: a torque, or a curve over frequency (CSV)", { placeholder: "30 mN*m, or the lines of a table: frequency_hz,t_mnm …", rows: 2, accept: ".csv,.txt,text/csv" });
const band = h("input", { type: "text", id: "angles-band", name: "band", placeholder: "all of the limit", spellcheck: "false" });
const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("angles", place, show);

export function makeAngles(tab) {
  const ask = h(
    "form",
    { onsubmit: sweep },
    limit.element,
    h(
      "div",
      { class: "ask" },
      h("label", { title: "FIRST:LAST:STEP in degrees, or a list such as 0, 45, 90" }, "first:last:step [deg], or a list", angles),
      h("label", { title: "Part of the limit that counts, such as 0.5:150 Hz" }, "band of the limit", band),
      h("label", { class: "check", title: "Solve for the periodic steady state at each angle" }, steady, "steady"),
      h("button", { class: "primary" }, "Sweep"),
    ),
  );
  const words = "One run of the scenario at each angle; it needs a spacecraft with a line of sight, in its file. With a limit each angle is judged, and nothing between them.";
  tab.append(h("section", { class: "card" }, h("h2", {}, "Angles of the array"), h("p", { class: "soft" }, words), ask, place), result);
  keepFields("angles.asked", { angles, steady, limit: limit.input, band });
  task.restore();
}

/** A sweep of the library. */
export const openAngles = ({ id, title }) => task.open({ id, name: title });

async function sweep(event) {
  event.preventDefault();
  const body = {
    scenario: scenario.current(),
    angles: angles.value.trim(),
    steady: steady.checked,
    limit: limit.input.value.trim() || undefined,
    band: band.value.trim() || undefined,
  };
  await task.start("Sweep", () => post("/api/angles", body));
}

function show({ summary, parts, files }) {
  const links = Object.entries(files).map(([name, text]) => h("button", { type: "button", onclick: () => save(text, name) }, name));
  const [first, ...others] = parts;
  result.replaceChildren(
    card("Lines over the array's angle", summary, ...partContent(first)),
    ...partCards(others),
    card("Download", "", h("div", { class: "bar" }, links)),
  );
}
