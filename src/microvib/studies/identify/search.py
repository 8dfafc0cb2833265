"""The search for the best parameters: a global search, local fits, wider ranges where they are too
narrow, and a second search.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.studies.identify.coordinates import Coordinates
from microvib.studies.identify.goodness import REJECTION_PROBABILITY, goodness
from microvib.studies.identify.images import symmetric_solutions
from microvib.studies.identify.jumps import figures_jump
from microvib.studies.identify.keys import MAX_WIDENINGS
from microvib.studies.identify.problem import (
    HUBER_THRESHOLD,
    BestSoFar,
    Correction,
    Problem,
    cost,
)

FIRST_STEP = 1e-4
"""Step of differences in a coordinate before it is known what the evidence resolves."""
RELATIVE_STEP = 0.3
"""Step of differences over what the evidence resolves: a parameter's standard error, were the
others known.
"""
STEP_LIMITS = (1e-6, 1e-2)
"""Least and largest step of differences: numerical noise of lines is some 1e-6."""
DAMPING, DAMPING_FACTOR = 1e-3, 10.0
"""Damping of a local fit's first step, over the slopes' squares; by what it is divided after a step
that is kept, or multiplied.
"""
MIN_GAIN_RATIO = 0.5
"""Part of the promised gain that a step must bring to be called kept: its slopes then serve for the
next, corrected by a secant.
"""
NEAR_BOUND = 1e-6
"""Part of its reach that a local fit keeps from an end."""
MAX_STEP_LENGTH = 1.0
"""Longest step in a coordinate: a factor of e."""
COST_TOLERANCE, COARSE_COST_TOLERANCE = 1e-5, 1e-3
"""Relative change of the cost below which a local fit is at its end; in a search, and at a point of
a profile.
"""
RESTART_STEPS, MAX_DESCENT_STEPS = 12, 60
"""Steps of a local fit: from beside an optimum, and to the end."""
FITS_PER_BATCH, MAX_FITS = 2, 8
"""Local fits before it is asked whether the evidence is explained, whatever the number of cores;
and at most, of a round.
"""
PROGRESS_INTERVAL = 32
"""Points of the global search between two reports of progress."""
MIN_JACOBIAN_GAIN = 0.1
"""Part of a material gain below which slopes are not taken anew."""
SEARCH_REDUCTION = 4
"""By how much the global search is smaller before a mode's frequency is fitted as well."""
SAME_OPTIMUM_DISTANCE = 0.01
"""Difference in a coordinate below which ends of fits to short records are the same."""
MAX_MISFIT_RATIO = 10.0
"""Chi-square over the limit of a correct model's, in a short record, that no whole record makes up
for.
"""
SCALED_POINTS, SCALED_FITS, SCALED_KEYS = 16, 2, 4
"""Points of a round of the search for the least misfit for each key, and fits from the best of
them, of so many keys at most.
"""
SCALED_NEAR = 0.75
"""Part of those points that lie in the ranges it began with."""
NEAR_START = 0.125
"""Part of their way from the start to which half of the points of another look at steady states are
drawn: values of a scenario are seldom far off, and beyond an edge of a motion no fit finds back.
"""
ABOUT = (0.1, 0.03, 0.01, 0.003)
"""Distances in each coordinate at which a round begins again about the best."""
SCALED_ROUNDS, SCALED_GAIN = 4, 0.02
"""Most rounds of it, and the part that another round must gain; two are made in any case."""
ALIKE = 0.1
"""Difference of slopes, over what moves figures by a standard deviation, below which steady states
stand for runs.
"""
MAX_RESTARTS = 4
"""Most second searches."""


@dataclass(frozen=True)
class Optimum:
    """Where a local fit ended."""

    x: np.ndarray
    r: np.ndarray
    cost: float
    J: np.ndarray | None = None
    """Slopes of the residuals (rows, free), where differences were taken there."""


