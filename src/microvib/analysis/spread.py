"""How far steady lines move within the ranges that a scenario's ``sources`` note, to first order.

Each line changes by its derivative (``SteadyState.derivatives``) times the way from a value to the
farther end of its range. Values are taken as independent, so that the changes of one line add up as
the root of the sum of their squares. Where one of the values has no derivative at a line (a friction
just sticks there, or just does not), the line has no spread.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.ranges import noted_ranges
from microvib.model.scenario import Scenario
from microvib.signals.line_table import Line, LineTable
from microvib.solve.steady.state import SteadyState
from microvib.text_tables import counted

MIN_RATIO = 1e-6
"""Amplitude over the largest line below which a line has no spread: it is rounding."""


@dataclass(frozen=True)
class Spread:
    """Spread of the harmonics of a steady state."""

    by_order: Mapping[int, float]
    """First-order change of the amplitude [N m] by order of the repetition frequency; nan where it
    is not known."""
    keys: tuple[str, ...]
    """Values whose ranges it comes from."""
    why_not: str = ""
    """Why it is not known at all."""


def spread_of(state: SteadyState, orders: list[int]) -> Spread:
    """Spread of some harmonics of a steady state; empty where no source notes a range."""
    try:
        ranges = noted_ranges(state.scenario)
    except MicrovibError as why:
        return Spread({}, (), str(why))
    if not ranges or not orders:
        return Spread({}, tuple(ranges))
    keys = tuple(ranges)
    ways = {key: _way(state.scenario, key, ends) for key, ends in ranges.items()}
    nothing = {key: way for key, way in ways.items() if state.scenario[key] == 0.0}
    try:
        found = state.derivatives(keys, orders, scales=nothing, coarse=True)
    except MicrovibError as why:
        return Spread({}, keys, str(why))
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.conj(found.amplitudes) / np.abs(found.amplitudes)
        changes = np.real(found.derivatives * along) * np.array(list(ways.values()))[:, None]
    total = np.sqrt(np.sum(changes**2, axis=0))
    return Spread(dict(zip(orders, total.tolist(), strict=True)), keys)


def _way(scenario: Scenario, key: str, ends: tuple[float, float]) -> float:
    """From a value to the farther end of its range [SI]."""
    value = float(scenario[key])
    return max(abs(end - value) for end in ends)


def with_spread(state: SteadyState, table: LineTable) -> LineTable:
    """The lines of a steady state with their spread."""
    orders = {x.name: _order(x, state) for x in _counting(table, table)}
    spread = spread_of(state, sorted({k for k in orders.values() if k > 0}))
    if not spread.by_order:
        return replace(table, no_spread=spread.why_not)
    lines = tuple(
        replace(x, spread=spread.by_order.get(orders.get(x.name, 0), math.nan)) for x in table
    )
    return replace(table, lines=lines, ranged=spread.keys)


def spread_sentence(table: LineTable) -> str:
    """Sentence on the spread of a table's lines, and on those that have none; empty without ranges."""
    if table.no_spread:
        return (
            "How far lines move within the ranges that sources note is not known to first order:"
            f" {table.no_spread}."
        )
    if not table.ranged:
        return ""
    counting = _counting(table.notable(), table)
    without = [x.name for x in counting if not math.isfinite(x.spread)]
    said = (
        "± (ranges) is how far a line moves, to first order, within the ranges that sources note of"
        f" {counted(len(table.ranged), 'value')} ({', '.join(table.ranged)}), taken as independent."
    )
    if without:
        said += (
            f" It is not given of {', '.join(without)}: a friction just sticks, or just does not, and"
            " the line has a kink; microvib sensitivity runs the ends of the ranges."
        )
    return said


def _counting(lines: Iterable[Line], table: LineTable) -> list[Line]:
    """Choose those of some lines of a table that may have a spread."""
    top = max((x.amplitude for x in table if math.isfinite(x.amplitude)), default=0.0)
    return [x for x in lines if x.seen and x.amplitude > MIN_RATIO * top]


def _order(line: Line, state: SteadyState) -> int:
    """Its order of the repetition frequency."""
    return round(line.frequency / state.frequency)
