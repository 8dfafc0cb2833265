"""The one path from what a file says of its channels to a recording: time axes, sample rates,
units, names.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from microvib.io.stated_scales import (
    QUANTITY,
    factor_in,
    name_may_scale,
    names_scale,
    remark_may_scale,
    scaling_value,
)
from microvib.model.rigid import COMPONENTS
from microvib.testdata.channels import (
    COUNTS,
    as_measured,
    is_time,
    load_in_name,
    named_unit,
    seconds_per,
    units_contradict,
    what_is_measured_in,
    yaml_quoted,
)
from microvib.testdata.force_table import UnusableBand
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.time_axis import agrees, regular_rate, snapped_rate
from microvib.units import convert

PLAUSIBLE = (
    20.0,
    1e7,
    # sample rates [Hz] of loads; others come of kilohertz, milliseconds or days that are not said to be
    # that
)
# sample rate [Hz] below which a number without a unit may be meant in kilohertz, which is told
SLOW_RATE = 1000.0
# relative difference up to which two statements on the sample rate agree: time axes have few digits
SAME_RATE = 1e-4
_RATES = re.compile(
    r"fs|f_?s(am(p|ple))?|s(ample|ampling)?_?(rate|freq|frequency)(_?hz)?|sfreq|srate|abtast(rate|frequenz)",
    re.IGNORECASE,
)
STEPS = re.compile(
    r"dt|d_?x|d_t|delta_?[tx]|t_?s|ts(ample)?|(x_?)?(inc(rement)?|delta)|(sample|sampling|time)_?(interval|step|time|period)",
    re.IGNORECASE,
)
"""Names of the step of an axis."""
_NAMED_UNIT = re.compile(r"(.+?)_(k?hz|[munµ]?s|sec|msec|usec)", re.IGNORECASE)
_SPECTRAL = re.compile(
    r"(?-i:f)|f_?axis|freq\w*|frequen\w*|fr[eé]quence\w*|frequenz\w*|k?hz|orders?|ordnung(en)?",
    re.IGNORECASE,
)
"""Names of what spectra are given over."""


@dataclass(frozen=True)
class Hints:
    """Properties of a file that only the preparation states."""

    sample_rate: float | None = None  # [Hz]
    time: str | None = None  # name of the time axis
    units: Mapping[str, str] = field(default_factory=dict)
    sensitivity: Mapping[str, str] = field(default_factory=dict)
    channels: frozenset[str] = frozenset()  # names of the channels that are wanted; empty: all


@dataclass(frozen=True)
class Axis:
    """Even axis of a channel as its file gives it: step and first value in its unit, and what runs
    along it.
    """

    name: str  # under which the preparation gives its unit
    step: float
    start: float | None = None
    unit: str = ""
    quantity: str = ""  # as the file calls it: Time, Frequency


@dataclass(frozen=True)
class Column:
    """One column of numbers, (n,), with all that its file says of it; a time axis is one, too."""

    name: str
    values: np.ndarray
    unit: str = ""
    rates: Mapping[str, float] = field(
        default_factory=dict
    )  # sample rates [Hz], each by who says so
    time: Column | None = None
    axis: Axis | None = None
    clock: float | None = (
        None  # time [s] of the file's clock to which the time axis is relative, where it says that
    )
    scales: Mapping[str, Any] = field(default_factory=dict)
    """Metadata of the samples that may be the scale of a converter's counts: numbers and
    texts by name.
    """
    units: Mapping[str, str] = field(default_factory=dict)
    """Further units that the file gives, by where they stand."""
    remarks: tuple[str, ...] = ()
    """Free texts of the file about its channels: lines above columns, comments, descriptions."""
    field: str = ""  # where the samples are in the file, if that is not the name
    unfit: str = ""  # why it is no time history, where it is none


def stated_rates(fields: Mapping[str, Any]) -> dict[str, float]:
    """Sample rates [Hz] among named numbers or texts: ``fs``, ``SampleRate`` and the like, or a
    time step ``dt``.

    Without a unit, in the name as in ``fs_kHz`` or in the text as in ``50 kHz``, they are in Hz and
    s.
    """
    found = {}
    for name, given in fields.items():
        word, unit = name.rsplit(".", 1)[-1], ""
        named = _NAMED_UNIT.fullmatch(word)
        if named and not (_RATES.fullmatch(word) or STEPS.fullmatch(word)):
            word, unit = named[1], named[2]
        rate, step = (
            _RATES.fullmatch(re.sub(r"[ -]", "_", word)),
            STEPS.fullmatch(re.sub(r"[ -]", "_", word)),
        )
        if not rate and not step:
            continue
        value = _scalar(given, unit or "", "Hz" if rate else "s")
        if value is not None:
            if rate:
                found[name] = value
            elif value:
                found[name] = 1.0 / value
            else:
                found[name] = math.inf
    return found


def _scalar(given: Any, unit: str, wanted: str) -> float | None:
    """A number or a text such as ``50 kHz``, without a unit in ``unit`` or else in the ``wanted``
    one; None if it is neither.
    """
    if isinstance(given, str):
        found = QUANTITY.fullmatch(
            given.replace(",", ".") if given.count(",") == 1 and "." not in given else given
        )
        if found is None:
            return None
        number, unit = float(found[1]), found[2] or unit
    else:
        number = float(given)
    if not unit:
        return number
    unit = re.sub(
        r"(?i)^(k?)hz$",
        lambda m: m[1].lower() + "Hz",
        re.sub(r"(?i)^([kM]?)S(a(mples)?)?/s(ec)?$", r"\1Hz", unit),
    )
    if wanted == "s":
        size = seconds_per(unit)
        if size is None:
            return None
        return number * size
    try:
        return number * convert(f"1 {unit}", wanted)
    except ValueError:
        return None


def recording_of(
    columns: Iterable[Column], hints: Hints, notes: Sequence[str] = (), mixed: bool = False
) -> Recording:
    """Recording of the columns of one rate and length, the longest; RecordingError for what is
    missing or contradictory.

    Columns of another rate, spectra and counts of a converter are left out, and named in a note.
    ``mixed`` says that the file may hold vectors that are not channels.
    """
    said, columns = list(notes), list(columns)
    named = _time_history_columns(_with_time(_with_units(columns, hints), hints), hints, said)
    if mixed and hints.sample_rate is None:
        named = _with_known_rate(named, said)
    rates = _rates_of(named, hints, said)
    rate = max((column.values.size, rate) for column, rate in zip(named, rates, strict=True))[1]
    at_rate = [column for column, own in zip(named, rates, strict=True) if own == rate]
    cuts = _aligned(at_rate, rate, hints, said)
    if not mixed:
        _check_lengths([cut.part for cut in cuts])
    size = max(cut.part.values.size for cut in cuts)
    cuts = [cut for cut in cuts if cut.part.values.size == size]
    channels = [cut.part for cut in cuts]
    used = {id(cut.whole) for cut in cuts}
    _check_alike(channels, [column for column in named if id(column) not in used], rate, said)
    lost = _remarks_on_samples(channels, hints, said)
    return Recording(
        {channel.name: channel.values for channel in channels},
        rate,
        {channel.name: channel.unit.strip().strip("[]").strip() for channel in channels},
        notes=tuple(dict.fromkeys(filter(None, said))),
        lost=lost,
        axes=_other_names(channels, named, columns),
    )


def _remarks_on_samples(
    channels: Sequence[Column], hints: Hints, said: list[str]
) -> tuple[UnusableBand, ...]:
    """The first band in which a channel's scale is uncertain; notes on all channels' samples go to ``said``."""
    units = [channel.unit for channel in channels]
    said += [note for channel in channels for note in _integer_notes(channel, hints)]
    said += [note for channel in channels for note in _not_a_number_notes(channel)]
    lost = [band for channel in channels for band in _uncertain_scale(channel, units, hints)]
    said += [band.why for band in lost]
    return tuple(lost[:1])


def _with_known_rate(columns: list[Column], said: list[str]) -> list[Column]:
    """The columns of which the file says a rate or an axis, or all where it says none."""
    sampled = [c for c in columns if c.rates or c.time is not None or c.axis is not None]
    if not sampled:
        return columns
    known = {id(column) for column in sampled}
    bare = [column for column in columns if id(column) not in known]
    said += [f"left out, without a sample rate: {c.name} ({c.values.size})" for c in bare]
    return sampled


def _rates_of(columns: list[Column], hints: Hints, said: list[str]) -> list[float]:
    """Sample rate [Hz] of each column; what states it is read once for all that share it."""
    known: dict[tuple[object, ...], float] = {}
    rates = []
    for column in columns:
        step = column.axis and replace(column.axis, start=None)
        statements = (id(column.time), step, *column.rates.items())
        if statements not in known:
            known[statements] = _rate(column, hints, said)
        rates.append(known[statements])
    return rates


def _check_lengths(columns: list[Column]) -> None:
    sizes = {column.name: column.values.size for column in columns}
    if len({column.values.size for column in columns}) > 1:
        raise RecordingError(f"its channels differ in length: {sizes}")


def _integer_notes(channel: Column, hints: Hints) -> Iterator[str]:
    """A question where all samples of a load are whole numbers, and no scale is given."""
    scaled = re.match(r"\s*[+-]?[\d.]", hints.units.get(channel.name, ""))
    if as_measured(f"1 {channel.unit}") is None or scaled or not _integer_valued(channel.values):
        return
    yield (
        f"channel {channel.name} contains only integers: are these {channel.unit}, or counts of a"
        " converter?"
    )


def _uncertain_scale(channel: Column, units: Sequence[str], hints: Hints) -> Iterator[UnusableBand]:
    """Band in which what is measured is uncertain: all, where its file says something that may concern its
    scale, and the preparation does not say what the samples are in.
    """
    decided = channel.name in hints.units or channel.name in hints.sensitivity
    unwanted = hints.channels and channel.name not in hints.channels
    if decided or unwanted or as_measured(f"1 {channel.unit}") is None:
        return
    said = _of_uncertain_scale(channel, units)
    if not said:
        return
    key, unit = yaml_quoted(channel.name), channel.unit.strip().strip("[]").strip()
    yield UnusableBand(
        0.0,
        math.inf,
        f"the file says {said}; add to the preparation file units: {{{key}: {unit}}} if these are in {unit},"
        f" or what 1 in the file stands for, such as units: {{{key}: 1000 {unit}}}",
        "scale",
    )


def _of_uncertain_scale(channel: Column, units: Sequence[str]) -> str:
    """Clause on the scale of a channel as its file says it; empty where it says nothing."""
    for name, value in channel.scales.items():
        factor = factor_in(name, value)
        if factor is not None:
            shown = factor if isinstance(factor, str) else f"{factor:.6g}"
            return (
                f"'{name}: {shown[:40]}', and not whether the samples of {channel.name} are already"
                " multiplied by it"
            )
    if name_may_scale(channel.name):
        return f"'{channel.name[:60]}', a name which may be of scaled samples"
    texts = [f"{name}: {value}" for name, value in channel.scales.items() if isinstance(value, str)]
    for remark in (*channel.remarks, *texts):
        if remark_may_scale(remark, units):
            return f"'{remark.strip()[:60]}', which may scale the samples of {channel.name}"
    return ""


def _not_a_number_notes(channel: Column) -> Iterator[str]:
    bad = int(np.count_nonzero(~np.isfinite(channel.values)))
    if bad:
        yield f"channel {channel.name}: {bad} of {channel.values.size} samples are not numbers"


def _other_names(
    channels: list[Column], named: list[Column], columns: list[Column]
) -> frozenset[str]:
    """Names of the axes, and of all columns of the file that are not channels."""
    axes = {axis.name for c in named for axis in (c.time, c.axis) if axis is not None}
    return frozenset(axes | ({c.name for c in columns} - {c.name for c in channels}))


def _with_units(columns: list[Column], hints: Hints) -> list[Column]:
    """The columns, with the units that their names hold; ``Mz_mNm`` becomes Mz unless the
    preparation, or the file, knows that.
    """
    names = [column.name for column in columns]
    meant = {*hints.units, *hints.sensitivity, *hints.channels, *filter(None, [hints.time])}
    found = []
    for column in columns:
        name, unit = load_in_name(column.name)
        _check_one_unit(column, hints)
        if column.unit or not unit or is_time(column.name):
            found.append(column)
            continue
        if name not in names and column.name not in meant and name in COMPONENTS:
            shorter = name
        else:
            shorter = column.name
        found.append(replace(column, name=shorter, unit=unit))
    return found


def _check_one_unit(column: Column, hints: Hints) -> None:
    """RecordingError where name, file or row of units give a channel different ones, and no preparation
    says which one counts.
    """
    wanted = not hints.channels or column.name in hints.channels or is_time(column.name)
    decided = {*hints.units, *hints.sensitivity}
    if not wanted or column.name in decided or load_in_name(column.name)[0] in decided:
        return
    for where, unit in _other_units(column).items():
        if units_contradict(unit, column.unit):
            raise RecordingError(
                f"channel {column.name} has two units, '{unit}' {where} and '{column.unit.strip()}' beside it; add the"
                f" right one to the preparation file, such as units: {{{yaml_quoted(column.name)}:"
                f" {unit}}}",
                remedy="prepare",
            )


def _other_units(column: Column) -> dict[str, str]:
    """Units that a channel has beside that which counts first, by where they stand."""
    in_name = load_in_name(column.name)[1] or named_unit(column.name.rsplit(".", 1)[-1])[1]
    named = {"in its name": in_name} if in_name else {}
    return named | dict(column.units)


def _time_history_columns(columns: list[Column], hints: Hints, said: list[str]) -> list[Column]:
    """Columns that are time histories in a unit; the others are left out with a note.
    RecordingError where none is one.
    """
    if not columns:
        raise RecordingError("has no channels")
    kept: list[Column] = []
    reasons: list[str] = []
    for column in columns:
        reason = (
            column.unfit or _over_another_axis(column, hints) or _unscaled_counts(column, hints)
        )
        if reason:
            reasons.append(reason)
        else:
            kept.append(_in_counts_where_scaled(column, hints))
    longest = max(column.values.size for column in columns)
    kept_longest = max((column.values.size for column in kept), default=0)
    if 2 * kept_longest <= longest:  # what is left are lists of something else
        raise RecordingError(reasons[0] if reasons else "has no channels", remedy="prepare")
    said += [f"left out: {reason}" for reason in reasons]
    return kept


def _in_counts_where_scaled(column: Column, hints: Hints) -> Column:
    """The column, in counts where the preparation says the sensitivity of the file's counts."""
    if column.scales and column.name in hints.sensitivity and _integer_valued(column.values):
        return replace(column, unit="counts")
    return column


