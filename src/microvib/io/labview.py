"""LabVIEW measurement files (.lvm): text with a header of its own and, before each segment, one of
its channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from microvib.io.delimited import read_delimited, read_text_of
from microvib.io.measured import Axis, Column, Hints, recording_of
from microvib.testdata.recording import Recording, RecordingError

_END = "***End_of_Header***"
_AXES_OF = {"no": 0, "one": 1}


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
    top = [line for line in lines[: ends[0]] if line.strip()]
    comma = any(line.lower().startswith("separator") and "comma" in line.lower() for line in top)
    separator = "," if comma else "\t"
    file = {line.split(separator)[0]: line.split(separator)[1:] for line in top}
    decimal = (file.get("Decimal_Separator") or ["."])[0].strip() or "."
    if len(ends) > 2:
        raise RecordingError(
            f"has {len(ends) - 1} segments; save them as files of their own, or write the file with"
            " one header only"
        )
    segment = _segment(lines[ends[0] + 1 :], separator, decimal)
    shared = _AXES_OF.get((file.get("X_Columns") or ["One"])[0].strip().lower())
    return recording_of(_columns(segment, shared), hints)


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
    count = len(names)
    table = np.full((len(segment.rows), count), np.nan)
    for k, row in enumerate(segment.rows):
        for j, cell in enumerate(row[:count]):
            try:
                table[k, j] = float(cell) if cell else np.nan
            except ValueError:
                raise RecordingError(
                    f"row {k + 1} of its numbers, {names[j]}: {cell[:40]!r} is not a number"
                ) from None
    xs = [j for j in range(count) if names[j].lower().startswith("x_value")]
    found: list[Column] = []
    for j, name in enumerate(names):
        if not name or j in xs:
            continue
        beside = [x for x in xs if x < j]
        if not beside:
            x = None
        else:
            x = table[:, beside[-1] if shared is None else beside[0]]
        found.append(_column(segment.said, name, len(found), table[:, j], x))
    if not found:
        raise RecordingError("has no channels")
    return found


def _column(
    said: dict[str, list[str]], name: str, k: int, values: np.ndarray, x: np.ndarray | None
) -> Column:
    """The ``k``-th channel, without the rows that it does not have."""

    def of(key: str) -> str:
        cells = said.get(key, [])
        if k < len(cells):
            return cells[k]
        return ""

    if np.any(np.isfinite(values)):
        size = int(np.flatnonzero(np.isfinite(values))[-1]) + 1
    else:
        size = 0
    unit, quantity = of("Y_Unit_Label"), of("X_Dimension")
    along = of("X_Unit_Label") or ("s" if quantity.lower() in ("", "time") else "")
    axis = time = None
    try:
        axis = Axis("Delta_X", float(of("Delta_X")), float(of("X0") or 0.0), along, quantity)
    except ValueError:
        axis = None
    even = axis is not None and axis.step > 0.0
    if x is not None and np.all(np.isfinite(x[:size])) and size > 1:
        step = float(x[size - 1] - x[0]) / (size - 1)
        if not even or abs(step / (axis.step if axis else 1.0) - 1.0) > 1e-3:
            time = Column("X_Value", x[:size], along)
    return Column(name, values[:size], unit, time=time, axis=axis if even else None)
