"""Spectra, one-sided, each with what it was made by: amplitude, density, cumulative, waterfall,
bands.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Literal, get_args

import numpy as np

from microvib.errors import MicrovibError, quoted_value
from microvib.units import GivenQuantity, Si, quantity

Window = Literal["rectangular", "hann", "flat-top"]
Average = Literal["none", "linear", "peak-hold", "exponential"]
"""How amplitude spectra of successive stretches become one."""

# Terms of the cosine sums; flat-top as in ISO 18431-2, whose scallop loss is 0.01 dB.
_COSINES: dict[str, tuple[float, ...]] = {
    "rectangular": (1.0,),
    "hann": (1.0, -1.0),
    "flat-top": (1.0, -1.933, 1.286, -0.388, 0.0322),
}


_FARTHEST_LEAKAGE = 4000.0
"""Distance [bins] from which leakage is no less."""


def window_name(window: Window) -> str:
    """A window in words."""
    return f"{window.replace('hann', 'Hann')} window"


def noise_bandwidth(window: Window) -> float:
    """Equivalent noise bandwidth of a window, in bins: 1 of a rectangular one, 1.5 of a Hann window."""
    return 1.0 + 0.5 * sum(a * a for a in _COSINES[window][1:])


class SpectrumError(MicrovibError):
    """A spectrum that cannot be had from these samples; says which setting, and what is allowed."""


@dataclass(frozen=True, repr=False)
class _Estimate:
    """Estimate in bins of frequency."""

    frequency: np.ndarray
    """Bins [Hz], (m,)."""
    window: Window
    segment: int
    """Samples that are transformed at a time."""
    sample_rate: float
    """Samples per second [Hz]."""
    averages: int = field(default=1, kw_only=True)
    overlap: float = field(default=0.0, kw_only=True)
    """Part of a segment that the next one shares."""
    unit: str = field(default="N*m", kw_only=True)
    """Unit of the signal."""

    @property
    def resolution(self) -> float:
        """Distance of the bins [Hz]."""
        return self.sample_rate / self.segment

    def __repr__(self) -> str:
        return str(self)

    def _made(self) -> str:
        if self.overlap:
            overlapping = f", overlap {100 * self.overlap:g} %"
        else:
            overlapping = ""
        if self.averages > 1:
            averaging = f"{self.averages} averages"
        else:
            averaging = "no averaging"
        return (
            f"{window_name(self.window)}, {self.segment} samples at {self.sample_rate:g} Hz,"
            f" {1.0 / self.resolution:g} s,"
            f" resolution {self.resolution:g} Hz, noise bandwidth"
            f" {noise_bandwidth(self.window) * self.resolution:.4g} Hz, {averaging}{overlapping}"
        )


@dataclass(frozen=True, repr=False)
class Spectrum(_Estimate):
    """One-sided amplitude spectrum: a tone on a bin reads its amplitude, zero to peak."""

    amplitude: np.ndarray
    """Amplitudes in the unit of the signal, (m,)."""
    average: str = field(default="", kw_only=True)
    """How the stretches became one, in words; empty where there is but one."""

    @property
    def samples(self) -> int:
        """Samples of the signal."""
        return self.segment

    def __str__(self) -> str:
        kind = f"amplitude spectrum, one-sided, 0-to-peak; {self._made()}"
        return f"{kind}; {self.average}" if self.average else kind


@dataclass(frozen=True, repr=False)
class Density(_Estimate):
    """One-sided power spectral density (Welch): its integral over frequency is the mean square."""

    density: np.ndarray
    """Unit of the signal squared per Hz, (m,)."""

    @property
    def cumulative_rms(self) -> np.ndarray:
        """RMS of all that lies up to each bin, (m,): the root of the integral of the density from 0
        Hz.
        """
        return np.sqrt(np.cumsum(self.density) * self.resolution)

    def band_rms(self, low: GivenQuantity, high: GivenQuantity) -> float:
        """RMS between two frequencies; a bin that is cut counts with its part. SpectrumError if low
        is not below high.
        """
        low, high = quantity("low", low, "Hz"), quantity("high", high, "Hz")
        if not 0.0 <= low < high:
            raise SpectrumError(
                f"band {low:g} to {high:g} Hz: its lower end must be at least 0 Hz and below its"
                " upper end"
            )
        edges = np.concatenate([[0.0], self.frequency + 0.5 * self.resolution])
        square = np.concatenate([[0.0], np.cumsum(self.density) * self.resolution])
        below, above = np.interp([low, high], edges, square)
        return float(np.sqrt(above - below))

    def third_octaves(self) -> tuple[np.ndarray, np.ndarray]:
        """Centre frequencies [Hz] and RMS of the 1/3-octave bands (base ten, IEC 61260-1) that the
        resolution can tell apart.

        A band counts from two bins wide up to half the sample rate.
        """
        first = int(np.ceil(10.0 * np.log10(2.0 * self.resolution / (10**0.05 - 10**-0.05))))
        last = int(np.floor(10.0 * np.log10(0.5 * self.sample_rate / 10**0.05)))
        centre = 10.0 ** (np.arange(first, last + 1) / 10.0)
        return centre, np.array(
            [self.band_rms(Si(f * 10**-0.05), Si(f * 10**0.05)) for f in centre]
        )

    def less(self, background: Density) -> Density:
        """The density that is not in ``background``: powers subtracted, at least 0; for a
        background that is independent.
        """
        if (
            background.frequency.shape != self.frequency.shape
            or background.sample_rate != self.sample_rate
        ):
            raise SpectrumError(
                "the background spectrum must have the same sample rate and segment length as the"
                " recording"
            )
        return replace(self, density=np.maximum(self.density - background.density, 0.0))

    def __str__(self) -> str:
        return f"power spectral density (Welch), one-sided; {self._made()}"


@dataclass(frozen=True, repr=False)
class Waterfall(_Estimate):
    """Amplitude spectra, one-sided and zero-to-peak, of successive stretches."""

    time: np.ndarray
    """Middles of the stretches from the first sample [s], (t,)."""
    amplitude: np.ndarray
    """Amplitudes in the unit of the signal, (t, m)."""

    def __str__(self) -> str:
        return f"waterfall of {self.time.size} amplitude spectra, one-sided, 0-to-peak; each {self._made()}"


def window_values(name: Window, samples: int) -> np.ndarray:
    """Window of ``samples`` points (periodic), (n,), of mean 1 but for rounding."""
    if not isinstance(name, str) or name not in _COSINES:
        raise SpectrumError(
            f"window: {quoted_value(name)} is not known; allowed are {', '.join(get_args(Window))}"
        )
    phase = 2.0 * np.pi * np.arange(samples) / samples
    return sum(
        (a * np.cos(k * phase) for k, a in enumerate(_COSINES[name])), start=np.zeros(samples)
    )


def leakage(window: Window, distance: np.ndarray) -> np.ndarray:
    """Largest power (...) that a line has in a bin at a ``distance`` (...) [bins], or farther away from it, over
    what it has in all bins together: the envelope of the window's side lobes; 1 in its main lobe.

    The transform of a window of cosines, at half bins from its bins.
    """
    of_window = _COSINES[window]
    at = np.arange(len(of_window) + 0.5, _FARTHEST_LEAKAGE)
    parts = (0.5 * a * (1.0 / (at - k) + 1.0 / (at + k)) for k, a in enumerate(of_window))
    amplitude = np.abs(sum(parts, start=np.zeros(at.size))) / np.pi
    power = np.maximum.accumulate(amplitude[::-1])[::-1] ** 2 / noise_bandwidth(window)
    return np.interp(distance, np.r_[at[0] - 0.5, at], np.r_[1.0, power])


_SHAPE_POINTS, _SHAPE_PARTS = 256, 32
"""Instants of a spectrum, and parts of a bin, at which the shape of a line is known."""


@dataclass(frozen=True)
class LineShape:
    """Shape of a line in a spectrum: its power in a bin over what it has in all bins together."""

    distance: np.ndarray
    """Ascending distances from the line's mean frequency [bins], (n,)."""
    part: np.ndarray
    """Part of its power in a bin there, (n,)."""

    def __call__(self, distance: np.ndarray) -> np.ndarray:
        """Interpolate at some distances (...) [bins]; far away 0."""
        return np.interp(distance, self.distance, self.part, left=0.0, right=0.0)


