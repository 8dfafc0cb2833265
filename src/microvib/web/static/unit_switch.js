// The switch for units in the page's head.

import { h } from "./dom.js";
import { CHOICES, chooseUnits, units } from "./measures.js";

const WORDS = { torque: "Torque in", level: "Lines as", angle: "Angles in" };

export function makeUnitSwitch(place) {
  const selects = Object.entries(CHOICES).map(([key, choices]) => {
    const select = h(
      "select",
      { id: `units-${key}`, onchange: () => chooseUnits({ [key]: select.value }) },
      Object.entries(choices).map(([value, words]) => h("option", { value }, words)),
    );
    select.value = units()[key];
    return h("label", { for: `units-${key}` }, WORDS[key], select);
  });
  place.append(h("details", { class: "menu units" }, h("summary", { class: "button", title: "Units of all plots and tables" }, "Units"), h("div", {}, selects)));
}
