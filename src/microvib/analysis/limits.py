"""Lines of a run against a limit: pass, fail, or not judged, and then what would have to change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.accuracy import (
    FINEST_ESTIMATED,
    can_be_refined,
    failed_invariants_reason,
    with_known_error,
)
from microvib.analysis.lines import clock_warnings, intermittency_cause
from microvib.analysis.margins import (
    ABOVE_PASSBAND_FACTOR,
    CLOCK_UNCERTAINTY,
    GROWTH_FACTOR,
    ONE_DRAW,
    SEEDS_NEEDED,
    Margin,
    Verdict,
    amplitude_bound,
    frequency_error_bound,
    margin,
    settling_advice,
    shared_amplitude_bound,
    unseen_ringing_modes,
)
from microvib.analysis.noise import noise_margins, with_other_draws
from microvib.analysis.start import (
    RecordGap,
    mode_has_decayed,
    record_gap,
    rounded_up,
    steady_start_advice,
)
from microvib.analysis.steadiness import may_be_larger
from microvib.analysis.unseen import out_of_band_lines
from microvib.analysis.usable import undecided_reason, unusable_gaps
from microvib.errors import OptionError, expect
from microvib.model.line_names import CONTROL_MODE, SECOND_DRIVE, LineName, of_second_wing
from microvib.model.record import PASSBAND
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import IN_BACKGROUND, NOISE_DRIVEN, Line, LineTable
from microvib.text_tables import counted
from microvib.units import Band, GivenQuantity, Si, band, pretty, quantity, within_band

_SETTLED_RATIO = 0.01
"""Fraction of the largest steady line below which ringing counts as settled."""
_FAR_ABOVE_RECORD = 10.0
"""Times the largest line of a record above which a limit is passed although modes that the record
does not resolve may ring."""
_STRONG_RINGING_EFOLDINGS = 3.0
"""Within which a mode rings with more than a twentieth of what it began with, and friction may make
lines of that."""
_FULL_BAND = Si(0.0), Si(math.inf)
"""The band of all frequencies [Hz]."""


@dataclass(frozen=True, init=False)
class Limit:
    """Largest amplitude, 0-to-peak, that a line of a torque may have between two frequencies.

    Parameters
    ----------
    torque : str or Si
        The amplitude, such as ``"10 mN*m"``.
    low, high : str or Si, optional
        Ends of the band in which it holds, such as ``"0.5 Hz"`` and ``"150 Hz"``; without them it
        holds at all frequencies.

    Raises
    ------
    OptionError
        For a bare number, and for what is no limit or band.

    Examples
    --------
    >>> import microvib as mv
    >>> mv.Limit("10 mN*m", "0.5 Hz", "150 Hz")
    Limit of 10 mN m from 0.5 to 150 Hz
    """

    torque: float
    low: float
    high: float

    def __init__(
        self,
        torque: GivenQuantity,
        low: GivenQuantity = _FULL_BAND[0],
        high: GivenQuantity = _FULL_BAND[1],
    ) -> None:
        object.__setattr__(self, "torque", quantity("torque", torque, "N*m", positive=True))
        for name, end in zip(("low", "high"), band((low, high)), strict=True):
            object.__setattr__(self, name, end)

    @classmethod
    def of(cls, limit: GivenQuantity | None, ends: Band | None) -> Limit | None:
        """Make the limit that a torque and the band state in which it holds.

        Parameters
        ----------
        limit : str, Si or None
            Largest amplitude, such as ``"10 mN*m"``; None for no limit.
        ends : str or pair, optional
            The band, ``"0.5:150 Hz"`` or both ends.

        Returns
        -------
        Limit or None
            None without a limit.

        Raises
        ------
        OptionError
            For a band without a limit, and for what is no limit or band.
        """
        if limit is None:
            if ends is not None:
                raise OptionError(
                    "band",
                    "is the band of a limit; give the limit too, such as '10 mN*m'",
                    remedy="limit",
                )
            return None
        torque = quantity("limit", limit, "N*m", positive=True)
        return cls(torque, *(() if ends is None else band(ends)))

    def __repr__(self) -> str:
        return f"Limit of {1e3 * self.torque:.4g} mN m {self.band or 'at all frequencies'}"

    @property
    def band(self) -> str:
        """The band in words; empty if the limit holds for all frequencies."""
        if math.isfinite(self.high):
            return f"from {self.low:g} to {self.high:g} Hz"
        if self.low > 0.0:
            return f"from {self.low:g} Hz"
        return ""

    def holds(self, frequency: float, tolerance: float = 0.0) -> bool:
        """Tell whether the limit holds at a frequency; the ends of the band belong to it.

        Parameters
        ----------
        frequency : float
            Frequency [Hz].
        tolerance : float
            To what it is known [Hz].

        Returns
        -------
        bool
            Whether the frequency may lie in the band.
        """
        return within_band(frequency, self.low, self.high, tolerance)


@dataclass(frozen=True)
class Judgement:
    """All lines within the band against the limit, the smallest margin first, and what could not be
    judged.

    The limit is passed only if everything in its band was looked at, and failed if a line is above
    it.
    """

    limit: Limit
    margins: tuple[Margin, ...]
    unknown: tuple[Line, ...]
    """Lines without a known amplitude."""
    gaps: tuple[str, ...] = ()
    """Ranges of the band that were not judged, why, and what would have to change; a sentence without a
    stop each.
    """

    @property
    def verdict(self) -> Verdict:
        """The verdict on all together."""
        if self.above:
            return "fail"
        if self.gaps:
            return "not judged"
        return "pass"

    @property
    def above(self) -> int:
        """How many lines are above the limit."""
        return sum(m.fails for m in self.margins)

    @property
    def worst(self) -> Margin | None:
        """The smallest margin that is judged; None without one."""
        return next((m for m in self.margins if m.verdict != "not judged"), None)

    def of(self, line: Line) -> Margin | None:
        """Margin of one line; None where it was not judged."""
        return next((m for m in self.margins if m.line.name == line.name), None)

    def __repr__(self) -> str:
        return f"{self}\n  {counted(len(self.margins), 'line')} judged, {len(self.unknown)} without an amplitude"

    def __str__(self) -> str:
        if self.limit.band:
            band = f" {self.limit.band}"
        else:
            band = ""
        head = f"Limit {1e3 * self.limit.torque:.4g} mN m{band}: "
        if not self.margins and not self.gaps:
            return f"{head}pass; there is no line{band}."
        if self.above:
            verdict = f"FAIL, {self.above} of {len(self.margins)} lines above"
        else:
            verdict = self.verdict
        return f"{head}{verdict}{self._worst()}.{self.not_judged()}"

    def not_judged(self, most: int = 3) -> str:
        """Ranges and lines not judged, as a sentence; empty if there is nothing."""
        if not self.gaps:
            return ""
        if len(self.gaps) > most:
            more = f"; and {len(self.gaps) - most} more"
        else:
            more = ""
        return f" Not judged: {'; '.join(self.gaps[:most])}{more}."

    def _worst(self) -> str:
        worst = self.worst
        if worst is None or math.isinf(worst.factor):
            return ""
        if self.verdict != "not judged":
            what = "smallest margin"
        else:
            what = "smallest margin judged"
        return f"; {what} {worst.decibel:+.1f} dB, factor {worst.factor:.3g} ({worst.line.name})"


def judge(
    table: LineTable,
    limit: Limit,
    scenario: GivenScenario | None = None,
    second: LineTable | None = None,
) -> Judgement:
    """Judge every line of a table against a limit, also those too small for a report, and what the
    table does not list.

    Lines of a motion whose invariants do not hold neither pass nor fail. Nor do lines of which it
    is not known how far they are off by the integration. The first verdict on lines of a simulation
    that nobody has asked that yet finds it out, by runs with finer steps (``accuracy``), which takes
    longer than the simulation.

    Parameters
    ----------
    table : LineTable
        Lines of a torque.
    limit : Limit
        Largest amplitude, and the band in which it holds.
    scenario : Scenario, str or path, optional
        Scenario of the table: says what may be above the passband and how long a start rings.
        Without it, nothing above the passband is judged.
    second : LineTable, optional
        Lines of the second wing's drive where the scenario has one that is driven, which are judged
        too.

    Returns
    -------
    Judgement
        The verdict, ``"pass"``, ``"fail"`` or ``"not judged"``, the margin of each line, and what
        was not judged and why.

    Raises
    ------
    OptionError
        For lines that are not of a torque.
    ObjectError
        For what is no table or no limit.

    Examples
    --------
    >>> import microvib as mv
    >>> table = mv.find_lines("state-1", start="steady")
    >>> mv.judge(table, mv.Limit("60 mN*m", "0.5 Hz", "150 Hz"), "state-1").verdict
    'pass'
    """
    expect(table, LineTable, "a table of lines (mv.find_lines)")
    expect(limit, Limit, "a limit, such as mv.Limit('10 mN*m')")
    if scenario is not None:
        scenario = as_scenario(scenario)
    if table.unit != "N*m":
        raise OptionError(
            "limit",
            f"is a torque, and these lines are in {pretty(table.unit)}; lines of a torque are"
            " expected",
        )
    table = with_known_error(table)
    within = [x for x in table if limit.holds(*_frequency_with_bound(x)) and x.status != TRANSIENT]
    ringing = [x for x in table if x.status in ("decaying", NOISE_DRIVEN)]
    known = [x for x in within if math.isfinite(x.amplitude)]
    each = (_margin(x, limit, table, ringing, scenario) for x in known)
    of_noise = noise_margins(table, limit.torque, (limit.low, limit.high), scenario)
    margins = sorted(
        [*(_certainly_within(one, limit) for one in each), *of_noise], key=lambda m: m.factor
    )
    unknown = tuple(x for x in within if not math.isfinite(x.amplitude))
    record = record_gap_of_table(table, scenario)
    gaps = [
        *([] if record is None else [record.why]),
        *(m.why for m in margins if m.verdict == "not judged"),
        *_hidden_line_gaps(unknown, limit, scenario),
        *_record_gaps(table, limit, scenario),
    ]
    why = failed_invariants_reason(table.broken, scenario) or unknown_error_reason(table, scenario)
    if why:
        gaps = [why, *gaps]
    for reason in filter(None, (why, _not_turning_reason(table, scenario))):
        margins = [_undecided(m, reason) for m in margins]
    if record is not None:
        margins = [_unless_overstated(m, record) for m in margins]
    judged = Judgement(limit, tuple(margins), unknown, tuple(gaps))
    if scenario is None or scenario.driven_wing is None:
        return judged
    return _combine_drives(judged, second, scenario.driven_wing.alone)


def _margin(
    line: Line,
    limit: Limit,
    table: LineTable,
    ringing: Sequence[Line],
    scenario: Scenario | None,
) -> Margin:
    """The margin of a line, undecided where other draws of the noise may change it, or the force
    table does not show it as it is.
    """
    found = margin(line, limit.torque, table, ringing, scenario)
    found = with_other_draws(found, limit.torque, table, scenario)
    if line.status == IN_BACKGROUND:
        return _margin_in_background(line, limit)
    why = undecided_reason(line)
    if why:
        return _undecided(found, why)
    return found


def _margin_in_background(line: Line, limit: Limit) -> Margin:
    """The margin of what the drive may have in a line of the background: the recorded amplitude and the
    background's, which may cancel in part, with three standard uncertainties. It never fails.
    """
    most = line.amplitude + line.background + 3.0 * line.amplitude_uncertainty
    found = Margin(line, most, limit.torque / most, "pass")
    if most <= limit.torque:
        return found
    return _undecided(found, line.status)


def _hidden_line_gaps(
    unknown: Sequence[Line], limit: Limit, scenario: Scenario | None
) -> Iterator[str]:
    """Lines without an amplitude that may be above the limit."""
    for line in unknown:
        if not (mode_has_decayed(line, scenario) or _is_negligible(line, limit)):
            yield f"{line.name} ({line.status})"


def _record_gaps(table: LineTable, limit: Limit, scenario: Scenario | None) -> Iterator[str]:
    """Gaps that a record leaves besides its lines."""
    yield from _residual_peak_gaps(table, limit, scenario)
    yield from _beside_band_gaps(table, limit, scenario)
    yield from _unresolved_ringing_gaps(table, limit, scenario)
    yield from _growing_line_gaps(table, limit)
    if table.clock_ratio_uncertainty != 0.0:  # a recording's, whose clock was looked for
        yield from clock_warnings(table)
    yield from may_be_larger(table, limit.low, limit.high, limit.torque)
    yield from unusable_gaps(table, limit.low, limit.high)
    if scenario is not None and scenario.rate is None:
        yield (
            "lines of the step clock, because the rate changes during the record (use a record at"
            " constant rate)"
        )
    yield from _above_passband(table, limit, scenario)


def _undecided(margin: Margin, why: str) -> Margin:
    """The margin of a line that neither passes nor fails."""
    return replace(margin, verdict="not judged", why=f"{margin.line.name} ({why})")


def _unless_overstated(one: Margin, record: RecordGap) -> Margin:
    """The margin of a line; of one above the limit that a longer record may bring below it, not
    judged.
    """
    if one.verdict == "fail" and one.factor * record.overstated >= 1.0:
        return _undecided(one, "smaller over a longer record, perhaps")
    return one


def unknown_error_reason(table: LineTable, scenario: Scenario | None) -> str:
    """Why nothing is known of lines whose error is not; empty where it is."""
    if not math.isnan(table.own_error):
        return ""
    if scenario is not None and not can_be_refined(scenario):
        return (
            "the whole motion, because the error of its integration is not known: no run with finer"
            f" steps is possible (solver.refinement={FINEST_ESTIMATED} or less)"
        )
    return (
        "the whole motion, because the error of its integration is not known, nor the state that it"
        " began in (simulate it again: mv.run_scenario)"
    )


def _frequency_with_bound(line: Line) -> tuple[float, float]:
    """Frequency of a line, found or expected, and to what it is known [Hz]."""
    return line.place, float(frequency_error_bound(line.place, line.frequency_uncertainty))


def _combine_drives(first: Judgement, table: LineTable | None, scenario: Scenario) -> Judgement:
    """The judgement of two drives on one craft, the second's lines called so."""
    if table is None:
        return replace(
            first, gaps=(*first.gaps, "the second wing's drive, whose lines are not here")
        )
    second = judge(table, first.limit, scenario)

    def called(line: Line) -> Line:
        return replace(line, name=of_second_wing(line.name))

    theirs = (replace(m, line=called(m.line)) for m in second.margins)
    margins = sorted([*first.margins, *theirs], key=lambda m: m.factor)
    unknown = (*first.unknown, *map(called, second.unknown))
    gaps = (*first.gaps, *(f"{SECOND_DRIVE} {gap}" for gap in second.gaps))
    return replace(first, margins=tuple(margins), unknown=unknown, gaps=gaps)


