"""Tones of one record: steady ones that keep their ratios, and decaying ones; fitted together, with their uncertainties.

Everything happens on one Hann-windowed spectrum, in which a steady or decaying tone has a closed form that falls off fast. Every
fit is a least-squares fit to the bins about the tones; ``microvib.signals.tone_kernel``, called from here alone, states the model.
Tones near each other are never fitted one after another. Amplitudes are eliminated (variable projection), so a fit moves
frequencies, decays and the clock ratio only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals import tone_kernel as hann
from microvib.signals.line_table import Uncertainty
from microvib.signals.spectrum import SpectrumError
from microvib.signals.tone_algebra import half_turns
from microvib.signals.tone_kernel import REACH

FEWEST = 8  # fewest samples of a record
NEAR = 2 * REACH  # bins within which tones are fitted together
SLOWEST, FASTEST = -8.0, 60.0  # bounds of a decay, in e-foldings over the record
SLACK = 2.0  # bins by which a frequency may leave its band
_NUDGE = 1e-4  # step of difference quotients, in cycles or e-foldings over the record
_FEW = 1.08
"""Widens uncertainties, since the floor is itself uncertain by a sixth: a median of some thirty dependent bins."""
_USUAL = 2.0  # RMS of the residual in a tone's own bins, over that of the noise, which noise alone hardly exceeds
_HIDES = 5.0  # effect of a hidden line on one within a bin, over the residual it leaves: the fit absorbs most of it


@dataclass(frozen=True)
class Tones:
    """Tones a exp((2 pi i frequency - decay) t), (m,) each."""

    lines: tuple[ExpectedLine, ...]
    frequency: np.ndarray  # [Hz]
    decay: np.ndarray  # decay rates [1/s]
    free: np.ndarray  # whether the frequency is fitted separately; the others are known, or known up to the clock ratio
    falls: np.ndarray  # whether the decay is fitted
    limited: np.ndarray  # whether the fit ended at a bound of the frequency band or of the decay rate

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def clock(self) -> np.ndarray:
        """Which tones belong to the step clock, (m,)."""
        return ~self.free & np.array([line.kind != "array mode" for line in self.lines], dtype=bool)

    def only(self, some: np.ndarray) -> Tones:
        """The tones for which ``some`` (m,) is true."""
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

    values: np.ndarray  # one-sided, (n//2 + 1,): a tone on a bin reads its amplitude
    unwindowed: np.ndarray  # the same without a window
    samples: int
    sample_rate: float

    def __post_init__(self) -> None:
        """SpectrumError for values that compiled code must not see: it would compute indices from NaN."""
        if not 0.0 < self.sample_rate < np.inf or self.samples < FEWEST:
            raise SpectrumError(
                f"lines need at least {FEWEST} samples at a finite rate; there are {self.samples} at {self.sample_rate:g} Hz"
            )
        if not np.all(np.isfinite(self.values)):
            raise SpectrumError("lines need finite samples, small enough for a finite spectrum")

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
        """Columns (2 m + 1, 2 n) of the equations at the bins ``k``: cosine and minus sine of each tone, a constant."""
        cycles, decay = self._in_record(tones)
        return hann.equations(cycles, decay, k, self.values, self.table)[0]

    def residual(self, tones: Tones, k: np.ndarray) -> np.ndarray:
        """Residual of the best fit of the tones at the bins ``k``: real parts, then imaginary ones."""
        return hann.residual(*self._in_record(tones), k, self.values, self.table)

    def amplitudes(self, tones: Tones) -> np.ndarray:
        """Complex amplitudes a of all tones, x = Re(a exp(i w t)), (m,), from one least-squares fit to the bins about them."""
        return hann.amplitudes(*self._in_record(tones), self.values, self.table)

    def without(self, tones: Tones, amplitudes: np.ndarray) -> HannSpectrum:
        """The spectrum less some tones, each subtracted from the bins where it is above rounding."""
        values = hann.without(*self._in_record(tones), np.asarray(amplitudes, complex), self.values, self.table)
        return replace(self, values=values)

    def floors(self, frequencies: np.ndarray) -> np.ndarray:
        """Median amplitude of bins 4 to 20 away from each of the ``frequencies``."""
        return hann.floors(frequencies * self.duration, self.values)

    def floor(self, frequency: float) -> float:
        """The noise floor about one frequency."""
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
        """Largest amplitude within so many bins of a frequency, at least of the two neighbouring bins."""
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


@dataclass(frozen=True)
class Joint:
    """Tones in a spectrum, fitted jointly, and the residual spectrum."""

    spectrum: HannSpectrum
    tones: Tones
    amplitudes: np.ndarray  # complex, at the first sample, (m,)
    rest: HannSpectrum

    @classmethod
    def of(cls, spectrum: HannSpectrum, tones: Tones) -> Joint:
        """Fit the amplitudes of all ``tones``, with their frequencies and decays as given."""
        amplitudes = spectrum.amplitudes(tones)
        return cls(spectrum, tones, amplitudes, spectrum.without(tones, amplitudes))

    def alone(self, i: int) -> Joint:
        """Tone ``i``, beside what all tones leave."""
        one = np.zeros(len(self.tones), dtype=bool)
        one[i] = True
        return replace(self, tones=self.tones.only(one), amplitudes=self.amplitudes[one])

    @property
    def sizes(self) -> np.ndarray:
        """Amplitudes, averaged over the record, (m,)."""
        return np.abs(self.amplitudes) * mean_of_decay(self.tones.decay * self.spectrum.duration)[0]

    def near(self, frequency: np.ndarray) -> np.ndarray:
        """Which tones (m,) have to be fitted together with tones at ``frequency`` (k,) [Hz]."""
        apart = np.abs(self.tones.frequency[:, None] - frequency[None, :]) * self.spectrum.duration
        return (apart < NEAR).any(axis=1)

    def with_tones(self, more: Tones) -> Joint:
        """A new fit with ``more`` tones, together with which the existing ones near them are fitted again."""
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
    """The tones with the frequencies and decays that minimise the residual, and the clock ratio.

    All free frequencies and decays move together, and with them the clock ``ratio`` if it is given, which all tones of the clock
    share. Only the bins of free tones and of those marked in ``telling`` (m,) count; by default those of all tones.
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


