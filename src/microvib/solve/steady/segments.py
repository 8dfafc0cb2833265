"""Segments of a drive's period: many starts under one command, each for some microsteps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.solve import kernel
from microvib.solve.sampling import empty_sample_buffer, sample_buffer
from microvib.solve.steady.period import PeriodMap, search_error

MAX_SEGMENTS = 8
"""Segments of a period."""


@dataclass(frozen=True)
class SegmentEnds:
    """Where segments ended, one row or entry for each."""

    x: np.ndarray
    """States, as seen from the command, (k, n)."""
    stuck: np.ndarray
    """Whether rotor and output stick at the end, (k, 2)."""
    ever: np.ndarray
    """Whether they stick at any time in the segment, (k, 2)."""
    stuck_output: float
    """Time [s] that the output sticks, where samples are taken."""
    T_d: np.ndarray
    """Interval means of the disturbance torque [N m], of all segments in sequence."""


class Segments:
    """The map of a period (``microvib.solve.steady.period``), cut into ``most`` parts at most."""

    def __init__(self, period: PeriodMap, most: int = MAX_SEGMENTS) -> None:
        self.period = period
        self.part = math.gcd(period.microsteps, max(period.microsteps // 16, 1))
        units = period.microsteps // self.part
        self.bounds = np.rint(np.linspace(0, units, min(most, units) + 1)).astype(int) * self.part
        self._unseen = empty_sample_buffer(period.packed.torque_columns)._replace(width=0.0)

    def advance(
        self, x: np.ndarray, first: np.ndarray, last: np.ndarray, rows: int = 0
    ) -> SegmentEnds:
        """From states ``x`` (k, n), seen from the command, at the microsteps ``first`` (k,) to the
        microsteps ``last``.

        The torque is averaged over so many ``rows`` in each microstep, a multiple of its parts, or not
        sampled. Raises
        NotPeriodic where a drive fails.
        """
        period, packed = self.period, self.period.packed
        y, made = period.absolute(x, period.turn(first)), int(np.sum(last - first))
        samples, width = self._unseen, period.microstep_time / max(rows, 1)
        if rows:
            samples = sample_buffer(np.zeros((rows * made, packed.torque_columns)), 0.0, width)
        status, sticks, sticking = packed.advance_each(
            y,
            period.clocks(first),
            np.column_stack([first, last]) * period.parts,
            period.start + last * period.microstep_time,
            samples,
            period.times,
            period.commands,
        )
        if status != kernel.OK:
            raise search_error(status)
        period.evaluations += made / period.microsteps
        stuck, rests = (
            sticks == 0.0,
            np.column_stack([sticking[:, 0], sticking[:, 1] - sticking[:, 0]]),
        )
        ever, stuck = stuck[:, :2] | stuck[:, 2:] | (rests > 0), stuck[:, 2:]
        if packed.drive.rigid:
            stuck, ever = stuck[:, [0, 0]], ever[:, [0, 0]]
        T_d, output = packed.torque_of(samples.rows)
        return SegmentEnds(
            period.from_command(y, period.turn(-last), x),
            stuck,
            ever,
            float(np.sum(output)) * width,
            T_d,
        )
