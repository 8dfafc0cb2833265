"""Formats of recordings: what each file says of its channels, handed to the one path in
``measured``.
"""

from __future__ import annotations

import logging
import logging.handlers
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from microvib.io.delimited import read_delimited
from microvib.io.files import library, suppress_output
from microvib.io.hdf5 import MAX_BYTES, Dataset, Group, open_hdf5
from microvib.io.labview import read_labview
from microvib.io.matlab import read_matlab
from microvib.io.measured import Axis, Column, Hints, recording_of, stated_rates
from microvib.io.sound import read_sound
from microvib.io.stated_scales import names_factor
from microvib.io.structs import columns_of
from microvib.io.uff import read_uff
from microvib.testdata.channels import is_time
from microvib.testdata.recording import Recording, RecordingError

Reader = Callable[[Path, Hints], Recording]


def _read_mat(path: Path, hints: Hints) -> Recording:
    return recording_of(columns_of(read_matlab(path)), hints, mixed=True)


def _read_netcdf(path: Path, hints: Hints) -> Recording:
    with path.open("rb") as stream:
        if stream.read(3) == b"CDF":
            raise RecordingError(
                f"is netCDF 3; netCDF 4 is read, made by: nccopy -k nc4 {path.name} new.nc"
            )
    with open_hdf5(path) as root:
        variables = {name: x for name, x in root.members().items() if _is_variable(x)}
        rates = _netcdf_rates(root, variables)
        columns = [
            Column(
                name,
                _decoded(x),
                str(x.attribute("units") or ""),
                rates,
                scales=_root_factors(root) | _not_of_the_convention(x),
                units={
                    f"in its {name}": str(x.attribute(name))
                    for name in ("units", "unit")
                    if x.attribute(name)
                },
                remarks=_netcdf_remarks(root, x),
            )
            for name, x in variables.items()
            if len(x.shape) == 1 and x.shape[0] > 1
        ]
    return recording_of(_torque_of_motion(columns), hints, mixed=True)


def _root_factors(root: Group) -> dict[str, Any]:
    """Attributes of the file that may be factors of all its variables."""
    return {name: root.attribute(name) for name in root.attributes() if names_factor(name)}


def _netcdf_remarks(root: Group, x: Dataset) -> tuple[str, ...]:
    """Free texts about a variable, and about the file."""
    texts = [x.attribute("long_name"), *(root.attribute(name) for name in _NETCDF_TEXTS)]
    return tuple(text for text in texts if isinstance(text, str))


def _is_variable(x: Group | Dataset) -> TypeGuard[Dataset]:
    return isinstance(x, Dataset) and x.numeric and _NO_VARIABLE not in str(x.attribute("NAME"))


def _netcdf_rates(root: Group, variables: dict[str, Dataset]) -> dict[str, float]:
    """Sample rates [Hz] that attributes of the file, or variables of one value, say."""
    said: dict[str, Any] = {name: root.attribute(name) for name in _RATE_ATTRIBUTES}
    for name, x in variables.items():
        if x.shape in ((), (1,)):
            said[name] = float(x.numbers().ravel()[0])
    return stated_rates({name: value for name, value in said.items() if value is not None})


def _torque_of_motion(columns: list[Column]) -> list[Column]:
    """Torque about the drive axis of a motion file of microvib; other files unchanged."""
    by_name = {column.name: column for column in columns}
    if "T_d" not in by_name or "Mz" in by_name:
        return columns
    by_name["T_d"] = replace(by_name["T_d"], name="Mz", unit="N*m")
    return [column for name, column in by_name.items() if name in ("T_d", "time")]


def _not_of_the_convention(x: Dataset) -> dict[str, Any]:
    """Attributes of a variable that the conventions of netCDF do not mean, such as a converter's
    sensitivity.
    """
    if any(isinstance(x.attribute(name), float) for name in ("scale_factor", "add_offset")):
        return {}
    known = ("NAME", "CLASS", "units", "_FillValue", "missing_value", "long_name", "standard_name")
    return {
        name: x.attribute(name)
        for name in x.attributes()
        if name not in known and not name.startswith(("valid_", "actual_"))
    }


_RATE_ATTRIBUTES = ("fs", "sample_rate", "sample_rate_hz", "sampling_frequency")
_NETCDF_TEXTS = ("title", "comment", "summary", "description")
_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"


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
        raise RecordingError(
            f"{x.where}: its scale_factor or add_offset is a text; a number is expected"
        )
    return values * (1.0 if scale is None else scale) + (0.0 if shift is None else shift)


