"""Time to a window of a long recording on a screen, from a pyramid of extremes that is kept.

``python benchmarks/browse.py [--samples 10000000] [--pixels 1200]``

Nothing is asserted. The cache of the run is a temporary folder.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

import microvib as mv
from microvib.io.browse import browse
from microvib.io.recordings import write_recording

RATE = 4096.0
WINDOWS = 300


def main() -> None:
    """Print the times of the first opening, of later ones, and of windows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--pixels", type=int, default=1200)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"):
            os.environ[name] = str(Path(folder) / "cache")
        file = Path(folder) / "long.mat"
        x = np.random.default_rng(1).normal(size=asked.samples)
        write_recording(mv.Recording({"Mz": x}, RATE, {"Mz": "N*m"}), file)
        _times(file, asked.samples, asked.pixels)


def _times(file: Path, samples: int, pixels: int) -> None:
    begun = time.perf_counter()
    x = mv.read_recording(file)["Mz"]
    reading = time.perf_counter() - begun
    begun = time.perf_counter()
    browse(file).window("Mz", 0.0, samples / RATE, pixels)
    first = time.perf_counter() - begun
    begun = time.perf_counter()
    kept = browse(file)
    kept.window("Mz", 0.0, samples / RATE, pixels)
    later = time.perf_counter() - begun
    rng = np.random.default_rng(2)
    each = []
    for _ in range(WINDOWS):
        width = kept.duration * 10.0 ** rng.uniform(-5.0, 0.0)
        t0 = rng.uniform(0.0, kept.duration - width)
        begun = time.perf_counter()
        kept.window("Mz", t0, t0 + width, pixels)
        each.append(time.perf_counter() - begun)
    begun = time.perf_counter()
    starts = np.arange(pixels) * samples // pixels
    np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)
    plain = time.perf_counter() - begun
    rows = {
        "reading the file": reading,
        "first opening, whole record drawn": first,
        "later opening, whole record drawn": later,
        f"window, median of {WINDOWS}": float(np.median(each)),
        f"window, slowest of {WINDOWS}": max(each),
        "extremes of all samples, already in memory": plain,
    }
    print(f"{samples} samples, {pixels} pixels")
    for name, seconds in rows.items():
        print(f"{name:45s} {1e3 * seconds:9.2f} ms   {seconds / reading:8.4f} of reading")


if __name__ == "__main__":
    main()
