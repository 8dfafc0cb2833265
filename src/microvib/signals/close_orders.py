"""Orders of a waterfall where their lines are, told from others that share their bins.

The search for ridges takes an order by the centre of its cells, and two orders that share bins for one between
them. Here the powers of each spectrum are described by the lines of all orders at once, each of the shape that
the window gives it, and each order is asked whether two lines describe its cells much better than one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from microvib.signals.ridges import (
    FIRST_BIN,
    GROWTH_UNKNOWN,
    PowerMap,
    Ridge,
    RidgeSearch,
    is_steady,
)
from microvib.signals.spectrum import LineShape, line_shape

_STEP, _REACH, _BEYOND_LOBE = 0.2, 4.0, 2.0
"""Step of the pairs of orders that are tried, and how far they go at least, and beyond the bins that hold a line's power,
in bins at the highest speed.
"""
_FINER, _HALF = (1.0, 0.2, 0.05), 10
"""Bins at the highest speed within which orders are sought, one after the other, and steps to either side."""
_SHIFTS = np.linspace(-0.5, 0.5, 9)
"""Bins by which the speed of a spectrum may be off for its own lines, while shapes are compared."""
_SHAPE_ERROR, _ERROR_OF_OTHERS = 0.01, 0.05
"""Part of the largest power of an order's cells that its shape is not known better than, and part of the power
of others in a cell (assumed)."""
_BETTER = 0.6
"""Part of the misfit of one line below which that of two is, where an order is two."""
_BY_NOISE = 50.0
"""Difference of the misfit of one and of two that noise does not make."""
_TWO = 0.9
"""Bins at the highest speed from which two lines are two orders; nearer ones are one with an error."""
_ALLOWED = 9.0
"""By how much the misfit with another line is above the least one, where it is excluded."""
_SHARES, _LARGE_SHARE = (1.0, 0.3, 0.1, 0.03, 0.01), 0.1
"""Parts of its power that a line beside an order is tried with, and from which it is asked for where nothing shows
it."""
_SIGMAS = 4.0
"""Standard uncertainties within which an order is told to be."""
_LEAST_ERROR = 0.02
"""Least standard uncertainty of an order, in bins at the highest speed (assumed)."""
_MOST_ERROR = 0.09
"""Part of an order by which lines that its cells do not exclude are looked for."""
_SHOWN = 6.0
"""Level from which the cells of a spectrum show an order."""
_MOST_SPECTRA = 60
"""Spectra that pairs of lines are tried in: those of the highest speeds."""
_TWO_SIDED = 1.96
"""Standard deviations within which 95 % of a normal distribution are."""
_BLOCKS, _LEAST_SPECTRA = 8, 3


def told_apart(maps: Sequence[PowerMap], search: RidgeSearch) -> RidgeSearch:
    """Ridges whose orders are where their lines are; one that two lines describe better becomes two, and one
    that is nothing beside the others is left out.

    Parameters
    ----------
    maps : sequence of PowerMap
        On one grid of speeds and frequencies.
    search : RidgeSearch
        What ``find_ridges`` makes of these maps.

    Returns
    -------
    RidgeSearch
        With uncertainties of orders by the scatter over speeds, and by the distance of two lines that the
        shape of its cells does not exclude.
    """
    orders = [x for x in search.ridges if x.kind == "order"]
    if not orders:
        return search
    found = _Orders(maps, search.of_no_order, orders)
    found.move()
    while found.split():
        pass
    found.join()
    found.move()
    found.widen_errors()
    others = [x for x in search.ridges if x.kind != "order"]
    return replace(search, ridges=(*found.ridges, *others))


def powers_apart(one: PowerMap, orders: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Powers of orders in each spectrum of a map by the lines of all at once, and what the others have in the bins
    of each, (n, orders) both.
    """
    none = np.zeros(one.power.shape, dtype=bool)
    powers, beside = (np.zeros((one.speed.size, len(orders))) for _ in range(2))
    for row in range(one.speed.size):
        spectrum = _Spectrum(one, row, none)
        powers[row] = spectrum.powers(orders)
        for k, order in enumerate(orders):
            bins = spectrum.near(order, one.lobe)
            others = [j for j in range(len(orders)) if j != k and powers[row, j] > 0.0]
            for j in others:
                beside[row, k] += powers[row, j] * float(np.sum(spectrum.line(orders[j], bins)))
    return powers, beside


