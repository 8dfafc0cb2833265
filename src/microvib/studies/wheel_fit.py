"""Harmonic coefficients and structural modes of a wheel, from the ridges of its waterfalls."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from microvib.signals.close_orders import powers_apart
from microvib.signals.ridges import PowerMap, Ridge, whirl_paths
from microvib.studies.budget.files import WheelMode
from microvib.studies.budget.wheel_modes import amplification

CONFIDENCE = 0.95
"""Confidence level of the intervals of coefficients."""
NEAR_MODE = 1.5
"""Amplification by a mode, or its inverse, from which a speed tells nothing of a coefficient."""
KNOWN_WITHIN = 2.0
"""Standard uncertainties within which a figure is, with a probability of 95 %."""
_UNKNOWN_DAMPING, _UNKNOWN_RATIO = 2.0, 0.1
"""Factor of a damping that only the width of a ridge tells, and by how much its ratio of inertias may be off
(assumed)."""
_LEAST_DAMPING = 1e-4
"""Least damping that a mode is taken to have where a fit tells nothing of it (assumed)."""
_LARGEST_DAMPING, _LARGEST_ERROR = 0.5, 0.45
"""Largest that a budget takes."""
_DETECTED = 0.998
"""Confidence with which a coefficient must be above zero to be taken for one."""
_LEAST_SPEEDS = 4
_KNOWN = 3.0
"""Times of its noise from which a reading tells of modes."""
_CHANCE = 1e-3
"""Chance that noise is taken for an order at any speed."""
WEAK = 0.25
"""Part of its power below which an order is told to be weak at a speed: half of its amplitude."""
_LARGE = 1.21
"""Part of the largest power of an interval from which a speed is told to be above it: 1.1 of the amplitude."""
_QUIETEST = 0.1
"""Share of the speeds that tell no more of an order than the others, however low their floor is."""
_LEAST_SHARE = 0.25
"""Share of the speeds that must show an order for its coefficient to be that of these speeds."""
Motion = Literal["rocking", "radial", "axial"]
MOTIONS: Mapping[str, Motion] = {
    "radial_force": "radial",
    "radial_torque": "rocking",
    "axial_force": "axial",
}
_MOST_MODES = 3
_RAISED = 0.35
"""Logarithm of the factor by which readings must be raised at a mode."""
_LEAST_RAISED = 3
_CRITERION = 20.0
"""By how much the Bayesian information criterion must fall for a mode."""
_CAPPED = 1.0
"""Largest deviation of a logarithm that counts among trial modes."""
_DAMPINGS = (0.003, 0.01, 0.03, 0.08)
_ITERATIONS = 12
_FREQUENCY, _DAMPING = 0, 1
"""Numbers of a mode's frequency and damping among its parameters."""
_LEAST_STEP = 1e-5
"""Least step of the logarithm of a frequency in the search for its ends."""
_LEAST_SCATTER = 0.01
"""Least standard deviation of the logarithm of readings."""
_HALVINGS = 4
_BEYOND = 2.0
"""Factor by which the frequency of a mode may be beyond those of the readings."""


