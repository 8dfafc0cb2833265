"""Lines of a run against a limit: pass, fail, or not judged, and then what would have to change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.accuracy import (
    FINEST_ESTIMATED,
    can_be_refined,
    failed_invariants_reason,
    with_known_error,
)
from microvib.analysis.both_drives import AddedTorque, drifting_lines
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
    background_bound,
    frequency_error_bound,
    line_range,
    margin,
    nominal_frequency,
    settling_advice,
    shared_amplitude_bound,
    unlisted_beside,
    unseen_ringing_modes,
    worst_verdict,
)
from microvib.analysis.noise import (
    noise_bounds,
    noise_margins,
    noise_of_record,
    with_other_draws,
)
from microvib.analysis.other_states import (
    SECOND_WING,
    OtherStates,
    other_states,
    slipping_reason_of_table,
)
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
from microvib.model.driver import motor_of_mean_spring
from microvib.model.hub_edge import HubEdge, hub_edge
from microvib.model.line_names import CONTROL_MODE, SECOND_DRIVE, LineName, of_second_wing
from microvib.model.record import PASSBAND
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import IN_BACKGROUND, NOISE_DRIVEN, Line, LineTable
from microvib.text_tables import counted
from microvib.units import pretty

_SETTLED_RATIO = 0.01
"""Fraction of the largest steady line below which ringing counts as settled."""
_FAR_ABOVE_RECORD = 10.0
"""Times the largest line of a record above which a limit is passed although modes that the record
does not resolve may ring."""
_STRONG_RINGING_EFOLDINGS = 3.0
"""Within which a mode rings with more than a twentieth of what it began with, and friction may make
lines of that."""
_MODULATION_INDEX = 0.2
"""Phase [rad] by which ringing may modulate a line, which is then smaller by 1 %."""
_BOTH_STEP = (
    "the torque with both drives stepping, as T_d is that of each while the other one stands (a limit of the"
    " loads, such as a column my_nm, judges both)"
)
_SECOND_UNKNOWN = "the second wing's drive, whose lines are not here (leave --lines-only out)"


@dataclass(frozen=True)
class Judgement:
    """All lines within the band against the limit, the smallest margin first, and what could not be
    judged.

    The limit is passed only if everything in its band was looked at, and failed if a line is above
    it. Where loads have limits of their own, they count as well.
    """

    limit: Limit
    margins: tuple[Margin, ...]
    unknown: tuple[Line, ...]
    """Lines without a known amplitude."""
    gaps: tuple[str, ...] = ()
    """Ranges of the band that were not judged, why, and what would have to change; a sentence without a
    stop each.
    """
    component: str = ""
    """Load on the spacecraft that the lines are of, such as ``Fx``; empty for the torque about the drive
    axis."""
    loads: tuple[Judgement, ...] = ()
    """Judgements of each load that has a limit of its own."""
    assumption: str = ""
    """State of a hinge in which the lines are those of the run, where it matters: a sentence."""

    @property
    def verdict(self) -> Verdict:
        """The verdict on all together."""
        return worst_verdict([self._own_verdict, *(one.verdict for one in self.loads)]) or "pass"

    @property
    def _own_verdict(self) -> Verdict:
        if self.above:
            return "fail"
        return "not judged" if self.gaps else "pass"

    @property
    def each(self) -> tuple[Judgement, ...]:
        """Judgements by one curve each: of the torque, and of each load."""
        own = replace(self, loads=())
        return (*([] if self.limit.curve is None and not self.component else [own]), *self.loads)

    @property
    def above(self) -> int:
        """How many lines are above the limit; of loads each has its own."""
        return sum(m.fails for m in self.margins)

    @property
    def worst(self) -> Margin | None:
        """The smallest margin that is judged; None without one."""
        return next((m for m in self.margins if m.verdict != "not judged"), None)

    @property
    def all_gaps(self) -> tuple[str, ...]:
        """Gaps of the torque, and of loads with their names in front."""
        of_loads = (f"{one.component}: {gap}" for one in self.loads for gap in one.gaps)
        return (*self.gaps, *of_loads)

    def of(self, line: Line) -> Margin | None:
        """Margin of one line; None where it was not judged."""
        return next((m for m in self.margins if m.line.name == line.name), None)

    def __repr__(self) -> str:
        return f"{self}\n  {counted(len(self.margins), 'line')} judged, {len(self.unknown)} without an amplitude"

    def __str__(self) -> str:
        return " ".join(one._sentences() for one in self.each)

    def _sentences(self) -> str:
        """Verdict by one curve, in words."""
        limit, band = self.limit, ""
        if limit.band:
            band = f" {limit.band}"
        if limit.is_one_number:
            head = f"Limit {limit.words}{band}: "
        else:
            head = f"Limit{self._of_what()} {self.allowed} over frequency{band}: "
        if not self.margins and not self.gaps:
            return f"{head}pass; no line is listed{band}, and nothing else is above the limit.{self._tail()}"
        if self.above:
            verdict = f"FAIL, {self.above} of {len(self.margins)} lines above"
        else:
            verdict = self._own_verdict
        worst = self._worst()
        if verdict == "not judged" and self.all_gaps and not worst:
            return f"{head}not judged: {self._reasons()}.{self._tail()}"
        return f"{head}{verdict}{worst}.{self.not_judged()}{self._tail()}"

    @property
    def unit(self) -> str:
        """Unit of amplitudes as people read them: ``mN m``, or of a force ``mN``."""
        return "mN" if self.component.startswith("F") else "mN m"

    @property
    def curve(self) -> LimitCurve | None:
        """The curve that these lines are judged by."""
        if self.component:
            return self.limit.loads[self.component.removesuffix(SECOND_WING)]
        return self.limit.curve

    def _of_what(self) -> str:
        return f" of {self.component}" if self.component else ""

    @property
    def allowed(self) -> str:
        """Amplitudes that the curve allows, in words."""
        assert self.curve is not None
        least, most = 1e3 * self.curve.least, 1e3 * self.curve.most
        if least == most:
            return f"{least:.4g} {self.unit}"
        return f"{least:.4g} to {most:.4g} {self.unit}"

    def _tail(self) -> str:
        """Assumption of the verdict, and where nothing is limited."""
        assumed = f" {self.assumption}" if self.assumption else ""
        return f"{assumed}{self._beyond()}"

    def _beyond(self) -> str:
        """That a curve limits nothing beyond its ends; empty for one number, which says where it
        holds."""
        if self.limit.is_one_number or self.curve is None:
            return ""
        ends = [f"below {self.curve.low:g} Hz"] if self.curve.low > 0.0 else []
        if math.isfinite(self.curve.high):
            ends.append(f"above {self.curve.high:g} Hz")
        return f" Nothing is limited {' and '.join(ends)}." if ends else ""

    def not_judged(self, most: int = 3) -> str:
        """Ranges and lines not judged, as a sentence; empty if there is nothing."""
        return f" Not judged: {self._reasons(most)}." if self.all_gaps else ""

    def _reasons(self, most: int = 3) -> str:
        """Ranges and lines not judged, the first of them by name."""
        named = "; ".join(self.all_gaps[:most])
        more = len(self.all_gaps) - most
        return f"{named}; and {more} more" if more > 0 else named

    def _worst(self) -> str:
        worst = self.worst
        if worst is None or math.isinf(worst.factor):
            return ""
        if self._own_verdict != "not judged":
            what = "smallest margin"
        else:
            what = "smallest margin judged"
        return f"; {what} {worst.decibel:+.1f} dB, factor {worst.factor:.3g} ({self.where(worst)})"

    def where(self, one: Margin) -> str:
        """The line of a margin, and with a curve where it is and what is allowed there."""
        if self.limit.is_one_number:
            return one.line.name
        return (
            f"{one.line.name} at {one.line.place:.5g} Hz, where {1e3 * one.limit:.4g} {self.unit}"
            " are allowed"
        )


def judge(
    table: LineTable,
    limit: Limit,
    scenario: GivenScenario | None = None,
    second: LineTable | None = None,
    loads: Mapping[str, LineTable] | None = None,
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
    loads : mapping of LineTable, optional
        Lines of loads on the spacecraft by their channels, ``"Fx"`` to ``"Mz"``, which a limit with
        curves of its own for them judges (``RunResult.load_lines``).

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
    judged = Judgement(limit, (), ())
    if limit.curve is not None:
        states = other_states(table, scenario)
        judged = _judge_table(table, limit, limit.curve, scenario, states=states)
        if scenario is not None and scenario.driven_wing is not None:
            judged = _combine_drives(judged, (table, second), scenario)
    of_loads = list(_judged_loads(limit, (table, second), loads or {}, scenario))
    if slips := slipping_reason_of_table(table, scenario):
        judged, *of_loads = (_open_for(one, slips) for one in (judged, *of_loads))
    return replace(judged, loads=tuple(of_loads))


def _open_for(one: Judgement, why: str) -> Judgement:
    """A judgement in which nothing passes or fails."""
    return replace(
        one, margins=tuple(_undecided(m, why) for m in one.margins), gaps=(why, *one.gaps)
    )


def judge_channel(table: LineTable, limit: Limit, component: str = "") -> Judgement:
    """Judge the lines of one channel of a recording against a limit.

    Parameters
    ----------
    table : LineTable
        Its lines, of a torque or a force.
    limit : Limit
        The limit: of that load, or without one of the torque about the drive axis.
    component : str
        The load that the channel is, ``Fx`` to ``Mz``.

    Returns
    -------
    Judgement
        The verdict. Nothing beyond the recording's passband is judged.

    Raises
    ------
    OptionError
        Where the limit has none for this channel.
    """
    if component in limit.loads:
        alone = Limit.of_curves(None, {component: limit.loads[component]}, limit.source)
        found = _judge_table(table, alone, limit.loads[component], None)
        return replace(found, component=component)
    if limit.curve is None or table.unit != "N*m":
        what = f"{component} [{pretty(table.unit)}]".strip()
        known = ", ".join([*([] if limit.curve is None else ["the torque"]), *limit.loads])
        raise OptionError("limit", f"has nothing for the channel {what}; it limits {known}")
    alone = Limit.of_curves(limit.curve, {}, limit.source)
    return _judge_table(table, alone, limit.curve, None)


def _judged_loads(
    limit: Limit,
    tables: tuple[LineTable, LineTable | None],
    loads: Mapping[str, LineTable],
    scenario: Scenario | None,
) -> Iterator[Judgement]:
    """The loads that have limits of their own, by their lines; of a craft with two wings, those of
    either interface.
    """
    table, _ = tables
    for name, curve in limit.loads.items():
        alone = Limit.of_curves(None, {name: curve}, limit.source)
        there = [each for each in (name, f"{name}{SECOND_WING}") if each in loads]
        for each in there:
            lines = replace(loads[each], own_error=table.own_error, find_error=None)
            states = other_states(lines, scenario, each)
            found = _judge_table(lines, alone, curve, scenario, of_torque=False, states=states)
            drifting = tuple(drifting_lines(curve, each, tables, scenario))
            yield replace(found, component=each, gaps=(*found.gaps, *drifting))
        if there:
            continue
        if _is_drive_torque(name, scenario):
            yield replace(_judge_table(table, alone, curve, scenario), component=name)
            continue
        gap = (
            "no load of this name is known of the run (an array with participation in six"
            " components is expected, and the motion or the steady state, not its lines only)"
        )
        yield Judgement(alone, (), (), (gap,), component=name)


def _is_drive_torque(name: str, scenario: Scenario | None) -> bool:
    """Whether a load is the torque about the drive axis itself: on a base that is fixed."""
    if scenario is None or scenario.spacecraft is not None:
        return False
    return name == f"M{scenario.array.drive_axis}"


def _judge_table(
    table: LineTable,
    limit: Limit,
    curve: LimitCurve,
    scenario: Scenario | None,
    *,
    of_torque: bool = True,
    states: OtherStates | None = None,
) -> Judgement:
    """The lines of one channel against a curve, in all ``states`` of the other wing's hinge.

    Models bound the torque about the drive axis only: of other channels nothing is known beyond
    their passband, nor what other draws of the noise have there.
    """
    within = [
        x for x in table if curve.holds(*_frequency_with_bound(x, table)) and x.status != TRANSIENT
    ]
    known = [x for x in within if math.isfinite(x.amplitude)]
    unknown = tuple(x for x in within if not math.isfinite(x.amplitude))
    of_noise = noise_margins(table, curve, scenario) if of_torque else ()
    margins = sorted(
        [*_line_margins(known, curve, table, scenario, states), *of_noise], key=lambda m: m.factor
    )
    edge = hub_edge(scenario)
    margins = [_unless_above_hub(m, edge) for m in margins]
    record = record_gap_of_table(table, scenario)
    gaps = [
        *([] if record is None else [record.why]),
        *_state_gaps(margins, table, curve, scenario, states),
        *(m.why for m in margins if m.verdict == "not judged"),
        *_hidden_line_gaps(unknown, curve, table, scenario, states),
        *_record_gaps(table, curve, scenario),
    ]
    if of_torque:
        gaps += _above_passband(table, curve, scenario, states)
        gaps += _unseen_above_hub(table, curve, scenario, edge)
    else:
        gaps += _other_channel_gaps(table, curve, scenario)
    why = failed_invariants_reason(table.broken, scenario) or unknown_error_reason(table, scenario)
    if why:
        gaps = [why, *gaps]
    for reason in filter(None, (why, _not_turning_reason(table, scenario))):
        margins = [_undecided(m, reason) for m in margins]
    if record is not None:
        margins = [_unless_overstated(m, record) for m in margins]
    assumption = ""
    if states is not None and states.matters(table, curve):
        assumption = states.assumption
    return Judgement(limit, tuple(margins), unknown, tuple(gaps), assumption=assumption)


def _state_gaps(
    margins: Sequence[Margin],
    table: LineTable,
    limit: LimitCurve,
    scenario: Scenario | None,
    states: OtherStates | None,
) -> Iterator[str]:
    """The state of the other wing's hinge, where a line, a peak or noise may be above the limit in one
    and not in another.
    """
    if states is None or scenario is None:
        return
    told = []
    factor = 1.0 if table.rest is None else table.rest.factor
    noise = (
        None if noise_of_record(scenario, table) is None else noise_bounds(scenario, table.duration)
    )
    for what, peaks, times in (
        ("unexplained peaks", table.rest, factor),
        ("lines of a part of the time", table.pieces, 1.0),
        ("noise of the friction", noise, 1.0),
    ):
        if above := states.peaks_above(peaks, limit, times):
            frequency, amplitude = above
            unit = f"m{pretty(table.unit)}"
            told.append(f"{what} of up to {1e3 * amplitude:.4g} {unit} at {frequency:.5g} Hz")
    if told or any(m.by_state for m in margins):
        yield states.gap
    yield from (f"{what} with another state of that hinge" for what in told)


def _other_channel_gaps(
    table: LineTable, curve: LimitCurve, scenario: Scenario | None
) -> Iterator[str]:
    """Gaps of a channel that is not the torque about the drive axis."""
    yield from _above_passband(table, curve, None)
    if noise_of_record(scenario, table) is not None:
        yield "what noise of the friction makes of it in other draws"


def _line_margins(
    lines: Sequence[Line],
    curve: LimitCurve,
    table: LineTable,
    scenario: Scenario | None,
    states: OtherStates | None,
) -> Iterator[Margin]:
    """Margins of lines of the table with known amplitudes."""
    ringing = [x for x in table if x.status in ("decaying", NOISE_DRIVEN)]
    for line in lines:
        yield _certainly_within(
            _margin(line, curve, table, ringing, scenario, states), curve, table
        )


def _margin(
    line: Line,
    limit: LimitCurve,
    table: LineTable,
    ringing: Sequence[Line],
    scenario: Scenario | None,
    states: OtherStates | None,
) -> Margin:
    """The margin of a line to the strictest limit within its frequency uncertainty, in any of the
    ``states``.

    It fails where it is above the most that is allowed there, too.
    """
    low, high = line_range(line, table, scenario)
    strict, lenient = limit.strictest(low, high), limit.most_lenient(low, high)
    unit = f"m{pretty(table.unit)}"

    def judged_at(most: float) -> Margin:
        return _margin_to(line, most, table, ringing, scenario)

    found = judged_at(strict)
    if found.fails and lenient > strict and not judged_at(lenient).fails:
        return _undecided(
            found,
            f"the limit goes from {1e3 * strict:.4g} to {1e3 * lenient:.4g} {unit} between"
            f" {low:.6g} and {high:.6g} Hz, within the uncertainty of its frequency",
        )
    if states is None:
        return found
    return states.judged(found, judged_at, lenient, unit)


def _margin_to(
    line: Line,
    most: float,
    table: LineTable,
    ringing: Sequence[Line],
    scenario: Scenario | None,
) -> Margin:
    """The margin of a line to one amplitude, undecided where other draws of the noise may change it,
    or the force table does not show it as it is.
    """
    found = margin(line, most, table, ringing, scenario)
    found = with_other_draws(found, most, table, scenario)
    if line.status == IN_BACKGROUND:
        return _margin_in_background(line, most)
    why = undecided_reason(line)
    if why:
        return _undecided(found, why)
    return found


def _margin_in_background(line: Line, allowed: float) -> Margin:
    """The margin of what the drive may have in a line of the background. It never fails."""
    most = background_bound(line)
    found = Margin(line, most, allowed / most, "pass", "", allowed)
    if most <= allowed:
        return found
    return _undecided(found, line.status)


def _hidden_line_gaps(
    unknown: Sequence[Line],
    limit: LimitCurve,
    table: LineTable,
    scenario: Scenario | None,
    states: OtherStates | None,
) -> Iterator[str]:
    """Lines without an amplitude that may be above the limit."""
    for line in unknown:
        most = limit.strictest(*line_range(line, table, scenario))
        if states is not None:
            most = states.strictest(line, most)
        if not (mode_has_decayed(line, scenario) or _is_negligible(line, most)):
            yield f"{line.name} ({line.status})"


def _record_gaps(table: LineTable, limit: LimitCurve, scenario: Scenario | None) -> Iterator[str]:
    """Gaps that a record leaves besides its lines."""
    yield from _residual_peak_gaps(table, limit, scenario)
    yield from _piece_gaps(table, limit, scenario)
    yield from _beside_band_gaps(table, limit, scenario)
    if not limit.is_flat:
        yield from filter(None, (unlisted_beside(x, limit, table, scenario) for x in table))
    yield from _unresolved_ringing_gaps(table, limit, scenario)
    yield from _growing_line_gaps(table, limit)
    yield from _modulated_line_gaps(table, scenario)
    if table.clock_ratio_uncertainty != 0.0:  # a recording's, whose clock was looked for
        yield from clock_warnings(table)
    yield from may_be_larger(table, limit)
    yield from _masked_line_gaps(table, limit)
    yield from unusable_gaps(table, limit.low, limit.high)
    if scenario is not None and scenario.rate is None:
        yield (
            "lines of the step clock, because the rate changes during the record (use a record at"
            " constant rate)"
        )


def _masked_line_gaps(table: LineTable, limit: LimitCurve) -> Iterator[str]:
    """Lines of the background that may hide a line of the drive which is above the limit."""
    for one in table.masked:
        middle, half = 0.5 * (one.low + one.high), 0.5 * (one.high - one.low)
        if not limit.holds(middle, half) or one.amplitude <= limit.strictest(one.low, one.high):
            continue
        yield (
            f"what the background's line at {middle:.5g} Hz may hide (up to"
            f" {1e3 * one.amplitude:.4g} m{pretty(table.unit)}; the recording has none there)"
        )


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


def _unseen_above_hub(
    table: LineTable, limit: LimitCurve, scenario: Scenario | None, edge: HubEdge | None
) -> Iterator[str]:
    """Gap of lines above the record's passband that may be above the limit by what the hub's model
    lacks; none where no mode of it is left out.
    """
    if scenario is None or edge is None:
        return
    start = max(PASSBAND * table.sample_rate, limit.low)
    if limit.high <= start:
        return
    unseen = out_of_band_lines(scenario, table, start, limit.high)
    if any(np.any(one.above_hub(edge).may_exceed(limit)) for one in unseen):
        yield edge.why


def _unless_above_hub(one: Margin, edge: HubEdge | None) -> Margin:
    """The margin of a line; of one where the hub's model has ended, not judged unless it is far within
    the limit.
    """
    if edge is None:
        return one
    line = one.line
    uncertainty = float(frequency_error_bound(line.place, line.frequency_uncertainty))
    if line.place + uncertainty <= edge.frequency or one.factor >= edge.factor:
        return one
    return _undecided(one, edge.why)


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


def _frequency_with_bound(line: Line, table: LineTable) -> tuple[float, float]:
    """Frequency of a line, found or expected, and to what it is known [Hz]; of a recording between where it is
    read and where the scenario's clock would have it.
    """
    nominal = nominal_frequency(line, table)
    off = float(frequency_error_bound(line.place, line.frequency_uncertainty))
    return 0.5 * (line.place + nominal), 0.5 * abs(line.place - nominal) + off


def _combine_drives(
    first: Judgement, tables: tuple[LineTable, LineTable | None], scenario: Scenario
) -> Judgement:
    """The judgement of two drives on one craft, the second's lines called so."""
    own, theirs = tables
    if theirs is None:
        return replace(first, gaps=(*first.gaps, _SECOND_UNKNOWN))
    curve, wing = first.limit.curve, scenario.driven_wing
    assert curve is not None
    assert wing is not None
    theirs = with_known_error(theirs)
    states = other_states(theirs, wing.alone, first=False)
    second = _judge_table(theirs, first.limit, curve, wing.alone, states=states)
    known = len(first.gaps) + len(second.gaps)
    first = _with_other_stepping(first, AddedTorque.of(theirs, wing.alone), own)
    second = _with_other_stepping(second, AddedTorque.of(own, scenario), theirs)
    if len(first.gaps) + len(second.gaps) > known:
        first = replace(first, gaps=(_BOTH_STEP, *first.gaps))

    def called(line: Line) -> Line:
        return replace(line, name=of_second_wing(line.name))

    of_second = (replace(m, line=called(m.line)) for m in second.margins)
    margins = sorted([*first.margins, *of_second], key=lambda m: m.factor)
    unknown = (*first.unknown, *map(called, second.unknown))
    gaps = (*first.gaps, *(f"{SECOND_DRIVE} {gap}" for gap in second.gaps))
    assumption = " ".join(filter(None, (first.assumption, second.assumption)))
    return replace(first, margins=tuple(margins), unknown=unknown, gaps=gaps, assumption=assumption)


