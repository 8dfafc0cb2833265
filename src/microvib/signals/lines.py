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
MOST_FOR_CLOCK = 12
"""Lines, the strongest, that the clock ratio is estimated from."""
_RANK = {"array mode": 1, "electrical": 2}
FAINT = "below the floor"
"""Status of a line that was looked for and not found."""
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

    def notable(self) -> tuple[Line, ...]:
        """Lines worth a row in a report: without those below the floor or a thousandth of the largest, sidebands 2 %."""
        top = max((x.amplitude_n_m for x in self.lines if np.isfinite(x.amplitude_n_m)), default=0.0)

        def is_notable(x: Line) -> bool:
            least = 0.02 if x.kind == "sideband" else 1e-3
            return x.status != FAINT and not x.amplitude_n_m < least * top

        return tuple(x for x in self.lines if is_notable(x))

    def text(self, notable: bool = False) -> str:
        """The table as text, whole or only what is notable."""
        shown = self.notable() if notable else self.lines
        rows = [f"{'line':16s} {'expected Hz':>12s} {'Hz':>12s} {'N m':>12s} {'bin Hz':>10s} {'bin N m':>12s}  status"]
        rows += [
            f"{x.line:16s} {x.expected_hz:12.5f} {x.frequency_hz:12.5f} {x.amplitude_n_m:12.4e} {x.bin_frequency_hz:10.4f}"
            f" {x.bin_amplitude_n_m:12.4e}  {x.status}"
            for x in shown
        ]
        if len(shown) < len(self.lines):
            rows.append(f"and {len(self.lines) - len(shown)} small ones in lines.csv")
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
    """Lines that the record can resolve, and the others with the reason.

    Lines of the clock go before array modes, for they last, while a mode rings down; but those of the electrical period
    go last, for equal phases make none.
    """
    wanted: list[ExpectedLine] = []
    refused: list[tuple[ExpectedLine, str]] = []
    for line in sorted(expected, key=lambda line: _RANK.get(line.kind, 0)):
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

    def near(self, frequencies: Sequence[float]) -> np.ndarray:
        """Bins within reach of any of the ``frequencies``."""
        centres = np.array([round(self.bins(f)) for f in frequencies])
        bins = np.unique(centres[:, None] + np.arange(-REACH, REACH + 1))
        return bins[(bins >= 0) & (bins < self.values.size)]

    def equations(self, tones: Sequence[_Tone], k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Real least-squares equations at the bins ``k``: cosine and minus sine of each tone, and a constant."""
        constant = _damped_hann(0.0, 0.0, k, self.samples)[:, None]
        shapes = np.hstack([*(self.shapes(tone, k) for tone in tones), constant])
        values = self.values[k]
        return np.vstack([shapes.real, shapes.imag]), np.concatenate([values.real, values.imag])

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
    """Clock ratio that explains the lines of the clock best, all together; None where none of them stands out.

    The strongest line gives the start; then Gauss-Newton on the joint fit, which weights each line with what it tells.
    """
    peaks = [(line, *spectrum.peak(line.low, line.high)) for line in clock]
    seen = [item for item in peaks if item[2] > _DETECTION * max(spectrum.floor(item[0].frequency), 1e-300)]
    if not seen:
        return None
    seen.sort(key=lambda item: -item[2])
    strongest, frequency, _ = seen[0]
    lines = [line for line, _, _ in seen[:MOST_FOR_CLOCK]]
    near = spectrum.near([line.frequency for line in lines])

    def residual(ratio: float) -> np.ndarray:
        tones = [_Tone(line, line.frequency * ratio, 0.0) for line in lines]
        A, b = spectrum.equations(tones, near)
        rest: np.ndarray = b - A @ _least_squares(A, b)
        return rest

    ratio, bin_ratio = frequency / strongest.frequency, 1.0 / max(spectrum.bins(line.frequency) for line in lines)
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


def _amplitudes(tones: Sequence[_Tone], spectrum: _HannSpectrum) -> np.ndarray:
    """Complex amplitudes a of all tones together, x = Re(a exp(i w t)), (m,); least squares over the bins about them."""
    if not tones:
        return np.zeros(0, dtype=complex)
    solution = _least_squares(*spectrum.equations(tones, spectrum.near([tone.frequency for tone in tones])))
    result: np.ndarray = solution[0:-1:2] + 1j * solution[1:-1:2]
    return result


def _least_squares(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    solution: np.ndarray = np.linalg.lstsq(A, b, rcond=1e-12)[0]
    return solution


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
    band = spectrum.near([frequency])

    def residual(u: np.ndarray) -> np.ndarray:
        A, b = spectrum.equations([_Tone(line, u[0] / duration, u[1] / duration)], band)
        rest: np.ndarray = b - A @ _least_squares(A, b)
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
        status = FAINT if size < _DETECTION * floor else "ok"
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
