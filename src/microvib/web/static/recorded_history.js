// Time history of a recording of any length: each window is asked from the server, as smallest and largest of groups of samples,
// or sample by sample where they fit. Zoomed and moved by mouse, wheel and keys; a part can be marked as the section to process.

import { get } from "./api.js";
import { addCursors } from "./cursors.js";
import { announce, h, unitText } from "./dom.js";
import { keep, kept } from "./kept.js";
import { latest } from "./latest.js";
import { onUnits, sampleAxis } from "./measures.js";
import { draw, envelopeTrace, onZoom, pointsFor } from "./plots.js";
import { LINE, RECORDED } from "./styles.js";

const STEP = 1.25; // of a window's length, for a notch of the wheel
const KEY_STEP = 2;
const FEWEST = 8; // samples of the smallest window
const DRAGS = { zoom: "Zoom", pan: "Move", select: "Mark a section" };

/** The card; `onSection([from, to])` hears what was marked [s]. */
export function makeHistory(onSection) {
  const view = { channel: null, window: null, y: null, drag: "zoom", ...kept("recorded.history", {}) };
  const plot = h("div", { class: "plot", id: "recorded-history-plot", role: "img", "aria-label": "Time history of the recording" });
  const channel = h("select", { id: "recorded-history-channel", onchange: () => set({ channel: channel.value, y: null }) });
  const note = h("span", { class: "soft note" });
  const button = (text, action, title) => h("button", { type: "button", onclick: action, title, "aria-label": title }, text);
  const drags = Object.entries(DRAGS).map(([name, text]) => h("button", { type: "button", "data-drag": name, onclick: () => set({ drag: name }) }, text));
  const mark = button("Section = what is seen", () => onSection(span()));
  const bar = h(
    "div",
    { class: "bar" },
    h("h2", {}, "Time history"),
    h("label", { for: "recorded-history-channel", class: "away" }, "Channel"),
    channel,
    h("span", { role: "group", "aria-label": "What dragging does", class: "bar" }, drags),
    button("Whole record", () => set({ window: null, y: null })),
    button("−", () => zoom(KEY_STEP), "See more time"),
    button("+", () => zoom(1 / KEY_STEP), "See less time"),
    button("‹", () => move(-0.5), "Earlier"),
    button("›", () => move(0.5), "Later"),
    mark,
    note,
  );
  const card = h("section", { class: "card" }, bar, plot);
  const asking = latest();
  let recording = null;
  let section = null;
  let listening = false;
  addCursors(plot, "time");
  const holder = plot.parentElement;
  // What arrives while something is dragged waits: a redraw would move the axis below the pointer.
  let released = Promise.resolve();
  holder.addEventListener("pointerdown", () => (released = new Promise((done) => window.addEventListener("pointerup", () => setTimeout(done), { once: true, capture: true }))), true);
  holder.addEventListener("keydown", keys);
  holder.addEventListener("wheel", wheel, { passive: false });
  holder.title = "Wheel: zoom, with Shift move, after a click here or with Ctrl. Keys: + − zoom, PageUp PageDown move, Home whole record";
  onUnits(() => set({ y: null }));

  const span = () => view.window ?? [0, recording.duration];

  function set(changes) {
    Object.assign(view, changes);
    keep("recorded.history", view);
    return update().catch((error) => announce(error.message, { error: true }));
  }

  /** See `factor` times as much, about a time that keeps its place. */
  function zoom(factor, about = null) {
    const [from, to] = span();
    const centre = about ?? (from + to) / 2;
    const length = Math.min(Math.max((to - from) * factor, FEWEST / recording.sample_rate), recording.duration);
    return moveTo(centre - ((centre - from) / (to - from)) * length, length);
  }

  /** Move by a part of what is seen. */
  function move(part) {
    const [from, to] = span();
    return moveTo(from + part * (to - from), to - from);
  }

  function moveTo(from, length) {
    const start = Math.min(Math.max(from, 0), recording.duration - length);
    return set({ window: length >= recording.duration ? null : [start, start + length] });
  }

  function keys(event) {
    if (event.target !== holder || !recording || event.ctrlKey || event.altKey || event.metaKey) return;
    const action = {
      "+": () => zoom(1 / KEY_STEP),
      "-": () => zoom(KEY_STEP),
      PageUp: () => move(-0.5),
      PageDown: () => move(0.5),
      Home: () => set({ window: null, y: null }),
    }[event.key === "=" ? "+" : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  // A page that is being scrolled must not stop here: the wheel is the plot's once it has been clicked, or with Ctrl.
  function wheel(event) {
    const { xaxis, _size: size } = plot._fullLayout ?? {};
    if (!xaxis || !recording || !(event.ctrlKey || holder.contains(document.activeElement))) return;
    event.preventDefault();
    const turned = Math.sign(event.deltaY || event.deltaX);
    if (event.shiftKey) return move(0.15 * turned);
    const across = event.clientX - plot.getBoundingClientRect().left - size.l;
    return zoom(STEP ** turned, xaxis.p2d(across));
  }

  async function update() {
    if (!recording) return;
    const [from, to] = span();
    const id = recording.id;
    const query = { channel: view.channel, from, to, points: pointsFor(plot, 1) };
    await asking(
      (signal) => get(`/api/recordings/${id}/series`, query, { signal }),
      async (series) => {
        await released;
        if (series.start === span()[0] && series.stop === span()[1]) await show(series);
      },
    );
  }

  async function show(series) {
    const { factor, printed } = sampleAxis(series.unit);
    const unit = printed ?? unitText(series.unit);
    const { x, y } = envelopeTrace(series.t, series, series.exact);
    const curve = {
      x,
      y: factor === 1 ? y : y.map((value) => (value === null ? null : factor * value)),
      name: view.channel,
      mode: "lines",
      line: { color: RECORDED, width: 1 },
      hovertemplate: `%{x:.7g} s<br>%{y:.5g} ${unit}<extra></extra>`,
    };
    for (const one of drags) one.setAttribute("aria-pressed", String(one.dataset.drag === view.drag));
    note.textContent = series.exact ? "every sample" : "smallest and largest of each stretch";
    await draw(plot, [curve], {
      xaxis: { title: { text: "time [s]" }, range: span(), hoverformat: ".7g" },
      yaxis: { title: { text: `${view.channel}${unit ? ` [${unit}]` : ""}` }, range: view.y ?? undefined },
      dragmode: view.drag,
      selectdirection: "h",
      selections: [],
      shapes: marks(),
      showlegend: false,
    });
    plot.dataset.shown = `${span().join(" ")} ${view.channel}`;
    if (listening) return;
    listening = true;
    onZoom(plot, ({ x: window = view.window, y: range = view.y }) => set({ window: within(window), y: range }));
    plot.on("plotly_selected", (event) => event?.range?.x && onSection(within([...event.range.x].sort((a, b) => a - b))));
  }

  const within = (window) => window && [Math.max(window[0], 0), Math.min(window[1], recording.duration)];

  /** The section that is to be processed. */
  function marks() {
    if (!section) return [];
    const [x0, x1] = [section[0] ?? 0, section[1] ?? recording.duration];
    return [{ type: "rect", x0, x1, yref: "paper", y0: 0, y1: 1, fillcolor: LINE, opacity: 0.13, line: { width: 0 }, layer: "below" }];
  }

  return {
    card,
    /** Show a recording, from its whole on unless it is the one that was shown. */
    open: (answer, chosen, marked) => {
      const same = recording?.id === answer.id || view.id === answer.id;
      recording = answer;
      section = marked;
      channel.replaceChildren(...answer.channels.map(({ name }) => h("option", { value: name }, name)));
      const there = answer.channels.some(({ name }) => name === view.channel);
      const next = { id: answer.id, channel: same && there ? view.channel : chosen, ...(same ? {} : { window: null, y: null }) };
      channel.value = next.channel;
      return set(next);
    },
    /** Mark a section, [from, to] in seconds, either null for an end of the record; null for none. */
    mark: (marked) => {
      section = marked;
      return set({});
    },
  };
}
