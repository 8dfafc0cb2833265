"""Hybrid stepping motor: its parameters; voltages and torque (Eq. 3, 4) are computed in
``microvib.solve.kernel``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from microvib.model.friction import Friction
from microvib.model.part import Part
from microvib.units import Quantity


class Motor(Part):
    """Hybrid stepping motor with two phases (Table 3), three or five, in balance and with
    sinusoidal flux linkages.

    The equations are those of two axes, into which currents and voltages of more phases are
    transformed with their power unchanged (Clarke): of the amplitudes of current and torque
    constant each is sqrt(phases/2) times that of a phase.
    """

    rotor_teeth: Annotated[
        int, Field(ge=1, le=10_000, strict=True, description="number of rotor teeth, z")
    ]
    phases: Literal[2, 3, 5] = Field(default=2, description="number of phases")
    current: Annotated[
        float, Quantity("A", "amplitude of the phase currents", "I", gt=0, usual=(5e-3, 20.0))
    ]
    torque_constant: Annotated[
        float, Quantity("N*m/A", "torque constant of one phase", "K_m", gt=0, usual=(1e-3, 20.0))
    ]
    detent_torque: Annotated[
        float, Quantity("N*m", "amplitude of the detent torque", "K_d", ge=0, usual=(1e-6, 2.0))
    ]
    detent_order: (
        Annotated[
            int,
            Field(
                ge=4,
                le=1000,
                strict=True,
                description="periods of the detent torque per electrical turn",
            ),
        ]
        | None
    ) = Field(
        default=None,
        description="periods of the detent torque per electrical turn; null is twice the phases",
    )
    winding_resistance: Annotated[
        float, Quantity("ohm", "resistance of one winding", "R", gt=0, usual=(0.02, 2000.0))
    ]
    winding_inductance: Annotated[
        float,
        Quantity("H", "self-inductance of one winding", "L", gt=0, display="mH", usual=(5e-6, 2.0)),
    ]
    rotor_inertia: Annotated[
        float,
        Quantity(
            "kg*m^2",
            "moment of inertia of the rotor",
            "J_r",
            gt=0,
            display="kg*cm^2",
            usual=(1e-9, 1e-2),
        ),
    ]
    friction: Friction = Field(description="friction on the rotor, against omega_m")

    def _consistency_errors(self) -> Iterator[str]:
        if self.friction.position is not None:
            yield "friction.position: slip ring and bearing are on the output; give it as friction.position of the scenario"
        if self.friction.torque_noise is not None:
            yield "friction.torque_noise: noise acts on the output; give it as friction.torque_noise of the scenario"
        if self.detent_periods % self.full_steps:
            yield (
                f"detent_order: {self.detent_order} is not allowed with {self.phases} phases; a"
                f" multiple of {self.full_steps},"
                " twice their number, is expected, since a balanced motor repeats after each full"
                " step"
            )

    @property
    def electromagnetic_stiffness(self) -> float:
        """Stiffness of the electromagnetic spring, z K_m I of two phases [N m/rad], without detent
        torque.
        """
        return self.rotor_teeth * self.axis_torque_constant * self.axis_current

    @property
    def detent_stiffness(self) -> float:
        """Largest stiffness of the detent torque [N m/rad], at every other of its zeros; at those
        between it is as much below 0.
        """
        return self.rotor_teeth * self.detent_periods * self.detent_torque

    @property
    def full_steps(self) -> int:
        """Full steps per electrical turn of a motor with so many phases: 4, 6 or 10."""
        return 2 * self.phases

    @property
    def detent_periods(self) -> int:
        """Periods of the detent torque per electrical turn."""
        return self.detent_order or self.full_steps

    @property
    def axis_current(self) -> float:
        """Amplitude of the currents of the two axes [A]."""
        return math.sqrt(self.phases / 2.0) * self.current

    @property
    def axis_torque_constant(self) -> float:
        """Torque constant of the two axes [N m/A]."""
        return math.sqrt(self.phases / 2.0) * self.torque_constant
