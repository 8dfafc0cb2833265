"""Nastran OP2 (binary results), read with pyyeti: three ways to the participation, whichever the
file allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.files import as_read_errors, check_file
from microvib.io.nastran.craig_bampton import MASS_MATRICES, MAX_MATRIX_SIZE, matrices, normalised
from microvib.io.nastran.library import grid_coordinates, pyyeti, rigid_motion
from microvib.io.nastran.masses import Masses, rigid_mass
from microvib.io.nastran.printed import listed_weight
from microvib.structures.deck import ORIGIN, Deck, ImportOptions, Point
from microvib.structures.modal import ModalError
from microvib.structures.modal_checks import check_clamped


@dataclass(frozen=True)
class Vectors:
    """Grid point results of the modes: (id, direction) of the rows, direction 0 for scalar points,
    and values (n, s).
    """

    rows: list[tuple[int, int]]
    values: np.ndarray


MAX_CLAMPED_MOTION = (
    1e-3  # relative; how much a clamped point may move in a mode (results come in single precision)
)


def read_op2(path: Path, options: ImportOptions) -> Deck:
    """Modes of an OP2 file of PARAM,POST,-1: from MEFFMASS(PLOT), from a mass matrix, or from the
    forces of constraint.
    """
    results = _read(path)
    _check_clamped_there(results, options)
    if results.factors is not None:
        return _from_factors(results, options)
    if results.uset is None:
        raise ModalError("has no geometry (GEOM1, BGPDT, EQEXIN); add PARAM,POST,-1 to the deck")
    matrix = _mass_matrix(results, options)
    if matrix is not None:
        return _from_shapes(results, matrix, options)
    if results.forces is not None:
        return _from_forces(results, results.forces, options)
    if results.shapes is None:
        found = "no eigenvectors"
    else:
        found = "eigenvectors, but no mass matrix and no forces of constraint"
    raise ModalError(
        f"has {found}; ask for SPCFORCES(PLOT)=ALL with PARAM,GRDPNT,0, or MEFFMASS(PLOT), or give"
        " the mass matrix MGG"
        " as OP4 beside it (mass: FILE.op4)"
    )


@dataclass(frozen=True)
class _Results:
    """Data blocks of an OP2 file that matter; ``uset`` is the library's table of degrees of
    freedom.
    """

    frequency: np.ndarray
    generalised: np.ndarray
    uset: Any = None
    shapes: Vectors | None = None
    shapes_basic: bool = False
    forces: Vectors | None = None
    matrix: Any = None
    factors: np.ndarray | None = None
    masses: Masses = field(default_factory=Masses)
    frames: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def grids(self) -> dict[int, np.ndarray]:
        if self.uset is None:
            return {}
        return grid_coordinates(self.uset)

    def deck(
        self,
        participation: np.ndarray,
        mass: np.ndarray,
        notes: Sequence[str],
        about: int | Point = ORIGIN,
    ) -> Deck:
        """The deck with ``participation`` (6, s) and rigid-body ``mass`` (6, 6) ``about`` a point."""
        return Deck(
            self.frequency, participation, mass, about, self.grids, self.frames, notes=tuple(notes)
        )


_VECTORS = {"forces": ("OQG",), "shapes": ("OUG", "OPHIG"), "basic": ("BOUG", "BOPHIG")}
"""How the names of blocks of grid point vectors start; those in the basic frame start with B."""
_WORDS = {b"\x04\0\0\0": "<4", b"\0\0\0\x04": ">4", b"\x08\0\0\0": "<8", b"\0\0\0\x08": ">8"}
"""Byte order and bytes of a word, by the first record's length."""


def read_free_op2(path: Path) -> tuple[np.ndarray, Any, np.ndarray]:
    """Modes of an OP2 file whatever is held: frequencies (s,) [Hz], table of degrees of freedom,
    mass-normalised shapes (n, s).
    """
    results = _read(path, clamped=False)
    if results.uset is None:
        raise ModalError("has no geometry (GEOM1, BGPDT, EQEXIN); add PARAM,POST,-1 to the deck")
    return results.frequency, results.uset, _shapes(results) / np.sqrt(results.generalised)


