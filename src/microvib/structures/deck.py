"""Modes as a finite-element deck says them, and the way from its units, frame and reference point
to the interface.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field, ValidationError

from microvib.model.part import Part
from microvib.model.rigid import perpendicular_unit_vector, rigid_motions
from microvib.structures.modal import ModalError, ModalModel
from microvib.structures.modal_checks import check_deck, check_mass, with_plausibility_notes
from microvib.units import Quantity

POUND_FORCE = 4.4482216152605  # N
UnitSystem = Literal["SI", "mm-t-s", "mm-kg-s", "in-lbf-s", "ft-lbf-s"]
UNIT_SYSTEMS: dict[str, tuple[float, float]] = {
    "SI": (1.0, 1.0),
    "mm-t-s": (1e-3, 1e3),
    "mm-kg-s": (1e-3, 1.0),
    "in-lbf-s": (0.0254, POUND_FORCE / 0.0254),
    "ft-lbf-s": (0.3048, POUND_FORCE / 0.3048),
}
"""Metres in a unit of length, kilograms in a unit of mass; time is in seconds in all of them."""

Point = tuple[
    float, float, float
]  # coordinates in the basic frame of the deck, in its unit of length; or a direction
ORIGIN: Point = (0.0, 0.0, 0.0)


class ImportOptions(Part):
    """How to interpret a deck; nothing that it does not say itself is guessed."""

    units: UnitSystem = Field(
        description=f"unit system of the deck: {', '.join(get_args(UnitSystem))}"
    )
    interface: int | Point = Field(
        description="interface point: a grid id, or three coordinates in the deck's basic frame and length unit"
    )
    drive_axis: Literal["x", "y", "z"] | Point = Field(
        description="drive axis: x, y or z of the frame, or three components of a direction"
    )
    frame: int = Field(
        default=0,
        ge=0,
        description="coordinate system of the deck whose axes the interface frame has; 0 is the basic one",
    )
    damping: Annotated[
        float,
        Quantity("", "modal damping ratio, of all modes", "xi", ge=0, le=0.99, display="percent"),
    ] = Field(default=0.01, description="modal damping ratio from 0 to 99 percent")
    modes: int | None = Field(
        default=None, ge=1, le=2000, description="how many modes to keep, from 1 to 2000"
    )
    mass: str | None = Field(
        default=None,
        description="a second file: OP4 with the mass matrix, or F06 with the grid point weight generator",
    )
    wtmass: float = Field(
        default=1.0, gt=0.0, description="PARAM,WTMASS of the deck, greater than 0"
    )
    reference: int | Point = Field(
        default=ORIGIN,
        description="point to which participation factors in OP2 and OP4 refer: a grid id or three coordinates",
    )


def import_options(data: Mapping[str, Any], origin: str) -> ImportOptions:
    """Options from keys and values; ModalError names each key that is wrong, with what is allowed."""
    try:
        return ImportOptions.model_validate(dict(data))
    except ValidationError as error:
        lines = dict.fromkeys(
            _sentence(item["type"], item["loc"], item.get("input")) for item in error.errors()
        )
        raise ModalError("\n".join(f"{origin}: {line}" for line in lines)) from None


def _sentence(kind: str, where: tuple[int | str, ...], found: Any) -> str:
    key = str(where[0])
    if kind == "extra_forbidden":
        return (
            f"{key}: unknown key; allowed for an import are {', '.join(ImportOptions.model_fields)}"
        )
    meaning = ImportOptions.model_fields[key].description
    if kind == "missing":
        return f"{key}: missing; expected {meaning}"
    return f"{key}: {found!r} is not allowed; {meaning}"


@dataclass(frozen=True)
class Deck:
    """Clamped modes from a file, in the deck's units and basic frame."""

    frequency: np.ndarray  # Hz, (s,)
    participation: np.ndarray  # mass-normalised, about ``reference``, (6, s)
    mass: np.ndarray  # rigid-body mass matrix about ``reference``, (6, 6)
    reference: int | Point = ORIGIN  # a grid id or coordinates
    grids: Mapping[int, np.ndarray] = field(
        default_factory=dict
    )  # coordinates of the grids, where known, (3,) each
    frames: Mapping[int, np.ndarray] = field(default_factory=dict)
    """Axes of rectangular coordinate systems as columns in the basic frame, (3, 3) each."""
    signed: bool = (
        True  # false where only magnitudes are known, as from a table of effective masses
    )
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        s = self.frequency.size
        if self.participation.shape != (6, s) or self.mass.shape != (6, 6):
            raise ModalError(
                f"has {s} modes, but participations {self.participation.shape} and mass"
                f" {self.mass.shape}; six"
                " directions of each mode and a 6 x 6 mass are expected"
            )


