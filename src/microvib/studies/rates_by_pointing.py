"""Rate planning by the line of sight: at which rates the drive's lines use least of what
requirements allow.

Cases are compared by the drive's lines alone. What other sources, gaps and uncertainties add is for
``pointing_budget``, which judges the best of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.lines import find_lines
from microvib.analysis.margins import Verdict
from microvib.errors import MicrovibError, OptionError, whole_number
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.results import FREQUENCY, MICROSTEPS, POINTING_ANGLE, RATE, SHARE, Column
from microvib.solve.integration import Progress, simulate_from_rest
from microvib.solve.on_craft import LINE_OF_SIGHT_ACCELERATIONS
from microvib.solve.steady.state import find_steady
from microvib.studies.budget.files import Requirement, Requirements, read_file
from microvib.studies.budget.study import Budget, pointing_budget
from microvib.studies.quiet.objective import part_of_limit, quickly_judged
from microvib.studies.rates import at_rate, rates_and_counts
from microvib.studies.workers import parallel_calls
from microvib.units import GivenQuantity, Si

MAX_JUDGED = 100


@dataclass(frozen=True)
class PointingCase:
    """Motion of the line of sight by the drive's lines at one rate and microstep count."""

    microsteps: Annotated[int, MICROSTEPS]
    rate: Annotated[float, Column("rate_deg_s", "rate", RATE)]
    share: Annotated[float, Column("of_limit", "of the limit", SHARE, absent="failed")]
    """Largest part of a requirement's limit that the drive's lines use; nan where nothing is known."""
    requirement: Annotated[str, Column("requirement", "requirement")] = ""
    """The requirement of that part."""
    line: Annotated[str, Column("line", "largest line")] = ""
    frequency: Annotated[float, Column("frequency_hz", "at", FREQUENCY)] = math.nan
    amplitude: Annotated[float, Column("amplitude_rad", "amplitude", POINTING_ANGLE)] = math.nan
    """Amplitude of that line, the larger of both axes [rad]."""
    solved: Annotated[str, Column("solved", "solved", report_only=True)] = ""
    """Steady, or why in time, or why not at all."""


@dataclass(frozen=True)
class JudgedRate:
    """A case with the budget at its rate."""

    case: PointingCase
    budget: Budget

    @property
    def verdict(self) -> Verdict:
        """On all requirements."""
        return self.budget.verdict


@dataclass(frozen=True)
class PointingPlan:
    """Cases by microstep count and rate, and the best of them judged."""

    scenario: Scenario
    requirements: tuple[Requirement, ...]
    cases: tuple[PointingCase, ...]
    judged: tuple[JudgedRate, ...]
    """Least part of a limit first."""

    @property
    def best(self) -> JudgedRate | None:
        """The first of the judged that passes."""
        return next((one for one in self.judged if one.verdict == "pass"), None)


def plan_rates_by_pointing(  # noqa: PLR0913 - keyword options
    scenario: GivenScenario,
    rates: Sequence[GivenQuantity],
    requirement: str | Path,
    microsteps: Sequence[int] | None = None,
    *,
    sources: str | Path | None = None,
    judged: int = 1,
    workers: int | None = None,
    progress: Progress | None = None,
) -> PointingPlan:
    """Find what a drive's lines use of the limits on the line of sight at many rates, and judge the
    best rates with a budget.

    Parameters
    ----------
    scenario : Scenario, str or path
        A drive on a craft with a line of sight.
    rates : sequence of str or Si
        Rates of the array, as of ``plan_rates``.
    requirement : str or path
        File of requirements, as of ``pointing_budget``.
    microsteps : sequence of int, optional
        Microsteps a full step; without it the scenario's.
    sources : str or path, optional
        File of other sources, which the budgets of the best rates include.
    judged : int
        How many of the best rates are judged.
    workers : int, optional
        Processes that solve cases; without it threads.
    progress : callable, optional
        Called as ``progress(done, total)``, with the number of cases.

    Returns
    -------
    PointingPlan
        Every case, and the budgets of the best.

    Raises
    ------
    OptionError
        For lists that are empty, and a requirement that lacks something.
    MicrovibError
        If the scenario has no line of sight.
    """
    scenario = as_scenario(scenario)
    whole_number("judged", judged, 1, MAX_JUDGED)
    grid, counts = rates_and_counts(scenario, rates, microsteps)
    required = read_file(Path(requirement), Requirements)
    asked = quickly_judged(required.requirements, scenario)
    wanted = [(scenario, Si(rate), count, asked) for count in counts for rate in grid]
    with parallel_calls(progress, workers) as calls:
        cases: list[PointingCase] = calls(_case, wanted)
    known = sorted((x for x in cases if math.isfinite(x.share)), key=lambda x: x.share)
    if not known:
        raise OptionError("from", f"no rate could be solved: {cases[0].solved}")
    budgets = tuple(
        JudgedRate(
            case,
            pointing_budget(
                at_rate(scenario, Si(case.rate), case.microsteps),
                required,
                sources=() if sources is None else sources,
                steady=True,
            ),
        )
        for case in known[:judged]
    )
    return PointingPlan(scenario, required.requirements, tuple(cases), budgets)


def _case(
    scenario: Scenario, rate: Si, microsteps: int, asked: tuple[Requirement, ...]
) -> PointingCase:
    """Part of the limits that the drive's lines use at one rate."""
    changed = at_rate(scenario, rate, microsteps)
    try:
        state, why = find_steady(changed)
        kept = ("T_d", "stuck_output", "alpha_l", "alpha_m", *LINE_OF_SIGHT_ACCELERATIONS)
        source = state or simulate_from_rest(changed, channels=kept, balanced=False)
        lines = hub_lines(source, find_lines(source), los_only=True)
    except MicrovibError as error:
        return PointingCase(microsteps, rate, math.nan, solved=f"failed: {error}")
    assert lines.los is not None
    los = np.nan_to_num(lines.los)
    shares = [part_of_limit(one, lines.frequency, los) for one in asked]
    worst = int(np.argmax(shares))
    sizes = np.abs(los).max(axis=1, initial=0.0)
    solved = f"in time: {why}" if why else "steady"
    name = asked[worst].name or f"no. {worst + 1}"
    if not sizes.size:
        return PointingCase(microsteps, rate, shares[worst], name, solved=solved)
    top = int(np.argmax(sizes))
    frequency, size = float(lines.frequency[top]), float(sizes[top])
    return PointingCase(
        microsteps, rate, shares[worst], name, lines.names[top], frequency, size, solved
    )
