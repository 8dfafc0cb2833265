// A hammer test of the force table: its responses and resonances, which recordings are then corrected by.

import { post } from "./api.js";
import { announce, h, number } from "./dom.js";
import { keepFields } from "./kept.js";
import { makeTask } from "./progress.js";
import { studyCards } from "./study.js";

const LOADS = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"];

/** The card, and what came out; `correctBy(response, mass)` takes the table's dynamics out of recordings from then on. */
export function makeHammer(correctBy) {
  const list = h("div", { class: "several", role: "group", "aria-label": "Recordings of blows" });
  const text = (name, value, placeholder = "") => h("input", { type: "text", id: `hammer-${name}`, name, value, placeholder, spellcheck: "false" });
  const fields = {
    mounted_mass: text("mounted_mass", "", "12 kg, 0 kg if empty"),
    impact: text("impact", "hammer"),
    block: text("block", "", "by the blows"),
    estimator: h("select", { id: "hammer-estimator", name: "estimator" }, ["H1", "H2"].map((one) => h("option", { value: one }, one))),
  };
  const place = h("div", {});
  const result = h("div", { class: "figures" });
  const task = makeTask("hammer", place, show);
  const words = "Of recordings with the hammer's force and the table's reading, blows along or about one axis each. Double, weak and clipped blows are left out and named.";
  const ask = h(
    "form",
    { onsubmit: start },
    list,
    h(
      "div",
      { class: "ask" },
      h("label", { title: "The response holds for it" }, "mass on the table", fields.mounted_mass),
      h("label", {}, "channel of the hammer", fields.impact),
      h("label", { title: "Length of a block, such as 0.5 s" }, "block", fields.block),
      h("label", { title: "H1: noise in the reading; H2: noise in the force" }, "estimator", fields.estimator),
      h("button", { class: "primary" }, "Find the response"),
    ),
  );
  const card = h("section", { class: "card", id: "hammer" }, h("h2", {}, "Hammer test of the table"), h("p", { class: "soft" }, words), ask, place);
  keepFields("hammer.asked", fields);

  /** Recordings that may be of blows. */
  function offer(recordings) {
    const chosen = new Map(hits().map((hit) => [hit.recording, hit]));
    list.replaceChildren(...recordings.map((one) => row(one, chosen.get(one.id))));
  }

  function row({ id, name, duration }, hit) {
    const box = h("input", { type: "checkbox", value: id });
    box.checked = Boolean(hit);
    const load = h("select", { "aria-label": `Load of ${name}`, onchange: () => free() }, LOADS.map((one) => h("option", { value: one }, one)));
    const arm = h("input", { type: "text", name: "arm", class: "short", placeholder: "arm, 0.2 m", "aria-label": `Lever arm of ${name}`, value: hit?.arm ?? "" });
    const free = () => (arm.hidden = load.value.startsWith("F"));
    load.value = hit?.load ?? "Mz";
    free();
    return h("div", { class: "one", "data-id": id }, h("label", { class: "check" }, box, name), h("span", { class: "soft note" }, `${number(duration, 4)} s`), h("span", { class: "blows" }, load, arm));
  }

  const hits = () =>
    [...list.children]
      .filter((one) => one.querySelector("[type=checkbox]").checked)
      .map((one) => {
        const [load, arm] = [one.querySelector("select").value, one.querySelector("[name=arm]").value.trim()];
        return { recording: one.dataset.id, load, arm: load.startsWith("F") ? undefined : arm || undefined };
      });

  const asked = () => ({
    hits: hits(),
    mounted_mass: fields.mounted_mass.value.trim(),
    impact: fields.impact.value.trim() || undefined,
    block: fields.block.value.trim() || undefined,
    estimator: fields.estimator.value,
  });

  async function start(event) {
    event.preventDefault();
    if (!hits().length) return announce("Tick one recording of blows or more.", { error: true });
    const body = asked();
    await task.start("Hammer test", () => post("/api/hammers", body), { mass: body.mounted_mass });
  }

  function show(found, { mass }, id) {
    const take = () => {
      correctBy(found.files["frf.csv"], mass);
      announce("Recordings are corrected by this response; state the mass that was on the table in them.");
    };
    const correct = h("div", { class: "bar" }, h("button", { type: "button", class: "primary", onclick: take }, "Correct recordings by it"));
    const [first, ...others] = studyCards("Hammer test", found, id);
    first.append(...(mass ? [correct] : []));
    result.replaceChildren(first, ...others);
  }

  return {
    elements: [card, result],
    offer,
    restore: task.restore,
    /** A hammer test of the library. */
    open: ({ id, name, asked: before }) => task.open({ id, name, context: { mass: before?.mounted_mass ?? "" } }),
    /** The test as a request of an acceptance report states it; undefined where no recording is ticked. */
    asked: () => (hits().length ? asked() : undefined),
  };
}
