"""Damped tones under a Hann window, compiled: their spectra in closed form, and least-squares fits
to the bins about them.

The model of a record x[n], n = 0 ... N - 1, with m tones is

    x[n] = constant + sum over i of Re(a_i exp((2 pi i f_i - d_i) n/N))

with frequencies f_i in cycles per record and decays d_i in e-foldings per record, (m,) each. Its
Hann-windowed spectrum is linear in the complex amplitudes a_i and the constant, and nonlinear in
f_i and d_i alone. So the fit is separable: for given f, d the amplitudes follow from linear least
squares (``equations``, ``least_squares``), and the search over f, d (``fit``) minimises what that
leaves. This is variable projection.

Every bin of a fit has the same weight. The bins are those within REACH of a tone: a Hann-windowed
tone falls off with the cube of the distance, so that others and the noise elsewhere hardly count.
Uncertainties come from the residual, with the correlation that the window makes between
neighbouring bins (``correlated``, ``microvib.signals.tones``).

Bins ``k`` (n,) ascend. A spectrum ``values`` is one-sided and scaled so that a steady tone on a bin
reads its amplitude.
"""

from __future__ import annotations

import math

import numpy as np

from microvib.compiled import Complexes, Counts, Matrix, Unit, Vector
from microvib.signals.tone_algebra import (
    COMPILE,
    factored,
    half,
    solved,
)

code = Unit(__name__, "tone_algebra.py")
REACH = 6
"""Bins on each side of a line that its fit uses."""
FAR = 400
"""Bins on each side from which a known tone is taken out; beyond, a Hann window leaves 1e-8 of it."""
_FLOOR_BINS = (4, 20)
"""Distances from a line [bins], nearest and farthest, over which its noise floor is taken."""
NUDGE = 1e-4
"""Step of difference quotients, in cycles or e-foldings over the record."""


@code.entry(**COMPILE)
def tone(cycles: float, decay: float, amplitude: complex, k: Counts, table: Matrix) -> Complexes:
    """Spectrum at the bins ``k`` of Re(amplitude exp((2 pi i cycles - decay) n/N)), (n,) complex."""
    plus, minus = np.empty(k.size, np.complex128), np.empty(k.size, np.complex128)
    half(cycles, decay, k, table, plus)
    half(-cycles, decay, k, table, minus)
    for i in range(k.size):
        plus[i] = amplitude * plus[i] + amplitude.conjugate() * minus[i]
    return plus


@code.entry(**COMPILE)
def bins_in(low: Vector, high: Vector, reach: int, size: int) -> Counts:
    """Bins, out of ``size``, that lie within ``reach`` of any of the bands from ``low`` to
    ``high``, (m,) each.
    """
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


@code.entry(**COMPILE)
def equations(
    cycles: Vector, decay: Vector, k: Counts, values: Complexes, table: Matrix
) -> tuple[Matrix, Vector]:
    """Real least-squares equations ``sum of x_j columns_j = right`` at the bins ``k``: (2 m + 1, 2
    n) and (2 n,).

    The columns are the spectra of each tone's cosine and minus sine, so that x holds the real and
    imaginary parts of the amplitudes, and of a constant. Along a column the real parts of all bins
    come first, then the imaginary ones.
    """
    m, n = cycles.size, k.size
    columns, right = np.empty((2 * m + 1, 2 * n)), np.empty(2 * n)
    spectra(cycles, decay, k, table, columns)
    constant(k, table, columns[2 * m])
    for j in range(n):
        right[j], right[n + j] = values[k[j]].real, values[k[j]].imag
    return columns, right


@code.inner(**COMPILE)
def spectra(cycles, decay, k, table, columns):
    """The spectra of each tone's cosine and minus sine at the bins ``k``, into the rows of
    ``columns`` (2 m at least, 2 n).
    """
    n = k.size
    plus, minus = np.empty(n, np.complex128), np.empty(n, np.complex128)
    for i in range(cycles.size):
        half(cycles[i], decay[i], k, table, plus)
        half(-cycles[i], decay[i], k, table, minus)
        for j in range(n):
            p, q = plus[j], minus[j]
            columns[2 * i, j], columns[2 * i, n + j] = p.real + q.real, p.imag + q.imag
            columns[2 * i + 1, j], columns[2 * i + 1, n + j] = q.imag - p.imag, p.real - q.real


@code.entry(**COMPILE)
def linearised(
    cycles: Vector,
    decay: Vector,
    amplitudes: Complexes,
    free: Counts,
    falls: Counts,
    k: Counts,
    table: Matrix,
) -> Matrix:
    """Columns of ``equations``, and below them what the model changes by at fixed amplitudes: with
    the frequencies, in cycles, of the tones ``free``, and with the decays, in e-foldings, of the
    tones ``falls``."""
    m, n = cycles.size, k.size
    columns = np.empty((2 * m + 1 + free.size + falls.size, 2 * n))
    spectra(cycles, decay, k, table, columns)
    constant(k, table, columns[2 * m])
    for j in range(free.size + falls.size):
        i = free[j] if j < free.size else falls[j - free.size]
        turn, fall = (NUDGE, 0.0) if j < free.size else (0.0, NUDGE)
        after = tone(cycles[i] + turn, decay[i] + fall, amplitudes[i], k, table)
        before = tone(cycles[i], decay[i], amplitudes[i], k, table)
        row = columns[2 * m + 1 + j]
        for b in range(n):
            slope = (after[b] - before[b]) / NUDGE
            row[b], row[n + b] = slope.real, slope.imag
    return columns


