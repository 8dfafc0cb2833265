"""How recordings are processed: what the server hands to a worker."""

from __future__ import annotations

from dataclasses import dataclass

from microvib.io.band_limits import BandLimit
from microvib.signals.spectrum import Average, Window


@dataclass(frozen=True)
class Processing:
    """How a recording is processed, as ``analyse`` is told."""

    window: Window = "hann"
    average: Average = "none"
    resolution: str | None = None
    overlap: float = 0.5
    band_limits: tuple[BandLimit, ...] = ()
    roll_off: float | None = None
