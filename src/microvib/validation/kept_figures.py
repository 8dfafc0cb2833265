"""Figures of a published test over draws of its assumptions, kept in a table beside its file."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from microvib.errors import (
    MicrovibError,
    OutputError,
    SimulationError,
    SynchronismLost,
    error_context,
)
from microvib.io.named import test_names
from microvib.io.tables import csv_rows, dict_rows, read_table, rows_csv
from microvib.io.writing import write_file
from microvib.validation.assumed_ranges import SEED, DescribedDrive
from microvib.validation.cases_file import COUNTS, CasesTest
from microvib.validation.comparisons import Figures
from microvib.validation.metrics import case_metrics, without_motion

Row = dict[str, str]
Progress = Callable[[int, int], None]
CENTRAL_TOLERANCE = 1e-3
"""Part by which the figures of the kept central draw may differ from those of today."""
WORDS = ("test", "failed")
"""Columns of words."""
ANOTHER = "choose another file, or the test that the table is of"
"""Remedy where a table of draws is none of the test's."""
LOSS_OF_SYNCHRONISM = "loss of synchronism"


@dataclass(frozen=True)
class KeptDraws:
    """Draws of a test's assumptions and the figures of its cases under them."""

    values: np.ndarray
    """Values of the assumptions in SI, (draws, assumptions)."""
    figures: tuple[Figures, ...]
    """Figures of each draw."""
    central: Figures
    """Figures under the central assumptions."""
    failed: tuple[str, ...] = ()
    """Cases without figures of each draw, and why; empty where all have some."""


def pairs_of(test: CasesTest) -> list[tuple[str, str]]:
    """Cases and metrics that the comparisons need."""
    return [(case, metric) for case, metrics in test.needs.items() for metric in metrics]


