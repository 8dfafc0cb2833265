"""Punched results (PCH): forces of constraint of each mode at the clamped interface, SPCFORCES(PUNCH)=ALL."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from microvib.io.nastran.library import lines_of
from microvib.io.nastran.masses import Masses, rigid_mass
from microvib.io.nastran.printed import listed_weight, number
from microvib.structures.deck import Deck, Import
from microvib.structures.modal import ModalError, natural_frequency

_EIGENVALUE = re.compile(r"\$EIGENVALUE\s*=\s*(\S+)\s+MODE\s*=\s*(\d+)")
_FIELDS = ((18, 36), (36, 54), (54, 72))
MAX_MODES = 2000


def read_punched(path: Path, options: Import) -> Deck:
    """Modes from punched forces of constraint at one grid; the rigid-body mass comes from a listing (``options.mass``)."""
    eigenvalue, forces = _forces(lines_of(path))
    if not forces:
        raise ModalError(
            "has neither DMIG entries (EXTSEOUT(DMIGPCH)) nor forces of constraint of modes (SPCFORCES(PUNCH)=ALL)"
        )
    points = sorted({grid for mode in forces.values() for grid, values in mode.items() if any(values)})
    if len(points) != 1:
        raise ModalError(f"has forces of constraint on {len(points)} grids; one, the interface point, is expected")
    if options.mass is None:
        raise ModalError("has no rigid-body mass; give the F06 of the run (mass: FILE.f06)")
    if isinstance(options.interface, int) and options.interface != points[0]:
        raise ModalError(f"interface: forces of constraint are on grid {points[0]}, not on {options.interface}")
    modes = sorted(forces)
    values = np.array([forces[k].get(points[0], [0.0] * 6) for k in modes]).T
    eigen = np.array([eigenvalue[k] for k in modes])
    masses = Masses(None, options.interface, *listed_weight(Path(options.mass)))
    mass, notes = rigid_mass(masses, {}, options.wtmass)
    said = "Participations are forces of constraint over eigenvalues, modes taken as mass-normalised, in axes of the basic frame."
    return Deck(
        natural_frequency(eigen), -values / np.maximum(eigen, 1e-300), mass, options.interface, notes=(said, *notes)
    )


def _forces(lines: Iterable[str]) -> tuple[dict[int, float], dict[int, dict[int, list[float]]]]:
    """Eigenvalue of each mode, and its forces of constraint by grid."""
    eigenvalue: dict[int, float] = {}
    forces: dict[int, dict[int, list[float]]] = {}
    wanted, mode, grid = False, 0, 0
    for line in lines:
        if line.startswith("$"):
            found = _EIGENVALUE.match(line)
            if found:
                mode = int(found[2])
                eigenvalue[mode] = number(found[1])
            elif re.match(r"\$[A-Z]", line) and not re.match(r"\$(REAL|SUBCASE|LABEL|SUBTITLE|TITLE)", line):
                wanted, mode = line.startswith("$SPCF"), 0
        elif wanted and mode:
            values = [number(line[a:b]) for a, b in _FIELDS if line[a:b].strip()]
            if not line.startswith("-CONT-"):
                grid = int(line[:10])
            forces.setdefault(mode, {}).setdefault(grid, []).extend(values)
            if len(forces) > MAX_MODES:
                raise ModalError(f"has more than {MAX_MODES} modes")
    return eigenvalue, forces
