"""Does a clamp that is modelled as conducting either way hide lost steps? A published drive with
assumed figures.

``python benchmarks/pulse_clamp.py [--draws N] [--seed N] [--steps N] [--check]``

The published drive: 1.8 degree motor with four phases, harmonic drive 200:1, a pulse of 60 ms every
2.16 s, diodes that conduct below -8 V; hot it makes its steps up to 71 V and loses some from 72 V,
after 25 to 50 steps; a model whose clamp conducts at +-8 V, and so damps twice as much, had called
it stable. Its R, L, K_t, inertias and frictions are not published: they are drawn from RANGES, and
the damping of the rotor is then taken where the drive just loses steps at 72 V, since nothing else
gives a threshold where the test found one. Each draw that makes all steps from 65 to 71 V is then run
at each volt up to 77 with both clamps. Left out are draws in which the back-EMF of a rotor that swings
by a full step does not reach 8 V: there neither clamp conducts while the rotor settles.

Each winding is integrated by itself, by the classical Runge-Kutta method in steps of 40 us, which
shares no code with microvib; ``--check`` compares it with the oracle of the tests
(``support.pulses``), whose changes of mode are located.
"""

from __future__ import annotations

import argparse
import math
import operator
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.pulses import Friction, PulsedDrive, integrate

STEP, COARSER = 4e-5, 25
"""Step [s], and how much longer it is while rotor and windings rest."""
RANGES = {
    "resistance": (50.0, 500.0, "ohm"),
    "time constant of a winding": (1e-3, 15e-3, "s"),
    "holding torque at 70 V": (0.05, 1.0, "N m"),
    "detent over holding torque": (0.01, 0.1, ""),
    "friction of the rotor over holding torque": (0.001, 0.03, ""),
    "inertia of rotor and wave generator": (5e-6, 3e-4, "kg m^2"),
    "inertia of the array": (20.0, 500.0, "kg m^2"),
    "stiffness of the gear": (1e4, 1e5, "N m/rad"),
    "damping ratio of the array on the gear": (0.005, 0.05, ""),
    "friction of the output": (0.1, 10.0, "N m"),
}
"""Drawn evenly in the logarithm; all assumed."""
DAMPING, FINER, HALVINGS = (1e-3, 0.1), 1.6, 3
"""Damping ratios of the rotor on its magnetic spring that are tried, the factor between them, and how
often the interval with the threshold is halved."""
LOST_AT, STABLE_AT = 72.0, 74.0
"""Voltages [V] at which the test lost steps, and up to which the wrong model is to make all."""
VOLTAGES = range(65, 78)
TEETH, FULL_STEP, DRIVEN = 50.0, 2.0 * math.pi / 200.0, 9.0


class Figures(NamedTuple):
    """A drive as compiled code takes it."""

    V: float
    V_d: float
    R: float
    L: float
    K: float
    K_d: float
    J_m: float
    J_l: float
    K_g: float
    C_g: float
    h: float
    T_m: float  # Coulomb friction and viscous part, of rotor and output
    s_m: float
    T_l: float
    s_l: float
    both_ways: bool
    on_steps: int
    all_steps: int
    fine: float


compiled = numba.njit(cache=True, error_model="numpy")


@compiled
def _pulls(y, p):
    """Torque per current of the windings a and b, and torques on rotor and output but for friction."""
    s, c = math.sin(TEETH * y[0]), math.cos(TEETH * y[0])
    k_a, k_b = -p.K * s, p.K * c
    gear = p.K_g * (-y[0] / p.h - y[2]) + p.C_g * (-y[1] / p.h - y[3])
    torque = k_a * (y[4] - y[6]) + k_b * (y[5] - y[7])
    return k_a, k_b, torque + gear / p.h - p.K_d * 4.0 * s * c * (c * c - s * s), gear


@compiled
def _constant(w, k_a, k_b):
    return (k_a if w % 2 == 0 else k_b) * (1.0 if w < 2 else -1.0)


@compiled
def _rates(y, mode, signs, p, f):
    """Right-hand side: rotor, output, currents of a, b, c, d."""
    k_a, k_b, torque, gear = _pulls(y, p)
    f[:4] = 0.0
    if signs[0] != 0.0:
        f[0], f[1] = y[1], (torque - signs[0] * p.T_m - p.s_m * y[1]) / p.J_m
    if signs[1] != 0.0:
        f[2], f[3] = y[3], (gear - signs[1] * p.T_l - p.s_l * y[3]) / p.J_l
    for w in range(4):
        v = p.V if mode[w] == DRIVEN else -mode[w] * p.V_d
        f[4 + w] = (v - p.R * y[4 + w] - _constant(w, k_a, k_b) * y[1]) / p.L
        if mode[w] == 0.0:
            f[4 + w] = 0.0


