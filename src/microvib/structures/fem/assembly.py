"""Sparse stiffness and mass of a structure, and its degrees of freedom with links and clamp taken
out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from microvib.model.rigid import rigid_motions
from microvib.structures.fem.elements import element_matrices
from microvib.structures.fem.structure import Beams, Link, Lump, Shells, Spring, Structure

ROUNDING = (
    1e-12  # entry of an element's matrix over the root of its diagonals that is taken for zero
)


@dataclass(frozen=True)
class System:
    """Matrices of a structure clamped at its interface."""

    K: Any  # stiffness of the free degrees of freedom, sparse (m, m) [N/m, N m/rad]
    M: Any  # mass of the free degrees of freedom, sparse (m, m) [kg, kg m, kg m^2]
    T: Any  # from the free degrees of freedom to all, sparse (n, m)
    M_all: Any  # mass of all degrees of freedom before links, sparse (n, n)
    R: np.ndarray  # rigid-body motions of all degrees of freedom about the interface, (n, 6)


def assemble(structure: Structure, clamped: bool = True) -> System:
    """System of a structure; with ``clamped`` false its interface is free, too."""
    K, M = _sum(structure)
    T = _reduction(structure, clamped)
    R = rigid_motions(structure.xyz, structure.xyz[structure.interface])
    return System((T.T @ K @ T).tocsc(), (T.T @ M @ T).tocsc(), T, M, R)


def _sum(structure: Structure) -> tuple[Any, Any]:
    K: list[Entries] = []
    M: list[Entries] = []
    for part in structure.parts:
        if isinstance(part, (Shells, Beams)):
            stiffness, mass, which = element_matrices(part, structure.xyz)
            K.append(_entries(part.nodes, stiffness, which))
            M.append(_entries(part.nodes, mass, which))
        elif isinstance(part, Spring):
            k = np.diag(part.stiffness)
            K.append(_entries(np.array([part.nodes]), np.block([[k, -k], [-k, k]])[None]))
        elif isinstance(part, Lump):
            M.append(
                _entries(
                    np.array([[part.node]]), np.diag([part.mass] * 3 + list(part.inertia))[None]
                )
            )
    return _matrix(K, structure.dof), _matrix(M, structure.dof)


Entries = tuple[
    np.ndarray, np.ndarray, np.ndarray
]  # rows, columns and values of a sparse matrix, (n,) each


def _entries(nodes: np.ndarray, matrices: np.ndarray, which: Any = slice(None)) -> Entries:
    """Entries of elements with ``nodes`` (n, c); ``which`` (n,) of the dense ``matrices`` (d, 6 c,
    6 c) each one has.
    """
    dof = (6 * nodes[:, :, None] + np.arange(6)).reshape(len(nodes), -1).astype(np.int32)
    diagonal = np.sqrt(np.abs(np.einsum("eii->ei", matrices)))
    scale = diagonal[:, :, None] * diagonal[:, None, :]
    # Rounding would couple bending and motion in the plane of flat panels, and multiply the fill of
    # the factor.
    rows, columns = np.nonzero(np.any(np.abs(matrices) > ROUNDING * scale, axis=0))
    return dof[:, rows].ravel(), dof[:, columns].ravel(), matrices[:, rows, columns][which].ravel()


def _matrix(groups: list[Entries], size: int) -> Any:
    if not groups:
        return sp.csc_array((size, size))
    rows, columns, values = (np.concatenate(parts) for parts in zip(*groups, strict=True))
    return sp.coo_array((values, (rows, columns)), shape=(size, size)).tocsc()


def _reduction(structure: Structure, clamped: bool) -> Any:
    """All degrees of freedom as combinations of those that are free: u_slave = u_master + theta x
    r.
    """
    motion = sp.identity(structure.dof, format="lil" if structure.of(Link) else "csc")
    if clamped:
        gone = list(range(6 * structure.interface, 6 * structure.interface + 6))
    else:
        gone = []
    for link in structure.of(Link):
        R = rigid_motions(structure.xyz[link.slaves], structure.xyz[link.master])
        slaves = (6 * np.asarray(link.slaves)[:, None] + np.arange(6)).ravel()
        gone.extend(slaves)
        for row, values in zip(slaves, R, strict=True):
            used = np.flatnonzero(values)
            motion.rows[row], motion.data[row] = (
                (6 * link.master + used).tolist(),
                values[used].tolist(),
            )
    free = np.setdiff1d(np.arange(structure.dof), gone)
    return motion.tocsc()[:, free]
