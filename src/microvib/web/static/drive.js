// The drive train as a drawing that carries a run's numbers. An arrow's head is on the body that the signed torque acts on;
// signs as in docs/signs.md. Width goes with the amplitude at the driving frequency, a decade for each step.

import { excited } from "./channels.js";
import { DASH, number, quantity, s } from "./dom.js";
import { shown, shownSigned } from "./measures.js";
import { textWidth } from "./labels.js";

const AXIS = 140;
const SHOWN_TURN = 3000; // degrees drawn for a radian of the rotor: a microstep is a tenth of a degree
const KINDS = { motor: "#E69F00", gear: "#0072B2", friction: "#D55E00", load: "#009E73", whole: "#CC79A7" };

/** The drawing for a run, or without numbers. `values` are the run's parameters as texts; `now`, channels at one instant instead of means. */
export function drawing(result, values = {}, now = null) {
  const told = figures(result, values, now);
  return s(
    "svg",
    { viewBox: "0 -24 1000 342", class: "drive", role: "img", "aria-label": spoken(told) },
    heads(),
    body(),
    driver(told),
    motor(told),
    reducer(told),
    bearing(told),
    array(told),
    flows(told),
    sum(told),
  );
}

/** Means and amplitudes of each torque, those on the housing included; null where there is no run. */
function figures(result, values, now) {
  const h = Number(values["reducer.ratio"]) || 100;
  const drive = result?.drivetrain;
  const amplitude = Object.fromEntries((result?.budget ?? []).map((row) => [row.torque, row.drive_1_amplitude]));
  const torque = (name, factor = 1) => ({
    value: drive ? factor * (now ? now[name] : drive[name].mean) : null,
    peak: drive ? Math.abs(factor) * drive[name].peak : null,
    alternating: amplitude[name] === undefined || amplitude[name] === null ? null : Math.abs(factor) * amplitude[name],
    strength: drive && Math.abs(factor) * (now ? Math.abs(now[name] - drive[name].mean) : (amplitude[name] ?? 0)),
  });
  return {
    drive,
    result,
    h,
    values,
    now,
    T_e: torque("T_e"),
    T_f_m: torque("T_f_m"),
    T_g: torque("T_g"),
    T_f: torque("T_f"),
    T_l: torque("T_l"),
    T_d: torque("T_d"),
    rotorGear: torque("T_g", 1 / h),
    stator: torque("T_e", -1),
    housingGear: torque("T_g", -(1 + 1 / h)),
    largest: Math.max(0, ...Object.values(amplitude).filter(Number.isFinite)),
  };
}

function spoken({ drive, T_e, T_g, T_l, T_d }) {
  const chain = "Drive train: driver, motor, reducer, shaft with bearing and slip ring, array; the spacecraft behind it.";
  if (!drive) return chain;
  const told = [
    ["T_e on the rotor", T_e],
    ["T_g on the output", T_g],
    ["T_l into the array", T_l],
    ["T_d on the spacecraft", T_d],
  ];
  return `${chain} ${told.map(([name, torque]) => `${name}: mean ${shownSigned(torque.value)}, at the driving frequency ${shown(torque.alternating, "N*m")}`).join("; ")}.`;
}

function heads() {
  const marker = ([name, fill]) =>
    s(
      "marker",
      {
        id: `head-${name}`,
        viewBox: "0 0 10 10",
        refX: 6,
        refY: 5,
        markerWidth: 15,
        markerHeight: 15,
        markerUnits: "userSpaceOnUse",
        orient: "auto",
      },
      s("path", { d: "M0 0L10 5L0 10z", fill }),
    );
  return s("defs", {}, ...Object.entries(KINDS).map(marker));
}

const text = (x, y, content, className = "", anchor = "middle") =>
  s("text", { x, y, class: className, "text-anchor": anchor }, content);
const rect = (x, y, width, height, className, rx = 3) => s("rect", { x, y, width, height, rx, class: className });
const circle = (cx, cy, r, className) => s("circle", { cx, cy, r, class: className });
const path = (d, className) => s("path", { d, class: className });

/** A symbol with its index, and what stands before and after it. */
function name(before, head, index, after = "") {
  return [
    before,
    s("tspan", { class: "variable" }, head),
    s("tspan", { dy: 3, "font-size": "75%" }, index),
    s("tspan", { dy: -3 }, after || "\u200b"),
  ];
}

function part(x, title, below) {
  return [text(x, 24, title, "part"), text(x, 40, below, "fine")];
}

