"""The figure that a requirement asks for, of lines and densities; between what it lies where they
are known in part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from microvib.analysis.margins import frequency_error_bound
from microvib.analysis.pointing import FREQUENCY_TOLERANCE
from microvib.signals.error_rows import ErrorRows
from microvib.signals.in_step import SLOW, in_step
from microvib.signals.pointing import (
    HALF_WINDOW,
    UNIFORM_INSTANTS,
    WHOLE_WINDOW,
    WITHIN_WINDOW,
    Distribution,
    change_within_cells,
    confidence_level_angle,
    distribution,
    excess_between_instants,
    mean_square_of_density,
    mean_square_of_lines,
    mean_squares_at_instants,
    metric_weight,
    row_shares,
    windowed_amplitudes,
    within_all,
    worst_case_angle,
)
from microvib.studies.budget.errors import CORNERS, NO_ERRORS, ErrorSum, Unit
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.sources import Contribution, Unobserved
from microvib.units import within_band as in_band

INCOHERENT = -1
AXES = {"x": [0], "y": [1], "radial": [0, 1]}
_FREQUENCY_SAMPLES = np.r_[0.0, np.sin(np.arange(100.0) ** 2)]
"""Parts of what a frequency may be off that are tried, unlike each other: after many periods they
decide where a window ends.
"""
MIN_MONOTONE_CONFIDENCE = 0.95
"""Confidence from which what nothing bounds is left out of a level's least; below, it may take
lines from their crests.
"""


@dataclass(frozen=True)
class CombinedLines:
    """Lines of all sources, one for each frequency: amplitudes [rad], (k, 2), with best, given and
    worst phases.
    """

    frequency: np.ndarray
    least: np.ndarray
    value: np.ndarray
    most: np.ndarray
    phasor: np.ndarray
    """Phase of the largest of those of one frequency, exp(j phase), (k, 2)."""
    clock: np.ndarray
    """Its clock, by number, (k, 2): harmonics of one clock keep their phases to each other; ALONE
    for those that keep none.
    """
    off: np.ndarray
    """By how much frequencies may be off [Hz], (k,)."""
    errors: ErrorSum = NO_ERRORS
    """Errors of the sources beside lines and densities."""

    @property
    def frequency_bounds(self) -> np.ndarray:
        """Between which frequencies [Hz] lines may be, (2, k)."""
        return np.array([self.frequency - self.off, self.frequency + self.off])


def evaluate_metric(
    requirement: Requirement,
    frequency: np.ndarray,
    amplitude: np.ndarray,
    densities: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    *,
    single_axis: bool = False,
    clock: np.ndarray | None = None,
) -> float:
    """The figure that is required [rad], of lines (k,) [Hz] with amplitudes (k, 2) [rad] and
    densities.

    What both axes reach together is a bound, since they need not do so at once; ``single_axis`` it is
    what one of them does. A level depends on the phases that lines of one ``clock`` (k, 2) keep, of
    complex amplitudes; those of all others count as unrelated.
    """
    moved = Moved(frequency, amplitude, densities, clock)
    return evaluate(requirement, moved, single_axis=single_axis)


class Moved(NamedTuple):
    """Motion of the line of sight: lines (k,) [Hz] with amplitudes (k, 2) [rad], densities and errors."""

    frequency: np.ndarray
    amplitude: np.ndarray
    densities: Sequence[tuple[np.ndarray, np.ndarray]] = ()
    clock: np.ndarray | None = None
    """Clocks of the lines, (k, 2), as in ``evaluate_metric``."""
    errors: ErrorSum = NO_ERRORS

    def in_band(self, r: Requirement) -> Moved:
        """Motion with the lines that count alone."""
        counts = counts_in_band(r, self.frequency)
        f, tones = self.frequency[counts], self.amplitude[counts]
        clock = np.full(tones.shape, INCOHERENT) if self.clock is None else self.clock[counts]
        return self._replace(frequency=f, amplitude=tones, clock=clock)


NOTHING = Moved(np.zeros(0), np.zeros((0, 2)))


def evaluate(r: Requirement, moved: Moved, *, single_axis: bool = False) -> float:
    """The figure that is required of all that moves the line of sight [rad]."""
    axes, moved = AXES[r.axis], moved.in_band(r)
    if r.statistic == "rms":
        A, window = np.abs(moved.amplitude), _window(r)
        lines = mean_square_of_lines(r.metric, moved.frequency, A[:, axes], window, r.apart)
        noise = np.array(_noise(r, moved.densities))[axes]
        errors = sum(moved.errors.mean_square(r, k) for k in axes) if moved.errors else 0.0
        return math.sqrt(float(np.sum(lines)) + float(noise.sum()) + errors)
    if r.statistic == "bound":
        each = [_crest(r, moved, k) for k in axes]
    else:  # both axes within theirs, each for a part of the time such that both are for the part that is asked for
        part = 1.0 - (1.0 - r.confidence) / len(axes)
        each = [_level(r, moved, k, part) for k in axes]
    if single_axis:
        return max(each)
    return math.hypot(*each)


def _crest(r: Requirement, moved: Moved, axis: int) -> float:
    """All at their crests at the worst instant of a window, about an axis [rad]."""
    A = np.abs(moved.amplitude[:, axis])
    f, sigma = moved.frequency, _noise_at_instants(r, moved.densities, axis, UNIFORM_INSTANTS)
    rows = windowed_amplitudes(r.metric, f, A, _window(r), r.apart, UNIFORM_INSTANTS)
    if not moved.errors:
        return worst_case_angle(rows, sigma, r.sigmas)
    unknown = moved.errors.unknown_crest(r, axis)
    bounded = math.isfinite(unknown)  # if not, its reason keeps a requirement from being judged
    errors = moved.errors.rows(r, axis, UNIFORM_INSTANTS, exact=bounded)
    lines = np.sum(np.abs(np.atleast_2d(rows)), axis=1)
    return float(np.max(lines + errors.crest(sigma**2, r.sigmas))) + (unknown if bounded else 0.0)


def _level(r: Requirement, moved: Moved, axis: int, part: float) -> float:
    """Within which the error about an axis is for a part of the time, of units or of both [rad]."""
    if r.interpretation == "ensemble":
        time_alone = _crest(r, moved._replace(errors=moved.errors.over_time), axis)
        units = [distribution(_NO_LINES, one) for one in moved.errors.ends(r, axis)]
        return time_alone + max(one.within(part) for one in units)
    assert moved.clock is not None
    clocks = moved.clock[:, axis]
    cells = WHOLE_WINDOW if np.any(moved.clock != INCOHERENT) else HALF_WINDOW
    f, tones = moved.frequency, moved.amplitude[:, axis]
    rows = windowed_amplitudes(r.metric, f, tones, _window(r), r.apart, cells.instants)
    sigma = _noise_at_instants(r, moved.densities, axis, cells.instants)
    shares = row_shares(r.metric, cells)
    if not moved.errors:
        return confidence_level_angle(rows, sigma, part, frequency=f, clock=clocks, shares=shares)
    found = []
    for unit in units_of(r):
        beside = moved.errors.rows(r, axis, cells.instants, unit).with_noise(sigma)
        spread = distribution(rows, beside, frequency=f, clock=clocks, shares=shares)
        found.append(spread.within(part))
    return max(found)


def units_of(r: Requirement) -> tuple[Unit | None, ...]:
    """Units of which the worst counts: any, or those that a temporal interpretation looks at."""
    return CORNERS if r.interpretation == "temporal" else (None,)


_NO_LINES = np.zeros((1, 0))


def evaluate_lines(
    r: Requirement, tones: CombinedLines, densities: Sequence[tuple[np.ndarray, np.ndarray]] = ()
) -> float:
    """The figure that is required of what the sources are given as."""
    value = tones.value * tones.phasor
    return evaluate(r, Moved(tones.frequency, value, densities, tones.clock, tones.errors))


def evaluate_errors(r: Requirement, errors: ErrorSum) -> float:
    """The figure that is required of errors alone."""
    return evaluate(r, NOTHING._replace(errors=errors))


def metric_bounds(
    r: Requirement,
    tones: CombinedLines,
    gaps: Sequence[Unobserved],
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
    moving: SweptLines | None = None,
    largest: Sequence[tuple[np.ndarray, np.ndarray]] | None = None,
) -> tuple[float, float]:
    """Between which the figure lies: least and most; infinite where nothing bounds a gap.

    Densities that are not known are given as small as they may be, and as ``largest`` once more.
    """
    if largest is None:
        largest = densities
    if r.statistic == "level":
        return _level_bounds(r, tones, gaps, (densities, largest), moving or SweptLines(tones))
    lower, upper = (_extreme_frequencies(r, tones, extreme) for extreme in (np.argmin, np.argmax))
    hidden_at, hidden = _unobserved_lines(gaps)
    smallest = Moved(lower, tones.least, densities, errors=tones.errors)
    least = evaluate(r, smallest, single_axis=True)
    least = max(least - _crest_offset(r, tones, lower, tones.least, -1.0), 0.0)
    if not np.all(np.isfinite(hidden)):
        return least, math.inf
    if moving is not None and r.statistic == "bound":
        return least, _crest_bound(
            r, moving, Unobserved("", 0.0, math.inf, hidden_at, hidden), largest
        )
    f, most = np.concatenate([upper, hidden_at]), np.vstack([tones.most, hidden])
    beyond = _excess_of_bound(r, f, most) + _crest_offset(r, tones, upper, tones.most, 1.0)
    return least, evaluate(r, Moved(f, most, largest, errors=tones.errors)) + beyond


def _crest_offset(
    r: Requirement, tones: CombinedLines, at: np.ndarray, amplitude: np.ndarray, sign: float
) -> float:
    """By how much lines of ``amplitude`` (k, 2) may crest higher (``sign`` 1) or lower (-1) at
    frequencies that they may have than at those where their mean squares are extreme [rad].

    At an instant of a window a line about its mean may be largest at another frequency than over
    the whole window.
    """
    if r.statistic != "bound" or r.metric not in ("rpe", "jitter"):
        return 0.0

    def sizes(f: np.ndarray) -> np.ndarray:
        rows = windowed_amplitudes(
            r.metric, f, np.ones(f.size), _window(r), r.apart, UNIFORM_INSTANTS
        )
        return np.abs(rows)

    own, found = sizes(at), np.zeros(at.size)
    for part in _FREQUENCY_SAMPLES:
        change = sign * (sizes(tones.frequency + part * tones.off) - own)
        found = np.maximum(found, change.max(axis=0))
    counted = np.abs(amplitude[:, AXES[r.axis]]) * counts_in_band(r, at)[:, None]
    return math.hypot(*(found @ counted))


def _excess_of_bound(r: Requirement, frequency: np.ndarray, most: np.ndarray) -> float:
    """By how much lines (k,) [Hz] of amplitudes (k, 2) may crest higher between the instants of a
    bound [rad].
    """
    if r.statistic != "bound":
        return 0.0
    spacing = float(UNIFORM_INSTANTS[1])
    each = excess_between_instants(r.metric, frequency, _window(r), spacing)
    size = np.abs(most[:, AXES[r.axis]]) * counts_in_band(r, frequency)[:, None]
    return math.hypot(*(each @ size))


@dataclass(frozen=True)
class SweptLines:
    """Lines of which some are at one of several places, such as those of a wheel at a speed: what
    crests there may be at most.
    """

    others: CombinedLines
    """Lines of all sources that are at one place."""
    x: float = 0.0
    y: float = 0.0
    together: float = 0.0
    """Most that lines of the others reach about either axis and about the required ones together,
    wherever they are [rad].
    """

    def upper_bound_with(
        self, axes: Sequence[int], of_others: Callable[[Sequence[float]], list[float]]
    ) -> float:
        """Most of all lines about ``axes``; ``of_others`` is that of the others about each, by what
        is beside them.
        """
        crests = [(self.x, self.y)[k] for k in axes]
        return min(
            math.hypot(*of_others(crests)),
            math.hypot(*of_others([0.0 for _ in axes])) + self.together,
        )


def _crest_bound(
    r: Requirement,
    moving: SweptLines,
    hidden: Unobserved,
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
) -> float:
    """The bound of all lines and densities, wherever those are that move."""
    upper = _extreme_frequencies(r, moving.others, np.argmax)
    frequency = np.concatenate([upper, hidden.frequency])
    amplitude = np.vstack([moving.others.most, hidden.most])
    each = [r.model_copy(update={"axis": "xy"[k]}) for k in AXES[r.axis]]
    found = [
        evaluate(one, Moved(frequency, amplitude, densities, errors=moving.others.errors))
        + _excess_of_bound(one, frequency, amplitude)
        + _crest_offset(one, moving.others, upper, moving.others.most, 1.0)
        for one in each
    ]
    return moving.upper_bound_with(AXES[r.axis], lambda more: np.add(found, more).tolist())


def _unobserved_lines(gaps: Sequence[Unobserved]) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (m,) [Hz] of the lines that gaps may hide, and their largest amplitudes (m, 2)
    [rad].
    """
    at = np.concatenate([np.zeros(0), *(gap.frequency for gap in gaps)])
    return at, np.vstack([np.zeros((0, 2)), *(gap.most for gap in gaps)])


