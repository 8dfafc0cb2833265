"""Tones in noise: steady ones that keep their ratios, decaying ones, and how well they are known.

Everything happens on one Hann-windowed spectrum, in which a steady or decaying tone has a closed form that falls off fast,
and every fit is a least-squares fit to the bins about the tones.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.spectrum import window_values

REACH = 6
"""Bins on each side of a line that its fit uses."""
MOST_FOR_CLOCK = 12
"""Lines, the strongest, that the clock ratio is estimated from."""
FAR = 400
"""Bins on each side from which a known tone is taken out; beyond, a Hann window leaves 1e-8 of it."""
DETECTION = 6.0
"""A line is seen when it stands this many times above the floor about it."""


@dataclass(frozen=True)
class Tone:
    """A tone a exp((2 pi i frequency - decay) t): its line, frequency [Hz], decay rate [1/s], and whether it was seen."""

    line: ExpectedLine
    frequency: float
    decay: float
    seen: bool = True
    limited: bool = False
    """The fit ended at the end of the band or of the decay rates that it may take."""


@dataclass(frozen=True)
class Uncertainty:
    """Standard uncertainties of fitted tones, from the local floor of the spectrum; each (m,) but the ratio's."""

    amplitude: np.ndarray
    phase: np.ndarray
    frequency: np.ndarray
    decay: np.ndarray
    clock_ratio: float


