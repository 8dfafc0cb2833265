"""Route of envelopes over runs, studies and recordings that the page has."""

from __future__ import annotations

from fastapi import APIRouter

from microvib.errors import OptionError
from microvib.signals.frequency_bands import Bandwidth
from microvib.units import quantity
from microvib.web.jobs.page_members import FOLDERS, PageMember
from microvib.web.jobs.processes import ENDED
from microvib.web.jobs.store import Store
from microvib.web.routes.common import (
    RequestRefused,
    StoreDependency,
    refusals,
    requested,
    start,
)
from microvib.web.routes.messages import EnvelopeOf, Started
from microvib.web.routes.results import done, limit_of, whole_run

routes = APIRouter(responses=refusals(404, 409, 429))


@routes.post("/envelopes", status_code=202)
def start_envelope(want: EnvelopeOf, store: StoreDependency) -> Started:
    """Find the envelope of lines over members, and judge it."""
    Bandwidth.of(want.bandwidth)
    quantity("resolution", want.resolution, "Hz", positive=True)
    if len(set(want.members)) < len(want.members):
        raise OptionError("members", "one is there twice; a member counts once")
    members = [_member(store, id) for id in want.members]
    scenario = None if want.scenario is None else requested(store, want.scenario)
    names = ", ".join(one.name for one in members)
    return start(
        store, "envelope", f"envelope of {names}", want, members=members, channels=want.channels,
        statistics=want.statistics, limit=limit_of(want.limit, want.band), bandwidth=want.bandwidth,
        resolution=want.resolution, scenario=scenario,
    )  # fmt: skip


def _member(store: Store, id: str) -> PageMember:
    """A run, study or recording that may be a member; Refused with why it is none."""
    upload = store.upload(id)
    if upload is not None:
        return PageMember("recording", str(upload.path), upload.name)
    job = store.job(id)
    if job is None:
        raise RequestRefused(404, "a member is no longer here; make it again", "members")
    if job.kind == "run":
        job = whole_run(store, id)
    elif job.kind not in FOLDERS:
        raise RequestRefused(
            422,
            f"'{job.title}' is no member; a run, rate map, campaign, sweep over angles or recording"
            " is expected",
            "members",
        )
    elif job.kind != "campaign":
        job = done(store, id)
    elif job.state not in ENDED:
        raise RequestRefused(409, f"'{job.title}' is under way", "members")
    return PageMember(job.kind, str(store.folder(job)), job.title)
