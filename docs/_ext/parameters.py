"""Tables of the scenario file's keys, from the declaration that each parameter has in the model."""

from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from IPython.display import Markdown
from pydantic.fields import FieldInfo

from microvib.model.part import Part, quantity_in
from microvib.units import pretty

shown: set[type[Part]] = set()


def keys(part: type[Part], prefix: str) -> Markdown:
    """Table of the keys of one group of the file: symbol, SI unit, allowed range, default, meaning."""
    shown.add(part)
    head = "| key | symbol | unit | allowed | default | meaning |\n|---|---|---|---|---|---|"
    rows = (
        _row(f"{prefix}{name}", field)
        for name, field in part.model_fields.items()
        if not part_of(field)
    )
    return Markdown("\n".join([head, *rows]))


def part_of(field: FieldInfo) -> type[Part] | None:
    """Group that a key holds, or a list of which it holds; None for a single value."""
    return next(
        (a for a in _arguments(field.annotation) if isinstance(a, type) and issubclass(a, Part)),
        None,
    )


def parts(part: type[Part]) -> Iterator[type[Part]]:
    """A group and all groups inside it."""
    yield part
    for field in part.model_fields.values():
        inner = part_of(field)
        if inner is not None:
            yield from parts(inner)


def _arguments(annotation: Any) -> Iterator[Any]:
    yield annotation
    for argument in get_args(annotation):
        yield from _arguments(argument)


def _row(key: str, field: FieldInfo) -> str:
    quantity = quantity_in(field)
    if quantity is None:
        cells = ["", "", _allowed(field), _default(field), field.description or ""]
    else:
        other = pretty(quantity.display) if quantity.display not in ("", quantity.unit) else ""
        unit = pretty(quantity.unit) + (f" ({other})" if other else "")
        cells = [
            _symbol(quantity.symbol),
            unit,
            _range(quantity),
            _default(field),
            quantity.meaning,
        ]
    return "| " + " | ".join([f"`{key}`", *cells]) + " |"


def _symbol(text: str) -> str:
    return f"`{text}`" if text else ""


def _range(bounds: Any) -> str:
    signs = {"gt": "> ", "ge": "≥ ", "lt": "< ", "le": "≤ "}
    return ", ".join(
        f"{sign}{bound:g}"
        for name, sign in signs.items()
        if (bound := getattr(bounds, name, None)) is not None
    )


def _allowed(field: FieldInfo) -> str:
    choices = [
        c for a in _arguments(field.annotation) if get_origin(a) is Literal for c in get_args(a)
    ]
    if choices:
        return ", ".join(f"`{choice}`" for choice in choices)
    texts = [
        _range(item)
        for a in (field, *_arguments(field.annotation))
        for item in getattr(a, "metadata", ())
    ]
    whole = ["whole"] if any(a is int for a in _arguments(field.annotation)) else []
    return ", ".join([*whole, *filter(None, texts)])


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    return (
        "none"
        if default in (None, "", (), {})
        else f"{default:g}"
        if isinstance(default, float)
        else f"{default}"
    )
