"""Scenario files: YAML with units, the catalog's names, and the way back to text."""

from __future__ import annotations

import copy
import io
import os
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from microvib.errors import ScenarioError, error_context, expect
from microvib.io.array_files import ARRAY_ORIGINS, with_array
from microvib.io.file_access import NO_FILES, WORKING_FOLDER, FileAccess
from microvib.io.named import bench_names, catalog_names, catalog_text, named_text, read_text
from microvib.io.yaml_text import parse_yaml
from microvib.model.part import Part, to_plain_data
from microvib.model.scenario import (
    TEXT_KEYS,
    USER_SOURCE,
    GivenScenario,
    Scenario,
    as_scenario,
    set_key,
)
from microvib.model.sentences import validate_part
from microvib.testdata.bench import Bench


def load_scenario(
    source: str | os.PathLike[str], changes: dict[str, Any] | None = None
) -> Scenario:
    """Load a scenario from the catalog or a YAML file, with keys changed on the way.

    Parameters
    ----------
    source : str or path
        A name of the catalog (``catalog_names``), or the path of a scenario file.
    changes : dict, optional
        Dotted keys with their values as in the file: text with a unit, numbers where there is no
        unit.

    Returns
    -------
    Scenario
        The drive, its array, its command and its record; frozen.

    Raises
    ------
    ScenarioError
        Where the file cannot be read or is not valid: a sentence for each problem.
    ObjectError
        For what is no name, or changes that are no mapping.

    Examples
    --------
    >>> import microvib as mv
    >>> scenario = mv.load_scenario("state-1", {"tracking.rate": "0.05 deg/s"})
    """
    expect(source, (str, os.PathLike), "a name of the catalog, or that of a file")
    expect(
        changes,
        (dict, type(None)),
        "keys with their values, such as {'tracking.rate': '0.05 deg/s'}",
    )
    name = os.fspath(source)
    if name in catalog_names():
        return scenario_of(copy.deepcopy(_catalog_data(name)), name, changes, WORKING_FOLDER)
    return scenario_of(
        parse_yaml(read_text(Path(name)), name), name, changes, WORKING_FOLDER.in_folder_of(name)
    )


@cache
def _catalog_data(name: str) -> Any:
    """Data of a catalog file, parsed once: that takes longer than all else of a scenario."""
    return parse_yaml(catalog_text(name), name)


def scenario_of(
    data: Any, name: str, changes: dict[str, Any] | None = None, files: FileAccess = NO_FILES
) -> Scenario:
    """A scenario from the data of a scenario file called ``name``, as ``load_scenario`` makes it;
    ``data`` is changed.

    What it names is taken from ``files``, what ``changes`` name from the working folder, unless no
    files may be opened.
    """
    if isinstance(data, dict):
        data = with_files(data, files, name)
    if not changes or not isinstance(data, dict):
        return validate_part(Scenario, data, origin=name)
    sources: dict[str, str] = {}
    if "sources" in data:
        sources = dict(validate_part(Scenario, data, origin=name).sources)
    another_array = any(f"array.{origin}" in changes for origin in ARRAY_ORIGINS)
    data = _with_changes(data, changes, another_array)
    data = with_files(data, files.in_working_folder(), name)
    if another_array and "title" not in changes:  # no longer what the file's title says
        data["title"] = f"Drive of {name}, array: {data['sources']['array']}"
    if "sources" in changes:
        return validate_part(Scenario, data, origin=name)
    changed = validate_part(Scenario, {**data, "sources": {}}, origin=name)
    if another_array:
        sources = {key: text for key, text in sources.items() if key.split(".")[0] != "array"}
    # A value that was changed no longer comes from the file's source.
    sources |= {key: USER_SOURCE for key in changes if key.split(".")[0] not in TEXT_KEYS}
    if another_array:
        sources["array"] = data["sources"]["array"]
    return changed.with_sources(sources)


def _with_changes(
    data: dict[str, Any], changes: dict[str, Any], another_array: bool
) -> dict[str, Any]:
    """Scenario data with the changes in place, which are copied: later keys may change what is
    inside of earlier ones.
    """
    if another_array:
        data["array"] = {}  # in place of the file's, of which nothing is left
    for key, value in changes.items():
        set_key(data, key, to_plain_data(value))
    return data


