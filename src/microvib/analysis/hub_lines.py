"""Lines of what a craft's hub feels and does, found in a run: those of the clock by its shafts,
others channel by channel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from microvib.analysis.lines import expected_in, find_lines
from microvib.analysis.margins import may_ring
from microvib.analysis.pointing import HubLines
from microvib.errors import MicrovibError
from microvib.model.coupling import MIN_FREQUENCY_WITHOUT_CONTROL
from microvib.model.craft import Craft
from microvib.model.expected import ExpectedLine
from microvib.model.line_names import SECOND_DRIVE
from microvib.model.linear import coupled_modes
from microvib.model.record import PASSBAND
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import lines_of_series
from microvib.signals.in_step import LOCKED
from microvib.signals.line_fit import (
    lines_at_known_clock,
    modes_near_clock_lines,
    tones_in_channels,
)
from microvib.signals.line_table import NOISE_DRIVEN, Line, LineTable
from microvib.solve.channels import SECOND_LOADS
from microvib.solve.motion import Motion
from microvib.solve.on_craft import LINE_OF_SIGHT_ACCELERATIONS
from microvib.solve.steady.state import SteadyState


def hub_lines(
    source: Motion | SteadyState, table: LineTable, *, los_only: bool = False
) -> HubLines:
    """Lines of loads and line of sight of a run on a craft: those that are expected, and those
    found in T_d (its ``table``).

    Lines of the clock follow from those of the two shafts' accelerations, through the craft's
    linear response, which no drift leaks into. What rings by itself, and what is not expected, is
    found in each channel; of the angles in their second derivatives. With ``los_only`` loads are
    not estimated, and nan, and what rings has the frequency and decay that it has in T_d where that
    shows it, which takes a tenth of the time. Where a second wing is driven, too, lines of both
    drives are added (``combine_wings``). MicrovibError where the scenario has no spacecraft.
    """
    beside = source.second_wing
    own = _single_drive_lines(
        source.alone if isinstance(source, Motion) else source, table, los_only
    )
    if beside is None:
        return own
    return combine_wings(
        own, _single_drive_lines(beside, find_lines(beside, harmonics=table.harmonics), los_only)
    )


def _single_drive_lines(source: Motion | SteadyState, table: LineTable, los_only: bool) -> HubLines:
    """``hub_lines`` of one drive's run."""
    scenario, craft = source.scenario, source.scenario.craft
    if craft is None:
        raise MicrovibError("this run has a fixed base; a scenario with a spacecraft is expected")
    looks = craft.spacecraft.line_of_sight is not None
    two = craft.second is not None and not los_only
    expected = _expected_and_found(scenario, table)
    channels = _channels_of_interest(looks, two, los_only)
    shafts, found = _estimate_tones(source, expected, channels, table, los_only)
    frequency, ringing = _free_decay_tones(*found, expected, channels)
    # Of the clock both shafts tell everything, and no drift is in them; what rings has its own way
    # into each channel.
    forced = _forced_tones(craft, frequency, shafts, looks, two, los_only)
    of_clock = np.array([line.of_clock for line in expected])
    tones = np.where(of_clock[:, None], forced, ringing)
    if los_only:
        tones = np.hstack([np.full((len(expected), 6), np.nan), tones])
    known = np.any(np.isfinite(tones), axis=1)
    # A free hub drifts: what is slower than that is no line of it.
    free = craft.spacecraft.attitude_control is None
    drifts = free & (frequency < MIN_FREQUENCY_WITHOUT_CONTROL)
    keep = np.any(np.isfinite(tones) & (tones != 0.0), axis=1) & ~drifts
    names = tuple(line.name for line, kept in zip(expected, keep, strict=True) if kept)
    rings = [line for line in table if line.name in names and may_ring(line, table, scenario)]
    tones = tones[keep]
    return HubLines(
        scenario,
        names,
        frequency[keep],
        tones[:, :6],
        tones[:, -2:] if looks else None,
        shafts[keep],
        tuple(line.name for line, told in zip(expected, known, strict=True) if not told),
        tones[:, 6:12] if two else None,
        tuple(line.name for line in table if line.status == NOISE_DRIVEN),
        tuple(line.name for line in rings),
    )


