"""What each optional part of the drive costs: processor time of a run with it over that of one
without.

``python benchmarks/parts.py [--rounds N]``

Runs take turns, and the median of their ratios is printed, with the steps per simulated second: a
part that changes the motion changes its steps, too. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from statistics import median

import microvib as mv

PARTS: dict[str, dict[str, object]] = {
    "nothing (the scatter of this table)": {},
    "gain, offsets, quadrature": {
        "driver.imperfections.gain_b": 0.012,
        "driver.imperfections.offset_a": 0.006,
        "driver.imperfections.offset_b": -0.004,
        "driver.imperfections.quadrature": 0.0157,
    },
    "8 bits": {"driver.imperfections.dac_bits": 8},
    "ramp between microsteps": {"driver.microstep_ramp": 0.5},
    "position-dependent friction": {
        "friction.position": {"harmonics": [{"order": 6000, "amplitude": 0.01}]}
    },
    "torque noise": {"friction.torque_noise": {"density": 3e-6}},
    "presliding, 1 element": {"friction.presliding": {"stiffness": 6e3, "elements": 1}},
    "presliding, 8 elements": {"friction.presliding": {"stiffness": 6e3, "elements": 8}},
    "hysteresis of the gear": {"reducer.hysteresis": {"loss": 1e-5, "stiffness": 2500.0}},
    "flux harmonic, order 3": {"motor.flux_harmonics": [{"order": 3, "amplitude": 0.025}]},
    "flux harmonics, orders 3, 5, 7": {
        "motor.flux_harmonics": [{"order": k, "amplitude": 0.025} for k in (3, 5, 7)]
    },
    "detent harmonic, order 8": {"motor.detent": [{"order": 8, "amplitude": 1e-3}]},
    "harness with friction, 3 elements": {
        "friction.harness": {
            "stiffness": 0.5,
            "friction": 5e-3,
            "presliding": {"stiffness": 50.0, "elements": 3},
        }
    },
}
"""Changes of state 1."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9, help="turns of each pair (default: 9)")
    rounds = parser.parse_args(arguments).rounds
    plain = mv.load_scenario("state-1")
    print(f"{'part':40s} {'processor time':>15s} {'steps':>8s}")
    for name, changes in PARTS.items():
        other = plain.with_si(changes)
        mv.simulate(other)  # compiles, or loads what was compiled
        ratios = []
        for _ in range(rounds):
            (with_it, more), (without, fewer) = _timed(other), _timed(plain)
            ratios.append(with_it / without)
        print(f"{name:40s} {median(ratios):14.2f}x {more / fewer:7.2f}x")


def _timed(scenario: mv.Scenario) -> tuple[float, int]:
    """Processor time [s] of a run of its torque, and its steps."""
    begun = time.process_time()
    motion = mv.simulate(scenario, channels=("T_d",))
    return time.process_time() - begun, motion.solver["steps"]


if __name__ == "__main__":
    main()