class _Spectrum:
    """One spectrum of a map, in bins."""

    def __init__(self, one: PowerMap, row: int, of_no_order: np.ndarray) -> None:
        self.one = one
        self.turns = float(one.centre_of_lines[row]) / (2.0 * math.pi * one.spacing)
        """Bins of the first order, from 0 Hz."""
        self.smear = float(one.smear[row]) / (2.0 * math.pi * one.spacing)
        """Bins by which the first order moves during the spectrum."""
        self.growth = abs(float(one.centre_of_lines[row] / one.speed[row]) - 1.0)
        """Part by which the growth of lines moves their centres."""
        self.first = float(one.frequency[0]) / one.spacing
        self.floor = one.floor[row]
        self.power = one.power[row] - self.floor
        """Above the floor, (m,)."""
        self.free = ~of_no_order[row]
        self.free[:FIRST_BIN] = False

    def at(self, order: np.ndarray) -> np.ndarray:
        """Places of orders [bins]."""
        return np.asarray(order * self.turns - self.first)

    def shape(self, order: float) -> LineShape:
        """Shape of the line of an order."""
        return line_shape(self.one.window, order * self.smear, self.smear / self.turns)

    def line(self, order: float, bins: np.ndarray) -> np.ndarray:
        """Powers of the line of an order in some bins, over its whole power."""
        return self.shape(order)(bins - self.at(np.array(order)))

    def near(self, order: float, reach: float) -> np.ndarray:
        """Bins up to a ``reach`` beside the line of an order that may be an order's; none where some are outside
        of the map.
        """
        at, wide = float(self.at(np.array(order))), reach + 0.5 * order * self.smear
        low, high = math.floor(at - wide), math.ceil(at + wide)
        if low < 0 or high >= self.power.size:
            return np.zeros(0, dtype=int)
        found = np.arange(low, high + 1)
        return np.asarray(found[self.free[found]])

    def powers(self, orders: Sequence[float]) -> np.ndarray:
        """Power of each order, by the cells of all of them."""
        from scipy.optimize import nnls

        each = [self.near(x, self.one.lobe) for x in orders]
        cells = np.unique(np.concatenate(each))
        if not cells.size:
            return np.zeros(len(orders))
        shapes = np.array([self.line(x, cells) for x in orders]).T
        power = self.power[cells]
        weight = 1.0 / (self.floor[cells] + _ERROR_OF_OTHERS * np.maximum(power, 0.0))
        return np.asarray(nnls(shapes * weight[:, None], power * weight)[0])