class Descent:
    """Damped least squares: slopes by differences at first, then by secants for as long as steps
    keep what they promise.

    Slopes ``J`` (rows, free) that are given, those of an optimum near by, are trusted in the same
    way. Huber's cost is made small by weights that follow the residuals.
    """

    def __init__(
        self,
        problem: Problem,
        x: np.ndarray,
        free: np.ndarray | None = None,
        central: bool = False,
        J: np.ndarray | None = None,
    ) -> None:
        self.problem, self.central, self.given = problem, central, J
        self.free = np.flatnonzero(np.ones(x.size, dtype=bool) if free is None else free)
        low, high = problem.low[self.free], problem.high[self.free]
        self.low, self.high = low + NEAR_BOUND * (high - low), high - NEAR_BOUND * (high - low)
        self.x0 = x.copy()
        self.x0[self.free] = np.clip(x[self.free], self.low, self.high)
        self.steps = np.full(x.size, FIRST_STEP)

    def run(self, steps: int, close: float = COST_TOLERANCE) -> Optimum:
        """The end of at most ``steps`` steps, or where the next would change the cost by less than
        the part ``close``.
        """
        here, damping, J = self._at(self.x0), DAMPING, self.given
        new = False  # whether the slopes are those of differences here
        for _ in range(steps):
            if J is None:
                J, new = self._slopes(here), True
            move = self._move(here, J, damping)
            promised = here.cost - cost(here.r + J @ move)
            if promised <= close * max(here.cost, 1.0):
                if new or self.given is not None:
                    break
                J = None
                continue
            there = self._at(self._moved(here.x, move))
            gained = here.cost - there.cost
            if gained > MIN_GAIN_RATIO * promised:
                J = J + np.outer(
                    self.problem.least(there.r - here.r) - J @ move, move / (move @ move)
                )
                damping, new = damping / DAMPING_FACTOR, False
            elif new:
                if gained <= 0.0 and promised <= COARSE_COST_TOLERANCE * max(here.cost, 1.0):
                    break  # the figures' own noise
                damping *= DAMPING_FACTOR
            if gained <= MIN_GAIN_RATIO * promised and (gained > 0.0 or not new):
                J = None
            here = there if gained > 0.0 else here
        return replace(here, J=J if new else None)

    def _at(self, x: np.ndarray) -> Optimum:
        r = self.problem.residuals([x])[0]
        return Optimum(x, r, cost(r))

    def _moved(self, x: np.ndarray, move: np.ndarray) -> np.ndarray:
        x = x.copy()
        x[self.free] = np.clip(x[self.free] + move, self.low, self.high)
        return x

    def _move(self, here: Optimum, J: np.ndarray, damping: float) -> np.ndarray:
        """The step to the least weighted cost that the slopes promise, within the reach, damped by
        the slopes' own size.
        """
        from scipy.optimize import lsq_linear

        weights = np.sqrt(np.minimum(1.0, HUBER_THRESHOLD / np.maximum(np.abs(here.r), 1e-300)))
        A = weights[:, None] * J
        size = np.maximum(np.sqrt(np.sum(A**2, axis=0)), 1e-12)
        rows = np.vstack([A, np.diag(math.sqrt(damping) * size)])
        wanted = np.concatenate([-weights * here.r, np.zeros(size.size)])
        x = here.x[self.free]
        room = (
            np.maximum(self.low - x, -MAX_STEP_LENGTH),
            np.minimum(self.high - x, MAX_STEP_LENGTH),
        )
        return (
            np.asarray(
                lsq_linear(rows / size, wanted, (room[0] * size, room[1] * size), method="bvls").x
            )
            / size
        )

    def _slopes(self, here: Optimum) -> np.ndarray:
        self.problem = self.problem.beginning_at(here.x)
        J = jacobian(self.problem, here.x, here.r, self.steps, self.free, self.central)
        self.steps[self.free] = _difference_steps(J)
        return J


def _difference_steps(J: np.ndarray) -> np.ndarray:
    """Steps of differences that the evidence resolves, by its slopes (rows, m)."""
    return np.clip(RELATIVE_STEP / np.maximum(np.sqrt(np.sum(J**2, axis=0)), 1e-300), *STEP_LIMITS)


def jacobian(
    problem: Problem,
    x: np.ndarray,
    r: np.ndarray,
    steps: np.ndarray,
    free: np.ndarray,
    central: bool,
) -> np.ndarray:
    """Differences (rows, free) of the residuals, ``r`` (rows,) at ``x``, by the ``free``
    coordinates, within the reach.
    """
    points = []
    for k in free:
        if x[k] + steps[k] <= problem.high[k]:
            up = 1.0
        else:
            up = -1.0
        if central and problem.low[k] <= x[k] - up * steps[k] <= problem.high[k]:
            down = -up
        else:
            down = 0.0
        points += [x + side * steps[k] * np.eye(x.size)[k] for side in (up, down)]
    ends = [p for p in points if np.any(p != x)]
    at = {p.tobytes(): found for p, found in zip(ends, problem.residuals(ends), strict=True)} | {
        x.tobytes(): r
    }
    pairs = zip(points[::2], points[1::2], free, strict=True)
    return np.column_stack(
        [problem.least(at[a.tobytes()] - at[b.tobytes()]) / (a[k] - b[k]) for a, b, k in pairs]
    )