class HannSpectrum:
    """Hann-windowed spectrum with interpolation between bins and a local floor."""

    def __init__(self, x: np.ndarray, sample_rate: float) -> None:
        self._set(np.fft.rfft(x * _hann(x.size)) * (2.0 / x.size), x.size, sample_rate)

    def _set(self, values: np.ndarray, samples: int, sample_rate: float) -> None:
        self.samples = samples
        self.sample_rate = sample_rate
        self.values = values
        self.magnitude = np.abs(values)

    def shapes(self, tone: Tone, k: np.ndarray) -> np.ndarray:
        """Spectra at the bins ``k`` of the tone's cosine and minus sine, (m, 2) complex."""
        duration = self.samples / self.sample_rate
        plus = _damped_hann(tone.frequency * duration, tone.decay * duration, k, self.samples)
        minus = _damped_hann(-tone.frequency * duration, tone.decay * duration, k, self.samples)
        return np.column_stack([plus + minus, 1j * (plus - minus)])

    def near(self, frequencies: Sequence[float]) -> np.ndarray:
        """Bins within reach of any of the ``frequencies``."""
        centres = np.array([round(self.bins(f)) for f in frequencies])
        bins: np.ndarray = np.unique(centres[:, None] + np.arange(-REACH, REACH + 1))
        inside: np.ndarray = bins[(bins >= 0) & (bins < self.values.size)]
        return inside

    def equations(self, tones: Sequence[Tone], k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Real least-squares equations at the bins ``k``: cosine and minus sine of each tone, and a constant."""
        constant = _damped_hann(0.0, 0.0, k, self.samples)[:, None]
        shapes = np.hstack([*(self.shapes(tone, k) for tone in tones), constant])
        values = self.values[k]
        return np.vstack([shapes.real, shapes.imag]), np.concatenate([values.real, values.imag])

    def without(self, tones: Sequence[Tone], amplitudes: np.ndarray) -> HannSpectrum:
        """The spectrum with some tones taken out, each from the bins where it stands out of rounding."""
        values = self.values.copy()
        for tone, a in zip(tones, amplitudes, strict=True):
            centre = round(self.bins(tone.frequency))
            band = np.arange(max(centre - FAR, 0), min(centre + FAR + 1, values.size))
            values[band] -= self.shapes(tone, band) @ np.array([a.real, a.imag])
        rest = copy(self)
        rest._set(values, self.samples, self.sample_rate)
        return rest

    def bins(self, frequency: float) -> float:
        """Frequency in bins."""
        return frequency * self.samples / self.sample_rate

    def floor(self, frequency: float) -> float:
        """Median amplitude of bins 4 to 20 away from ``frequency``."""
        centre = round(self.bins(frequency))
        left = self.magnitude[max(centre - 20, 1) : max(centre - 3, 1)]
        right = self.magnitude[centre + 4 : centre + 21]
        about = np.concatenate([left, right])
        return float(np.median(about)) if about.size else 0.0

    def peak(self, low: float, high: float, margin: float = 1.5) -> tuple[float, float]:
        """Frequency [Hz] and amplitude of the highest peak from ``low`` to ``high``, a few bins of margin allowed."""
        first = max(int(np.floor(self.bins(low) - margin)), 1)
        last = min(int(np.ceil(self.bins(high) + margin)), self.magnitude.size - 2)
        k = first + int(np.argmax(self.magnitude[first : last + 1])) if last >= first else first
        k = min(max(k, 1), self.magnitude.size - 2)
        left, centre, right = self.magnitude[k - 1 : k + 2]
        side, neighbour = (1.0, right) if right >= left else (-1.0, left)
        ratio = neighbour / centre if centre > 0.0 else 0.0
        offset = side * (2.0 * ratio - 1.0) / (ratio + 1.0)
        return (k + offset) * self.sample_rate / self.samples, float(centre)


@lru_cache(maxsize=2)
def _hann(samples: int) -> np.ndarray:
    """The window, kept: many records of one length come in a row."""
    window = window_values("hann", samples)
    window.flags.writeable = False
    return window


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
    near = spectrum.near([line.frequency * start for line in lines])

    def residual(ratio: float) -> np.ndarray:
        tones = [Tone(line, line.frequency * ratio, 0.0) for line in lines]
        A, b = spectrum.equations(tones, near)
        rest: np.ndarray = b - A @ _least_squares(A, b)
        return rest

    ratio, bin_ratio = start, 1.0 / max(spectrum.bins(line.frequency) for line in lines)
    r = residual(ratio)
    for _ in range(12):
        slope = (residual(ratio + 1e-4 * bin_ratio) - r) / (1e-4 * bin_ratio)
        move = float(np.clip(-(slope @ r) / max(float(slope @ slope), 1e-300), -0.2 * bin_ratio, 0.2 * bin_ratio))
        r_new = residual(ratio + move)
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


def estimate_amplitudes(tones: Sequence[Tone], spectrum: HannSpectrum) -> np.ndarray:
    """Complex amplitudes a of all tones together, x = Re(a exp(i w t)), (m,); least squares over the bins about them."""
    if not tones:
        return np.zeros(0, dtype=complex)
    solution = _least_squares(*spectrum.equations(tones, spectrum.near([tone.frequency for tone in tones])))
    result: np.ndarray = solution[0:-1:2] + 1j * solution[1:-1:2]
    return result


def _least_squares(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least squares by scaled normal equations: tones that can be told apart are well conditioned, and SVD is slow."""
    scale = _column_norms(A)
    scaled = A / scale
    solution: np.ndarray = np.linalg.lstsq(scaled.T @ scaled, scaled.T @ b, rcond=1e-12)[0] / scale
    return solution


def _column_norms(A: np.ndarray) -> np.ndarray:
    norms: np.ndarray = np.sqrt(np.einsum("ij,ij->j", A, A))
    norms[norms == 0.0] = 1.0
    return norms


def fit_modes(modes: Sequence[ExpectedLine], spectrum: HannSpectrum) -> list[Tone]:
    """Frequency and decay of each array mode, the strongest first, each taken out before the next is looked at."""
    order = sorted(modes, key=lambda line: -spectrum.peak(line.low, line.high)[1])
    tones = {}
    for line in order:
        frequency, amplitude = spectrum.peak(line.low, line.high)
        if amplitude < DETECTION * spectrum.floor(line.frequency):
            tones[line.name] = Tone(line, line.frequency, 0.0, seen=False)
            continue
        tone = _fit_decay(line, frequency, spectrum)
        tones[line.name] = tone
        spectrum = spectrum.without([tone], estimate_amplitudes([tone], spectrum))
    return [tones[line.name] for line in modes]


def _fit_decay(line: ExpectedLine, frequency: float, spectrum: HannSpectrum) -> Tone:
    """Damped tone that fits the bins about a peak: damped Gauss-Newton over frequency and decay, amplitude eliminated."""
    duration = spectrum.samples / spectrum.sample_rate
    band = spectrum.near([frequency])

    def residual(u: np.ndarray) -> np.ndarray:
        A, b = spectrum.equations([Tone(line, u[0] / duration, u[1] / duration)], band)
        rest: np.ndarray = b - A @ _least_squares(A, b)
        return rest

    # in bins, and in e-foldings over the record
    u = np.array([frequency * duration, 0.3])
    lowest = np.array([max(line.low * duration - 2.0, 0.5), -8.0])
    highest = np.array([line.high * duration + 2.0, 60.0])
    u = np.clip(u, lowest, highest)
    r, damping, nudge = residual(u), 1e-3, 1e-4
    for _ in range(60):
        slope = np.column_stack([(residual(u + nudge * unit) - r) / nudge for unit in np.eye(2)])
        normal = slope.T @ slope
        move = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)) + 1e-300 * np.eye(2), slope.T @ r)
        reach = np.array([0.5, max(0.5, 0.3 * abs(u[1]))])
        candidate = np.clip(u + np.clip(move, -reach, reach), lowest, highest)
        r_new = residual(candidate)
        if r_new @ r_new > r @ r:
            damping *= 8.0
            if damping > 1e8:
                break
            continue
        converged = float(np.max(np.abs(candidate - u))) < 1e-9
        u, r, damping = candidate, r_new, max(0.2 * damping, 1e-12)
        if converged:
            break
    limited = bool(np.any(u <= lowest) or np.any(u >= highest))
    return Tone(line, float(u[0] / duration), float(u[1] / duration), limited=limited)


