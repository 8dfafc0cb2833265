"""Amplitude, frequency and phase of expected lines, wherever the bins fall.

* lines of the step clock keep exact ratios to each other, so one clock ratio is estimated from all of them together, each
  weighted with what it tells;
* an array mode rings down while it is recorded, so it is fitted as a decaying tone;
* all amplitudes then come from one least-squares fit to the bins about the lines, in which every line is present.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.spectrum import tone_amplitude
from microvib.signals.tones import (
    DETECTION,
    HannSpectrum,
    Tone,
    Uncertainty,
    estimate_amplitudes,
    estimate_clock_ratio,
    fit_modes,
    mean_over_record,
    uncertainties,
)

SEPARATION = 2.5
"""Bins that two lines must be apart to be told apart."""
_RANK = {"array mode": 1, "electrical": 2}
MOST_OTHERS = 12
PASSBAND = 0.35
"""Part of the sample rate up to which unexpected lines are looked for."""
FAINT = "below the floor"
"""Status of a line that was looked for and not found."""


@dataclass(frozen=True)
class Line:
    """One line of a torque; amplitudes in N m, 0-to-peak."""

    line: str
    kind: str
    origin: str
    expected_hz: float
    frequency_hz: float
    frequency_uncertainty_hz: float
    amplitude_n_m: float
    """Amplitude; of a decaying tone its mean over the record."""
    amplitude_uncertainty_n_m: float
    """Standard uncertainty, from the floor about the line."""
    phase_rad: float
    """Phase of the cosine at the first sample."""
    phase_uncertainty_rad: float
    bin_frequency_hz: float
    bin_amplitude_n_m: float
    """The paper's figure: rectangular window, nearest bin."""
    floor_n_m: float
    """Median amplitude of the bins about the line."""
    decay_per_s: float
    """Decay rate sigma of the tone, exp(-sigma t); 0 for a line of the step clock."""
    decay_uncertainty_per_s: float
    status: str
    background_n_m: float = float("nan")
    """Amplitude of the background recording at this frequency; nan without one."""


@dataclass(frozen=True)
class LineTable:
    """All lines of one record, and how they were estimated."""

    lines: tuple[Line, ...]
    clock_ratio: float | None
    """Step clock found over step clock expected; None where no line of the clock is seen."""
    clock_ratio_uncertainty: float | None
    """Its standard uncertainty."""
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
        """Lines worth a row in a report: without those below the floor, those below a thousandth of the largest, and
        sidebands and other lines below a twentieth."""
        top = max((x.amplitude_n_m for x in self.lines if np.isfinite(x.amplitude_n_m)), default=0.0)

        def is_notable(x: Line) -> bool:
            least = 0.05 if x.kind in ("sideband", "other") else 1e-3
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
    spectrum = HannSpectrum(x, sample_rate)
    wanted, refused = _sort_out(expected, duration)
    clock = [line for line in wanted if line.kind != "array mode"]
    modes = [line for line in wanted if line.kind == "array mode"]

    ratio = estimate_clock_ratio(clock, spectrum)
    tones = [Tone(line, line.frequency * (ratio or 1.0), 0.0) for line in clock]
    if modes:
        tones += fit_modes(modes, spectrum.without(tones, estimate_amplitudes(tones, spectrum)))
    tones, mistaken = _without_mistaken(tones, ratio, duration)
    refused += mistaken
    amplitudes = estimate_amplitudes(tones, spectrum)
    rest = spectrum.without(tones, amplitudes)
    spread = uncertainties(tones, amplitudes, ratio, spectrum, rest)
    bins = np.abs(np.fft.rfft(x)) * (2.0 / x.size)
    found = {tone.line.name: _result(k, tone, amplitudes[k], spread, bins, rest) for k, tone in enumerate(tones)}
    for line, why in refused:
        found[line.name] = _not_estimated(line, why, bins, duration)
    rows = [found[line.name] for line in expected]
    rows += _others(rest, rows, clock, ratio, bins)
    return LineTable(tuple(rows), ratio, spread.clock_ratio if ratio else None, x.size, sample_rate)


