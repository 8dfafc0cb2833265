"""Samples and spectra thinned for a screen or a drawing, without losing a peak."""

from __future__ import annotations

import numpy as np


def decimate_spectrum(
    f: np.ndarray, y: np.ndarray, points: int, log: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """A spectrum in at most ``points`` bins, for a screen.

    Where there are more, the smallest and the largest of each group of neighbours, at their own
    frequencies: the largest alone would lift the floor. Groups are equally wide on a linear axis of
    frequency or, with ``log``, on a logarithmic one, where groups of equally many bins would make a
    plateau of each line at low frequencies.
    """
    if f.size <= points:
        return f, y
    groups = max(points // 2, 1)
    starts = np.unique(_log_starts(f, groups) if log else np.arange(groups) * f.size // groups)
    spans = zip(starts, [*starts[1:], f.size], strict=True)
    keep = [k for a, b in spans for k in _ends(y, int(a), int(b))]
    return f[keep], y[keep]


def _ends(y: np.ndarray, a: int, b: int) -> list[int]:
    """Bins of the smallest and the largest from ``a`` to ``b``, in order; of two bins both, also
    where they are alike.
    """
    if b - a == 2:
        return [a, a + 1]
    return sorted({a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))})


def _log_starts(f: np.ndarray, groups: int) -> np.ndarray:
    """First bins of groups that are equally wide on a logarithmic axis; the bin at zero belongs to
    the first.
    """
    edges = np.geomspace(f[f > 0.0][0], f[-1], groups, endpoint=False)
    return np.concatenate([[0], np.searchsorted(f, edges[1:])])


def extremes(x: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest of each ``size`` samples, the last group perhaps shorter."""
    starts = np.arange(0, x.size, size)
    return np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)


def largest_in_cells(
    amplitude: np.ndarray, rows: int, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A map (t, m) in at most ``rows`` times ``columns`` cells, each the largest of what it covers, so
    that no line is lost, and the first row and column of each.
    """
    starts = [
        np.arange(cells) * size // cells
        for size, most in zip(amplitude.shape, (rows, columns), strict=True)
        for cells in (min(size, most),)
    ]
    down, across = starts
    cells = np.maximum.reduceat(np.maximum.reduceat(amplitude, down, axis=0), across, axis=1)
    return cells, down, across
