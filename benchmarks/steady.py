"""The steady solver against time integration: speed and lines, on states 1-5 and on random
parameter sets.

``python benchmarks/steady.py [--sets 50] [--seed 0] [--chart 80] [--heavy 500]
[--smooth 300] [--any 300] [--rates 30]``

``--chart`` adds points of state 1's rate chart, 0.01 to 0.3 deg/s and 8 to 64 microsteps.
``--heavy`` takes slow sets in which friction weighs much instead, and compares the RMS of the
torque with that of a run from rest, ``--smooth`` drives that ramp their microsteps, beside whose
smooth turning friction may keep a mode ringing. ``--any`` takes drives of all kinds and compares RMS and
largest lines with those of a run from rest of eight decay times of the slowest mode. ``--rates``
plans rates of such drives with a limit that half of them pass, and looks at what a run from rest
has at each rate that is allowed.

Nothing is asserted. Machines differ: only the ratios and deviations mean something elsewhere.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.scenarios import heavy_scenario, random_scenario, scenario_of_any_kind, smooth_scenario
from support.steady_lines import long_run, settled_motion, slowest, worst_deviation

import microvib as mv
from microvib.signals.line_table import Line
from microvib.solve.batch import simulate_torques
from microvib.solve.steady.period import NotPeriodic
from microvib.solve.steady.state import SteadyState, find_steady, steady_state
from microvib.studies.rates import at_rate, plan_rates, rate_grid
from microvib.units import Si

STATES = ("state-1", "state-2", "state-3", "state-4", "state-5")


def main() -> None:
    """Print one row for each state and set, then the worst deviation and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--chart", type=int, default=0)
    parser.add_argument("--heavy", type=int, default=0)
    parser.add_argument("--smooth", type=int, default=0)
    parser.add_argument("--any", type=int, default=0)
    parser.add_argument("--rates", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.rates:
        allowed_rates(range(arguments.seed, arguments.seed + arguments.rates))
        return
    if arguments.any:
        of_any_kind(range(arguments.seed, arguments.seed + arguments.any))
        return
    if arguments.heavy:
        from_rest(heavy_scenario, range(arguments.seed, arguments.seed + arguments.heavy))
        return
    if arguments.smooth:
        from_rest(smooth_scenario, range(arguments.seed, arguments.seed + arguments.smooth))
        return
    steady_state(mv.load_scenario("state-1"))  # compiles, or loads what was compiled
    mv.simulate(mv.load_scenario("state-1"))
    print(
        "settled: time integration settles until its slowest mode has rung down to 1e-6; its lines are the reference"
    )
    print(
        f"{'case':10s} {'deg/s':>7s} {'n':>3s} {'periods':>8s} {'steady ms':>10s} {'30+16 s':>8s} {'to 1 %':>8s}"
        f" {'deviation':>10s}  line"
    )
    named = [(name, mv.load_scenario(name)) for name in STATES]
    rows = [_row(name, scenario) for name, scenario in named]
    rows += [
        _row(f"set {k}", random_scenario(k))
        for k in range(arguments.seed, arguments.seed + arguments.sets)
    ]
    rows += [_row(f"chart {k}", chart_point(k)) for k in range(arguments.chart)]
    found = [row for row in rows if row is not None]
    worst = max(row[2] for row in found)
    nominal, settled = ([row[j] for row in found] for j in (0, 1))
    print(
        f"\nsteady states found: {len(found)} of {len(rows)}; worst deviation of a line {100 * worst:.2f} %"
    )
    print(
        f"times as fast as settling 30 s and recording 16 s: median {np.median(nominal):.0f}, least {min(nominal):.1f}"
    )
    print(
        f"times as fast as settling to 1 % and recording 16 s: median {np.median(settled):.0f}, least {min(settled):.1f}"
    )


def _row(name: str, scenario: mv.Scenario) -> tuple[float, float, float] | None:
    head = f"{name:10s} {math.degrees(scenario.rate):7.3f} {scenario.driver.microsteps:3d}"
    try:
        steady, state = _best_of(20, lambda: steady_state(scenario))
    except NotPeriodic as why:
        print(f"{head}  falls back: {why}", flush=True)
        return None
    to_percent = scenario.with_si({"record.settle": max(30.0, math.log(100.0) * slowest(scenario))})
    nominal, _ = _best_of(3, lambda: mv.simulate(scenario, channels=("T_d",)))
    settled, _ = _best_of(3, lambda: mv.simulate(to_percent, channels=("T_d",)))
    deviation, line = worst_deviation(state, settled_motion(scenario))
    print(
        f"{head} {state.solver['periods_evaluated']:8.2f} {1e3 * steady:10.1f} {nominal / steady:8.1f} {settled / steady:8.1f}"
        f" {100 * deviation:8.3f} %  {line}",
        flush=True,
    )
    return nominal / steady, settled / steady, deviation


def _best_of(runs: int, call: Callable[[], Any]) -> tuple[float, Any]:
    """Least processor time of some runs [s], since other processes disturb; and the result."""
    times = []
    for _ in range(runs):
        begun = time.process_time()
        result = call()
        times.append(time.process_time() - begun)
    return min(times), result


def from_rest(drawn: Callable[[int], mv.Scenario], seeds: Sequence[int]) -> None:
    """Print the ``drawn`` sets whose torque is off by more than 3 % RMS from that of a run from rest after
    eight of its slowest decays.
    """
    reasons: Counter[str] = Counter()
    found = []
    for seed in seeds:
        scenario = drawn(seed)
        try:
            state = steady_state(scenario)
        except NotPeriodic as why:
            reasons["".join(c for c in str(why) if not c.isdigit())[:70]] += 1
        else:
            found.append((seed, state))
    wrong = 0
    for start in range(0, len(found), 32):
        part = found[start : start + 32]
        for (seed, state), run in zip(
            part, simulate_torques([long_run(state) for _, state in part]), strict=True
        ):
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
    print(
        f"\nsteady states found: {len(found)} of {len(seeds)}; more than 3 % RMS off a run from rest: {wrong}"
    )
    for reason, count in reasons.most_common():
        print(f"{count:5d} fall back: {reason}")


FALSE = 0.03
"""Deviation from a run from rest, of the RMS or of a line over the largest, from which a steady
state is false.
"""
DECAYS, LONGEST = 8.0, 4000.0
"""Decay times of the slowest mode before that run's record, and the time [s] that they may take."""


def of_any_kind(seeds: Sequence[int]) -> None:
    """Print the sets of any kind whose steady state is not that of a run from rest, and what falls
    back, counted.
    """
    reasons: Counter[str] = Counter()
    found, false, times = 0, 0, []
    for seed in seeds:
        scenario = scenario_of_any_kind(seed)
        begun = time.process_time()
        state, why = find_steady(scenario)
        times.append(time.process_time() - begun)
        if state is None:
            reasons["".join(c for c in why if not c.isdigit())[:90]] += 1
            continue
        found += 1
        settle = _settling(state)
        off, what = _off(state, settle)
        if off > FALSE:
            print(f"set {seed}: {what} off by {100 * off:.3g} % after {settle:.0f} s", flush=True)
            later = min(4.0 * settle, LONGEST)  # irregular transients end late
            off, what = _off(state, later)
            print(f"set {seed}: {what} off by {100 * off:.3g} % after {later:.0f} s", flush=True)
        false += off > FALSE
        if (seed + 1) % 25 == 0:
            print(f"up to set {seed}: {found} found, {false} of them false", flush=True)
    print(
        f"\nsteady states found: {found} of {len(seeds)}, {false} of them false; {1e3 * np.mean(times):.0f} ms each"
    )
    for reason, count in reasons.most_common():
        print(f"{count:5d} fall back: {reason}")


def _off(state: SteadyState, settle: float) -> tuple[float, str]:
    """Largest deviation of RMS and of the six largest lines in the record's band from those of a run
    from rest after ``settle`` [s], and of what.
    """
    scenario, band = state.scenario, 0.33 * state.scenario.record.sample_rate
    duration = max(math.ceil(16.0 * state.frequency), 1) / state.frequency
    [run] = simulate_torques(
        [scenario.with_si({"record.settle": settle, "record.duration": duration})]
    )
    if isinstance(run, Exception):
        return math.inf, str(run)
    frequency = np.arange(state.T_d.size // 2) * state.frequency
    lines = np.abs(state.harmonics()) * (frequency < band)
    lines[0] = 0.0
    spectrum = np.fft.rfft(run.T_d) * (np.fft.rfftfreq(run.T_d.size, 1.0 / run.sample_rate) < band)
    spectrum[0] = 0.0
    in_time = float(np.sqrt(2.0 * np.sum(np.abs(spectrum) ** 2))) / run.T_d.size
    largest = np.argsort(-lines)[:6]
    turned = np.exp(
        -2j * np.pi * np.outer(frequency[largest], np.arange(run.T_d.size)) / run.sample_rate
    )
    off = np.abs(np.abs(turned @ run.T_d) * 2.0 / run.T_d.size - lines[largest]) / np.max(lines)
    rms = abs(float(np.sqrt(np.sum(lines**2) / 2.0)) / in_time - 1.0)
    return (
        (rms, "RMS")
        if rms > np.max(off)
        else (float(np.max(off)), f"{frequency[largest[np.argmax(off)]]:.4g} Hz")
    )


def _settling(state: SteadyState) -> float:
    """Time [s] in which a run from rest has settled."""
    decay = min(m.decay for m in mv.coupled_modes(state.scenario) if m.frequency > 0.0)
    slow = DECAYS * max(1.0 / decay, state.solver["settling_s"] / math.log(100.0))
    ran = 1.5 * state.solver.get("arrived_s", 0.0)  # it may have rung for long
    return min(max(60.0, slow, ran), LONGEST)


RATES = 6
"""Rates of each drive that is planned, from a third to three times its own."""


def allowed_rates(seeds: Sequence[int]) -> None:
    """Print the rates that a plan allows and at which a run from rest has a line above the limit."""
    band, allowed, false, steady = (0.1, 300.0), 0, 0, 0
    for seed in seeds:
        scenario = scenario_of_any_kind(seed)
        rate = abs(math.degrees(float(scenario.rate or 0.0)))
        grid = rate_grid(f"{rate / 3.0} deg/s", f"{3.0 * rate} deg/s", RATES)
        cases = plan_rates(scenario, grid, band=f"{band[0]}:{band[1]} Hz", workers=1).cases
        limit = float(
            np.median(
                [line.amplitude for case in cases if (line := case.largest(band)) is not None]
            )
        )
        for case in (case for case in cases if not case.verdict(band, limit)):
            allowed += 1
            turning = at_rate(scenario, Si(case.rate), case.microsteps)
            state, _ = find_steady(turning)
            if state is None:
                continue
            steady += 1
            late = turning.with_si({"record.settle": _settling(state), "record.duration": 16.0})
            inside = [
                x.amplitude
                for x in mv.find_lines(mv.simulate(late, channels=("T_d",)))
                if _in(x, band)
            ]
            if max(inside, default=0.0) > (1.0 + FALSE) * limit:
                false += 1
                print(
                    f"set {seed}, {math.degrees(case.rate):.6g} deg/s: {max(inside):.4g} N m, limit {limit:.4g}"
                )
        print(
            f"up to set {seed}: {allowed} allowed, {steady} with a steady state, {false} false",
            flush=True,
        )


def _in(line: Line, band: tuple[float, float]) -> bool:
    """Whether a line of a run has an amplitude and lies within a ``band`` [Hz]."""
    return band[0] <= line.frequency <= band[1] and line.amplitude > 0.0


def chart_point(k: int) -> mv.Scenario:
    """State 1 at a rate and microstep count; the rates fill their range evenly, however many points
    there are.
    """
    rate = 0.01 + 0.29 * (k * (math.sqrt(5.0) - 1.0) / 2.0 % 1.0)
    return mv.load_scenario("state-1").with_(
        {"tracking.rate": f"{rate} deg/s", "driver.microsteps": 8 << k % 4}
    )


if __name__ == "__main__":
    main()
