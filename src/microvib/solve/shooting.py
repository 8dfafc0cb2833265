"""Search for the state that one period of the command leaves as it is (shooting), and checks of what was found.

Quasi-Newton on the drive's map over a period (``microvib.solve.period``): its derivative is that of a part of the period, by
differences, then Broyden's updates. What was found must be stable, and the only such motion as far as two further starts tell.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import eig

from microvib.solve import kernel
from microvib.solve.decimate import PASSBAND
from microvib.solve.motion import Invariants
from microvib.solve.period import NotPeriodic, PeriodMap
from microvib.solve.simulate import balance

CLOSE = 1e-4
"""Largest distance of an accepted state from the steady one, over what a microstep moves."""
SAMPLED_FROM = 0.5
"""Distance below which a period is sampled, for it may be the last."""
BELIEVED = 20.0
"""Correction above which the linearisation is not believed and a period is let pass instead."""
MOST_STEPS = 8
"""Corrections that a search may take. Three to six are usual; what took twice as many was seldom what a run in time shows."""
STABLE = 1.005
"""Largest multiplier that passes for stable: that of a mode without damping is 1, and it is measured to a thousandth."""
SLOW = 0.8
"""Multiplier from which a deviation's decay is measured over a whole period and not taken from the derivative."""
DEVIATION = 0.3
"""Deviation with which it is measured, over what a microstep moves."""
SAME = 0.02
"""Part of its distance within which a search from another start must come back, to count as finding the same motion."""
STUCK = (kernel.CHANNELS.index("stuck_rotor"), kernel.CHANNELS.index("stuck_output"))
CALMS_WITHIN = 4.0
"""Time [s] within which what was stopped must slip again without sticking."""
NOT_FOUND = "no motion was found that repeats with the command"
HARMONICS = 8
"""Driving lines whose amplitudes the sampling must not disturb; see ``_intervals``."""


class NotUnique(NotPeriodic):
    """More than one steady state that repeats with the command was found."""


