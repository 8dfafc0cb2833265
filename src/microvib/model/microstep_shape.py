"""Microsteps made in parts: input shaping of the references by their times (ZV, ZVD and others)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np

from microvib.model.part import Part
from microvib.units import Quantity

MAX_PARTS = 16
"""Parts of a microstep, at most."""
_WHOLE = 1e-6  # by how much fractions may miss their sum


class MicrostepPart(Part):
    """One part of a microstep: the fraction of the way that the references go, and when."""

    fraction: (
        Annotated[
            float,
            Quantity(
                "",
                "fraction of the way from the references before the microstep to those after it;"
                " null, allowed in the first part, is what the others leave",
                gt=0,
                le=1,
            ),
        ]
        | None
    ) = None
    after: Annotated[
        float, Quantity("s", "time since the microstep", ge=0, le=10, display="ms")
    ] = 0.0


class MicrostepShape(NamedTuple):
    """The parts of a microstep: a single one, at once, of an ordinary microstep."""

    fractions: tuple[float, ...] = (1.0,)
    """Fractions of the way, (n,), which add up to 1."""
    after: tuple[float, ...] = (0.0,)
    """Times [s] since the microstep, (n,), increasing."""

    @property
    def lasts(self) -> float:
        """Time [s] from the microstep to its last part."""
        return self.after[-1]

    def spectrum(self, frequency: np.ndarray) -> np.ndarray:
        """Factor by which the parts multiply what the microsteps make at each ``frequency`` of (n,)
        [Hz], complex, (n,): sum of fraction x exp(-2 pi j f after).
        """
        phases = np.exp(-2j * np.pi * np.multiply.outer(frequency, self.after))
        return np.asarray(phases @ np.array(self.fractions))


def shape_of(parts: Sequence[MicrostepPart]) -> MicrostepShape:
    """The shape by its parts; without any, that of an ordinary microstep."""
    if not parts:
        return MicrostepShape()
    further = [part.fraction or 0.0 for part in parts[1:]]
    return MicrostepShape((1.0 - sum(further), *further), tuple(part.after for part in parts))


def shape_errors(parts: Sequence[MicrostepPart]) -> Iterator[str]:
    """Sentences on parts that do not go together, which begin with the key."""
    if len(parts) == 1:
        yield "microstep_shape: has one part; two at least are expected, or leave it out for an ordinary microstep"
        return
    if parts and parts[0].after != 0.0:
        yield (
            f"microstep_shape.0.after: {1e3 * parts[0].after:g} ms is not allowed; the first part comes"
            " with the microstep, 0 ms (driver.delay delays all)"
        )
    for k, (one, following) in enumerate(pairwise(parts)):
        if following.after <= one.after:
            yield (
                f"microstep_shape.{k + 1}.after: {1e3 * following.after:g} ms is not after the part before,"
                f" at {1e3 * one.after:g} ms; give the parts in the order of their times"
            )
    for k, part in enumerate(parts[1:], 1):
        if part.fraction is None:
            yield f"microstep_shape.{k}.fraction: missing; only the first part may leave it out"
            return
    total = sum(part.fraction or 0.0 for part in parts)
    if parts and parts[0].fraction is None and total >= 1.0:
        yield f"microstep_shape: the fractions after the first part add up to {total:g}; less than 1 is expected"
    elif parts and parts[0].fraction is not None and abs(total - 1.0) > _WHOLE:
        yield f"microstep_shape: the fractions add up to {total:.7g}; 1 is expected"
