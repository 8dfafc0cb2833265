"""Margin against lost steps of a pulsed drive: over which values of one key steps are lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np

from microvib.errors import (
    MicrovibError,
    OptionError,
    SimulationError,
    did_you_mean,
    whole_number,
)
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.results import COUNT, Column
from microvib.solve.integration import Progress, simulate_from_rest
from microvib.studies.workers import Calls, parallel_calls
from microvib.units import Quantity, convert

DEFAULT_COUNT, COUNT_RANGE = 11, (2, 1000)
"""Values that are run over the range at first, and how many there may be."""
HALVINGS = 4
"""How often the interval between two such values is halved where steps are lost at one of them."""
State = Literal["made", "lost", "not known"]


@dataclass(frozen=True)
class StepRun:
    """A run with one value: steps judged, and those lost and gained."""

    value: float
    """In SI."""
    judged: Annotated[int, Column("judged", "steps", COUNT)]
    lost: Annotated[int, Column("lost", "lost", COUNT)]
    gained: Annotated[int, Column("gained", "gained", COUNT)]
    first: Annotated[int, Column("first_not_made", "first not made", COUNT)]
    """Number of the first step that was not made as commanded, from 1; 0 where all were."""
    problem: str = ""
    """Why it could not be simulated; empty where it was."""

    @property
    def state(self) -> Annotated[State, Column("state", "state")]:
        """Whether all steps were made."""
        if self.problem:
            return "not known"
        if self.lost or self.gained:
            return "lost"
        return "made"


@dataclass(frozen=True)
class Edge:
    """Two neighbouring values between which steps begin, or cease, to be lost."""

    below: StepRun
    above: StepRun

    @property
    def begins(self) -> bool:
        """Whether steps are lost above it."""
        return self.above.state == "lost"


@dataclass(frozen=True)
class StepMargin:
    """Where steps are lost over the range of one key."""

    scenario: Scenario
    key: str
    low: float
    """Ends of the range, in SI."""
    high: float
    runs: tuple[StepRun, ...]
    """By value."""

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Where runs that make all steps have neighbours that lose some."""
        known = [run for run in self.runs if run.state != "not known"]
        return tuple(Edge(a, b) for a, b in pairwise(known) if a.state != b.state)

    @property
    def losing(self) -> tuple[StepRun, ...]:
        """Runs that lose steps."""
        return tuple(run for run in self.runs if run.state == "lost")

    @property
    def unknown(self) -> tuple[StepRun, ...]:
        """Runs that could not be simulated."""
        return tuple(run for run in self.runs if run.state == "not known")


def step_margin(
    scenario: GivenScenario,
    over: str,
    count: int = DEFAULT_COUNT,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> StepMargin:
    """Find over which values of one key a pulsed drive loses steps.

    Values are run in equal distances over the range; where steps are lost at one and not at its
    neighbour, the interval between them is halved four times. What happens in between is not known:
    steps may be lost in narrow bands, as where a resonance of the array meets the step rate. Runs
    start at rest and are as long as the record of the scenario with its settling time.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive, with ``driver.drive: pulse``: a scenario, a name of the catalog, or the path of a
        scenario file.
    over : str
        Key and range with a unit, such as ``"driver.supply_voltage=60:80 V"``.
    count : int
        Values over the range, its ends among them.
    workers : int, optional
        Processes that share the runs; without it threads of this one do.
    progress : callable, optional
        Called as ``progress(done, total)`` with runs.

    Returns
    -------
    StepMargin
        Every run by its value, and the edges between values that lose steps and those that do not.

    Raises
    ------
    OptionError
        For a key that the scenario has not, a range that is none, a wrong count.
    ScenarioError
        Where a name stands for no scenario, or a value of the range is not allowed.
    MicrovibError
        For a drive that is not pulsed, or a record without two steps.
    """
    scenario = as_scenario(scenario)
    whole_number("count", count, *COUNT_RANGE)
    if not scenario.driver.pulsed:
        raise MicrovibError(
            f"driver.drive: is {scenario.driver.drive}; a drive that holds its currents loses"
            " synchronism, which ends its run; pulse is expected where lost steps are counted"
        )
    key, low, high = _range(scenario, over)
    for end in (low, high):
        scenario.with_si({key: end})
    found: dict[float, StepRun] = {}
    with parallel_calls(progress, workers) as calls:
        _run_all(scenario, key, np.linspace(low, high, count).tolist(), found, calls)
        for _ in range(HALVINGS):
            margin = StepMargin(scenario, key, low, high, _by_value(found))
            middles = [0.5 * (edge.below.value + edge.above.value) for edge in margin.edges]
            if not middles:
                break
            _run_all(scenario, key, middles, found, calls)
    return StepMargin(scenario, key, low, high, _by_value(found))


def _by_value(found: dict[float, StepRun]) -> tuple[StepRun, ...]:
    return tuple(found[value] for value in sorted(found))


def _run_all(
    scenario: Scenario, key: str, values: Iterable[float], found: dict[float, StepRun], calls: Calls
) -> None:
    new = [value for value in values if value not in found]
    each = calls(partial(_run, scenario, key), [(value,) for value in new])
    found.update(zip(new, each, strict=True))


def _run(scenario: Scenario, key: str, value: float) -> StepRun:
    """A run with one value."""
    try:
        motion = simulate_from_rest(scenario.with_si({key: value}), channels=("T_d",))
    except SimulationError as error:
        return StepRun(value, 0, 0, 0, 0, str(error))
    steps = motion.steps
    assert steps is not None
    if steps.judged == 0:
        raise MicrovibError(
            "record.duration: no step is judged, since none is followed by another within the"
            " record; a longer record is expected"
        )
    return StepRun(value, steps.judged, steps.lost, steps.gained, steps.first)


def _range(scenario: Scenario, over: str) -> tuple[str, float, float]:
    """Key and range [SI] of ``KEY=LOW:HIGH``; the first bound may go without the unit of the second."""
    key, _, span = (part.strip() for part in over.partition("="))
    numbers = dict(_numbers(scenario))
    if key not in numbers:
        near = did_you_mean(key, list(numbers))
        raise OptionError(
            "over",
            f"is not a number of the scenario; {near}allowed are {', '.join(numbers)}",
            key,
        )
    unit = numbers[key].unit
    low_text, colon, high_text = (part.strip() for part in span.partition(":"))
    if not any(c.isalpha() for c in low_text):
        low_text = f"{low_text} {high_text.lstrip('+-.0123456789eE ')}".strip()
    write = f"write KEY=LOW:HIGH with a unit ({unit or 'none'}), such as {key}={_example(scenario, key)}"
    if not colon:
        raise OptionError("over", f"is no range; {write}", over)
    try:
        low, high = convert(low_text, unit), convert(high_text, unit)
    except ValueError as error:
        raise OptionError("over", f"{error}; {write}", over) from None
    if not low < high:
        raise OptionError("over", f"LOW must be below HIGH; {write}", over)
    return key, low, high


def _numbers(scenario: Scenario) -> Iterator[tuple[str, Quantity]]:
    """Keys of the drive and of what it carries that are numbers."""
    for key, value, quantity in scenario.entries():
        of_drive = not key.startswith(("record.", "solver.", "tracking."))
        if of_drive and quantity is not None and isinstance(value, float):
            yield key, quantity


def _example(scenario: Scenario, key: str) -> str:
    """A range about the value of a key."""
    value = float(scenario[key])
    low, high = sorted((0.8 * value, 1.2 * value)) if value else (0.0, 1.0)
    return f"{scenario.shown(key, low)}:{scenario.shown(key, high)}"
