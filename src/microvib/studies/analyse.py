"""All that one torque tells: lines, amplitude spectrum, density, cumulative RMS, waterfall, bands."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from microvib.analysis import spectra
from microvib.analysis.lines import lines_of_recording, lines_of_samples, recording_warnings
from microvib.analysis.usable import force_table_notes
from microvib.errors import MicrovibError
from microvib.io.recordings import Prepared
from microvib.io.sources import RunFolder, Source, open_source
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.line_table import LineTable
from microvib.signals.spectrum import Density, Spectrum, Waterfall, Window
from microvib.solve.integration import Progress
from microvib.solve.simulate import simulate
from microvib.testdata.recording import Recording, require_usable_channel
from microvib.units import Band, GivenQuantity, Si, band

NO_SCENARIO_NOTE = "lines are not identified, because no scenario was given to predict them"


@dataclass(frozen=True)
class Analysis:
    """One channel of one source, seen in every way."""

    name: str
    channel: str
    unit: str
    """``N`` or ``N*m``."""
    recording: Recording
    table: LineTable | None
    """Lines of the drive-axis torque; None for another channel."""
    clock_ratio: float | None
    """Step clock over nominal; None where no line of the clock is seen."""
    spectrum: Spectrum
    density: Density
    """Power spectral density; the background's is subtracted where there is one."""
    waterfall: Waterfall
    bands: tuple[tuple[float, float, float], ...]
    """Lower and upper end [Hz] of the bands asked for, and their RMS."""


def analyse(  # noqa: PLR0913 - keyword options
    source: Source | str | os.PathLike[str],
    *,
    name: str = "",
    scenario: GivenScenario | None = None,
    channel: str = "Mz",
    window: Window = "hann",
    resolution: GivenQuantity | None = None,
    bands: Sequence[Band] = (),
    progress: Progress | None = None,
) -> Analysis:
    """Find the lines and spectra of a scenario, a run's folder or a recording.

    Parameters
    ----------
    source : Scenario, RunFolder, Prepared, str or path
        What is analysed; a name is one that ``open_source`` takes.
    name : str
        What a scenario is called.
    scenario : Scenario, str or path, optional
        Says which lines to look for in a recording; without it those above the noise floor are not named.
    channel : str
        Channel with the torque about the drive axis.
    window : {"rectangular", "hann", "flat-top"}
        Window of the spectra.
    resolution : str or Si, optional
        Distance between bins of density and waterfall, such as ``"0.5 Hz"``.
    bands : sequence of str or pairs
        Bands whose RMS is wanted, such as ``["0.5:5 Hz"]``.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.

    Returns
    -------
    Analysis
        Lines, spectrum, density, waterfall, and RMS in the bands.

    Raises
    ------
    MicrovibError
        Where the source is too short, or its channel is neither a force nor a torque.
    """
    opened = open_source(os.fspath(source)) if isinstance(source, (str, os.PathLike)) else source
    guide = None if scenario is None else as_scenario(scenario)
    recording, background, table, expected = _source(opened, name, guide, channel, progress)
    if table is None:
        found = None
    else:
        found = table.clock_ratio
    recording.load(channel)  # which refuses what is neither a force nor a torque
    density = spectra.psd(recording, channel, resolution, window)
    if background is not None:
        density = density.less(spectra.psd(background, channel, Si(density.resolution), window))
    return Analysis(
        name=name or recording.title,
        channel=channel,
        unit=recording.units[channel],
        recording=recording,
        table=table,
        clock_ratio=None if found is None else found * expected,
        spectrum=spectra.spectrum(recording, channel, window),
        density=density,
        waterfall=spectra.waterfall(recording, channel, resolution, window),
        bands=tuple((low, high, density.band_rms(low, high)) for low, high in map(band, bands)),
    )


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
    motion = simulate(scenario, channels=("T_d",), progress=progress)
    axis = "M" + scenario.array.drive_axis
    simulated = Recording(
        {axis: motion["T_d"]}, motion.sample_rate, {axis: "N*m"}, name or scenario.title
    )
    return _simulated_with_lines(simulated, channel, scenario)


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
    table = lines_of_recording(recording, channel, guide, background)
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
    return recording, None, table, guide.tracking.clock_ratio