def transient_warnings(table: LineTable, scenario: Scenario) -> list[str]:
    """Sentences: an array that does not turn yet, a record of a part of a slow cycle, and tones that
    decay from above a hundredth of the largest steady line.
    """
    largest = max((x.amplitude for x in table if x.status == "ok"), default=math.inf)
    starts = [(x, x.amplitude_at_start(table.duration)) for x in table if x.status == "decaying"]
    held = _not_turning_reason(table, scenario)
    told = [f"{held[0].upper()}{held[1:]}."] if held else []
    told += filter(None, [part_of_cycle_note(table, scenario)])
    told += [_noise_line_note(x, table) for x in table if x.status == NOISE_DRIVEN and x.is_mode]
    return told + [
        f"{x.name} decays, {1e3 * start:.4g} mN m at the start of the record and"
        f" {1e3 * x.amplitude:.4g} mN m on average:"
        f" {settling_advice(x, start / (_SETTLED_RATIO * largest), scenario)} to fall to a"
        " hundredth of the largest steady"
        f" line{steady_start_advice(scenario)}."
        for x, start in starts
        if start > _SETTLED_RATIO * largest
    ]


def record_gap_of_table(table: LineTable, scenario: Scenario | None) -> RecordGap | None:
    """Reason why the record of a table does not show the lines of tracking; None in a steady state."""
    if any(x.status == TRANSIENT for x in table):
        return None
    simulated = table.clock_ratio_uncertainty == 0.0
    return record_gap(scenario, table.duration, simulated=simulated)


