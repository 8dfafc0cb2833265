"""What a force table would record of a scenario: simulation through a virtual bench."""

from __future__ import annotations

import numpy as np

from microvib.model.scenario import Scenario
from microvib.solve.integration import Progress
from microvib.solve.motion import Motion
from microvib.solve.simulate import simulate
from microvib.testdata.bench import Bench
from microvib.testdata.bench import measure as record
from microvib.testdata.recording import COMPONENTS, Recording

_NEEDED = ("T_d", "theta_l", "alpha_l", "eta", "eta_rate")


def measure(scenario: Scenario, bench: Bench, *, seed: int = 1, progress: Progress | None = None) -> Recording:
    """Six components that ``bench`` records of ``scenario``, from ``record.settle`` on, for as long as the bench records.

    Rate and length of the recording are the bench's. A scenario without interface participation has a torque about the drive axis
    only; the other loads are then zero, and the recording says so.
    """
    lead = min(bench.lead, scenario.record.settle)
    bench = bench.model_copy(update={"lead": lead})
    start = {"record.settle": scenario.record.settle - lead, "record.duration": bench.span}
    motion = simulate(
        scenario.with_si({**start, "record.sample_rate": bench.analog_rate}), channels=_NEEDED, progress=progress
    )
    loads, known = _loads(motion)
    recording = record(bench, loads, motion["theta_l"], scenario.array.drive_axis, seed)
    recording = recording.noted(f"simulated: {scenario.title or 'without a title'}")
    if known:
        return recording
    return recording.noted(
        f"loads but M{scenario.array.drive_axis} are not in the scenario: its array has no interface participation"
    )


def _loads(motion: Motion) -> tuple[np.ndarray, bool]:
    """Loads on the table, (6, n), and whether all six are known."""
    loads = motion.interface_loads()
    if loads is not None:
        return np.ascontiguousarray(loads.T), True
    alone = np.zeros((6, motion.time.size))
    alone[COMPONENTS.index("M" + motion.scenario.array.drive_axis)] = motion["T_d"]
    return alone, False
