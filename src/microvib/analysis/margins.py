"""One line against a limit: how far its amplitude is known, and whether that is enough to pass or
to fail.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from microvib.analysis.start import (
    SETTLED_EFOLDINGS,
    may_still_ring,
    rounded_up,
    time_to_settle,
)
from microvib.model.expected import distance_to_clock_line
from microvib.model.linear import CoupledMode, coupled_modes
from microvib.model.parametric import decay_in_motion
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_fit import CANCELLED, SEPARATION
from microvib.signals.line_table import (
    BELOW_FLOOR,
    DISTORTED,
    IN_BACKGROUND,
    NOISE_DRIVEN,
    Line,
    LineTable,
    SeedLine,
)
from microvib.units import pretty

Verdict = Literal["pass", "fail", "not judged"]
NoVerdict = Literal[""]
"""In place of a verdict where no limit was given."""
MIN_RELATIVE_ERROR = 1e-3
"""Least relative error of an amplitude from integration and line fit (docs/numerics.md); a table
may know a larger one.
"""
CLOCK_UNCERTAINTY = 1e-4
"""Part by which a clock or speed may be off; assumed."""
FREQUENCY_SIGMAS = 4.0
"""Standard uncertainties of a frequency within which a line may be on either side of an end of a
band: 99.99 %.
"""
MIN_ERROR_REFERENCE_RATIO = 0.25
"""Part of the largest line to which an error of integration is relative at the least: it does not
fall in proportion with a line that is far smaller than the motion about it."""
ABOVE_PASSBAND_FACTOR = 10.0
"""Factor on what is known by a model or a bin only: on lines of the linearised drive above the
passband, for what friction and detent torque add there, and on bins that several lines share."""
SHARED_BINS_FACTOR = 2.0
"""Factor by which a line may be larger or smaller than is found while the record is too short to
tell it from others of the clock."""
_HELD_DECAY = 0.5
"""Part of a mode's own decay below which what rings in its place is not the start's alone."""
RINGING_FACTOR = 0.1
"""Part of what rings in a record by which a line may change until that has died away: friction
couples them.
"""
GROWTH_FACTOR = 3.0
"""Factor on the amplitude of a line that grows within its record for what it may end with."""
_BOUND_FIT_FACTOR = 3.0
"""Factor on the amplitude of a line whose fit ended at a limit."""
_MIN_TRANSIENT_RATIO = 1.5
"""Times what noise alone gives a mode, above which its mean over draws holds something that decays."""
ONE_DRAW = "driven by noise, one draw of many"
SEEDS_NEEDED = 59
"""Draws from which their largest is, with 95 % confidence, no less than their 95 % quantile: the
least n with 0.95**n <= 0.05.
"""
_RAYLEIGH = 1.823
"""Standard deviations by which the 95 % quantile of an envelope of noise lies above its mean; that
of a line with noise on it, by less."""


def frequency_error_bound(frequency: Any, uncertainty: Any = 0.0) -> Any:
    """By how much frequencies [Hz] may be off, with standard ``uncertainty`` [Hz] or by their
    clocks; scalars or arrays.
    """
    return np.maximum(
        FREQUENCY_SIGMAS * np.nan_to_num(uncertainty), CLOCK_UNCERTAINTY * np.abs(frequency)
    )


def line_range(
    line: Line, table: LineTable, scenario: Scenario | None = None
) -> tuple[float, float]:
    """Range of frequencies [Hz] that a line may have.

    Parameters
    ----------
    line : Line
        The line.
    table : LineTable
        The lines of its record.
    scenario : Scenario, optional
        The drive. Its modes lie between their coupled and their clamped frequencies, as the shaft
        sticks for a part of the time.

    Returns
    -------
    tuple of float
        Lowest and highest frequency [Hz].
    """
    at = line.place
    off = float(frequency_error_bound(at, line.frequency_uncertainty))
    if line.status == NOISE_DRIVEN:  # other draws have it elsewhere in the mode's width
        off += (table.rest.resolution if table.rest else 0.0) + np.nan_to_num(line.decay) / math.pi
    nominal = nominal_frequency(line, table)
    low, high = min(at, nominal) - off, max(at, nominal) + off
    if scenario is None or not line.is_mode or line.status == "ok":
        return low, high
    for mode in coupled_modes(scenario):
        if mode.name == line.name:
            ends = (mode.frequency, mode.fixed_frequency or mode.frequency)
            return min(low, *ends), max(high, *ends)
    return low, high


def nominal_frequency(line: Line, table: LineTable) -> float:
    """Frequency [Hz] of a recorded line by the scenario's step clock: the drive may be off it, or the recorder, whose
    frequencies are then all wrong. Of a simulation the line's own.
    """
    if table.clock_ratio is None or table.clock_ratio_uncertainty == 0.0:
        return line.place
    return line.place / table.clock_ratio


def worst_verdict(verdicts: Iterable[Verdict | NoVerdict]) -> Verdict | NoVerdict:
    """The verdict on several things together: *fail* where one fails, *pass* only where none is *not
    judged*; empty where nothing was judged.
    """
    found = set(verdicts)
    worst_first: tuple[Verdict, ...] = ("fail", "not judged", "pass")
    return next((each for each in worst_first if each in found), "")


@dataclass(frozen=True)
class Margin:
    """One line against the limit."""

    line: Line
    amplitude: float
    """Judged amplitude [N m]: the line's amplitude, where it decays that at the start of the record,
    where it was not found what it may have at most."""
    factor: float
    """Limit over amplitude."""
    verdict: Verdict
    why: str = ""
    """Why it is not judged, and what would have to change."""
    limit: float = math.nan
    """The strictest limit within the uncertainty of the line's frequency [N m]."""
    by_state: bool = False
    """Whether it is not judged because of what the other wing's hinge may be like."""

    @property
    def decibel(self) -> float:
        """The factor in dB."""
        return 20.0 * math.log10(self.factor)

    @property
    def fails(self) -> bool:
        """Whether the amplitude is certainly above the limit."""
        return self.verdict == "fail"


