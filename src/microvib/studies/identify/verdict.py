"""Verdicts on the estimates, and their dependence on parameters that were not fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.scenario import Scenario
from microvib.studies.identify.equivalent import Equivalent, together
from microvib.studies.identify.goodness import REJECTION_PROBABILITY, Goodness, goodness
from microvib.studies.identify.hints import noise_may_release_stiction, period_mismatch_warnings
from microvib.studies.identify.images import (
    PHASE_DEPENDENT_KEYS,
    SAME_POINT_DISTANCE,
    quarter_turn_solutions,
)
from microvib.studies.identify.intervals import Z_95, Interval
from microvib.studies.identify.keys import FitKey, IntegerKey, fittable
from microvib.studies.identify.lacking import UnmodelledEffect, shift_reason
from microvib.studies.identify.problem import Problem
from microvib.studies.identify.search import (
    COARSE_COST_TOLERANCE,
    RESTART_STEPS,
    Descent,
    LinearModel,
    Optimum,
    linearise_at,
)

QUARTER_TURN_SIGMAS = 5.0
"""Standard deviations of the settling time in a quarter of the electrical turn that tell the
quarters apart.
"""
MAX_RELATIVE_ERROR = 0.2
"""Standard error over value above which a parameter is not identifiable."""
MAX_CORRELATION = 0.995
"""Correlation above which two estimates cannot be told apart."""
RELATIVE_STEP = 0.01
"""Relative change of a parameter that was not fitted, to see which estimates depend on it."""
ASSUMED_SETTLE_ERROR = 0.1
"""Relative error of a settling time that nobody measured."""
CORRECTED_REFITS = 2
"""Fits among steady states at another settling time, each corrected to the run where the last one
ended.
"""
SETTLE_KEY = "record.settle"
DETENT_KEYS, FLUX_KEYS = ("motor.detent_torque", "motor.detent."), ("motor.flux_harmonics.",)
"""Beginnings of the keys of torques of the same order."""
ADDED_FREQUENCY_NOTE = (
    "; fitted as well, since no fit with the scenario's value explained the evidence"
)
"""Note on a mode's frequency that was fitted without request."""
EQUIVALENT_COST = 2.0 * math.log(1.0 / REJECTION_PROBABILITY)
"""Cost above the best's up to which an optimum elsewhere explains the data as well: odds of a
thousand to one.
"""


@dataclass(frozen=True)
class Estimate:
    """One identified parameter."""

    key: str
    """Its key, with the recording whose own it is."""
    unit: str
    estimate: float
    standard_error: float
    """Standard error; of a profiled interval a quarter or so of its width, nan where it is
    withheld.
    """
    low: float
    high: float
    identifiable: bool
    verdict: str
    interval: tuple[float, float] = (math.nan, math.nan)
    """95 % interval; nan where it is withheld, the end of the range where it is open."""
    profiled: bool = False
    """Whether the interval comes from the profile of the cost instead of its curvature."""
    recording: str = ""
    """The recording whose own it is; empty where all share one value."""


@dataclass(frozen=True)
class Dependence:
    """How far the estimates move with a parameter that was not fitted."""

    key: str
    shifts: tuple[float, ...]
    """Relative change of each estimate for a relative change of the parameter (d ln estimate / d ln
    parameter).
    """


@dataclass(frozen=True)
class IntegerResult:
    """A whole number as it was found."""

    key: IntegerKey
    number: int
    as_good: tuple[int, ...]
    """All that explain the evidence as well within odds of a thousand to one, that one among them."""


