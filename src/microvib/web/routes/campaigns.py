"""Routes of campaigns and sweeps: started, gone on with, looked at while they run, their cases and files."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse

from microvib.errors import OptionError, ScenarioError
from microvib.io.limit_files import limit_from_text
from microvib.io.scenario_file import parse_value
from microvib.model.sentences import validate_part
from microvib.studies.campaign.design import design as draw_cases
from microvib.studies.campaign.study_file import Sampling, Study
from microvib.studies.campaign.variation import ARRAY
from microvib.web.jobs.campaigns import CAMPAIGN, SO_FAR
from microvib.web.jobs.processes import ENDED, Job, QueueFull
from microvib.web.jobs.store import Store
from microvib.web.routes.common import (
    RequestRefused,
    StoreDependency,
    ask,
    busy,
    refusals,
    requested,
    start,
)
from microvib.web.routes.forms import FILES
from microvib.web.routes.messages import CampaignOf, CaseOf, Given, Id, Result, Started, SweepOf
from microvib.web.routes.new_jobs import check_size

SCENARIO = "scenario.yaml"
"""Name of the scenario's file in a study, which lies beside it."""
_NAME = "campaign"
_FILES = {
    "study.yaml": "text/yaml",
    SCENARIO: "text/yaml",
    "results.nc": "application/x-netcdf",
    "report.html": "text/html",
    "report.pdf": "application/pdf",
}

routes = APIRouter(responses=refusals(404))


