"""Samples with their pyramid in one file, from which any window is mapped without reading the rest."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from microvib.signals.pyramid import Pyramid, level_sizes

_HEAD = 4096
"""Bytes of the head, a multiple of any size of a sample."""


def pyramid_parts(made: Pyramid) -> list[Any]:
    """Contents of the file of a pyramid, as buffers that are written one after another."""
    head = {"dtype": made.samples.dtype.str, "samples": made.samples.size, "rate": made.rate}
    parts = [
        json.dumps(head).encode().ljust(_HEAD, b"\0"),
        np.ascontiguousarray(made.samples).data,
    ]
    return parts + [np.ascontiguousarray(x).data for level in made.levels for x in level]


def mapped_pyramid(path: Path) -> Pyramid | None:
    """The pyramid of a file, in the file itself; None where there is none, or not a whole one."""
    try:
        with path.open("rb") as file:
            head = json.loads(file.read(_HEAD).rstrip(b"\0"))
        kind = np.dtype(head["dtype"])
        if kind.kind != "f":
            return None
        data = np.memmap(path, dtype=kind, mode="r", offset=_HEAD)
        samples, rate = int(head["samples"]), float(head["rate"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    sizes = level_sizes(samples)
    if data.size != samples + 2 * sum(sizes):
        return None
    levels, at = [], samples
    for size in sizes:
        levels.append((data[at : at + size], data[at + size : at + 2 * size]))
        at += 2 * size
    return Pyramid(data[:samples], rate, tuple(levels))
