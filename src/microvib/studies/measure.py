"""Prediction of a force table's recording of a scenario: simulation through a virtual bench."""

from __future__ import annotations

import numpy as np

from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, as_scenario
from microvib.solve.integration import Progress
from microvib.solve.simulate import simulate
from microvib.testdata.bench import Bench
from microvib.testdata.bench import measure as record
from microvib.testdata.recording import Recording

_NEEDED = ("T_d", "theta_l", "alpha_l", "eta", "eta_rate")


def measure(
    scenario: GivenScenario, bench: Bench, *, seed: int = 1, progress: Progress | None = None
) -> Recording:
    """Record the six components that a virtual test bench measures, from ``record.settle`` on, for
    as long as the bench records.

    The bench stands on the ground: drive and array of a craft are measured without it. Rate and
    length of the recording are the bench's. A scenario without interface participation has a torque
    about the drive axis only; the other loads are then zero, and the recording says so.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is measured: a scenario, a name of the catalog, or the path of a scenario file.
    bench : Bench
        The bench, its sensors and its recorder.
    seed : int
        Seed of the bench's noise.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.

    Returns
    -------
    Recording
        Fx Fy Fz [N], Mx My Mz [N m], (n,) each.

    Raises
    ------
    SimulationError
        What ``simulate`` raises.
    """
    scenario = as_scenario(scenario)
    lead, axis = min(bench.lead, scenario.record.settle), scenario.array.drive_axis
    bench = bench.model_copy(update={"lead": lead})
    span = {"record.settle": scenario.record.settle - lead, "record.duration": bench.span}
    tested = scenario.with_si({**span, "record.sample_rate": bench.analog_rate, "spacecraft": None})
    motion = simulate(tested, channels=_NEEDED, progress=progress)
    notes, known = [f"simulated: {scenario.title or 'without a title'}"], motion.interface_loads()
    if scenario.spacecraft is not None:
        notes.append("drive and array on the ground, without their spacecraft")
    if known is not None:
        loads = np.ascontiguousarray(known.T)
    else:
        loads = np.zeros((6, motion.time.size))
        loads[COMPONENTS.index("M" + axis)] = motion["T_d"]
        notes.append(
            f"loads other than M{axis} are not in the scenario: its array has no interface"
            " participation"
        )
    recording = record(bench, loads, motion["theta_l"], axis, seed)
    for note in notes:
        recording = recording.noted(note)
    return recording
