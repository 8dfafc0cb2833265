"""Files that others wrote: looked at before they are opened, and whatever is wrong with them as one
sentence.
"""

from __future__ import annotations

import contextlib
import io
import stat
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from microvib.errors import MicrovibError, error_context, missing_library

RECORDINGS = (
    ".uff",
    ".unv",
    ".ufb",
    ".mat",
    ".nc",
    ".tdms",
    ".csv",
    ".txt",
    ".asc",
    ".lvm",
    ".wav",
)
"""Endings of the files of recordings that are read."""
LARGEST = 8_000_000_000  # bytes of the largest file that is opened


@contextmanager
def as_read_errors(path: Path, kind: type[MicrovibError]) -> Iterator[None]:
    """Every error of the block as a ``kind`` that names the file; libraries raise whatever they
    meet in a broken one.
    """
    with error_context(path), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except MicrovibError as error:
            raise kind(str(error), remedy=error.remedy) from None
        except MemoryError:
            raise kind("needs more memory than is available; it is too large, or broken") from None
        except Exception as error:
            found = f"{type(error).__name__}: {str(error)[:300]}"
            raise kind(f"is corrupt or truncated, or not of its kind ({found})") from None


class _OtherThreads(io.TextIOBase):
    """A stream that drops what one thread writes and passes on what others do."""

    def __init__(self, stream: Any):
        self.stream, self.owner = stream, threading.get_ident()

    def write(self, text: str) -> int:
        if threading.get_ident() != self.owner and self.stream is not None:
            self.stream.write(text)
        return len(text)

    def flush(self) -> None:
        if self.stream is not None:
            self.stream.flush()

    def isatty(self) -> bool:
        return self.stream is not None and bool(self.stream.isatty())

    def fileno(self) -> int:
        return int(self.stream.fileno())


_OUTPUT_LOCK = threading.RLock()


@contextmanager
def suppress_output() -> Iterator[None]:
    """Drop what a library prints in this thread while it reads: that is no output of ours."""
    with (
        _OUTPUT_LOCK,
        contextlib.redirect_stdout(_OtherThreads(sys.stdout)),
        contextlib.redirect_stderr(_OtherThreads(sys.stderr)),
    ):
        yield


def check_file(path: Path, largest: int = LARGEST) -> None:
    """MicrovibError unless there is a file that can be read and has at most ``largest`` bytes."""
    try:
        facts = path.stat()
        if not stat.S_ISREG(facts.st_mode):
            raise MicrovibError("is not a file")
        path.open("rb").close()
    except (OSError, ValueError) as error:
        raise MicrovibError(
            f"cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
    if facts.st_size > largest:
        raise MicrovibError(
            f"has {facts.st_size / 1e9:.1f} GB; files of at most {largest / 1e9:g} GB are read"
        )


def library(module: str) -> Any:
    """A module of an optional library; MicrovibError where that is not installed, with the extra
    that brings it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise MicrovibError(missing_library(error) or str(error)) from None
