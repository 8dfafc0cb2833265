"""Harmonic coefficients and structural modes of a wheel, from the ridges of its waterfalls."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.signals.ridges import PowerMap, Ridge, whirl_paths

CONFIDENCE = 0.95
"""Confidence level of the intervals of coefficients."""
NEAR_MODE = 1.5
"""Amplification by a mode, or its inverse, from which a speed tells nothing of a coefficient."""
_TWO_SIDED = 2.0
"""Standard uncertainties within which a figure of a mode is, with a probability of 95 %."""
_UNKNOWN_DAMPING, _UNKNOWN_RATIO = 2.0, 0.1
"""Factor of a damping that only the width of a ridge tells, and by how much its ratio of inertias may be off
(assumed)."""
_LARGEST_DAMPING, _LARGEST_ERROR = 0.5, 0.45
"""Largest that a budget takes."""
_DETECTED = 0.998
"""Confidence with which a coefficient must be above zero to be taken for one."""
_LEAST_SPEEDS = 4
_KNOWN = 3.0
"""Times of its noise from which a reading tells of modes."""
_MOTION = {"radial_force": "radial", "radial_torque": "rocking", "axial_force": "axial"}
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


@dataclass(frozen=True)
class Reading:
    """An order in one map, at the speeds at which no other ridge is near it."""

    order: float
    speed: np.ndarray
    """[rad/s], (n,)."""
    power: np.ndarray
    """Half of the squared amplitude less the floor, (n,)."""
    noise: np.ndarray
    """Standard deviation of that by the floor, (n,)."""

    @property
    def frequency(self) -> np.ndarray:
        """[Hz], (n,)."""
        return np.asarray(self.order * self.speed / (2.0 * np.pi))


@dataclass(frozen=True)
class FoundMode:
    """A structural mode of the wheel."""

    motion: str
    frequency: float
    """At rest [Hz]."""
    damping: float
    inertia_ratio: float
    uncertainty: tuple[float, float, float]
    """Standard uncertainties of frequency [Hz], damping and ratio; nan where not known."""
    how: str
    """*orders* that rise near it, or a *ridge* of its own."""
    ways: Mapping[float, float]
    """Direction in which orders fit best that cross it, 1 with the wheel and -1 against it."""

    @property
    def dampings(self) -> tuple[float, float]:
        """Between which its damping is with a probability of 95 %; assumed where the fit does not tell."""
        error = self.uncertainty[1] / self.damping
        factor = _UNKNOWN_DAMPING if np.isnan(error) else math.exp(_TWO_SIDED * error)
        return self.damping / factor, min(self.damping * factor, _LARGEST_DAMPING)

    def frequency_error(self, speed: float) -> float:
        """Part by which its frequency, or those of its whirl up to a ``speed`` [rad/s], may be off with a
        probability of 95 %; what the ratio of inertias is off by moves whirl.
        """
        own, _, of_ratio = self.uncertainty
        found = own / self.frequency
        if self.motion == "rocking":
            off = _UNKNOWN_RATIO / _TWO_SIDED if np.isnan(of_ratio) else of_ratio
            still = 2.0 * math.pi * self.frequency
            found += 0.5 * off * speed / math.hypot(still, 0.5 * self.inertia_ratio * speed)
        return min(_TWO_SIDED * found, _LARGEST_ERROR)


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


def read_order(one: PowerMap, order: float, ridges: Sequence[Ridge]) -> Reading:
    """An order in a map, where no other ridge comes nearer than the bins of both."""
    f = order * one.speed / (2.0 * np.pi)
    reach = one.lobe + np.ceil(0.5 * order * one.smear / (2.0 * np.pi * one.spacing)).astype(int)
    clear = one.bins(f) - reach >= 1
    clear &= one.bins(f) + reach < one.frequency.size
    for ridge in ridges:
        for path in ridge_paths(ridge, one.speed):
            if ridge.kind == "order" and ridge.values[0] == order:
                continue
            clear &= np.abs(path - f) > (reach + one.lobe + 1) * one.spacing
    power, noise = [], []
    for i in np.flatnonzero(clear):
        near = slice(one.bins(f)[i] - reach[i], one.bins(f)[i] + reach[i] + 1)
        floor = one.floor[i, near]
        total = float(one.power[i, near].sum() - floor.sum())
        power.append(total)
        own = 1.5 * float(np.sum(floor**2)) + 2.0 * max(total, 0.0) * float(floor.mean())
        noise.append(np.sqrt(own / one.averages))
    return Reading(order, one.speed[clear], np.array(power), np.array(noise))


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


# ---- Coefficients ----


def fit_coefficient(reading: Reading, factor: np.ndarray) -> Coefficient:
    """The coefficient of a reading, whose modes amplify by ``factor`` (n,), with its interval by the
    scatter over speeds.

    Weighted least squares of powers over the fourth power of the speed, with Huber's weights; the
    interval is that of the residuals (sandwich estimate), by Student's t of the effective number of
    speeds, and of the scatter over speeds beyond noise: it is to hold the coefficient at any of them.
    """
    from scipy.stats import t as student

    quiet = (factor < NEAR_MODE) & (factor > 1.0 / NEAR_MODE)
    near_modes = int(quiet.sum()) < _LEAST_SPEEDS
    used = np.ones(factor.size, dtype=bool) if near_modes else quiet
    if int(used.sum()) < _LEAST_SPEEDS:
        return Coefficient(0.0, 0.0, np.inf, int(used.sum()), near_modes)
    x = 0.5 * (reading.speed[used] ** 2 * factor[used]) ** 2
    y, noise = reading.power[used], reading.noise[used]
    q, w, scatter = _robust_ratio(x, y, noise)
    weight = w * x**2
    count = float(weight.sum() ** 2 / np.sum(weight**2))
    leverage = np.minimum(weight / weight.sum(), 0.9)
    error = float(np.sqrt(np.sum((w * x * (y - q * x) / (1.0 - leverage)) ** 2)) / weight.sum())
    by_noise = float(np.sqrt(np.sum((w * x * noise) ** 2)) / weight.sum())
    error = max(error, by_noise)
    freedom = max(count - 1.0, 1.0)
    reach = float(student.ppf(0.5 + 0.5 * CONFIDENCE, freedom)) * error
    reach = math.hypot(reach, _TWO_SIDED * scatter * q)
    value, most = np.sqrt(max(q, 0.0)), np.sqrt(max(q, 0.0) + reach)
    if q <= float(student.ppf(_DETECTED, freedom)) * error:
        return Coefficient(0.0, 0.0, float(most), int(used.sum()), near_modes)
    least = float(np.sqrt(max(q - reach, 0.0)))
    return Coefficient(float(value), least, float(most), int(used.sum()), near_modes)


def over_axes(mean: Coefficient, axes: Sequence[Coefficient]) -> Coefficient:
    """The coefficient of the mean square of both axes, with an interval that holds those of either alone."""
    if not axes:
        return mean
    least = min(mean.least, *(one.least for one in axes))
    most = max(mean.most, *(one.most for one in axes))
    apart = max(one.least for one in axes) > min(one.most for one in axes)
    return replace(mean, least=least, most=most, axes_differ=apart)


def bound_coefficient(one: PowerMap, order: float, factor: np.ndarray) -> float:
    """Upper bound on the coefficient of an order that other ridges mask at every speed, with modes that
    amplify by ``factor`` (n,) at the map's speeds: all that is in its bins is taken for it.
    """
    reading = read_order(one, order, ())
    kept = np.isin(one.speed, reading.speed)
    if not reading.speed.size:
        return float("inf")
    power = np.maximum(reading.power, 0.0) + _KNOWN * reading.noise
    each = np.sort(np.sqrt(2.0 * power) / (reading.speed**2 * factor[kept]))
    return float(each[min(2, each.size - 1)])  # of those at all speeds, one that noise did not make


def _robust_ratio(
    x: np.ndarray, y: np.ndarray, noise: np.ndarray
) -> tuple[float, np.ndarray, float]:
    """Ratio of ``y`` to ``x`` (n,), and the weights of it: noise, scatter of the ratio and Huber's
    weights of what lies far off; and that scatter without noise, over the ratio.
    """
    q = max(float(np.sum(x * y / noise**2) / np.sum((x / noise) ** 2)), 0.0)
    w = 1.0 / noise**2
    scatter, own_scatter = 0.02, 0.0
    for _ in range(_ITERATIONS):
        variance = noise**2 + (scatter * q * x) ** 2
        strong = q * x > _KNOWN * noise
        if int(strong.sum()) >= _LEAST_SPEEDS:
            off = (y[strong] - q * x[strong]) / (q * x[strong])
            own = 1.4826 * float(np.median(np.abs(off - np.median(off))))
            scatter = max(own, 0.005)
            by_noise = float(np.median(noise[strong] / (q * x[strong])))
            own_scatter = math.sqrt(max(own**2 - by_noise**2, 0.0))
        away = np.abs(y - q * x) / np.sqrt(variance)
        w = np.minimum(1.0, 2.5 / np.maximum(away, 1e-12)) / variance
        q = max(float(np.sum(w * x * y) / np.sum(w * x**2)), 0.0)
    return float(np.sum(w * x * y) / np.sum(w * x**2)), w, own_scatter


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
    motion = _MOTION.get(load)
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
    return FoundMode(
        "rocking", f0, damping, ratio, (ridge.uncertainty, np.nan, np.nan), "ridge", {}
    )


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


def _next_mode(motion: str, rises: Sequence[_Rise]) -> FoundMode | None:
    """The mode that explains most of what is left of orders; None where none does."""
    rocking = motion == "rocking"
    trial = _best_trial(rises, rocking)
    ways = {x.order: _way(trial, x) if rocking else 1.0 for x in rises}
    before = sum(float(np.sum(_spread_of(x))) for x in rises)
    mode, error, after = _polished(trial, rises, ways, rocking)
    count = sum(x.log.size for x in rises)
    parameters = 3 if rocking else 2
    gain = 2.0 * count * np.log(max(before, 1e-9) / max(after, 1e-9)) - parameters * np.log(count)
    raised = sum(_raised(mode, x, ways[x.order]) for x in rises)
    if gain < _CRITERION or raised < _LEAST_RAISED:
        return None
    return FoundMode(
        motion, float(mode[0]), float(mode[1]), float(mode[2]),
        tuple(error.tolist()), "orders", ways,
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


def _polished(
    trial: np.ndarray, rises: Sequence[_Rise], ways: Mapping[float, float], rocking: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """The mode that fits best near a trial, its standard uncertainties, and their capped deviation."""
    from scipy.optimize import least_squares

    number = 3 if rocking else 2

    def unpacked(p: np.ndarray) -> np.ndarray:
        ratio = p[2] if rocking else 0.0
        return np.array([np.exp(p[0]), np.exp(p[1]), ratio])

    def deviation(p: np.ndarray) -> np.ndarray:
        mode = unpacked(p)
        return np.concatenate(
            [
                x.log - log_factor(mode, x.frequency, x.speed, ways[x.order]) - p[number + k]
                for k, x in enumerate(rises)
            ]
        )

    levels = [
        float(np.median(x.log - log_factor(trial, x.frequency, x.speed, ways[x.order])))
        for x in rises
    ]
    start = np.r_[np.log(trial[:2]), trial[2:number], levels]
    low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
    low[1], high[1] = np.log(2e-4), np.log(0.5)
    if rocking:
        low[2], high[2] = 0.0, 2.0
    start = np.clip(start, low + 1e-9, high - 1e-9)
    fit = least_squares(deviation, start, loss="soft_l1", f_scale=0.05, bounds=(low, high))
    mode, left = unpacked(fit.x), deviation(fit.x)
    spread = max(1.4826 * float(np.median(np.abs(left))), 1e-4)
    J = fit.jac
    error = spread * np.sqrt(np.maximum(np.diag(np.linalg.pinv(J.T @ J)), 0.0))
    ratio = float(error[2]) if rocking else 0.0
    errors = np.array([mode[0] * error[0], mode[1] * error[1], ratio])
    return mode, errors, float(np.sum(np.minimum(np.abs(left), _CAPPED)))
