"""Speed references of order tracking: a tacho, a speed channel, a stated profile, a scenario's command,
or the strongest order of the record itself.

A reference is the revolutions of a shaft at the samples of a record. Order 1 is once per revolution;
of a scenario it is once per electrical period, as in ``microvib.analysis.orders``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from microvib.analysis.lines import CLOCK_TOLERANCE
from microvib.errors import MicrovibError, OptionError, ScenarioError
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.row_table import row_table
from microvib.io.tables import csv_rows, text_rows
from microvib.model.scenario import Scenario
from microvib.signals.order_tracking import OrderError
from microvib.signals.sweep_clock import (
    FoundClock,
    find_clock,
    follow_strongest,
    refine_clock,
    revolutions,
)
from microvib.solve.command import Command
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import GivenQuantity, Si, convert, quantity

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

CLOCKS = ("found", "stated")
"""Whether the clock is looked for in the record, or taken as it is stated."""
_MIN_PULSES = 8
_HYSTERESIS = 0.2
"""Part of the height of a tacho's pulses that a crossing must pass on both sides."""


_WORTH = 0.85
"""Part of the scatter of a tacho's edges to which more knots must bring it."""
_REVOLUTIONS = 4.0
"""Revolutions between knots at the least, where twice as many as before are not enough."""


@dataclass(frozen=True)
class Reference:
    """Revolutions of the reference over a part of a record."""

    phase: np.ndarray
    """Revolutions at the samples of the part, (n,), growing."""
    part: slice
    """Samples at which it is known."""
    words: str
    """Source of it, for readers."""
    name: str = "revolution"
    """Name of what order 1 is once per."""
    clock: FoundClock | None = None
    """The clock, where it was looked for."""

    def speed(self, rate: float) -> np.ndarray:
        """Revolutions per second at the samples, (n,)."""
        return np.asarray(np.gradient(self.phase) * rate)


def speed_in_hz(key: str, given: GivenQuantity) -> float:
    """Revolutions per second of a speed in Hz, rpm or deg/s; OptionError where it is none."""
    if isinstance(given, Si):
        return float(given)
    try:
        return convert(given, "Hz")
    except (ValueError, TypeError):
        return float(quantity(key, given, "rad/s", example="rpm")) / (2.0 * math.pi)


def stated_speed(profile: str, t: np.ndarray, files: FileAccess = WORKING_FOLDER) -> np.ndarray:
    """Speed [Hz] at the times ``t`` (n,) [s] of a profile: points ``0 s:10 Hz, 5 s:40 Hz``, a table of
    times and speeds as text of several lines, or a CSV file of one; between points it changes
    linearly, before and after it stays.

    OptionError or ScenarioError where it is no profile, or names a file and ``files`` opens none.
    """
    if "\n" in profile.strip():
        points = _profile_rows("profile", text_rows(profile))
    elif profile.strip().lower().endswith((".csv", ".txt")):
        path = files.under("profile").path(profile.strip())
        points = _profile_rows(str(path), csv_rows(path, ScenarioError))
    else:
        points = [[*_point(text)] for text in profile.split(",")]
    times, speeds = np.array(points).T
    if np.any(np.diff(times) <= 0.0):
        raise OptionError("profile", "its times must increase from point to point")
    if np.any(speeds < 0.0) or not np.any(speeds > 0.0):
        raise OptionError("profile", "its speeds must be positive")
    return np.asarray(np.interp(t, times, speeds))


def _point(text: str) -> tuple[float, float]:
    time, colon, speed = text.partition(":")
    if not colon:
        raise OptionError(
            "profile",
            f"{text.strip()!r} is no point; write TIME:SPEED, such as '0 s:10 Hz, 5 s:40 Hz', or"
            " the name of a CSV file with times and speeds",
        )
    return float(quantity("profile", time.strip(), "s")), speed_in_hz("profile", speed.strip())


def _profile_rows(name: str, rows: list[list[str]]) -> list[list[float]]:
    """Rows of times [s] and speeds [Hz]; the header may name rpm or deg/s."""
    try:
        return row_table(name, rows, ("time", "s"), ("speed", "Hz"))
    except ScenarioError as error:
        if "mixes angles and cycles" not in str(error):
            raise
    found = row_table(name, rows, ("time", "s"), ("speed", "rad/s"))
    return [[time, speed / (2.0 * math.pi)] for time, speed in found]