def descend_all(
    problem: Problem, starts: Sequence[np.ndarray], steps: int = MAX_DESCENT_STEPS
) -> list[Optimum]:
    """Local fits from several starts, as many at a time as there are cores."""
    return problem.in_threads(
        lambda x: Descent(problem, x).run(steps, COARSE_COST_TOLERANCE), starts
    )


def search(
    problem: Problem, seed: int, starts: int, finishes: int
) -> tuple[Problem, list[Optimum]]:
    """Ends of local fits, the best first, and the problem as it was widened on the way.

    Local fits start from the best of a Sobol sequence over the ranges, at least ``finishes`` of
    them, among steady states if there are any, or else in short records as far as these tell the lines
    apart, and end in whole ones: nothing is judged by either alone. Where none explains the evidence, a measured array mode's
    frequency is fitted as well, from there and from as many others; then ranges of ours are widened
    both ways, as long as that helps.
    """
    problem, optima = _search(problem.with_cartesian(), seed, starts, finishes)
    return _by_keys(problem, optima)


def _by_keys(problem: Problem, optima: Sequence[Optimum]) -> tuple[Problem, list[Optimum]]:
    """The problem and its optima with a coordinate for each key, where amplitudes and phases were
    moved by their Cartesian parts.
    """
    own = problem.with_cartesian(False)
    if own is not problem:
        points = [own.point(problem.named(o.x)) for o in optima]
        each = zip(points, own.residuals(points), strict=True)
        optima = [Optimum(x, r, cost(r)) for x, r in each]
    return own, list(optima)


def _search(
    problem: Problem, seed: int, starts: int, finishes: int
) -> tuple[Problem, list[Optimum]]:
    """The search, in the problem's coordinates."""
    optima: list[Optimum] = []
    also = [problem.start]
    found = _search_steady_states(problem, seed, starts, finishes)
    for _ in range(MAX_WIDENINGS + 2):
        before = optima[0].cost if optima else math.inf
        if not any(goodness(problem, o.r).explained for o in found):
            found = _search_round(problem, seed, starts, finishes, also)
        optima = sorted([*optima, *found], key=lambda o: o.cost)
        more = descend_all(
            problem, symmetric_solutions(problem, optima[0].x)
        )  # one fit rarely gets to other signs
        optima = sorted([*optima, *more], key=lambda o: o.cost)
        best = optima[0]
        if goodness(problem, best.r).explained:
            break
        wider = problem.along() or (problem.widened() if best.cost < 0.9 * before else None)
        if wider is None:
            break
        also = []
        if len(wider.keys) > len(problem.keys):
            optima, also = [], [np.append(o.x, wider.start[-1]) for o in optima] + [wider.start]
        problem = wider
    problem, optima = _drop_extra_frequency(problem, optima)
    return problem.within(optima[0].x), optima


def _drop_extra_frequency(problem: Problem, optima: list[Optimum]) -> tuple[Problem, list[Optimum]]:
    """Without a frequency that is fitted along, where its start explains the evidence after all,
    which a search may miss.
    """
    own = np.array([not key.along for key in problem.keys])
    if np.all(own) or not goodness(problem, optima[0].r).explained:
        return problem, optima
    asked = problem.again([key for key in problem.keys if not key.along])
    ends = sorted(
        descend_all(asked, [o.x[own] for o in optima[:FITS_PER_BATCH]]), key=lambda o: o.cost
    )
    if goodness(asked, ends[0].r).explained:
        return (asked, ends)
    return (problem, optima)


def _search_round(
    problem: Problem, seed: int, starts: int, finishes: int, also: Sequence[np.ndarray]
) -> list[Optimum]:
    """Local fits from the best points of a global look, in the order of their cost, until the
    evidence is explained; both begin with short records.
    """
    count, most = _round_size(problem, starts, finishes)
    points = [*_sobol_points(problem, seed, count), *(problem.tuned(x) for x in also)]
    rough = problem.rough()
    return _fits_from_best(problem, rough, points, finishes, most)


