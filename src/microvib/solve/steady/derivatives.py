"""Derivatives of a steady state's lines with respect to the drive's parameters, from the solution that
was found.

A period maps the state x at its start to the state P(x, p) at its end and has the Fourier
coefficients c(x, p) of the disturbance torque, p being a parameter. In the steady state x = P(x, p),
and so

    dc/dp = c_p + c_x (I - P_x)^-1 P_p

All of it is had from differences of single periods: nothing settles, and nothing is searched again.
The period is integrated once with finer steps than the solution; those beside it take the same
steps and end them at the same events (``microvib.solve.replay``), so that they are smooth functions
of x and p, and one-sided differences with small steps are exact to about as much. Fourier
coefficients are integrated over each step, not made of samples.

**Where there is no derivative.** Lines have kinks where a friction just sticks or just does not
(grazing), and near them derivatives depend on the steps. So all parameters are changed together, once
up and once down by a hundred-thousandth, with finer steps: a period that chooses its steps itself,
from where the derivatives say that the changed drive repeats, must have the same events, and between
the two lines must go where the derivatives lead. Where they do not, the derivative is not given.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microvib.errors import SimulationError
from microvib.model.scenario import Scenario
from microvib.solve.steady.directions import Directions, Parameters, directions
from microvib.solve.steady.recorded import (
    KINK,
    NotDifferentiable,
    PeriodEnd,
    RecordedPeriod,
    output_offset,
)
from microvib.solve.steady.search import STICKING_STATES


@dataclass(frozen=True)
class Effort:
    """How differences are taken."""

    finer: int
    """Times by which steps are finer than those of the solution."""
    checked_finer: int
    """Times by which steps of the check are finer."""
    state_step: float
    """Step of a state, over what a microstep moves."""
    parameter_step: float
    """Step of a parameter, over itself."""
    both_ways: bool
    """Whether steps are taken up and down, so that what is curved does not count."""


COARSE = Effort(1, 1, 5e-6, 2e-6, both_ways=False)
QUICK = Effort(2, 3, 2e-6, 2e-6, both_ways=False)
THOROUGH = Effort(4, 5, 1e-5, 5e-6, both_ways=True)
NOTABLE, GOOD, MOST_OF_THEM = 1e-2, 2.5e-4, 0.9
"""Lines from NOTABLE of the largest must all be given, and MOST_OF_THEM disagree by no more than GOOD;
else more effort is made."""
MOST_CHANGED = 1e-3
"""Change of the logarithm of a notable line up to which it is looked whether lines follow."""
CHECKED, TOLERANCE = 1e-5, 2e-4
"""Part of themselves by which parameters change to see whether lines follow their derivatives with
other steps, and by how much they may not, over it and the largest relative derivative of the line (at
least 1)."""
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Multiples of it are spread evenly between whole numbers, however many there are."""
COARSE_TOLERANCE = 1e-2
"""Disagreement of what is checked by its own steps, up to which it is given."""
CLOSED, MAX_CLOSING_STEPS = 1e-10, 8
"""Gap of a period that counts as closed, over what a microstep moves, and corrections until then."""
SAME_STEPS = 2e-5
"""Way of the start, over what a microstep moves, within which steps and derivatives stay as good."""
COARSE_SAME_STEPS = 1e-3
"""Way of the start for derivatives that need be good to a hundredth."""
NOT_CLOSED = "with finer steps the period does not close about the motion that was found"


@dataclass(frozen=True)
class LineDerivatives:
    """Derivatives of the harmonics of a steady state by some parameters.

    Phases are those of cosines at the start of the period, on the step clock; with late parts of
    microsteps or compensation, where it would start without them.
    """

    keys: tuple[str, ...]
    """Parameters, (p,)."""
    values: np.ndarray
    """Their values [SI], (p,)."""
    orders: np.ndarray
    """Harmonics of the repetition frequency, (k,)."""
    amplitudes: np.ndarray
    """Complex amplitudes [N m], 0-to-peak, (k,)."""
    derivatives: np.ndarray
    """Derivatives of the complex amplitudes [N m per SI unit], (p, k); nan where there is none."""
    disagreement: np.ndarray
    """How far the lines are from where the derivatives lead when all parameters change by CHECKED of
    themselves and steps are finer, over that change and the line's largest relative derivative (at
    least 1), (p, k); infinite where other events occur."""

    @property
    def is_good(self) -> bool:
        """Whether all notable lines have their derivatives, and most go well where these lead."""
        size = np.abs(self.amplitudes)
        notable = size >= NOTABLE * np.max(size, initial=0.0)
        off = np.max(self.disagreement[:, notable], axis=0, initial=0.0)
        if np.any(np.isnan(self.derivatives[:, notable])):
            return False
        return not off.size or float(np.quantile(off, MOST_OF_THEM)) <= GOOD

    @property
    def relative(self) -> np.ndarray:
        """Relative changes of the complex amplitudes over those of the parameters, d ln c / d ln p,
        (p, k); the real part is that of the amplitude.
        """
        result: np.ndarray = self.derivatives * self.values[:, None] / self.amplitudes
        return result