def _read(path: Path, *, clamped: bool = True) -> _Results:
    with path.open("rb") as stream:
        word = _WORDS.get(stream.read(4))
    if word is None:
        raise ModalError("is not an OP2 file; such a file starts with a record of 4 or 8 bytes")
    with _reader()(str(path)) as file:
        wanted = _wanted(file)
        data: dict[str, Any] = file.rdparampost(get_mats=wanted or False, get_dr_tables=False)
        if data.get("ogpwg"):
            file.set_position("OGPWG")
            file.rdop2nt()
            data["gpwg_grid"] = int(file.rdop2record("int")[2])
        for kind, starts in _VECTORS.items():
            name = next(
                (n for start in starts for n in file.dbdct if n.upper().startswith(start)), None
            )
            if name is None:
                data[kind] = None
            else:
                data[kind] = read_vectors(file, name, word)
    return _results(data, clamped)


@cache
def _reader() -> Any:
    """The library's reader, which here also takes the table of grids of Siemens' Nastran."""

    class Reader(pyyeti("op2").OP2):  # type: ignore[misc]
        def _rdop2bgpdt68(self) -> np.ndarray:
            """Places of the grids: four words a grid (MSC), or six whole numbers and three double
            ones (Siemens, older MSC).
            """
            here = self._fileh.tell()
            size = len(self.rdop2record("bytes"))
            after = self._fileh.tell()
            points = self._points()
            self._fileh.seek(here)
            short, long = self._ibytes + 3 * self._fbytes, 6 * self._ibytes + 24
            if points and size == points * long != points * short:
                rows = self._rdop2bgpdt()
                kind = np.dtype([("ints", self._intstr), ("xyz", (f"{self._endian}f8", 3))])
                table = np.empty(len(rows), kind)
                table["ints"], table["xyz"] = rows["ints"][:, 0], rows["xyz"]
                self._fileh.seek(after)
                self.goto_next()
                return table
            if points and size != points * short:
                words = size / points / self._ibytes
                raise ModalError(
                    f"has {words:.4g} words for each of {points} grids in BGPDT; 4 or 12 are read"
                )
            found: np.ndarray = super()._rdop2bgpdt68()
            return found

        def _points(self) -> int:
            """Grids and scalar points of the file, by its list of their numbers; 0 without."""
            name = next((name for name in ("EQEXINS", "EQEXIN") if name in self.dbdct), None)
            if name is None:
                return 0
            here = self._fileh.tell()
            self.set_position(name)
            self.rdop2nt()
            points = len(self.rdop2record("int")) // 2
            self._fileh.seek(here)
            return points

        def _rdcstm(self, verbose: bool) -> np.ndarray | None:
            """Coordinate systems, where the table is of the known kind; those of the bulk data are
            taken else.
            """
            try:
                found: np.ndarray | None = super()._rdcstm(verbose)
            except ValueError:
                return None
            for row in [] if found is None else found[found[:, 0] > 0]:
                axes = row[5:].reshape(3, 3)
                if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-3):
                    return None
            return found

    return Reader


