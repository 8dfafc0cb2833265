"""Work on all cores: processes that may die or hang at any time, and many calls of one function, on
those or on threads.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Protocol

from microvib.errors import MicrovibError
from microvib.solve.integration import Progress
from microvib.studies.interrupts import any_done, deferred_interrupts, threads

POLL_INTERVAL = 5.0
"""Seconds between two looks at the workers."""
MAX_MISSED_HEARTBEATS = 24
"""Looks in a row at which a worker gave no sign, after which it is ended: it was stopped, or hangs."""
HEARTBEAT_INTERVAL = 1.0
"""Seconds between two signs of a worker."""
MAIN_GUARD_ADVICE = (
    "microvib: each process imports the script that starts it, so what a script does with several"
    " workers stands under"
    " if __name__ == '__main__':"
)


class Backend(Protocol):
    """Where cases are computed. A new executor is asked for when the last one broke."""

    workers: int
    deaths: tuple[type[BaseException], ...]
    """Exceptions of a future whose worker died."""

    def executor(self) -> Executor:
        """A working executor; called again where the last one lost a worker."""
        ...

    def watch(self) -> None:
        """Look after the workers; called at least every POLL seconds while they are at work."""
        ...


@contextmanager
def local(workers: int | None = None) -> Iterator[Backend]:
    """Processes on this machine, one per core by default."""
    pool = _Local(workers or os.cpu_count() or 1)
    with deferred_interrupts():
        try:
            yield pool
        finally:
            pool.close()


@contextmanager
def in_threads(count: int | None = None) -> Iterator[Backend]:
    """Threads of this process, one per core by default: for a process that may start no others. A
    case that ends its worker ends this process.
    """
    with threads(count) as pool:
        yield _Threads(pool, count or os.cpu_count() or 1)


@dataclass
class _Threads:
    """Threads as a place where cases are computed: none dies, and none is looked after."""

    pool: Executor
    workers: int
    deaths: tuple[type[BaseException], ...] = ()

    def executor(self) -> Executor:
        return self.pool

    def watch(self) -> None:
        """Nothing to look after."""


class _Local:
    """A pool of processes on a leash: a pipe whose far end only the coordinator holds. When it
    closes, because the coordinator ends or is killed, all workers end at once; they have nothing to
    save. On another pipe each gives a sign every second; one that gives none for long is killed,
    and its cases are computed again. Looks are counted, not seconds, so that a coordinator that was
    itself stopped for a while blames nobody."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self.deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)
        self._context = multiprocessing.get_context(
            "spawn"
        )  # a forked copy of threads and locks may hang
        self._pool: ProcessPoolExecutor | None = None
        self._held: Connection | None = None
        self._signs: Connection | None = None
        self._started: set[BaseProcess] = set()
        self._silent: Counter[int] = Counter()
        self._looked = -math.inf

    def executor(self) -> Executor:
        if getattr(
            multiprocessing.current_process(), "_inheriting", False
        ):  # a process that is being started imports the script
            raise SystemExit(MAIN_GUARD_ADVICE)
        self.close()
        # Inherited: workers' small matrices must not wait on busy cores.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        leash, self._held = self._context.Pipe(duplex=False)
        self._signs, sign = self._context.Pipe(duplex=False)
        self._silent.clear()
        quiet_tracker()
        self._pool = ProcessPoolExecutor(
            self.workers, self._context, _initialise_worker, (leash, sign)
        )
        others = set(multiprocessing.active_children())
        with (
            _interrupts_blocked()
        ):  # a worker that is still starting must not answer Ctrl-C with a traceback
            for _ in range(self.workers):  # each starts one, as long as none is idle
                self._pool.submit(os.getpid)
        self._started = set(multiprocessing.active_children()) - others
        return self._pool

    def watch(self) -> None:
        now = time.monotonic()
        if now - self._looked < 0.9 * POLL_INTERVAL:  # asked more often than workers give signs
            return
        heard, self._looked = set(), now
        while self._signs is not None and self._signs.poll():
            heard.add(int(self._signs.recv_bytes()))
        for pid in heard | set(self._silent):
            if pid in heard:
                self._silent[pid] = 0
            else:
                self._silent[pid] = self._silent[pid] + 1
            if self._silent[pid] == MAX_MISSED_HEARTBEATS:
                with suppress(OSError):  # it has ended meanwhile
                    os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))

    def close(self) -> None:
        if self._held is not None:
            self._held.close()
        for worker in (
            self._started
        ):  # one that still imports would see only seconds later that the leash is gone
            worker.kill()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)


def quiet_tracker() -> None:
    """Start the process that clears away what killed processes leave, so that it does so without a
    warning on the terminal.
    """
    if os.name != "posix":
        return
    from multiprocessing import resource_tracker

    quiet = "ignore:resource_tracker:UserWarning"  # handed on to the interpreter that is started
    sys.warnoptions.append(quiet)
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(quiet)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Holds Ctrl-C back; processes that are started in the meantime never hear it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _initialise_worker(leash: Connection, sign: Connection) -> None:
    """In a worker: Ctrl-C is for the coordinator, the worker's life is the coordinator's, and it
    says that it lives.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(
        signal, "SIGPIPE"
    ):  # what is sent to a coordinator that is gone ends the worker, without a traceback
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)

    def watch() -> None:
        try:
            leash.recv_bytes()
        except (EOFError, OSError):
            os._exit(1)

    def live() -> None:
        with suppress(OSError):
            while True:
                time.sleep(HEARTBEAT_INTERVAL)
                sign.send_bytes(b"%d" % os.getpid())

    sign.send_bytes(b"%d" % os.getpid())  # before any work: one that hangs at once is missed, too
    for task in (watch, live):
        threading.Thread(target=task, daemon=True).start()


Calls = Callable[[Callable[..., Any], Iterable[tuple[Any, ...]]], list[Any]]
"""Calls a function with each of some arguments, and gives what it returns in their order."""


@contextmanager
def parallel_calls(progress: Progress | None = None, workers: int | None = None) -> Iterator[Calls]:
    """Calls on threads, which share one interpreter, or on so many processes as there are
    ``workers``; one needs no process.

    ``progress(done, total)`` counts all calls so far. An interrupt does not wait for what has not
    begun. MicrovibError where a process was ended, because memory was short or it hung.
    """
    if workers in (None, 1):
        with threads(workers) as pool:
            yield _calls(pool, progress, lambda: None)
        return
    with local(workers) as backend:
        yield _calls(backend.executor(), progress, backend.watch)


def _calls(pool: Executor, progress: Progress | None, watch: Callable[[], None]) -> Calls:
    before = 0

    def called(function: Callable[..., Any], arguments: Iterable[tuple[Any, ...]]) -> list[Any]:
        nonlocal before
        try:
            futures = [pool.submit(function, *each) for each in arguments]
            total = before + len(futures)
            if progress is not None:
                progress(before, total)
            for done, future in enumerate(
                futures, before + 1
            ):  # one by one: to wait for all takes the square of their number
                while not any_done([future]):
                    watch()
                watch()
                future.result()  # an error ends all
                if progress is not None:
                    progress(done, total)
        except BrokenExecutor:
            raise MicrovibError(
                "a process that solved cases was ended; memory may be short"
            ) from None
        before = total
        return [future.result() for future in futures]

    return called
