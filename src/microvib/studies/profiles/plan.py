"""The shortest profile of a manoeuvre that keeps an array's modes from ringing: ``plan_profile``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal, cast

import numpy as np

from microvib.errors import MicrovibError, OptionError
from microvib.model.line_names import CONTROL_MODE, LineName
from microvib.model.linear import CoupledMode, coupled_modes, rate_step_response
from microvib.model.other_hinge import other_hinge
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.model.slow_variations import slow_variations
from microvib.model.tracking import Tracking
from microvib.model.winding_up import wind_up
from microvib.signals.limit_curve import EVERYWHERE, Limit, LimitCurve
from microvib.solve.command import Command
from microvib.solve.integration import Progress
from microvib.studies.profiles.correction import (
    Attempt,
    Task,
    correct,
    measure_all,
)
from microvib.studies.profiles.manoeuvre import Manoeuvre
from microvib.studies.profiles.modes import UncertainMode
from microvib.studies.profiles.rate_profile import RateProfile
from microvib.studies.profiles.runs import Case, Ringing, case_of, measure, with_profile
from microvib.studies.profiles.shapes import SHAPERS, ramp, s_curve, shaped, shortest_of
from microvib.studies.profiles.shortest import Bounds, samples_of, shortest_change
from microvib.studies.profiles.worst import Measured, Point, Searched, search_worst, start_grid
from microvib.studies.workers import Calls, parallel_calls
from microvib.units import GivenQuantity, Si, quantity

ShapeVerdict = Literal["pass", "fail", "not judged"]
STEP, TRAPEZOID, S_CURVE = "step", "trapezoid", "S curve"
LINEAR, FULL = "shortest, linearised drive", "shortest, full model"
DEFAULT_ATTENUATION = 30.0
FRICTION_CHECK = 0.1
"""Part by which friction is off in runs that show what this does, where no uncertainty is given."""
LATE_PARTS = (0.25, 0.5, 0.75)
"""Parts of a full step by which a manoeuvre begins later in runs that show what this does."""
WOUND = 0.9
"""Part of the angle at which the output breaks away that is commanded before it is to move."""
_SETTLED = 5.0
"""e-foldings of the slowest decay for which the rate before a manoeuvre lasts, at least."""
_LONGEST_LEAD = 600.0
"""Seconds that it lasts at most."""
_ROUNDS = 3
"""How often a shape is found anew with the worst cases of the search."""
_ROUND_PART, _LEAST_PART = 0.97, 0.7
"""Part of the limit that a shape which is found anew is to keep in the worst drive, and the least part
to which its limit is lowered at once."""
RINGS_OFF = 0.01
"""Part by which a mode may ring off its frequency in the linearised drive, where a limit over frequency is
looked up."""
MAX_MODES = 8
"""Modes that a profile is shaped for, at most."""


_RAISED = 1.05
"""Times that another state of a second wing's hinge may raise what rings, and is left out."""


@dataclass(frozen=True)
class Run:
    """Ringing of a mode after a shape, in a run of the full model."""

    shape: str
    case: Case
    mode: str
    ringing: Ringing
    limit: float
    """[N m]; the strictest within the uncertainty of the mode's frequency."""
    step: float
    """Ringing that a step of the rate leaves in the linearised drive of the case, of the mode that
    rings most [N m]."""
    counts: bool = True
    """Whether a verdict depends on it."""
    fails_above: float | None = None
    """Ringing above which it fails [N m], the most that a limit over frequency allows at the frequency of
    the mode in this run; None where that is the limit itself."""

    @property
    def verdict(self) -> ShapeVerdict:
        """Whether the limit is kept."""
        if self.ringing.most <= self.limit:
            return "pass"
        if math.isnan(self.ringing.amplitude):
            return "not judged"
        certain = self.limit if self.fails_above is None else self.fails_above
        return "fail" if self.ringing.amplitude > certain else "not judged"

    @property
    def below_step(self) -> float:
        """Ringing over that of a step, as a factor; nan where it is not known."""
        if math.isinf(self.ringing.most):
            return math.nan
        return self.ringing.most / self.step


@dataclass(frozen=True)
class ModeResidual:
    """Ringing of a mode after a shape, in the linearised drive."""

    shape: str
    mode: str
    nominal: float
    """[N m]."""
    worst: float
    """Upper bound over the uncertainty of the mode [N m]."""
    limit: float
    """[N m]."""
    step: float
    """[N m]; as of a run."""


