"""Bounds on a wheel's orders at the speeds that their coefficients are not from: where other ridges mask
them, and near modes.

A resonance that no fit has found may be at these speeds alone. So the largest coefficients are held against
all that the waterfall shows: what their sum leaves open, each of the orders that are there may have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microvib.signals.ridges import PowerMap, Ridge
from microvib.signals.spectrum import leakage
from microvib.studies.wheel_fit import (
    KNOWN_WITHIN,
    FoundMode,
    bins_beside,
    largest_factor,
    read_order,
    ridge_paths,
)
from microvib.studies.wheel_gaps import Fit

_APART = 3
"""Bins from which the powers of two lines add; nearer ones may add their amplitudes."""
_TOLD = 1.1
"""Factor of the power that the largest coefficients make from which a speed is told to be above them."""
_RESONANT = 4.0
"""Factor of the power that the usual coefficients make, from which a peak is a resonance: twice the amplitude."""
_VARIES = 2.0
"""Factor of the largest power of a constant line, or of whirl, elsewhere that it may have beside an order
(assumed).
"""


def held_at_all_speeds(
    fits: Sequence[Fit],
    one: PowerMap,
    ridges: Sequence[Ridge],
    modes: Sequence[FoundMode],
    kept: np.ndarray,
) -> list[Fit]:
    """Fits of a load, whose coefficients may be as large as the load's map shows them at any of its speeds.

    Parameters
    ----------
    fits : sequence of Fit
        Of the load alone.
    one : PowerMap
        Its map; coefficients hold what either axis of it shows, too.
    ridges : sequence of Ridge
        Of all kinds: what lines and whirl have where no order is near is not an order's.
    modes : sequence of FoundMode
        That amplify this load.
    kept : ndarray
        Which speeds show the wheel, (n,).
    """
    factors = [largest_factor(modes, fit.reading.order, one.speed) for fit in fits]
    most = [fit.coefficient.most for fit in fits]
    large = [set(fit.coefficient.large) for fit in fits]
    resonant = np.zeros((len(fits), one.speed.size), dtype=bool)
    for each in (one, *one.of_axes):
        beside = [
            _Beside(each, fit.reading.order, each.speed**2 * f)
            for fit, f in zip(fits, factors, strict=True)
        ]
        others = _powers_of_others(each, ridges, beside)
        largest = [fit.coefficient.most for fit in fits]
        usual = [fit.coefficient.usual for fit in fits]
        for k, fit in enumerate(fits):
            reading = read_order(each, fit.reading.order, (), kept)
            rows = np.searchsorted(each.speed, reading.speed)
            masked = beside[k].masked_by(beside)[rows]
            shown = np.where(masked, reading.sure_part(reading.power), reading.at_least)
            known, expected = (
                (beside[k].power(beside, sizes) + others[k])[rows] for sizes in (largest, usual)
            )
            resonant[k, rows] |= shown > _RESONANT * expected
            more = shown > known
            if more.any():
                at_most = np.where(shown > 0.0, reading.power + KNOWN_WITHIN * reading.noise, 0.0)
                needed = np.sqrt(2.0 * np.maximum(at_most, shown)) / (
                    reading.speed**2 * factors[k][rows]
                )
                most[k] = max(most[k], float(needed[more].max()))
            large[k] |= set(reading.speed[shown > _TOLD * known].tolist())
    return [
        replace(
            fit,
            coefficient=replace(
                fit.coefficient, most=most[k], large=tuple(sorted(large[k])),
                resonances=_between_neighbours(one.speed[kept], resonant[k, kept]),
            ),
        )
        for k, fit in enumerate(fits)
    ]  # fmt: skip


def largest_power(
    one: PowerMap, fits: Sequence[Fit], modes: Sequence[FoundMode], order_errors: Sequence[float]
) -> np.ndarray:
    """Power that orders with their largest coefficients make in each cell of a load's map, by their lines and
    what leaks from these, (n, m); orders may be off by ``order_errors``.
    """
    found = np.zeros(one.power.shape)
    bins = np.arange(one.frequency.size)
    turns = one.speed / (2.0 * np.pi * one.spacing)
    for fit, off in zip(fits, order_errors, strict=True):
        order = fit.reading.order
        factor = largest_factor(modes, order, one.speed)
        power = 0.5 * (fit.coefficient.most * one.speed**2 * factor) ** 2
        at = order * turns - one.frequency[0] / one.spacing
        wide = (bins_beside(one, order) - one.lobe) + off * turns
        distance = np.abs(bins - at[:, None]) - wide[:, None]
        found += power[:, None] * leakage(one.window, distance)
    return found


def _between_neighbours(speed: np.ndarray, chosen: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Speeds from the one before each chosen one (n,) to the one behind it, joined where they touch."""
    found: list[tuple[float, float]] = []
    for k in np.flatnonzero(chosen).tolist():
        start, stop = float(speed[max(k - 1, 0)]), float(speed[min(k + 1, speed.size - 1)])
        if found and start <= found[-1][1]:
            start = found.pop()[0]
        found.append((start, stop))
    return tuple(found)


