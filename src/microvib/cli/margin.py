"""The command that finds where a pulsed drive loses steps."""

from __future__ import annotations

import click

from microvib.cli.common import Target, load, set_option, target_options, with_precompilation
from microvib.cli.progress import progress_bar


@click.command()
@click.argument("scenario")
@click.option(
    "--over",
    required=True,
    metavar="KEY=LOW:HIGH",
    help="Key that is varied and its range, e.g. 'driver.supply_voltage=60:80 V'.",
)
@click.option(
    "--count",
    default=11,
    type=click.IntRange(2, 1000),
    help="Values over the range; edges are narrowed down to a sixteenth of their distance.",
)
@set_option
@target_options("Folder for table, picture and report [default: print only].")
@with_precompilation
def margin(scenario: str, over: str, count: int, settings: tuple[str, ...], target: Target) -> None:
    """Find where SCENARIO, a drive by voltage pulses, loses steps: over its voltage, a friction, an
    inertia or any other number.
    """
    from microvib.reports.step_margin import step_margin_outcome
    from microvib.studies.step_margin import step_margin

    loaded = load(scenario, settings)
    with progress_bar("simulating", "runs") as progress:
        found = step_margin(loaded, over, count, progress=progress)
    target.present(step_margin_outcome(found))
