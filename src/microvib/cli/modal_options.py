"""Options of commands that read a modal model from other people's finite elements."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from microvib.cli.common import options

if TYPE_CHECKING:
    from microvib.structures.deck import Import

modal_options = options(
    click.option("--units", help="Unit system of the deck: SI, mm-t-s, mm-kg-s, in-lbf-s or ft-lbf-s."),
    click.option(
        "--interface", metavar="GRID|X,Y,Z", help="Interface point, in the deck's basic frame and length unit."
    ),
    click.option("--drive-axis", metavar="AXIS", help="Drive axis: x, y, z, or the components X,Y,Z of a direction."),
    click.option("--frame", metavar="CID", help="Coordinate system of the deck whose axes are used [default: basic]."),
    click.option("--damping", metavar="RATIO", help="Damping of every mode, such as '1 percent' [default: 1 percent]."),
    click.option(
        "--mass", metavar="FILE", help="Second file: OP4 with the mass matrix, or F06 with the weight generator."
    ),
    click.option("--wtmass", metavar="FACTOR", help="PARAM,WTMASS of the deck [default: 1]."),
    click.option(
        "--reference", metavar="GRID|X,Y,Z", help="Point of participation factors in OP2 and OP4 [default: 0,0,0]."
    ),
)
"""A command with them gets them as texts or None, for ``import_from``."""


def import_from(source: Path, given: Mapping[str, str | None], modes: int | None = None) -> Import | None:
    """Options of an import from those of a command; None if none is given. ModalError names what is wrong."""
    from microvib.structures.deck import import_options

    data = {key: _value(text) for key, text in given.items() if text is not None}
    if not data:
        return None
    if given.get("mass"):
        data["mass"] = str(Path(str(given["mass"])).absolute())  # the user's folder, not the deck's
    return import_options(data if modes is None else {**data, "modes": modes}, str(source))


def _value(text: str) -> Any:
    """A whole number, three numbers, or the text itself."""
    parts = [part.strip() for part in text.split(",")]
    try:
        return int(text) if len(parts) == 1 else [float(part) for part in parts]
    except ValueError:
        return text
