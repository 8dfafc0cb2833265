"""Responses of a flexible hub by its modes."""

import numpy as np

from microvib.model.spacecraft import Hub


def payload_rotations(hub: Hub, f: np.ndarray, point: str) -> np.ndarray:
    """Rotations of the payload about x and y by unit loads at a point, (n, 2, 6)."""
    shapes = np.array([mode.shapes for mode in hub.modes])
    names = [one.name for one in hub.points]
    own = np.array([mode.frequency for mode in hub.modes])
    xi = np.array([mode.damping for mode in hub.modes])
    stiff = 4.0 * np.pi**2 * (own**2 - f[:, None] ** 2 + 2j * xi * own * f[:, None])
    payload, there = shapes[:, names.index("payload"), 3:5], shapes[:, names.index(point)]
    return np.asarray(np.einsum("fs,sa,sb->fab", 1.0 / stiff, payload, there))