def _over_another_axis(column: Column, hints: Hints) -> str:
    """Reason why the axis of a column is not time, and remedy; empty where it is time.

    Every axis passes here, whichever format it is from.
    """
    axis = column.time or column.axis
    if axis is None:
        return ""
    unit = _unit(axis, hints)
    if isinstance(axis, Axis):
        quantity = axis.quantity
    else:
        quantity = ""
    if unit:
        if seconds_per(unit) is not None:
            return ""
        if _is_index(unit):
            asks = f"its time axis {axis.name} counts samples ('{unit}'); add the rate to the preparation file"
            if hints.sample_rate is not None:
                return ""
            return f"{asks}, such as sample_rate: 4096 Hz"
        found = what_is_measured_in(unit)
        if found:
            what = f" but of {found}: channel {column.name} is not a time history"
        else:
            what = ""
        return (
            f"its time axis {axis.name} is in '{unit}', which is not a unit of time{what}; export"
            " the time history, or, if only the"
            " unit is wrong, add the right one to the preparation file, such as units:"
            f" {{{yaml_quoted(axis.name)}: s}}"
        )
    if quantity and axis.name not in hints.units and _SPECTRAL.fullmatch(quantity.split()[0]):
        return (
            f"channel {column.name} is not a time history: its axis is called '{quantity}'; export"
            " the time history, or, if the"
            " axis is time, add its unit to the preparation file, such as units:"
            f" {{{yaml_quoted(axis.name)}: s}}"
        )
    return ""