def of_tacho(recording: Recording, channel: str, pulses_per_rev: float) -> Reference:
    """Revolutions by the pulses of a tacho channel; RecordingError where there are too few.

    A pulse counts where the signal rises through the middle between its levels, after it was well
    below. Edges are known to a sample or less: a cubic spline is laid through them with as many
    knots as their scatter bears.
    """
    if not pulses_per_rev > 0.0:
        raise OptionError("pulses_per_rev", f"{pulses_per_rev:g} is not allowed; more than 0")
    x = recording[channel]
    low, high = np.percentile(x, [1.0, 99.0])
    if not high > low:
        raise RecordingError(f"{recording.title}: tacho {channel} has no pulses: it is constant")
    places = _rises(x, 0.5 * (low + high), _HYSTERESIS * (high - low))
    if places.size < _MIN_PULSES:
        raise RecordingError(
            f"{recording.title}: tacho {channel} has {places.size} pulses; at least {_MIN_PULSES}"
            " are expected"
        )
    steps = np.diff(places)
    odd = np.flatnonzero((steps[1:] > 1.6 * steps[:-1]) | (steps[1:] < steps[:-1] / 1.6))
    if odd.size:
        at = places[odd[0] + 1] / recording.sample_rate
        raise RecordingError(
            f"{recording.title}: tacho {channel}: pulses are missing or doubled, the first at"
            f" {at:.5g} s"
        )
    part = slice(math.ceil(places[0]), math.floor(places[-1]) + 1)
    phase, scatter = _through_pulses(places, part, pulses_per_rev)
    phase /= pulses_per_rev
    if np.any(np.diff(phase) <= 0.0):
        raise RecordingError(f"{recording.title}: tacho {channel}: its speed is not above zero")
    words = (
        f"tacho {channel}, {places.size} pulses, {pulses_per_rev:g} per revolution, whose edges"
        f" scatter by {scatter:.2g} samples"
    )
    return Reference(np.asarray(phase), part, words)


def _through_pulses(
    places: np.ndarray, part: slice, pulses_per_rev: float
) -> tuple[np.ndarray, float]:
    """Pulses counted at the samples of a part, (n,), as a smooth curve, and the scatter of the edges
    about it [samples].

    Its knots are doubled as long as that brings the edges nearer by more than noise would. Speeds that are
    held one after the other need as many knots as there are: fewer than that tell nothing, so doubling
    goes on where it helps later, unless that follows what a revolution repeats.
    """
    count = np.arange(places.size, dtype=float)
    at = np.arange(part.start, part.stop)
    most = [2**k for k in range(places.size.bit_length()) if 4 * 2**k <= places.size]
    if not most:
        return np.interp(at, places, count), 0.0
    splines = [_spline_through(places, count, intervals) for intervals in most]
    chosen, turns = 0, places.size / max(pulses_per_rev, 1.0)
    for k in range(1, len(splines)):
        nearer = splines[k][1] <= _WORTH * splines[chosen][1]
        if nearer and (k == chosen + 1 or _REVOLUTIONS * most[k] <= turns):
            chosen = k
    return np.asarray(splines[chosen][0](at)), splines[chosen][1]


def _spline_through(places: np.ndarray, count: np.ndarray, intervals: int) -> tuple[BSpline, float]:
    """Cubic spline through the pulses with even ``intervals`` between its knots, and the scatter of the edges
    about it [samples].
    """
    from scipy.interpolate import make_lsq_spline

    inner = np.interp(np.linspace(0.0, count[-1], intervals + 1)[1:-1], count, places)
    spline = make_lsq_spline(places, count, np.r_[[places[0]] * 4, inner, [places[-1]] * 4])
    squares = ((spline(places) - count) / np.gradient(count, places)) ** 2
    return spline, math.sqrt(float(np.sum(squares)) / max(places.size - intervals - 3, 1))


def _rises(x: np.ndarray, level: float, margin: float) -> np.ndarray:
    """Places, in parts of samples, at which ``x`` rises through a level after it was well below."""
    state = np.where(x > level + margin, 1, np.where(x < level - margin, -1, 0))
    known = np.flatnonzero(state)
    turned = np.flatnonzero((state[known[1:]] == 1) & (state[known[:-1]] == -1))
    places = []
    for before, after in zip(known[turned], known[turned + 1], strict=True):
        piece = x[before : after + 1]
        k = int(np.argmax(piece >= level))
        rise = piece[k] - piece[k - 1]
        places.append(before + k - 1 + (level - piece[k - 1]) / rise)
    return np.array(places)


