"""One door to the finite elements of whatever is described: an array or a simulator."""

from __future__ import annotations

from functools import lru_cache

from microvib.structures.array_design import ArrayDesign
from microvib.structures.fem import array_mesh, modes, simulator_mesh
from microvib.structures.fem.modes import Modes
from microvib.structures.modal import ModalModel
from microvib.structures.simulator_design import SimulatorDesign

Description = ArrayDesign | SimulatorDesign


@lru_cache(maxsize=16)
def solved(design: Description, count: int) -> Modes:
    """Lowest ``count`` modes of a description; kept in memory."""
    if isinstance(design, ArrayDesign):
        return modes.solve(array_mesh.structure_of(design), count)
    return modes.solve(simulator_mesh.structure_of(design), count)


def modal_model(design: Description, count: int) -> ModalModel:
    """Modal model of a description, with the questions that its numbers raise."""
    found = solved(design, count)
    xi = design.damping.of(found.frequency)
    notes = array_mesh.questions(design, found) if isinstance(design, ArrayDesign) else ()
    title = found.structure.title
    return ModalModel(found.frequency, xi, found.participation, found.mass, design.drive_axis, title, notes)


def kinds(design: Description, solution: Modes) -> tuple[str, ...]:
    """Kind of each mode of a description."""
    return modes.kinds(solution) if isinstance(design, ArrayDesign) else simulator_mesh.kinds(solution)


def meanings(design: Description) -> dict[str, str]:
    """What the kinds of modes stand for."""
    return modes.KINDS if isinstance(design, ArrayDesign) else simulator_mesh.KINDS
