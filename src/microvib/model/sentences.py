"""Sentences on errors in given data: which key, what was found, what is allowed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from microvib.errors import ScenarioError, did_you_mean, quoted_value
from microvib.model.fields import integer_range_text, part_type_of, quantity_in

P = TypeVar("P", bound=BaseModel)
_KINDS_OF_YAML: Mapping[type, str] = MappingProxyType(
    {list: "a list", str: "plain text", type(None): "nothing"}
)
"""Contents of a file that should hold keys, in words."""
MAX_SENTENCES = 8  # problems that are told, at most; of the others their number


def validate_part(part: type[P], data: Any, *, si: bool = False, origin: str = "") -> P:
    """A part from nested dicts; every problem found becomes a sentence of one ScenarioError.

    Bare numbers are taken where no unit decides; with ``si`` everywhere, as SI.
    """
    if not isinstance(data, dict):
        name = part.__name__.lower()
        first = next(
            (key for key, field in part.model_fields.items() if part_type_of(field.annotation)),
            "title",
        )
        raise ScenarioError(
            f"{origin or name}: keys with their values are expected, such as '{first}:', but there"
            f" is {_KINDS_OF_YAML.get(type(data), 'one value')} instead"
        )
    try:
        return part.model_validate(data, context={"si": si})
    except ValidationError as error:
        before = f"{origin}: " if origin else ""
        lines = _sentences(part, error.errors(include_url=False))
        raise ScenarioError("\n".join(before + line for line in lines)) from None


_ORDER = {"extra_forbidden": 0, "missing": 2}
"""Unknown keys first, for a misspelt one is the cause of a missing one; by types of errors."""


def _sentences(part: type[BaseModel], items: list[ErrorDetails]) -> list[str]:
    """The first validation errors, a sentence each, and how many more there are."""
    # Of a choice between a quantity and a word, what is wrong with the quantity says it all.
    quantities = {item["loc"][:-1] for item in items if item["type"] == "quantity"}
    items = [
        item
        for item in items
        if item["type"] != "literal_error" or item["loc"][:-1] not in quantities
    ]
    items.sort(key=lambda item: _ORDER.get(item["type"], 1))
    lines = list(dict.fromkeys(_sentence(part, item) for item in items[: 10 * MAX_SENTENCES]))
    if len(lines) <= MAX_SENTENCES:
        return lines
    count = len(lines) if len(items) <= 10 * MAX_SENTENCES else len(items)
    return [*lines[:MAX_SENTENCES], f"... and {count - MAX_SENTENCES} more"]


_BRANCHES = (
    "function-after",
    "function-plain",
    "function-wrap",
    "literal",
    "constrained",
    "tuple",
    "lax-or-strict",
)


class _KeyContext(NamedTuple):
    """Field at a path of keys."""

    keys: tuple[str, ...] = ()
    """Keys that are allowed there."""
    meaning: str = ""
    """Meaning and unit, in parentheses."""
    number: str = "a whole number"
    """Text on the whole number that is expected."""
    removed_keys: Mapping[str, str] = MappingProxyType({})
    """Keys of the release before, and what to do instead."""


def _resolve_key(root: type[BaseModel], where: list[str]) -> _KeyContext:
    part: type[BaseModel] | None = root
    field = None
    for name in (name for name in where if not name.isdigit()):
        if part is None or name not in part.model_fields:
            return _KeyContext()
        field = part.model_fields[name]
        part = part_type_of(field.annotation)
    keys = () if part is None else tuple(part.model_fields)
    removed_keys = getattr(part, "removed_keys", {})
    if field is None:
        return _KeyContext(keys, removed_keys=removed_keys)
    meaning = _meaning(field, is_entry=where[-1].isdigit())
    return _KeyContext(
        keys,
        f" ({meaning})" if meaning else "",
        integer_range_text(field) or "a whole number",
        removed_keys,
    )


def _meaning(field: FieldInfo, is_entry: bool) -> str | None:
    """Meaning of a key, with the unit of its quantity; of an entry of a list that of the list."""
    quantity = None if is_entry else quantity_in(field)
    if not quantity:
        return field.description
    if quantity.unit:
        return f"{quantity.meaning}, in {quantity.display or quantity.unit}"
    return f"{quantity.meaning}"


def _sentence(root: type[BaseModel], item: ErrorDetails) -> str:
    """One validation error as a sentence: which key, what was found, what is allowed."""
    where = [str(part) for part in item["loc"] if not str(part).startswith(_BRANCHES)]
    key = ".".join(where) or root.__name__.lower()
    kind, found, context = item["type"], item.get("input"), item.get("ctx", {})
    place = _resolve_key(root, where)
    if kind == "extra_forbidden":
        return _unknown_key(root, where, key)
    if kind == "missing":
        return f"{key}: missing{place.meaning}"
    if kind == "quantity":
        return f"{key}: {context['text']}"
    if kind == "value_error":
        return _of_value_error(str(context.get("error", item["msg"])), ".".join(where))
    if kind in ("too_long", "string_too_long"):
        what = "characters" if kind == "string_too_long" else "entries"
        length = context.get("actual_length") or len(found)
        return f"{key}: has {length} {what}; at most {context['max_length']} are allowed{place.meaning}"
    if kind == "literal_error":
        expected = f"write {context.get('expected')}{place.meaning}"
    elif kind in _NOT_AN_INTEGER:
        expected = f"{place.number} is expected{place.meaning}"
    elif kind in _NOT_A_MAPPING:
        expected = f"keys are expected here: {', '.join(place.keys) or 'text to text'}"
    elif kind == "tuple_type":
        expected = f"a list is expected{place.meaning}"
    else:
        expected = item["msg"].replace("Input should", "it should")
    return f"{key}: {quoted_value(found)} is not allowed; {expected}"


_NOT_AN_INTEGER = (
    "int_type",
    "int_from_float",
    "int_parsing",
    "greater_than_equal",
    "less_than_equal",
)
_NOT_A_MAPPING = ("model_type", "model_attributes_type", "dict_type")
"""Validation errors by their type."""


def _unknown_key(root: type[BaseModel], where: list[str], key: str) -> str:
    parent = _resolve_key(root, where[:-1])
    if where[-1] in parent.removed_keys:
        return f"{key}: this key was removed; {parent.removed_keys[where[-1]]}"
    known = [".".join([*where[:-1], name]) for name in parent.keys]
    return f"{key}: unknown key; {_suggest_key(key, known, root)}allowed here are {', '.join(parent.keys) or 'none'}"


def _of_value_error(text: str, key: str) -> str:
    """Sentence of a check of the part at a key, which may begin with a key within it."""
    if not key:
        return text
    deeper = text.split(":")[0].replace(".", "").replace("_", "").isalnum()
    return f"{key}{'.' if deeper else ': '}{text}"


def _suggest_key(key: str, known: list[str], root: type[BaseModel]) -> str:
    """Suggestions for an unknown key: a neighbour spelt like it, or a key of its name in another
    group, the outermost.
    """
    elsewhere = [name for name in _all_keys(root) if name.split(".")[-1] == key.split(".")[-1]]
    outermost = min((name.count(".") for name in elsewhere), default=0)
    elsewhere = [name for name in elsewhere if name.count(".") == outermost]
    return did_you_mean(key, known) or (
        f"did you mean {' or '.join(elsewhere)}? " if 0 < len(elsewhere) <= 3 else ""
    )


def _all_keys(part: type[BaseModel], prefix: str = "") -> Iterator[str]:
    for name, field in part.model_fields.items():
        yield f"{prefix}{name}"
        inner = part_type_of(field.annotation)
        if inner is not None:
            yield from _all_keys(
                inner,
                f"{prefix}{name}.0." if "tuple" in str(field.annotation) else f"{prefix}{name}.",
            )
