"""Channels among the variables of MATLAB files, as people and test software lay them out."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from microvib.io.measured import STEPS, Axis, Column, names_scale, stated_rates
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
_UNITS = ("units", "unit", "unitstring", "eu", "engunits", "yunit", "yunits")
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
_DEEPEST = 6


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
    """What the structs about some samples say of them."""

    rates: Mapping[str, float] = field(default_factory=dict)
    time: Column | None = None
    axis: Axis | None = None
    scales: Mapping[str, Any] = field(default_factory=dict)

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


def _scope(
    name: str, fields: Mapping[str, Any], around: _StructContext, depth: int
) -> Iterator[Column]:
    """Channels of one struct; what it says of rate and time holds for those within, too."""
    at = f"{name}." if name else ""
    by_word = {_word(key): value for key, value in fields.items()}
    x, y = by_word.get("xvalues"), by_word.get("yvalues")
    if isinstance(x, Mapping) and isinstance(y, Mapping):
        yield from _of_x_and_y(name, fields, x, y)
        return
    numbers = {
        k: np.asarray(v, dtype=float) for k, v in map(_stacked, fields.items()) if v is not None
    }
    unit_of = _units_beside(fields)
    axes = [
        Column(at + k, v, unit_of.get(k) or _axis_unit(fields))
        for k, v in numbers.items()
        if v.ndim == 1 and v.size > 1 and is_time(k)
    ]
    names, listed = _texts(_of(fields, _NAMES)), _texts(_of(fields, _UNITS))
    channels = [
        k
        for k, v in numbers.items()
        if v.size >= 2
        and v.ndim <= 2
        and not any(a.name == at + k for a in axes)
        and not (v.size <= _FEW and names_scale(k))
    ]
    around = _with_what_is_said(at, fields, channels, around)
    if name and axes:
        around = replace(around, time=axes[0])
    elif axes:
        yield from axes
    for key in channels:
        values, own = numbers[key], f"{at}{key}"
        beside = _without_those_of_others(around, key, channels)
        if values.ndim == 2:
            yield from _matrix(own, values, names, listed or [unit_of.get(key, "")], beside)
            continue
        single = _word(key) in _VALUES and name
        if single:
            if single and len(names) == 1 and names[0]:
                label = names[0]
            else:
                label = name
        else:
            label = own
        unit = unit_of.get(key) or (
            listed[names.index(key)] if key in names and len(listed) == len(names) else ""
        )
        if not unit and len(listed) == 1 and (single or len(channels) == 1):
            unit = listed[0]
        yield beside.column(label, values, unit, own)
    if depth < _DEEPEST:
        yield from _nested_columns(at, fields, around, depth)


def _units_beside(fields: Mapping[str, Any]) -> dict[str, str]:
    """Units by the fields that they are of: a struct ``units``, or fields such as ``Mz_unit``."""
    found: dict[str, str] = {}
    texts = {_word(k): v.strip() for k, v in fields.items() if isinstance(v, str)}
    for key in fields:
        word = _word(key)
        own = (
            f"{word}unit",
            f"{word}units",
            f"unit{word}",
            f"units{word}",
            f"{word}eu",
            f"unitof{word}",
            f"{word}unitstring",
        )
        unit = next((texts[name] for name in own if texts.get(name)), "")
        if unit:
            found[key] = unit
    for key, value in fields.items():
        if isinstance(value, Mapping) and _word(key) in _UNITS:
            found |= {k: v.strip() for k, v in value.items() if isinstance(v, str)}
    return found


def _axis_unit(fields: Mapping[str, Any]) -> str:
    unit = _of(fields, _AXIS_UNITS)
    if not isinstance(unit, str):
        return ""
    return named_unit(unit)[1] or unit.strip()  # a label such as Time (ms)


def _with_what_is_said(
    at: str, fields: Mapping[str, Any], channels: Sequence[str], around: _StructContext
) -> _StructContext:
    """What stands about the samples, with rates, step of the axis and scales that this struct says."""
    said = {
        at + k: v if isinstance(v, str) else float(np.ravel(v)[0])
        for k, v in fields.items()
        if isinstance(v, str)
        or (isinstance(v, np.ndarray) and v.size == 1 and v.dtype.kind in "fiub")
    }
    axis = around.axis
    step = next(
        (k for k in fields if STEPS.fullmatch(k) and isinstance(said.get(at + k), float)), None
    )
    if step is not None:
        starts = [
            said[at + k]
            for k in fields
            if _word(k) in _AXIS_STARTS and isinstance(said.get(at + k), float)
        ]
        start = float(starts[0]) if starts else None
        quantity = _of(fields, _AXIS_NAMES)
        unit = _units_beside(fields).get(step) or _axis_unit(fields)
        axis = Axis(
            at + step,
            float(said.pop(at + step)),
            start,
            unit,
            quantity if isinstance(quantity, str) else "",
        )
    scales = {**around.scales, **_small(at, fields, channels)}
    return _StructContext({**around.rates, **stated_rates(said)}, around.time, axis, scales)


def _small(at: str, fields: Mapping[str, Any], channels: Sequence[str]) -> dict[str, Any]:
    """Numbers and texts that are no channels, those of structs in it by their paths."""
    found: dict[str, Any] = {}
    for key, value in fields.items():
        if isinstance(value, Mapping):
            inner = [k for k, v in value.items() if isinstance(v, np.ndarray) and v.size > _FEW]
            if not inner:  # no channel of its own
                found |= {
                    f"{at}{key}.{k}": v
                    for k, v in value.items()
                    if isinstance(v, (str, np.ndarray))
                }
                found |= {
                    f"{at}{key}": v
                    for v in value.values()
                    if isinstance(v, np.ndarray) and v.size == 1
                }
        elif isinstance(value, str) or (
            isinstance(value, np.ndarray) and (key not in channels or value.size <= _FEW)
        ):
            found[at + key] = value
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
    samples = y.get("values")
    if isinstance(samples, list):
        samples = _stacked(("values", samples))[1]
    if (
        not isinstance(samples, np.ndarray)
        or samples.size < 2
        or samples.ndim > 2
        or samples.dtype.kind not in "fiubc"
    ):
        return
    count = _number(x.get("numberofvalues", x.get("number_of_values")))
    if samples.ndim == 1:
        table = samples[:, None]
    else:
        table = samples
    if table.shape[0] != count and (table.shape[1] == count or table.shape[0] < table.shape[1]):
        table = table.T
    labels, factor, _ = _quantity(x)
    unit = labels[0] if labels else ""
    size = seconds_per(unit) if unit else None
    if size is not None and factor is not None and _stored_in_si(factor, size):
        unit = "s"
    kind = str(_of(fields, ("type", "functiontype", "functionclass")) or "")
    if not unit and re.search(r"spectr|power|frf|psd|coheren|order|fft", kind, re.IGNORECASE):
        quantity = "Frequency"
    else:
        quantity = ""
    given = x.get("values")
    time = axis = None
    if isinstance(given, np.ndarray) and given.ndim == 1 and given.size == table.shape[0]:
        time = Column("x_values", given.astype(float), unit)
    else:
        step = next((_number(x[k]) for k in x if _word(k) in ("increment", "delta")), None)
        start = next((_number(x[k]) for k in x if _word(k) in ("startvalue", "start")), None)
        if step is None:
            axis = None
        else:
            axis = Axis("x_values", step, start, unit, quantity)
    names, (units, factor, offset) = _texts(_of(fields, _NAMES)), _quantity(y)
    for k, values in enumerate(table.T):
        if len(names) == table.shape[1] and names[k]:
            label = names[k]
        else:
            label = name
        if table.shape[1] == 1 or label != name:
            label = label
        else:
            label = f"{name}({k + 1})"
        if len(units) == table.shape[1]:
            own = units[k]
        elif units:
            own = units[0]
        else:
            own = ""
        own, unfit = _unit_of_values(own, factor, offset, label)
        if values.dtype.kind == "c":
            unfit = f"channel {label} is not a time history but has complex values, as a spectrum; export the time history"
        scales = _small(f"{name}.", fields, ()) | _small(
            f"{name}.y_values.", {k: v for k, v in y.items() if k != "values"}, ()
        )
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


def _number(given: Any) -> float | None:
    if isinstance(given, np.ndarray) and given.size:
        return float(np.ravel(given)[0])
    return None


def _quantity(axis: Mapping[str, Any]) -> tuple[list[str], float | None, float]:
    """Labels of an axis' unit, and factor and offset that its file gives with it."""
    quantity = axis.get("quantity")
    if isinstance(quantity, list):
        several = quantity
    else:
        several = [quantity]
    labels = [
        str(q.get("label", "")).strip() if not isinstance(q.get("label"), list) else ""
        for q in several
        if isinstance(q, Mapping)
    ]
    if (
        len(several) == 1
        and isinstance(quantity, Mapping)
        and isinstance(quantity.get("label"), list)
    ):
        labels = _texts(quantity["label"])
    if isinstance(several[0], Mapping):
        change = several[0].get("unit_transformation")
    else:
        change = None
    if not isinstance(change, Mapping):
        return labels, None, 0.0
    return labels, _number(change.get("factor")), _number(change.get("offset")) or 0.0


def _stored_in_si(factor: float, size: float) -> bool:
    """Whether a factor turns SI into a unit of this size in SI: such values are stored in SI,
    whatever their label.
    """
    return abs(size - 1.0) > 1e-9 and abs(factor * size - 1.0) < 1e-3


def _unit_of_values(label: str, factor: float | None, offset: float, name: str) -> tuple[str, str]:
    """Unit of a force's or torque's samples by its label and the factor beside it, and why that is
    not known.
    """
    load = as_load(f"1 {label}") if label else None
    if load is None or factor is None:
        return label, ""
    size, si = load
    if _stored_in_si(factor, size):
        return si, ""
    if (abs(factor - 1.0) < 1e-9 and not offset) or (
        abs(factor / size - 1.0) < 1e-3 and not offset
    ):
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
    for key, value in fields.items():
        if isinstance(value, list):
            several = value
        else:
            several = [value]
        for k, item in enumerate(several):
            if isinstance(item, Mapping) and _word(key) not in _UNITS:
                inner = f"{at}{key}" + (f"({k + 1})" if len(several) > 1 else "")
                yield from _scope(inner, _joined(_paired(dict(item))), around, depth + 1)


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