class Search:
    """Quasi-Newton search for the state that one period leaves as it is; states in units of what a microstep moves."""

    def __init__(self, period: PeriodMap) -> None:
        self.period = period
        self.rows = np.zeros((_intervals(period), period.packed.channels))

    def run(self, settle: float) -> Search:
        """Search from the mean motion, after ``settle`` periods of simulation; NotPeriodic where nothing is found."""
        period = self.period
        y = period.guess()
        for _ in range(max(int(settle), 1)):  # the fast motions settle
            y = period.advance(y, math.ceil(min(settle, 1.0) * period.microsteps))
        self.newton = _Newton(period.monodromy(y))
        x, self.distance = y / period.sizes, math.inf
        for _ in range(MOST_STEPS):
            self.x, self._end, self.invariants = self._advance(x, sampled=self.distance < SAMPLED_FROM)
            x = self.newton.next(self.x, self.x - self._end)
            self.distance = float(np.max(np.abs(x - self.x)))
            if self.invariants is not None and self.distance < CLOSE:
                self._check_stable()
                self._check_for_a_twin()
                self._check_for_stick_slip()
                return self
            if not self.distance < BELIEVED:
                x = self._end
        raise NotPeriodic(NOT_FOUND)

    def _advance(self, x: np.ndarray, sampled: bool) -> tuple[np.ndarray, np.ndarray, Invariants | None]:
        """The state as it was started, with the rates at zero of what sticks; that after a period; its invariants."""
        period, invariants = self.period, None
        y = x * period.sizes
        if sampled:
            n, channels = self.rows.shape
            width = 1.0 / (period.frequency * n)
            samples = kernel.Samples(period.start, width, self.rows, np.zeros(channels), np.zeros(2, dtype=np.int64))
            period.put(y)
            before, momentum = period.packed.snapshot(), period.packed.momentum
            end = period.advance(y, samples=samples)
            invariants = balance(period.packed, before, momentum, 1.0 / period.frequency)
        else:
            end = period.advance(y)
        x = x.copy()
        x[[kernel.WM, kernel.WL]] *= np.logical_not(period.stuck)
        return x, end / period.sizes, invariants

    def _check_stable(self) -> None:
        self.multiplier = self._multiplier(self.newton.derivative)
        if self.multiplier > STABLE:
            self.multiplier = self._multiplier(self._derivative_here())
        if self.multiplier > STABLE:
            raise NotPeriodic(f"what repeats with the command is not stable (multiplier {self.multiplier:.4g})")

    def _multiplier(self, derivative: np.ndarray) -> float:
        """Largest part of a deviation that is left after a period, of slow ones measured along their directions, all at once."""
        values, left, right = eig(derivative, left=True)
        size = np.abs(values)
        slow = (size > SLOW) & (values.imag >= 0.0)
        if np.any(slow):
            directions = right[:, slow].real / np.max(np.abs(right[:, slow].real), axis=0)
            x = self.x + DEVIATION * np.sum(directions, axis=1) * (self.x != 0.0)  # what sticks stays
            _, end, _ = self._advance(x, sampled=False)
            seen = left[:, slow].conj().T
            size[slow] = np.abs(seen @ (end - self._end)) / np.abs(seen @ (x - self.x))
        return float(np.max(size))

    def _check_for_a_twin(self) -> None:
        """Search again from the state one microstep on: a motion that breaks the symmetry of microsteps has a twin there."""
        x = self.period.advance(self.x * self.period.sizes, 1) / self.period.sizes
        if not (self._comes_back(x, self.newton.derivative) or self._comes_back(x, self._derivative_here())):
            raise NotUnique(
                "of the motions that repeat with the command there are several; which one, its beginning decides"
            )

    def _comes_back(self, x: np.ndarray, derivative: np.ndarray) -> bool:
        newton = _Newton(derivative)
        back = max(SAME * float(np.max(np.abs(x - self.x))), 10.0 * CLOSE)
        for _ in range(6):
            x, end, _ = self._advance(x, sampled=False)
            x = newton.next(x, x - end)
            if float(np.max(np.abs(x - self.x))) <= back:
                return True
        return False

    def _derivative_here(self) -> np.ndarray:
        """The derivative at what was found, where what the search knows of it is not good enough."""
        return self.period.monodromy(self.x * self.period.sizes)

    def _check_for_stick_slip(self) -> None:
        """Stop what never sticks: where friction falls with the rate, an oscillation that sticks and slips may last beside it."""
        period, p = self.period, self.period.packed.drive
        never = [kernel.WM] * (p.m_stribeck > 0.0) * (not np.any(self.rows[:, STUCK[0]]))
        never += [kernel.WL] * (p.l_stribeck > 0.0) * (not np.any(self.rows[:, STUCK[1]]))
        if not never:
            return
        y = self.x * period.sizes
        y[[kernel.WM, kernel.WL] if p.rigid else never] = 0.0
        counters = period.packed.state.counters
        for _ in range(math.ceil(CALMS_WITHIN * period.frequency)):
            before = int(counters[kernel.STICKS])
            y = period.advance(y)
            if counters[kernel.STICKS] == before:
                return
        raise NotUnique("beside the motion that repeats with the command there is one that sticks and slips")


class _Newton:
    """Zero of a residual x - P(x), from a first derivative of P and Broyden's (good) updates of it."""

    def __init__(self, derivative: np.ndarray) -> None:
        self.derivative = derivative
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def next(self, x: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """Where the residual should vanish, now that it is known at ``x``."""
        slope = np.eye(x.size) - self.derivative
        if self._last is not None:
            dx = x - self._last[0]
            missed = residual - self._last[1] - slope @ dx
            slope += np.outer(missed, dx) / max(float(dx @ dx), 1e-300)
            self.derivative = np.eye(x.size) - slope
        self._last = x, residual
        try:
            result: np.ndarray = x - np.linalg.solve(slope, residual)
        except np.linalg.LinAlgError:
            raise NotPeriodic(NOT_FOUND) from None
        return result


def _intervals(period: PeriodMap) -> int:
    """Intervals of a period. An order k takes up k/(N - k) of what order N - k has, and torques have jumps.

    So many that this is a third at the end of the record's band, and a fiftieth at the driving lines that are looked for.
    """
    highest = PASSBAND * period.scenario.record.sample_rate / period.frequency
    return max(4 * math.ceil(highest), 50 * min(HARMONICS * period.microsteps, math.ceil(highest)))
