"""Where in the range of the assumptions a comparison holds: values that part what holds from what
does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

SIGNIFICANCE = 0.01
"""Chance, over all assumptions together, that one is named which has no effect."""
MIN_DRAWS = 8
"""Draws on either side that are needed."""


@dataclass(frozen=True)
class Separation:
    """A value of one assumption, and how often a comparison holds below and above it."""

    name: str
    value: float
    below: float
    """Part of the draws below the value in which it holds."""
    above: float
    chance: float
    """Chance of so different shares if the assumption had no effect, over all assumptions."""
    weight: float
    """Difference of the shares, weighed by how evenly the value parts the draws."""


def separations(values: np.ndarray, held: np.ndarray, names: list[str]) -> list[Separation]:
    """Assumptions that decide whether a comparison holds, the most decisive first.

    Each is looked at by itself: a rank test (Mann-Whitney) of its values where the comparison holds
    against those where it does not, its chance multiplied by the number of assumptions; then the
    value that parts the draws best.

    Parameters
    ----------
    values : numpy.ndarray
        Drawn values, (draws, assumptions).
    held : numpy.ndarray
        Whether the comparison holds, (draws,).
    names : list of str
        Names of the assumptions.
    """
    from scipy import stats

    if held.all() or not held.any() or held.size < 2 * MIN_DRAWS:
        return []
    found = []
    for name, column in zip(names, values.T, strict=True):
        test = stats.mannwhitneyu(column[held], column[~held])
        chance = min(float(test.pvalue) * len(names), 1.0)
        if chance <= SIGNIFICANCE:
            found.append(_best_value(name, column, held, chance))
    return sorted(found, key=lambda one: -one.weight)


def _best_value(name: str, column: np.ndarray, held: np.ndarray, chance: float) -> Separation:
    """The value that parts the draws best, with at least ``MIN_DRAWS`` on either side."""
    order = np.argsort(column)
    sorted_held = held[order].astype(float)
    counts = np.arange(1, held.size)
    below = np.cumsum(sorted_held)[:-1] / counts
    above = (sorted_held.sum() - np.cumsum(sorted_held)[:-1]) / (held.size - counts)
    both = np.minimum(counts, held.size - counts) >= MIN_DRAWS
    # proportional to the correlation of side and outcome, so that thin ends do not win
    evenness = np.sqrt(counts * (held.size - counts)) / held.size
    weights = np.where(both, np.abs(below - above) * evenness, -math.inf)
    k = int(np.argmax(weights))
    value = 0.5 * float(column[order[k]] + column[order[k + 1]])
    return Separation(name, value, float(below[k]), float(above[k]), chance, float(weights[k]))