def line_shape(window: Window, smear: float = 0.0, growth: float = 0.0) -> LineShape:
    """Find the shape of a line that moves evenly by ``smear`` [bins] during its spectrum, to a tenth of a bin.

    Its frequency grows by a part ``growth`` meanwhile, and its amplitude with the square of that.
    """
    return _line_shape(window, round(smear, 1), round(growth, 3))


@cache
def _line_shape(window: Window, smear: float, growth: float) -> LineShape:
    u = (np.arange(_SHAPE_POINTS) + 0.5) / _SHAPE_POINTS - 0.5
    weight = (
        sum(a * np.cos(2.0 * np.pi * k * (u + 0.5)) for k, a in enumerate(_COSINES[window]))
        * (1.0 + growth * u) ** 2
    )
    square = np.sum(weight**2)
    moving = weight * np.exp(1j * np.pi * smear * u**2)
    part = np.abs(np.fft.fft(moving, _SHAPE_POINTS * _SHAPE_PARTS)) ** 2 / (_SHAPE_POINTS * square)
    distance = (
        np.fft.fftfreq(part.size, 1.0 / _SHAPE_POINTS) - smear * float(weight**2 @ u) / square
    )
    return LineShape(np.fft.fftshift(distance), np.fft.fftshift(part))


def amplitude_spectrum(
    x: np.ndarray, sample_rate: float, window: Window = "rectangular"
) -> Spectrum:
    """Amplitude spectrum of the mean-free signal ``x`` (n,); 2 |X| / sum of the window."""
    w = window_values(window, x.size)
    X = np.fft.rfft((x - x.mean()) * w)
    return Spectrum(
        np.arange(X.size) * sample_rate / x.size,
        window,
        x.size,
        sample_rate,
        2.0 * np.abs(X) / w.sum(),
    )


