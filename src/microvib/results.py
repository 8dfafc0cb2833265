"""Results as tables, declared once: what a column is called in files and for readers, its unit and
digits.

A result's dataclass annotates the fields that its table has, in their order:

>>> from typing import Annotated
>>> from dataclasses import dataclass
>>> @dataclass(frozen=True)
... class Peak:
...     frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
...     amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
>>> table = Table.of("peaks", Peak, [Peak(53.01, 0.0123)])
>>> [column.title for column in table.columns]
['frequency [Hz]', 'amplitude [mN m]']
>>> table.texts()
[['53.01', '12.30']]
>>> table.file_rows()
[[53.01, 0.0123]]

``reports.outcome`` makes a terminal's text, a report, CSV files and the page's answer of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, get_type_hints


@dataclass(frozen=True)
class Measure:
    """How figures of one quantity, which are in SI units, are given."""

    unit: str = ""
    """That readers see."""
    size: float = 1.0
    """Of that unit in SI."""
    digits: int = 4
    zeros: bool = False
    """Whether zeros at the end are kept, for figures that are compared down a column."""
    file_size: float = 1.0
    """Of the unit in files, which a column's key ends with."""

    def text(self, value: float) -> str:
        """A figure as readers see it; empty if there is none."""
        if not math.isfinite(value):
            return ""
        shown = value / self.size
        if self.zeros:
            return f"{shown:#.{self.digits}g}".rstrip(".")
        return f"{shown:.{self.digits}g}"


_DEGREE = math.radians(1.0)
COUNT = Measure(digits=15)
FREQUENCY = Measure("Hz")
ORDER = Measure(digits=6)
RATE = Measure("deg/s", _DEGREE, digits=5, file_size=_DEGREE)
TORQUE = Measure("mN m", 1e-3, zeros=True)


@dataclass(frozen=True)
class Column:
    """One column of a table of results."""

    key: str
    """Its name in files, which ends with the unit there: ``rate_deg_s``."""
    heading: str = ""
    """For readers; without one, the column is in files only."""
    measure: Measure | None = None
    """Of its figures; None where it holds words."""
    absent: str = ""
    """What readers see where there is no figure."""

    @property
    def title(self) -> str:
        """The heading with the unit: ``rate [deg/s]``."""
        if self.measure is None or not self.measure.unit:
            return self.heading
        return f"{self.heading} [{self.measure.unit}]"

    def text(self, value: Any) -> str:
        """A value as readers see it."""
        if self.measure is None:
            return str(value)
        return self.measure.text(float(value)) or self.absent

    def in_file(self, value: Any) -> Any:
        """A value as it stands in files."""
        if self.measure is None or not isinstance(value, float):
            return value
        return value / self.measure.file_size


@dataclass(frozen=True)
class Table:
    """Records under columns. Files have all of them, readers those that matter."""

    name: str
    """Of its CSV file, without the ending."""
    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    """Values in SI units, as the columns stand."""
    for_readers: tuple[tuple[Any, ...], ...]
    """The rows that a report shows, what matters most first."""
    brief: int | None = None
    """How many of these a terminal shows; None for all."""
    caption: str = ""
    """A sentence below it in a report."""

    @classmethod
    def of(
        cls,
        name: str,
        kind: type,
        records: Iterable[Any],
        *,
        for_readers: Iterable[Any] | None = None,
        brief: int | None = None,
        caption: str = "",
    ) -> Table:
        """The table of ``records`` of a dataclass whose fields are annotated with columns.

        Parameters
        ----------
        name : str
            Name of its file.
        kind : type
            The dataclass; fields without a Column are left out.
        records : iterable
            Instances of it, in the order of the file.
        for_readers : iterable, optional
            Those that a report shows, in its order; all without it, none if it is empty.
        brief : int, optional
            How many of these a terminal shows.
        caption : str, optional
            A sentence below it in a report.
        """
        declared = columns_of(kind)
        rows = tuple(tuple(getattr(x, field) for field in declared) for x in records)
        if for_readers is None:
            shown = rows
        else:
            shown = tuple(tuple(getattr(x, field) for field in declared) for x in for_readers)
        return cls(name, tuple(declared.values()), rows, shown, brief, caption)

    @property
    def shown(self) -> list[Column]:
        """The columns that readers see."""
        return [column for column in self.columns if column.heading]

    def texts(self, most: int | None = None) -> list[list[str]]:
        """Cells as readers see them, of the first ``most`` rows that they do."""
        return [
            [column.text(value) for column, value in self._cells(row) if column.heading]
            for row in self.for_readers[:most]
        ]

    def file_rows(self) -> list[list[Any]]:
        """Values as they stand in files."""
        return [[column.in_file(value) for column, value in self._cells(row)] for row in self.rows]

    def _cells(self, row: Sequence[Any]) -> Iterable[tuple[Column, Any]]:
        return zip(self.columns, row, strict=True)


MICROSTEPS = Column("microsteps", "microsteps", COUNT)


@cache
def columns_of(kind: type) -> dict[str, Column]:
    """Columns of a dataclass by the fields that they annotate, in the order of its fields."""
    hints = get_type_hints(kind, include_extras=True)
    found = {}
    for field in fields(kind):
        for note in getattr(hints[field.name], "__metadata__", ()):
            if isinstance(note, Column):
                found[field.name] = note
    return found