def margin(
    line: Line, most: float, table: LineTable, ringing: Sequence[Line], scenario: Scenario | None
) -> Margin:
    """The verdict on one line against a limit [N m]: pass or fail where it is known well enough,
    whatever the record was.
    """
    seeds = table.over_seeds(line.name)
    if seeds is not None and _draws_decide(line, seeds):
        judged = _judge_seed_quantile(line, seeds, most, table.own_error)
    else:
        judged = _judge_record(line, most, table, ringing, scenario)
        if judged.verdict == "pass" and seeds is not None and math.isnan(seeds.p95_high):
            verdict, why = _judge_by_tolerance_bound(line, seeds, most)
            judged = judged._replace(verdict=verdict, why=why)
    if judged.verdict == "fail" and (why := ringing_reason(line, table, scenario)):
        judged = judged._replace(verdict="not judged", why=why)
    factor = most / judged.amplitude if judged.amplitude > 0.0 else math.inf
    why = f"{line.name} ({judged.why})" if judged.verdict == "not judged" else ""
    return Margin(line, judged.amplitude, factor, judged.verdict, why, most)


def unlisted_beside(
    line: Line, curve: LimitCurve, table: LineTable, scenario: Scenario | None
) -> str:
    """Reason why a line may hide another one that is above the limit: within the record's resolution
    the limit is stricter than where the line stands, and the line, with what it is not told apart
    from, is above that; empty where it is not so.

    With one number as limit, that line is judged by it itself.
    """
    if table.rest is None or not table.rest.resolution > 0.0:
        return ""
    low, high = line_range(line, table, scenario)
    reach = table.rest.resolution
    here, about = curve.strictest(low, high), curve.strictest(low - reach, high + reach)
    if not about < here or not curve.holds(0.5 * (low + high), 0.5 * (high - low)):
        return ""
    if line.seen and line.amplitude > here:  # which is above the limit itself
        return ""
    if not shared_amplitude_bound(line, table, scenario) > about:
        return ""
    return (
        f"lines within {reach:.3g} Hz of {line.name} at {line.place:.5g} Hz, where the limit falls"
        f" to {1e3 * about:.4g} m{pretty(table.unit)}, masked by it; increase record.duration"
    )


