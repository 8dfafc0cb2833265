"""The steady state of a scenario and its lines; where there is none, time integration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from microvib.analysis.lines import lines
from microvib.errors import expect
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.solve.integration import Progress, from_rest
from microvib.solve.motion import Invariants, Motion
from microvib.solve.steady.state import SteadyState, find_steady


@dataclass(frozen=True)
class Steady:
    """Lines at constant rate, from the steady state or, where ``fallback`` says why not, from time integration."""

    lines: LineTable
    source: SteadyState | Motion
    fallback: str = ""

    @property
    def state(self) -> SteadyState | None:
        """The steady state, if there is one."""
        return self.source if isinstance(self.source, SteadyState) else None

    @property
    def invariants(self) -> Invariants:
        """What should have held; of a steady state the motion is run once more for it."""
        return self.source.invariants

    @property
    def solver(self) -> dict[str, Any]:
        """How it was solved."""
        return self.source.solver


def steady(scenario: Scenario, *, harmonics: int = 8, progress: Progress | None = None) -> Steady:
    """Lines of the disturbance torque of ``scenario`` in its steady state, without simulating how it settles.

    Where the motion does not repeat with the command, or not in one way only, the scenario is simulated in time instead, and
    ``fallback`` says why. Raises what ``simulate`` raises.
    """
    expect(scenario, Scenario, "a scenario (mv.load_scenario)")
    state, why = find_steady(scenario)
    source = state or from_rest(scenario, channels=("T_d",), progress=progress)
    return Steady(lines(source, harmonics=harmonics), source, why)