def _expected_and_found(scenario: Scenario, table: LineTable) -> tuple[ExpectedLine, ...]:
    """Lines that are expected, and those that were found in T_d and were not."""
    expected = expected_in(scenario, scenario.record.sample_rate, table.harmonics)
    found = (
        ExpectedLine(x.name, "other", x.frequency, x.frequency, x.frequency, x.origin)
        for x in table
        if x.kind == "other" and np.isfinite(x.frequency)
    )
    return (*expected, *found)


def _channels_of_interest(looks: bool, two: bool, los_only: bool) -> tuple[str, ...]:
    """Channels in which lines are sought: loads, those of a second wing where there are ``two``, and
    the line of sight where there is one.
    """
    channels: tuple[str, ...] = () if los_only else COMPONENTS
    if two:
        channels = (*channels, *SECOND_LOADS)
    if looks:
        channels = (*channels, *LINE_OF_SIGHT_ACCELERATIONS)
    return channels


def _forced_tones(
    craft: Craft, frequency: np.ndarray, shafts: np.ndarray, looks: bool, two: bool, los_only: bool
) -> np.ndarray:
    """Response to the accelerations of both ``shafts`` (k, 2) at each ``frequency`` (k,) [Hz] in the
    channels of interest, (k, channels).
    """
    rows = [] if los_only else [craft.loads()]
    if two:
        rows.append(craft.second_loads())
    if looks:
        rows.append(craft.line_of_sight())
    each = [np.einsum("fkj,fj->fk", craft.transfer(one, frequency), shafts) for one in rows]
    return np.hstack(each)


