"""A recording in a folder, as it was read: samples of each channel with their pyramid, so that it is
drawn and cut without being read again.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from microvib.io.pyramid_files import mapped_pyramid, pyramid_parts
from microvib.signals.pyramid import Pyramid
from microvib.testdata.recording import Recording

_FORMAT = 1
_HEAD = "channels.json"
_KEYS = {
    "sample_rate": float,
    "channels": list,
    "units": dict,
    "notes": list,
    "axes": list,
}
"""Keys of the head, and the types of their values."""


def keep_recording(recording: Recording, folder: Path) -> None:
    """Keep a recording as it was read; OSError where the disk does not take it.

    The head is written last: without it nothing is taken for whole.
    """
    for k, x in enumerate(recording.channels.values()):
        _write(folder / _samples(k), pyramid_parts(Pyramid.of(x, recording.sample_rate)))
    head = {
        "format": _FORMAT,
        "sample_rate": recording.sample_rate,
        "channels": list(recording.channels),
        "units": dict(recording.units),
        "notes": list(recording.notes),
        "axes": sorted(recording.axes),
    }
    _write(folder / _HEAD, [json.dumps(head).encode()])


def kept_recording(folder: Path, title: str) -> Recording | None:
    """The recording of a folder, its samples mapped from their files; None where there is no whole
    one.
    """
    head = _head(folder)
    if head is None:
        return None
    channels = {}
    for k, name in enumerate(head["channels"]):
        found = mapped_pyramid(folder / _samples(k))
        if found is None:
            return None
        channels[str(name)] = found.samples
    return Recording(
        channels,
        head["sample_rate"],
        head["units"],
        title,
        tuple(head["notes"]),
        axes=frozenset(head["axes"]),
    )


def kept_pyramid(folder: Path, channel: str) -> Pyramid | None:
    """Samples of a channel of a kept recording with their pyramid; None where there are none."""
    head = _head(folder)
    if head is None or channel not in head["channels"]:
        return None
    return mapped_pyramid(folder / _samples(head["channels"].index(channel)))


def _samples(k: int) -> str:
    return f"channel-{k}.samples"


def _head(folder: Path) -> dict[str, Any] | None:
    try:
        head = json.loads((folder / _HEAD).read_bytes())
    except (OSError, ValueError):
        return None
    if not isinstance(head, dict) or head.get("format") != _FORMAT:
        return None
    whole = all(isinstance(head.get(key), kind) for key, kind in _KEYS.items())
    return head if whole else None


def _write(path: Path, parts: list[Any]) -> None:
    """Write a file, whole or not at all."""
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    try:
        with new.open("wb") as file:
            for part in parts:
                file.write(part)
        os.replace(new, path)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
