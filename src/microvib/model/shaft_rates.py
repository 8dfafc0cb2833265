"""Rates of a drive's shafts over an electrical turn, as a run or a steady state has them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class ShaftRates:
    """Mean over all electrical turns of a motion, each from where the rotor's even motion passes the
    electrical angle 0, at equal steps of time.
    """

    rotor: np.ndarray
    """[rad/s], (n,)."""
    output: np.ndarray
    """[rad/s], (n,)."""
    rotor_remainder: float = 0.0
    """By how much the rotor's rate is off this mean at most [rad/s]."""
    output_remainder: float = 0.0
    """By how much that of the output is [rad/s]."""
    output_angle: float = 0.0
    """Angle of the output [rad] where that of the rotor is 0."""
    least_gear_torque: float = 0.0
    """Torque [N m] that the gear carries at all times, either way; 0 where it changes its sign."""
    gear_swing: float = math.inf
    """Range of that torque [N m]."""
    at_supply_limit: bool = False
    """Whether the supply limits the voltage of a winding at times."""

    def or_as(self, other: ShaftRates | None) -> ShaftRates | None:
        """Rates of either of two motions: those of the first, and how far the other's are off."""
        if other is None:
            return None
        at = np.arange(self.rotor.size) / self.rotor.size
        of_other = np.arange(other.rotor.size) / other.rotor.size
        off = [
            float(np.max(np.abs(own - np.interp(at, of_other, theirs, period=1.0))))
            for own, theirs in ((self.rotor, other.rotor), (self.output, other.output))
        ]
        return ShaftRates(
            self.rotor,
            self.output,
            max(self.rotor_remainder, off[0] + other.rotor_remainder),
            max(self.output_remainder, off[1] + other.output_remainder),
            self.output_angle,
            min(self.least_gear_torque, other.least_gear_torque),
            max(self.gear_swing, other.gear_swing),
            self.at_supply_limit or other.at_supply_limit,
        )


def rates_over_turn(
    angle: np.ndarray,
    rates: tuple[np.ndarray, np.ndarray],
    rate: float,
    step: float,
    *,
    repeats: bool = False,
) -> ShaftRates | None:
    """Fold the rates of rotor and output (n,) [rad/s] over an electrical turn.

    Parameters
    ----------
    angle : array
        Electrical angle of the rotor [rad], (n,).
    rates : pair of arrays
        Rates of rotor and output [rad/s], (n,) each.
    rate : float
        Mean rate of that angle [rad/s].
    step : float
        Time between samples [s].
    repeats : bool
        What is given is one period of a motion that repeats.

    Returns
    -------
    ShaftRates or None
        None where less than a turn is given.
    """
    turn = 2.0 * np.pi / abs(rate)
    count = angle.size
    if repeats:
        more = 2 * int(np.ceil(turn / (count * step))) + 1
        rates = np.tile(rates[0], more), np.tile(rates[1], more)
    time = step * np.arange(rates[0].size)
    first = -float(np.mean(angle - rate * time[:count])) / rate % turn
    turns = int((time[-1] - first) / turn + 1e-9)
    if turns < 1:
        return None
    per_turn = max(round(turn / step), 1)
    at = first + turn * np.arange(per_turn * turns) / per_turn
    folded = [np.interp(at, time, x).reshape(turns, per_turn) for x in rates]
    mean = [x.mean(axis=0) for x in folded]
    remainder = [float(np.max(np.abs(x - m))) for x, m in zip(folded, mean, strict=True)]
    return ShaftRates(mean[0], mean[1], remainder[0], remainder[1])
