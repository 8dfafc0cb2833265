"""Where no model explains a recording: whether one would with its sign or time reversed, in another
unit, or another channel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from microvib.studies.evidence import Evidence
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.problem import Problem, TestOverrides, cost
from microvib.studies.identify.search import (
    COARSE_COST_TOLERANCE,
    MAX_DESCENT_STEPS,
    Descent,
    Optimum,
)
from microvib.studies.misreading import reversal_variants, scale_in_words

UNKNOWN_SCALE_SIGMA = 10.0
"""Standard deviation of the logarithm of a recording's scale where its unit is in question."""
UNKNOWN_SIGN_SIGMA = 1e3
"""Standard deviation of an angle or a decay where signs are in question, over its own."""
MIN_SCALE_ERROR = 0.1
"""Logarithm of a scale from which it is told."""
POINTS, ENDS = 32, 3
"""Points of the search whose cost sees neither sign nor scale, and how many of them are fitted
from.
"""

Tests = list[tuple[Evidence, TestOverrides]]


def diagnose_units_signs(problem: Problem) -> tuple[str, ...]:
    """Sentences on what would make the evidence one that the model explains; ranges are those that
    a search begins with.
    """
    while (along := problem.along()) is not None:
        problem = along
    found = [
        f"{one.name}: {what} the model explains it; check order, sign and unit of"
        f" {one.channel or 'its figures'}."
        for one, what in _signs_and_scales(problem, problem.evidence)
    ]
    return tuple(found or _channels(problem))


def _signs_and_scales(
    problem: Problem, tests: Sequence[tuple[Evidence, TestOverrides]]
) -> Iterator[tuple[Evidence, str]]:
    """Change of each test that explains it; nothing, where the model explains none of them, or all as
    they are.
    """
    free = problem.again(evidence=tests, trust=replace(problem.trust, common=UNKNOWN_SCALE_SIGMA))
    signed = np.array([o.is_angle or o.form == "decay" for _, o in free.observed])
    end = _best_of_fits(free.looser(np.where(signed, UNKNOWN_SIGN_SIGMA, 1.0)))
    if not goodness(free, end.r).explained:
        return
    changes, changed = [], []
    for j, (one, own) in enumerate(tests):
        read = reversal_variants(one.observations, free.tests[j][1].motor.alike_per_turn)
        each = {what: replace(one, observations=its) for what, its in read.items()}
        costs = {what: _mean_cost_of_test(free, j, its, end.x) for what, its in each.items()}
        changes.append(min(costs, key=lambda what: costs[what]))
        changed.append((each[changes[-1]], own))
    told = free.again(evidence=changed)
    end = Descent(told, end.x).run(MAX_DESCENT_STEPS, COARSE_COST_TOLERANCE)
    if not goodness(told, end.r).explained:
        return
    scales = (
        -UNKNOWN_SCALE_SIGMA * end.r[told.figures : told.figures + len(tests)]
    )  # of the recording, not of the model
    for (one, _), change, scale in zip(tests, changes, scales, strict=True):
        what = [change] if change else []
        if abs(scale) > MIN_SCALE_ERROR:
            what += [scale_in_words(float(scale))]
        else:
            what += []
        if what:
            yield one, " and ".join(what)


def _best_of_fits(problem: Problem) -> Optimum:
    """The best of local fits from a few points."""
    from scipy.stats import qmc

    problem.best_so_far.stage = "sign and unit"
    low, high = np.array([key.range for key in problem.keys]).T
    others = low + (high - low) * qmc.Sobol(low.size, seed=1).random(POINTS)
    points = [problem.tuned(point) for point in (problem.start, *others)]
    order = np.argsort([cost(r) for r in problem.residuals(points)], kind="stable")
    ends = problem.in_threads(
        lambda point: Descent(problem, point).run(MAX_DESCENT_STEPS, COARSE_COST_TOLERANCE),
        [points[k] for k in order[:ENDS]],
    )
    return min(ends, key=lambda o: o.cost)


def _mean_cost_of_test(problem: Problem, j: int, its: Evidence, x: np.ndarray) -> float:
    """Mean cost of figures with ``its`` observations in place of one test's."""
    other = problem.again(evidence=_with_test(problem, j, its))
    return cost(other.residuals([x])[0][: other.figures]) / other.figures


def _with_test(problem: Problem, j: int, its: Evidence) -> list[tuple[Evidence, TestOverrides]]:
    """The evidence with ``its`` observations in place of one test's."""
    return [(its if k == j else one, own) for k, (one, own) in enumerate(problem.evidence)]


def _channels(problem: Problem) -> Iterator[str]:
    """Other channels of torque that the model explains, in place of a recording's."""
    for j, (one, _) in enumerate(problem.evidence):
        if one.prepared is None:
            continue
        units = one.prepared.recording.units
        for channel in (
            name
            for name, unit in units.items()
            if unit == units[one.channel] and name != one.channel
        ):
            other = one.of_channel(channel, problem.tests[j][1])
            tests = _with_test(problem, j, other)
            posed = problem.again(evidence=tests)
            if len(other.observations) <= len(problem.keys):
                continue
            fit = goodness(posed, _best_of_fits(posed).r)
            if fit.explained:
                told = {other.name: ""}
            else:
                told = {its.name: what for its, what in _signs_and_scales(posed, tests)}
            if told:
                how = ", ".join(filter(None, told.values()))
                where = f"{channel} in place of {one.channel}{how and f', {how}'}"
                yield f"{one.name}: the model explains {where}; check the drive axis."
