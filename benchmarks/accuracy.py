"""The estimate of the integration's error against the error itself, on states 1-5 and on random
parameter sets.

``python benchmarks/accuracy.py [--sets 110] [--seed 0] [--heavy]``

Each set is run from rest with its settings and with ``solver.refinement`` 4; printed is by how much
lines of at least a hundredth of the largest differ, beside what ``microvib.analysis.accuracy`` says
of the first run alone. ``--heavy`` takes slow sets in which friction weighs much.

Nothing is asserted. Machines differ: only ratios and deviations mean something elsewhere.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.line_errors import worst_change
from support.scenarios import heavy_scenario, random_scenario

import microvib as mv
from microvib.analysis.accuracy import MAX_LINE_CHANGE, accuracy

STATES = ("state-1", "state-2", "state-3", "state-4", "state-5")


def main() -> None:
    """Print one row for each case that is off or said to be, then how often the estimate was right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=110)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--heavy", action="store_true")
    arguments = parser.parse_args()
    draw = heavy_scenario if arguments.heavy else random_scenario
    cases = [(name, mv.load_scenario(name)) for name in STATES]
    cases += [(f"set {k}", draw(k)) for k in range(arguments.seed, arguments.seed + arguments.sets)]
    mv.simulate(cases[0][1])  # compiles, or loads what was compiled
    counts: Counter[tuple[str, str]] = Counter()
    costs = []
    for name, scenario in cases:
        try:
            said, off, cost = _row(name, scenario)
        except mv.SimulationError as error:
            print(f"{name:8s} {str(error)[:90]}")
            continue
        counts[said, off] += 1
        costs.append(cost)
    print(
        f"\nsaid of the lines, and what they are (off: one changes by more than {100 * MAX_LINE_CHANGE:g} %)"
    )
    for (said, off), count in sorted(counts.items()):
        print(f"{count:5d}  {said:10s} {off}")
    print(
        f"time of the estimate over that of the run without its lines: median {np.median(costs):.2f}"
    )


def _row(name: str, scenario: mv.Scenario) -> tuple[str, str, float]:
    begun = time.process_time()
    motion = mv.simulate(scenario)
    simulated = time.process_time()
    table = mv.find_lines(motion)
    found_lines = time.process_time()
    estimate = accuracy(motion, table)
    cost = (time.process_time() - found_lines) / (simulated - begun)
    assert estimate is not None
    finer = mv.simulate(scenario.with_({"solver.refinement": 4}), channels=("T_d",))
    T_d, exact = motion["T_d"], finer["T_d"]
    line, at = worst_change(table, mv.find_lines(finer))
    rms = float(np.std(T_d) / np.std(exact)) - 1.0
    apart = float(np.std(T_d - exact) / np.std(exact))
    said = "sensitive" if estimate.sensitive else "refine" if estimate.advised else "fine"
    off = "off" if line > MAX_LINE_CHANGE else "not off"
    if said != "fine" or off == "off" or name in STATES:
        print(
            f"{name:8s} line {100 * line:7.3f} % {at:16s} RMS {100 * rms:+8.4f} %, of the difference {100 * apart:8.3f} %;"
            f" {said}: line {100 * estimate.line:7.3f} % {estimate.name:16s} RMS {100 * estimate.rms:7.3f} %",
            flush=True,
        )
    return said, off, cost


if __name__ == "__main__":
    main()
