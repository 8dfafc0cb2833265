"""Routes that process recordings: sections, sweeps, comparisons, several at once; and what the page draws of
what came out.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter
from fastapi import Path as PathParameter

from microvib.errors import OptionError
from microvib.io.band_limits import BandLimit, band_limits_from_text
from microvib.io.file_access import sent_files
from microvib.io.pyramid_files import mapped_pyramid
from microvib.signals.limit_curve import Limit
from microvib.signals.screen import largest_in_cells
from microvib.testdata.section import Section
from microvib.web.jobs.processing import NOT_SENT_WITH, Part, Preparing, Processing
from microvib.web.jobs.store import Store, Upload
from microvib.web.routes.common import (
    RequestRefused,
    StoreDependency,
    refusals,
    requested,
    start,
)
from microvib.web.routes.messages import (
    AnalysisOf,
    BatchOf,
    ComparisonOf,
    Id,
    PreparingOf,
    ProcessingOf,
    RecordedMap,
    RecordedSeries,
    RecordedSpectrum,
    RepeatedOf,
    SectionOf,
    Started,
    TrackingOf,
)
from microvib.web.routes.recordings import Pixels, Time, series_in, upload_of
from microvib.web.routes.results import (
    From,
    Log,
    Points,
    To,
    done,
    finished_run,
    limit_of,
    stretch,
    there,
)

_REFERENCES = ("scenario", "profile", "tacho", "speed", "strongest")
_ROWS, _COLUMNS = 160, 600
"""Cells of a map that a screen shows."""

routes = APIRouter(responses=refusals(404, 409, 429))


def preparing_of(store: Store, want: PreparingOf) -> Preparing | None:
    """The preparation that a request states; OptionError where a table's name is none."""
    sent_files(Path(), want.tables, NOT_SENT_WITH)
    if not want.prepare.strip():
        return None
    here = {one.name: str(one.path) for one in store.uploads()}
    return Preparing(want.prepare, want.tables, here)


def _part_of(store: Store, want: SectionOf) -> Part:
    section = Section.stated(want.start, want.stop, want.trigger, want.pre_trigger)
    return Part(section, want.unit or "", preparing_of(store, want))


def _processing(want: ProcessingOf) -> Processing:
    limits: tuple[BandLimit, ...] = ()
    if want.bands is not None and want.bands.strip():
        limits = band_limits_from_text(want.bands)
    elif want.roll_off is not None:
        raise OptionError("roll_off", "is that of filters of bands; give bands", remedy="bands")
    return Processing(
        want.window, want.average, want.resolution, want.overlap, limits, want.roll_off,
        recording_limit(want.limit, want.limit_band),
    )  # fmt: skip


def _background(store: Store, want: ProcessingOf) -> tuple[str, str] | None:
    return None if want.background is None else upload_of(store, want.background).file


def _given(store: Store, want: AnalysisOf | BatchOf) -> dict[str, Any]:
    """Arguments of processing, of one recording or several."""
    return {
        "channel": want.channel,
        "scenario": requested(store, want.scenario),
        "part": _part_of(store, want),
        "background": _background(store, want),
        "processing": _processing(want),
    }


@routes.post("/analyses", status_code=202)
def start_analysis(want: AnalysisOf, store: StoreDependency) -> Started:
    """Lines with uncertainty, spectra and bands of a recording, or of a section of it."""
    upload = upload_of(store, want.recording)
    return start(
        store,
        "analysis",
        f"{upload.name}, {want.channel}",
        want,
        recording=upload.file,
        **_given(store, want),
    )


@routes.post("/batches", status_code=202)
def start_batch(want: BatchOf, store: StoreDependency) -> Started:
    """Several recordings processed alike."""
    uploads = once_each([upload_of(store, id) for id in dict.fromkeys(want.recordings)])
    if len(uploads) < 2:
        raise OptionError("recordings", "names one recording; two or more are expected")
    return start(
        store,
        "batch",
        f"{len(uploads)} recordings, {want.channel}",
        want,
        recordings=uploads,
        **_given(store, want),
    )


@routes.post("/trackings", status_code=202)
def start_tracking(want: TrackingOf, store: StoreDependency) -> Started:
    """Track orders through a rate sweep."""
    upload = upload_of(store, want.recording)
    return start(
        store,
        "tracking",
        f"orders of {upload.name}, {want.channel}",
        want,
        recording=upload.file,
        channel=want.channel,
        orders=_orders(want.orders),
        reference=_reference(store, want),
        part=_part_of(store, want),
        fixed=want.fixed,
        bandwidth=want.bandwidth,
        limit=recording_limit(want.limit, None),
    )


