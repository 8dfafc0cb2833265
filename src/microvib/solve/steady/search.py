"""Search for the motion that repeats with the command (multiple shooting), and checks of what was found.

The period (``microvib.solve.steady.period``) is cut into segments that run at the same time
(``microvib.solve.steady.segments``); sought are states at their starts such that each segment ends where the next one starts,
and the last where the first does. Quasi-Newton: the derivative of a segment is that of a part of the period, by differences, then
come Broyden's updates. What was found must be stable, and the only such motion as far as some further starts tell.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce
from itertools import pairwise

import numpy as np
from scipy.linalg import eig

from microvib.model.record import PASSBAND
from microvib.solve import kernel
from microvib.solve.steady.period import NotPeriodic, PeriodMap
from microvib.solve.steady.segments import Ends, Segments
from microvib.solve.vector import WIDTH

CLOSE = 1e-5
"""Distance from the steady state, over what a microstep moves, at which a state is accepted."""
AS_CLOSE_AS_IT_GETS = 5e-4
"""Distance at which one is accepted whose corrections fall no longer: the tolerance of the integration shows."""
CALMS = 0.07
"""Time [s] that is simulated before a search, so that fast motions settle, or MOST_SWEEPS segments if that is less."""
MOST_SWEEPS = 2
SAMPLED_FROM = 0.5
"""Distance below which the torque is sampled, for it may be the last."""
RENEWED_FROM = 2.0
"""Correction after which the derivatives are taken anew, for they were those of another motion."""
BELIEVED = 1e3
"""Correction above which the linearisation is not believed and a period is let pass instead."""
MOST_STEPS = 12
"""Corrections that a search may take; four or five are usual."""
STABLE = 1.005
"""Largest multiplier that passes for stable: that of a mode without damping is 1, and it is measured to a thousandth."""
FAR_FROM_STABLE = 10.0
"""Multiplier from which its figure means nothing."""
LONG = 200.0
"""Settling [s] that is too long for a run to show the motion, unless the modes' own damping is as slow."""
FED = 2.0
"""Settling, over that of the modes' own damping, from which friction feeds them."""
SLOW = 0.8
"""Multiplier from which a deviation's decay is measured over a whole period and not taken from the derivative."""
DEVIATION = 0.3
"""Deviation with which it is measured, over what a microstep moves."""
WINDINGS = np.array([-12.0, -8.0, -5.0, -3.0, -2.0, -1.0, 3.0, 6.0]) / 32.0
"""Full steps by which the output is wound forward of where it was found, to see whether it comes back."""
BACK = 0.1
"""Distance at which it is back."""
STICKING = np.array([kernel.WM, kernel.WL])
"""States that are zero exactly where a friction sticks."""
NUDGE = 0.03
"""Step of differences, over what a microstep moves: well above the solver's tolerance, below what changes the motion."""
CALMS_WITHIN = 4.0
"""Time [s] within which what was stopped must slip again without sticking."""
SHARES = np.array([1.0, 0.75, 0.5, 0.3, 0.15, 0.07, 0.03, 0.01])
"""Parts of the distance from what was found to a start from rest at which lanes begin, the last one for small deviations."""
PATIENCE = (4, 8, 16, 32)
"""Periods after which it is asked whether all are back or on their way; the last time for good."""
AS_SMALL_ONES = 1.3
"""Part of what small deviations would have left that a large one may be at."""
CAME_BACK = 0.02
"""Distance at which one is back."""
STILL_FALLS = 1.01
"""Part of itself that a small deviation may be at after twice as many periods: a mode without damping keeps its own."""
NOT_FOUND = "no motion was found that repeats with the command"
HARMONICS = 8
"""Driving lines whose amplitudes the sampling must not disturb; see ``_rows``."""


class NotShown(NotPeriodic):
    """A motion that repeats with the command was found, but a run need not show it: there are others, or it takes too long."""


