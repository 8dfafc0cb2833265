"""Shared parts of all reports: figures as text, pictures as blocks, the way to reproduce,
the line at the foot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np

from microvib.io.runs import scenario_hash
from microvib.io.scenario_file import dump_part
from microvib.io.tables import package_versions
from microvib.model.part import Part
from microvib.model.scenario import Scenario
from microvib.reports import figures, sheets
from microvib.reports.document import Block, Document, Fact, Figure, Section, pairs

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def study_report(  # noqa: PLR0913 - keyword options
    kind: str,
    title: str,
    subtitle: str,
    *,
    first_page: Sequence[Block],
    sections: Sequence[Section],
    facts: Sequence[Fact] = (),
    scenario: Scenario | None = None,
    parts: Mapping[str, Part] | None = None,
    versions: Mapping[str, str] | None = None,
    again: Sequence[Block] = (),
) -> Document:
    """The report of a study; how to reproduce it is added as its last section, and a line at the
    foot.

    ``scenario`` is what all of it rests on; ``parts`` are further descriptions, by what they are.
    ``versions`` are those that made it, without them today's; ``again`` says how else to reproduce
    it.
    """
    versions = versions or package_versions()
    if scenario is None:
        hashes = {}
    else:
        hashes = {"scenario": scenario_hash(scenario)}
    foot = f"microvib {versions['microvib']}" + "".join(
        f" · scenario SHA-256 {text[:16]}…" for text in hashes.values()
    )
    hashes |= {
        name: sha256(dump_part(part).encode()).hexdigest() for name, part in (parts or {}).items()
    }
    made = pairs([*versions.items(), *((f"{name} SHA-256", text) for name, text in hashes.items())])
    last = Section("Versions, and how to reproduce", (*again, made))
    return Document(kind, title, subtitle, tuple(facts), tuple(first_page), (*sections, last), foot)


def figure_block(drawing: Drawing, alt: str, caption: str = "", turned: bool = False) -> Figure:
    """A figure of Matplotlib as a block."""
    return Figure(sheets.svg(drawing), alt, caption, turned)


OVERLAY_CAPTION = (
    "Amplitude spectra of T_d, one-sided, 0-to-peak, Hann window. Left, the low end. Right, the"
    " peaks to 200 Hz, those of one frequency drawn side by side."
)


def draw_overlay(sides: Sequence[tuple[str, np.ndarray, float]]) -> Drawing:
    """Spectra of several torques: the low end as curves, lines to 200 Hz as stems side by side."""
    drawing, axes = sheets.plain_sheet(3.5, 1, 2)
    axes[0, 0].get_gridspec().set_width_ratios((1.0, 1.6))
    drawing.subplots_adjust()  # moves the axes
    figures.draw_overlay(axes[0, 0], sides, 5.0)
    figures.draw_stems(axes[0, 1], sides, 200.0)
    return drawing
