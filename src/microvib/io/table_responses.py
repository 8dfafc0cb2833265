"""Frequency responses of a force table from files: UFF 58, CSV and MATLAB; as CSV into them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.csv_cells import csv_text
from microvib.io.files import as_read_errors, check_file
from microvib.io.matlab import read_matlab
from microvib.io.tables import dict_rows, parse_finite
from microvib.io.uff import COHERENCE, FrequencyFunction, read_functions
from microvib.model.rigid import COMPONENTS
from microvib.testdata.channels import as_load
from microvib.testdata.recording import RecordingError
from microvib.testdata.table_response import TableResponse

LARGEST = 500_000_000
"""Bytes of the largest file of responses that is read."""
_PAIR = re.compile(r"([FM][xyz])(?:_per_([FM][xyz]))?")


def read_table_response(path: Path | str) -> TableResponse:
    """Read the frequency responses of a table, readings over loads, by the ending of the file.

    Parameters
    ----------
    path : str or path
        A UFF file with functions 4 (and 6, coherences), a CSV file with ``frequency_hz`` and columns
        such as ``Mz_real``, ``Mz_imag`` (or ``Mz_magnitude``, ``Mz_phase_deg``), ``Mz_coherence``,
        ``Mz_uncertainty``, or a MATLAB file with ``frequency`` and ``H``, (m, 6, 6), or a vector for each
        component.

    Returns
    -------
    TableResponse
        Responses, with uncertainties where the file has them.

    Raises
    ------
    RecordingError
        Where it cannot be read, or is none.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    with as_read_errors(path, RecordingError):
        if reader is None:
            raise RecordingError(
                f"'{path.suffix}' is not known; responses of a table are read from {', '.join(READERS)}"
            )
        check_file(path, LARGEST)
        return reader(path)


class _Made:
    """Responses as they are collected from a file, on its frequencies."""

    def __init__(self, name: str, frequency: np.ndarray) -> None:
        self.name, self.frequency = name, np.asarray(frequency, dtype=float)
        m = self.frequency.size
        self.H = np.full((m, 6, 6), np.nan, dtype=complex)
        self.spread = np.full((m, 6, 6), np.nan)
        self.coherence = np.full((m, 6), np.nan)

    def put(self, reading: str, load: str, values: np.ndarray) -> None:
        """Set one response; RecordingError where it is there already or not as long."""
        i, j = COMPONENTS.index(reading), COMPONENTS.index(load)
        if np.shape(values) != self.frequency.shape:
            raise RecordingError(
                f"{reading} over {load} has {np.size(values)} values and {self.frequency.size}"
                " frequencies"
            )
        if np.any(np.isfinite(self.H[:, i, j])):
            raise RecordingError(f"{reading} over {load} occurs twice")
        self.H[:, i, j] = values

    def made(self) -> TableResponse:
        """The response; RecordingError where there is none."""
        response = TableResponse(self.name, self.frequency, self.H, self.spread, self.coherence)
        if not response.known:
            raise RecordingError(
                f"has no reading over its own load; {', '.join(COMPONENTS)} are the names that are known"
            )
        return response


def _read_uff(path: Path) -> TableResponse:
    functions = read_functions(path)
    responses = [x for x in functions if x.function != COHERENCE]
    if not responses:
        raise RecordingError("has no frequency response function (function 4 of dataset 58)")
    f = responses[0].frequency
    made = _Made(path.name, f)
    for one in functions:
        if one.frequency.shape != f.shape or not np.allclose(one.frequency, f):
            raise RecordingError("its responses have different frequencies")
        reading, sign = _component(one.label, one.response)
        load, other = _component(one.label, one.reference, reading)
        if one.function == COHERENCE:
            if reading == load:
                made.coherence[:, COMPONENTS.index(reading)] = np.real(one.values)
        else:
            made.put(reading, load, sign * other * _scale(one, reading, load) * one.values)
    return made.made()


def _component(label: str, direction: int, otherwise: str = "") -> tuple[str, float]:
    """Component by its direction, with its sign; by the label without one."""
    if 1 <= abs(direction) <= 6:
        return COMPONENTS[abs(direction) - 1], 1.0 if direction > 0 else -1.0
    found = _PAIR.match(label.strip())
    if found is not None:
        return (found[2] if otherwise and found[2] else found[1]), 1.0
    if otherwise:
        return otherwise, 1.0
    raise RecordingError(
        f"response '{label}' has no direction, and no name such as Mz: which reading it is of is not known"
    )


def _scale(one: FrequencyFunction, reading: str, load: str) -> float:
    """Factor from a response's units to SI; RecordingError where it is none of a load."""
    factor = 1.0
    for unit, component, power in ((one.unit, reading, 1), (one.reference_unit, load, -1)):
        if not unit.strip():
            continue
        found = as_load(f"1 {unit}")
        wanted = "N" if component.startswith("F") else "N*m"
        if found is None or found[1] != wanted:
            raise RecordingError(
                f"response '{one.label}' has {unit} where {wanted} is expected; a reading of the table over"
                " its load is wanted, no accelerance"
            )
        factor *= found[0] ** power
    return factor


