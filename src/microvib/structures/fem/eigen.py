"""Lowest modes of a sparse system: shift-invert Lanczos on a sparse factorisation."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from microvib.structures.fem.structure import StructureError

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
