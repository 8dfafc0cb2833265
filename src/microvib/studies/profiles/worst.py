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
    the larger one and an eighth of the second difference. Where this is above the worst run by more
    than ``TOLERANCE``, a run halfway is made.

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
        gaps = list(_gaps(size))
        wide = {at for most, at in gaps if most > worst + TOLERANCE}
        new = sorted(wide - set(found))[: max(MOST_RUNS - len(found), 0)]
        if not new:
            break
    between = max((most - worst for most, _ in gaps), default=0.0)
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


def _gaps(
    size: dict[Point, tuple[np.ndarray, np.ndarray]],
) -> Iterator[tuple[float, Point]]:
    """What a mode may ring with over its limit between neighbouring points, and the middle of them."""
    for axis in range(3):
        lines: dict[tuple[float, ...], list[Point]] = {}
        for at in sorted(size):
            lines.setdefault((*at[:axis], *at[axis + 1 :]), []).append(at)
        for points in lines.values():
            if len(points) >= 3:
                yield from _gaps_of_line(axis, points, size)


def _gaps_of_line(
    axis: int, points: Sequence[Point], size: dict[Point, tuple[np.ndarray, np.ndarray]]
) -> Iterator[tuple[float, Point]]:
    x = np.array([at[axis] for at in points])
    values = np.array([size[at][0] for at in points])
    most = np.array([size[at][1] for at in points])
    slope = np.diff(values, axis=0) / np.diff(x)[:, None]
    curvature = np.abs(2.0 * np.diff(slope, axis=0) / (x[2:] - x[:-2])[:, None])
    for k in range(x.size - 1):
        about = np.max(curvature[max(k - 1, 0) : k + 1], axis=0)
        bulge = 0.125 * (x[k + 1] - x[k]) ** 2 * about
        middle = list(points[k])
        middle[axis] = round(float(0.5 * (x[k] + x[k + 1])), 12)
        yield float(np.max(np.maximum(most[k], most[k + 1]) + bulge)), (
            middle[0], middle[1], middle[2],
        )  # fmt: skip
