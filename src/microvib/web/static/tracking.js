// Order tracking of a sweep: which orders, by which speed; their cuts against a limit, the order map, the waterfall with the orders' paths.

import { post } from "./api.js";
import { h, unitText } from "./dom.js";
import { keep, keepFields, kept } from "./kept.js";
import { amplitudeAxis, onUnits } from "./measures.js";
import { draw, ink } from "./plots.js";
import { makeTask } from "./progress.js";
import * as scenario from "./scenario.js";
import { LIMIT, style } from "./styles.js";
import { partContent } from "./tables.js";
import { heat, makeWaterfall } from "./waterfall.js";

const REFERENCES = {
  scenario: "the scenario on the left",
  profile: "a stated profile",
  tacho: "a tacho channel",
  speed: "a speed channel",
  strongest: "the strongest order of the record",
};
const ALONG = { speed: "speed", frequency: "frequency", time: "time" };
const MOST = 8; // cuts that are drawn, the largest ones
const NAMED_AT = 0.9; // part of an order's way at which its name stands
const BAND = 2; // standard uncertainties of the band about a cut

/** The part of the page; `evidence()` gives {recording, channel, channels} and the section when it is asked. */
export function makeTracking(evidence) {
  const text = (name, attributes) => h("input", { type: "text", name, id: `tracking-${name}`, spellcheck: "false", ...attributes });
  const select = (name, words, attributes) => h("select", { name, id: `tracking-${name}`, ...attributes }, Object.entries(words).map(([value, label]) => h("option", { value }, label)));
  const fields = {
    orders: text("orders", { value: "1,4,64,128", title: "Cycles per revolution of the reference; of a scenario per electrical period" }),
    reference: select("reference", REFERENCES, { onchange: () => ask() }),
    profile: h("textarea", { name: "profile", id: "tracking-profile", rows: 2, placeholder: "0 s:10 Hz, 5 s:40 Hz", spellcheck: "false", title: "Points TIME:SPEED (Hz, rpm or deg/s), or the lines of a table with times and speeds, pasted" }),
    channel: select("reference-channel", {}),
    pulses: text("pulses_per_rev", { value: "1", class: "short" }),
    strongest: text("strongest", { value: "1", class: "short" }),
    clock: select("clock", { found: "found in the record", stated: "as stated" }),
    fixed: text("fixed", { placeholder: "50 Hz, 1.19 Hz", title: "Lines that do not follow the speed, told from the orders that cross them" }),
    bandwidth: text("bandwidth", { placeholder: "by the orders" }),
    limit: h("textarea", { name: "limit", id: "tracking-limit", rows: 2, placeholder: "such as 60 mN*m", spellcheck: "false", title: "A torque, or the lines of a table of a limit over frequency (CSV), pasted" }),
  };
  const labels = Object.fromEntries(
    Object.entries({
      orders: "orders",
      reference: "speed by",
      profile: "profile",
      channel: "channel",
      pulses: "pulses per revolution",
      strongest: "its order",
      clock: "clock",
      fixed: "fixed lines",
      bandwidth: "bandwidth",
      limit: "limit",
    }).map(([name, words]) => [name, h("label", {}, words, fields[name])]),
  );
  const place = h("div", {});
  const task = makeTask("tracking", place, show);
  const asked = h("section", { class: "card", id: "tracking" }, h("h2", {}, "Order tracking"), h("p", { class: "soft" }, "Of a rate sweep: how large each order is at each speed. The section above counts here, too."), h("div", { class: "ask" }, Object.values(labels), h("button", { type: "button", class: "primary", onclick: start }, "Track orders")), place);
  const cuts = makeCuts();
  const map = makeOrderMap();
  const waterfall = makeWaterfall("tracking-waterfall", "Waterfall of the sweep, with the orders", paths);
  const words = h("section", { class: "card", hidden: true });
  keepFields("tracking.asked", fields);
  ask();

  function ask() {
    const { value } = fields.reference;
    labels.profile.hidden = value !== "profile";
    labels.channel.hidden = !["tacho", "speed"].includes(value);
    labels.pulses.hidden = value !== "tacho";
    labels.strongest.hidden = value !== "strongest";
    labels.clock.hidden = !["scenario", "profile"].includes(value);
    const { channels } = evidence();
    const chosen = fields.channel.value;
    fields.channel.replaceChildren(...channels.map((name) => h("option", { value: name }, name)));
    if (channels.includes(chosen)) fields.channel.value = chosen;
  }

  function reference() {
    const { value } = fields.reference;
    if (value === "scenario") return { scenario: scenario.current(), clock: fields.clock.value };
    if (value === "profile") return { profile: fields.profile.value, clock: fields.clock.value };
    if (value === "tacho") return { tacho: fields.channel.value, pulses_per_rev: numeric(fields.pulses.value) };
    if (value === "speed") return { speed: fields.channel.value };
    return { strongest: numeric(fields.strongest.value) };
  }

  function start() {
    const { recording, channel, section } = evidence();
    const fixed = fields.fixed.value.split(",").map((one) => one.trim()).filter(Boolean);
    const body = { recording, channel, ...section, orders: fields.orders.value, ...reference(), fixed, bandwidth: fields.bandwidth.value.trim() || undefined, limit: fields.limit.value.trim() ? fields.limit.value : undefined };
    return task.start("Order tracking", () => post("/api/trackings", body));
  }

  function show(answer, _, id) {
    const result = { ...answer, id };
    words.hidden = false;
    const [first, ...others] = result.parts;
    words.replaceChildren(h("h2", {}, "Orders of the sweep"), ...partContent(first), ...others.flatMap((part) => titled(part)));
    return Promise.all([cuts.show(result), map.show(result), waterfall.show(result, result.waterfall)]);
  }

  function leave() {
    task.leave();
    words.hidden = true;
    cuts.show(null);
    map.show(null);
    waterfall.show(null);
  }

  return { cards: [asked, cuts.card, words, map.card, waterfall.card], restore: task.restore, open: task.open, leave, refresh: ask };
}

