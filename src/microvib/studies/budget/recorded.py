"""Remainder of the six loads of a recording beside the counted lines: their excess over these and the
floor, as line-of-sight motion, and lines of higher order that the floor may hide."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from microvib.analysis.lines import expected_in
from microvib.model.coupling import blocked_load_method, receiver_of, rotation_to_hub_axes
from microvib.model.linear import coupled_modes
from microvib.model.record import PASSBAND
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.signals.clock import near_mains
from microvib.signals.line_fit import SEPARATION, estimate_lines
from microvib.signals.line_table import Line, LineTable
from microvib.signals.tones import HannSpectrum
from microvib.signals.unaccounted import (
    Excess,
    excesses,
    joined,
    samples_of_lines,
    slow_rms,
)
from microvib.testdata.recording import Recording

_SCALLOP = 1.18
"""Amplitude of a tone over the larger of its two nearest bins, at most, with a Hann window."""
_NOISE = 3.0
"""Floors by which noise may make a line seem smaller: one line in five hundred more."""


class HigherOrders(NamedTuple):
    """Orders of the clock that are not listed: largest amplitudes of each load."""

    frequency: np.ndarray
    """[Hz], (m,)."""
    amplitude: np.ndarray
    """As they stand in the spectrum, (m, 6) [N, N m]."""
    noise: np.ndarray
    """By how much noise may lower that, (m, 6)."""


def higher_orders(
    scenario: Scenario, recording: Recording, rows: Mapping[str, LineTable], clock_ratio: float
) -> HigherOrders:
    """All multiples of the electrical frequency up to the edge of the passband, but for the lines of
    which ``rows`` has amplitudes in each channel.

    Where they are closer than a record resolves, every second bin stands for those about it.
    """
    table = next(iter(rows.values()), None)
    f_d, driver = scenario.driving_frequency, scenario.driver
    if table is None or not f_d:
        return HigherOrders(np.zeros(0), np.zeros((0, 6)), np.zeros((0, 6)))
    electrical = clock_ratio * f_d / (driver.beats * driver.microsteps)
    resolved = SEPARATION / table.duration
    step = electrical if electrical >= resolved else 2.0 / table.duration
    f = step * np.arange(
        max(1, math.ceil(resolved / step)), int(PASSBAND * recording.sample_rate / step) + 1
    )
    listed = np.array([line.place for line in table])
    near = np.abs(f[:, None] - listed) < 0.5 * min(step, resolved)
    f = f[~near.any(axis=1)]
    amplitude, noise = np.zeros((f.size, 6)), np.zeros((f.size, 6))
    for k, channel in enumerate(COMPONENTS):
        if channel in rows:
            seen = [line for line in rows[channel] if line.seen]
            x = recording[channel] - samples_of_lines(
                seen, recording[channel].size, recording.sample_rate
            )
            spectrum = HannSpectrum.of(x - x.mean(), recording.sample_rate)
            amplitude[:, k] = [_SCALLOP * spectrum.height(at, 0.0) for at in f.tolist()]
            noise[:, k] = _NOISE * spectrum.floors(f)
    return HigherOrders(f, amplitude, noise)


class Unaccounted(NamedTuple):
    """Excess in a band: why, its ends [Hz] and the largest amplitude of the line of sight about
    both axes [rad].
    """

    why: str
    low: float
    high: float
    most: np.ndarray


def unaccounted(
    scenario: Scenario, recording: Recording, rows: Mapping[str, LineTable], counted: set[str]
) -> Iterator[Unaccounted]:
    """Bands in which a recording holds more than the lines ``counted``, which ``rows`` has of each
    channel, and its floor.
    """
    found: list[tuple[str, Excess]] = []
    for channel, table in rows.items():
        beside = _other_lines(scenario, recording[channel], recording.sample_rate, table)
        own = [line for line in table if line.name in counted]
        mains = [line for line in beside if near_mains(line.frequency, table.duration)]
        more = excesses(recording[channel], recording.sample_rate, [*own, *mains], beside)
        found += [(channel, one) for one in more]
    channels = {id(one): channel for channel, one in found}
    for group in joined([one for _, one in found]):
        sizes = {id(one): _seen(scenario, channels[id(one)], one) for one in group}
        worst = max(group, key=lambda one: float(np.hypot(*sizes[id(one)])))
        why = worst.sentence(channels[id(worst)])
        for low, high in dict.fromkeys((one.low, one.high) for one in group):
            together = [sizes[id(one)] for one in group if one.low == low]
            yield Unaccounted(why, low, high, np.sum(together, axis=0))


def below_all_bands(
    scenario: Scenario, recording: Recording, rows: Mapping[str, LineTable]
) -> Unaccounted:
    """All that a recording holds beside its lines below the lowest band, for which it is too short,
    as one tone where the line of sight sees most of each channel.
    """
    low, most = 0.0, np.zeros(2)
    for channel, table in rows.items():
        x = recording[channel]
        seen = [line for line in table if line.seen]
        rest = x - samples_of_lines(seen, x.size, recording.sample_rate)
        low, rms = slow_rms(rest, recording.sample_rate)
        start = min(max(receiver_of(scenario).lowest, 1e-3), low)
        most = most + _largest_response(scenario, channel, start, low) * math.sqrt(2.0) * rms
    why = f"what the recording holds below {low:.3g} Hz, for which it is too short (a longer recording)"
    return Unaccounted(why, 0.0, low, most)


def _other_lines(
    scenario: Scenario, x: np.ndarray, sample_rate: float, clock: LineTable
) -> list[Line]:
    """Unlisted lines of a channel, at the clock whose lines these are."""
    known = [
        replace(line, frequency=row.frequency, low=row.frequency, high=row.frequency)
        for line in expected_in(scenario, sample_rate, clock.harmonics)
        for row in clock
        if row.name == line.name and row.frequency > 0.0
    ]
    return [line for line in estimate_lines(x, sample_rate, known) if line.kind == "other"]


def _seen(scenario: Scenario, channel: str, one: Excess) -> np.ndarray:
    """Upper bound of the line of sight from a channel's excess, at the most sensitive frequency of the band,
    (2,) [rad].
    """
    return _largest_response(scenario, channel, one.low, one.high) * one.amplitude


def _largest_response(scenario: Scenario, channel: str, low: float, high: float) -> np.ndarray:
    """Line of sight by one of a channel, at the most sensitive frequency between two [Hz], (2,)."""
    modes = [mode.frequency for mode in coupled_modes(scenario) if low < mode.frequency < high]
    f = np.array([*np.geomspace(low, high, 9), *modes])
    column = rotation_to_hub_axes(scenario)[:, COMPONENTS.index(channel)]
    los = blocked_load_method(scenario, f, np.tile(column, (f.size, 1))).los
    assert los is not None
    size: np.ndarray = np.nan_to_num(np.abs(los)).max(axis=0)
    return size
