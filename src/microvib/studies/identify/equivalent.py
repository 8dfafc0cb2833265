"""Parameters that are not fitted and act exactly like one that is: what is found is of both together.

No evidence tells eddy-current damping of a rotor from viscous friction in its bearings, or two inertias
on one shaft from each other. Their slopes are parallel, that of a parameter which the scenario does not
have included.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from microvib.errors import MicrovibError
from microvib.studies.identify.keys import FitKey, fittable
from microvib.studies.identify.lacking import EQUIVALENT_CHI_SQUARE
from microvib.studies.identify.problem import Problem
from microvib.studies.identify.search import LinearModel, Optimum
from microvib.units import pretty

STEP = 0.01
"""Relative change of a fitted parameter, and of those that are compared with it."""
PARALLEL = 3e-3
"""Part of a change of the evidence that another parameter may not make, up to which both act alike."""
LEAST_FIGURES = 3
"""Figures of the evidence from which parallel slopes tell anything."""
_SAME = 0.01
"""Relative difference of two effects, for the same change, up to which it is their sum that acts."""


@dataclass(frozen=True)
class Equivalent:
    """A parameter that is not fitted and acts exactly like a fitted one."""

    key: str
    fitted: int
    """Place of the fitted one among the keys of the problem."""
    ratio: float
    """Change of the fitted one that does what a change of 1 of this one does, in SI."""
    value: float
    """Its value in the scenario [SI]; 0 where that does not have it."""

    @property
    def adds(self) -> bool:
        """Whether it is the sum of both that acts."""
        return abs(self.ratio - 1.0) <= _SAME


def equivalents(problem: Problem, best: Optimum, local: LinearModel) -> tuple[Equivalent, ...]:
    """Parameters that act exactly like a fitted one: numbers of the scenario, and those at 0 or absent
    that have the unit of a fitted one.
    """
    steps = {} if problem.figures < LEAST_FIGURES else dict(_steps(problem, best))
    if not steps:
        return ()
    values = problem.values(best.x)
    points = [best.x.copy() for _ in problem.keys] + [best.x] * len(steps)
    for k, (key, value) in enumerate(zip(problem.keys, values, strict=True)):
        points[k][k] = key.coordinate(value + STEP * key.relative_to(value))
    known = _numbers(problem)
    own: list[Mapping[str, object]] = [{} for _ in problem.keys]
    own += [{name: known[name] + step} for name, step in steps.items()]
    found = local.near(problem).residuals(points, [[one] * len(problem.tests) for one in own])
    changes = [problem.least(r - best.r)[: -best.x.size] for r in found]
    fitted, others = changes[: best.x.size], changes[best.x.size :]
    worst = math.sqrt(EQUIVALENT_CHI_SQUARE * local.scatter)
    return tuple(
        Equivalent(
            name, k, part * STEP * problem.keys[k].relative_to(values[k]) / step, known[name]
        )
        for (name, step), other in zip(steps.items(), others, strict=True)
        for k, mine in enumerate(fitted)
        if (part := _part_of(other, mine, worst))
    )


def _part_of(other: np.ndarray, mine: np.ndarray, worst: float) -> float:
    """Part of a change of the residuals that another one is; 0 where it is not parallel, or differs by
    more than ``worst`` once the fitted parameter is replaced by the other one altogether.
    """
    square, size = float(mine @ mine), float(np.linalg.norm(other))
    if not square or not size:
        return 0.0
    part = float(other @ mine) / square
    apart = float(np.linalg.norm(other - part * mine))
    alike = apart <= PARALLEL * size and apart <= worst * STEP * abs(part)
    return part if alike else 0.0


def _numbers(problem: Problem) -> dict[str, float]:
    """Numbers of the scenario by their keys; 0 of those that it does not have."""
    return {
        name: float(value or 0.0)
        for name, value, quantity in problem.scenario.entries()
        if quantity is not None and (value is None or isinstance(value, float))
    }


def _steps(problem: Problem, best: Optimum) -> Iterator[tuple[str, float]]:
    """Changes of the parameters that are compared [SI], by their keys."""
    known, units = _numbers(problem), {n: q.unit for n, _, q in problem.scenario.entries() if q}
    sizes = {
        key.unit: abs(STEP * value)
        for key, value in zip(problem.keys, problem.values(best.x), strict=True)
        if value and not key.is_phase
    }
    changeable = {*fittable(problem.scenario), *(n for n, v in known.items() if not v)}
    for name, value in known.items():
        taken = any(name in each for each in problem.taken)
        if taken or name not in changeable or name.startswith(("record.", "solver.", "tracking.")):
            continue
        step = sizes.get(units[name], STEP * value)  # a sum is the same at the same step alone
        if step and _is_valid(problem, {name: value + step}):
            yield name, step


def _is_valid(problem: Problem, change: dict[str, object]) -> bool:
    try:
        problem.scenario.with_si(change)
    except MicrovibError:
        return False
    return True


def together(found: Sequence[Equivalent], key: FitKey, value: float) -> str:
    """Clause on what acts exactly like a fitted parameter, after *identifiable*; empty without any."""
    clauses = []
    if added := [one for one in found if one.adds]:
        total = value + sum(one.value for one in added)
        names = " and ".join(one.key for one in added)
        told = "the two are" if len(added) == 1 else "they are"
        clauses.append(
            f" with {names}: the sum is, {total:.4g} {pretty(key.unit)}; {told} not told apart"
        )
    if others := [one for one in found if not one.adds]:
        names = " and ".join(one.key for one in others)
        clauses.append(f", if {names} is right: an error in it has the same effect on all lines")
    return "".join(clauses)
