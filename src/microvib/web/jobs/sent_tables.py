"""Tables that came with a request, as files for as long as they are read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from microvib.errors import MicrovibError
from microvib.io.file_access import FileAccess, sent_files


@contextmanager
def sent_tables(folder: Path, tables: Mapping[str, str], refusal: str) -> Iterator[FileAccess]:
    """Permission to open the ``tables`` of a request, name and text, and no other file, of which
    ``refusal`` is said; errors call them by these names.
    """
    with TemporaryDirectory(dir=folder) as place:
        for name, text in tables.items():
            with open(Path(place) / name, "x", encoding="utf-8") as stream:
                stream.write(text)
        try:
            yield sent_files(Path(place), tables, refusal)
        except MicrovibError as error:
            error.args = (str(error).replace(f"{place}{os.sep}", ""),)
            raise
