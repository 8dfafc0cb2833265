"""Channels among the variables of MATLAB files, as people and test software lay them out."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np

from microvib.io.measured import STEPS, Axis, Column, stated_rates
from microvib.io.stated_scales import names_scale
from microvib.testdata.channels import as_load, is_time, named_unit, seconds_per

_VALUES = ("values", "value", "data", "samples", "signal", "signals", "y", "ydata")
_NAMES = (
    "names",
    "name",
    "labels",
    "label",
    "channels",
    "channelnames",
    "channelname",
    "signalname",
    "signalnames",
)
_UNITS = ("units", "unit", "unitstring", "eu", "engunits", "yunit", "yunits", "einheit")
_TRANSPARENT_FIELDS = (
    "header", "info", "properties", "quantity", "functionrecord", "abscissa", "ordinate", "unittransformation", "meta",
)  # fmt: skip
"""Fields whose content belongs to the struct that they stand in."""
_AXIS_UNITS = (
    "xunit", "xunits", "xunitstring", "xaxisunit", "abscissaunit", "abscissaunits", "timeunit", "timeunits", "tunit", "tunits",
    "dtunit", "dtunits", "stepunit", "incrementunit", "xlabel", "xunitlabel", "wfxunitstring",
)  # fmt: skip
"""Fields with the unit of the axis of the samples beside them."""
_AXIS_NAMES = ("xname", "xquantity", "abscissaname", "abscissalabel", "domain", "wfxname")
_AXIS_STARTS = ("start", "startvalue", "x0", "xstart", "t0", "tstart", "xmin", "xoffset", "xfirst")
_MAX_DEPTH = 6


def columns_of(variables: Mapping[str, Any]) -> list[Column]:
    """Channels of a file's variables, each with the rates, time axis, name and unit that the struct
    about it says.
    """
    return list(_scope("", _joined(_paired(dict(variables))), _StructContext(), 0))


def _word(name: str) -> str:
    return re.sub(r"[ _-]", "", name).lower()


def _of(fields: Mapping[str, Any], words: tuple[str, ...]) -> Any:
    by_word = {_word(name): value for name, value in fields.items()}
    return next(
        (
            by_word[word]
            for word in words
            if word in by_word and not isinstance(by_word[word], Mapping)
        ),
        None,
    )


def _texts(x: Any) -> list[str]:
    if isinstance(x, str):
        return [x.strip()]
    if isinstance(x, list) and all(isinstance(text, str) for text in x):
        return [str(text).strip() for text in x]
    return []


def _paired(fields: dict[str, Any]) -> dict[str, Any]:
    """Channels that are spread over variables as one struct each: NAME_Data with NAME_Header,
    DataK_time_NAME with DataK_NAME.
    """
    out = dict(fields)
    for name in fields:
        stem, data = name.removesuffix("_Header"), name.removesuffix("_Header") + "_Data"
        if (
            name.endswith("_Header")
            and isinstance(fields[name], Mapping)
            and isinstance(fields.get(data), np.ndarray)
        ):
            out[stem] = {**out.pop(name), "data": out.pop(data)}
        time = re.fullmatch(r"(Data\d+)_time_(.+)", name, re.IGNORECASE)
        if time and f"{time[1]}_{time[2]}" in fields:
            out[time[2]] = {"data": out.pop(f"{time[1]}_{time[2]}"), "time": out.pop(name)}
    return out


def _joined(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a struct with those of the structs in it that only describe it; x_values and
    y_values become time step and data.
    """
    by_word = {_word(name): value for name, value in fields.items()}
    x, y = by_word.get("xvalues"), by_word.get("yvalues")
    out: dict[str, Any] = {}
    for name, value in fields.items():
        if (
            isinstance(value, Mapping)
            and _word(name) in _TRANSPARENT_FIELDS
            and not {"xvalues", "yvalues"} & {_word(k) for k in value}
        ):
            out |= {k: v for k, v in _joined(value).items() if k not in fields}
        else:
            out[name] = value
    if isinstance(x, Mapping) and isinstance(y, Mapping):
        out |= {
            name: value for name, value in fields.items() if _word(name) in ("xvalues", "yvalues")
        }
    return out


