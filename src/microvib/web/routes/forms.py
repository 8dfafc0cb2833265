"""The form: what the schema says of each field, and a scenario with what is wrong with it, field by
field.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic.fields import FieldInfo

from microvib.errors import MicrovibError, ScenarioError
from microvib.io.data_sheet import DataSheet
from microvib.io.file_access import FileAccess
from microvib.io.named import catalog_names, catalog_text, hub_names, reference_names
from microvib.io.questions import QUESTIONS
from microvib.io.scenario_file import dump_scenario, parse_value, scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.model.fields import flatten_annotation, integer_range_text, part_type_of
from microvib.model.scenario import Scenario, set_key
from microvib.reports.parameters import derived
from microvib.units import Quantity

TITLES = {
    "motor": "Motor",
    "driver": "Driver",
    "reducer": "Reducer",
    "friction": "Friction of the output",
    "array": "Array",
    "spacecraft": "Spacecraft",
    "tracking": "Tracking",
    "record": "Record",
    "solver": "Solver",
}
_AS_FIRST = tuple(f"spacecraft.second_wing.{key}." for key in TITLES)
"""Parts of a second wing that are declared as those of the first."""
MAX_MODES = 100
LONG = 2000
"""Characters of changes, and 20 for each, from which a worker reads them: here they would take a
tenth of a second.
"""
NAME = "scenario"  # what a scenario of the page is called in messages, if anything
FILES = FileAccess(None, "the page opens no files")
"""Permission to open files that a request has: none, whichever key names them; names of the catalog
need no permission.
"""
NOT_SENT = "it did not come with the request; choose it as a table of the sources"
"""Reason given of a table that sources of a budget name and that was not sent."""


class Spec(BaseModel):
    """A scenario: a name of the catalog or the text of a file, and changed keys."""

    model_config = ConfigDict(extra="forbid")

    base: str | None = Field(default=None, max_length=100, description="name in the catalog")
    text: str | None = Field(
        default=None, max_length=1_000_000, description="text of a scenario file (YAML)"
    )
    changes: dict[str, str] = Field(
        default_factory=dict, max_length=2000, description="dotted key: value as typed"
    )

    @field_validator("changes")
    @classmethod
    def _short(cls, changes: dict[str, str]) -> dict[str, str]:
        if any(len(key) > 200 or len(value) > 20_000 for key, value in changes.items()):
            raise ValueError("a key has at most 200 characters and a value 20000")
        return changes

    @model_validator(mode="after")
    def _one_origin(self) -> Spec:
        if (self.base is None) == (self.text is None):
            raise ValueError("give either base, a name of the catalog, or text, a scenario file")
        return self

    @property
    def name(self) -> str:
        """Name in messages."""
        return self.base or NAME


def groups() -> list[dict[str, Any]]:
    """Groups of fields, as the drive is built."""
    return [
        {
            "key": key,
            "title": title,
            "fields": [
                field
                for field in _fields(part_type_of(Scenario.model_fields[key].annotation), f"{key}.")
                if not field["key"].startswith(_AS_FIRST)
            ],
        }
        for key, title in TITLES.items()
    ]


def sheet_fields() -> list[dict[str, Any]]:
    """Entries of a data sheet, as they are asked for on a terminal, too."""
    declared = {
        key: _field(DataSheet, key, field, "") for key, field in DataSheet.model_fields.items()
    }
    return [
        declared[key] | {"meaning": asked.words, "example": asked.example}
        for key, asked in QUESTIONS.items()
    ]


def _fields(part: Any, prefix: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    for name, field in part.model_fields.items():
        inner = part_type_of(field.annotation)
        if inner is not None and not _is_list(field.annotation):
            nested = _fields(inner, f"{prefix}{name}.")
            found += [
                {**item, "optional": item["optional"] or _may_be_none(field)} for item in nested
            ]
        else:
            found.append(_field(part, name, field, prefix))
    return found


def _field(part: Any, name: str, field: FieldInfo, prefix: str) -> dict[str, Any]:
    quantity = part.quantity_of(name)
    inner = part_type_of(field.annotation)
    made: dict[str, Any] = {
        "key": prefix + name,
        "symbol": quantity.symbol if quantity else "",
        "meaning": quantity.meaning if quantity else field.description or "",
        "unit": (quantity.display or quantity.unit) if quantity else "",
        "range": quantity.allowed if quantity else integer_range_text(field),
        "kind": _kind(field, quantity),
        "optional": _may_be_none(field) or not field.is_required(),
    }
    choices = _choices(field.annotation)
    if choices:
        made["choices"] = choices
    if inner is not None:
        made["items"] = _fields(inner, "")
    return made


def _kind(field: FieldInfo, quantity: Quantity | None) -> str:
    if quantity is not None:
        return "quantity"
    if _is_list(field.annotation):
        return "list"
    if field.annotation in (int, int | None):
        return "count"
    if field.annotation is bool:
        return "flag"
    if _choices(field.annotation):
        return "choice"
    return "text"


def _may_be_none(field: FieldInfo) -> bool:
    return type(None) in get_args(field.annotation)


def _is_list(annotation: Any) -> bool:
    return any(get_origin(inner) is tuple for inner in flatten_annotation(annotation))


def _choices(annotation: Any) -> list[str]:
    words = (
        get_args(inner) for inner in flatten_annotation(annotation) if get_origin(inner) is Literal
    )
    return [str(word) for each in words for word in each]


@lru_cache(maxsize=8)
def _parsed(text: str, name: str) -> Any:
    """Parsed text, or the error that says why it cannot be read: finding that out may take as
    long.
    """
    try:
        return parse_yaml(text, name)
    except MicrovibError as error:
        return error


def _data(spec: Spec) -> Any:
    """Data of the scenario without its changes, to be changed at will."""
    if spec.base is not None and spec.base not in catalog_names():
        raise ScenarioError(
            f"base: '{spec.base}' is not in the catalog, which has {', '.join(catalog_names())}"
        )
    if spec.base is not None:
        text = catalog_text(spec.base)
    else:
        text = spec.text or ""
    found = _parsed(text, spec.name)
    if isinstance(found, MicrovibError):
        raise found.with_traceback(None)
    return copy.deepcopy(found)


def _changes(spec: Spec) -> dict[str, Any]:
    return {key: parse_value(value) for key, value in spec.changes.items()}


def _written_data(spec: Spec) -> dict[str, Any]:
    """Data of the scenario with its changes, as written."""
    data = _data(spec)
    told: dict[str, Any] = data if isinstance(data, dict) else {}
    for key, value in _changes(spec).items():
        set_key(told, key, value)
    return told


def array_structure(spec: Spec) -> str | None:
    """Name in the catalog of the structure whose finite elements give the array's modes; None where
    none is named.
    """
    array = _written_data(spec).get("array")
    if isinstance(array, dict):
        named = array.get("fem")
    else:
        named = None
    if named in reference_names():
        return named
    return None


def _texts(data: Any) -> Iterator[str]:
    """Every text among the values of some data."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, (dict, list)):
        for item in data.values() if isinstance(data, dict) else data:
            yield from _texts(item)


