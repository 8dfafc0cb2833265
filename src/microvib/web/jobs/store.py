"""Store of one server: computations, their results, recordings; each bounded, all in one
temporary folder.
"""

from __future__ import annotations

import os
import secrets
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from microvib.web.jobs.processes import ENDED, Job, Workers
from microvib.web.server.limits import Limits


@dataclass(frozen=True)
class Upload:
    """A recording that a page sent."""

    id: str
    name: str
    path: Path

    @property
    def file(self) -> tuple[str, str]:
        """Where it is, and its name: what tasks take."""
        return str(self.path), self.name


def private(path: str, flags: int) -> int:
    """Opener of files that their owner alone may read."""
    return os.open(path, flags, 0o600)


class Store:
    """Jobs and recordings by id; the one not used for longest goes when there are too many."""

    def __init__(self, root: Path, limits: Limits) -> None:
        self.root, self.limits = root, limits
        self.closed = False
        self._jobs: dict[str, Job] = {}
        self._uploads: dict[str, Upload] = {}
        self._lock = threading.Lock()
        self.views: dict[str, dict[str, Any]] = {}
        """Scenarios with finite elements, as the form shows them."""
        self.reading = threading.Lock()
        """Held while a scenario is read in the server itself."""
        self.waiting = threading.BoundedSemaphore(limits.checks)
        self._receiving = threading.BoundedSemaphore(limits.receiving)
        self._long = Workers(limits.at_once, limits.wall_s, limits)
        # What a page waits for must not stand behind long computations.
        self._quick = Workers(2, limits.quick_s, limits)
        # Nor the form behind large recordings.
        self._checks = Workers(1, limits.check_s, limits)

    def submit(self, kind: str, title: str, **arguments: Any) -> Job:
        """Start the task that is called as its kind; Busy where too many wait."""
        job = Job(kind, {}, kind, title)
        folder = self.folder(job)
        job.arguments = {"folder": str(folder), **arguments}
        folder.mkdir(mode=0o700)
        try:
            self._long.submit(job)
        except BaseException:
            folder.rmdir()
            raise
        with self._lock:
            self._jobs[job.id] = job
        self._make_room()
        return job

    def ask(self, task: str, **arguments: Any) -> Job:
        """A short job, waited for."""
        if task == "view":
            workers = self._checks
        else:
            workers = self._quick
        job = workers.submit(Job(task, arguments))
        job.ended.wait()
        return job

    def folder(self, job: Job) -> Path:
        """Where a job leaves its files."""
        return self.root / job.id

    def job(self, id: str) -> Job | None:
        """A job, which now counts as used."""
        with self._lock:
            return _touch(self._jobs, id)

    def jobs(self) -> list[Job]:
        """All jobs."""
        with self._lock:
            return list(self._jobs.values())

    def drop(self, job: Job) -> None:
        """Cancel a job that has not ended; forget one that has."""
        if job.state not in ENDED:
            self._long.cancel(job)
            return
        with self._lock:
            self._jobs.pop(job.id, None)
        shutil.rmtree(self.folder(job), ignore_errors=True)

    def _make_room(self) -> None:
        ended = [job for job in self.jobs() if job.state in ENDED]
        sizes = {job.id: _size(self.folder(job)) for job in ended}
        total = sum(sizes.values())
        for k, job in enumerate(ended):
            if len(ended) - k <= self.limits.kept and total <= self.limits.stored:
                break
            total -= sizes[job.id]
            self.drop(job)

    def new_file(self, suffix: str) -> Path:
        """A name that nothing has yet."""
        return self.root / f"{secrets.token_hex(8)}{suffix}"

    @contextmanager
    def receiving(self) -> Iterator[bool]:
        """Whether a recording may be taken in now."""
        free = self._receiving.acquire(blocking=False)
        try:
            yield free
        finally:
            if free:
                self._receiving.release()

    def keep_view(self, spec: str, view: dict[str, Any]) -> None:
        """Keep what a worker found out about a scenario."""
        self.views[spec] = view
        while len(self.views) > 16:
            del self.views[next(iter(self.views))]

    def keep(self, name: str, path: Path) -> Upload:
        """Keep a recording that was read."""
        upload = Upload(path.stem, name, path)
        with self._lock:
            self._uploads[upload.id] = upload
            surplus = list(self._uploads)[: max(len(self._uploads) - self.limits.recordings, 0)]
            old = [self._uploads.pop(id) for id in surplus]
        for one in old:
            one.path.unlink(missing_ok=True)
        return upload

    def upload(self, id: str) -> Upload | None:
        """A recording, which now counts as used."""
        with self._lock:
            return _touch(self._uploads, id)

    def close(self) -> None:
        """End all computations."""
        self.closed = True
        for workers in (self._long, self._quick, self._checks):
            workers.close()
        for job in self.jobs():
            self._long.cancel(job)

    def join(self, seconds: float = 3.0) -> None:
        """Wait for all workers to end, but no longer."""
        until = time.monotonic() + seconds
        for workers in (self._long, self._quick, self._checks):
            workers.join(until)


Kept = TypeVar("Kept")


def _touch(kept: dict[str, Kept], id: str) -> Kept | None:
    """One of what is kept in the order of its use, which is now the last."""
    found = kept.pop(id, None)
    if found is not None:
        kept[id] = found
    return found


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.glob("*"))