class _Judged(NamedTuple):
    """Amplitude that is judged [N m], verdict and reason."""

    amplitude: float
    verdict: Verdict
    why: str = ""


def _draws_decide(line: Line, seeds: SeedLine) -> bool:
    """Whether draws tell more than one record: of what noise drives, and of a steady line once they
    bound its quantile from above.
    """
    if line.status == NOISE_DRIVEN:
        return True
    return line.status in ("ok", BELOW_FLOOR) and math.isfinite(seeds.p95_high)


def _judge_record(
    line: Line, most: float, table: LineTable, ringing: Sequence[Line], scenario: Scenario | None
) -> _Judged:
    """The verdict of one record alone.

    What a line may be at most decides that it passes, whatever its status; only a line that neither
    decays nor is hidden can fail.
    """
    amplitude, error_bound = line.amplitude, amplitude_error_bound(line, table)
    if line.status == NOISE_DRIVEN:
        why = f"{ONE_DRAW}; --seeds N judges by its 95 % quantile"
        return _Judged(amplitude, "not judged", why)
    if line.status == BELOW_FLOOR:
        found = amplitude + error_bound if math.isfinite(amplitude) else 0.0
        largest = max(found, line.hidden)
        return _passes(largest, largest, most, "below the noise floor; increase record.duration")
    if why := _held_mode_reason(line, most, error_bound, table, scenario):
        return _Judged(amplitude, "not judged", why)
    if line.status in ("decaying", "growing"):
        start = line.amplitude_at_start(table.duration)
        largest = max(start, amplitude) + error_bound
        why = settling_advice(line, largest / most, scenario)
        if line.status == "growing":
            return _Judged(start, "not judged", why)
        return _passes(start, largest, most, why)
    if line.status != "ok":
        return _passes(amplitude, _BOUND_FIT_FACTOR * amplitude, most, line.status)
    if why := _shared_bins_reason(line, most, error_bound, table, scenario):
        return _Judged(amplitude, "not judged", why)
    return _judge_beside_ringing(line, most, table, ringing, scenario)


def _held_mode_reason(
    line: Line, most: float, error_bound: float, table: LineTable, scenario: Scenario | None
) -> str:
    """Why a mode is not passed that falls more slowly than its damping says, before its ringing has died
    away; empty where it is not so, or the limit is far from what is found.

    Something lasts there, the ringing beats with it, and the record may be of a part where they cancel.
    """
    if scenario is None or not line.is_mode or line.status not in ("ok", "decaying"):
        return ""
    largest = max(line.amplitude, line.amplitude_at_start(table.duration))
    if line.amplitude > most or SHARED_BINS_FACTOR * largest + error_bound <= most:
        return ""
    mode = next((m for m in coupled_modes(scenario) if m.name == line.name), None)
    if mode is None or not may_still_ring(mode, scenario):
        return ""
    own = decay_in_motion(mode, scenario)
    if own <= 0.0 or line.decay >= _HELD_DECAY * own:
        return ""
    settled = time_to_settle(scenario)
    wanted = scenario.record.settle - settled + SETTLED_EFOLDINGS / own
    return (
        "it falls more slowly than its damping says, and may hold a line that lasts and what rings from"
        f" the start, one against the other; record.settle >= {rounded_up(wanted)} s"
    )


def _passes(amplitude: float, largest: float, most: float, why: str) -> _Judged:
    """A pass where what a line may be at most, ``largest``, is within the limit."""
    return _Judged(amplitude, "pass" if largest <= most else "not judged", why)