@dataclass(frozen=True)
class Findings:
    """Everything that the verdicts are based on."""

    problem: Problem
    best: Optimum
    confirmed: LinearModel | None = None
    """The model about the optimum, where a second search has it."""
    converged: bool = False
    intervals: tuple[Interval, ...] | None = None
    """None where they are withheld."""
    alternatives: tuple[Optimum, ...] = ()
    """Other optima, elsewhere, that explain the evidence as well."""
    dependences: tuple[Dependence, ...] = ()
    note: str = ""
    """Method of solution, where not by a search."""
    whole: tuple[IntegerResult, ...] = ()
    """Whole numbers, where each was tried."""
    lacking: tuple[UnmodelledEffect, ...] = ()
    """Effects that the model lacks and the evidence does not rule out."""
    alike: tuple[Equivalent, ...] = ()
    """Parameters that are not fitted and act exactly like a fitted one."""
    misread: tuple[str, ...] = ()
    """Mistakes of recordings that would explain why no model explains them."""

    @cached_property
    def local(self) -> LinearModel:
        """The model about the optimum, linearised."""
        return self.confirmed or linearise_at(self.problem, self.best)

    @cached_property
    def other_period(self) -> bool:
        """Whether model and recording repeat after different numbers of microsteps."""
        tests, after = self.problem.tests, self.problem.lines(self.best.x)
        return after is not None and any(
            any(period_mismatch_warnings(*each)) for each in zip(tests, after, strict=True)
        )


def estimate(findings: Findings, k: int) -> Estimate:
    """The k-th parameter with its interval and verdict."""
    key = findings.problem.keys[k]
    value = key.value(float(findings.best.x[k]))
    good, verdict = _verdict(findings, k)
    turned = (
        abs(x[k] - findings.best.x[k]) > SAME_POINT_DISTANCE
        for x in quarter_turn_solutions(findings.problem, findings.best.x)
    )
    if good and any(turned):
        known = f"{SETTLE_KEY} being right within {findings.problem.trust.settle:g} s (one standard deviation)"
        verdict += f"; which phase is which, and so its sign, rests on {known}"
    if key.along:
        verdict += ADDED_FREQUENCY_NOTE
    if findings.intervals is None:
        return Estimate(
            key.label,
            key.unit,
            value,
            math.nan,
            key.low,
            key.high,
            good,
            verdict,
            recording=key.recording,
        )
    i = findings.intervals[k]
    interval = key.value(i.low), key.value(i.high)
    error = key.slope(value) * float(findings.local.spread[k])
    if i.profiled:
        error = (interval[1] - interval[0]) / (2.0 * Z_95)
    return Estimate(
        key.label,
        key.unit,
        value,
        error,
        key.low,
        key.high,
        good,
        verdict,
        interval,
        i.profiled,
        key.recording,
    )


def not_identifiable_reason(findings: Findings) -> str:
    """Why nothing is identifiable; empty where something may be."""
    fit = goodness(findings.problem, findings.best.r)
    if any(one.warnings for one, _ in findings.problem.tests):
        return "not identifiable: the recording may not be of this drive at this rate"
    if not fit.explained:
        return "not identifiable: the model does not explain the data"
    parameters = fit.parameters + len(findings.whole)
    if fit.figures < parameters:
        return f"not identifiable: {_counted(fit.figures, 'figure')} cannot tell {_counted(parameters, 'parameter')}; fit fewer"
    if fit.is_questionable:
        return "not identifiable: few degrees of freedom are left, and the fit is poor"
    if not findings.converged or findings.intervals is None:
        return "not identifiable: the search has not converged"
    if findings.other_period:
        return "not identifiable: the model's motion repeats after another number of microsteps than the recording's"
    if any(noise_may_release_stiction(one, scenario) for one, scenario in findings.problem.tests):
        return "not identifiable without friction.torque_noise: the floor may be such noise, which would move the lines"
    return ""


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _verdict(findings: Findings, k: int) -> tuple[bool, str]:
    key, x = findings.problem.keys[k], float(findings.best.x[k])
    fit = goodness(findings.problem, findings.best.r)
    if refused := not_identifiable_reason(findings):
        if key.stated and not key.interior(x):
            refused += "; it is at the end of its range: a wider one may explain them"
        return False, refused
    assert findings.intervals is not None
    if refused := _single_current_reason(findings.problem, key):
        return False, refused
    if not key.interior(x):
        return False, "not identifiable: at the end of its range"
    interval = findings.intervals[k]
    margin = 0.5 * (interval.high - interval.low)
    elsewhere = (
        float(o.x[k])
        for o in findings.alternatives
        if not interval.low - margin <= o.x[k] <= interval.high + margin
    )
    others = {f"{key.value(x):.2g}": f"{key.value(x):.3g}" for x in sorted(elsewhere)}
    if others:
        values, plural = " or ".join(others.values()), "s" if len(others) == 1 else ""
        text = f"not identifiable: {values} explain{plural} the data as well"
        if key.key.startswith(PHASE_DEPENDENT_KEYS):
            turn = _quarter(findings.problem)
        else:
            turn = 0.0
        if findings.problem.scenario.motor.phases == 2:
            part = "quarter"
        else:
            part = "part"
        known = (
            f", from another {part} of the electrical turn; {SETTLE_KEY} known to"
            f" {turn / QUARTER_TURN_SIGMAS:.2g} s (settle_error) would tell"
        )
        return False, text + (known if turn else "")
    return _width(findings, k, interval, fit)


