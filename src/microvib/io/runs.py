"""A run's folder, read back as it was written."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.io.scenario_file import load_scenario
from microvib.signals.line_table import Line, LineTable, Rest
from microvib.solve.channels import CHANNELS, MODAL
from microvib.solve.motion import Invariants, Motion

_NEEDED = ("motion.nc", "lines.csv", "scenario.yaml", "summary.json")


@dataclass(frozen=True)
class Run:
    """A motion with its lines, the versions that made them, and what the lines were judged by."""

    motion: Motion
    table: LineTable
    versions: dict[str, str]
    limit: tuple[float, float, float] | None = None
    """Largest amplitude, 0-to-peak [N m], that a line may have between two frequencies [Hz]."""


def read_run(folder: Path | str) -> Run:
    """The run in ``folder``. MicrovibError where a file is missing, is none of a run, or was changed since."""
    folder = Path(folder)
    missing = [name for name in _NEEDED if not (folder / name).is_file()]
    if missing:
        raise MicrovibError(f"{folder}: holds no {missing[0]}; the folder of a run with its motion is expected")
    summary = _summary(folder / "summary.json")
    written = folder / "scenario.yaml"
    if hashlib.sha256(written.read_bytes()).hexdigest() != summary["scenario_sha256"]:
        raise MicrovibError(f"{written}: was changed since the run; run it again: microvib run {written}")
    scenario = load_scenario(written)
    time, channels = _channels(folder / "motion.nc")
    motion = Motion(scenario, time, channels, summary["invariants"], summary["solver"])
    return Run(motion, _table(folder / "lines.csv", summary), summary["versions"], summary["limit"])


def _summary(path: Path) -> dict[str, Any]:
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        known = {key: math.nan if value is None else float(value) for key, value in data["invariants"].items()}
        needed = {key: data[key] for key in ("scenario_sha256", "solver", "versions", "record")}
        return {**data, **needed, "invariants": Invariants(**known), "limit": _limit(data.get("limit"))}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise MicrovibError(f"{path}: is not a summary of a run of this version") from None


def _limit(data: dict[str, float | None] | None) -> tuple[float, float, float] | None:
    """Torque and band of a limit; a band that is open above has no number there."""
    if data is None:
        return None
    torque, low, high = (data[key] for key in ("torque", "low", "high"))
    return float(torque or math.nan), float(low or 0.0), math.inf if high is None else float(high)


def _channels(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    import h5netcdf

    try:
        with h5netcdf.File(path, "r") as f:
            channels = {name: np.asarray(f[name]) for name in (*CHANNELS, *MODAL) if name in f}
            return np.asarray(f["time"]), channels
    except (OSError, KeyError):
        raise MicrovibError(f"{path}: is not a motion of a run") from None


def _table(path: Path, summary: dict[str, Any]) -> LineTable:
    texts = {field.name for field in fields(Line) if field.type == "str"}
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows: list[dict[str, Any]] = [
                {key: text if key in texts else float(text or math.nan) for key, text in row.items()}
                for row in csv.DictReader(stream)
            ]
        record = summary["record"]
        lines = tuple(Line(**row) for row in rows)
        left = summary.get("left_by_lines")
        rest = None if left is None else Rest(*(np.array(left[name]) for name in ("frequency_hz", "amplitude_n_m")))
        return LineTable(
            lines, summary.get("clock_ratio_found"), None, record["samples"], record["sample_rate_hz"], rest=rest,
            own_error=summary.get("own_error", 0.0),
        )  # fmt: skip
    except (OSError, ValueError, TypeError, KeyError):
        raise MicrovibError(f"{path}: is not a table of lines of a run") from None
