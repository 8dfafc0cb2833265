"""Nodes of a step, and the polynomials through what is known there, as coefficients and as weights."""

import math

import numpy as np

CUBES = np.array([0.0, 0.5 - math.sqrt(0.05), 0.5 + math.sqrt(0.05), 1.0])
"""Nodes of a step, as fractions of it: Lobatto's, both ends among them."""

# Coefficients become constants of compiled code. Products of small polynomials give the same digits
# on every processor, which the library's inverse of a matrix does not.


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Coefficients of a product of polynomials, lowest power first."""
    product = np.zeros(a.size + b.size - 1)
    for power, factor in enumerate(b):
        product[power : power + a.size] += factor * a
    return product


def _lagrange(j: int) -> np.ndarray:
    """Coefficients of the cubic that is 1 at node ``j`` and 0 at the others."""
    cubic = np.ones(1)
    for node in np.delete(CUBES, j):
        cubic = _times(cubic, np.array([-node, 1.0]) / (CUBES[j] - node))
    return cubic


LAGRANGE = np.array([_lagrange(j) for j in range(4)])
"""Coefficients of the cubics l_j, (node, power)."""
HIGHEST = np.array([1.0, -math.sqrt(5.0), math.sqrt(5.0), -1.0]) * -0.5
"""Weights of the highest Legendre term of a cubic, peak to peak (twice its coefficient), by its
values at the nodes.
"""


def _hermite() -> np.ndarray:
    """Coefficients of the polynomial of degree 7 with given values and slopes at the nodes, (power,
    4 values and 4 slopes).
    """
    squares = [_times(cubic, cubic) for cubic in LAGRANGE]
    offsets = [np.array([-node, 1.0]) for node in CUBES]
    slopes = [float(np.sum(1.0 / (node - np.delete(CUBES, j)))) for j, node in enumerate(CUBES)]
    lines = [np.array([1.0, 0.0]) - 2.0 * rise * x for x, rise in zip(offsets, slopes, strict=True)]
    by_value = [_times(square, line) for square, line in zip(squares, lines, strict=True)]
    by_slope = [_times(square, x) for square, x in zip(squares, offsets, strict=True)]
    return np.array([*by_value, *by_slope]).T.copy()


HERMITE = _hermite()


def _onwards() -> np.ndarray:
    """Values at the nodes of another step by those of this one, (step, 4 nodes of this, 4 of that).

    Of the first half of this step; of the next step of half its length, of its length, and, by the
    end's slope, of twice that.
    """
    cubic = [
        at[:, None] ** np.arange(4) @ LAGRANGE.T
        for at in (0.5 * CUBES, 1.0 + 0.5 * CUBES, 1.0 + CUBES)
    ]
    slope = LAGRANGE @ np.arange(4)
    line = np.eye(4)[3] + 2.0 * CUBES[:, None] * slope
    return np.array([values.T for values in (*cubic, line)])


ONWARDS = _onwards()
FIRST_HALF, HALF, SAME, TWICE = range(4)