@dataclass(frozen=True)
class Reading:
    """An order in one map, at the speeds at which no other ridge is near it."""

    order: float
    speed: np.ndarray
    """[rad/s], (n,)."""
    power: np.ndarray
    """Half of the squared amplitude less the floor, (n,)."""
    still: np.ndarray
    """Standard deviation of that by the floor where there is no order, (n,)."""
    gain: np.ndarray
    """Variance that the floor adds to it, over the power of the order, (n,)."""
    limit: np.ndarray
    """Power that the floor alone exceeds at any of the speeds with a chance of 0.1 %, (n,)."""
    seen: np.ndarray
    """Power above the floor and above the bins beside it, (n,): that of a peak, not of a slope."""

    @property
    def noise(self) -> np.ndarray:
        """Standard deviation of the power by the floor, (n,)."""
        return self.noise_at(self.power)

    def noise_at(self, power: np.ndarray) -> np.ndarray:
        """Standard deviation by the floor of a power (n,)."""
        return np.asarray(np.sqrt(self.still**2 + self.gain * np.maximum(power, 0.0)))

    @property
    def at_least(self) -> np.ndarray:
        """Power that an order has for sure, (n,); 0 where none is seen."""
        return self.sure_part(self.seen)

    @property
    def at_most(self) -> np.ndarray:
        """Power that an order has at most where it is seen, (n,); 0 where it is not."""
        return np.where(self.at_least > 0.0, self.seen + KNOWN_WITHIN * self.noise, 0.0)

    def sure_part(self, power: np.ndarray) -> np.ndarray:
        """Part of a ``power`` (n,) that the floor does not make, (n,)."""
        own = _KNOWN * np.sqrt(self.gain * np.maximum(self.power, 0.0))
        return np.asarray(np.where(power > self.limit, np.maximum(power - own, 0.0), 0.0))

    def where(self, chosen: np.ndarray) -> Reading:
        """Only the chosen speeds."""
        return Reading(
            self.order, self.speed[chosen], self.power[chosen], self.still[chosen],
            self.gain[chosen], self.limit[chosen], self.seen[chosen],
        )  # fmt: skip

    @property
    def frequency(self) -> np.ndarray:
        """[Hz], (n,)."""
        return np.asarray(self.order * self.speed / (2.0 * np.pi))


@dataclass(frozen=True)
class FoundMode:
    """A structural mode of the wheel."""

    motion: Motion
    frequency: float
    """At rest [Hz]."""
    damping: float
    inertia_ratio: float
    uncertainty: tuple[float, float]
    """Standard uncertainties of frequency [Hz] and ratio; nan where not known."""
    dampings: tuple[float, float]
    """Between which its damping is with a probability of 95 %; assumed where it has a ridge alone."""
    how: str
    """*orders* that rise near it, or a *ridge* of its own."""
    ways: Mapping[float, float]
    """Direction in which orders fit best that cross it, 1 with the wheel and -1 against it."""

    def frequency_error(self, speed: float) -> float:
        """Part by which its frequency, or those of its whirl up to a ``speed`` [rad/s], may be off with a
        probability of 95 %; what the ratio of inertias is off by moves whirl.
        """
        own, of_ratio = self.uncertainty
        found = own / self.frequency
        if self.motion == "rocking":
            off = _UNKNOWN_RATIO / KNOWN_WITHIN if np.isnan(of_ratio) else of_ratio
            still = 2.0 * math.pi * self.frequency
            found += 0.5 * off * speed / math.hypot(still, 0.5 * self.inertia_ratio * speed)
        return min(KNOWN_WITHIN * found, _LARGEST_ERROR)

    def of_budget(self, highest_speed: float) -> WheelMode:
        """The mode as a budget takes it up to a speed [rad/s]."""
        return WheelMode.model_construct(
            motion=self.motion, frequency=self.frequency, damping=self.damping,
            inertia_ratio=self.inertia_ratio, frequency_error=self.frequency_error(highest_speed),
            damping_least=self.dampings[0], damping_most=self.dampings[1],
        )  # fmt: skip


@dataclass(frozen=True)
class Coefficient:
    """Coefficient of an order in one load, (N, N m) s^2/rad^2."""

    value: float
    least: float
    most: float
    """Ends of its interval; a value of 0 is not seen, and may be up to ``most``."""
    speeds: int
    """Speeds that it is from."""
    near_modes: bool
    """Whether all of these are near a mode, whose amplification is taken out."""
    bounded: bool = False
    """Whether other ridges mask the order at every speed, so that only ``most`` is known."""
    axes_differ: bool = False
    """Whether both axes across the spin axis have coefficients whose intervals are apart: then the load
    does not go round in a circle."""
    weak: tuple[float, ...] = ()
    """Speeds [rad/s] at which it has less than half of its amplitude; ``least`` holds them."""
    large: tuple[float, ...] = ()
    """Speeds [rad/s] at which it is seen and larger than elsewhere; ``most`` holds them."""
    usual: float = math.inf
    """End of its interval without what it has at single speeds."""
    resonances: tuple[tuple[float, float], ...] = ()
    """Speeds [rad/s] between which it has a resonance that no mode explains, and may be larger than it was
    seen at any speed."""


