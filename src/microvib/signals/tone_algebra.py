"""Compiled building blocks of tone fits: the spectrum of a damped tone under a Hann window, and
linear least squares.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from microvib.compiled import Unit

code = Unit(__name__)
_DEPENDENT = 1e-12
"""Squared norm of what is left of a (unit) column after projection on those before it; below, it
counts as dependent.
"""
COMPILE: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


@lru_cache(maxsize=2)
def half_turns(samples: int) -> np.ndarray:
    """Sine and cosine of pi j/N, j = 0 ... N - 1, (2, N): kept, for many records of one length come
    in a row.
    """
    j = np.arange(samples)
    angle = np.minimum(j, samples - j) * (
        np.pi / samples
    )  # small also at the end, so that its sine is exact there
    table = np.array([np.sin(angle), np.where(2 * j > samples, -np.cos(angle), np.cos(angle))])
    table.flags.writeable = False
    return table


@code.inner(**COMPILE)
def half(cycles, decay, k, table, out):
    """Spectrum at the bins ``k`` of exp((2 pi i cycles - decay) n/N), scaled as half a tone, into
    ``out`` (n,).

    Without a window, bin k of exp(z' n) is a geometric series, expm1(N z)/expm1(z) with z = z' - 2
    pi i k/N. The Hann window 1/2 - 1/4 exp(2 pi i n/N) - 1/4 exp(-2 pi i n/N) combines three of
    these, one bin apart. N z differs by whole turns between them, so that the numerator is common
    to all bins; the real part of z is common too, and what remains for each bin is the sine and
    cosine of one angle, from a table. expm1 keeps the digits where a tone is nearly on a bin.
    """
    samples = table.shape[1]
    whole = round(cycles)
    over = cycles - whole
    whole %= samples  # a series has the period N
    turn, angle = 2.0 * math.pi * over, over * (math.pi / samples)
    # expm1(N z)
    real = math.expm1(-decay) * math.cos(turn) - 2.0 * math.sin(0.5 * turn) ** 2
    imag = math.exp(-decay) * math.sin(turn)
    growth, less = 2.0 * math.exp(-decay / samples), math.expm1(-decay / samples)
    s_over, c_over = math.sin(angle), math.cos(angle)
    on_bin = less == 0.0 and abs(over) < 1e-15 * samples
    x, y, share = np.empty(k.size + 2), np.empty(k.size + 2), 2.0 / samples
    first = 0
    while first < k.size:
        after = first + 1
        while after < k.size and k[after] == k[after - 1] + 1:
            after += 1
        count, i = after - first + 2, 0
        while i < count:  # stretches without a wrap in the table, for vectors
            j = (whole - k[first] + 1 - i) % samples
            end = min(count, i + j + 1)
            for n in range(i, end):
                s = table[0, j + i - n] * c_over + table[1, j + i - n] * s_over
                c = table[1, j + i - n] * c_over - table[0, j + i - n] * s_over
                a, b = less - growth * s * s, growth * s * c
                inverse = 1.0 / (a * a + b * b)
                x[n], y[n] = (real * a + imag * b) * inverse, (imag * a - real * b) * inverse
            if on_bin and end == i + j + 1:
                x[end - 1], y[end - 1] = samples, 0.0
            i = end
        for n in range(after - first):
            out[first + n] = complex(
                (0.5 * x[n + 1] - 0.25 * (x[n] + x[n + 2])) * share,
                (0.5 * y[n + 1] - 0.25 * (y[n] + y[n + 2])) * share,
            )
        first = after


@code.inner(fastmath={"reassoc", "contract", "nsz"}, **COMPILE)
def dot(a, b):
    """Sum of products, in an order that vectors like."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@code.inner(**COMPILE)
def factored(columns):
    """Scales that make the columns unit vectors, and the Cholesky factor of the scaled normal
    equations, its diagonal inverted.

    Normal equations suffice: tones that can be told apart are well conditioned. A column that is
    zero or depends on those before it has a zero on the diagonal.
    """
    m = columns.shape[0]
    scale, factor = np.empty(m), np.empty((m, m))
    for i in range(m):
        norm = math.sqrt(dot(columns[i], columns[i]))
        scale[i] = 1.0 / norm if norm > 0.0 else 1.0
    for i in range(m):
        for j in range(i + 1):
            rest = dot(columns[i], columns[j]) * scale[i] * scale[j] - dot(
                factor[i, :j], factor[j, :j]
            )
            if j < i:
                factor[i, j] = rest * factor[j, j]
            else:
                factor[i, i] = 1.0 / math.sqrt(rest) if rest > _DEPENDENT else 0.0
    return scale, factor


@code.inner(**COMPILE)
def orthonormal(columns, scale, factor):
    """Make the columns orthonormal, in place; those that depend on others zero."""
    for i in range(columns.shape[0]):
        for n in range(columns.shape[1]):
            columns[i, n] *= scale[i]
        for j in range(i):
            for n in range(columns.shape[1]):
                columns[i, n] -= factor[i, j] * columns[j, n]
        for n in range(columns.shape[1]):
            columns[i, n] *= factor[i, i]


@code.inner(**COMPILE)
def take_out(basis, x):
    """Subtract from ``x`` what orthonormal columns make of it, in place."""
    for i in range(basis.shape[0]):
        part = dot(basis[i], x)
        for n in range(x.size):
            x[n] -= part * basis[i, n]


@code.inner(**COMPILE)
def solved(columns, scale, factor, right):
    """Least-squares solution from ``factored``: forward and back substitution; zero for a dependent
    column.
    """
    m = columns.shape[0]
    solution = np.empty(m)
    for i in range(m):
        solution[i] = (
            dot(columns[i], right) * scale[i] - dot(factor[i, :i], solution[:i])
        ) * factor[i, i]
    for i in range(m - 1, -1, -1):
        solution[i] *= factor[i, i]
        for j in range(i):
            solution[j] -= factor[i, j] * solution[i]
    for i in range(m):
        solution[i] *= scale[i]
    return solution


@code.inner(**COMPILE)
def subtract(columns, solution, right):
    """Subtract columns times the solution from the right-hand side, in place."""
    for i in range(solution.size):
        for j in range(right.size):
            right[j] -= solution[i] * columns[i, j]