def _round_size(problem: Problem, starts: int, finishes: int) -> tuple[int, int]:
    """Points of a global look, and most local fits from them.

    Before a mode's frequency is fitted as well there are a few only: where that is what is missing,
    more show nothing.
    """
    if problem.along() is not None:
        return math.ceil(starts / SEARCH_REDUCTION), min(finishes, FITS_PER_BATCH)
    return starts, max(finishes, MAX_FITS)


def _search_steady_states(problem: Problem, seed: int, starts: int, finishes: int) -> list[Optimum]:
    """Local fits of runs from the ends of fits among steady states, of which each takes a fraction of a
    run; none where there are no steady states.

    Where runs jump about the best of them, a look at runs may find a better one where they do not.
    """
    steady = problem.steady()
    if steady is None:
        return []
    ends = _fits_among_steady_states(steady, seed, starts, finishes)
    first, *others = _distinct_optima(sorted(ends, key=lambda o: o.cost), [])
    slopes = _slopes_of(steady, first)
    (best,) = _refit_whole_records(problem, steady, [replace(first, J=slopes)])
    explained = goodness(problem, best.r).explained
    if explained and figures_jump(problem, best.x, best.r, slopes):
        by_runs = _search_round(problem, seed, starts, finishes, [problem.start])
        if any(goodness(problem, o.r).explained for o in by_runs):
            return by_runs
    return [best, *_refit_whole_records(problem, steady, others)]


def _fits_among_steady_states(
    steady: Problem, seed: int, starts: int, finishes: int
) -> list[Optimum]:
    """Local fits from the best points of a global look, as of runs; where a few explain nothing there are as
    many as with a mode's frequency, from points of which half are near the start.
    """
    count, most = _round_size(steady, starts, finishes)
    points = _sobol_points(steady, seed, starts)
    found = _fits_from_best(
        steady, steady, [*points[:count], steady.tuned(steady.start)], finishes, most
    )
    if any(goodness(steady, o.r).explained for o in found):
        return found
    more = points[count:]
    more[::2] = [steady.start + NEAR_START * (x - steady.start) for x in more[::2]]
    return found + _fits_from_best(steady, steady, more, 1, max(finishes, MAX_FITS))


def _sobol_points(problem: Problem, seed: int, count: int) -> list[np.ndarray]:
    """Points over the ranges, the first ``count`` of a Sobol sequence."""
    from scipy.stats import qmc

    power = max(math.ceil(math.log2(count)), 1)
    parts = qmc.Sobol(len(problem.keys), seed=seed).random_base2(power)[:count]
    return [problem.tuned(x) for x in problem.coordinates.spread(parts)]


def _fits_from_best(
    problem: Problem, rough: Problem, points: Sequence[np.ndarray], finishes: int, most: int
) -> list[Optimum]:
    """Local fits from the best of the ``points`` in the ``rough`` problem, ``finishes`` at least and
    ``most`` at most, until one explains the evidence in the whole one.
    """
    problem.best_so_far.stage = "global"
    some = [points[k : k + PROGRESS_INTERVAL] for k in range(0, len(points), PROGRESS_INTERVAL)]
    costs = [cost(r) for part in some for r in rough.residuals(part)]
    best = [points[k] for k in np.argsort(costs, kind="stable")[:most]]
    problem.best_so_far.stage = "local"
    optima: list[Optimum] = []
    ends: list[Optimum] = []
    while best and not (
        len(ends) >= finishes and any(goodness(problem, o.r).explained for o in optima)
    ):
        met = descend_all(rough, best[:FITS_PER_BATCH])
        if rough is problem:
            optima += met
        else:
            optima += _refit_whole_records(problem, rough, _distinct_optima(met, ends))
        ends, best = ends + met, best[FITS_PER_BATCH:]
    return optima


def least_misfit(
    problem: Problem, optima: Sequence[Optimum], seed: int
) -> tuple[Problem, list[Optimum]]:
    """Ends of local fits where no fit explains the evidence, the least chi-square first, at the
    scale of what is left.

    With the problem, which has lost a frequency that is fitted along where its start leaves hardly
    more.

    Against errors that are stated too small nearly every figure is far off, and counts in
    proportion only: a search then ends at any of many corners. With all standard deviations as much
    larger as the best so far asks for, the same squares are smooth. Where a motion is sensitive
    there are many corners still: each round begins anew, from points that no round had before, and
    follows to their ends those fits that were the best of the one before, from points about them,
    too.
    """
    given, problem = problem, problem.with_cartesian()
    if problem is not given:
        points = [problem.point(given.named(o.x)) for o in optima]
        optima = [Optimum(x, o.r, o.cost) for x, o in zip(points, optima, strict=True)]
    return _by_keys(*_least_misfit(problem, optima, seed))


