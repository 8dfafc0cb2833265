"""Hybrid stepping motor: its parameters; voltages and torque (Eq. 3, 4) are computed in
``microvib.solve.kernel``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from microvib.model.friction import Friction
from microvib.model.harmonics import (
    AxisHarmonic,
    DetentHarmonic,
    FluxHarmonic,
    axis_harmonics,
    repeated_order,
    sequence,
)
from microvib.model.part import Part
from microvib.units import Quantity

MAX_HARMONICS = 50


class Motor(Part):
    """Hybrid stepping motor with two phases (Table 3), three or five, in balance; its flux linkages
    are sinusoidal but for ``flux_harmonics``.

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
    flux_harmonics: tuple[FluxHarmonic, ...] = Field(
        default=(),
        max_length=MAX_HARMONICS,
        description="harmonics of each phase's torque constant over the electrical angle; odd orders",
    )
    detent: tuple[DetentHarmonic, ...] = Field(
        default=(),
        max_length=MAX_HARMONICS,
        description="further harmonics of the detent torque, beside detent_torque",
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
    eddy_damping: (
        Annotated[
            float,
            Quantity(
                "N*m*s/rad",
                "eddy-current damping of the rotor; null is none",
                ge=0,
                usual=(1e-7, 1.0),
            ),
        ]
        | None
    ) = None
    friction: Friction = Field(description="friction on the rotor, against omega_m")

    def _consistency_errors(self) -> Iterator[str]:
        yield from self._harmonics_errors()
        if self.friction.position is not None:
            yield "friction.position: slip ring and bearing are on the output; give it as friction.position of the scenario"
        if self.friction.torque_noise is not None:
            yield "friction.torque_noise: noise acts on the output; give it as friction.torque_noise of the scenario"
        if self.friction.harness is not None:
            yield "friction.harness: a harness is on the output; give it as friction.harness of the scenario"
        if self.detent_periods % self.full_steps:
            yield (
                f"detent_order: {self.detent_order} is not allowed with {self.phases} phases; a"
                f" multiple of {self.full_steps},"
                " twice their number, is expected, since a balanced motor repeats after each full"
                " step"
            )

    def _harmonics_errors(self) -> Iterator[str]:
        for name in ("flux_harmonics", "detent"):
            order = repeated_order(getattr(self, name))
            if order is not None:
                yield f"{name}: order {order} is given more than once; each order once is expected"
        if self.detent_torque > 0.0:
            for k, harmonic in enumerate(self.detent):
                if harmonic.order == self.detent_periods:
                    yield (
                        f"detent.{k}.order: {harmonic.order} is the order of detent_torque; set"
                        " detent_torque to 0 N*m, or leave this harmonic out"
                    )

    @property
    def electromagnetic_stiffness(self) -> float:
        """Stiffness of the electromagnetic spring, z K_m I of two phases [N m/rad], without detent
        torque.
        """
        return self.rotor_teeth * self.axis_torque_constant * self.axis_current

    @property
    def detent_stiffness(self) -> float:
        """Largest stiffness of detent torque and flux harmonics [N m/rad], beside that of sinusoidal
        flux.

        Of the detent torque alone it is there at every other of its zeros; at those between it is as
        much below 0. Of more harmonics the sum of theirs, an upper bound.
        """
        return math.fsum(self.stiffness_orders.values())

    @property
    def stiffness_orders(self) -> dict[int, float]:
        """Amplitudes of the stiffness of detent torque and flux harmonics [N m/rad], by cycles per
        electrical turn of a rotor that follows its command.
        """
        z = self.rotor_teeth
        orders = {order: z * order * size for order, size in self.detent_orders.items()}
        for harmonic in self.axis_flux_harmonics:
            order = harmonic.torque_order
            own = self.electromagnetic_stiffness * harmonic.order * abs(harmonic.amplitude)
            orders[order] = orders.get(order, 0.0) + own
        return orders

    @property
    def viscous(self) -> float:
        """Torque over rate of the rotor [N m s/rad]: viscous friction and eddy-current damping."""
        return self.friction.viscous + (self.eddy_damping or 0.0)

    @property
    def full_steps(self) -> int:
        """Full steps per electrical turn of a motor with so many phases: 4, 6 or 10."""
        return 2 * self.phases

    @property
    def detent_periods(self) -> int:
        """Periods of the detent torque per electrical turn."""
        return self.detent_order or self.full_steps

    @property
    def axis_flux_harmonics(self) -> tuple[AxisHarmonic, ...]:
        """Flux harmonics that make torque with the currents of the two axes."""
        return axis_harmonics(self.flux_harmonics, self.phases)

    @property
    def second_plane_orders(self) -> tuple[int, ...]:
        """Orders of flux harmonics of five phases that act on currents in their second plane."""
        if self.phases != 5:
            return ()
        return tuple(
            h.order
            for h in self.flux_harmonics
            if h.amplitude and h.order % 5 and not sequence(h.order, 5)
        )

    @property
    def detent_orders(self) -> dict[int, float]:
        """Amplitude of the detent torque [N m] by cycles per electrical turn; those that are not 0."""
        orders = {self.detent_periods: self.detent_torque}
        for harmonic in self.detent:
            orders[harmonic.order] = orders.get(harmonic.order, 0.0) + harmonic.amplitude
        return {order: size for order, size in orders.items() if size > 0.0}

    @property
    def torque_orders(self) -> dict[int, float]:
        """Amplitudes of what the motor's torque has beside that of sinusoidal flux [N m], by cycles
        per electrical turn: detent torque, and flux harmonics with the current I.

        Amplitudes of one order are added up.
        """
        orders = dict(self.detent_orders)
        full = self.axis_torque_constant * self.axis_current
        for harmonic in self.axis_flux_harmonics:
            order = harmonic.torque_order
            orders[order] = orders.get(order, 0.0) + full * abs(harmonic.amplitude)
        return orders

    @property
    def torque_comb(self) -> int | None:
        """The largest order that all ``torque_orders`` are multiples of; None where there are none."""
        orders = self.torque_orders
        if orders:
            return math.gcd(*orders)
        return None

    @property
    def side_line_order(self) -> int | None:
        """Distance of side lines of driving lines by detent torque and flux harmonics, in cycles per
        electrical turn: a period of theirs, or a full step where they are more often alike.
        """
        comb = self.torque_comb
        if comb is None or comb % self.full_steps == 0:
            return comb
        return self.full_steps

    @property
    def alike_per_turn(self) -> int:
        """How often per electrical turn the phases change places with the motor as before."""
        return math.gcd(self.full_steps, self.repeats_per_turn)

    @property
    def repeats_per_turn(self) -> int:
        """How often per electrical turn the motor is as before, but for its phases."""
        repeats = math.gcd(self.detent_periods, *self.detent_orders)
        if self.axis_flux_harmonics:
            return math.gcd(repeats, self.full_steps)
        return repeats

    @property
    def axis_current(self) -> float:
        """Amplitude of the currents of the two axes [A]."""
        return math.sqrt(self.phases / 2.0) * self.current

    @property
    def axis_torque_constant(self) -> float:
        """Torque constant of the two axes [N m/A]."""
        return math.sqrt(self.phases / 2.0) * self.torque_constant
