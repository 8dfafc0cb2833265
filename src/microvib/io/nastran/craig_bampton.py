"""Matrices of other people's finite elements: Craig-Bampton models in OP4 and in punched DMIG, mode
shapes with mass in OP4.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.nastran.library import grid_coordinates, lines_of, pyyeti, rigid_motion
from microvib.io.nastran.printed import read_punched
from microvib.structures.deck import Deck, ImportOptions
from microvib.structures.modal import ModalError, natural_frequency

MAX_MATRIX_SIZE = 1_000_000_000  # bytes of the largest matrix that is read into memory in full
MASS_MATRICES = ("mgg", "maa", "maax", "mxx")
PAIRS = (("kaa", "maa"), ("kaax", "maax"), ("kxx", "mxx"))
SHAPES, RIGID = ("phg", "phig", "phix", "phia", "ugv"), ("rbg", "rbm", "rbglob", "rg")
Reduced = tuple[np.ndarray, np.ndarray, np.ndarray, Any, np.ndarray]
"""Stiffness and mass (n, n), which rows are the boundary (n,), its table of degrees of freedom, and
those rows in the table.
"""
# relative; what may be left of phi^T M phi off its diagonal (shapes come in single precision)
ORTHOGONAL = 0.02
# ratio to the first fixed-interface frequency of the frequencies that a free model has on its
# boundary
GROUNDED = 0.1


def matrices(path: Path, names: tuple[str, ...], full: bool = False) -> dict[str, Any]:
    """Named matrices that an OP4 file (binary or text) has, by lower-case name; large
    ones sparse, unless ``full``.
    """
    op4 = pyyeti("op4")
    present, sizes, _, _ = op4.dir(str(path), verbose=False)
    if not present:
        raise ModalError("is not an OP4 file, or has no matrices")
    wanted = [name for name in names if name in present]
    if not wanted:
        return {}
    large = [
        f"{name.upper()} ({rows} x {columns})"
        for name, (rows, columns) in zip(present, sizes, strict=True)
        if name in wanted and 8 * abs(rows) * abs(columns) > MAX_MATRIX_SIZE
    ]
    if large and full:
        raise ModalError(
            f"{', '.join(large)} is too large; at most {MAX_MATRIX_SIZE / 1e9:g} GB are read into"
            " memory"
        )
    found = op4.read(str(path), wanted, sparse=bool(large))
    return {name: found[name] for name in wanted}


def read_op4(path: Path, options: ImportOptions) -> Deck:
    """A Craig-Bampton model (KAA and MAA, or KXX and MXX of EXTSEOUT), or mode shapes with mass and
    rigid-body motions.
    """
    pair = _pair(path)
    if pair is not None:
        return _from_reduced(path, *pair, options)
    present = names_in(path)
    shapes, rigid, mass = (
        next((n for n in names if n in present), "") for names in (SHAPES, RIGID, MASS_MATRICES)
    )
    stiffness = "k" + mass[1:]
    if not shapes or not rigid or not mass or stiffness not in present:
        raise ModalError(
            f"holds {', '.join(present[:12]).upper() or 'no matrices'}; expected KAA and MAA (or"
            " KXX and MXX, KAAX and"
            f" MAAX) of a Craig-Bampton model, or mode shapes ({', '.join(SHAPES).upper()}) with"
            " MGG, KGG and the six rigid-body"
            f" motions ({', '.join(RIGID).upper()})"
        )
    found = matrices(path, (shapes, rigid, mass, stiffness))
    return _from_full(found[shapes], found[rigid], found[mass], found[stiffness], options)


def names_in(path: Path) -> list[str]:
    """Names of the matrices in an OP4 file, in lower case."""
    return pyyeti("op4").dir(str(path), verbose=False)[0]


def _pair(path: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Stiffness and mass (n, n) of the Craig-Bampton model in an OP4 file; None where it holds
    none.
    """
    present = names_in(path)
    pair = next((p for p in PAIRS if all(name in present for name in p)), None)
    if pair is None:
        return None
    found = matrices(path, pair, full=True)
    return np.asarray(found[pair[0]]), np.asarray(found[pair[1]])


def _from_full(phi: Any, R: Any, M: Any, K: Any, options: ImportOptions) -> Deck:
    """Modes from shapes, rigid-body motions about ``options.reference``, mass and stiffness of one
    set.
    """
    phi, R = (x.toarray() if hasattr(x, "toarray") else np.asarray(x) for x in (phi, R))
    n = phi.shape[0]
    if R.shape != (n, 6) or M.shape != (n, n) or K.shape != (n, n):
        raise ModalError(
            f"shapes {phi.shape}, rigid-body motions {R.shape}, mass {M.shape}, stiffness {K.shape}"
            " do not fit"
        )
    phi = normalised(phi, M)[0]
    eigenvalue = np.einsum("ij,ij->j", phi, K @ phi)
    return Deck(natural_frequency(eigenvalue), R.T @ (M @ phi), R.T @ (M @ R), options.reference)