def read_order(
    one: PowerMap, order: float, ridges: Sequence[Ridge], kept: np.ndarray | None = None
) -> Reading:
    """An order in a map, where no other ridge comes nearer than the bins of both, at the speeds of the map
    that are ``kept`` (n,).
    """
    f = order * one.speed / (2.0 * np.pi)
    reach = bins_beside(one, order)
    clear = one.bins(f) - reach >= 1
    clear &= one.bins(f) + reach < one.frequency.size
    for ridge in ridges:
        for path in ridge_paths(ridge, one.speed):
            if ridge.kind == "order" and ridge.values[0] == order:
                continue
            clear &= np.abs(path - f) > (reach + one.lobe + 1) * one.spacing
    if kept is not None:
        clear &= kept
    cells = [
        _read_cell(one, i, int(one.bins(f)[i]), int(reach[i]))
        for i in np.flatnonzero(clear).tolist()
    ]
    power, still, gain, mean, seen = np.array(cells).reshape(-1, 5).T
    return Reading(
        order, one.speed[clear], power, still, gain, _largest_of_noise(mean, still), seen
    )


def read_apart(
    one: PowerMap, order: float, orders: Sequence[float], kept: np.ndarray | None = None
) -> Reading:
    """An order that others of some ``orders`` mask, at the speeds of a map that are ``kept`` (n,) at which its line
    is told from theirs: by all lines at once.
    """
    apart = np.min([abs(x - order) for x in orders if x != order], initial=np.inf)
    reach = bins_beside(one, order)
    f = order * one.speed / (2.0 * np.pi)
    clear = (one.bins(f) - reach >= 1) & (one.bins(f) + reach < one.frequency.size)
    clear &= apart * one.speed / (2.0 * np.pi * one.spacing) >= reach
    if kept is not None:
        clear &= kept
    rows = np.flatnonzero(clear).tolist()
    powers, beside = powers_apart(one, orders)
    k = list(orders).index(order)
    cells = np.array([_read_cell(one, i, int(one.bins(f)[i]), int(reach[i])) for i in rows])
    _, still, gain, mean, _ = cells.reshape(-1, 5).T
    power = powers[rows, k]
    # Amplitudes add by phases that are not known: a variance of twice both powers.
    return Reading(
        order, one.speed[clear], power, still, gain + 2.0 * beside[rows, k],
        _largest_of_noise(mean, still), power,
    )  # fmt: skip


def bins_beside(one: PowerMap, order: float) -> np.ndarray:
    """Bins on either side of an order that hold its power at each speed, (n,)."""
    smear = order * one.smear / (2.0 * np.pi * one.spacing)
    return one.lobe + np.ceil(0.5 * smear).astype(int)


def _read_cell(
    one: PowerMap, row: int, bin_: int, reach: int
) -> tuple[float, float, float, float, float]:
    """Power of an order at a speed above the floor, its standard deviation by the floor alone, the variance
    that the floor adds over that power, the power of the floor, and the order's above the bins beside it.
    """
    near = slice(bin_ - reach, bin_ + reach + 1)
    floor, K = one.floor[row, near], one.averages
    total = float(one.power[row, near].sum())
    beside = [
        one.power[row, max(bin_ - reach - one.lobe - 1, 0) : bin_ - reach],
        one.power[row, bin_ + reach + 1 : bin_ + reach + one.lobe + 2],
    ]
    slope = max(float(x.mean()) for x in beside if x.size)
    mean = float(floor.sum())
    still = math.sqrt(1.5 * float(np.sum(floor**2)) / K)
    seen = total - max(mean, slope * floor.size)
    return total - mean, still, 2.0 * float(floor.mean()) / K, mean, seen


