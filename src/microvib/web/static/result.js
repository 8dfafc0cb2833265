// Tables of a run.

import { DASH, fixed, h, number, quantity } from "./dom.js";
import { KINDS, marginOf, verdictOf } from "./limit.js";
import { shortTable, table } from "./tables.js";

const mN =
  (digits = 4) =>
  (value) =>
    number(value === null ? null : 1e3 * value, digits);
const hz = (value) => number(value, 7);

/** An uncertainty beside an amplitude of five digits: below the last of them it is that it is. */
function within(value, { amplitude_n_m: amplitude }) {
  if (value === null || amplitude === null || amplitude === 0) return DASH;
  const last = 10 ** (Math.floor(Math.log10(Math.abs(1e3 * amplitude))) - 4);
  return 1e3 * value < last ? `<${last.toFixed(Math.max(0, -Math.round(Math.log10(last))))}` : number(1e3 * value, 2);
}

/** Lines, torque budget, measured lines beside them, power and checks. */
export function tablesOf(run) {
  const { result } = run;
  const judged = verdictOf(run) !== null;
  const margin = (_, { line }) => {
    const found = marginOf(run, line);
    if (!found) return DASH;
    const words = found.decibel === null ? "" : `${found.decibel > 0 ? "+" : ""}${fixed(found.decibel, 1)} `;
    return h("span", { class: KINDS[found.verdict], title: found.why }, `${words}${found.verdict.replace("fail", "FAIL")}`);
  };
  const columns = [
    { key: "line", title: "line" },
    { key: "frequency_hz", title: "frequency", unit: "Hz", show: hz },
    { key: "expected_hz", title: "expected", unit: "Hz", show: hz },
    { key: "amplitude_n_m", title: "amplitude", unit: "mN m", show: mN(5), note: "0-to-peak" },
    { key: "amplitude_uncertainty_n_m", title: "± (1σ)", unit: "mN m", show: within },
    ...(judged ? [{ key: "margin_db", title: "margin", unit: "dB", show: margin }] : []),
    { key: "phase_rad", title: "phase", unit: "rad", show: (value) => fixed(value, 3) },
    { key: "origin", title: "what it is" },
    { key: "status", title: "status" },
  ];
  const rows = result.lines.map((line) => ({ ...line, margin_db: marginOf(run, line.line)?.decibel ?? null }));
  const above = (line) => marginOf(run, line.line)?.verdict === "fail";
  const lines = shortTable(columns, rows, (line) => result.notable.includes(line.line) || above(line), {
    caption: "Lines of the disturbance torque",
  });
  const budget = table(
    [
      { key: "torque", title: "torque", show: (value, row) => `${value} ${row.meaning}` },
      { key: "mean", title: "mean", unit: "mN m", show: mN() },
      { key: "rms", title: "RMS", unit: "mN m", show: mN() },
      { key: "peak", title: "largest", unit: "mN m", show: mN() },
      { key: "drive_1_amplitude", title: "at f_d", unit: "mN m", show: mN() },
      { key: "drive_1_phase", title: "phase", unit: "rad", show: (value) => fixed(value, 2) },
    ],
    result.budget.map((row) => ({ ...row, mean: result.drivetrain[row.torque]?.mean ?? null })),
    { caption: "Torque budget" },
  );
  return [
    ...overSeeds(result),
    section(
      "Lines",
      `Amplitudes are 0-to-peak; a decaying line is quoted with its mean over the record. ± is how well the line of this record is known; how far to trust the model: ${result.standing}.`,
      lines,
    ),
    section("Torque budget", "", budget),
    ...measured(result),
    section("Power, modes and checks", "", checks(result)),
  ];
}

/** The lines over several draws of the noise. */
function overSeeds({ seeds }) {
  if (!seeds?.length) return [];
  const words = `${seeds[0].draws} draws, this record's and those of the following seeds. The quantile is bounded with 95 % confidence each way; fewer than 59 draws do not bound it from above.`;
  const figures = [["mean_n_m", "mean"], ["deviation_n_m", "deviation"], ["p95_n_m", "95 % quantile"], ["p95_low_n_m", "at least"], ["p95_high_n_m", "at most"]]; // prettier-ignore
  const columns = [
    { key: "line", title: "line" },
    { key: "frequency_hz", title: "frequency", unit: "Hz", show: hz },
    ...figures.map(([key, title]) => ({ key, title, unit: "mN m", show: mN() })),
  ];
  return [section("Lines over the draws of the noise", words, table(columns, seeds, { caption: "Lines over the draws of the noise" }))];
}

function section(title, words, ...content) {
  return h("section", { class: "card" }, h("h2", {}, title), words && h("p", { class: "soft" }, words), ...content);
}

function checks({ drivetrain, invariants, modes }) {
  const power = ["electrical", "joule", "friction", "damping"]
    .map((name) => [name, drivetrain.power[name]])
    .map(([name, value]) => [`power, ${name}`, quantity(value, "W")]);
  const kept = Object.entries(invariants).flatMap(([whose, values]) =>
    ["torque_forms", "momentum", "energy"]
      .filter((name) => name in values)
      .map((name) => [`residual of ${name.replace("_", " ")}${whose}`, number(values[name], 2)]),
  );
  const seen = modes.map((mode) => [
    mode.name.replaceAll("_", " "),
    `${number(mode.frequency, 5)} Hz, damping ${number(100 * mode.damping, 3)} %`,
  ]);
  return h(
    "dl",
    {},
    [...power, ...seen.slice(0, 8), ...kept].map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))),
  );
}

function measured({ reference }) {
  if (!reference) return [];
  const off = (value) => `${value > 0 ? "+" : ""}${number(100 * value, 3)} %`;
  const beside = table(
    [
      { key: "line", title: "line" },
      { key: "measured_hz", title: "measured", unit: "Hz", show: hz },
      { key: "run_hz", title: "this run", unit: "Hz", show: hz },
      { key: "measured_n_m", title: "measured", unit: "mN m", show: mN() },
      { key: "model_n_m", title: "published model", unit: "mN m", show: mN() },
      { key: "run_n_m", title: "this run", unit: "mN m", show: mN() },
      { key: "error", title: "this run against measured", show: off },
    ],
    reference.rows.map((row) => ({ ...row, error: row.run_n_m / row.measured_n_m - 1 })),
    { caption: "Beside measured lines" },
  );
  const words = `${reference.source}; amplitudes: ${reference.estimator}; ${reference.worth}.`;
  return [section("Beside measured lines", words, beside)];
}
