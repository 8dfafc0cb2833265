"""Declared comparisons over metrics of cases: one value each, and whether it holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from microvib.errors import ScenarioError
from microvib.units import convert
from microvib.validation.cases_file import (
    CasesTest,
    Comparison,
    ExceedsComparison,
    FigureComparison,
    Metric,
    OnsetComparison,
    RankingComparison,
    RatioComparison,
    TrendComparison,
)

Figures = Mapping[tuple[str, str], float]
"""Figures by case and metric, in SI."""
_CLEAR = 1e-12
"""Part of the larger of two figures below which a difference is rounding, as between equal ones."""


@dataclass(frozen=True)
class Bar:
    """Value of a comparison, and where it has to lie."""

    value: Callable[[Figures], float]
    unit: str
    least: float = -math.inf
    most: float = math.inf
    words: str = ""
    """The bar in words."""
    quantity: str = "ratio"
    """Quantity of the value: a metric of a case, or a ratio of some."""

    def holds(self, value: float) -> bool | None:
        """Whether a value holds; None where there is none."""
        if math.isnan(value):
            return None
        return self.least <= value <= self.most


def bar_of(test: CasesTest, comparison: Comparison, where: str) -> Bar | None:
    """Value and bounds of a comparison; None where nothing is comparable.

    Raises ScenarioError for a bound whose unit is not that of the metric.
    """
    if comparison.figure:
        return _figure(comparison.figure, test.metrics, f"{where}.figure")
    if comparison.bound:
        bound = comparison.bound
        unit = test.metrics[bound.metric].unit
        low, high = _ends(bound.at_least, bound.at_most, unit, f"{where}.bound")
        key = bound.case, bound.metric
        return Bar(lambda of: of[key], unit, low, high, _words(low, high, unit), bound.metric)
    if comparison.ratio:
        return _ratio(comparison.ratio, test.metrics, f"{where}.ratio")
    if comparison.trend:
        return _trend(comparison.trend)
    if comparison.ranking:
        return _ranking(comparison.ranking)
    if comparison.exceeds:
        return _exceeds(comparison.exceeds)
    if comparison.onset:
        return _onset(comparison.onset)
    return None


def _number(given: str | float, unit: str, where: str) -> float:
    try:
        return convert(str(given), unit)
    except ValueError as error:
        raise ScenarioError(f"{where}: {given!r} {error}") from None


def _ends(
    least: str | float | None, most: str | float | None, unit: str, where: str
) -> tuple[float, float]:
    low = -math.inf if least is None else _number(least, unit, f"{where}.at_least")
    high = math.inf if most is None else _number(most, unit, f"{where}.at_most")
    return low, high


def _words(low: float, high: float, unit: str) -> str:
    """Bounds in words."""
    ends = []
    if math.isfinite(low):
        ends.append(f"at least {low:g}")
    if math.isfinite(high):
        ends.append(f"at most {high:g}")
    return f"{' and '.join(ends)} {unit.replace('*', ' ')}".strip()


def _figure(figure: FigureComparison, metrics: Mapping[str, Metric], where: str) -> Bar:
    unit = metrics[figure.metric].unit
    published = _number(figure.value, unit, f"{where}.value")
    if not published > 0.0:
        raise ScenarioError(
            f"{where}.value: {figure.value!r} is not allowed; it must be greater than 0 {unit}".rstrip()
        )
    key = figure.case, figure.metric
    return Bar(
        lambda of: of[key],
        unit,
        published / figure.factor,
        published * figure.factor,
        f"{published:g} {unit.replace('*', ' ')}, within a factor of {figure.factor:g}",
        figure.metric,
    )


def _ratio(ratio: RatioComparison, metrics: Mapping[str, Metric], where: str) -> Bar:
    first, second = (ratio.case, ratio.metric), (ratio.over, ratio.over_metric or ratio.metric)
    units = metrics[first[1]].unit, metrics[second[1]].unit
    if units[0] != units[1]:
        raise ScenarioError(
            f"{where}.over_metric: '{second[1]}' is in {units[1] or 'no unit'} and '{first[1]}' in"
            f" {units[0] or 'no unit'}; two metrics of one unit are expected"
        )
    low, high = _ends(ratio.at_least, ratio.at_most, "", where)
    return Bar(lambda of: quotient(of[first], of[second]), "", low, high, _words(low, high, ""))


def _trend(trend: TrendComparison) -> Bar:
    keys = [(case, trend.metric) for case in trend.cases]
    if trend.direction == "level":
        assert trend.within is not None
        most = 1.0 + trend.within
        words = f"largest over smallest at most {most:g}"
        return Bar(lambda of: _spread([of[key] for key in keys]), "", 0.0, most, words)
    if trend.direction == "rises":
        words = "each over the one before above 1"
    else:
        keys = keys[::-1]
        words = "each over the next above 1"
    return Bar(lambda of: _least_step([of[key] for key in keys]), "", 1.0 + _CLEAR, words=words)


def _ranking(ranking: RankingComparison) -> Bar:
    keys = [(case, ranking.metric) for case in ranking.cases]
    if ranking.first_only:
        return Bar(
            lambda of: quotient(_least([of[key] for key in keys[1:]]), of[keys[0]]),
            "",
            1.0 + _CLEAR,
            words="the least of the others over it above 1",
        )
    return Bar(
        lambda of: _least_step([of[key] for key in keys]),
        "",
        1.0 + _CLEAR,
        words="each over the one before above 1",
    )


def _exceeds(out: ExceedsComparison) -> Bar:
    first = [(out.case, metric) for metric in out.metrics]
    second = [(out.case, metric) for metric in out.others]
    return Bar(
        lambda of: quotient(_least([of[key] for key in first]), _most([of[key] for key in second])),
        "",
        out.by,
        words=f"the least of them over the others at least {out.by:g}",
    )


def _onset(onset: OnsetComparison) -> Bar:
    first, second = (onset.none, onset.metric), (onset.some, onset.metric)

    def beyond(of: Figures) -> float:
        """The count where there is to be one, or 0 where there is one in the other case, too."""
        if of[first] > 0.0:
            return 0.0
        return of[second] + 0.0 * of[first]

    words = f"none in {onset.none}, 1 or more in {onset.some}"
    return Bar(beyond, "", least=1.0, words=words, quantity=onset.metric)


def quotient(first: float, second: float) -> float:
    """First over second, of figures that are not negative; infinite over nothing, 1 where both are
    nothing, and nan where there is no figure.
    """
    if math.isnan(first) or math.isnan(second):
        return math.nan
    if first == second:
        return 1.0
    if second == 0.0:
        return math.inf
    return first / second


def _least(figures: list[float]) -> float:
    return float(np.min(figures))


def _most(figures: list[float]) -> float:
    return float(np.max(figures))


def _spread(figures: list[float]) -> float:
    return quotient(_most(figures), _least(figures))


def _least_step(figures: list[float]) -> float:
    """Least quotient of a figure over the one before."""
    return _least([quotient(b, a) for a, b in pairwise(figures)])
