"""Tables of two columns as CSV: densities of a noise over frequency or cycles per turn; a measured
loop of friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from microvib.errors import ScenarioError
from microvib.io.tables import csv_rows, parse_finite
from microvib.model.noise import MAX_ROWS
from microvib.testdata.channels import named_unit
from microvib.units import convert


def read_row_table(path: Path, *columns: tuple[str, str]) -> list[list[float]]:
    """Rows that a scenario keeps of a file, in the units of two ``columns`` (name and unit).

    A first line may name the columns, with units such as ``[mN^2*m^2/Hz]``. ScenarioError tells the
    row and column that is wrong.
    """
    return row_table(str(path), csv_rows(path, ScenarioError), *columns)


def row_table(
    path: str, cells: Sequence[list[str]], *columns: tuple[str, str]
) -> list[list[float]]:
    """As ``read_row_table``, of the cells of a table that is called ``path``."""
    names = [name for name, _ in columns]
    rows = [row for row in cells if row and not row[0].lstrip().startswith("#")]
    if rows and not rows[0][0].strip(" +-.")[:1].isdigit():
        head = rows.pop(0)
    else:
        head = []
    if not 0 < len(rows) <= MAX_ROWS:
        raise ScenarioError(
            f"{path}: has {len(rows)} rows of {' and '.join(names)}; 1 to {MAX_ROWS} are expected"
        )
    for k, row in enumerate([head or ["", ""], *rows]):
        if len(row) != 2:
            raise ScenarioError(
                f"{path}, row {k + bool(head)}: has {len(row)} columns; {','.join(names)} are"
                " expected"
            )
    factors = [
        _factor(f"{path}: column '{name}'", name, unit)
        for name, (_, unit) in zip(head, columns, strict=False)
    ]
    return [
        [
            factor * parse_finite(f"{path}, row {k}: {name}", cell, ScenarioError)
            for name, cell, factor in zip(names, row, factors or (1.0, 1.0), strict=True)
        ]
        for k, row in enumerate(rows, 1 + bool(head))
    ]


_ENDINGS = {
    "hz": "Hz", "khz": "kHz", "rad": "rad", "mrad": "mrad", "deg": "deg", "n_m": "N*m", "nm": "N*m", "mn_m": "mN*m", "mnm": "mN*m",
}  # fmt: skip
"""Units as the ends of names say them, such as that of ``frequency_khz``."""


def _factor(where: str, name: str, unit: str) -> float:
    """Factor from the unit that a column names to ``unit``; 1 where it names none."""
    given = named_unit(name)[1] or _ENDINGS.get(name.strip().lower().partition("_")[2], "")
    try:
        if given:
            return convert(f"1 {given}", unit)
        return 1.0
    except ValueError as error:
        raise ScenarioError(f"{where} {error}") from None
