"""All that one torque tells: lines, amplitude spectrum, density, cumulative RMS, waterfall, bands."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from microvib.analysis import spectra
from microvib.analysis.background import (
    BackgroundLine,
    background_notes,
    lines_of_background,
)
from microvib.analysis.lines import (
    CLOCK_TOLERANCE,
    clock_warnings,
    lines_of_recording,
    lines_of_samples,
    recording_warnings,
    shortest_record,
)
from microvib.analysis.orders import (
    FULL_STEPS,
    OrderLine,
    StepClock,
    lines_at_orders,
    lines_without_clock,
    order_lines,
)
from microvib.analysis.steadiness import steadiness_notes
from microvib.analysis.usable import force_table_notes
from microvib.errors import MicrovibError, OptionError
from microvib.io.band_limits import BandLimit
from microvib.io.recordings import Prepared
from microvib.io.sources import RunFolder, Source, open_source
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.line_fit import with_background
from microvib.signals.line_table import LineTable
from microvib.signals.spectrum import Average, Density, Spectrum, Waterfall, Window
from microvib.solve.integration import Progress
from microvib.solve.simulate import simulate
from microvib.studies.bands import BandPeak, Gaps, judge_bands, reasons_of_lines
from microvib.studies.recording_limits import beside_scenario, misread_in_band
from microvib.testdata.channels import ACCELERATIONS
from microvib.testdata.recording import Recording, require_usable_channel
from microvib.testdata.section import Section
from microvib.units import Band, GivenQuantity, Si, band

NO_CLOCK_NOTE = (
    "lines are not identified, because neither a step rate nor a scenario was given to name them"
)
_BAND_BINS = 4.0
"""Bins of the density below which a band has a note."""
NO_SCENARIO_NOTE = "lines are not identified, because no scenario was given to predict them"


@dataclass(frozen=True)
class Analysis:
    """One channel of one source, seen in every way."""

    name: str
    channel: str
    unit: str
    """``N``, ``N*m``, ``m/s^2`` or ``g``."""
    recording: Recording
    table: LineTable | None
    """Lines of the drive-axis torque, of an acceleration, or of any channel at the orders of a
    stated step clock; None for another channel.
    """
    clock_ratio: float | None
    """Step clock over nominal; None where no line of the clock is seen."""
    spectrum: Spectrum
    density: Density
    """Power spectral density; the background's is subtracted where there is one."""
    waterfall: Waterfall
    bands: tuple[tuple[float, float, float], ...]
    """Lower and upper end [Hz] of the bands asked for, and their RMS."""
    background: Spectrum | None = None
    """Amplitude spectrum of the background, where there is one."""
    background_lines: tuple[BackgroundLine, ...] = ()
    """Lines of the background, the largest first."""
    orders: tuple[OrderLine, ...] = ()
    """Orders of the electrical period, where a step clock was stated, or the channel is an
    acceleration and the scenario has one.
    """
    band_peaks: tuple[BandPeak, ...] = ()
    """Peaks in bands against their limits, where limits were given."""


