"""Browsing of recordings that are too long to be read each time: samples and their pyramids are kept in
the user's cache folder, from where any window is drawn at once.

Nothing is written beside the user's files. What is kept belongs to a file by its path, size, time of
change and the ends of its content, and to how it was prepared; when there is too much of it, what was
used least recently goes.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.pyramid_files import mapped_pyramid, pyramid_parts
from microvib.io.recordings import read_prepared
from microvib.signals.pyramid import Curve, Pyramid
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording, RecordingError

_FORMAT = 1
_FOLDER = "browse"
_ENDS = 65536
"""Bytes at each end of a file that are looked at."""
LARGEST_CACHE = 4_000_000_000
"""Bytes that are kept of all recordings together."""


@dataclass(frozen=True)
class BrowsedRecording:
    """A recording of which windows are drawn."""

    path: Path
    sample_rate: float
    """[Hz]."""
    samples: int
    units: dict[str, str]
    """Units of the channels, by their names."""
    notes: tuple[str, ...]
    _key: str
    _preparation: Preparation | None
    _known: dict[str, Pyramid] = field(default_factory=dict)
    _read: list[Recording] = field(default_factory=list)

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.samples / self.sample_rate

    @property
    def channels(self) -> list[str]:
        """Names of the channels."""
        return list(self.units)

    def window(self, channel: str, t0: float, t1: float, pixels: int) -> Curve:
        """A window of a channel, ``t0`` to ``t1`` [s], for so many ``pixels`` (``Pyramid.window``).

        RecordingError for a channel that is not there.
        """
        return self.pyramid(channel).window(t0, t1, pixels)

    def pyramid(self, channel: str) -> Pyramid:
        """Samples of a channel with their pyramid: as kept, or made and kept."""
        if channel not in self.units:
            raise RecordingError(
                f"{self.path}: there is no channel '{channel}'; there are {', '.join(self.units)}"
            )
        if channel not in self._known:
            name = f"{self._key}-{hashlib.sha256(channel.encode()).hexdigest()[:16]}.samples"
            found = _kept_pyramid(name)
            if found is None:
                made = Pyramid.of(np.asarray(self._recording()[channel]), self.sample_rate)
                found = _keep_pyramid(name, made) or made
            self._known[channel] = found
        return self._known[channel]

    def _recording(self) -> Recording:
        if not self._read:
            self._read.append(read_prepared(self.path, self._preparation).recording)
        return self._read[0]


def browse(path: Path | str, preparation: Preparation | None = None) -> BrowsedRecording:
    """A recording, to draw windows of; it is read only if it is not kept as it is now.

    RecordingError where it cannot be read.
    """
    path = Path(path)
    key = _key_of(path, preparation)
    told = _kept_head(f"{key}.json")
    if told is not None:
        return BrowsedRecording(
            path,
            told["sample_rate"],
            told["samples"],
            told["units"],
            tuple(told["notes"]),
            key,
            preparation,
        )
    recording = read_prepared(path, preparation).recording
    units = {name: recording.units.get(name, "") for name in recording.channels}
    head = {
        "sample_rate": recording.sample_rate,
        "samples": recording.samples,
        "units": units,
        "notes": list(recording.notes),
    }
    _keep(f"{key}.json", [json.dumps(head).encode()])
    return BrowsedRecording(
        path,
        recording.sample_rate,
        recording.samples,
        units,
        recording.notes,
        key,
        preparation,
        _read=[recording],
    )


def _key_of(path: Path, preparation: Preparation | None) -> str:
    """Digest of all that the samples depend on; RecordingError where the file cannot be read."""
    digest = hashlib.sha256(f"{_FORMAT}\n".encode())
    try:
        status = path.stat()
        digest.update(f"{path.resolve()}\n{status.st_size}\n{status.st_mtime_ns}\n".encode())
        with path.open("rb") as file:
            digest.update(file.read(_ENDS))
            file.seek(max(status.st_size - _ENDS, 0))
            digest.update(file.read(_ENDS))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    if preparation is not None:
        digest.update(preparation.model_dump_json().encode())
    return digest.hexdigest()[:32]


def _folder() -> Path | None:
    from microvib.compiled import machine

    return machine.own_folder(_FOLDER)


def _kept_head(name: str) -> dict[str, Any] | None:
    """Description of a recording's channels that is kept; None where nothing is."""
    folder = _folder()
    if folder is None:
        return None
    try:
        told = json.loads((folder / name).read_bytes())
    except (OSError, ValueError):
        return None
    expected = {"sample_rate": float, "samples": int, "units": dict, "notes": list}
    whole = isinstance(told, dict) and all(isinstance(told.get(k), t) for k, t in expected.items())
    return told if whole else None


def _kept_pyramid(name: str) -> Pyramid | None:
    """Pyramid that is kept under a name, which now counts as used; None where there is no whole one."""
    folder = _folder()
    if folder is None:
        return None
    found = mapped_pyramid(folder / name)
    if found is not None:
        with contextlib.suppress(OSError):
            os.utime(folder / name)
    return found


def _keep_pyramid(name: str, made: Pyramid) -> Pyramid | None:
    """The pyramid as it is kept from now on; None where it cannot be kept."""
    _keep(name, pyramid_parts(made))
    return _kept_pyramid(name)


def _keep(name: str, parts: list[Any]) -> None:
    """Write a file of the cache, whole or not at all; nothing where that is not possible."""
    folder = _folder()
    if folder is None:
        return
    with contextlib.suppress(OSError):
        handle, temporary = tempfile.mkstemp(dir=folder)
        try:
            with os.fdopen(handle, "wb") as file:
                for part in parts:
                    file.write(part)
            os.replace(temporary, folder / name)
        except BaseException:
            os.unlink(temporary)
            raise
        _make_room(folder, folder / name)


def _make_room(folder: Path, newest: Path) -> None:
    """Remove what was used least recently where the folder has grown too large."""
    files = [(path.stat(), path) for path in folder.iterdir() if path.is_file()]
    total = sum(status.st_size for status, _ in files)
    for status, path in sorted(files, key=lambda one: one[0].st_mtime):
        if total <= LARGEST_CACHE:
            return
        if path != newest:
            path.unlink()
            total -= status.st_size
