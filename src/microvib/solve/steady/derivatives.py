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
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from microvib.errors import MicrovibError, SimulationError
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.pack import Replayed
from microvib.solve.replay import FREQUENCY, GAINED, MOMENTUM, N_SPAN, START
from microvib.solve.sampling import step_buffer
from microvib.solve.steady.period import PeriodMap, search_error
from microvib.solve.steady.search import STICKING_STATES

FINER, CHECKED_FINER = 3, 4
"""Times by which steps are finer than those of the solution: for the derivatives, and for their check."""
SETTLED, FINE = 1e-12, 1e-10
"""Accuracies of replays: of what others are beside, and of those others. Iterations end at a tenth of
it, over what a microstep moves."""
STATE_STEP, PARAMETER_STEP = 5e-6, 2e-6
"""Steps of the differences: of states over what a microstep moves, of parameters over themselves."""
CHECKED, TOLERANCE = 1e-5, 5e-4
"""Part of themselves by which parameters change to see whether lines follow their derivatives with
other steps, and by how much they may not, over it and the largest relative derivative of the line (at
least 1)."""
CLOSED, MAX_CLOSING_STEPS = 1e-10, 8
"""Gap of a period that counts as closed, over what a microstep moves, and corrections until then."""
SAME_STEPS = 2e-5
"""Way of the start, over what a microstep moves, within which steps and derivatives stay as good."""
NOT_CLOSED = "with finer steps the period does not close about the motion that was found"
KINK = "a friction just sticks there, or just does not"
FIRST_ROWS = 4096
"""Steps of a period for which there is room at first."""
TERMS, INTERVALS = 10, 8
"""Terms of the expansion of a phase about the middle of an interval, and intervals per period of the
highest harmonic: their error is (pi / 8)^10 / 10!, 2e-11, which counts because it jumps where an event crosses an edge."""


class NotDifferentiable(SimulationError):
    """The lines of this motion have no derivatives here; the message says why."""


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
    keys: Sequence[str],
    orders: np.ndarray,
    scales: Mapping[str, float],
) -> LineDerivatives:
    """Derivatives of the harmonics ``orders`` (k,) by the parameters ``keys``, about the steady
    ``state`` at the start of a period of ``microsteps``; ``scales`` [SI] are of those that are 0.

    Raises NotDifferentiable where the motion is none that repeats from its state alone, or is not
    closed by finer steps, and MicrovibError for a key that is not a number, or is 0 without a scale.
    """
    if scenario.has_memory:
        raise NotDifferentiable("friction with memory has no derivatives here")
    values = np.array([_value(scenario, key, scales) for key in keys])
    sizes = np.array([scales.get(key, abs(x)) for key, x in zip(keys, values, strict=True)])
    parameters = _Parameters(tuple(keys), sizes)
    about = _about_closed(_recorded(scenario, microsteps, keys, orders, FINER), state)
    moved, total = about.by_parameters(parameters)
    known = np.all(np.isfinite(moved), axis=0)
    off = np.zeros(orders.size)
    if np.any(known):
        finer = _recorded(scenario, microsteps, keys, orders, CHECKED_FINER)
        own = parameters.only(known)
        off = about.disagreement(finer, own, moved[:, known], total[:, known])
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.abs(total) / np.abs(about.harmonics)[:, None]
        largest = np.fmax(np.fmax.reduce(relative, axis=1, initial=1.0), 1.0)
        disagreement = np.where(known[:, None], off / largest, np.inf)
        derivatives = np.where(disagreement <= TOLERANCE, (total / sizes).T, np.nan)
    return LineDerivatives(tuple(keys), values, orders, about.harmonics, derivatives, disagreement)


@dataclass(frozen=True)
class _Parameters:
    """Parameters, and what their changes are relative to."""

    keys: tuple[str, ...]
    scales: np.ndarray
    """[SI], (p,)."""

    def changed(self, scenario: Scenario, parts: np.ndarray) -> Scenario:
        """Scenario in which each parameter is more by a part of its scale."""
        for key, change in zip(self.keys, (parts * self.scales).tolist(), strict=True):
            if change:
                scenario = scenario.nudged(key, scenario[key] + change)
        return scenario

    def only(self, some: np.ndarray) -> _Parameters:
        """Some of the parameters."""
        keys = tuple(key for key, counts in zip(self.keys, some, strict=True) if counts)
        return _Parameters(keys, self.scales[some])


