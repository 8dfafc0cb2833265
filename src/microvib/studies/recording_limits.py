"""Recordings against a limit: lines of one of their channels, or of all that the limit has a curve for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from microvib.analysis.limits import Judgement, judge_channel
from microvib.analysis.lines import lines_of_recording, shortest_judged_record
from microvib.analysis.orders import lines_without_clock
from microvib.analysis.usable import with_force_table
from microvib.errors import MicrovibError, OptionError, expect
from microvib.io.recordings import Prepared
from microvib.io.sources import Source
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.signals.line_fit import with_background
from microvib.signals.line_table import LineTable
from microvib.studies.compare import (
    Comparison,
    compare,
    drive_of_sides,
    lacking_within,
    misread,
    misreads_amplitudes,
)
from microvib.testdata.recording import Recording, require_usable_channel


def judge_recording(
    source: Source | Recording,
    limit: Limit,
    *,
    channel: str = "Mz",
    scenario: GivenScenario | None = None,
) -> Judgement:
    """Judge the lines of one channel of a recording against a limit.

    The limit's curve of that load counts, or where it has none that of the torque about the drive
    axis. Beyond the recording's passband, and where its force table does not show what there is,
    nothing is judged. Nor does a torque pass that would be like the scenario's in another unit, has
    its lines on another axis, or far less of all its main lines.

    Parameters
    ----------
    source : Prepared or Recording
        The recording, in SI units.
    limit : Limit
        What is allowed.
    channel : str
        Channel whose lines are judged.
    scenario : Scenario, str or path, optional
        The drive that was measured, which gives its lines names, and is simulated to see whether the
        torque is in the unit that it says.

    Returns
    -------
    Judgement
        The verdict, the margin of each line, and what was not judged.

    Raises
    ------
    OptionError
        For a source that is no recording, and a limit that has nothing for the channel.
    RecordingError
        Where the channel cannot be used, or the record is too short.
    """
    expect(limit, Limit, "a limit, such as mv.Limit('10 mN*m')")
    if isinstance(source, Recording):
        source = Prepared(source)
    if not isinstance(source, Prepared):
        raise OptionError(
            "limit",
            "applies to recordings here; a scenario is judged as it is run (microvib run), a run's"
            " folder by microvib report",
        )
    guide = None if scenario is None else as_scenario(scenario)
    axis = None if guide is None else f"M{guide.array.drive_axis}"
    of_torque = not limit.is_one_number and channel not in limit.loads
    if of_torque and channel in COMPONENTS and axis not in (None, channel):
        raise OptionError(
            "limit",
            f"has no curve of {channel} ({channel.lower()}_nm); its curve of the torque is that about"
            f" the scenario's drive axis, {axis}",
        )
    table = lines_of_channel(source, channel, guide)
    judged = judge_channel(table, limit, channel if channel in COMPONENTS else "")
    beside = beside_scenario(source, channel, guide)
    curve = limit.loads.get(channel, limit.curve)
    return replace(
        judged,
        gaps=(*judged.gaps, *misread_gaps(beside, curve)),
        assumption=source.recording.chain_assumption,
    )


def beside_scenario(source: Prepared, channel: str, scenario: Scenario | None) -> Comparison | None:
    """A torque about the drive axis beside the scenario, which is simulated; None for another load, without a
    scenario, and where they cannot be compared.
    """
    if scenario is None or (channel in COMPONENTS and channel != f"M{scenario.array.drive_axis}"):
        return None
    try:
        return compare(source, scenario, channel=channel)
    except MicrovibError:
        return None


def misread_gaps(found: Comparison | None, curve: LimitCurve | None) -> tuple[str, ...]:
    """Why a recording, compared with a scenario, is not what a limit's ``curve`` is about, as ``misread_in_band``
    has it of the curve's band. Empty without a comparison.
    """
    return misread_in_band(found, None if curve is None else (curve.low, curve.high))


def misread_in_band(found: Comparison | None, ends: tuple[float, float] | None) -> tuple[str, ...]:
    """Why a recording, compared with a scenario, does not show its loads between two ``ends`` [Hz]: its lines are
    those of the scenario in another unit, those of another axis, or all far smaller, everywhere or in the
    band. Empty without a comparison.
    """
    if found is None:
        return ()
    if misreads_amplitudes(*found):
        told = misread(*found)
    else:
        told = () if ends is None else lacking_within(*found, *ends)
    said = (sentence.rstrip(".?") for sentence in told)
    return tuple(f"the recording (A) beside the scenario (B): {one}" for one in said)


def judge_components(
    recording: Recording, limit: Limit, scenario: GivenScenario
) -> Iterator[Judgement]:
    """Judgements of every component that the limit has a curve for, and of the drive axis by that of its
    torque.
    """
    axis = f"M{as_scenario(scenario).array.drive_axis}"
    channels = [*limit.loads, *([axis] if limit.curve and axis not in limit.loads else [])]
    for channel in channels:
        yield judge_recording(recording, limit, channel=channel, scenario=scenario)


def judge_sides(
    sources: tuple[Source, Source], limit: Limit | None, channel: str, scenario: Scenario | None
) -> tuple[Judgement | None, ...]:
    """Judgements of each side of a comparison that is a recording; None of another one. Nothing without a
    limit. OptionError where no side is a recording.

    The drive is that of ``drive_of_sides``, at its own clock.
    """
    if limit is None:
        return ()
    if not any(isinstance(source, Prepared) for source in sources):
        judge_recording(sources[0], limit)
    drive = drive_of_sides(*sources, scenario)
    return tuple(
        judge_recording(source, limit, channel=channel, scenario=drive)
        if isinstance(source, Prepared)
        else None
        for source in sources
    )


def lines_of_channel(
    prepared: Prepared, channel: str, scenario: GivenScenario | None = None
) -> LineTable:
    """Find the lines of a recording's channel that are judged: of the drive-axis torque by their
    names, of another load all that stand above the floor.

    Parameters
    ----------
    prepared : Prepared
        The recording and its background.
    channel : str
        The channel.
    scenario : Scenario, str or path, optional
        The drive that was measured, which gives its lines names.

    Returns
    -------
    LineTable
        Its lines.

    Raises
    ------
    RecordingError
        Where the channel cannot be used, or the record is too short.
    """
    guide = None if scenario is None else as_scenario(scenario)
    axis = None if guide is None else f"M{guide.array.drive_axis}"
    recording = prepared.recording
    other = channel in COMPONENTS and (channel.startswith("F") or axis not in (None, channel))
    if other:
        shortest = shortest_judged_record(recording, None)
        require_usable_channel(recording, channel, shortest)
        table = lines_without_clock(recording, channel)
        if prepared.background is not None:
            require_usable_channel(prepared.background, channel, shortest)
            table = with_background(table, prepared.background[channel])
        return with_force_table(table, recording, channel)
    return lines_of_recording(recording, channel, guide, prepared.background)