def _least_misfit(
    problem: Problem, optima: Sequence[Optimum], seed: int
) -> tuple[Problem, list[Optimum]]:
    """The search for the least misfit, in the problem's coordinates."""
    problem.best_so_far.stage = "least misfit"
    found = sorted(optima, key=lambda o: _chi_square(problem, o.r))[:FITS_PER_BATCH]
    looks = _looks(problem, seed)
    for number in range(SCALED_ROUNDS):
        before = _chi_square(problem, found[0].r)
        scaled = _with_scaled_errors(problem, found[0].r)
        known = (
            [o.x for o in found[:FITS_PER_BATCH]]
            + symmetric_solutions(problem, found[0].x)
            + _about(scaled, found[0].x, seed + number)
        )
        ends = [
            o.x
            for o in (
                *descend_all(scaled, known),
                *descend_all(scaled, _promising(scaled, next(looks)), RESTART_STEPS),
            )
        ]
        problem.best_so_far.more(scaled.best_so_far.simulations)
        met = [Optimum(x, r, cost(r)) for x, r in zip(ends, problem.residuals(ends), strict=True)]
        found = sorted([*found, *met], key=lambda o: _chi_square(problem, o.r))
        least = _chi_square(problem, found[0].r)
        if goodness(problem, found[0].r).explained or (
            number and least > (1.0 - SCALED_GAIN) * before
        ):
            break
    return _drop_insignificant_frequencies(problem, found)


def _looks(problem: Problem, seed: int) -> Iterator[list[np.ndarray]]:
    """Points over the ranges that it began with, and some over those that it was widened to; others
    each time.
    """
    from scipy.stats import qmc

    m = len(problem.keys)
    first = Coordinates(tuple(key.as_begun() for key in problem.keys), problem.coordinates.pairs)
    sampler = qmc.Sobol(m, seed=seed)
    while True:
        count = _power(SCALED_POINTS * min(m, SCALED_KEYS))
        near, far = np.split(sampler.random(count), [int(SCALED_NEAR * count)])
        points = [*first.spread(near), *problem.coordinates.spread(far)]
        yield [problem.tuned(x) for x in points]


def _power(count: int) -> int:
    """The next power of two, of which such points are even."""
    return 1 << (count - 1).bit_length()


def _about(scaled: Problem, x: np.ndarray, seed: int) -> list[np.ndarray]:
    """The best of points about another, near and less near: where figures jump, a fit ends wherever
    it is.
    """
    from scipy.stats import qmc

    sides = 2.0 * qmc.Sobol(x.size, seed=seed).random(_power(2 * len(ABOUT) * x.size)) - 1.0
    sizes = np.resize(ABOUT, len(sides))
    points = list(np.clip(x + sizes[:, None] * sides, scaled.low, scaled.high))
    costs = [cost(r) for r in scaled.residuals(points)]
    return [points[k] for k in np.argsort(costs, kind="stable")[:FITS_PER_BATCH]]


