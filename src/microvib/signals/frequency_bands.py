"""Bands that tile the frequency axis: parts of an octave, of constant width, or of constant percentage.

Where the bands lie depends on the bandwidth alone, never on what is looked at in them.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from microvib.errors import OptionError, quoted_value
from microvib.units import GivenQuantity, Si, quantity

OCTAVE = 10.0**0.3
"""Ratio of an octave, base ten (IEC 61260-1)."""
MOST_BANDS = 20_000
"""Bands of one envelope at most."""
LOWEST = 1e-3
"""Frequency [Hz] at which bands of constant ratio begin; those of constant width begin at 0."""
_REFERENCE = {"octave": 1000.0, "percent": 1.0}
_ROUNDING = 1e-9
_OCTAVES = re.compile(r"(?:1\s*/\s*(\d{1,2})|third)?\s*[- ]?\s*octave", re.IGNORECASE)
_EXPECTED = "a part of an octave such as '1/3 octave', a width such as '2 Hz' or '5 percent'"


@dataclass(frozen=True)
class Bandwidth:
    """Width of the bands, which says where each of them lies.

    Parts of an octave are those of IEC 61260-1, about 1 kHz; bands of a constant percentage have an
    edge at 1 Hz, those of constant width at 0 Hz.
    """

    kind: Literal["octave", "constant", "percent"]
    size: float
    """Parts of an octave, width [Hz], or width over the lower edge."""

    @classmethod
    def of(cls, given: GivenQuantity | Bandwidth) -> Bandwidth:
        """Make a bandwidth of what was written.

        Parameters
        ----------
        given : str, Si or Bandwidth
            Such as ``"1/3 octave"``, ``"2 Hz"`` or ``"5 percent"``; a number in SI is a width in Hz.

        Returns
        -------
        Bandwidth
            The bandwidth.

        Raises
        ------
        OptionError
            For what is none of them.
        """
        if isinstance(given, Bandwidth):
            return given
        if not isinstance(given, str) or isinstance(given, Si):
            return cls("constant", quantity("bandwidth", given, "Hz", positive=True))
        parts = _OCTAVES.fullmatch(given.strip())
        if parts is not None:
            return cls._of_octave(given, parts[1])
        if given.rstrip().endswith(("%", "percent")):
            part = quantity("bandwidth", given, "")
            if not 1e-4 <= part <= 1.0:
                raise OptionError(
                    "bandwidth",
                    f"{quoted_value(given)} is not allowed; 0.01 to 100 percent are expected",
                )
            return cls("percent", part)
        try:
            return cls("constant", quantity("bandwidth", given, "Hz", positive=True))
        except OptionError:
            raise OptionError(
                "bandwidth", f"{quoted_value(given)} is not known; {_EXPECTED} is expected"
            ) from None

    @classmethod
    def _of_octave(cls, given: str, number: str | None) -> Bandwidth:
        if number is not None:
            parts = int(number)
        else:
            parts = 3 if "third" in given.lower() else 1
        if not 1 <= parts <= 48:
            raise OptionError(
                "bandwidth",
                f"{quoted_value(given)} is not allowed; 1/1 to 1/48 octave are expected",
            )
        return cls("octave", float(parts))

    @property
    def words(self) -> str:
        """The bandwidth in words."""
        if self.kind == "constant":
            return f"bands of {self.size:g} Hz"
        if self.kind == "percent":
            return f"bands of {100.0 * self.size:g} %"
        return "octave bands" if self.size == 1.0 else f"1/{self.size:g}-octave bands"

    def edge(self, number: int) -> float:
        """Lower edge [Hz] of the band with a ``number``, which is the upper one of that before."""
        if self.kind == "constant":
            return number * self.size
        if self.kind == "percent":
            return float(_REFERENCE["percent"] * (1.0 + self.size) ** number)
        return float(_REFERENCE["octave"] * OCTAVE ** ((number - self._half) / self.size))

    @property
    def _half(self) -> float:
        """Part of a band between the reference and the edge of the band with the number 0: of an odd
        number of parts of an octave the reference is a centre, of an even one an edge.
        """
        return 0.5 if self.size % 2.0 else 0.0

    def ends(self, number: int) -> tuple[float, float]:
        """Lower and upper edge [Hz] of a band."""
        return self.edge(number), self.edge(number + 1)

    def number(self, frequency: float) -> int:
        """Number of the band that a frequency [Hz] is in; one on an edge is in the upper band."""
        if self.kind == "constant":
            found = math.floor(frequency / self.size)
        else:
            found = math.floor(self._position(max(frequency, LOWEST)))
        while self.edge(found) > frequency and frequency >= LOWEST:
            found -= 1
        while self.edge(found + 1) <= frequency:
            found += 1
        return found

    def _position(self, frequency: float) -> float:
        if self.kind == "percent":
            return math.log(frequency / _REFERENCE["percent"]) / math.log1p(self.size)
        return self.size * math.log(frequency / _REFERENCE["octave"], OCTAVE) + self._half

    def touching(self, low: float, high: float) -> range:
        """Numbers of all bands that an interval of frequency [Hz] touches, with its ends; OptionError
        where they are too many.
        """
        least = 0.0 if self.kind == "constant" else LOWEST
        first = self.number(max(low * (1.0 - _ROUNDING), least))
        last = self.number(max(high * (1.0 + _ROUNDING), least))
        if last - first >= MOST_BANDS:
            raise OptionError(
                "bandwidth",
                f"{self.words} from {low:g} to {high:g} Hz are more than {MOST_BANDS}; wider ones are expected",
            )
        return range(first, last + 1)
