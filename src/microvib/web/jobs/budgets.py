"""Pointing budgets of the page: the texts of a request as requirements and sources, and the tables that came
with it, which are the only files that are opened.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from microvib.errors import MicrovibError
from microvib.io.file_access import FileAccess, sent_files
from microvib.model.scenario import Scenario
from microvib.reports.budget import budget_outcome
from microvib.studies.budget.angles import budget_over_angles
from microvib.studies.budget.files import OtherSource, Requirements, Sources, from_text
from microvib.studies.budget.study import pointing_budget
from microvib.web.jobs import ProgressCallback
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
) -> None:
    """A pointing budget; ``how`` are options of ``pointing_budget``, ``several`` those of
    ``budget_over_angles``, empty for the scenario's own angle.
    """

    def progress(done: float, total: float) -> None:
        tell(done, total, "s", "simulating" if done < total else "lines and report")

    judge = budget_over_angles if several else pointing_budget
    with sent_tables(Path(folder), tables) as files:
        found = judge(
            [scenario], required, sources=sources, names=[DRIVE], files=files, progress=progress,
            **how, **several,
        )  # fmt: skip
    keep_study(Path(folder), budget_outcome(found))


@contextmanager
def sent_tables(folder: Path, tables: Mapping[str, str]) -> Iterator[FileAccess]:
    """Permission to open the ``tables`` of a request, name and text, and no other file; errors call
    them by these names.
    """
    with TemporaryDirectory(dir=folder) as place:
        for name, text in tables.items():
            with open(Path(place) / name, "x", encoding="utf-8") as stream:
                stream.write(text)
        try:
            yield sent_files(Path(place), tables, NOT_SENT)
        except MicrovibError as error:
            raise MicrovibError(str(error).replace(f"{place}{os.sep}", "")) from None
