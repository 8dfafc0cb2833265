"""Quantities with units at the edge, SI floats inside.

A parameter is declared once, as ``Annotated[float, Quantity("kg*m^2", ...)]``: its unit, its range and its meaning. From
that one declaration come the check, the text in error messages, the JSON Schema and the tables in reports.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import PydanticCustomError, core_schema

_ANGLE = re.compile(r"\b(rad|radian|deg|degree|rpm|rps|turn|revolution|arcsec|arcmin|mrad|urad)s?\b")
_QUANTITY = re.compile(
    r"\s*(?P<number>[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf))\s*(?P<unit>[A-Za-zµΩ°%][A-Za-z0-9µΩ°%*/^.() -]*)?$"
)
_HERTZ = re.compile(r"\b[kMGmu]?(Hz|hertz)\b")


@cache
def _registry() -> Any:
    import pint  # slow to import, and not needed for numbers

    return pint.UnitRegistry()


def convert(text: str, unit: str) -> float:
    """Value of a quantity such as ``"0.2 kg*cm^2"`` in ``unit``; raises ValueError with a sentence."""
    import pint

    if len(text) > 200:
        raise ValueError("is too long for a quantity")
    match = _QUANTITY.match(text)
    if match is None:
        comma = "; write a decimal point, not a comma" if "," in text else ""
        raise ValueError(f"is not a quantity; write one number and a unit, such as '1 {unit}'" + comma)
    number, written = float(match["number"]), (match["unit"] or "").strip()
    if not written and unit:
        raise ValueError(f"needs a unit, such as '{text.strip()} {unit}'")
    try:
        quantity = _registry().Quantity(number, _registry().parse_units(written))
    except Exception as error:  # pint raises many kinds, down to tokenizer errors, for text that is no unit
        raise ValueError(f"has an unknown unit, '{written}'; write it such as '{unit or 'percent'}'") from error
    wants_hertz = "Hz" in unit
    if wants_hertz and _ANGLE.search(text):
        raise ValueError(f"mixes angles and cycles: a frequency is wanted here, in {unit}")
    if not wants_hertz and _ANGLE.search(unit) and _HERTZ.search(text):
        raise ValueError(f"mixes cycles and angles: an angle or angular rate is wanted here, in {unit}")
    try:
        return float(quantity.to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError as error:
        raise ValueError(
            f"has the wrong dimension; a unit compatible with {unit or 'a plain number'} is wanted"
        ) from error


@dataclass(frozen=True)
class Quantity:
    """Declaration of one physical parameter, used inside ``Annotated[float, ...]``.

    ``unit`` is the SI unit of the value in memory, ``display`` the unit that people use for it, ``symbol`` the paper's.
    """

    unit: str
    meaning: str
    symbol: str = ""
    gt: float | None = None
    ge: float | None = None
    le: float | None = None
    display: str = ""

    @property
    def allowed(self) -> str:
        """The allowed range in words, with the unit."""
        unit = f" {self.unit}" if self.unit else ""
        parts = []
        if self.gt is not None:
            parts.append(f"greater than {self.gt:g}{unit}")
        if self.ge is not None:
            parts.append(f"at least {self.ge:g}{unit}")
        if self.le is not None:
            parts.append(f"at most {self.le:g}{unit}")
        return " and ".join(parts) or f"any finite number in {self.unit or 'no unit'}"

    def parse(self, value: Any, info: ValidationInfo) -> float:
        """Value in SI from text with a unit, or from a number (only where units are not asked for)."""
        number = self._number(value, bool(info.context and info.context.get("units_required")))
        if not math.isfinite(number):
            raise self._error(value, f"is not finite; allowed is {self.allowed}")
        too_low = (self.gt is not None and number <= self.gt) or (self.ge is not None and number < self.ge)
        if too_low or (self.le is not None and number > self.le):
            raise self._error(value, f"is not allowed; it must be {self.allowed}")
        return number

    def _number(self, value: Any, units_required: bool) -> float:
        if isinstance(value, str):
            try:
                return convert(value, self.unit)
            except ValueError as error:
                raise self._error(value, str(error)) from error
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self._error(value, f"is not a quantity; write a number and a unit, such as '1 {self.unit}'".rstrip())
        if units_required and self.unit and math.isfinite(value):
            raise self._error(value, f"needs a unit, such as '{value} {self.display or self.unit}'")
        try:
            return float(value)
        except OverflowError:
            return math.inf

    def _error(self, value: Any, problem: str) -> PydanticCustomError:
        shown = str(value) if len(str(value)) < 60 else str(value)[:57] + "..."
        # Braces would be taken for placeholders of the message template.
        text = (
            f"{shown!r} {problem} ({self.meaning})" if isinstance(value, str) else f"{shown} {problem} ({self.meaning})"
        )
        return PydanticCustomError("quantity", "{text}", {"text": text})

    def format(self, value: float) -> str:
        """Text that reads back to the very same value: in the display unit where that is exact, else in SI."""
        for unit in (self.display, self.unit):
            if not unit:
                continue
            number = value if unit == self.unit else float(_registry().Quantity(value, self.unit).to(unit).magnitude)
            for digits in (6, 9, 12, 15, 17):
                text = f"{number:.{digits}g} {unit}"
                if convert(text, self.unit) == value:
                    return text
        return repr(value)

    def show(self, value: float) -> str:
        """Short text for tables: six digits in the display unit."""
        unit = self.display or self.unit
        number = value if unit == self.unit else float(_registry().Quantity(value, self.unit).to(unit).magnitude)
        return f"{number:.6g} {pretty(unit)}".strip()

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.with_info_plain_validator_function(self.parse)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        result: dict[str, Any] = {"type": "string" if self.unit else ["string", "number"], "description": self.meaning}
        result["x-unit"] = self.unit
        result["x-display-unit"] = self.display or self.unit
        if self.symbol:
            result["x-symbol"] = self.symbol
        bounds = {"exclusiveMinimum": self.gt, "minimum": self.ge, "maximum": self.le}
        result["x-range"] = {name: bound for name, bound in bounds.items() if bound is not None}
        return result


def pretty(unit: str) -> str:
    """A unit as print shows it: ``kg*m^2`` becomes ``kg m²``."""
    powers = {"^2": "²", "^3": "³", "^0.5": "^½", "^-1": "⁻¹"}
    for plain, raised in powers.items():
        unit = unit.replace(plain, raised)
    return unit.replace("*", " ").replace("deg", "°").replace("ohm", "Ω").replace("percent", "%")
