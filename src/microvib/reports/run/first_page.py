"""The first page of a run's report: what was simulated, its main lines with margins, the picture
that matters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microvib.analysis.accuracy import read_error_estimate
from microvib.analysis.limits import Judgement, transient_warnings
from microvib.analysis.start import steady_state_fallback_note
from microvib.reports import figures
from microvib.reports.blocks import figure_block
from microvib.reports.craft import craft_words
from microvib.reports.document import Block, Fact, Figure, Mark, Table, Text, pairs, table
from microvib.reports.numbers import (
    count_text,
    format_number,
    milli,
    torque,
    torque_as_given,
    truncate,
)
from microvib.reports.run.trust import drives, failed_invariants, invariants_sentence
from microvib.signals.line_table import NOISE_DRIVEN, Line, LineTable
from microvib.solve.motion import Motion

MAX_LINES = 10
"""Lines on the first page."""


def leading_figures(motion: Motion, lines: LineTable, judged: Judgement | None) -> tuple[Fact, ...]:
    """The verdict, or without a limit the largest lines; largest torque and RMS."""
    T_d = motion["T_d"]
    if failed_invariants(motion):
        found = [Fact("NOT to be used", "an invariant does not hold", "fail")]
    else:
        found = []
    if judged is not None:
        found += _verdict(judged)
    else:
        found += [Fact(torque(x.amplitude), _line_label(x)) for x in _largest(lines)[:2]]
    largest, rms = torque(float(np.abs(T_d).max())), torque(float(T_d.std()))
    return (*found, Fact(largest, "largest T_d"), Fact(rms, "RMS about the mean"))


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


def _verdict(judged: Judgement) -> list[Fact]:
    label = f"limit {torque_as_given(judged.limit.torque)} {judged.limit.band}".strip()
    total = len(judged.margins)
    if not total and not judged.gaps:
        return [Fact("no line to judge", label)]
    whole = {
        "fail": Fact(f"FAIL: {judged.above} of {total} lines", label, "fail"),
        "pass": Fact(f"Pass: {count_text(total, 'line')}", label, "pass"),
        "not judged": Fact(
            "Not judged", f"{label}: {judged.gaps[0] if judged.gaps else ''}", "fail"
        ),
    }[judged.verdict]
    worst = judged.worst
    if worst is None:
        return [whole]
    smallest = f"smallest margin, factor {format_number(worst.factor, 3)}: {worst.line.name}"
    return [whole, Fact(f"{worst.decibel:+.1f} dB", smallest)]


def _largest(lines: LineTable) -> list[Line]:
    seen = [x for x in lines.notable() if x.seen]
    return sorted(seen, key=lambda x: -x.amplitude)


def first_page(motion: Motion, lines: LineTable, judged: Judgement | None) -> tuple[Block, ...]:
    """What was simulated, the main lines, what they do not say by themselves, and the picture."""
    scenario = motion.scenario
    unusual, told = scenario.unusual_values(), steady_state_fallback_note(motion.solver)
    notes = [told] if told else []
    notes += [f"{text}." for text in unusual[:4]]
    if len(unusual) > 4:
        notes += [f"So are {len(unusual) - 4} more; `microvib show scenario.yaml` names them."]
    else:
        notes += []
    notes += transient_warnings(lines, scenario)
    if judged is not None:
        of_draws = any(lines.over_seeds(margin.line.name) for margin in judged.margins)
        alone = "" if of_draws else " of this one run,"
        if of_draws:
            quantile = (
                ", of lines that several draws of the noise were run of over their 95 % quantile"
            )
        else:
            quantile = ""
        notes += [
            f"A margin is limit over amplitude{quantile},{alone} without allowance for the"
            " uncertainty of parameters.",
            *([judged.not_judged(4).strip()] if judged.gaps else []),
        ]
    if notes:
        noted = [Text(" ".join(notes), note=True)]
    else:
        noted = []
    return (
        pairs(_simulated(motion)),
        _main_lines(lines, judged),
        *noted,
        _picture(motion, lines, judged),
    )


def _simulated(motion: Motion) -> list[tuple[str, str]]:
    scenario = motion.scenario
    motor, driver, reducer = scenario.motor, scenario.driver, scenario.reducer
    array, record = scenario.array, scenario.record
    if reducer.rigid:
        stiffness = "rigid"
    else:
        stiffness = f"{float(reducer.stiffness):.5g} N m/rad"
    if array.modes:
        first = f", the first clamped at {array.modes[0].frequency:.5g} Hz"
    else:
        first = ""
    if motor.phases == 2:
        phases = ""
    else:
        phases = f"{motor.phases} phases, "
    steps = f"{phases}{motor.rotor_teeth} rotor teeth, {driver.microsteps} microsteps per full step"
    if reducer.train:
        gears = f"gear train of {count_text(len(reducer.train), 'stage')}"
    else:
        gears = "reducer"
    if driver.drive == "voltage":
        steps += ", driven by voltages"
    else:
        steps += ""
    rows = {
        "Drive": f"{steps}, {gears} {reducer.ratio:.6g}:1, {stiffness}",
        "Array": f"{array.inertia:.5g} kg m² about {array.drive_axis}, {count_text(len(array.modes), 'mode')}{first}",
        "Spacecraft": "" if scenario.spacecraft is None else craft_words(scenario.spacecraft),
        "Motion": _motion(motion),
        "Record": f"{record.duration:g} s at {record.sample_rate:g} Hz after {record.settle:g} s",
        "Values": truncate(scenario.source, 160),
    }
    for whose, one in drives(motion).items():
        estimate = read_error_estimate(one.solver)
        rows[f"Invariants{whose}"] = invariants_sentence(one)
        if estimate is None:
            rows[f"Integration{whose}"] = ""
        else:
            rows[f"Integration{whose}"] = str(estimate)
    return [(name, text) for name, text in rows.items() if text]


def _motion(motion: Motion) -> str:
    rate, f_d = motion.scenario.rate, motion.scenario.driving_frequency
    parts = ["at a rate that changes" if rate is None else f"at {math.degrees(rate):.6g} deg/s"]
    if f_d:
        parts += [f"driving frequency {f_d:.5g} Hz"]
    else:
        parts += []
    if "stuck_output" in motion.channels:
        parts.append(f"the shaft sticks {100 * motion['stuck_output'].mean():.3g} % of the time")
    return ", ".join(parts)


def _shown(lines: LineTable, judged: Judgement | None) -> list[Line]:
    """The largest lines, or those with the smallest margins, by frequency."""
    if judged:
        of_limit = [m.line for m in judged.margins[:MAX_LINES]]
    else:
        of_limit = []
    return sorted(of_limit if judged else _largest(lines)[:MAX_LINES], key=lambda x: x.frequency)


def _main_lines(lines: LineTable, judged: Judgement | None) -> Table:
    shown = _shown(lines, judged)
    header = [
        "line",
        "frequency [Hz]",
        "amplitude [mN m]",
        *(VERDICT_HEADS if judged else ["what it is"]),
    ]
    rows = [
        [
            x.name,
            format_number(x.frequency, 5),
            milli(x.amplitude),
            *(judged_cells(x, judged) if judged else [origin_and_status(x)]),
        ]
        for x in shown
    ]
    if judged:
        most = "smallest margins"
    else:
        most = "largest amplitudes"
    if len(shown) < len(lines):
        which = f"The {len(shown)} of {len(lines)} lines with the {most}. "
    else:
        which = ""
    return table(header, rows, f"{which}Amplitudes 0-to-peak.", row_marks(shown, judged))


VERDICT_HEADS = ["margin [dB]", "factor [1]", "verdict"]
"""Heads of ``judged_cells``."""


def judged_cells(line: Line, judged: Judgement) -> list[str]:
    """Margin in dB and as a factor, and the verdict in a word; a line may also be outside the band."""
    margin = judged.of(line)
    if margin is None:
        return ["", "", "not judged" if line in judged.unknown else "outside"]
    return [
        f"{margin.decibel:+.1f}" if math.isfinite(margin.decibel) else "",
        format_number(margin.factor, 3),
        "FAIL" if margin.fails else margin.verdict,
    ]


def row_marks(shown: Sequence[Line], judged: Judgement | None) -> dict[int, Mark]:
    """How the rows of lines stand out."""
    if judged is None:
        margins = {}
    else:
        margins = {k: judged.of(x) for k, x in enumerate(shown)}
    return {
        k: "fail" if m.fails else "pass"
        for k, m in margins.items()
        if m is not None and m.verdict != "not judged"
    }


def origin_and_status(line: Line) -> str:
    """Origin of a line, and its status where that is not simply seen."""
    if line.status == "ok":
        return line.origin
    return f"{line.origin}; {line.status}"


def _picture(motion: Motion, lines: LineTable, judged: Judgement | None) -> Figure:
    if judged and judged.above:
        squares = ", squares those above the limit"
    else:
        squares = ""
    caption = (
        "Above, amplitude spectrum of T_d, one-sided, 0-to-peak; dots are the estimated"
        f" lines{squares}. Below, T_d over the"
        " record."
    )
    alt = "Spectrum of the disturbance torque with named lines, and time history"
    highest = figures.spectrum_upper_end(_shown(lines, judged))
    return figure_block(figures.draw_first_page(motion, lines, highest, judged), alt, caption)
