"""Disturbance torques of many scenarios at once: ``simulate_torques(scenarios)``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from microvib.errors import SimulationError
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve import stepper as abreast
from microvib.solve.command import Command
from microvib.solve.pack import Packed, pack
from microvib.solve.sampling import Window, half_length, taps, window
from microvib.solve.simulate import stopped
from microvib.solve.vector import WIDTH

MICROSTEPS_AT_ONCE = 4096
"""Microsteps of a drive that are known in advance; bounds the memory of a long run."""
SAMPLES_AT_ONCE = 256
"""Samples whose intervals wait for the filter."""


@dataclass(frozen=True)
class Torque:
    """Disturbance torque of one scenario over its record."""

    T_d: np.ndarray
    """Samples [N m], (n,), as in a ``Motion``."""
    sample_rate: float
    """Samples per second [Hz]."""
    stuck_output: float
    """Fraction of the record that the output shaft sticks."""
    steps: int
    """Steps taken, settling included."""
    momentum: float
    """Mean torque that the change of momentum does not account for, over the largest T_d: what stops take out of the momentum."""


def simulate_torques(scenarios: Sequence[Scenario]) -> list[Torque | SimulationError]:
    """Torque of each scenario, or the error with which it stopped, in their order.

    It is the T_d of ``simulate``, from the same equations, steps and events, with nothing else sampled; WIDTH drives share
    each step's arithmetic (``microvib.solve.stepper``). A torque is the same to the last bit whatever else is in the list.
    One core is used; the lock of the interpreter is free meanwhile.
    """
    results: dict[int, Torque | SimulationError] = {}
    alike: dict[_Kind, list[int]] = defaultdict(list)
    for k, scenario in enumerate(scenarios):
        if scenario.record.start == "rest":
            alike[_kind(scenario)].append(k)
        else:
            results[k] = SimulationError(
                "record.start: many scenarios at once begin at rest; allowed is rest, not steady"
            )
    for kind, members in alike.items():
        results |= _Crew(kind, {k: scenarios[k] for k in members}).run()
    return [results[k] for k in range(len(scenarios))]


class _Kind(NamedTuple):
    """What all drives of a company have in common."""

    rigid: bool
    shaped: bool
    modes: int
    harmonics: int


def _kind(scenario: Scenario) -> _Kind:
    shapes = {scenario.motor.friction.stribeck_shape, scenario.friction.stribeck_shape}
    harmonics = len(scenario.reducer.transmission_error)
    return _Kind(scenario.reducer.rigid, shapes != {1.0}, len(scenario.array.modes), harmonics)


class _Berth:
    """A scenario in its lane."""

    def __init__(self, index: int, scenario: Scenario, intervals: Window) -> None:
        self.index, self.scenario, self.intervals = index, scenario, intervals
        self.packed: Packed = pack(scenario)
        self.command = Command(scenario)
        self.momentum = self.packed.momentum
        fastest = float(np.max(np.abs(scenario.tracking.breakpoints()[1])))
        top = scenario.driver.driving_frequency(scenario.motor, scenario.reducer.ratio * fastest)
        self.stretch = (MICROSTEPS_AT_ONCE - 2) / max(top, 1e-300)

    def torque(self, samples: np.ndarray, y: np.ndarray, control: np.ndarray, steps: int) -> Torque:
        """The result, from what the kernel leaves."""
        self.packed.state.y[:] = y
        lost = abs(self.packed.momentum - self.momentum + float(control[abreast.IMPULSE]))
        largest = float(control[abreast.LARGEST])
        return Torque(
            T_d=samples,
            sample_rate=self.scenario.record.sample_rate,
            stuck_output=float(control[abreast.STUCK] / (control[abreast.RECORDED] - control[abreast.SETTLED])),
            steps=steps,
            momentum=lost / (largest * self.intervals.end) if largest > 0.0 else 0.0,
        )


class _Crew:
    """Scenarios of one kind, WIDTH of them under way at a time; a lane that is through takes the next."""

    def __init__(self, kind: _Kind, scenarios: dict[int, Scenario]) -> None:
        self.scenarios = scenarios
        self.windows = {k: window(scenario) for k, scenario in scenarios.items()}
        self.berths: list[_Berth | None] = [None] * WIDTH
        self.results: dict[int, Torque | SimulationError] = {}
        factor = max(w.factor for w in self.windows.values())
        samples = max(scenario.record.samples for scenario in scenarios.values())
        self.company = abreast.company(
            *kind,
            taps=2 * half_length(factor) + 1,
            waiting=SAMPLES_AT_ONCE * factor,
            samples=samples,
            microsteps=MICROSTEPS_AT_ONCE,
        )

    def run(self) -> dict[int, Torque | SimulationError]:
        """Results by index."""
        waiting, flags = iter(self.scenarios), self.company.flags
        while True:
            for lane in range(WIDTH):
                self._serve(lane, waiting)
            if not np.any(flags[:, abreast.STATUS] == abreast.RUNNING):
                return self.results
            abreast.advance(self.company)

    def _serve(self, lane: int, waiting: Iterator[int]) -> None:
        """Give a lane what it waits for, microsteps or the next scenario, until it runs or there is none."""
        flags = self.company.flags[lane]
        while flags[abreast.STATUS] != abreast.RUNNING:
            berth = self.berths[lane]
            if berth and flags[abreast.STATUS] != abreast.WANTS_MICROSTEPS:
                self.results[berth.index] = self._result(lane, berth)
                berth = self.berths[lane] = None
            index = berth.index if berth else next(waiting, None)
            if index is None:
                flags[abreast.STATUS] = abreast.IDLE
                return
            try:
                berth = berth or self._board(lane, index)
                self._instruct(lane, berth)
            except SimulationError as error:
                self.results[index] = error
                berth = None
            self.berths[lane] = berth

    def _result(self, lane: int, berth: _Berth) -> Torque | SimulationError:
        c, n = self.company, berth.packed.state.y.size
        if c.flags[lane, abreast.STATUS] == abreast.FAILED:
            now = float(c.state[n + 2 + kernel.NOW, lane])
            return stopped(berth.scenario, int(c.flags[lane, abreast.CODE]), now)
        samples = c.out[lane, : berth.scenario.record.samples].copy()
        return berth.torque(samples, c.state[:n, lane], c.control[lane], int(c.counters[lane, kernel.STEPS]))

    def _board(self, lane: int, index: int) -> _Berth:
        """Put a scenario at rest into a lane."""
        berth = _Berth(index, self.scenarios[index], self.windows[index])
        c, state, record = self.company, berth.packed.state, berth.scenario.record
        abreast.embark(c, lane, berth.packed.drive)
        c.state[:, lane] = np.concatenate([state.y, state.stick, state.clock])
        c.counters[lane] = 0
        intervals, k, g = berth.intervals, c.control[lane], c.flags[lane]
        k[:], g[:] = 0.0, 0
        k[abreast.END], k[abreast.FIRST], k[abreast.INTERVAL] = intervals.end, intervals.first, intervals.width
        k[abreast.SETTLED], k[abreast.RECORDED] = record.settle, record.settle + record.samples / record.sample_rate
        c.taps[lane] = 0.0
        filter_taps = taps(intervals.factor)
        c.taps[lane, : filter_taps.size] = filter_taps
        g[abreast.FACTOR], g[abreast.TAPS], g[abreast.ROWS] = intervals.factor, filter_taps.size, intervals.rows
        g[abreast.MISSING], g[abreast.SAMPLES] = intervals.missing, record.samples
        return berth

    def _instruct(self, lane: int, berth: _Berth) -> None:
        """Tell a lane its next microsteps."""
        c, known = self.company, self.company.control[lane, abreast.KNOWN_UNTIL]
        stop = min(known + berth.stretch, berth.intervals.end)
        times, references = berth.command.microsteps(float(known), float(stop))
        c.times[lane, : times.size], c.references[lane, : times.size] = times, references
        c.flags[lane, [abreast.COMING, abreast.KNOWN]] = 0, times.size
        c.control[lane, abreast.KNOWN_UNTIL] = stop
        c.flags[lane, abreast.STATUS] = abreast.RUNNING
