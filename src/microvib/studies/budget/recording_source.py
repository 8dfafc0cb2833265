"""Contribution of a drive to the line of sight by a recording of its loads on a force table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from microvib.analysis.lines import clock_warnings, expected_in, lines_of_recording
from microvib.analysis.margins import frequency_error_bound
from microvib.model.coupling import blocked_load_method, rotation_to_hub_axes
from microvib.model.drive_states import drive_states
from microvib.model.expected import ExpectedLine
from microvib.model.record import PASSBAND
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.signals.line_fit import lines_at_known_clock
from microvib.signals.line_table import (
    BELOW_FLOOR,
    DETECTION_RATIO,
    NOT_THE_DRIVES,
    Line,
    LineTable,
)
from microvib.studies.budget.recorded import below_all_bands, higher_orders, unaccounted
from microvib.studies.budget.sources import (
    BLOCKED_LOAD_UNCERTAINTY,
    Contribution,
    SoughtLoads,
    Unobserved,
    above_passband_gaps,
    both_errors,
    drive_uncertainty,
    low_frequency_gap,
    natural_frequencies,
    open_gap,
    response_uncertainty,
)
from microvib.testdata.recording import Recording, channel_fault


@dataclass(frozen=True)
class _RecordedLoads:
    """Loads on a force table at the expected lines of the clock, 0 where a channel is missing."""

    lines: tuple[ExpectedLine, ...]
    loads: np.ndarray  # with phases, (k, 6)
    floors: np.ndarray  # below which nothing is detected, (k, 6)
    tables: dict[str, LineTable]  # by channel


def _recorded_loads(
    recording: Recording, scenario: Scenario, harmonics: int, clock_ratio: float
) -> _RecordedLoads:
    """Complex amplitudes of each channel at the lines of the known clock."""
    lines = tuple(
        replace(
            line,
            frequency=clock_ratio * line.frequency,
            low=clock_ratio * line.frequency,
            high=clock_ratio * line.frequency,
        )
        for line in expected_in(scenario, recording.sample_rate, harmonics)
        if line.of_clock
    )
    loads, floors = np.zeros((len(lines), 6), dtype=complex), np.zeros((len(lines), 6))
    tables: dict[str, LineTable] = {}
    for k, channel in enumerate(COMPONENTS):
        if channel not in recording.channels:
            continue
        tables[channel] = lines_at_known_clock(recording[channel], recording.sample_rate, lines)
        rows = [tables[channel][line.name] for line in lines]
        loads[:, k] = [row.amplitude * np.exp(1j * row.phase) for row in rows]
        floors[:, k] = [DETECTION_RATIO * row.floor for row in rows]
    return _RecordedLoads(lines, loads, floors, tables)


def _faults_of_recording(recording: Recording, table: LineTable) -> list[Unobserved]:
    """Reasons to question the channels of a recording and its clock."""
    missing = [channel for channel in COMPONENTS if channel not in recording.channels]
    given = [channel for channel in COMPONENTS if channel in recording.channels]
    told = [f"{', '.join(missing)} not recorded, and counted as 0"] if missing else []
    for check in (partial(channel_fault, recording), recording.glitch):
        faults = {channel: check(channel) for channel in given}
        told += [f"channel {channel} {fault}" for channel, fault in faults.items() if fault]
    gaps = [open_gap(why) for why in (*told, *clock_warnings(table))]
    for channel in given:
        for one in recording.unusable(channel):
            gaps.append(open_gap(f"channel {channel}: {one.why}", one.low, one.high))
    return gaps


def _table_error(recording: Recording, frequency: np.ndarray) -> np.ndarray:
    """Largest part by which the force table's resonances change a channel at each ``frequency`` (m,)
    [Hz], (m,); 0 where the table is not known.
    """
    error = np.zeros(frequency.size)
    if recording.table is not None:
        for channel in COMPONENTS:
            if channel in recording.channels:
                error = np.maximum(error, recording.table.departure(channel, frequency))
    return error


def contribution_of_recording(
    name: str, scenario: Scenario, recording: Recording, harmonics: int
) -> Contribution:
    """A drive by its loads on a force table, in the array's axes at angle 0, the blocked-load method to the
    craft of the scenario.
    """
    axis, recording = "M" + scenario.array.drive_axis, recording.in_si()
    table = lines_of_recording(recording, axis, scenario, harmonics=harmonics)
    recorded = _recorded_loads(recording, scenario, harmonics, table.clock_ratio or 1.0)
    lines = _lines_on_craft(scenario, recorded, table)
    kept, sought = lines.kept, lines.kept | lines.faint
    f, off = lines.frequency[kept], lines.off(table.clock_ratio or 1.0)[kept]
    loads, floors = lines.loads, lines.floors
    beside = np.maximum(
        drive_uncertainty(scenario, drive_states(scenario, own=False), f, off),
        _time_axis_uncertainty(scenario, (loads @ lines.turn.T)[kept], f, off),
    )
    own_error = np.broadcast_to(lines.relative_error(recording), beside.shape)
    return Contribution(
        name,
        f"clock lines of the recording {recording.title}, blocked-load method",
        lines.named(kept),
        f,
        lines.los[kept],
        # Its lines keep their phases to each other, not to those of a run, which starts at another
        # instant.
        f"{name}, recorded",
        gaps=tuple(_gaps_of_recording(scenario, recording, recorded, table, lines)),
        relative_error=both_errors(own_error, beside),
        frequency_error=off,
        scenario=scenario,
        recording=recording.title or "without a title",
        recorded=(loads[kept], floors[kept]),
        chain_assumption=recording.chain_assumption,
        step_clock=table.clock_ratio or 1.0,
        sought=SoughtLoads(
            lines.named(sought), lines.frequency[sought], np.abs(loads[sought]), floors[sought]
        ),
    )


@dataclass(frozen=True)
class _LinesOnCraft:
    """Expected lines of the clock as a recording has them, and as the craft would move by them, (k, ...)."""

    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    status: np.ndarray
    """Status of each in the table of the drive's axis, (k,)."""
    loads: np.ndarray
    """With phases, in the array's axes, 0 where a channel is missing, (k, 6) [N, N m]."""
    floors: np.ndarray
    """Floors of their amplitudes, (k, 6)."""
    has_loads: np.ndarray
    """Whether all loads are known, (k,)."""
    has_floors: np.ndarray
    """Whether all floors are, (k,)."""
    los: np.ndarray
    """[rad], (k, 2)."""
    los_of_noise: np.ndarray
    """Line of sight by the floors [rad], (k, 2)."""
    most_los: np.ndarray
    """The largest line of sight with any phases, and noise [rad], (k, 2)."""
    spread: np.ndarray
    """Relative standard uncertainty of each in the drive's axis, (k,)."""
    turn: np.ndarray
    """From the array's axes to the hub's, (6, 6)."""

    @property
    def moves_craft(self) -> np.ndarray:
        """Whether it is known how the craft moves, (k,)."""
        return np.asarray(np.all(np.isfinite(self.los), axis=1))

    @property
    def seen(self) -> np.ndarray:
        """Which are in the recording, (k,)."""
        return (self.status == "ok") & self.has_loads

    @property
    def kept(self) -> np.ndarray:
        """Which the contribution has, (k,)."""
        return self.seen & self.moves_craft

    @property
    def faint(self) -> np.ndarray:
        """Which are below the floor, (k,)."""
        return (self.status == BELOW_FLOOR) & self.has_floors & self.moves_craft

    def named(self, chosen: np.ndarray) -> tuple[str, ...]:
        """Names of the chosen ones (k,)."""
        return tuple(self.names[k] for k in np.flatnonzero(chosen))

    def off(self, clock_ratio: float) -> np.ndarray:
        """By how much frequencies may be off [Hz], by the recorder's clock too, (k,)."""
        off_clock = np.abs(self.frequency * (1.0 / clock_ratio - 1.0))
        return np.asarray(frequency_error_bound(self.frequency) + off_clock)

    def relative_error(self, recording: Recording) -> np.ndarray:
        """Relative error of those that are kept, by method, fit, noise and force table, (j, 2)."""
        kept = self.kept
        return np.asarray(
            BLOCKED_LOAD_UNCERTAINTY
            + 2.0 * float(np.max(self.spread[kept], initial=0.0))
            + self.los_of_noise[kept] / np.abs(self.los[kept])
            + _table_error(recording, self.frequency[kept])[:, None]
        )