def _is_index(unit: str) -> bool:
    return unit.lower() in ("samples", "sample", "points", "pts", "index", "#", "-", "1")


def _unscaled_counts(column: Column, hints: Hints) -> str:
    """Reason to take samples for counts of a converter, and remedy; empty where nothing does,
    or they are scaled later.
    """
    scale = _scale_attribute(column)
    if (
        scale is None
        or column.unit.strip("[] ").lower() in COUNTS
        or not _integer_valued(column.values)
    ):
        return ""
    given = hints.units.get(column.name, "")
    if (
        column.name in hints.sensitivity
        or re.match(r"\s*[+-]?[\d.]", given)
        or given.lower() in COUNTS
    ):
        return ""
    name, value = scale
    if isinstance(value, float):
        shown = f"{value:.6g}"
    else:
        shown = str(value)[:40]
    key, load = yaml_quoted(column.name), "N" if column.name.startswith("F") else "N*m"
    return (
        f"{column.field or column.name} has whole numbers beside {name}: counts of a converter,"
        " which nothing scales here"
        f" ({shown}); add to the preparation file what one count stands for, such as units:"
        f" {{{key}: 0.0001 {load}}}, or save the"
        f" channel in its unit; units: {{{key}: 1 {load}}} if it is in whole {load}"
    )


