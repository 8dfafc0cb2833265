"""Tables of lines in files: ``lines.csv`` of a run or of others, and the columns of the paper's Tables 5 and 6."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from microvib.errors import MicrovibError
from microvib.io.tables import PAPER_LINES, finite, read_table
from microvib.signals.line_table import Line, LineTable

_FIGURES = ("frequency_hz", "amplitude_n_m", "amplitude_uncertainty_n_m", "bin_frequency_hz", "bin_amplitude_n_m")
_UNKNOWN: dict[str, Any] = {field.name: "" if field.type == "str" else math.nan for field in fields(Line)}


@dataclass(frozen=True)
class PaperLines:
    """Nearest-bin figures of the paper's test or simulation in state 1."""

    column: Literal["test", "simulation"]
    table: LineTable


def is_line_table(path: Path) -> bool:
    """Whether a CSV file is a table of lines and not a recording."""
    try:
        with path.open("rb") as stream:
            return stream.readline(1000).removeprefix(b"\xef\xbb\xbf").split(b",")[0].strip() == b"line"
    except OSError:
        return False


def read_lines(path: Path) -> LineTable:
    """Frequencies and amplitudes of a table of lines by name, nan where they are empty; nothing else of the table is read.

    MicrovibError names the row where one is not a number, or not finite.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = enumerate(csv.DictReader(stream), 2)
            return _table([(row.get("line") or "", _figures(f"{path}, row {k}", row)) for k, row in rows])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or f"is not a table as text ({error})"
        raise MicrovibError(f"{path}: cannot be read: {reason}") from None


def paper_lines(column: Literal["test", "simulation"]) -> PaperLines:
    """A column of Tables 5 and 6."""
    hz = {row["line"]: float(row[f"{column}_hz"]) for row in read_table("table5_line_frequencies")}
    rows = [
        (PAPER_LINES[name], {"bin_frequency_hz": hz[name], "bin_amplitude_n_m": float(row[f"{column}_n_m"])})
        for row in read_table("table6_line_amplitudes")
        for name in [row["line"]]
    ]
    return PaperLines(column, _table(rows))


def _table(rows: list[tuple[str, dict[str, float]]]) -> LineTable:
    lines = tuple(Line(**{**_UNKNOWN, "line": name, **figures}) for name, figures in rows)
    return LineTable(lines, None, None, 0, math.nan)


def _figures(where: str, row: dict[str, str | None]) -> dict[str, float]:
    texts = {column: (row.get(column) or "").strip() for column in _FIGURES}
    return {column: finite(f"{where}: {column}", text) if text else math.nan for column, text in texts.items()}