def _lines_on_craft(
    scenario: Scenario, recorded: _RecordedLoads, table: LineTable
) -> _LinesOnCraft:
    """Recorded lines by the blocked-load method; ``table`` has those of the drive's axis."""
    of_axis = {line.name: line for line in table}
    found = [of_axis.get(line.name) for line in recorded.lines]
    status = ["not in the table" if row is None else row.status for row in found]
    loads, floors = np.nan_to_num(recorded.loads), np.nan_to_num(recorded.floors)
    turn, f = rotation_to_hub_axes(scenario), np.array([x.frequency for x in recorded.lines])
    los = blocked_load_method(scenario, f, loads @ turn.T).los
    assert los is not None
    by_each = line_of_sight_by_load(scenario, f, turn)
    noise = np.sqrt(np.einsum("jka,kj->ka", by_each**2, floors**2))
    return _LinesOnCraft(
        tuple(line.name for line in recorded.lines),
        f,
        np.array(status, str),
        loads,
        floors,
        np.all(np.isfinite(recorded.loads), axis=1),
        np.all(np.isfinite(recorded.floors), axis=1),
        los,
        noise,
        np.einsum("jka,kj->ka", by_each, np.abs(loads)) + noise,
        np.array([_relative_uncertainty(row) for row in found]),
        turn,
    )