def _scale_attribute(column: Column) -> tuple[str, str | float] | None:
    """First of what stands beside the samples that may be their scale."""
    for name, value in column.scales.items():
        found = scaling_value(value) if names_scale(name) else None
        if found is not None:
            return name, found
    return None


def _integer_valued(values: np.ndarray) -> bool:
    """Whether all samples are whole numbers, and not all the same."""
    first = values[:100]
    if np.any(np.isfinite(first) & (first != np.rint(first))):  # as nearly always
        return False
    finite = values[np.isfinite(values)]
    return bool(finite.size and np.all(finite == np.rint(finite)) and np.ptp(finite) > 0)


@dataclass(frozen=True)
class _Cut:
    """A column, and its part from the latest start of all on."""

    whole: Column
    part: Column


def _aligned(columns: list[Column], rate: float, hints: Hints, said: list[str]) -> list[_Cut]:
    """Columns from the latest of their starts on; RecordingError where they differ by parts of a
    sample.
    """
    started = _columns_with_start(columns, hints)
    starts = [start for _, start in started]
    if not starts or max(starts) - min(starts) <= 0.01 / rate:
        return [_Cut(column, column) for column in columns]
    first, last = min(starts), max(starts)
    late = [(column, (last - start) * rate) for column, start in started]  # samples
    size = min(column.values.size - round(k) for column, k in late)
    if size < 8 or any(abs(k - round(k)) > 0.01 for _, k in late):
        names = ", ".join(f"{column.name} at {start:.6g} s" for column, start in started[:6])
        raise RecordingError(
            f"its channels start at different times, {first:g} to {last:g} s, and not by whole"
            " samples within the record; they must"
            " be cut to one time. Or name in the preparation file those that start together, such"
            f" as channels: {{Mz:"
            f" {yaml_quoted(started[-1][0].name)}}}; there are {names}",
            remedy="prepare",
        )
    said.append(
        f"channels start at different times, {first:g} to {last:g} s; all are taken from the latest"
        f" start on, {size} samples"
    )
    return [
        _Cut(column, replace(column, values=column.values[round(k) : round(k) + size]))
        for column, k in late
    ]


