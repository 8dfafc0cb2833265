"""Drive and array as a source at the interface: matrices by the interface's motion and coordinates of
their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.coupling import Source as Coupled
from microvib.model.craft import array_on_hub, held_wing
from microvib.model.linear import held_motor
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import Interface
from microvib.structures.deck import UNIT_SYSTEMS, UnitSystem

HUB_AXES, ARRAY_AXES = "hub axes", "the array's axes"


@dataclass(frozen=True)
class Source:
    """Mass, damping and stiffness by the interface's six motions and by coordinates of drive and array."""

    M: np.ndarray
    """(6 + n, 6 + n)."""
    C: np.ndarray
    K: np.ndarray
    names: tuple[str, ...]
    """The own coordinates, (n,)."""
    axes: str
    """Axes of the interface's motions, in words."""
    coupled: Coupled
    """As ``microvib.model.coupling`` takes it."""

    def matrices_in(self, units: UnitSystem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass, damping and stiffness in a unit system; modes stay mass-normalised."""
        length, mass = UNIT_SYSTEMS[units]
        energy = mass * length**2
        shafts = sum(name.startswith("theta") for name in self.names)
        modes = len(self.names) - shafts
        scale = np.concatenate(
            [np.full(3, length), np.ones(3 + shafts), np.full(modes, np.sqrt(mass) * length)]
        )
        by = np.outer(scale, scale) / energy
        return self.M * by, self.C * by, self.K * by


def own_axes(drive_axis: str) -> Interface:
    """An interface whose axes are those of the array."""
    k = "xyz".index(drive_axis)
    along, across = np.eye(3)[k], np.eye(3)[(k + 1) % 3]
    return Interface(position=(0.0, 0.0, 0.0), drive_axis=tuple(along), reference=tuple(across))


def no_source(scenario: Scenario, powered: bool = True) -> str:
    """Sentence on why drive and array of a scenario have no matrices at the interface; empty where they
    have.
    """
    array = scenario.array
    if array.mass is None or array.interface is None:
        return (
            "array.rigid_body: missing; the mass of drive and array at the interface needs it, with"
            " interface_participation of every mode"
        )
    if powered and scenario.driver.drive != "current":
        return (
            f"driver.drive: {scenario.driver.drive} is not allowed; matrices of a powered drive need a"
            " current loop (current)"
        )
    return ""


def source_at_interface(scenario: Scenario, powered: bool = True) -> Source:
    """Drive and array of a scenario about the interface point: on a craft in hub axes and at the array's
    angle, else in the array's axes.

    Not ``powered``, the hinges are locked. MicrovibError where the array has no mass properties in six
    components, or the drive no current loop.
    """
    refusal = no_source(scenario, powered)
    if refusal:
        raise MicrovibError(refusal)
    array, spacecraft = scenario.array, scenario.spacecraft
    if spacecraft is None:
        interface, angle, axes = own_axes(array.drive_axis), 0.0, ARRAY_AXES
    else:
        interface, angle, axes = spacecraft.interface, spacecraft.array_angle, HUB_AXES
    wing = held_wing(
        held_motor(scenario), scenario.reducer, scenario.friction, array, interface, angle
    )
    modes = tuple(f"array_mode_{k + 1}" for k in range(len(array.modes)))
    if powered:
        shafts = ("theta_m",) if scenario.reducer.rigid else ("theta_m", "theta_l")
        coupled, names = Coupled(wing.mass, wing.G, wing.M, wing.C, wing.K), (*shafts, *modes)
    else:
        _, P = array_on_hub(array, interface, angle)
        D, squares = np.diag(array.D), np.diag(array.Lambda)
        coupled, names = Coupled(wing.mass, P, np.eye(P.shape[1]), D, squares), modes
    n = len(names)
    apart = np.zeros((6, n))
    M = np.block([[coupled.mass, coupled.G], [coupled.G.T, coupled.M]])
    C, K = (np.block([[np.zeros((6, 6)), apart], [apart.T, X]]) for X in (coupled.C, coupled.K))
    return Source(M, C, K, names, axes, coupled)
