"""Damped tones under a Hann window, compiled: their spectra in closed form, and least-squares fits to the bins about them.

Frequencies are in cycles per record and decays in e-foldings per record, (m,) each. Bins ``k`` (n,) ascend. A spectrum
``values`` is one-sided and scaled so that a steady tone on a bin reads its amplitude.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit

REACH = 6
"""Bins on each side of a line that its fit uses."""
FAR = 400
"""Bins on each side from which a known tone is taken out; beyond, a Hann window leaves 1e-8 of it."""
_ABOUT = (4, 20)
"""Bins on each side of a line, from and to, that its floor is of."""
_NUDGE = 1e-4
"""Step of difference quotients, in cycles or e-foldings over the record."""
_DEPENDENT = 1e-12
"""Square of the part of a column that the columns before it leave, below which it is made up of them."""
COMPILE: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


@lru_cache(maxsize=2)
def half_turns(samples: int) -> np.ndarray:
    """Sine and cosine of pi j/N, j = 0 ... N - 1, (2, N): kept, for many records of one length come in a row."""
    j = np.arange(samples)
    angle = np.minimum(j, samples - j) * (np.pi / samples)  # small also at the end, so that its sine is exact there
    table = np.array([np.sin(angle), np.where(2 * j > samples, -np.cos(angle), np.cos(angle))])
    table.flags.writeable = False
    return table


@njit(**COMPILE)
def _half(cycles, decay, k, table, out):
    """Spectrum at the bins ``k`` of exp((2 pi i cycles - decay) n/N), scaled as half a tone, into ``out`` (n,).

    Three geometric series expm1(N z)/expm1(z), one bin apart, make a Hann window. N z differs by whole turns between them and
    between bins, and the real part of z not at all, so that the sine and cosine of one angle are left for each.
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
    series = np.empty(k.size + 2, np.complex128)
    first = 0
    while first < k.size:
        after = first + 1
        while after < k.size and k[after] == k[after - 1] + 1:
            after += 1
        for i in range(after - first + 2):
            j = whole - k[first] + 1 - i
            j += samples if j < 0 else (-samples if j >= samples else 0)
            s = table[0, j] * c_over + table[1, j] * s_over
            c = table[1, j] * c_over - table[0, j] * s_over
            a, b = less - growth * s * s, growth * s * c
            inverse = 1.0 / (a * a + b * b)
            series[i] = complex((real * a + imag * b) * inverse, (imag * a - real * b) * inverse)
            if on_bin and j == 0:
                series[i] = samples
        for i in range(after - first):
            out[first + i] = (0.5 * series[i + 1] - 0.25 * (series[i] + series[i + 2])) * (2.0 / samples)
        first = after


@njit(**COMPILE)
def tone(cycles, decay, amplitude, k, table):
    """Spectrum at the bins ``k`` of Re(amplitude exp((2 pi i cycles - decay) n/N)), (n,) complex."""
    plus, minus = np.empty(k.size, np.complex128), np.empty(k.size, np.complex128)
    _half(cycles, decay, k, table, plus)
    _half(-cycles, decay, k, table, minus)
    for i in range(k.size):
        plus[i] = amplitude * plus[i] + amplitude.conjugate() * minus[i]
    return plus


@njit(**COMPILE)
def bins_in(low, high, reach, size):
    """Bins, of ``size`` that there are, that are within ``reach`` of a band from ``low`` to ``high``, of several (m,)."""
    inside, count = np.zeros(size, np.bool_), 0
    for i in range(low.size):
        for k in range(max(round(low[i]) - reach, 0), min(round(high[i]) + reach + 1, size)):
            count += not inside[k]
            inside[k] = True
    bins = np.empty(count, np.int64)
    for k in range(size - 1, -1, -1):
        if inside[k]:
            count -= 1
            bins[count] = k
    return bins


