"""Lines of a steady state beside those of time integrations."""

import math

import microvib as mv
from microvib.solve.steady.state import SteadyState

LEAST = 0.01
"""Lines of at least this part of the largest are compared."""


def slowest(scenario: mv.Scenario) -> float:
    """Longest time constant of the array's modes [s]."""
    return max(1.0 / (2.0 * math.pi * m.frequency * m.damping) for m in scenario.array.modes)


def settled_motion(scenario: mv.Scenario) -> mv.Motion:
    """Time integration after the slowest mode has rung down to 1e-6, recorded long enough to tell
    the lines apart.
    """
    long = scenario.with_si(
        {"record.settle": max(60.0, math.log(1e6) * slowest(scenario)), "record.duration": 64.0}
    )
    return mv.simulate(long, channels=("T_d",))


def worst_deviation(state: SteadyState, motion: mv.Motion) -> tuple[float, str]:
    """Largest relative deviation of an amplitude from time integration, of lines of at least LEAST,
    and its line.
    """
    steady, in_time = mv.find_lines(state), mv.find_lines(motion)
    top = max(line.amplitude for line in steady if line.amplitude > 0.0)
    worst, name = 0.0, ""
    for line in in_time:
        if line.kind in ("array mode", "other") or not line.amplitude > 0.0:
            continue
        other = steady[line.name].amplitude
        if max(other, line.amplitude) < LEAST * top:
            continue
        deviation = abs(other / line.amplitude - 1.0)
        if deviation > worst:
            worst, name = deviation, line.name
    return worst, name


def long_run(state: SteadyState) -> mv.Scenario:
    """The scenario with time to settle, and a record of whole periods."""
    settle = max(60.0, 8.0 * slowest(state.scenario), state.solver["settling_s"])
    periods = max(math.ceil(10.0 * state.frequency), 1)
    return state.scenario.with_si(
        {"record.settle": settle, "record.duration": periods / state.frequency}
    )