@dataclass(frozen=True)
class _Cells:
    """Cells of a spectrum about an order, less what others have there."""

    spectrum: _Spectrum
    bins: np.ndarray
    power: np.ndarray
    weight: np.ndarray
    """Inverse of the variance of the power."""
    level: float
    """Largest power over the floor and what is not known of others."""

    @classmethod
    def of(cls, spectrum: _Spectrum, orders: Sequence[float], others: dict[float, float]) -> _Cells:
        """About some orders, with the powers of ``others``."""
        each = [spectrum.near(x, spectrum.one.lobe + _reach(spectrum.one)) for x in orders]
        bins = np.unique(np.concatenate(each)) if all(x.size for x in each) else each[0][:0]
        beside = np.zeros(bins.size)
        for other, power in others.items():
            beside += power * spectrum.line(other, bins)
        floor, K = spectrum.floor[bins], spectrum.one.averages
        power = spectrum.power[bins] - beside
        largest = float(np.max(power, initial=0.0))
        of_noise = (1.5 * floor**2 + 2.0 * floor * np.maximum(spectrum.power[bins], 0.0)) / K
        of_phases = 2.0 * beside * np.maximum(power, 0.0)  # amplitudes add by phases, not powers
        variance = (
            of_noise + (_SHAPE_ERROR * largest) ** 2 + (_ERROR_OF_OTHERS * beside) ** 2 + of_phases
        )
        paths, wide = spectrum.at(np.array(orders)), 1.0 + 0.5 * orders[0] * spectrum.smear
        close = np.any(np.abs(bins - paths[:, None]) <= wide, axis=0)
        level = np.max((power / (floor + 2.0 * _ERROR_OF_OTHERS * beside))[close], initial=0.0)
        return cls(spectrum, bins, power, 1.0 / variance, float(level))

    @property
    def is_shown(self) -> bool:
        """Whether a line is seen there."""
        K = self.spectrum.one.averages
        return self.bins.size >= 5 and self.level >= _SHOWN + _SHOWN / math.sqrt(K)

    @property
    def square(self) -> float:
        """Misfit without any line."""
        return float(self.weight @ self.power**2)

    def products(self, orders: np.ndarray, shift: float) -> tuple[np.ndarray, np.ndarray]:
        """Products of the lines of orders (k,) with each other, (k, k), and with the powers, (k,)."""
        shape = self.spectrum.shape(float(np.median(orders)))
        lines = shape(self.bins[:, None] - (self.spectrum.at(orders) + shift))
        weighted = lines * self.weight[:, None]
        return lines.T @ weighted, weighted.T @ self.power

    def alone(self, orders: np.ndarray, shift: float = 0.0) -> np.ndarray:
        """Misfit of one line of each of some orders, (k,)."""
        squares, own = self.products(orders, shift)
        return np.asarray(self.square - np.maximum(own, 0.0) ** 2 / np.diag(squares))

    def in_pairs(self, orders: np.ndarray, shift: float = 0.0) -> np.ndarray:
        """Misfit of two lines of powers above 0 of each pair of some orders, (k, k); of one where that is not
        above 0.
        """
        squares, own = self.products(orders, shift)
        d = np.diag(squares)
        alone = self.square - np.maximum(own, 0.0) ** 2 / d
        either = np.minimum(alone[:, None], alone[None, :])
        determinant = d[:, None] * d[None, :] - squares**2
        apart = determinant > 1e-6 * d[:, None] * d[None, :]
        determinant = np.where(apart, determinant, 1.0)
        first = (own[:, None] * d[None, :] - own[None, :] * squares) / determinant
        both = self.square - first * own[:, None] - first.T * own[None, :]
        return np.where(apart & (first > 0.0) & (first.T > 0.0), both, either)

    def misfit(self, tried: np.ndarray) -> np.ndarray:
        """Misfit of one line of each order ``tried`` (1, k), (k,), or of two lines (2, k), (k, k)."""
        if len(tried) == 1:
            return self.alone(tried[0])
        count = tried.shape[1]
        return self.in_pairs(tried.ravel())[:count, count:]

    def beside(
        self, order: float, away: np.ndarray, shares: np.ndarray, shift: float
    ) -> np.ndarray:
        """Misfit of a line with another at distances ``away`` (k,), of ``shares`` (s,) of its power, (s, k)."""
        squares, own = self.products(np.concatenate([[order], order + away]), shift)
        cross, d = squares[0, 1:], np.diag(squares)[1:]
        power = squares[0, 0] + 2.0 * shares[:, None] * cross + shares[:, None] ** 2 * d
        product = np.maximum(own[0] + shares[:, None] * own[1:], 0.0)
        return np.asarray(self.square - product**2 / power)


class _OneOrTwo(NamedTuple):
    """Least misfit of an order's cells in all spectra, whose speeds may be off."""

    one: float
    """Misfit of the best single line."""
    two: float
    """Misfit of the best two."""
    pair: tuple[float, float]
    """These two."""

    @property
    def are_two(self) -> bool:
        """Whether two lines describe the cells much better than one, by more than noise makes of it."""
        return self.two < _BETTER * self.one and self.one - self.two > _BY_NOISE


def _one_or_two(cells: Sequence[_Cells], orders: np.ndarray) -> _OneOrTwo:
    """Least misfit of single lines of some ``orders`` (k,), and of all pairs of these."""
    single = sum(np.min([x.alone(orders, y) for y in _SHIFTS], axis=0) for x in cells)
    pairs = sum(np.min([x.in_pairs(orders, y) for y in _SHIFTS], axis=0) for x in cells)
    a, b = np.unravel_index(int(np.argmin(pairs)), pairs.shape)
    pair = (float(orders[min(a, b)]), float(orders[max(a, b)]))
    return _OneOrTwo(float(np.min(single)), float(np.min(pairs)), pair)


