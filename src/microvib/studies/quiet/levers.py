"""Levers of a drive: what an engineer can change to make it quieter, as numbers that a search turns."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from microvib.errors import OptionError, ScenarioError, did_you_mean
from microvib.model.driver import MAX_TABLE, Driver, quantized
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.units import Quantity, Si, convert

Scale = Literal["linear", "logarithmic"]
MAX_CHOICES = 16
"""Choices of a lever that has no numbers between them."""
TABLE_FIRST_ORDERS = (1, 2)
"""Cycles per electrical turn of what unequal phases do, besides those of the motor's own torques."""
MAX_CORRECTION = 0.1
"""Largest correction [rad] of the electrical angle for what unequal phases do, and least range for
others."""
COMPENSATION_KEY = "driver.compensation"
COMPENSATION_RANGE = 1.5
"""Times the gear's error up to which microsteps make up for it."""
DETENT_RANGE = 1.5
"""Times the correction that cancels a torque of the motor at standstill, up to which it is tried."""


@dataclass(frozen=True)
class Lever:
    """Something that is changed, by a few numbers between 0 and 1 or by one of some choices."""

    name: str
    text: str
    """Key or keys and range, in words."""
    keys: tuple[str, ...]
    """Keys of the scenario that it sets."""
    change: Callable[[Scenario, Sequence[float]], dict[str, Any]]
    """Changes of the scenario by the numbers, (dimensions,), or by the choice."""
    start: tuple[float, ...] = ()
    """Numbers of the scenario as it is; empty of a lever with choices."""
    guess: tuple[float, ...] = ()
    """Numbers that a closed form gives, from which a search begins, too."""
    choices: tuple[float, ...] = ()
    show: Callable[[Scenario, Sequence[float]], str] = lambda scenario, numbers: ""
    """A setting in words."""

    @property
    def dimensions(self) -> int:
        """How many numbers it has."""
        return len(self.start)


@dataclass(frozen=True)
class Setting:
    """One setting of all levers."""

    numbers: tuple[tuple[float, ...], ...]
    """Numbers of each lever between 0 and 1, or its choice."""


def with_levers(scenario: Scenario, levers: Sequence[Lever], setting: Setting) -> Scenario:
    """The scenario with all levers set; ScenarioError where that is not allowed."""
    for lever, numbers in zip(levers, setting.numbers, strict=True):
        changes = lever.change(scenario, numbers)
        if changes:
            scenario = scenario.with_si(changes)
    return scenario


# ---- Levers over keys of the scenario ----


def _on_range(low: float, high: float, scale: Scale) -> Callable[[float], float]:
    """The value at a part between 0 and 1 of a range."""
    if scale == "logarithmic":
        return lambda part: low * (high / low) ** part
    return lambda part: low + (high - low) * part


def _part_of_range(value: float, low: float, high: float, scale: Scale) -> float:
    """At which part of a range a value is; those outside are at its nearer end."""
    if scale == "logarithmic":
        part = math.log(max(value, 1e-300) / low) / math.log(high / low)
    else:
        part = (value - low) / (high - low)
    return min(max(part, 0.0), 1.0)


def key_lever(scenario: Scenario, name: str, key: str, low: float, high: float) -> Lever:
    """A lever over one number of the scenario from ``low`` to ``high`` [SI]; over more than a factor
    of three on a logarithmic scale."""
    quantity = _quantity(scenario, key)
    scale: Scale = "logarithmic" if low > 0.0 and high > 3.0 * low else "linear"
    at = _on_range(low, high, scale)
    now = scenario[key]
    start = _part_of_range(now if isinstance(now, float) else low, low, high, scale)

    def change(_: Scenario, numbers: Sequence[float]) -> dict[str, Any]:
        return {key: Si(at(numbers[0]))}

    def show(_: Scenario, numbers: Sequence[float]) -> str:
        return f"{key} {quantity.show(at(numbers[0]))}"

    text = f"{key} from {quantity.show(low)} to {quantity.show(high)}"
    return Lever(name, text, (key,), change, (start,), (start,), show=show)


