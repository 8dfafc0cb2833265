"""Microstep command and current loop (Eq. 1, 2, 25, 26)."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from microvib.model.motor import Motor
from microvib.model.part import Part
from microvib.units import Quantity


class Driver(Part):
    """Microstepping current driver with one PI(D) loop per phase (Table 3)."""

    beats: Annotated[int, Field(ge=3, le=64, strict=True, description="full steps per electrical period, b")]
    microsteps: Annotated[int, Field(ge=1, le=65_536, strict=True, description="microsteps per full step, n")]
    proportional_gain: Annotated[
        float, Quantity("V/A", "proportional gain of the current loop", "K_P", ge=0, usual=(0.05, 1e5))
    ]
    integral_gain: Annotated[
        float, Quantity("V/A/s", "integral gain of the current loop", "K_I", ge=0, display="V/(A*s)", usual=(0.05, 1e8))
    ]
    derivative_gain: Annotated[float, Quantity("V*s/A", "derivative gain, on the measured current", "K_D", ge=0)] = 0.0
    supply_voltage: (
        Annotated[float, Quantity("V", "limit of the phase voltage; null is none", "U", gt=0, usual=(1.0, 400.0))]
        | None
    ) = None

    def full_step(self, motor: Motor) -> float:
        """Full step of the rotor Delta theta [rad] (Eq. 25)."""
        return 2.0 * math.pi / (self.beats * motor.rotor_teeth)

    def microstep(self, motor: Motor) -> float:
        """Microstep of the rotor [rad]."""
        return self.full_step(motor) / self.microsteps

    def driving_frequency(self, motor: Motor, omega_m: float) -> float:
        """Microsteps per second f_d [Hz] at the rotor rate ``omega_m`` [rad/s] (Eq. 26)."""
        return abs(omega_m) / self.microstep(motor)

    def electrical_angle(self, count: np.ndarray) -> np.ndarray:
        """Electrical angle theta_e [rad] after ``count`` microsteps, an array of any shape (Eq. 1, corrected)."""
        return 2.0 * math.pi * count / (self.beats * self.microsteps)

    def reference_currents(self, motor: Motor, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reference currents i_A*, i_B* [A] after ``count`` microsteps (Eq. 1, corrected)."""
        angle = self.electrical_angle(count)
        return motor.current * np.cos(angle), motor.current * np.sin(angle)

    def time_constant(self, motor: Motor) -> float:
        """Fast time constant of the closed current loop [s]."""
        return (motor.winding_inductance + self.derivative_gain) / (self.proportional_gain + motor.winding_resistance)
