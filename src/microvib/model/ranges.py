"""Ranges that the sources of values note: what a data sheet gives, or what is assumed, as ``...; range
LOW to HIGH``.
"""

from __future__ import annotations

import re

from microvib.errors import MicrovibError
from microvib.model.scenario import ASSUMED_SOURCE, Scenario
from microvib.units import Quantity, convert

_RANGE = re.compile(r"; range (.+) to (.+)$")


def noted_ranges(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Ranges [SI] that sources of continuous values note, as ``...; range LOW to HIGH``, by dotted
    key.
    """
    found: dict[str, tuple[float, float]] = {}
    if not any(_RANGE.search(text) for text in scenario.sources.values()):
        return found
    for key, value, quantity in scenario.entries():
        noted = _RANGE.search(scenario.sources.get(key, ""))
        if noted and isinstance(value, float):
            found[key] = _ends(key, quantity, *noted.groups())
    return found


def values_without_range(scenario: Scenario) -> dict[str, str]:
    """Values with a source of their own, or assumed for want of one, that have no range though they
    are assumed, or have one and are not continuous, and why.
    """
    found, ranged = {}, noted_ranges(scenario)
    for key, value, _ in scenario.entries():
        source = scenario.sources.get(key, "")
        if scenario.source_of(key) == ASSUMED_SOURCE and value:
            source = ASSUMED_SOURCE
        if key in ranged or value is None:
            continue
        if _RANGE.search(source):
            found[key] = "not a continuous value"
        elif source.startswith("assumed"):
            found[key] = "assumed, without a range"
    return found


def _ends(key: str, quantity: Quantity | None, low: str, high: str) -> tuple[float, float]:
    unit = quantity.unit if quantity else ""
    try:
        ends = convert(low, unit), convert(high, unit)
    except ValueError as error:
        raise MicrovibError(f"sources.{key}: the range {low} to {high} {error}") from None
    if not ends[0] < ends[1]:
        raise MicrovibError(
            f"sources.{key}: range {low} to {high}: the first must be below the second"
        )
    return ends
