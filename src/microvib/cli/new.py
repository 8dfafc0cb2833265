"""The command that writes a file to start from: the example, one with a gear of the catalog, or one from a data sheet."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from microvib.cli.common import PATH, options
from microvib.cli.streams import echo
from microvib.errors import OptionError, OutputError

_SHEET = {
    "holding_torque": ("TORQUE", "Holding torque of the motor, e.g. '0.5 N*m'."),
    "phases": ("2|3|5", "Phases of the motor [usual: 2]."),
    "phases_on": ("1|2|...", "Phases on at the holding torque [usual: 2 of two phases]."),
    "current": ("CURRENT", "Current per phase at the holding torque, e.g. '0.6 A'."),
    "detent": ("PART", "Detent torque over holding torque, e.g. '5 percent'."),
    "step_angle": ("ANGLE", "Full step at the output, e.g. '0.018 deg'."),
    "ratio": ("NUMBER", "Reduction ratio, e.g. 100."),
    "resistance": ("RESISTANCE", "Resistance of one winding, e.g. '6 ohm'."),
    "inductance": ("INDUCTANCE", "Inductance of one winding, e.g. '13 mH'."),
    "rotor_inertia": ("INERTIA", "Moment of inertia of the rotor, e.g. '0.2 kg*cm^2'."),
    "drive": ("current|voltage", "What the driver commands; voltage is without a current loop."),
    "microsteps": ("NUMBER", "Microsteps per full step, e.g. 16."),
    "gear": ("GEAR", "A harmonic gear of the catalog, e.g. 'size 14 ratio 100'; also without --from-datasheet."),
}
"""What a data sheet may say, in the order in which it is asked for: how it is written in the help, and what it is."""


_HYSTERESIS = (
    "The gear's hysteresis stands in the file as a comment, under reducer: a maker's bound, which stiffens and damps."
)


@click.command()
@click.argument("file", type=PATH)
@click.option(
    "--from-datasheet",
    is_flag=True,
    help="From a data sheet: by the options below or, without any, by questions on the terminal. What is missing is assumed.",
)
@options(*(click.option(f"--{key.replace('_', '-')}", metavar=m, help=text) for key, (m, text) in _SHEET.items()))
def new(file: Path, from_datasheet: bool, **given: str | None) -> None:
    """Write FILE, a commented scenario to start from. Never overwrites."""
    from microvib.io.new_scenario import new_text, sheet_text
    from microvib.io.writing import write_file

    if file.exists():
        raise OutputError(f"{file}: already exists; nothing was written")
    sheet = {key: text for key, text in given.items() if text is not None}
    if not from_datasheet:
        stray = next((key for key in sheet if key != "gear"), None)
        if stray is not None:
            raise OptionError(stray, "is of a data sheet; it goes with --from-datasheet")
        write_file(file, new_text(**sheet))
        echo(f"Written: {file}. Edit it, then: microvib run {file}")
        if sheet:
            echo(_HYSTERESIS)
        return
    sheet = sheet or _asked()
    text, missing = sheet_text(sheet)
    write_file(file, text)
    echo("Assumed, as the data sheet does not say it:" if missing else "Nothing of the drive had to be assumed.")
    for key, entry in missing.items():
        echo(f"  {key}: {entry.text} ({entry.source.removeprefix('assumed: ')})")
    echo(f"Friction, array and tracking are examples. Written: {file}. Now: microvib run {file}")


def _asked() -> dict[str, str]:
    """Answers of a person at the terminal; OptionError where there is none."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        known = ", ".join(f"--{key.replace('_', '-')}" for key in _SHEET)
        raise OptionError("from_datasheet", f"there is no terminal to ask on; give at least one of {known}")
    from microvib.io.data_sheet import read_entry

    echo("What does the data sheet say? Empty where it does not; a typical value is then assumed.")
    answers: dict[str, str] = {}
    for key, (_, said) in _SHEET.items():
        question = said.partition("; also")[0].rstrip(".")
        while text := click.prompt(question, default="", show_default=False).strip():
            try:
                read_entry(key, text)
            except OptionError as error:
                echo(str(error).removeprefix(f"{key}: "), err=True)
            else:
                answers[key] = text
                break
    return answers
