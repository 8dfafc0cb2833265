"""Lines of the torque that a driver's references make on a rotor which turns as it is commanded.

Whatever a driver does to its references (a table, errors, a converter's rounding, microsteps that come
earlier or later) is in the currents after each microstep and in the times at which these change. The
torque K_m (i_B cos theta - i_A sin theta) of such currents, over a whole period, has all the lines that
any of it makes, those above the driving frequency, too.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from microvib.model.compensation import CompensatedCount
from microvib.model.driver import Driver, references_over_electrical_period
from microvib.model.motor import Motor
from microvib.model.scenario import Scenario

_POINTS_PER_CYCLE = 4
"""Points in a cycle of the highest line, at the least: its aliases are then a third of it."""
_LEAST_POINTS, _MOST_POINTS = 16, 2**20
"""Points in a microstep, and in a period."""

_MOST_SPRING_ORDERS, _LEAST_SPRING_SHARE = 16, 1e-3
"""Orders at which the spring varies, and the part of it from which that counts."""


class CommandedTorque(NamedTuple):
    """Lines of a torque on the rotor at all multiples of a frequency."""

    frequency: float
    """[Hz]."""
    amplitude: np.ndarray
    """0-to-peak [N m], from the first multiple on, (n,)."""


def commanded_torque(scenario: Scenario, highest: float) -> CommandedTorque:
    """Lines up to a frequency [Hz] of the torque that the driver's references make.

    The rotor turns evenly or, where microsteps make up for an error of the gear, as they command;
    of both the larger is given. Currents are held from microstep to microstep: ramps make lines smaller.
    """
    f_d = float(scenario.driving_frequency or 0.0)
    driver, motor = scenario.driver, scenario.motor
    period = driver.beats * driver.microsteps
    if driver.compensates:
        period *= motor.rotor_teeth
    frequency = f_d / period
    wanted = max(_POINTS_PER_CYCLE * math.ceil(highest / f_d), _LEAST_POINTS)
    points = 2 ** math.ceil(math.log2(min(wanted, max(_MOST_POINTS // period, 1))))
    amplitude = _amplitudes(driver, motor, scenario.reducer.h, points)
    return CommandedTorque(frequency, amplitude[: math.floor(highest / frequency)])


def spring_orders(driver: Driver, motor: Motor) -> list[int]:
    """Cycles per electrical turn of the largest variations of the electromagnetic spring, z K_m
    (i_A cos theta_e + i_B sin theta_e), that a driver's errors make: distances of the side lines that
    they make of any other.
    """
    turn = references_over_electrical_period(driver, 1.0, motor.phases)
    angle = driver.electrical_angle(np.arange(len(turn)))
    size = np.abs(np.fft.rfft(turn[:, 0] * np.cos(angle) + turn[:, 1] * np.sin(angle)))[1:]
    largest = np.argsort(-size)[:_MOST_SPRING_ORDERS]
    return [int(k) + 1 for k in largest if size[k] > _LEAST_SPRING_SHARE * len(turn)]


@lru_cache(maxsize=8)
def _amplitudes(driver: Driver, motor: Motor, h: float, points: int) -> np.ndarray:
    """Amplitudes [N m] at the multiples of a period's frequency, with ``points`` in a microstep."""
    turn = references_over_electrical_period(driver, motor.axis_current, motor.phases)
    current = turn[:, 0] + 1j * turn[:, 1]
    period = len(current)
    compensated = CompensatedCount(driver.compensation, h, driver.microstep(motor))
    if compensated.acts:
        period *= motor.rotor_teeth
    at = (np.arange(period * points) + 0.5) / points
    reach = math.ceil(compensated.reach) + 1
    count = np.arange(-reach, period + reach + 1)
    comes = compensated.commanded(count)
    made = count[np.searchsorted(comes, at, side="right") - 1]
    rotors = [at]
    if compensated.acts:
        rotors.append(np.interp(at, comes, count))
    found = []
    for rotor in rotors:
        angle = 2.0 * math.pi * rotor / len(current)
        torque = (current[made % len(current)] * np.exp(-1j * angle)).imag
        found.append(np.abs(np.fft.rfft(torque))[1:] * (2.0 / at.size))
    amplitude = motor.axis_torque_constant * np.max(found, axis=0)
    amplitude.flags.writeable = False
    return np.asarray(amplitude)
