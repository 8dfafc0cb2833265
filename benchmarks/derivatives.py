"""Derivatives of steady lines: what they cost, beside the steady state itself, and how good they are,
beside steady states that are closed for parameters a little larger and smaller.

``python benchmarks/derivatives.py [--sets 100] [--seed 0] [--keys 6] [--cost] [--spread]``

Drives are drawn (``tests/support/scenarios.py``, ``random_scenario``), and of each some keys. The
reference is the difference of two motions that repeat, each closed to 1e-10 of what a microstep moves
with finer steps, at two distances of the parameter; lines at which the two distances
disagree by more than a third of what is asked are of an unknown derivative and counted apart. Errors
are over the largest relative derivative of the line by any key, at least 1, as the module judges.
``--cost`` gives times for all keys at once, ``--spread`` those of cases of a rate plan with and without
ranges of twelve values: over a period of some full steps, and over one of half a turn of the rotor.

Nothing is asserted. Machines differ: only ratios and errors mean something elsewhere.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.scenarios import random_scenario

import microvib as mv
from microvib.errors import SimulationError
from microvib.solve import kernel
from microvib.solve.steady.period import PeriodMap
from microvib.solve.steady.state import SteadyState, steady_state
from microvib.studies.rates import full_case
from microvib.units import Si

LEAST, LINES = 3e-3, 24
"""Part of the largest line below which a line is left out, and how many are looked at."""
FINER = 6
"""Times by which steps are finer, beside those of derivatives: 12 times as fine as the solution's."""
NEAR, FAR = 3e-5, 1e-4
"""Distances of the parameter, over itself."""
ROUNDS = 5
RATES = (0.02, 0.05, 0.06, 0.1, 0.2)
"""Rates of the cases whose lines have spreads [deg/s]."""
RANGED = (
    "motor.torque_constant",
    "motor.detent_torque",
    "motor.rotor_inertia",
    "motor.friction.viscous",
    "driver.proportional_gain",
    "driver.integral_gain",
    "reducer.wave_generator_inertia",
    "reducer.stiffness",
    "reducer.damping",
    "friction.slip_ring.friction_factor",
    "array.rigid_inertia",
    "array.modes.0.damping",
)


def main() -> None:
    """Print a row for each drive, then the distribution of the errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keys", type=int, default=6)
    parser.add_argument("--cost", action="store_true")
    parser.add_argument("--spread", action="store_true")
    given = parser.parse_args()
    if given.spread:
        cost_of_spread()
        return
    if given.cost:
        cost()
        return
    errors, refused, unknown, lines, failed = [], 0, 0, 0, 0
    drawn = random_states(given.seed)
    for _ in range(given.sets):
        seed, state = next(drawn)
        keys = list(np.random.default_rng(seed).permutation(continuous_keys(state)))[: given.keys]
        try:
            own, off, dark = of_drive(state, keys)
        except SimulationError as why:
            failed += 1
            print(f"{seed}: none: {why}")
            continue
        given_up = np.isnan(own)
        known = ~given_up & ~dark
        errors.append(off[known])
        lines, refused = lines + own.size, refused + int(given_up.sum())
        unknown += int((dark & ~given_up).sum())
        worst = np.max(off[known], initial=0.0)
        print(
            f"{seed}: {own.size} derivatives, {given_up.sum()} refused, {(dark & ~given_up).sum()}"
            f" without reference, worst error {worst:.1e}",
            flush=True,
        )
    every = np.concatenate(errors)
    print(
        f"{given.sets} drives, {failed} refused whole; of {lines} derivatives of the others"
        f" {refused} refused, {unknown} without a reference"
    )
    for part in (0.5, 0.9, 0.95, 0.99, 1.0):
        print(f"error at {100 * part:g} %: {np.quantile(every, part):.1e}")
    print(f"within 1e-4: {100 * np.mean(every <= 1e-4):.2f} %, above 3e-3: {np.sum(every > 3e-3)}")


def random_states(seed: int):
    """Drives that have a steady state without memory, with their seeds."""
    while True:
        with suppress(SimulationError):
            yield seed, steady_state(random_scenario(seed))
        seed += 1


def continuous_keys(state: SteadyState) -> list[str]:
    """Keys of the drive's numbers other than 0."""
    return [
        key
        for key, value, _ in state.scenario.entries()
        if isinstance(value, float)
        and value != 0.0
        and np.isfinite(value)
        and key.partition(".")[0] not in ("record", "solver")
    ]


