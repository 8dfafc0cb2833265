"""A published test with cases for those who read it: what is compared, over which part of the
assumptions it holds, and all that it rests on.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated

import numpy as np

from microvib.reports import sheets
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Item, Outcome, Part, Picture
from microvib.results import TORQUE, Column, Measure, Table
from microvib.units import pretty
from microvib.validation.cases_study import (
    HOLDS,
    NOT_COMPARABLE,
    CasesValidation,
    Compared,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_INTRODUCTION = (
    "Verdicts and figures (ours) are those under the central assumptions; the share is that of the"
    " draws of the assumptions in which a claim holds, and beside it stand the values of assumptions"
    " that part the draws in which it holds from the others. Predicted: nothing was fitted to it."
    " Calibrated: something was, and it is no evidence. Not comparable: nothing can be compared, and"
    " why."
)
_MAX_PANELS = 6
SMALLEST_SHOWN = 1e-4
"""Torque [mN m] below which it is only said that one is less."""
_STATUSES = ("calibrated", "predicted", "not comparable")


@dataclass(frozen=True)
class MeasuredRow:
    """One finding of the test."""

    finding: Annotated[str, Column("finding", "finding")]
    value: Annotated[str, Column("value", "value")]
    source: Annotated[str, Column("source", "source")]


@dataclass(frozen=True)
class AssumedRow:
    """One assumption with its range, in words."""

    name: Annotated[str, Column("assumption", "assumed")]
    meaning: Annotated[str, Column("meaning", "meaning", report_only=True)]
    low: Annotated[str, Column("low", "from")]
    central: Annotated[str, Column("central", "central")]
    high: Annotated[str, Column("high", "to")]
    spacing: Annotated[str, Column("spacing", "spacing", report_only=True)]
    why: Annotated[str, Column("why", "why", report_only=True)]


@dataclass(frozen=True)
class GivenRow:
    """A key of the scenario that the publication gives."""

    key: Annotated[str, Column("key", "given", role="key")]
    value: Annotated[str, Column("value", "value")]
    source: Annotated[str, Column("source", "source")]


def cases_summary(found: CasesValidation) -> str:
    """How many comparisons of each status hold, in a sentence."""
    return "; ".join(f"{value} {label}" for value, label in _counts(found.compared)) + "."


def _counts(compared: tuple[Compared, ...]) -> Iterator[tuple[str, str]]:
    for status in _STATUSES[:2]:
        of = [one for one in compared if one.status == status and one.verdict != NOT_COMPARABLE]
        if of:
            held = sum(one.verdict == HOLDS for one in of)
            yield f"{held} of {len(of)}", f"{status} claims hold"
    none = sum(one.verdict == NOT_COMPARABLE for one in compared)
    if none:
        yield str(none), "not comparable"


def cases_outcome(found: CasesValidation) -> Outcome:
    """The comparison for those who read it."""
    test = found.test
    said = [f"Verdicts are given with {count_text(found.draws, 'draw')} of the assumptions."]
    if not found.draws:
        said = []
    texts = [Text(x) for x in (test.remarks, _INTRODUCTION, *said, *found.notes) if x]
    return Outcome(
        "Validation report",
        "Validation against a published test",
        f"{test.title}: the claims of {test.citation}, beside what its cases give.",
        "",
        tuple(Fact(value, label) for value, label in _counts(found.compared)),
        (
            Part("", (*texts, Table.of("validation", Compared, _by_status(found.compared)))),
            Part("Where claims hold", tuple(_pictures(found)), report_only=True),
            Part("What was measured", (_measured(found),), new_page=True),
            Part("What is assumed", tuple(_assumed(found))),
            Part("Figures under the central assumptions", tuple(_figures(found))),
        ),
        descriptions={"drive": found.drive.base},
    )


def _by_status(compared: tuple[Compared, ...]) -> list[Compared]:
    return sorted(compared, key=lambda one: _STATUSES.index(one.status))


def _measured(found: CasesValidation) -> Table:
    rows = [MeasuredRow(x.finding, x.value, x.source) for x in found.test.measured]
    return Table.of("measured", MeasuredRow, rows)


def _assumed(found: CasesValidation) -> Iterator[Item]:
    base = found.drive.base
    given = [GivenRow(key, _shown(found, key), source) for key, source in found.test.given.items()]
    yield Table.of("given", GivenRow, given)
    rows = [
        AssumedRow(
            one.name,
            one.quantity.meaning,
            one.show(one.low),
            one.show(one.central),
            one.show(one.high),
            one.range.spacing,
            one.range.why,
        )
        for one in found.drive.assumptions
    ]
    yield Table.of("assumed", AssumedRow, rows)
    held = [f"{key} {base.shown(key, base[key])}" for key in found.drive.held_keys()]
    if held:
        yield Text(f"Assumed and held, without a range: {', '.join(held)}.", note=True)


def _shown(found: CasesValidation, key: str) -> str:
    """A value of the scenario as tables show it; empty for a group."""
    base = found.drive.base
    value = base[key]
    if isinstance(value, (str, int, float)):
        return str(base.shown(key, value))
    return ""


def _figures(found: CasesValidation) -> Iterator[Item]:
    """Figures of the cases by metrics, one table for all."""
    test = found.test
    metrics = [x for x in test.metrics if any(x == metric for _, metric in found.figures)]
    columns = [Column("case", "case")]
    columns += [
        Column(_key(test.metrics[x].unit, x), x, _measure(test.metrics[x].unit)) for x in metrics
    ]
    cases = dict.fromkeys(case for case, _ in found.figures)
    rows = tuple(
        (case, *(found.figures.get((case, metric), math.nan) for metric in metrics))
        for case in cases
    )
    yield Table("figures", tuple(columns), rows)


def _key(unit: str, metric: str) -> str:
    """Name of a metric's column in files, with its unit."""
    plain = unit.replace("*", "_").replace("/", "_").replace("^", "").lower()
    return "_".join(filter(None, [metric.replace(" ", "_"), plain]))


