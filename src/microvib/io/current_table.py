"""Tables of a driver's currents as CSV: one row a microstep of an electrical turn, or one row a
harmonic.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import ScenarioError
from microvib.io.tables import csv_rows, parse_finite
from microvib.model.driver import MAX_CURRENT, MAX_TABLE

ANGLES = {"rad": 1.0, "deg": np.pi / 180.0}
FORMS = (
    "i_a,i_b (currents over I, a row for each microstep of an electrical turn), i_a_of_N,i_b_of_N"
    " (whole numbers, of which N is I), angle_deg or"
    " angle_rad (added to theta_e, a row for"
    " each of them), or order,amplitude_deg,phase_deg (harmonics of what is added; _rad in place of"
    " _deg is read, too)"
)


def read_current_table(path: Path) -> dict[str, Any]:
    """Keys of ``driver.table`` that a file says; ScenarioError tells the row and column that is
    wrong.

    The first line names the columns: see ``FORMS``. Rows of an electrical turn begin at theta_e =
    0.
    """
    head, *rows = csv_rows(path, ScenarioError) or [[]]
    while rows and not "".join(rows[-1]).strip():
        rows.pop()
    if len(rows) > MAX_TABLE:
        raise ScenarioError(f"{path}: has {len(rows)} rows; at most {MAX_TABLE} are read")
    names = [name.strip().lower() for name in head]
    _require_cells(path, rows, len(names))
    columns = {name: _parsed(path, rows, j, name) for j, name in enumerate(names)}
    if names and not rows:
        raise ScenarioError(f"{path}: has no rows below its first line; one or more are expected")
    if names == ["i_a", "i_b"]:
        _require_currents(path, columns, 1)
        return _currents(columns["i_a"], columns["i_b"])
    levels = _whole_numbers(path, names)
    if levels:
        _require_whole(path, columns)
        _require_currents(path, columns, levels)
        return _currents(*(columns[name] / levels for name in names))
    angle = _angle(columns, "angle")
    if len(names) == 1 and angle is not None:
        theta_e = 2.0 * np.pi * np.arange(angle.size) / angle.size + angle
        return _currents(np.cos(theta_e), np.sin(theta_e))
    amplitude, phase = _angle(columns, "amplitude"), _angle(columns, "phase")
    if names[:1] != ["order"] or amplitude is None or len(names) != (2 if phase is None else 3):
        raise ScenarioError(f"{path}: is not a table of currents; its first line must be {FORMS}")
    if phase is None:
        phase = 0.0 * amplitude
    return {"harmonics": list(map(_harmonic, columns["order"], amplitude, phase))}


def integer_columns(levels: int) -> tuple[str, str]:
    """Names of the columns of a table of whole numbers, of which ``levels`` is the current I."""
    return f"i_a_of_{levels}", f"i_b_of_{levels}"


_INTEGER_COLUMN = re.compile(r"i_[ab]_of_(\d{1,8})")


def _whole_numbers(path: Path, names: list[str]) -> int:
    """The whole number that stands for the current I; 0 where columns are no table of whole
    numbers.
    """
    found = [_INTEGER_COLUMN.fullmatch(name) for name in names]
    if len(names) != 2 or not all(found):
        return 0
    levels = int(found[0][1]) if found[0] else 0
    if names != list(integer_columns(levels)) or not levels:
        raise ScenarioError(
            f"{path}: {','.join(names)} is not allowed; i_a_of_N,i_b_of_N is expected, with one N above"
            " 0, which stands for the current I"
        )
    return levels


def _require_cells(path: Path, rows: list[list[str]], count: int) -> None:
    """ScenarioError where a row has more cells than the first line: a comma may be a decimal mark."""
    for k, row in enumerate(rows, 2):
        if len(row) > count:
            raise ScenarioError(
                f"{path}, row {k}: has {len(row)} cells; {count} are expected, as in the first line"
                " (decimal commas need semicolons between columns)"
            )


def _parsed(path: Path, rows: list[list[str]], column: int, name: str) -> np.ndarray:
    """Numbers of one column."""
    return np.array(
        [
            parse_finite(
                f"{path}, row {k}: {name}", "".join(row[column : column + 1]), ScenarioError
            )
            for k, row in enumerate(rows, 2)
        ]
    )


def _require_whole(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """ScenarioError where a column has another than a whole number."""
    for name, values in columns.items():
        for k in np.flatnonzero(values != np.rint(values))[:1].tolist():
            raise ScenarioError(
                f"{path}, row {k + 2}: {name} is {values[k]:.9g}; a whole number is expected"
                " (columns i_a,i_b have currents over I)"
            )


def _require_currents(path: Path, columns: Mapping[str, np.ndarray], one: int) -> None:
    """ScenarioError where a current is larger than ``MAX_CURRENT``, in numbers of which ``one`` is I."""
    most = MAX_CURRENT * one
    for name, values in columns.items():
        for k in np.flatnonzero(np.abs(values) > most)[:1].tolist():
            raise ScenarioError(
                f"{path}, row {k + 2}: {name} is {values[k]:.9g}; a number from {-most:g} to {most:g} is"
                f" expected, {MAX_CURRENT:g} times the current I"
            )


def _currents(i_a: np.ndarray, i_b: np.ndarray) -> dict[str, Any]:
    return {"currents": np.column_stack([i_a, i_b]).tolist()}


def _harmonic(order: float, amplitude: float, phase: float) -> dict[str, Any]:
    """One harmonic of what is added to theta_e, angles [rad]."""
    return {
        "order": int(order) if order == int(order) else float(order),
        "amplitude": f"{float(amplitude)!r} rad",
        "phase": f"{float(phase)!r} rad",
    }


def _angle(columns: dict[str, np.ndarray], stem: str) -> np.ndarray | None:
    """A column of angles [rad], whichever unit its name ends in; None where there is none."""
    return next(
        (
            columns[f"{stem}_{unit}"] * size
            for unit, size in ANGLES.items()
            if f"{stem}_{unit}" in columns
        ),
        None,
    )
