"""Pointing budgets of the page: the texts of a request as requirements and sources, and the tables that came
with it, which are the only files that are opened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from microvib.model.scenario import Scenario
from microvib.reports.budget import budget_outcome
from microvib.reports.designs import designs_outcome
from microvib.studies.budget.angles import budget_over_angles
from microvib.studies.budget.designs import Designs
from microvib.studies.budget.files import OtherSource, Requirements, Sources, from_text
from microvib.studies.budget.study import pointing_budget
from microvib.web.jobs import ProgressCallback
from microvib.web.jobs.budget_designs import Design
from microvib.web.jobs.sent_tables import sent_tables
from microvib.web.jobs.study_files import keep_study
from microvib.web.routes.forms import NOT_SENT

DRIVE = "drive"
"""Name of the drive among the sources of a budget."""


def budget_file(
    kind: Literal["requirement", "sources"], text: str, tell: ProgressCallback
) -> Requirements | Sources:
    """Requirements or sources of a text; ScenarioError says what is wrong with it."""
    if kind == "requirement":
        return from_text(text, Requirements, kind)
    return from_text(text, Sources, kind)


def budget(  # noqa: PLR0913 - what a process is sent
    folder: str,
    scenario: Scenario,
    required: Requirements | None,
    sources: Sequence[OtherSource],
    tables: Mapping[str, str],
    how: Mapping[str, Any],
    several: Mapping[str, Any],
    tell: ProgressCallback,
    second: Design | None = None,
) -> None:
    """A pointing budget, or that of two designs; ``how`` are options of ``pointing_budget``, ``several``
    those of ``budget_over_angles``, empty for the scenario's own angle.
    """
    designs = [Design(scenario, sources), *([] if second is None else [second])]

    def progress(done: float, total: float) -> None:
        tell(done, total, "s", "simulating" if done < total else "lines and report")

    judge = budget_over_angles if several else pointing_budget
    with sent_tables(Path(folder), tables, NOT_SENT) as files:
        found = [
            judge(
                [one.scenario], required, sources=one.sources, names=[DRIVE], files=files,
                progress=progress, **how, **several,
            )
            for one in designs
        ]  # fmt: skip
    if second is None:
        keep_study(Path(folder), budget_outcome(found[0]))
        return
    keep_study(Path(folder), designs_outcome(Designs(_names_of(designs), found[0], found[1])))


def _names_of(designs: Sequence[Design]) -> tuple[str, str]:
    """Names of two designs: their titles, where these tell them apart."""
    first, second = (one.scenario.title or DRIVE for one in designs)
    if first == second:
        return "the scenario in the form", "the second scenario"
    return first, second
