"""Routes of pointing budgets, and reports of studies that are done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fastapi import APIRouter
from fastapi.responses import FileResponse

from microvib.errors import OptionError, ScenarioError
from microvib.io.file_access import FileAccess, sent_files
from microvib.model.coupling import require_craft
from microvib.studies.angles import angles_in
from microvib.studies.budget.files import OtherSource
from microvib.web.jobs.budget_designs import Design
from microvib.web.routes.common import (
    RequestRefused,
    StoreDependency,
    ask,
    refusals,
    requested,
    start,
)
from microvib.web.routes.forms import NOT_SENT
from microvib.web.routes.messages import BudgetOf, Id, Started
from microvib.web.routes.new_jobs import check_size
from microvib.web.routes.results import done, there

WITH_REPORTS = ("budget", "envelope", "hammer", "acceptance")
"""Kinds of computations that leave a report."""
REPORTS = {"report.html": "text/html", "report.pdf": "application/pdf"}

routes = APIRouter()


@routes.post("/budgets", status_code=202, responses=refusals(429))
def start_budget(want: BudgetOf, store: StoreDependency) -> Started:
    """Budget the line of sight of a craft against requirements."""
    scenario = requested(store, want.scenario)
    require_craft(scenario)
    check_size(scenario, store.limits.record)
    files = sent_files(Path(), want.tables, NOT_SENT)
    several: dict[str, Any] = {}
    if want.angles or want.orbit:
        angles = angles_in(want.angles) if want.angles else None
        several = {"angles": angles, "orbit": want.orbit}
    required, sources = (
        _read(store, key, text)
        for key, text in (("requirement", want.requirement), ("sources", want.sources))
    )
    listed = () if sources is None else sources.sources
    _check_tables(listed, files)
    title = f"pointing budget of {scenario.title}"
    second = _second_design(store, want, listed)
    if second is not None:
        _check_tables(second.sources, files)
        title = f"{title} and {second.scenario.title}"
    return start(
        store, "budget", title, want, scenario=scenario,
        required=required, sources=listed, tables=want.tables,
        how={"rule": want.rule, "one_clock": want.one_clock, "steady": want.steady}, several=several,
        second=second,
    )  # fmt: skip


def _second_design(
    store: StoreDependency, want: BudgetOf, sources: Sequence[OtherSource]
) -> Design | None:
    """The design that is compared, with its own sources or the first one's; None where there is none."""
    if want.other is None and not want.other_sources.strip():
        return None
    if not want.requirement.strip():
        raise OptionError(
            "requirement", "is missing; two designs are judged by the same requirements"
        )
    scenario = requested(store, want.scenario if want.other is None else want.other)
    require_craft(scenario)
    check_size(scenario, store.limits.record)
    own = _read(store, "sources", want.other_sources)
    return Design(scenario, sources if own is None else own.sources)


def _read(store: StoreDependency, key: str, text: str) -> Any:
    """Requirements or sources of a text, which a worker reads; None of an empty one; Refused with the
    first thing that is wrong with it, which is about ``key``.
    """
    if not text.strip():
        return None
    try:
        return ask(store, "budget_file", kind=key, text=text)
    except RequestRefused as error:
        if error.status != 422:
            raise
        raise RequestRefused(422, error.sentence.partition("\n")[0], key) from None


def _check_tables(sources: Sequence[OtherSource], files: FileAccess) -> None:
    """Refused where sources name a table that did not come with the request."""
    for source in sources:
        for key, name in source.tables.items():
            try:
                files.under(f"{source.name}: {key}").path(name)
            except ScenarioError as error:
                raise RequestRefused(422, f"sources: {error}", "sources") from None


@routes.get(
    "/studies/{id}/files/{name}", response_class=FileResponse,
    responses=refusals(404, 409) | {200: {"content": {kind: {} for kind in REPORTS.values()}}},
)  # fmt: skip
def report_of(id: Id, name: str, store: StoreDependency) -> FileResponse:
    """The report of a study that is done, which was made with its result."""
    if name not in REPORTS:
        raise RequestRefused(404, f"there is no such file; there are {', '.join(REPORTS)}")
    job = done(store, id)
    if job.kind not in WITH_REPORTS:
        raise RequestRefused(404, f"this computation is not one of: {', '.join(WITH_REPORTS)}")
    file = there(store.folder(job) / name)
    return FileResponse(file, media_type=REPORTS[name], filename=name)
