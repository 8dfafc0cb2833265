"""Campaigns: many runs of one scenario, on this machine or on others."""

from __future__ import annotations

import shlex
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from microvib.cli.common import PATH, Target, options, print_scenario_warnings, report_options
from microvib.cli.progress import progress_bar
from microvib.cli.streams import INTERRUPTED, echo
from microvib.errors import MicrovibError, OptionError
from microvib.text_tables import counted

if TYPE_CHECKING:
    from microvib.reports.document import Form
    from microvib.signals.limit_curve import LimitCurve
    from microvib.studies.campaign.folder import Campaign
    from microvib.studies.campaign.study_file import Study

_STATUS_INTERVAL = 15.0  # seconds between two lines of progress where there is no terminal

folder_argument = click.argument("folder", metavar="DIR", type=PATH)


@click.group()
def campaign() -> None:
    """Run one scenario many times: a study file declares what varies, DIR holds all results, and
    computed cases survive an interruption.

    create STUDY DIR, then run DIR; after an interruption, resume DIR; report DIR at any time.
    """


@campaign.command()
@click.argument("study", type=PATH)
@folder_argument
@click.option(
    "--chunk", type=click.IntRange(1, 100_000), help="Cases computed and written together."
)
def create(study: Path, folder: Path, chunk: int | None) -> None:
    """Draw the cases of STUDY (a YAML file) and write them to the new folder DIR."""
    from microvib.studies.campaign import folder as campaigns
    from microvib.studies.campaign.design import read_design

    design = read_design(study)
    print_scenario_warnings(design.base, str(study))
    made = campaigns.create(design, folder, chunk)
    chunks = counted(made.chunks, "chunk")
    echo(f"{counted(design.cases, 'case')} in {chunks} of up to {made.chunk_size}.")
    for levels in design.levels:
        echo(
            f"  {levels.key}: {len(levels.values)} levels, {levels.labels[0]} to"
            f" {levels.labels[-1]}"
        )
    for uncertain in design.uncertain:
        echo(f"  {uncertain.key}: {uncertain.text}")
    echo(f"Written: {folder}. Now: microvib campaign run {shlex.quote(str(folder))}")


def _opened(folder: Path) -> Campaign:
    """The campaign of a folder; a repaired manifest is reported."""
    from microvib.studies.campaign.folder import open_campaign

    opened = open_campaign(folder)
    if opened.repair_note:
        echo(opened.repair_note, err=True)
    return opened


_run_options = options(
    click.option("--on", type=click.Choice(["local", "dask", "slurm"]), default="local", help="Where the cases are computed."),
    click.option("--workers", type=click.IntRange(1, 4096), help="Processes, or on Slurm jobs [default: all cores; 8 jobs]."),
    click.option("--scheduler", metavar="ADDRESS", help="A running Dask scheduler, such as tcp://host:8786."),
    click.option("--shard", metavar="K/N", help="Compute only every N-th chunk, from the K-th (0 to N-1) on."),
    click.option("--todo", type=PATH, hidden=True, help="Chunks that the shards share."),
    click.option("--sbatch", "directives", multiple=True, metavar="OPTION", help="For Slurm, e.g. '--time=02:00:00'."),
    click.option("--no-submit", is_flag=True, help="On Slurm, write the job script only."),
)  # fmt: skip


@campaign.command()
@folder_argument
@_run_options
def run(folder: Path, **options: Any) -> None:
    """Compute the missing cases of DIR. It may be stopped at any time; `resume` continues."""
    _compute(folder, **options)


@campaign.command()
@folder_argument
@_run_options
def resume(folder: Path, **options: Any) -> None:
    """Continue with DIR after any interruption: the same as `run`."""
    _compute(folder, **options)


def _compute(
    folder: Path, on: str, workers: int | None, scheduler: str | None, shard: str | None, todo: Path | None,
    directives: tuple[str, ...], no_submit: bool,
) -> None:  # fmt: skip
    opened = _opened(folder)
    part = _shard(shard)
    listed = None if todo is None else _cases_in(todo)
    _check_backend_options(on, scheduler, directives, no_submit)
    if on == "slurm":
        from microvib.studies.campaign.slurm import submit

        echo(submit(opened, workers or 8, directives, only_write=no_submit))
        return
    from microvib.studies.campaign.run import compute_missing

    try:
        with (
            _backend(on, workers, scheduler) as backend,
            progress_bar("computing", "cases", lines_every=_STATUS_INTERVAL) as progress,
        ):
            compute_missing(opened, backend, shard=part, todo=listed, progress=progress)
    except KeyboardInterrupt:
        echo(
            "Interrupted; computed cases are kept. Continue with: microvib campaign resume"
            f" {shlex.quote(str(folder))}",
            err=True,
        )
        sys.exit(INTERRUPTED)
    echo(_state_text(opened))
    if not opened.missing():
        echo(f"Now: microvib campaign report {shlex.quote(str(folder))}")


