"""Two designs against the same requirements, for those who read it: one table, which passes, and what
decides it in each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

from microvib.analysis.margins import worst_verdict
from microvib.reports.budget import pointing_angle, reasons_not_judged
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Outcome, Part
from microvib.results import DECIBEL, DIFFERENCE, POINTING_ANGLE, SHARE, Column, Table
from microvib.studies.budget.designs import DesignPair, Designs
from microvib.studies.budget.study import summary
from microvib.studies.budget.sums import LEFT_OUT_IN_TURN, Assessment

CHANGE = replace(DECIBEL, form="+z.2f")
_RELATIVE_CHANGE = replace(DIFFERENCE, file_size=DIFFERENCE.size)


@dataclass(frozen=True)
class DesignRow:
    """A requirement by both designs; angles [rad]."""

    name: Annotated[str, Column("name", "name")]
    limit: Annotated[float, Column("limit_rad", "limit", POINTING_ANGLE)]
    a: Annotated[float, Column("a_value_rad", "A", POINTING_ANGLE)]
    a_least: Annotated[float, Column("a_least_rad", measure=POINTING_ANGLE)]
    a_most: Annotated[
        float, Column("a_most_rad", "A at most", POINTING_ANGLE, absent="not bounded")
    ]
    a_margin: Annotated[float, Column("a_margin_db", "margin of A", DECIBEL)]
    a_verdict: Annotated[str, Column("a_verdict", "verdict of A", role="verdict")]
    b: Annotated[float, Column("b_value_rad", "B", POINTING_ANGLE)]
    b_least: Annotated[float, Column("b_least_rad", measure=POINTING_ANGLE)]
    b_most: Annotated[
        float, Column("b_most_rad", "B at most", POINTING_ANGLE, absent="not bounded")
    ]
    b_margin: Annotated[float, Column("b_margin_db", "margin of B", DECIBEL)]
    b_verdict: Annotated[str, Column("b_verdict", "verdict of B", role="verdict")]
    change: Annotated[float, Column("change_percent", "B over A", _RELATIVE_CHANGE)]
    change_db: Annotated[float, Column("change_db", "B over A", CHANGE)]
    passed_by: Annotated[str, Column("passed_by", "passed by")]
    better: Annotated[str, Column("smaller", "smaller")]
    requirement: Annotated[str, Column("requirement", "requirement")]


_CONTRIBUTORS = (
    Column("name", "requirement", role="group"),
    Column("requirement"),
    Column("design", "design"),
    Column("source", "source"),
    Column("rms_rad", "rms", POINTING_ANGLE),
    Column("share", "share", SHARE),
    Column("without_rad", "value without it", POINTING_ANGLE),
)


def designs_outcome(found: Designs) -> Outcome:
    """Two designs side by side: values, margins and verdicts, what changes, and the worst contributors
    of each.
    """
    a, b = found.names
    rows = [_row(pair) for pair in found.pairs]
    table = Table.of(
        "designs",
        DesignRow,
        rows,
        caption="B over A: of the values, for a curve of what it allows. Smaller: the design whose figure"
        " is below the other's with all that is not known of either.",
    )
    return Outcome(
        "Comparison of designs",
        f"Two designs: A {a}, B {b}",
        _summary(found),
        worst_verdict((found.a.verdict, found.b.verdict)),
        tuple(_facts(found)),
        (
            Part("", (table, *_reasons(found))),
            Part("Worst contributors", (_contributors(found),)),
        ),
        data={
            "designs": {"a": {"name": a, **summary(found.a)}, "b": {"name": b, **summary(found.b)}}
        },
        descriptions={} if found.a.requirements is None else {"requirements": found.a.requirements},
        units=(pointing_angle(found.a),),
    )


def _summary(found: Designs) -> str:
    a, b = found.names
    words = {
        "both": "Both designs pass",
        "neither": "Neither design passes",
        "A": "A alone passes",
        "B": "B alone passes",
    }
    number = count_text(len(found.pairs), "requirement")
    return (
        f"{words[found.passed_by]} all of {number}. A is {a}, {found.a.holds_at}; B is {b},"
        f" {found.b.holds_at}."
    )


def _facts(found: Designs) -> Iterator[Fact]:
    for letter, budget in (("A", found.a), ("B", found.b)):
        verdicts = [one.verdict for one in budget.judged]
        said = f"{verdicts.count('pass')} of {len(verdicts)} passed by {letter}"
        yield Fact(
            "FAIL" if budget.verdict == "fail" else budget.verdict.capitalize(),
            said,
            "pass" if budget.verdict == "pass" else "fail",
        )


def _reasons(found: Designs) -> Iterator[Text]:
    for letter, budget in (("A", found.a), ("B", found.b)):
        for why in reasons_not_judged(budget):
            yield Text(f"{letter}: {why}")


def _row(pair: DesignPair) -> DesignRow:
    a, b, change = pair.a, pair.b, pair.change
    decibel = 20.0 * math.log10(change) if change > 0.0 else math.nan
    return DesignRow(
        a.requirement.name,
        a.requirement.limit or math.nan,
        *(a.value, a.least, a.most, a.margin_db, a.verdict),
        *(b.value, b.least, b.most, b.margin_db, b.verdict),
        change - 1.0,
        decibel,
        pair.passed_by,
        pair.better,
        a.requirement.text,
    )


def _contributors(found: Designs) -> Table:
    def rows(letter: str, one: Assessment) -> Iterator[tuple[object, ...]]:
        name = one.requirement.name or one.requirement.text
        for x in one.sources[:LEFT_OUT_IN_TURN]:
            yield name, one.requirement.text, letter, x.source, x.rms, x.share, x.without

    every = tuple(
        row
        for pair in found.pairs
        for letter, one in (("A", pair.a), ("B", pair.b))
        for row in rows(letter, one)
    )
    return Table("design_contributors", _CONTRIBUTORS, every)
