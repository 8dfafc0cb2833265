"""Tables of numbers as text: separator, decimal mark, header, units and lines on top are found out."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from microvib.io.csv_cells import unescape_formula
from microvib.io.measured import Column, Hints, recording_of, stated_rates
from microvib.io.stated_scales import LONGEST_REMARK, names_factor
from microvib.io.timestamps import in_seconds
from microvib.testdata.channels import is_unit, named_unit, yaml_quoted
from microvib.testdata.recording import Recording, RecordingError

MIN_ROWS = 8
MAX_HEADER_LINES = 500  # lines that may stand above the numbers
_FORMS = (("\t", "."), (";", "."), (",", "."), (None, "."), ("\t", ","), (";", ","), (None, ","))
"""Separators (None: blanks) and decimal marks, in the order in which they are tried."""
_NUMBER = re.compile(
    r"\s*\"?\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*\"?\s*|\s*\"?[+-]?(nan|inf|infinity)\"?\s*",
    re.IGNORECASE,
)
_HERTZ = r"([kM]?)(?:Hz|S/s|Sa/s)"
_RATE = re.compile(
    rf"\W*(?:sampl\w*|abtast\w*)[ _-]*(?:rate|freq\w*|frequenz)\W*(?:(?:in\s+)?{_HERTZ}\W+)?"
    rf"(\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)\W*(?:{_HERTZ})?\W*",
    re.IGNORECASE,
)
_SAID = re.compile(
    r"\W*([A-Za-z_]\w*(?:[ /-]\w+){0,5}) ?(?:[\[(]([^\])]{0,20})[\])])?[:=;,\t]"
    r"([+-]?[\d.,]+(?:[eE][+-]?\d+)?) ?([^;,\t]{0,30}?)\W*"
)
"""A line on top such as ``Sampling interval [ms]: 0.25``: name, unit, number, unit."""
_SAID_WITH_BLANK = re.compile(
    r"\W*([A-Za-z_]\w*(?:[ /-][A-Za-z]\w*){0,5}) ()([+-]?[\d.,]+(?:[eE][+-]?\d+)?) ?([^;,\t]{0,30}?)\W*"
)
"""One that only a blank parts, such as ``Amplifier gain 10``, of factors alone."""
_THOUSANDS = re.compile(r"\d{1,3}([.,])\d{3}")


@dataclass(frozen=True)
class _Form:
    separator: str | None
    decimal: str

    def split(self, line: str) -> list[str]:
        """Fields of a line; the empty one after a separator at its end does not count."""
        if self.separator is None:
            return line.split()
        if '"' in line:
            fields = next(csv.reader([line], delimiter=self.separator))
        else:
            fields = line.split(self.separator)
        if len(fields) > 1 and not fields[-1].strip():
            return fields[:-1]
        return fields

    def numbers(self, line: str) -> int:
        """How many numbers the line has; 0 where it has anything else."""
        fields = self.split(line)
        other = "," if self.decimal == "." else "."
        if all(_NUMBER.fullmatch(x) and other not in x for x in fields):
            return len(fields)
        return 0


@dataclass(frozen=True)
class _Layout:
    """Where the numbers of a text file are."""

    form: _Form
    first: int  # line of the first row
    width: int  # numbers in a row


@dataclass(frozen=True)
class _Header:
    """Names and units of the columns."""

    names: list[str]
    units: list[str]
    is_in_file: bool = True
    in_brackets: tuple[str, ...] = ()
    """Units in the brackets of the names, above a row of units."""


def read_delimited(path: Path, hints: Hints) -> Recording:
    """Recording of a text file; RecordingError says which row or column is wrong, or what the
    preparation must add.
    """
    text = read_text_of(path)
    lines = [line for line in text.splitlines() if line.strip()]
    lines, layout, notes = _find_layout(lines, hints)
    form = layout.form
    top = [line.lstrip("#%").strip(" ") for line in lines[: layout.first]]
    body = [
        line.rstrip(form.separator) for line in lines[layout.first :] if not line.startswith("#")
    ]
    header = _header(top, form, layout.width)
    data = _values(body, form, layout.width, header.names)
    if not text.endswith(("\n", "\r")):
        data, note = _without_cut_row(data, body, form)
        notes.append(note)
    decimal = form.decimal if any(form.decimal in line for line in body) else ""
    columns = _columns(header, data, top, decimal)
    is_sampling_known = columns[0].rates or hints.time is not None or hints.sample_rate is not None
    if not (header.is_in_file or is_sampling_known):
        raise _unnamed_columns(header.names)
    return recording_of(columns, hints, notes)


def _without_cut_row(data: np.ndarray, body: list[str], form: _Form) -> tuple[np.ndarray, str]:
    """The numbers without a last row that no end of line follows and that may be cut off, and a note."""
    if _last_number_truncated([form.split(line)[-1] for line in body[-2000:]]):
        return data[:-1], "the last row has no end of line and may be cut off: it was left out"
    return data, "the last row has no end of line"


def _columns(header: _Header, data: np.ndarray, top: Sequence[str], decimal: str) -> list[Column]:
    """The columns of the numbers, with what the lines on top say of them."""
    said = _header_values(top, decimal)
    rates = _rates(top, decimal) or stated_rates(said)
    above = top[:-1] if header.is_in_file else top
    in_brackets = header.in_brackets or [""] * len(header.names)
    return [
        Column(
            name,
            values,
            unit,
            rates,
            scales=said,
            units={"in its header": own} if own else {},
            remarks=tuple(above),
        )
        for name, values, unit, own in zip(
            header.names, data.T, header.units, in_brackets, strict=True
        )
    ]


def _unnamed_columns(names: list[str]) -> RecordingError:
    return RecordingError(
        f"has no header; its columns are called {names[0]} to {names[-1]}; add to the"
        " preparation file what"
        f" they are, such as time: {names[0]}, units: {{{yaml_quoted(names[0])}: s,"
        f" {yaml_quoted(names[-1])}: N*m}}, channels: {{Mz:"
        f" {yaml_quoted(names[-1])}}}; without a time axis, sample_rate: 4096 Hz",
        remedy="prepare",
    )


def read_text_of(path: Path) -> str:
    """Text of a file in UTF-8, UTF-16 with its mark, or as older test software writes it;
    RecordingError where it is no text.
    """
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16")
    if b"\0" in data[:4096]:
        raise RecordingError("is not text")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")  # as older test software writes its units


def _find_layout(lines: list[str], hints: Hints) -> tuple[list[str], _Layout, list[str]]:
    """Lines and their ``_layout``, with seconds in place of dates and times, and notes."""
    try:
        return lines, _layout(lines), []
    except RecordingError:
        stamped = in_seconds(lines, MIN_ROWS, MAX_HEADER_LINES, hints.time)
        if stamped is None:
            raise
    lines, start = stamped
    return lines, _layout(lines), [f"time is counted from '{start}'"]


def _layout(lines: Sequence[str]) -> _Layout:
    """Where rows of equal length come.

    Of several forms the first that has as many numbers as the header has names: a comma may part
    numbers or be their decimal mark.
    """
    fitting = list(_matching_form(lines))
    for layout in fitting:
        above = lines[layout.first - 1 : layout.first]
        if above and len(layout.form.split(above[0])) == layout.width:
            return layout
    if fitting:
        return fitting[0]
    raise RecordingError(
        f"has no {MIN_ROWS} consecutive rows of numbers in its first {MAX_HEADER_LINES}"
        " lines; expected are rows of"
        " equal length without empty cells, separated by commas, semicolons, tabs or blanks; times"
        " are numbers, or such as"
        " 2024-03-05T10:15:30.000244"
    )


def _matching_form(lines: Sequence[str]) -> Iterator[_Layout]:
    """Every form in which rows of equal length come, and where."""
    for separator, decimal in _FORMS:
        form = _Form(separator, decimal)
        counts = [form.numbers(line) for line in lines[: MAX_HEADER_LINES + MIN_ROWS]]
        for first in range(max(len(counts) - MIN_ROWS + 1, 0)):
            if counts[first] and len(set(counts[first : first + MIN_ROWS])) == 1:
                yield _Layout(form, first, counts[first])
                break


def _header(top: Sequence[str], form: _Form, width: int) -> _Header:
    """Names and units of the columns: those in the last line on top, or in the last two."""
    rows = _header_cells(top, form, width)
    if not rows or len(rows[-1]) > width or not any(rows[-1]):
        return _without_header(width)
    last = rows[-1] + [""] * (width - len(rows[-1]))
    if len(rows) == 2 and len(rows[0]) in (width, width - 1) and all(map(_may_be_unit, last)):
        names = rows[0] + [""] * (width - len(rows[0]))
        return _header_of_units_below(names, last)
    if len(rows[-1]) < width or any(cell and form.numbers(cell) for cell in last):
        return _without_header(width)
    return _header_of_units_below(last, [""] * width)


def _header_cells(top: Sequence[str], form: _Form, width: int) -> list[list[str]]:
    """Cells of the last two lines on top."""
    rows = [
        [unescape_formula(cell.strip().strip('"').strip()) for cell in form.split(line)]
        for line in top[-2:]
    ]
    if form.separator is None:  # blanks separate names from units, too
        return [row for row in rows if len(row) == width]
    return rows


def _may_be_unit(cell: str) -> bool:
    return cell in ("", "-", "1") or is_unit(cell)


def _without_header(width: int) -> _Header:
    return _Header([_nth_column(k) for k in range(width)], [""] * width, is_in_file=False)


def _header_of_units_below(names: list[str], units: list[str]) -> _Header:
    """Names that may hold a unit, and a row of units, which counts first."""
    named = [named_unit(name) for name in names]
    below = ["" if unit in ("-", "1") else unit.strip(" []()") for unit in units]
    return _Header(
        [name or _nth_column(k) for k, (name, _) in enumerate(named)],
        [unit or own for unit, (_, own) in zip(below, named, strict=True)],
        in_brackets=tuple(own for _, own in named),
    )


def _nth_column(k: int) -> str:
    return f"column {k + 1}"


def _values(body: list[str], form: _Form, width: int, names: Sequence[str]) -> np.ndarray:
    """The numbers, (rows, columns); RecordingError names the first row that is cut off or has
    anything else.
    """
    clean = [line.replace('"', "") for line in body]
    if form.decimal == ",":
        clean = [line.replace(",", ".") for line in clean]
    try:
        data = np.loadtxt(clean, delimiter=form.separator, comments=None, ndmin=2)
    except ValueError:
        data = np.empty((0, 0))
    if data.shape == (len(body), width):
        return data
    for k, line in enumerate(body):
        fields = form.split(line)
        if len(fields) != width:
            raise RecordingError(
                f"row {k + 1} of its numbers has {len(fields)} of {width} columns:"
                f" {line[:60]!r}{_row_length_reason(body[k:], form, width)}"
            )
        for name, field in zip(names, fields, strict=True):
            if not form.numbers(field):
                raise RecordingError(
                    f"row {k + 1} of its numbers, {name}: {field.strip()[:40]!r} is not a number"
                )
    raise RecordingError(f"has rows that are not {width} numbers")


def _row_length_reason(rows: list[str], form: _Form, width: int) -> str:
    """Why the first of the last rows has not as many columns as those before, where that shows."""
    fields = [form.split(row) for row in rows]
    if len(rows) == 1 and len(fields[0]) < width:
        return "; the file is truncated"
    if len(rows) > 1 and all(len(row) < width or not all(row) for row in fields):
        return "; save columns with another sample rate in a separate file"
    return ""


def _last_number_truncated(texts: Sequence[str]) -> bool:
    """Whether the last of these numbers, which no end of line follows, may have lost digits;
    RecordingError where it has.

    Numbers with the same count of decimals show it; with others, one that is shorter than all but a
    hundredth of them.
    """
    whole = [x.strip().strip('"').replace(",", ".") for x in texts]
    parts = [re.split("[eE]", x) for x in whole]
    decimals = [len(p[0].partition(".")[2]) for p in parts]
    digits = [len(re.sub(r"\D", "", p[0]).lstrip("0")) for p in parts]
    exponents = [len(p[1].lstrip("+-")) for p in parts[:-1] if len(p) > 1]
    fixed = len(set(decimals[:-1])) == 1 and decimals[0] > 0
    if fixed:
        cut = decimals[-1] != decimals[0]
    else:
        cut = digits[-1] < float(np.quantile(digits[:-1], 0.01))
    if len(parts[-1]) > 1:
        cut |= len(parts[-1][1].lstrip("+-")) < min(exponents, default=1)
    elif len(exponents) == len(parts) - 1:
        cut = True
    if cut:
        raise RecordingError(
            f"is truncated; its last number, {whole[-1]!r}, has fewer digits than the others and no"
            " end of line"
        )
    return not any(decimals)


def _header_values(top: Sequence[str], decimal: str) -> dict[str, str]:
    """Numbers that the lines on top give a name, each with its unit, where their mark is known to
    be the decimal one.
    """
    found = {}
    for line in top:
        if len(line) > LONGEST_REMARK:
            continue
        plain = re.sub(r" ?([:=;,\t]) ?", r"\1", re.sub(r'[ "]+', " ", line.strip()))
        said = _SAID.fullmatch(plain)
        if said is None:
            said = _SAID_WITH_BLANK.fullmatch(plain)
            if said is not None and not names_factor(said[1]):
                continue
        if said is None or (
            _THOUSANDS.fullmatch(said[3]) and said[3].lstrip("+-0123456789")[:1] != decimal
        ):
            continue
        found[said[1].strip()] = (
            f"{said[3].replace(',', '.')} {said[4].strip(' []()') or said[2] or ''}".strip()
        )
    return found


def _rates(top: Sequence[str], decimal: str) -> dict[str, float]:
    """Sample rates [Hz] that the lines on top say, such as ``Sample rate: 4096 Hz`` or ``Sampling
    rate [kHz]: 4.096``.

    Not one such as ``4,096`` where the numbers below do not show that its mark is the ``decimal``
    one: it may part thousands.
    """
    found = {}
    for line in top:
        said = _RATE.fullmatch(line.strip())
        grouped = said and _THOUSANDS.fullmatch(said[2])
        if said and not (grouped and grouped[1] != decimal):
            if said[3] is None:
                prefix = said[1] or ""
            else:
                prefix = said[3]
            times = {"": 1.0, "k": 1e3, "m": 1e6}[prefix.lower()]
            found[f"the line '{line.strip()[:40]}'"] = float(said[2].replace(",", ".")) * times
    return found
