"""Outcome of a study, declared once, and its renderings: a terminal's text, a report, files, the
page's answer.

A study's module makes one ``Outcome`` of its result. Whatever is shown of it anywhere comes from
there, so that all say the same in the same units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from microvib.io.tables import rows_csv, to_json
from microvib.model.part import Part as ModelPart
from microvib.model.scenario import Scenario
from microvib.reports import document, sheets
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import Block, Code, Contents, Document, Fact, Section, Text
from microvib.reports.drawn_points import drawn_points
from microvib.reports.rendering import address
from microvib.results import MARKS, Column, Measure, Table
from microvib.text_tables import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Verdict = Literal["", "pass", "fail", "not judged"]


@dataclass(frozen=True)
class Picture:
    """A figure, drawn when it is asked for."""

    name: str
    """Name of its PNG file, without the ending; empty for one that reports alone have."""
    draw: Callable[[], Figure]
    title: str
    """Alternative text."""
    caption: str = ""
    turned: bool = False
    """Whether it is printed on a page of its own, which lies on its side."""


@dataclass(frozen=True)
class Pairs:
    """Names and what they stand for, a line each."""

    rows: tuple[tuple[str, str], ...]

    @property
    def lines(self) -> list[str]:
        """As text."""
        return [f"{name}: {text}" for name, text in self.rows]


Item = Text | Table | Picture | Pairs


@dataclass(frozen=True)
class Part:
    """A heading and what stands below it, in every form; the first part of an outcome has none."""

    title: str
    items: tuple[Item, ...]
    new_page: bool = False
    report_only: bool = False
    """Whether neither terminal nor page shows it."""
    not_on_terminal: bool = False
    """Whether a terminal leaves it out, where a page, on which one can scroll, has it."""

    def in_units(self, chosen: Sequence[Measure]) -> Part:
        """The part with all its tables in the units that were chosen."""
        items = list(self.items)
        for measure in chosen:
            items = [x.in_unit(measure) if isinstance(x, Table) else x for x in items]
        return replace(self, items=tuple(items))

    @property
    def shown(self) -> list[Item]:
        """The items that readers see: tables without rows are in files only."""
        return [x for x in self.items if not (isinstance(x, Table) and not x.rows_shown)]


def _units_of(tables: Iterable[Table]) -> list[Measure]:
    """The unit that suits all figures of some tables, for each measure with a choice of units."""
    figures: dict[Measure, list[float]] = {}
    for table in tables:
        for k, column in enumerate(table.columns):
            if column.measure is not None and column.measure.units:
                found = figures.setdefault(replace(column.measure, form="", least=0.0), [])
                found += [row[k] for row in table.rows_shown if not isinstance(row[k], str)]
    return [measure.suited_to(values) for measure, values in figures.items()]


@dataclass(frozen=True)
class Outcome:
    """The result of a study for those who read it."""

    kind: str
    """Kind of study, such as *Rate plan*."""
    title: str
    summary: str
    """Summary, a sentence."""
    verdict: Verdict
    """On what was asked of it; empty where nothing was."""
    facts: tuple[Fact, ...]
    """Leading figures of a report."""
    parts: tuple[Part, ...]
    """The first is the first page of a report. Parts of which nothing is shown are left out."""
    scenario: Scenario | None = None
    """Scenario of the study."""
    files: tuple[Table, ...] = ()
    """Tables that are in files only."""
    data: Mapping[str, Any] = field(default_factory=dict)
    """Contents of JSON files by their names, without the ending."""
    other_files: Mapping[str, str] = field(default_factory=dict)
    """Further files by their names, such as a scenario that was found."""
    descriptions: Mapping[str, ModelPart] = field(default_factory=dict)
    """Further descriptions it is based on, by kind; a report has their hashes."""
    again: tuple[Text | Code, ...] = ()
    """How to do it again, besides the command that was typed."""
    versions: Mapping[str, str] | None = None
    """That made it; None for today's."""
    units: tuple[Measure, ...] = ()
    """Measures of its texts and pictures in the units that they are in, which its tables take."""

    def __post_init__(self) -> None:
        tables = [x for part in self.parts for x in part.shown if isinstance(x, Table)]
        chosen = [*self.units, *_units_of(tables)]
        object.__setattr__(self, "parts", tuple(part.in_units(chosen) for part in self.parts))

    @property
    def tables(self) -> list[Table]:
        """All tables with a name, those of the parts first."""
        shown = [item for part in self.parts for item in part.items if isinstance(item, Table)]
        return [table for table in (*shown, *self.files) if table.name]

    @property
    def pictures(self) -> list[Picture]:
        """All pictures."""
        return [item for part in self.parts for item in part.items if isinstance(item, Picture)]


def terminal_text(outcome: Outcome) -> str:
    """The outcome as text, its tables as wide as the terminal allows; pictures are left out.

    The first part stands last where it has a verdict: there a terminal shows it.
    """
    blocks = [outcome.summary]
    first, *others = outcome.parts
    for part in (*others, first) if outcome.verdict else outcome.parts:
        if part.report_only or part.not_on_terminal:
            continue
        texts = [text for item in part.shown if (text := _terminal_item(item))]
        if texts and part.title:
            texts[0] = f"{part.title}:\n{texts[0]}"
        blocks += texts
    return "\n\n".join(blocks)


def _terminal_item(item: Item) -> str:
    if isinstance(item, Text):
        return _plain(item)
    if isinstance(item, Picture):
        return ""
    if isinstance(item, Pairs):
        return "\n".join(item.lines)
    if item.brief == 0:
        return ""
    item = item.only([x.key for x in item.shown if not x.report_only])
    words = [x.measure is None for x in item.shown]
    left = words.index(False) if False in words else len(words) - 1
    head = [x.title for x in item.shown]
    return text_table(head, item.texts(item.brief), left=left, last_left=words[-1])


