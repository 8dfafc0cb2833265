"""Lines of a drive that has settled, from one start: what a search compares designs by."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from microvib.analysis.accuracy import failed_invariants_reason
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.lines import find_lines
from microvib.analysis.margins import (
    ABOVE_PASSBAND_FACTOR,
    amplitude_bound,
    frequency_error_bound,
    may_ring,
)
from microvib.analysis.start import (
    current_loop_reason,
    not_moving_reason,
    not_sliding_reason,
    unseen_growth_reason,
)
from microvib.errors import MicrovibError
from microvib.model.expected import is_made
from microvib.model.line_names import is_unlisted
from microvib.model.scenario import Scenario
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import BELOW_FLOOR, Line, LineTable
from microvib.signals.tones import HannSpectrum
from microvib.solve.batch import torque_from_rest
from microvib.solve.integration import simulate_from_rest
from microvib.solve.on_craft import LINE_OF_SIGHT_ACCELERATIONS
from microvib.studies.budget.sources import los_over_torque
from microvib.units import within_band

_DECAY_RATIO = 0.3
"""Part of the decay by its own damping below which a mode's ringing is not that of its start."""
_TOLD = 0.3
"""Decay over a record from which it is told how a mode decays."""


@dataclass(frozen=True)
class UntoldLine:
    """A line that was looked for and has no amplitude of its own: below the floor, not resolved, or
    hidden by others.
    """

    name: str
    frequency: float
    """Frequency at which it is expected [Hz]."""
    most: float
    """Upper bound of its amplitude [N m]."""
    is_faint: bool = False
    """Whether it is below the floor, and so no larger than what that hides."""
    is_made: bool = True
    """Whether anything in the drive makes it."""
    duration: float = math.nan
    """Length of record [s] from which it is told apart; nan where no length is known to help."""
    los: np.ndarray | None = None
    """Upper bound of both angles of the line of sight [rad], (2,); None where nobody asked for it."""

    def may_be_within(self, low: float, high: float) -> bool:
        """Whether it may lie between two frequencies [Hz]."""
        off = frequency_error_bound(self.frequency)
        return bool(within_band(self.frequency, low, high, off))


@dataclass(frozen=True)
class Unexplained:
    """Spectrum of what the lines of a record leave of its torque."""

    frequency: np.ndarray
    """[Hz], (n,)."""
    mean_square: np.ndarray
    """Part of each frequency in the mean square [N² m²], (n,)."""
    resolution: float
    """Distance [Hz] from which two lines are told apart, and the lowest frequency of a line."""
    slow: float
    """Upper bound [N m] of lines at lower frequencies, which the record does not tell from its mean."""

    @classmethod
    def of(cls, left: np.ndarray, table: LineTable) -> Unexplained:
        """Spectrum of samples without a mean (n,) that a table leaves."""
        spectrum = HannSpectrum.of(left, table.sample_rate)
        frequency = np.arange(spectrum.magnitude.size) / spectrum.duration
        slow = 0.0 if table.rest is None else ABOVE_PASSBAND_FACTOR * table.rest.slow
        mean_square = spectrum.magnitude**2 / _HANN_SQUARES
        return cls(frequency, mean_square, SEPARATION / spectrum.duration, slow)

    def tone(self, low: Any, high: Any) -> Any:
        """Amplitude [N m] of a tone that would hold all that is left between two frequencies [Hz], and
        within the resolution of them; scalars or arrays.
        """
        total = np.concatenate([[0.0], np.cumsum(self.mean_square)])
        first = np.searchsorted(self.frequency, low - self.resolution, "left")
        last = np.searchsorted(self.frequency, high + self.resolution, "right")
        return np.sqrt(2.0 * np.maximum(total[last] - total[first], 0.0))


_HANN_SQUARES = 3.0
"""Sum of the squares of a tone's bins over its mean square, in a spectrum with a Hann window."""
_NOTHING_LEFT = Unexplained(np.zeros(0), np.zeros(0), 0.0, 0.0)


