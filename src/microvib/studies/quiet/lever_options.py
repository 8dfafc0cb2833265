"""Levers as one writes them: names with usual ranges, keys with ranges, and lists of choices."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from microvib.errors import OptionError, did_you_mean
from microvib.model.scenario import Scenario
from microvib.studies.quiet.levers import (
    Lever,
    TableLimits,
    choice_lever,
    compensation_lever,
    gains_lever,
    key_lever,
    shape_lever,
    table_lever,
    table_orders,
)
from microvib.units import Quantity, convert

MAX_CHOICES = 16
"""Choices of a lever that has no numbers between them."""
USUAL_FACTORS = "0.05:2"
"""Factors on the gains of the current loop that are tried."""
USUAL_COMPENSATION = 1.5
"""Times the gear's error up to which microsteps make up for it."""
KEYS = {
    "ramp": "driver.microstep_ramp",
    "rate": "tracking.rate",
    "current": "motor.current",
    "damping": "reducer.damping",
    "wings": "spacecraft.second_wing.stagger",
}
"""Named levers over one number of the scenario, and its key."""
USUALLY_BEST = {"ramp": (1.0,), "damping": (1.0,)}
"""Ends of usual ranges at which named levers usually are best."""


def parse_levers(
    given: Sequence[str], scenario: Scenario, limits: TableLimits | None = None
) -> tuple[Lever, ...]:
    """Read levers, in the order in which they act: tables last, whose rows depend on microsteps.

    Parameters
    ----------
    given : sequence of str
        Names of ``NAMED`` with their usual ranges, or with one: ``"current=0.3:0.6 A"``,
        ``"microsteps=16,32"``, ``"table=4,8"`` (orders); or any key of the scenario that is a number,
        with a range or a list.
    scenario : Scenario
        The drive.
    limits : TableLimits, optional
        Bits and rows of the driver's table.

    Raises
    ------
    OptionError
        For a lever that there is not, a range that is none, and none or two over one key.
    """
    if not given:
        raise OptionError("lever", f"is missing; allowed are {', '.join(NAMED)}, or KEY=LOW:HIGH")
    limits = limits or TableLimits()
    levers = [_parse_lever(text.strip(), scenario, limits) for text in given]
    keys = [key for lever in levers for key in lever.keys]
    for key in keys:
        if keys.count(key) > 1:
            raise OptionError("lever", f"{key} is set by two levers; one is expected")
    names = [lever.name for lever in levers]
    if "ramp" in names and "shape" in names:
        raise OptionError(
            "lever", "shape and ramp are two ways to make a microstep; one is expected"
        )
    return tuple(sorted(levers, key=lambda lever: lever.name == "table"))


def _parse_lever(text: str, scenario: Scenario, limits: TableLimits) -> Lever:
    name, equals, span = (part.strip() for part in text.partition("="))
    if name in SPECIAL:
        return SPECIAL[name].read(span, scenario, limits)
    if equals and not span:
        raise OptionError("lever", f"wants a range, such as {_example(scenario, name)}", text)
    return _read_key(name, span, scenario)


# ---- Levers over one number of the scenario ----


def _read_key(name: str, span: str, scenario: Scenario) -> Lever:
    key = _key_of(name, scenario)
    quantity = _numbers(scenario)[key]
    text = f"{name}={span}"
    if not span:
        low, high = _usual_range(name, key, scenario)
        lever = key_lever(scenario, name, key, quantity, low, high)
        return replace(lever, guess=USUALLY_BEST.get(name, lever.start))
    if ":" in span:
        low, high = _range(text, span, quantity)
        return key_lever(scenario, name, key, quantity, low, high)
    values = [_number(text, part, quantity) for part in _with_unit(span.split(","))]
    return choice_lever(name, key, values, quantity.unit or " ")


def _key_of(name: str, scenario: Scenario) -> str:
    """The key that a name, or a key, sets."""
    key = KEYS.get(name, name)
    numbers = _numbers(scenario)
    if key in numbers:
        return key
    if key in KEYS.values():
        raise OptionError("lever", f"needs {key}, which this scenario has not", name)
    near = did_you_mean(name, [*NAMED, *numbers])
    raise OptionError(
        "lever",
        f"is none; {near}allowed are {', '.join(NAMED)}, and every number of the scenario, such"
        " as reducer.damping=0.5:5 N*m*s/rad",
        name,
    )


