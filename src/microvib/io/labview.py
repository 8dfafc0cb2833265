"""LabVIEW measurement files (.lvm): text with a header of its own and, before each segment, one of
its channels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from microvib.io.delimited import read_delimited, read_text_of
from microvib.io.measured import Axis, Column, Hints, recording_of
from microvib.io.stated_scales import names_factor
from microvib.testdata.recording import Recording, RecordingError

_END = "***End_of_Header***"
_AXES_OF = {"no": 0, "one": 1}
_REMARKS = ("Description", "Notes", "Comment", "Test_Name", "Project", "Y_Dimension")
"""Keys of free texts."""


@dataclass(frozen=True)
class _Segment:
    """Header of a segment, by key one cell for each channel, the names of its columns and its rows."""

    said: dict[str, list[str]]
    names: list[str]
    rows: list[list[str]]


def read_labview(path: Path, hints: Hints) -> Recording:
    """Recording of a file's only segment; a file without its header is read as a table of text."""
    lines = read_text_of(path).splitlines()
    if not lines or not lines[0].startswith("LabVIEW Measurement"):
        return read_delimited(path, hints)
    ends = [k for k, line in enumerate(lines) if line.startswith(_END)]
    if not ends:
        raise RecordingError("is truncated; its header does not end")
    if len(ends) > 2:
        raise RecordingError(
            f"has {len(ends) - 1} segments; save them as files of their own, or write the file with"
            " one header only"
        )
    top = [line for line in lines[: ends[0]] if line.strip()]
    separator = _separator(top)
    file = {line.split(separator)[0]: line.split(separator)[1:] for line in top}
    decimal = (file.get("Decimal_Separator") or ["."])[0].strip() or "."
    segment = _segment(lines[ends[0] + 1 :], separator, decimal)
    shared = _AXES_OF.get((file.get("X_Columns") or ["One"])[0].strip().lower())
    remarks = tuple(_remarks(file))
    columns = [replace(c, remarks=(*remarks, *c.remarks)) for c in _columns(segment, shared)]
    return recording_of(columns, hints)


def _remarks(said: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Free texts of a header."""
    for key in _REMARKS:
        text = " ".join(said.get(key, ())).strip()
        if text:
            yield f"{key}: {text}"


def _separator(top: Sequence[str]) -> str:
    said = [line.lower() for line in top if line.lower().startswith("separator")]
    if any("comma" in line for line in said):
        return ","
    return "\t"


def _segment(lines: Sequence[str], separator: str, decimal: str) -> _Segment:
    end = next((k for k, line in enumerate(lines) if line.startswith(_END)), -1)
    said = {}
    for line in lines[: max(end, 0)]:
        cells = line.split(separator)
        if cells[0].strip():
            said[cells[0].strip()] = [
                cell.strip().replace(",", ".") if _numeric(cell) else cell.strip()
                for cell in cells[1:]
            ]
    body = [line for line in lines[end + 1 :] if line.strip(separator + " ")]
    if not body:
        raise RecordingError("is truncated; it has no rows of numbers")
    names = [name.strip() for name in body[0].split(separator)]
    rows = [
        [cell.strip().replace(decimal, ".") for cell in line.split(separator)] for line in body[1:]
    ]
    return _Segment(said, names, rows)


def _numeric(cell: str) -> bool:
    return bool(cell.strip()) and not cell.strip().strip("+-0123456789.,eE")


def _columns(segment: _Segment, shared: int | None) -> list[Column]:
    """Channels of a segment; ``shared`` is how many columns of x there are for all of them, None
    for one each.
    """
    names = segment.names
    if names[-1].lower() == "comment":
        names = names[:-1]
    if shared == 0 and names and names[0].lower() in ("", "x_value"):
        names = ["", *names[1:]]
    table = _numbers(segment.rows, names)
    found: list[Column] = []
    xs: list[np.ndarray] = []  # the columns of x so far
    for name, values in zip(names, table.T, strict=True):
        if name.lower().startswith("x_value"):
            xs.append(values)
        elif name:
            x = None
            if xs:
                x = xs[-1] if shared is None else xs[0]
            found.append(_column(segment.said, name, len(found), values, x))
    if not found:
        raise RecordingError("has no channels")
    return found


def _numbers(rows: Sequence[Sequence[str]], names: Sequence[str]) -> np.ndarray:
    """Cells as numbers, (rows, columns), nan where a cell is empty or missing."""
    table = np.full((len(rows), len(names)), np.nan)
    for k, row in enumerate(rows):
        for j, (name, cell) in enumerate(zip(names, row, strict=False)):
            if cell:
                table[k, j] = _number(cell, f"row {k + 1} of its numbers, {name}")
    return table


def _number(cell: str, where: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise RecordingError(f"{where}: {cell[:40]!r} is not a number") from None


def _column(
    said: dict[str, list[str]], name: str, k: int, values: np.ndarray, x: np.ndarray | None
) -> Column:
    """The ``k``-th channel, without the rows that it does not have."""
    own = {key: cells[k] for key, cells in said.items() if k < len(cells)}
    size = int(np.max(np.flatnonzero(np.isfinite(values)), initial=-1)) + 1
    axis = _even_axis(own)
    time = None
    if x is not None and size > 1 and np.all(np.isfinite(x[:size])):
        step = float(x[size - 1] - x[0]) / (size - 1)
        if axis is None or abs(step / axis.step - 1.0) > 1e-3:
            time = Column("X_Value", x[:size], _axis_unit(own))
    return Column(
        name,
        values[:size],
        own.get("Y_Unit_Label", ""),
        time=time,
        axis=axis,
        scales={key: cell for key, cell in own.items() if names_factor(key)},
        remarks=tuple(_remarks({key: [cell] for key, cell in own.items()})),
    )


def _even_axis(own: dict[str, str]) -> Axis | None:
    """The axis that a channel's header gives with its step, where it runs forward."""
    try:
        step, start = float(own.get("Delta_X", "")), float(own.get("X0") or 0.0)
    except ValueError:
        return None
    if step > 0.0:
        return Axis("Delta_X", step, start, _axis_unit(own), own.get("X_Dimension", ""))
    return None


def _axis_unit(own: dict[str, str]) -> str:
    unit = own.get("X_Unit_Label")
    if not unit and own.get("X_Dimension", "").lower() in ("", "time"):
        return "s"
    return unit or ""
