"""The steady solver against the run in time: speed and lines, on states 1-5 and on random parameter sets.

``python benchmarks/steady.py [--sets 50] [--seed 0] [--chart 80] [--heavy 500]``

``--chart`` adds points of state 1's rate chart, 0.01 to 0.3 deg/s and 8 to 64 microsteps. ``--heavy`` takes slow sets in which
friction weighs much instead, and compares the RMS of the torque with that of a run from rest.

Nothing is asserted. Machines differ: only the ratios and deviations mean something elsewhere.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

import numpy as np

import microvib as mv
from microvib.solve.batch import simulate_torques
from microvib.solve.steady.period import NotPeriodic
from microvib.solve.steady.state import SteadyState, steady_state

LEAST = 0.01
"""Lines of at least this part of the largest are compared."""
STATES = ("state-1", "state-2", "state-3", "state-4", "state-5")


def main() -> None:
    """Print one row for each state and set, then the worst deviation and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--chart", type=int, default=0)
    parser.add_argument("--heavy", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.heavy:
        from_rest(range(arguments.seed, arguments.seed + arguments.heavy))
        return
    steady_state(mv.load_scenario("state-1"))  # compiles, or loads what was compiled
    mv.simulate(mv.load_scenario("state-1"))
    print("settled: the run in time settles until its slowest mode has rung down to 1e-6; its lines are the reference")
    print(
        f"{'case':10s} {'deg/s':>7s} {'n':>3s} {'periods':>8s} {'steady ms':>10s} {'30+16 s':>8s} {'to 1 %':>8s}"
        f" {'deviation':>10s}  line"
    )
    named = [(name, mv.load_scenario(name)) for name in STATES]
    rows = [_row(name, scenario) for name, scenario in named]
    rows += [_row(f"set {k}", random_scenario(k)) for k in range(arguments.seed, arguments.seed + arguments.sets)]
    rows += [_row(f"chart {k}", chart_point(k)) for k in range(arguments.chart)]
    found = [row for row in rows if row is not None]
    worst = max(row[2] for row in found)
    nominal, settled = ([row[j] for row in found] for j in (0, 1))
    print(f"\nsteady states found: {len(found)} of {len(rows)}; worst deviation of a line {100 * worst:.2f} %")
    print(
        f"times as fast as settling 30 s and recording 16 s: median {np.median(nominal):.0f}, least {min(nominal):.1f}"
    )
    print(
        f"times as fast as settling to 1 % and recording 16 s: median {np.median(settled):.0f}, least {min(settled):.1f}"
    )


def _row(name: str, scenario: mv.Scenario) -> tuple[float, float, float] | None:
    slowest = max(1.0 / (2.0 * math.pi * m.frequency * m.damping) for m in scenario.array.modes)
    head = f"{name:10s} {math.degrees(scenario.rate):7.3f} {scenario.driver.microsteps:3d}"
    try:
        steady, state = _best_of(20, lambda: steady_state(scenario))
    except NotPeriodic as why:
        print(f"{head}  falls back: {why}", flush=True)
        return None
    to_percent = scenario.with_si({"record.settle": max(30.0, math.log(100.0) * slowest)})
    nominal, _ = _best_of(3, lambda: mv.simulate(scenario, channels=("T_d",)))
    settled, _ = _best_of(3, lambda: mv.simulate(to_percent, channels=("T_d",)))
    deviation, line = worst_deviation(state, settled_motion(scenario, slowest))
    print(
        f"{head} {state.solver['periods_evaluated']:8.2f} {1e3 * steady:10.1f} {nominal / steady:8.1f} {settled / steady:8.1f}"
        f" {100 * deviation:8.3f} %  {line}",
        flush=True,
    )
    return nominal / steady, settled / steady, deviation


def _best_of(runs: int, call: Callable[[], Any]) -> tuple[float, Any]:
    """Least processor time of some runs [s], for other processes disturb; and the result."""
    times = []
    for _ in range(runs):
        begun = time.process_time()
        result = call()
        times.append(time.process_time() - begun)
    return min(times), result


def settled_motion(scenario: mv.Scenario, slowest: float) -> mv.Motion:
    """The run in time after ``slowest`` [s] x 13.8, recorded long enough to tell the lines apart."""
    long = scenario.with_si({"record.settle": max(60.0, math.log(1e6) * slowest), "record.duration": 64.0})
    return mv.simulate(long, channels=("T_d",))


def worst_deviation(state: SteadyState, motion: mv.Motion) -> tuple[float, str]:
    """Largest relative deviation of an amplitude from the run in time, of lines of at least LEAST, and its line."""
    steady, in_time = mv.lines(state), mv.lines(motion)
    top = max(line.amplitude_n_m for line in steady if line.amplitude_n_m > 0.0)
    worst, name = 0.0, ""
    for line in in_time:
        if line.kind in ("array mode", "other") or not line.amplitude_n_m > 0.0:
            continue
        other = steady[line.line].amplitude_n_m
        if max(other, line.amplitude_n_m) < LEAST * top:
            continue
        deviation = abs(other / line.amplitude_n_m - 1.0)
        if deviation > worst:
            worst, name = deviation, line.line
    return worst, name


def from_rest(seeds: Sequence[int]) -> None:
    """Print the sets whose torque is off by more than 3 % RMS from that of a run from rest after eight of its slowest decays."""
    reasons: Counter[str] = Counter()
    found = []
    for seed in seeds:
        scenario = heavy_scenario(seed)
        try:
            state = steady_state(scenario)
        except NotPeriodic as why:
            reasons["".join(c for c in str(why) if not c.isdigit())[:70]] += 1
        else:
            found.append((seed, state))
    wrong = 0
    for start in range(0, len(found), 32):
        part = found[start : start + 32]
        for (seed, state), run in zip(part, simulate_torques([_long(state) for _, state in part]), strict=True):
            if isinstance(run, Exception):
                wrong += 1
                print(f"set {seed}: the run fails: {run}")
                continue
            steady, in_time = float(np.std(state["T_d"])), float(np.std(run.T_d))
            if abs(steady / in_time - 1.0) > 0.03:
                wrong += 1
                print(
                    f"set {seed}: {1e3 * steady:.4g} mN m RMS steady, {1e3 * in_time:.4g} in the run from rest",
                    flush=True,
                )
    print(f"\nsteady states found: {len(found)} of {len(seeds)}; more than 3 % RMS off a run from rest: {wrong}")
    for reason, count in reasons.most_common():
        print(f"{count:5d} fall back: {reason}")


def _long(state: SteadyState) -> mv.Scenario:
    """The scenario with time to settle, and a record of whole periods."""
    slowest = max(1.0 / (2.0 * math.pi * m.frequency * m.damping) for m in state.scenario.array.modes)
    settle = max(60.0, 8.0 * slowest, state.solver["settling_s"])
    periods = max(math.ceil(10.0 * state.frequency), 1)
    return state.scenario.with_si({"record.settle": settle, "record.duration": periods / state.frequency})


def heavy_scenario(seed: int) -> mv.Scenario:
    """A slow set about state 1 in which friction weighs much and falls with the rate."""
    r = np.random.default_rng(10_000 + seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(r.uniform(math.log(low), math.log(high))))

    coulomb = between(0.02, 0.3)
    return random_scenario(seed).with_si(
        {
            "friction.coulomb": coulomb,
            "friction.breakaway": coulomb + between(0.005, 0.15),
            "friction.stribeck_rate": math.radians(between(0.001, 0.1)),
            "friction.viscous": between(0.005, 1.0),
            "tracking.rate": math.radians(between(0.004, 0.06)) * float(r.choice([-1, 1])),
            "tracking.clock_ratio": 1.0,
        }
    )


def chart_point(k: int) -> mv.Scenario:
    """State 1 at a rate and microstep count; the rates fill their range evenly, however many points there are."""
    rate = 0.01 + 0.29 * (k * (math.sqrt(5.0) - 1.0) / 2.0 % 1.0)
    return mv.load_scenario("state-1").with_({"tracking.rate": f"{rate} deg/s", "driver.microsteps": 8 << k % 4})


def random_scenario(seed: int) -> mv.Scenario:
    """A legal set drawn about state 1: drive, gear (one in seven rigid), frictions, one to four modes, rate and microsteps."""
    r = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(r.uniform(math.log(low), math.log(high))))

    def some(low: float, high: float) -> float:
        return float(r.uniform(low, high))

    current, coulomb = some(0.3, 1.2), some(0.0, 0.1)
    on_rotor = some(0.0, 0.005) if r.random() < 0.5 else 0.0
    inertia, rigid = between(1.0, 60.0), between(0.02, 0.5)
    count = int(r.integers(1, 5))
    share = r.dirichlet(np.r_[20.0, np.ones(count - 1)])
    frequencies = np.sort([between(0.2, 10.0) for _ in range(count)])
    return mv.load_scenario("state-1").with_si(
        {
            "motor.current": current,
            "motor.torque_constant": some(0.15, 0.4),
            "motor.detent_torque": current * some(0.0, 0.015),
            "motor.winding_inductance": between(3e-3, 3e-2),
            "motor.friction.viscous": between(0.005, 0.06),
            "motor.friction.coulomb": on_rotor,
            "motor.friction.breakaway": on_rotor * some(1.0, 1.5),
            "driver.microsteps": int(r.choice([4, 8, 16, 32, 64])),
            "driver.proportional_gain": between(50.0, 1000.0),
            "driver.integral_gain": between(500.0, 20_000.0) if r.random() < 0.5 else 0.0,
            "driver.supply_voltage": None if r.random() < 0.5 else 6.0 * current * some(1.3, 4.0),
            "reducer.stiffness": "rigid" if r.random() < 1 / 7 else between(3000.0, 30_000.0),
            "reducer.damping": between(0.2, 10.0),
            "reducer.ratio": float(r.choice([50, 80, 100, 160])),
            "friction.coulomb": coulomb,
            "friction.breakaway": coulomb + some(0.0, 0.05),
            "friction.stribeck_rate": math.radians(between(0.001, 0.05)),
            "friction.viscous": between(0.005, 5.0),
            "friction.slip_ring.contact_pairs": int(r.integers(0, 400)),
            "array.inertia": inertia,
            "array.rigid_inertia": None,
            "array.modes": [
                {"frequency": float(f), "damping": some(0.005, 0.02), "effective_inertia": float((inertia - rigid) * s)}
                for f, s in zip(frequencies, share, strict=True)
            ],
            "tracking.rate": math.radians(between(0.01, 0.3)) * float(r.choice([-1, 1])),
            "tracking.clock_ratio": some(0.99, 1.01),
        }
    )


if __name__ == "__main__":
    main()
