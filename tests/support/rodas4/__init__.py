"""A reference for ``microvib.solve.propagate``: RODAS4 steps with located friction events.

It shares the equations of motion, the friction and its events with the propagators, and nothing
else: neither their linear part nor their steps. It knows no friction with memory, no backlash and
no torque noise.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.integration import Simulation, record_motion
from microvib.solve.motion import Motion
from microvib.solve.pack import Packed, pack
from support.rodas4 import loop

TOLERANCE = 2e-5
"""Local error of a step over the size of each state; the error estimate is of order 3, so that it
falls with the fourth power of the step's length."""


class Rodas4(Packed):
    """A scenario as RODAS4 takes it."""

    scale: np.ndarray
    """1 / (tolerance x size) of each state."""

    def advance(self, stop: float, samples: Any, steps_t: np.ndarray, steps_ref: np.ndarray) -> int:
        room, scale = np.zeros((loop.SCRATCH_ROWS, self.scratch.shape[1])), self.scale
        return int(
            loop.advance(stop, self.state, self.drive, scale, samples, steps_t, steps_ref, room)
        )

    def mixes(self, mix: np.ndarray) -> bool:
        return False

    @property
    def torque_columns(self) -> int:
        return self.channels

    @property
    def columns(self) -> int:
        return self.channels

    def torque_of(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return rows[:, kernel.T_D], rows[:, kernel.CHANNELS.index("stuck_output")]


def packed_for_rodas4(scenario: Scenario, tolerance: float = TOLERANCE) -> Rodas4:
    """A scenario at rest; its ``solver.refinement`` counts, its ``solver.accuracy`` does not."""
    usual = pack(scenario)
    if usual.drive.elements.size or usual.drive.noise.size:
        raise ValueError("RODAS4 knows no friction with memory, backlash and torque noise")
    packed = Rodas4(**{field.name: getattr(usual, field.name) for field in fields(Packed)})
    object.__setattr__(
        packed, "scale", 1.0 / (tolerance / scenario.solver.refinement**4 * packed.sizes)
    )
    return packed


def simulate(
    scenario: Scenario, channels: tuple[str, ...] | None = None, tolerance: float = TOLERANCE
) -> Motion:
    """As ``microvib.simulate`` from rest, without a second wing."""
    return record_motion(
        Simulation(scenario, packed=packed_for_rodas4(scenario, tolerance), channels=channels)
    )
