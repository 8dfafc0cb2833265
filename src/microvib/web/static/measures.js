// The one place that says in which units torques and angles are shown; plots and tables ask here, and are told when it changes.

import { number, quantity } from "./dom.js";

const STORED = "microvib.units";
const USUAL = { torque: "auto", level: "peak", angle: "auto" };
export const CHOICES = {
  torque: { auto: "fitting", "mN*m": "mN m", "N*m": "N m", dB: "dB re 1 N m" },
  level: { peak: "0-to-peak", rms: "RMS" },
  angle: { auto: "fitting", arcsec: "arcsec", urad: "µrad", rad: "rad" },
};
const RMS = Math.SQRT1_2; // of a line, from 0-to-peak
const TORQUES = { "N m": 1, "mN m": 1e-3, "µN m": 1e-6, "nN m": 1e-9, "N*m": 1, "mN*m": 1e-3 };
const ANGLES = { rad: 1, mrad: 1e-3, "µrad": 1e-6, nrad: 1e-9, arcsec: Math.PI / 648000, mas: Math.PI / 648e6, urad: 1e-6 };
const PRINTED = { "mN*m": "mN m", "N*m": "N m", urad: "µrad" };
const listeners = new Set();
const chosen = { ...USUAL, ...stored() };

function stored() {
  try {
    const found = JSON.parse(localStorage.getItem(STORED)) ?? {};
    return Object.fromEntries(Object.entries(found).filter(([key, value]) => CHOICES[key]?.[value]));
  } catch {
    return {};
  }
}

export const units = () => ({ ...chosen });
export const onUnits = (listener) => listeners.add(listener);

/** Show torques, levels of lines or angles otherwise. */
export function chooseUnits(changes) {
  Object.assign(chosen, changes);
  localStorage.setItem(STORED, JSON.stringify(chosen));
  for (const listener of listeners) listener();
}

const decibel = (value) => 20 * Math.log10(value);
const isTorque = (unit) => unit === "N*m";

/**
 * How an axis of lines in `unit` is shown: `y(value)` of a 0-to-peak amplitude, `title`, `unit`, `words` for the sort of
 * level, and whether it is in dB. Other units than torque keep theirs.
 */
export function amplitudeAxis(unit) {
  const level = chosen.level === "rms" ? RMS : 1;
  const words = CHOICES.level[chosen.level];
  if (!isTorque(unit)) return { y: (value) => level * value, printed: null, words, dB: false, factor: level };
  if (chosen.torque === "dB")
    return { y: (value) => decibel(level * value), printed: "dB re 1 N m", words, dB: true, factor: level };
  const name = chosen.torque === "auto" ? "N*m" : chosen.torque;
  return { y: (value) => (level * value) / TORQUES[name], printed: PRINTED[name], words, dB: false, factor: level / TORQUES[name] };
}

/** How an axis of a channel's samples is shown: no level, and no dB. */
export function sampleAxis(unit) {
  const name = isTorque(unit) && chosen.torque === "mN*m" ? "mN*m" : unit;
  return { factor: isTorque(unit) ? 1 / TORQUES[name] : 1, printed: isTorque(unit) ? PRINTED[name] : null };
}

/** How an axis of power spectral densities of `unit`²/Hz is shown. */
export function densityAxis(unit) {
  if (!isTorque(unit)) return { y: (value) => value, printed: null, dB: false };
  if (chosen.torque === "dB") return { y: (value) => 10 * Math.log10(value), printed: "dB re 1 (N m)²/Hz", dB: true };
  const name = chosen.torque === "auto" ? "N*m" : chosen.torque;
  return { y: (value) => value / TORQUES[name] ** 2, printed: `(${PRINTED[name]})²/Hz`, dB: false };
}

/** A line's amplitude in words, from 0-to-peak; an angle's; other quantities as they are. */
export function shown(value, unit, digits = 3, { line = true } = {}) {
  if (isTorque(unit)) {
    const level = line && chosen.level === "rms" ? RMS * value : value;
    if (chosen.torque === "dB") return `${number(decibel(Math.abs(level)), Math.max(digits, 3))} dB`;
    if (chosen.torque === "auto") return quantity(level, unit, digits);
    return `${number(level / TORQUES[chosen.torque], digits)} ${PRINTED[chosen.torque]}`;
  }
  if (unit === "rad" && chosen.angle !== "auto") return `${number(value / ANGLES[chosen.angle], digits)} ${PRINTED[chosen.angle] ?? chosen.angle}`;
  return quantity(value, unit, digits);
}

/** The same of a torque with a sign, which dB would lose. */
export function shownSigned(value, digits = 3) {
  const name = ["auto", "dB"].includes(chosen.torque) ? null : chosen.torque;
  const text = name ? `${number(value / TORQUES[name], digits)} ${PRINTED[name]}` : quantity(value, "N*m", digits);
  return (value > 0 ? "+" : "") + text;
}

/** A sentence that says which level amplitudes have. */
export const shownWords = (text) => (chosen.level === "rms" ? text.replaceAll("0-to-peak", "RMS") : text);

// ---- Tables, whose cells are texts in a unit that the server chose ----

const NO_LINE = /^(mean|rms|largest|peak|limit|noise|T_)|_(rms|mean|peak)(_|$)/;
const SPREAD = /uncertainty|deviation|spread|difference/;

/** A column as the switch shows it: its unit, and `of(value)` of a number in it; null where nothing changes. */
export function shownColumn({ key, unit, title }) {
  if (unit in TORQUES) return torqueColumn(key, unit);
  if (unit in ANGLES && chosen.angle !== "auto" && !/phase/.test(`${key} ${title}`)) {
    const scale = ANGLES[unit] / ANGLES[chosen.angle];
    return { unit: PRINTED[chosen.angle] ?? chosen.angle, of: (value) => scale * value };
  }
  return null;
}

function torqueColumn(key, unit) {
  const isLine = !NO_LINE.test(key);
  const level = isLine && chosen.level === "rms" ? RMS : 1;
  const sort = isLine && chosen.level === "rms" ? " RMS" : "";
  if (chosen.torque === "dB" && !SPREAD.test(key))
    return { unit: `dB re 1 N m${sort}`, of: (value) => decibel(level * Math.abs(value) * TORQUES[unit]), dB: true };
  const name = ["auto", "dB"].includes(chosen.torque) ? unit : chosen.torque;
  if (level === 1 && name === unit) return null;
  return { unit: (PRINTED[name] ?? name) + sort, of: (value) => (level * value * TORQUES[unit]) / TORQUES[name] };
}

const LEADING = /^([-−]?[\d.]+(?:e[-+−]?\d+)?) (N m|mN m|µN m|nN m)$/;

/** A leading figure, "49.5 mN m", as the switch shows it. Where its label names a line and its frequency, it is an amplitude. */
export function shownFact({ value, label }) {
  const [, figure, unit] = LEADING.exec(value) ?? [];
  if (unit === undefined) return value;
  const given = Number(figure.replace("−", "-"));
  return shown(given * TORQUES[unit], "N*m", figure.replace(/[^\d]/g, "").length, { line: / at [\d.]+ Hz/.test(label) });
}
