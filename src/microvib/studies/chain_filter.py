"""Filter of a measuring chain that a recording went through and nobody stated, such as AC coupling, estimated from
its lines beside those of a scenario.

A filter changes amplitudes and phases of all lines by one law. Recorded lines over expected ones are therefore held
against the filters of a grid, with a gain in common and the time by which the records are apart. A filter is told
only where nearly all lines that it changes are then as expected: other parameters of a drive change some lines, and
not by the law of a filter. Where the scenario is not that good, nothing is told, and none is excluded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

MOST_TAKEN = 0.05
"""Part of a line that a filter may take and that is still judged: as much as a force table may change."""
_OFF, _SIGMAS = 0.1, 4.0
"""Relative difference, as complex amplitudes, from which a line is off, and standard uncertainties of it."""
_LEAST_EXPLAINED, _CLEARLY = 2, 1.5
"""Lines that must be off without the filter and not with it, since one alone may have any cause; and how many times
their tolerance they must be off.
"""
_TAKEN, _EXPLAINED, _FAR_LESS, _OTHERS_OFF = 2.0, 0.8, 1.0 / 3.0, 1.0 / 3.0
"""How many tolerances a filter takes of a line that must then be explained, and what part of these must be; part that
is left of the difference of a line that is off by far less; and part of the others that may be off: where more are,
the scenario is of another drive.
"""
_LEAST_PASSED, _MANY_EXPLAINED = 2, 6
"""Lines that a filter must pass: without any it is a slope, and the gain in common is not known; unless so many lines
are explained with a gain of 1.
"""
_MOSTLY_EXPLAINED = 0.5
"""Part of the lines of which it takes a part that must be off without it: those of the median gain are not."""
_ORDERS = (1, 2, 4, 8)
_CORNERS_PER_OCTAVE = 6
_REFINED_OCTAVES = (1.0 / 24.0, 1.0 / 96.0)
"""Steps between corners beside the best of each kind, one after the other."""
_BEYOND = 8.0
"""Times the lines' range of frequencies on either side of which corners are looked for."""
_SHIFTS_PER_CYCLE, _REFINED = 12, 2
"""Time shifts looked at in a cycle of the highest line, and how many times the best one is refined by the phases."""
_MOST_SHIFTS = 20_000
_AT_ONCE = 64
"""Filters whose shifts are looked at together."""
_MOST_OFF = 3.0
"""Tolerances up to which a line that is off counts in a misfit."""
_LEAST_RESPONSE = 1e-6


class LineRatio(NamedTuple):
    """A recorded line over the expected one."""

    frequency: float
    """[Hz]."""
    ratio: complex
    uncertainty: float
    """Standard uncertainty relative to the line."""


