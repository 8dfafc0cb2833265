// A waterfall: amplitude over frequency and time, in colours over three decades. Each zoom asks the server for that part, as the
// largest amplitude of each cell, so that no line is lost.

import { get } from "./api.js";
import { announce, h, unitText } from "./dom.js";
import { latest } from "./latest.js";
import { amplitudeAxis, onUnits } from "./measures.js";
import { draw, onZoom } from "./plots.js";

const DECADES = 3;

/** Traces and a scale of colours of a map of amplitudes. */
export function heat(x, y, amplitude, unit, words) {
  const axis = amplitudeAxis(unit);
  const largest = amplitude.reduce((most, row) => row.reduce((a, b) => Math.max(a, b), most), 0) || 1e-12;
  const level = (value) => (axis.dB ? axis.y(value) : Math.log10(axis.y(value)));
  const [low, high] = [level(largest * 10 ** -DECADES), level(largest)];
  const printed = axis.printed ?? unitText(unit);
  return {
    type: "heatmap",
    x,
    y,
    z: amplitude.map((row) => row.map((value) => Math.max(level(Math.max(value, 1e-30)), low))),
    customdata: amplitude.map((row) => row.map(axis.y)),
    zmin: low,
    zmax: high,
    colorscale: "Viridis",
    hovertemplate: `%{x:.6g} ${words.x}<br>%{y:.6g} ${words.y}<br>%{customdata:.4g} ${printed}<extra></extra>`,
    colorbar: { title: { text: `${printed}, ${axis.words}`, side: "right" }, thickness: 12, ...ticks(low, high, axis.dB) },
  };
}

function ticks(low, high, dB) {
  if (dB) return {};
  const powers = [];
  for (let power = Math.ceil(low); power <= high; power++) powers.push(power);
  return { tickvals: powers, ticktext: powers.map((power) => String(Number((10 ** power).toPrecision(3)))) };
}

/** A card; `over(result)` are {traces, annotations} over it, by frequency and time. */
export function makeWaterfall(id, title, over = () => ({ traces: [], annotations: [] })) {
  const plot = h("div", { class: "plot taller", id: `${id}-plot`, role: "img", "aria-label": title });
  const note = h("span", { class: "soft note" });
  const all = h("button", { type: "button", onclick: () => see({ x: null, y: null }) }, "All");
  const card = h("section", { class: "card", hidden: true }, h("div", { class: "bar" }, h("h2", {}, title), all, note), plot);
  const asking = latest();
  const view = { x: null, y: null };
  let shown = null;
  let listening = false;
  onUnits(() => update());

  function see(changes) {
    Object.assign(view, changes);
    return update();
  }

  async function update() {
    if (!shown) return;
    const result = shown;
    const [[from, to], [begin, end]] = [view.x ?? [], view.y ?? []];
    await asking(
      (signal) => get(`/api/analyses/${result.id}/waterfall`, { from, to, begin, end }, { signal }),
      async ({ f, t, amplitude }) => {
        const { traces, annotations } = over(result);
        await draw(plot, [heat(f, t, amplitude, result.unit, { x: "Hz", y: "s" }), ...traces], {
          annotations,
          xaxis: { title: { text: "frequency [Hz]" }, range: view.x ?? [f[0], f.at(-1)] },
          yaxis: { title: { text: "time [s]" }, range: view.y ?? [t[0], t.at(-1)] },
          showlegend: false,
        });
        if (!listening) onZoom(plot, ({ x = view.x, y = view.y }) => see({ x, y }));
        listening = true;
      },
    ).catch((error) => announce(error.message, { error: true }));
  }

  return {
    card,
    /** Show that of a result, {id, unit}, or nothing. */
    show: (result, words = "") => {
      Object.assign(view, { x: null, y: null });
      shown = result;
      card.hidden = !result;
      note.textContent = words.split(";")[0];
      return update();
    },
  };
}