def analyse(  # noqa: PLR0913 - keyword options
    source: Source | Recording | str | os.PathLike[str],
    *,
    name: str = "",
    scenario: GivenScenario | None = None,
    channel: str = "Mz",
    step_rate: GivenQuantity | None = None,
    steps_per_period: int = FULL_STEPS,
    window: Window = "hann",
    resolution: GivenQuantity | None = None,
    bands: Sequence[Band] = (),
    section: Section | None = None,
    average: Average = "none",
    overlap: float = 0.5,
    band_limits: Sequence[BandLimit] = (),
    roll_off: float | None = None,
    progress: Progress | None = None,
) -> Analysis:
    """Find the lines and spectra of a scenario, a run's folder or a recording.

    Nothing is judged here, so a record may be as short as its lines allow: each line that it does
    not resolve says so, with the length that would.

    Parameters
    ----------
    source : Scenario, RunFolder, Recording, Prepared, str or path
        What is analysed; a name is one that ``open_source`` takes.
    name : str
        What a scenario is called.
    scenario : Scenario, str or path, optional
        Says which lines to look for in a recording; without it those above the noise floor are not named.
    channel : str
        Channel with the torque about the drive axis; of a recording also a force or an
        acceleration.
    step_rate : str or Si, optional
        Steps per second of the recorded motor, such as ``"4000 Hz"``, in place of a scenario: lines
        are then looked for at the orders of the electrical period.
    steps_per_period : int
        Steps of that rate per electrical period: of a two-phase motor 4 times its microsteps per
        full step.
    window : {"rectangular", "hann", "flat-top"}
        Window of the spectra.
    resolution : str or Si, optional
        Distance between bins of density and waterfall, such as ``"0.5 Hz"``.
    bands : sequence of str or pairs
        Bands whose RMS is wanted, such as ``["0.5:5 Hz"]``.
    section : Section, optional
        Part of a recording, between two times or from a trigger on.
    average : {"none", "linear", "peak-hold", "exponential"}
        How stretches of 1/``resolution`` become one amplitude spectrum; *none* transforms all
        samples at once.
    overlap : float
        Part of a stretch that the next one shares.
    band_limits : sequence of BandLimit
        Bands in which the time history is judged by its peak.
    roll_off : float, optional
        Roll-off of the filters of these bands.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.

    Returns
    -------
    Analysis
        Lines, spectrum, density, waterfall, and RMS in the bands.

    Raises
    ------
    MicrovibError
        Where the source is too short, or its channel is neither a force, a torque nor an
        acceleration.
    """
    opened = opened_source(source)
    guide = None if scenario is None else as_scenario(scenario)
    opened = section_of(opened, section)
    clock = _step_clock(opened, guide, channel, step_rate, steps_per_period)
    if isinstance(opened, Prepared) and (clock or _is_acceleration(opened.recording, channel)):
        recording, background, table, expected = _at_orders(opened, channel, guide, clock)
    else:
        recording, background, table, expected = _source(opened, name, guide, channel, progress)
    if table is None:
        found = None
    else:
        found = table.clock_ratio
    recording.load_or_acceleration(channel)  # which refuses what is none of them
    density = spectra.psd(recording, channel, resolution, window, overlap)
    of_background = None
    if background is not None:
        density = density.less(
            spectra.psd(background, channel, Si(density.resolution), window, overlap)
        )
        of_background = spectra.spectrum(background, channel, window)
        for note in background_notes(recording, background, channel, table):
            recording = recording.noted(note)
    in_bands = tuple(_rms_in_bands(density, bands))
    recording = _with_notes_on_narrow_bands(recording, density, in_bands)
    return Analysis(
        name=name or recording.title,
        channel=channel,
        unit=recording.units[channel],
        recording=recording,
        table=table,
        clock_ratio=None if found is None else found * expected,
        spectrum=spectra.averaged_spectrum(
            recording, average, channel, resolution, window, overlap
        ),
        density=density,
        waterfall=spectra.waterfall(recording, channel, resolution, window, overlap),
        bands=in_bands,
        background=of_background,
        background_lines=lines_of_background(recording, background, channel, table),
        orders=_orders(table, recording[channel]) if clock else (),
        band_peaks=judge_bands(
            recording,
            band_limits,
            channel,
            roll_off=roll_off,
            background=background,
            **(_reasons_of(opened, guide, channel, table) if band_limits else {}),
        ),
    )


def _with_notes_on_narrow_bands(
    recording: Recording, density: Density, in_bands: Sequence[tuple[float, float, float]]
) -> Recording:
    """The recording with a note on each band that is narrower than a few bins of its density."""
    for low, high, _ in in_bands:
        if high - low < _BAND_BINS * density.resolution:
            recording = recording.noted(
                f"the band from {low:g} to {high:g} Hz is narrower than {_BAND_BINS:g} bins of the density,"
                f" {density.resolution:g} Hz each: its RMS is a part of theirs, and a window's leakage is in it"
            )
    return recording


