"""When the microsteps come: the inverse of the commanded angle (Eq. 1, 25, 26)."""

from __future__ import annotations

import math
from copy import copy
from itertools import pairwise

import numpy as np

from microvib.errors import SimulationError
from microvib.model.compensation import CompensatedCount
from microvib.model.microstep_shape import MicrostepShape
from microvib.model.scenario import Scenario

MAX_MICROSTEP_RATE = 5_000_000
"""Microsteps per second, at most."""
_NOISE = 1e-14  # error of a count of microsteps over the count, by floating point
_SAME_TIME = 1e-12
"""Part of a time [s], at least of 1 s, within which a part of a microstep is taken twice rather than not
at all, where a run asks for microsteps from there on."""


class Command:
    """Microsteps of a scenario's rate profile, interval by interval.

    k(t) = round(n theta_cmd / Delta theta) with theta_cmd = -h x the commanded angle of the array
    (Eq. 19): a microstep comes whenever the commanded rotor angle passes an odd half of a
    microstep, or, compensated, what ``CompensatedCount`` makes of it.
    """

    def __init__(self, scenario: Scenario) -> None:
        times, rates = scenario.tracking.breakpoints()
        delay = scenario.driver.delay
        if delay > 0.0:
            times, rates = np.r_[0.0, delay, times + delay], np.r_[0.0, 0.0, rates]
        self._times = times
        scale = -scenario.reducer.h / scenario.driver.microstep(scenario.motor)
        self._rates = rates * scale  # in microsteps per second
        steps = np.diff(times)
        self._counts = np.concatenate(
            [[0.0], np.cumsum(0.5 * (self._rates[1:] + self._rates[:-1]) * steps)]
        )
        self._driver, self._motor = scenario.driver, scenario.motor
        self._shape = scenario.driver.shape
        self._since = 0.0  # no microstep comes before it
        self.compensated = CompensatedCount(
            scenario.driver.compensation,
            scenario.reducer.h,
            scenario.driver.microstep(scenario.motor),
        )

    @classmethod
    def lasting(cls, scenario: Scenario, since: float) -> Command:
        """The command as if the rate that it has at ``record.settle`` had lasted since the time
        ``since`` [s] and went on.
        """
        given = cls(scenario)
        begun = scenario.record.settle + scenario.driver.delay
        rate = given._rates[int(np.searchsorted(given._times, begun, side="right")) - 1]
        lasting = copy(given)
        lasting._times, lasting._rates = np.array([since]), np.array([rate])
        lasting._counts = given.count(np.array([begun])) - rate * (begun - since)
        lasting._since = -math.inf
        return lasting

    @property
    def legs(self) -> np.ndarray:
        """Times [s] at which legs of the command begin, and microsteps per second and commanded angle
        in microsteps there, (3, m). Between two the rate is linear; the last lasts for ever.
        """
        return np.array([self._times, self._rates, self._counts])

    def count(self, t: np.ndarray) -> np.ndarray:
        """Commanded angle in microsteps, not rounded and without compensation, at the times ``t`` [s]."""
        leg = np.searchsorted(self._times, t, side="right") - 1
        dt = t - self._times[leg]
        result: np.ndarray = self._counts[leg] + dt * (
            self._rates[leg] + 0.5 * self._slope(leg) * dt
        )
        return result

    def _slope(self, leg: np.ndarray) -> np.ndarray:
        following = np.minimum(leg + 1, self._times.size - 1)
        span = self._times[following] - self._times[leg]
        change = self._rates[following] - self._rates[leg]
        return np.where(span > 0.0, change / np.where(span > 0.0, span, 1.0), 0.0)

    def microsteps(self, start: float, stop: float) -> tuple[np.ndarray, np.ndarray]:
        """Times [s], (m,), in [start, stop), and of each i_A*, i_B* [A] and electrical angle [rad]
        after it, and the time [s] of the ramp to them, of a pulse drive that of the pulse, (m, 4).

        Of microsteps that are made in parts these are the parts, with the electrical angle after the
        whole microstep; where microsteps follow each other more quickly, as about a reversal, the
        references go by the sum of all parts so far.
        """
        if len(self._shape.after) == 1:
            t, k, _, ramp = self._whole(start, stop)
            references = self._driver.reference_currents(self._motor, k)
            return t, np.column_stack([*references, self._driver.electrical_angle(k), ramp])
        begun = min(max(start - self._shape.lasts, self._since), start)
        t, k, way, _ = self._whole(begun, stop)
        return self._within(start, stop, *self._in_parts(t, k, way))

    def _in_parts(
        self, t: np.ndarray, k: np.ndarray, way: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] of the parts of microsteps at the times ``t`` (m,), in their order, and rows of
        ``microsteps``; ``k`` (m,) microsteps are made after each, ``way`` (m,) is 1 or -1."""
        times = (t[:, None] + self._shape.after).ravel()
        of = np.repeat(np.arange(t.size), len(self._shape.after))
        order = np.argsort(times, kind="stable")
        times, last = times[order], np.maximum.accumulate(of[order])
        goal = np.column_stack(self._driver.reference_currents(self._motor, k))
        step = goal - np.column_stack(self._driver.reference_currents(self._motor, k - way))
        references = goal[last]
        earliest = np.searchsorted(t, t - self._shape.lasts)
        for behind in range(int(np.max(np.arange(t.size) - earliest, initial=0)) + 1):
            one = np.maximum(last - behind, 0)
            coming = _coming(self._shape, t[one], times) * (last >= behind)
            references = references - coming[:, None] * step[one]
        angle = self._driver.electrical_angle(k)[last]
        return times, np.column_stack([references, angle, np.zeros(times.size)])

    @staticmethod
    def _within(
        start: float, stop: float, t: np.ndarray, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Keep of the times ``t`` (m,), in order, those in [start, stop), with their rows.

        One at ``start`` may have been computed as just before it. It is taken again then, which
        changes nothing: a row has what the references are, not their change.
        """
        first = int(np.searchsorted(t, start - _SAME_TIME * max(abs(start), 1.0)))
        there = slice(first, int(np.searchsorted(t, stop)))
        return np.maximum(t[there], start), rows[there]

    def crossings(self, start: float, stop: float) -> np.ndarray:
        """Times [s] of whole microsteps in [start, stop), the rotor's microsteps made after each, 1 or
        -1 by the direction of each, and microsteps per second there, (4, m).
        """
        edges = np.unique(
            np.concatenate(
                [[start, stop], self._times[(self._times > start) & (self._times < stop)]]
            )
        )
        found = [
            self._crossings(lo, hi)
            for a, b in pairwise(edges.tolist())
            for lo, hi in self._monotone(a, b)
        ]
        if not found:
            return np.zeros((4, 0))
        return np.concatenate(found, axis=1)

    def _whole(self, start: float, stop: float) -> tuple[np.ndarray, ...]:
        """Times [s] of whole microsteps in [start, stop), microsteps made after each, 1 or -1 by the
        direction of each, and the time [s] of its ramp or pulse, (m,) each."""
        t, k, way, rate = self.crossings(start, stop)
        with np.errstate(divide="ignore"):
            ramp = np.where(rate > 0.0, self._driver.microstep_ramp / rate, 0.0)
        if self._driver.pulsed:
            ramp = np.full(t.size, self._driver.on_time)
        return t, k, way, ramp

    def _monotone(self, a: float, b: float) -> list[tuple[float, float]]:
        """Split a piece of constant acceleration where its rate passes zero."""
        leg = int(np.searchsorted(self._times, a, side="right")) - 1
        slope = float(self._slope(np.array([leg]))[0])
        rate = float(self._rates[leg] + slope * (a - self._times[leg]))
        turn = a - rate / slope if slope != 0.0 else a
        if a < turn < b:
            return [(a, turn), (turn, b)]
        return [(a, b)]

    def _crossings(self, a: float, b: float) -> np.ndarray:
        """Times [s], microsteps made after each, their direction, and microsteps per second there, (4,
        m), where the rate keeps its sign.
        """
        leg = int(np.searchsorted(self._times, a, side="right")) - 1
        slope = float(self._slope(np.array([leg]))[0])
        dt_a, dt_b = a - self._times[leg], b - self._times[leg]
        rate_a = self._rates[leg] + slope * dt_a
        from_count = self._counts[leg] + dt_a * (self._rates[leg] + 0.5 * slope * dt_a)
        to_count = self._counts[leg] + dt_b * (self._rates[leg] + 0.5 * slope * dt_b)
        # A microstep due at a or b comes once, whichever side of it the noise of floating point
        # puts the count.
        from_count, to_count = self._snapped(from_count), self._snapped(to_count)
        if abs(to_count - from_count) > MAX_MICROSTEP_RATE * max(b - a, 1.0):
            raise SimulationError(
                f"tracking: the command asks for {abs(to_count - from_count) / (b - a):.3g}"
                f" microsteps per second at t = {a:.4g} s;"
                f" at most {MAX_MICROSTEP_RATE} are followed; lower the rate, reducer.ratio or"
                " driver.microsteps"
            )
        levels = self._passed(from_count, to_count)
        way = math.copysign(1.0, to_count - from_count)
        due = self.compensated.commanded(levels)
        rise = due - from_count
        # root of rate_a dt + slope dt^2 / 2 = rise, in the form that does not cancel
        root = np.sqrt(np.maximum(rate_a**2 + 2.0 * slope * rise, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            dt = np.where(
                rise == 0.0, 0.0, 2.0 * rise / (rate_a + np.copysign(root, to_count - from_count))
            )
        # A crossing just before b may round to b, which belongs to the next interval: it stays in
        # this one.
        t = np.clip(a + dt, a, np.nextafter(b, a))
        after, ways = levels + 0.5 * way, np.full(levels.size, way)
        if not self.compensated.acts:
            return np.array([t, after, ways, root])
        following = np.abs(self.compensated.commanded(levels + way) - due)
        return np.array([t, after, ways, root / following])

    def _passed(self, from_count: float, to_count: float) -> np.ndarray:
        """Odd halves of microsteps, (m,), at which one comes from one count of the command to
        another, the first included."""
        if self.compensated.acts:
            reach = self.compensated.reach + 1.0
            low, high = sorted([from_count, to_count])
            levels = np.arange(math.floor(low - reach), math.ceil(high + reach)) + 0.5
            due = self.compensated.commanded(levels)
            if to_count >= from_count:
                return levels[(due >= from_count) & (due < to_count)]
            return levels[(due <= from_count) & (due > to_count)][::-1]
        if to_count >= from_count:
            return np.arange(np.ceil(from_count - 0.5), np.ceil(to_count - 0.5)) + 0.5
        return np.arange(np.floor(from_count + 0.5), np.floor(to_count + 0.5), -1.0) - 0.5

    def _snapped(self, count: float) -> float:
        """A count of the command; that of a microstep where it is within the noise of floating point
        of one."""
        if not self.compensated.acts:
            return _snap_to_odd_half(count)
        reach = self.compensated.reach + 1.0
        levels = np.arange(math.floor(count - reach), math.ceil(count + reach)) + 0.5
        due = self.compensated.commanded(levels)
        nearest = float(due[np.argmin(np.abs(due - count))])
        if abs(count - nearest) <= _NOISE * (1.0 + abs(count)):
            return nearest
        return count


def _snap_to_odd_half(count: float) -> float:
    """A count of microsteps; an odd half where it is within the noise of floating point of one."""
    half = math.floor(count) + 0.5
    if abs(count - half) <= _NOISE * (1.0 + abs(count)):
        return half
    return count


def _coming(shape: MicrostepShape, begun: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Fraction of microsteps at the times ``begun`` (m,) whose parts come after the times ``now``
    (m,); zero, to the last bit, after their last part.
    """
    left = np.zeros(now.size)
    for fraction, after in zip(shape.fractions, shape.after, strict=True):
        left += np.where(begun + after > now, fraction, 0.0)
    return left
