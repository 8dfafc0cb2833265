"""Coordinates by which a fit moves its parameters: one for each key, or, for an amplitude and its
phase, the amplitude times cosine and sine of the phase.

About an amplitude of 0 a phase means nothing, and a fit by amplitude and phase runs along valleys
to a wrong phase. Cartesian parts have no such place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from microvib.studies.identify.keys import FitKey

SMALLEST_AMPLITUDE = 0.01
"""Least amplitude that a search begins at, over the largest of a range that includes 0."""
ROUNDING = 1e-9
"""By how much an end of a range may be exceeded."""


@dataclass(frozen=True)
class Coordinates:
    """Coordinates of fitted keys; those of the ``pairs``, the numbers of an amplitude and of its
    phase, are Cartesian, over twice the largest amplitude of the range that it began with.
    """

    keys: tuple[FitKey, ...]
    pairs: tuple[tuple[int, int], ...] = ()

    def cartesian(self) -> Coordinates:
        """With Cartesian parts for each amplitude that is fitted with its phase, any phase being
        allowed.
        """
        pairs = ((a, p) for a, p in self._amplitudes() if self._any_phase(a, p))
        return Coordinates(self.keys, tuple(pairs))

    def _amplitudes(self) -> Iterator[tuple[int, int]]:
        """Numbers of amplitudes and of their phases."""
        at = {(key.key, key.test): k for k, key in enumerate(self.keys)}
        for (name, test), p in at.items():
            a = at.get((name.removesuffix("phase") + "amplitude", test))
            if a is not None and self.keys[p].is_phase:
                yield a, p

    def _any_phase(self, a: int, p: int) -> bool:
        """Whether ranges allow each phase, with an amplitude of one sign or the other."""
        width = self.keys[p].high - self.keys[p].low
        if self.keys[a].low < 0.0:
            return width > math.pi - ROUNDING
        return width > math.tau - ROUNDING

    def _scale(self, a: int) -> float:
        """Twice the largest amplitude of the range that it began with."""
        key = self.keys[a]
        return 2.0 * (key.around * key.factor or max(abs(key.low), abs(key.high)))

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates between which a local fit may move, (m,) each."""
        low, high = np.array([key.reach for key in self.keys]).T
        for a, p in self.pairs:
            ends = [abs(self.keys[a].value(x)) for x in (low[a], high[a])]
            far = max(ends) / self._scale(a)
            low[[a, p]], high[[a, p]] = -far, far
        return low, high

    @property
    def spans(self) -> np.ndarray:
        """Widths of the ranges that the keys began with, (m,)."""
        spans = np.array([key.span for key in self.keys])
        for a, p in self.pairs:
            spans[[a, p]] = 1.0
        return spans

    def values(self, x: np.ndarray) -> list[float]:
        """The keys' values at ``x`` (m,); of a pair an amplitude that is not negative."""
        pairs = {k for pair in self.pairs for k in pair}
        found = [
            0.0 if k in pairs else key.value(float(c))
            for k, (key, c) in enumerate(zip(self.keys, x, strict=True))
        ]
        for a, p in self.pairs:
            found[a] = self._scale(a) * math.hypot(x[a], x[p])
            found[p] = math.atan2(x[p], x[a])
        return found

    def point(self, values: Sequence[float]) -> np.ndarray:
        """Coordinates (m,) of values, within their limits."""
        return np.clip(self.start(values), *self.limits)

    def start(self, values: Sequence[float]) -> np.ndarray:
        """Coordinates (m,) of values, wherever they are.

        Of an amplitude and its phase those that are the same and in the ranges, if any are, the
        amplitude preferably not negative.
        """
        values = list(values)
        for a, p in self._amplitudes():
            values[a], values[p] = self._in_range(a, p, values[a], values[p])
        pairs = {k for pair in self.pairs for k in pair}
        x = np.array(
            [
                0.0 if k in pairs else key.coordinate(value)
                for k, (key, value) in enumerate(zip(self.keys, values, strict=True))
            ]
        )
        for a, p in self.pairs:
            size = values[a] / self._scale(a)
            x[a], x[p] = size * math.cos(values[p]), size * math.sin(values[p])
        return x

    def _in_range(self, a: int, p: int, size: float, phase: float) -> tuple[float, float]:
        """Amplitude and phase as they are written within their ranges; unchanged where they never are."""
        amplitude, its = self.keys[a], self.keys[p]
        folded = math.remainder(phase, math.tau)
        for sign in sorted((1.0, -1.0), key=lambda sign: sign * size < 0.0):
            turned = folded if sign > 0.0 else math.remainder(folded + math.pi, math.tau)
            for turns in (0.0, math.tau, -math.tau):
                inside = its.low - ROUNDING <= turned + turns <= its.high + ROUNDING
                if inside and amplitude.low <= sign * size <= amplitude.high:
                    return sign * size, turned + turns
        return size, phase

    def spread(self, parts: np.ndarray) -> np.ndarray:
        """Points (n, m) over the ranges of the keys for ``parts`` (n, m) from 0 to 1.

        Amplitudes of pairs are spread by their logarithm, since their size is not known, and phases
        over the whole turn.
        """
        low, high = np.array([key.range for key in self.keys]).T
        points = low + (high - low) * parts
        for a, p in self.pairs:
            key = self.keys[a]
            largest = max(abs(key.low), abs(key.high))
            if key.logarithmic:
                least = key.low
            else:
                least = SMALLEST_AMPLITUDE * largest
            size = least * (largest / least) ** parts[:, a] / self._scale(a)
            points[:, a] = size * np.cos(math.tau * parts[:, p])
            points[:, p] = size * np.sin(math.tau * parts[:, p])
        return points
