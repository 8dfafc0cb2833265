"""The entry point of the solver: ``simulate(scenario)``."""

from __future__ import annotations

from dataclasses import replace

from microvib.errors import expect_channel, expect_list
from microvib.model.scenario import Scenario, expect_scenario
from microvib.solve.integration import Progress, simulate_from_rest
from microvib.solve.motion import Motion


def simulate(
    scenario: Scenario, *, progress: Progress | None = None, channels: tuple[str, ...] | None = None
) -> Motion:
    """Motion of ``scenario`` over its record, sampled without aliasing.

    ``progress(done, total)`` is called with simulated seconds. ``channels`` keeps only the named
    ones (of ``microvib.solve.channels``), which saves memory.

    Samples are taken at ``record.settle + k / sample_rate``, through the filter that
    ``microvib.solve.sampling`` describes: flat to 0.35 of the sample rate. With ``record.start``
    steady the motion begins in the steady state where one is found, and otherwise at rest;
    ``solver["steady"]`` says which. Raises SynchronismLost where the motor no longer follows,
    SimulationError where the solution does not stay finite.
    """
    expect_scenario(scenario)
    if channels is not None and not isinstance(channels, str):
        expect_list(channels, "channels", "['T_d', 'theta_l']")
        channels = tuple(channels)
        for name in channels:
            expect_channel(name)
    if scenario.record.start == "rest":
        return simulate_from_rest(scenario, progress=progress, channels=channels)
    from microvib.solve.steady.state import (
        find_steady,
    )  # which imports what a start from rest does without

    state, why = find_steady(scenario)
    begin = (
        (lambda **options: simulate_from_rest(scenario, **options))
        if state is None
        else state.motion
    )
    motion = begin(progress=progress, channels=channels)
    return replace(
        motion, solver={**motion.solver, "steady": "used" if state else f"not used: {why}"}
    )