# ---- Levels: between which they lie over all phases that nobody stated ----


def _level_bounds(
    r: Requirement,
    tones: CombinedLines,
    gaps: Sequence[Unobserved],
    densities: tuple[Sequence[tuple[np.ndarray, np.ndarray]], ...],
    moving: SweptLines,
) -> tuple[float, float]:
    """Least and most of a level; ``densities`` as small and as large as they may be.

    Harmonics of one clock keep their phases. Of all others neither phases nor the exact ratios of
    frequencies are known: they may crest together or make each other's crests lower. So the largest
    group of known phases has its distribution, and everything beside it adds its crests in *most*
    and takes them off in *least*. What is beside may be as large as the group; then the mean square
    tells more, which does not depend on phases: above x for a part 1 - c of the time it is (1 - c)
    x^2 at the least.
    """
    if r.interpretation == "ensemble":
        return _ensemble_bounds(r, tones, gaps, densities, moving)
    at, hidden = _unobserved_lines([gap for gap in gaps if not gap.of_squares])
    bounded = np.all(np.isfinite(hidden), axis=1)
    if r.confidence < MIN_MONOTONE_CONFIDENCE and not bounded.all():
        return 0.0, math.inf
    axes = AXES[r.axis]
    both_within = 1.0 - (1.0 - r.confidence) / len(axes)
    known = Unobserved("", 0.0, math.inf, at[bounded], hidden[bounded])
    smallest, largest = densities
    least, found = _least_level(r, tones, known, smallest)
    if not bounded.all():
        return least, math.inf
    _, squares = metric_bounds(r.model_copy(update={"statistic": "rms"}), tones, gaps, largest)
    if moving.together or largest is not smallest or r.interpretation == "temporal":
        found = [_of_worst(r, moving.others, known, largest, k) for k in axes]
    by_squares = squares / math.sqrt(1.0 - r.confidence)
    if not all(np.all(np.isfinite(beside)) for _, beside in found):
        return least, by_squares
    most = moving.upper_bound_with(
        axes,
        lambda more: [
            spread.within(both_within, beside + x)
            for x, (spread, beside) in zip(more, found, strict=True)
        ],
    )
    return least, min(most, by_squares)


