"""How often the intervals of an identification hold the truth: many synthetic recordings, each
identified.

``python benchmarks/intervals.py [--recordings N] [--seed N] [--state N] [--mismatch PART]
[--driver] [--results FILE]``

Each recording is of a drive of its own (reducer, rotor friction, inertia and clock drawn), with
noise, and with figures that are wrong by random parts of the size that the identification states
for them. The search starts from the catalog's state. With ``--mismatch`` the rotor's inertia is
wrong by that part in the model: then no parameter must be called identifiable. With ``--driver``
errors of the driver are drawn and identified, and the time before the recording, which is known to
SETTLE_ERROR. With ``--results`` a run that was interrupted goes on. In brackets are 95 % confidence
limits of each share (Clopper and Pearson). Nothing is asserted.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.model.scenario import Scenario
from microvib.studies.evidence import Evidence, Observation, observations
from microvib.studies.identify import MODEL_ERROR, Fit, identify
from microvib.studies.identify.problem import DECAY_FLOOR, FREQUENCY_FLOOR, PHASE_FLOOR
from microvib.studies.relative_phase import phase_multiples
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
        truth = {
            f"driver.imperfections.{key}": size * random.uniform(-1.0, 1.0)
            for key, size in DRIVER.items()
        }
        truth["record.settle"] = start.record.settle + SETTLE_ERROR * random.normal()
    else:
        truth = {
            key: own[key] * (1.0 + part * random.uniform(-1.0, 1.0)) for key, part in SPREAD.items()
        }
    clock = {"tracking.clock_ratio": start.tracking.clock_ratio * random.uniform(0.995, 1.005)}
    torque = mv.simulate(start.with_si({**truth, **clock}), channels=("T_d",))["T_d"]
    table = lines_of_samples(
        torque + random.normal(0.0, NOISE, torque.size), RATE, start, measured=True
    )
    found = wrong_figures(observations(table), start, random)
    return Made(
        Evidence("made", found, table.clock_ratio, start.record.duration, RATE), {**own, **truth}
    )


def wrong_figures(
    found: Sequence[Observation], scenario: Scenario, random: np.random.Generator
) -> tuple[Observation, ...]:
    """Figures of a recording that are wrong by as much as a model and an instrument chain are
    trusted to be: phases by errors of both lines, of which the one that they are against has one
    error in all.
    """
    against = {o.against: PHASE_FLOOR * random.normal() for o in found if o.against}
    return tuple(_wrong(o, against.get(o.against, 0.0), scenario, random) for o in found)


def _wrong(
    o: Observation, against: float, scenario: Scenario, random: np.random.Generator
) -> Observation:
    error = random.normal()
    if o.is_angle:
        m, n = 1, 0
        if o.against:
            m, n = phase_multiples(o.line, o.against, scenario.motor.alike_per_turn)
        return replace(o, value=o.value + m * PHASE_FLOOR * error - n * against)
    floor = {"frequency": FREQUENCY_FLOOR, "decay": DECAY_FLOOR}.get(o.form, MODEL_ERROR)
    return replace(o, value=o.value * math.exp(floor * error))


def identified(start: Scenario, one: Made, seed: int, driver: bool) -> Fit:
    """Its identification, with ranges of ours."""
    keys = [f"driver.imperfections.{key}" for key in DRIVER] if driver else list(SPREAD)
    late = Si(SETTLE_ERROR) if driver else None
    return identify(
        start, [(one.evidence, {})], keys, starts=32, finishes=1, seed=seed, settle_error=late
    )


def told(one: Made, fit: Fit) -> dict[str, object]:
    """What is counted of one recording."""
    keys = {
        e.key: {
            "truth": one.truth[e.key], "estimate": e.estimate, "standard_error": e.standard_error,
            "interval": e.interval, "identifiable": e.identifiable, "profiled": e.profiled,
        }
        for e in fit.estimates
    }  # fmt: skip
    return {"explained": fit.goodness.explained, "converged": fit.converged, "keys": keys}


def counts(rows: Sequence[dict[str, Any]]) -> dict[str, tuple[int, int]]:
    """How often something held, of how many."""
    found = {"explained": (sum(row["explained"] for row in rows), len(rows))}
    found["not come to its end"] = (sum(not row["converged"] for row in rows), len(rows))
    for key in dict.fromkeys(key for row in rows for key in row["keys"]):
        every = [row["keys"][key] for row in rows if key in row["keys"]]
        have = [
            e for e in every if e["interval"][0] <= e["interval"][1]
        ]  # those that are not withheld
        sure = [e for e in every if e["identifiable"]]
        found[f"{key} identifiable"] = (len(sure), len(every))
        found[f"{key} from its profile"] = (sum(e["profiled"] for e in have), len(have))
        found[f"{key}: truth in its 95 % interval"] = (sum(map(_inside, have)), len(have))
        found[f"{key}, identifiable: truth in its 95 % interval"] = (
            sum(map(_inside, sure)),
            len(sure),
        )
        found[f"{key}, identifiable: within 5 % or two standard errors"] = (
            sum(map(_near, sure)),
            len(sure),
        )
    return found


def _inside(e: dict[str, Any]) -> bool:
    return bool(e["interval"][0] <= e["truth"] <= e["interval"][1])


def _near(e: dict[str, Any]) -> bool:
    return bool(
        abs(e["estimate"] - e["truth"]) <= max(0.05 * abs(e["truth"]), 2.0 * e["standard_error"])
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, identify, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=100, help="how many (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="of truths and noise (default: 1)")
    parser.add_argument(
        "--mismatch",
        type=float,
        default=0.0,
        help="error of the model's rotor inertia, such as 0.2",
    )
    parser.add_argument("--state", type=int, default=1, help="state of the catalog (default: 1)")
    parser.add_argument(
        "--driver",
        action="store_true",
        help="errors of the driver instead of reducer, friction and inertia",
    )
    parser.add_argument(
        "--results",
        type=Path,
        help="file to add each recording to; those that it has are not made again",
    )
    options = parser.parse_args(arguments)
    record = {"record.settle": SETTLE, "record.duration": DURATION[options.driver]}
    start = mv.load_scenario(f"state-{options.state}").with_si(record)
    inertia = start.motor.rotor_inertia * (1.0 + options.mismatch)
    model = start.with_si({"motor.rotor_inertia": inertia})
    asked = {name: getattr(options, name) for name in ("seed", "mismatch", "state", "driver")}
    lines = (
        options.results.read_text().splitlines()
        if options.results and options.results.exists()
        else []
    )
    known = {row["recording"]: row for line in lines if (row := json.loads(line))["of"] == asked}
    for k in range(options.recordings):
        if k in known:
            continue
        one = made(start, np.random.default_rng([options.seed, k]), options.driver)
        known[k] = {
            "of": asked,
            "recording": k,
            **told(one, identified(model, one, k, options.driver)),
        }
        if options.results:
            with options.results.open("a") as file:
                file.write(json.dumps(known[k]) + "\n")
        print(f"{k + 1} of {options.recordings} recordings", file=sys.stderr)
    for what, (n, of) in counts([known[k] for k in range(options.recordings)]).items():
        low, high = binomtest(n, of).proportion_ci(0.95) if of else (math.nan, math.nan)
        print(f"{n:4d} of {of:4d}  {what} ({100.0 * low:.0f} to {100.0 * high:.0f} %)")


if __name__ == "__main__":
    main()
