"""The figure that a requirement asks for, of lines and densities; between what it lies where they are known in part."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from microvib.analysis.margins import frequency_doubt
from microvib.analysis.pointing import SAME
from microvib.signals.pointing import (
    EVERYWHERE,
    MIDDLES,
    bound,
    in_window,
    level,
    mean_square_of_density,
    mean_square_of_lines,
    weight,
)
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.sources import Contribution, Gap
from microvib.units import inside as in_band

ALONE = -1
SLOW = 0.01
"""Distance [Hz] from which two lines have mean squares that add; nearer, an observation may see no more than their crest."""
AXES = {"x": [0], "y": [1], "radial": [0, 1]}
_OFF = np.r_[0.0, np.sin(np.arange(100.0) ** 2)]
"""Parts of what a frequency may be off that are tried, unlike each other: after many periods they decide where a window ends."""
RISES = 0.95
"""Confidence from which a level rises with the amplitude of each line; below, a line may also take others from their crests."""


@dataclass(frozen=True)
class Tones:
    """Lines of all sources, one for each frequency: amplitudes [rad], (k, 2), with best, given and worst phases."""

    frequency: np.ndarray
    least: np.ndarray
    value: np.ndarray
    most: np.ndarray
    turn: np.ndarray
    """Phase of the largest of those of one frequency, exp(j phase), (k, 2)."""
    clock: np.ndarray
    """Its clock, by number, (k, 2): lines of one clock keep their phases to each other; ALONE for those that keep none."""
    off: np.ndarray
    """By how much frequencies may be off [Hz], (k,)."""

    @property
    def ends(self) -> np.ndarray:
        """Between which frequencies [Hz] lines may be, (2, k)."""
        return np.array([self.frequency - self.off, self.frequency + self.off])


def figure(
    requirement: Requirement,
    frequency: np.ndarray,
    amplitude: np.ndarray,
    densities: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    *,
    surely: bool = False,
    clock: np.ndarray | None = None,
    nominal: np.ndarray | None = None,
) -> float:
    """The figure that is required [rad], of lines (k,) [Hz] with amplitudes (k, 2) [rad] and densities.

    What both axes reach together is a bound, since they need not do so at once; ``surely`` it is what one of them does. A level
    depends on the phases that lines of one ``clock`` (k, 2) keep, of complex amplitudes at the frequencies ``nominal`` (k,), of
    which ``frequency`` may be off: that shifts them in time, together.
    """
    r, axes = requirement, AXES[requirement.axis]
    window = r.window or r.apart or 1.0
    counts = inside(r, frequency)
    f, tones = frequency[counts], amplitude[counts]
    A = np.abs(tones)
    squares = np.array([sum((_of_density(r, window, f_S, S[:, k]) for f_S, S in densities), 0.0) for k in axes])
    if r.statistic == "rms":
        total = float(np.sum(mean_square_of_lines(r.metric, f, A[:, axes], window, r.apart)))
        return math.sqrt(total + float(squares.sum()))
    if r.statistic == "bound":
        each = [
            bound(in_window(r.metric, f, A[:, k], window, r.apart, EVERYWHERE), math.sqrt(s))
            for k, s in zip(axes, squares, strict=True)
        ]
    else:  # both axes within theirs, each for a part of the time such that both are for the part that is asked for
        part = r.confidence if surely else 1.0 - (1.0 - r.confidence) / len(axes)
        at = f if nominal is None else nominal[counts]
        of = np.full(A.shape, ALONE) if clock is None else clock[counts]
        halves = np.r_[-MIDDLES[::-1], MIDDLES] if np.any(of != ALONE) else MIDDLES
        each = []
        for k, s in zip(axes, squares, strict=True):
            rows = np.abs(in_window(r.metric, f, A[:, k], window, r.apart, halves)).astype(complex)
            rows *= np.exp(1j * np.angle(in_window(r.metric, at, tones[:, k], window, r.apart, halves)))
            each.append(level(rows, math.sqrt(s), part, frequency=at, clock=of[:, k]))
    return max(each) if surely else math.hypot(*each)


def of_tones(r: Requirement, tones: Tones, densities: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> float:
    """The figure that is required of what the sources are given as."""
    return figure(r, tones.frequency, tones.value * tones.turn, densities, clock=tones.clock)


def ends(
    r: Requirement, tones: Tones, gaps: Sequence[Gap], densities: Sequence[tuple[np.ndarray, np.ndarray]]
) -> tuple[float, float]:
    """Between which the figure lies: least and most; infinite where nothing bounds a gap."""
    lower, upper = (_shifted(r, tones, extreme) for extreme in (np.argmin, np.argmax))
    hidden_at = np.concatenate([np.zeros(0), *(gap.frequency for gap in gaps)])
    hidden = np.vstack([np.zeros((0, 2)), *(gap.most for gap in gaps)])
    f, bounded = np.concatenate([upper, hidden_at]), bool(np.all(np.isfinite(hidden)))
    if r.statistic != "level":
        least = figure(r, lower, tones.least, densities, surely=True)
        return least, figure(r, f, np.vstack([tones.most, hidden]), densities) if bounded else math.inf
    # A level may fall as a line grows, where others keep their phases to it or below RISES, but changes by no more than what the
    # line adds at its crests.
    falls = (tones.clock != ALONE) | (r.confidence < RISES)
    change = np.where(falls, np.maximum(tones.most - tones.value, tones.value - tones.least), 0.0)
    if r.confidence < RISES:
        change, hidden = np.vstack([change, hidden]), 0.0 * np.nan_to_num(hidden)
    crests = r.model_copy(update={"statistic": "bound"})
    reach = figure(crests, f[: len(change)], change) if np.all(np.isfinite(change)) else math.inf
    nominal, clock = (
        np.concatenate([tones.frequency, hidden_at]),
        np.vstack([tones.clock, np.full(hidden.shape, ALONE)]),
    )
    less, more = (np.where(falls, tones.value, one) * tones.turn for one in (tones.least, tones.most))
    least = figure(r, lower, less, densities, surely=True, clock=tones.clock, nominal=tones.frequency)
    most = figure(r, f, np.vstack([more, hidden]), densities, clock=clock, nominal=nominal) if bounded else math.inf
    return max(least - reach, 0.0), most + reach


def _shifted(r: Requirement, tones: Tones, extreme: Callable[..., np.ndarray]) -> np.ndarray:
    """Frequencies (k,) of lines, off by what they may be, such that they count least or most: between the zeros of a weight there
    may be no more than that, and at an end of the band they may be on either side of it."""
    f = tones.frequency
    off = f[:, None] + tones.off[:, None] * _OFF
    at = extreme(weight(r.metric, off, r.window or r.apart or 1.0, r.apart), axis=1)
    low, high = tones.ends
    if extreme is np.argmin:
        shifted = off[np.arange(f.size), at]
        outside = np.where(inside(r, low), np.where(inside(r, high), shifted, high), low)
        return np.where(inside(r, f), outside, f)
    shifted = np.clip(off[np.arange(f.size), at], r.lowest, math.inf if r.highest is None else r.highest)
    return np.where((shifted >= low) & (shifted <= high), shifted, f)


def crossings(r: Requirement, moving: Contribution, contributions: Iterable[Contribution]) -> Iterator[Gap]:
    """What lines that ``moving`` takes through a range of frequencies add where they meet a line of another source.

    Two lines of amplitudes A and a are one of A + a at most where they meet, by A a more than their mean squares.
    """
    if not moving.alternatives or r.statistic == "bound":
        return  # in a bound amplitudes add anyway
    before = True
    for other in contributions:
        before = before and other is not moving
        if other is moving or (before and other.alternatives):  # of two that move, the first has told what both add
            continue
        if other.sweep is not None:
            f, A = (np.concatenate(each) for each in zip(*other.sweep.swept(), strict=True))
        else:
            lines = other.alternatives or (other,)
            f = np.concatenate([one.frequency for one in lines])
            A = np.vstack([np.abs(one.los) * one.settled[:, None] for one in lines])
        why = f"its lines may meet those of {other.source}, in any phase"
        for swept, size in _swept(moving):
            met, a = _meeting(r, swept, size, f)
            if met.any() and r.curve is not None:
                yield Gap(why, 0.0, math.inf, f[met], A[met] + a)
            elif met.any():
                by = weight(r.metric, f[met], r.window or r.apart or 1.0, r.apart)
                worst = [int(np.argmax(by * np.sum((A[met] * a)[:, AXES[r.axis]], axis=1)))]
                yield Gap(why, 0.0, math.inf, f[met][worst], np.sqrt(2.0 * A[met] * a)[worst])


def beats(r: Requirement, one: Contribution, others: Iterable[Contribution]) -> Iterator[Gap]:
    """What lines of ``one`` source and of ``others`` add while those nearer than SLOW are in step; as ``crossings``."""
    if r.statistic == "bound":
        return
    for other in others:
        f, g = np.meshgrid(one.frequency, other.frequency, indexing="ij")
        apart = g - f if other is one else np.abs(g - f)  # of one source each pair once
        near = (apart > SAME * f) & (apart < SLOW) & inside(r, f) & np.outer(one.settled, other.settled)
        i, j = np.nonzero(near)
        if i.size:
            A, a = np.abs(one.los[i]), np.abs(other.los[j])
            most = A + a if r.curve is not None else np.sqrt(2.0 * A * a)
            whom = "each other" if other is one else f"those of {other.source}"
            yield Gap(
                f"its lines beat with {whom}, more slowly than once in {1.0 / SLOW:g} s", 0.0, math.inf, f[near], most
            )


def _swept(moving: Contribution) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of each line of a source with alternatives its frequencies, ascending (n,) [Hz], and amplitudes (n, 2) [rad]."""
    if moving.sweep is not None:
        yield from (each for each in moving.sweep.swept() if each[0].size > 1)
        return
    f = np.array([one.frequency for one in moving.alternatives])
    size = np.abs([one.los for one in moving.alternatives])
    for k in range(f.shape[1]):
        order = np.argsort(f[:, k])
        yield f[order, k], size[order, k]


def _meeting(r: Requirement, swept: np.ndarray, size: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which frequencies (m,) a line ``swept`` (n,) with its ``size`` (n, 2) passes, or comes so near to that the two add for as
    long as any window lasts, and its amplitudes there."""
    near = np.maximum(SLOW, frequency_doubt(f))
    met = (f >= swept[0] - near) & (f <= swept[-1] + near) & inside(r, f)
    right = np.clip(np.searchsorted(swept, f[met]), 1, swept.size - 1)
    return met, np.maximum(size[right - 1], size[right])


def inside(r: Requirement, frequency: np.ndarray) -> np.ndarray:
    """Which frequencies [Hz] count."""
    return np.asarray(in_band(frequency, r.lowest, math.inf if r.highest is None else r.highest))


def _of_density(r: Requirement, window: float, f: np.ndarray, S: np.ndarray) -> float:
    low, high = max(r.lowest, float(f[0])), min(math.inf if r.highest is None else r.highest, float(f[-1]))
    if low >= high:
        return 0.0
    grid = np.union1d(f[(f > low) & (f < high)], [low, high])
    return mean_square_of_density(r.metric, grid, np.interp(grid, f, S), window, r.apart)
