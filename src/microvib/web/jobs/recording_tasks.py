"""Tasks of workers about recordings: reading, processing, tracking, comparing. Each leaves ``result.json``
in its folder, and what belongs to it; errors are MicrovibErrors.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from microvib.analysis.limits import Judgement
from microvib.errors import MicrovibError
from microvib.io.file_access import NO_FILES
from microvib.io.kept_recording import keep_recording, kept_recording
from microvib.io.pyramid_files import pyramid_parts
from microvib.io.recordings import (
    Prepared,
    beside_background,
    preparation_from_text,
    read_prepared,
    read_recording,
)
from microvib.io.scenario_file import scenario_of
from microvib.io.tables import to_json
from microvib.io.yaml_text import parse_yaml
from microvib.model.scenario import Scenario
from microvib.model.sentences import validate_part
from microvib.reports.analysis import analysis_outcome
from microvib.reports.batch import batch_outcome
from microvib.reports.comparison import comparison_outcome
from microvib.reports.outcome import page_answer
from microvib.reports.repeatability import repeatability_outcome
from microvib.signals.limit_curve import Limit
from microvib.signals.pyramid import Pyramid
from microvib.signals.screen import largest_in_cells
from microvib.studies.analyse import Analysis, analyse
from microvib.studies.bands import band_history
from microvib.studies.batch import batch_of
from microvib.studies.compare import compare
from microvib.studies.cut_limits import cuts_against
from microvib.studies.recording_limits import judge_recording, judge_sides
from microvib.studies.repeatability import RecordedRun, repeatability
from microvib.studies.track import track_orders
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording
from microvib.web.jobs import ProgressCallback, recording_results
from microvib.web.jobs.processing import NOT_SENT_WITH, Part, Preparing, Processing, RecordedFile
from microvib.web.jobs.sent_tables import sent_tables

_CELLS = 8_000, 4_000
"""Rows and columns of a waterfall that are kept, at most."""


def _processed(
    how: Processing, source: Prepared, channel: str, scenario: Scenario, name: str
) -> Analysis:
    """The analysis of a source that its owner calls ``name``."""
    return analyse(
        source,
        name=name,
        scenario=scenario,
        channel=channel,
        window=how.window,
        resolution=how.resolution,
        average=how.average,
        overlap=how.overlap,
        band_limits=how.band_limits,
        roll_off=how.roll_off,
    )


def _judged(
    how: Processing, source: Prepared, channel: str, scenario: Scenario
) -> Judgement | None:
    """The lines of a source against the limit; None without one."""
    if how.limit is None:
        return None
    return judge_recording(source, how.limit, channel=channel, scenario=scenario)


def _write(folder: str, data: dict[str, Any]) -> None:
    (Path(folder) / "result.json").write_text(to_json(data), encoding="utf-8")


def recording(path: str, name: str, tell: ProgressCallback) -> dict[str, Any]:
    """Contents of a recording that its owner calls ``name``; its samples are left beside its file."""
    found = _read(path, name)
    _keep_samples(found, path)
    channels = [
        {
            "name": key,
            "unit": found.units.get(key, ""),
            "rms": float(np.std(x)) if x.size else math.nan,
        }
        for key, x in found.channels.items()
    ]
    facts = {"channels": channels, "sample_rate": found.sample_rate, "samples": found.samples}
    return dict(
        json.loads(to_json(facts | {"duration": found.duration, "notes": list(found.notes)}))
    )


def samples(path: str, name: str, tell: ProgressCallback) -> None:
    """Leave the samples of a recording beside its file: an older version left none."""
    _keep_samples(_read(path, name), path)


def _keep_samples(found: Recording, path: str) -> None:
    try:
        keep_recording(found, Path(path).parent)
    except OSError as error:
        raise MicrovibError(
            f"{found.title}: its samples could not be stored: {error.strerror or error}"
        ) from None


def recorded(upload: RecordedFile) -> Recording:
    """A recording whose samples are beside its file, or which is read from it."""
    path, name = upload
    return kept_recording(Path(path).parent, name) or _read(path, name)


def _read(path: str, name: str) -> Recording:
    """A recording under the name that its owner gave it, as are errors and notes about it."""
    try:
        found = read_recording(path)
    except MicrovibError as error:
        raise MicrovibError(str(error).replace(path, name)) from None
    return replace(found, title=name, notes=tuple(note.replace(path, name) for note in found.notes))


def _in_unit(whole: Recording, channel: str, unit: str) -> Recording:
    """A recording whose channel is in a stated unit; what is wrong with samples is asked later."""
    if not unit:
        return whole
    stated = validate_part(Preparation, {"units": {channel: unit}}, origin=whole.title)
    return replace(stated.apply(whole), faults=None, alone=None)


def preparation(folder: str, preparing: Preparing | None) -> Preparation | None:
    """The preparation that a request states; None without one."""
    if preparing is None:
        return None
    with sent_tables(Path(folder), preparing.tables, NOT_SENT_WITH) as files:
        return preparation_from_text(preparing.text, files, preparing.recordings)


def prepared(
    upload: RecordedFile, how: Preparation | None, background: RecordedFile | None = None
) -> Prepared:
    """A recording as it is, or as a preparation makes it of its file, beside a background where one is given
    or the preparation names one.
    """
    if how is None:
        alone = recorded(upload)
        return (
            Prepared(alone)
            if background is None
            else beside_background(alone, recorded(background))
        )
    if background is not None:
        if how.background is not None:
            raise MicrovibError(
                "background: is stated in the preparation, too; leave one of them out"
            )
        how = how.model_copy(update={"background": background[0]})
    path, name = upload
    called = {path: name} if how.background is None else {path: name, how.background: "background"}
    if background is not None:
        called[background[0]] = background[1]

    def renamed(text: str) -> str:
        for file, its in called.items():
            text = text.replace(file, its)
        return text

    def under_its_name(found: Recording) -> Recording:
        notes = tuple(map(renamed, found.notes))
        return replace(found, title=renamed(found.title), notes=notes)

    try:
        found = read_prepared(path, how)
    except MicrovibError as error:
        raise MicrovibError(renamed(str(error))) from None
    beside = None if found.background is None else under_its_name(found.background)
    return replace(found, recording=under_its_name(found.recording), background=beside)


def _in_units_of(source: Prepared, channel: str, unit: str) -> Prepared:
    beside = source.background
    return replace(
        source,
        recording=_in_unit(source.recording, channel, unit),
        background=None if beside is None else _in_unit(beside, channel, unit),
    )


def _prepared(
    recording: RecordedFile,
    channel: str,
    part: Part,
    how: Preparation | None,
    background: RecordedFile | None = None,
) -> tuple[Prepared, float]:
    """A section of a recording beside all of its background, and when it begins [s]."""
    whole = _in_units_of(prepared(recording, how, background), channel, part.unit)
    if part.section is None:
        return whole, 0.0
    cut, start = part.section.cut(whole.recording)
    return replace(whole, recording=cut), start


def analysis(  # noqa: PLR0913 - what a process is sent
    folder: str,
    recording: RecordedFile,
    scenario: Scenario,
    channel: str,
    part: Part,
    background: RecordedFile | None,
    processing: Processing,
    tell: ProgressCallback,
) -> None:
    """Lines with uncertainties, spectra, waterfall and bands of a recording, or of a section of it."""
    tell(0, None, "", "reading and finding the lines")
    how = preparation(folder, part.preparing)
    source, start = _prepared(recording, channel, part, how, background)
    judged = _judged(processing, source, channel, scenario)
    found = _processed(processing, source, channel, scenario, recording[1])
    where = Path(folder)
    np.save(where / "amplitude.npy", [found.spectrum.frequency, found.spectrum.amplitude])
    np.save(where / "density.npy", [found.density.frequency, found.density.density])
    if found.background is not None:
        np.save(where / "background.npy", [found.background.frequency, found.background.amplitude])
    w = found.waterfall
    _keep_waterfall(where, w.frequency, w.time + start, w.amplitude)
    tell(0, None, "", "splitting into bands")
    bands = [_keep_band(where, k, source.recording, found, start) for k in _bands(found)]
    _write(folder, recording_results.analysis_result(found, start, bands, judged))


def _bands(found: Analysis) -> range:
    return range(len(found.band_peaks))


def _keep_waterfall(where: Path, f: np.ndarray, t: np.ndarray, amplitude: np.ndarray) -> None:
    """Keep a map of amplitudes (t, m), thinned where it is large."""
    cells, down, across = largest_in_cells(amplitude, *_CELLS)
    np.save(where / "waterfall.npy", cells.astype(np.float32))
    np.save(where / "waterfall-time.npy", t[down])
    np.save(where / "waterfall-frequency.npy", f[across])


def _keep_band(
    where: Path, k: int, recording: Recording, found: Analysis, start: float
) -> dict[str, Any]:
    """Keep the time history of a band, and say what it is."""
    peak = found.band_peaks[k]
    history, rate = band_history(recording, peak), recording.sample_rate
    span = None
    if history is not None:
        begins = start + history.first / rate
        span = [begins, begins + history.values.size / rate]
        made = Pyramid.of(history.values, rate)
        with (where / f"band-{k}.samples").open("wb") as file:
            for part in pyramid_parts(made):
                file.write(part)
    return {
        "channel": peak.channel,
        "low": peak.low,
        "high": peak.high,
        "limit": peak.limit,
        "unit": peak.unit,
        "peak": peak.peak,
        "time": start + peak.time,
        "verdict": peak.verdict,
        "why": peak.why,
        "span": span,
    }


def tracking(  # noqa: PLR0913 - what a process is sent
    folder: str,
    recording: RecordedFile,
    channel: str,
    orders: Sequence[float],
    reference: dict[str, Any],
    part: Part,
    tell: ProgressCallback,
    fixed: Sequence[str] = (),
    bandwidth: str | None = None,
    limit: Limit | None = None,
) -> None:
    """Orders through a rate sweep: cuts, order map, waterfall, and the cuts against a limit. No file is
    opened, whatever a profile is called.
    """
    tell(0, None, "", "finding the speed and tracking the orders")
    whole, _ = _prepared(
        recording, channel, replace(part, section=None), preparation(folder, part.preparing)
    )
    found = track_orders(
        whole,
        orders,
        channel=channel,
        section=part.section,
        fixed=fixed,
        bandwidth=bandwidth,
        files=NO_FILES,
        **reference,
    )
    found = replace(found, name=recording[1])
    against = None if limit is None else cuts_against(found, limit)
    cut, w = found.cuts[0], found.waterfall
    start = 0.0 if part.section is None else part.section.cut(whole.recording)[1]
    _keep_waterfall(Path(folder), w.frequency, w.time + float(cut.time[0]) + start, w.amplitude)
    _write(folder, recording_results.tracking_result(found, against, start))


def comparison(  # noqa: PLR0913 - what a process is sent
    folder: str,
    recording: RecordedFile,
    channel: str,
    tell: ProgressCallback,
    run: str | None = None,
    run_title: str = "",
    other: RecordedFile | None = None,
    scenario: Scenario | None = None,
    preparing: Preparing | None = None,
    limit: Limit | None = None,
) -> None:
    """Lines of a recording beside those of a run's scenario (its file), simulated at the clock that
    the recording shows, or beside another recording's.
    """
    how = preparation(folder, preparing)
    if other is None:
        text = Path(str(run)).read_text(encoding="utf-8")
        second: Any = scenario_of(parse_yaml(text, run_title), run_title)
    else:
        second = prepared(other, how)
    names = (recording[1], run_title if other is None else other[1])
    first = prepared(recording, how)
    found = compare(
        first, second, names=names, scenario=scenario, channel=channel,
        progress=lambda done, total: tell(done, total, "s", "simulating"),
    )  # fmt: skip
    judged = judge_sides((first, second), limit, channel, scenario)
    outcome = comparison_outcome(*found, judged=judged)
    _write(folder, page_answer(outcome, pictures=other is not None))


def repeated(
    folder: str,
    runs: Sequence[tuple[RecordedFile, str]],
    channels: Sequence[str],
    scenario: Scenario,
    tell: ProgressCallback,
    preparing: Preparing | None = None,
) -> None:
    """Repeated tests of units: mean, scatter and outliers of their lines."""
    tell(0, None, "", "finding the lines of all recordings")
    how = preparation(folder, preparing)
    tests = [RecordedRun(file[1], prepared(file, how), unit) for file, unit in runs]
    found = repeatability(tests, scenario=scenario, channels=channels)
    _write(folder, page_answer(repeatability_outcome(found), pictures=True))


def batch(  # noqa: PLR0913 - what a process is sent
    folder: str,
    recordings: Sequence[RecordedFile],
    channel: str,
    scenario: Scenario,
    part: Part,
    background: RecordedFile | None,
    processing: Processing,
    tell: ProgressCallback,
) -> None:
    """Several recordings processed alike, with their figures and spectra side by side."""
    found, outcomes, how = [], [], preparation(folder, part.preparing)
    for k, one in enumerate(recordings):
        tell(k, len(recordings), "recordings", f"processing {one[1]}")
        source, _ = _prepared(one, channel, part, how, background)
        judged = _judged(processing, source, channel, scenario)
        found.append(_processed(processing, source, channel, scenario, one[1]))
        outcomes.append(analysis_outcome(found[-1], judged, with_spectra_files=False))
    names = [one[1] for one in recordings]
    answer = page_answer(batch_outcome(batch_of(names, found), outcomes), pictures=True)
    _write(folder, answer | recording_results.spectra_of(found))
