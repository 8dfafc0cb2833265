"""Dimensioned drawing of a sized simulator: top view, side view, parts, title block."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.reports.drawing import import_artists
from microvib.reports.sheets import BLUE, GREEN, GREY, ORANGE, RED
from microvib.studies.sas import Setting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from microvib.structures.simulator_design import SimulatorDesign

_TUBE, _PLATE, _STEEL = "#e4e4e4", "#cfe3f1", "#f6dfb0"
_SIDES = (-1, 1)


def draw_simulator(setting: Setting) -> Figure:
    """The simulator at one setting; lengths in mm."""
    import_artists()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 8.45), dpi=110)
    FigureCanvasAgg(figure)
    top = figure.add_axes((0.01, 0.02, 0.60, 0.92))
    side = figure.add_axes((0.62, 0.70, 0.37, 0.24))
    sheet = figure.add_axes((0.62, 0.02, 0.37, 0.66))
    for ax in (top, side, sheet):
        ax.set_axis_off()
    for ax, draw in ((top, _top_view), (side, _side_view)):
        ax.set_aspect("equal")
        draw(ax, setting.design)
        ax.autoscale_view()
    _parts(sheet, setting)
    figure.text(
        0.02,
        0.955,
        "Top view, against the drive axis z (lengths in mm)",
        fontsize=12,
        weight="bold",
    )
    figure.text(0.62, 0.955, "Side view, plate and arm in section", fontsize=12, weight="bold")
    return figure


def _box(
    ax: Any, x: float, y: float, width: float, height: float, colour: str, **given: Any
) -> None:
    """A rectangle about its centre [mm]."""
    from matplotlib.patches import Rectangle

    style: dict[str, Any] = {"edgecolor": "#333333", "linewidth": 0.9, "zorder": 2} | given
    ax.add_patch(
        Rectangle((x - width / 2, y - height / 2), width, height, facecolor=colour, **style)
    )


def _disc(ax: Any, x: float, y: float, diameter: float, colour: str, **given: Any) -> None:
    from matplotlib.patches import Circle

    style: dict[str, Any] = {"edgecolor": "#333333", "linewidth": 0.9} | given
    ax.add_patch(Circle((x, y), diameter / 2, facecolor=colour, **style))


def _dimension(
    ax: Any, a: tuple[float, float], b: tuple[float, float], at: float, text: str, up: bool = False
) -> None:
    """A dimension from a to b, its line at the height ``at`` (or, ``up``, at that place across),
    with extension lines.
    """
    if up:
        p, q = ((at, a[1]), (at, b[1]))
    else:
        p, q = ((a[0], at), (b[0], at))
    for end, foot in ((p, a), (q, b)):
        ax.plot([foot[0], end[0]], [foot[1], end[1]], color=GREY, linewidth=0.6, zorder=5)
    arrow = {"arrowstyle": "<|-|>", "color": "black", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", q, p, arrowprops=arrow)
    if up:
        offset, across, along = ((-3, 0), "right", "center")
    else:
        offset, across, along = ((0, 3), "center", "bottom")
    ax.annotate(
        text, ((p[0] + q[0]) / 2, (p[1] + q[1]) / 2), offset, textcoords="offset points", ha=across, va=along, fontsize=10,
        rotation=90 if up else 0, zorder=7, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
    )  # fmt: skip


def _coil(
    ax: Any, a: tuple[float, float], b: tuple[float, float], diameter: float, body: float
) -> None:
    """A spring between two hooks: straight hooks, ``body`` of coils."""
    start, end = np.array(a), np.array(b)
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    across = np.array([-along[1], along[0]])
    s = np.linspace((length - body) / 2.0, (length + body) / 2.0, 25)
    swing = np.where(np.arange(25) % 2 == 0, 0.5, -0.5) * diameter
    swing[[0, -1]] = 0.0
    points = np.vstack([start, start + s[:, None] * along + swing[:, None] * across, end])
    ax.plot(points[:, 0], points[:, 1], color=RED, linewidth=1.0, zorder=6)


def _top_view(ax: Any, design: SimulatorDesign) -> None:
    f, p, w = design.frame, design.plate, design.counterweight
    A, b, arm, r, t = (1e3 * v for v in (f.half_length, f.rail, design.arm, w.radius, f.tube.width))
    _cross(ax, A, b, t)
    _box(ax, 0, 0, 1e3 * f.bridge, 2 * b, "#efefef", linestyle="--", zorder=1)
    _box(ax, 0, 0, 1e3 * p.length, 1e3 * p.width, _PLATE, zorder=3)
    _disc(ax, 0, 0, 1e3 * design.shaft.diameter, "white", zorder=4)
    for x, y in ((r, 0), (-r, 0), (0, r), (0, -r)):
        if y == 0:
            across = (t, 2 * b + t)
        else:
            across = (2 * b + t, t)
        _box(ax, x, y, *across, "#f3ead3", zorder=3)
        _disc(ax, x, y, 1e3 * w.diameter, _STEEL, zorder=4)
    _spring_sets(ax, design)
    ax.plot([-A - 60, A + 60], [0, 0], color=GREY, linewidth=0.6, linestyle="-.", zorder=5)
    ax.plot([0, 0], [-A - 60, A + 60], color=GREY, linewidth=0.6, linestyle="-.", zorder=5)
    _dimension(ax, (0, 0), (r, 0), -A - 190, f"r = {r:.1f}")
    _dimension(ax, (-A, -b), (A, -b), -A - 260, f"{2 * A:g}")
    _dimension(ax, (0, b), (arm, b), b + 150, f"l = {arm:.1f}")
    _dimension(ax, (0, 0), (0, r), -A - 110, f"r = {r:.1f}", up=True)
    _dimension(ax, (-A, -b), (-A, b), -A - 190, f"{2 * b:g}", up=True)
    half = 1e3 * p.length / 2
    _dimension(
        ax, (-half, -1e3 * p.width / 2), (half, -1e3 * p.width / 2), -b - 110, f"plate {2 * half:g}"
    )
    a, end = 1e3 * p.hook, 1e3 * design.hook_end
    _dimension(ax, (arm, a), (arm, end), arm + 95, f"{end - a:.1f}", up=True)
    if design.shaft.bearing_at > design.shaft.plate_at:
        side = "over"
    else:
        side = "under"
    springs = f"8 springs in pairs above and below\nthe plate, k = {design.spring.rate:g} N/m"
    for tip, place, text in (
        ((r, 25), (A * 0.55, b + 200), f"4 × {w.mass:g} kg, diameter {1e3 * w.diameter:g}"),
        ((-arm, 0.6 * end), (-A - 60, A - 60), springs),
        (
            (b, A * 0.93),
            (b + 130, A + 60),
            f"tube {t:g} × {1e3 * f.tube.height:g} × {1e3 * f.tube.wall:g}",
        ),
        ((50, -0.8 * b), (A * 0.55, -A * 0.62), f"bridge with bearing,\n{side} the plate"),
    ):
        ax.annotate(
            text, tip, place, fontsize=9.5, ha="left", va="center", zorder=8,
            arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 0.7},
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
        )  # fmt: skip


def _cross(ax: Any, A: float, b: float, t: float) -> None:
    for s in _SIDES:
        _box(ax, 0, s * b, 2 * A + t, t, _TUBE)
        _box(ax, s * A, 0, t, 2 * b, _TUBE)
        _box(ax, 0, s * A, 2 * b, t, _TUBE)
        for u in _SIDES:
            _box(ax, s * b, u * (A + b) / 2, t, A - b + t, _TUBE)


def _spring_sets(ax: Any, design: SimulatorDesign) -> None:
    p, s = design.plate, design.spring
    arm, b, a, end = (1e3 * v for v in (design.arm, design.frame.rail, p.hook, design.hook_end))
    body = 1e3 * s.wire * (s.coils + 1) + 1e3 * design.preload
    for sx in _SIDES:
        _box(
            ax, sx * arm, 0, 1e3 * p.slider_width, 1e3 * p.slider_width, GREEN, alpha=0.55, zorder=5
        )
        for sy in _SIDES:
            _box(
                ax,
                sx * arm,
                sy * b,
                46,
                1e3 * design.frame.tube.width + 10,
                BLUE,
                alpha=0.5,
                zorder=4,
            )
            ax.plot([sx * arm] * 2, [sy * end, sy * b], color="#333333", linewidth=2.0, zorder=5)
            _coil(ax, (sx * arm, sy * a), (sx * arm, sy * end), 1e3 * s.coil, body)


def _side_view(ax: Any, design: SimulatorDesign) -> None:
    s, p, f, w = design.shaft, design.plate, design.frame, design.counterweight
    plate, bearing, level = (1e3 * v for v in (s.plate_at, s.bearing_at, p.level))
    A, r, arm, D, top = (
        1e3 * v for v in (f.half_length, w.radius, design.arm, s.diameter, s.length)
    )
    _box(ax, 0, -12, 1e3 * max(s.connector_diameter, s.diameter), 24, "#bbbbbb")
    _box(ax, 0, top / 2, D, top, "white", zorder=3)
    _box(ax, 0, plate, 2 * A, 1e3 * f.tube.height, _TUBE)
    _box(ax, 0, plate, 1e3 * p.length, 1e3 * p.thickness, _PLATE, zorder=4)
    _box(ax, 0, bearing, 1e3 * f.bridge, 22, ORANGE, alpha=0.6, zorder=4)
    for sx in _SIDES:
        _box(ax, sx * r, plate, 1e3 * w.diameter, 1e3 * w.height, _STEEL, alpha=0.8, zorder=5)
        for sz in _SIDES:
            _box(
                ax,
                sx * arm,
                plate + sz * level / 2,
                1e3 * p.slider_width,
                level,
                GREEN,
                alpha=0.55,
                zorder=5,
            )
            _disc(
                ax,
                sx * arm,
                plate + sz * level,
                1e3 * design.spring.coil,
                "none",
                edgecolor=RED,
                zorder=6,
            )
    ax.plot([0, 0], [-60, top + 90], color=GREY, linewidth=0.6, linestyle="-.", zorder=5)
    ax.text(12, top + 70, "drive axis z", fontsize=9)
    ax.text(0, -45, "interface to the drive", fontsize=9, ha="center", va="top")
    _dimension(ax, (0, 0), (0, plate), -A - 60, f"{plate:g}", up=True)
    _dimension(ax, (0, 0), (0, bearing), -A - 150, f"{bearing:g}", up=True)
    _dimension(ax, (arm, plate), (arm, plate + level), A + 70, f"{level:g}", up=True)
    ax.text(-D, bearing + 14, "bearing", fontsize=9, ha="right", va="bottom")
    if design.rope is not None:
        line = {"arrowstyle": "-", "color": GREY}
        ax.annotate(
            "rope", (0, top), (-30, top + 85), fontsize=9, ha="right", color=GREY, arrowprops=line
        )


def _parts(ax: Any, setting: Setting) -> None:
    widths, box = [0.31, 0.08, 0.61], (0.0, 0.23, 1.0, 0.77)
    rows = [list(row) for row in _rows(setting)]
    table = ax.table(
        rows, colLabels=["part", "pcs", "value"], colWidths=widths, cellLoc="left", bbox=box
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    for cell in table.get_celld().values():
        cell.PAD = 0.02
        cell.set_linewidth(0.6)
    _title_block(ax, setting)


def _rows(setting: Setting) -> list[tuple[str, str, str]]:
    d, s, w = setting.design, setting.design.spring, setting.design.counterweight
    low, high = setting.forces
    mm, a = 1e3, d.adjustment
    stress = f"{setting.stress / 1e6:.0f} of {setting.allowable / 1e6:.0f} MPa"
    return [
        ("spring", "8", f"{s.name}, k = {s.rate:g} N/m"),
        ("its coils", "", f"{s.coils:g}, diameter {mm * s.coil:g} mm, wire {mm * s.wire:g} mm"),
        ("its length", "", f"free {mm * s.free_length:g}, set {mm * (s.free_length + d.preload):.1f} mm"),
        ("its preload", "", f"{mm * d.preload:.1f} mm, {d.spring_force:.1f} N"),
        ("its load", "", f"{low:.1f} to {high:.1f} N at {math.degrees(setting.amplitude):.3g}°, {stress}"),
        ("slider, on the plate", "4", f"{d.plate.slider_mass:g} kg at l = {mm * d.arm:.1f} mm"),
        ("spring seat, on rail", "4", f"{d.frame.spring_seat_mass:g} kg at l = {mm * d.arm:.1f} mm"),
        ("counterweight", "4", f"{w.mass:g} kg at r = {mm * w.radius:.1f} mm, {mm * w.height:.0f} mm high"),
        ("counterweight seat", "4", f"{d.frame.weight_seat_mass:g} kg"),
        ("plate", "1", f"{mm * d.plate.length:g} × {mm * d.plate.width:g} × {mm * d.plate.thickness:g} mm"),
        ("shaft", "1", f"diameter {mm * d.shaft.diameter:g}, bore {mm * d.shaft.bore:g} mm"),
        ("frame, bare", "1", f"{d.frame_inertia:.3f} kg m²"),
        ("arm l", "", f"adjustable, {mm * a.arm_min:g} to {mm * a.arm_max:g} mm"),
        ("radius r", "", f"adjustable, {mm * a.radius_min:g} to {mm * a.radius_max:g} mm"),
    ]  # fmt: skip


def _title_block(ax: Any, setting: Setting) -> None:
    from matplotlib.patches import Rectangle

    d = setting.design
    ax.add_patch(
        Rectangle(
            (0, 0),
            1,
            0.20,
            transform=ax.transAxes,
            facecolor="none",
            edgecolor="black",
            linewidth=1.4,
        )
    )
    lines = [
        f"Torsion {d.frequency:.4g} Hz, interface clamped (Eq. 24 with 1/2π, tension included)",
        f"Inertia about z {d.inertia:.4g} kg m², of which on the shaft J_h = {d.J_h:.3g} kg m²",
        f"Stiffness {d.stiffness:.4g} N m/rad; eight springs, k l² = {d.spring.rate * d.arm**2:.4g}"
        " N m",
    ]
    style = {"transform": ax.transAxes, "va": "center"}
    ax.text(0.02, 0.17, d.title, fontsize=10.5, weight="bold", **style)
    for text, y in zip(lines, itertools.count(0.12, -0.04), strict=False):
        ax.text(0.02, y, text, fontsize=8.5, **style)
    ax.text(0.98, 0.04, "to scale", fontsize=9, ha="right", color=GREY, **style)