def _columns_with_start(columns: list[Column], hints: Hints) -> list[tuple[Column, float]]:
    """The columns that are wanted, or else the longer ones, with their start [s] where known."""
    longest = max(column.values.size for column in columns)
    wanted = [column for column in columns if column.name in hints.channels]
    if not wanted:
        wanted = [column for column in columns if 2 * column.values.size > longest]
    starts = ((column, _start(column, hints)) for column in wanted)
    return [(column, start) for column, start in starts if start is not None]


def _start(column: Column, hints: Hints) -> float | None:
    """Time [s] of the first sample, as far as the file says it."""
    axis = column.time or column.axis
    if isinstance(axis, Axis):
        first = axis.start
    elif axis is None:
        first = None
    else:
        first = float(axis.values[0])
    if first is None or axis is None:
        return column.clock
    return (column.clock or 0.0) + first * _seconds(axis, hints)


def _check_alike(kept: list[Column], others: list[Column], rate: float, said: list[str]) -> None:
    """RecordingError for a name that is there twice; columns of another rate or length are named as
    left out.
    """
    names = [column.name for column in kept]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(f"channel {twice} occurs twice; give the two different names")
    if others:
        listed = ", ".join(f"{c.name} ({c.values.size})" for c in others[:8]) + (
            " ..." if len(others) > 8 else ""
        )
        said.append(f"left out, not of {kept[0].values.size} samples at {rate:g} Hz: {listed}")


