"""Directions in which parameters change a drive.

Some parameters change a drive as others do: the contact force and the friction factor of a slip ring,
two inertias on one shaft, a rate and a ratio of clocks. What follows from one of them then follows
from the other in proportion, and a period is taken again for one of them only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.scenario import Scenario
from microvib.solve.steady.period import PeriodMap
from microvib.solve.steady.recorded import RecordedPeriod

NEW = 1e-4
"""Part of a change that others do not make from which it is a direction of its own; numbers that follow
from parameters are curved by a hundredth of that."""
AS_GOOD_AS_0 = 1e-6
"""Part of the largest of some numbers below which one is rounding: a current where its sine is 0."""


@dataclass(frozen=True)
class Parameters:
    """Parameters, and what their changes are relative to."""

    keys: tuple[str, ...]
    scales: np.ndarray
    """[SI], (p,)."""

    @classmethod
    def of(cls, scenario: Scenario, keys: Sequence[str], scales: Mapping[str, float]) -> Parameters:
        """Parameters of a scenario, relative to themselves or to given ``scales`` [SI].

        Raises MicrovibError for a key that is not a number, or is 0 without a scale.
        """
        return cls(tuple(keys), np.array([_scale(scenario, key, scales) for key in keys]))

    def changed(self, scenario: Scenario, parts: np.ndarray) -> Scenario:
        """Scenario in which each parameter is more by a part of its scale."""
        for key, change in zip(self.keys, (parts * self.scales).tolist(), strict=True):
            if change:
                scenario = scenario.nudged(key, scenario[key] + change)
        return scenario

    @property
    def are_shapes(self) -> np.ndarray:
        """Which of them are shapes of a Stribeck curve, (p,)."""
        return np.array([key.endswith("stribeck_shape") for key in self.keys], dtype=bool)

    def only(self, numbers: Sequence[int]) -> Parameters:
        """Some of the parameters, by their numbers."""
        return Parameters(tuple(self.keys[k] for k in numbers), self.scales[list(numbers)])


def _scale(scenario: Scenario, key: str, scales: Mapping[str, float]) -> float:
    value = scenario[key]
    if (
        not isinstance(value, float)
        or not math.isfinite(value)
        or (not value and key not in scales)
    ):
        raise MicrovibError(f"{key}: {value} has no derivative; expected a number other than 0")
    return scales.get(key, abs(value))


@dataclass(frozen=True)
class Directions:
    """Changes of a drive that are independent of each other, and what parameters have of them."""

    chosen: tuple[int, ...]
    """Numbers of the parameters whose changes they are, (d,)."""
    periods: tuple[PeriodMap, ...]
    """The period of each drive changed so, (d,)."""
    parts: np.ndarray
    """Parts of them in each parameter's change, (d, p)."""

    def combined(self, changes: np.ndarray) -> np.ndarray:
        """Changes by the parameters (n, p), from those by the directions (n, d); nan where that is not
        known.
        """
        known = np.all(np.isfinite(changes), axis=0)
        result = changes[:, known] @ self.parts[known]
        result[:, np.any(self.parts[~known] != 0.0, axis=0)] = np.nan
        return result


def directions(period: RecordedPeriod, parameters: Parameters, step: float) -> Directions:
    """Directions of the changes of a recorded drive by a ``step`` of each parameter, over its scale."""
    numbers, scenario = _numbers(period.map), period.map.scenario
    here, scale = np.concatenate(numbers), _scales(numbers)
    finite = np.isfinite(here)  # the voltage of a supply without a limit is not
    units, count = np.zeros((len(parameters.keys), here.size)), 0
    changes = np.zeros_like(units)
    chosen, periods = [], []
    for number, part in enumerate(step * np.eye(len(units))):
        changed = period.of(parameters.changed(scenario, part))
        there = np.concatenate(_numbers(changed))
        is_new = there.shape != here.shape  # numbers that are not here, which no other one makes
        if not is_new:
            change = changes[number]
            change[finite] = (there[finite] - here[finite]) / scale[finite]
            left = change - (units[:count] @ change) @ units[:count]
            size = math.sqrt(left @ left)
            is_new = size > NEW * math.sqrt(change @ change)
            if is_new:
                units[count] = left / size
                count += 1
        if is_new:
            chosen.append(number)
            periods.append(changed)
    parts = np.zeros((len(chosen), len(units)))
    if chosen:
        parts[:] = np.linalg.lstsq(changes[chosen].T, changes.T, rcond=None)[0]
        parts[np.abs(parts) < NEW] = 0.0
        parts[:, chosen] = np.eye(len(chosen))
    return Directions(tuple(chosen), tuple(periods), parts)


def _numbers(period: PeriodMap) -> list[np.ndarray]:
    """All that a motion over a period follows from, with the same steps from the same start: single
    numbers, (n,), and then arrays of numbers of a kind.
    """
    single, *arrays = period.packed.numbers
    own = [period.frequency, period.commanded_output, period.after_clock]
    clock = period.clocks(np.array([0]))[0]
    return [np.concatenate([single, own]), *arrays, clock, period.times, *period.commands.T]


def _scales(numbers: list[np.ndarray]) -> np.ndarray:
    """Sizes that changes of numbers count over: themselves, or the largest of their kind, beside which they are
    as good as 0.
    """
    found = [np.where(numbers[0] == 0.0, 1.0, np.abs(numbers[0]))]
    for values in numbers[1:]:
        largest = np.max(np.abs(values), initial=0.0) or 1.0
        size = np.abs(values)
        found.append(np.where(size > AS_GOOD_AS_0 * largest, size, largest))
    return np.concatenate(found)
