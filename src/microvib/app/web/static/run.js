// The Run tab: chips of the runs, drawing, plots and tables of the chosen one.

import { download } from "./api.js";
import { announce, fixed, h, number, quantity, s, save } from "./dom.js";
import { drawing } from "./drive.js";
import * as history from "./history.js";
import { progressRow } from "./progress.js";
import * as runs from "./runs.js";
import * as scenario from "./scenario.js";
import * as spectrum from "./spectrum.js";
import { shortTable, table } from "./tables.js";

const bars = new Map();
const chips = h("ul", { class: "chips", "aria-label": "Runs" });
const going = h("div", { class: "going", hidden: true });
const head = h("div", { class: "head" });
const picture = h("section", { class: "card drawing" });
const figures = h("div", { class: "figures", hidden: true }, spectrum.card, history.card);
const tables = h("div", {});

const FILES = [["scenario.yaml", "scenario"], ["lines.csv", "lines (CSV)"], ["summary.json", "summary"], ["motion.nc", "data set (netCDF)"], ["report.html", "report (HTML)"], ["report.pdf", "report (PDF)"]];
const TORQUES = {
  T_d: "on the spacecraft", T_e: "motor, on the rotor", T_f_m: "friction of the rotor", T_f: "friction of the output", T_g: "gear, on the output", T_l: "load of the array",
};

export function makeRun(place) {
  place.append(chips, going, head, picture, figures, tables);
  runs.onChange((what) => (what === "progress" ? showProgress() : show()));
  scenario.onCheck(() => !runs.selected()?.result && showDrawing());
  show();
}

async function show() {
  showChips();
  showProgress();
  showDrawing();
  const run = runs.selected();
  head.replaceChildren(...(run?.result ? headOf(run) : run?.error ? [failure(run)] : runs.all().length ? [] : [welcome()]));
  tables.replaceChildren(...(run?.result ? tablesOf(run) : []));
  const shown = runs.shown();
  figures.hidden = !shown.length;
  if (figures.hidden) return;
  await Promise.all([spectrum.update(), history.update()]).catch((error) => announce(error.message, { error: true }));
  performance.mark("run-drawn");
  figures.dataset.drawn = shown.map((item) => item.id).join(" ");
}

function welcome() {
  return h("p", { class: "welcome" }, "Choose a scenario, change what you like, and press ", h("b", {}, "Run"), ". Lines, spectrum and time history appear here; each further run is drawn over the others.");
}

function failure(run) {
  const failed = run.state === "failed";
  return h("p", { class: failed ? "error block" : "soft" }, failed ? `${run.name} failed: ${run.error}` : `${run.name} was cancelled.`);
}

function showDrawing() {
  const run = runs.selected();
  picture.replaceChildren(h("div", { class: "wide", tabindex: "0", role: "region", "aria-label": "Drive train" }, drawing(run?.result, run?.result ? run.values : scenario.checked().values)),
    h("p", { class: "soft note" }, run?.result
      ? "Signed means; ∿ amplitude at the driving frequency f_d, which also sets the arrows' widths (by decades). Each arrow's head is on the body that the torque acts on; positive is one sense about the drive axis. The means on the housing add up to that of T_d."
      : "After a run this drawing carries its voltages, currents and torques."));
}

function showChips() {
  chips.replaceChildren(...runs.all().map((run) => {
    const state = runs.going(run) ? "" : run.state === "done" ? "" : ` (${run.state})`;
    const eye = run.state === "done" && h("button", { class: "eye", "aria-pressed": String(run.visible), title: run.visible ? "Hide in the plots" : "Show in the plots", "aria-label": `Show ${run.name} in the plots`, onclick: () => runs.toggle(run) }, run.visible ? "●" : "○");
    const name = h("button", { class: "name", "aria-pressed": String(run === runs.selected()), title: run.name, onclick: () => runs.choose(run) }, sample(run), h("span", {}, run.name + state));
    const close = h("button", { class: "close", title: "Remove", "aria-label": `Remove ${run.name}`, onclick: () => runs.remove(run) }, "×");
    return h("li", { class: `chip ${run.state}${run === runs.selected() ? " chosen" : ""}` }, eye, name, close);
  }));
}

/** The run's colour and dash, as in the plots. */
function sample(run) {
  const dashes = { solid: "", dash: "7 4", dot: "2 3", dashdot: "7 3 2 3", longdash: "11 4", longdashdot: "11 3 2 3" };
  return s("svg", { width: 26, height: 8, "aria-hidden": "true" }, s("path", { d: "M0 4H26", stroke: run.colour, "stroke-width": 3, "stroke-dasharray": dashes[run.dash] }));
}

/** One bar for each run that is under way; kept in place while it moves, so that its button can be pressed. */
function showProgress() {
  const active = runs.all().filter(runs.going);
  going.hidden = !active.length;
  for (const [id, row] of bars) {
    if (active.some((run) => run.id === id)) continue;
    row.element.remove();
    bars.delete(id);
  }
  for (const run of active) {
    if (!bars.has(run.id)) {
      bars.set(run.id, progressRow(run.name, () => runs.cancel(run)));
      going.append(bars.get(run.id).element);
    }
    bars.get(run.id).show(run);
  }
}