def part_of_cycle_note(table: LineTable, scenario: Scenario | None) -> str:
    """Sentence on a record that holds a part of what changes the drive slowly; else empty."""
    gap = record_gap_of_table(table, scenario)
    if gap is None or gap.overstated == 1.0:
        return ""
    return f"These lines hold at the angles of the record alone; not known are {gap.why}."


def _not_turning_reason(table: LineTable, scenario: Scenario | None) -> str:
    """Why a run's lines are not those of tracking, because the array does not turn; empty where it
    does.
    """
    gap = record_gap_of_table(table, scenario)
    return "" if gap is None or gap.turns else gap.why


def _noise_line_note(line: Line, table: LineTable) -> str:
    """Note on a line of which the record is one draw."""
    seeds = table.over_seeds(line.name)
    if seeds is not None:
        told = (
            f"{line.name}: {NOISE_DRIVEN}; over {seeds.draws} seeds {1e3 * seeds.mean:.4g} ±"
            f" {1e3 * seeds.deviation:.2g} mN m"
        )
        if math.isnan(seeds.p95_high):
            return f"{told}; too few draws to bound the 95 % quantile: at least {SEEDS_NEEDED} are needed."
        return f"{told}, 95 % of them below {1e3 * seeds.p95:.4g} mN m."
    if math.isfinite(line.noise_mean):
        alone = (
            f" the linearised drive gives {1e3 * line.noise_mean:.3g} ±"
            f" {1e3 * line.noise_deviation:.2g} mN m by noise alone,"
            f" 95 % of the draws below {1e3 * line.noise_p95:.3g} mN m;"
        )
    else:
        alone = ""
    return f"{line.name}: {ONE_DRAW};{alone} --seeds N runs others."


