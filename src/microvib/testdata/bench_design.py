"""A force table, its surroundings and its data acquisition, as parameters of a virtual test bench."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from microvib.model.part import Part, Six
from microvib.units import Quantity

OVERSAMPLING = 4
"""Rate of the analog stages over that of the converter."""
MAX_SAMPLES = 20_000_000

Ratio = Annotated[float, Quantity("", "damping ratio", "zeta", ge=0, le=2, display="percent")]


class Resonance(Part):
    """One resonance along or about one axis of the table."""

    component: Literal["Fx", "Fy", "Fz", "Mx", "My", "Mz"] = Field(description="along or about which axis")
    frequency: Annotated[float, Quantity("Hz", "natural frequency", gt=0)]
    damping: Annotated[float, Quantity("", "damping ratio", "zeta", ge=1e-3, le=2, display="percent")]
    share: Annotated[float, Quantity("", "part of the load that goes through it", ge=0, le=1)] = 1.0


class Rope(Part):
    """The rope that carries the array against gravity."""

    length: Annotated[float, Quantity("m", "length", gt=0)]
    mass: Annotated[float, Quantity("kg", "suspended mass", gt=0)]
    sway: Annotated[float, Quantity("m", "amplitude of the sway at the start of the recording", ge=0, display="mm")]
    damping: Ratio
    torsional_stiffness: Annotated[float, Quantity("N*m/rad", "torsional stiffness about the drive axis", ge=0)]


class Bench(Part):
    """A force table, its surroundings and its data acquisition."""

    title: str = Field(default="", max_length=500, description="what bench this is")
    source: str = Field(default="", max_length=2000, description="where the values come from")
    table: tuple[Resonance, ...] = Field(
        default=(), max_length=60, description="resonances of table and sensors: they amplify"
    )
    platform: tuple[Resonance, ...] = Field(
        default=(),
        max_length=60,
        description="rigid-body modes on the air springs; share is moving mass over platform's",
    )
    rope: Rope | None = None
    high_pass: Annotated[float, Quantity("Hz", "corner of the charge amplifiers", ge=0)] = 0.0
    force_noise: Annotated[float, Quantity("N/Hz^0.5", "noise density of the force channels", ge=0)] = 0.0
    torque_noise: Annotated[float, Quantity("N*m/Hz^0.5", "noise density of the torque channels", ge=0)] = 0.0
    noise_corner: Annotated[float, Quantity("Hz", "below it the noise power grows with 1/f", ge=0)] = 0.0
    mains: Annotated[float, Quantity("Hz", "frequency of the mains", gt=0)] = 50.0
    mains_torque: Annotated[float, Quantity("N*m", "mains pick-up of the torque channels", ge=0)] = 0.0
    mains_force: Annotated[float, Quantity("N", "mains pick-up of the force channels", ge=0)] = 0.0
    cross_talk: tuple[Six, Six, Six, Six, Six, Six] | None = Field(
        default=None, description="6 x 6 matrix: readings Fx Fy Fz Mx My Mz = matrix x loads"
    )
    filter_corner: Annotated[float, Quantity("Hz", "corner of the anti-aliasing filter (Butterworth)", gt=0)] | None = (
        None
    )
    filter_order: int = Field(default=8, ge=1, le=12, description="order of the anti-aliasing filter")
    force_range: Annotated[float, Quantity("N", "largest force the converter takes, either sign", gt=0)] = 1000.0
    torque_range: Annotated[float, Quantity("N*m", "largest torque the converter takes, either sign", gt=0)] = 100.0
    bits: int | None = Field(default=None, ge=4, le=32, description="resolution of the converter; none: not rounded")
    clock_error: Annotated[
        float, Quantity("", "converter's clock over its nominal rate, less one", ge=-0.01, le=0.01)
    ] = 0.0
    sample_rate: Annotated[float, Quantity("Hz", "nominal sample rate", gt=0)] = 4096.0
    duration: Annotated[float, Quantity("s", "length of the recording", gt=0)] = 16.0
    lead: Annotated[float, Quantity("s", "time before the recording in which amplifiers and filters settle", ge=0)] = (
        4.0
    )

    def _misfits(self) -> Iterator[str]:
        for name in ("table", "platform"):
            for k, resonance in enumerate(getattr(self, name)):
                if resonance.frequency >= self.sample_rate:
                    yield f"{name}.{k}.frequency: {resonance.frequency:g} Hz is not below the sample rate, {self.sample_rate:g} Hz"
        if self.filter_corner is not None and self.filter_corner >= 0.5 * self.sample_rate:
            yield (
                f"filter_corner: {self.filter_corner:g} Hz is not below half the sample rate, {0.5 * self.sample_rate:g} Hz;"
                " it could not keep aliases out"
            )
        if self.sample_rate * (self.lead + self.duration) * OVERSAMPLING > MAX_SAMPLES:
            yield (
                f"duration: {self.duration:g} s at {self.sample_rate:g} Hz is too much; a recording has at most"
                f" {MAX_SAMPLES // OVERSAMPLING} samples"
            )

    @property
    def samples(self) -> int:
        """Samples of each channel."""
        return round(self.duration * self.sample_rate)

    @property
    def analog_rate(self) -> float:
        """Rate [Hz] at which the loads are needed and the analog stages are computed."""
        return OVERSAMPLING * self.sample_rate

    @property
    def span(self) -> float:
        """Time [s] that the loads must cover: lead, recording, and a little for a clock that runs slow."""
        return self.lead + self.duration / (1.0 + self.clock_error) + 8.0 / self.sample_rate