def of_drive(state: SteadyState, keys: list[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Relative derivatives (keys, lines), their errors, and where these are not known."""
    found = state.derivatives(keys)
    size = np.abs(found.amplitudes)
    large = np.sort(np.argsort(-size)[: min(LINES, int(np.sum(size > LEAST * size.max())))])
    orders = found.orders[large]
    near, far = (np.array([difference(state, k, orders, h) for k in keys]) for h in (NEAR, FAR))
    own = found.relative[:, large]
    scale = np.maximum(np.nanmax(np.abs(near), axis=0), 1.0)
    dark = ~(np.abs(near - far) <= 3e-5 * scale)
    return own, np.abs(own - near) / scale, dark


def difference(state: SteadyState, key: str, orders: np.ndarray, part: float) -> np.ndarray:
    """d ln c / d ln p by motions that are closed for two values."""
    below, here, above = (closed(state, key, orders, x) for x in (-part, 0.0, part))
    return (above - below) / (2.0 * part * here)


def closed(state: SteadyState, key: str, orders: np.ndarray, part: float) -> np.ndarray:
    """Harmonics of the motion that repeats with one value changed, with finer steps."""
    given = state.scenario
    changed = given.with_si({key: given[key] * (1.0 + part), "solver.refinement": FINER})
    before, after = given.driving_frequency, changed.driving_frequency
    if before != after:  # the period starts at the same microstep
        settle = given.record.settle * before / after
        changed = changed.with_si({"record.settle": settle})
    start = state.state.copy()  # a gear of another ratio is not wound up
    wound = (PeriodMap(x, state.microsteps).commanded_output for x in (changed, given))
    start[kernel.TL] += next(wound) - next(wound)
    try:
        return replace(state, scenario=changed, state=start).derivatives([], orders).amplitudes
    except SimulationError:
        return np.full(orders.size, np.nan, dtype=complex)


def cost() -> None:
    """Times of states 1 to 5, all their keys at once."""
    for name in ("state-1", "state-2", "state-3", "state-4", "state-5"):
        scenario = mv.load_scenario(name)
        state = steady_state(scenario)
        keys = continuous_keys(state)
        solve = least_time(lambda scenario=scenario: steady_state(scenario))
        own = least_time(lambda state=state, keys=keys: state.derivatives(keys))
        print(
            f"{name}: solve {1e3 * solve:.1f} ms, {len(keys)} keys {1e3 * own:.1f} ms,"
            f" ratio {own / solve:.2f}, of thirty keys {30 * own / len(keys) / solve:.2f}"
        )


def cost_of_spread() -> None:
    """Times of cases of a rate plan, with and without ranges."""
    short = mv.load_scenario("state-1")
    error = {"order": 2, "amplitude": 1e-4, "phase": 0.0}
    long = short.with_si({"reducer.transmission_error": [error]})
    for name, scenario in (("some full steps", short), ("half a turn of the rotor", long)):
        ranged = with_ranges(scenario)
        totals = np.zeros(2)
        for rate in RATES:
            cases = [
                lambda x=x, rate=rate: full_case(x, Si(math.radians(rate)), 16)
                for x in (scenario, ranged)
            ]
            times = np.array([least_time(case) for case in cases])
            totals += times
            lines = cases[1]().lines
            print(
                f"{name}, {rate} deg/s: {1e3 * times[0]:.1f} ms, with spreads {1e3 * times[1]:.1f} ms,"
                f" ratio {times[1] / times[0]:.2f}; {len(lines)} lines,"
                f" {sum(math.isfinite(x.spread) for x in lines)} with a spread",
                flush=True,
            )
        print(f"{name}: ratio {totals[1] / totals[0]:.2f}")


def with_ranges(scenario: mv.Scenario) -> mv.Scenario:
    """The scenario with ranges of a fifth either way of the values that data sheets lack."""
    units = {key: quantity.unit if quantity else "" for key, _, quantity in scenario.entries()}
    notes = {
        key: f"assumed; range {0.8 * scenario[key]!r} {units[key]} to {1.2 * scenario[key]!r} {units[key]}"
        for key in RANGED
    }
    return scenario.with_sources(notes)


def least_time(call) -> float:
    """Least processor time of some calls [s]."""
    call()
    times = []
    for _ in range(ROUNDS):
        begun = time.process_time()
        call()
        times.append(time.process_time() - begun)
    return min(times)


if __name__ == "__main__":
    main()