def _with_time(columns: list[Column], hints: Hints) -> list[Column]:
    """The columns that are not axes, each with the time axis that is meant for it."""
    axes = _time_axes(columns, hints)
    timed = {axis.values.size for axis in axes}
    spectral = [c for c in columns if c.values.size not in timed and _runs_over_spectra(c)]
    runs_over = ""
    if len(columns) > 1 and not axes:
        runs_over = _evenly_over(columns[0], hints)
    left_out = {id(column) for column in (*axes, *spectral)}
    if runs_over:
        left_out.add(id(columns[0]))
    found = []
    for column in columns:
        if id(column) not in left_out:
            timed_column = _with_time_of_same_length(column, axes, hints)
            unfit = _unfit_without_time(timed_column, spectral, runs_over)
            found.append(replace(timed_column, unfit=unfit))
    return found


def _time_axes(columns: list[Column], hints: Hints) -> list[Column]:
    """The columns that are time axes, by the preparation, by name or else by unit."""
    names = [column.name for column in columns]
    if hints.time is not None:
        if hints.time not in names:
            raise RecordingError(
                f"time: there is no column '{hints.time}'; there are {', '.join(names)}"
            )
        return [column for column in columns if column.name == hints.time]
    called_time = [column for column in columns if is_time(column.name)]
    # one whose unit alone says it, such as X_Value [s]
    return called_time or [column for column in columns if _runs_in_time(column)][:1]


def _with_time_of_same_length(column: Column, axes: list[Column], hints: Hints) -> Column:
    """The column with the first axis of its length, and with what further ones say of its rate."""
    fitting = [axis for axis in axes if axis.values.size == column.values.size]
    rates = dict(column.rates)
    for axis in fitting[1:]:  # a second axis is a second statement
        rates |= _rate_of_axis(axis, hints, [])
    if column.time is None and fitting:
        return replace(column, time=fitting[0], rates=rates)
    return column


def _unfit_without_time(column: Column, spectral: list[Column], runs_over: str) -> str:
    """Why a column is no time history, as other columns show it or its file says."""
    if column.time is not None or column.axis is not None:
        return column.unfit
    for axis in spectral:
        if axis.values.size == column.values.size:
            return _spectrum(column, axis)
    if runs_over:
        return f"channel {column.name} is not a time history but {runs_over}"
    return column.unfit


