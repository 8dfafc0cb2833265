"""Noise of the friction and limits: amplitudes that other draws have, at every
frequency of the band, on modes and off them.

Many draws say so themselves (``LineTable.seed_peaks``). Without them the linearised drive does, of
what noise makes directly (``model.noise_amplitudes``). What it makes by changing other lines, such as
side lines of the clock's, one draw bounds by its own amplitude only.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from microvib.analysis.margins import MIN_RELATIVE_ERROR, ONE_DRAW, SEEDS_NEEDED, Margin
from microvib.analysis.seeds import QUANTILE, quantile_bounds
from microvib.analysis.slow_noise import (
    slow_noise_bound,
    slow_noise_places,
)
from microvib.model.driven import RAYLEIGH_P95, noise_bands
from microvib.model.noise_amplitudes import (
    NoiseAmplitudes,
    mean_square_amplitudes,
    noise_amplitudes,
    torque_of_noise,
)
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_table import NOISE_DRIVEN, Line, LineTable, ResidualPeaks, part_ends
from microvib.signals.seed_peaks import SeedPeaks

NOISE = "noise"
"""Name of what noise makes beside the lines, as a line of a judgement."""
ONE_DRAW_FACTOR = RAYLEIGH_P95 / math.sqrt(-math.log(QUANTILE))
"""Times the amplitude of one draw that 95 % of the draws stay below, with 95 % confidence, where
noise makes all of it: both are drawn from a Rayleigh distribution."""
CERTAIN_FACTOR = 2.0 * RAYLEIGH_P95
"""Times the root mean square of noise in a bin that one draw in 10^5 exceeds."""
LINEAR_FACTOR = 1.25
"""Factor on what the linearised drive says of noise, for what a shaft that sticks at times may add;
assumed. Draws of a shaft that always slides have the quantile itself (tests/test_noise_verdicts.py)."""
_IN_OTHER_DRAWS = math.sqrt(2.0) * RAYLEIGH_P95
"""Root mean squares of noise at a line by which 95 % of other draws differ from one at most: each
has noise of its own."""
_REACH_IN_BINS = 3.0
"""Bins on either side of a bin that what stands in it may be away, with a Hann window."""
_REMEDY = f"of one run --seeds {SEEDS_NEEDED + 1} judges by draws"
_NEGLIGIBLE_TORQUE = 0.01
"""Part of the friction up to which noise changes no line of the clock by much."""
_NEGLIGIBLE_AMPLITUDE = 0.01
"""Part of a limit up to which noise does not matter to it."""


def noise_of_record(scenario: Scenario | None, table: LineTable) -> Scenario | None:
    """The ``scenario``, where its noise is in the record of a table; None in a steady state, which
    has none.
    """
    if scenario is None or not noise_bands(scenario):
        return None
    if any(line.status == TRANSIENT for line in table):
        return None
    return scenario


def noise_margins(
    table: LineTable, limit: LimitCurve, scenario: Scenario | None
) -> Iterator[Margin]:
    """Margins of what noise makes beside the lines to a limit [N m]."""
    noisy = noise_of_record(scenario, table)
    if noisy is None:
        return
    band, peaks = (limit.low, limit.high), table.seed_peaks
    amplitudes = noise_amplitudes(noisy, table.duration, *band)
    if peaks is not None and _bounds_by_draws(table):
        top = PASSBAND * table.sample_rate
        seen = limit.within(0.0, top)
        if seen is not None:
            yield _by_draws(peaks, amplitudes, seen, table)
        if band[1] <= top:
            return
        amplitudes = noise_amplitudes(noisy, table.duration, max(top, band[0]), band[1])
    else:
        yield from _unexplained_by_noise(table, limit, noisy)
        yield from _of_slow_noise(table, limit, noisy)
    if amplitudes.frequency.size:
        yield _by_closed_form(amplitudes, limit, table, noisy)


def _referred(
    amplitudes: NoiseAmplitudes, limit: LimitCurve, duration: float
) -> tuple[NoiseAmplitudes, np.ndarray]:
    """Amplitudes over what is allowed at each, times the least of all that is allowed: by these the
    largest of all bins is judged against that least; and what is allowed (n,) [N m].

    A bin sees what stands within some others beside it, and may stand for several.
    """
    reach = (_REACH_IN_BINS + amplitudes.number) / duration
    allowed = limit.strictest(amplitudes.frequency - reach, amplitudes.frequency + reach)
    share = limit.least / allowed
    return replace(amplitudes, mean_square=amplitudes.mean_square * share**2), allowed


def _loudest(referred: NoiseAmplitudes, allowed: np.ndarray) -> tuple[float, float]:
    """Frequency [Hz] of the bin that is nearest to its limit, and what is allowed there [N m]."""
    k = int(np.argmax(referred.mean_square))
    return float(referred.frequency[k]), float(allowed[k])


def _by_closed_form(
    amplitudes: NoiseAmplitudes, limit: LimitCurve, table: LineTable, scenario: Scenario
) -> Margin:
    """The margin of what the linearised drive says."""
    referred, allowed = _referred(amplitudes, limit, table.duration)
    (at, most), least = _loudest(referred, allowed), limit.least
    share = referred.quantile() / least
    quantile = referred.quantile() * (most / least)
    line = _noise_line(at, quantile)
    if LINEAR_FACTOR * referred.quantile() <= least:
        return Margin(line, quantile, _factor(most, quantile), "pass", limit=most)
    keys = " and ".join(noise_bands(scenario))
    if share > 1.0:
        slides = "if the shaft always slides"
    else:
        slides = f"and where the shaft sticks at times it may be {LINEAR_FACTOR:g} times that"
    why = (
        f"{NOISE} ({keys}: in one draw of twenty the largest amplitude in a record of"
        f" {table.duration:g} s is above {1e3 * quantile:.4g} mN m, most likely at {at:.4g} Hz,"
        f" {slides}; {_REMEDY})"
    )
    return Margin(line, quantile, _factor(most, quantile), "not judged", why, most)


def _by_draws(
    peaks: SeedPeaks, amplitudes: NoiseAmplitudes, limit: LimitCurve, table: LineTable
) -> Margin:
    """The margin of the largest amplitude in the band over many draws."""
    least, band = limit.least, (limit.low, limit.high)
    low, high = part_ends(peaks.frequency)
    strict = peaks.over(limit.strictest(low, high) / least)
    bin_width = 1.0 / table.duration
    places = peaks.frequency - bin_width, peaks.frequency + bin_width
    lenient = peaks.over(limit.most_lenient(*places) / least)
    highest, certain = strict.largest(*band)[0], lenient.largest(*band)[1]
    error = max(MIN_RELATIVE_ERROR, table.own_error)
    upper = quantile_bounds(np.sort(highest))[1]
    lower = quantile_bounds(np.sort(certain))[0]
    at = strict.typical_frequency(*band)
    most = min(float(limit.strictest(at - bin_width, at + bin_width)), limit.most)
    scale = most / least
    p95 = float(np.quantile(highest, QUANTILE)) * scale
    line = _noise_line(at, p95)
    factor = _factor(most, p95)
    if upper * (1.0 + error) <= least:
        return Margin(line, p95, factor, "pass", limit=most)
    told = (
        f"{NOISE} (95 % quantile of the largest amplitude beside the clock's lines, between"
        f" {1e3 * lower * scale:.4g} and {1e3 * upper * scale:.4g} mN m"
    )
    if lower * (1.0 - error) <= least:
        why = f"{told}; more seeds than {peaks.draws})"
        return Margin(line, p95, factor, "not judged", why, most)
    if _referred(amplitudes, limit, table.duration)[0].quantile() <= least:
        why = f"{told}, larger than the noise accounts for; increase record.settle)"
        return Margin(line, p95, factor, "not judged", why, most)
    return Margin(line, p95, factor, "fail", limit=most)


def _unexplained_by_noise(
    table: LineTable, limit: LimitCurve, scenario: Scenario
) -> Iterator[Margin]:
    """The largest peak of one draw that noise may have made by changing lines, where it may be above
    the limit in others.
    """
    if table.rest is None or is_negligible(scenario, table.duration, limit.least):
        return
    at, size, allowed = _beyond_direct(table.rest, scenario, table.duration, limit)
    k = int(np.argmax(size / allowed)) if size.size else 0
    if size.size and ONE_DRAW_FACTOR * size[k] > allowed[k]:
        most = float(allowed[k])
        why = (
            f"{NOISE} (one draw of many has a peak without a line of {1e3 * size[k]:.4g} mN m at"
            f" {at[k]:.4g} Hz; {_REMEDY})"
        )
        line = _noise_line(float(at[k]), float(size[k]))
        yield Margin(line, line.amplitude, _factor(most, line.amplitude), "not judged", why, most)


def _of_slow_noise(table: LineTable, limit: LimitCurve, scenario: Scenario) -> Iterator[Margin]:
    """Margin of what noise that is slow beside the record may make where it shows nothing, where that may be
    above the limit.
    """
    at = slow_noise_places(scenario, table.duration, (limit.low, limit.high))
    bound = slow_noise_bound(scenario, table.duration, at)
    if not np.any(bound > 0.0):
        return
    # Between two places it is no larger than at one of them: both count to the neighbours.
    beside = np.concatenate([at[:1], at, at[-1:]])
    allowed = np.minimum(limit.strictest(beside[:-2], beside[2:]), limit.most)
    k = int(np.argmax(bound / allowed))
    most = float(allowed[k])
    if bound[k] > most:
        why = (
            f"{NOISE} (friction.torque_noise is slow beside the record, which sees one value of it;"
            f" others may change the drive, and lines by up to {1e3 * bound[k]:.4g} mN m, at"
            f" {at[k]:.4g} Hz; {_REMEDY}, or a longer record.duration)"
        )
        line = _noise_line(float(at[k]), float(bound[k]))
        yield Margin(line, line.amplitude, _factor(most, line.amplitude), "not judged", why, most)


def with_other_draws(
    found: Margin, most: float, table: LineTable, scenario: Scenario | None
) -> Margin:
    """The margin of a line to a limit [N m] with what other draws of the noise may make of it: the
    margin that was ``found``, but for unlisted lines, in whose place others stand in other draws, and
    for lines of the clock that noise adds to.
    """
    noisy, line = noise_of_record(scenario, table), found.line
    if noisy is None or not math.isfinite(line.amplitude):
        return found
    if line.is_mode and line.status == NOISE_DRIVEN and table.over_seeds(line.name) is None:
        return _mode_of_one_draw(found, most, table, noisy)
    if line.kind == "other" and line.status in ("ok", NOISE_DRIVEN):
        if _bounds_by_draws(table):
            return _unlisted_by_draws(found, most, table)
        return _unlisted_of_one_draw(found, most, table, noisy)
    if line.of_clock and found.verdict != "not judged" and not _bounds_by_draws(table):
        added = _added_by_other_draws(noisy, table.duration, line.place)
        if abs(line.amplitude - most) <= added and found.amplitude > 0.0:
            return _not_judged(found, f"noise changes it from draw to draw; {_REMEDY}")
    return found


def _added_by_other_draws(scenario: Scenario, duration: float, frequency: float) -> float:
    """Torque that other draws may add to a line at a ``frequency`` [Hz], or take from it [N m]."""
    at = np.array([frequency])
    direct = _IN_OTHER_DRAWS * _direct(scenario, duration, at)[0]
    return float(direct + slow_noise_bound(scenario, duration, at)[0])


def _unlisted_by_draws(found: Margin, most: float, table: LineTable) -> Margin:
    """The margin of an unlisted line by the largest amplitudes near it in many draws."""
    assert table.seed_peaks is not None
    highest = table.seed_peaks.largest(found.line.place, found.line.place)[0]
    lower, upper = quantile_bounds(np.sort(highest))
    error = max(MIN_RELATIVE_ERROR, table.own_error)
    decided = found.verdict != "not judged" or found.line.status == NOISE_DRIVEN
    if upper * (1.0 + error) <= most:
        return replace(found, verdict="pass", why="") if decided else found
    if found.verdict == "fail" and lower * (1.0 - error) > most:
        return found
    told = f"about it the 95 % quantile lies between {1e3 * lower:.4g} and {1e3 * upper:.4g} mN m"
    return _not_judged(found, f"{ONE_DRAW}; {told}")


def _mode_of_one_draw(found: Margin, most: float, table: LineTable, scenario: Scenario) -> Margin:
    """The margin of a mode that noise drives, of which one draw is known: it passes only where what
    noise makes by the linearised drive, and what this draw shows, are far enough below the limit.
    """
    line = found.line
    shown = max(line.amplitude, line.amplitude_at_start(table.duration))
    direct = float(_direct(scenario, table.duration, np.array([line.place]))[0])
    if LINEAR_FACTOR * (shown + _IN_OTHER_DRAWS * direct) <= most:
        return replace(found, verdict="pass", why="")
    return found


def _unlisted_of_one_draw(
    found: Margin, most: float, table: LineTable, scenario: Scenario
) -> Margin:
    """The margin of an unlisted line of which one draw is known."""
    line = found.line
    if line.status == NOISE_DRIVEN:
        direct = float(_direct(scenario, table.duration, np.array([line.place]))[0])
        largest = line.amplitude + _IN_OTHER_DRAWS * direct
        if line.amplitude <= CERTAIN_FACTOR * direct:
            largest = RAYLEIGH_P95 * direct
        largest += float(slow_noise_bound(scenario, table.duration, np.array([line.place]))[0])
        if largest <= most:
            return replace(found, verdict="pass", why="")
        return _not_judged(found, f"{ONE_DRAW}; {_REMEDY}")
    slow = float(slow_noise_bound(scenario, table.duration, np.array([line.place]))[0])
    if found.verdict == "fail" and line.amplitude - slow <= most:
        return _not_judged(found, f"noise changes it from draw to draw; {_REMEDY}")
    if found.verdict != "pass" or ONE_DRAW_FACTOR * line.amplitude + slow <= most:
        return found
    if slow == 0.0 and is_negligible(scenario, table.duration, most):
        return found
    return _not_judged(found, f"one draw of many, as noise may have made it; {_REMEDY}")


def noise_bounds(scenario: Scenario, duration: float) -> ResidualPeaks:
    """Upper bounds of what noise makes directly in a record of ``duration`` [s], for each twelfth of
    an octave: one draw in 10^5 has more there.
    """
    direct = noise_amplitudes(scenario, duration)
    size = CERTAIN_FACTOR * LINEAR_FACTOR * np.sqrt(direct.mean_square)
    return ResidualPeaks.of(direct.frequency, size)


_PERIODS_OF_RINGING = 3.0
"""Periods of a mode in which it has an amplitude, however slowly noise changes it."""


def ringing_by_noise(scenario: Scenario, frequency: float) -> float:
    """Amplitude [N m] below which a mode at a ``frequency`` [Hz] rings by noise of the friction in 95 % of the
    draws, at any one time; 0 without noise, or where the array stands still.
    """
    if not scenario.rate:
        return 0.0
    direct = _direct(scenario, _PERIODS_OF_RINGING / frequency, np.array([frequency]))
    return LINEAR_FACTOR * RAYLEIGH_P95 * float(direct[0])


def changed_line_bounds(table: LineTable, scenario: Scenario) -> Iterator[tuple[float, float]]:
    """Frequencies [Hz] and upper bounds [N m] of what noise makes by changing lines, as far as one
    draw bounds it: of unlisted lines, and of peaks without one.
    """
    noisy = noise_of_record(scenario, table)
    if noisy is None:
        return
    yield from _slow_noise_bounds(table, noisy)
    if _changes_little(noisy):
        return
    for line in table:
        if line.kind == "other" and line.status == "ok":
            yield line.place, ONE_DRAW_FACTOR * line.amplitude
    if table.rest is not None:
        anything = LimitCurve.flat(1.0)
        at, size, _ = _beyond_direct(table.rest, noisy, table.duration, anything)
        yield from zip(at.tolist(), (ONE_DRAW_FACTOR * size).tolist(), strict=True)


def _slow_noise_bounds(table: LineTable, scenario: Scenario) -> Iterator[tuple[float, float]]:
    """Frequencies [Hz] and upper bounds [N m] of lines with what slow noise may add to them, and of
    what it may make beside them.
    """
    seen = [line for line in table if line.seen]
    places = slow_noise_places(scenario, table.duration, (0.0, math.inf))
    at = np.concatenate([places, [line.place for line in seen]])
    added = slow_noise_bound(scenario, table.duration, at)
    if np.any(added > 0.0):
        size = np.concatenate([np.zeros(places.size), [line.amplitude for line in seen]])
        yield from zip(at.tolist(), (size + added).tolist(), strict=True)


def _beyond_direct(
    rest: ResidualPeaks, scenario: Scenario, duration: float, limit: LimitCurve
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies [Hz] and amplitudes [N m] of peaks within the range of a limit that are larger than
    noise makes directly, and what it allows there [N m], (n,) each.
    """
    low, high = limit.low - rest.resolution, limit.high + rest.resolution
    inside = (rest.frequency >= low) & (rest.frequency <= high)
    at, size, allowed = (
        x[inside] for x in (rest.frequency, rest.amplitude, rest.least_allowed(limit))
    )
    beyond = size > CERTAIN_FACTOR * _direct(scenario, duration, at)
    return at[beyond], size[beyond], allowed[beyond]


