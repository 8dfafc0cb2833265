"""Amplitude, frequency and phase of expected lines, wherever the bins fall.

Everything happens on one Hann-windowed spectrum, in which a steady or decaying tone has a closed form that falls off fast:

* lines of the step clock keep exact ratios to each other, so one clock ratio is estimated from all of them together, each
  weighted with what it tells;
* an array mode rings down while it is recorded, so it is fitted as a decaying tone;
* all amplitudes then come from one least-squares fit to the bins about the lines, in which every line is present.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.spectrum import window_values

SEPARATION = 2.5
"""Bins that two lines must be apart to be told apart."""
REACH = 6
"""Bins on each side of a line that its fit uses."""
FAR = 400
"""Bins on each side from which a known tone is taken out; beyond, a Hann window leaves 1e-8 of it."""
_DETECTION = 6.0
"""A line is seen when it stands this many times above the floor about it."""


@dataclass(frozen=True)
class Line:
    """One line of a torque; amplitudes in N m, 0-to-peak."""

    line: str
    kind: str
    origin: str
    expected_hz: float
    frequency_hz: float
    amplitude_n_m: float
    """Amplitude; of a decaying tone its mean over the record."""
    phase_rad: float
    """Phase of the cosine at the first sample."""
    bin_frequency_hz: float
    bin_amplitude_n_m: float
    """The paper's figure: rectangular window, nearest bin."""
    floor_n_m: float
    """Median amplitude of the bins about the line."""
    decay_per_s: float
    """Decay rate sigma of the tone, exp(-sigma t); 0 for a line of the step clock."""
    status: str


@dataclass(frozen=True)
class LineTable:
    """All lines of one record, and how they were estimated."""

    lines: tuple[Line, ...]
    clock_ratio: float | None
    """Step clock found over step clock expected; None where no line of the clock is seen."""
    samples: int
    sample_rate: float

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(self.lines)

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, name: str) -> Line:
        for line in self.lines:
            if line.line == name:
                return line
        raise KeyError(f"no line '{name}'; there are {', '.join(line.line for line in self.lines)}")

    def __str__(self) -> str:
        return self.text()

    def text(self, shown_above: float = 0.0) -> str:
        """The table as text; lines below the fraction ``shown_above`` of the largest are only counted."""
        top = max((x.amplitude_n_m for x in self.lines if np.isfinite(x.amplitude_n_m)), default=0.0)
        shown = [x for x in self.lines if not x.amplitude_n_m < shown_above * top]
        rows = [f"{'line':18s} {'expected Hz':>12s} {'Hz':>12s} {'N m':>12s} {'bin Hz':>10s} {'bin N m':>12s}  status"]
        rows += [
            f"{x.line:18s} {x.expected_hz:12.5f} {x.frequency_hz:12.5f} {x.amplitude_n_m:12.4e} {x.bin_frequency_hz:10.4f}"
            f" {x.bin_amplitude_n_m:12.4e}  {x.status}"
            for x in shown
        ]
        if len(shown) < len(self.lines):
            rows.append(f"and {len(self.lines) - len(shown)} lines below {shown_above:g} of the largest, in lines.csv")
        return "\n".join(rows)


def estimate_lines(x: np.ndarray, sample_rate: float, expected: Sequence[ExpectedLine]) -> LineTable:
    """Estimate the ``expected`` lines in the samples ``x`` (n,) [N m] taken at ``sample_rate`` [Hz]."""
    x = np.asarray(x, dtype=float)
    duration = x.size / sample_rate
    x = x - x.mean()
    spectrum = _HannSpectrum(x, sample_rate)
    wanted, refused = _sort_out(expected, duration)
    clock = [line for line in wanted if line.kind != "array mode"]
    modes = [line for line in wanted if line.kind == "array mode"]

    ratio = _clock_ratio(clock, spectrum)
    tones = [_Tone(line, line.frequency * (ratio or 1.0), 0.0) for line in clock]
    if modes:
        tones += _fit_modes(modes, spectrum.without(tones, _amplitudes(tones, spectrum)))
    amplitudes = _amplitudes(tones, spectrum)
    bins = np.abs(np.fft.rfft(x)) * (2.0 / x.size)
    found = {
        tone.line.name: _result(tone, a, bins, spectrum, duration) for tone, a in zip(tones, amplitudes, strict=True)
    }
    for line, why in refused:
        found[line.name] = _not_estimated(line, why, bins, duration)
    return LineTable(tuple(found[line.name] for line in expected), ratio, x.size, sample_rate)


