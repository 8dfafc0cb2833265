"""The shortest change of rate that keeps modes below their limits, by linear programming.

A change of rate from 0 to 1 within the time T is a sum of steps (or, where the acceleration has a
limit, of ramps) at the points of an even grid. The residual R of each mode is linear in their
heights, and |R| is at most its largest projection on 16 directions over cos(pi/16). The least of
the largest |R| over its limit is thus the optimum of a linear program; the shortest T at which it
is one is found by bisection.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.errors import MicrovibError
from microvib.studies.profiles.modes import UncertainMode
from microvib.studies.profiles.rate_profile import RateProfile

INTERVALS = 96
"""Intervals of the grid of steps or ramps."""
DIRECTIONS = 16
"""Directions on which residuals are projected: they are overstated by 2 % at most."""
LONGEST = 20.0
"""Periods of the slowest mode up to which a change of rate is searched."""
DURATION_TOLERANCE = 0.002
"""Part of a period to which the shortest duration is found."""
_FREQUENCIES, _DAMPINGS = 13, 2
"""Points over the uncertainty of a mode at which a linear program holds it down."""
_NEGLIGIBLE = 1e-6
"""Height of a step below which it is left out."""


@dataclass(frozen=True)
class Samples:
    """Points over the uncertainty of modes, with what is allowed there."""

    s: np.ndarray
    """Eigenvalues [1/s], complex (n,)."""
    allowed: np.ndarray
    """Largest residual of a change of rate by one, (n,)."""
    offset: np.ndarray
    """Residual that is there besides, complex (n,): at the end of the change of rate, or at its begin
    where it is made ``early``."""
    early: bool = False
    """Whether what makes the offset happens at the begin, from where it rings on to the end."""

    def offset_after(self, duration: float) -> np.ndarray:
        """Offset at the end of a change of rate of a ``duration`` [s], complex (n,)."""
        if self.early:
            return np.asarray(self.offset * np.exp(self.s * duration))
        return self.offset


def samples_of(modes: Sequence[UncertainMode]) -> Samples:
    """Points of all modes, evenly over their ranges."""
    s = [mode.eigenvalues(_FREQUENCIES, _DAMPINGS) for mode in modes]
    allowed = [np.full(points.size, mode.allowed) for points, mode in zip(s, modes, strict=True)]
    found = np.concatenate(s)
    return Samples(found, np.concatenate(allowed), np.zeros(found.size, dtype=complex))


@dataclass(frozen=True)
class Bounds:
    """Bounds on a change of rate from 0 to 1."""

    largest: float = 1.0
    """Largest rate on the way; 1 is no overshoot."""
    acceleration: float = math.inf
    """Largest rate of change [1/s]."""


def shortest_change(
    samples: Samples,
    period: float,
    bounds: Bounds,
    factor: float = 1.0,
    longest: float = LONGEST,
) -> tuple[RateProfile, float]:
    """The shortest change of rate with all residuals within ``factor`` of what is allowed.

    Parameters
    ----------
    samples : Samples
        Points of the modes.
    period : float
        Period of the slowest mode [s], the unit of the search.
    bounds : Bounds
        Largest rate and acceleration.
    factor : float
        Part of what is allowed that is used.
    longest : float
        Periods up to which it is searched, besides what the acceleration needs.

    Returns
    -------
    RateProfile, float
        From rate 0 to 1, and its largest residual over what is allowed at the points.

    Raises
    ------
    MicrovibError
        Where even the ``longest`` is too short.
    """
    least = 1.0 / bounds.acceleration
    low, high = least, least + min(2.0, longest) * period
    best = least_residual(samples, high, bounds)
    while best[1] > factor:
        low, high = high, high + 2.0 * period
        if high > least + longest * period:
            raise MicrovibError(
                f"limit: no profile of up to {longest:g} periods of the slowest mode keeps it;"
                " allow more ringing, less uncertainty or more acceleration"
            )
        best = least_residual(samples, high, bounds)
    while high - low > DURATION_TOLERANCE * period:
        middle = 0.5 * (low + high)
        found = least_residual(samples, middle, bounds)
        if found[1] <= factor:
            high, best = middle, found
        else:
            low = middle
    return best


def least_residual(samples: Samples, duration: float, bounds: Bounds) -> tuple[RateProfile, float]:
    """The change of rate within a ``duration`` [s] whose largest residual, over what is allowed, is
    least, and that part; infinite where the acceleration does not allow it.
    """
    from scipy.optimize import linprog

    grid = np.linspace(0.0, duration, INTERVALS + 1)
    ramped = math.isfinite(bounds.acceleration)
    response = _responses(samples.s, grid, ramped)
    size = response.shape[1]
    A, b = _projections(samples, response, samples.offset_after(duration))
    cost = np.zeros(size + 1)
    cost[-1] = 1.0
    most = bounds.acceleration * duration / INTERVALS if ramped else math.inf
    heights = (0.0, min(most, 1.0)) if bounds.largest <= 1.0 else (-most, most)
    if bounds.largest > 1.0:
        rates = np.hstack([np.tri(size), np.zeros((size, 1))])
        A = np.vstack([A, rates, -rates])
        b = np.concatenate([b, np.full(size, bounds.largest), np.zeros(size)])
    one = np.ones((1, size + 1))
    one[0, -1] = 0.0
    found = linprog(
        cost, A_ub=A, b_ub=b, A_eq=one, b_eq=[1.0],
        bounds=[heights] * size + [(0.0, None)], method="highs",
    )  # fmt: skip
    if found.status != 0:
        return RateProfile.of_jumps(np.zeros(1), np.ones(1)), math.inf
    return _profile(grid, found.x[:-1], ramped), float(found.x[-1])


def _responses(s: np.ndarray, grid: np.ndarray, ramped: bool) -> np.ndarray:
    """Residuals of a step at each point of the grid, or of a ramp over each interval, by one."""
    step = np.exp(np.outer(s, grid[-1] - grid))
    if not ramped:
        return np.asarray(step)
    return np.asarray((step[:, :-1] - step[:, 1:]) / (s[:, None] * (grid[1] - grid[0])))


def _projections(
    samples: Samples, response: np.ndarray, offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows A x <= b that hold the residuals below the last unknown, times what is allowed."""
    angles = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    turn = np.exp(-1j * angles)[:, None]
    over = math.cos(math.pi / DIRECTIONS) * samples.allowed
    rows = (turn[:, :, None] * (response / over[:, None])[None]).real
    rows = rows.reshape(-1, response.shape[1])
    right = -(turn * (offset / over)[None]).real.ravel()
    return np.hstack([rows, np.full((rows.shape[0], 1), -1.0)]), right


def _profile(grid: np.ndarray, heights: np.ndarray, ramped: bool) -> RateProfile:
    if ramped:
        rates = np.concatenate([[0.0], np.cumsum(heights)])
        rates[-1] = 1.0
        return RateProfile(grid, rates)
    kept = np.abs(heights) > _NEGLIGIBLE
    kept[0] = kept[-1] = True
    parts = heights[kept] / np.sum(heights[kept])
    return RateProfile.of_jumps(grid[kept], parts)