def combine_wings(first: HubLines, second: HubLines) -> HubLines:
    """Lines of two drives on one craft: those of one frequency of one clock, and natural modes, with
    their phases; of others both.

    Each drive's run knows the same natural modes, by names that may differ where one of them is the
    other drive's. Lines of two clocks drift against each other, however near their frequencies are,
    and so do those of one clock that are not quite of one frequency.
    """
    partner = _modes_by_name(second, first)
    place = _places_of_second(first, second, partner)
    count = len(first.names)
    new = np.flatnonzero(place >= count)
    # a natural mode has the name that it has in the first's run, even if that one does not look for
    # it
    behind = [
        partner.get(second.names[k], f"{SECOND_DRIVE} {second.names[k]}") for k in new.tolist()
    ]
    names = (*first.names, *behind)
    called = {name: names[k] for name, k in zip(second.names, place.tolist(), strict=True)}

    def added(ours: np.ndarray | None, theirs: np.ndarray | None) -> np.ndarray | None:
        if ours is None or theirs is None:
            return None
        both = np.full((2, len(names), ours.shape[1]), np.nan, dtype=complex)
        both[0, :count], both[1, place] = ours, theirs
        total: np.ndarray = np.where(np.isnan(both).all(axis=0), np.nan, np.nansum(both, axis=0))
        return total

    def of_both(ours: tuple[str, ...], theirs: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(dict.fromkeys([*ours, *(called[x] for x in theirs if x in called)]))

    loads = added(first.loads, second.loads if second.second is None else second.second)
    assert loads is not None
    return replace(
        first,
        names=names,
        frequency=np.concatenate([first.frequency, second.frequency[new]]),
        loads=loads,
        los=added(first.los, second.los),
        shafts=np.vstack([first.shafts, np.zeros((new.size, 2))]),
        second=added(first.second, second.loads),
        unknown=(*first.unknown, *(f"{SECOND_DRIVE} {name}" for name in second.unknown)),
        driven=of_both(first.driven, second.driven),
        rings=of_both(first.rings, second.rings),
        drives=(first, second),
    )


def _modes_by_name(of: HubLines, other: HubLines) -> dict[str, str]:
    """Names of the natural modes of one drive's run in the ``other``'s: the k-th of one is
    the k-th of the other; empty where they have not as many.
    """
    mine, theirs = (
        sorted(coupled_modes(one.scenario), key=lambda m: m.frequency) for one in (of, other)
    )
    if len(mine) != len(theirs):
        return {}
    return {a.name: b.name for a, b in zip(mine, theirs, strict=True)}


def _places_of_second(first: HubLines, second: HubLines, partner: dict[str, str]) -> np.ndarray:
    """Where each line of the second goes, (k,): to the one of the first that it is added to, or
    behind them all.
    """
    modes = {m.name for m in coupled_modes(second.scenario)}
    together = _have_one_clock(first)
    place, behind = [], len(first.names)
    for name, f in zip(second.names, second.frequency, strict=True):
        if name in modes:
            same = [k for k, own in enumerate(first.names) if own == partner.get(name)]
        elif together:
            same = np.flatnonzero(np.abs(first.frequency - f) <= LOCKED * f).tolist()
        else:
            same = []
        place.append(same[0] if same else behind)
        behind += not same
    return np.array(place, dtype=int)


def _have_one_clock(first: HubLines) -> bool:
    """Whether the second wing's drive, if there is one, is stepped by the first's clock."""
    craft = first.scenario.spacecraft
    wing = None if craft is None else craft.second_wing
    return wing is not None and wing.clock_ratio == 1.0


ChannelTones = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Tones, frequencies [Hz] and decays [1/s] of lines in channels, (k, channels) each."""


def _estimate_tones(
    source: Motion | SteadyState,
    expected: tuple[ExpectedLine, ...],
    channels: tuple[str, ...],
    table: LineTable,
    fast: bool,
) -> tuple[np.ndarray, ChannelTones]:
    """Tones of the expected lines in the accelerations of both shafts, (k, 2), and what is found in
    the ``channels``.

    Where it has to be ``fast``, what rings does so as in T_d, and only what T_d does not show is
    sought.
    """
    shafts, rows = ("alpha_l", "alpha_m"), table if fast else modes_near_clock_lines(table)
    if not fast or isinstance(source, SteadyState):
        return _estimate_by_channel(source, expected, shafts, rows)[0], _estimate_by_channel(
            source, expected, channels, rows
        )
    tones, frequency, decay = tones_in_channels(
        [source[name] for name in (*shafts, *channels)], source.sample_rate, expected, table
    )
    if any(x.is_mode and not x.seen and np.isfinite(x.amplitude) for x in table):
        return tones[:, :2], _estimate_by_channel(source, expected, channels, rows)
    each = np.ones((1, len(channels)))
    return tones[:, :2], (tones[:, 2:], frequency[:, None] * each, decay[:, None] * each)


def _estimate_by_channel(
    source: Motion | SteadyState,
    expected: tuple[ExpectedLine, ...],
    channels: tuple[str, ...],
    table: LineTable | None,
) -> ChannelTones:
    """Channel by channel."""
    columns = [channel_lines(source, name, expected, table) for name in channels]
    frequency = np.array([[line.frequency for line in column] for column in columns]).T
    decay = np.array([[line.decay for line in column] for column in columns]).T
    return np.array([complex_amplitudes(column) for column in columns]).T, frequency, decay


def _free_decay_tones(
    tones: np.ndarray,
    found: np.ndarray,
    decay: np.ndarray,
    expected: tuple[ExpectedLine, ...],
    channels: tuple[str, ...],
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (k,) [Hz] of the expected lines, and their tones in each channel, (k, channels),
    of accelerations the angles.
    """
    given = np.array([line.frequency for line in expected])
    # One frequency a line: that of the channel in which it exceeds its floor most, over what stands in the
    # channel.
    size = np.nan_to_num(np.abs(tones))
    largest = size.max(axis=0, initial=1e-300)  # of none of a rigid array that rests
    best = np.argmax(size / largest, axis=1)
    shared = found[np.arange(given.size), best]
    root = -np.nan_to_num(decay) + 2j * np.pi * np.where(np.isfinite(found), found, given[:, None])
    angles = [name in LINE_OF_SIGHT_ACCELERATIONS for name in channels]
    tones[:, angles] /= root[:, angles] ** 2
    return np.where(np.isfinite(shared), shared, given), tones


def complex_amplitudes(lines: list[Line]) -> np.ndarray:
    """Complex amplitudes."""
    return np.array([line.amplitude * np.exp(1j * line.phase) for line in lines], dtype=complex)


def channel_lines(
    source: Motion | SteadyState,
    channel: str,
    expected: tuple[ExpectedLine, ...],
    table: LineTable | None = None,
) -> list[Line]:
    """The expected lines in one channel, in their order; with the ``table`` of T_d, modes ring as
    there.
    """
    rate, samples = source.scenario.record.sample_rate, source.scenario.record.samples
    if isinstance(source, SteadyState):
        series = source.harmonics(channel, int(PASSBAND * rate / source.frequency) + 1)
        found = lines_of_series(
            series, source.frequency, source.microsteps, expected, samples, rate
        )
    else:
        found = lines_at_known_clock(source[channel], rate, expected, table)
    return [found[line.name] for line in expected]