@dataclass(frozen=True)
class Shape:
    """A manoeuvre in one shape, with what it leaves ringing."""

    name: str
    profile: RateProfile
    """Rates of the manoeuvre from time 0 [rad/s]."""
    whole: RateProfile
    """The whole from rest: what brings the array to the rate before the manoeuvre, and this."""
    residuals: tuple[ModeResidual, ...]
    """In the linearised drive; none of a shape that allows for what that lacks."""
    runs: tuple[Run, ...]
    searched: bool = False
    """Whether the runs are those of a search for the worst drive."""
    between: float = 0.0
    """How much more than in the runs that count a mode may ring with between them, over its limit."""
    unknown: str = ""
    """Why runs do not tell what rings, a clause; empty where they do."""

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.profile.duration

    @property
    def start(self) -> float:
        """Time after the rest at which it begins [s]."""
        return self.whole.duration - self.profile.duration

    @property
    def linear_nominal(self) -> float:
        """Largest nominal residual over that of a step; nan where there is none."""
        return max((one.nominal / one.step for one in self.residuals), default=math.nan)

    @property
    def linear_worst(self) -> float:
        """Largest bound on residuals over that of a step; nan where there is none."""
        return max((one.worst / one.step for one in self.residuals), default=math.nan)

    @property
    def measured_nominal(self) -> float:
        """Largest ringing over that of a step in the nominal run; nan where it is not known."""
        found = [run.below_step for run in self.runs if run.case.text == "nominal"]
        return max(found) if found and not any(map(math.isnan, found)) else math.nan

    @property
    def measured_worst(self) -> float:
        """Largest ringing over that of a step in all runs that count; nan where one is not known."""
        found = [run.below_step for run in self.runs if run.counts]
        return max(found) if found and not any(map(math.isnan, found)) else math.nan

    @property
    def largest_ringing(self) -> float:
        """Largest ringing in all runs that count [N m]; nan where one is not known."""
        found = [run.ringing.most for run in self.runs if run.counts]
        return max(found) if found and not any(map(math.isinf, found)) else math.nan

    @property
    def verdict(self) -> ShapeVerdict:
        """Whether the limit is kept: by runs and what may be between them, and where it applies by the
        linearised drive over the whole uncertainty."""
        each = [run.verdict for run in self.runs if run.counts]
        if "fail" in each:
            return "fail"
        if not each or "not judged" in each or self.linear_over_limit > 1.0:
            return "not judged"
        if not self.searched or self.unknown or self.over_limit + self.between > 1.0:
            return "not judged"
        return "pass"

    @property
    def may_pass(self) -> bool:
        """Whether the runs so far and the linearised drive keep the limit."""
        each = [run.verdict for run in self.runs if run.counts]
        return all(one == "pass" for one in each) and self.linear_over_limit <= 1.0

    @property
    def linear_over_limit(self) -> float:
        """Largest bound on residuals over its limit; 0 where there is none."""
        return max((one.worst / one.limit for one in self.residuals), default=0.0)

    @property
    def over_limit(self) -> float:
        """Largest ringing over its limit in the runs that count; infinite where it is not known."""
        return max(
            (run.ringing.most / run.limit for run in self.runs if run.counts), default=math.inf
        )


@dataclass(frozen=True)
class Instants:
    """Microsteps of a profile."""

    times: np.ndarray
    """Times [s] from the begin of the manoeuvre, (m,)."""
    counts: np.ndarray
    """Microsteps made since the manoeuvre began, those of a positive rate less those of a negative
    one, after each, (m,)."""


