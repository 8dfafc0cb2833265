"""Files that a scenario's ``spacecraft`` names: the hub's free-free modes, rows of the line of sight."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import ScenarioError, error_context, shown
from microvib.io.files import check_file, reading
from microvib.io.tables import finite
from microvib.model.part import plain
from microvib.structures.deck import UNIT_SYSTEMS
from microvib.structures.hub import FreeModes, hub_of
from microvib.structures.modal import ModalError
from microvib.units import convert

PLACE, SHAPE = ("x_m", "y_m", "z_m"), ("tx", "ty", "tz", "rx", "ry", "rz")
HUB_COLUMNS = ("mode", "frequency_hz", "damping", "point", *PLACE, *SHAPE)
LOS_COLUMNS = ("axis", "point", *SHAPE)


def with_spacecraft(data: dict[str, Any], folder: Path, origin: str) -> dict[str, Any]:
    """Scenario data with ``spacecraft.hub.modes: FILE`` and ``spacecraft.line_of_sight.rows: FILE`` replaced by what is in them.

    Files are relative to ``folder``. Raises ScenarioError or ModalError.
    """
    group = data.get("spacecraft")
    if not isinstance(group, dict):
        return data
    hub, los, sources = group.get("hub"), group.get("line_of_sight"), {}
    group = dict(group)
    with error_context(origin):
        if isinstance(hub, dict) and isinstance(hub.get("modes"), str):
            group["hub"] = _hub(hub, folder)
            sources["spacecraft.hub"] = f"free-free modes of {hub['modes']}"
        if isinstance(los, dict) and isinstance(los.get("rows"), str):
            group["line_of_sight"] = {**los, "rows": _rows(folder / los["rows"])}
            sources["spacecraft.line_of_sight"] = str(los["rows"])
    if not sources:
        return data
    given = data.get("sources")
    return {**data, "spacecraft": group, "sources": {**(given if isinstance(given, dict) else {}), **sources}}


def _hub(group: dict[str, Any], folder: Path) -> dict[str, Any]:
    name = str(group["modes"])
    kind = Path(name).suffix.lower()
    if kind not in _BESIDE:
        raise ScenarioError(
            f"spacecraft.hub.modes: {shown(name)} is not a source of a hub's modes; allowed are a table (.csv) of free-free"
            " modes and results of Nastran (.op2)"
        )
    extra = [key for key in group if key not in ("modes", *_BESIDE[kind])]
    if extra:
        raise ScenarioError(
            f"spacecraft.hub.{extra[0]}: does not go with hub.modes: {name}, which brings mass, inertia and modes; allowed beside"
            f" it are {', '.join(_BESIDE[kind])}"
        )
    damping = _damping(group)
    points = _points(group) if kind == ".op2" else {}
    with reading(folder / name, ModalError):
        check_file(folder / name)
        free = _from_op2(folder / name, points, group, damping) if points else read_hub_table(folder / name, damping)
        hub = hub_of(free)
    return dict(plain(hub, text=True))


_BESIDE = {".csv": ("damping",), ".op2": ("units", "points", "damping")}
"""Keys beside ``hub.modes``, by the ending of its file."""


def _points(group: dict[str, Any]) -> dict[str, int]:
    """Grids by the names of points, of results of a finite-element program, whose units must be said."""
    points, units = group.get("points"), group.get("units")
    if units not in UNIT_SYSTEMS:
        raise ScenarioError(
            f"spacecraft.hub.units: {shown(units)} is not allowed; write the unit system of the deck, one of"
            f" {', '.join(UNIT_SYSTEMS)}"
        )
    whole = isinstance(points, dict) and all(isinstance(x, int) and not isinstance(x, bool) for x in points.values())
    if not isinstance(points, dict) or not points or not whole:
        raise ScenarioError(
            f"spacecraft.hub.points: {shown(points)} is not allowed; names of points and their grids are expected, such as"
            " {root: 101, payload: 205}"
        )
    return {str(name): grid for name, grid in points.items()}


def _from_op2(path: Path, points: dict[str, int], group: dict[str, Any], damping: float | None) -> FreeModes:
    from microvib.io.nastran.op2 import read_free_op2

    frequency, places, shapes = read_free_op2(path, list(points.values()))
    length, kilogram = UNIT_SYSTEMS[group["units"]]
    scale = np.repeat([length, 1.0], 3) / (np.sqrt(kilogram) * length)
    xi = np.full(frequency.size, 0.01 if damping is None else damping)
    return FreeModes(frequency, xi, tuple(points), length * places, scale[:, None] * shapes)


def _damping(group: dict[str, Any]) -> float | None:
    given = group.get("damping")
    if given is None:
        return None
    try:
        xi = convert(given, "") if isinstance(given, str) else float(given)
    except (TypeError, ValueError):
        xi = -1.0
    if not 0.0 <= xi <= 0.99:
        raise ScenarioError(
            f"spacecraft.hub.damping: {shown(given)} is not allowed; a damping ratio from 0 to 99 percent is expected"
        )
    return xi


def _table(path: Path, columns: tuple[str, ...], what: str) -> list[dict[str, str]]:
    """Rows of a CSV file with these columns; ModalError where it is none."""
    rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
    missing = [name for name in columns if not rows or name not in rows[0]]
    if missing:
        raise ModalError(
            f"is not a table of {what}: a header with {', '.join(columns)} is expected; {missing[0]} is missing"
        )
    return rows


def read_hub_table(path: Path, damping: float | None) -> FreeModes:
    """Free-free modes from a CSV file: a row for each mode and point, the six rigid modes among them; SI, mass-normalised."""
    rows = _table(path, tuple(c for c in HUB_COLUMNS if c != "damping"), "a hub's modes")
    names = tuple(dict.fromkeys(row["point"].strip() for row in rows))
    labels = list(dict.fromkeys(row["mode"].strip() for row in rows))
    frequency, xi = np.full(len(labels), np.nan), np.full(len(labels), 0.01 if damping is None else damping)
    places, shapes = np.full((len(names), 3), np.nan), np.full((len(names), 6, len(labels)), np.nan)
    for number, row in enumerate(rows, 2):
        k, p = labels.index(row["mode"].strip()), names.index(row["point"].strip())

        def value(column: str, row: dict[str, str] = row, number: int = number) -> float:
            return finite(f"row {number}: {column}", row[column], ModalError)

        frequency[k] = _same(frequency[k], value("frequency_hz"), f"row {number}: frequency_hz")
        if damping is None and row.get("damping"):
            xi[k] = value("damping")
        for j, column in enumerate(PLACE):
            places[p, j] = _same(places[p, j], value(column), f"row {number}: {column}")
        if np.isfinite(shapes[p, 0, k]):
            raise ModalError(f"row {number}: mode {labels[k]} at point {names[p]} is there twice")
        shapes[p, :, k] = [value(column) for column in SHAPE]
    if np.any(np.isnan(shapes)):
        p, _, k = np.argwhere(np.isnan(shapes))[0]
        raise ModalError(f"mode {labels[k]} has no row for point {names[p]}; each mode needs one for each point")
    if np.any(frequency < 0.0) or np.any((xi < 0.0) | (xi > 0.99)):
        raise ModalError("a frequency is negative, or a damping ratio not from 0 to 0.99")
    return FreeModes(frequency, xi, names, places, shapes)


def _same(before: float, now: float, where: str) -> float:
    """The value, which must be that of the rows before."""
    if np.isfinite(before) and before != now:
        raise ModalError(f"{where} is {now:g}, and {before:g} in a row before; it must be the same")
    return now


def _rows(path: Path) -> list[dict[str, Any]]:
    """Sensitivities of the line of sight from a CSV file: axis (x or y), point, and six numbers [rad/m, rad/rad]."""
    with reading(path, ModalError):
        check_file(path)
        rows = _table(path, LOS_COLUMNS, "sensitivities of a line of sight")
        return [
            {
                "axis": row["axis"].strip(),
                "point": row["point"].strip(),
                "by": [finite(f"row {number}: {column}", row[column], ModalError) for column in SHAPE],
            }
            for number, row in enumerate(rows, 2)
        ]
