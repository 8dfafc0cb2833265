"""Lines of a motion that repeats: the coefficients of its Fourier series, exact, without window or
leakage.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.line_search import MAX_OTHERS
from microvib.signals.line_table import (
    BELOW_FLOOR,
    LineEstimates,
    LineTable,
    ResidualPeaks,
    Uncertainty,
)
from microvib.signals.orders import ClockOrders

TRANSIENT = "not in a steady state"  # status of an array mode: it rings after a start and decays
_MIN_RELATIVE_AMPLITUDE = 1e-6  # amplitude over the largest, below which a line is none


def lines_of_series(
    series: np.ndarray,
    base: float,
    microsteps: int,
    expected: Sequence[ExpectedLine],
    samples: int,
    sample_rate: float,
) -> LineTable:
    """The ``expected`` lines in the Fourier series ``series`` (n,) [N m], complex, of k ``base``
    [Hz], k = 0, 1, ...

    The period has ``microsteps`` microsteps. Rows are those of ``estimate_lines`` on a record of
    ``samples`` at ``sample_rate`` [Hz], at whose first sample the phases are; nearest-bin figures
    are what that record would give.
    """
    sizes = np.abs(series)
    top = float(np.max(sizes[1:], initial=0.0))
    size = series.size
    named = {k for line in expected if not line.is_mode and (k := order_of(line, base, size))}
    lines = (*expected, *_others(sizes, base, microsteps, named, ClockOrders.of(expected, 1.0)))
    frequency = np.array([line.frequency for line in lines], dtype=float)
    mode = np.array([line.is_mode for line in lines], dtype=bool)
    tone = np.array(
        [series[k] if (k := order_of(line, base, series.size)) else 0.0 for line in lines],
        dtype=complex,
    )
    sharp = np.where(mode, math.nan, 0.0)
    amplitude = np.abs(tone) + sharp
    status = np.select(
        [mode, amplitude > _MIN_RELATIVE_AMPLITUDE * top], [TRANSIENT, "ok"], BELOW_FLOOR
    )
    bins = _nearest_bins(series, base, frequency, samples, sample_rate)
    figures = LineEstimates(
        lines,
        tuple(status.tolist()),
        frequency + sharp,
        amplitude,
        np.angle(tone) + sharp,
        sharp,
        sharp,
        *bins,
    )
    unlisted = np.ones(series.size, dtype=bool)
    # An array mode is no line of a steady state: the order nearest to it is still left.
    unlisted[[0, *(order_of(line, base, series.size) for line in lines if not line.is_mode)]] = (
        False
    )
    left = np.flatnonzero(unlisted)
    rows = figures.rows(Uncertainty(sharp, sharp, sharp, sharp))
    rest = ResidualPeaks.of_exact_lines(left * base, sizes[left])
    return LineTable(rows, 1.0, 0.0, samples, sample_rate, rest=rest)


def order_of(line: ExpectedLine, base: float, size: int) -> int:
    """Order of a Fourier series of ``size`` coefficients at which a line lies; 0 where it lies between
    them, or beyond the last.
    """
    k = round(line.frequency / base)
    if abs(line.frequency - k * base) < 1e-6 * base and k < size:
        return k
    return 0


def _others(
    sizes: np.ndarray, base: float, microsteps: int, named: set[int], orders: ClockOrders | None
) -> Iterator[ExpectedLine]:
    """Orders without a name, from a hundredth of the largest, the strongest first, as
    ``estimate_lines`` lists them.
    """
    unnamed = sizes.copy()
    unnamed[[0, *named]] = 0.0
    strong = np.flatnonzero(unnamed > 0.01 * float(np.max(sizes[1:], initial=0.0)))
    strong = strong[np.argsort(-unnamed[strong], kind="stable")][:MAX_OTHERS]
    for number, k in enumerate(strong.tolist(), 1):
        if orders:
            origin = orders.name(k * base, 1e-6 * base)
        else:
            origin = None
        origin = origin or f"{Fraction(k, microsteps)} of the driving frequency"
        yield ExpectedLine(f"other_{number}", "other", k * base, k * base, k * base, origin)


def _nearest_bins(
    series: np.ndarray, base: float, frequency: np.ndarray, samples: int, sample_rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest bins of a rectangular window on a record of the series, leakage of all lines
    included.

    Frequencies [Hz] and amplitudes of the bins nearest to ``frequency`` (m,) [Hz].
    """
    keep = np.abs(series) > _MIN_RELATIVE_AMPLITUDE * np.max(np.abs(series[1:]), initial=0.0)
    keep[0] = False  # bins are of the mean-free record
    tones = np.concatenate([series[keep], series[keep].conj()])
    cycles = np.concatenate([np.flatnonzero(keep), -np.flatnonzero(keep)]) * base / sample_rate
    n, k = samples, np.minimum(np.round(frequency * samples / sample_rate), samples // 2)
    # Sum of a geometric series for each tone: sin(pi nu n/f_s) / sin(pi nu/f_s), nu its distance
    # from the bin.
    distance = np.sin(np.pi * (cycles - k[:, None] / n))
    near = np.abs(distance) < 1e-12
    inverse = np.where(near, 0.0, 1.0 / np.where(near, 1.0, distance))
    half = np.exp(1j * np.pi * cycles * (n - 1)) * np.sin(np.pi * cycles * n) * tones
    whole = (
        np.einsum("bt,t->b", inverse, half) * np.exp(-1j * np.pi * k * (n - 1) / n) * (-1.0) ** k
    )
    whole += n * np.einsum("bt,t->b", near, tones)
    return k * sample_rate / n, np.abs(whole) / n
