"""Disturbance torques of many scenarios at once: ``simulate_torques(scenarios)``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from microvib.errors import SimulationError, expect
from microvib.model.scenario import Scenario
from microvib.solve import kernel, stepper
from microvib.solve.command import Command
from microvib.solve.integration import stopped
from microvib.solve.pack import Packed, pack
from microvib.solve.sampling import SampleIntervals, half_length, sample_intervals, taps
from microvib.solve.vector import WIDTH

MICROSTEPS_AT_ONCE = 4096
"""Microsteps of a drive computed in advance; bounds the memory of a long run."""
SAMPLES_AT_ONCE = 256
"""Samples whose intervals are buffered for the filter."""


@dataclass(frozen=True)
class Torque:
    """Disturbance torque of one scenario over its record."""

    scenario: Scenario
    T_d: np.ndarray
    """Samples [N m], (n,), as in a ``Motion``."""
    sample_rate: float
    """Samples per second [Hz]."""
    stuck_output: float
    """Fraction of the record that the output shaft sticks."""
    steps: int
    """Steps taken, settling included."""
    momentum: float
    """Momentum that stops removed (each within its tolerance), as a mean torque, over the largest T_d."""


def simulate_torques(scenarios: Sequence[Scenario]) -> list[Torque | SimulationError]:
    """Torque of each scenario, or the error with which it stopped, in their order.

    This is the T_d of ``simulate``, from the same equations, steps and events, with nothing else sampled; WIDTH drives share
    each step's arithmetic (``microvib.solve.stepper``). A torque is the same to the last bit whatever else is in the list.
    One core is used; the interpreter's lock is released meanwhile.
    """
    results: dict[int, Torque | SimulationError] = {}
    alike: dict[_Kind, list[int]] = defaultdict(list)
    for k, scenario in enumerate(scenarios):
        expect(scenario, Scenario, "a list of scenarios (mv.load_scenario)")
        if scenario.record.start == "rest":
            alike[_kind(scenario)].append(k)
        else:
            results[k] = SimulationError(
                "record.start: many scenarios at once begin at rest; allowed is rest, not steady"
            )
    for kind, members in alike.items():
        results |= _Queue(kind, {k: scenarios[k] for k in members}).run()
    return [results[k] for k in range(len(scenarios))]


class _Kind(NamedTuple):
    """What all drives of a group have in common."""

    rigid: bool
    shaped: bool
    modes: int
    harmonics: int


def _kind(scenario: Scenario) -> _Kind:
    shapes = {scenario.motor.friction.stribeck_shape, scenario.friction.stribeck_shape}
    harmonics = len(scenario.reducer.transmission_error)
    return _Kind(scenario.reducer.rigid, shapes != {1.0}, len(scenario.array.modes), harmonics)


class _Slot:
    """A scenario in its lane."""

    def __init__(self, index: int, scenario: Scenario, intervals: SampleIntervals) -> None:
        self.index, self.scenario, self.intervals = index, scenario, intervals
        self.packed: Packed = pack(scenario)
        self.command = Command(scenario)
        self.momentum = self.packed.momentum
        fastest = float(np.max(np.abs(scenario.tracking.breakpoints()[1])))
        top = scenario.driver.driving_frequency(scenario.motor, scenario.reducer.ratio * fastest)
        self.stretch = (MICROSTEPS_AT_ONCE - 2) / max(top, 1e-300)

    def torque(self, samples: np.ndarray, y: np.ndarray, control: np.ndarray, steps: int) -> Torque:
        """The result, from the arrays of the lane."""
        self.packed.state.y[:] = y
        lost = abs(self.packed.momentum - self.momentum + float(control[stepper.IMPULSE]))
        largest = float(control[stepper.LARGEST])
        return Torque(
            scenario=self.scenario,
            T_d=samples,
            sample_rate=self.scenario.record.sample_rate,
            stuck_output=float(control[stepper.STUCK] / (control[stepper.RECORD_END] - control[stepper.RECORD_START])),
            steps=steps,
            momentum=lost / (largest * self.intervals.end) if largest > 0.0 else 0.0,
        )


class _Queue:
    """Scenarios of one kind, WIDTH of them at a time; a lane that has finished takes the next."""

    def __init__(self, kind: _Kind, scenarios: dict[int, Scenario]) -> None:
        self.scenarios = scenarios
        self.intervals = {k: sample_intervals(scenario) for k, scenario in scenarios.items()}
        self.slots: list[_Slot | None] = [None] * WIDTH
        self.results: dict[int, Torque | SimulationError] = {}
        factor = max(w.factor for w in self.intervals.values())
        samples = max(scenario.record.samples for scenario in scenarios.values())
        self.group = stepper.drive_group(
            *kind,
            taps=2 * half_length(factor) + 1,
            waiting=SAMPLES_AT_ONCE * factor,
            samples=samples,
            microsteps=MICROSTEPS_AT_ONCE,
        )

    def run(self) -> dict[int, Torque | SimulationError]:
        """Results by index."""
        waiting, flags = iter(self.scenarios), self.group.flags
        while True:
            for lane in range(WIDTH):
                self._refill(lane, waiting)
            if not np.any(flags[:, stepper.STATUS] == stepper.RUNNING):
                return self.results
            stepper.advance(self.group)

    def _refill(self, lane: int, waiting: Iterator[int]) -> None:
        """Give a lane what it waits for, microsteps or the next scenario, until it runs or none is left."""
        flags = self.group.flags[lane]
        while flags[stepper.STATUS] != stepper.RUNNING:
            slot = self.slots[lane]
            if slot and flags[stepper.STATUS] != stepper.WANTS_MICROSTEPS:
                self.results[slot.index] = self._result(lane, slot)
                slot = self.slots[lane] = None
            index = slot.index if slot else next(waiting, None)
            if index is None:
                flags[stepper.STATUS] = stepper.IDLE
                return
            try:
                slot = slot or self._load(lane, index)
                self._give_microsteps(lane, slot)
            except SimulationError as error:
                self.results[index] = error
                slot = None
            self.slots[lane] = slot

    def _result(self, lane: int, slot: _Slot) -> Torque | SimulationError:
        c, n = self.group, slot.packed.state.y.size
        if c.flags[lane, stepper.STATUS] == stepper.FAILED:
            now = float(c.state[n + 2 + kernel.NOW, lane])
            return stopped(slot.scenario, int(c.flags[lane, stepper.CODE]), now)
        samples = c.out[lane, : slot.scenario.record.samples].copy()
        return slot.torque(samples, c.state[:n, lane], c.control[lane], int(c.counters[lane, kernel.STEPS]))

    def _load(self, lane: int, index: int) -> _Slot:
        """Load a scenario into a lane, at rest."""
        slot = _Slot(index, self.scenarios[index], self.intervals[index])
        c, state, record = self.group, slot.packed.state, slot.scenario.record
        stepper.load_drive(c, lane, slot.packed.drive)
        c.state[:, lane] = np.concatenate([state.y, state.stick, state.clock])
        c.counters[lane] = 0
        intervals, k, g = slot.intervals, c.control[lane], c.flags[lane]
        k[:], g[:] = 0.0, 0
        k[stepper.END], k[stepper.FIRST], k[stepper.INTERVAL] = intervals.end, intervals.first, intervals.width
        k[stepper.RECORD_START], k[stepper.RECORD_END] = (
            record.settle,
            record.settle + record.samples / record.sample_rate,
        )
        c.taps[lane] = 0.0
        filter_taps = taps(intervals.factor)
        c.taps[lane, : filter_taps.size] = filter_taps
        g[stepper.FACTOR], g[stepper.TAPS], g[stepper.ROWS] = intervals.factor, filter_taps.size, intervals.rows
        g[stepper.MISSING], g[stepper.SAMPLES] = intervals.missing, record.samples
        return slot

    def _give_microsteps(self, lane: int, slot: _Slot) -> None:
        """Load a lane's next microsteps."""
        c, known = self.group, self.group.control[lane, stepper.KNOWN_UNTIL]
        stop = min(known + slot.stretch, slot.intervals.end)
        times, references = slot.command.microsteps(float(known), float(stop))
        c.times[lane, : times.size], c.references[lane, : times.size] = times, references
        c.flags[lane, [stepper.COMING, stepper.KNOWN]] = 0, times.size
        c.control[lane, stepper.KNOWN_UNTIL] = stop
        c.flags[lane, stepper.STATUS] = stepper.RUNNING
