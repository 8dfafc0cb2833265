"""A ranking of uncertain values as tables: what each line depends on most, and every effect."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from microvib.model.scenario import Scenario
from microvib.reports.document import Text
from microvib.reports.outcome import Outcome, Part
from microvib.results import FREQUENCY, TORQUE, Column, Measure, Table
from microvib.studies.sensitivity import Effect, LineEffects, Ranking

SENSITIVITY = Measure(form=".3g")
SI_VALUE = Measure(form=".9g")


@dataclass(frozen=True)
class EffectOnLine:
    """Effect of one value of a scenario on one line."""

    line: Annotated[str, Column("line")]
    key: Annotated[str, Column("key", "parameter", role="key")]
    sensitivity: Annotated[float, Column("sensitivity", "d ln/d ln", SENSITIVITY, absent="none")]
    slope_below: Annotated[float, Column("slope_below", measure=SENSITIVITY)]
    slope_above: Annotated[float, Column("slope_above", measure=SENSITIVITY)]
    at_low: Annotated[float, Column("at_low_n_m", "at low end", TORQUE, absent="unknown")]
    at_high: Annotated[float, Column("at_high_n_m", "at high end", TORQUE, absent="unknown")]
    low: Annotated[float, Column("low_si", measure=SI_VALUE)]
    high: Annotated[float, Column("high_si", measure=SI_VALUE)]
    remarks: Annotated[str, Column("remarks")]
    range: Annotated[str, Column("range", "range")]


@dataclass(frozen=True)
class FailedRun:
    """A value with which the scenario could not be simulated."""

    key: Annotated[str, Column("key", "parameter", role="key")]
    value: Annotated[str, Column("value", "value")]
    reason: Annotated[str, Column("reason", "reason")]


@dataclass(frozen=True)
class NotRanked:
    """A value that is assumed or has a range, and did not take part."""

    key: Annotated[str, Column("key", "parameter", role="key")]
    reason: Annotated[str, Column("reason", "reason")]


def ranking_outcome(found: Ranking, scenario: Scenario) -> Outcome:
    """The ranking of the uncertain values of a ``scenario`` for those who read it: what matters
    most for each line, the effects line by line, runs that failed, values that were not ranked.
    """
    effects = {
        line: [_effect_on_line(line, effect, scenario) for effect in line.effects] for line in found
    }
    failed = [FailedRun(x.key, scenario.shown(x.key, x.value), x.reason) for x in found.failed]
    left_out = [NotRanked(key, why) for key, why in found.left_out.items()]
    every_effect = [x for of_line in effects.values() for x in of_line]
    return Outcome(
        "Sensitivity report",
        f"Uncertain values: {scenario.title or 'drive'}",
        _summary(found),
        "",
        (),
        (
            Part(
                "", (Table.of("ranking", LineEffects, found), Text(_how_to_read(found), note=True))
            ),
            *(Part(_line_title(line), tuple(_line_items(x))) for line, x in effects.items()),
            Part("Runs that failed", (Table.of("failed", FailedRun, failed),)),
            Part("Not ranked", (Table.of("not_ranked", NotRanked, left_out),)),
        ),
        scenario,
        files=(Table.of("effects", EffectOnLine, every_effect, for_readers=()),),
    )


_HOW_TO_READ = (
    "Each value is set to both ends of its range, and to extremes of the linearised drive in "
    "between, the others unchanged; d ln/d ln is the relative change of the line for a relative change of"
    " the value, at the value itself."
)


def _how_to_read(found: Ranking) -> str:
    return f"{_HOW_TO_READ} {found.how}".rstrip()


def _summary(found: Ranking) -> str:
    keys = {effect.key for line in found for effect in line.effects}
    return f"{len(keys)} uncertain values over their ranges, {len(found.lines)} lines, the largest first."


def _line_title(line: LineEffects) -> str:
    return f"{line.line}, {FREQUENCY.figure(line.frequency)}, {TORQUE.figure(line.amplitude)}"


def _line_items(effects: list[EffectOnLine]) -> Iterator[Table | Text]:
    yield Table.of("", EffectOnLine, effects)
    for effect in effects:
        if effect.remarks:
            yield Text(f"`{effect.key}`: {effect.remarks}.")


def _effect_on_line(line: LineEffects, effect: Effect, scenario: Scenario) -> EffectOnLine:
    low, high = (scenario.shown(effect.key, end) for end in effect.range)
    return EffectOnLine(
        line.line,
        effect.key,
        effect.sensitivity,
        *effect.slopes,
        *effect.amplitudes,
        *effect.range,
        "; ".join(_remarks(effect, scenario)),
        f"{low} to {high}",
    )


def _remarks(effect: Effect, scenario: Scenario) -> Iterator[str]:
    """Extremes inside the range, and slopes where the line has no derivative."""
    for value, amplitude in effect.between:
        at = scenario.shown(effect.key, value)
        size = TORQUE.figure(amplitude) or "unknown"
        yield f"{size} at {at}, where the linearised drive has an extreme"
    if math.isnan(effect.sensitivity) and not math.isnan(effect.slopes[0]):
        below, above = map(SENSITIVITY.text, effect.slopes)
        yield f"the line jumps or bends at the value itself, d ln/d ln {below} below and {above} above"
