"""Derivatives of a steady state's lines with respect to the drive's parameters, from the solution that
was found.

A period maps the state x at its start to the state P(x, p) at its end and has the Fourier
coefficients c(x, p) of the disturbance torque, p being a parameter. In the steady state x = P(x, p),
and so

    dc/dp = c_p + c_x (I - P_x)^-1 P_p

All of it is had from differences of single periods: nothing settles, and nothing is searched again.
The periods are integrated with finer steps than the solution, for a step that is accepted here and
rejected there changes the end by the error of integration; and Fourier coefficients are integrated
over each step, for an event that crosses the edge of a sample would make them jump.

**Where there is no derivative.** Lines have kinks where a friction just sticks or just does not
(grazing). Differences to both sides then disagree, and such a derivative is not given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.errors import MicrovibError, SimulationError
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.sampling import step_buffer
from microvib.solve.steady.period import PeriodMap
from microvib.solve.steady.search import STICKING_STATES

FINER = 4
"""Times by which steps are finer than those of the solution."""
STATE_STEP, PARAMETER_STEP = 3e-5, 1e-6
"""Steps of the differences: of states over what a microstep moves, of parameters over themselves."""
ONE_SIDED_TOLERANCE = 1e-3
"""By how much the differences to both sides may differ, over the largest relative derivative of the
line (at least 1)."""
CLOSED, MAX_CLOSING_STEPS = 1e-11, 30
"""Gap of a period that counts as closed, over what a microstep moves, and corrections until then."""
FIRST_ROWS = 4096
"""Steps of a period for which there is room at first."""
TERMS, INTERVALS = 8, 8
"""Terms of the expansion of a phase about the middle of an interval, and intervals per period of the
highest harmonic: their error is (pi / 8)^8 / 8!, 1e-8."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
_POWERS = _NODES[:, None] ** np.arange(8)


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
    """Difference of the derivatives to one side from those to both, over the line's largest relative
    derivative (at least 1), (p, k)."""

    @property
    def relative(self) -> np.ndarray:
        """Relative changes of the complex amplitudes over those of the parameters, d ln c / d ln p,
        (p, k); the real part is that of the amplitude.
        """
        result: np.ndarray = self.derivatives * self.values[:, None] / self.amplitudes
        return result


