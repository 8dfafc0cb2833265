"""Shapes of a change of rate from 0 to 1: ramps, S curves and input shapers.

ZV and ZVD: Singer and Seering, J. Dyn. Syst. Meas. Control 112 (1990) 76; ZVDD is ZV three times.
EI: Singhose, Seering and Singer, J. Mech. Des. 116 (1994) 654, whose impulses are here those of an
undamped mode times the decay between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from microvib.studies.profiles.modes import UncertainMode
from microvib.studies.profiles.rate_profile import RateProfile

S_CURVE_LEGS = 32
"""Legs of constant acceleration that an S curve is made of."""
SHAPERS = ("ZV", "ZVD", "EI", "ZVDD")
LONGEST_PERIODS = 30.0
"""Periods of the slowest mode up to which the length of a ramp or an S curve is searched."""
_STEPS_PER_PERIOD = 40
_POINTS = 41, 3
"""Points over frequency and damping at which a length is searched."""
_SEARCH_MARGIN = 0.98
Impulses = tuple[np.ndarray, np.ndarray]
"""Times [s] and parts, (n,) each, of an input shaper; the parts add up to 1."""


def jump() -> RateProfile:
    """A jump from 0 to 1."""
    return RateProfile.of_jumps(np.zeros(1), np.ones(1))


def ramp(duration: float) -> RateProfile:
    """A rate that rises evenly for ``duration`` [s]."""
    if duration <= 0.0:
        return jump()
    return RateProfile(np.array([0.0, duration]), np.array([0.0, 1.0]))


def s_curve(duration: float) -> RateProfile:
    """Jerk of one size, up and then down, for ``duration`` [s], in ``S_CURVE_LEGS`` legs."""
    x = np.linspace(0.0, 1.0, S_CURVE_LEGS + 1)
    rising = np.where(x < 0.5, 2.0 * x**2, 1.0 - 2.0 * (1.0 - x) ** 2)
    return RateProfile(duration * x, rising)


def zero_vibration(frequency: float, damping: float, order: int = 1) -> Impulses:
    """Impulses of ZV, of ZVD with the ``order`` 2, of ZVDD with 3.

    Parameters
    ----------
    frequency : float
        Damped frequency of the mode [Hz].
    damping : float
        Its damping ratio.
    order : int
        How often the shaper ZV is applied.

    Returns
    -------
    tuple of ndarray
        Times [s] and parts, (order + 1,) each.
    """
    decay = _half_period_decay(damping)
    parts = np.array([math.comb(order, k) * decay**k for k in range(order + 1)])
    return np.arange(order + 1) * 0.5 / frequency, parts / np.sum(parts)


def extra_insensitive(frequency: float, damping: float, tolerated: float) -> Impulses:
    """Impulses of EI, which leaves the residual ``tolerated`` at the frequency itself and none at
    two others beside it.
    """
    decay = _half_period_decay(damping)
    undamped = np.array(
        [0.25 * (1.0 + tolerated), 0.5 * (1.0 - tolerated), 0.25 * (1.0 + tolerated)]
    )
    parts = undamped * decay ** np.arange(3)
    return np.arange(3) * 0.5 / frequency, parts / np.sum(parts)


def _half_period_decay(damping: float) -> float:
    """Part of an amplitude that is left after half a period."""
    return math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))


def shaped(base: RateProfile, kind: str, modes: Sequence[UncertainMode]) -> RateProfile:
    """A change of rate through one shaper of the ``kind`` for each of the modes."""
    for mode in modes:
        base = base.convolved(*_impulses(kind, mode))
    return base


def _impulses(kind: str, mode: UncertainMode) -> Impulses:
    if kind == "EI":
        return extra_insensitive(mode.frequency, mode.damping, min(mode.allowed, 0.5))
    order = {"ZV": 1, "ZVD": 2, "ZVDD": 3}[kind]
    return zero_vibration(mode.frequency, mode.damping, order)


def shortest_of(
    make: Callable[[float], RateProfile], least: float, modes: Sequence[UncertainMode]
) -> RateProfile | None:
    """The shortest profile of a family that keeps all modes within what is allowed; None where it
    would be longer than ``LONGEST_PERIODS``.

    Parameters
    ----------
    make : callable
        Makes the profile of a duration [s].
    least : float
        Shortest duration [s] that is allowed.
    modes : sequence of UncertainMode
        Modes with what is allowed.
    """
    period = 1.0 / min(mode.frequency for mode in modes)
    points = [(mode.eigenvalues(*_POINTS), _SEARCH_MARGIN * mode.allowed) for mode in modes]

    def keeps(duration: float) -> bool:
        profile = make(duration)
        return all(np.max(np.abs(profile.residual(s))) <= most for s, most in points)

    step = period / _STEPS_PER_PERIOD
    low, high = max(least - step, 0.0), max(least, step)
    while not keeps(high):
        low, high = high, high + step
        if high > LONGEST_PERIODS * period + least:
            return None
    low = max(low, least)
    for _ in range(12):
        middle = 0.5 * (low + high)
        if middle > 0.0 and keeps(middle):
            high = middle
        else:
            low = middle
    return make(high)
