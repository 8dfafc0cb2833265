"""Orders of a drive: what its motor, driver and gears repeat per turn of the output, known before
anything is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from microvib.model.gear_train import train_orders
from microvib.model.harmonics import sequence
from microvib.model.line_names import driving_line, electrical_line, full_step_line
from microvib.model.linear import CoupledMode, coupled_modes
from microvib.model.motor import Motor
from microvib.model.scenario import Scenario

RESONANCE_PROXIMITY = 0.05
"""Part of a mode's frequency within which an order is near it."""


@dataclass(frozen=True)
class DriveOrder:
    """Something that a drive repeats; lines stand at its frequency where it makes a torque."""

    name: str
    words: str
    """Description, and how it is computed."""
    per_turn: float
    """Cycles per turn of the output."""
    frequency: float
    """At the scenario's rate [Hz]; nan where that changes."""
    near: tuple[str, ...]
    """Array modes that it is near."""


def drive_orders(scenario: Scenario) -> tuple[DriveOrder, ...]:
    """Orders of motor, driver and gears, the train's stage by stage.

    Microsteps, full steps, detent torque, flux harmonics, electrical periods and turns of the rotor
    with their first harmonics; of a harmonic reducer two per turn, where its kinematic error usually stands,
    and the orders of ``transmission_error``; of a train all of its stages' orders and their
    ``errors``. Near are modes through the drive or clamped, within NEAR.
    """
    rate = scenario.rate
    if rate is None:
        per_second = math.nan
    else:
        per_second = abs(rate) / (2.0 * math.pi)
    modes = [mode for mode in coupled_modes(scenario) if mode.fixed_frequency is not None]
    rows: dict[str, DriveOrder] = {}
    for name, words, cycles in _enumerate_orders(scenario):
        per_turn = float(cycles) * scenario.reducer.ratio
        near = tuple(mode.name for mode in modes if _is_near(per_turn * per_second, mode))
        rows.setdefault(name, DriveOrder(name, words, per_turn, per_turn * per_second, near))
    return tuple(rows.values())


def _is_near(frequency: float, mode: CoupledMode) -> bool:
    return any(
        abs(frequency - f) <= RESONANCE_PROXIMITY * f
        for f in (mode.frequency, mode.fixed_frequency or mode.frequency)
    )


def _enumerate_orders(scenario: Scenario) -> Iterator[tuple[str, str, Fraction | int]]:
    """Name, words and cycles per turn of the rotor."""
    driver, motor, reducer = scenario.driver, scenario.motor, scenario.reducer
    z, b, n = motor.rotor_teeth, driver.beats, driver.microsteps
    for k in (1, 2, 3):
        yield (
            driving_line(k),
            f"{_multiple_prefix(k)}microsteps: {b} beats x {n} microsteps x {z} teeth x turns of"
            " the rotor",
            k * b * n * z,
        )
    for k in (1, 2):
        words = (
            f"{_multiple_prefix(k)}full steps: {motor.full_steps} x {z} teeth x turns of the rotor"
        )
        yield full_step_line(k), words, k * motor.full_steps * z
    detent = motor.detent_periods
    yield "detent", f"detent torque: {detent} x {z} teeth x turns of the rotor", detent * z
    for h in motor.detent:
        words = f"detent torque, harmonic: {h.order} x {z} teeth x turns of the rotor"
        yield f"detent {h.order}", words, h.order * z
    for flux in motor.flux_harmonics:
        yield from _flux_order(motor, flux.order)
    for k in (1, 2):
        yield (
            electrical_line(k),
            f"{_multiple_prefix(k)}electrical periods: {z} teeth x turns of the rotor",
            k * z,
        )
    yield "rotor", f"turns of the rotor: ratio {reducer.ratio:.6g}", 1
    if not reducer.train:
        yield "wave_generator_2", "two per turn of the wave generator, the usual kinematic error", 2
    for stage, name, words, cycles in train_orders(reducer.train):
        yield f"stage {stage}, {name}", words, cycles
    for e in scenario.rotor_harmonics:
        yield (
            (e.line if e.line.startswith("wave") else e.origin),
            f"{e.cause.replace('transmission', 'kinematic')}: {e.origin}",
            e.order,
        )
    yield (
        "output",
        "turns of the output",
        Fraction(1) / Fraction(reducer.ratio).limit_denominator(10**9),
    )


def _flux_order(motor: Motor, order: int) -> Iterator[tuple[str, str, int]]:
    """The torque of a flux harmonic with currents that follow the rotor; one that makes none has its
    own order, and says so.
    """
    z, turned = motor.rotor_teeth, sequence(order, motor.phases)
    if turned == 0:
        words = (
            f"flux harmonic {order}: no torque with {motor.phases} phases in star, which carry none"
            " of its current"
        )
        yield f"flux {order}", words, order * z
        return
    words = (
        f"flux harmonic {order}: torque at {order} {'-' if turned > 0 else '+'} 1 ="
        f" {order - turned} x {z} teeth x turns of the rotor, proportional to the current"
    )
    yield f"flux {order}", words, (order - turned) * z


def _multiple_prefix(k: int) -> str:
    if k == 1:
        return ""
    return f"{k} x "
