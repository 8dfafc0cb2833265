"""Parameters of an exported drive that can be set before it starts, and what the wrapper needs to
renew what hangs on them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from microvib.model.friction import Friction
from microvib.model.part import Part
from microvib.model.scenario import Scenario
from microvib.solve import propagators
from microvib.solve.pack import Packed, rotor_rate_of, shortest_ratio

FIELD, DAMPING, MICROSTEPS, RATE = range(4)
"""Kinds of parameters: a number of the drive, a mode's damping, microsteps per full step, the rate."""
SPARE_LEVELS = 6
"""Lengths of steps more than the drive has as exported: stiffer reducers ask for shorter ones."""


@dataclass(frozen=True)
class Parameter:
    """A parameter that can be set: its name, by the scenario's key where that has the same meaning."""

    name: str
    unit: str
    meaning: str
    value: float
    kind: int
    lowest: float = 0.0
    """The lowest value allowed; itself not, if it is 0 and the parameter cannot vanish."""
    highest: float = math.inf
    positive: bool = False
    field: str = ""
    """Field of ``kernel.Drive``."""
    index: int = 0
    """Which mode."""


def parameters_of(scenario: Scenario, packed: Packed) -> list[Parameter]:
    """Parameters of a scenario's drive that can be set."""
    p = packed.drive
    found = [
        _of_drive("motor.detent_torque", "N*m", "amplitude of the detent torque", p.K_d, "K_d"),
        *_of_friction("motor.friction", "rotor", scenario.motor.friction, p, "m"),
        *_of_friction("friction", "output shaft", scenario.friction, p, "l"),
    ]
    if not scenario.reducer.rigid:
        if scenario.reducer.hysteresis is None:  # its torque hangs on the stiffness, too
            meaning = "stiffness of the reducer at the output"
            found.append(
                _of_drive("reducer.stiffness", "N*m/rad", meaning, p.K_g, "K_g", positive=True)
            )
        meaning = "damping of the reducer"
        found.append(_of_drive("reducer.damping", "N*m*s/rad", meaning, p.C_g, "C_g"))
    for k, mode in enumerate(scenario.array.modes):
        name, meaning = f"array.modes[{k + 1}].damping", f"damping ratio of mode {k + 1}"
        value, highest = float(mode.damping), _highest(mode, "damping")
        found.append(Parameter(name, "1", meaning, value, DAMPING, highest=highest, index=k))
    driver = scenario.driver
    if not (driver.distorted or driver.pulsed):
        meaning = "microsteps per full step"
        highest = _highest(driver, "microsteps")
        found.append(
            Parameter(
                "driver.microsteps", "1", meaning, driver.microsteps, MICROSTEPS, 1.0, highest
            )
        )
    if scenario.tracking.rate is not None:
        meaning = "constant commanded rate of the array"
        rate = float(scenario.tracking.rate)
        found.append(Parameter("tracking.rate", "rad/s", meaning, rate, RATE, lowest=-math.inf))
    return found


def _highest(part: Part, key: str) -> float:
    """The highest value that the declaration of a key allows."""
    quantity = part.quantity_of(key)
    if quantity is not None:
        return math.inf if quantity.le is None else quantity.le
    bounds = (getattr(limit, "le", None) for limit in type(part).model_fields[key].metadata)
    return float(next((bound for bound in bounds if bound is not None), math.inf))


def _of_drive(
    name: str, unit: str, meaning: str, value: float, field: str, *, positive: bool = False
) -> Parameter:
    return Parameter(name, unit, meaning, float(value), FIELD, positive=positive, field=field)


def _of_friction(
    key: str, body: str, friction: Friction, p: Any, letter: str
) -> Iterator[Parameter]:
    """Levels of the friction on a body: what slides, the excess at breakaway, what is viscous. Those at
    rest are fixed where presliding is measured against them, by an angle or a loop.
    """
    parts = (
        ("sliding_torque", "N*m", "sliding friction (Coulomb and slip ring)", "slide"),
        ("stribeck_torque", "N*m", "excess of breakaway over sliding friction", "stribeck"),
        ("viscous", "N*m*s/rad", "viscous friction", "viscous"),
    )
    measured = friction.presliding is not None and (
        friction.presliding.breakaway_angle is not None or friction.presliding.loop
    )
    for name, unit, meaning, end in parts:
        if measured and name != "viscous":
            continue
        field = f"{letter}_{end}"
        yield _of_drive(f"{key}.{name}", unit, f"{meaning} on the {body}", getattr(p, field), field)


def with_spare_levels(t: Any, modes: int) -> Any:
    """Tables with room for shorter steps."""
    levels = min(t.levels + SPARE_LEVELS, propagators.MOST_LEVELS)
    sizes = {
        "nodes": propagators.PATTERNS * levels * propagators.NODE_ROWS,
        "pieces": propagators.PATTERNS * levels * propagators.PIECE_ROWS,
        "modes": levels * modes * propagators.MODE_ROWS,
        "sums": levels * propagators.SUM_ROWS,
    }
    return t._replace(**{name: np.zeros((rows, 4)) for name, rows in sizes.items()})


def packing_numbers(scenario: Scenario, packed: Packed, microsteps_per_angle: float) -> np.ndarray:
    """Numbers that the wrapper packs parameters with, as ``solve.pack`` does: sizes of currents and of their
    integrals over a microstep, full step, ratio, rate of the rotor, inertia of the output, most
    levels, shortest step over the fastest motion, and as exported microsteps per full step, per electrical
    turn and per angle of the array."""
    t, sizes, driver = packed.propagators, packed.sizes, scenario.driver
    levels = min(t.levels + SPARE_LEVELS, propagators.MOST_LEVELS)
    return np.array(
        [
            sizes[0],
            sizes[2],
            driver.full_step(scenario.motor),
            scenario.reducer.ratio,
            rotor_rate_of(scenario),
            scenario.output_inertia,
            levels,
            shortest_ratio(packed.drive, t.accuracy),
            driver.microsteps,
            driver.beats * driver.microsteps,
            microsteps_per_angle,
        ]
    )