@njit(**COMPILE)
def equations(cycles, decay, k, values, table):
    """Real least-squares equations at the bins ``k``: columns (2 m + 1, 2 n) of which x makes the right-hand side (2 n,).

    Columns are cosine and minus sine of each tone, and a constant; rows are real parts, then imaginary ones.
    """
    m, n = cycles.size, k.size
    columns = np.empty((2 * m + 1, 2 * n))
    plus, minus = np.empty(n, np.complex128), np.empty(n, np.complex128)
    for i in range(m):
        _half(cycles[i], decay[i], k, table, plus)
        _half(-cycles[i], decay[i], k, table, minus)
        for j in range(n):
            p, q = plus[j], minus[j]
            columns[2 * i, j], columns[2 * i, n + j] = p.real + q.real, p.imag + q.imag
            columns[2 * i + 1, j], columns[2 * i + 1, n + j] = q.imag - p.imag, p.real - q.real
    _half(0.0, 0.0, k, table, plus)
    right = np.empty(2 * n)
    for j in range(n):
        columns[2 * m, j], columns[2 * m, n + j] = plus[j].real, plus[j].imag
        right[j], right[n + j] = values[k[j]].real, values[k[j]].imag
    return columns, right


@njit(fastmath={"reassoc", "contract", "nsz"}, **COMPILE)
def _dot(a, b):
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@njit(**COMPILE)
def _factored(columns):
    """Scales of columns, and the Cholesky factor of their scaled normal equations, its diagonal inverted: tones that can be told
    apart are well conditioned. A column that those before it make up, or that is zero, has a zero there."""
    m = columns.shape[0]
    scale, factor = np.empty(m), np.empty((m, m))
    for i in range(m):
        norm = math.sqrt(_dot(columns[i], columns[i]))
        scale[i] = 1.0 / norm if norm > 0.0 else 1.0
    for i in range(m):
        for j in range(i + 1):
            rest = _dot(columns[i], columns[j]) * scale[i] * scale[j] - _dot(factor[i, :j], factor[j, :j])
            if j < i:
                factor[i, j] = rest * factor[j, j]
            else:
                factor[i, i] = 1.0 / math.sqrt(rest) if rest > _DEPENDENT else 0.0
    return scale, factor


@njit(**COMPILE)
def _solved(columns, scale, factor, right):
    """Least-squares solution with the columns as ``_factored`` has them; nothing for a column that others make up."""
    m = columns.shape[0]
    solution = np.empty(m)
    for i in range(m):
        solution[i] = (_dot(columns[i], right) * scale[i] - _dot(factor[i, :i], solution[:i])) * factor[i, i]
    for i in range(m - 1, -1, -1):
        solution[i] *= factor[i, i]
        for j in range(i):
            solution[j] -= factor[i, j] * solution[i]
    for i in range(m):
        solution[i] *= scale[i]
    return solution


@njit(**COMPILE)
def least_squares(columns, right):
    """Least squares by scaled normal equations; a column that those before it make up, or that is zero, gets nothing."""
    scale, factor = _factored(columns)
    return _solved(columns, scale, factor, right)


@njit(**COMPILE)
def _take_out(columns, solution, right):
    """Take columns times the solution from the right-hand side."""
    for i in range(solution.size):
        for j in range(right.size):
            right[j] -= solution[i] * columns[i, j]


@njit(**COMPILE)
def residual(cycles, decay, k, values, table):
    """What the tones that fit best leave at the bins ``k``, (2 n,): real parts, then imaginary ones."""
    columns, rest = equations(cycles, decay, k, values, table)
    _take_out(columns, least_squares(columns, rest), rest)
    return rest


@njit(**COMPILE)
def _slopes(there, fold, free, falls, clock, k, values, table, slopes):
    """How what is left changes with the parameters of ``fit``, into the rows of ``slopes`` (p, 2 n at least).

    Each is the change of the model at fixed amplitudes less what amplitudes make up for (Kaufman's variable projection): one
    factorisation serves all parameters, and the minimum is that of the whole derivative.
    """
    columns, right = equations(there, fold, k, values, table)
    scale, factor = _factored(columns)
    solution = _solved(columns, scale, factor, right)
    highest = 1.0
    for i in clock:
        highest = max(highest, there[i])
    for j in range(slopes.shape[0]):
        change = np.zeros(right.size)
        if j < free.size:
            _add_change(there, fold, solution, free[j], _NUDGE, 0.0, 1.0, k, table, change)
        elif j < free.size + falls.size:
            _add_change(there, fold, solution, falls[j - free.size], 0.0, _NUDGE, 1.0, k, table, change)
        else:
            for i in clock:
                _add_change(there, fold, solution, i, _NUDGE, 0.0, there[i] / highest, k, table, change)
        _take_out(columns, _solved(columns, scale, factor, change), change)
        slopes[j, : change.size] = -change


