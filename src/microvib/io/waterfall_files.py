"""Waterfalls of spectra over speed as test software exports them: CSV, MATLAB and UFF 58."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError, OptionError
from microvib.io.files import as_read_errors, check_file
from microvib.io.matlab import read_matlab
from microvib.io.tables import csv_rows, parse_finite
from microvib.io.uff import FrequencyFunction, read_functions

LARGEST = 500_000_000  # bytes
LAYOUTS = ("speeds-in-rows", "speeds-in-columns")
ENDINGS = (".csv", ".txt", ".mat", ".uff", ".unv", ".uf")
_SPECTRA = (2, 9, 12)
"""Functions of dataset 58 that are spectra over frequency: auto spectrum, density, spectrum."""
_SPEED = re.compile(r"(^|[^a-z])(speeds?|rpm|rps|omega|drehzahl|rad/s|rev/s|n)([^a-z]|$)")
_FREQUENCY = re.compile(r"(^|[^a-z])(freq\w*|hz|f)([^a-z]|$)")
_EVEN = 1e-3
"""Part of a step by which frequencies may be uneven, as decimals are cut off."""


@dataclass(frozen=True)
class SpectraOverSpeed:
    """A matrix of spectra over speed as it is in a file."""

    speed: np.ndarray
    """In the file's unit, ascending, (n,)."""
    frequency: np.ndarray
    """Evenly spaced [Hz], (m,)."""
    values: np.ndarray
    """In the file's unit, (n, m)."""
    unit: str = ""
    """Unit that the file says of its values; empty where it says none."""
    speed_unit: str = ""
    """Unit that it says of its speeds."""


def read_waterfall(
    path: Path, name: str | None = None, layout: str | None = None
) -> SpectraOverSpeed:
    """The matrix of a file, called ``name`` where it holds several.

    ``layout`` is one of LAYOUTS, for a CSV file whose first cell does not say where speeds stand, and a square
    matrix in MAT.
    MicrovibError where the file is no such matrix, OptionError where something must be stated.
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise MicrovibError(
            f"{path}: '{ending}' is not known; waterfalls are read from {', '.join(ENDINGS)}"
        )
    if ending in (".csv", ".txt"):
        if name is not None:
            raise MicrovibError(f"{path}: a CSV file is one matrix; leave ':{name}' out")
        found = _read_csv(path, layout)
    else:
        with as_read_errors(path, MicrovibError):
            check_file(path, LARGEST)
            if ending != ".mat":
                return _read_uff(path, name)
            found = _read_mat(path, name, layout)
    return _checked(path, *found)


def _read_csv(path: Path, layout: str | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows = [row for row in csv_rows(path, MicrovibError) if any(cell.strip() for cell in row)]
    if len(rows) < 2 or len(rows[0]) < 2:
        raise MicrovibError(
            f"{path}: is no waterfall: a row of frequencies and a column of speeds, or the other way round,"
            " are expected"
        )
    for k, row in enumerate(rows, 1):
        if len(row) != len(rows[0]):
            raise MicrovibError(
                f"{path}, row {k}: has {len(row)} cells and the first has {len(rows[0])}"
            )
    across = _numbers(path, 1, rows[0][1:])
    table = np.array([_numbers(path, k, row) for k, row in enumerate(rows[1:], 2)])
    down, values = table[:, 0], table[:, 1:]
    in_rows = _speeds_in_rows(rows[0][0]) if layout is None else layout == LAYOUTS[0]
    if in_rows is None:
        raise OptionError(
            "layout",
            f"{path}: its first cell, '{rows[0][0].strip()[:40]}', does not say whether rows are speeds or"
            f" frequencies; {LAYOUTS[0]} or {LAYOUTS[1]}",
        )
    if in_rows:
        return down, across, values
    return across, down, values.T


def _speeds_in_rows(corner: str) -> bool | None:
    """Whether a first cell such as *rpm \\ Hz* says that rows are speeds; None where it does not say."""
    text = corner.strip().lower()
    parts = [part for part in re.split(r"[\\|>;]|\s/\s|\bvs\b", text) if part.strip()]
    if len(parts) != 2:
        return None
    kinds = [(bool(_SPEED.search(part)), bool(_FREQUENCY.search(part))) for part in parts]
    return {((True, False), (False, True)): True, ((False, True), (True, False)): False}.get(
        (kinds[0], kinds[1])
    )


def _numbers(path: Path, k: int, cells: list[str]) -> np.ndarray:
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        return np.array([parse_finite(f"{path}, row {k}:", cell) for cell in cells])


def _read_mat(
    path: Path, name: str | None, layout: str | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    data = _flat(read_matlab(path))
    vectors = {key: x for key, x in data.items() if x.ndim == 1 and x.size > 1}
    matrices = {key: x for key, x in data.items() if x.ndim == 2}
    speed = _only(path, "speeds", "speed or rpm", vectors, _SPEED)
    frequency = _only(path, "frequencies", "frequency or f", vectors, _FREQUENCY)
    if name is not None and name not in matrices:
        raise MicrovibError(f"{path}: has no matrix '{name}'; it has {_list(matrices)}")
    if name is None:
        if len(matrices) != 1:
            raise MicrovibError(
                f"{path}: has {_list(matrices)} as matrices; name one, such as {path.name}:NAME"
            )
        name = next(iter(matrices))
    values = matrices[name]
    shape = (speed.size, frequency.size)
    if values.shape not in (shape, shape[::-1]):
        raise MicrovibError(
            f"{path}: '{name}' is {values.shape[0]} x {values.shape[1]}; {shape[0]} speeds and {shape[1]}"
            " frequencies are expected"
        )
    if shape[0] != shape[1]:
        in_rows = values.shape == shape
    elif layout is not None:
        in_rows = layout == LAYOUTS[0]
    else:
        raise MicrovibError(
            f"{path}: has as many speeds as frequencies; say which are the rows of '{name}' by layout,"
            f" {' or '.join(LAYOUTS)}"
        )
    return speed, frequency, values if in_rows else values.T


def _flat(data: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Arrays of numbers by name, magnitudes of complex ones, those of structs with a dot."""
    found: dict[str, np.ndarray] = {}
    for key, x in data.items():
        if isinstance(x, Mapping):
            found |= {f"{key}.{inner}": y for inner, y in _flat(x).items()}
        elif isinstance(x, np.ndarray) and x.dtype.kind in "fiuc":
            found[key] = (np.abs(x) if x.dtype.kind == "c" else x).astype(float)
    return found


