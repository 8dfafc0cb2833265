"""What friction that sticks makes of loads, integrated in time, over its bound by energy.

``python benchmarks/switching_friction.py [--drives 30] [--seed 0] [--falling]``

Draws microsteps, friction and rates of the example craft without detent torque, and loads its hub at a
frequency. The columns are the root mean square of what is beside the line of the load in four bands,
over that of the bound. ``--falling`` draws friction whose torque falls as its rate grows, of drives
that stick and for which ``record.start: steady`` finds a state; the bound is then that without the
factor that the product adds.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.sticking_in_time import integrated, rms_in_band, without_line
from support.turning_in_time import EXAMPLE, PLACE

import microvib as mv
from microvib.errors import MicrovibError
from microvib.model.drive_states import SLIDES, Sticking
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.side_lines import TurningDrives

BANDS = ((0.2, 400.0), (1.0, 400.0), (5.0, 400.0), (14.0, 16.0))
STICKS = (Sticking(rotor=False, output=True), SLIDES)


def main() -> None:
    """Print a row for each drive, then the largest ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--falling", action="store_true")
    arguments = parser.parse_args()
    random, found = np.random.default_rng(arguments.seed), list[np.ndarray]()
    print(
        f"{'sticks':>6} {'breakaway/Coulomb':>17} " + " ".join(f"{a:g}-{b:g} Hz" for a, b in BANDS)
    )
    while len(found) < arguments.drives:
        scenario, ratio = drawn(random, arguments.falling)
        if arguments.falling and not sticks_in_steady_state(falling(scenario, ratio)):
            continue
        sticks, over = compared(scenario, ratio, random)
        found.append(over)
        print(f"{sticks:6.2f} {ratio:17.2f} " + " ".join(f"{x:9.5f}" for x in over), flush=True)
    print("largest", *np.max(found, axis=0).round(4))


def drawn(random: np.random.Generator, falls: bool) -> tuple[mv.Scenario, float]:
    """A drive with Coulomb friction, and breakaway over it."""
    keys = {
        "driver.microsteps": int(random.choice([2, 4, 4, 8, 8, 16])),
        "tracking.rate": f"{random.choice([0.006, 0.01, 0.03, 0.06, 0.1])} deg/s",
        "friction.stribeck_rate": f"{random.choice([0.003, 0.01])} deg/s",
        "motor.detent_torque": "0 N*m",
    }
    torque = f"{random.choice([0.02, 0.05, 0.1, 0.2, 0.3])} N*m"
    friction = {"friction.coulomb": torque, "friction.breakaway": torque}
    damping = {f"array.modes.{i}.damping": 0.02 for i in range(4)}  # so that what rings dies away
    ratio = float(random.uniform(1.05, 2.0)) if falls else 1.0
    return mv.load_scenario(EXAMPLE).with_({**keys, **friction, **damping}), ratio


def falling(scenario: mv.Scenario, ratio: float) -> mv.Scenario:
    """The drive with a breakaway torque above Coulomb friction."""
    return scenario.with_({"friction.breakaway": f"{ratio * scenario.friction.coulomb!r} N*m"})


def sticks_in_steady_state(scenario: mv.Scenario) -> bool:
    """Whether there is a steady state, in which the output sticks."""
    try:
        return bool(mv.steady_state(scenario).stuck_output > 0.0)
    except MicrovibError:
        return False


def compared(
    scenario: mv.Scenario, ratio: float, random: np.random.Generator
) -> tuple[float, np.ndarray]:
    """Part of the time that the output is nearly at rest, and what loads make over the bound, by band."""
    f, size = float(np.exp(random.uniform(0.0, 4.0))), float(np.exp(random.uniform(-8.0, -3.0)))
    turning = TurningDrives(scenario, STICKS)
    forces = turning.craft.on_hub(PLACE) @ (size * np.array([0.0, 0.0, 0.0, 0.3, 1.0, 0.5]))
    side = turning.of_lines(np.array([f]), forces[None, :, None])
    assert side is not None
    motion = integrated(falling(scenario, ratio), f, forces, 30.0, 30.0)
    beside = without_line(motion.time, motion.los, f)
    (of_friction,) = (one for one in side.anywhere if "friction" in one.why)
    found = []
    for low, high in BANDS:
        band = {"lowest": f"{low} Hz", "highest": f"{high} Hz", "limit": "1 rad"}
        asked = [Requirement(name="a", metric="ape", axis=axis, **band) for axis in ("x", "y")]
        most = np.array([of_friction.largest(r) for r in asked])
        found.append(float(np.max(rms_in_band(motion.time, beside, low, high) / most)))
    return motion.sticks, np.array(found)


if __name__ == "__main__":
    main()
