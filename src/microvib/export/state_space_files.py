"""State spaces as MATLAB files (version 5) and as NumPy's archives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from microvib.export.state_space import StateSpace, channel_table, state_space
from microvib.export.subject import Subject
from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import package_versions

FORMAT = "microvib state space 1"
"""Name and version of the fields that are written."""


def write_state_space(subject: Subject, path: Path, options: object) -> None:
    """Write the state space of a scenario to ``.mat`` or ``.npz``."""
    system = state_space(subject.scenario)
    if path.suffix.lower() == ".npz":
        np.savez(path, **_fields(system, subject, _text_array))
        return
    from scipy.io import savemat

    savemat(path, _fields(system, subject, cells), oned_as="column")


def _fields(system: StateSpace, subject: Subject, texts: Any) -> dict[str, Any]:
    fields: dict[str, Any] = {name: getattr(system, name) for name in "ABCD"}
    for kind in ("state", "input", "output"):
        channels = channel_table(getattr(system, f"{kind}s"))
        fields |= {f"{kind}_{key}": texts(values) for key, values in channels.items()}
    return fields | {
        "format": FORMAT,
        "title": system.title,
        "microvib_version": package_versions()["microvib"],
        "scenario": dump_scenario(subject.scenario),
    }


def cells(texts: Sequence[str]) -> np.ndarray:
    """Texts as a column of cells of MATLAB, (n, 1)."""
    column = np.empty((len(texts), 1), dtype=object)
    column[:, 0] = list(texts)
    return column


def _text_array(texts: Sequence[str]) -> np.ndarray:
    return np.array(list(texts))