@dataclass(frozen=True)
class DriveLines:
    """Lines of the disturbance torque of a drive that has come to its rate.

    Array modes that only ring from the start are left out: they die away, and no lever of a steady
    motion changes them. A mode that does not die away is a line.
    """

    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    amplitude: np.ndarray
    """[N m], (k,)."""
    residual: float
    """RMS of the torque less all lines and what rings [N m]."""
    left: Unexplained = _NOTHING_LEFT
    """Spectrum of that."""
    untold: tuple[UntoldLine, ...] = ()
    """Lines that were looked for and have no amplitude of their own."""
    los_names: tuple[str, ...] = ()
    """Names of lines of the line of sight, (m,); empty where nobody asked for them."""
    los_frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Their frequencies [Hz], (m,)."""
    los: np.ndarray | None = None
    """Complex amplitudes of both angles [rad], (m, 2)."""
    may_ring: frozenset[str] = frozenset()
    """Names of lines that may be a part of the ringing of the start, and not of a steady motion."""
    problem: str = ""
    """Why there is no motion at the rate; empty where there is one."""

    @property
    def rms(self) -> float:
        """RMS of the torque without what rings from the start [N m]."""
        return math.sqrt(0.5 * float(np.sum(self.amplitude**2)) + self.residual**2)

    @property
    def shown(self) -> DriveLines:
        """The part that is shown to be of a steady motion: lines that are resolved from the mean and from
        those that are not told, and cannot be the start's ringing.
        """
        keep = np.array(
            [self._is_shown(*one) for one in zip(self.names, self.frequency, strict=True)], bool
        )
        los_keep = np.array(
            [self._is_shown(*one) for one in zip(self.los_names, self.los_frequency, strict=True)],
            bool,
        )
        return replace(
            self,
            names=tuple(np.array(self.names, dtype=object)[keep]),
            frequency=self.frequency[keep],
            amplitude=self.amplitude[keep],
            residual=0.0,
            left=_NOTHING_LEFT,
            untold=(),
            los_names=tuple(np.array(self.los_names, dtype=object)[los_keep]),
            los_frequency=self.los_frequency[los_keep],
            los=None if self.los is None else self.los[los_keep],
        )

    def _is_shown(self, name: str, frequency: float) -> bool:
        reach = self.left.resolution
        if name in self.may_ring or frequency < reach:
            return False
        hides = (x for x in self.untold if x.is_made and not x.is_faint)
        return not (is_unlisted(name) and any(abs(x.frequency - frequency) < reach for x in hides))


def failed(problem: str) -> DriveLines:
    """Stand for a drive that does not come to its rate."""
    return DriveLines((), np.zeros(0), np.zeros(0), math.inf, problem=problem)


def measure_lines(scenario: Scenario, *, pointing: bool = False) -> DriveLines:
    """Simulate a drive from rest and measure the lines of its record, those of the line of sight,
    too, with ``pointing``.

    It has failed where the record begins before the array turns, before frictions with memory slide or before
    the current loop has settled, and where a mode may grow that no run shows.
    """
    not_lasting = (not_moving_reason, not_sliding_reason, current_loop_reason, unseen_growth_reason)
    if why := next(filter(None, (reason(scenario) for reason in not_lasting)), ""):
        return failed(why)
    try:
        if pointing:
            return _with_line_of_sight(scenario)
        torque = torque_from_rest(scenario)
        table = find_lines(torque)
        if why := failed_invariants_reason(table.broken, scenario):
            return failed(why)
    except MicrovibError as error:
        return failed(" ".join(str(error).split()))
    return _lines_of(scenario, table, torque.T_d)


def _with_line_of_sight(scenario: Scenario) -> DriveLines:
    kept = ("T_d", "stuck_output", "alpha_l", "alpha_m", *LINE_OF_SIGHT_ACCELERATIONS)
    motion = simulate_from_rest(scenario, channels=kept, balanced=False)
    table = find_lines(motion)
    if why := failed_invariants_reason(table.broken, scenario):
        return failed(why)
    own = _lines_of(scenario, table, motion["T_d"])
    seen = hub_lines(motion, table, los_only=True)
    assert seen.los is not None
    counted = [name not in seen.driven and _lasts(name, own, table) for name in seen.names]
    los = np.nan_to_num(seen.los[counted])
    names = tuple(name for name, kept in zip(seen.names, counted, strict=True) if kept)
    return replace(
        own,
        untold=_with_los(own.untold, scenario),
        los_names=names,
        los_frequency=seen.frequency[counted],
        los=los,
    )


def _with_los(untold: tuple[UntoldLine, ...], scenario: Scenario) -> tuple[UntoldLine, ...]:
    """Lines with what they may do to the line of sight, through the drive's motion."""
    if not untold:
        return untold
    most = los_over_torque(scenario, np.array([x.frequency for x in untold]))
    return tuple(replace(x, los=x.most * one) for x, one in zip(untold, most, strict=True))


