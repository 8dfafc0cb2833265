"""Order tracking beside a second-generation Vold-Kalman filter, on sweeps whose orders are known.

``python benchmarks/order_tracking.py [--draws 20]``

Both are told the phase. Orders 1, 2 and 4 pass a resonance of 24 Hz (5 % of critical damping) in 60 s; a
line of 31 Hz crosses order 4; white noise. Bandwidths are 3 dB widths of the filter, and the inverse of
the distance between knots. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from microvib.signals.order_tracking import track_components
from microvib.signals.sweep_clock import revolutions

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.vold_kalman import vold_kalman

RATE, DURATION, ORDERS = 256.0, 60.0, (1.0, 2.0, 4.0)
PAIRS = ((0.7, 1.4), (1.0, 2.0), (1.5, 3.0))
"""Bandwidths [Hz] of the filter and of the splines: half and all of the distance of the knots."""


def sweep(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples (n,), phases [rad] and true amplitudes of the components, (4, n) each."""
    t = np.arange(round(RATE * DURATION)) / RATE
    speed = rng.uniform(3.5, 4.5) + rng.uniform(10.0, 13.0) * t / DURATION
    turns = 2.0 * np.pi * revolutions(speed, RATE)
    x, phases, truth = 0.05 * rng.normal(size=t.size), [], []
    for order in ORDERS:
        r = order * speed / 24.0
        H = 1.0 / (1.0 - r**2 + 0.1j * r)
        x += np.real(H * np.exp(1j * order * turns))
        phases.append(order * turns)
        truth.append(np.abs(H))
    line = 2.0 * np.pi * 31.0 * t + rng.uniform(0.0, 6.3)
    x += np.cos(line)
    return x, np.array([*phases, line]), np.array([*truth, np.ones(t.size)])


def main() -> None:
    """Print errors and times of both, and how well the stated uncertainties cover the errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    draws = parser.parse_args().draws
    print(
        "bandwidths [Hz]      RMS error: splines  Vold-Kalman   time [s]: splines  Vold-Kalman   within 2 u"
    )
    for theirs, ours in PAIRS:
        rng = np.random.default_rng(1)
        squares, seconds, covered = np.zeros(2), np.zeros(2), []
        for _ in range(draws):
            x, phases, truth = sweep(rng)
            begun = time.perf_counter()
            found = track_components(x, RATE, phases, np.ones(phases.shape, bool), ours)
            middle = time.perf_counter()
            filtered = np.abs(vold_kalman(x, RATE, phases, theirs))
            seconds += (middle - begun, time.perf_counter() - middle)
            at = np.minimum(np.rint(found.time * RATE).astype(int), x.size - 1)
            inner = (found.time > 2.0) & (found.time < DURATION - 2.0)
            away = (np.abs(found.amplitude) - truth[:, at])[:, inner]
            squares += (np.mean(away**2), np.mean((filtered - truth)[:, at][:, inner] ** 2))
            told = found.separable[:, inner]
            covered.append(np.mean((np.abs(away) < 2.0 * found.uncertainty[:, inner])[told]))
        own, other = np.sqrt(squares / draws)
        print(
            f"{theirs:5g} and {ours:5g} {own:24.4f} {other:12.4f} {seconds[0] / draws:19.3f}"
            f" {seconds[1] / draws:12.3f} {100.0 * np.mean(covered):11.0f} %"
        )


if __name__ == "__main__":
    main()
