"""Free-free modes of a hub from Nastran (OP2, OP4, PCH): shapes of some grids, as computed or out
of a Craig-Bampton model.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.nastran.craig_bampton import (
    DIRECTIONS,
    MASS_MATRICES,
    SHAPES,
    Reduced,
    dmig_model,
    matrices,
    names_in,
    normalised,
    op4_model,
)
from microvib.io.nastran.library import grid_coordinates, lines_of, pyyeti, rigid_motion
from microvib.io.nastran.op2 import read_free_op2
from microvib.io.nastran.printed import punched_vectors
from microvib.structures.modal import ModalError, natural_frequency

FreeModeData = tuple[np.ndarray, Any, np.ndarray]
"""Frequencies (s,) [Hz], table of degrees of freedom (n rows), mass-normalised shapes in its rows
(n, s), nan where not known.
"""
RIGID_BELOW = 0.1
"""Frequency [Hz] of a mode below which a model counts as free: every grid of it moves."""
BULK = (".bdf", ".dat", ".nas", ".blk")
"""Endings of bulk data, which has the grids of results that do not say where they are."""


def read_free(path: Path, grids: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (s,) [Hz] of all modes, rigid ones too, and of ``grids`` their places (p, 3) and
    shapes (p, 6, s).

    Places and mass-normalised shapes are in the deck's units and basic frame. Raises ModalError.
    """
    frequency, uset, phi = {".op2": read_free_op2, ".op4": _op4, ".pch": _pch}[path.suffix.lower()](
        path
    )
    places, turns = grid_coordinates(uset), rigid_motion(uset)
    shapes = []
    for grid in grids:
        if grid not in places:
            raise ModalError(
                f"points: grid {grid} is not in the model, which has {len(places)} grids"
            )
        rows = np.flatnonzero(uset.index.get_level_values(0) == grid)
        lost = [
            name for name, row in zip(DIRECTIONS, phi[rows], strict=True) if np.any(np.isnan(row))
        ]
        if lost:
            raise ModalError(
                f"points: the motion of grid {grid} is not in the file in {', '.join(lost)}; all"
                " six directions are expected"
            )
        if not np.any(phi[rows]) and frequency.min(initial=np.inf) < RIGID_BELOW:
            raise ModalError(
                f"points: grid {grid} has no motion in any mode: it is disconnected or constrained;"
                " choose a grid of the structure"
            )
        turn = np.kron(np.eye(2), turns[rows[:3], :3])  # from the basic frame to the grid's own
        shapes.append(turn.T @ phi[rows])
    return frequency, np.array([places[grid] for grid in grids]), np.array(shapes)


def _op4(path: Path) -> FreeModeData:
    """A Craig-Bampton model, or eigenvectors of the G-set with mass and stiffness and the deck
    beside them.
    """
    reduced = op4_model(path)
    if reduced is not None:
        return _solved(reduced)
    present = names_in(path)
    shapes, mass = (
        next((name for name in names if name in present), "") for names in (SHAPES, MASS_MATRICES)
    )
    stiffness = "k" + mass[1:]
    if not shapes or not mass or stiffness not in present:
        raise ModalError(
            f"holds {', '.join(present[:12]).upper() or 'no matrices'}; expected KAA and MAA of a"
            " Craig-Bampton model, or"
            f" eigenvectors ({', '.join(SHAPES).upper()}) with MGG and KGG"
        )
    found, uset = matrices(path, (shapes, mass, stiffness)), _grids(path)
    phi, M, K = (found[name] for name in (shapes, mass, stiffness))
    phi = np.asarray(phi.toarray() if hasattr(phi, "toarray") else phi)
    if phi.shape[0] != len(uset) or M.shape != (len(uset), len(uset)) or K.shape != M.shape:
        raise ModalError(
            f"eigenvectors {phi.shape}, mass {M.shape} and stiffness {K.shape} do not match the"
            f" {len(uset)} degrees of freedom of"
            " the grids in the deck beside it"
        )
    phi = normalised(phi, M)[0]
    return natural_frequency(np.einsum("ij,ij->j", phi, K @ phi)), uset, phi


