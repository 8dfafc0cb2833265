"""Amplitude, frequency and phase of expected lines, wherever the bins fall.

* lines of the step clock keep exact ratios to each other, so one clock ratio is estimated from all of them together, each
  weighted with what it tells;
* an array mode rings down while it is recorded, so it is fitted as a decaying tone;
* all amplitudes then come from one least-squares fit to the bins about the lines, in which every line is present.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.spectrum import tone_amplitude
from microvib.signals.table import DETECTION, FAINT, Figures, Line, LineTable, Uncertainty
from microvib.signals.tones import HannSpectrum, Tones, estimate_clock_ratio, mean_of_decay, steady, with_modes
from microvib.signals.uncertainty import uncertainties

SEPARATION = 2.5
"""Bins that two lines must be apart to be told apart."""
_RANK = {"array mode": 1, "electrical": 2}
MOST_OTHERS = 12
PASSBAND = 0.35
"""Part of the sample rate up to which unexpected lines are looked for."""


def estimate_lines(x: np.ndarray, sample_rate: float, expected: Sequence[ExpectedLine]) -> LineTable:
    """Estimate the ``expected`` lines in the samples ``x`` (n,) [N m] taken at ``sample_rate`` [Hz]."""
    spectrum = _spectrum(x, sample_rate)
    wanted, refused = _sort_out(expected, spectrum.duration)
    clock = [line for line in wanted if line.kind != "array mode"]
    modes = [line for line in wanted if line.kind == "array mode"]
    ratio = estimate_clock_ratio(clock, spectrum)
    tones = with_modes(steady(clock, ratio or 1.0), modes, spectrum)
    tones, mistaken = _without_mistaken(tones, ratio, spectrum.duration)
    amplitudes = spectrum.amplitudes(tones)
    rest = spectrum.without(tones, amplitudes)
    spread, ratio_spread = uncertainties(tones, amplitudes, ratio, spectrum, rest)
    rows = _figures(expected, tones, refused | mistaken, amplitudes, rest).rows(_placed(spread, expected, tones))
    rows += _others(rest, rows, clock, ratio)
    return LineTable(rows, ratio, ratio_spread, spectrum.samples, sample_rate)


def lines_at_known_clock(x: np.ndarray, sample_rate: float, expected: Sequence[ExpectedLine]) -> LineTable:
    """Lines of a simulated torque ``x`` (n,) [N m], whose clock is exactly the expected one: no noise, so no uncertainties.

    Amplitudes, phases and decays are those of ``estimate_lines``, at a fraction of its time.
    """
    figures = figures_at_known_clock(x, sample_rate, expected)
    none = 0.0 * figures.amplitude
    return LineTable(figures.rows(Uncertainty(none, none, none, none)), 1.0, 0.0, np.size(x), sample_rate)


def figures_at_known_clock(x: np.ndarray, sample_rate: float, expected: Sequence[ExpectedLine]) -> Figures:
    """The figures of ``lines_at_known_clock`` as arrays, for many records."""
    spectrum = _spectrum(x, sample_rate)
    wanted, refused = _sort_out(expected, spectrum.duration)
    clock = steady([line for line in wanted if line.kind != "array mode"])
    tones = with_modes(clock, [line for line in wanted if line.kind == "array mode"], spectrum)
    return _figures(expected, tones, refused, spectrum.amplitudes(tones), spectrum)


def _spectrum(x: np.ndarray, sample_rate: float) -> HannSpectrum:
    x = np.asarray(x, dtype=float)
    return HannSpectrum.of(x - x.mean(), sample_rate)


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


def _without_mistaken(tones: Tones, ratio: float | None, duration: float) -> tuple[Tones, dict[str, str]]:
    """Take out array modes that are really steady lines of the clock: on a multiple of the full-step rate, not decaying."""
    base = next((f for line, f in zip(tones.lines, tones.frequency, strict=True) if line.name == "full_step_1"), None)
    if ratio is None or base is None or base * duration < 2 * SEPARATION:
        return tones, {}
    order = np.rint(tones.frequency / base)
    mistaken = (
        tones.modes
        & (np.abs(tones.decay) * duration < 0.05)
        & (np.abs(tones.frequency - order * base) * duration < 0.5)
    )
    why = {
        tones.lines[k].name: f"not separable from order {order[k]:.0f} of the full step"
        for k in np.flatnonzero(mistaken)
    }
    return tones.without(mistaken), why


def _others(
    rest: HannSpectrum, rows: Sequence[Line], clock: Sequence[ExpectedLine], ratio: float | None
) -> tuple[Line, ...]:
    """Lines that stand in what is left, from a hundredth of the largest; with their place among the clock's orders.

    Such are further full-step orders, and subharmonics: stick and slip may repeat only after several microsteps.
    """
    duration = rest.duration
    top = max((row.amplitude_n_m for row in rows if np.isfinite(row.amplitude_n_m)), default=0.0)
    drive = next((line.frequency * (ratio or 1.0) for line in clock if line.name == "drive_1"), None)
    found: tuple[Line, ...] = ()
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
        tone = steady([line])
        amplitude = rest.amplitudes(tone)
        spread, _ = uncertainties(tone, amplitude, None, rest, rest)
        found += _figures([line], tone, {}, amplitude, rest).rows(spread)
    return found


def _place(frequency: float, drive: float | None, duration: float) -> str:
    """Where a line stands among the orders of the driving frequency, as the simplest fraction."""
    if drive:
        for q in (*range(1, 9), 16, 32, 64):
            p = round(frequency * q / drive)
            if p > 0 and abs(frequency - p * drive / q) * duration < 0.3:
                return f"{p}/{q} of the driving frequency" if q > 1 else f"order {p} of the driving frequency"
    return "no simple order of the driving frequency"


def _sort_out(expected: Sequence[ExpectedLine], duration: float) -> tuple[list[ExpectedLine], dict[str, str]]:
    """Lines that the record can resolve, and the names of the others with the reason.

    Lines of the clock go before array modes, for they last, while a mode rings down; but those of the electrical period
    go last, for equal phases make none.
    """
    wanted: list[ExpectedLine] = []
    refused: dict[str, str] = {}
    for line in sorted(expected, key=lambda line: _RANK.get(line.kind, 0)):
        if line.frequency * duration < SEPARATION:
            refused[line.name] = f"not resolved: needs a record of {SEPARATION / line.frequency:.3g} s"
            continue
        near = next((other for other in wanted if abs(other.frequency - line.frequency) * duration < SEPARATION), None)
        if near is not None:
            needed = SEPARATION / max(abs(near.frequency - line.frequency), 1e-12)
            length = f"; a record of {needed:.3g} s could" if needed < 1e6 else ""
            refused[line.name] = f"not separable from {near.name}{length}"
        else:
            wanted.append(line)
    return wanted, refused


def _figures(
    expected: Sequence[ExpectedLine], tones: Tones, refused: dict[str, str], amplitudes: np.ndarray, rest: HannSpectrum
) -> Figures:
    """Figures of the tones and, nan but for their nearest bin, of the lines that are ``refused`` for a reason.

    Floors are those of ``rest``.
    """
    duration = rest.duration
    fold = tones.decay * duration
    size, floor = np.abs(amplitudes) * mean_of_decay(fold)[0], rest.floors(tones.frequency)
    status = _statuses(tones, size, floor, fold) | refused
    order = _order(expected, tones)
    frequency = _at(tones.frequency, order)
    wanted = np.array([line.frequency for line in expected], dtype=float)
    bins = np.minimum(np.rint(np.where(np.isnan(frequency), wanted, frequency) * duration), rest.values.size - 1)
    return Figures(
        expected=tuple(expected),
        status=tuple(status[line.name] for line in expected),
        frequency=frequency,
        amplitude=_at(size, order),
        phase=_at(np.angle(amplitudes), order),
        decay=_at(tones.decay, order),
        floor=_at(floor, order),
        # The paper's estimator: rectangular window, nearest bin. Between bins it reads up to 36 % low (picket fence), so that
        # it depends on where the bins happen to fall.
        bin_frequency=bins / duration,
        bin_amplitude=np.abs(rest.unwindowed[bins.astype(int)]),
    )


def _statuses(tones: Tones, size: np.ndarray, floor: np.ndarray, fold: np.ndarray) -> dict[str, str]:
    """Status of each tone of amplitude ``size`` that falls by ``fold`` e-foldings, by the name of its line."""
    faint, falling = size < DETECTION * floor, tones.seen & (np.abs(fold) > 0.1)
    status = np.select([faint, tones.limited, falling & (fold > 0.0), falling], [0, 1, 2, 3], 4)
    words = (FAINT, "at a limit of its fit", "decaying", "growing", "ok")
    return {line.name: words[k] for line, k in zip(tones.lines, status.tolist(), strict=True)}


def _order(expected: Sequence[ExpectedLine], tones: Tones) -> np.ndarray:
    """Place of each expected line among the tones, (lines,); one after the last where it is none of them."""
    place = {line.name: k for k, line in enumerate(tones.lines)}
    return np.array([place.get(line.name, len(tones)) for line in expected], dtype=int)


def _at(values: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Values of tones (m,) as those of lines (lines,)."""
    placed: np.ndarray = np.append(values, np.nan)[order]
    return placed


def _placed(spread: Uncertainty, expected: Sequence[ExpectedLine], tones: Tones) -> Uncertainty:
    """Uncertainties of tones as those of lines."""
    order = _order(expected, tones)
    each = (spread.amplitude, spread.phase, spread.frequency, spread.decay)
    return Uncertainty(*(_at(values, order) for values in each))
