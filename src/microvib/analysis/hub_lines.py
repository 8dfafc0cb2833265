"""Lines of what a craft's hub feels and does, found in a run: those of the clock by its shafts,
others channel by channel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from microvib.analysis.lines import expected_in, find_lines
from microvib.analysis.margins import may_ring
from microvib.analysis.pointing import FREQUENCY_TOLERANCE, HubLines
from microvib.errors import MicrovibError
from microvib.model.coupling import MIN_FREQUENCY_WITHOUT_CONTROL
from microvib.model.expected import ExpectedLine
from microvib.model.line_names import SECOND_DRIVE
from microvib.model.linear import coupled_modes
from microvib.model.record import PASSBAND
from microvib.model.rigid import COMPONENTS
from microvib.signals.fourier_lines import lines_of_series
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
    beside = source.beside
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
    others = [line for line in table if line.kind == "other" and np.isfinite(line.frequency_hz)]
    expected = (
        *expected_in(scenario, scenario.record.sample_rate, table.harmonics),
        *(
            ExpectedLine(x.line, "other", x.frequency_hz, x.frequency_hz, x.frequency_hz, x.origin)
            for x in others
        ),
    )
    looks, two = (
        craft.spacecraft.line_of_sight is not None,
        craft.second is not None and not los_only,
    )
    channels = (
        *(() if los_only else COMPONENTS),
        *(SECOND_LOADS if two else ()),
        *(LINE_OF_SIGHT_ACCELERATIONS if looks else ()),
    )
    shafts, found = _estimate_tones(source, expected, channels, table, los_only)
    frequency, ringing = _free_decay_tones(*found, expected, channels)
    # Of the clock both shafts tell everything, and no drift is in them; what rings has its own way
    # into each channel.
    own = np.array([not line.of_clock for line in expected])
    rows = [*([] if los_only else [craft.loads()]), *([craft.second_loads()] if two else [])]
    rows += [craft.line_of_sight()] if looks else []
    forced = np.hstack(
        [np.einsum("fkj,fj->fk", craft.transfer(one, frequency), shafts) for one in rows]
    )
    tones = np.where(own[:, None], ringing, forced)
    if los_only:
        tones = np.hstack([np.full((len(expected), 6), np.nan), tones])
    # A free hub drifts: what is slower than MEANINGLESS is no line of it.
    free = craft.spacecraft.attitude_control is None
    keep = np.any(np.isfinite(tones) & (tones != 0.0), axis=1) & ~(
        free & (frequency < MIN_FREQUENCY_WITHOUT_CONTROL)
    )
    names = tuple(line.name for line, kept in zip(expected, keep, strict=True) if kept)
    unknown = tuple(
        x.name
        for x, lost in zip(expected, ~np.any(np.isfinite(tones), axis=1), strict=True)
        if lost
    )
    tones = tones[keep]
    los, second = tones[:, -2:] if looks else None, tones[:, 6:12] if two else None
    driven = tuple(line.line for line in table if line.status == NOISE_DRIVEN)
    rings = tuple(
        line.line for line in table if line.line in names and may_ring(line, table, scenario)
    )
    return HubLines(
        scenario,
        names,
        frequency[keep],
        tones[:, :6],
        los,
        shafts[keep],
        unknown,
        second,
        driven,
        rings,
    )


def combine_wings(first: HubLines, second: HubLines) -> HubLines:
    """Lines of two drives on one craft: those of one frequency, and natural modes, with their
    phases; of others both.

    Each drive's run knows the same natural modes, by names that may differ where one of them is the
    other drive's.
    """
    # Both runs have the same natural modes: the k-th of one is the k-th of the other, whatever
    # either calls it.
    ours, theirs = (
        sorted(coupled_modes(one.scenario), key=lambda m: m.frequency) for one in (first, second)
    )
    if len(ours) == len(theirs):
        partner = {b.name: a.name for a, b in zip(ours, theirs, strict=False)}
    else:
        partner = {}
    modes = {m.name for m in theirs}
    # Where each line of the second goes: to one of the first of its frequency, or behind them all.
    place: dict[str, int] = {}
    for name, f in zip(second.names, second.frequency, strict=True):
        near = np.flatnonzero(np.abs(first.frequency - f) <= FREQUENCY_TOLERANCE * f)
        if name in modes:
            near = np.array(
                [k for k, own in enumerate(first.names) if own == partner.get(name)], dtype=int
            )
        if near.size:
            place[name] = int(near[0])
        else:
            place[name] = len(first.names) + sum(k >= len(first.names) for k in place.values())
    new = [k for k, name in enumerate(second.names) if place[name] >= len(first.names)]
    to = [place[name] for name in second.names]

    def added(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
        if a is None or b is None:
            return None
        both = np.full((2, len(first.names) + len(new), a.shape[1]), np.nan, dtype=complex)
        both[0, : len(first.names)], both[1, to] = a, b
        total: np.ndarray = np.where(np.isnan(both).all(axis=0), np.nan, np.nansum(both, axis=0))
        return total

    def of_both(ours: tuple[str, ...], theirs: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(
            dict.fromkeys([*ours, *(names[place[name]] for name in theirs if name in place)])
        )

    # a natural mode has the name that it has in the first's run, even if that one does not look for
    # it
    names = (
        *first.names,
        *(partner.get(second.names[k], f"{SECOND_DRIVE} {second.names[k]}") for k in new),
    )
    loads = added(first.loads, second.loads if second.second is None else second.second)
    assert loads is not None
    return replace(
        first,
        names=names,
        frequency=np.concatenate([first.frequency, second.frequency[new]]),
        loads=loads,
        los=added(first.los, second.los),
        shafts=np.vstack([first.shafts, np.zeros((len(new), 2))]),
        second=added(first.second, second.loads),
        unknown=(*first.unknown, *(f"{SECOND_DRIVE} {name}" for name in second.unknown)),
        driven=of_both(first.driven, second.driven),
        rings=of_both(first.rings, second.rings),
        drives=(first, second),
    )


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
    if any(x.is_mode and not x.seen and np.isfinite(x.amplitude_n_m) for x in table):
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
    frequency = np.array([[line.frequency_hz for line in column] for column in columns]).T
    decay = np.array([[line.decay_per_s for line in column] for column in columns]).T
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
    # One frequency a line: that of the channel in which it stands out most, over what stands in the
    # channel.
    size = np.nan_to_num(np.abs(tones))
    best = np.argmax(size / np.maximum(size.max(axis=0), 1e-300), axis=1)
    shared = found[np.arange(given.size), best]
    root = -np.nan_to_num(decay) + 2j * np.pi * np.where(np.isfinite(found), found, given[:, None])
    angles = [name in LINE_OF_SIGHT_ACCELERATIONS for name in channels]
    tones[:, angles] /= root[:, angles] ** 2
    return np.where(np.isfinite(shared), shared, given), tones


def complex_amplitudes(lines: list[Line]) -> np.ndarray:
    """Complex amplitudes."""
    return np.array([line.amplitude_n_m * np.exp(1j * line.phase_rad) for line in lines])


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