def _judge_beside_ringing(
    line: Line, most: float, table: LineTable, ringing: Sequence[Line], scenario: Scenario | None
) -> _Judged:
    """A steady line beside what rings in its record.

    Until that has died away friction may change this line by a part of it: the limit must be
    farther off than that, too.
    """
    amplitude = line.amplitude
    falling = [x for x in ringing if x.status != NOISE_DRIVEN]
    rings = sum(
        x.amplitude if x.status == NOISE_DRIVEN else x.amplitude_at_start(table.duration)
        for x in ringing
    )
    clear = abs(amplitude - most) - amplitude_error_bound(line, table)
    stirred = _ringing_factor(scenario) * min(rings, amplitude)
    stirred = max(stirred, _parted_by_ringing(line, table, scenario))
    if clear >= stirred:
        return _Judged(amplitude, "fail" if amplitude > most else "pass")
    if clear <= 0.0:
        return _Judged(amplitude, "not judged", "within its uncertainty of the limit")
    remedy = "a longer record.settle" if not rings else "--seeds N"
    if falling:
        slowest = min(falling, key=lambda x: x.decay)
        remedy = settling_advice(slowest, stirred / clear, scenario)
    why = f"too close to the limit to judge until the transient has decayed; {remedy}"
    return _Judged(amplitude, "not judged", why)


def _parted_by_ringing(line: Line, table: LineTable, scenario: Scenario | None) -> float:
    """Sum of the unlisted lines about a line of the clock [N m], while a mode may ring, which none
    does in a steady state.

    Friction, backlash and hysteresis part a line into side lines by what rings; as that dies away
    they go back into it.
    """
    if scenario is None or not line.of_clock or not scenario.driving_frequency:
        return 0.0
    if any(x.status == TRANSIENT for x in table):
        return 0.0
    if not any(may_still_ring(mode, scenario) for mode in coupled_modes(scenario)):
        return 0.0
    reach = 0.5 * scenario.driving_frequency
    return sum(
        x.amplitude
        for x in table
        if x.kind == "other" and x.seen and abs(x.place - line.place) < reach
    )


def _ringing_factor(scenario: Scenario | None) -> float:
    """Part of what rings by which a line may change: with backlash, by all of it."""
    if scenario is not None and scenario.reducer.backlash:
        return 1.0
    return RINGING_FACTOR


def _shared_bins_reason(
    line: Line, most: float, error_bound: float, table: LineTable, scenario: Scenario | None
) -> str:
    """Why a line is not judged that the record is too short to tell from another, listed or not;
    empty where its limit is far from what is found, or it has its bins for itself.
    """
    if scenario is None or table.rest is None:
        return ""
    if SHARED_BINS_FACTOR * line.amplitude + error_bound <= most:
        return ""
    if beside := _ringing_beside(line, table):
        return (
            f"not resolved from {beside.name} at {beside.place:.5g} Hz, which is not a "
            "clock line; increase record.duration or record.settle"
        )
    if line.of_clock and line.amplitude - error_bound > SHARED_BINS_FACTOR * most:
        return ""
    return _unresolved_from(line, table, table.rest.resolution, scenario)


def _ringing_beside(line: Line, table: LineTable) -> Line | None:
    """A tone that the clock does not make, not much smaller than a ``line`` and closer to it than
    the record resolves: what both have in the bins that they share may be the tone's alone.
    """
    if table.rest is None:
        return None
    for x in table:
        close = x is not line and abs(x.place - line.place) < table.rest.resolution
        if close and x.seen and not x.of_clock and x.amplitude > 0.1 * line.amplitude:
            return x
    return None


def _unresolved_from(line: Line, table: LineTable, resolution: float, scenario: Scenario) -> str:
    """Other lines that may lie within the ``resolution`` [Hz] of a line and what would tell them apart:
    a line of the clock, or a mode that may still ring and is not seen; empty without one.
    """
    if line.of_clock:
        nominal, frequency_error = line.expected, 0.0
    else:
        nominal = line.place / (table.clock_ratio or 1.0)
        frequency_error = float(frequency_error_bound(line.place, line.frequency_uncertainty))
    apart = distance_to_clock_line(scenario, nominal, frequency_error)
    if apart < resolution:
        longer = rounded_up(SEPARATION / apart)
        return f"not resolved from a clock line; record.duration >= {longer} s"
    if mode := _unseen_mode_beside(line, table, scenario):
        return f"not resolved from {mode}, which may still ring; increase record.settle"
    return ""


