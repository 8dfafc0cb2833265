// Two runs against one limit, and which of them is quieter: by its worst line and by the RMS of its lines in a band, where both were
// looked at and differ by more than is uncertain.

import { DASH, fixed, h } from "./dom.js";
import { latest } from "./latest.js";
import * as limit from "./limit.js";
import { onUnits, shown } from "./measures.js";
import * as runs from "./runs.js";

const COVERAGE = 2; // standard uncertainties each way
const HIDDEN = 10; // what a line that others hide may have at most, over the amplitude of its bin, as limits take it
const NO_LIMIT = "1e6 N*m"; // above every line: what is not judged against it was not looked at
const GONE = ["below the floor", "not in a steady state", "transient"];
const asking = latest();
const place = h("div", { id: "ab-verdict", role: "status" });
export { place };
let last = null;

/** Least and most that a line may have; `known` where it has an amplitude of its own. */
function bounds(line) {
  const { amplitude_n_m: a, amplitude_uncertainty_n_m: u, bin_amplitude_n_m: bin, status } = line;
  if (GONE.includes(status)) return null;
  if (a === null || /^not separable/.test(status)) return { line: line.line, value: null, low: 0, high: HIDDEN * (bin ?? Infinity) };
  const off = COVERAGE * (u ?? 0);
  return { line: line.line, value: a, low: /^(decaying|growing)/.test(status) ? 0 : Math.max(a - off, 0), high: a + off };
}

/** Worst line, and RMS of the lines, between two frequencies, each {value, low, high}. */
export function levels(lines, [from, to]) {
  const place = ({ frequency_hz: f, expected_hz: expected }) => f ?? expected;
  const inside = lines.filter((line) => place(line) >= from && place(line) <= to);
  const found = inside.map(bounds).filter(Boolean);
  const known = found.filter(({ value }) => value !== null);
  const largest = known.reduce((most, line) => (line.value > (most?.value ?? 0) ? line : most), null);
  const most = (key) => Math.max(0, ...found.map((one) => one[key]));
  const rms = (key) => Math.sqrt(found.reduce((sum, one) => sum + (one[key] ?? 0) ** 2 / 2, 0));
  return {
    worst: { name: largest?.line ?? "", value: largest?.value ?? 0, low: most("low"), high: most("high") },
    rms: { name: "", value: rms("value"), low: rms("low"), high: rms("high") },
  };
}

/** Which of two levels is lower: "A", "B", or "" where they may be the same. */
export function lower(a, b) {
  if (a.high < b.low) return "A";
  if (b.high < a.low) return "B";
  return "";
}

export async function update(a, b) {
  last = [a, b];
  const { limit: asked, band } = limit.query();
  const of = async (run) => ({
    run,
    looked: await runs.ask(run, "verdict", { limit: NO_LIMIT, band }),
    judged: asked ? await runs.ask(run, "verdict", { limit: asked, band }) : null,
  });
  try {
    await asking(() => Promise.all([of(a), of(b)]), ([one, other]) => show(one, other, asked));
  } catch (error) {
    place.replaceChildren(h("p", { class: "error" }, error.message));
  }
}

function show(a, b, asked) {
  const band = [a.looked.low, a.looked.high ?? Infinity];
  const [of, other] = [a, b].map(({ run }) => levels(run.result.lines, band));
  const gaps = [["A", a], ["B", b]].flatMap(([name, { looked }]) => looked.gaps.map((gap) => `${name}: ${gap}`));
  const where = Number.isFinite(band[1]) ? `from ${band[0]} to ${band[1]} Hz` : "at all frequencies";
  const rows = [
    ["worst line", of.worst, other.worst],
    ["RMS of the lines", of.rms, other.rms],
  ].map(([what, x, y]) => row(what, [level(x, what), level(y, what)], gaps.length ? judged("not judged") : quieter(x, y)));
  const against = asked ? [row("against the limit", [a, b].map(({ judged: { verdict, text } }) => judged(verdict, text)), both(a.judged, b.judged))] : [];
  const heads = ["", "A", "B", "quieter"].map((head) => h("th", { scope: "col" }, head));
  place.replaceChildren(
    h("table", {}, h("caption", { class: "away" }, "Which run is quieter"), h("thead", {}, h("tr", {}, heads)), h("tbody", {}, against, rows)),
    h("p", { class: "soft note" }, `Lines ${where}. In brackets what each may be: two standard uncertainties of its estimate each way, and ten times its bin of a line that others hide; what the model leaves out is not in it.`),
    gaps.length ? h("p", { class: "unclear note" }, `Not judged: ${gaps.join("; ")}`) : "",
  );
}

const row = (what, cells, last) => h("tr", {}, h("th", { scope: "row" }, what), cells.map((cell) => h("td", {}, cell)), h("td", { "data-key": "quieter" }, last));
const judged = (verdict, title = "") => h("b", { class: limit.KINDS[verdict], title }, verdict);

function level({ name, value, low, high }, what) {
  const text = (torque) => (Number.isFinite(torque) ? shown(torque, "N*m", 4, { line: what === "worst line" }) : DASH);
  return `${name} ${text(value)} (${text(low)} to ${text(high)})`.trim();
}

/** Which run passes where the other fails; of two that pass or fail alike nothing is said. */
function both({ verdict: a }, { verdict: b }) {
  if (a === b) return DASH;
  if ([a, b].includes("not judged")) return judged("not judged");
  return a === "pass" ? "A passes, B fails" : "B passes, A fails";
}

function quieter(a, b) {
  const which = lower(a, b);
  if (!which) return "no difference beyond the uncertainty";
  const [small, large] = which === "A" ? [a, b] : [b, a];
  const decibel = (x, y) => fixed(20 * Math.log10(x / y), 2);
  const span = small.low > 0 && Number.isFinite(large.high) ? ` (${decibel(large.low, small.high)} to ${decibel(large.high, small.low)})` : "";
  return `${which}, by ${decibel(large.value, small.value)} dB${span}`;
}

onUnits(() => last && place.isConnected && update(...last));