def modal_model(deck: Deck, options: ImportOptions, title: str = "deck") -> ModalModel:
    """Modes at the interface point, in the interface frame, in SI; ModalError says what is wrong
    with the deck.
    """
    check_deck(deck.frequency, deck.mass)
    shift, turn = np.zeros(3), _axes(deck, options)
    if options.interface != deck.reference:
        shift = _position(deck, deck.reference, "reference") - _position(
            deck, options.interface, "interface"
        )
    if isinstance(options.drive_axis, str):
        axis = options.drive_axis
    else:
        axis = "z"
    if not deck.signed and not (np.allclose(shift, 0.0) and np.allclose(turn, np.eye(3))):
        raise ModalError(
            "gives magnitudes of effective mass only, which cannot be moved from"
            f" {_words(deck.reference)} or"
            " turned; ask for participation factors, MEFFMASS(ALL), or give this point and an axis"
            " of the basic frame"
        )
    motion = rigid_motions(shift[None], np.zeros(3)) @ np.kron(np.eye(2), turn.T)
    length, kilogram = UNIT_SYSTEMS[options.units]
    scale = np.sqrt(kilogram) * np.repeat([1.0, length], 3)
    mass = scale[:, None] * (motion.T @ (deck.mass + deck.mass.T) @ motion / 2.0) * scale
    participation = scale[:, None] * (motion.T @ deck.participation)
    if not deck.signed:  # what the modes do in other directions at the same time is not known
        only = np.eye(6)[3 + "xyz".index(axis)]
        participation, mass = only[:, None] * participation, only[:, None] * mass * only
    order = np.argsort(deck.frequency, kind="stable")
    notes = (*deck.notes, _frame_note(deck, options))
    xi = np.full(order.size, options.damping)
    model = ModalModel(deck.frequency[order], xi, participation[:, order], mass, axis, title, notes)
    if options.modes is None:
        count = order.size
    else:
        count = options.modes
    if count > order.size:
        raise ModalError(f"has {order.size} modes; {count} are asked for")
    return with_plausibility_notes(check_mass(model).first(count), options.units)


def _position(deck: Deck, point: int | Point, role: str) -> np.ndarray:
    if not isinstance(point, int):
        return np.array(point)
    if point in deck.grids:
        return deck.grids[point]
    if deck.grids:
        raise ModalError(
            f"{role}: grid {point} is not in the model, which has {len(deck.grids)} grids from"
            f" {min(deck.grids)} to {max(deck.grids)}"
        )
    raise ModalError(
        f"{role}: the file does not say where grid {point} is; its participations refer to"
        f" {_words(deck.reference)}; give coordinates, or have them computed about that grid"
    )


def _axes(deck: Deck, options: ImportOptions) -> np.ndarray:
    """Rotation from the basic frame to the interface frame, rows are the axes of the interface
    frame, (3, 3).
    """
    turn = np.eye(3)
    if options.frame:
        if options.frame not in deck.frames:
            known = ", ".join(str(k) for k in sorted(deck.frames)) or "none"
            raise ModalError(
                f"frame: rectangular coordinate system {options.frame} is not in the file; it has"
                f" {known}"
            )
        turn = np.array(deck.frames[options.frame]).T
    if isinstance(options.drive_axis, str):
        return turn
    return np.array(_with_z_along(np.array(options.drive_axis)) @ turn)


def _with_z_along(direction: np.ndarray) -> np.ndarray:
    """Frame with z along ``direction`` and x as near as may be to the first of x, y that is not
    close to it.
    """
    if not np.all(np.isfinite(direction)) or not np.any(direction):
        raise ModalError(
            f"drive_axis: {direction.tolist()} is not a direction; three components, not all 0, are"
            " expected"
        )
    z = direction / np.linalg.norm(direction)
    x = perpendicular_unit_vector(z)
    return np.array([x, np.cross(z, x), z])


def _frame_note(deck: Deck, options: ImportOptions) -> str:
    if not options.frame:
        axes = "the deck's basic frame"
    else:
        axes = f"coordinate system {options.frame} of the deck"
    if not isinstance(options.drive_axis, str):
        axes = f"z along {list(options.drive_axis)} of {axes}"
    return (
        f"Interface point {_words(options.interface)}, interface frame {axes}, deck in"
        f" {options.units};"
        f" damping {100.0 * options.damping:g} % of every mode is declared, not computed."
    )


def _words(point: int | Point) -> str:
    if isinstance(point, int):
        return f"grid {point}"
    if not any(point):
        return "the origin of the basic frame"
    return f"point {list(point)}"
