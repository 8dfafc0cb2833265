"""Hybrid stepping motor: its parameters; voltages and torque (Eq. 3, 4) are computed in ``microvib.solve.kernel``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from microvib.model.friction import Friction
from microvib.model.part import Part
from microvib.units import Quantity


class Motor(Part):
    """Two-phase hybrid stepping motor (Table 3)."""

    rotor_teeth: Annotated[int, Field(ge=1, le=10_000, strict=True, description="number of rotor teeth, z")]
    current: Annotated[float, Quantity("A", "amplitude of the phase currents", "I", gt=0, usual=(5e-3, 20.0))]
    torque_constant: Annotated[float, Quantity("N*m/A", "motor torque constant", "K_m", gt=0, usual=(1e-3, 20.0))]
    detent_torque: Annotated[float, Quantity("N*m", "amplitude of the detent torque", "K_d", ge=0, usual=(1e-6, 2.0))]
    winding_resistance: Annotated[float, Quantity("ohm", "resistance of one winding", "R", gt=0, usual=(0.02, 2000.0))]
    winding_inductance: Annotated[
        float, Quantity("H", "self-inductance of one winding", "L", gt=0, display="mH", usual=(5e-6, 2.0))
    ]
    rotor_inertia: Annotated[
        float, Quantity("kg*m^2", "moment of inertia of the rotor", "J_r", gt=0, display="kg*cm^2", usual=(1e-9, 1e-2))
    ]
    friction: Friction = Field(description="friction on the rotor, against omega_m")

    def _misfits(self) -> Iterator[str]:
        if self.friction.torque_noise is not None:
            yield "friction.torque_noise: noise acts on the output; give it as friction.torque_noise of the scenario"

    @property
    def electromagnetic_stiffness(self) -> float:
        """Stiffness of the electromagnetic spring z K_m I [N m/rad], without detent torque."""
        return self.rotor_teeth * self.torque_constant * self.current
