"""Harmonic reducer: ratio, torsional compliance, transmission error (Eq. 19, and beyond the paper)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from microvib.model.friction import maxwell_elements
from microvib.model.part import Part
from microvib.units import Quantity


class TransmissionError(Part):
    """One harmonic of the kinematic error, in turns of the wave generator."""

    order: Annotated[int, Field(ge=1, le=1000, strict=True, description="cycles per turn of the wave generator")]
    amplitude: Annotated[float, Quantity("rad", "amplitude at the output", ge=0, display="arcsec", usual=(1e-7, 0.02))]
    phase: Annotated[float, Quantity("rad", "phase at the wave generator's zero", display="deg")] = 0.0


class Hysteresis(Part):
    """What the gear's torque lags behind its twist: elements beside its spring, each a spring up to its share of a limit."""

    loss: Annotated[
        float,
        Quantity("rad", "width of the loop at zero torque, at the output", gt=0, display="arcsec", usual=(1e-6, 0.01)),
    ]
    stiffness: Annotated[
        float, Quantity("N*m/rad", "stiffness beside the gear's own at small twists", gt=0, usual=(1.0, 1e7))
    ]
    elements: Annotated[int, Field(ge=1, le=10, strict=True, description="number of elements")] = 4


class Reducer(Part):
    """Harmonic reducer; ``stiffness: rigid`` is the paper's, which has no compliance and no loss."""

    ratio: Annotated[float, Quantity("", "reduction ratio", "h", ge=1, le=1e5, usual=(1.0, 5000.0))]
    wave_generator_inertia: Annotated[
        float,
        Quantity(
            "kg*m^2", "moment of inertia of the wave generator", "J_wg", ge=0, display="kg*cm^2", usual=(1e-10, 1e-2)
        ),
    ]
    stiffness: (
        Annotated[
            float, Quantity("N*m/rad", "torsional stiffness at the output, or rigid", "K_g", gt=0, usual=(1.0, 1e7))
        ]
        | Literal["rigid"]
    )
    damping: Annotated[
        float,
        Quantity("N*m*s/rad", "torsional damping at the output; no part if rigid", "C_g", ge=0, usual=(1e-4, 1e4)),
    ]
    output_inertia: Annotated[
        float, Quantity("kg*m^2", "moment of inertia of flexspline and output", "J_flex", ge=0, usual=(1e-7, 10.0))
    ] = 0.0
    transmission_error: tuple[TransmissionError, ...] = Field(
        default=(), description="kinematic error, harmonic by harmonic"
    )
    hysteresis: Hysteresis | None = Field(
        default=None, description="torque that lags behind the twist; without it, none"
    )

    @model_validator(mode="before")
    @classmethod
    def _name_the_other_choice(cls, data: Any) -> Any:
        stiffness = data.get("stiffness") if isinstance(data, dict) else None
        if isinstance(stiffness, str) and stiffness.strip().lower() == "rigid":
            return {**data, "stiffness": "rigid"}
        return data

    def _misfits(self) -> Iterator[str]:
        if self.rigid and self.hysteresis is not None:
            yield "hysteresis: a rigid reducer has no twist that torque could lag behind; give stiffness in N*m/rad"
        slope = sum(e.order * e.amplitude for e in self.transmission_error)
        if slope >= 1.0 / self.ratio:
            yield (
                f"transmission_error: the sum of order x amplitude is {slope:g} rad; it must be below 1/ratio,"
                f" {1.0 / self.ratio:g} rad, or the output would run backwards"
            )

    @property
    def h(self) -> float:
        """The ratio of Eq. 19, theta_m = -h theta_l."""
        return self.ratio

    @property
    def input_inertia(self) -> float:
        """What of the reducer turns with the rotor [kg m^2]."""
        return self.wave_generator_inertia

    @property
    def hysteresis_torque(self) -> float:
        """Torque at which all elements of the hysteresis slide [N m]: half the loss over the compliance."""
        return 0.0 if self.hysteresis is None else 0.5 * self.hysteresis.loss * float(self.stiffness)

    @property
    def memory(self) -> tuple[tuple[float, float], ...]:
        """Stiffness [N m/rad] and share of that torque of each element of the hysteresis; empty without."""
        if self.hysteresis is None:
            return ()
        return maxwell_elements(self.hysteresis.stiffness, self.hysteresis_torque, self.hysteresis.elements)

    @property
    def rigid(self) -> bool:
        """True for the paper's reducer, without compliance."""
        return self.stiffness == "rigid"

    def kinematic_error(self, theta_m: float) -> float:
        """Transmission error epsilon(theta_m) [rad at the output]."""
        return sum(e.amplitude * math.sin(e.order * theta_m + e.phase) for e in self.transmission_error)
