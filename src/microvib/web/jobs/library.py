"""Results and recordings that outlast the server: a folder for each, called by its id, whole or not
at all.

The folder of a library is its owner's alone. What it holds beside plain data, a run's pickle, is
read only where its seal says that this user's microvib of this version wrote it.
"""

from __future__ import annotations

import contextlib
import hmac
import json
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from microvib import __version__
from microvib.errors import MicrovibError
from microvib.io.user_folders import data_folder, is_own, seal_key

ID = re.compile(r"[0-9a-f]{16}")
_MARK = "microvib-library"
_MARKED = "Results and recordings of the page of microvib (microvib serve).\n"
_ENTRY = "entry.json"
_SEALED = "run.pickle"
_LONGEST = 4_000_000
"""Bytes of an entry's description, in which a scenario's text may stand."""
ATTRIBUTES = 20
TRASH = 20
"""Removed entries that can be brought back, until the server ends."""

Short = Annotated[str, Field(max_length=200)]


class Entry(BaseModel):
    """Name of a result or a recording, and the request that it answers."""

    id: str = Field(pattern=r"^[0-9a-f]{16}$")
    kind: Short
    title: Short
    created: str = Field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    version: Short = __version__
    kept: bool = False
    """Whether it stays when others make room."""
    attributes: dict[Short, Short] = Field(default_factory=dict, max_length=ATTRIBUTES)
    asked: dict[str, Any] = Field(default_factory=dict)
    """The request that it is the answer to."""
    facts: dict[str, Any] = Field(default_factory=dict)
    """Contents of a recording."""
    seal: Short = ""


class InUse(MicrovibError):
    """Another server has this library."""


class Library:
    """The entries of one folder, which one server has at a time."""

    def __init__(self, root: Path, key: bytes, lock: int) -> None:
        self.root = root
        self._key, self._lock = key, lock
        self._entries = {entry.id: entry for entry in _entries(root / "entries")}

    def entries(self) -> list[Entry]:
        """All entries, the oldest first."""
        return sorted(self._entries.values(), key=lambda entry: entry.created)

    def get(self, id: str) -> Entry | None:
        """An entry by its id."""
        return self._entries.get(id)

    def folder(self, id: str) -> Path:
        """Folder of an entry; ValueError for what is no id."""
        if not ID.fullmatch(id):
            raise ValueError(id)
        return self.root / "entries" / id

    def size(self, id: str) -> int:
        """Bytes of an entry's files."""
        return sum(file.stat().st_size for file in self.folder(id).rglob("*") if file.is_file())

    def take(self, folder: Path, entry: Entry) -> Path:
        """Move a folder of the same disk in, whole, and describe it; OSError where it cannot be."""
        sealed = folder / _SEALED
        if sealed.is_file():
            entry = entry.model_copy(update={"seal": self._seal(sealed)})
        _write(folder, entry)
        place = self.folder(entry.id)
        os.rename(folder, place)
        self._entries[entry.id] = entry
        return place

    def edit(self, id: str, changes: dict[str, Any]) -> Entry:
        """Change title, attributes or whether an entry is kept."""
        entry = Entry.model_validate(self._entries[id].model_dump() | changes)
        _write(self.folder(id), entry)
        self._entries[id] = entry
        return entry

    def remove(self, id: str) -> None:
        """Take an entry out, so that it can be brought back for a while."""
        place = self._removed(id)
        shutil.rmtree(place, ignore_errors=True)
        os.rename(self.folder(id), place)
        del self._entries[id]
        removed = sorted(place.parent.iterdir(), key=lambda path: path.stat().st_ctime)
        for old in removed[:-TRASH]:
            shutil.rmtree(old, ignore_errors=True)

    def bring_back(self, id: str) -> Entry | None:
        """An entry that was taken out; None where it is gone."""
        place = self._removed(id)
        entry = _entry(place)
        if entry is None:
            return None
        os.rename(place, self.folder(id))
        self._entries[id] = entry
        return entry

    def forget(self, id: str) -> None:
        """Delete an entry for good."""
        self._entries.pop(id, None)
        shutil.rmtree(self.folder(id), ignore_errors=True)

    def trusts(self, id: str) -> bool:
        """Whether this user's microvib of this version wrote the pickle of an entry."""
        entry, file = self._entries.get(id), self.folder(id) / _SEALED
        if entry is None or entry.version != __version__ or not is_own(file):
            return False
        return hmac.compare_digest(entry.seal, self._seal(file))

    def close(self) -> None:
        """Let other servers have it; what was removed is deleted."""
        shutil.rmtree(self.root / "removed", ignore_errors=True)
        with contextlib.suppress(OSError):
            os.close(self._lock)

    def _removed(self, id: str) -> Path:
        folder = self.root / "removed"
        folder.mkdir(mode=0o700, exist_ok=True)
        return folder / self.folder(id).name

    def _seal(self, file: Path) -> str:
        return hmac.new(self._key, file.read_bytes(), "sha256").hexdigest()


