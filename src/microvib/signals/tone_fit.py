"""Least-squares fits of damped tones to the bins about them, compiled;
``microvib.signals.tone_kernel`` states the model.

What stands still while others move, all known tones near them, is made an orthonormal basis once
and taken out of everything else (``known``), so that a step costs the tones that move alone.
"""

from __future__ import annotations

import math

import numpy as np

from microvib.compiled import Complexes, Counts, Matrix, Unit, Vector
from microvib.signals.tone_algebra import (
    COMPILE,
    dot,
    factored,
    orthonormal,
    solved,
    subtract,
    take_out,
)
from microvib.signals.tone_kernel import (
    NUDGE,
    REACH,
    add_tones,
    amplitudes,
    bins_in,
    constant,
    least_squares,
    spectra,
    tone,
)

code = Unit(__name__, "tone_kernel.py")


@code.entry(**COMPILE)
def known(
    cycles: Vector, decay: Vector, k: Counts, values: Complexes, table: Matrix
) -> tuple[Matrix, Vector]:
    """Quantities that stay the same while other tones move: an orthonormal basis (2 m, 2 n) of
    the spectra of tones that stand still, and the values at the bins ``k``, (2 n,), less what these
    make of them."""
    n = k.size
    basis, right = np.empty((2 * cycles.size, 2 * n)), np.empty(2 * n)
    spectra(cycles, decay, k, table, basis)
    for j in range(n):
        right[j], right[n + j] = values[k[j]].real, values[k[j]].imag
    scale, factor = factored(basis)
    orthonormal(basis, scale, factor)
    take_out(basis, right)
    return basis, right


@code.inner(**COMPILE)
def _beside(cycles, decay, k, basis, table):
    """The columns of tones and of a constant, less what those of the ``basis`` make of them."""
    columns = np.empty((2 * cycles.size + 1, 2 * k.size))
    spectra(cycles, decay, k, table, columns)
    constant(k, table, columns[2 * cycles.size])
    for i in range(columns.shape[0]):
        take_out(basis, columns[i])
    return columns


@code.entry(**COMPILE)
def residual(
    cycles: Vector, decay: Vector, k: Counts, basis: Matrix, right: Vector, table: Matrix
) -> Vector:
    """Residual at the bins ``k`` with the best amplitudes, (2 n,), beside what is ``known``: real
    parts, then imaginary ones.
    """
    columns, rest = _beside(cycles, decay, k, basis, table), right.copy()
    subtract(columns, least_squares(columns, rest), rest)
    return rest


@code.entry(**COMPILE)
def _slopes(
    cycles: Vector,
    decay: Vector,
    free: Counts,
    falls: Counts,
    clock: Counts,
    k: Counts,
    basis: Matrix,
    right: Vector,
    table: Matrix,
    slopes: Matrix,
) -> None:
    """Derivatives of the residual by the parameters of ``fit``, into the rows of ``slopes`` (p, 2 n
    at least).

    With the columns Phi(f, d) and amplitudes a = Phi^+ v, the residual is (I - Phi Phi^+) v.
    Kaufman's form of variable projection keeps the first of the two terms of its derivative, -(I -
    Phi Phi^+) (d Phi/d parameter) a: the change of the model at fixed amplitudes, less what a
    change of the amplitudes can make up for. One factorisation of Phi serves all parameters. The
    term left out is orthogonal to the residual at every point, so that the gradient, and with it
    the minimum, are exact.
    """
    columns = _beside(cycles, decay, k, basis, table)
    scale, factor = factored(columns)
    solution = solved(columns, scale, factor, right)
    highest = 1.0
    for i in clock:
        highest = max(highest, cycles[i])
    for j in range(slopes.shape[0]):
        change = np.zeros(right.size)
        if j < free.size:
            _add_change(cycles, decay, solution, free[j], NUDGE, 0.0, 1.0, k, table, change)
        elif j < free.size + falls.size:
            _add_change(
                cycles, decay, solution, falls[j - free.size], 0.0, NUDGE, 1.0, k, table, change
            )
        else:
            for i in clock:
                _add_change(
                    cycles, decay, solution, i, NUDGE, 0.0, cycles[i] / highest, k, table, change
                )
        take_out(basis, change)
        subtract(columns, solved(columns, scale, factor, change), change)
        for i in range(change.size):
            slopes[j, i] = -change[i]