def _least_level(
    r: Requirement,
    tones: CombinedLines,
    known: Unobserved,
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
) -> tuple[float, list[tuple[Distribution, np.ndarray]]]:
    """Level below which none is, whatever the phases that nobody stated [rad], and the distributions
    about each axis, of each unit that is looked at, that it follows from.
    """
    found = [
        _largest_group_distribution(r, tones, known, densities, _Of(k, unit))
        for unit in units_of(r)
        for k in AXES[r.axis]
    ]
    least = max(spread.within(r.confidence, -beside) for spread, beside in found)
    if not tones.errors:
        least = max(least, _mean_square_floor(r, tones, known, densities))
    return least, found


def _of_worst(
    r: Requirement,
    tones: CombinedLines,
    hidden: Unobserved,
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
    axis: int,
) -> tuple[Distribution, np.ndarray]:
    """``_largest_group_distribution`` of all units or, in a temporal interpretation, of the mean one
    with what the worst has beyond it beside.
    """
    temporal = r.interpretation == "temporal"
    of = _Of(axis, CORNERS[0] if temporal else None, worst=temporal)
    return _largest_group_distribution(r, tones, hidden, densities, of)


def _ensemble_bounds(
    r: Requirement,
    tones: CombinedLines,
    gaps: Sequence[Unobserved],
    densities: tuple[Sequence[tuple[np.ndarray, np.ndarray]], ...],
    moving: SweptLines,
) -> tuple[float, float]:
    """Least and most of a level over units, each at its largest over the time.

    What changes with time has a mean of zero: beside a constant B its largest value is B and the crests
    of all at most, and the root of the mean square of both at least. A unit with a drift has passed
    neither its beginning nor its end, each taken by itself, in all but the sum of both parts.
    """
    smallest, largest = densities
    axes, confidence = AXES[r.axis], r.confidence
    both_within = 1.0 - (1.0 - confidence) / len(axes)
    over_time = tones.errors.over_time
    still = replace(tones, errors=over_time)
    others = replace(moving, others=replace(moving.others, errors=over_time))
    least, most = 0.0, []
    for k in axes:
        own = r.model_copy(update={"axis": "xy"[k], "interpretation": None})
        rms, bound = (own.model_copy(update={"statistic": x}) for x in ("rms", "bound"))
        _, crest = metric_bounds(bound, still, gaps, smallest, others, largest)
        squares, _ = metric_bounds(rms, still, gaps, smallest)
        units = [distribution(_NO_LINES, one) for one in tones.errors.ends(r, k)]
        least = max(least, math.hypot(squares, max(one.within(confidence) for one in units)))
        most.append(crest + within_all(units, both_within) if math.isfinite(crest) else math.inf)
    return least, math.hypot(*most)


