"""Doors for recordings: UFF 58, MATLAB, TDMS, CSV, netCDF; out as UFF 58, MATLAB and CSV."""

from __future__ import annotations

import csv
import os
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError, OutputError
from microvib.io.hdf5 import Dataset, open_hdf5
from microvib.io.matlab import read_matlab
from microvib.io.scenario_file import read_text
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validated
from microvib.signals.preparation import Preparation
from microvib.signals.recording import COMPONENTS, Recording, RecordingError, regular_rate, snapped_rate

LARGEST = 2_000_000_000
"""Bytes of the largest recording that is read."""


def read_recording(path: Path | str, sample_rate: float | None = None) -> Recording:
    """Channels of a recording, in SI; the format follows from the file's ending. RecordingError says what is wrong.

    ``sample_rate`` [Hz] is needed only where the file has no time axis.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(f"{path}: '{path.suffix}' is not known; recordings are read from {', '.join(READERS)}")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    if size > LARGEST:
        raise RecordingError(f"{path}: has {size / 1e9:.1f} GB; recordings of at most {LARGEST / 1e9:g} GB are read")
    try:
        recording = reader(path, sample_rate)
    except MicrovibError as error:
        raise RecordingError(str(error)) from None
    except MemoryError:
        raise RecordingError(f"{path}: needs more memory than there is") from None
    except Exception as error:  # the libraries raise whatever they meet in a broken file
        raise RecordingError(
            f"{path}: is broken or truncated, or not of its kind ({type(error).__name__}: {error})"
        ) from None
    if not recording.channels:
        raise RecordingError(f"{path}: has no channels")
    sizes = {name: x.size for name, x in recording.channels.items()}
    if len(set(sizes.values())) > 1:
        raise RecordingError(f"{path}: its channels differ in length: {sizes}")
    return recording.in_si()


@dataclass(frozen=True)
class Prepared:
    """A recording that was prepared, and the background of its table where there is one."""

    recording: Recording
    background: Recording | None = None


def load_preparation(path: Path | str) -> Preparation:
    """How to prepare recordings, from a YAML file; its background is found relative to the file. ScenarioError if it is wrong."""
    path = Path(path)
    data = parse_yaml(read_text(path, "preparation", ()), str(path))
    preparation = validated(Preparation, data if data is not None else {}, units_required=True, origin=str(path))
    if preparation.background is None:
        return preparation
    return preparation.model_copy(update={"background": str(path.parent / preparation.background)})


def read_prepared(path: Path | str, preparation: Preparation | None = None) -> Prepared:
    """A recording, and its background, after the steps of ``preparation``; RecordingError says what does not go."""
    if preparation is None:
        return Prepared(read_recording(path))
    recording = preparation.apply(read_recording(path, preparation.sample_rate))
    if preparation.background is None:
        return Prepared(recording)
    whole = preparation.model_copy(update={"start": None, "stop": None})
    background = whole.apply(read_recording(preparation.background, preparation.sample_rate))
    if background.sample_rate != recording.sample_rate:
        raise RecordingError(
            f"{background.title}: was sampled at {background.sample_rate:g} Hz and the recording at"
            f" {recording.sample_rate:g} Hz; a background needs the recording's sample rate"
        )
    return Prepared(recording, background)


def _library(name: str, package: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise RecordingError(f"{package} is not installed; pip install 'microvib[test-data]'") from None


def _read_uff(path: Path, sample_rate: float | None) -> Recording:
    pyuff = _library("pyuff", "pyuff")
    with path.open("rb") as stream:
        stream.seek(max(path.stat().st_size - 200, 0))
        if not stream.read().rstrip().endswith(b"-1"):  # each dataset ends so; the library drops one that does not
            raise RecordingError(f"{path}: is truncated, or no UFF; its last dataset does not end with -1")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sets = pyuff.UFF(str(path)).read_sets()
    sets = [s for s in (sets if isinstance(sets, list) else [sets]) if s.get("type") == 58]
    if not sets:
        raise RecordingError(f"{path}: has no dataset 58")
    channels: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: set[float] = set()
    notes: list[str] = []
    for s in sets:
        x = np.asarray(s["data"], dtype=float)
        if x.size < int(s["num_pts"]):
            raise RecordingError(
                f"{path}: channel {s['id1'].strip()} is truncated, {x.size} of {int(s['num_pts'])} samples"
            )
        name = s["id1"].strip() or f"channel {len(channels) + 1}"
        if name in channels:
            raise RecordingError(f"{path}: channel {name} is there twice")
        channels[name], units[name] = x, s.get("ordinate_axis_units_lab", "").strip()
        if int(s.get("abscissa_spacing", 1)) == 1:
            rate, note = snapped_rate(1.0 / float(s["abscissa_inc"]))
        else:
            rate, note = regular_rate(np.asarray(s["x"], dtype=float), str(path))
        rates.add(rate)
        notes.append(note)
    if len(rates) > 1:
        raise RecordingError(f"{path}: its channels have different sample rates: {sorted(rates)} Hz")
    return Recording(channels, rates.pop(), units, str(path), tuple(dict.fromkeys(n for n in notes if n)))


def _read_mat(path: Path, sample_rate: float | None) -> Recording:
    return _from_arrays(path, {k: x for k, x in read_matlab(path).items() if isinstance(x, np.ndarray)}, sample_rate)


def _read_netcdf(path: Path, sample_rate: float | None) -> Recording:
    with open_hdf5(path) as root:
        variables = {
            name: x for name, x in root.members().items() if isinstance(x, Dataset) and x.numeric and len(x.shape) == 1
        }
        data = {name: x.numbers() for name, x in variables.items()}
        units = {name: str(x.attribute("units") or "") for name, x in variables.items()}
    if "T_d" in data and "Mz" not in data:  # a motion of ours: what a table would feel about the drive axis
        data, units = {"time": data["time"], "Mz": data["T_d"]}, {"Mz": "N*m"}
    return _from_arrays(path, data, sample_rate, units)


def _from_arrays(
    path: Path, data: dict[str, Any], rate: float | None, units: dict[str, str] | None = None
) -> Recording:
    """Equal-length vectors of a file; one called time or t is the time axis, a scalar fs or sample_rate the rate."""
    arrays = {k: np.asarray(v, dtype=float) for k, v in data.items() if np.asarray(v).dtype.kind in "fiu"}
    scalars = {k.lower(): float(v) for k, v in arrays.items() if v.size == 1}
    vectors = {k: v for k, v in arrays.items() if v.ndim == 1 and v.size > 1}
    axis = next((k for k in vectors if k.lower() in ("time", "t", "time [s]", "time_s")), None)
    note = ""
    if axis is not None:
        rate, note = regular_rate(vectors.pop(axis), str(path))
    else:
        rate = rate or scalars.get("fs") or scalars.get("sample_rate")
    if not rate:
        raise RecordingError(
            f"{path}: has neither a time axis (time, t) nor a rate (fs, sample_rate); give the sample rate in Hz"
        )
    longest = max((v.size for v in vectors.values()), default=0)
    vectors = {k: v for k, v in vectors.items() if v.size == longest}
    return Recording(vectors, float(rate), units or {}, str(path), (note,) if note else ())


def _read_tdms(path: Path, sample_rate: float | None) -> Recording:
    tdms = _library("nptdms", "npTDMS").TdmsFile.read(str(path))
    channels, units, rates = {}, {}, set()
    for group in tdms.groups():
        for channel in group.channels():
            channels[channel.name] = np.asarray(channel[:], dtype=float)
            units[channel.name] = str(channel.properties.get("unit_string", ""))
            if "wf_increment" in channel.properties:
                rates.add(snapped_rate(1.0 / float(channel.properties["wf_increment"]))[0])
    if len(rates) > 1:
        raise RecordingError(f"{path}: its channels have different sample rates: {sorted(rates)} Hz")
    if rates:
        return Recording(channels, rates.pop(), units, str(path))
    return _from_arrays(path, channels, sample_rate, units)


def _read_csv(path: Path, sample_rate: float | None) -> Recording:
    """A header row, an optional row of units, then numbers; separator and decimal comma are found out."""
    text = path.read_text(encoding="utf-8-sig")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 10:
        raise RecordingError(f"{path}: has {len(lines)} rows; a header and samples are wanted")
    separator = max(";\t,", key=lambda s: min(line.count(s) for line in lines[:10]))
    comma = separator != "," and "," in lines[-1]
    names = [name.strip() for name in next(csv.reader([lines[0]], delimiter=separator))]
    rows = lines[1:]
    units: dict[str, str] = {}
    if not _numbers(rows[0], separator, comma):
        units = dict(
            zip(names, (u.strip(" []") for u in next(csv.reader([rows[0]], delimiter=separator))), strict=False)
        )
        rows = rows[1:]
    for k, name in enumerate(names):
        if name.endswith("]") and "[" in name:
            names[k], unit = (part.strip(" []") for part in name.split("[", 1))
            units[names[k]] = unit
    data = np.empty((len(rows), len(names)))
    for k, row in enumerate(rows):
        values = _numbers(row, separator, comma)
        if values is None or len(values) != len(names):
            raise RecordingError(f"{path}: row {k + 2} has not {len(names)} numbers: {row[:60]!r}")
        data[k] = values
    return _from_arrays(path, dict(zip(names, data.T, strict=True)), sample_rate, units)


def _numbers(row: str, separator: str, comma: bool) -> list[float] | None:
    try:
        return [float(v.replace(",", ".") if comma else v) for v in row.split(separator)]
    except ValueError:
        return None


READERS: dict[str, Callable[[Path, float | None], Recording]] = {
    ".uff": _read_uff,
    ".unv": _read_uff,
    ".mat": _read_mat,
    ".nc": _read_netcdf,
    ".tdms": _read_tdms,
    ".csv": _read_csv,
    ".txt": _read_csv,
}


def check_output(path: Path) -> None:
    """RecordingError where a recording cannot be written to ``path``: kind not known, or a file there already."""
    if path.suffix.lower() not in WRITERS:
        raise RecordingError(f"{path}: '{path.suffix}' is not known; recordings are written to {', '.join(WRITERS)}")
    if path.exists():
        raise OutputError(f"{path}: exists already; nothing was written")
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path}: cannot be written: there is no folder {path.parent}")


def write_recording(recording: Recording, path: Path | str) -> None:
    """Write UFF 58 (binary), MATLAB v5 or CSV, by the file's ending; whole or not at all, and never over a file."""
    path = Path(path)
    check_output(path)
    writer = WRITERS[path.suffix.lower()]
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.absolute().parent)
        os.close(handle)
        os.unlink(temporary)
        writer(recording, Path(temporary))
        os.rename(temporary, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)


