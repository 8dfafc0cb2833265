"""The one door to files that are named in a scenario, a study, or any other file of a user.

Whoever reads such data is given a ``FileAccess`` and gets paths from it alone. A request of the
page has ``NO_FILES``: whichever key of its data names a file, nothing is opened. Where tables come
with a request, ``sent_files`` are the only ones that it may name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from microvib.errors import OptionError, ScenarioError, quoted_value


@dataclass(frozen=True)
class FileAccess:
    """Permission to open the files that are named in data."""

    folder: Path | None = None
    """Folder to which names are relative; None where no file may be opened."""
    refusal: str = "no files are opened here"
    """Reason given where no file may be opened."""
    key: str = ""
    """Key that names the file, for messages."""
    only: frozenset[str] | None = None
    """Names that may be opened, of files in the folder itself; None for all."""

    @property
    def takes_names(self) -> bool:
        """Whether a user may name any file, and not only what came with a request."""
        return self.folder is not None and self.only is None

    def under(self, key: str) -> FileAccess:
        """Permission for files named at a ``key``."""
        return replace(self, key=key)

    def path(self, name: Any, allowed: Sequence[str] = ()) -> Path:
        """Path of the file called ``name``.

        Parameters
        ----------
        name : Any
            Value that stands in the data.
        allowed : sequence of str
            Names of the catalog that the key takes as well, for the message.

        Returns
        -------
        Path
            Relative to the folder; the file need not exist.

        Raises
        ------
        ScenarioError
            Where files may not be opened, or ``name`` is no file name.
        """
        where = f"{self.key}: " if self.key else ""
        if not isinstance(name, str) or not name or "\0" in name:
            raise ScenarioError(
                f"{where}{quoted_value(name)} is not allowed; the name of a file is expected"
            )
        if self.folder is None:
            if allowed:
                choice = f", or take {', '.join(allowed)}"
            else:
                choice = ""
            raise ScenarioError(
                f"{where}{quoted_value(name)} names a file, and {self.refusal}; write its contents into the scenario{choice}"
            )
        if self.only is not None and name not in self.only:
            raise ScenarioError(f"{where}{quoted_value(name)} names a file, and {self.refusal}")
        return self.folder / name

    def in_folder_of(self, name: Any) -> FileAccess:
        """Permission for what the file called ``name`` names in turn, relative to that file's
        folder.
        """
        return replace(self, folder=self.path(name).parent)

    def in_working_folder(self) -> FileAccess:
        """Permission for names that are typed rather than written in a file, relative to the
        working folder.
        """
        if self.folder is None or self.only is not None:
            return self
        return replace(self, folder=Path())


def sent_files(folder: Path, names: Iterable[str], refusal: str) -> FileAccess:
    """Permission to open the files of a ``folder`` that came with a request, by the ``names`` that
    their owner gave them; ``refusal`` is said of any other. OptionError about ``tables`` where one is
    more than a name, and could lead out of the folder.
    """
    kept = frozenset(names)
    for name in kept:
        if not _PLAIN.fullmatch(name):
            raise OptionError(
                "tables",
                f"{quoted_value(name)} is not allowed; the name of a table such as harmonics.csv is"
                " expected",
            )
    return FileAccess(folder, refusal, only=kept)


_PLAIN = re.compile(r"[\w(][\w .()+-]{0,98}")
"""A name of a file that leads nowhere else: no separator, no drive, no point at its beginning."""
NO_FILES = FileAccess()
"""Permission to open none: the default of everything that reads data."""
WORKING_FOLDER = FileAccess(Path())
"""Permission for names that a user types on a command line or in a script."""