def _rms_in_bands(density: Density, bands: Sequence[Band]) -> Iterator[tuple[float, float, float]]:
    """Bands [Hz] and their RMS; OptionError for one that reaches above half the sample rate."""
    top = 0.5 * density.sample_rate
    for low, high in map(band, bands):
        if high > top * (1.0 + 1e-9):
            raise OptionError(
                "band",
                f"{low:g} to {high:g} Hz is not allowed; the record shows frequencies up to half its"
                f" sample rate, {top:g} Hz",
            )
        yield low, high, density.band_rms(low, high)


def opened_source(source: Source | Recording | str | os.PathLike[str]) -> Source:
    """A source of a name; a recording as one that needs no preparation."""
    if isinstance(source, Recording):
        return Prepared(source)
    if isinstance(source, (str, os.PathLike)):
        return open_source(os.fspath(source))
    return source


def section_of(source: Source, section: Section | None) -> Source:
    """A section of a recording, all of it without one; OptionError for a section of a simulation."""
    if section is None:
        return source
    if not isinstance(source, Prepared):
        raise OptionError(
            "from",
            "sections are of recordings; of a simulation, record.settle and record.duration say"
            " which part is recorded",
        )
    return replace(source, recording=section.cut(source.recording)[0])


def _reasons_of(
    source: Source, guide: Scenario | None, channel: str, table: LineTable | None
) -> dict[str, Any]:
    """Reasons why bands are not judged, for ``judge_bands``: of a simulated torque those for which its
    lines are not, of a recording of a drive that what is seen may not be that drive, or not all of it.
    """
    if isinstance(source, Scenario):
        scenario: Scenario | None = source
    elif isinstance(source, RunFolder):
        scenario = source.scenario or guide
    elif guide is None or table is None:
        return {}
    else:
        return {"gaps": _recording_gaps(source, guide, channel, table)}
    return {} if table is None else reasons_of_lines(table, scenario)


def _recording_gaps(source: Source, guide: Scenario, channel: str, table: LineTable) -> Gaps:
    """Reasons to question that a band of a recording shows the drive: the same in every band, that it is of
    the drive at its rate, and those that keep lines between the band's ends from passing.
    """
    everywhere = tuple(clock_warnings(table))
    compared = beside_scenario(source, channel, guide) if isinstance(source, Prepared) else None
    return lambda low, high, limit: (*everywhere, *misread_in_band(compared, (low, high)))


def _orders(table: LineTable | None, x: np.ndarray) -> tuple[OrderLine, ...]:
    return () if table is None else order_lines(table, x)


def _is_acceleration(recording: Recording, channel: str) -> bool:
    return channel not in COMPONENTS and recording.units.get(channel) in ACCELERATIONS


def _step_clock(
    source: Source,
    guide: Scenario | None,
    channel: str,
    step_rate: GivenQuantity | None,
    steps_per_period: int,
) -> StepClock | None:
    """The clock at whose orders lines are looked for: the stated one, or a scenario's where the
    channel is an acceleration, of which it predicts nothing else.
    """
    if step_rate is None:
        of_scenario = (
            guide is not None
            and isinstance(source, Prepared)
            and _is_acceleration(source.recording, channel)
        )
        return StepClock.of(guide) if guide is not None and of_scenario else None
    if not isinstance(source, Prepared):
        raise OptionError("step_rate", "applies to a recording; this source has its own step rate")
    if guide is not None:
        raise OptionError("step_rate", "the scenario has a step rate, too; give one of the two")
    return StepClock.stated(step_rate, steps_per_period)


def _at_orders(
    prepared: Prepared, channel: str, guide: Scenario | None, clock: StepClock | None
) -> tuple[Recording, Recording | None, LineTable | None, float]:
    """Lines of a channel at the orders of a step clock; all above the floor where none is known."""
    recording, expected = prepared.recording, 1.0
    if guide is not None:
        expected = guide.tracking.clock_ratio
    require_usable_channel(recording, channel, shortest_record(recording, None), acceleration=True)
    if clock is None:
        table = lines_without_clock(recording, channel)
        return recording.noted(NO_CLOCK_NOTE), prepared.background, table, expected
    table = lines_at_orders(recording, channel, clock)
    if prepared.background is not None:
        table = with_background(table, prepared.background[channel])
    if table.clock_ratio is None:
        recording = recording.noted(
            f"no order of {clock.electrical_frequency:.6g} Hz is above the noise floor within"
            f" {100.0 * CLOCK_TOLERANCE:g} % of the stated step rate"
        )
    for note in steadiness_notes(table):
        recording = recording.noted(note)
    return recording, prepared.background, table, expected