@compiled
def _step(dt, y, mode, signs, p, room):
    """A step by the classical Runge-Kutta method, in place."""
    f, at, total = room
    total[:] = 0.0
    for stage in range(4):
        reach = 0.0 if stage == 0 else (dt if stage == 3 else 0.5 * dt)
        for i in range(8):
            at[i] = y[i] + reach * f[i]
        _rates(at, mode, signs, p, f)
        for i in range(8):
            total[i] += (1.0 if stage == 0 or stage == 3 else 2.0) * f[i]
    for i in range(8):
        y[i] += dt / 6.0 * total[i]


@compiled
def _decide_windings(y, mode, p):
    """Modes of the windings at the end of a step."""
    k_a, k_b, _, _ = _pulls(y, p)
    for w in range(4):
        emf = _constant(w, k_a, k_b) * y[1]
        if mode[w] != DRIVEN and mode[w] * y[4 + w] <= 0.0:
            y[4 + w], mode[w] = 0.0, 0.0
        if mode[w] == 0.0 and emf < -p.V_d:
            mode[w] = 1.0
        elif mode[w] == 0.0 and p.both_ways and emf > p.V_d:
            mode[w] = -1.0


@compiled
def _decide_frictions(y, signs, p):
    """Whether rotor and output stick at the end of a step, 0, or which way they slip."""
    _, _, torque, gear = _pulls(y, p)
    for which in range(2):
        pull, held, rate = (torque, p.T_m, 1) if which == 0 else (gear, p.T_l, 3)
        if signs[which] * y[rate] < 0.0 or signs[which] == 0.0:
            y[rate] = 0.0
            signs[which] = 0.0 if abs(pull) <= held else np.sign(pull)


@compiled
def _make_step(driven, y, mode, signs, p, room):
    """One step of the drive: a pulse on a winding, and what follows."""
    mode[driven] = DRIVEN
    done = 0
    while done < p.all_steps:
        if done == p.on_steps:
            mode[driven] = np.sign(y[4 + driven])
        rests = done > p.on_steps and not mode.any() and signs[0] == 0.0
        if rests and signs[1] == 0.0:
            return
        count = min(COARSER if rests else 1, p.all_steps - done)
        _step(count * p.fine, y, mode, signs, p, room)
        _decide_windings(y, mode, p)
        _decide_frictions(y, signs, p)
        done += count


@compiled
def _first_lost(p, angles):
    """Number of the first step not made, 0 if all are; the rotor's angle before each in ``angles``."""
    y, mode, signs, room = np.zeros(8), np.zeros(4), np.zeros(2), np.zeros((3, 8))
    last, steps = 0, angles.size - 1
    for n in range(steps + 1):
        angles[n] = y[0] / FULL_STEP
        behind = round(n - angles[n])
        if behind != last:
            return n
        last = behind
        if n < steps:
            _make_step((n + 1) % 4, y, mode, signs, p, room)
    return 0


def first_lost(drive: PulsedDrive, steps: int, fine: float = STEP) -> tuple[int, np.ndarray]:
    """Number of the first step that is not made, 0 if all are, and the rotor before each in full
    steps.
    """
    angles = np.full(steps + 1, np.nan)
    figures = Figures(
        drive.voltage, drive.diode_voltage, drive.R, drive.L, drive.K_m, drive.K_d, drive.J_m, drive.J_l,
        drive.K_g, drive.C_g, drive.ratio, drive.rotor.coulomb, drive.rotor.viscous,
        drive.output.coulomb, drive.output.viscous, drive.both_ways,
        round(drive.on_time / fine), round(drive.step_time / fine), fine,
    )  # fmt: skip
    return int(_first_lost(figures, angles)), angles


def drawn(r: np.random.Generator) -> tuple[PulsedDrive, float]:
    """A drive, without damping of its rotor, and the viscous friction that would be critical."""
    R, tau, hold, detent, friction, J_m, J_l, K_g, damping, T_l = (
        float(np.exp(r.uniform(math.log(low), math.log(high)))) for low, high, _ in RANGES.values()
    )
    drive = PulsedDrive(
        voltage=70.0, on_time=0.06, diode_voltage=8.0, step_time=2.16, R=R, L=R * tau, K_m=hold * R / 70.0,
        K_d=detent * hold, J_m=J_m, J_l=J_l, K_g=K_g, C_g=2.0 * damping * math.sqrt(K_g * J_l),
        rotor=Friction(coulomb=friction * hold), output=Friction(coulomb=T_l), four_windings=True,
    )  # fmt: skip
    return drive, 2.0 * math.sqrt(drive.teeth * hold * J_m)


