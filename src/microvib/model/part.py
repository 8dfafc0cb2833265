"""Base of all parameter objects: frozen, no unknown keys, quantities declared once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, model_validator

from microvib.errors import ScenarioError
from microvib.model.fields import quantity_in
from microvib.model.sentences import validate_part
from microvib.units import Quantity, Si

Six = tuple[float, float, float, float, float, float]  # Fx Fy Fz and Mx My Mz of something


if TYPE_CHECKING:
    _Base = BaseModel
else:

    class _Sentences(type(BaseModel)):
        """Classes whose constructor takes and refuses what a file would, in the same sentences."""

        def __call__(cls, **data: Any) -> Any:
            return validate_part(cls, data)

    class _Base(BaseModel, metaclass=_Sentences):
        pass


class Part(_Base):
    """A frozen set of parameters; values are SI floats, given as text with a unit, or as ``Si``
    numbers.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    removed_keys: ClassVar[dict[str, str]] = {}
    """Keys of the release before that are refused, and what to do instead."""

    def __setattr__(self, name: str, value: Any) -> None:
        """Nothing can be set: pydantic's refusal, as a sentence."""
        raise ScenarioError(
            f"{name}: cannot be set, scenarios are frozen; scenario.with_({{...}}) makes a changed"
            " copy"
        )

    def __dir__(self) -> list[str]:
        """Parameters and what is computed of them, without the machinery."""
        own = [
            name
            for kind in type(self).__mro__
            if kind.__module__.startswith("microvib")
            for name in vars(kind)
        ]
        return sorted(
            {
                *type(self).model_fields,
                *(name for name in own if not name.startswith(("_", "model_"))),
            }
        )

    @classmethod
    @cache
    def quantity_of(cls, name: str) -> Quantity | None:
        """Declaration of the field's physical quantity, or None where it has none."""
        field = cls.model_fields.get(name)
        if field is None:
            return None
        return quantity_in(field)

    def _consistency_errors(self) -> Iterator[str]:
        """Sentences on what does not go together, which begin with the key; the first is told."""
        yield from ()

    def _derived_fields(self) -> dict[str, Any]:
        """Fields that follow from others here, with their values; a file leaves them out."""
        return {}

    def _required_fields(self) -> tuple[str, ...]:
        """Fields that must be given though others would do without them."""
        return ()

    @model_validator(mode="after")
    def _check_consistency(self) -> Self:
        following = self._derived_fields()
        for name, value in following.items():
            if name in self.model_fields_set and not _nearly_equal(getattr(self, name), value):
                given = getattr(self, name)
                if isinstance(given, float):
                    told = f"{given:g}"
                else:
                    told = given
                raise ValueError(
                    f"{name}: {told} is not what follows from the other keys, {value:g}; leave it"
                    " out"
                )
            object.__setattr__(self, name, value)
        missing = [
            name
            for name in self._required_fields()
            if name not in self.model_fields_set | set(following)
        ]
        if missing:
            raise ValueError(self._missing_sentence(*missing))
        for sentence in self._consistency_errors():
            raise ValueError(sentence)
        return self

    def _missing_sentence(self, name: str, *others: str) -> str:
        """Sentence on fields that must be given and are not."""
        quantity = self.quantity_of(name)
        if quantity and quantity.unit:
            unit = f", in {quantity.display or quantity.unit}"
        else:
            unit = ""
        told = f"{name}: missing ({quantity.meaning if quantity else name}{unit})"
        if not others:
            return told
        verb = "is" if len(others) == 1 else "are"
        return f"{told}; {' and '.join(others)} {verb} missing, too"


def _nearly_equal(given: Any, value: float) -> bool:
    return isinstance(given, float) and math.isclose(given, value, rel_tol=1e-6)


def nudged_part(node: Any, path: Sequence[str], value: float) -> Any:
    """A copy of a part, or of a tuple of parts, with the number at the end of ``path`` replaced,
    unchecked; fields that follow from others are renewed.
    """
    if not path:
        return value
    first, rest = path[0], path[1:]
    if isinstance(node, tuple):
        k = int(first)
        return (*node[:k], nudged_part(node[k], rest, value), *node[k + 1 :])
    copy = node.model_copy(update={first: nudged_part(getattr(node, first), rest, value)})
    for name, derived in copy._derived_fields().items():
        object.__setattr__(copy, name, derived)
    return copy


def to_plain_data(value: Any, quantity: Quantity | None = None, *, text: bool = False) -> Any:
    """A part as nested dicts and lists, of which the same part can be made; what is None is left
    out.

    Its quantities are known to be in SI or, with ``text``, are texts with units that read back
    exactly.
    """
    if isinstance(value, Part):
        return _part_to_plain_data(value, text)
    if isinstance(value, (tuple, list)):
        return [to_plain_data(item, quantity, text=text) for item in value]
    if isinstance(value, dict):
        return {key: to_plain_data(item, text=text) for key, item in value.items()}
    if hasattr(value, "item") and getattr(value, "ndim", 1) == 0:  # a number of numpy's
        value = value.item()
    if not isinstance(value, float) or quantity is None:
        return value
    if not text:
        return Si(value)
    if quantity.unit:
        return quantity.format(value)
    return value


def _part_to_plain_data(part: Part, text: bool) -> dict[str, Any]:
    left_out = part._derived_fields()
    return {
        name: to_plain_data(value, part.quantity_of(name), text=text)
        for name in type(part).model_fields
        if name not in left_out and (value := getattr(part, name)) is not None
    }


def flatten_parameters(
    key: str, value: Any, quantity: Quantity | None
) -> Iterator[tuple[str, Any, Quantity | None]]:
    """Every parameter under ``key`` as (dotted key, value, declaration or None), in the order of
    the file.
    """
    if isinstance(value, Part):
        for name in type(value).model_fields:
            yield from flatten_parameters(
                f"{key}.{name}", getattr(value, name), type(value).quantity_of(name)
            )
    elif isinstance(value, tuple) and value and isinstance(value[0], Part):
        for index, item in enumerate(value):
            yield from flatten_parameters(f"{key}.{index}", item, None)
    else:
        yield key, value, quantity
