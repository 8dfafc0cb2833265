"""Result folders: written whole or not at all, and never over something else."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import platform
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from microvib.errors import OutputError
from microvib.io.netcdf import new_netcdf
from microvib.io.scenario_file import dump_scenario
from microvib.io.writing import Writer, real_path, workspace, write_files
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.signals.line_table import Line, LineTable
from microvib.solve.channels import TIME, Channel
from microvib.solve.motion import Motion

RUN_FILES = ("motion.nc", "lines.csv", "summary.json", "scenario.yaml", "report.html")
"""Files of a run's folder; only a folder that holds nothing else may be replaced."""

STUDY_FILES = (
    "compare.csv", "fit.json", "validation.csv", "spectrum.csv", "density.csv", "third_octaves.csv", "modes.csv", "modes.png",
    "rates.csv", "resonances.csv", "forbidden.csv", "campbell.png", "largest.png",
    "sas.csv", "sas.json", "simulator.yaml", "drawing.png", "report.pdf",
    "statistics.csv", "worst.csv", "failed.csv", "effects.csv", "envelopes.png", "exceedance.png", "histograms.png",
    "tornado.png", "sobol.png", "scatter.png", "levels.png",
)  # fmt: skip
"""Further files of the folders of studies."""


def check_folder(out: Path, overwrite: bool = False) -> None:
    """OutputError unless ``out`` is free: absent, empty, or with ``overwrite`` a folder that holds results and no more."""
    try:
        where = real_path(out)
        with workspace(out if out.is_dir() else _existing_parent(where), out.name):
            pass  # it can be written to
        exists = out.exists()
    except OSError as error:
        raise OutputError(f"{str(out)[:200]}: cannot be made or written to: {error.strerror or error}") from None
    if not exists:
        return
    if not out.is_dir():
        raise OutputError(f"{out}: is a file; a folder is expected")
    content = sorted(p.name for p in out.iterdir())
    if not content:
        return
    foreign = [name for name in content if name not in (*RUN_FILES, *STUDY_FILES) or not (out / name).is_file()]
    if foreign:
        raise OutputError(
            f"{out}: holds other content ({foreign[0]}); nothing was written; choose an empty or new folder"
        )
    if not overwrite:
        raise OutputError(
            f"{out}: holds results already; nothing was written; choose another folder, or allow them to be replaced",
            remedy="overwrite",
        )


def free_folder(stem: str) -> Path:
    """``stem``, or ``stem-2``, ``stem-3``, ... whichever does not exist yet in the current folder."""
    candidate, k = Path(stem), 1
    while candidate.exists():
        k += 1
        candidate = Path(f"{stem}-{k}")
    return candidate


def _existing_parent(path: Path) -> Path:
    parent = path.absolute().parent
    while not parent.exists():
        parent = parent.parent
    return parent


def check_room(out: Path, size: float) -> None:
    """OutputError where the disk of ``out`` has no room for ``size`` bytes."""
    free = shutil.disk_usage(_existing_parent(out) if not out.is_dir() else out).free
    if size > free:
        raise OutputError(
            f"{out}: needs about {size / 1e6:.0f} MB, but the disk has {free / 1e6:.0f} MB free; shorten record.duration, lower"
            " record.sample_rate, or keep the lines only",
            remedy="lines_only",
        )


def write_folder(out: Path, files: dict[str, str | Writer], overwrite: bool = False) -> None:
    """Write a folder of results, whole or not at all, where ``check_folder`` allows it."""
    check_folder(out, overwrite)
    write_files(out, files)


def columns_csv(columns: dict[str, Iterable[float]]) -> str:
    """CSV text of columns of equal length."""
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{v:.9g}" for v in row) for row in rows)]) + "\n"


def rows_csv(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV text of rows under a header; figures with nine digits, what is not known left empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(x) for x in row] for row in rows)
    return stream.getvalue()


