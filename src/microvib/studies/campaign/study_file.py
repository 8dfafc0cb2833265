"""The study file: what a campaign varies, how it samples, what it keeps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from microvib.model.part import Part
from microvib.signals.limit_curve import MOST_POINTS
from microvib.units import Quantity

Method = Literal["sobol", "latin-hypercube", "random", "sobol-indices", "one-at-a-time"]


class Sampling(Part):
    """How the distributions are sampled. The same seed gives the same cases."""

    method: Method = Field(
        default="sobol",
        description="sobol, latin-hypercube or random points; sobol-indices for a variance decomposition;"
        " one-at-a-time for each key at its 5 % and 95 % points",
    )
    count: int = Field(
        default=128, ge=1, le=10_000_000, description="points; for sobol-indices the base sample N"
    )
    seed: int = Field(default=1, ge=0, le=2**32 - 1, description="seed of the random numbers")
    noise: Literal["one", "each"] = Field(
        default="one",
        description="each: every point has its own draw of the friction's noise, the scenario's seeds and the following ones;"
        " one: all have the scenario's",
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.noise == "each" and self.method in ("sobol-indices", "one-at-a-time"):
            yield f"noise: each goes with sobol, latin-hypercube and random points, not with {self.method}, which compares points"


class Correlation(Part):
    """Two sampled keys that go together."""

    keys: tuple[str, str] = Field(description="the two keys")
    coefficient: Annotated[
        float, Quantity("", "correlation of the normal scores of the two", ge=-1.0, le=1.0)
    ]


class LimitPoint(Part):
    """A point of a limit over frequency."""

    frequency: Annotated[float, Quantity("Hz", "frequency", gt=0.0)]
    amplitude: Annotated[
        float, Quantity("N*m", "largest line allowed there, 0-to-peak", gt=0.0, display="mN*m")
    ]


class Study(Part):
    """Definition of a campaign: a scenario, its varied keys, and what is kept of each case."""

    title: str = Field(default="", max_length=500, description="short title")
    scenario: str = Field(
        description="scenario to vary: a catalog name or a file, relative to the study's folder"
    )
    set: dict[str, Any] = Field(
        default_factory=dict, description="changes of the scenario, the same in all cases"
    )
    vary: dict[str, Any] = Field(
        default_factory=dict,
        description="per key a list of values, a grid {from, to, count, spacing} or a distribution",
    )
    cases: tuple[dict[str, Any], ...] = Field(
        default=(),
        description="combinations of values, each key: value; how many are drawn says sampling.count",
    )
    sampling: Sampling = Sampling()
    correlations: tuple[Correlation, ...] = Field(
        default=(), description="keys that are sampled together"
    )
    solve: Literal["record", "steady"] = Field(
        default="record",
        description="record: settle and record in time; steady: find the steady state",
    )
    harmonics: int = Field(default=8, ge=1, le=200, description="members of each family of lines")
    limit: (
        Annotated[float, Quantity("N*m", "largest line allowed", gt=0.0, display="mN*m")] | None
    ) = None
    limit_curve: tuple[LimitPoint, ...] | None = Field(
        default=None,
        max_length=MOST_POINTS,
        description="in place of limit: largest lines allowed over frequency, straight on logarithmic scales between"
        " points, a step where a frequency stands twice; limit: FILE.csv reads it from a file",
    )
    band: str | None = Field(
        default=None, description="band in which the limit applies, such as 0.5:5 Hz"
    )
    time_limit: (
        Annotated[float, Quantity("s", "time that a case may take to compute", gt=0.0)] | None
    ) = Field(
        default=None,
        description="time that a case may take to compute; null: a minute and the time that it simulates",
    )
    keep: tuple[Literal["T_d"], ...] = Field(
        default=(), description="histories to keep of every case"
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.limit is not None and self.limit_curve is not None:
            yield "limit_curve: goes in place of limit; leave one of them out"
