"""Loads on the hub beside a drive that turns and always slides, integrated in time with its windings, its
frictions and the errors of its gear (RK4): what is compared with bounds of other sources' lines.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

import microvib as mv
from microvib.model.drive_states import DriveStates, Sticking
from microvib.model.driver import motor_of_mean_spring, references_over_electrical_period
from microvib.model.shaft_rates import rates_over_turn

STEP = 1e-4
"""Longest step [s]."""
_LARGEST = 2.0
"""Step over the time constant of a winding with its current loop."""
KEPT = 8
"""Steps between samples."""


class InTime(NamedTuple):
    """Difference that loads make, and the motion without them."""

    craft: DriveStates
    time: np.ndarray
    """[s], (n,)."""
    los: np.ndarray
    """Line of sight with the loads less that without [rad], (n, 2)."""
    sticking: Sticking
    """Least rates without the loads, and rates over an electrical turn."""


def integrated(
    scenario: mv.Scenario, f: float, forces: np.ndarray, settle: float, duration: float
) -> InTime:
    """Line of sight that ``forces`` (n,) on the coordinates at f [Hz] make of a drive by microsteps."""
    craft = DriveStates(scenario, ())
    motor, driver, reducer, friction = (
        scenario.motor, scenario.driver, scenario.reducer, scenario.friction,
    )  # fmt: skip
    M, C, K = (part.copy() for part in craft._system)
    rotor, output = craft.on_rotor_of(0)[:, 0], craft.on_output_of(0, scenario)[:, 0]
    K -= motor_of_mean_spring(driver, motor).electromagnetic_stiffness * np.outer(rotor, rotor)
    twist = -rotor / reducer.h - output
    gear = np.zeros(2)
    if reducer.errors:
        gear = np.array([float(reducer.stiffness), reducer.damping])
        K -= gear[0] * np.outer(twist, twist)
        C -= gear[1] * np.outer(twist, twist)
    inverse = np.linalg.inv(M)
    n = M.shape[0]
    rate, omega_m = float(scenario.rate), -reducer.h * float(scenario.rate)
    turn = references_over_electrical_period(driver, motor.axis_current, motor.phases)
    period = 2.0 * math.pi / (motor.rotor_teeth * abs(omega_m))
    inductance = motor.winding_inductance + driver.derivative_gain
    fast = inductance / (motor.winding_resistance + driver.proportional_gain)
    per_step = 2 * math.ceil(0.5 * period / len(turn) / min(STEP, _LARGEST * fast))
    step = period / len(turn) / per_step
    detent = [(motor.detent_periods, motor.detent_torque, 0.0)]
    detent += [(h.order, h.amplitude, h.phase) for h in motor.detent]
    w = 2.0 * math.pi * f
    moved = np.linalg.solve(craft._system[2] - w**2 * M + 1j * w * craft._system[1], forces + 0j)
    start = np.zeros((2, 2 * n + 4))
    start[1, : 2 * n] = np.concatenate([moved.real, (1j * w * moved).real])
    start[:, 2 * n] = motor.axis_current
    shafts = np.array(
        [
            _friction(motor.friction, motor.eddy_damping or 0.0, omega_m),
            _friction(friction, 0.0, rate),
        ]
    )
    position = [] if friction.position is None else friction.position.harmonics
    winding = (
        motor.winding_resistance, inductance,
        driver.proportional_gain, driver.integral_gain, motor.axis_torque_constant,
    )  # fmt: skip
    count, skip = round((settle + duration) / step), round(settle / step)
    los, theta, rates = _run(
        np.ascontiguousarray(inverse), np.ascontiguousarray(inverse @ C), np.ascontiguousarray(inverse @ K),
        np.ascontiguousarray(inverse @ forces), start, rotor, output, twist, np.array([rate, omega_m]), motor.rotor_teeth,
        turn, per_step, np.array(detent, dtype=float), np.array(winding), shafts,
        np.array([(e.order, e.amplitude, e.phase) for e in position], dtype=float).reshape(-1, 3), gear,
        np.array([(float(e.order), e.amplitude, e.phase) for e in reducer.errors]).reshape(-1, 3),
        w, step, count, skip, np.ascontiguousarray(craft.line_of_sight),
    )  # fmt: skip
    found = rates_over_turn(
        motor.rotor_teeth * theta,
        (rates[:, 0], rates[:, 1]),
        motor.rotor_teeth * omega_m,
        KEPT * step,
    )
    slowest = np.min(np.abs(rates), axis=0)
    sticking = Sticking(False, False, float(slowest[0]), float(slowest[1]), rates=found)
    time = step * (skip + KEPT * (1 + np.arange(len(los))))
    return InTime(craft, time, los, sticking)


def _friction(friction: mv.model.friction.Friction, eddy: float, rate: float) -> list[float]:
    return [
        friction.sliding_torque, friction.stribeck_torque, friction.stribeck_rate, friction.stribeck_shape,
        friction.viscous, eddy * rate,
    ]  # fmt: skip


@njit(cache=False)
def _dry(v, one):
    """Friction torque beside the viscous part of a shaft that slides."""
    size = one[0] + one[1] * math.exp(-((abs(v) / one[2]) ** one[3]))
    return math.copysign(size, v)


@njit(cache=False)
def _rates(
    x, t, loaded, references, inverse, C, K, force, rotor, output, twist, even, teeth, detent, winding, shafts, position,
    gear, errors, w, out,
):  # fmt: skip
    n = rotor.size
    theta = even[1] * t
    omega = even[1]
    theta_l = even[0] * t
    omega_l = even[0]
    turned = 0.0
    speed = 0.0
    for b in range(n):
        theta += rotor[b] * x[b]
        omega += rotor[b] * x[n + b]
        theta_l += output[b] * x[b]
        omega_l += output[b] * x[n + b]
        turned += twist[b] * x[b]
        speed += twist[b] * x[n + b]
    p = teeth * theta
    i_a, i_b = x[2 * n], x[2 * n + 1]
    R, L, K_P, K_I, K_m = winding
    flux_a, flux_b = -math.sin(p), math.cos(p)
    on_rotor = K_m * (i_a * flux_a + i_b * flux_b)
    for k in range(detent.shape[0]):
        on_rotor -= detent[k, 1] * math.sin(detent[k, 0] * p + detent[k, 2])
    on_rotor -= _dry(omega, shafts[0]) + shafts[0, 4] * even[1] + shafts[0, 5]
    factor = 1.0
    for k in range(position.shape[0]):
        factor += position[k, 1] * math.cos(position[k, 0] * theta_l + position[k, 2])
    viscous = shafts[1, 4] * omega_l
    on_output = -factor * (_dry(omega_l, shafts[1]) + viscous) + (viscous - shafts[1, 4] * even[0])
    on_twist = 0.0
    if gear[0] > 0.0:
        e0, e1 = 0.0, 0.0
        for k in range(errors.shape[0]):
            e0 += errors[k, 1] * math.sin(errors[k, 0] * theta + errors[k, 2])
            e1 += errors[k, 0] * errors[k, 1] * math.cos(errors[k, 0] * theta + errors[k, 2])
        torque = gear[0] * (turned + e0) + gear[1] * (speed + e1 * omega)
        on_twist = -torque
        on_rotor -= torque * e1
    for a in range(n):
        s = 0.0
        for b in range(n):
            s -= K[a, b] * x[b] + C[a, b] * x[n + b]
            s += inverse[a, b] * (rotor[b] * on_rotor + output[b] * on_output + twist[b] * on_twist)
        if loaded:
            s += force[a] * math.cos(w * t)
        out[a] = x[n + a]
        out[n + a] = s
    for k in range(2):
        off = references[k] - x[2 * n + k]
        emf = K_m * omega * (flux_a if k == 0 else flux_b)
        out[2 * n + k] = (K_P * off + K_I * x[2 * n + 2 + k] - R * x[2 * n + k] - emf) / L
        out[2 * n + 2 + k] = off
    return theta, omega, omega_l


@njit(cache=False)
def _run(
    inverse, C, K, force, start, rotor, output, twist, even, teeth, turn, per_step, detent, winding, shafts, position, gear,
    errors, w, step, count, skip, los,
):  # fmt: skip
    size = start.shape[1]
    n = rotor.size
    samples = (count - skip) // 8
    kept, theta, rates = np.zeros((samples, 2)), np.zeros(samples), np.zeros((samples, 2))
    x = start.copy()
    a, b, c, d = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    for k in range(count):
        t = k * step
        number = (k + per_step // 2) // per_step
        if even[1] < 0.0:
            number = -number
        references = turn[number % turn.shape[0]]
        for i in range(2):
            y = x[i]
            common = (
                i == 1, references, inverse, C, K, force, rotor, output, twist, even, teeth, detent, winding, shafts,
                position, gear, errors, w,
            )  # fmt: skip
            found = _rates(y, t, *common, a)
            done = k - skip
            if i == 0 and done >= 0 and done % 8 == 0 and done // 8 < samples:
                theta[done // 8] = found[0]
                rates[done // 8] = found[1:]
            _rates(y + 0.5 * step * a, t + 0.5 * step, *common, b)
            _rates(y + 0.5 * step * b, t + 0.5 * step, *common, c)
            _rates(y + step * c, t + step, *common, d)
            x[i] = y + step / 6.0 * (a + 2.0 * (b + c) + d)
        done = k + 1 - skip
        if done > 0 and done % 8 == 0:
            for axis in range(2):
                for m in range(n):
                    kept[done // 8 - 1, axis] += los[axis, m] * (x[1, m] - x[0, m])
    return kept, theta, rates
