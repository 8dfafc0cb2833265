"""Mesh of an array description."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from pyfe3d.shellprop_utils import laminated_plate

from microvib.structures.array_design import ArrayDesign, Hinge, Sandwich, Tube, Yoke
from microvib.structures.fem.modes import Modes
from microvib.structures.fem.structure import (
    Link,
    Lump,
    Mesh,
    Section,
    Spring,
    Structure,
    StructureError,
)
from microvib.structures.simulator_design import Material

LARGEST = 2_000_000  # degrees of freedom of the largest mesh that is tried
_HONEYCOMB_MODULUS = (
    1e3  # Pa; a core carries shear only, and the laminate theory wants some modulus
)


KINDS = {
    "B": "out-of-plane bending",
    "I": "in-plane bending",
    "T": "torsion about the drive axis",
    "P": "bending of the panels across",
    "A": "along the drive axis",
}
"""Kinds of modes, by their kinetic energy."""


def structure_of(design: ArrayDesign) -> Structure:
    """Mesh of a description; StructureError where it would be too large or cannot be made."""
    check_size(
        6.0 * design.panels.count * design.panels.span * design.panels.chord / design.mesh**2,
        design.mesh,
    )
    mesh = Mesh()
    drive = interface = mesh.node(0.0, 0.0, 0.0)
    if design.shaft is not None:
        drive = mesh.node(0.0, 0.0, 0.0)
        mesh.parts.append(Spring("drive shaft", (interface, drive), design.shaft.values))
    seats = _yoke(mesh, design, drive)
    there = [k for k in range(1, design.panels.count + 1) if k not in design.panels.missing]
    panels = {k: _panel(mesh, design, k) for k in there}
    if 1 in panels:
        _root_hinges(mesh, design, seats, panels[1])
    for k in there:
        if k + 1 in panels:
            _hinge_line(mesh, design, k, panels[k], panels[k + 1])
    _masses(mesh, design, list(panels.values()))
    return mesh.structure(interface, design.title or "array")


def check_size(dof: float, size: float) -> None:
    """StructureError where elements of ``size`` [m] would make far too many degrees of freedom."""
    if dof > LARGEST:
        raise StructureError(
            f"mesh: elements of {size:g} m make about {dof:.3g} degrees of freedom; at most"
            f" {LARGEST:.0e} are tried"
        )


def laminate_of(sandwich: Sandwich) -> Any:
    """The library's laminate: plies of both faces, mirrored about the core, shear stiffness from
    equilibrium.
    """
    plies = [
        (
            p.angle,
            p.thickness,
            p.density,
            (p.modulus_1, p.modulus_2, p.poisson, *[p.shear_modulus] * 3),
        )
        for p in sandwich.face
    ]
    core, E = sandwich.core, _HONEYCOMB_MODULUS
    middle = (0.0, core.thickness, core.density, (E, E, 0.0, E / 2.0, core.shear_xz, core.shear_yz))
    stack = [*plies, middle, *reversed(plies)]
    laminate = laminated_plate(
        [math.degrees(angle) for angle, *_ in stack],
        plyts=[t for _, t, *_ in stack],
        rhos=[rho for *_, rho, _ in stack],
        laminaprops=[material for *_, material in stack],
    )
    laminate.intrho += sandwich.nonstructural_mass
    return laminate


def tube_section(tube: Tube, material: Yoke | Material) -> Section:
    """Section of a rectangular tube; torsion by Bredt, shear carried by the walls along it."""
    b, h, t = tube.width, tube.height, tube.wall
    bi, hi = b - 2.0 * t, h - 2.0 * t
    A = b * h - bi * hi
    enclosed = (b - t) * (h - t)
    J = 4.0 * enclosed**2 * t / (2.0 * (b + h - 2.0 * t))
    flat = (b * h**3 - bi * hi**3) / 12.0  # bending along the normal
    edge = (h * b**3 - hi * bi**3) / 12.0
    E, rho = material.modulus, material.density
    G = E / (2.0 * (1.0 + material.poisson))
    # y of the section lies along the normal
    return Section(
        E, G, rho, A, I_yy=edge, I_zz=flat, J=J, shear_y=2 * h * t / A, shear_z=2 * b * t / A
    )


def _yoke(mesh: Mesh, design: ArrayDesign, drive: int) -> dict[float, int]:
    """Legs and cross-bar; the nodes of the cross-bar at the root hinges."""
    yoke = design.yoke
    ends = yoke.half_width_panel
    places = sorted({-ends, ends, *(hinge.position for hinge in design.hinges.root)})
    bar = {y: mesh.node(yoke.length, y, 0.0) for y in places}
    leg, crossbar = tube_section(yoke.leg, yoke), tube_section(yoke.crossbar, yoke)
    if yoke.half_width_drive > 0.0:
        feet = [mesh.node(0.0, side * yoke.half_width_drive, 0.0) for side in (-1.0, 1.0)]
        mesh.parts.append(Link("yoke fitting", drive, np.array(feet)))
    else:
        feet = [drive, drive]
    for foot, y in zip(feet, (-ends, ends), strict=True):
        mesh.line("yoke", (foot, bar[y]), leg, design.mesh)
    for a, b in itertools.pairwise(places):
        mesh.line("cross-bar", (bar[a], bar[b]), crossbar, design.mesh)
    return bar


Panel = tuple[np.ndarray, np.ndarray]
Point = tuple[float, float, float]


def _panel(mesh: Mesh, design: ArrayDesign, number: int) -> Panel:
    """Shells of one panel; grid lines run along the edges of all footprints."""
    panels, hinges = design.panels, design.hinges
    start = design.yoke.length + (number - 1) * (panels.span + panels.gap)
    end = start + panels.span
    before, after = hinges.root if number == 1 else hinges.between, hinges.between
    x = grid_lines(
        [start, end, *(start + h.footprint for h in before), *(end - h.footprint for h in after)],
        design.mesh,
    )
    edges = [
        h.position + side * h.footprint / 2.0
        for h in (*hinges.root, *hinges.between)
        for side in (-1, 1)
    ]
    y = grid_lines([-panels.chord / 2.0, panels.chord / 2.0, *edges], design.mesh)
    return mesh.rectangle(f"panel {number}", x, y, design.offset, laminate_of(design.sandwich))


def grid_lines(breaks: list[float], size: float) -> np.ndarray:
    """Lines through all ``breaks`` and at most ``size`` apart."""
    fixed = np.unique(np.round(breaks, 9))
    pieces = [
        np.linspace(a, b, max(math.ceil((b - a) / size - 1e-9), 1), endpoint=False)
        for a, b in itertools.pairwise(fixed)
    ]
    return np.append(np.concatenate(pieces), fixed[-1])


def _root_hinges(mesh: Mesh, design: ArrayDesign, seats: dict[float, int], first: Panel) -> None:
    x = design.yoke.length
    for hinge in design.hinges.root:
        node = _footprint(
            mesh,
            "root hinge",
            first,
            hinge,
            (x, hinge.position, 0.0),
            along=(x, x + hinge.footprint),
        )
        mesh.parts.append(
            Spring("root hinge", (seats[hinge.position], node), hinge.stiffness.values)
        )


def _hinge_line(mesh: Mesh, design: ArrayDesign, number: int, before: Panel, after: Panel) -> None:
    """Hinges between two panels, at the middle of the gap."""
    panels = design.panels
    edge = design.yoke.length + number * panels.span + (number - 1) * panels.gap
    other = edge + panels.gap
    name = f"hinge line {number}-{number + 1}"
    for hinge in design.hinges.between:
        place = ((edge + other) / 2.0, hinge.position, design.offset)
        a = _footprint(mesh, name, before, hinge, place, along=(edge - hinge.footprint, edge))
        b = _footprint(mesh, name, after, hinge, place, along=(other, other + hinge.footprint))
        mesh.parts.append(Spring(name, (a, b), hinge.stiffness.values))


def _footprint(
    mesh: Mesh, name: str, panel: Panel, hinge: Hinge, place: Point, *, along: tuple[float, float]
) -> int:
    """A node at ``place``, rigidly linked to the panel's nodes in the hinge's footprint, which is
    ``along`` x [m].
    """
    index, xyz = panel
    half = hinge.footprint / 2.0 + 1e-6
    inside = (
        (xyz[:, 0] > along[0] - 1e-6)
        & (xyz[:, 0] < along[1] + 1e-6)
        & (np.abs(xyz[:, 1] - hinge.position) < half)
    )
    node = mesh.node(*place)
    mesh.parts.append(Link(name, node, index[inside]))
    return node


def _masses(mesh: Mesh, design: ArrayDesign, panels: list[Panel]) -> None:
    index = np.concatenate([p[0] for p in panels])
    xyz = np.concatenate([p[1] for p in panels])
    for k, item in enumerate(design.masses):
        distance = np.hypot(xyz[:, 0] - item.x, xyz[:, 1] - item.y)
        nearest = int(np.argmin(distance))
        if distance[nearest] > max(design.mesh, 1e-3):
            raise StructureError(f"masses.{k}: there is no panel at x {item.x:g} m, y {item.y:g} m")
        mesh.parts.append(Lump(f"mass {k + 1}", int(index[nearest]), item.mass))


def kinds(modes: Modes) -> tuple[str, ...]:
    """Kind of each mode, a key of ``KINDS``.

    The motion along the normal is split, at each station along the axis, into what the station does
    as a whole (bending), its turning about the axis (torsion) and the rest.
    """
    m, u = modes.node_masses, modes.shapes
    xyz = modes.structure.xyz - modes.structure.xyz[modes.structure.interface]
    _, station = np.unique(np.round(xyz[:, 0], 6), return_inverse=True)
    station = station.ravel()
    y = xyz[:, 1]

    def per_station(values: np.ndarray) -> np.ndarray:
        return np.array([np.bincount(station, row) for row in values.T])

    w = u[:, 2, :]
    mass, width = np.bincount(station, m), np.bincount(station, m * y**2)
    bending = (per_station(m[:, None] * w) ** 2 / np.maximum(mass, 1e-12)).sum(axis=1)
    torsion = (per_station((m * y)[:, None] * w) ** 2 / np.maximum(width, 1e-12)).sum(axis=1)
    total = (m[:, None] * w**2).sum(axis=0)
    energies = {
        "B": bending,
        "I": (m[:, None] * u[:, 1, :] ** 2).sum(axis=0),
        "T": torsion,
        "P": total - bending - torsion,
        "A": (m[:, None] * u[:, 0, :] ** 2).sum(axis=0),
    }
    names = list(energies)
    return tuple(names[k] for k in np.argmax(np.array(list(energies.values())), axis=0))


def unit_warnings(design: ArrayDesign, modes: Modes) -> tuple[str, ...]:
    """Suspected wrong units, as questions."""
    areal, first = design.sandwich.areal_mass, float(modes.frequency[0])
    weight = f"The panels weigh {areal:.4g} kg/m²; solar panels weigh 0.5 to 50. Is a unit wrong?"
    mode = f"The first mode is at {first:.4g} Hz; deployed arrays have it between 0.02 and 50. Is a unit wrong?"
    implausible = {weight: not 0.5 <= areal <= 50.0, mode: not 0.02 <= first <= 50.0}
    return tuple(text for text, found in implausible.items() if found)
