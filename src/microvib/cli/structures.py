"""Commands about the structure on the drive: modes of an array, the solar array simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from microvib.cli.common import deliver, overwrite_option, report_options
from microvib.cli.modal_options import import_from, modal_options
from microvib.reports.document import Form


@click.command()
@click.argument("source")
@click.option("--count", type=click.IntRange(1, 2000), help="How many modes [default: 10; of a table, all].")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for table, pictures, report [default: the name].")
@overwrite_option
@report_options
@modal_options
def modes(source: str, count: int | None, out: Path | None, overwrite: bool, form: Form, **deck: str | None) -> None:
    """Modes of SOURCE as in the paper's Table 1: `reference-array`, `reference-sas`, a description of an array or a simulator,
    a table of modes, or results of Nastran or Ansys, for which the options say how the deck is meant.

    A scenario takes them as `array: {from: modes.csv}`, or directly as `array: {fem: reference-array, modes: 10}`.
    """
    from microvib.io.modal_sources import modal_source
    from microvib.io.results import check_folder, free_folder
    from microvib.reports.modes import table_text, write_modes

    out = out or free_folder(f"{Path(source).stem}-modes")
    check_folder(out, overwrite)
    found = modal_source(source, count, options=import_from(Path(source), deck))
    deliver(table_text(found), out, lambda folder: write_modes(folder, found, overwrite, form))


@click.group()
def sas() -> None:
    """The solar array simulator: springs, arm and counterweights that stand for an array."""


@sas.command("size")
@click.option("--inertia", help="Inertia about the drive axis, e.g. '8.18 kg*m^2'.")
@click.option("--frequency", help="Torsional frequency, e.g. '1.19 Hz'.")
@click.option("--array", help="Stand for this array instead: a table of modes, a description, or reference-array.")
@click.option("--state", "states", multiple=True, metavar="F:J", help="A further state to reach, e.g. 1.19:15.69.")
@click.option("--states", "file", type=click.Path(path_type=Path), help="Table of them [default: the paper's Table 2].")
@click.option("--amplitude", default="2 deg", show_default=True, help="Largest angle between frame and plate.")
@click.option("--rate", default="0.06 deg/s", show_default=True, help="Rate at which the drive starts and stops.")
@click.option("--design", default="reference-sas", show_default=True, help="Simulator to set: a description.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for tables, drawing, report [default: sas].")
@overwrite_option
@report_options
def sas_size(out: Path | None, overwrite: bool, form: Form, **options: Any) -> None:
    """Size a simulator for --inertia and --frequency, or for --array, and say how it is set for further states.

    The folder's simulator.yaml is a source of modes: `microvib modes sas/simulator.yaml`, or `array: {fem: sas/simulator.yaml}`.
    """
    from microvib.io.results import check_folder, free_folder
    from microvib.reports.sas import sizing_text, write_sizing
    from microvib.studies.sizing import sized

    out = out or free_folder("sas")
    check_folder(out, overwrite)
    result = sized(**options)
    deliver(sizing_text(result), out, lambda folder: write_sizing(folder, result, overwrite, form))