def _residual_peak_gaps(table: LineTable, limit: Limit, scenario: Scenario | None) -> list[str]:
    """Peaks above the limit that are not lines of the table."""
    if table.rest is None:
        return ["no search was made for lines outside the table"]
    frequency, amplitude = table.rest.within(limit.low, limit.high)
    peak = f"up to {1e3 * amplitude:.4g} mN m at {frequency:.5g} Hz"
    more = "more members of each family, --harmonics N, or a longer record.duration"
    told = []
    if amplitude > limit.torque:
        told.append(f"unexplained peaks, {peak} ({more})")
    elif table.rest.factor * amplitude > limit.torque:
        told.append(
            f"unexplained peaks, {peak}, where a line may have {table.rest.factor:g} times as much"
            f" ({more})"
        )
    if told and (varies := intermittency_cause(scenario, table)):
        told = [
            f"lines of a part of the time, as {varies} changes the drive, and peaks without a line,"
            f" up to {1e3 * table.rest.factor * amplitude:.4g} mN m at {frequency:.5g} Hz"
        ]
    lowest = float(table.rest.frequency.min(initial=math.inf))
    if limit.low < lowest and ABOVE_PASSBAND_FACTOR * table.rest.slow > limit.torque:
        if math.isfinite(lowest):
            ends = f"below {lowest:.3g} Hz"
        else:
            ends = "between its mean and its highest frequency"
        told.append(
            f"anything {ends}, for which the record is too short (increase record.duration)"
        )
    return told


