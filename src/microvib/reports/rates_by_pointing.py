"""Rate plans by the line of sight as text, tables and a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from microvib.reports import sheets
from microvib.reports.document import Fact, Text
from microvib.reports.outcome import Item, Outcome, Part, Picture, Verdict
from microvib.results import MICROSTEPS, RATE, SHARE, Column, Table
from microvib.studies.rates_by_pointing import JudgedRate, PointingPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 12


def pointing_rates_outcome(plan: PointingPlan) -> Outcome:
    """A plan for those who read it: the best rates with their budgets' verdicts, every case."""
    ranked = sorted((x for x in plan.cases if math.isfinite(x.share)), key=lambda x: x.share)
    first: list[Item] = [
        Text(_best(plan)),
        Table("judged", _JUDGED, tuple(map(_judged_row, plan.judged))),
        Picture("share", lambda: draw_shares(plan), "Part of the limit over rate", _CAPTION),
    ]
    failed = [x for x in plan.cases if not math.isfinite(x.share)]
    return Outcome(
        "Rate plan",
        f"Rates by the line of sight: {plan.scenario.title or 'drive'}",
        _summary(plan),
        _verdict(plan),
        tuple(_facts(plan)),
        (
            Part("", tuple(first)),
            Part(
                "Rates, the least part of a limit first",
                (
                    Table.of(
                        "rates_by_pointing",
                        type(plan.cases[0]),
                        plan.cases,
                        for_readers=ranked,
                        brief=SHOWN,
                    ),
                    Text(_HOW_TO_READ, note=True),
                ),
            ),
            Part("Not solved", tuple(Text(f"{RATE.figure(x.rate)}: {x.solved}.") for x in failed)),
        ),
        plan.scenario,
    )


_JUDGED = (
    MICROSTEPS,
    Column("rate_deg_s", "rate", RATE),
    Column("of_limit", "of the limit", SHARE),
    Column("verdict", "budget", role="verdict"),
)
_CAPTION = (
    "Largest part of a requirement's limit that the drive's lines use. Dashed: the limit. Filled:"
    " rates that a budget judged."
)
_HOW_TO_READ = (
    "Cases are compared by the drive's own lines at one array angle, levels by their bounds. Other"
    " sources, gaps and uncertainties are in the budgets of the judged rates alone."
)


def _judged_row(one: JudgedRate) -> tuple[int, float, float, str]:
    return one.case.microsteps, one.case.rate, one.case.share, one.verdict


def _summary(plan: PointingPlan) -> str:
    rates = [case.rate for case in plan.cases]
    steady = sum(case.solved == "steady" for case in plan.cases)
    return (
        f"{len(plan.cases)} cases from {RATE.figure(min(rates))} to {RATE.figure(max(rates))},"
        f" {len(plan.requirements)} requirements on the line of sight; {steady} in their steady"
        " states, the others in time or not at all."
    )


def _best(plan: PointingPlan) -> str:
    best = plan.best
    least = plan.judged[0].case
    if best is None:
        return (
            f"No judged rate passes. The least part of a limit is {SHARE.figure(least.share)} at"
            f" {RATE.figure(least.rate)} with {least.microsteps} microsteps, of {least.requirement}."
        )
    case = best.case
    return (
        f"Best: {RATE.figure(case.rate)} with {case.microsteps} microsteps, where the drive's lines"
        f" use {SHARE.figure(case.share)} of the limit of {case.requirement}; its budget passes."
    )


def _verdict(plan: PointingPlan) -> Verdict:
    if plan.best is not None:
        return "pass"
    if all(one.verdict == "fail" for one in plan.judged) and _all_above(plan):
        return "fail"
    return "not judged"


def _all_above(plan: PointingPlan) -> bool:
    """Whether the drive's lines alone are above a limit at every rate."""
    return all(x.share > 1.0 for x in plan.cases)


def _facts(plan: PointingPlan) -> Iterator[Fact]:
    least = plan.judged[0].case
    yield Fact(RATE.figure(least.rate), f"least part of a limit, {least.microsteps} microsteps")
    yield Fact(SHARE.figure(least.share), "of the limit, by the drive's lines")


def draw_shares(plan: PointingPlan) -> Figure:
    """Part of the limit over rate, a curve for each microstep count."""
    figure, ax = sheets.one_axes(3.0)
    counts = dict.fromkeys(case.microsteps for case in plan.cases)
    judged = {(one.case.microsteps, one.case.rate) for one in plan.judged}
    for count, colour in zip(counts, sheets.COLOURS * 4, strict=False):
        own = [x for x in plan.cases if x.microsteps == count and math.isfinite(x.share)]
        rates = [math.degrees(x.rate) for x in own]
        ax.plot(
            rates,
            [100.0 * x.share for x in own],
            "o-",
            mfc="none",
            ms=3,
            color=colour,
            label=f"{count} microsteps",
        )
        chosen = [x for x in own if (x.microsteps, x.rate) in judged]
        ax.plot(
            [math.degrees(x.rate) for x in chosen],
            [100.0 * x.share for x in chosen],
            "o",
            color=colour,
        )
    ax.axhline(100.0, color=sheets.RED, linestyle="--")
    ax.set_yscale("log")
    sheets.plain_numbers(ax.yaxis)
    ax.set_xlabel("rate of the array [deg/s]")
    ax.set_ylabel("of the limit [%]")
    ax.legend(loc="best")
    return figure
