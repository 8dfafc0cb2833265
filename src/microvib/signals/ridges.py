"""Ridges of a waterfall of spectra over speed: orders, lines of a constant frequency, whirling modes.

A ridge is a path f(W) of frequencies over the speed. Along it, cells that are above a level are
counted; how many there would be by chance follows from how many cells of the whole waterfall are
above that level (binomial distribution). The path with the least chance is taken, its cells are
struck out, and the search goes on until no path is less likely than ``CHANCE`` among all that
were tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from microvib.signals.spectrum import Window, leakage

CHANCE = 1e-3
"""Chance that a waterfall of noise alone has any ridge."""
LEAST_HITS = 5
"""Speeds at which a ridge must be above the floor."""
_SHARES = (3e-2, 1e-2, 1e-3)
"""Shares of cells that are above the levels at which cells are counted."""
_LOWER_LEVELS = np.array([10.0, 30.0, 100.0])
"""Levels above which cells are counted when nothing more is found above those shares."""
FIRST_BIN = 3
"""First bin that is used: those below hold the mean and its leakage."""
_AS_UNLIKELY = 0.95
"""Part of the logarithm of the least chance from which paths are about as unlikely."""
_OF_EITHER_KIND = 0.5
"""Part of it from which an order that is stronger than a line is taken for it."""
_LEAST_LOG = -700.0
"""Logarithm of the smallest chance that is told from others."""
_MOST_STEPS = 20
_LED_AWAY = 3.0
"""Half bins at the highest speed by which an order is elsewhere than the path that it was found on."""
_MOST_RIDGES = 200
_RATIO_STEP = 0.04
"""Step of the ratio of moments of inertia among whirling modes that are tried."""
_STEADY = 1.5
"""Bins by which a line may move during a spectrum that tells its order, or times what the quarter of the
steadiest spectra have."""
GROWTH_UNKNOWN = 0.4
"""Part of the correction for the growth of a line during a spectrum that is a standard uncertainty
(assumed)."""
_APART = 3
"""Bins by which backward and forward whirl must differ to be counted as two."""


@dataclass(frozen=True)
class PowerMap:
    """Powers of spectra over speed."""

    speed: np.ndarray
    """Ascending [rad/s], (n,)."""
    frequency: np.ndarray
    """Evenly spaced [Hz], (m,)."""
    power: np.ndarray
    """By bin, (n, m): those of a line sum to half of its squared amplitude."""
    lobe: int
    """Bins on either side of a line that hold its power."""
    spread: np.ndarray | None = None
    """By how much the speed changes during a spectrum [rad/s], (n,); None where it does not."""
    axes: tuple[np.ndarray, ...] = ()
    """Powers of either axis, each (n, m), where these are the mean of two; else none."""
    centre: np.ndarray | None = None
    """Speed [rad/s] at the mean frequency of a line whose amplitude goes with the square of the speed, (n,);
    None where the speed does not change during a spectrum."""
    window: Window = "hann"
    """Window of the spectra, whose side lobes are no ridges."""

    @property
    def of_axes(self) -> tuple[PowerMap, ...]:
        """The map of either axis alone; none where it is of one."""
        return tuple(replace(self, power=power, axes=()) for power in self.axes)

    def up_to_bin(self, count: int) -> PowerMap:
        """The map of its first bins alone."""
        return replace(
            self, frequency=self.frequency[:count], power=self.power[:, :count],
            axes=tuple(power[:, :count] for power in self.axes),
        )  # fmt: skip

    @property
    def smear(self) -> np.ndarray:
        """By how much the speed changes during a spectrum [rad/s], (n,)."""
        if self.spread is None:
            return np.zeros(self.speed.size)
        return self.spread

    @property
    def centre_of_lines(self) -> np.ndarray:
        """Speed [rad/s] at the mean frequency of a line, (n,)."""
        return self.speed if self.centre is None else self.centre

    @property
    def spacing(self) -> float:
        """Distance of the bins [Hz]."""
        return float((self.frequency[-1] - self.frequency[0]) / (self.frequency.size - 1))

    @cached_property
    def averages(self) -> float:
        """Independent spectra that each power is the mean of, by the scatter of the floor."""
        from scipy.stats import gamma

        ratio = (self.power / self._median)[:, FIRST_BIN:]
        logs = np.log(ratio[ratio > 0.0])  # spectra or bins of zeros are of no noise
        spread = float(np.subtract(*np.percentile(logs, [75, 25])))
        trial = np.geomspace(0.5, 2000.0, 120)
        wanted = np.log(gamma.ppf(0.75, trial) / gamma.ppf(0.25, trial))
        return float(np.exp(np.interp(-spread, -wanted, np.log(trial))))

    @cached_property
    def _median(self) -> np.ndarray:
        """Median of the powers about each, over frequency, (n, m)."""
        from scipy.ndimage import median_filter

        width = int(min(max(41, self.frequency.size // 12), 201)) | 1
        found = median_filter(self.power, size=(1, width), mode="reflect")
        return np.asarray(np.maximum(found, 1e-12 * float(self.power.max(initial=0.0)) + 1e-300))

    @cached_property
    def floor(self) -> np.ndarray:
        """Mean power of the noise in each bin, (n, m)."""
        from scipy.stats import gamma

        K = self.averages
        return self._median * (K / float(gamma.ppf(0.5, K)))

    @cached_property
    def level(self) -> np.ndarray:
        """Powers over the floor, (n, m)."""
        return np.asarray(self.power / self.floor)

    def bins(self, frequency: np.ndarray) -> np.ndarray:
        """Nearest bins; -1 where there is none."""
        found = np.rint((frequency - self.frequency[0]) / self.spacing)
        inside = (found >= FIRST_BIN) & (found < self.frequency.size)
        return np.where(inside, found, -1.0).astype(np.int32)


@dataclass(frozen=True)
class Ridge:
    """A ridge that was found."""

    kind: str
    """*order*, *line* of a constant frequency, or *whirl*."""
    values: tuple[float, ...]
    """The order; the frequency [Hz]; frequency at rest [Hz] and ratio of moments of inertia."""
    uncertainty: float
    """Standard uncertainty of the order or of the frequency."""
    width: float
    """Width of a line or a mode at half of its power, the resolution among it [Hz]."""
    seen: tuple[int, ...]
    """Speeds at which each map has it above the floor."""
    chance: float
    """Decimal logarithm of the chance that noise makes it."""


@dataclass(frozen=True)
class RidgeSearch:
    """Ridges of some maps, and what is left of these."""

    ridges: tuple[Ridge, ...]
    """The most certain first."""
    of_no_order: np.ndarray
    """Cells of lines of a constant frequency and of whirl, (maps, n, m)."""


def find_ridges(maps: Sequence[PowerMap]) -> RidgeSearch:
    """Ridges of maps of the same speeds and frequencies."""
    search = _Search(maps)
    found: list[Ridge] = []
    while len(found) < _MOST_RIDGES:
        one = search.best()
        if one is None and search.lines_too:
            search.look_lower()
        elif one is None:
            break
        else:
            found.append(one)
    return RidgeSearch(tuple(found), search.of_no_order)


_PORTION = 4096
"""Paths that are tried at a time."""


def _portions(count: int) -> Iterator[slice]:
    return (slice(k, k + _PORTION) for k in range(0, count, _PORTION))


def _least_chance(
    bins: np.ndarray, free: np.ndarray, above: np.ndarray, tails: Sequence[np.ndarray]
) -> np.ndarray:
    """The least of the logarithms of chances by all levels along paths (k, n), (k,)."""
    rows = np.arange(bins.shape[1])
    valid = (bins >= 0) & free[rows, bins]
    count, best = valid.sum(axis=1), np.zeros(len(bins))
    for level, tail in zip(above, tails, strict=True):
        hits = (level[rows, bins] & valid).sum(axis=1)
        best = np.minimum(best, np.where(hits >= LEAST_HITS, tail[hits, count], 0.0))
    return best


def _log_tail(most: int, share: float) -> np.ndarray:
    """Logarithm of the chance of so many hits or more among a count, for all up to ``most``, (most + 1,
    most + 1).
    """
    from scipy.stats import binom

    number = np.arange(most + 1)
    return np.asarray(binom.logsf(number[:, None] - 1, number, min(share, 1.0)))


def whirl_paths(frequency: np.ndarray, ratio: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Frequencies [Hz] of backward and forward whirl of modes (k,) at speeds (n,) [rad/s], (2, k,
    n).
    """
    half = ratio[:, None] * speed / (4.0 * np.pi)
    root = np.hypot(half, frequency[:, None])
    return np.array([root - half, root + half])


