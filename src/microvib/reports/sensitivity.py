"""A ranking of what is not known, as text."""

from __future__ import annotations

import math
from collections.abc import Iterator

from microvib.model.scenario import Scenario
from microvib.studies.sensitivity import Effect, Ranking
from microvib.text_tables import text_table

_HEAD = ("value", "d ln/d ln", "mN m over its range", "range")


def ranking_text(found: Ranking, scenario: Scenario) -> str:
    """Line by line the effects of the scenario's uncertain values; what failed, and what was not
    looked at.
    """
    rows: list[str] = []
    for line in found:
        rows += [
            "",
            f"{line.line}, {line.frequency:.4g} Hz, {1e3 * line.amplitude:.4g} mN m:"
            f" {line.verdict}",
        ]
        effects = [_row(effect, scenario) for effect in line.effects]
        told = text_table(_HEAD, effects, left=1, last_left=True, indent=2)
        rows += [f"  {row}".rstrip() for row in told.splitlines()]
        rows += [note for effect in line.effects for note in _notes(effect, scenario)]
    for case in found.failed:
        rows += [
            "",
            f"No run with {case.key} {scenario.shown(case.key, case.value)}: {case.reason}",
        ]
    if found.left_out:
        rows += ["", "Not ranked:"]
    else:
        rows += []
    return "\n".join([*rows, *(f"  {key}: {why}" for key, why in found.left_out.items())])


def _row(effect: Effect, scenario: Scenario) -> tuple[str, ...]:
    low, high = (scenario.shown(effect.key, end) for end in effect.range)
    moved = " to ".join(f"{1e3 * x:.4g}" for x in effect.amplitudes)
    if _jumps(effect):
        slope = "none *"
    else:
        slope = f"{effect.sensitivity:.3g}"
    return effect.key, slope, moved, f"{low} to {high}"


def _jumps(effect: Effect) -> bool:
    """Whether the line jumps or bends at the value itself, which leaves it without a sensitivity
    there.
    """
    return math.isnan(effect.sensitivity) and not math.isnan(effect.slopes[0])


def _notes(effect: Effect, scenario: Scenario) -> Iterator[str]:
    for value, amplitude in effect.between:
        at = scenario.shown(effect.key, value)
        yield f"  {effect.key}: {1e3 * amplitude:.4g} mN m at {at}, where the linearised drive has an extreme"
    if _jumps(effect):
        below, above = effect.slopes
        yield f"  * {effect.key}: {below:.3g} below and {above:.3g} above: the line jumps or bends there"
