"""Structural modes of a reaction wheel: by how much they amplify the loads of its harmonics.

A rotor on its flexible bearings passes a load of frequency w on to its mount with the factor

    T = (w0^2 + 2j xi w0 w) / (w0^2 - w^2 + 2j xi w0 w)

of its axial, radial and rocking modes. A rocking rotor that turns with the speed W is gyroscopic: with
r = I_polar / I_transverse its denominator is w0^2 - w^2 -/+ r W w + 2j xi w0 w for whirl backward and
forward, (w_f - w)(w_b + w) for forward whirl, with both whirl frequencies at that speed, whose
product is w0^2 and whose difference is r W. These may also be measured. Harmonics of bearings go round
either way: the largest of both counts, and in *least* the smallest.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from microvib.studies.budget.files import WheelMode

MOVED_BY = {
    "radial": ("radial_force",),
    "rocking": ("radial_torque",),
    "axial": ("axial_force",),
}
"""Loads that each motion of the rotor passes on."""


class Resonance(NamedTuple):
    """A resonance of a mode by one order."""

    frequency: float
    """[Hz]."""
    damping: float
    """Half-width at half of the power, over the frequency."""


def whirl_frequencies(mode: WheelMode, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Backward and forward whirl frequencies [rad/s] at speeds (...) [rad/s]; of modes that do not
    rock their frequency.
    """
    if mode.whirl:
        at = [point.speed for point in mode.whirl]
        back, forth = ([getattr(x, key) for x in mode.whirl] for key in ("backward", "forward"))
        return 2.0 * np.pi * np.interp(speed, at, back), 2.0 * np.pi * np.interp(speed, at, forth)
    still = 2.0 * np.pi * (mode.frequency or 0.0)
    half = 0.5 * (mode.inertia_ratio or 0.0) * speed
    root = np.hypot(half, still)
    return root - half, root + half


def amplification(mode: WheelMode, frequency: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Smallest and largest factor of a mode on each order at its frequencies (o, n) [Hz], (2, o, n)."""
    w = 2.0 * np.pi * frequency
    back, forth = whirl_frequencies(mode, w / orders[:, None])
    still = np.sqrt(back * forth)
    lost = 2j * mode.damping * still * w
    ways = ((forth - w) * (back + w), (back - w) * (forth + w))
    both = np.abs([(still**2 + lost) / (way + lost) for way in ways])
    return np.array([both.min(axis=0), both.max(axis=0)])


def resonances(mode: WheelMode, orders: np.ndarray) -> list[Resonance]:
    """Where orders meet a mode, whirling either way."""
    found = []
    for order in orders.tolist():
        for speed in _meeting_speeds(mode, order):
            back, forth = whirl_frequencies(mode, np.array(speed))
            still, w = float(np.sqrt(back * forth)), order * speed
            width = mode.damping * w / still  # along the order, on which the speed changes, too
            found.append(Resonance(w / (2.0 * np.pi), width))
    return found


def _meeting_speeds(mode: WheelMode, order: float) -> list[float]:
    """Speeds [rad/s] at which an order is at a whirl frequency."""
    if not mode.whirl:
        still, ratio = 2.0 * np.pi * (mode.frequency or 0.0), (mode.inertia_ratio or 0.0) / order
        left = [1.0 + ratio, 1.0 - ratio]  # w0^2 = w^2 (1 +/- r / order)
        return [float(still / np.sqrt(x)) / order for x in left if x > 0.0]
    found = []
    for key in ("backward", "forward"):
        for a, b in pairwise(mode.whirl):
            above = [2.0 * np.pi * getattr(x, key) - order * x.speed for x in (a, b)]
            if above[0] * above[1] <= 0.0 and above[0] != above[1]:
                share = above[0] / (above[0] - above[1])
                found.append(a.speed + share * (b.speed - a.speed))
    return found
