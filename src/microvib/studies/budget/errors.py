"""Errors of the line of sight by their class: constants, random errors and drifts, in the metric, the
window and the statistical interpretation that a requirement asks for.

A constant counts in ``ape`` and ``mpe`` alone: windows take their mean out, and between two instants
it does not change. A drift of rate b is b t in these, from zero to its duration; b T tau/2 at the
instant tau, from -1 to 1, of a window T about its mean, all of it along a straight line; and b T_s from
one instant to another T_s later. A random error has the weights of its spectrum. Definitions and
interpretations are those of ECSS-E-ST-60-10C.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from microvib.signals.error_rows import Deviation, ErrorRows, Kind, Ramp
from microvib.signals.pointing import (
    Metric,
    mean_square_of_density,
    mean_squares_at_instants,
)
from microvib.studies.budget.files import (
    ConstantError,
    DriftError,
    ErrorClass,
    RandomError,
    Requirement,
)
from microvib.units import within_band

_WHOLE: tuple[Metric, ...] = ("ape", "mpe")
"""Metrics in which what stays counts."""
_BETWEEN: tuple[Metric, ...] = ("stability", "pde")
"""Metrics of a change from one instant to another."""
_GAIN: dict[Metric, float] = {
    "ape": 1.0, "mpe": 1.0, "rpe": 2.0, "smear": 1.5, "jitter": 8.0 / 3.0, "stability": 2.0, "pde": 2.0,
}  # fmt: skip
"""No error within a bound is larger than this part of it in a window: about a mean twice, and a
fitted line has no more than 3/2 at its end; about both, at the window's end, 1 and the integral of
abs(1/2 + 3/2 x) over the window, x from -1 to 1."""
_DENSE = 1600
"""Frequencies at which the spectrum of a random error is taken."""
_LARGEST_WEIGHT: dict[Metric, float] = {"ape": 1.0, "rpe": 1.0, "jitter": 1.0, "stability": 4.0}
"""Largest weight of a metric at high frequencies; the others have fallen to nothing there."""


class SourceError(NamedTuple):
    """Error of one source, and the group with which it is fully correlated."""

    error: ErrorClass
    group: str


class _Spectrum(NamedTuple):
    """Spectrum of a random error, of mean square 1."""

    correlation_time: float | None
    lowest: float | None
    highest: float | None

    @property
    def known(self) -> bool:
        return self.correlation_time is not None or self.lowest is not None


@dataclass(frozen=True)
class _Group:
    """Errors that are fully correlated, or one alone."""

    error: ErrorClass
    mean: np.ndarray
    """Known part about both axes, (2,) [rad], of a drift [rad/s]."""
    size: np.ndarray
    """Size of the spread, (2,)."""

    @property
    def kind(self) -> Kind | None:
        """Distribution of the spread; None where there is none."""
        if self.error.distribution == "fixed" or not self.size.any():
            return None
        return self.error.distribution

    def deviation(self, axis: int, factor: np.ndarray) -> Deviation | None:
        """The spread about an axis times a ``factor`` (n,)."""
        size = self.size[axis] * np.abs(factor)
        if self.kind is None or not np.any(size):
            return None
        return Deviation(self.kind, np.asarray(size))

    def largest(self, axis: int, sigmas: float) -> float:
        """The most that the spread makes about an axis, of a normal one so many standard deviations."""
        return float(self.size[axis]) * (sigmas if self.kind == "normal" else 1.0)


class Unit(NamedTuple):
    """One of the units that spreads stand for: at which part of their largest deviation its constants
    and its drifts are.
    """

    constants: float
    drifts: float

    def of(self, group: _Group, axis: int, sigmas: float) -> float:
        """Deviation of a group in it [rad], of drifts [rad/s]; of a normal one so many standard
        deviations.
        """
        part = self.drifts if isinstance(group.error, DriftError) else self.constants
        return part * group.largest(axis, sigmas)


CORNERS = (Unit(0.0, 0.0), *(Unit(a, b) for a in (1.0, -1.0) for b in (1.0, -1.0)))
"""Units of which a temporal interpretation takes the worst: the mean one, and those at the ends, where
the mean square is largest.
"""


@dataclass(frozen=True)
class ErrorSum:
    """Errors of all sources, those of one group together."""

    groups: tuple[_Group, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.groups)

    @property
    def spread_over_units(self) -> bool:
        """Whether any differs from unit to unit."""
        return any(one.kind is not None for one in self._of_units)

    @property
    def _of_units(self) -> list[_Group]:
        return [one for one in self.groups if not isinstance(one.error, RandomError)]

    @property
    def of_units(self) -> ErrorSum:
        """Errors that belong to a unit: constants and drifts."""
        return ErrorSum(tuple(self._of_units))

    @property
    def over_time(self) -> ErrorSum:
        """Errors that change with time alone: random errors."""
        return ErrorSum(tuple(x for x in self.groups if isinstance(x.error, RandomError)))

    def rows(
        self,
        r: Requirement,
        axis: int,
        instants: np.ndarray,
        unit: Unit | None = None,
        *,
        exact: bool = False,
    ) -> ErrorRows:
        """Errors as a metric has them about an axis, 0 or 1, at ``instants`` of a window, from -1 to 1;
        one row where the metric is one value of a window.

        With ``exact`` random errors are left out whose distribution in a window is not known, for
        they are not normal (``unknown_crest``).
        """
        instants = _instants_of(r, instants)
        mean, deviations = np.zeros(instants.size), list[Deviation]()
        ramps = dict[float, Ramp]()  # drifts of one duration begin together
        for one in self.groups:
            if isinstance(one.error, RandomError):
                if not exact or _keeps_its_distribution(r, one.error):
                    deviations += _random_deviation(r, one, axis, instants)
            elif isinstance(one.error, DriftError) and r.metric in _WHOLE:
                duration = one.error.duration or 0.0
                own = _own(unit, one, axis, r)
                ramps[duration] = _added(ramps.get(duration, Ramp(0.0)), one, axis, unit, own)
            else:
                factor = _factor(r, one.error, instants)
                mean = mean + factor * (one.mean[axis] + _own(unit, one, axis, r))
                if unit is None and (spread := one.deviation(axis, factor)) is not None:
                    deviations.append(spread)
        return ErrorRows(mean, tuple(deviations), tuple(x for x in ramps.values() if x.reach))

    def crest_over_units(self, r: Requirement, axis: int, instants: np.ndarray) -> np.ndarray:
        """The most that spreads over units add to the mean unit about an axis, (n,) [rad]."""
        instants = _instants_of(r, instants)
        found = np.zeros(instants.size)
        for one in self._of_units:
            if isinstance(one.error, DriftError) and r.metric in _WHOLE:
                factor = np.full(1, one.error.duration or 0.0)
            else:
                factor = np.abs(_factor(r, one.error, instants))
            found = found + factor * one.largest(axis, r.sigmas) * (one.kind is not None)
        return found

    def ends(self, r: Requirement, axis: int) -> list[ErrorRows]:
        """Constants and drifts of a unit where they are largest in a window: at its end, and where a
        drift begins; one row each.
        """
        own = self.of_units
        if r.metric not in _WHOLE:
            return [own.rows(r, axis, np.ones(1))]
        constants = [x for x in own.groups if isinstance(x.error, ConstantError)]
        start = ErrorSum(tuple(constants)).rows(r, axis, np.ones(1))
        drifts = [x for x in own.groups if isinstance(x.error, DriftError)]
        if not drifts:
            return [start]
        mean, deviations = start.mean, list(start.deviations)
        for one in drifts:
            assert isinstance(one.error, DriftError)
            duration = np.full(1, one.error.duration or 0.0)
            mean = mean + one.mean[axis] * duration
            if (spread := one.deviation(axis, duration)) is not None:
                deviations.append(spread)
        return [start, ErrorRows(mean, tuple(deviations))]

    def mean_square(self, r: Requirement, axis: int) -> float:
        """Mean square about an axis [rad^2]: over time and units, or over the time of the worst
        unit.
        """
        nodes, weights = np.polynomial.legendre.leggauss(4)  # of a parabola in the instant
        temporal = r.interpretation == "temporal"
        found = []
        for unit in CORNERS if temporal else (None,):
            each = self.of_units.rows(r, axis, nodes, unit).mean_square
            found.append(float(each[0]) if each.size == 1 else float(0.5 * weights @ each))
        random = [_random_mean_square(r, one, axis) for one in self.over_time.groups]
        return max(found) + sum(random)

    def unknown_crest(self, r: Requirement, axis: int) -> float:
        """The most that random errors make whose distribution in a window is not known [rad];
        infinite where a band cuts them.
        """
        found = 0.0
        for one in self.over_time.groups:
            assert isinstance(one.error, RandomError)
            if one.size[axis] and not _keeps_its_distribution(r, one.error):
                found += _crest_in_band(r, one.error) * float(one.size[axis])
        return found

    def slope(self, r: Requirement, axis: int) -> float:
        """By how much drifts change from the middle of a window to its end [rad], at most."""
        if r.metric in _WHOLE or r.metric in _BETWEEN:
            return 0.0
        end = self.of_units.rows(r, axis, np.ones(1))
        return float(np.abs(end.mean[0]) + self.crest_over_units(r, axis, np.ones(1))[0])


NO_ERRORS = ErrorSum()


def sum_of_errors(errors: Iterable[SourceError]) -> ErrorSum:
    """Errors of sources, those of one group as one: known parts and spreads add."""
    found: dict[object, _Group] = {}
    for number, (error, name) in enumerate(errors):
        key = name or number
        if isinstance(error, RandomError):
            mean = np.zeros(2)
        else:
            mean = np.array([error.x, error.y])
        size = np.array([error.spread_x or 0.0, error.spread_y or 0.0])
        before = found.get(key)
        if before is None:
            found[key] = _Group(error, mean, size)
        else:
            found[key] = replace(before, mean=before.mean + mean, size=before.size + size)
    return ErrorSum(tuple(found.values()))


def reasons_against(
    r: Requirement, errors: Sequence[SourceError], of_all: Sequence[SourceError]
) -> Iterator[str]:
    """Why a requirement cannot be judged beside the errors of a source, and those ``of_all``, a
    sentence without a stop each; the key that would tell.
    """
    if r.curve is not None:
        return
    for error, _ in errors:
        if isinstance(error, RandomError):
            yield from _reasons_against_random(r, error)
        elif _counts(r, error):
            if isinstance(error, DriftError):
                durations = {x.duration for x, _ in of_all if isinstance(x, DriftError)}
                yield from _reasons_against_drift(r, error, durations - {None})
            if error.distribution != "fixed" and (error.spread_x or error.spread_y):
                yield from _reasons_against_spread(r)


def _reasons_against_random(r: Requirement, error: RandomError) -> Iterator[str]:
    if _needs_spectrum(r) and not _spectrum(error).known:
        what = r.metric if r.metric != "ape" else "a band of frequencies"
        yield (
            f"random.correlation_time: missing; {what} needs it, or the band random.lowest and"
            " random.highest"
        )
    elif r.statistic == "bound" and not math.isfinite(_crest_in_band(r, error)):
        yield (
            "a uniform random error that a band cuts has no bound (statistic rms or level, or no"
            " lowest and highest)"
        )


def _reasons_against_drift(
    r: Requirement, error: DriftError, durations: AbstractSet[float | None]
) -> Iterator[str]:
    if r.metric in _WHOLE and error.duration is None:
        yield f"drift.duration: missing; {r.metric} needs it, such as duration: 1 h"
    elif r.metric in _WHOLE and len(durations) > 1:
        yield (
            "drift.duration: differs from that of another drift, and how far each has come while the"
            " other lasts is not known (give all the same, or one that is reset sooner as constant)"
        )
    longest = max(r.window or 0.0, r.apart or 0.0)
    if r.metric not in _WHOLE and error.duration is not None and longest > error.duration:
        yield (
            f"drift.duration: ends within the {longest:g} s of the requirement, and what the drift does"
            " after that is not known (give a duration that is at least as long, or a sawtooth of"
            " calibrations as periodic)"
        )
    if r.lowest > 0.0:
        yield (
            "a drift has no frequency, and the requirement's lowest says nothing of it (leave lowest"
            " out)"
        )


def _reasons_against_spread(r: Requirement) -> Iterator[str]:
    if r.percentile is not None:
        yield (
            "its spread is over units, and percentile is over a campaign's cases (leave percentile"
            " out, or give distribution: fixed)"
        )
    elif r.interpretation is None and r.statistic != "bound":
        yield (
            "its spread is over units, and the requirement's interpretation is missing; mixed is over"
            " time and units, temporal over the time of the worst unit, ensemble over units at their"
            " largest"
        )


def _needs_spectrum(r: Requirement) -> bool:
    return r.metric != "ape" or r.lowest > 0.0 or r.highest is not None


def _instants_of(r: Requirement, instants: np.ndarray) -> np.ndarray:
    """Instants of a window, one where the metric is one value of it."""
    if r.metric in _WHOLE or r.metric in _BETWEEN:
        return np.zeros(1)
    return instants


def _counts(r: Requirement, error: ErrorClass) -> bool:
    """Whether a class of errors makes anything of a metric in a band."""
    if isinstance(error, RandomError):
        return not _needs_spectrum(r) or _spectrum(error).known
    if isinstance(error, ConstantError):
        return r.metric in _WHOLE and r.lowest == 0.0
    return r.metric != "jitter"


def _factor(r: Requirement, error: ErrorClass, instants: np.ndarray) -> np.ndarray:
    """Part that a constant of 1, or a drift of 1/s, has in a metric at the instants of a window, (n,)."""
    if not _counts(r, error):
        return np.zeros(instants.size)
    if isinstance(error, ConstantError):
        return np.ones(instants.size)
    if r.metric in _BETWEEN:
        return np.full(instants.size, r.apart or r.window or 0.0)
    return 0.5 * (r.window or 0.0) * instants


def _own(unit: Unit | None, one: _Group, axis: int, r: Requirement) -> float:
    """Deviation of a group in a unit; 0 where it is any."""
    return 0.0 if unit is None else unit.of(one, axis, r.sigmas)


def _added(ramp: Ramp, one: _Group, axis: int, unit: Unit | None, own: float) -> Ramp:
    """A ramp with another drift of the same duration, from zero to it, with its ``own`` deviation in
    a unit.
    """
    assert isinstance(one.error, DriftError)
    duration = one.error.duration or 0.0
    end = duration * (float(one.mean[axis]) + own)
    spread = one.deviation(axis, np.full(1, duration)) if unit is None else None
    more = () if spread is None else (spread,)
    return Ramp(ramp.mean + end, (*ramp.deviations, *more))


def _spectrum(error: RandomError) -> _Spectrum:
    return _Spectrum(error.correlation_time, error.lowest, error.highest)


def _keeps_its_distribution(r: Requirement, error: RandomError) -> bool:
    """Whether a random error is in the metric what it is given as: normal, or in no window."""
    return error.distribution == "normal" or not _needs_spectrum(r)


def _crest_in_band(r: Requirement, error: RandomError) -> float:
    """The most that a random error within a bound of 1 makes of a metric; infinite where a band cuts
    it.
    """
    if _keeps_its_distribution(r, error) or not _counts(r, error):
        return 0.0
    if r.lowest > 0.0 or r.highest is not None:
        return math.inf
    return _GAIN[r.metric]


def _random_deviation(
    r: Requirement, one: _Group, axis: int, instants: np.ndarray
) -> list[Deviation]:
    """Deviation of a random error about an axis at the instants of a window: in windows it is larger
    towards their ends.
    """
    assert isinstance(one.error, RandomError)
    if not one.size[axis] or not _counts(r, one.error):
        return []
    whole = Deviation(one.error.distribution, one.size[axis : axis + 1])
    if not _needs_spectrum(r):
        return [whole]
    weights = _weights_at(*_weight_of(r, one.error), tuple(instants.tolist()))
    return [Deviation("normal", np.sqrt(weights * whole.variance))]


def _random_mean_square(r: Requirement, one: _Group, axis: int) -> float:
    """Mean square of a random error about an axis over all of a window [rad^2]."""
    assert isinstance(one.error, RandomError)
    if not _counts(r, one.error):
        return 0.0
    whole = float(Deviation(one.error.distribution, one.size[axis : axis + 1]).variance[0])
    if not _needs_spectrum(r):
        return whole
    return whole * _weight(*_weight_of(r, one.error))


_WeightOf = tuple[Metric, float, float | None, _Spectrum, tuple[float, float]]


def _weight_of(r: Requirement, error: RandomError) -> _WeightOf:
    """Arguments of the weight of a random error in a requirement."""
    ends = r.lowest, math.inf if r.highest is None else r.highest
    return r.metric, r.window or r.apart or 1.0, r.apart, _spectrum(error), ends


@lru_cache(maxsize=256)
def _weight(
    metric: Metric,
    window: float,
    apart: float | None,
    spectrum: _Spectrum,
    ends: tuple[float, float],
) -> float:
    """Mean square in a window of a random error of mean square 1, between two frequencies [Hz]."""
    grid, density, beyond = _density_of(metric, window, spectrum, ends)
    if grid.size < 2:
        return beyond
    return mean_square_of_density(metric, grid, density, window, apart) + beyond


@lru_cache(maxsize=256)
def _weights_at(
    metric: Metric,
    window: float,
    apart: float | None,
    spectrum: _Spectrum,
    ends: tuple[float, float],
    instants: tuple[float, ...],
) -> np.ndarray:
    """``_weight`` at instants of a window, from -1 to 1, (n,); one row where the metric is one value
    of it.
    """
    grid, density, beyond = _density_of(metric, window, spectrum, ends)
    if grid.size < 2:
        return np.full(1, beyond)
    at = np.asarray(instants)
    return mean_squares_at_instants(metric, grid, density, window, apart, at) + beyond


def _density_of(
    metric: Metric, window: float, spectrum: _Spectrum, ends: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Density [1/Hz] of a random error of mean square 1 between two frequencies [Hz], (k,) and (k,),
    less than two where there is none, and its weighted mean square above them.

    What a first-order process has above the highest frequency of the grid counts with the largest
    weight there may be, some 1e-4 at most.
    """
    low, high = ends
    if spectrum.correlation_time is None:
        first, last = spectrum.lowest or 0.0, spectrum.highest or 0.0
        grid = np.array([max(first, low), min(last, high)])
        if grid[0] >= grid[1]:
            return np.zeros(0), np.zeros(0), 0.0
        return grid, np.full(2, 1.0 / (last - first)), 0.0
    tau = spectrum.correlation_time
    corner = 1.0 / (2.0 * math.pi * tau)
    top = max(1e4 * corner, 1e3 / window)
    grid = np.r_[0.0, np.geomspace(1e-4 * corner, top, _DENSE)]
    inside = within_band(grid, low, high)
    grid = np.unique(np.r_[grid[inside], min(max(low, 0.0), top), min(high, top)])
    beyond = 0.0
    if high > top:
        beyond = _LARGEST_WEIGHT.get(metric, 0.0) * (
            1.0 - 2.0 / math.pi * math.atan(max(top, low) / corner)
        )
    return grid, 4.0 * tau / (1.0 + (grid / corner) ** 2), beyond
