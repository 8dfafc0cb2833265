"""Routes that start something: runs, studies, and recordings to study."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool

from microvib.analysis.seeds import check_seeds
from microvib.errors import MicrovibError, OptionError
from microvib.io.files import RECORDINGS
from microvib.model.coupling import require_craft
from microvib.model.ranges import noted_ranges
from microvib.model.scenario import Scenario
from microvib.solve.motion import record_bytes
from microvib.studies.angles import angles_in, check_sweep
from microvib.studies.quiet.starts import require_constant_rate
from microvib.studies.quiet.study import Constraints
from microvib.studies.rates import rate_grid
from microvib.studies.sensitivity import NOT_RANKED
from microvib.units import Si, band, quantity
from microvib.web.jobs.quieter import CURVE, REQUIREMENT, STUDY, TABLE, QuietRequest
from microvib.web.jobs.store import private
from microvib.web.routes.common import (
    RequestRefused,
    StoreDependency,
    ask,
    refusals,
    requested,
    start,
)
from microvib.web.routes.messages import (
    AnglesOf,
    Id,
    IdentificationOf,
    QuietOf,
    RankingOf,
    RatesOf,
    RecordingFacts,
    Run,
    SasOf,
    ShapesOf,
    Started,
)
from microvib.web.routes.processing import preparing_of
from microvib.web.routes.recordings import upload_of
from microvib.web.routes.results import limit_of

_RAW = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}

routes = APIRouter(responses=refusals(429))


@routes.post("/runs", status_code=202)
def start_run(want: Run, store: StoreDependency) -> Started:
    """Simulate a scenario."""
    scenario = requested(store, want.scenario)
    if want.steady:
        scenario = scenario.with_({"record.start": "steady"})
    if want.seeds:
        check_seeds(scenario, want.seeds)
    check_size(scenario, store.limits.record)
    return start(
        store,
        "run",
        want.name or scenario.title or "run",
        want,
        scenario=scenario,
        seeds=want.seeds or 0,
    )


def check_size(scenario: Scenario, most: int) -> None:
    """OptionError where a record of this scenario takes more than ``most`` bytes."""
    size, samples = record_bytes(scenario), scenario.record.samples
    if size > most:
        raise OptionError(
            "record.duration",
            f"{samples:.3g} samples are more than the page keeps, {most / size * samples:.3g} for"
            " this drive; shorten"
            " record.duration, lower record.sample_rate, or keep the lines only, by `microvib run`",
        )


@routes.post(
    "/recordings",
    responses=refusals(507),
    openapi_extra={"requestBody": {"required": True, "content": _RAW}},
)
async def take_recording(
    request: Request,
    name: Annotated[str, Query(max_length=200, description="its ending says its format")],
    store: StoreDependency,
) -> RecordingFacts:
    """Take in a recording and say what is in it."""
    suffix = Path(name).suffix.lower()
    if suffix not in RECORDINGS:
        raise RequestRefused(
            422,
            f"'{suffix[:20]}' is not known; recordings are read from {', '.join(RECORDINGS)}",
            "name",
        )
    shown = re.sub(r"[^\w .()+-]", "_", Path(name).name)[-100:]
    with store.receiving() as free:
        if not free:
            raise RequestRefused(429, "other recordings are being loaded; try again in a moment")
        path = store.new_recording(suffix)
        try:
            await _receive(request, path)
            facts = await asyncio.to_thread(ask, store, "recording", path=str(path), name=shown)
        except BaseException:
            shutil.rmtree(path.parent, ignore_errors=True)
            raise
    upload = store.keep(shown, path, facts)
    return RecordingFacts(id=upload.id, name=shown, **facts)


@routes.get("/recordings/{id}", responses=refusals(404))
def recording_of(id: Id, store: StoreDependency) -> RecordingFacts:
    """Contents of a recording that is here."""
    upload = upload_of(store, id)
    return RecordingFacts(id=upload.id, name=upload.name, **upload.facts)


async def _receive(request: Request, path: Path) -> None:
    try:
        with open(path, "xb", opener=private) as stream:
            async for part in request.stream():
                await run_in_threadpool(stream.write, part)  # a disk may be slow
    except OSError as error:
        raise RequestRefused(507, f"the recording could not be stored: {error.strerror}") from None


@routes.post("/identifications", status_code=202, responses=refusals(404))
def start_identification(want: IdentificationOf, store: StoreDependency) -> Started:
    """Parameters from recordings."""
    uploads = [upload_of(store, id) for id in want.recordings]
    return start(
        store, "identification", ", ".join(u.name for u in uploads), want, recordings=[u.file for u in uploads],
        scenario=requested(store, want.scenario), channel=want.channel, fit=want.fit, starts=want.starts,
        preparing=preparing_of(store, want),
    )  # fmt: skip


@routes.post("/rates", status_code=202)
def start_rates(want: RatesOf, store: StoreDependency) -> Started:
    """Plan the rate."""
    scenario = requested(store, want.scenario)
    counts = list(dict.fromkeys(want.microsteps)) or [scenario.driver.microsteps]
    if want.count * len(counts) > store.limits.cases:
        raise OptionError(
            "count", f"rates times microstep counts are at most {store.limits.cases} here"
        )
    rates = rate_grid(want.low, want.high, want.count)
    limit = limit_of(want.limit, None)
    if limit is not None:
        limit.torque_curve("a plan of rates")
    if want.band is None:
        within = (Si(0.0), Si("inf"))
    else:
        within = band(want.band)
    return start(
        store, "rates", f"rates of {scenario.title}", want, scenario=scenario, rates=rates,
        microsteps=counts, limit=limit, band=within, linear=want.linear,
    )  # fmt: skip


@routes.post("/angles", status_code=202)
def start_angles(want: AnglesOf, store: StoreDependency) -> Started:
    """Run a craft at several angles of its array."""
    scenario, angles = requested(store, want.scenario), angles_in(want.angles)
    if want.steady:
        scenario = scenario.with_({"record.start": "steady"})
    check_sweep(scenario)
    check_size(scenario, store.limits.record // (os.cpu_count() or 1))
    return start(
        store, "angles", f"angles of {scenario.title}", want, scenario=scenario, angles=angles,
        limit=limit_of(want.limit, want.band),
    )  # fmt: skip


@routes.post("/quiet", status_code=202)
def start_quiet(want: QuietOf, store: StoreDependency) -> Started:
    """Search for a quieter drive, or judge a table of currents."""
    scenario = requested(store, want.scenario)
    require_constant_rate(scenario)
    check_size(scenario, store.limits.record // (os.cpu_count() or 1))
    if want.limit is None:
        limit = None
    else:
        limit = quantity("limit", want.limit, "N*m", positive=True)
    request = _quiet_request(want, scenario)
    problem = ask(
        store, "quiet_problem", folder=str(store.root), request=request,
        most_cases=store.limits.campaign,
    )  # fmt: skip
    if problem is not None:
        raise RequestRefused(422, **problem)
    title = f"quieter drive for {scenario.title}"
    if want.check:
        title = f"table of currents in {scenario.title}"
    return start(store, "quiet", title, want, request=request, limit=limit)


def _quiet_request(want: QuietOf, scenario: Scenario) -> QuietRequest:
    """A request with its texts by name, of which those that are empty are not there."""
    objective, curve = want.objective, ""
    if "\n" in want.objective:
        objective, curve = CURVE, want.objective
    given = {CURVE: curve, REQUIREMENT: want.requirement, STUDY: want.study, TABLE: want.check}
    return QuietRequest(
        scenario,
        objective,
        want.levers,
        want.bits,
        want.table_rows,
        want.cases,
        want.effort,
        Constraints.of_texts(want.margin, want.factor, want.lag),
        {name: text for name, text in given.items() if text.strip()},
    )


@routes.post("/shapes", status_code=202)
def start_shapes(want: ShapesOf, store: StoreDependency) -> Started:
    """Shapes of modes, to be moved by the page."""
    scenario = requested(store, want.scenario)
    if want.of == "craft":
        require_craft(scenario)
    spec = want.scenario.model_dump()  # which a worker reads: a text may take long
    return start(
        store,
        "shapes",
        f"modes of {scenario.title}",
        want,
        scenario=scenario,
        of=want.of,
        spec=spec,
    )


@routes.post("/sensitivity", status_code=202)
def start_sensitivity(want: RankingOf, store: StoreDependency) -> Started:
    """Rank the values whose sources note a range by what they do to each line."""
    scenario = requested(store, want.scenario)
    if not noted_ranges(scenario):
        raise MicrovibError(NOT_RANKED)
    return start(store, "sensitivity", f"ranking of {scenario.title}", want, scenario=scenario)


@routes.post("/sas", status_code=202)
def start_sas(want: SasOf, store: StoreDependency) -> Started:
    """Size the simulator."""
    wanted: dict[str, Any] = {"inertia": want.inertia, "frequency": want.frequency}
    if want.from_scenario is not None:
        array = requested(store, want.from_scenario).array
        if not array.modes:
            raise OptionError(
                "array.modes", "is empty; a simulator stands for an array with a torsion mode"
            )
        wanted = {
            "inertia": f"{array.inertia!r} kg*m^2",
            "frequency": f"{array.modes[0].frequency!r} Hz",
        }
    for key, value in wanted.items():
        if not value:
            raise OptionError(key, "missing; inertia and frequency of the array are expected")
    options = {**wanted, "states": want.states, "amplitude": want.amplitude, "rate": want.rate}
    return start(
        store,
        "sas",
        f"simulator for {wanted['frequency']}, {wanted['inertia']}",
        want,
        options=options,
    )