def _usual_range(name: str, key: str, scenario: Scenario) -> tuple[float, float]:
    """The range [SI] of a named lever that is tried where none is given."""
    if name not in KEYS:
        raise OptionError("lever", f"wants a range, such as {_example(scenario, key)}", name)
    value = scenario[key]
    ranges = {
        "ramp": (0.0, 1.0),
        "rate": tuple(sorted((0.9 * value, 1.1 * value))),
        "current": (0.4 * value, value),
        "damping": (value, 10.0 * value),
        "wings": (0.0, 1.0),
    }
    low, high = ranges[name]
    if not low < high:
        raise OptionError(
            "lever", f"wants a range, since {key} is {value:g}; write {name}=LOW:HIGH", name
        )
    return low, high


def _numbers(scenario: Scenario) -> dict[str, Quantity]:
    """Numbers of the scenario that a lever may set, by their keys; those that are not given yet are
    among them."""
    return {
        key: quantity
        for key, value, quantity in scenario.entries()
        if quantity is not None
        and not key.startswith(("record.", "solver."))
        and (value is None or isinstance(value, float))
    }


def _example(scenario: Scenario, name: str) -> str:
    key = _key_of(name, scenario)
    value = scenario[key]
    quantity = _numbers(scenario)[key]
    if isinstance(value, float) and value:
        low, high = sorted((0.5 * value, 2.0 * value))
        return f"{name}={quantity.show(low)}:{quantity.show(high)}"
    return f"{name}=LOW:HIGH with a unit ({quantity.unit or 'none'})"


# ---- Levers that are more than one number of the scenario ----


@dataclass(frozen=True)
class SpecialLever:
    """How a named lever is written that is more than one number of the scenario."""

    meaning: str
    example: str
    """Form of what may stand in place of the usual range."""
    usual: Callable[[Scenario], str]
    """Its usual range, list or orders as one writes them."""
    read: Callable[[str, Scenario, TableLimits], Lever]
    """The lever of what is written, or of nothing; OptionError where the scenario cannot have it."""


_HALVES = Quantity("s", "time between the halves of a microstep", display="ms")
_GAINS = Quantity("", "factor on the gains of the current loop")
_COMPENSATION = Quantity("", "times the gear's error that microsteps make up for, at most")


def _usual_orders(scenario: Scenario) -> str:
    return ",".join(map(str, table_orders(scenario)))


def _read_table(span: str, scenario: Scenario, limits: TableLimits) -> Lever:
    orders = _whole_numbers(f"table={span}", span) if span else table_orders(scenario)
    if not orders:
        raise OptionError(
            "lever",
            "has nothing to correct: the motor has neither detent torque nor flux harmonics, and its"
            " phases are equal; give orders, such as table=4",
            "table",
        )
    if scenario.driver.drive != "current":
        raise OptionError(
            "lever", f"needs a driver of currents; driver.drive is {scenario.driver.drive}", "table"
        )
    return table_lever(scenario, orders, limits)


def _read_gains(span: str, scenario: Scenario, _: TableLimits) -> Lever:
    text = f"gains={span}"
    low, high = _range(text, span or USUAL_FACTORS, _GAINS)
    if not low > 0.0:
        raise OptionError("lever", "factors above 0 are expected", text)
    return gains_lever(scenario, low, high)


def _usual_times(scenario: Scenario) -> tuple[float, float]:
    """Times [s] between the halves of a microstep: most of its period."""
    period = 1.0 / (scenario.driving_frequency or math.nan)
    return 0.05 * period, 0.95 * period


def _read_shape(span: str, scenario: Scenario, _: TableLimits) -> Lever:
    text = f"shape={span}"
    low, high = _range(text, span, _HALVES) if span else _usual_times(scenario)
    if not low > 0.0:
        raise OptionError("lever", "times above 0 s are expected", text)
    return shape_lever(scenario, low, high)


def _read_compensation(span: str, scenario: Scenario, _: TableLimits) -> Lever:
    text = f"compensation={span}"
    bound = _number(text, span, _COMPENSATION) if span else USUAL_COMPENSATION
    if not bound > 0.0:
        raise OptionError("lever", "a factor above 0 is expected", text)
    return compensation_lever(scenario, bound)


