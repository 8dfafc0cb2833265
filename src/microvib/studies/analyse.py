"""All that one torque tells: lines, amplitude spectrum, density, cumulative RMS, waterfall, bands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from microvib.analysis.lines import lines_of_samples
from microvib.errors import MicrovibError
from microvib.io.recordings import READERS, read_prepared, read_recording
from microvib.io.scenario_file import catalog_names, load_scenario
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.signals.spectrum import (
    Density,
    Spectrum,
    Waterfall,
    Window,
    amplitude_spectrum,
    power_spectral_density,
    waterfall,
)
from microvib.solve.simulate import Progress, simulate
from microvib.studies.evidence import measured_lines
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import COMPONENTS, Recording, check
from microvib.units import pretty

NO_DRIVE = "lines are not named, for no drive was; name it with --scenario"


@dataclass(frozen=True)
class Analysis:
    """One channel of one source, seen in every way."""

    name: str
    channel: str
    unit: str
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


def analyse(
    source: str,
    *,
    scenario: str | None = None,
    channel: str = "Mz",
    preparation: Preparation | None = None,
    window: Window = "hann",
    resolution: float | None = None,
    bands: Sequence[tuple[float, float]] = (),
    progress: Progress | None = None,
) -> Analysis:
    """Lines and spectra of a scenario, a run folder or a recording.

    ``scenario`` says which lines to look for in a recording; without it those that stand out are not named. ``resolution``
    [Hz] is that of density and waterfall. MicrovibError where the source cannot be read or is too short.
    """
    guide = None if scenario is None else load_scenario(scenario)
    recording, background, table, expected = _source(source, guide, channel, preparation, progress)
    found = None if table is None else table.clock_ratio
    x, rate = recording.load(channel), recording.sample_rate
    density = power_spectral_density(x, rate, resolution, window)
    if background is not None:
        density = density.less(power_spectral_density(background[channel], rate, density.resolution, window))
    return Analysis(
        name=source,
        channel=channel,
        unit=pretty(recording.units[channel]),
        recording=recording,
        table=table,
        clock_ratio=None if found is None else found * expected,
        spectrum=amplitude_spectrum(x, rate, window),
        density=density,
        waterfall=waterfall(x, rate, resolution, window),
        bands=tuple((low, high, density.band_rms(low, high)) for low, high in bands),
    )


def _source(
    source: str, guide: Scenario | None, channel: str, preparation: Preparation | None, progress: Progress | None
) -> tuple[Recording, Recording | None, LineTable | None, float]:
    """Recording, background, lines, and the step clock over nominal at which the lines were expected."""
    path = Path(source)
    if source in catalog_names() or path.suffix.lower() in (".yaml", ".yml"):
        recording, guide = _simulated(source, load_scenario(source), progress)
        return recording, None, _lines(recording, channel, guide), guide.tracking.clock_ratio
    if path.is_dir():
        if not (path / "motion.nc").is_file():
            raise MicrovibError(f"{path}: is not a run folder with a motion; it has no motion.nc")
        if (path / "scenario.yaml").is_file():
            guide = load_scenario(path / "scenario.yaml")
        recording = read_recording(path / "motion.nc")
        if guide is None:
            raise MicrovibError(
                f"{path}: has no scenario.yaml that says which lines to look for; name one with --scenario"
            )
        return recording, None, _lines(recording, channel, guide), guide.tracking.clock_ratio
    if path.suffix.lower() not in READERS:
        raise MicrovibError(
            f"{source}: cannot be analysed; expected a scenario, a run folder or a recording ({', '.join(READERS)})"
        )
    if channel.startswith("F") or not _about_the_axis(channel, guide):
        prepared = read_prepared(path, preparation)
        check(prepared.recording, channel)
        return prepared.recording, prepared.background, None, 1.0
    prepared, table = measured_lines(path, guide, channel, preparation)
    if guide is None:
        return prepared.recording.noted(NO_DRIVE), prepared.background, table, 1.0
    return prepared.recording, prepared.background, table, guide.tracking.clock_ratio


def _simulated(name: str, scenario: Scenario, progress: Progress | None) -> tuple[Recording, Scenario]:
    motion = simulate(scenario, channels=("T_d",), progress=progress)
    axis = "M" + scenario.array.drive_axis
    return Recording({axis: motion["T_d"]}, motion.sample_rate, {axis: "N*m"}, name), scenario


def _about_the_axis(channel: str, guide: Scenario | None) -> bool:
    """Whether a channel is the torque about the drive axis; one that is not called as a component is meant as it."""
    return guide is None or channel not in COMPONENTS or channel == "M" + guide.array.drive_axis


def _lines(recording: Recording, channel: str, guide: Scenario) -> LineTable | None:
    if channel != "M" + guide.array.drive_axis:
        return None
    return lines_of_samples(recording[channel], recording.sample_rate, guide)