def _with_other_stepping(one: Judgement, added: AddedTorque, table: LineTable) -> Judgement:
    """The judgement of a drive's lines, of which none passes or fails by what they are while the other
    drive stands.
    """
    assert one.limit.curve is not None
    margins = tuple(added.judged(margin) for margin in one.margins)
    changed = [a.why for a, b in zip(margins, one.margins, strict=True) if a is not b]
    told = (*changed, *added.alone(list(table), one.limit.curve))
    return replace(one, margins=margins, gaps=(*one.gaps, *told))


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
    """Reason why the record of a table, or its steady state, does not show the lines of tracking."""
    steady = any(x.status == TRANSIENT for x in table)
    simulated = table.clock_ratio_uncertainty == 0.0
    return record_gap(scenario, table.duration, simulated=simulated, steady=steady)


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


def _residual_peak_gaps(
    table: LineTable, limit: LimitCurve, scenario: Scenario | None
) -> list[str]:
    """Peaks above the limit that are not lines of the table."""
    if table.rest is None:
        return ["no search was made for lines outside the table"]
    frequency, amplitude, most = table.rest.nearest_to(limit)
    unit = f"m{pretty(table.unit)}"
    peak = f"up to {1e3 * amplitude:.4g} {unit} at {frequency:.5g} Hz"
    if not limit.is_flat:
        peak = f"{peak}, about which {1e3 * most:.4g} {unit} are allowed"
    more = "more members of each family, --harmonics N, or a longer record.duration"
    told = []
    if amplitude > most:
        told.append(f"unexplained peaks, {peak} ({more})")
    elif table.rest.factor * amplitude > most:
        told.append(
            f"unexplained peaks, {peak}, where a line may have {table.rest.factor:g} times as much"
            f" ({more})"
        )
    in_time = not any(x.status == TRANSIENT for x in table)
    if told and in_time and (varies := intermittency_cause(scenario)):
        told = [
            f"lines of a part of the time, as {varies} changes the drive, and peaks without a line,"
            f" up to {1e3 * table.rest.factor * amplitude:.4g} {unit} at {frequency:.5g} Hz"
        ]
    lowest = float(table.rest.frequency.min(initial=math.inf))
    slow = ABOVE_PASSBAND_FACTOR * table.rest.slow
    if limit.low < lowest and slow > limit.strictest(limit.low, lowest):
        if math.isfinite(lowest):
            ends = f"below {lowest:.3g} Hz"
        else:
            ends = "between its mean and its highest frequency"
        told.append(
            f"anything {ends}, for which the record is too short (increase record.duration)"
        )
    return told