def averaged_spectrum(
    x: np.ndarray,
    sample_rate: float,
    average: Average,
    resolution: GivenQuantity | None = None,
    window: Window = "hann",
    overlap: float = 0.5,
) -> Spectrum:
    """One amplitude spectrum of stretches of ``x`` (n,), each ``1 / resolution`` long.

    *linear*: root of the mean square of each bin, all stretches alike; *peak-hold*: the largest of
    each bin; *exponential*: mean squares in which a stretch counts half as much as one that comes
    an eighth of the record later. *none* is the spectrum of all samples at once. SpectrumError for
    what is none of them.
    """
    if average not in get_args(Average):
        raise SpectrumError(
            f"average: {quoted_value(average)} is not known; allowed are"
            f" {', '.join(get_args(Average))}"
        )
    if average == "none":
        return amplitude_spectrum(x, sample_rate, window)
    each = waterfall(x, sample_rate, resolution, window, overlap)
    if average == "peak-hold":
        amplitude, words = np.max(each.amplitude, axis=0), "peak hold"
    elif average == "linear":
        amplitude = np.sqrt(np.mean(each.amplitude**2, axis=0))
        words = "linear average (root mean square)"
    else:
        half = x.size / sample_rate / 8.0
        weight = 0.5 ** ((each.time[-1] - each.time) / half)
        amplitude = np.sqrt(weight @ each.amplitude**2 / weight.sum())
        words = f"exponential average, half as much weight {half:.4g} s earlier"
    return Spectrum(
        each.frequency,
        window,
        each.segment,
        sample_rate,
        amplitude,
        averages=each.time.size,
        overlap=each.overlap,
        average=words,
    )


