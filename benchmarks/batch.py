"""Cases per second and core: the torque alone beside all channels, with both methods.

``python benchmarks/batch.py [--cases N] [--rounds N]``

Times are of the processor, the least of some rounds in turn, after compiling. Nothing is asserted.
BLAS is held to one thread.
"""

from __future__ import annotations

import argparse
import os

os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support import rodas4

import microvib as mv
from microvib.model.expected import expected_lines
from microvib.signals.line_fit import lines_at_known_clock
from microvib.solve import kernel
from microvib.solve.batch import Torque, simulate_torques
from microvib.solve.command import Command
from microvib.solve.pack import pack
from microvib.solve.sampling import empty_sample_buffer, sample_intervals
from microvib.units import Si

TOP = 1400.0
"""Highest line looked for [Hz]."""
FINEST = 8


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=4, help="scenarios in each list (default: 4)")
    parser.add_argument(
        "--rounds", type=int, default=5, help="rounds, of which the least time counts (default: 5)"
    )
    options = parser.parse_args(arguments)
    state = mv.load_scenario("state-1")
    for name, cases in (("state 1", [state]), ("spread", spread(state, options.cases))):
        print(f"\n{name}, {len(cases)} cases")
        _compare(cases, options.rounds)
    _converge(state)


def spread(state: mv.Scenario, count: int) -> list[mv.Scenario]:
    """State 1 with rate, current, frictions, gear and array about as far apart as units of a batch."""
    r = np.random.default_rng(1)

    def about(value: float, part: float) -> float:
        return float(value * r.uniform(1.0 - part, 1.0 + part))

    return [
        state.with_si(
            {
                "tracking.rate": about(state.rate, 0.3),
                "motor.current": about(state.motor.current, 0.1),
                "motor.friction.viscous": about(state.motor.friction.viscous, 0.3),
                "friction.coulomb": about(state.friction.coulomb, 0.1),
                "reducer.stiffness": about(float(state.reducer.stiffness), 0.2),
                "reducer.damping": about(state.reducer.damping, 0.3),
                "array.modes.0.frequency": about(state.array.modes[0].frequency, 0.1),
            }
        )
        for _ in range(count)
    ]


def _compare(cases: list[mv.Scenario], rounds: int) -> None:
    """Print what a case takes, and what its lines take."""
    torques = [_torque(case) for case in cases]
    calls: dict[str, Callable[[], Any]] = {
        "simulate(), all channels": lambda: [mv.simulate(case) for case in cases],
        "simulate_torques": lambda: simulate_torques(cases),
        "its loop, nothing sampled": lambda: [_bare(case) for case in cases],
        "RODAS4, all channels": lambda: [rodas4.simulate(case) for case in cases],
        "lines_at_known_clock": lambda: [
            _lines(*pair) for pair in zip(cases, torques, strict=True)
        ],
    }
    times: dict[str, list[float]] = {row: [] for row in calls}
    for _ in range(rounds + 1):  # the first compiles, or loads what was compiled
        for row, call in calls.items():
            times[row].append(_timed(call) / len(cases))
    print(f"{'':28s} {'ms a case':>10s} {'cases/s':>9s} {'RODAS4 over this':>17s}")
    reference = min(times["RODAS4, all channels"][1:])
    for what, measured in times.items():
        seconds = min(measured[1:])
        print(f"{what:28s} {1e3 * seconds:10.1f} {1 / seconds:9.1f} {reference / seconds:17.2f}")


def _timed(call: Callable[[], Any]) -> float:
    """Processor time [s]."""
    begun = time.process_time()
    call()
    return time.process_time() - begun


def _bare(scenario: mv.Scenario) -> None:
    """The compiled loop, its tables and its command over the same span; at once, so that it ends no
    step for our sake.
    """
    packed, end = pack(scenario), sample_intervals(scenario).end
    silent = empty_sample_buffer(packed.torque_columns)._replace(width=0.0)
    status = packed.advance(end, silent, *Command(scenario).microsteps(0.0, end))
    assert status == kernel.OK


def _torque(scenario: mv.Scenario) -> np.ndarray:
    (found,) = simulate_torques([scenario])
    assert isinstance(found, Torque), found
    return found.T_d


def _lines(scenario: mv.Scenario, torque: np.ndarray) -> np.ndarray:
    table = lines_at_known_clock(
        torque, scenario.record.sample_rate, expected_lines(scenario, Si(TOP))
    )
    return np.array([line.amplitude for line in table])


def _converge(state: mv.Scenario) -> None:
    """Print how far the lines are from those of RODAS4 with much finer steps, and how many steps
    they take.
    """
    finest = state.with_({"solver.refinement": FINEST})
    exact = _lines(state, rodas4.simulate(finest, channels=("T_d",))["T_d"])
    print(
        f"\nlines against RODAS4, refinement {FINEST}: largest difference over the largest; steps a microstep"
    )
    for refinement in (1, 2, 4):
        finer = state.with_({"solver.refinement": refinement})
        motion, (torque,) = mv.simulate(finer, channels=("T_d",)), simulate_torques([finer])
        run, alone = (
            np.nanmax(np.abs(_lines(state, x) - exact)) / np.nanmax(exact)
            for x in (motion["T_d"], torque.T_d)
        )
        steps, fewer = (
            x / motion.solver["microsteps"] for x in (motion.solver["steps"], torque.steps)
        )
        print(
            f"refinement {refinement}: simulate() {run:.1e}, {steps:.0f} steps;"
            f" simulate_torques {alone:.1e}, {fewer:.0f} steps"
        )


if __name__ == "__main__":
    main()
