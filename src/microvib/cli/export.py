"""The command that writes scenarios and runs in the formats of other tools."""

from __future__ import annotations

from pathlib import Path

import click

from microvib.cli.common import PATH, load, set_option
from microvib.cli.progress import progress_bar
from microvib.cli.streams import echo
from microvib.errors import OptionError

_LIST = "?"
"""Value of ``--as`` where none is typed."""


@click.command()
@click.argument("source", metavar="SCENARIO|RUN", required=False)
@click.option(
    "--as",
    "target",
    metavar="TARGET",
    is_flag=False,
    flag_value=_LIST,
    help="Format of the file; without a value, or with --list, those that can be had here.",
)
@click.option("--list", "listed", is_flag=True, help="List the formats with their options.")
@set_option
@click.option(
    "--option",
    "given",
    multiple=True,
    metavar="KEY=VALUE",
    help="Option of the format, e.g. contents=[lines]; --list shows them.",
)
@click.option("-o", "--output", type=PATH, help="File to write [default: the source's name].")
@click.option("--overwrite", is_flag=True, help="Replace an existing file.")
@click.option(
    "--pdf", is_flag=True, help="Of a source sheet, write two pages as PDF, too (extra `report`)."
)
@click.option(
    "--check", type=PATH, metavar="FILE", help="Check a source sheet, and say what it has."
)
def export(
    source: str | None,
    target: str | None,
    listed: bool,
    settings: tuple[str, ...],
    given: tuple[str, ...],
    output: Path | None,
    overwrite: bool,
    pdf: bool,
    check: Path | None,
) -> None:
    """Write SCENARIO, or the RUN in a folder, as a file of another tool.

    A scenario is run first where the format needs a run.
    """
    from microvib.export.exporting import (
        check_file_name,
        check_subject,
        options_of,
        typed_options,
        write_subject,
    )
    from microvib.export.subject import Subject, subject_of
    from microvib.export.targets import target_of

    if check is not None:
        _check(check)
        return
    if listed or target == _LIST:
        echo(_listing())
        return
    if target is None:
        raise OptionError("as", "missing; the name of a format is expected, which --list shows")
    if source is None:
        raise OptionError("as", "a scenario or the folder of a run is expected before it", target)
    found = target_of(target)
    if pdf:
        _check_pdf(found.name)
    options = options_of(found, typed_options(given))
    path = check_file_name(found, output or Path(Path(source).stem + found.endings[0]), overwrite)
    if Path(source).is_dir():
        if settings:
            raise OptionError(
                "set", "changes a scenario; it cannot be combined with a run's folder"
            )
        subject = subject_of(source)
    else:
        subject = Subject(load(source, settings))
    check_subject(found, subject)
    with progress_bar(finishing="lines (compiles on first use)") as progress:
        if found.needs == "run":
            subject = subject.as_run(progress)
        write_subject(subject, found, path, options, overwrite=overwrite)
    echo(f"Written: {path}")
    if pdf:
        _write_pages(path, overwrite)


def _check(file: Path) -> None:
    from microvib.export.source_sheet import read_source_sheet

    echo(f"{file}: is whole and agrees with itself\n{read_source_sheet(file)!r}")


def _check_pdf(target: str) -> None:
    """OptionError where the format has no pages; a library that is missing is told before anything is
    computed.
    """
    if target != "source-sheet":
        raise OptionError("pdf", f"a {target} file has no pages; only a source-sheet has")
    import typst  # noqa: F401


def _write_pages(sheet: Path, overwrite: bool) -> None:
    from microvib.export.source_sheet import read_source_sheet
    from microvib.io.writing import write_file
    from microvib.reports.rendering import pdf
    from microvib.reports.source_sheet import source_sheet_document

    out = sheet.with_suffix(".pdf")
    write_file(out, pdf(source_sheet_document(read_source_sheet(sheet))), overwrite=overwrite)
    echo(f"Written: {out}")


def _listing() -> str:
    """Formats: what each gives, of what, its options, and what is missing here."""
    from microvib.export.targets import TARGETS

    lines = []
    for target in TARGETS.values():
        of = {"scenario": "a scenario or a run", "run": "a run"}[target.needs]
        lines.append(f"{target.name} ({', '.join(target.endings)}), of {of}: {target.gives}")
        if target.missing:
            lines.append(f"    not here: {target.missing}")
        lines += [f"    --option {text}" for text in target.option_lines()]
    return "\n".join(lines)
