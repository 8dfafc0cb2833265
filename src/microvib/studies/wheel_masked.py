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
from microvib.studies.wheel_fit import (
    FoundMode,
    bins_beside,
    largest_factor,
    read_order,
    ridge_paths,
)
from microvib.studies.wheel_gaps import Fit

_APART = 3
"""Bins from which the powers of two lines add; nearer ones may add their amplitudes."""
_LEFT_OPEN = 1.1
"""Factor of the power that the largest coefficients leave open."""
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
    for each in (one, *one.of_axes):
        beside = [
            _Beside(each, fit.reading.order, fit.coefficient.most * each.speed**2 * factor)
            for fit, factor in zip(fits, factors, strict=True)
        ]
        others = _powers_of_others(each, ridges, beside)
        for k, fit in enumerate(fits):
            reading = read_order(each, fit.reading.order, (), kept)
            rows = np.searchsorted(each.speed, reading.speed)
            known, masked = beside[k].largest_power(beside)
            shown = np.where(masked[rows], reading.sure_part(reading.power), reading.at_least)
            more = shown > _LEFT_OPEN * (known + others[k])[rows]
            if more.any():
                needed = np.sqrt(2.0 * shown) / (reading.speed**2 * factors[k][rows])
                most[k] = max(most[k], float(needed[more].max()))
                large[k] |= set(reading.speed[more].tolist())
    return [
        replace(fit, coefficient=replace(fit.coefficient, most=a, large=tuple(sorted(b))))
        for fit, a, b in zip(fits, most, large, strict=True)
    ]


class _Beside:
    """Where an order is in a map, and how large it may be there."""

    def __init__(self, one: PowerMap, order: float, amplitude: np.ndarray) -> None:
        self.order = order
        self.path = order * one.speed / (2.0 * np.pi * one.spacing)
        """In bins, (n,)."""
        self.reach = bins_beside(one, order) + one.lobe + 1
        """Bins within which another one's lie, (n,)."""
        self.amplitude = amplitude
        """(n,)."""

    def is_near(self, path: np.ndarray) -> np.ndarray:
        """Whether a ``path`` (n,) [bins] comes into its bins, (n,)."""
        return np.asarray(np.abs(path - self.path) <= self.reach)

    def largest_power(self, orders: Sequence[_Beside]) -> tuple[np.ndarray, np.ndarray]:
        """Largest power in its bins by all ``orders``, it included, and whether others are there, (n,)."""
        together, apart = self.amplitude.copy(), np.zeros(self.path.size)
        masked = np.zeros(self.path.size, dtype=bool)
        for other in orders:
            if other is self:
                continue
            near = self.is_near(other.path)
            masked |= near
            touches = np.abs(other.path - self.path) < _APART + self.reach - self.reach.min()
            together += np.where(near & touches, other.amplitude, 0.0)
            apart += np.where(near & ~touches, other.amplitude**2, 0.0)
        return 0.5 * (together**2 + apart), masked


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
