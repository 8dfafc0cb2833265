"""Stepping modes over rate: which number of microsteps keeps lines smallest at which rates.

A driver that changes its stepping mode by a table over the rate, so that harmonics of the step rate
stay out of a band of frequencies, is claimed in US 2026/0149395 A1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Annotated, Literal

from microvib.results import MICROSTEPS, RATE, TORQUE, Column
from microvib.studies.rates import ABOVE_LIMIT, RateCase, RatePlan

SWITCH_GAIN = 10.0 ** (3.0 / 20.0)
"""Factor by which another number of microsteps must make the largest line smaller for a switch."""
RangeVerdict = Literal["", "pass", "fail", "not judged"]


@dataclass(frozen=True)
class SteppingMode:
    """A range of rates with the number of microsteps to be used in it."""

    low: Annotated[float, Column("from_deg_s", "from", RATE)]
    high: Annotated[float, Column("to_deg_s", "to", RATE)]
    microsteps: Annotated[int, MICROSTEPS]
    largest: Annotated[float, Column("largest_n_m", "largest line", TORQUE, absent="unknown")]
    line: Annotated[str, Column("line", "line")]
    verdict: Annotated[RangeVerdict, Column("verdict", "verdict", role="verdict")]
    """On the limit of the plan; empty where there is none."""


@dataclass(frozen=True)
class _Cell:
    """Rates about one of the grid, and what a number of microsteps makes of them."""

    low: float
    high: float
    cases: tuple[RateCase, ...]
    largest: float
    """Largest line [N m]; infinite where a case failed."""
    allowed: bool


def stepping_modes(plan: RatePlan) -> tuple[SteppingMode, ...]:
    """Choose the number of microsteps for each range of rates of a plan.

    At the lowest rate it is the one whose largest line in the plan's band is smallest, of those that
    are allowed. From there up it changes only where it is not allowed any more and another one is,
    or where another one that is no less allowed makes the largest line smaller by 3 dB. A range ends
    halfway between two rates of the plan that all numbers have in common; cases about resonances count
    for the rate that they are next to.

    Parameters
    ----------
    plan : RatePlan
        A plan with several numbers of microsteps.

    Returns
    -------
    tuple of SteppingMode
        Ranges that follow each other, by rate; none of a plan with one number of microsteps.
    """
    if len(plan.counts) < 2:
        return ()
    rates = _common_rates(plan)
    cells = {count: _cells(plan, count, rates) for count in plan.counts}
    chosen: list[int] = []
    for k in range(len(rates)):
        chosen.append(_choice({count: of[k] for count, of in cells.items()}, chosen[-1:]))
    ranges = []
    for count, group in groupby(range(len(rates)), key=lambda k: chosen[k]):
        ranges.append(_range(plan, count, [cells[count][k] for k in group]))
    return tuple(ranges)


def _common_rates(plan: RatePlan) -> list[float]:
    """Rates [rad/s] that every number of microsteps has a case at."""
    each = [{case.rate for case in plan.of(count)} for count in plan.counts]
    return sorted(set.intersection(*each))


def _cells(plan: RatePlan, count: int, rates: Sequence[float]) -> list[_Cell]:
    middles = [0.5 * (a + b) for a, b in pairwise(rates)]
    edges = [rates[0], *middles, rates[-1]]
    found = []
    for k, (low, high) in enumerate(pairwise(edges)):
        last = k == len(rates) - 1
        cases = tuple(
            c for c in plan.of(count) if low <= c.rate < high or (last and c.rate == high)
        )
        failed = any(case.failed for case in cases)
        largest = math.inf if failed else max((plan.top(case) for case in cases), default=math.inf)
        found.append(_Cell(low, high, cases, largest, all(map(plan.is_allowed, cases))))
    return found


def _choice(cells: dict[int, _Cell], before: Sequence[int]) -> int:
    """Number of microsteps at one rate, after the one ``before``, if any."""
    best = min(cells, key=lambda count: (not cells[count].allowed, cells[count].largest))
    if not before:
        return best
    kept, other = cells[before[0]], cells[best]
    if other.allowed and not kept.allowed:
        return best
    if kept.allowed == other.allowed and kept.largest > SWITCH_GAIN * other.largest:
        return best
    return before[0]


def _range(plan: RatePlan, count: int, cells: Sequence[_Cell]) -> SteppingMode:
    cases = [case for cell in cells for case in cell.cases]
    largest = max(cell.largest for cell in cells)
    lines = [line for case in cases if (line := case.largest(plan.band)) is not None]
    top = max(lines, key=lambda line: line.amplitude, default=None)
    return SteppingMode(
        cells[0].low,
        cells[-1].high,
        count,
        largest if math.isfinite(largest) else math.nan,
        "" if top is None else top.name,
        _verdict(plan, cases),
    )


def _verdict(plan: RatePlan, cases: Sequence[RateCase]) -> RangeVerdict:
    if plan.limit is None:
        return ""
    each = {case.verdict(plan.band, plan.limit) for case in cases}
    if ABOVE_LIMIT in each:
        return "fail"
    return "not judged" if each != {""} else "pass"