def lines_at_known_clock(x: np.ndarray, sample_rate: float, expected: Sequence[ExpectedLine]) -> LineTable:
    """Lines of a simulated torque ``x`` (n,) [N m], whose clock is exactly the expected one: no noise, so no uncertainties.

    Amplitudes, phases and decays are those of ``estimate_lines``, at a fraction of its time.
    """
    x = np.asarray(x, dtype=float)
    x = x - x.mean()
    spectrum = HannSpectrum(x, sample_rate)
    wanted, refused = _sort_out(expected, x.size / sample_rate)
    tones = [Tone(line, line.frequency, 0.0) for line in wanted if line.kind != "array mode"]
    modes = [line for line in wanted if line.kind == "array mode"]
    if modes:
        tones += fit_modes(modes, spectrum.without(tones, estimate_amplitudes(tones, spectrum)))
    amplitudes = estimate_amplitudes(tones, spectrum)
    none = np.zeros(len(tones))
    exact = Uncertainty(none, none, none, none, 0.0)
    bins = np.abs(np.fft.rfft(x)) * (2.0 / x.size)
    found = {tone.line.name: _result(k, tone, amplitudes[k], exact, bins, spectrum) for k, tone in enumerate(tones)}
    found |= {line.name: _not_estimated(line, why, bins, x.size / sample_rate) for line, why in refused}
    return LineTable(tuple(found[line.name] for line in expected), 1.0, 0.0, x.size, sample_rate)


def with_background(table: LineTable, background: np.ndarray) -> LineTable:
    """Lines with what the table reads at their frequencies while nothing runs, ``background`` (m,) at the same sample rate.

    The phase between the two is unknown, so nothing is subtracted: half of the background's square goes into the variance of the
    line's amplitude, and a line that does not exceed the background is named so.
    """
    rows = []
    for line in table:
        if not np.isfinite(line.amplitude_n_m):
            rows.append(line)
            continue
        there = tone_amplitude(background, table.sample_rate, line.frequency_hz)
        spread = float(np.hypot(line.amplitude_uncertainty_n_m, there / np.sqrt(2.0)))
        status = "in the background" if line.amplitude_n_m < 2.0 * there else line.status
        rows.append(replace(line, background_n_m=there, amplitude_uncertainty_n_m=spread, status=status))
    return replace(table, lines=tuple(rows))


def _without_mistaken(
    tones: Sequence[Tone], ratio: float | None, duration: float
) -> tuple[list[Tone], list[tuple[ExpectedLine, str]]]:
    """Take out array modes that are really steady lines of the clock: on a multiple of the full-step rate, not decaying."""
    base = next((tone.frequency for tone in tones if tone.line.name == "full_step_1"), None)
    if ratio is None or base is None or base * duration < 2 * SEPARATION:
        return list(tones), []
    kept: list[Tone] = []
    mistaken = []
    for tone in tones:
        order = round(tone.frequency / base)
        steady = abs(tone.decay) * duration < 0.05
        if (
            tone.line.kind == "array mode"
            and tone.seen
            and steady
            and abs(tone.frequency - order * base) * duration < 0.5
        ):
            mistaken.append((tone.line, f"not separable from order {order} of the full step"))
        else:
            kept.append(tone)
    return kept, mistaken