def lines_csv(table: LineTable) -> str:
    """CSV text of a table of lines, one row each; what could not be estimated is left empty."""
    names = [
        "line",
        "expected_hz",
        "frequency_hz",
        "amplitude_n_m",
        "phase_rad",
        "bin_frequency_hz",
        "bin_amplitude_n_m",
    ]
    names += [f.name for f in fields(Line) if f.name not in names]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    for line in table:
        row = asdict(line)
        writer.writerow({name: _cell(row[name]) for name in names})
    return stream.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.9g}"
    return str(value)


def write_motion(motion: Motion, path: Path) -> None:
    """NetCDF 4 file of a motion (HDF5; read by xarray, MATLAB, Octave), with unit and meaning on every variable."""
    with new_netcdf(path) as f:
        f.dimensions = {"time": motion.time.size}
        if any(v.ndim == 2 for v in motion.channels.values()):
            f.dimensions["mode"] = len(motion.scenario.array.modes)
        f.attrs["title"] = motion.scenario.title or "microvib run"
        f.attrs["sample_rate_hz"] = motion.sample_rate
        f.attrs["scenario"] = dump_scenario(motion.scenario)
        f.attrs["microvib_version"] = package_versions()["microvib"]
        _variable(f, TIME, motion.time)
        for channel, values in motion.variables():
            if values.size:
                _variable(f, channel, values)


def _variable(f: Any, channel: Channel, values: Any) -> None:
    variable = f.create_variable(channel.name, ("time", "mode")[: values.ndim], data=values)
    variable.attrs["units"] = channel.unit
    variable.attrs["long_name"] = channel.meaning


def package_versions() -> dict[str, str]:
    """Versions that a result depends on."""
    names = ("microvib", "numpy", "numba", "llvmlite")
    return {"python": platform.python_version()} | {name: _version_of(name) for name in names}


@cache
def _version_of(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def scenario_hash(scenario: Scenario) -> str:
    """SHA-256 of the complete scenario as it is written to ``scenario.yaml``."""
    return hashlib.sha256(dump_scenario(scenario).encode()).hexdigest()


def summary(
    scenario: Scenario, invariants: Any, solver: dict[str, Any], table: LineTable, **timings: float
) -> dict[str, Any]:
    """What ``summary.json`` holds: invariants, settings, versions, timings, frequencies of the coupled drive."""
    return {
        "title": scenario.title,
        "source": scenario.source,
        "scenario_sha256": scenario_hash(scenario),
        "invariants": asdict(invariants),
        "solver": solver,
        "clock_ratio_found": table.clock_ratio,
        "record": {"samples": table.samples, "sample_rate_hz": table.sample_rate},
        "doubts": list(scenario.doubts()),
        "left_by_lines": _left_by_lines(table),
        "own_error": table.own_error,
        "natural_frequencies": [asdict(mode) for mode in coupled_modes(scenario)],
        "versions": package_versions(),
        "timings_s": timings,
    }


def _left_by_lines(table: LineTable) -> dict[str, list[float]] | None:
    """The highest peaks that no line accounts for."""
    rest = table.rest
    if rest is None:
        return None
    return {"frequency_hz": rest.frequency.tolist(), "amplitude_n_m": rest.amplitude.tolist()}


def to_json(data: Any) -> str:
    """JSON text; numbers that JSON does not know become null."""
    return json.dumps(_finite(data), indent=2, ensure_ascii=False) + "\n"


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    if isinstance(data, float):
        return float(data) if math.isfinite(data) else None
    return data


PAPER_LINES = {"natural": "array_mode_1", "driving": "drive_1", "driving_2": "drive_2", "driving_3": "drive_3"}
"""Our names of the lines of Tables 5 and 6."""


def read_table(name: str) -> Iterable[dict[str, str]]:
    """Rows of one of the paper's tables in the catalog, such as ``table6_line_amplitudes``."""
    from importlib import resources

    text = (resources.files("microvib.catalog") / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))
