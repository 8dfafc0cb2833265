"""How far a drive must be turned one way before what its frictions remember of the start, or of the
last reversal, is gone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from microvib.model.driver import motor_of_mean_spring
from microvib.model.scenario import Scenario

NEGLIGIBLE_HARNESS = 0.01
"""Friction of a harness, over the motor's torque at the output, below which it counts for nothing that it
grows while the strands are stretched; assumed: with 0.03 and 0.11 lines changed by up to 1 and 5 % on the way
(tests/test_winding_up.py).
"""


def wind_up(scenario: Scenario) -> float:
    """Angle at the output [rad] that is commanded from rest until the output breaks away; infinite
    if the motor is too weak.

    The twist of the gear and the lag of the rotor on its electromagnetic spring, the mean over an
    electrical turn, T_max sin(z lag),
    at the breakaway torques of both shafts with what a harness adds, and half of the backlash;
    without detent torque and flux harmonics.
    """
    motor, reducer = motor_of_mean_spring(scenario.driver, scenario.motor), scenario.reducer
    held, harness = scenario.friction.breakaway_torque, scenario.friction.harness
    if held == 0.0:
        return 0.0
    if harness is not None:
        held += harness.friction + harness.stiffness * abs(harness.neutral_angle)
    most = motor.electromagnetic_stiffness / motor.rotor_teeth
    asked = held / reducer.ratio + motor.friction.breakaway_torque
    if asked >= most:
        return math.inf
    if reducer.stiffness == "rigid":
        twist = 0.0
    else:
        twist = held / float(reducer.stiffness)
    return (
        math.asin(asked / most) / motor.rotor_teeth / reducer.ratio
        + twist
        + 0.5 * (reducer.backlash or 0.0)
    )


def sliding_travel(scenario: Scenario) -> float:
    """Angle at the output [rad] after which all elements of frictions with memory slide, from where
    they are relaxed; 0 without any.

    Until then friction grows with the angle, and that part of it which falls with the rate is not
    there yet. A harness whose friction is small beside the motor's torque does not count.
    """
    friction, ratio = scenario.friction, scenario.reducer.ratio
    motor = scenario.motor
    largest = 1.0 if friction.position is None else friction.position.largest_factor
    found = [
        _last_slides(friction.memory, friction.breakaway_torque * largest),
        _last_slides(motor.friction.memory, motor.friction.breakaway_torque) / ratio,
    ]
    harness = friction.harness
    if harness is not None:
        full = motor.axis_torque_constant * motor.axis_current * ratio
        if harness.friction > NEGLIGIBLE_HARNESS * full:
            found.append(_last_slides(harness.memory, harness.friction))
    return max(found)


def _last_slides(memory: Iterable[tuple[float, float]], limit: float) -> float:
    """Angle [rad] at which the last of elements of stiffness [N m/rad] and share of the ``limit`` [N m]
    slides."""
    return max((share * limit / stiffness for stiffness, share in memory), default=0.0)


def seconds_until_sliding(scenario: Scenario, end: float) -> float:
    """Seconds from the time ``end`` on until all elements of frictions with memory slide, at the rate
    that is commanded then; 0 where they do by then, or there are none."""
    travel = sliding_travel(scenario)
    if travel == 0.0:
        return 0.0
    turned, rate, whole = commanded_travel(scenario, end)
    needed = (wind_up(scenario) + travel) * (1.0 if whole else 2.0)
    if rate == 0.0 or turned >= needed:
        return 0.0
    return (needed - turned) / abs(rate)


def commanded_travel(scenario: Scenario, end: float) -> tuple[float, float, bool]:
    """Angle [rad] commanded one way up to the time ``end`` [s], the rate then, and whether that is
    all since the start.
    """
    times, rates = scenario.tracking.breakpoints()
    before = times < end
    t = np.append(times[before], end)
    v = np.append(rates[before], np.interp(end, times, rates))
    ramps = np.flatnonzero(v[1:] * v[:-1] < 0.0)  # through zero, where each is parted
    zeros = t[ramps] + np.diff(t)[ramps] * v[ramps] / (v[ramps] - v[ramps + 1])
    t, v = np.insert(t, ramps + 1, zeros), np.insert(v, ramps + 1, 0.0)
    steps = 0.5 * (v[1:] + v[:-1]) * np.diff(t)
    against = np.flatnonzero(steps * v[-1] < 0.0)
    if against.size:
        first = int(against[-1]) + 1
    else:
        first = 0
    return abs(float(np.sum(steps[first:]))), float(v[-1]), first == 0
