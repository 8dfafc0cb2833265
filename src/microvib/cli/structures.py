"""Commands about the structure on the drive: modes of an array, the solar array simulator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from microvib.cli.common import PATH, Target, options, target_options

if TYPE_CHECKING:
    from microvib.structures.deck import ImportOptions


modal_options = options(
    click.option(
        "--units", help="Unit system of the deck: SI, mm-t-s, mm-kg-s, in-lbf-s or ft-lbf-s."
    ),
    click.option(
        "--interface",
        metavar="GRID|X,Y,Z",
        help="Interface point, in the deck's basic frame and length unit.",
    ),
    click.option(
        "--drive-axis",
        metavar="AXIS",
        help="Drive axis: x, y, z, or the components X,Y,Z of a direction.",
    ),
    click.option(
        "--frame",
        metavar="CID",
        help="Coordinate system of the deck whose axes are used [default: basic].",
    ),
    click.option(
        "--damping",
        metavar="RATIO",
        help="Damping of every mode, such as '1 percent' [default: 1 percent].",
    ),
    click.option(
        "--mass",
        metavar="FILE",
        help="Second file: OP4 with the mass matrix, or F06 with the weight generator.",
    ),
    click.option("--wtmass", metavar="FACTOR", help="PARAM,WTMASS of the deck [default: 1]."),
    click.option(
        "--reference",
        metavar="GRID|X,Y,Z",
        help="Reference point of participation factors in OP2 and OP4 [default: 0,0,0].",
    ),
)
"""A command with them gets them as texts or None, for ``import_from``."""


def import_from(source: Path, given: Mapping[str, str | None]) -> ImportOptions | None:
    """Options of an import from those of a command; None if none is given. A ModalError or
    ScenarioError names what is wrong.
    """
    from microvib.io.modal_sources import expect_results
    from microvib.structures.deck import import_options

    data = {key: _value(text) for key, text in given.items() if text is not None}
    if not data:
        return None
    expect_results(str(source))
    if given.get("mass"):
        data["mass"] = str(Path(str(given["mass"])).absolute())  # the user's folder, not the deck's
    return import_options(data, str(source))


def _value(text: str) -> Any:
    """A whole number, three numbers, or the text itself."""
    parts = [part.strip() for part in text.split(",")]
    try:
        if len(parts) == 1:
            return int(text)
        return [float(part) for part in parts]
    except ValueError:
        return text


@click.command()
@click.argument("source")
@click.option(
    "--count", type=click.IntRange(1, 2000), help="Number of modes [default: 10; for a table, all]."
)
@target_options(
    "Folder for table, pictures, report [default: the name].",
    lambda options: f"{Path(options['source']).stem}-modes",
)
@modal_options
def modes(source: str, count: int | None, target: Target, **deck: str | None) -> None:
    """Modes of SOURCE with the interface clamped: `reference-array`, `reference-sas`, a description
    of an array or a simulator, a table of modes, or results of Nastran or Ansys, for which the
    options describe the deck.

    A scenario takes them as `array: {from: modes.csv}`, or directly as `array: {fem:
    reference-array, modes: 10}`.
    """
    from microvib.io.file_access import WORKING_FOLDER
    from microvib.io.modal_sources import modal_source
    from microvib.reports.modes import modes_folder, table_text

    found = modal_source(source, count, WORKING_FOLDER, import_from(Path(source), deck))
    target.deliver(table_text(found), modes_folder, found)


@click.group()
def sas() -> None:
    """The solar array simulator: springs, arm and counterweights that stand in for an array on a
    test bench.
    """


@sas.command("size")
@click.option("--inertia", help="Inertia about the drive axis, e.g. '8.18 kg*m^2'.")
@click.option("--frequency", help="Torsional frequency, e.g. '1.19 Hz'.")
@click.option(
    "--array",
    help="Array to simulate, in place of inertia and frequency: a table of modes, a description, or reference-array.",
)
@click.option(
    "--state",
    "states",
    multiple=True,
    metavar="F:J",
    help="Further state FREQUENCY:INERTIA to reach, e.g. 1.19:15.69.",
)
@click.option(
    "--states",
    "file",
    type=PATH,
    help="Table of further states [default: the catalog's five states].",
)
@click.option("--amplitude", default="2 deg", help="Largest angle between frame and plate.")
@click.option("--rate", default="0.06 deg/s", help="Rate at which the drive starts and stops.")
@click.option("--design", default="reference-sas", help="Simulator to size: a description.")
@target_options("Folder for tables, drawing, report [default: sas].", lambda options: "sas")
def sas_size(target: Target, **options: Any) -> None:
    """Size a simulator for --inertia and --frequency, or for --array, and say how it is set for
    further states.

    The folder's simulator.yaml is a source of modes: `microvib modes sas/simulator.yaml`, or
    `array: {fem: sas/simulator.yaml}`.
    """
    from microvib.io.file_access import WORKING_FOLDER
    from microvib.reports.sas import sizing_outcome
    from microvib.studies.sizing import size_simulator

    target.present(sizing_outcome(size_simulator(**options, files=WORKING_FOLDER)))