class _Beside:
    """Place of an order in a map, and how large it may be there."""

    def __init__(self, one: PowerMap, order: float, per_coefficient: np.ndarray) -> None:
        self.path = order * one.speed / (2.0 * np.pi * one.spacing)
        """In bins, (n,)."""
        self.reach = bins_beside(one, order) + one.lobe + 1
        """Bins within which another one's lie, (n,)."""
        self.per_coefficient = per_coefficient
        """Amplitude over its coefficient, (n,)."""

    def is_near(self, path: np.ndarray) -> np.ndarray:
        """Whether a ``path`` (n,) [bins] comes into its bins, (n,)."""
        return np.asarray(np.abs(path - self.path) <= self.reach)

    def masked_by(self, orders: Sequence[_Beside]) -> np.ndarray:
        """Whether any others of some orders are in its bins, (n,)."""
        near = [self.is_near(other.path) for other in orders if other is not self]
        return np.any([np.zeros(self.path.size, dtype=bool), *near], axis=0)

    def power(self, orders: Sequence[_Beside], coefficients: Sequence[float]) -> np.ndarray:
        """Largest power in its bins by all ``orders``, it included, with these ``coefficients``, (n,)."""
        together, apart = np.zeros(self.path.size), np.zeros(self.path.size)
        for other, size in zip(orders, coefficients, strict=True):
            amplitude = size * other.per_coefficient
            near = self.is_near(other.path)
            touches = np.abs(other.path - self.path) < _APART + self.reach - self.reach.min()
            together += np.where(near & touches, amplitude, 0.0)
            apart += np.where(near & ~touches, amplitude**2, 0.0)
        return np.asarray(0.5 * (together**2 + apart))


def _powers_of_others(
    one: PowerMap, ridges: Sequence[Ridge], orders: Sequence[_Beside]
) -> list[np.ndarray]:
    """Powers that lines and whirl may have in the bins of each of some orders, (n,)."""
    found = [np.zeros(one.speed.size) for _ in orders]
    for ridge in ridges:
        if ridge.kind == "order":
            continue
        for path in ridge_paths(ridge, one.speed):
            bins = path / one.spacing
            near = [order.is_near(bins) for order in orders]
            alone = ~np.any(near, axis=0) if near else np.ones(one.speed.size, dtype=bool)
            level = _VARIES * float(np.max(_power_along(one, path, ridge)[alone], initial=0.0))
            for k, where in enumerate(near):
                found[k] += np.where(where, level, 0.0)
    return found


def _power_along(one: PowerMap, path: np.ndarray, ridge: Ridge) -> np.ndarray:
    """Power above the floor in the bins about a ``path`` (n,) [Hz] as wide as its ridge, (n,); 0 outside of
    the map.
    """
    reach = one.lobe + round(ridge.width / one.spacing)
    found = np.zeros(path.size)
    for row, bin_ in enumerate(one.bins(path).tolist()):
        if bin_ >= 0:
            near = slice(max(bin_ - reach, 0), bin_ + reach + 1)
            found[row] = float(np.sum((one.power - one.floor)[row, near]))
    return found
