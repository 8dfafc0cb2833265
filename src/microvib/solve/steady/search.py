"""Search for the motion that repeats with the command (multiple shooting), and checks of the motion
found.

**Unknown** are the states x_0 ... x_(k-1) of the drive at the starts of the k segments into which the period is cut
(``microvib.solve.steady.segments``), seen from the command and in units of what one microstep moves. **Solved** is that each
segment ends where the next one starts, and the last where the first does:

    P_j(x_j) = x_(j+1),    j = 0 ... k - 1,    x_k = x_0

with P_j the kernel's own integration over segment j. ``_Newton`` solves this with
derivatives from differences (``Search._derivatives``) and Broyden's updates.

A solution repeats with the command, but need not be what the drive does. Three **checks** stand
against one failure each:

- ``_check_stable``: an unstable motion solves the equations as well; the drive leaves it.
- ``_check_settles``: a stable motion that takes minutes to settle, because friction feeds an array mode, is not what a run shows.
- ``_check_from_rest``: beside the motion there may be others, such as slips that are long and short in turn or a mode that
  friction keeps ringing; a start from rest must lead to this one (``microvib.solve.steady.arrival``).
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from functools import reduce

import numpy as np

from microvib.model.linear import coupled_modes
from microvib.model.parametric import growth_over_angle
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.steady.arrival import PeriodicMotion, confirm_reached_from_rest
from microvib.solve.steady.from_rest import RingingTimes, RunFromRest, rms
from microvib.solve.steady.period import NotPeriodic, PeriodMap
from microvib.solve.steady.segments import MAX_SEGMENTS, SegmentEnds, Segments

CONVERGED = 1e-5
"""Last correction, over what a microstep moves, below which a state is accepted."""
CONVERGED_STALLED = 5e-4
"""Convergence bound where corrections have stopped falling, limited by the tolerance of the integration."""
TORQUE_STALLED = 0.01
"""Change of the torque from one correction to the next, over its RMS, up to which such a state is accepted.
A smooth drive has a torque so small that a correction which is small beside a microstep still changes it.
"""
WARM_UP = 0.07
"""Time [s] simulated before a search, for fast motions to settle, or MAX_SWEEPS segments if that is
less.
"""
MAX_SWEEPS = 2
SAMPLED_BELOW = 0.5
"""Correction below which the torque is sampled: the next evaluation may be the last."""
RENEW_ABOVE = 2.0
"""Correction above which derivatives are computed again: those at hand belong to another motion."""
MAX_CORRECTION = 1e3
"""Correction above which the linearisation is not trusted; a period is simulated instead."""
MAX_STEPS = 12
"""Corrections that a search may take; four or five are usual."""
MAX_STABLE_MULTIPLIER = 1.005
"""Multiplier above which a motion is unstable for certain: an undamped mode has 1, and multipliers
of drives that slip are measured to a thousandth. One between 1 and this does not settle
(``Search._check_settles``).
"""
MAX_REPORTED_MULTIPLIER = 10.0
"""Multiplier above which its value is not given, since it means nothing."""
MAX_SETTLING = 200.0
"""Settling time [s] too long for a run to show the motion, unless the modes' own damping is as
slow.
"""
SETTLING_RATIO = 2.0
"""Settling time, over that by the modes' own damping, above which friction feeds the modes."""
SLOW_MULTIPLIER = 0.8
"""Multiplier above which a deviation decays slowly."""
LEAST_SIMULATED_MULTIPLIER = 0.3
"""Multiplier by the rough derivatives from which what is left of a deviation is simulated: what
decays faster cannot be kept up by the varying stiffness of a motor.
"""
DEVIATION = 0.3
"""Deviation with which that is done, over what a microstep moves."""
LEAST_PART_OF_DECAY = 0.7
"""Part of the slowest mode's own decay below which something feeds a mode: then all derivatives
are computed.
"""
DOUBTED_MULTIPLIER = 0.99
"""Multiplier above which that is done in any case: by slow shapes it may be wrong by 0.004."""
FROM_REST = 4, 20
"""Periods after a start from rest from which a single segment is searched: few, and more where that
leads nowhere.
"""
STICKING_STATES = np.array([kernel.WM, kernel.WL])
"""States that are exactly zero while a friction sticks."""
DIFFERENCE_STEP = 0.03
"""Step of the differences, over what a microstep moves: well above the solver's tolerance, below
what changes the motion.
"""
NOT_FOUND = "no periodic steady state was found"
HARMONICS = 8
"""Driving lines whose amplitudes the sampling must not disturb; see ``sample_rows``."""

