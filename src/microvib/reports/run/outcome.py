"""A run for those who read it: what was simulated, its lines against a limit, and what they rest
on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from microvib.analysis.accuracy import ERROR_ESTIMATE_KEY
from microvib.analysis.budget import torque_budget
from microvib.analysis.limits import Judgement
from microvib.analysis.run import RunResult
from microvib.model.line_names import driving_line
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.reports import figures, sheets
from microvib.reports.craft import craft_parts, pointing_facts
from microvib.reports.document import Code, Fact, Text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.reports.parameters import derived_table, parameter_items, status_sentence
from microvib.reports.run.first_page import first_page, leading_figures
from microvib.reports.run.lines import all_lines, beside_reference, lines_over_seeds
from microvib.reports.run.margins import judgement_data, margin_items, margins_csv
from microvib.reports.run.trust import invariants
from microvib.results import Column, Measure, Table
from microvib.signals.limit_curve import Limit
from microvib.signals.line_table import Line, LineTable
from microvib.solve.motion import Motion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HIDDEN_SOLVER_KEYS = ("wall_s", "times_real_time", ERROR_ESTIMATE_KEY)
"""Keys of the solver's account that differ from run to run, or are given in words."""
_MAX_LINES = 3
_CONTRIBUTIONS = {
    "T_e": "−T_e, motor",
    "T_f_m": "T_f,m, rotor friction",
    "T_f": "T_f, output friction",
    "T_g": "−(1 + 1/h) T_g, gear",
    "T_d": "T_d, their sum",
    "T_l": "T_l, load of the array (not in the sum)",
}
"""Each torque, as the housing feels it."""
_MIN_PHASE_RATIO = 1e-9
"""Part of a line's largest contribution below which a phase says nothing."""


def run_outcome(
    result: RunResult,
    limit: Limit | None = None,
    versions: Mapping[str, str] | None = None,
) -> Outcome:
    """A run for those who read it; a ``limit`` judges its lines.

    Without a motion, only its lines are told. ``versions`` are those that made it, without them
    today's.
    """
    scenario = result.scenario
    judged = None if limit is None else judge_run(result, limit)
    first, *of_lines = judged_parts(result, judged)
    return Outcome(
        "Run report",
        scenario.title or "microvib run",
        "Disturbance torque T_d of the solar array drive on the spacecraft, about the drive axis"
        f" ({scenario.array.drive_axis}).",
        "" if judged is None else judged.verdict,
        run_facts(result, judged),
        (
            first,
            *of_lines,
            *_of_craft(result),
            Part("Beside measured lines", tuple(beside_reference(scenario, result.table))),
            *_of_motion(result),
            Part("Natural frequencies", (_frequencies(scenario),), not_on_terminal=True),
            Part(
                "Parameters",
                (Text(status_sentence(scenario)), *parameter_items(scenario)),
                new_page=True,
                report_only=True,
            ),
            Part("Derived values", (derived_table(scenario),), report_only=True),
            Part("Method", tuple(_method(result)), report_only=True),
            Part("Can it be trusted?", tuple(invariants(result)), not_on_terminal=True),
        ),
        scenario,
        again=(
            Text("In the folder of this report (the scenario there is complete):"),
            Code("microvib run scenario.yaml --out again"),
        ),
        versions=versions,
        data={} if judged is None else {"judgement": judgement_data(judged)},
        other_files={} if judged is None else {"margins.csv": margins_csv(judged)},
    )


def judge_run(result: RunResult, limit: Limit) -> Judgement:
    """The lines of a run, and of its second wing's drive, against a limit."""
    if result.judgement is not None and result.judgement.limit == limit:
        return result.judgement
    return result.judge(limit)


def run_facts(result: RunResult, judged: Judgement | None) -> tuple[Fact, ...]:
    """Leading figures of a run."""
    return (*leading_figures(result, judged), *pointing_facts(result.hub))


def judged_parts(result: RunResult, judged: Judgement | None) -> tuple[Part, ...]:
    """The parts of a run's outcome that a limit changes: the first page, and its lines."""
    return (
        Part("", tuple(first_page(result, judged))),
        Part("All lines", tuple(all_lines(result.table, judged)), new_page=True),
        Part("Against the limit", () if judged is None else tuple(margin_items(judged))),
        Part("Lines over draws of the noise", tuple(lines_over_seeds(result.table, judged))),
    )


def _of_craft(result: RunResult) -> Iterator[Part]:
    if result.motion is not None and result.hub is not None:
        yield from craft_parts(result.motion, result.hub)


def _of_motion(result: RunResult) -> Iterator[Part]:
    """Pictures and torques of the motion; nothing where lines alone were asked for."""
    motion, lines = result.motion, result.table
    if motion is None:
        return
    zoom = Picture(
        "",
        partial(_draw_zoom, motion, lines),
        "Amplitude spectrum about the array's modes",
        "Seen through the compliant drive, a mode below the drive resonance lies below its clamped"
        " frequency.",
    )
    stretch = Picture(
        "",
        partial(_draw_microsteps, motion),
        "Disturbance torque through a few microsteps",
        "T_d through the first microsteps of the record. Grey: the output shaft sticks, its rate is"
        " exactly zero.",
    )
    yield Part("About the array's modes", (zoom,), report_only=True)
    yield Part("Through the microsteps", (stretch,), report_only=True)
    yield Part("Torque budget", tuple(_torque_budget(motion, lines)), not_on_terminal=True)
    if motion.scenario.friction.memory:
        loop = Picture(
            "",
            partial(_draw_friction_loop, motion),
            "Friction torque over the output's angle",
            "Left: a shaft at rest before, turned slowly to and fro until all elements slide, and"
            " by less. Right: through the first microsteps of the record.",
        )
        yield Part("Friction with memory", (loop,), report_only=True)


