"""How recordings are processed: what the server hands to a worker."""

from __future__ import annotations

from dataclasses import dataclass

from microvib.io.band_limits import BandLimit
from microvib.signals.spectrum import Average, Window
from microvib.testdata.section import Section


@dataclass(frozen=True)
class Part:
    """The part of a recording that is looked at."""

    section: Section | None = None
    unit: str = ""
    """Unit of the channel, or its full scale; empty for the one that the file has."""


@dataclass(frozen=True)
class Processing:
    """How a recording is processed, as ``analyse`` is told."""

    window: Window = "hann"
    average: Average = "none"
    resolution: str | None = None
    overlap: float = 0.5
    band_limits: tuple[BandLimit, ...] = ()
    roll_off: float | None = None
