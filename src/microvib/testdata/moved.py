"""Torques about another point: the virtual bench and the preparation of recordings move them alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from microvib.testdata.recording import Recording


def moving_matrix(r: Sequence[float] | np.ndarray) -> np.ndarray:
    """Six components with torques about the point ``r`` (3,) [m] over those with torques about the
    origin, (6, 6): M - r x F.
    """
    x, y, z = r
    A = np.eye(6)
    A[3:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return A


def with_moved_torques(recording: Recording, r: Sequence[float] | np.ndarray) -> Recording:
    """Torques about the point ``r`` (3,) [m] of the table's frame instead of its origin. The noise of
    forces comes along on its lever arms; a note says by how much it raises the floors.
    """
    r = np.asarray(r, dtype=float)
    return recording.combined(moving_matrix(r), f"torques about {r.tolist()} m")
