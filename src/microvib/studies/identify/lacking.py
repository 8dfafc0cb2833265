"""Unmodelled effects that the evidence cannot show: effects that explain it as well, and move
the estimates.

The intervals hold for the model as it is. Here each effect of a list is added in several sizes, the
fitted parameters follow by the slopes at the best, and what is left is compared with what the model
without it leaves. Where that is hardly more, the evidence does not rule the effect out; what it
moves then is not identifiable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from microvib.model.driven import noise_bands
from microvib.model.expected import expected_lines
from microvib.model.scenario import Scenario
from microvib.studies.evidence import Observation
from microvib.studies.identify.problem import TORQUE_FORMS, Problem
from microvib.studies.identify.search import LinearModel, Optimum
from microvib.studies.relative_phase import phase_multiples
from microvib.units import Si

EQUIVALENT_CHI_SQUARE = 9.0
"""Chi-square above the best's, over the scatter, up to which an effect is not ruled out: three
standard deviations.
"""
MAX_RELATIVE_SHIFT, MAX_SHIFT_SIGMAS = 0.03, 2.0
"""Relative change of an estimate, and standard errors, from both of which on it is not
identifiable.
"""
SIZE_STEPS = np.linspace(0.1, 1.0, 10)
"""Parts of the way from one size of an effect to the next that are looked at."""
ORDERS, CORNERS = (1, 2, 4), np.geomspace(20.0, 2e4, 40)
"""Orders and corners [Hz] of a low-pass that nobody stated."""
DAMPINGS, RESONANCES = (0.003, 0.02, 0.1), np.geomspace(20.0, 4e3, 80)
"""Dampings and frequencies [Hz] of a resonance of the table."""
CHAIN, TABLE = "the chain's response", "a resonance of the table"
DRIVER_TABLE = "a driver.table"
FLUX, DETENT = "harmonics of the motor's flux", "detent torque"
"""Effects of which each makes the lines of the other as long as the current is the same."""
STATE_CHAIN_ADVICE = (
    "; state it in the preparation file (response; 'response: flat' where there is none)"
)
"""Advice on the measuring chain."""
ANOTHER_CURRENT_ADVICE = (
    "; the two cannot be told apart at one current: add a recording at another one"
    " (FILE@motor.current=...)"
)
"""Advice on detent torque and flux harmonics."""
TYPICAL_SIZE = 0.01
"""Torque of a harmonic that is looked for, over the motor's at its current."""
DEFAULT_STIFFNESS = 1e4
"""Stiffness [N m/rad] that presliding is compared with where the reducer has none."""


@dataclass(frozen=True)
class UnmodelledEffect:
    """An effect that the evidence does not rule out, and how far it moves each estimate at most."""

    effect: str
    shifts: tuple[float, ...]
    """Changes of the coordinates."""
    remedy: str = ""
    """Advice on what would rule it out, a clause with its semicolon; empty where nothing is known."""

    def text(self, value: float, moved: float, phase: bool = False) -> str:
        """Why an estimate, of a phase [rad] or another, is not identifiable that it moves to
        another value.
        """
        if value:
            change = moved / value - 1.0
        else:
            change = math.inf
        by = f"by {100.0 * change:+.2g} %"
        if not abs(change) < 1.0:
            by = "by more than a factor of two" if value else "away from 0"  # slopes tell no more
        if phase:
            by = f"by {math.degrees(moved - value):+.2g} deg"
        return f"not identifiable: the evidence does not rule out {self.effect}, which would move it {by}{self.remedy}"


