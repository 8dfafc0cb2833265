"""Whole numbers that are fitted: each that may be is tried, all other parameters at their best."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from microvib.model.scenario import Scenario
from microvib.studies.evidence import Evidence
from microvib.studies.identify.keys import IntegerKey
from microvib.studies.identify.problem import Problem, TestOverrides
from microvib.studies.identify.scattered import minus_two_log_likelihood, refine_noisy_optimum
from microvib.studies.identify.search import (
    COARSE_COST_TOLERANCE,
    MAX_DESCENT_STEPS,
    Descent,
    Optimum,
    significant_gain,
)
from microvib.studies.identify.verdict import (
    EQUIVALENT_COST,
    Estimate,
    Findings,
    IntegerResult,
    not_identifiable_reason,
)


def with_integers(
    scenario: Scenario,
    tests: Sequence[tuple[Evidence, TestOverrides]],
    numbers: Mapping[str, object],
) -> tuple[Scenario, list[tuple[Evidence, TestOverrides]]]:
    """Scenario and tests, those that have scenarios of their own too, with those numbers."""
    told: list[tuple[Evidence, TestOverrides]] = [
        (one, own.with_si(dict(numbers)) if isinstance(own, Scenario) else own)
        for one, own in tests
    ]
    return scenario.with_si(dict(numbers)), told


def try_integers(
    found: Findings, keys: Sequence[IntegerKey]
) -> tuple[tuple[IntegerResult, ...], Problem | None]:
    """Findings on integer keys where ``found`` has its best, and the problem with one that is
    better, if there is one.
    """
    problem, best = found.problem, found.best
    least, better, told = minus_two_log_likelihood(problem, best), None, []
    for key in keys:
        now, as_good = int(str(problem.scenario[key.key])), []
        for number in key.numbers:
            other = _problem_with_integers(problem, {key.key: number})
            if number == now:
                rise = 0.0
            else:
                rise = minus_two_log_likelihood(
                    *_fitted_again(other, problem, best)
                ) - minus_two_log_likelihood(problem, best)
            if rise < EQUIVALENT_COST * found.local.scatter:
                as_good.append(number)
            if rise + minus_two_log_likelihood(problem, best) < least - significant_gain(best.cost):
                least, better = rise + minus_two_log_likelihood(problem, best), other
        told.append(IntegerResult(key, now, tuple(as_good)))
    return tuple(told), better


def _problem_with_integers(problem: Problem, numbers: Mapping[str, object]) -> Problem:
    scenario, tests = with_integers(problem.scenario, problem.evidence, numbers)
    return problem.again(evidence=tests, scenario=scenario)


def _fitted_again(other: Problem, problem: Problem, best: Optimum) -> tuple[Problem, Optimum]:
    problem.best_so_far.stage = "whole numbers"
    return refine_noisy_optimum(
        other, [Descent(other, best.x).run(MAX_DESCENT_STEPS, COARSE_COST_TOLERANCE)]
    )


def estimate(found: Findings, key: IntegerKey) -> Estimate:
    """A whole number with those that explain the evidence as well, and its verdict."""
    number, low, high = int(str(found.problem.scenario[key.key])), float(key.low), float(key.high)
    one = next((one for one in found.whole if one.key is key), None)
    refused = not_identifiable_reason(found) or (
        "" if one else "not identifiable: the search has not converged"
    )
    if refused or one is None:
        return Estimate(key.key, "", number, math.nan, low, high, False, refused)
    others = [str(n) for n in one.as_good if n != number]
    verdict = "identifiable"
    if others:
        verdict = f"not identifiable: {' or '.join(others)} explain{'s' if len(others) == 1 else ''} the data as well"
    elif number in (key.low, key.high):
        verdict = "not identifiable: at the end of its range"
    between = float(min(one.as_good)), float(max(one.as_good))
    return Estimate(
        key.key, "", number, math.nan, low, high, verdict == "identifiable", verdict, between
    )