def _piece_gaps(table: LineTable, limit: LimitCurve, scenario: Scenario | None) -> Iterator[str]:
    """Amplitudes above the limit in pieces of a steady state's period."""
    if table.pieces is None:
        return
    frequency, amplitude, most = table.pieces.nearest_to(limit)
    if amplitude > most:
        varies = intermittency_cause(scenario)
        cause = f", as {varies} changes the drive" if varies else ""
        yield (
            f"lines of a part of the time{cause}, up to {1e3 * amplitude:.4g} mN m at"
            f" {frequency:.5g} Hz in a piece of the steady state's cycle"
        )


def _beside_band_gaps(
    table: LineTable, limit: LimitCurve, scenario: Scenario | None
) -> Iterator[str]:
    """Lines above the limit beside its band, which may hide others in the band: the record is too
    short to tell them apart.
    """
    if table.rest is None:
        return
    reach = table.rest.resolution
    beside = [(max(limit.low - x.place, x.place - limit.high), x) for x in table]
    near = [
        (apart, x)
        for apart, x in beside
        if 0.0 < apart < reach
        and not limit.holds(*_frequency_with_bound(x, table))
        and shared_amplitude_bound(x, table, scenario)
        > limit.strictest(x.place - reach, x.place + reach)
    ]
    if near:
        apart, line = min(near, key=lambda one: one[0])
        yield (
            f"lines in the band masked by {line.name} at {line.place:.5g} Hz"
            f" (record.duration >= {rounded_up(SEPARATION / apart)} s)"
        )