def _cases_in(todo: Path) -> list[int]:
    """Numbers of the cases that a file lists."""
    return [int(word) for word in todo.read_text(encoding="utf-8").split()]


def _check_backend_options(
    on: str, scheduler: str | None, directives: tuple[str, ...], no_submit: bool
) -> None:
    """OptionError where an option of another backend than ``on`` is given."""
    if scheduler is not None and on != "dask":
        raise OptionError("scheduler", "works only with --on dask", scheduler)
    if directives and on != "slurm":
        raise OptionError("sbatch", "works only with --on slurm")
    if no_submit and on != "slurm":
        raise OptionError("no_submit", "works only with --on slurm")


def _backend(on: str, workers: int | None, scheduler: str | None) -> AbstractContextManager[Any]:
    if on == "dask":
        from microvib.studies.campaign.on_dask import dask

        return dask(workers, scheduler)
    from microvib.studies.workers import local

    return local(workers)


def _shard(text: str | None) -> tuple[int, int]:
    if text is None:
        return 0, 1
    first, slash, last = text.partition("/")
    if slash and first.isdigit() and last.isdigit() and int(first) < int(last):
        return int(first), int(last)
    raise OptionError(
        "shard", f"{text!r} is not allowed; write K/N with K from 0 to N-1, such as 0/8"
    )


@campaign.command()
@folder_argument
def status(folder: Path) -> None:
    """Show what is computed in DIR, what failed and why."""
    echo(_state_text(_opened(folder), reasons=True))


def _state_text(opened: Campaign, reasons: bool = False) -> str:
    from microvib.reports.campaign.text import state_text

    return state_text(opened, reasons)


@campaign.command()
@folder_argument
def merge(folder: Path) -> None:
    """Write DIR/results.nc: all results so far as one labelled data set."""
    from microvib.studies.campaign.results import merge as merge_chunks

    merged = merge_chunks(_opened(folder))
    echo(
        f"{merged.done} of {merged.cases} cases done, {merged.failed} failed, {len(merged.lines)}"
        " lines."
    )
    echo(f"Written: {merged.path}")


@campaign.command()
@folder_argument
@click.option(
    "--limit",
    metavar="TORQUE|FILE",
    help="Largest line allowed, or a CSV file of a curve over frequency [default: the study's].",
)
@click.option(
    "--band", metavar="LOW:HIGH", help="Consider only lines in this band [default: the study's]."
)
@report_options
def report(folder: Path, limit: str | None, band: str | None, form: Form) -> None:
    """Merge the results so far, then write statistics, worst cases, pictures and report into
    DIR/report.
    """
    from microvib.reports.campaign.report import campaign_outcome, summarise
    from microvib.studies.campaign.results import merge as merge_chunks
    from microvib.studies.campaign.results import open_results
    from microvib.units import band as ends

    opened = _opened(folder)
    study = opened.design.study
    text = band or study.band
    within = ends(text) if text else (0.0, float("inf"))
    most = _report_limit(opened.design.study, limit, within)
    merge_chunks(opened)
    summary = summarise(open_results(opened), most, within)
    Target(folder / "report", True, form).present(campaign_outcome(summary))
    if (worst := summary.worst_case) is not None:
        again = f"microvib campaign case {shlex.quote(str(folder))} {worst} --out worst.yaml"
        echo(f"To recompute the worst case: {again}")


def _report_limit(
    study: Study, limit: str | None, within: tuple[float, float]
) -> float | LimitCurve | None:
    """The limit that a report judges by, one amplitude [N m] or a curve: the one given, or else the
    study's.
    """
    from microvib.io.limit_files import given_limit
    from microvib.reports.campaign.report import allowed_by
    from microvib.studies.campaign.design import limit_of

    return allowed_by(limit_of(study) if limit is None else given_limit(limit), within)


@campaign.command()
@folder_argument
@click.argument("number", type=click.IntRange(0))
@click.option("-o", "--out", type=PATH, help="Write the case's scenario to this file.")
def case(folder: Path, number: int, out: Path | None) -> None:
    """Compute case NUMBER of DIR again, alone, and compare with the stored result."""
    from microvib.reports.campaign.text import recomputed_case_text

    opened = _opened(folder)
    if number >= opened.design.cases:
        raise MicrovibError(
            f"{folder}: has no case {number}; there are 0 to {opened.design.cases - 1}"
        )
    if out is not None:
        from microvib.reports.campaign.text import write_case

        write_case(opened, number, out)
    echo(recomputed_case_text(opened, number))
    if out is not None:
        echo(f"Written: {out}. Whole motion and report: microvib run {shlex.quote(str(out))}")
