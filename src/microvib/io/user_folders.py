"""Folders of this user's own: where data is kept, and whether a folder is nobody else's to change."""

from __future__ import annotations

import os
import secrets
import stat
import sys
from pathlib import Path

_KEY = "seal.key"
_KEY_LENGTH = 32


def data_folder() -> Path:
    """Folder where this user's data is kept."""
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local"
        return Path(local) / "microvib/data"
    if sys.platform == "darwin":
        return Path.home() / "Library/Application Support/microvib"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "microvib"


def is_own(path: Path) -> bool:
    """Whether a file or folder is this user's, no link, and nobody else may write to it.

    On Windows, where the folder of a user's data is, nobody else may write.
    """
    try:
        status = path.lstat()
    except OSError:
        return False
    if stat.S_ISLNK(status.st_mode):
        return False
    if sys.platform == "win32":
        return True
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


def seal_key() -> bytes:
    """Secret of this user by which files that microvib wrote are told from others'.

    It is kept in the data folder; where it cannot be, it lasts as long as the process.
    """
    folder = data_folder()
    path = folder / _KEY
    new = secrets.token_bytes(_KEY_LENGTH)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not is_own(folder):
            return new
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            kept = path.read_bytes() if is_own(path) else b""
            return kept if len(kept) == _KEY_LENGTH else new
        with os.fdopen(handle, "wb") as stream:
            stream.write(new)
    except OSError:
        pass  # a disk that is full or read-only
    return new