@njit(**COMPILE)
def _add_change(there, fold, solution, i, turn, fall, times, k, table, change):
    """Add to ``change`` (2 n,) the derivative of tone ``i`` by its frequency or its decay, so many ``times``."""
    a, n, twice = complex(solution[2 * i], solution[2 * i + 1]), k.size, 2.0 * (turn + fall)
    after = tone(there[i] + turn, fold[i] + fall, a, k, table)
    before = tone(there[i] - turn, fold[i] - fall, a, k, table)
    for j in range(n):
        slope = (after[j] - before[j]) * (times / twice)
        change[j] += slope.real
        change[n + j] += slope.imag


@njit(**COMPILE)
def amplitudes(cycles, decay, values, table):
    """Complex amplitudes of all tones together, (m,); least squares over the bins about them."""
    k = bins_in(cycles, cycles, REACH, values.size)
    columns, right = equations(cycles, decay, k, values, table)
    solution = least_squares(columns, right)
    result = np.empty(cycles.size, np.complex128)
    for i in range(cycles.size):
        result[i] = complex(solution[2 * i], solution[2 * i + 1])
    return result


@njit(**COMPILE)
def without(cycles, decay, amplitudes, values, table):
    """A spectrum with tones taken out, each from the bins where it stands out of rounding."""
    rest = values.copy()
    for i in range(cycles.size):
        centre = round(cycles[i])
        band = np.arange(max(centre - FAR, 0), min(centre + FAR + 1, rest.size))
        taken = tone(cycles[i], decay[i], amplitudes[i], band, table)
        for j in range(band.size):
            rest[band[j]] -= taken[j]
    return rest