def _hidden_distance(cells: Sequence[_Cells], order: float, step: float, reach: float) -> float:
    """Largest distance from an ``order``, up to a ``reach``, at which its cells do not exclude another line.

    One of a large part of its power anywhere that describes them about as well as the best; one of a smaller
    part where they are not described as well without it.
    """
    most = max(math.floor(reach / step), 1)
    away = step * np.arange(-most, most + 1)
    shares = np.array(_SHARES)
    misfit = sum(np.min([x.beside(order, away, shares, y) for y in _SHIFTS], axis=0) for x in cells)
    alone = float(sum(np.min([x.alone(np.array([order]), y) for y in _SHIFTS]) for x in cells))
    count = sum(one.bins.size - 2 for one in cells)
    least = min(float(np.min(misfit)), alone)
    allowed = least + _ALLOWED * max(1.0, least / count)
    open_ = misfit <= allowed
    if alone <= allowed:
        open_ &= (shares >= _LARGE_SHARE)[:, None]
    farthest = float(np.max(np.abs(away)[open_.any(axis=0)], initial=0.0))
    return farthest + step if farthest > step else farthest


def _reach(one: PowerMap) -> float:
    """Bins at the highest speed up to which an order may hide another."""
    return max(_REACH, one.lobe + _BEYOND_LOBE)


class _Orders:
    """Orders of some maps, which are bettered step by step."""

    def __init__(
        self, maps: Sequence[PowerMap], of_no_order: np.ndarray, ridges: Sequence[Ridge]
    ) -> None:
        self._maps = maps
        self._bin = 2.0 * math.pi * maps[0].spacing / float(maps[0].speed[-1])
        """A bin at the highest speed, in orders."""
        self._reach = _reach(maps[0])
        self._spectra = [
            [_Spectrum(one, row, masked) for row in range(one.speed.size)]
            for one, masked in zip(maps, of_no_order, strict=True)
        ]
        self._set({x.values[0]: x for x in ridges})

    def _set(self, ridges: Mapping[float, Ridge]) -> None:
        """Take ridges by their orders, with their powers in all spectra."""
        self._ridges, orders = dict(ridges), list(ridges)
        self._powers = [
            [dict(zip(orders, x.powers(orders), strict=True)) for x in each]
            for each in self._spectra
        ]

    @property
    def ridges(self) -> list[Ridge]:
        """Their ridges."""
        return list(self._ridges.values())

    def _cells(self, *orders: float) -> list[_Cells]:
        """Cells that show some orders, of the highest speed first."""
        found = []
        for one, spectra, powers in zip(self._maps, self._spectra, self._powers, strict=True):
            for k in np.flatnonzero(is_steady(one, max(orders))).tolist():
                others = {x: p for x, p in powers[k].items() if x not in orders and p > 0.0}
                cells = _Cells.of(spectra[k], orders, others)
                if cells.is_shown:
                    found.append(cells)
        return sorted(found, key=lambda x: -x.spectrum.turns)

    def split(self) -> bool:
        """Make two of the order that one line describes worst; whether there are more orders then."""
        before = len(self._ridges)
        found = [
            (gain, order, pair)
            for order in self._ridges
            for gain, pair in self._pairs(order)
            if pair[1] - pair[0] >= _TWO * self._bin
        ]
        if not found:
            return False
        _, order, pair = max(found)
        ridges = dict(self._ridges)
        ridge = ridges.pop(order)
        self._set(ridges | {x: replace(ridge, values=(x,)) for x in pair})
        self.move()
        self.join()
        return len(self._ridges) > before

    def widen_errors(self) -> None:
        """Let the errors of orders hold lines beside them that their cells do not exclude."""
        for order, ridge in self._ridges.items():
            cells = self._cells(order)[:_MOST_SPECTRA]
            if len(cells) < _LEAST_SPECTRA:
                continue
            reach = min(
                [
                    self._reach * self._bin,
                    *(0.5 * abs(x - order) for x in self._ridges if x != order),
                ]
            )
            away = [_hidden_distance(cells, order, _STEP * self._bin, reach)]
            away += [abs(x - order) for _, pair in self._pairs(order) for x in pair]
            error = max(ridge.uncertainty, min(max(away), _MOST_ERROR * order) / _SIGMAS)
            self._ridges[order] = replace(ridge, uncertainty=error)

    def _pairs(self, order: float) -> Iterator[tuple[float, tuple[float, float]]]:
        """Two orders that describe the cells of one much better, and by how much; none where they do not."""
        cells = self._cells(order)[:_MOST_SPECTRA]
        if len(cells) < _LEAST_SPECTRA:
            return
        tried = order + np.arange(-self._reach, self._reach + 0.5 * _STEP, _STEP) * self._bin
        found = _one_or_two(cells, tried[tried > 0.0])
        if not found.are_two:
            return
        others = [x for x in self._ridges if x != order]
        if all(abs(x - y) >= _TWO * self._bin for x in found.pair for y in others):
            yield found.one - found.two, found.pair

    def join(self) -> None:
        """Leave out the weaker of two orders that are one, and orders that others leave nothing of."""
        kept: dict[float, Ridge] = {}
        for order in sorted(self._ridges, key=self._power_of, reverse=True):
            if all(abs(order - x) >= _TWO * self._bin for x in kept) and self._is_there(order):
                kept[order] = self._ridges[order]
        self._set(kept)

    def _power_of(self, order: float) -> float:
        return float(sum(x[order] for each in self._powers for x in each))

    def _is_there(self, order: float) -> bool:
        """Whether an order is shown, or nothing is near that would hide it."""
        alone = self._beside(order) is None
        return alone or len(self._cells(order)) >= _LEAST_SPECTRA

    def _beside(self, order: float) -> float | None:
        """The nearest other order, if its line is in the cells of an order."""
        others = [x for x in self._ridges if x != order]
        nearest = min(others, key=lambda x: abs(x - order), default=math.inf)
        return nearest if abs(nearest - order) <= self._reach * self._bin else None

    def move(self) -> None:
        """Move each order to where it describes its cells best; two that share cells together."""
        left, moved = sorted(self._ridges), {}
        while left:
            order = left.pop(0)
            beside = self._beside(order)
            both = (order,) if beside is None else (order, beside)
            cells = self._cells(*both)
            places = [(x, self._ridges[x].uncertainty) for x in both]
            if len(cells) >= _LEAST_SPECTRA:
                places = self._places(both, cells)
            for x, (place, error) in zip(both, places, strict=True):
                if x == order or x in left:
                    moved[place] = replace(self._ridges[x], values=(place,), uncertainty=error)
            left = [x for x in left if x != beside]
        self._set(moved)

    def _places(
        self, orders: Sequence[float], cells: Sequence[_Cells]
    ) -> list[tuple[float, float]]:
        """Where orders describe their cells best, and their standard uncertainties."""
        best, errors = np.array(orders), np.zeros(len(orders))
        for reach in _FINER:
            tried = best[:, None] + np.linspace(-reach, reach, 2 * _HALF + 1) * self._bin
            best, errors = _least(tried, _blocks([x.misfit(tried) for x in cells]))
        growth = GROWTH_UNKNOWN * float(np.mean([x.spectrum.growth for x in cells]))
        least = _LEAST_ERROR * self._bin
        return [
            (float(x), max(math.hypot(error, growth * x), least))
            for x, error in zip(best, errors, strict=True)
        ]


