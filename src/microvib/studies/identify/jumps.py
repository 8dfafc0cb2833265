"""Whether figures jump with the least change of a parameter, as a sensitive motion's do."""

from __future__ import annotations

import numpy as np

from microvib.studies.identify.problem import Problem

TRIAL_SHIFTS = (3e-5, 3e-4)
"""Changes of all coordinates after which figures are compared with their slopes."""
MAX_NONLINEARITY = 0.3
"""Difference from these, in standard deviations of all figures together, from which they jump: it
moves an estimate by as many of its standard errors. Where the slopes change the figures by more
than one standard deviation, the part of that change: figures that are merely curved do not jump.
"""


def figures_jump(problem: Problem, x: np.ndarray, r: np.ndarray, J: np.ndarray) -> bool:
    """Whether figures about ``x`` (m,), where residuals are ``r`` (rows,), do not follow the slopes
    ``J`` (rows, m), so that neither a search nor slopes between neighbours tell anything.
    """
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (3, x.size))
    points = [
        np.clip(x + shift * sign, problem.low, problem.high)
        for shift in TRIAL_SHIFTS
        for sign in signs
    ]
    for point, there in zip(points, problem.residuals(points), strict=True):
        expected = J @ (point - x)
        off = float(np.linalg.norm(problem.least(there - r) - expected))
        if off > MAX_NONLINEARITY * max(float(np.linalg.norm(expected)), 1.0):
            return True
    return False