def _gaps_of_recording(
    scenario: Scenario,
    recording: Recording,
    recorded: _RecordedLoads,
    table: LineTable,
    lines: _LinesOnCraft,
) -> Iterator[Unobserved]:
    """Gaps of a recording with respect to the line of sight."""
    f, faint = lines.frequency, lines.faint
    yield from _faults_of_recording(recording, table)
    if faint.any():
        yield Unobserved(
            "lines below the recording's floor", 0.0, math.inf, f[faint], lines.most_los[faint]
        )
    yield from _higher_orders_gap(scenario, recording, recorded.tables, table.clock_ratio or 1.0)
    for k in np.flatnonzero(~(lines.seen | faint)).tolist():
        remedy = "" if lines.status[k] in NOT_THE_DRIVES else "; a longer recording"
        yield open_gap(f"{lines.names[k]} ({lines.status[k]}{remedy})", float(f[k]), float(f[k]))
    # lines of the clock or not, a recording has something at all frequencies
    yield from low_frequency_gap(scenario, np.zeros(1), np.array([math.inf]), what="the recording")
    yield from above_passband_gaps(scenario, table, PASSBAND * recording.sample_rate)
    counted = set(lines.named(lines.kept))
    for why, low, high, size in unaccounted(scenario, recording, recorded.tables, counted):
        middle = np.array([math.sqrt(low * high)])
        yield Unobserved(why, low, high, middle, size[None, :], between=True)
    slow = below_all_bands(scenario, recording, recorded.tables)
    ends, most_of_slow = np.array([0.1 * slow.high, slow.high]), np.tile(slow.most, (2, 1))
    yield Unobserved(slow.why, 0.0, slow.high, ends, most_of_slow, between=True)


def _higher_orders_gap(
    scenario: Scenario, recording: Recording, tables: Mapping[str, LineTable], clock_ratio: float
) -> Iterator[Unobserved]:
    """The gap of orders of a recording that are not listed and that no excess shows."""
    found = higher_orders(scenario, recording, tables, clock_ratio)
    by_each = line_of_sight_by_load(scenario, found.frequency, rotation_to_hub_axes(scenario))
    noise = np.sqrt(np.einsum("jka,kj->ka", by_each**2, found.noise**2))
    most = np.einsum("jka,kj->ka", by_each, found.amplitude) + noise
    known = np.all(np.isfinite(most), axis=1)
    if known.any():
        yield Unobserved(
            "orders that are not listed, of which the recording's floor may hide lines"
            " (a longer recording, or --harmonics N)",
            0.0,
            math.inf,
            found.frequency[known],
            most[known],
        )


def recording_at_angle(measured: Contribution, scenario: Scenario) -> Contribution:
    """Lines of a recording as the craft of a ``scenario``, at the angle that its array has there,
    shows them; nothing else of the contribution.
    """
    assert measured.recorded is not None
    loads, _ = measured.recorded
    in_hub_axes = loads @ rotation_to_hub_axes(scenario).T
    los = blocked_load_method(scenario, measured.frequency, in_hub_axes).los
    assert los is not None
    return Contribution(
        measured.source, measured.how, measured.names, measured.frequency, np.nan_to_num(los)
    )


def _relative_uncertainty(line: Line | None) -> float:
    """Relative standard uncertainty of a line's amplitude."""
    if line is None:
        return 0.0
    amplitude, spread = line.amplitude, line.amplitude_uncertainty
    if amplitude > 0.0 and math.isfinite(spread):
        return spread / amplitude
    return 0.0


def line_of_sight_by_load(scenario: Scenario, f: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Amplitudes of the line of sight by one of each load in the array's axes, (6, k, 2)."""
    by_one = (
        blocked_load_method(scenario, f, np.tile(column, (f.size, 1))).los for column in turn.T
    )
    return np.abs(np.array([one for one in by_one if one is not None]))


def _time_axis_uncertainty(
    scenario: Scenario, loads: np.ndarray, frequency: np.ndarray, off: np.ndarray
) -> np.ndarray:
    """Relative error of lines, (2, k, 2), whose frequencies (k,) [Hz] a recorder's clock has wrong by up to
    ``off`` (k,) [Hz]: the drive made their ``loads`` on the hub (k, 6) there, and not where they are read.
    """

    def los(f: np.ndarray) -> np.ndarray:
        of_each = np.repeat(loads, f.size // len(loads), axis=0)
        found = blocked_load_method(scenario, f, of_each).los
        assert found is not None
        return np.abs(found)

    return response_uncertainty([los], frequency, off, natural_frequencies(scenario))
