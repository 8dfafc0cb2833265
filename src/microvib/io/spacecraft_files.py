"""Sources named in a scenario's ``spacecraft``: its hub, rows of the line of sight,
points of the hub, another drive.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from microvib.errors import ScenarioError, error_context, quoted_value
from microvib.io.array_files import with_array
from microvib.io.file_access import FileAccess
from microvib.io.hub_sources import COLUMNS, hub_from
from microvib.io.named import catalog_names, hub_names, named_text
from microvib.io.tables import named_rows, parse_finite
from microvib.io.yaml_text import parse_yaml
from microvib.model.part import to_plain_data
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import DRIVE_GROUPS
from microvib.structures.modal import ModalError

SHAPE = COLUMNS[6:]
LOS_COLUMNS = ("axis", "point", *SHAPE)


Load = Callable[..., Scenario]
"""Makes a scenario of data, a name and its ``files`` (``scenario_file.scenario_of``)."""


def with_spacecraft(
    data: dict[str, Any], files: FileAccess, origin: str, load: Load
) -> dict[str, Any]:
    """Scenario data with what they stand for in place of the names of ``spacecraft``: of
    ``hub.modes`` a file or a description, of ``line_of_sight.rows`` a file, of an
    ``interface.position`` a point of the hub, of ``second_wing.scenario`` another drive.

    Names are those of ``files`` or of the catalog; another drive is what ``load`` makes of its
    file. Raises ScenarioError or ModalError.
    """
    group, sources = dict(data["spacecraft"]), {}
    hub, los, second = (group.get(key) for key in ("hub", "line_of_sight", "second_wing"))
    with error_context(origin):
        if isinstance(hub, dict) and isinstance(hub.get("modes"), str):
            group["hub"] = to_plain_data(hub_from(hub, files), text=True)
            name = hub["modes"]
            known = name in hub_names()
            if known:
                sources["spacecraft.hub"] = f"assumed: finite elements of {name}"
            else:
                sources["spacecraft.hub"] = f"free-free modes of {name}"
        if isinstance(los, dict) and isinstance(los.get("rows"), str):
            group["line_of_sight"] = {
                **los,
                "rows": _rows(files.under("spacecraft.line_of_sight.rows").path(los["rows"])),
            }
            sources["spacecraft.line_of_sight"] = str(los["rows"])
        if isinstance(second, dict):
            name = second.get("scenario")
            if name is not None:
                sources["spacecraft.second_wing"] = str(name)
            group["second_wing"] = _placed(
                _with_drive(second, files, load), group.get("hub"), "second_wing."
            )
        group = _placed(group, group.get("hub"))
    data = {**data, "spacecraft": group}
    if not sources:
        return data
    given = data.get("sources")
    return {**data, "sources": {**(given if isinstance(given, dict) else {}), **sources}}


def _with_drive(wing: dict[str, Any], files: FileAccess, load: Load) -> dict[str, Any]:
    """A second wing with drive and array of the scenario that it names, but for the groups that it
    gives itself.
    """
    given = dict(with_array(wing, files, "spacecraft.second_wing"))
    given.pop("sources", None)
    name = given.pop("scenario", None)
    if name is None:
        return given
    if not isinstance(name, str) or "\0" in name:
        raise ScenarioError(
            f"spacecraft.second_wing.scenario: {quoted_value(name)} is not allowed; a scenario file"
            " is expected, or a catalog name"
        )
    files = files.under("spacecraft.second_wing.scenario")
    data = parse_yaml(named_text(name, files), name)
    if isinstance(data, dict):
        data.pop("spacecraft", None)  # whose second wing may be this one's file
    other = load(data, name, files=files if name in catalog_names() else files.in_folder_of(name))
    return {**{key: to_plain_data(getattr(other, key), text=True) for key in DRIVE_GROUPS}, **given}


def _placed(group: dict[str, Any], hub: Any, prefix: str = "") -> dict[str, Any]:
    """The group with coordinates in place of a point's name in its interface."""
    interface = group.get("interface")
    if not isinstance(interface, dict) or not isinstance(interface.get("position"), str):
        return group
    with error_context(f"spacecraft.{prefix}interface.position"):
        return {**group, "interface": {**interface, "position": _place(interface["position"], hub)}}


def _place(name: str, hub: Any) -> Any:
    """Position of the hub's point of this name."""
    if isinstance(hub, dict):
        points = hub.get("points")
    else:
        points = None
    if isinstance(points, list):
        known = [p for p in points if isinstance(p, dict)]
    else:
        known = []
    for point in known:
        if point.get("name") == name:
            return point.get("position")
    raise ScenarioError(
        f"{quoted_value(name)} is not a point of the hub"
        f" ({', '.join(str(p.get('name')) for p in known) or 'it has none'}); write one of them, or"
        " three coordinates from the"
        " hub's centre of mass"
    )


def _rows(path: Path) -> list[dict[str, Any]]:
    """Sensitivities of the line of sight from a CSV file: axis (x or y), point, and six numbers
    [rad/m, rad/rad].
    """
    rows = named_rows(path, LOS_COLUMNS, "sensitivities of a line of sight", ModalError)
    with error_context(path):
        return [
            {
                "axis": row["axis"].strip(),
                "point": row["point"].strip(),
                "by": [
                    parse_finite(f"row {number}: {column}", row[column], ModalError)
                    for column in SHAPE
                ],
            }
            for number, row in enumerate(rows, 2)
        ]
