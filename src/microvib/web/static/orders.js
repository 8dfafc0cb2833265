// The axis of orders: frequencies as multiples of the drive's clock, by other figures at the ticks of an axis that stays in Hz.

const FULL_STEPS = 4; // of an electrical period

/** What orders of a run are multiples of [Hz]: its microstep rate and its electrical frequency. */
export function basesOf(result) {
  const rate = result?.drivetrain?.f_d;
  const microsteps = Number(result?.values?.["driver.microsteps"]);
  if (!(rate > 0) || !(microsteps > 0)) return {};
  return { "microstep rate": rate, "electrical frequency": rate / (FULL_STEPS * microsteps) };
}

/** Ticks of an axis from `low` to `high` [Hz] at multiples of `base`. */
export function orderTicks(low, high, base, log) {
  const orders = log ? decades(low / base, high / base) : even(low / base, high / base);
  return { tickvals: orders.map((order) => order * base), ticktext: orders.map((order) => String(Number(order.toPrecision(6)))) };
}

const MOST = 11;

function even(from, to) {
  const raw = (to - from) / MOST;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((one) => one >= raw);
  const first = Math.ceil(from / step - 1e-9);
  return Array.from({ length: Math.floor(to / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
}

function decades(from, to) {
  const found = [];
  for (let power = Math.floor(Math.log10(from)); power <= Math.log10(to); power++) found.push(...[1, 2, 5].map((k) => k * 10 ** power));
  return found.filter((order) => order >= from && order <= to);
}
