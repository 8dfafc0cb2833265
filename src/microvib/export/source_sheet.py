"""Data sheet of a source of micro-vibration: blocked loads at its lines, with uncertainty, and apparent
mass, in one HDF5 file (docs/reference/source-sheet.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from pydantic import Field

from microvib.analysis.run import RunResult, run_scenario
from microvib.errors import MicrovibError, expect_path
from microvib.export.contents import Phasors, phasors
from microvib.export.source import ARRAY_AXES, source_at_interface
from microvib.export.subject import Subject
from microvib.io.file_access import WORKING_FOLDER
from microvib.io.files import as_read_errors, check_file
from microvib.io.hdf5 import Dataset, Group, open_hdf5
from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import package_versions
from microvib.model.coupling import (
    CoupledResponse,
    Source,
    couple_source_to_hub,
    receiver_of,
    resonance_frequency_grid,
    rotation_to_hub_axes,
)
from microvib.model.part import Part
from microvib.model.record import PASSBAND
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.line_table import LineTable

FORMAT, VERSION = "microvib source sheet", 1
_LOWEST = 0.1
"""Lowest frequency [Hz] of the apparent mass."""
_SYMMETRIC, _AGREES = 1e-9, 1e-8
"""Differences over the largest up to which an apparent mass is symmetric, and is that of its matrices."""
LOAD_UNITS = "N, N, N, N*m, N*m, N*m"
MASS_UNITS = "kg, kg*m, kg*m^2"
SIGNS = (
    "Blocked loads act on the spacecraft at the interface point. x(t) = Re(X exp(2 pi j f t)), 0-to-peak, with t = 0"
    " at the first sample of the record. Coupled to a hub of apparent mass AM_hub: (AM_hub + AM) a = F_b,"
    " load on the hub F = F_b - AM a."
)
POINT = "the interface point: that of array.rigid_body and interface_participation of the scenario"
VALIDITY = (
    "Blocked loads are those of a run on a fixed base: the interface's motion does not act back on the drive's"
    " detent torque, steps and friction but through the linear apparent mass. A detent torque turns motion at one"
    " line into torque a full-step frequency beside it, which is left out of small full-step lines. Lines that"
    " are not of the clock ring at other frequencies on a spacecraft and are not to be coupled. Uncertainty by"
    " integration and by the ranges of parameters is"
    " given; that of the model is not."
)


class SourceSheetError(MicrovibError):
    """A source sheet that cannot be read, or contradicts itself."""


class SourceSheetOptions(Part):
    """Extent of a source sheet."""

    frequencies: int = Field(
        default=300,
        ge=10,
        le=100_000,
        description="frequencies of the apparent mass, besides those of lines and resonances",
    )


@dataclass(frozen=True)
class SourceSheet:
    """Blocked loads and apparent mass of a drive with its array, about the interface point."""

    title: str
    drive_axis: str
    """Drive axis in the axes of the sheet: x, y or z."""
    clock: float
    """Driving frequency [Hz]; nan where the rate is zero or changes."""
    rate: float
    """Commanded rate [rad/s]; nan where it changes."""
    band: tuple[float, float]
    """Frequencies [Hz] between which the sheet is valid."""
    names: tuple[str, ...]
    origins: tuple[str, ...]
    of_clock: np.ndarray
    """Whether each line is forced by the clock, (k,); the others ring."""
    frequency: np.ndarray
    """Frequencies of the lines [Hz], (k,)."""
    loads: np.ndarray
    """Blocked loads, complex (k, 6) [N, N m]; 0 where a line was not found."""
    by_integration: np.ndarray
    """Uncertainty of their size by the integration in time, (k, 6); nan where it is not known."""
    by_parameters: np.ndarray
    """And by the ranges that the scenario's sources note, (k, 6); nan where none are."""
    mass_frequency: np.ndarray
    """Frequencies of the apparent mass [Hz], (m,)."""
    powered: np.ndarray
    """Apparent mass with the drive powered, complex (m, 6, 6)."""
    locked: np.ndarray
    """With its hinge locked, complex (m, 6, 6)."""
    source: Source
    """Matrices behind ``powered``, from which it follows at any frequency."""
    own_names: tuple[str, ...]
    """Coordinates of these matrices."""
    scenario: str
    """The scenario, as YAML."""
    made_by: str

    def __repr__(self) -> str:
        return (
            f"SourceSheet of {self.title or 'a drive'}: {len(self.names)} lines,"
            f" {self.band[0]:g} to {self.band[1]:g} Hz, apparent mass at {self.mass_frequency.size} frequencies"
        )

    def on(self, scenario: GivenScenario) -> tuple[tuple[str, ...], CoupledResponse]:
        """Couple the lines of the clock to the hub of a scenario.

        Parameters
        ----------
        scenario : Scenario, str or path
            A scenario with a ``spacecraft``, at whose interface and array angle the source sits.

        Returns
        -------
        tuple
            Names of the lines (k,), and motion of the interface and loads on the hub at each.

        Raises
        ------
        MicrovibError
            Where the scenario has no spacecraft.
        """
        s = as_scenario(scenario)
        turn = rotation_to_hub_axes(s)
        f = self.frequency[self.of_clock]
        mass = turn @ self.source.apparent_mass(f) @ turn.T
        loads = self.loads[self.of_clock] @ turn.T
        names = tuple(np.array(self.names)[self.of_clock].tolist())
        return names, couple_source_to_hub(f, loads, mass, receiver_of(s))