def _only(
    path: Path, what: str, names: str, vectors: Mapping[str, np.ndarray], pattern: re.Pattern[str]
) -> np.ndarray:
    fitting = [key for key in vectors if pattern.search(key.lower().replace("_", " "))]
    if len(fitting) != 1:
        raise MicrovibError(
            f"{path}: one vector of {what}, called {names}, is expected; it has {_list(vectors)}"
        )
    return vectors[fitting[0]]


def _list(names: Mapping[str, Any]) -> str:
    return ", ".join(sorted(names)) or "none"


def _read_uff(path: Path, name: str | None) -> SpectraOverSpeed:
    sets = _of_one_place(path, read_functions(path, _SPECTRA), name)
    speeds = np.array([x.along_z for x in sets])
    if len(sets) > 1 and np.all(speeds == 0.0):
        raise MicrovibError(
            f"{path}: its spectra have no speed: each needs its own as the third axis (Z) of dataset 58"
        )
    values, times = np.unique(speeds, return_counts=True)
    if np.any(times > 1):
        raise MicrovibError(
            f"{path}: has {times.max()} spectra at the speed {values[np.argmax(times)]:g}; one at each speed is expected"
        )
    units = {(x.unit, x.z_unit) for x in sets}
    if len(units) > 1:
        raise MicrovibError(
            f"{path}: its spectra have several units: {', '.join(sorted(' over '.join(x) for x in units))}"
        )
    if any(not np.array_equal(x.frequency, sets[0].frequency) for x in sets):
        raise MicrovibError(f"{path}: its spectra are over different frequencies")
    matrix = _checked(path, speeds, sets[0].frequency, np.array([np.abs(x.values) for x in sets]))
    return replace(matrix, unit=sets[0].unit, speed_unit=sets[0].z_unit)


def _of_one_place(
    path: Path, sets: list[FrequencyFunction], name: str | None
) -> list[FrequencyFunction]:
    """Spectra of the place that is called ``name``, or of the only one."""
    places = sorted({x.place for x in sets})
    wanted = places if name is None else [name]
    if len(wanted) != 1 or wanted[0] not in places:
        example = f"{path.name}:{places[0] if places else 'NAME'}"
        raise MicrovibError(
            f"{path}: has spectra of {', '.join(places) or 'nothing'}; name one, such as {example}"
        )
    return [x for x in sets if x.place == wanted[0]]


def _checked(
    path: Path, speed: np.ndarray, frequency: np.ndarray, values: np.ndarray
) -> SpectraOverSpeed:
    """The matrix with ascending speeds and frequencies; MicrovibError where it has gaps."""
    if np.unique(speed).size < speed.size or np.any(speed <= 0.0):
        raise MicrovibError(f"{path}: speeds above 0, each once, are expected")
    order, along = np.argsort(speed), np.argsort(frequency)
    speed, frequency, values = speed[order], frequency[along], values[np.ix_(order, along)]
    if speed.size < 8 or frequency.size < 64:
        raise MicrovibError(
            f"{path}: has {speed.size} speeds and {frequency.size} frequencies; at least 8 and 64 are needed"
        )
    steps = np.diff(frequency)
    if np.any(
        np.abs(steps - steps.mean()) > _EVEN * frequency[-1] / frequency.size + 0.02 * steps.mean()
    ):
        raise MicrovibError(
            f"{path}: its frequencies are not evenly spaced; spectra of constant resolution are expected"
        )
    if not np.all(np.isfinite(values)) or np.any(values < 0.0):
        raise MicrovibError(f"{path}: amplitudes and densities are finite and not below 0")
    return SpectraOverSpeed(speed, frequency, values)
