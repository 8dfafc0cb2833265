"""A craft whose array turns slowly: its lines at angles between those that were run, and what the
turning itself changes.

A run tells how both shafts accelerate at each line. The torques on rotor and output by which the
linearised drive, on the craft at that angle, moves the same way hold all that is not linear
(detent, friction, current loop), and hardly depend on the angle. They are interpolated, and the
craft is assembled anew at each angle, so that a line which crosses a mode between two runs is
resolved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microvib.analysis.pointing import HubLines
from microvib.model.coupling import require_craft
from microvib.model.craft import OutputMatrix
from microvib.model.drive_matrices import coordinates
from microvib.model.linear import dynamic_stiffness
from microvib.model.scenario import Scenario

_RELATIVE_STEP = 1e-5
"""Part of a frequency for difference quotients; far below the damping of any mode."""


@dataclass(frozen=True)
class HubResponse:
    """Lines (k,) of the hub at one angle, complex amplitudes, 0-to-peak, and how they change with
    their frequencies.
    """

    loads: np.ndarray
    """On the hub at the interface point, (k, 6) [N, N m]."""
    los: np.ndarray
    """Line of sight, (k, 2) [rad]."""
    slope: np.ndarray
    """Its derivative by the angular frequency, the torques held, (k, 2) [rad s]."""

    def __add__(self, other: HubResponse) -> HubResponse:
        return HubResponse(self.loads + other.loads, self.los + other.los, self.slope + other.slope)


def shaft_torques(lines: HubLines) -> np.ndarray:
    """Torques [N m] on rotor and output, (k, 2), that make the ``lines``; on the rotor alone, (k,
    1), of a rigid reducer.
    """
    scenario, omega = lines.scenario, 2.0 * np.pi * lines.frequency
    c = coordinates(scenario.reducer, 0).shape[1]
    moved = -(lines.shafts[:, ::-1][:, :c] / omega[:, None] ** 2)
    return np.asarray(
        np.linalg.solve(_receptance(scenario, lines.frequency)[:, :c], moved[:, :, None])[:, :, 0]
    )


def hub_response(
    scenario: Scenario, frequency: np.ndarray, torque: np.ndarray, *, at_second: bool = False
) -> HubResponse:
    """Response to ``torque`` (k, c), as from ``shaft_torques``, at each ``frequency`` (k,) [Hz] of the
    craft of a scenario.

    Loads are those at its interface, or ``at_second`` at that of its second wing.
    """
    craft, f = (
        require_craft(scenario),
        np.concatenate(
            [frequency, (1.0 + _RELATIVE_STEP) * frequency, (1.0 - _RELATIVE_STEP) * frequency]
        ),
    )
    shafts = (_receptance(scenario, f) @ np.tile(torque, (3, 1))[:, :, None])[:, :, 0]
    accelerations = (
        -((2.0 * np.pi * f[:, None]) ** 2) * (shafts @ coordinates(scenario.reducer, 0).T)[:, ::-1]
    )
    loads, los = craft.second_loads() if at_second else craft.loads(), craft.line_of_sight()
    names = ("position", "acceleration", "direct")
    both = OutputMatrix(*(np.vstack([getattr(loads, name), getattr(los, name)]) for name in names))
    found = np.einsum("fkj,fj->fk", craft.transfer(both, f), accelerations)
    here, above, below = np.split(found, 3)
    slope = (above - below)[:, 6:] / (4.0 * np.pi * _RELATIVE_STEP * frequency[:, None])
    return HubResponse(here[:, :6], here[:, 6:], slope)


def _receptance(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """Angles of the coordinates of the shafts by torques on them at each frequency (k,) [Hz], (k,
    c, c).
    """
    dynamic = dynamic_stiffness(scenario, frequency)
    c = coordinates(scenario.reducer, 0).shape[1]
    return np.asarray(
        np.linalg.solve(
            dynamic, np.broadcast_to(np.eye(dynamic.shape[1])[:, :c], (*dynamic.shape[:2], c))
        )
    )[:, :c]
