"""Inputs of a sizing, from texts with units to a simulator: states, amplitude, rate,
description.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from microvib.errors import MicrovibError, OptionError, ScenarioError
from microvib.io.file_access import NO_FILES, FileAccess
from microvib.io.modal_sources import load_design, modal_source
from microvib.io.tables import dict_rows
from microvib.structures.modal import ModalModel
from microvib.structures.simulator_design import SimulatorDesign
from microvib.studies.sas import Sizing, TargetState, catalog_states, size, state_of_array
from microvib.units import quantity

_MODES_OF_ARRAY = 20
_MAX_STATES = 1000
_COLUMNS = {"mode_frequency_hz": "Hz", "inertia_kg_m2": "kg*m^2"}


@dataclass(frozen=True)
class SizingResult:
    """A sizing, with what it was made from."""

    sizing: Sizing
    rate: float
    """Rate of the drive at which it starts or stops [rad/s]."""
    array: ModalModel | None = None


def size_simulator(  # noqa: PLR0913 - keyword options
    *, inertia: str | None = None, frequency: str | None = None, array: str | None = None, states: Sequence[str] = (),
    file: Path | None = None, amplitude: str = "2 deg", rate: str = "0.06 deg/s", design: str = "reference-sas",
    files: FileAccess = NO_FILES,
) -> SizingResult:  # fmt: skip
    """A simulator for an inertia and a frequency, or for an array (a source of modes), set for
    further states: ``F:J`` each, or a table; without any those of the catalog. MicrovibError where
    these do not go together or are out of reach."""
    if (array is None) == (inertia is None and frequency is None) or (inertia is None) != (
        frequency is None
    ):
        raise MicrovibError(
            "what the simulator stands for is not clear; give both inertia and frequency, or"
            " instead of them an array"
        )
    if states and file is not None:
        raise OptionError("state", "cannot be combined with a table of states; give one of them")
    model = None
    if array is not None:
        model = modal_source(
            array, None if array.endswith(".csv") else _MODES_OF_ARRAY, files
        ).model
        target = state_of_array(model, array)
    else:
        J = _positive("inertia", str(inertia), "kg*m^2")
        target = TargetState("target", _positive("frequency", str(frequency), "Hz"), J)
    given = [parse_state(text, f"state {k}") for k, text in enumerate(states, 1)]
    further = given or (read_states(file) if file is not None else catalog_states())
    angle = math.radians(quantity("amplitude", amplitude, "deg", positive=True))
    turning = math.radians(quantity("rate", rate, "deg/s", positive=True))
    simulator = load_design(design, files)
    if not isinstance(simulator, SimulatorDesign):
        raise ScenarioError(
            f"{design}: describes an array; a simulator is expected, such as reference-sas"
        )
    return SizingResult(size(target, further, simulator, angle), turning, model)


def parse_state(text: str, name: str) -> TargetState:
    """A state from ``FREQUENCY:INERTIA``."""
    frequency, colon, inertia = text.partition(":")
    if not colon:
        raise OptionError(
            "state", f"'{text}' is not a state; write frequency and inertia, such as 1.19:8.18"
        )
    return TargetState(
        name, _positive("state", frequency, "Hz"), _positive("state", inertia, "kg*m^2")
    )


def read_states(path: Path) -> list[TargetState]:
    """States from a table with the columns ``mode_frequency_hz`` and ``inertia_kg_m2``, and
    ``state`` for their names.
    """
    rows = dict_rows(path, (*_COLUMNS, "state"), ScenarioError)
    if not 1 <= len(rows) <= _MAX_STATES or not rows[0].keys() >= _COLUMNS.keys():
        expected = f"the columns {' and '.join(_COLUMNS)} and 1 to {_MAX_STATES} rows"
        raise ScenarioError(f"{path}: is not a table of states; expected {expected}")
    states = []
    for k, row in enumerate(rows, 1):
        try:
            frequency, inertia = (
                _positive(name, row[name] or "", unit) for name, unit in _COLUMNS.items()
            )
        except OptionError as error:
            raise ScenarioError(f"{path}, row {k + 1}: {error}") from None
        states.append(TargetState(f"state {row.get('state') or k}", frequency, inertia))
    return states


def _positive(key: str, text: str, unit: str) -> float:
    """A positive number, here also without its unit."""
    with suppress(ValueError):
        text = f"{float(text)!r} {unit}"
    return quantity(key, text, unit, positive=True)
