"""Mesh of a simulator: beams for shaft and frame, shells for the plate, eight springs under
tension, bearing, lumped weights.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from pyfe3d.shellprop_utils import isotropic_plate

from microvib.structures.fem.array_mesh import check_size, grid_lines, tube_section
from microvib.structures.fem.modes import Modes
from microvib.structures.fem.structure import Link, Lump, Mesh, Section, Spring, Structure
from microvib.structures.simulator_design import Shaft, SimulatorDesign

KINDS = {
    "T": "torsion about the drive axis",
    "R": "rocking of the frame on bearing and shaft",
    "H": "heave along the drive axis",
    "S": "sway across the drive axis",
    "F": "frame or plate in itself",
}
"""Kinds of modes: the rigid motion about the drive axis that has most of its kinetic energy,
or none.
"""
_SIDES = (-1.0, 1.0)
_RIGID = 0.5  # least share of a rigid motion in a mode's kinetic energy that names the mode


def structure_of(design: SimulatorDesign) -> Structure:
    """Mesh of a description; StructureError where it would be too large."""
    check_size(
        6.0 * (design.plate.length / design.mesh) * (design.plate.width / design.mesh), design.mesh
    )
    mesh = Mesh()
    interface = mesh.node(0.0, 0.0, 0.0)
    mesh.parts.append(
        _disc("connector", interface, design.shaft.connector_mass, design.shaft.connector_diameter)
    )
    seat, bearing = _shaft(mesh, design, interface)
    sliders = _plate(mesh, design, seat)
    nodes = _frame(mesh, design)
    bridge = _bridge(mesh, design, nodes, bearing)
    _counterweights(mesh, design, nodes)
    _springs(mesh, design, sliders, nodes, interface)
    if design.rope is not None:
        across = design.rope.tension / design.rope.length
        stiffness = (across, across, design.rope.axial, 0.0, 0.0, design.rope.twist)
        mesh.parts.append(Spring("rope", (interface, bridge), stiffness))
    return mesh.structure(interface, design.title or "simulator")


def _disc(name: str, node: int, mass: float, diameter: float, height: float = 0.0) -> Lump:
    """A disc on the drive axis' direction as a lump."""
    tilt = mass * (diameter**2 / 16.0 + height**2 / 12.0)
    return Lump(name, node, mass, (tilt, tilt, mass * diameter**2 / 8.0))


def _shaft(mesh: Mesh, design: SimulatorDesign, interface: int) -> tuple[int, int]:
    """Beams along the shaft; its nodes at plate and bearing."""
    shaft = design.shaft
    at = {z: mesh.node(0.0, 0.0, z) for z in (shaft.plate_at, shaft.bearing_at)}
    heights = sorted(at)
    section = shaft_section(design, shaft)
    for a, b in itertools.pairwise([interface, *(at[z] for z in heights)]):
        mesh.line("shaft", (a, b), section, design.mesh, up=(1.0, 0.0, 0.0))
    return at[shaft.plate_at], at[shaft.bearing_at]


def shaft_section(design: SimulatorDesign, shaft: Shaft) -> Section:
    """Section of a round hollow shaft."""
    D, d, m = shaft.diameter, shaft.bore, design.material
    area, second = math.pi / 4.0 * (D**2 - d**2), math.pi / 64.0 * (D**4 - d**4)
    return Section(
        m.modulus,
        m.shear_modulus,
        m.density,
        area,
        second,
        second,
        2.0 * second,
        shear_y=0.89,
        shear_z=0.89,
    )