function headOf(run) {
  const { result } = run;
  const top = [...result.lines].filter((line) => line.amplitude_n_m !== null && line.status !== "below the floor").sort((a, b) => b.amplitude_n_m - a.amplitude_n_m);
  const facts = [["largest T_d", quantity(result.drivetrain.T_d.peak, "N*m", 4)], ["RMS of T_d", quantity(result.drivetrain.T_d.rms, "N*m", 4)],
    ...top.slice(0, 2).map((line) => [`${line.line} at ${number(line.frequency_hz, 5)} Hz`, quantity(line.amplitude_n_m, "N*m", 4)])];
  return [h("div", { class: "facts" }, h("h2", {}, result.title || run.name), ...facts.map(([words, value]) => h("div", {}, h("b", {}, value), h("span", {}, words))), menu(run))];
}

function menu(run) {
  const links = FILES.map(([file, words]) => h("a", { href: `/api/runs/${run.id}/files/${file}`, download: file, onclick: (event) => file === "report.pdf" && fetched(event, run, file) }, words));
  return h("details", { class: "menu" }, h("summary", { class: "button" }, "Download"), h("div", {}, links));
}

// The PDF may not be to be had; then the page says why instead of the browser saving the reason as a file.
async function fetched(event, run, file) {
  event.preventDefault();
  announce("Making the PDF …");
  try {
    save(await download(`/api/runs/${run.id}/files/${file}`), file);
  } catch (error) {
    announce(error.message, { error: true });
  }
}

const mN = (digits = 4) => (value) => number(value === null ? null : 1e3 * value, digits);
const hz = (value) => number(value, 7);

function tablesOf({ result }) {
  const columns = [
    { key: "line", title: "line" }, { key: "frequency_hz", title: "frequency", unit: "Hz", show: hz }, { key: "expected_hz", title: "expected", unit: "Hz", show: hz },
    { key: "amplitude_n_m", title: "amplitude", unit: "mN m", show: mN(5), note: "0-to-peak" }, { key: "amplitude_uncertainty_n_m", title: "±", unit: "mN m", show: mN(2) },
    { key: "phase_rad", title: "phase", unit: "rad", show: (value) => fixed(value, 3) },
    { key: "origin", title: "what it is" }, { key: "status", title: "status" }];
  const lines = shortTable(columns, result.lines, (line) => result.notable.includes(line.line), { caption: "Lines of the disturbance torque" });
  const budget = table([
    { key: "torque", title: "torque", show: (value) => `${value} ${TORQUES[value] ?? ""}` }, { key: "mean", title: "mean", unit: "mN m", show: mN() }, { key: "rms", title: "RMS", unit: "mN m", show: mN() }, { key: "peak", title: "largest", unit: "mN m", show: mN() },
    { key: "drive_1_amplitude", title: "at f_d", unit: "mN m", show: mN() }, { key: "drive_1_phase", title: "phase", unit: "rad", show: (value) => fixed(value, 2) }],
    result.budget.map((row) => ({ ...row, mean: result.drivetrain[row.torque]?.mean ?? null })), { caption: "Torque budget" });
  return [section("Lines", "Amplitudes are 0-to-peak; a decaying line is quoted with its mean over the record.", lines),
    section("Torque budget", "", budget), ...paper(result), section("Power, modes and checks", "", checks(result))];
}

function section(title, words, ...content) {
  return h("section", { class: "card" }, h("h2", {}, title), words && h("p", { class: "soft" }, words), ...content);
}

function checks({ drivetrain, invariants, modes }) {
  const power = ["electrical", "joule", "friction", "damping"].map((name) => [name, drivetrain.power[name]]).map(([name, value]) => [`power, ${name}`, quantity(value, "W")]);
  const kept = ["torque_forms", "momentum", "energy"].filter((name) => name in invariants).map((name) => [`residual of ${name.replace("_", " ")}`, number(invariants[name], 2)]);
  const seen = modes.map((mode) => [mode.name.replaceAll("_", " "), `${number(mode.frequency, 5)} Hz, damping ${number(100 * mode.damping, 3)} %`]);
  return h("dl", {}, [...power, ...seen.slice(0, 8), ...kept].map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))));
}

function paper({ paper: rows }) {
  if (!rows.length) return [];
  const off = (value) => `${value > 0 ? "+" : ""}${number(100 * value, 3)} %`;
  const beside = table([
    { key: "line", title: "line" }, { key: "test_hz", title: "test", unit: "Hz", show: hz }, { key: "ours_hz", title: "this run", unit: "Hz", show: hz },
    { key: "test_n_m", title: "test", unit: "mN m", show: mN() }, { key: "paper_n_m", title: "paper's model", unit: "mN m", show: mN() }, { key: "ours_n_m", title: "this run", unit: "mN m", show: mN() },
    { key: "error", title: "this run against the test", show: off }], rows.map((row) => ({ ...row, error: row.ours_n_m / row.test_n_m - 1 })), { caption: "Beside the paper" });
  return [section("Beside the paper", "Tables 5 and 6, all in the paper's own form: nearest bin, rectangular window.", beside)];
}
