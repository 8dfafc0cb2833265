"""The clock of a sweep: its phase found in the record, from a stated speed or from the strongest order.

Recorder and driver count time by clocks of their own, and a profile may begin a little before or
after it is thought to. The speed is therefore looked for about the stated one: first on a grid, by
how far the orders stand above the floor along their paths through a spectrogram, then by the phases
of all orders, which turn with the difference between their frequencies and those of the reference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.signals.line_table import DETECTION_RATIO
from microvib.signals.order_tracking import Tracked, track_components

_GRID = 21
"""Steps of the search on each side together."""
_TERMS = 5
"""Polynomials, from a constant on, that a correction of the speed is made of."""
_ROUNDS = 8
_BEYOND = 2.2
"""Times of the tolerance, of mean and slope together, beyond which a clock is not the stated one."""
_MIN_SHARE = 0.5
"""Part of the record in which an order must be above the noise, without which its clock is not found."""
_STRUCTURE = 0.25
"""Turns by which a structure shifts the phase of an order over a sweep, as a standard uncertainty: half a
turn where it crosses a resonance."""
_POINTS_ALIKE = 4.0
"""Points of an amplitude between two knots, whose noise is alike."""
_RANK = 1e-9
"""Singular value of the fit of the speed, over the largest, below which it is not told."""
_SETTLED = 1e-4
"""Part of a revolution below which a round changes nothing."""
_CYCLES = 12.0
"""Cycles of the slowest order in a stretch of the spectrogram, about."""
_MAX_JUMP = 2
"""Bins by which a ridge moves from one stretch to the next, at least allowed for."""


@dataclass(frozen=True)
class FoundClock:
    """Revolutions of the reference as a record shows them."""

    phase: np.ndarray
    """Revolutions at the samples, (n,)."""
    correction: np.ndarray
    """Speed found over the one stated, less 1, (n,)."""
    uncertainty: float
    """Standard uncertainty of the mean speed over the speed."""
    share: float
    """Part of the record in which an order is above the noise."""


@dataclass(frozen=True)
class Spectrogram:
    """Powers over frequency of successive stretches, in units of the floor about each bin."""

    time: np.ndarray
    """Middles of the stretches [s], (t,)."""
    resolution: float
    """Distance of the bins [Hz]."""
    height: np.ndarray
    """Amplitude over the floor, (t, f)."""
    amplitude: np.ndarray
    """Amplitudes in the unit of the samples, (t, f)."""

    @classmethod
    def of(cls, x: np.ndarray, rate: float, seconds: float) -> Spectrogram:
        """Spectrogram of stretches of so many ``seconds`` that overlap by three quarters."""
        from scipy.ndimage import median_filter

        segment = int(np.clip(round(seconds * rate), 32, x.size))
        starts = np.arange(0, x.size - segment + 1, max(segment // 4, 1))
        window = np.hanning(segment + 1)[:-1]
        rows = [
            np.abs(np.fft.rfft((x[k : k + segment] - x[k : k + segment].mean()) * window))
            for k in starts
        ]
        amplitude = np.array(rows) * (2.0 / window.sum())
        floor = median_filter(amplitude, size=(1, 41), mode="reflect")
        least = 1e-9 * max(float(np.max(amplitude)), 1e-300)
        height = amplitude / np.maximum(floor, least)
        return cls((starts + 0.5 * segment) / rate, rate / segment, height, amplitude)

    def along(self, frequency: np.ndarray) -> np.ndarray:
        """Heights over the floor at a ``frequency`` (..., t) [Hz] in each stretch; 1 beyond the bins."""
        place = np.rint(frequency / self.resolution).astype(int)
        inside = (place >= 2) & (place < self.height.shape[1] - 1)
        place = np.clip(place, 0, self.height.shape[1] - 1)
        return np.where(inside, self.height[np.arange(self.time.size), place], 1.0)


def stretch_length(speed: np.ndarray, rate: float, orders: Sequence[float]) -> float:
    """Length [s] of stretches in which a sweep of ``speed`` (n,) [Hz] moves its orders by about a bin."""
    slope = float(np.median(np.abs(np.diff(speed)))) * rate * max(orders)
    slowest = max(float(np.median(speed)) * min(orders), 1e-9)
    longest = speed.size / rate / 8.0
    sharp = np.sqrt(1.0 / slope) if slope > 0.0 else longest
    return float(min(max(sharp, _CYCLES / slowest / 4.0), longest))


def find_clock(
    x: np.ndarray, rate: float, speed: np.ndarray, orders: Sequence[float], tolerance: float
) -> FoundClock | None:
    """Revolutions over the record ``x`` (n,), whose ``speed`` (n,) [Hz] is stated to a relative
    ``tolerance`` in its mean and in its slope; None where no order is above the noise floor.
    """
    start = _on_grid(x, rate, speed, orders, tolerance)
    if start is None:
        return None
    found = refine_clock(x, rate, start, speed, orders)
    lost = float(np.max(np.abs(found.correction))) > _BEYOND * tolerance
    return None if lost or found.share < _MIN_SHARE else found


def _on_grid(
    x: np.ndarray, rate: float, speed: np.ndarray, orders: Sequence[float], tolerance: float
) -> np.ndarray | None:
    """Speed (n,) [Hz] along which the orders are highest over the noise floor; None where none is
    above it."""
    gram = Spectrogram.of(x, rate, stretch_length(speed, rate, orders))
    at = np.clip((gram.time * rate).astype(int), 0, speed.size - 1)
    stated, u = speed[at], np.linspace(-1.0, 1.0, speed.size)
    tried = np.linspace(-tolerance, tolerance, _GRID) if tolerance > 0.0 else np.zeros(1)
    best, found, height = -1.0, (0.0, 0.0), 0.0
    for offset in tried:
        for tilt in tried:
            along = stated * (1.0 + offset + tilt * u[at])
            heights = [gram.along(order * along) for order in orders]
            score = float(sum(np.sum(np.log(np.maximum(one, 1.0))) for one in heights))
            if score > best + 1e-9:
                best, found = score, (offset, tilt)
                height = max(float(np.median(one)) for one in heights)
    if height < 0.5 * DETECTION_RATIO:
        return None
    return np.asarray(speed * (1.0 + found[0] + found[1] * u))


def refine_clock(
    x: np.ndarray, rate: float, start: np.ndarray, stated: np.ndarray, orders: Sequence[float]
) -> FoundClock:
    """Revolutions by the phases of the orders, from a speed ``start`` (n,) [Hz] that is off by less
    than a few cycles of a stretch.

    The correction of the speed is a polynomial over the record: the shifts of phase that a
    structure makes where an order crosses its resonance are not in it.
    """
    speed, sigma, share = start, np.inf, 0.0
    gap = float(np.min(np.diff(np.unique([0.0, *orders]))) * np.percentile(start, 10.0))
    lowest = 4.0 * rate / x.size
    bandwidth = max(min(0.5 * gap, 8.0 / stretch_length(start, rate, orders)), lowest)
    for _ in range(_ROUNDS):
        phase = revolutions(speed, rate)
        phases = 2.0 * np.pi * np.outer(orders, phase)
        used = np.outer(orders, speed) < 0.5 * rate
        tracked = track_components(x, rate, phases, used, bandwidth)
        share = float(np.mean(np.any(np.abs(tracked.amplitude) > 4.0 * tracked.noise, axis=0)))
        turned = tracked.amplitude[:, 1:] * np.conj(tracked.amplitude[:, :-1])
        step = float(tracked.time[1] - tracked.time[0])
        middle = 0.5 * (tracked.time[1:] + tracked.time[:-1])
        off = np.angle(turned) / (2.0 * np.pi * step * np.asarray(orders)[:, None])
        weight = np.abs(turned) * np.asarray(orders)[:, None] ** 2
        told = tracked.separable[:, 1:] & tracked.separable[:, :-1]
        told &= np.abs(turned) > (3.0 * tracked.noise[:, 1:]) ** 2
        weight = np.where(told, weight, 0.0)
        if not np.any(weight):
            break
        u = 2.0 * middle * rate / x.size - 1.0
        basis = np.polynomial.legendre.legvander(np.tile(u, len(orders)), _TERMS - 1)
        root = np.sqrt(weight).ravel()
        solve = np.linalg.pinv(basis * root[:, None], rcond=_RANK)
        c = solve @ (off.ravel() * root)
        change = np.polynomial.legendre.legval(np.linspace(-1.0, 1.0, x.size), c)
        speed = np.maximum(speed + change, 1e-6 * np.max(speed))
        shares = (solve[0] * root).reshape(off.shape)
        sigma = _speed_uncertainty(tracked, shares, np.asarray(orders), step)
        if np.max(np.abs(np.cumsum(change))) / rate < _SETTLED:
            break
    relative = sigma / float(np.mean(speed))
    return FoundClock(revolutions(speed, rate), speed / stated - 1.0, relative, share)


def _speed_uncertainty(
    tracked: Tracked, shares: np.ndarray, orders: np.ndarray, step: float
) -> float:
    """Standard uncertainty [Hz] of the mean speed, which is the sum of ``shares`` (K, m) times what the
    phases of each order say of it between points ``step`` [s] apart.

    A structure turns the phase of an order by up to half a turn where it crosses a resonance, wherever
    that is, and all orders in the same direction. Where no order is seen the speed is that of the
    polynomial through the rest, to which few points have large shares.
    """
    size = np.maximum(np.abs(tracked.amplitude), 1e-300)
    phase = np.minimum(tracked.noise / size, math.pi) / (2.0 * math.pi)
    ends = np.pad(shares, ((0, 0), (1, 1)))
    by_point = np.diff(ends, axis=1) / (orders[:, None] * step)
    noise = math.sqrt(_POINTS_ALIKE * float(np.sum((by_point * phase) ** 2)))
    structure = _STRUCTURE * float(np.sum(np.max(np.abs(shares), axis=1) / (orders * step)))
    return math.hypot(noise, structure)


def revolutions(speed: np.ndarray, rate: float) -> np.ndarray:
    """Revolutions (n,) from the first sample on at a ``speed`` (n,) [Hz], by the trapezoidal rule."""
    steps = 0.5 * (speed[1:] + speed[:-1]) / rate
    return np.concatenate([[0.0], np.cumsum(steps)])


def follow_strongest(x: np.ndarray, rate: float, seconds: float) -> np.ndarray | None:
    """Frequency (n,) [Hz] of the strongest component, followed through the stretches of a
    spectrogram of so many ``seconds``; None where nothing is above the noise floor.

    The path through the bins has the largest sum of heights over the floor of all that move by few
    bins from stretch to stretch (dynamic programming); a smooth curve is laid through it.
    """
    from scipy.interpolate import make_lsq_spline

    gram = Spectrogram.of(x, rate, seconds)
    score = np.log(np.maximum(gram.amplitude, 1e-9 * gram.amplitude.max()))
    score[:, :3] = score.min()
    jump = max(_MAX_JUMP, score.shape[1] // 50)
    total, came = score[0], []
    for row in score[1:]:
        padded = np.pad(total, jump, constant_values=-np.inf)
        around = np.lib.stride_tricks.sliding_window_view(padded, 2 * jump + 1)
        cost = 0.05 * np.abs(np.arange(-jump, jump + 1))
        best = np.argmax(around - cost, axis=1)
        came.append(best - jump)
        total = row + (around - cost)[np.arange(row.size), best]
    path = [int(np.argmax(total))]
    for moves in reversed(came):
        path.append(path[-1] + int(moves[path[-1]]))
    bins = np.array(path[::-1])
    if np.median(gram.height[np.arange(bins.size), bins]) < 0.5 * DETECTION_RATIO:
        return None
    places = np.array([_between_bins(gram.amplitude[k], b) for k, b in enumerate(bins)])
    f = places * gram.resolution
    inner = np.linspace(gram.time[0], gram.time[-1], max(min(bins.size // 4, 12), 1) + 2)[1:-1]
    knots = np.r_[[gram.time[0]] * 4, inner, [gram.time[-1]] * 4]
    t = np.arange(x.size) / rate
    if bins.size < 8:
        return np.interp(t, gram.time, f)
    smooth = make_lsq_spline(gram.time, f, knots)
    inside = smooth(np.clip(t, gram.time[0], gram.time[-1]))
    slope = smooth.derivative()
    early, late = float(slope(gram.time[0])), float(slope(gram.time[-1]))
    inside += early * np.minimum(t - gram.time[0], 0.0) + late * np.maximum(t - gram.time[-1], 0.0)
    return np.maximum(inside, gram.resolution)


def _between_bins(amplitude: np.ndarray, k: int) -> float:
    """Place of a peak at bin ``k`` in parts of a bin, by a parabola through logarithms."""
    if not 0 < k < amplitude.size - 1:
        return float(k)
    a, b, c = np.log(np.maximum(amplitude[k - 1 : k + 2], 1e-300))
    bend = a - 2.0 * b + c
    return k + float(np.clip(0.5 * (a - c) / bend if bend < 0.0 else 0.0, -0.5, 0.5))
