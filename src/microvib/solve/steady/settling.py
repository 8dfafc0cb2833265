"""The motion that a run from rest settles to, where none can be searched for.

The run is looked at in stretches. It has settled when the torque of the last stretch repeats, that
is when it is what it was a period of the command before, or a few periods. Nothing is done to the run
meanwhile: what is made smaller may leave a mode that friction keeps ringing. What attitude control
still swings in the end, of which the torque hardly knows, is taken away
(``microvib.solve.steady.attitude``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from microvib.model.scenario import Scenario
from microvib.model.winding_up import seconds_until_sliding
from microvib.solve.steady.attitude import AttitudeModes
from microvib.solve.steady.from_rest import RunFromRest, rms
from microvib.solve.steady.period import NotPeriodic, PeriodMap

STRETCH = 0.15
"""Decay times in a stretch, or a cycle of the slowest mode if that is longer."""
MAX_PARTS = 64
"""Parts of a long period at whose ends it is asked whether the run has settled."""
SETTLED = 5e-4
"""Estimated deviation from a motion that repeats, over the RMS of the torque, at which a run has
settled.
"""
GIVE_UP_CRITERION = (3.0, 0.8)
"""Decay times in which what changes from period to period must fall at least to this part of
itself.
"""
MIN_CHANGE_WINDOW = 0.7
"""Decay times, at least, over which a change is looked at: what decays slowly changes little from
period to period.
"""
MAX_PERIOD_MULTIPLE = 16
"""Periods of the command after which the motion of a run may repeat, at most."""
MAX_MULTIPLE = 300.0
"""Time [s] beyond which such multiples are not looked for."""
EXPECTED_WITHIN = 7.0
"""Decay times of the slowest mode in which a run settles, as a rule."""
SETTLES_WITHIN = 12.0
"""Decay times of the slowest mode in which a run must have settled."""
ATTITUDE_SETTLED = 1e-3
"""Deviation of attitude control's modes, over what a microstep moves, at which a run has settled."""

NOT_SETTLED = (
    "no periodic steady state from rest: friction keeps a mode ringing, or stick-slip varies from"
    " period to period (a longer record.settle and record.duration show what they settle to)"
)


@dataclass(frozen=True)
class Settled:
    """The motion that a run from rest settled to."""

    period: PeriodMap
    state: np.ndarray
    """At the start of the period, seen from the command."""
    stick: np.ndarray
    """Modes and memory of the frictions there (``PeriodMap.stick_turned``)."""
    T_d: np.ndarray
    """Interval means of the disturbance torque over a period [N m]."""
    stuck_output: float
    """Time [s] in the period that the output sticks."""
    distance: float
    """Change of the state over the period, over what a microstep moves."""