def power_spectral_density(
    x: np.ndarray,
    sample_rate: float,
    resolution: GivenQuantity | None = None,
    window: Window = "hann",
    overlap: float = 0.5,
) -> Density:
    """Power spectral density of ``x`` (n,) by Welch's method: segments that ``overlap``, by half of
    each where nothing else is asked for, the mean of each taken out.

    ``resolution`` is the distance of the bins; without it an eighth of the record makes a segment.
    SpectrumError where the record is too short for it.
    """
    from scipy.signal import welch

    segment = _segment(x.size, sample_rate, resolution)
    lap = _lap(segment, overlap)
    frequency, density = welch(
        x,
        sample_rate,
        window_values(window, segment),
        segment,
        lap,
        detrend="constant",
        scaling="density",
    )
    averages = 1 + (x.size - segment) // (segment - lap)
    return Density(
        frequency, window, segment, sample_rate, density, averages=averages, overlap=lap / segment
    )


def waterfall(
    x: np.ndarray,
    sample_rate: float,
    resolution: GivenQuantity | None = None,
    window: Window = "hann",
    overlap: float = 0.5,
) -> Waterfall:
    """Amplitude spectra of stretches of ``x`` (n,) that ``overlap``, each ``1 / resolution`` long and
    free of its mean.
    """
    segment = _segment(x.size, sample_rate, resolution)
    lap = _lap(segment, overlap)
    starts = np.arange(0, x.size - segment + 1, segment - lap)
    spectra = [amplitude_spectrum(x[k : k + segment], sample_rate, window) for k in starts]
    middle = (starts + 0.5 * segment) / sample_rate
    amplitude = np.array([s.amplitude for s in spectra])
    return Waterfall(
        spectra[0].frequency, window, segment, sample_rate, middle, amplitude, overlap=lap / segment
    )


def _lap(segment: int, overlap: float) -> int:
    """Samples that a stretch shares with the next one; SpectrumError for an overlap that is none."""
    if not 0.0 <= overlap <= 0.95:
        raise SpectrumError(f"overlap: {overlap:g} is not allowed; from 0 to 0.95")
    return int(segment * overlap)


def _segment(samples: int, sample_rate: float, given: GivenQuantity | None) -> int:
    if given is None:
        return max(samples // 8, min(samples, 8))
    resolution = quantity("resolution", given, "Hz")
    if not 0.0 < resolution <= sample_rate / 8:
        raise SpectrumError(
            f"resolution: {resolution:g} Hz is not allowed; it must be greater than 0 and at most"
            f" {sample_rate / 8:g} Hz"
        )
    segment = round(sample_rate / resolution)
    if segment > samples:
        raise SpectrumError(
            f"resolution: {resolution:g} Hz needs a record of {1 / resolution:.4g} s; it has"
            f" {samples / sample_rate:.4g} s"
        )
    return segment


def complex_tone(x: np.ndarray, sample_rate: float, frequency: float) -> np.ndarray:
    """Complex amplitudes, shape (...), of ``x`` (..., n) at one frequency [Hz], for tones apart
    from others.

    Hann-windowed, so that it does not matter where the bins fall; phases are those of cosines at
    the first sample.
    """
    n = x.shape[-1]
    w = window_values("hann", n)
    turning = w * np.exp(-2j * np.pi * frequency / sample_rate * np.arange(n))
    return (x - x.mean(axis=-1, keepdims=True)) @ turning * (2.0 / w.sum())


def tone_amplitude(x: np.ndarray, sample_rate: float, frequency: float) -> float:
    """Magnitude of ``complex_tone`` of one signal ``x`` (n,)."""
    return float(abs(complex_tone(x, sample_rate, frequency)))
