"""The filter from interval means to samples, compiled."""

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve.kernel import COMPILE
from microvib.solve.vector import WIDTH, rows

code = Unit(__name__, "kernel.py")


@code.entry(**COMPILE)
def filter_and_decimate(samples: Matrix, taps: Vector, factor: int, out: Matrix) -> None:
    """``out[m, c] = sum over k of taps[k] samples[factor m + k, c]``, of rows (n, channels) in
    whole lanes.

    Four sums at a time, of one column and rows that follow each other, because each addition waits
    for the one before.
    """
    count, columns = out.shape[0], out.shape[1] // WIDTH
    x, y = (
        rows(samples, 0, samples.shape[0] * columns, columns),
        rows(out, 0, count * columns, columns),
    )
    together = count - count % 4
    for m in range(0, together, 4):
        first, second, third, fourth = (
            factor * m,
            factor * (m + 1),
            factor * (m + 2),
            factor * (m + 3),
        )
        for c in range(columns):
            a, b, d, e = (
                x[first, c] * taps[0],
                x[second, c] * taps[0],
                x[third, c] * taps[0],
                x[fourth, c] * taps[0],
            )
            for k in range(1, taps.size):
                tap = taps[k]
                a += x[first + k, c] * tap
                b += x[second + k, c] * tap
                d += x[third + k, c] * tap
                e += x[fourth + k, c] * tap
            y[m, c], y[m + 1, c], y[m + 2, c], y[m + 3, c] = a, b, d, e
    for m in range(together, count):
        for c in range(columns):
            a = x[factor * m, c] * taps[0]
            for k in range(1, taps.size):
                a += x[factor * m + k, c] * taps[k]
            y[m, c] = a
