"""Quantities with units at the edge, SI floats inside.

A parameter is declared once, as ``Annotated[float, Quantity("kg*m^2", ...)]``: its unit, its range
and its meaning. From that one declaration come the check, the text in error messages, the JSON
Schema and the tables in reports.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache, lru_cache
from numbers import Real
from typing import TYPE_CHECKING, Any

from microvib.errors import OptionError, quoted_value

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
    from pydantic_core import PydanticCustomError, core_schema

LARGEST_MAGNITUDE = 1e50
"""Largest number that a quantity or a cell of a table may be, so that no product of them overflows."""

_NUMBER = re.compile(r"\s*([+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf))\s*")
_UNIT = re.compile(r"(1?/)?[A-Za-z_][A-Za-z0-9_*/^.() -]*")
_EXPONENT = re.compile(r"\^-?\d{1,2}(\.\d{1,2})?(?![\d.^])")
_PRINTED = {
    "^0.5": "^½",
    "^-1": "⁻¹",
    "^2": "²",
    "^3": "³",
    "*": " ",
    "deg": "°",
    "ohm": "Ω",
    "percent": "%",
}
"""Units as they are declared, and as print shows them."""
_SUPERSCRIPT = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_GLUED = r"(?<![A-Za-z_])(da|[GMkhdcmun]?)"
_READ = (
    (r"(?<![A-Za-z])([kMGmu]?)(?i:ohms?)(?![A-Za-z])", r"\1ohm"),
    (r"(?<![A-Za-z])([kKMGmu]?)(?i:hz)(?![A-Za-z])", lambda found: found[1].replace("K", "k") + "Hz"),
    (r"(?<![A-Za-z])(?i:revs?|revolutions?|umdr|[ru](?=/))(?![A-Za-z])", "turn"),
    (r"(?<![A-Za-z])(?i:rpm)(?![A-Za-z])", "rpm"),
    (r"(?<![A-Za-z])(?i:arc-?sec(onds?)?)(?![A-Za-z])", "arcsec"),
    (r"(?<![A-Za-z])(?i:deg(rees?)?)(?![A-Za-z])", "deg"),
    (r"(?<![A-Za-z])(?i:sec(onds?)?)(?![A-Za-z])", "s"),
    (r"(?<![A-Za-z])(?i:volts?)(?![A-Za-z])", "V"),
    (r"(?<![A-Za-z])(?i:amps?|amperes?)(?![A-Za-z])", "A"),
    (r"(?<![A-Za-z])(?i:henr(y|ys|ies))(?![A-Za-z])", "H"),
    (r"(?<![A-Za-z])(?i:newtons?)(?![A-Za-z])", "N"),
    (r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda found: "^" + found[0].translate(_SUPERSCRIPT)),
    (r"\s+", " "),
    (r"\^?½", "^0.5"),
    (r"\*\*", "^"),
    (r"[·⋅∙•×]", "*"),
    (r"[µμ]", "u"),
    (r"[ΩΩ]", "ohm"),
    (r"°", "deg"),
    (r"%", "percent"),
    (r"(?<=[A-Za-z])(-?\d)", r"^\1"),  # m2, s-1
    (_GLUED + r"N(mm|cm|m)(s?)(?![A-Za-z])", lambda found: "*".join(filter(None, (f"{found[1]}N", found[2], found[3])))),
    (_GLUED + r"(g|kgf|lbf|ozf)(mm|cm|m|in|ft)(?![A-Za-z])", r"\1\2*\3"),
    (_GLUED + r"([NVAW])s(?![A-Za-z])", r"\1\2*s"),
    (r"(?<=[A-Za-z])[.-](?=[A-Za-z])", "*"),
)  # fmt: skip
"""How units are written, and the same as pint reads it: print, keyboards without raised digits,
products without a sign.
"""
_COMMON: dict[str, dict[str, float]] = {
    "": {"percent": 0.01},
    "A": {"A": 1.0, "mA": 0.001},
    "H": {"H": 1.0, "mH": 0.001, "uH": 1e-6},
    "Hz": {"Hz": 1.0, "mHz": 0.001, "kHz": 1000.0},
    "N": {"N": 1.0, "mN": 0.001, "kN": 1000.0},
    "N*m": {"N*m": 1.0, "uN*m": 1e-6, "mN*m": 0.001, "kN*m": 1000.0, "N*mm": 0.001, "N*cm": 0.01},
    "N*m*s/rad": {
        "N*m*s/rad": 1.0,
        "mN*m*s/rad": 0.001,
        "N*m*s": 1.0,
        "N*m*s/deg": 57.29577951308232,
    },
    "N*m/A": {"N*m/A": 1.0, "mN*m/A": 0.001, "V*s/rad": 1.0},
    "N*m/Hz^0.5": {"N*m/Hz^0.5": 1.0, "mN*m/Hz^0.5": 0.001},
    "N*m/rad": {
        "N*m/rad": 1.0,
        "mN*m/rad": 0.001,
        "kN*m/rad": 1000.0,
        "N*m/deg": 57.29577951308232,
    },
    "N^2*m^2/Hz": {"N^2*m^2/Hz": 1.0, "mN^2*m^2/Hz": 1e-6},
    "N*s^2/rad^2": {"N*s^2/rad^2": 1.0},
    "N*m*s^2/rad^2": {"N*m*s^2/rad^2": 1.0},
    "N/Hz^0.5": {"N/Hz^0.5": 1.0, "mN/Hz^0.5": 0.001},
    "N/m": {"N/m": 1.0, "N/mm": 1000.0, "kN/m": 1000.0},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9},
    "V": {"V": 1.0, "mV": 0.001},
    "V*s/A": {"V*s/A": 1.0, "mV*s/A": 0.001},
    "V/A": {"V/A": 1.0, "mV/A": 0.001},
    "V/A/s": {"V/A/s": 1.0, "V/(A*s)": 1.0},
    "kg": {"kg": 1.0, "g": 0.001},
    "kg*m^2": {
        "kg*m^2": 1.0,
        "kg*cm^2": 1e-4,
        "kg*mm^2": 1e-6,
        "g*m^2": 0.001,
        "g*cm^2": 1.0000000000000001e-07,
    },
    "kg/m^2": {"kg/m^2": 1.0, "g/m^2": 0.001},
    "kg/m^3": {"kg/m^3": 1.0},
    "kg^0.5*m": {"kg^0.5*m": 1.0},
    "m": {"m": 1.0, "um": 1e-6, "mm": 0.001, "cm": 0.01, "km": 1000.0},
    "ohm": {"ohm": 1.0, "mohm": 0.001, "kohm": 1000.0},
    "rad": {
        "rad": 1.0,
        "nrad": 1e-9,
        "urad": 1e-6,
        "mrad": 0.001,
        "deg": 0.017453292519943295,
        "arcsec": 4.84813681109536e-06,
    },
    "rad/s": {
        "rad/s": 1.0,
        "mrad/s": 0.001,
        "deg/s": 0.017453292519943295,
        "rpm": 0.10471975511965977,
    },
    "s": {"s": 1.0, "us": 1e-6, "ms": 0.001, "min": 60.0, "h": 3600.0},
    "s^-1": {"s^-1": 1.0, "1/s": 1.0},
}
"""Factors of common units, by the declared one, to the last bit as pint's: pint takes longer to
start than a run to simulate. Their reciprocals are the factors of the way back. Whatever is not
listed is asked of pint."""
_RATES = ("rad/s", "rad/s^2")
_HERTZ = re.compile(r"\b[kMGmu]?(Hz|hertz)\b")


@cache
def _registry() -> Any:
    import pint  # slow to import, and not needed for numbers

    return pint.UnitRegistry()


@lru_cache(maxsize=1024)
def plain_unit(written: str) -> str:
    """A unit as pint reads it: ``kg·cm²``, ``kgcm2`` and ``kg cm^2`` become ``kg*cm^2`` or the
    like.
    """
    for pattern, plain in _READ:
        written = re.sub(pattern, plain, written)
    return written.strip()


def convert(text: str, unit: str, example: str = "") -> float:
    """Value of a quantity such as ``"0.2 kg*cm^2"`` in ``unit``; ValueError with a sentence that
    proposes ``unit``, or ``example``.

    Units may be written as the project prints them (``0.2 kg cm²``), or run together as on data
    sheets (``0.2 kgcm2``).
    """
    if len(text) > 200:
        raise ValueError("is too long for a quantity")
    digits, written, plain = _number_and_unit(text, unit, example)
    number = float(digits)
    if not written and unit and number != 0.0:  # nought is nought in every unit
        raise ValueError(f"needs a unit, such as '{text.strip()} {example or unit}'")
    value = number * (_factor(plain, written, unit) if written else 1.0)
    if not math.isfinite(value):
        raise ValueError("is not finite")
    if abs(value) > LARGEST_MAGNITUDE:
        raise ValueError(f"is too large; {LARGEST_MAGNITUDE:g} {unit} at most is expected")
    if value == 0.0 and re.search("[1-9]", re.split("[eE]", digits)[0]):
        raise ValueError("is too small for a number")
    return value


def _number_and_unit(text: str, unit: str, example: str) -> tuple[str, str, str]:
    """Number, and unit as written and in plain letters, of a quantity; ValueError where it is none."""
    match = _NUMBER.match(text.replace("\u2212", "-"))  # the sign of minus
    if match is not None:
        written = text[match.end() :].strip()
        plain = written if written in _COMMON.get(unit, ()) else plain_unit(written)
        if not written or _UNIT.fullmatch(plain):
            return match[1], written, plain
    comma = "; write a decimal point, not a comma" if "," in text else ""
    raise ValueError(f"{_no_quantity(example or unit)}{comma}")


def unit_of(text: str) -> str:
    """The unit that a quantity such as ``"2 arcsec"`` is given in; empty where it has none."""
    match = _NUMBER.match(text)
    return plain_unit(text[match.end() :]) if match else ""


def _no_quantity(unit: str) -> str:
    """Message on a value that is no quantity in ``unit``, or no number where there is none."""
    if not unit:
        return "is not a number; write one without a unit, such as 0.5, or a percentage, such as '50 percent'"
    return f"is not a quantity; write one number and a unit, such as '1 {unit}'"


@lru_cache(maxsize=1024)
def _factor(plain: str, written: str, unit: str) -> float:
    """Factor from the unit ``plain``, ``written`` so by the user, to ``unit``; ValueError with a
    sentence.
    """
    common = _common(plain.replace(" ", "*"), unit)
    if common is not None:
        return common
    import pint

    try:
        if re.search(r"[\d^]", _EXPONENT.sub("", plain.removeprefix("1/"))):
            # pint would compute the number, for hours where it is a tower of powers
            raise ValueError
        given = _registry().parse_units(plain.removeprefix("1/")) ** (
            -1 if plain.startswith("1/") else 1
        )
        wanted = _registry().parse_units(unit)
        factor, nothing = (
            float(_registry().Quantity(x, given).to(wanted).magnitude) for x in (1.0, 0.0)
        )
    except pint.DimensionalityError as error:
        raise ValueError(
            f"has the wrong dimension; a unit compatible with {unit or 'a plain number'} is"
            " expected"
        ) from error
    except (
        Exception
    ) as error:  # pint raises many kinds, down to tokenizer errors, for text that is not a unit
        raise ValueError(
            f"has an unknown unit, '{written}'; write it such as '{unit or 'percent'}'"
        ) from error
    if nothing != 0.0:  # decibels, degrees Celsius
        raise ValueError(
            f"has a unit with an offset, '{written}'; write it such as '{unit or 'percent'}'"
        )
    _check_angles(_angles(given), _angles(wanted), unit, plain)
    return factor


def _common(given: str, unit: str) -> float | None:
    """Factor of a common unit, either way; None where the registry is to be asked."""
    if unit in _COMMON:
        return _COMMON[unit].get(given)
    back = _COMMON.get(given, {}).get(unit)
    if back is None:
        return None
    return 1.0 / back


def _angles(unit: Any) -> float:
    """Power of the radian in a unit, which pint does not count as a dimension."""
    return float(dict(_registry().get_root_units(unit)[1]._units).get("radian", 0))


def _check_angles(given: float, wanted: float, unit: str, plain: str) -> None:
    """ValueError where an angle is given for a number, or cycles or a percentage for an angle; left
    out, an angle is in radians, but in an angular rate and beside minutes, where turns may be meant.
    """
    if wanted and "percent" in plain:
        raise ValueError(f"is a percentage; an angle is expected here, in {unit}")
    _check_cycles(given, wanted, unit, plain)
    if wanted and not given and (unit in _RATES or re.search(r"\bmin\b", plain)):
        raise ValueError(
            f"leaves open whether turns or radians are counted; write rpm, deg or rad, such as in {unit}"
        )
    if given not in (0, wanted) and (wanted or given > 0):
        raise ValueError(
            f"has one angle unit too many or too few; a unit such as {unit or 'percent'} is"
            " expected"
        )


def _check_cycles(given: float, wanted: float, unit: str, plain: str) -> None:
    """ValueError where an angle is given for cycles, or cycles for an angle."""
    if "Hz" in unit:
        if given:
            raise ValueError(f"mixes angles and cycles: a frequency is expected here, in {unit}")
    elif wanted and _HERTZ.search(plain) is not None:
        raise ValueError(
            f"mixes cycles and angles: an angle or angular rate is expected here, in {unit}"
        )


class Si(float):
    """A number that is said to be in SI, ``Si(0.001)``: it needs no unit where text with a unit is
    expected.
    """


GivenQuantity = str | Si
"""How a quantity is given wherever a unit decides: text with its unit, or a number that is said to
be in SI.
"""
Band = str | tuple[GivenQuantity, GivenQuantity]
"""LOW:HIGH with a unit, or both ends."""


def quantity(
    key: str, given: GivenQuantity, unit: str, *, positive: bool = False, example: str = ""
) -> Si:
    """Value of ``key``, in ``unit``; OptionError where it is no such quantity, or a bare
    number where a unit decides.

    ``example`` is the unit to propose in place of ``unit``.
    """
    try:
        if isinstance(given, Si):
            value = given
        else:
            value = Si(_number_or_text(given, unit, example))
    except ValueError as error:
        raise OptionError(key, f"{quoted_value(given)} {error}") from None
    if positive and not value > 0.0:
        raise OptionError(
            key, f"{quoted_value(given)} is not allowed; it must be greater than 0 {unit}"
        )
    return value


def _number_or_text(given: Any, unit: str, example: str) -> float:
    if isinstance(given, str):
        return convert(given, unit, example)
    if isinstance(given, bool) or not isinstance(given, Real):
        raise ValueError(_no_quantity(example or unit))
    try:
        float(given)
    except OverflowError:
        raise ValueError("is too large") from None
    if unit and given != 0:
        number = quoted_value(float(given))
        raise ValueError(
            f"needs a unit, such as '{number} {example or unit}'; for {unit} write Si({number})"
        )
    return float(given)


def band(given: Band) -> tuple[Si, Si]:
    """Ends in Hz of ``0.5:5 Hz``, whose first bound may go without the unit of the second, or of a
    pair. OptionError.
    """
    low, colon, high = given.partition(":") if isinstance(given, str) else (given[0], ":", given[1])
    if not colon:
        raise OptionError(
            "band", f"{given!r} is not a range; write LOW:HIGH with a unit, such as '0.5:5 Hz'"
        )
    if isinstance(given, str) and not any(c.isalpha() for c in str(low)):
        low = f"{low} {str(high).strip().lstrip('+-.0123456789eE ')}".strip()
    first, last = quantity("band", low, "Hz"), quantity("band", high, "Hz")
    if not 0.0 <= first < last:
        raise OptionError(
            "band",
            f"{given!r} is not a range; the first bound must be at least 0 and below the second",
        )
    return first, last


def within_band(frequency: Any, low: float, high: float, tolerance: Any = 0.0) -> Any:
    """Whether a frequency, known to within ``tolerance``, may be within a band, whose ends belong to it; also
    of arrays.

    A line of the clock at an end of the band may be a rounding off it.
    """
    slack = tolerance + 1e-9 * abs(frequency)
    return (frequency >= low - slack) & (frequency <= high + slack)


@dataclass(frozen=True)
class Quantity:
    """Declaration of one physical parameter, used inside ``Annotated[float, ...]``.

    ``unit`` is the SI unit of the value in memory, ``display`` the unit that people use for it,
    ``symbol`` that of the equations.
    """

    unit: str
    meaning: str
    symbol: str = ""
    gt: float | None = None
    ge: float | None = None
    le: float | None = None
    display: str = ""
    usual: tuple[float, float] | None = None
    """Between which magnitudes a value is expected; beyond it is allowed, and said to be
    unusual. Zero never is.
    """

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
        """Value in SI from text with a unit or an ``Si``, and from a bare number where the context
        says ``si``.
        """
        number = self._number(value, bool(info.context and info.context.get("si")))
        if not math.isfinite(number):
            raise self._error(value, f"is not finite; allowed is {self.allowed}")
        if abs(number) > LARGEST_MAGNITUDE:
            raise self._error(
                value, f"is too large; {LARGEST_MAGNITUDE:g} {self.unit} at most is expected"
            )
        if not self._allows(number):
            raise self._error(
                value, f"is not allowed; it must be {self.allowed}{self._other_form(value, number)}"
            )
        return number

    def _allows(self, number: float) -> bool:
        too_low = (self.gt is not None and number <= self.gt) or (
            self.ge is not None and number < self.ge
        )
        return not too_low and (self.le is None or number <= self.le)

    def _other_form(self, value: Any, number: float) -> str:
        """Suggestion where a fraction was taken for a percentage, or the reverse; empty otherwise."""
        if self.display != "percent":
            return ""
        as_percent = (
            isinstance(value, str) and plain_unit(value.lstrip("+-.0123456789eE ")) == "percent"
        )
        if as_percent:
            meant = 100.0 * number
        else:
            meant = 0.01 * number
        if self._allows(meant):
            return f"; perhaps {100.0 * meant:.6g} percent was meant"
        return ""

    def _hint(self, text: str) -> str:
        """Words on a probability in standard deviations; empty for anything else."""
        if self.display != "percent" or "sigma" not in text.lower():
            return ""
        return (
            "is no probability; write it such as '99.73 percent', 3 sigma of a normal distribution"
        )

    def _number(self, value: Any, in_si: bool) -> float:
        if isinstance(value, str):
            try:
                return convert(value, self.unit, self.display)
            except ValueError as error:
                raise self._error(value, self._hint(value) or str(error)) from error
        if isinstance(value, bool) or not isinstance(value, Real):
            raise self._error(value, _no_quantity(self.display or self.unit))
        try:
            number = float(value)
        except OverflowError:
            return math.inf
        stated = in_si or isinstance(value, Si)
        if self.unit and number != 0.0 and math.isfinite(number) and not stated:
            raise self._error(
                value, f"needs a unit, such as '{quoted_value(value)} {self.display or self.unit}'"
            )
        return number

    def _error(self, value: Any, problem: str) -> PydanticCustomError:
        from pydantic_core import PydanticCustomError

        # Braces would be taken for placeholders of the message template.
        return PydanticCustomError(
            "quantity", "{text}", {"text": f"{quoted_value(value)} {problem} ({self.meaning})"}
        )

    def format(self, value: float) -> str:
        """Text that reads back to the very same value: in the display unit where that is exact,
        else in SI.
        """
        for unit in (self.display, self.unit):
            if not unit:
                continue
            number = self._in(unit, value)
            for digits in (6, 9, 12, 15, 17):
                text = f"{number:.{digits}g} {unit}"
                if convert(text, self.unit) == value:
                    return text
        return repr(value)

    def show(self, value: float) -> str:
        """Short text for tables: six digits in the display unit."""
        unit = self.display or self.unit
        return f"{self._in(unit, value):.6g} {pretty(unit)}".strip()

    def span(self, low: float, high: float) -> str:
        """Range as one types it, six digits in the display unit: ``0.3:0.6 A``."""
        unit = self.display or self.unit
        return f"{self._in(unit, low):.6g}:{self._in(unit, high):.6g} {unit}".strip()

    def _in(self, unit: str, value: float) -> float:
        """A value in memory in another unit of its kind."""
        if unit == self.unit:
            return value
        return value * _factor(self.unit, self.unit, unit)

    def unusual(self, value: float) -> str:
        """Warning on a value that is allowed but of unusual size; else empty."""
        if self.usual is None or value == 0.0 or self.usual[0] <= abs(value) <= self.usual[1]:
            return ""
        low, high = map(self.show, self.usual)
        return f"{self.show(value)} is unusual; {low} to {high} is expected ({self.meaning})"

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        from pydantic_core import core_schema

        return core_schema.with_info_plain_validator_function(self.parse)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        result: dict[str, Any] = {
            "type": "string" if self.unit else ["string", "number"],
            "description": self.meaning,
        }
        result["x-unit"] = self.unit
        result["x-display-unit"] = self.display or self.unit
        if self.symbol:
            result["x-symbol"] = self.symbol
        bounds = {"exclusiveMinimum": self.gt, "minimum": self.ge, "maximum": self.le}
        result["x-range"] = {name: bound for name, bound in bounds.items() if bound is not None}
        return result


def pretty(unit: str) -> str:
    """A unit as print shows it: ``kg*m^2`` becomes ``kg m²``."""
    for plain, printed in _PRINTED.items():
        unit = unit.replace(plain, printed)
    return unit
