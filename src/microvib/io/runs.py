"""Folder of a run: motion, lines, summary; written, and read back unchanged."""

from __future__ import annotations

import csv
import hashlib
import json
import math
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError, expect_path
from microvib.io.band_limits import BandLimit
from microvib.io.csv_cells import unescape_formula
from microvib.io.netcdf import new_netcdf
from microvib.io.scenario_file import dump_scenario, load_scenario
from microvib.io.tables import package_versions, rows_csv
from microvib.io.writing import LISTING, require_unchanged
from microvib.model.line_names import SECOND_DRIVE
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.results import Column, Table, columns_of
from microvib.signals.limit_curve import Limit
from microvib.signals.line_table import Line, LineTable, ResidualPeaks, SeedLine
from microvib.signals.seed_peaks import SeedPeaks
from microvib.solve.channels import CHANNELS, MODAL, TIME, Channel
from microvib.solve.motion import Invariants, Motion

SECOND_MOTION = "motion_wing_2.nc"
"""Motion of a second wing's drive that is driven."""
SECOND_LINES = "lines_wing_2.csv"
"""Lines of that drive's torque."""
SEED_PEAKS = "seed_peaks.csv"
"""Largest amplitudes beside the clock's lines in each draw of the noise."""
_NEEDED = ("motion.nc", "lines.csv", "scenario.yaml", "summary.json")
_READ_BACK = (*_NEEDED, SECOND_MOTION, SECOND_LINES, "seeds.csv", SEED_PEAKS)
"""Files from which a run is read."""


@dataclass(frozen=True)
class Run:
    """A motion with its lines, the versions that made them, and what the lines were judged by."""

    motion: Motion
    table: LineTable
    versions: dict[str, str]
    limit: Limit | None = None
    """Limit that the lines were judged by."""
    band_limits: tuple[BandLimit, ...] = ()
    """Bands in which the time history was judged."""
    roll_off: float | None = None
    """Roll-off of their filters, where one was asked for."""
    second_table: LineTable | None = None
    """Lines of a second wing's drive; None where it is not driven, or they were not kept."""
    unchecked: str = ""
    """Sentence on a folder that does not tell whether its files are those of the run; else empty."""

    def __repr__(self) -> str:
        return f"Run kept by microvib {self.versions['microvib']}\n{self.motion!r}\n{self.table!r}"


def write_motion(motion: Motion, path: Path) -> None:
    """NetCDF 4 file of a motion (HDF5; read by xarray, MATLAB, Octave), with unit and meaning on
    every variable.
    """
    with new_netcdf(path) as f:
        f.dimensions = {"time": motion.time.size}
        if any(v.ndim == 2 for v in motion.channels.values()):
            f.dimensions["mode"] = motion.scenario.load.H.size
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


def lines_csv(table: LineTable) -> str:
    """CSV text of a table of lines, one row each; what could not be estimated is left empty."""
    columns = columns_of(Line)
    first = (
        "name",
        "expected",
        "frequency",
        "amplitude",
        "phase",
        "bin_frequency",
        "bin_amplitude",
    )
    names = [*first, *(name for name in columns if name not in first)]
    header = [columns[name].key for name in names]
    return rows_csv(header, ([getattr(line, name) for name in names] for line in table))


def seeds_csv(table: LineTable) -> str:
    """CSV text of the lines over many draws of the noise."""
    seeds = Table.of("seeds", SeedLine, table.seeds)
    return rows_csv([column.key for column in seeds.columns], seeds.file_rows())


def seed_peaks_csv(peaks: SeedPeaks) -> str:
    """CSV text of the largest amplitudes beside the clock's lines, a row for each draw and part of
    the spectrum.
    """
    rows = (
        (draw, f, amplitude)
        for draw, (at, sizes) in enumerate(zip(peaks.frequency, peaks.amplitude, strict=True))
        for f, amplitude in zip(at.tolist(), sizes.tolist(), strict=True)
    )
    return rows_csv(("draw", "frequency_hz", "amplitude_n_m"), rows)


def _seed_peaks(path: Path) -> SeedPeaks | None:
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    keys = ("draw", "frequency_hz", "amplitude_n_m")
    draw, frequency, amplitude = np.array([[float(row[k]) for k in keys] for row in rows]).T
    draws = int(draw.max()) + 1
    return SeedPeaks(frequency.reshape(draws, -1), amplitude.reshape(draws, -1))


