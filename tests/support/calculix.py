"""The reference array in CalculiX: quadratic bricks for panels and yoke, rigid bodies and springs
of its own.

What is shared is the geometry: grid lines of the panels, footprints, spring stiffnesses. It needs
``ccx`` (Debian's ``calculix-ccx``).
"""

import itertools
import math
import re
import subprocess

import numpy as np

from microvib.structures.fem.array_mesh import structure_of, tube_section
from microvib.structures.fem.structure import Link, Shells, Spring


class Deck:
    """Lines of an input file, with nodes and elements numbered on the way."""

    def __init__(self):
        self.nodes, self.elements, self.text, self.count = [], [], [], 0

    def node(self, xyz):
        self.nodes.append(xyz)
        return len(self.nodes)

    def element(self, kind, name, nodes):
        self.count += 1
        self.elements.append((kind, name, self.count, nodes))
        return self.count

    def rigid(self, name, nodes, place):
        """A rigid body; its nodes for translation and rotation."""
        both = self.node(place), self.node(place)
        self.text += [
            f"*NSET,NSET={name}",
            *lines_of(nodes),
            f"*RIGID BODY,NSET={name},REF NODE={both[0]},ROT NODE={both[1]}",
        ]
        return both

    def spring(self, a, b, stiffness):
        for k, value in enumerate(stiffness):
            name = f"S{self.count}"
            self.element("SPRING2", name, (a[k // 3], b[k // 3]))
            self.text += [f"*SPRING,ELSET={name}", f"{k % 3 + 1},{k % 3 + 1}", f"{float(value)!r}"]

    def write(self, path, modes):
        out = [
            "*NODE",
            *(f"{k},{x:.9g},{y:.9g},{z:.9g}" for k, (x, y, z) in enumerate(self.nodes, 1)),
        ]
        for (kind, name), group in itertools.groupby(self.elements, key=lambda e: e[:2]):
            out.append(f"*ELEMENT,TYPE={kind},ELSET={name}")
            for _, _, number, nodes in group:
                out += lines_of([number, *nodes], keep_comma=True)
        path.write_text(
            "\n".join([*out, *self.text, "*STEP", "*FREQUENCY", str(modes), "*END STEP", ""])
        )


def lines_of(numbers, keep_comma=False):
    rows = [numbers[k : k + 10] for k in range(0, len(numbers), 10)]
    return [
        ",".join(map(str, row)) + ("," if keep_comma and k + 1 < len(rows) else "")
        for k, row in enumerate(rows)
    ]


def bricks(deck, name, along, across, thickness, place):
    """Twenty-node bricks, one through the thickness, on two lists of grid lines; nodes by their
    place on the halved grid.

    ``place`` makes coordinates of (along, across, up).
    """
    x, y = (
        np.sort(np.r_[lines, (lines[1:] + lines[:-1]) / 2])
        for lines in (np.asarray(along), np.asarray(across))
    )
    z = np.array([-0.5, 0.0, 0.5]) * thickness
    grid = {}

    def node(p):
        if p not in grid:
            grid[p] = deck.node(place(x[p[0]], y[p[1]], z[p[2]]))
        return grid[p]

    def middle(p, q):
        return tuple((a + b) // 2 for a, b in zip(p, q, strict=True))

    for i, j in itertools.product(range(0, len(x) - 1, 2), range(0, len(y) - 1, 2)):
        low = [(i, j, 0), (i + 2, j, 0), (i + 2, j + 2, 0), (i, j + 2, 0)]
        high = [(a, b, 2) for a, b, _ in low]
        rings = [middle(ring[k], ring[(k + 1) % 4]) for ring in (low, high) for k in range(4)]
        upright = [middle(a, b) for a, b in zip(low, high, strict=True)]
        deck.element("C3D20R", name, [node(p) for p in (*low, *high, *rings, *upright)])
    return grid


def panels(deck, design, structure):
    """Bricks on the grids of the panels; coordinates and numbers of their nodes."""
    found = {}
    for part in structure.of(Shells):
        name = part.name.replace(" ", "").upper()
        xyz = structure.xyz[np.unique(part.nodes)]
        x, y = np.unique(np.round(xyz[:, 0], 9)), np.unique(np.round(xyz[:, 1], 9))
        h = plate(deck, design, name)
        found[part.name] = list(
            bricks(deck, name, x, y, h, lambda a, b, c: (a, b, design.offset + c)).values()
        )
    return found


def plate(deck, design, name):
    """The homogeneous orthotropic plate with the sandwich's stiffnesses (CalculiX takes no springs
    beside layered shells).

    Faces t thick at a distance d have A = 2 t Q and D = A d^2/4 + 2 Q t^3/12 in every component, so
    that one thickness sqrt(12 D/A) fits all; the core shears with G d^2/c.
    """
    s = design.sandwich
    (ply,), core = s.face, s.core
    t, d = ply.thickness, core.thickness + ply.thickness
    h = math.sqrt(12.0 * (d**2 / 4 + t**2 / 12))
    thin = 2.0 * t / h
    E1, E2, G12 = (thin * modulus for modulus in (ply.modulus_1, ply.modulus_2, ply.shear_modulus))
    G13, G23 = (G * d**2 / core.thickness / h for G in (core.shear_xz, core.shear_yz))
    areal = 2 * t * ply.density + core.thickness * core.density + s.nonstructural_mass
    deck.text += [f"*MATERIAL,NAME=M{name}", "*ELASTIC,TYPE=ENGINEERING CONSTANTS",
                  f"{E1:.8g},{E2:.8g},{E2:.8g},{ply.poisson},0,0,{G12:.8g},{G13:.8g}", f"{G23:.8g}",
                  "*DENSITY", f"{areal / h:.9g}", f"*ORIENTATION,NAME=O{name}", "1,0,0,0,1,0",
                  f"*SOLID SECTION,ELSET={name},MATERIAL=M{name},ORIENTATION=O{name}"]  # fmt: skip
    return h


def bar(deck, name, start, end, section, size):
    """Solid bricks with the area, both bending stiffnesses, torsion and mass of a section; nodes of
    its end faces.
    """
    start, end = np.array(start), np.array(end)
    length = np.linalg.norm(end - start)
    x = (end - start) / length
    z = np.array([0.0, 0.0, 1.0])
    y = np.cross(z, x)
    b, h = math.sqrt(12 * section.I_yy / section.A), math.sqrt(12 * section.I_zz / section.A)
    along = np.linspace(0.0, length, max(round(length / size), 2) + 1)
    grid = bricks(
        deck, name, along, (-b / 2, b / 2), h, lambda p, q, r: start + x * p + y * q + z * r
    )
    J = (b * h) ** 3 / (3 * (b**2 + h**2))  # of one such brick, whose warping is bilinear
    E, G = section.E * section.A / (b * h), section.G * section.J / J
    deck.text += [f"*MATERIAL,NAME=M{name}", "*ELASTIC,TYPE=ENGINEERING CONSTANTS", f"{E:.8g},{E:.8g},{E:.8g},0,0,0,{G:.8g},{G:.8g}",
                  f"{G:.8g}", "*DENSITY", f"{section.density * section.A / (b * h):.9g}"]  # fmt: skip
    axes = ",".join(f"{v:.9g}" for v in (*x, *y))
    deck.text += [
        f"*ORIENTATION,NAME=O{name}",
        axes,
        f"*SOLID SECTION,ELSET={name},MATERIAL=M{name},ORIENTATION=O{name}",
    ]
    last = max(i for i, _, _ in grid)
    return [[number for (i, _, _), number in grid.items() if i == end] for end in (0, last)]


def array_deck(design, structure):
    deck = Deck()
    at = panels(deck, design, structure)
    yoke = design.yoke
    leg, crossbar = tube_section(yoke.leg, yoke), tube_section(yoke.crossbar, yoke)
    end = yoke.half_width_panel
    joints = {}
    bars = [
        bar(deck, f"LEG{k}", (0, s * yoke.half_width_drive, 0), (yoke.length, s * end, 0), leg, 0.1)
        for k, s in enumerate((-1, 1))
    ]
    across = bar(deck, "BAR", (yoke.length, -end, 0), (yoke.length, end, 0), crossbar, 0.05)
    for k, s in enumerate((-1, 1)):
        joints[s] = deck.rigid(f"JOINT{k}", [*bars[k][1], *across[k]], (yoke.length, s * end, 0))
    clamped = [*bars[0][0], *bars[1][0]]
    deck.text += ["*BOUNDARY", *(f"{number},1,3" for number in clamped)]
    footprints = {}
    for k, link in enumerate(part for part in structure.of(Link) if part.name != "yoke fitting"):
        box = structure.xyz[link.slaves]
        low, high = box.min(axis=0)[:2] - 1e-6, box.max(axis=0)[:2] + 1e-6
        panel = next(part.name for part in structure.of(Shells) if link.slaves[0] in part.nodes)
        inside = [
            n
            for n in at[panel]
            if np.all(deck.nodes[n - 1][:2] >= low) and np.all(deck.nodes[n - 1][:2] <= high)
        ]
        footprints[link.master] = deck.rigid(f"FOOT{k}", inside, structure.xyz[link.master])
    for spring in structure.of(Spring):
        a, b = spring.nodes
        first = footprints.get(a) or joints[int(np.sign(structure.xyz[a, 1]))]
        deck.spring(first, footprints[b], spring.stiffness)
    return deck


def results(path):
    """Frequencies [Hz] and effective inertia about x [kg m^2], with the total."""
    text = path.read_text()
    rows = lambda head, columns: np.array([  # noqa: E731
        [float(v) for v in line.split()]
        for line in text[text.index(head) :].splitlines()[1:]
        if re.match(r"^\s+\d+\s", line) and len(line.split()) == columns
    ])  # fmt: skip
    f = rows("E I G E N V A L U E   O U T P U T", 5)[:, 3]
    effective = rows("E F F E C T I V E   M O D A L   M A S S", 7)[: f.size, 4]
    total = next(
        line
        for line in text[text.index("T O T A L   E F F E C T I V E") :].splitlines()
        if "e+" in line.lower() or "E-" in line
    )
    return f, effective, float(total.split()[-3])


def in_calculix(design, folder):
    """What ``results`` reads of an array, with bricks of 0.2 m."""
    coarse = design.model_copy(update={"mesh": 0.2})
    array_deck(coarse, structure_of(coarse)).write(folder / "array.inp", 14)
    environment = {"OMP_NUM_THREADS": "1", "PATH": "/usr/bin:/bin"}
    subprocess.run(["ccx", "array"], cwd=folder, check=True, capture_output=True, env=environment)
    return results(folder / "array.dat")
