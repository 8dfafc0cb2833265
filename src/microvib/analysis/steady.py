"""The steady state of a scenario and its lines; where there is none, the run in time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from microvib.model.expected import expected_lines
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import lines_of_series
from microvib.signals.line_fit import estimate_lines
from microvib.signals.line_table import LineTable
from microvib.solve.motion import Invariants, Motion, series_of, unit_of
from microvib.solve.sampling import PASSBAND
from microvib.solve.simulate import Progress, from_rest
from microvib.solve.steady.period import NotPeriodic
from microvib.solve.steady.state import SteadyState, steady_state


@dataclass(frozen=True)
class Steady:
    """Lines at constant rate, from the steady state or, where ``fallback`` says why not, from the run in time."""

    lines: LineTable
    source: SteadyState | Motion
    fallback: str = ""

    @property
    def state(self) -> SteadyState | None:
        """The steady state, if there is one."""
        return self.source if isinstance(self.source, SteadyState) else None

    @property
    def invariants(self) -> Invariants:
        """What must have held; of a steady state the motion is run once more for it."""
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
    state, why = find_steady(scenario)
    if state is not None:
        return Steady(steady_lines(state, harmonics=harmonics), state)
    motion = from_rest(scenario, channels=("T_d",), progress=progress)
    expected = expected_lines(scenario, PASSBAND * motion.sample_rate, harmonics)
    table = estimate_lines(motion["T_d"], motion.sample_rate, expected)
    return Steady(table, motion, why)


def find_steady(scenario: Scenario) -> tuple[SteadyState | None, str]:
    """The steady state, or None and why there is none."""
    try:
        return steady_state(scenario), ""
    except NotPeriodic as why:
        return None, str(why)


def steady_lines(state: SteadyState, channel: str = "T_d", harmonics: int = 8) -> LineTable:
    """Lines of one channel of a steady state, named as those of a record, with its bins and its first sample's phases."""
    if channel != "T_d":
        series_of(state.channels, channel, state.scenario.array)
    record = state.scenario.record
    highest = PASSBAND * record.sample_rate
    series = state.harmonics(channel)[: int(highest / state.frequency) + 1]
    expected = expected_lines(state.scenario, highest, harmonics)
    table = lines_of_series(series, state.frequency, state.microsteps, expected, record.samples, record.sample_rate)
    return replace(table, unit=unit_of(channel))