class Search:
    """The search; its states ``x`` (segments, n) are those at the starts of all segments, in units of what a microstep moves."""

    def __init__(self, period: PeriodMap) -> None:
        self.period = period
        self.segments = Segments(period, _rows(period))

    def run(self, settle: int) -> Search:
        """Search from the mean motion, after ``settle`` periods of simulation; NotPeriodic where nothing is found."""
        x, self.distance = self._begin(settle), math.inf
        for step in range(MOST_STEPS):
            sampled = self.distance < SAMPLED_FROM
            self.x, self.ends = self._advance(x, sampled)
            if self.distance > RENEWED_FROM:
                self.newton = _Newton(self._derivatives(self.ends.x[-1]))
            x = self.newton.next(self.x, self.ends.x)
            last, self.distance = self.distance, float(np.max(np.abs(x - self.x)))
            falls = self.distance < last and step + 1 < MOST_STEPS
            if sampled and self.distance < (CLOSE if falls else AS_CLOSE_AS_IT_GETS):
                self._check_stable()
                self._check_settles()
                self._check_for_others()
                self._check_for_stick_slip()
                self._check_from_rest()
                return self
            if self.distance > BELIEVED:
                x = self._swept(self.ends.x, len(self.x))
        raise NotPeriodic(NOT_FOUND)

    def _begin(self, settle: int) -> np.ndarray:
        """States to start from: where some segments lead from the mean motion, or after periods of simulation."""
        period, bounds = self.period, self.segments.bounds
        start = period.guess()
        if settle == 0:
            states = np.tile(start / period.sizes, (bounds.size - 1, 1))
            segment = 1.0 / (period.frequency * len(states))
            return self._swept(states, min(math.ceil(CALMS / segment), MOST_SWEEPS))
        for _ in range(settle):  # the fast motions settle
            start = period.advance(start)
        chain = [start / period.sizes]
        for j in range(bounds.size - 2):
            chain.append(self._from(chain[-1][None], bounds[j : j + 1], bounds[j + 1 : j + 2]).x[0])
        return np.array(chain)

    def _swept(self, x: np.ndarray, times: int) -> np.ndarray:
        """States after simulating from each start to the next one, some times."""
        for _ in range(times):
            x = _shifted(self._advance(x)[1].x)
        return x

    def _derivatives(self, x: np.ndarray) -> np.ndarray:
        """Derivative of each segment's map, (segments, n, n).

        That of a sixteenth of the period, or of one microstep, by differences at ``x`` (n,), to the power of their number: the
        parts differ by the detent torque only.
        """
        part, moving = self.segments.part, np.setdiff1d(np.arange(x.size), self.period.idle)
        starts = np.vstack([x, x + NUDGE * np.eye(x.size)[moving]])
        nothing = np.zeros(len(starts), dtype=int)
        ends = self._from(starts, nothing, nothing + part)
        change = np.zeros((x.size, x.size))
        change[:, moving] = (ends.x[1:] - ends.x[0]).T / NUDGE
        change[:, STICKING] *= np.logical_not(ends.stuck[0])
        with np.errstate(over="ignore", invalid="ignore"):
            result = np.array([np.linalg.matrix_power(change, m // part) for m in np.diff(self.segments.bounds)])
        if not np.all(np.isfinite(result)):
            raise NotPeriodic("what repeats with the command is far from stable")
        return result

    def _from(self, x: np.ndarray, first: np.ndarray, last: np.ndarray, sampled: bool = False) -> Ends:
        """Segments from states (k, n) at microsteps ``first`` (k,) to the microsteps ``last``, both in units."""
        ends = self.segments.advance(x * self.period.sizes, first, last, sampled)
        return replace(ends, x=ends.x / self.period.sizes)

    def _advance(self, x: np.ndarray, sampled: bool = False) -> tuple[np.ndarray, Ends]:
        """The states as they were started, with the rates at zero of what sticks; their segments' ends."""
        bounds = self.segments.bounds
        ends = self._from(x, bounds[:-1], bounds[1:], sampled)
        x = x.copy()
        x[:, STICKING] *= ~_shifted(ends.stuck)
        return x, ends

    def _check_stable(self) -> None:
        self.multiplier = self._multiplier(self.newton.derivatives)
        if self.multiplier > STABLE:
            self.multiplier = self._multiplier(self._derivatives(self.x[0]))
        if self.multiplier > STABLE:
            far = "far from it" if self.multiplier > FAR_FROM_STABLE else f"multiplier {self.multiplier:.4g}"
            raise NotPeriodic(f"what repeats with the command is not stable ({far})")

    @property
    def settling(self) -> float:
        """Time [s] in which a small deviation falls to a hundredth; infinite where the multiplier is not below 1."""
        if self.multiplier >= 1.0:
            return math.inf
        return math.log(0.01) / math.log(max(self.multiplier, 1e-9)) / self.period.frequency

    def _check_settles(self) -> None:
        """A mode that friction feeds nearly as fast as it loses may ring for minutes: no run shows what it rings about."""
        rates = [m.damping * 2.0 * math.pi * m.frequency for m in self.period.scenario.array.modes]
        own = math.log(100.0) / max(min(rates, default=math.inf), 1e-9)
        if self.settling > max(LONG, FED * own):
            raise NotShown(
                f"friction that falls with the rate keeps it ringing: deviations take {self.settling:.3g} s to fall to a hundredth,"
                f" {own:.3g} s by the modes' own damping"
            )

    def _multiplier(self, derivatives: np.ndarray) -> float:
        """Largest part of a deviation that is left after a period, of slow ones measured along their directions, all at once."""
        values, left, right = eig(_product(derivatives), left=True)
        size = np.abs(values)
        slow = (size > SLOW) & (values.imag >= 0.0)
        if np.any(slow):
            along, seen = [right[:, slow]], [left[:, slow].conj().T]
            for derivative in derivatives[:-1]:
                along.append(derivative @ along[-1])
            for derivative in derivatives[::-1]:
                seen.insert(0, seen[0] @ derivative)
            off = np.array([v.real.sum(axis=1) for v in along])
            off *= DEVIATION / np.max(np.abs(off)) * (self.x != 0.0)  # what sticks stays
            x, ends = self._advance(self.x + off)
            for j in range(len(x)):
                size[slow] *= np.abs(seen[j + 1] @ (ends.x[j] - self.ends.x[j])) / np.abs(seen[j] @ (x[j] - self.x[j]))
        return float(np.max(size))

    def _check_for_others(self) -> None:
        """Wind the output back, and on, all lanes by different angles: what sticks and slips may do so in more than one way.

        Each must be back, or on its way, within a period. Array modes are held to what was found, for they take longer.
        """
        period, bounds, modes = self.period, self.segments.bounds, slice(kernel.MODES, None)
        if not np.any(self.ends.ever):
            return
        driver, turned = period.scenario.driver, math.copysign(1.0, period.scenario.rate or 0.0)
        x = np.tile(self.x[0], (WIDTH, 1))
        x[:, kernel.TM if period.packed.drive.rigid else kernel.TL] += (
            WINDINGS * turned * driver.beats / 4 * driver.microsteps
        )
        away = []
        for k in range(max(bounds.size - 1, WIDTH)):
            j = k % (bounds.size - 1)
            x = self._from(x, np.full(WIDTH, bounds[j]), np.full(WIDTH, bounds[j + 1])).x
            away.append(np.max(np.abs(x - self.ends.x[j])[:, : kernel.MODES], axis=1))
            if np.all(away[-1] < BACK):
                return
            x[:, modes] = self.ends.x[j, modes]
        if np.any(np.maximum(away[-1], away[-2]) > np.maximum(BACK, 0.7 * away[len(away) // 2 - 1])):
            raise NotShown(
                "of the motions that repeat with the command there are several; which one, its beginning decides"
            )

    def _check_for_stick_slip(self) -> None:
        """Stop what never sticks: where friction falls with the rate, an oscillation that sticks and slips may last beside it."""
        period, p = self.period, self.period.packed.drive
        falls = np.array([p.m_stribeck > 0.0, p.l_stribeck > 0.0])
        never = falls & np.logical_not(np.any(self.ends.ever, axis=0))
        if not np.any(never):
            return
        x = self.x[0] * period.sizes
        x[STICKING if p.rigid else STICKING[never]] = 0.0
        counters = period.packed.state.counters
        for _ in range(math.ceil(CALMS_WITHIN * period.frequency)):
            before = int(counters[kernel.STICKS])
            x = period.advance(x)
            if counters[kernel.STICKS] == before:
                return
        raise NotShown("beside the motion that repeats with the command there is one that sticks and slips")

    def _check_from_rest(self) -> None:
        """What a run shows is what a start from rest goes on to: the last witness, with starts on the way from there.

        One lane begins at rest with the command, the others at parts of its distance from what was found, the last so near that
        it tells whether and how small deviations fall. All must be back, or have fallen as these do: a mode may ring for long, but
        what stays where it is, or falls more slowly, goes on to another motion.
        """
        x = self.x[0] + SHARES[:, None] * (self._at_section_from_rest() - self.x[0])
        away = [self._distance(x)]
        for periods in range(1, PATIENCE[-1] + 1):
            x = self._period(x)
            away.append(self._distance(x))
            if periods in PATIENCE:
                expected = away[-1][-1] * SHARES / SHARES[-1]
                falls = away[-1][-1] <= max(STILL_FALLS * away[periods // 2][-1], SHARES[-1] * CAME_BACK)
                if falls and np.all(away[-1] <= np.maximum(AS_SMALL_ONES * expected, CAME_BACK)):
                    return
        raise NotShown("a start from rest does not go on to the motion that repeats with the command")

    def _at_section_from_rest(self) -> np.ndarray:
        """State at the end of the period, in units, of a drive that stood still until a run's first microstep."""
        state, first = self.period.at_rest()
        x = np.tile(state / self.period.sizes, (WIDTH, 1))
        for last in self.segments.bounds[self.segments.bounds > first].tolist():
            x = self._from(x, np.full(WIDTH, first), np.full(WIDTH, last)).x
            first = last
        end: np.ndarray = x[0]
        return end

    def _period(self, x: np.ndarray) -> np.ndarray:
        """States (k, n) after a period."""
        for first, last in pairwise(self.segments.bounds.tolist()):
            x = self._from(x, np.full(len(x), first), np.full(len(x), last)).x
        return x

    def _distance(self, x: np.ndarray) -> np.ndarray:
        """Distance of states (k, n) from what was found, (k,): root of the sum of squares.

        A mode's two states weigh by its energy, so that the phase in which it rings does not matter.
        """
        off, size = x - self.x[0], self.period.sizes
        Omega = np.array([2.0 * math.pi * mode.frequency for mode in self.period.scenario.array.modes])
        off[:, kernel.MODES :: 2] *= Omega * size[kernel.MODES :: 2] / size[kernel.MODES + 1 :: 2]
        distance: np.ndarray = np.sqrt(np.sum(off**2, axis=1))
        return distance


class _Newton:
    """Zero of what each segment's end misses the next one's start by: Newton's step with given derivatives, and Broyden's
    (good) updates of its inverse."""

    def __init__(self, derivatives: np.ndarray) -> None:
        self.derivatives = derivatives
        self._whole = np.eye(derivatives.shape[1]) - _product(derivatives)
        self._updates: list[tuple[np.ndarray, np.ndarray]] = []
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def next(self, x: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Where nothing should be missed, now that ``x`` (segments, n) is known to lead to ``end``."""
        change = self._change(end - np.concatenate([x[1:], x[:1]]))
        if self._last is not None:
            step, moved = x - self._last[0], self._last[1] - change
            along = float(np.vdot(step, moved))
            if along != 0.0:
                self._updates.append(((step - moved) / along, step))
                change += self._updates[-1][0] * np.vdot(step, change)
        self._last = x, change
        result: np.ndarray = x + change
        return result

    def _change(self, missed: np.ndarray) -> np.ndarray:
        """Change of the starts that makes good what is ``missed``."""
        after = np.zeros(missed.shape[1])
        for derivative, gap in zip(self.derivatives, missed, strict=True):
            after = derivative @ after + gap
        try:
            changes = [np.linalg.solve(self._whole, after)]
        except np.linalg.LinAlgError:
            raise NotPeriodic(NOT_FOUND) from None
        for derivative, gap in zip(self.derivatives[:-1], missed[:-1], strict=True):
            changes.append(derivative @ changes[-1] + gap)
        change = np.array(changes)
        for update, step in self._updates:
            change += update * np.vdot(step, change)
        return change


def _shifted(ends: np.ndarray) -> np.ndarray:
    """Ends of segments (segments, ...) in the order of the starts that they lead to."""
    return np.concatenate([ends[-1:], ends[:-1]])


def _product(derivatives: np.ndarray) -> np.ndarray:
    """Derivative of the whole period's map."""
    with np.errstate(over="ignore", invalid="ignore"):
        result: np.ndarray = reduce(lambda before, following: following @ before, derivatives)
    if not np.all(np.isfinite(result)):
        raise NotPeriodic(NOT_FOUND)
    return result


def _rows(period: PeriodMap) -> int:
    """Intervals of a microstep. Of n in a period an order k takes up k/(n - k) of what order n - k has, and torques have jumps.

    So many that this is a third at the end of the record's band, and a fiftieth at the driving lines that are looked for.
    """
    highest = math.ceil(PASSBAND * period.scenario.record.sample_rate / period.frequency)
    return math.ceil(max(4 * highest, 50 * min(HARMONICS * period.microsteps, highest)) / period.microsteps)