def _recorded(
    scenario: Scenario, microsteps: int, keys: Sequence[str], orders: np.ndarray, finer: int
) -> _Recorded:
    """A period to be recorded, with steps some times as fine as the solution's."""
    changed = scenario.with_si({"solver.refinement": finer * scenario.solver.refinement})
    shaped = any(key.endswith("stribeck_shape") for key in keys)
    return _Recorded(PeriodMap(changed, microsteps), orders, shaped)


def _value(scenario: Scenario, key: str, scales: Mapping[str, float]) -> float:
    value = scenario[key]
    if (
        not isinstance(value, float)
        or not math.isfinite(value)
        or (not value and key not in scales)
    ):
        raise MicrovibError(f"{key}: {value} has no derivative; expected a number other than 0")
    return value


@dataclass(frozen=True)
class _End:
    """Where a period leads to."""

    state: np.ndarray
    """The state at its end, seen from the command; the output's angle is counted from that at which
    the command begins the period."""
    moments: np.ndarray
    """Moments of the momentum (``replay.replay``), (TERMS, n)."""
    gained: float
    """Momentum that it gains [N m s]."""
    frequency: float
    """Periods per second [Hz]."""
    late: float
    """Time [s] from where an ordinary period begins to the start of this one."""


class _Recorded:
    """A period that was recorded, and what is beside it: from its start to its end and its harmonics."""

    def __init__(self, period: PeriodMap, orders: np.ndarray, shaped: bool) -> None:
        packed = period.packed
        # What another drive changes may be in any row of the equations; the shape of a Stribeck
        # curve may differ from 1.
        period.packed = replace(
            packed,
            propagators=packed.propagators._replace(inputs=6),
            drive=packed.drive._replace(shaped=shaped or packed.drive.shaped),
        )
        self.map, self.orders, self._room = period, orders, FIRST_ROWS
        # a power of 2, of which Fourier transforms are fast
        self._intervals = 1 << math.ceil(math.log2(INTERVALS * int(orders.max())))

    def record(self, state: np.ndarray) -> _End:
        """From a state at its start, with steps that it chooses; others then take these."""
        self._plan = self._steps(self.map, state)
        self._modes: np.ndarray | None = None
        return self.settle(state)

    def settle(self, state: np.ndarray) -> _End:
        """From another state with the steps that were recorded; others then begin their iterations
        from this.
        """
        self.here = self._replayed(self.map, state, SETTLED, noted=True)
        return self.here

    def beside(self, state: np.ndarray, scenario: Scenario | None = None) -> _End:
        """From another state, or of another drive, with the steps that were recorded.

        Raises SimulationError where the same events do not occur.
        """
        return self._replayed(self._map_of(scenario), state, FINE)

    def has_same_events(self, state: np.ndarray, scenario: Scenario) -> bool:
        """Whether another drive, from another state, has the same events with steps of its own."""
        return _same_events(self._plan, self._steps(self._map_of(scenario), state))

    def has_events_of(self, other: _Recorded) -> bool:
        """Whether another recording has the same events."""
        return _same_events(self._plan, other._plan)

    def harmonics(self, ends: Sequence[_End]) -> np.ndarray:
        """Fourier coefficients [N m] of the torque T_d = -dL/dt, by parts of those of the momentum L,
        (k, ends).

        Phases are expanded about the middles of equal intervals, whose sums are Fourier transforms.
        """
        orders, n = self.orders, ends[0].moments.shape[1]
        sums = np.fft.rfft(np.array([end.moments for end in ends]))[:, :, orders]
        powers = np.vstack(
            [np.ones(orders.size), -1j * orders / np.arange(1, TERMS)[:, None]],
        )
        factors = np.cumprod(powers, axis=0) * np.exp(-1j * math.pi * orders / n)
        total = np.einsum("mk,emk->ke", factors, sums)
        gained = np.array([end.gained for end in ends])
        frequency = np.array([end.frequency for end in ends])
        result: np.ndarray = (
            2.0 * frequency * (-gained - 2j * math.pi * frequency * orders[:, None] * total)
        )
        late = np.array([end.late for end in ends])
        if np.any(late):
            result = result * np.exp(-2j * math.pi * frequency * orders[:, None] * late)
        return result

    def _map_of(self, scenario: Scenario | None) -> PeriodMap:
        if scenario is None:
            return self.map
        return self.map.beside(scenario, self.map.packed.beside(scenario))

    def _steps(self, period: PeriodMap, state: np.ndarray) -> np.ndarray:
        """Steps that a period chooses (n, STEP_COLUMNS)."""
        while True:
            rows = np.empty((self._room, kernel.STEP_COLUMNS))
            samples = step_buffer(rows)
            period.put(state + _offset(period))
            period.go_on(samples)
            made = int(samples.cursor[0])
            if made < self._room:
                return rows[:made]
            self._room *= 2

    def _replayed(
        self, period: PeriodMap, state: np.ndarray, accuracy: float, noted: bool = False
    ) -> _End:
        start = state + _offset(period)
        period.put(start)
        span = np.zeros(N_SPAN)
        span[[START, FREQUENCY, MOMENTUM]] = period.start, period.frequency, period.packed.momentum
        moments = np.zeros((TERMS, self._intervals))
        results = Replayed(accuracy, noted, np.zeros(len(self._plan)), moments, span)
        stop = period.start + 1.0 / period.frequency
        status = period.packed.replay(stop, self._plan, results, period)
        if status != kernel.OK:
            raise NotDifferentiable(KINK) from search_error(status)
        if self._modes is None:
            self._modes = results.modes
        elif not np.array_equal(self._modes, results.modes):
            raise NotDifferentiable(KINK)
        end = period.from_command(
            period.packed.state.y[None], period.turn([-period.microsteps]), start[None]
        )[0]
        return _End(
            end - _offset(period),
            moments,
            float(span[GAINED]),
            period.frequency,
            period.after_clock,
        )


