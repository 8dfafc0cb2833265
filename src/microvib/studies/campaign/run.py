"""Computing what is missing of a campaign, with whatever may die while it runs."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Protocol

from microvib.errors import MicrovibError
from microvib.studies.campaign.cases import Work, compute_bytes
from microvib.studies.campaign.folder import Campaign

STRIKES = 3
"""Deaths of a worker over one chunk, or over one case alone, after which it is to blame."""

POLL = 5.0
"""Seconds between two looks at the workers."""
SILENT = 24
"""Looks in a row at which a worker gave no sign, after which it is ended: it was stopped, or hangs."""
BEAT = 1.0
"""Seconds between two signs of a worker."""

Progress = Callable[[int, int], None]
"""Cases done and cases in all."""


class Backend(Protocol):
    """Where cases are computed. A new executor is asked for when the last one broke."""

    workers: int
    deaths: tuple[type[BaseException], ...]
    """What a future raises whose worker died."""

    def executor(self) -> Executor:
        """A working executor; called again where the last one lost a worker."""
        ...

    def watch(self) -> None:
        """Look after the workers; called every POLL seconds while they are at work."""
        ...


@contextmanager
def local(workers: int | None = None) -> Iterator[Backend]:
    """Processes on this machine, one per core by default."""
    pool = _Local(workers or os.cpu_count() or 1)
    try:
        yield pool
    finally:
        pool.close()


class _Local:
    """A pool of processes on a leash: a pipe whose far end only the coordinator holds. When it closes, because the coordinator
    ends or is killed, all workers end at once; they have nothing to save. On another pipe each gives a sign every second; one
    that gives none for long is killed, and its cases are computed again. Looks are counted, not seconds, so that a coordinator
    that was itself stopped for a while blames nobody."""

    def __init__(self, workers: int) -> None:
        from concurrent.futures.process import BrokenProcessPool

        self.workers = workers
        self.deaths: tuple[type[BaseException], ...] = (BrokenProcessPool,)
        self._context = multiprocessing.get_context("spawn")  # a forked copy of threads and locks may hang
        self._pool: ProcessPoolExecutor | None = None
        self._held: Connection | None = None
        self._signs: Connection | None = None
        self._silent: Counter[int] = Counter()

    def executor(self) -> Executor:
        self.close()
        # Inherited: workers' small matrices must not wait on busy cores.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        leash, self._held = self._context.Pipe(duplex=False)
        self._signs, sign = self._context.Pipe(duplex=False)
        self._silent.clear()
        self._pool = ProcessPoolExecutor(self.workers, self._context, _on_leash, (leash, sign))
        with _without_interrupts():  # a worker that is still starting must not answer Ctrl-C with a traceback
            for _ in range(self.workers):  # each starts one, as long as none is idle
                self._pool.submit(os.getpid)
        return self._pool

    def watch(self) -> None:
        heard = set()
        while self._signs is not None and self._signs.poll():
            heard.add(int(self._signs.recv_bytes()))
        for pid in heard | set(self._silent):
            self._silent[pid] = 0 if pid in heard else self._silent[pid] + 1
            if self._silent[pid] == SILENT:
                with suppress(OSError):  # it has ended meanwhile
                    os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))

    def close(self) -> None:
        if self._held is not None:
            self._held.close()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Holds Ctrl-C back; processes that are started in the meantime never hear it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _on_leash(leash: Connection, sign: Connection) -> None:
    """In a worker: Ctrl-C is for the coordinator, the worker's life is the coordinator's, and it says that it lives."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        try:
            leash.recv_bytes()
        except (EOFError, OSError):
            os._exit(1)

    def live() -> None:
        with suppress(OSError):
            while True:
                sign.send_bytes(b"%d" % os.getpid())
                time.sleep(BEAT)

    for task in (watch, live):
        threading.Thread(target=task, daemon=True).start()