def _unresolved_ringing_gaps(
    table: LineTable, limit: LimitCurve, scenario: Scenario | None
) -> Iterator[str]:
    """Modes that may ring, slower than the record resolves, where there is friction: it makes other
    lines of their motion, which come and go with it.
    """
    if scenario is None or table.rest is None:
        return
    if max(scenario.friction.largest_torque, scenario.motor.friction.largest_torque) == 0.0:
        return
    if limit.least > _FAR_ABOVE_RECORD * table.largest:
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


def _growing_line_gaps(table: LineTable, limit: LimitCurve) -> Iterator[str]:
    """Lines outside the band that grow: nothing bounds their multiples, which grow with them."""
    for x in table:
        outside = not limit.holds(*_frequency_with_bound(x, table))
        if x.status == "growing" and outside and GROWTH_FACTOR * x.amplitude > limit.least:
            yield f"lines caused by {x.name}, which grows within the record (increase record.settle)"


def _modulated_line_gaps(table: LineTable, scenario: Scenario | None) -> Iterator[str]:
    """Lines of flux harmonics and detent torque while the start rings: what they have at an order of
    the rotor's angle is spread by its motion over sidebands, each smaller than the line that lasts.
    """
    ringing = [x for x in table if x.status == "decaying"]
    if scenario is None or not ringing:
        return
    torque = math.fsum(x.amplitude_at_start(table.duration) for x in ringing)
    stiffness = motor_of_mean_spring(scenario.driver, scenario.motor).electromagnetic_stiffness
    angle = scenario.motor.rotor_teeth * torque / (abs(scenario.reducer.ratio) * stiffness)
    order = max((1, *scenario.motor.torque_orders))
    if order * angle <= _MODULATION_INDEX:
        return
    decay = max(ringing, key=lambda x: x.amplitude).decay
    settle = scenario.record.settle + math.log(order * angle / _MODULATION_INDEX) / decay
    yield (
        f"lines of order {order} of the electrical angle, spread by the ringing of the start"
        f" (record.settle >= {rounded_up(settle)} s)"
    )


