"""Searches for a quieter drive, and tables that are judged: the texts of a request are the only files that
are opened.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from microvib.errors import MicrovibError, OptionError
from microvib.io.file_access import FileAccess
from microvib.io.tables import to_json
from microvib.model.scenario import Scenario
from microvib.studies.quiet.cases import draw_cases
from microvib.studies.quiet.lever_options import parse_levers
from microvib.studies.quiet.levers import Lever, TableLimits
from microvib.studies.quiet.objective import parse_objective
from microvib.studies.quiet.study import (
    Constraints,
    files_of_study,
    require_seen,
    require_table_alone,
    with_given_table,
)
from microvib.studies.quiet.study import quiet as search_quieter
from microvib.units import Si
from microvib.web.jobs import ProgressCallback, results
from microvib.web.jobs.sent_tables import sent_tables
from microvib.web.routes.forms import FILES

CURVE, REQUIREMENT, STUDY, TABLE = "curve.csv", "requirement.yaml", "study.yaml", "table.csv"
"""Names of the texts of a request, by which messages call them."""


@dataclass(frozen=True)
class QuietRequest:
    """Options of ``quiet``; those that name files name texts of the request."""

    scenario: Scenario
    objective: str
    levers: list[str]
    bits: int | None
    table_rows: int
    cases: int
    effort: int
    constraints: Constraints
    texts: Mapping[str, str]

    def named(self, text: str) -> str | None:
        """The name of a text that came with the request, as an option takes it; None of others."""
        return text if text in self.texts else None


def quiet(folder: str, request: QuietRequest, limit: Si | None, tell: ProgressCallback) -> None:
    """A quieter drive, or a table that is judged. No figures are kept."""
    best = ["judging" if request.named(TABLE) else "searching"]
    with sent_tables(Path(folder), request.texts, FILES.refusal) as files:
        found = search_quieter(
            request.scenario, request.objective, request.levers,
            requirement=request.named(REQUIREMENT), study=request.named(STUDY),
            check=request.named(TABLE), constraints=request.constraints, bits=request.bits,
            table_rows=request.table_rows, cases=request.cases, effort=request.effort, files=files,
            progress=lambda done, total: tell(done, total, "runs", best[-1]),
            on_best=lambda text: best.append(f"best so far {text}"),
        )  # fmt: skip
    result = results.quiet_result(found, limit)
    (Path(folder) / "result.json").write_text(to_json(result), encoding="utf-8")


def quiet_problem(
    folder: str, request: QuietRequest, most_cases: int, tell: ProgressCallback
) -> dict[str, str] | None:
    """The first thing that is wrong with a request, with the field that it is about; None of one that can
    be searched. ``most_cases`` may judge.
    """
    for field, read in _fields(request, most_cases).items():
        try:
            with sent_tables(Path(folder), request.texts, FILES.refusal) as files:
                read(files)
        except MicrovibError as error:
            own = error.key if isinstance(error, OptionError) else field
            return {"key": own, "sentence": str(error).partition("\n")[0]}
    return None


def _fields(request: QuietRequest, most_cases: int) -> dict[str, Callable[[FileAccess], object]]:
    """Readers of the fields of a request, each of which raises what is wrong with its own."""
    scenario, requirement = request.scenario, request.named(REQUIREMENT)

    def levers(files: FileAccess) -> tuple[Lever, ...]:
        if request.named(TABLE) is not None:
            require_table_alone(request.levers, request.bits)
            return ()
        found = parse_levers(
            request.levers, scenario, TableLimits(request.bits, request.table_rows)
        )
        require_seen(found, parse_objective(request.objective, scenario, requirement, files))
        return found

    def study(files: FileAccess) -> None:
        file = files.path(STUDY)
        drawn = draw_cases(
            scenario, levers(files), file, request.cases, files_of_study(files, STUDY)
        )
        if len(drawn.judged) > most_cases:
            raise OptionError(
                "study",
                f"makes {len(drawn.judged)} cases; at most {most_cases} are computed here, and all by"
                " `microvib quiet`",
            )

    reading: dict[str, Callable[[FileAccess], object]] = {
        "requirement" if requirement else "objective": lambda files: parse_objective(
            request.objective, scenario, requirement, files
        ),
        "lever": levers,
    }
    if request.named(TABLE):
        reading["check"] = lambda files: with_given_table(
            scenario, files.path(TABLE), request.table_rows
        )
    if request.named(STUDY):
        reading["study"] = study
    return reading
