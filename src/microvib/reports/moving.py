"""Shapes of modes as they move in a browser: points at rest with faces and lines, and how far each
goes in each mode.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.array import Array
from microvib.model.coupling import require_craft
from microvib.model.craft import hub_matrices
from microvib.model.drive_matrices import coordinates
from microvib.model.reducer import Reducer
from microvib.model.rigid import COMPONENTS, inertia_about_center, rigid_motions, tensor
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import CENTER, INTERFACE, SECOND_INTERFACE, Interface

if TYPE_CHECKING:
    from microvib.structures.fem.modes import Modes
    from microvib.structures.fem.structure import Structure

SCRIPT = Path(str(resources.files("microvib.reports"))) / "templates" / "shapes.js"
"""Script that draws them, in reports and on the page."""
NOISE = 1e-6
"""Part of the mass or inertia below which an effective one counts as none."""
MAX_NODES = 4000
MAX_DISPLACEMENT_RATIO = 0.08
"""Largest displacement shown, of the structure's size."""
SIGHT_LENGTH_RATIO = 0.4
"""Length of the line of sight, of the array's size."""
AZIMUTH, ELEVATION = math.radians(-60.0), math.radians(28.0)
_PANEL = np.linspace(0.6, 3.0, 9), np.linspace(-0.5, 0.5, 5)
"""Points of a panel of no scale: along the drive axis, and across it."""
_FACES = [
    [a, b, d, c]
    for a, b, c, d in (
        (0, 1, 2, 3),
        (4, 5, 6, 7),
        (0, 1, 4, 5),
        (2, 3, 6, 7),
        (0, 2, 4, 6),
        (1, 3, 5, 7),
    )
]


@dataclass(frozen=True)
class AnimatedShape:
    """Points, what is drawn between them, and what they do in each mode."""

    xyz: np.ndarray
    """At rest, (n, 3) [m]."""
    shapes: np.ndarray
    """Displacements, (n, 3, s), of each mode on a scale of its own."""
    faces: np.ndarray
    """Corners, (f, 4)."""
    lines: np.ndarray
    """Ends, (l, 2); both the same for a point by itself."""
    sight: np.ndarray
    """Ends of the line of sight, (0 or 1, 2)."""

    @property
    def largest(self) -> np.ndarray:
        """How far the point goes that goes farthest, (s,)."""
        return np.asarray(np.sqrt((self.shapes**2).sum(axis=1)).max(axis=0))

    @property
    def scaled(self) -> np.ndarray:
        """Displacements of each mode so that they are seen, (n, 3, s) [m]."""
        extent = np.ptp(self.xyz, axis=0).max()
        return np.asarray(
            MAX_DISPLACEMENT_RATIO
            * extent
            * self.shapes
            / np.where(self.largest > 0.0, self.largest, 1.0)
        )

    def data(self) -> dict[str, Any]:
        """Numbers that ``templates/shapes.js`` draws."""
        return {
            "xyz": np.round(self.xyz, 3).tolist(),
            "faces": self.faces.tolist(), "lines": self.lines.tolist(), "sight": self.sight.tolist(),
            "shapes": np.round(np.moveaxis(self.scaled, 2, 0), 4).tolist(),
            "azimuth": AZIMUTH, "elevation": ELEVATION,
        }  # fmt: skip


def markup(data: dict[str, Any], names: Sequence[str]) -> str:
    """The canvas of a report with its script and data: numbers and our own words only."""
    told = json.dumps({**data, "names": list(names)}, separators=(",", ":")).replace("<", "\\u003c")
    page, script = (
        (SCRIPT.parent / name).read_text(encoding="utf-8") for name in ("shapes.html", SCRIPT.name)
    )
    return page.replace("__SCRIPT__", script).replace("__DATA__", told)


def shape_of_mesh(modes: Modes) -> AnimatedShape:
    """A meshed structure, axes and origin as its nodes have them."""
    faces, lines = faces_and_lines(modes.structure)
    return AnimatedShape(
        modes.structure.xyz, modes.shapes[:, :3, :], faces, lines, np.zeros((0, 2), dtype=int)
    )


