"""The report of a run: what was simulated, its lines against a limit, and what they rest on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from microvib.analysis.accuracy import ERROR_ESTIMATE_KEY
from microvib.analysis.budget import torque_budget
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.limits import Judgement, Limit, judge
from microvib.analysis.pointing import HubLines
from microvib.analysis.reference import (
    compare_with_reference,
    comparison_worth,
    estimator_text,
)
from microvib.analysis.run import lines_of_second
from microvib.model.line_names import driving_line
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.reports import figures, sheets
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.craft import craft_sections, pointing_facts
from microvib.reports.document import Code, Document, Section, Table, Text, pairs, table
from microvib.reports.numbers import brief_number, count_text, format_number, milli, percent
from microvib.reports.parameters import derived_values, parameter_blocks, status_sentence
from microvib.reports.run.first_page import (
    first_page,
    judged_cells,
    leading_figures,
    origin_and_status,
    row_marks,
)
from microvib.reports.run.trust import invariants_section
from microvib.signals.line_table import BELOW_FLOOR, Line, LineTable
from microvib.solve.motion import Motion

_HIDDEN_SOLVER_KEYS = ("wall_s", "times_real_time", ERROR_ESTIMATE_KEY)
"""What of the solver's account differs from run to run, or is told in words."""
_MAX_LINES = 3
_ROWS = {
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


def run_report(
    motion: Motion,
    lines: LineTable,
    *,
    hub: HubLines | None = None,
    second: LineTable | None = None,
    limit: Limit | None = None,
    versions: Mapping[str, str] | None = None,
) -> Document:
    """The report on one run; ``versions`` are those that made the motion, without them today's.

    ``hub`` are the lines of a craft's hub, ``second`` those of its second wing's drive; without
    them they are found in the motion.
    """
    scenario, axis = motion.scenario, motion.scenario.array.drive_axis
    again = (
        Text("In the folder of this report (the scenario there is complete):"),
        Code("microvib run scenario.yaml --out again"),
    )
    if limit is None:
        judged = None
    else:
        judged = judge(lines, limit, scenario, second or lines_of_second(motion, lines))
    if hub is None and scenario.spacecraft is not None:
        hub = hub_lines(motion, lines)
    return study_report(
        "Run report",
        scenario.title or "microvib run",
        "Disturbance torque T_d of the solar array drive on the spacecraft, about the drive axis"
        f" ({axis}).",
        facts=(*leading_figures(motion, lines, judged), *pointing_facts(hub)),
        first_page=first_page(motion, lines, judged),
        sections=(
            _all_lines(lines, judged),
            *(() if hub is None else craft_sections(motion, hub)),
            *_beside_reference(scenario, lines),
            *_pictures(motion, lines),
            _torque_budget(motion, lines),
            *_friction_loop(motion),
            _frequencies(scenario),
            Section(
                "Parameters",
                (Text(status_sentence(scenario)), *parameter_blocks(scenario)),
                new_page=True,
            ),
            Section(
                "Derived values",
                (table(["quantity", "value [1]", "by"], derived_values(scenario)),),
            ),
            _method(motion),
            invariants_section(motion),
        ),
        scenario=scenario,
        versions=versions,
        again=again,
    )


def _all_lines(lines: LineTable, judged: Judgement | None) -> Section:
    worth = {x.name for x in lines.notable()} | {
        m.line.name for m in (judged.margins if judged else ()) if m.fails
    }
    shown = tuple(x for x in lines if x.name in worth)
    header = [
        "line", "expected [Hz]", "found [Hz]", "amplitude [mN m]", "phase [rad]", "nearest bin [Hz]", "nearest bin [mN m]",
        "what it is", *(["margin [dB]", "verdict"] if judged else []),
    ]  # fmt: skip
    rows = [[*_line_cells(x), *(judged_cells(x, judged)[::2] if judged else [])] for x in shown]
    text = (
        "Amplitudes are 0-to-peak and do not depend on where the bins fall. Nearest bin is the"
        " figure of a rectangular window, which reads up to 36 % low between bins. A decaying line is quoted"
        " with its mean over the"
        " record. Phases are those of a cosine at the first sample."
    )
    listed = table(header, rows, _omitted_lines_note(lines, shown), row_marks(shown, judged))
    return Section("All lines", (Text(text), listed, *_over_seeds(lines, shown)), new_page=True)


def _over_seeds(lines: LineTable, shown: Sequence[Line]) -> tuple[Text | Table, ...]:
    """The lines over many draws of the noise."""
    found = [seed for x in shown if (seed := lines.over_seeds(x.name))]
    if not found:
        return ()
    text = (
        f"Over {found[0].draws} draws of the noise, this record's and those of the following seeds."
        " The 95 % quantile is given with"
        " what this many draws say about it, each bound with 95 % confidence; fewer than 59 do not"
        " bound it from above."
    )
    header = [
        "line",
        "draws [1]",
        "mean [mN m]",
        "deviation [mN m]",
        "95 % [mN m]",
        "at least [mN m]",
        "at most [mN m]",
    ]
    rows = [
        [
            x.name,
            str(x.draws),
            *map(milli, (x.mean, x.deviation, x.p95, x.p95_low, x.p95_high)),
        ]
        for x in found
    ]
    return Text(text), table(header, rows)


def _line_cells(x: Line) -> list[str]:
    if math.isfinite(x.phase):
        phase = f"{x.phase:.3f}"
    else:
        phase = ""
    expected, found, bin_hz = (
        format_number(f, 7) for f in (x.expected, x.frequency, x.bin_frequency)
    )
    return [
        x.name,
        expected,
        found,
        milli(x.amplitude),
        phase,
        bin_hz,
        milli(x.bin_amplitude),
        origin_and_status(x),
    ]


def _omitted_lines_note(lines: LineTable, shown: tuple[Line, ...]) -> str:
    """A sentence on the lines that are left to the CSV file."""
    faint = [x.name for x in lines if x.status == BELOW_FLOOR]
    small = sum(x.status != BELOW_FLOOR for x in lines) - sum(
        x.status != BELOW_FLOOR for x in shown
    )
    if small:
        parts = [f"{count_text(small, 'small line')} more in `lines.csv`."]
    else:
        parts = []
    if faint:
        parts += [f"Expected, but not above the floor: {', '.join(faint)}."]
    else:
        parts += []
    return " ".join(parts)


def _beside_reference(scenario: Scenario, lines: LineTable) -> list[Section]:
    found, reference = compare_with_reference(scenario, lines), scenario.reference
    if not found or reference is None:
        return []
    rows = [
        [r.line, *(brief_number(f, 7) for f in (r.measured_hz, r.model_hz, r.run_hz)),
         *(milli(a) for a in (r.measured_n_m, r.model_n_m, r.run_n_m)),
         *(percent(e) for e in (r.model_error, r.run_error))]
        for r in found
    ]  # fmt: skip
    header = ["line", "measured [Hz]", "model [Hz]", "this run [Hz]", "measured [mN m]", "model [mN m]", "this run [mN m]",
              "model over measured [%]", "this run over measured [%]"]  # fmt: skip
    text = f"Amplitudes: {estimator_text(reference)}; {comparison_worth(scenario)}."
    caption = (
        f"Measured, and by the publication's own model: {reference.source}. The last columns are"
        " differences of amplitude."
    )
    return [Section("Beside measured lines", (Text(text), table(header, rows, caption)))]


def _pictures(motion: Motion, lines: LineTable) -> tuple[Section, Section]:
    (zoom, about), (stretch, through) = (sheets.plain_sheet(height) for height in (2.6, 2.4))
    figures.draw_array_zoom(about[0, 0], motion, lines)
    figures.draw_microsteps(through[0, 0], motion)
    clamped = "Seen through the compliant drive, a mode below the hub's resonance lies below its clamped frequency."
    sticks = "T_d through the first microsteps of the record. Grey: the output shaft sticks, its rate is exactly zero."
    return (
        Section(
            "About the array's modes",
            (figure_block(zoom, "Amplitude spectrum about the array's modes", clamped),),
        ),
        Section(
            "Through the microsteps",
            (figure_block(stretch, "Disturbance torque through a few microsteps", sticks),),
        ),
    )


def _friction_loop(motion: Motion) -> list[Section]:
    if not motion.scenario.friction.memory:
        return []
    drawing, axes = sheets.plain_sheet(2.9, 1, 2)
    figures.draw_friction_loop(axes[0, 0], axes[0, 1], motion)
    caption = (
        "Left: a shaft at rest before, turned slowly to and fro until all elements slide, and by"
        " less. Right: through the first"
        " microsteps of the record."
    )
    return [
        Section(
            "Friction with memory",
            (figure_block(drawing, "Friction torque over the output's angle", caption),),
        )
    ]


def _torque_budget(motion: Motion, lines: LineTable) -> Section:
    text = (
        "The torques on the housing, which add up to the disturbance torque, line by line as"
        " phasors:"
        " T_d = −T_e + T_f,m + T_f − (1 + 1/h) T_g. RMS is about the mean; phases are those of a"
        " cosine at the first sample."
    )
    drawing, axes = sheets.plain_sheet(2.9, 1, 2)
    figures.draw_torques(axes[0, 0], axes[0, 1], motion)
    caption = (
        "Left, torques at the output less their means: T_d on the spacecraft, T_g of the gear, T_f"
        " of friction, T_l of the array."
        " Right, torques at the rotor: T_e of the motor, T_f,m of friction, T_g/h of the gear."
    )
    picture = figure_block(drawing, "Torques at output and rotor through a few microsteps", caption)
    return Section("Torque budget", (Text(text), _budget(motion, _main_lines(lines)), picture))


def _main_lines(lines: LineTable) -> list[Line]:
    """The first driving line and the largest others, by frequency."""
    found = (x for x in lines.notable() if math.isfinite(x.amplitude))
    main = sorted(found, key=lambda x: (x.name != driving_line(1), -x.amplitude))[:_MAX_LINES]
    return sorted(main, key=lambda x: x.frequency)


def _budget(motion: Motion, lines: list[Line]) -> Table:
    """Mean, RMS and largest value of each contribution, then its amplitude and phase at each line."""
    shares = torque_budget(motion, [line.frequency for line in lines])
    felt = [shares[name].felt for name in _ROWS]
    header = ["contribution", "mean [mN m]", "RMS [mN m]", "largest [mN m]"]
    header += [text for line in lines for text in (f"{line.name} [mN m]", "phase [°]")]
    least = [_MIN_PHASE_RATIO * max(abs(x.tones[k]) for x in felt) for k in range(len(lines))]
    cells = []
    for text, x in zip(_ROWS.values(), felt, strict=True):
        phasors = [
            cell
            for v, small in zip(x.tones, least, strict=True)
            for cell in (
                _milli(abs(v)),
                f"{np.degrees(np.angle(v)):+.0f}" if abs(v) > small else "",
            )
        ]
        cells.append([text, _milli(x.mean), _milli(x.rms), _milli(x.peak), *phasors])
    return table(header, cells, "", {len(cells) - 2: "strong"})


def _milli(value: float) -> str:
    """A torque [N m] in mN m: four digits, and no more than a thousandth of one."""
    size = abs(1e3 * value)
    if size < 1e-3:
        decimals = 3
    else:
        decimals = max(0, min(3, 3 - math.floor(math.log10(size))))
    return f"{1e3 * value:.{decimals}f}"


def _frequencies(scenario: Scenario) -> Section:
    rows = [
        [m.name, format_number(m.fixed_frequency or math.nan, 5), format_number(m.frequency, 5), format_number(100 * m.damping, 3)]
        for m in coupled_modes(scenario)[:40]
    ]  # fmt: skip
    header = ["name", "clamped [Hz]", "through the drive [Hz]", "damping ratio [%]"]
    caption = "Of the linearised drive: mean electromagnetic spring, no Coulomb friction, no detent torque."
    return Section("Natural frequencies", (table(header, rows, caption),))


def _method(motion: Motion) -> Section:
    duration = motion.scenario.record.duration
    text = (
        "The equations of motor, current loop, microstep command, frictions, reducer and flexible"
        " array are integrated in time"
        " with adaptive steps; stick and slip are located as events. T_d is what the angular"
        " momentum of drive"
        " and array loses (Eq. 20). Lines come from one Hann-windowed spectrum: the lines of the"
        " step clock share one clock ratio,"
        " array modes are fitted as decaying tones, and all amplitudes come from one least-squares"
        " fit. The record of"
        f" {duration:g} s has bins of {1 / duration:.4g} Hz."
    )
    account = []
    for key, value in motion.solver.items():
        name = key.removesuffix("_s").replace("_", " ") + (" [s]" if key.endswith("_s") else "")
        if key not in _HIDDEN_SOLVER_KEYS:
            account += [(name, f"{value:.4g}" if isinstance(value, float) else str(value))]
        else:
            account += []
    return Section("Method", (Text(text), pairs(account)))
