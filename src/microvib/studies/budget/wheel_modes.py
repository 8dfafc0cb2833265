"""Structural modes of a reaction wheel: by how much they amplify the loads of its harmonics.

A rotor on its flexible bearings passes a load of frequency w on to its mount with the factor

    T = (w0^2 + 2j xi w0 w) / (w0^2 - w^2 + 2j xi w0 w)

of its axial, radial and rocking modes. A rocking rotor that turns with the speed W is gyroscopic: with
r = I_polar / I_transverse its denominator is w0^2 - w^2 -/+ r W w + 2j xi w0 w for whirl backward and
forward, (w_f - w)(w_b + w) for forward whirl, with both whirl frequencies at that speed, whose
product is w0^2 and whose difference is r W. These may also be measured. Harmonics of bearings go round
either way, with one factor forward and another backward. Frequencies that may be off by a part e,
all of a mode together, are met at v = w / s as those given, with s between 1 - e and 1 + e.
"""

from __future__ import annotations

from itertools import pairwise, product
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


class Amplification(NamedTuple):
    """Factor of a mode on loads of each order at its frequencies that go round forward, and backward, (2, o, n)."""

    least: np.ndarray
    """The smallest that it may be, by the mode's intervals."""
    value: np.ndarray
    """Factor of the mode as given."""
    most: np.ndarray


def amplification(mode: WheelMode, frequency: np.ndarray, orders: np.ndarray) -> Amplification:
    """Factor of a mode on each order at its frequencies (o, n) [Hz], whichever way its loads go round."""
    w = 2.0 * np.pi * frequency
    back, forth = whirl_frequencies(mode, w / orders[:, None])
    exactly = _Interval(w, w, (mode.damping, mode.damping))
    error = mode.frequency_error
    # A mode of higher frequencies does at w what it would do, as given, at a lower frequency.
    about = _Interval(w / (1.0 + error), w / (1.0 - error), mode.dampings)
    ways = ((forth, back), (back, forth))
    given = [_extremes(exactly, *way)[1] for way in ways]
    least, most = zip(*[_extremes(about, *way) for way in ways], strict=True)
    return Amplification(np.array(least), np.array(given), np.array(most))


class _Interval(NamedTuple):
    """Frequencies at which a mode may be met, over those of its resonances as given, and its damping."""

    low: np.ndarray
    """[rad/s], (o, n)."""
    high: np.ndarray
    dampings: tuple[float, float]


def _extremes(at: _Interval, met: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest factor of a mode with whirl frequencies [rad/s] in the direction of loads, ``met``,
    and against it, (o, n).

    With x = (met - v) (other + v) / (met other) and l = 2 xi v / sqrt(met other) the squared factor is
    (1 + l^2) / (x^2 + l^2): it falls with |x|, and with l falls where |x| < 1 and rises elsewhere.
    """
    squared = met * other

    def distance(v: np.ndarray) -> np.ndarray:
        return np.asarray((met - v) * (other + v) / squared)

    ends = np.abs([distance(at.low), distance(at.high)])
    inside = (at.low <= met) & (met <= at.high)
    nearest = np.where(inside, 0.0, ends.min(axis=0))
    vertex = np.clip(0.5 * (met - other), at.low, at.high)  # where x is largest
    farthest = np.maximum(ends.max(axis=0), np.abs(distance(vertex)))
    losses = [
        2.0 * damping * v / np.sqrt(squared)
        for damping, v in zip(at.dampings, (at.low, at.high), strict=True)
    ]

    def factor(x: np.ndarray, larger: bool) -> np.ndarray:
        few, many = losses if larger else losses[::-1]
        lost = np.where(x < 1.0, few, many) ** 2
        return np.asarray(np.sqrt((1.0 + lost) / (x**2 + lost)))

    return factor(farthest, larger=False), factor(nearest, larger=True)


def resonances(mode: WheelMode, orders: np.ndarray) -> list[Resonance]:
    """Where orders meet a mode, whirling either way, as given and as far off as it may be."""
    found = []
    scales = {1.0, 1.0 - mode.frequency_error, 1.0 + mode.frequency_error}
    for order, scale in product(orders.tolist(), sorted(scales)):
        for speed in _meeting_speeds(mode, order, scale):
            back, forth = whirl_frequencies(mode, np.array(speed))
            still, w = scale * float(np.sqrt(back * forth)), order * speed
            # along the order, on which the speed changes, too
            width = mode.dampings[0] * w / still
            found.append(Resonance(w / (2.0 * np.pi), width))
    return found


def _meeting_speeds(mode: WheelMode, order: float, scale: float) -> list[float]:
    """Speeds [rad/s] at which an order is at a whirl frequency times a ``scale``."""
    if not mode.whirl:
        still, ratio = 2.0 * np.pi * (mode.frequency or 0.0), (mode.inertia_ratio or 0.0) / order
        left = [1.0 + scale * ratio, 1.0 - scale * ratio]  # (s w0)^2 = w^2 (1 +/- s r / order)
        return [scale * float(still / np.sqrt(x)) / order for x in left if x > 0.0]
    found = []
    for key in ("backward", "forward"):
        for a, b in pairwise(mode.whirl):
            above = [2.0 * np.pi * scale * getattr(x, key) - order * x.speed for x in (a, b)]
            if above[0] * above[1] <= 0.0 and above[0] != above[1]:
                share = above[0] / (above[0] - above[1])
                found.append(a.speed + share * (b.speed - a.speed))
    return found