def _single_current_reason(problem: Problem, key: FitKey) -> str:
    """Why a detent torque and a flux harmonic that are fitted together are not identifiable; empty
    where recordings at several currents tell them apart.

    At one current a flux harmonic and detent torque of its order make the same full-step line, and
    differ only in small lines that other effects make as well.
    """
    if len({test.motor.current for _, test in problem.tests}) > 1:
        return ""
    fitted = [one.key for one in problem.keys]
    kinds = (DETENT_KEYS, FLUX_KEYS)
    together = all(any(name.startswith(kind) for name in fitted) for kind in kinds)
    if together and any(key.key.startswith(kind) for kind in kinds):
        return (
            "not identifiable: detent torque and flux harmonics are not told apart at one current;"
            " add a recording at another one (FILE@motor.current=...)"
        )
    return ""


def _quarter(problem: Problem) -> float:
    """Time of a period of the detent torque, a quarter of the electrical turn of two phases [s]; 0
    where the rate changes.
    """
    driver, clock = problem.scenario.driver, problem.tests[0][1].driving_frequency
    if clock:
        return driver.beats * driver.microsteps / (problem.scenario.motor.alike_per_turn * clock)
    return 0.0


def _width(findings: Findings, k: int, interval: Interval, fit: Goodness) -> tuple[bool, str]:
    key = findings.problem.keys[k]
    value = key.value(float(findings.best.x[k]))
    half = 0.5 * (key.value(interval.high) - key.value(interval.low))
    if (
        interval.open_low
        or interval.open_high
        or half > Z_95 * MAX_RELATIVE_ERROR * abs(key.relative_to(value))
    ):
        correlation = np.abs(
            np.where(np.arange(findings.best.x.size) == k, 0.0, correlations(findings.local)[k])
        )
        if np.max(correlation) > MAX_CORRELATION:
            return (
                False,
                "not identifiable separately from"
                f" {findings.problem.keys[int(np.argmax(correlation))].label}",
            )
        return False, "not identifiable: the evidence is insensitive to it"
    settle = findings.problem.scenario.record.settle
    late = next((one.shifts[k] for one in findings.dependences if one.key == SETTLE_KEY), 0.0)
    if abs(late) * settle_relative_error(findings.problem) * abs(key.relative_to(value)) > half:
        moves = f"1 s more than the {settle:g} s assumed moves it by {100.0 * late / settle:+.2g} %"
        return False, f"not identifiable without the settling time: {moves}"
    # slopes that tell too little widen the linearised one alone
    if interval.profiled:
        spread = (interval.high - interval.low) / (2.0 * Z_95)
    else:
        spread = float(findings.local.spread[k])
    if moved := shift_reason(findings.lacking, findings.problem, findings.best, k, spread):
        return False, moved
    alike = [one for one in findings.alike if one.fitted == k]
    held = "" if fit.freedom > 0 else ", if the model holds"
    return True, f"identifiable{together(alike, key, value)}{held}"


def correlations(local: LinearModel) -> np.ndarray:
    """Correlation of the estimates, (m, m)."""
    return local.covariance / np.outer(local.spread, local.spread)


