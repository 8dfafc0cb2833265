"""Catalog of component harmonic gears, and what a scenario takes from one."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from microvib.errors import OptionError, quoted_value
from microvib.io.tables import read_table

SOURCE = "makers' engineering data of component harmonic gears (cup type, ratios from 80 on)"
LOWEST, HIGHEST = 80.0, 160.0
"""Ratios that the catalog's stiffnesses are for."""
SPREAD = 0.3
"""Part by which a gear's stiffness may differ from the catalog's, which is an average."""
DAMPING = (0.01, 0.02, 0.05)
"""Damping of the hub on the gear over critical damping, as makers do not state it: low, assumed,
high.
"""
WAVE_GENERATOR = 14, 0.033
"""Size, and moment of inertia [kg cm^2] of the wave generator, from which those of other sizes are
scaled by the fifth power of the size, as of bodies of one shape; assumed."""
INERTIA_SPREAD = 2.0
"""Factor by which it may be smaller or larger: hubs, bores and couplings differ."""
NON_CATALOG_GEARS = ("planetary", "none")
"""Gears that are not of the catalog."""
_GEAR = re.compile(r"\s*size\s+(\d{1,4})(?:[\s,]+ratio\s+(\d{1,6}(?:\.\d{1,6})?))?\s*")


class Entry(NamedTuple):
    """A value of a scenario as its file has it, and what the file says of its source."""

    text: str
    source: str


@dataclass(frozen=True)
class Gear:
    """One size of the catalog. Stiffnesses are for torques up to T1, between T1 and T2, and above."""

    size: int
    stiffnesses: tuple[float, float, float]
    """K1, K2, K3 [N m/rad] at the output."""
    torques: tuple[float, float]
    """T1, T2 [N m]."""
    accuracy: float
    """Bound on the transmission accuracy [arcmin], peak to peak over a turn of the output."""
    hysteresis: float
    """Bound on the hysteresis loss [arcmin]."""

    @property
    def amplitude(self) -> float:
        """Bound on the amplitude of the kinematic error [arcsec at the output]: half of what is
        stated peak to peak.
        """
        return 0.5 * 60.0 * self.accuracy

    @property
    def wave_generator_inertia(self) -> float:
        """Moment of inertia of the wave generator [kg cm^2], assumed."""
        size, inertia = WAVE_GENERATOR
        return inertia * (self.size / size) ** 5

    def entries(self, ratio: float, inertia: float) -> dict[str, Entry]:
        """Dotted key to value and source of a scenario with this gear and ``inertia`` [kg m^2]
        rigidly on its output.

        The stiffness is K1, the kinematic error the largest that the accuracy allows, at two per
        turn of the wave generator; its moment of inertia and the damping are assumed.
        """
        K, T1 = self.stiffnesses[0], self.torques[0]
        low, damping, high = (2.0 * xi * math.sqrt(K * inertia) for xi in DAMPING)
        ends = f"range {(1.0 - SPREAD) * K:g} N*m/rad to {(1.0 + SPREAD) * K:g} N*m/rad"
        error, J_wg = "reducer.transmission_error", self.wave_generator_inertia
        lightest, heaviest = J_wg / INERTIA_SPREAD, J_wg * INERTIA_SPREAD
        return {
            "reducer.ratio": Entry(
                f"{ratio:g}", f"data sheet: component harmonic gear of size {self.size}"
            ),
            "reducer.stiffness": Entry(
                f"{K:g} N*m/rad",
                f"data sheet: K1 of size {self.size}, {SOURCE}, which holds up to T1 = {T1:g} N m:"
                " torques of tracking in"
                f" orbit are far below; above T1 K2 = {self.stiffnesses[1]:g}, above T2 ="
                f" {self.torques[1]:g} N m K3 ="
                f" {self.stiffnesses[2]:g} N m/rad, which are not used; an average, to ±"
                f" {100 * SPREAD:g} %; {ends}",
            ),
            "reducer.damping": Entry(
                f"{damping:.3g} N*m*s/rad",
                f"assumed: {100 * DAMPING[1]:g} % of critical for the hub on the gear,"
                f" {100 * DAMPING[0]:g} to"
                f" {100 * DAMPING[2]:g} %; range {low:.3g} N*m*s/rad to {high:.3g} N*m*s/rad",
            ),
            "reducer.wave_generator_inertia": Entry(
                f"{J_wg:.3g} kg*cm^2",
                f"assumed: of size {self.size}, by the fifth power of the size from"
                f" {WAVE_GENERATOR[1]:g} kg cm² of size"
                f" {WAVE_GENERATOR[0]}; a data sheet states it at the input, with its coupling;"
                f" range {lightest:.3g} kg*cm^2 to"
                f" {heaviest:.3g} kg*cm^2",
            ),
            "reducer.hysteresis": Entry(
                f"{{loss: {self.hysteresis:g} arcmin, stiffness: {K:g} N*m/rad}}", ""
            ),
            error: Entry(
                "", "assumed: two per turn of the wave generator, the usual order; phase 0"
            ),
            f"{error}.0.amplitude": Entry(
                f"{self.amplitude:g} arcsec",
                f"assumed: half of the accuracy of {self.accuracy:g} arcmin peak to peak, a maker's"
                " bound for size"
                f" {self.size}, all of it at this order; range 0 arcsec to {self.amplitude:g}"
                " arcsec",
            ),
        }


@cache
def catalog_gears() -> dict[int, Gear]:
    """Gears of the catalog by their size, the smallest first."""
    rows = [{key: float(text) for key, text in row.items()} for row in read_table("harmonic_gears")]
    gears = (
        Gear(
            size=int(row["size"]),
            stiffnesses=(row["K1_n_m_per_rad"], row["K2_n_m_per_rad"], row["K3_n_m_per_rad"]),
            torques=(row["T1_n_m"], row["T2_n_m"]),
            accuracy=row["accuracy_arcmin"],
            hysteresis=row["hysteresis_arcmin"],
        )
        for row in rows
    )
    return {gear.size: gear for gear in gears}


def find_gear(text: str, ratio: float | None = None) -> tuple[Gear, float]:
    """Gear and ratio of ``size 14 ratio 100``; the ratio may be given apart. OptionError where the
    catalog has no such gear.
    """
    found = _GEAR.fullmatch(str(text).lower())
    sizes = ", ".join(map(str, catalog_gears()))
    if found is None:
        raise OptionError(
            "gear",
            f"{quoted_value(text)} is not a gear; write 'size 14 ratio 100', sizes are {sizes}; or"
            f" of a data sheet {' or '.join(NON_CATALOG_GEARS)}",
        )
    gear = catalog_gears().get(int(found[1]))
    if gear is None:
        raise OptionError(
            "gear",
            f"{quoted_value(text)}: size {found[1]} is not in the catalog; sizes are {sizes}",
        )
    own = float(found[2]) if found[2] else ratio
    if own is None:
        raise OptionError(
            "gear", f"{quoted_value(text)} has no ratio; write 'size {gear.size} ratio 100'"
        )
    if ratio is not None and own != ratio:
        raise OptionError(
            "gear",
            f"{quoted_value(text)} has another ratio than the one given separately, {ratio:g}; give"
            " one ratio",
        )
    if not LOWEST <= own <= HIGHEST:
        raise OptionError(
            "gear",
            f"{quoted_value(text)}: the catalog's stiffnesses are for ratios from {LOWEST:g} to"
            f" {HIGHEST:g}, not {own:g}; give"
            " reducer.stiffness in the file instead",
        )
    return gear, own