def _plate(mesh: Mesh, design: SimulatorDesign, seat: int) -> dict[tuple[float, float, float], int]:
    """Shells, held at the hub by the shaft; the hooks of the sliders by their sides along x, y, z."""
    p, z, m = design.plate, design.shaft.plate_at, design.material
    half, arm, level = p.slider_width / 2.0, design.arm, p.level
    ends = (p.length / 2.0, p.hub / 2.0, arm - half, arm + half)
    x = grid_lines([side * e for e in ends for side in _SIDES], design.mesh)
    y = grid_lines(
        [side * e for e in (p.width / 2.0, p.hub / 2.0, half) for side in _SIDES], design.mesh
    )
    laminate = isotropic_plate(p.thickness, m.modulus, m.poisson, rho=m.density)
    index, xyz = mesh.rectangle("plate", x, y, z, laminate)
    mesh.parts.append(Link("plate hub", seat, index[_inside(xyz, 0.0, p.hub / 2.0)]))
    hooks: dict[tuple[float, float, float], int] = {}
    for sx in _SIDES:
        node = mesh.node(sx * arm, 0.0, z)
        own = {
            (sx, sy, sz): mesh.node(sx * arm, sy * p.hook, z + sz * level)
            for sy in _SIDES
            for sz in _SIDES
        }
        mesh.parts.append(
            Link("slider", node, np.append(index[_inside(xyz, sx * arm, half)], list(own.values())))
        )
        turning = 2.0 * p.slider_mass * level**2
        mesh.parts.append(Lump("slider", node, 2.0 * p.slider_mass, (turning, turning, 0.0)))
        hooks |= own
    return hooks


def _inside(xyz: np.ndarray, x: float, half: float) -> np.ndarray:
    return (np.abs(xyz[:, 0] - x) < half + 1e-6) & (np.abs(xyz[:, 1]) < half + 1e-6)


Nodes = dict[tuple[float, float], int]


def _frame(mesh: Mesh, design: SimulatorDesign) -> Nodes:
    """Rails, arms and ties; nodes of the frame by place."""
    f, r, arm = design.frame, design.counterweight.radius, design.arm
    A, b, h = f.half_length, f.rail, f.bridge / 2.0
    nodes: Nodes = {}
    along = sorted({side * v for v in (h, b, arm, r, A) for side in _SIDES})
    across = sorted({b, r, A})
    for s in _SIDES:
        _chain(mesh, design, nodes, "rail", [(v, s * b) for v in along])
        _chain(mesh, design, nodes, "tie", [(s * A, -b), (s * A, b)])
        _chain(mesh, design, nodes, "tie", [(-b, s * A), (b, s * A)])
        for t in _SIDES:
            _chain(mesh, design, nodes, "arm", [(t * b, s * v) for v in across])
    return nodes


def _chain(
    mesh: Mesh, design: SimulatorDesign, nodes: Nodes, name: str, places: list[tuple[float, float]]
) -> None:
    section = tube_section(design.frame.tube, design.material)
    for place in places:
        if place not in nodes:
            nodes[place] = mesh.node(*place, design.shaft.plate_at)
    for a, b in itertools.pairwise(places):
        mesh.line(name, (nodes[a], nodes[b]), section, design.mesh)


def _bridge(mesh: Mesh, design: SimulatorDesign, nodes: Nodes, bearing: int) -> int:
    """The frame's rigid bridge over the plate, on the bearing; its node."""
    f, k = design.frame, design.bearing
    h, b, m = f.bridge / 2.0, f.rail, f.bridge_mass
    node = mesh.node(0.0, 0.0, design.shaft.bearing_at)
    mesh.parts.append(
        Link("bridge", node, np.array([nodes[s * h, t * b] for s in _SIDES for t in _SIDES]))
    )
    mesh.parts.append(
        Lump("bridge", node, m, (m * b**2 / 3.0, m * h**2 / 3.0, m * (h**2 + b**2) / 3.0))
    )
    mesh.parts.append(
        Spring("bearing", (bearing, node), (k.radial, k.radial, k.axial, k.rocking, k.rocking, 0.0))
    )
    return node