def _others(
    rest: HannSpectrum, rows: Sequence[Line], clock: Sequence[ExpectedLine], ratio: float | None, bins: np.ndarray
) -> list[Line]:
    """Lines that stand in what is left, from a hundredth of the largest; with their place among the clock's orders.

    Such are further full-step orders, and subharmonics: stick and slip may repeat only after several microsteps.
    """
    duration = rest.samples / rest.sample_rate
    top = max((row.amplitude_n_m for row in rows if np.isfinite(row.amplitude_n_m)), default=0.0)
    drive = next((line.frequency * (ratio or 1.0) for line in clock if line.name == "drive_1"), None)
    found: list[Line] = []
    if drive is None:  # without a steady clock there is nothing that a line could be unexpected against
        return found
    highest = int(PASSBAND * rest.samples)
    magnitude = rest.magnitude[:highest].copy()
    magnitude[: int(SEPARATION) + 1] = 0.0
    while len(found) < MOST_OTHERS and magnitude.size > 8:
        k = int(np.argmax(magnitude))
        low, high = max(k - 1, 0) / duration, (k + 1) / duration
        if magnitude[k] < max(0.01 * top, 1e-12) or magnitude[k] < DETECTION * rest.floor(k / duration):
            break
        magnitude[max(k - 4, 0) : k + 5] = 0.0
        frequency, _ = rest.peak(low, high, margin=0.0)
        line = ExpectedLine(
            f"other_{len(found) + 1}", "other", frequency, low, high, _place(frequency, drive, duration)
        )
        tone = Tone(line, frequency, 0.0)
        spread = uncertainties([tone], amplitude := estimate_amplitudes([tone], rest), None, rest, rest)
        found.append(_result(0, tone, amplitude[0], spread, bins, rest))
    return found


def _place(frequency: float, drive: float | None, duration: float) -> str:
    """Where a line stands among the orders of the driving frequency, as the simplest fraction."""
    if drive:
        for q in (*range(1, 9), 16, 32, 64):
            p = round(frequency * q / drive)
            if p > 0 and abs(frequency - p * drive / q) * duration < 0.3:
                return f"{p}/{q} of the driving frequency" if q > 1 else f"order {p} of the driving frequency"
    return "no simple order of the driving frequency"


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


def _result(k: int, tone: Tone, amplitude: complex, spread: Uncertainty, bins: np.ndarray, rest: HannSpectrum) -> Line:
    duration = rest.samples / rest.sample_rate
    floor = rest.floor(tone.frequency)
    size = mean_over_record(tone, amplitude, duration)
    status = "ok"
    if size < DETECTION * floor:
        status = FAINT
    elif tone.limited:
        status = "at a limit of its fit"
    elif tone.seen and abs(tone.decay) * duration > 0.1:
        status = "decaying" if tone.decay > 0.0 else "growing"
    bin_frequency, bin_amplitude = _nearest_bin(bins, tone.frequency, duration)
    return Line(
        line=tone.line.name,
        kind=tone.line.kind,
        origin=tone.line.origin,
        expected_hz=float(tone.line.frequency),
        frequency_hz=float(tone.frequency),
        frequency_uncertainty_hz=float(spread.frequency[k]),
        amplitude_n_m=size,
        amplitude_uncertainty_n_m=float(spread.amplitude[k]),
        phase_rad=float(np.angle(amplitude)),
        phase_uncertainty_rad=float(spread.phase[k]),
        bin_frequency_hz=bin_frequency,
        bin_amplitude_n_m=bin_amplitude,
        floor_n_m=floor,
        decay_per_s=tone.decay,
        decay_uncertainty_per_s=float(spread.decay[k]),
        status=status,
    )


def _not_estimated(line: ExpectedLine, why: str, bins: np.ndarray, duration: float) -> Line:
    nan = float("nan")
    bin_frequency, bin_amplitude = _nearest_bin(bins, line.frequency, duration)
    return Line(
        line=line.name,
        kind=line.kind,
        origin=line.origin,
        expected_hz=float(line.frequency),
        frequency_hz=nan,
        frequency_uncertainty_hz=nan,
        amplitude_n_m=nan,
        amplitude_uncertainty_n_m=nan,
        phase_rad=nan,
        phase_uncertainty_rad=nan,
        bin_frequency_hz=bin_frequency,
        bin_amplitude_n_m=bin_amplitude,
        floor_n_m=nan,
        decay_per_s=nan,
        decay_uncertainty_per_s=nan,
        status=why,
    )


def _nearest_bin(bins: np.ndarray, frequency: float, duration: float) -> tuple[float, float]:
    """The paper's estimator: rectangular window, bin nearest to ``frequency``; its frequency [Hz] and amplitude.

    Between bins it reads up to 36 % low (picket fence), so that it depends on where the bins happen to fall.
    """
    k = min(round(frequency * duration), bins.size - 1)
    return k / duration, float(bins[k])
