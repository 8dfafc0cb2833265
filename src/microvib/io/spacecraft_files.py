"""What a scenario's ``spacecraft`` names: where its hub comes from, rows of the line of sight, a point of the hub."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from microvib.errors import ScenarioError, error_context, shown
from microvib.io.files import check_file, reading
from microvib.io.hub_sources import COLUMNS, hub_from
from microvib.io.scenario_file import hub_names
from microvib.io.tables import finite, named_rows
from microvib.model.part import plain
from microvib.structures.modal import ModalError

SHAPE = COLUMNS[6:]
LOS_COLUMNS = ("axis", "point", *SHAPE)


def with_spacecraft(data: dict[str, Any], folder: Path, origin: str) -> dict[str, Any]:
    """Scenario data with what they stand for in place of the names of ``spacecraft``: of ``hub.modes`` a file or a description,
    of ``line_of_sight.rows`` a file, of ``interface.position`` a point of the hub.

    Files are relative to ``folder``. Raises ScenarioError or ModalError.
    """
    group, sources = dict(data["spacecraft"]), {}
    hub, los, interface = (group.get(key) for key in ("hub", "line_of_sight", "interface"))
    with error_context(origin):
        if isinstance(hub, dict) and isinstance(hub.get("modes"), str):
            group["hub"] = plain(hub_from(hub, folder), text=True)
            name = hub["modes"]
            known = name in hub_names()
            sources["spacecraft.hub"] = f"assumed: finite elements of {name}" if known else f"free-free modes of {name}"
        if isinstance(los, dict) and isinstance(los.get("rows"), str):
            group["line_of_sight"] = {**los, "rows": _rows(folder / los["rows"])}
            sources["spacecraft.line_of_sight"] = str(los["rows"])
        if isinstance(interface, dict) and isinstance(interface.get("position"), str):
            group["interface"] = {**interface, "position": _place(interface["position"], group.get("hub"))}
    data = {**data, "spacecraft": group}
    if not sources:
        return data
    given = data.get("sources")
    return {**data, "sources": {**(given if isinstance(given, dict) else {}), **sources}}


def _place(name: str, hub: Any) -> Any:
    """Position of the hub's point of this name."""
    points = hub.get("points") if isinstance(hub, dict) else None
    known = [p for p in points if isinstance(p, dict)] if isinstance(points, list) else []
    for point in known:
        if point.get("name") == name:
            return point.get("position")
    raise ScenarioError(
        f"spacecraft.interface.position: {shown(name)} is not a point of the hub"
        f" ({', '.join(str(p.get('name')) for p in known) or 'it has none'}); write one of them, or three coordinates from the"
        " hub's centre of mass"
    )


def _rows(path: Path) -> list[dict[str, Any]]:
    """Sensitivities of the line of sight from a CSV file: axis (x or y), point, and six numbers [rad/m, rad/rad]."""
    with reading(path, ModalError):
        check_file(path)
        rows = named_rows(path, LOS_COLUMNS, "sensitivities of a line of sight", ModalError)
        return [
            {
                "axis": row["axis"].strip(),
                "point": row["point"].strip(),
                "by": [finite(f"row {number}: {column}", row[column], ModalError) for column in SHAPE],
            }
            for number, row in enumerate(rows, 2)
        ]
