"""95 % intervals: linearised where the cost confirms them, otherwise from the profile of the cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from microvib.studies.identify.problem import Problem, cost
from microvib.studies.identify.search import (
    COARSE_COST_TOLERANCE,
    RESTART_STEPS,
    Descent,
    LinearModel,
    Optimum,
    as_run,
)

Z_95 = 1.959964
"""Standard errors to either side of an interval of 95 %."""
MAX_PROFILE_DEVIATION = 0.1
"""How far the profile may be off the linearised one, relatively, to confirm it."""
BOUND_TOLERANCE = 0.05
"""How well an end of an interval is found on the profile, relatively."""
MAX_PREDICTOR_STEPS, PREDICTOR_TOLERANCE = 3, 0.02
"""Steps with the optimum's slopes towards a point of the profile; how far they may have left to go,
relatively, to be there.
"""
OPEN_INTERVAL_RATIO = 4.0
"""Times of the way to an end of a range, from which a linearised interval reaches there if the
profile is low at that end.
"""
MAX_POINTS = 10
"""Points of a profile to one side, at most."""


@dataclass(frozen=True)
class Interval:
    """The 95 % interval of one coordinate."""

    low: float
    high: float
    open_low: bool = False
    """Whether the cost does not rise enough up to the bound."""
    open_high: bool = False
    profiled: bool = False
    """Whether it comes from the profile, because the linearised one was not confirmed."""


class Profiles(NamedTuple):
    """Intervals of all parameters, and the best that was met on the way."""

    intervals: tuple[Interval, ...]
    best: Optimum


def profiles(problem: Problem, best: Optimum, local: LinearModel) -> Profiles:
    """Interval of each parameter. The profile: its cost at the best values of all others.

    The linearised interval counts where the profile agrees with it half way and at its end, on both
    sides. Otherwise the ends are where the profile has risen as far as a 95 % interval requires.
    """
    problem.best_so_far.stage, near = "intervals", local.near(problem)
    ends, bounds = _sides(near, best, local)
    if near is not problem and not _are_those_of_runs(problem, ends, bounds):
        near = problem
        ends, bounds = _sides(near, best, local)
    met = min((end.met for end in ends), key=lambda o: o.cost)
    if met is not best:
        met = as_run(problem, near, met)
    return Profiles(
        tuple(_combine_sides(x, *bounds[2 * k : 2 * k + 2]) for k, x in enumerate(best.x)), met
    )


def _sides(
    problem: Problem, best: Optimum, local: LinearModel
) -> tuple[list[_Side], list[_IntervalBound]]:
    """Profiles to both sides of each parameter, and how far its interval reaches there."""
    ends = [
        _Side(problem, best, local, k, sign) for k in range(best.x.size) for sign in (-1.0, 1.0)
    ]
    _evaluate_predictors(problem, ends)
    return ends, problem.in_threads(_Side.run, ends)


def _are_those_of_runs(
    problem: Problem, ends: Sequence[_Side], bounds: Sequence[_IntervalBound]
) -> bool:
    """Whether a run at each end of an interval has the height that its steady state has there."""
    at = [
        end.known[bound.linear if bound.confirmed else bound.reach]
        for end, bound in zip(ends, bounds, strict=True)
    ]
    runs = problem.residuals([x for _, x in at])
    return all(
        abs(end.rise(cost(r)) - height) <= MAX_PROFILE_DEVIATION * max(height, Z_95)
        for end, (height, _), r in zip(ends, at, runs, strict=True)
    )


class _IntervalBound(NamedTuple):
    """How far one side of an interval reaches."""

    reach: float
    linear: float
    open: bool = False
    confirmed: bool = False


def _combine_sides(x: float, below: _IntervalBound, above: _IntervalBound) -> Interval:
    if below.confirmed and above.confirmed:
        return Interval(x - below.linear, x + above.linear)
    return Interval(x - below.reach, x + above.reach, below.open, above.open, True)


class _Side:
    """The profile of one parameter to one side."""

    def __init__(
        self, problem: Problem, best: Optimum, local: LinearModel, k: int, sign: float
    ) -> None:
        self.problem, self.best, self.local, self.k, self.sign = problem, best, local, k, sign
        self.linear = Z_95 * float(local.spread[k])
        if sign > 0.0:
            end = problem.high[k]
        else:
            end = problem.low[k]
        self.far = abs(float(end - best.x[k]))
        self.met = best
        self.known = {0.0: (0.0, best.x)}

    @property
    def checked(self) -> tuple[float, ...]:
        """Distances at which the profile is compared with the linearised one."""
        if self.linear <= self.far:
            return (0.5 * self.linear, self.linear)
        return ()

    def run(self) -> _IntervalBound:
        if self.linear > OPEN_INTERVAL_RATIO * self.far and self.height(self.far) < Z_95:
            return _IntervalBound(self.far, self.linear, True)
        off = [abs(self.height(t) / (Z_95 * t / self.linear) - 1.0) for t in self.checked]
        if off and max(off) < MAX_PROFILE_DEVIATION:
            return _IntervalBound(self.linear, self.linear, confirmed=True)
        reach, is_open = self._crossing()
        return _IntervalBound(reach, self.linear, is_open)

    def _crossing(self) -> tuple[float, bool]:
        """The least distance known at which the profile is as high as Z, by secants outwards from
        where it is lower.
        """
        for _ in range(MAX_POINTS):
            t = self._next()
            if t is None:
                break
            self.height(t)
        reach = self._inside()
        found, outside = (
            self.known[reach][0] > Z_95 * (1.0 - BOUND_TOLERANCE),
            [t for t in self.known if t > reach],
        )
        closed = found or bool(outside)
        if outside and self.known[reach][0] < Z_95 * (1.0 - BOUND_TOLERANCE):
            reach = min(outside)  # not found closely: rather too wide
        return reach, not closed or reach >= self.far

    def _inside(self) -> float:
        """The farthest known distance before which the profile is nowhere too high: what lies
        beyond is another basin.
        """
        too_high = min(
            (t for t, (h, _) in self.known.items() if h >= Z_95 * (1.0 + BOUND_TOLERANCE)),
            default=np.inf,
        )
        return max(t for t in self.known if t < too_high)

    def _next(self) -> float | None:
        """The next distance to look at; None where the end is found."""
        inside = self._inside()
        outside = min((t for t in self.known if t > inside), default=None)
        height = self.known[inside][0]
        if (
            height > Z_95 * (1.0 - BOUND_TOLERANCE)
            or inside >= self.far
            or (outside is not None and outside < 1.02 * inside)
        ):
            return None
        if outside is None:
            if inside > 0.0:
                step = inside * min(max(1.05 * Z_95 / max(height, 1e-9), 1.2), 4.0)
            else:
                step = self.linear
            return min(step, self.far)
        top = self.known[outside][0]
        part = min(max((Z_95 - height) / max(top - height, 1e-9), 0.1), 0.9)
        return inside + (0.5 if top > 2.0 * Z_95 else part) * (outside - inside)

    def height(self, t: float) -> float:
        """Square root of the rise of the cost at distance ``t``, over the scatter: Z at the end of
        a 95 % interval.
        """
        if t not in self.known:
            start, free = self.start(t), np.arange(self.best.x.size) != self.k
            if np.any(free):
                self.note(
                    t,
                    Descent(self.problem, start, free, J=self.local.J[:, free]).run(
                        RESTART_STEPS, COARSE_COST_TOLERANCE
                    ),
                )
            else:
                r = self.problem.residuals([start])[0]
                self.note(t, Optimum(start, r, cost(r)))
        return self.known[t][0]

    def start(self, t: float) -> np.ndarray:
        """Where the linearised model has the profile's point at distance ``t``, seen from the
        nearest that is known.
        """
        problem, k = self.problem, self.k
        near = min(self.known, key=lambda s: abs(s - t))
        along = self.sign * self.local.covariance[:, k] / self.local.covariance[k, k]
        start = np.clip(self.known[near][1] + (t - near) * along, problem.low, problem.high)
        start[k] = np.clip(self.best.x[k] + self.sign * t, problem.low[k], problem.high[k])
        return start

    def note(self, t: float, found: Optimum) -> None:
        """A point of the profile."""
        self.met = min(self.met, found, key=lambda o: o.cost)
        self.known[t] = (self.rise(found.cost), found.x)

    def rise(self, c: float) -> float:
        """Height of a cost."""
        return float(np.sqrt(max(c - self.best.cost, 0.0) / self.local.scatter))


def _evaluate_predictors(problem: Problem, sides: list[_Side]) -> None:
    """Points that check the linearised intervals, all at once, by steps with the optimum's own
    slopes.

    A step costs one simulation, an eighth of what new slopes cost. Points that are not there after
    a few, or not as high as the linearised model says, are left to ``_Side``: there the optimum's
    slopes may not hold.
    """
    open_points = [(side, t, side.start(t)) for side in sides for t in side.checked]
    for _ in range(MAX_PREDICTOR_STEPS):
        left, found = [], problem.residuals([x for _, _, x in open_points])
        for (side, t, x), r in zip(open_points, found, strict=True):
            free = np.flatnonzero(np.arange(x.size) != side.k)
            J = side.local.J[:, free]
            move = -np.linalg.lstsq(J, r, rcond=None)[0]
            here, there = side.rise(cost(r)), side.rise(cost(r) - float(np.sum((J @ move) ** 2)))
            linear = Z_95 * t / side.linear
            if here - there < PREDICTOR_TOLERANCE * linear:
                if abs(here - linear) < MAX_PROFILE_DEVIATION * linear:
                    side.note(t, Optimum(x, r, cost(r)))
            else:
                x = x.copy()
                x[free] = np.clip(x[free] + move, problem.low[free], problem.high[free])
                left.append((side, t, x))
        open_points = left