@dataclass(frozen=True)
class ChainFilter:
    """A Butterworth filter, of zero phase or as an amplifier has it."""

    passes: Literal["low", "high"]
    order: int
    corner: float
    """Frequency [Hz] at which it passes 0.707 of an amplitude."""
    zero_phase: bool = False

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Complex response at each ``frequency`` (m,) [Hz]."""
        s = 1j * np.asarray(frequency, dtype=float) / self.corner
        if self.passes == "high":
            s = 1.0 / s
        poles = np.exp(0.5j * np.pi * (1.0 + (2.0 * np.arange(self.order) + 1.0) / self.order))
        H = 1.0 / np.prod(s[:, None] - poles, axis=1)
        return np.abs(H).astype(complex) if self.zero_phase else H

    @property
    def taken_from(self) -> tuple[float, float]:
        """Ends [Hz] of the frequencies at which it takes more than ``MOST_TAKEN`` of a line."""
        least = 1.0 - MOST_TAKEN
        times = (1.0 / least**2 - 1.0) ** (1.0 / (2.0 * self.order))
        if self.passes == "low":
            return self.corner * times, math.inf
        return 0.0, self.corner / times

    def takes_between(self, low: float, high: float) -> bool:
        """Whether it takes more than ``MOST_TAKEN`` of lines somewhere between ``low`` and ``high`` [Hz]."""
        first, last = self.taken_from
        return first < high and low < last

    def __str__(self) -> str:
        low, high = self.taken_from
        where = f"below {high:.3g} Hz" if self.passes == "high" else f"above {low:.3g} Hz"
        such = "a high-pass (AC coupling)" if self.passes == "high" else "a low-pass"
        return (
            f"{such} of order {self.order} at {self.corner:.3g} Hz, which takes more than"
            f" {100.0 * MOST_TAKEN:g} % of a line {where}"
        )


@lru_cache(maxsize=16)
def find_filter(lines: tuple[LineRatio, ...], slowest: float) -> ChainFilter | None:
    """The filter that explains how recorded lines differ from expected ones; None where they do not, or no filter
    does.

    Parameters
    ----------
    lines : tuple of LineRatio
        Lines that both sides have.
    slowest : float
        Frequency [Hz] with which the motion repeats, which bounds the time by which records may be apart.
    """
    if len(lines) < _LEAST_EXPLAINED + _LEAST_PASSED or not slowest > 0.0:
        return None
    fit = _Fit.of(lines, slowest)
    before = fit.distance(np.ones(fit.frequency.size, dtype=complex))
    if np.count_nonzero(before > 1.0) < _LEAST_EXPLAINED:
        return None
    candidates = fit.best_of_kinds(list(_candidates(fit.frequency)))
    for octaves in _REFINED_OCTAVES:
        candidates = fit.best_of_kinds([x for one in candidates for x in _beside(one, octaves)])
    best = candidates[0]
    return best if fit.tells(best.response(fit.frequency)) else None


def _beside(one: ChainFilter, octaves: float) -> Iterator[ChainFilter]:
    """A filter, and those of corners beside it."""
    for steps in (-2, -1, 0, 1, 2):
        yield replace(one, corner=one.corner * 2.0 ** (steps * octaves))


def _candidates(frequency: np.ndarray) -> Iterator[ChainFilter]:
    low, high = float(np.min(frequency)) / _BEYOND, float(np.max(frequency)) * _BEYOND
    corners = np.geomspace(low, high, round(_CORNERS_PER_OCTAVE * math.log2(high / low)))
    for order in _ORDERS:
        for corner in corners.tolist():
            for zero_phase in (False, True):
                yield ChainFilter("low", order, corner, zero_phase)
                yield ChainFilter("high", order, corner, zero_phase)


@dataclass(frozen=True)
class _Fit:
    frequency: np.ndarray
    ratio: np.ndarray
    tolerance: np.ndarray
    """From which a line is off, relative, (k,)."""
    turns: np.ndarray
    """Phasors of the lines over time shifts, (shifts, k)."""

    @classmethod
    def of(cls, lines: Sequence[LineRatio], slowest: float) -> _Fit:
        f = np.array([line.frequency for line in lines])
        shifts = min(math.ceil(_SHIFTS_PER_CYCLE * float(np.max(f)) / slowest), _MOST_SHIFTS)
        time = np.arange(shifts) / (shifts * slowest)
        sigma = np.array([line.uncertainty for line in lines])
        return cls(
            f,
            np.array([line.ratio for line in lines]),
            np.maximum(_OFF, _SIGMAS * sigma),
            np.exp(2j * math.pi * f * time[:, None]),
        )

    def distance(self, response: np.ndarray) -> np.ndarray:
        """Differences of the lines over their tolerances with a ``response`` (k,), (k,)."""
        return np.asarray(self.distances(response[None])[0])

    def tells(self, response: np.ndarray) -> bool:
        """Whether lines tell that they are behind a ``response`` (k,): several that are off without it are as expected
        with it, or off by far less, nearly all of those among them of which it takes a part; it makes hardly any
        worse; and most of the others are as expected, some of which it passes.
        """
        before, after = self.distance(np.ones_like(response)), self.distance(response)
        right = after < np.maximum(1.0, _FAR_LESS * before)
        explained = (before > _CLEARLY) & right
        worse = (before <= 1.0) & (after > 1.0)
        taken = np.abs(response) < 1.0 - _TAKEN * self.tolerance
        passed = np.abs(response) > 1.0 - MOST_TAKEN
        count = np.count_nonzero
        gain = float(np.median(np.abs(self.ratio / response)))
        gain_is_known = count(passed) >= _LEAST_PASSED or (
            abs(gain - 1.0) < _OFF and count(explained) >= _MANY_EXPLAINED
        )
        return bool(
            gain_is_known
            and count(passed) < passed.size
            and count(explained) >= _LEAST_EXPLAINED
            and count(explained & taken) >= _MOSTLY_EXPLAINED * count(taken)
            and count(right & taken) >= _EXPLAINED * count(taken)
            and count(worse) <= (1.0 - _EXPLAINED) * count(explained)
            and count((after > 1.0) & ~taken) <= _OTHERS_OFF * count(~taken)
        )

    def best_of_kinds(self, candidates: Sequence[ChainFilter]) -> list[ChainFilter]:
        """The filter of each kind and order with the least misfit, the best first."""
        responses = np.array([one.response(self.frequency) for one in candidates])
        misfits = self.square_sums(responses)
        best: dict[tuple[str, int, bool], int] = {}
        for k in np.argsort(misfits, kind="stable").tolist():
            one = candidates[k]
            best.setdefault((one.passes, one.order, one.zero_phase), k)
        return [candidates[k] for k in best.values()]

    def square_sums(self, responses: np.ndarray) -> np.ndarray:
        """Misfit of each of ``responses`` (m, k): sum of squares of what lines are off, each up to a few
        tolerances, (m,).
        """
        pieces = np.array_split(responses, math.ceil(responses.shape[0] / _AT_ONCE))
        distances = np.concatenate([self.distances(piece) for piece in pieces])
        return np.asarray(np.sum(np.minimum(distances, _MOST_OFF) ** 2, axis=1))

    def distances(self, responses: np.ndarray) -> np.ndarray:
        """Differences of the lines over their tolerances with each of ``responses`` (m, k), at the best gain and
        shift, (m, k).
        """
        left = self.ratio / np.where(
            np.abs(responses) > _LEAST_RESPONSE, responses, _LEAST_RESPONSE
        )
        left = left / np.median(np.abs(left), axis=1, keepdims=True)
        weighted = np.minimum(1.0 / np.abs(left), 1.0) / self.tolerance * left
        at = np.argmax(np.real(self.turns.conj() @ weighted.T), axis=0)
        left = left * self.turns[at].conj()
        for _ in range(_REFINED):
            left = left * np.exp(-2j * math.pi * self.frequency * self._later(left)[:, None])
        return np.asarray(np.abs(left - 1.0) / self.tolerance)

    def _later(self, left: np.ndarray) -> np.ndarray:
        """Time [s] by which lines are still late, of those whose phases are near those of the others, (m,)."""
        phase = np.angle(left)
        weight = np.where(np.abs(phase) < 1.0, self.frequency / self.tolerance**2, 0.0)
        whole = np.sum(weight * self.frequency, axis=1)
        return np.asarray(
            np.sum(weight * phase, axis=1) / (2.0 * math.pi * np.maximum(whole, 1e-12))
        )
