"""Segments of a drive's period in the processor's lanes: many starts under one command, each for some microsteps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.solve import kernel, stepper
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
    """Whether they stick at any time in the segment, (k, 2)."""
    stuck_output: np.ndarray
    """Time [s] that the output sticks, (k,)."""
    T_d: np.ndarray
    """Interval means of the disturbance torque [N m], of all segments in sequence."""


@dataclass(frozen=True)
class _Schedule:
    """What the lanes need for given segments, whatever the states; names as in ``DriveGroup``."""

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
        """``rows`` intervals of each microstep are averaged where samples are needed."""
        self.period, self.rows = period, rows
        self.part = math.gcd(period.microsteps, max(period.microsteps // 16, 1))
        units = period.microsteps // self.part
        self.bounds = np.rint(np.linspace(0, units, min(WIDTH, units) + 1)).astype(int) * self.part
        p = period.packed.drive
        longest = int(np.max(np.diff(self.bounds)))
        self._group = stepper.drive_group(
            p.rigid, p.shaped, p.H.size, p.te.size // 3,
            taps=1, waiting=255, samples=rows * longest, microsteps=longest, together=True,
        )  # fmt: skip
        for lane in range(WIDTH):
            stepper.load_drive(self._group, lane, p)
        self._group.taps[:] = 1.0
        self._schedules: dict[tuple[bytes, bytes, bool], _Schedule] = {}

    def advance(self, x: np.ndarray, first: np.ndarray, last: np.ndarray, sampled: bool = False) -> Ends:
        """From states ``x`` (k, n), seen from the command, at the microsteps ``first`` (k,) to the microsteps ``last``.

        Raises NotPeriodic where a drive fails.
        """
        if len(x) <= WIDTH:
            return self._advance_group(x, self._schedule(first, last, sampled))
        parts = [slice(k, k + WIDTH) for k in range(0, len(x), WIDTH)]
        ends = [self._advance_group(x[part], self._schedule(first[part], last[part], sampled)) for part in parts]
        return Ends(*(np.concatenate([getattr(end, name) for end in ends]) for name in Ends.__dataclass_fields__))

    def _advance_group(self, x: np.ndarray, schedule: _Schedule) -> Ends:
        c, period, (count, n) = self._group, self.period, x.shape
        c.state[:n, :count], c.state[n:] = period.absolute(x, schedule.turn).T, 0.0
        c.state[n + 2 :, :count] = schedule.clock
        c.control[:], c.flags[:], c.counters[:] = schedule.control, schedule.flags, 0
        c.times[:], c.references[:] = schedule.times, schedule.references
        stepper.initial_friction(c)
        started = c.state[n : n + 2, :count] == 0.0
        stepper.advance(c)
        failed = c.flags[:count, stepper.STATUS] == stepper.FAILED
        if failed.any():
            raise interrupted(int(c.flags[failed.argmax(), stepper.CODE]))
        period.evaluations += schedule.periods
        stuck = c.state[n : n + 2, :count] == 0.0
        on_rotor = c.counters[:count, kernel.ROTOR_STICKS]
        ever = started | stuck | (np.array([on_rotor, c.counters[:count, kernel.STICKS] - on_rotor]) > 0)
        if period.packed.drive.rigid:
            stuck, ever = stuck[[0, 0]], ever[[0, 0]]
        means = [c.out[lane, : c.flags[lane, stepper.ROWS]] for lane in range(count)]
        return Ends(
            x=period.from_command(c.state[:n, :count].T, schedule.turn_back, x),
            stuck=stuck.T,
            ever=ever.T,
            stuck_output=c.control[:count, stepper.STUCK].copy(),
            T_d=np.concatenate(means),
        )

    def _schedule(self, first: np.ndarray, last: np.ndarray, sampled: bool) -> _Schedule:
        """The schedule of these segments, made once."""
        key = (first.tobytes(), last.tobytes(), sampled)
        if key not in self._schedules:
            self._schedules[key] = self._new_schedule(first, last, sampled)
        return self._schedules[key]

    def _new_schedule(self, first: np.ndarray, last: np.ndarray, sampled: bool) -> _Schedule:
        c, period, k = self._group, self.period, len(first)
        now, angle = period.start + first * period.microstep_time, period.angle(first)
        clock, control = np.zeros((kernel.N_CLOCK, k)), np.zeros_like(c.control)
        clock[kernel.NOW], clock[kernel.NEXT_STEP] = now, period.packed.drive.max_step
        clock[kernel.REF_A], clock[kernel.REF_B] = period.references(angle)
        clock[kernel.THETA_E] = period.packed.drive.z * angle
        control[:, stepper.FIRST] = control[:, stepper.RECORD_END] = np.inf
        control[:k, stepper.END] = control[:k, stepper.KNOWN_UNTIL] = now + (last - first) * period.microstep_time
        flags = np.zeros_like(c.flags)
        flags[:, [stepper.STATUS, stepper.FACTOR, stepper.TAPS]] = stepper.IDLE, 1, 1
        flags[:k, stepper.STATUS], flags[:k, stepper.KNOWN] = stepper.RUNNING, last - first
        if sampled:
            control[:k, stepper.FIRST], control[:k, stepper.INTERVAL] = now, period.microstep_time / self.rows
            flags[:k, stepper.ROWS] = flags[:k, stepper.SAMPLES] = self.rows * (last - first)
        times, references = np.zeros_like(c.times), np.zeros_like(c.references)
        for lane, (begin, end) in enumerate(zip(first, last, strict=True)):
            times[lane, : end - begin] = period.times[begin:end]
            references[lane, : end - begin] = period.commands[begin:end]
        return _Schedule(
            turn=period.turn(first),
            turn_back=period.turn(-last),
            clock=clock,
            control=control,
            flags=flags,
            times=times,
            references=references,
            periods=float(np.sum(last - first)) / period.microsteps,
        )
