"""The command that writes a file to start from: the example, one with a gear of the catalog, or one
from a data sheet.
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from microvib.cli.common import PATH, options
from microvib.cli.streams import echo
from microvib.errors import OptionError, OutputError
from microvib.io.questions import QUESTIONS

if TYPE_CHECKING:
    from microvib.io.gears import Entry

_HYSTERESIS = (
    "The gear's hysteresis is in the file as a comment, under reducer: a "
    "manufacturer's bound; active, it adds stiffness and damping."
)


def _option(key: str) -> str:
    return f"--{key.replace('_', '-')}"


@click.command()
@click.argument("file", type=PATH)
@click.option(
    "--from-datasheet",
    is_flag=True,
    help="Start from a data sheet: its values from the options below or, without any, asked "
    "for on the terminal. Missing values are assumed.",
)
@options(
    *(
        click.option(_option(key), metavar=asked.metavar, help=f"{asked}.")
        for key, asked in QUESTIONS.items()
    )
)
def new(file: Path, from_datasheet: bool, **given: str | None) -> None:
    """Write FILE, a commented scenario to start from. An existing file is never overwritten. --gear
    also works without --from-datasheet."""
    from microvib.io.new_scenario import gear_assumed, new_text, sheet_text
    from microvib.io.writing import write_file

    if file.exists():
        raise OutputError(f"{file}: already exists; nothing was written")
    sheet = {key: text for key, text in given.items() if text is not None}
    if not from_datasheet:
        stray = next((key for key in sheet if key != "gear"), None)
        if stray is not None:
            raise OptionError(stray, "belongs to a data sheet; it needs --from-datasheet")
        if sheet:
            missing = gear_assumed(sheet["gear"])
        else:
            missing = {}
        write_file(file, new_text(**sheet))
        if sheet:
            _print_assumptions("Assumed for the gear (not in the catalog):", missing)
            echo(_HYSTERESIS)
            echo(
                "Motor, driver, friction (with the gear's), array and tracking are example values."
            )
        echo(f"Written: {file}. Edit it, then: microvib run {shlex.quote(str(file))}")
        return
    if sheet:
        text, missing = sheet_text(sheet)
    else:
        text, missing = _questionnaire()
    write_file(file, text)
    _print_assumptions(
        "Assumed (not in the data sheet):"
        if missing
        else "No value of the drive had to be assumed.",
        missing,
    )
    if "# hysteresis: {loss" in text:
        echo(_HYSTERESIS)
    echo(
        f"Friction, array and tracking are example values. Written: {file}. Now: microvib run"
        f" {shlex.quote(str(file))}"
    )


def _print_assumptions(head: str, assumed: dict[str, Entry]) -> None:
    """Say what is assumed, and why."""
    echo(head)
    for key, entry in assumed.items():
        echo(f"  {key}: {entry.text} ({entry.source.removeprefix('assumed: ')})")


def _questionnaire() -> tuple[str, dict[str, Entry]]:
    """Text of ``sheet_text`` from the answers of a person at the terminal; OptionError where there
    is none.

    Answers that contradict each other are asked for again, and the others kept.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        known = ", ".join(map(_option, QUESTIONS))
        raise OptionError(
            "from_datasheet", f"no terminal to ask questions on; give at least one of {known}"
        )
    from microvib.io.new_scenario import sheet_text

    echo(
        "Enter the data sheet's values; leave empty those that it does not state, and a typical value is assumed."
    )
    answers: dict[str, str] = {}
    for key in QUESTIONS:
        _ask(key, answers)
    while True:
        try:
            return sheet_text(answers)
        except OptionError as error:
            if error.key not in QUESTIONS:
                raise
            echo(
                f"{QUESTIONS[error.key].words}: {str(error).removeprefix(f'{error.key}: ')}",
                err=True,
            )
            _ask(error.key, answers)


def _ask(key: str, answers: dict[str, str]) -> None:
    """Ask one question until its answer can be read."""
    from microvib.io.data_sheet import read_entry

    answers.pop(key, None)
    while text := click.prompt(str(QUESTIONS[key]), default="", show_default=False).strip():
        try:
            read_entry(key, text)
        except OptionError as error:
            echo(str(error).removeprefix(f"{key}: "), err=True)
        else:
            answers[key] = text
            return
