"""Motion of and loads on the hub of a spacecraft, from a motion's channels: loads at the interface,
motions of points, line of sight.

Everything is linear in modes and shafts (``model.craft``), so that nothing of it is integrated.
Angles count from the mean motion that the command makes: a free craft turns against its array as
long as it tracks, which is not a disturbance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from microvib.errors import ChannelError
from microvib.model.craft import Craft, OutputMatrix
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.solve.channels import LINE_OF_SIGHT, SECOND_LOADS
from microvib.solve.command import Command

ACCELERATIONS = ("eta", "eta_rate", "omega_l", "omega_m", "alpha_l", "alpha_m")
"""Channels of which loads and accelerations are made; angles take those of the shafts too."""
ANGLES = ("theta_l", "theta_m")
SHAFTS = ("alpha_l", "alpha_m", "omega_l", "omega_m")
"""Channels of both shafts, as ``model.craft.Outputs`` takes them after their angles."""
LINE_OF_SIGHT_ACCELERATIONS = ("los_ax", "los_ay")
"""Channels that a run can keep of a spacecraft with a line of sight instead of the states that it is made of."""


def evaluate_outputs(
    rows: OutputMatrix,
    channels: Mapping[str, np.ndarray],
    scenario: Scenario,
    time: np.ndarray | None = None,
) -> np.ndarray:
    """Outputs, (n, k), in the ``channels`` of a motion of ``scenario`` at its times [s],
    (n,), which only angles need.
    """
    craft = scenario.craft
    assert craft is not None
    shafts = np.zeros((channels["alpha_l"].shape[0], 6))
    shafts[:, 2:] = np.column_stack([channels[name] for name in SHAFTS])
    if np.any(rows.position):
        assert time is not None
        rotor = Command(scenario).count(time) * scenario.driver.microstep(scenario.motor)
        shafts[:, 0] = channels["theta_l"] + rotor / scenario.reducer.h
        shafts[:, 1] = channels["theta_m"] - rotor
    return craft.outputs(rows).of(channels["eta"], channels["eta_rate"], shafts)


def missing_channels(channels: Mapping[str, np.ndarray], name: str) -> tuple[str, ...]:
    """Channels that were not kept and are needed for ``name``."""
    needed = ACCELERATIONS + (ANGLES if name in ("los_x", "los_y") else ())
    return tuple(one for one in needed if one not in channels)


def channel_on_craft(
    name: str, channels: Mapping[str, np.ndarray], scenario: Scenario, time: np.ndarray | None
) -> np.ndarray | None:
    """A load on the hub or an angle of the line of sight, (n,); None where there is none of it."""
    if scenario.craft is None or missing_channels(channels, name):
        rows = None
    else:
        rows = _rows_of(scenario.craft, name)
    if rows is None:
        return None
    return evaluate_outputs(rows, channels, scenario, time)[:, 0]


def _rows_of(craft: Craft, name: str) -> OutputMatrix | None:
    if name in COMPONENTS:
        rows, k = craft.loads(), COMPONENTS.index(name)
    elif name in SECOND_LOADS and craft.second is not None:
        rows, k = craft.second_loads(), list(SECOND_LOADS).index(name)
    elif name in LINE_OF_SIGHT and craft.spacecraft.line_of_sight is not None:
        rows, k = (
            craft.line_of_sight(accelerations=name in LINE_OF_SIGHT_ACCELERATIONS),
            int(name.endswith("y")),
        )
    else:
        return None
    return rows.through(np.eye(len(rows.position))[[k]])


def line_of_sight_acceleration_weights(craft: Craft, columns: Sequence[str]) -> np.ndarray:
    """OF_STATES by the kernel's ``columns``, behind which the modes and their rates stand, (columns
    and states, 2).
    """
    outputs = craft.outputs(craft.line_of_sight(accelerations=True))
    by = np.zeros((len(columns), 2))
    by[[columns.index(name) for name in SHAFTS]] = outputs.shafts[:, 2:].T
    return np.vstack([by, outputs.eta.T, outputs.rate.T])


def hub_motion(
    craft: Craft,
    point: str,
    channels: Mapping[str, np.ndarray],
    scenario: Scenario,
    time: np.ndarray,
    accelerations: bool,
) -> np.ndarray:
    """Displacement [m] and rotation [rad] of a named point, or their second derivatives, (n, 6),
    hub axes.
    """
    if point not in craft.spacecraft.points:
        raise ChannelError(
            f"point '{point}' is not on the hub; there are {', '.join(craft.spacecraft.points)}"
        )
    lacking = [name for name in (*ACCELERATIONS, *ANGLES) if name not in channels]
    if lacking:
        raise ChannelError(
            f"point '{point}': {', '.join(lacking)} were not kept, of which its motion is made"
        )
    return evaluate_outputs(
        craft.acceleration(point) if accelerations else craft.motion(point),
        channels,
        scenario,
        time,
    )
