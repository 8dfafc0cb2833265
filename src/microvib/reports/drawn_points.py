"""Points of what is drawn in a picture, for those who want its figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DrawnPoint = tuple[str, str, float, float]
"""Titles of the axes, name of the curve, x, y."""


def drawn_points(figure: Figure) -> list[DrawnPoint]:
    """Points of all curves and dots of a figure, in the order in which they were drawn; bars, maps and lines
    across the axes are left out.
    """
    return [point for ax in figure.axes for point in _points_of(ax)]


def _points_of(ax: Axes) -> Iterator[DrawnPoint]:
    from matplotlib.collections import PathCollection

    shown = " against ".join(text for text in (ax.get_ylabel(), _abscissa(ax)) if text)
    for line in ax.lines:
        if line.get_transform() == ax.transData:
            yield from _listed(shown, str(line.get_label()), np.asarray(line.get_xydata()))
    for dots in ax.collections:
        if isinstance(dots, PathCollection):
            yield from _listed(
                shown, str(dots.get_label()), np.ma.filled(dots.get_offsets(), np.nan)
            )


def _abscissa(ax: Axes) -> str:
    """The title of the x axis, which stands below the lowest of those that share it."""
    together = [ax, *ax.get_shared_x_axes().get_siblings(ax)]
    return next((text for one in together if (text := one.get_xlabel())), "")


def _listed(shown: str, label: str, points: np.ndarray) -> Iterator[DrawnPoint]:
    name = "" if label.startswith("_") else label.replace("$", "")
    for x, y in points.tolist():
        if np.isfinite(x) and np.isfinite(y):
            yield shown, name, float(f"{x:.7g}"), float(f"{y:.7g}")
