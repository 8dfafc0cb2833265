"""Routes of a hammer test of a force table, and of an acceptance report from a template."""

from __future__ import annotations

from fastapi import APIRouter

from microvib.errors import OptionError
from microvib.model.scenario import Scenario
from microvib.units import quantity
from microvib.web.jobs.processing import Blows, RecordedFile
from microvib.web.jobs.store import Store
from microvib.web.routes.common import StoreDependency, refusals, requested, start
from microvib.web.routes.messages import AcceptanceOf, HammerOf, HitOf, Started
from microvib.web.routes.processing import once_each, preparing_of
from microvib.web.routes.recordings import upload_of
from microvib.web.routes.results import limit_of

routes = APIRouter(responses=refusals(404, 429))


@routes.post("/hammers", status_code=202)
def start_hammer(want: HammerOf, store: StoreDependency) -> Started:
    """Responses and resonances of a force table from recordings of a hammer's blows."""
    blows = _blows(store, want)
    loads = ", ".join(load for load, *_ in blows.hits)
    return start(store, "hammer", f"hammer test of {loads}", want, blows=blows)


def _blows(store: Store, want: HammerOf) -> Blows:
    quantity("mounted_mass", want.mounted_mass, "kg")
    hits = [(hit.load, _arm(hit), upload_of(store, hit.recording).file) for hit in want.hits]
    return Blows(hits, want.impact, want.mounted_mass, want.block or None, want.estimator)


def _arm(hit: HitOf) -> float:
    """Lever arm [m] of a torque; 1 of a force, which has none."""
    if hit.load.startswith("F"):
        if hit.arm:
            raise OptionError("arm", f"is that of a torque; {hit.load} is a force and has none")
        return 1.0
    if not hit.arm:
        raise OptionError("arm", f"is missing; {hit.load} is a torque and needs one, such as 0.2 m")
    length = quantity("arm", hit.arm, "m")
    if length == 0.0:
        raise OptionError("arm", "of 0 m makes no torque")
    return length


@routes.post("/acceptances", status_code=202)
def start_acceptance(want: AcceptanceOf, store: StoreDependency) -> Started:
    """Judge every recording against a limit, all for repeatability, and report by a template."""
    if not want.template.strip():
        raise OptionError("template", "is missing; a text such as {{ test.verdicts }} is expected")
    tests = {test.recording: test.unit for test in want.tests}
    if len({bool(unit) for unit in tests.values()}) > 1:
        raise OptionError("tests", "have a unit in part; give one to all of them, or to none")
    files = once_each([upload_of(store, id) for id in tests])
    scenario = requested(store, want.scenario)
    return start(
        store,
        "acceptance",
        f"acceptance of {', '.join(name for _, name in files)}",
        want,
        runs=list(zip(files, tests.values(), strict=True)),
        channel=want.channel,
        scenario=scenario,
        limit=limit_of(want.limit, want.band),
        reference=_reference(store, want, scenario),
        blows=None if want.hammer is None else _blows(store, want.hammer),
        preparing=preparing_of(store, want),
        template=want.template,
        words=want.data,
    )


def _reference(
    store: Store, want: AcceptanceOf, scenario: Scenario
) -> Scenario | RecordedFile | None:
    """Source that the first recording is compared with; None where none is asked for."""
    if want.reference == "scenario":
        return scenario
    return upload_of(store, want.reference).file if want.reference else None
