"""Cases per second and core: torques of many scenarios at once, beside one run after the other.

``python benchmarks/batch.py [--cases N] [--rounds N]``

Times are of the processor, the least of some rounds in turn, after compiling. Nothing is asserted. BLAS is held to one thread.
"""

from __future__ import annotations

import argparse
import os

os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import njit

import microvib as mv
import microvib.solve.vector_type
from microvib.model.expected import expected_lines
from microvib.signals.line_fit import lines_at_known_clock
from microvib.solve import batch, kernel, stepper
from microvib.solve import vector as lanes
from microvib.solve.batch import Torque, simulate_torques
from microvib.solve.command import Command
from microvib.solve.pack import no_samples, pack
from microvib.solve.sampling import sample_intervals
from microvib.units import Si

TOP = 1400.0
"""Highest line looked for [Hz]."""
ONE_BY_ONE = 4
"""Scenarios of each round that run one after the other, too."""
FINEST = 8
FLOPS = {"fixed": 1833, "a state": 93, "a mode": 189}
"""Of an attempt with a compliant reducer and no transmission error, counted in the source: additions, multiplications,
divisions and roots are one each; a sine with its cosine 45, an exponential 33. Six right-hand sides 1188 + 48 a mode, the
Jacobian and its elimination 171 + 9, six solutions 312 + 114, two margins 150 + 10, momentum 12 + 8; sums of stages 65 a state,
the continuous extension 28."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=32, help="scenarios in each list (default: 32)")
    parser.add_argument("--rounds", type=int, default=5, help="rounds, of which the least time counts (default: 5)")
    options = parser.parse_args(arguments)
    state = mv.load_scenario("state-1")
    peaks = _peaks(options.rounds)
    print(f"arithmetic peak of one core: {peaks[0]:.1f} GFlop/s in single numbers, {peaks[1]:.1f} in lanes")
    for name, cases in (("state 1", [state] * options.cases), ("spread", spread(state, options.cases))):
        print(f"\n{name}, {len(cases)} cases")
        _compare(cases, options.rounds, peaks[1])
    _converge(state)
    seconds, flops = _attempt(state, options.rounds), _flops(state)
    rate = 1e-9 * flops / seconds
    print(
        f"\narithmetic of an attempt alone: {1e6 * seconds:.3f} us, {flops} flops,"
        f" {rate:.1f} GFlop/s, {100 * rate / peaks[1]:.0f} % of the peak"
    )


def spread(state: mv.Scenario, count: int) -> list[mv.Scenario]:
    """State 1 with rate, current, frictions, gear and array about as far apart as units of a batch."""
    r = np.random.default_rng(1)

    def about(value: float, part: float) -> float:
        return float(value * r.uniform(1.0 - part, 1.0 + part))

    return [
        state.with_si(
            {
                "tracking.rate": about(state.rate, 0.3),
                "motor.current": about(state.motor.current, 0.1),
                "motor.friction.viscous": about(state.motor.friction.viscous, 0.3),
                "friction.coulomb": about(state.friction.coulomb, 0.1),
                "reducer.stiffness": about(float(state.reducer.stiffness), 0.2),
                "reducer.damping": about(state.reducer.damping, 0.3),
                "array.modes.0.frequency": about(state.array.modes[0].frequency, 0.1),
            }
        )
        for _ in range(count)
    ]


def _compare(cases: list[mv.Scenario], rounds: int, peak: float) -> None:
    """Print what a case takes, one by one and at once."""
    some = cases[:: max(len(cases) // ONE_BY_ONE, 1)][:ONE_BY_ONE]
    names = ("run", "bare", "all", "loop", "lines")
    times: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(rounds + 1):  # the first compiles
        seconds, motions = _timed(lambda: [mv.simulate(case, channels=("T_d",)) for case in some])
        times["run"].append(seconds / len(some))
        bare = [_bare(case) for case in some]
        times["bare"].append(sum(bare) / len(some))
        (seconds, torques), loop = _timed_loop(lambda: _timed(lambda: simulate_torques(cases)))
        times["all"].append(seconds / len(cases))
        times["loop"].append(loop / len(cases))
        pairs = [(case, motion["T_d"]) for case, motion in zip(some, motions, strict=True)]
        times["lines"].append(_timed(lambda pairs=pairs: [_lines(*pair) for pair in pairs])[0] / len(some))
    run, bare_run, at_once, loop, lines = (min(times[name][1:]) for name in names)
    rows = (
        ("simulate()", run, run),
        ("its kernel, nothing sampled", bare_run, bare_run),
        ("simulate_torques", at_once, run),
        ("its compiled loop, T_d sampled", loop, bare_run),
        ("lines_at_known_clock", lines, math.nan),
        ("simulate() and lines", run + lines, run + lines),
        ("simulate_torques and lines", at_once + lines, run + lines),
    )
    print(f"{'':32s} {'ms a case':>10s} {'cases/s':>9s} {'ratio':>6s}")
    for name, seconds, single in rows:
        ratio = f"{single / seconds:6.2f}" if math.isfinite(single) else ""
        print(f"{name:32s} {1e3 * seconds:10.1f} {1 / seconds:9.1f} {ratio}")
    rate = 1e-9 * sum(_attempts(case) * _flops(case) for case in some) / len(some) / loop
    print(f"compiled loop: {rate:.1f} GFlop/s, {100 * rate / peak:.0f} % of the peak")
    print(f"largest difference of lines over the largest: {_difference(some, motions, torques, cases):.1e}")


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time [s] and the result."""
    begun = time.process_time()
    result = call()
    return time.process_time() - begun, result


