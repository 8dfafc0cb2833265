"""Files that nobody of this project made, which lie beside it where they are at hand."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def real_file(name: str) -> Path:
    """Path of such a file in ``shared/real`` beside the project; skips the test where it is not."""
    for folder in ROOT.parents[:2]:
        path = folder / "shared" / "real" / name
        if path.is_file():
            return path
    pytest.skip(f"{name}, data of others, is not here")
