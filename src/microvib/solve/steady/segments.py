"""Segments of a drive's period: many starts under one command, each for some microsteps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.solve import kernel
from microvib.solve.pack import no_samples
from microvib.solve.steady.period import PeriodMap, interrupted

MOST = 8
"""Segments of a period."""


@dataclass(frozen=True)
class Ends:
    """Where segments ended, one row or entry for each."""

    x: np.ndarray
    """States, as seen from the command, (k, n)."""
    stuck: np.ndarray
    """Whether rotor and output stick at the end, (k, 2)."""
    ever: np.ndarray
    """Whether they stick at any time in the segment, (k, 2)."""
    stuck_output: np.ndarray
    """Time [s] that the output sticks, (k,), where samples are taken."""
    T_d: np.ndarray
    """Interval means of the disturbance torque [N m], of all segments in sequence."""


class Segments:
    """The map of a period (``microvib.solve.steady.period``), cut into parts."""

    def __init__(self, period: PeriodMap, rows: int) -> None:
        """``rows`` intervals of each microstep are averaged where samples are needed."""
        self.period, self.rows = period, rows
        self.part = math.gcd(period.microsteps, max(period.microsteps // 16, 1))
        units = period.microsteps // self.part
        self.bounds = np.rint(np.linspace(0, units, min(MOST, units) + 1)).astype(int) * self.part
        self._unseen = no_samples(period.packed.torque_columns)._replace(width=0.0)

    def advance(self, x: np.ndarray, first: np.ndarray, last: np.ndarray, sampled: bool = False) -> Ends:
        """From states ``x`` (k, n), seen from the command, at the microsteps ``first`` (k,) to the microsteps ``last``.

        Raises NotPeriodic where a drive fails.
        """
        period, k = self.period, len(x)
        y = period.absolute(x, period.turn(first))
        stuck, ever, stuck_output, torques = np.zeros((k, 2), bool), np.zeros((k, 2), bool), np.zeros(k), []
        for j, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            state = period.packed.state
            period.set(y[j], begin)
            started, counted = state.stick == 0.0, state.counters.copy()
            T_d, stuck_output[j] = self._through(begin, end, sampled)
            y[j], stuck[j] = state.y, state.stick == 0.0
            on_rotor, on_both = (state.counters - counted)[[kernel.ROTOR_STICKS, kernel.STICKS]]
            ever[j] = started | stuck[j] | (np.array([on_rotor, on_both - on_rotor]) > 0)
            torques.append(T_d)
        period.evaluations += float(np.sum(last - first)) / period.microsteps
        if period.packed.drive.rigid:
            stuck, ever = stuck[:, [0, 0]], ever[:, [0, 0]]
        return Ends(period.from_command(y, period.turn(-last), x), stuck, ever, stuck_output, np.concatenate(torques))

    def _through(self, begin: int, end: int, sampled: bool) -> tuple[np.ndarray, float]:
        """Advance from one microstep to another: interval means of T_d [N m], and the time that the output sticks [s]."""
        period, packed = self.period, self.period.packed
        samples, start = self._unseen, period.start + begin * period.microstep_time
        width = period.microstep_time / self.rows
        if sampled:
            rows = np.zeros((self.rows * (end - begin), packed.torque_columns))
            samples = kernel.Samples(start, width, rows, samples.partial * 0.0, np.zeros(2, dtype=np.int64))
        stop = period.start + end * period.microstep_time
        status = packed.advance(stop, samples, period.times[begin:end], period.commands[begin:end])
        if status != kernel.OK:
            raise interrupted(status)
        if not sampled:
            return np.zeros(0), 0.0
        T_d, stuck = packed.torque_of(samples.rows)
        return T_d, float(np.sum(stuck)) * width