@code.inner(**COMPILE)
def _add_change(cycles, decay, solution, i, turn, fall, times, k, table, change):
    """Add to ``change`` (2 n,) ``times`` the derivative of tone ``i`` by its frequency or decay,
    from central differences.
    """
    a, n, twice = complex(solution[2 * i], solution[2 * i + 1]), k.size, 2.0 * (turn + fall)
    after = tone(cycles[i] + turn, decay[i] + fall, a, k, table)
    before = tone(cycles[i] - turn, decay[i] - fall, a, k, table)
    for j in range(n):
        slope = (after[j] - before[j]) * (times / twice)
        change[j] += slope.real
        change[n + j] += slope.imag


@code.entry(**COMPILE)
def fit(
    cycles: Vector,
    decay: Vector,
    free: Counts,
    falls: Counts,
    clock: Counts,
    low: Vector,
    high: Vector,
    k: Counts,
    values: Complexes,
    table: Matrix,
) -> tuple[Vector, Vector, Vector]:
    """Frequencies and decays of tones that minimise the residual at the bins ``k``, amplitudes
    eliminated.

    The parameters, each bounded by ``low`` and ``high`` (p,), are the frequencies of the tones
    ``free``, the decays of the tones ``falls`` and, where there are tones ``clock``, one common
    factor on their frequencies, expressed as the shift in bins of the highest of them. Returns the
    frequencies, the decays and the parameters.

    Levenberg-Marquardt: the damping is in proportion to each parameter's own slope, falls by 5
    after a step that improves and rises by 8 after one that does not. No frequency moves by more
    than half a bin in one step, no decay by more than 30 % or half an e-folding, whichever is more:
    beyond that the linearisation is of no use.
    """
    place, count = _places(cycles.size, free, falls, clock)
    still_cycles, moving_cycles = np.empty(cycles.size - count), np.empty(count)
    still_decay, moving_decay = np.empty(cycles.size - count), np.empty(count)
    for i in range(cycles.size):
        if place[i] < count:
            moving_cycles[place[i]], moving_decay[place[i]] = cycles[i], decay[i]
        else:
            still_cycles[place[i] - count], still_decay[place[i] - count] = cycles[i], decay[i]
    basis, right = known(still_cycles, still_decay, k, values, table)
    own = _at(place, free), _at(place, falls), _at(place, clock)
    found, falling, parameters = _moved(
        moving_cycles, moving_decay, *own, low, high, k, basis, right, table
    )
    there, fall = cycles.copy(), decay.copy()
    for i in range(cycles.size):
        if place[i] < count:
            there[i], fall[i] = found[place[i]], falling[place[i]]
    return there, fall, parameters


@code.entry(**COMPILE)
def refit(
    cycles: Vector,
    decay: Vector,
    before: Complexes,
    free: Counts,
    falls: Counts,
    low: Vector,
    high: Vector,
    values: Complexes,
    table: Matrix,
) -> tuple[Vector, Vector, Vector, Complexes, Complexes]:
    """``fit`` of tones in a residual from which they were taken out with the amplitudes ``before``;
    0 for new ones.

    Returns frequencies, decays, parameters, amplitudes and the residual without the tones.
    """
    there = values.copy()
    add_tones(cycles, decay, before, 1.0, table, there)
    k = bins_in(cycles, cycles, REACH, values.size)
    found, falling, parameters = cycles, decay, low
    if low.size > 0:
        found, falling, parameters = fit(
            cycles, decay, free, falls, np.empty(0, np.int64), low, high, k, there, table
        )
    now = amplitudes(found, falling, there, table)
    add_tones(found, falling, now, -1.0, table, there)
    return found, falling, parameters, now, there


