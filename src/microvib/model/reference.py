"""Lines that were measured on the drive that a scenario describes, to be shown beside its runs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity


class ReferenceLine(Part):
    """One measured line and, if it was published with the test, the same line of another model."""

    line: str = Field(
        min_length=1, max_length=100, description="name, such as drive_1 or array_mode_1"
    )
    frequency: Annotated[float, Quantity("Hz", "measured frequency", gt=0)]
    amplitude: Annotated[
        float, Quantity("N*m", "measured amplitude, 0-to-peak", gt=0, display="mN*m")
    ]
    resolution: (
        Annotated[
            float, Quantity("N*m", "last digit of the measured amplitude", gt=0, display="mN*m")
        ]
        | None
    ) = None
    model_frequency: (
        Annotated[float, Quantity("Hz", "frequency by the publication's own model", gt=0)] | None
    ) = None
    model_amplitude: (
        Annotated[
            float,
            Quantity(
                "N*m",
                "amplitude by the publication's own model, 0-to-peak",
                gt=0,
                display="mN*m",
            ),
        ]
        | None
    ) = None


class Reference(Part):
    """Reference lines of a scenario, and the record in which they were measured."""

    source: str = Field(max_length=2000, description="where the lines come from")
    estimator: Literal["fitted", "nearest bin"] = Field(
        default="fitted",
        description="amplitude estimate: the fitted line, or the nearest bin of a rectangular window",
    )
    duration: Annotated[float, Quantity("s", "length of the record", gt=0)]
    sample_rate: Annotated[float, Quantity("Hz", "samples per second of the record", gt=0)]
    clock_ratio: Annotated[float, Quantity("", "step clock of the record over nominal", gt=0)] = 1.0
    lines: tuple[ReferenceLine, ...] = Field(
        min_length=1, max_length=1000, description="the lines themselves"
    )
