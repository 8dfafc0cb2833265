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

# Below what any array has, so that all eigenvalues lie on one side and the shifted matrix stays
# positive definite even when parts are loose.
SHIFT = 0.05 * 2.0 * np.pi  # rad/s


def lowest_modes(K: Any, M: Any, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Squares of angular frequency, (s,) [rad^2/s^2] ascending, and mass-normalised vectors, (m,
    s).

    ``K`` and ``M`` are symmetric, sparse (m, m); StructureError where they cannot be factorised.
    """
    m = K.shape[0]
    if not 0 < count < m - 1:
        raise StructureError(
            f"{count} modes are asked for; a mesh with {m} free degrees of freedom gives 1 to"
            f" {m - 2}"
        )
    inverse = factorise(K + SHIFT**2 * M)
    operator = LinearOperator((m, m), matvec=inverse, dtype=float)
    start = np.random.default_rng(1).standard_normal(m)
    values, vectors = eigsh(K, count, M, sigma=-(SHIFT**2), OPinv=operator, v0=start)
    order = np.argsort(values)
    return values[order], vectors[:, order]


def factorise(A: Any) -> Any:
    """The function that solves A x = b for a symmetric positive definite A; StructureError where A
    is singular.

    SciPy's SuperLU, told that A is symmetric and needs no pivoting, is as fast as the best of the
    factorisations that come as wheels, and adds no dependency (``benchmarks/fem.py``).
    """
    options = {"SymmetricMode": True}
    try:
        factor = splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:
        raise StructureError(
            "the shifted stiffness matrix is singular: a degree of freedom has neither stiffness"
            " nor mass, such as a node"
            " that hangs on springs of zero stiffness"
        ) from None
    return factor.solve


@dataclass(frozen=True)
class Modes:
    """Fixed-interface modes of a structure, mass-normalised."""

    structure: Structure
    frequency: np.ndarray  # [Hz], (s,)
    shapes: (
        np.ndarray
    )  # displacements [kg^-0.5] and rotations [kg^-0.5 m^-1] of the nodes, (n, 6, s)
    participation: (
        np.ndarray
    )  # in the six directions at the interface [kg^0.5, kg^0.5 m], (6, s) (Eq. 13)
    mass: np.ndarray  # rigid-body mass matrix at the interface, (6, 6)
    node_masses: np.ndarray  # mass of each node [kg], (n,): row sums of the mass matrix


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
    largest = np.argmax(np.abs(participation), axis=0)[
        None
    ]  # of each mode the direction to be made positive
    sign = np.where(np.take_along_axis(participation, largest, axis=0)[0] < 0.0, -1.0, 1.0)
    shapes = (everywhere * sign).reshape(-1, 6, count)
    check_mechanisms(structure, frequency, shapes, node_masses)
    return Modes(structure, frequency, shapes, participation * sign, system.R.T @ MR, node_masses)
