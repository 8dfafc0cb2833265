"""Record and solver settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity

MAX_SAMPLES = 2_000_000_000
PASSBAND = 0.35
"""Edge of a record's flat band, as a fraction of its sample rate: samples are filtered so, and
lines looked for up to there.
"""


Start = Literal["rest", "steady"]
"""How the motion of a record begins."""


class Record(Part):
    """The recorded window."""

    settle: Annotated[float, Quantity("s", "time before the window", ge=0, usual=(1e-3, 1e6))]
    duration: Annotated[float, Quantity("s", "length of the window", gt=0, usual=(0.01, 1e6))]
    sample_rate: Annotated[
        float, Quantity("Hz", "samples per second", gt=0, le=1e7, usual=(5.0, 1e6))
    ]
    start: Start = Field(
        default="rest",
        description="initial state: at rest at t = 0, or the steady state at the window's rate if it exists",
    )

    rotor_offset: Annotated[
        float,
        Quantity("", "rotor angle from the first commanded angle at power-on, in full steps"),
    ] = 0.0

    def _consistency_errors(self) -> Iterator[str]:
        if self.start == "steady" and self.rotor_offset != 0.0:
            yield "rotor_offset: applies to start: rest only, and start is steady; leave one of them out"
        samples = self.duration * self.sample_rate
        product = f"duration: {self.duration:g} s at {self.sample_rate:g} Hz is"
        if samples < 8:
            yield (
                f"{product} {samples:g} samples; at least 8 are needed: lengthen duration or raise"
                " sample_rate"
            )
        if samples > MAX_SAMPLES:
            yield (
                f"{product} {samples:.3g} samples, more than the {MAX_SAMPLES:.0e} that are allowed;"
                " shorten duration or lower sample_rate"
            )

    @property
    def samples(self) -> int:
        """Number of samples in the window."""
        return round(self.duration * self.sample_rate)


class Solver(Part):
    """Accuracy of the time integration; docs/numerics.md says what the defaults reach,
    ``refinement`` how to check it.
    """

    removed_keys: ClassVar[dict[str, str]] = {
        "method": "integration has a single method; leave the key out",
        "tolerance": "solver.accuracy sets the accuracy of a step; leave the key out",
    }

    accuracy: Annotated[
        float,
        Quantity(
            "",
            "error of a step relative to the motion per microstep",
            gt=0,
            le=0.1,
            usual=(1e-8, 1e-2),
        ),
    ] = 5e-4
    max_step: Annotated[float, Quantity("s", "longest step", gt=0, le=1.0, display="ms")] = 2e-3
    refinement: Annotated[
        int, Field(ge=1, le=64, strict=True, description="factor by which every step is refined")
    ] = 1
