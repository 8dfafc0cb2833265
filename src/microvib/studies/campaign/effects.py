"""Influence of a campaign's keys: effect on a line (tornado), and share of the variance (Sobol indices)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.studies.campaign.design import ONE_AT_A_TIME_QUANTILES, Design
from microvib.studies.campaign.results import Results
from microvib.studies.campaign.statistics import CONFIDENCE, Estimate, amplitudes
from microvib.studies.campaign.variation import Levels

BOOTSTRAP_SAMPLES = 200
"""Number of samples of the bootstrap."""
MIN_CASES = 4
"""Draws per parameter below which no regression is made."""


@dataclass(frozen=True)
class Effect:
    """Effect of one key on a line: amplitude [N m] at its low and at its high end, the others as
    they are.

    With ``levels`` they are the lowest and the highest of the means over its levels, in whatever
    order these come.
    """

    key: str
    low: float
    high: float
    levels: bool = False

    @property
    def size(self) -> float:
        """How far the amplitude moves."""
        return abs(self.high - self.low)


@dataclass(frozen=True)
class Tornado:
    """Effects on one line, the strongest first."""

    line: str
    centre: float
    effects: tuple[Effect, ...]
    explained: float
    """Part of the variance that the effects explain, R²; nan for one-at-a-time."""
    left_out: int = 0
    """Cases in which the line has no amplitude, of which the effects know nothing."""


@dataclass(frozen=True)
class Indices:
    """Sobol indices of one line, first order and total, per sampled key, with confidence intervals."""

    line: str
    keys: tuple[str, ...]
    first: tuple[Estimate, ...]
    total: tuple[Estimate, ...]
    points: int


def tornado(results: Results, line: str, band: tuple[float, float]) -> Tornado | None:
    """Effect of every key on a line. None where the cases are too few.

    A sampled key goes from its 5 % to its 95 % point: directly in a one-at-a-time sample, else
    along the plane fitted to all cases. A key with levels goes from its lowest to its highest mean.
    """
    design = results.campaign.design
    y = amplitudes(results, line, band)
    if not np.isfinite(y).any():
        return None
    effects = [_between_levels(design, x, y) for x in design.levels]
    explained = math.nan
    if design.uncertain and design.study.sampling.method == "one-at-a-time":
        effects += _one_at_a_time(design, y)
    elif design.uncertain:
        planes = _regression_effects(design, y)
        if planes is None:
            return None
        effects += planes[0]
        explained = planes[1]
    effects.sort(
        key=lambda effect: (not math.isfinite(effect.size), -effect.size)
    )  # what is not known comes last
    left_out = int(np.sum(~np.isfinite(y)))
    return Tornado(line, float(np.nanmean(y)), tuple(effects), explained, left_out)


def _between_levels(design: Design, levels: Levels, y: np.ndarray) -> Effect:
    number, known = design.level_numbers(levels.key), np.isfinite(y)
    means = [float(y[known & (number == k)].mean()) for k in np.unique(number[known])]
    return Effect(levels.key, min(means), max(means), levels=True)


def _one_at_a_time(design: Design, y: np.ndarray) -> list[Effect]:
    """Means over all levels of what each key does alone; a case that failed leaves its end out."""
    means = _means(y.reshape(-1, design.samples.shape[0]).T)
    return [
        Effect(x.key, means[1 + 2 * k], means[2 + 2 * k]) for k, x in enumerate(design.uncertain)
    ]


def _regression_effects(design: Design, y: np.ndarray) -> tuple[list[Effect], float] | None:
    """Effects along the plane through all cases, levels taken out by their means, and the variance
    that it explains.
    """
    d, points = len(design.uncertain), design.samples.shape[0]
    table = y.reshape(-1, points)
    centred = table - np.array(_means(table))[:, None]
    spread = design.samples - design.samples.mean(axis=0)
    scale = spread.std(axis=0)
    X = np.tile(spread / np.where(scale > 0.0, scale, 1.0), (table.shape[0], 1))
    target = centred.ravel()
    good = np.isfinite(target)
    if good.reshape(table.shape).any(axis=0).sum() < MIN_CASES * (
        d + 1
    ):  # a draw seen at many levels is one draw
        return None
    slopes, *_ = np.linalg.lstsq(X[good], target[good], rcond=None)
    total = float(np.sum(target[good] ** 2))
    if total > 0.0:
        explained = 1.0 - float(np.sum((target[good] - X[good] @ slopes) ** 2)) / total
    else:
        explained = math.nan
    centre, effects = float(np.nanmean(y)), []
    for k, x in enumerate(design.uncertain):
        ends = (
            x.quantile(np.array(ONE_AT_A_TIME_QUANTILES)) - design.samples[:, k].mean()
        ) / scale[k]
        effects.append(Effect(x.key, *(centre + slopes[k] * ends)))
    return effects, explained


def _means(rows: np.ndarray) -> list[float]:
    """Mean of the known values of each row; nan where none is known."""
    return [float(np.nanmean(row)) if np.isfinite(row).any() else math.nan for row in rows]


def sobol(results: Results, line: str, band: tuple[float, float]) -> Indices | None:
    """Sobol indices of a line's amplitude (estimator of SciPy); None where the sample is not made
    for them.

    Where a case failed, its point is left out, and then points down to a power of two. With levels
    the variances are added over the combinations.
    """
    design = results.campaign.design
    if design.study.sampling.method != "sobol-indices" or not design.uncertain:
        return None
    y = amplitudes(results, line, band)
    d, n = len(design.uncertain), design.study.sampling.count
    tables = y.reshape(-1, d + 2, n)
    good = np.isfinite(tables).all(axis=(0, 1))
    if good.sum() >= 2:
        points = 1 << (int(good.sum()).bit_length() - 1)
    else:
        points = 0
    if points < 2:
        return None
    kept = tables[:, :, np.flatnonzero(good)[:points]]
    first, total = _indices(kept, points)
    return Indices(line, tuple(x.key for x in design.uncertain), first, total, points)


def _indices(tables: np.ndarray, points: int) -> list[tuple[Estimate, ...]]:
    """First and total order of ``tables`` (combinations, 2 + keys, points), with bootstrap
    intervals; the same each time.
    """
    rng = np.random.default_rng(1)
    drawn = [
        _first_and_total(tables[:, :, rng.integers(points, size=points)], points)
        for _ in range(BOOTSTRAP_SAMPLES)
    ]
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(drawn, [tail, 100.0 - tail], axis=0)  # (2, keys) each
    ends = np.stack([_first_and_total(tables, points), low, high], axis=-1)
    return [tuple(Estimate(*each) for each in order) for order in ends.tolist()]


def _first_and_total(tables: np.ndarray, points: int) -> np.ndarray:
    """Indices (2, keys), first order and total, the combinations weighted with their variances."""
    from scipy.stats import sobol_indices

    f_A, f_B, f_AB = tables[:, 0, :], tables[:, 1, :], np.moveaxis(tables[:, 2:, :], 1, 0)
    found = sobol_indices(func={"f_A": f_A, "f_B": f_B, "f_AB": f_AB}, n=points)
    weight = np.var(np.concatenate([f_A, f_B], axis=1), axis=1)
    if weight.sum() > 0.0:
        weight = weight / weight.sum()
    else:
        weight = np.full(weight.size, 1.0 / weight.size)
    shape = (weight.size, -1)
    return np.stack([weight @ x.reshape(shape) for x in (found.first_order, found.total_order)])
