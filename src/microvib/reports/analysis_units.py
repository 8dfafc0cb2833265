"""Tables of torques as those of other channels: of forces and accelerations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from microvib.results import TORQUE, TORQUE_LIMIT, TORQUE_UNCERTAINTY, Column, Measure, Table
from microvib.testdata.channels import ACCELERATIONS
from microvib.units import pretty

CHANNEL_KINDS = {"N": "a force", "N*m": "a torque"} | dict.fromkeys(
    ACCELERATIONS, "an acceleration"
)
"""Words for what a channel is, by its unit."""
ENDINGS = {"N": "n", "N*m": "n_m", "m/s^2": "m_s2", "g": "g"}
"""Endings of names of columns in files, by the unit."""


def table_in_unit(table: Table, unit: str) -> Table:
    """A table of torques as one of forces or accelerations, where the channel is one."""
    return replace(table, columns=columns_in_unit(table.columns, unit))


def columns_in_unit(columns: Iterable[Column], unit: str) -> tuple[Column, ...]:
    """Columns of torques as those of forces or accelerations."""
    return tuple(_column_in_unit(x, unit) for x in columns)


def _column_in_unit(column: Column, unit: str) -> Column:
    measure = column.measure
    if measure is None or measure not in (TORQUE, TORQUE_LIMIT, TORQUE_UNCERTAINTY):
        return column
    return replace(
        column, key=key_in_unit(column.key, unit), measure=measure_in_unit(measure, unit)
    )


def key_in_unit(key: str, unit: str) -> str:
    """The key of a column of torques, with the ending of another unit where it has that of a
    torque.
    """
    if key.endswith("_n_m"):
        return f"{key.removesuffix('_n_m')}_{ENDINGS[unit]}"
    return key


def measure_in_unit(torque: Measure, unit: str) -> Measure:
    """A measure of torques in thousandths of another unit of a channel."""
    return replace(torque, unit=f"m{pretty(unit)}")