class Settling:
    """A run from rest that is followed until its torque repeats."""

    def __init__(self, run: RunFromRest) -> None:
        self.run, self.whole = run, 1.0 / run.period.frequency
        self.parts, self.stretch = _cut(run)
        self.attitude = AttitudeModes(run.period.scenario)
        self.multiples = self._multiples()
        longest = max(self._lag(multiple) for multiple in self.multiples)
        kept = self.stretch + (longest + self.multiples[-1] + 1) * run.period.microsteps
        self._torque, self._kept = np.zeros(0), kept * run.rows

    def followed(self, rows: int) -> Settled:
        """The motion that the run settles to, with at least ``rows`` means of the torque in each
        microstep.

        Raises NotPeriodic where it has not settled to one that repeats after a few periods of the
        command.
        """
        most = self._most()
        self.run.begin(self.parts)
        most += self._wind_up()
        rows = self.run.rows * math.ceil(rows / self.run.rows)
        looked = math.ceil(
            GIVE_UP_CRITERION[0]
            / (self.run.ringing.decay * self.stretch * self.run.period.microstep_time)
        )
        near, changes = 0, [math.inf] * looked
        while self.run.simulated < most:
            self.watch(self.stretch)
            multiple, change = self._repeats(self.stretch * self.run.rows, self.multiples)
            near = near + 1 if multiple else 0
            if near >= 2 and (found := self._period(multiple, rows)):
                return found
            changes.append(change)
            if self._knows_all_multiples() and change > GIVE_UP_CRITERION[1] * changes[-1 - looked]:
                raise NotPeriodic(NOT_SETTLED)
        raise NotPeriodic(
            self._too_long(self._decays(SETTLES_WITHIN))
            if most == self.run.longest
            else NOT_SETTLED
        )

    def _wind_up(self) -> float:
        """Advance until frictions with memory slide, unwatched: before, the motion may repeat, too, but
        only for a time. Returns how long that takes [s]; NotPeriodic where it is too long.
        """
        run, period = self.run, self.run.period
        wait = seconds_until_sliding(period.scenario, run.now)
        if wait == 0.0:
            return 0.0
        if wait + run.simulated + self._expected() > run.longest:
            raise NotPeriodic(
                f"friction with memory slides only after {wait:.3g} s, too long for a run from rest"
            )
        stretches = math.ceil(wait / (self.stretch * period.microstep_time))
        run.advance(stretches * self.stretch)
        return stretches * self.stretch * period.microstep_time

    def _multiples(self) -> range:
        """Periods of the command after which the motion may repeat."""
        room = min(MAX_MULTIPLE, self.run.longest - self._expected() - 2.0 * self.whole)
        return range(1, max(min(MAX_PERIOD_MULTIPLE, int(room / self.whole)), 1) + 1)

    def _decays(self, times: float) -> float:
        """So many decay ``times`` of the slowest mode [s]."""
        return times / self.run.ringing.decay

    def _expected(self) -> float:
        """Time [s] that the run takes to settle, as a rule."""
        return self._decays(EXPECTED_WITHIN)

    def _most(self) -> float:
        """Time [s] in which it must have settled; NotPeriodic where that is too long."""
        periods = (self.multiples[-1] + 2) * self.whole
        if self._expected() + periods > self.run.longest:
            raise NotPeriodic(self._too_long(self._expected()))
        return min(self._decays(SETTLES_WITHIN) + periods, self.run.longest)

    def _too_long(self, decays: float) -> str:
        """Why a run of so many seconds of ``decays``, or of periods, is not made."""
        period = self.run.period
        if self.whole < 0.3 * decays:
            return f"the slowest mode needs {decays:.3g} s to decay, too long for a run from rest"
        return (
            f"the common period of the command and all that repeats with it is {period.microsteps}"
            " microsteps"
            f" ({self.whole:.3g} s), too long for a run from rest that shows"
            f" it{_shorter_period_hint(period.scenario)}"
        )

    def watch(self, microsteps: int) -> None:
        """Advance, and keep the last of the torque."""
        torque, _ = self.run.advance(microsteps, self.run.rows)
        self._torque = np.concatenate([self._torque, torque])[-self._kept :]

    def _knows_all_multiples(self) -> bool:
        """Whether enough has been simulated to see a motion that repeats after as many periods as
        may be.
        """
        return self.run.simulated > (self.multiples[-1] + 1) * self.whole

    def _repeats(self, last: int, multiples: Iterable[int]) -> tuple[int, float]:
        """After how many periods of the command the ``last`` of the torque repeats, 0 where it does
        not; and its least change, over the RMS of the torque."""
        least, size = math.inf, rms(self._torque)
        if size == 0.0:  # nothing moves yet, which repeats with any period
            return 0, math.inf
        for multiple in multiples:
            at_once = self._change(last, multiple) / size
            least = min(least, at_once)
            lag = self._lag(multiple)
            left = -math.expm1(-0.5 * self.run.ringing.decay * lag * self.whole)
            if at_once <= SETTLED and self._change(last, lag) / size <= SETTLED * left:
                return multiple, at_once
        return 0, least

    def _change(self, last: int, periods: int) -> float:
        """Change [N m] of the ``last`` of the torque from ``periods`` before; infinite before it is
        known.
        """
        lag = periods * self.run.period.microsteps * self.run.rows
        if lag + last > self._torque.size:
            return math.inf
        return rms(self._torque[-last:] - self._torque[-last - lag : -lag])

    def _lag(self, multiple: int) -> int:
        """Periods of the command, a multiple of ``multiple``, over which a change shows."""
        return multiple * math.ceil(self._decays(MIN_CHANGE_WINDOW) / (self.whole * multiple))

    def _period(self, multiple: int, rows: int) -> Settled | None:
        """The motion over the ``multiple`` periods that come next, if it is throughout what it was
        before, and attitude control rests.
        """
        run, own = self.run, self.run.period
        if multiple == 1:
            period = own
        else:
            period = PeriodMap(own.scenario, multiple * own.microsteps)
        ahead = round((own.start - period.start) / own.microstep_time)
        self.watch((-run.made - ahead) % period.microsteps)
        begun, stick = run.seen(period, ahead), run.stick(ahead)
        T_d, output = run.advance(period.microsteps, rows)
        means = T_d.reshape(-1, rows // run.rows).mean(axis=1)
        self._torque = np.concatenate([self._torque, means])
        if not self._repeats(means.size, [multiple])[0]:
            return None
        ended = run.seen(period, ahead)
        swings = self.attitude.deviation(begun, ended, 1.0 / period.frequency)
        if np.max(np.abs(swings) / period.sizes) > ATTITUDE_SETTLED:
            run.take_away(swings)
            return None
        distance = float(np.max(np.abs(ended - begun) / period.sizes))
        stuck = float(np.sum(output)) * period.microsteps * period.microstep_time / T_d.size
        return Settled(period, begun, stick, T_d, stuck, distance)


def _cut(run: RunFromRest) -> tuple[int, int]:
    """Into how many parts a period is cut at whose ends the run is looked at, and the microsteps
    from one look to the next.
    """
    period, ringing = run.period, run.ringing
    whole = 1.0 / period.frequency
    span = max(ringing.cycle, STRETCH / ringing.decay, whole / MAX_PARTS)
    if span < whole:
        parts = _parts(period.microsteps, whole / span)
    else:
        parts = 1
    return parts, period.microsteps // parts * max(math.ceil(span / whole), 1)


def _shorter_period_hint(scenario: Scenario) -> str:
    """Causes of a long common period, as keys to leave out; empty where it is the driver's
    alone.
    """
    keys = [
        f"reducer.train.{k}.errors"
        for k, stage in enumerate(scenario.reducer.train)
        if stage.errors
    ]
    if scenario.reducer.transmission_error:
        keys += ["reducer.transmission_error"]
    if scenario.driver.compensates:
        keys += ["driver.compensation"]
    if any(order % scenario.motor.full_steps for order in scenario.motor.detent_orders):
        keys += ["motor.detent"]
    if keys:
        return f" ({', '.join(f'{key}: []' for key in keys)} removes what lengthens it)"
    return ""


def _parts(microsteps: int, most: float) -> int:
    """The largest number of equal parts of whole microsteps that is at most ``most`` and
    MOST_PARTS.
    """
    return next(k for k in range(min(int(most), MAX_PARTS), 0, -1) if microsteps % k == 0)