def shared_amplitude_bound(line: Line, table: LineTable, scenario: Scenario | None) -> float:
    """Upper bound [N m] of a line together with those that the record is too short to resolve from it."""
    largest = largest_amplitude(line, table)
    if scenario is None or table.rest is None or not largest > 0.0:
        return largest
    if _unresolved_from(line, table, table.rest.resolution, scenario):
        return SHARED_BINS_FACTOR * largest
    return largest


def amplitude_error_bound(line: Line, table: LineTable) -> float:
    """By how much an amplitude may be off [N m]: twice its spread over records and draws, and the
    integration's error.
    """
    seeds = table.over_seeds(line.name)
    if seeds:
        drawn = seeds.deviation
    else:
        drawn = line.noise_scatter
    known = (x if math.isfinite(x) else 0.0 for x in (line.amplitude_uncertainty, drawn))
    size = max(line.amplitude, MIN_ERROR_REFERENCE_RATIO * table.largest)
    return 2.0 * math.hypot(*known) + max(MIN_RELATIVE_ERROR, table.own_error) * size


def largest_amplitude(line: Line, table: LineTable) -> float:
    """Upper bound of a line in the record and, where it decays, at its start [N m]; 0 of one
    without a figure that another line hides, and infinite where it grows.
    """
    if line.status == "growing":
        return math.inf
    if line.status == CANCELLED:
        return amplitude_bound(line)
    if not math.isfinite(line.amplitude):
        return line.hidden
    size = max(line.amplitude, line.amplitude_at_start(table.duration))
    return max(size + amplitude_error_bound(line, table), line.hidden)


def settling_advice(line: Line, too_large: float, scenario: Scenario | None) -> str:
    """Advice on a tone that is ``too_large`` by this factor until it has decayed."""
    if line.status == "growing":
        return "it grows within the record"
    longer = math.log(max(too_large, 1.0)) / line.decay
    if scenario is None:
        return f"not settled for another {rounded_up(longer)} s"
    return f"not settled; record.settle >= {rounded_up(scenario.record.settle + longer)} s"


def _judge_seed_quantile(line: Line, seeds: SeedLine, most: float, own_error: float) -> _Judged:
    """The verdict where many draws of the noise were run, by their 95 % quantile."""
    relative_error = max(MIN_RELATIVE_ERROR, own_error)
    largest = max(seeds.p95_high, seeds.hidden) * (1.0 + relative_error)
    if seeds.mean > _MIN_TRANSIENT_RATIO * line.noise_mean:
        return _Judged(
            seeds.p95,
            "not judged",
            "larger than the noise accounts for, possibly the start-up transient; increase"
            " record.settle",
        )
    if largest <= most:
        return _Judged(seeds.p95, "pass")
    if seeds.p95_low * (1.0 - relative_error) > most:
        return _Judged(seeds.p95, "fail")
    high, needed = f"{1e3 * seeds.p95_high:.4g} mN m", f"more seeds than {seeds.draws}"
    if math.isnan(seeds.p95_high):
        high, needed = "an unknown amplitude", f"{SEEDS_NEEDED} seeds or more"
    why = f"its 95 % quantile lies between {1e3 * seeds.p95_low:.4g} mN m and {high}; {needed}"
    if seeds.p95_high * (1.0 + relative_error) <= most:
        why = "below the noise floor in some draws; increase record.duration"
    elif most < seeds.p95_low or seeds.p95_high <= most:
        why = (
            f"its 95 % quantile lies between {1e3 * seeds.p95_low:.4g} mN m and {high} over the"
            " draws, and the integration may"
            f" be off by {100.0 * relative_error:.2g} %; a larger solver.refinement"
        )
    return _Judged(seeds.p95, "not judged", why)


def _judge_by_tolerance_bound(line: Line, seeds: SeedLine, most: float) -> tuple[Verdict, str]:
    """Verdict and reason of a line that passes by its record, where fewer draws were run than bound
    its quantile by their largest.

    Their mean and scatter bound it with the same confidence, as a tolerance bound of a normal
    distribution does: by many deviations where the draws are few.
    """
    from scipy.stats import nct  # slow to import, and seldom needed

    n = seeds.draws
    if n < 2:
        return (
            "not judged",
            f"found in {n} noise draw, too few to bound it; use at least {SEEDS_NEEDED} seeds",
        )
    reach = float(nct.ppf(0.95, n - 1, _RAYLEIGH * math.sqrt(n))) / math.sqrt(n)
    largest = seeds.mean + reach * seeds.deviation
    if max(largest, seeds.hidden) <= most:
        return "pass", ""
    why = (
        f"{n} draws of the noise bound its 95 % quantile to no better than {1e3 * largest:.4g} mN"
        f" m; use at least {SEEDS_NEEDED} seeds"
    )
    return "not judged", why


