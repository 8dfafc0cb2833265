"""Tones in noise: steady ones that keep their ratios, and decaying ones.

Everything happens on one Hann-windowed spectrum, in which a steady or decaying tone has a closed form that falls off fast,
and every fit is a least-squares fit to the bins about the tones (``microvib.signals.hann``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals import hann
from microvib.signals.hann import FAR, REACH, ROOM
from microvib.signals.table import DETECTION

MOST_FOR_CLOCK = 12
"""Lines, the strongest, that the clock ratio is estimated from."""


@dataclass(frozen=True)
class Tones:
    """Tones a exp((2 pi i frequency - decay) t), (m,) each."""

    lines: tuple[ExpectedLine, ...]
    frequency: np.ndarray
    """[Hz]."""
    decay: np.ndarray
    """Decay rates [1/s]."""
    seen: np.ndarray
    limited: np.ndarray
    """Whether the fit ended at the end of the band or of the decay rates that it may take."""

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def modes(self) -> np.ndarray:
        """Which of them are array modes that were seen, (m,)."""
        modes: np.ndarray = self.seen & np.array([line.kind == "array mode" for line in self.lines], dtype=bool)
        return modes

    def without(self, some: np.ndarray) -> Tones:
        """The others than ``some``, (m,) true or false."""
        lines = tuple(line for line, out in zip(self.lines, some, strict=True) if not out)
        return Tones(lines, self.frequency[~some], self.decay[~some], self.seen[~some], self.limited[~some])


def steady(lines: Sequence[ExpectedLine], ratio: float = 1.0) -> Tones:
    """Steady tones at the expected frequencies times a clock ratio."""
    frequency = np.array([line.frequency for line in lines], dtype=float) * ratio
    none = np.zeros(len(lines), dtype=bool)
    return Tones(tuple(lines), frequency, np.zeros(len(lines)), ~none, none)


@dataclass(frozen=True)
class HannSpectrum:
    """Hann-windowed spectrum with interpolation between bins and a local floor."""

    values: np.ndarray
    """One-sided, (n//2 + 1,): a tone on a bin reads its amplitude."""
    unwindowed: np.ndarray
    """The same without a window."""
    samples: int
    sample_rate: float

    @classmethod
    def of(cls, x: np.ndarray, sample_rate: float) -> HannSpectrum:
        """Spectrum of the mean-free samples ``x`` (n,), at ``sample_rate`` [Hz]."""
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
        """Columns of the least-squares equations at the bins ``k``: cosine and minus sine of each tone, and a constant."""
        cycles, decay = self._in_record(tones)
        columns: np.ndarray = hann.equations(cycles, decay, k, self.values, self.table)[0].T
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
        values = self.values.copy()
        for cycles, decay, a in zip(*self._in_record(tones), amplitudes, strict=True):
            centre = round(cycles)
            band = np.arange(max(centre - FAR, 0), min(centre + FAR + 1, values.size))
            values[band] -= hann.tone(cycles, decay, a, band, self.table)
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

    def _in_record(self, tones: Tones) -> tuple[np.ndarray, np.ndarray]:
        """Cycles and e-foldings of the tones over the record."""
        return tones.frequency * self.duration, tones.decay * self.duration


def estimate_clock_ratio(clock: Sequence[ExpectedLine], spectrum: HannSpectrum) -> float | None:
    """Clock ratio that explains the lines of the clock best, all together; None where none of them stands out.

    One line gives the start; then Gauss-Newton on the joint fit, which weights each line with what it tells.
    """
    start = _first_ratio(clock, spectrum)
    if start is None:
        return None
    peaks = [(line, spectrum.peak(line.frequency * start, line.frequency * start)[1]) for line in clock]
    seen = [(line, a) for line, a in peaks if a > DETECTION * max(spectrum.floor(line.frequency * start), 1e-300)]
    lines = [line for line, _ in sorted(seen, key=lambda item: -item[1])[:MOST_FOR_CLOCK]]
    near = spectrum.near(steady(lines, start).frequency)
    ratio, bin_ratio = start, 1.0 / (max(line.frequency for line in lines) * spectrum.duration)
    r = spectrum.residual(steady(lines, ratio), near)
    for _ in range(12):
        slope = (spectrum.residual(steady(lines, ratio + 1e-4 * bin_ratio), near) - r) / (1e-4 * bin_ratio)
        move = float(np.clip(-(slope @ r) / max(float(slope @ slope), 1e-300), -0.2 * bin_ratio, 0.2 * bin_ratio))
        r_new = spectrum.residual(steady(lines, ratio + move), near)
        if r_new @ r_new > r @ r:
            break
        ratio, r = ratio + move, r_new
        if abs(move) < 1e-9 * bin_ratio:
            break
    return ratio


def _first_ratio(clock: Sequence[ExpectedLine], spectrum: HannSpectrum) -> float | None:
    """Clock ratio that one line tells: the strongest of the first driving lines, whose search bands hold no other line."""
    candidates = [line for line in clock if line.kind == "drive"][:3] or [
        line for line in clock if line.kind == "full step" and line.high > line.low
    ]  # a clock that is known is not looked for in these slow lines
    peaks = [(line, *spectrum.peak(line.low, line.high)) for line in candidates]
    seen = [item for item in peaks if item[2] > DETECTION * max(spectrum.floor(item[1]), 1e-300)]
    if not seen:
        return None
    line, frequency, _ = max(seen, key=lambda item: item[1] * item[2])
    slack = 0.7 * spectrum.sample_rate / spectrum.samples
    if not line.low - slack <= frequency <= line.high + slack:  # that peak is another line's
        return None
    return frequency / line.frequency


def with_modes(clock: Tones, modes: Sequence[ExpectedLine], spectrum: HannSpectrum) -> Tones:
    """The tones of the clock, and frequency and decay of each array mode, fitted beside them."""
    if not modes:
        return clock
    duration, expected = spectrum.duration, steady(modes)
    low, high = (np.array([getattr(line, end) for line in modes], dtype=float) * duration for end in ("low", "high"))
    at, values = expected.frequency * duration, spectrum.values
    room = hann.bins_in(np.minimum(low, at), np.maximum(high, at), ROOM, values.size)
    cycles, decay, seen, limited = hann.fit_modes(
        clock.frequency * duration, at, low, high, DETECTION, room, values, spectrum.table
    )
    # what is not seen stays where it is expected
    frequency = np.where(seen, cycles / duration, expected.frequency)
    return Tones(
        clock.lines + expected.lines,
        np.concatenate([clock.frequency, frequency]),
        np.concatenate([clock.decay, decay / duration]),
        np.concatenate([clock.seen, seen]),
        np.concatenate([clock.limited, limited]),
    )


def mean_of_decay(fold: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of exp(-fold u) for u from 0 to 1, and its derivative by ``fold``."""
    small = np.abs(fold) < 1e-4
    safe = np.where(small, 1.0, fold)
    mean = -np.expm1(-safe) / safe
    slope = np.exp(-safe) / safe - mean / safe
    return np.where(small, 1.0 - fold / 2.0, mean), np.where(small, -0.5 + fold / 3.0, slope)