def choice_lever(name: str, key: str, choices: Sequence[float], unit: str = "") -> Lever:
    """A lever over whole numbers or listed values of one key."""

    def value(choice: float) -> float | int:
        return int(choice) if not unit and float(choice).is_integer() else Si(choice)

    def change(_: Scenario, numbers: Sequence[float]) -> dict[str, Any]:
        return {key: value(numbers[0])}

    def show(scenario: Scenario, numbers: Sequence[float]) -> str:
        return f"{key} {scenario.shown(key, value(numbers[0]))}"

    listed = ", ".join(f"{each:g}" for each in choices)
    return Lever(
        name,
        f"{key}, one of {listed} {unit}".rstrip(),
        (key,),
        change,
        choices=tuple(choices),
        show=show,
    )


def gains_lever(scenario: Scenario, low: float, high: float) -> Lever:
    """One factor on the gains of the current loop."""
    keys = tuple(
        key for key in ("driver.proportional_gain", "driver.integral_gain") if scenario[key] > 0.0
    )
    if not keys:
        raise OptionError(
            "lever",
            f"needs a current loop with gains; driver.drive is {scenario.driver.drive}",
            "gains",
        )
    base = {key: scenario[key] for key in keys}
    at = _on_range(low, high, "logarithmic")
    start = _part_of_range(1.0, low, high, "logarithmic")

    def change(_: Scenario, numbers: Sequence[float]) -> dict[str, Any]:
        return {key: Si(at(numbers[0]) * value) for key, value in base.items()}

    def show(_: Scenario, numbers: Sequence[float]) -> str:
        return f"gains of the current loop times {at(numbers[0]):.3g}"

    text = f"gains of the current loop, times {low:g} to {high:g}"
    return Lever("gains", text, keys, change, (start,), (start,), show=show)


# ---- Times of the microsteps ----


def shape_lever(scenario: Scenario, low: float, high: float) -> Lever:
    """Microsteps in two halves, the second ``low`` to ``high`` [s] after the first: half a period of
    a resonance takes its lines away (ZV).
    """
    at = _on_range(low, high, "linear")

    def change(_: Scenario, numbers: Sequence[float]) -> dict[str, Any]:
        halves = [{"fraction": 0.5}, {"fraction": 0.5, "after": Si(at(numbers[0]))}]
        return {"driver.microstep_shape": halves}

    def show(_: Scenario, numbers: Sequence[float]) -> str:
        return f"microsteps in two halves, {1e3 * at(numbers[0]):.3g} ms apart"

    text = f"microsteps in two halves, {1e3 * low:g} to {1e3 * high:g} ms apart"
    guess = _part_of_range(_half_period(scenario), low, high, "linear")
    return Lever("shape", text, ("driver.microstep_shape",), change, (guess,), (guess,), show=show)


def _half_period(scenario: Scenario) -> float:
    """Half a period [s] of the resonance that the microsteps are next to."""
    frequencies = [mode.frequency for mode in coupled_modes(scenario)]
    wanted = scenario.driving_frequency or 0.0
    nearest = min(frequencies, key=lambda f: abs(f - wanted), default=wanted)
    return 0.5 / nearest