function body() {
  return s(
    "g",
    {},
    rect(4, -20, 700, 334, "spacecraft", 12),
    text(20, 0, "spacecraft", "part soft", "start"),
    rect(24, 226, 660, 9, "housing", 2),
  );
}

function driver({ drive, values, now }) {
  const [u, i] = now ? [now.u_A, now.i_A] : drive ? [drive.u_rms, drive.i_rms] : [];
  const phase = now ? "in A" : "rms";
  const stairs = "M50 124h8v-7h9v-7h9v-7h9v7h9v7h9v7h9";
  return s(
    "g",
    {},
    part(80, "driver", drive ? `${number(drive.f_d, 4)} microsteps/s` : "microsteps"),
    rect(30, 96, 100, 88, "block"),
    path(stairs, "stairs"),
    text(80, 148, drive ? `${quantity(u, "V")} ${phase}` : `n = ${values["driver.microsteps"] ?? DASH}`, "fine"),
    text(80, 166, drive ? `${quantity(i, "A")} ${phase}` : "", "fine"),
    path("M80 184V226", "mount"),
    path(`M130 ${AXIS - 8}h54`, "wire a"),
    path(`M130 ${AXIS + 8}h54`, "wire b"),
    text(157, AXIS - 13, "A", "tiny"),
    text(157, AXIS + 20, "B", "tiny"),
  );
}

const share = (part, whole, now) => (now ? (part > 0.5 ? "sticks" : "slips") : `sticks ${number(100 * whole, 3)} %`);

function motor({ drive, now }) {
  const turn = now ? `rotate(${SHOWN_TURN * now.theta_m} 230 ${AXIS})` : null;
  return s(
    "g",
    {},
    part(230, "motor", drive ? `rotor ${share(now?.stuck_rotor, drive.stuck_rotor, now)}` : "stator and rotor"),
    circle(230, AXIS, 47, "block"),
    circle(230, AXIS, 37, "gap"),
    s("circle", { cx: 230, cy: AXIS, r: 31, class: "teeth", transform: turn }),
    circle(230, AXIS, 28, "rotor"),
    circle(230, AXIS, 4, "hub"),
    path("M205 180V226M255 180V226", "mount"),
  );
}

function reducer({ h }) {
  return s(
    "g",
    {},
    rect(258, AXIS - 4, 140, 8, "shaft"),
    part(430, "reducer", `h = ${h}`),
    circle(430, AXIS, 47, "block"),
    circle(430, AXIS, 39, "teeth ring"),
    s("ellipse", { cx: 430, cy: AXIS, rx: 30, ry: 37, class: "flex" }),
    s("ellipse", { cx: 430, cy: AXIS, rx: 19, ry: 29, class: "rotor" }),
    circle(430, AXIS, 4, "hub"),
    path("M430 187V226", "mount"),
  );
}

function bearing({ drive, now }) {
  return s(
    "g",
    {},
    rect(472, AXIS - 8, 318, 16, "shaft"),
    part(584, "bearing, slip ring", drive ? `shaft ${share(now?.stuck_output, drive.stuck_output, now)}` : "friction"),
    rect(567, AXIS - 32, 34, 22, "block"),
    rect(567, AXIS + 10, 34, 22, "block"),
    path(`M572 ${AXIS - 10}v20M580 ${AXIS - 10}v20M588 ${AXIS - 10}v20M596 ${AXIS - 10}v20`, "rings"),
    path("M584 172V226", "mount"),
  );
}

function array({ drive, result, now }) {
  const tip = now ? -24 * (now.T_l / (drive.T_l.peak || 1)) : -24;
  const mode = excited(result);
  const rate = drive && drive.rate !== null ? `${number((180 / Math.PI) * drive.rate, 4)} deg/s` : "";
  const panel = (x) => [
    rect(x, 78, 92, 124, "panel", 2),
    path(`M${x} 109h92M${x} ${AXIS}h92M${x} 171h92M${x + 31} 78v124M${x + 62} 78v124`, "cells"),
  ];
  return s(
    "g",
    {},
    path(`M788 ${AXIS - 14}v28`, "yoke"),
    ...panel(798),
    ...panel(896),
    path(`M893 100v20M893 ${AXIS + 20}v20`, "yoke"),
    path(`M796 78Q900 ${78 + 0.2 * tip} 992 ${78 + tip}V${202 + tip}Q900 ${202 + 0.2 * tip} 796 202`, "bent"),
    text(894, 24, "array", "part"),
    text(894, 40, rate, "fine"),
    text(894, 226, mode ? `${number(mode.frequency, 4)} Hz through the drive` : "flexible modes", "fine"),
  );
}

