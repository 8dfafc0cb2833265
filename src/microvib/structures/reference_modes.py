"""Modes of a structure that its description is to reproduce, shown beside those that it has."""

from __future__ import annotations

from typing import Annotated

from microvib.model.part import Part
from microvib.units import Quantity


class ReferenceMode(Part):
    """One mode, as it was measured or published."""

    frequency: Annotated[float, Quantity("Hz", "with the interface clamped", gt=0)]
    effective_inertia: (
        Annotated[float, Quantity("kg*m^2", "effective inertia about the drive axis", ge=0)] | None
    ) = None
    fraction: (
        Annotated[float, Quantity("", "effective inertia over the whole one", ge=0, le=1)] | None
    ) = None
