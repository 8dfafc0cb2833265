"""Flexible solar array in modal coordinates (Eq. 8-16, Table 1)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from microvib.model.part import Part, Six
from microvib.model.rigid import COMPONENTS, RigidBody
from microvib.units import Quantity

ROUNDING_TOLERANCE = 1e-9  # relative; what rounding may make of sum H^2 = J
TABLE_ROUNDING_TOLERANCE = (
    1e-3  # relative; what rounding of printed tables and single precision may do to masses
)


class Mode(Part):
    """One fixed-interface mode, mass-normalised (Eq. 14, 16)."""

    frequency: Annotated[
        float,
        Quantity(
            "Hz",
            "natural frequency with the interface clamped",
            "Omega/2pi",
            gt=0,
            usual=(5e-3, 5000.0),
        ),
    ]
    damping: Annotated[
        float,
        Quantity(
            "", "modal damping ratio", "xi", ge=0, le=0.99, display="percent", usual=(1e-4, 0.15)
        ),
    ]
    participation: (
        Annotated[float, Quantity("kg^0.5*m", "participation about the drive axis", "H")] | None
    ) = None
    effective_inertia: (
        Annotated[float, Quantity("kg*m^2", "effective inertia about the drive axis", "H^2", ge=0)]
        | None
    ) = None
    interface_participation: Six | None = Field(
        default=None,
        description="participation in Fx Fy Fz [kg^0.5] and Mx My Mz [kg^0.5 m] at the interface",
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.participation is not None and self.effective_inertia is not None:
            yield "participation and effective_inertia are alternatives; give one of them"

    @property
    def H(self) -> float | None:
        """Participation about the drive axis [kg^0.5 m], or None where it is left to the array."""
        if self.effective_inertia is not None:
            return math.sqrt(self.effective_inertia)
        return self.participation


class Array(Part):
    """Solar array, or its simulator, about the drive axis; no modes make it a rigid load."""

    inertia: Annotated[
        float,
        Quantity("kg*m^2", "moment of inertia about the drive axis", "J", gt=0, usual=(1e-3, 1e5)),
    ]
    rigid_inertia: (
        Annotated[float, Quantity("kg*m^2", "inertia rigidly on the shaft", "J_h", ge=0)] | None
    ) = None
    modes: tuple[Mode, ...] = Field(
        max_length=2000, description="fixed-interface modes; an empty list is a rigid load"
    )
    interface_inertia: Six | None = Field(
        default=None,
        description="rigid-body inertia coupling a rotation about the drive axis to Fx Fy Fz [kg m], Mx My Mz [kg m^2];"
        " without it the centre of mass is on the drive axis, a principal axis",
    )
    drive_axis: Literal["x", "y", "z"] = Field(
        default="z", description="drive axis in the interface frame"
    )
    rigid_body: RigidBody | None = Field(
        default=None, description="mass properties of the whole array, which a spacecraft needs"
    )

    def _consistency_errors(self) -> Iterator[str]:
        yield from self._participation_errors()
        yield from self._interface_inertia_errors()
        yield from self._rigid_body_errors()
        yield from self._effective_inertia_errors()

    def _participation_errors(self) -> Iterator[str]:
        axis = self._axis
        rows = [mode.interface_participation for mode in self.modes]
        for k, (row, mode) in enumerate(zip(rows, self.modes, strict=True)):
            if not row or mode.H is None:
                continue
            if not math.isclose(abs(row[axis]), abs(mode.H), rel_tol=1e-6, abs_tol=1e-9):
                yield (
                    f"modes.{k}: interface_participation about {self.drive_axis} is {row[axis]:g}"
                    " kg^0.5*m and"
                    f" participation {mode.H:g} kg^0.5*m; they must be equal"
                )
        if any(rows) and not all(rows):
            yield f"modes.{rows.index(None)}.interface_participation: missing; give it for all modes, or for none"

    def _interface_inertia_errors(self) -> Iterator[str]:
        if self.interface_inertia is None:
            return
        J = self.interface_inertia[self._axis]
        if not math.isclose(J, self.inertia, rel_tol=1e-3):
            yield (
                f"interface_inertia: {J:g} kg*m^2 about"
                f" {self.drive_axis} disagrees with inertia,"
                f" {self.inertia:g} kg*m^2; they must be equal"
            )

    def _effective_inertia_errors(self) -> Iterator[str]:
        J, rigid = self.inertia, self.rigid_inertia
        given = [self._given(mode) for mode in self.modes]
        if None in given and (len(self.modes) > 1 or rigid is None):
            yield (
                f"modes.{given.index(None)}: participation is missing; give participation or"
                " effective_inertia of each mode,"
                " or rigid_inertia where there is one mode"
            )
        if rigid is not None and rigid > J * (1 + ROUNDING_TOLERANCE):
            yield f"rigid_inertia: {rigid:g} kg*m^2 is more than the inertia, {J:g} kg*m^2"
        if None in given:
            return
        effective = sum((H or 0.0) ** 2 for H in given)
        if effective > J * (1 + ROUNDING_TOLERANCE):
            yield (
                f"modes: effective inertias H^2 add up to {effective:g} kg*m^2, more than the"
                f" inertia, {J:g} kg*m^2; they must"
                " not exceed it"
            )
        residual = J - effective
        if rigid is not None and not math.isclose(rigid, residual, rel_tol=1e-3, abs_tol=1e-6 * J):
            yield (
                f"rigid_inertia: {rigid:g} kg*m^2 disagrees with inertia - sum H^2 = {residual:g}"
                " kg*m^2; leave it out, or"
                " correct the modes"
            )

    def _rigid_body_errors(self) -> Iterator[str]:
        if self.rigid_body is None:
            return
        M, axis = self.rigid_body.matrix, self._axis
        if not math.isclose(M[axis, axis], self.inertia, rel_tol=TABLE_ROUNDING_TOLERANCE):
            yield (
                f"rigid_body.inertia: {M[axis, axis]:g} kg*m^2 about {self.drive_axis} disagrees"
                " with inertia,"
                f" {self.inertia:g} kg*m^2; they must be equal"
            )
        size = np.sqrt(np.diag(M))
        size = np.where(size > 0.0, size, 1.0)
        if self.interface_inertia is not None:
            off = np.abs(np.array(self.interface_inertia) - M[:, axis]) / (size * size[axis])
            if off.max() > TABLE_ROUNDING_TOLERANCE:
                k = int(off.argmax())
                yield (
                    f"interface_inertia: {self.interface_inertia[k]:g} in {COMPONENTS[k]} disagrees"
                    " with rigid_body, which has"
                    f" {M[k, axis]:g} there; leave it out, or correct one of them"
                )
        P = self.interface
        if P is None:
            return
        least = float(np.linalg.eigvalsh((M - P @ P.T) / np.outer(size, size)).min())
        if least < -TABLE_ROUNDING_TOLERANCE:
            yield (
                "rigid_body: the modal effective masses exceed the rigid-body mass (D_0 = M_r - P"
                f" P' has the eigenvalue {least:.3g}"
                " of its diagonal, and must be positive semi-definite); mass, participation and"
                " reference point are inconsistent"
            )

    @property
    def _axis(self) -> int:
        return 3 + "xyz".index(self.drive_axis)

    def _given(self, mode: Mode) -> float | None:
        if mode.interface_participation is not None:
            return mode.interface_participation[self._axis]
        return mode.H

    @property
    def H(self) -> np.ndarray:
        """Participation of each mode about the drive axis, (s,) [kg^0.5 m] (Eq. 13, 16)."""
        given = [self._given(mode) for mode in self.modes]
        if None in given:
            return np.array([math.sqrt(max(self.inertia - (self.rigid_inertia or 0.0), 0.0))])
        return np.array(given, dtype=float)

    @property
    def J_h(self) -> float:
        """Inertia rigidly attached to the shaft, J - sum H^2 [kg m^2]."""
        return max(self.inertia - float(np.sum(self.H**2)), 0.0)

    @property
    def Lambda(self) -> np.ndarray:
        """Squares of the angular natural frequencies, (s,) [rad^2/s^2] (Eq. 14)."""
        return np.array([(2.0 * math.pi * mode.frequency) ** 2 for mode in self.modes])

    @property
    def D(self) -> np.ndarray:
        """Modal damping 2 xi Omega, (s,) [1/s] (Eq. 14)."""
        return np.array([4.0 * math.pi * mode.damping * mode.frequency for mode in self.modes])

    @property
    def mass(self) -> np.ndarray | None:
        """Rigid-body mass matrix about the interface point, (6, 6) [kg, kg m, kg m^2]; None where
        it is not given.
        """
        if self.rigid_body is None:
            return None
        M = self.rigid_body.matrix
        M[self._axis, self._axis] = self.inertia
        return M

    @property
    def coupling(self) -> np.ndarray | None:
        """Column of that matrix for a rotation about the drive axis, (6,), as given or from
        ``rigid_body``; None without either.
        """
        if self.interface_inertia is not None:
            return np.array(self.interface_inertia)
        if self.rigid_body is None:
            return None
        return self.rigid_body.matrix[:, self._axis]

    @property
    def interface(self) -> np.ndarray | None:
        """Interface participation, (6, s) [kg^0.5, kg^0.5 m]; None unless every mode, or a mass
        without modes, gives it.
        """
        if not self.modes and (self.interface_inertia is not None or self.rigid_body is not None):
            return np.zeros((6, 0))
        rows = [mode.interface_participation for mode in self.modes]
        if not rows or any(row is None for row in rows):
            return None
        return np.array(rows, dtype=float).T
