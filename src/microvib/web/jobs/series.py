"""Samples thinned for a screen, without losing a peak."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from microvib.signals.spectrum import Window, amplitude_spectrum
from microvib.solve.motion import CHANNELS, INTERFACE


def outline(f: np.ndarray, y: np.ndarray, points: int, log: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A spectrum in at most ``points`` bins, for a screen.

    Where there are more, the smallest and the largest of each group of neighbours, at their own frequencies: the largest alone
    would lift the floor. Groups are equally wide on a linear axis of frequency or, with ``log``, on a logarithmic one, where
    groups of equally many bins would make a plateau of each line at low frequencies.
    """
    if f.size <= points:
        return f, y
    groups = max(points // 2, 1)
    starts = np.unique(_log_starts(f, groups) if log else np.arange(groups) * f.size // groups)
    spans = zip(starts, [*starts[1:], f.size], strict=True)
    keep = [k for a, b in spans for k in _ends(y, int(a), int(b))]
    return f[keep], y[keep]


def _ends(y: np.ndarray, a: int, b: int) -> list[int]:
    """Bins of the smallest and the largest from ``a`` to ``b``, in order; of two bins both, also where they are alike."""
    return [a, a + 1] if b - a == 2 else sorted({a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))})


def _log_starts(f: np.ndarray, groups: int) -> np.ndarray:
    """First bins of groups that are equally wide on a logarithmic axis; the bin at zero belongs to the first."""
    edges = np.geomspace(f[f > 0.0][0], f[-1], groups, endpoint=False)
    return np.concatenate([[0], np.searchsorted(f, edges[1:])])


def within(f: np.ndarray, low: float | None, high: float | None) -> np.ndarray:
    """Which frequencies lie from ``low`` to ``high`` [Hz]."""
    keep: np.ndarray = (f >= (low or 0.0)) & (f <= (np.inf if high is None else high))
    return keep


def extremes(x: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest of each ``size`` samples, the last group perhaps shorter."""
    starts = np.arange(0, x.size, size)
    return np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)


def channel(folder: Path, name: str) -> np.ndarray | None:
    """Samples of a run's channel, (n,), mapped from its file; None where it has none."""
    if name in INTERFACE:
        loads = folder / "loads.npy"
        return np.load(loads, mmap_mode="r")[:, INTERFACE.index(name)] if loads.is_file() else None
    file = folder / f"{name}.npy"
    return np.load(file, mmap_mode="r") if name in CHANNELS and file.is_file() else None


def unit(name: str) -> str:
    """Unit of a channel."""
    if name in CHANNELS:
        return CHANNELS[name].unit
    return "N" if name.startswith("F") else "N*m"


def series(
    channels: dict[str, np.ndarray], t0: float, rate: float, low: float | None, high: float | None, points: int
) -> dict[str, Any]:
    """Samples from ``low`` to ``high`` [s]: each, where they are few enough, else extremes of groups at their middles."""
    n = min(x.size for x in channels.values())
    first = 0 if low is None else int(np.clip(np.ceil((low - t0) * rate - 1e-6), 0, n - 1))
    last = n if high is None else int(np.clip(np.floor((high - t0) * rate + 1e-6) + 1, first + 1, n))
    size = -(-(last - first) // points)
    starts = np.arange(first, last, size)
    middles = 0.5 * (starts + np.minimum(starts + size, last) - 1)
    found: dict[str, Any] = {}
    for name, x in channels.items():
        smallest, largest = extremes(np.asarray(x[first:last]), size)
        found[name] = {"unit": unit(name), "min": smallest.tolist(), "max": largest.tolist()}
    return {
        "from": t0 + first / rate,
        "to": t0 + (last - 1) / rate,
        "exact": size == 1,
        "t": (t0 + middles / rate).tolist(),
        "channels": found,
    }


def spectrum(
    x: np.ndarray, rate: float, window: Window, low: float | None, high: float | None, points: int, log: bool = False
) -> dict[str, Any]:
    """Amplitudes, 0-to-peak, from ``low`` to ``high`` [Hz], as an outline."""
    s = amplitude_spectrum(np.asarray(x), rate, window)
    keep = within(s.frequency, low, high)
    f, amplitude = outline(s.frequency[keep], s.amplitude[keep], points, log)
    return {"f": f.tolist(), "amplitude": amplitude.tolist(), "resolution": s.resolution, "made": str(s)}
