"""Dates and times of day in tables of text, as seconds from the first."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from microvib.testdata.channels import is_time, is_unit, named_unit
from microvib.testdata.recording import RecordingError

_DAY = 86400.0
_DATE = r"\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.](?:\d{1,2}|[A-Za-z]{3})[-/.]\d{2,4}"
_STAMP = (
    r"(?<![\w.:])(?:(?P<date>{date})(?P<between>T|\"?[ ,;\t]+\"?))?"
    r"(?:(?P<hours>\d{{1,2}}):)?(?P<minutes>\d{{1,2}}):(?P<seconds>\d{{2}}(?:[{marks}]\d+)?)"
    r"(?:[ ]?(?P<half>[AaPp])\.?[Mm]\.?)?(?P<zone>[ ]?(?:Z|UTC|GMT)|(?:[+-]\d\d:?\d\d|[ ][+-]\d\d:\d\d)(?![.]))?(?![\w:])"
)
_STAMPS = {marks: re.compile(_STAMP.format(date=_DATE, marks=marks)) for marks in (".", ".,")}


def in_seconds(
    lines: Sequence[str], rows: int, longest_top: int, time: str | None
) -> tuple[list[str], str] | None:
    """The lines of a table whose rows have a time of day, with or without a date, as seconds from
    the first in its place, and the first as it is written; None where no ``rows`` lines below each
    other among the first ``longest_top`` have one.

    A date and a time that are two columns become one. Its name in the header stays if it is that of
    a time axis, or ``time``, the name that is given. RecordingError where a row has none, or where
    dates and times contradict each other.
    """
    start = lines[: longest_top + rows]
    has_separators = any(mark in line for line in start[-rows:] for mark in (";", "\t"))
    stamp = _STAMPS[".," if has_separators else "."]
    found = [stamp.search(line) for line in start]
    first = next((k for k in range(len(found) - rows + 1) if all(found[k : k + rows])), None)
    if first is None:
        return None
    one = found[first]
    assert one is not None
    body = _moments([line for line in lines[first:] if not line.startswith("#")], stamp, one)
    separator = _separator(lines[first], one)
    decimal = "."
    if separator != "," and any("," in row.after for row in body[:rows]):
        decimal = ","
    rest = []
    for row in body:
        seconds = f"{row.moment - body[0].moment:.9f}".replace(".", decimal)
        rest.append((row.before + seconds + row.after).replace('"', ""))
    return [*_header(lines[:first], lines[first], one, separator, time), *rest], one[0]


@dataclass(frozen=True)
class _StampedRow:
    """A row with its time [s] from the midnight before the first, and the text about the stamp."""

    moment: float
    before: str
    after: str


def _moments(
    lines: Sequence[str], pattern: re.Pattern[str], first: re.Match[str]
) -> list[_StampedRow]:
    """Times of rows; RecordingError where one has none, or a day is missing or there twice."""
    rows: list[_StampedRow] = []
    days, last = 0.0, first
    for k, line in enumerate(lines, 1):
        this = pattern.search(line)
        if this is None or (this["date"] is None) != (first["date"] is None):
            raise RecordingError(
                f"row {k} of its numbers has no time such as '{first[0]}': {line[:60]!r}"
            )
        # A new day is told by the clock, whichever way its date is written.
        is_new_day = _of_day(this) < _of_day(last) - 0.5 * _DAY
        if first["date"] and (this["date"] != last["date"]) != is_new_day:
            raise RecordingError(
                f"row {k} of its numbers is of '{this[0]}', and the row before of '{last[0]}'; a"
                " day is missing or twice"
            )
        days, last = days + _DAY * is_new_day, this
        moment = _of_day(this) + days - _utc_offset(this)
        rows.append(_StampedRow(moment, line[: this.start()], line[this.end() :]))
    return rows


def _of_day(stamp: re.Match[str]) -> float:
    """Seconds of the day."""
    hours = int(stamp["hours"] or 0)
    if stamp["half"]:
        hours = hours % 12 + (12 if stamp["half"].lower() == "p" else 0)
    return 3600.0 * hours + 60.0 * int(stamp["minutes"]) + float(stamp["seconds"].replace(",", "."))


def _utc_offset(stamp: re.Match[str]) -> float:
    """Seconds by which the zone is ahead of universal time, where a number tells it."""
    zone = (stamp["zone"] or "").strip()
    if zone[:1] not in ("+", "-"):
        return 0.0
    return (1.0 if zone[0] == "+" else -1.0) * (3600.0 * int(zone[1:3]) + 60.0 * int(zone[-2:]))


def _separator(row: str, stamp: re.Match[str]) -> str | None:
    """Separator of the columns of a row with a time stamp; None for blanks."""
    for text in (
        row[stamp.end() :].lstrip('" '),
        row[: stamp.start()].rstrip('" ')[::-1],
        (stamp["between"] or "").strip('" '),
    ):
        if text[:1] in (",", ";", "\t"):
            return text[0]
    return None


def _header(
    top: Sequence[str], row: str, stamp: re.Match[str], separator: str | None, time: str | None
) -> list[str]:
    """The lines above the numbers, in whose header date and time are one column, in seconds."""
    columns = len(row.rstrip(separator).split(separator))
    stamped = _stamped_columns(row, stamp, separator)
    rows = [line.lstrip("#%").strip(" ").rstrip(separator).split(separator) for line in top[-2:]]
    fits = [len(cells) == columns for cells in rows]
    has_units = len(rows) == 2 and all(fits) and all(map(_may_be_unit, rows[1]))
    if has_units:
        rows[0][stamped] = [_time_name(rows[0][stamped], time)]
        rows[1][stamped] = ["s"]
    elif rows and fits[-1]:
        name = _time_name(rows[-1][stamped], time)
        rows[-1][stamped] = [f"{name} [s]" if separator else f"{name}_s"]
    return [
        *top[: len(top) - len(rows)],
        *((separator or " ").join(cells) for cells in rows),
    ]


def _stamped_columns(row: str, stamp: re.Match[str], separator: str | None) -> slice:
    """The column of date and time, or the two where each has its own."""
    before = row[: stamp.start()]
    place = before.count(separator) if separator else len(before.split())
    between = (stamp["between"] or "").strip('"')
    if between not in ("", "T") and (separator is None or separator in between):
        return slice(place, place + 2)
    return slice(place, place + 1)


def _may_be_unit(cell: str) -> bool:
    return not cell.strip() or is_unit(cell.strip('" '))


def _time_name(cells: Sequence[str], time: str | None) -> str:
    """Name of the time axis, as the header or the preparation has it."""
    for cell in cells:
        name = cell.strip().strip('"').strip()
        if name == time or is_time(named_unit(name)[0]):
            return named_unit(name)[0]
    return "time"