def _write_uff(recording: Recording, path: Path) -> None:
    pyuff = _library("pyuff", "pyuff")
    t = np.arange(recording.samples) / recording.sample_rate
    for name, x in recording.channels.items():
        data = {
            "type": 58, "binary": 1, "func_type": 1, "rsp_node": 1, "rsp_dir": 0, "ref_node": 0, "ref_dir": 0,
            "id1": name, "id2": recording.title[-70:] or "microvib", "id3": "NONE", "id4": "NONE", "id5": "NONE",
            "ver_num": 0, "load_case_id": 0, "rsp_ent_name": "TABLE", "ref_ent_name": "NONE",
            "data": np.asarray(x, dtype=float), "x": t, "num_pts": x.size, "ord_data_type": 4,
            "abscissa_spacing": 1, "abscissa_min": 0.0, "abscissa_inc": 1.0 / recording.sample_rate, "z_axis_value": 0.0,
            "abscissa_spec_data_type": 17, "abscissa_axis_lab": "Time", "abscissa_axis_units_lab": "s",
            "ordinate_spec_data_type": 13 if name in COMPONENTS[:3] else 12, "ordinate_axis_lab": name,
            "ordinate_axis_units_lab": recording.units.get(name, "") or "NONE",
            "func_id": 0, "orddenom_spec_data_type": 0, "orddenom_axis_lab": "NONE", "orddenom_axis_units_lab": "NONE",
            "z_axis_spec_data_type": 0, "z_axis_axis_lab": "NONE", "z_axis_axis_units_lab": "NONE",
        }  # fmt: skip
        for axis in ("abscissa", "ordinate", "orddenom", "z_axis"):
            data |= {f"{axis}_{kind}_unit_exp": 0 for kind in ("len", "force", "temp")}
        pyuff.UFF(str(path)).write_sets([data], mode="add")


def _write_mat(recording: Recording, path: Path) -> None:
    data = {"fs": recording.sample_rate, **{name: np.asarray(x) for name, x in recording.channels.items()}}
    _library("scipy.io", "scipy").savemat(path, data, oned_as="column")


def _write_csv(recording: Recording, path: Path) -> None:
    t = np.arange(recording.samples) / recording.sample_rate
    names = list(recording.channels)
    header = ",".join(["time", *names]) + "\n" + ",".join(["s", *(recording.units.get(n, "") or "1" for n in names)])
    np.savetxt(
        path, np.column_stack([t, *recording.channels.values()]), delimiter=",", header=header, comments="", fmt="%.12g"
    )


WRITERS: dict[str, Callable[[Recording, Path], None]] = {".uff": _write_uff, ".mat": _write_mat, ".csv": _write_csv}