def _promising(scaled: Problem, points: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The best of the points, by the cost and, in turn, by how many figures are right, whatever the
    others are.
    """
    rows = scaled.residuals(points)
    by_cost = np.argsort([cost(r) for r in rows], kind="stable")
    by_number = np.argsort([float(np.sum(np.log1p(r**2))) for r in rows], kind="stable")
    best = dict.fromkeys(int(k) for pair in zip(by_cost, by_number, strict=True) for k in pair)
    return [points[k] for k in list(best)[: SCALED_FITS * min(len(scaled.keys), SCALED_KEYS)]]


def _drop_insignificant_frequencies(
    problem: Problem, optima: list[Optimum]
) -> tuple[Problem, list[Optimum]]:
    """Without the frequencies that are fitted along, where their starts leave no more than chance
    would over what is left.
    """
    from scipy.stats import chi2

    own = np.array([not key.along for key in problem.keys])
    if np.all(own):
        return problem, optima
    asked = problem.again([key for key in problem.keys if not key.along])
    starts = [o.x[own] for o in optima[:FITS_PER_BATCH]]
    starts += symmetric_solutions(asked, starts[0])
    rest = goodness(problem, optima[0].r)
    scaled = asked.looser(np.full(asked.figures, math.sqrt(max(rest.ratio, 1.0))))
    ends = [o.x for o in descend_all(scaled, starts)]
    found = [Optimum(x, r, cost(r)) for x, r in zip(ends, asked.residuals(ends), strict=True)]
    found.sort(key=lambda o: _chi_square(asked, o.r))
    chance = float(chi2.isf(REJECTION_PROBABILITY, int(np.sum(~own)))) * max(rest.ratio, 1.0)
    as_good = _chi_square(asked, found[0].r) <= rest.chi_square + chance
    if as_good or goodness(asked, found[0].r).explained:
        return (asked, found)
    return (problem, optima)


def _with_scaled_errors(problem: Problem, r: np.ndarray) -> Problem:
    """The problem with standard deviations that leave one for each figure of residuals ``r``; with
    a best_so_far of its own.
    """
    factor = math.sqrt(max(goodness(problem, r).ratio, 1.0))
    scaled = problem.looser(np.full(problem.figures, factor))
    scaled.best_so_far = BestSoFar(lambda *_: None)
    return scaled


def _chi_square(problem: Problem, r: np.ndarray) -> float:
    return goodness(problem, r).chi_square


def eased(problem: Problem, best: Optimum) -> tuple[Problem, Optimum]:
    """The problem, and its best, at the scale of what the best leaves, where that is more than was
    stated.
    """
    scaled = _with_scaled_errors(problem, best.r)
    (r,) = scaled.residuals([best.x])
    return scaled, Optimum(best.x, r, cost(r))


def confirm_scaled(problem: Problem, best: Optimum) -> tuple[Optimum, LinearModel, bool]:
    """``confirm`` at the scale of what the best leaves, where that is more than was stated; figures
    at the stated one.
    """
    scaled, there = eased(problem, best)
    end, _, converged = confirm(scaled, there, linearise_at(scaled, there))
    problem.best_so_far.more(scaled.best_so_far.simulations)
    (r,) = problem.residuals([end.x])
    best = Optimum(end.x, r, cost(r))
    return best, linearise_at(problem, best), converged


def _distinct_optima(met: Sequence[Optimum], known: Sequence[Optimum]) -> list[Optimum]:
    """Optima that differ from known ones and from each other."""
    found: list[Optimum] = []
    for o in met:
        if all(np.max(np.abs(o.x - p.x)) > SAME_OPTIMUM_DISTANCE for p in (*known, *found)):
            found.append(o)
    return found


def _refit_whole_records(
    problem: Problem, rough: Problem, ends: Sequence[Optimum]
) -> list[Optimum]:
    """Local fits of whole records from the ends of those of short ones; where these are hopeless,
    what they are there.
    """

    def fitted(end: Optimum) -> Optimum:
        fit = goodness(rough, end.r)
        if fit.ratio > MAX_MISFIT_RATIO * fit.limit:
            return Descent(problem, end.x).run(0)
        slopes = _slopes_of(rough, end)
        return Descent(problem, end.x, J=slopes).run(MAX_DESCENT_STEPS, COARSE_COST_TOLERANCE)

    return problem.in_threads(fitted, ends)


def _slopes_of(problem: Problem, end: Optimum) -> np.ndarray:
    """Slopes (rows, m) at the end of a local fit: its own, or new ones where it has none."""
    if end.J is not None:
        return end.J
    return _slopes_at(problem.beginning_at(end.x), end)[1]


def confirm(
    problem: Problem, best: Optimum, local: LinearModel
) -> tuple[Optimum, LinearModel, bool]:
    """Search again at the optimum, where the model is ``local``: finer, with central differences,
    from there and from around it.

    If that finds something better, the search is repeated there; the last value tells whether the
    last search found nothing.
    """
    problem.best_so_far.stage = "second look"
    for look in range(MAX_RESTARTS):
        if look:
            local = linearise_at(problem, best)
        ends = _ends_nearby(problem, best, local)
        better = min(ends, key=lambda o: o.cost)
        gain, best = best.cost - better.cost, min(best, better, key=lambda o: o.cost)
        if gain < significant_gain(best.cost):
            return (
                best,
                local
                if gain < MIN_JACOBIAN_GAIN * significant_gain(best.cost)
                else linearise_at(problem, best),
                True,
            )
    return best, linearise_at(problem, best), False


def _ends_nearby(problem: Problem, best: Optimum, local: LinearModel) -> list[Optimum]:
    """Ends of local fits from an optimum and from either side of it, as runs have them."""
    near, sides = local.near(problem), _along_weakest_direction(problem, best.x, local)
    beside = COST_TOLERANCE if near is problem else COARSE_COST_TOLERANCE

    def restarted(start: tuple[np.ndarray, float]) -> Optimum:
        x, close = start
        end = Descent(near, x, central=True, J=local.J).run(RESTART_STEPS, close)
        return as_run(problem, near, end)

    starts = [(best.x, COST_TOLERANCE), *((x, beside) for x in sides)]
    return problem.in_threads(restarted, starts)


def as_run(problem: Problem, near: Problem, found: Optimum) -> Optimum:
    """An optimum of the problem ``near`` by another, as runs have it."""
    if near is problem:
        return found
    (r,) = problem.residuals([found.x])
    return Optimum(found.x, r, cost(r))


def significant_gain(c: float) -> float:
    """By how much a cost must be lower to count as another."""
    return max(0.1, 1e-3 * c)


@dataclass(frozen=True)
class LinearModel:
    """The model about an optimum, linearised."""

    J: np.ndarray
    """Slopes of the residuals by the coordinates, (rows, m)."""
    covariance: np.ndarray
    """Covariance of the coordinates, (m, m), widened by the scatter that the fit leaves."""
    scatter: float
    """Chi-square per degree of freedom, at least 1."""
    steady: Problem | None = None
    """The problem with steady states in place of runs, corrected to what runs are there, where both
    have about the same slopes; None elsewhere.
    """

    def near(self, problem: Problem) -> Problem:
        """The problem for what is near: with steady states in place of runs, if these are alike."""
        return self.steady or problem

    @property
    def spread(self) -> np.ndarray:
        """Standard errors of the coordinates, (m,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))


