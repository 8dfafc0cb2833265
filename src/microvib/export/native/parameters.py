"""Parameters of an exported drive that can be set before it starts, and what the wrapper needs to
renew what hangs on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

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
        *_of_friction("motor.friction", "rotor", p, "m"),
        *_of_friction("friction", "output shaft", p, "l"),
    ]
    if not scenario.reducer.rigid:
        stiffness = "stiffness of the reducer at the output"
        found += [
            _of_drive("reducer.stiffness", "N*m/rad", stiffness, p.K_g, "K_g", positive=True),
            _of_drive("reducer.damping", "N*m*s/rad", "damping of the reducer", p.C_g, "C_g"),
        ]
    for k, mode in enumerate(scenario.array.modes):
        name, meaning = f"array.modes[{k + 1}].damping", f"damping ratio of mode {k + 1}"
        found.append(Parameter(name, "1", meaning, float(mode.damping), DAMPING, index=k))
    driver = scenario.driver
    if not (driver.distorted or driver.pulsed):
        meaning = "microsteps per full step"
        found.append(
            Parameter("driver.microsteps", "1", meaning, driver.microsteps, MICROSTEPS, lowest=1.0)
        )
    if scenario.tracking.rate is not None:
        meaning = "constant commanded rate of the array"
        rate = float(scenario.tracking.rate)
        found.append(Parameter("tracking.rate", "rad/s", meaning, rate, RATE, lowest=-math.inf))
    return found


def _of_drive(
    name: str, unit: str, meaning: str, value: float, field: str, *, positive: bool = False
) -> Parameter:
    return Parameter(name, unit, meaning, float(value), FIELD, positive=positive, field=field)


def _of_friction(key: str, body: str, p: object, letter: str) -> list[Parameter]:
    """Levels of the friction on a body: what slides, the excess at breakaway, what is viscous."""
    parts = (
        ("sliding_torque", "N*m", "sliding friction (Coulomb and slip ring)", "slide"),
        ("stribeck_torque", "N*m", "excess of breakaway over sliding friction", "stribeck"),
        ("viscous", "N*m*s/rad", "viscous friction", "viscous"),
    )
    return [
        _of_drive(
            f"{key}.{name}", unit, f"{meaning} on the {body}", getattr(p, f"{letter}_{end}"),
            f"{letter}_{end}",
        )
        for name, unit, meaning, end in parts
    ]  # fmt: skip


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


def packing_numbers(scenario: Scenario, packed: Packed) -> np.ndarray:
    """Numbers that the wrapper packs parameters with, as ``solve.pack`` does: sizes of currents and of their
    integrals over a microstep, full step, ratio, rate of the rotor, inertia of the output, most
    levels, shortest step over the fastest motion, and microsteps as exported."""
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
        ]
    )
