"""Order spectra by angular resampling: samples at equal angles of the reference, then a spectrum of
each so many revolutions.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import lcm

import numpy as np

from microvib.signals.order_tracking import OrderError
from microvib.signals.spectrum import Window, window_name, window_values

_TAPS = 32
"""Samples on which an interpolated one rests."""
_BETA = 9.0
"""Shape of the Kaiser window of the interpolation: errors below 0.1 % up to 0.4 of the sample rate."""
_BLOCK = 1 << 16
_MOST = 4
"""Times of the samples of a record that it has after resampling, at most."""
_ROWS = 24
"""Rows that a map has, about, where nothing else is asked for."""


@dataclass(frozen=True)
class OrderMap:
    """Amplitudes over order, of successive stretches of equally many revolutions."""

    order: np.ndarray
    """Orders, (m,)."""
    time: np.ndarray
    """Middles of the stretches [s], (t,)."""
    speed: np.ndarray
    """Mean speeds of the stretches [Hz], (t,)."""
    amplitude: np.ndarray
    """0-to-peak amplitudes, (t, m)."""
    revolutions: int
    """Revolutions of a stretch."""
    window: Window
    unit: str = "N*m"

    def __str__(self) -> str:
        return (
            f"{self.speed.size} stretches of {self.revolutions} revolutions, resampled at equal"
            f" angles, resolution {1.0 / self.revolutions:.3g} of an order,"
            f" {window_name(self.window)}"
        )


def at_equal_angles(
    x: np.ndarray, phase: np.ndarray, per_revolution: int
) -> tuple[np.ndarray, np.ndarray]:
    """Samples of ``x`` (n,) at equal steps of the ``phase`` (n,) [rev], and the places among the
    samples of ``x`` at which they are.
    """
    first = int(np.ceil(phase[0] * per_revolution))
    last = int(np.floor(phase[-1] * per_revolution))
    angles = np.arange(first, last + 1) / per_revolution
    place = np.interp(angles, phase, np.arange(x.size))
    return interpolated(x, place), place


def interpolated(x: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Values of ``x`` (n,) at places between its samples, by a windowed sinc; at the ends of the
    record it goes on with its first and last value.
    """
    half = _TAPS // 2
    padded = np.pad(x, half, mode="edge")
    out = np.empty(place.size)
    for begin in range(0, place.size, _BLOCK):
        p = place[begin : begin + _BLOCK]
        base = np.floor(p).astype(int)
        away = (p - base)[:, None] - np.arange(1 - half, half + 1)
        root = np.sqrt(np.maximum(1.0 - (away / half) ** 2, 0.0))
        weight = np.sinc(away) * np.i0(_BETA * root) / np.i0(_BETA)
        samples = padded[base[:, None] + np.arange(1, _TAPS + 1)]
        out[begin : begin + _BLOCK] = np.sum(samples * weight, axis=1) / np.sum(weight, axis=1)
    return out


def revolutions_of_a_stretch(orders: list[float], revolutions: float) -> int:
    """Whole revolutions of a stretch that put the ``orders`` on bins where that is possible, for a
    map of some two dozen rows.
    """
    period = lcm(*(Fraction(order).limit_denominator(16).denominator for order in orders))
    wanted = max(2.0 * revolutions / _ROWS, 4.0 / min(orders), 4.0)
    return min(max(int(np.ceil(wanted / period)) * period, 1), max(int(revolutions), 1))


def order_map(
    x: np.ndarray,
    rate: float,
    phase: np.ndarray,
    orders: list[float],
    highest: float,
    window: Window = "hann",
) -> OrderMap:
    """Order map of ``x`` (n,) up to the ``highest`` order, whose ``phase`` (n,) [rev] grows.

    OrderError where the record holds less than four revolutions.
    """
    total = float(phase[-1] - phase[0])
    if total < 4.0:
        raise OrderError(
            f"the record holds {total:.3g} revolutions of the reference; an order map needs 4"
        )
    slowest = max(float(np.percentile(np.diff(phase), 5.0)) * rate, 1e-12)
    most = _MOST * x.size / total
    per_revolution = int(np.ceil(max(2.56 * highest, min(rate / slowest, most))))
    resampled, place = at_equal_angles(x, phase, per_revolution)
    revolutions = revolutions_of_a_stretch(orders, total)
    segment = revolutions * per_revolution
    starts = np.arange(0, resampled.size - segment + 1, max(segment // 2, 1))
    w = window_values(window, segment)
    order = np.arange(segment // 2 + 1) / revolutions
    kept = order <= highest
    rows = []
    for k in starts:
        piece = resampled[k : k + segment]
        spectrum = np.fft.rfft((piece - piece.mean()) * w)
        rows.append(2.0 * np.abs(spectrum[kept]) / w.sum())
    ends = np.minimum(starts + segment - 1, place.size - 1)
    speed = revolutions * rate * (segment - 1) / segment / (place[ends] - place[starts])
    time = 0.5 * (place[ends] + place[starts]) / rate
    return OrderMap(order[kept], time, speed, np.array(rows), revolutions, window)
