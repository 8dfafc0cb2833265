"""Results as tables, declared once: what a column is called in files and for readers, its unit and
digits.

A result's dataclass annotates the fields, and properties, that its table has, in their order:

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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from typing import Any, Literal, get_type_hints
from warnings import warn

Mark = Literal["", "strong", "group", "pass", "fail", "off"]
"""How a row is marked; its last cell has the words of ``pass``, ``fail`` and (less loudly)
``off`` mean.
"""
MARKS: dict[str, Mark] = {
    "pass": "pass",
    "holds": "pass",
    "agrees": "pass",
    "fail": "fail",
    "does NOT hold": "fail",
    "no": "fail",
    "not judged": "off",
    "not comparable": "off",
    "differs": "off",
    "sum": "strong",
}
"""Marks of rows, by the word of their verdict; others have none."""
Role = Literal["", "key", "group", "verdict"]
"""Role of the words of a column: keys of a scenario, which reports set as code; headings
under which reports set the rows that have them; verdicts, by which rows are marked.
"""


@dataclass(frozen=True)
class Measure:
    """How figures of one quantity, which are in SI units, are given."""

    unit: str = ""
    """That readers see."""
    size: float = 1.0
    """Size of that unit in SI."""
    form: str = ".4g"
    """Format specification of the figure in that unit."""
    file_size: float = 1.0
    """Size of the unit in files, which a column's key ends with."""
    units: tuple[tuple[str, float], ...] = ()
    """Units and their sizes in SI, the largest first, where a table takes the one that suits it."""
    least: float = 0.0
    """Figure in that unit below which it is only said that one is less."""

    def text(self, value: float) -> str:
        """A figure as readers see it; empty if there is none."""
        if not math.isfinite(value):
            return ""
        shown = value / self.size
        if 0.0 < shown < self.least:
            return f"< {self.least:g}"
        return f"{shown:{self.form}}".rstrip(".")

    def figure(self, value: float) -> str:
        """A figure with its unit; empty if there is none."""
        if not math.isfinite(value):
            return ""
        return f"{self.text(value)} {self.unit}".rstrip()

    def suited_to(self, values: Iterable[float]) -> Measure:
        """The measure in the one of its ``units`` that suits the largest of some values [SI]."""
        if not self.units:
            return self
        largest = max((abs(x) for x in values if math.isfinite(x)), default=0.0)
        suiting = (one for one in self.units if largest >= one[1])
        unit, size = next(suiting, self.units[-1])
        return replace(self, unit=unit, size=size)


_DEGREE = math.radians(1.0)
ARRAY_ANGLE = Measure("deg", _DEGREE, ".6g", file_size=_DEGREE)
COUNT = Measure(form=".15g")
DIFFERENCE = Measure("%", 0.01, "+z.2f")
DECAY = Measure("1/s")
DECIBEL = Measure("dB", form="+.1f")
FREQUENCY = Measure("Hz")
LINE_FREQUENCY = Measure("Hz", form="#.6g")
LINE_FREQUENCY_UNCERTAINTY = Measure("mHz", 1e-3, "#.2g", least=0.001)
ORDER = Measure(form=".6g")
PHASE = Measure("rad")
POINTING_ANGLE = Measure("rad", units=(("mrad", 1e-3), ("µrad", 1e-6), ("nrad", 1e-9)))
RATE = Measure("deg/s", _DEGREE, ".5g", file_size=_DEGREE)
SHARE = Measure("%", 0.01, ".3g")
TIME = Measure("s")
TORQUE = Measure("mN m", 1e-3, "#.4g")
TORQUE_LIMIT = Measure("mN m", 1e-3, ".6g")
"""Measure of a torque that somebody chose, in as many digits as were given."""
TORQUE_UNCERTAINTY = Measure("mN m", 1e-3, "#.2g", least=0.001)


