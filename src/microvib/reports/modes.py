"""Modes from command to folder: Table 1 of any source, pictures, convergence, second-order terms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.io.modal_sources import ModalSource, StructureDesign
from microvib.io.modal_table import modes_csv
from microvib.model.rigid import COMPONENTS
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import (
    AnimatedMarkup,
    Block,
    Contents,
    Document,
    Fact,
    Section,
    Text,
    table,
)
from microvib.reports.moving import (
    AZIMUTH,
    ELEVATION,
    MAX_NODES,
    faces_and_lines,
    markup,
    shape_of_mesh,
)
from microvib.reports.numbers import count_text, signed
from microvib.reports.outcome import report_table
from microvib.reports.parameters import parameter_table
from microvib.reports.sheets import GREY, png, sheet
from microvib.reports.typography import file_name
from microvib.structures.fem.structure import Structure
from microvib.structures.modal import ModalModel
from microvib.structures.modal_checks import MIN_EFFECTIVE_MASS_FRACTION
from microvib.structures.simulator_design import SimulatorDesign
from microvib.text_tables import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from microvib.structures.fem.modes import Modes

RATES = {"cruise": 0.06, "fast slew": 1.0}  # deg/s
_MAX_DRAWN = 12


def mode_kinds(source: ModalSource) -> tuple[str, ...]:
    """Kind of each mode: from its shape where that is known, else the direction in which it takes
    part most.
    """
    if source.modes is not None and source.design is not None:
        from microvib.structures.fem.described import kinds

        return kinds(source.design, source.modes)
    with np.errstate(invalid="ignore"):
        fraction = np.nan_to_num(source.model.fraction)
    return tuple(COMPONENTS[k] for k in np.argmax(fraction, axis=0))


def effective_mass_sentence(model: ModalModel) -> str:
    """The 90 % rule, and what it leaves out."""
    cumulative = np.cumsum(model.fraction[model.axis])
    reached = np.flatnonzero(cumulative >= MIN_EFFECTIVE_MASS_FRACTION)
    what = f"90 % of the inertia about {model.drive_axis}"
    first = f"{what} is not reached with {model.frequency.size} modes ({100 * cumulative[-1]:.1f} %): ask for more."
    if reached.size:
        first = f"{what} is reached with {count_text(int(reached[0]) + 1, 'mode')}."
    return (
        f"{first} The residual inertia, J_h = {model.J_h:.4g} kg m², is rigidly attached to "
        "the shaft and determines the lines above"
        f" {model.frequency[-1]:.3g} Hz."
    )


def table_text(source: ModalSource) -> str:
    """Table 1 as text."""
    m = source.model
    whole = (
        f"inertia about {m.drive_axis} J = {m.inertia:.5g} kg m², residual J_h = {m.J_h:.4g} kg m²"
    )
    if m.spatial:
        whole += f", mass {m.mass[0, 0]:.5g} kg"
    else:
        whole += ""
    return "\n".join(
        [text_table(*table_1(source)), "", whole, effective_mass_sentence(m), *m.notes]
    )


def table_1(source: ModalSource) -> tuple[list[str], list[list[str]]]:
    """Header and rows of Table 1; beside the reference modes of a description that has some."""
    m, beside = source.model, _beside_reference(source)
    header = ["mode", "kind", "f [Hz]", "damping [%]", "inertia [kg m²]", "fraction [1]", "cumulative [1]",
              "reference [Hz]", "diff. [%]", "reference fraction [1]"]  # fmt: skip
    cumulative = np.cumsum(m.fraction[m.axis])
    effective, fraction = (
        _zero_rounding(m.effective[m.axis], m.inertia),
        _zero_rounding(m.fraction[m.axis], 1.0),
    )
    rows = [
        [str(k + 1), kind, f"{m.frequency[k]:.4g}", f"{100 * m.damping[k]:.3g}", f"{effective[k]:.3g}", f"{fraction[k]:.3g}",
         f"{cumulative[k]:.4f}", *beside[k]]
        for k, kind in enumerate(mode_kinds(source))
    ]  # fmt: skip
    return header[: len(rows[0])], rows


def _zero_rounding(values: np.ndarray, whole: float) -> np.ndarray:
    """Zero where there is nothing but rounding of the ``whole``."""
    return np.where(np.abs(values) > 1e-12 * whole, values, 0.0)


def _beside_reference(source: ModalSource) -> list[list[str]]:
    """Frequencies of the description's reference modes, the differences from them, and where they
    are known the effective fractions.
    """
    frequencies = source.model.frequency
    reference = () if source.design is None else source.design.reference
    if not reference:
        return [[] for _ in frequencies]
    has_fractions = any(mode.fraction is not None for mode in reference)
    cells = []
    for mode, f in zip(reference, frequencies, strict=False):
        row = [f"{mode.frequency:g}", f"{100 * (f / mode.frequency - 1):+z.1f}"]
        if mode.fraction is not None:
            row.append(f"{mode.fraction:.3g}")
        elif has_fractions:
            row.append("")
        cells.append(row)
    return [*cells, *[[""] * len(cells[0])] * (len(frequencies) - len(cells))]


def modes_folder(source: ModalSource) -> Contents:
    """``modes.csv``, the report and, of finite elements, ``modes.png``."""
    files: dict[str, Any] = {"modes.csv": modes_csv(source.model)}
    if source.modes is not None:
        files["modes.png"] = png(draw_shapes(source.modes, mode_kinds(source), _MAX_DRAWN))
    return files, modes_report(source)


def modes_report(source: ModalSource) -> Document:
    """The report on the modes of one source."""
    model, design = source.model, source.design
    first_page: list[Block] = [table(*table_1(source)), Text(effective_mass_sentence(model))]
    if model.notes:
        first_page += [Text(f"To be checked: {' '.join(model.notes)}")]
    else:
        first_page += []
    sections: list[Section] = []
    if source.modes is not None and design is not None:
        shapes, moving = _shapes(design, source.modes)
        first_page.append(shapes)
        compared = (_convergence(design, source.modes), *_without_rope(design, source.modes))
        sections = [*moving, *compared, _second_order(source.modes, model)]
    sections += _spatial(model) if model.spatial else []
    if design is not None:
        origin = (Text(design.source),) if design.source else ()
        sections.append(
            Section("Description", (*origin, report_table(parameter_table(design))), new_page=True)
        )
    name = file_name(source.name)
    return study_report(
        "Modes report",
        f"Modes of {model.title or name}",
        f"{name}: {model.frequency.size} modes with the interface clamped, drive axis"
        f" {model.drive_axis} (as Table 1).",
        facts=_facts(model),
        first_page=first_page,
        sections=sections,
        parts={} if design is None else {"description": design},
    )


def _facts(model: ModalModel) -> list[Fact]:
    dominant, held = (
        int(np.argmax(model.effective[model.axis])),
        float(model.fraction[model.axis].sum()),
    )
    of = f"of the inertia about {model.drive_axis} in {count_text(model.frequency.size, 'mode')}; common practice requires 90 %"
    return [
        Fact(f"{100 * held:.1f} %", of, "pass" if held >= MIN_EFFECTIVE_MASS_FRACTION else "fail"),
        Fact(
            f"{model.frequency[dominant]:.4g} Hz",
            f"mode {dominant + 1}, the strongest about {model.drive_axis}",
        ),
        Fact(f"{model.inertia:.4g} kg m²", f"inertia about {model.drive_axis}"),
        Fact(f"{model.J_h:.4g} kg m²", "residual J_h, rigid on the shaft"),
    ]


def _shapes(design: StructureDesign, modes: Modes) -> tuple[Block, list[Section]]:
    """Shapes of the first modes as a picture and, of a structure that is not too large, in motion."""
    from microvib.structures.fem.described import kinds, mode_kind_labels

    found = kinds(design, modes)
    legend = "; ".join(
        f"{key} {meaning}" for key, meaning in mode_kind_labels(design).items() if key in found
    )
    caption = (
        f"Mode shapes: displacements exaggerated, colour by size; grey at rest. Kinds: {legend}."
    )
    picture = figure_block(draw_shapes(modes, found, _MAX_DRAWN), "Mode shapes", caption)
    if len(modes.structure.xyz) > MAX_NODES:
        return picture, []
    return picture, [Section("In motion", (AnimatedMarkup(animation(modes, found, _MAX_DRAWN)),))]


def _convergence(design: StructureDesign, modes: Modes) -> Section:
    from microvib.structures.fem.described import kinds, solve_design

    coarse = solve_design(
        design.model_copy(update={"mesh": 2.0 * design.mesh}), modes.frequency.size
    )
    fine, other = (_by_kind(found.frequency, kinds(design, found)) for found in (modes, coarse))
    rows = []
    for k, (key, f) in enumerate(fine.items(), 1):
        g = other.get(key, math.nan)
        rows.append(
            [
                str(k),
                key[0],
                f"{f:.5g}",
                *([f"{g:.5g}", signed(100 * (g / f - 1))] if key in other else ["", ""]),
            ]
        )
    text = (
        f"The same with elements of {2 * design.mesh:g} m instead of {design.mesh:g} m"
        f" ({coarse.structure.dof} instead of"
        f" {modes.structure.dof} degrees of freedom). The error goes with the square of the size; a"
        " difference that is not"
        " small calls for a finer mesh."
    )
    header = ["mode", "kind", "f [Hz]", "coarser [Hz]", "difference [%]"]
    return Section("Convergence", (Text(text), table(header, rows)))


def _without_rope(design: StructureDesign, modes: Modes) -> list[Section]:
    """Frequencies of a simulator without its rope."""
    from microvib.structures.fem.described import solve_design

    if not isinstance(design, SimulatorDesign) or design.rope is None:
        return []
    without = solve_design(design.model_copy(update={"rope": None}), modes.frequency.size).frequency
    pairs = zip(modes.frequency, without, strict=True)
    rows = [
        [str(k), f"{f:.5g}", f"{g:.5g}", f"{100 * (g / f - 1):+z.3f}"]
        for k, (f, g) in enumerate(pairs, 1)
    ]
    text = "The same without the suspension rope, whose mass is in neither."
    header = ["mode", "with [Hz]", "without [Hz]", "difference [%]"]
    return [Section("Suspension rope", (Text(text), table(header, rows)))]


def _by_kind(frequency: np.ndarray, kinds: Sequence[str]) -> dict[tuple[str, int], float]:
    """Frequencies under their kind and their number in it."""
    found: dict[tuple[str, int], float] = {}
    for f, kind in zip(frequency, kinds, strict=True):
        found[kind, sum(key[0] == kind for key in found)] = float(f)
    return found


def _second_order(modes: Modes, model: ModalModel) -> Section:
    from microvib.structures.fem.coupling import coupling_size

    rows = []
    for name, rate in RATES.items():
        s = coupling_size(modes, math.radians(rate), model.damping, model.axis - 3)
        terms = s.coriolis, s.centrifugal, s.frequency, s.torque
        rows.append([f"{name}, {rate:g} deg/s", *(f"{v:.2g}" for v in terms)])
    text = (
        "Terms of Eq. 15 that Eq. 16 neglects, computed from the elements for a steady rate: Coriolis"
        " coupling over inertia forces,"
        " centrifugal over elastic force, and what both change in the natural frequencies and in"
        " the torque that an acceleration of"
        " the shaft takes, at worst from 0.01 to 200 Hz. Stiffening by the steady tension, of the"
        " size of the centrifugal"
        " column, is in neither equation."
    )
    header = ["rate", "Coriolis [1]", "centrifugal [1]", "frequencies [1]", "torque [1]"]
    return Section("Second-order terms", (Text(text), table(header, rows)))


def _spatial(model: ModalModel) -> list[Section]:
    both = np.stack(
        [100 * model.fraction, 100 * np.cumsum(model.fraction, axis=1)], axis=-1
    )  # (6, modes, 2)
    rows = [
        [str(k + 1), f"{f:.4g}", *(f"{part:.2f} / {whole:.2f}" for part, whole in both[:, k])]
        for k, f in enumerate(model.frequency)
    ]
    mass = _zero_rounding(model.mass, float(np.abs(model.mass).max()))
    rigid = [[name, *(f"{v:.5g}" for v in row)] for name, row in zip(COMPONENTS, mass, strict=True)]
    text = "Fraction of the rigid body's mass (forces) and inertia (torques) at the interface, and cumulative after the slash."
    effective = table(["mode", "f [Hz]", *(f"{d} [%]" for d in COMPONENTS)], rows)
    inertia = table(["row", *(f"{d} [1]" for d in COMPONENTS)], rigid)
    return [
        Section("Effective mass in six directions", (Text(text), effective)),
        Section(
            "Rigid body at the interface",
            (Text("Mass matrix about the interface point, in kg and m."), inertia),
        ),
    ]


def animation(modes: Modes, kinds: Sequence[str], count: int) -> str:
    """Shapes that move, as markup: modes chosen from a list, turned with the mouse, played and
    paused.
    """
    moving = shape_of_mesh(modes)
    first = replace(moving, shapes=moving.shapes[:, :, :count])
    return markup(first.data(), _names(modes, kinds, min(count, len(kinds))))


def draw_shapes(modes: Modes, kinds: Sequence[str], count: int) -> Figure:
    """The mesh, and the first ``count`` modes with it at rest behind them."""
    count = min(count, len(kinds))
    figure, axes = sheet(1.3 * (count // 3 + 1), count // 3 + 1, 3)
    shapes, xyz = shape_of_mesh(modes).scaled, modes.structure.xyz
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
    c, s = np.cos(AZIMUTH), np.sin(AZIMUTH)
    right, away = xyz[:, 0] * -s + xyz[:, 1] * c, xyz[:, 0] * c + xyz[:, 1] * s
    up = xyz[:, 2] * np.cos(ELEVATION) - away * np.sin(ELEVATION)
    return np.column_stack([right, up]), away * np.cos(ELEVATION) + xyz[:, 2] * np.sin(ELEVATION)


def _draw(ax: Any, structure: Structure, xyz: np.ndarray, shape: np.ndarray | None) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    faces, lines = faces_and_lines(structure)
    rest, _ = project(xyz)
    ground, edge = ("#dbe7f0", GREY) if shape is None else ("none", "#bbbbbb")
    shells = PolyCollection(
        rest[faces], facecolors=ground, edgecolors=edge, linewidths=0.3, rasterized=True
    )
    ax.add_collection(shells)
    ax.add_collection(LineCollection(list(rest[lines]), colors=edge, linewidths=1.0))
    if shape is None:
        return
    points, depth = project(xyz + shape)
    size = np.sqrt((shape**2).sum(axis=1))
    front = faces[np.argsort(depth[faces].mean(axis=1))]
    colours = {"array": size[front].mean(axis=1), "cmap": "viridis", "edgecolors": "#ffffff60"}
    coloured = PolyCollection(points[front], linewidths=0.2, rasterized=True, **colours)
    coloured.set_clim(
        0.0, size.max()
    )  # of the whole structure, of which shells may be the part that hardly moves
    ax.add_collection(coloured)
    ax.add_collection(LineCollection(list(points[lines]), colors="#333333", linewidths=1.4))
