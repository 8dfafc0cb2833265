"""How often the intervals of an identification hold the truth: many synthetic recordings, each identified.

``python benchmarks/intervals.py [--recordings N] [--seed N] [--mismatch PART] [--driver]``

Each recording is of a drive of its own (reducer, rotor friction, inertia and clock drawn), with noise, and with figures that
are wrong by random parts of the size that the identification states for them. The search starts from the catalog's state 1. With
``--mismatch`` the rotor's inertia is wrong by that part in the model: then no parameter must be called identifiable. With
``--driver`` errors of the driver are drawn and identified, and the time before the recording, which is known to SETTLE_ERROR.
Nothing is asserted.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.model.scenario import Scenario
from microvib.studies.evidence import Evidence, Observation, observations
from microvib.studies.identify import MODEL_ERROR, Fit, identify
from microvib.studies.identify.problem import DECAY_FLOOR, FREQUENCY_FLOOR, PHASE_FLOOR
from microvib.units import Si

SPREAD = {"reducer.stiffness": 0.3, "motor.friction.viscous": 0.3, "array.rigid_inertia": 0.2}
"""Drawn parameters: largest relative deviation from the catalog's, either way."""
DRIVER = {"gain_b": 0.03, "offset_a": 0.015, "offset_b": 0.015, "quadrature": 0.026}
"""Drawn errors of the driver: largest value, either way."""
SETTLE_ERROR = 0.05
"""Standard deviation of the time before a recording [s]."""
NOISE = 1e-3
"""Standard deviation of each sample [N m]."""
SETTLE, RATE = 2.0, 4096.0
DURATION = {False: 6.0, True: 10.0}
"""Of a recording [s]; lines of the electrical period need more."""


@dataclass(frozen=True)
class Made:
    """A synthetic recording's evidence, and what made it."""

    evidence: Evidence
    truth: dict[str, float]
    """Every parameter's, drawn or not: the search may fit others along."""


def made(start: Scenario, random: np.random.Generator, driver: bool) -> Made:
    """One recording, as the identification gets it."""
    own = {name: value for name, value, _ in start.entries()}
    if driver:
        truth = {f"driver.imperfections.{key}": size * random.uniform(-1.0, 1.0) for key, size in DRIVER.items()}
        truth["record.settle"] = start.record.settle + SETTLE_ERROR * random.normal()
    else:
        truth = {key: own[key] * (1.0 + part * random.uniform(-1.0, 1.0)) for key, part in SPREAD.items()}
    clock = {"tracking.clock_ratio": start.tracking.clock_ratio * random.uniform(0.995, 1.005)}
    torque = mv.simulate(start.with_si({**truth, **clock}), channels=("T_d",))["T_d"]
    table = lines_of_samples(torque + random.normal(0.0, NOISE, torque.size), RATE, start, measured=True)
    found = tuple(wrong(o, random) for o in observations(table))
    return Made(Evidence("made", found, table.clock_ratio, start.record.duration, RATE), {**own, **truth})


def wrong(o: Observation, random: np.random.Generator) -> Observation:
    """A figure that is wrong by as much as a model and an instrument chain are trusted to be."""
    error = random.normal()
    if o.is_angle:
        return replace(o, value=o.value + PHASE_FLOOR * error)
    floor = {"frequency": FREQUENCY_FLOOR, "decay": DECAY_FLOOR}.get(o.form, MODEL_ERROR)
    return replace(o, value=o.value * math.exp(floor * error))


def identified(start: Scenario, one: Made, seed: int, driver: bool) -> Fit:
    """Its identification, with ranges of ours."""
    keys = [f"driver.imperfections.{key}" for key in DRIVER] if driver else list(SPREAD)
    late = Si(SETTLE_ERROR) if driver else None
    return identify(start, [(one.evidence, {})], keys, starts=32, finishes=1, seed=seed, settle_error=late)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, identify, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=100, help="how many (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="of truths and noise (default: 1)")
    parser.add_argument("--mismatch", type=float, default=0.0, help="error of the model's rotor inertia, such as 0.2")
    parser.add_argument(
        "--driver", action="store_true", help="errors of the driver instead of reducer, friction and inertia"
    )
    options = parser.parse_args(arguments)
    record = {"record.settle": SETTLE, "record.duration": DURATION[options.driver]}
    start = mv.load_scenario("state-1").with_si(record)
    inertia = start.motor.rotor_inertia * (1.0 + options.mismatch)
    model = start.with_si({"motor.rotor_inertia": inertia})
    random = np.random.default_rng(options.seed)
    count: Counter[str] = Counter()
    for k in range(options.recordings):
        one = made(start, random, options.driver)
        fit = identified(model, one, k, options.driver)
        count["explained"] += fit.goodness.explained
        count["not come to its end"] += not fit.converged
        for e in fit.estimates:
            truth = one.truth[e.key]
            off, near = abs(e.estimate - truth), max(0.05 * abs(truth), 2.0 * e.standard_error)
            count[f"{e.key} identifiable"] += e.identifiable
            count[f"{e.key} identifiable and within 5 % or two standard errors"] += e.identifiable and off <= near
            count[f"{e.key} identifiable and in its 95 % interval"] += (
                e.identifiable and e.interval[0] <= truth <= e.interval[1]
            )
            count[f"{e.key} in its 95 % interval"] += e.interval[0] <= truth <= e.interval[1]
            count[f"{e.key} within two standard errors"] += off <= 2.0 * e.standard_error
            count[f"{e.key} from its profile"] += e.profiled
        print(f"{k + 1} recordings: " + "; ".join(f"{n} {what}" for what, n in count.items() if n), file=sys.stderr)
    print(f"of {options.recordings} recordings:")
    for what, n in count.items():
        print(f"  {n:4d}  {what}")


if __name__ == "__main__":
    main()