def _changes_little(scenario: Scenario) -> bool:
    """Whether noise is so small beside the friction that it changes no line by much."""
    return torque_of_noise(scenario) <= _NEGLIGIBLE_TORQUE * scenario.friction.largest_torque


def _not_judged(found: Margin, why: str) -> Margin:
    return replace(found, verdict="not judged", why=f"{found.line.name} ({why})")


def _bounds_by_draws(table: LineTable) -> bool:
    """Whether so many draws were run that their largest bounds their 95 % quantile."""
    return table.seed_peaks is not None and table.seed_peaks.draws >= SEEDS_NEEDED


def is_negligible(scenario: Scenario, duration: float, most: float) -> bool:
    """Whether noise neither matters to a limit [N m] directly nor changes lines by much."""
    if not _changes_little(scenario):
        return False
    return noise_amplitudes(scenario, duration).quantile() <= _NEGLIGIBLE_AMPLITUDE * most


def _direct(scenario: Scenario, duration: float, frequency: np.ndarray) -> np.ndarray:
    """Root mean square amplitudes [N m] that noise makes directly at frequencies (n,) [Hz]."""
    return np.sqrt(mean_square_amplitudes(scenario, frequency, duration))


def _noise_line(frequency: float, amplitude: float) -> Line:
    """Amplitude that noise makes beside the lines, as a line."""
    return Line(
        name=NOISE,
        kind="other",
        origin="noise of the friction, 95 % of the draws below",
        expected=frequency,
        frequency=frequency,
        amplitude=amplitude,
        status=NOISE_DRIVEN,
    )


def _factor(most: float, amplitude: float) -> float:
    return most / amplitude if amplitude > 0.0 else math.inf