def source_sheet(subject: Subject, frequencies: int = 300) -> SourceSheet:
    """Make the sheet of a scenario or a run; a scenario on a craft is run on a fixed base.

    MicrovibError where the array has no mass properties in six components, or the drive no current loop.
    """
    scenario = subject.scenario.model_copy(update={"spacecraft": None})
    powered = source_at_interface(scenario, True)
    locked = source_at_interface(scenario, False)
    result = _on_fixed_base(subject, scenario)
    lines = phasors(result)
    names = [channel.name for channel in lines.channels]
    six = [names.index(name) for name in COMPONENTS]
    band = (_LOWEST, PASSBAND * scenario.record.sample_rate)
    f = _mass_frequencies(scenario, lines.frequency, band, frequencies)
    loads = lines.known[:, six]
    return SourceSheet(
        title=scenario.title,
        drive_axis=scenario.array.drive_axis,
        clock=_known(scenario.driving_frequency),
        rate=_known(scenario.rate),
        band=band,
        names=lines.names,
        origins=lines.origins,
        of_clock=lines.of_clock,
        frequency=lines.frequency,
        loads=loads,
        by_integration=np.abs(loads) * _relative_error(result),
        by_parameters=np.abs(loads) * _spread(lines, result.table)[:, None],
        mass_frequency=f,
        powered=powered.coupled.apparent_mass(f),
        locked=locked.coupled.apparent_mass(f),
        source=powered.coupled,
        own_names=powered.names,
        scenario=dump_scenario(scenario),
        made_by=f"microvib {package_versions()['microvib']}",
    )


