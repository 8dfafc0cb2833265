"""Does a clamp that is modelled as conducting either way hide lost steps? A published drive with
assumed figures.

``python benchmarks/pulse_clamp.py [--draws N] [--seed N] [--steps N] [--check]``

The published drive: 1.8 degree motor with four phases, harmonic drive 200:1, a pulse of 60 ms every
2.16 s, diodes that conduct below -8 V; hot it makes its steps up to 71 V and loses some from 72 V,
after 25 to 50 steps; a model whose clamp conducts at +-8 V, and so damps twice as much, had called
it stable. Its R, L, K_t, inertias and frictions are not published: they are drawn from RANGES, and
the damping of the rotor is then taken where the drive just loses steps at 75 V, since nothing else
gives a threshold where the test found one. Of these draws those count that make all steps at 65 V.

Each winding is integrated by itself, by the classical Runge-Kutta method in steps of 40 us, which
shares no code with microvib; ``--check`` compares it with the oracle of the tests
(``support.pulses``), whose changes of mode are located.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

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
    "inertia of the rotor": (5e-6, 1e-4, "kg m^2"),
    "inertia of the array": (20.0, 500.0, "kg m^2"),
    "stiffness of the gear": (1e4, 1e5, "N m/rad"),
    "damping ratio of the array on the gear": (0.005, 0.05, ""),
    "friction of the output": (0.1, 10.0, "N m"),
}
"""Drawn evenly in the logarithm; all assumed."""
DAMPING, FINER, HALVINGS = (1e-3, 0.1), 1.6, 3
"""Damping ratios of the rotor on its magnetic spring that are tried, the factor between them, and how
often the interval with the threshold is halved."""
UNKNOWN_BELOW, LOST_BY, WRONG_AT = 65.0, 75.0, 74.0


@numba.njit(cache=True, error_model="numpy")
def _first_lost(
    V, on_time, V_d, step_time, R, L, K, K_d, J_m, J_l, K_g, C_g, h, T_m, s_m, T_l, s_l, both_ways, steps, fine, angles,
):  # fmt: skip
    """Number of the first step not made, 0 if all are; the rotor's angle before each in ``angles``.

    Friction is Coulomb's, with viscous parts ``s_m`` and ``s_l``.
    """
    z, full = 50.0, 2.0 * math.pi / 200.0
    y, f, at, total = np.zeros(8), np.zeros(8), np.zeros(8), np.zeros(8)
    mode = np.zeros(4)  # 0 open, 1 or -1 by its diodes, 9 driven
    sign_m = sign_l = 0.0
    last = 0
    on_steps, all_steps = round(on_time / fine), round(step_time / fine)
    for n in range(steps + 1):
        behind = round(n - y[0] / full)
        angles[n] = y[0] / full
        if behind != last:
            return n
        if n == steps:
            break
        driven = (n + 1) % 4
        mode[driven] = 9.0
        done = 0
        while done < all_steps:
            open_all = mode[0] == 0.0 and mode[1] == 0.0 and mode[2] == 0.0 and mode[3] == 0.0
            if done == on_steps:
                mode[driven] = np.sign(y[4 + driven])
            rests = done > on_steps and open_all and sign_m == 0.0
            if rests and sign_l == 0.0:
                break
            count = min(COARSER if rests else 1, all_steps - done)
            dt = count * fine
            total[:] = 0.0
            for stage in range(4):
                for i in range(8):
                    reach = 0.0 if stage == 0 else (dt if stage == 3 else 0.5 * dt)
                    at[i] = y[i] + reach * f[i]
                s, c = math.sin(z * at[0]), math.cos(z * at[0])
                k_a, k_b = -K * s, K * c
                gear = K_g * (-at[0] / h - at[2]) + C_g * (-at[1] / h - at[3])
                torque = k_a * (at[4] - at[6]) + k_b * (at[5] - at[7])
                torque += gear / h - K_d * 4.0 * s * c * (c * c - s * s)
                f[0] = f[1] = f[2] = f[3] = 0.0
                if sign_m != 0.0:
                    f[0], f[1] = at[1], (torque - sign_m * T_m - s_m * at[1]) / J_m
                if sign_l != 0.0:
                    f[2], f[3] = at[3], (gear - sign_l * T_l - s_l * at[3]) / J_l
                for w in range(4):
                    k = (k_a if w % 2 == 0 else k_b) * (1.0 if w < 2 else -1.0)
                    v = V if mode[w] == 9.0 else -mode[w] * V_d
                    f[4 + w] = 0.0 if mode[w] == 0.0 else (v - R * at[4 + w] - k * at[1]) / L
                for i in range(8):
                    total[i] += (1.0 if stage == 0 or stage == 3 else 2.0) * f[i]
            for i in range(8):
                y[i] += dt / 6.0 * total[i]
            s, c = math.sin(z * y[0]), math.cos(z * y[0])
            k_a, k_b = -K * s, K * c
            for w in range(4):
                k = (k_a if w % 2 == 0 else k_b) * (1.0 if w < 2 else -1.0)
                if (mode[w] == 1.0 or mode[w] == -1.0) and mode[w] * y[4 + w] <= 0.0:
                    y[4 + w], mode[w] = 0.0, 0.0
                if mode[w] == 0.0 and k * y[1] < -V_d:
                    mode[w] = 1.0
                elif mode[w] == 0.0 and both_ways and k * y[1] > V_d:
                    mode[w] = -1.0
            gear = K_g * (-y[0] / h - y[2]) + C_g * (-y[1] / h - y[3])
            torque = k_a * (y[4] - y[6]) + k_b * (y[5] - y[7])
            torque += gear / h - K_d * 4.0 * s * c * (c * c - s * s)
            if sign_m * y[1] < 0.0 or sign_m == 0.0:
                y[1] = 0.0
                sign_m = 0.0 if abs(torque) <= T_m else np.sign(torque)
            if sign_l * y[3] < 0.0 or sign_l == 0.0:
                y[3] = 0.0
                sign_l = 0.0 if abs(gear) <= T_l else np.sign(gear)
            done += count
        last = behind
    return 0


def first_lost(drive: PulsedDrive, steps: int, fine: float = STEP) -> tuple[int, np.ndarray]:
    """Number of the first step that is not made, 0 if all are, and the rotor before each in full
    steps.
    """
    angles = np.full(steps + 1, np.nan)
    found = _first_lost(
        drive.voltage, drive.on_time, drive.diode_voltage, drive.step_time, drive.R, drive.L, drive.K_m, drive.K_d,
        drive.J_m, drive.J_l, drive.K_g, drive.C_g, drive.ratio, drive.rotor.coulomb, drive.rotor.viscous,
        drive.output.coulomb, drive.output.viscous, drive.both_ways, steps, fine, angles,
    )  # fmt: skip
    return int(found), angles


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


def with_damping(drive: PulsedDrive, viscous: float) -> PulsedDrive:
    return replace(drive, rotor=replace(drive.rotor, viscous=viscous))


def at_threshold(drive: PulsedDrive, critical: float, steps: int) -> tuple[PulsedDrive, float] | None:
    """The drive with the largest damping tried with which it loses steps at LOST_BY, and that ratio;
    None where there is no such damping.
    """

    def loses(ratio: float) -> bool:
        damped = replace(with_damping(drive, ratio * critical), voltage=LOST_BY)
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
    r, counted, hidden = np.random.default_rng(asked.seed), 0, 0
    print("draw, damping ratio, first step lost at 75 V (74 V), with the clamp at +-8 V at 74 V, figures")
    for n in range(asked.draws):
        drive, critical = drawn(r)
        found = at_threshold(drive, critical, asked.steps)
        if found is None:
            continue
        just, ratio = found
        if first_lost(replace(just, voltage=UNKNOWN_BELOW), asked.steps)[0]:
            continue
        right = first_lost(replace(just, voltage=LOST_BY), asked.steps)[0]
        wrong = first_lost(replace(just, voltage=WRONG_AT, both_ways=True), asked.steps)[0]
        same = first_lost(replace(just, voltage=WRONG_AT), asked.steps)[0]
        counted += 1
        hidden += wrong == 0 and same > 0
        K = just.K_m
        print(
            f"{n:4d} {ratio:7.4f} {right:6d} (at 74 V {same:2d}) {wrong:6d}   {just.R:6.0f} {1e3 * just.L / just.R:6.1f} ms"
            f" {70 * K / just.R:6.3f} {just.K_d / (70 * K / just.R):6.3f} rotor {just.J_m:.2g} friction {just.rotor.coulomb:.2g}"
            f" array {just.J_l:.3g} gear {just.K_g:.3g} output {just.output.coulomb:.2g}",
            flush=True,
        )
    print(
        f"{asked.draws} draws; {counted} make all {asked.steps} steps at 65 V and lose some at 75 V;"
        f" of these {hidden} lose some at 74 V and none there with the clamp at +-8 V"
    )


if __name__ == "__main__":
    main()
