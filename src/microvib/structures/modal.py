"""A modal model of an array, from whatever finite elements: frequencies, damping, participation,
rigid-body mass (Table 1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.array import ROUNDING_TOLERANCE, Array
from microvib.model.rigid import elements
from microvib.model.sentences import validate_part

RIGID = 1e-6
"""Relative size of what a rigid body's mass matrix cannot have, up to which it is rounding."""


class ModalError(MicrovibError):
    """A modal model that cannot be right, or cannot be used; says why."""


def natural_frequency(eigenvalue: Any) -> Any:
    """Natural frequency [Hz] of each square of an angular frequency [rad^2/s^2]; zero where
    rounding made it negative.
    """
    return np.sqrt(np.maximum(eigenvalue, 0.0)) / (2.0 * np.pi)


@dataclass(frozen=True)
class ModalModel:
    """Fixed-interface modes, mass-normalised, seen from the interface point."""

    frequency: np.ndarray
    """Natural frequencies with the interface clamped [Hz], (s,), ascending."""
    damping: np.ndarray
    """Modal damping ratios, (s,)."""
    participation: np.ndarray
    """Participation in the six directions [kg^0.5, kg^0.5 m], (6, s) (Eq. 13)."""
    mass: np.ndarray
    """Rigid-body mass matrix at the interface point [kg, kg m, kg m^2], (6, 6)."""
    drive_axis: str = "z"
    """Axis of the interface frame about which the drive turns: x, y or z."""
    title: str = ""
    notes: tuple[str, ...] = ()
    """Notes on checks and assumptions."""

    def __post_init__(self) -> None:
        s = self.frequency.size
        if (
            self.damping.shape != (s,)
            or self.participation.shape != (6, s)
            or self.mass.shape != (6, 6)
        ):
            raise ModalError(
                f"{self.title}: {s} modes need damping (s,), participation (6, s) and mass (6, 6)"
            )
        if self.drive_axis not in ("x", "y", "z"):
            raise ModalError(
                f"{self.title}: drive axis '{self.drive_axis}' is not known; allowed are x, y and z"
            )

    @property
    def axis(self) -> int:
        """Row of the torque about the drive axis."""
        return 3 + "xyz".index(self.drive_axis)

    @property
    def inertia(self) -> float:
        """Moment of inertia J about the drive axis [kg m^2]."""
        return float(self.mass[self.axis, self.axis])

    @property
    def spatial(self) -> bool:
        """Whether more is known than the motion about the drive axis."""
        return bool(np.any(np.delete(np.diag(self.mass), self.axis) > 0.0))

    @property
    def effective(self) -> np.ndarray:
        """Effective mass and inertia of each mode in the six directions [kg, kg m^2], (6, s):
        H_i^2.
        """
        return self.participation**2

    @property
    def fraction(self) -> np.ndarray:
        """Effective mass over rigid-body mass, (6, s) (Table 1); nan in a direction without mass."""
        total = np.diag(self.mass)[:, None]
        return np.divide(
            self.effective, total, out=np.full(self.effective.shape, np.nan), where=total > 0.0
        )

    @property
    def J_h(self) -> float:
        """Residual inertia J - sum H^2 about the drive axis [kg m^2], rigidly attached to the shaft."""
        return self.inertia - float(self.effective[self.axis].sum())

    def first(self, count: int) -> ModalModel:
        """Model with its first ``count`` modes."""
        return replace(
            self,
            frequency=self.frequency[:count],
            damping=self.damping[:count],
            participation=self.participation[:, :count],
        )

    def array(self) -> Array:
        """The array of a scenario; ModalError where the modes hold more inertia than there is."""
        if self.J_h < -ROUNDING_TOLERANCE * self.inertia:
            raise ModalError(
                f"{self.title}: effective inertias about {self.drive_axis} add up to"
                f" {self.inertia - self.J_h:.6g} kg*m^2, more than the inertia, {self.inertia:.6g}"
                " kg*m^2"
            )
        if self.spatial:
            key, rows = "interface_participation", self.participation.T.tolist()
        else:
            key, rows = "participation", self.participation[self.axis].tolist()
        if self.spatial:
            coupling = self.mass[:, self.axis].tolist()
        else:
            coupling = None
        modes = [
            {"frequency": f, "damping": xi, key: row}
            for f, xi, row in zip(self.frequency.tolist(), self.damping.tolist(), rows, strict=True)
        ]
        whole = {
            "inertia": self.inertia,
            "modes": modes,
            "interface_inertia": coupling,
            "drive_axis": self.drive_axis,
        }
        return validate_part(Array, {**whole, "rigid_body": self._rigid_body()}, si=True)

    def _rigid_body(self) -> dict[str, Any] | None:
        """Mass properties, where the mass matrix is that of a rigid body (the same mass in all
        directions).
        """
        m, coupling = np.diag(self.mass)[:3], self.mass[:3, 3:]
        largest = float(np.abs(coupling).max())
        if (
            m.min() <= 0.0
            or np.ptp(m) > RIGID * m.max()
            or np.abs(coupling + coupling.T).max() > RIGID * largest
        ):
            return None
        mass = float(m.mean())
        center = np.array(
            [
                coupling[1, 2] - coupling[2, 1],
                coupling[2, 0] - coupling[0, 2],
                coupling[0, 1] - coupling[1, 0],
            ]
        )
        inertia = self.mass[3:, 3:]
        return {
            "mass": mass,
            "center_of_mass": (center / (2.0 * mass)).tolist(),
            "inertia": elements(inertia),
        }