def _certainly_within(one: Margin, limit: LimitCurve, table: LineTable) -> Margin:
    """The margin of a line; of one above the limit that may be outside its band, not judged: an unlisted one
    that was found outside, or one of a recording where it is read or where the scenario's clock would have it.
    """
    line = one.line
    clock, nominal = CLOCK_UNCERTAINTY * line.place, nominal_frequency(line, table)
    if one.verdict != "fail" or (line.kind != "other" and nominal == line.place):
        return one
    if limit.holds(line.place, clock) and limit.holds(nominal, clock):
        return one
    if nominal != line.place:
        why = f"{line.name} (read at {line.place:.5g} Hz, and at {nominal:.5g} Hz by the scenario's clock)"
        return replace(one, verdict="not judged", why=why)
    apart = max(limit.low - line.place, line.place - limit.high)
    why = (
        f"{line.name} (at {line.place:.5g} Hz, which may be in the band;"
        f" record.duration >= {rounded_up(SEPARATION / apart)} s)"
    )
    return replace(one, verdict="not judged", why=why)


def _above_passband(
    table: LineTable,
    limit: LimitCurve,
    scenario: Scenario | None,
    states: OtherStates | None = None,
) -> list[str]:
    """Gap above the highest frequency examined."""
    top = PASSBAND * table.sample_rate
    if limit.high <= top:
        return []
    start = max(top, limit.low)
    if scenario is None:
        return [f"lines above {start:.4g} Hz (increase record.sample_rate)"]
    unseen = list(out_of_band_lines(scenario, table, start, limit.high))
    if states is not None:
        unseen = [states.out_of_band(one, limit) for one in unseen]
    large = [
        (one, np.flatnonzero(above)) for one in unseen if np.any(above := one.may_exceed(limit))
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


def _is_negligible(line: Line, most: float) -> bool:
    """Whether a line that others hide is small all the same."""
    return line.status.startswith("not separable") and amplitude_bound(line) <= most
