"""One door to the finite elements of whatever is described: an array or a simulator."""

from __future__ import annotations

from microvib.structures.array_design import ArrayDesign
from microvib.structures.fem import array_mesh as array
from microvib.structures.fem import modes
from microvib.structures.fem import simulator_mesh as simulator
from microvib.structures.fem.modes import Modes
from microvib.structures.modal import ModalModel
from microvib.structures.simulator_design import SimulatorDesign

Design = ArrayDesign | SimulatorDesign


def solved(design: Design, count: int) -> Modes:
    """Lowest ``count`` modes of a description; kept in memory."""
    return array.solve_array(design, count) if isinstance(design, ArrayDesign) else simulator.solve(design, count)


def modal_model(design: Design, count: int) -> ModalModel:
    """Modal model of a description."""
    return array.modal_model(design, count) if isinstance(design, ArrayDesign) else simulator.modal_model(design, count)


def kinds(design: Design, solution: Modes) -> tuple[str, ...]:
    """Kind of each mode of a description."""
    return modes.kinds(solution) if isinstance(design, ArrayDesign) else simulator.kinds(solution)


def meanings(design: Design) -> dict[str, str]:
    """What the kinds of modes stand for."""
    return modes.KINDS if isinstance(design, ArrayDesign) else simulator.KINDS
