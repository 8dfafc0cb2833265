"""Whether the shafts of a drive stick in a motion, so that friction holds them at times, and how fast
they are over an electrical turn.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from microvib.model.drive_states import MAY_STICK, Sticking
from microvib.model.scenario import Scenario
from microvib.model.shaft_rates import ShaftRates, rates_over_turn

_SAMPLES_PER_MICROSTEP = 4
"""Samples of a microstep, at least, that tell how rates change within it."""
_AT_LIMIT = 0.999
"""Part of the supply's voltage from which it limits that of a winding."""


class Shafts(Protocol):
    """A motion or a steady state, with its channels."""

    @property
    def scenario(self) -> Scenario:
        """Scenario of the motion."""
        ...

    @property
    def time(self) -> np.ndarray:
        """Instants [s], (n,)."""
        ...

    def __getitem__(self, name: str) -> np.ndarray:
        """Samples of a channel, (n,)."""
        ...


def sticking_of(motion: Shafts | None, *, repeats: bool = False) -> Sticking:
    """Which shafts of a drive stick at any time of a motion, or turn back.

    Where a rate changes its sign it is zero for an instant, and friction may hold a shaft there.
    Where no motion was kept, both may. ``repeats`` says that it is a steady motion.
    """
    if motion is None:
        return MAY_STICK
    return Sticking(
        _sticks(motion["stuck_rotor"], motion["omega_m"]),
        _sticks(motion["stuck_output"], motion["omega_l"]),
        float(np.min(np.abs(motion["omega_m"]))),
        float(np.min(np.abs(motion["omega_l"]))),
        repeats,
        _rates_of(motion, repeats=repeats),
    )


def _sticks(stuck: np.ndarray, rate: np.ndarray) -> bool:
    return bool(np.any(stuck > 0.0) or np.min(rate) <= 0.0 <= np.max(rate))


def _rates_of(motion: Shafts, *, repeats: bool) -> ShaftRates | None:
    """Rates over an electrical turn; None of a rate that changes, or where samples are too few."""
    scenario, time = motion.scenario, motion.time
    if not scenario.rate or time.size < 2:
        return None
    step, teeth = float(time[1] - time[0]), scenario.motor.rotor_teeth
    if _SAMPLES_PER_MICROSTEP * step * float(scenario.driving_frequency or 0.0) > 1.0:
        return None
    rotor = -scenario.reducer.h * scenario.rate
    angle, rates = motion["theta_m"], (motion["omega_m"], motion["omega_l"])
    found = rates_over_turn(teeth * angle, rates, teeth * rotor, step, repeats=repeats)
    if found is None:
        return None
    torque, limit = motion["T_g"], scenario.driver.supply_voltage
    one_way = float(np.min(torque)) * float(np.max(torque)) > 0.0
    voltage = max(float(np.max(np.abs(motion[name]))) for name in ("u_A", "u_B"))
    return replace(
        found,
        output_angle=float(np.mean(motion["theta_l"] + angle / scenario.reducer.h)),
        least_gear_torque=float(np.min(np.abs(torque))) if one_way else 0.0,
        gear_swing=float(np.ptp(torque)),
        at_supply_limit=limit is not None and voltage >= _AT_LIMIT * limit,
    )
