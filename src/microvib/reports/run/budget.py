"""The torque budget of a run: what the housing feels adds up to the disturbance torque, line by line with phases."""

from __future__ import annotations

import math

import numpy as np

from microvib.reports import figures, sheets
from microvib.reports.blocks import drawn
from microvib.reports.document import Section, Table, Text, table
from microvib.signals.line_table import Line, LineTable
from microvib.signals.spectrum import tone
from microvib.solve.motion import Motion

_MAX_LINES = 3
_TINY = 1e-9
"""Part of a line's largest contribution below which a phase says nothing."""


def contributions(motion: Motion) -> dict[str, np.ndarray]:
    """What the housing feels of each torque, (n,) each [N m]; they add up to T_d."""
    gear = 1.0 + 1.0 / motion.scenario.reducer.ratio
    return {
        "−T_e, motor": -motion["T_e"],
        "T_f,m, rotor friction": motion["T_f_m"],
        "T_f, output friction": motion["T_f"],
        "−(1 + 1/h) T_g, gear": -gear * motion["T_g"],
    }


def budget_section(motion: Motion, lines: LineTable) -> Section:
    """Mean, RMS and largest of each contribution, and its amplitude and phase at the main lines."""
    text = (
        "What the housing feels of each torque. The contributions add up to the disturbance torque, line by line as phasors:"
        " T_d = −T_e + T_f,m + T_f − (1 + 1/h) T_g. RMS is about the mean; phases are those of a cosine at the first sample."
    )
    drawing, axes = sheets.plain_sheet(2.9, 1, 2)
    figures.draw_torques(axes[0, 0], motion)
    figures.draw_motor_torques(axes[0, 1], motion)
    caption = (
        "Left, torques at the output less their means: T_d on the spacecraft, T_g of the gear, T_f of friction, T_l of the array."
        " Right, torques at the rotor: T_e of the motor, T_f,m of friction, T_g/h of the gear."
    )
    picture = drawn(drawing, "Torques at output and rotor through a few microsteps", caption)
    return Section("Torque budget", (Text(text), _budget(motion, main_lines(lines)), picture))


def main_lines(lines: LineTable) -> list[Line]:
    """The first driving line and the largest others, by frequency."""
    found = [x for x in lines.notable() if math.isfinite(x.amplitude_n_m)]
    found.sort(key=lambda x: (x.line != "drive_1", -x.amplitude_n_m))
    return sorted(found[:_MAX_LINES], key=lambda x: x.frequency_hz)


def _budget(motion: Motion, lines: list[Line]) -> Table:
    rows = {
        **contributions(motion),
        "T_d, their sum": motion["T_d"],
        "T_l, load of the array (not in the sum)": motion["T_l"],
    }
    torques = np.array(list(rows.values()))
    at_lines = [tone(torques, motion.sample_rate, line.frequency_hz) for line in lines]
    header = ["contribution", "mean [mN m]", "RMS [mN m]", "largest [mN m]"]
    for line in lines:
        header += [f"{line.line} [mN m]", "phase [°]"]
    columns = [_phasor_cells(values) for values in at_lines]
    phasors = [[cell for column in columns for cell in column[k]] for k in range(len(rows))]
    cells = [
        [name, _milli(float(x.mean())), _milli(float(x.std())), _milli(float(np.abs(x).max())), *at]
        for (name, x), at in zip(rows.items(), phasors, strict=True)
    ]
    return table(header, cells, "", {len(cells) - 2: "strong"})


def _phasor_cells(values: np.ndarray) -> list[tuple[str, str]]:
    """Amplitude and phase of each contribution at one line."""
    known = np.abs(values) > _TINY * np.abs(values).max()
    degrees = np.degrees(np.angle(values))
    return [(_milli(abs(v)), f"{d:+.0f}" if k else "") for v, d, k in zip(values, degrees, known, strict=True)]


def _milli(value: float) -> str:
    """A torque [N m] in mN m: four digits, and no more than a thousandth of one."""
    size = abs(1e3 * value)
    decimals = 3 if size < 1e-3 else max(0, min(3, 3 - math.floor(math.log10(size))))
    return f"{1e3 * value:.{decimals}f}"
