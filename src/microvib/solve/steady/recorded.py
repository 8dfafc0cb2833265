"""A period of a steady motion that was recorded with its steps, and what is beside it: other starts,
other drives, taken with the same steps (``microvib.solve.replay``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from microvib.errors import SimulationError
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.pack import Replayed
from microvib.solve.replay import FREQUENCY, GAINED, MOMENTUM, N_SPAN, START
from microvib.solve.sampling import step_buffer
from microvib.solve.steady.period import PeriodMap, search_error

SETTLED, FINE = 1e-12, 1e-9
"""Accuracies of replays: of what others are beside, and of those others. Iterations end at a tenth of
it, over what a microstep moves."""
KINK = "a friction just sticks there, or just does not"
FIRST_ROWS = 64
"""Steps of a microstep for which there is room at first, with steps as fine as the solution's."""
TERMS, INTERVALS = 18, 2
"""Terms of the expansion of a phase about the middle of an interval, and intervals per period of the
highest harmonic: their error is (pi / 2)^18 / 18!, 5e-13, which counts because it jumps where an event
crosses an edge."""


class NotDifferentiable(SimulationError):
    """The lines of this motion have no derivatives here; the message says why."""


@dataclass(frozen=True)
class PeriodEnd:
    """Where a period leads to."""

    state: np.ndarray
    """The state at its end, seen from the command; the output's angle is counted from that at which
    the command begins the period."""
    moments: np.ndarray
    """Moments of the momentum (``replay.replay``), (n, TERMS)."""
    gained: float
    """Momentum that it gains [N m s]."""
    frequency: float
    """Periods per second [Hz]."""
    late: float
    """Time [s] from where an ordinary period begins to the start of this one."""


class RecordedPeriod:
    """A period that was recorded, and what is beside it: from its start to its end and its harmonics."""

    def __init__(self, period: PeriodMap, orders: np.ndarray) -> None:
        self.map, self.orders = period, orders
        self._room = FIRST_ROWS * period.microsteps * period.scenario.solver.refinement
        self._moments = _moments_of(int(orders.max()))

    @classmethod
    def with_finer_steps(
        cls, scenario: Scenario, microsteps: int, orders: np.ndarray, finer: int
    ) -> RecordedPeriod:
        """A period to be recorded, with steps some times as fine as the scenario's."""
        changed = scenario.nudged("solver.refinement", finer * scenario.solver.refinement)
        return cls(PeriodMap(changed, microsteps), orders)

    def shaped(self, state: np.ndarray) -> RecordedPeriod:
        """Recording with the same steps, from a state, of the drive as one whose Stribeck curves may have shapes
        other than 1, which take longer to evaluate.
        """
        packed = self.map.packed
        if packed.drive.shaped:
            return self
        other = copy(self)
        other.map, other._plan = copy(self.map), self._plan.copy()
        other.map.packed = replace(packed, drive=packed.drive._replace(shaped=True))
        other.settle(state)
        return other

    def of(self, scenario: Scenario) -> PeriodMap:
        """The period of another drive, to be taken with the steps of this one."""
        return self.map.beside(scenario, self.map.packed.beside(scenario))

    def record(self, state: np.ndarray) -> PeriodEnd:
        """From a state at its start, with steps that it chooses; others then take these."""
        self._plan = self._steps(self.map, state)
        self._modes: np.ndarray | None = None
        return self.settle(state)

    def settle(self, state: np.ndarray) -> PeriodEnd:
        """From another state with the steps that were recorded; others then begin their iterations
        from this.
        """
        self.here = self._replayed(self.map, state, SETTLED, noted=True)
        return self.here

    def beside(self, state: np.ndarray, period: PeriodMap | None = None) -> PeriodEnd:
        """From another state, or of another drive (``of``), with the steps that were recorded.

        Raises SimulationError where the same events do not occur.
        """
        return self._replayed(period or self.map, state, FINE)

    def has_same_events(self, state: np.ndarray, period: PeriodMap) -> bool:
        """Whether another drive, from another state, has the same events with steps of its own."""
        return _same_events(self._plan, self._steps(period, state))

    def has_events_of(self, other: RecordedPeriod) -> bool:
        """Whether another recording has the same events."""
        return _same_events(self._plan, other._plan)

    @cached_property
    def _factors(self) -> np.ndarray:
        """Factors of the moments' Fourier transforms in each harmonic, (k, TERMS)."""
        orders, (n, terms) = self.orders, self._moments
        powers = np.ones((orders.size, terms), dtype=complex)
        powers[:, 1:] = -1j * orders[:, None] / np.arange(1, terms)
        factors: np.ndarray = np.cumprod(powers, axis=1)
        return factors * np.exp(-1j * math.pi * orders / n)[:, None]

    def harmonics(self, ends: Sequence[PeriodEnd]) -> np.ndarray:
        """Fourier coefficients [N m] of the torque T_d = -dL/dt, by parts of those of the momentum L,
        (k, ends).

        Phases are expanded about the middles of equal intervals, whose sums are Fourier transforms.
        """
        orders = self.orders
        sums = np.fft.rfft(np.array([end.moments for end in ends]), axis=1)[:, orders]
        total = np.einsum("km,ekm->ke", self._factors, sums)
        gained = np.array([end.gained for end in ends])
        frequency = np.array([end.frequency for end in ends])
        result: np.ndarray = (
            2.0 * frequency * (-gained - 2j * math.pi * frequency * orders[:, None] * total)
        )
        late = np.array([end.late for end in ends])
        if np.any(late):
            result = result * np.exp(-2j * math.pi * frequency * orders[:, None] * late)
        return result

    def _steps(self, period: PeriodMap, state: np.ndarray) -> np.ndarray:
        """Steps that a period chooses (n, STEP_COLUMNS)."""
        while True:
            rows = np.empty((self._room, kernel.STEP_COLUMNS))
            samples = step_buffer(rows)
            period.put(state + output_offset(period))
            period.go_on(samples)
            made = int(samples.cursor[0])
            if made < self._room:
                return rows[:made]
            self._room *= 2

    def _replayed(
        self, period: PeriodMap, state: np.ndarray, accuracy: float, noted: bool = False
    ) -> PeriodEnd:
        offset = output_offset(period)
        start = state + offset
        period.put(start)
        span = np.zeros(N_SPAN)
        span[[START, FREQUENCY, MOMENTUM]] = period.start, period.frequency, period.packed.momentum
        moments = np.zeros(self._moments)
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
        return PeriodEnd(
            end - offset,
            moments,
            float(span[GAINED]),
            period.frequency,
            period.after_clock,
        )


def _moments_of(highest: int) -> tuple[int, int]:
    """Intervals and terms for harmonics up to the ``highest`` one; as many intervals as a power of 2, of
    which Fourier transforms are fast.
    """
    return 1 << math.ceil(math.log2(INTERVALS * highest)), TERMS


def _same_events(steps: np.ndarray, others: np.ndarray) -> bool:
    """Whether steps (n, STEP_COLUMNS) have the same events in the same order."""
    one, other = (x[:, kernel.STEP_EVENT] for x in (steps, others))
    return np.array_equal(one[one >= 0.0], other[other >= 0.0])


def output_offset(period: PeriodMap) -> np.ndarray:
    """Angle of the output at which the command begins the period, in a state: a gear of another
    ratio is not wound up by it.
    """
    offset: np.ndarray = np.zeros(period.sizes.size)
    offset[kernel.TL] = period.commanded_output
    return offset
