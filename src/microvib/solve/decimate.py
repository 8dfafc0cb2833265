"""The filter from interval means to samples, compiled."""

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve.kernel import COMPILE
from microvib.solve.vector import WIDTH, rows

code = Unit(__name__, "kernel.py", "vector.py", "vector_type.py", types="microvib.solve.vector_type")


@code.entry(**COMPILE)
def filter_and_decimate(samples: Matrix, taps: Vector, factor: int, out: Matrix) -> None:
    """``out[m, c] = sum over k of taps[k] samples[factor m + k, c]``, of rows (n, channels) in whole lanes.

    Four sums at a time, because each addition waits for the one before: of four columns or, of those that are left, of four rows.
    Each is summed up in the same order, so that a channel does not depend on its company.
    """
    count, columns = out.shape[0], out.shape[1] // WIDTH
    x, y = rows(samples, 0, samples.shape[0] * columns, columns), rows(out, 0, count * columns, columns)
    shared, together = columns - columns % 4, count - count % 4
    for m in range(count):
        first = factor * m
        for c in range(0, shared, 4):
            a, b = x[first, c] * taps[0], x[first, c + 1] * taps[0]
            d, e = x[first, c + 2] * taps[0], x[first, c + 3] * taps[0]
            for k in range(1, taps.size):
                tap = taps[k]
                a += x[first + k, c] * tap
                b += x[first + k, c + 1] * tap
                d += x[first + k, c + 2] * tap
                e += x[first + k, c + 3] * tap
            y[m, c], y[m, c + 1], y[m, c + 2], y[m, c + 3] = a, b, d, e
    for c in range(shared, columns):
        for m in range(0, together, 4):
            i, j, n, o = factor * m, factor * (m + 1), factor * (m + 2), factor * (m + 3)
            a, b, d, e = x[i, c] * taps[0], x[j, c] * taps[0], x[n, c] * taps[0], x[o, c] * taps[0]
            for k in range(1, taps.size):
                tap = taps[k]
                a += x[i + k, c] * tap
                b += x[j + k, c] * tap
                d += x[n + k, c] * tap
                e += x[o + k, c] * tap
            y[m, c], y[m + 1, c], y[m + 2, c], y[m + 3, c] = a, b, d, e
        for m in range(together, count):
            a = x[factor * m, c] * taps[0]
            for k in range(1, taps.size):
                a += x[factor * m + k, c] * taps[k]
            y[m, c] = a