def compute_missing(
    campaign: Campaign, backend: Backend, *, shard: tuple[int, int] = (0, 1), todo: Sequence[int] | None = None,
    progress: Progress | None = None,
) -> None:  # fmt: skip
    """Compute and write all chunks that are missing, or of ``todo``; of a shard (k, n), every n-th from the k-th on.

    Whenever this ends, by return, error, interrupt or kill, each chunk's file is there whole or not at all. MicrovibError where
    the disk is full or chunks cannot be computed.
    """
    campaign.check_version()
    mine = (range(campaign.chunks) if todo is None else todo)[shard[0] :: shard[1]]
    _Coordinator(campaign, backend, mine, progress or (lambda done, total: None)).run()


class _Coordinator:
    """Keeps the workers supplied, writes what comes back, finds out which cases kill workers."""

    def __init__(self, campaign: Campaign, backend: Backend, chunks: Sequence[int], progress: Progress) -> None:
        self._campaign, self._backend, self._progress = campaign, backend, progress
        left = set(campaign.missing())
        self._waiting = deque(k for k in chunks if k in left)
        self._suspects: list[int] = []
        self._strikes: Counter[int] = Counter()
        self._total = self._cases(chunks)
        self._done = self._total - self._cases(self._waiting)
        self._executor: Executor | None = None

    def _cases(self, chunks: Iterable[int]) -> int:
        return sum(len(self._campaign.cases_of(k)) for k in chunks)

    def run(self) -> None:
        self._progress(self._done, self._total)
        running: dict[Future[bytes], int] = {}
        while self._waiting or running:
            while self._waiting and len(running) < 2 * self._backend.workers:  # one in reserve for every worker
                chunk = self._waiting.popleft()
                running[self._submit(self._campaign.work(chunk))] = chunk
            for future in wait(running, timeout=POLL, return_when=FIRST_COMPLETED).done:
                self._collect(future, running.pop(future))
            self._backend.watch()
        for chunk in self._suspects:
            self._keep(chunk, self._one_by_one(chunk))

    def _submit(self, work: Work) -> Future[bytes]:
        if self._executor is not None:
            try:
                return self._executor.submit(compute_bytes, work)
            except self._backend.deaths:  # it lost a worker, and with it all that was under way
                pass
        self._executor = self._backend.executor()
        return self._executor.submit(compute_bytes, work)

    def _collect(self, future: Future[bytes], chunk: int) -> None:
        try:
            self._keep(chunk, future.result())
        except MicrovibError:
            raise
        except Exception:  # its worker died, or failed beyond its cases
            self._strikes[chunk] += 1
            if self._strikes[chunk] < STRIKES:
                self._waiting.appendleft(chunk)
            else:
                self._suspects.append(chunk)

    def _keep(self, chunk: int, data: bytes) -> None:
        self._campaign.write(chunk, data)
        self._done += len(self._campaign.cases_of(chunk))
        self._progress(self._done, self._total)

    def _one_by_one(self, chunk: int) -> bytes:
        """A chunk whose workers died: was it one of its cases, or only near one that was?"""
        cases = self._campaign.cases_of(chunk)
        data = self._alone(chunk)
        if data is None:
            if self._alone(chunk, []) is None:
                text = "workers end as soon as they start; memory may be short: take fewer workers"
                raise MicrovibError(text, remedy="workers")
            tries = range(STRIKES)
            deadly = tuple(k for k, case in enumerate(cases) if all(self._alone(chunk, [case]) is None for _ in tries))
            data = self._alone(chunk, deadly=deadly)
        if data is None:
            text = (
                f"chunk {chunk} (cases {cases[0]} to {cases[-1]}) ends its worker, though none of its cases does alone; memory"
                " may be short: make the campaign again with smaller chunks, or take fewer workers"
            )
            raise MicrovibError(text, remedy="workers")
        return data

    def _alone(self, chunk: int, cases: Sequence[int] | None = None, deadly: tuple[int, ...] = ()) -> bytes | None:
        """A chunk, or some cases of it, computed with nothing else under way; None where the worker dies or fails."""
        future = self._submit(self._campaign.work(chunk, cases, deadly))
        while not wait([future], timeout=POLL).done:
            self._backend.watch()
        try:
            return future.result()
        except MicrovibError:
            raise
        except Exception:
            return None