def normalised(phi: np.ndarray, M: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Mass-normalised shapes (n, s), the roots of their generalised masses (s,), and what is off
    the diagonal of phi^T M phi.
    """
    own = np.sqrt(np.einsum("ij,ij->j", phi, M @ phi))
    phi = phi / own
    off = float(np.abs(phi.T @ (M @ phi) - np.eye(own.size)).max())
    if not off < ORTHOGONAL:
        raise ModalError(
            f"mode shapes are not orthogonal in the mass matrix (up to {off:.2g}): it belongs "
            "to another model, or is in other units"
        )
    return phi, own, off


def _from_reduced(path: Path, K: Any, M: Any, options: ImportOptions) -> Deck:
    """OP4 with the geometry of EXTSEOUT beside it, or with a boundary of one point, the interface."""
    geometry = _adjacent_geometry(path, K)
    if geometry is not None:
        boundary, points, rows = geometry
        return _tied(K, M, boundary, points, rows)
    if not isinstance(options.interface, int):
        raise ModalError(
            "has no geometry; give the interface as the id of the boundary grid, or put the .asm or"
            " .pch file of"
            " EXTSEOUT beside it"
        )
    boundary = _boundary_of_six(K, M)
    said = "The boundary is taken to be the interface point, in axes of the basic frame."
    deck = _fixed(K, M, boundary, np.eye(6))
    return replace(deck, reference=options.interface, notes=(said,))


def _adjacent_geometry(path: Path, K: Any) -> tuple[np.ndarray, Any, np.ndarray] | None:
    """Geometry that EXTSEOUT writes next to an OP4 file, the last three of ``Reduced``."""
    name = next(
        (x for x in (path.with_suffix(".asm"), path.with_suffix(".pch")) if x.is_file()), None
    )
    if name is None:
        return None
    uset, _, boundary, kept = pyyeti("bulk").asm2uset(str(name), try_rdextrn="pv_only")
    if K.shape != (np.count_nonzero(kept), np.count_nonzero(kept)):
        raise ModalError(
            f"stiffness is {K.shape}, but the geometry beside it has {np.count_nonzero(kept)}"
            " degrees of freedom; where the"
            " boundary has some directions of a grid only, the .pch file of EXTSEOUT is needed,"
            " too, which says which"
        )
    return boundary[kept], uset[boundary], np.flatnonzero(kept[boundary])


DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")


def missing_directions(points: Any, rows: np.ndarray) -> dict[int, list[str]]:
    """Directions of the grids of a table that are not among its ``rows``, by grid."""
    lost: dict[int, list[str]] = {}
    for k in sorted(set(range(len(points))) - set(rows.tolist())):
        grid, direction = points.index[k]
        if direction:
            lost.setdefault(int(grid), []).append(DIRECTIONS[int(direction) - 1])
    return lost


def _tied(K: Any, M: Any, boundary: np.ndarray, points: Any, rows: np.ndarray) -> Deck:
    """A model whose boundary grids, in ``rows`` of their table of degrees of freedom, are tied
    rigidly to the interface.
    """
    lost = missing_directions(points, rows)
    if lost:
        listed = "; ".join(
            f"grid {grid}: {', '.join(names)}" for grid, names in list(lost.items())[:6]
        )
        raise ModalError(
            f"its boundary lacks directions of {len(lost)} grids ({listed}), so that they are not"
            " clamped; reduce the model again"
            " with all six directions of each boundary grid (BSET1,123456)"
        )
    grids = grid_coordinates(points)
    said = (
        ()
        if len(grids) == 1
        else (f"The {len(grids)} boundary grids are tied rigidly to the interface point.",)
    )
    return replace(_fixed(K, M, boundary, rigid_motion(points)[rows]), grids=grids, notes=said)


def _boundary_of_six(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    """First or last six degrees of freedom, whichever leaves uncoupled modes of unit mass."""
    n = len(K)
    for boundary in (np.arange(n) < 6, np.arange(n) >= n - 6):
        modal, unit = K[np.ix_(~boundary, ~boundary)], M[np.ix_(~boundary, ~boundary)]
        if (
            n > 6
            and _diagonal(modal)
            and _diagonal(unit)
            and np.allclose(np.diag(unit), 1.0, rtol=1e-3)
        ):
            return boundary
    raise ModalError(
        f"neither the first nor the last six of {n} degrees of freedom are a boundary beside"
        " mass-normalised modes; put"
        " the .asm or .pch file of EXTSEOUT beside it"
    )


def _diagonal(A: np.ndarray) -> bool:
    return bool(np.abs(A - np.diag(np.diag(A))).max() <= 1e-4 * np.abs(A).max())


def _fixed(K: Any, M: Any, boundary: np.ndarray, R: np.ndarray) -> Deck:
    """Fixed-interface modes and participation M_bq of a Craig-Bampton model; ``R`` (b, 6) moves its
    boundary rigidly.
    """
    from scipy.linalg import LinAlgError, eigh

    for name, A in (("stiffness", K), ("mass", M)):
        if np.abs(A - A.T).max() > 1e-6 * np.abs(A).max():
            raise ModalError(f"its {name} matrix is not symmetric")
    inner = ~boundary
    K_qq, M_qq, M_bq = K[np.ix_(inner, inner)], M[np.ix_(inner, inner)], M[np.ix_(boundary, inner)]
    if not inner.any():
        raise ModalError("has a boundary, but no modes")
    if np.abs(K[np.ix_(boundary, inner)]).max() > 1e-3 * np.abs(K_qq).max():
        raise ModalError(
            "stiffness couples boundary and modes: this is not a model with fixed-interface modes"
        )
    try:
        eigenvalue, phi = eigh(K_qq, M_qq)
    except LinAlgError:
        raise ModalError("its modal mass matrix is not positive definite") from None
    frequency = natural_frequency(eigenvalue)
    mass = R.T @ M[np.ix_(boundary, boundary)] @ R
    _check_free(R.T @ K[np.ix_(boundary, boundary)] @ R, mass, float(frequency[0]))
    return Deck(frequency, R.T @ M_bq @ phi, mass)


def _check_free(stiffness: np.ndarray, mass: np.ndarray, first: float) -> None:
    """Moved rigidly at its boundary, nothing may hold the model elsewhere."""
    size = np.sqrt(np.maximum(np.diag(mass), 1e-300))
    held = np.linalg.eigvalsh(stiffness / np.outer(size, size)).max()
    frequency = float(natural_frequency(held))
    if frequency > GROUNDED * first:
        raise ModalError(
            f"the model is constrained other than at its boundary (rigid-body mode at {frequency:.3g}"
            " Hz; 0 Hz is expected)"
        )


def read_dmig(path: Path, options: ImportOptions) -> Deck:
    """Punched Craig-Bampton model (EXTSEOUT(DMIGPCH)); a file without DMIG entries is read for
    forces of constraint.
    """
    if not any(line.startswith("DMIG") for line in lines_of(path)):
        return read_punched(path, options)
    K, M, boundary, whole, rows = dmig_model(path)
    return _tied(K, M, boundary, whole, rows)


def dmig_model(path: Path) -> Reduced:
    """A model that EXTSEOUT(DMIGPCH) punched."""
    if path.stat().st_size > MAX_MATRIX_SIZE:
        raise ModalError(f"DMIG entries of at most {MAX_MATRIX_SIZE / 1e9:g} GB are read; use OP4")
    bulk = pyyeti("bulk")
    found = bulk.rddmig(str(path), square=True)
    pair = next((p for p in PAIRS if all(name in found for name in p)), None)
    if pair is None:
        raise ModalError(f"has the DMIG entries {', '.join(found).upper()}; expected KAAX and MAAX")
    stiffness = found[pair[0]]
    index = stiffness.index.union(found[pair[1]].index)
    K, M = (
        found[name].reindex(index=index, columns=index, fill_value=0.0).to_numpy(dtype=float)
        for name in pair
    )
    uset = bulk.bulk2uset(str(path))[0]
    boundary = index.get_level_values(1).to_numpy() > 0
    missing = index[boundary].difference(uset.index)
    if len(missing):
        raise ModalError(f"has no GRID entry of boundary grid {missing[0][0]}")
    whole = uset.loc[sorted({i for i, _ in index[boundary]})]
    return K, M, boundary, whole, whole.index.get_indexer(index[boundary])


def op4_model(path: Path) -> Reduced | None:
    """Modal model of an OP4 file with the geometry of EXTSEOUT next to it; None where it holds no such
    model.
    """
    pair = _pair(path)
    if pair is None:
        return None
    geometry = _adjacent_geometry(path, pair[0])
    if geometry is None:
        raise ModalError("has no geometry; the .asm or .pch file of EXTSEOUT is expected beside it")
    return *pair, *geometry
