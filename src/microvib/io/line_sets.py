"""Folders of studies that hold lines of many runs: rate plans, and sweeps over angles and orbits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from microvib.errors import MicrovibError
from microvib.io.tables import dict_rows, parse_finite
from microvib.io.writing import EDITED_COPY, require_unchanged

RATES, NOT_SEEN = "rates.csv", "not_seen.csv"
ANGLES, ORBIT = "angles.csv", "orbit_lines.csv"


class Unseen(NamedTuple):
    """Something that may be there beside the lines."""

    what: str
    low: float
    high: float
    """[Hz]."""
    at_most: float
    """[N m]; infinite where that is not known."""
    overstated: float
    """Times by which the record may show the lines too large."""


@dataclass(frozen=True)
class LineSet:
    """Lines of one run of a study."""

    values: Mapping[str, str]
    """Values that the run was at, such as its rate, as the table has them."""
    lines: tuple[tuple[str, float, Mapping[str, float]], ...]
    """Names, frequencies [Hz] and amplitudes by their columns; nan where one is not known."""
    status: str = ""
    """How it was solved."""
    not_seen: tuple[Unseen, ...] | None = None
    """All that may be there beside the lines; None where the folder does not tell."""


def read_rate_lines(folder: Path) -> list[LineSet]:
    """Read the lines at each rate of a folder that ``microvib rates --out`` wrote.

    Parameters
    ----------
    folder : Path
        The folder.

    Returns
    -------
    list of LineSet
        One for each rate and number of microsteps, with amplitudes ``amplitude_n_m``.

    Raises
    ------
    MicrovibError
        Where a table was changed, or is not one of a rate plan.
    """
    found = _line_sets(
        folder / RATES,
        ("rate_deg_s", "microsteps"),
        ("amplitude_n_m",),
        ("kind", "order", "spread_n_m"),
    )
    if not (folder / NOT_SEEN).is_file():
        return found
    told = _not_seen(folder / NOT_SEEN)
    return [
        LineSet(x.values, x.lines, x.status, tuple(told.get(tuple(x.values.values()), ())))
        for x in found
    ]


def read_swept_lines(folder: Path, columns: Sequence[str]) -> list[LineSet]:
    """Read the lines at each angle of a folder that ``microvib run --angles`` or ``--orbit`` wrote.

    Parameters
    ----------
    folder : Path
        The folder.
    columns : sequence of str
        Columns of amplitudes in N and N m that are read.

    Returns
    -------
    list of LineSet
        One for each angle.

    Raises
    ------
    MicrovibError
        Where the table was changed, or is not one of a sweep.
    """
    if (folder / ORBIT).is_file():
        return _line_sets(
            folder / ORBIT, ("time_s", "angle_deg"), columns, ("los_x_rad", "los_y_rad")
        )
    return _line_sets(folder / ANGLES, ("angle_deg",), columns, ("los_x_rad", "los_y_rad"))


def _line_sets(
    path: Path, keys: Sequence[str], columns: Sequence[str], others: Sequence[str]
) -> list[LineSet]:
    require_unchanged(path, EDITED_COPY)
    needed = (*keys, "line", "frequency_hz", *columns)
    rows = dict_rows(path, (*needed, *others, "status"), what="lines of a study", needed=needed)
    lines: dict[tuple[str, ...], list[tuple[str, float, Mapping[str, float]]]] = {}
    status: dict[tuple[str, ...], str] = {}
    for k, row in enumerate(rows, 2):
        at = tuple(row[key] for key in keys)
        there = lines.setdefault(at, [])
        status[at] = row.get("status", "")
        if not row["line"].strip():
            continue
        where = f"{path}, row {k}:"
        sizes = {name: _size(f"{where} {name}:", row[name]) for name in columns}
        frequency = parse_finite(f"{where} frequency_hz:", row["frequency_hz"])
        if not frequency > 0.0:
            raise MicrovibError(f"{where} frequency_hz: {frequency:g} is not above 0")
        there.append((row["line"], frequency, sizes))
    return [
        LineSet(dict(zip(keys, at, strict=True)), tuple(of), status[at]) for at, of in lines.items()
    ]


def _size(where: str, cell: str) -> float:
    """The amplitude of a cell; nan where it is empty, because it is not known."""
    return abs(parse_finite(where, cell)) if cell.strip() else math.nan


def _not_seen(path: Path) -> dict[tuple[str, ...], list[Unseen]]:
    """All that is not seen at each rate and number of microsteps."""
    require_unchanged(path, EDITED_COPY)
    needed = ("rate_deg_s", "microsteps", "what", "from_hz", "to_hz", "at_most_n_m", "overstated")
    found: dict[tuple[str, ...], list[Unseen]] = {}
    for k, row in enumerate(dict_rows(path, needed, what="what a plan lacks", needed=needed), 2):
        where, at = f"{path}, row {k}:", (row["rate_deg_s"], row["microsteps"])
        low, high, most, times = (
            _infinite_if_empty(f"{where} {name}:", row[name]) for name in needed[3:]
        )
        found.setdefault(at, []).append(Unseen(row["what"], low, high, most, times))
    return found


def _infinite_if_empty(where: str, cell: str) -> float:
    """The figure of a cell; infinite where it is empty, or says so."""
    if cell.strip() in ("", "inf"):
        return math.inf
    return parse_finite(where, cell)
