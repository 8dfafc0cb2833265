"""Runs that the page keeps: all of a run, its samples beside it."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np

from microvib.analysis.run import RunResult
from microvib.io.tables import to_json
from microvib.solve.channels import CHANNELS, MODAL
from microvib.solve.motion import Motion


def keep_run(where: Path, result: RunResult, motion: Motion) -> None:
    """Keep a run in the folder ``where``: channels as ``NAME.npy``, and all the rest of it."""
    for name, x in motion.channels.items():
        np.save(where / f"{name}.npy", x)
    loads = motion.interface_loads()
    if loads is not None:
        np.save(where / "loads.npy", loads)
    axis = {"t0": float(motion.time[0]), "sample_rate": motion.sample_rate}
    (where / "axis.json").write_text(to_json(axis), encoding="utf-8")
    bare = replace(result, motion=replace(motion, channels={}))
    (where / "run.pickle").write_bytes(pickle.dumps(bare))


def kept_run(where: Path) -> RunResult:
    """A run that ``keep_run`` kept; its samples are mapped from their files."""
    # written by a worker of this very server
    result: RunResult = pickle.loads((where / "run.pickle").read_bytes())
    assert result.motion is not None
    files = {name: where / f"{name}.npy" for name in (*CHANNELS, *MODAL)}
    channels = {
        name: np.load(file, mmap_mode="r") for name, file in files.items() if file.is_file()
    }
    return replace(result, motion=replace(result.motion, channels=channels))
