"""Tables: CSV and JSON of results, the versions behind them; tables of lines and those of the
catalog, read.
"""

from __future__ import annotations

import csv
import io
import json
import math
import platform
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path
from typing import Any

from microvib.errors import MicrovibError, did_you_mean, quoted_value
from microvib.io.csv_cells import csv_text, unescape_formula
from microvib.io.files import as_read_errors, check_file
from microvib.io.writing import EDITED_COPY, require_unchanged
from microvib.model.reference import Reference
from microvib.results import columns_of
from microvib.signals.line_table import Line, LineTable
from microvib.units import LARGEST_MAGNITUDE

_COMMA, _POINT = (re.compile(rf"\s*[+-]?\d*{mark}\d+([eE][+-]?\d+)?\s*") for mark in (",", r"\."))

LARGEST = 1_000_000_000  # bytes of the largest table that is read


def rows_csv(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV text of rows under a header; figures with nine digits, what is not known left empty."""
    return csv_text(chain([header], ([_cell(x) for x in row] for row in rows)))


def columns_csv(columns: Mapping[str, Iterable[float]]) -> str:
    """CSV text of columns of equal length."""
    return rows_csv(list(columns), zip(*columns.values(), strict=True))


def _cell(value: Any) -> str:
    if isinstance(value, float):
        if math.isnan(value):
            return ""
        return f"{value:.9g}"
    return str(value)


def to_json(data: Any) -> str:
    """JSON text; numbers that JSON does not know become null."""
    return json.dumps(_finite(data), indent=2, ensure_ascii=False) + "\n"


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_finite(value) for value in data]
    if isinstance(data, float):
        if math.isfinite(data):
            return float(data)
        return None
    return data


def plain_lines(text: str) -> list[str]:
    """Lines of a table as text, separated by commas and with decimal points, however it came from a
    spreadsheet.

    Where its columns are parted by semicolons or tabs, numbers may have decimal commas; not where
    another has a point, for then a comma may part thousands.
    """
    lines = text.removeprefix("\ufeff").splitlines()
    head = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    separator = next((x for x in ";\t" if x in head), ",")
    if separator == "," or any("," in x and not _COMMA.fullmatch(x) for x in head.split(separator)):
        return lines
    rows = list(csv.reader(lines, delimiter=separator))
    if not any(_POINT.fullmatch(cell) for row in rows for cell in row):
        rows = [
            [cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell for cell in row]
            for row in rows
        ]
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue().splitlines()


@contextmanager
def _table_at(path: Path, kind: type[MicrovibError]) -> Iterator[list[str]]:
    with as_read_errors(path, kind):
        check_file(path, LARGEST)
        try:
            yield plain_lines(path.read_text(encoding="utf-8"))
        except (UnicodeDecodeError, csv.Error) as error:
            raise MicrovibError(
                f"cannot be read: is not a table as text ({error}); save it as CSV in UTF-8"
            ) from None


def csv_rows(path: Path, kind: type[MicrovibError]) -> list[list[str]]:
    """Rows of a CSV file; an error of this ``kind`` where it cannot be read, or is no text."""
    with _table_at(path, kind) as lines:
        return _cells(lines)


def text_rows(text: str) -> list[list[str]]:
    """Rows of a CSV table that is given as text."""
    return _cells(plain_lines(text))


def _cells(lines: Iterable[str]) -> list[list[str]]:
    """Cells of a table by rows, as they were before they were guarded against spreadsheets."""
    return [[unescape_formula(cell) for cell in row] for row in csv.reader(lines)]


def dict_rows(
    path: Path, known: Iterable[str], kind: type[MicrovibError] = MicrovibError, *, what: str = "",
    needed: Sequence[str] = (), ignored: str = "(?!)",
) -> list[dict[str, str]]:  # fmt: skip
    """Rows of a CSV file by the names in its first line.

    A column that is not read would count as nothing, so that every column must be a ``known`` one.

    Parameters
    ----------
    known : iterable of str
        Names of columns that are read; ``comment`` is always allowed. Capitals and blanks about a name do not matter.
    kind : type
        Error that is raised.
    what : str
        What is in its rows, in words for the sentence.
    needed : sequence of str
        Columns without which, and without a row, it is none.
    ignored : str
        Regular expression of further columns that may be there and are not read.

    Raises
    ------
    MicrovibError
        Of this ``kind``, where the file cannot be read, a column is not known, there twice or in mega where it is
        read in milli, or a row has more cells than there are columns.
    """
    expected = _KnownColumns((*known, "comment"), tuple(needed), ignored, what)
    with _table_at(path, kind) as lines:
        return _dict_rows(str(path), lines, expected, kind)


def text_dict_rows(
    text: str, name: str, known: Iterable[str], *, what: str = "", needed: Sequence[str] = ()
) -> list[dict[str, str]]:
    """As ``dict_rows``, of a table that is given as text and called ``name``; MicrovibError."""
    expected = _KnownColumns((*known, "comment"), tuple(needed), "(?!)", what)
    return _dict_rows(name, plain_lines(text), expected, MicrovibError)


def _dict_rows(
    name: str, lines: Iterable[str], expected: _KnownColumns, kind: type[MicrovibError]
) -> list[dict[str, str]]:
    """Rows of the lines of a table called ``name``, by the names in its first line."""
    names = {known.lower(): known for known in expected.names}
    head, *rows = _cells(lines) or [[]]
    _refuse_mega(name, [cell.strip() for cell in head], names, kind)
    columns = [names.get(cell.strip().lower(), cell.strip()) for cell in head]
    rows = [row for row in rows if row]
    while columns and not columns[-1] and not _has_cells(rows, len(columns) - 1):
        columns.pop()  # spreadsheets leave empty columns behind
    if not rows and expected.needed and set(expected.needed) <= set(columns):
        what = f"; {expected.what} are expected, a row each" if expected.what else ""
        raise kind(f"{name}: has a header and no rows below it{what}")
    _check_columns(name, columns if rows else [], expected, kind)
    for k, row in enumerate(rows, 2):
        if _has_cells([row], len(columns)):
            raise kind(
                f"{name}, row {k}: has {len(row)} cells, and the first line names"
                f" {len(columns)} columns"
            )
    return [dict(zip(columns, [*row, *[""] * len(columns)], strict=False)) for row in rows]


def _refuse_mega(
    name: str, head: Sequence[str], names: Mapping[str, str], kind: type[MicrovibError]
) -> None:
    """Refuse a table whose heading has M, mega, where the column of its name in small letters is in milli."""
    for cell in head:
        if _has_mega(cell) and cell.lower() in names:
            raise kind(
                f"{name}: column {quoted_value(cell)} has a prefix of 1e6 (mega); {names[cell.lower()]} is in"
                " thousandths (milli), and no other is read"
            )


def _has_mega(heading: str) -> bool:
    """Whether a unit in a heading that is not all in capitals begins with M, as MN in limit_MN_m does."""
    return not heading.isupper() and bool(re.search(r"(?:^|_)M(?:N|g|rad|m|Hz)", heading))


def _has_cells(rows: Sequence[Sequence[str]], first: int) -> bool:
    """Whether anything is in the columns from the ``first`` on."""
    return any(cell.strip() for row in rows for cell in row[first:])


@dataclass(frozen=True)
class _KnownColumns:
    """Columns that a table may have."""

    names: tuple[str, ...]
    needed: tuple[str, ...]
    ignored: str  # regular expression of those that are not read
    what: str  # is in the rows, in words


def _check_columns(
    path: str, columns: Sequence[str], known: _KnownColumns, kind: type[MicrovibError]
) -> None:
    """Refuse a table that lacks columns which are needed, or has unknown ones, or one twice."""
    what = known.what
    for name in known.needed:
        if name not in columns:
            raise kind(
                f"{path}: is not a table of {what}: a header with {', '.join(known.needed)} is"
                f" expected; {name} is missing"
            )
    for name in columns:
        if name not in known.names and not re.fullmatch(known.ignored, name):
            none = f"is not a table of {what}: " if what else ""
            raise kind(
                f"{path}: {none}column {quoted_value(name)} is not known;"
                f" {_proposal(name, known.names)}"
            )
        if columns.count(name) > 1:
            raise kind(f"{path}: column '{name}' occurs twice; leave one of them out")


def _proposal(name: str, known: Iterable[str]) -> str:
    """Advice on an unknown column."""
    names = [each for each in known if each != "comment"]
    return f"{did_you_mean(name, names)}allowed are {', '.join(names)}, and comment for remarks"


def named_rows(
    path: Path,
    columns: Sequence[str],
    what: str,
    kind: type[MicrovibError],
    *,
    also: Sequence[str] = (),
) -> list[dict[str, str]]:
    """Rows of a CSV file with these columns, and perhaps those of ``also``; an error of this
    ``kind`` where it is none.
    """
    return dict_rows(path, (*columns, *also), kind, what=what, needed=columns)


def parse_finite(where: str, text: str | None, kind: type[MicrovibError] = MicrovibError) -> float:
    """The number that a cell of a table holds; an error of this ``kind`` where it is none, or not
    finite.
    """
    try:
        if "_" in (text or ""):  # which Python takes between digits
            raise ValueError
        value = float(text or "")
    except ValueError:
        raise kind(f"{where} '{str(text)[:60]}' is not a number") from None
    if not math.isfinite(value):
        raise kind(f"{where} is {value}; a finite number is expected")
    if abs(value) > LARGEST_MAGNITUDE:
        raise kind(f"{where} is {value:g}; a number within {LARGEST_MAGNITUDE:g} is expected")
    return value


def package_versions() -> dict[str, str]:
    """Versions that a result depends on."""
    names = ("microvib", "numpy", "numba", "llvmlite")
    return {"python": platform.python_version()} | {name: _version_of(name) for name in names}


@cache
def _version_of(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def read_table(name: str) -> list[dict[str, str]]:
    """Rows of one of the tables in the catalog, such as ``harmonic_gears``."""
    from importlib import resources

    text = (resources.files("microvib.catalog") / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))


_FIGURES = ("frequency", "amplitude", "amplitude_uncertainty", "bin_frequency", "bin_amplitude")


def is_line_table(path: Path) -> bool:
    """Whether a CSV file is a table of lines and not a recording."""
    try:
        with path.open("rb") as stream:
            first = stream.readline(1000).removeprefix(b"\xef\xbb\xbf")
            return re.split(rb"[,;\t]", first)[0].strip(b' "\r\n') == b"line"
    except OSError:
        return False


def read_lines(path: Path) -> LineTable:
    """Frequencies, amplitudes and status of a table of lines by name, empty or nan where they are;
    nothing else is read.

    MicrovibError names a column that is not known, and the row where one is not a number, or not
    finite.
    """
    require_unchanged(path, EDITED_COPY)
    rows = dict_rows(path, [column.key for column in columns_of(Line).values()], what="lines")
    return _table(
        [
            (row.get("line") or "", _figures(f"{path}, row {k}", row))
            for k, row in enumerate(rows, 2)
        ]
    )


def reference_table(reference: Reference, column: str) -> LineTable:
    """Reference lines as a table: their frequencies and amplitudes by the reference's estimator."""
    if reference.estimator == "nearest bin":
        names = ("bin_frequency", "bin_amplitude")
    else:
        names = ("frequency", "amplitude")
    rows = []
    for line in reference.lines:
        if column == "measured":
            figures: tuple[float | None, float | None] = (line.frequency, line.amplitude)
        else:
            figures = (line.model_frequency, line.model_amplitude)
        known = {n: x for n, x in zip(names, figures, strict=True) if x is not None}
        rows.append((line.line, known))
    return _table(rows)


def _table(rows: list[tuple[str, dict[str, Any]]]) -> LineTable:
    lines = tuple(Line(name, **figures) for name, figures in rows)
    return LineTable(lines, None, None, 0, math.nan)


def _figures(where: str, row: Mapping[str, str | None]) -> dict[str, Any]:
    found: dict[str, Any] = {"status": (row.get("status") or "").strip()}
    for name in _FIGURES:
        key = columns_of(Line)[name].key
        if text := (row.get(key) or "").strip():
            found[name] = parse_finite(f"{where}: {key}", text)
        if "amplitude" in name and found.get(name, 0.0) < 0.0:
            raise MicrovibError(f"{where}: {key}: {text} is negative; an amplitude is 0 or more")
    return found
