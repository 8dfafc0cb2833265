"""Formats of recordings: what each file says of its channels, handed to the one path in ``measured``."""

from __future__ import annotations

import logging
import logging.handlers
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.delimited import read_delimited
from microvib.io.hdf5 import MAX_BYTES, Dataset, open_hdf5
from microvib.io.matlab import read_matlab
from microvib.io.measured import Column, Hints, Time, recording_of, stated_rates
from microvib.io.structs import columns_of
from microvib.testdata.channels import is_time
from microvib.testdata.recording import Recording, RecordingError

Reader = Callable[[Path, Hints], Recording]


def library(name: str, package: str) -> Any:
    """A library of the extra ``test-data``; RecordingError where it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise RecordingError(f"{package} is not installed; pip install 'microvib[test-data]'") from None


def _read_uff(path: Path, hints: Hints) -> Recording:
    pyuff = library("pyuff", "pyuff")
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
    return recording_of(path, [_column_58(path, s, k) for k, s in enumerate(sets)], hints)


def _column_58(path: Path, s: dict[str, Any], k: int) -> Column:
    name = s["id1"].strip() or f"channel {k + 1}"
    x = np.asarray(s["data"])
    if (
        int(s.get("func_type", 1)) not in (0, 1)
        or int(s.get("abscissa_spec_data_type", 17)) not in (0, 1, 17)
        or x.dtype.kind == "c"
    ):
        raise RecordingError(f"{path}: channel {name} is not a time history but a spectrum or another function")
    samples = int(s["num_pts"])
    if x.size < samples:
        raise RecordingError(f"{path}: channel {name} is truncated, {x.size} of {samples} samples")
    if x.size > samples + 1:  # a line's end may read as one
        raise RecordingError(f"{path}: channel {name} is broken; it has {x.size} samples and says {samples}")
    x = x[:samples]
    unit = _label(s, "ordinate")
    if int(s.get("abscissa_spacing", 1)) != 1:
        return Column(
            name,
            x.astype(float),
            unit,
            time=Time("abscissa", np.asarray(s["x"], dtype=float)[:samples], _label(s, "abscissa")),
        )
    step = float(s["abscissa_inc"])
    axis = Time("abscissa", float(s.get("abscissa_min", 0.0)) + step * np.arange(x.size), _label(s, "abscissa"))
    return Column(name, x.astype(float), unit, time=axis, start=float(axis.values[0]))


def _label(s: dict[str, Any], axis: str) -> str:
    text = str(s.get(f"{axis}_axis_units_lab", "")).strip()
    return "" if text.upper() == "NONE" else text


def _read_mat(path: Path, hints: Hints) -> Recording:
    return recording_of(path, columns_of(read_matlab(path)), hints, mixed=True)


def _read_netcdf(path: Path, hints: Hints) -> Recording:
    with path.open("rb") as stream:
        start = stream.read(3)
    if start == b"CDF":
        raise RecordingError(f"{path}: is netCDF 3; netCDF 4 is read, made by: nccopy -k nc4 {path.name} new.nc")
    with open_hdf5(path) as root:
        variables = {
            k: x for k, x in root.members().items() if isinstance(x, Dataset) and x.numeric and _is_variable(x)
        }
        said = {k: root.attribute(k) for k in ("fs", "sample_rate", "sample_rate_hz", "sampling_frequency")}
        said |= {k: float(x.numbers().ravel()[0]) for k, x in variables.items() if x.shape in ((), (1,))}
        rates = stated_rates({k: v for k, v in said.items() if isinstance(v, float)})
        columns = [
            Column(k, _decoded(x), str(x.attribute("units") or ""), rates)
            for k, x in variables.items()
            if len(x.shape) == 1 and x.shape[0] > 1
        ]
    names = [c.name for c in columns]
    if "T_d" in names and "Mz" not in names:  # a motion of ours: what a table would feel about the drive axis
        columns = [
            Column("Mz", c.values, "N*m", c.rates) if c.name == "T_d" else c
            for c in columns
            if c.name in ("T_d", "time")
        ]
    return recording_of(path, columns, hints, mixed=True)


def _is_variable(x: Dataset) -> bool:
    return not str(x.attribute("NAME") or "").startswith("This is a netCDF dimension but not a netCDF variable")


def _decoded(x: Dataset) -> np.ndarray:
    """Numbers as the conventions of netCDF mean them: missing ones nan, then scaled and shifted."""
    raw = x.numbers(whole=True)
    values = raw.astype(float)
    for name in ("_FillValue", "missing_value"):
        fill = x.attribute(name)
        if isinstance(fill, float):
            values[raw == np.asarray(fill).astype(raw.dtype)] = np.nan
    scale, shift = x.attribute("scale_factor"), x.attribute("add_offset")
    if isinstance(scale, str) or isinstance(shift, str):
        raise RecordingError(f"{x.where}: its scale_factor or add_offset is a text; a number is expected")
    return values * (1.0 if scale is None else scale) + (0.0 if shift is None else shift)


def _read_tdms(path: Path, hints: Hints) -> Recording:
    nptdms = library("nptdms", "npTDMS")
    with (
        _complaints(path, "nptdms"),
        path.open("rb") as stream,
        nptdms.TdmsFile.open(stream) as file,
    ):  # a stream: no index file beside it is taken
        channels = [c for group in file.groups() for c in group.channels()]
        if sum(len(c) for c in channels) > min(path.stat().st_size, MAX_BYTES // 8):
            raise RecordingError(f"{path}: is broken or truncated; it says that it has more values than it can hold")
        numeric = [c for c in channels if c.data_type is None or getattr(c.dtype, "kind", "O") in "fiu"]
        names = [c.name for c in numeric]
        return recording_of(path, [_tdms_column(path, c, names.count(c.name) > 1) for c in numeric if len(c)], hints)


@contextmanager
def _complaints(path: Path, library: str) -> Iterator[None]:
    """RecordingError for the first thing that a library says in its log about a file that it reads all the same."""
    said = logging.handlers.BufferingHandler(1000)
    names = [name for name in list(logging.root.manager.loggerDict) if name.split(".")[0] == library]
    handlers = {name: logging.getLogger(name).handlers for name in names}
    try:
        for name in names:
            logging.getLogger(name).handlers = [said]
        yield
    finally:
        for name in names:
            logging.getLogger(name).handlers = handlers[name]
    if said.buffer:
        raise RecordingError(f"{path}: is broken or truncated: {said.buffer[0].getMessage()[:300]}")


def _tdms_column(path: Path, channel: Any, grouped: bool) -> Column:
    """A channel; by group and name where its name is in several groups."""
    name = f"{channel.group_name}/{channel.name}" if grouped else channel.name
    given = {k: str(v).strip() for k, v in channel.properties.items() if k.lower() in _TDMS_UNITS and str(v).strip()}
    if len(set(given.values())) > 1:
        raise RecordingError(
            f"{path}: channel {name} has two units: {', '.join(f'{v} by {k}' for k, v in given.items())}"
        )
    rates = {}
    if "wf_increment" in channel.properties and not is_time(channel.name):
        step = float(channel.properties["wf_increment"])
        rates["wf_increment"] = 1.0 / step if step else np.inf
    start = channel.properties.get("wf_start_offset")
    values = np.asarray(channel[:], dtype=float)
    return Column(name, values, next(iter(given.values()), ""), rates, start=None if start is None else float(start))


_TDMS_UNITS = ("unit_string", "unit", "units", "ni_unitdescription", "engineering_units")
READERS: dict[str, Reader] = {
    ".uff": _read_uff,
    ".unv": _read_uff,
    ".mat": _read_mat,
    ".nc": _read_netcdf,
    ".tdms": _read_tdms,
    ".csv": read_delimited,
    ".txt": read_delimited,
}
"""Endings of files and what reads them."""
