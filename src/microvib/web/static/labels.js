// Names that do not lie on each other: measured first, then placed, the important ones before the others.

const pen = document.createElement("canvas").getContext("2d");

/** Width of a text in pixels. */
export function textWidth(text, size, weight = 400) {
  pen.font = `${weight} ${size}px system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif`;
  return pen.measureText(text).width;
}

const BESIDE = 7;
const PLACES = [18, 2, 32, 46, 60, 74, 92, 110, -14, -30, -46].flatMap((rise) => [[rise, 1], [rise, -1]]); // prettier-ignore

/**
 * Places for names beside points of a picture of `width` and `height`. `names`: {x, y, lines, size}, the most important first, in
 * pixels from the left and from the top; `kept` are boxes that should stay clear of them, and do of `optional` names. Of each that finds room: {...name, ax, ay, xanchor, yanchor},
 * where its text goes from its point.
 */
export function placed(names, area, kept = []) {
  const taken = [];
  return names.flatMap((name) => {
    const boxes = PLACES.map((place) => boxOf(name, place)).filter((box) => inside(box, area));
    const free = boxes.filter((box) => !taken.some((other) => meet(box, other)));
    const best = free.find((box) => !kept.some((other) => meet(box, other))) ?? (name.optional ? undefined : free[0]);
    if (!best) return [];
    taken.push(best);
    const [ay, yanchor] = best.rise < 0 ? [0.5 * (best.top + best.bottom) - name.y, "middle"] : [-best.rise, "bottom"];
    return [{ ...name, ax: best.side * BESIDE, ay, yanchor, xanchor: best.side > 0 ? "left" : "right" }];
  });
}

function boxOf(name, [rise, side]) {
  const wide = Math.max(...name.lines.map((line) => textWidth(line, name.size, 650))) + 4;
  const high = 1.35 * name.size * name.lines.length;
  const left = side > 0 ? name.x + BESIDE : name.x - BESIDE - wide;
  return { rise, side, left, right: left + wide, top: name.y - rise - high, bottom: name.y - rise };
}

const inside = (box, { width, height }) => box.left >= 0 && box.right <= width && box.top >= 0 && box.bottom <= height;

/** A box about a point. */
export const about = (x, y, by) => ({ left: x - by, right: x + by, top: y - by, bottom: y + by });

const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

/** Groups of what lies closer than `gap` to its neighbour, by `place` (in pixels). */
export function together(items, place, gap) {
  const groups = [];
  for (const item of [...items].sort((a, b) => place(a) - place(b))) {
    const last = groups.at(-1);
    if (last && place(item) - place(last.at(-1)) < gap) last.push(item);
    else groups.push([item]);
  }
  return groups;
}

/** One name for several modes: array_mode_2, array_mode_3, array_mode_4 are array modes 2–4. */
export function modeNames(modes) {
  const kinds = new Map();
  for (const { name } of modes) {
    const [, kind, number] = /^(.*?)_?(\d*)$/.exec(name);
    kinds.set(kind, [...(kinds.get(kind) ?? []), Number(number)]);
  }
  return [...kinds].map(([kind, numbers]) => `${kind.replaceAll("_", " ")}${numbers.length > 1 ? "s" : ""} ${ranges(numbers)}`).join(", ");
}

function ranges(numbers) {
  const runs = [];
  for (const n of numbers.sort((a, b) => a - b)) {
    if (runs.at(-1)?.at(-1) === n - 1) runs.at(-1).push(n);
    else runs.push([n]);
  }
  return runs.map((run) => (run.length > 1 ? `${run[0]}–${run.at(-1)}` : run[0])).join(", ");
}