const numeric = (words) => (Number.isFinite(Number(words)) && words.trim() ? Number(words) : words);

function titled(part) {
  const content = partContent(part);
  const drawn = ["Order map", "Waterfall", "Phases"].includes(part.title); // pictures that the page draws itself
  return content.length && !drawn ? [h("h3", {}, part.title), ...content] : [];
}

const nameOf = ({ order, label }) => (order === null ? `line at ${label}` : `order ${label}`);

/** The largest cuts, in their order. */
function largest(cuts) {
  const size = ({ amplitude, known }) => Math.max(...amplitude.map((value, k) => (known[k] ? value : 0)));
  const first = [...cuts].sort((a, b) => size(b) - size(a)).slice(0, MOST);
  return cuts.filter((cut) => first.includes(cut));
}

/** Amplitudes of the orders over speed, frequency or time, with their limit; where an order is not told its curve is broken. */
function makeCuts() {
  const plot = h("div", { class: "plot tall", id: "cuts-plot", role: "img", "aria-label": "Order cuts" });
  const along = h("select", { "aria-label": "Axis of the order cuts", id: "cuts-along", onchange: () => (keep("cuts.along", along.value), update()) }, Object.entries(ALONG).map(([value, words]) => h("option", { value }, `over ${words}`)));
  const log = h("button", { type: "button", onclick: () => press() }, "log amplitude");
  along.value = kept("cuts.along", "speed");
  let isLog = kept("cuts.log", false);
  const card = h("section", { class: "card", hidden: true }, h("div", { class: "bar" }, h("h2", {}, "Order cuts"), along, log, h("span", { class: "soft note" }, "bands: two standard uncertainties")), plot);
  let shown = null;
  onUnits(() => update());

  function press() {
    isLog = !isLog;
    keep("cuts.log", isLog);
    return update();
  }

  function update() {
    if (!shown) return;
    const axis = amplitudeAxis(shown.unit);
    const unit = axis.printed ?? unitText(shown.unit);
    log.hidden = axis.dB;
    log.setAttribute("aria-pressed", String(isLog));
    const curve = along.value === "frequency" ? shown.limit_curve : [];
    const traces = largest(shown.cuts).flatMap((cut, k) => curves({ ...cut, limit: curve.length ? null : cut.limit }, k, along.value, axis, unit));
    if (curve.length) traces.push({ x: curve.map(([f]) => f), y: curve.map(([, most]) => axis.y(most)), mode: "lines", name: "limit", line: { color: LIMIT, width: 1.6, dash: "dash" }, hovertemplate: `limit<br>%{x:.5g} Hz<br>%{y:.4g} ${unit}<extra></extra>` });
    return draw(plot, traces, {
      xaxis: { title: { text: { speed: `speed [${shown.reference}s per second]`, frequency: "frequency [Hz]", time: "time [s]" }[along.value] } },
      yaxis: { title: { text: `amplitude [${unit}], ${axis.words}` }, ...(axis.dB ? {} : isLog ? { type: "log", dtick: 1 } : { rangemode: "tozero" }) },
      showlegend: true,
    });
  }

  return {
    card,
    show: (result) => {
      shown = result;
      card.hidden = !result;
      return update();
    },
  };
}