def _measure(unit: str) -> Measure:
    if unit == "N*m":
        return replace(TORQUE, least=SMALLEST_SHOWN)
    return Measure(unit.replace("*", " "), form=".4g")


def _pictures(found: CasesValidation) -> Iterator[Item]:
    parted = [one for one in found.compared if one.separations]
    if parted and found.kept:
        yield Picture(
            "separations",
            partial(draw_separations, found, parted[:_MAX_PANELS]),
            "Values of comparisons over the assumption that decides each of them",
            "Each point is a draw of the assumptions; the dashed line is the bar, the dotted one the"
            " value that parts the draws best. Filled: the claim holds.",
        )


def draw_separations(found: CasesValidation, compared: list[Compared]) -> Figure:
    """Draw the value of some comparisons over the assumption that decides each of them."""
    figure, axes = sheets.panels(len(compared), 2.6, 2)
    for ax, one in zip(axes, compared, strict=True):
        _draw_panel(ax, found, one)
    return figure


def _draw_panel(ax: Axes, found: CasesValidation, one: Compared) -> None:
    assert found.kept is not None
    parted = one.separations[0]
    deciding = next(x for x in found.drive.deciding(found.kept.values) if x.name == parted.name)
    x, y = deciding.values, np.array(one.over_draws)
    low, high = one.bounds
    held = (y >= low) & (y <= high)
    known = np.isfinite(y)
    ax.plot(x[known & held], y[known & held], ".", color=sheets.BLUE, markersize=5)
    ax.plot(
        x[known & ~held], y[known & ~held], ".", color=sheets.RED, markersize=5, fillstyle="none"
    )
    for bound in (low, high):
        if math.isfinite(bound) and bound > 0.0:
            ax.axhline(bound, color="black", linewidth=0.9, linestyle="--")
    ax.axvline(parted.value, color=sheets.GREY, linewidth=0.9, linestyle=":")
    if deciding.logarithmic:
        ax.set_xscale("log")
        _show_plain_numbers(ax.xaxis)
    if np.all(y[known] > 0.0):
        ax.set_yscale("log")
        _show_plain_numbers(ax.yaxis)
    ax.set_xlabel(_with_unit(parted.name, deciding.quantity.unit))
    ax.set_ylabel(_with_unit(one.quantity, one.unit))
    ax.set_title("\n".join(textwrap.wrap(one.claim, 55)), fontsize=7)


def _with_unit(name: str, unit: str) -> str:
    """A name with its unit, where it has one."""
    shown = pretty(unit)
    return f"{name} [{shown}]" if shown else name


def _show_plain_numbers(axis: Axis) -> None:
    """Show plain numbers at a few ticks of a logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
