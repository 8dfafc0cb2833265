"""The periodic steady state at constant rate, found directly: ``steady_state(scenario)``.

It is the state that a period of the command maps to itself (``microvib.solve.steady.search``).
Solving for it replaces the minute that array modes take to settle; friction, stick and detent are
the kernel's own, because the kernel integrates the period.
"""

from __future__ import annotations

import math
import time as clock_time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from microvib.errors import error_context
from microvib.former_names import FormerName
from microvib.model.linear import sliding_growth
from microvib.model.parametric import growth_over_angle
from microvib.model.record import PASSBAND
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.model.turning import GROWN_EFOLDINGS, turning_drive
from microvib.solve.integration import (
    SECOND_WING,
    Progress,
    Simulation,
    channels_of,
    compute_invariants,
    keeps_hub_motion,
    method_of,
    record_motion,
    split_progress,
)
from microvib.solve.motion import Invariants, Motion, channel_of
from microvib.solve.sampling import sample_buffer
from microvib.solve.steady.arrival import NotReached
from microvib.solve.steady.derivatives import LineDerivatives, line_derivatives
from microvib.solve.steady.directions import Parameters
from microvib.solve.steady.from_rest import RunFromRest
from microvib.solve.steady.period import NotPeriodic, PeriodMap, common_period
from microvib.solve.steady.recorded import NotDifferentiable, RecordedPeriod, output_offset
from microvib.solve.steady.search import HARMONICS, NotReproducedByRun, Search, sample_rows
from microvib.solve.steady.settling import Settling

FINER_FOR_HARMONICS = 2
"""By how much steps are finer by which harmonics are integrated: a sixteenth of the error."""
ATTEMPTS = ((1, 0), (2, 4), (3, 4))
"""Searches in turn: periods of the command after which the motion may repeat, and such periods
simulated beforehand.
"""
MAX_PERIOD_QUARTER_TURNS = 8
"""Quarter electrical turns in a period beyond which a run from rest takes less time than a search."""

MAX_MODES = 100
"""Array modes beyond which differences in each state take longer than time integration."""


FINE_INTERVALS = 64
"""Intervals in a cycle of the highest order of a Fourier series."""
MOST_FINE_INTERVALS, MOST_FINE_NUMBERS = 8_000_000, 32_000_000
"""Intervals of the torque, and numbers of all channels, that are kept at most: of longer periods a torque with jumps
has intervals less fine, and up to 1 % of the last orders is aliased.
"""


