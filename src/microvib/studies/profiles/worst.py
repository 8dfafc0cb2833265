"""The worst ringing over all that a drive may be: runs where it may still be larger, until nothing is left
between them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from microvib.studies.profiles.runs import Case, Ringing

TOLERANCE = 0.02
"""Part of the limit to which the worst is found."""
MOST_RUNS = 300
"""Runs after which the search ends, whatever may still be between them."""
_FREQUENCIES = 9
"""Points over the frequencies to begin with."""
_SHARE = 0.3
"""Part of what may be between two runs from which their axis is worth a run."""
_NEAREST = 4
_SAFETY = 2.0
"""Factor on a curvature, which is a mean over three points."""
Point = tuple[float, float, float]
"""Frequency, damping and friction over the nominal ones."""
Measured = tuple[Case, tuple[Ringing, ...]]


@dataclass(frozen=True)
class Searched:
    """Runs of a search for the worst."""

    cases: tuple[Case, ...]
    ringing: tuple[tuple[Ringing, ...], ...]
    """By case and mode."""
    between: float
    """How much more than the largest of them a mode may ring with between the runs, over its limit."""


def start_points(frequency: float, damping: float, friction: float) -> tuple[Point, ...]:
    """Points over ranges of parts either way: nine frequencies, middle and ends of the others."""
    frequencies = _over(frequency, _FREQUENCIES)
    return tuple(product(frequencies, _over(damping, 3), _over(friction, 3)))


def _over(part: float, count: int) -> list[float]:
    if part == 0.0:
        return [1.0]
    values: list[float] = np.linspace(1.0 - part, 1.0 + part, count).round(12).tolist()
    return values


def search_worst(
    first: Sequence[Point],
    measure: Callable[[Sequence[Point]], Sequence[Measured]],
    limits: Callable[[Case], np.ndarray],
) -> Searched:
    """Search the largest ringing over its limit.

    Along each of frequency, damping and friction the ringing, as a complex number, lies between two
    runs within the curvature that three runs tell of the straight line between them: it is at most
    the larger one and a quarter of the second differences along all of these, twice what an even
    curvature would make. Where this is above the
    worst run by more than ``TOLERANCE``, a run halfway is made along the axes that curve most.

    Parameters
    ----------
    first : sequence of Point
        Points of a grid to begin with, as of ``start_points``.
    measure : callable
        Makes runs at points.
    limits : callable
        Limits of the modes in a case [N m], (n,).

    Returns
    -------
    Searched
        All runs, and what may be between them.
    """
    found: dict[Point, Measured] = {}
    new = list(first)
    while True:
        found |= dict(zip(new, measure(new), strict=True))
        size = {at: _over_limit(one, limits) for at, one in found.items()}
        worst = max(float(np.max(most)) for _, most in size.values())
        bounds = list(_bounds(size))
        wide = {
            gap.middle
            for most, gap in bounds
            if most > worst + TOLERANCE and gap.bulge >= _SHARE * (most - gap.ends)
        }
        new = sorted(wide - set(found))[: max(MOST_RUNS - len(found), 0)]
        if not new:
            break
    between = max((most - worst for most, _ in bounds), default=0.0)
    cases, ringing = zip(*found.values(), strict=True)
    return Searched(cases, ringing, max(between, 0.0))


def _over_limit(
    measured: Measured, limits: Callable[[Case], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Ringing of each mode over its limit, complex (n,), and what it is at most, (n,)."""
    case, ringing = measured
    allowed = limits(case)
    value = np.array([one.value for one in ringing]) / allowed
    return value, np.array([one.most for one in ringing]) / allowed


@dataclass(frozen=True)
class _Gap:
    """Two neighbouring points along an axis: 0 frequency, 1 damping, 2 friction."""

    axis: int
    middle: Point
    ends: float
    """Larger ringing of both, over its limit."""
    bulge: float
    """How much the ringing between them is off a straight line, by the second differences there."""


def _bounds(size: dict[Point, tuple[np.ndarray, np.ndarray]]) -> Iterator[tuple[float, _Gap]]:
    """What a mode may ring with over its limit about each gap: that of its ends and what is off a
    straight line along all axes.
    """
    gaps = [list(_gaps(axis, size)) for axis in range(3)]
    for axis, along in enumerate(gaps):
        others = [_NearBulges(other) for k, other in enumerate(gaps) if k != axis and other]
        for gap in along:
            yield gap.ends + gap.bulge + sum(near.at(gap.middle) for near in others), gap


class _NearBulges:
    """Bulges along one axis by place."""

    def __init__(self, gaps: Sequence[_Gap]) -> None:
        self._places = np.array([gap.middle for gap in gaps])
        self._bulges = np.array([gap.bulge for gap in gaps])
        self._spans = np.maximum(np.ptp(self._places, axis=0), 1e-9)

    def at(self, place: Point) -> float:
        """The largest of the nearest."""
        away = np.sum(((self._places - np.array(place)) / self._spans) ** 2, axis=1)
        return float(np.max(self._bulges[np.argsort(away, kind="stable")[:_NEAREST]]))


def _gaps(axis: int, size: dict[Point, tuple[np.ndarray, np.ndarray]]) -> Iterator[_Gap]:
    """Gaps between neighbouring points along an axis, on lines of three points or more."""
    lines: dict[tuple[float, ...], list[Point]] = {}
    for at in sorted(size):
        lines.setdefault((*at[:axis], *at[axis + 1 :]), []).append(at)
    for points in lines.values():
        if len(points) >= 3:
            yield from _gaps_of_line(axis, points, size)


def _gaps_of_line(
    axis: int, points: Sequence[Point], size: dict[Point, tuple[np.ndarray, np.ndarray]]
) -> Iterator[_Gap]:
    x = np.array([at[axis] for at in points])
    values = np.array([size[at][0] for at in points])
    most = np.array([size[at][1] for at in points])
    slope = np.diff(values, axis=0) / np.diff(x)[:, None]
    curvature = np.abs(2.0 * np.diff(slope, axis=0) / (x[2:] - x[:-2])[:, None])
    for k in range(x.size - 1):
        about = np.max(curvature[max(k - 1, 0) : k + 1])
        middle = list(points[k])
        middle[axis] = round(float(0.5 * (x[k] + x[k + 1])), 12)
        yield _Gap(
            axis,
            (middle[0], middle[1], middle[2]),
            float(np.max(most[k : k + 2])),
            float(_SAFETY * 0.125 * (x[k + 1] - x[k]) ** 2 * about),
        )
