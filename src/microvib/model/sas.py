"""Solar array simulator: frequency of the spring-held inertia frame (Eq. 21-24)."""

import math


def torsion_frequency(stiffness: float, arm: float, inertia: float) -> float:
    """Torsional frequency [Hz] of eight springs ``stiffness`` [N/m] at ``arm`` [m] on ``inertia`` [kg m^2] (Eq. 24 with 1/2pi)."""
    return 2.0 * arm * math.sqrt(2.0 * stiffness / inertia) / (2.0 * math.pi)


def spring_rate_times_arm_squared(frequency: float, inertia: float) -> float:
    """The product k l^2 [N m] that gives ``frequency`` [Hz] with ``inertia`` [kg m^2] (Eq. 23)."""
    return (2.0 * math.pi * frequency) ** 2 * inertia / 8.0
