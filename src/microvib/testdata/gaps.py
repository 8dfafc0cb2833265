"""Gaps of a channel in which samples were dropped, and what a recorder or a program filled them with: the last
value, a straight or a smooth line, or each sample several times.

What is filled in lacks what the rest has. Without noise in it a gap is exactly constant or exactly straight.
Where the rest has noise from one sample to the next, second differences that are hardly any, many in a row, are
incredible by the distribution of the others, and the noise stops and comes back at once, as no drive's does.
Where the noise was added behind the hold, the level of a gap is left at once, and it is another one in each gap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from microvib.testdata.clipping import run_lengths

_HELD_RUN = 8
"""Differences of nothing in a row, from which a value was held."""
_STRAIGHT_RUN = 16
"""Second differences of nothing in a row, from which a gap was filled."""
_STRAIGHT_RISE = 1e-3
"""Part of the range by which its ends are apart."""
_ROUNDING, _ROUNDED_BEND = 1e-6, 1e-3
"""Second difference that is none: over the largest sample, to six digits, and over those of the rest."""

_QUANTILE, _OF_SIGMA = 0.95, 1.96
"""Quantile of magnitudes of second differences by which noise is told, and how many standard deviations it is at:
up to half of the samples may be in gaps.
"""
_TURNS = 0.4
"""Part of second differences that have another sign than the one before, from which they are noise's: white noise
has 0.73, what is slower than a fifth of the sample rate less than this.
"""
_LARGEST_BINS, _OF_LINES = 0.01, 0.5
"""Part of the bins of their spectrum, the largest, and part of the power in these, from which second differences are
those of lines: of noise 6 % of it are there. Lines that cease are a drive's that stops.
"""
_OF_KICKS = 2.5
"""Root mean square of second differences outside of what was found, over the median of their magnitudes, from which
they are a drive's kicks, and what is between them is its rest: of noise it is 1.5, and kicks that have half of the
power make it 2.1. A short record has too few bins to tell their lines.
"""
_LEAST_NOISE = 1e-5
"""Its standard deviation over the largest sample, below which it may be rounding to six digits, which is finer
where samples are small.
"""
_SMALL = 2.0 ** -np.arange(2.0, 12.0)
"""Second differences over the noise's standard deviation, from a quarter down, below which they are hardly any."""
_LOCALLY, _LIKELY = 2.0, 0.7
"""How many times as probable they may be where the signal's own second differences are small, and how probable at
most, given the one before.
"""
_STEP = 1e-6
"""Second difference over the noise's standard deviation from which it is a converter's step, and no rounding."""
_INCREDIBLE = 1e-6
"""Probability of a run in all of a record, from which it is not one of noise."""
_EDGE = 4
"""Samples beside a gap within which the noise, or the signal, is back."""
_BACK = 0.5
"""Second difference over the noise's standard deviation that shows that it is back: noise has one in four samples
in 49 of 50 cases.
"""

_AT_ONCE = 0.7
"""Part of the long runs at whose ends the noise stops and comes back at once: friction that sticks makes a
simulation quiet by and by.
"""

_LEVEL_RUN = 32
"""Samples of a level in a row from which it is one."""
_WITHIN, _BEYOND = 8.0, 20.0
"""Standard deviations of noise within which samples are at one level; and beyond which, within ``_EDGE`` samples,
the signal has left it. A flat extremum of a signal is left far more slowly.
"""
_SAME, _FEWEST_PLACES = 2.0, 8.0
"""Standard deviations of noise within which two levels are the same, and how many such places the signal's range
must have.
"""
_HELD_PART = 0.01
"""Part of the samples from which levels were held: fewer take less of a line, and between two microsteps of a drive
a shaft may stick at a level that noise hides the ends of.
"""
_OTHER_LEVELS = 0.6
"""Part of the levels that would differ by chance which do: rests of a signal are at one level or a few."""

_REPEATED, _NEXT_STEPS, _OF_STEPS = 0.02, 3.5, 3.0
"""Part of the samples that are as the one before, from which a record was held at a lower rate; of how many of the
converter's steps differences are few, and how many times as many as these repetitions must be: chance makes fewer.
"""
_FINE = 0.05
"""Part of the differences that may be a few of the converter's steps: of a coarse one's all are."""

_QUIET_RUN, _QUIET, _LEFT = 4, 1.0 / 30.0, 1.0 / 3.0
"""Samples in a row by whose range it is told whether a signal hardly changes, and part of the usual range below
which it does not; part of it by which the signal leaves a level at once.
"""
_FEWEST_GAPS, _LEFT_AT_ONCE, _LOST = 8, 0.4, 0.02
"""Such places, part of them that are come to and left at once, and part of the samples in these, from which samples
were lost.
"""


