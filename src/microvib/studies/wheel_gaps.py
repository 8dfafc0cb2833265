"""Speeds and frequencies at which a waterfall does not show the wheel: runs that failed, and bins that the
analyser's filter weakens.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from microvib.errors import MicrovibError
from microvib.signals.ridges import PowerMap
from microvib.studies.wheel_fit import WEAK, Coefficient, Reading, is_weak

_DEAD = 1e-8
"""Part of the usual power below which a spectrum is of no sensor."""
_LEAST_ORDERS = 2
"""Orders that must be missing together for a run to have failed."""
_LEAST_SPEEDS = 5
"""Speeds that must show the wheel in all loads."""
_TOP = 0.5
"""Part of the measured frequencies above which a filter may weaken orders."""
_FALLING = 0.6
"""Part of its power below which an order is weakened by a filter."""
_LEAST_WEAKENED = 2
_BEFORE = (0.5, 0.7)
"""Parts of the measured frequencies between which the floor is taken for whole."""
_FLOOR_FALLS = 0.05
"""Part of that floor below which a filter has taken it."""


@dataclass(frozen=True)
class Fit:
    """A coefficient with the reading that it is of."""

    load: str
    reading: Reading
    factor: np.ndarray
    """Amplification by the modes at the speeds of the reading, (n,)."""
    coefficient: Coefficient

    @property
    def expected(self) -> np.ndarray:
        """Power by the coefficient, (n,)."""
        amplitude = self.coefficient.value * self.reading.speed**2 * self.factor
        return np.asarray(0.5 * amplitude**2)


def require_power(maps: Mapping[str, PowerMap]) -> None:
    """MicrovibError where a load is zero, along both axes or either."""
    for load, one in maps.items():
        if not all(power.any() for power in (one.power, *one.axes)):
            raise MicrovibError(
                f"{load}: its spectra are zero at all speeds, as of a channel that was not connected; leave it out"
            )


def failed_speeds(maps: Mapping[str, PowerMap], fits: Sequence[Fit]) -> dict[str, np.ndarray]:
    """Speeds (n,) at which each load shows none of its orders, two or more, or has no noise either; and
    those at which no load shows any.

    MicrovibError where too few are left.
    """
    shown = {load: _counts(one, [x for x in fits if x.load == load]) for load, one in maps.items()}
    expected, weak = np.sum(list(shown.values()), axis=0)
    at_all = (expected >= _LEAST_ORDERS) & (weak == expected)
    found = {}
    for load, (own, own_weak) in shown.items():
        failed = (own >= _LEAST_ORDERS) & (own_weak == own)
        found[load] = failed | at_all | _dead(maps[load])
    remain = int(np.sum(~np.any(list(found.values()), axis=0)))
    if remain < _LEAST_SPEEDS:
        count = next(iter(found.values())).size
        raise MicrovibError(
            f"only {remain} of {count} speeds show the orders in all loads; {_LEAST_SPEEDS} or more are needed:"
            " leave out a load whose channel failed, or measure again"
        )
    return found


def _counts(one: PowerMap, fits: Sequence[Fit]) -> np.ndarray:
    """Orders that each speed would show, and those of them that are weak, (2, n)."""
    counts = np.zeros((2, one.speed.size), dtype=int)
    for fit in fits:
        at = np.searchsorted(one.speed, fit.reading.speed)
        weak = is_weak(fit.reading, fit.expected)
        counts[0, at] += weak | (WEAK * fit.expected > 2.0 * fit.reading.limit)
        counts[1, at] += weak
    return counts


def _dead(one: PowerMap) -> np.ndarray:
    usual = np.median(one.power, axis=1)
    return np.asarray(usual <= _DEAD * float(np.max(usual)))


def usable_bins(maps: Mapping[str, PowerMap], fits: Sequence[Fit]) -> int:
    """Bins from the first up to where all orders, or the floor, fall off to the end of the spectra."""
    one = next(iter(maps.values()))
    count = min(_before_floor_falls(x) for x in maps.values())
    weakened, sound = _by_frequency(fits, _TOP * one.frequency[-1])
    edge = float(np.max(sound, initial=_TOP * one.frequency[-1]))
    above = weakened[weakened > edge]
    if above.size < _LEAST_WEAKENED:
        return count
    return min(count, int(one.bins(above.min())))


def _by_frequency(fits: Sequence[Fit], top: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] at which orders are weakened and at which they are not, at speeds whose orders
    below a ``top`` one are as expected.
    """
    weakened: list[np.ndarray] = []
    sound: list[np.ndarray] = []
    each = [(x, x.reading.power + x.reading.limit < _FALLING * x.expected) for x in fits]
    failed = {
        float(speed)
        for fit, weak in each
        for speed in fit.reading.speed[weak & (fit.reading.frequency < top)]
    }
    for fit, weak in each:
        would = _FALLING * fit.expected > 2.0 * fit.reading.limit
        would &= ~np.isin(fit.reading.speed, list(failed))
        weakened.append(fit.reading.frequency[would & weak])
        sound.append(fit.reading.frequency[would & ~weak])
    return np.concatenate([*weakened, []]), np.concatenate([*sound, []])


def _before_floor_falls(one: PowerMap) -> int:
    """Bins from the first up to where the floor falls off to the end of the spectra."""
    profile = np.median(one.power, axis=0)
    first, last = (int(part * profile.size) for part in _BEFORE)
    usual = float(np.median(profile[first:last]))
    sound = np.flatnonzero(profile >= _FLOOR_FALLS * usual)
    return int(sound[-1]) + 1