def _plain(item: Text) -> str:
    """A text without the marks of code."""
    return item.text.replace("`", "")


def study_contents(outcome: Outcome) -> Contents:
    """Files of the outcome by name, CSV, JSON and PNG, and its report."""
    drawn = {picture: picture.draw() for picture in outcome.pictures}
    files: dict[str, Any] = {**text_files(outcome)}
    files |= {f"{one.name}.png": sheets.png(figure) for one, figure in drawn.items() if one.name}
    return files, report(outcome, drawn)


def report(outcome: Outcome, drawn: Mapping[Picture, Figure] | None = None) -> Document:
    """The outcome as a report; pictures that are ``drawn`` already are taken as they are."""
    drawn = drawn or {}

    def blocks(part: Part) -> Iterator[Block]:
        for item in part.shown:
            if isinstance(item, Picture):
                figure = drawn[item] if item in drawn else item.draw()
                yield figure_block(figure, item.title, item.caption, item.turned)
            elif isinstance(item, Table):
                yield report_table(item)
            elif isinstance(item, Pairs):
                yield document.pairs(item.rows)
            else:
                yield item

    first, *others = outcome.parts
    return study_report(
        outcome.kind,
        outcome.title,
        outcome.summary,
        facts=outcome.facts,
        first_page=tuple(blocks(first)),
        sections=[
            Section(part.title, tuple(blocks(part)), part.new_page) for part in others if part.shown
        ],
        scenario=outcome.scenario,
        parts=outcome.descriptions,
        versions=outcome.versions,
        again=outcome.again,
    )


def text_files(outcome: Outcome) -> dict[str, str]:
    """Files of the outcome that are text by name: CSV, JSON and others."""
    tables = {
        f"{table.name}.csv": rows_csv([x.key for x in table.columns], table.file_rows())
        for table in outcome.tables
    }
    data = {f"{name}.json": to_json(data) for name, data in outcome.data.items()}
    return tables | data | dict(outcome.other_files)


def report_table(table: Table) -> document.Table:
    """A table of results as a report's: groups under their words, the verdict of each row at its
    end.
    """
    order = sorted(range(len(table.shown)), key=lambda k: table.shown[k].role == "verdict")
    columns = [k for k in order if table.shown[k].role != "group"]
    group = next((k for k in order if table.shown[k].role == "group"), None)
    rows, before = [], ""
    for cells, mark in zip(table.texts(), table.marks(), strict=True):
        if group is not None and cells[group] != before:
            before = cells[group]
            rows.append(document.Row((before,), "group"))
        rows.append(document.Row(tuple(cells[k] for k in columns), mark))
    heads = tuple(_report_column(table.shown[k]) for k in columns)
    return document.Table(heads, tuple(rows), table.caption)


def _report_column(column: Column) -> document.Column:
    if column.measure is None:
        return document.Column(column.heading, kind="code" if column.role == "key" else "text")
    return document.Column(column.heading, column.measure.unit, "number")


def page_answer(outcome: Outcome, *, pictures: bool = False) -> dict[str, Any]:
    """The outcome for the page: the items of its parts, cells as texts.

    The ``pictures`` are given where the page does not draw them itself.
    """
    return {
        "summary": outcome.summary,
        "verdict": outcome.verdict,
        "facts": page_facts(outcome.facts),
        "parts": [
            page_part(part, pictures)
            for k, part in enumerate(outcome.parts)
            if k == 0 or (part.shown and not part.report_only)
        ],
    }


def page_facts(facts: Iterable[Fact]) -> list[dict[str, str]]:
    """Leading figures for the page."""
    return [{"value": x.value, "label": x.label, "status": x.status} for x in facts]


def page_part(part: Part, pictures: bool = False) -> dict[str, Any]:
    """A part for the page."""
    items = (_page_item(item, pictures) for item in part.shown)
    return {"title": part.title, "items": [item for item in items if item]}


def _page_item(item: Item, pictures: bool) -> dict[str, Any]:
    """One item by its kind; empty where the page has no use for it."""
    if isinstance(item, Text):
        return {"kind": "text", "text": _plain(item), "note": item.note}
    if isinstance(item, Pairs):
        return {"kind": "pairs", "rows": [list(row) for row in item.rows]}
    if isinstance(item, Table):
        return {} if item.brief == 0 else _page_table(item)
    if not pictures:
        return {}
    drawing = item.draw()
    points = drawn_points(drawing)
    return {
        "kind": "picture",
        "title": item.title,
        "caption": item.caption,
        "source": address(sheets.svg(drawing)),
        "points": points if len(points) <= _MAX_POINTS else [],
    }


_MAX_POINTS = 12_000
"""Points of a picture that the page gets as figures; files of the study hold those of larger ones."""


def _page_table(table: Table) -> dict[str, Any]:
    def by_key(rows: list[list[str]]) -> list[dict[str, str]]:
        return [dict(zip((x.key for x in table.shown), row, strict=True)) for row in rows]

    left_out = table.for_readers is not None and len(table.rows_shown) < len(table.rows)
    return {
        "kind": "table",
        "name": table.name,
        "caption": table.caption.replace("`", ""),
        "columns": [_page_column(column) for column in table.shown],
        "rows": by_key(table.texts()),
        "all_rows": by_key(table.all_texts()) if left_out else None,
    }


def _page_column(column: Column) -> dict[str, Any]:
    """A column for the page; of verdicts with the marks of their words."""
    marks = {}
    if column.role == "verdict":
        marks = {column.text(word): mark for word, mark in MARKS.items()}
    return {
        "key": column.key,
        "title": column.heading,
        "unit": column.measure.unit if column.measure else "",
        "marks": marks,
    }
