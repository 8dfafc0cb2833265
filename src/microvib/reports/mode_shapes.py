"""Pictures of mode shapes: a sheet of drawings, and an animation for the report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.reports.sheets import GREY, sheet
from microvib.structures.fem.structure import Beams, Shells, Structure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from microvib.structures.fem.modes import Modes

_REACH = 0.08  # largest displacement shown, of the structure's size
_AZIMUTH, _ELEVATION = np.radians(-60.0), np.radians(28.0)


def shown_shapes(modes: Modes) -> np.ndarray:
    """Displacements of the nodes, scaled to be seen, (n, 3, s) [m]."""
    u = modes.shapes[:, :3, :]
    extent = np.ptp(modes.structure.xyz, axis=0).max()
    largest = np.sqrt((u**2).sum(axis=1)).max(axis=0)
    return np.asarray(_REACH * extent * u / largest)


def faces_and_lines(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the shells (f, 4) and ends of the beams (b, 2)."""
    faces = [part.nodes for part in structure.of(Shells)] or [np.zeros((0, 4), dtype=int)]
    lines = [part.nodes for part in structure.of(Beams)] or [np.zeros((0, 2), dtype=int)]
    return np.concatenate(faces), np.concatenate(lines)


def draw_shapes(modes: Modes, kinds: Sequence[str], count: int) -> Figure:
    """The mesh, and the first ``count`` modes with it at rest behind them."""
    count = min(count, len(kinds))
    figure, axes = sheet(1.3 * (count // 3 + 1), count // 3 + 1, 3)
    shapes, xyz = shown_shapes(modes), modes.structure.xyz
    drawn = [None, *np.moveaxis(shapes[:, :, :count], 2, 0)]
    titles = [f"mesh, {modes.structure.dof} degrees of freedom", *_names(modes, kinds, count)]
    for ax, shape, title in zip(axes.flat, drawn, titles, strict=False):
        _draw(ax, modes.structure, xyz, shape)
        ax.set_title(title, fontsize=7.5)
    for ax in axes.flat:
        ax.set_axis_off()
        ax.set_aspect("equal")
        ax.autoscale_view()
    return figure


def _names(modes: Modes, kinds: Sequence[str], count: int) -> list[str]:
    return [f"mode {k + 1} ({kinds[k]}), {modes.frequency[k]:.4g} Hz" for k in range(count)]


def project(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Screen coordinates (n, 2) and depth (n,) of points seen obliquely from above."""
    c, s = np.cos(_AZIMUTH), np.sin(_AZIMUTH)
    right, away = xyz[:, 0] * -s + xyz[:, 1] * c, xyz[:, 0] * c + xyz[:, 1] * s
    up = xyz[:, 2] * np.cos(_ELEVATION) - away * np.sin(_ELEVATION)
    return np.column_stack([right, up]), away * np.cos(_ELEVATION) + xyz[:, 2] * np.sin(_ELEVATION)


def _draw(ax: Any, structure: Structure, xyz: np.ndarray, shape: np.ndarray | None) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    faces, lines = faces_and_lines(structure)
    rest, _ = project(xyz)
    ground, edge = ("#dbe7f0", GREY) if shape is None else ("none", "#bbbbbb")
    shells = PolyCollection(rest[faces], facecolors=ground, edgecolors=edge, linewidths=0.3, rasterized=True)
    ax.add_collection(shells)
    ax.add_collection(LineCollection(list(rest[lines]), colors=edge, linewidths=1.0))
    if shape is None:
        return
    points, depth = project(xyz + shape)
    size = np.sqrt((shape**2).sum(axis=1))
    front = faces[np.argsort(depth[faces].mean(axis=1))]
    colours = {"array": size[front].mean(axis=1), "cmap": "viridis", "edgecolors": "#ffffff60"}
    coloured = PolyCollection(points[front], linewidths=0.2, rasterized=True, **colours)
    coloured.set_clim(0.0, size.max())  # of the whole structure, of which shells may be the part that hardly moves
    ax.add_collection(coloured)
    ax.add_collection(LineCollection(list(points[lines]), colors="#333333", linewidths=1.4))


def animation(modes: Modes, kinds: Sequence[str], count: int) -> Any:
    """A canvas with its script and data, as markup: modes chosen from a list, turned with the mouse, played and paused."""
    from markupsafe import Markup

    faces, lines = faces_and_lines(modes.structure)
    shapes = np.moveaxis(shown_shapes(modes)[:, :, :count], 2, 0)
    data = {
        "xyz": np.round(modes.structure.xyz - modes.structure.xyz.mean(axis=0), 3).tolist(),
        "faces": faces.tolist(),
        "lines": lines.tolist(),
        "shapes": np.round(shapes, 3).tolist(),
        "names": _names(modes, kinds, len(shapes)),
        "azimuth": float(_AZIMUTH),
        "elevation": float(_ELEVATION),
    }
    script = (resources.files("microvib.reports") / "templates" / "shapes.html").read_text(encoding="utf-8")
    return Markup(script.replace("__DATA__", json.dumps(data, separators=(",", ":"))))  # numbers and our own words only
