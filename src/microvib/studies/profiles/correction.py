"""A change of rate that allows for what a linear drive lacks: friction that holds and lets go,
detent torque, single microsteps.

In a run of the full model a mode rings with c = g Delta (R + D): R is the residual of the change of
rate by Delta in the linearised drive, and D is everything else. D depends on the drive far more than
on the shape. So a shape is found for which R + D is small, by the linear program with D as it was
measured; it is run, D is measured anew, and so on until it holds: iterative learning with the model
in place of the drive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from microvib.errors import MicrovibError
from microvib.studies.profiles.rate_profile import RateProfile
from microvib.studies.profiles.runs import Case, Ringing, measure
from microvib.studies.profiles.shortest import Bounds, Samples, least_residual, shortest_change
from microvib.studies.workers import Calls

ITERATIONS = 18
RELAXATION = 0.8
"""Part of a change of D that is taken over."""
DESIGN_PART = 0.85
"""Part of the limit that the shortest shape is designed for, so that what it is measured with keeps
it."""
_SHORTEST, _AT_A_LENGTH = 5, 4
"""Iterations with the shortest shape, and where these do not keep the limit those with the best shape
of a fixed length, which are made for each of several lengths."""
_LONGER = 0.08
"""Periods by which a next length is longer."""
_KEPT = 0.98
"""Ringing over its limit at which a shape of a fixed length is taken."""
LONGEST, FALLBACK = 2.0, 1.25
"""Periods of the slowest mode that a shape has at most, and those it has where none so long keeps the
limit. Slower shapes crawl microstep by microstep, and D then depends on the shape."""
_BETWEEN = 9
"""Points over the frequencies at which a shape is held down, between the cases by interpolation."""


@dataclass(frozen=True)
class Attempt:
    """A shape and what its runs rang with."""

    transition: RateProfile
    profile: RateProfile
    """From rest to the end of the manoeuvre."""
    cases: tuple[Case, ...]
    ringing: tuple[tuple[Ringing, ...], ...]
    """By case and mode."""
    worst: float
    """Largest ringing over its limit; infinite where one is not known."""


@dataclass(frozen=True)
class Task:
    """A change of rate that is to be shaped, and what is around it."""

    build: Callable[[RateProfile], tuple[RateProfile, float]]
    """Makes of a shape from 0 to 1 the whole profile from rest, and the size of the change
    [rad/s]."""
    limits: Callable[[Case], np.ndarray]
    """Limits of the modes in a case [N m], (n,)."""
    period: float
    """Period of the slowest mode [s]."""
    bounds: Bounds
    early: bool
    """Whether friction lets go at the begin of the change, rather than holding at its end: D rings on
    from there, and is the same for shapes of other lengths."""


def measure_all(
    calls: Calls, cases: Sequence[Case], profile: RateProfile
) -> tuple[tuple[Ringing, ...], ...]:
    """Ringing by case and mode after a profile from rest."""
    return tuple(calls(measure, [(case, profile) for case in cases]))


def over_limit(cases: Sequence[Case], ringing: Sequence[Sequence[Ringing]], task: Task) -> float:
    """Largest ringing over its limit."""
    return max(
        one.most / most
        for case, of_case in zip(cases, ringing, strict=True)
        for one, most in zip(of_case, task.limits(case), strict=True)
    )


def correct(task: Task, cases: Sequence[Case], first: RateProfile, calls: Calls) -> Attempt:
    """The shortest shape found that keeps the limits in all cases by runs of the full model; where
    none does, the one that comes nearest.

    Parameters
    ----------
    task : Task
        What is to be shaped.
    cases : sequence of Case
        Drives in which the limits are to be kept.
    first : RateProfile
        Shape from 0 to 1 to begin with.
    calls : callable
        Runs functions in parallel.

    Returns
    -------
    Attempt
        The shape with its runs.
    """
    transition, found = first, []
    offset: np.ndarray | None = None
    for k in range(ITERATIONS):
        profile, change = task.build(transition)
        ringing = measure_all(calls, cases, profile)
        worst = over_limit(cases, ringing, task)
        found.append(Attempt(transition, profile, tuple(cases), ringing, worst))
        if _is_settled(found, task.period):
            break
        measured = _offsets(task, found[-1], change)
        offset = measured if offset is None else offset + RELAXATION * (measured - offset)
        samples = _samples(task, cases, offset, change)
        if k < _SHORTEST:
            transition = _shape(task, samples)
            continue
        longer = _LONGER * task.period if (k - _SHORTEST) % _AT_A_LENGTH == 0 else 0.0
        transition = least_residual(samples, transition.duration + longer, task.bounds)[0]
    return _best(found)


def _best(found: Sequence[Attempt]) -> Attempt:
    keeping = [attempt for attempt in found if attempt.worst <= 1.0]
    if keeping:
        return min(keeping, key=lambda attempt: attempt.profile.duration)
    return min(found, key=lambda attempt: attempt.worst)


def _is_settled(found: Sequence[Attempt], period: float) -> bool:
    """Whether the last two shapes keep the limits and are as long as each other, or one of a fixed
    length keeps them."""
    if len(found) > _SHORTEST + 1:
        return found[-1].worst <= _KEPT
    if len(found) < 3 or max(attempt.worst for attempt in found[-2:]) > 1.0:
        return False
    return abs(found[-1].transition.duration - found[-2].transition.duration) < 0.01 * period


def _offsets(task: Task, attempt: Attempt, change: float) -> np.ndarray:
    """D of each case and mode, complex (c, n); at the begin of the shape where it is made early."""
    rows = []
    for case, of_case in zip(attempt.cases, attempt.ringing, strict=True):
        value = np.array([one.value for one in of_case])
        s = case.eigenvalues
        beside = value / (case.gains * change) - attempt.transition.residual(s)
        if task.early:
            beside = beside * np.exp(-s * attempt.transition.duration)
        rows.append(beside)
    return np.array(rows)


def _shape(task: Task, samples: Samples) -> RateProfile:
    """The shortest shape within ``DESIGN_PART`` of the limits; where there is none, the best of one
    length."""
    least = 1.0 / task.bounds.acceleration
    try:
        return shortest_change(samples, task.period, task.bounds, DESIGN_PART, LONGEST)[0]
    except MicrovibError:
        return least_residual(samples, FALLBACK * task.period + least, task.bounds)[0]


def _samples(task: Task, cases: Sequence[Case], offset: np.ndarray, change: float) -> Samples:
    """Points over the cases, interpolated over the frequency among those that are alike but for it."""
    parts = list(_sampled_groups(task, cases, offset, change))
    s, allowed, beside = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return Samples(s, allowed.real, beside, task.early)


def _sampled_groups(
    task: Task, cases: Sequence[Case], offset: np.ndarray, change: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    def alike(k: int) -> tuple[float, float]:
        return cases[k].damping, cases[k].friction

    order = sorted(range(len(cases)), key=lambda k: (*alike(k), cases[k].frequency))
    for _, group in groupby(order, key=alike):
        members = list(group)
        x = np.array([cases[k].frequency for k in members])
        at = np.linspace(x[0], x[-1], _BETWEEN) if x.size > 1 else x
        rows = [
            (
                cases[k].eigenvalues,
                task.limits(cases[k]) / np.abs(cases[k].gains * change),
                offset[k],
            )
            for k in members
        ]
        yield tuple(  # type: ignore[misc]
            _interpolated(at, x, np.array([row[part] for row in rows])) for part in range(3)
        )


def _interpolated(at: np.ndarray, x: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Complex values (m, n) at ``x`` (m,), at other points, (k n,)."""
    columns = [
        np.interp(at, x, column.real) + 1j * np.interp(at, x, column.imag)
        for column in np.asarray(values, dtype=complex).T
    ]
    return np.concatenate(columns)
