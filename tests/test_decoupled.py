"""Modes that damping couples against the matrices themselves, also where eigenvalues are one or their shapes are."""

import numpy as np
import pytest
from scipy.optimize import brentq, root

from microvib.model.decoupled import decouple_modes

H = np.array([[1.0, 0.3], [-0.7, 0.2], [0.4, -1.1], [0.6, 0.9]])


def eigenvalues(D: np.ndarray, Lambda: np.ndarray) -> np.ndarray:
    s = Lambda.size
    return np.linalg.eigvals(np.block([[np.zeros((s, s)), np.eye(s)], [-np.diag(Lambda), -D]]))


def mixed(damping: float, frequency: np.ndarray) -> np.ndarray:
    """Damping in other shapes than the modes', of such a ratio."""
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(frequency.size, frequency.size)))[0]
    return np.asarray(
        turn @ np.diag(2.0 * damping * frequency[::-1] * [0.3, 1.0, 2.5, 0.7]) @ turn.T
    )


def defective() -> tuple[np.ndarray, np.ndarray]:
    """One mode damped critically by what couples it with another."""
    Lambda = np.array([1.0, 9.0])

    def damping(own: float) -> np.ndarray:
        return np.array([[own, 0.3], [0.3, 0.4]])

    def gap(own: float) -> float:
        lowest = sorted(eigenvalues(damping(own), Lambda), key=abs)[:2]
        return float(((lowest[0] - lowest[1]) ** 2).real)

    return damping(brentq(gap, 1.6, 2.6, xtol=1e-15)), Lambda


def exceptional() -> tuple[np.ndarray, np.ndarray]:
    """Two modes that damping makes one."""

    def model(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([[0.1 * (1.0 + x[1]), 0.05], [0.05, 0.1]]), np.array(
            [1.0, (1.05 + x[0]) ** 2]
        )

    def gap(x: np.ndarray) -> list[float]:
        upper = [value for value in eigenvalues(*model(x)) if value.imag > 0.0]
        square = 1e3 * (upper[0] - upper[1]) ** 2
        return [square.real, square.imag]

    return model(root(gap, [0.0, 0.0], tol=1e-15).x)


def repeated() -> tuple[np.ndarray, np.ndarray]:
    """Two systems of two modes with the same eigenvalues, in coordinates that couple them."""
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.kron(np.diag([1.0, 0.0]), np.eye(2)) + np.kron(
        np.diag([0.0, 1.0]), np.array([[c, -s], [s, c]])
    )
    D = turn.T @ np.kron(np.array([[0.3, 0.1], [0.1, 0.5]]), np.eye(2)) @ turn
    return D, np.array([1.0, 1.0, 4.0, 4.0])


FREQUENCY = np.array([0.3, 1.0, 1.1, 7.0])
CASES = {
    **{f"mixed {z}": ((mixed(z, FREQUENCY), FREQUENCY**2), 1e-10) for z in (0.005, 0.3, 1.0, 3.0)},
    "one critical of equal": ((mixed(1.0, np.ones(4)), np.ones(4)), 1e-5),
    "repeated": (repeated(), 1e-5),
    "defective": (defective(), 1e-5),
    "exceptional": (exceptional(), 1e-5),
    "three critical": ((np.full((3, 3), 0.2) + 2.0 * np.eye(3), np.ones(3)), 1e-5),
}


@pytest.mark.parametrize("case", CASES)
def test_shafts_and_modes_move_as_with_the_whole_matrix(case: str) -> None:
    (D, Lambda), within = CASES[case]
    s, h = Lambda.size, H[: Lambda.size]
    y = decouple_modes(D, Lambda, h)
    assert np.all(y.k > 0.0)
    assert np.all(y.d > 0.0)
    for jw in 1j * np.geomspace(0.05, 20.0, 21):
        zeta = -(jw**2) * np.linalg.solve(jw**2 * np.eye(s) + jw * D + np.diag(Lambda), h)
        response = -jw * (y.a * jw + y.g) / (jw**2 + jw * y.d + y.k)[:, None]
        found = y.p @ response + y.q @ (jw * response + jw * y.a)
        rate = jw * y.p @ response - y.q @ ((jw * y.d + y.k)[:, None] * response + jw * y.g)
        reaction = (jw**2 * y.a + jw * y.g).T @ response + jw**2 * (y.g.T / y.k) @ y.g
        assert np.abs(found - zeta).max() < within * np.abs(zeta).max()
        assert np.abs(rate - jw * zeta).max() < within * np.abs(jw * zeta).max()
        assert (
            np.abs(reaction - jw**2 * h.T @ zeta).max() < within * np.abs(jw**2 * h.T @ zeta).max()
        )


def test_modes_that_damping_does_not_couple_stay_what_they_are() -> None:
    d, Lambda = np.array([0.1, 0.0, 5.0, 0.3]), np.array([1.0, 1.0, 2.0, 30.0])
    y = decouple_modes(np.diag(d), Lambda, H)
    for found, wanted in ((y.d, d), (y.k, Lambda), (y.a, H), (y.p, np.eye(4))):
        assert found.tolist() == wanted.tolist()
    assert not np.any(y.g)
    assert not np.any(y.q)
