"""Validation from command to folder: one table, and spectra of the states."""

from __future__ import annotations

import math

from microvib.reports.blocks import overlay_block, study_report
from microvib.reports.document import (
    Contents,
    Document,
    Fact,
    Mark,
    Row,
    Section,
    Table,
    Text,
    table,
)
from microvib.reports.numbers import brief_number, count_text
from microvib.text_tables import text_table
from microvib.validation.study import Check, Validation, checks_csv

_INTRODUCTION = (
    "Calibrated rows were fitted to the test's own lines and are not evidence. Assumed rows"
    " say what predictions rest on,"
    " and from which range it was drawn. Predicted rows were not fitted to anything; they are given"
    " for the central assumptions,"
    " with the part of the draws, and of single records, in which they hold, and with what the"
    " states' scenarios give without these"
    " assumptions. Computed rows are arithmetic or numerics."
)


def validation_text(checks: list[Check]) -> str:
    """All checks as a table, and how many hold."""
    header = (
        "item",
        "published",
        "test",
        "ours",
        "error %",
        "holds",
        "spread",
        "single",
        "without",
        "status",
        "bar",
    )
    rows = [
        (
            c.item,
            brief_number(c.paper, 6),
            brief_number(c.test, 6),
            brief_number(c.ours, 5),
            brief_number(c.error_percent, 3),
            _holds(c),
            _part(c.over_spread),
            _part(c.single_records),
            brief_number(c.without, 4),
            c.status,
            c.bar,
        )
        for c in checks
    ]
    return "\n".join([text_table(header, rows, left=1, last_left=True), "", summary(checks)])


def _holds(c: Check) -> str:
    if c.holds is None:
        return ""
    if c.holds:
        return "yes"
    return "NO"


def _part(value: float) -> str:
    if math.isnan(value):
        return ""
    return f"{100.0 * value:.0f} %"


def summary(checks: list[Check]) -> str:
    """How many checks of each status hold."""
    parts = (
        f"{sum(c.holds is True for c in of)} of {len(of)} {status} rows hold"
        for status, of in _by_status(checks).items()
    )
    return "; ".join(parts) + "."


def _by_status(checks: list[Check]) -> dict[str, list[Check]]:
    """Checks that hold or do not, by their status."""
    judged = [c for c in checks if c.holds is not None]
    return {
        status: [c for c in judged if c.status == status]
        for status in dict.fromkeys(c.status for c in judged)
    }


def validation_folder(found: Validation) -> Contents:
    """``validation.csv`` and the report."""
    return {"validation.csv": checks_csv(found.checks)}, validation_report(found)


def validation_report(found: Validation) -> Document:
    """The report of the validation: every claim with its verdict, and the spectra of the states."""
    test, checks = found.test, found.checks
    torques = {
        k: (f"state {k}", state.motion["T_d"], state.motion.sample_rate)
        for k, state in found.states.items()
    }
    spectra = [overlay_block([torques[k] for k in one.states], one.title) for one in test.spectra]
    facts = [
        Fact(f"{sum(c.holds is True for c in of)} of {len(of)}", f"{status} rows hold")
        for status, of in _by_status(checks).items()
    ]
    sections = [Section("All claims", (_claims(checks),), new_page=True)]
    if spectra[1:]:
        sections.append(Section("Further spectra", tuple(spectra[1:])))
    return study_report(
        "Validation report",
        "Validation against a published test",
        f"{test.title}: the claims of {test.citation}, beside what the scenarios of its"
        f" {count_text(len(test.states), 'state')} give.",
        facts=facts,
        first_page=(Text(_INTRODUCTION), *_failing(checks), *spectra[:1]),
        sections=sections,
        parts={f"state {k}": state.motion.scenario for k, state in found.states.items()},
    )


_HEADER = [
    "item", "source", "published [1]", "test [1]", "ours [1]", "error [%]", "bar", "over spread", "single records", "without [1]",
    "holds",
]  # fmt: skip


def _claims(checks: list[Check]) -> Table:
    rows: list[Row] = []
    for status in dict.fromkeys(c.status for c in checks):
        of = [c for c in checks if c.status == status]
        rows += [Row((status,), "group"), *(Row(_cells(c), _mark(c)) for c in of)]
    return Table(table(_HEADER, ()).columns, tuple(rows))


def _failing(checks: list[Check]) -> tuple[Text | Table, ...]:
    fails = [[*_cells(c)[:9], c.status] for c in checks if c.holds is False]
    if fails:
        return (Text("Claims that do not hold:"), table([*_HEADER[:9], "status"], fails))
    return ()


def _mark(c: Check) -> Mark:
    if c.holds is None:
        return ""
    if c.holds:
        return "pass"
    return "fail"


def _cells(c: Check) -> tuple[str, ...]:
    return (
        c.item,
        c.source,
        brief_number(c.paper, 6),
        brief_number(c.test, 6),
        brief_number(c.ours, 6 if abs(c.ours) >= 1.0 else 4),
        brief_number(c.error_percent, 3),
        c.bar,
        _part(c.over_spread),
        _part(c.single_records),
        brief_number(c.without, 4),
        _holds(c),
    )
