"""A run in time from rest, counted in microsteps of the command: what every other run of the
scenario does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.integration import status_error
from microvib.solve.sampling import sample_buffer
from microvib.solve.steady.period import NotPeriodic, PeriodMap

MAX_MICROSTEPS = 3_000_000
"""Microsteps of a run from rest, at most."""
MAX_STEPS = 10_000_000
"""Steps of its integration, at most: some seconds of computing."""
MAX_SIMULATED_TIME = 3000.0
"""Time [s] that it simulates, at most."""
MIN_AVERAGES_PER_CYCLE = 2.0
"""Averages of the torque in a cycle of the fastest mode, at least."""
MIN_DECAY_RATE = 1e-4
"""Rate [1/s] that a decay is taken to have at least."""
MAX_RINGING_DAMPING_RATIO = 0.5
"""Damping ratio above which a mode does not ring."""


class RingingTimes:
    """The slowest decay [1/s] of a drive's modes and current loop, the longest cycle [s] of what rings in it,
    and the highest frequency [Hz] (``decay``, ``cycle``, ``top``).
    """

    def __init__(self, scenario: Scenario) -> None:
        modes = [m for m in coupled_modes(scenario) if m.frequency > 0.0]
        decays = (*(m.decay for m in modes), scenario.driver.slow_decay(scenario.motor))
        self.decay = max(min(decays), MIN_DECAY_RATE)
        modes = [m for m in modes if m.damping < MAX_RINGING_DAMPING_RATIO]
        self.cycle = max((1.0 / m.frequency for m in modes), default=0.0)
        self.top = max((m.frequency for m in modes), default=0.0)


class Checkpoint(NamedTuple):
    """Where a run is, to go back to."""

    state: list[np.ndarray]
    made: int


class RunFromRest:
    """A run in time under the command of a ``PeriodMap``, that begins as every run of its scenario
    does.
    """

    def __init__(self, period: PeriodMap) -> None:
        self.period, self.ringing = period, RingingTimes(period.scenario)
        self.rows = math.ceil(
            max(MIN_AVERAGES_PER_CYCLE * self.ringing.top * period.microstep_time, 2.0)
        )
        """Averages of the torque in each microstep."""
        self.simulated = 0.0
        """Time [s] that was simulated."""
        self.longest = min(MAX_MICROSTEPS * period.microstep_time, MAX_SIMULATED_TIME)
        """Time [s] that may be simulated."""

    def begin(self, parts: int = 1) -> None:
        """Go from rest to the first of the ``parts`` of a period that begins under the rate of the
        record.
        """
        period, scenario = self.period, self.period.scenario
        period.rest()
        self._begun = int(period.packed.state.counters[kernel.STEPS])
        times, _ = scenario.tracking.breakpoints()
        now = int(np.searchsorted(times, scenario.record.settle, side="right")) - 1
        since = float(times[now]) + scenario.driver.delay + scenario.driver.shape.lasts
        part = period.microsteps // parts
        self.made = part * math.ceil((since - period.start) / (part * period.microstep_time) + 1e-6)
        stop = self._time(self.made)
        given = Command(scenario)
        if (
            stop > MAX_SIMULATED_TIME
            or abs(float(np.diff(given.count(np.array([0.0, stop])))[0])) > MAX_MICROSTEPS
        ):
            raise NotPeriodic(
                "the recorded rate starts too late for a run from rest to reach its steady state"
            )
        self._go(stop, *given.microsteps(0.0, stop))

    def advance(self, microsteps: int, rows: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Means of torque [N m] and of the output's stick over the next ``microsteps``, with
        ``rows`` in each of them.
        """
        packed, count = self.period.packed, microsteps * rows
        stop = self._time(self.made + microsteps)
        samples = None
        if count:
            buffer, now = np.zeros((count, packed.torque_columns)), self._time(self.made)
            samples = sample_buffer(buffer, now, (stop - now) / count)
        self._go(stop, *self.period.command.microsteps(self._time(self.made), stop), samples)
        self.made += microsteps
        if samples is not None:
            return packed.torque_of(samples.rows)
        return (np.zeros(0), np.zeros(0))

    @property
    def now(self) -> float:
        """Time of the run [s], since the start of the scenario."""
        return float(self.period.packed.state.clock[kernel.NOW])

    def seen(self, period: PeriodMap | None = None, ahead: int = 0) -> np.ndarray:
        """The state at the start of a ``period`` that begins ``ahead`` microsteps before the run's
        own, seen from the command.
        """
        y = self.period.packed.state.y[None]
        if period is None:
            period = self.period
        return period.from_command(y, period.turn([-self.made - ahead]), np.zeros_like(y))[0]

    def stick(self, ahead: int = 0) -> np.ndarray:
        """Modes and memory of the frictions there (``PeriodMap.stick_turned``)."""
        return self.period.stick_turned(self.period.packed.state.stick, -self.made - ahead)

    def go_on_from(self, x: np.ndarray, stick: np.ndarray | None = None) -> None:
        """Go on from another state at the start of a period, seen from the command."""
        self.period.put(x, stick)
        self.made = 0

    def take_away(self, deviation: np.ndarray) -> None:
        """Take a ``deviation`` (n,) off the state; shafts that stick stay where they are."""
        y = self.period.packed.state.y
        for angle, rate in ((kernel.TM, kernel.WM), (kernel.TL, kernel.WL)):
            if y[rate] == 0.0:
                deviation[[angle, rate]] = 0.0
        y -= deviation

    def place(self) -> Checkpoint:
        """Where the run is."""
        return Checkpoint([part.copy() for part in self.period.packed.state], self.made)

    def go_back(self, place: Checkpoint) -> None:
        """Go on from where the run was."""
        for part, value in zip(self.period.packed.state, place.state, strict=True):
            part[:] = value
        self.made = place.made

    def _time(self, made: int) -> float:
        return self.period.start + made * self.period.microstep_time

    def _go(
        self, stop: float, times: np.ndarray, commands: np.ndarray, samples: object = None
    ) -> None:
        packed = self.period.packed
        begun = float(packed.state.clock[kernel.NOW])
        status = packed.advance(stop, samples or self.period.unseen, times, commands)
        now = float(packed.state.clock[kernel.NOW])
        self.simulated += now - begun
        if status != kernel.OK:
            raise NotPeriodic(
                "a start from rest does not reach it:"
                f" {status_error(self.period.scenario, status, now)}"
            )
        if packed.state.counters[kernel.STEPS] - self._begun > MAX_STEPS:
            raise NotPeriodic(
                f"a run from rest that shows it takes too many steps, of which {self.simulated:.3g}"
                f" s had {MAX_STEPS}"
            )


def rms(x: np.ndarray) -> float:
    """Root mean square of ``x``."""
    return float(np.sqrt(np.mean(x**2)))
