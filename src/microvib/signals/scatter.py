"""Scatter of repeated estimates: what is theirs beyond their uncertainties, within and between groups, and
which of them are outliers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

OUTLIER_RATIO = 3.5
"""Deviations from the median, over their robust scale, from which a value is called an outlier."""
FEWEST_FOR_OUTLIERS = 3
"""Values below which none is called that."""
_CONFIDENCE = 0.95
_MEDIAN_FACTORS = {2: 2.091, 3: 3.189, 4: 2.061, 5: 2.038, 6: 1.899, 7: 1.815, 8: 1.777}
"""One over the median of the deviations of so many standard normal numbers from their own median, the zeros of
medians that are one of them included: by simulation, which a test repeats."""
_MANY = 1.65


@dataclass(frozen=True)
class Scatter:
    """A standard deviation beyond what the uncertainties explain, with its 95 % interval."""

    value: float
    low: float
    high: float
    """Infinite where the data set no bound."""


NO_SCATTER = Scatter(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class RandomEffects:
    """Mean of estimates in groups, x = mean + group + run + error of the estimate."""

    mean: float
    uncertainty: float
    """Standard uncertainty of the mean."""
    runs: Scatter
    """Between runs of one group."""
    groups: Scatter
    """Between groups; nan with fewer than two."""


def random_effects(
    values: np.ndarray, uncertainty: np.ndarray, groups: Sequence[str]
) -> RandomEffects:
    """Separate scatter between runs, scatter between groups and the errors of estimates.

    Variances are those at which Q, the weighted sum of squares about the weighted mean, has its
    expectation (Paule and Mandel 1982), and at the ends of their intervals its quantiles (Q-profile,
    Viechtbauer 2007).

    Parameters
    ----------
    values, uncertainty : numpy.ndarray
        Estimates and their standard uncertainties, (n,) each.
    groups : sequence of str
        Group of each, (n,).

    Returns
    -------
    RandomEffects
        Mean and scatters; nan where there is no pair.
    """
    names = list(dict.fromkeys(groups))
    parts = [np.flatnonzero([g == name for g in groups]) for name in names]
    within = _profile([(values[k], uncertainty[k] ** 2) for k in parts])
    tau = 0.0 if math.isnan(within.value) else within.value**2
    means, variances = np.array(
        [_weighted_mean(values[k], uncertainty[k] ** 2 + tau) for k in parts]
    ).T
    if len(names) < 2:
        return RandomEffects(float(means[0]), math.sqrt(float(variances[0])), within, NO_SCATTER)
    between = _profile([(means, variances)])
    mean, variance = _weighted_mean(means, variances + between.value**2)
    return RandomEffects(mean, math.sqrt(variance), within, between)


def _weighted_mean(x: np.ndarray, variance: np.ndarray) -> tuple[float, float]:
    """Mean by inverse variances, and its variance; the plain mean where some are zero."""
    if np.any(variance <= 0.0):
        return float(np.mean(x)), float(np.mean(variance)) / x.size
    w = 1.0 / variance
    return float(w @ x / w.sum()), float(1.0 / w.sum())


def _profile(sets: Sequence[tuple[np.ndarray, np.ndarray]]) -> Scatter:
    """Scatter in common of sets of values and variances, each about a mean of its own."""
    from scipy.stats import chi2

    freedom = sum(x.size - 1 for x, _ in sets)
    if freedom < 1:
        return NO_SCATTER
    spread = max(float(np.ptp(x)) for x, _ in sets)
    tail = 0.5 * (1.0 - _CONFIDENCE)
    low = _at_quantile(sets, float(chi2.ppf(1.0 - tail, freedom)), spread)
    high = _at_quantile(sets, float(chi2.ppf(tail, freedom)), spread)
    return Scatter(_at_quantile(sets, float(freedom), spread), low, high)


def _at_quantile(
    sets: Sequence[tuple[np.ndarray, np.ndarray]], wanted: float, spread: float
) -> float:
    """Standard deviation at which Q has a value; 0 where it is less without any."""
    from scipy.optimize import brentq

    def excess(tau: float) -> float:
        total = 0.0
        for x, variance in sets:
            w = 1.0 / (variance + tau**2)
            total += float(w @ (x - w @ x / w.sum()) ** 2)
        return total - wanted

    tiny = 1e-9 * spread
    if spread == 0.0 or excess(tiny) <= 0.0:
        return 0.0
    top = spread
    while excess(top) > 0.0:
        top *= 2.0
    return float(brentq(excess, tiny, top, rtol=1e-10))


def median_factor(n: int) -> float:
    """Standard deviation of normal numbers over the median of the deviations of ``n`` from their median."""
    return _MEDIAN_FACTORS.get(n, _MANY)


def outliers(
    values: np.ndarray, uncertainty: np.ndarray, groups: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of several quantities in each run over their robust scale, and which are outliers.

    A deviation is that from the median of the run's group. Its scale is the value's own uncertainty and a
    relative scatter in common of all quantities, by the median of all deviations: one run of three may be
    off in all of them.

    Parameters
    ----------
    values, uncertainty : numpy.ndarray
        Estimates and their standard uncertainties, (quantities, runs) each; nan where there is none.
    groups : sequence of str
        Group of each run, (runs,).

    Returns
    -------
    tuple of numpy.ndarray
        Deviations over their scale, and whether that is above ``OUTLIER_RATIO``, (quantities, runs) each;
        nan and false where fewer than three runs of a group have the quantity.
    """
    off, sigma, each = (np.full(values.shape, np.nan) for _ in range(3))
    for name in dict.fromkeys(groups):
        own = np.flatnonzero([g == name for g in groups])
        count = np.sum(np.isfinite(values[:, own]), axis=1)
        for k in np.flatnonzero(count >= FEWEST_FOR_OUTLIERS).tolist():
            middle = float(np.nanmedian(values[k, own]))
            off[k, own] = (values[k, own] - middle) / middle
            sigma[k, own] = uncertainty[k, own] / middle
            each[k, own] = np.abs(off[k, own]) * median_factor(int(count[k]))
    if not np.any(np.isfinite(each)):
        return off, np.zeros(values.shape, dtype=bool)
    common = max(float(np.nanmedian(each)) ** 2 - float(np.nanmedian(sigma)) ** 2, 0.0)
    scale = np.sqrt(sigma**2 + common)
    with np.errstate(invalid="ignore", divide="ignore"):
        over = np.where(scale > 0.0, off / scale, 0.0 * off)
        return over, np.abs(over) > OUTLIER_RATIO
