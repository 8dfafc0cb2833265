"""Search for the setting of levers whose worst drawn case is quietest."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from microvib.errors import ScenarioError
from microvib.model.scenario import Scenario
from microvib.studies.quiet.evaluate import Case, Evaluations, drawn
from microvib.studies.quiet.levers import Lever, Setting, with_levers
from microvib.studies.quiet.starts import Start

Allowed = Callable[[Scenario], str]
"""Says why a drive is not allowed; empty where it is."""
MAX_COMBINATIONS = 64
"""Combinations of choices that are tried."""
AT_ONCE = 8
"""Runs between two looks at whether a setting is worse than others already."""
POINTS_PER_NUMBER = 6
"""Points spread over the range of each number of the levers before the best are improved."""
MAX_POINTS = 48
IMPROVED = 2
"""Settings that are improved, the best of those points."""
FIRST_STEP = 0.15
"""First step of an improvement, as a part of each range."""
NEAR = 0.1
"""Difference in any number, as a part of its range, below which settings are near to each other."""
SEED = 7
SMALLEST = 1e-12
"""Figure that stands for 0 on a logarithmic scale."""


@dataclass(frozen=True)
class Tried:
    """A setting with the worst figure that it was seen to have; of one that was given up, a lower
    bound of that."""

    setting: Setting
    worst: float
    median: float = math.nan
    """Median of the cases, each from its worst start; nan of one that was given up."""
    why_not: str = ""
    """Why it is not allowed."""


@dataclass(frozen=True)
class Drives:
    """Drives by which settings are judged."""

    base: Scenario
    cases: Sequence[dict[str, Any]]
    """Changes of the base, in SI."""
    starts: Sequence[Start]
    allowed: Allowed


class Search:
    """Settings of ``levers``, judged by their worst case from some starts.

    ``on_tried`` is called with every setting.
    """

    def __init__(
        self,
        drives: Drives,
        levers: Sequence[Lever],
        evaluations: Evaluations,
        on_tried: Callable[[Tried], None] = lambda one: None,
    ) -> None:
        self.drives, self.levers, self.evaluations = drives, tuple(levers), evaluations
        self._on_tried, self._best = on_tried, math.inf
        self._tried: dict[Setting, Tried] = {}
        self._telling = np.zeros(len(drives.cases) * len(drives.starts))

    @property
    def tried(self) -> tuple[Tried, ...]:
        """All settings that were tried, best first."""
        return tuple(sorted(self._tried.values(), key=lambda one: one.worst))

    @property
    def best(self) -> float:
        """Least worst figure of all settings so far."""
        return self._best

    def unlike(self, count: int) -> tuple[Setting, ...]:
        """The best settings that were tried, so many at most, that are not near to a better one."""
        chosen: list[Setting] = []
        for one in self.tried:
            far = all(_distance(one.setting, other) >= NEAR for other in chosen)
            if far and math.isfinite(one.worst):
                chosen.append(one.setting)
        return tuple(chosen[:count])

    def worst(self, setting: Setting, bound: float = math.inf) -> float:
        """Worst figure of a setting; once one is above the ``bound``, that."""
        known = self._tried.get(setting)
        if known is not None:
            return known.worst
        why_not = self._why_not(setting)
        worst, median = math.inf, math.nan
        if not why_not:
            worst, median = self._over_cases(setting, bound)
        one = self._tried[setting] = Tried(setting, worst, median, why_not)
        self._best = min(worst, self._best)
        self._on_tried(one)
        return worst

    def _why_not(self, setting: Setting) -> str:
        try:
            return self.drives.allowed(with_levers(self.drives.base, self.levers, setting))
        except ScenarioError as error:
            return str(error)

    def _over_cases(self, setting: Setting, bound: float) -> tuple[float, float]:
        """Worst figure of a setting, and the median over cases, which is not known where one is above
        the ``bound``; cases that were worst of earlier settings come first.
        """
        every = self._cases_of(setting)
        order = np.argsort(-self._telling, kind="stable")
        values = np.zeros(len(every))
        for first in range(0, len(every), AT_ONCE):
            chosen = order[first : first + AT_ONCE]
            values[chosen] = self.evaluations.values([every[k] for k in chosen])
            if values.max() > bound:
                break
        else:
            first = len(every)
        self._telling[int(np.argmax(values))] += 1.0
        if first < len(every):
            return float(values.max()), math.nan
        by_case = values.reshape(-1, len(self.drives.starts)).max(axis=1)
        return float(values.max()), float(np.median(by_case))

    def _cases_of(self, setting: Setting) -> list[Case]:
        return drawn(
            self.drives.base,
            self.drives.cases,
            self.drives.starts,
            lambda scenario: with_levers(scenario, self.levers, setting),
        )

    # ---- Which settings are tried ----

    def run(self, most: int, first: Sequence[Setting] = ()) -> Tried:
        """The best of at most ``most`` settings, beginning with the ``first``."""
        for setting in (*first, *self._spread(most // 2)):
            self.worst(setting, self._bound())
        for one in self.tried[:IMPROVED]:
            left = most - len(self._tried)
            if left > 0 and math.isfinite(one.worst):
                self._improve(one.setting, left // IMPROVED if one is self.tried[0] else left)
        return self.tried[0]

    def _bound(self) -> float:
        """Figure above which a setting is none of the best few."""
        ranked = self.tried
        if len(ranked) < IMPROVED + 1:
            return math.inf
        return ranked[IMPROVED].worst

    def as_it_is(self) -> Iterator[Setting]:
        """Levers where the scenario has them, and where closed forms want them, all and one by one."""
        for choices in self._choices():
            starts = [self._numbers(lever, choice, lever.start) for lever, choice in choices]
            guesses = [self._numbers(lever, choice, lever.guess) for lever, choice in choices]
            yield Setting(tuple(starts))
            yield Setting(tuple(guesses))
            for k in range(len(guesses)):
                others = [*guesses[:k], starts[k], *guesses[k + 1 :]]
                yield Setting(tuple(others))

    def _choices(self) -> list[list[tuple[Lever, float]]]:
        options = [lever.choices or (math.nan,) for lever in self.levers]
        every = itertools.islice(itertools.product(*options), MAX_COMBINATIONS)
        return [list(zip(self.levers, one, strict=True)) for one in every]

    def _numbers(self, lever: Lever, choice: float, numbers: Sequence[float]) -> tuple[float, ...]:
        return (choice,) if lever.choices else tuple(numbers)

    def _spread(self, most: int) -> Iterator[Setting]:
        """Points spread over all ranges, as many for each combination of choices."""
        from scipy.stats import qmc

        count = sum(lever.dimensions for lever in self.levers)
        combinations = self._choices()
        if not count:
            for choices in combinations:
                yield Setting(tuple((choice,) for _, choice in choices))
            return
        wanted = min(POINTS_PER_NUMBER * count, MAX_POINTS, max(most // len(combinations), 1))
        points = qmc.Sobol(count, rng=np.random.default_rng(SEED)).random_base2(
            max(wanted - 1, 1).bit_length()
        )
        for choices in combinations:
            for point in points[:wanted]:
                yield self._at(point, choices)

    def _at(self, point: np.ndarray, choices: Sequence[tuple[Lever, float]]) -> Setting:
        numbers, used = [], 0
        for lever, choice in choices:
            own = point[used : used + lever.dimensions].tolist()
            used += lever.dimensions
            numbers.append(self._numbers(lever, choice, own))
        return Setting(tuple(numbers))

    def _improve(self, setting: Setting, most: int) -> None:
        """Nelder and Mead's simplex about a setting, with its choices."""
        from scipy.optimize import minimize

        choices = [
            (lever, numbers[0] if lever.choices else math.nan)
            for lever, numbers in zip(self.levers, setting.numbers, strict=True)
        ]
        start = np.array(
            [
                number
                for lever, numbers in zip(self.levers, setting.numbers, strict=True)
                if not lever.choices
                for number in numbers
            ]
        )
        if not start.size:
            return

        def score(point: np.ndarray) -> float:
            worst = self.worst(self._at(np.clip(point, 0.0, 1.0), choices), self._bound())
            return math.log(max(worst, SMALLEST)) if math.isfinite(worst) else 1e3

        steps = np.where(start > 0.5, -FIRST_STEP, FIRST_STEP)
        simplex = np.vstack([start, start + np.diag(steps)])
        minimize(
            score,
            start,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * start.size,
            options={"maxfev": most, "initial_simplex": simplex, "xatol": 2e-3, "fatol": 5e-3},
        )


def _distance(one: Setting, other: Setting) -> float:
    """Largest difference of two settings in any number; choices that differ are far."""
    pairs = zip(itertools.chain(*one.numbers), itertools.chain(*other.numbers), strict=True)
    return max((abs(a - b) for a, b in pairs), default=0.0)
