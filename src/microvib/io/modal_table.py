"""Tables of modes as CSV, one row a mode: what ``microvib modes`` writes and any scenario takes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from microvib.io.csv_cells import csv_text
from microvib.io.tables import dict_rows, parse_finite
from microvib.model.rigid import COMPONENTS
from microvib.structures.modal import ModalError, ModalModel

PARTICIPATIONS = tuple(f"participation_{d.lower()}" for d in COMPONENTS)
COUPLINGS = tuple(
    f"rigid_{a.lower()}_{b.lower()}" for k, a in enumerate(COMPONENTS) for b in COMPONENTS[k:]
)
"""Upper triangle of the rigid-body mass matrix; the same in each row, so that every row stands
alone.
"""
COLUMNS = (
    "mode", "frequency_hz", "damping", "effective_inertia_kg_m2", "effective_fraction", "cumulative_fraction",
    *PARTICIPATIONS, "drive_axis", "inertia_kg_m2", *COUPLINGS,
)  # fmt: skip
"""Columns of ``modes.csv``; SI units."""
MAX_MODES = 2000


def modes_csv(model: ModalModel) -> str:
    """CSV text of a modal model, its rigid-body mass included."""
    rows: list[Sequence[str]] = [COLUMNS]
    rigid = [f"{v:.12g}" for v in model.mass[np.triu_indices(6)]]
    effective, fraction = model.effective[model.axis], model.fraction[model.axis]
    for k, frequency in enumerate(model.frequency):
        values = (frequency, model.damping[k], effective[k], fraction[k], fraction[: k + 1].sum())
        rows.append(
            [f"{k + 1}", *(f"{v:.12g}" for v in (*values, *model.participation[:, k])), model.drive_axis,
             f"{model.inertia:.12g}", *rigid]
        )  # fmt: skip
    return csv_text(rows)


def read_modes(path: Path | str) -> ModalModel:
    """Modal model of a table; ModalError says which row and column is wrong.

    Needed are ``frequency_hz`` and either the six participations with the rigid-body mass, or about
    the drive axis alone ``effective_inertia_kg_m2`` (or ``participation``) and ``inertia_kg_m2``
    (or ``effective_fraction``). Damping is 1 % where the table gives none.
    """
    path = Path(path)
    rows = dict_rows(path, (*COLUMNS, "participation"), ModalError)
    if not rows or "frequency_hz" not in rows[0]:
        raise ModalError(
            f"{path}: is not a table of modes; a header with frequency_hz and a row for each mode"
            " is expected"
        )
    if len(rows) > MAX_MODES:
        raise ModalError(f"{path}: has {len(rows)} modes; at most {MAX_MODES} are read")
    frequency = _column(path, rows, "frequency_hz")
    if np.any(frequency <= 0.0):
        k = int(np.argmax(frequency <= 0.0))
        raise ModalError(
            f"{path}, row {k + 2}: frequency_hz is {frequency[k]:g}; it must be greater than 0 Hz"
        )
    if "damping" in rows[0]:
        xi = _column(path, rows, "damping")
    else:
        xi = np.full(len(rows), 0.01)
    axes = {
        (row.get("drive_axis") or rows[0].get("drive_axis") or "z").strip().lower() for row in rows
    }
    if len(axes) > 1:
        raise ModalError(
            f"{path}: drive_axis is {' and '.join(sorted(axes))}; one for the whole array is"
            " expected"
        )
    (axis,) = axes
    order = np.argsort(frequency, kind="stable")
    participation, mass = _masses(path, rows, axis)
    return ModalModel(frequency[order], xi[order], participation[:, order], mass, axis, str(path))


def _masses(path: Path, rows: list[dict[str, str]], axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Participation (6, s) and rigid-body mass (6, 6); about the drive axis alone where the table
    has no more.
    """
    mass = np.zeros((6, 6))
    if all(name in rows[0] for name in (*PARTICIPATIONS, *COUPLINGS)):
        upper = [_shared(path, rows, name) for name in COUPLINGS]
        mass[np.triu_indices(6)] = upper
        mass = mass + np.triu(mass, 1).T
        return np.array([_column(path, rows, name) for name in PARTICIPATIONS]), mass
    row = 3 + ("xyz".index(axis) if axis in ("x", "y", "z") else 2)
    participation = np.zeros((6, len(rows)))
    if "participation" in rows[0]:
        participation[row] = _column(path, rows, "participation")
    elif "effective_inertia_kg_m2" in rows[0]:
        effective = _column(path, rows, "effective_inertia_kg_m2")
        if np.any(effective < 0.0):
            raise ModalError(f"{path}: effective_inertia_kg_m2 must not be negative")
        participation[row] = np.sqrt(effective)
    else:
        raise ModalError(
            f"{path}: has neither effective_inertia_kg_m2 nor the six participations of the modes"
        )
    mass[row, row] = _inertia(path, rows, participation[row] ** 2)
    return participation, mass


def _inertia(path: Path, rows: list[dict[str, str]], effective: np.ndarray) -> float:
    if "inertia_kg_m2" in rows[0]:
        return _shared(path, rows, "inertia_kg_m2")
    if "effective_fraction" in rows[0]:
        fraction = _column(path, rows, "effective_fraction")
        k = int(np.argmax(effective))
        if fraction[k] > 0.0:
            return float(effective[k] / fraction[k])
    raise ModalError(
        f"{path}: does not give the inertia about the drive axis; a column inertia_kg_m2 is expected"
    )


def _shared(path: Path, rows: list[dict[str, str]], name: str) -> float:
    """A number of the whole array, which every row has or only the first."""
    given = [(k, row) for k, row in enumerate(rows, 2) if k == 2 or (row.get(name) or "").strip()]
    values = [
        (k, parse_finite(f"{path}, row {k}: {name}", row.get(name), ModalError)) for k, row in given
    ]
    first = values[0][1]
    other = next(((k, v) for k, v in values if abs(v - first) > 1e-6 * abs(first)), None)
    if other is not None:
        raise ModalError(
            f"{path}, row {other[0]}: {name} is {other[1]:g}, and {first:g} in row 2; one value for"
            " the whole array is expected"
        )
    return first


def _column(path: Path, rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array(
        [
            parse_finite(f"{path}, row {k}: {name}", row.get(name), ModalError)
            for k, row in enumerate(rows, 2)
        ]
    )
