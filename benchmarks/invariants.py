"""Invariants of random drives against their bars, and what a coarse integration leaves of them.

``python benchmarks/invariants.py [--sets 150] [--seed 0]``

So many sets each of three kinds (any kind of drive, legal sets about the catalog's, heavy friction)
are run from rest. Printed are the largest value of each invariant, what the balance of energy
leaves at most over the electrical energy where little passes the shaft, and how often each does not
hold, also of the short balance after a run of the torque alone and of steady states; then the same
of state 1 with coarser settings.

Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.scenarios import heavy_scenario, random_scenario, scenario_of_any_kind

import microvib as mv
from microvib.solve.batch import torque_from_rest
from microvib.solve.motion import Invariants
from microvib.solve.steady.state import find_steady

COARSE = (
    {"solver.accuracy": 0.005},
    {"solver.accuracy": 0.02},
    {"solver.accuracy": 0.1},
)
"""Settings coarser than the defaults."""


def main() -> None:
    """Print the largest values of random sets, then those of coarse settings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.sets)
    for draw in (scenario_of_any_kind, random_scenario, heavy_scenario):
        _of_sets(draw.__name__, [draw(k) for k in seeds])
    for changes in COARSE:
        short = {"record.settle": 2.0, "record.duration": 4.0}
        found = mv.simulate(
            mv.load_scenario("state-1").with_si(short | changes), channels=("T_d",)
        ).invariants
        print(f"{changes}: {_parts(found)}; {', '.join(found.broken) or 'all hold'}", flush=True)


def _of_sets(name: str, scenarios: list[mv.Scenario]) -> None:
    runs, others = [], []
    for scenario in scenarios:
        short = scenario.with_si(
            {
                "record.start": "rest",
                "record.settle": min(scenario.record.settle, 5.0),
                "record.duration": min(scenario.record.duration, 8.0),
            }
        )
        try:
            runs.append(mv.simulate(short, channels=("T_d",)).invariants)
            after = torque_from_rest(short, balanced=True).after
        except mv.SimulationError:
            continue
        state, _ = find_steady(scenario, whole=False)
        others += [found for found in (after, state and state.invariants) if found is not None]
    print(f"\n{name}: {len(runs)} runs from rest, {len(others)} short balances and steady states")
    for key in runs[0].bars:
        print(f"  {key}: at most {max(getattr(one, key) for one in runs):.2g}")
    narrow = [one for one in runs if one.energy_mechanical > 1e-3]
    left = max((one.energy for one in narrow), default=0.0)
    print(
        f"  energy where energy_mechanical is above 1e-3 ({len(narrow)} runs): at most {left:.2g}"
    )
    print(
        f"  do not hold: {dict(Counter(key for one in runs for key in one.broken)) or 'none'}; of the others:",
        end=" ",
    )
    print(dict(Counter(key for one in others for key in one.broken)) or "none", flush=True)


def _parts(found: Invariants) -> str:
    return ", ".join(
        f"{key} {getattr(found, key):.2g} of {bar:.2g}" for key, bar in found.bars.items()
    )


if __name__ == "__main__":
    main()