def digest_of(test: CasesTest) -> str:
    """Digest of all that draws of a test follow from, but files that it names."""
    names = {"scenario", "set", "assumed", "cases", "metrics"}
    data = test.model_dump(mode="json", include=names)
    for given in data["assumed"].values():
        del given["why"]
    text = json.dumps([SEED, data], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def columns_of(test: CasesTest) -> list[str]:
    """Columns of the table of draws of a test."""
    figures = (f"{case} | {metric}" for case, metric in pairs_of(test))
    return ["draw", "test", *test.assumed, "failed", *figures]


@dataclass(frozen=True)
class CaseFigures:
    """Figures of all cases, and cases that could not be simulated."""

    figures: dict[tuple[str, str], float]
    """By case and metric, in SI; nan where there is none."""
    failed: dict[str, str]
    """Reason of each case that could not be simulated, or lost synchronism."""


def figures_under(
    drive: DescribedDrive,
    values: dict[str, float],
    needs: dict[str, tuple[str, ...]],
    tell: Callable[[str], None] | None = None,
) -> CaseFigures:
    """Figures of the cases under values of the assumptions."""
    found: dict[tuple[str, str], float] = {}
    failed = {}
    for case, names in needs.items():
        if tell:
            tell(case)
        metrics = {name: drive.test.metrics[name] for name in names}
        with error_context(f"case '{case}'"):
            scenario = drive.scenario(case, values)
            try:
                made = case_metrics(scenario, metrics)
            except SimulationError as error:
                made = without_motion(metrics, error)
                failed[case] = reason_of(error)
        found |= {(case, name): figure for name, figure in made.items()}
    return CaseFigures(found, failed)


def reason_of(error: SimulationError) -> str:
    """Reason why a case has no figures, in a few words."""
    if isinstance(error, SynchronismLost):
        return LOSS_OF_SYNCHRONISM
    return str(error).partition(";")[0]


def extend_figures(
    drive: DescribedDrive, path: Path, draws: int, progress: Progress | None = None
) -> list[Row]:
    """Rows of the table ``path``: the central assumptions, draw 0, and ``draws`` others; what it
    lacks is computed and added, row by row.

    Raises OutputError where the table is of another test, or of another version of its file.
    """
    columns = columns_of(drive.test)
    rows: list[Row] = []
    if path.is_file():
        head = csv_rows(path, OutputError)[:1]
        rows = dict_rows(path, columns, OutputError, ignored=".*")
        problem = _problem(drive.test, head, rows)
        if problem:
            raise OutputError(f"{path}: {problem}; nothing was written; {ANOTHER}")
    each = [drive.central_values(), *drive.drawn_values(draws)]
    lacking = sorted(set(range(draws + 1)) - {int(row["draw"]) for row in rows})
    total = len(rows) + len(lacking)
    if progress:
        progress(len(rows), total)
    for number in lacking:
        with error_context(f"draw {number}"):
            found = figures_under(drive, each[number], drive.test.needs)
        rows.append(_row(drive.test, number, each[number], found))
        rows.sort(key=lambda row: int(row["draw"]))
        cells = ([row[name] for name in columns] for row in rows)
        write_file(path, rows_csv(columns, cells), overwrite=True)
        if progress:
            progress(len(rows), total)
    return rows


def _row(test: CasesTest, number: int, values: dict[str, float], found: CaseFigures) -> Row:
    row = {"draw": str(number), "test": digest_of(test)}
    row |= {name: f"{value:.6g}" for name, value in values.items()}
    row["failed"] = "; ".join(f"{case}: {reason}" for case, reason in found.failed.items())
    figures = found.figures.items()
    return row | {f"{case} | {metric}": f"{x:.6g}" for (case, metric), x in figures}


def _problem(test: CasesTest, head: Sequence[Sequence[str]], rows: list[Row]) -> str:
    """Reason why a table of draws, with so many first lines, cannot be used; empty where it can."""
    columns = columns_of(test)
    if any(list(line) != columns for line in head):
        return f"is not a table of draws of the test '{test.title}'"
    if any(row["test"] != digest_of(test) for row in rows):
        return "has draws of another version of the test's file"
    for k, row in enumerate(rows, 2):
        wrong = [name for name in columns if name not in WORDS and not _is_number(row[name])]
        if wrong:
            return f"row {k}, column '{wrong[0]}': is {row[wrong[0]]!r}, not a number"
    return ""


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def kept_table(name: str) -> str:
    """Name of the table of draws beside the file of a test, for messages."""
    if name in test_names():
        return f"{name}.csv"
    return str(Path(name).with_suffix(".csv"))


def kept_figures(name: str, test: CasesTest) -> KeptDraws | None:
    """The draws beside the file of a test; None where there are none.

    Raises MicrovibError where they are of another version of it.
    """
    if name in test_names():
        if not (resources.files("microvib.catalog") / f"tests/{name}.csv").is_file():
            return None
        rows = read_table(f"tests/{name}")
    else:
        path = Path(name).with_suffix(".csv")
        if not path.is_file():
            return None
        rows = dict_rows(path, columns_of(test), ignored=".*")
    problem = _problem(test, [list(row) for row in rows[:1]], rows)
    if problem:
        raise MicrovibError(
            f"{kept_table(name)}: {problem}; delete it, or make it anew with `microvib statements"
            f" {kept_table(name)} --test {name}`"
        )
    return draws_of(test, rows)


def draws_of(test: CasesTest, rows: list[Row]) -> KeptDraws | None:
    """Draws of the rows of a table; None without the central one."""
    by_number = {int(row["draw"]): row for row in rows}
    if 0 not in by_number:
        return None
    others = [by_number[k] for k in sorted(by_number) if k > 0]
    values = [[float(row[name]) for name in test.assumed] for row in others]
    return KeptDraws(
        np.array(values).reshape(len(others), len(test.assumed)),
        tuple(_figures(test, row) for row in others),
        _figures(test, by_number[0]),
        tuple(row["failed"] for row in others),
    )


def _figures(test: CasesTest, row: Row) -> Figures:
    return {(case, metric): float(row[f"{case} | {metric}"]) for case, metric in pairs_of(test)}


def differs(test: CasesTest, kept: Figures, today: Figures) -> list[tuple[str, str]]:
    """Cases and metrics whose kept figures are not those of today; counts of steps, which may hang
    on the last digit, only where there are none in one of them.
    """
    largest: dict[str, float] = {}
    for (_, metric), figure in today.items():
        if math.isfinite(figure):
            largest[metric] = max(largest.get(metric, 0.0), abs(figure))
    off = []
    for (case, metric), figure in kept.items():
        if test.metrics[metric].what in COUNTS:
            same = _is_count(figure) == _is_count(today[case, metric])
        else:
            tolerance = CENTRAL_TOLERANCE * largest.get(metric, 0.0)
            same = _same(figure, today[case, metric], tolerance)
        if not same:
            off.append((case, metric))
    return off


def _is_count(figure: float) -> bool:
    """Whether a figure counts something: 0 lost steps, or no first one, do not."""
    return figure > 0.0 and math.isfinite(figure)


def _same(first: float, second: float, tolerance: float) -> bool:
    if math.isfinite(first) and math.isfinite(second):
        return abs(first - second) <= tolerance
    return str(first) == str(second)
