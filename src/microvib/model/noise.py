"""Random and angle-dependent friction: torque noise, harmonics and
roughness.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity

MAX_ROWS = 16_384  # of a table of densities, at most
TableRows = tuple[tuple[float, float], ...]
_ROUGHNESS_SIGMAS = 3.0
"""Standard deviations of a roughness that must leave some friction."""
_SEED = Field(ge=0, le=2**63 - 1, strict=True, description="of the random draw")


def density_table_errors(density: float | None, table: TableRows) -> Iterator[str]:
    """Sentences on a density that is to be a number or a table."""
    if (density is None) == (not table):
        yield "density: give either density or table, a file or rows of frequency and density"
    f = [row[0] for row in table]
    if table and not (f[0] > 0.0 and all(a < b for a, b in pairwise(f)) and math.isfinite(f[-1])):
        yield "table: frequencies must be above 0 and ascend"
    if any(not 0.0 <= row[1] < math.inf for row in table):
        yield "table: densities must be at least 0"


def _density_at(
    frequency: np.ndarray, band: tuple[float, float], density: float | None, table: TableRows
) -> np.ndarray:
    """The density at each ``frequency`` (n,); between rows of a table straight in logarithms, 0
    beyond them and the ``band``.
    """
    inside = (frequency > 0.0) & (frequency >= band[0]) & (frequency <= band[1])
    if density is not None:
        return np.where(inside, density, 0.0)
    f, S = np.log(np.maximum(np.array(table), 1e-300)).T
    return np.where(
        inside,
        np.exp(np.interp(np.log(np.maximum(frequency, 1e-300)), f, S, -np.inf, -np.inf)),
        0.0,
    )


def _band(lowest: float, highest: float, table: TableRows) -> tuple[float, float]:
    """Between which frequencies there is noise: those that are given, as far as a table reaches."""
    if table:
        first, last = (table[0][0], table[-1][0])
    else:
        first, last = (0.0, math.inf)
    return max(lowest, first), min(highest, last)


class TorqueNoise(Part):
    """Gaussian torque noise of a friction, with a flat density within a band or the densities of a
    table.
    """

    density: (
        Annotated[
            float,
            Quantity(
                "N^2*m^2/Hz",
                "one-sided power spectral density of the torque",
                ge=0,
                usual=(1e-12, 1e-2),
            ),
        ]
        | None
    ) = None
    table: TableRows = Field(
        default=(),
        max_length=MAX_ROWS,
        description="in place of density: rows of frequency [Hz] and density [N^2*m^2/Hz], or the name of a CSV file",
    )
    lowest: Annotated[float, Quantity("Hz", "lowest frequency of the noise", ge=0)] = 0.0
    highest: (
        Annotated[
            float,
            Quantity("Hz", "highest frequency of the noise; half the sample rate if null", gt=0),
        ]
        | None
    ) = None
    seed: Annotated[int, _SEED] = 1

    def _consistency_errors(self) -> Iterator[str]:
        yield from density_table_errors(self.density, self.table)
        low, high = self.band(math.inf)
        if high <= low:
            yield f"highest: {high:g} Hz is not above lowest, {low:g} Hz; it must be"

    @property
    def silent(self) -> bool:
        """Whether there is no noise at all."""
        return self.density == 0.0 or (self.density is None and not any(S for _, S in self.table))

    def band(self, sample_rate: float) -> tuple[float, float]:
        """Lowest and highest frequency [Hz] in a record of ``sample_rate`` [Hz]."""
        return _band(
            self.lowest, 0.5 * sample_rate if self.highest is None else self.highest, self.table
        )

    def at(self, frequency: np.ndarray, sample_rate: float) -> np.ndarray:
        """Density [N^2 m^2/Hz] at each ``frequency`` (n,) [Hz], in a record of ``sample_rate``
        [Hz].
        """
        return _density_at(frequency, self.band(sample_rate), self.density, self.table)


class FrictionHarmonic(Part):
    """One harmonic of friction over the angle: amplitude x cos(order theta_l + phase), as a part of
    the friction.
    """

    order: Annotated[
        int, Field(ge=1, le=1_000_000, strict=True, description="cycles per turn of the output")
    ]
    amplitude: Annotated[
        float,
        Quantity("", "amplitude, as a fraction of the friction", ge=0, le=1, usual=(1e-5, 0.5)),
    ]
    phase: Annotated[float, Quantity("rad", "phase at theta_l = 0", display="deg")] = 0.0


class Roughness(Part):
    """A random field in angle, the same in every turn: parts of the friction, Gaussian, with a
    given density.
    """

    density: (
        Annotated[
            float,
            Quantity(
                "",
                "one-sided power spectral density per cycle per turn, of parts of the friction",
                ge=0,
                le=1,
            ),
        ]
        | None
    ) = None
    table: TableRows = Field(
        default=(),
        max_length=MAX_ROWS,
        description="in place of density: rows of cycles per turn and density, or the name of a CSV file",
    )
    lowest: Annotated[float, Quantity("", "fewest cycles per turn", ge=0)] = 0.0
    highest: (
        Annotated[
            float,
            Quantity("", "most cycles per turn; the last of the table if null", gt=0, le=1_000_000),
        ]
        | None
    ) = None
    seed: Annotated[int, _SEED] = 1

    def _consistency_errors(self) -> Iterator[str]:
        yield from density_table_errors(self.density, self.table)
        if self.highest is None and not self.table:
            yield "highest: required when density is a number; give the highest number of cycles per turn"
        elif self.band[1] <= self.band[0]:
            yield f"highest: {self.band[1]:g} cycles per turn are not more than lowest, {self.band[0]:g}; they must be"

    @property
    def band(self) -> tuple[float, float]:
        """Fewest and most cycles per turn."""
        return _band(self.lowest, math.inf if self.highest is None else self.highest, self.table)

    def at(self, order: np.ndarray) -> np.ndarray:
        """Density at each ``order`` (n,) [cycles per turn]."""
        return _density_at(order, self.band, self.density, self.table)

    @property
    def deviation(self) -> float:
        """Standard deviation, as a part of the friction: whole cycles per turn alone occur."""
        return math.sqrt(
            float(np.sum(self.at(np.arange(1.0, math.floor(min(self.band[1], 1e6)) + 1.0))))
        )


class FrictionPosition(Part):
    """How friction varies with the shaft's angle: it is multiplied by 1 + harmonics + roughness.
    Assumed, if not measured.
    """

    harmonics: tuple[FrictionHarmonic, ...] = Field(
        default=(), max_length=1000, description="variation over the angle, harmonic by harmonic"
    )
    roughness: Roughness | None = Field(
        default=None, description="random variation over the angle; without it, none"
    )

    def _consistency_errors(self) -> Iterator[str]:
        periodic, random = self._periodic_variation, self._random_variation
        if periodic + random > 1.0:
            yield (
                f"harmonics: amplitudes add up to {periodic:.3g} and {_ROUGHNESS_SIGMAS:g} standard"
                f" deviations of roughness to {random:.3g};"
                " together they must be at most 1, or friction would change its sign"
            )

    @property
    def _periodic_variation(self) -> float:
        return sum(h.amplitude for h in self.harmonics)

    @property
    def _random_variation(self) -> float:
        if self.roughness is None:
            return 0.0
        return _ROUGHNESS_SIGMAS * self.roughness.deviation

    def turned(self, angle: float) -> FrictionPosition:
        """Variation with harmonics counted from another angle of the shaft [rad]."""
        harmonics = tuple(
            h.model_copy(update={"phase": math.remainder(h.phase + h.order * angle, math.tau)})
            for h in self.harmonics
        )
        return self.model_copy(update={"harmonics": harmonics})

    @property
    def largest_factor(self) -> float:
        """Largest factor on the friction at any angle."""
        return 1.0 + self._periodic_variation + self._random_variation

    @property
    def acts(self) -> bool:
        """Whether friction varies at all."""
        return any(h.amplitude > 0.0 for h in self.harmonics) or (
            self.roughness is not None and self.roughness.deviation > 0.0
        )
