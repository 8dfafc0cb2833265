// The craft of a run: its picture, what a window of any length sees of its line of sight, which lines cost that.

import { h, number } from "./dom.js";
import { keep, kept } from "./kept.js";
import { shown } from "./measures.js";
import { picture } from "./tables.js";

const METRICS = { rpe: "RPE", smear: "smear", jitter: "jitter", mpe: "MPE", pde: "PDE", stability: "stability", ape: "APE" };
const RANKS = 8;
const view = { metric: "rpe", decade: -2, ...kept("craft", {}) };

const span = (window) => {
  const [scale, unit] = window < 0.9995e-3 ? [1e6, "µs"] : window < 0.9995 ? [1e3, "ms"] : [1, "s"];
  return `${Number((scale * window).toPrecision(3))} ${unit}`;
};

/** j_n(u) of small u, where the closed forms cancel. */
function series(n, u) {
  let leading = 1;
  for (let k = 1; k <= n; k++) leading *= u / (2 * k + 1);
  return leading * (1 - (u * u) / (4 * n + 6) + u ** 4 / (8 * (2 * n + 3) * (2 * n + 5)));
}

/** Weight of a metric on the mean square of a line, as in microvib.signals.pointing. */
export function weight(metric, frequency, window) {
  const u = Math.PI * frequency * window;
  const j0 = u === 0 ? 1 : Math.sin(u) / u;
  const j1 = u < 0.5 ? series(1, u) : Math.sin(u) / u ** 2 - Math.cos(u) / u;
  const beyond = (first) => [1, 2, 3, 4].filter((n) => n >= first).reduce((sum, n) => sum + (2 * n + 1) * series(n, u) ** 2, 0);
  const change = 4 * Math.sin(u) ** 2;
  return {
    ape: 1,
    mpe: j0 ** 2,
    rpe: u < 0.5 ? beyond(1) : 1 - j0 ** 2,
    smear: 3 * j1 ** 2,
    jitter: u < 0.5 ? beyond(2) : 1 - j0 ** 2 - 3 * j1 ** 2,
    stability: change,
    pde: change * j0 ** 2,
  }[metric];
}

/** Mean squares about both axes of each line, the most costly first, and their sums. */
export function cost(lines, metric, window) {
  const lasting = lines.filter(({ noise }) => !noise); // of what noise drives this is one draw
  const squares = lasting.map(({ line, frequency_hz, los, rings }) => {
    const w = 0.5 * weight(metric, frequency_hz, window);
    const [x, y] = los.map((amplitude) => w * amplitude ** 2);
    return { line, frequency_hz, x, y, radial: x + y, rings };
  });
  const sum = (key) => Math.sqrt(squares.reduce((total, one) => total + one[key], 0));
  return { ranked: squares.sort((a, b) => b.radial - a.radial), x: sum("x"), y: sum("y"), radial: sum("radial") };
}

/** The card of a run on a craft; nothing on a fixed base. */
export function craftOf(run) {
  const craft = run?.result?.craft;
  if (!craft) return [];
  return [
    h(
      "section",
      { class: "card craft" },
      h("div", { class: "bar" }, h("h2", {}, "Spacecraft"), h("span", { class: "soft note" }, craft.words)),
      picture(craft.drawing, "Hub, array at its angle, drive axis and line of sight"),
      craft.lines.some(({ los }) => los) && windowOf(craft),
    ),
  ];
}

function windowOf(craft) {
  const said = h("output", { class: "seen" });
  const ranking = h("ol", { class: "ranking" });
  const slider = h("input", {
    type: "range",
    id: "craft-window",
    min: -4,
    max: 1,
    step: 0.05,
    value: view.decade,
    oninput: () => set({ decade: Number(slider.value) }),
  });
  const metric = h(
    "select",
    { id: "craft-metric", onchange: () => set({ metric: metric.value }) },
    Object.entries(METRICS).map(([key, words]) => h("option", { value: key, selected: key === view.metric }, words)),
  );
  const given = craft.windows.map((window) =>
    h("button", { type: "button", onclick: () => set({ decade: Math.log10(window) }) }, span(window)),
  );

  function set(changes) {
    Object.assign(view, changes);
    keep("craft", view);
    fill();
  }

  function fill() {
    const window = 10 ** view.decade;
    const { ranked, x, y, radial } = cost(craft.lines, view.metric, window);
    const part = ranked.reduce((total, one) => total + (one.rings ? one.radial : 0), 0) / radial ** 2;
    const rings = part > 0.01 ? `; ${number(100 * part, 2)} % of its square rings after the start (steady leaves it out)` : "";
    const noise = craft.noise ? "; noise, which the report has, is left out" : "";
    const pixels = craft.pixel ? `, ${number(radial / craft.pixel, 3)} pixels` : "";
    slider.value = view.decade;
    slider.setAttribute("aria-valuetext", span(window));
    said.textContent =
      `${METRICS[view.metric]} in ${span(window)}: ${shown(radial, "rad")} radial${pixels}` +
      ` (x ${shown(x, "rad")}, y ${shown(y, "rad")}), rms of all lines${rings}${noise}`;
    const top = ranked[0]?.radial || 1;
    ranking.replaceChildren(
      ...ranked.slice(0, RANKS).map((one) =>
        h(
          "li",
          {},
          h("span", {}, `${one.line}, ${number(one.frequency_hz, 4)} Hz${one.rings ? ", rings" : ""}`),
          h("span", { class: "rod", css: { "--share": Math.sqrt(one.radial / top) } }),
          h("span", { class: "n" }, shown(Math.sqrt(one.radial), "rad")),
        ),
      ),
    );
  }

  fill();
  return h(
    "div",
    { class: "window" },
    h(
      "div",
      { class: "bar" },
      h("label", { for: "craft-metric" }, "Line of sight:"),
      metric,
      h("label", { for: "craft-window" }, "in a window of"),
      slider,
      given,
    ),
    said,
    ranking,
  );
}
