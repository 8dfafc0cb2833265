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
from microvib.io.timestamps import in_seconds
from microvib.testdata.channels import is_unit, named_unit, yaml_quoted
from microvib.testdata.recording import Recording, RecordingError

FEWEST_ROWS = 8
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
LONGEST_SAID = 200  # characters of a line on top that may say a number
_SAID = re.compile(
    r"\W*([A-Za-z_]\w*(?:[ /-]\w+){0,5}) ?(?:[\[(]([^\])]{0,20})[\])])?[:=;,\t]"
    r"([+-]?[\d.,]+(?:[eE][+-]?\d+)?) ?([^;,\t]{0,30}?)\W*"
)
"""A line on top such as ``Sampling interval [ms]: 0.25``: name, unit, number, unit."""
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


def read_delimited(path: Path, hints: Hints) -> Recording:
    """Recording of a text file; RecordingError says which row or column is wrong, or what the
    preparation must add.
    """
    text = read_text_of(path)
    lines = [line for line in text.splitlines() if line.strip()]
    lines, (form, first, width), notes = _laid_out(lines, hints)
    top = [line.lstrip("#%").strip(" ") for line in lines[:first]]
    names, units, headed = _header(top, form, width)
    body = [line.rstrip(form.separator) for line in lines[first:] if not line.startswith("#")]
    if not text.endswith(("\n", "\r")):
        last = body[-1]
    else:
        last = None
    data = _values(body, form, width, names)
    if last is not None and _last_number_truncated([form.split(line)[-1] for line in body[-2000:]]):
        data = data[:-1]
        notes.append("the last row has no end of line and may be cut off: it was left out")
    elif last is not None:
        notes.append("the last row has no end of line")
    said = _header_values(top, form.decimal if any(form.decimal in line for line in body) else "")
    rates = _rates(
        top, form.decimal if any(form.decimal in line for line in body) else ""
    ) or stated_rates(said)
    columns = [
        Column(name, data[:, k], units[k], rates, scales=said) for k, name in enumerate(names)
    ]
    if not headed and hints.time is None and not rates and hints.sample_rate is None:
        raise RecordingError(
            f"has no header; its columns are called {names[0]} to {names[-1]}; add to the"
            " preparation file what"
            f" they are, such as time: {names[0]}, units: {{{yaml_quoted(names[0])}: s,"
            f" {yaml_quoted(names[-1])}: N*m}}, channels: {{Mz:"
            f" {yaml_quoted(names[-1])}}}; without a time axis, sample_rate: 4096 Hz",
            remedy="prepare",
        )
    return recording_of(columns, hints, notes)


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


def _laid_out(
    lines: list[str], hints: Hints
) -> tuple[list[str], tuple[_Form, int, int], list[str]]:
    """Lines and their ``_layout``, with seconds in place of dates and times, and notes."""
    try:
        return lines, _layout(lines), []
    except RecordingError:
        stamped = in_seconds(lines, FEWEST_ROWS, MAX_HEADER_LINES, hints.time)
        if stamped is None:
            raise
    lines, start = stamped
    return lines, _layout(lines), [f"time is counted from '{start}'"]


def _layout(lines: Sequence[str]) -> tuple[_Form, int, int]:
    """Form of the rows, the first of them, and how many numbers each has; from where rows of equal
    length come.

    Of several forms the first that has as many numbers as the header has names: a comma may part
    numbers or be their decimal mark.
    """
    fitting = list(_fitting(lines))
    for form, first, width in fitting:
        if first > 0 and len(form.split(lines[first - 1])) == width:
            return form, first, width
    if fitting:
        return fitting[0]
    raise RecordingError(
        f"has no {FEWEST_ROWS} rows of numbers below each other in its first {MAX_HEADER_LINES}"
        " lines; expected are rows of"
        " equal length without empty cells, separated by commas, semicolons, tabs or blanks; times"
        " are numbers, or such as"
        " 2024-03-05T10:15:30.000244"
    )


def _fitting(lines: Sequence[str]) -> Iterator[tuple[_Form, int, int]]:
    """Every form in which rows of equal length come, with the first of them and their length."""
    for separator, decimal in _FORMS:
        form = _Form(separator, decimal)
        counts = [form.numbers(line) for line in lines[: MAX_HEADER_LINES + FEWEST_ROWS]]
        for first in range(max(len(counts) - FEWEST_ROWS + 1, 0)):
            if counts[first] and len(set(counts[first : first + FEWEST_ROWS])) == 1:
                yield form, first, counts[first]
                break


def _header(top: Sequence[str], form: _Form, width: int) -> tuple[list[str], list[str], bool]:
    """Names and units of the columns, and whether the file names them."""
    none = [f"column {k + 1}" for k in range(width)]
    rows = [
        [unescape_formula(field.strip().strip('"').strip()) for field in form.split(line)]
        for line in top[-2:]
    ]
    if form.separator is None:  # blanks separate names from units, too
        rows = [row for row in rows if len(row) == width]
    padded = [row + [""] * (width - len(row)) for row in rows]
    if not rows or len(rows[-1]) > width or not any(rows[-1]):
        return none, [""] * width, False
    below = padded[-1]
    if (
        len(rows) == 2
        and len(rows[0]) in (width, width - 1)
        and all(not x or x in ("-", "1") or is_unit(x) for x in below)
    ):
        named = [named_unit(x) for x in padded[0]]
        units = [u.strip(" []()") if u not in ("-", "1") else "" for u in below]
        return (
            [n or none[k] for k, (n, _) in enumerate(named)],
            [u or v for u, (_, v) in zip(units, named, strict=True)],
            True,
        )
    if len(rows[-1]) != width or any(form.numbers(x) and x for x in below):
        return none, [""] * width, False
    found = [named_unit(x) for x in below]
    return [n or none[k] for k, (n, _) in enumerate(found)], [u for _, u in found], True


def _values(body: list[str], form: _Form, width: int, names: Sequence[str]) -> np.ndarray:
    """The numbers, (rows, columns); RecordingError names the first row that is cut off or has
    anything else.
    """
    clean = [
        line.replace('"', "").replace(",", ".") if form.decimal == "," else line.replace('"', "")
        for line in body
    ]
    try:
        data = np.loadtxt(clean, delimiter=form.separator, comments=None, ndmin=2)
    except ValueError:
        data = np.empty((0, 0))
    if data.shape == (len(body), width):
        return data
    for k, line in enumerate(body):
        fields = form.split(line)
        last = k == len(body) - 1
        if len(fields) != width:
            ended = not last and all(
                len(form.split(x)) < width or not all(form.split(x)) for x in body[k:]
            )
            if last and len(fields) < width:
                what = "; the file is truncated"
            else:
                what = ""
            if ended:
                what = "; columns that end here, as of another sample rate, go into a file of their own"
            else:
                what = what
            raise RecordingError(
                f"row {k + 1} of its numbers has {len(fields)} of {width} columns:"
                f" {line[:60]!r}{what}"
            )
        for name, field in zip(names, fields, strict=True):
            if not form.numbers(field):
                raise RecordingError(
                    f"row {k + 1} of its numbers, {name}: {field.strip()[:40]!r} is not a number"
                )
    raise RecordingError(f"has rows that are not {width} numbers")


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
        if len(line) > LONGEST_SAID:
            continue
        said = _SAID.fullmatch(
            re.sub(r" ?([:=;,\t]) ?", r"\1", re.sub(r'[ "]+', " ", line.strip()))
        )
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
