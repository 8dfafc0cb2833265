"""Estimates where simulated figures scatter: with the draw of torque noise, or with the least
change of a parameter.

A drive with noise has other lines with every draw; one whose motion is sensitive, as friction with
memory makes it, has others after the least change. No search ends among such figures, and slopes
between two of them tell nothing. Here figures have a mean, linear in the parameters about the best,
and a scatter: both by regression over points about it, each with a draw of its own. The recording
is one more draw.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from microvib.model.scenario import Scenario
from microvib.studies.evidence import TWO_DRAW_SCATTER
from microvib.studies.identify.intervals import Interval
from microvib.studies.identify.jumps import TRIAL_SHIFTS, figures_jump
from microvib.studies.identify.problem import Problem, cost, total_standard_deviation
from microvib.studies.identify.search import LinearModel, Optimum, linearise_at
from microvib.studies.identify.verdict import (
    SETTLE_KEY,
    Dependence,
    Findings,
    alternative_optima,
    settle_relative_error,
)

INITIAL_HALF_WIDTH, ROUNDS, FINAL_HALF_WIDTH = 0.05, 8, 2.0
"""Half width of the first region in each coordinate; most regions; half width of the last over the
standard error.
"""
POINTS_PER_COEFFICIENT, MIN_POINTS = 8, 32
"""Points of a regression for each of its coefficients, and at least, up to the next power of two."""
SEED_KEY = "friction.torque_noise.seed"


class Regression(NamedTuple):
    """Means of weighted residuals about a centre, and their scatter."""

    at: np.ndarray
    """At the centre, (rows,)."""
    J: np.ndarray
    """Slopes by the coordinates, (rows, m)."""
    variance: np.ndarray
    """Variance of one draw, (rows,)."""
    spread: np.ndarray
    """Covariance of mean and slopes over that, (1 + m, 1 + m)."""
    freedom: int


def is_noisy(problem: Problem, best: Optimum, local: LinearModel) -> bool:
    """Whether figures about the best scatter, so that neither a search nor slopes between
    neighbours tell anything. Runs are asked, whose scatter the recording has, too: steady states may
    be smooth where runs are not.
    """
    return _any_noise(problem) or figures_jump(problem, best.x, best.r, local.J)


def _any_noise(problem: Problem) -> bool:
    return any(_has_noise(test) for _, test in problem.tests)


def _has_noise(scenario: Scenario) -> bool:
    noise = scenario.friction.torque_noise
    return noise is not None and not noise.silent


def noisy_objective(problem: Problem, optima: Sequence[Optimum]) -> Findings:
    """Findings from regressions about the best of the ``optima``, whose region follows the
    standard errors.
    """
    problem.best_so_far.stage = "scatter"
    x, m = optima[0].x, optima[0].x.size
    widest, size, converged = problem.spans / 4.0, np.full(m, INITIAL_HALF_WIDTH), False
    power = math.ceil(math.log2(max(MIN_POINTS, POINTS_PER_COEFFICIENT * (m + 1))))
    for number in range(ROUNDS):
        fit = _regression(problem, x, size, power + converged, number)
        move, v, normal = _step(problem, fit, size)
        there = np.clip(x + move, problem.low, problem.high)
        r = (fit.at + fit.J @ (there - x)) / np.sqrt(v)
        told = np.linalg.eigvalsh(normal)[0] > 0.0
        scatter = max(float(r[:-m] @ r[:-m]) / max(problem.figures - m, 1), 1.0)
        if told:
            covariance = np.linalg.inv(normal) * scatter
        else:
            covariance = np.diag((2.0 * widest) ** 2)
        now = np.clip(FINAL_HALF_WIDTH * np.sqrt(np.diag(covariance)), TRIAL_SHIFTS[1], widest)
        if converged:
            converged = bool(np.all(np.abs(move) < size))
            break
        converged = bool(
            np.all(np.abs(move) < size) and np.all(now < 2.0 * size) and np.all(now > size / 4.0)
        )
        x, size = there, now
    looser = problem.within(there).looser(np.sqrt(v[: problem.figures]))
    best, local = (
        Optimum(there, r, cost(r)),
        LinearModel(fit.J / np.sqrt(v)[:, None], covariance, scatter),
    )
    return replace(
        _found(looser, best, local, optima, converged, fit),
        dependences=_dependences(looser, best, local, size),
    )


def refine_noisy_optimum(problem: Problem, ends: Sequence[Optimum]) -> tuple[Problem, Optimum]:
    """The best end of local fits; where figures jump about it, that of a regression, with their
    scatter in the weights.
    """
    best = min(ends, key=lambda o: o.cost)
    if not is_noisy(problem, best, linearise_at(problem, best)):
        return problem, best
    found = noisy_objective(problem, [best])
    return found.problem, found.best


def minus_two_log_likelihood(problem: Problem, best: Optimum) -> float:
    """Minus twice the log likelihood, but for a constant: cost of the figures, and logarithms of
    what their scatter widens.
    """
    own = cost(best.r[: best.r.size - len(problem.keys)])
    return own + 2.0 * float(np.sum(np.log(problem.weights / problem.tight)))


def _found(
    problem: Problem,
    best: Optimum,
    local: LinearModel,
    optima: Sequence[Optimum],
    converged: bool,
    fit: Regression,
) -> Findings:
    """With intervals and alternative optima, which are compared with single draws of the best."""
    from scipy.stats import t

    half = float(t.ppf(0.975, fit.freedom)) * local.spread
    low, high = best.x - half, best.x + half
    intervals = tuple(
        Interval(max(a, low_end), min(b, high_end), a <= low_end, b >= high_end)
        for a, b, low_end, high_end in zip(low, high, problem.low, problem.high, strict=True)
    )
    each = [cost(r) for r in _residuals_of_draws(problem, [best.x] * 4, 0)]
    excess = float(np.mean(each)) - best.cost
    points = [o.x for o in optima[1:]]
    ends = [
        Optimum(x, r, cost(r) - excess)
        for x, r in zip(points, problem.residuals(points) if points else [], strict=True)
    ]
    others = alternative_optima(problem, best, ends, local)
    return Findings(
        problem, best, local, converged, intervals, others, note=_regression_note(problem, fit)
    )


def _dependences(
    problem: Problem, best: Optimum, local: LinearModel, size: np.ndarray
) -> tuple[Dependence, ...]:
    """How far estimates move with the settling time; of other parameters a mean over many draws
    would be needed for each.
    """
    settles = [test.record.settle for _, test in problem.tests]
    if SETTLE_KEY in problem.taken or not all(settles):
        return ()
    part, values = settle_relative_error(problem), problem.values(best.x)
    points = [
        np.clip(x, problem.low, problem.high)
        for x in best.x + size * _sobol_points(size.size, 4, ROUNDS)
    ]
    later = _residuals_of_draws(
        problem, points, ROUNDS + 1, [{SETTLE_KEY: settle * (1.0 + part)} for settle in settles]
    )
    change = np.mean(
        [
            problem.least(r - best.r) - local.J @ (x - best.x)
            for x, r in zip(points, later, strict=True)
        ],
        axis=0,
    )
    moves = -(local.covariance / local.scatter) @ (local.J.T @ change) / part
    scale = [key.slope(v) / key.relative_to(v) for key, v in zip(problem.keys, values, strict=True)]
    return (Dependence(SETTLE_KEY, tuple((np.array(scale) * moves).tolist())),)


def _regression_note(problem: Problem, fit: Regression) -> str:
    sizes = [o.form == "amplitude" for _, o in problem.observed]
    own = np.sqrt(fit.variance[: problem.figures])[sizes] * problem.tight[sizes]
    what = "each noise draw gives other values" if _any_noise(problem) else (
        "the motion is sensitive: a parameter change of less than 0.1 % changes the simulated"
        " values"
    )  # fmt: skip
    if own.size:
        by = f", amplitudes by {100.0 * float(np.median(own)):.2g} % in the median"
    else:
        by = ""
    return f"Estimates are those of a regression, since {what}{by}; this scatter counts in all intervals."


def _regression(
    problem: Problem, centre: np.ndarray, size: np.ndarray, power: int, number: int
) -> Regression:
    """From 2 to the ``power`` points, up to ``size`` off the centre."""
    points = np.clip(
        centre + size * _sobol_points(centre.size, power, number), problem.low, problem.high
    )
    rows = np.array(_residuals_of_draws(problem, list(points), number + 1))
    rows = rows[0] + problem.least(
        rows - rows[0]
    )  # an angle half a turn off is no angle that scatters
    columns = np.column_stack([np.ones(len(points)), points - centre])
    found = np.linalg.lstsq(columns, rows, rcond=None)[0]
    freedom = len(points) - columns.shape[1]
    variance = np.sum((rows - columns @ found) ** 2, axis=0) / freedom
    return Regression(
        problem.least(found[0]), found[1:].T, variance, np.linalg.pinv(columns.T @ columns), freedom
    )


def _sobol_points(m: int, power: int, number: int) -> np.ndarray:
    """2 to the ``power`` points between -1 and 1, evenly spread, (points, m)."""
    from scipy.stats import qmc

    return np.asarray(2.0 * qmc.Sobol(m, seed=number).random_base2(power) - 1.0)


def _residuals_of_draws(
    problem: Problem,
    points: Sequence[np.ndarray],
    number: int,
    own: Sequence[dict[str, object]] = (),
) -> list[np.ndarray]:
    """Residuals at points, each with another draw of the noise where there is one, and with what
    each test has of its ``own``.
    """
    problem.best_so_far.more(len(points) * len(problem.tests))
    tests = list(
        zip((test for _, test in problem.tests), own or [{}] * len(problem.tests), strict=True)
    )
    draws = [1000 * number + k + 1 for k in range(len(points))]
    return problem.residuals(
        points,
        [
            [mine | ({SEED_KEY: k} if _has_noise(test) else {}) for test, mine in tests]
            for k in draws
        ],
    )


def _step(
    problem: Problem, fit: Regression, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The way to the best, variances of residuals there (rows,), and the normal matrix (m, m).

    The recording's own scatter is that of a draw; where noise makes it, its lines' floor has it
    already. Slopes by regression are uncertain themselves, which would count as evidence: that part
    is taken off.
    """
    noisy = np.array([_has_noise(problem.tests[k][1]) for k, _ in problem.observed])
    single = np.ones(fit.at.size)
    for i, (_, o) in enumerate(problem.observed):
        if noisy[i]:
            steps = problem.tests[problem.observed[i][0]][1].motor.alike_per_turn
            each = total_standard_deviation(o, problem.trust.each, TWO_DRAW_SCATTER, steps)
            single[i] = (each / problem.tight[i]) ** 2
    own = np.where(
        np.append(noisy, np.zeros(fit.at.size - noisy.size, bool)),
        np.maximum(single, fit.variance),
        1.0 + fit.variance,
    )
    move = np.zeros(size.size)
    for _ in range(3):
        lever = np.append(1.0, move)
        v = own + fit.variance * float(lever @ fit.spread @ lever)
        whole = (fit.J / v[:, None]).T @ fit.J
        normal = whole - float(np.sum(fit.variance / v)) * fit.spread[1:, 1:]
        if np.linalg.eigvalsh(normal)[0] > 0.0:
            used = normal
        else:
            used = whole
        move = -np.linalg.solve(used, fit.J.T @ (fit.at / v))
        move = move / max(1.0, float(np.max(np.abs(move) / (2.0 * size))))
    return move, v, normal