def scenario_hash(scenario: Scenario) -> str:
    """SHA-256 of the complete scenario as it is written to ``scenario.yaml``."""
    return hashlib.sha256(dump_scenario(scenario).encode()).hexdigest()


def summary(
    scenario: Scenario,
    invariants: Invariants,
    solver: dict[str, Any],
    table: LineTable,
    **timings: float,
) -> dict[str, Any]:
    """Contents of ``summary.json``: invariants, settings, versions, timings, frequencies of the
    coupled drive.
    """
    return {
        "title": scenario.title,
        "source": scenario.source,
        "scenario_sha256": scenario_hash(scenario),
        **account_of_drive(invariants, solver, table),
        "doubts": list(scenario.unusual_values()),
        "natural_frequencies": [asdict(mode) for mode in coupled_modes(scenario)],
        "versions": package_versions(),
        "timings_s": timings,
    }


def account_of_drive(
    invariants: Invariants, solver: dict[str, Any], table: LineTable
) -> dict[str, Any]:
    """Account of one drive in ``summary.json``: its numerics, and what its table of lines knows beside
    its rows. That of the second wing's drive is under SECOND_DRIVE.
    """
    return {
        "invariants": asdict(invariants),
        "solver": solver,
        "clock_ratio_found": table.clock_ratio,
        "record": {"samples": table.samples, "sample_rate_hz": table.sample_rate},
        "left_by_lines": table.rest and _residual_peaks(table.rest),
        "larger_in_pieces": table.pieces and _peaks(table.pieces),
        "own_error": _known_error(table),
        "broken_invariants": list(table.broken),
        "harmonics": table.harmonics,
    }


def _peaks(found: ResidualPeaks) -> dict[str, Any]:
    """Frequencies and amplitudes of peaks."""
    return {
        "frequency_hz": found.frequency.tolist(),
        "amplitude_n_m": found.amplitude.tolist(),
    }


def _residual_peaks(found: ResidualPeaks) -> dict[str, Any]:
    """The highest peaks that no line accounts for, with what they may be together."""
    return _peaks(found) | {
        "sum_n_m": found.in_sum.tolist(),
        "slow_n_m": found.slow,
        "resolution_hz": found.resolution,
    }


Numerics = tuple[Invariants, dict[str, Any]]


def _numerics(said: dict[str, Any]) -> Numerics:
    return Invariants(
        **{k: math.nan if x is None else float(x) for k, x in said["invariants"].items()}
    ), said["solver"]


def read_run(folder: Path | str) -> Run:
    """Read a run's folder, as ``microvib run`` and ``write_run`` leave it.

    Parameters
    ----------
    folder : str or path
        The folder, with its motion.

    Returns
    -------
    Run
        Motion, table of lines, versions that made them, and the limit that they were judged by.

    Raises
    ------
    MicrovibError
        Where a file is missing, is not a run's, or has been changed since.
    """
    expect_path(folder)
    folder = Path(folder)
    missing = [name for name in _NEEDED if not (folder / name).is_file()]
    if missing:
        raise MicrovibError(
            f"{folder}: holds no {missing[0]}; the folder of a run with its motion is expected"
        )
    unchecked = check_run_folder(folder)
    with _expected(folder / "summary.json", "a summary of a run of this version") as path:
        said = json.loads(path.read_text(encoding="utf-8"))
        first, second = _numerics(said), _numerics(said.get(SECOND_DRIVE, said))
        digest, versions = (said[key] for key in ("scenario_sha256", "versions"))
        limit = None if said.get("limit") is None else Limit.from_dict(said["limit"])
        of_bands = said.get("band_limits") or {"roll_off": None, "bands": ()}
        bands = tuple(BandLimit(**one) for one in of_bands["bands"])
    written = folder / "scenario.yaml"
    if hashlib.sha256(written.read_bytes()).hexdigest() != digest:
        raise MicrovibError(
            f"{written}: was changed since the run; run it again: microvib run"
            f" {shlex.quote(str(written))}"
        )
    scenario = load_scenario(written)
    motion = _motion(folder / "motion.nc", scenario, first)
    other = scenario.driven_wing
    if other is not None:
        motion = replace(motion, second_wing=_motion(folder / SECOND_MOTION, other, second))
    with _expected(folder / "lines.csv", "a table of lines of a run") as path:
        table = replace(_table(path, said), seeds=_seeds(folder / "seeds.csv"))
    second_table = None
    # A folder of a version that kept no more than the numerics of this drive knows its rows alone.
    if other is not None and "record" in said.get(SECOND_DRIVE, ()):
        with _expected(folder / SECOND_LINES, "a table of lines of a run") as path:
            second_table = _table(path, said[SECOND_DRIVE])
    with _expected(folder / SEED_PEAKS, "a table of peaks over draws") as path:
        table = replace(table, seed_peaks=_seed_peaks(path))
    return Run(motion, table, versions, limit, bands, of_bands["roll_off"], second_table, unchecked)


