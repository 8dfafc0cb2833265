"""Parts that the table of a budget's lines leaves out of each source, in words.

A budget knows more of a source than lines: ranges that they pass, densities, what was not looked at
and how large that may be at most. Whoever takes ``lines.csv`` for a source of another budget has the
lines alone, and is told of the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from microvib.analysis.margins import frequency_error_bound
from microvib.studies.budget.side_lines import SideLines
from microvib.studies.budget.sources import Contribution

_ROUNDING = 1.0 + 1e-9
_NEGLIGIBLE = 1e-3
"""Part of the largest line below which what is made of a source at other frequencies is nothing of its
own."""


def left_out_of_lines(contributions: Sequence[Contribution], angles: int = 0) -> list[str]:
    """For each source what its rows of ``lines.csv`` leave out, with what is left out of sources
    without rows; empty where nothing is.

    ``angles`` is the number of array angles that were judged, where it was not one alone.
    """
    own = ["; ".join(f"{one.source}: {said}" for said in _left_out(one)) for one in contributions]
    others = [said for one, said in zip(contributions, own, strict=True) if said and not one.names]
    if angles:
        others.append(f"all but one of {angles} array angles")
    return [
        "; ".join(filter(None, (said, *others))) if one.names else ""
        for one, said in zip(contributions, own, strict=True)
    ]


def _varying_springs_make(side: SideLines) -> bool:
    """Whether there are side lines or a side density, or may be."""
    return bool(side.unknown or side.frequency.size or side.density is not None)


def _left_out(one: Contribution) -> Iterator[str]:
    """Parts of a source that its lines do not say."""
    if one.alternatives or one.sweep is not None:
        yield f"other speeds ({one.how}, of which one is listed)"
    if one.density is not None:
        yield f"its density ({one.how})"
    if one.errors:
        yield f"its error without lines ({one.how})"
    if one.side is not None and _varying_springs_make(one.side):
        yield "side lines that varying elements of a drive make of it"
    if one.side is not None and any(
        np.max(beside.most) > _NEGLIGIBLE * np.abs(one.los).max(initial=0.0)
        for beside in one.side.anywhere
    ):
        yield "what friction and the sine of a drive's motor make of it at other frequencies"
    if one.cases is not None or one.in_case is not None:
        yield "the cases of a campaign"
    if not np.all(np.isfinite(one.relative_errors[1])):
        yield "how large its lines may be"
    clock = np.asarray(frequency_error_bound(one.frequency))
    if np.any(one.off > clock * _ROUNDING):
        yield "by how much its frequencies may be off"
    yield from dict.fromkeys(gap.why for gap in one.gaps)