def read_vectors(file: Any, name: str, word: str) -> Vectors | None:
    """Real eigenvectors or forces of constraint; None where the block holds other results.

    ``file`` is the library's open file, ``word`` the byte order and bytes of its words, such as <4.
    """
    row = np.dtype([("key", f"{word[0]}i{word[1]}", 2), ("value", f"{word[0]}f{word[1]}", 6)])
    file.set_position(name)
    file.rdop2nt()
    columns: list[np.ndarray] = []
    keys: np.ndarray = np.empty((0, 2), dtype=int)
    while (ident := file.rdop2record("int")) is not None:
        data = file.rdop2record("bytes")
        if ident[0] // 10 != 2 or ident[9] != 8 or len(data) % row.itemsize:
            return None  # no real modes, or a wide format
        table = np.frombuffer(data, row)
        if columns and not np.array_equal(table["key"], keys):
            raise ModalError(f"{name} has other points in mode {len(columns) + 1} than before")
        keys = table["key"]
        columns.append(table["value"])
    if not columns:
        return None
    grid = np.repeat(keys[:, 1] == 1, 6)
    direction = np.tile(np.arange(1, 7), len(keys))
    kept = grid | (direction == 1)
    ids = np.repeat(keys[:, 0] // 10, 6)
    rows = [
        (int(i), int(d)) for i, d in zip(ids[kept], np.where(grid, direction, 0)[kept], strict=True)
    ]
    return Vectors(rows, np.array([c.ravel()[kept] for c in columns], dtype=float).T)


def places_of(uset: Any, vectors: Vectors) -> np.ndarray:
    """Rows of the table of degrees of freedom where the rows of the results are; -1 where they are
    not.
    """
    order = {(int(i), int(d)): k for k, (i, d) in enumerate(uset.index)}
    return np.array([order.get(row, -1) for row in vectors.rows])


def _wanted(file: Any) -> list[str]:
    """Names of the matrices to read, where they are not too large."""
    names = {name.upper() for name in file.dbdct}
    if not any(name.startswith("LAMA") for name in names):
        raise ModalError(
            "has no table of eigenvalues (LAMA); it holds"
            f" {', '.join(sorted(names)[:12]) or 'nothing'}; a run of SOL 103"
            " with PARAM,POST,-1 is expected"
        )
    wanted = [n for n in names if n.lower() in MASS_MATRICES or n.startswith(("MPFACS", "RBMASS"))]
    for name in wanted:
        rows, columns = file.dbdct[name][-1].size
        if 8 * rows * columns > MAX_MATRIX_SIZE:
            raise ModalError(
                f"{name} is {rows} x {columns}, too large; give it as OP4, or use"
                " SPCFORCES(PLOT)=ALL"
            )
    return wanted


def _results(data: dict[str, Any], clamped: bool) -> _Results:
    lama = np.asarray(_named(data, "lama"), dtype=float)
    if lama.ndim != 2 or not lama.size or np.any(lama[:, 5] <= 0.0):
        raise ModalError(
            "its table of eigenvalues (LAMA) is empty, or has generalised masses not greater than 0"
        )
    forces, shapes, basic = (data[kind] for kind in _VECTORS)
    if clamped:
        check_clamped(lama[:, 4])
    systems = {
        int(k): np.asarray(v, dtype=float) for k, v in (data.get("cstm2") or {}).items() if k > 0
    }
    free, weight = _named(data, "rbmass"), data.get("ogpwg")
    return _Results(
        lama[:, 4], lama[:, 5], data.get("uset"), basic if shapes is None else shapes, shapes is None and basic is not None,
        forces, _named(data, *MASS_MATRICES), _named(data, "mpfacs"),
        Masses(
            None if free is None else np.asarray(free, dtype=float),
            whole=np.asarray(weight["m66"], dtype=float) if weight else None, whole_grid=data.get("gpwg_grid", 0),
        ),
        {k: v[2:] for k, v in systems.items() if v[0, 1] == 1},
    )  # fmt: skip


def _named(data: dict[str, Any], *starts: str) -> Any:
    for start in starts:
        for key, value in data.items():
            if key.startswith(start) and value is not None and value.shape[0]:
                return value
    return None


def _masses(results: _Results, options: ImportOptions) -> Masses:
    """The masses of the file, or the weight of the whole model from a listing beside it."""
    own = results.masses
    if options.mass is None or options.mass.lower().endswith(".op4"):
        return replace(own, reference=options.reference)
    return Masses(own.free, options.reference, *listed_weight(Path(options.mass)))


def _from_factors(results: _Results, options: ImportOptions) -> Deck:
    factors = np.asarray(results.factors, dtype=float)
    if factors.shape[0] != 6:
        factors = factors.T
    if factors.shape != (6, results.frequency.size):
        raise ModalError(
            f"MPFACS is {factors.shape}, which is not six directions by {results.frequency.size}"
            " modes"
        )
    mass, notes = rigid_mass(_masses(results, options), results.grids, options.wtmass)
    if options.reference == (0.0, 0.0, 0.0):
        where = "the origin of the basic frame"
    else:
        where = f"{options.reference}"
    said = f"Participation factors of MEFFMASS, declared to refer to {where}."
    return results.deck(
        factors * np.sqrt(results.generalised), mass, (said, *notes), options.reference
    )


def _from_forces(results: _Results, forces: Vectors, options: ImportOptions) -> Deck:
    """Rigid-body sum of the forces of constraint is -lambda times the participation, for any mass
    matrix (Eq. 13).
    """
    if forces.values.shape[1] != results.frequency.size:
        raise ModalError(
            f"has forces of constraint for {forces.values.shape[1]} of {results.frequency.size}"
            " modes"
        )
    held = results.uset[results.uset.index.get_level_values(0).isin([i for i, _ in forces.rows])]
    rows = places_of(held, forces)
    if np.any(rows < 0):
        raise ModalError("has forces of constraint on points that are not in its geometry")
    _check_held(forces, options)
    eigenvalue = (2.0 * np.pi * results.frequency) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        P = -(rigid_motion(held)[rows].T @ forces.values) / (
            eigenvalue * np.sqrt(results.generalised)
        )
    masses = replace(_masses(results, options), free=None, reference=ORIGIN)
    mass, notes = rigid_mass(masses, results.grids, options.wtmass)
    said = "Participations are the forces of constraint of each mode over its eigenvalue."
    return results.deck(P, mass, (said, *notes))


def _check_held(forces: Vectors, options: ImportOptions) -> None:
    """Nothing but the interface point may hold the model; where it is not a grid, all clamped grids
    are the interface.
    """
    ids, size = np.array([i for i, _ in forces.rows]), np.abs(forces.values).max(axis=1)
    if not isinstance(options.interface, int) or options.interface not in ids:
        return  # several clamped grids are the interface together
    others = sorted(
        set(ids[(ids != options.interface) & (size > MAX_CLAMPED_MOTION * size.max())].tolist())
    )
    if others:
        raise ModalError(
            f"grid {others[0]} is constrained, too ({len(others)} grids beside "
            f"{options.interface}); modes with only the interface clamped are expected, and "
            "where that is several grids, its coordinates"
        )


def _from_shapes(results: _Results, matrix: Any, options: ImportOptions) -> Deck:
    phi, R = _shapes(results), rigid_motion(results.uset)
    if matrix.shape != (R.shape[0], R.shape[0]):
        raise ModalError(
            f"mass matrix is {matrix.shape}, but the model has {R.shape[0]} degrees of freedom"
            " (G-set)"
        )
    phi, own, off = normalised(phi, matrix)
    notes = [
        f"Participations are phi^T M R of the G-set; eigenvectors are orthogonal in M to {off:.1g}."
    ]
    if np.abs(own - 1.0).max() > 1e-3:
        notes.append("The eigenvectors were not mass-normalised; they have been.")
    mass = R.T @ (matrix @ R)
    return results.deck(
        R.T @ (matrix @ phi), mass, (*notes, *_against_weight(mass, results, options))
    )


def _against_weight(mass: np.ndarray, results: _Results, options: ImportOptions) -> list[str]:
    """Grid point weight generator against the mass matrix."""
    if results.masses.whole is None:
        return []
    ratio = options.wtmass * np.trace(results.masses.whole[:3, :3]) / np.trace(mass[:3, :3])
    if abs(ratio - 1.0) <= 0.01:
        return []
    return [
        f"The grid point weight generator gives {ratio:.4g} times the mass of the mass matrix:"
        " PARAM,WTMASS, or another model?"
    ]


def _shapes(results: _Results) -> np.ndarray:
    """Eigenvectors of the G-set in the output coordinate systems of its grids, (n, s)."""
    shapes, index = results.shapes, results.uset.index
    if shapes is None:
        raise ModalError(
            "has no eigenvectors (OUG); add DISPLACEMENT(PLOT)=ALL to its case control"
        )
    places = places_of(results.uset, shapes)
    missing = len(index) - np.unique(places[places >= 0]).size
    if missing or shapes.values.shape[1] != results.frequency.size:
        raise ModalError(
            f"has eigenvectors of {shapes.values.shape[1]} of {results.frequency.size} modes,"
            f" without {missing} of"
            f" {len(index)} degrees of freedom; DISPLACEMENT(PLOT)=ALL is expected"
        )
    values = np.zeros((len(index), shapes.values.shape[1]))
    values[places[places >= 0]] = shapes.values[places >= 0]
    if not results.shapes_basic:
        return values
    turns = rigid_motion(results.uset)
    for k in np.flatnonzero(index.get_level_values(1) == 1):
        turn = turns[k : k + 3, :3]  # from the basic frame to the grid's own
        values[k : k + 3], values[k + 3 : k + 6] = (
            turn @ values[k : k + 3],
            turn @ values[k + 3 : k + 6],
        )
    return values


def _check_clamped_there(results: _Results, options: ImportOptions) -> None:
    """The interface's grid, where it is one, is held, as far as shapes or forces of constraint
    tell.
    """
    grid = options.interface
    if not isinstance(grid, int) or grid not in results.grids:
        return  # said where the interface point is looked for
    if results.shapes is None:
        told = []
    else:
        told = [k for k, (i, d) in enumerate(results.shapes.rows) if i == grid and d]
    if results.shapes is not None and told:
        phi, places = results.shapes.values, np.array(list(results.grids.values()))
        turns = np.array([results.shapes.rows[k][1] > 3 for k in told])[:, None]
        motion = np.abs(phi[told]) * np.where(turns, max(np.ptp(places, axis=0).max(), 1e-30), 1.0)
        moves = motion.max(axis=0) / np.maximum(np.abs(phi).max(axis=0), 1e-300)
        if moves.max() > MAX_CLAMPED_MOTION:
            k = int(moves.argmax())
            raise ModalError(
                f"interface: grid {grid} moves in mode {k + 1} by {moves[k]:.2g} of the largest"
                " motion; modes with the"
                " interface point clamped are expected"
            )
    _check_carries(results, grid)


def _check_carries(results: _Results, grid: int) -> None:
    """ModalError for a grid that carries no forces of constraint where the file has any: it is
    loose, or not held.
    """
    if results.forces is None:
        return
    ids = np.array([i for i, _ in results.forces.rows])
    size = np.abs(results.forces.values).max(axis=1, initial=0.0)
    held = sorted(set(ids[size > MAX_CLAMPED_MOTION * max(size.max(initial=0.0), 1e-300)].tolist()))
    if grid not in held:
        raise ModalError(
            f"interface: grid {grid} is not constrained, but {_listed(held)}: it carries no forces of"
            " constraint in any mode; the grid"
            " that is clamped is expected, and where several are, coordinates"
        )


def _listed(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids[:6])) + (" ..." if len(ids) > 6 else "")


def _mass_matrix(results: _Results, options: ImportOptions) -> Any:
    if options.mass is None or not options.mass.lower().endswith(".op4"):
        return results.matrix
    other = Path(options.mass)
    with as_read_errors(other, ModalError):
        check_file(other)
        found = matrices(other, MASS_MATRICES)
        if not found:
            raise ModalError(
                f"has no mass matrix; expected one of {', '.join(MASS_MATRICES).upper()}"
            )
    return next(iter(found.values()))
