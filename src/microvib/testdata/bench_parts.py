"""Parts of a force table's description: its resonances and the mass on it, the noise of its channels, mains
pick-up, and the band in which it is used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from microvib.model.part import Part
from microvib.model.rigid import COMPONENTS
from microvib.units import Quantity

Inertia = Annotated[float, Quantity("kg*m^2", "inertia about an axis of the table", ge=0)]


class Mounted(Part):
    """Body that is bolted to the table and moves with its top: it lowers the table's resonances."""

    mass: Annotated[float, Quantity("kg", "mass mounted on the table", gt=0)]
    inertia: tuple[Inertia, Inertia, Inertia] = Field(
        default=(0.0, 0.0, 0.0),
        description="its inertia about the axes x, y, z about which the table rocks and twists",
    )

    def along(self, component: str) -> float:
        """Mass [kg] along a force's axis, or inertia [kg m^2] about a torque's."""
        if component.startswith("F"):
            return self.mass
        return self.inertia["xyz".index(component[1])]


class Resonance(Part):
    """One resonance along or about one axis of the table."""

    component: Literal["Fx", "Fy", "Fz", "Mx", "My", "Mz"] = Field(
        description="along or about which axis"
    )
    frequency: Annotated[float, Quantity("Hz", "natural frequency", gt=0)]
    damping: Annotated[
        float, Quantity("", "damping ratio", "zeta", ge=1e-3, le=2, display="percent")
    ]
    share: Annotated[float, Quantity("", "fraction of the load that it carries", ge=0, le=1)] = 1.0
    frequency_uncertainty: (
        Annotated[
            float,
            Quantity(
                "",
                "relative standard uncertainty of the frequency",
                ge=0,
                le=0.5,
                display="percent",
            ),
        ]
        | None
    ) = None
    damping_uncertainty: (
        Annotated[
            float,
            Quantity(
                "",
                "relative standard uncertainty of the damping ratio",
                ge=0,
                le=1,
                display="percent",
            ),
        ]
        | None
    ) = None
    table_mass: (
        Annotated[float, Quantity("kg", "mass that moves in it when the table is empty", gt=0)]
        | None
    ) = None
    table_inertia: (
        Annotated[
            float, Quantity("kg*m^2", "inertia that moves in it when the table is empty", gt=0)
        ]
        | None
    ) = None

    def _consistency_errors(self) -> Iterator[str]:
        of_force = self.component.startswith("F")
        if of_force and self.table_inertia is not None:
            yield f"table_inertia: does not go with {self.component}, which table_mass is of"
        if not of_force and self.table_mass is not None:
            yield f"table_mass: does not go with {self.component}, which table_inertia is of"

    @property
    def moving(self) -> float | None:
        """Mass [kg] or inertia [kg m^2] that moves in it when the table is empty; None if not known."""
        if self.component.startswith("F"):
            return self.table_mass
        return self.table_inertia

    def under(self, mounted: Mounted | None) -> Resonance:
        """The resonance under what is ``mounted``: the same stiffness and damping ratio under more
        mass, f sqrt(m/(m + M)).
        """
        if mounted is None or self.moving is None:
            return self
        total = self.moving + mounted.along(self.component)
        frequency = self.frequency * math.sqrt(self.moving / total)
        return self.model_copy(update={"frequency": frequency})


Lowest = Annotated[float, Quantity("Hz", "lower end of the band", ge=0)]
Highest = Annotated[float, Quantity("Hz", "upper end of the band", gt=0)]
Force = Annotated[float, Quantity("N", "of a force channel", ge=0, display="mN")]
Torque = Annotated[float, Quantity("N*m", "of a torque channel", ge=0, display="mN*m")]
ForceDensity = Annotated[float, Quantity("N/Hz^0.5", "noise density of a force channel", ge=0)]
TorqueDensity = Annotated[float, Quantity("N*m/Hz^0.5", "noise density of a torque channel", ge=0)]


class UsableBand(Part):
    """Frequencies at which the table is used, as its owner states them."""

    lowest: Lowest = 0.0
    highest: Highest

    def _consistency_errors(self) -> Iterator[str]:
        yield from _band_errors(self.lowest, self.highest)


class ChannelRms(Part):
    """Noise of the readings as RMS in a band; white unless ``noise_corner`` says more."""

    lowest: Lowest = 0.0
    highest: Highest
    Fx: Force | None = None
    Fy: Force | None = None
    Fz: Force | None = None
    Mx: Torque | None = None
    My: Torque | None = None
    Mz: Torque | None = None

    def _consistency_errors(self) -> Iterator[str]:
        yield from _band_errors(self.lowest, self.highest)

    def densities(self, corner: float) -> np.ndarray:
        """Densities above the ``corner`` [Hz] that have these RMS values in the band, (6,)
        [N/Hz^0.5, N m/Hz^0.5]; nan where none is given.
        """
        return six_of(self) / math.sqrt(band_power(self.lowest, self.highest, corner))


class ChannelDensity(Part):
    """Noise density of the readings, above ``noise_corner``."""

    Fx: ForceDensity | None = None
    Fy: ForceDensity | None = None
    Fz: ForceDensity | None = None
    Mx: TorqueDensity | None = None
    My: TorqueDensity | None = None
    Mz: TorqueDensity | None = None


class MainsHarmonic(Part):
    """Pick-up of the mains at one multiple of its frequency: amplitudes of the readings, 0-to-peak."""

    harmonic: int = Field(default=1, ge=1, le=1000, description="multiple of the mains' frequency")
    Fx: Force = 0.0
    Fy: Force = 0.0
    Fz: Force = 0.0
    Mx: Torque = 0.0
    My: Torque = 0.0
    Mz: Torque = 0.0


def six_of(part: ChannelRms | ChannelDensity | MainsHarmonic) -> np.ndarray:
    """Figures of the six channels, (6,) in SI; nan where none is given."""
    given = [getattr(part, name) for name in COMPONENTS]
    return np.array([math.nan if value is None else value for value in given])


def band_power(low: float, high: float, corner: float) -> float:
    """Mean square [per density squared] of noise with the power 1 + corner/f between two
    frequencies [Hz]: high - low + corner ln(high/low).
    """
    if corner > 0.0:
        return high - low + corner * math.log(high / low)
    return high - low


def _band_errors(lowest: float, highest: float) -> Iterator[str]:
    if not lowest < highest:
        yield f"lowest: {lowest:g} Hz is not below highest, {highest:g} Hz"


def table_response(s: np.ndarray, w: float, resonance: Resonance) -> np.ndarray:
    """Reading over load at ``s`` [rad/s] of a resonance at ``w`` [rad/s]: the share that goes through
    it is amplified, w^2/(s^2 + 2 zeta w s + w^2).
    """
    return (
        resonance.share * w * w / (s * s + 2.0 * resonance.damping * w * s + w * w)
        + 1.0
        - resonance.share
    )