def gap_faults(x: np.ndarray, rate: float) -> Iterator[str]:
    """Clauses on gaps of samples ``x`` (n,), finite, at ``rate`` [Hz] that were filled."""
    held = int(np.max(run_lengths(np.diff(x) == 0.0), initial=0))
    if held >= _HELD_RUN:
        yield f"repeats one value for {held + 1} samples; samples were dropped and held"
    if repeated := _repeated_samples(x):
        yield (
            f"has {100.0 * repeated / x.size:.2g} % of its samples exactly as the one before, far more than its steps"
            " explain; it was sampled at a lower rate and held"
        )
    if straight := _straight_samples(x):
        part = f"{100.0 * straight / x.size:.2g} % of its samples"
        yield f"is exactly straight over {part}; samples were dropped and interpolated"
    if gaps := _noiseless_gaps(x):
        yield f"lacks the noise of the rest over {_in_words(gaps, x.size, rate)}; samples were dropped and filled"
    if gaps := _short_gaps(x):
        yield f"falls to one level again and again, and leaves it at once, over {_in_words(gaps, x.size, rate)}; samples were lost"
    if gaps := _level_gaps(x):
        yield f"stands at a level, and leaves it at once, over {_in_words(gaps, x.size, rate)}; samples were dropped and held"


def _short_gaps(x: np.ndarray) -> list[tuple[int, int]]:
    """First samples and ends of short gaps: samples that hardly change, at one level, which the signal leaves for
    far away from one sample to the next, and comes to likewise; without those, what is at rest comes to rest by
    and by. None where these are few.
    """
    if x.size < _QUIET_RUN:
        return []
    windows = np.lib.stride_tricks.sliding_window_view(x, _QUIET_RUN)
    change = windows.max(axis=1) - windows.min(axis=1)
    usual = float(np.median(change))
    first, end = _runs((change > 0.0) & (change < _QUIET * usual))
    end = end + _QUIET_RUN - 1
    inside = (first > 0) & (end < x.size)
    first, end = first[inside], end[inside]
    if first.size < _FEWEST_GAPS:
        return []
    level = np.array([x[a:b].mean() for a, b in zip(first.tolist(), end.tolist(), strict=True)])
    far = np.minimum(np.abs(x[first - 1] - level), np.abs(x[end] - level)) > _LEFT * usual
    found = far & (np.abs(level - np.median(level)) < _LEFT * usual) & (end - first < _LEVEL_RUN)
    lost = int(np.sum((end - first)[found]))
    if np.count_nonzero(found) < _LEFT_AT_ONCE * first.size or lost < _LOST * x.size:
        return []
    return list(zip(first[found].tolist(), end[found].tolist(), strict=True))


def _in_words(gaps: list[tuple[int, int]], size: int, rate: float) -> str:
    """The part of the samples in gaps, from a first to an end each, and where the longest is."""
    first, end = max(gaps, key=lambda gap: gap[1] - gap[0])
    share = sum(b - a for a, b in gaps) / size
    return f"{100.0 * share:.2g} % of its samples, such as from {first / rate:.6g} to {end / rate:.6g} s"