def compensation_lever(scenario: Scenario, bound: float) -> Lever:
    """Microsteps that come earlier or later to make up for the gear's error, at its orders: an
    amplitude up to ``bound`` times the error's and any phase.
    """
    errors = [e for e in scenario.reducer.errors if e.amplitude > 0.0]
    if not errors or any(float(e.order) % 1.0 for e in errors):
        raise OptionError(
            "lever",
            "needs a gear's error of whole orders per turn of the rotor"
            " (reducer.transmission_error)",
            "compensation",
        )

    def harmonics(numbers: Sequence[float]) -> list[tuple[int, complex]]:
        pairs = 2.0 * np.asarray(numbers, dtype=float).reshape(-1, 2) - 1.0
        return [
            (int(e.order), bound * e.amplitude * complex(*pair))
            for e, pair in zip(errors, pairs, strict=True)
        ]

    def change(_: Scenario, numbers: Sequence[float]) -> dict[str, Any]:
        parts = [
            {"order": order, "amplitude": Si(abs(z)), "phase": Si(float(np.angle(z)))}
            for order, z in harmonics(numbers)
        ]
        return {COMPENSATION_KEY: parts}

    def show(_: Scenario, numbers: Sequence[float]) -> str:
        parts = (
            f"{math.degrees(abs(z)) * 3600.0:.3g} arcsec at order {order}, phase"
            f" {math.degrees(np.angle(z)):.0f} deg"
            for order, z in harmonics(numbers)
        )
        return f"microsteps make up for the gear's error by {' and '.join(parts)}"

    guess = [x for e in errors for x in _as_numbers(cmath.rect(1.0 / bound, e.phase))]
    centre = (0.5,) * len(guess)
    orders = ", ".join(str(int(e.order)) for e in errors)
    text = f"microsteps that make up for the gear's error, orders {orders} per turn of the rotor"
    return Lever("compensation", text, (COMPENSATION_KEY,), change, centre, tuple(guess), show=show)


def _as_numbers(z: complex) -> tuple[float, float]:
    """Numbers between 0 and 1 of a complex amplitude within the unit circle."""
    return 0.5 + 0.5 * z.real, 0.5 + 0.5 * z.imag


# ---- Table of the currents ----


def table_lever(
    scenario: Scenario, orders: Sequence[int], bits: int | None = None, most_rows: int = MAX_TABLE
) -> Lever:
    """A table of the currents whose angle is corrected at some orders, cycles per electrical turn.

    With ``bits`` its rows are whole numbers for a converter of so many bits. The correction that
    cancels a torque T of the motor at standstill is arcsin(T/(K_m I)).
    """
    sizes = tuple(_correction_range(scenario, order) for order in orders)
    own = scenario.motor.torque_orders
    full = scenario.motor.axis_torque_constant * scenario.motor.axis_current

    def harmonics(numbers: Sequence[float]) -> list[tuple[int, complex]]:
        parts = np.asarray(numbers, dtype=float).reshape(-1, 2)
        return [
            (order, size * complex(*(2.0 * pair - 1.0)))
            for order, size, pair in zip(orders, sizes, parts, strict=True)
        ]

    def change(now: Scenario, numbers: Sequence[float]) -> dict[str, Any]:
        rows = now.driver.beats * now.driver.microsteps
        if rows > most_rows:
            raise ScenarioError(f"driver.table: has {rows} rows; at most {most_rows} are allowed")
        return {
            "driver.table": {"currents": table_rows(now.driver, harmonics(numbers), bits).tolist()}
        }

    def show(_: Scenario, numbers: Sequence[float]) -> str:
        parts = (
            f"{math.degrees(abs(z)):.3g} deg at order {order}, phase {math.degrees(np.angle(z)):.0f} deg"
            for order, z in harmonics(numbers)
            if abs(z) > 1e-6
        )
        return f"table of the currents, angle corrected by {' and '.join(parts) or 'nothing'}"

    centre = (0.5,) * (2 * len(orders))
    guess = list(centre)
    for k, order in enumerate(orders):
        if own.get(order):
            guess[2 * k] = 0.5 + 0.5 * math.asin(min(own[order] / full, 1.0)) / sizes[k]
    text = f"table of the currents, angle corrected at {', '.join(map(str, orders))} cycles per electrical turn"
    if bits is not None:
        text += f", {bits} bits"
    return Lever("table", text, ("driver.table",), change, centre, tuple(guess), show=show)


def table_rows(
    driver: Driver, harmonics: Sequence[tuple[int, complex]], bits: int | None = None
) -> np.ndarray:
    """Currents over I after each microstep of an electrical turn, (b n, 2): cosine and sine of the
    angle theta_e + sum Im(z exp(i order theta_e)); rounded to what ``bits`` can hold.
    """
    theta_e = driver.electrical_angle(np.arange(driver.beats * driver.microsteps))
    angle = theta_e.copy()
    for order, z in harmonics:
        angle += (z * np.exp(1j * order * theta_e)).imag
    rows = np.column_stack([np.cos(angle), np.sin(angle)])
    if bits is None:
        return rows
    return quantized(rows, levels_of(bits))


