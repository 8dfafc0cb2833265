"""Door for other people's finite elements: modal models from Nastran OP2, OP4, F06 and PCH, Ansys listings, tables of modes."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

from microvib.io.modal_table import read_modes
from microvib.io.nastran.craig_bampton import read_dmig, read_op4
from microvib.io.nastran.op2 import read_op2
from microvib.io.nastran.printed import read_listing
from microvib.structures.deck import Deck, Import, modal_model
from microvib.structures.modal import ModalError, ModalModel

LARGEST = 8_000_000_000
"""Bytes of the largest file that is opened."""

READERS: dict[str, Callable[[Path, Import], Deck]] = {
    ".op2": read_op2,
    ".op4": read_op4,
    ".pch": read_dmig,
    ".f06": read_listing,
    ".out": read_listing,
    ".txt": read_listing,
}


def read_modal_model(path: Path | str, options: Import | None = None) -> ModalModel:
    """Fixed-interface modes of a result file, at the interface point, in SI; the kind follows from the file's ending.

    ``options`` says how the deck is meant: unit system, interface point, drive axis; a table of modes (``.csv``) says all that
    itself and takes none. Raises ModalError with one sentence for what is wrong with the file or the model in it.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return read_modes(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ModalError(f"{path}: '{path.suffix}' is not known; modes are read from .csv, {', '.join(READERS)}")
    _check_file(path)
    if options is None:
        raise ModalError(
            f"{path}: does not say its units, interface point and drive axis; give units, interface, drive_axis"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            deck = reader(path, options)
        except (ModalError, KeyboardInterrupt):
            raise
        except MemoryError:
            raise ModalError(f"{path}: asks for more memory than there is; it is too large, or broken") from None
        except Exception as error:  # the libraries raise whatever they meet in a broken file
            raise ModalError(
                f"{path}: is broken or truncated, or not of its kind ({type(error).__name__}: {str(error)[:100]})"
            ) from None
    return modal_model(deck, options)


def _check_file(path: Path) -> None:
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            stream.read(1)
    except OSError as error:
        raise ModalError(f"{path}: cannot be read: {error.strerror}") from None
    if not size:
        raise ModalError(f"{path}: is empty")
    if size > LARGEST:
        raise ModalError(f"{path}: has {size / 1e9:.1f} GB; files of at most {LARGEST / 1e9:g} GB are read")
