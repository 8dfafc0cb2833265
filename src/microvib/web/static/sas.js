// The SAS tab: springs, arm and counterweights of the simulator that stands for an array.

import { post } from "./api.js";
import { h } from "./dom.js";
import { keepFields } from "./kept.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { card, partCards, partContent } from "./tables.js";

const ASKED = [
  ["inertia", "inertia J", "8.18 kg*m^2"],
  ["frequency", "first frequency", "1.19 Hz"],
  ["amplitude", "largest angle", "1 deg"],
  ["rate", "rate at start and stop", "0.06 deg/s"],
  ["states", "further states", ""],
];
const inputs = Object.fromEntries(
  ASKED.map(([key, , value]) => [
    key,
    h("input", {
      type: "text",
      id: `sas-${key}`,
      name: key,
      value,
      placeholder: key === "states" ? "the catalog's five" : "",
      title: key === "states" ? "Hz:kg m² of each, such as 1.19:15.69, 1.39:8.18" : "",
    }),
  ]),
);
const place = h("div", {});
const result = h("div", { class: "figures" });
const task = makeTask("sas", place, show);

export function makeSas(tab) {
  const ask = h(
    "form",
    {
      class: "ask",
      onsubmit: (event) => {
        event.preventDefault();
        size(false);
      },
    },
    ASKED.map(([key, words]) => h("label", {}, words, inputs[key])),
    h("button", { class: "primary" }, "Size"),
    h("button", { type: "button", onclick: () => size(true) }, "Size for the scenario's array"),
  );
  tab.append(
    h("section", { class: "card" }, h("h2", {}, "Solar array simulator for an inertia and a frequency"), ask, place),
    result,
  );
  keepFields("sas.asked", inputs);
  task.restore();
}

/** A sizing of the library. */
export const openSas = ({ id, title }) => task.open({ id, name: title });

async function size(ofScenario) {
  const text = (key) => inputs[key].value.trim() || undefined;
  const what = ofScenario ? { from_scenario: scenario.current() } : { inertia: text("inertia"), frequency: text("frequency") };
  const body = { ...what, amplitude: text("amplitude"), rate: text("rate"), states: text("states")?.split(/[\s,]+/) };
  await task.start("Sizing", () => post("/api/sas", body));
}

function show({ summary, parts: [first, ...others] }) {
  result.replaceChildren(card("Settings", summary, ...partContent(first)), ...partCards(others));
}