@dataclass(frozen=True)
class _Tone:
    line: ExpectedLine
    frequency: float
    decay: float
    seen: bool = True


def _sort_out(
    expected: Sequence[ExpectedLine], duration: float
) -> tuple[list[ExpectedLine], list[tuple[ExpectedLine, str]]]:
    """Lines that the record can resolve, and the others with the reason."""
    wanted: list[ExpectedLine] = []
    refused: list[tuple[ExpectedLine, str]] = []
    for line in expected:
        if line.frequency * duration < SEPARATION:
            refused.append((line, f"not resolved: needs a record of {SEPARATION / line.frequency:.3g} s"))
            continue
        near = next((other for other in wanted if abs(other.frequency - line.frequency) * duration < SEPARATION), None)
        if near is not None:
            needed = SEPARATION / max(abs(near.frequency - line.frequency), 1e-12)
            length = f"; a record of {needed:.3g} s could" if needed < 1e6 else ""
            refused.append((line, f"not separable from {near.name}{length}"))
        else:
            wanted.append(line)
    return wanted, refused


class _HannSpectrum:
    """Hann-windowed spectrum with interpolation between bins and a local floor."""

    def __init__(self, x: np.ndarray, sample_rate: float) -> None:
        self._set(np.fft.rfft(x * window_values("hann", x.size)) * (4.0 / x.size), x.size, sample_rate)

    def _set(self, values: np.ndarray, samples: int, sample_rate: float) -> None:
        self.samples = samples
        self.sample_rate = sample_rate
        self.values = values
        self.magnitude = np.abs(values)

    def shapes(self, tone: _Tone, k: np.ndarray) -> np.ndarray:
        """Spectra at the bins ``k`` of the tone's cosine and minus sine, (m, 2) complex."""
        duration = self.samples / self.sample_rate
        plus = _damped_hann(tone.frequency * duration, tone.decay * duration, k, self.samples)
        minus = _damped_hann(-tone.frequency * duration, tone.decay * duration, k, self.samples)
        return np.column_stack([plus + minus, 1j * (plus - minus)])

    def without(self, tones: Sequence[_Tone], amplitudes: np.ndarray) -> _HannSpectrum:
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


def _clock_ratio(clock: Sequence[ExpectedLine], spectrum: _HannSpectrum) -> float | None:
    """Clock ratio from all lines of the clock that stand out, weighted by their information."""
    weights, ratios = [], []
    for line in clock:
        frequency, amplitude = spectrum.peak(line.low, line.high)
        floor = spectrum.floor(line.frequency)
        if amplitude > _DETECTION * max(floor, 1e-300):
            ratios.append(frequency / line.frequency)
            weights.append((line.frequency * amplitude / max(floor, 1e-12 * amplitude)) ** 2)
    if not ratios:
        return None
    return float(np.average(ratios, weights=weights))


def _amplitudes(tones: Sequence[_Tone], spectrum: _HannSpectrum) -> np.ndarray:
    """Complex amplitudes a of all tones together, x = Re(a exp(i w t)), (m,); least squares over the bins about them."""
    if not tones:
        return np.zeros(0, dtype=complex)
    centres = np.array([round(spectrum.bins(tone.frequency)) for tone in tones])
    near = np.unique(centres[:, None] + np.arange(-REACH, REACH + 1))
    near = near[(near >= 0) & (near < spectrum.values.size)]
    shapes = np.hstack([spectrum.shapes(tone, near) for tone in tones])
    A = np.vstack([shapes.real, shapes.imag])
    b = np.concatenate([spectrum.values[near].real, spectrum.values[near].imag])
    solution = np.linalg.lstsq(A, b, rcond=1e-12)[0]
    result: np.ndarray = solution[0::2] + 1j * solution[1::2]
    return result


def _fit_modes(modes: Sequence[ExpectedLine], spectrum: _HannSpectrum) -> list[_Tone]:
    """Frequency and decay of each array mode, the strongest first, each taken out before the next is looked at."""
    order = sorted(modes, key=lambda line: -spectrum.peak(line.low, line.high)[1])
    tones = {}
    for line in order:
        frequency, amplitude = spectrum.peak(line.low, line.high)
        if amplitude < _DETECTION * spectrum.floor(line.frequency):
            tones[line.name] = _Tone(line, line.frequency, 0.0, seen=False)
            continue
        tone = _fit_decay(line, frequency, spectrum)
        tones[line.name] = tone
        spectrum = spectrum.without([tone], _amplitudes([tone], spectrum))
    return [tones[line.name] for line in modes]