@dataclass(frozen=True)
class _StructContext:
    """Metadata of samples from the structs that enclose them."""

    rates: Mapping[str, float] = field(default_factory=dict)
    time: Column | None = None
    axis: Axis | None = None
    scales: Mapping[str, Any] = field(default_factory=dict)
    unit: str = ""
    """Unit that the enclosing struct has for this one, in a field such as Mz_unit beside Mz."""

    def column(self, name: str, values: np.ndarray, unit: str, where: str) -> Column:
        """A channel whose samples are ``where`` in the file; the time axis is its own if it is as
        long.
        """
        if self.time is not None and self.time.values.size == values.size:
            time = self.time
        else:
            time = None
        return Column(
            name, values, unit, self.rates, time, self.axis, scales=self.scales, field=where
        )


@dataclass(frozen=True)
class _Struct:
    """One struct, or all variables of a file, under no name, with what it says of its channels."""

    name: str
    numbers: Mapping[str, np.ndarray]
    unit_of: Mapping[str, str]  # units by the fields that they are of
    unit_fields: Mapping[str, Mapping[str, str]]
    """Texts that are called units of a field, by their own fields."""
    axis_unit: str
    names: list[str]  # of channels, listed in one field
    units: list[str]

    @property
    def at(self) -> str:
        """Prefix of the names of its fields."""
        return f"{self.name}." if self.name else ""

    @cached_property
    def time_axes(self) -> dict[str, Column]:
        """Time axes by field."""
        return {
            key: Column(self.at + key, values, self.unit_of.get(key) or self.axis_unit)
            for key, values in self.numbers.items()
            if values.ndim == 1 and values.size > 1 and is_time(key)
        }

    @cached_property
    def channels(self) -> list[str]:
        """Fields that are samples of channels."""
        axes = self.time_axes
        return [key for key in self.numbers if key not in axes and self._may_be_channel(key)]

    def _may_be_channel(self, key: str) -> bool:
        values = self.numbers[key]
        if values.size <= _FEW and names_scale(key):
            return False
        return values.size >= 2 and values.ndim <= 2

    def columns(self, key: str, around: _StructContext) -> Iterator[Column]:
        """The channel that a field holds, or those of a matrix."""
        values, where = self.numbers[key], self.at + key
        if values.ndim == 2:
            units = self.units or [self.unit_of.get(key, "")]
            yield from _matrix(where, values, self.names, units, around)
        else:
            said = self._units(key, around.unit)
            own = next(iter(said.values()), "")
            yield replace(around.column(self._label(key), values, own, where), units=said)

    def _holds_values(self, key: str) -> bool:
        """Whether a field is called what the struct's own samples are."""
        return bool(self.name) and _word(key) in _VALUES

    def _label(self, key: str) -> str:
        if not self._holds_values(key):
            return self.at + key
        if len(self.names) == 1:
            return self.names[0] or self.name
        return self.name

    def _units(self, key: str, beside: str) -> dict[str, str]:
        """Units of a channel by where the struct, or a field ``beside`` it, says them; the first counts."""
        said = {"in a field of its own": self.unit_of.get(key, "")}
        if key in self.names and len(self.units) == len(self.names):
            said["in the list of units"] = self.units[self.names.index(key)]
        elif len(self.units) == 1 and (self._holds_values(key) or len(self.channels) == 1):
            said["in the struct's unit"] = self.units[0]
        if self._holds_values(key) or len(self.channels) == 1:
            said["in a field beside the struct"] = beside
        said |= {f"in {field}": unit for field, unit in self.unit_fields.get(key, {}).items()}
        return {where: unit for where, unit in said.items() if unit}


def _scope(
    name: str, fields: Mapping[str, Any], around: _StructContext, depth: int
) -> Iterator[Column]:
    """Channels of one struct; what it says of rate and time holds for those within, too."""
    by_word = {_word(key): value for key, value in fields.items()}
    x, y = by_word.get("xvalues"), by_word.get("yvalues")
    if isinstance(x, Mapping) and isinstance(y, Mapping):
        yield from _of_x_and_y(name, fields, x, y)
        return
    struct = _struct(name, fields)
    channels, axes = struct.channels, list(struct.time_axes.values())
    around = _with_what_is_said(struct.at, fields, channels, around)
    if name and axes:
        around = replace(around, time=axes[0])
    elif axes:
        yield from axes
    for key in channels:
        yield from struct.columns(key, _without_those_of_others(around, key, channels))
    if depth < _MAX_DEPTH:
        yield from _nested_columns(struct.at, fields, around, depth)


