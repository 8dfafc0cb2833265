"""Segments of a drive's period, in the lanes of the processor: many starts on one command, each for some microsteps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.solve import abreast, kernel
from microvib.solve.lanes import WIDTH
from microvib.solve.period import PeriodMap, interrupted


@dataclass(frozen=True)
class Ends:
    """Where segments ended, one row or entry for each."""

    x: np.ndarray
    """States, as seen from the command, (k, n)."""
    stuck: np.ndarray
    """Whether rotor and output stick at the end, (k, 2)."""
    ever: np.ndarray
    """Whether they stick at any time, (k, 2)."""
    stuck_output: np.ndarray
    """Time [s] that the output sticks, (k,)."""
    T_d: np.ndarray
    """Interval means of the disturbance torque [N m], of all segments in a row."""


class Segments:
    """The map of a period (``microvib.solve.period``), cut into parts that are computed at the same time."""

    def __init__(self, period: PeriodMap, rows: int) -> None:
        """``rows`` intervals of each microstep are averaged where samples are wanted."""
        self.period, self.rows = period, rows
        self.part = math.gcd(period.microsteps, max(period.microsteps // 16, 1))
        units = period.microsteps // self.part
        self.bounds = np.rint(np.linspace(0, units, min(WIDTH, units) + 1)).astype(int) * self.part
        p = period.packed.drive
        longest = int(np.max(np.diff(self.bounds)))
        self._company = abreast.company(
            p.rigid, p.shaped, p.H.size, p.te.size // 3,
            taps=1, waiting=255, samples=rows * longest, microsteps=longest, together=True,
        )  # fmt: skip
        for lane in range(WIDTH):
            abreast.embark(self._company, lane, p)
        self._company.taps[:] = 1.0

    def advance(self, x: np.ndarray, first: np.ndarray, last: np.ndarray, sampled: bool = False) -> Ends:
        """From states ``x`` (k, n), seen from the command, at the microsteps ``first`` (k,) to the microsteps ``last``.

        Raises NotPeriodic where a drive fails.
        """
        parts = [slice(k, k + WIDTH) for k in range(0, len(x), WIDTH)]
        ends = [self._some(x[part], first[part], last[part], sampled) for part in parts]
        return Ends(*(np.concatenate([getattr(end, name) for end in ends]) for name in Ends.__dataclass_fields__))

    def _some(self, x: np.ndarray, first: np.ndarray, last: np.ndarray, sampled: bool) -> Ends:
        c, period, count = self._company, self.period, len(x)
        n = x.shape[1]
        self._board(period.absolute(x, first), first, last, sampled)
        started = c.state[n : n + 2, :count] == 0.0
        abreast.advance(c)
        for lane in range(count):
            if c.flags[lane, abreast.STATUS] == abreast.FAILED:
                raise interrupted(int(c.flags[lane, abreast.CODE]))
        period.evaluations += float(np.sum(last - first)) / period.microsteps
        end, stuck = c.state[:n, :count].T, c.state[n : n + 2, :count] == 0.0
        sticks = c.counters[:count, kernel.STICKS] - c.counters[:count, kernel.ROTOR_STICKS]
        ever = started | stuck | (np.array([c.counters[:count, kernel.ROTOR_STICKS], sticks]) > 0)
        if period.packed.drive.rigid:
            stuck, ever = stuck[[0, 0]], ever[[0, 0]]
        means = [c.out[lane, : c.flags[lane, abreast.ROWS]] for lane in range(count)]
        return Ends(
            x=period.from_command(end, last, x),
            stuck=stuck.T,
            ever=ever.T,
            stuck_output=c.control[:count, abreast.STUCK].copy(),
            T_d=np.concatenate(means),
        )

    def _board(self, y: np.ndarray, first: np.ndarray, last: np.ndarray, sampled: bool) -> None:
        """Put states (k, n) into the first lanes, each with its command."""
        c, period = self._company, self.period
        k, n = y.shape
        now = period.start + first * period.microstep_time
        c.state[:n, :k], c.state[n:] = y.T, 0.0
        clock, control, flags = c.state[n + 2 :], c.control, c.flags
        angle = period.angle(first)
        clock[kernel.NOW, :k], clock[kernel.NEXT_STEP, :k] = now, period.packed.drive.max_step
        clock[kernel.REF_A, :k], clock[kernel.REF_B, :k] = period.references(angle)
        clock[kernel.THETA_E, :k] = period.packed.drive.z * angle
        c.counters[:] = 0
        control[:], flags[:] = 0.0, 0
        control[:, abreast.FIRST] = control[:, abreast.RECORDED] = np.inf
        control[:k, abreast.END] = control[:k, abreast.KNOWN_UNTIL] = now + (last - first) * period.microstep_time
        flags[:, [abreast.STATUS, abreast.FACTOR, abreast.TAPS]] = abreast.IDLE, 1, 1
        flags[:k, abreast.STATUS], flags[:k, abreast.KNOWN] = abreast.RUNNING, last - first
        if sampled:
            control[:k, abreast.FIRST], control[:k, abreast.INTERVAL] = now, period.microstep_time / self.rows
            flags[:k, abreast.ROWS] = flags[:k, abreast.SAMPLES] = self.rows * (last - first)
        for lane in range(k):
            known = slice(first[lane], last[lane])
            c.times[lane, : last[lane] - first[lane]] = period.times[known]
            c.references[lane, : last[lane] - first[lane]] = period.commands[known]
        abreast.start(c)
