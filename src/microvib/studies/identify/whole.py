"""Whole numbers that are fitted: each that may be is tried, all other parameters at their best."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from microvib.model.scenario import Scenario
from microvib.studies.evidence import Evidence
from microvib.studies.identify.keys import WholeKey
from microvib.studies.identify.problem import Own, Problem
from microvib.studies.identify.scattered import misfit, settled
from microvib.studies.identify.search import FULL, ROUGH, Descent, Optimum, material
from microvib.studies.identify.verdict import ODDS, Estimate, Findings, Whole, refusal


def numbered(
    scenario: Scenario, tests: Sequence[tuple[Evidence, Own]], numbers: Mapping[str, object]
) -> tuple[Scenario, list[tuple[Evidence, Own]]]:
    """Scenario and tests, those that have scenarios of their own too, with those numbers."""
    told: list[tuple[Evidence, Own]] = [
        (one, own.with_si(dict(numbers)) if isinstance(own, Scenario) else own) for one, own in tests
    ]
    return scenario.with_si(dict(numbers)), told


def each_tried(found: Findings, keys: Sequence[WholeKey]) -> tuple[tuple[Whole, ...], Problem | None]:
    """What is known of whole numbers where ``found`` has its best, and the problem with one that is better, if there is one."""
    problem, best = found.problem, found.best
    least, better, told = misfit(problem, best), None, []
    for key in keys:
        now, as_good = int(str(problem.scenario[key.key])), []
        for number in key.numbers:
            other = _with(problem, {key.key: number})
            rise = 0.0 if number == now else misfit(*_fitted_again(other, problem, best)) - misfit(problem, best)
            if rise < ODDS * found.local.scatter:
                as_good.append(number)
            if rise + misfit(problem, best) < least - material(best.cost):
                least, better = rise + misfit(problem, best), other
        told.append(Whole(key, now, tuple(as_good)))
    return tuple(told), better


def _with(problem: Problem, numbers: Mapping[str, object]) -> Problem:
    scenario, tests = numbered(problem.scenario, problem.evidence, numbers)
    return problem.again(evidence=tests, scenario=scenario)


def _fitted_again(other: Problem, problem: Problem, best: Optimum) -> tuple[Problem, Optimum]:
    problem.ledger.stage = "whole numbers"
    return settled(other, [Descent(other, best.x).run(FULL, ROUGH)])


def estimate(found: Findings, key: WholeKey) -> Estimate:
    """A whole number with those that explain the evidence as well, and its verdict."""
    number, low, high = int(str(found.problem.scenario[key.key])), float(key.low), float(key.high)
    one = next((one for one in found.whole if one.key is key), None)
    refused = refusal(found) or ("" if one else "not identifiable: the search has not converged")
    if refused or one is None:
        return Estimate(key.key, "", number, math.nan, low, high, False, refused)
    others = [str(n) for n in one.as_good if n != number]
    verdict = "identifiable"
    if others:
        verdict = f"not identifiable: {' or '.join(others)} explain{'s' if len(others) == 1 else ''} the data as well"
    elif number in (key.low, key.high):
        verdict = "not identifiable: at the end of its range"
    between = float(min(one.as_good)), float(max(one.as_good))
    return Estimate(key.key, "", number, math.nan, low, high, verdict == "identifiable", verdict, between)
