"""Lines of random legal sets by both methods of integration, against rodas4 with ``solver.refinement`` 4.

``python benchmarks/random_sets.py [--sets 372] [--seed 0] [--settle 1] [--record 4]``

Printed is each set in which a line of at least a hundredth of the largest is off by more than 0.5 %, with whether the reference
itself agrees with one of refinement 8; then how many there are, the median of the worst lines, and the processor time of
``simulate`` and of the torque alone over rodas4's.

Nothing is asserted. Machines differ: only ratios and deviations mean something elsewhere.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.line_errors import worst_change
from support.scenarios import random_scenario

import microvib as mv
from microvib.analysis.accuracy import BOUND
from microvib.signals.line_table import LineTable
from microvib.solve.batch import torque_from_rest

METHODS = ("propagators", "rodas4")


def main() -> None:
    """Print what is off, then the sums."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=372)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--settle", type=float, default=1.0)
    parser.add_argument("--record", type=float, default=4.0)
    arguments = parser.parse_args()
    record = {"record.settle": arguments.settle, "record.duration": arguments.record}
    for method in METHODS:  # loads what was compiled
        _solved(random_scenario(0).with_si(record | {"solver.method": method}))
    worst, times = [], []
    for k in range(arguments.seed, arguments.seed + arguments.sets):
        scenario = random_scenario(k).with_si(record)
        exact = mv.lines(mv.simulate(scenario.with_si({"solver.method": "rodas4", "solver.refinement": 4})))
        found = [_solved(scenario.with_si({"solver.method": method})) for method in METHODS]
        off = [worst_change(table, exact) for table, *_ in found]
        worst.append([line for line, _ in off])
        times.append([(seconds, alone) for _, seconds, alone in found])
        if max(worst[-1]) > BOUND:
            finest = mv.lines(mv.simulate(scenario.with_si({"solver.method": "rodas4", "solver.refinement": 8})))
            said = ", ".join(f"{m} {100 * x:.3g} % ({name})" for m, (x, name) in zip(METHODS, off, strict=True))
            print(
                f"set {k:4d}: {said}; the reference changes by {100 * worst_change(exact, finest)[0]:.2g} %", flush=True
            )
    print(f"\n{arguments.sets} sets; off by more than {100 * BOUND:g} %, median of the worst lines")
    for method, lines in zip(METHODS, np.array(worst).T, strict=True):
        print(f"{method:12s} {np.sum(lines > BOUND):4d}   {100 * np.median(lines):.4f} %")
    ratios = np.array(times)[:, 0] / np.array(times)[:, 1]
    for what, ratio in zip(("all channels", "torque alone"), ratios.T, strict=True):
        print(f"processor time over rodas4's, {what}: median {np.median(ratio):.2f}, worst {ratio.max():.2f}")


def _solved(scenario: mv.Scenario) -> tuple[LineTable, float, float]:
    """Lines, and processor time of the motion and of the torque alone [s], the least of three each."""
    motion, moved = _timed(mv.simulate, scenario)
    _, alone = _timed(torque_from_rest, scenario)
    return mv.lines(motion), moved, alone


def _timed(solve: Callable[[mv.Scenario], Any], scenario: mv.Scenario) -> tuple[Any, float]:
    """What it gives, and its least processor time [s] of three."""
    seconds = []
    for _ in range(3):
        begun = time.process_time()
        found = solve(scenario)
        seconds.append(time.process_time() - begun)
    return found, min(seconds)


if __name__ == "__main__":
    main()
