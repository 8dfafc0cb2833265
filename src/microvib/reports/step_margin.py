"""Margin against lost steps as text, picture and tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Annotated

from microvib.reports import sheets
from microvib.reports.document import Text
from microvib.reports.outcome import Item, Outcome, Part, Picture
from microvib.results import COUNT, Column, Measure, Table
from microvib.studies.step_margin import Edge, StepMargin, StepRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    picture = Picture(
        "step_margin", lambda: draw_step_margin(margin), f"Lost steps over {margin.key}", _CAPTION
    )
    return Outcome(
        "Margin against lost steps",
        f"Lost steps over {margin.key}: {margin.scenario.title or 'drive'}",
        _summary(margin),
        "",
        (),
        (
            Part("", (*_edges(margin), picture)),
            Part("Runs", (Table.of("step_margin", ShownRun, runs), Text(_HOW_TO_READ, note=True))),
        ),
        margin.scenario,
    )


_HOW_TO_READ = (
    "A step is judged when the next begins, by the full step that the rotor is then nearest to. Lost"
    " steps leave the rotor behind its command, gained ones ahead of it; a step that fails can cost"
    " several. Between the values that were run nothing is known."
)


_CAPTION = (
    "Points: runs. Shaded: between neighbouring runs that both lose steps; hatched: where losses"
    " begin or cease, somewhere between two runs."
)


def draw_step_margin(margin: StepMargin) -> Figure:
    """Steps that were not made as commanded, and the first of them, over the value of the key."""
    figure, axes = sheets.sheet(4.2, 2)
    count, first = axes[:, 0]
    _draw_runs(count, margin, [(run, run.lost + run.gained) for run in margin.runs])
    _draw_runs(first, margin, [(run, run.first) for run in margin.losing])
    judged = max((run.judged for run in margin.runs), default=0)
    count.set(ylabel="steps lost and gained", title=f"{judged} steps a run")
    first.set(ylabel="first step not made", ylim=(0.0, 1.05 * max(judged, 1)))
    unit = _value(margin, margin.high).partition(" ")[2]
    first.set_xlabel(f"{margin.key} [{unit}]" if unit else margin.key)
    for ax in (count, first):
        ax.set_xlim(_number(margin, margin.low), _number(margin, margin.high))
        for a, b in pairwise(margin.runs):
            _shade(ax, margin, a, b)
    count.legend(loc="best", fontsize=7.5)
    return figure


_STATES = {"made": (sheets.BLUE, "o"), "lost": (sheets.RED, "o"), "not known": (sheets.GREY, "x")}
"""Colour and marker of a run's point."""


def _draw_runs(ax: Axes, margin: StepMargin, points: list[tuple[StepRun, int]]) -> None:
    for state, (color, marker) in _STATES.items():
        mine = [(_number(margin, run.value), n) for run, n in points if run.state == state]
        if mine:
            name = {"made": "all made", "lost": "some lost"}.get(state, "not simulated")
            x, y = zip(*mine, strict=True)
            ax.plot(
                x,
                y,
                color=color,
                marker=marker,
                markersize=4,
                linestyle="",
                label=name,
                clip_on=False,
            )


def _shade(ax: Axes, margin: StepMargin, a: StepRun, b: StepRun) -> None:
    """Shade the values between two neighbouring runs by what these say."""
    ends = _number(margin, a.value), _number(margin, b.value)
    if a.state == b.state == "lost":
        ax.axvspan(*ends, color=sheets.RED, alpha=0.15, linewidth=0)
    elif {a.state, b.state} == {"made", "lost"}:
        ax.axvspan(*ends, color=sheets.RED, alpha=0.3, linewidth=0, hatch="///", fill=False)


def _number(margin: StepMargin, value: float) -> float:
    """A value in the unit in which it is shown."""
    return float(_value(margin, value).partition(" ")[0])


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
        when = f"step {early}" if early == late else f"one of steps {early} to {late}"
        yield Text(f"Steps are lost {where}; the first not made is {when}.")
    for edge in margin.edges:
        yield Text(_edge_sentence(margin, edge))
    if margin.unknown:
        yield Text(f"{len(margin.unknown)} runs could not be simulated, and are not judged.")


def _edge_sentence(margin: StepMargin, edge: Edge) -> str:
    verb = "begin" if edge.begins else "cease"
    below, above = _value(margin, edge.below.value), _value(margin, edge.above.value)
    return f"Losses {verb} between {below} and {above}."
