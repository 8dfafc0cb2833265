"""Friction that gives before it slides: elements of a generalised Maxwell-slip, from two figures or
from a measured loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import Field

from microvib.model.noise import MAX_ROWS, TableRows
from microvib.model.part import Part
from microvib.units import Quantity

LEVEL_TOLERANCE = 0.05
"""Part of the limit by which a loop that levels may miss it."""
_SLIDING_DETECTION_LIMIT = 0.8
"""Part of the reach of a loop up to which an element is seen to slide; later ones look like one
that does not.
"""
_CANDIDATES, _ROWS = (
    200,
    1000,
)  # elements among which a loop chooses, and rows of it that are looked at


class Presliding(Part):
    """Friction with memory before it slides: elements side by side, each a spring up to its share
    of the limit.

    Generalised Maxwell-slip (F. Al-Bender, V. Lampaert, J. Swevers, IEEE Trans. Automatic Control
    50 (11), 2005) without the elements' own attraction: one that slips is at its limit. Elements
    give way one after another, at angles in a geometric row. A stiffness makes them, or a measured
    loop of torque over angle.
    """

    stiffness: (
        Annotated[
            float,
            Quantity(
                "N*m/rad",
                "initial stiffness of the sticking contact",
                "k_0",
                gt=0,
                usual=(1e-3, 1e7),
            ),
        ]
        | None
    ) = None
    breakaway_angle: (
        Annotated[
            float,
            Quantity(
                "rad",
                "angle from rest at which gross sliding begins",
                gt=0,
                display="arcsec",
                usual=(1e-7, 0.1),
            ),
        ]
        | None
    ) = None
    elements: Annotated[int, Field(ge=1, le=10, strict=True, description="number of elements")] = 6
    loop: TableRows = Field(
        default=(),
        max_length=MAX_ROWS,
        description="in place of stiffness: rows of angle [rad] and torque [N m] as measured, or the name of a CSV file",
    )

    def _consistency_errors(self) -> Iterator[str]:
        if (self.stiffness is None) == (not self.loop):
            yield "stiffness: give either stiffness or loop, a file or rows of angle and torque"
        elif self.loop and self.breakaway_angle is not None:
            yield "breakaway_angle: a measured loop already defines gross sliding; leave it out"

    def split(self, limit: float) -> tuple[tuple[float, float], ...]:
        """Stiffness [N m/rad] and share of the ``limit`` [N m] of each element; ValueError where
        the two do not go together.
        """
        if self.stiffness is None:
            return loop_elements(self.loop, limit, self.elements)
        return maxwell_elements(self.stiffness, limit, self.elements, self.breakaway_angle)


def maxwell_elements(
    stiffness: float, limit: float, count: int, angle: float | None = None
) -> tuple[tuple[float, float], ...]:
    """Stiffness [N m/rad] and share of the limit of ``count`` elements: ``stiffness`` together, all
    sliding at ``angle`` [rad].

    ``limit`` [N m] is what they transmit then; the angle is four times that over the stiffness if
    not given. Raises ValueError where the angle does not go with stiffness and limit.
    """
    from scipy.optimize import brentq  # imported when needed: it takes half a second

    elastic = limit / stiffness
    angle = angle or (elastic if count == 1 else 4.0 * elastic)
    if count == 1:
        if abs(angle / elastic - 1.0) > 1e-6:
            raise ValueError(
                f"one element slides at {elastic:.4g} rad; give that breakaway_angle or more"
                " elements"
            )
        return ((stiffness, 1.0),)
    if angle <= elastic * (1.0 + 1e-9):
        raise ValueError(
            f"breakaway_angle is {angle:.4g} rad; it must be above {elastic:.4g} rad, the breakaway"
            " torque over the stiffness"
        )
    ends = np.geomspace(min(angle / count, 0.5 * elastic), angle, count)
    falls = np.linspace(1.0, 0.0, count + 1)[:-1]

    def short_of(
        power: float,
    ) -> float:  # the slope falls from k_0 to 0 so that the limit is reached at the angle
        return stiffness * float(np.sum(falls**power * np.diff(ends, prepend=0.0))) - limit

    slopes = stiffness * falls ** brentq(short_of, 0.0, 1e4)
    each = -np.diff(slopes, append=0.0)
    return tuple(
        (float(k), float(k * end / limit)) for k, end in zip(each, ends, strict=True) if k > 0.0
    )


def quasi_static_torque(
    memory: tuple[tuple[float, float], ...], limit: float, angles: np.ndarray
) -> np.ndarray:
    """Torque [N m] of elements along slow ``angles`` (n,) [rad], the first of which finds them
    relaxed, (n,).
    """
    stiffness, share = np.array(memory).T
    slides = share * limit / stiffness
    return np.asarray(elongations(angles, slides, 0.0 * slides) @ stiffness)


@lru_cache(maxsize=8)
def loop_elements(loop: TableRows, limit: float, count: int) -> tuple[tuple[float, float], ...]:
    """Stiffness [N m/rad] and share of the ``limit`` [N m] of at most ``count`` elements that make
    a measured ``loop``.

    Rows of angle [rad] and torque [N m] in the order of time. A loop that closes (both ends and the
    first of them again) counts from its first end, about its own mean torque; anything else begins
    with a shaft at rest without torque. What the loop does not break away is one more element, up
    to the limit. ValueError where the two do not go together.
    """
    from scipy.optimize import nnls  # imported when needed: it takes half a second

    angle, torque, closed = _counted_branch(loop)
    reach = np.abs(angle - angle[0]).max() * (0.5 if closed else 1.0)
    finest = max(
        1e-3 * reach, float(np.median(np.abs(np.diff(angle))))
    )  # what slides within a row is not seen
    slides = np.geomspace(min(finest, 0.5 * reach), _SLIDING_DETECTION_LIMIT * reach, _CANDIDATES)
    if closed:
        first = np.copysign(np.minimum(slides, reach), angle[0] - angle.mean())
    else:
        first = 0.0 * slides
    held = angle - angle[0] + (np.copysign(reach, first[0]) if closed else 0.0)
    mean = np.outer(np.ones(angle.size), [1.0, -1.0] if closed else [])
    columns = np.column_stack(
        [elongations(angle, slides, first) / slides, held / reach, mean]
    )  # of one size
    found = nnls(columns, torque)[0]
    force, rest = zip(found[:_CANDIDATES] / slides, slides, strict=True), found[_CANDIDATES] / reach
    elements = _merge_elements(
        [(float(k), float(x)) for k, x in force if k > 0.0], count - (rest > 0.0)
    )
    return _shares_of_limit(limit, elements, float(rest), reach)


def elongations(angle: np.ndarray, slides: np.ndarray, first: np.ndarray) -> np.ndarray:
    """By how much elements are stretched [rad] along ``angle`` (n,) that slide when stretched by
    ``slides`` (m,), (n, m).
    """
    stretch, found = np.array(first), []
    for turn in np.diff(angle, prepend=angle[0]):
        stretch = np.clip(stretch + turn, -slides, slides)
        found.append(stretch)
    return np.array(found)


def _counted_branch(loop: TableRows) -> tuple[np.ndarray, np.ndarray, bool]:
    """Angle and torque of a loop from where they count, thinned, and whether it closes."""
    angle, torque = np.array(loop, dtype=float).reshape(-1, 2).T
    if angle.size:
        span = float(np.ptp(angle))
    else:
        span = 0.0
    if angle.size < 5 or not np.all(np.isfinite([angle, torque])) or span == 0.0:
        raise ValueError(
            "loop: at least 5 rows are expected, all finite, of a shaft that is turned"
        )
    ends = [
        np.flatnonzero(side * angle >= np.max(side * angle) - 0.02 * span) for side in (1.0, -1.0)
    ]
    one, other = sorted(ends, key=lambda found: found[0])
    closed = bool(one[-1] > other[0])
    if closed:
        start = one[np.argmax(np.abs(angle[one[one < other[0]]] - angle[other[0]]))]
    else:
        start = 0
    rows = np.arange(start, angle.size)
    rows = rows[:: max(1, rows.size // _ROWS)]
    return angle[rows], torque[rows], closed


def _merge_elements(elements: list[tuple[float, float]], count: int) -> list[tuple[float, float]]:
    """At most ``count`` elements of stiffness and angle: neighbours in one where the torque changes
    least, sums stay.
    """
    while len(elements) > max(count, 1):
        k, x = np.array(elements).T
        both = k[:-1] + k[1:]
        i = int(np.argmin(k[:-1] * k[1:] / both * np.diff(x)))
        one = float(both[i]), float((k[i] * x[i] + k[i + 1] * x[i + 1]) / both[i])
        elements = [*elements[:i], one, *elements[i + 2 :]]
    return elements


def _shares_of_limit(
    limit: float, elements: list[tuple[float, float]], rest: float, reach: float
) -> tuple[tuple[float, float], ...]:
    """Shares of the ``limit``; what has not slid at ``reach`` [rad], of the stiffness ``rest``, has
    what they leave of it.
    """
    broken = sum(k * x for k, x in elements)
    transmitted = broken + rest * reach
    if not transmitted > 0.0:
        raise ValueError(
            "loop: its torque does not rise with the angle; friction is expected as positive where"
            " the angle grows"
        )
    if transmitted > (1.0 + LEVEL_TOLERANCE) * limit:
        raise ValueError(
            f"loop reaches {transmitted:.4g} N*m; at most coulomb or breakaway and slip_ring"
            f" together, {limit:.4g} N*m, is expected"
        )
    levels = rest * reach < LEVEL_TOLERANCE * limit
    if levels and transmitted < (1.0 - LEVEL_TOLERANCE) * limit:
        raise ValueError(
            f"loop levels at {transmitted:.4g} N*m; as much as coulomb or breakaway and slip_ring,"
            f" {limit:.4g} N*m, is expected"
        )
    if levels:
        return tuple((k * limit / broken, k * x / broken) for k, x in elements)
    return (*((k, k * x / limit) for k, x in elements), (rest, 1.0 - broken / limit))
