"""The filter from interval means to samples, compiled."""

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve.kernel import COMPILE
from microvib.solve.vector import WIDTH, rows

code = Unit(__name__, "kernel.py", "vector.py", "vector_type.py", types="microvib.solve.vector_type")


@code.entry(**COMPILE)
def filter_and_decimate(samples: Matrix, taps: Vector, factor: int, out: Matrix) -> None:
    """``out[m, c] = sum over k of taps[k] samples[factor m + k, c]``, of rows (n, channels) in whole lanes.

    Four sums, because each addition waits for the one before.
    """
    columns = out.shape[1] // WIDTH
    x, y = rows(samples, 0, samples.shape[0] * columns, columns), rows(out, 0, out.shape[0] * columns, columns)
    whole = taps.size - taps.size % 4
    for m in range(out.shape[0]):
        first = factor * m
        for c in range(columns):
            a, b = x[first, c] * taps[0], x[first + 1, c] * taps[1]
            d, e = x[first + 2, c] * taps[2], x[first + 3, c] * taps[3]
            for k in range(4, whole, 4):
                a += x[first + k, c] * taps[k]
                b += x[first + k + 1, c] * taps[k + 1]
                d += x[first + k + 2, c] * taps[k + 2]
                e += x[first + k + 3, c] * taps[k + 3]
            for k in range(whole, taps.size):
                a += x[first + k, c] * taps[k]
            y[m, c] = (a + b) + (d + e)
