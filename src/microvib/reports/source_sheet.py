"""Source sheets for those who read them: two pages with lines, apparent mass and what they mean."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from microvib.export.source import ARRAY_AXES
from microvib.export.source_sheet import POINT, SIGNS, VALIDITY, VERSION, SourceSheet
from microvib.model.rigid import COMPONENTS
from microvib.reports import sheets
from microvib.reports.blocks import figure_block
from microvib.reports.document import Block, Document, Fact, Section, Table, Text, pairs, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 32
"""Lines in the table, the largest over their component's largest; the file has all."""


def source_sheet_document(sheet: SourceSheet) -> Document:
    """The two pages of a sheet."""
    clock = "none" if math.isnan(sheet.clock) else f"{sheet.clock:.6g} Hz"
    rate = "changes" if math.isnan(sheet.rate) else f"{math.degrees(sheet.rate):.5g} deg/s"
    facts = (
        Fact(f"{len(sheet.names)}", "lines"),
        Fact(f"{np.diag(sheet.source.mass)[0]:.4g} kg", "mass of the array"),
        Fact(f"{sheet.band[0]:g} to {sheet.band[1]:.5g} Hz", "band"),
    )
    about = pairs(
        [
            ("Driving frequency (clock)", clock),
            ("Commanded rate", rate),
            ("Drive axis", f"{sheet.drive_axis} of {ARRAY_AXES}"),
            ("Axes", ARRAY_AXES),
            ("Point", POINT),
            ("Format", f"microvib source sheet, version {VERSION}; this is a summary of the file"),
        ]
    )
    mass = figure_block(
        draw_apparent_mass(sheet),
        "Apparent mass over frequency, diagonal elements, drive powered and hinge locked",
        "Apparent mass: size of the diagonal elements about the interface point.",
    )
    sections = (
        Section(
            "Apparent mass, and what figures mean",
            (mass, Text(SIGNS), Text(VALIDITY)),
            new_page=True,
        ),
    )
    first: tuple[Block, ...] = (about, _lines(sheet))
    title = sheet.title or "Drive and array"
    return Document(
        "Source data sheet",
        title,
        "Blocked loads and apparent mass at the interface.",
        facts,
        first,
        sections,
        sheet.made_by,
    )


def _lines(sheet: SourceSheet) -> Table:
    size = np.abs(sheet.loads)
    over = (size / np.maximum(size.max(axis=0, initial=0.0), 1e-300)).max(axis=1, initial=0.0)
    chosen = np.sort(np.argsort(-over, kind="stable")[:SHOWN])
    units = ["mN"] * 3 + ["mN m"] * 3
    header = ["line", "f [Hz]", *(f"{c} [{u}]" for c, u in zip(COMPONENTS, units, strict=True))]
    rows = [
        [sheet.names[k], f"{sheet.frequency[k]:.5g}", *map(_phasor, sheet.loads[k])] for k in chosen
    ]
    known = sheet.by_integration[np.isfinite(sheet.by_integration) & (size > 0.0)]
    part = known / size[np.isfinite(sheet.by_integration) & (size > 0.0)]
    worst = f"{100.0 * float(part.max()):.2g} %" if part.size else "not known"
    caption = (
        "Blocked loads, 0-to-peak, with phase in degrees; the largest"
        f" {len(rows)} of {len(sheet.names)} lines. Uncertainty by the integration: {worst}."
    )
    return table(header, rows, caption)


def _phasor(value: complex) -> str:
    if value == 0.0:
        return "–"
    return f"{1e3 * abs(value):.3g} ∠ {round(math.degrees(np.angle(value)))}"


def draw_apparent_mass(sheet: SourceSheet) -> Figure:
    """Diagonal elements of the apparent mass, forces on the left and moments on the right."""
    drawing, axes = sheets.plain_sheet(3.6, 1, 2)
    f = sheet.mass_frequency
    for ax, first, unit in ((axes[0, 0], 0, "kg"), (axes[0, 1], 3, "kg m²")):
        for k in range(3):
            colour, name = sheets.COLOURS[k], COMPONENTS[first + k]
            i = first + k
            ax.loglog(f, np.abs(sheet.powered[:, i, i]), color=colour, label=name, linewidth=1.2)
            ax.loglog(f, np.abs(sheet.locked[:, i, i]), color=colour, linewidth=0.7, linestyle=":")
        ax.set_xlabel("frequency [Hz]")
        ax.set_title(f"apparent mass [{unit}]; dotted: hinge locked")
        ax.legend(loc="best", fontsize="small")
    return drawing