def _damped_hann(cycles: float, decay: float, k: np.ndarray, samples: int) -> np.ndarray:
    """Spectrum at the bins ``k`` of exp((2 pi i cycles - decay) n/N) under a Hann window, in closed form, scaled as a half tone.

    Three geometric series expm1(N z)/expm1(z), one bin apart: N z differs by whole turns between them and between bins, and
    the real part of z not at all, so that one sine and one cosine are left for each.
    """
    whole = np.rint(cycles)
    over = cycles - whole
    top = np.expm1(2j * np.pi * over - decay)
    growth, less = np.exp(-decay / samples), np.expm1(-decay / samples)
    turns = (whole - k + np.array([[0.0], [1.0], [-1.0]])) + over
    half = turns * (np.pi / samples)
    s, c = np.sin(half), np.cos(half)
    series = np.empty(half.shape, dtype=complex)
    series.real, series.imag = less - 2.0 * growth * s * s, 2.0 * growth * s * c
    with np.errstate(divide="ignore", invalid="ignore"):
        np.divide(top, series, out=series)
    if abs(decay) < 1e-15 * samples:
        series[np.abs(turns) < 1e-15 * samples] = samples
    result: np.ndarray = (0.5 * series[0] - 0.25 * (series[1] + series[2])) * (2.0 / samples)
    return result


def uncertainties(
    tones: Sequence[Tone], amplitudes: np.ndarray, ratio: float | None, spectrum: HannSpectrum, rest: HannSpectrum
) -> Uncertainty:
    """Standard uncertainties of all that was fitted, jointly: amplitudes, phases, clock ratio, frequency and decay of modes.

    Noise is taken as Gaussian, with the local floor of ``rest`` (the spectrum without the tones) as its size and the
    correlation between neighbouring bins that a Hann window makes. Amplitudes of decaying tones are their means over the
    record.
    """
    m = len(tones)
    if m == 0:
        none = np.zeros(0)
        return Uncertainty(none, none, none, none, float("nan"))
    duration = spectrum.samples / spectrum.sample_rate
    near = spectrum.near([tone.frequency for tone in tones])
    A, _ = spectrum.equations(tones, near)
    slopes = [_slope(tones, amplitudes, near, spectrum, k) for k in range(m) if _is_mode(tones[k])]
    extra = [column for pair in slopes for column in pair]
    if ratio is not None:
        extra.append(_ratio_slope(tones, amplitudes, ratio, near, spectrum))
    J = np.column_stack([A, *extra]) if extra else A
    covariance = _sandwich(J, near, _noise(tones, near, rest))
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))

    amplitude, phase, frequency, decay = (np.zeros(m) for _ in range(4))
    ratio_spread = float(spread[-1]) if ratio is not None else float("nan")
    column = A.shape[1]
    for k, tone in enumerate(tones):
        size, angle = abs(amplitudes[k]), float(np.angle(amplitudes[k]))
        along = np.zeros(J.shape[1])
        along[2 * k], along[2 * k + 1] = np.cos(angle), np.sin(angle)
        across = np.zeros(J.shape[1])
        across[2 * k], across[2 * k + 1] = -np.sin(angle), np.cos(angle)
        if _is_mode(tone):
            mean, slope = _mean_of_decay(tone.decay * duration)
            along *= mean
            along[column + 1] = size * slope * duration
            frequency[k], decay[k] = spread[column], spread[column + 1]
            column += 2
        elif ratio is not None:
            frequency[k] = ratio_spread * tone.line.frequency
        amplitude[k] = np.sqrt(max(float(along @ covariance @ along), 0.0))
        phase[k] = np.sqrt(max(float(across @ covariance @ across), 0.0)) / size if size > 0.0 else np.inf
    return Uncertainty(amplitude, phase, frequency, decay, ratio_spread)