def levels_of(bits: int) -> int:
    """Largest whole number of a signed converter with so many bits."""
    levels: int = 2 ** (bits - 1) - 1
    return levels


def _correction_range(scenario: Scenario, order: int) -> float:
    """Largest correction [rad] that is tried at an order."""
    motor = scenario.motor
    full = motor.axis_torque_constant * motor.axis_current
    own = motor.torque_orders.get(order, 0.0)
    if not own:
        return MAX_CORRECTION
    return DETENT_RANGE * math.asin(min(own / full, 1.0))


def table_orders(scenario: Scenario) -> tuple[int, ...]:
    """Orders at which a table is worth correcting: those of the motor's torques, and where phases are
    unlike each other those of that.
    """
    own = tuple(scenario.motor.torque_orders)
    errors = scenario.driver.imperfections
    unlike = errors.gain_b or errors.offset_a or errors.offset_b or errors.quadrature
    return tuple(dict.fromkeys((*own, *(TABLE_FIRST_ORDERS if unlike else ()))))


# ---- What is written ----

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


@dataclass(frozen=True)
class TableLimits:
    """Size of a table that a driver can hold."""

    bits: int | None = None
    rows: int = MAX_TABLE


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
    levers = [_parsed(text.strip(), scenario, limits) for text in given]
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
        if name == "table":
            return _named_table(scenario)
        if name == "gains":
            gains_lever(scenario, *_factors(name, _USUAL_FACTORS))
            return NamedLever(name, _USUAL_FACTORS, _GAINS, "0.5:2")
        if name == "shape":
            span = _BETWEEN_HALVES.span(*_times(name, "", scenario))
            return NamedLever(name, span, _BETWEEN_HALVES.meaning, "LOW:HIGH ms")
        if name == "compensation":
            compensation_lever(scenario, COMPENSATION_RANGE)
            return NamedLever(name, f"{COMPENSATION_RANGE:g}", _COMPENSATION, "1.5")
        if name == "microsteps":
            counts = _usual_counts(scenario)
            return NamedLever(name, counts, "microsteps per full step", "16,32")
        key = _key_of(name, scenario)
    except OptionError:
        return None
    quantity = _quantity(scenario, key)
    unit = quantity.display or quantity.unit
    span = _usual_span(name, key, scenario)
    return NamedLever(name, span, quantity.meaning, f"LOW:HIGH {unit}".rstrip())


_GAINS = "factor on the gains of the current loop"
_COMPENSATION = "times the gear's error that microsteps make up for, at most"
_BETWEEN_HALVES = Quantity("s", "time between the halves of a microstep", display="ms")


def _named_table(scenario: Scenario) -> NamedLever:
    orders = ",".join(map(str, table_orders(scenario)))
    _table(orders or "1", scenario, TableLimits())
    return NamedLever(
        "table", orders, "orders at which the angle of the currents is corrected", "4,8"
    )


def _usual_span(name: str, key: str, scenario: Scenario) -> str:
    """The usual range of a key as one writes it; empty where there is none."""
    try:
        low, high = _usual_range(name, key, scenario)
    except OptionError:
        return ""
    return _quantity(scenario, key).span(low, high)


_USUAL_FACTORS = "0.05:2"
_USUALLY_BEST = {"ramp": (1.0,), "damping": (1.0,)}
"""Ends of ranges at which named levers usually are best."""


