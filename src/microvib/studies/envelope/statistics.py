"""Statistics over members of figures that are known to within intervals: largest, mean, percentiles with
the confidence that their number allows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from microvib.analysis.seeds import CONFIDENCE, quantile_bounds
from microvib.errors import OptionError, quoted_value

Statistic = Literal["max", "p95", "p99", "mean"]
QUANTILES: dict[str, float] = {"p95": 0.95, "p99": 0.99}
WORDS: dict[str, str] = {"max": "maximum", "p95": "P95", "p99": "P99", "mean": "mean"}


def checked_statistics(given: Sequence[str]) -> tuple[Statistic, ...]:
    """Statistics by their names, each once; OptionError for one that is not known, or for none."""
    known: tuple[Statistic, ...] = get_args(Statistic)
    for name in given:
        if name not in known:
            raise OptionError(
                "statistic", f"{quoted_value(name)} is not known; allowed are {', '.join(known)}"
            )
    if not given:
        raise OptionError("statistic", f"is missing; allowed are {', '.join(known)}")
    return tuple(name for name in known if name in given)


def members_needed(statistic: str) -> int:
    """Members from which on the largest of them is, with 95 % confidence, no less than a percentile of
    what they are drawn from: 59 for P95, 299 for P99; 1 for other statistics.
    """
    if statistic not in QUANTILES:
        return 1
    return math.ceil(math.log(1.0 - CONFIDENCE) / math.log(QUANTILES[statistic]))


@dataclass(frozen=True)
class Interval:
    """A figure, the least that it is, and the most."""

    value: float
    low: float
    high: float


def statistic_of(
    statistic: Statistic, low: np.ndarray, value: np.ndarray, high: np.ndarray
) -> Interval:
    """A statistic of figures (n,), each of which lies between ``low`` (n,) and ``high`` (n,).

    A percentile is that of the distribution from which members are drawn: its bounds are order
    statistics with 95 % confidence each, whatever the distribution. Of too few members it has no
    value, and no upper bound (nan).
    """
    if not value.size:
        return Interval(math.nan, math.nan, math.nan)
    if statistic in QUANTILES:
        q = QUANTILES[statistic]
        known = value.size >= members_needed(statistic)
        middle = float(np.quantile(value, q)) if known else math.nan
        return Interval(
            middle, quantile_bounds(np.sort(low), q)[0], quantile_bounds(np.sort(high), q)[1]
        )
    pick = np.max if statistic == "max" else np.mean
    return Interval(float(pick(value)), float(pick(low)), float(pick(high)))
