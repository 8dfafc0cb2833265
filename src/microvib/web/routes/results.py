"""Routes about jobs and what they found."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import StringConstraints

from microvib.errors import OptionError
from microvib.export.exporting import options_of, typed_options
from microvib.export.targets import TARGETS, target_of_file
from microvib.io.limit_files import is_limit_file, limit_from_text
from microvib.io.tables import to_json
from microvib.model.rigid import COMPONENTS
from microvib.signals.limit_curve import Limit
from microvib.signals.screen import decimate_spectrum, extremes
from microvib.signals.spectrum import Window, amplitude_spectrum
from microvib.solve.channels import ALL_CHANNELS, CHANNELS
from microvib.web.jobs.processes import ENDED, Job
from microvib.web.jobs.store import Store
from microvib.web.routes.common import RequestRefused, StoreDependency, ask, refusals
from microvib.web.routes.messages import (
    Id,
    JobState,
    Result,
    Series,
    SpectrumOf,
    Verdict,
)

FILES = {
    "scenario.yaml": "text/yaml",
    "lines.csv": "text/csv",
    "seeds.csv": "text/csv",
    "seed_peaks.csv": "text/csv",
    "loads.csv": "text/csv",
    "pointing.csv": "text/csv",
    "densities.csv": "text/csv",
    "lines_wing_2.csv": "text/csv",
    "loads_wing_2.csv": "text/csv",
    "summary.json": "application/json",
    "motion.nc": "application/x-netcdf",
    "report.html": "text/html",
    "report.pdf": "application/pdf",
}
GENERATED_FILES = (
    "motion.nc",
    "report.html",
    "report.pdf",
)  # files that are made when they are asked for
_LOOK_AGAIN = 0.01
"""s after which a question that waits looks again whether a computation has ended."""
_OLDER = (
    "another version of microvib, or another user, kept this run: its pictures and tables are here; run"
    " it again for a verdict, a report or an export"
)
EXPORTED = "application/octet-stream"
"""Media type of files of other tools."""
Points = Annotated[int, Query(ge=2, le=20_000)]
From = Annotated[float | None, Query(alias="from", allow_inf_nan=False)]
To = Annotated[float | None, Query(alias="to", allow_inf_nan=False)]
Shown = Annotated[str | None, Query(max_length=100)]
Allowed = Annotated[
    str | None,
    Query(
        max_length=4000, description="a torque, or a table of a limit over frequency as CSV text"
    ),
]
Option = Annotated[str, StringConstraints(max_length=500)]
Options = Annotated[
    tuple[Option, ...], Query(max_length=20, description="options of the format, KEY=VALUE each")
]
Log = Annotated[bool, Query(description="for a logarithmic axis of frequency")]

routes = APIRouter(responses=refusals(404))


def _state(job: Job) -> JobState:
    return JobState.model_validate(job, from_attributes=True)


def _job(store: Store, id: str) -> Job:
    job = store.job(id)
    if job is None:
        raise RequestRefused(404, "no such computation, or it was dropped; start it again")
    return job


def done(store: Store, id: str) -> Job:
    """A computation that is done; Refused with how it stands."""
    job = _job(store, id)
    if job.state != "done":
        raise RequestRefused(409, job.error or f"this computation is {job.state}")
    return job


def finished_run(store: Store, id: str) -> Job:
    """A run that is done; Refused if there is none of this id."""
    if _job(store, id).kind != "run":
        raise RequestRefused(404, "this computation is not a run")
    return done(store, id)


def whole_run(store: Store, id: str) -> Job:
    """A run that is done and can be read again as a whole; Refused where another version kept it."""
    job = finished_run(store, id)
    if not store.trusts(job):
        raise RequestRefused(409, _OLDER)
    return job


@routes.get("/jobs")
async def jobs(
    store: StoreDependency,
    ids: Annotated[
        str | None, Query(max_length=2000, description="ids, separated by commas")
    ] = None,
    wait: Annotated[
        int, Query(ge=0, le=1000, description="ms to wait for one of the ids to end or to be gone")
    ] = 0,
) -> list[JobState]:
    """All computations, or those of the ids that are still here."""
    if ids is None:
        return [_state(job) for job in store.jobs()]
    asked = set(ids.split(","))
    until = time.monotonic() + 1e-3 * wait
    while True:
        found = [job for job in store.jobs() if job.id in asked]
        go_on = len(found) == len(asked) and not any(job.state in ENDED for job in found)
        if not go_on or store.closed or time.monotonic() >= until:
            return [_state(job) for job in found]
        await asyncio.sleep(_LOOK_AGAIN)


@routes.get("/jobs/{id}")
async def job(id: Id, store: StoreDependency) -> JobState:
    """One computation."""
    return _state(_job(store, id))


@routes.delete("/jobs/{id}", status_code=204, response_class=Response)
def drop(id: Id, store: StoreDependency) -> None:
    """Cancel a computation that runs or waits; forget one that has ended."""
    store.drop(_job(store, id))


@routes.get(
    "/jobs/{id}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}}},
)
async def events(id: Id, store: StoreDependency) -> StreamingResponse:
    """States of a computation until it ends, as server-sent events."""
    return StreamingResponse(_states(_job(store, id), store), media_type="text/event-stream")


async def _states(job: Job, store: Store) -> AsyncIterator[str]:
    sent, ended = "", False
    while not ended:
        ended = job.state in ENDED or store.closed
        text = _state(job).model_dump_json()
        if text != sent:
            sent = text
            yield f"data: {text}\n\n"
        await asyncio.sleep(0.0 if ended else 0.05)


@routes.get("/jobs/{id}/result", response_model=Result, responses=refusals(409))
def result(id: Id, store: StoreDependency) -> Response:
    """Result of a computation, by its kind."""
    file = there(store.folder(done(store, id)) / "result.json")
    return Response(file.read_bytes(), media_type="application/json")


def there(path: Path) -> Path:
    """A file of a result; Refused where it was dropped."""
    if not path.is_file():
        raise RequestRefused(404, "this result was dropped for newer ones; run it again")
    return path


@routes.get("/runs/{id}/series", responses=refusals(409))
def series_of(
    id: Id, store: StoreDependency, channels: Annotated[str, Query(max_length=500)], points: Points = 2000, low: From = None,
    high: To = None,
) -> Series:  # fmt: skip
    """Samples of some channels, separated by commas; where they are many, extremes of groups."""
    folder, axis = _run(store, id)
    found = {name: _channel(folder, name) for name in dict.fromkeys(channels.split(","))}
    return Series.model_validate(series(found, axis["t0"], axis["sample_rate"], low, high, points))


def series(
    channels: dict[str, np.ndarray],
    t0: float,
    rate: float,
    low: float | None,
    high: float | None,
    points: int,
) -> dict[str, Any]:
    """Samples from ``low`` to ``high`` [s]: each, where they are few enough, else extremes of
    groups at their middles.
    """
    n = min(x.size for x in channels.values())
    if low is None:
        first = 0
    else:
        first = int(np.clip(np.ceil((low - t0) * rate - 1e-6), 0, n - 1))
    if high is None:
        last = n
    else:
        last = int(np.clip(np.floor((high - t0) * rate + 1e-6) + 1, first + 1, n))
    size = -(-(last - first) // points)
    starts = np.arange(first, last, size)
    middles = 0.5 * (starts + np.minimum(starts + size, last) - 1)
    found: dict[str, Any] = {}
    for name, x in channels.items():
        smallest, largest = extremes(np.asarray(x[first:last]), size)
        found[name] = {
            "unit": ALL_CHANNELS[name].unit,
            "min": smallest.tolist(),
            "max": largest.tolist(),
        }
    return {
        "from": t0 + first / rate,
        "to": t0 + (last - 1) / rate,
        "exact": size == 1,
        "t": (t0 + middles / rate).tolist(),
        "channels": found,
    }


@routes.get("/runs/{id}/spectrum", responses=refusals(409))
def spectrum_of(
    id: Id, store: StoreDependency, *, channel: Annotated[str, Query(max_length=50)] = "T_d",
    window: Window = "hann", points: Points = 4000, low: From = None, high: To = None,
    log: Log = False,
) -> SpectrumOf:  # fmt: skip
    """Amplitude spectrum of a channel, 0-to-peak."""
    folder, axis = _run(store, id)
    s = amplitude_spectrum(np.asarray(_channel(folder, channel)), axis["sample_rate"], window)
    f, amplitude = stretch(s.frequency, s.amplitude, low, high, points, log)
    return SpectrumOf(
        f=f,
        amplitude=amplitude,
        unit=ALL_CHANNELS[channel].unit,
        resolution=s.resolution,
        made=str(s),
    )


def stretch(
    f: np.ndarray, y: np.ndarray, low: float | None, high: float | None, points: int, log: bool
) -> tuple[list[float], list[float]]:
    """Outline of a spectrum from ``low`` to ``high`` [Hz]."""
    keep = (f >= (low or 0.0)) & (f <= (np.inf if high is None else high))
    thin, outlined = decimate_spectrum(f[keep], y[keep], points, log)
    return thin.tolist(), outlined.tolist()


def _run(store: Store, id: str) -> tuple[Path, dict[str, Any]]:
    """Folder and time axis of a run."""
    folder = store.folder(finished_run(store, id))
    return folder, json.loads(there(folder / "axis.json").read_text(encoding="utf-8"))


def _channel(folder: Path, name: str) -> np.ndarray:
    """Samples of a run's channel, (n,), mapped from its file."""
    file = folder / ("loads.npy" if name in COMPONENTS else f"{name}.npy")
    if name not in (*COMPONENTS, *CHANNELS) or not file.is_file():
        raise RequestRefused(404, f"this run has no channel '{name}'", "channel")
    x = np.load(file, mmap_mode="r")
    if name in COMPONENTS:
        return x[:, COMPONENTS.index(name)]
    return x


