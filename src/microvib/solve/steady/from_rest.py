"""Runs in time from rest: whether they lead to a motion that was found, and the motion that they themselves settle to.

What a drive does follows from how it began, and every run begins at rest. A motion that repeats with the command is therefore
taken only if a start from rest leads to it, which is seen in the disturbance torque: its deviation must die out. How long that
takes follows from the slowest decay; only where the deviation is seen to decay as that of small deviations does, again and
again while it gets smaller, is it shortened instead of waited for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.integration import stopped
from microvib.solve.sampling import samples_into
from microvib.solve.steady.period import NotPeriodic, PeriodMap

ARRIVED = 0.01
"""Deviation of the torque, over the RMS of the torque, at which a start from rest has arrived."""
WINDOW = 0.15
"""Decay times over which a deviation is averaged, or a cycle of the slowest mode if that is longer."""
REGULAR = (0.5, 2.5)
"""Rate of the decay, over that of small deviations, within which a deviation may be shortened."""
SHORTENED_BELOW = 0.5
"""Part of its largest value below which a deviation may be shortened: above it, each start is its own."""
SHORTENED_TO = 0.4
"""Part of a deviation that is left when it is shortened."""
STALLED = (1.5, 0.8)
"""Decay times in which a deviation must fall at least to this part of itself."""
MOST_MICROSTEPS = 1_000_000
"""Microsteps of a run from rest, at most."""
MOST_STEPS = 5_000_000
"""Steps of its integration, at most: some seconds of computing."""
LONGEST = 3000.0
"""Time [s] that it simulates, at most."""
SETTLED = 5e-4
"""Estimated deviation from a motion that repeats, over the RMS of the torque, at which a run has settled."""
GIVEN_UP = (3.0, 0.8)
"""Decay times in which what changes from period to period must fall at least to this part of itself."""
SEEN_OVER = 0.7
"""Decay times, at least, over which a change is looked at: what decays slowly changes little from period to period."""
MULTIPLES = 6
"""Periods of the command after which the motion of a run may repeat, at most."""
LONGEST_MULTIPLE = 200.0
"""Time [s] beyond which such multiples are not looked for."""
MOST_PARTS = 64
"""Parts of a long period at whose ends it is asked whether the run has settled."""
HIGHEST = 2.0
"""Averages of the torque in a cycle of the fastest mode, at least."""
SETTLES_WITHIN = 12.0
"""Decay times of the slowest mode in which a run must have settled."""
SHORTENED_WITHIN = 4.0
"""The same where deviations may be shortened."""
FOLLOWED = 4
"""States in each stretch over which a change is averaged, at most, from which it is seen where a deviation goes."""
BROUGHT_TO = 0.2
"""Part of a deviation that is left when a run that is followed is shortened."""
INDEPENDENT = 1e-3
"""Part of the largest singular value below which directions of a deviation are noise."""
BETTER, MISLED = 0.6, 3
"""Part of a change that may be left after a deviation was shortened, and how often more may be: it goes elsewhere then."""
DIED_OUT = 0.01
"""Change, over that of a run that has settled, below which nothing is shortened."""
FARTHEST = 4.0
"""Distance to where a deviation goes, over what was seen of it, at most."""
SLOWEST = 1e-4
"""Rate [1/s] that a decay is taken to have at least."""
LIGHT = 0.5
"""Damping ratio above which a mode does not ring."""


NOT_SETTLED = (
    "a run from rest does not settle to a motion that repeats with the command: friction keeps a mode ringing, or slips vary from"
    " period to period (a longer record.settle and record.duration show what they settle to)"
)


class NotReached(NotPeriodic):
    """A start from rest does not lead to the motion that was found."""


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
    simulated: float
    """Time [s] that was simulated."""


class Ringing:
    """The slowest decay [1/s] and the longest and shortest cycle [s] of what rings in a drive: (``decay``, ``cycle``, ``top``)."""

    def __init__(self, scenario: Scenario) -> None:
        modes = [m for m in coupled_modes(scenario) if m.frequency > 0.0]
        self.decay = max(min((m.decay for m in modes), default=math.inf), SLOWEST)
        modes = [m for m in modes if m.damping < LIGHT]
        self.cycle = max((1.0 / m.frequency for m in modes), default=0.0)
        self.top = max((m.frequency for m in modes), default=0.0)


class RunFromRest:
    """A run in time under the command of a ``PeriodMap``, that begins as every run of its scenario does."""

    def __init__(self, period: PeriodMap) -> None:
        self.period, self.ringing = period, Ringing(period.scenario)
        self.rows = math.ceil(max(HIGHEST * self.ringing.top * period.microstep_time, 2.0))
        """Averages of the torque in each microstep."""
        self.simulated = 0.0

    def begin(self, parts: int = 1) -> None:
        """Go from rest to the first of the ``parts`` of a period that begins under the rate of the record."""
        period, scenario = self.period, self.period.scenario
        period.rest()
        self._begun = int(period.packed.state.counters[kernel.STEPS])
        times, _ = scenario.tracking.breakpoints()
        now = int(np.searchsorted(times, scenario.record.settle, side="right")) - 1
        since = float(times[now]) + scenario.driver.delay
        part = period.microsteps // parts
        self._made = part * math.ceil((since - period.start) / (part * period.microstep_time) + 1e-6)
        stop = self._time(self._made)
        given = Command(scenario)
        if stop > LONGEST or abs(float(np.diff(given.count(np.array([0.0, stop])))[0])) > MOST_MICROSTEPS:
            raise NotPeriodic("the rate of the record begins too late for a run from rest that shows its steady state")
        self._go(stop, *given.microsteps(0.0, stop))

    def advance(self, microsteps: int, rows: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Means of torque [N m] and of the output's stick over the next ``microsteps``, with ``rows`` in each of them."""
        packed, count = self.period.packed, microsteps * rows
        stop = self._time(self._made + microsteps)
        samples = None
        if count:
            buffer, now = np.zeros((count, packed.torque_columns)), self._time(self._made)
            samples = samples_into(buffer, now, (stop - now) / count)
        self._go(stop, *self.period.command.microsteps(self._time(self._made), stop), samples)
        self._made += microsteps
        return packed.torque_of(samples.rows) if samples is not None else (np.zeros(0), np.zeros(0))

    def leads_to(self, x: np.ndarray, T_d: np.ndarray, decay: float, shortened: bool = True) -> None:
        """Show that a start from rest leads to a motion; NotReached where it does not, or takes too long.

        Parameters
        ----------
        x : (n,)
            State at the start of the period, seen from the command.
        T_d : (microsteps x ``rows``,)
            Its torque [N m].
        decay : float
            Rate [1/s] at which small deviations from it die out.
        shortened : bool
            Whether a deviation that decays as small ones do may be shortened instead of waited for.
        """
        period, size = self.period, _rms(T_d)
        whole = 1.0 / period.frequency
        decay = max(decay, 1e-9)
        periods = math.ceil(max(self.ringing.cycle, WINDOW / decay) * period.frequency - 1e-9)
        if periods * whole > self._longest / 8.0:
            raise NotReached(
                f"small deviations take {1.0 / decay:.3g} s to die out by a factor e, too long to be waited for"
            )
        looked = max(math.ceil(STALLED[0] / (decay * periods * whole)), 3)
        self.begin()
        largest = expected = 0.0
        regular, left, history = 0, 1.0, []
        while self.simulated < self._longest:
            torque, _ = self.advance(periods * period.microsteps, self.rows)
            away = _rms(torque.reshape(periods, -1) - T_d)
            if away <= ARRIVED * size:
                return
            largest = max(largest, away)
            rate = math.log(expected / away) / (periods * whole) if expected else 0.0
            regular = regular + 1 if REGULAR[0] * decay <= rate <= REGULAR[1] * decay else 0
            history.append(away / left)
            if len(history) > looked and history[-1] > STALLED[1] * history[-1 - looked]:
                break
            expected = away
            if shortened and regular >= 2 and away <= SHORTENED_BELOW * largest:
                period.put(x + SHORTENED_TO * (self._seen(period) - x))
                self._made, expected, left = 0, SHORTENED_TO * away, SHORTENED_TO * left
        raise NotReached("a start from rest does not lead to the motion that repeats with the command")

    def settled(self, rows: int) -> Settled:
        """The motion that a run from rest settles to, with at least ``rows`` means of the torque in each microstep.

        Raises NotPeriodic where it has not settled to one that repeats after a few periods of the command.
        """
        period, ringing = self.period, self.ringing
        whole = 1.0 / period.frequency
        span = max(ringing.cycle, WINDOW / ringing.decay, whole / MOST_PARTS)
        parts = _parts(period.microsteps, whole / span) if span < whole else 1
        chunk = period.microsteps // parts * max(math.ceil(span / whole), 1)
        decays = (SHORTENED_WITHIN if parts == 1 else SETTLES_WITHIN) / ringing.decay
        room = min(LONGEST_MULTIPLE, self._longest - decays - 2.0 * whole)
        multiples = range(1, max(min(MULTIPLES, int(room / whole)), 1) + 1)
        periods = (multiples[-1] + 2) * whole
        if decays + periods > self._longest:
            raise NotPeriodic(self._too_long(decays))
        self.begin(parts)
        lag = max(self._lag(multiple) for multiple in multiples)
        self._torque, self._kept = np.zeros(0), (chunk + (lag + multiples[-1] + 1) * period.microsteps) * self.rows
        looked = math.ceil(GIVEN_UP[0] / (ringing.decay * chunk * period.microstep_time))
        near, changes, decaying = 0, [math.inf] * looked, _Decaying(self) if parts == 1 else None
        watch = self._watch if decaying is None else decaying.watch
        most = min(SETTLES_WITHIN / ringing.decay + periods, self._longest)
        while self.simulated < most:
            watch(chunk)
            multiple, change = self._repeats(chunk * self.rows, multiples)
            near = near + 1 if multiple else 0
            if near >= 2 and (found := self._period(multiple, self.rows * math.ceil(rows / self.rows))):
                return found
            changes.append(change)
            if self.simulated > (multiples[-1] + 1) * whole and change > GIVEN_UP[1] * changes[-1 - looked]:
                break
            if not near and decaying is not None and decaying.shortened(self._change(chunk * self.rows, 1)):
                self._torque, changes = np.zeros(0), [math.inf] * looked
        waited = self.simulated >= most == self._longest
        raise NotPeriodic(self._too_long(SETTLES_WITHIN / ringing.decay) if waited else NOT_SETTLED)

    def _too_long(self, decays: float) -> str:
        """Why a run of so many seconds of ``decays``, or of periods, is not made."""
        period, whole = self.period, 1.0 / self.period.frequency
        if whole < 0.3 * decays:
            return f"the slowest mode needs {decays:.3g} s to die out, too long for a run from rest that shows it"
        return (
            f"the common period of the command and all that repeats with it is {period.microsteps} microsteps ({whole:.3g} s),"
            f" too long for a run from rest that shows it{_leave_out(period.scenario)}"
        )

    def _watch(self, microsteps: int) -> None:
        """Advance, and keep the last of the torque."""
        self._torque = np.concatenate([self._torque, self.advance(microsteps, self.rows)[0]])[-self._kept :]

    def _repeats(self, last: int, multiples: Iterable[int]) -> tuple[int, float]:
        """After how many periods of the command the ``last`` of the torque repeats, 0 where it does not; and its least change, over
        the RMS of the torque."""
        least = math.inf
        for multiple in multiples:
            at_once = self._change(last, multiple)
            least = min(least, at_once)
            lag = self._lag(multiple)
            left = -math.expm1(-0.5 * self.ringing.decay * lag / self.period.frequency)
            if at_once <= SETTLED and self._change(last, lag) <= SETTLED * left:
                return multiple, at_once
        return 0, least

    def _change(self, last: int, periods: int) -> float:
        """Change of the ``last`` of the torque from ``periods`` before, over the RMS of the torque; infinite before it is known."""
        lag = periods * self.period.microsteps * self.rows
        if lag + last > self._torque.size:
            return math.inf
        return _rms(self._torque[-last:] - self._torque[-last - lag : -lag]) / _rms(self._torque)

    def _lag(self, multiple: int) -> int:
        """Periods of the command, a multiple of ``multiple``, over which a change shows."""
        return multiple * math.ceil(SEEN_OVER * self.period.frequency / (self.ringing.decay * multiple))

    def _period(self, multiple: int, rows: int) -> Settled | None:
        """The motion over the ``multiple`` periods that come next, if it is throughout what it was before."""
        own = self.period
        period = own if multiple == 1 else PeriodMap(own.scenario, multiple * own.microsteps)
        ahead = round((own.start - period.start) / own.microstep_time)
        self._watch((-self._made - ahead) % period.microsteps)
        begun, stick = self._seen(period, ahead), self.period.stick_turned(own.packed.state.stick, -self._made - ahead)
        T_d, output = self.advance(period.microsteps, rows)
        means = T_d.reshape(-1, rows // self.rows).mean(axis=1)
        self._torque = np.concatenate([self._torque, means])
        if not self._repeats(means.size, [multiple])[0]:
            return None
        distance = float(np.max(np.abs(self._seen(period, ahead) - begun) / period.sizes))
        stuck = float(np.sum(output)) * period.microsteps * period.microstep_time / T_d.size
        return Settled(period, begun, stick, T_d, stuck, distance, self.simulated)

    def _seen(self, period: PeriodMap, ahead: int = 0) -> np.ndarray:
        """The state at the start of a ``period`` that begins ``ahead`` microsteps before that of the run, seen from the command."""
        y = self.period.packed.state.y[None]
        return period.from_command(y, period.turn([-self._made - ahead]), np.zeros_like(y))[0]

    @property
    def _longest(self) -> float:
        """Time [s] that may be simulated."""
        return min(MOST_MICROSTEPS * self.period.microstep_time, LONGEST)

    def _time(self, made: int) -> float:
        return self.period.start + made * self.period.microstep_time

    def _go(self, stop: float, times: np.ndarray, commands: np.ndarray, samples: object = None) -> None:
        packed = self.period.packed
        begun = float(packed.state.clock[kernel.NOW])
        status = packed.advance(stop, samples or self.period.unseen, times, commands)
        now = float(packed.state.clock[kernel.NOW])
        self.simulated += now - begun
        if status != kernel.OK:
            raise NotPeriodic(f"a start from rest does not get there: {stopped(self.period.scenario, status, now)}")
        if packed.state.counters[kernel.STEPS] - self._begun > MOST_STEPS:
            raise NotPeriodic(
                f"a run from rest that shows it takes too many steps, of which {self.simulated:.3g} s had {MOST_STEPS}"
            )


class _Decaying:
    """A run whose deviation from a motion that repeats with each period of the command is shortened where it decays regularly.

    Where the deviation goes is seen from states at starts of periods, by reduced rank extrapolation (Sidi, Vector Extrapolation
    Methods, 2017): exact for a motion that is linear about it.
    """

    def __init__(self, run: RunFromRest) -> None:
        self.run, self.largest, self._before, self._misled = run, 0.0, math.inf, 0
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._states: list[np.ndarray] = []
        self._last, self._regular = math.inf, 0

    def watch(self, chunk: int) -> None:
        """Advance by ``chunk`` microsteps, whole periods, and keep states on the way."""
        period = self.run.period
        periods = chunk // period.microsteps
        pieces = _parts(periods, FOLLOWED)
        self._span = chunk * period.microstep_time
        for _ in range(pieces):
            self.run._watch(chunk // pieces)
            self._states.append(np.append(self.run._seen(period) / period.sizes, period.packed.state.stick[:2]))

    def shortened(self, change: float) -> bool:
        """Whether the deviation was shortened, after a ``change`` of the torque from one period to the next was seen."""
        if math.isinf(change) or self._misled >= MISLED:
            return False
        self._misled, self._before = self._misled + (change > BETTER * self._before), math.inf
        run, self.largest = self.run, max(self.largest, change)
        rate = math.log(self._last / change) / self._span if change > 0.0 and not math.isinf(self._last) else 0.0
        low, high = (r * run.ringing.decay for r in REGULAR)
        self._regular, self._last = self._regular + 1 if low <= rate <= high else 0, change
        if self._regular < 2 or not DIED_OUT * SETTLED < change <= SHORTENED_BELOW * self.largest:
            return False
        goal = self._goal(np.array(self._states[-3 * FOLLOWED - 1 :]))
        if goal is None:
            return False
        period = run.period
        now, stick = run._seen(period), period.stick_turned(period.packed.state.stick, -run._made)
        period.put(goal + BROUGHT_TO * (now - goal), stick)
        run._made, self._before = 0, change
        self._begin_anew()
        return True

    def _goal(self, states: np.ndarray) -> np.ndarray | None:
        """The state to which ``states`` (k, n + 2) decay; None where it is not seen, or where frictions do not stay as they are."""
        x, modes = states[:, :-2], states[:, -2:]
        if len(x) < 4 or np.ptp(modes, axis=0).any():
            return None
        steps = np.diff(x, axis=0).T
        goal = x[0] - steps[:, :-1] @ np.linalg.lstsq(np.diff(steps, axis=1), steps[:, 0], rcond=INDEPENDENT)[0]
        if np.max(np.abs(goal - x[-1])) > FARTHEST * np.max(np.ptp(x, axis=0)):
            return None
        result: np.ndarray = goal * self.run.period.sizes
        return result


def _leave_out(scenario: Scenario) -> str:
    """What makes the common period long, as keys to leave out; empty where it is the driver's alone."""
    keys = [f"reducer.train.{k}.errors" for k, stage in enumerate(scenario.reducer.train) if stage.errors]
    keys += ["reducer.transmission_error"] if scenario.reducer.transmission_error else []
    return f" ({', '.join(f'{key}: []' for key in keys)} leaves out what makes it long)" if keys else ""


def _parts(microsteps: int, most: float) -> int:
    """The largest number of equal parts of whole microsteps that is at most ``most`` and MOST_PARTS."""
    return next(k for k in range(min(int(most), MOST_PARTS), 0, -1) if microsteps % k == 0)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))
