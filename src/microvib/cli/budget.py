"""The pointing budget of a craft."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from microvib.model.scenario import Scenario
    from microvib.studies.budget.study import Budget
    from microvib.testdata.recording import Recording


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
    help="Other sources that move the line of sight: wheels, lines, densities, errors by class.",
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
@click.option(
    "--compare",
    "other",
    metavar="SCENARIO",
    help="A second design, B, beside SCENARIO, A: each with value, margin and verdict, and whether they differ.",
)
@click.option(
    "--compare-sources",
    "other_sources",
    type=PATH,
    metavar="FILE",
    help="Other sources of design B [default: those of A].",
)
@harmonics_option
@set_option
@target_options("Folder for tables, JSON and report [default: print only].")
@with_precompilation
def budget(
    scenarios: tuple[str, ...], requirement: Path | None, sources: Path | None, campaign: Path | None, recording: str | None,
    prepare: Path | None, rule: str, one_clock: bool, short_way: bool, steady: bool, angles: str | None,
    orbit: bool, other: str | None, other_sources: Path | None, harmonics: int,
    settings: tuple[str, ...], target: Target,
) -> None:  # fmt: skip
    """Assess the line of sight of a spacecraft against pointing requirements. SCENARIO is the
    drive on its spacecraft; further ones are other drives on the same spacecraft."""
    from microvib.reports.budget import budget_outcome
    from microvib.studies.budget.angles import budget_over_angles
    from microvib.studies.budget.study import pointing_budget

    two = other is not None or other_sources is not None
    if other is not None:
        _check_designs("compare", scenarios, requirement, campaign, recording, short_way)
    elif other_sources is not None:
        _check_designs("compare_sources", scenarios, requirement, campaign, recording, short_way)
    measured = _measured(recording, prepare)
    loaded = [load(name, settings) for name in scenarios]
    second, beside = other or scenarios[0], other_sources or sources
    of_second = _second_design(second, settings, beside) if two else None
    several = _several_angles(angles, orbit)
    judge: Callable[..., Budget] = budget_over_angles if several else pointing_budget
    common: dict[str, Any] = {
        "rule": rule, "one_clock": one_clock, "steady": steady, "harmonics": harmonics, **several,
    }  # fmt: skip
    with progress_bar(finishing="lines and report (compiles on first use)") as progress:
        found = judge(
            loaded, requirement, sources=sources or (), campaign=campaign, recording=measured, short_way=short_way,
            names=[Path(name).stem for name in scenarios], progress=progress, **common,
        )  # fmt: skip
    if of_second is None:
        target.present(budget_outcome(found))
        return
    with progress_bar(finishing="lines and report of design B") as progress:
        of_b = judge(
            [of_second], requirement, sources=beside or (), names=[Path(second).stem],
            progress=progress, **common,
        )  # fmt: skip
    names = _name_of_design(scenarios[0], sources), _name_of_design(second, beside)
    _present_designs(target, names, found, of_b)


def _present_designs(target: Target, names: tuple[str, str], a: Budget, b: Budget) -> None:
    """The comparison of design A with design B."""
    from microvib.reports.designs import designs_outcome
    from microvib.studies.budget.designs import Designs

    target.present(designs_outcome(Designs(names, a, b)))


def _second_design(name: str, settings: tuple[str, ...], sources: Path | None) -> Scenario:
    """The scenario of design B; it and its sources are read before design A is computed."""
    from microvib.studies.budget.files import Sources, read_file

    if sources is not None:
        read_file(sources, Sources)
    return load(name, settings)


def _measured(recording: str | None, prepare: Path | None) -> Recording | None:
    """The recording that takes the place of a run."""
    from microvib.io.recordings import read_prepared

    if recording is not None:
        return read_prepared(Path(recording), read_preparation(prepare)).recording
    if prepare is not None:
        raise OptionError(
            "prepare",
            "describes how a recording is prepared; give a recording as well",
            remedy="recording",
        )
    return None


def _several_angles(angles: str | None, orbit: bool) -> dict[str, Any]:
    """Keys of a budget over several angles of the array; empty for one."""
    from microvib.studies.angles import angles_in

    if angles is None and not orbit:
        return {}
    return {"angles": None if angles is None else angles_in(angles), "orbit": orbit}


def _name_of_design(scenario: str, sources: Path | None) -> str:
    """The files of a design, which may differ in either."""
    name = Path(scenario).name
    if sources is None:
        return name
    return f"{name} with {sources.name}"


def _check_designs(
    key: str, scenarios: tuple[str, ...], requirement: Path | None, *of_one: object
) -> None:
    """OptionError where two designs are to be compared, by the option ``key``, with what is of one
    alone; ``of_one`` are campaign, recording and short_way.
    """
    if requirement is None:
        raise OptionError(
            key, "judges two designs by the same requirements; give them", remedy="requirement"
        )
    if len(scenarios) > 1:
        raise OptionError(
            key,
            "takes one scenario for each design; give a second drive as spacecraft.second_wing",
        )
    for name, value in zip(("campaign", "recording", "short_way"), of_one, strict=True):
        if value:
            raise OptionError(
                key, f"does not go with {name}, which is of one design; leave one of them out"
            )
