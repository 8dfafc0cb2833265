"""Channels among the variables of MATLAB files, as people and test software lay them out."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from microvib.io.measured import Column, stated_rates
from microvib.testdata.channels import is_time
from microvib.testdata.recording import RecordingError

_VALUES = ("values", "value", "data", "samples", "signal", "signals", "y", "ydata")
_NAMES = ("names", "name", "labels", "label", "channels", "channelnames", "channelname", "signalname", "signalnames")
_UNITS = ("units", "unit", "unitstring", "eu", "engunits", "yunit", "yunits")
_LOOSE = (
    "header", "info", "properties", "quantity", "functionrecord", "abscissa", "ordinate", "unittransformation", "meta",
)  # fmt: skip
"""Fields whose content belongs to the struct that they stand in."""
_SCALES = ("scale", "scaling", "scalefactor", "gain", "slope", "offset", "bias")
"""What turns a converter's counts into a unit."""
_DEEPEST = 6


def columns_of(variables: Mapping[str, Any]) -> list[Column]:
    """Channels of a file's variables, each with the rates, time axis, name and unit that the struct about it says."""
    return list(_scope("", _joined(_paired(dict(variables))), {}, None, 0))


def _word(name: str) -> str:
    return re.sub(r"[ _-]", "", name).lower()


def _of(fields: Mapping[str, Any], words: tuple[str, ...]) -> Any:
    by_word = {_word(name): value for name, value in fields.items()}
    return next((by_word[word] for word in words if word in by_word and not isinstance(by_word[word], Mapping)), None)


def _texts(x: Any) -> list[str]:
    if isinstance(x, str):
        return [x.strip()]
    return [str(text).strip() for text in x] if isinstance(x, list) and all(isinstance(text, str) for text in x) else []


def _paired(fields: dict[str, Any]) -> dict[str, Any]:
    """Channels that are spread over variables as one struct each: NAME_Data with NAME_Header, DataK_time_NAME with DataK_NAME."""
    out = dict(fields)
    for name in fields:
        stem, data = name.removesuffix("_Header"), name.removesuffix("_Header") + "_Data"
        if name.endswith("_Header") and isinstance(fields[name], Mapping) and isinstance(fields.get(data), np.ndarray):
            out[stem] = {**out.pop(name), "data": out.pop(data)}
        time = re.fullmatch(r"(Data\d+)_time_(.+)", name, re.IGNORECASE)
        if time and f"{time[1]}_{time[2]}" in fields:
            out[time[2]] = {"data": out.pop(f"{time[1]}_{time[2]}"), "time": out.pop(name)}
    return out