function curves(cut, k, along, axis, unit) {
  const [color, dash] = style(k);
  const x = cut[along];
  const told = (values) => values.map((value, i) => (cut.known[i] && value !== null ? axis.y(value) : null));
  const least = Math.max(...cut.amplitude) * 1e-6;
  const edge = (sign) => told(cut.amplitude.map((value, i) => Math.max(value + sign * BAND * cut.uncertainty[i], least)));
  const band = { mode: "lines", line: { width: 0 }, showlegend: false, hoverinfo: "skip", legendgroup: cut.label, connectgaps: false };
  const line = { x, y: told(cut.amplitude), mode: "lines", name: nameOf(cut), legendgroup: cut.label, line: { color, dash, width: 1.6 }, customdata: cut.frequency, connectgaps: false, hovertemplate: `%{x:.5g}<br>%{y:.4g} ${unit}<br>at %{customdata:.5g} Hz<extra>%{fullData.name}</extra>` };
  const allowed = cut.limit && { x, y: cut.limit.map((value) => (value === null ? null : axis.y(value))), mode: "lines+markers", marker: { size: 0.1 }, name: along === "frequency" ? "limit" : `limit of ${nameOf(cut)}`, legendgroup: along === "frequency" ? "limit" : `limit ${cut.label}`, showlegend: along !== "frequency" || k === 0, line: { color: along === "frequency" ? LIMIT : color, width: 1.4, dash: "dash" }, hovertemplate: `limit<br>%{y:.4g} ${unit}<extra></extra>` };
  return [{ ...band, x, y: edge(-1), name: "" }, { ...band, x, y: edge(1), name: "", fill: "tonexty", fillcolor: translucent(color) }, line, ...(allowed ? [allowed] : [])];
}

/** A colour as a band has it. */
const translucent = (color) => (color.startsWith("#") ? `${color}33` : color.replace(")", " / 0.2)"));

/** Amplitude over order and speed. */
function makeOrderMap() {
  const plot = h("div", { class: "plot tall", id: "order-map-plot", role: "img", "aria-label": "Order map" });
  const note = h("span", { class: "soft note" });
  const card = h("section", { class: "card", hidden: true }, h("div", { class: "bar" }, h("h2", {}, "Order map"), note), plot);
  let shown = null;
  onUnits(() => update());

  function update() {
    if (!shown) return;
    const { order, time, speed, amplitude, made } = shown.order_map;
    const way = speed.map((value, k) => Math.sign(value - speed[k - 1] || 0));
    const oneWay = way.every((step) => step >= 0) || way.every((step) => step <= 0);
    const rows = speed.map((_, k) => k).sort((a, b) => (oneWay ? speed[a] - speed[b] : a - b));
    const y = rows.map((k) => (oneWay ? speed[k] : time[k]));
    note.textContent = made;
    return draw(plot, [heat(order, y, rows.map((k) => amplitude[k]), shown.unit, { x: `per ${shown.reference}`, y: oneWay ? "Hz" : "s" })], {
      xaxis: { title: { text: `order of the ${shown.reference}` } },
      yaxis: { title: { text: oneWay ? `speed [${shown.reference}s per second]` : "time [s]" } },
      shapes: shown.cuts.filter(({ order: k }) => k !== null).map(({ order: k }) => ({ type: "line", x0: k, x1: k, yref: "paper", y0: 0, y1: 0.04, line: { color: ink(), width: 2 } })),
      showlegend: false,
    });
  }

  return {
    card,
    show: (result) => {
      shown = result;
      card.hidden = !result;
      return update();
    },
  };
}

/** Ways of the orders through the waterfall, with their names near their ends. */
function paths({ cuts }) {
  const shown = largest(cuts);
  const traces = shown.map((cut) => ({
    x: cut.frequency,
    y: cut.time,
    mode: "lines",
    name: nameOf(cut),
    line: { color: "#fff", width: 1, dash: "dash" },
    hovertemplate: `${nameOf(cut)}<br>%{x:.5g} Hz<br>%{y:.5g} s<extra></extra>`,
  }));
  const annotations = shown.map((cut) => {
    const k = Math.floor(NAMED_AT * cut.time.length);
    return { x: cut.frequency[k], y: cut.time[k], text: cut.label, ax: 26, ay: 10, arrowhead: 0, arrowwidth: 1, arrowcolor: "#fff", bgcolor: "#fff", borderpad: 1, font: { size: 11, color: "#1c2330" } };
  });
  return { traces, annotations };
}
