"""The report of a run, made again from its folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from microvib.cli.common import PATH, limit_options, report_options
from microvib.errors import OptionError, OutputError

if TYPE_CHECKING:
    from microvib.analysis.limits import Limit
    from microvib.reports.document import Document, Form

_KINDS = (".html", ".pdf")


@click.command()
@click.argument("folder", type=PATH)
@limit_options
@click.option(
    "-o",
    "--output",
    type=PATH,
    help="The one file to write, .html or .pdf [default: report.html of the folder, with --pdf report.pdf too].",
)
@report_options
@click.option("--overwrite", is_flag=True, help="Replace an existing --output file.")
def report(folder: Path, limit: str | None, band: str | None, output: Path | None, overwrite: bool, form: Form) -> None:
    """Make the report of a run again from its FOLDER, with the run's limit and band, or with others.

    report.html of the folder is replaced, with --pdf report.pdf too. --limit none leaves the limit out.
    """
    from microvib.io.writing import write_file
    from microvib.reports.rendering import html, pdf

    targets = _targets(folder, output, form)
    again = output is None or overwrite
    _check(targets, form, again)
    document = _document(folder, limit, band, form)
    contents = [pdf(document) if target.suffix.lower() == ".pdf" else html(document) for target in targets]
    for target, content in zip(targets, contents, strict=True):
        write_file(target, content, overwrite=again)
        click.echo(f"Written: {target}")


def _targets(folder: Path, output: Path | None, form: Form) -> list[Path]:
    """The file that is named, or those of the folder: HTML, and PDF beside it where that is asked for."""
    if output is not None:
        return [output]
    return [folder / f"report{kind}" for kind in (_KINDS if form.pdf else _KINDS[:1])]


def _check(targets: list[Path], form: Form, again: bool) -> None:
    """OptionError or OutputError where a file's name does not fit, or it is there already, before anything is drawn."""
    for target in targets:
        kinds = _KINDS[1:] if form.pdf and len(targets) == 1 else _KINDS
        if target.suffix.lower() not in kinds:
            raise OptionError("output", f"{target} is not allowed; its name must end in {' or '.join(kinds)}")
        if target.exists() and not again:
            raise OutputError(
                f"{target}: already exists; nothing was written; choose another file, or allow it to be replaced",
                remedy="overwrite",
            )


def _document(folder: Path, limit: str | None, band: str | None, form: Form) -> Document:
    from microvib.io.runs import read_run
    from microvib.reports.run.report import run_report

    run = read_run(folder)
    allowed = _limit(run.limit, limit, band)
    return run_report(run.motion, run.table, limit=allowed, versions=run.versions, form=form)


def _limit(kept: tuple[float, float, float] | None, limit: str | None, band: str | None) -> Limit | None:
    """What lines are judged by: what is asked for, and for the rest what the run was judged by."""
    from microvib.analysis.limits import Limit
    from microvib.units import Si
    from microvib.units import band as ends

    if limit == "none":
        if band is not None:
            raise OptionError("band", "says where a limit applies; it cannot be combined with --limit none")
        return None
    asked = Limit.of(limit, None if kept else band)
    if kept is None:
        return asked
    return Limit(Si(asked.torque if asked else kept[0]), *(map(Si, kept[1:]) if band is None else ends(band)))
