"""The icon of an FMU: a spacecraft, its drive and its array."""

from __future__ import annotations

import io

SIZE = 1.28
"""Width and height [inches] at 100 dots an inch."""


def icon() -> bytes:
    """A PNG file of 128 by 128 dots."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    figure = Figure(figsize=(SIZE, SIZE), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, 10.0), ylim=(0.0, 10.0))
    axes.axis("off")
    axes.add_patch(Rectangle((0.6, 2.6), 3.2, 4.8, facecolor="#c9ccd1", edgecolor="#2f3640", lw=2))
    axes.plot([3.8, 6.2], [5.0, 5.0], color="#2f3640", lw=3)
    axes.add_patch(Circle((4.3, 5.0), 0.8, facecolor="#d9822b", edgecolor="#2f3640", lw=2))
    axes.add_patch(Rectangle((6.2, 2.0), 3.2, 6.0, facecolor="#2b5d9b", edgecolor="#2f3640", lw=2))
    for height in (4.0, 6.0):
        axes.plot([6.2, 9.4], [height, height], color="#e8edf3", lw=1)
    axes.plot([7.8, 7.8], [2.0, 8.0], color="#e8edf3", lw=1)
    written = io.BytesIO()
    figure.savefig(written, format="png", transparent=True)
    return written.getvalue()
