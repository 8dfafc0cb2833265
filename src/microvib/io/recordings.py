"""Doors for recordings: UFF 58, MATLAB, TDMS, CSV, netCDF; out as UFF 58, MATLAB and CSV."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import OutputError, ScenarioError, expect, quoted_value
from microvib.io.csv_cells import csv_text
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.files import as_read_errors, check_file
from microvib.io.formats import READERS
from microvib.io.measured import Hints
from microvib.io.named import read_text
from microvib.io.scenario_file import load_bench
from microvib.io.table_responses import read_table_response
from microvib.io.tables import dict_rows
from microvib.io.uff_writing import FUNCTIONS, Dataset58, Even, Place, write_datasets
from microvib.io.writing import write_file
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validate_part
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.response import Stage
from microvib.units import GivenQuantity, quantity

LARGEST = 2_000_000_000  # bytes of the largest recording that is read


def read_recording(path: Path | str, sample_rate: GivenQuantity | None = None) -> Recording:
    """Read the channels of a recording; the format follows from the file's ending.

    Parameters
    ----------
    path : str or path
        File of the recording.
    sample_rate : str or Si, optional
        Samples per second, such as ``"4096 Hz"``: needed only where the file has no time axis, or
        contradicts itself.

    Returns
    -------
    Recording
        Channels by name, (n,) each; forces in N, torques in N m.

    Raises
    ------
    RecordingError
        Where the file cannot be read, or is no recording: says what is wrong.
    """
    expect(path, (str, Path), "the name of a file")
    if sample_rate is None:
        rate = None
    else:
        rate = quantity("sample_rate", sample_rate, "Hz", positive=True)
    return _read(Path(path), Hints(rate)).in_si()


def _read(path: Path, hints: Hints) -> Recording:
    """Channels in the units of the file."""
    with (
        as_read_errors(path, RecordingError),
        np.errstate(all="ignore"),
    ):  # numbers are checked where they are looked at
        reader = READERS.get(path.suffix.lower())
        if reader is None:
            raise RecordingError(
                f"'{path.suffix}' is not known; recordings are read from {', '.join(READERS)}"
            )
        check_file(path, LARGEST)
        return replace(reader(path, hints), title=str(path))


@dataclass(frozen=True)
class Prepared:
    """A recording that was prepared, and the background of its table where there is one."""

    recording: Recording
    background: Recording | None = None
    response_known: bool = False
    """Whether the measuring chain's response was stated."""


def load_preparation(path: Path | str) -> Preparation:
    """How to prepare recordings, from a YAML file; files that it names are relative to it.
    ScenarioError if it is wrong.
    """
    path = Path(path)
    data = parse_yaml(read_text(path, "preparation", ()), str(path))
    files = WORKING_FOLDER.in_folder_of(str(path))
    return _preparation(data, str(path), files, files.under("background").path)


def preparation_from_text(
    text: str, files: FileAccess, recordings: Mapping[str, str]
) -> Preparation:
    """As ``load_preparation``, of a file's text that came with a request: tables that it names are those that
    ``files`` allows, its background is one of the ``recordings``, files by the names that their owner gave
    them. ScenarioError if it is wrong.
    """

    def background(name: str) -> str:
        if name not in recordings:
            raise ScenarioError(
                f"background: there is no recording {quoted_value(name)} here; load it, or choose another one"
            )
        return recordings[name]

    return _preparation(parse_yaml(text, "prepare"), "prepare", files, background)


def _preparation(
    data: Any, origin: str, files: FileAccess, background_of: Callable[[str], Path | str]
) -> Preparation:
    """A preparation of its file's contents, with the tables that it names."""
    bench = None
    if isinstance(data, dict) and isinstance(data.get("bench"), str):
        bench = load_bench(data.pop("bench"), files.under("bench"))
    preparation = validate_part(Preparation, data if data is not None else {}, origin=origin)
    if bench is not None:
        preparation = preparation.model_copy(update={"bench": bench})
    tables = [stage for stage in preparation.response if stage.file is not None]
    chain = tuple(
        _with_table(stage, files) if stage in tables else stage for stage in preparation.response
    )
    if preparation.background is None:
        background = None
    else:
        background = str(background_of(preparation.background))
    frf = preparation.table_frf
    if frf is not None and frf.file is not None:
        where = files.under("table_frf.file").path(frf.file)
        frf = frf.model_copy(update={"measured": read_table_response(where)})
    return preparation.model_copy(
        update={"response": chain, "background": background, "table_frf": frf}
    )


