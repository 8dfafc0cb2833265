"""Points that may explain the evidence as well as another: the driver's errors turned in its
electrical period, other signs.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

import numpy as np

from microvib.model.scenario import Scenario
from microvib.studies.identify.problem import Problem

IMPERFECTIONS_PREFIX = "driver.imperfections."
"""Keys of the driver's errors."""
PHASE_IMBALANCE_NAMES = ("gain_b", "offset_a", "offset_b", "quadrature")
"""Driver errors that make one phase differ from the other, or a half turn from the next."""
PHASE_DEPENDENT_KEYS = (
    *(IMPERFECTIONS_PREFIX + name for name in PHASE_IMBALANCE_NAMES),
    "driver.table.harmonics.",
)
"""Keys, or how they begin, of errors that are others in another quarter of the electrical turn."""
SAME_POINT_DISTANCE = 1e-9
"""Difference in every coordinate below which two points are one."""


def symmetric_solutions(problem: Problem, x: np.ndarray) -> list[np.ndarray]:
    """Points from which a fit may end as well as in ``x``: the driver's errors turned, and keys of
    either sign mirrored.

    What is not fitted stays. Offsets are turned alone, too: a fit that has those in the wrong
    quarter may have the rest right.
    """
    now, every = problem.named(x), range(len(problem.tests))
    turned = [_rotate_driver_errors(problem, x, periods, every)[0] for periods in _periods(problem)]
    others = [
        *turned,
        *({name: v for name, v in one.items() if "offset" in name} for one in turned),
    ]
    for name in (key.label for key in problem.keys if key.low < 0.0 < key.high):
        others += [{name: -now[name]}]
        phase = name.replace("amplitude", "phase")
        if phase != name and phase in now:
            others += [{name: -now[name], phase: math.remainder(now[phase] + math.pi, math.tau)}]
    return _distinct_points(x, [problem.point(now | other) for other in others])


def quarter_turn_solutions(problem: Problem, x: np.ndarray) -> list[np.ndarray]:
    """Points whose driver, in another quarter of the electrical turn, is that of ``x``: the same
    torque, later.

    In all recordings, and in each that has errors of its own. None where errors that are not
    fitted, or that others share, tell the quarters apart, where stated ranges do, or where ``x``
    has no errors.
    """
    every, found, now = range(len(problem.tests)), [], problem.named(x)
    for tests in (every, *([j] for j in every if len(every) > 1)):
        for periods in _periods(problem):
            then, whole = _rotate_driver_errors(problem, x, periods, tests)
            point = problem.point(now | then)
            if whole and np.allclose(problem.values(point), list((now | then).values())):
                found.append(point)
    return _distinct_points(x, found)


def _periods(problem: Problem) -> range:
    """Numbers of the motor's periods, those of the detent torque as a rule, that are less than an
    electrical turn.
    """
    return range(1, problem.scenario.motor.alike_per_turn)


def _rotate_driver_errors(
    problem: Problem, x: np.ndarray, periods: int, tests: Sequence[int]
) -> tuple[dict[str, float], bool]:
    """The driver's fitted errors in some tests as seen ``periods`` of the detent torque later, and
    whether no others change.
    """
    then: dict[str, float] = {}
    whole = True
    for j in tests:
        scenario = problem.tests[j][1]
        own = {
            name: value
            for name, value, _ in scenario.entries()
            if name.startswith(PHASE_DEPENDENT_KEYS)
        }
        fitted, changed = problem.labels(j), problem.changes(x, j)
        now = own | {name: value for name, value in changed.items() if name in own}
        own_or_all = {
            key for key, label in fitted.items() if len(tests) == len(problem.tests) or label != key
        }
        rows = scenario.driver.table is not None and not scenario.driver.table.harmonics
        for name, value in _rotated_error_values(now, scenario, periods).items():
            mirrored = name.replace(
                "phase", "amplitude"
            )  # half a turn of a harmonic whose phase is not fitted
            if name in own_or_all and math.isfinite(value):
                then[fitted[name]] = value
            elif mirrored in own_or_all and math.isclose(math.cos(value - now[name]), -1.0):
                then[fitted[mirrored]] = -now[mirrored]
            else:
                whole = whole and math.isclose(value, now[name], abs_tol=SAME_POINT_DISTANCE)
        whole = whole and not rows
    return then, whole


def _rotated_error_values(
    now: dict[str, float], scenario: Scenario, periods: int
) -> dict[str, float]:
    """Values of the driver's errors as seen ``periods`` of the detent torque later.

    Of two phases i_B and -i_A are the phases then; after an odd number the current is that of B,
    larger by its gain. Of more, errors of B alone are another phase's then, which has no keys:
    none, unless it is half a turn.
    """
    one, motor, driver = (
        {name: now[IMPERFECTIONS_PREFIX + name] for name in PHASE_IMBALANCE_NAMES},
        scenario.motor,
        scenario.driver,
    )
    alike, two = motor.alike_per_turn, motor.phases == 2
    angle = math.tau * periods / alike
    swapped = two and (4 * periods // alike) % 2 == 1
    if not two and 2 * periods != alike and (one["gain_b"] or one["quadrature"]):
        return {IMPERFECTIONS_PREFIX + name: math.nan for name in ("gain_b", "quadrature")}
    larger, b = (
        1.0 + one["gain_b"] if swapped else 1.0,
        cmath.rect(1.0, math.tau / (4 if two else motor.phases)),
    )
    seen = (one["offset_a"] + one["offset_b"] * b) * cmath.rect(1.0 / larger, -angle)
    offset_b = seen.imag / b.imag
    then = {"offset_a": seen.real - offset_b * b.real, "offset_b": offset_b}
    if swapped:
        then |= {"gain_b": 1.0 / larger - 1.0, "quadrature": -one["quadrature"]}
    else:
        then |= {}
    then = {IMPERFECTIONS_PREFIX + name: value for name, value in then.items()}
    for k, harmonic in enumerate(driver.table.harmonics if driver.table else ()):
        name = f"driver.table.harmonics.{k}."
        then[f"{name}phase"] = math.remainder(
            now[f"{name}phase"] + harmonic.order * angle, math.tau
        )
    return then


def _distinct_points(x: np.ndarray, points: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Points that are neither ``x`` nor one before them."""
    found: list[np.ndarray] = []
    for point in points:
        if all(np.any(np.abs(point - other) > SAME_POINT_DISTANCE) for other in (x, *found)):
            found.append(point)
    return found