def of_speed_channel(recording: Recording, channel: str) -> Reference:
    """Revolutions by a channel that is the speed, in rpm, Hz or deg/s.

    RecordingError where its unit is none of them, or the shaft stands or turns back.
    """
    x, unit = recording[channel], recording.units.get(channel, "").strip()
    try:
        factor = speed_in_hz("speed", f"1 {unit}")
    except MicrovibError:
        raise RecordingError(
            f"{recording.title}: speed channel {channel} is in '{unit or 'no unit'}'; rpm, Hz or"
            f" deg/s is expected; state it in the preparation file, such as units: {{{channel}: rpm}}",
            remedy="prepare",
        ) from None
    speed = factor * x
    if np.mean(speed) < 0.0:
        speed = -speed
    if np.min(speed) <= 0.0:
        at = float(np.argmin(speed)) / recording.sample_rate
        raise RecordingError(
            f"{recording.title}: speed channel {channel} is not above zero throughout: the shaft"
            f" stands or turns back at {at:.4g} s; cut that away",
            remedy="from",
        )
    phase = revolutions(speed, recording.sample_rate)
    return Reference(phase, slice(0, x.size), f"speed channel {channel}")


def of_profile(
    samples: int, rate: float, profile: str, offset: float, files: FileAccess = WORKING_FOLDER
) -> tuple[np.ndarray, str]:
    """Stated speed [Hz] (n,) of a section that begins at ``offset`` [s], and words for it."""
    t = offset + np.arange(samples) / rate
    words = "a table" if "\n" in profile.strip() else profile
    return stated_speed(profile, t, files), f"stated profile {words}"


def of_scenario(
    scenario: Scenario, samples: int, rate: float, offset: float
) -> tuple[np.ndarray, str]:
    """Electrical periods per second [Hz] (n,) that a scenario commands from ``record.settle`` on."""
    t = scenario.record.settle + offset + np.arange(samples + 1) / rate
    period = scenario.driver.beats * scenario.driver.microsteps
    turns = Command(scenario).count(t) / period
    speed = np.abs(np.diff(turns)) * rate
    return speed, "the scenario's command"


def with_clock(
    x: np.ndarray,
    rate: float,
    speed: np.ndarray,
    words: str,
    orders: Sequence[float],
    clock: str,
) -> Reference:
    """Reference of a stated ``speed`` (n,) [Hz]; its clock *found* in the samples ``x`` (n,), or as
    *stated*.

    OrderError where no order is above the noise floor along the stated speed.
    """
    if clock not in CLOCKS:
        raise OptionError("clock", f"'{clock}' is not known; allowed are {', '.join(CLOCKS)}")
    if np.min(speed) <= 0.0:
        at = float(np.argmin(speed)) / rate
        raise OrderError(
            f"the reference stands still at {at:.4g} s of the section; cut that away", remedy="from"
        )
    whole = slice(0, x.size)
    if clock == "stated":
        return Reference(revolutions(speed, rate), whole, f"{words}, taken as it is")
    found = find_clock(x, rate, speed, orders, CLOCK_TOLERANCE)
    if found is None:
        raise OrderError(
            f"no order is above the noise floor within {100.0 * CLOCK_TOLERANCE:g} % of {words} for half of"
            " the record, or a structure turns their phases more than such a clock would; check it, or take it"
            " as it is with clock stated",
            remedy="clock",
        )
    return Reference(found.phase, whole, f"{words}, its clock found in the record", clock=found)


def of_strongest(
    x: np.ndarray, rate: float, strongest: float, orders: Sequence[float], seconds: float
) -> Reference:
    """Reference by the record alone, whose strongest component is the order ``strongest``.

    OrderError where nothing is above the noise floor.
    """
    if not strongest > 0.0:
        raise OptionError("strongest", f"order {strongest:g} is not allowed; more than 0")
    ridge = follow_strongest(x, rate, seconds)
    if ridge is None:
        raise OrderError(
            "no component of the record is above the noise floor, which could be followed"
        )
    speed = ridge / strongest
    found = refine_clock(x, rate, speed, speed, sorted({*orders, strongest}))
    if found.share < 0.5:
        raise OrderError(
            "the strongest component could not be followed: it is above the noise in"
            f" {100.0 * found.share:.0f} % of the record"
        )
    words = f"the record's strongest component, taken for order {strongest:g}"
    return Reference(found.phase, slice(0, x.size), words, clock=found)


def named(reference: Reference, name: str) -> Reference:
    """The reference with the name of what order 1 is once per."""
    return replace(reference, name=name)