def mean_over_record(tone: Tone, amplitude: complex, duration: float) -> float:
    """Mean amplitude of a tone over a record of ``duration`` [s] that starts at its amplitude."""
    return abs(amplitude) * _mean_of_decay(tone.decay * duration)[0]


def _mean_of_decay(fold: float) -> tuple[float, float]:
    """Mean of exp(-fold u) for u from 0 to 1, and its derivative by ``fold``."""
    if abs(fold) < 1e-4:
        return 1.0 - fold / 2.0, -0.5 + fold / 3.0
    mean = float(-np.expm1(-fold) / fold)
    return mean, float(np.exp(-fold)) / fold - mean / fold


def _is_mode(tone: Tone) -> bool:
    return tone.seen and tone.line.kind == "array mode"


def _stack(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def _slope(
    tones: Sequence[Tone], amplitudes: np.ndarray, near: np.ndarray, spectrum: HannSpectrum, k: int
) -> tuple[np.ndarray, np.ndarray]:
    """Change of the model at the bins ``near`` with frequency and with decay of tone ``k``."""
    a = np.array([amplitudes[k].real, amplitudes[k].imag])
    nudge = 1e-4 * spectrum.sample_rate / spectrum.samples
    base = spectrum.shapes(tones[k], near) @ a
    higher = spectrum.shapes(replace(tones[k], frequency=tones[k].frequency + nudge), near) @ a
    faster = spectrum.shapes(replace(tones[k], decay=tones[k].decay + nudge), near) @ a
    return _stack(higher - base) / nudge, _stack(faster - base) / nudge


def _ratio_slope(
    tones: Sequence[Tone], amplitudes: np.ndarray, ratio: float, near: np.ndarray, spectrum: HannSpectrum
) -> np.ndarray:
    """Change of the model with the clock ratio, which moves all lines of the clock together."""
    clock = [(tone, a) for tone, a in zip(tones, amplitudes, strict=True) if tone.line.kind != "array mode"]
    nudge = 1e-4 / max(spectrum.bins(tone.line.frequency) for tone, _ in clock)
    total = np.zeros(near.size, dtype=complex)
    for tone, a in clock:
        moved = replace(tone, frequency=tone.line.frequency * (ratio + nudge))
        total += (spectrum.shapes(moved, near) - spectrum.shapes(tone, near)) @ np.array([a.real, a.imag])
    return _stack(total) / nudge


def _noise(tones: Sequence[Tone], near: np.ndarray, spectrum: HannSpectrum) -> np.ndarray:
    """RMS of real and imaginary part of the noise at each bin of ``near``, from the floor about the closest tone."""
    frequencies = np.array([tone.frequency for tone in tones])
    # median of a Rayleigh distribution is sqrt(2 ln 2) times the RMS of one of its parts
    floors = np.array([spectrum.floor(f) for f in frequencies]) / np.sqrt(2.0 * np.log(2.0))
    centres = frequencies * spectrum.samples / spectrum.sample_rate
    closest = np.argmin(np.abs(near[:, None] - centres[None, :]), axis=1)
    result: np.ndarray = floors[closest]
    return result


def _sandwich(J: np.ndarray, near: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance of the least-squares solution under noise that a Hann window has correlated from bin to bin."""
    scale = _column_norms(J)
    scaled = J / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True) @ scaled.T
    m = near.size
    correlated = np.zeros((inverse.shape[0], inverse.shape[0]))
    for lag, correlation in ((0, 1.0), (1, -2.0 / 3.0), (2, 1.0 / 6.0)):
        first = np.flatnonzero(np.isin(near + lag, near))
        second = np.searchsorted(near, near[first] + lag)
        for offset in (0, m):
            left = inverse[:, offset + first] * noise[first]
            right = inverse[:, offset + second] * noise[second]
            product = correlation * left @ right.T
            correlated += product if lag == 0 else product + product.T
    result: np.ndarray = correlated / np.outer(scale, scale)
    return result