def linearise_at(problem: Problem, best: Optimum) -> LinearModel:
    """The model about an optimum, by central differences of runs; with steady states that stand for
    them, where these have about the same slopes.
    """
    every, steady = np.arange(best.x.size), problem.in_steady_state(best.x)
    if steady is None:
        steps, _ = _slopes_at(problem, best)
        return _linear_model(problem, best, jacobian(problem, best.x, best.r, steps, every, True))
    (r,) = steady.residuals([best.x])
    steps, _ = _slopes_at(steady, Optimum(best.x, r, cost(r)))
    J = jacobian(problem, best.x, best.r, steps, every, True)
    own = jacobian(steady, best.x, r, steps, every, True)
    if not _are_alike(J, own):
        return _linear_model(problem, best, J)
    correction = Correction(best.x, problem.least(best.r - r), J - own)
    return _linear_model(problem, best, J, steady.corrected(correction))


def _linear_model(
    problem: Problem, best: Optimum, J: np.ndarray, steady: Problem | None = None
) -> LinearModel:
    scatter = max(goodness(problem, best.r).ratio, 1.0)
    return LinearModel(J, np.linalg.pinv(J.T @ J, rcond=1e-14) * scatter, scatter, steady)


def _slopes_at(problem: Problem, here: Optimum) -> tuple[np.ndarray, np.ndarray]:
    """Steps of differences that the evidence resolves, (m,), from one-sided differences, (rows, m)."""
    every, steps = np.arange(here.x.size), np.full(here.x.size, FIRST_STEP)
    J = jacobian(problem, here.x, here.r, steps, every, False)
    return _difference_steps(J), J


def _are_alike(J: np.ndarray, other: np.ndarray) -> bool:
    """Whether slopes (rows, m) are those of runs ``J``: over a standard error of each parameter, the
    others known, figures go the same way to ALIKE.
    """
    size = np.maximum(np.sqrt(np.sum(J**2, axis=0)), 1e-300)
    return bool(np.max(np.sqrt(np.sum((other - J) ** 2, axis=0)) / size) < ALIKE)


def _along_weakest_direction(
    problem: Problem, x: np.ndarray, local: LinearModel
) -> list[np.ndarray]:
    """Four standard errors to either side along the direction that the evidence tells least of."""
    values, vectors = np.linalg.eigh(local.covariance)
    move = min(4.0 * math.sqrt(max(float(values[-1]), 0.0)), 0.5) * vectors[:, -1]
    return [np.clip(x + sign * move, problem.low, problem.high) for sign in (1.0, -1.0)]
