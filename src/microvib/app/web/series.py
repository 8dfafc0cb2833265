"""Samples thinned for a screen, without losing a peak."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from microvib.signals.spectrum import Window, amplitude_spectrum
from microvib.solve.motion import CHANNELS, INTERFACE


def loudest(f: np.ndarray, amplitude: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """At most ``points`` bins: of neighbours the largest, at its own frequency."""
    size = -(-f.size // points)
    if size <= 1:
        return f, amplitude
    starts = np.arange(0, f.size, size)
    keep = np.array([k + int(np.argmax(amplitude[k : k + size])) for k in starts])
    return f[keep], amplitude[keep]


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
    x: np.ndarray, rate: float, window: Window, low: float | None, high: float | None, points: int
) -> dict[str, Any]:
    """Amplitudes, 0-to-peak, from ``low`` to ``high`` [Hz]; of neighbouring bins the largest."""
    s = amplitude_spectrum(np.asarray(x), rate, window)
    keep = (s.frequency >= (low or 0.0)) & (s.frequency <= (np.inf if high is None else high))
    f, amplitude = loudest(s.frequency[keep], s.amplitude[keep], points)
    return {"f": f.tolist(), "amplitude": amplitude.tolist(), "resolution": s.resolution, "made": str(s)}