def _draw_zoom(motion: Motion, lines: LineTable) -> Figure:
    drawing, axes = sheets.plain_sheet(2.6)
    figures.draw_array_zoom(axes[0, 0], motion, lines)
    return drawing


def _draw_microsteps(motion: Motion) -> Figure:
    drawing, axes = sheets.plain_sheet(2.4)
    figures.draw_microsteps(axes[0, 0], motion)
    return drawing


def _draw_friction_loop(motion: Motion) -> Figure:
    drawing, axes = sheets.plain_sheet(2.9, 1, 2)
    figures.draw_friction_loop(axes[0, 0], axes[0, 1], motion)
    return drawing


def _draw_torques(motion: Motion) -> Figure:
    drawing, axes = sheets.plain_sheet(2.9, 1, 2)
    figures.draw_torques(axes[0, 0], axes[0, 1], motion)
    return drawing


def _torque_budget(motion: Motion, lines: LineTable) -> Iterator[Item]:
    yield Text(
        "The torques on the housing, which add up to the disturbance torque, line by line as"
        " phasors: T_d = −T_e + T_f,m + T_f − (1 + 1/h) T_g. RMS is about the mean; phases are"
        " those of a cosine at the first sample."
    )
    yield _contributions(motion, _main_lines(lines))
    yield Picture(
        "",
        partial(_draw_torques, motion),
        "Torques at output and rotor through a few microsteps",
        "Left, torques at the output less their means: T_d on the spacecraft, T_g of the gear, T_f"
        " of friction, T_l of the array. Right, torques at the rotor: T_e of the motor, T_f,m of"
        " friction, T_g/h of the gear.",
    )


def _main_lines(lines: LineTable) -> list[Line]:
    """The first driving line and the largest others, by frequency."""
    found = (x for x in lines.notable() if math.isfinite(x.amplitude))
    main = sorted(found, key=lambda x: (x.name != driving_line(1), -x.amplitude))[:_MAX_LINES]
    return sorted(main, key=lambda x: x.frequency)


_TORQUE = Measure("mN m", 1e-3, "z.3f")
_PHASE = Measure("°", math.radians(1.0), "+.0f")


def _contributions(motion: Motion, lines: list[Line]) -> Table:
    """Mean, RMS and largest value of each contribution, then its amplitude and phase at each line."""
    shares = torque_budget(motion, [line.frequency for line in lines])
    on_housing = {name: shares[name].on_housing for name in _CONTRIBUTIONS}
    tones = np.array([x.tones for x in on_housing.values()]).reshape(len(on_housing), len(lines))
    least = _MIN_PHASE_RATIO * np.abs(tones).max(axis=0, initial=0.0)
    phases = np.where(np.abs(tones) > least, np.angle(tones), np.nan)
    columns = [
        Column("contribution", "contribution"),
        Column("mean_n_m", "mean", _TORQUE),
        Column("rms_n_m", "RMS", _TORQUE),
        Column("largest_n_m", "largest", _TORQUE),
    ]
    for line in lines:
        columns.append(Column(f"{line.name}_n_m", line.name, _TORQUE))
        columns.append(Column(f"{line.name}_phase", "phase", _PHASE))
    columns.append(Column("role", role="verdict"))
    rows = tuple(
        (
            _CONTRIBUTIONS[name],
            x.mean,
            x.rms,
            x.peak,
            *np.column_stack([np.abs(tones[k]), phases[k]]).ravel().tolist(),
            "sum" if name == "T_d" else "",
        )
        for k, (name, x) in enumerate(on_housing.items())
    )
    return Table("", tuple(columns), rows)


_FREQUENCY = Measure("Hz", form="#.5g")


def _frequencies(scenario: Scenario) -> Table:
    columns = (
        Column("name", "name"),
        Column("clamped_hz", "clamped", _FREQUENCY),
        Column("frequency_hz", "through the drive", _FREQUENCY),
        Column("damping", "damping ratio", Measure("%", 0.01, "#.3g")),
    )
    rows = tuple(
        (m.name, m.fixed_frequency or math.nan, m.frequency, m.damping)
        for m in coupled_modes(scenario)[:40]
    )
    caption = "Of the linearised drive: mean electromagnetic spring, no Coulomb friction, no detent torque."
    return Table("", columns, rows, caption=caption)


def _method(result: RunResult) -> Iterator[Item]:
    duration = result.scenario.record.duration
    yield Text(
        "The equations of motor, current loop, microstep command, frictions, reducer and flexible"
        " array are integrated in time with adaptive steps; stick and slip are located as events."
        " T_d is what the angular momentum of drive and array loses (Eq. 20). Lines come from one"
        " Hann-windowed spectrum: the lines of the step clock share one clock ratio, array modes"
        " are fitted as decaying tones, and all amplitudes come from one least-squares fit. The"
        f" record of {duration:g} s has bins of {1 / duration:.4g} Hz."
    )
    solver = result.solver if result.motion is None else result.motion.solver
    yield Pairs(
        tuple(_account(*item) for item in solver.items() if item[0] not in _HIDDEN_SOLVER_KEYS)
    )


def _account(key: str, value: object) -> tuple[str, str]:
    """Value of a solver, by its name with the unit."""
    name = key.removesuffix("_s").replace("_", " ") + (" [s]" if key.endswith("_s") else "")
    return name, f"{value:.4g}" if isinstance(value, float) else str(value)