def usual_folder() -> Path:
    """Folder of the library where none is named."""
    return data_folder() / "library"


@contextmanager
def opened_library(root: Path) -> Iterator[Library]:
    """The library of a folder, which is made where it is not there.

    MicrovibError where the folder is another user's, or holds something else; InUse where another
    server has it.
    """
    try:
        _prepare(root)
        lock = _locked(root)
        shutil.rmtree(root / "removed", ignore_errors=True)
        library = Library(root, seal_key(), lock)
    except OSError as error:
        raise MicrovibError(f"{root}: cannot be used as a library: {error.strerror}") from None
    try:
        yield library
    finally:
        library.close()


def _prepare(root: Path) -> None:
    root.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not is_own(root):
        raise MicrovibError(
            f"{root}: is another user's, a link, or others may write to it; a library needs a folder"
            " of your own (chmod go-w)"
        )
    mark = root / _MARK
    if not mark.exists():
        found = next((path.name for path in root.iterdir()), None)
        if found is not None:
            raise MicrovibError(
                f"{root}: holds other content ({found}); choose an empty or new folder as a library"
            )
        mark.write_text(_MARKED, encoding="utf-8")
    (root / "entries").mkdir(mode=0o700, exist_ok=True)
    if not is_own(root / "entries"):
        raise MicrovibError(f"{root}: its folder 'entries' is not your own")


def _locked(root: Path) -> int:
    lock = os.open(root / "lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if sys.platform == "win32":
            windows: Any = import_module("msvcrt")
            windows.locking(lock, windows.LK_NBLCK, 1)
        else:
            unix: Any = import_module("fcntl")
            unix.flock(lock, unix.LOCK_EX | unix.LOCK_NB)
    except OSError:
        os.close(lock)
        raise InUse(f"{root}: is in use by another server") from None
    return lock


def _entries(folder: Path) -> Iterator[Entry]:
    for path in sorted(folder.iterdir()):
        entry = _entry(path)
        if entry is not None:
            yield entry


def _entry(folder: Path) -> Entry | None:
    """The entry of a folder; None where it is not one of ours."""
    file = folder / _ENTRY
    if not ID.fullmatch(folder.name) or not is_own(folder) or not is_own(file):
        return None
    try:
        if file.stat().st_size > _LONGEST:
            return None
        entry = Entry.model_validate_json(file.read_bytes())
    except (OSError, ValidationError):
        return None
    return entry if entry.id == folder.name else None


def _write(folder: Path, entry: Entry) -> None:
    """Describe an entry in its folder, whole or not at all."""
    new = folder / f"{_ENTRY}.new"
    with open(new, "w", encoding="utf-8") as stream:
        json.dump(entry.model_dump(), stream)
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(new, folder / _ENTRY)