def unmodelled_effects(
    problem: Problem, best: Optimum, local: LinearModel, simulated: bool = True
) -> tuple[UnmodelledEffect, ...]:
    """Effects that are not ruled out; with those that are ``simulated``, or of the measuring chain
    alone.
    """
    solve = np.linalg.pinv(local.J)
    rest = best.r - local.J @ (solve @ best.r)
    limit = float(rest @ rest) + EQUIVALENT_CHI_SQUARE * local.scatter
    found: dict[str, np.ndarray] = {}
    for effect, path in (
        *_chain_effects(problem),
        *(_effects(local.near(problem), best) if simulated else ()),
    ):
        before = np.zeros(best.r.size)
        for change in path:
            points = before + SIZE_STEPS[:, None] * (change - before)
            moves = -(points @ solve.T)
            left = points + best.r - (points + best.r) @ (local.J @ solve).T
            good = np.sum(left**2, axis=1) < limit
            if np.any(good):
                most = moves[good][
                    np.argmax(np.abs(moves[good]), axis=0), np.arange(moves.shape[1])
                ]
                known = found.get(effect, 0.0 * most)
                found[effect] = np.where(np.abs(most) > np.abs(known), most, known)
            before = change
    return tuple(
        UnmodelledEffect(effect, tuple(shifts.tolist()), _remedy(problem, effect))
        for effect, shifts in found.items()
    )


def _remedy(problem: Problem, effect: str) -> str:
    """Advice on what would rule out an effect; empty where nothing is known."""
    if effect in (CHAIN, TABLE):
        return STATE_CHAIN_ADVICE
    currents = {test.motor.current for _, test in problem.tests}
    if effect in (FLUX, DETENT) and len(currents) == 1:
        return ANOTHER_CURRENT_ADVICE
    return ""


def shift_reason(
    found: Sequence[UnmodelledEffect], problem: Problem, best: Optimum, k: int, spread: float
) -> str:
    """Why the k-th parameter, whose coordinate has the standard error ``spread``, is not
    identifiable; empty where it may be.
    """
    key, x = problem.keys[k], float(best.x[k])
    value = key.value(x)
    far = [one for one in found if abs(one.shifts[k]) > MAX_SHIFT_SIGMAS * spread]
    far = [
        one
        for one in far
        if abs(key.value(x + one.shifts[k]) - value)
        > MAX_RELATIVE_SHIFT * abs(key.relative_to(value))
    ]
    if not far:
        return ""
    worst = max(far, key=lambda one: abs(one.shifts[k]))
    return worst.text(value, key.value(x + worst.shifts[k]), key.is_phase)


def _chain_effects(problem: Problem) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Changes of the residuals by chains and tables that are not stated, each a path of one size."""
    open_tests = [
        j
        for j, (one, _) in enumerate(problem.tests)
        if one.prepared and not one.prepared.response_known
    ]
    if not open_tests:
        return
    at = [_frequencies(problem, j) for j in range(len(problem.tests))]
    for order in ORDERS:
        for corner in CORNERS:
            yield CHAIN, [_filtered(problem, open_tests, at, _low_pass(order, float(corner)))]
    for damping in DAMPINGS:
        for resonance in RESONANCES:
            yield TABLE, [_filtered(problem, open_tests, at, _resonance(damping, float(resonance)))]


def _low_pass(order: int, corner: float) -> np.ndarray:
    """Coefficients of a Butterworth low-pass in j f/corner, that of the highest power first, with
    its corner.
    """
    from scipy.signal import butter

    return np.append(butter(order, 1.0, analog=True)[1], corner)


def _resonance(damping: float, frequency: float) -> np.ndarray:
    return np.array([1.0, 2.0 * damping, 1.0, frequency])


def _filtered(
    problem: Problem, tests: Sequence[int], at: Sequence[dict[str, float]], poles: np.ndarray
) -> np.ndarray:
    """Change of the residuals where the recordings of some ``tests`` passed an all-pole filter."""
    change = np.zeros(problem.figures)
    for i, (j, o) in enumerate(problem.observed):
        if j in tests:
            change[i] = _observation_change(
                o, at[j], poles, problem.tests[j][1].motor.alike_per_turn
            )
    return np.append(np.concatenate(problem.weighted(change)), np.zeros(len(problem.keys)))


def _observation_change(
    o: Observation, at: dict[str, float], poles: np.ndarray, steps: int
) -> float:
    """Change of a figure's difference by a filter: logarithm of the gain, or relative phase."""

    def gain(name: str) -> complex:
        return complex(1.0 / np.polyval(poles[:-1], 1j * at.get(name, 0.0) / poles[-1]))

    if o.form in TORQUE_FORMS:
        return math.log(
            abs(
                complex(1.0 / np.polyval(poles[:-1], 1j * o.bin_frequency / poles[-1]))
                if o.bins
                else gain(o.line)
            )
        )
    if not o.is_angle or not o.against:
        return 0.0
    mine, its = phase_multiples(o.line, o.against, steps)
    turned = np.angle(gain(o.line)) * mine - np.angle(gain(o.against)) * its
    return math.remainder(float(turned), math.tau)


