"""Validation for those who read it: one table, and spectra of the states."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from microvib.reports.blocks import OVERLAY_CAPTION, draw_overlay
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Item, Outcome, Part, Picture
from microvib.results import Table
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


def summary(checks: list[Check]) -> str:
    """How many checks of each status hold."""
    parts = (f"{count} {rows} hold" for count, rows in _held(checks))
    return "; ".join(parts) + "."


def _held(checks: list[Check]) -> Iterator[tuple[str, str]]:
    """How many of the checks of each status that claim something hold."""
    judged = [c for c in checks if c.holds is not None]
    for status in dict.fromkeys(c.status for c in judged):
        of = [c for c in judged if c.status == status]
        yield f"{sum(c.holds is True for c in of)} of {len(of)}", f"{status} rows"


def validation_outcome(found: Validation) -> Outcome:
    """The validation for those who read it: every claim with its verdict, and the spectra of the
    states.
    """
    test, checks = found.test, found.checks
    spectra = tuple(_spectra(found))
    return Outcome(
        "Validation report",
        "Validation against a published test",
        f"{test.title}: the claims of {test.citation}, beside what the scenarios of its"
        f" {count_text(len(test.states), 'state')} give.",
        "",
        tuple(Fact(count, f"{rows} hold") for count, rows in _held(checks)),
        (
            Part("", (Text(_INTRODUCTION), *_failing(checks), *spectra[:1])),
            Part("All claims", (_claims(checks), Text(summary(checks))), new_page=True),
            Part("Further spectra", spectra[1:], report_only=True),
        ),
        other_files={"validation.csv": checks_csv(checks)},
        descriptions={f"state {k}": state.motion.scenario for k, state in found.states.items()},
    )


def _spectra(found: Validation) -> Iterator[Picture]:
    torques = {
        k: (f"state {k}", state.motion["T_d"], state.motion.sample_rate)
        for k, state in found.states.items()
    }
    for one in found.test.spectra:
        draw = partial(draw_overlay, [torques[k] for k in one.states])
        yield Picture("", draw, f"Spectra: {one.title}", f"{one.title}. {OVERLAY_CAPTION}")


def _claims(checks: list[Check]) -> Table:
    """All claims, those of one status together."""
    statuses = list(dict.fromkeys(c.status for c in checks))
    return Table.of("", Check, sorted(checks, key=lambda c: statuses.index(c.status)))


def _failing(checks: list[Check]) -> Iterator[Item]:
    fails = [c for c in checks if c.holds is False]
    if fails:
        yield Text("Claims that do not hold:")
        yield Table.of("", Check, fails)
