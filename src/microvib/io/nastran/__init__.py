"""Modal models from other people's finite elements: Nastran OP2, OP4, F06 and PCH, Ansys listings,
tables of modes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from microvib.io.file_access import FileAccess
from microvib.io.files import as_read_errors, check_file, suppress_output
from microvib.io.modal_table import read_modes
from microvib.io.nastran.craig_bampton import read_dmig, read_op4
from microvib.io.nastran.op2 import read_op2
from microvib.io.nastran.printed import read_listing
from microvib.structures.deck import Deck, ImportOptions, modal_model
from microvib.structures.modal import ModalError, ModalModel

READERS: dict[str, Callable[[Path, ImportOptions], Deck]] = {
    ".op2": read_op2,
    ".op4": read_op4,
    ".pch": read_dmig,
    ".f06": read_listing,
    ".out": read_listing,
    ".txt": read_listing,
}


def read_modal_model(path: Path | str, options: ImportOptions | None = None) -> ModalModel:
    """Fixed-interface modes of a result file, at the interface point, in SI; the kind follows from
    the file's ending.

    ``options`` says how the deck is meant: unit system, interface point, drive axis; a table of
    modes (``.csv``) says all that itself and takes none. Raises ModalError with one sentence for
    what is wrong with the file or the model in it.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return read_modes(path)
    with as_read_errors(path, ModalError):
        reader = READERS.get(path.suffix.lower())
        if reader is None:
            raise ModalError(
                f"'{path.suffix}' is not known; modes are read from .csv, {', '.join(READERS)}"
            )
        check_file(path)
        if not path.stat().st_size:
            raise ModalError("is empty")
        if options is None:
            raise ModalError(
                "does not say its units, interface point and drive axis; give units, interface,"
                " drive_axis"
            )
        if options.mass is not None:
            options = options.model_copy(
                update={"mass": str(FileAccess(path.parent).under("mass").path(options.mass))}
            )
        with suppress_output():
            deck = reader(path, options)
        return modal_model(deck, options, str(path))
