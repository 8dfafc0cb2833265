"""How often an identification asks for effects that a drive has, and for those that it does not
have.

``python benchmarks/selection.py [--recordings N] [--seed N] [--effects NAME,NAME]``

Each recording is of a drive that has each of the candidates or not, by the toss of a coin, in a
size that is drawn; with noise, and with figures that are wrong by random parts of the size that the
identification states for them. The reducer's stiffness is fitted beside. Power depends on sizes,
which the table SIZES states. The identification is ended after the selection. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np
from intervals import NOISE, RATE, wrong_figures

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.model.scenario import Scenario
from microvib.studies.evidence import Evidence, observations
from microvib.studies.identify import MODEL_ERROR, Candidate, ErrorModel, parse_fit, with_effects
from microvib.studies.identify.fit import without_start_dependence
from microvib.studies.identify.keys import DAC_BITS
from microvib.studies.identify.selection import Selector

BITS = (7, 11)
"""Whole numbers of bits that are drawn."""
SIZES: dict[str, dict[str, float]] = {
    "driver.imperfections": {
        "driver.imperfections.gain_b": 0.01,
        "driver.imperfections.offset_a": 0.005,
        "driver.imperfections.offset_b": 0.005,
        "driver.imperfections.quadrature": 0.01,
    },
    "motor.detent_torque": {"motor.detent_torque": 0.01},
    "friction.presliding": {"friction.presliding.stiffness": 6000.0},
    DAC_BITS: {},
    "reducer.hysteresis": {"reducer.hysteresis.loss": 1e-5, "reducer.hysteresis.stiffness": 2500.0},
}
"""Central sizes; half to one and a half of them are drawn."""


def asked(
    start: Scenario,
    effects: Sequence[str],
    has: Sequence[str],
    random: np.random.Generator,
    seed: int,
) -> tuple[Candidate, ...]:
    """What the recording of a drive that ``has`` some of the effects asks for."""
    drawn: dict[str, object] = {
        key: size * random.uniform(0.5, 1.5) for name in has for key, size in SIZES[name].items()
    }
    if DAC_BITS in has:
        drawn[DAC_BITS] = int(random.integers(*BITS))
    clock = {"tracking.clock_ratio": start.tracking.clock_ratio * random.uniform(0.995, 1.005)}
    stiffness = {"reducer.stiffness": float(start.reducer.stiffness) * random.uniform(0.7, 1.3)}
    torque = mv.simulate(
        with_effects(start, effects, has).with_si({**drawn, **clock, **stiffness}),
        channels=("T_d",),
    )["T_d"]
    every = with_effects(start, effects, effects)
    table = lines_of_samples(
        torque + random.normal(0.0, NOISE, torque.size), RATE, every, measured=True
    )
    found = wrong_figures(observations(table), every, random)
    evidence = Evidence("made", found, table.clock_ratio, start.record.duration, RATE)
    keys, trust = [parse_fit(start, "reducer.stiffness")], ErrorModel(MODEL_ERROR)
    tests, _ = without_start_dependence([(evidence, {})], start, keys, trust)
    return Selector(start, tests, keys, effects, trust, seed, starts=32, progress=None).run()[-1]


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, identify, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=100, help="how many (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="of drives and noise (default: 1)")
    parser.add_argument("--effects", default=",".join(SIZES), help="candidates, with commas")
    options = parser.parse_args(arguments)
    effects = options.effects.split(",")
    start = mv.load_scenario("state-1").with_si({"record.settle": 2.0, "record.duration": 8.0})
    random = np.random.default_rng(options.seed)
    count: Counter[str] = Counter()
    for k in range(options.recordings):
        has = [name for name in effects if random.uniform() < 0.5]
        told = asked(start, effects, has, random, k)
        for one in told:
            kind = "has" if one.effect in has else "has not"
            count[f"{one.effect}: drives that {'have' if kind == 'has' else 'do not have'} it"] += 1
            count[f"{one.effect}: asked for where the drive {kind} it"] += one.selected
            count[f"{one.effect}: not told where the drive {kind} it"] += not (
                one.selected or one.explained
            )
        count["any that is not there"] += any(
            one.selected and one.effect not in has for one in told
        )
        gains = ", ".join(f"{one.effect} {one.gain:.3g} of {one.limit:.3g}" for one in told)
        print(f"recording {k}, a drive with {', '.join(has) or 'none'}: {gains}", file=sys.stderr)
    print(f"of {options.recordings} recordings:")
    for what, n in sorted(count.items()):
        print(f"  {n:4d}  {what}")


if __name__ == "__main__":
    main()
