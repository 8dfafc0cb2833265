"""Dates and times of day in tables of text, as seconds from the first."""

from __future__ import annotations

import re
from collections.abc import Sequence

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
    if sum(line.count(";") + line.count("\t") for line in lines[: longest_top + rows][-rows:]):
        marks = ".,"
    else:
        marks = "."
    stamp = _STAMPS[marks]
    found = [stamp.search(line) for line in lines[: longest_top + rows]]
    first = next((k for k in range(len(found) - rows + 1) if all(found[k : k + rows])), None)
    if first is None:
        return None
    one = stamp.search(lines[first])
    assert one is not None
    body: list[tuple[str, re.Match[str], float]] = []
    days, last = 0.0, one
    for k, line in enumerate((line for line in lines[first:] if not line.startswith("#")), 1):
        this = stamp.search(line)
        if this is None or (this["date"] is None) != (one["date"] is None):
            raise RecordingError(
                f"row {k} of its numbers has no time such as '{one[0]}': {line[:60]!r}"
            )
        # A new day is told by the clock, whichever way its date is written.
        new = _of_day(this) < _of_day(last) - 0.5 * _DAY
        if one["date"] and (this["date"] != last["date"]) != new:
            raise RecordingError(
                f"row {k} of its numbers is of '{this[0]}', and the row before of '{last[0]}'; a"
                " day is missing or twice"
            )
        days, last = days + _DAY * new, this
        body.append((line, this, _of_day(this) + days - _utc_offset(this)))
    start, separator = body[0][2], _separator(lines[first], one)
    if separator != "," and any("," in line[this.end() :] for line, this, _ in body[:rows]):
        mark = ","
    else:
        mark = "."
    rest = [
        (
            line[: this.start()] + f"{moment - start:.9f}".replace(".", mark) + line[this.end() :]
        ).replace('"', "")
        for line, this, moment in body
    ]
    return [*_header(lines[:first], lines[first], one, separator, time), *rest], one[0]


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
    """What parts the columns of a row with a time stamp; None for blanks."""
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
    if separator:
        place = row[: stamp.start()].count(separator)
    else:
        place = len(row[: stamp.start()].split())
    apart = (stamp["between"] or "").strip('"')
    if apart not in ("", "T") and (separator is None or separator in apart):
        wide = 2
    else:
        wide = 1
    rows = [line.lstrip("#%").strip(" ").rstrip(separator).split(separator) for line in top[-2:]]
    fits = [len(fields) == columns for fields in rows]
    below = (
        len(rows) == 2
        and all(fits)
        and all(not x.strip() or is_unit(x.strip('" ')) for x in rows[1])
    )
    found = list(top[: len(top) - len(rows)])
    for k, fields in enumerate(rows):
        own = [x.strip().strip('"').strip() for x in fields[place : place + wide]]
        name = next((x for x in own if x == time or is_time(named_unit(x)[0])), "time")
        if fits[k] and (below or k == len(rows) - 1):
            unit = "s" if k == 1 else named_unit(name)[0]
            if below:
                cell = unit
            elif separator:
                cell = f"{named_unit(name)[0]} [s]"
            else:
                cell = f"{named_unit(name)[0]}_s"
            fields = [*fields[:place], cell, *fields[place + wide :]]
        found.append((separator or " ").join(fields))
    return found
