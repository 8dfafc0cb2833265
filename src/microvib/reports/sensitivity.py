"""A ranking of what is not known, as text."""

from __future__ import annotations

import math
from collections.abc import Iterator

from microvib.model.scenario import Scenario
from microvib.studies.sensitivity import Effect, Ranking

_ROW = "  {:42s} {:>9s} {:>22s}  {}".format


def ranking_text(found: Ranking, scenario: Scenario) -> str:
    """Line by line the effects of the scenario's uncertain values; what failed, and what was not looked at."""
    rows: list[str] = []
    for line in found:
        rows += ["", f"{line.line}, {line.frequency:.4g} Hz, {1e3 * line.amplitude:.4g} mN m: {line.verdict}"]
        rows.append(_ROW("value", "d ln/d ln", "mN m over its range", "range"))
        rows += [row for effect in line.effects for row in _rows(effect, scenario)]
    for case in found.failed:
        rows += ["", f"No run with {case.key} {scenario.shown(case.key, case.value)}: {case.reason}"]
    rows += ["", "Not ranked:"] if found.left_out else []
    return "\n".join([*rows, *(f"  {key}: {why}" for key, why in found.left_out.items())])


def _rows(effect: Effect, scenario: Scenario) -> Iterator[str]:
    low, high = (scenario.shown(effect.key, end) for end in effect.range)
    moved = " to ".join(f"{1e3 * x:.4g}" for x in effect.amplitudes)
    none = math.isnan(effect.sensitivity) and not math.isnan(effect.slopes[0])
    yield _ROW(effect.key, "none *" if none else f"{effect.sensitivity:.3g}", moved, f"{low} to {high}")
    for value, amplitude in effect.between:
        at = scenario.shown(effect.key, value)
        yield f"    {1e3 * amplitude:.4g} mN m at {at}, where the linearised drive has an extreme"
    if none:
        below, above = effect.slopes
        yield f"    * {below:.3g} below and {above:.3g} above: the line jumps or bends there"