def alternative_optima(
    problem: Problem, best: Optimum, others: Sequence[Optimum], local: LinearModel
) -> tuple[Optimum, ...]:
    """Optima elsewhere that are not much less likely than the best, the best of them first; before
    them, the best's other quarters.

    Quarters of the electrical turn are told apart by the turn alone. What else differs from one to
    the next, such as the mean current where one phase has more than the other, is smaller than what
    is known of a drive.
    """
    points = quarter_turn_solutions(problem, best.x)
    turn = np.array([o.form == "turn" for _, o in problem.observed], dtype=bool)
    if points:
        at = [r[: problem.figures][turn] for r in problem.residuals(points)]
    else:
        at = []
    rise = [float(r @ r - np.sum(best.r[: problem.figures][turn] ** 2)) for r in at]
    found = [
        Optimum(x, best.r, best.cost)
        for x, more in zip(points, rise, strict=True)
        if more < EQUIVALENT_COST
    ]
    for other in sorted(others, key=lambda o: o.cost):
        apart = all(
            np.max(np.abs(other.x - o.x) / local.spread) > 3.0 * Z_95 for o in (best, *found)
        )
        if apart and other.cost - best.cost < EQUIVALENT_COST * local.scatter:
            found.append(other)
    return tuple(found)


def dependences(problem: Problem, best: Optimum, local: LinearModel) -> tuple[Dependence, ...]:
    """How far each estimate moves with each number of the scenario that was not fitted, to first
    order.

    With the settling time by fitting again at a later one: how much of the start's ringing is left
    is far from linear.
    """
    taken, own = problem.taken, {name: value for name, value, _ in problem.scenario.entries()}
    free = [
        name
        for name in fittable(problem.scenario)
        if name not in {*taken, SETTLE_KEY} and own[name]
    ]
    changes = [{name: own[name] * (1.0 + RELATIVE_STEP)} for name in free]
    changes = [change for change in changes if _scenario_if_valid(problem.scenario, change)]
    values = problem.values(best.x)
    scale = np.array(
        [key.slope(v) / key.relative_to(v) for key, v in zip(problem.keys, values, strict=True)]
    )
    gain = -(local.covariance / local.scatter) @ local.J.T
    nudged = local.near(problem).residuals(
        [best.x] * len(changes), [[change] * len(problem.tests) for change in changes]
    )
    moves = {
        name: gain @ (r - best.r) / RELATIVE_STEP
        for (name,), r in zip(changes, nudged, strict=True)
    }
    if SETTLE_KEY not in taken and own[SETTLE_KEY]:
        part = settle_relative_error(problem)
        scenario = problem.scenario.with_si({SETTLE_KEY: own[SETTLE_KEY] * (1.0 + part)})
        later = Problem(
            scenario, problem.evidence, problem.keys, problem.trust
        )  # what it meets is not the search's best
        moves[SETTLE_KEY] = (_refitted(later, best, local) - best.x) / part
    found = [Dependence(name, tuple((scale * move).tolist())) for name, move in moves.items()]
    return tuple(sorted(found, key=lambda one: -max(map(abs, one.shifts))))


def _refitted(later: Problem, best: Optimum, local: LinearModel) -> np.ndarray:
    """The best point (m,) of a problem that differs in its settling time alone; among steady states,
    of which none does, corrected to its runs, where they have the slopes of runs.
    """
    if local.steady is None:
        return Descent(later, best.x, J=local.J).run(RESTART_STEPS).x
    x = best.x
    for _ in range(CORRECTED_REFITS):
        near = local.steady.corrected_to(later, x)
        x = Descent(near, x, J=local.J).run(RESTART_STEPS, COARSE_COST_TOLERANCE).x
    return x


def settle_relative_error(problem: Problem) -> float:
    """Relative error of the settling time."""
    settle = problem.scenario.record.settle
    if settle:
        return min(ASSUMED_SETTLE_ERROR, problem.trust.settle / settle)
    return ASSUMED_SETTLE_ERROR


def _scenario_if_valid(scenario: Scenario, change: dict[str, object]) -> bool:
    try:
        scenario.with_si(change)
    except MicrovibError:
        return False
    return True