@code.inner(**COMPILE)
def constant(k, table, column):
    """The spectrum of a constant, into ``column`` (2 n,)."""
    n = k.size
    there = np.empty(n, np.complex128)
    half(0.0, 0.0, k, table, there)
    for j in range(n):
        column[j], column[n + j] = there[j].real, there[j].imag


@code.entry(**COMPILE)
def least_squares(columns: Matrix, right: Vector) -> Vector:
    """Least squares by scaled normal equations; a column that is zero or depends on those before it
    gets zero.
    """
    scale, factor = factored(columns)
    return solved(columns, scale, factor, right)


@code.entry(**COMPILE)
def amplitudes(cycles: Vector, decay: Vector, values: Complexes, table: Matrix) -> Complexes:
    """Complex amplitudes of all tones, (m,), from one least-squares fit to the bins about them."""
    k = bins_in(cycles, cycles, REACH, values.size)
    columns, right = equations(cycles, decay, k, values, table)
    solution = least_squares(columns, right)
    result = np.empty(cycles.size, np.complex128)
    for i in range(cycles.size):
        result[i] = complex(solution[2 * i], solution[2 * i + 1])
    return result


@code.entry(**COMPILE)
def without(
    cycles: Vector, decay: Vector, amplitudes: Complexes, values: Complexes, table: Matrix
) -> Complexes:
    """The spectrum less the tones, each subtracted from the bins where it is above rounding."""
    rest = values.copy()
    add_tones(cycles, decay, amplitudes, -1.0, table, rest)
    return rest


@code.inner(**COMPILE)
def add_tones(cycles, decay, amplitudes, times, table, values):
    """Add tones to a spectrum, so many times, in place."""
    for i in range(cycles.size):
        if amplitudes[i] != 0.0:
            centre = round(cycles[i])
            band = np.arange(max(centre - FAR, 0), min(centre + FAR + 1, values.size))
            there = tone(cycles[i], decay[i], times * amplitudes[i], band, table)
            for j in range(band.size):
                values[band[j]] += there[j]


@code.inner(**COMPILE)
def floor(cycles, values):
    """Noise floor of one tone: median amplitude of the bins 4 to 20 away (insertion sort; there are
    at most 34).
    """
    centre = round(cycles)
    about = np.empty(2 * (_FLOOR_BINS[1] - _FLOOR_BINS[0] + 1))
    count = 0
    for away in range(_FLOOR_BINS[0], _FLOOR_BINS[1] + 1):
        for k in (centre - away, centre + away):
            if 1 <= k < values.size:
                at, new = count, abs(values[k])
                while at > 0 and about[at - 1] > new:
                    about[at] = about[at - 1]
                    at -= 1
                about[at] = new
                count += 1
    return 0.5 * (about[(count - 1) // 2] + about[count // 2]) if count else 0.0


@code.entry(**COMPILE)
def floors(cycles: Vector, values: Complexes) -> Vector:
    """Floor about each tone, (m,)."""
    result = np.empty(cycles.size)
    for i in range(cycles.size):
        result[i] = floor(cycles[i], values)
    return result


@code.entry(**COMPILE)
def bin_rms(cycles: Vector, values: Complexes) -> Vector:
    """RMS of the magnitudes in the bins within REACH of each tone, (m,)."""
    result = np.zeros(cycles.size)
    for i in range(cycles.size):
        total, count = 0.0, 0
        for k in range(
            max(round(cycles[i]) - REACH, 1), min(round(cycles[i]) + REACH + 1, values.size)
        ):
            total += values[k].real ** 2 + values[k].imag ** 2
            count += 1
        result[i] = math.sqrt(total / count) if count else 0.0
    return result


@code.entry(**COMPILE)
def correlated(columns: Matrix, k: Counts, noise: Vector) -> Matrix:
    """Columns (p, 2 n) at the bins ``k`` times the covariance of noise with RMS ``noise`` (n,).

    White noise under a Hann window has the correlation -2/3 between neighbouring bins, 1/6 between
    next neighbours.
    """
    n = k.size
    result = np.empty_like(columns)
    for i in range(columns.shape[0]):
        for part in (0, n):
            for j in range(n):
                total = noise[j] * columns[i, part + j]
                for other in range(max(j - 2, 0), min(j + 3, n)):
                    away = abs(k[other] - k[j])
                    if away == 1 or away == 2:
                        total += (
                            (-2.0 / 3.0 if away == 1 else 1.0 / 6.0)
                            * noise[other]
                            * columns[i, part + other]
                        )
                result[i, part + j] = noise[j] * total
    return result


@code.entry(**COMPILE)
def peak(low: float, high: float, margin: float, values: Complexes) -> tuple[float, float]:
    """Frequency and amplitude of the highest peak from ``low`` to ``high``, both widened by
    ``margin`` bins.

    The frequency follows from the ratio of the two highest bins, exactly for a single steady tone
    far from 0 and Nyquist.
    """
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