def uncertainties(joint: Joint, ratio: float | None = None) -> tuple[Uncertainty, float | None]:
    """Standard uncertainties of everything fitted, jointly: amplitudes, phases, frequencies and decays, and the clock ratio.

    With the columns X of the linearised least-squares fit, noise of covariance N gives the parameters the covariance
    (X X^T)^-1 X N X^T (X X^T)^-1 (``_sandwich``). The noise is taken as Gaussian; its size is the local floor of the residual
    spectrum, and neighbouring bins are correlated by the Hann window. Amplitudes of decaying tones are averages over the record.
    The uncertainty of the clock ratio is None without a ``ratio``.
    """
    tones, amplitudes, spectrum = joint.tones, joint.amplitudes, joint.spectrum
    m, duration = len(tones), spectrum.duration
    amplitude, phase, frequency, decay = (np.zeros(m) for _ in range(4))
    result = Uncertainty(amplitude, phase, frequency, decay)
    if m == 0:
        return result, None
    near = spectrum.near(tones.frequency)
    free, falls = (np.flatnonzero(some).tolist() for some in (tones.free, tones.falls))
    slopes = [_slope(joint, near, k, moves=(_NUDGE, 0.0)) for k in free]
    slopes += [_slope(joint, near, k, moves=(0.0, _NUDGE)) for k in falls]
    if ratio is not None:
        slopes.append(_ratio_slope(joint, near, ratio))
    columns = np.vstack([spectrum.equations(tones, near), *slopes])
    covariance = _sandwich(columns, near, _noise(joint, near))
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    ratio_spread = None if ratio is None else float(spread[-1])
    frequency[:] = [(ratio_spread or 0.0) * line.frequency for line in tones.lines]
    first = 2 * m + 1
    frequency[free] = spread[first : first + len(free)] / duration
    place = first + len(free) + np.arange(len(falls))
    decay[falls] = spread[place] / duration
    mean, slope = mean_of_decay(tones.decay * duration)
    size, angle, each = np.abs(amplitudes), np.angle(amplitudes), np.arange(m)
    along, across = np.zeros((2, m, covariance.shape[0]))
    across[each, 2 * each], across[each, 2 * each + 1] = -np.sin(angle), np.cos(angle)
    along[each, 2 * each], along[each, 2 * each + 1] = mean * np.cos(angle), mean * np.sin(angle)
    along[falls, place] = size[falls] * slope[falls]
    amplitude[:] = _spread(along, covariance)
    phase[:] = np.divide(_spread(across, covariance), size, out=np.full(m, np.inf), where=size > 0.0)
    return result, ratio_spread


