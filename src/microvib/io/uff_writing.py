"""Universal files of test data, written: binary datasets 58.

pyuff reads them. It does not write them here: it knows no spectra (function 12), gives a dataset of
complex or uneven numbers the length of an even real one, and needs two points.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from microvib.testdata.time_axis import snapped_rate

FUNCTIONS = {"time": 1, "response": 4, "coherence": 6, "density": 9, "spectrum": 12}
"""Numbers of the functions of dataset 58 that are written."""
_TIME, _FREQUENCY = 17, 18
_GENERAL = 1
_KINDS = {
    "": (0, 0, 0),
    "N": (13, 0, 0),
    "m": (8, 0, 0),
    "m/s^2": (12, 0, 0),
    "N*m": (_GENERAL, 1, 1),
    "J": (_GENERAL, 1, 1),
    "(N)^2/Hz": (_GENERAL, 0, 2),
    "(N*m)^2/Hz": (_GENERAL, 2, 2),
}
"""Kinds of data on axes by their units: number of the kind (excitation force, displacement, acceleration),
and of a general kind, by which there is none for moments, the exponents of length and force. The rest is
general and without either.
"""
_LITTLE_ENDIAN, _IEEE = 1, 2
_HEADER_LINES = 11
_LABEL, _TITLE = 20, 80


@dataclass(frozen=True)
class Place:
    """Node and direction of a response or a reference: 1 to 3 for x y z, 4 to 6 for rotations about
    them, 0 for a scalar.
    """

    node: int = 1
    direction: int = 0


NOWHERE = Place(0, 0)


@dataclass(frozen=True)
class Even:
    """Times of samples: first and step [s]."""

    start: float
    step: float


@dataclass(frozen=True)
class Dataset58:
    """Numbers over time or frequency, and what they are of."""

    name: str
    function: int
    values: np.ndarray
    """Real or complex, (n,)."""
    along: Even | np.ndarray
    """Times, or frequencies [Hz], (n,)."""
    unit: str = ""
    title: str = ""
    response: Place = NOWHERE
    reference: Place = NOWHERE
    reference_unit: str = ""

    def encoded(self) -> bytes:
        """The dataset with its delimiters."""
        numbers = self._numbers().astype("<f8").tobytes()
        first = f"    58b{_LITTLE_ENDIAN:6d}{_IEEE:6d}{_HEADER_LINES:12d}{len(numbers):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        lines = [f"{-1:6d}", first, *self._header()]
        head = "".join(f"{line:<80}\n" for line in lines)
        return head.encode("ascii", "replace") + numbers + f"\n{-1:6d}\n".encode()

    @property
    def _even(self) -> bool:
        """Whether the step and the first value survive their digits in the header; where not, each
        number has its abscissa.
        """
        if not isinstance(self.along, Even):
            return False
        step = float(f"{self.along.step:.5e}")
        kept = snapped_rate(1.0 / step)[0] == 1.0 / self.along.step
        return bool(kept and float(f"{self.along.start:.5e}") == self.along.start)

    @property
    def _abscissas(self) -> np.ndarray:
        if isinstance(self.along, Even):
            return self.along.start + self.along.step * np.arange(self.values.size)
        return np.asarray(self.along, dtype=float)

    def _numbers(self) -> np.ndarray:
        columns = [self.values.real]
        if np.iscomplexobj(self.values):
            columns.append(self.values.imag)
        if not self._even:
            columns.insert(0, self._abscissas)
        return np.column_stack(columns)

    def _header(self) -> list[str]:
        kind = 6 if np.iscomplexobj(self.values) else 4
        start, step = self._header_step()
        if isinstance(self.along, Even):
            abscissa = _axis((_TIME, 0, 0), "Time", "s")
        else:
            abscissa = _axis((_FREQUENCY, 0, 0), "Frequency", "Hz")
        return [
            self.name[:_TITLE],
            " ".join(self.title.split())[:_TITLE] or "microvib",
            *("NONE",) * 3,
            f"{self.function:5d}{0:10d}{0:5d}{0:10d} {_at(self.response)} {_at(self.reference)}",
            f"{kind:10d}{self.values.size:10d}{int(self._even):10d}{start:13.5e}{step:13.5e}{0.0:13.5e}",
            abscissa,
            _axis(_kind(self.unit), self.name, self.unit),
            _axis(_kind(self.reference_unit), "", self.reference_unit),
            _axis(_kind(""), "", ""),
        ]

    def _header_step(self) -> tuple[float, float]:
        """First value and step, where these say all."""
        if isinstance(self.along, Even) and self._even:
            return self.along.start, self.along.step
        return 0.0, 0.0


def _at(place: Place) -> str:
    return f"{'NONE':<10}{place.node:10d}{place.direction:4d}"


def _kind(unit: str) -> tuple[int, int, int]:
    """Kind of data of a unit, and exponents of length and force."""
    return _KINDS.get(unit, (_GENERAL, 0, 0))


def _axis(kind: tuple[int, int, int], label: str, unit: str) -> str:
    """An axis: kind of data, exponents of length, force and temperature, label and unit."""
    number, length, force = kind
    return f"{number:10d}{length:5d}{force:5d}{0:5d} {label[:_LABEL] or 'NONE':<20} {unit[:_LABEL] or 'NONE':<20}"


def write_datasets(path: Path, sets: Iterable[Dataset58]) -> None:
    """Write datasets to a file."""
    with path.open("wb") as stream:
        for one in sets:
            stream.write(one.encoded())
