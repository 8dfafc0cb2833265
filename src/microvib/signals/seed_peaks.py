"""Largest amplitudes of T_d beside the lines of the clock, over many draws of the noise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from microvib.model.record import PASSBAND
from microvib.signals.line_table import Line, ResidualPeaks, twelfth_octave
from microvib.signals.tones import HannSpectrum
from microvib.signals.unaccounted import samples_of_lines

MOST_DRAWS = 1000
"""Draws whose peaks are kept, at most."""


@dataclass(frozen=True)
class SeedPeaks:
    """The highest bin of a Hann window in each twelfth of an octave, of every draw, without lines of
    the clock.
    """

    frequency: np.ndarray
    """[Hz], (draws, parts)."""
    amplitude: np.ndarray
    """[N m], 0-to-peak, (draws, parts)."""

    @classmethod
    def of(cls, draws: Iterable[ResidualPeaks]) -> SeedPeaks | None:
        """Peaks of draws of the same length each; None without one."""
        rows = list(draws)
        if not rows:
            return None
        return cls(
            np.array([one.frequency for one in rows]), np.array([one.amplitude for one in rows])
        )

    @property
    def draws(self) -> int:
        """How many there are."""
        return int(self.amplitude.shape[0])

    def largest(self, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        """The largest amplitude [N m] between two frequencies [Hz] of every draw: what it may be at
        most, and what is certainly in the band, (draws,) each.

        Where an end of the band cuts a twelfth of an octave, only the highest bin of the whole of it
        is known.
        """
        part = twelfth_octave(self.frequency)
        first, last = twelfth_octave(np.array([low, high]))
        touched = (part >= first) & (part <= last)
        inside = (self.frequency >= low) & (self.frequency <= high)
        most = np.max(np.where(touched, self.amplitude, 0.0), axis=1, initial=0.0)
        least = np.max(np.where(inside, self.amplitude, 0.0), axis=1, initial=0.0)
        return most, least

    def over(self, allowed: np.ndarray) -> SeedPeaks:
        """These peaks over what is allowed at each, (draws, parts); infinite where all is."""
        return SeedPeaks(self.frequency, self.amplitude / allowed)

    def typical_frequency(self, low: float, high: float) -> float:
        """Frequency [Hz] of the largest amplitude between two frequencies [Hz], the median over draws."""
        inside = (self.frequency >= low) & (self.frequency <= high)
        size = np.where(inside, self.amplitude, -1.0)
        rows = np.flatnonzero(np.any(inside, axis=1))
        if not rows.size:
            return 0.5 * (low + high)
        return float(np.median(self.frequency[rows, np.argmax(size[rows], axis=1)]))


def peaks_of_draw(x: np.ndarray, sample_rate: float, lines: Iterable[Line]) -> ResidualPeaks:
    """The highest bins of a draw ``x`` (n,) [N m], without those of its ``lines`` that the clock
    makes.
    """
    clock = [line for line in lines if line.of_clock and line.seen]
    rest = x - samples_of_lines(clock, x.size, sample_rate)
    spectrum = HannSpectrum.of(rest - rest.mean(), sample_rate)
    bins = np.arange(1, min(int(PASSBAND * x.size), spectrum.values.size))
    return ResidualPeaks.of(bins / spectrum.duration, spectrum.magnitude[bins])