def _beside_band_gaps(table: LineTable, limit: Limit, scenario: Scenario | None) -> Iterator[str]:
    """Lines above the limit beside its band, which may hide others in the band: the record is too
    short to tell them apart.
    """
    if table.rest is None:
        return
    beside = [(max(limit.low - x.place, x.place - limit.high), x) for x in table]
    near = [
        (apart, x)
        for apart, x in beside
        if 0.0 < apart < table.rest.resolution
        and not limit.holds(*_frequency_with_bound(x))
        and shared_amplitude_bound(x, table, scenario) > limit.torque
    ]
    if near:
        apart, line = min(near, key=lambda one: one[0])
        yield (
            f"lines in the band masked by {line.name} at {line.place:.5g} Hz"
            f" (record.duration >= {rounded_up(SEPARATION / apart)} s)"
        )


def _unresolved_ringing_gaps(
    table: LineTable, limit: Limit, scenario: Scenario | None
) -> Iterator[str]:
    """Modes that may ring, slower than the record resolves, where there is friction: it makes other
    lines of their motion, which come and go with it.
    """
    if scenario is None or table.rest is None:
        return
    if max(scenario.friction.largest_torque, scenario.motor.friction.largest_torque) == 0.0:
        return
    if limit.torque > _FAR_ABOVE_RECORD * table.largest:
        return
    for mode in unseen_ringing_modes(table, scenario, _STRONG_RINGING_EFOLDINGS):
        # Attitude control hardly moves the shaft against its friction.
        by_control = LineName.parse(mode.name).family == CONTROL_MODE
        if mode.frequency < table.rest.resolution and not by_control:
            yield (
                f"friction lines excited by {mode.name}, which may still ring and which the"
                " record is too short to show; record.duration >="
                f" {rounded_up(SEPARATION / mode.frequency)} s, or a longer record.settle"
            )


