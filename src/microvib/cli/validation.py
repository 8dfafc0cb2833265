"""Commands that compare a published test with what scenarios give: validate, statements."""

from __future__ import annotations

from pathlib import Path

import click

from microvib.cli.common import PATH, Target, target_options, with_precompilation
from microvib.cli.progress import progress_bar
from microvib.cli.streams import echo

_TEST = "solar-array-simulator"


@click.command()
@click.argument("test", default=_TEST)
@target_options("Folder for table and report [default: print only].")
@with_precompilation
def validate(test: str, target: Target) -> None:
    """Compare the claims of a published TEST with the results of its scenarios: a catalog "
    "name or a YAML file [default: solar-array-simulator]."""
    from microvib.validation.report import validation_outcome
    from microvib.validation.study import validate as run_validation

    with progress_bar() as progress:
        found = run_validation(test, lambda text: progress.say(f"running {text}"))
    target.present(validation_outcome(found))


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
    default=40,
    type=click.IntRange(0, 100_000),
    help="How many draws of the assumptions.",
)
@click.option(
    "--seeds",
    default=24,
    type=click.IntRange(1, 1000),
    help="Draws of the noise for each state in each of them.",
)
def statements(table: Path, name: str, draws: int, seeds: int) -> None:
    """Check the claims of a published test over the ranges of its assumptions.

    Each draw is calibrated to the first state and kept as a row of TABLE, a CSV file; an
    existing table is continued. About a minute a draw. `microvib validate` shows the table beside the
    test's own file, which is made so.
    """
    from microvib.validation.claims import claims_of
    from microvib.validation.draws import extend_table, fraction_holding
    from microvib.validation.published import load_test

    test = load_test(name)
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
