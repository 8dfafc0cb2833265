"""Disturbance torques of many scenarios: ``simulate_torques(scenarios)``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.errors import SimulationError, expect, expect_list
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.integration import Progress, Simulation
from microvib.solve.motion import BALANCE_TOLERANCE, Invariants


@dataclass(frozen=True)
class Torque:
    """Disturbance torque of one scenario over its record."""

    scenario: Scenario
    T_d: np.ndarray
    """Samples [N m], (n,), as in a ``Motion``."""
    sample_rate: float
    """Samples per second [Hz]."""
    stuck_output: float
    """Fraction of the record that the output shaft sticks."""
    steps: int
    """Steps taken, settling included."""
    momentum: float
    """Momentum that stops removed (each within its tolerance), as a mean torque, over the largest
    T_d.
    """
    after: Invariants | None = None
    """Invariants of the motion that follows for some microsteps; None where they were not asked
    for, or it stops.
    """

    @property
    def broken(self) -> tuple[str, ...]:
        """Names of the invariants that do not hold, of those that are known: momentum of the
        record, others of what follows.
        """
        own = () if self.momentum <= BALANCE_TOLERANCE else ("momentum",)
        followed = () if self.after is None else self.after.broken
        return (*own, *(name for name in followed if name != "momentum"))

    def __repr__(self) -> str:
        return (
            f"Torque of {self.scenario.brief}: {self.T_d.size} samples at {self.sample_rate:g} Hz"
        )

    def __getitem__(self, name: str) -> np.ndarray:
        """As of a ``Motion``, which has other channels too."""
        return {"T_d": self.T_d}[name]


def simulate_torques(
    scenarios: Sequence[Scenario], *, balanced: bool = False
) -> list[Torque | SimulationError]:
    """Torque of each scenario, or the error with which it stopped, in their order.

    This is the T_d of ``simulate``, from the same equations, steps and events, with nothing else
    sampled. One core is used; the interpreter's lock is released meanwhile. ``balanced``, energies
    are then balanced over some more microsteps (``Torque.after``), which takes a few per cent more
    time.
    """
    expect_list(scenarios, "scenarios", "[scenario]")
    return [_torque(scenario, balanced) for scenario in scenarios]


def _torque(scenario: Scenario, balanced: bool) -> Torque | SimulationError:
    expect(scenario, Scenario, "a list of scenarios (mv.load_scenario)")
    if scenario.record.start != "rest":
        return SimulationError(
            "record.start: a batch always starts from rest; set record.start to rest"
        )
    try:
        return torque_from_rest(scenario, balanced=balanced)
    except SimulationError as error:
        return error


def torque_from_rest(
    scenario: Scenario, progress: Progress | None = None, *, balanced: bool = False
) -> Torque:
    """Torque of one scenario that begins at rest, whatever ``record.start`` says; ``balanced`` as
    in ``simulate_torques``.

    Raises what ``simulate`` raises.
    """
    run = Simulation(scenario, progress=progress, torque_only=True)
    T_d = np.concatenate([block["T_d"] for block in run])
    steps = int(run.packed.state.counters[kernel.STEPS])
    return Torque(
        scenario=scenario,
        T_d=T_d,
        sample_rate=scenario.record.sample_rate,
        stuck_output=run.stuck_output,
        steps=steps,
        momentum=run.momentum,
        after=run.balance_after() if balanced else None,
    )
