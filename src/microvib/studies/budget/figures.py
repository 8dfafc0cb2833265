"""The figure that a requirement asks for, of lines and densities; between what it lies where they
are known in part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from microvib.analysis.margins import frequency_error_bound
from microvib.analysis.pointing import FREQUENCY_TOLERANCE
from microvib.signals.in_step import SLOW, in_step
from microvib.signals.pointing import (
    HALF_WINDOW,
    UNIFORM_INSTANTS,
    WHOLE_WINDOW,
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
    worst_case_angle,
)
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
    r, axes = requirement, AXES[requirement.axis]
    window = _window(r)
    counts = counts_in_band(r, frequency)
    f, tones = frequency[counts], amplitude[counts]
    A = np.abs(tones)
    if r.statistic == "rms":
        total = float(np.sum(mean_square_of_lines(r.metric, f, A[:, axes], window, r.apart)))
        return math.sqrt(total + float(np.array(_noise(r, densities))[axes].sum()))
    if r.statistic == "bound":
        each = [
            worst_case_angle(
                windowed_amplitudes(r.metric, f, A[:, k], window, r.apart, UNIFORM_INSTANTS),
                _noise_at_instants(r, densities, k, UNIFORM_INSTANTS),
            )
            for k in axes
        ]
    else:  # both axes within theirs, each for a part of the time such that both are for the part that is asked for
        part = 1.0 - (1.0 - r.confidence) / len(axes)
        if clock is None:
            of = np.full(A.shape, INCOHERENT)
        else:
            of = clock[counts]
        if np.any(of != INCOHERENT):
            cells = WHOLE_WINDOW
        else:
            cells = HALF_WINDOW
        each, shares = [], row_shares(r.metric, cells)
        for k in axes:
            rows = windowed_amplitudes(r.metric, f, tones[:, k], window, r.apart, cells.instants)
            sigma, clocks = _noise_at_instants(r, densities, k, cells.instants), of[:, k]
            each.append(
                confidence_level_angle(rows, sigma, part, frequency=f, clock=clocks, shares=shares)
            )
    if single_axis:
        return max(each)
    return math.hypot(*each)


def evaluate_lines(
    r: Requirement, tones: CombinedLines, densities: Sequence[tuple[np.ndarray, np.ndarray]] = ()
) -> float:
    """The figure that is required of what the sources are given as."""
    return evaluate_metric(
        r, tones.frequency, tones.value * tones.phasor, densities, clock=tones.clock
    )


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
    least = evaluate_metric(r, lower, tones.least, densities, single_axis=True)
    least = max(least - _crest_offset(r, tones, lower, tones.least, -1.0), 0.0)
    if not np.all(np.isfinite(hidden)):
        return least, math.inf
    if moving is not None and r.statistic == "bound":
        return least, _crest_bound(
            r, moving, Unobserved("", 0.0, math.inf, hidden_at, hidden), largest
        )
    f, most = np.concatenate([upper, hidden_at]), np.vstack([tones.most, hidden])
    beyond = _excess_of_bound(r, f, most) + _crest_offset(r, tones, upper, tones.most, 1.0)
    return least, evaluate_metric(r, f, most, largest) + beyond


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
        evaluate_metric(one, frequency, amplitude, densities)
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
    at, hidden = _unobserved_lines([gap for gap in gaps if not gap.of_squares])
    bounded = np.all(np.isfinite(hidden), axis=1)
    if r.confidence < MIN_MONOTONE_CONFIDENCE and not bounded.all():
        return 0.0, math.inf
    axes = AXES[r.axis]
    both_within = 1.0 - (1.0 - r.confidence) / len(axes)
    known = Unobserved("", 0.0, math.inf, at[bounded], hidden[bounded])
    smallest, largest = densities
    found = [_largest_group_distribution(r, tones, known, smallest, k) for k in axes]
    least = max(spread.within(r.confidence, -beside) for spread, beside in found)
    least = max(least, _mean_square_floor(r, tones, known, smallest))
    if not bounded.all():
        return least, math.inf
    _, squares = metric_bounds(r.model_copy(update={"statistic": "rms"}), tones, gaps, largest)
    if moving.together or largest is not smallest:
        found = [_largest_group_distribution(r, moving.others, known, largest, k) for k in axes]
    most = moving.upper_bound_with(
        axes,
        lambda more: [
            spread.within(both_within, beside + x)
            for x, (spread, beside) in zip(more, found, strict=True)
        ],
    )
    return least, min(most, squares / math.sqrt(1.0 - r.confidence))


def _largest_group_distribution(
    r: Requirement,
    tones: CombinedLines,
    hidden: Unobserved,
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
    axis: int,
) -> tuple[Distribution, np.ndarray]:
    """The largest group of lines with known phases, or the largest line, with noise; and what is
    beside it at most, (n,) [rad].

    Rows are cells of a window, in which all is as in their middles; by how much it changes within
    them is beside it.
    """
    cells, window = WHOLE_WINDOW, _window(r)

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
    spread = distribution(
        given[:, group],
        _noise_at_instants(r, densities, axis, cells.instants),
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
            at = _costliest_frequencies(r, f[met], reach)
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
            reach = SLOW
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
        at = _costliest_frequencies(r, middle, reach)
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


def _costliest_frequencies(r: Requirement, frequency: np.ndarray, reach: np.ndarray) -> np.ndarray:
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