def line_derivatives(
    scenario: Scenario,
    state: np.ndarray,
    microsteps: int,
    orders: np.ndarray,
    parameters: Parameters,
    coarse: bool = False,
) -> LineDerivatives:
    """Derivatives of the harmonics ``orders`` (k,) by some ``parameters``, about the steady ``state`` at
    the start of a period of ``microsteps``; ``coarse``, with the steps of the solution, and checked by
    these alone.

    Raises NotDifferentiable where the motion is none that repeats from its state alone, or is not
    closed by finer steps.
    """
    if scenario.has_memory:
        raise NotDifferentiable("friction with memory has no derivatives here")
    if coarse:
        return with_effort(COARSE, scenario, state, microsteps, orders, parameters)
    given = scenario, state, microsteps, orders, parameters
    quick = None
    with suppress(NotDifferentiable):
        quick = with_effort(QUICK, *given)
    if quick is not None and quick.is_good:
        return quick
    try:
        return with_effort(THOROUGH, *given)
    except NotDifferentiable:
        if quick is None:
            raise
        return quick


def with_effort(
    effort: Effort,
    scenario: Scenario,
    state: np.ndarray,
    microsteps: int,
    orders: np.ndarray,
    parameters: Parameters,
) -> LineDerivatives:
    """Derivatives by some effort."""
    period = RecordedPeriod.with_finer_steps(scenario, microsteps, orders, effort.finer)
    other, same_steps, tolerance = period, COARSE_SAME_STEPS, COARSE_TOLERANCE
    if effort.checked_finer != effort.finer:
        other = RecordedPeriod.with_finer_steps(scenario, microsteps, orders, effort.checked_finer)
        same_steps, tolerance = SAME_STEPS, TOLERANCE
    return _checked(about_closed(period, state, effort, same_steps), other, parameters, tolerance)


def _checked(
    about: _Differences, other: RecordedPeriod, parameters: Parameters, tolerance: float
) -> LineDerivatives:
    """Derivatives about a period that closes, checked by the steps of another recording, or by its
    own.
    """
    moved, total, chosen = about.by_parameters(parameters)
    known = np.all(np.isfinite(moved), axis=0)
    looked_at = [number for number in chosen if known[number]]
    off = np.zeros(about.harmonics.size)
    if looked_at:
        own = parameters.only(looked_at)
        off = about.disagreement(other, own, moved[:, looked_at], total[:, looked_at])
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.abs(total) / np.abs(about.harmonics)[:, None]
        largest = np.fmax(np.fmax.reduce(relative, axis=1, initial=1.0), 1.0)
        disagreement = np.where(known[:, None], off / largest, np.inf)
        derivatives = np.where(disagreement <= tolerance, (total / parameters.scales).T, np.nan)
    values = np.array([about.period.map.scenario[key] for key in parameters.keys])
    orders = about.period.orders
    return LineDerivatives(
        parameters.keys, values, orders, about.harmonics, derivatives, disagreement
    )


