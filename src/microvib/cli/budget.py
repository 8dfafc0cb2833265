"""The pointing budget of a craft."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from microvib.cli.common import (
    PATH,
    Target,
    harmonics_option,
    load,
    read_preparation,
    set_option,
    target_options,
    with_precompilation,
)
from microvib.cli.progress import progress_bar
from microvib.errors import OptionError


@click.command()
@click.argument("scenarios", metavar="SCENARIO...", nargs=-1, required=True)
@click.option(
    "--requirement",
    type=PATH,
    metavar="FILE",
    help="Requirements: limits per window, curves over frequency.",
)
@click.option(
    "--sources",
    type=PATH,
    metavar="FILE",
    help="Other sources that move the line of sight: wheels, lines, densities.",
)
@click.option(
    "--campaign",
    type=PATH,
    metavar="FOLDER",
    help="Merged campaign of SCENARIO: median, P95, P99 over its cases.",
)
@click.option(
    "--recording",
    metavar="FILE",
    help="The drive's loads recorded on a force table, in place of a run.",
)
@click.option("--prepare", type=PATH, metavar="FILE", help="How to prepare the recording.")
@click.option(
    "--sum",
    "rule",
    default="rss",
    metavar="RULE",
    help="Lines of one frequency: rss, coherent or bound.",
)
@click.option(
    "--one-clock",
    is_flag=True,
    help="All drives step from one clock: their lines keep their relative phases.",
)
@click.option(
    "--short-way",
    is_flag=True,
    help="Also use the blocked-load method (blocked loads and apparent masses), and report its error against the coupled run.",
)
@click.option(
    "--steady",
    is_flag=True,
    help="Start in the steady state (record.start=steady), without settling.",
)
@click.option(
    "--angles",
    metavar="FIRST:LAST:STEP",
    help="Assess each requirement at the worst of these array angles, e.g. 0:330:30 (degrees), or a list, 0,45,90.",
)
@click.option(
    "--orbit",
    is_flag=True,
    help="Assess each requirement at the worst array angle of one revolution; with --angles, between the first and the last.",
)
@harmonics_option
@set_option
@target_options("Folder for tables, JSON and report [default: print only].")
@with_precompilation
def budget(
    scenarios: tuple[str, ...], requirement: Path | None, sources: Path | None, campaign: Path | None, recording: str | None,
    prepare: Path | None, rule: str, one_clock: bool, short_way: bool, steady: bool, angles: str | None,
    orbit: bool, harmonics: int,
    settings: tuple[str, ...], target: Target,
) -> None:  # fmt: skip
    """Assess the line of sight of a spacecraft against pointing requirements. SCENARIO is "
    "the drive on its spacecraft; further ones are other drives on the same spacecraft."""
    from microvib.io.recordings import read_prepared
    from microvib.reports.budget import budget_outcome
    from microvib.studies.angles import angles_in
    from microvib.studies.budget.angles import budget_over_angles
    from microvib.studies.budget.study import Budget, pointing_budget

    if recording is None and prepare is not None:
        raise OptionError(
            "prepare",
            "describes how a recording is prepared; give a recording as well",
            remedy="recording",
        )
    if recording is None:
        measured = None
    else:
        measured = read_prepared(Path(recording), read_preparation(prepare)).recording
    loaded = [load(name, settings) for name in scenarios]
    if angles is None:
        turns = None
    else:
        turns = angles_in(angles)
    if turns is None and not orbit:
        several: dict[str, Any] = {}
    else:
        several = {"angles": turns, "orbit": orbit}
    if several:
        judge: Callable[..., Budget] = budget_over_angles
    else:
        judge = pointing_budget
    with progress_bar(finishing="lines and report (compiles on first use)") as progress:
        found = judge(
            loaded, requirement, sources=sources or (), campaign=campaign, recording=measured, rule=rule,
            one_clock=one_clock, short_way=short_way, steady=steady, harmonics=harmonics,
            names=[Path(name).stem for name in scenarios], progress=progress, **several,
        )  # fmt: skip
    target.present(budget_outcome(found))