@dataclass(frozen=True)
class SteadyState:
    """One period of a steady motion: its torque and, on demand, all channels of a ``Motion``, as
    means over equal intervals.

    They are of the first drive alone where a second wing is driven, which has a steady state of its
    own, ``second_wing``.
    """

    scenario: Scenario
    start: float
    """Start of the period [s], on the clock of the scenario's record."""
    frequency: float
    """Repetitions per second [Hz]."""
    microsteps: int
    """Microsteps in the period."""
    T_d: np.ndarray
    """Disturbance torque [N m], (n,)."""
    stuck_output: float
    """Part of the period that the output shaft sticks."""
    state: np.ndarray
    """The kernel's state at the start of the period, seen from the command
    (``microvib.solve.steady.period``).
    """
    distance: float
    """Estimated distance of ``state`` from the steady state, over what a microstep moves."""
    multiplier: float
    """Largest part of a deviation that is left after a period; below 1 the motion is stable. Of a
    run that settled, that by the damping of the slowest mode."""
    solver: dict[str, Any]
    stick: np.ndarray | None = None
    """Modes and memory of the frictions at the start of the period, where they do not follow from
    ``state``.
    """
    slow_multipliers: np.ndarray | None = None
    """Part that is left after a period of each deviation that decays slowly, complex, one of each
    conjugate pair, (k,); None of a run that settled.
    """
    derivatives_of_period: np.ndarray | None = field(default=None, repr=False, compare=False)
    """Derivatives of the period's map that its search went by, over what a microstep moves, (1, n, n);
    None where the period was searched in segments, or not at all.
    """

    def __repr__(self) -> str:
        return f"Steady state of {self.scenario.brief}: repeats every {1.0 / self.frequency:.6g} s"

    def __getitem__(self, name: str) -> np.ndarray:
        if name == "T_d":
            return self.T_d
        return channel_of(self.channels, name, self.scenario, self.time)

    @cached_property
    def second_wing(self) -> SteadyState | None:
        """Steady state of the second wing's drive, found when it is first needed; None where it is
        not driven.

        Raises NotPeriodic where there is none.
        """
        other = self.scenario.driven_wing
        if other is None:
            return None
        with error_context(SECOND_WING):
            return _steady_state(other, confirmed=False)

    beside = FormerName("second_wing")

    @property
    def subharmonic(self) -> bool:
        """Whether the motion repeats only after several periods of the command; then there are
        others beside it.
        """
        return self.microsteps > common_period(self.scenario)[0]

    @property
    def driving_frequency(self) -> float:
        """Microsteps per second [Hz]."""
        return self.frequency * self.microsteps

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """All channels by name, (n,) each, from one more run over the period, made when they are
        first needed.
        """
        return self._sampled

    @cached_property
    def invariants(self) -> Invariants:
        """Invariants of a run over the period, with the energies and both forms of the torque, in
        which nothing is sampled.
        """
        period = PeriodMap(self.scenario, self.microsteps)
        packed = period.packed
        period.put(self.state, self.stick)
        before, momentum = packed.snapshot(), packed.momentum
        self._run(period, np.zeros((0, packed.columns)))
        return compute_invariants(packed, before, momentum, 1.0 / self.frequency)

    @cached_property
    def _sampled(self) -> dict[str, np.ndarray]:
        return self._all_channels(self.T_d.size) | {"T_d": self.T_d}

    def _all_channels(self, count: int) -> dict[str, np.ndarray]:
        """All channels by means over a ``count`` of intervals."""
        period = PeriodMap(self.scenario, self.microsteps)
        packed = period.packed
        rows = np.zeros((count, packed.columns))
        period.put(self.state, self.stick)
        self._run(period, rows)
        return channels_of(rows[:, : packed.channels], packed.drive.H.size)

    @cached_property
    def _fine_torque(self) -> np.ndarray:
        """Torque by means over intervals for a Fourier series, (n,)."""
        period = PeriodMap(self.scenario, self.microsteps)
        rows = np.zeros((self._fine_count, period.packed.torque_columns))
        period.put(self.state, self.stick)
        self._run(period, rows)
        return period.packed.torque_of(rows)[0]

    @cached_property
    def _fine_channels(self) -> dict[str, np.ndarray]:
        return self._all_channels(self._fine_count) | {"T_d": self._fine_torque}

    @property
    def _fine_count(self) -> int:
        """Intervals for a Fourier series: so many that of what is aliased into an order, k/(n - k) of order n - k,
        less than 0.1 % is left even of torques with jumps, at the end of the record's band.
        """
        highest = PASSBAND * self.scenario.record.sample_rate / self.frequency
        times = math.ceil(FINE_INTERVALS * highest / self.T_d.size)
        return max(min(times, MOST_FINE_INTERVALS // self.T_d.size), 1) * self.T_d.size

    def _fine(self, name: str) -> np.ndarray:
        """A channel by means over finer intervals, (n,), unless all channels would need too much memory."""
        if name == "T_d":
            return self._fine_torque
        count = self._fine_count
        if count * len(self.channels) > MOST_FINE_NUMBERS:
            return self[name]
        return channel_of(self._fine_channels, name, self.scenario, self._middles(count))

    def _run(self, period: PeriodMap, rows: np.ndarray) -> None:
        """The period from where it is, into ``rows``; as many as they are."""
        width = 1.0 / (self.frequency * max(len(rows), 1))
        period.go_on(sample_buffer(rows, period.start, width))

    @property
    def time(self) -> np.ndarray:
        """Middles of the intervals [s], (n,)."""
        return self._middles(self.T_d.size)

    def _middles(self, count: int) -> np.ndarray:
        middles: np.ndarray = self.start + (np.arange(count) + 0.5) / (count * self.frequency)
        return middles

    def ringing(self, frequency: float, decay: float) -> tuple[float, float]:
        """Frequency [Hz] and decay [1/s] with which a small deviation rings about this motion: of
        those that decay slowly the one nearest to given ones, such as those of the linear model.

        nan where none is known. A multiplier tells a frequency up to whole turns in a period, and
        its sign: the nearest counts.
        """
        if self.slow_multipliers is None or not self.slow_multipliers.size:
            return math.nan, math.nan
        wanted = np.exp((-decay + 2j * np.pi * frequency) / self.frequency)
        each = np.concatenate([self.slow_multipliers, self.slow_multipliers.conj()])
        nearest = complex(each[np.argmin(np.abs(each - wanted))])
        turned = float(np.angle(nearest / wanted)) / math.tau
        return frequency + turned * self.frequency, -math.log(abs(nearest)) * self.frequency

    def harmonics(self, name: str = "T_d", count: int | None = None) -> np.ndarray:
        """Complex amplitudes, 0-to-peak, of a channel's Fourier series at k ``frequency``, k = 0,
        1, ..., (n // 2,).

        Phases are those of cosines at the first sample of the record, ``record.settle``. The droop
        of interval means is corrected. With a ``count`` only so many are made: of a long period
        most are beyond any band.
        """
        x = self._fine(name)
        n = x.shape[0]
        k = np.arange(self.T_d.size // 2)[:count]
        series = np.fft.rfft(x, axis=0)[: k.size] * (2.0 / n)
        series[0] *= 0.5
        shift = (
            2j * np.pi * k * ((self.scenario.record.settle - self.start) * self.frequency - 0.5 / n)
        )
        result: np.ndarray = series * np.exp(shift) / np.sinc(k / n)
        return result

    def integrated_harmonics(self, orders: np.ndarray) -> np.ndarray:
        """Complex amplitudes of the torque at some ``orders`` (k,) of ``frequency``, as
        ``harmonics`` has them, but integrated over each step of the solution.

        They are smooth functions of the drive's parameters. Means over equal intervals are not:
        lines by them have kinks where an event crosses the edge of an interval. Steps are finer than
        the solution's, with which small lines of high orders would jump by some per cent where a
        step is one more or less. Where a friction just sticks, or just does not, steps cannot be taken again, and
        they are those by means.
        """
        recorded = RecordedPeriod.with_finer_steps(
            self.scenario, self.microsteps, orders, FINER_FOR_HARMONICS
        )
        try:
            end = recorded.record(self.state - output_offset(recorded.map))
        except NotDifferentiable:
            return self.harmonics("T_d", int(orders.max()) + 1)[orders]
        late = self.scenario.record.settle - self.start + end.late
        shift = np.exp(2j * np.pi * self.frequency * late * orders)
        result: np.ndarray = recorded.harmonics([end])[:, 0] * shift
        return result

    def derivatives(
        self,
        keys: Sequence[str],
        orders: Sequence[int] | None = None,
        *,
        scales: Mapping[str, float] | None = None,
        coarse: bool = False,
    ) -> LineDerivatives:
        """Derivatives of the torque's complex amplitudes by continuous parameters, in SI units.

        Parameters
        ----------
        keys : sequence of str
            Dotted keys of numbers, such as ``reducer.stiffness``.
        orders : sequence of int, optional
            Harmonics of ``frequency``; as a rule those of the motion up to the eighth driving line.
        scales : mapping, optional
            What steps are relative to [SI], of parameters that are 0: such as their ranges.
        coarse : bool
            With the steps of the solution, in a third of the time and good to about 1 %; as a rule with
            finer ones, good to 1e-4.

        Returns
        -------
        LineDerivatives
            With nan where the lines have a kink.

        Raises
        ------
        NotDifferentiable
            Where frictions have a memory, or finer steps lead to another motion.
        MicrovibError
            Where a key is not a number, or is 0 without a scale.
        """
        if orders is None:
            orders = range(1, HARMONICS * self.microsteps + 1)
        return line_derivatives(
            self.scenario,
            self.state,
            self.microsteps,
            np.asarray(orders, dtype=int),
            Parameters.of(self.scenario, keys, scales or {}),
            coarse,
        )

    def motion(
        self, *, channels: tuple[str, ...] | None = None, progress: Progress | None = None
    ) -> Motion:
        """The record of the scenario, integrated from this state instead of from rest."""
        if keeps_hub_motion(channels):
            beside = self.second_wing
        else:
            beside = None
        if beside is None:
            first, second = (progress, None)
        else:
            first, second = split_progress(progress)
        period = PeriodMap(self.scenario, self.microsteps)
        period.put(self.state, self.stick)
        motion = record_motion(
            Simulation(
                self.scenario,
                progress=first,
                channels=channels,
                packed=period.packed,
                command=period.command,
            )
        )
        if beside is None:
            return motion
        return replace(motion, second_wing=beside.motion(channels=channels, progress=second))


def steady_state(scenario: GivenScenario, *, confirmed: bool = False) -> SteadyState:
    """Find the steady state that a start from rest leads to, at the rate that the scenario has in
    its record.

    A short period is searched (``microvib.solve.steady.search``). Where it is long, where frictions
    have a memory, where microsteps do not come evenly (``driver.compensation``), or where the search
    finds nothing that a start from rest leads to, it is the motion that a run from rest settles to.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is solved: a scenario, a name of the catalog, or the path of a scenario file.
    confirmed : bool
        Wait to its end for the run that shows that a start from rest leads there.

    Returns
    -------
    SteadyState
        One period of the motion, its Fourier series, and how it was found.

    Raises
    ------
    NotPeriodic
        Where the rate changes or is zero, where something does not repeat with the command or takes
        too long to, where there are more than MAX_MODES modes, or where a run from rest does not
        settle: says which. It is a SimulationError.
    """
    return _steady_state(as_scenario(scenario), confirmed)


def _steady_state(scenario: Scenario, confirmed: bool) -> SteadyState:
    begun = clock_time.perf_counter()
    repeat, searched = _period_to_search(scenario)
    spent = 0.0
    if searched:
        found, spent = _searched(scenario, repeat, confirmed, begun)
        if found is not None:
            return found
    return _result_of_settling(PeriodMap(scenario, repeat), spent, begun)


def _period_to_search(scenario: Scenario) -> tuple[int, bool]:
    """Microsteps in a period of the command, and whether a search over it takes less than a run from
    rest. NotPeriodic where there are too many modes.
    """
    if scenario.load.H.size > MAX_MODES:
        raise NotPeriodic(
            f"there are more than {MAX_MODES} modes, for which time integration is faster"
        )
    repeat, quarter = common_period(scenario)
    remembers = scenario.has_memory or scenario.driver.compensates
    return repeat, not remembers and repeat <= MAX_PERIOD_QUARTER_TURNS * quarter


def is_searched(scenario: Scenario) -> bool:
    """Whether ``steady_by_search`` may find anything: the command repeats after a short period, and
    nothing remembers, or is random.
    """
    try:
        _, searched = _period_to_search(scenario)
        PeriodMap(scenario, 1)  # refuses what does not repeat
    except NotPeriodic:
        return False
    return searched


def steady_by_search(scenario: Scenario, near: SteadyState | None = None) -> SteadyState:
    """A steady state that repeats with each period of the command, where a search finds one; ``near``
    that of a drive that is hardly another, where its motion goes.

    **Nobody asks whether a start from rest leads there**: this is for many scenarios, of which runs
    confirm those that count. Raises NotPeriodic where nothing is found, also where ``steady_state``
    would follow a run until it has settled.
    """
    begun = clock_time.perf_counter()
    if near is not None and near.derivatives_of_period is not None:
        search = Search(PeriodMap(scenario, near.microsteps), segments=1)
        search.follow(near.state, near.derivatives_of_period)
        return _kept(search, clock_time.perf_counter() - begun)
    repeat, searched = _period_to_search(scenario)
    if not searched:
        raise NotPeriodic("the motion is followed from rest until it has settled")
    search = Search(PeriodMap(scenario, repeat), segments=1).find()
    return _kept(search, clock_time.perf_counter() - begun)


def _kept(search: Search, seconds: float) -> SteadyState:
    """The result of a search over one segment, with what others near by begin from."""
    assert search.newton is not None
    return replace(
        _result_of_search(search, 0.0, seconds),
        derivatives_of_period=search.newton.derivatives,
    )


def _searched(
    scenario: Scenario, repeat: int, confirmed: bool, begun: float
) -> tuple[SteadyState | None, float]:
    """State that the first of some attempts finds and a start from rest leads to, or None; and the time
    [s] that others simulated in vain.
    """
    spent = 0.0
    for multiple, warm_up in ATTEMPTS:
        period = PeriodMap(scenario, multiple * repeat)
        try:
            search = Search(period, confirmed).run(warm_up)
            return _result_of_search(search, spent, clock_time.perf_counter() - begun), spent
        except NotReproducedByRun:
            raise
        except NotPeriodic as problem:
            spent += period.evaluations / period.frequency
            if isinstance(problem, NotReached):
                break
    return None, spent


def find_steady(
    scenario: Scenario, *, whole: bool = True, confirmed: bool = False
) -> tuple[SteadyState | None, str]:
    """The steady state of ``scenario``, or None and why there is none: ``whole``, that of a second
    wing that is driven, too.
    """
    try:
        found = _steady_state(scenario, confirmed)
        if whole:
            _ = found.second_wing  # which says why there is none
    except NotPeriodic as why:
        return None, str(why)
    return found, ""


def _result_of_settling(period: PeriodMap, spent: float, begun: float) -> SteadyState:
    """The motion that a run from rest settles to, after searches simulated ``spent`` [s] in vain."""
    run = RunFromRest(period)
    found = Settling(run).followed(sample_rows(period))
    if found.period.microsteps == period.microsteps:  # else what grows has left it
        _check_grown(run)
    period, simulated = found.period, spent + run.simulated
    multiplier = math.exp(-run.ringing.decay / period.frequency)
    solver = {
        **method_of(period.scenario),
        "search": "run from rest until its periods repeat",
        "arrived_s": run.simulated,
        "period_s": 1.0 / period.frequency,
        "period_microsteps": period.microsteps,
        "periods_evaluated": simulated * period.frequency,
        "distance": found.distance,
        "multiplier": multiplier,
        "settling_s": math.log(100.0) / run.ringing.decay,
        "simulated_s": simulated,
        "wall_s": clock_time.perf_counter() - begun,
    }
    return SteadyState(
        scenario=period.scenario,
        start=period.start,
        frequency=period.frequency,
        microsteps=period.microsteps,
        T_d=found.T_d,
        stuck_output=found.stuck_output * period.frequency,
        state=found.state,
        distance=found.distance,
        multiplier=multiplier,
        solver=solver,
        stick=found.stick,
    )


def _check_grown(run: RunFromRest) -> None:
    """Against a motion that a run is still about to leave: NotPeriodic where deviations grow from
    nothing, and took too little time to be seen.
    """
    scenario = run.period.scenario
    if sliding_growth(scenario) > 0.0:  # then friction excites them, and they are large at once
        return
    growths = [one.growth for one in growth_over_angle(scenario) if one.may_grow]
    if (of_motor := turning_drive(scenario).growth) > 0.0:
        growths.append(of_motor)
    growth = min(growths, default=math.inf)
    if run.simulated * growth < GROWN_EFOLDINGS:
        known = f" (growth by e in {1.0 / growth:.3g} s)" if growth > 0.0 else ""
        raise NotPeriodic(
            "deviations from smooth turning may grow so slowly that what they become was not seen in"
            f" {run.simulated:.3g} s{known}"
        )


def _result_of_search(search: Search, spent: float, seconds: float) -> SteadyState:
    """The result of a search, after others simulated ``spent`` [s] in vain."""
    period = search.period
    simulated = spent + period.evaluations / period.frequency
    solver = {
        **method_of(period.scenario),
        "search": "multiple shooting over one period, quasi-Newton",
        "from_rest_s": search.from_rest,
        "period_s": 1.0 / period.frequency,
        "period_microsteps": period.microsteps,
        "periods_evaluated": simulated * period.frequency,
        "distance": search.distance,
        "multiplier": search.multiplier,
        "settling_s": search.settling,
        "simulated_s": simulated,
        "wall_s": seconds,
    }
    return SteadyState(
        scenario=period.scenario,
        start=period.start,
        frequency=period.frequency,
        microsteps=period.microsteps,
        T_d=search.ends.T_d,
        stuck_output=search.ends.stuck_output * period.frequency,
        state=search.x[0] * period.sizes,
        distance=search.distance,
        multiplier=search.multiplier,
        solver=solver,
        slow_multipliers=search.slow_multipliers,
    )