def _fit_decay(line: ExpectedLine, frequency: float, spectrum: _HannSpectrum) -> _Tone:
    """Damped tone that fits the bins about a peak: damped Gauss-Newton over frequency and decay, amplitude eliminated."""
    duration = spectrum.samples / spectrum.sample_rate
    centre = round(spectrum.bins(frequency))
    band = np.arange(max(centre - REACH, 0), min(centre + REACH + 1, spectrum.values.size))
    b = np.concatenate([spectrum.values[band].real, spectrum.values[band].imag])

    def residual(u: np.ndarray) -> np.ndarray:
        shapes = spectrum.shapes(_Tone(line, u[0] / duration, u[1] / duration), band)
        A = np.vstack([shapes.real, shapes.imag])
        rest: np.ndarray = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
        return rest

    u = np.array([frequency * duration, 0.3])  # in bins, and in e-foldings over the record
    r, damping, nudge = residual(u), 1e-3, 1e-4
    for _ in range(60):
        slope = np.column_stack([(residual(u + nudge * unit) - r) / nudge for unit in np.eye(2)])
        normal = slope.T @ slope
        move = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)) + 1e-300 * np.eye(2), slope.T @ r)
        candidate = u + np.clip(move, -0.5, 0.5)
        candidate[1] = np.clip(candidate[1], -2.0, 60.0)
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
    return _Tone(line, float(u[0] / duration), float(u[1] / duration))


def _damped_hann(cycles: float, decay: float, k: np.ndarray, samples: int) -> np.ndarray:
    """Spectrum at the bins ``k`` of exp((2 pi i cycles - decay) n/N) under a Hann window, in closed form, scaled as a half tone."""

    def series(shift: float) -> np.ndarray:
        z = (2j * np.pi * (cycles + shift - k) - decay) / samples
        with np.errstate(divide="ignore", invalid="ignore"):
            total = np.expm1(z * samples) / np.expm1(z)
        return np.where(np.abs(z) < 1e-15, samples, total)

    result: np.ndarray = (0.5 * series(0.0) - 0.25 * series(1.0) - 0.25 * series(-1.0)) * (2.0 / samples)
    return result


def _result(tone: _Tone, amplitude: complex, bins: np.ndarray, spectrum: _HannSpectrum, duration: float) -> Line:
    fold = tone.decay * duration
    mean = -np.expm1(-fold) / fold if abs(fold) > 1e-9 else 1.0
    floor = spectrum.floor(tone.frequency)
    size = abs(amplitude) * float(mean)
    status = "ok"
    if not tone.seen or size < _DETECTION * floor:
        status = "below the floor" if size < _DETECTION * floor else "ok"
    elif abs(fold) > 0.1:
        status = "decaying" if fold > 0.0 else "growing"
    bin_frequency, bin_amplitude = _nearest_bin(bins, tone.frequency, duration)
    return Line(
        line=tone.line.name,
        kind=tone.line.kind,
        origin=tone.line.origin,
        expected_hz=float(tone.line.frequency),
        frequency_hz=float(tone.frequency),
        amplitude_n_m=size,
        phase_rad=float(np.angle(amplitude)),
        bin_frequency_hz=bin_frequency,
        bin_amplitude_n_m=bin_amplitude,
        floor_n_m=floor,
        decay_per_s=tone.decay,
        status=status,
    )


def _not_estimated(line: ExpectedLine, why: str, bins: np.ndarray, duration: float) -> Line:
    bin_frequency, bin_amplitude = _nearest_bin(bins, line.frequency, duration)
    nan = float("nan")
    return Line(
        line.name, line.kind, line.origin, float(line.frequency), nan, nan, nan, bin_frequency, bin_amplitude, nan, nan, why
    )  # fmt: skip


def _nearest_bin(bins: np.ndarray, frequency: float, duration: float) -> tuple[float, float]:
    """The paper's estimator: rectangular window, bin nearest to ``frequency``; its frequency [Hz] and amplitude.

    Between bins it reads up to 36 % low (picket fence), so that it depends on where the bins happen to fall.
    """
    k = min(round(frequency * duration), bins.size - 1)
    return k / duration, float(bins[k])
