"""What users type as options, turned into values: quantities, bands, counts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from microvib.errors import MicrovibError

if TYPE_CHECKING:
    from microvib.analysis.limits import Limit


def quantity(option: str, text: str, unit: str) -> float:
    """Value of an option's text in ``unit``; MicrovibError with the option's name."""
    from microvib.units import convert

    try:
        return convert(text, unit)
    except ValueError as error:
        raise MicrovibError(f"{option}: {text!r} {error}") from None


def band_of(text: str) -> tuple[float, float]:
    """LOW:HIGH in Hz, such as ``0.5:5 Hz``; MicrovibError with the option's name."""
    from microvib.units import band

    try:
        return band(text)
    except ValueError as error:
        raise MicrovibError(f"--band: {error}") from None


def limit_of(limit: str | None, band: str | None) -> Limit | None:
    """The limit on lines that ``--limit`` and ``--band`` state; None without one. MicrovibError where they do not fit."""
    if limit is None:
        if band is not None:
            raise MicrovibError("--band: says where a limit holds; give --limit, such as --limit '10 mN*m'")
        return None
    from microvib.analysis.limits import Limit

    most = quantity("--limit", limit, "N*m")
    if not 0.0 < most < math.inf:
        raise MicrovibError(f"--limit: {limit!r} is not allowed; it must be finite and greater than 0 N*m")
    return Limit(most, *((0.0, math.inf) if band is None else band_of(band)))


def counts_of(text: str) -> tuple[int, ...]:
    """Microsteps per full step, separated by commas."""
    try:
        counts = tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError:
        counts = (0,)
    if min(counts) < 1 or max(counts) > 65_536:
        raise MicrovibError(
            f"--microsteps: {text!r} is not allowed; whole numbers from 1 to 65536 are wanted, such as 8,16,32"
        )
    return counts