class _Of(NamedTuple):
    """Axis of the line of sight, and units."""

    axis: int
    unit: Unit | None = None
    """The unit whose errors count with their sign; None for all of them."""
    worst: bool = False
    """Whether what units may have beyond it is beside."""


def _largest_group_distribution(
    r: Requirement,
    tones: CombinedLines,
    hidden: Unobserved,
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
    of: _Of,
) -> tuple[Distribution, np.ndarray]:
    """The largest group of lines with known phases, or the largest line, with noise; and what is
    beside it at most, (n,) [rad].

    Rows are cells of a window, in which all is as in their middles; by how much it changes within
    them is beside it.
    """
    cells, window, axis = WHOLE_WINDOW, _window(r), of.axis

    def moved(f: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
        at = cells.instants
        rows = windowed_amplitudes(r.metric, f, amplitude[:, axis], window, r.apart, at)
        return rows * counts_in_band(r, f)

    def changes(f: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
        size = np.abs(amplitude[:, axis]) * counts_in_band(r, f)
        return change_within_cells(r.metric, f, window, cells) @ size

    lower, upper = (_extreme_frequencies(r, tones, extreme) for extreme in (np.argmin, np.argmax))
    given = moved(tones.frequency, tones.value * tones.phasor)
    low, high = np.abs(moved(lower, tones.least)), np.abs(moved(upper, tones.most))
    crest = high.max(axis=0, initial=0.0)
    group = _largest_group(in_step(tones.frequency, tones.clock[:, axis], crest), crest)
    relative_error = np.maximum(high - np.abs(given), np.abs(given) - low)[:, group]
    beside = high[:, ~group].sum(axis=1) + relative_error.sum(axis=1)
    beside = beside + np.abs(moved(hidden.frequency, hidden.most)).sum(axis=1)
    beside = beside + changes(upper, tones.most) + changes(hidden.frequency, hidden.most)
    sigma = _noise_at_instants(r, densities, axis, cells.instants)
    noise: np.ndarray | ErrorRows = sigma
    if tones.errors:
        errors = tones.errors.rows(r, axis, cells.instants, of.unit, exact=True)
        noise = errors.with_noise(sigma)
        beside = beside + tones.errors.unknown_crest(r, axis)
        if r.metric in WITHIN_WINDOW:
            beside = beside + cells.reach * tones.errors.slope(r, axis)
        if of.worst:
            beside = beside + tones.errors.crest_over_units(r, axis, np.abs(cells.instants))
    spread = distribution(
        given[:, group],
        noise,
        frequency=tones.frequency[group],
        clock=np.zeros(int(group.sum()), dtype=int),
        shares=row_shares(r.metric, cells),
        noise_ratio=0.0,
    )
    return spread, beside


def _largest_group(clock: np.ndarray, crest: np.ndarray) -> np.ndarray:
    """Which lines (k,) are of the ``clock`` (k,) with the largest sum of crests (k,); or the
    largest line, where that is larger.
    """
    if not crest.size:
        return np.zeros(0, dtype=bool)
    groups = [clock == one for one in np.unique(clock[clock != INCOHERENT])]
    groups.append(np.arange(crest.size) == np.argmax(crest))
    return max(groups, key=lambda group: float(crest[group].sum()))


def _mean_square_floor(
    r: Requirement,
    tones: CombinedLines,
    hidden: Unobserved,
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
) -> float:
    """Below which no level is, whatever the phases [rad].

    Lines of other frequencies have the mean square R^2 together. While the sum s of lines is beyond
    a level x, a part 1 - c of the time, it has no more than its crests S, and the noise n no more
    than N^2, what it has beyond its own level: R^2 + sigma^2 <= c x^2 + (sqrt(1 - c) S + N)^2. Nor is
    a level below that of the noise alone.
    """
    rest = 1.0 - r.confidence
    lower, upper = (_extreme_frequencies(r, tones, extreme) for extreme in (np.argmin, np.argmax))
    f, most = np.concatenate([upper, hidden.frequency]), np.vstack([tones.most, hidden.most])
    noise, found = _noise(r, densities), []
    levels, tails = zip(*(_level_of_noise(r, densities, k) for k in range(2)), strict=True)
    for axis in {"x", "y", "radial"} if r.axis == "radial" else {r.axis}:
        own = r.model_copy(update={"axis": axis})
        squares = float(sum(noise[k] for k in AXES[axis]))
        lines = (
            evaluate_metric(own.model_copy(update={"statistic": "rms"}), lower, tones.least) ** 2
        )
        bound = own.model_copy(update={"statistic": "bound"})
        crests = evaluate_metric(bound, f, most) + _excess_of_bound(bound, f, most)
        tail = sum(tails[k] for k in AXES[axis])
        beyond = (math.sqrt(rest) * crests + math.sqrt(tail)) ** 2
        found.append(math.sqrt(max(lines + squares - beyond, 0.0) / r.confidence))
    return max(*found, *(levels[k] for k in AXES[r.axis]))


def _level_of_noise(
    r: Requirement, densities: Sequence[tuple[np.ndarray, np.ndarray]], axis: int
) -> tuple[float, float]:
    """Level of the noise alone about an axis [rad], and its mean square while it is beyond [rad^2]."""
    from scipy.special import ndtr

    sigma = _noise_at_instants(r, densities, axis, HALF_WINDOW.instants)
    if not sigma.any():
        return 0.0, 0.0
    shares = row_shares(r.metric, HALF_WINDOW)
    level = distribution(np.zeros((sigma.size, 0)), sigma, shares=shares).within(r.confidence)
    z = level / np.maximum(sigma, 1e-9 * sigma.max())
    tail = 2.0 * (ndtr(-z) + z * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi))
    return level, float(shares @ (sigma**2 * tail))


def _window(r: Requirement) -> float:
    return r.window or r.apart or 1.0


def _noise(r: Requirement, densities: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[float]:
    """Mean squares [rad^2] of densities about both axes."""
    return [
        sum((_density_mean_square(r, _window(r), f, S[:, k]) for f, S in densities), 0.0)
        for k in range(2)
    ]


def _noise_at_instants(
    r: Requirement,
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
    axis: int,
    instants: np.ndarray,
) -> np.ndarray:
    """Sigma of densities about an axis [rad] at ``instants`` of a window, (n,), or of all of it, (1,)."""
    squares = np.zeros(1)
    for f, S in densities:
        grid, values = _density_in_band(r, f, S[:, axis])
        if grid.size > 1 and values.any():
            more = mean_squares_at_instants(r.metric, grid, values, _window(r), r.apart, instants)
            squares = squares + more
    return np.sqrt(squares)


def _extreme_frequencies(
    r: Requirement, tones: CombinedLines, extreme: Callable[..., np.ndarray]
) -> np.ndarray:
    """Frequencies (k,) of lines, off by what they may be, such that they count least or most:
    between the zeros of a weight there may be no more than that, and at an end of the band they may
    be on either side of it."""
    f = tones.frequency
    off = f[:, None] + tones.off[:, None] * _FREQUENCY_SAMPLES
    at = extreme(metric_weight(r.metric, off, r.window or r.apart or 1.0, r.apart), axis=1)
    low, high = tones.frequency_bounds
    if extreme is np.argmin:
        shifted = off[np.arange(f.size), at]
        outside = np.where(
            counts_in_band(r, low), np.where(counts_in_band(r, high), shifted, high), low
        )
        return np.where(counts_in_band(r, f), outside, f)
    shifted = np.clip(
        off[np.arange(f.size), at], r.lowest, math.inf if r.highest is None else r.highest
    )
    return np.where((shifted >= low) & (shifted <= high), shifted, f)


def crossing_bounds(
    r: Requirement, moving: Contribution, contributions: Iterable[Contribution]
) -> Iterator[Unobserved]:
    """Bounds added by lines that ``moving`` takes through a range of frequencies, where they meet a line of
    another source.

    Two lines of amplitudes A and a are one of A + a at most where they meet, by A a more than their
    mean squares.
    """
    if not moving.alternatives or r.statistic == "bound":
        return  # in a bound amplitudes add anyway
    before = True
    for other in contributions:
        before = before and other is not moving
        if other is moving or (
            before and other.alternatives
        ):  # of two that move, the first has told what both add
            continue
        if other.sweep is not None:
            f, A = (np.concatenate(each) for each in zip(*other.sweep.swept(), strict=True))
        else:
            lines = other.alternatives or (other,)
            f = np.concatenate([one.frequency for one in lines])
            A = np.vstack([np.abs(one.los) * one.settled[:, None] for one in lines])
        why = f"its lines may meet those of {other.source}, in any phase"
        for swept, size in _swept_lines(moving):
            met, a = _swept_frequencies_met(r, swept, size, f)
            if not met.any():
                continue
            reach = _meeting_reach(f[met])
            at = frequencies_that_count_most(r, f[met], reach)
            together = np.abs(np.subtract.outer(f[met], f[met])) <= np.add.outer(reach, reach)
            A_met = together @ A[met]  # lines so near to each other are met together
            if r.curve is not None:
                yield Unobserved(why, 0.0, math.inf, at, A_met + a)
                continue
            by = metric_weight(r.metric, at, r.window or r.apart or 1.0, r.apart)
            worst = [int(np.argmax(by * np.sum((A_met * a)[:, AXES[r.axis]], axis=1)))]
            more, apart = np.sqrt(2.0 * A_met * a)[worst], r.statistic == "level"
            yield Unobserved(why, 0.0, math.inf, at[worst], more, of_squares=apart)


def beat_bounds(
    r: Requirement, one: Contribution, others: Iterable[Contribution]
) -> Iterator[Unobserved]:
    """Bounds added by lines of ``one`` source and of ``others`` while those nearer than SLOW are in step;
    as ``crossing_bounds``.

    Those of two sources may be nearer than they are given, even of one frequency, by what their
    clocks may be off.
    """
    if r.statistic == "bound":
        return
    for other in others:
        f, g = np.meshgrid(one.frequency, other.frequency, indexing="ij")
        apart = g - f if other is one else np.abs(g - f)  # of one source each pair once
        if other is not one:
            reach = np.maximum(SLOW, frequency_approach(one, other))
        else:
            # of one clock, but orders of a wheel, and what is not the clock's
            clocks = frequency_error_bound(f) + frequency_error_bound(g)
            reach = np.maximum(SLOW, np.add.outer(one.off, one.off) - clocks)
        near = (
            (apart > FREQUENCY_TOLERANCE * f)
            & (apart < reach)
            & np.outer(one.settled, other.settled)
        )
        i, j = np.nonzero(near)
        # Two that are in step count where either may be: each by its own weight there.
        middle, reach = 0.5 * (f[near] + g[near]), 0.5 * apart[near] + one.off[i] + other.off[j]
        counted = _reaches_band(r, middle, reach)
        i, j, middle, reach = i[counted], j[counted], middle[counted], reach[counted]
        if not i.size:
            continue
        at = frequencies_that_count_most(r, middle, reach)
        A, a = np.abs(one.los[i]), np.abs(other.los[j])
        if r.curve is not None:
            most = A + a
        else:
            most = np.sqrt(2.0 * A * a)
        if other is one:
            whom = "each other"
        else:
            whom = f"those of {other.source}"
        why = f"its lines beat with {whom}, more slowly than once in {1.0 / SLOW:g} s"
        if np.any(apart[near] >= SLOW):
            why = (
                f"its lines may coincide in frequency with {whom}, within the frequency uncertainty"
            )
        # in a level crests are counted anyway, for no two that beat so slowly are in step
        yield Unobserved(why, 0.0, math.inf, at, most, of_squares=r.statistic == "level")


def _reaches_band(r: Requirement, frequency: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Which frequencies (k,) [Hz] may count, off by ``reach`` (k,) at most."""
    highest = math.inf if r.highest is None else r.highest
    return np.asarray(np.abs(np.clip(frequency, r.lowest, highest) - frequency) <= reach)


def frequencies_that_count_most(
    r: Requirement, frequency: np.ndarray, reach: np.ndarray
) -> np.ndarray:
    """Frequencies (k,) [Hz] of the band, off by ``reach`` (k,) at most, at which lines count most:
    by the weight, or where a curve allows least.
    """
    at = frequency[:, None] + reach[:, None] * _FREQUENCY_SAMPLES
    if r.curve is not None:
        points = np.array([point.frequency for point in r.curve])
        near = np.clip(points, (frequency - reach)[:, None], (frequency + reach)[:, None])
        at = np.hstack([at, near])
    at = np.clip(at, r.lowest, math.inf if r.highest is None else r.highest)
    if r.curve is not None:
        by = 1.0 / r.allowed.at(at.ravel()).reshape(at.shape)
    else:
        by = metric_weight(r.metric, at, r.window or r.apart or 1.0, r.apart)
    return np.asarray(at[np.arange(at.shape[0]), np.argmax(by, axis=1)])


def frequency_approach(one: Contribution, other: Contribution) -> np.ndarray:
    """By how much lines of two sources may be nearer to each other [Hz], (k, j), than they are
    given: of one clock by what is not the clock's."""
    f, g = np.meshgrid(one.frequency, other.frequency, indexing="ij")
    off = np.add.outer(one.off, other.off)
    if one.clock and one.clock == other.clock:
        return off - frequency_error_bound(f) - frequency_error_bound(g)
    return off


def _swept_lines(moving: Contribution) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Swept lines of a source with alternatives: frequencies, ascending (n,) [Hz], and
    amplitudes (n, 2) [rad].
    """
    if moving.sweep is not None:
        yield from (each for each in moving.sweep.swept() if each[0].size > 1)
        return
    f = np.array([one.frequency for one in moving.alternatives])
    size = np.abs([one.los for one in moving.alternatives])
    for k in range(f.shape[1]):
        order = np.argsort(f[:, k])
        yield f[order, k], size[order, k]


def _swept_frequencies_met(
    r: Requirement, swept: np.ndarray, size: np.ndarray, f: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which frequencies (m,) a line ``swept`` (n,) with its ``size`` (n, 2) passes, or comes so
    near to that the two add for as long as any window lasts, and its amplitudes there."""
    near = _meeting_reach(f)
    met = (f >= swept[0] - near) & (f <= swept[-1] + near) & _reaches_band(r, f, near)
    right = np.clip(np.searchsorted(swept, f[met]), 1, swept.size - 1)
    return met, np.maximum(size[right - 1], size[right])


def _meeting_reach(frequency: np.ndarray) -> np.ndarray:
    """How near to lines (k,) [Hz] one that passes them is in step with them, (k,) [Hz]."""
    return np.asarray(np.maximum(SLOW, frequency_error_bound(frequency)))


def counts_in_band(r: Requirement, frequency: np.ndarray) -> np.ndarray:
    """Which frequencies [Hz] count."""
    return np.asarray(in_band(frequency, r.lowest, math.inf if r.highest is None else r.highest))


def line_weights(r: Requirement, frequency: np.ndarray) -> np.ndarray:
    """Weight of a line's amplitude at each ``frequency`` (k,) [Hz] in a requirement, (k,): 0 outside the band;
    over what a curve allows [1/rad] where it has one.
    """
    if r.curve is not None:
        weight = 1.0 / r.allowed.at(frequency)
    else:
        weight = np.sqrt(metric_weight(r.metric, frequency, _window(r), r.apart))
    return np.where(counts_in_band(r, frequency), weight, 0.0)


def _density_mean_square(r: Requirement, window: float, f: np.ndarray, S: np.ndarray) -> float:
    grid, values = _density_in_band(r, f, S)
    if grid.size < 2:
        return 0.0
    return mean_square_of_density(r.metric, grid, values, window, r.apart)


def _density_in_band(r: Requirement, f: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Part of a density that counts; empty where none does."""
    low, high = (
        max(r.lowest, float(f[0])),
        min(math.inf if r.highest is None else r.highest, float(f[-1])),
    )
    if low >= high:
        return np.zeros(0), np.zeros(0)
    grid = np.union1d(f[(f > low) & (f < high)], [low, high])
    return grid, np.interp(grid, f, S)
