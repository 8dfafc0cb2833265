"""The report of a run, made again from its folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from microvib.app.commands.common import band_option, limit_option, pdf_option
from microvib.app.reports.document import Form
from microvib.errors import OutputError

if TYPE_CHECKING:
    from microvib.studies.margins import Limit

_KINDS = (".html", ".pdf")


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@limit_option
@band_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="File to write, .html or .pdf [default: report.* of the folder].",
)
@pdf_option
@click.option("--overwrite", is_flag=True, help="Replace the file that --output names.")
def report(folder: Path, limit: str | None, band: str | None, output: Path | None, overwrite: bool, form: Form) -> None:
    """Make the report of a run again from its FOLDER, as HTML or PDF, with margins against a limit if one is given."""
    from microvib.app.options import limit_of
    from microvib.io.results import write_file

    allowed = limit_of(limit, band)
    target = output or folder / ("report.pdf" if form.pdf else "report.html")
    _check(target, form, again=output is None or overwrite)
    write_file(target, _content(folder, target, allowed, form), overwrite=output is None or overwrite)
    click.echo(f"Written: {target}")


def _check(target: Path, form: Form, again: bool) -> None:
    """OutputError where the file's name does not fit, or it is there already, before anything is drawn."""
    kinds = _KINDS[1:] if form.pdf else _KINDS
    if target.suffix.lower() not in kinds:
        raise OutputError(f"--output: {target} is not allowed; its name must end in {' or '.join(kinds)}")
    if target.exists() and not again:
        raise OutputError(f"{target}: exists already; nothing was written; choose another file, or add --overwrite")


def _content(folder: Path, target: Path, limit: Limit | None, form: Form) -> str | bytes:
    from microvib.app.reports.rendering import html, pdf
    from microvib.app.reports.run import run_report
    from microvib.io.runs import read_run

    run = read_run(folder)
    document = run_report(run.motion, run.table, limit=limit, versions=run.versions, form=replace(form, command=""))
    return pdf(document) if target.suffix.lower() == ".pdf" else html(document)
