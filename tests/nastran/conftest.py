"""A frame with known mass, and writers of the files of a run on it: layouts as the programs have them, nothing of the readers."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh

INTERFACE = 1001
FREE = (7, 12, 20, 31, 44, 58)
HOME = np.array([0.1, -0.2, 0.3])  # of the interface point
STATIONS = np.array(
    [
        [0.3, 0.9, 0.05],
        [-0.1, 1.6, 0.0],
        [0.4, 2.3, -0.1],
        [0.1, 3.1, 0.2],
        [-0.2, 3.9, 0.1],
        [0.2, 4.6, 0.0],
    ]
)
SCALES = {"SI": (1.0, 1.0), "mm-t-s": (1e-3, 1e3), "in-lbf-s": (0.0254, 4.4482216152605 / 0.0254)}
CD = 5  # output coordinate system of one grid, rotated about an oblique axis


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0.0]])


def point_mass(m, inertia, arm):
    """Mass matrix at a point of a body with its centre ``arm`` away, from the parallel axis theorem."""
    s = skew(arm)
    return np.block([[m * np.eye(3), -m * s], [m * s, inertia - m * s @ s]])


def beam(a, b):
    """Stiffness of a beam between two points in the basic frame (textbook matrix; section 30 x 40 mm, aluminium)."""
    E, G, A, Iy, Iz, Jt = 7e10, 2.6e10, 1.2e-3, 1.6e-7, 9e-8, 1.9e-7
    L = np.linalg.norm(b - a)
    k = np.zeros((12, 12))
    for i, j, v in [(0, 6, E * A / L), (3, 9, G * Jt / L)]:
        k[i, i] = k[j, j] = v
        k[i, j] = k[j, i] = -v
    for w, r, sign, inertia in [(1, 5, 1, Iz), (2, 4, -1, Iy)]:
        f = E * inertia / L**3
        index = [w, r, w + 6, r + 6]
        block = f * np.array(
            [[12, 6 * L * sign, -12, 6 * L * sign], [6 * L * sign, 4 * L**2, -6 * L * sign, 2 * L**2],
             [-12, -6 * L * sign, 12, -6 * L * sign], [6 * L * sign, 2 * L**2, -6 * L * sign, 4 * L**2]]
        )  # fmt: skip
        k[np.ix_(index, index)] += block
    x = (b - a) / L
    z = np.cross(x, [0.0, 0.0, 1.0])
    z /= np.linalg.norm(z)
    T = np.kron(np.eye(4), np.array([x, np.cross(z, x), z]))
    return T.T @ k @ T


@dataclass
class Frame:
    """Clamped frame in the units of a deck; ``free`` leaves the interface free."""

    units: str = "SI"
    free: bool = False
    consistent: bool = False
    local: bool = False
    """Whether one grid has an output coordinate system of its own."""
    also: tuple[int, ...] = ()
    """Further grids that are clamped."""

    @cached_property
    def scale(self):
        return SCALES[self.units]

    @cached_property
    def ids(self):
        return np.array(sorted((*FREE, INTERFACE)))

    @cached_property
    def places(self):
        """Coordinates by id, SI."""
        return {INTERFACE: HOME, **dict(zip(FREE, STATIONS, strict=True))}

    @cached_property
    def order(self):
        return {g: k for k, g in enumerate(self.ids)}

    def rows(self, grid):
        k = 6 * self.order[grid]
        return slice(k, k + 6)

    @cached_property
    def bodies(self):
        """(grid, mass, inertia about its centre, arm) of all bodies, SI."""
        rng = np.random.default_rng(4)
        result = []
        for g in self.ids:
            m = 0.6 if g == INTERFACE else 2.0 + rng.random()
            arm = np.zeros(3) if g == INTERFACE else 0.2 * rng.normal(size=3)
            result.append((g, m, np.diag(0.02 + 0.05 * rng.random(3)), arm))
        return result

    @cached_property
    def turn(self):
        """Basic components to those of the grid with its own system, (3, 3)."""
        a = np.deg2rad(33.0)
        axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
        return (np.eye(3) + np.sin(a) * skew(axis) + (1 - np.cos(a)) * skew(axis) @ skew(axis)).T

    @cached_property
    def output(self):
        """Basic to output coordinates of all grids."""
        blocks = [
            np.kron(np.eye(2), self.turn) if self.local and g == FREE[2] else np.eye(6)
            for g in self.ids
        ]
        return block_diag(*blocks)

    @cached_property
    def units_of(self):
        """Deck values of displacements are those in metres times this."""
        return np.tile(np.repeat([1.0 / self.scale[0], 1.0], 3), len(self.ids))

    def _deck(self, A):
        energy = self.scale[1] * self.scale[0] ** 2
        return self.output @ (A / np.outer(self.units_of, self.units_of) / energy) @ self.output.T

    @cached_property
    def matrices(self):
        """K, M of the G-set in output coordinates and deck units."""
        n = 6 * len(self.ids)
        K, M = np.zeros((n, n)), np.zeros((n, n))
        chain = [INTERFACE, *FREE]
        for g, m, inertia, arm in self.bodies:
            M[self.rows(g), self.rows(g)] += point_mass(m, inertia, arm)
        for a, b in pairwise(chain):
            index = np.r_[self.rows(a), self.rows(b)]
            K[np.ix_(index, index)] += beam(self.places[a], self.places[b])
            if self.consistent:  # a bar of mass that moves with the mean of its ends
                half = [
                    np.hstack([np.eye(3), -skew(0.5 * (self.places[b] - self.places[a]) * s)])
                    for s in (1, -1)
                ]
                N = np.hstack(half) / 2.0
                M[np.ix_(index, index)] += 1.5 * N.T @ N
        return self._deck(K), self._deck(M)

    @cached_property
    def rigid(self):
        """Rigid-body motions about the origin in output coordinates and deck units, (n, 6)."""
        R = np.vstack(
            [
                np.block(
                    [
                        [np.eye(3), -skew(self.places[g] / self.scale[0])],
                        [np.zeros((3, 3)), np.eye(3)],
                    ]
                )
                for g in self.ids
            ]
        )
        return self.output @ R

    @cached_property
    def inside(self):
        held = np.zeros(6 * len(self.ids), bool)
        for grid in (INTERFACE, *self.also):
            held[self.rows(grid)] = not self.free
        return ~held

    @cached_property
    def modes(self):
        """Frequencies [Hz], shapes of the G-set (mass-normalised)."""
        K, M = self.matrices
        i = np.ix_(self.inside, self.inside)
        lam, shapes = eigh(K[i], M[i])
        phi = np.zeros((K.shape[0], lam.size))
        phi[self.inside] = shapes
        return np.sqrt(np.abs(lam)) / (2 * np.pi), phi

    def forces(self, phi, frequency):
        """Forces of constraint in each mode."""
        K, M = self.matrices
        f = K @ phi - M @ phi * (2 * np.pi * frequency) ** 2
        f[self.inside] = 0.0
        return f

    def about(self, point, turn=np.eye(3)):  # noqa: B008
        """Mass matrix by the parallel axis theorem and participation about a point, in SI and turned axes."""
        point, T = np.asarray(point, float), np.kron(np.eye(2), turn)
        M = sum(
            point_mass(m, inertia, self.places[g] + arm - point)
            for g, m, inertia, arm in self.bodies
        )
        if self.consistent:
            chain = [INTERFACE, *FREE]
            M = M + sum(
                point_mass(1.5, np.zeros((3, 3)), (self.places[a] + self.places[b]) / 2 - point)
                for a, b in pairwise(chain)
            )
        si = Frame(consistent=self.consistent)
        frequency, phi = si.modes
        R = np.vstack(
            [
                np.block(
                    [[np.eye(3), -skew(self.places[g] - point)], [np.zeros((3, 3)), np.eye(3)]]
                )
                for g in self.ids
            ]
        )
        return frequency, T @ (R.T @ si.matrices[1] @ phi), T @ M @ T.T

    @cached_property
    def weight(self):
        """Mass of the whole model about the origin in deck units."""
        return self.rigid.T @ self.matrices[1] @ self.rigid

    def moved(self, grid):
        """Motion of the origin from that of a grid (0: the origin itself)."""
        T = np.eye(6)
        T[:3, 3:] = skew(self.places[grid] / self.scale[0]) if grid else 0.0
        return T

    @cached_property
    def at(self):
        """Interface point in deck units."""
        return HOME / self.scale[0]


@pytest.fixture(scope="session")
def frame():
    return Frame


# --- OP2: records between markers, as OUTPUT2 writes them


class Op2:
    def __init__(self, path: Path, endian="<"):
        self.path, self.e, self.data = path, endian, []
        self.marker(3).record("3i", 11, 21, 26).marker(7).raw(
            b"NASTRAN FORT TAPE ID CODE - "
        ).marker(2).raw(b"NX2019.2")
        self.marker(-1).marker(0)

    def raw(self, data):
        n = struct.pack(self.e + "i", len(data))
        self.data.append(n + data + n)
        return self

    def marker(self, k):
        return self.raw(struct.pack(self.e + "i", k))

    def record(self, form, *values):
        return self.raw(struct.pack(self.e + form, *values))

    def head(self, name, trailer, kind=0):
        self.marker(2).raw(name.ljust(8).encode()).marker(-1).marker(7).record("7i", *trailer)
        self.marker(-2).marker(1).marker(0).marker(2).raw(name.ljust(8).encode()).marker(-3).marker(
            1
        ).marker(kind)

    def table(self, name, records, trailer=(101, 1, 0, 0, 0, 0, 0)):
        self.head(name, trailer)
        for k, data in enumerate(records, 4):
            self.marker(len(data) // 4).raw(data).marker(-k).marker(1).marker(0)
        self.marker(0)

    def matrix(self, name, A):
        rows, columns = A.shape
        self.head(name, (101, columns, rows, 2, 2, 0, 0), 1)
        for k, column in enumerate(A.T, 4):
            data = struct.pack(self.e + f"i{rows}d", 1, *column)
            self.marker(len(data) // 4).raw(data).marker(-k).marker(1).marker(
                1 if k - 3 < columns else 0
            )
        self.marker(0)

    def pack(self, form, *values):
        return struct.pack(self.e + form, *values)

    def close(self):
        self.marker(0)
        self.path.write_bytes(b"".join(self.data))
        return self.path


def op2(path, frame, *, count=None, shapes=True, forces=True, weight=True, geometry=True, mass=False, lama=True, factors=False,
        endian="<", maximum=False, extra=None, basic=False, siemens=False, loose=None):  # fmt: skip
    """An OP2 file of a run of modes; ``siemens`` writes its table of grids as that Nastran does, ``loose`` a grid by itself."""
    f, phi = frame.modes
    f, phi = f[:count], phi[:, :count]
    norm = np.abs(phi).max(axis=0) if maximum else np.ones(f.size)
    phi, generalised = phi / norm, 1.0 / norm**2
    o = Op2(path, endian)
    ids = [*frame.ids, *([loose] if loose else [])]
    xyz = [frame.places.get(g, np.ones(3)) / frame.scale[0] for g in ids]
    cd = [CD if frame.local and g == FREE[2] else 0 for g in ids]
    if geometry:
        rows = b"".join(
            o.pack("2i3f3i", g, 0, *x, c, 0, 0) for g, x, c in zip(ids, xyz, cd, strict=True)
        )
        # CORD2R: id, type, 2, reference; origin, a point on z, a point in x-z
        T = frame.turn
        cord = o.pack("4i9f", CD, 1, 2, 0, 0, 0, 0, *T[2], *(T[0] + T[2]))
        o.table("GEOM1", [o.pack("3i", 2101, 21, 8) + cord, o.pack("3i", 4501, 45, 1) + rows])
        n = len(ids)
        if siemens:
            rows = [
                o.pack("6i3d", c, 6 * k + 1, g, 61, 0, 0, *x)
                for k, (g, c, x) in enumerate(zip(ids, cd, xyz, strict=True))
            ]
            o.table(
                "BGPDT", [b"".join(rows), o.pack(f"{2 * n}i", *np.repeat(np.arange(1, n + 1), 2))]
            )
        else:
            o.table("BGPDT", [b"".join(o.pack("i3f", c, *x) for c, x in zip(cd, xyz, strict=True))])
        o.table("EQEXIN", [
            o.pack(f"{2 * n}i", *np.column_stack([ids, np.arange(1, n + 1)]).ravel()),
            o.pack(f"{2 * n}i", *np.column_stack([ids, 10 * (6 * np.arange(n) + 1) + 1]).ravel()),
        ])  # fmt: skip
    if weight:
        o.table(
            "OGPWG",
            [
                o.pack("146i", 1, 13, 0, *[0] * 143),
                o.pack("78f", *frame.weight.ravel(), *[0.0] * 42),
            ],
        )
    if lama:
        lam = (2 * np.pi * f) ** 2
        rows = b"".join(
            o.pack("2i5f", k, k, x, np.sqrt(x), y, g, x * g)
            for k, (x, y, g) in enumerate(zip(lam, f, generalised, strict=True), 1)
        )
        o.table("LAMA", [o.pack("146i", 21, 6, *[0] * 144), rows])

    def vectors(name, code, values, grids):
        records = []
        for k, column in enumerate(values.T, 1):
            lam = np.float32((2 * np.pi * f[k - 1]) ** 2)
            records.append(
                o.pack("5i2f139i", 22, code, 0, 1, k, lam, f[k - 1], 0, 1, 8, *[0] * 136)
            )
            rows = [o.pack("2i6f", 10 * g + 2, 1, *column[frame.rows(g)]) for g in grids]
            rows += [o.pack("2i6f", 10 * loose + 2, 1, *[0.0] * 6)] if loose else []
            records.append(b"".join(rows))
        o.table(name, records)

    if shapes:
        out = frame.output.T @ phi if basic else phi
        vectors("BOUGV1" if basic else "OUGV1", 7, out, frame.ids)
    if forces:
        vectors("OQG1", 3, frame.forces(phi, f), sorted((INTERFACE, *frame.also)))
    if mass:
        o.matrix("MGG", frame.matrices[1])
    if factors:
        R, M = frame.rigid, frame.matrices[1]
        o.matrix("MPFACS", R.T @ M @ phi / generalised)
        o.matrix(
            "RBMASS", R[frame.inside].T @ M[np.ix_(frame.inside, frame.inside)] @ R[frame.inside]
        )
    for name, A in (extra or {}).items():
        o.matrix(name, A)
    return o.close()


@pytest.fixture(scope="session")
def write_op2():
    return op2


# --- F06: pages as they are printed


def _page(out, number, case="SUBCASE 1"):
    out.append(f"1{'':74}FEBRUARY   2, 2026  MSC Nastran 12/ 1/17   PAGE {number:5d}")
    out.append(" " * 132)
    out.append(f"0     MODES{'':94}{case:22}")
    out.append("")


def _e(v):
    return f"{v:.6E}"


def _matrix(A):
    return [f"{'':23}* {' '.join(f'{_e(v):>13}' for v in row)} *" for row in A]


def f06(path, frame, *, count=None, tables=("factors", "effective", "fractions"), weight=True, free=True, per_page=10**6,
        repeat=True, reference=None, grdpnt=0, scaled=1.0, letter="E", echo=True, maximum=False):  # fmt: skip
    """The printed result of MEFFMASS(ALL)=YES and PARAM,GRDPNT,0; ``reference`` is a grid id."""
    f, phi = frame.modes
    f, phi = f[:count], phi[:, :count]
    generalised = 1.0 / np.abs(phi).max(axis=0) ** 2 if maximum else np.ones(f.size)
    R, M = frame.rigid, frame.matrices[1]
    if reference is not None:
        R = R @ frame.moved(reference)
    P = R.T @ M @ phi
    A = R[frame.inside].T @ M[np.ix_(frame.inside, frame.inside)] @ R[frame.inside]
    out = ["1", "  M S C   N a s t r a n", " EXAMPLE OF A LISTING"]
    if echo:
        out += [
            "0        C A S E    C O N T R O L    E C H O",
            "   2      MEFFMASS(ALL)=YES",
            "  3     SUBTITLE = REAL EIGENVALUES",
        ]
    page = iter(range(1, 10_000))
    if weight:
        _page(out, next(page), "")
        out.append(
            "                           O U T P U T   F R O M   G R I D   P O I N T   W E I G H T   G E N E R A T O R"
        )
        out.append(
            f"0                                                     REFERENCE POINT = {grdpnt:8d}"
        )
        out.append("                                                                M O")
        out += _matrix(scaled * (frame.moved(grdpnt).T @ frame.weight @ frame.moved(grdpnt)))
        out.append("                                                                 S")
        out += _matrix(np.eye(3))

    def rows(title, header, lines):
        for k, line in enumerate(lines):
            if k % per_page == 0:
                _page(out, next(page))
                if k == 0 or repeat:
                    out.extend(title)
                out.extend(header)
            out.append(line)
        out.append("")

    lam = (2 * np.pi * f) ** 2
    rows(
        ["                                              R E A L   E I G E N V A L U E S"],
        ["   MODE    EXTRACTION      EIGENVALUE            RADIANS             CYCLES            GENERALIZED         GENERALIZED",
         "    NO.       ORDER                                                                       MASS              STIFFNESS"],
        [f"{k:9d}{k:10d}  {_e(x):>18}{_e(np.sqrt(x)):>20}{_e(y):>20}{_e(g):>20}{_e(g * x):>20}"
         for k, (x, y, g) in enumerate(zip(lam, f, generalised, strict=True), 1)],
    )  # fmt: skip
    if free:
        _page(out, next(page))
        where = (
            "ORIGIN OF BASIC COORDINATE SYSTEM" if reference is None else f"GRID POINT {reference}"
        )
        out.append(
            "                                       M O D A L   E F F E C T I V E   M A S S   S U M M A R Y"
        )
        out += [
            "",
            "                                                    TOTAL EFFECTIVE MASS FRACTION",
        ]
        out += [f"                                         REFERENCE POINT AT {where}", ""]
        out.append(
            "                        T1                T2                T3                R1                R2                R3"
        )
        out.append("  " + "".join(f"{_e(v):>18}" for v in (P**2).sum(1) / np.diag(A)))
        out.append("                                                        EFFECTIVE MASS MATRIX")
        out += [f"{'':23}***{'':82}***", *_matrix(P @ P.T), f"{'':23}***{'':82}***"]
        out.append(
            "                                                     A-SET RIGID BODY MASS MATRIX"
        )
        out += [f"{'':23}***{'':82}***", *_matrix(A), f"{'':23}***{'':82}***"]
    head = ["    MODE     FREQUENCY               T1                T2                T3                R1                R2                R3",
            "     NO.", ""]  # fmt: skip
    if "fractions" in tables:
        F = P**2 / np.diag(A)[:, None]
        for words, part in (("TRANSLATIONAL", F[:3]), ("ROTATIONAL", F[3:])):
            both = [
                np.column_stack([part[:, k], part[:, : k + 1].sum(1)]).ravel()
                for k in range(f.size)
            ]
            rows(
                ["                                                    MODAL EFFECTIVE MASS FRACTION",
                 f"                                                (FOR {words} DEGREES OF FREEDOM)", ""],
                ["    MODE    FREQUENCY                      T1                                  T2                                  T3",
                 "     NO.                        FRACTION            SUM             FRACTION            SUM             FRACTION            SUM", ""],
                [f"{k + 1:8d}{_e(f[k]):>16}{''.join(f'{_e(v):>18}' for v in both[k])}" for k in range(f.size)],
            )  # fmt: skip
    for name, title, values in (
        ("factors", "MODAL PARTICIPATION FACTORS", P),
        ("effective", "MODAL EFFECTIVE MASS   ", P**2),
        ("effective", "MODAL EFFECTIVE WEIGHT  ", P**2 * 9.81),
    ):
        if name in tables:
            lines = [
                f"{k + 1:8d}{_e(f[k]):>16}{''.join(f'{_e(v):>18}' for v in values[:, k])}"
                for k in range(f.size)
            ]
            rows([f"{'':53}{title}", ""], head, lines)
            out += [
                f"                  TOTAL  {''.join(f'{_e(v):>18}' for v in values.sum(1))}",
                "",
            ]
    out.append("1                                        * * * END OF JOB * * *")
    path.write_text("\n".join(out).replace("E+", f"{letter}+").replace("E-", f"{letter}-") + "\n")
    return path


@pytest.fixture(scope="session")
def write_f06():
    return f06


def ansys(
    path, frame, *, count=None, mass=True, directions=("X", "Y", "Z", "ROTX", "ROTY", "ROTZ")
):
    """The listing of a modal analysis with its mass summary."""
    f, phi = frame.modes
    f, phi = f[:count], phi[:, :count]
    P = frame.rigid.T @ frame.matrices[1] @ phi
    W = frame.weight
    out = [" *** ANSYS - ENGINEERING ANALYSIS SYSTEM  RELEASE 2021 R2          21.2     ***", ""]
    if mass:
        out += ["                         ***********  PRECISE MASS SUMMARY  ***********", "",
                "   TOTAL RIGID BODY MASS MATRIX ABOUT ORIGIN",
                "               Translational mass               |   Coupled translational/rotational mass"]  # fmt: skip
        out += [
            f"   {''.join(f'{v:14.8G}' for v in W[k, :3])}     | {''.join(f'{v:14.8G}' for v in W[k, 3:])}"
            for k in range(3)
        ]
        out += ["     ------------------------------------------ | ------------------------------------------",
                "                                                |         Rotational mass (inertia)"]  # fmt: skip
        out += [
            f"                                                | {''.join(f'{v:14.8G}' for v in W[k, 3:])}"
            for k in (3, 4, 5)
        ]
        out += [
            "",
            f"   TOTAL MASS =  {W[0, 0]:.5G}",
            "     The mass principal axes coincide with the global axes",
            "",
        ]
    for name in directions:
        k = ("X", "Y", "Z", "ROTX", "ROTY", "ROTZ").index(name)
        what = f"  {name}  " if len(name) == 1 else f"{name} "
        out += [f"          ***** PARTICIPATION FACTOR CALCULATION *****{what}DIRECTION",
                "                                                                                  CUMULATIVE     RATIO EFF.MASS",
                "  MODE   FREQUENCY       PERIOD      PARTIC.FACTOR     RATIO    EFFECTIVE MASS   MASS FRACTION   TO TOTAL MASS"]  # fmt: skip
        top, total = np.abs(P[k]).max(), (P[k] ** 2).sum()
        for i in range(f.size):
            out.append(
                f"{i + 1:6d}  {f[i]:12.8g}  {1 / f[i]:14.5E}  {P[k, i]:13.5G}  {abs(P[k, i]) / top:9.6f}  {P[k, i] ** 2:14.7G}"
                f"  {(P[k, : i + 1] ** 2).sum() / total:13.6G}  {P[k, i] ** 2 / W[k, k]:14.6G}"
            )
        out += [
            " " + "-" * 113,
            f"   sum  {total:70.6G}  {total / W[k, k]:30.6G}",
            " " + "-" * 113,
            "",
        ]
    path.write_text("\n".join(out))
    return path


@pytest.fixture(scope="session")
def write_ansys():
    return ansys


def reduced(frame, keep):
    """Craig-Bampton K and M with the interface first, and the modes kept."""
    K, M = frame.matrices
    b, i = np.flatnonzero(~frame.inside), np.flatnonzero(frame.inside)
    f, phi = frame.modes
    psi = -np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, b)])
    T = np.zeros((K.shape[0], b.size + keep))
    T[b, : b.size] = np.eye(b.size)
    T[np.ix_(i, range(b.size))] = psi
    T[:, b.size :] = phi[:, :keep]
    k, m = T.T @ K @ T, T.T @ M @ T
    return (k + k.T) / 2, (m + m.T) / 2


@pytest.fixture(scope="session")
def craig_bampton():
    return reduced
