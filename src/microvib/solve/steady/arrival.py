"""Whether a start from rest leads to a motion that was found.

What a drive does follows from how it began, and every run begins at rest. A motion that repeats
with the command is therefore taken only if a start from rest leads to it. Its deviation from the
motion must die out, which is seen in one of two ways:

- The deviation is **as linear as a small one** (``_is_linear``): from a part of it the drive goes a part of the way, to
  much less than what decays meanwhile. A mode that friction feeds, slips that alternate or an edge that is met are none of that:
  what keeps them as large as they are is that they do not scale. Then it dies out as small deviations do, in whatever time.
- It **arrives** (``wait_for_arrival``). How long that takes follows from the slowest decay. Nothing is done to the run
  meanwhile: a deviation that is made smaller may leave an oscillation which friction feeds, beside a large one that decays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microvib.solve.steady.from_rest import RunFromRest, rms
from microvib.solve.steady.period import NotPeriodic

ARRIVAL_TOLERANCE = 0.01
"""Deviation of the torque, over the RMS of the torque, at which a start from rest has arrived."""
LINEARITY_CHECK_WINDOW = 0.05
"""Decay times over which it is asked whether a deviation is linear, or a cycle of the slowest mode
if that is longer.
"""
FAST_DECAY_TIMES = 3.0
"""Decay times before it, of what dies out fast: linear or not, it says nothing of where the run
goes.
"""
MAX_LINEARITY_CHECKS = 3
"""How often that is asked before the deviation is waited for."""
LINEARITY_TEST_SCALE = 0.1
"""Part of a deviation with which it is compared."""
LINEARITY_TOLERANCE = 0.3
"""Difference between them, over what decays meanwhile, below which a deviation is linear."""
MIN_DECAY_RATE_RATIO = 0.5
"""Rate of its decay, over that of small deviations, at least."""
WINDOW = 0.15
"""Decay times over which a deviation that is waited for is averaged, or a cycle of the slowest mode
if that is longer.
"""
STALL_CRITERION = (1.5, 0.8)
"""Decay times in which a deviation must fall at least to this part of itself."""
MIN_DECAY = 1e-9
"""Rate [1/s] that a decay is taken to have at least."""


class NotReached(NotPeriodic):
    """A start from rest does not lead to the motion that was found."""


@dataclass(frozen=True)
class PeriodicMotion:
    """A motion that repeats with the command."""

    x: np.ndarray
    """State at the start of the period, seen from the command, (n,)."""
    T_d: np.ndarray
    """Its torque [N m], (microsteps x rows of the run,)."""
    decay: float
    """Rate [1/s] at which small deviations from it die out."""
    slow: np.ndarray
    """Left eigenvectors of the slowly decaying deviations of the state, (k, n), possibly none.
    """
    fast: float
    """Rate [1/s] at which all others die out at least."""


def confirm_reached_from_rest(
    run: RunFromRest, found: PeriodicMotion, waited: bool = False
) -> None:
    """Show that a start from rest leads to the motion ``found``; NotReached where it does not, or
    takes too long.

    ``waited``, the deviation is waited for to its end.
    """
    found = replace(found, decay=max(found.decay, MIN_DECAY))
    _check_decay_time(run, found)
    run.begin()
    if waited or not _deviation_is_linear_or_gone(run, found):
        wait_for_arrival(run, found.T_d, found.decay)


def _check_decay_time(run: RunFromRest, found: PeriodicMotion) -> None:
    if _periods(run, WINDOW / found.decay) > run.longest * run.period.frequency / 8.0:
        raise NotReached(
            f"small deviations take {1.0 / found.decay:.3g} s (time constant) to decay, too long to"
            " wait for"
        )


def _periods(run: RunFromRest, time: float) -> int:
    """Periods of the command in ``time`` [s], or in a cycle of the slowest mode if that is longer."""
    return math.ceil(max(run.ringing.cycle, time) * run.period.frequency - 1e-9)


def _deviation_is_linear_or_gone(run: RunFromRest, found: PeriodicMotion) -> bool:
    """Whether the deviation from the motion becomes as linear as a small one before long, or has
    died out.
    """
    if not len(found.slow):
        return False  # nothing takes long
    periods, whole = _periods(run, LINEARITY_CHECK_WINDOW / found.decay), 1.0 / run.period.frequency
    _deviation(
        run, found.T_d, math.ceil(max(0.5 * periods, FAST_DECAY_TIMES / (found.fast * whole)))
    )
    left = math.exp(-MIN_DECAY_RATE_RATIO * found.decay * periods * whole)
    for _ in range(MAX_LINEARITY_CHECKS):
        begun = run.seen() - found.x
        deviation = _deviation(run, found.T_d, periods)
        if rms(deviation) <= ARRIVAL_TOLERANCE * rms(found.T_d):
            return True
        before, after = (np.linalg.norm(found.slow @ x) for x in (begun, run.seen() - found.x))
        if after <= left * before and _is_linear(run, found, begun, deviation):
            return True
    return False


def _is_linear(
    run: RunFromRest, found: PeriodicMotion, begun: np.ndarray, deviation: np.ndarray
) -> bool:
    """Whether a part of the deviation of the state that the run had ``begun`` with makes that part
    of its ``deviation``.
    """
    decayed = -math.expm1(-found.decay * len(deviation) / run.period.frequency)
    here = run.place()
    run.go_on_from(found.x + LINEARITY_TEST_SCALE * begun)
    scaled = _deviation(run, found.T_d, len(deviation)) / LINEARITY_TEST_SCALE
    run.go_back(here)
    return rms(scaled - deviation) <= LINEARITY_TOLERANCE * decayed * rms(deviation)


def _deviation(run: RunFromRest, T_d: np.ndarray, periods: int) -> np.ndarray:
    """Deviation of the torque from ``T_d`` [N m] over the next ``periods``, one row for each."""
    torque, _ = run.advance(periods * run.period.microsteps, run.rows)
    result: np.ndarray = torque.reshape(periods, -1) - T_d
    return result


def wait_for_arrival(run: RunFromRest, T_d: np.ndarray, decay: float) -> None:
    """Advance a run that is at the start of a period until its torque is that of the motion ``T_d``
    [N m], (microsteps x rows of the run,), from which small deviations die out with ``decay`` [1/s].
    NotReached where it does not become so.
    """
    periods, size = _periods(run, WINDOW / decay), rms(T_d)
    time = periods / run.period.frequency
    looked = max(math.ceil(STALL_CRITERION[0] / (decay * time)), 3)
    history: list[float] = []
    while run.simulated < run.longest:
        away = rms(_deviation(run, T_d, periods))
        if away <= ARRIVAL_TOLERANCE * size:
            return
        history.append(away)
        if len(history) > looked and away > STALL_CRITERION[1] * history[-1 - looked]:
            break
    raise NotReached("a start from rest does not converge to the periodic motion that was found")
