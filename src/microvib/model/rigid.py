"""Rigid bodies: motion of their points, mass matrices, and what a mass matrix can be."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity

Length = Annotated[float, Quantity("m", "coordinate")]
Position = tuple[Length, Length, Length]
Direction = tuple[float, float, float]
_Element = Annotated[float, Quantity("kg*m^2", "tensor element of inertia")]
Inertia = tuple[_Element, _Element, _Element, _Element, _Element, _Element]
"""xx, yy, zz, xy, xz, yz as tensor elements: I_xy = - integral of x y dm."""
COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""The six components of a load, and the motions that go with them: along the axes of a frame, then
about them.
"""
ROUNDING = 1e-9


def rigid_motions(xyz: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Displacements and rotations of nodes (n, 3) that move as one rigid body about ``origin``, (6
    n, 6).
    """
    R = np.zeros((len(xyz), 6, 6))
    R[:] = np.eye(6)
    x, y, z = (xyz - origin).T
    R[:, 1, 3], R[:, 2, 3] = -z, y
    R[:, 0, 4], R[:, 2, 4] = z, -x
    R[:, 0, 5], R[:, 1, 5] = -y, x
    return R.reshape(-1, 6)


def rigid_motion_at(position: np.ndarray) -> np.ndarray:
    """Rigid motions of one point that lies at ``position`` (3,) [m] from the reference point, (6, 6)."""
    return rigid_motions(np.asarray(position, dtype=float)[None], np.zeros(3))


def tensor(inertia: Inertia) -> np.ndarray:
    """Inertia tensor (3, 3) of its six elements."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def elements(inertia: np.ndarray) -> list[float]:
    """The six elements of an inertia tensor (3, 3)."""
    return [float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def mass_matrix(mass: float, center: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Mass matrix (6, 6) about a point, with the ``center`` of mass (3,) [m] and the ``inertia``
    (3, 3) about that point.
    """
    M = np.zeros((6, 6))
    turn = rigid_motion_at(center)[:3, 3:]  # displacement of the centre by rotations
    M[:3, :3], M[:3, 3:], M[3:, :3], M[3:, 3:] = (
        mass * np.eye(3),
        mass * turn,
        mass * turn.T,
        inertia,
    )
    return M


def inertia_about_center(mass: float, center: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) about the centre of mass of what has ``inertia`` about a point from which the
    centre is at ``center``.
    """
    c = np.asarray(center, dtype=float)
    return np.asarray(inertia - mass * (c @ c * np.eye(3) - np.outer(c, c)))


def perpendicular_unit_vector(direction: np.ndarray) -> np.ndarray:
    """Unit vector across a unit vector (3,): the first axis, or where that is near it the second,
    made perpendicular to it.
    """
    axis = np.eye(3)[0 if abs(direction[0]) < 0.9 else 1]
    across = axis - (axis @ direction) * direction
    return np.asarray(across / np.linalg.norm(across))


def block_rotation(turn: np.ndarray) -> np.ndarray:
    """A turn (3, 3) of displacements and rotations, or of forces and torques, alike, (6, 6)."""
    return np.kron(np.eye(2), turn)


def inertia_error(inertia: np.ndarray) -> str:
    """Reason why a tensor (3, 3) about a centre of mass is no inertia, in words; empty
    where it is one.
    """
    principal = np.linalg.eigvalsh(inertia)
    said = ", ".join(f"{value:.4g}" for value in principal)
    if principal[0] <= ROUNDING * abs(principal[2]):
        return f"principal moments about the centre of mass are {said} kg*m^2; they must be greater than 0 kg*m^2"
    if principal[2] > (principal[0] + principal[1]) * (1.0 + ROUNDING):
        return (
            f"principal moments about the centre of mass are {said} kg*m^2; none may be more than"
            " the sum of the other two"
            " (xx yy zz xy xz yz are tensor elements, I_xy = - integral of x y dm)"
        )
    return ""


class RigidBody(Part):
    """Mass properties of an array as one rigid body, about its interface point, in array axes at
    angle 0.
    """

    mass: Annotated[float, Quantity("kg", "mass", gt=0, usual=(0.1, 5000.0))]
    center_of_mass: Position = Field(description="centre of mass from the interface point")
    inertia: Inertia = Field(
        description="inertia about the interface point: xx yy zz xy xz yz, tensor elements"
    )

    def _consistency_errors(self) -> Iterator[str]:
        center = np.array(self.center_of_mass)
        misfit = inertia_error(inertia_about_center(self.mass, center, tensor(self.inertia)))
        if misfit:
            yield f"inertia: {misfit}"

    @property
    def matrix(self) -> np.ndarray:
        """Mass matrix about the interface point [kg, kg m, kg m^2], (6, 6)."""
        return mass_matrix(self.mass, np.array(self.center_of_mass), tensor(self.inertia))