def load_bench(source: str | Path) -> Bench:
    """A virtual test bench from a catalog name or a YAML file; ScenarioError with one sentence per
    problem.
    """
    name = str(source)
    text = named_text(
        name, WORKING_FOLDER, kind="bench", published=bench_names(), within="benches/"
    )
    return validate_part(Bench, parse_yaml(text, name), origin=name)


def with_files(data: dict[str, Any], files: FileAccess, origin: str) -> dict[str, Any]:
    """Scenario data with what files hold in place of their names: ``with_array``,
    ``with_spacecraft``, and ``TABLES``.
    """
    data = with_array(data, files, origin)
    if isinstance(data.get("spacecraft"), dict):
        from microvib.io.spacecraft_files import with_spacecraft

        data = with_spacecraft(data, files, origin, scenario_of)
    for key, name in named_tables(data).items():
        with error_context(origin):
            data = _with_table(data, key, files.under(key).path(name))
        given = data.get("sources")
        if isinstance(given, dict):
            sources = {key: name, **given}
        else:
            sources = given or {key: name}
        data = {**data, "sources": sources}
    return data


_LOOP = (("angle", "rad"), ("torque", "N*m"))
TABLES: dict[str, tuple[tuple[str, str], ...]] = {
    "driver.table": (),
    "friction.torque_noise.table": (("frequency", "Hz"), ("density", "N^2*m^2/Hz")),
    "friction.position.roughness.table": (("frequency", ""), ("density", "")),
    "friction.presliding.loop": _LOOP,
    "motor.friction.presliding.loop": _LOOP,
    "friction.harness.presliding.loop": _LOOP,
}
"""Keys that may name a file with a table, and its columns, name and unit, where these are fixed."""


def named_tables(data: Any) -> dict[str, str]:
    """Names of the files that scenario data name as tables, by their keys."""
    named = {}
    for key in TABLES:
        node = data
        for part in key.split("."):
            if isinstance(node, dict):
                node = node.get(part)
            else:
                node = None
        if isinstance(node, str):
            named[key] = node
    return named


def _with_table(data: dict[str, Any], key: str, path: Path) -> dict[str, Any]:
    """Scenario data with what a file holds in place of its name at the ``key``."""
    from microvib.io.current_table import read_current_table
    from microvib.io.row_table import read_row_table

    if TABLES[key]:
        table: Any = read_row_table(path, *TABLES[key])
    else:
        table = read_current_table(path)
    if any(name == "density" for name, _ in TABLES[key]):
        table = [
            row for row in table if row[0] != 0.0
        ]  # a density at 0 is nothing that turns or varies
    first, *rest = key.split(".")
    changed = copy.deepcopy(data[first])
    set_key(changed, ".".join(rest), table)
    return {**data, first: changed}


def parse_value(text: str) -> Any:
    """The value of a change KEY=VALUE: a YAML scalar or list, text with a unit stays text."""
    try:
        value = parse_yaml(text, "value")
    except ScenarioError:
        return text
    if value is None and text.strip() not in ("null", "~", ""):
        return text
    return value


def dump_part(part: Part) -> str:
    """YAML text of a scenario or a description: complete, and the same again when it is loaded."""
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.default_flow_style = False
    yaml.width = 4096
    stream = io.StringIO()
    yaml.dump(to_plain_data(part, text=True), stream)
    return stream.getvalue()


def dump_scenario(scenario: GivenScenario) -> str:
    """Write a scenario as YAML text, complete: loaded again, it is the same scenario.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is written: a scenario, a name of the catalog, or the path of a scenario file.

    Returns
    -------
    str
        Text of a scenario file, values with their units.

    Raises
    ------
    ScenarioError
        Where a name stands for no scenario.
    """
    return _dumped(as_scenario(scenario))


@lru_cache(maxsize=1)  # a run writes it to several places, 20 ms each
def _dumped(scenario: Scenario) -> str:
    return dump_part(scenario)


def json_schema() -> dict[str, Any]:
    """JSON Schema of the scenario file, with units, ranges and meanings."""
    schema = Scenario.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "microvib scenario"
    return schema