def swing_emf(drive: PulsedDrive) -> float:
    """Largest back-EMF [V] of a rotor that swings freely by a full step about its magnetic spring."""
    hold = drive.K_m * drive.voltage / drive.R
    rate = math.sqrt(drive.teeth * hold / drive.J_m)
    return drive.K_m * drive.full_step * rate


def with_damping(drive: PulsedDrive, viscous: float) -> PulsedDrive:
    return replace(drive, rotor=replace(drive.rotor, viscous=viscous))


def at_threshold(
    drive: PulsedDrive, critical: float, steps: int
) -> tuple[PulsedDrive, float] | None:
    """The drive with the largest damping tried with which it loses steps at LOST_AT, and that ratio;
    None where there is no such damping.
    """

    def loses(ratio: float) -> bool:
        damped = replace(with_damping(drive, ratio * critical), voltage=LOST_AT)
        return first_lost(damped, steps)[0] > 0

    ratio, highest = DAMPING
    if not loses(ratio):
        return None
    while loses(FINER * ratio):
        ratio *= FINER
        if ratio > highest:
            return None
    low, high = ratio, FINER * ratio
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if loses(middle) else (low, middle)
    return with_damping(drive, low * critical), low


def check(seed: int) -> None:
    """Compare with the oracle over three steps, with steps as they are and half as long."""
    r = np.random.default_rng(seed)
    for _ in range(3):
        drive, critical = drawn(r)
        for both_ways in (False, True):
            one = replace(with_damping(drive, 0.03 * critical), both_ways=both_ways)
            oracle = integrate(one, 3)
            said = (first_lost(one, 3, fine)[1].round(4).tolist() for fine in (STEP, 0.5 * STEP))
            print(oracle.before_step.round(4).tolist(), *said)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    if asked.check:
        check(asked.seed)
        return
    r, counted = np.random.default_rng(asked.seed), []
    print("first voltage with lost steps and number of the first step lost there: diodes; +-8 V")
    acting = 0
    for n in range(asked.draws):
        drive, critical = drawn(r)
        swing = swing_emf(drive) / drive.diode_voltage
        if swing <= 1.0:
            continue
        acting += 1
        found = at_threshold(drive, critical, asked.steps)
        if found is None:
            continue
        just, ratio = found
        right, wrong = (_scan(replace(just, both_ways=both), asked.steps) for both in (False, True))
        if right[0] != LOST_AT:
            continue
        counted.append((right, wrong))
        hold = just.K_m * 70.0 / just.R
        print(
            f"draw {n}: {right[0]:g} V, step {right[1]}; {wrong[0]:g} V, step {wrong[1]}; R {just.R:.0f} ohm, L/R"
            f" {1e3 * just.L / just.R:.1f} ms, hold {hold:.2f} N m, detent {just.K_d / hold:.3f}, rotor {just.J_m:.1e}"
            f" kg m^2, friction {just.rotor.coulomb / hold:.4f}, damping ratio {ratio:.4f}, swing {8 * swing:.0f} V",
            flush=True,
        )
    slow = sum(25 <= right[1] <= 50 for right, _ in counted)
    stable = sum(wrong[0] > STABLE_AT for _, wrong in counted)
    later, same, earlier = (
        sum(compared(wrong[0], right[0]) for right, wrong in counted)
        for compared in (operator.gt, operator.eq, operator.lt)
    )
    print(
        f"{asked.draws} draws, in {acting} of which the diodes can conduct; {len(counted)} make all"
        f" {asked.steps} steps from 65 to 71 V and lose some at 72 V, {slow} of them first after 25 to"
        f" 50 steps. With the clamp at +-8 V {stable} of them make all up to 74 V; the first loss comes"
        f" at a higher voltage in {later}, the same in {same}, a lower one in {earlier}"
    )


def _scan(drive: PulsedDrive, steps: int) -> tuple[float, int]:
    """The lowest of VOLTAGES at which steps are lost, and which is the first; inf and 0 where none is."""
    for volts in VOLTAGES:
        first, _ = first_lost(replace(drive, voltage=float(volts)), steps)
        if first:
            return float(volts), first
    return math.inf, 0


if __name__ == "__main__":
    main()
