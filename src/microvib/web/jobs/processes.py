"""Computations in worker processes: each in one of its own, so that its end, however bad, is the
end of nothing else.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import multiprocessing.util
import secrets
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from microvib.web.jobs.worker import step, work
from microvib.web.server.limits import Limits

ENDED = ("done", "failed", "cancelled")
_STARTING = "starting a worker"
# Python 3.11.0 would put the fork server's socket where every user can send it pickles; 3.11.1 and
# later never do.
multiprocessing.util.abstract_sockets_supported = False  # type: ignore[misc]


class QueueFull(Exception):
    """As many computations as are allowed wait already."""


@dataclass(eq=False)
class Job:
    """One computation: what is to be done, how far it is, how it ended."""

    task: str
    arguments: dict[str, Any]
    kind: str = ""
    title: str = ""
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    state: str = "queued"
    progress: dict[str, Any] = field(default_factory=lambda: step(text="waiting"))
    error: str | None = None
    value: Any = None  # what the task returned
    pid: int | None = None
    folder: Path | None = None  # where it leaves its files
    asked: dict[str, Any] = field(default_factory=dict)  # the request that it answers
    settle: Callable[[Job], None] | None = None  # called when its files are whole
    ended: threading.Event = field(default_factory=threading.Event)
    stop: Callable[[], None] | None = None

    def end(self, state: str, error: str | None = None) -> None:
        """The first end counts."""
        if self.state not in ENDED:
            self.error, self.state = error, state
            self.ended.set()


class _Worker:
    """A process that warms up and then does one piece of work."""

    def __init__(self, context: Any, memory: int) -> None:
        self.pipe: Connection
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=work, args=(theirs, memory), daemon=True)
        self.process.start()
        theirs.close()

    def close(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


class Workers:
    """Some computations at a time, in the order of their arrival, each in a worker that was warm
    before it was asked.
    """

    def __init__(self, at_once: int, wall_s: float, limits: Limits) -> None:
        self._wall_s, self._limits = wall_s, limits
        # A fork of a process that has everything loaded is warm at once; elsewhere each worker
        # warms up by itself.
        self._context = multiprocessing.get_context(
            "forkserver" if sys.platform == "linux" else "spawn"
        )
        if sys.platform == "linux":
            self._context.set_forkserver_preload(["microvib.web.jobs.preload"])
        self._queue: deque[Job] = deque()
        self._change = threading.Condition()
        self._closed = self._warm = False
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(at_once)]
        for thread in self._threads:
            thread.start()

    def submit(self, job: Job) -> Job:
        """Put a job at the end of the queue; Busy where it is full."""
        with self._change:
            if self._closed or len(self._queue) >= self._limits.waiting:
                raise QueueFull
            if not self._warm:
                job.progress = step(text=_STARTING)
            self._queue.append(job)
            self._change.notify()
        return job

    def cancel(self, job: Job) -> None:
        """End a job, whether it waits or runs."""
        with self._change:
            if job in self._queue:
                self._queue.remove(job)
            job.end("cancelled")
            if job.stop is not None:
                job.stop()

    def close(self) -> None:
        """End everything."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        for job in list(self._queue):
            self.cancel(job)

    def join(self, until: float) -> None:
        """Wait for the workers to end, at most until then on the monotonic clock; one that is
        starting ends by itself.
        """
        for thread in self._threads:
            thread.join(max(until - time.monotonic(), 0.0))

    def _serve(self) -> None:
        if hasattr(
            signal, "pthread_sigmask"
        ):  # what is started here hears no Ctrl-C, not even before it could say so
            from multiprocessing import resource_tracker  # not on Windows

            # where a process starts it, that process's Ctrl-C is unblocked after
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        worker: _Worker | None = None
        while not self._closed:
            worker = worker or self._worker()
            job = self._next()
            if worker is not None and not worker.process.is_alive():  # it died while it was idle
                worker = self._worker()
            if job is not None and worker is not None:
                self._follow(job, worker)
            elif job is not None:
                job.end("failed", "no process could be started for it; the server's log says more")
            if worker is not None:
                worker.close()
            worker = None

    def _worker(self) -> _Worker | None:
        try:
            worker = _Worker(self._context, self._limits.memory)
            self._warm = True
            return worker
        except (OSError, EOFError) as error:
            logging.getLogger("microvib.serve").error("no worker could be started: %s", error)
            return None

    def _next(self) -> Job | None:
        with self._change:
            while not self._queue and not self._closed:
                self._change.wait()
            if self._closed:
                return None
            return self._queue.popleft()

    def _follow(self, job: Job, worker: _Worker) -> None:
        with self._change:
            if job.state != "queued":
                return
            job.state, job.pid, job.stop = "running", worker.process.pid, worker.process.kill
            job.progress = step(text=_STARTING)
        deadline = math.inf
        try:
            while job.state == "running":
                if self._closed:
                    job.end("cancelled")
                elif time.monotonic() > deadline:
                    job.end(
                        "failed",
                        f"stopped after {self._wall_s:g} s, the longest that is allowed here",
                    )
                elif worker.pipe.poll(0.2):
                    kind, content = worker.pipe.recv()
                    _take_message(job, kind, content)
                    if kind == "ready":
                        deadline = time.monotonic() + self._wall_s
                        worker.pipe.send((job.task, job.arguments))
        except (EOFError, OSError):
            worker.process.join(2.0)
            job.end("failed", _how_it_ended(worker.process.exitcode))


def _take_message(job: Job, kind: str, content: Any) -> None:
    """Change the ``job`` by what its process sends."""
    if kind == "done":
        job.value = content
        if job.settle is not None:
            job.settle(job)
        job.end(kind)
    elif kind == "failed":
        job.end(kind, content)
    else:
        job.progress = content


def _how_it_ended(status: int | None) -> str:
    """Sentence on a process that ended with ``status`` before it had answered."""
    if status is not None and status < 0:
        how = f"was killed by signal {-status}, perhaps for lack of memory"
    else:
        how = f"ended unexpectedly (status {status})"
    return f"its process {how}; nothing else was affected"
