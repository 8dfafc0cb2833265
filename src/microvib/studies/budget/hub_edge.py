"""Gaps of sources above the frequency up to which a hub is known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from microvib.model.hub_edge import CLOSE_ERROR, HubEdge
from microvib.studies.budget.sources import Contribution, Unobserved

_BANDS_PER_OCTAVE = 3
"""Bands in which a density is added up, each to a line."""


def with_unknown_above(one: Contribution, edge: HubEdge | None) -> Contribution:
    """A contribution of which lines above the ``edge`` may be as small as nothing, and those close
    below are less certain.
    """
    if edge is None or not len(one.frequency):
        return one
    close = np.where(one.frequency + one.off > edge.close, CLOSE_ERROR, 0.0)[:, None]
    less, more = one.relative_errors + close
    less = np.where(_above(one, edge)[:, None], np.maximum(less, 1.0), less)
    return replace(one, relative_error=np.stack([less, more]))


def hub_edge_gaps(one: Contribution) -> Iterator[Unobserved]:
    """The gap of what a source, with all its alternatives, makes above the edge of its hub's model.

    Lines, densities and what other gaps have there may be the edge's factor times as large.
    """
    if one.edge is None:
        return
    parts = [*_lines(one, one.edge), *_densities(one, one.edge), *_gaps(one, one.edge)]
    f = np.concatenate([np.zeros(0), *(at for at, _ in parts)])
    most = np.concatenate([np.zeros((0, 2)), *(size for _, size in parts)])
    counts = most.any(axis=1)
    if counts.any():
        yield Unobserved(
            one.edge.why, one.edge.frequency, math.inf, f[counts], one.edge.factor * most[counts]
        )


_Lines = tuple[np.ndarray, np.ndarray]
"""Frequencies [Hz], (m,), and amplitudes [rad], (m, 2)."""


def _above(one: Contribution, edge: HubEdge) -> np.ndarray:
    """Which lines may be above the edge, (k,)."""
    return np.asarray(one.frequency + one.off > edge.frequency)


def _lines(one: Contribution, edge: HubEdge) -> Iterator[_Lines]:
    """Lines above the edge, of each the largest that alternatives have."""
    if one.sweep is not None:
        for f, size in one.sweep.swept():
            above = f > edge.frequency
            if above.any():
                highest = int(np.argmax(np.where(above, np.hypot(*np.abs(size).T), -1.0)))
                yield f[[highest]], np.abs(size[[highest]])
        return
    largest: dict[str, _Lines] = {}
    for each in one.alternatives or (one,):
        for k in np.flatnonzero(_above(each, edge)).tolist():
            found = each.frequency[[k]], np.abs(each.los[[k]])
            before = largest.get(each.names[k])
            if before is None or np.hypot(*found[1][0]) > np.hypot(*before[1][0]):
                largest[each.names[k]] = found
    yield from largest.values()


def _densities(one: Contribution, edge: HubEdge) -> Iterator[_Lines]:
    """Lines of the mean squares of a density in bands above the edge."""
    if one.most_density is None or one.most_density[0][-1] <= edge.frequency:
        return
    f, S = one.most_density
    number = max(math.ceil(_BANDS_PER_OCTAVE * math.log2(f[-1] / edge.frequency)), 1)
    bounds = np.geomspace(edge.frequency, f[-1], number + 1)
    at = np.union1d(f[f > edge.frequency], bounds)
    values = np.column_stack([np.interp(at, f, column) for column in S.T])
    for low, high in pairwise(bounds.tolist()):
        inside = (at >= low) & (at <= high)
        squares = np.trapezoid(values[inside], at[inside], axis=0)
        yield np.array([low]), np.sqrt(2.0 * squares)[None, :]


def _gaps(one: Contribution, edge: HubEdge) -> Iterator[_Lines]:
    """Bounds of other gaps above the edge; what nothing bounds tells itself."""
    for gap in one.gaps:
        bounded = np.all(np.isfinite(gap.most), axis=1)
        above = (gap.frequency > edge.frequency) & bounded
        yield gap.frequency[above], gap.most[above]