def _struct(name: str, fields: Mapping[str, Any]) -> _Struct:
    numbers = {
        key: np.asarray(values, dtype=float)
        for key, values in map(_stacked, fields.items())
        if values is not None
    }
    return _Struct(
        name,
        numbers,
        _unit_fields(fields),
        {key: _fields_of_unit(fields, key) for key in numbers},
        _axis_unit(fields),
        _texts(_of(fields, _NAMES)),
        _texts(_of(fields, _UNITS)),
    )


def _unit_fields(fields: Mapping[str, Any]) -> dict[str, str]:
    """Units by the fields that they are of: a struct ``units``, or fields such as ``Mz_unit``."""
    said = {key: _fields_of_unit(fields, key) for key in fields}
    found = {key: next(iter(units.values())) for key, units in said.items() if units}
    for key, value in fields.items():
        if isinstance(value, Mapping) and _word(key) in _UNITS:
            found |= {k: v.strip() for k, v in value.items() if isinstance(v, str)}
    return found


def _fields_of_unit(fields: Mapping[str, Any], key: str) -> dict[str, str]:
    """Texts that are called a unit of a field, by their own fields."""
    word = _word(key)
    names = [
        f"{word}unit",
        f"{word}units",
        f"unit{word}",
        f"units{word}",
        f"{word}eu",
        f"unitof{word}",
        f"{word}unitstring",
    ]
    texts = {_word(k): (k, v.strip()) for k, v in fields.items() if isinstance(v, str)}
    return dict(texts[name] for name in names if texts.get(name, ("", ""))[1])


def _axis_unit(fields: Mapping[str, Any]) -> str:
    unit = _of(fields, _AXIS_UNITS)
    if not isinstance(unit, str):
        return ""
    return named_unit(unit)[1] or unit.strip()  # a label such as Time (ms)


def _with_what_is_said(
    at: str, fields: Mapping[str, Any], channels: Sequence[str], around: _StructContext
) -> _StructContext:
    """Context of the samples, with rates, step of the axis and scales that this struct says."""
    said = {key: _text_or_number(value) for key, value in fields.items()}
    step = next((key for key in fields if STEPS.fullmatch(key) and _is_number(said[key])), None)
    axis = around.axis
    if step is not None:
        axis = _axis_with_step(at, fields, step, said)
        del said[step]
    rates = stated_rates({at + key: value for key, value in said.items() if value is not None})
    scales = {**around.scales, **_small(at, fields, channels)}
    return _StructContext({**around.rates, **rates}, around.time, axis, scales, around.unit)


def _text_or_number(value: Any) -> str | float | None:
    """A text or one number; None for anything else."""
    if isinstance(value, str):
        return value
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "fiub":
        return float(np.ravel(value)[0])
    return None


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, float)


def _axis_with_step(
    at: str, fields: Mapping[str, Any], step: str, said: Mapping[str, str | float | None]
) -> Axis:
    """The axis of the samples in a struct that says its step."""
    starts = (said[key] for key in fields if _word(key) in _AXIS_STARTS)
    quantity = _of(fields, _AXIS_NAMES)
    return Axis(
        at + step,
        float(said[step] or 0.0),
        next(filter(_is_number, starts), None),
        _unit_fields(fields).get(step) or _axis_unit(fields),
        quantity if isinstance(quantity, str) else "",
    )


def _small(at: str, fields: Mapping[str, Any], channels: Sequence[str]) -> dict[str, Any]:
    """Numbers and texts that are no channels, those of structs in it by their paths."""
    found: dict[str, Any] = {}
    for key, value in fields.items():
        if isinstance(value, Mapping):
            found |= _small_in_struct(at + key, value)
        elif isinstance(value, str) or (
            isinstance(value, np.ndarray) and (key not in channels or value.size <= _FEW)
        ):
            found[at + key] = value
    return found


