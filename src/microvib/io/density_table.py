"""Tables of densities of a noise as CSV: frequency, or cycles per turn, and one-sided power spectral density."""

from __future__ import annotations

import csv
from pathlib import Path

from microvib.errors import ScenarioError
from microvib.io.scenario_file import read_text
from microvib.io.tables import finite
from microvib.model.noise import MAX_ROWS
from microvib.testdata.channels import named_unit
from microvib.units import convert


def read_density_table(path: Path, *units: str) -> list[list[float]]:
    """The ``table`` of a noise as a file says it, rows of frequency and density in these ``units``; a row at 0 is left out.

    A first line may name the columns, with units such as ``[mN^2*m^2/Hz]``. ScenarioError tells the row and column that is wrong.
    """
    text = read_text(path, "table of densities", ()).removeprefix("\ufeff")
    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].lstrip().startswith("#")]
    head = rows.pop(0) if rows and not rows[0][0].strip(" +-.")[:1].isdigit() else []
    if not 0 < len(rows) <= MAX_ROWS:
        raise ScenarioError(f"{path}: has {len(rows)} rows of frequency and density; 1 to {MAX_ROWS} are expected")
    for k, row in enumerate([head or ["", ""], *rows]):
        if len(row) != 2:
            raise ScenarioError(f"{path}, row {k + bool(head)}: has {len(row)} columns; frequency,density are expected")
    factors = [_factor(f"{path}: column '{name}'", name, unit) for name, unit in zip(head, units, strict=False)] or [
        1.0,
        1.0,
    ]
    table = [
        [
            factor * finite(f"{path}, row {k}: {name}", cell, ScenarioError)
            for name, cell, factor in zip(("frequency", "density"), row, factors, strict=True)
        ]
        for k, row in enumerate(rows, 1 + bool(head))
    ]
    return [row for row in table if row[0] != 0.0]


def _factor(where: str, name: str, unit: str) -> float:
    """What the unit that a column names is in ``unit``; 1 where it names none."""
    given = named_unit(name)[1]
    try:
        return convert(f"1 {given}", unit) if given else 1.0
    except ValueError as error:
        raise ScenarioError(f"{where} {error}") from None
