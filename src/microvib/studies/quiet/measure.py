"""Lines of a drive that has settled, from one start: what a search compares designs by."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from microvib.analysis.accuracy import failed_invariants_reason
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.lines import find_lines
from microvib.analysis.margins import amplitude_bound
from microvib.analysis.start import not_moving_reason, not_sliding_reason
from microvib.errors import MicrovibError
from microvib.model.scenario import Scenario
from microvib.signals.line_table import BELOW_FLOOR, Line, LineTable
from microvib.solve.batch import torque_from_rest
from microvib.solve.integration import simulate_from_rest
from microvib.solve.on_craft import LINE_OF_SIGHT_ACCELERATIONS

_DECAY_RATIO = 0.3
"""Part of the decay by its own damping below which a mode's ringing is not that of its start."""
_TOLD = 0.3
"""Decay over a record from which it is told how a mode decays."""


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
    bounds: tuple[tuple[str, float], ...] = ()
    """Lines that were looked for and have no amplitude of their own, with what they have at most [N m]:
    those below the floor, and those that others hide."""
    los_frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Frequencies of lines of the line of sight [Hz], (m,); empty where nobody asked for them."""
    los: np.ndarray | None = None
    """Complex amplitudes of both angles [rad], (m, 2)."""
    problem: str = ""
    """Why there is no motion at the rate; empty where there is one."""

    @property
    def rms(self) -> float:
        """RMS of the torque without what rings from the start [N m]."""
        return math.sqrt(0.5 * float(np.sum(self.amplitude**2)) + self.residual**2)

    @property
    def unexplained(self) -> float:
        """Amplitude of a tone that would hold all that is left beside the lines [N m]."""
        return math.sqrt(2.0) * self.residual


def failed(problem: str) -> DriveLines:
    """Stand for a drive that does not come to its rate."""
    return DriveLines((), np.zeros(0), np.zeros(0), math.inf, problem=problem)


def measure_lines(scenario: Scenario, *, pointing: bool = False) -> DriveLines:
    """Simulate a drive from rest and measure the lines of its record, those of the line of sight,
    too, with ``pointing``.

    It has failed where the record begins before the array turns, or before frictions with memory slide.
    """
    if why := not_moving_reason(scenario) or not_sliding_reason(scenario):
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
    return replace(own, los_frequency=seen.frequency[counted], los=los)


def _lasts(name: str, own: DriveLines, table: LineTable) -> bool:
    """Whether a line of the line of sight lasts: all but the modes that T_d shows to die away."""
    is_mode = any(x.name == name and x.is_mode for x in table)
    return name in own.names or not is_mode


def _lines_of(scenario: Scenario, table: LineTable, T_d: np.ndarray) -> DriveLines:
    seen = [x for x in table if x.seen and math.isfinite(x.amplitude)]
    lasting = [x for x in seen if not x.is_mode or _keeps_ringing(x, scenario, table.duration)]
    residual = _residual_rms(T_d, table.sample_rate, seen)
    return DriveLines(
        tuple(x.name for x in lasting),
        np.array([x.frequency for x in lasting]),
        np.array([x.amplitude for x in lasting]),
        residual,
        tuple((x.name, amplitude_bound(x)) for x in table if not x.seen and _has_bound(x)),
    )


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


def _residual_rms(T_d: np.ndarray, sample_rate: float, lines: list[Line]) -> float:
    """RMS of samples (n,) less their mean and some lines."""
    left = T_d - T_d.mean()
    time = np.arange(left.size) / sample_rate
    for tone in _tones(time, lines):
        left = left - tone
    return float(left.std())


def _tones(time: np.ndarray, lines: list[Line]) -> Iterator[np.ndarray]:
    for line in lines:
        decay = line.decay if math.isfinite(line.decay) else 0.0
        tone = line.amplitude * np.cos(2.0 * math.pi * line.frequency * time + line.phase)
        if decay:
            tone *= (
                line.amplitude_at_start(float(time[-1])) / line.amplitude * np.exp(-decay * time)
            )
        yield tone