def _joined(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a struct with those of the structs in it that only describe it; x_values and y_values become time step and data."""
    by_word = {_word(name): value for name, value in fields.items()}
    x, y = by_word.get("xvalues"), by_word.get("yvalues")
    out: dict[str, Any] = {}
    for name, value in fields.items():
        if (
            isinstance(value, Mapping)
            and _word(name) in _LOOSE
            and not {"xvalues", "yvalues"} & {_word(k) for k in value}
        ):
            out |= {k: v for k, v in _joined(value).items() if k not in fields}
        else:
            out[name] = value
    if isinstance(x, Mapping) and isinstance(y, Mapping):
        out = {k: v for k, v in out.items() if _word(k) not in ("xvalues", "yvalues")}
        out |= {k: v for k, v in x.items() if _word(k) in ("increment", "delta")}
        quantity = y.get("quantity")
        out |= {"data": y.get("values"), "unit": quantity.get("label", "") if isinstance(quantity, Mapping) else ""}
    return out


def _scope(
    name: str, fields: Mapping[str, Any], rates: Mapping[str, float], time: Column | None, depth: int
) -> Iterator[Column]:
    """Channels of one struct; what it says of rate and time holds for those within, too."""
    at = f"{name}." if name else ""
    numbers = {k: np.asarray(v, dtype=float) for k, v in map(_stacked, fields.items()) if v is not None}
    rates = {**rates, **stated_rates({at + k: float(v) for k, v in numbers.items() if v.size == 1})}
    axes = [Column(at + k, v) for k, v in numbers.items() if v.ndim == 1 and v.size > 1 and is_time(k)]
    if name and axes:
        time = axes[0]
    names, units = _texts(_of(fields, _NAMES)), _of(fields, _UNITS)
    unit_of = {k: str(v) for k, v in units.items()} if isinstance(units, Mapping) else {}
    for key, value in fields.items():
        if isinstance(value, Mapping) and _word(key) in _UNITS:
            unit_of |= {k: v for k, v in value.items() if isinstance(v, str)}
    listed = _texts(units)
    for key, values in numbers.items():
        own = f"{at}{key}"
        if values.size < 2 or values.ndim > 2 or (name and any(axis.name == own for axis in axes)):
            continue
        _check_counts(at, key, fields, numbers)
        if values.ndim == 2:
            yield from _matrix(own, values, names, listed, rates, time)
            continue
        single = _word(key) in _VALUES and name
        label = (names[0] if single and len(names) == 1 and names[0] else name) if single else own
        unit = unit_of.get(key) or (listed[names.index(key)] if key in names and len(listed) == len(names) else "")
        if not unit and len(listed) == 1 and (single or len(numbers) == 1):
            unit = listed[0]
        yield Column(label, values, unit, rates, _fitting(time, values))
    if depth < _DEEPEST:
        yield from _below(at, fields, rates, time, depth)


def _check_counts(at: str, key: str, fields: Mapping[str, Any], numbers: Mapping[str, np.ndarray]) -> None:
    """RecordingError for counts of a converter beside their scale: samples that are in no unit, whatever stands beside them."""
    if getattr(fields[key], "dtype", np.dtype(float)).kind not in "iu":
        return
    scale = next((k for k, v in numbers.items() if _word(k) in _SCALES and np.any((v != 0.0) & (v != 1.0))), None)
    if scale is not None:
        raise RecordingError(
            f"{at}{key} has whole numbers beside {at}{scale}: counts of a converter, which nothing scales here; save the channel"
            " in its unit"
        )


def _stacked(item: tuple[str, Any]) -> tuple[str, np.ndarray | None]:
    """A field's numbers; cells of vectors of one length as the columns of a matrix."""
    key, value = item
    if isinstance(value, list) and value and all(isinstance(x, np.ndarray) and x.ndim == 1 for x in value):
        value = np.column_stack(value) if len({x.size for x in value}) == 1 else None
    return key, value if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" else None


def _below(
    at: str, fields: Mapping[str, Any], rates: Mapping[str, float], time: Column | None, depth: int
) -> Iterator[Column]:
    for key, value in fields.items():
        several = value if isinstance(value, list) else [value]
        for k, item in enumerate(several):
            if isinstance(item, Mapping) and _word(key) not in _UNITS:
                inner = f"{at}{key}" + (f"({k + 1})" if len(several) > 1 else "")
                yield from _scope(inner, _joined(_paired(dict(item))), rates, time, depth + 1)


def _matrix(
    name: str, values: np.ndarray, names: list[str], units: list[str], rates: Mapping[str, float], time: Column | None
) -> Iterator[Column]:
    """Columns of a matrix of samples, its longer axis being time; time itself may be one of them."""
    rows = values if values.shape[0] >= values.shape[1] else values.T
    if rows.shape[0] < 8:
        return
    named = names if len(names) == rows.shape[1] else [f"{name}({k + 1})" for k in range(rows.shape[1])]
    given = units if len(units) == rows.shape[1] else units * rows.shape[1] if len(units) == 1 else [""] * rows.shape[1]
    axis = next((k for k, text in enumerate(named) if is_time(text)), None)
    if axis is not None:
        time = Column(named[axis], rows[:, axis], given[axis])
    for k, text in enumerate(named):
        if k != axis:
            yield Column(text, rows[:, k], given[k], rates, _fitting(time, rows[:, k]))


def _fitting(time: Column | None, values: np.ndarray) -> Column | None:
    return time if time is not None and time.values.size == values.size else None