def _read_tdms(path: Path, hints: Hints) -> Recording:
    nptdms = library("nptdms")
    # A stream: no index file beside it is taken.
    with (
        suppress_output(),
        _logged_errors("nptdms"),
        path.open("rb") as stream,
        nptdms.TdmsFile.open(stream) as file,
    ):
        channels = [c for group in file.groups() for c in group.channels()]
        if sum(len(c) for c in channels) > min(path.stat().st_size, MAX_BYTES // 8):
            raise RecordingError(
                "is corrupt or truncated; it declares more values than it can hold"
            )
        numeric = [
            c for c in channels if c.data_type is None or getattr(c.dtype, "kind", "O") in "fiu"
        ]
        names = [c.name for c in numeric]
        began = {c.path: c.properties.get("wf_start_time") for c in numeric if len(c)}
        times = {path: np.datetime64(t, "us") for path, t in began.items() if t is not None}
        first = min(times.values(), default=np.datetime64(0, "us"))
        columns = []
        for c in numeric:
            if len(c):
                clock = (times.get(c.path, first) - first) / np.timedelta64(1, "s")
                column = _tdms_column(c, names.count(c.name) > 1)
                around = [file, file[c.group_name]]
                columns.append(replace(_with_said_around(column, around), clock=float(clock)))
        return recording_of(columns, hints)


@contextmanager
def _logged_errors(library: str) -> Iterator[None]:
    """RecordingError for the first thing that a library says in its log about a file that it reads
    all the same.
    """
    said = logging.handlers.BufferingHandler(1000)
    names = [
        name for name in list(logging.root.manager.loggerDict) if name.split(".")[0] == library
    ]
    handlers = {name: logging.getLogger(name).handlers for name in names}
    try:
        for name in names:
            logging.getLogger(name).handlers = [said]
        yield
    finally:
        for name in names:
            logging.getLogger(name).handlers = handlers[name]
    if said.buffer:
        raise RecordingError(f"is corrupt or truncated: {said.buffer[0].getMessage()[:300]}")


def _tdms_column(channel: Any, grouped: bool) -> Column:
    """A channel; by group and name where its name is in several groups."""
    name = channel.name
    if grouped:
        name = f"{channel.group_name}/{channel.name}"
    said = {
        k: v for k, v in channel.properties.items() if isinstance(v, (str, int, float, np.number))
    }
    axis = None
    if "wf_increment" in said and not is_time(channel.name):
        axis = _waveform_axis(said)
    rates = stated_rates({k: v for k, v in said.items() if not k.startswith("wf_")})
    values = np.asarray(channel[:], dtype=float)
    units = {f"in its {key}": unit for key, unit in _tdms_units(channel).items()}
    unit = next(iter(units.values()), "")
    return Column(name, values, unit, rates, axis=axis, scales=_tdms_scales(channel), units=units)


def _with_said_around(column: Column, around: Sequence[Any]) -> Column:
    """A channel with the units, factors and texts that its file and its group have."""
    scales: dict[str, Any] = {}
    units: dict[str, str] = {}
    for holder, what in zip(around, ("file", "group"), strict=True):
        scales |= _tdms_scales(holder)
        units |= {f"in {key} of its {what}": unit for key, unit in _tdms_units(holder).items()}
    unit = column.unit or next(reversed(units.values()), "")
    scales |= column.scales
    return replace(column, unit=unit, scales=scales, units=dict(column.units) | units)


def _tdms_scales(holder: Any) -> dict[str, Any]:
    """Numbers and texts among the properties of a file, a group or a channel, but for those of LabVIEW's waveforms."""
    return {
        name: value
        for name, value in holder.properties.items()
        if isinstance(value, (str, int, float, np.number)) and not name.startswith(("wf_", "NI_"))
    }


def _tdms_units(holder: Any) -> dict[str, str]:
    """Units that the properties of a file, a group or a channel say, by property."""
    return {
        key: str(value).strip()
        for key, value in holder.properties.items()
        if key.lower() in _TDMS_UNITS and str(value).strip()
    }


def _waveform_axis(said: dict[str, Any]) -> Axis:
    x = {key.lower(): str(value).strip() for key, value in said.items()}
    offset = said.get("wf_start_offset")
    return Axis(
        "wf_increment",
        float(said["wf_increment"]),
        None if offset is None else float(offset),
        x.get("wf_xunit_string", ""),
        x.get("wf_xname", ""),
    )


_TDMS_UNITS = (
    "unit_string",
    "unit",
    "units",
    "ni_unitdescription",
    "engineering_units",
    "eu",
    "einheit",
)
READERS: dict[str, Reader] = {
    ".uff": read_uff,
    ".unv": read_uff,
    ".ufb": read_uff,
    ".mat": _read_mat,
    ".nc": _read_netcdf,
    ".tdms": _read_tdms,
    ".csv": read_delimited,
    ".txt": read_delimited,
    ".asc": read_delimited,
    ".lvm": read_labview,
    ".wav": read_sound,
}
"""Endings of files and what reads them."""