def is_slow_to_read(spec: Spec) -> bool:
    """Whether the scenario may take long to read, so that a worker should do it: a text, many
    changes, names of the catalog.
    """
    if spec.text is not None or sum(20 + len(value) for value in spec.changes.values()) > LONG:
        return True
    named = {*reference_names(), *hub_names(), *catalog_names()}
    return not named.isdisjoint(_texts(list(_changes(spec).values())))


def scenario(spec: Spec) -> Scenario:
    """The scenario that is meant; ScenarioError says what is wrong."""
    loaded = scenario_of(_data(spec), spec.name, _changes(spec), FILES)
    n, hub = (
        len(loaded.array.modes),
        0 if loaded.spacecraft is None else len(loaded.spacecraft.hub.modes),
    )
    if n + hub > MAX_MODES:
        if not hub:
            where = f"array.modes: has {n} modes"
        else:
            where = f"spacecraft.hub.modes: has {hub} modes, beside {n} of the array"
        raise ScenarioError(
            f"{where}; the page takes at most {MAX_MODES}, `microvib run` takes all"
        )
    return loaded


def view_of(spec: Spec) -> dict[str, Any]:
    """A scenario as the form shows it, also one that is wrong."""
    base, errors = _load_or_errors(spec.model_copy(update={"changes": {}}))
    base_values = {} if base is None else values_of(base)
    found = base
    if spec.changes:
        found, errors = _load_or_errors(spec)
    if found is None:
        return _view_of_wrong(spec, base, base_values) | {"errors": errors}
    values = values_of(found)
    changed = [key for key in values if base_values.get(key) != values[key]]
    typed = {key: text for key, text in spec.changes.items() if key in changed}
    return {
        "title": found.title,
        "values": values | typed,
        "base_values": base_values,
        "sources": {key: found.source_of(key) for key in values},
        "changed": changed,
        "errors": errors,
        "derived": derived(found),
        "unusual": list(found.unusual_values()),
        "yaml": dump_scenario(found),
    }


def _view_of_wrong(
    spec: Spec, base: Scenario | None, base_values: dict[str, str]
) -> dict[str, Any]:
    """The form's values, of which some are wrong: what was typed, over those of the ``base``."""
    values = base_values or _written(spec)
    return {
        "title": base.title if base else "",
        "values": values | spec.changes,
        "base_values": base_values,
        "sources": {key: base.source_of(key) for key in values} if base else {},
        "changed": list(spec.changes),
        "derived": [],
        "unusual": [],
        "yaml": None,
    }


def _load_or_errors(spec: Spec) -> tuple[Scenario | None, list[dict[str, Any]]]:
    """The scenario, or what is wrong with it."""
    try:
        return scenario(spec), []
    except MicrovibError as error:
        return None, sentences(str(error), spec.name)


def _written(spec: Spec) -> dict[str, str]:
    """Values of the form's keys from a file that is not a scenario."""
    try:
        data = _data(spec)
    except MicrovibError:
        return {}
    groups = data.items() if isinstance(data, dict) else ()
    return dict(item for key, value in groups if key in TITLES for item in _flat(key, value))


def _flat(key: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, (dict, list)) and value:
        for name, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _flat(f"{key}.{name}", item)
    else:
        yield key, "" if value is None else str(value)


_KEY = re.compile(r"[A-Za-z_]\w*(\.\w+)*(?=:)")


def sentences(text: str, name: str = NAME) -> list[dict[str, Any]]:
    """Each line of an error with the key that it is about, None where it names none."""
    found = []
    for line in filter(None, text.split("\n")):
        sentence = line.removeprefix(f"{name}: ")
        match = _KEY.match(sentence)
        known = match is not None and match.group().split(".")[0] in Scenario.model_fields
        found.append({"key": match.group() if match and known else None, "error": sentence})
    return found


def values_of(loaded: Scenario) -> dict[str, str]:
    """Every parameter as the text that one would type."""
    return {key: _text(value, quantity) for key, value, quantity in loaded.entries()}


def _text(value: Any, quantity: Quantity | None) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        if quantity is not None and (quantity.unit or quantity.display):
            return quantity.format(value)
        if float(f"{value:g}") == value:
            return f"{value:g}"
        return repr(value)
    if isinstance(value, tuple):
        return str([list(item) if isinstance(item, tuple) else item for item in value])
    return str(value)
