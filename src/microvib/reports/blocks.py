"""What the reports of all studies share: figures as text, pictures as blocks, the way to reproduce, the line at the foot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np

from microvib.io.results import package_versions, scenario_hash
from microvib.io.scenario_file import dump_part
from microvib.model.part import Part
from microvib.model.scenario import Scenario
from microvib.reports import figures, sheets
from microvib.reports.document import Block, Code, Document, Fact, Figure, Form, Section, Text, pairs

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def study(
    kind: str,
    title: str,
    subtitle: str,
    *,
    first_page: Sequence[Block],
    sections: Sequence[Section],
    form: Form | None,
    facts: Sequence[Fact] = (),
    scenario: Scenario | None = None,
    parts: Mapping[str, Part] | None = None,
) -> Document:
    """The report of a study; how to reproduce it is added as its last section.

    ``scenario`` is what all of it rests on; ``parts`` are further descriptions, by what they are.
    """
    form = form or Form()
    blocks: list[Block] = [Text("Made by:"), Code(form.command)] if form.command else []
    named = {**({} if scenario is None else {"scenario": scenario}), **(parts or {})}
    hashes = [(f"{name} SHA-256", sha256(dump_part(part).encode()).hexdigest()) for name, part in named.items()]
    last = Section("Versions, and how to reproduce", (*blocks, pairs([*package_versions().items(), *hashes])))
    foot = made_by(package_versions()["microvib"], scenario)
    return Document(kind, title, subtitle, tuple(facts), tuple(first_page), (*sections, last), foot, form.title_block)


def made_by(version: str, scenario: Scenario | None = None) -> str:
    """The line at the foot: version, and what tells the scenario from all others."""
    tail = "" if scenario is None else f" · scenario SHA-256 {scenario_hash(scenario)[:16]}…"
    return f"microvib {version}{tail}"


def drawn(drawing: Drawing, alt: str, caption: str = "", turned: bool = False) -> Figure:
    """A figure of Matplotlib as a block."""
    return Figure(sheets.svg(drawing), alt, caption, turned)


def overlaid(sides: Sequence[tuple[str, np.ndarray, float]], what: str) -> Figure:
    """Spectra of several torques in one picture: the low end as curves, lines to 200 Hz as stems beside each other."""
    drawing, axes = sheets.plain_sheet(3.5, 1, 2)
    axes[0, 0].get_gridspec().set_width_ratios((1.0, 1.6))
    drawing.subplots_adjust()  # moves the axes
    figures.draw_overlay(axes[0, 0], sides, 5.0)
    figures.draw_stems(axes[0, 1], sides, 200.0)
    caption = (
        f"{what}. Amplitude spectra of T_d, one-sided, 0-to-peak, Hann window. Left, the low end. Right, the peaks to 200 Hz,"
        " those of one frequency drawn side by side."
    )
    return drawn(drawing, f"Spectra: {what}", caption)


def number(value: float, digits: int = 4) -> str:
    """A figure with at most so many digits; empty where there is none."""
    return f"{value:.{digits}g}" if math.isfinite(value) else ""


def figure(value: float, digits: int = 4, scale: float = 1.0) -> str:
    """A figure with so many digits, zeros at its end included; empty where there is none."""
    return f"{value * scale:#.{digits}g}".rstrip(".") if math.isfinite(value) else ""


def milli(value: float, digits: int = 4) -> str:
    """A torque [N m] in mN m with so many digits."""
    return figure(value, digits, 1e3)


def torque(value: float) -> str:
    """A torque [N m] with its unit: in mN m below one."""
    return f"{figure(value)} N m" if abs(value) >= 1.0 else f"{milli(value)} mN m"


def given(value: float) -> str:
    """A torque [N m] that somebody chose, with its unit, in as many digits as were given."""
    return f"{value:.6g} N m" if abs(value) >= 1.0 else f"{1e3 * value:.6g} mN m"


def plain(value: float, digits: int = 4) -> str:
    """A figure with at most so many digits and, up to a million, without an exponent."""
    return f"{float(f'{value:.{digits}g}'):g}"


def signed(value: float, decimals: int = 2) -> str:
    """A figure with its sign; what rounds to zero is +0."""
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"


def with_error(value: float, error: float) -> str:
    """A value with its standard error: two digits of the error, and as many decimals of the value."""
    if not (math.isfinite(error) and error > 0.0):
        return number(value)
    decimals = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"


def percent(value: float) -> str:
    """A relative difference in per cent, to a tenth of one, or below ten a hundredth; empty where there is none."""
    return f"{100 * value:+.{1 if abs(value) >= 0.1 else 2}f}" if math.isfinite(value) else ""


def count(n: int, what: str) -> str:
    """A number of things in words."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def short(text: str, most: int) -> str:
    """The text, cut where it is too long for its place."""
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"