def line_derivatives(
    scenario: Scenario, state: np.ndarray, microsteps: int, keys: Sequence[str], orders: np.ndarray
) -> LineDerivatives:
    """Derivatives of the harmonics ``orders`` (k,) by the parameters ``keys``, about the steady
    ``state`` at the start of a period of ``microsteps``.

    Raises NotDifferentiable where the motion is none that repeats from its state alone, or is not
    closed by finer steps, and MicrovibError for a key that is not a number other than 0.
    """
    if scenario.has_memory:
        raise NotDifferentiable("friction with memory has no derivatives here")
    values = np.array([_value(scenario, key) for key in keys])
    finer = scenario.with_si({"solver.refinement": FINER * scenario.solver.refinement})
    period = _Period(finer, microsteps, orders)
    rough = _Differences(period, state, 10.0 * STATE_STEP)
    state = _closed(period, state, rough)
    by_state = _Differences(period, state, STATE_STEP)
    changes = [
        _by_parameter(finer, by_state, key, value) for key, value in zip(keys, values, strict=True)
    ]
    amplitudes = by_state.harmonics
    derivatives = np.array([c for c, _ in changes]).reshape(len(keys), orders.size)
    one_sided = np.array([off for _, off in changes]).reshape(derivatives.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.abs(values)[:, None] / np.abs(amplitudes)
        largest = np.max(np.abs(derivatives) * scale, axis=0, initial=1.0)
        disagreement = one_sided * scale / largest
    derivatives = np.where(disagreement <= ONE_SIDED_TOLERANCE, derivatives, np.nan)
    return LineDerivatives(tuple(keys), values, orders, amplitudes, derivatives, disagreement)


def _value(scenario: Scenario, key: str) -> float:
    value = scenario[key]
    if not isinstance(value, float) or value == 0.0 or not math.isfinite(value):
        raise MicrovibError(f"{key}: {value} has no derivative; expected a number other than 0")
    return value


@dataclass(frozen=True)
class _End:
    """State and harmonics to which a period leads."""

    state: np.ndarray
    """The state at its end, seen from the command."""
    harmonics: np.ndarray


class _Period:
    """A period of a scenario as a map from its start to its end and its harmonics."""

    def __init__(self, scenario: Scenario, microsteps: int, orders: np.ndarray) -> None:
        self.map, self.orders, self._room = PeriodMap(scenario, microsteps), orders, FIRST_ROWS

    @property
    def sizes(self) -> np.ndarray:
        """Motion of each state per microstep."""
        return self.map.sizes

    def advance(self, state: np.ndarray) -> _End:
        """From a state at its start, seen from the command."""
        period = self.map
        while True:
            rows = np.zeros((self._room, kernel.STEP_COLUMNS))
            samples = step_buffer(rows)
            period.put(state)
            before = period.packed.momentum
            period.go_on(samples)
            made = int(samples.cursor[0])
            if made < self._room:
                break
            self._room *= 2
        end = period.from_command(
            period.packed.state.y[None], period.turn([-period.microsteps]), state[None]
        )[0]
        gained = period.packed.momentum - before
        return _End(end, self._harmonics(rows[:made], gained))

    def _harmonics(self, steps: np.ndarray, gained: float) -> np.ndarray:
        """Fourier coefficients [N m] of the torque T_d = -dL/dt, by parts of those of the momentum L,
        which is a polynomial in each step.

        Phases are expanded about the middles of equal intervals, whose sums are Fourier transforms.
        """
        start, lasts = steps[:, :1] - self.map.start, steps[:, 1:2]
        momentum = steps[:, 2:] @ _POWERS.T
        momentum -= np.mean(momentum)
        frequency = self.map.frequency
        turns = ((start + lasts * _NODES) * frequency).ravel()
        parts = (momentum * (lasts * _WEIGHTS)).ravel()
        n = INTERVALS * int(self.orders.max() + 1)
        interval = np.clip((turns * n).astype(int), 0, n - 1)
        offset = 2.0 * math.pi * (turns - (interval + 0.5) / n)
        total = np.zeros(self.orders.size, dtype=complex)
        factor = np.ones(self.orders.size, dtype=complex)
        for m in range(TERMS):
            sums = np.fft.rfft(np.bincount(interval, parts, n))[self.orders]
            total += factor * sums
            factor = factor * (-1j * self.orders) / (m + 1.0)
            parts = parts * offset
        total *= np.exp(-1j * math.pi * self.orders / n)
        result: np.ndarray = (
            2.0 * frequency * (-gained - 2j * math.pi * frequency * self.orders * total)
        )
        late = self.map.after_clock
        if late != 0.0:
            result = result * np.exp(-2j * math.pi * frequency * self.orders * late)
        return result


class _Differences:
    """Differences of a period in each state that moves, to both sides."""

    def __init__(self, period: _Period, state: np.ndarray, step: float) -> None:
        self.state, self.sizes = state, period.sizes
        self.orders, self.microsteps = period.orders, period.map.microsteps
        here = period.advance(state)
        at_rest = STICKING_STATES[here.state[STICKING_STATES] == 0.0]
        self.moving = np.setdiff1d(np.arange(state.size), [*period.map.idle, *at_rest])
        self.end, self.harmonics = here.state, here.harmonics
        forward, backward = [], []
        for k in self.moving:
            change = np.zeros(state.size)
            change[k] = step * period.sizes[k]
            forward.append(self.slopes(period.advance(state + change), step))
            backward.append(self.slopes(period.advance(state - change), -step))
        self.forward, self.backward = _Slopes.stacked(forward), _Slopes.stacked(backward)
        self.central = self.forward.mean_with(self.backward)

    def slopes(self, end: _End, step: float) -> _Slopes:
        """Slopes from here to another end by a ``step``; of states over what a microstep moves, of
        whichever drive the end is.
        """
        gained = (end.state - self.end) / self.sizes
        return _Slopes(gained[self.moving] / step, (end.harmonics - self.harmonics) / step)


@dataclass(frozen=True)
class _Slopes:
    """Slopes of the end of a period, and of its harmonics; columns where there are several."""

    state: np.ndarray
    harmonics: np.ndarray

    @staticmethod
    def stacked(each: Sequence[_Slopes]) -> _Slopes:
        """Slopes in several directions, as columns."""
        return _Slopes(
            np.column_stack([one.state for one in each]),
            np.column_stack([one.harmonics for one in each]),
        )

    def mean_with(self, other: _Slopes) -> _Slopes:
        """Means of both."""
        return _Slopes(0.5 * (self.state + other.state), 0.5 * (self.harmonics + other.harmonics))

    def total(self, by_parameter: _Slopes) -> np.ndarray:
        """Derivative of the harmonics of the motion that repeats, by a parameter; these are by the
        states.
        """
        unit = np.eye(len(self.state))
        moved = np.linalg.solve(unit - self.state, by_parameter.state)
        result: np.ndarray = by_parameter.harmonics + self.harmonics @ moved
        return result


def _closed(period: _Period, state: np.ndarray, about: _Differences) -> np.ndarray:
    """The state from which a period ends where it starts, by corrections with one set of slopes."""
    unit, moving = np.eye(about.moving.size), about.moving
    for _ in range(MAX_CLOSING_STEPS):
        gap = ((period.advance(state).state - state) / period.sizes)[moving]
        if float(np.max(np.abs(gap))) < CLOSED:
            return state
        state = state.copy()
        state[moving] += np.linalg.solve(unit - about.central.state, gap) * period.sizes[moving]
    raise NotDifferentiable(
        "with finer steps the period does not close about the motion that was found"
    )


def _by_parameter(
    scenario: Scenario, by_state: _Differences, key: str, value: float
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the harmonics by a parameter, and how far those to either side are from them."""
    step = PARAMETER_STEP * value
    forward, backward = (
        by_state.slopes(_changed(scenario, by_state, key, value + change), change)
        for change in (step, -step)
    )
    central = by_state.central.total(forward.mean_with(backward))
    one_sided = by_state.forward.total(forward), by_state.backward.total(backward)
    return central, np.max([np.abs(one - central) for one in one_sided], axis=0)


def _changed(scenario: Scenario, by_state: _Differences, key: str, value: float) -> _End:
    """Where the period of a changed scenario leads to from the same state.

    Where the clock changes, the settling time follows, so that the period starts at the same
    microstep.
    """
    changed = scenario.with_si({key: value})
    before, after = scenario.driving_frequency, changed.driving_frequency
    if before and after and before != after:
        settle = scenario.record.settle * (before / after)
        changed = changed.with_si({"record.settle": settle})
    return _Period(changed, by_state.microsteps, by_state.orders).advance(by_state.state)
