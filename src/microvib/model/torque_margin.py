"""Motorisation margin: the torque that a motor has against what it must overcome, with factors as
mechanisms' standards use them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from microvib.model.driver import motor_of_mean_spring
from microvib.model.part import Part
from microvib.model.scenario import Scenario
from microvib.results import Column, Measure
from microvib.units import Quantity

MOTOR_TORQUE = Measure("mN m", 1e-3, "#.4g")


class MotorisationFactors(Part):
    """Factors on resisting torques and on their sum.

    The defaults are those that ECSS-E-ST-33-01C is commonly quoted with for torques that were
    calculated and not measured. They were not compared with its text here: take those of your
    project.
    """

    inertia: Annotated[float, Quantity("", "on torque that accelerates inertia", ge=1, le=10)] = 1.1
    spring: Annotated[float, Quantity("", "on the torque of springs", ge=1, le=10)] = 1.2
    detent: Annotated[float, Quantity("", "on magnetic losses of the motor", ge=1, le=10)] = 1.5
    friction: Annotated[float, Quantity("", "on friction", ge=1, le=10)] = 3.0
    harness: Annotated[float, Quantity("", "on the harness", ge=1, le=10)] = 3.0
    total: Annotated[float, Quantity("", "on the sum of all, for a motor", ge=1, le=10)] = 2.0


@dataclass(frozen=True)
class ResistingTorque:
    """One torque that the motor must overcome, at the rotor."""

    name: Annotated[str, Column("torque", "torque")]
    nominal: Annotated[float, Column("nominal_n_m", "nominal", MOTOR_TORQUE)]
    factor: Annotated[float, Column("factor", "factor", Measure(form="g"))]

    @property
    def factored(self) -> Annotated[float, Column("factored_n_m", "with factor", MOTOR_TORQUE)]:
        """Torque times its factor [N m]."""
        return self.nominal * self.factor


@dataclass(frozen=True)
class TorqueMargin:
    """Torque of the motor against what resists it."""

    available: float
    """Largest torque of the motor with its currents, without detent torque [N m]."""
    resisting: tuple[ResistingTorque, ...]
    total_factor: float

    @property
    def required(self) -> float:
        """Torque that the factors ask for [N m]."""
        return self.total_factor * math.fsum(x.factored for x in self.resisting)

    @property
    def margin(self) -> float:
        """Available over required torque, less 1; from 0 on the factors are met."""
        if self.required == 0.0:
            return math.inf
        return self.available / self.required - 1.0


def torque_margin(scenario: Scenario, factors: MotorisationFactors | None = None) -> TorqueMargin:
    """Margin of a drive at its constant rate.

    Available is what the least currents of an electrical turn make. Friction counts at breakaway and
    at the rate, whichever is more; the gear's efficiency is 1, as in the equations of motion. Springs
    are harnesses with a stiffness, over one turn of the array.

    Parameters
    ----------
    scenario : Scenario
        The drive.
    factors : MotorisationFactors, optional
        Factors on resisting torques; without them the defaults.

    Returns
    -------
    TorqueMargin
        Every torque at the rotor [N m] with its factor.
    """
    factors = factors or MotorisationFactors()
    motor = scenario.motor
    available = motor.axis_torque_constant * scenario.driver.least_amplitude(motor)
    return TorqueMargin(available, tuple(_resisting(scenario, factors)), factors.total)


def _resisting(scenario: Scenario, factors: MotorisationFactors) -> Iterator[ResistingTorque]:
    motor, ratio = scenario.motor, abs(scenario.reducer.h)
    rate = abs(scenario.rate or 0.0)
    on_rotor = _friction(motor.friction.breakaway_torque, motor.friction.torque(rate * ratio))
    yield ResistingTorque("friction of the rotor", on_rotor, factors.friction)
    friction = scenario.friction
    on_output = _friction(friction.breakaway_torque, friction.torque(rate))
    yield ResistingTorque("friction of the output", on_output / ratio, factors.friction)
    if motor.eddy_damping:
        eddy = motor.eddy_damping * rate * ratio
        yield ResistingTorque("eddy currents", eddy, factors.detent)
    detent = math.fsum(motor.detent_orders.values())
    if detent:
        yield ResistingTorque("detent torque", detent, factors.detent)
    acceleration = _largest_acceleration(scenario)
    if acceleration:
        inertia = scenario.load.rotor * ratio + scenario.load.output / ratio
        yield ResistingTorque("inertia", inertia * acceleration, factors.inertia)
    harness = friction.harness
    if harness is None:
        return
    yield ResistingTorque("friction of the harness", harness.friction / ratio, factors.harness)
    if harness.stiffness:
        wound = 2.0 * math.pi * harness.stiffness / ratio
        yield ResistingTorque("spring of the harness", wound, factors.spring)


def _largest_acceleration(scenario: Scenario) -> float:
    """Largest acceleration of the array [rad/s^2] that a profile commands in its ramps."""
    times, rates = scenario.tracking.breakpoints()
    spans = np.diff(times)
    ramps = spans > 0.0
    return float(np.max(np.abs(np.diff(rates)[ramps] / spans[ramps]), initial=0.0))


def _friction(breakaway: float, sliding: float) -> float:
    return max(breakaway, sliding)


def lag_of_array(scenario: Scenario) -> float:
    """Angle [rad] by which the array stays behind its command at a constant rate, quasi-static: by
    friction on the magnetic spring and on the reducer.
    """
    motor = motor_of_mean_spring(scenario.driver, scenario.motor)
    ratio = abs(scenario.reducer.h)
    rate = abs(scenario.rate or 0.0)
    on_output = scenario.friction.torque(rate)
    on_rotor = motor.friction.torque(rate * ratio) + on_output / ratio
    on_rotor += (motor.eddy_damping or 0.0) * rate * ratio
    lag = on_rotor / motor.electromagnetic_stiffness / ratio
    if isinstance(scenario.reducer.stiffness, float):
        lag += on_output / scenario.reducer.stiffness
    return lag
