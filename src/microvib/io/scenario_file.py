"""Scenario files: YAML with units, the catalog's names, and the way back to text."""

from __future__ import annotations

import copy
import io
import math
from dataclasses import replace
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.errors import ScenarioError, error_context, expect, shown
from microvib.io.yaml_text import parse_yaml
from microvib.model.part import Part, plain
from microvib.model.scenario import Scenario, set_key
from microvib.model.sentences import validated
from microvib.testdata.bench import Bench
from microvib.units import convert

if TYPE_CHECKING:
    from microvib.structures.modal import ModalModel

LARGEST_FILE = 1_000_000  # bytes of the largest scenario file that is read


def catalog_names() -> tuple[str, ...]:
    """Names of the published scenarios."""
    return tuple(name for name in _catalog_files() if name != "new" and not name.startswith(REFERENCE))


REFERENCE = "reference-"  # how names of catalog files begin that describe structures, not scenarios


def reference_names() -> tuple[str, ...]:
    """Names of the structures of the catalog, such as ``reference-array``."""
    return tuple(name for name in _catalog_files() if name.startswith(REFERENCE))


def _catalog_files(folder: str = "") -> list[str]:
    files = (resources.files("microvib.catalog") / folder).iterdir()
    return sorted(f.name[:-5] for f in files if f.name.endswith(".yaml"))


def catalog_text(name: str) -> str:
    """Text of a catalog file, with its comments; ``new`` is the commented file to start from."""
    return (resources.files("microvib.catalog") / f"{name}.yaml").read_text(encoding="utf-8")


