"""Start-up transient in a record: how long it rings, and how far the drive is wound up before
its array turns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from microvib.model.line_names import CONTROL_MODE, LineName
from microvib.model.linear import CoupledMode, coupled_modes, sliding_growth
from microvib.model.parametric import (
    GrowthOverAngle,
    decay_in_motion,
    growth_over_angle,
    modes_fed_by_both_drives,
)
from microvib.model.scenario import Scenario
from microvib.model.slow_variations import (
    COMPENSATION,
    CYCLES_SEEN,
    HARNESS,
    SlowVariation,
    slow_variations,
    unseen_variations,
)
from microvib.model.tracking import HeldRate, Tracking
from microvib.model.turning import GROWN_EFOLDINGS, TurningDrive, turning_drive
from microvib.model.winding_up import (
    commanded_travel,
    seconds_until_sliding,
    sliding_travel,
    wind_up,
)
from microvib.signals.line_table import Line

_LOOP_EFOLDINGS = 4.6
"""e-foldings of the current loop's slow pole after which a hundredth is left of what its integral part
changes, which is a part of the lines itself."""
SETTLED_EFOLDINGS = 12.0
"""e-foldings after which the transient of a start has vanished."""


def steady_start_advice(scenario: Scenario | None) -> str:
    """The advice to start in the steady state, to be added to another; empty where ``record.start``
    says so already, or where none is looked for.
    """
    if scenario is not None and (scenario.record.start == "steady" or scenario.driver.pulsed):
        return ""
    return ", or record.start: steady"


def steady_state_fallback_note(solver: Mapping[str, Any]) -> str:
    """A sentence on a run that was to start in its steady state and has none, from its account;
    else empty.
    """
    kind, _, why = str(solver.get("steady", "")).partition(": ")
    if kind == "not used":
        return f"No steady state: {why}. Simulated from rest instead."
    return ""


def mode_has_decayed(line: Line, scenario: Scenario | None) -> bool:
    """Whether an array mode's ringing has died away by its damping, whatever it was, so that it
    need not be told from others.
    """
    if scenario is None or not line.is_mode:
        return False
    mode = next((m for m in coupled_modes(scenario) if m.name == line.name), None)
    return mode is not None and not may_still_ring(mode, scenario)


def has_decayed(decay: float, settled: float) -> bool:
    """Whether what decays at the rate ``decay`` [1/s] has vanished after a time ``settled`` [s]."""
    return decay * settled > SETTLED_EFOLDINGS


def may_still_ring(
    mode: CoupledMode, scenario: Scenario, efoldings: float = SETTLED_EFOLDINGS
) -> bool:
    """Whether what rings in a mode after the start has not yet died away by so many ``efoldings``."""
    return decay_in_motion(mode, scenario) * time_to_settle(scenario) <= efoldings


def time_to_settle(scenario: Scenario) -> float:
    """Seconds at one rate before the record."""
    times, rates = scenario.tracking.breakpoints()
    settle = scenario.record.settle
    changes = [
        0.0,
        *(
            t
            for t, a, b in zip(times[1:], rates[:-1], rates[1:], strict=True)
            if a != b and t <= settle
        ),
    ]
    return float(settle - max(changes))


def not_moving_reason(scenario: Scenario) -> str:
    """Why the record begins before the array turns, and what to do; empty where it turns by then,
    or is not to turn.
    """
    end = scenario.record.settle
    turned, rate, whole = commanded_travel(scenario, end)
    needed = wind_up(scenario) * (1.0 if whole else 2.0)  # after a reversal it is first wound off
    if rate == 0.0 or turned >= needed:
        return ""
    if math.isinf(needed):
        return "the array does not turn: the breakaway torque of its friction exceeds the motor torque (increase motor.current)"
    remedy = f"record.settle >= {rounded_up(end + (needed - turned) / abs(rate))} s"
    held = f"static friction holds the output shaft until wind-up reaches {math.degrees(needed):.3g} deg"
    return f"the array does not turn yet: {held} ({remedy})"


def rounded_up(value: float) -> str:
    """A number rounded up to three digits, as remedies name it."""
    if value > 0.0:
        digits = 10.0 ** (math.floor(math.log10(value)) - 2)
    else:
        digits = 1.0
    return f"{math.ceil(value / digits - 1e-9) * digits:.6g}"


def full_step_time(scenario: Scenario) -> float:
    """Seconds that a full step of the motor takes; 0 where the rate is not constant, or zero."""
    if not scenario.driving_frequency:
        return 0.0
    driver = scenario.driver
    microsteps = driver.beats * driver.microsteps / scenario.motor.full_steps
    return microsteps / scenario.driving_frequency


_LONGEST_ADDED_RECORD = 128.0
"""Length [s] up to which a record is made longer for the sake of slow full steps."""
_LONGEST_RECORD_OF_CYCLES = 256.0
"""Length [s] up to which it is for what changes the drive more slowly."""
_LONGER = 1.01
"""Length of a record over the time of bursts of stick-slip that it is made to show: it holds whole samples."""
_MOST_ADDED_SAMPLES = 2**22
"""Samples up to which it is."""


def with_full_steps(scenario: Scenario, count: int) -> Scenario:
    """``scenario`` with a record of ``count`` full steps of the motor at least, or of as many as it
    takes little to record; with its own record where that is longer.

    Where there are full steps to be recorded, what changes the drive more slowly is, too, if it
    takes little.
    """
    record = scenario.record
    most = _MOST_ADDED_SAMPLES / record.sample_rate
    wanted = min(count * full_step_time(scenario), _LONGEST_ADDED_RECORD, most)
    if count > 0 and not not_moving_reason(scenario):
        cycles = [CYCLES_SEEN * one.cycle for one in slow_variations(scenario)]
        cycles.append(_LONGER * _time_of_bursts(scenario))
        wanted = max([wanted, *(x for x in cycles if x <= min(_LONGEST_RECORD_OF_CYCLES, most))])
    if wanted <= record.duration:
        return scenario
    return scenario.with_si({"record.duration": wanted})


_FULL_STEPS_SEEN = 2.0
"""Full steps from which a record shows a motion that slips but once in each."""
_CHANGE_BY_SHARE = 6.0
"""Part by which lines of a record shorter than a cycle of what changes the drive may be larger than
those of whole cycles, over the part by which that changes the rate or the friction; assumed: up to
6.0 was seen, where friction over the angle changed which microsteps slip, and 1.5 with an error of
the gear (tests/test_slow_variations.py).
"""
VARIATION_FACTOR = 4.0
"""Times that they may be larger at most; assumed."""
_START_CYCLES = 3.0
"""Cycles of the slowest mode within which a shaped start is over, whatever its steps; assumed."""
_RISING_CYCLES = 30.0
"""Cycles within which one is over whose rate only rises; assumed. Slower ones dwell in resonances."""
_ONSET_EFOLDINGS = 1.0
"""e-foldings of the slowest mode before which what rings may keep lines from what they last with."""


@dataclass(frozen=True)
class RecordGap:
    """Why a record of a run in time, as a whole, does not show the lines of tracking."""

    why: str
    """The reason, with the remedy; a sentence without a stop."""
    turns: bool
    """Whether the array turns: then what the record shows is there, although not all of it."""
    overstated: float = 1.0
    """Factor by which a line of the record may be larger than it is in a longer one."""


def record_gap(
    scenario: Scenario | None, duration: float, *, simulated: bool = True, steady: bool = False
) -> RecordGap | None:
    """Reason why a record of ``duration`` [s] does not show the lines of tracking; None where it does.

    The command has rates that the record does not see; the array does not turn yet; the motion is
    not yet the lasting one; frictions with memory do not slide yet; the record is shorter than two
    full steps, of which a slow drive may slip but once in each; or it holds less than two cycles of
    something that changes the drive more slowly. Limits, budgets, rate plans and campaigns all ask
    here. Of a recording that is not ``simulated`` the start is not known; in a ``steady`` state only
    the rates are asked for.
    """
    if scenario is None:
        return None
    if simulated and (fed := modes_fed_by_both_drives(scenario)):
        return RecordGap(both_drives_reason(fed), turns=True, overstated=math.inf)
    if simulated:
        gap = unseen_rates_gap(scenario)
        if gap is None and not steady:
            gap = _start_gap(scenario)
        if gap is not None:
            return gap
    if steady:
        return None
    return _short_record_gap(scenario, duration)


def both_drives_reason(modes: Sequence[str]) -> str:
    """Why lines of two drives, each by itself, are not those of both together."""
    return (
        f"a parametric resonance of {' and '.join(modes)} by both drives together, each of which is run while"
        " the other one stands (another tracking.rate, by a hundredth)"
    )


def _start_gap(scenario: Scenario) -> RecordGap | None:
    """Reason why a record begins before the motion is the lasting one; None where it does not."""
    if held := not_moving_reason(scenario):
        return RecordGap(held, turns=False)
    if why := _not_lasting_reason(scenario) or not_sliding_reason(scenario):
        return RecordGap(why, turns=True)
    if why := current_loop_reason(scenario):
        return RecordGap(why, turns=True, overstated=math.inf)
    return None


def current_loop_reason(scenario: Scenario) -> str:
    """Reason why the currents of a drive are not yet those that last: the integral part of their loop has a
    slow pole near K_I / (K_P + R); empty where it has died away.
    """
    decay = scenario.driver.slow_decay(scenario.motor)
    settled = time_to_settle(scenario)
    if decay * settled >= _LOOP_EFOLDINGS:
        return ""
    longer = rounded_up(scenario.record.settle - settled + _LOOP_EFOLDINGS / decay)
    return (
        f"lines before the current loop has settled: the integral part of its slow pole takes {1.0 / decay:.3g} s"
        f" for each e-folding (record.settle >= {longer} s{steady_start_advice(scenario)})"
    )


def _short_record_gap(scenario: Scenario, duration: float) -> RecordGap | None:
    """Reason why a record of ``duration`` [s] is too short for what changes slowly; None where it is not."""
    if slow := unseen_variations(scenario, duration):
        why = _unseen_variation_reason(slow[0], scenario)
        changed = 1.0 + _CHANGE_BY_SHARE * sum(one.share for one in slow)
        overstated = min(changed, VARIATION_FACTOR)
        if any(one.key == COMPENSATION for one in slow):
            overstated = math.inf  # over whole cycles a driving line is spread over many
        return RecordGap(why, turns=True, overstated=overstated)
    needed = [
        (_FULL_STEPS_SEEN * full_step_time(scenario), _FEW_FULL_STEPS),
        (_time_of_bursts(scenario), _BURSTS),
    ]
    wanted, why = max(needed)
    if duration >= wanted:
        return None
    remedy = f"record.duration >= {rounded_up(wanted)} s"
    if why == _BURSTS:
        remedy += steady_start_advice(scenario)
    return RecordGap(f"{why} ({remedy})", turns=True)


_FEW_FULL_STEPS = (
    "lines of a motion that slips once in a full step, of which the record holds fewer than two"
)
_BURSTS = (
    "stick-slip that may come in bursts, longer than the record, as friction falls with the rate by more"
    " than the damping"
)


def _time_of_bursts(scenario: Scenario) -> float:
    """Time [s] from which on a record shows the bursts of a drive that cannot slide evenly: those of its
    modes build up and die away with their damping. 0 where it slides.
    """
    growth = sliding_growth(scenario)
    if growth <= 0.0:
        return 0.0
    decays = (decay_in_motion(mode, scenario) for mode in _ringing_modes(scenario))
    return SETTLED_EFOLDINGS / min([growth, *(decay for decay in decays if decay > 0.0)])


def unseen_rates_gap(scenario: Scenario) -> RecordGap | None:
    """Reason why a record at one rate does not show what a profile makes at others, or while the rate
    changes; None where it commands nothing else.

    What comes before the record is its start, and not judged (``start_sentence`` says so), where the rate
    is that of the record within some cycles of the slowest mode, more of them if it only rises; what takes
    longer runs through the modes slowly, and legs that last longer than a cycle, or go faster, are rates of
    their own.
    """
    recorded = scenario.rate
    if recorded is None or scenario.tracking.profile is None:
        return None
    cycle = max((1.0 / mode.frequency for mode in _shaft_modes(scenario)), default=0.0)
    held = scenario.tracking.held_rates()
    why = (
        _another_rate_reason(scenario, held, recorded, cycle)
        or _slow_start_reason(scenario, held, cycle)
        or _changes_behind_reason(scenario, held)
    )
    return RecordGap(why, turns=recorded != 0.0) if why else None


def _another_rate_reason(
    scenario: Scenario, held: Sequence[HeldRate], recorded: float, cycle: float
) -> str:
    """Reason why a rate that is held for longer than a ``cycle`` [s], or a higher one, is not seen; empty
    without one.
    """
    for one in held:
        faster = abs(one.rate) > abs(recorded)
        lasts = one.passed if faster else one.lasts
        if one.rate not in (0.0, recorded) and lasts > cycle:
            return _unseen_rate_reason(scenario, one, recorded)
    return ""


def _slow_start_reason(scenario: Scenario, held: Sequence[HeldRate], cycle: float) -> str:
    """Reason why what comes before the rate of a record is more than a start; empty where it is one."""
    k = _recorded_leg(scenario, held)
    if held[k].rate == 0.0 or cycle == 0.0:
        return ""
    falls = [b.start for a, b in pairwise(held[: k + 1]) if abs(b.rate) < abs(a.rate)]
    begins = _first_motion(scenario.tracking)
    if held[k].start - begins <= (_START_CYCLES if falls else _RISING_CYCLES) * cycle:
        return ""
    return _changing_rate_reason(scenario, falls[0] if falls else begins)


def _changes_behind_reason(scenario: Scenario, held: Sequence[HeldRate]) -> str:
    """Reason why a change of rate behind the record is not seen; empty where there is none."""
    k = _recorded_leg(scenario, held)
    for before, after in pairwise(held[k:]):
        if after.rate != before.rate:
            return _changing_rate_reason(scenario, before.start + before.lasts)
    return ""


def start_sentence(scenario: Scenario) -> str:
    """Sentence on starts by profiles of rate: until when they last, and that they are not judged; empty
    without one.
    """
    trackings = {"tracking": scenario.tracking}
    wing = None if scenario.spacecraft is None else scenario.spacecraft.second_wing
    if wing is not None and wing.tracking is not None:
        trackings["spacecraft.second_wing.tracking"] = wing.tracking
    lasts = []
    for key, tracking in trackings.items():
        held = tracking.held_rates()
        reached = held[_recorded_leg(scenario, held)].start if held else 0.0
        if _first_motion(tracking) < reached:
            lasts.append(f"until {reached:.4g} s ({key}.profile)")
    return f"The start, {' and '.join(lasts)}, is not judged." if lasts else ""


def _first_motion(tracking: Tracking) -> float:
    """When a command leaves rest [s]."""
    times, rates = tracking.breakpoints()
    moving = np.flatnonzero(rates != 0.0)
    if not moving.size:
        return math.inf
    return float(times[max(int(moving[0]) - 1, 0)])


def _recorded_leg(scenario: Scenario, held: Sequence[HeldRate]) -> int:
    """Number of the leg whose rate a record at one rate has: the first of those that follow each other at
    it.
    """
    record = scenario.record
    stop = record.settle + record.duration
    k = max((k for k, one in enumerate(held) if one.start < stop), default=0)
    while k > 0 and held[k - 1].rate == held[k].rate:
        k -= 1
    return k


def _changing_rate_reason(scenario: Scenario, start: float) -> str:
    """Why what a profile makes while its rate changes is not seen, and what to do."""
    record = scenario.record
    return (
        f"what the array does while its rate changes, from {start:.6g} s on (tracking.profile): the record,"
        f" from {record.settle:g} to {record.settle + record.duration:g} s, is at one rate (tracking.rate"
        " judges that rate alone)"
    )


def _unseen_rate_reason(scenario: Scenario, unseen: HeldRate, recorded: float) -> str:
    """Why lines of a rate that a profile holds are not seen, and what to do."""
    record = scenario.record
    if recorded != 0.0:
        at = f"is at {_in_degrees(recorded)}"
    elif unseen.start > record.settle:
        at = "begins before the array turns"
    else:
        at = "has the array at rest"
    return (
        f"lines at {_in_degrees(unseen.rate)}, which tracking.profile holds from"
        f" {unseen.start:.6g} s on: the record, from {record.settle:g} to"
        f" {record.settle + record.duration:g} s, {at} (tracking.rate, a run for each)"
    )


def _in_degrees(rate: float) -> str:
    return f"{math.degrees(rate):.4g} deg/s"


def _unseen_variation_reason(slow: SlowVariation, scenario: Scenario) -> str:
    """Reason why a record does not show a drive that something changes slowly, and what to do."""
    if slow.key == HARNESS:
        return (
            f"lines at angles that the record does not reach: {HARNESS} pulls more, and the motor lags"
            f" more, as the array turns ({HARNESS}: null and a run each with friction of the least and"
            " the most torque of it)"
        )
    wanted = CYCLES_SEEN * slow.cycle
    remedy = f"record.duration >= {rounded_up(wanted)} s"
    if not slow.key.startswith("friction"):
        remedy += steady_start_advice(scenario)
    elif wanted > _LONGEST_RECORD_OF_CYCLES:
        remedy += ", or friction.position: null and a run each with the least and the most friction"
    return (
        f"lines at angles that the record does not reach: {slow.what} repeats after"
        f" {slow.cycle:.4g} s, and two of its cycles are needed ({remedy})"
    )


def _not_lasting_reason(scenario: Scenario) -> str:
    """Why lines of a run in time may change by more than what rings in it; empty where they do not.

    Nothing in a drive is quite linear: while a mode rings, its angles shift the phases at which
    friction, detent torque and the motor's spring act, and lines are smeared. Where friction falls
    with the rate by more than the damping, modes grow until they stick; where the motor's stiffness
    varies at twice their frequency, or windings take damping away, they grow from nothing.
    """
    ringing = {mode.name: decay_in_motion(mode, scenario) for mode in _ringing_modes(scenario)}
    decays = [(decay, name) for name, decay in ringing.items() if decay > 0.0]
    decay, slowest = min(decays, default=(math.inf, ""))
    needed = _ONSET_EFOLDINGS / decay
    what = f"lines while {slowest} still rings with more than a third of what it began with"
    if (growth := sliding_growth(scenario)) > 0.0:
        needed = SETTLED_EFOLDINGS / min(growth, decay)
        what = (
            "stick-slip that has not come to its end, as friction falls with the rate by more than"
            " the damping"
        )
    elif (turning := turning_drive(scenario)).growth > 0.0:
        needed = GROWN_EFOLDINGS / turning.growth + SETTLED_EFOLDINGS / decay
        what = _oscillation(turning)
    elif fed := [one for one in growth_over_angle(scenario) if one.may_grow]:
        slowest_growth = min(fed, key=lambda one: one.growth)
        if slowest_growth.growth == 0.0:
            return _perhaps_growing_reason(slowest_growth, scenario)
        needed = GROWN_EFOLDINGS / slowest_growth.growth + SETTLED_EFOLDINGS / decay
        what = (
            f"a parametric resonance that has not come to its end, as {slowest_growth.what} varies the stiffness"
            " at about twice a mode's frequency"
        )
    settled = time_to_settle(scenario)
    if settled >= needed:
        return ""
    longer = rounded_up(scenario.record.settle - settled + needed)
    return f"{what} (record.settle >= {longer} s{steady_start_advice(scenario)})"


def unseen_growth_reason(scenario: Scenario) -> str:
    """Why no run in time, however long, tells what lasts: both drives of a craft feed a mode together, or
    something does about as fast as it decays. Empty where it does.
    """
    if fed := modes_fed_by_both_drives(scenario):
        return both_drives_reason(fed)
    for one in growth_over_angle(scenario):
        if one.may_grow and one.growth == 0.0:
            return _perhaps_growing_reason(one, scenario)
    return ""


def _perhaps_growing_reason(fed: GrowthOverAngle, scenario: Scenario) -> str:
    """Why a run in time, of whatever length, does not tell whether modes last that something feeds."""
    return (
        f"a parametric resonance that may grow, however slowly: {fed.what} may feed"
        f" {' and '.join(fed.modes)} as fast as damping drains them (another tracking.rate, by a"
        f" hundredth{steady_start_advice(scenario)})"
    )


def not_sliding_reason(scenario: Scenario) -> str:
    """Why lines of a run in time are those of frictions with memory that do not slide yet, and what to
    do; empty where they do by then.
    """
    settle = scenario.record.settle
    wait = seconds_until_sliding(scenario, settle)
    if wait == 0.0:
        return ""
    travel = math.degrees(sliding_travel(scenario))
    return (
        "lines of friction that slides: presliding lasts until the array has turned by"
        f" {travel:.3g} deg (record.settle >= {rounded_up(settle + wait)} s)"
    )


def _oscillation(turning: TurningDrive) -> str:
    """The motion to which deviations from smooth turning grow without a friction that falls."""
    if turning.varying:
        return (
            "a parametric resonance that has not come to its end, as detent torque, flux harmonics or"
            " steps of the references vary the motor's stiffness at about twice a mode's frequency"
        )
    return (
        "an oscillation that has not come to its end, as the windings take damping away at this rate"
        " (mid-range instability)"
    )


def _ringing_modes(scenario: Scenario) -> list[CoupledMode]:
    """Modes that the start may make ring; attitude control hardly moves the shaft."""
    return [mode for mode in _shaft_modes(scenario) if mode.decay > 0.0]


def _shaft_modes(scenario: Scenario) -> list[CoupledMode]:
    """Modes but for attitude control's."""
    return [
        mode for mode in coupled_modes(scenario) if LineName.parse(mode.name).family != CONTROL_MODE
    ]
