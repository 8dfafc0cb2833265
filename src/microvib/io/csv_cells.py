"""Texts in cells of CSV files that a spreadsheet would take for formulas, and the way back.

A name such as ``=HYPERLINK(...)`` in somebody's file must not become a formula in the table of
results. Such a text gets an apostrophe in front, by which spreadsheets know text; numbers stay
numbers. Where a spreadsheet's language parts cells at semicolons, a cell also begins after one
inside a text: there the apostrophe stands behind the semicolon.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence

_FORMULAS = "=+-@\uff1d\uff0b\uff0d\uff20"
"""First characters of a formula, those of full width among them."""
_CONTROLS = "\t\r\n"
ESCAPE_PREFIX = "'"
_INSIDE = re.compile(rf""";(?=['"\s]*[{re.escape(_FORMULAS)}]|['"]*[{_CONTROLS}])""")
"""A semicolon behind which a formula begins, whatever quotes and blanks stand between."""
_MARKED = re.compile(_INSIDE.pattern.replace(";", f";{ESCAPE_PREFIX}", 1))
"""Escaped formula as ``escape_formula`` writes it."""


def escape_formula(text: str) -> str:
    """A text for a cell that no spreadsheet computes; numbers and single characters are as they
    were.
    """
    begins = _is_formula(text.lstrip(ESCAPE_PREFIX)) and not _is_number(text)
    return (ESCAPE_PREFIX if begins else "") + _INSIDE.sub(f";{ESCAPE_PREFIX}", text)


def unescape_formula(text: str) -> str:
    """The text that ``escape_formula`` was given."""
    begins = text.startswith(ESCAPE_PREFIX) and _is_formula(text.lstrip(ESCAPE_PREFIX))
    return _MARKED.sub(";", text[1:] if begins else text)


def csv_text(rows: Iterable[Sequence[str]]) -> str:
    """CSV text of rows of texts."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(
        [escape_formula(cell) for cell in row] for row in rows
    )
    return stream.getvalue()


def _is_formula(text: str) -> bool:
    return len(text) > 1 and (text[0] in _CONTROLS or text.lstrip()[:1] in tuple(_FORMULAS))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text and text == text.strip()