def _pch(path: Path) -> FreeModeData:
    """A punched Craig-Bampton model, or punched eigenvectors, taken as mass-normalised."""
    if any(line.startswith("DMIG") for line in lines_of(path)):
        return _solved(dmig_model(path))
    eigenvalue, vectors = punched_vectors(path, "$EIGENVECTOR", "$DISPLACEMENT")
    if not vectors:
        raise ModalError(
            "has neither DMIG entries (EXTSEOUT(DMIGPCH)) nor eigenvectors"
            " (DISPLACEMENT(PUNCH)=ALL)"
        )
    uset, modes = _grids(path), sorted(vectors)
    phi = np.full((len(uset), len(modes)), np.nan)
    rows = {
        grid: np.flatnonzero(uset.index.get_level_values(0) == grid) for grid in vectors[modes[0]]
    }
    for k, mode in enumerate(modes):
        for grid, values in vectors[mode].items():
            if len(values) == 6 and len(rows.get(grid, ())) == 6:
                phi[rows[grid], k] = values
    return natural_frequency(np.array([eigenvalue[mode] for mode in modes])), uset, phi


def _solved(reduced: Reduced) -> FreeModeData:
    """Free modes of a Craig-Bampton model, all that it has."""
    from scipy.linalg import LinAlgError, eigh

    K, M, boundary, uset, rows = reduced
    K, M = 0.5 * (K + K.T), 0.5 * (M + M.T)
    T = _massive_motions(K, M, [uset.index[k] for k in rows], np.flatnonzero(boundary))
    try:
        squares, vectors = eigh(T.T @ K @ T, T.T @ M @ T)
    except LinAlgError:
        raise ModalError("its mass matrix is not positive definite") from None
    phi = np.full((len(uset), squares.size), np.nan)
    phi[rows] = (T @ vectors)[boundary]
    return natural_frequency(squares), uset, phi


MASSLESS = 1e-10
"""Mass of a motion below which it has none, with the mass of each degree of freedom scaled to one."""


def _massive_motions(
    K: np.ndarray, M: np.ndarray, names: list[tuple[int, int]], boundary: np.ndarray
) -> np.ndarray:
    """Motions (n, m) of all degrees of freedom that have mass; those without follow them
    statically.

    ``names`` are grid and direction of the rows ``boundary``. ModalError names those without mass
    that nothing holds, either.
    """
    size = np.sqrt(np.maximum(np.diag(M), 0.0))
    size = np.where(size > 0.0, size, size.max() or 1.0)
    mass, V = np.linalg.eigh(M / np.outer(size, size))
    if mass[0] < -1e-6:
        raise ModalError("its mass matrix is not positive definite")
    empty = mass < MASSLESS
    if not empty.any():
        return np.eye(len(M))
    N, R = V[:, empty] / size[:, None], V[:, ~empty] / size[:, None]
    held = N.T @ K @ N
    own = np.sqrt(np.maximum(np.diag(N.T @ np.diag(np.abs(np.diag(K))) @ N), 1e-300))
    stiffness, loose = np.linalg.eigh(held / np.outer(own, own))
    if stiffness[0] < 1e-9:
        moved = np.abs(N @ (loose[:, 0] / own))[boundary]
        large = [
            name for name, x in zip(names, moved, strict=True) if name[1] and x > 0.1 * moved.max()
        ]
        words = ", ".join(f"{DIRECTIONS[d - 1]} of grid {i}" for i, d in large[:6]) or "its modes"
        raise ModalError(
            f"has neither mass nor stiffness for a motion in {words}; give it mass, or leave it out"
            " of the boundary"
        )
    return np.asarray(R - N @ np.linalg.solve(held, N.T @ K @ R))


def _grids(path: Path) -> Any:
    """Table of degrees of freedom of the GRID entries in a file itself, or in bulk data of its name
    beside it.
    """
    files = [path, *(path.with_suffix(ending) for ending in BULK)]
    for name in files:
        if name.is_file() and (name != path or path.suffix.lower() == ".pch"):
            uset = pyyeti("bulk").bulk2uset(str(name), follow_includes=False)[0]
            if len(uset):
                return uset
    raise ModalError(
        "does not say where its grids are; bulk data with their GRID entries"
        f" ({path.stem}{BULK[0]}) is expected beside it"
    )
