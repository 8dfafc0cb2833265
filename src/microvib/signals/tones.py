"""Tones in noise: steady ones that keep their ratios, and decaying ones.

Everything happens on one Hann-windowed spectrum, in which a steady or decaying tone has a closed form that falls off fast,
and every fit is a least-squares fit to the bins about the tones (``microvib.signals.tone_kernel``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals import tone_kernel as hann
from microvib.signals.spectrum import SpectrumError
from microvib.signals.tone_kernel import REACH

FEWEST = 8
"""Samples of the shortest record."""


@dataclass(frozen=True)
class Tones:
    """Tones a exp((2 pi i frequency - decay) t), (m,) each."""

    lines: tuple[ExpectedLine, ...]
    frequency: np.ndarray
    """[Hz]."""
    decay: np.ndarray
    """Decay rates [1/s]."""
    free: np.ndarray
    """Whether the frequency is fitted by itself; that of the others is known, or known but for the clock ratio."""
    falls: np.ndarray
    """Whether the decay is fitted."""
    limited: np.ndarray
    """Whether the fit ended at the end of the band or of the decay rates that it may take."""

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def clock(self) -> np.ndarray:
        """Which of them keep to the step clock, (m,)."""
        clock: np.ndarray = ~self.free & np.array([line.kind != "array mode" for line in self.lines], dtype=bool)
        return clock

    def only(self, some: np.ndarray) -> Tones:
        """Those of ``some``, (m,) true or false."""
        lines = tuple(line for line, keep in zip(self.lines, some, strict=True) if keep)
        return Tones(lines, *(getattr(self, name)[some] for name in _ARRAYS))

    def and_those(self, more: Tones) -> Tones:
        """These and ``more``."""
        arrays = (np.concatenate([getattr(self, name), getattr(more, name)]) for name in _ARRAYS)
        return Tones(self.lines + more.lines, *arrays)


_ARRAYS = ("frequency", "decay", "free", "falls", "limited")


def steady(lines: Sequence[ExpectedLine], ratio: float = 1.0) -> Tones:
    """Steady tones at the expected frequencies times a clock ratio."""
    frequency = np.array([line.frequency for line in lines], dtype=float) * ratio
    none = np.zeros(len(lines), dtype=bool)
    return Tones(tuple(lines), frequency, np.zeros(len(lines)), none, none, none)


def falling(lines: Sequence[ExpectedLine], frequency: np.ndarray, decay: np.ndarray) -> Tones:
    """Tones whose frequencies and decays are fitted, from ``frequency`` [Hz] and ``decay`` [1/s], (m,) each."""
    every = np.ones(len(lines), dtype=bool)
    return Tones(tuple(lines), np.asarray(frequency, float), np.asarray(decay, float), every, every, ~every)


@dataclass(frozen=True)
class HannSpectrum:
    """Hann-windowed spectrum with interpolation between bins and a local floor."""

    values: np.ndarray
    """One-sided, (n//2 + 1,): a tone on a bin reads its amplitude."""
    unwindowed: np.ndarray
    """The same without a window."""
    samples: int
    sample_rate: float

    def __post_init__(self) -> None:
        """SpectrumError for what compiled code must not see: it would take indices from numbers that are none."""
        if not 0.0 < self.sample_rate < np.inf or self.samples < FEWEST:
            raise SpectrumError(
                f"lines need at least {FEWEST} samples at a finite rate; there are {self.samples} at {self.sample_rate:g} Hz"
            )
        if not np.all(np.isfinite(self.values)):
            raise SpectrumError("lines need finite samples, and no larger than a spectrum of them can be")

    @classmethod
    def of(cls, x: np.ndarray, sample_rate: float) -> HannSpectrum:
        """Spectrum of the mean-free samples ``x`` (n,), at ``sample_rate`` [Hz]; SpectrumError where they are not finite."""
        if x.size < FEWEST:
            raise SpectrumError(f"lines need at least {FEWEST} samples; there are {x.size}")
        plain = np.fft.rfft(x) * (2.0 / x.size)
        mirrored = plain[-2 if x.size % 2 == 0 else -1]
        beside = np.concatenate([plain[1:], [mirrored.conj()]])
        beside[1:] += plain[:-1]
        beside[0] += plain[1].conj()
        return cls(plain - 0.5 * beside, plain, x.size, sample_rate)  # a Hann window is 1 - cos(2 pi n/N)

    @property
    def duration(self) -> float:
        """Length of the record [s]: bins per Hz."""
        return self.samples / self.sample_rate

    @property
    def table(self) -> np.ndarray:
        """Half turns that the closed forms are made of."""
        return hann.half_turns(self.samples)

    @cached_property
    def magnitude(self) -> np.ndarray:
        """Amplitudes of the bins, (n//2 + 1,)."""
        magnitude: np.ndarray = np.abs(self.values)
        return magnitude

    def near(self, frequencies: np.ndarray) -> np.ndarray:
        """Bins within reach of any of the ``frequencies``."""
        cycles = frequencies * self.duration
        bins: np.ndarray = hann.bins_in(cycles, cycles, REACH, self.values.size)
        return bins

    def equations(self, tones: Tones, k: np.ndarray) -> np.ndarray:
        """Columns (2 m + 1, 2 n) of the equations at the bins ``k``: cosine and minus sine of each tone, a constant."""
        cycles, decay = self._in_record(tones)
        columns: np.ndarray = hann.equations(cycles, decay, k, self.values, self.table)[0]
        return columns

    def residual(self, tones: Tones, k: np.ndarray) -> np.ndarray:
        """What the best fit of the tones leaves at the bins ``k``: real parts, then imaginary ones."""
        rest: np.ndarray = hann.residual(*self._in_record(tones), k, self.values, self.table)
        return rest

    def amplitudes(self, tones: Tones) -> np.ndarray:
        """Complex amplitudes a of all tones together, x = Re(a exp(i w t)), (m,); least squares over the bins about them."""
        result: np.ndarray = hann.amplitudes(*self._in_record(tones), self.values, self.table)
        return result

    def without(self, tones: Tones, amplitudes: np.ndarray) -> HannSpectrum:
        """The spectrum with some tones taken out, each from the bins where it stands out of rounding."""
        values = hann.without(*self._in_record(tones), np.asarray(amplitudes, complex), self.values, self.table)
        return replace(self, values=values)

    def floors(self, frequencies: np.ndarray) -> np.ndarray:
        """Median amplitude of bins 4 to 20 away from each of the ``frequencies``."""
        floors: np.ndarray = hann.floors(frequencies * self.duration, self.values)
        return floors

    def floor(self, frequency: float) -> float:
        """The floor about one frequency."""
        return float(self.floors(np.array([frequency]))[0])

    def peak(self, low: float, high: float, margin: float = 1.5) -> tuple[float, float]:
        """Frequency [Hz] and amplitude of the highest peak from ``low`` to ``high``, a few bins of margin allowed."""
        cycles, amplitude = hann.peak(low * self.duration, high * self.duration, margin, self.values)
        return cycles / self.duration, amplitude

    def peaks(self, low: float, high: float, most: int) -> list[tuple[float, float]]:
        """Frequency [Hz] and amplitude of the ``most`` highest peaks from ``low`` to ``high``, a few bins of margin allowed."""
        first, last = max(int(low * self.duration - 1.5), 1), int(np.ceil(high * self.duration + 1.5)) + 1
        inside = self.magnitude[first - 1 : last + 1]
        tops = 1 + np.flatnonzero((inside[1:-1] >= inside[:-2]) & (inside[1:-1] >= inside[2:]))
        strongest = tops[np.argsort(-inside[tops], kind="stable")][:most]
        at = (strongest + first - 1) / self.duration
        return [self.peak(f, f, margin=0.0) for f in at.tolist()]

    def height(self, frequency: float, within: float) -> float:
        """Largest amplitude of the bins within so many bins of a frequency, the two beside it at least."""
        cycles = frequency * self.duration
        first, last = int(np.floor(cycles - within)), int(np.ceil(cycles + within))
        return float(np.max(self.magnitude[max(first, 0) : last + 1], initial=0.0))

    def _in_record(self, tones: Tones) -> tuple[np.ndarray, np.ndarray]:
        """Cycles and e-foldings of the tones over the record."""
        return tones.frequency * self.duration, tones.decay * self.duration


def mean_of_decay(fold: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of exp(-fold u) for u from 0 to 1, and its derivative by ``fold``."""
    small = np.abs(fold) < 1e-4
    safe = np.where(small, 1.0, fold)
    mean = -np.expm1(-safe) / safe
    slope = np.exp(-safe) / safe - mean / safe
    return np.where(small, 1.0 - fold / 2.0, mean), np.where(small, -0.5 + fold / 3.0, slope)
