"""What is wrong with given data, as sentences: which key, what was found, what is allowed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from microvib.errors import ScenarioError, did_you_mean, shown
from microvib.model.part import Part, part_in, whole_numbers

P = TypeVar("P", bound=Part)
MAX_SENTENCES = 8  # problems that are told, at most; of the others their number


def validated(part: type[P], data: Any, *, si: bool = False, origin: str = "") -> P:
    """A part from nested dicts; every problem found becomes a sentence of one ScenarioError.

    Bare numbers are taken where no unit decides; with ``si`` everywhere, as SI.
    """
    name = part.__name__.lower()
    if not isinstance(data, dict):
        first = next((key for key, field in part.model_fields.items() if part_in(field.annotation)), "title")
        raise ScenarioError(
            f"{origin or name}: a mapping of keys is expected, such as '{first}:', not {type(data).__name__}"
        )
    try:
        return part.model_validate(data, context={"si": si})
    except ValidationError as error:
        items = error.errors(include_url=False)
        # Of a choice between a quantity and a word, what is wrong with the quantity says it all.
        quantities = {item["loc"][:-1] for item in items if item["type"] == "quantity"}
        items = [item for item in items if item["type"] != "literal_error" or item["loc"][:-1] not in quantities]
        lines = list(dict.fromkeys(_sentence(part, item) for item in items[: 10 * MAX_SENTENCES]))
        if len(lines) > MAX_SENTENCES:
            more = len(lines) if len(items) <= 10 * MAX_SENTENCES else len(items)
            lines = [*lines[:MAX_SENTENCES], f"... and {more - MAX_SENTENCES} more"]
        raise ScenarioError("\n".join(f"{origin}: {line}" if origin else line for line in lines)) from None


_BRANCHES = ("function-plain", "function-wrap", "literal", "constrained", "tuple", "lax-or-strict")


def _sentence(root: type[Part], item: ErrorDetails) -> str:
    """One validation error as a sentence: which key, what was found, what is allowed."""
    where = [str(part) for part in item["loc"] if not str(part).startswith(_BRANCHES)]
    key = ".".join(where) or root.__name__.lower()
    kind, found, context = item["type"], item.get("input"), item.get("ctx", {})
    if kind == "extra_forbidden":
        allowed = _keys_at(root, where[:-1])
        known = [".".join([*where[:-1], name]) for name in allowed]
        return f"{key}: unknown key; {_near(key, known, root)}allowed here are {', '.join(allowed) or 'none'}"
    if kind == "missing":
        return f"{key}: missing{_meaning(root, where)}"
    if kind == "quantity":
        return f"{key}: {context['text']}"
    if kind == "value_error":
        text = str(context.get("error", item["msg"]))
        if not where:
            return text
        return (
            f"{key}.{text}"
            if where and text.split(":")[0].replace(".", "").replace("_", "").isalnum()
            else f"{key}: {text}"
        )
    if kind == "literal_error":
        return f"{key}: {shown(found)} is not allowed; write {context.get('expected')}{_meaning(root, where)}"
    if kind in ("int_type", "int_from_float", "int_parsing", "greater_than_equal", "less_than_equal"):
        return f"{key}: {shown(found)} is not allowed; {_range(root, where)} is expected{_meaning(root, where)}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"{key}: {shown(found)} is not allowed; keys are expected here: {', '.join(_keys_at(root, where)) or 'text to text'}"
    if kind == "tuple_type":
        return f"{key}: {shown(found)} is not allowed; a list is expected{_meaning(root, where)}"
    if kind in ("too_long", "string_too_long"):
        what = "characters" if kind.startswith("string") else "entries"
        length = context.get("actual_length") or len(found)
        return f"{key}: has {length} {what}; at most {context['max_length']} are allowed{_meaning(root, where)}"
    message = item["msg"].replace("Input should", "it should")
    return f"{key}: {shown(found)} is not allowed; {message}"


def _near(key: str, known: list[str], root: type[Part]) -> str:
    """What an unknown key may stand for: a neighbour that is spelt like it, or a key of its name in another group."""
    elsewhere = [name for name in _all_keys(root) if name.split(".")[-1] == key.split(".")[-1]]
    return did_you_mean(key, known) or (f"did you mean {' or '.join(elsewhere)}? " if 0 < len(elsewhere) <= 3 else "")


def _all_keys(part: type[Part], prefix: str = "") -> Iterator[str]:
    for name, field in part.model_fields.items():
        yield f"{prefix}{name}"
        inner = part_in(field.annotation)
        if inner is not None:
            yield from _all_keys(
                inner, f"{prefix}{name}.0." if "tuple" in str(field.annotation) else f"{prefix}{name}."
            )


def _field_at(root: type[Part], where: list[str]) -> tuple[type[Part] | None, Any]:
    """The part class and the field that a path leads to."""
    part: type[Part] | None = root
    field: Any = None
    for name in where:
        if name.isdigit():
            continue
        if part is None or name not in part.model_fields:
            return None, None
        field = part.model_fields[name]
        part = part_in(field.annotation)
    return part, field


def _keys_at(root: type[Part], where: list[str]) -> list[str]:
    part, _ = _field_at(root, where)
    return list(part.model_fields) if part is not None else []


def _meaning(root: type[Part], where: list[str]) -> str:
    parent, _ = _field_at(root, where[:-1])
    _, field = _field_at(root, where)
    if field is None or parent is None:
        return ""
    quantity = parent.quantity_of(where[-1])
    if quantity is not None:
        unit = f", in {quantity.display or quantity.unit}" if quantity.unit else ""
        return f" ({quantity.meaning}{unit})"
    return f" ({field.description})" if field.description else ""


def _range(root: type[Part], where: list[str]) -> str:
    _, field = _field_at(root, where)
    return (field and whole_numbers(field)) or "a whole number"
