"""Rate profiles, and the ringing that they leave in a linear mode.

A mode with the eigenvalue s = -zeta omega + i omega sqrt(1 - zeta^2) that a step of the rate by one
leaves ringing with the amplitude g rings after a profile r(t) that ends at t_e with g ``|R(s)|``,

    R(s) = integral of dr/dt exp(s (t_e - t)) dt,

in which a step counts as an impulse of dr/dt. That is the residual vibration of input shaping
(Singer and Seering, J. Dyn. Syst. Meas. Control 112, 1990).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_BLOCK = 2_000_000
"""Terms of exponentials that are in memory together, at most."""
_SMALL = 1e-6
"""Exponent below which a leg's mean exponential is taken by its series."""


@dataclass(frozen=True)
class RateProfile:
    """A rate over time, linear between its points; a jump repeats its time.

    Before the first point the rate is the first one, after the last point the last one.
    """

    times: np.ndarray
    """Times [s], (m,), in order, the first is 0."""
    rates: np.ndarray
    """Rates [rad/s], (m,)."""

    @classmethod
    def of_jumps(cls, times: np.ndarray, jumps: np.ndarray, first: float = 0.0) -> RateProfile:
        """Profile that begins at the rate ``first`` and jumps by ``jumps`` (n,) at ``times`` (n,)."""
        levels = first + np.concatenate([[0.0], np.cumsum(jumps)])
        return cls(np.repeat(times, 2), np.column_stack([levels[:-1], levels[1:]]).ravel())

    @property
    def duration(self) -> float:
        """Time from its first point to its last [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def angle(self) -> float:
        """Angle that it turns through [rad]."""
        return float(np.trapezoid(self.rates, self.times))

    @property
    def largest_jump(self) -> float:
        """Largest change of the rate within an instant [rad/s]."""
        jumps = np.abs(np.diff(self.rates))[np.diff(self.times) == 0.0]
        return float(np.max(jumps, initial=0.0))

    @property
    def largest_acceleration(self) -> float:
        """Largest rate of change [rad/s^2]; infinite where it jumps."""
        if self.largest_jump > 0.0:
            return math.inf
        return float(np.max(np.abs(self._accelerations), initial=0.0))

    @property
    def _accelerations(self) -> np.ndarray:
        spans = np.diff(self.times)
        change = np.diff(self.rates)
        return np.asarray(np.divide(change, spans, out=np.zeros_like(change), where=spans > 0.0))

    def at(self, t: np.ndarray) -> np.ndarray:
        """Rates at times (n,); at a jump that after it."""
        index = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.times.size - 1)
        following = np.minimum(index + 1, self.times.size - 1)
        span = self.times[following] - self.times[index]
        part = np.divide(t - self.times[index], span, out=np.zeros_like(span), where=span > 0.0)
        before = self.rates[index]
        inside = np.clip(part, 0.0, 1.0)
        return np.asarray(before + inside * (self.rates[following] - before))

    def then(self, other: RateProfile, wait: float = 0.0) -> RateProfile:
        """The profile, its last rate for a time ``wait`` [s], and another profile."""
        late = other.times - other.times[0] + self.times[-1] + wait
        return RateProfile(
            np.concatenate([self.times, late]), np.concatenate([self.rates, other.rates])
        )

    def scaled(self, first: float, last: float) -> RateProfile:
        """A profile from 0 to 1 as one from the rate ``first`` to the rate ``last``, exactly."""
        rates = first + (last - first) * self.rates
        rates[-1] = last
        return RateProfile(self.times, rates)

    def convolved(self, times: np.ndarray, parts: np.ndarray) -> RateProfile:
        """Mean of the profile delayed by ``times`` (n,), with the weights ``parts`` (n,): the profile
        through an input shaper.

        Jumps of the profile are kept.
        """
        events = [
            (float(t + late), float(part * change))
            for late, part in zip(times, parts, strict=True)
            for t, change in zip(*self._jumps(), strict=True)
        ]
        corners = np.add.outer(times, self.times).ravel()
        at = np.unique(np.round(corners, 12))
        ramped = np.zeros(at.size)
        for late, part in zip(times, parts, strict=True):
            ramped += part * self._continuous(at - late)
        return _with_jumps(at, ramped, events)

    def _jumps(self) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and heights [rad/s] of its jumps."""
        here = np.diff(self.times) == 0.0
        return self.times[:-1][here], np.diff(self.rates)[here]

    def _continuous(self, t: np.ndarray) -> np.ndarray:
        """Rates at times (n,) without the jumps."""
        times, heights = self._jumps()
        shift = np.zeros(self.times.size)
        for k in np.flatnonzero(np.diff(self.times) == 0.0):
            shift[k + 1 :] += self.rates[k + 1] - self.rates[k]
        return np.interp(t, self.times, self.rates - shift)

    def residual(self, s: np.ndarray) -> np.ndarray:
        """R(s) at its end for eigenvalues ``s`` (n,) [1/s], complex (n,), in rad/s."""
        found = np.zeros(s.size, dtype=complex)
        step = max(_BLOCK // max(self.times.size, 1), 1)
        for first in range(0, s.size, step):
            found[first : first + step] = self._residual(s[first : first + step])
        return found

    def _residual(self, s: np.ndarray) -> np.ndarray:
        left = self.times[-1] - self.times
        spans, change = np.diff(self.times), np.diff(self.rates)
        mean = np.exp(np.outer(s, left[1:])) * _mean_exponential(np.outer(s, spans))
        return np.asarray(mean @ change)

    def residual_slope(self, decay: float) -> float:
        """Bound on ``|dR/ds|`` [rad] where modes decay at the rate ``decay`` [1/s] or faster.

        It is at most the integral of ``|dr/dt|`` (t_e - t) exp(-decay (t_e - t)) dt, whose last
        factors are at most 1/(e decay).
        """
        left = self.times[-1] - self.times
        longest = np.maximum(left[:-1], left[1:])
        if decay > 0.0:
            weight = np.where(
                longest * decay < 1.0, longest * np.exp(-decay * longest), 1.0 / (math.e * decay)
            )
        else:
            weight = longest
        return float(np.sum(np.abs(np.diff(self.rates)) * weight))


def _mean_exponential(x: np.ndarray) -> np.ndarray:
    """Mean of exp(x u) over u from 0 to 1: (exp(x) - 1)/x."""
    small = np.abs(x) < _SMALL
    safe = np.where(small, 1.0, x)
    return np.where(small, 1.0 + 0.5 * x, np.expm1(safe) / safe)


def _with_jumps(
    at: np.ndarray, ramped: np.ndarray, events: list[tuple[float, float]]
) -> RateProfile:
    """Profile of a continuous part ``ramped`` (n,) at ``at`` (n,), and of ``events``: jumps, by their times."""
    heights: dict[float, float] = {}
    for t, height in events:
        heights[round(t, 12)] = heights.get(round(t, 12), 0.0) + height
    times, rates, level = [], [], 0.0
    for t, rate in zip(at.tolist(), ramped.tolist(), strict=True):
        times.append(t)
        rates.append(rate + level)
        if heights.get(t, 0.0) != 0.0:
            level += heights[t]
            times.append(t)
            rates.append(rate + level)
    return RateProfile(np.array(times), np.array(rates))
