"""Structure on the drive's two shafts, as the equations of motion take it: an array on a fixed base, or a craft.

    y'' + D y' + Lambda y + H alpha_l + R alpha_m + V_l omega_l + V_m omega_m = 0
    J_l alpha_l + c alpha_m + H' y'' + V_l' y' = torques on the output
    J_m alpha_m + c alpha_l + R' y'' + V_m' y' = torques on the rotor

On a fixed base y are the array's modes, and R, c and V are zero (Eq. 16-18). On a craft V is what is
left of damping that couples its modes, where each y stands for a complex mode
(``microvib.model.decoupled``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Load:
    """Modes with their participation in both shafts, and the inertia of both."""

    H: np.ndarray
    """Participation in the output's motion, (s,) [kg^0.5 m]."""
    R: np.ndarray
    """Participation in the rotor's motion, (s,); zero on a fixed base."""
    V_l: np.ndarray
    """Viscous participation in the output's motion, (s,) [kg^0.5 m/s]; zero where damping couples
    no modes.
    """
    V_m: np.ndarray
    """Coupling to the rotor's acceleration, (s,)."""
    D: np.ndarray
    """Modal damping, (s,) [1/s]."""
    Omega: np.ndarray
    """Angular frequencies, (s,) [rad/s]."""
    Lambda: np.ndarray
    """Their squares, (s,) [rad^2/s^2]."""
    output: float
    """Inertia of the output with all modes held, J_l [kg m^2]."""
    rotor: float
    """Inertia of the rotor with all modes held, J_m [kg m^2]."""
    cross: float
    """Coupling of the two shafts with all modes held, c [kg m^2]; not zero where free rigid motions
    are taken out of the modes.
    """
    output_left: float
    """Residual inertia of the output, in no mode, J_l - sum H^2 [kg m^2]."""
    array_left: float
    """Residual inertia without the reducer's, J_h [kg m^2]."""

    @cached_property
    def moves(self) -> bool:
        """Whether the ground moves."""
        return self.cross != 0.0 or bool(np.any(self.R) or np.any(self.V_l))

    @property
    def decay(self) -> np.ndarray:
        """Rate at which each mode dies away at the last, (s,) [1/s]: of what is overdamped the
        slower.
        """
        return np.asarray(0.5 * self.D - np.sqrt(np.maximum(0.25 * self.D**2 - self.Lambda, 0.0)))

    @cached_property
    def rotor_left(self) -> float:
        """Residual inertia of the rotor, in no mode, J_m - sum R^2 [kg m^2]."""
        return self.rotor - float(self.R @ self.R)

    @cached_property
    def cross_left(self) -> float:
        """Residual coupling, in no mode, c - sum H R [kg m^2]."""
        return self.cross - float(self.H @ self.R)
