"""Manoeuvres: a change of rate, or a rotation by an angle, made of one change of rate or two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.errors import OptionError
from microvib.studies.profiles.rate_profile import RateProfile


@dataclass(frozen=True)
class Manoeuvre:
    """Motion that the array is to make: from a rate to a rate, and where it has an ``angle``, gaining it on a
    target that moves with the final rate all the time.
    """

    initial_rate: float
    """[rad/s]."""
    final_rate: float
    """[rad/s]."""
    angle: float | None = None
    """Angle [rad] that is gained on a target that moves with the final rate: of a rewind, which
    ends at rest, the angle that the array turns through; of a catch-up the angle that it lagged."""
    largest_rate: float = math.inf
    """[rad/s]; only with an angle."""
    largest_acceleration: float = math.inf
    """[rad/s^2]."""

    @property
    def slew_rate(self) -> float:
        """Rate with which an angle is gained [rad/s]."""
        return math.copysign(self.largest_rate, self.angle or 0.0)

    @property
    def changes(self) -> tuple[tuple[float, float], ...]:
        """Changes of rate [rad/s], each from and to; the second waits for the angle."""
        if self.angle is None:
            return ((self.initial_rate, self.final_rate),)
        return ((self.initial_rate, self.slew_rate), (self.slew_rate, self.final_rate))

    @property
    def largest_change(self) -> float:
        """Size of the largest change of rate [rad/s]."""
        return max(abs(b - a) for a, b in self.changes)

    def bound_on_acceleration(self, change: int) -> float:
        """Largest acceleration of a change of rate by one [1/s]."""
        first, last = self.changes[change]
        return self.largest_acceleration / abs(last - first)

    def profile(self, transitions: Sequence[RateProfile], wind_up: float = 0.0) -> RateProfile:
        """The manoeuvre, its changes of rate made by ``transitions`` from 0 to 1.

        Parameters
        ----------
        transitions : sequence of RateProfile
            One for each of ``changes``.
        wind_up : float
            Angle [rad] that is commanded first, at the rate of the first change, to wind up a drive
            that is held by friction.

        Returns
        -------
        RateProfile
            Rates over time from 0.

        Raises
        ------
        OptionError
            Where the angle is too small for these changes of rate.
        """
        peak = self.changes[0][1]
        wound = _wind_up_profile(wind_up, peak)
        if self.angle is None:
            made = transitions[0].scaled(self.initial_rate, self.final_rate)
            return made if wound is None else wound.then(made)
        peak, hold = self.slew(transitions, wind_up)
        first = transitions[0].scaled(self.initial_rate, peak)
        last = transitions[1].scaled(peak, self.final_rate)
        made = first.then(last, hold)
        return made if wound is None else wound.then(made)

    def last_change(self, transitions: Sequence[RateProfile], wind_up: float = 0.0) -> float:
        """Size with its sign of the last change of rate [rad/s], which is smaller where the angle
        does not let the largest rate be reached.
        """
        if self.angle is None:
            return self.final_rate - self.initial_rate
        return self.final_rate - self.slew(transitions, wind_up)[0]

    def slew(self, transitions: Sequence[RateProfile], wind_up: float = 0.0) -> tuple[float, float]:
        """Rate of the slew [rad/s] and how long it is held [s], after a ``wind_up`` [rad].

        Over the first change the angle gained is (r_0 - r_1) T + (r - r_0) (T - tau), over the hold
        (r - r_1) h, over the last change (r - r_1) tau, with each one's time T and lag tau.
        """
        angle = float(self.angle or 0.0)
        late = wind_up / self.largest_rate
        up, down = transitions
        start, end, rate = self.initial_rate, self.final_rate, self.slew_rate
        lag_up, lag_down = lag(up), lag(down)
        wanted = angle + end * late
        made = (
            (start - end) * up.duration
            + (rate - start) * (up.duration - lag_up)
            + (rate - end) * lag_down
        )
        hold = (wanted - made) / (rate - end)
        if hold >= 0.0:
            return rate, hold
        over = up.duration - lag_up + lag_down
        if over > 0.0:
            given = (start - end) * up.duration - start * (up.duration - lag_up) - end * lag_down
            slower = (wanted - given) / over
        else:
            slower = end
        if (slower - end) * (rate - end) <= 0.0 or abs(slower) > abs(rate):
            raise OptionError(
                "angle",
                "is too small for these changes of rate: the array has gained more by the end of the first;"
                " give a larger angle, or a smaller largest_rate",
                f"{math.degrees(angle):.6g} deg",
            )
        return slower, 0.0


def _wind_up_profile(angle: float, rate: float) -> RateProfile | None:
    if angle == 0.0 or rate == 0.0:
        return None
    return RateProfile(np.array([0.0, angle / abs(rate)]), np.array([rate, rate]))


def lag(transition: RateProfile) -> float:
    """Time [s] by which a change of rate from 0 to 1 is late against a jump at its begin."""
    return transition.duration - transition.angle
