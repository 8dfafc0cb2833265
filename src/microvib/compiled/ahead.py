"""Machine code that another process makes, while this one imports, reads and makes that of other
units.

LLVM takes one core and seconds for the largest unit, which is most of a first run. Nothing depends
on that process: where there is none, or it fails, or takes too long, code is made here when it is
needed, as ever. It ends with this one at the latest; where this one is killed, seconds later, when
its code is made.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence

from microvib.compiled import codegen

PATIENCE = 60.0
"""Seconds to wait for the other process; where a machine is that slow it was stopped, or hangs."""

_begun: dict[str, _Making] = {}


def begin(name: str, content: bytes, meanwhile: Sequence[Callable[[], object]]) -> None:
    """Begin to make the object file that ``take`` then gives by this name; who waits for it makes
    these calls in the meantime.
    """
    if cores() > 1 and sys.executable and not getattr(sys, "frozen", False) and name not in _begun:
        with contextlib.suppress(OSError):  # no more processes, no room for files
            _begun[name] = _Making(content, meanwhile)


def take(name: str) -> bytes | None:
    """The object file, when it is made; None where it has to be made here."""
    making = _begun.pop(name, None)
    if making is not None:
        return making.result()
    return None


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Making:
    def __init__(self, content: bytes, meanwhile: Sequence[Callable[[], object]]) -> None:
        self.meanwhile, self.owner = meanwhile, os.getpid()
        # Without site and environment, for speed; it imports from where this process does.
        words = [sys.executable, "-I", "-S", codegen.__file__, *sys.path]
        with tempfile.TemporaryFile() as given, contextlib.ExitStack() as files:
            given.write(content)
            given.seek(0)
            self.made = files.enter_context(
                tempfile.TemporaryFile()
            )  # a pipe would hold it up until somebody reads
            self.process = subprocess.Popen(
                words, stdin=given, stdout=self.made, stderr=subprocess.DEVNULL
            )
            files.pop_all()
        atexit.register(self.end)

    def result(self) -> bytes | None:
        if os.getpid() != self.owner:  # a fork of the process that began it
            return None
        try:
            for call in self.meanwhile:
                if self.process.poll() is None:
                    call()
            if self.process.wait(PATIENCE) != 0:
                return None
            self.made.seek(0)
            return self.made.read()
        except (OSError, subprocess.TimeoutExpired):
            return None
        finally:
            self.end()

    def end(self) -> None:
        if os.getpid() == self.owner:
            self.process.kill()
            self.process.wait()
            self.made.close()
            atexit.unregister(self.end)