def _known(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _on_fixed_base(subject: Subject, scenario: Scenario) -> RunResult:
    result = subject.result
    if result is not None and subject.scenario.spacecraft is None:
        return result
    return run_scenario(scenario)


def _mass_frequencies(
    scenario: Scenario, lines: np.ndarray, band: tuple[float, float], count: int
) -> np.ndarray:
    near = resonance_frequency_grid(scenario, np.linspace(-8.0, 8.0, 33))
    inside = np.concatenate([near, lines])
    inside = inside[(inside >= band[0]) & (inside <= band[1])]
    return np.unique(np.concatenate([np.geomspace(*band, count), inside]))


def _relative_error(result: RunResult) -> float:
    found = result.accuracy
    if found is None:
        return float("nan")
    return float(found.relative_error)


def _spread(lines: Phasors, table: LineTable) -> np.ndarray:
    """Spread of each line by ranges of parameters, over its amplitude in T_d, (k,)."""
    by_name = {line.name: line for line in table}
    return np.array(
        [
            by_name[name].spread / by_name[name].amplitude if name in by_name else np.nan
            for name in lines.names
        ]
    )


def write_source_sheet(subject: Subject, path: Path, options: Any) -> None:
    """Write the sheet of a scenario or a run."""
    write_sheet(source_sheet(subject, options.frequencies), path)


def write_sheet(sheet: SourceSheet, path: Path) -> None:
    """Write a sheet to an HDF5 file."""
    with h5py.File(path, "w") as f:
        f.attrs.update(
            {
                "format": FORMAT, "version": VERSION, "title": sheet.title, "made_by": sheet.made_by,
                "axes": ARRAY_AXES, "drive_axis": sheet.drive_axis, "point": POINT, "signs": SIGNS, "validity": VALIDITY,
                "clock_hz": sheet.clock, "rate_rad_per_s": sheet.rate,
                "lowest_hz": sheet.band[0], "highest_hz": sheet.band[1],
            }
        )  # fmt: skip
        for name, (values, unit) in _datasets(sheet).items():
            data = f.create_dataset(name, data=values)
            data.attrs["units"] = unit
        for name, texts in _texts(sheet).items():
            f.create_dataset(name, data=list(texts), dtype=h5py.string_dtype())


def _datasets(sheet: SourceSheet) -> dict[str, tuple[np.ndarray, str]]:
    """Datasets of numbers, each with its unit."""
    own = "SI by coordinates"
    return {
        "lines/frequency": (sheet.frequency, "Hz"),
        "lines/of_clock": (sheet.of_clock.astype(np.int8), "1"),
        "lines/load_re": (sheet.loads.real, LOAD_UNITS),
        "lines/load_im": (sheet.loads.imag, LOAD_UNITS),
        "lines/uncertainty_integration": (sheet.by_integration, LOAD_UNITS),
        "lines/uncertainty_parameters": (sheet.by_parameters, LOAD_UNITS),
        "apparent_mass/frequency": (sheet.mass_frequency, "Hz"),
        "apparent_mass/powered_re": (sheet.powered.real, MASS_UNITS),
        "apparent_mass/powered_im": (sheet.powered.imag, MASS_UNITS),
        "apparent_mass/locked_re": (sheet.locked.real, MASS_UNITS),
        "apparent_mass/locked_im": (sheet.locked.imag, MASS_UNITS),
        "matrices/mass": (sheet.source.mass, MASS_UNITS),
        "matrices/G": (sheet.source.G, own),
        "matrices/M": (sheet.source.M, own),
        "matrices/C": (sheet.source.C, own),
        "matrices/K": (sheet.source.K, own),
    }


def _texts(sheet: SourceSheet) -> dict[str, tuple[str, ...]]:
    return {
        "lines/name": sheet.names,
        "lines/origin": sheet.origins,
        "matrices/coordinate": sheet.own_names,
        "components": COMPONENTS,
        "scenario": (sheet.scenario,),
    }


def read_source_sheet(path: Path | str) -> SourceSheet:
    """Read a source sheet, checked.

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    SourceSheet
        Blocked loads and apparent mass.

    Raises
    ------
    SourceSheetError
        Where the file is no source sheet, is of a later version, lacks something, or contradicts
        itself: says what.
    """
    expect_path(path)
    file = WORKING_FOLDER.path(str(path))
    with as_read_errors(file, SourceSheetError):
        check_file(file)
        with open_hdf5(file) as root:
            sheet = _read(root)
        for problem in problems_of(sheet):
            raise SourceSheetError(problem)
    return sheet


class _Reader:
    """Datasets of a file by their paths."""

    def __init__(self, root: Group) -> None:
        self.root = root
        self._groups: dict[str, Any] = root.members()

    def dataset(self, name: str) -> Dataset:
        """A dataset; SourceSheetError where there is none."""
        group, _, last = name.rpartition("/")
        within = self._groups.get(group) if group else self.root
        if not isinstance(within, Group):
            raise SourceSheetError(f"{name} is missing; a source sheet has it")
        found = within.members().get(last)
        if not isinstance(found, Dataset):
            raise SourceSheetError(f"{name} is missing; a source sheet has it")
        return found

    def numbers(self, name: str, unit: str, shape: tuple[int | None, ...]) -> np.ndarray:
        """Numbers of a dataset, of a shape in which None is any length."""
        data = self.dataset(name)
        if data.attribute("units") != unit:
            raise SourceSheetError(
                f"{name}: its units are '{data.attribute('units')}'; {unit} is expected"
            )
        fits = len(data.shape) == len(shape) and all(
            wanted in (None, size) for wanted, size in zip(shape, data.shape, strict=True)
        )
        if not fits:
            wanted = " x ".join("n" if size is None else str(size) for size in shape)
            raise SourceSheetError(f"{name}: has the shape {data.shape}; {wanted} is expected")
        return np.asarray(data.numbers(whole=True), dtype=float)

    def text(self, name: str) -> str:
        """A text among the attributes of the file."""
        found = self.root.attribute(name)
        if not isinstance(found, str):
            raise SourceSheetError(f"attribute {name} is missing; a text is expected")
        return found

    def number(self, name: str) -> float:
        """A number among the attributes of the file."""
        found = self.root.attribute(name)
        if not isinstance(found, float):
            raise SourceSheetError(f"attribute {name} is missing; a number is expected")
        return found


def _read(root: Group) -> SourceSheet:
    read = _Reader(root)
    if root.attribute("format") != FORMAT:
        raise SourceSheetError(f"is no source sheet; its attribute format is not '{FORMAT}'")
    if read.number("version") != VERSION:
        raise SourceSheetError(
            f"has version {read.number('version'):g} of the format; {VERSION} is read"
        )
    if tuple(read.dataset("components").texts()) != COMPONENTS:
        raise SourceSheetError(f"components: are not {', '.join(COMPONENTS)}")
    names = tuple(read.dataset("lines/name").texts())
    k = len(names)
    f = read.numbers("apparent_mass/frequency", "Hz", (None,))
    own = tuple(read.dataset("matrices/coordinate").texts())
    n, m, unit = len(own), f.size, "SI by coordinates"

    def pair(name: str, units: str, shape: tuple[int, ...]) -> np.ndarray:
        real, imaginary = (read.numbers(f"{name}_{part}", units, shape) for part in ("re", "im"))
        return np.asarray(real + 1j * imaginary)

    try:
        source = Source(
            read.numbers("matrices/mass", MASS_UNITS, (6, 6)),
            *(read.numbers(f"matrices/{x}", unit, (6 if x == "G" else n, n)) for x in "GMCK"),
        )
    except SourceSheetError:
        raise
    except MicrovibError as error:
        raise SourceSheetError(f"matrices: {error}") from None
    return SourceSheet(
        title=read.text("title"),
        drive_axis=read.text("drive_axis"),
        clock=read.number("clock_hz"),
        rate=read.number("rate_rad_per_s"),
        band=(read.number("lowest_hz"), read.number("highest_hz")),
        names=names,
        origins=tuple(read.dataset("lines/origin").texts()),
        of_clock=read.numbers("lines/of_clock", "1", (k,)) != 0.0,
        frequency=read.numbers("lines/frequency", "Hz", (k,)),
        loads=pair("lines/load", LOAD_UNITS, (k, 6)),
        by_integration=read.numbers("lines/uncertainty_integration", LOAD_UNITS, (k, 6)),
        by_parameters=read.numbers("lines/uncertainty_parameters", LOAD_UNITS, (k, 6)),
        mass_frequency=f,
        powered=pair("apparent_mass/powered", MASS_UNITS, (m, 6, 6)),
        locked=pair("apparent_mass/locked", MASS_UNITS, (m, 6, 6)),
        source=source,
        own_names=own,
        scenario="".join(read.dataset("scenario").texts()),
        made_by=read.text("made_by"),
    )


def problems_of(sheet: SourceSheet) -> Iterator[str]:
    """Contradictions in a sheet, a sentence each."""
    if sheet.drive_axis not in ("x", "y", "z"):
        yield f"drive_axis: '{sheet.drive_axis}' is not allowed; x, y or z is expected"
    low, high = sheet.band
    if not 0.0 <= low < high:
        yield f"lowest_hz and highest_hz: {low:g} and {high:g} are no band"
    if len(sheet.origins) != len(sheet.names) or len(set(sheet.names)) != len(sheet.names):
        yield "lines: names and origins of the lines do not go together, or a name stands twice"
    for name, f in (("lines", sheet.frequency), ("apparent_mass", sheet.mass_frequency)):
        if not np.all(np.isfinite(f)) or np.any(f <= 0.0) or np.any(np.diff(f) < 0.0):
            yield f"{name}/frequency: positive frequencies in ascending order are expected"
            return
    if not np.all(np.isfinite(sheet.loads)):
        yield "lines/load: a number is missing; 0 stands for a line that was not found"
    for name, given in (("integration", sheet.by_integration), ("parameters", sheet.by_parameters)):
        if np.any(given < 0.0):
            yield f"lines/uncertainty_{name}: is negative; 0 at least, or nan where it is not known, is expected"
    yield from _mass_problems(sheet)


def _mass_problems(sheet: SourceSheet) -> Iterator[str]:
    for name, mass in (("powered", sheet.powered), ("locked", sheet.locked)):
        if not np.all(np.isfinite(mass)):
            yield f"apparent_mass/{name}: a number is missing"
            return
        scale = np.abs(mass).max(axis=(1, 2), keepdims=True)
        if np.any(np.abs(mass - mass.transpose(0, 2, 1)) > _SYMMETRIC * scale):
            yield f"apparent_mass/{name}: is not symmetric, as that of a passive structure is"
    for name in "MCK":
        matrix = getattr(sheet.source, name)
        if not np.allclose(matrix, matrix.T, rtol=_SYMMETRIC, atol=0.0):
            yield f"matrices/{name}: is not symmetric"
    found = sheet.source.apparent_mass(sheet.mass_frequency)
    scale = np.abs(found).max(axis=(1, 2), keepdims=True)
    if np.any(np.abs(found - sheet.powered) > _AGREES * scale):
        yield "apparent_mass/powered: is not what the matrices give"
