"""Routes about recordings that are here: windows of their time histories."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query

from microvib.io.kept_recording import kept_pyramid
from microvib.signals.pyramid import Pyramid
from microvib.web.jobs.store import Store, Upload
from microvib.web.routes.common import RequestRefused, StoreDependency, ask, refusals
from microvib.web.routes.messages import Id, RecordedSeries, RecordingHere
from microvib.web.routes.results import From, To

Time = Annotated[float | None, Query(allow_inf_nan=False)]
Pixels = Annotated[int, Query(ge=2, le=20_000)]
Channel = Annotated[str, Query(max_length=200)]

routes = APIRouter(prefix="/recordings", responses=refusals(404))


def upload_of(store: Store, id: str) -> Upload:
    """A recording by its id; Refused where it is gone."""
    found = store.upload(id)
    if found is None:
        raise RequestRefused(
            404, "this recording is no longer on the server; load it again", "recording"
        )
    return found


@routes.get("")
def recordings_here(store: StoreDependency) -> list[RecordingHere]:
    """All recordings, the one used last first."""
    return [
        RecordingHere(
            id=one.id,
            name=one.name,
            channels=[str(channel["name"]) for channel in one.facts["channels"]],
            duration=one.facts["duration"],
            sample_rate=one.facts["sample_rate"],
        )
        for one in reversed(store.uploads())
    ]


@routes.get("/{id}/series", responses=refusals(429))
def series_of(
    id: Id,
    store: StoreDependency,
    channel: Channel,
    low: From = None,
    high: To = None,
    points: Pixels = 2000,
) -> RecordedSeries:
    """A window of a channel's time history: every sample, or the smallest and largest of groups of them
    where they are more than twice the ``points``.
    """
    upload = upload_of(store, id)
    return series_in(_pyramid(store, upload, channel), low, high, points, _unit(upload, channel))


def series_in(
    found: Pyramid, low: float | None, high: float | None, points: int, unit: str
) -> RecordedSeries:
    """A window of samples in a ``unit``, from ``low`` to ``high`` [s]."""
    start = 0.0 if low is None else low
    stop = found.duration if high is None else high
    curve = found.window(min(start, stop), max(start, stop), points)
    return RecordedSeries(
        start=start,
        stop=stop,
        exact=curve.of_samples,
        unit=unit,
        t=curve.time.tolist(),
        min=_numbers(curve.low),
        max=[] if curve.of_samples else _numbers(curve.high),
    )


def _pyramid(store: Store, upload: Upload, channel: str) -> Pyramid:
    """Samples of a channel as they were kept; those of a recording of before are read once."""
    names = [one["name"] for one in upload.facts["channels"]]
    if channel not in names:
        raise RequestRefused(
            404, f"there is no channel '{channel}'; there are {', '.join(names)}", "channel"
        )
    found = kept_pyramid(upload.folder, channel)
    if found is None:
        ask(store, "samples", path=str(upload.path), name=upload.name)
        found = kept_pyramid(upload.folder, channel)
    if found is None:
        raise RequestRefused(404, "the samples of this recording are gone; load it again")
    return found


def _unit(upload: Upload, channel: str) -> str:
    facts: list[dict[str, Any]] = upload.facts["channels"]
    return next(str(one["unit"]) for one in facts if one["name"] == channel)


def _numbers(x: np.ndarray) -> list[float | None]:
    """Samples as they go to the page, to seven digits, which no screen shows more of; nan as None."""
    return [float(f"{value:.7g}") if np.isfinite(value) else None for value in x.tolist()]