@dataclass(frozen=True)
class ProfilePlan:
    """Shapes of a manoeuvre, and the shortest that keeps the limit."""

    scenario: Scenario
    manoeuvre: Manoeuvre
    modes: tuple[UncertainMode, ...]
    """Modes that a step of the rate makes ring above the limit, the largest first."""
    shapes: tuple[Shape, ...]
    limit: float | None
    """Largest ringing [N m], of a curve over frequency the least; None where it is relative to a step of
    the rate."""
    attenuation: float
    """Smallest ratio of a step's ringing to that of a profile [dB], where there is no ``limit``."""
    frequency_uncertainty: float
    damping_uncertainty: float
    friction_uncertainty: float
    wind_up: float
    """Angle [rad] that is commanded first in the shape for the full model."""
    too_long: tuple[str, ...] = ()
    """Shapes that keep the limit at no length that was tried."""
    curve: LimitCurve | None = None
    """The limit over frequency; None where it is one number."""
    not_limited: tuple[str, ...] = ()
    """Modes that ring where a limit over frequency has no value: nothing is said of them."""

    def __repr__(self) -> str:
        best = self.best
        rows = [
            f"Profile plan of {self.scenario.brief}",
            f"{len(self.shapes)} shapes, {len(self.modes)} modes that a step would make ring above the limit",
        ]
        if best is None:
            rows.append("no shape is known to keep the limit")
        else:
            rows.append(f"best: {best.name}, {best.duration:.4g} s")
        return "\n  ".join(rows)

    def __getitem__(self, name: str) -> Shape:
        """The shape of a name, such as ``"ZVD"``; KeyError where there is none."""
        found = {shape.name: shape for shape in self.shapes}
        return found[name]

    @property
    def best(self) -> Shape | None:
        """The shortest shape that keeps the limit; None where none is known to."""
        found = [shape for shape in self.shapes if shape.verdict == "pass"]
        return min(found, key=lambda shape: shape.duration, default=None)

    @property
    def nearest(self) -> Shape:
        """The best shape; where there is none, the one whose runs come nearest to the limit; without
        runs the shortest that keeps it in the linearised drive.
        """
        if self.best is not None:
            return self.best
        if any(shape.runs for shape in self.shapes):
            return min(self.shapes, key=lambda shape: shape.over_limit)
        keeping = [shape for shape in self.shapes if shape.linear_over_limit <= 1.0]
        if keeping:
            return min(keeping, key=lambda shape: shape.duration)
        return min(self.shapes, key=lambda shape: shape.linear_over_limit)

    @property
    def period(self) -> float:
        """Period of the slowest mode [s]."""
        return 1.0 / min(mode.frequency for mode in self.modes)

    def commanded(self, shape: Shape) -> Scenario:
        """The scenario with a shape as ``tracking.profile``, from rest; its record begins where the
        profile ends.
        """
        made = with_profile(self.scenario, shape.whole)
        legs = [leg.model_dump() for leg in made.tracking.profile or ()]
        changes = {
            "tracking.rate": None,
            "tracking.profile": legs,
            "record.settle": made.record.settle,
            "record.start": "rest",
            "reference": None,
        }
        return self.scenario.with_si(changes)

    def microsteps_into_full_step(self, shape: Shape) -> float:
        """Microsteps that the command has made since a full step when a shape begins, not rounded; from
        rest 0.
        """
        driver, motor = self.scenario.driver, self.scenario.motor
        begin = np.array([shape.start + driver.delay])
        count = float(Command(self.commanded(shape)).count(begin)[0])
        return abs(count) % (driver.beats * driver.microsteps / motor.full_steps)

    def instants(self, shape: Shape) -> Instants:
        """When the microsteps of a shape come, up to its end."""
        delay = self.scenario.driver.delay
        begin = shape.start + delay
        command = Command(self.commanded(shape))
        times, after, *_ = command.crossings(begin, shape.whole.duration + delay)
        before = np.round(command.count(np.array([begin])))
        sense = -math.copysign(1.0, self.scenario.reducer.h)
        return Instants(times - begin, (sense * (after - before)).astype(int))


def plan_profile(  # noqa: PLR0913 - keyword options
    scenario: GivenScenario,
    *,
    initial_rate: GivenQuantity = "0 deg/s",
    final_rate: GivenQuantity | None = None,
    angle: GivenQuantity | None = None,
    largest_rate: GivenQuantity | None = None,
    largest_acceleration: GivenQuantity | None = None,
    limit: GivenQuantity | Limit | None = None,
    attenuation: float = DEFAULT_ATTENUATION,
    frequency_uncertainty: GivenQuantity | float = "10 percent",
    damping_uncertainty: GivenQuantity | float = "50 percent",
    friction_uncertainty: GivenQuantity | float = "0 percent",
    runs: bool = True,
    workers: int | None = None,
    progress: Progress | None = None,
) -> ProfilePlan:
    """Find the shortest profile of a manoeuvre that leaves the array's modes ringing below a limit.

    A change of rate (start, stop), or with an ``angle`` a rotation that gains it on a target which
    moves with the final rate all the time (rewind, catch-up after an eclipse). Step, trapezoid, S
    curve and the input shapers ZV, ZVD, EI and ZVDD are compared with the shortest profile of the
    linearised drive and with the shortest one that allows for friction, detent torque and
    microsteps. All are run in the full model with modes at their nominal frequencies and off by the
    uncertainty.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive: a scenario, a name of the catalog, or the path of a scenario file.
    initial_rate, final_rate : str or Si
        Rates of the array before and after; without a ``final_rate`` the one that the scenario tracks
        with.
    angle : str or Si, optional
        Angle to be gained on a target with the final rate, such as ``"20 deg"``.
    largest_rate : str or Si, optional
        Largest rate while an angle is gained; needed with ``angle``.
    largest_acceleration : str or Si, optional
        Largest acceleration of the array, such as ``"0.1 deg/s^2"``; without it rates may jump.
    limit : str, Si or Limit, optional
        Largest ringing of a mode in T_d at the end of the manoeuvre, 0-to-peak, such as
        ``"2 mN*m"``, or a limit over frequency of the torque (``read_limit``). A mode passes by the
        strictest value within the uncertainty of its frequency.
    attenuation : float
        Without a ``limit``: how far [dB] the ringing must be below what the largest change of rate
        leaves ringing as a step.
    frequency_uncertainty, damping_uncertainty : str or float
        Parts by which the modes may be off either way, such as ``"10 percent"``.
    friction_uncertainty : str or float
        Part by which friction on the output may be off either way; it is part of the limit, and of
        the shape, where it is above 0.
    runs : bool
        Whether the full model is run; without it nothing is judged.
    workers : int, optional
        Processes that share the runs; without it threads of this one do.
    progress : callable, optional
        Called as ``progress(done, total)`` with runs.

    Returns
    -------
    ProfilePlan
        Shapes with their ringing, the shortest that keeps the limit (``best``), its scenario
        (``commanded``) and its microsteps (``instants``).

    Raises
    ------
    OptionError
        For options that are not allowed or do not fit together.
    MicrovibError
        For a drive without array modes, one that steps by pulses, or one whose motor cannot turn
        it; where no profile of 20 periods keeps the limit.
    """
    scenario = as_scenario(scenario)
    _expect_modes(scenario)
    manoeuvre = _manoeuvre(
        scenario, initial_rate, final_rate, angle, largest_rate, largest_acceleration
    )
    curve = _limit_over_frequency(limit)
    lowered = float(quantity("attenuation", cast(GivenQuantity, attenuation), ""))
    if not 0.0 < lowered <= 100.0:
        raise OptionError("attenuation", "must be above 0 and at most 100 dB", f"{lowered:g}")
    study = _Study(
        scenario,
        manoeuvre,
        curve,
        lowered,
        _part("frequency_uncertainty", frequency_uncertainty),
        _part("damping_uncertainty", damping_uncertainty),
        _part("friction_uncertainty", friction_uncertainty),
    )
    with parallel_calls(progress, workers) as calls:
        shapes, too_long = study.shapes(calls if runs else None)
    unknown = _unknown_hinge(scenario, study.modes[0]) or unknown_angle_reason(scenario, manoeuvre)
    return ProfilePlan(
        scenario,
        manoeuvre,
        study.modes[0],
        tuple(replace(shape, unknown=unknown) for shape in shapes),
        None if curve is None else curve.least,
        study.attenuation,
        study.frequency_uncertainty,
        study.damping_uncertainty,
        study.friction_uncertainty,
        study.wind_up,
        too_long,
        None if curve is None or _is_one_number(curve) else curve,
        study.not_limited,
    )