def _largest_of_noise(mean: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Power above its mean that the floor exceeds at any of the speeds with a chance of ``_CHANCE``, (n,)."""
    from scipy.stats import gamma

    shape = (mean / deviation) ** 2
    return np.asarray(mean * (gamma.isf(_CHANCE / max(mean.size, 1), shape) / shape - 1.0))


def ridge_paths(ridge: Ridge, speed: np.ndarray) -> list[np.ndarray]:
    """Frequencies [Hz] of a ridge over speeds (n,) [rad/s]: one path, of whirl two."""
    if ridge.kind == "order":
        return [ridge.values[0] * speed / (2.0 * np.pi)]
    if ridge.kind == "line":
        return [np.full(speed.size, ridge.values[0])]
    f0, ratio = (np.array([x]) for x in ridge.values)
    return [path[0] for path in whirl_paths(f0, ratio, speed)]


def log_factor(
    mode: np.ndarray, frequency: np.ndarray, speed: np.ndarray, way: float
) -> np.ndarray:
    """Logarithm of the amplification by modes (frequency [Hz], damping, ratio), (3, ...), of loads that
    go round in one way.
    """
    w, w0 = 2.0 * np.pi * frequency, 2.0 * np.pi * mode[0]
    stiff = w0**2 + 2j * mode[1] * w0 * w
    return np.asarray(np.log(np.abs(stiff / (stiff - w**2 + way * mode[2] * speed * w))))


def amplification_of(modes: Sequence[FoundMode], reading: Reading) -> np.ndarray:
    """Factor of the modes on a reading at its speeds, (n,)."""
    return factor_of(modes, reading.order, reading.speed)


def factor_of(modes: Sequence[FoundMode], order: float, speed: np.ndarray) -> np.ndarray:
    """Factor of the modes on an order at speeds (n,) [rad/s]."""
    total = np.zeros(speed.size)
    for one in modes:
        mode = np.array([one.frequency, one.damping, one.inertia_ratio])
        way = one.ways.get(order, 1.0)
        total += log_factor(mode, order * speed / (2.0 * np.pi), speed, way)
    return np.exp(total)


def largest_factor(modes: Sequence[FoundMode], order: float, speed: np.ndarray) -> np.ndarray:
    """Largest factor of the modes on an order at speeds (n,) [rad/s] that a budget takes, by loads that go round
    either way.
    """
    found, f = np.ones(speed.size), order * speed[None, :] / (2.0 * np.pi)
    for one in modes:
        mode = one.of_budget(float(speed.max()))
        found *= np.max(amplification(mode, f, np.array([order])).most, axis=(0, 1))
    return found


# ---- Coefficients ----


def fit_coefficient(reading: Reading, factor: np.ndarray) -> Coefficient:
    """The coefficient of a reading, whose modes amplify by ``factor`` (n,), with its interval by the
    scatter over speeds.

    Weighted least squares of powers over the fourth power of the speed, with Huber's weights, of the
    speeds at which the order is not weak; the interval is that of the residuals (sandwich estimate), by
    Student's t of the effective number of speeds, and of the scatter over speeds beyond noise: it is to
    hold the coefficient at any of them. What is seen at a speed is never above it, and what a speed lacks
    never below it.
    """
    quiet = (factor < NEAR_MODE) & (factor > 1.0 / NEAR_MODE)
    near_modes = int(quiet.sum()) < _LEAST_SPEEDS
    used = np.ones(factor.size, dtype=bool) if near_modes else quiet
    if int(used.sum()) < _LEAST_SPEEDS:
        return Coefficient(0.0, 0.0, np.inf, int(used.sum()), near_modes)
    one = reading.where(used)
    x = 0.5 * (one.speed**2 * factor[used]) ** 2
    one = _levelled(one, x)
    shown = _ratio_shown(one, x)
    first = _ratio_of_all(one, x) if shown is None else shown
    weak = is_weak(one, (shown or 0.0) * x)
    q, reach, seen = _ratio_and_reach(one.where(~weak), x[~weak], first)
    lowest, highest = _ratios_held(one, x, weak)
    usual, most = math.sqrt(q + reach), math.sqrt(max(q + reach, highest))
    if not seen:
        large = tuple(one.speed[one.at_least > 0.0].tolist())
        return Coefficient(0.0, 0.0, most, int(used.sum()), near_modes, large=large, usual=usual)
    return Coefficient(
        math.sqrt(q), math.sqrt(max(min(q - reach, lowest), 0.0)), most, int(np.sum(~weak)), near_modes,
        weak=tuple(one.speed[weak].tolist()),
        large=tuple(one.speed[one.at_least / x > _LARGE * (q + reach)].tolist()),
        usual=usual,
    )  # fmt: skip


def _levelled(reading: Reading, x: np.ndarray) -> Reading:
    """A reading whose quietest speeds tell no more of its ratio to ``x`` (n,) than others: that a run is
    silent must not bound an order.
    """
    usual = float(np.quantile(reading.still / x, _QUIETEST))
    return replace(reading, still=np.maximum(reading.still, usual * x))


def is_weak(reading: Reading, expected: np.ndarray) -> np.ndarray:
    """Speeds at which an order has less than half of the amplitude of an ``expected`` power (n,), (n,)."""
    return np.asarray(np.maximum(reading.power, 0.0) + reading.limit < WEAK * expected)


def _ratio_shown(reading: Reading, x: np.ndarray) -> float | None:
    """Ratio of powers to ``x`` (n,) at the speeds that show the order; None where these are too few of
    those that would show it.
    """
    clear = reading.at_least > 0.0
    if int(clear.sum()) < _LEAST_SPEEDS:
        return None
    ratio = float(np.median(reading.power[clear] / x[clear]))
    would = clear | (ratio * x > 2.0 * reading.limit)
    return ratio if clear.sum() >= _LEAST_SHARE * would.sum() else None


def _ratio_of_all(reading: Reading, x: np.ndarray) -> float:
    """Ratio of powers to ``x`` (n,), not below 0, by least squares with the floor's weights."""
    w = x / reading.still**2
    return max(float(np.sum(w * reading.power) / np.sum(w * x)), 0.0)


def _ratios_held(reading: Reading, x: np.ndarray, weak: np.ndarray) -> tuple[float, float]:
    """Smallest and largest ratio to ``x`` (n,) that an interval must hold: what an order is for sure below at any
    speed, and what it has at most where it is seen.
    """
    above = reading.power + reading.limit + _KNOWN * reading.noise
    below = np.where(weak, reading.at_least, np.maximum(above, 0.0))
    return float(np.min(below / x)), float(np.max(reading.at_most / x))


def _ratio_and_reach(reading: Reading, x: np.ndarray, first: float) -> tuple[float, float, bool]:
    """Ratio of the powers of a reading to ``x`` (n,), half of its interval, and whether it is above zero."""
    from scipy.stats import t as student

    q, w, scatter = _robust_ratio(reading, x, first)
    y, noise = reading.power, reading.noise_at(q * x)
    weight = w * x**2
    count = float(weight.sum() ** 2 / np.sum(weight**2))
    leverage = np.minimum(weight / weight.sum(), 0.9)
    error = float(np.sqrt(np.sum((w * x * (y - q * x) / (1.0 - leverage)) ** 2)) / weight.sum())
    by_noise = float(np.sqrt(np.sum((w * x * noise) ** 2)) / weight.sum())
    error = max(error, by_noise)
    freedom = max(count - 1.0, 1.0)
    reach = float(student.ppf(0.5 + 0.5 * CONFIDENCE, freedom)) * error
    reach = math.hypot(reach, KNOWN_WITHIN * scatter * q)
    return q, reach, q > float(student.ppf(_DETECTED, freedom)) * error


def over_axes(mean: Coefficient, axes: Sequence[Coefficient]) -> Coefficient:
    """The coefficient of the mean square of both axes, with an interval that holds those of either alone."""
    if not axes:
        return mean
    least = min(mean.least, *(one.least for one in axes))
    most = max(mean.most, *(one.most for one in axes))
    apart = max(one.least for one in axes) > min(one.most for one in axes)
    told = [mean, *axes]
    return replace(
        mean, least=least, most=most, axes_differ=apart, usual=max(one.usual for one in (mean, *axes)),
        weak=max((one.weak for one in told), key=len), large=max((one.large for one in told), key=len),
    )  # fmt: skip


def bound_coefficient(
    one: PowerMap, order: float, factor: np.ndarray, kept: np.ndarray | None = None
) -> float:
    """Upper bound on the coefficient of an order that other ridges mask at every speed, with modes that
    amplify by ``factor`` (n,) at the map's speeds: all that is in its bins is taken for it, at the median
    of the speeds that are ``kept``.
    """
    reading = read_order(one, order, (), kept)
    if not reading.speed.size:
        return float("inf")
    power = np.maximum(reading.power, 0.0) + _KNOWN * reading.noise
    used = np.isin(one.speed, reading.speed)
    return float(np.median(np.sqrt(2.0 * power) / (reading.speed**2 * factor[used])))


def _robust_ratio(reading: Reading, x: np.ndarray, first: float) -> tuple[float, np.ndarray, float]:
    """Ratio of powers to ``x`` (n,) from a ``first`` one on, and the weights of it: noise, scatter of the
    ratio and Huber's weights of what lies far off; and that scatter without noise, over the ratio.
    """
    q, y, scatter, own_scatter = first, reading.power, 0.02, 0.0
    w = 1.0 / reading.still**2
    for _ in range(_ITERATIONS):
        noise = reading.noise_at(q * x)
        strong = q * x > _KNOWN * noise
        if int(strong.sum()) >= _LEAST_SPEEDS:
            off = (y[strong] - q * x[strong]) / (q * x[strong])
            own = 1.4826 * float(np.median(np.abs(off - np.median(off))))
            scatter = max(own, 0.005)
            by_noise = float(np.median(noise[strong] / (q * x[strong])))
            own_scatter = math.sqrt(max(own**2 - by_noise**2, 0.0))
        variance = noise**2 + (scatter * q * x) ** 2
        away = np.abs(y - q * x) / np.sqrt(variance)
        w = np.minimum(1.0, 2.5 / np.maximum(away, 1e-12)) / variance
        q = max(float(np.sum(w * x * y) / np.sum(w * x**2)), 0.0)
    return q, w, own_scatter


# ---- Modes ----


@dataclass(frozen=True)
class _Rise:
    """An order's amplitude over the square of its speed."""

    order: float
    frequency: np.ndarray
    speed: np.ndarray
    log: np.ndarray
    """Logarithm of the amplitude over the square of the speed, (n,)."""


def find_modes(load: str, readings: Sequence[Reading], whirls: Sequence[Ridge]) -> list[FoundMode]:
    """Modes that a load's orders show by rising near them, and whirl that has ridges of its own."""
    motion = MOTIONS.get(load)
    rises = [one for one in (_rise(x) for x in readings) if one.log.size > _LEAST_SPEEDS]
    found: list[FoundMode] = []
    if motion is None:
        return found
    for _ in range(_MOST_MODES):
        left = [_less_modes(x, found) for x in rises]
        one = _next_mode(motion, left) if left else None
        if one is None:
            break
        found.append(one)
    if motion == "rocking":
        found += [_of_ridge(x) for x in whirls if not any(_is_same(one, x) for one in found)]
    return found


def _is_same(mode: FoundMode, ridge: Ridge) -> bool:
    f0, ratio = ridge.values
    return (
        abs(mode.frequency - f0) < 0.05 * f0 + 2.0 * ridge.uncertainty
        and abs(mode.inertia_ratio - ratio) < 0.2
    )


def _of_ridge(ridge: Ridge) -> FoundMode:
    f0, ratio = ridge.values
    damping = min(max(0.5 * ridge.width / f0, 1e-4), 0.5)
    ends = damping / _UNKNOWN_DAMPING, min(damping * _UNKNOWN_DAMPING, _LARGEST_DAMPING)
    return FoundMode("rocking", f0, damping, ratio, (ridge.uncertainty, np.nan), ends, "ridge", {})


def _rise(one: Reading) -> _Rise:
    known = one.power > _KNOWN * one.noise
    speed = one.speed[known]
    log = 0.5 * np.log(2.0 * one.power[known]) - 2.0 * np.log(speed)
    return _Rise(one.order, one.frequency[known], speed, log)


def _less_modes(one: _Rise, modes: Sequence[FoundMode]) -> _Rise:
    log = one.log.copy()
    for mode in modes:
        values = np.array([mode.frequency, mode.damping, mode.inertia_ratio])
        log -= log_factor(values, one.frequency, one.speed, mode.ways.get(one.order, 1.0))
    return replace(one, log=log)


def _deviations(modes: np.ndarray, one: _Rise, way: float) -> np.ndarray:
    """Capped deviations of one order to trial modes (3, g), (g, n)."""
    left = one.log - log_factor(modes[:, :, None], one.frequency, one.speed, way)
    return np.minimum(np.abs(left - np.median(left, axis=1, keepdims=True)), _CAPPED)


def _next_mode(motion: Motion, rises: Sequence[_Rise]) -> FoundMode | None:
    """The mode that explains most of what is left of orders; None where none does."""
    rocking = motion == "rocking"
    trial = _best_trial(rises, rocking)
    ways = {x.order: _way(trial, x) if rocking else 1.0 for x in rises}
    before = sum(float(np.sum(_spread_of(x))) for x in rises)
    mode, error, ends, after = _polished(trial, rises, ways, rocking)
    count = sum(x.log.size for x in rises)
    parameters = 3 if rocking else 2
    gain = 2.0 * count * np.log(max(before, 1e-9) / max(after, 1e-9)) - parameters * np.log(count)
    raised = sum(_raised(mode, x, ways[x.order]) for x in rises)
    if gain < _CRITERION or raised < _LEAST_RAISED:
        return None
    return FoundMode(
        motion, float(mode[0]), float(mode[1]), float(mode[2]),
        tuple(error.tolist()), ends, "orders", ways,
    )  # fmt: skip


def _best_trial(rises: Sequence[_Rise], rocking: bool) -> np.ndarray:
    """Frequency [Hz], damping and ratio of the trial mode that orders deviate least from."""
    highest = 1.1 * max(float(x.frequency.max()) for x in rises)
    lowest = min(float(x.frequency.min()) for x in rises)
    f0 = np.geomspace(lowest, highest, int(np.log(highest / lowest) / 0.012) + 2)
    ratios = np.arange(0.1, 2.01, 0.1) if rocking else np.zeros(1)
    either = (1.0, -1.0) if rocking else (1.0,)
    grid = np.array(np.meshgrid(f0, _DAMPINGS, ratios, indexing="ij")).reshape(3, -1)
    cost = np.zeros(grid.shape[1])
    for one in rises:
        cost += np.min([np.sum(_deviations(grid, one, way), axis=1) for way in either], axis=0)
    return np.asarray(grid[:, int(np.argmin(cost))])


def _spread_of(one: _Rise) -> np.ndarray:
    return np.minimum(np.abs(one.log - np.median(one.log)), _CAPPED)


def _way(mode: np.ndarray, one: _Rise) -> float:
    """Direction that fits an order better."""
    sums = {way: float(np.sum(_deviations(mode[:, None], one, way))) for way in (1.0, -1.0)}
    return min(sums, key=lambda way: sums[way])


def _raised(mode: np.ndarray, one: _Rise, way: float) -> int:
    """Readings that a mode raises, and that are raised."""
    factor = log_factor(mode, one.frequency, one.speed, way)
    level = np.median(one.log - factor)
    return int(np.sum((factor > _RAISED) & (one.log - level > _RAISED)))


class _Misfit:
    """Deviations of some orders from a mode and their own levels, by the logarithms of its frequency and
    damping, its ratio where it rocks, and the levels.
    """

    def __init__(self, rises: Sequence[_Rise], ways: Mapping[float, float], rocking: bool) -> None:
        self._rises, self._ways = rises, ways
        self.number = 3 if rocking else 2
        """Parameters of the mode."""
        levels = len(rises)
        self.low = np.full(self.number + levels, -np.inf)
        self.high = -self.low
        measured = np.concatenate([one.frequency for one in rises])
        self.low[_FREQUENCY] = np.log(float(measured.min()) / _BEYOND)
        self.high[_FREQUENCY] = np.log(float(measured.max()) * _BEYOND)
        self.low[_DAMPING], self.high[_DAMPING] = np.log(_LEAST_DAMPING), np.log(_LARGEST_DAMPING)
        if rocking:
            self.low[2], self.high[2] = 0.0, 2.0

    def start(self, trial: np.ndarray) -> np.ndarray:
        """Parameters of a trial mode (3,), with the levels that fit it."""
        levels = [float(np.median(one.log - self._factor(trial, one))) for one in self._rises]
        found = np.r_[np.log(trial[:2]), trial[2 : self.number], levels]
        return np.clip(found, self.low + 1e-9, self.high - 1e-9)

    def mode(self, p: np.ndarray) -> np.ndarray:
        """Frequency [Hz], damping and ratio."""
        return np.array([np.exp(p[0]), np.exp(p[1]), p[2] if self.number == 3 else 0.0])

    def deviations(self, p: np.ndarray) -> np.ndarray:
        """Logarithms of readings over the fit, of one order after another, (n,)."""
        mode, levels = self.mode(p), p[self.number :]
        return np.concatenate(
            [
                one.log - self._factor(mode, one) - level
                for one, level in zip(self._rises, levels, strict=True)
            ]
        )

    def scatter(self, left: np.ndarray) -> np.ndarray:
        """Standard deviation of the readings of each order, by what a fit has ``left`` (n,), (n,)."""
        ends = np.cumsum([one.log.size for one in self._rises])
        of_each = [_spread_about_zero(own) for own in np.split(left, ends[:-1])]
        return np.repeat(of_each, np.diff(ends, prepend=0))

    def _factor(self, mode: np.ndarray, one: _Rise) -> np.ndarray:
        return log_factor(mode, one.frequency, one.speed, self._ways[one.order])


def _spread_about_zero(left: np.ndarray) -> float:
    return max(1.4826 * float(np.median(np.abs(left))), _LEAST_SCATTER)


def _polished(
    trial: np.ndarray, rises: Sequence[_Rise], ways: Mapping[float, float], rocking: bool
) -> tuple[np.ndarray, np.ndarray, tuple[float, float], float]:
    """The mode that fits best near a trial, standard uncertainties of its frequency [Hz] and ratio, the ends of
    its damping, and the capped deviation.
    """
    from scipy.optimize import least_squares

    misfit = _Misfit(rises, ways, rocking)
    fit = least_squares(
        misfit.deviations, misfit.start(trial), loss="soft_l1", f_scale=0.05,
        bounds=(misfit.low, misfit.high),
    )  # fmt: skip
    mode, left = misfit.mode(fit.x), misfit.deviations(fit.x)
    scatter = misfit.scatter(left)
    weighted = fit.jac / scatter[:, None]
    error = np.sqrt(np.maximum(np.diag(np.linalg.pinv(weighted.T @ weighted)), 0.0))
    ends = [
        _ends(misfit, fit.x, scatter, k, step)
        for k, step in ((_FREQUENCY, max(float(error[_FREQUENCY]), _LEAST_STEP)), (_DAMPING, 0.1))
    ]
    of_frequency = max(abs(end / mode[0] - 1.0) for end in ends[_FREQUENCY]) / KNOWN_WITHIN
    errors = np.array([mode[0] * of_frequency, float(error[2]) if rocking else 0.0])
    return mode, errors, ends[_DAMPING], float(np.sum(np.minimum(np.abs(left), _CAPPED)))


def _ends(
    misfit: _Misfit, best: np.ndarray, scatter: np.ndarray, which: int, step: float
) -> tuple[float, float]:
    """Frequencies [Hz] or dampings, by ``which``, between which a mode's is with a probability of 95 %, by what
    the best of all fits with each of them leaves of readings with a ``scatter`` (n,) (profile likelihood):
    readings that are not near the peak tell little of how high it is. A first ``step`` of its logarithm is
    doubled until it is outside.
    """
    from scipy.optimize import least_squares

    free = np.arange(best.size) != which

    def cost(log_value: float) -> float:
        def deviations(rest: np.ndarray) -> np.ndarray:
            return misfit.deviations(np.insert(rest, which, log_value)) / scatter

        fit = least_squares(
            deviations, best[free], loss="soft_l1", f_scale=KNOWN_WITHIN,
            bounds=(misfit.low[free], misfit.high[free]),
        )  # fmt: skip
        return 2.0 * float(fit.cost)

    own = float(best[which])
    allowed = cost(own) + KNOWN_WITHIN**2

    def end(towards: float, first: float) -> float:
        inside, outside, wide = own, own + first, first
        while abs(outside - own) < abs(towards - own) and cost(outside) <= allowed:
            wide *= 2.0
            inside, outside = outside, own + wide
        if abs(outside - own) >= abs(towards - own):
            outside = towards
            if cost(outside) <= allowed:
                return outside
        for _ in range(_HALVINGS):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if cost(middle) <= allowed else (inside, middle)
        return outside

    low, high = float(misfit.low[which]), float(misfit.high[which])
    return math.exp(end(low, -step)), math.exp(end(high, step))