def _usual_counts(scenario: Scenario) -> str:
    own = scenario.driver.microsteps
    return ",".join(str(own * factor) for factor in (1, 2, 4))


def _read_microsteps(span: str, scenario: Scenario, _: TableLimits) -> Lever:
    counts = _whole_numbers(f"microsteps={span}", span or _usual_counts(scenario))
    return choice_lever("microsteps", "driver.microsteps", counts)


SPECIAL = {
    "shape": SpecialLever(
        _HALVES.meaning,
        "LOW:HIGH ms",
        lambda scenario: _HALVES.span(*_usual_times(scenario)),
        _read_shape,
    ),
    "table": SpecialLever(
        "orders at which the angle of the currents is corrected",
        "4,8",
        _usual_orders,
        _read_table,
    ),
    "microsteps": SpecialLever(
        "microsteps per full step", "16,32", _usual_counts, _read_microsteps
    ),
    "compensation": SpecialLever(
        _COMPENSATION.meaning, "1.5", lambda _: f"{USUAL_COMPENSATION:g}", _read_compensation
    ),
    "gains": SpecialLever(_GAINS.meaning, "0.5:2", lambda _: USUAL_FACTORS, _read_gains),
}
NAMED = (
    "ramp",
    "shape",
    "table",
    "microsteps",
    "rate",
    "compensation",
    "current",
    "gains",
    "damping",
    "wings",
)
"""Levers that have a name; any number of the scenario is one, too."""


# ---- Named levers, as a form shows them ----


@dataclass(frozen=True)
class NamedLever:
    """A named lever that a scenario can have."""

    name: str
    span: str
    """Its usual range, list or orders as one writes them; empty where there is none."""
    meaning: str
    example: str
    """Form of what may stand in place of the usual range."""


def named_levers(scenario: Scenario) -> tuple[NamedLever, ...]:
    """The named levers that a scenario can have, with their usual ranges as one writes them."""
    return tuple(lever for name in NAMED if (lever := _named(name, scenario)) is not None)


def _named(name: str, scenario: Scenario) -> NamedLever | None:
    try:
        return _named_special(name, scenario) if name in SPECIAL else _named_key(name, scenario)
    except OptionError:
        return None


def _named_special(name: str, scenario: Scenario) -> NamedLever:
    special = SPECIAL[name]
    span = special.usual(scenario)
    # A table that has nothing to correct by itself can be given orders.
    special.read(span or special.example, scenario, TableLimits())
    return NamedLever(name, span, special.meaning, special.example)


def _named_key(name: str, scenario: Scenario) -> NamedLever:
    key = _key_of(name, scenario)
    quantity = _numbers(scenario)[key]
    try:
        span = quantity.span(*_usual_range(name, key, scenario))
    except OptionError:
        span = ""
    example = f"LOW:HIGH {quantity.display or quantity.unit}".rstrip()
    return NamedLever(name, span, quantity.meaning, example)


# ---- Ranges and lists ----


def _range(text: str, span: str, quantity: Quantity) -> tuple[float, float]:
    ends = _with_unit(span.split(":"))
    if len(ends) != 2:
        raise OptionError("lever", "is no range; LOW:HIGH is expected", text)
    low, high = (_number(text, end, quantity) for end in ends)
    if not low < high:
        raise OptionError("lever", "LOW must be below HIGH", text)
    return low, high


def _with_unit(parts: Sequence[str]) -> list[str]:
    """Quantities of which the last may carry the unit of all."""
    unit = parts[-1].strip().lstrip("+-.0123456789eE ")
    return [
        part.strip()
        if any(c.isalpha() for c in part.strip("eE"))
        else f"{part.strip()} {unit}".strip()
        for part in parts
    ]


def _number(text: str, part: str, quantity: Quantity) -> float:
    try:
        return convert(part, quantity.unit)
    except ValueError as error:
        raise OptionError("lever", f"{error} ({quantity.meaning})", text) from None


def _whole_numbers(text: str, span: str) -> list[int]:
    try:
        numbers = list(dict.fromkeys(int(part) for part in span.split(",")))
    except ValueError:
        numbers = [0]
    if min(numbers) < 1 or len(numbers) > MAX_CHOICES:
        raise OptionError(
            "lever",
            f"whole numbers from 1 on, {MAX_CHOICES} at most, are expected, such as 16,32",
            text,
        )
    return numbers