def _unknown_hinge(scenario: Scenario, modes: Sequence[UncertainMode]) -> str:
    """Why the state of a second wing's hinge, which dry friction may lock, leaves open what rings; empty where
    it changes none of the ``modes``, and adds none.
    """
    hinge = other_hinge(scenario)
    if hinge is None or not modes:
        return ""
    f, spread = (
        np.array([getattr(mode, key) for mode in modes]) for key in ("frequency", "spread")
    )
    low, high = f * (1.0 - spread), f * (1.0 + spread)
    other = hinge.modes(coupled_modes(scenario), _RAISED)
    moved = any(mode.frequency <= high.max() for mode in other)
    if not moved and hinge.ratios(low, high)[1].max() <= _RAISED:
        return ""
    return hinge.gap


def unknown_angle_reason(scenario: Scenario, manoeuvre: Manoeuvre) -> str:
    """Find why runs that begin at one angle of the output leave open what rings from others: something changes the
    drive over its angle. Empty where nothing does.
    """
    rates = [abs(rate) for change in manoeuvre.changes for rate in change]
    moving = scenario.alone.with_si({"friction": scenario.friction.without_noise})
    tracking = Tracking(rate=Si(max(rates)), clock_ratio=Si(scenario.tracking.clock_ratio))
    varies = slow_variations(moving.model_copy(update={"tracking": tracking}))
    if not varies:
        return ""
    one = varies[0]
    return (
        f"{one.what} changes the drive over the angle, and all runs begin at one angle of it (leave {one.key} out"
        " for a verdict without it)"
    )


def _limit_over_frequency(given: GivenQuantity | Limit | None) -> LimitCurve | None:
    """The limit as a curve, of one number a flat one; None without a limit."""
    if given is None:
        return None
    if isinstance(given, Limit):
        return given.torque_curve("a rate profile")
    return LimitCurve.flat(quantity("limit", given, "N*m", positive=True))


def _is_one_number(curve: LimitCurve) -> bool:
    """Whether a limit is one torque at all frequencies."""
    return curve.is_flat and (curve.low, curve.high) == EVERYWHERE


def _expect_modes(scenario: Scenario) -> None:
    if not scenario.array.modes:
        raise MicrovibError(
            "array.modes: is empty; a rigid array does not ring, and modes are expected where a"
            " profile is to keep them from it"
        )
    if scenario.driver.pulsed:
        raise MicrovibError(
            f"driver.drive: is {scenario.driver.drive}; between its pulses the command does not hold"
            " the rotor; current or voltage is expected where a profile is shaped"
        )
    if math.isinf(wind_up(scenario)):
        raise MicrovibError(
            "motor.current: is too small to break the output shaft away from its friction; a larger"
            " one is expected where the array is to move"
        )


def _part(key: str, given: GivenQuantity | float) -> float:
    value = float(quantity(key, cast(GivenQuantity, given), ""))
    if not 0.0 <= value <= 0.5:
        raise OptionError(
            key, "must be at least 0 and at most 50 percent", f"{100.0 * value:g} percent"
        )
    return value


