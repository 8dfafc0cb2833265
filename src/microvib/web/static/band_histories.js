// Time histories of bands, each with its limit: a strip for each band, on one time.

import { get } from "./api.js";
import { announce, h, unitText } from "./dom.js";
import { latest } from "./latest.js";
import { onUnits, sampleAxis } from "./measures.js";
import { draw, envelopeTrace, onZoom, pointsFor } from "./plots.js";
import { LIMIT, LINE, RECORDED } from "./styles.js";
import { partContent } from "./tables.js";

const STRIP = 118; // pixels of a band, of which a part is its gap
const AROUND = 70;
const GAP = 0.16;
const MOST = 12; // bands that are drawn

/** The card. */
export function makeBands() {
  const plot = h("div", { class: "plot", id: "bands-plot", role: "img", "aria-label": "Time histories of the bands" });
  const words = h("div", {});
  const note = h("span", { class: "soft note" });
  const all = h("button", { type: "button", onclick: () => see(null) }, "All");
  const card = h("section", { class: "card", id: "bands", hidden: true }, h("div", { class: "bar" }, h("h2", {}, "Bands with a limit each"), all, note), words, plot);
  const asking = latest();
  let shown = null;
  let span = null;
  let listening = false;
  onUnits(() => update());

  function see(x) {
    span = x;
    return update();
  }

  async function update() {
    if (!shown) return;
    const { id, bands, section } = shown;
    const drawn = bands.map((band, k) => ({ ...band, k })).filter((band) => band.span).slice(0, MOST);
    const [from, to] = span ?? section;
    const ask = (band, signal) =>
      get(`/api/analyses/${id}/bands/${band.k}`, { from: from - band.span[0], to: to - band.span[0], points: pointsFor(plot, 1) }, { signal });
    await asking(
      (signal) => Promise.all(drawn.map((band) => ask(band, signal))),
      (series) => show(drawn, series, [from, to]),
    ).catch((error) => announce(error.message, { error: true }));
  }

  async function show(drawn, series, [from, to]) {
    plot.hidden = !drawn.length;
    if (!drawn.length) return;
    const place = (k) => [1 - (k + 1 - GAP) / drawn.length, 1 - k / drawn.length];
    const axes = Object.fromEntries(drawn.map((band, k) => [`yaxis${k ? k + 1 : ""}`, { domain: place(k), title: { text: titleOf(band), font: { size: 10.5 } }, nticks: 5 }]));
    plot.style.height = `${STRIP * drawn.length + AROUND}px`;
    await draw(plot, drawn.flatMap((band, k) => curves(band, series[k], k)), {
      height: STRIP * drawn.length + AROUND,
      xaxis: { title: { text: "time [s]" }, range: [from, to], anchor: `y${drawn.length > 1 ? drawn.length : ""}`, hoverformat: ".7g" },
      ...axes,
      shapes: drawn.flatMap(limits),
      annotations: drawn.map(verdict),
      showlegend: false,
    });
    note.textContent = series.every((one) => one.exact) ? "every sample" : "smallest and largest of each stretch";
    if (!listening) onZoom(plot, ({ x }) => x !== undefined && see(x));
    listening = true;
  }

  return {
    card,
    /** Show the bands of an analysis, {id, bands, section, parts}; nothing without any. */
    show: (analysis) => {
      shown = analysis?.bands.length ? analysis : null;
      span = null;
      card.hidden = !shown;
      const parts = (shown?.parts ?? []).filter(({ title }) => title.startsWith("Peaks in bands")).flatMap(partContent);
      const within = shown?.section[0] > 0 && h("p", { class: "soft" }, "Times in the table count from the first sample of the section, those below from the record's.");
      words.replaceChildren(...parts, ...(within ? [within] : []));
      return update();
    },
  };
}

const plain = (value) => String(Number(value.toPrecision(5)));
const axisOf = (k) => `y${k ? k + 1 : ""}`;
const scaleOf = (band) => sampleAxis(band.unit);
const titleOf = (band) => `${plain(band.low)}–${plain(band.high)} Hz<br>${band.channel} [${scaleOf(band).printed ?? unitText(band.unit)}]`;

function curves(band, series, k) {
  const { factor } = scaleOf(band);
  const { x, y } = envelopeTrace(series.t, series, series.exact);
  const line = { mode: "lines", name: `${plain(band.low)}–${plain(band.high)} Hz`, line: { color: RECORDED, width: 1 } };
  return [
    { ...line, x: x.map((t) => t + band.span[0]), y: y.map((value) => factor * value), yaxis: axisOf(k), hovertemplate: "%{x:.7g} s<br>%{y:.4g}<extra></extra>" },
    { mode: "markers", name: "peak", x: [band.time], y: [factor * band.peak], yaxis: axisOf(k), marker: { color: LINE, size: 6 }, hovertemplate: "largest magnitude<br>%{x:.7g} s<br>%{y:.4g}<extra></extra>" },
  ];
}

const limits = (band, k) =>
  [1, -1].map((sign) => ({
    type: "line",
    xref: "paper",
    x0: 0,
    x1: 1,
    yref: axisOf(k),
    y0: sign * scaleOf(band).factor * band.limit,
    y1: sign * scaleOf(band).factor * band.limit,
    line: { color: LIMIT, width: 1.6, dash: "dash" },
  }));

const WORDS = { pass: "pass", fail: "FAIL", "not judged": "not judged" };
const verdict = (band, k) => ({
  xref: "paper",
  x: 1,
  xanchor: "right",
  yref: `${axisOf(k)} domain`,
  y: 1,
  yanchor: "bottom",
  showarrow: false,
  font: { size: 10.5, ...(band.verdict === "fail" ? { color: LIMIT } : {}) },
  text: `<b>${WORDS[band.verdict]}</b>, limit ${plain(scaleOf(band).factor * band.limit)}`,
});
