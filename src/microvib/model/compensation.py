"""Compensation of the gear's error by the driver: microsteps that come earlier or later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity


class CompensationHarmonic(Part):
    """One harmonic that the driver takes off the commanded angle: amplitude x sin(order theta +
    phase), theta being the rotor angle of the microstep.
    """

    order: Annotated[
        int,
        Field(
            ge=1,
            le=1000,
            strict=True,
            description="cycles per turn of the rotor, which is that of the wave generator",
        ),
    ]
    amplitude: Annotated[
        float,
        Quantity("rad", "amplitude at the output", ge=0, display="arcsec", usual=(1e-7, 0.02)),
    ]
    phase: Annotated[float, Quantity("rad", "phase at zero rotor angle", display="deg")] = 0.0


def largest_slope(harmonics: Sequence[CompensationHarmonic]) -> float:
    """Bound of the slope of the sum, output angle [rad] over rotor angle [rad]."""
    return sum(h.order * h.amplitude for h in harmonics)


class CompensatedCount:
    """Counts of microsteps at which the command is as far as a compensated microstep asks.

    Without compensation the microstep at a count n comes when the command has made n. A gear with
    the error epsilon(theta_m) turns the output to -theta_m/h + epsilon(theta_m), which shall be what
    is commanded, -theta_cmd/h: the microstep at the rotor angle theta comes when the commanded angle
    is theta - h epsilon(theta). The value at theta = 0, where the drive begins, is taken off.
    """

    def __init__(
        self, harmonics: Sequence[CompensationHarmonic], h: float, microstep: float
    ) -> None:
        """``h`` is the ratio with its sign (Eq. 19), ``microstep`` that of the rotor [rad]."""
        self._acting = [one for one in harmonics if one.amplitude > 0.0]
        self._scale, self._microstep = h / microstep, microstep

    @property
    def acts(self) -> bool:
        """Whether any microstep comes earlier or later."""
        return bool(self._acting)

    @property
    def reach(self) -> float:
        """Microsteps by which one may come earlier or later, at most."""
        return 2.0 * abs(self._scale) * sum(one.amplitude for one in self._acting)

    def commanded(self, count: np.ndarray) -> np.ndarray:
        """Microsteps that the command has made when a microstep at ``count``, an array of any shape,
        comes; it increases with it.
        """
        if not self._acting:
            return count
        theta = count * self._microstep
        taken = sum(
            one.amplitude * (np.sin(one.order * theta + one.phase) - math.sin(one.phase))
            for one in self._acting
        )
        return np.asarray(count - self._scale * taken)
