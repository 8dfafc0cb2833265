"""Side lines of drives that turn, integrated in time, beside harmonic balance and its bounds.

``python benchmarks/side_lines.py [--drives 40] [--seed 0]``

Draws currents, microsteps, rates, errors of the driver and detent torque of the example craft without
dry friction, and loads the hub at a frequency. Rows in the order of how far what varies moves the
rotor; ``lines over balance`` is the largest line in time over that of harmonic balance at the same
frequency, ``over bound`` over its bound, which is infinite above a motion that the product has.
Currents are those that are asked for: the current loop is left out on both sides.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.turning_in_time import LOADS, PLACE, amplitudes, integrated, resolved, smooth_drive

import microvib as mv
from microvib.model.side_lines import VaryingDrive, varying_drives

_SETTLE, _RECORD = 24.0, 10.0
"""Seconds before lines are taken, in which modes below 1 Hz die out, and of the record."""


def main() -> None:
    """Print a row for each drive, then the largest ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    smooth = smooth_drive()
    rows = []
    for seed in range(arguments.seed, arguments.seed + arguments.drives):
        row = compared(drawn(smooth, np.random.default_rng(seed)), seed)
        if row is not None:
            rows.append(row)
            print(".", end="", flush=True, file=sys.stderr)
    print(f"\n{'seed':>5} {'motion rad':>10} {'lines over balance':>18} {'over bound':>10}")
    for seed, motion, balance, bound in sorted(rows, key=lambda row: row[1]):
        print(f"{seed:5d} {motion:10.4f} {balance:18.3f} {bound:10.3f}")
    bounded = [row for row in rows if row[3] > 0.0]
    print(
        f"{len(rows)} drives with side lines, {len(bounded)} bounded; largest in time over bound:"
    )
    print(max((row[3] for row in bounded), default=math.nan))


def drawn(smooth: mv.Scenario, random: np.random.Generator) -> mv.Scenario:
    """A drive whose spring varies by something, the scenario itself where it would not start."""
    signed = random.choice([-1.0, 1.0])
    changes: dict[str, object] = {
        "motor.current": f"{random.uniform(0.08, 0.4)} A",
        "driver.microsteps": int(random.choice([2, 4, 8, 16, 32, 64])),
        "tracking.rate": f"{signed * random.uniform(0.1, 0.4)} deg/s",
        "driver.imperfections.gain_b": float(random.uniform(-0.25, 0.25)),
        "driver.imperfections.offset_a": float(random.uniform(-0.1, 0.1)),
        "motor.detent_torque": f"{random.uniform(0.0, 3.0)} mN*m",
    }
    return smooth.with_(changes)


def compared(scenario: mv.Scenario, seed: int) -> tuple[int, float, float, float] | None:
    """Seed, motion [rad] by what varies, largest line in time over harmonic balance and over its
    bound, the latter 0 where there is none; nothing of a drive whose spring does not vary.
    """
    f = float(np.random.default_rng(1000 + seed).uniform(5.0, 12.0))
    craft, t, y = integrated(scenario, f, _SETTLE, _RECORD)
    drives: list[VaryingDrive] = varying_drives(scenario, craft)
    if not drives:
        return None
    (drive,) = drives
    loaded, forces = np.array([f]), 0.1 * (craft.on_hub(PLACE) @ LOADS)[:, None]
    motion = drive.motion(loaded, forces)[:, :, 0].T
    bounds = drive.response(loaded)
    at, beside = bounds.frequency[:, 0], bounds.orders != 0
    alike = replace(drive, with_windings=False)
    balance = replace(alike, with_margins=False).response(loaded).of_motion(motion)[:, 0]
    large = balance.max(axis=1) > 0.01 * balance[beside].max()
    counts = np.flatnonzero(beside & large & (at > 0.05) & (at < 70.0) & resolved(at, _RECORD))
    if counts.size == 0:
        return None
    found = amplitudes(t, y, np.r_[f, at[counts]])[1:]
    largest = np.unravel_index(np.argmax(found), found.shape)
    over_balance = float(found[largest] / balance[counts][largest])
    most = bounds.of_motion(motion)[counts, 0]
    over_bound = float(np.max(found / most)) if np.all(np.isfinite(most)) else 0.0
    return seed, drive.spring.motion, over_balance, over_bound


if __name__ == "__main__":
    main()