def _timed_loop(call: Callable[[], Any]) -> tuple[Any, float]:
    """The result, and the processor time that was spent in the compiled loop of ``simulate_torques``."""
    advance, spent = stepper.advance, [0.0]

    def noted(group: Any) -> None:
        seconds, _ = _timed(lambda: advance(group))
        spent[0] += seconds

    stepper.advance = noted
    try:
        return call(), spent[0]
    finally:
        stepper.advance = advance


def _bare(scenario: mv.Scenario) -> float:
    """Processor time of the kernel alone over the same span [s]; at once, so that it ends no step for our sake."""
    packed, end = pack(scenario), sample_intervals(scenario).end
    microsteps = Command(scenario).microsteps(0.0, end)
    return _timed(lambda: packed.advance(end, no_samples(packed.channels)._replace(width=0.0), *microsteps))[0]


def _attempts(scenario: mv.Scenario) -> int:
    """Attempts at a step, those that were refused or looked for an event included."""
    packed, end = pack(scenario), sample_intervals(scenario).end
    silent = no_samples(packed.channels)._replace(width=0.0)
    packed.advance(end, silent, *Command(scenario).microsteps(0.0, end))
    return int(packed.state.counters[[kernel.STEPS, kernel.REJECTED, kernel.EVENT_STEPS]].sum())


def _flops(scenario: mv.Scenario) -> int:
    modes = len(scenario.array.modes)
    return FLOPS["fixed"] + FLOPS["a state"] * (kernel.MODES + 2 * modes) + FLOPS["a mode"] * modes


def _lines(scenario: mv.Scenario, torque: np.ndarray) -> np.ndarray:
    table = lines_at_known_clock(torque, scenario.record.sample_rate, expected_lines(scenario, Si(TOP)))
    return np.array([line.amplitude_n_m for line in table])


def _difference(
    some: list[mv.Scenario], motions: list[mv.Motion], torques: list[Any], cases: list[mv.Scenario]
) -> float:
    worst = 0.0
    for scenario, motion in zip(some, motions, strict=True):
        torque = torques[cases.index(scenario)]
        assert isinstance(torque, Torque), torque
        ours, theirs = _lines(scenario, torque.T_d), _lines(scenario, motion["T_d"])
        worst = max(worst, float(np.nanmax(np.abs(ours - theirs)) / np.nanmax(theirs)))
    return worst


def _converge(state: mv.Scenario) -> None:
    """Print how far the lines are from those of much finer steps."""
    exact = _lines(state, mv.simulate(state.with_({"solver.refinement": FINEST}), channels=("T_d",))["T_d"])
    print(f"\nlines against simulate() with refinement {FINEST}, largest difference over the largest")
    for refinement in (1, 2, 4):
        finer = state.with_({"solver.refinement": refinement})
        both = mv.simulate(finer, channels=("T_d",))["T_d"], simulate_torques([finer])[0].T_d
        run, lanes_run = (np.nanmax(np.abs(_lines(state, T_d) - exact)) / np.nanmax(exact) for T_d in both)
        print(f"refinement {refinement}: simulate() {run:.1e}, simulate_torques {lanes_run:.1e}")


def _attempt(scenario: mv.Scenario, rounds: int) -> float:
    """Time [s] of the arithmetic of one attempt of one drive, in lanes, without any decision."""
    attempt, count = stepper._attempt, 20_000

    @njit(**kernel.COMPILE)
    def repeat(group: Any, count: int) -> None:
        for _ in range(count):
            attempt(group)

    queue = batch._Queue(batch._kind(scenario), dict.fromkeys(range(lanes.WIDTH), scenario))
    for lane in range(lanes.WIDTH):
        queue._refill(lane, iter([lane]))
    queue.group.length[:] = 1e-4
    queue.group.state[kernel.MODES + 2 * len(scenario.array.modes) :][:2] = 1.0  # both slip
    repeat(queue.group, 1)
    return min(_timed(lambda: repeat(queue.group, count))[0] for _ in range(rounds)) / count / lanes.WIDTH


def _peaks(rounds: int) -> tuple[float, float]:
    """Multiplications and additions per second [1e9] in a loop of nothing else, single and in lanes."""
    count, rows = 2_000_000, lanes.rows

    @njit(fastmath={"contract"}, error_model="numpy")
    def single(x: Any, count: int) -> None:
        m, a = x[0], x[1]
        s0, s1, s2, s3, s4, s5, s6, s7, s8, s9 = x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11]
        for _ in range(count):
            s0, s1, s2, s3, s4 = s0 * m + a, s1 * m + a, s2 * m + a, s3 * m + a, s4 * m + a
            s5, s6, s7, s8, s9 = s5 * m + a, s6 * m + a, s7 * m + a, s8 * m + a, s9 * m + a
        x[2] = s0 + s1 + s2 + s3 + s4 + s5 + s6 + s7 + s8 + s9

    @njit(fastmath={"contract"}, error_model="numpy")
    def abreast_loop(array: Any, count: int) -> None:
        x = rows(array, 0, 12, 1)
        m, a, s0, s1, s2, s3, s4 = x[0], x[1], x[2], x[3], x[4], x[5], x[6]
        for _ in range(count):
            s0, s1, s2, s3, s4 = s0 * m + a, s1 * m + a, s2 * m + a, s3 * m + a, s4 * m + a
        x[2] = s0 + s1 + s2 + s3 + s4

    result = []
    for loop, x, chains in (
        (single, np.full(12, 0.5), 10),
        (abreast_loop, np.full((12, lanes.WIDTH), 0.5), 5 * lanes.WIDTH),
    ):
        loop(x, 1)
        seconds = min(_timed(lambda loop=loop, x=x: loop(x, count))[0] for _ in range(max(rounds, 5)))
        result.append(2e-9 * chains * count / seconds)
    return result[0], result[1]


if __name__ == "__main__":
    main()
