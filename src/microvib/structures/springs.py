"""Solar array simulator: eight springs at an arm hold an inertia frame (Eq. 21-24), and what a coil
spring of its kind bears.
"""

import math
from typing import Any

SPRINGS = 8  # four pairs, of which one spring lengthens by what the other shortens (Eq. 22)


def kinetic_energy(inertia: float, rate: float) -> float:
    """Energy [J] of ``inertia`` [kg m^2] that turns at ``rate`` [rad/s] (Eq. 21)."""
    return 0.5 * inertia * rate**2


def spring_energy(stiffness: float, arm: float, preload: float, angle: float) -> float:
    """Energy [J] that eight springs [N/m] gain at ``angle`` [rad] over that of their ``preload``
    [m] (Eq. 22).
    """
    move = arm * angle
    pair = (preload + move) ** 2 + (preload - move) ** 2 - 2.0 * preload**2
    return SPRINGS / 2 * 0.5 * stiffness * pair


def torsion_stiffness(stiffness: float, arm: float) -> float:
    """Stiffness 8 k l^2 [N m/rad] of eight springs at an arm (Eq. 23)."""
    return SPRINGS * stiffness * arm**2


def torsion_frequency(stiffness: float, arm: float, inertia: float) -> float:
    """Torsional frequency [Hz] of eight springs ``stiffness`` [N/m] at ``arm`` [m] on ``inertia``
    [kg m^2] (Eq. 24 with 1/2pi).
    """
    return 2.0 * arm * math.sqrt(2.0 * stiffness / inertia) / (2.0 * math.pi)


def preload_stiffness(force: Any, hook: float, length: Any) -> Any:
    """Contribution of the tension [N] of eight springs to the stiffness about the shaft [N m/rad].

    A spring of ``length`` [m] runs from ``hook`` [m] off the plate's middle line, square to it, to
    the frame: turned by alpha it is longer by l alpha + hook (hook + length)/(2 length) alpha^2.
    Eq. 22 has the first term; with hooks on the middle line there is no other.
    """
    return SPRINGS * force * hook * (hook + length) / length


def wahl_factor(wire: float, coil: float) -> float:
    """Stress at the inner side of a coil over that of the straight bar, by Wahl."""
    index = coil / wire
    return (4.0 * index - 1.0) / (4.0 * index - 4.0) + 0.615 / index


def coil_stress(force: float, wire: float, coil: float) -> float:
    """Largest shear stress [Pa] of a coil spring at ``force`` [N], curvature by Wahl."""
    return wahl_factor(wire, coil) * 8.0 * force * coil / (math.pi * wire**3)


def allowable_stress(wire: float) -> float:
    """Shear stress [Pa] that extension springs of ``wire`` [m] are designed for: 0.45 of the
    tensile strength (EN 13906-2).

    The strength is that of wire EN 10270-1 SH, 2220 - 820 lg(d/mm) MPa.
    """
    return 0.45 * (2220.0 - 820.0 * math.log10(wire * 1e3)) * 1e6
