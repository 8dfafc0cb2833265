"""A published test as data: its states, what is assumed of it, and what of it is compared."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from microvib.io.file_access import WORKING_FOLDER
from microvib.io.named import named_text, test_names
from microvib.io.yaml_text import parse_yaml
from microvib.model.part import Part
from microvib.model.sentences import validate_part
from microvib.units import Quantity, quantity

DEFAULT_TEST = "solar-array-simulator"
Source = Annotated[str, Field(max_length=500)]
Lines = Annotated[tuple[str, ...], Field(min_length=1, max_length=100)]
Within = Annotated[float, Quantity("", "relative difference that is allowed", gt=0)]


class State(Part):
    """One state of the test: its scenario, and what was measured of it besides lines."""

    scenario: str = Field(description="name of the catalog, or a scenario file")
    mode_frequency: (
        Annotated[float, Quantity("Hz", "of the first mode, through the drive", gt=0)] | None
    ) = None
    inertia: (
        Annotated[float, Quantity("kg*m^2", "of the array about the drive axis", gt=0)] | None
    ) = None


class Spectra(Part):
    """States whose spectra are drawn together."""

    title: str = Field(max_length=200)
    states: tuple[int, ...] = Field(min_length=1, max_length=20)


class PublishedAngle(Part):
    """An angle that the publication derives."""

    value: Annotated[float, Quantity("rad", "as published", gt=0, display="deg")]
    within: Within
    source: Source = ""


class PublishedFrequency(Part):
    """A frequency that the publication derives."""

    value: Annotated[float, Quantity("Hz", "as published", gt=0)]
    within: Within
    source: Source = ""


class ReferenceBar(Part):
    """How near runs must come to the reference lines of their scenarios."""

    within: Within
    frequencies: Source = ""
    amplitudes: Source = ""


class RangeClaim(Part):
    """Amplitudes of each line lie within a range of each other over some states."""

    lines: Lines
    states: tuple[int, ...] = Field(min_length=2, max_length=100)
    at_most: Annotated[float, Quantity("N*m", "largest less smallest amplitude", gt=0)]
    source: Source = ""


class GrowthClaim(Part):
    """Each line is larger in the second state of each pair than in the first."""

    lines: Lines
    pairs: tuple[tuple[int, int], ...] = Field(min_length=1, max_length=100)
    cause: str = Field(max_length=200, description="what else is larger in the second state")
    source: Source = ""


class PeakClaim(Part):
    """The largest torque is the published one, within a factor."""

    state: int
    when: Literal["in the record", "from power-on"] = "in the record"
    value: Annotated[float, Quantity("N*m", "as published", gt=0)]
    factor: Annotated[float, Quantity("", "either way", gt=1)]
    source: Source = ""


class LargerClaim(Part):
    """A line is larger than another one of the same state."""

    line: str
    than: str
    state: int
    words: str = Field(default="", max_length=500, description="what the claim is called")
    source: Source = ""


class Assumption(Part):
    """A central value, and the range from which others are drawn, each as likely as another."""

    central: str | float
    low: str | float
    high: str | float


class Assumptions(Part):
    """Assumptions on a test with a solar array simulator, in the order in which it is drawn."""

    kappa: Assumption
    damping: Assumption
    settle: Assumption
    exponent: Assumption
    lowest: Assumption
    highest: Assumption
    rotor_offset: Assumption

    def values(self, which: Literal["central", "low", "high"]) -> dict[str, Any]:
        """One value of each, in SI."""
        return {
            name: quantity(f"assumed.{name}", getattr(getattr(self, name), which), unit)
            for name, unit in ASSUMED_UNITS.items()
        }


ASSUMED_UNITS = {
    "kappa": "",
    "damping": "",
    "settle": "s",
    "exponent": "",
    "lowest": "Hz",
    "highest": "Hz",
    "rotor_offset": "",
}


class PublishedTest(Part):
    """A published test; states are numbered from 1."""

    title: str = Field(max_length=500)
    citation: str = Field(max_length=2000, description="where the test is published")
    states: tuple[State, ...] = Field(min_length=1, max_length=100)
    spectra: tuple[Spectra, ...] = ()
    full_step: PublishedAngle | None = None
    driving_frequency: PublishedFrequency | None = None
    lines: ReferenceBar | None = None
    ranges: tuple[RangeClaim, ...] = ()
    growths: tuple[GrowthClaim, ...] = ()
    peaks: tuple[PeakClaim, ...] = ()
    larger: tuple[LargerClaim, ...] = ()
    assumed: Assumptions | None = None
    reading_error: Annotated[
        float, Quantity("", "standard deviation of the test's driving lines", gt=0)
    ] = 0.05
    simulator: str = Field(default="", description="solar array simulator of the catalog")
    noise_density: (
        Annotated[
            float, Quantity("N^2*m^2/Hz", "from which the calibration of the noise begins", gt=0)
        ]
        | None
    ) = None

    def _consistency_errors(self) -> Iterator[str]:
        for n in self._named_states():
            if not 1 <= n <= len(self.states):
                yield f"states: there is no state {n}; states are numbered from 1 to {len(self.states)}"
        if self.assumed is None:
            return
        if not self.simulator or self.noise_density is None:
            yield "assumed: needs the keys simulator and noise_density, too"
        if any(state.mode_frequency is None or state.inertia is None for state in self.states):
            yield "assumed: needs mode_frequency and inertia of every state"

    def _named_states(self) -> Iterator[int]:
        """Numbers of the states that spectra and claims are about."""
        for one in self.ranges:
            yield from one.states
        for spectrum in self.spectra:
            yield from spectrum.states
        for growth in self.growths:
            yield from itertools.chain.from_iterable(growth.pairs)
        yield from (claim.state for claim in self.peaks)
        yield from (claim.state for claim in self.larger)


def load_test(name: str) -> PublishedTest:
    """A published test of the catalog, or of a YAML file.

    Raises MicrovibError with one sentence per problem.
    """
    text = named_text(name, WORKING_FOLDER, kind="test", published=test_names(), within="tests/")
    return validate_part(PublishedTest, parse_yaml(text, name), origin=name)
