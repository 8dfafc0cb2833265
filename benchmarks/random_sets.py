"""Lines of random legal sets against RODAS4 (``tests/support/rodas4``) with ``solver.refinement``
4.

``python benchmarks/random_sets.py [--sets 372] [--seed 0] [--settle 1] [--record 4]``

Printed is each set in which a line of at least a hundredth of the largest is off by more than 0.5
%, with whether the reference itself agrees with one of refinement 8; then how many there are, the
median of the worst lines, and the processor time of ``simulate`` and of the torque alone over
RODAS4's with all channels.

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
from support import rodas4
from support.line_errors import worst_change
from support.scenarios import random_scenario

import microvib as mv
from microvib.analysis.accuracy import MAX_LINE_CHANGE
from microvib.signals.line_table import LineTable
from microvib.solve.batch import torque_from_rest


def main() -> None:
    """Print what is off, then the sums."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=372)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--settle", type=float, default=1.0)
    parser.add_argument("--record", type=float, default=4.0)
    arguments = parser.parse_args()
    record = {"record.settle": arguments.settle, "record.duration": arguments.record}
    _measured(random_scenario(0).with_si(record))  # loads what was compiled
    worst, times = [], []
    for k in range(arguments.seed, arguments.seed + arguments.sets):
        scenario = random_scenario(k).with_si(record)
        exact = mv.find_lines(rodas4.simulate(scenario.with_si({"solver.refinement": 4})))
        table, seconds = _measured(scenario)
        off, name = worst_change(table, exact)
        worst.append(off)
        times.append(seconds)
        if off > MAX_LINE_CHANGE:
            finest = mv.find_lines(rodas4.simulate(scenario.with_si({"solver.refinement": 8})))
            changes = worst_change(exact, finest)[0]
            print(
                f"set {k:4d}: {100 * off:.3g} % ({name}); the reference changes by {100 * changes:.2g} %",
                flush=True,
            )
    lines = np.array(worst)
    print(
        f"\n{arguments.sets} sets; {np.sum(lines > MAX_LINE_CHANGE)} off by more than {100 * MAX_LINE_CHANGE:g} %"
    )
    print(f"median of the worst lines {100 * np.median(lines):.4f} %")
    for what, ratio in zip(("all channels", "torque alone"), np.array(times).T, strict=True):
        print(
            f"processor time over RODAS4's, {what}: median {np.median(ratio):.2f}, worst {ratio.max():.2f}"
        )


def _measured(scenario: mv.Scenario) -> tuple[LineTable, tuple[float, float]]:
    """Lines, and processor time of the motion and of the torque alone over RODAS4's, the least of
    three each.
    """
    motion, moved = _timed(mv.simulate, scenario)
    _, alone = _timed(torque_from_rest, scenario)
    _, reference = _timed(rodas4.simulate, scenario)
    return mv.find_lines(motion), (moved / reference, alone / reference)


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
