"""When the microsteps come: the inverse of the commanded angle (Eq. 1, 25, 26)."""

from __future__ import annotations

import math
from copy import copy
from itertools import pairwise

import numpy as np

from microvib.errors import SimulationError
from microvib.model.scenario import Scenario

MAX_MICROSTEP_RATE = 5_000_000
"""Microsteps per second, at most."""
_NOISE = 1e-14  # error of a count of microsteps over the count, by floating point


class Command:
    """Microsteps of a scenario's rate profile, interval by interval.

    k(t) = round(n theta_cmd / Delta theta) with theta_cmd = -h x the commanded angle of the array
    (Eq. 19): a microstep comes whenever the commanded rotor angle passes an odd half of a
    microstep.
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
        return lasting

    def count(self, t: np.ndarray) -> np.ndarray:
        """Commanded angle in microsteps, not rounded, at the times ``t`` [s]."""
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

    def crossings(self, start: float, stop: float) -> np.ndarray:
        """Times [s] of the microsteps in [start, stop), the rotor's microsteps made after each, and
        microsteps per second there, (3, m).
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
            return np.zeros((3, 0))
        return np.concatenate(found, axis=1)

    def microsteps(self, start: float, stop: float) -> tuple[np.ndarray, np.ndarray]:
        """Times [s], (m,), in [start, stop), and of each i_A*, i_B* [A] and electrical angle [rad]
        after it, and the time [s] of the ramp to them, of a pulse drive that of the pulse, (m, 4)."""
        t, k, rate = self.crossings(start, stop)
        with np.errstate(divide="ignore"):
            ramp = np.where(rate > 0.0, self._driver.microstep_ramp / rate, 0.0)
        if self._driver.pulsed:
            ramp = np.full(t.size, self._driver.on_time)
        references = self._driver.reference_currents(self._motor, k)
        return t, np.column_stack([*references, self._driver.electrical_angle(k), ramp])

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
        """Times [s], microsteps made after each, and microsteps per second there, (3, m), where the
        rate keeps its sign.
        """
        leg = int(np.searchsorted(self._times, a, side="right")) - 1
        slope = float(self._slope(np.array([leg]))[0])
        dt_a, dt_b = a - self._times[leg], b - self._times[leg]
        rate_a = self._rates[leg] + slope * dt_a
        from_count = self._counts[leg] + dt_a * (self._rates[leg] + 0.5 * slope * dt_a)
        to_count = self._counts[leg] + dt_b * (self._rates[leg] + 0.5 * slope * dt_b)
        # A microstep due at a or b comes once, whichever side of it the noise of floating point
        # puts the count.
        from_count, to_count = _snap_to_odd_half(from_count), _snap_to_odd_half(to_count)
        if abs(to_count - from_count) > MAX_MICROSTEP_RATE * max(b - a, 1.0):
            raise SimulationError(
                f"tracking: the command asks for {abs(to_count - from_count) / (b - a):.3g}"
                f" microsteps per second at t = {a:.4g} s;"
                f" at most {MAX_MICROSTEP_RATE} are followed; lower the rate, reducer.ratio or"
                " driver.microsteps"
            )
        if to_count >= from_count:
            levels = np.arange(np.ceil(from_count - 0.5), np.ceil(to_count - 0.5)) + 0.5
            after = levels + 0.5
        else:
            levels = np.arange(np.floor(from_count + 0.5), np.floor(to_count + 0.5), -1.0) - 0.5
            after = levels - 0.5
        rise = levels - from_count
        # root of rate_a dt + slope dt^2 / 2 = rise, in the form that does not cancel
        root = np.sqrt(np.maximum(rate_a**2 + 2.0 * slope * rise, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            dt = np.where(
                rise == 0.0, 0.0, 2.0 * rise / (rate_a + np.copysign(root, to_count - from_count))
            )
        # A crossing just before b may round to b, which belongs to the next interval: it stays in
        # this one.
        return np.array([np.clip(a + dt, a, np.nextafter(b, a)), after, root])


def _snap_to_odd_half(count: float) -> float:
    """A count of microsteps; an odd half where it is within the noise of floating point of one."""
    half = math.floor(count) + 0.5
    if abs(count - half) <= _NOISE * (1.0 + abs(count)):
        return half
    return count
