"""Texts in cells of CSV files that a spreadsheet would take for formulas, and the way back.

A name such as ``=HYPERLINK(...)`` in somebody's file must not become a formula in the table of results. Such a text gets an
apostrophe in front, by which spreadsheets know text; numbers stay numbers.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

_FORMULAS = "=+-@\uff1d\uff0b\uff0d\uff20"
"""First characters of a formula, those of full width among them."""
_CONTROLS = "\t\r\n"
MARK = "'"


def guarded(text: str) -> str:
    """A text for a cell that no spreadsheet computes; numbers and single characters are as they were."""
    return MARK + text if _is_formula(text.lstrip(MARK)) and not _is_number(text) else text


def unguarded(text: str) -> str:
    """The text that ``guarded`` was given."""
    return text[1:] if text.startswith(MARK) and _is_formula(text.lstrip(MARK)) else text


def csv_text(rows: Iterable[Sequence[str]]) -> str:
    """CSV text of rows of texts."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([guarded(cell) for cell in row] for row in rows)
    return stream.getvalue()


def _is_formula(text: str) -> bool:
    return len(text) > 1 and (text[0] in _CONTROLS or text.lstrip()[:1] in tuple(_FORMULAS))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text and text == text.strip()