@dataclass(frozen=True)
class Column:
    """One column of a table of results."""

    key: str
    """Its name in files, which ends with the unit there: ``rate_deg_s``."""
    heading: str = ""
    """For readers; without one, the column is in files only."""
    measure: Measure | None = None
    """Measure of its figures; None where it holds words."""
    absent: str = ""
    """Text where there is no figure."""
    words: Callable[[str], str] = str
    """How readers see its words."""
    report_only: bool = False
    """Whether a terminal, which is narrow, leaves it out."""
    role: Role = ""

    def __post_init__(self) -> None:
        if self.measure is not None:
            size = {"percent": self.measure.size, "deg": _DEGREE}.get(self.key.rpartition("_")[2])
            if size not in (None, self.measure.file_size):
                raise ValueError(
                    f"{self.key}: files have it in units of {self.measure.file_size:g}"
                )

    @property
    def title(self) -> str:
        """The heading with the unit: ``rate [deg/s]``."""
        if self.measure is None or not self.measure.unit:
            return self.heading
        return f"{self.heading} [{self.measure.unit}]"

    def text(self, value: Any) -> str:
        """A value as readers see it; a word among figures, such as *worst*, stands as it is."""
        if self.role == "verdict" and value == "fail":
            return "FAIL"
        if self.measure is None or isinstance(value, str):
            return self.words(str(value))
        return self.measure.text(float(value)) or self.absent

    def in_unit(self, measure: Measure) -> Column:
        """The column in the unit of a measure, where that is one for its figures."""
        own = self.measure
        if own is None or not own.units or own.units != measure.units:
            return self
        fixed = replace(own, unit=measure.unit, size=measure.size, units=())
        return replace(self, measure=fixed)

    def in_file(self, value: Any) -> Any:
        """A value as it stands in files."""
        if self.measure is None or not isinstance(value, float):
            return value
        return value / self.measure.file_size


