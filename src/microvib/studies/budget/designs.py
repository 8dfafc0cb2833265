"""Two designs of a craft against the same requirements: what each comes to, and whether they differ.

Each design is a budget of its own. They differ in a requirement only where their figures do with all
that is not known of either: the largest that one may be is below the least that the other may be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from microvib.analysis.margins import Verdict
from microvib.errors import MicrovibError
from microvib.studies.budget.study import Budget
from microvib.studies.budget.sums import Assessment

Better = Literal["A", "B", "no difference within uncertainty", "not judged"]


@dataclass(frozen=True)
class DesignPair:
    """One requirement by both designs."""

    a: Assessment
    b: Assessment

    @property
    def change(self) -> float:
        """Figure of B over that of A, both over their limits; nan where that says nothing."""
        a, b = _part_of_limit(self.a, self.a.value), _part_of_limit(self.b, self.b.value)
        if a > 0.0:
            return b / a
        return math.nan

    @property
    def better(self) -> Better:
        """Design with the smaller figure, where that is certain."""
        (a_least, a_most), (b_least, b_most) = _range(self.a), _range(self.b)
        if a_most < b_least:
            return "A"
        if b_most < a_least:
            return "B"
        if not all(map(math.isfinite, (a_most, b_most))):
            return "not judged"
        return "no difference within uncertainty"

    @property
    def passed_by(self) -> str:
        """Which of the designs pass the requirement, in words."""
        return _passing([self.a.verdict], [self.b.verdict])


@dataclass(frozen=True)
class Designs:
    """Budgets of two designs, A and B, against the same requirements."""

    names: tuple[str, str]
    a: Budget
    b: Budget

    def __post_init__(self) -> None:
        asked = [[one.requirement for one in budget.judged] for budget in (self.a, self.b)]
        if asked[0] != asked[1]:
            raise MicrovibError(
                "requirement: differs between both designs; they are compared by the same one"
            )

    @property
    def pairs(self) -> tuple[DesignPair, ...]:
        """All requirements."""
        pairs = zip(self.a.judged, self.b.judged, strict=True)
        return tuple(DesignPair(a, b) for a, b in pairs)

    @property
    def passed_by(self) -> str:
        """Which of the designs pass all requirements, in words."""
        each = ([one.verdict for one in budget.judged] for budget in (self.a, self.b))
        return _passing(*each)


def _part_of_limit(one: Assessment, value: float) -> float:
    """A figure over the limit, which of a curve is that at the worst line."""
    if one.limit > 0.0:
        return value / one.limit
    return math.nan


def _range(one: Assessment) -> tuple[float, float]:
    """Least and most of a requirement over the limit; without end where nothing is known."""
    least, most = _part_of_limit(one, one.least), _part_of_limit(one, one.most)
    if math.isnan(least) or math.isnan(most):
        return 0.0, math.inf
    return least, most


def _passing(a: list[Verdict], b: list[Verdict]) -> str:
    passes = [bool(each) and all(x == "pass" for x in each) for each in (a, b)]
    if all(passes):
        return "both"
    if passes[0]:
        return "A"
    if passes[1]:
        return "B"
    return "neither"
