// What stands in a spectrum beside its curve: names of its lines, those that decide the verdict first, and the limit.

import { number } from "./dom.js";
import { about, placed } from "./labels.js";
import { shown as inUnits } from "./measures.js";
import { ground, ink } from "./plots.js";
import { LIMIT } from "./styles.js";

const NAMED = 8; // lines at most; half of them in a picture that is narrow [px]
const NARROW = 400;
const WORTH = 0.005; // of the largest line that is seen, from which another has a name
const SIZE = 10.5; // of names
const PIECE = 24; // of a limit curve, for which a box stands [px]

/** Lines that have an amplitude, above the floor. */
export const seen = ({ lines }) => lines.filter((line) => line.amplitude_n_m !== null && line.status !== "below the floor");

/**
 * Where values lie: in the units of the axes, and in pixels from the left and the top. `x`, `y` are the ends of the axes in their own units
 * (decades where they are logarithmic), `axis` the unit of amplitudes, `area` width and height.
 */
export function scaled({ x, y, axis, logX, logY, area: [width, height] }) {
  const onX = (f) => (logX ? Math.log10(Math.max(f, 1e-9)) : f);
  const onY = (amplitude) => {
    const value = axis.y(Math.max(amplitude, 1e-30));
    return logY && !axis.dB ? Math.log10(value) : value;
  };
  const right = (f) => ((onX(f) - x[0]) / (x[1] - x[0])) * width;
  const down = (amplitude) => ((y[1] - onY(amplitude)) / (y[1] - y[0])) * height;
  const sees = (f) => right(f) >= 0 && right(f) <= width;
  return { width, height, axis, onX, onY, right, down, sees };
}

/** Names of the lines that decide a verdict, the worst first: those above the limit, or the one nearest to it. */
function deciding(limit) {
  const judged = (limit?.margins ?? []).filter(({ verdict }) => verdict !== "not judged");
  const above = judged.filter(({ verdict }) => verdict === "fail");
  return (above.length ? above : judged.slice(0, 1)).map(({ line }) => line);
}

/** Names of the lines that decide the verdict, and of the strongest that are seen, where there is room; `kept` are boxes that stay clear. */
export function namesOfLines(lines, axes, limit, { unit = "N*m", kept = [] } = {}) {
  const inside = lines.filter(
    (line) => axes.sees(line.frequency_hz) && axes.down(line.amplitude_n_m) > 0 && axes.down(line.amplitude_n_m) < 0.93 * axes.height,
  );
  const top = Math.max(...inside.map((line) => line.amplitude_n_m));
  const rank = ({ kind }) => ({ "array mode": 0, sideband: 2, other: 2 })[kind] ?? 1;
  const first = deciding(limit);
  const turn = ({ line }) => (first.includes(line) ? first.indexOf(line) : first.length);
  inside.sort((a, b) => turn(a) - turn(b) || rank(a) - rank(b) || b.amplitude_n_m - a.amplitude_n_m);
  const dots = [...kept, ...inside.map((line) => about(axes.right(line.frequency_hz), axes.down(line.amplitude_n_m), 4)), ...alongCurve(limit, axes)];
  if (isOneNumber(limit)) {
    const y = axes.down(limit.torque);
    dots.push({ left: axes.width - 100, right: axes.width, top: y - 15, bottom: y }); // its name
    dots.push({ left: 0, right: axes.width, top: y - 2, bottom: y + 2 });
  }
  const worth = inside.filter(
    (line) => line.amplitude_n_m > WORTH * top || line.kind === "array mode" || first.includes(line.line),
  );
  const wanted = worth.slice(0, 3 * NAMED).map((line) => ({
    line,
    x: axes.right(line.frequency_hz),
    y: axes.down(line.amplitude_n_m),
    size: SIZE,
    optional: rank(line) === 2 && !first.includes(line.line),
    lines: [line.line, `${number(line.frequency_hz, 4)} Hz · ${inUnits(line.amplitude_n_m, unit, 3)}`],
  }));
  return placed(wanted, axes, dots)
    .slice(0, axes.width < NARROW ? NAMED / 2 : NAMED)
    .map(({ line, lines, ax, ay, xanchor, yanchor }) => ({
      x: axes.onX(line.frequency_hz),
      y: axes.onY(line.amplitude_n_m),
      text: `<b>${lines[0]}</b><br>${lines[1]}`,
      showarrow: true,
      arrowhead: 0,
      arrowwidth: 0.8,
      arrowcolor: ink(),
      ax,
      ay,
      xanchor,
      yanchor,
      align: xanchor,
      font: { size: SIZE },
      bgcolor: ground(),
      borderpad: 0,
    }));
}

const span = ({ low, high }, axes) => [
  Math.max(axes.right(low), 0) / axes.width,
  Math.min(high === null ? axes.width : axes.right(high), axes.width) / axes.width,
];

/** A limit over frequency; in a mode of its own, so that no cursor takes it for a spectrum. */
export function limitCurve(limit, axis) {
  if (!limit?.curve) return [];
  return [
    {
      x: limit.curve.map(([f]) => f),
      y: limit.curve.map(([, torque]) => axis.y(torque)),
      name: "limit",
      mode: "lines+markers",
      line: { color: LIMIT, width: 2 },
      marker: { color: LIMIT, size: 4 },
      hovertemplate: `limit<br>%{x:.5g} Hz<br>%{y:.4g} ${axis.printed}<extra></extra>`,
    },
  ];
}

const isOneNumber = (limit) => Boolean(limit) && limit.torque !== null && !limit.curve;

/** A limit of one number in its band. */
export function limitLine(limit, axes) {
  if (!isOneNumber(limit)) return [];
  const [x0, x1] = span(limit, axes);
  const line = { color: LIMIT, width: 2 };
  return x0 < x1 ? [{ type: "line", xref: "paper", x0, x1, y0: axes.axis.y(limit.torque), y1: axes.axis.y(limit.torque), line }] : [];
}

/** Its name, in the `unit` of the amplitudes. */
export function limitName(limit, axes, unit = "N*m") {
  if (!isOneNumber(limit)) return [];
  const [x0, x1] = span(limit, axes);
  const text = `limit ${inUnits(limit.torque, unit, 3)}`;
  const font = { size: SIZE, color: LIMIT };
  const place = { xref: "paper", x: x1, y: axes.onY(limit.torque), xanchor: "right", yanchor: "bottom", showarrow: false };
  return x0 < x1 ? [{ ...place, text, font }] : [];
}

/** Boxes along a limit over frequency, which names are kept from where they have another place. */
function alongCurve(limit, axes) {
  if (!limit?.curve) return [];
  const points = limit.curve.map(([f, torque]) => [axes.right(f), axes.down(torque)]);
  return points.slice(1).flatMap((end, k) => {
    const [[x0, y0], [x1, y1]] = [points[k], end];
    const [first, last] = [Math.max(x0, 0), Math.min(x1, axes.width)];
    if (x1 === x0) return [{ left: x0 - 2, right: x0 + 2, top: Math.min(y0, y1), bottom: Math.max(y0, y1) }];
    const parts = Math.max(Math.ceil((last - first) / PIECE), 0);
    return Array.from({ length: parts }, (_, n) => {
      const at = (x) => y0 + ((x - x0) / (x1 - x0)) * (y1 - y0);
      const [left, right] = [first + n * PIECE, Math.min(first + (n + 1) * PIECE, last)];
      return { left, right, top: Math.min(at(left), at(right)) - 2, bottom: Math.max(at(left), at(right)) + 2 };
    });
  });
}
