"""Harness across the output: a torsional spring about an angle, with friction of its strands."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from microvib.model.part import Part
from microvib.model.presliding import Presliding
from microvib.units import Quantity


class Harness(Part):
    """Cables from the housing to the array, wound about the output shaft or beside it.

    Their torque against the output is stiffness x (theta_l - neutral_angle) and a friction that does
    not depend on the rate: elements that are springs up to their shares of it (``Presliding``), so
    that torque over angle is a loop.
    """

    stiffness: Annotated[
        float, Quantity("N*m/rad", "torsional stiffness", ge=0, usual=(1e-4, 1e3))
    ] = 0.0
    neutral_angle: Annotated[
        float,
        Quantity(
            "rad",
            "output angle at which the harness is relaxed, from where the motion begins",
            display="deg",
        ),
    ] = 0.0
    friction: Annotated[
        float, Quantity("N*m", "friction torque of the strands", ge=0, usual=(1e-5, 10.0))
    ] = 0.0
    presliding: Presliding | None = Field(
        default=None, description="how the strands give before they slide; needed with friction"
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.friction > 0.0 and self.presliding is None:
            yield (
                "presliding: missing; strands of a harness give before they slide, as"
                " {stiffness: 1 N*m/rad} says"
            )
        if self.friction == 0.0 and self.presliding is not None:
            yield "presliding: there is no friction; give the harness a friction greater than 0 N*m"
        if self.presliding is None or self.friction == 0.0:
            return
        try:
            _ = self.memory
        except ValueError as error:
            yield f"presliding: {error}"

    def turned(self, angle: float) -> Harness:
        """Harness for a motion that begins at another angle of the output [rad]."""
        return self.model_copy(update={"neutral_angle": self.neutral_angle - angle})

    @property
    def memory(self) -> tuple[tuple[float, float], ...]:
        """Stiffness [N m/rad] and share of the friction of each element; empty without friction."""
        if self.presliding is None or self.friction == 0.0:
            return ()
        return self.presliding.split(self.friction)
