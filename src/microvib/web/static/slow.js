// Slow motion: the drawing at instants of four microsteps, by hand or played.

import { announce, fixed, h } from "./dom.js";
import { latest } from "./latest.js";
import * as runs from "./runs.js";

const CHANNELS = ["T_e", "T_f_m", "T_g", "T_f", "T_l", "T_d", "u_A", "i_A", "theta_m", "stuck_rotor", "stuck_output"];
const MICROSTEPS = 4;
const FRAME = 60;

/** The bar under the drawing; `show` gets the channels at an instant, or null for the means of the record. */
export function makeSlowMotion(show) {
  let stretch = null;
  let timer = null;
  const asking = latest();
  const play = h("button", { type: "button", onclick: () => (timer ? stop() : start()) }, "▶ Slow motion");
  const place = h("input", {
    type: "range",
    min: 0,
    value: 0,
    "aria-label": "Instant of the record",
    oninput: () => seek(Number(place.value)),
  });
  const time = h("span", { class: "soft" });
  const means = h("button", { type: "button", onclick: reset }, "Means");
  const bar = h("div", { class: "bar slow", hidden: true }, play, place, time, means);
  let mine = null; // what it is of
  const done = () => (runs.selected()?.state === "done" ? runs.selected().result : null);
  runs.onChange(() => mine !== done() && reset());
  return bar;

  function reset() {
    stop();
    asking.forget();
    stretch = null;
    mine = done();
    bar.hidden = !mine;
    for (const part of [place, time, means]) part.hidden = true;
    show(null);
  }

  async function start() {
    if (stretch) return run();
    const chosen = runs.selected();
    const { t0, drivetrain } = chosen.result;
    const to = t0 + MICROSTEPS / (drivetrain.f_d || 50);
    const query = { channels: CHANNELS.join(","), from: t0, to, points: 600 };
    const question = (signal) => runs.ask(chosen, "series", query, { signal });
    await asking(question, begin).catch((error) => announce(error.message, { error: true }));
  }

  function begin(found) {
    stretch = found;
    place.max = stretch.t.length - 1;
    for (const part of [place, time, means]) part.hidden = false;
    run();
  }

  function run() {
    stop();
    play.textContent = "❚❚ Pause";
    timer = setInterval(() => seek((Number(place.value) + 1) % stretch.t.length), FRAME);
  }

  function stop() {
    clearInterval(timer);
    timer = null;
    play.textContent = "▶ Slow motion";
  }

  function seek(k) {
    place.value = k;
    time.textContent = `${fixed(stretch.t[k], 4)} s`;
    const { channels } = stretch;
    const now = Object.fromEntries(CHANNELS.map((name) => [name, channels[name].min[k]]));
    now.theta_m -= channels.theta_m.min[0];
    show(now);
  }
}