def _counterweights(mesh: Mesh, design: SimulatorDesign, nodes: Nodes) -> None:
    """Discs and their seats, each across a pair of rails."""
    w, b, z = design.counterweight, design.frame.rail, design.shaft.plate_at
    seat = design.frame.weight_seat_mass
    about = seat * b**2 / 3.0  # the seat is a bar from rail to rail
    for k, (x, y) in enumerate(
        [(w.radius, 0.0), (-w.radius, 0.0), (0.0, w.radius), (0.0, -w.radius)], 1
    ):
        node = mesh.node(x, y, z)
        if y == 0.0:
            places = [(x, s * b) for s in _SIDES]
        else:
            places = [(s * b, y) for s in _SIDES]
        mesh.parts.append(Link(f"seat {k}", node, np.array([nodes[p] for p in places])))
        mesh.parts.append(_disc(f"counterweight {k}", node, w.mass, w.diameter, w.height))
        mesh.parts.append(
            Lump(
                f"seat {k}",
                node,
                seat,
                (about if y == 0.0 else 0.0, about if x == 0.0 else 0.0, about),
            )
        )


def _springs(
    mesh: Mesh,
    design: SimulatorDesign,
    hooks: dict[tuple[float, float, float], int],
    nodes: Nodes,
    interface: int,
) -> None:
    """Eight springs under tension, half of their mass at either end.

    Tension F over the length holds the ends across. It also pulls on the levers from the middle
    line to the ends, which takes F end from the stiffness against turning the outer end and adds F
    hook at the inner one, against the ground, here the clamped interface: together nothing resists
    turning both ends as one body.
    """
    k, F, end = design.spring.rate, design.spring_force, design.hook_end
    across = F / (end - design.plate.hook)
    half = design.spring.mass / 2.0
    f, z = design.frame, design.shaft.plate_at
    for sx, sy in itertools.product(_SIDES, _SIDES):
        seat = nodes[sx * design.arm, sy * f.rail]
        mesh.parts.append(Lump("spring seat", seat, f.spring_seat_mass))
        pair = [mesh.node(sx * design.arm, sy * end, z + sz * design.plate.level) for sz in _SIDES]
        mesh.parts.append(Link("spring seat", seat, np.array(pair)))
        for sz, outer in zip(_SIDES, pair, strict=True):
            inner = hooks[sx, sy, sz]
            mesh.parts.append(Spring("spring", (inner, outer), (across, k, across, 0.0, 0.0, 0.0)))
            for node, lever in ((inner, F * design.plate.hook), (outer, -F * end)):
                mesh.parts.append(
                    Spring("tension", (interface, node), (0.0, 0.0, 0.0, lever, 0.0, lever))
                )
                mesh.parts.append(Lump("spring", node, half))


def kinds(found: Modes) -> tuple[str, ...]:
    """Kind of each mode, a key of ``KINDS``: share of the best-fitting rigid motions in the kinetic
    energy of the nodes.
    """
    m, xyz = found.node_masses, found.structure.xyz
    x, y, z = (xyz - np.average(xyz, axis=0, weights=m)).T
    zero, one = np.zeros(len(xyz)), np.ones(len(xyz))
    motions = {
        "T": [(-y, x, zero)],
        "R": [(zero, -z, y), (z, zero, -x)],
        "H": [(zero, zero, one)],
        "S": [(one, zero, zero), (zero, one, zero)],
    }
    names = []
    for u in np.moveaxis(found.shapes[:, :3, :], 2, 0):
        total = (m[:, None] * u**2).sum()
        share = {
            name: sum(_projected(m, u, np.column_stack(motion)) for motion in rows) / total
            for name, rows in motions.items()
        }
        best = max(share, key=lambda name: share[name])
        names.append(best if share[best] > _RIGID else "F")
    return tuple(names)


def _projected(m: np.ndarray, u: np.ndarray, motion: np.ndarray) -> float:
    """Kinetic energy of ``u`` along one rigid ``motion``, both (n, 3)."""
    weighted = m[:, None] * motion
    return float((weighted * u).sum() ** 2 / (weighted * motion).sum())
