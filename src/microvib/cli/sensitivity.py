"""The command that ranks what is not known."""

from __future__ import annotations

from dataclasses import asdict

import click

from microvib.cli.common import Target, load, set_option, target_options, with_precompilation
from microvib.cli.progress import progress_bar


@click.command()
@click.argument("scenario")
@click.option(
    "--steady",
    is_flag=True,
    help="Lines of steady states instead of runs from rest, and their derivatives as sensitivities.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON, in SI.")
@set_option
@target_options("Folder for tables and report [default: print only].")
@with_precompilation
def sensitivity(
    scenario: str, steady: bool, as_json: bool, settings: tuple[str, ...], target: Target
) -> None:
    """Rank, line by line, the values of SCENARIO whose sources note a range by how much they
    matter.

    Each goes to both ends of its range, and to extremes of the linearised drive in between, the
    others as they are; d ln/d ln is the sensitivity at the value itself.
    """
    from microvib.io.tables import to_json
    from microvib.reports.sensitivity import ranking_outcome
    from microvib.studies.sensitivity import sensitivities

    loaded = load(scenario, settings)
    with progress_bar("simulating", "runs") as progress:
        found = sensitivities(loaded, start="steady" if steady else None, progress=progress)
    if as_json:
        click.echo(to_json(asdict(found)), nl=False)
    else:
        target.present(ranking_outcome(found, loaded))
