"""The search for the best parameters: a global search, local fits, wider ranges where they are too narrow, and a second search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.studies.identify.keys import WIDENINGS
from microvib.studies.identify.problem import ROBUST, Problem, cost, goodness

FIRST_STEP = 1e-4
"""Step of differences in a coordinate before it is known what the evidence resolves."""
STEP = 0.3
"""Step of differences over what the evidence resolves: a parameter's standard error, were the others known."""
STEPS = (1e-6, 1e-2)
"""Least and largest step of differences: numerical noise of lines is some 1e-6."""
CLOSE = 1e-5
"""Relative change of the cost below which a local fit is at its end."""
AGAIN, FULL = 12, 60
"""Steps of a local fit: from beside an optimum, and to the end."""
AT_ONCE, MAX_FITS = 2, 8
"""Local fits before it is asked whether the evidence is explained, whatever the number of cores; and at most, of a round."""
PART = 32
"""Points of the global search between two reports of progress."""
LOOKS = 4
"""Most second searches."""


@dataclass(frozen=True)
class Optimum:
    """Where a local fit ended."""

    x: np.ndarray
    r: np.ndarray
    cost: float


class Descent:
    """Trust-region least squares with differences whose steps follow what the evidence resolves."""

    def __init__(self, problem: Problem, x: np.ndarray, free: np.ndarray | None = None, central: bool = False) -> None:
        self.problem, self.x0, self.central = problem, x, central
        self.free = np.flatnonzero(np.ones(x.size, dtype=bool) if free is None else free)
        self.steps = np.full(x.size, FIRST_STEP)
        self.seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def run(self, steps: int, close: float = CLOSE) -> Optimum:
        """The end of at most ``steps`` steps, or where the next would change the cost by less than the part ``close``."""
        from scipy.optimize import least_squares

        low, high = self.problem.low[self.free], self.problem.high[self.free]
        rim = 1e-6 * (high - low)
        least_squares(
            lambda v: self._look(v)[0], np.clip(self.x0[self.free], low + rim, high - rim),
            jac=lambda v: self._look(v)[1], bounds=(low, high), x_scale="jac", loss="huber", f_scale=ROBUST,
            xtol=1e-9, ftol=close, gtol=None, max_nfev=steps,
        )  # fmt: skip
        v, (r, _) = min(self.seen.items(), key=lambda item: cost(item[1][0]))
        return Optimum(self._whole(np.frombuffer(v)), r, cost(r))

    def _whole(self, v: np.ndarray) -> np.ndarray:
        x = self.x0.copy()
        x[self.free] = v
        return x

    def _look(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their slopes, both at once: simulated in parallel they cost little more than the residuals alone."""
        known = self.seen.get(v.tobytes())
        if known is None:
            known = self.seen[v.tobytes()] = slopes(self.problem, self._whole(v), self.steps, self.free, self.central)
            self.steps[self.free] = _resolved(known[1])
        return known


def _resolved(J: np.ndarray) -> np.ndarray:
    """Steps of differences that the evidence resolves, by its slopes (rows, m)."""
    return np.clip(STEP / np.maximum(np.sqrt(np.sum(J**2, axis=0)), 1e-300), *STEPS)


def slopes(
    problem: Problem, x: np.ndarray, steps: np.ndarray, free: np.ndarray, central: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals at ``x`` (rows,) and their differences by the ``free`` coordinates (rows, free), within the reach."""
    points = [x]
    for k in free:
        up = 1.0 if x[k] + steps[k] <= problem.high[k] else -1.0
        down = -up if central and problem.low[k] <= x[k] - up * steps[k] <= problem.high[k] else 0.0
        points += [x + side * steps[k] * np.eye(x.size)[k] for side in (up, down)]
    ends = [p for p in points[1:] if np.any(p != x)]
    found = problem.residuals([x, *ends])
    at = {p.tobytes(): r for p, r in zip([x, *ends], found, strict=True)}
    pairs = zip(points[1::2], points[2::2], free, strict=True)
    columns = [(at[a.tobytes()] - at[b.tobytes()]) / (a[k] - b[k]) for a, b, k in pairs]
    return found[0], np.column_stack(columns)


def descend_all(problem: Problem, starts: Sequence[np.ndarray], steps: int, central: bool = False) -> list[Optimum]:
    """Local fits from several starts, as many at a time as there are cores."""
    return problem.in_threads(lambda x: Descent(problem, x, central=central).run(steps), starts)


def search(problem: Problem, seed: int, starts: int, finishes: int) -> tuple[Problem, list[Optimum]]:
    """Ends of local fits, the best first, and the problem as it was widened on the way.

    Local fits start from the best of a Sobol sequence over the ranges, at least ``finishes`` of them. Where none explains the
    evidence, a measured array mode's frequency is fitted as well, from there and from as many others; then ranges of ours are
    widened both ways, as long as that helps.
    """
    optima: list[Optimum] = []
    also = [problem.start]
    for _ in range(WIDENINGS + 2):
        before = optima[0].cost if optima else math.inf
        optima = sorted([*optima, *_round(problem, seed, starts, finishes, also)], key=lambda o: o.cost)
        best = optima[0]
        if goodness(problem, best.r).explained:
            return _turned(problem, optima)
        wider = problem.along() or (problem.widened() if best.cost < 0.9 * before else None)
        if wider is None:
            break
        also = []
        if len(wider.keys) > len(problem.keys):
            optima, also = [], [np.append(o.x, wider.start[-1]) for o in optima] + [wider.start]
        problem = wider
    return problem.within(optima[0].x), optima


def _turned(problem: Problem, optima: list[Optimum]) -> tuple[Problem, list[Optimum]]:
    """The optima, and those that the driver's errors have in other quarters of the electrical turn: one fit rarely gets there."""
    more = descend_all(problem, problem.turned(optima[0].x), FULL)
    optima = sorted([*optima, *more], key=lambda o: o.cost)
    return problem.within(optima[0].x), optima


def _round(problem: Problem, seed: int, starts: int, finishes: int, also: Sequence[np.ndarray]) -> list[Optimum]:
    """Local fits from the best points of a global look, in the order of their cost, until the evidence is explained.

    Before a mode's frequency is fitted as well there are a few only: where that is what is missing, more show nothing.
    """
    from scipy.stats import qmc

    problem.ledger.stage = "global"
    low, high = np.array([key.range for key in problem.keys]).T
    unit = qmc.Sobol(low.size, seed=seed).random_base2(max(math.ceil(math.log2(starts)), 1))
    points = [problem.tuned(x) for x in (*(low + (high - low) * unit), *also)]
    parts = [points[k : k + PART] for k in range(0, len(points), PART)]
    costs = [cost(r) for part in parts for r in problem.residuals(part)]
    most = min(finishes, AT_ONCE) if problem.along() else max(finishes, MAX_FITS)
    best = [points[k] for k in np.argsort(costs, kind="stable")[:most]]
    problem.ledger.stage = "local"
    optima: list[Optimum] = []
    while best and not (len(optima) >= finishes and any(goodness(problem, o.r).explained for o in optima)):
        optima += descend_all(problem, best[:AT_ONCE], FULL)
        best = best[AT_ONCE:]
    return optima


def confirm(problem: Problem, best: Optimum) -> tuple[Optimum, Local, bool]:
    """Search again at the optimum: finer, with central differences, from the optimum itself and from points around it.

    If that finds something better, the search is repeated there; the last value tells whether the last search found nothing.
    """
    problem.ledger.stage = "second look"
    for _ in range(LOOKS):
        local = local_at(problem, best)
        ends = descend_all(problem, [best.x, *_beside(problem, best.x, local)], AGAIN, central=True)
        better = min(ends, key=lambda o: o.cost)
        gain, best = best.cost - better.cost, min(best, better, key=lambda o: o.cost)
        if gain < material(best.cost):
            return best, local_at(problem, best), True
    return best, local_at(problem, best), False


def material(c: float) -> float:
    """By how much a cost must be lower to count as another."""
    return max(0.1, 1e-3 * c)


@dataclass(frozen=True)
class Local:
    """The model about an optimum, linearised."""

    J: np.ndarray
    """Slopes of the residuals by the coordinates, (rows, m)."""
    covariance: np.ndarray
    """Of the coordinates, (m, m), widened by the scatter that the fit leaves."""
    scatter: float
    """Chi-square per degree of freedom, at least 1."""

    @property
    def spread(self) -> np.ndarray:
        """Standard errors of the coordinates, (m,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))


def local_at(problem: Problem, best: Optimum) -> Local:
    """Central differences at an optimum, with steps that follow what the evidence resolves."""
    every, steps = np.arange(best.x.size), np.full(best.x.size, FIRST_STEP)
    for central in (False, True):
        _, J = slopes(problem, best.x, steps, every, central)
        steps = _resolved(J)
    scatter = max(goodness(problem, best.r).ratio, 1.0)
    return Local(J, np.linalg.pinv(J.T @ J, rcond=1e-14) * scatter, scatter)


def _beside(problem: Problem, x: np.ndarray, local: Local) -> list[np.ndarray]:
    """Four standard errors to either side along the direction that the evidence tells least of."""
    values, vectors = np.linalg.eigh(local.covariance)
    move = min(4.0 * math.sqrt(max(float(values[-1]), 0.0)), 0.5) * vectors[:, -1]
    return [np.clip(x + sign * move, problem.low, problem.high) for sign in (1.0, -1.0)]