def _growing_line_gaps(table: LineTable, limit: Limit) -> Iterator[str]:
    """Lines outside the band that grow: nothing bounds their multiples, which grow with them."""
    for x in table:
        outside = not limit.holds(*_frequency_with_bound(x))
        if x.status == "growing" and outside and GROWTH_FACTOR * x.amplitude > limit.torque:
            yield f"lines caused by {x.name}, which grows within the record (increase record.settle)"


def _certainly_within(one: Margin, limit: Limit) -> Margin:
    """The margin of a line; of an unlisted one above the limit that was found outside the band and
    may be in it, not judged.
    """
    line = one.line
    clock = CLOCK_UNCERTAINTY * line.place
    if one.verdict != "fail" or line.kind != "other" or limit.holds(line.place, clock):
        return one
    apart = max(limit.low - line.place, line.place - limit.high)
    why = (
        f"{line.name} (at {line.place:.5g} Hz, which may be in the band;"
        f" record.duration >= {rounded_up(SEPARATION / apart)} s)"
    )
    return replace(one, verdict="not judged", why=why)


def _above_passband(table: LineTable, limit: Limit, scenario: Scenario | None) -> list[str]:
    """Gap above the highest frequency examined."""
    top = PASSBAND * table.sample_rate
    if limit.high <= top:
        return []
    start = max(top, limit.low)
    if scenario is None:
        return [f"lines above {start:.4g} Hz (increase record.sample_rate)"]
    large = [
        (one, np.flatnonzero(one.most > limit.torque))
        for one in out_of_band_lines(scenario, table, start, limit.high)
        if np.any(one.most > limit.torque)
    ]
    if not large:
        return []
    highest = max(float(one.frequency[there[-1]]) for one, there in large)
    reaches = min(highest + 0.5 * (scenario.driving_frequency or 0.0), limit.high)
    first = dict(reversed([(one.what, one.frequency[there[0]]) for one, there in large]))
    named = "; ".join(
        f"{what} at {first[what]:.4g} Hz"
        for what in list(dict.fromkeys(one.what for one, _ in large))[:2]
    )
    return [
        f"lines above {start:.4g} Hz (record.sample_rate >= {rounded_up(reaches / PASSBAND)} Hz),"
        f" such as {named}"
    ]


def _is_negligible(line: Line, limit: Limit) -> bool:
    """Whether a line that others hide is small all the same."""
    return line.status.startswith("not separable") and amplitude_bound(line) <= limit.torque