def _frequencies(problem: Problem, j: int) -> dict[str, float]:
    """Frequencies [Hz] of a test's lines by name."""
    one, test = problem.tests[j]
    return {line.name: line.frequency for line in expected_lines(test, Si(math.inf), one.harmonics)}


def _effects(problem: Problem, best: Optimum) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Changes of the residuals by effects of the drive that its scenario lacks, in growing sizes of
    each.
    """
    sizes = [
        (effect, changes) for effect, key, changes in _drive_effects(problem.scenario)
        if all(key not in taken for taken in problem.taken) and not any(noise_bands(test) for _, test in problem.tests)
    ]  # fmt: skip
    each = [change for _, changes in sizes for change in changes]
    if not each:
        return
    with_it = problem.residuals(
        [best.x] * len(each), [[change] * len(problem.tests) for change in each]
    )
    at = iter(with_it)
    for effect, changes in sizes:
        yield effect, [problem.least(next(at) - best.r) for _ in changes]


def _drive_effects(scenario: Scenario) -> Iterator[tuple[str, str, list[dict[str, object]]]]:
    """Effects that a scenario lacks, their keys, and changes by them in growing sizes."""
    driver, motor, reducer = scenario.driver, scenario.motor, scenario.reducer
    if driver.supply_voltage is None:
        least = motor.winding_resistance * motor.current
        volts: list[dict[str, object]] = [
            {"driver.supply_voltage": times * least} for times in (5.0, 2.0, 1.2)
        ]
        yield "driver.supply_voltage", "driver.supply_voltage", volts
    if scenario.friction.presliding is None:
        if reducer.stiffness == "rigid":
            stiffness = DEFAULT_STIFFNESS
        else:
            stiffness = reducer.stiffness
        stiff: list[dict[str, object]] = [
            {"friction.presliding": {"stiffness": times * stiffness}} for times in (20.0, 4.0, 1.0)
        ]
        yield "friction.presliding", "friction.presliding", stiff
    if scenario.driving_frequency:
        step = abs(scenario.rate or 0.0) / scenario.driving_frequency
    else:
        step = 0.0
    if not reducer.backlash and not reducer.rigid and step:
        gaps: list[dict[str, object]] = [
            {"reducer.backlash": times * step} for times in (0.05, 0.3, 1.0)
        ]
        yield "reducer.backlash", "reducer.backlash", gaps
    yield from _full_step_effects(scenario)


def _full_step_effects(scenario: Scenario) -> Iterator[tuple[str, str, list[dict[str, object]]]]:
    """Effects of the order of the detent torque, in four phases each: a table of the driver, a
    harmonic of the flux, the detent torque itself.
    """
    driver, motor = scenario.driver, scenario.motor
    order, full = motor.detent_periods, motor.axis_torque_constant * motor.axis_current
    for turned in range(4):
        phase = 0.5 * math.pi * turned
        if driver.table is None:
            harmonic = {"order": order, "amplitude": TYPICAL_SIZE, "phase": phase}
            yield DRIVER_TABLE, "driver.table", [{"driver.table": {"harmonics": [harmonic]}}]
        if not motor.flux_harmonics:
            harmonic = {"order": order - 1, "amplitude": TYPICAL_SIZE, "phase": phase}
            yield FLUX, "motor.flux_harmonics", [{"motor.flux_harmonics": [harmonic]}]
        if not motor.detent and motor.detent_torque == 0.0:
            harmonic = {"order": order, "amplitude": TYPICAL_SIZE * full, "phase": phase}
            yield DETENT, "motor.detent", [{"motor.detent": [harmonic]}]
