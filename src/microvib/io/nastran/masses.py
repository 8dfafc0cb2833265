"""Which of the rigid-body masses that a run gives is meant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from microvib.model.rigid import rigid_motions
from microvib.structures.deck import ORIGIN, Point
from microvib.structures.modal import ModalError

MASS_RATIO_RANGE = (0.999, 1.5)
"""Mass of the whole model over that of its free degrees of freedom: mass on clamped points explains
no more.
"""


@dataclass(frozen=True)
class Masses:
    """Rigid-body mass matrices of a file, in its units, (6, 6) each."""

    free: np.ndarray | None = (
        None  # of the free degrees of freedom (A-set of MEFFMASS), about ``reference``
    )
    reference: int | Point = ORIGIN
    whole: np.ndarray | None = (
        None  # of the whole model (grid point weight generator), about ``whole_grid``
    )
    whole_grid: int = 0  # a grid id; 0 is the origin of the basic frame


def rigid_mass(
    masses: Masses, grids: Mapping[int, np.ndarray], wtmass: float
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Mass matrix about the reference point with what is to be said of it; the whole model's where
    it is known.
    """
    whole, free = _about_reference(masses, grids, wtmass), masses.free
    if whole is None:
        if free is None:
            raise ModalError(
                "has no rigid-body mass about the reference point; add PARAM,GRDPNT,0 or"
                " MEFFMASS(ALL)=YES to the deck"
            )
        return free, (
            "Rigid-body mass is that of the free degrees of freedom: mass on clamped points is"
            " missing.",
        )
    if free is None:
        return whole, ()
    ratio = float(np.trace(whole[:3, :3]) / max(np.trace(free[:3, :3]), 1e-300))
    if MASS_RATIO_RANGE[0] <= ratio <= MASS_RATIO_RANGE[1]:
        return whole, ()
    return free, (
        f"The grid point weight generator gives {ratio:.4g} times the mass of the free degrees of"
        " freedom; is PARAM,WTMASS"
        " (option wtmass) missing? The mass of the free degrees of freedom is used.",
    )


def _about_reference(
    masses: Masses, grids: Mapping[int, np.ndarray], wtmass: float
) -> np.ndarray | None:
    if masses.whole is None:
        return None
    if (masses.whole_grid or ORIGIN) == masses.reference:
        return wtmass * masses.whole
    places = [
        grids.get(p) if isinstance(p, int) else np.array(p)
        for p in (masses.whole_grid or ORIGIN, masses.reference)
    ]
    if places[0] is None or places[1] is None:
        return None
    motion = rigid_motions(places[0][None], places[1])
    return wtmass * (motion.T @ masses.whole @ motion)
