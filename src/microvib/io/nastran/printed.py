"""Modes and masses printed by Nastran (F06) and Ansys, and punched by Nastran (PCH): forces of
constraint of each mode.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from microvib.io.files import as_read_errors, check_file
from microvib.io.nastran.library import lines_of
from microvib.io.nastran.masses import Masses, rigid_mass
from microvib.structures.deck import ORIGIN, Deck, ImportOptions, Point
from microvib.structures.modal import ModalError, natural_frequency
from microvib.structures.modal_checks import check_clamped

MAX_ROWS = 20_000  # rows of a table; no modal analysis prints as many
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))(?:[EeDd]?([-+]\d+)|[EeDd](\d+))?$")
_TITLES: tuple[tuple[str, str], ...] = (
    ("REALEIGENVALUES", "eigenvalues"),
    ("MODALPARTICIPATIONFACTORS", "factors"),
    ("MODALEFFECTIVEMASSFRACTION", "fractions"),
    ("MODALEFFECTIVEMASSSUMMARY", "summary"),
    ("MODALEFFECTIVEMASS", "effective"),
    ("MODALEFFECTIVEWEIGHT", "other"),
    ("A-SETRIGIDBODYMASSMATRIX", "free"),
    ("EFFECTIVEMASSMATRIX", "other"),
    ("OUTPUTFROMGRIDPOINTWEIGHTGENERATOR", "weight"),
    ("OUTPUTFROMWEIGHTCHECK", "weight"),
    ("TOTALRIGIDBODYMASSMATRIXABOUTORIGIN", "ansys-mass"),
    ("*****PARTICIPATIONFACTORCALCULATION*****", "ansys"),
)
"""Titles without their spaces, the first that fits, and the table under them."""
_MAYBE = re.compile("E I G E N|W E I G H T|MODAL|MASS MATRIX|PARTICIPATION")
"""Pattern of a line with a title, which most lines of a listing lack."""
_ANSYS = ("X", "Y", "Z", "ROTX", "ROTY", "ROTZ")
_COUNTED = (
    "eigenvalues",
    "factors",
    "effective",
    "fractions-T",
    "fractions-R",
    *(f"ansys-{d}" for d in _ANSYS),
)
_WIDTHS = {
    "eigenvalues": (7,), "weight": (6,), "free": (6,), "ansys-mass": (6,), "ansys-inertia": (3,),
    **{f"ansys-{d}": (7, 8) for d in _ANSYS},
}  # fmt: skip
"""Numbers in a row of each table, where they are not mode, frequency and six values."""
_WITHIN = (
    "(BEFORE", "(AFTER",
    "MODE", "NO.", "REFERENCE", "DEGREESOFFREEDOM", "MO", "(FOR", "TOTAL", "T1", "CUMULATIVE", "TRANSLATIONALMASS",
)  # fmt: skip
"""How lines within a table start that are not rows of it, without spaces."""


def number(text: str) -> float:
    """A printed number, also with a D exponent or none of either letter (1.0-8); ValueError if it
    is not one.
    """
    found = _NUMBER.match(text.strip())
    if not found:
        raise ValueError(text)
    return float(f"{found[1]}e{found[2] or found[3] or 0}")


@dataclass
class _Tables:
    """Rows of the tables of a listing, by name; a table that starts again is another one."""

    rows: dict[str, list[list[list[float]]]] = field(default_factory=dict)
    reference: int | Point = ORIGIN
    weight_grid: int = 0
    augmented: bool = False  # whether a table of eigenvalues follows that has residual vectors

    def start(self, name: str) -> None:
        self.rows.setdefault(name, []).append([])

    def add(self, name: str, row: list[float]) -> None:
        tables = self.rows.setdefault(name, [[]])
        if len(tables[-1]) > MAX_ROWS:
            raise ModalError(f"a table has more than {MAX_ROWS} rows")
        tables[-1].append(row)

    def last(self, name: str) -> np.ndarray | None:
        """The last table that has rows."""
        full = [t for t in self.rows.get(name, []) if t]
        if not full:
            return None
        width = len(full[-1][0])
        return np.array([row for row in full[-1] if len(row) == width])

    def ends_before(self, name: str, mode: float) -> bool:
        """Whether a row of this mode begins another table: modes are counted up within one."""
        table = self.rows.get(name, [[]])[-1]
        return bool(table) and mode <= table[-1][0]

    def count(self, name: str) -> int:
        return sum(1 for t in self.rows.get(name, []) if t)


def read_listing(path: Path, options: ImportOptions) -> Deck:
    """Modes of a listing: of Nastran's MEFFMASS(ALL) tables, or of Ansys' participation factors."""
    tables = _tables(path)
    if tables.count("ansys-X"):
        return _ansys(tables)
    eigenvalues, augmented = _eigenvalues(tables)
    if eigenvalues is None:
        raise ModalError(
            "has no table of real eigenvalues, nor participation factors of Ansys: is it a modal analysis?"
        )
    frequency, generalised = eigenvalues[:, 4], eigenvalues[:, 5]
    if np.any(generalised <= 0.0):
        raise ModalError(
            "has generalised masses that are not greater than 0: these are not natural modes"
        )
    check_clamped(frequency)
    free = _matrix(tables.last("free"))
    weight = _weight(tables)
    mass, notes = rigid_mass(
        Masses(free, tables.reference, weight, tables.weight_grid), {}, options.wtmass
    )
    participation, signed, said = _participation(
        tables, eigenvalues, mass if free is None else free
    )
    repeated = tables.count("eigenvalues")
    if repeated > 1 and not augmented:
        more = [f"Of {repeated} tables of eigenvalues the last was taken."]
    else:
        more = [augmented]
    return Deck(
        frequency,
        participation,
        mass,
        tables.reference,
        signed=signed,
        notes=(said, *notes, *filter(None, more)),
    )


def _eigenvalues(tables: _Tables) -> tuple[np.ndarray | None, str]:
    """The table of eigenvalues that goes with the effective masses, and which it is where residual
    vectors make two.
    """
    last = tables.last("eigenvalues")
    if last is None or not tables.augmented:
        return last, ""
    full = [np.array(t) for t in tables.rows["eigenvalues"] if t]
    found = next(
        (
            tables.last(name)
            for name in ("factors", "effective", "fractions-T")
            if tables.last(name) is not None
        ),
        None,
    )
    if len(full) > 1 and found is not None and len(found) == len(full[-2]) != len(last):
        return (
            full[-2],
            "Modes before their augmentation with residual vectors, as in the table of"
            " participation.",
        )
    return (
        last,
        "Modes with residual vectors: the highest are shapes that the run added for static loads.",
    )


def listed_weight(path: Path) -> tuple[np.ndarray, int]:
    """Mass matrix of the grid point weight generator in a listing, and the grid to which it refers
    (0: the origin).
    """
    return _listed(path)[:2]


def _listed(path: Path) -> tuple[np.ndarray, int, np.ndarray | None]:
    """``listed_weight``, and the table of eigenvalues where the listing has one."""
    with as_read_errors(path, ModalError):
        check_file(path)
        tables = _tables(path)
        weight = _weight(tables)
        if weight is None:
            raise ModalError(
                "has no output of the grid point weight generator; add PARAM,GRDPNT,0 to the deck"
            )
    return weight, tables.weight_grid, tables.last("eigenvalues")


def _participation(
    tables: _Tables, eigenvalues: np.ndarray, free: np.ndarray
) -> tuple[np.ndarray, bool, str]:
    """Participation (6, s), whether its signs are known, and the sentence that says where it is
    from.
    """
    generalised = eigenvalues[:, 5]
    factors = tables.last("factors")
    if factors is not None:
        values = _matched(factors, eigenvalues, "participation factors")
        return (
            values.T * np.sqrt(generalised),
            True,
            "Participation factors as printed (seven digits).",
        )
    effective = tables.last("effective")
    magnitudes = "magnitudes only, so that only the motion about the drive axis is kept."
    if effective is not None:
        values = _matched(effective, eigenvalues, "effective masses")
        return (
            np.sqrt(np.maximum(values.T, 0.0)),
            False,
            f"Effective masses as printed: {magnitudes}",
        )
    fractions = (
        [t for t in tables.rows.get("fractions-T", []) if t],
        [t for t in tables.rows.get("fractions-R", []) if t],
    )
    if not all(fractions):
        raise ModalError(
            "has no participation factors and no effective masses; ask for MEFFMASS(ALL)=YES"
        )
    parts = [
        _matched(np.array(t[-1]), eigenvalues, "effective mass fractions")[:, ::2]
        for t in fractions
    ]
    values = np.hstack(parts).T * np.diag(free)[:, None]
    return (
        np.sqrt(np.maximum(values, 0.0)),
        False,
        f"Effective mass fractions as printed: {magnitudes}",
    )


def _matched(table: np.ndarray, eigenvalues: np.ndarray, what: str) -> np.ndarray:
    """Six columns of a table of modes; it must be of the same modes as the table of eigenvalues."""
    if len(table) != len(eigenvalues) or not np.allclose(
        table[:, 1], eigenvalues[:, 4], rtol=1e-4, atol=1e-9
    ):
        raise ModalError(
            f"has {len(eigenvalues)} eigenvalues and {len(table)} rows of {what} that do not belong"
            " to each other; is the listing complete, and of a single subcase?"
        )
    return table[:, 2:8]


def _weight(tables: _Tables) -> np.ndarray | None:
    """First table of rigid-body mass: the weight check begins with the whole model."""
    full = [t for t in tables.rows.get("weight", []) if len(t) >= 6]
    if full:
        return _matrix(np.array(full[0][:6]))
    return None


def _matrix(rows: np.ndarray | None) -> np.ndarray | None:
    if rows is not None and rows.shape[0] >= 6 and rows.shape[1] == 6:
        return rows[:6]
    return None


def _ansys(tables: _Tables) -> Deck:
    columns = [tables.last(f"ansys-{name}") for name in _ANSYS]
    if any(c is None for c in columns):
        missing = [name for name, c in zip(_ANSYS, columns, strict=True) if c is None]
        raise ModalError(
            f"has no participation factors in direction {', '.join(missing)}; all six are expected"
        )
    tables_of = [c for c in columns if c is not None]
    if len({c.shape for c in tables_of}) != 1 or tables_of[0].shape[1] < 7:
        raise ModalError(
            "its tables of participation factors differ in length; is the listing complete?"
        )
    blocks = tables.last("ansys-mass"), tables.last("ansys-inertia")
    if (
        blocks[0] is None
        or blocks[1] is None
        or blocks[0].shape != (3, 6)
        or blocks[1].shape != (3, 3)
    ):
        raise ModalError("has no rigid-body mass matrix about the origin (precise mass summary)")
    mass = np.block([[blocks[0][:, :3], blocks[0][:, 3:]], [blocks[0][:, 3:].T, blocks[1]]])
    participation = np.array(
        [np.copysign(np.sqrt(np.maximum(c[:, 5], 0.0)), c[:, 3]) for c in tables_of]
    )
    said = "Ansys' participation factors about the global origin, as printed (five to six digits)."
    return Deck(tables_of[0][:, 1], participation, mass, notes=(said,))


def _tables(path: Path) -> _Tables:
    tables, name = _Tables(), ""
    for line in lines_of(path):
        if not name and not _MAYBE.search(line):
            continue
        squeezed = line.replace(" ", "").strip().upper()
        fresh = _title(squeezed)
        if fresh:
            name = fresh
            if name not in _COUNTED:  # the others go on over pages that repeat their title
                tables.start(name)
        elif name:
            name = _within(line, squeezed, name, tables)
    return tables


def _title(squeezed: str) -> str:
    for start, name in _TITLES:
        if squeezed.startswith(start):
            if name == "ansys":
                direction = squeezed[len(start) :].removesuffix("DIRECTION")
                if direction in _ANSYS:
                    return f"ansys-{direction}"
                return ""
            return name
    return ""


def _within(line: str, squeezed: str, name: str, tables: _Tables) -> str:
    """Takes one line under a title; gives the name of the table that the next line belongs to, ''
    after its end.
    """
    if name in ("fractions", "fractions-T", "fractions-R") and squeezed.startswith("(FOR"):
        if "TRANSLATIONAL" in squeezed:
            return "fractions-T"
        return "fractions-R"
    tables.augmented |= name == "eigenvalues" and squeezed.startswith("(AFTER")
    if "REFERENCEPOINT" in squeezed:
        _refer(squeezed, name, tables)
    if "ROTATIONALMASS(INERTIA)" in squeezed:
        tables.start("ansys-inertia")
        return "ansys-inertia"
    row = _row(line)
    if row is None:
        if name == "summary" or _interrupts_no_table(line, squeezed):
            return name
        return ""
    if len(row) in _WIDTHS.get(name, (8,)):
        if name in _COUNTED and tables.ends_before(name, row[0]):
            tables.start(name)
        tables.add(name, row)
    return name


def _interrupts_no_table(line: str, squeezed: str) -> bool:
    """Whether a line without a row is the head of a page, a frame or a caption, after which the
    table may go on.
    """
    if not squeezed or set(squeezed) <= set("*-|"):
        return True
    at_page_head = line.startswith(("1", "0", " \n", "-")) or "PAGE" in squeezed
    return at_page_head or squeezed.startswith(_WITHIN)


def _refer(squeezed: str, name: str, tables: _Tables) -> None:
    digits = re.search(r"(\d+)\D*$", squeezed)
    if name == "weight":
        tables.weight_grid = int(digits[1]) if digits else 0
    else:
        tables.reference = int(digits[1]) if digits else ORIGIN


def _row(line: str) -> list[float] | None:
    """Numbers of a line that holds nothing else but the frame of a matrix."""
    words = line.replace("*", " ").replace("|", " ").split()
    try:
        return [number(word) for word in words] or None
    except ValueError:
        return None


_EIGENVALUE = re.compile(r"\$EIGENVALUE\s*=\s*(\S+)\s+MODE\s*=\s*(\d+)")
_FIELDS = ((18, 36), (36, 54), (54, 72))
MAX_MODES = 2000


def read_punched(path: Path, options: ImportOptions) -> Deck:
    """Modes from punched forces of constraint at one grid; the rigid-body mass comes from a listing
    (``options.mass``).
    """
    eigenvalue, forces = punched_vectors(path, "$SPCF")
    if not forces:
        raise ModalError(
            "has neither DMIG entries (EXTSEOUT(DMIGPCH)) nor forces of constraint of modes"
            " (SPCFORCES(PUNCH)=ALL)"
        )
    points = sorted(
        {grid for mode in forces.values() for grid, values in mode.items() if any(values)}
    )
    if len(points) != 1:
        raise ModalError(
            f"has forces of constraint on {len(points)} grids; one, the interface point, is"
            " expected"
        )
    if options.mass is None:
        raise ModalError("has no rigid-body mass; give the F06 of the run (mass: FILE.f06)")
    if isinstance(options.interface, int) and options.interface != points[0]:
        raise ModalError(
            f"interface: forces of constraint are on grid {points[0]}, not on {options.interface}"
        )
    weight, grid, listed = _listed(Path(options.mass))
    modes = sorted(forces)
    rows = [forces[k].get(points[0], [0.0] * 6) for k in modes]
    for k, row in zip(modes, rows, strict=True):
        if len(row) > 6:
            raise ModalError(
                f"has forces of constraint of mode {k} twice; those of one subcase are expected"
            )
        if len(row) < 6:
            raise ModalError(
                f"has {len(row)} of the six forces of constraint of mode {k}; is the file complete?"
            )
    values, eigen = np.array(rows).T, np.array([eigenvalue[k] for k in modes])
    mass, notes = rigid_mass(Masses(None, options.interface, weight, grid), {}, options.wtmass)
    size, how = np.ones(len(modes)), "modes taken as mass-normalised"
    if listed is not None:
        size, how = (
            _generalised(modes, eigen, listed, Path(options.mass)),
            "with the generalised masses of the listing",
        )
    P = -values / (np.maximum(eigen, 1e-300) * np.sqrt(size))
    said = f"Participations are forces of constraint over eigenvalues, {how}, in axes of the basic frame."
    return Deck(natural_frequency(eigen), P, mass, options.interface, notes=(said, *notes))


def _generalised(modes: list[int], eigen: np.ndarray, listed: np.ndarray, path: Path) -> np.ndarray:
    """Generalised masses of punched modes in the table of eigenvalues of their listing; ModalError
    where it is of others.
    """
    known = {int(row[0]): row for row in listed}
    lost = next((k for k in known if k < modes[-1] and k not in modes), None)
    if lost is not None:
        raise ModalError(
            f"lacks mode {lost}, which {path.name} has; forces of constraint of all modes are"
            " expected"
        )
    for k, value in zip(modes, eigen, strict=True):
        if k not in known or abs(known[k][2] - value) > 1e-4 * abs(value):
            raise ModalError(
                f"mode {k} is not that of {path.name}; the listing of the same run is expected"
            )
    size = np.array([known[k][5] for k in modes])
    if np.any(size <= 0.0):
        raise ModalError(
            f"{path.name} has generalised masses that are not greater than 0: these are not natural"
            " modes"
        )
    return size


def punched_vectors(
    path: Path, *titles: str
) -> tuple[dict[int, float], dict[int, dict[int, list[float]]]]:
    """Eigenvalue of each mode, and its six values by grid, under the titles of a punched file that
    start so.
    """
    eigenvalue: dict[int, float] = {}
    forces: dict[int, dict[int, list[float]]] = {}
    wanted, mode, grid = False, 0, 0
    for line in lines_of(path):
        if line.startswith("$"):
            found = _EIGENVALUE.match(line)
            if found:
                mode = int(found[2])
                eigenvalue[mode] = number(found[1])
            elif re.match(r"\$[A-Z]", line) and not re.match(
                r"\$(REAL|SUBCASE|LABEL|SUBTITLE|TITLE)", line
            ):
                wanted, mode = line.startswith(titles), 0
        elif wanted and mode:
            values = [number(line[a:b]) for a, b in _FIELDS if line[a:b].strip()]
            if not line.startswith("-CONT-"):
                grid = int(line[:10])
            forces.setdefault(mode, {}).setdefault(grid, []).extend(values)
            if len(forces) > MAX_MODES:
                raise ModalError(f"has more than {MAX_MODES} modes")
    return eigenvalue, forces
