"""Harmonic reducer or gear train: ratio, torsional compliance, transmission error (Eq. 19
and beyond).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, model_validator

from microvib.model.gear_train import GearStage, backlash, input_inertia, speeds, stiffness
from microvib.model.part import Part
from microvib.model.presliding import maxwell_elements
from microvib.units import Quantity

_LEFT_OUT = (
    "ratio",
    "wave_generator_inertia",
    "stiffness",
    "backlash",
)  # keys that null leaves out, as a train may make them


class TransmissionError(Part):
    """One harmonic of the kinematic error, in turns of the wave generator."""

    order: Annotated[
        int, Field(ge=1, le=1000, strict=True, description="cycles per turn of the wave generator")
    ]
    amplitude: Annotated[
        float,
        Quantity("rad", "amplitude at the output", ge=0, display="arcsec", usual=(1e-7, 0.02)),
    ]
    phase: Annotated[
        float, Quantity("rad", "phase at zero angle of the wave generator", display="deg")
    ] = 0.0


class KinematicError(NamedTuple):
    """A harmonic of the transmission error."""

    order: Fraction
    """Cycles per turn of the rotor."""
    amplitude: float
    """At the output [rad]."""
    phase: float
    line: str
    origin: str
    cause: str = "transmission error"


class Hysteresis(Part):
    """Hysteresis of the gear: elements beside its spring, each a spring up to
    its share of a limit.
    """

    loss: Annotated[
        float,
        Quantity(
            "rad",
            "width of the loop at zero torque, at the output",
            gt=0,
            display="arcsec",
            usual=(1e-6, 0.01),
        ),
    ]
    stiffness: Annotated[
        float,
        Quantity(
            "N*m/rad", "stiffness added to the gear's at small twists", gt=0, usual=(1.0, 1e7)
        ),
    ]
    elements: Annotated[int, Field(ge=1, le=10, strict=True, description="number of elements")] = 4


class Reducer(Part):
    """Harmonic reducer, or a train of gears; with ``stiffness: rigid`` it has no
    compliance and no loss.
    """

    ratio: Annotated[
        float, Quantity("", "reduction ratio", "h", ge=1, le=1e5, usual=(1.0, 5000.0))
    ] = 1.0
    wave_generator_inertia: Annotated[
        float,
        Quantity(
            "kg*m^2",
            "moment of inertia of the wave generator",
            "J_wg",
            ge=0,
            display="kg*cm^2",
            usual=(1e-10, 1e-2),
        ),
    ] = 0.0
    stiffness: (
        Annotated[
            float,
            Quantity(
                "N*m/rad",
                "torsional stiffness at the output, or rigid",
                "K_g",
                gt=0,
                usual=(1.0, 1e7),
            ),
        ]
        | Literal["rigid"]
    ) = "rigid"
    damping: Annotated[
        float,
        Quantity(
            "N*m*s/rad",
            "torsional damping at the output; unused if rigid",
            "C_g",
            ge=0,
            usual=(1e-4, 1e4),
        ),
    ]
    same_way: bool = Field(
        default=False,
        description="whether the output turns in the rotor's direction, as with most "
        "planetary gears and without a gear; follows from train if given",
    )
    output_inertia: Annotated[
        float,
        Quantity(
            "kg*m^2",
            "moment of inertia of flexspline and output",
            "J_flex",
            ge=0,
            usual=(1e-7, 10.0),
        ),
    ] = 0.0
    transmission_error: tuple[TransmissionError, ...] = Field(
        default=(), description="kinematic error, harmonic by harmonic"
    )
    backlash: (
        Annotated[
            float,
            Quantity(
                "rad",
                "free play from flank to flank, at the output",
                ge=0,
                display="arcsec",
                usual=(1e-6, 0.05),
            ),
        ]
        | None
    ) = None
    hysteresis: Hysteresis | None = Field(
        default=None, description="torque that lags behind the twist (hysteresis); none if left out"
    )
    train: tuple[GearStage, ...] = Field(
        default=(),
        max_length=10,
        description="stages of a gear train, from the rotor to the output; they make the ratio",
    )

    @model_validator(mode="before")
    @classmethod
    def _name_the_other_choice(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        data = {
            key: value for key, value in data.items() if value is not None or key not in _LEFT_OUT
        }
        stiffness = data.get("stiffness")
        if isinstance(stiffness, str) and stiffness.strip().lower() == "rigid":
            return {**data, "stiffness": "rigid"}
        return data

    def _derived_fields(self) -> dict[str, Any]:
        if not self.train:
            return {}
        K, gap = stiffness(self.train), backlash(self.train)
        made = {"ratio": abs(float(1 / speeds(self.train)[-1]))} | (
            {} if K is None else {"stiffness": K}
        )
        return made | ({"backlash": gap} if gap else {})

    def _required_fields(self) -> tuple[str, ...]:
        if self.train:
            return ("stiffness",)
        return ("ratio", "wave_generator_inertia", "stiffness")

    def _consistency_errors(self) -> Iterator[str]:
        if not 1.0 <= self.ratio <= 1e5:
            yield f"train: its ratio is {self.ratio:g}; 1 to 100 000 is expected, a train that turns slower than the rotor"
        if self.train and self.same_way:
            yield "same_way: the teeth of a train say which way its output turns; leave it out"
        if self.train and self.train[-1].output_inertia:
            yield f"train.{len(self.train) - 1}.output_inertia: is on the output; give it as reducer.output_inertia"
        if self.rigid and self.hysteresis is not None:
            yield "hysteresis: a rigid reducer has no wind-up, so no hysteresis; give stiffness in N*m/rad"
        if self.rigid and self.backlash:
            yield (
                "backlash: a rigid reducer cannot have backlash, because tooth contact would be"
                " instantaneous; give stiffness in N*m/rad"
            )
        slope = sum(float(e.order) * e.amplitude for e in self.errors)
        if slope >= 1.0 / self.ratio:
            yield (
                f"transmission_error: the sum of order x amplitude is {slope:g} rad; it must be"
                " below 1/ratio,"
                f" {1.0 / self.ratio:g} rad, or the output would run backwards"
            )

    @property
    def h(self) -> float:
        """The ratio of Eq. 19, theta_m = -h theta_l; negative where the output turns the rotor's
        way.
        """
        if self.train:
            return math.copysign(self.ratio, -speeds(self.train)[-1])
        if self.same_way:
            return -self.ratio
        return self.ratio

    @property
    def input_inertia(self) -> float:
        """Inertia of the reducer as the rotor feels it, of a train that of its wheels [kg m^2]."""
        return self.wave_generator_inertia + input_inertia(self.train)

    @property
    def errors(self) -> tuple[KinematicError, ...]:
        """Harmonics of the transmission error: those of the wave generator's turns, then those of
        the train's stages.
        """
        found = [
            KinematicError(
                Fraction(e.order),
                e.amplitude,
                e.phase,
                f"wave_generator_{e.order}",
                f"order {e.order}",
            )
            for e in self.transmission_error
        ]
        through = speeds(self.train)
        for k, stage in enumerate(self.train):
            for e in stage.errors:
                amplitude = e.amplitude * abs(float(through[-1] / through[k + 1]))
                name = re.sub(
                    r"[^a-z0-9]+",
                    "_",
                    e.order.strip().replace("+", " plus ").replace("-", " minus "),
                )
                order = abs(through[k]) * stage.order(e.order)
                found.append(
                    KinematicError(
                        order,
                        amplitude,
                        e.phase,
                        f"stage_{k + 1}_{name}",
                        f"stage {k + 1}, {e.order}",
                    )
                )
        return tuple(found)

    @property
    def hysteresis_torque(self) -> float:
        """Torque at which all elements of the hysteresis slide [N m]: half the loss over the
        compliance.
        """
        if self.hysteresis is None:
            return 0.0
        return 0.5 * self.hysteresis.loss * float(self.stiffness)

    @property
    def memory(self) -> tuple[tuple[float, float], ...]:
        """Stiffness [N m/rad] and share of that torque of each element of the hysteresis; empty
        without.
        """
        if self.hysteresis is None:
            return ()
        return maxwell_elements(
            self.hysteresis.stiffness, self.hysteresis_torque, self.hysteresis.elements
        )

    @property
    def rigid(self) -> bool:
        """Whether the reducer has no compliance."""
        return self.stiffness == "rigid"

    def kinematic_error(self, theta_m: float) -> float:
        """Transmission error epsilon(theta_m) [rad at the output]."""
        return sum(e.amplitude * math.sin(float(e.order) * theta_m + e.phase) for e in self.errors)
