"""Store of one server: computations, their results, recordings; each bounded, in one temporary folder
until they are whole, then in the library, if there is one.
"""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from microvib.web.jobs.library import Entry, Library
from microvib.web.jobs.processes import ENDED, Job, Workers
from microvib.web.server.limits import Limits

RECORDING = "recording"
"""Kind of a recording in the library, and its file's name."""
RESUMABLE = ("campaign",)
"""Kinds of jobs that go on where they were stopped."""


@dataclass(frozen=True)
class Upload:
    """A recording that a page sent."""

    id: str
    name: str
    path: Path
    """Its file, in a folder of its own beside its samples."""
    facts: dict[str, Any]

    @property
    def folder(self) -> Path:
        """Folder of its file and of its samples as they were read."""
        return self.path.parent

    @property
    def file(self) -> tuple[str, str]:
        """Where it is, and its name: what tasks take."""
        return str(self.path), self.name


def private(path: str, flags: int) -> int:
    """Opener of files that their owner alone may read."""
    return os.open(path, flags, 0o600)


class Store:
    """Jobs and recordings by id; the one not used for longest goes when there are too many."""

    def __init__(self, root: Path, limits: Limits, library: Library | None = None) -> None:
        self.root, self.limits, self.library = root, limits, library
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
        if library is not None:
            for entry in library.entries():
                self._add(library, entry)

    def submit(
        self, kind: str, title: str, asked: dict[str, Any] | None = None, **arguments: Any
    ) -> Job:
        """Start the task that is called as its kind; Busy where too many wait."""
        job = Job(kind, {}, kind, title, asked=asked or {}, settle=self._settle)
        folder = job.folder = self.root / job.id
        folder.mkdir(mode=0o700)
        if kind in RESUMABLE:  # what it has computed outlasts the server at any time
            self._settle(job)
            folder = job.folder
        job.arguments = {"folder": str(folder), **arguments}
        try:
            self._long.submit(job)
        except BaseException:
            self._forget(job.id)
            shutil.rmtree(folder, ignore_errors=True)
            raise
        with self._lock:
            self._jobs[job.id] = job
        self._make_room()
        return job

    def resume(self, job: Job) -> Job:
        """Go on with a job of RESUMABLE that ended before it was through; Busy where too many wait."""
        again = Job(job.task, {}, job.kind, job.title, job.id, settle=self._settle)
        again.folder, again.asked = job.folder, job.asked
        again.arguments = {"folder": str(job.folder)}
        self._long.submit(again)
        with self._lock:
            self._jobs[job.id] = again
        return again

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
        assert job.folder is not None
        return job.folder

    def _settle(self, job: Job) -> None:
        """Keep what a job has left; where the disk does not take it, it is there until the end."""
        if self.library is None or self.library.get(job.id) is not None:
            return
        entry = Entry(id=job.id, kind=job.kind, title=job.title, asked=job.asked)
        try:
            job.folder = self.library.take(self.folder(job), entry)
        except OSError as error:
            _log_not_kept(job.title, error)

    def _add(self, library: Library, entry: Entry) -> None:
        """An entry of the library as what it was: a recording, or a computation that has ended."""
        folder = library.folder(entry.id)
        if entry.kind == RECORDING:
            found = next(folder.glob(f"{RECORDING}.*"), None)
            if found is not None:
                self._uploads[entry.id] = Upload(entry.id, entry.title, found, entry.facts)
            return
        job = Job(
            entry.kind, {}, entry.kind, entry.title, entry.id, folder=folder, asked=entry.asked
        )
        if entry.kind in RESUMABLE and not (folder / "result.json").is_file():
            job.end("cancelled")
        else:
            job.end("done")
        self._jobs[entry.id] = job

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
            self._forget(job.id)
        shutil.rmtree(self.folder(job), ignore_errors=True)

    def _forget(self, id: str) -> None:
        if self.library is not None and self.library.get(id) is not None:
            self.library.forget(id)

    def _stays(self, id: str) -> bool:
        """Whether its owner wants to keep it when others make room."""
        entry = None if self.library is None else self.library.get(id)
        return entry is not None and entry.kept

    def _make_room(self) -> None:
        ended = [job for job in self.jobs() if job.state in ENDED and not self._stays(job.id)]
        sizes = {job.id: _size(self.folder(job)) for job in ended}
        total = sum(sizes.values())
        for k, job in enumerate(ended):
            if len(ended) - k <= self.limits.kept and total <= self.limits.stored:
                break
            total -= sizes[job.id]
            self.drop(job)

    def new_recording(self, suffix: str) -> Path:
        """A file for a recording that is taken in, in a folder of its own."""
        folder = self.root / secrets.token_hex(8)
        folder.mkdir(mode=0o700)
        return folder / f"{RECORDING}{suffix}"

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

    def keep(self, name: str, path: Path, facts: dict[str, Any]) -> Upload:
        """Keep a recording that was read, and what is in it."""
        id = path.parent.name
        folder = self._kept_recording(name, path.parent, facts)
        upload = Upload(id, name, folder / path.name, facts)
        with self._lock:
            self._uploads[upload.id] = upload
            old = [self._uploads.pop(one.id) for one in self._surplus()]
            for one in old:
                self._forget(one.id)
        for one in old:
            shutil.rmtree(one.folder, ignore_errors=True)
        return upload

    def _surplus(self) -> list[Upload]:
        """Recordings that are too many, or too large together; never the newest."""
        others = [one for id, one in self._uploads.items() if not self._stays(id)]
        sizes = {one.id: _size(one.folder) for one in others}
        total, surplus = sum(sizes.values()), []
        for k, one in enumerate(others[:-1]):
            few = len(others) - k <= self.limits.recordings
            if few and total <= self.limits.recorded:
                break
            total -= sizes[one.id]
            surplus.append(one)
        return surplus

    def _kept_recording(self, name: str, folder: Path, facts: dict[str, Any]) -> Path:
        """Folder in which a recording is from now on."""
        if self.library is None:
            return folder
        entry = Entry(id=folder.name, kind=RECORDING, title=name, facts=facts)
        try:
            return self.library.take(folder, entry)
        except OSError as error:
            _log_not_kept(name, error)
            return folder

    def rename(self, id: str, changes: dict[str, Any]) -> Entry | None:
        """Change title, attributes or whether an entry of the library is kept; None where it is
        gone.
        """
        with self._lock:
            if self.library is None or self.library.get(id) is None:
                return None
            entry = self.library.edit(id, changes)
            if id in self._jobs:
                self._jobs[id].title = entry.title
            if id in self._uploads:
                self._uploads[id] = replace(self._uploads[id], name=entry.title)
            return entry

    def remove(self, id: str) -> bool:
        """Take an entry out of the library, so that it can be brought back; whether it was there."""
        with self._lock:
            if self.library is None or self.library.get(id) is None:
                return False
            self.library.remove(id)
            self._jobs.pop(id, None)
            self._uploads.pop(id, None)
            return True

    def bring_back(self, id: str) -> Entry | None:
        """An entry that was taken out of the library; None where it is gone."""
        with self._lock:
            if self.library is None:
                return None
            entry = self.library.bring_back(id)
            if entry is not None:
                self._add(self.library, entry)
            return entry

    def trusts(self, job: Job) -> bool:
        """Whether the whole of a run can be read again: one of another version cannot."""
        return (
            self.library is None or self.library.get(job.id) is None or self.library.trusts(job.id)
        )

    def upload(self, id: str) -> Upload | None:
        """A recording, which now counts as used."""
        with self._lock:
            return _touch(self._uploads, id)

    def uploads(self) -> list[Upload]:
        """All recordings, the one used last at the end."""
        with self._lock:
            return list(self._uploads.values())

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


def _log_not_kept(name: str, error: OSError) -> None:
    logging.getLogger("microvib.serve").error(
        "%s could not be kept: %s", name, error.strerror or error
    )


Kept = TypeVar("Kept")


def _touch(kept: dict[str, Kept], id: str) -> Kept | None:
    """One of what is kept in the order of its use, which is now the last."""
    found = kept.pop(id, None)
    if found is not None:
        kept[id] = found
    return found


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
