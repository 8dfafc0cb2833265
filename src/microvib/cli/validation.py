"""Commands that compare published tests with what scenarios give: validate, statements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from microvib.cli.common import PATH, Target, target_options, with_precompilation
from microvib.cli.progress import progress_bar
from microvib.cli.streams import echo
from microvib.errors import OptionError

if TYPE_CHECKING:
    from microvib.reports.outcome import Outcome
    from microvib.validation.cases_file import CasesTest
    from microvib.validation.published import PublishedTest

_TEST = "solar-array-simulator"
_DRAWS_OF_STATES, _DRAWS_OF_CASES = 40, 128


@click.command()
@click.argument("test", required=False)
@target_options(
    "Folder for table and report, of all tests with a folder each [default: print only]."
)
@with_precompilation
def validate(test: str | None, target: Target) -> None:
    """Compare the claims of a published TEST with what its scenarios give: a name of the catalog or a
    YAML file [default: all tests of the catalog].
    """
    from microvib.io.named import test_names

    if test is not None:
        target.present(_outcome(test)[0])
        return
    names = test_names()
    if target.out is not None:
        _check_folders(target, names)
    held = []
    for name in names:
        outcome, counts = _outcome(name)
        echo(f"== {name}\n")
        folder = None if target.out is None else target.out / name
        replace(target, out=folder).present(outcome)
        echo("")
        held.append((name, counts))
    for name, counts in held:
        echo(f"{name}: {counts}")


def _check_folders(target: Target, names: tuple[str, ...]) -> None:
    """Refuse folders of the tests that hold other results, before anything is computed."""
    from microvib.io.writing import check_folder

    assert target.out is not None
    if target.out.exists() and (not target.out.is_dir() or _foreign(target.out, names)):
        check_folder(target.out, overwrite=False)
    for name in names:
        check_folder(target.out / name, target.overwrite)


def _foreign(folder: Path, names: tuple[str, ...]) -> bool:
    """Whether a folder holds anything but folders of the tests."""
    return any(entry.name not in names or not entry.is_dir() for entry in folder.iterdir())


def _outcome(name: str) -> tuple[Outcome, str]:
    """Outcome of a published test, and how many of its claims hold, in words."""
    from microvib.validation.cases_file import CasesTest
    from microvib.validation.cases_report import cases_outcome, cases_summary
    from microvib.validation.cases_study import validate_cases
    from microvib.validation.loading import load_published
    from microvib.validation.report import summary, validation_outcome
    from microvib.validation.study import validate as validate_states

    test = load_published(name)
    with progress_bar() as progress:

        def tell(text: str) -> None:
            progress.say(f"running {text}")

        if isinstance(test, CasesTest):
            found = validate_cases(test, name, tell)
            return cases_outcome(found), cases_summary(found)
        states = validate_states(name, tell)
    return validation_outcome(states), summary(states.checks)


@click.command()
@click.argument("table", type=PATH)
@click.option(
    "--test",
    "name",
    default=_TEST,
    show_default=True,
    help="Published test: a name of the catalog, or a YAML file.",
)
@click.option(
    "--draws",
    type=click.IntRange(0, 100_000),
    help="How many draws of the assumptions [default: 40 of a test with states, 128 of one with cases].",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 1000),
    help="Draws of the noise for each state in each of them, of a test with states [default: 24].",
)
def statements(table: Path, name: str, draws: int | None, seeds: int | None) -> None:
    """Check the claims of a published test over the ranges of its assumptions.

    Each draw is kept as a row of TABLE, a CSV file; an existing table is continued. `microvib
    validate` shows the table beside the test's own file, which is made so. In a test with states
    each draw is calibrated to the first state, which takes about a minute.
    """
    from microvib.validation.cases_file import CasesTest
    from microvib.validation.loading import load_published

    test = load_published(name)
    if not isinstance(test, CasesTest):
        _statements_of_states(
            test, table, _DRAWS_OF_STATES if draws is None else draws, seeds or 24
        )
        return
    if seeds is not None:
        raise OptionError("seeds", "belongs to tests with states; this one has cases")
    _statements_of_cases(test, name, table, _DRAWS_OF_CASES if draws is None else draws)


def _statements_of_cases(test: CasesTest, name: str, table: Path, draws: int) -> None:
    from microvib.validation.assumed_ranges import described_drive
    from microvib.validation.cases_study import compare_with_kept
    from microvib.validation.kept_figures import draws_of, extend_figures

    drive = described_drive(test, name)
    with progress_bar("computing", "draws") as progress:
        rows = extend_figures(drive, table, draws, progress)
    kept = draws_of(test, rows)
    assert kept is not None
    for one in compare_with_kept(drive, kept.central, kept):
        if one.draws > 0.0:
            share = f"in {100 * one.share:.0f} % of {one.draws:.0f} draws"
            echo(f"{one.claim}: {one.verdict}, {share}; {one.where}")
        else:
            echo(f"{one.claim}: {one.verdict}; {one.where}")


def _statements_of_states(test: PublishedTest, table: Path, draws: int, seeds: int) -> None:
    from microvib.validation.claims import claims_of
    from microvib.validation.draws import extend_table, fraction_holding

    with progress_bar("computing", "draws") as progress:

        def told(done: int, total: int) -> None:
            if done < total and not progress.begun:
                minutes = max(round((total - done) * seeds / 24), 1)
                echo(
                    f"{total - done} draws to compute, about {minutes} min. Each is kept in {table}"
                    " when it is done: after an"
                    " interruption the same command continues.",
                    err=True,
                )
            progress(done, total)

        rows = extend_table(test, table, draws, seeds, told)
    for k, claim in enumerate(claims_of(test)):
        spread, single = fraction_holding(rows, k)
        echo(
            f"{claim.item:90s} {100 * spread:5.0f} % of the draws, {100 * single:5.0f} % of"
            " single records"
        )
    refused = sum(bool(row["refused"]) for row in rows)
    echo(
        f"{refused} of {len(rows) - 1} draws were rejected: they do not reproduce state 1's lines."
    )