def _same_events(steps: np.ndarray, others: np.ndarray) -> bool:
    """Whether steps (n, STEP_COLUMNS) have the same events in the same order."""
    one, other = (x[:, kernel.STEP_EVENT] for x in (steps, others))
    return np.array_equal(one[one >= 0.0], other[other >= 0.0])


def _offset(period: PeriodMap) -> np.ndarray:
    """Angle of the output at which the command begins the period, in a state: a gear of another
    ratio is not wound up by it.
    """
    offset: np.ndarray = np.zeros(period.sizes.size)
    offset[kernel.TL] = period.commanded_output
    return offset


class _Differences:
    """Differences of a recorded period in each state that moves."""

    def __init__(self, period: _Recorded, state: np.ndarray) -> None:
        self.period, self.state, self.sizes = period, state, period.map.sizes
        at_rest = STICKING_STATES[period.here.state[STICKING_STATES] == 0.0]
        self.moving = np.setdiff1d(np.arange(state.size), [*period.map.idle, *at_rest])
        ends = [period.beside(self.moved(STATE_STEP * unit)) for unit in np.eye(self.moving.size)]
        self._of_state = np.column_stack([self.gained(end) for end in ends]) / STATE_STEP
        self._ends = [period.here, *ends]

    @cached_property
    def harmonics(self) -> np.ndarray:
        """Harmonics of the period that closes, (k,)."""
        here: np.ndarray = self.period.harmonics([self.period.here])[:, 0]
        return here

    @cached_property
    def _of_harmonics(self) -> np.ndarray:
        """Their derivatives by each state that moves, (k, n)."""
        each = self.period.harmonics(self._ends)
        result: np.ndarray = (each[:, 1:] - each[:, :1]) / STATE_STEP
        return result

    def moved(self, by: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        """The start, or another one, moved; by what a microstep moves."""
        state = (self.state if start is None else start).copy()
        state[self.moving] += by * self.sizes[self.moving]
        return state

    def gained(self, end: _End) -> np.ndarray:
        """Change of the end of the period, over what a microstep moves."""
        result: np.ndarray = ((end.state - self.period.here.state) / self.sizes)[self.moving]
        return result

    def closing(self, gained: np.ndarray) -> np.ndarray:
        """Change of the start, over what a microstep moves, that makes up for what the end gains."""
        result: np.ndarray = np.linalg.solve(np.eye(self.moving.size) - self._of_state, gained)
        return result

    def close(self) -> bool:
        """Move the start to where the recorded steps close the period; False where that is too far
        for them, and then only there.
        """
        gap, by = self._gap(), np.zeros(self.moving.size)
        for _ in range(MAX_CLOSING_STEPS):
            change = self.closing(gap)
            by += change
            self.state = self.moved(change)
            if float(np.max(np.abs(by))) > SAME_STEPS:
                return False
            self.period.settle(self.state)
            gap = self._gap()
            if float(np.max(np.abs(gap))) < CLOSED:
                return True
        raise NotDifferentiable(NOT_CLOSED)

    def _gap(self) -> np.ndarray:
        """By how much the period does not close, over what a microstep moves."""
        result: np.ndarray = ((self.period.here.state - self.state) / self.sizes)[self.moving]
        return result

    def by_parameters(self, parameters: _Parameters) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by the parameters, over their scales: of the start that repeats, over what a
        microstep moves, (n, p), and of its harmonics, (k, p); nan where there is none.
        """
        count = len(parameters.keys)
        ends: list[_End | None] = []
        for part in PARAMETER_STEP * np.eye(count):
            try:
                changed = parameters.changed(self.period.map.scenario, part)
                ends.append(self.period.beside(self.state, changed))
            except SimulationError:
                ends.append(None)
        known = np.array([end is not None for end in ends], dtype=bool)
        moved = np.full((self.moving.size, count), np.nan)
        total = np.full((self.harmonics.size, count), np.nan, dtype=complex)
        found = [end for end in ends if end is not None]
        if found:
            gained = np.column_stack([self.gained(end) for end in found])
            moved[:, known] = self.closing(gained) / PARAMETER_STEP
            own = self.period.harmonics(found) - self.harmonics[:, None]
            total[:, known] = own / PARAMETER_STEP + self._of_harmonics @ moved[:, known]
        return moved, total

    def disagreement(
        self, other: _Recorded, parameters: _Parameters, moved: np.ndarray, total: np.ndarray
    ) -> np.ndarray:
        """How far logarithms of harmonics are from where the derivatives lead, with the steps of
        ``other``: between all parameters less by the part CHECKED of themselves, or more, and as much
        more, or less; over that part, (k,). Infinite where other events occur.
        """
        count = len(parameters.keys)
        signs = np.where(np.random.default_rng(count).random(count) < 0.5, -1.0, 1.0)
        try:
            state = self._closed_by(other)
            above, below = (
                self._reached(
                    other,
                    parameters.changed(other.map.scenario, part),
                    self.moved(moved @ part, state),
                )
                for part in (CHECKED * signs, -CHECKED * signs)
            )
        except SimulationError:
            return np.full(self.harmonics.size, np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.log(above / below) / (2.0 * CHECKED)
            off: np.ndarray = np.abs(slope - (total @ signs) / self.harmonics)
        return off

    def _closed_by(self, other: _Recorded) -> np.ndarray:
        """The start from which the steps of another recording close the period.

        Raises NotDifferentiable where they have other events.
        """
        state = self.state
        end = other.record(state)
        if not self.period.has_events_of(other):
            raise NotDifferentiable(KINK)
        for _ in range(MAX_CLOSING_STEPS):
            gap = ((end.state - state) / self.sizes)[self.moving]
            if float(np.max(np.abs(gap))) < CLOSED:
                return state
            state = self.moved(self.closing(gap), state)
            end = other.settle(state)
        raise NotDifferentiable(NOT_CLOSED)

    def _reached(self, other: _Recorded, scenario: Scenario, start: np.ndarray) -> np.ndarray:
        """Harmonics of a changed scenario that repeat near a ``start``, with the steps of another
        recording, (k,).

        Raises SimulationError where other events occur.
        """
        if not other.has_same_events(start, scenario):
            raise NotDifferentiable(KINK)
        end = other.beside(start, scenario)
        left = self.closing(((end.state - start) / self.sizes)[self.moving])
        result: np.ndarray = other.harmonics([end])[:, 0] + self._of_harmonics @ left
        return result


def _about_closed(period: _Recorded, state: np.ndarray) -> _Differences:
    """Differences about the state from which a period ends where it starts, near a ``state`` as
    ``PeriodMap`` has it.
    """
    state = state - _offset(period.map)
    for _ in range(MAX_CLOSING_STEPS):
        period.record(state)
        about = _Differences(period, state)
        with suppress(SimulationError):  # steps too short for their events to move so far
            if about.close():
                return about
        state = about.state
    raise NotDifferentiable(NOT_CLOSED)