@routes.post("/campaigns", status_code=202, responses=refusals(429))
def start_campaign(want: CampaignOf, store: StoreDependency) -> Started:
    """Draw the cases of a campaign and compute them."""
    scenario = requested(store, want.scenario)
    check_size(scenario, store.limits.record // (os.cpu_count() or 1))
    try:
        drawn = draw_cases(study_of(want), FILES, _NAME, scenario)
    except ScenarioError as error:
        raise _refused(error, want.vary) from None
    if drawn.cases > store.limits.campaign:
        raise OptionError(
            "count",
            f"makes {drawn.cases} cases; at most {store.limits.campaign} are computed here, and all by"
            " `microvib campaign`",
        )
    title = want.title or f"campaign of {scenario.title}"
    return start(store, "campaign", title, want, design=drawn)


@routes.post("/sweeps", status_code=202, responses=refusals(429))
def start_sweep(want: SweepOf, store: StoreDependency) -> Started:
    """Lines over one value, from one end to another: the grid of a campaign with one key."""
    scenario = requested(store, want.scenario)
    check_size(scenario, store.limits.record // (os.cpu_count() or 1))
    if want.key in ARRAY:
        raise OptionError("key", "is not a number of the scenario; the page opens no files")
    grid = {
        "from": parse_value(want.low),
        "to": parse_value(want.high),
        "count": want.count,
    }
    try:
        study = validate_part(Study, {"scenario": SCENARIO, "vary": {want.key: grid}}, origin=_NAME)
        drawn = draw_cases(study, FILES, _NAME, scenario)
    except ScenarioError as error:
        raise _refused_end(error, want.key) from None
    title = f"{want.key} of {scenario.title}"
    return start(store, "sweep", title, want, design=drawn, key=want.key, linear=want.linear)


def _refused_end(error: ScenarioError, key: str) -> RequestRefused:
    """Refusal of an end of a sweep, which it names."""
    sentence = str(error).split("\n")[0].removeprefix(f"{_NAME}: ").removeprefix(f"vary.{key}")
    field = sentence.lstrip(".").partition(":")[0]
    return RequestRefused(422, sentence.lstrip(".: "), field if field in ("from", "to") else "key")


def study_of(want: CampaignOf) -> Study:
    """The study file of a request; ScenarioError or OptionError where it is none."""
    files = [key for key in want.vary if key in ARRAY]
    if files:
        raise OptionError(files[0], "cannot vary here; the page opens no files")
    entries: dict[str, Any] = {
        "title": want.title,
        "scenario": SCENARIO,
        "vary": {key: _variation(given) for key, given in want.vary.items()},
        "sampling": Sampling(
            method=want.method, count=want.count, seed=want.seed, noise=want.noise
        ).model_dump(),
        "solve": want.solve,
        "band": want.band or None,
    }
    return validate_part(Study, entries | _limit(want.limit), origin=_NAME)


def _refused(error: ScenarioError, varied: Iterable[str]) -> RequestRefused:
    """The first sentence of an error about a study, and the field of the request that it is about."""
    sentence = str(error).split("\n")[0].removeprefix(f"{_NAME}: ")
    subject = sentence.partition(": ")[0]
    inside = [key for key in varied if f"{subject}.".startswith(f"vary.{key}.")]
    if inside:
        return RequestRefused(422, sentence, max(inside, key=len))
    field = subject.rpartition(".")[2]
    return RequestRefused(422, sentence, field if field in CampaignOf.model_fields else None)


def _variation(given: list[str] | Given) -> Any:
    """A list, a grid or a distribution as a study file has it."""
    if isinstance(given, list):
        return [parse_value(text) for text in given]
    return {key: parse_value(text) for key, text in given.items()}


def _limit(text: str | None) -> dict[str, Any]:
    """The entry of a limit in a study: a torque, or points of the curve whose table ``text`` is."""
    if not text:
        return {}
    if "\n" not in text:
        return {"limit": text}
    curve = limit_from_text(text).torque_curve("a campaign")
    points = zip(curve.frequency, curve.amplitude, strict=True)
    return {
        "limit_curve": [{"frequency": f"{f!r} Hz", "amplitude": f"{a!r} N*m"} for f, a in points]
    }


@routes.post("/campaigns/{id}/resume", status_code=202, responses=refusals(409, 429))
def resume(id: Id, store: StoreDependency) -> Started:
    """Go on with a campaign that was stopped: computed cases are not computed again."""
    job = _campaign(store, id)
    if job.state not in ENDED:
        raise RequestRefused(409, "this campaign is under way")
    if job.state == "done":
        raise RequestRefused(409, "all cases of this campaign are computed")
    try:
        return Started(id=store.resume(job).id)
    except QueueFull:
        raise busy(store) from None


@routes.get("/campaigns/{id}/so-far", response_model=Result)
def so_far(id: Id, store: StoreDependency) -> Response:
    """Results so far of a campaign that is under way or was stopped; all of them when it is done;
    empty where no case is computed yet."""
    folder = store.folder(_campaign(store, id))
    for name in ("result.json", SO_FAR):
        if (folder / name).is_file():
            return Response((folder / name).read_bytes(), media_type="application/json")
    return Response("{}", media_type="application/json")


@routes.get("/campaigns/{id}/cases/{number}", responses=refusals(409, 429))
def case_of(id: Id, number: int, store: StoreDependency) -> CaseOf:
    """A case as changes of the scenario that the campaign varies."""
    if number < 0:
        raise OptionError("number", f"{number} is not allowed; cases are numbered from 0")
    folder = _whole(store, id)
    return CaseOf.model_validate(ask(store, "campaign_case", folder=folder, number=number))


@routes.get(
    "/campaigns/{id}/files/{name}", response_class=FileResponse,
    responses=refusals(409, 429) | {200: {"content": {kind: {} for kind in _FILES.values()}}},
)  # fmt: skip
def file_of(id: Id, name: str, store: StoreDependency) -> FileResponse:
    """A file of a campaign that has ended: study and scenario, which `microvib campaign create` takes;
    results; its report.
    """
    if name not in _FILES:
        raise RequestRefused(404, f"there is no such file; there are {', '.join(_FILES)}")
    job = _campaign(store, id)
    if job.state not in ENDED:
        raise RequestRefused(409, "this campaign is under way")
    folder = _whole(store, id)
    if not name.startswith("report."):
        path = store.folder(job) / CAMPAIGN / name
    else:
        ask(store, "campaign_report", folder=folder, name=name)
        path = store.folder(job) / name
    if not path.is_file():
        raise RequestRefused(409, "this file is not there before cases are computed")
    return FileResponse(path, media_type=_FILES[name], filename=name)


def _campaign(store: Store, id: str) -> Job:
    job = store.job(id)
    if job is None or job.kind != "campaign":
        raise RequestRefused(404, "no such campaign, or it was dropped; start it again")
    return job


def _whole(store: Store, id: str) -> str:
    """Folder of a campaign that has its cases."""
    folder = store.folder(_campaign(store, id))
    if not (folder / CAMPAIGN).is_dir():
        raise RequestRefused(409, "this campaign has not begun yet")
    return str(folder)