_FORMS = ("real", "imag", "magnitude", "phase_deg", "coherence", "uncertainty")


def _pairs() -> Iterator[tuple[str, str, str]]:
    """Names of responses in files, with reading and load."""
    for reading in COMPONENTS:
        yield reading, reading, reading
        for load in COMPONENTS:
            yield f"{reading}_per_{load}", reading, load


def _read_csv(path: Path) -> TableResponse:
    known = ["frequency_hz", *(f"{name}_{form}" for name, _, _ in _pairs() for form in _FORMS)]
    rows = dict_rows(
        path, known, RecordingError, what="responses of a table", needed=["frequency_hz"]
    )
    if not rows:
        raise RecordingError("has no row")
    columns = {
        key: np.array(
            [
                parse_finite(f"row {k}, {key}:", row[key], RecordingError)
                if row[key].strip()
                else np.nan
                for k, row in enumerate(rows, 2)
            ]
        )
        for key in rows[0]
        if key in known
    }
    made = _Made(path.name, columns["frequency_hz"])
    for name, reading, load in _pairs():
        values = _complex(columns, name)
        if values is None:
            continue
        made.put(reading, load, values)
        i, j = COMPONENTS.index(reading), COMPONENTS.index(load)
        if f"{name}_uncertainty" in columns:
            made.spread[:, i, j] = columns[f"{name}_uncertainty"]
        if reading == load and f"{name}_coherence" in columns:
            made.coherence[:, i] = columns[f"{name}_coherence"]
    return made.made()


def _complex(columns: Mapping[str, np.ndarray], name: str) -> np.ndarray | None:
    """Complex values of one response; None where its columns are not there."""
    if f"{name}_real" in columns and f"{name}_imag" in columns:
        return np.asarray(columns[f"{name}_real"] + 1j * columns[f"{name}_imag"])
    if f"{name}_magnitude" in columns:
        phase = columns.get(f"{name}_phase_deg")
        if phase is None:
            raise RecordingError(f"{name}_phase_deg is missing; a response has a phase")
        return np.asarray(columns[f"{name}_magnitude"] * np.exp(1j * np.deg2rad(phase)))
    if f"{name}_real" in columns or f"{name}_imag" in columns:
        raise RecordingError(f"{name}_real and {name}_imag belong together; one is missing")
    return None


def _read_mat(path: Path) -> TableResponse:
    data = read_matlab(path)
    f = _first_of(data, ("frequency", "frequency_hz", "f", "freq"))
    if f is None:
        raise RecordingError("has no variable frequency, in Hz")
    made = _Made(path.name, np.ravel(f))
    whole = _first_of(data, ("H", "frf", "FRF"))
    if whole is not None:
        _put_matrix(made, np.asarray(whole))
    for name, reading, load in _pairs():
        if isinstance(data.get(name), np.ndarray):
            made.put(reading, load, np.ravel(data[name]))
            spread, coherence = data.get(f"{name}_uncertainty"), data.get(f"{name}_coherence")
            i, j = COMPONENTS.index(reading), COMPONENTS.index(load)
            if isinstance(spread, np.ndarray):
                made.spread[:, i, j] = np.ravel(spread)
            if isinstance(coherence, np.ndarray) and reading == load:
                made.coherence[:, i] = np.ravel(coherence)
    return made.made()


def _first_of(data: Mapping[str, Any], names: tuple[str, ...]) -> np.ndarray | None:
    return next((data[name] for name in names if isinstance(data.get(name), np.ndarray)), None)


def _put_matrix(made: _Made, H: np.ndarray) -> None:
    """All 36 responses, (m, 6, 6) or (6, 6, m): readings along the first of the two axes of six."""
    m = made.frequency.size
    if H.shape == (6, 6, m) and m != 6:
        H = np.moveaxis(H, 2, 0)
    if H.shape != (m, 6, 6):
        raise RecordingError(f"H has the shape {H.shape}; ({m}, 6, 6) or (6, 6, {m}) is expected")
    made.H[:] = H


def table_response_csv(response: TableResponse) -> str:
    """The responses of components over their own loads as CSV text, as ``read_table_response`` takes it."""
    columns: dict[str, np.ndarray] = {"frequency_hz": response.frequency}
    for name in response.known:
        k, H = COMPONENTS.index(name), response.diagonal(name)
        columns |= {
            f"{name}_real": H.real,
            f"{name}_imag": H.imag,
            f"{name}_coherence": response.coherence[:, k],
            f"{name}_uncertainty": response.uncertainty[:, k, k],
        }
    rows = zip(*columns.values(), strict=True)
    cells = [[f"{x:.9g}" if np.isfinite(x) else "" for x in row] for row in rows]
    return csv_text([list(columns), *cells])


READERS: dict[str, Callable[[Path], TableResponse]] = {
    ".uff": _read_uff,
    ".unv": _read_uff,
    ".ufb": _read_uff,
    ".csv": _read_csv,
    ".mat": _read_mat,
}
"""Endings of files and what reads them."""
