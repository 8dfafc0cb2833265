"""Grid point results in OP2: eigenvectors and forces of constraint of real modes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.structures.modal import ModalError


@dataclass(frozen=True)
class Vectors:
    """Grid point results of the modes: (id, direction) of the rows, direction 0 for scalar points, and values (n, s)."""

    rows: list[tuple[int, int]]
    values: np.ndarray


def read_vectors(path: Path, file: Any, name: str, word: str) -> Vectors | None:
    """Real eigenvectors or forces of constraint; None where the block holds other results.

    ``file`` is the library's open file, ``word`` the byte order and bytes of its words, such as <4.
    """
    row = np.dtype([("key", f"{word[0]}i{word[1]}", 2), ("value", f"{word[0]}f{word[1]}", 6)])
    file.set_position(name)
    file.rdop2nt()
    columns: list[np.ndarray] = []
    keys: np.ndarray = np.empty((0, 2), dtype=int)
    while (ident := file.rdop2record("int")) is not None:
        data = file.rdop2record("bytes")
        if ident[0] // 10 != 2 or ident[9] != 8 or len(data) % row.itemsize:
            return None  # no real modes, or a wide format
        table = np.frombuffer(data, row)
        if columns and not np.array_equal(table["key"], keys):
            raise ModalError(f"{path}: {name} has other points in mode {len(columns) + 1} than before")
        keys = table["key"]
        columns.append(table["value"])
    if not columns:
        return None
    grid = np.repeat(keys[:, 1] == 1, 6)
    direction = np.tile(np.arange(1, 7), len(keys))
    kept = grid | (direction == 1)
    ids = np.repeat(keys[:, 0] // 10, 6)
    rows = [(int(i), int(d)) for i, d in zip(ids[kept], np.where(grid, direction, 0)[kept], strict=True)]
    return Vectors(rows, np.array([c.ravel()[kept] for c in columns], dtype=float).T)


def places_of(uset: Any, vectors: Vectors) -> np.ndarray:
    """Rows of the table of degrees of freedom where the rows of the results are; -1 where they are not."""
    order = {(int(i), int(d)): k for k, (i, d) in enumerate(uset.index)}
    return np.array([order.get(row, -1) for row in vectors.rows])