def _manoeuvre(
    scenario: Scenario,
    initial_rate: GivenQuantity,
    final_rate: GivenQuantity | None,
    angle: GivenQuantity | None,
    largest_rate: GivenQuantity | None,
    largest_acceleration: GivenQuantity | None,
) -> Manoeuvre:
    initial = float(quantity("initial_rate", initial_rate, "rad/s", example="deg/s"))
    if final_rate is None:
        final = _tracking_rate(scenario)
    else:
        final = float(quantity("final_rate", final_rate, "rad/s", example="deg/s"))
    fastest = math.inf
    if largest_acceleration is not None:
        fastest = float(
            quantity(
                "largest_acceleration",
                largest_acceleration,
                "rad/s^2",
                positive=True,
                example="deg/s^2",
            )
        )
    if angle is None:
        if largest_rate is not None:
            raise OptionError(
                "largest_rate", "applies to a rotation by an angle; give an angle, too"
            )
        if initial == final:
            raise OptionError(
                "final_rate",
                "is the initial rate; a change of rate, or an angle, is expected",
                f"{math.degrees(final):g} deg/s",
            )
        return Manoeuvre(initial, final, largest_acceleration=fastest)
    gained = float(quantity("angle", angle, "rad", example="deg"))
    if gained == 0.0:
        raise OptionError("angle", "must not be 0")
    if largest_rate is None:
        raise OptionError("largest_rate", "is needed with an angle, such as '0.5 deg/s'")
    rate = float(quantity("largest_rate", largest_rate, "rad/s", positive=True, example="deg/s"))
    if rate <= max(abs(initial), abs(final)):
        raise OptionError(
            "largest_rate",
            "must be above the rates before and after the manoeuvre,"
            f" {math.degrees(max(abs(initial), abs(final))):g} deg/s",
            f"{math.degrees(rate):g} deg/s",
        )
    return Manoeuvre(initial, final, gained, rate, fastest)


def _tracking_rate(scenario: Scenario) -> float:
    """Rate that the scenario tracks with in the end."""
    tracking = scenario.tracking
    if tracking.profile is not None:
        return float(tracking.profile[-1].rate)
    return float(tracking.rate or 0.0)


