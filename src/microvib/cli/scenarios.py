"""Commands about one scenario: run it, report on the run again, show it, list the catalog."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from microvib.cli.common import (
    PATH,
    Target,
    band_limit_options,
    harmonics_option,
    limit_options,
    load,
    parse_limit,
    read_bands,
    report_options,
    set_option,
    with_precompilation,
)
from microvib.cli.progress import progress_bar
from microvib.cli.streams import echo
from microvib.errors import OptionError, OutputError

if TYPE_CHECKING:
    from microvib.model.scenario import Scenario
    from microvib.reports.document import Form
    from microvib.signals.limit_curve import Limit

_KINDS = (".html", ".pdf")  # files of a report


@click.command()
@click.argument("scenario")
@set_option
@click.option(
    "-o", "--out", type=PATH, help="Folder for the results [default: the scenario's name]."
)
@click.option("--overwrite", is_flag=True, help="Replace an existing run in the folder.")
@click.option(
    "--lines-only",
    is_flag=True,
    help="Write lines only, no motion and no report: memory does not grow with the record.",
)
@harmonics_option
@click.option(
    "--steady",
    is_flag=True,
    help="Start in the steady state (record.start=steady), without settling; lines are then exact.",
)
@click.option(
    "--angles",
    metavar="FIRST:LAST:STEP",
    help="One run at each angle of the array on its spacecraft, e.g. 0:180:15 (degrees), or "
    "a list, 0,45,90; one table and picture.",
)
@click.option(
    "--orbit",
    is_flag=True,
    help="Lines and pointing windows over one revolution of the array, from steady states; "
    "with --angles, between the first and the last.",
)
@click.option(
    "--seeds",
    type=click.IntRange(2, 100_000),
    help="Number of noise draws: mean, deviation and 95 % quantile of each line; a limit then applies to the quantile.",
)
@limit_options
@band_limit_options
@report_options
@with_precompilation
def run(
    scenario: str, settings: tuple[str, ...], out: Path | None, overwrite: bool, lines_only: bool, harmonics: int,
    steady: bool, angles: str | None, orbit: bool, seeds: int | None, limit: str | None, band: str | None,
    band_file: Path | None, roll_off: float | None, form: Form,
) -> None:  # fmt: skip
    """Simulate SCENARIO (a file, or a catalog name) and write motion, lines, summary and report."""
    from microvib.io.writing import check_folder, free_folder
    from microvib.reports.outcome import terminal_text
    from microvib.reports.run.folder import run_to_folder

    if form.pdf and lines_only:
        raise OptionError("pdf", "--lines-only makes no report; leave one of them out")
    allowed, band_limits = parse_limit(limit, band), read_bands(band_file, roll_off)
    without_one_motion = lines_only or bool(seeds)
    if band_limits and without_one_motion:
        raise OptionError("bands", "are judged by one motion; leave lines_only and seeds out")
    loaded = load(scenario, (*settings, "record.start=steady") if steady else settings)
    out = out or free_folder(Path(scenario).stem)
    check_folder(out, overwrite)
    if angles is not None or orbit:
        _check_over_angles(orbit, bool(band_limits) or without_one_motion)
        target = Target(out, overwrite, form)
        if orbit:
            _run_orbit(loaded, angles, harmonics, allowed, target)
        else:
            _run_angles(loaded, angles or "", harmonics, allowed, target)
        return
    with progress_bar(finishing="lines and report (compiles on first use)") as progress:
        _, outcome, files = run_to_folder(
            loaded, out, overwrite=overwrite, lines_only=lines_only, harmonics=harmonics, seeds=seeds or 0, limit=allowed,
            band_limits=band_limits, roll_off=roll_off, form=form, progress=progress,
        )  # fmt: skip
    echo(terminal_text(outcome))
    echo(f"Written: {', '.join(str(out / name) for name in files)}")


def _check_over_angles(orbit: bool, of_one_motion: bool) -> None:
    """OptionError for what a sweep over angles does not look at."""
    if of_one_motion:
        raise OptionError(
            "orbit" if orbit else "angles",
            "cannot be combined with bands, lines_only or seeds; leave them out",
        )


def _run_angles(
    loaded: Scenario, angles: str, harmonics: int, limit: Limit | None, target: Target
) -> None:
    from microvib.reports.angles import angles_outcome
    from microvib.studies.angles import angles_in, check_sweep, sweep_angles

    asked = angles_in(angles)
    check_sweep(loaded)
    with progress_bar("solving", "angles") as progress:
        sweep = sweep_angles(loaded, asked, harmonics=harmonics, limit=limit, progress=progress)
    target.present(angles_outcome(sweep))


def _run_orbit(
    loaded: Scenario, angles: str | None, harmonics: int, limit: Limit | None, target: Target
) -> None:
    from microvib.reports.orbit import orbit_outcome
    from microvib.studies.angles import angles_in
    from microvib.studies.orbit import analyse_orbit, check_orbit

    if angles is None:
        asked = None
    else:
        asked = angles_in(angles)
    check_orbit(loaded, asked)
    with progress_bar("solving", "angles") as progress:
        orbit = analyse_orbit(loaded, asked, harmonics=harmonics, limit=limit, progress=progress)
    target.present(orbit_outcome(orbit))


@click.command()
def scenarios() -> None:
    """List the published scenarios of the catalog."""
    from microvib.io.named import catalog_names
    from microvib.io.scenario_file import load_scenario

    for name in catalog_names():
        loaded = load_scenario(name)
        mode = loaded.array.modes[0]
        echo(
            f"{name:10s} {loaded.title}: {loaded.array.inertia:g} kg m², first mode"
            f" {mode.frequency:g} Hz [{loaded.source}]"
        )


@click.command()
@click.argument("scenario")
@set_option
def show(scenario: str, settings: tuple[str, ...]) -> None:
    """Print SCENARIO checked and complete, with derived values and the orders of drive and gears."""
    from microvib.io.scenario_file import dump_scenario
    from microvib.reports.parameters import derived, order_lines

    loaded = load(scenario, settings)
    click.echo(dump_scenario(loaded), nl=False)
    click.echo("\n# Derived:")
    for text in derived(loaded):
        click.echo(f"#   {text}")
    click.echo("\n# Orders:")
    for text in order_lines(loaded, indent=4):
        click.echo(f"#   {text}")


@click.command()
def schema() -> None:
    """Print the JSON Schema of scenario files."""
    from microvib.io.scenario_file import json_schema
    from microvib.io.tables import to_json

    click.echo(to_json(json_schema()), nl=False)


@click.command()
@click.argument("folder", type=PATH)
@limit_options
@click.option(
    "-o",
    "--output",
    type=PATH,
    help="File to write, .html or .pdf [default: report.html of the folder, with --pdf report.pdf too].",
)
@report_options
@click.option("--overwrite", is_flag=True, help="Replace an existing --output file.")
def report(
    folder: Path,
    limit: str | None,
    band: str | None,
    output: Path | None,
    overwrite: bool,
    form: Form,
) -> None:
    """Make the report of a run again from its FOLDER, with the run's limit and band or with others,
    and with the bands of its time history.

    report.html of the folder is replaced, with --pdf report.pdf too. --limit none leaves the limit
    out.
    """
    from microvib.analysis.run import RunResult
    from microvib.io.runs import read_run
    from microvib.io.writing import write_file
    from microvib.reports.bands import with_bands
    from microvib.reports.outcome import report as report_of
    from microvib.reports.outcome import terminal_text
    from microvib.reports.rendering import html, pdf
    from microvib.reports.run.outcome import run_outcome
    from microvib.studies.bands import judge_bands_of_run

    if output is None:
        targets = [folder / f"report{kind}" for kind in (_KINDS if form.pdf else _KINDS[:1])]
    else:
        targets = [output]
    again = output is None or overwrite
    _check(targets, form, again)
    run = read_run(folder)
    if run.unchecked:
        click.echo(run.unchecked, err=True)
    allowed = _limit(run.limit, limit, band)
    result = RunResult.of_motion(run.motion, run.table, run.second_table)
    peaks = judge_bands_of_run(result, run.band_limits, run.roll_off)
    outcome = with_bands(run_outcome(result, allowed, run.versions), peaks)
    document = report_of(outcome).in_form(form)
    echo(terminal_text(outcome))
    contents = [
        pdf(document) if target.suffix.lower() == ".pdf" else html(document) for target in targets
    ]
    for target, content in zip(targets, contents, strict=True):
        write_file(target, content, overwrite=again)
        echo(f"Written: {target}")


def _check(targets: list[Path], form: Form, again: bool) -> None:
    """OptionError or OutputError where a file's name does not fit, or it is there already, before
    anything is drawn.
    """
    for target in targets:
        kinds = _KINDS[1:] if form.pdf and len(targets) == 1 else _KINDS
        if target.suffix.lower() not in kinds:
            raise OptionError(
                "output", f"{target} is not allowed; its name must end in {' or '.join(kinds)}"
            )
        if target.exists() and not again:
            raise OutputError(
                f"{target}: already exists; nothing was written; choose another file, or allow it"
                " to be replaced",
                remedy="overwrite",
            )


def _limit(kept: Limit | None, limit: str | None, band: str | None) -> Limit | None:
    """Limit and band: those given, and otherwise those of the run."""
    if limit == "none":
        if band is not None:
            raise OptionError(
                "band", "is the band of a limit; it cannot be combined with --limit none"
            )
        return None
    if kept is None:
        return parse_limit(limit, band)
    if limit is None:
        return _rebanded(kept, band)
    asked = parse_limit(limit, None)
    if band is None and asked is not None and asked.is_one_number and kept.is_one_number:
        return asked.in_band_of(kept)
    return parse_limit(limit, band)


def _rebanded(kept: Limit, band: str | None) -> Limit:
    """The limit of a run in a band: one number in any, a curve in its part there."""
    from microvib.signals.limit_curve import Limit
    from microvib.units import Si
    from microvib.units import band as ends

    if band is None or not kept.is_one_number:
        return kept.within(band)
    return Limit(Si(kept.torque), *ends(band))
