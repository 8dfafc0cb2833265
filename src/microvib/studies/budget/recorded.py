"""Excess of the six loads of a recording over the counted lines and their floor, as line-of-sight motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from microvib.analysis.lines import expected_in
from microvib.model.coupling import blocked_load_method, rotation_to_hub_axes
from microvib.model.linear import coupled_modes
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.signals.clock import near_mains
from microvib.signals.line_fit import estimate_lines
from microvib.signals.line_table import Line, LineTable
from microvib.signals.unaccounted import Excess, excesses, joined
from microvib.testdata.recording import Recording


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
    modes = [
        mode.frequency for mode in coupled_modes(scenario) if one.low < mode.frequency < one.high
    ]
    f = np.array([*np.geomspace(one.low, one.high, 9), *modes])
    column = rotation_to_hub_axes(scenario)[:, COMPONENTS.index(channel)]
    los = blocked_load_method(scenario, f, np.tile(column, (f.size, 1))).los
    assert los is not None
    size: np.ndarray = np.nan_to_num(np.abs(los)).max(axis=0) * one.amplitude
    return size
