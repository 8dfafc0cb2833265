"""Margin against lost steps as text and tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Annotated

from microvib.reports.document import Text
from microvib.reports.outcome import Item, Outcome, Part
from microvib.results import COUNT, Column, Measure, Table
from microvib.studies.step_margin import Edge, StepMargin, StepRun

SI_VALUE = Measure(form=".9g")


@dataclass(frozen=True)
class ShownRun:
    """A run with one value, as tables show it."""

    value: Annotated[str, Column("value", "value")]
    value_si: Annotated[float, Column("value_si", measure=SI_VALUE)]
    judged: Annotated[int, Column("judged", "steps", COUNT)]
    lost: Annotated[int, Column("lost", "lost", COUNT)]
    gained: Annotated[int, Column("gained", "gained", COUNT)]
    first: Annotated[int, Column("first_not_made", "first not made", COUNT)]
    state: Annotated[str, Column("state", "state")]


def step_margin_outcome(margin: StepMargin) -> Outcome:
    """A margin for those who read it: where steps are lost, and every run."""
    runs = [_shown(margin, run) for run in margin.runs]
    return Outcome(
        "Margin against lost steps",
        f"Lost steps over {margin.key}: {margin.scenario.title or 'drive'}",
        _summary(margin),
        "",
        (),
        (
            Part("", tuple(_edges(margin))),
            Part("Runs", (Table.of("step_margin", ShownRun, runs), Text(_HOW_TO_READ, note=True))),
        ),
        margin.scenario,
    )


_HOW_TO_READ = (
    "A step is judged when the next begins, by the full step that the rotor is then nearest to. Lost"
    " steps leave the rotor behind its command, gained ones ahead of it; a step that fails can cost"
    " several. Between the values that were run nothing is known."
)


def _shown(margin: StepMargin, run: StepRun) -> ShownRun:
    shown = margin.scenario.shown(margin.key, run.value)
    return ShownRun(
        shown, run.value, run.judged, run.lost, run.gained, run.first, run.problem or run.state
    )


def _summary(margin: StepMargin) -> str:
    steps = max((run.judged for run in margin.runs), default=0)
    return (
        f"{len(margin.runs)} runs over {margin.key} from {_value(margin, margin.low)} to"
        f" {_value(margin, margin.high)}, {steps} steps each."
    )


def _value(margin: StepMargin, value: float) -> str:
    return margin.scenario.shown(margin.key, value)


def _edges(margin: StepMargin) -> Iterator[Item]:
    known = [run for run in margin.runs if run.state != "not known"]
    for state, group in groupby(known, key=lambda run: run.state):
        runs = list(group)
        first, last = _value(margin, runs[0].value), _value(margin, runs[-1].value)
        where = f"at {first}" if len(runs) == 1 else f"from {first} to {last}"
        if state == "made":
            yield Text(f"All steps are made {where}.")
            continue
        early = min(run.first for run in runs)
        late = max(run.first for run in runs)
        when = f"step {early}" if early == late else f"steps {early} to {late}"
        yield Text(f"Steps are lost {where}; the first not made is {when}.")
    for edge in margin.edges:
        yield Text(_edge_sentence(margin, edge))
    if margin.unknown:
        yield Text(f"{len(margin.unknown)} runs could not be simulated, and are not judged.")


def _edge_sentence(margin: StepMargin, edge: Edge) -> str:
    verb = "begin" if edge.begins else "cease"
    below, above = _value(margin, edge.below.value), _value(margin, edge.above.value)
    return f"Losses {verb} between {below} and {above}."
