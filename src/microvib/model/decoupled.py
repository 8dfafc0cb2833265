"""Modes that damping couples, as modes that it does not: exact, one complex mode for each.

Modes zeta'' + D zeta' + Lambda zeta = -h alpha of a structure that turns with two shafts, theta =
(theta_l, theta_m), omega = theta', alpha = theta'', push back with h' zeta''. Let lambda and its
conjugate be eigenvalues of lambda^2 + lambda D + Lambda, with the shape v for which v' (2 lambda +
D) v = 1. The pair is a mode of its own,

    y'' + d y' + k y = -(a alpha + g omega),   which pushes back with a y'' + g y',
    d = -2 Re lambda,  k = abs(lambda)^2,  p + q lambda = c v,  a + g / lambda = c h' v,  c^2 = lambda - conj(lambda),

with real p, q (of each zeta), a, g (of each shaft). What is overdamped has two real eigenvalues,
lambda_1 > lambda_2, in place of lambda and its conjugate; v' (2 lambda + D) v is 1 for the first
and -1 for the second. Then (partial fractions)

    s^4 h' (s^2 + s D + Lambda)^-1 h = sum of s^2 (a s + g) (a s + g)' / (s^2 + d s + k)  -  s^2 sum of g g' / k
    zeta = sum of p y + q (y' + a' omega),     zeta' = sum of p y' - q (d y' + k y + g' omega)

so that the shafts feel the same if their inertia is greater by the sum of g g' / k. Where D is
diagonal g and q are zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEGLIGIBLE_COUPLING = 1e-14
"""Damping between two modes, over the geometric mean of their own, that is rounding."""
DAMPING_PERTURBATIONS = (0.0, 1e-10, 1e-8, 1e-6)
"""Parts by which own damping is changed, one mode unlike the other, where eigenvalues are one and
their shapes are not found.
"""
MAX_ORTHOGONALITY_ERROR = 1e-9
"""Error of the decoupled modes, over 1, at which a nudge is enough."""


@dataclass(frozen=True)
class DecoupledModes:
    """The modes y, in the order of the frequencies of those that they are made of."""

    d: np.ndarray
    """Damping, (s,) [1/s]."""
    k: np.ndarray
    """Squares of their frequencies, (s,) [1/s^2]."""
    a: np.ndarray
    """Participation in the accelerations of the shafts, (s, 2)."""
    g: np.ndarray
    """In their rates, (s, 2) [1/s]."""
    p: np.ndarray
    """The coupled modes by them, (s, s)."""
    q: np.ndarray
    """And by their rates, (s, s) [s]."""


def decouple_modes(D: np.ndarray, Lambda: np.ndarray, h: np.ndarray) -> DecoupledModes:
    """Decouple the modes of the symmetric damping matrix ``D`` (s, s), squares of frequencies ``Lambda`` (s,) and
    participation ``h`` (s, 2).
    """
    from scipy.sparse.csgraph import connected_components

    s, own = Lambda.size, np.sqrt(np.diag(D))
    d, k, p, q = np.diag(D).copy(), Lambda.copy(), np.eye(s), np.zeros((s, s))
    count, group = connected_components(
        np.abs(D) > NEGLIGIBLE_COUPLING * np.outer(own, own), directed=False
    )
    for one in range(count):
        i = np.flatnonzero(group == one)
        if i.size > 1:
            d[i], k[i], p[np.ix_(i, i)], q[np.ix_(i, i)] = _pairs(D[np.ix_(i, i)], Lambda[i])
    # h' p and h' q are a and g in other words: a + g/lambda = h' (p + q lambda), and 1/lambda =
    # -(lambda + d) / k.
    a, g = p.T @ h - (q * d).T @ h, -(q * k).T @ h
    return DecoupledModes(d, k, a, g, p, q)


Pairs = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _pairs(D: np.ndarray, Lambda: np.ndarray) -> Pairs:
    """d, k, p and q of modes that are coupled, nudged as little as their shapes need."""
    uneven, found = np.linspace(0.5, 1.5, Lambda.size), []
    for nudge in DAMPING_PERTURBATIONS:
        D_nudged = D + np.diag(np.diag(D) * nudge * uneven)
        pairs = _pairs_of(D_nudged, Lambda)
        if pairs is None:
            continue
        found.append((_error(pairs, D_nudged), pairs))
        if found[-1][0] < MAX_ORTHOGONALITY_ERROR:
            break
    return min(found, key=lambda one: one[0])[1]


def _pairs_of(D: np.ndarray, Lambda: np.ndarray) -> Pairs | None:
    """Pairs where eigenvalues are distinct; None where real ones cannot be paired."""
    s = Lambda.size
    values, vectors = np.linalg.eig(
        np.block([[np.zeros((s, s)), np.eye(s)], [-np.diag(Lambda), -D]])
    )
    v = vectors[:s].astype(complex)
    sign = np.sum(v * (D @ v + 2.0 * v * values), axis=0)
    v /= np.sqrt(sign)
    upper = np.flatnonzero(values.imag > 0.0)
    first, second = [values[upper]], [values[upper].conj()]
    shape, other = [v[:, upper]], [v[:, upper].conj()]
    real = np.flatnonzero(values.imag == 0.0)
    slow, fast = real[sign[real].real > 0.0], real[sign[real].real <= 0.0]
    if real.size:
        partner = _partners(values.real, v, slow, fast)
        if partner is None:
            return None
        first, second = [*first, values[slow]], [*second, values[partner]]
        turned = 1j * v[:, partner]
        shape, other = (
            [*shape, v[:, slow]],
            [*other, turned * np.sign(np.sum(v[:, slow] * turned, axis=0).real)],
        )
    x, y = np.concatenate(first), np.concatenate(second)
    c, along, across = np.sqrt(x - y), np.hstack(shape), np.hstack(other)
    c_other = np.where(x.imag > 0.0, c.conj(), c)
    q = (c * along - c_other * across) / (x - y)
    p = c * along - q * x
    order = np.argsort((x * y).real, kind="stable")
    return -(x + y).real[order], (x * y).real[order], p.real[:, order], q.real[:, order]


def _partners(
    values: np.ndarray, v: np.ndarray, slow: np.ndarray, fast: np.ndarray
) -> np.ndarray | None:
    """The faster partner of each of the ``slow`` real eigenvalues, of the shape most like its own."""
    from scipy.optimize import linear_sum_assignment

    if slow.size != fast.size:
        return None
    size = np.linalg.norm(v, axis=0)
    alike = np.abs(v[:, slow].T @ v[:, fast]) / np.outer(size[slow], size[fast])
    allowed = values[slow][:, None] > values[fast]
    _, column = linear_sum_assignment(np.where(allowed, -alike, 2.0 * slow.size))
    partner: np.ndarray = fast[column]
    if np.all(values[slow] > values[partner]):
        return partner
    return None


def _error(pairs: Pairs, D: np.ndarray) -> float:
    """By how much the mass of the decoupled modes is not 1, over what may cancel: modes that are
    nearly one have large shapes.
    """
    d, k, p, q = pairs
    unit = p.T @ D @ q + p.T @ (p - q * d) - (k[:, None] * q.T) @ q
    difference = np.abs(unit - np.eye(k.size))
    if np.all(np.isfinite(difference)):
        return float(np.max(difference) * np.max(p**2))
    return np.inf
