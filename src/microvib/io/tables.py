"""Texts of results: CSV and JSON, the versions behind them, and the paper's tables."""

from __future__ import annotations

import csv
import io
import json
import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from microvib.errors import MicrovibError


def rows_csv(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV text of rows under a header; figures with nine digits, what is not known left empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(x) for x in row] for row in rows)
    return stream.getvalue()


def columns_csv(columns: Mapping[str, Iterable[float]]) -> str:
    """CSV text of columns of equal length."""
    return rows_csv(list(columns), zip(*columns.values(), strict=True))


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.9g}"
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
        return float(data) if math.isfinite(data) else None
    return data


def finite(where: str, text: str | None, kind: type[MicrovibError] = MicrovibError) -> float:
    """The number that a cell of a table holds; an error of this ``kind`` where it is none, or not finite."""
    try:
        value = float(text or "")
    except ValueError:
        raise kind(f"{where} '{str(text)[:60]}' is not a number") from None
    if not math.isfinite(value):
        raise kind(f"{where} is {value}; a finite number is expected")
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


PAPER_LINES = {"natural": "array_mode_1", "driving": "drive_1", "driving_2": "drive_2", "driving_3": "drive_3"}
"""Our names of the lines of Tables 5 and 6."""


def read_table(name: str) -> Iterable[dict[str, str]]:
    """Rows of one of the paper's tables in the catalog, such as ``table6_line_amplitudes``."""
    from importlib import resources

    text = (resources.files("microvib.catalog") / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))