def _runs_in_time(column: Column) -> bool:
    """Whether a column is in a unit of time and rises throughout."""
    unit = column.unit or named_unit(column.name)[1]
    rises = column.values.size > 1 and bool(np.all(np.diff(column.values) > 0.0))
    return (
        rises
        and bool(unit)
        and seconds_per(unit) is not None
        and column.time is None
        and column.axis is None
    )


def _runs_over_spectra(column: Column) -> bool:
    """Whether a column is the axis of spectra: frequencies or orders in even steps, as no
    measurement has them.
    """
    x = column.values
    if column.time is not None or column.axis is not None:
        return False
    unit = column.unit or named_unit(column.name)[1]
    named = bool(
        _SPECTRAL.fullmatch(
            named_unit(column.name.rsplit(".", 1)[-1])[0].split(" ")[0].split("_")[0] or "-"
        )
    )
    if (
        not (named or what_is_measured_in(unit).startswith("a frequency"))
        or x.size < 8
        or not np.all(np.isfinite(x))
    ):
        return False
    steps = np.diff(x)
    return bool(np.all(steps > 0.0) and np.ptp(steps) < 0.05 * float(np.median(steps)))


def _evenly_over(first: Column, hints: Hints) -> str:
    """Quantity other than time over which the first column runs evenly, and remedy; empty where it does
    not, or the rate is known.
    """
    what = what_is_measured_in(first.unit or named_unit(first.name)[1])
    x = first.values
    if (
        not what
        or hints.sample_rate is not None
        or first.rates
        or x.size < 8
        or not np.all(np.isfinite(x))
    ):
        return ""
    steps = np.diff(x)
    if not np.all(steps > 0.0) or np.ptp(steps) > 1e-3 * float(np.median(steps)):
        return ""
    return (
        f"given over {first.name}, {what} that rises evenly; export it over time, or, where its"
        " samples are evenly spaced in time,"
        " add their rate to the preparation file, such as sample_rate: 4096 Hz"
    )


def _spectrum(column: Column, over: Column) -> str:
    return (
        f"channel {column.name} is not a time history but given over {over.name}, which rises"
        " evenly as the axis of a spectrum"
        f" does; export the time history, or, if {over.name} is a channel, take it out of the file"
    )


def _rate(column: Column, hints: Hints, said: list[str]) -> float:
    """Sample rate on which all statements agree; the preparation's settles which one is right."""
    stated = _stated_rates(column, hints, said)
    if hints.sample_rate is not None:
        return _rate_as_prepared(hints.sample_rate, stated, said)
    if not stated:
        raise RecordingError(
            f"has neither a time axis (time, t) nor a rate (fs, sample_rate); give the sample rate"
            " in Hz: add to the"
            " preparation file sample_rate: 4096 Hz, with your rate, or time: with the name of the"
            " column"
            f" that is the time axis; there are {column.name}",
            remedy="prepare",
        )
    return _rate_as_stated(column, stated, said)


def _stated_rates(column: Column, hints: Hints, said: list[str]) -> dict[str, float]:
    """Sample rates [Hz] of a column that the file states, by their source."""
    stated = dict(column.rates)
    for name, value in stated.items():
        if not 0.0 < value < math.inf:
            raise RecordingError(
                f"{name} gives a sample rate of {value:g} Hz; it must be greater than 0 Hz and"
                " finite"
            )
    said += [
        f"{name} has no unit and is read in Hz: {value:g} Hz"
        for name, value in stated.items()
        if value < SLOW_RATE and _RATES.fullmatch(name.rsplit(".", 1)[-1])
    ]
    if column.time is not None and not _is_index(_unit(column.time, hints)):
        stated |= _rate_of_axis(column.time, hints, said)
    if column.axis is not None:
        stated |= _rate_of_step(column.axis, hints, said)
    return stated


def _listed(stated: dict[str, float]) -> str:
    return ", ".join(f"{value:.6g} Hz by {name}" for name, value in stated.items())


