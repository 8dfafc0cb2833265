"""Tones of one record fitted together: what is near each other is never fitted one after another.

Amplitudes are eliminated (variable projection), so that a fit moves frequencies, decays and the clock ratio alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from microvib.signals import tone_kernel as hann
from microvib.signals.tone_kernel import REACH
from microvib.signals.tones import HannSpectrum, Tones, mean_of_decay

NEAR = 2 * REACH
"""Bins within which tones are fitted together."""
SLOWEST, FASTEST = -8.0, 60.0
"""e-foldings over the record that a decay may have."""
SLACK = 2.0
"""Bins beyond its band that a frequency may end at."""


@dataclass(frozen=True)
class Joint:
    """Tones in a spectrum, fitted together, and what they leave of it."""

    spectrum: HannSpectrum
    tones: Tones
    amplitudes: np.ndarray
    """Complex, at the first sample, (m,)."""
    rest: HannSpectrum

    @classmethod
    def of(cls, spectrum: HannSpectrum, tones: Tones) -> Joint:
        """The amplitudes of all ``tones``, where these are."""
        amplitudes = spectrum.amplitudes(tones)
        return cls(spectrum, tones, amplitudes, spectrum.without(tones, amplitudes))

    @property
    def sizes(self) -> np.ndarray:
        """Amplitudes as means over the record, (m,)."""
        sizes: np.ndarray = np.abs(self.amplitudes) * mean_of_decay(self.tones.decay * self.spectrum.duration)[0]
        return sizes

    def near(self, frequency: np.ndarray) -> np.ndarray:
        """Which tones are fitted together with tones at ``frequency`` (k,) [Hz]; (m,) true or false."""
        apart = np.abs(self.tones.frequency[:, None] - frequency[None, :]) * self.spectrum.duration
        near: np.ndarray = (apart < NEAR).any(axis=1)
        return near

    def with_tones(self, more: Tones) -> Joint:
        """A new fit with ``more`` tones; of the others, those near them are fitted again, together with them."""
        near = self.near(more.frequency)
        around, apart = self.tones.only(near), self.tones.only(~near)
        local = self.rest.without(around, -self.amplitudes[near])
        some, _ = moved(around.and_those(more), local)
        amplitudes = local.amplitudes(some)
        together = np.concatenate([self.amplitudes[~near], amplitudes])
        return Joint(self.spectrum, apart.and_those(some), together, local.without(some, amplitudes))


def moved(
    tones: Tones, spectrum: HannSpectrum, ratio: float | None = None, telling: np.ndarray | None = None
) -> tuple[Tones, float | None]:
    """The tones where they leave least of the spectrum: all free frequencies and decays together, and with them the clock
    ``ratio`` if it is given, to which the tones of the clock keep; ``telling``, (m,) true or false, are those of them whose bins
    count.
    """
    free, falls, duration = np.flatnonzero(tones.free), np.flatnonzero(tones.falls), spectrum.duration
    if free.size == 0 and ratio is None:
        return tones, None
    cycles, fold = tones.frequency * duration, tones.decay * duration
    counting = cycles if telling is None else cycles[telling | tones.free]
    k = hann.bins_in(counting, counting, REACH, spectrum.values.size)
    clock = np.flatnonzero(tones.clock & (ratio is not None))
    shifts = [np.inf] * (clock.size > 0)
    bands = [(x.low * duration - SLACK, x.high * duration + SLACK) for x in (tones.lines[i] for i in free)]
    low = np.array([max(a, 0.5) for a, _ in bands] + [SLOWEST] * falls.size + [-x for x in shifts])
    high = np.array([b for _, b in bands] + [FASTEST] * falls.size + shifts)
    there, falling, at = hann.fit(cycles, fold, free, falls, clock, low, high, k, spectrum.values, spectrum.table)
    ended = (at <= low + 1e-9) | (at >= high - 1e-9)
    limited = tones.limited.copy()
    limited[free] = ended[: free.size]
    limited[falls] |= ended[free.size : free.size + falls.size]
    result = replace(tones, frequency=there / duration, decay=falling / duration, limited=limited)
    if clock.size == 0:
        return result, ratio
    return result, float((ratio or 1.0) * there[clock[0]] / cycles[clock[0]])
