"""Loads on the hub beside a drive that turns, integrated in time: what bounds of side lines are compared with."""

from pathlib import Path

import numpy as np

import microvib as mv
from microvib.model.drive_states import SLIDES, DriveStates, craft_of_drives
from microvib.model.driver import motor_of_mean_spring, references_over_electrical_period
from microvib.model.rigid import rigid_motion_at

EXAMPLE = Path(__file__).parents[2] / "examples" / "spacecraft.yaml"
LOADS = np.array([1.0, 0.5, -0.7, 1.5, 1.2, -1.0])
PLACE = rigid_motion_at(np.array([0.3, -0.2, 0.5]))


def smooth_drive() -> mv.Scenario:
    """Drive of the example craft without dry friction, whose weak spring moves modes about the drive axis."""
    smooth = {
        "coulomb": "0 N*m",
        "breakaway": "0 N*m",
        "stribeck_rate": "0.003 deg/s",
        "viscous": "0.05 N*m*s/rad",
    }
    changes = {"friction": smooth, "motor.friction.viscous": "2e-4 N*m*s/rad", "motor.current": "0.1 A", "motor.detent_torque": "0 N*m", "reducer.damping": "0.5 N*m*s/rad", "tracking.rate": "0.2 deg/s"}  # fmt: skip
    return mv.load_scenario(EXAMPLE).with_(
        {**changes, **{f"array.modes.{i}.damping": 0.02 for i in range(4)}}
    )


def integrated(
    scenario: mv.Scenario, f: float, settle: float, duration: float
) -> tuple[DriveStates, np.ndarray, np.ndarray]:
    """Line of sight that loads at f [Hz] make of the nonlinear drive, whose currents are those that are
    asked for, with and without these loads (RK4): instants and the difference.
    """
    craft, motor = craft_of_drives(scenario, (SLIDES, SLIDES)), scenario.motor
    M, C, K = (part.copy() for part in craft._system)
    n, rotor = M.shape[0], int(np.argmax(craft.on_rotor_of(0)[:, 0]))
    push, w = craft.on_hub(PLACE) @ LOADS * 0.1, 2.0 * np.pi * f
    moved = np.linalg.solve(K - w**2 * M + 1j * w * C, push + 0j)
    K[rotor, rotor] -= motor_of_mean_spring(scenario.driver, motor).electromagnetic_stiffness
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]]).T
    omega_m = -scenario.reducer.h * scenario.rate
    z, omega = motor.rotor_teeth, motor.rotor_teeth * omega_m
    load = motor.viscous * omega_m - scenario.friction.torque(scenario.rate) / scenario.reducer.h
    turn = references_over_electrical_period(scenario.driver, motor.axis_current, motor.phases)
    detent = [(motor.detent_periods, motor.detent_torque, 0.0)]
    detent += [(h.order, h.amplitude, h.phase) for h in motor.detent]
    force = inverse @ push
    on = np.array([[0.0], [1.0]])
    step = 2.0 * np.pi / abs(omega) / 512
    per_step = 512 // len(turn)
    y, kept = on * np.concatenate([moved.real, (1j * w * moved).real]), []

    def rate(y: np.ndarray, t: float, i: np.ndarray) -> np.ndarray:
        p = omega * t + z * y[:, rotor]
        torque = motor.axis_torque_constant * (i[1] * np.cos(p) - i[0] * np.sin(p)) - load
        for order, size, phase in detent:
            torque = torque - size * np.sin(order * p + phase)
        found = y @ A
        found[:, n:] += torque[:, None] * inverse[:, rotor]
        found[:, n:] += on * force * np.cos(2.0 * np.pi * f * t)
        return found

    for k in range(round((settle + duration) / step)):
        t, number = k * step, (k + per_step // 2) // per_step
        i = turn[(number if omega > 0.0 else -number) % len(turn)]
        a = rate(y, t, i)
        b = rate(y + 0.5 * step * a, t + 0.5 * step, i)
        c = rate(y + 0.5 * step * b, t + 0.5 * step, i)
        d = rate(y + step * c, t + step, i)
        y = y + step / 6.0 * (a + 2.0 * (b + c) + d)
        if k % 8 == 7 and t >= settle:
            kept.append((t + step, *(craft.line_of_sight @ (y[1] - y[0])[:n])))
    kept = np.array(kept)
    return craft, kept[:, 0], kept[:, 1:]


def amplitudes(t: np.ndarray, y: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Amplitudes (k, 2) of lines at known frequencies."""
    window = np.hanning(t.size)[:, None]
    waves = np.hstack([part(2.0 * np.pi * np.outer(t, frequency)) for part in (np.cos, np.sin)])
    found = np.linalg.lstsq(waves * window, y * window, rcond=None)[0]
    return np.hypot(*np.split(found, 2))


def resolved(frequency: np.ndarray, duration: float) -> np.ndarray:
    """Whether lines (k,) stand far enough from every other for the window of a record of ``duration`` [s]."""
    apart = np.abs(frequency[:, None] - frequency[None, :])
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart.min(axis=1) > 4.0 / duration)
