"""Where a hub comes from: a table of free-free modes, Nastran, finite elements of a described
craft.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from microvib.errors import ScenarioError, quoted_value
from microvib.io.array_files import damping_ratio
from microvib.io.file_access import NO_FILES, FileAccess
from microvib.io.files import as_read_errors, check_file, suppress_output
from microvib.io.modal_sources import DESCRIPTIONS, elements_of
from microvib.io.named import hub_names, named_text
from microvib.io.tables import named_rows, parse_finite
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validate_part
from microvib.model.spacecraft import Hub
from microvib.structures.deck import UNIT_SYSTEMS, ImportOptions, import_options
from microvib.structures.hub import FreeModes, free_free_modes, hub_of
from microvib.structures.hub_design import HubDesign
from microvib.structures.modal import ModalError

COLUMNS = ("mode", "frequency_hz", "point", "x_m", "y_m", "z_m", "tx", "ty", "tz", "rx", "ry", "rz")
DEFAULT_MODES = 30
"""Flexible modes taken of finite elements where their number is not given."""
_FREE = (".op2", ".op4", ".pch")
_INTERFACE = (
    "damping",
    "count",
    *(key for key in ImportOptions.model_fields if key not in ("drive_axis", "modes", "damping")),
)
"""Keys beside ``hub.modes`` where they are modes with the interface clamped."""


def hub_from(group: dict[str, Any], files: FileAccess = NO_FILES) -> Hub:
    """The hub that ``spacecraft.hub`` names as ``modes``: one of the ``files``, or of the catalog.

    Raises ScenarioError or ModalError.
    """
    files = files.under("spacecraft.hub.modes")
    name = str(group["modes"])
    if name not in hub_names():
        files.path(name, hub_names())
    source = _source_of(name, "interface" in group)
    _check_keys(group, name, source)
    damping, count = _damping(group), _count(group)
    if source == "description":
        kept = DEFAULT_MODES if count is None else count
        return hub_of(_described(name, files, kept), damping)
    if source == "clamped":
        return hub_of(_clamped(files.path(name, hub_names()), group), damping, count)
    read: Callable[[Path], FreeModes] = read_hub_table
    if source == "nastran":
        read = partial(_nastran, points=_points(group), units=str(group["units"]))
    path = files.path(name, hub_names())
    with as_read_errors(path, ModalError):
        check_file(path)
        return hub_of(read(path), damping, count)


_Source = Literal["description", "clamped", "table", "nastran"]
_KEYS: dict[_Source, tuple[str, ...]] = {
    "description": ("damping", "count"),
    "clamped": _INTERFACE,
    "table": ("damping", "count"),
    "nastran": ("damping", "count", "units", "points"),
}
"""Keys that go beside ``hub.modes``."""


def _source_of(name: str, has_interface: bool) -> _Source:
    """Kind of source, by name and ending; ``has_interface`` says that modes have it clamped."""
    ending = Path(name).suffix.lower()
    if name in hub_names() or ending in DESCRIPTIONS:
        return "description"
    if has_interface:
        return "clamped"
    if ending == ".csv":
        return "table"
    if ending in _FREE:
        return "nastran"
    raise ScenarioError(
        f"spacecraft.hub.modes: {quoted_value(name)} is not a source of a hub's modes; allowed"
        f" are {', '.join(hub_names())}, a"
        f" description of a spacecraft ({', '.join(DESCRIPTIONS)}), a table of free-free modes"
        " (.csv), results of Nastran"
        f" ({', '.join(_FREE)}), and with the key interface modes with the interface clamped,"
        " from what an array is read"
    )


def _check_keys(group: dict[str, Any], name: str, source: _Source) -> None:
    beside = _KEYS[source]
    for key in group:
        if key not in ("modes", *beside):
            raise ScenarioError(
                f"spacecraft.hub.{key}: does not go with hub.modes: {name}, which supplies "
                f"mass, inertia and modes; allowed with it are {', '.join(beside)}"
            )


def _described(name: str, files: FileAccess, count: int) -> FreeModes:
    text = named_text(
        name, files, kind="description of a spacecraft", published=hub_names(), within="hubs/"
    )
    design = validate_part(HubDesign, parse_yaml(text, name), origin=name)
    with elements_of(name):
        from microvib.structures.fem.hub_mesh import free_modes
    return free_modes(design, count)


def _clamped(path: Path, group: dict[str, Any]) -> FreeModes:
    """A hub whose modes have the interface clamped (Craig-Bampton with one point): freed of it."""
    from microvib.io.nastran import read_modal_model

    options = None
    if path.suffix.lower() != ".csv":
        said = {
            key: value
            for key, value in group.items()
            if key in ImportOptions.model_fields and key not in ("modes", "damping")
        }
        options = import_options({**said, "drive_axis": "z"}, "spacecraft.hub")
    return free_free_modes(read_modal_model(path, options))


def _points(group: dict[str, Any]) -> dict[str, int]:
    """Grids by the names of points, of results of a finite-element program, whose units must be
    said.
    """
    points, units = group.get("points"), group.get("units")
    if units not in UNIT_SYSTEMS:
        raise ScenarioError(
            f"spacecraft.hub.units: {quoted_value(units)} is not allowed; write the unit system of"
            " the deck, one of"
            f" {', '.join(UNIT_SYSTEMS)}"
        )
    whole = isinstance(points, dict) and all(
        isinstance(x, int) and not isinstance(x, bool) for x in points.values()
    )
    if not isinstance(points, dict) or not points or not whole:
        raise ScenarioError(
            f"spacecraft.hub.points: {quoted_value(points)} is not allowed; names of points and"
            " their grids are expected, such as"
            " {root: 101, payload: 205}"
        )
    return {str(name): grid for name, grid in points.items()}


def _nastran(path: Path, points: dict[str, int], units: str) -> FreeModes:
    from microvib.io.nastran.free import read_free

    with suppress_output():
        frequency, places, shapes = read_free(path, list(points.values()))
    length, kilogram = UNIT_SYSTEMS[units]
    scale = np.repeat([length, 1.0], 3) / (np.sqrt(kilogram) * length)
    return FreeModes(
        frequency,
        np.full(frequency.size, 0.01),
        tuple(points),
        length * places,
        scale[:, None] * shapes,
    )


def _damping(group: dict[str, Any]) -> float | None:
    given = group.get("damping")
    if given is None:
        return None
    return damping_ratio("spacecraft.hub.damping", given)


def _count(group: dict[str, Any]) -> int | None:
    count = group.get("count")
    if count is not None and (
        not isinstance(count, int) or isinstance(count, bool) or not 0 <= count <= 2000
    ):
        raise ScenarioError(
            f"spacecraft.hub.count: {quoted_value(count)} is not allowed; how many flexible modes"
            " are kept, from 0 to 2000"
        )
    return count


def read_hub_table(path: Path) -> FreeModes:
    """Free-free modes from a CSV file: a row for each mode and point, the six rigid modes among
    them; SI, mass-normalised.
    """
    rows = named_rows(path, COLUMNS, "a hub's modes", ModalError, also=("damping",))
    names = tuple(dict.fromkeys(row["point"].strip() for row in rows))
    labels = list(dict.fromkeys(row["mode"].strip() for row in rows))
    frequency, xi = np.full(len(labels), np.nan), np.full(len(labels), 0.01)
    places, shapes = np.full((len(names), 3), np.nan), np.full((len(names), 6, len(labels)), np.nan)
    for number, row in enumerate(rows, 2):
        k, p = labels.index(row["mode"].strip()), names.index(row["point"].strip())
        value = _row_numbers(row, number)
        frequency[k] = _same(frequency[k], value["frequency_hz"], f"row {number}: frequency_hz")
        xi[k] = value.get("damping", xi[k])
        for j, column in enumerate(COLUMNS[3:6]):
            places[p, j] = _same(places[p, j], value[column], f"row {number}: {column}")
        if np.isfinite(shapes[p, 0, k]):
            raise ModalError(f"row {number}: mode {labels[k]} at point {names[p]} is there twice")
        shapes[p, :, k] = [value[column] for column in COLUMNS[6:]]
    if np.any(np.isnan(shapes)):
        p, _, k = np.argwhere(np.isnan(shapes))[0]
        raise ModalError(
            f"mode {labels[k]} has no row for point {names[p]}; each mode needs one for each point"
        )
    if np.any(frequency < 0.0) or np.any((xi < 0.0) | (xi > 0.99)):
        raise ModalError("a frequency is negative, or a damping ratio not from 0 to 0.99")
    return FreeModes(frequency, xi, names, places, shapes)


def _row_numbers(row: dict[str, str], number: int) -> dict[str, float]:
    """Numbers of one row by column; the damping may be left out."""
    columns = ["frequency_hz", *COLUMNS[3:]]
    if row.get("damping"):
        columns.insert(1, "damping")
    return {name: parse_finite(f"row {number}: {name}", row[name], ModalError) for name in columns}


def _same(before: float, now: float, where: str) -> float:
    """The value, which must be that of the rows before."""
    if np.isfinite(before) and before != now:
        raise ModalError(f"{where} is {now:g}, and {before:g} in a row before; it must be the same")
    return now
