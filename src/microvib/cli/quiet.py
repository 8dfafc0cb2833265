"""The command that searches for a quieter drive."""

from __future__ import annotations

import os
from typing import Any

import click

from microvib.cli.common import PATH, Target, load, set_option, target_options
from microvib.cli.progress import progress_bar
from microvib.errors import OptionError
from microvib.units import quantity

_STATUS_INTERVAL = 10.0  # seconds between two lines of progress where there is no terminal


@click.command()
@click.argument("scenario")
@click.option(
    "--objective",
    default="rms",
    metavar="FIGURE",
    help="What is made small: rms, a line such as drive_1, a band such as '0.5:150 Hz', or a CSV file of a limit.",
)
@click.option(
    "--requirement",
    type=PATH,
    metavar="FILE",
    help="In place of the objective: requirements on the line of sight, as of `budget`.",
)
@click.option(
    "--lever",
    "levers",
    multiple=True,
    metavar="LEVER",
    help="What may be changed: ramp, table, microsteps, rate, current, gains, damping, wings, with or"
    " without a range, e.g. 'current=0.3:0.6 A'; or KEY=LOW:HIGH of any number of the scenario.",
)
@click.option(
    "--study",
    type=PATH,
    metavar="FILE",
    help="Study file of a campaign: how drives scatter [default: assumed].",
)
@click.option(
    "--limit",
    metavar="TORQUE",
    help="Largest value allowed to 95 % of the cases, e.g. '3 mN*m'; of limits and requirements their own.",
)
@click.option(
    "--cases", default=80, type=click.IntRange(8, 10_000), help="Drawn cases that judge the result."
)
@click.option(
    "--effort", default=200, type=click.IntRange(4, 100_000), help="Settings that are tried."
)
@click.option(
    "--bits",
    type=click.IntRange(2, 24),
    help="Bits of the driver's converter, to which a table is rounded.",
)
@click.option(
    "--table-rows",
    default=16_384,
    type=click.IntRange(4, 16_384),
    help="Rows that the driver's table can hold.",
)
@click.option(
    "--margin", default="0", metavar="NUMBER", help="Least torque margin, with the factors."
)
@click.option(
    "--factor",
    "factors",
    multiple=True,
    metavar="NAME=NUMBER",
    help="Motorisation factor: inertia, spring, detent, friction, harness or total, e.g. friction=1.5.",
)
@click.option(
    "--lag", metavar="ANGLE", help="Largest angle of the array behind its command, e.g. '0.01 deg'."
)
@click.option(
    "--check", type=PATH, metavar="FILE", help="Judge this table of currents in place of a search."
)
@click.option(
    "--keep",
    type=PATH,
    metavar="FILE",
    help="Keep every figure here; a search that was interrupted goes on from it.",
)
@set_option
@target_options("Folder for scenario, table, lines and report [default: print only].")
def quiet(scenario: str, settings: tuple[str, ...], target: Target, **given: Any) -> None:
    """Find what to change in SCENARIO's drive so that it is quieter, in the worst of many drawn cases
    and from several starts.
    """
    from microvib.io.limit_files import is_limit_file
    from microvib.reports.quiet import quiet_outcome
    from microvib.studies.quiet.study import Constraints
    from microvib.studies.quiet.study import quiet as search

    loaded = load(scenario, settings)
    limit = given.pop("limit")
    constraints = Constraints.of_texts(given.pop("margin"), given.pop("factors"), given.pop("lag"))
    if is_limit_file(limit):
        raise OptionError(
            "limit",
            "is the largest value of what is made small; a curve over frequency is given as the"
            " objective, which counts the lines over it",
            limit,
            remedy="objective",
        )
    allowed = None if limit is None else quantity("limit", limit, "N*m", positive=True)
    best = _BestSoFar()
    with (
        progress_bar("searching", "runs", lines_every=_STATUS_INTERVAL) as progress,
        best,
    ):
        found = search(
            loaded,
            constraints=constraints,
            workers=os.cpu_count(),
            progress=progress,
            on_best=best.note,
            **given,
        )
    target.present(quiet_outcome(found, allowed))


class _BestSoFar:
    """Tells an interrupted search's best setting on standard error."""

    def __init__(self) -> None:
        self._text = ""

    def note(self, text: str) -> None:
        """Keep the sentence on the best setting so far."""
        self._text = text

    def __enter__(self) -> _BestSoFar:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is not None and issubclass(kind, KeyboardInterrupt) and self._text:
            click.echo(f"\nBest so far: {self._text}", err=True)