def _source(
    source: Source, name: str, guide: Scenario | None, channel: str, progress: Progress | None
) -> tuple[Recording, Recording | None, LineTable | None, float]:
    """Recording, background, lines, and the step clock over nominal at which the lines were
    expected.
    """
    match source:
        case Scenario():
            return _of_scenario(source, name, channel, progress)
        case RunFolder():
            return _of_run_folder(source, guide, channel)
        case Prepared():
            return _of_recording(source, guide, channel)
        case _:
            expected = "a scenario, the folder of a run or a recording"
            raise MicrovibError(
                f"{name or 'the source'}: lines alone cannot be analysed; expected {expected}"
            )


def _of_scenario(
    scenario: Scenario, name: str, channel: str, progress: Progress | None
) -> tuple[Recording, None, LineTable | None, float]:
    return _simulated_with_lines(torque_of(scenario, name, progress), channel, scenario)


def torque_of(scenario: Scenario, name: str, progress: Progress | None) -> Recording:
    """Simulated disturbance torque about the drive axis, as a recording called ``name``."""
    motion = simulate(scenario, channels=("T_d",), progress=progress)
    axis = "M" + scenario.array.drive_axis
    return Recording(
        {axis: motion["T_d"]}, motion.sample_rate, {axis: "N*m"}, name or scenario.title
    )


def _of_run_folder(
    folder: RunFolder, guide: Scenario | None, channel: str
) -> tuple[Recording, None, LineTable | None, float]:
    guide = folder.scenario or guide
    if folder.motion is None:
        raise MicrovibError(
            f"{folder.path}: is not a run folder with a motion; it has no motion.nc"
        )
    if guide is None:
        text = "has no scenario.yaml that says which lines to look for; name a scenario"
        raise MicrovibError(f"{folder.path}: {text}", remedy="scenario")
    return _simulated_with_lines(folder.motion, channel, guide)


def _of_recording(
    prepared: Prepared, guide: Scenario | None, channel: str
) -> tuple[Recording, Recording | None, LineTable | None, float]:
    recording, background = prepared.recording, prepared.background
    if not _may_be_drive_torque(channel, guide):
        require_usable_channel(recording, channel)
        if guide is not None:
            recording = recording.noted(
                f"{channel} is not the torque about the drive axis: its lines are not looked for"
            )
        return recording, background, None, 1.0
    table = lines_of_recording(recording, channel, guide, background, judged=False)
    if guide is None:
        recording = recording.noted(NO_SCENARIO_NOTE)
        for note in force_table_notes(table, recording, channel):
            recording = recording.noted(note)
        return recording, background, table, 1.0
    for note in recording_warnings(recording, channel, guide, table):
        recording = recording.noted(note)
    return recording, background, table, guide.tracking.clock_ratio


def _may_be_drive_torque(channel: str, guide: Scenario | None) -> bool:
    """Whether a channel may be the torque about the drive axis, as one is that is not called as a
    component.
    """
    if channel.startswith("F"):
        return False
    return guide is None or channel not in COMPONENTS or channel == "M" + guide.array.drive_axis


def _simulated_with_lines(
    recording: Recording, channel: str, guide: Scenario
) -> tuple[Recording, None, LineTable | None, float]:
    """A simulated torque with its lines, where the channel is the one about the drive axis."""
    table = None
    if channel == "M" + guide.array.drive_axis:
        table = lines_of_samples(recording[channel], recording.sample_rate, guide)
    without_chain = replace(recording, chain_stated=True)
    return without_chain, None, table, guide.tracking.clock_ratio
