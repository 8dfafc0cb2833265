"""Motion command: a rate profile of the array, and the microsteps it makes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import zip_longest
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity

_RATES = (math.radians(1e-4), math.radians(10.0))


class Leg(Part):
    """One leg of a profile: reach ``rate`` over ``ramp``, then hold it for ``hold``."""

    rate: Annotated[
        float,
        Quantity(
            "rad/s",
            "commanded rate of the array; negative turns back",
            display="deg/s",
            usual=_RATES,
        ),
    ]
    ramp: Annotated[float, Quantity("s", "time to reach the rate linearly; 0 is a jump", ge=0)] = (
        0.0
    )
    hold: (
        Annotated[
            float, Quantity("s", "time at the rate; without it the leg lasts to the end", ge=0)
        ]
        | None
    ) = None


class HeldRate(NamedTuple):
    """A rate that a command holds for a time."""

    start: float
    """When the command reaches it [s]."""
    rate: float
    """[rad/s]."""
    lasts: float
    """How long it is held [s]; infinite where to the end."""
    passed: float
    """How long it is held, and ramped to and from [s]."""


class Tracking(Part):
    """Commanded motion of the array; ``rate`` alone is a constant rate from t = 0."""

    rate: (
        Annotated[
            float,
            Quantity(
                "rad/s",
                "constant commanded rate of the array",
                "omega",
                display="deg/s",
                usual=_RATES,
            ),
        ]
        | None
    ) = None
    profile: tuple[Leg, ...] | None = Field(
        default=None, max_length=1000, description="legs of the motion, from rest"
    )
    clock_ratio: Annotated[
        float, Quantity("", "step clock over its nominal rate", gt=0, le=10, usual=(0.8, 1.25))
    ] = 1.0

    def _consistency_errors(self) -> Iterator[str]:
        if (self.rate is None) == (self.profile is None):
            yield "give either rate, a constant rate of the array in deg/s, or profile, a list of legs"
        if self.profile == ():
            yield "profile: an empty list commands no motion; give at least one leg with a rate"
        for k, leg in enumerate((self.profile or ())[:-1]):
            if leg.hold is None:
                yield f"profile.{k}.hold: only the last leg may leave hold out; give a time in s"

    @property
    def reversed(self) -> Tracking:
        """Motion in the opposite direction."""
        legs = self.profile and tuple(
            leg.model_copy(update={"rate": -leg.rate}) for leg in self.profile
        )
        return self.model_copy(
            update={"rate": None if self.rate is None else -self.rate, "profile": legs}
        )

    def breakpoints(self) -> tuple[np.ndarray, np.ndarray]:
        """Piecewise linear rate: times [s] and rates [rad/s] of the array, (m,) each; a jump
        repeats its time.

        The last rate lasts for ever. Rates carry the clock ratio; the legs are timed by the
        computer that commands them.
        """
        if self.profile is None:
            return np.array([0.0]), np.array([float(self.rate or 0.0) * self.clock_ratio])
        times, rates, now, rate = [0.0], [0.0], 0.0, 0.0
        for leg in self.profile:
            now += leg.ramp
            rate = leg.rate * self.clock_ratio
            times.append(now)
            rates.append(rate)
            if leg.hold is not None:
                now += leg.hold
                times.append(now)
                rates.append(rate)
        return np.array(times), np.array(rates)

    def held_rates(self) -> list[HeldRate]:
        """Rates that the legs of a profile reach, in order, none without one; they carry the clock ratio."""
        legs = self.profile or ()
        found, now = [], 0.0
        for leg, after in zip_longest(legs, legs[1:]):
            now += leg.ramp
            lasts = math.inf if leg.hold is None else leg.hold
            passed = leg.ramp + lasts + (after.ramp if after else 0.0)
            found.append(HeldRate(now, leg.rate * self.clock_ratio, lasts, passed))
            now += lasts
        return found

    def constant_rate(self, start: float, stop: float) -> float | None:
        """The one rate [rad/s] between two times [s], or None where the rate changes."""
        if self.profile is None:
            return float(self.rate or 0.0) * self.clock_ratio
        times, rates = self.breakpoints()
        before = int(np.searchsorted(times, start + 1e-12 * (1 + start), side="right")) - 1
        after = int(np.searchsorted(times, stop - 1e-12 * (1 + stop), side="left"))
        inside = rates[before : after + 1]
        if np.all(inside == inside[0]):
            return float(inside[0])
        return None