def _agreed(stated: dict[str, float]) -> bool:
    return max(stated.values()) <= min(stated.values()) * (1.0 + SAME_RATE)


def _rate_as_prepared(given: float, stated: dict[str, float], said: list[str]) -> float:
    """The preparation's sample rate, unless all that the file states is another."""
    values = list(stated.values())
    if not values:
        return given
    if all(abs(1e3 * value / given - 1.0) <= SAME_RATE for value in values):
        said.append(
            f"sample rate {given:g} Hz as the preparation says; the file says {_listed(stated)},"
            " which is kilohertz"
        )
    elif all(abs(value / given - 1.0) > SAME_RATE for value in values):
        raise RecordingError(
            f"has a sample rate of {_listed(stated)}, but the preparation says {given:g} Hz"
        )
    elif not _agreed(stated):
        said.append(
            f"sample rate {given:g} Hz as the preparation says; the file says {_listed(stated)}"
        )
    return given


def _rate_as_stated(column: Column, stated: dict[str, float], said: list[str]) -> float:
    """The one sample rate that the file states."""
    values = list(stated.values())
    if not _agreed(stated):
        raise RecordingError(
            f"has contradictory sample rates: {_listed(stated)}; add the right one to the"
            " preparation file,"
            f" such as sample_rate: {values[0]:.6g} Hz",
            remedy="prepare",
        )
    rate, note = snapped_rate(values[0])
    if not PLAUSIBLE[0] <= rate <= PLAUSIBLE[1]:
        runs = column.time or column.axis
        if runs is None:
            axis = "time"
        else:
            axis = yaml_quoted(runs.name)
        raise RecordingError(
            f"has a sample rate of {_listed(stated)}; {PLAUSIBLE[0]:g} Hz to"
            f" {1e-6 * PLAUSIBLE[1]:g} MHz is expected."
            f" Add the right rate to the preparation file, such as sample_rate: 4096 Hz,"
            f" or the unit of the time axis, such as units: {{{axis}: ms}}",
            remedy="prepare",
        )
    said.append(note)
    return rate


def _rate_of_axis(time: Column, hints: Hints, said: list[str]) -> dict[str, float]:
    t, given = np.asarray(time.values, dtype=float) * _seconds(time, hints), hints.sample_rate
    try:
        rate, note = regular_rate(t)
    except RecordingError:
        if given is None or not agrees(t, given):
            raise
        rate, note = (
            given,
            f"time axis {time.name} has too few digits; its samples are at {given:g} Hz as the"
            " preparation says",
        )
    said.append(note)
    if not _unit(time, hints):
        said.append(f"time axis {time.name} has no unit and is read in seconds")
    return {f"the time axis {time.name}": rate}


def _rate_of_step(axis: Axis, hints: Hints, said: list[str]) -> dict[str, float]:
    if _is_index(_unit(axis, hints)):
        return {}
    if not _unit(axis, hints):
        said.append(f"{axis.name} has no unit and is read in seconds")
    step = axis.step * _seconds(axis, hints)
    if step and not 0.0 < 1.0 / step < math.inf:
        raise RecordingError(
            f"{axis.name} gives a sample rate of {1.0 / step:g} Hz; it must be greater than 0 Hz"
            " and finite"
        )
    if not step:
        raise RecordingError(
            f"{axis.name} gives a sample rate of inf Hz; it must be greater than 0 Hz and finite"
        )
    return {axis.name: 1.0 / step}


def _unit(axis: Column | Axis, hints: Hints) -> str:
    own = axis.unit or named_unit(axis.name.rsplit(".", 1)[-1])[1]  # as time_ms
    return hints.units.get(axis.name, own).strip().strip("[]()").split(" since ")[0].strip()


def _seconds(axis: Column | Axis, hints: Hints) -> float:
    """Seconds in the unit of a time axis."""
    return seconds_per(_unit(axis, hints)) or 1.0
