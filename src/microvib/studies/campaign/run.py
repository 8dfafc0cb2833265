"""Computing what is missing of a campaign, with whatever may die while it runs."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future

from microvib.errors import MicrovibError
from microvib.studies.campaign.cases import WorkPackage, compute_bytes
from microvib.studies.campaign.folder import Campaign
from microvib.studies.interrupts import any_done
from microvib.studies.workers import Backend

MAX_WORKER_DEATHS = 3
"""Deaths of a worker over one chunk, or over one case alone, after which it is to blame."""

Progress = Callable[[int, int], None]
"""Cases done and cases in all."""


def compute_missing(
    campaign: Campaign, backend: Backend, *, shard: tuple[int, int] = (0, 1), todo: Sequence[int] | None = None,
    progress: Progress | None = None,
) -> None:  # fmt: skip
    """Compute and write all chunks that are missing, or of ``todo``; of a shard (k, n), every n-th
    from the k-th on.

    Whenever this ends, by return, error, interrupt or kill, each chunk's file is there whole or not
    at all. MicrovibError where the disk is full or chunks cannot be computed.
    """
    campaign.check_version()
    mine = (range(campaign.chunks) if todo is None else todo)[shard[0] :: shard[1]]
    _Coordinator(campaign, backend, mine, progress or (lambda done, total: None)).run()


class _Coordinator:
    """Keeps the workers supplied, writes what comes back, finds out which cases kill workers."""

    def __init__(
        self, campaign: Campaign, backend: Backend, chunks: Sequence[int], progress: Progress
    ) -> None:
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
            while (
                self._waiting and len(running) < 2 * self._backend.workers
            ):  # one in reserve for every worker
                chunk = self._waiting.popleft()
                running[self._submit(self._campaign.work(chunk))] = chunk
            for future in any_done(running):
                self._collect(future, running.pop(future))
            self._backend.watch()
        for chunk in self._suspects:
            self._keep(chunk, self._one_by_one(chunk))

    def _submit(self, work: WorkPackage) -> Future[bytes]:
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
            if self._strikes[chunk] < MAX_WORKER_DEATHS:
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
            tries = range(MAX_WORKER_DEATHS)
            crashing = tuple(
                k
                for k, case in enumerate(cases)
                if all(self._alone(chunk, [case]) is None for _ in tries)
            )
            data = self._alone(chunk, crashing=crashing)
        if data is None:
            text = (
                f"chunk {chunk} (cases {cases[0]} to {cases[-1]}) ends its worker, though none of"
                " its cases does alone; memory"
                " may be short: make the campaign again with smaller chunks, or take fewer workers"
            )
            raise MicrovibError(text, remedy="workers")
        return data

    def _alone(
        self, chunk: int, cases: Sequence[int] | None = None, crashing: tuple[int, ...] = ()
    ) -> bytes | None:
        """A chunk, or some cases of it, computed with nothing else under way; None where the worker
        dies or fails.
        """
        future = self._submit(self._campaign.work(chunk, cases, crashing))
        while not any_done([future]):
            self._backend.watch()
        try:
            return future.result()
        except MicrovibError:
            raise
        except Exception:
            return None
