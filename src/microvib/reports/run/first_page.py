"""The first page of a run's report: what was simulated, its main lines with margins, the picture
that matters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from microvib.analysis.accuracy import read_error_estimate
from microvib.analysis.limits import Judgement, transient_warnings
from microvib.analysis.run import RunResult
from microvib.analysis.spread import spread_sentence
from microvib.analysis.start import start_sentence, steady_state_fallback_note
from microvib.model.scenario import Scenario
from microvib.reports import figures
from microvib.reports.craft import craft_words, pointing_sentence
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text, format_number, truncate
from microvib.reports.outcome import Item, Pairs, Picture
from microvib.reports.run.lines import largest_lines, main_lines, main_table
from microvib.reports.run.trust import drives, failed_invariants, invariants_sentence
from microvib.results import DECIBEL, TORQUE, TORQUE_LIMIT
from microvib.signals.line_table import NOISE_DRIVEN, Line, LineTable
from microvib.solve.motion import Motion, StepCount, step_count

_MAX_UNUSUAL = 4
"""Unusual values that are told on the first page."""


def leading_figures(result: RunResult, judged: Judgement | None) -> Iterator[Fact]:
    """The verdict, or without a limit the largest lines; largest torque and RMS."""
    if failed_invariants(result):
        yield Fact("NOT to be used", "an invariant does not hold", "fail")
    steps = _steps(result)
    if steps is not None and steps.first:
        yield Fact("steps lost", str(steps), "fail")
    if judged is not None:
        yield from verdict_facts(judged)
    else:
        for line in largest_lines(result.table)[:2]:
            yield Fact(TORQUE.figure(line.amplitude), _line_label(line))
    if result.motion is not None:
        T_d = result.motion["T_d"]
        yield Fact(TORQUE.figure(float(np.abs(T_d).max())), "largest T_d")
        yield Fact(TORQUE.figure(float(T_d.std())), "RMS about the mean")


def _line_label(line: Line) -> str:
    """Name and frequency of a line, and that it decays, since it is then not part of the settled
    motion.
    """
    settled = {
        "decaying": ", decaying: not settled",
        "growing": ", growing",
        NOISE_DRIVEN: f", {NOISE_DRIVEN}: one draw",
    }.get(line.status, "")
    return f"{line.name} at {format_number(line.frequency)} Hz{settled}"


def verdict_facts(judged: Judgement) -> Iterator[Fact]:
    """The verdict by each curve, and its smallest margin."""
    for one in judged.each:
        label = _limit_label(one)
        total, worst = len(one.margins), one.worst
        of = f"{one.component}: " if one.component else ""
        if not total and not one.gaps:
            yield Fact(f"{of}no line to judge", label)
        elif one.verdict == "fail":
            yield Fact(f"{of}FAIL: {one.above} of {total} lines", label, "fail")
        elif one.verdict == "pass":
            yield Fact(f"{of}Pass: {count_text(total, 'line')}", label, "pass")
        else:
            yield Fact(f"{of}Not judged", f"{label}: {one.gaps[0]}", "fail")
        if worst is not None:
            smallest = (
                f"smallest margin, factor {format_number(worst.factor, 3)}: {one.where(worst)}"
            )
            yield Fact(DECIBEL.figure(worst.decibel), smallest)


def _limit_label(judged: Judgement) -> str:
    """The limit in words."""
    limit = judged.limit
    if limit.is_one_number:
        return f"limit {TORQUE_LIMIT.figure(limit.torque)} {limit.band}".strip()
    return f"limit {judged.allowed} over frequency {limit.band}".strip()


def first_page(result: RunResult, judged: Judgement | None) -> Iterator[Item]:
    """Simulated case, main lines, remarks on them, and the picture."""
    yield Pairs(tuple(_simulated(result)))
    yield main_table(result.table, judged)
    for note in _notes(result, judged):
        yield Text(note, note=True)
    if result.motion is not None:
        yield _picture(result.motion, result.table, judged)


def _notes(result: RunResult, judged: Judgement | None) -> Iterator[str]:
    if told := steady_state_fallback_note(result.solver):
        yield told
    if told := spread_sentence(result.table):
        yield told
    yield from _unusual(result.scenario)
    yield from transient_warnings(result.table, result.scenario)
    if result.hub is not None:
        yield from pointing_sentence(result.hub)
    elif result.scenario.craft is not None:
        yield (
            "Loads and line of sight need the motion, or a steady state: leave --lines-only out, or"
            " add --steady."
        )
    if judged is not None:
        start = start_sentence(result.scenario)
        yield " ".join(filter(None, (str(judged), start, _margin_note(result.table, judged))))


def _unusual(scenario: Scenario) -> Iterator[str]:
    unusual = scenario.unusual_values()
    told = [f"{text}." for text in unusual[:_MAX_UNUSUAL]]
    if more := len(unusual) - len(told):
        told.append(f"So are {more} more; `microvib show scenario.yaml` names them.")
    if told:
        yield " ".join(told)


def _margin_note(lines: LineTable, judged: Judgement) -> str:
    """How margins are to be read."""
    quantile, alone = "", " of this one run,"
    if any(lines.over_seeds(margin.line.name) for margin in judged.margins):
        quantile = ", of lines that several draws of the noise were run of over their 95 % quantile"
        alone = ""
    return (
        f"A margin is limit over amplitude{quantile},{alone} without allowance for the uncertainty"
        " of parameters."
    )


def _simulated(result: RunResult) -> Iterator[tuple[str, str]]:
    scenario = result.scenario
    array, record = scenario.array, scenario.record
    first = ""
    if array.modes:
        first = f", the first clamped at {array.modes[0].frequency:.5g} Hz"
    yield "Drive", _drive(scenario)
    yield (
        "Array",
        f"{array.inertia:.5g} kg m² about {array.drive_axis}, {count_text(len(array.modes), 'mode')}{first}",
    )
    if scenario.spacecraft is not None:
        yield "Spacecraft", craft_words(scenario.spacecraft)
    yield "Motion", _motion(result)
    steps = _steps(result)
    if steps is not None:
        yield "Steps", str(steps)
    yield (
        "Record",
        f"{record.duration:g} s at {record.sample_rate:g} Hz after {record.settle:g} s",
    )
    if scenario.source:
        yield "Values", truncate(scenario.source, 160)
    yield from _numerics(result)


def _steps(result: RunResult) -> StepCount | None:
    """Steps that a pulsed drive made; None of other drives."""
    return step_count(result.solver if result.motion is None else result.motion.solver)


def _drive(scenario: Scenario) -> str:
    motor, driver, reducer = scenario.motor, scenario.driver, scenario.reducer
    phases = "" if motor.phases == 2 else f"{motor.phases} phases, "
    voltages = {"voltage": ", driven by voltages", "pulse": ", driven by voltage pulses"}
    steps = f"{phases}{motor.rotor_teeth} rotor teeth, {driver.microsteps} microsteps per full step"
    if driver.pulsed:
        steps = f"{motor.rotor_teeth} rotor teeth, {driver.beats} steps per electrical turn"
    gears = "reducer"
    if reducer.train:
        gears = f"gear train of {count_text(len(reducer.train), 'stage')}"
    stiffness = "rigid"
    if not reducer.rigid:
        stiffness = f"{float(reducer.stiffness):.5g} N m/rad"
    return f"{steps}{voltages.get(driver.drive, '')}, {gears} {reducer.ratio:.6g}:1, {stiffness}"


def _motion(result: RunResult) -> str:
    rate, f_d = result.scenario.rate, result.scenario.driving_frequency
    parts = ["at a rate that changes" if rate is None else f"at {math.degrees(rate):.6g} deg/s"]
    if f_d:
        parts.append(f"driving frequency {f_d:.5g} Hz")
    if result.motion is not None and "stuck_output" in result.motion.channels:
        sticks = 100 * result.motion["stuck_output"].mean()
        parts.append(f"the shaft sticks {sticks:.3g} % of the time")
    return ", ".join(parts)


def _numerics(result: RunResult) -> Iterator[tuple[str, str]]:
    """How each drive was solved, and how well."""
    fails = failed_invariants(result)
    if result.state is not None:
        for whose, of in result.drives.items():
            yield f"Steady state{whose}", _steady_state(of.solver)
    for whose, one in drives(result).items():
        yield f"Invariants{whose}", invariants_sentence(one, fails)
        estimate = read_error_estimate(one.solver)
        if estimate is not None:
            yield f"Integration{whose}", str(estimate)


def _steady_state(solver: dict[str, Any]) -> str:
    arrived = ""
    if "arrived_s" in solver:
        arrived = f"; a run from rest repeated within {solver['arrived_s']:.3g} s"
    return (
        f"repeats every {solver['period_s']:.6g} s ({solver['period_microsteps']} microsteps);"
        f" found with {solver['periods_evaluated']:.3g} periods; deviations fall to"
        f" {solver['multiplier']:.3g} in one period, to 1 % in"
        f" {solver['settling_s']:.3g} s{arrived}"
    )


def _picture(motion: Motion, lines: LineTable, judged: Judgement | None) -> Picture:
    squares = ", squares those above the limit" if judged and judged.above else ""
    highest = figures.spectrum_upper_end(main_lines(lines, judged))
    return Picture(
        "",
        partial(figures.draw_first_page, motion, lines, highest, judged),
        "Spectrum of the disturbance torque with named lines, and time history",
        "Above, amplitude spectrum of T_d, one-sided, 0-to-peak; dots are the estimated"
        f" lines{squares}. Below, T_d over the record.",
    )
