"""The torque budget of a run: what the housing feels adds up to the disturbance torque, line by line with phases."""

from __future__ import annotations

import math

import numpy as np

from microvib.analysis.budget import budget
from microvib.reports import figures, sheets
from microvib.reports.blocks import drawn
from microvib.reports.document import Section, Table, Text, table
from microvib.signals.line_table import Line, LineTable
from microvib.solve.motion import Motion

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
_TINY = 1e-9
"""Part of a line's largest contribution below which a phase says nothing."""


def budget_section(motion: Motion, lines: LineTable) -> Section:
    """Mean, RMS and largest of each contribution, and its amplitude and phase at the main lines."""
    text = (
        "The torques on the housing, which add up to the disturbance torque, line by line as phasors:"
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
    shares = budget(motion, [line.frequency_hz for line in lines])
    felt = [shares[name].felt for name in _ROWS]
    header = ["contribution", "mean [mN m]", "RMS [mN m]", "largest [mN m]"]
    cells = [
        [text, _milli(x.mean), _milli(x.rms), _milli(x.peak)] for text, x in zip(_ROWS.values(), felt, strict=True)
    ]
    for k, line in enumerate(lines):
        header += [f"{line.line} [mN m]", "phase [°]"]
        for row, at in zip(cells, _phasor_cells(np.array([x.tones[k] for x in felt])), strict=True):
            row += at
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