def _table(path: Path, account: dict[str, Any]) -> LineTable:
    """Table of lines of one drive, with what ``account_of_drive`` says of it."""
    left, pieces, record = (
        account.get("left_by_lines"), account.get("larger_in_pieces"), account["record"],
    )  # fmt: skip
    return LineTable(
        _lines(path),
        account.get("clock_ratio_found"),
        0.0,
        record["samples"],
        record["sample_rate_hz"],
        rest=left and _rest(left),
        pieces=pieces and _rest(pieces),
        own_error=_error_of(account.get("own_error")),
        broken=tuple(account.get("broken_invariants", _numerics(account)[0].broken)),
        harmonics=account.get("harmonics", 8),
    )


def check_run_folder(folder: Path) -> str:
    """Refuse a run's folder of which a file that is read back was changed since the run.

    Parameters
    ----------
    folder : Path
        The folder.

    Returns
    -------
    str
        A sentence where the folder does not tell; else empty.

    Raises
    ------
    MicrovibError
        Names the file that was changed.
    """
    again = f"run it again: microvib run {shlex.quote(str(folder / 'scenario.yaml'))}"
    there = [folder / name for name in _READ_BACK if (folder / name).is_file()]
    known = [require_unchanged(path, f"put it back, or {again}") for path in there]
    if all(known):
        return ""
    return (
        f"{folder}: does not tell whether its files are still those of the run, which an older"
        f" microvib wrote, or which were copied without {LISTING}."
    )


def _known_error(table: LineTable) -> float | None:
    """Error of a table; None where it is not known."""
    if table.find_error is not None or math.isnan(table.own_error):
        return None
    return table.own_error


def _error_of(said: float | None) -> float:
    if said is None:
        return math.nan
    return said


def _rest(left: dict[str, Any]) -> ResidualPeaks:
    """Unexplained peaks in ``summary.json``."""
    frequency, amplitude = (np.array(left[name]) for name in ("frequency_hz", "amplitude_n_m"))
    slow, resolution = left.get("slow_n_m", 0.0), left.get("resolution_hz", 0.0)
    together = np.array(left.get("sum_n_m", left["amplitude_n_m"]))
    return ResidualPeaks(frequency, amplitude, None, slow, resolution, together)


def _motion(path: Path, scenario: Scenario, how: Numerics) -> Motion:
    import h5netcdf

    with _expected(path, "a motion of a run"), h5netcdf.File(path, "r") as f:
        channels = {name: np.asarray(f[name]) for name in (*CHANNELS, *MODAL) if name in f}
        return Motion(scenario, np.asarray(f["time"]), channels, *how)


@contextmanager
def _expected(path: Path, what: str) -> Iterator[Path]:
    """The file; what goes wrong with it in the block says that it is not ``what`` it should be."""
    try:
        yield path
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise MicrovibError(f"{path}: is not {what}") from None


def _lines(path: Path) -> tuple[Line, ...]:
    return tuple(Line(**row) for row in _rows(path, Line))


def _seeds(path: Path) -> tuple[SeedLine, ...]:
    if path.is_file():
        rows = _rows(path, SeedLine)
    else:
        rows = []
    return tuple(SeedLine(**{**row, "draws": int(row["draws"])}) for row in rows)


def _rows(path: Path, of: type) -> list[dict[str, Any]]:
    """Rows of a CSV table as keywords of a dataclass, of texts and numbers."""
    declared = {column.key: (name, column) for name, column in columns_of(of).items()}

    def value(column: Column, text: str) -> Any:
        return unescape_formula(text) if column.measure is None else float(text or math.nan)

    with path.open(encoding="utf-8", newline="") as stream:
        return [
            {name: value(column, row[key]) for key, (name, column) in declared.items()}
            for row in csv.DictReader(stream)
        ]
