"""A worker: one process, one piece of work."""

from __future__ import annotations

import logging
import re
import signal
import sys
import time
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from microvib.errors import MicrovibError, missing_library
from microvib.web.jobs import ProgressCallback

_FOLDERS = re.compile(r"""(?<![\w.*^/\\])(?:[A-Za-z]:)?[/\\](?:[^\s/\\:;,'"]+[/\\])+""")
_OUT_OF_MEMORY = "out of memory; shorten record.duration or lower record.sample_rate"


def step(
    done: float = 0.0, total: float | None = None, unit: str = "", text: str = ""
) -> dict[str, Any]:
    """How far a job is."""
    return {"done": float(done), "total": total, "unit": unit, "text": text}


def work(pipe: Connection, memory: int) -> None:
    """Warm up, say so, do the one task that comes, tell how it went."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server ends its workers itself
    import_module("microvib.web.jobs.preload")
    _bound(memory)
    try:
        pipe.send(("ready", step(text="at work")))
        task, arguments = pipe.recv()
        pipe.send(_done(task, arguments, _telling(pipe)))
    except (EOFError, OSError):  # the server is gone
        sys.exit(1)


def _bound(memory: int) -> None:
    """Allow so much address space beyond what is taken by what is loaded; on Linux, where it can be
    told.
    """
    if sys.platform != "linux":
        return
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + memory
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _done(task: str, arguments: dict[str, Any], tell: ProgressCallback) -> tuple[str, Any]:
    from microvib.web.jobs import tasks

    try:
        return "done", getattr(tasks, task)(tell=tell, **arguments)
    except Exception as error:
        return "failed", without_folders(_error_text(task, error))


def _error_text(task: str, error: Exception) -> str:
    if isinstance(error, MicrovibError):
        return str(error)
    if isinstance(error, MemoryError):
        return _OUT_OF_MEMORY
    if isinstance(error, ModuleNotFoundError) and (sentence := missing_library(error)):
        return sentence
    if isinstance(error, OSError):
        return f"a file of the server could not be used: {error.strerror or error}"
    logging.getLogger("microvib.serve").error("%s failed", task, exc_info=error)
    return f"ended by a fault of the program ({type(error).__name__}: {error})"


def without_folders(text: str) -> str:
    """A text in which files have no folders: those of the server's machine are nobody's business."""
    return _FOLDERS.sub("", text)


def _telling(pipe: Connection) -> ProgressCallback:
    last = 0.0

    def tell(done: float, total: float | None, unit: str, text: str) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last > 0.05 or done == total:
            last = now
            pipe.send(("progress", step(done, total, unit, text)))

    return tell
