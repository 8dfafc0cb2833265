// Two runs against one limit, and which of them is quieter: by its worst line and by the RMS of its lines in a band, where both
// are assessed and differ by more than their uncertainty.

import { DASH, fixed, h } from "./dom.js";
import { latest } from "./latest.js";
import * as limit from "./limit.js";
import { onUnits, shown } from "./measures.js";
import * as runs from "./runs.js";

// The largest limit there is, above every line: a run that is not judged against it has lines that its record does not show.
const NO_LIMIT = "1e5 N*m";
const asking = latest();
const place = h("div", { id: "ab-verdict", role: "status" });
export { place };
let last = null;

/** Which of two levels is lower: "A", "B", or "" where they may be the same. */
export function lower(a, b) {
  if (a.most !== null && a.most < b.least) return "A";
  if (b.most !== null && b.most < a.least) return "B";
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
  const [of, other] = [a, b].map(({ looked }) => looked.levels);
  const gaps = [["A", a], ["B", b]].flatMap(([name, { looked }]) => looked.gaps.map((gap) => `${name}: ${gap}`));
  if (!of || !other) gaps.push("which run is quieter, since the lines of two drives are not added up here");
  const where = Number.isFinite(band[1]) ? `from ${band[0]} to ${band[1]} Hz` : "at all frequencies";
  const pairs = of && other ? [["worst line", of.largest, other.largest], ["RMS of the lines", of.rms, other.rms]] : [];
  const rows = pairs.map(([what, x, y]) => row(what, [level(x, what), level(y, what)], gaps.length ? judged("not judged") : quieter(x, y)));
  const against = asked ? [row("against the limit", [a, b].map(({ judged: { verdict, text } }) => judged(verdict, text)), both(a.judged, b.judged))] : [];
  const heads = ["", "A", "B", "quieter"].map((head) => h("th", { scope: "col" }, head));
  place.replaceChildren(
    h("table", {}, h("caption", { class: "away" }, "Which run is quieter"), h("thead", {}, h("tr", {}, heads)), h("tbody", {}, against, rows)),
    h("p", { class: "soft note" }, `Lines ${where}. In brackets what each may be: two standard uncertainties of its estimate and the integration's error each way, and what a line that is masked may have; what the model leaves out is not in it.`),
    gaps.length ? h("p", { class: "unclear note" }, `Not judged: ${gaps.join("; ")}`) : "",
  );
}

const row = (what, cells, last) => h("tr", {}, h("th", { scope: "row" }, what), cells.map((cell) => h("td", {}, cell)), h("td", { "data-key": "quieter" }, last));
const judged = (verdict, title = "") => h("b", { class: limit.KINDS[verdict], title }, verdict);

function level({ line, value, least, most }, what) {
  const text = (torque) => (torque !== null ? shown(torque, "N*m", 4, { line: what === "worst line" }) : DASH);
  return `${line} ${text(value)} (${text(least)} to ${text(most)})`.trim();
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
  const span = small.least > 0 && large.most !== null ? ` (${decibel(large.least, small.most)} to ${decibel(large.most, small.least)})` : "";
  return `${which}, by ${decibel(large.value, small.value)} dB${span}`;
}

onUnits(() => last && place.isConnected && update(...last));