def _small_in_struct(path: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers and texts of a struct that has no channel of its own; the last single number under
    the struct's path, too.
    """
    arrays = [value for value in fields.values() if isinstance(value, np.ndarray)]
    if any(value.size > _FEW for value in arrays):
        return {}
    found = {
        f"{path}.{key}": value
        for key, value in fields.items()
        if isinstance(value, (str, np.ndarray))
    }
    single = [value for value in arrays if value.size == 1]
    if single:
        found[path] = single[-1]
    return found


_FEW = 64  # values of what is no channel, such as a sensitivity to each of them


def _without_those_of_others(
    around: _StructContext, key: str, channels: Sequence[str]
) -> _StructContext:
    """The scales that may be those of a channel: not one that is called by the name of another."""
    others = [_word(k) for k in channels if k != key and len(k) > 1]
    kept = {
        name: value
        for name, value in around.scales.items()
        if not any(_word(name).startswith(other) for other in others)
        or _word(name).startswith(_word(key))
    }
    return replace(around, scales=kept)


def _of_x_and_y(
    name: str, fields: Mapping[str, Any], x: Mapping[str, Any], y: Mapping[str, Any]
) -> Iterator[Column]:
    """Channels of a function as Simcenter writes it: an axis in ``x_values``, samples in
    ``y_values``, each with its quantity.
    """
    table = _samples(x, y)
    if table is None:
        return
    time, axis = _axis_of_x(fields, x, table.shape[0])
    quantity = _quantity(y)
    labels = _labels(name, _texts(_of(fields, _NAMES)), table.shape[1])
    units = _one_for_each(quantity.labels, table.shape[1])
    beside = {key: value for key, value in y.items() if key != "values"}
    scales = _small(f"{name}.", fields, ()) | _small(f"{name}.y_values.", beside, ())
    for label, unit, values in zip(labels, units, table.T, strict=True):
        own, unfit = _unit_of_values(unit, quantity, label)
        if values.dtype.kind == "c":
            unfit = f"channel {label} is not a time history but has complex values, as a spectrum; export the time history"
        yield Column(
            label,
            values.real.astype(float),
            own,
            {},
            time,
            axis,
            scales=scales,
            field=f"{name}.y_values.values",
            unfit=unfit,
        )


def _samples(x: Mapping[str, Any], y: Mapping[str, Any]) -> np.ndarray | None:
    """Samples in ``y_values``, (samples, channels); None where they are no numbers."""
    samples = y.get("values")
    if isinstance(samples, list):
        samples = _stacked(("values", samples))[1]
    if not isinstance(samples, np.ndarray) or samples.dtype.kind not in "fiubc":
        return None
    if samples.size < 2 or samples.ndim > 2:
        return None
    if samples.ndim == 1:
        samples = samples[:, None]
    rows, columns = samples.shape
    count = _number(x.get("numberofvalues", x.get("number_of_values")))
    if rows != count and (columns == count or rows < columns):
        return samples.T
    return samples


def _axis_of_x(
    fields: Mapping[str, Any], x: Mapping[str, Any], count: int
) -> tuple[Column | None, Axis | None]:
    """The axis of ``count`` samples in ``x_values``: each of its values, or else its step."""
    unit = _unit_of_axis(_quantity(x))
    given = x.get("values")
    if isinstance(given, np.ndarray) and given.ndim == 1 and given.size == count:
        return Column("x_values", given.astype(float), unit), None
    step = next((_number(x[key]) for key in x if _word(key) in ("increment", "delta")), None)
    if step is None:
        return None, None
    start = next((_number(x[key]) for key in x if _word(key) in ("startvalue", "start")), None)
    kind = str(_of(fields, ("type", "functiontype", "functionclass")) or "")
    is_spectrum = re.search(r"spectr|power|frf|psd|coheren|order|fft", kind, re.IGNORECASE)
    quantity = "Frequency" if is_spectrum and not unit else ""
    return None, Axis("x_values", step, start, unit, quantity)


def _unit_of_axis(quantity: _Quantity) -> str:
    """Unit of an axis by its label, s where the factor beside it says that it is stored in that."""
    if not quantity.labels or not quantity.labels[0]:
        return ""
    unit = quantity.labels[0]
    size = seconds_per(unit)
    if size is not None and quantity.factor is not None and _stored_in_si(quantity.factor, size):
        return "s"
    return unit


def _labels(name: str, names: list[str], count: int) -> list[str]:
    """Names of the channels of a function, by number where they are not listed."""
    if count == 1:
        return [names[0] or name] if len(names) == 1 else [name]
    if len(names) != count:
        names = [""] * count
    return [f"{name}({k + 1})" if label in ("", name) else label for k, label in enumerate(names)]


def _one_for_each(units: list[str], count: int) -> list[str]:
    """Units of so many channels; where their number is another, the first is that of all."""
    if len(units) == count:
        return units
    return [units[0] if units else ""] * count


def _number(given: Any) -> float | None:
    if isinstance(given, np.ndarray) and given.size:
        return float(np.ravel(given)[0])
    return None


@dataclass(frozen=True)
class _Quantity:
    """Unit of an axis as a file states it."""

    labels: list[str]
    factor: float | None = None
    offset: float = 0.0


def _quantity(axis: Mapping[str, Any]) -> _Quantity:
    """Labels of an axis' unit, and factor and offset that its file gives with it."""
    quantity = axis.get("quantity")
    several = quantity if isinstance(quantity, list) else [quantity]
    structs = [item for item in several if isinstance(item, Mapping)]
    if isinstance(quantity, Mapping) and isinstance(quantity.get("label"), list):
        labels = _texts(quantity["label"])
    else:
        labels = [_label_text(item) for item in structs]
    change = several[0].get("unit_transformation") if isinstance(several[0], Mapping) else None
    if not isinstance(change, Mapping):
        return _Quantity(labels)
    return _Quantity(labels, _number(change.get("factor")), _number(change.get("offset")) or 0.0)


def _label_text(quantity: Mapping[str, Any]) -> str:
    label = quantity.get("label", "")
    return "" if isinstance(label, list) else str(label).strip()


def _stored_in_si(factor: float, size: float) -> bool:
    """Whether a factor turns SI into a unit of this size in SI: such values are stored in SI,
    whatever their label.
    """
    return abs(size - 1.0) > 1e-9 and abs(factor * size - 1.0) < 1e-3


def _unit_of_values(label: str, quantity: _Quantity, name: str) -> tuple[str, str]:
    """Unit of a force's or torque's samples by its label and the factor beside it, and why that is
    not known.
    """
    factor, offset = quantity.factor, quantity.offset
    load = as_load(f"1 {label}") if label else None
    if load is None or factor is None:
        return label, ""
    size, si = load
    if _stored_in_si(factor, size):
        return si, ""
    is_factor_of_unit = abs(factor - 1.0) < 1e-9 or abs(factor / size - 1.0) < 1e-3
    if is_factor_of_unit and not offset:
        return label, ""
    return label, (
        f"channel {name} is in '{label}' with a factor of {factor:.6g} and an offset of"
        f" {offset:.6g} beside it, which is neither"
        f" {size:.6g} nor {1.0 / size:.6g}: in what its samples are is not known; export it in {si}"
    )


def _stacked(item: tuple[str, Any]) -> tuple[str, np.ndarray | None]:
    """A field's numbers; cells of vectors of one length as the columns of a matrix."""
    key, value = item
    if (
        isinstance(value, list)
        and value
        and all(isinstance(x, np.ndarray) and x.ndim == 1 for x in value)
    ):
        if len({x.size for x in value}) == 1:
            value = np.column_stack(value)
        else:
            value = None
    return key, value if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" else None


def _nested_columns(
    at: str, fields: Mapping[str, Any], around: _StructContext, depth: int
) -> Iterator[Column]:
    units = _unit_fields(fields)
    for key, value in fields.items():
        if isinstance(value, list):
            several = value
        else:
            several = [value]
        of_this = replace(around, unit=units.get(key, ""))
        for k, item in enumerate(several):
            if isinstance(item, Mapping) and _word(key) not in _UNITS:
                inner = f"{at}{key}" + (f"({k + 1})" if len(several) > 1 else "")
                yield from _scope(inner, _joined(_paired(dict(item))), of_this, depth + 1)


def _matrix(
    name: str, values: np.ndarray, names: list[str], units: list[str], around: _StructContext
) -> Iterator[Column]:
    """Columns of a matrix of samples, its longer axis being time; time itself may be one of them."""
    if values.shape[0] >= values.shape[1]:
        rows = values
    else:
        rows = values.T
    if rows.shape[0] < 8:
        return
    if len(names) == rows.shape[1]:
        named = names
    else:
        named = [f"{name}({k + 1})" for k in range(rows.shape[1])]
    if len(units) == rows.shape[1]:
        given = units
    elif len(units) == 1:
        given = units * rows.shape[1]
    else:
        given = [""] * rows.shape[1]
    axis = next((k for k, text in enumerate(named) if is_time(text)), None)
    if axis is not None:
        around = replace(around, time=Column(named[axis], rows[:, axis], given[axis]))
    for k, text in enumerate(named):
        if k != axis:
            yield around.column(text, rows[:, k], given[k], f"{name}(:,{k + 1})")
