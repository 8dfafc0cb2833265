"""A report as data: one frozen tree of blocks. Studies build it, ``rendering`` draws it as HTML and
as PDF.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from microvib.reports.title_block import TitleBlock
from microvib.results import Mark as Mark

Status = Literal["", "pass", "fail"]


@dataclass(frozen=True)
class Form:
    """User's settings of a report: also as PDF, the command as it was typed, and what the title
    block says.
    """

    pdf: bool = False
    command: str = ""
    title_block: TitleBlock = field(default_factory=TitleBlock)


@dataclass(frozen=True)
class Fact:
    """A leading figure: its value with unit, what it is, and whether it passes or fails, if
    anything was asked of it.
    """

    value: str
    label: str
    status: Status = ""


@dataclass(frozen=True)
class Text:
    """A paragraph of plain text; what stands between backticks is code. A note is set small."""

    text: str
    note: bool = False


@dataclass(frozen=True)
class Code:
    """A command, to be copied."""

    text: str


@dataclass(frozen=True)
class Column:
    """Head of a column; figures go to the right, names of keys are set as code."""

    title: str
    unit: str = ""
    kind: Literal["text", "number", "code"] = "text"


@dataclass(frozen=True)
class Row:
    """Cells of a row; a group is a heading over the whole width, and has one cell."""

    cells: tuple[str, ...]
    mark: Mark = ""


@dataclass(frozen=True)
class Table:
    """Rows under columns; without any title there is no head."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    caption: str = ""


@dataclass(frozen=True)
class Figure:
    """A picture as SVG, with what it shows in words for those who do not see it.

    A ``turned`` one is printed on a page of its own, which lies on its side.
    """

    svg: str
    alt: str
    caption: str = ""
    turned: bool = False


@dataclass(frozen=True)
class AnimatedMarkup:
    """Markup of our own that moves: for HTML only, print leaves it out."""

    html: str


Block = Text | Code | Table | Figure | AnimatedMarkup


@dataclass(frozen=True)
class Section:
    """A heading and its blocks; ``new_page`` starts a page in print."""

    title: str
    blocks: tuple[Block, ...]
    new_page: bool = False


@dataclass(frozen=True)
class Document:
    """A whole report. ``first_page`` follows facts and title block there; ``made`` is the line at
    the foot of every page.
    """

    kind: str
    title: str
    subtitle: str
    facts: tuple[Fact, ...]
    first_page: tuple[Block, ...]
    sections: tuple[Section, ...]
    made: str
    title_block: TitleBlock = field(default_factory=TitleBlock)

    def in_form(self, form: Form) -> Document:
        """The report of a study as it was asked for: with its title block, and before the versions
        the command that made it.
        """
        *others, last = self.sections
        command = (Text("Made by:"), Code(form.command)) if form.command else ()
        last = replace(last, blocks=(*last.blocks[:-1], *command, last.blocks[-1]))
        return replace(self, sections=(*others, last), title_block=form.title_block)


Contents = tuple[dict[str, Any], Document]
"""Contents of a study's folder: its files by name, as ``write_folder`` takes them, and its
report.
"""


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    caption: str = "",
    marks: Mapping[int, Mark] | None = None,
) -> Table:
    """A table from texts; ``marks`` marks rows, by their number.

    ``amplitude [mN m]`` heads a column of figures, ``factor [1]`` one without unit, and a head
    between backticks one of keys.
    """
    marks = marks or {}
    made = tuple(Row(tuple(cells), marks.get(k, "")) for k, cells in enumerate(rows))
    return Table(tuple(_column(text) for text in header), made, caption)


def _column(text: str) -> Column:
    if text.startswith("`"):
        return Column(text.strip("`"), kind="code")
    title, bracket, unit = text.partition(" [")
    if not bracket:
        return Column(text)
    return Column(title, "" if unit == "1]" else unit.removesuffix("]"), "number")


def pairs(rows: Iterable[tuple[str, str]]) -> Table:
    """Names and what they stand for, without a head."""
    return Table((Column(""), Column("")), tuple(map(Row, rows)))
