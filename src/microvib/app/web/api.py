"""The server's answers."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
from collections.abc import AsyncIterator
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, FastAPI, Query, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, StreamingResponse
from pydantic import Field
from starlette.exceptions import HTTPException
from starlette.staticfiles import StaticFiles

from microvib import __version__
from microvib.app.web import forms, series
from microvib.app.web.desk import Desk, Upload
from microvib.app.web.forms import Spec
from microvib.app.web.guard import Access, Guard
from microvib.app.web.lanes import ENDED, Busy, Job
from microvib.app.web.messages import (
    AnalysisOf,
    ComparisonOf,
    Entry,
    Form,
    IdentificationOf,
    Id,
    JobState,
    RatesOf,
    RecordingFacts,
    Result,
    Run,
    SasOf,
    Series,
    SpectrumOf,
    Started,
    View,
    Wrong,
)
from microvib.errors import MicrovibError, ScenarioError
from microvib.io.scenario_file import catalog_names, catalog_text, dump_scenario, parse_yaml
from microvib.model.scenario import Scenario

FILES = {
    "scenario.yaml": "text/yaml",
    "lines.csv": "text/csv",
    "summary.json": "application/json",
    "motion.nc": "application/x-netcdf",
    "report.html": "text/html",
}
_MADE = ("motion.nc", "report.html")
"""Files that are made when they are asked for."""
RECORDINGS = (".uff", ".unv", ".mat", ".nc", ".tdms", ".csv", ".txt")


class Refused(Exception):
    """An answer that is a sentence."""

    def __init__(self, status: int, sentence: str, key: str | None = None) -> None:
        super().__init__(sentence)
        self.status, self.sentence, self.key = status, sentence, key


def _wrong(*statuses: int) -> dict[int | str, dict[str, Any]]:
    meanings = {
        401: "the token is wanted", 403: "refused", 404: "not there", 409: "not yet, or not any more", 411: "length wanted",
        413: "too large", 422: "not allowed", 429: "too much is waiting", 500: "a fault of the server",
    }  # fmt: skip
    return {s: {"model": Wrong, "description": meanings[s]} for s in (401, 403, 411, 413, 422, *statuses)}


def desk_of(request: Request) -> Desk:
    """What the server holds."""
    found: Desk = request.app.state.desk
    return found


At = Annotated[Desk, Depends(desk_of)]
api = APIRouter(prefix="/api", responses=_wrong())


@api.get("/catalog")
def catalog() -> list[Entry]:
    """Published scenarios."""
    data = ((name, parse_yaml(catalog_text(name), name)) for name in catalog_names())
    return [Entry(name=name, title=d.get("title", ""), source=d.get("source", "")) for name, d in data]


@api.get("/schema", response_model_exclude_none=True)
def schema() -> Form:
    """Groups of fields."""
    return Form(**forms.schema())


@api.post("/scenario", responses=_wrong(429))
def scenario(spec: Spec, desk: At) -> View:
    """A scenario with all its values, and what is wrong with it."""
    with contextlib.suppress(MicrovibError):  # what is wrong is in the view
        if forms.elements_of(spec):
            return View(**_asked(desk, "view", spec=spec.model_dump()))
    return View(**forms.view_of(spec))


def _asked(desk: Desk, task: str, **arguments: Any) -> Any:
    """What a short task finds out; Refused with its sentence."""
    try:
        job = desk.ask(task, **arguments)
    except Busy:
        raise Refused(429, "the server has too much to do; try again in a moment") from None
    if job.state != "done":
        raise Refused(422, job.error or "the server is about to end")
    return job.value


def _meant(desk: Desk, spec: Spec) -> Scenario:
    """The scenario of a request; Refused with what is wrong with it."""
    try:
        if forms.elements_of(spec):
            view = _asked(desk, "view", spec=spec.model_dump())
            if view["errors"]:
                raise Refused(422, view["errors"][0]["error"], view["errors"][0]["key"])
            spec = Spec(text=view["yaml"])
        return forms.scenario(spec)
    except MicrovibError as error:
        raise _refused(error, spec.name) from None


def _refused(error: MicrovibError, name: str = forms.NAME) -> Refused:
    first = forms.sentences(str(error), name)[0]
    return Refused(422, first["error"], first["key"])


def _submit(desk: Desk, kind: str, title: str, **arguments: Any) -> Started:
    try:
        return Started(id=desk.submit(kind, title[:200], kind, **arguments).id)
    except Busy:
        raise Refused(
            429, f"{desk.limits.waiting} computations are waiting already; cancel some, or wait for them"
        ) from None


@api.post("/runs", status_code=202, responses=_wrong(429))
def start_run(asked: Run, desk: At) -> Started:
    """Simulate a scenario."""
    meant = _meant(desk, asked.scenario)
    _check_size(meant, desk.limits.record)
    return _submit(desk, "run", asked.name or meant.title, scenario=dump_scenario(meant), steady=asked.steady)


def _check_size(meant: Scenario, most: int) -> None:
    row = 8 * (30 + 2 * len(meant.array.modes))
    if meant.record.samples * row > most:
        raise Refused(
            422,
            f"record.duration: {meant.record.samples:.3g} samples are more than the page keeps, {most // row:.3g} for this"
            " drive; shorten record.duration, lower record.sample_rate, or use `microvib run --lines-only`",
            "record.duration",
        )


@api.post("/recordings", responses=_wrong(429), openapi_extra={
    "requestBody": {"required": True, "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}
})  # fmt: skip
async def recordings(request: Request, name: Annotated[str, Query(max_length=200)], desk: At) -> RecordingFacts:
    """Take in a recording; its name says its format."""
    suffix = Path(name).suffix.lower()
    if suffix not in RECORDINGS:
        raise Refused(422, f"'{suffix[:20]}' is not known; recordings are read from {', '.join(RECORDINGS)}", "name")
    shown = re.sub(r"[^\w .()+-]", "_", Path(name).name)[-100:]
    path = desk.new_file(suffix)
    try:
        with path.open("xb") as stream:
            async for part in request.stream():
                stream.write(part)
        facts = await asyncio.to_thread(_asked, desk, "recording", path=str(path), name=shown)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    upload = desk.keep(shown, path, facts)
    return RecordingFacts(id=upload.id, name=shown, **facts)


def _upload(desk: Desk, id: str) -> Upload:
    found = desk.upload(id)
    if found is None:
        raise Refused(404, "this recording is not here (any more); load it again", "recording")
    return found


@api.post("/analyses", status_code=202, responses=_wrong(404, 429))
def start_analysis(asked: AnalysisOf, desk: At) -> Started:
    """Lines with uncertainty and spectra of a recording."""
    upload = _upload(desk, asked.recording)
    guide = dump_scenario(_meant(desk, asked.scenario))
    return _submit(
        desk, "analysis", f"{upload.name}, {asked.channel}", recording=str(upload.path), scenario=guide,
        channel=asked.channel, names={str(upload.path): upload.name},
    )  # fmt: skip


@api.post("/comparisons", status_code=202, responses=_wrong(404, 409, 429))
def start_comparison(asked: ComparisonOf, desk: At) -> Started:
    """A recording beside a run's scenario at the recording's clock."""
    upload, job = _upload(desk, asked.recording), _run(desk, asked.run)
    path = str(desk.folder(job) / "scenario.yaml")
    return _submit(
        desk, "comparison", f"{upload.name} and {job.title}", recording=str(upload.path), run=path, channel=asked.channel,
        names={str(upload.path): upload.name, path: job.title},
    )  # fmt: skip


@api.post("/identifications", status_code=202, responses=_wrong(404, 429))
def start_identification(asked: IdentificationOf, desk: At) -> Started:
    """Parameters from recordings."""
    uploads = [_upload(desk, id) for id in asked.recordings]
    guide = dump_scenario(_meant(desk, asked.scenario))
    return _submit(
        desk, "identification", ", ".join(u.name for u in uploads), recordings=[str(u.path) for u in uploads],
        scenario=guide, channel=asked.channel, fit=asked.fit, starts=asked.starts,
        names={str(u.path): u.name for u in uploads},
    )  # fmt: skip


@api.post("/rates", status_code=202, responses=_wrong(429))
def start_rates(asked: RatesOf, desk: At) -> Started:
    """Plan the rate."""
    from microvib.app.options import band_of, quantity

    meant = _meant(desk, asked.scenario)
    if asked.count * max(len(asked.microsteps), 1) > desk.limits.cases:
        raise Refused(422, f"count: rates times microstep counts are at most {desk.limits.cases} here", "count")
    try:
        low, high = quantity("from", asked.low, "rad/s"), quantity("to", asked.high, "rad/s")
        limit = None if asked.limit is None else quantity("limit", asked.limit, "N*m")
        band = None if asked.band is None else band_of(asked.band)
    except MicrovibError as error:
        text = str(error).removeprefix("--")
        raise Refused(422, text, text.split(":")[0]) from None
    if not 0.0 < low < high:
        raise Refused(422, "from: must be above 0 deg/s and below to", "from")
    if limit is not None and not limit > 0.0:
        raise Refused(422, f"limit: {asked.limit} is not allowed; it must be greater than 0 N*m", "limit")
    return _submit(
        desk, "rates", f"rates of {meant.title}", scenario=dump_scenario(meant), low=low, high=high, count=asked.count,
        microsteps=list(dict.fromkeys(asked.microsteps)), limit=limit, band=band or (0.0, float("inf")),
        linear=asked.linear,
    )  # fmt: skip


@api.post("/sas", status_code=202, responses=_wrong(429))
def start_sas(asked: SasOf, desk: At) -> Started:
    """Size the simulator."""
    inertia, frequency = asked.inertia, asked.frequency
    if asked.from_scenario is not None:
        array = _meant(desk, asked.from_scenario).array
        if not array.modes:
            raise Refused(422, "array.modes: the array is rigid; the simulator stands for one with a torsion mode", "array.modes")
        inertia, frequency = f"{array.inertia!r} kg*m^2", f"{array.modes[0].frequency!r} Hz"
    for key, value in (("inertia", inertia), ("frequency", frequency)):
        if not value:
            raise Refused(422, f"{key}: missing; inertia and frequency of the array are wanted", key)
    options = {
        "inertia": inertia, "frequency": frequency, "states": asked.states, "amplitude": asked.amplitude or "2 deg",
        "rate": asked.rate or "0.06 deg/s",
    }  # fmt: skip
    return _submit(desk, "sas", f"simulator for {frequency}, {inertia}", options=options)


def _state(job: Job) -> JobState:
    return JobState(
        id=job.id, kind=job.kind, title=job.title, state=job.state, progress=job.progress, error=job.error,  # type: ignore[arg-type]
    )  # fmt: skip


def _job(desk: Desk, id: str) -> Job:
    job = desk.job(id)
    if job is None:
        raise Refused(404, "there is no such computation (any more); run it again")
    return job


def _run(desk: Desk, id: str) -> Job:
    """A run that is done."""
    job = _job(desk, id)
    if job.kind != "run":
        raise Refused(404, "this computation is no run")
    if job.state != "done":
        raise Refused(409, job.error or f"this run is {job.state}")
    return job


@api.get("/jobs")
def jobs(desk: At) -> list[JobState]:
    """All computations."""
    return [_state(job) for job in desk.jobs()]


@api.get("/jobs/{id}", responses=_wrong(404))
def job(id: Id, desk: At) -> JobState:
    """One computation."""
    return _state(_job(desk, id))


@api.delete("/jobs/{id}", status_code=204, response_class=Response, responses=_wrong(404))
def drop(id: Id, desk: At) -> None:
    """Cancel a computation that runs or waits; forget one that has ended."""
    desk.drop(_job(desk, id))


@api.get("/jobs/{id}/events", responses=_wrong(404) | {200: {"content": {"text/event-stream": {}}}}, response_class=StreamingResponse)
async def events(id: Id, desk: At) -> StreamingResponse:
    """States of a computation until it ends, as server-sent events."""
    return StreamingResponse(_states(_job(desk, id), desk), media_type="text/event-stream")


async def _states(job: Job, desk: Desk) -> AsyncIterator[str]:
    sent = ""
    while True:
        ended = job.state in ENDED or desk.closed
        text = _state(job).model_dump_json()
        if text != sent:
            sent = text
            yield f"data: {text}\n\n"
        if ended:
            return
        await asyncio.sleep(0.05)


@api.get("/jobs/{id}/result", responses=_wrong(404, 409))
def result(id: Id, desk: At) -> Result:
    """What a computation found; by its kind."""
    job = _job(desk, id)
    if job.state != "done":
        raise Refused(409, job.error or f"this computation is {job.state}")
    return Response(_there(desk.folder(job) / "result.json").read_bytes(), media_type="application/json")  # type: ignore[return-value]


def _there(path: Path) -> Path:
    if not path.is_file():
        raise Refused(404, "this result was given up for newer ones; run it again")
    return path


Points = Annotated[int, Query(ge=2, le=20_000)]
Second = Annotated[float | None, Query(allow_inf_nan=False)]


@api.get("/runs/{id}/series", responses=_wrong(404, 409))
def series_of(
    id: Id, desk: At, channels: Annotated[str, Query(max_length=500)], points: Points = 2000,
    low: Annotated[float | None, Query(alias="from", allow_inf_nan=False)] = None,
    high: Annotated[float | None, Query(alias="to", allow_inf_nan=False)] = None,
) -> Series:  # fmt: skip
    """Samples of some channels, separated by commas; where they are many, extremes of groups."""
    folder, facts = _facts(desk, id)
    found = {name: _channel(folder, name) for name in dict.fromkeys(channels.split(","))}
    return Series(**series.series(found, facts["t0"], facts["sample_rate"], low, high, points))


@api.get("/runs/{id}/spectrum", responses=_wrong(404, 409))
def spectrum_of(
    id: Id, desk: At, channel: Annotated[str, Query(max_length=50)] = "T_d",
    window: Literal["rectangular", "hann", "flat-top"] = "hann", points: Points = 4000,
    low: Annotated[float | None, Query(alias="from", allow_inf_nan=False)] = None,
    high: Annotated[float | None, Query(alias="to", allow_inf_nan=False)] = None,
) -> SpectrumOf:  # fmt: skip
    """Amplitude spectrum of a channel, 0-to-peak."""
    folder, facts = _facts(desk, id)
    x = _channel(folder, channel)
    return SpectrumOf(unit=series.unit(channel), **series.spectrum(x, facts["sample_rate"], window, low, high, points))


def _facts(desk: Desk, id: str) -> tuple[Path, dict[str, Any]]:
    folder = desk.folder(_run(desk, id))
    return folder, json.loads(_there(folder / "axis.json").read_text())


def _channel(folder: Path, name: str) -> Any:
    x = series.channel(folder, name)
    if x is None:
        raise Refused(404, f"this run has no channel '{name}'", "channels")
    return x


@api.get("/runs/{id}/files/{name}", responses=_wrong(404, 409, 429) | {200: {"content": {"application/octet-stream": {}}}}, response_class=FileResponse)
def file_of(id: Id, name: Annotated[str, Field(max_length=50)], desk: At) -> FileResponse:
    """A file of a run."""
    job = _run(desk, id)
    if name not in FILES:
        raise Refused(404, f"there is no such file; there are {', '.join(FILES)}")
    path = desk.folder(job) / name
    if name in _MADE and not path.is_file():
        _asked(desk, "file", folder=str(desk.folder(job)), name=name)
    return FileResponse(_there(path), media_type=FILES[name], filename=name)


def create_app(desk: Desk, access: Access | None = None) -> Guard:
    """The application on top of ``desk``, behind its guard."""
    app = FastAPI(
        title="microvib", version=__version__, openapi_url="/api/openapi.json", docs_url=None, redoc_url=None,
    )  # fmt: skip
    app.state.desk = desk
    app.include_router(api)
    static = Path(str(resources.files("microvib.app.web"))) / "static"

    @app.get("/", include_in_schema=False)
    def page() -> FileResponse:
        return FileResponse(static / "index.html")

    @app.get("/static/plotly.min.js", include_in_schema=False)
    def plotly() -> FileResponse:
        return FileResponse(_plotly())

    app.mount("/static", StaticFiles(directory=static))
    app.add_exception_handler(Refused, _say_refused)
    app.add_exception_handler(RequestValidationError, _say_invalid)
    app.add_exception_handler(HTTPException, _say_http)
    app.add_exception_handler(MicrovibError, _say_error)
    return Guard(app, access or Access(), desk.limits.body, desk.limits.recording)


def _plotly() -> Path:
    """Plotly's script, without importing the package, which takes a second."""
    spec = find_spec("plotly")
    if spec is None or spec.origin is None:
        raise Refused(404, "plotly is not installed; pip install 'microvib[serve]'")
    return Path(spec.origin).parent / "package_data" / "plotly.min.js"


def _answer(status: int, sentence: str, key: str | None = None) -> JSONResponse:
    return JSONResponse({"error": sentence, "key": key}, status)


def _say_refused(request: Request, error: Any) -> JSONResponse:
    return _answer(error.status, error.sentence, error.key)


def _say_error(request: Request, error: Any) -> JSONResponse:
    return _say_refused(request, _refused(error))


def _say_http(request: Request, error: Any) -> JSONResponse:
    return _answer(error.status_code, str(error.detail))


def _say_invalid(request: Request, error: Any) -> JSONResponse:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"] if part not in ("body", "query", "path")) or None
    message = first["msg"].removeprefix("Value error, ").replace("Input should", "it should")
    return _answer(422, f"{key or 'the request'}: {message}", key)
