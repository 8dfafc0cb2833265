"""The one path from what a file says of its channels to a recording: time axes, sample rates, units, names."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from microvib.testdata.channels import in_yaml, is_time, named_unit
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.time_axis import agrees, regular_rate, snapped_rate
from microvib.units import convert

PLAUSIBLE = (
    20.0,
    1e7,
)  # sample rates [Hz] of loads; others come of kilohertz, milliseconds or days that are not said to be that
SAME_RATE = 1e-4  # relative difference up to which two statements on the sample rate agree: time axes have few digits
_RATES = re.compile(
    r"fs|f_?s(am(p|ple))?|s(ample|ampling)?_?(rate|freq|frequency)(_?hz)?|sfreq|srate|abtast(rate|frequenz)",
    re.IGNORECASE,
)
_STEPS = re.compile(
    r"dt|d_t|delta_?t|t_?s|ts(ample)?|(x_?)?(increment|delta)|(sample|sampling|time)_?(interval|step|time|period)", re.IGNORECASE
)  # fmt: skip


@dataclass(frozen=True)
class Hints:
    """What a preparation says of a file that the file does not say itself."""

    sample_rate: float | None = None  # [Hz]
    time: str | None = None  # name of the time axis
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Column:
    """One column of numbers, (n,), with all that its file says of it; a time axis is one, too."""

    name: str
    values: np.ndarray
    unit: str = ""
    rates: Mapping[str, float] = field(default_factory=dict)  # sample rates [Hz], each by who says so
    time: Column | None = None
    start: float | None = None  # time of the first sample [s], where the file says that and no time axis


def stated_rates(scalars: Mapping[str, float]) -> dict[str, float]:
    """Sample rates [Hz] among named numbers: ``fs``, ``SampleRate`` and the like, or a time step ``dt`` [s]."""
    found = {}
    for name, value in scalars.items():
        word = name.rsplit(".", 1)[-1]
        if _RATES.fullmatch(word):
            found[name] = value
        elif _STEPS.fullmatch(word):
            found[name] = 1.0 / value if value else math.inf
    return found


def recording_of(columns: Iterable[Column], hints: Hints, notes: Sequence[str] = (), mixed: bool = False) -> Recording:
    """Recording of the columns of one rate and length, the longest; RecordingError for what is missing or contradictory.

    Columns of another rate are left out, and named in a note. ``mixed`` says that the file may hold vectors that are not channels.
    """
    said = list(notes)
    rated: list[tuple[Column, float]] = []
    known: dict[tuple[object, ...], float] = {}
    named = _with_time(list(columns), hints)
    if not named:
        raise RecordingError("has no channels")
    sampled = [c for c in named if c.rates or c.time is not None]
    if mixed and sampled and hints.sample_rate is None:
        bare = (c for c in named if not c.rates and c.time is None)
        said += [f"left out, without a sample rate: {c.name} ({c.values.size})" for c in bare]
        named = sampled
    for column in named:
        key = (id(column.time), *column.rates.items())
        if key not in known:
            known[key] = _rate(column, hints, said)
        rated.append((column, known[key]))
    size, rate = max((column.values.size, rate) for column, rate in rated)
    kept = [column for column, own in rated if own == rate and column.values.size == size]
    if not mixed and any(own == rate and column.values.size != size for column, own in rated):
        sizes = {column.name: column.values.size for column, own in rated if own == rate}
        raise RecordingError(f"its channels differ in length: {sizes}")
    _check_alike(rated, kept, rate, said)
    axes = {id(c.time): c.time for c in kept if c.start is None and c.time is not None}
    starts = [c.start for c in kept if c.start is not None]
    starts += [float(axis.values[0]) * _seconds(axis, hints) for axis in axes.values()]
    if starts and max(starts) - min(starts) > 0.01 / rate:
        raise RecordingError(
            f"its channels start at different times, {min(starts):g} to {max(starts):g} s; they must be cut to one time"
        )
    for column in kept:
        bad = int(np.count_nonzero(~np.isfinite(column.values)))
        if bad:
            said.append(f"channel {column.name}: {bad} of {size} samples are not numbers")
    units = {c.name: c.unit.strip().strip("[]").strip() for c in kept}
    return Recording({c.name: c.values for c in kept}, rate, units, notes=tuple(dict.fromkeys(n for n in said if n)))


def _check_alike(rated: list[tuple[Column, float]], kept: list[Column], rate: float, said: list[str]) -> None:
    """RecordingError for a name that is there twice; columns of another rate or length are named as left out."""
    names = [column.name for column in kept]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(f"channel {twice} occurs twice; give the two different names")
    others = [column for column, own in rated if not any(column is k for k in kept)]
    if others:
        listed = ", ".join(f"{c.name} ({c.values.size})" for c in others[:8]) + (" ..." if len(others) > 8 else "")
        said.append(f"left out, not of {kept[0].values.size} samples at {rate:g} Hz: {listed}")


def _with_time(columns: list[Column], hints: Hints) -> list[Column]:
    """The columns that are not time axes, each with the time axis that is meant for it."""
    if hints.time is not None and hints.time not in [c.name for c in columns]:
        raise RecordingError(f"time: there is no column '{hints.time}'; there are {', '.join(c.name for c in columns)}")
    axes = [c for c in columns if (c.name == hints.time if hints.time is not None else is_time(c.name))]
    found = []
    for column in columns:
        if any(column is axis for axis in axes):
            continue
        fitting = [a for a in axes if a.values.size == column.values.size]
        rates = dict(column.rates)
        for axis in fitting[1:]:  # a second axis is a second statement
            rates |= _rate_of_axis(axis, hints, [])
        if column.time is None and fitting:
            column = replace(column, time=fitting[0], rates=rates)
        found.append(column)
    return found


def _rate(column: Column, hints: Hints, said: list[str]) -> float:
    """Sample rate on which all statements agree; the preparation's settles which one is right."""
    stated = dict(column.rates)
    for name, value in stated.items():
        if not 0.0 < value < math.inf:
            raise RecordingError(f"{name} gives a sample rate of {value:g} Hz; it must be greater than 0 Hz and finite")
    if column.time is not None:
        stated |= _rate_of_axis(column.time, hints, said)
    given = hints.sample_rate
    if not stated and given is None:
        raise RecordingError(
            f"has neither a time axis (time, t) nor a rate (fs, sample_rate); give the sample rate in Hz: add to the"
            " preparation file sample_rate: 4096 Hz, with your rate, or time: with the name of the column"
            f" that is the time axis; there are {column.name}",
            remedy="prepare",
        )
    if not stated:
        return float(given or 0.0)
    values = list(stated.values())
    agreed = max(values) <= min(values) * (1.0 + SAME_RATE)
    listed = ", ".join(f"{value:.6g} Hz by {name}" for name, value in stated.items())
    if given is not None:
        if all(abs(1e3 * value / given - 1.0) <= SAME_RATE for value in values):
            said.append(f"sample rate {given:g} Hz as the preparation says; the file says {listed}, which is kilohertz")
            return given
        if all(abs(value / given - 1.0) > SAME_RATE for value in values):
            raise RecordingError(f"has a sample rate of {listed}, but the preparation says {given:g} Hz")
        if not agreed:
            said.append(f"sample rate {given:g} Hz as the preparation says; the file says {listed}")
        return given
    if not agreed:
        raise RecordingError(
            f"contradicts itself, its sample rate is {listed}; add the right one to the preparation file,"
            f" such as sample_rate: {values[0]:.6g} Hz",
            remedy="prepare",
        )
    rate, note = snapped_rate(values[0])
    if not PLAUSIBLE[0] <= rate <= PLAUSIBLE[1]:
        axis = "time" if column.time is None else in_yaml(column.time.name)
        raise RecordingError(
            f"has a sample rate of {listed}; {PLAUSIBLE[0]:g} Hz to {1e-6 * PLAUSIBLE[1]:g} MHz is expected. Add the right rate to"
            f" the preparation file, such as sample_rate: 4096 Hz, or the unit of the time axis, such as units: {{{axis}: ms}}",
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
            f"time axis {time.name} has too few digits; its samples are at {given:g} Hz as the preparation says",
        )
    said.append(note)
    if not _unit(time, hints):
        said.append(f"time axis {time.name} has no unit and is read in seconds")
    return {f"the time axis {time.name}": rate}


def _unit(time: Column, hints: Hints) -> str:
    own = time.unit or named_unit(time.name.rsplit(".", 1)[-1])[1]  # as time_ms
    return hints.units.get(time.name, own).strip().strip("[]()").split(" since ")[0].strip()


def _seconds(time: Column, hints: Hints) -> float:
    """Seconds in the unit of a time axis."""
    unit = _unit(time, hints)
    try:
        return convert(f"1 {unit}", "s") if unit else 1.0
    except ValueError:
        raise RecordingError(
            f"its time axis {time.name} is in '{unit}', which is not a unit of time; add the right one to the"
            f" preparation file, such as units: {{{in_yaml(time.name)}: s}}",
            remedy="prepare",
        ) from None
