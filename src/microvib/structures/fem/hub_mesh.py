"""Mesh and free-free modes of a described hub."""

from __future__ import annotations

import math

import numpy as np

from microvib.model.rigid import Position
from microvib.structures.fem.array_mesh import check_size, laminate_of
from microvib.structures.fem.assembly import System, assemble
from microvib.structures.fem.checks import check_structure
from microvib.structures.fem.modes import SHIFT, factorise, lowest_modes
from microvib.structures.fem.structure import Link, Lump, Mesh, Spring, Structure, StructureError
from microvib.structures.hub import FreeModes, residual_modes, residual_weights
from microvib.structures.hub_design import BENCH_POINT, Bench, Bus, HubDesign
from microvib.structures.modal import natural_frequency


def free_modes(design: HubDesign, count: int) -> FreeModes:
    """The six rigid modes, the lowest ``count`` flexible ones and residual modes, which have the
    static compliance of all others, at the named points; StructureError where it cannot be meshed.
    """
    structure, points = structure_of(design)
    check_structure(structure)
    system = assemble(structure, clamped=False)
    values, vectors = lowest_modes(system.K, system.M, 7 + count)
    frequency, at = natural_frequency(values), list(points.values())
    rows = (6 * np.array(at)[:, None] + np.arange(6)).ravel()
    positions = structure.xyz[at]
    squares, residual = _residual(system, rows, vectors[:, :-1], positions)
    kept = np.append(frequency[:-1], natural_frequency(squares))
    shapes = np.asarray(system.T.tocsr()[rows] @ np.hstack([vectors[:, :-1], residual]))
    xi = np.zeros(kept.size)
    xi[6:] = design.damping.of(kept[6:])
    at_points = shapes.reshape(len(at), 6, kept.size)
    return FreeModes(
        kept, xi, tuple(points), positions, at_points, left_out_from=float(frequency[-1])
    )


def _residual(
    system: System, rows: np.ndarray, kept: np.ndarray, positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residual modes beside those that are ``kept``, (m, s), by unit loads in ``rows`` of all degrees
    of freedom: squares of angular frequency and vectors (``residual_modes``).
    """
    loads = system.T.tocsr()[rows].T.toarray()
    # Without what acts on the modes that are kept, the rigid ones among them, the loads are in
    # equilibrium, and a shift far below the first mode that is left out changes nothing.
    loads = loads - system.M @ (kept @ (kept.T @ loads))
    responses = factorise(system.K + SHIFT**2 * system.M)(loads)
    responses -= kept @ (kept.T @ (system.M @ responses))
    weights = residual_weights(loads.T @ responses, positions)
    return residual_modes(responses @ weights, system.M)


def structure_of(design: HubDesign) -> tuple[Structure, dict[str, int]]:
    """Mesh, and the nodes of its named points; the interface is that of the first."""
    bus, bench = design.bus, design.bench
    area = 2.0 * sum(math.prod(bus.size) / side for side in bus.size) + bus.width * bus.height
    check_size(6.0 * (area + bench.length * bench.width) / design.mesh**2, design.mesh)
    mesh = Mesh()
    box = _box(mesh, bus, design.mesh)
    for unit in design.equipment:
        node = _rigid_footprint(mesh, unit.name, unit.position, unit.position, box, unit.reach)
        mesh.parts.append(Lump(unit.name, node, unit.mass))
    points = {
        fitting.name: _rigid_footprint(
            mesh, fitting.name, fitting.position, fitting.position, box, fitting.reach
        )
        for fitting in design.points
    }
    points[BENCH_POINT] = _bench(mesh, bench, 0.5 * bus.height, box, design.mesh)
    return mesh.structure(points[design.points[0].name], design.title or "hub"), points


def _steps(side: float, size: float) -> np.ndarray:
    """Places along a side that is centred on 0, at most ``size`` apart, one of them its middle."""
    return np.linspace(-0.5 * side, 0.5 * side, 2 * max(math.ceil(0.5 * side / size), 1) + 1)


def _box(mesh: Mesh, bus: Bus, size: float) -> np.ndarray:
    """Six panels and the shear wall, which share their edges; indices of their nodes."""
    steps = [_steps(side, size) for side in bus.size]
    counts = [len(places) - 1 for places in steps]
    nodes: dict[tuple[int, ...], int] = {}
    laminate = laminate_of(bus.panel)
    for name, axis, place in (
        ("-x panel", 0, 0), ("shear wall", 0, counts[0] // 2), ("+x panel", 0, counts[0]), ("-y panel", 1, 0),
        ("+y panel", 1, counts[1]), ("bottom panel", 2, 0), ("top panel", 2, counts[2]),
    ):  # fmt: skip
        others = [k for k in range(3) if k != axis]
        grid = np.empty([counts[k] + 1 for k in others], dtype=int)
        for i, j in np.ndindex(grid.shape):
            key = tuple(np.insert((i, j), axis, place).tolist())
            if key not in nodes:
                nodes[key] = mesh.node(*(float(steps[k][key[k]]) for k in range(3)))
            grid[i, j] = nodes[key]
        mesh.shells(name, grid, laminate, (0.0, 1.0, 0.0) if axis == 0 else (1.0, 0.0, 0.0))
    return np.array(list(nodes.values()))


def _rigid_footprint(
    mesh: Mesh, name: str, at: Position, around: Position, nodes: np.ndarray, reach: float
) -> int:
    """A new node ``at`` a place, with which all ``nodes`` within ``reach`` of the place ``around``
    move rigidly.
    """
    xyz = np.concatenate(mesh.points)
    near = nodes[np.linalg.norm(xyz[nodes] - around, axis=1) <= reach * (1.0 + 1e-9)]
    if not near.size:
        raise StructureError(
            f"{name}: no place of the mesh lies within {reach:g} m of it; a larger reach is needed"
        )
    node = mesh.node(*at)
    mesh.parts.append(Link(name, node, near))
    return node


def _bench(mesh: Mesh, bench: Bench, top: float, box: np.ndarray, size: float) -> int:
    """Bench, its mounts on the top panel, and the payload, whose node is returned."""
    level = top + bench.above
    x, y = _steps(bench.length, size), _steps(bench.width, size)
    plate, _ = mesh.rectangle("bench", x, y, level, laminate_of(bench.panel))
    for k, mount in enumerate(bench.mounts):
        here = (mount.x, mount.y, level)
        foot = _rigid_footprint(
            mesh, f"foot {k + 1}", here, (mount.x, mount.y, top), box, mount.reach
        )
        seat = _rigid_footprint(mesh, f"seat {k + 1}", here, here, plate, mount.reach)
        across, about = mount.lateral, mount.rotational
        mesh.parts.append(
            Spring(
                f"mount {k + 1}", (foot, seat), (across, across, mount.axial, about, about, about)
            )
        )
    node = _rigid_footprint(
        mesh,
        BENCH_POINT,
        (0.0, 0.0, level + bench.payload_above),
        (0.0, 0.0, level),
        plate,
        bench.payload_reach,
    )
    mesh.parts.append(Lump(BENCH_POINT, node, bench.payload_mass, bench.payload_inertia))
    return node
