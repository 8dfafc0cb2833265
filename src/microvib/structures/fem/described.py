"""One door to the finite elements of whatever is described: an array or a simulator."""

from __future__ import annotations

from functools import lru_cache
from types import ModuleType

from microvib.structures.array_design import ArrayDesign
from microvib.structures.fem import array_mesh, simulator_mesh
from microvib.structures.fem.modes import Modes, solve
from microvib.structures.modal import ModalModel
from microvib.structures.simulator_design import SimulatorDesign

Description = ArrayDesign | SimulatorDesign


def _mesh(design: Description) -> ModuleType:
    if isinstance(design, ArrayDesign):
        return array_mesh
    return simulator_mesh


@lru_cache(maxsize=16)
def solve_design(design: Description, count: int) -> Modes:
    """Lowest ``count`` modes of a description; kept in memory."""
    return solve(_mesh(design).structure_of(design), count)


def modal_model(design: Description, count: int) -> ModalModel:
    """Modal model of a description, with the questions that its numbers raise."""
    found = solve_design(design, count)
    xi = design.damping.of(found.frequency)
    if isinstance(design, ArrayDesign):
        notes = array_mesh.unit_warnings(design, found)
    else:
        notes = ()
    title = found.structure.title
    return ModalModel(
        found.frequency, xi, found.participation, found.mass, design.drive_axis, title, notes
    )


def kinds(design: Description, solution: Modes) -> tuple[str, ...]:
    """Kind of each mode of a description."""
    return _mesh(design).kinds(solution)


def mode_kind_labels(design: Description) -> dict[str, str]:
    """Meanings of the kinds of modes."""
    return _mesh(design).KINDS
