"""Lines that drives which turn and always slide make of another source's line, integrated in time, beside
harmonic balance and its bounds.

``python benchmarks/sliding_drives.py [--drives 20] [--seed 0]``

Draws currents, microsteps, rates, current loops, friction that falls with the rate, friction over the
angle, errors of the gear and detent torque of the example craft, and loads the hub at a frequency. ``lines
over balance`` is the largest line in time over that of harmonic balance at the same frequency, ``over
bound`` the largest ratio of a line above a hundredth of the largest to its bound. Drives that stick, or
whose lines have no bound, are left out.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.sliding_in_time import integrated
from support.turning_in_time import LOADS, PLACE, amplitudes, resolved, smooth_drive

import microvib as mv
from microvib.model.drive_states import SLIDES, DriveStates, craft_of_drives
from microvib.model.side_lines import VaryingDrive, varying_drives

_SETTLE, _RECORD = 20.0, 10.0
"""Seconds before lines are taken, in which what rings dies away, and of the record."""
_SLOWEST = 0.02
"""Part of the commanded rate below which a shaft counts as one that sticks."""


def main() -> None:
    """Print a row for each drive, then the largest ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    smooth, rows = smooth_drive(), []
    print(f"{'seed':>5} {'lines over balance':>18} {'over bound':>10}")
    for seed in range(arguments.seed, arguments.seed + arguments.drives):
        row = compared(drawn(smooth, np.random.default_rng(seed)), seed)
        if row is not None:
            rows.append(row)
            print(f"{seed:5d} {row[0]:18.3f} {row[1]:10.3f}", flush=True)
    print(f"{len(rows)} of {arguments.drives} drives; largest in time over bound:")
    print(f"{max((row[1] for row in rows), default=math.nan):.3f}")


def drawn(smooth: mv.Scenario, random: np.random.Generator) -> mv.Scenario:
    """A drive that slides, as a rule."""
    coulomb = random.uniform(0.02, 0.1)
    changes: dict[str, object] = {
        "motor.current": f"{random.uniform(0.15, 0.5)} A",
        "motor.detent_torque": f"{random.choice([0.0, 1.0])} mN*m",
        "driver.microsteps": int(random.choice([8, 16, 32])),
        "driver.proportional_gain": f"{random.uniform(20.0, 100.0)} V/A",
        "driver.imperfections.gain_b": float(random.choice([0.0, -0.05])),
        "tracking.rate": f"{random.choice([-1.0, 1.0]) * random.uniform(0.15, 0.4)} deg/s",
        "friction.coulomb": f"{coulomb} N*m",
        "friction.breakaway": f"{coulomb * random.uniform(1.0, 1.6)} N*m",
        "friction.stribeck_rate": f"{random.uniform(0.03, 0.2)} deg/s",
        "friction.viscous": f"{random.uniform(1.0, 4.0)} N*m*s/rad",
    }
    if random.random() < 0.5:
        errors = [{"order": k, "amplitude": f"{random.uniform(0.0, 20.0)} arcsec"} for k in (2, 4)]
        changes["reducer.transmission_error"] = errors
    if random.random() < 0.5:
        harmonic = {"order": int(random.choice([10, 100, 1000])), "amplitude": 0.2}
        changes["friction.position"] = {"harmonics": [harmonic]}
    return smooth.with_(changes)


def compared(scenario: mv.Scenario, seed: int) -> tuple[float, float] | None:
    """Largest line in time over harmonic balance and over its bound; nothing of a drive that sticks, or
    whose lines have no bound.
    """
    f = float(np.random.default_rng(1000 + seed).uniform(5.0, 12.0))
    forces = 0.01 * (DriveStates(scenario, ()).on_hub(PLACE) @ LOADS)
    found = integrated(scenario, f, forces, _SETTLE, _RECORD)
    rate, one = abs(float(scenario.rate or 0.0)), found.sticking
    if min(one.slowest_output, one.slowest_rotor / scenario.reducer.ratio) < _SLOWEST * rate:
        return None
    sticking = one, SLIDES
    drives: list[VaryingDrive] = varying_drives(
        scenario, craft_of_drives(scenario, sticking), sticking=sticking
    )
    if not drives or drives[0].unbounded:
        return None
    (drive,) = drives
    loaded = np.array([f])
    motion = drive.motion(loaded, forces[:, None])[:, :, 0].T
    bounds = drive.response(loaded)
    at, beside = bounds.frequency[:, 0], drive.orders != 0.0
    balance = replace(drive, with_margins=False).response(loaded).of_motion(motion)[:, 0]
    large = balance.max(axis=1) > 0.01 * balance[beside].max()
    counts = np.flatnonzero(beside & large & (at > 0.05) & (at < 300.0) & resolved(at, _RECORD))
    if counts.size == 0:
        return None
    there = amplitudes(found.time, found.los, np.r_[f, at[counts]])[1:]
    largest = np.unravel_index(np.argmax(there), there.shape)
    over_balance = float(there[largest] / balance[counts][largest])
    return over_balance, float(np.max(there / bounds.of_motion(motion)[counts, 0]))


if __name__ == "__main__":
    main()
