"""Static Stribeck friction with slip ring, set-valued at rest (Eq. 5-7)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from microvib.model.harness import Harness
from microvib.model.noise import FrictionPosition, TorqueNoise
from microvib.model.part import Part
from microvib.model.presliding import Presliding
from microvib.units import Quantity


class SlipRing(Part):
    """Conductive slip ring: brushes that slide on rings (Eq. 6)."""

    contact_pairs: Annotated[
        int, Field(ge=0, le=1_000_000, strict=True, description="pairs of ring and brush, N_c")
    ]
    contact_force: Annotated[
        float, Quantity("N", "force of one contact", "p", ge=0, usual=(1e-3, 20.0))
    ]
    friction_factor: Annotated[
        float, Quantity("", "friction factor of the contact", "mu", ge=0, usual=(0.01, 5.0))
    ]
    ring_radius: Annotated[
        float, Quantity("m", "radius of the rings", "r", ge=0, display="mm", usual=(5e-4, 0.5))
    ]

    @property
    def torque(self) -> float:
        """Friction torque N_c p mu r [N m] (Eq. 6)."""
        return self.contact_pairs * self.contact_force * self.friction_factor * self.ring_radius


class Friction(Part):
    """Stribeck friction of one shaft (Eq. 5, 7)."""

    coulomb: Annotated[
        float, Quantity("N*m", "Coulomb friction torque", "T_c", ge=0, usual=(1e-6, 100.0))
    ]
    breakaway: Annotated[
        float, Quantity("N*m", "breakaway (static) torque", "T_s", ge=0, usual=(1e-6, 100.0))
    ]
    stribeck_rate: Annotated[
        float,
        Quantity("rad/s", "Stribeck rate", "omega_s", gt=0, display="deg/s", usual=(1e-7, 20.0)),
    ]
    stribeck_shape: Annotated[
        float, Quantity("", "exponent of the Stribeck curve", "delta", gt=0, le=10)
    ] = 1.0
    viscous: Annotated[
        float, Quantity("N*m*s/rad", "viscous friction", "sigma", ge=0, usual=(1e-7, 1e4))
    ]
    slip_ring: SlipRing | None = None
    presliding: Presliding | None = Field(
        default=None,
        description="presliding friction (hysteretic); if left out, sticking contacts are rigid",
    )
    torque_noise: TorqueNoise | None = Field(
        default=None, description="torque noise at the output; none if left out"
    )
    position: FrictionPosition | None = Field(
        default=None,
        description="variation of friction with the output angle; none if left out",
    )

    harness: Harness | None = Field(
        default=None,
        description="harness from the housing to the array; none if left out",
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.breakaway < self.coulomb:
            yield f"breakaway: {self.breakaway:g} N*m is below coulomb, {self.coulomb:g} N*m; it must be at least that"
            return
        if self.presliding is None:
            return
        if self.breakaway_torque == 0.0:
            yield "presliding: there is no friction to stick; coulomb, breakaway or slip_ring must be greater than 0"
            return
        try:
            _ = self.memory
        except ValueError as error:
            yield f"presliding: {error}"

    @property
    def memory(self) -> tuple[tuple[float, float], ...]:
        """Stiffness [N m/rad] and share of the limit of each element of a friction with memory;
        empty without.
        """
        own = self.presliding
        if own is None:
            return ()
        return own.split(self.breakaway_torque)

    @property
    def sliding_torque(self) -> float:
        """Torque that does not depend on the rate: Coulomb and slip ring [N m]."""
        return self.coulomb + (self.slip_ring.torque if self.slip_ring else 0.0)

    @property
    def stribeck_torque(self) -> float:
        """Excess of breakaway over Coulomb torque [N m]."""
        return self.breakaway - self.coulomb

    @property
    def breakaway_torque(self) -> float:
        """Largest torque that can be held at rest, slip ring included [N m]."""
        return self.sliding_torque + self.stribeck_torque

    @property
    def largest_torque(self) -> float:
        """Largest torque that friction can hold at rest at any angle of the shaft, that of a harness
        included [N m].
        """
        if self.position is None:
            own = self.breakaway_torque
        else:
            own = self.breakaway_torque * self.position.largest_factor
        if self.harness is None:
            return own
        return own + self.harness.friction

    def turned(self, angle: float) -> Friction:
        """Friction for a motion that begins at another angle of the shaft [rad]."""
        changed: dict[str, Part] = {}
        if self.position is not None and self.position.harmonics:
            changed["position"] = self.position.turned(angle)
        if self.harness is not None:
            changed["harness"] = self.harness.turned(angle)
        if changed:
            return self.model_copy(update=changed)
        return self

    @property
    def with_new_seed(self) -> Friction:
        """Friction of another unit: other draws of noise and roughness."""
        noise, position = self.torque_noise, self.position
        if position is None:
            rough = None
        else:
            rough = position.roughness
        changed: dict[str, Part] = {}
        if noise is not None:
            changed["torque_noise"] = noise.model_copy(update={"seed": _derived_seed(noise.seed)})
        if position is not None and rough is not None:
            anew = rough.model_copy(update={"seed": _derived_seed(rough.seed)})
            changed["position"] = position.model_copy(update={"roughness": anew})
        if changed:
            return self.model_copy(update=changed)
        return self

    @property
    def without_noise(self) -> Friction:
        """Friction without torque noise and roughness."""
        if self.position is None:
            position = None
        else:
            position = self.position.model_copy(update={"roughness": None})
        return self.model_copy(update={"torque_noise": None, "position": position})

    def torque(self, omega: float) -> float:
        """Friction torque [N m] at the rate ``omega`` != 0 [rad/s] (Eq. 7); at rest it is
        set-valued and this is 0.
        """
        if omega == 0.0:
            return 0.0
        stribeck = self.stribeck_torque * math.exp(
            -(abs(omega / self.stribeck_rate) ** self.stribeck_shape)
        )
        return math.copysign(self.sliding_torque + stribeck + self.viscous * abs(omega), omega)

    def slope(self, omega: float) -> float:
        """Slope of the friction torque [N m s/rad] at the rate ``omega`` != 0 [rad/s]: negative
        where a shaft that slides faster is held less.
        """
        ratio, shape = abs(omega) / self.stribeck_rate, self.stribeck_shape
        falling = shape * ratio ** (shape - 1.0) / self.stribeck_rate * math.exp(-(ratio**shape))
        return self.viscous - self.stribeck_torque * falling


def _derived_seed(seed: int) -> int:
    """A seed far from those that studies count up to."""
    return (seed + 2**62) % 2**63