@dataclass(frozen=True)
class _Study:
    """Parts of a plan: modes, limits, cases, shapes."""

    scenario: Scenario
    manoeuvre: Manoeuvre
    limit: LimitCurve | None
    attenuation: float
    frequency_uncertainty: float
    damping_uncertainty: float
    friction_uncertainty: float

    @cached_property
    def ringing_modes(self) -> tuple[tuple[CoupledMode, float], ...]:
        """Modes of array and craft with what a step of the rate by one leaves ringing, the largest
        first.
        """
        found = tuple(
            mode
            for mode in coupled_modes(self.scenario)
            if mode.fixed_frequency is not None and LineName.parse(mode.name).family != CONTROL_MODE
        )
        clock = self.scenario.tracking.clock_ratio
        gains = np.abs(rate_step_response(self.scenario, found)) * clock
        pairs = zip(found, gains.tolist(), strict=True)
        return tuple(sorted(pairs, key=lambda pair: -pair[1]))

    @cached_property
    def factor(self) -> float:
        """Largest ringing over a step's, without a limit as a torque."""
        return 10.0 ** (-self.attenuation / 20.0)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Modes that a step makes ring above the limit; at least the one that rings most."""
        change = self.manoeuvre.largest_change
        limited = [pair for pair in self.ringing_modes if math.isfinite(self._limit(pair[0]))]
        if not limited:
            raise self._nothing_limited()
        above = [mode.name for mode, gain in limited if gain * change > self._limit(mode)]
        return tuple(above[:MAX_MODES]) or (limited[0][0].name,)

    @property
    def not_limited(self) -> tuple[str, ...]:
        """Modes at whose frequencies a limit over frequency has no value."""
        return tuple(m.name for m, _ in self.ringing_modes if math.isinf(self._limit(m)))

    def _nothing_limited(self) -> OptionError:
        assert self.limit is not None
        (first, _), low, high = self.ringing_modes[0], self.limit.low, self.limit.high
        return OptionError(
            "limit",
            f"is given from {low:g} to {high:g} Hz and limits no mode: {first.name}, which rings most, is at"
            f" {first.frequency:.4g} Hz",
        )

    @cached_property
    def modes(self) -> tuple[tuple[UncertainMode, ...], ...]:
        """Modes for each change of rate, with what its residual may be."""
        return tuple(
            tuple(
                self._mode(mode, gain, abs(last - first))
                for mode, gain in self.ringing_modes
                if mode.name in self.names
            )
            for first, last in self.manoeuvre.changes
        )

    def _mode(self, mode: CoupledMode, gain: float, change: float) -> UncertainMode:
        off = self.damping_uncertainty
        share = 1.0 / len(self.manoeuvre.changes)
        return UncertainMode(
            mode.name,
            mode.frequency,
            mode.damping,
            self.frequency_uncertainty,
            ((1.0 - off) * mode.damping, min((1.0 + off) * mode.damping, 0.95)),
            gain,
            share * self._limit(mode) / (gain * change),
        )

    def _limit(self, mode: CoupledMode) -> float:
        """Limit of a mode [N m] that holds over its uncertainty, if its ringing is taken as
        proportional to its frequency; infinite where it has none."""
        if self.limit is None:
            return self.factor * self.ringing_modes[0][1] * self.manoeuvre.largest_change
        return self._strictest(self.limit, mode) / (1.0 + self.frequency_uncertainty)

    def _strictest(self, curve: LimitCurve, mode: CoupledMode) -> float:
        """The strictest limit within the uncertainty of a mode's nominal frequency [N m]."""
        off = (1.0 + self.frequency_uncertainty) * (1.0 + RINGS_OFF) - 1.0
        return float(curve.strictest((1.0 - off) * mode.frequency, (1.0 + off) * mode.frequency))

    def limits(self, case: Case) -> np.ndarray:
        """Limits of the modes in a case [N m], (n,): those of all cases, for no notch of a limit may lie
        between two of them."""
        if self.limit is None:
            return np.full(len(case.names), self.factor * self.step_ringing(case))
        nominal = {mode.name: mode for mode, _ in self.ringing_modes}
        return np.array([self._strictest(self.limit, nominal[name]) for name in case.names])

    def fails_above(self, case: Case) -> list[float | None]:
        """The most that a limit over frequency allows the modes of a case at their frequencies [N m]; None
        where that is the limit."""
        curve = self.limit
        if curve is None or _is_one_number(curve):
            return [None] * len(case.names)
        ends = [
            ((1.0 - RINGS_OFF) * m.frequency, (1.0 + RINGS_OFF) * m.frequency) for m in case.modes
        ]
        return [float(curve.most_lenient(*one)) for one in ends]

    def step_ringing(self, case: Case) -> float:
        """Ringing that the largest change of rate leaves as a step in a case, of the mode that rings
        most [N m]."""
        return float(np.max(np.abs(case.gains))) * self.manoeuvre.largest_change

    @cached_property
    def period(self) -> float:
        """Period of the slowest mode [s]."""
        return 1.0 / min(mode.frequency for mode in self.modes[0])

    @cached_property
    def wind_up(self) -> float:
        """Angle [rad] that is commanded first where the manoeuvre begins at rest."""
        if self.manoeuvre.initial_rate != 0.0:
            return 0.0
        return WOUND * wind_up(self.scenario)

    @cached_property
    def lead(self) -> RateProfile | None:
        """Profile that brings the array from rest to the rate before the manoeuvre, until hardly anything
        rings; None where it begins at rest.
        """
        initial = self.manoeuvre.initial_rate
        if initial == 0.0:
            return None
        angle = WOUND * wind_up(self.scenario)
        start = Manoeuvre(0.0, initial, largest_acceleration=self.manoeuvre.largest_acceleration)
        made = start.profile([self._linear_shape(0, abs(initial))], angle)
        decay = min(2.0 * math.pi * mode.frequency * mode.damping for mode in self.modes[0])
        settled = _SETTLED / decay if decay > 0.0 else math.inf
        held = max(min(settled, _LONGEST_LEAD), self.scenario.record.settle)
        return made.then(RateProfile(np.array([0.0, held]), np.array([initial, initial])))

    def whole(self, profile: RateProfile) -> RateProfile:
        """A manoeuvre after what leads to it."""
        if self.lead is None:
            return profile
        return self.lead.then(profile)

    def bounds(self, change: int) -> Bounds:
        """Bounds on the shape of a change of rate."""
        return Bounds(acceleration=self.manoeuvre.bound_on_acceleration(change))

    def _linear_shape(self, change: int, size: float = 0.0) -> RateProfile:
        """The shortest shape of the linearised drive, proven over the uncertainty; for a change of
        another ``size`` [rad/s] where that is given."""
        bounds, modes = self.bounds(change), self.modes[change]
        if size:
            bounds = replace(bounds, acceleration=self.manoeuvre.largest_acceleration / size)
        factor = 0.99
        for _ in range(4):
            shape, _ = shortest_change(samples_of(modes), self.period, bounds, factor)
            over = max(mode.worst_residual(shape) / mode.allowed for mode in modes)
            if over <= 1.0:
                break
            factor *= 0.995 / over
        return shape

    def transitions(self, name: str) -> list[RateProfile] | None:
        """Shapes of the changes of rate from 0 to 1; None where there is none short enough."""
        made = [self._transition(name, k) for k in range(len(self.manoeuvre.changes))]
        if None in made:
            return None
        return [one for one in made if one is not None]

    def _transition(self, name: str, change: int) -> RateProfile | None:
        modes = self.modes[change]
        least = 1.0 / self.manoeuvre.bound_on_acceleration(change)
        if name == STEP:
            return ramp(least)
        if name == TRAPEZOID:
            return shortest_of(ramp, least, modes)
        if name == S_CURVE:
            return shortest_of(s_curve, 2.0 * least, modes)
        if name == LINEAR:
            return self._linear_shape(change)
        return shaped(ramp(least), name, modes)

    @cached_property
    def nominal(self) -> Case:
        """The drive as it is."""
        return case_of(self.scenario, self.names, 1.0, 1.0, 1.0)

    def cases(
        self, frequencies: Sequence[float], damping: float = 1.0, friction: float = 1.0
    ) -> list[Case]:
        """Drives with modes at factors of their frequencies."""
        return [
            case_of(self.scenario, self.names, factor, damping, friction) for factor in frequencies
        ]

    @cached_property
    def ends(self) -> list[Case]:
        """The drive as it is, and with its modes at both ends of their frequencies."""
        x = self.frequency_uncertainty
        if x == 0.0:
            return [self.nominal]
        return [self.nominal, *self.cases((1.0 - x, 1.0 + x))]

    @cached_property
    def design_cases(self) -> list[Case]:
        """Drives in which a shape for the full model is to keep the limit."""
        x, u = self.frequency_uncertainty, self.friction_uncertainty
        points = (1.0 - x, 1.0 - 0.5 * x, 1.0, 1.0 + 0.5 * x, 1.0 + x) if x > 0.0 else (1.0,)
        found = self.cases(points)
        if u > 0.0:
            found += [
                case for part in (1.0 - u, 1.0 + u) for case in self.cases(points, friction=part)
            ]
        return found

    def _case_at(self, at: Point) -> Case:
        if at not in self._cases:
            self._cases[at] = case_of(self.scenario, self.names, *at)
        return self._cases[at]

    @cached_property
    def _cases(self) -> dict[Point, Case]:
        return {}

    def _searched(self, profile: RateProfile, calls: Calls) -> Searched:
        """Runs of a manoeuvre in search of the worst drive within all that is uncertain."""
        whole = self.whole(profile)

        def measured(points: Sequence[Point]) -> Sequence[Measured]:
            cases = [self._case_at(at) for at in points]
            return list(zip(cases, measure_all(calls, cases, whole), strict=True))

        ranges = self.frequency_uncertainty, self.damping_uncertainty, self.friction_uncertainty
        return search_worst(start_grid(*ranges), measured, self.limits)

    def shapes(self, calls: Calls | None) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
        """All shapes, and the names of those that would be too long."""
        found, too_long = [], []
        for name in (STEP, TRAPEZOID, S_CURVE, *SHAPERS, LINEAR):
            transitions = self.transitions(name)
            if transitions is None:
                too_long.append(name)
                continue
            profile = self.manoeuvre.profile(transitions)
            runs = () if calls is None else self._runs(name, self.ends, profile, calls)
            shape = self._shape(name, profile, runs)
            if calls is not None and shape.may_pass:
                shape = self._proven(shape, calls)
            found.append(shape)
        if calls is not None:
            found.append(self._full_shape(calls))
        return tuple(found), tuple(too_long)

    def _proven(self, shape: Shape, calls: Calls) -> Shape:
        """A shape with the runs of a search for the worst drive."""
        worst = self._searched(shape.profile, calls)
        runs = tuple(self._as_runs(shape.name, worst.cases, worst.ringing, True))
        return replace(shape, runs=runs, searched=True, between=worst.between)

    def _runs(
        self,
        name: str,
        cases: Sequence[Case],
        profile: RateProfile,
        calls: Calls,
        counts: bool = True,
    ) -> tuple[Run, ...]:
        ringing = measure_all(calls, cases, self.whole(profile))
        return tuple(self._as_runs(name, cases, ringing, counts))

    def _as_runs(
        self, name: str, cases: Sequence[Case], ringing: Sequence[Sequence[Ringing]], counts: bool
    ) -> Iterator[Run]:
        for case, of_case in zip(cases, ringing, strict=True):
            limits, step = self.limits(case), self.step_ringing(case)
            each = zip(case.names, of_case, limits.tolist(), self.fails_above(case), strict=True)
            for mode, one, limit, above in each:
                yield Run(name, case, mode, one, limit, step, counts, above)

    def _shape(self, name: str, profile: RateProfile, runs: tuple[Run, ...]) -> Shape:
        residuals = tuple(
            self._residual(name, mode, profile) for mode in self.modes[0] if name != FULL
        )
        return Shape(name, profile, self.whole(profile), residuals, runs)

    def _residual(self, name: str, mode: UncertainMode, profile: RateProfile) -> ModeResidual:
        change = self.manoeuvre.largest_change
        return ModeResidual(
            name,
            mode.name,
            mode.gain * mode.nominal_residual(profile),
            mode.gain * mode.worst_residual(profile, change),
            self._limit_of(mode),
            self.ringing_modes[0][1] * change,
        )

    def _limit_of(self, mode: UncertainMode) -> float:
        return self._limit(next(m for m, _ in self.ringing_modes if m.name == mode.name))

    def _full_shape(self, calls: Calls) -> Shape:
        """The shortest shape that allows for what the linearised drive lacks."""
        transitions: list[RateProfile] = []
        for change in range(len(self.manoeuvre.changes)):
            attempt = self._corrected(change, transitions, self.design_cases, calls)
            transitions.append(attempt.transition)
        profile = self.manoeuvre.profile(transitions, self.wind_up)
        shape = self._proven(self._shape(FULL, profile, ()), calls)
        cases, factor = list(attempt.cases), 1.0
        for _ in range(_ROUNDS):
            if shape.verdict == "pass" or attempt.worst > 1.0:
                break
            cases += self._failed_cases(shape, cases)
            factor *= max(_ROUND_PART / (shape.over_limit + shape.between), _LEAST_PART)
            attempt = self._corrected(len(transitions) - 1, transitions[:-1], cases, calls, factor)
            other = self.manoeuvre.profile([*transitions[:-1], attempt.transition], self.wind_up)
            again = self._proven(self._shape(FULL, other, ()), calls)
            if again.over_limit + again.between < shape.over_limit + shape.between:
                shape, transitions[-1] = again, attempt.transition
        beside = (
            *self._friction_runs(shape.profile, calls),
            *self._late_runs(shape.profile, calls),
        )
        return replace(shape, runs=(*shape.runs, *beside))

    def _failed_cases(self, shape: Shape, known: Sequence[Case]) -> Iterator[Case]:
        """The worst drive of a shape, and those beside it with the same damping and friction, as far as
        no shape was made for them.
        """
        worst = max((run for run in shape.runs if run.counts), key=_ringing_over_limit).case
        had = {case.text for case in known}
        x = self.frequency_uncertainty
        points = dict.fromkeys(
            (worst.frequency, 1.0 - x, 1.0 - 0.5 * x, 1.0, 1.0 + 0.5 * x, 1.0 + x)
        )
        for case in self.cases(tuple(points), worst.damping, worst.friction):
            if case.text not in had:
                yield case

    def _friction_runs(self, profile: RateProfile, calls: Calls) -> tuple[Run, ...]:
        """Runs that show what friction does that is off, where it is not part of the limit."""
        if self.friction_uncertainty > 0.0 or self.scenario.friction.breakaway_torque == 0.0:
            return ()
        cases = [
            case
            for part in (1.0 - FRICTION_CHECK, 1.0 + FRICTION_CHECK)
            for case in self.cases((1.0,), friction=part)
        ]
        return self._runs(FULL, cases, profile, calls, counts=False)

    def _late_runs(self, profile: RateProfile, calls: Calls) -> tuple[Run, ...]:
        """Runs that show what another electrical angle at the begin does, where the array moves before."""
        if self.lead is None:
            return ()
        driver, motor = self.scenario.driver, self.scenario.motor
        whole_step = driver.beats * driver.microsteps / motor.full_steps
        per_second = abs(self.manoeuvre.initial_rate * self.scenario.reducer.ratio)
        clock = self.scenario.tracking.clock_ratio
        step_time = whole_step * driver.microstep(motor) / (per_second * clock)
        cases, calls_of = [], []
        for part in LATE_PARTS:
            case = replace(self.nominal, late=part)
            cases.append(case)
            calls_of.append((case, self.lead.then(profile, part * step_time)))
        ringing = calls(measure, calls_of)
        return tuple(self._as_runs(FULL, cases, ringing, False))

    def _corrected(
        self,
        change: int,
        before: Sequence[RateProfile],
        cases: Sequence[Case],
        calls: Calls,
        part: float = 1.0,
    ) -> Attempt:
        """One change of rate after those ``before``, within a ``part`` of the limits; a first of two
        alone.
        """
        manoeuvre = self.manoeuvre
        if change + 1 < len(manoeuvre.changes):
            first, last = manoeuvre.changes[change]
            manoeuvre = Manoeuvre(first, last, largest_acceleration=manoeuvre.largest_acceleration)
        task = Task(
            partial(self._built, manoeuvre, tuple(before)),
            self._limits_of_change(change, part),
            self.period,
            self.bounds(change),
            early=change == 0 and self.manoeuvre.initial_rate == 0.0,
        )
        return correct(task, cases, self._linear_shape(change), calls)

    def _built(
        self, manoeuvre: Manoeuvre, before: tuple[RateProfile, ...], transition: RateProfile
    ) -> tuple[RateProfile, float]:
        transitions = (*before, transition)
        whole = self.whole(manoeuvre.profile(transitions, self.wind_up))
        return whole, manoeuvre.last_change(transitions, self.wind_up)

    def _limits_of_change(self, change: int, part: float) -> Callable[[Case], np.ndarray]:
        """A part of the limits of a change of rate: half the limit for the first of two."""
        if change + 1 < len(self.manoeuvre.changes):
            part *= 0.5
        return lambda case: part * self.limits(case)


def _ringing_over_limit(run: Run) -> float:
    return run.ringing.most / run.limit
