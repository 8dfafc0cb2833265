"""Matrices of the linearised drive, on whatever its output carries."""

from __future__ import annotations

import numpy as np

from microvib.model.friction import Friction
from microvib.model.load import Load
from microvib.model.motor import Motor
from microvib.model.reducer import Reducer


def drive_matrices(
    motor: Motor, reducer: Reducer, friction: Friction, load: Load
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, damping and stiffness by the coordinates theta_m, theta_l (not if rigid) and the modes
    of a ``load`` (Eq. 16-18).
    """
    s, h, spring = load.H.size, reducer.h, motor.electromagnetic_stiffness
    M, C, K = (np.zeros((2 + s, 2 + s)) for _ in range(3))
    M[0, 0], M[1, 1] = load.rotor, load.output
    M[0, 1] = M[1, 0] = load.cross
    M[0, 2:] = M[2:, 0] = load.R
    M[1, 2:] = M[2:, 1] = load.H
    M[2:, 2:] = np.eye(s)
    C[0, 0], C[1, 1] = motor.viscous, friction.viscous
    C[2:, 2:] = np.diag(load.D)
    C[0, 2:] = C[2:, 0] = load.V_m
    C[1, 2:] = C[2:, 1] = load.V_l
    K[0, 0] = spring
    if friction.harness is not None:
        K[1, 1] = friction.harness.stiffness
    K[2:, 2:] = np.diag(load.Lambda)
    if reducer.rigid:
        T = coordinates(reducer, s)
        return T.T @ M @ T, T.T @ C @ T, T.T @ K @ T
    gear = np.array([-1.0 / h, -1.0])
    K[:2, :2] += float(reducer.stiffness) * np.outer(gear, gear)
    C[:2, :2] += reducer.damping * np.outer(gear, gear)
    return M, C, K


def coordinates(reducer: Reducer, modes: int) -> np.ndarray:
    """theta_m, theta_l and ``modes`` by the coordinates of the matrices, (2 + s, n): the same, or
    without theta_l if rigid.
    """
    T = np.eye(2 + modes)
    if reducer.rigid:  # theta_m = -h theta_l (Eq. 19)
        T[1, 0] = -1.0 / reducer.h
        T = np.delete(T, 1, axis=1)
    return T