def is_steady(one: PowerMap, order: float) -> np.ndarray:
    """Spectra of a map during which the line of an order does not move much farther than during others, (n,)."""
    smear = order * one.smear / (2.0 * np.pi * one.spacing)
    return np.asarray(smear <= max(_STEADY * float(np.quantile(smear, 0.25)), _STEADY))


class _Search:
    def __init__(self, maps: Sequence[PowerMap]) -> None:
        self.maps = list(maps)
        one = self.maps[0]
        self.one, self.turns = one, one.speed / (2.0 * np.pi)
        self.free = np.ones((len(self.maps), *one.power.shape), dtype=bool)
        self.free[:, :, :FIRST_BIN] = False
        self.of_no_order = np.zeros(self.free.shape, dtype=bool)
        self.floor = [x.floor.copy() for x in self.maps]
        """Floors with what leaks from the ridges that were found, (n, m) each."""
        self.levels = [
            np.quantile(x.level[:, FIRST_BIN:], 1.0 - np.array(_SHARES)) for x in self.maps
        ]
        self.above = np.zeros((len(self.maps), len(_SHARES), *one.power.shape), dtype=bool)
        for k in range(len(self.maps)):
            self._count_above(k)
        self.lines_too = True
        step = 0.5 * one.spacing / float(self.turns[-1])
        top = one.frequency[-1] / np.sort(self.turns)[min(LEAST_HITS, self.turns.size) - 1]
        self.orders = np.arange(max(step, 2.0 * step), min(top, 100.0), step)
        self.order_bins = one.bins(self.orders[:, None] * self.turns)
        f0 = one.frequency[FIRST_BIN + 1 :: 1]
        r = np.arange(_RATIO_STEP, 2.0 + 0.5 * _RATIO_STEP, _RATIO_STEP)
        self.modes = np.array(np.meshgrid(f0, r, indexing="ij")).reshape(2, -1)
        self.tests = len(self.maps) * len(_SHARES)
        self.wanted = np.log(CHANCE / 3.0)

    def _chances(self, bins: np.ndarray) -> np.ndarray:
        """Logarithms of the chance that each map has so many cells above a level along paths
        (k, n), (maps, k).
        """
        found = np.zeros((len(self.maps), len(bins)))
        for k, (free, above) in enumerate(zip(self.free, self.above, strict=True)):
            tails = [self._tail(level, free) for level in above]
            for some in _portions(len(bins)):
                found[k, some] = _least_chance(bins[some], free, above, tails)
        return found

    def _tail(self, above: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Chances of counts of cells above a level, by how many there are."""
        share = (np.count_nonzero(above & free) + 1.0) / (np.count_nonzero(free) + 1.0)
        return _log_tail(self.turns.size, share)

    def look_lower(self) -> None:
        """Go on with orders alone, at lower levels: strong lines of wide lobes are on more cells than the shares that
        levels are by, which are then above weaker lines.
        """
        self.lines_too = False
        for k in range(len(self.maps)):
            self.levels[k] = np.minimum(self.levels[k], _LOWER_LEVELS)
            self._count_above(k)

    def _count_above(self, k: int) -> None:
        """Cells of a map that are above its levels, with its floor as it is."""
        level = self.maps[k].power / self.floor[k]
        self.above[k] = [level > t for t in self.levels[k]]

    def best(self) -> Ridge | None:
        """The next ridge, which is struck out; None where nothing is left."""
        columns = np.tile(np.arange(self.one.frequency.size)[:, None], self.turns.size)
        columns[:FIRST_BIN] = -1
        each = {
            "order": (self.order_bins, self._chances(self.order_bins).min(axis=0)),
            "line": (columns, self._chances(columns).min(axis=0)),
        }
        if not self.lines_too:
            del each["line"]
        found = []
        for kind, (paths, chances) in each.items():
            k, _ = self._strongest(
                paths, chances, _AS_UNLIKELY * max(float(chances.min()), _LEAST_LOG)
            )
            found.append((float(chances[k]) + np.log(self.tests * len(paths)), kind, k))
        chance, kind, k = min(found)
        if chance >= self.wanted:
            return self._whirl() if self.lines_too else None
        if kind == "order":
            return self._order(k, chance)
        # Of an order and a line that are both unlikely, the stronger one: lobes are wide, and both are on them.
        part = _OF_EITHER_KIND * max(chance, _LEAST_LOG)
        strengths = {kind: self._strongest(*of_kind, part) for kind, of_kind in each.items()}
        if strengths["order"][1] > strengths["line"][1]:
            return self._order(strengths["order"][0], chance)
        return self._line(k, chance)

    def _strongest(self, paths: np.ndarray, chances: np.ndarray, most: float) -> tuple[int, float]:
        """The path of the highest levels among those of a chance of ``most`` and less, and the sum of their
        logarithms: a strong line is wide. None is -inf.
        """
        near = np.flatnonzero(chances <= most)
        if not near.size:
            return 0, -np.inf
        rows, best = np.arange(self.turns.size), np.full(near.size, -np.inf)
        for one, free in zip(self.maps, self.free, strict=True):
            bins = paths[near]
            valid = (bins >= 0) & free[rows, bins]
            logs = np.log(np.maximum(one.level[rows, bins], 1.0))
            best = np.maximum(best, np.sum(np.where(valid, logs, 0.0), axis=1))
        strongest = int(np.argmax(best))
        return int(near[strongest]), float(best[strongest])

    def _order(self, k: int, chance: float) -> Ridge:
        order, uncertainty = self._centred_order(float(self.orders[k]))
        bins = self.one.bins(order * self.turns)
        seen = self._seen(bins)
        self._strike(bins)
        self._strike(self.order_bins[k])
        smear = order * self.one.smear / (2.0 * np.pi * self.one.spacing)
        self._let_leak(order * self.turns, smear)
        return Ridge("order", (order,), uncertainty, 0.0, seen, chance / np.log(10.0))

    def _centred_order(self, first: float) -> tuple[float, float]:
        """The order whose lines have their centres on its path, from a ``first`` one on, and its standard
        uncertainty.

        The first is within half a bin at all speeds. Centres that lead away from it are of two orders that
        share bins at low speeds.
        """
        step = 0.5 * self.one.spacing / float(self.turns[-1])
        order = first
        for _ in range(_MOST_STEPS):
            before = order
            order, uncertainty = self._centre(self.one.bins(order * self.turns), order)
            if abs(order - first) > _LED_AWAY * step:
                return first, step
            if abs(order - before) < 0.1 * uncertainty:
                break
        return order, uncertainty

    def _line(self, k: int, chance: float) -> Ridge:
        bins = np.full(self.turns.size, k)
        seen = self._seen(bins)
        widths = self._strike(bins, of_no_order=True)
        f = float(self.one.frequency[k])
        self._let_leak(np.full(self.turns.size, f), np.zeros(self.turns.size))
        return Ridge(
            "line", (f,), 0.3 * self.one.spacing, widths * self.one.spacing, seen, chance / np.log(10.0)
        )  # fmt: skip

    def _let_leak(self, path: np.ndarray, smear: np.ndarray) -> None:
        """Raise the floors by what leaks from lines along a ``path`` (n,) [Hz] that move by ``smear`` (n,) [bins]
        during a spectrum.
        """
        at = (path - self.one.frequency[0]) / self.one.spacing
        for k, one in enumerate(self.maps):
            for i in np.flatnonzero(one.bins(path) >= 0).tolist():
                distance = np.abs(np.arange(one.frequency.size) - at[i]) - 0.5 * smear[i]
                near = distance <= one.lobe + 0.5
                power = max(float(np.sum((one.power[i] - one.floor[i])[near])), 0.0)
                self.floor[k][i] += power * leakage(one.window, distance)
            self._count_above(k)

    def _branches(self, modes: np.ndarray) -> list[np.ndarray]:
        """Bins of backward and forward whirl of modes (2, k), where these are apart, (k, n) each."""
        back, forth = (self.one.bins(x) for x in whirl_paths(modes[0], modes[1], self.one.speed))
        return [back, np.where(np.abs(forth - back) >= _APART, forth, -1)]

    def _best_mode(self, modes: np.ndarray) -> tuple[int, float, float]:
        """The mode whose whirl is least likely noise, the logarithm of that chance, and of that of its
        less certain branch.
        """
        both, weaker = [], []
        for some in _portions(modes.shape[1]):
            each = [self._chances(bins) for bins in self._branches(modes[:, some])]
            both.append((each[0] + each[1]).min(axis=0))
            weaker.append(np.max([x.min(axis=0) for x in each], axis=0))
        chances = np.concatenate(both)
        k = int(np.argmin(chances))
        return k, float(chances[k]), float(np.concatenate(weaker)[k])

    def _whirl(self) -> Ridge | None:
        k, chance, weaker = self._best_mode(self.modes)
        chance += np.log(self.tests * self.modes.shape[1])
        if chance >= self.wanted or weaker > np.log(0.01):
            return None
        f0, ratio = self.modes[:, k]
        near = np.meshgrid(
            f0 + self.one.spacing * np.linspace(-2.0, 2.0, 17),
            ratio + _RATIO_STEP * np.linspace(-1.0, 1.0, 17),
            indexing="ij",
        )
        fine = np.array(near).reshape(2, -1)
        f0, ratio = (float(x) for x in fine[:, self._best_mode(fine)[0]])
        seen, width = np.zeros(len(self.maps), dtype=int), 0.0
        for bins in self._branches(np.array([[f0], [ratio]])):
            seen += self._seen(bins[0])
            width = max(width, self._strike(bins[0], of_no_order=True))
        return Ridge(
            "whirl", (f0, ratio), self.one.spacing, width * self.one.spacing,
            tuple(seen.tolist()), chance / np.log(10.0),
        )  # fmt: skip

    def _seen(self, bins: np.ndarray) -> tuple[int, ...]:
        rows, valid = np.arange(bins.size), bins >= 0
        return tuple(
            int(np.sum(above[1][rows, bins] & valid & free[rows, bins]))
            for above, free in zip(self.above, self.free, strict=True)
        )

    def _centre(self, bins: np.ndarray, order: float) -> tuple[float, float]:
        """The order by the centres of its cells, and its standard uncertainty.

        Spectra during which its line moves much farther than during others are left out. Where a line
        does not grow with the square of the speed, as near a mode, its centre is elsewhere by about the
        correction for that growth, a part of which is in the uncertainty.
        """
        smear = order * self.one.smear / (2.0 * np.pi * self.one.spacing)
        steady = is_steady(self.one, order)
        turns = self.one.centre_of_lines / (2.0 * np.pi)
        found, weights, corrected = [], [], []
        for one, free in zip(self.maps, self.free, strict=True):
            for i in np.flatnonzero((bins >= 0) & steady):
                reach = 2 + math.ceil(0.5 * smear[i])
                near = bins[i] + np.arange(-reach, reach + 1)
                if near[0] < 0 or near[-1] >= one.frequency.size or not free[i, near].all():
                    continue
                level = one.level[i, near]
                if level.max() < 6.0 + 6.0 / np.sqrt(one.averages):
                    continue
                power = np.maximum(one.power[i, near] - one.floor[i, near], 0.0)
                f = float(power @ one.frequency[near] / power.sum())
                found.append(f / turns[i])
                weights.append(min(float(level.max()), 100.0) * turns[i] ** 2)
                corrected.append(turns[i] / self.turns[i] - 1.0)
        if len(found) < 3:
            return order, 0.5 * self.one.spacing / float(self.turns[-1])
        values, w = np.array(found), np.array(weights) / np.sum(weights)
        mean = float(w @ values)
        # Spectra that overlap by half, and loads of one run, are not independent.
        scatter = math.sqrt(2.0 * len(self.maps) * float(w**2 @ (values - mean) ** 2))
        of_growth = GROWTH_UNKNOWN * mean * abs(float(w @ corrected))
        least = 0.01 * self.one.spacing / self.turns[-1]
        return mean, max(math.hypot(scatter, of_growth), least)

    def _strike(self, bins: np.ndarray, *, of_no_order: bool = False) -> float:
        """Strike out the cells of a path, down to the floor or the next rise on either side; the median
        of how wide it is, in bins.
        """
        widths = []
        for k, one in enumerate(self.maps):
            for i in np.flatnonzero(bins >= 0):
                low, high = _foot(one.level[i], int(bins[i]), one.lobe)
                self.free[k, i, low : high + 1] = False
                self.of_no_order[k, i, low : high + 1] |= of_no_order
                half = 0.5 * one.level[i, low : high + 1].max()
                widths.append(int(np.sum(one.level[i, low : high + 1] >= half)))
        return float(np.median(widths)) if widths else 0.0


_MOST_REACH = 25


def _foot(level: np.ndarray, at: int, lobe: int) -> tuple[int, int]:
    """Bins between which a peak stands above the floor, (low, high)."""
    near = slice(max(at - lobe, 0), min(at + lobe + 1, level.size))
    top = near.start + int(np.argmax(level[near]))
    ends = []
    for way in (-1, 1):
        k = top
        while (
            0 <= k + way < level.size
            and abs(k + way - top) <= _MOST_REACH
            and level[k + way] > 2.0
            and level[k + way] <= 1.2 * level[k]
        ):
            k += way
        ends.append(k)
    low = min(ends[0], at - lobe)
    high = max(ends[1], at + lobe)
    return max(low, 0), min(high, level.size - 1)