@njit(**COMPILE)
def floor(cycles, values):
    """Median amplitude of the bins 4 to 20 away from one tone."""
    centre = round(cycles)
    about = np.empty(2 * (_ABOUT[1] - _ABOUT[0] + 1))
    count = 0
    for away in range(_ABOUT[0], _ABOUT[1] + 1):
        for k in (centre - away, centre + away):
            if 1 <= k < values.size:
                at, new = count, abs(values[k])
                while at > 0 and about[at - 1] > new:
                    about[at] = about[at - 1]
                    at -= 1
                about[at] = new
                count += 1
    return 0.5 * (about[(count - 1) // 2] + about[count // 2]) if count else 0.0


@njit(**COMPILE)
def floors(cycles, values):
    """Floor about each tone, (m,)."""
    result = np.empty(cycles.size)
    for i in range(cycles.size):
        result[i] = floor(cycles[i], values)
    return result


@njit(**COMPILE)
def own(cycles, values):
    """RMS of the magnitudes in the bins of each tone, (m,)."""
    result = np.zeros(cycles.size)
    for i in range(cycles.size):
        total, count = 0.0, 0
        for k in range(max(round(cycles[i]) - REACH, 1), min(round(cycles[i]) + REACH + 1, values.size)):
            total += values[k].real ** 2 + values[k].imag ** 2
            count += 1
        result[i] = math.sqrt(total / count) if count else 0.0
    return result


@njit(**COMPILE)
def correlated(columns, k, noise):
    """Columns (p, 2 n) at the bins ``k`` times the covariance of noise of RMS ``noise`` (n,), which the window correlates."""
    n = k.size
    result = np.empty_like(columns)
    for i in range(columns.shape[0]):
        for part in (0, n):
            for j in range(n):
                total = noise[j] * columns[i, part + j]
                for other in range(max(j - 2, 0), min(j + 3, n)):
                    away = abs(k[other] - k[j])
                    if away == 1 or away == 2:
                        total += (-2.0 / 3.0 if away == 1 else 1.0 / 6.0) * noise[other] * columns[i, part + other]
                result[i, part + j] = noise[j] * total
    return result


@njit(**COMPILE)
def peak(low, high, margin, values):
    """Frequency and amplitude of the highest peak from ``low`` to ``high``, both widened by ``margin`` bins."""
    first = max(math.floor(low - margin), 1)
    last = min(math.ceil(high + margin), values.size - 2)
    best, top = first, -1.0
    for k in range(first, last + 1):
        if abs(values[k]) > top:
            best, top = k, abs(values[k])
    best = min(max(best, 1), values.size - 2)
    left, centre, right = abs(values[best - 1]), abs(values[best]), abs(values[best + 1])
    side, neighbour = (1.0, right) if right >= left else (-1.0, left)
    ratio = neighbour / centre if centre > 0.0 else 0.0
    return best + side * (2.0 * ratio - 1.0) / (ratio + 1.0), centre


@njit(**COMPILE)
def fit(cycles, decay, free, falls, clock, low, high, k, values, table):
    """Frequencies and decays of tones that leave least at the bins ``k``, amplitudes eliminated: damped Gauss-Newton.

    Parameters, each from ``low`` to ``high`` (p,), are the frequencies of the tones ``free``, the decays of those that ``falls``
    names and, where ``clock`` names any, a shift of these together, in bins of the highest of them, that keeps their ratios.
    Returned are frequencies, decays and the parameters.
    """
    at = np.empty(low.size)
    for i in range(free.size):
        at[i] = cycles[free[i]]
    for i in range(falls.size):
        at[free.size + i] = decay[falls[i]]
    if clock.size > 0:
        at[-1] = 0.0
    for i in range(at.size):
        at[i] = _within(at[i], low[i], high[i])
    there, fold = _placed(at, cycles, decay, free, falls, clock)
    r = residual(there, fold, k, values, table)
    n, damping = r.size, 1e-3
    slopes, right = np.zeros((at.size, n + at.size)), np.zeros(n + at.size)
    fresh = False
    for _ in range(60):
        if not fresh:
            right[:n] = -r
            _slopes(there, fold, free, falls, clock, k, values, table, slopes)
            fresh = True
        for j in range(at.size):  # the damping, as further equations
            slopes[j, n + j] = math.sqrt(damping * _dot(slopes[j, :n], slopes[j, :n]))
        step = least_squares(slopes, right)
        new, largest = np.empty(at.size), 0.0
        for j in range(at.size):
            decays = free.size <= j < free.size + falls.size
            reach = max(0.5, 0.3 * abs(at[j])) if decays else 0.5
            new[j] = _within(at[j] + _within(step[j], -reach, reach), low[j], high[j])
            largest = max(largest, abs(new[j] - at[j]))
        there, fold = _placed(new, cycles, decay, free, falls, clock)
        r_new = residual(there, fold, k, values, table)
        if _dot(r_new, r_new) > _dot(r, r):
            damping *= 8.0
            if damping > 1e8 or largest < 1e-9:
                break
            continue
        at, r, damping, fresh = new, r_new, max(0.2 * damping, 1e-12), False
        if largest < 1e-9:
            break
    there, fold = _placed(at, cycles, decay, free, falls, clock)
    return there, fold, at


@njit(**COMPILE)
def _placed(at, cycles, decay, free, falls, clock):
    """Frequencies and decays of all tones, where parameters of ``fit`` put them."""
    there, fold = cycles.copy(), decay.copy()
    for i in range(free.size):
        there[free[i]] = at[i]
    for i in range(falls.size):
        fold[falls[i]] = at[free.size + i]
    if clock.size > 0:
        highest = 1.0
        for i in clock:
            highest = max(highest, cycles[i])
        for i in clock:
            there[i] = cycles[i] * (1.0 + at[-1] / highest)
    return there, fold


@njit(**COMPILE)
def _within(x, low, high):
    return min(max(x, low), high)
