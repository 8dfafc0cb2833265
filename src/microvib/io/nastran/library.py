"""The library that reads Nastran's binary files and bulk data, its tables of degrees of freedom,
and lines of text files.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.files import library

MAX_LINE_LENGTH = 1000


def pyyeti(name: str) -> Any:
    """A module of pyyeti's Nastran part; MicrovibError where the package is missing."""
    return library(f"pyyeti.nastran.{name}")


def lines_of(path: Path) -> Iterator[str]:
    """Lines of a text file; one without end, as in a file that is not text, comes in pieces."""
    with path.open(encoding="latin-1") as stream:
        yield from iter(lambda: stream.readline(MAX_LINE_LENGTH), "")


def grid_coordinates(uset: Any) -> dict[int, np.ndarray]:
    """Coordinates in the basic frame of the grids of a table of degrees of freedom, (3,) each."""
    first = uset.loc[(slice(None), 1), ["x", "y", "z"]]
    return {
        int(k): v
        for k, v in zip(first.index.get_level_values(0), first.to_numpy(dtype=float), strict=True)
    }


def rigid_motion(uset: Any) -> np.ndarray:
    """Six rigid-body motions about the origin of the basic frame, in the output coordinate systems
    of the grids, (n, 6).
    """
    return pyyeti("n2p").rbgeom_uset(uset)