def faces_and_lines(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the shells (f, 4) and ends of the beams (b, 2)."""
    from microvib.structures.fem.structure import Beams, Shells

    faces = [part.nodes for part in structure.of(Shells)] or [np.zeros((0, 4), dtype=int)]
    lines = [part.nodes for part in structure.of(Beams)] or [np.zeros((0, 2), dtype=int)]
    return np.concatenate(faces), np.concatenate(lines)


def shape_of_array(array: Array, modes: Modes | None) -> AnimatedShape:
    """An array about its interface point, in its own axes: its mesh or, where there is none, the
    box of its mass and inertia.

    The box moves in a mode by M^-1 P, which has the mode's momentum: of all rigid motions the one
    closest to the mode's, weighed by mass. Where only the drive axis is known, a panel of no scale
    turns about it by H/J. MicrovibError where the mesh is too fine.
    """
    if modes is not None:
        nodes = modes.structure.xyz
        if len(nodes) > MAX_NODES:
            raise MicrovibError(
                f"array.fem: its mesh of {len(nodes)} nodes is too fine to move; at most"
                f" {MAX_NODES} can"
            )
        return replace(shape_of_mesh(modes), xyz=nodes - nodes[modes.structure.interface])
    mass, participation, body = array.mass, array.interface, array.rigid_body
    if mass is None or participation is None or body is None:
        return _panel(array)
    center = np.array(body.center_of_mass)
    corners = center + box_corners(
        body.mass, inertia_about_center(body.mass, center, tensor(body.inertia))
    )
    points = np.vstack([corners, np.zeros(3), center])  # the last two are its arm
    return _rigid(points, np.linalg.solve(mass, participation), faces=_FACES, lines=[[8, 9]])


def _panel(array: Array) -> AnimatedShape:
    """A panel on an arm along the drive axis, for an array of which only inertia and modes about
    that axis are known.
    """
    along = "xyz".index(array.drive_axis)
    u, v = _PANEL
    points = np.zeros((len(u) * len(v) + 2, 3))
    points[:-2, along] = np.repeat(u, len(v))
    points[:-2, (along + 1) % 3] = np.tile(v, len(u))
    points[-1, along] = u[0]  # the last two are its arm
    first = [k * len(v) + j for k in range(len(u) - 1) for j in range(len(v) - 1)]
    faces = [[k, k + 1, k + 1 + len(v), k + len(v)] for k in first]
    motion = np.zeros((6, len(array.modes)))
    if array.modes:
        motion[3 + along] = array.H / array.inertia
    else:
        motion[3 + along] = ()
    return _rigid(points, motion, faces=faces, lines=[[len(points) - 2, len(points) - 1]])


def _coordinates_of(drive: str, reducer: Reducer, modes: int) -> np.ndarray:
    """theta_m, theta_l and modes by the coordinates of a second wing that does not step, (2 + s, n): those
    of its modes alone where its shaft is locked.
    """
    if drive == "locked":
        return np.eye(2 + modes)[:, 2:]
    return coordinates(reducer, modes)


def shape_of_craft(scenario: Scenario, modes: Modes | None) -> AnimatedShape:
    """Hub, arrays at their angles and line of sight in the craft's modes, hub axes about the hub's
    centre of mass.

    The hub is the box of its mass and inertia; of a flexible one its named points move as they do.
    ``modes`` are those of the first array's mesh, and of the second's where both are alike. Raises
    what ``shape_of_array`` does.
    """
    craft = require_craft(scenario)
    spacecraft, shapes = craft.spacecraft, craft.shapes
    hub, los = spacecraft.hub, spacecraft.line_of_sight
    places = {point.name: np.array(point.position) for point in hub.points}
    own = shapes[len(shapes) - len(scenario.array.modes) :]
    wings = [_wing(shape_of_array(scenario.array, modes), scenario.array.drive_axis, spacecraft.interface, spacecraft.array_angle,
                   craft.at(INTERFACE) @ shapes, own)]  # fmt: skip
    second = spacecraft.second_wing
    if (
        second is not None
        and second.array is not None
        and second.reducer is not None
        and second.array_angle is not None
    ):
        by = _coordinates_of(second.drive, second.reducer, len(second.array.modes))
        turned = by @ shapes[6 + len(hub.modes) :][: by.shape[1]]
        moved = craft.at(SECOND_INTERFACE) @ shapes
        moved[3:] += np.outer(second.interface.axis, turned[1])
        there = shape_of_array(second.array, modes if second.array == scenario.array else None)
        wings.append(
            _wing(
                there,
                second.array.drive_axis,
                second.interface,
                second.array_angle,
                moved,
                turned[2:],
            )
        )
    points = [
        _rigid(np.zeros((1, 3)), craft.at(name) @ shapes, place, lines=[[0, 0]])
        for name, place in places.items()
    ]
    box = _rigid(box_corners(hub.mass, tensor(hub.inertia)), shapes[:6], faces=_FACES)
    sight = []
    if los is not None and los.boresight is not None:
        roots = {INTERFACE: spacecraft.interface} | (
            {} if second is None else {SECOND_INTERFACE: second.interface}
        )
        others = {name: np.array(there.position) for name, there in roots.items()} | {
            CENTER: np.zeros(3)
        }
        start = (others | places)[los.point]
        along = np.array(los.boresight) / np.linalg.norm(los.boresight)
        ends = np.outer([0.0, SIGHT_LENGTH_RATIO * np.ptp(wings[0].xyz, axis=0).max()], along)
        sight = [_rigid(ends, craft.at(los.point) @ shapes, start, sight=[[0, 1]])]
    return _merge_shapes([box, *wings, *points, *sight])


def _wing(
    local: AnimatedShape,
    drive_axis: Literal["x", "y", "z"],
    interface: Interface,
    angle: float,
    root: np.ndarray,
    eta: np.ndarray,
) -> AnimatedShape:
    """An array at its place whose interface moves by ``root`` (6, s), and its own modes by ``eta``
    (s_array, s).
    """
    turn = interface.turn(drive_axis, angle)
    carried = _rigid(local.xyz @ turn.T, root, np.array(interface.position))
    own = np.einsum("ij,njk,ks->nis", turn, local.shapes, eta)
    return replace(local, xyz=carried.xyz, shapes=carried.shapes + own)


def box_corners(mass: float, inertia: np.ndarray) -> np.ndarray:
    """Corners (8, 3) of the box of this mass and inertia (3, 3) about its centre, about which they
    are.
    """
    moments, axes = np.linalg.eigh(inertia)
    sides = np.sqrt(np.maximum(6.0 / mass * (moments.sum() - 2.0 * moments), 0.0))
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    return np.asarray(0.5 * signs * sides @ axes.T)


def _rigid(
    xyz: np.ndarray,
    motion: np.ndarray,
    place: np.ndarray | None = None,
    **drawn: Sequence[Sequence[int]],
) -> AnimatedShape:
    """Points (n, 3) of a rigid body whose origin, at a ``place`` (3,), moves by ``motion`` (6, s)."""
    shapes = rigid_motions(xyz, np.zeros(3)).reshape(-1, 6, 6)[:, :3] @ motion
    faces = np.array(drawn.get("faces", ()), dtype=int).reshape(-1, 4)
    lines, sight = (
        np.array(drawn.get(name, ()), dtype=int).reshape(-1, 2) for name in ("lines", "sight")
    )
    return AnimatedShape(xyz if place is None else place + xyz, shapes, faces, lines, sight)


def _merge_shapes(parts: Sequence[AnimatedShape]) -> AnimatedShape:
    """Several as one."""
    first = np.cumsum([0, *(len(part.xyz) for part in parts)])

    def pairs(name: str) -> np.ndarray:
        return np.concatenate(
            [getattr(part, name) + k for part, k in zip(parts, first, strict=False)]
        )

    return AnimatedShape(
        np.concatenate([part.xyz for part in parts]),
        np.concatenate([part.shapes for part in parts]),
        pairs("faces"), pairs("lines"), pairs("sight"),
    )  # fmt: skip


def array_modes(array: Array, kinds: Sequence[str] | None) -> dict[str, list[Any]]:
    """Columns of the list of an array's modes, unit in brackets; ``kinds`` are known of finite
    elements.

    Effective masses and inertias are those of six directions, or of the drive axis alone where no
    other is known.
    """
    mass, participation, axis = array.mass, array.interface, "xyz".index(array.drive_axis)
    directions = list(range(6))
    if mass is None or participation is None:
        mass, participation, directions = np.diag([array.inertia]), array.H[None, :], [3 + axis]
    effective, whole = participation**2, np.diag(mass)[:, None]
    if kinds is None:  # the direction in which it takes part most
        fraction = np.divide(effective, whole, out=np.zeros_like(effective), where=whole > 0.0)
        kinds = [COMPONENTS[directions[k]] for k in np.argmax(fraction, axis=0)]
    effective = np.where(effective > NOISE * whole, effective, 0.0)
    sizes = {
        f"{'' if k < 3 else 'about '}{'xyz'[k % 3]} [{'kg' if k < 3 else 'kg m²'}]": row.tolist()
        for k, row in zip(directions, effective, strict=True)
    }
    damping = [100.0 * mode.damping for mode in array.modes]
    frequency = [mode.frequency for mode in array.modes]
    return {"kind": list(kinds), "frequency [Hz]": frequency, "damping [%]": damping, **sizes}


def craft_modes(scenario: Scenario, moving: AnimatedShape) -> dict[str, list[Any]]:
    """Columns of the list of a craft's undamped modes, each with its damping by itself."""
    craft = require_craft(scenario)
    M = hub_matrices(craft.spacecraft)[0]
    of_hub = craft.shapes[: len(M)]
    share = 100.0 * (of_hub * (M @ of_hub)).sum(
        axis=0
    )  # of a mass-normalised mode's kinetic energy
    found = {
        "frequency [Hz]": craft.frequency,
        "damping [%]": 50.0 * np.diag(craft.damping) / np.sqrt(craft.squares),
        "about the drive axis [kg m²]": craft.participation_of_shafts[:, 0] ** 2,
        "energy in the hub [%]": share,
    }
    if craft.spacecraft.line_of_sight is not None:
        los = np.linalg.norm(craft.line_of_sight().position @ craft.shapes, axis=0)
        found["line of sight [µrad/mm]"] = 1e3 * los / moving.largest
    return {name: column.tolist() for name, column in found.items()}


def shape_description(scenario: Scenario, of: str, meshed: bool) -> str:
    """Description of the drawn ``array`` or ``craft``, in a sentence or two; ``meshed`` is an array
    with a mesh.
    """
    array = scenario.array
    mesh = "The array is the mesh of its finite elements."
    box = (
        "The array is the box of its mass and inertia, as its shape is not known: in each mode it"
        " moves as the rigid body that has"
        " the mode's momentum."
    )
    panel = (
        "The panel stands for the array: the scenario gives its inertia and its modes about the"
        f" drive axis {array.drive_axis}"
        " alone, so that shape and size are not known, and it turns about that axis in every mode."
        " For shapes give array.fem; for"
        " motion in six directions, interface_participation of each mode and rigid_body."
    )
    hub = (
        " The hub is the box of its mass and inertia, dots are its points, the red line is the line"
        " of sight; hinges are"
        " locked, a second wing's held by its drive. Line of sight: for 1 mm where the mode moves"
        " most."
    )
    if not meshed and (array.mass is None or array.interface is None):
        return panel
    return (mesh if meshed else box) + (
        hub if of == "craft" else " Effective masses and inertias are those at the interface point."
    )