def _lasts(name: str, own: DriveLines, table: LineTable) -> bool:
    """Whether a line of the line of sight lasts: all but the modes that T_d shows to die away."""
    is_mode = any(x.name == name and x.is_mode for x in table)
    return name in own.names or not is_mode


def _lines_of(scenario: Scenario, table: LineTable, T_d: np.ndarray) -> DriveLines:
    seen = [x for x in table if x.seen and math.isfinite(x.amplitude)]
    lasting = [x for x in seen if not x.is_mode or _keeps_ringing(x, scenario, table.duration)]
    left = _left_by(T_d, table.sample_rate, seen)
    return DriveLines(
        tuple(x.name for x in lasting),
        np.array([x.frequency for x in lasting]),
        np.array([x.amplitude for x in lasting]),
        float(left.std()),
        Unexplained.of(left - left.mean(), table),
        tuple(_untold(x, table, scenario) for x in table if not x.seen and _has_bound(x)),
        may_ring=frozenset(x.name for x in lasting if may_ring(x, table, scenario)),
    )


def _untold(line: Line, table: LineTable, scenario: Scenario) -> UntoldLine:
    return UntoldLine(
        line.name,
        line.place,
        amplitude_bound(line),
        line.status == BELOW_FLOOR,
        is_made(line.name, scenario),
        _duration_needed(line, table),
    )


def _duration_needed(line: Line, table: LineTable) -> float:
    """Length of record [s] that resolves a line from its mean and from others of the clock; nan where this
    record does, and it is hidden all the same: by what rings, or because it still changes.
    """
    near = [abs(x.place - line.place) for x in table if x is not line and x.of_clock]
    needed = SEPARATION / max(min(line.place, *near), 1e-12)
    return needed if needed > table.duration else math.nan


def _has_bound(line: Line) -> bool:
    """Whether a line that is not seen counts with its bound: all but modes that others hide, whose bound
    may be what rings from the start.
    """
    return not line.is_mode or line.status == BELOW_FLOOR


def _keeps_ringing(mode: Line, scenario: Scenario, duration: float) -> bool:
    """Whether a mode does not die away as its damping says: friction feeds it."""
    if mode.status == "growing":
        return True
    decays = scenario.load.decay
    own = float(decays.min(initial=math.inf))
    told = own * duration >= _TOLD and math.isfinite(mode.decay)
    return told and mode.decay < _DECAY_RATIO * own


def _left_by(T_d: np.ndarray, sample_rate: float, lines: list[Line]) -> np.ndarray:
    """Samples (n,) less their mean and some lines."""
    left = T_d - T_d.mean()
    time = np.arange(left.size) / sample_rate
    for tone in _tones(time, lines):
        left = left - tone
    return left


def _tones(time: np.ndarray, lines: list[Line]) -> Iterator[np.ndarray]:
    for line in lines:
        decay = line.decay if math.isfinite(line.decay) else 0.0
        tone = line.amplitude * np.cos(2.0 * math.pi * line.frequency * time + line.phase)
        if decay:
            tone *= (
                line.amplitude_at_start(float(time[-1])) / line.amplitude * np.exp(-decay * time)
            )
        yield tone