@code.inner(**COMPILE)
def _places(size, free, falls, clock):
    """Place of each of so many tones, those that move first, and how many these are: all, where the
    clock's do.
    """
    place = np.full(size, 1 if clock.size > 0 else 0)
    for some in (free, falls):
        for i in some:
            place[i] = 1
    count = 0
    for i in range(size):
        count += place[i]
    first, after = 0, count
    for i in range(size):
        if place[i] == 1:
            place[i] = first
            first += 1
        else:
            place[i] = after
            after += 1
    return place, count


@code.inner(**COMPILE)
def _at(place, which):
    """The places of some tones."""
    result = np.empty(which.size, np.int64)
    for i in range(which.size):
        result[i] = place[which[i]]
    return result


@code.inner(**COMPILE)
def _moved(cycles, decay, free, falls, clock, low, high, k, basis, right_hand, table):
    """``fit`` of tones that all move, beside what is ``known``."""
    parameters = _parameters(cycles, decay, free, falls, low, high)
    there, falling = _with_parameters(parameters, cycles, decay, free, falls, clock)
    r = residual(there, falling, k, basis, right_hand, table)
    slopes, right = (
        np.zeros((parameters.size, r.size + parameters.size)),
        np.zeros(r.size + parameters.size),
    )
    damping, fresh = 1e-3, False
    for _ in range(60):
        if not fresh:
            _slopes(there, falling, free, falls, clock, k, basis, right_hand, table, slopes)
            for j in range(r.size):
                right[j] = -r[j]
            fresh = True
        new, largest = _stepped(
            parameters, slopes, right, damping, free.size, free.size + falls.size, low, high
        )
        there, falling = _with_parameters(new, cycles, decay, free, falls, clock)
        r_new = residual(there, falling, k, basis, right_hand, table)
        if dot(r_new, r_new) > dot(r, r):
            damping *= 8.0
        else:
            parameters, r, damping, fresh = new, r_new, max(0.2 * damping, 1e-12), False
        if largest < 1e-9 or damping > 1e8:
            break
    there, falling = _with_parameters(parameters, cycles, decay, free, falls, clock)
    return there, falling, parameters


@code.inner(**COMPILE)
def _parameters(cycles, decay, free, falls, low, high):
    """The parameters of ``fit`` at which it begins: tones as they are given, the clock's factor
    without a shift.
    """
    parameters = np.zeros(low.size)
    for i in range(free.size):
        parameters[i] = cycles[free[i]]
    for i in range(falls.size):
        parameters[free.size + i] = decay[falls[i]]
    for i in range(parameters.size):
        parameters[i] = _clipped(parameters[i], low[i], high[i])
    return parameters


@code.inner(**COMPILE)
def _stepped(parameters, slopes, right, damping, decays, after, low, high):
    """Parameters after one damped step, of which those from ``decays`` to ``after`` are decays, and
    the largest change.
    """
    first = right.size - parameters.size
    for j in range(parameters.size):  # the damping, as further equations
        slopes[j, first + j] = math.sqrt(damping * dot(slopes[j, :first], slopes[j, :first]))
    step = least_squares(slopes, right)
    new, largest = np.empty(parameters.size), 0.0
    for j in range(parameters.size):
        reach = max(0.5, 0.3 * abs(parameters[j])) if decays <= j < after else 0.5
        new[j] = _clipped(parameters[j] + _clipped(step[j], -reach, reach), low[j], high[j])
        largest = max(largest, abs(new[j] - parameters[j]))
    return new, largest


@code.inner(**COMPILE)
def _with_parameters(parameters, cycles, decay, free, falls, clock):
    """Frequencies and decays of all tones at the given parameters of ``fit``."""
    new_cycles, new_decay = cycles.copy(), decay.copy()
    for i in range(free.size):
        new_cycles[free[i]] = parameters[i]
    for i in range(falls.size):
        new_decay[falls[i]] = parameters[free.size + i]
    if clock.size > 0:
        highest = 1.0
        for i in clock:
            highest = max(highest, cycles[i])
        for i in clock:
            new_cycles[i] = cycles[i] * (1.0 + parameters[-1] / highest)
    return new_cycles, new_decay


@code.inner(**COMPILE)
def _clipped(x, low, high):
    return min(max(x, low), high)
