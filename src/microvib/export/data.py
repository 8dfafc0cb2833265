"""Runs as data of test and analysis programs: UFF 58, MATLAB, CSV."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from pydantic import Field

from microvib.export.contents import (
    Densities,
    FrequencyResponses,
    Phasors,
    TimeHistories,
    densities,
    frequency_responses,
    phasors,
    time_histories,
)
from microvib.export.state_space import channel_table
from microvib.export.state_space_files import cells
from microvib.export.subject import Subject
from microvib.io.csv_cells import csv_text
from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import package_versions
from microvib.io.uff_writing import FUNCTIONS, Dataset58, Even, Place, write_datasets
from microvib.model.part import Part
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.solve.channels import LINE_OF_SIGHT

Content = Literal["time", "lines", "densities", "responses"]
CONTENTS: tuple[Content, ...] = get_args(Content)
MAT_FORMAT = "microvib run 1"
"""Name and version of the fields that are written."""
_INTERFACE, _SHAFT, _SECOND_INTERFACE, _INSTRUMENT = 1, 2, 3, 4
"""Nodes of datasets 58: the interface point; the drive's shaft; the second wing's interface point; the
point of the line of sight."""


class DataOptions(Part):
    """Parts of a run that are written."""

    contents: tuple[Content, ...] = Field(
        default=(),
        description=f"list of {', '.join(CONTENTS)}; without it all that there is",
    )


class CsvOptions(Part):
    """Part of a run that is written as a table."""

    contents: Content = Field(
        default="time", description=f"table that is written: {', '.join(CONTENTS)}"
    )


def _chosen(subject: Subject, wanted: Sequence[Content]) -> Iterator[Any]:
    """Contents that are wanted; of all those that there are."""
    makers: dict[str, Callable[[], Any]] = {
        "time": lambda: time_histories(subject.motion),
        "lines": lambda: phasors(subject.run),
        "densities": lambda: densities(subject.motion),
        "responses": lambda: frequency_responses(subject),
    }
    for name in CONTENTS:
        if wanted and name not in wanted:
            continue
        if not wanted and name == "responses" and subject.scenario.driver.pulsed:
            continue  # a pulse drive has none
        yield makers[name]()


def write_uff(subject: Subject, path: Path, options: Any) -> None:
    """Write binary datasets 58: time histories, lines as complex spectra, densities, responses."""
    sets: list[Dataset58] = []
    for part in _chosen(subject, options.contents):
        sets += _UFF[type(part)](part, subject.scenario)
    write_datasets(path, sets)


def _place(name: str, scenario: Scenario) -> Place:
    """Node and direction of a channel: loads and motions of an interface by their axis, the disturbance
    torque by the drive axis where that is one of the axes.
    """
    if name in LINE_OF_SIGHT:
        return Place(_INSTRUMENT, 0)
    if name in ("T_d", "T_d_force"):
        along = "xyz".index(scenario.array.drive_axis) + 4 if scenario.spacecraft is None else 0
        return Place(_INTERFACE, along)
    stem = name.removeprefix("base_").removeprefix("hub_").removeprefix("interface_")
    node = _SECOND_INTERFACE if stem.endswith("_2") else _INTERFACE
    component = stem.removesuffix("_2")
    if component in COMPONENTS:
        return Place(node, COMPONENTS.index(component) + 1)
    motions = ("ax", "ay", "az", "arx", "ary", "arz"), ("ux", "uy", "uz", "rx", "ry", "rz")
    for names in motions:
        if stem in names:
            return Place(_INTERFACE, names.index(stem) + 1)
    return Place(_SHAFT, 0)


def _time_sets(part: TimeHistories, scenario: Scenario) -> list[Dataset58]:
    at, title = Even(part.start, 1.0 / part.sample_rate), scenario.title
    return [
        Dataset58(c.name, FUNCTIONS["time"], x, at, c.unit, title, _place(c.name, scenario))
        for c, x in zip(part.channels, part.values, strict=True)
    ]


def _line_sets(part: Phasors, scenario: Scenario) -> list[Dataset58]:
    spectrum, f, title = FUNCTIONS["spectrum"], part.frequency, scenario.title
    return [
        Dataset58(f"{c.name} lines", spectrum, values, f, c.unit, title, _place(c.name, scenario))
        for c, values in zip(part.channels, part.known.T, strict=True)
    ]


def _density_sets(part: Densities, scenario: Scenario) -> list[Dataset58]:
    density, f, title = FUNCTIONS["density"], part.frequency, scenario.title
    return [
        Dataset58(
            f"{c.name} density", density, x, f, f"({c.unit})^2/Hz", title, _place(c.name, scenario)
        )
        for c, x in zip(part.channels, part.values, strict=True)
    ]


def _response_sets(part: FrequencyResponses, scenario: Scenario) -> list[Dataset58]:
    system, response = part.system, FUNCTIONS["response"]
    return [
        Dataset58(
            f"{seen.name} / {fed.name}", response, part.values[:, o, i], part.frequency, seen.unit,
            scenario.title, _place(seen.name, scenario), _place(fed.name, scenario), fed.unit,
        )
        for i, fed in enumerate(system.inputs)
        for o, seen in enumerate(system.outputs)
    ]  # fmt: skip


_UFF: dict[type, Any] = {
    TimeHistories: _time_sets,
    Phasors: _line_sets,
    Densities: _density_sets,
    FrequencyResponses: _response_sets,
}


def write_mat(subject: Subject, path: Path, options: Any) -> None:
    """Write a MATLAB file, version 5: channels of the record as variables, the rest as structs."""
    from scipy.io import savemat

    fields: dict[str, Any] = {}
    for part in _chosen(subject, options.contents):
        fields |= _MAT[type(part)](part)
    fields["about"] = {
        "format": MAT_FORMAT,
        "title": subject.scenario.title,
        "microvib_version": package_versions()["microvib"],
        "scenario": dump_scenario(subject.scenario),
    }
    savemat(path, fields, oned_as="column")


def _time_fields(part: TimeHistories) -> dict[str, Any]:
    units = {c.name: c.unit for c in part.channels}
    values = dict(zip((c.name for c in part.channels), part.values, strict=True))
    return {"fs": part.sample_rate, "t0": part.start, "units": units} | values


def _described(part: Phasors | Densities) -> dict[str, Any]:
    return {f"channel_{key}": cells(x) for key, x in channel_table(part.channels).items()}


def _line_fields(part: Phasors) -> dict[str, Any]:
    return {
        "lines": {
            "names": cells(part.names),
            "origins": cells(part.origins),
            "frequency": part.frequency,
            "phasor": part.values,
            "uncertainty": part.uncertainty,
            "of_clock": part.of_clock,
            **_described(part),
        }
    }


def _density_fields(part: Densities) -> dict[str, Any]:
    densities = {
        "frequency": part.frequency,
        "density": np.column_stack(part.values),
        "window": part.window,
    }
    return {"densities": densities | _described(part)}


def _response_fields(part: FrequencyResponses) -> dict[str, Any]:
    named = {
        f"{kind}_{key}": cells(x)
        for kind, channels in (("output", part.system.outputs), ("input", part.system.inputs))
        for key, x in channel_table(channels).items()
    }
    return {"responses": {"frequency": part.frequency, "response": part.values, **named}}


_MAT: dict[type, Any] = {
    TimeHistories: _time_fields,
    Phasors: _line_fields,
    Densities: _density_fields,
    FrequencyResponses: _response_fields,
}


def write_csv(subject: Subject, path: Path, options: Any) -> None:
    """Write one table: names of the columns, then their units, then rows of numbers with all their
    digits.
    """
    (part,) = _chosen(subject, (options.contents,))
    header, units, columns = _CSV[type(part)](part)
    units = ["-" if unit == "1" else unit for unit in units]  # a 1 would be a number
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(csv_text([header, units]))
        for row in zip(*columns, strict=True):
            stream.write(",".join(map(_cell, row)) + "\n")


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return csv_text([[value]]).rstrip("\n")
    return repr(float(value))


_Columns = tuple[list[str], list[str], list[Any]]
"""Names, units and values of columns."""


def _time_columns(part: TimeHistories) -> _Columns:
    t = part.start + np.arange(part.values[0].size) / part.sample_rate
    names, units = [c.name for c in part.channels], [c.unit for c in part.channels]
    return ["time", *names], ["s", *units], [t.tolist(), *(x.tolist() for x in part.values)]


def _complex_columns(names: Sequence[str], units: Sequence[str], values: np.ndarray) -> _Columns:
    """Real and imaginary parts, side by side."""
    both = [
        (f"{name}_{part}", unit)
        for name, unit in zip(names, units, strict=True)
        for part in ("re", "im")
    ]
    columns = [part.tolist() for x in values.T for part in (x.real, x.imag)]
    return [name for name, _ in both], [unit for _, unit in both], columns


def _line_columns(part: Phasors) -> _Columns:
    names, units, columns = _complex_columns(
        [c.name for c in part.channels], [c.unit for c in part.channels], part.values
    )
    before = [list(part.names), part.frequency.tolist()]
    return ["name", "frequency", *names], ["-", "Hz", *units], [*before, *columns]


def _density_columns(part: Densities) -> _Columns:
    names = [c.name for c in part.channels]
    units = [f"({c.unit})^2/Hz" for c in part.channels]
    columns = [part.frequency.tolist(), *(x.tolist() for x in part.values)]
    return ["frequency", *names], ["Hz", *units], columns


def _response_columns(part: FrequencyResponses) -> _Columns:
    pairs = [(o, i) for i in part.system.inputs for o in part.system.outputs]
    flat = part.values.transpose(0, 2, 1).reshape(part.frequency.size, -1)
    names, units, columns = _complex_columns(
        [f"{o.name} / {i.name}" for o, i in pairs],
        [f"({o.unit})/({i.unit})" for o, i in pairs],
        flat,
    )
    return ["frequency", *names], ["Hz", *units], [part.frequency.tolist(), *columns]


_CSV: dict[type, Any] = {
    TimeHistories: _time_columns,
    Phasors: _line_columns,
    Densities: _density_columns,
    FrequencyResponses: _response_columns,
}