def _parsed(text: str, scenario: Scenario, limits: TableLimits) -> Lever:
    name, equals, span = (part.strip() for part in text.partition("="))
    if name == "table":
        return _table(span, scenario, limits)
    if name == "gains":
        low, high = _factors(text, span or _USUAL_FACTORS)
        return gains_lever(scenario, low, high)
    if name == "shape":
        low, high = _times(text, span, scenario)
        return shape_lever(scenario, low, high)
    if name == "compensation":
        return compensation_lever(scenario, _bound(text, span))
    if name == "microsteps":
        counts = span or _usual_counts(scenario)
        return choice_lever(name, "driver.microsteps", _whole_numbers(text, counts))
    key = _key_of(name, scenario)
    if not span:
        if equals or name not in NAMED:
            raise OptionError("lever", f"wants a range, such as {_example(scenario, key)}", text)
        low, high = _usual_range(name, key, scenario)
        lever = key_lever(scenario, name, key, low, high)
        return replace(lever, guess=_USUALLY_BEST.get(name, lever.start))
    quantity = _quantity(scenario, key)
    if ":" in span:
        low, high = _range(text, span, quantity)
        return key_lever(scenario, name, key, low, high)
    values = [_number(text, part, quantity) for part in _with_unit(span.split(","))]
    return choice_lever(name, key, values, quantity.unit or " ")


def _table(span: str, scenario: Scenario, limits: TableLimits) -> Lever:
    if span:
        orders = tuple(_whole_numbers(f"table={span}", span))
    else:
        orders = table_orders(scenario)
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
    return table_lever(scenario, orders, limits.bits, limits.rows)


def _key_of(name: str, scenario: Scenario) -> str:
    keys = {
        "ramp": "driver.microstep_ramp",
        "rate": "tracking.rate",
        "current": "motor.current",
        "damping": "reducer.damping",
        "wings": "spacecraft.second_wing.stagger",
    }
    key = keys.get(name, name)
    numbers = _numbers(scenario)
    if key not in numbers:
        if key in keys.values():
            raise OptionError("lever", f"needs {key}, which this scenario has not", name)
        near = did_you_mean(name, [*NAMED, *numbers])
        raise OptionError(
            "lever",
            f"is none; {near}allowed are {', '.join(NAMED)}, and every number of the scenario, such"
            " as reducer.damping=0.5:5 N*m*s/rad",
            name,
        )
    return key


def _usual_range(name: str, key: str, scenario: Scenario) -> tuple[float, float]:
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


def _usual_counts(scenario: Scenario) -> str:
    own = scenario.driver.microsteps
    return ",".join(str(own * factor) for factor in (1, 2, 4))


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


def _quantity(scenario: Scenario, key: str) -> Quantity:
    return _numbers(scenario)[key]


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


def _times(text: str, span: str, scenario: Scenario) -> tuple[float, float]:
    """Times [s] between the halves of a microstep: those that are given, or most of its period."""
    if span:
        low, high = _range(text, span, _BETWEEN_HALVES)
    else:
        period = 1.0 / (scenario.driving_frequency or math.nan)
        low, high = 0.05 * period, 0.95 * period
    if not low > 0.0:
        raise OptionError("lever", "times above 0 s are expected", text)
    return low, high


def _bound(text: str, span: str) -> float:
    """Times the gear's error up to which it is made up for."""
    if not span:
        return COMPENSATION_RANGE
    bound = _number(text, span, Quantity("", _COMPENSATION))
    if not bound > 0.0:
        raise OptionError("lever", "a factor above 0 is expected", text)
    return bound


def _factors(text: str, span: str) -> tuple[float, float]:
    low, high = _range(text, span, Quantity("", "factor on the gains"))
    if not low > 0.0:
        raise OptionError("lever", "factors above 0 are expected", text)
    return low, high


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


def _example(scenario: Scenario, key: str) -> str:
    value = scenario[key]
    quantity = _quantity(scenario, key)
    if isinstance(value, float) and value:
        low, high = sorted((0.5 * value, 2.0 * value))
        return f"{key}={quantity.show(low)}:{quantity.show(high)}"
    return f"{key}=LOW:HIGH with a unit ({quantity.unit or 'none'})"


def fixed(lever: Lever, mapping: Mapping[str, Any]) -> Iterator[str]:
    """Keys of a lever that a mapping of keys sets, too."""
    for key in lever.keys:
        for other in mapping:
            if key == other or key.startswith(f"{other}.") or other.startswith(f"{key}."):
                yield key
