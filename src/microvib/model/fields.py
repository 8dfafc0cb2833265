"""Declarations of the fields of parts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from microvib.units import Quantity


def flatten_annotation(annotation: Any) -> Iterator[Any]:
    """An annotation and all that it is made of, from outside to inside."""
    yield annotation
    for argument in get_args(annotation):
        yield from flatten_annotation(argument)


def quantity_in(field: FieldInfo) -> Quantity | None:
    """The ``Quantity`` that a field declares, also inside ``Annotated[...] | None``."""
    return next(
        (
            x
            for x in (*field.metadata, *flatten_annotation(field.annotation))
            if isinstance(x, Quantity)
        ),
        None,
    )


def part_type_of(annotation: Any) -> Any:
    """The class of the part, or of the parts, that a field holds; None where it holds none."""
    return next(
        (
            x
            for x in flatten_annotation(annotation)
            if isinstance(x, type) and issubclass(x, BaseModel)
        ),
        None,
    )


def integer_range_text(field: FieldInfo) -> str:
    """The range of a field that holds a whole number, in words; empty without one."""
    told = [
        *field.metadata,
        *(
            m
            for x in flatten_annotation(field.annotation)
            if isinstance(x, FieldInfo)
            for m in x.metadata
        ),
    ]
    low, high = (
        next((getattr(m, end) for m in told if hasattr(m, end)), None) for end in ("ge", "le")
    )
    if low is None:
        return ""
    return f"a whole number from {low} to {high}"