def _runs(flags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First samples and ends of the runs of true ones in ``flags`` (n,)."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)


def _repeated_samples(x: np.ndarray) -> int:
    """Number of samples that are as the one before, where that is neither chance nor a converter's coarse step."""
    steps = np.abs(np.diff(x))
    zeros = int(np.count_nonzero(steps == 0.0))
    if zeros < max(_REPEATED * steps.size, _HELD_RUN) or zeros == steps.size:
        return 0
    moved = steps[steps > 0.0]
    few = int(np.count_nonzero(moved <= _NEXT_STEPS * np.min(moved)))
    return zeros if few <= _FINE * moved.size and zeros > _OF_STEPS * few else 0


def _straight_samples(x: np.ndarray) -> int:
    """Number of samples in straight lines, with which gaps were filled: without the noise and the curvature that
    the rest has, and between values apart. What is at rest may be straight of itself, and what is straight
    nearly everywhere, such as a triangle without noise.
    """
    bend = np.abs(np.diff(x, 2))
    rounding = _ROUNDING * float(np.max(np.abs(x)))
    if bend.size < _STRAIGHT_RUN or (usual := float(np.quantile(bend, _QUANTILE))) <= rounding:
        return 0
    first, end = _runs(bend <= min(rounding, _ROUNDED_BEND * usual))
    long = end - first > _STRAIGHT_RUN - 1
    pieces = [x[a : b + 2] for a, b in zip(first[long].tolist(), end[long].tolist(), strict=True)]
    least = _STRAIGHT_RISE * float(np.ptp(x))
    return sum(y.size for y in pieces if _is_straight(y, rounding, least))


def _is_straight(y: np.ndarray, rounding: float, least: float) -> bool:
    """Whether samples ``y`` (n,) follow the line between the first and the last but for ``rounding``, and these
    are ``least`` apart or more.
    """
    chord = np.linspace(y[0], y[-1], y.size)
    return bool(abs(y[-1] - y[0]) > least and np.max(np.abs(y - chord)) <= rounding)


def _noiseless_gaps(x: np.ndarray) -> list[tuple[int, int]]:
    """First samples and ends of gaps that lack the noise of the rest; none where the rest has none from one sample
    to the next.
    """
    bend = np.diff(x, 2)
    size = np.abs(bend)
    if size.size < 2 * _LEVEL_RUN:
        return []
    sigma = float(np.quantile(size, _QUANTILE)) / _OF_SIGMA
    if sigma <= _LEAST_NOISE * np.max(np.abs(x)) or not _is_noise(bend, _BACK * sigma):
        return []
    step = float(np.min(size[size > _STEP * sigma])) / sigma
    known, found = np.zeros(x.size, dtype=bool), []
    for small in _SMALL:
        first, end = _runs(size <= small * sigma)
        long = end - first >= _longest_by_chance(max(small, step), size.size)
        new = long & ~known[first]
        runs = list(zip(first[new].tolist(), end[new].tolist(), strict=True))
        gaps = [(a, b + 2) for a, b in runs if _noise_beside(size, a, b, _BACK * sigma)]
        if len(gaps) < _AT_ONCE * len(runs):
            return []
        for a, b in runs:
            known[a : b + 2] = True
        found += gaps
    rest = size[~known[:-2]]
    return [] if np.sqrt(np.mean(rest * rest)) > _OF_KICKS * np.median(rest) else found


def _is_noise(bend: np.ndarray, least: float) -> bool:
    """Whether second differences (n,) are those of noise from one sample to the next: those of ``least`` and more
    change their sign, and their power is not in a few lines.
    """
    large = np.sign(bend[np.abs(bend) > least])
    if np.mean(large[1:] != large[:-1]) < _TURNS:
        return False
    power = np.sort(np.abs(np.fft.rfft(bend)) ** 2)
    few = math.ceil(_LARGEST_BINS * power.size)
    return bool(np.sum(power[-few:]) < _OF_LINES * np.sum(power))


def _longest_by_chance(small: float, size: int) -> float:
    """Length of a run of second differences below ``small`` standard deviations that noise has not in ``size`` of
    them; infinite where that is too many to tell.

    They are those of independent samples: k in a row have the density at 0 of k independent ones times
    sqrt(6)^k at most, whose variance is 6 of a sample's.
    """
    probability = _LOCALLY * math.sqrt(6.0) * math.sqrt(2.0 / math.pi) * small
    if small > _SMALL[0]:
        return math.inf
    return math.log(size / _INCREDIBLE) / -math.log(min(probability, _LIKELY))


def _noise_beside(size: np.ndarray, first: int, end: int, least: float) -> bool:
    """Whether magnitudes ``size`` (n,) reach ``least`` within a few samples on both sides of a run."""
    before, after = size[max(first - _EDGE, 0) : first], size[end : end + _EDGE]
    return bool(min(np.max(before, initial=0.0), np.max(after, initial=0.0)) >= least)


def _level_gaps(x: np.ndarray) -> list[tuple[int, int]]:
    """First samples and ends of gaps at a level each, which the signal leaves at once on both sides; none where it
    is a level or a few to which the signal comes back.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    if x.size < 4 * _LEVEL_RUN:
        return []
    noise = float(np.median(np.abs(np.diff(x, 4)))) / (0.6745 * math.sqrt(70.0))
    window = slice(_LEVEL_RUN // 2, x.size - _LEVEL_RUN // 2 + 1)
    spread = (maximum_filter1d(x, _LEVEL_RUN) - minimum_filter1d(x, _LEVEL_RUN))[window]
    first, end = _runs(spread <= _WITHIN * noise)
    flat = [(a, b - 1 + _LEVEL_RUN) for a, b in zip(first.tolist(), end.tolist(), strict=True)]
    gaps = [gap for gap in flat if _leaves_at_once(x, *gap, noise)]
    rests = np.array([np.mean(x[slice(*one)]) for one in flat if one not in gaps])
    levels = np.array([np.mean(x[slice(*gap)]) for gap in gaps])
    width = _SAME * noise
    at_rest = np.any(np.abs(levels[:, None] - rests) <= width, axis=1)
    if not _differ(levels[~at_rest], float(np.ptp(x)), width):
        return []
    found = [gap for gap, rest in zip(gaps, at_rest.tolist(), strict=True) if not rest]
    held = sum(b - a for a, b in found)
    return found if held >= _HELD_PART * x.size else []


def _leaves_at_once(x: np.ndarray, first: int, end: int, noise: float) -> bool:
    """Whether the samples from ``first`` to ``end`` are at one level, which the signal leaves within a few samples
    on both sides.
    """
    inside = x[first:end]
    level, away = float(np.mean(inside)), _BEYOND * noise
    before, after = x[max(first - _EDGE, 0) : first], x[end : end + _EDGE]
    leaves = [np.max(np.abs(beside - level), initial=0.0) > away for beside in (before, after)]
    return all(leaves) and float(np.ptp(inside)) <= 0.5 * (_WITHIN + _BEYOND) * noise


def _differ(levels: np.ndarray, span: float, width: float) -> bool:
    """Whether ``levels`` (m,) differ as those do at which a signal of a ``span`` happens to be, to a ``width``."""
    if levels.size == 0 or not 0.0 < _FEWEST_PLACES * width <= span:
        return False
    places = span / width
    by_chance = places * (1.0 - math.exp(-levels.size / places))
    return np.unique(np.floor(levels / width)).size >= _OTHER_LEVELS * by_chance