def load_scenario(source: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """A scenario from a catalog name or a YAML file, with dotted keys changed on the way.

    Values of ``changes`` are as in the file: text with a unit, numbers where there is no unit. Raises ScenarioError with one
    sentence per problem.
    """
    expect(source, (str, Path), "a name of the catalog, or that of a file")
    expect(changes, (dict, type(None)), "keys with their values, such as {'tracking.rate': '0.05 deg/s'}")
    name = str(source)
    if name in catalog_names():
        return scenario_of(copy.deepcopy(_catalog_data(name)), name, changes)
    return scenario_of(parse_yaml(read_text(Path(name)), name), name, changes, Path(name).parent)


@cache
def _catalog_data(name: str) -> Any:
    """Data of a catalog file, parsed once: that takes longer than all else of a scenario."""
    return parse_yaml(catalog_text(name), name)


def scenario_of(data: Any, name: str, changes: dict[str, Any] | None = None, folder: Path = Path()) -> Scenario:
    """A scenario from the data of a scenario file called ``name``, as ``load_scenario`` makes it; ``data`` is changed.

    Files that ``array`` and ``TABLES`` name are found relative to ``folder``.
    """
    if isinstance(data, dict):
        data = with_files(data, folder, name)
    if not changes or not isinstance(data, dict):
        return validated(Scenario, data, origin=name)
    before = validated(Scenario, data, origin=name) if "sources" in data else None
    other = any(key in (f"array.{origin}" for origin in ARRAY_ORIGINS) for key in changes)
    if other:
        data["array"] = {}  # another array, not a changed one
    for key, value in changes.items():
        set_key(data, key, plain(value))  # a copy, for later keys may change what is inside
    data = with_files(data, Path(), name)
    if other and "title" not in changes:  # no longer what the file's title says
        data["title"] = f"Drive of {name}, array: {data['sources']['array']}"
    after = validated(Scenario, {**data, "sources": data.get("sources") if "sources" in changes else {}}, origin=name)
    if before is None or "sources" in changes:
        return after
    kept = {key: text for key, text in before.sources.items() if not (other and key.split(".")[0] == "array")}
    own = {"array": data["sources"]["array"]} if other else {}
    # A value that was changed no longer comes from the file's source.
    set_here = [key for key in changes if key.split(".")[0] not in ("source", "sources", "title")]
    return after.with_sources(kept | dict.fromkeys(set_here, "set by the user") | own)


def hub_names() -> tuple[str, ...]:
    """Names of the described craft of the catalog, such as ``reference-hub``."""
    return tuple(_catalog_files("hubs"))


def bench_names() -> tuple[str, ...]:
    """Names of the published virtual test benches."""
    return tuple(_catalog_files("benches"))


def load_bench(source: str | Path) -> Bench:
    """A virtual test bench from a catalog name or a YAML file; ScenarioError with one sentence per problem."""
    name = str(source)
    text = named_text(name, kind="bench", published=bench_names(), within="benches/")
    return validated(Bench, parse_yaml(text, name), origin=name)


ARRAY_ORIGINS = ("from", "fem")
"""Keys of ``array`` that name where its modes come from, instead of the modes themselves: a table, a description."""


def with_files(data: dict[str, Any], folder: Path, origin: str) -> dict[str, Any]:
    """Scenario data with what files hold in place of their names: ``with_array``, ``with_spacecraft``, and ``TABLES``."""
    data = with_array(data, folder, origin)
    if isinstance(data.get("spacecraft"), dict):
        from microvib.io.spacecraft_files import with_spacecraft

        data = with_spacecraft(data, folder, origin)
    for key, name in named_tables(data).items():
        with error_context(origin):
            if "\0" in name:
                raise ScenarioError(f"{key}: {shown(name)} is not allowed; the name of a file is expected")
            data = _with_table(data, key, folder / name)
        given = data.get("sources")
        sources = {key: name, **given} if isinstance(given, dict) else given or {key: name}
        data = {**data, "sources": sources}
    return data


_LOOP = (("angle", "rad"), ("torque", "N*m"))
TABLES: dict[str, tuple[tuple[str, str], ...]] = {
    "driver.table": (),
    "friction.torque_noise.table": (("frequency", "Hz"), ("density", "N^2*m^2/Hz")),
    "friction.position.roughness.table": (("frequency", ""), ("density", "")),
    "friction.presliding.loop": _LOOP,
    "motor.friction.presliding.loop": _LOOP,
}
"""Keys that may name a file with a table, and its columns, name and unit, where these are fixed."""


def named_tables(data: Any) -> dict[str, str]:
    """Names of the files that scenario data name as tables, by their keys."""
    named = {}
    for key in TABLES:
        node = data
        for part in key.split("."):
            node = node.get(part) if isinstance(node, dict) else None
        if isinstance(node, str):
            named[key] = node
    return named


def _with_table(data: dict[str, Any], key: str, path: Path) -> dict[str, Any]:
    """Scenario data with what a file holds in place of its name at the ``key``."""
    from microvib.io.current_table import read_current_table
    from microvib.io.row_table import read_row_table

    table: Any = read_row_table(path, *TABLES[key]) if TABLES[key] else read_current_table(path)
    if any(name == "density" for name, _ in TABLES[key]):
        table = [row for row in table if row[0] != 0.0]  # a density at 0 is nothing that turns or varies
    first, *rest = key.split(".")
    changed = copy.deepcopy(data[first])
    set_key(changed, ".".join(rest), table)
    return {**data, first: changed}


def with_array(data: dict[str, Any], folder: Path, origin: str) -> dict[str, Any]:
    """Scenario data with ``array: {from: FILE}`` or ``array: {fem: DESCRIPTION}`` replaced by the modes of that source.

    Files are relative to ``folder``. ``modes: N`` keeps the first N modes, ``damping`` replaces their damping ratios; beside
    results of a finite-element program stand the keys of ``Import``. Raises ScenarioError or ModalError.
    """
    group = data.get("array")
    if not isinstance(group, dict) or not any(key in group for key in ARRAY_ORIGINS):
        return data
    with error_context(origin):
        model, source = _modes_of(group, folder)
        given = data.get("sources") or {}
        if not isinstance(given, dict):
            raise ScenarioError(f"sources: {given!r} is not allowed; keys are expected here: text to text")
    sources = {key: text for key, text in given.items() if not str(key).startswith("array.")} | {"array": source}
    if model.notes:
        sources["array.inertia"] = " ".join([f"{source}.", *model.notes])  # once, not at each mode
    return {**data, "array": plain(model.array(), text=True), "sources": sources}


def _modes_of(group: dict[str, Any], folder: Path) -> tuple[ModalModel, str]:
    """Modal model that ``array.from`` or ``array.fem`` names, and what to say of its source."""
    from microvib.io.modal_sources import DEFAULT_MODES, DESCRIPTIONS, TABLES, modal_source
    from microvib.io.modal_table import MAX_MODES

    key, *others = [key for key in group if key in ARRAY_ORIGINS]
    if not isinstance(group[key], str) or "\0" in group[key]:
        raise ScenarioError(f"array.{key}: {shown(group[key])} is not allowed; the name of a file is expected")
    name = str(group[key])
    if key == "from" and not others and Path(name).suffix.lower() not in (*TABLES, *DESCRIPTIONS):
        from microvib.io.nastran import read_modal_model
        from microvib.structures.deck import import_options

        said = {option: value for option, value in group.items() if option not in ARRAY_ORIGINS}
        return read_modal_model(folder / name, import_options(said, "array")), name
    unknown = [*others, *(key for key in group if key not in (*ARRAY_ORIGINS, "modes", "damping"))]
    if unknown:
        raise ScenarioError(
            f"array.{unknown[0]}: does not go with array.{key}, which brings the modes; allowed beside it are modes"
            " (how many) and damping"
        )
    if key == "from":
        model = modal_source(name, folder=folder).model
        return _damped(model.first(_count(group, model.frequency.size)), group), name
    count = _count({"modes": DEFAULT_MODES, **group}, MAX_MODES)
    model = modal_source(name, max(count, 1), folder).model
    return _damped(model.first(count), group), f"finite elements of {name}, {count} modes"


def _count(group: dict[str, Any], available: int) -> int:
    count = group.get("modes", available)
    if not isinstance(count, int) or isinstance(count, bool) or not 0 <= count <= available:
        raise ScenarioError(f"array.modes: {count!r} is not allowed; a whole number from 0 to {available} is expected")
    return count


def _damped(model: ModalModel, group: dict[str, Any]) -> ModalModel:
    if "damping" not in group:
        return model
    return replace(model, damping=np.full(model.frequency.size, damping_ratio("array.damping", group["damping"])))


def damping_ratio(key: str, given: Any) -> float:
    """A damping ratio as a user wrote it beside the name of a file; ScenarioError where it is none."""
    try:
        xi = convert(given, "") if isinstance(given, str) else float(given)
    except (TypeError, ValueError):
        xi = math.nan
    if not 0.0 <= xi <= 0.99:
        raise ScenarioError(f"{key}: {shown(given)} is not allowed; a damping ratio from 0 to 99 percent is expected")
    return xi


def named_text(
    name: str,
    folder: Path = Path(),
    *,
    kind: str = "scenario",
    published: tuple[str, ...] | None = None,
    within: str = "",
) -> str:
    """Text of what a user named: a ``published`` name of the catalog, ``within`` a folder of it, or a file in ``folder``."""
    names = catalog_names() if published is None else published
    return catalog_text(f"{within}{name}") if name in names else read_text(folder / name, kind, names)


def read_text(path: Path, kind: str = "scenario", published: tuple[str, ...] | None = None) -> str:
    """Text of a file that a user named, which is to hold a ``kind``; ScenarioError if it is not one."""
    names = ", ".join(catalog_names() if published is None else published)
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise ScenarioError(
                f"{path}: is a folder; a {kind} file{f' or one of {names}' if names else ''} is expected"
            )
        if not path.is_file():
            raise ScenarioError(f"{path}: is not a regular file")
        if size > LARGEST_FILE:
            raise ScenarioError(
                f"{path}: has {size / 1e6:.1f} MB; a {kind} file has at most {LARGEST_FILE / 1e6:.0f} MB"
            )
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ScenarioError(
            f"{path}: there is no such file"
            + (f" and no catalog {kind} of this name; the catalog has {names}" if names else "")
        ) from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: is not text in UTF-8; a {kind} file is YAML") from None
    except (OSError, ValueError) as error:  # a null byte in the name is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{str(path)[:200]!r}: cannot be read: {reason}") from None


def parse_value(text: str) -> Any:
    """The value of a change KEY=VALUE: a YAML scalar or list, text with a unit stays text."""
    try:
        value = parse_yaml(text, "value")
    except ScenarioError:
        return text
    return text if value is None and text.strip() not in ("null", "~", "") else value


def dump_part(part: Part) -> str:
    """YAML text of a scenario or a description: complete, and the same again when it is loaded."""
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.default_flow_style = False
    yaml.width = 4096
    stream = io.StringIO()
    yaml.dump(plain(part, text=True), stream)
    return stream.getvalue()


def dump_scenario(scenario: Scenario) -> str:
    """YAML text of a scenario."""
    expect(scenario, Scenario, "a scenario (mv.load_scenario)")
    return _dumped(scenario)


@lru_cache(maxsize=1)  # a run writes it to several places, 20 ms each
def _dumped(scenario: Scenario) -> str:
    return dump_part(scenario)


def json_schema() -> dict[str, Any]:
    """JSON Schema of the scenario file, with units, ranges and meanings."""
    schema = Scenario.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "microvib scenario"
    return schema
