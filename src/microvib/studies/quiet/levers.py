"""Levers of a drive: what an engineer can change to make it quieter, as numbers that a search turns."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from microvib.errors import OptionError, ScenarioError
from microvib.model.driver import MAX_TABLE, Driver, quantized
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.units import Quantity, Si

Scale = Literal["linear", "logarithmic"]
TABLE_FIRST_ORDERS = (1, 2)
"""Cycles per electrical turn of what unequal phases do, besides those of the motor's own torques."""
MAX_CORRECTION = 0.1
"""Largest correction [rad] of the electrical angle for what unequal phases do, and least range for
others."""
COMPENSATION_KEY = "driver.compensation"
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
class TableLimits:
    """Size of a table of currents that a driver can hold."""

    bits: int | None = None
    rows: int = MAX_TABLE


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


def key_lever(
    scenario: Scenario, name: str, key: str, quantity: Quantity, low: float, high: float
) -> Lever:
    """A lever over one number of the scenario from ``low`` to ``high`` [SI]; over more than a factor
    of three on a logarithmic scale."""
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


def table_lever(scenario: Scenario, orders: Sequence[int], limits: TableLimits) -> Lever:
    """A table of the currents whose angle is corrected at some orders, cycles per electrical turn.

    With ``limits.bits`` its rows are whole numbers for a converter of so many bits. The correction that
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
        if rows > limits.rows:
            raise ScenarioError(f"driver.table: has {rows} rows; at most {limits.rows} are allowed")
        currents = table_rows(now.driver, harmonics(numbers), limits.bits)
        return {"driver.table": {"currents": currents.tolist()}}

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
    if limits.bits is not None:
        text += f", {limits.bits} bits"
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


def fixed(lever: Lever, mapping: Mapping[str, Any]) -> Iterator[str]:
    """Keys of a lever that a mapping of keys sets, too."""
    for key in lever.keys:
        for other in mapping:
            if key == other or key.startswith(f"{other}.") or other.startswith(f"{key}."):
                yield key