def _blocks(left_over: Sequence[np.ndarray]) -> np.ndarray:
    """Sums of the misfit over neighbouring spectra, (blocks, ...)."""
    parts = np.array_split(np.array(left_over), min(_BLOCKS, len(left_over)))
    return np.array([x.sum(axis=0) for x in parts])


def _least(tried: np.ndarray, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the sum of a misfit (blocks, k) or (blocks, k, k) of one or two orders ``tried`` (orders, k) is
    least, and standard uncertainties by leaving out one block at a time (jackknife).
    """
    from scipy.stats import t as student

    total = blocks.sum(axis=0)
    left = np.array([_lowest(tried, total - x) for x in blocks])
    count = len(blocks)
    scatter = np.sqrt((1.0 - 1.0 / count) * np.sum((left - left.mean(axis=0)) ** 2, axis=0))
    wide = float(student.ppf(0.975, count - 1)) / _TWO_SIDED
    return _lowest(tried, total), wide * scatter


def _lowest(tried: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """Where a misfit (k,) or (k, k) at evenly spaced places (orders, k) is least, by parabolas."""
    at = np.unravel_index(int(np.argmin(misfit)), misfit.shape)
    found = []
    for axis, places in enumerate(tried):
        along = misfit[tuple(slice(None) if k == axis else x for k, x in enumerate(at))]
        middle = int(np.clip(at[axis], 1, places.size - 2))
        low, least, high = along[middle - 1 : middle + 2]
        bend = low - 2.0 * least + high
        off = float(np.clip(0.5 * (low - high) / bend, -1.0, 1.0)) if bend > 0.0 else 0.0
        found.append(places[middle] + off * (places[1] - places[0]))
    return np.array(found)
