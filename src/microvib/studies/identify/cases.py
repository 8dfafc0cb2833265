"""Tests as they are simulated for an identification: runs in time, or steady states in their place."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

from microvib.analysis.lines import lines_by_name, lines_by_name_of_steady_state
from microvib.errors import SimulationError
from microvib.model.scenario import Scenario
from microvib.solve.batch import Torque, simulate_torques
from microvib.solve.steady.state import SteadyState, is_searched, steady_by_search
from microvib.studies.evidence import Evidence, Simulated

LEAST_RUN = 30.0
"""Length of a run [s] from which steady states take its place: one takes as long as a run of some 8 s."""


def has_steady_states(test: Scenario) -> bool:
    """Whether steady states are searched for in place of runs of a test: of short runs they save
    nothing.
    """
    return test.record.settle + test.record.duration >= LEAST_RUN and is_searched(test)


@dataclass(frozen=True)
class Case:
    """A test to simulate at one of many points."""

    point: int
    test: Scenario
    evidence: Evidence
    solved: bool
    """Whether the steady state stands for a run."""
    begun: SteadyState | None
    """Steady state from which it is searched, that of a point near by."""
    runs_else: bool
    """Whether it is run where no steady state is found."""

    @property
    def asked(self) -> set[str]:
        """Lines that the evidence has."""
        observations = self.evidence.observations
        return {name for o in observations for name in (o.line, o.against) if name}

    def simulated(self) -> Simulated | None:
        """Its lines; None where the motion is lost."""
        if not self.solved:
            return self._run()
        steady = self._steady()
        if steady is None and self.runs_else:
            return self._run()
        return steady

    def _run(self) -> Simulated | None:
        """Lines of a run in time."""
        (torque,) = simulate_torques([self.test])
        if not isinstance(torque, Torque):
            return None
        table = lines_by_name(torque, self.test, self.asked, self.evidence.harmonics)
        return Simulated(table, torque.T_d, torque.sample_rate)

    def _steady(self) -> Simulated | None:
        """Lines of its steady state; None where none is found at once, or where it does not tell how
        an observed mode rings.
        """
        state = self._steady_state()
        if state is None:
            return None
        asked = self.asked
        table = lines_by_name_of_steady_state(state, asked, self.evidence.harmonics)
        if any(line.is_mode and line.name in asked and math.isnan(line.decay) for line in table):
            return None
        return Simulated(table, state.T_d, state.T_d.size * state.frequency, state)

    def _steady_state(self) -> SteadyState | None:
        """Its steady state, searched from the other one or, where that ends, anew."""
        with suppress(SimulationError):
            return steady_by_search(self.test, self.begun)
        if self.begun is not None:
            with suppress(SimulationError):
                return steady_by_search(self.test)
        return None