def limit_of(limit: str | None, band: str | None) -> Limit | None:
    """The limit of a request: a torque, or the text of a table; no file is opened for it."""
    if limit and "\n" in limit:
        return limit_from_text(limit).within(band or None)
    if is_limit_file(limit):
        raise OptionError(
            "limit", f"{limit!r} names a file, and no files are opened here; its text is expected"
        )
    return Limit.of(limit or None, band or None)


@routes.get("/runs/{id}/verdict", responses=refusals(409, 429))
def verdict_of(id: Id, store: StoreDependency, limit: Allowed, band: Shown = None) -> Verdict:
    """Lines of a run against a limit such as ``30 mN*m``, over a band such as ``0.5:5 Hz``; a text of
    several lines is a table of a limit over frequency.
    """
    folder = store.folder(whole_run(store, id))
    wanted = limit_of(limit, band)
    if wanted is None:
        raise OptionError("limit", "missing; a torque is needed, such as 30 mN*m")
    return Verdict.model_validate(ask(store, "verdict", folder=str(folder), limit=wanted))


@routes.get(
    "/runs/{id}/files/{name}", response_class=FileResponse,
    responses=refusals(409, 429) | {200: {"content": {kind: {} for kind in FILES.values()}}},
)  # fmt: skip
def file_of(
    id: Id, name: str, store: StoreDependency, limit: Allowed = None, band: Shown = None
) -> FileResponse:
    """A file of a run; motion and report are made when they are first asked for, the report against
    a limit where one is given.
    """
    folder = store.folder(finished_run(store, id))
    if name not in FILES:
        raise RequestRefused(404, f"there is no such file; there are {', '.join(FILES)}")
    if name.startswith("report."):
        wanted = limit_of(limit, band)
    else:
        wanted = None
    if wanted is None:
        mark = ""
    else:
        mark = sha256(to_json(wanted.as_dict()).encode()).hexdigest()[:16] + "-"
    if name in GENERATED_FILES and not (folder / (mark + name)).is_file():
        whole_run(store, id)
        ask(store, "file", folder=str(folder), name=name, mark=mark, limit=wanted)
    return FileResponse(there(folder / (mark + name)), media_type=FILES[name], filename=name)


@routes.get(
    "/runs/{id}/exports/{name}", response_class=FileResponse,
    responses=refusals(409, 429) | {200: {"content": {EXPORTED: {}}}},
)  # fmt: skip
def export_of(id: Id, name: str, store: StoreDependency, option: Options = ()) -> FileResponse:
    """A run as a file of another tool, called by format and ending, such as ``nastran.bdf``, with options
    of the format as KEY=VALUE; made when it is first asked for.
    """
    folder = store.folder(finished_run(store, id))
    found = target_of_file(name)
    if found is None:
        names = ", ".join(
            target.name + ending for target in TARGETS.values() for ending in target.endings
        )
        raise RequestRefused(404, f"there is no such file; there are {names}")
    target, _ = found
    options = options_of(target, typed_options(option))
    mark = ""
    if options != target.options():
        mark = sha256(options.model_dump_json().encode()).hexdigest()[:16] + "-"
    kept = folder / f"export-{mark}{name}"
    if not kept.is_file():
        whole_run(store, id)
        ask(store, "export", folder=str(folder), name=name, options=options, mark=mark)
    return FileResponse(there(kept), media_type=EXPORTED, filename=name)
