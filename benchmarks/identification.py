"""What an identification costs: simulations and processor time, beside another version of the program.

``python benchmarks/identification.py [--parameters 2 3 5] [--draws 4] [--recordings 1]
[--lacking EFFECT] [--before DIRECTORY]``

Each draw is a drive like state 1, of which as many parameters are off by up to a fifth, recorded for
20 s after 30 s with noise of 1 mN m, and once more at 0.4 A with ``--recordings 2``. The search starts
from state 1. With ``--lacking`` the recorded drive has an effect that the model has not: then the
model explains nothing, and the search takes its longest. ``--before`` names a checkout of another
version (``git worktree add DIRECTORY COMMIT``): every identification is then made by both in turn,
each in a process of its own, and estimates, intervals and verdicts are compared. What is imported at
first does not count. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

KEYS = {
    2: ["reducer.stiffness", "motor.friction.viscous"],
    3: ["reducer.stiffness", "motor.friction.viscous", "array.rigid_inertia"],
    5: [
        "reducer.stiffness",
        "motor.friction.viscous",
        "array.rigid_inertia",
        "motor.detent_torque",
        "reducer.damping",
    ],
}
"""Parameters that are drawn and fitted, by their number."""
OFF = 0.2
"""Largest part by which one is off, either way."""
DURATION, RATE, NOISE = 20.0, 4096.0, 1e-3
"""Of a recording [s, Hz, N m]."""
CURRENTS = ({}, {"motor.current": "0.4 A"})
"""Changes of the scenario in the recordings."""
LACKING: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "nothing": ({}, {}),
    "detent": ({}, {"motor.detent_torque": 0.0}),
    "flux": ({"motor.flux_harmonics": [{"order": 3, "amplitude": 0.03}]}, {}),
}
"""Changes of the recorded drive, and of the model."""


def identified(parameters: int, draw: int, recordings: int, lacking: str) -> dict[str, Any]:
    """One identification, on one core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    import scipy.linalg
    import scipy.optimize
    import scipy.stats  # noqa: F401 - not counted

    import microvib as mv
    from microvib.analysis.lines import lines_of_samples
    from microvib.studies.evidence import Evidence, observations

    random = np.random.default_rng([draw, parameters])
    start = mv.load_scenario("state-1").with_si({"record.duration": DURATION})
    truth = {key: start[key] * (1.0 + OFF * random.uniform(-1.0, 1.0)) for key in KEYS[parameters]}
    recorded, model = LACKING[lacking]
    drive, start, evidence = start.with_(recorded), start.with_(model), []
    for number, own in enumerate(CURRENTS[:recordings]):
        test = drive.with_(own)
        torque = mv.simulate(test.with_si(truth), channels="T_d")["T_d"]
        noisy = torque + random.normal(0.0, NOISE, torque.size)
        table = lines_of_samples(noisy, RATE, test, measured=True)
        found = tuple(observations(table))
        one = Evidence(f"recording {number + 1}", found, table.clock_ratio, DURATION, RATE)
        evidence.append((one, dict(own)))
    begun = time.process_time()
    fit = mv.identify(start, evidence, KEYS[parameters])
    return {
        "seconds": time.process_time() - begun,
        "simulations": fit.simulations,
        "explained": fit.goodness.explained,
        "chi-square": fit.cost,
        "keys": {
            e.key: [e.estimate, e.standard_error, *e.interval, e.identifiable]
            for e in fit.estimates
        },
    }


def by_version(source: Path, asked: Sequence[int | str]) -> dict[str, Any]:
    """The same by the program in a directory ``source``, in a process of its own."""
    command = [sys.executable, __file__, "--one", *map(str, asked)]
    own = os.environ | {"PYTHONPATH": str(source / "src")}
    made = subprocess.run(command, env=own, check=True, capture_output=True, text=True)
    result: dict[str, Any] = json.loads(made.stdout.splitlines()[-1])
    return result


def compared(before: dict[str, Any], after: dict[str, Any]) -> str:
    """How far the answers of two versions are from each other."""
    moved, wider, verdicts = 0.0, 0.0, before["explained"] == after["explained"]
    for key, (estimate, error, low, high, sure) in before["keys"].items():
        other = after["keys"].get(key, [math.nan] * 5)
        verdicts = verdicts and sure == other[4]
        moved = max(moved, abs(other[0] - estimate) / error)
        wider = max(wider, abs((other[3] - other[2]) / (high - low) - 1.0))
    verdict = "same verdicts" if verdicts else "other verdicts"
    return f"{moved:.3f} standard errors, intervals {100.0 * wider:.1f} %, {verdict}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Identify, by one version or by two in turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parameters", type=int, nargs="+", default=[2, 3, 5], choices=KEYS)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--first", type=int, default=1, help="number of the first draw")
    parser.add_argument("--recordings", type=int, default=1, choices=(1, 2))
    parser.add_argument("--before", type=Path, help="checkout of another version")
    parser.add_argument("--lacking", default="nothing", choices=LACKING)
    parser.add_argument("--one", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        *numbers, lacking = options.one
        print(json.dumps(identified(*map(int, numbers), lacking)))
        return
    here = Path(__file__).parents[1]
    for parameters in options.parameters:
        for draw in range(options.first, options.first + options.draws):
            asked = parameters, draw, options.recordings, options.lacking
            after = by_version(here, asked)
            text = f"{parameters} parameters, draw {draw}: "
            if options.before is None:
                text += f"{after['simulations']} simulations, {after['seconds']:.2f} s"
            else:
                before = by_version(options.before, asked)
                ratio = before["seconds"] / after["seconds"]
                text += (
                    f"{before['simulations']} -> {after['simulations']} simulations, "
                    f"{before['seconds']:.2f} -> {after['seconds']:.2f} s ({ratio:.2f} times); "
                    f"{compared(before, after)}"
                )
            print(text, flush=True)


if __name__ == "__main__":
    main()
