"""Tones of one record: steady ones that keep their ratios, and decaying ones; fitted together, with
their uncertainties.

Everything happens on one Hann-windowed spectrum, in which a steady or decaying tone has a closed
form that falls off fast. Every fit is a least-squares fit to the bins about the tones;
``microvib.signals.tone_kernel`` states the model, and ``microvib.signals.tone_fit`` fits it; both
are called from here alone. Tones near each other are never fitted one after another. Amplitudes are
eliminated (variable projection), so a fit moves frequencies, decays and the clock ratio only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals import tone_fit
from microvib.signals import tone_kernel as hann
from microvib.signals.line_table import Line
from microvib.signals.spectrum import SpectrumError
from microvib.signals.tone_algebra import half_turns
from microvib.signals.tone_kernel import REACH

MIN_SAMPLES = 8  # fewest samples of a record
INTERACTION_DISTANCE = 2 * REACH  # bins within which tones are fitted together
MIN_E_FOLDINGS, MAX_E_FOLDINGS = -8.0, 60.0  # bounds of a decay, in e-foldings over the record
BAND_MARGIN = 2.0  # bins by which a frequency may leave its band


@dataclass(frozen=True)
class Tones:
    """Tones a exp((2 pi i frequency - decay) t), (m,) each."""

    lines: tuple[ExpectedLine, ...]
    frequency: np.ndarray  # [Hz]
    decay: np.ndarray  # decay rates [1/s]
    # whether the frequency is fitted separately; the others are known, or known up to the clock
    # ratio
    free: np.ndarray
    falls: np.ndarray  # whether the decay is fitted
    limited: (
        np.ndarray
    )  # whether the fit ended at a bound of the frequency band or of the decay rate

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def clock(self) -> np.ndarray:
        """Which tones belong to the step clock, (m,)."""
        return ~self.free & np.array([not line.is_mode for line in self.lines], dtype=bool)

    def only(self, some: np.ndarray) -> Tones:
        """The tones for which ``some`` (m,) is true, or whose places it holds."""
        if some.dtype == bool:
            which = np.flatnonzero(some)
        else:
            which = some
        lines = tuple(self.lines[k] for k in which.tolist())
        return Tones(lines, *(getattr(self, name)[some] for name in _ARRAYS))

    def and_those(self, more: Tones) -> Tones:
        """These and ``more``."""
        arrays = (np.concatenate([getattr(self, name), getattr(more, name)]) for name in _ARRAYS)
        return Tones(self.lines + more.lines, *arrays)


_ARRAYS = ("frequency", "decay", "free", "falls", "limited")


def steady_tones(lines: Sequence[ExpectedLine], ratio: float = 1.0) -> Tones:
    """Steady tones at the expected frequencies times a clock ratio."""
    frequency = np.array([line.frequency for line in lines], dtype=float) * ratio
    none = np.zeros(len(lines), dtype=bool)
    return Tones(tuple(lines), frequency, np.zeros(len(lines)), none, none, none)


def decaying_tones(
    lines: Sequence[ExpectedLine], frequency: np.ndarray, decay: np.ndarray
) -> Tones:
    """Tones whose frequencies and decays are fitted, from ``frequency`` [Hz] and ``decay`` [1/s],
    (m,) each.
    """
    every = np.ones(len(lines), dtype=bool)
    return Tones(
        tuple(lines), np.asarray(frequency, float), np.asarray(decay, float), every, every, ~every
    )


def known_decaying_tones(lines: Sequence[tuple[ExpectedLine, Line]]) -> Tones:
    """Tones that fall as is known of each."""
    tones = steady_tones([line for line, _ in lines])
    frequency = np.array([found.frequency for _, found in lines], dtype=float)
    decay = np.array([found.decay for _, found in lines], dtype=float)
    return replace(tones, frequency=frequency, decay=decay)


@dataclass(frozen=True)
class HannSpectrum:
    """Hann-windowed spectrum with interpolation between bins and a local floor."""

    values: np.ndarray  # one-sided, (n//2 + 1,): a tone on a bin reads its amplitude
    unwindowed: np.ndarray  # the same without a window
    samples: int
    sample_rate: float

    def __post_init__(self) -> None:
        """SpectrumError for values that compiled code must not see: it would compute indices from
        NaN.
        """
        if not 0.0 < self.sample_rate < np.inf or self.samples < MIN_SAMPLES:
            raise SpectrumError(
                f"lines need at least {MIN_SAMPLES} samples at a finite rate; there are"
                f" {self.samples} at {self.sample_rate:g} Hz"
            )
        if not np.all(np.isfinite(self.values)):
            raise SpectrumError("lines need finite samples, small enough for a finite spectrum")

    @classmethod
    def of(cls, x: np.ndarray, sample_rate: float) -> HannSpectrum:
        """Spectrum of the mean-free samples ``x`` (n,), at ``sample_rate`` [Hz]; SpectrumError
        where they are not finite.
        """
        if x.size < MIN_SAMPLES:
            raise SpectrumError(f"lines need at least {MIN_SAMPLES} samples; there are {x.size}")
        plain = np.fft.rfft(x) * (2.0 / x.size)
        mirrored = plain[-2 if x.size % 2 == 0 else -1]
        beside = np.concatenate([plain[1:], [mirrored.conj()]])
        beside[1:] += plain[:-1]
        beside[0] += plain[1].conj()
        return cls(
            plain - 0.5 * beside, plain, x.size, sample_rate
        )  # a Hann window is 1 - cos(2 pi n/N)

    @property
    def duration(self) -> float:
        """Length of the record [s]: bins per Hz."""
        return self.samples / self.sample_rate

    @property
    def table(self) -> np.ndarray:
        """Sines and cosines for the closed forms (``tone_algebra.half_turns``)."""
        return half_turns(self.samples)

    @cached_property
    def magnitude(self) -> np.ndarray:
        """Amplitudes of the bins, (n//2 + 1,)."""
        return np.abs(self.values)

    def near(self, frequencies: np.ndarray) -> np.ndarray:
        """Bins within reach of any of the ``frequencies``."""
        cycles = frequencies * self.duration
        return hann.bins_in(cycles, cycles, REACH, self.values.size)

    def equations(self, tones: Tones, k: np.ndarray) -> np.ndarray:
        """Columns (2 m + 1, 2 n) of the equations at the bins ``k``: cosine and minus sine of each
        tone, a constant.
        """
        cycles, decay = self._in_record(tones)
        return hann.equations(cycles, decay, k, self.values, self.table)[0]

    def residual(self, tones: Tones, k: np.ndarray) -> np.ndarray:
        """Residual of the best fit of the tones at the bins ``k``: real parts, then imaginary ones."""
        nothing = np.zeros(0)
        basis, right = tone_fit.known(nothing, nothing, k, self.values, self.table)
        return tone_fit.residual(*self._in_record(tones), k, basis, right, self.table)

    def amplitudes(self, tones: Tones) -> np.ndarray:
        """Complex amplitudes a of all tones, x = Re(a exp(i w t)), (m,), from one least-squares fit
        to the bins about them.
        """
        return hann.amplitudes(*self._in_record(tones), self.values, self.table)

    def without(self, tones: Tones, amplitudes: np.ndarray) -> HannSpectrum:
        """The spectrum less some tones, each subtracted from the bins where it is above rounding."""
        values = hann.without(
            *self._in_record(tones), np.asarray(amplitudes, complex), self.values, self.table
        )
        return replace(self, values=values)

    def floors(self, frequencies: np.ndarray) -> np.ndarray:
        """Median amplitude of bins 4 to 20 away from each of the ``frequencies``."""
        return hann.floors(frequencies * self.duration, self.values)

    def floor(self, frequency: float) -> float:
        """The noise floor about one frequency."""
        return float(self.floors(np.array([frequency]))[0])

    def peak(self, low: float, high: float, margin: float = 1.5) -> tuple[float, float]:
        """Frequency [Hz] and amplitude of the highest peak from ``low`` to ``high``, a few bins of
        margin allowed.
        """
        cycles, amplitude = hann.peak(
            low * self.duration, high * self.duration, margin, self.values
        )
        return cycles / self.duration, amplitude

    def peaks(self, low: float, high: float, most: int) -> list[tuple[float, float]]:
        """Frequency [Hz] and amplitude of the ``most`` highest peaks from ``low`` to ``high``, a
        few bins of margin allowed.
        """
        first, last = (
            max(int(low * self.duration - 1.5), 1),
            int(np.ceil(high * self.duration + 1.5)) + 1,
        )
        inside = self.magnitude[first - 1 : last + 1]
        tops = 1 + np.flatnonzero((inside[1:-1] >= inside[:-2]) & (inside[1:-1] >= inside[2:]))
        strongest = tops[np.argsort(-inside[tops], kind="stable")][:most]
        at = (strongest + first - 1) / self.duration
        return [self.peak(f, f, margin=0.0) for f in at.tolist()]

    def height(self, frequency: float, within: float) -> float:
        """Largest amplitude within so many bins of a frequency, at least of the two neighbouring
        bins.
        """
        cycles = frequency * self.duration
        first, last = int(np.floor(cycles - within)), int(np.ceil(cycles + within))
        return float(np.max(self.magnitude[max(first, 0) : last + 1], initial=0.0))

    def _in_record(self, tones: Tones) -> tuple[np.ndarray, np.ndarray]:
        """Cycles and e-foldings of the tones over the record."""
        return tones.frequency * self.duration, tones.decay * self.duration


def amplitudes_in(spectra: Sequence[HannSpectrum], tones: Tones) -> np.ndarray:
    """``amplitudes`` of the same tones in several spectra of one length, (m, spectra), for the
    price of one.
    """
    first = spectra[0]
    k = first.near(tones.frequency)
    columns = first.equations(tones, k)
    scale = np.linalg.norm(columns, axis=1)[:, None]
    there = scale[:, 0] > 0.0  # of a constant nothing stands in bins far from zero
    columns, scale = columns[there] / scale[there], scale[there]
    right = np.array([np.concatenate([one.values[k].real, one.values[k].imag]) for one in spectra])
    solution = np.zeros((there.size, len(spectra)))
    solution[there] = np.linalg.solve(columns @ columns.T, columns @ right.T) / scale
    return np.asarray(solution[:-1:2] + 1j * solution[1:-1:2])


def mean_of_decay(fold: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of exp(-fold u) for u from 0 to 1, and its derivative by ``fold``."""
    small = np.abs(fold) < 1e-4
    safe = np.where(small, 1.0, fold)
    mean = -np.expm1(-safe) / safe
    slope = np.exp(-safe) / safe - mean / safe
    return np.where(small, 1.0 - fold / 2.0, mean), np.where(small, -0.5 + fold / 3.0, slope)


@dataclass(frozen=True)
class JointFit:
    """Tones in a spectrum, fitted jointly, and the residual spectrum."""

    spectrum: HannSpectrum
    tones: Tones
    amplitudes: np.ndarray  # complex, at the first sample, (m,)
    rest: HannSpectrum

    @classmethod
    def of(cls, spectrum: HannSpectrum, tones: Tones) -> JointFit:
        """Fit the amplitudes of all ``tones``, with their frequencies and decays as given."""
        amplitudes = spectrum.amplitudes(tones)
        return cls(spectrum, tones, amplitudes, spectrum.without(tones, amplitudes))

    @property
    def sizes(self) -> np.ndarray:
        """Amplitudes, averaged over the record, (m,)."""
        return np.abs(self.amplitudes) * mean_of_decay(self.tones.decay * self.spectrum.duration)[0]

    def near(self, frequency: np.ndarray) -> np.ndarray:
        """Which tones (m,) have to be fitted together with tones at ``frequency`` (k,) [Hz]."""
        apart = np.abs(self.tones.frequency[:, None] - frequency[None, :]) * self.spectrum.duration
        return (apart < INTERACTION_DISTANCE).any(axis=1)

    def with_tones(self, more: Tones) -> JointFit:
        """A new fit with ``more`` tones, together with which the existing ones near them are fitted
        again.
        """
        near = self.near(more.frequency)
        around, apart = self.tones.only(near), self.tones.only(~near)
        before = np.concatenate([self.amplitudes[near], np.zeros(len(more))])
        some, amplitudes, rest = _refit_in_residual(around.and_those(more), before, self.rest)
        together = np.concatenate([self.amplitudes[~near], amplitudes])
        return JointFit(self.spectrum, apart.and_those(some), together, rest)


def _refit_in_residual(
    tones: Tones, before: np.ndarray, rest: HannSpectrum
) -> tuple[Tones, np.ndarray, HannSpectrum]:
    """Tones fitted in a residual that they were taken out of with the amplitudes ``before``, 0 for
    new ones; their amplitudes, and what they leave."""
    free, falls, duration = np.flatnonzero(tones.free), np.flatnonzero(tones.falls), rest.duration
    low, high = _bounds(tones, free, falls.size, duration)
    there, falling, at, amplitudes, values = tone_fit.refit(
        tones.frequency * duration,
        tones.decay * duration,
        before,
        free,
        falls,
        low,
        high,
        rest.values,
        rest.table,
    )
    found = _with_fit_result(tones, there / duration, falling / duration, at, low, high)
    return found, amplitudes, replace(rest, values=values)


def _bounds(
    tones: Tones, free: np.ndarray, falls: int, duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of a fit's parameters: frequencies of the tones ``free``, in cycles, and so many
    decays, in e-foldings.
    """
    bands = [
        (x.low * duration - BAND_MARGIN, x.high * duration + BAND_MARGIN)
        for x in (tones.lines[i] for i in free)
    ]
    low, high = [max(a, 0.5) for a, _ in bands], [b for _, b in bands]
    return np.array(low + [MIN_E_FOLDINGS] * falls), np.array(high + [MAX_E_FOLDINGS] * falls)


def _with_fit_result(
    tones: Tones,
    frequency: np.ndarray,
    decay: np.ndarray,
    at: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> Tones:
    """Tones where a fit ended, and which of its parameters, free frequencies and then decays, ended
    at a bound.
    """
    ended = (at <= low + 1e-9) | (at >= high - 1e-9)
    limited, free = tones.limited.copy(), int(np.count_nonzero(tones.free))
    limited[tones.free] = ended[:free]
    limited[tones.falls] |= ended[free : free + int(np.count_nonzero(tones.falls))]
    return replace(tones, frequency=frequency, decay=decay, limited=limited)


def refine_clock_and_tones(
    tones: Tones, spectrum: HannSpectrum, ratio: float, telling: np.ndarray
) -> tuple[Tones, float]:
    """The tones with the clock ratio, free frequencies and decays that minimise the residual, all
    moved together.

    All tones of the clock share the ratio. Only the bins of free tones and of those marked in
    ``telling`` (m,) count.
    """
    free, falls, clock = (np.flatnonzero(which) for which in (tones.free, tones.falls, tones.clock))
    if clock.size == 0:
        return tones, ratio
    duration = spectrum.duration
    cycles, fold, counting = (
        tones.frequency * duration,
        tones.decay * duration,
        telling | tones.free,
    )
    k = hann.bins_in(cycles[counting], cycles[counting], REACH, spectrum.values.size)
    bounds = zip(_bounds(tones, free, falls.size, duration), (-np.inf, np.inf), strict=True)
    low, high = (np.append(ends, end) for ends, end in bounds)
    there, falling, at = tone_fit.fit(
        cycles, fold, free, falls, clock, low, high, k, spectrum.values, spectrum.table
    )
    found = _with_fit_result(tones, there / duration, falling / duration, at, low, high)
    return found, float(ratio * there[clock[0]] / cycles[clock[0]])
