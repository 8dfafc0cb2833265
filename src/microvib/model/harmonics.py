"""Harmonics of a motor over its electrical angle: of the flux linkages and of the detent torque."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, NamedTuple

from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity

HIGHEST_FLUX_ORDER = 25


class FluxHarmonic(Part):
    """One harmonic of a phase's flux rate, over the torque constant: amplitude x sin(order p +
    phase), beside sin p.

    p = z theta_m is the electrical angle of the rotor. Torque over current and back-EMF over rate
    are both that rate. Halves of an electrical turn are alike but for their sign, so that orders are
    odd.
    """

    order: Annotated[
        int,
        Field(
            ge=3,
            le=HIGHEST_FLUX_ORDER,
            strict=True,
            description="cycles per electrical turn; odd",
        ),
    ]
    amplitude: Annotated[
        float,
        Quantity("", "amplitude over the torque constant", ge=-0.99, le=0.99, usual=(1e-5, 0.3)),
    ]
    phase: Annotated[float, Quantity("rad", "phase at zero angle of phase A", display="deg")] = 0.0

    def _consistency_errors(self) -> Iterator[str]:
        if self.order % 2 == 0:
            yield (
                f"order: {self.order} is not allowed; an odd order from 3 to {HIGHEST_FLUX_ORDER} is"
                " expected, since a winding's flux changes sign after half an electrical turn"
            )


class DetentHarmonic(Part):
    """One harmonic of the detent torque: amplitude x sin(order p + phase) against the rotor, p = z
    theta_m.
    """

    order: Annotated[
        int, Field(ge=1, le=1000, strict=True, description="cycles per electrical turn")
    ]
    amplitude: Annotated[float, Quantity("N*m", "amplitude", ge=0, usual=(1e-6, 2.0))]
    phase: Annotated[float, Quantity("rad", "phase at zero rotor angle", display="deg")] = 0.0


class AxisHarmonic(NamedTuple):
    """A harmonic of the flux rates of the two axes, -k_A/K_m and k_B/K_m: amplitude x sin(order p +
    phase) and sequence x amplitude x cos(order p + phase).
    """

    order: int
    amplitude: float
    phase: float
    sequence: int
    """1 where it turns with the fundamental, -1 where it turns against it."""

    @property
    def torque_order(self) -> int:
        """Cycles per electrical turn of its torque with currents that follow the rotor."""
        return self.order - self.sequence


def sequence(order: int, phases: int) -> int:
    """How a harmonic of each phase's flux appears in the two axes: 1 turns with the fundamental, -1
    against it, 0 is not there.

    Phases are turned by 2 pi/phases, those of two by pi/2. Of more phases what is not there is in
    the zero sequence, which a star without neutral does not carry (orders 3, 9 ... of three phases,
    5, 15 ... of five), or in the second plane of five (3, 7, 13, 17 ...), which has no current of
    sinusoidal references.
    """
    symmetry = 4 if phases == 2 else phases
    if order % symmetry == 1:
        return 1
    if order % symmetry == symmetry - 1:
        return -1
    return 0


def axis_harmonics(harmonics: Iterable[FluxHarmonic], phases: int) -> tuple[AxisHarmonic, ...]:
    """Harmonics that act in the two axes, by their order."""
    found = (
        AxisHarmonic(h.order, h.amplitude, h.phase, sequence(h.order, phases)) for h in harmonics
    )
    return tuple(sorted(h for h in found if h.amplitude and h.sequence))


def repeated_order(harmonics: Iterable[FluxHarmonic | DetentHarmonic]) -> int | None:
    """An order that is given more than once; None where all differ."""
    seen: set[int] = set()
    for harmonic in harmonics:
        if harmonic.order in seen:
            return harmonic.order
        seen.add(harmonic.order)
    return None
