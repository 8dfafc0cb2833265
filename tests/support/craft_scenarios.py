"""The whole systems of ``craft.py`` as scenarios of microvib, and what is seen at instants of their
runs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from microvib.model.craft import OutputMatrix
from microvib.model.rigid import elements
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.pack import Packed, pack
from microvib.solve.sampling import empty_sample_buffer
from support import craft as whole
from support.scenarios import in_si

TIMES = np.array([0.031, 0.072, 0.113, 0.154])
BENDING = np.array([2e-3, -3e-3, 4e-3, 1e-2, 6e-3, -8e-3])
PAYLOAD = np.array([-1e-3, 2e-3, 1e-3, -2e-2, 1.5e-2, 5e-3])


def six(inertia: np.ndarray) -> list[float]:
    return elements(inertia)


def array_of(damping: np.ndarray = whole.DAMPING) -> dict[str, Any]:
    modes = zip(whole.FREQUENCIES, damping, whole.PARTICIPATION.T, strict=True)
    return {
        "inertia": whole.ARRAY_INERTIA[2, 2],
        "drive_axis": "z",
        "modes": [
            {"frequency": f, "damping": xi, "interface_participation": p.tolist()}
            for f, xi, p in modes
        ],
        "rigid_body": {
            "mass": whole.ARRAY_MASS,
            "center_of_mass": whole.ARRAY_CENTER.tolist(),
            "inertia": six(whole.ARRAY_INERTIA),
        },
    }


def spacecraft_of(full: whole.FullCraft) -> dict[str, Any]:
    hub: dict[str, Any] = {
        "mass": full.hub_scale * whole.HUB_MASS,
        "inertia": six(full.hub_scale * whole.HUB_INERTIA),
    }
    if full.flexible:
        hub["points"] = [
            {"name": "root", "position": whole.PLACE.tolist()},
            {"name": "payload", "position": [0.1, -0.2, 0.6]},
        ]
        hub["modes"] = [
            {"frequency": f, "damping": xi, "shapes": [shape.tolist(), PAYLOAD.tolist()]}
            for f, xi, shape in full.flexible
        ]
    control = (
        {"bandwidth": full.bandwidth, "damping": full.control_damping} if full.bandwidth else "none"
    )
    return {
        "hub": hub,
        "array_angle": full.angle,
        "interface": {
            "position": whole.PLACE.tolist(),
            "drive_axis": full.axis.tolist(),
            "reference": full.reference.tolist(),
        },
        "attitude_control": control,
        "line_of_sight": {
            "boresight": [0.0, 0.0, 1.0],
            "point": "payload" if full.flexible else "center",
            "windows": [0.01, 0.1],
        },
    }


def scenario_of(full: whole.FullCraft, **changes: Any) -> Scenario:
    """The same drive and craft as a scenario; frictions are viscous."""
    friction = {"coulomb": 0.0, "breakaway": 0.0, "stribeck_rate": 1e-4}
    data: dict[str, Any] = {
        "motor": {
            "rotor_teeth": full.teeth, "current": full.current, "torque_constant": full.torque_constant,
            "detent_torque": full.detent, "winding_resistance": full.resistance, "winding_inductance": full.inductance,
            "rotor_inertia": full.rotor_inertia - 5e-6, "friction": {**friction, "viscous": full.on_rotor},
        },
        "driver": {"beats": 4, "microsteps": full.microsteps, "proportional_gain": full.gain, "integral_gain": full.integral},
        "reducer": {
            "ratio": full.ratio, "wave_generator_inertia": 5e-6, "stiffness": full.stiffness, "damping": full.gear_damping,
            "output_inertia": full.output_inertia,
        },
        "friction": {**friction, "viscous": full.on_output},
        "array": array_of(full.damping),
        "tracking": {"rate": full.rate},
        "record": {"settle": 1.0, "duration": 4.0, "sample_rate": 1024.0},
        "spacecraft": spacecraft_of(full),
    }  # fmt: skip
    return in_si(Scenario, **data).with_si(changes)


def shafts_of(row: np.ndarray) -> np.ndarray:
    names = ("theta_l", "theta_m", "alpha_l", "alpha_m", "omega_l", "omega_m")
    return row[[kernel.CHANNELS.index(name) for name in names]]


def instants(
    scenario: Scenario, times: np.ndarray, packed: Packed | None = None
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Modes, their rates and shafts at instants of a run from rest."""
    packed, command, now, found = packed or pack(scenario), Command(scenario), 0.0, []
    nothing = empty_sample_buffer(packed.channels)._replace(width=0.0)
    for stop in times:
        assert packed.advance(stop, nothing, *command.microsteps(now, stop)) == kernel.OK
        now, row = stop, packed.snapshot()
        eta, rate = np.split(row[kernel.N_CHANNELS :], 2)
        found.append((eta, rate, shafts_of(row)))
    return found


def seen(
    scenario: Scenario, rows: OutputMatrix, found: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
) -> np.ndarray:
    """What is looked at in such instants."""
    assert scenario.craft is not None
    outputs = scenario.craft.outputs(rows)
    return np.array([outputs.of(eta, rate, shafts) for eta, rate, shafts in found])


def off(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference over the largest value of each column."""
    return float(np.max(np.abs(found - wanted).max(axis=0) / np.abs(wanted).max(axis=0)))


UNDAMPED = whole.FullCraft(damping=0.0 * whole.DAMPING)
FLEXIBLE = whole.FullCraft(
    angle=math.radians(-65.0),
    bandwidth=0.3,
    flexible=[(17.0, 0.003, BENDING), (31.0, 0.004, -2.0 * BENDING[::-1])],
)

OBLIQUE = whole.FullCraft(
    angle=math.radians(137.0), axis=np.array([0.48, 0.6, -0.64]), reference=np.array([0.8, 0.0, 0.6]), bandwidth=0.1,
)  # fmt: skip


HEAVY = [(17.0, 0.3, BENDING), (31.0, 0.2, -2.0 * BENDING[::-1])]
DAMPED = {
    "hub": replace(FLEXIBLE, flexible=HEAVY, bandwidth=0.05),
    "fast": whole.FullCraft(bandwidth=0.3, control_damping=1.5),
    "critical": replace(OBLIQUE, bandwidth=0.3, control_damping=1.0, damping=np.array([0.05, 0.3, 0.9, 0.95])),
    "all": replace(
        FLEXIBLE, flexible=HEAVY, bandwidth=0.05, control_damping=1.5, axis=OBLIQUE.axis, reference=OBLIQUE.reference,
    ),
}  # fmt: skip