def _orders(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise OptionError(
            "orders", f"{text!r} is not a list of orders, such as 0.5,1,4,6"
        ) from None


def _reference(store: Store, want: TrackingOf) -> dict[str, Any]:
    """The one reference of a sweep, and what belongs to it."""
    given = [name for name in _REFERENCES if getattr(want, name) is not None]
    if len(given) != 1:
        found = ", ".join(given) or "none"
        raise OptionError(
            "reference", f"one is expected of {', '.join(_REFERENCES)}; given: {found}"
        )
    options: dict[str, Any] = {given[0]: getattr(want, given[0]), "clock": want.clock}
    if want.scenario is not None:
        options["scenario"] = requested(store, want.scenario)
    if want.tacho is not None:
        options["pulses_per_rev"] = want.pulses_per_rev
    return options


def recording_limit(text: str | None, band: str | None) -> Limit | None:
    """The limit of a recording's lines in a band, whose key is ``limit_band``; None without one."""
    try:
        return limit_of((text or "").strip(), (band or "").strip())
    except OptionError as error:
        if error.key != "band":
            raise
        problem = str(error).removeprefix("band: ")
        raise OptionError("limit_band", problem, remedy=error.remedy) from None


@routes.post("/comparisons", status_code=202)
def start_comparison(want: ComparisonOf, store: StoreDependency) -> Started:
    """A recording beside a run's scenario, simulated at the recording's clock, or beside another
    recording.
    """
    upload = upload_of(store, want.recording)
    if (want.run is None) == (want.other is None):
        raise OptionError("run", "a run or another recording is expected, one of the two")
    if want.run is not None:
        job = finished_run(store, want.run)
        second, title = {"run": str(store.folder(job) / "scenario.yaml")}, job.title
        more: dict[str, Any] = {**second, "run_title": title}
    else:
        other = upload_of(store, str(want.other))
        title = other.name
        _, file = once_each([upload, other])
        scenario = None if want.scenario is None else requested(store, want.scenario)
        more = {"other": file, "scenario": scenario}
    return start(
        store,
        "comparison",
        f"{upload.name} and {title}",
        want,
        recording=upload.file,
        channel=want.channel,
        preparing=preparing_of(store, want),
        limit=recording_limit(want.limit, want.limit_band),
        **more,
    )


@routes.post("/repeated", status_code=202)
def start_repeated(want: RepeatedOf, store: StoreDependency) -> Started:
    """Mean, scatter and outliers of the lines of repeated tests."""
    tests = {test.recording: test.unit for test in want.tests}
    files = once_each([upload_of(store, id) for id in tests])
    if len(files) < 2:
        raise OptionError("tests", "name one recording; two or more are expected")
    return start(
        store,
        "repeated",
        f"repeatability of {len(files)} recordings",
        want,
        runs=list(zip(files, tests.values(), strict=True)),
        channels=want.channels,
        scenario=requested(store, want.scenario),
        preparing=preparing_of(store, want),
    )


def once_each(uploads: list[Upload]) -> list[tuple[str, str]]:
    """Files of recordings with their names; of those that are called alike, with a number."""
    found: list[tuple[str, str]] = []
    for upload in uploads:
        path, name = upload.file
        taken = {other for _, other in found}
        stem, ending = Path(name).stem, Path(name).suffix
        number = 1
        while name in taken:
            number += 1
            name = f"{stem} ({number}){ending}"
        found.append((path, name))
    return found


# ---- What the page draws ----


def _folder_of(store: Store, id: str, *kinds: str) -> Path:
    """Folder of a computation of one of some kinds that is done; Refused for another."""
    job = done(store, id)
    if job.kind not in kinds:
        raise RequestRefused(404, f"this computation is not one of: {', '.join(kinds)}")
    return store.folder(job)


@routes.get("/analyses/{id}/spectrum")
def recorded_spectrum(
    id: Id,
    store: StoreDependency,
    of: Literal["amplitude", "density", "background"] = "amplitude",
    points: Points = 4000,
    low: From = None,
    high: To = None,
    log: Log = False,
) -> RecordedSpectrum:
    """Amplitude spectrum, 0-to-peak, power spectral density, or amplitude spectrum of the background, of
    an analysed recording.
    """
    f, y = np.load(there(_folder_of(store, id, "analysis") / f"{of}.npy"), mmap_mode="r")
    f, y = stretch(f, y, low, high, points, log)
    return RecordedSpectrum(f=f, values=y)


@routes.get("/analyses/{id}/waterfall")
def recorded_waterfall(
    id: Id,
    store: StoreDependency,
    low: From = None,
    high: To = None,
    begin: Time = None,
    end: Time = None,
) -> RecordedMap:
    """Waterfall of an analysed or tracked recording between two frequencies [Hz] and two times [s]."""
    folder = _folder_of(store, id, "analysis", "tracking")
    cells = np.load(there(folder / "waterfall.npy"), mmap_mode="r")
    t = np.load(there(folder / "waterfall-time.npy"))
    f = np.load(there(folder / "waterfall-frequency.npy"))
    rows, columns = _part(t, begin, end), _part(f, low, high)
    shown, down, across = largest_in_cells(np.asarray(cells[rows, columns]), _ROWS, _COLUMNS)
    return RecordedMap(
        f=f[columns][across].tolist(),
        t=t[rows][down].tolist(),
        amplitude=[[float(f"{value:.4g}") for value in row] for row in shown.tolist()],
    )


def _part(axis: np.ndarray, low: float | None, high: float | None) -> slice:
    """Places of an ascending axis from ``low`` to ``high``, at least one."""
    first = 0 if low is None else int(np.searchsorted(axis, low))
    last = axis.size if high is None else int(np.searchsorted(axis, high, side="right"))
    first = min(first, axis.size - 1)
    return slice(first, max(last, first + 1))


@routes.get("/analyses/{id}/bands/{k}")
def band_series(
    id: Id,
    k: Annotated[int, PathParameter(ge=0, le=10_000)],
    store: StoreDependency,
    low: From = None,
    high: To = None,
    points: Pixels = 2000,
) -> RecordedSeries:
    """A window of the time history of an analysed recording's band, in seconds of the history itself."""
    folder = _folder_of(store, id, "analysis")
    found = mapped_pyramid(there(folder / f"band-{k}.samples"))
    if found is None:
        raise RequestRefused(404, "this band's time history is gone; process the recording again")
    return series_in(found, low, high, points, "")
