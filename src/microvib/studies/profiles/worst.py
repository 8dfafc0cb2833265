"""The worst ringing over all that a drive may be: runs on a grid, which is made finer where the ringing may
still be larger between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from microvib.studies.profiles.runs import Case, Ringing

TOLERANCE = 0.02
"""Part of the limit to which the worst is found."""
MOST_RUNS = 400
"""Runs from which on the grid is made no finer, whatever may still be between them."""
_FREQUENCIES, _OTHERS = 9, 3
"""Points to begin with."""
_SAFETY = 2.0
"""Factor on a curvature, which is a mean over three points."""
Point = tuple[float, float, float]
"""Frequency, damping and friction over the nominal ones."""
Axes = tuple[list[float], list[float], list[float]]
Measured = tuple[Case, tuple[Ringing, ...]]


@dataclass(frozen=True)
class Searched:
    """Runs of a search for the worst."""

    cases: tuple[Case, ...]
    ringing: tuple[tuple[Ringing, ...], ...]
    """By case and mode."""
    between: float
    """How much more than the largest of them a mode may ring with between the runs, over its limit."""


def start_grid(frequency: float, damping: float, friction: float) -> Axes:
    """Even points over ranges of parts either way: nine frequencies, middle and ends of the others."""
    return _over(frequency, _FREQUENCIES), _over(damping, _OTHERS), _over(friction, _OTHERS)


def _over(part: float, count: int) -> list[float]:
    if part == 0.0:
        return [1.0]
    values: list[float] = np.linspace(1.0 - part, 1.0 + part, count).round(12).tolist()
    return values


def search_worst(
    axes: Axes,
    measure: Callable[[Sequence[Point]], Sequence[Measured]],
    limits: Callable[[Case], np.ndarray],
) -> Searched:
    """Search the largest ringing over its limit.

    In a cell of the grid the ringing, as a complex number, is taken to be off what is linear between
    the corners by a quarter of the second differences along frequency, damping and friction at most,
    twice what even curvatures would make. Where the largest corner and these are above the worst run by
    more than ``TOLERANCE``, the cell is halved along the axis that curves most, and with it the
    whole grid there.

    Parameters
    ----------
    axes : three lists of float
        Points of a grid to begin with, as of ``start_grid``.
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
    while True:
        new = [at for at in product(*axes) if at not in found]
        found |= dict(zip(new, measure(new), strict=True))
        values, most = _on_grid(axes, found, limits)
        bulges = [_bulges(values, axis, axes[axis]) for axis in range(3)]
        off = [_of_cells(each, axis) for axis, each in enumerate(bulges)]
        bound = np.max(_of_cells(most) + sum(off), axis=-1)
        worst = float(np.max(most))
        finer = _finer(axes, off, bound > worst + TOLERANCE)
        if finer == axes or np.prod([len(x) for x in finer]) > MOST_RUNS:
            break
        axes = finer
    cases, ringing = zip(*found.values(), strict=True)
    between = max(float(np.max(bound)) - worst, 0.0) if np.isfinite(worst) else np.inf
    return Searched(cases, ringing, between)


def _on_grid(
    axes: Axes, found: dict[Point, Measured], limits: Callable[[Case], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Ringing of each mode over its limit, complex (f, d, u, n), and what it is at most."""
    shape = (*(len(x) for x in axes), -1)
    measured = [found[at] for at in product(*axes)]
    allowed = [limits(case) for case, _ in measured]
    values, most = (
        [
            [getattr(one, name) for one in ringing] / of
            for (_, ringing), of in zip(measured, allowed, strict=True)
        ]
        for name in ("value", "most")
    )
    return np.reshape(values, shape), np.reshape(most, shape)


def _bulges(values: np.ndarray, axis: int, points: Sequence[float]) -> np.ndarray:
    """How far the ringing may be off a straight line to the next point along an axis, at each point
    but the last; 0 where there is one point.
    """
    x, along = np.array(points), np.moveaxis(values, axis, 0)
    if x.size < _OTHERS:
        return np.zeros(values.shape)
    step = np.diff(x).reshape(-1, *(1,) * (along.ndim - 1))
    slope = np.diff(along, axis=0) / step
    curvature = np.abs(2.0 * np.diff(slope, axis=0) / (step[1:] + step[:-1]))
    about = np.maximum(
        np.concatenate([curvature[:1], curvature]), np.concatenate([curvature, curvature[-1:]])
    )
    return np.asarray(np.moveaxis(_SAFETY * 0.125 * step**2 * about, 0, axis))


def _of_cells(values: np.ndarray, known: int = -1) -> np.ndarray:
    """Largest of the corners of each cell, (f, d, u, n); along the axis ``known`` they are of cells
    already.
    """
    for axis in range(3):
        size = values.shape[axis]
        if size > 1 and axis != known:
            first, second = (np.take(values, range(k, size - 1 + k), axis) for k in (0, 1))
            values = np.maximum(first, second)
    return values


def _finer(axes: Axes, off: Sequence[np.ndarray], wide: np.ndarray) -> Axes:
    """Axes with points in the middle of cells that are ``wide``, each along the axis that curves most."""
    most = np.array([np.max(each, axis=-1) for each in off])
    steepest = np.argmax(most, axis=0)
    finer: list[list[float]] = []
    for axis, points in enumerate(axes):
        there = np.nonzero(wide & (steepest == axis))[axis] if len(points) > 1 else ()
        middles = {round(0.5 * (points[k] + points[k + 1]), 12) for k in set(there)}
        finer.append(sorted({*points, *middles}))
    return finer[0], finer[1], finer[2]