FASTEST_MODES = 12.0
"""Times the drive's fastest natural frequency up to which the sampling must not disturb a line."""
MAX_PERIOD_SAMPLES = 2_000_000
"""Samples of a period beyond which driving lines are disturbed up to a third."""


class NotReproducedByRun(NotPeriodic):
    """A motion that repeats with the command was found, but a run need not show it: there are
    others, or it takes too long.
    """


class Search:
    """The search; ``x`` (segments, n) are the states at the starts of all segments, in units of
    what a microstep moves.
    """

    ends: SegmentEnds

    def __init__(
        self, period: PeriodMap, confirmed: bool = False, segments: int = MAX_SEGMENTS
    ) -> None:
        self.period, self.confirmed = period, confirmed
        self.segments, self.rows = Segments(period, segments), sample_rows(period)
        self.newton: _Newton | None = None

    def run(self, warm_up: int) -> Search:
        """Search from the mean motion, after ``warm_up`` periods of simulation; NotPeriodic where
        nothing is found, or nothing that a start from rest leads to.
        """
        self._converge(self._begin(warm_up))
        self._check_from_rest()
        return self

    def find(self) -> Search:
        """Search from where a start from rest is after a few periods for a motion that repeats, is
        stable and settles; NotPeriodic where nothing is found. The period is one segment here.

        Of motions that exist beside each other this is mostly the one that a run shows, but nobody
        asks.
        """
        for periods in FROM_REST:
            run, self.newton = RunFromRest(self.period), None
            run.begin()
            run.advance(periods * self.period.microsteps)
            self.from_rest = run.simulated
            self.period.evaluations += run.simulated * self.period.frequency
            with suppress(NotPeriodic):
                self._converge(run.seen()[None] / self.period.sizes)
                return self
        raise NotPeriodic(NOT_FOUND)

    def follow(self, state: np.ndarray, derivatives: np.ndarray) -> Search:
        """Search for such a motion from the ``state`` (n,) at the start of the period of a drive that is hardly another,
        and its ``derivatives`` (1, n, n). The period is one segment here.
        """
        self.from_rest, self.newton = 0.0, _Newton(derivatives)
        self._converge(state[None] / self.period.sizes)
        return self

    def _converge(self, x: np.ndarray) -> None:
        """Search from states (segments, n) for a motion that repeats, is stable and settles."""
        self.distance = math.inf
        for step in range(MAX_STEPS):
            sampled = self.distance < SAMPLED_BELOW
            before = self.ends.T_d if step and sampled else np.zeros(0)
            self.x, self.ends = self._advance(x, self.rows if sampled else 0)
            if self.newton is None or (step and self.distance > RENEW_ABOVE):
                self.newton = _Newton(self._derivatives(self.ends.x[-1]))
            x = self.newton.next(self.x, self.ends.x)
            last, self.distance = self.distance, float(np.max(np.abs(x - self.x)))
            falls = self.distance < last and step + 1 < MAX_STEPS
            if sampled and self._has_converged(falls, before):
                self._check_stable()
                self._check_settles()
                return
            if self.distance > MAX_CORRECTION:
                x = self._swept(self.ends.x, len(self.x))
        raise NotPeriodic(NOT_FOUND)

    def _has_converged(self, falls: bool, before: np.ndarray) -> bool:
        """Whether the last correction is small: where corrections no longer fall, small enough not to
        change the torque from that ``before`` it.
        """
        if self.distance < CONVERGED:
            return True
        if falls or self.distance >= CONVERGED_STALLED:
            return False
        return _is_alike(self.ends.T_d, before)

    def _begin(self, warm_up: int) -> np.ndarray:
        """States to start from, from the mean motion (``PeriodMap.guess``).

        Fast motions must have settled: with ``warm_up`` whole periods they are simulated one after
        the other; without, each segment starts from the mean motion and is simulated for WARM_UP,
        all at the same time.
        """
        period, bounds = self.period, self.segments.bounds
        start = period.guess()
        if warm_up == 0:
            states = np.tile(start / period.sizes, (bounds.size - 1, 1))
            segment = 1.0 / (period.frequency * len(states))
            return self._swept(states, min(math.ceil(WARM_UP / segment), MAX_SWEEPS))
        for _ in range(warm_up):
            start = period.advance(start)
        chain = [start / period.sizes]
        for j in range(bounds.size - 2):
            chain.append(self._from(chain[-1][None], bounds[j : j + 1], bounds[j + 1 : j + 2]).x[0])
        return np.array(chain)

    def _swept(self, x: np.ndarray, times: int) -> np.ndarray:
        """States after simulating from each start to the next, ``times`` over."""
        for _ in range(times):
            x = _shifted(self._advance(x)[1].x)
        return x

    def _derivatives(self, x: np.ndarray) -> np.ndarray:
        """Derivative of each segment's map, (segments, n, n).

        Only a sixteenth of the period, or one microstep if that is more, is differentiated, by
        differences at ``x`` (n,) in each state; a segment of m such parts has the m-th power. The
        parts differ only by the detent torque, which Broyden's updates correct. The rate of a body
        that sticks at the end of a part has no influence, nor do ``idle`` states.
        """
        part, moving = self.segments.part, np.setdiff1d(np.arange(x.size), self.period.idle)
        starts = np.vstack([x, x + DIFFERENCE_STEP * np.eye(x.size)[moving]])
        nothing = np.zeros(len(starts), dtype=int)
        ends = self._from(starts, nothing, nothing + part)
        change = np.zeros((x.size, x.size))
        change[:, moving] = (ends.x[1:] - ends.x[0]).T / DIFFERENCE_STEP
        change[:, STICKING_STATES] *= np.logical_not(ends.stuck[0])
        with np.errstate(over="ignore", invalid="ignore"):
            result = np.array(
                [np.linalg.matrix_power(change, m // part) for m in np.diff(self.segments.bounds)]
            )
        if not np.all(np.isfinite(result)):
            raise NotPeriodic("the periodic motion is strongly unstable")
        return result

    def _from(
        self, x: np.ndarray, first: np.ndarray, last: np.ndarray, rows: int = 0
    ) -> SegmentEnds:
        """Segments from states (k, n) at the microsteps ``first`` (k,) to the microsteps ``last``;
        states in units here.
        """
        ends = self.segments.advance(x * self.period.sizes, first, last, rows)
        return replace(ends, x=ends.x / self.period.sizes)

    def _advance(self, x: np.ndarray, rows: int = 0) -> tuple[np.ndarray, SegmentEnds]:
        """The states as started, with the rates of what sticks at zero, and the ends of their
        segments.
        """
        bounds = self.segments.bounds
        ends = self._from(x, bounds[:-1], bounds[1:], rows)
        x = x.copy()
        x[:, STICKING_STATES] *= ~_shifted(ends.stuck)
        return x, ends

    def _check_stable(self) -> None:
        """Against unstable motions: no deviation may grow from period to period.

        Where a mode decays about as its own damping has it, what the search knows of its shape
        suffices; else all is differentiated anew, at the solution.
        """
        assert self.newton is not None
        self.multiplier = self._multiplier_of_slow_shapes(self.newton.derivatives)
        own = RingingTimes(self.period.scenario).decay / self.period.frequency
        if not self.multiplier < min(math.exp(-LEAST_PART_OF_DECAY * own), DOUBTED_MULTIPLIER):
            self.multiplier = self._multiplier(self._derivatives_of_solution())
        if self.multiplier > MAX_STABLE_MULTIPLIER:
            if self.multiplier > MAX_REPORTED_MULTIPLIER:
                far = "far from it"
            else:
                far = f"multiplier {self.multiplier:.4g}"
            raise NotPeriodic(f"the motion that repeats with the command is not stable ({far})")

    @property
    def settling(self) -> float:
        """Time [s] in which a small deviation falls to a hundredth; infinite where the multiplier
        is not below 1.
        """
        if self.multiplier >= 1.0:
            return math.inf
        return math.log(0.01) / math.log(max(self.multiplier, 1e-9)) / self.period.frequency

    def _check_settles(self) -> None:
        """Against motions that no run reaches: a mode that something feeds nearly as fast as damping
        drains it rings for minutes, or for good.
        """
        scenario = self.period.scenario
        decays = (*scenario.load.decay, scenario.driver.slow_decay(scenario.motor))
        own = math.log(100.0) / max(min(decays), 1e-9)
        if self.settling <= max(MAX_SETTLING, SETTLING_RATIO * own):
            return
        cause = _cause_of_ringing(scenario)
        if math.isinf(self.settling):
            raise NotReproducedByRun(f"{cause}: deviations do not die out")
        by_modes = f", {own:.3g} s by the modes' own damping" if own > 0.0 else ""
        raise NotReproducedByRun(
            f"{cause}: deviations take {self.settling:.3g} s to fall to a hundredth{by_modes}"
        )

    def _derivatives_of_solution(self) -> np.ndarray:
        """Derivative of each segment's map at the solution, (segments, n, n), by differences at the
        segment's own start.

        Powers of one part's derivative, which suffice for a search, leave out that detent torque
        and flux harmonics change the motor's stiffness over the period: by this a mode may grow that
        has half the frequency of the full steps (parametric resonance). The rate of a body that
        sticks at a start has no influence, nor do ``idle`` states.
        """
        bounds, (count, n) = self.segments.bounds, self.x.shape
        moving = np.setdiff1d(np.arange(n), self.period.idle)
        steps = DIFFERENCE_STEP * np.eye(n)[moving]
        starts = (self.x[:, None] + steps).reshape(-1, n)
        ends = self._from(
            starts, np.repeat(bounds[:-1], moving.size), np.repeat(bounds[1:], moving.size)
        )
        gained = ends.x.reshape(count, moving.size, n) - self.ends.x[:, None]
        result = np.zeros((count, n, n))
        result[:, :, moving] = np.swapaxes(gained, 1, 2) / DIFFERENCE_STEP
        result[:, :, STICKING_STATES] *= ~_shifted(self.ends.stuck)[:, None, :]
        return result

    def _multiplier_of_slow_shapes(self, derivatives: np.ndarray) -> float:
        """Largest part of a deviation that is left after a period, by deviations along shapes that
        decay slowly by rough ``derivatives``.

        These are powers of one part's, too coarse near 1 and blind to what changes over the period.
        Deviations along their right eigenvectors, real and imaginary parts by themselves, are
        therefore simulated in all segments, and the left eigenvectors read off what becomes of
        them: the product of these small matrices has the multipliers. Beside a direction that grows by
        many powers of ten others vanish; then nothing is known, and the multiplier is infinite.
        """
        from scipy.linalg import eig  # slow to import, and runs from rest need none of it

        values, left, right = eig(_product(derivatives), left=True)
        size = np.abs(values)
        told = (size > LEAST_SIMULATED_MULTIPLIER) & (values.imag >= 0.0)
        self._fast = float(np.max(size[size <= LEAST_SIMULATED_MULTIPLIER], initial=0.0))
        self._slow, self.slow_multipliers = np.zeros((0, size.size)), values[:0]
        if not np.any(told):
            return self._fast
        shapes, readings = _real_columns(right[:, told]), _real_columns(left[:, told])
        along, seen = [shapes], [readings.T]
        for derivative in derivatives[:-1]:
            along.append(derivative @ along[-1])
        for derivative in derivatives[::-1]:
            seen.insert(0, seen[0] @ derivative)
        try:
            with np.errstate(all="ignore"):
                found = self._reduced(np.array(along), [*seen[:-1], readings.T])
        except np.linalg.LinAlgError:
            return math.inf
        if not np.all(np.isfinite(found)):
            return math.inf
        multipliers, by_shape = np.linalg.eig(found.T)
        self._keep(multipliers, by_shape.T @ np.linalg.solve(readings.T @ shapes, readings.T))
        return float(np.max(np.abs(multipliers)))

    def _reduced(self, along: np.ndarray, seen: list[np.ndarray]) -> np.ndarray:
        """The period's map in coordinates of the deviations ``along`` (segments, n, m) of the starts
        of its segments, which ``seen`` (m, n) at each start and at the end read off, (m, m).
        """
        bounds, (count, n) = self.segments.bounds, self.x.shape
        m = along.shape[2]
        moved = self.x[:, :, None] != 0.0  # what sticks stays at rest
        step = DEVIATION / np.max(np.abs(along * moved), axis=1)
        starts = self.x[:, None] + np.swapaxes(along * moved * step[:, None], 1, 2)
        ends = self._from(
            starts.reshape(-1, n), np.repeat(bounds[:-1], m), np.repeat(bounds[1:], m)
        )
        gained = np.swapaxes(ends.x.reshape(count, m, n) - self.ends.x[:, None], 1, 2)
        result, following = np.eye(m), [*along[1:], along[0]]
        for j in range(count):
            unit = seen[j + 1] @ following[j]
            result = np.linalg.solve(unit, seen[j + 1] @ (gained[j] / step[j])) @ result
        return result

    def _keep(self, multipliers: np.ndarray, left: np.ndarray) -> None:
        """Keep what decays slowly: its left eigenvectors (m, n) as ``_slow``, its multipliers as
        ``slow_multipliers``; and the largest multiplier of all else as ``_fast``.
        """
        size = np.abs(multipliers)
        slow = (size > SLOW_MULTIPLIER) & (multipliers.imag >= 0.0)
        self._slow, self.slow_multipliers = left[slow], multipliers[slow]
        rest = float(np.max(size[size <= SLOW_MULTIPLIER], initial=0.0))
        self._fast = max(self._fast, rest)

    def _multiplier(self, derivatives: np.ndarray) -> float:
        """Largest part of a deviation that is left after a period, by the ``derivatives`` of its
        segments at the solution.
        """
        from scipy.linalg import eig

        values, left, right = eig(_product(derivatives), left=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            rows = (left / np.sum(left * right.conj(), axis=0)).conj().T
        self._fast = 0.0
        self._keep(values, rows)
        return float(np.max(np.abs(values)))

    def _check_from_rest(self) -> None:
        """Against all else: the motion that a run shows is the one that a start from rest leads to."""
        period, bounds = self.period, self.segments.bounds
        run = RunFromRest(period)
        T_d = self.segments.advance(self.x * period.sizes, bounds[:-1], bounds[1:], run.rows).T_d
        decay, fast = (
            -math.log(max(x, 1e-9)) * period.frequency for x in (self.multiplier, self._fast)
        )
        found = PeriodicMotion(
            self.x[0] * period.sizes, T_d, decay, self._slow / period.sizes, fast
        )
        confirm_reached_from_rest(run, found, waited=self.confirmed)
        self.from_rest = run.simulated
        period.evaluations += run.simulated * period.frequency


def _is_alike(T_d: np.ndarray, before: np.ndarray) -> bool:
    """Whether a torque (n,) is that of the state ``before`` the correction; False where that was not
    sampled.
    """
    if before.size != T_d.size:
        return False
    return rms(T_d - before) <= TORQUE_STALLED * rms(T_d)


class _Newton:
    """Quasi-Newton for the gaps g_j = P_j(x_j) - x_(j+1): Newton's step with given derivatives D_j,
    then Broyden's updates.

    Newton's step d solves d_(j+1) = D_j d_j + g_j. Run through the period, this leaves a system of
    the size of one state,

        (I - D_(k-1) ... D_0) d_0 = g_(k-1) + D_(k-1) g_(k-2) + ... + D_(k-1) ... D_1 g_0

    and the other d_j follow by recursion. Broyden's "good" updates correct the inverse of the whole
    system by rank one from each step and the change of the gaps that it made; they are kept as
    pairs of vectors and applied in turn.
    """

    def __init__(self, derivatives: np.ndarray) -> None:
        self.derivatives = derivatives
        self._whole = np.eye(derivatives.shape[1]) - _product(derivatives)
        self._updates: list[tuple[np.ndarray, np.ndarray]] = []
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def next(self, x: np.ndarray, end: np.ndarray) -> np.ndarray:
        """The next states, now that ``x`` (segments, n) is known to lead to ``end``."""
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
        """Change of the starts that closes the gaps ``missed``."""
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


def _real_columns(vectors: np.ndarray) -> np.ndarray:
    """Real columns that span the same as complex ones (n, m) and their conjugates."""
    imaginary = vectors.imag[:, np.any(vectors.imag != 0.0, axis=0)]
    return np.hstack([vectors.real, imaginary])


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


def _cause_of_ringing(scenario: Scenario) -> str:
    """Possible cause that feeds a mode of a drive, as the beginning of a sentence."""
    motor, friction = scenario.motor, scenario.friction
    if max(motor.friction.stribeck_torque, friction.stribeck_torque) > 0.0:
        return "negative friction slope (Stribeck effect) sustains the ringing"
    if motor.stiffness_orders:
        return (
            "the motor's stiffness, which detent torque or flux harmonics vary over each full step,"
            " sustains the ringing of a mode (parametric resonance)"
        )
    if fed := growth_over_angle(scenario):
        key = max(fed, key=lambda one: one.rate).what
        return f"{key} sustains the ringing of a mode (parametric resonance)"
    return "ringing is hardly damped"


def sample_rows(period: PeriodMap) -> int:
    """Sample intervals in one microstep.

    With n interval means in a period, k/(n - k) of order n - k is aliased into order k, and torques
    have jumps. This makes n so large that the fraction is at most a third at the end of the
    record's band, and a fiftieth at the driving lines. Below these the drive may swing with far larger
    amplitudes, whatever the record's band is: intervals are short against its fastest mode.
    """
    fastest = max(mode.frequency for mode in coupled_modes(period.scenario))
    band = max(PASSBAND * period.scenario.record.sample_rate, FASTEST_MODES * fastest)
    highest = math.ceil(band / period.frequency)
    wanted = min(50 * min(HARMONICS * period.microsteps, highest), MAX_PERIOD_SAMPLES)
    rows = math.ceil(max(4 * highest, wanted) / period.microsteps)
    return period.parts * math.ceil(rows / period.parts)