class _Differences:
    """Differences of a recorded period in each state that moves."""

    def __init__(self, period: RecordedPeriod, state: np.ndarray, effort: Effort) -> None:
        self.period, self.state, self.effort = period, state, effort
        self.sizes = period.map.sizes
        at_rest = STICKING_STATES[period.here.state[STICKING_STATES] == 0.0]
        self.moving = np.setdiff1d(np.arange(state.size), [*period.map.idle, *at_rest])
        self._differ(both_ways=False)

    def _differ(self, both_ways: bool) -> None:
        """Take differences about the start where it is now."""
        up = self._beside_in_each_state(self.effort.state_step)
        down = self._beside_in_each_state(-self.effort.state_step) if both_ways else []
        self._ends = self.period.here, up, down
        self._of_state = self._slopes_of_ends(*self._ends) / self.effort.state_step

    def _beside_in_each_state(self, step: float) -> list[PeriodEnd]:
        """Where the period leads with each state more by a step, over what a microstep moves."""
        return [self.period.beside(self.moved(step * x)) for x in np.eye(self.moving.size)]

    def _slopes_of_ends(
        self, here: PeriodEnd, up: list[PeriodEnd], down: list[PeriodEnd]
    ) -> np.ndarray:
        """Change of the end of a period, over what a microstep moves, by a step each, (n, ends); with the
        steps ``down``, half of what is between both.
        """
        if down:
            pairs = zip(up, down, strict=True)
            return np.column_stack([0.5 * self.gained(end, other) for end, other in pairs])
        return np.column_stack([self.gained(end, here) for end in up])

    def _slopes_of_harmonics(
        self, here: PeriodEnd, up: list[PeriodEnd], down: list[PeriodEnd]
    ) -> np.ndarray:
        """Change of the harmonics by the same steps, (k, ends)."""
        each = self.period.harmonics([here, *up, *down])
        above, below = each[:, 1 : len(up) + 1], each[:, len(up) + 1 :]
        result: np.ndarray = 0.5 * (above - below) if down else above - each[:, :1]
        return result

    @cached_property
    def harmonics(self) -> np.ndarray:
        """Harmonics of the period that closes, (k,)."""
        here: np.ndarray = self.period.harmonics([self.period.here])[:, 0]
        return here

    @cached_property
    def _of_harmonics(self) -> np.ndarray:
        """Their derivatives by each state that moves, (k, n)."""
        return self._slopes_of_harmonics(*self._ends) / self.effort.state_step

    def moved(self, by: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        """The start, or another one, moved; by what a microstep moves."""
        state = (self.state if start is None else start).copy()
        state[self.moving] += by * self.sizes[self.moving]
        return state

    def gained(self, end: PeriodEnd, before: PeriodEnd) -> np.ndarray:
        """Change of the end of the period from another one, over what a microstep moves."""
        result: np.ndarray = ((end.state - before.state) / self.sizes)[self.moving]
        return result

    def closing(self, gained: np.ndarray) -> np.ndarray:
        """Change of the start, over what a microstep moves, that makes up for what the end gains."""
        result: np.ndarray = np.linalg.solve(np.eye(self.moving.size) - self._of_state, gained)
        return result

    def close(self, same_steps: float) -> bool:
        """Move the start to where the recorded steps close the period; False where that is farther than
        is good for them, and then only there.
        """
        gap, by = self._gap(), np.zeros(self.moving.size)
        for _ in range(MAX_CLOSING_STEPS):
            change = self.closing(gap)
            by += change
            self.state = self.moved(change)
            if float(np.max(np.abs(by))) > same_steps:
                return False
            self.period.settle(self.state)
            gap = self._gap()
            if float(np.max(np.abs(gap))) < CLOSED:
                if self.effort.both_ways:
                    self._differ(both_ways=True)
                return True
        raise NotDifferentiable(NOT_CLOSED)

    def _gap(self) -> np.ndarray:
        """By how much the period does not close, over what a microstep moves."""
        result: np.ndarray = ((self.period.here.state - self.state) / self.sizes)[self.moving]
        return result

    def by_parameters(
        self, parameters: Parameters
    ) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
        """Derivatives by the parameters, over their scales: of the start that repeats, over what a
        microstep moves, (n, p), and of its harmonics, (k, p); nan where there is none. And the numbers of
        the parameters from whose changes those of all follow.
        """
        step = self.effort.parameter_step
        found = directions(self.period, parameters, step)
        gained = np.full((self.moving.size, len(found.chosen)), np.nan)
        own = np.full((self.harmonics.size, len(found.chosen)), np.nan, dtype=complex)
        are_shapes = parameters.are_shapes[list(found.chosen)]
        for some in (~are_shapes, are_shapes):
            if not np.any(some):
                continue
            if some is are_shapes:
                period = self.period.shaped(self.state)
            else:
                period = self.period
            numbers, up, down = [], [], []
            for number in np.flatnonzero(some).tolist():
                with suppress(SimulationError):  # other events: there is no derivative
                    ends = self._beside_in(found, number, parameters, period)
                    numbers.append(number)
                    up.append(ends[0])
                    down += ends[1:]
            if numbers:
                gained[:, numbers] = self._slopes_of_ends(period.here, up, down) / step
                own[:, numbers] = self._slopes_of_harmonics(period.here, up, down) / step
        moved = self.closing(found.combined(gained))
        total = found.combined(own) + self._of_harmonics @ moved
        return moved, total, found.chosen

    def _beside_in(
        self, found: Directions, number: int, parameters: Parameters, period: RecordedPeriod
    ) -> list[PeriodEnd]:
        """Where the period leads with the drive changed in a direction: up, and down where steps are
        taken both ways.
        """
        ends = [period.beside(self.state, found.periods[number])]
        if self.effort.both_ways:
            part = np.zeros(len(parameters.keys))
            part[found.chosen[number]] = -self.effort.parameter_step
            changed = parameters.changed(period.map.scenario, part)
            ends.append(period.beside(self.state, period.of(changed)))
        return ends

    def disagreement(
        self, other: RecordedPeriod, parameters: Parameters, moved: np.ndarray, total: np.ndarray
    ) -> np.ndarray:
        """How far logarithms of harmonics are from where the derivatives lead, with the steps of
        ``other``: between all parameters less by up to the part CHECKED of themselves, or more, and as
        much more, or less; over that part, (k,). Infinite where other events occur.
        """
        count = len(parameters.keys)
        signs = np.where(np.random.default_rng(count).random(count) < 0.5, -1.0, 1.0)
        # Sizes differ, too, so that errors of parameters that act alike do not cancel.
        ways = signs * (0.4 + 0.6 * (GOLDEN * np.arange(count) % 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = (total @ ways) / self.harmonics
        size = np.abs(self.harmonics)
        steepest = np.abs(expected[size >= NOTABLE * np.max(size)])
        part = min(CHECKED, MOST_CHANGED / float(np.max(steepest, initial=1.0)))
        try:
            state = self._closed_by(other)
            if np.any(parameters.are_shapes):
                other = other.shaped(state)
            above, below = (
                self._reached(
                    other,
                    parameters.changed(other.map.scenario, way),
                    self.moved(moved @ way, state),
                )
                for way in (part * ways, -part * ways)
            )
        except SimulationError:
            return np.full(self.harmonics.size, np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            off: np.ndarray = np.abs(np.log(above / below) / (2.0 * part) - expected)
        return off

    def _closed_by(self, other: RecordedPeriod) -> np.ndarray:
        """The start from which the steps of another recording close the period, but for what
        ``_reached`` makes up for.

        Raises NotDifferentiable where they have other events.
        """
        if other is self.period:
            return self.state
        end = other.record(self.state)
        if not self.period.has_events_of(other):
            raise NotDifferentiable(KINK)
        gap = ((end.state - self.state) / self.sizes)[self.moving]
        return self.moved(self.closing(gap))

    def _reached(self, other: RecordedPeriod, scenario: Scenario, start: np.ndarray) -> np.ndarray:
        """Harmonics of a changed scenario that repeat near a ``start``, with the steps of another
        recording, (k,).

        Raises SimulationError where other events occur.
        """
        period = other.of(scenario)
        if not other.has_same_events(start, period):
            raise NotDifferentiable(KINK)
        end = other.beside(start, period)
        left = self.closing(((end.state - start) / self.sizes)[self.moving])
        result: np.ndarray = other.harmonics([end])[:, 0] + self._of_harmonics @ left
        return result


def about_closed(
    period: RecordedPeriod, state: np.ndarray, effort: Effort, same_steps: float
) -> _Differences:
    """Differences about the state from which a period ends where it starts, near a ``state`` as
    ``PeriodMap`` has it.
    """
    state = state - output_offset(period.map)
    for _ in range(MAX_CLOSING_STEPS):
        period.record(state)
        about = _Differences(period, state, effort)
        with suppress(SimulationError):  # steps too short for their events to move so far
            if about.close(same_steps):
                return about
        state = about.state
    raise NotDifferentiable(NOT_CLOSED)
