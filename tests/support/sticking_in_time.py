"""Loads on the hub beside a drive whose shaft sticks, integrated in time: what bounds on what friction makes of
them are compared with.

Linear parts are exact over a step (matrix exponential); the motor's torque is a sine of the angle to the
commanded microstep, and friction is a steep line through rest, as steep as steps of this length bear.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import expm

import microvib as mv
from microvib.model.drive_states import SLIDES, DriveStates, craft_of_drives
from microvib.model.driver import motor_of_mean_spring

STEP = 2e-5
KEPT = 50
"""Steps between samples."""
SLOW = 3e-6
"""Rate [rad/s] at which friction that sticks has its whole torque, at the least."""


class InTime(NamedTuple):
    """Difference that loads make."""

    craft: DriveStates
    time: np.ndarray
    """[s], (n,)."""
    los: np.ndarray
    """Line of sight with the loads less that without [rad], (n, 2)."""
    sticks: float
    """Part of the time that the output is nearly at rest without the loads."""


def integrated(
    scenario: mv.Scenario, f: float, forces: np.ndarray, settle: float, duration: float
) -> InTime:
    """Line of sight that ``forces`` (n,) on the coordinates at f [Hz] make of a drive by microsteps
    whose currents are those that are asked for, with dry friction on its output.
    """
    craft = craft_of_drives(scenario, (SLIDES, SLIDES))
    motor, friction = scenario.motor, scenario.friction
    M, C, K = (part.copy() for part in craft._system)
    n = M.shape[0]
    rotor, output = craft.on_rotor_of(0)[:, 0], craft.on_output[:, 0]
    K -= motor_of_mean_spring(scenario.driver, motor).electromagnetic_stiffness * np.outer(rotor, rotor)  # fmt: skip
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
    w = 2.0 * np.pi * f
    # forces cos(w t) are (e, e') with e'' = -w^2 e, so that they are exact over a step, too
    columns = np.zeros((2 * n, 4))
    columns[n:, 0], columns[n:, 1], columns[n:, 2] = (inverse @ x for x in (rotor, output, forces))
    whole = np.zeros((2 * n + 4, 2 * n + 4))
    whole[: 2 * n, : 2 * n], whole[: 2 * n, 2 * n :] = A, columns
    whole[-2, -1], whole[-1, -2] = 1.0, -(w**2)
    step = expm(whole * STEP)
    Km, z = motor.electromagnetic_stiffness / motor.rotor_teeth, motor.rotor_teeth
    moved = np.linalg.solve(craft._system[2] - w**2 * M + 1j * w * craft._system[1], forces + 0j)
    start = np.zeros((2, 2 * n))
    start[1] = np.concatenate([moved.real, (1j * w * moved).real])
    microstep = 2.0 * np.pi / (z * scenario.driver.beats * scenario.driver.microsteps)
    steepest = 0.5 / (STEP * float(output @ inverse @ output))
    rest = max(friction.breakaway_torque / steepest, SLOW)
    of_friction = np.array(
        [friction.sliding_torque, friction.breakaway_torque, friction.stribeck_rate, rest]
    )
    count = round((settle + duration) / STEP)
    skip = round(settle / STEP)
    kept, sticks = _run(
        np.ascontiguousarray(step), start, np.flatnonzero(rotor)[0], np.flatnonzero(output)[0],
        float(scenario.rate), -scenario.reducer.h * float(scenario.rate), microstep, float(z), Km,
        of_friction, w, count, skip, np.ascontiguousarray(craft.line_of_sight),
    )  # fmt: skip
    time = STEP * (skip + KEPT * (1 + np.arange(len(kept))))
    return InTime(craft, time, kept, sticks)


@njit(cache=False, fastmath=True)
def _run(
    step, start, rotor, output, rate, rotor_rate, microstep, z, Km, friction, w, count, skip, los
):  # fmt: skip
    m = start.shape[1]
    n = m // 2
    x = start.copy()
    new = np.zeros(m)
    kept = np.zeros(((count - skip) // KEPT, 2))
    stuck = 0
    sliding, breakaway, stribeck, rest = friction
    for k in range(count):
        t = k * STEP
        command = rotor_rate * (t + 0.5 * STEP)
        held = microstep * np.round(command / microstep) - command
        for i in range(2):
            v = rate + x[i, n + output]
            part = min(max(v / rest, -1.0), 1.0)
            torque = -(sliding + (breakaway - sliding) * np.exp(-abs(v) / stribeck)) * part
            motor = Km * np.sin(z * (held - x[i, rotor]))
            if i == 0 and k >= skip and abs(v) < rest:
                stuck += 1
            for j in range(m):
                s = step[j, m] * motor + step[j, m + 1] * torque
                if i == 1:
                    s += step[j, m + 2] * np.cos(w * t) - step[j, m + 3] * w * np.sin(w * t)
                for b in range(m):
                    s += step[j, b] * x[i, b]
                new[j] = s
            x[i] = new
        done = k + 1 - skip
        if done > 0 and done % KEPT == 0:
            for axis in range(2):
                s = 0.0
                for b in range(n):
                    s += los[axis, b] * (x[1, b] - x[0, b])
                kept[done // KEPT - 1, axis] = s
    return kept, stuck / (count - skip)


def without_line(time: np.ndarray, los: np.ndarray, f: float) -> np.ndarray:
    """Motion (n, 2) less its line at f [Hz], its mean and its drift."""
    own = np.column_stack(
        [np.cos(2.0 * np.pi * f * time), np.sin(2.0 * np.pi * f * time), np.ones_like(time), time]
    )
    return np.asarray(los - own @ np.linalg.lstsq(own, los, rcond=None)[0])


def rms_in_band(time: np.ndarray, los: np.ndarray, low: float, high: float) -> np.ndarray:
    """Root mean square (2,) of what is from ``low`` to ``high`` [Hz]."""
    window = np.hanning(time.size)[:, None]
    f = np.fft.rfftfreq(time.size, time[1] - time[0])
    squares = np.abs(np.fft.rfft(los * window, axis=0)) ** 2
    inside = (f >= low) & (f <= high)
    return np.asarray(np.sqrt(2.0 * squares[inside].sum(axis=0) / (time.size * np.sum(window**2))))
