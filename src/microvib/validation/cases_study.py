"""Everything that is compared of a published test with cases, with the share of the draws of its
assumptions over which it holds, and over which part of their ranges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from microvib.errors import error_context
from microvib.results import Column, Measure
from microvib.text_tables import counted
from microvib.validation.assumed_ranges import Deciding, DescribedDrive, described_drive
from microvib.validation.cases_file import CasesTest, Comparison
from microvib.validation.comparisons import Bar, Figures, bar_of
from microvib.validation.kept_figures import (
    LOSS_OF_SYNCHRONISM,
    CaseFigures,
    KeptDraws,
    differs,
    figures_under,
    kept_figures,
    kept_table,
)
from microvib.validation.separation import Separation, separations

HOLDS, FAILS, NOT_COMPARABLE = "holds", "does NOT hold", "not comparable"
Status = Literal["calibrated", "predicted", "not comparable"]
MAX_SEPARATIONS = 2
"""Assumptions that are named where they decide a comparison, at most."""
_PART = Measure("%", 0.01, ".0f")


@dataclass(frozen=True)
class Compared:
    """One claim of a published test: what is compared, and whether it holds."""

    claim: Annotated[str, Column("claim", "claim")]
    source: Annotated[str, Column("source", "source", report_only=True)]
    published: Annotated[str, Column("published", "published", report_only=True)]
    status: Annotated[str, Column("status", "status", role="group")]
    ours: Annotated[float, Column("ours", "ours", Measure(form=".4g"))]
    """Under the central assumptions."""
    unit: Annotated[str, Column("unit", "unit", report_only=True)]
    bar: Annotated[str, Column("bar", "bar")]
    share: Annotated[float, Column("share", "of draws", _PART)]
    """Part of the draws in which it holds, of those in which there is a figure."""
    draws: Annotated[float, Column("draws", "draws", Measure(form=".0f"), report_only=True)]
    """Draws in which there is a figure."""
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]
    """Under the central assumptions."""
    where: Annotated[str, Column("where", "where it holds")]
    separations: tuple[Separation, ...] = ()
    over_draws: tuple[float, ...] = ()
    """Its value in each draw; nan where there is none."""
    bounds: tuple[float, float] = (-math.inf, math.inf)
    """Where its value has to lie."""
    quantity: str = ""
    """Quantity of the value: a metric, or a ratio."""


@dataclass(frozen=True)
class CasesValidation:
    """A published test with cases, what is compared of it, and what it rests on."""

    name: str
    drive: DescribedDrive
    compared: tuple[Compared, ...]
    figures: Figures
    """Under the central assumptions, compared and shown ones."""
    kept: KeptDraws | None
    notes: tuple[str, ...]

    @property
    def test(self) -> CasesTest:
        """The test."""
        return self.drive.test

    @property
    def draws(self) -> int:
        """Draws of the assumptions that are kept."""
        return len(self.kept.figures) if self.kept else 0


def validate_cases(
    test: CasesTest, name: str, progress: Callable[[str], None] | None = None
) -> CasesValidation:
    """Compare a published test with cases, which was read from ``name``, with what they give.

    The cases are run under the central assumptions; shares come from the draws that are kept beside
    the file. Raises MicrovibError where a case is not allowed or cannot be simulated, and where
    the kept draws are of another version of the file.
    """
    with error_context(name):
        drive = described_drive(test, name)
        bars_of(test)
        central = figures_under(drive, drive.central_values(), test.shows, progress)
    kept = kept_figures(name, test)
    compared = compare_with_kept(drive, central.figures, kept)
    notes = tuple(_notes(test, name, kept, central))
    return CasesValidation(name, drive, compared, central.figures, kept, notes)


def bars_of(test: CasesTest) -> list[Bar | None]:
    """Value and bounds of each comparison of a test; ScenarioError for a bound that is none."""
    return [bar_of(test, one, f"compare.{k}") for k, one in enumerate(test.compare)]


def compare_with_kept(
    drive: DescribedDrive, figures: Figures, kept: KeptDraws | None
) -> tuple[Compared, ...]:
    """Compare the figures under the central assumptions, and those of the draws that are kept."""
    test = drive.test
    return tuple(
        _compared(comparison, bar, figures, drive, kept)
        for comparison, bar in zip(test.compare, bars_of(test), strict=True)
    )


def _notes(
    test: CasesTest, name: str, kept: KeptDraws | None, central: CaseFigures
) -> Iterator[str]:
    """Notes on figures and draws that readers need."""
    for case, reason in central.failed.items():
        yield f"Case '{case}' has no figures under the central assumptions: {reason}."
    table = kept_table(name)
    renew = f"`microvib statements {table} --test {name}`"
    if kept is None:
        yield (
            f"No draws are kept beside the file ({table}), so that nothing is said of the ranges of"
            f" the assumptions; {renew} makes them."
        )
        return
    failed = [reason for reason in kept.failed if reason]
    other = [reason for reason in failed if LOSS_OF_SYNCHRONISM not in reason]
    if failed:
        yield (
            f"In {len(failed) - len(other)} of {len(kept.failed)} draws the motor loses synchronism"
            " in a case, which then has no figures."
        )
    if other:
        yield (
            f"In {counted(len(other), 'draw')} a case could not be simulated; the first: {other[0]}."
        )
    off = differs(test, kept.central, central.figures)
    if off:
        case, metric = off[0]
        yield (
            f"The kept draws ({table}) were made by other equations or another scenario: '{metric}'"
            f" of '{case}' was {kept.central[off[0]]:.5g} and is {central.figures[off[0]]:.5g};"
            f" delete them, then {renew} makes them anew."
        )


def _status(comparison: Comparison) -> Status:
    if comparison.not_comparable:
        return "not comparable"
    if comparison.calibrated:
        return "calibrated"
    return "predicted"


def _compared(
    comparison: Comparison,
    bar: Bar | None,
    figures: Figures,
    drive: DescribedDrive,
    kept: KeptDraws | None,
) -> Compared:
    if bar is None:
        reason = comparison.not_comparable
        return _row(comparison, NOT_COMPARABLE, where=reason)
    ours = bar.value(figures)
    verdict = _verdict(bar.holds(ours))
    if kept is None or not kept.figures:
        return _row(comparison, verdict, ours=ours, bar=bar)
    values = [bar.value(of) for of in kept.figures]
    judged = [bar.holds(value) for value in values]
    known = np.array([one is not None for one in judged])
    held = np.array([one is True for one in judged])[known]
    deciding = drive.deciding(kept.values)
    columns = np.column_stack([one.values for one in deciding])[known]
    names = [one.name for one in deciding]
    found = tuple(separations(columns, held, names)[:MAX_SEPARATIONS])
    return replace(
        _row(comparison, verdict, ours=ours, bar=bar),
        share=float(held.mean()) if held.size else math.nan,
        draws=float(held.size),
        where=_where(held, len(judged), found, deciding),
        separations=found,
        over_draws=tuple(values),
    )


def _verdict(holds: bool | None) -> str:
    if holds is None:
        return NOT_COMPARABLE
    return HOLDS if holds else FAILS


def _row(
    comparison: Comparison,
    verdict: str,
    *,
    ours: float = math.nan,
    bar: Bar | None = None,
    where: str = "",
) -> Compared:
    return Compared(
        claim=comparison.claim,
        source=comparison.source,
        published=comparison.published,
        status=_status(comparison),
        ours=ours,
        unit=bar.unit if bar else "",
        bar=bar.words if bar else "",
        share=math.nan,
        draws=math.nan,
        verdict=verdict,
        where=where,
        bounds=(bar.least, bar.most) if bar else (-math.inf, math.inf),
        quantity=bar.quantity if bar else "",
    )


def _where(
    held: np.ndarray, draws: int, found: tuple[Separation, ...], deciding: Sequence[Deciding]
) -> str:
    """Over which part of the ranges a comparison holds, in words."""
    if held.size == 0:
        return "no draw has a figure"
    by_name = {one.name: one for one in deciding}
    texts = []
    for one in found:
        limit = by_name[one.name].quantity.show(float(f"{one.value:.2g}"))
        texts.append(
            f"{one.name}: in {_percent(one.below)} of draws below {limit}, in {_percent(one.above)}"
            " above"
        )
    if held.all():
        texts.append("over all of the ranges")
    elif not held.any():
        texts.append("nowhere in the ranges")
    elif not found:
        texts.append("no assumption decides by itself")
    if held.size < draws:
        texts.append(f"no figure in {draws - held.size} of {draws} draws")
    return "; ".join(texts)


def _percent(part: float) -> str:
    return f"{100.0 * part:.0f} %"
