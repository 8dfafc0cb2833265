"""A meshed structure: nodes and named groups of shells, beams, springs, masses and rigid links."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from microvib.errors import MicrovibError


class StructureError(MicrovibError):
    """A structure that cannot be right; says which part and why."""


@dataclass(frozen=True)
class Shells:
    """Four-node shells of one laminate; their angles count from ``axis``, projected onto them."""

    name: str
    nodes: np.ndarray  # corners, counter-clockwise seen from the side of the upper face, (n, 4)
    laminate: Any  # ``pyfe3d`` ShellProp: stiffnesses and mass of the laminate per area
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Section:
    """Cross-section of a beam, axes through its centroid; y lies in the plane of the beam and its
    ``up`` vector.
    """

    E: float
    G: float
    density: float
    A: float
    I_yy: float
    I_zz: float
    J: float
    shear_y: float = 5.0 / 6.0
    shear_z: float = 5.0 / 6.0


@dataclass(frozen=True)
class Beams:
    """Two-node Timoshenko beams of one section."""

    name: str
    nodes: np.ndarray  # ends, (n, 2)
    section: Section
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Spring:
    """Six springs between two nodes at one place: stiffness along [N/m] and about [N m/rad] the
    axes x, y, z.
    """

    name: str
    nodes: tuple[int, int]
    stiffness: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Lump:
    """A mass [kg] at a node, with its inertia [kg m^2] about the axes x, y, z there."""

    name: str
    node: int
    mass: float
    inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Link:
    """Nodes that move with ``master`` as one rigid body."""

    name: str
    master: int
    slaves: np.ndarray


Part = Shells | Beams | Spring | Lump | Link


def nodes_of(part: Part) -> np.ndarray:
    """All nodes of a part."""
    if isinstance(part, Lump):
        return np.array([part.node])
    if isinstance(part, Link):
        return np.append(part.slaves, part.master)
    return np.unique(part.nodes)


@dataclass(frozen=True)
class Structure:
    """Finite-element structure: coordinates [m], parts, and the node that is the interface."""

    xyz: np.ndarray  # nodes, (n, 3) [m]
    parts: tuple[Part, ...]
    interface: int
    title: str = ""

    @property
    def dof(self) -> int:
        """Degrees of freedom, six for each node."""
        return 6 * len(self.xyz)

    def of(self, kind: type) -> list[Any]:
        """The parts of one kind."""
        return [part for part in self.parts if isinstance(part, kind)]


@dataclass
class Mesh:
    """Collects nodes and parts; ``structure`` closes it."""

    points: list[np.ndarray] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    count: int = 0

    def add(self, xyz: Any) -> np.ndarray:
        """Indices of new nodes at ``xyz``, (n, 3) or (3,)."""
        points = np.atleast_2d(np.asarray(xyz, dtype=float))
        self.points.append(points)
        self.count += len(points)
        return np.arange(self.count - len(points), self.count)

    def node(self, x: float, y: float, z: float) -> int:
        """Index of one new node."""
        return int(self.add((x, y, z))[0])

    def rectangle(
        self, name: str, x: np.ndarray, y: np.ndarray, z: float, laminate: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shells on the grid ``x`` by ``y`` at height ``z``; indices and coordinates of its nodes."""
        X, Y = np.meshgrid(x, y, indexing="ij")
        xyz = np.column_stack([X.ravel(), Y.ravel(), np.full(X.size, z)])
        index = self.add(xyz)
        self.shells(name, index.reshape(X.shape), laminate)
        return index, xyz

    def shells(
        self, name: str, grid: np.ndarray, laminate: Any, *along: tuple[float, float, float]
    ) -> None:
        """Shells between the nodes of a ``grid`` (m, n) of indices."""
        corners = (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
        self.parts.append(
            Shells(name, np.column_stack([c.ravel() for c in corners]), laminate, *along)
        )

    def line(
        self,
        name: str,
        ends: tuple[int, int],
        section: Section,
        size: float,
        up: Any = (0.0, 0.0, 1.0),
    ) -> None:
        """Beams of at most ``size`` [m] between two nodes."""
        xyz = np.concatenate(self.points)
        a, b = xyz[ends[0]], xyz[ends[1]]
        n = max(int(np.ceil(np.linalg.norm(b - a) / size - 1e-9)), 1)
        if n > 1:
            inner = self.add(a + np.arange(1, n)[:, None] / n * (b - a))
        else:
            inner = np.array([], dtype=int)
        chain = np.r_[ends[0], inner, ends[1]]
        self.parts.append(Beams(name, np.column_stack([chain[:-1], chain[1:]]), section, tuple(up)))

    def structure(self, interface: int, title: str = "") -> Structure:
        """The finished structure."""
        return Structure(np.concatenate(self.points), tuple(self.parts), interface, title)