def _with_table(stage: Stage, files: FileAccess) -> Stage:
    """A stage with the rows of its table; ScenarioError says which row is wrong."""
    path = files.under("response.file").path(stage.file)
    rows = []
    for number, row in enumerate(
        dict_rows(path, [name for name, _ in _RESPONSE_COLUMNS], ScenarioError), 2
    ):
        try:
            values = tuple(float(row.get(name) or default) for name, default in _RESPONSE_COLUMNS)
        except ValueError:
            values = (math.nan,)
        if not all(map(math.isfinite, values)):
            raise ScenarioError(
                f"{path}, row {number}: expected numbers in the columns frequency_hz, magnitude"
                " and, if known, phase_deg"
            )
        rows.append(values)
    return validate_part(
        Stage, {"kind": "table", "file": str(stage.file), "rows": rows}, si=True, origin=str(path)
    )


_RESPONSE_COLUMNS = (("frequency_hz", "nan"), ("magnitude", "nan"), ("phase_deg", "0"))


def read_prepared(path: Path | str, preparation: Preparation | None = None) -> Prepared:
    """A recording, and its background, after the steps of ``preparation``; RecordingError says what
    does not go.
    """
    if preparation is None:
        return Prepared(read_recording(path))
    wanted = frozenset(name.lstrip("-") for name in preparation.channels.values())
    hints = Hints(
        preparation.sample_rate,
        preparation.time,
        preparation.units,
        preparation.sensitivity,
        wanted,
    )
    recording = preparation.apply(_read(Path(path), hints))
    if preparation.background is None:
        return Prepared(recording, response_known=bool(preparation.response))
    whole = preparation.model_copy(update={"start": None, "stop": None})
    background = whole.apply(_read(Path(preparation.background), hints))
    return beside_background(recording, background, bool(preparation.response))


def beside_background(
    recording: Recording, background: Recording, response_known: bool = False
) -> Prepared:
    """A recording and its background; RecordingError where their sample rates differ."""
    if background.sample_rate != recording.sample_rate:
        raise RecordingError(
            f"{background.title}: was sampled at {background.sample_rate:g} Hz and the recording at"
            f" {recording.sample_rate:g} Hz; a background needs the recording's sample rate"
        )
    return Prepared(recording, background, response_known)


def check_output(path: Path) -> None:
    """RecordingError where a recording cannot be written to ``path``: kind not known, or a file
    there already.
    """
    if path.suffix.lower() not in WRITERS:
        raise RecordingError(
            f"{path}: '{path.suffix}' is not known; recordings are written to {', '.join(WRITERS)}"
        )
    if path.exists():
        raise OutputError(f"{path}: already exists; nothing was written")
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path}: cannot be written: there is no folder {path.parent}")


def write_recording(recording: Recording, path: Path | str) -> None:
    """Write UFF 58 (binary), MATLAB v5 or CSV, by the file's ending; whole or not at all, and never
    over a file.
    """
    path = Path(path)
    check_output(path)
    write_file(path, partial(WRITERS[path.suffix.lower()], recording))


def _write_uff(recording: Recording, path: Path) -> None:
    at = Even(0.0, 1.0 / recording.sample_rate)
    sets = [
        Dataset58(
            name, FUNCTIONS["time"], np.asarray(x, dtype=float), at, recording.units.get(name, ""), recording.title, Place(1)
        )
        for name, x in recording.channels.items()
    ]  # fmt: skip
    write_datasets(path, sets)


def _write_mat(recording: Recording, path: Path) -> None:
    from scipy.io import savemat

    units = {name: unit for name, unit in recording.units.items() if unit}
    data = {"fs": recording.sample_rate, "units": units} | {
        name: np.asarray(x) for name, x in recording.channels.items()
    }
    savemat(path, data, oned_as="column")


def _write_csv(recording: Recording, path: Path) -> None:
    t = np.arange(recording.samples) / recording.sample_rate
    names = list(recording.channels)
    header = csv_text(
        [["time", *names], ["s", *(recording.units.get(n, "") or "-" for n in names)]]
    ).rstrip("\n")
    np.savetxt(
        path,
        np.column_stack([t, *recording.channels.values()]),
        delimiter=",",
        header=header,
        comments="",
        fmt="%.12g",
    )


WRITERS: dict[str, Callable[[Recording, Path], None]] = {
    ".uff": _write_uff,
    ".mat": _write_mat,
    ".csv": _write_csv,
}