const width = (torque, largest) => {
  if (!torque.strength || !largest) return 2;
  return Math.min(Math.max(9 + 1.8 * Math.log10(torque.strength / largest), 1.5), 9);
};

function arrow(d, kind, torque, told, title) {
  const line = s("path", {
    d,
    class: "torque",
    stroke: KINDS[kind],
    "stroke-width": width(torque, told.largest),
    "marker-end": `url(#head-${kind})`,
  });
  const words = told.drive
    ? `: ${told.now ? "now" : "mean"} ${shownSigned(torque.value, 4)}, amplitude at f_d ${shown(torque.alternating, "N*m", 4)}, largest ${shown(torque.peak, "N*m", 4, { line: false })}`
    : "";
  return s("g", {}, s("title", {}, title + words), line);
}

function label(x, y, head, torque, told, className = "", step = 15, digits = 3) {
  const lines = told.drive
    ? [
        text(x, y + step, shownSigned(torque.value, digits), "value"),
        text(x, y + 2 * step, `∿ ${shown(torque.alternating, "N*m")}`, "fine value"),
      ]
    : [];
  return s("g", { class: className }, s("text", { x, y, "text-anchor": "middle", class: "torque-name" }, ...head), ...lines);
}

function flows(told) {
  const { T_e, T_g, T_l, rotorGear } = told;
  return s(
    "g",
    {},
    arrow("M284 121H366", "motor", T_e, told, "Motor torque on the rotor"),
    label(328, 66, name("", "T", "e", " on the rotor"), T_e, told),
    arrow("M380 160H298", "gear", rotorGear, told, "Torque of the gear on the rotor"),
    label(332, 181, name("", "T", "g", "/h"), rotorGear, told, "", 14),
    arrow("M484 119H548", "gear", T_g, told, "Torque of the gear on the output"),
    label(516, 66, name("", "T", "g", " on the output"), T_g, told),
    arrow("M714 119H772", "load", T_l, told, "Torque of the shaft into the array"),
    label(751, 66, name("", "T", "l", " on the array"), T_l, told, "", 15),
  );
}

/** Middles of columns of these widths, with equal gaps from `left` to `right`. */
function spread(widths, left, right) {
  const gap = (right - left - widths.reduce((a, b) => a + b, 0)) / (widths.length - 1);
  return widths.map((width, k) => left + widths.slice(0, k).reduce((a, b) => a + b + gap, 0) + width / 2);
}

/** What each part puts on the housing, and their sum, the disturbance torque. */
function sum(told) {
  const { T_f_m, T_f, T_d, stator, housingGear } = told;
  const terms = [
    [name("−", "T", "e"), stator],
    [name("+ ", "T", "f,m"), T_f_m],
    [name("− ", "T", "g", " (1 + 1/h)"), housingGear],
    [name("+ ", "T", "f"), T_f],
  ];
  const texts = ([, torque]) => (told.drive ? [shownSigned(torque.value, 4), `∿ ${shown(torque.alternating, "N*m")}`] : []);
  const wide = (texts, least, size) => Math.max(least, ...texts.map((text) => textWidth(text, size, 650)));
  const widths = [...terms.map((term) => wide(texts(term), 76, 12.5)), 12, wide(texts([null, T_d]), 60, 14)];
  const centres = spread(widths, 112, 692);
  return s(
    "g",
    {},
    arrow("M205 190V222", "motor", stator, told, "Reaction of the motor torque on the housing"),
    arrow("M255 190V222", "friction", T_f_m, told, "Friction of the rotor on the housing"),
    arrow("M430 190V222", "gear", housingGear, told, "Reaction of the gear on the housing"),
    arrow("M584 176V222", "friction", T_f, told, "Friction of bearing and slip ring on the housing"),
    text(24, 256, "on the housing", "fine", "start"),
    text(24, 273, told.drive ? (told.now ? "now" : "mean") : "", "fine", "start"),
    text(24, 290, told.drive ? "∿ at f_d" : "", "fine", "start"),
    terms.map(([head, torque], k) => label(centres[k], 256, head, torque, told, "", 17, 4)),
    text(centres[4], told.drive ? 273 : 256, "=", "part"),
    label(centres[5], 256, name("", "T", "d"), T_d, told, "whole", 17, 4),
    s(
      "g",
      {},
      s("title", {}, "Disturbance torque on the spacecraft"),
      s("path", {
        d: `M${centres[5] - 46} 301q46 12 92 -4`,
        class: "torque",
        stroke: KINDS.whole,
        "stroke-width": 4,
        "marker-end": "url(#head-whole)",
      }),
    ),
  );
}
