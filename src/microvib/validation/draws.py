"""Claims of a published test over the range of what is assumed of it: draws, kept in a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import OutputError, SimulationError
from microvib.io.named import test_names
from microvib.io.tables import dict_rows, read_table, rows_csv
from microvib.io.writing import write_file
from microvib.solve.batch import torque_from_rest
from microvib.validation.assumptions import (
    Assumed,
    Calibrated,
    amplitudes,
    assumed_scenario,
    assumptions_of,
    calibrate,
    draw_assumptions,
    initial_calibration,
)
from microvib.validation.claims import Claim, claims_of, line_names, power_on_states
from microvib.validation.kept_figures import ANOTHER
from microvib.validation.published import PublishedTest

Rows = Sequence[Mapping[str, str]]
"""Rows of a table of draws; the central assumptions come first."""
_POWER_ON = {"record.settle": 0.0, "record.duration": 2.0}


@dataclass(frozen=True)
class DrawnStates:
    """The states of a test under one draw of the assumptions."""

    assumed: Assumed
    calibrated: Calibrated
    records: dict[int, np.ndarray]
    """Amplitudes of each state, (seeds, names + 1); under its number with a minus sign, a state
    from power-on, of which the largest torque alone is told.
    """

    @property
    def means(self) -> dict[int, np.ndarray]:
        """Means over the seeds."""
        return {number: rows.mean(axis=0) for number, rows in self.records.items()}

    def value(self, claim: Claim) -> float:
        """Value of a claim from the means over the seeds."""
        return claim.value(self.means)

    def single(self, claim: Claim) -> float:
        """Part of the single records, one in each state, in which it holds."""
        seeds = min(len(rows) for number, rows in self.records.items() if number > 0)
        each = (
            {n: rows[min(k, len(rows) - 1)] for n, rows in self.records.items()}
            for k in range(seeds)
        )
        return float(np.mean([claim.holds(claim.value(record)) for record in each]))


def drawn_states(
    test: PublishedTest, assumed: Assumed, found: Calibrated, seeds: int
) -> DrawnStates:
    """Run the states, each with so many draws of the noise, and those that are compared from
    power-on.
    """
    names = line_names(test)
    records = {
        number: amplitudes(assumed_scenario(test, number, assumed, found), names, seeds)
        for number in range(1, len(test.states) + 1)
    }
    for number in power_on_states(test):
        on = {**_POWER_ON, "record.rotor_offset": assumed.rotor_offset}
        scenario = assumed_scenario(test, number, assumed, found).with_si(on)
        peak = float(np.abs(torque_from_rest(scenario).T_d).max())
        records[-number] = np.array([[*[math.nan] * len(names), peak]])
    return DrawnStates(assumed, found, records)


def row_of(test: PublishedTest, number: int, seeds: int) -> dict[str, Any]:
    """Draw ``number`` as a row of the kept table: assumptions, calibrated values, and of each claim
    value, whether it holds on the means, and in which part of single records; without them where
    the first state cannot be calibrated.
    """
    assumed = draw_assumptions(test, number)
    row: dict[str, Any] = {"draw": number, "seeds": seeds, **asdict(assumed)}
    try:
        found = calibrate(test, assumed, seeds, initial_calibration(test))
        reached = drawn_states(test, assumed, found, seeds)
    except SimulationError as error:
        return row | {"refused": str(error)}
    row |= {"refused": "", **asdict(found)}
    for n in range(1, len(test.states) + 1):
        means = zip(line_names(test), reached.means[n], strict=False)
        row |= {f"state_{n}_{name}": float(x) for name, x in means}
    for k, claim in enumerate(claims_of(test)):
        value = reached.value(claim)
        row |= {
            f"value_{k}": value,
            f"holds_{k}": float(claim.holds(value)),
            f"single_{k}": reached.single(claim),
        }
    return row


def columns_of(test: PublishedTest) -> list[str]:
    """Columns of the table of draws of a test."""
    assumed = [f.name for f in fields(Assumed)]
    calibrated = [f.name for f in fields(Calibrated)]
    states = range(1, len(test.states) + 1)
    lines = [f"state_{n}_{name}" for n in states for name in line_names(test)]
    told = ("value", "holds", "single")
    claims = [f"{what}_{k}" for k in range(len(claims_of(test))) for what in told]
    return ["draw", "seeds", *assumed, "refused", *calibrated, *lines, *claims]


def extend_table(
    test: PublishedTest,
    path: Path,
    draws: int,
    seeds: int,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, str]]:
    """Rows of the table ``path``: the central assumptions and ``draws`` others; what it lacks is
    computed and added, row by row.

    ``progress`` is called with the rows that are there and those that there will be, before the
    first and after each.
    """
    assumptions_of(test)
    columns = columns_of(test)
    if path.is_file():
        rows = dict_rows(path, columns, OutputError, ignored=".*")
    else:
        rows = []
    if rows and list(rows[0]) != columns:
        raise OutputError(
            f"{path}: is not a table of draws of the test '{test.title}'; nothing was written; {ANOTHER}"
        )
    lacking = sorted(set(range(draws + 1)) - {int(row["draw"]) for row in rows})
    total = len(rows) + len(lacking)
    if progress:
        progress(len(rows), total)
    for number in lacking:
        made = row_of(test, number, seeds)
        rows.append({name: _cell(made.get(name, "")) for name in columns})
        rows.sort(key=lambda row: int(row["draw"]))
        cells = ([row[name] for name in columns] for row in rows)
        write_file(path, rows_csv(columns, cells), overwrite=True)
        if progress:
            progress(len(rows), total)
    return rows


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)


def kept_draws(name: str, test: PublishedTest) -> list[dict[str, str]]:
    """The table of draws beside the file of a test, of which ``microvib statements`` says how it is
    made; empty where there is none.
    """
    if name not in test_names():
        path = Path(name).with_suffix(".csv")
        if test.assumed is not None and path.is_file():
            return dict_rows(path, columns_of(test), ignored=".*")
        return []
    if (resources.files("microvib.catalog") / f"tests/{name}.csv").is_file():
        return read_table(f"tests/{name}")
    return []


def fraction_holding(rows: Rows, claim: int) -> tuple[float, float]:
    """Part of the draws, the central one apart, in which a claim holds on the means; and of their
    single records.
    """
    of = [row for row in rows if int(row["draw"]) > 0 and not row["refused"]]
    if not of:
        return math.nan, math.nan
    on_means, single = (
        float(np.mean([float(row[f"{what}_{claim}"]) for row in of]))
        for what in ("holds", "single")
    )
    return on_means, single