def _spread(directions: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard uncertainty along each of the ``directions`` (m, p), (m,)."""
    return np.sqrt(np.maximum(np.sum((directions @ covariance) * directions, axis=1), 0.0))


def _stack(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def _slope(joint: Joint, near: np.ndarray, k: int, moves: tuple[float, float]) -> np.ndarray:
    """Change of the model at the bins ``near`` with frequency or decay of tone ``k``, in cycles or e-foldings."""
    duration, a, table = joint.spectrum.duration, joint.amplitudes[k], joint.spectrum.table
    cycles, decay = joint.tones.frequency[k] * duration, joint.tones.decay[k] * duration
    base = hann.tone(cycles, decay, a, near, table)
    moved = hann.tone(cycles + moves[0], decay + moves[1], a, near, table)
    return _stack(moved - base) / sum(moves)


def _ratio_slope(joint: Joint, near: np.ndarray, ratio: float) -> np.ndarray:
    """Change of the model with the clock ratio, which moves all lines of the clock together."""
    tones, spectrum = joint.tones, joint.spectrum
    each = zip(tones.lines, joint.amplitudes, tones.clock, strict=True)
    clock = [(line.frequency * spectrum.duration, a) for line, a, own in each if own]
    nudge = _NUDGE / max((cycles for cycles, _ in clock), default=1.0)
    total = np.zeros(near.size, dtype=complex)
    for cycles, a in clock:
        total += hann.tone(cycles * (ratio + nudge), 0.0, a, near, spectrum.table)
        total -= hann.tone(cycles * ratio, 0.0, a, near, spectrum.table)
    return _stack(total) / nudge


def _noise(joint: Joint, near: np.ndarray) -> np.ndarray:
    """RMS of real and imaginary part of the noise at each bin of ``near``, from the residual about the closest tone.

    That is the floor. Where the residual in the bins of the tone itself is larger than noise, the tone does not explain
    everything there, and the rest counts as noise.
    """
    floors, left = _floors(joint)
    centres = joint.tones.frequency * joint.spectrum.duration
    closest = np.argmin(np.abs(near[:, None] - centres[None, :]), axis=1)
    noise = np.sqrt((_FEW * floors) ** 2 + _HIDES**2 * np.maximum(left**2 - (_USUAL * floors) ** 2, 0.0))
    return noise[closest]


def disturbed(joint: Joint) -> np.ndarray:
    """Which tones (m,) do not explain their bins, or change within the record: the residual there is larger than noise."""
    floors, left = _floors(joint)
    return left > _USUAL * floors


def _floors(joint: Joint) -> tuple[np.ndarray, np.ndarray]:
    """RMS of real and imaginary part of the noise about each tone, and of the residual in its own bins, (m,) each."""
    # median of a Rayleigh distribution is sqrt(2 ln 2) times the RMS of one of its parts
    rest, frequency = joint.rest, joint.tones.frequency
    floors = rest.floors(frequency) / np.sqrt(2.0 * np.log(2.0))
    return floors, hann.bin_rms(frequency * rest.duration, rest.values) / np.sqrt(2.0)


def _sandwich(columns: np.ndarray, near: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance of the least-squares solution with ``columns`` (p, 2 n), for noise that the Hann window correlates."""
    scale = np.sqrt(np.einsum("ij,ij->i", columns, columns))
    scale[scale == 0.0] = 1.0
    scaled = columns / scale[:, None]
    inverse = np.linalg.pinv(scaled @ scaled.T, rcond=1e-12, hermitian=True) / scale[:, None]
    return inverse @ (scaled @ hann.correlated(scaled, near, noise).T) @ inverse.T