@dataclass(frozen=True)
class Table:
    """Records under columns. Files have all of them, readers those that matter."""

    name: str
    """Name of its CSV file, without the ending; empty for a table that readers alone see."""
    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    """Values in SI units, as the columns stand."""
    for_readers: tuple[tuple[Any, ...], ...] | None = None
    """The rows that a report shows, what matters most first; None for all."""
    brief: int | None = None
    """How many of these a terminal shows; None for all, 0 for a table of reports alone."""
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
        """The table of ``records`` of a dataclass whose fields and properties are annotated with
        columns.

        Parameters
        ----------
        name : str
            Name of its file; empty for a table that readers alone see.
        kind : type
            The dataclass; fields and properties without a Column are left out.
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

        def rows_of(some: Iterable[Any]) -> tuple[tuple[Any, ...], ...]:
            return tuple(tuple(getattr(x, field) for field in declared) for x in some)

        shown = None if for_readers is None else rows_of(for_readers)
        return cls(name, tuple(declared.values()), rows_of(records), shown, brief, caption)

    @property
    def rows_shown(self) -> tuple[tuple[Any, ...], ...]:
        """The rows that readers see."""
        return self.rows if self.for_readers is None else self.for_readers

    @cached_property
    def shown(self) -> tuple[Column, ...]:
        """The columns that readers see, those of one measure in one unit; empty ones are left
        out.
        """
        return tuple(self._in_one_unit(self.columns[k]) for k in self._kept)

    @cached_property
    def _kept(self) -> list[int]:
        named = [k for k, column in enumerate(self.columns) if column.heading]
        rows = self.rows_shown
        return [k for k in named if not rows or any(self.columns[k].text(row[k]) for row in rows)]

    def _in_one_unit(self, column: Column) -> Column:
        if column.measure is None or not column.measure.units:
            return column
        units = column.measure.units
        alike = [x.measure is not None and x.measure.units == units for x in self.columns]
        figures = (
            x
            for row in self.rows_shown
            for x, counts in zip(row, alike, strict=True)
            if counts and not isinstance(x, str)
        )
        return replace(column, measure=column.measure.suited_to(figures))

    def in_unit(self, measure: Measure) -> Table:
        """The table with all figures that could be in one of the ``units`` of a measure in its
        unit.
        """
        columns = tuple(x.in_unit(measure) for x in self.columns)
        return replace(self, columns=columns)

    def measure(self, key: str) -> Measure:
        """Measure of the figures in the column ``key``, for texts and pictures beside the table."""
        found = next(column.measure for column in self.shown if column.key == key)
        assert found is not None
        return found

    def records(self) -> list[dict[str, Any]]:
        """Rows as they stand in files, by the keys of the columns."""
        keys = [column.key for column in self.columns]
        return [dict(zip(keys, row, strict=True)) for row in self.file_rows()]

    def texts(self, most: int | None = None) -> list[list[str]]:
        """Cells as readers see them, of the first ``most`` rows that they do."""
        return self._texts_of(self.rows_shown[:most])

    def all_texts(self) -> list[list[str]]:
        """Cells of all rows as readers would see them."""
        return self._texts_of(self.rows)

    def _texts_of(self, rows: Iterable[tuple[Any, ...]]) -> list[list[str]]:
        return [
            [column.text(row[k]) for k, column in zip(self._kept, self.shown, strict=True)]
            for row in rows
        ]

    def only(self, keys: Sequence[str]) -> Table:
        """The table under the columns with some ``keys``, in their order, for readers alone."""
        by_key = {column.key: k for k, column in enumerate(self.columns)}
        kept = [by_key[key] for key in keys if key in by_key]

        def under_them(rows: Iterable[tuple[Any, ...]]) -> tuple[tuple[Any, ...], ...]:
            return tuple(tuple(row[k] for k in kept) for row in rows)

        return replace(
            self,
            name="",
            columns=tuple(self.columns[k] for k in kept),
            rows=under_them(self.rows),
            for_readers=None if self.for_readers is None else under_them(self.for_readers),
        )

    def marks(self) -> list[Mark]:
        """Marks of the rows that readers see, by the words of their verdicts."""
        roles = [column.role for column in self.columns]
        if "verdict" not in roles:
            return [""] * len(self.rows_shown)
        at = roles.index("verdict")
        return [MARKS.get(row[at], "") for row in self.rows_shown]

    def file_rows(self) -> list[list[Any]]:
        """Values as they stand in files."""
        return [
            [column.in_file(value) for column, value in zip(self.columns, row, strict=True)]
            for row in self.rows
        ]


MICROSTEPS = Column("microsteps", "microsteps", COUNT)


def file_record(record: Any) -> dict[str, Any]:
    """Fields of a dataclass with columns as they stand in files, by the columns' keys."""
    kind: type = type(record)
    declared = columns_of(kind)
    own = [(each.name, declared[each.name]) for each in fields(record) if each.name in declared]
    return {column.key: column.in_file(getattr(record, name)) for name, column in own}


def former_field(record: Any, name: str, former: Mapping[str, str]) -> Any:
    """The field that the release before called ``name``: by ``former``, which gives new names, or as
    its column is called still; FutureWarning. It goes with the release after this one.
    """
    kind: type = type(record)
    new = former.get(name) or {x.key: of for of, x in columns_of(kind).items()}.get(name, name)
    if new == name:
        raise AttributeError(f"{kind.__name__!r} object has no attribute {name!r}")
    text = f"{kind.__name__}.{name} is called {new}; the old name goes with the next release"
    warn(text, FutureWarning, stacklevel=3)
    return getattr(record, new)


@cache
def columns_of(kind: type) -> dict[str, Column]:
    """Columns of a dataclass by the fields and properties that they annotate: fields in their
    order, then properties in theirs.
    """
    hints = get_type_hints(kind, include_extras=True)
    declared = {field.name: hints[field.name] for field in fields(kind)}
    for name, member in vars(kind).items():
        if isinstance(member, property):
            declared[name] = get_type_hints(member.fget, include_extras=True).get("return")
    notes = (
        (name, note)
        for name, hint in declared.items()
        for note in getattr(hint, "__metadata__", ())
    )
    return {name: note for name, note in notes if isinstance(note, Column)}