def amplitude_bound(line: Line) -> float:
    """Upper bound [N m] of a line without an estimated amplitude of its own: what its floor hides, or
    ABOVE_PASSBAND_FACTOR times the bin that it shares with others, for there they may cancel in
    part; infinite where the force table distorts it.
    """
    if line.status == IN_BACKGROUND:
        return background_bound(line)
    if line.status in DISTORTED:
        return math.inf
    if line.hidden > 0.0:
        return line.hidden
    return ABOVE_PASSBAND_FACTOR * line.bin_amplitude


def background_bound(line: Line) -> float:
    """Upper bound [N m] of what the drive has in a line of the background: the recorded amplitude and
    the background's, which may cancel in part, with three standard uncertainties of the first.
    """
    variance = line.amplitude_uncertainty**2 - 0.5 * line.background**2  # as with_background adds
    return line.amplitude + line.background + 3.0 * math.sqrt(max(variance, 0.0))


def may_ring(line: Line, table: LineTable, scenario: Scenario | None) -> bool:
    """Whether a line rings after the start and dies away, or may do so.

    A mode whose decay the record is too short to show does, and what lies within its resolution,
    until it has died away by its damping.
    """
    if line.of_clock or line.status == NOISE_DRIVEN:
        return False
    if scenario is None or line.status != "ok":
        return line.status != "ok"
    near = SEPARATION / table.duration
    modes = [
        m
        for m in coupled_modes(scenario)
        if m.name == line.name or abs(m.frequency - line.frequency) < near
    ]
    return any(may_still_ring(m, scenario) for m in modes)


def ringing_reason(line: Line, table: LineTable, scenario: Scenario | None) -> str:
    """Why a line that is found steady may ring all the same, and dies away later; empty where it
    lasts.
    """
    if line.status != "ok" or scenario is None or any(x.status == TRANSIENT for x in table):
        return ""
    if may_ring(line, table, scenario):
        return "may be a decaying array mode, which the record is too short to resolve; increase record.settle"
    if line.of_clock and (mode := _unseen_mode_beside(line, table, scenario)):
        return f"not resolved from {mode}, which may still ring; increase record.settle"
    if _may_be_locked(line, scenario):
        return "may be a mode that rings at an order of the clock in the backlash; increase record.settle"
    return ""


def _may_be_locked(line: Line, scenario: Scenario) -> bool:
    """Whether a line may be a mode's ringing that the backlash holds at an order of the clock until
    all else has died away: an electrical line, which nothing forces where the driver has no errors.
    """
    if not scenario.reducer.backlash or scenario.driver.distorted or line.kind != "electrical":
        return False
    return any(may_still_ring(mode, scenario) for mode in coupled_modes(scenario))


def _unseen_mode_beside(line: Line, table: LineTable, scenario: Scenario) -> str:
    """The mode within a record's resolution of a line that may still ring and is not seen; empty
    without one.
    """
    if table.rest is None:
        return ""
    near = table.rest.resolution
    modes = unseen_ringing_modes(table, scenario)
    return next((m.name for m in modes if abs(m.frequency - line.place) < near), "")


def unseen_ringing_modes(
    table: LineTable, scenario: Scenario, efoldings: float = SETTLED_EFOLDINGS
) -> list[CoupledMode]:
    """Modes that may still ring after the start, which have not yet decayed by so many
    ``efoldings``, and of which the record shows nothing.
    """
    seen = {x.name for x in table if x.seen}
    return [
        mode
        for mode in coupled_modes(scenario)
        if mode.name not in seen and may_still_ring(mode, scenario, efoldings)
    ]
