"""Samples and spectra of a run as the page gets them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from microvib.signals.screen import extremes, outline
from microvib.signals.spectrum import Window, amplitude_spectrum
from microvib.solve.channels import CHANNELS, INTERFACE, KNOWN


def within(f: np.ndarray, low: float | None, high: float | None) -> np.ndarray:
    """Which frequencies lie from ``low`` to ``high`` [Hz]."""
    return (f >= (low or 0.0)) & (f <= (np.inf if high is None else high))


def channel(folder: Path, name: str) -> np.ndarray | None:
    """Samples of a run's channel, (n,), mapped from its file; None where it has none."""
    if name in INTERFACE:
        loads = folder / "loads.npy"
        return np.load(loads, mmap_mode="r")[:, INTERFACE.index(name)] if loads.is_file() else None
    file = folder / f"{name}.npy"
    return np.load(file, mmap_mode="r") if name in CHANNELS and file.is_file() else None


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
        found[name] = {"unit": KNOWN[name].unit, "min": smallest.tolist(), "max": largest.tolist()}
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
