"""Modes of a structure clamped at its interface: shapes, participation, rigid-body mass, kinds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from microvib.structures.fem.assembly import assemble
from microvib.structures.fem.checks import check_mechanisms, check_structure
from microvib.structures.fem.structure import Structure, StructureError
from microvib.structures.modal import natural_frequency

# Below what any array has, so that all eigenvalues lie on one side and the shifted matrix stays positive definite even when parts
# are loose.
SHIFT = 0.05 * 2.0 * np.pi  # rad/s


def lowest_modes(K: Any, M: Any, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Squares of angular frequency, (s,) [rad^2/s^2] ascending, and mass-normalised vectors, (m, s).

    ``K`` and ``M`` are symmetric, sparse (m, m); StructureError where they cannot be factorised.
    """
    m = K.shape[0]
    if not 0 < count < m - 1:
        raise StructureError(f"{count} modes are asked for; a mesh with {m} free degrees of freedom gives 1 to {m - 2}")
    inverse = factorise(K + SHIFT**2 * M)
    operator = LinearOperator((m, m), matvec=inverse, dtype=float)
    start = np.random.default_rng(1).standard_normal(m)
    values, vectors = eigsh(K, count, M, sigma=-(SHIFT**2), OPinv=operator, v0=start)
    order = np.argsort(values)
    return values[order], vectors[:, order]


def factorise(A: Any) -> Any:
    """The function that solves A x = b for a symmetric positive definite A; StructureError where A is singular.

    SciPy's SuperLU, told that A is symmetric and needs no pivoting, is as fast as the best of the factorisations that come as
    wheels, and adds no dependency (``benchmarks/fem.py``).
    """
    options = {"SymmetricMode": True}
    try:
        factor = splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:
        raise StructureError(
            "the stiffness is singular although masses are counted in: something has neither stiffness nor mass, such as a node"
            " that hangs on springs of zero stiffness"
        ) from None
    return factor.solve


KINDS = {
    "B": "out-of-plane bending",
    "I": "in-plane bending",
    "T": "torsion about the drive axis",
    "P": "bending of the panels across",
    "A": "along the drive axis",
}
"""What a mode mostly is, by its kinetic energy."""


@dataclass(frozen=True)
class Modes:
    """Fixed-interface modes of a structure, mass-normalised."""

    structure: Structure
    frequency: np.ndarray
    """[Hz], (s,)."""
    shapes: np.ndarray
    """Displacements [kg^-0.5] and rotations [kg^-0.5 m^-1] of the nodes, (n, 6, s)."""
    participation: np.ndarray
    """In the six directions at the interface [kg^0.5, kg^0.5 m], (6, s) (Eq. 13)."""
    mass: np.ndarray
    """Rigid-body mass matrix at the interface, (6, 6)."""
    node_masses: np.ndarray
    """Mass of each node [kg], (n,): row sums of the mass matrix."""


def solve(structure: Structure, count: int) -> Modes:
    """The lowest ``count`` modes; StructureError where ``check_structure`` refuses it."""
    check_structure(structure)
    system = assemble(structure)
    values, vectors = lowest_modes(system.K, system.M, count)
    frequency = natural_frequency(values)
    everywhere = system.T @ vectors
    MR = system.M_all @ system.R
    node_masses = MR[:, 0].reshape(-1, 6)[:, 0]
    participation = MR.T @ everywhere
    largest = np.argmax(np.abs(participation), axis=0)[None]  # of each mode the direction to be made positive
    sign = np.where(np.take_along_axis(participation, largest, axis=0)[0] < 0.0, -1.0, 1.0)
    shapes = (everywhere * sign).reshape(-1, 6, count)
    check_mechanisms(structure, frequency, shapes, node_masses)
    return Modes(structure, frequency, shapes, participation * sign, system.R.T @ MR, node_masses)


def kinds(modes: Modes, axis: int = 0, normal: int = 2) -> tuple[str, ...]:
    """Kind of each mode, a key of ``KINDS``: of an array along ``axis`` whose panels' normal is ``normal``.

    The motion along the normal is split, at each station along the axis, into what the station does as a whole (bending), its
    turning about the axis (torsion) and the rest.
    """
    across = 3 - axis - normal
    m, u = modes.node_masses, modes.shapes
    xyz = modes.structure.xyz - modes.structure.xyz[modes.structure.interface]
    _, station = np.unique(np.round(xyz[:, axis], 6), return_inverse=True)
    station = station.ravel()
    y = xyz[:, across]

    def per_station(values: np.ndarray) -> np.ndarray:
        return np.array([np.bincount(station, row) for row in values.T])

    w = u[:, normal, :]
    mass, width = np.bincount(station, m), np.bincount(station, m * y**2)
    bending = (per_station(m[:, None] * w) ** 2 / np.maximum(mass, 1e-12)).sum(axis=1)
    torsion = (per_station((m * y)[:, None] * w) ** 2 / np.maximum(width, 1e-12)).sum(axis=1)
    total = (m[:, None] * w**2).sum(axis=0)
    energies = {
        "B": bending,
        "I": (m[:, None] * u[:, across, :] ** 2).sum(axis=0),
        "T": torsion,
        "P": total - bending - torsion,
        "A": (m[:, None] * u[:, axis, :] ** 2).sum(axis=0),
    }
    names = list(energies)
    return tuple(names[k] for k in np.argmax(np.array(list(energies.values())), axis=0))
