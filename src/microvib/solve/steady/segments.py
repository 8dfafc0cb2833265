"""Segments of a drive's period, in the lanes of the processor: many starts on one command, each for some microsteps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.solve import kernel
from microvib.solve import stepper as abreast
from microvib.solve.steady.period import PeriodMap, Turn, interrupted
from microvib.solve.vector import WIDTH


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


@dataclass(frozen=True)
class _Orders:
    """What the lanes are told for given segments, whatever their states; as in a ``Company``."""

    turn: Turn
    """From states seen from the command to those of the drive, at the beginning."""
    turn_back: Turn
    """And back, at the end."""
    clock: np.ndarray
    control: np.ndarray
    flags: np.ndarray
    times: np.ndarray
    references: np.ndarray
    periods: float
    """Periods in all."""


class Segments:
    """The map of a period (``microvib.solve.steady.period``), cut into parts that are computed at the same time."""

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
        self._known: dict[tuple[bytes, bytes, bool], _Orders] = {}

    def advance(self, x: np.ndarray, first: np.ndarray, last: np.ndarray, sampled: bool = False) -> Ends:
        """From states ``x`` (k, n), seen from the command, at the microsteps ``first`` (k,) to the microsteps ``last``.

        Raises NotPeriodic where a drive fails.
        """
        if len(x) <= WIDTH:
            return self._some(x, self._orders(first, last, sampled))
        parts = [slice(k, k + WIDTH) for k in range(0, len(x), WIDTH)]
        ends = [self._some(x[part], self._orders(first[part], last[part], sampled)) for part in parts]
        return Ends(*(np.concatenate([getattr(end, name) for end in ends]) for name in Ends.__dataclass_fields__))

    def _some(self, x: np.ndarray, orders: _Orders) -> Ends:
        c, period, (count, n) = self._company, self.period, x.shape
        c.state[:n, :count], c.state[n:] = period.absolute(x, orders.turn).T, 0.0
        c.state[n + 2 :, :count] = orders.clock
        c.control[:], c.flags[:], c.counters[:] = orders.control, orders.flags, 0
        c.times[:], c.references[:] = orders.times, orders.references
        abreast.start(c)
        started = c.state[n : n + 2, :count] == 0.0
        abreast.advance(c)
        failed = c.flags[:count, abreast.STATUS] == abreast.FAILED
        if failed.any():
            raise interrupted(int(c.flags[failed.argmax(), abreast.CODE]))
        period.evaluations += orders.periods
        stuck = c.state[n : n + 2, :count] == 0.0
        on_rotor = c.counters[:count, kernel.ROTOR_STICKS]
        ever = started | stuck | (np.array([on_rotor, c.counters[:count, kernel.STICKS] - on_rotor]) > 0)
        if period.packed.drive.rigid:
            stuck, ever = stuck[[0, 0]], ever[[0, 0]]
        means = [c.out[lane, : c.flags[lane, abreast.ROWS]] for lane in range(count)]
        return Ends(
            x=period.from_command(c.state[:n, :count].T, orders.turn_back, x),
            stuck=stuck.T,
            ever=ever.T,
            stuck_output=c.control[:count, abreast.STUCK].copy(),
            T_d=np.concatenate(means),
        )

    def _orders(self, first: np.ndarray, last: np.ndarray, sampled: bool) -> _Orders:
        """Made once for the same segments."""
        key = (first.tobytes(), last.tobytes(), sampled)
        if key not in self._known:
            self._known[key] = self._made(first, last, sampled)
        return self._known[key]

    def _made(self, first: np.ndarray, last: np.ndarray, sampled: bool) -> _Orders:
        c, period, k = self._company, self.period, len(first)
        now, angle = period.start + first * period.microstep_time, period.angle(first)
        clock, control = np.zeros((kernel.N_CLOCK, k)), np.zeros_like(c.control)
        clock[kernel.NOW], clock[kernel.NEXT_STEP] = now, period.packed.drive.max_step
        clock[kernel.REF_A], clock[kernel.REF_B] = period.references(angle)
        clock[kernel.THETA_E] = period.packed.drive.z * angle
        control[:, abreast.FIRST] = control[:, abreast.RECORDED] = np.inf
        control[:k, abreast.END] = control[:k, abreast.KNOWN_UNTIL] = now + (last - first) * period.microstep_time
        flags = np.zeros_like(c.flags)
        flags[:, [abreast.STATUS, abreast.FACTOR, abreast.TAPS]] = abreast.IDLE, 1, 1
        flags[:k, abreast.STATUS], flags[:k, abreast.KNOWN] = abreast.RUNNING, last - first
        if sampled:
            control[:k, abreast.FIRST], control[:k, abreast.INTERVAL] = now, period.microstep_time / self.rows
            flags[:k, abreast.ROWS] = flags[:k, abreast.SAMPLES] = self.rows * (last - first)
        times, references = np.zeros_like(c.times), np.zeros_like(c.references)
        for lane, (begin, end) in enumerate(zip(first, last, strict=True)):
            times[lane, : end - begin] = period.times[begin:end]
            references[lane, : end - begin] = period.commands[begin:end]
        return _Orders(
            turn=period.turn(first),
            turn_back=period.turn(-last),
            clock=clock,
            control=control,
            flags=flags,
            times=times,
            references=references,
            periods=float(np.sum(last - first)) / period.microsteps,
        )
