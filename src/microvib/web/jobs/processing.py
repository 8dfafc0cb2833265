"""How recordings are processed: what the server hands to a worker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from microvib.io.band_limits import BandLimit
from microvib.signals.impacts import Estimator
from microvib.signals.limit_curve import Limit
from microvib.signals.spectrum import Average, Window
from microvib.testdata.section import Section

RecordedFile = tuple[str, str]
"""File of a recording, and what its owner calls it."""
NOT_SENT_WITH = "it did not come with the request; choose it as a table of the preparation"
"""Reason given of a table that a preparation names and that was not sent."""


@dataclass(frozen=True)
class Preparing:
    """How recordings are prepared: the text of a preparation file, and what it may name."""

    text: str
    tables: Mapping[str, str]
    """Tables that came with it: name and text."""
    recordings: Mapping[str, str]
    """Files of recordings that the page has, by the names that their owner gave them."""


@dataclass(frozen=True)
class Part:
    """The part of a recording that is looked at."""

    section: Section | None = None
    unit: str = ""
    """Unit of the channel, or its full scale; empty for the one that the file has."""
    preparing: Preparing | None = None


@dataclass(frozen=True)
class Processing:
    """How a recording is processed, as ``analyse`` is told."""

    window: Window = "hann"
    average: Average = "none"
    resolution: str | None = None
    overlap: float = 0.5
    band_limits: tuple[BandLimit, ...] = ()
    roll_off: float | None = None
    limit: Limit | None = None
    """Limit of the lines; none is judged without it."""


@dataclass(frozen=True)
class Blows:
    """How a hammer test is made of recordings, as ``hammer_test`` is told."""

    hits: Sequence[tuple[str, float, RecordedFile]]
    """Component, lever arm [m] (1 of a force) and recording of each."""
    impact: str
    mounted_mass: str
    block: str | None = None
    estimator: Estimator = "H1"
