"""Acceptance report from a template: Markdown with Jinja's marks, in which named parts stand for tables,
pictures and texts of the test.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from microvib.errors import MicrovibError, did_you_mean
from microvib.reports import document, sheets
from microvib.reports.analysis import analysis_outcome
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.comparison import comparison_outcome
from microvib.reports.document import Block, Contents, Fact, Section, Text
from microvib.reports.hammer import hammer_outcome
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture, report_table, text_files
from microvib.reports.repeatability import repeatability_outcome
from microvib.reports.run.margins import margin_tables
from microvib.reports.typography import file_name
from microvib.results import DECIBEL, Column, Table
from microvib.studies.acceptance import AcceptanceTest, JudgedRun
from microvib.studies.compare import misread
from microvib.text_tables import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_TEMPLATE = 1_000_000
"""Bytes of the largest template that is read."""
_MARK = re.compile(r"\x02([^\x03]*)\x03")
"""Mark that a part leaves in the rendered text."""


@dataclass(frozen=True, eq=False)
class NamedParts:
    """Parts of a test or a run by their names, as a template has them; a part that is not there says which
    are.
    """

    prefix: str
    items: Mapping[str, tuple[Item, ...]]
    facts: Mapping[str, str] = field(default_factory=dict)
    """Words that stand in a text, such as a verdict."""

    def __getattr__(self, name: str) -> str:
        if name in self.facts:
            return self.facts[name]
        if name in self.items:
            return f"\n\n\x02{self.prefix}{name}\x03\n\n"
        if name.startswith("_"):
            raise AttributeError(name)
        known = (*self.facts, *self.items)
        what = self.prefix.removesuffix(".") or "the test"
        raise MicrovibError(
            f"{what} has no part '{name}'; {did_you_mean(name, known)}there are {', '.join(known)}"
        )


def acceptance_contents(
    test: AcceptanceTest, template: str, name: str, data: Mapping[str, Any]
) -> Contents:
    """Files of an acceptance report, and the report, from the text of a ``template`` called ``name``.

    ``data`` are words of the user, which the template has as ``data``. MicrovibError where the template is
    wrong: in which line, and which parts there are.
    """
    whole, runs, outcomes = _parts(test)
    text = _rendered(template, name, {"test": whole, "runs": runs, "data": _Words(data)})
    every = {f"test.{key}": items for key, items in whole.items.items()}
    for run in runs:
        every |= {f"{run.prefix}{key}": items for key, items in run.items.items()}
    used = list(dict.fromkeys(_MARK.findall(text)))
    drawn = {
        picture: picture.draw()
        for key in used
        for picture in every[key]
        if isinstance(picture, Picture)
    }
    names = {
        picture: _picture_name(key, picture)
        for key in used
        for picture in every[key]
        if isinstance(picture, Picture)
    }
    files: dict[str, Any] = {"report.md": _as_markdown(text, every, names)}
    for prefix, outcome in outcomes.items():
        files |= {f"{prefix}{file}": content for file, content in text_files(outcome).items()}
    files |= {f"{names[picture]}.png": sheets.png(figure) for picture, figure in drawn.items()}
    title, first, sections = _as_sections(text, every, drawn)
    report = study_report(
        "Acceptance report",
        title or "Acceptance test",
        f"{counted(len(test.runs), 'run')}, channel {test.channel}.",
        facts=tuple(_facts(test)),
        first_page=first,
        sections=sections,
    )
    return files, report


def acceptance_outcome(test: AcceptanceTest) -> Outcome:
    """An acceptance test for those who read it, whatever the template of its report has: verdicts, conclusion,
    and what the report's template may take.
    """
    whole, _, _ = _parts(test)
    parts = (
        ("", ("verdicts", "conclusion")),
        ("The table", ("table_resonances",)),
        ("Repeatability", ("repeatability", "outliers")),
        ("Against the reference", ("comparison",)),
    )
    return Outcome(
        "Acceptance report",
        "Acceptance test",
        f"{counted(len(test.runs), 'run')}, channel {test.channel}.",
        test.verdict,
        tuple(_facts(test)),
        tuple(
            Part(title, tuple(item for name in names for item in whole.items.get(name, ())))
            for title, names in parts
        ),
    )


class _Words(dict[str, Any]):
    """The user's words; one that is missing is a sentence."""

    def __getattr__(self, name: str) -> Any:
        if name in self:
            value = self[name]
            return _Words(value) if isinstance(value, dict) else value
        if name.startswith("_"):
            raise AttributeError(name)
        raise MicrovibError(
            f"data has no '{name}'; there are {', '.join(self) or 'none'} (--data names the file)"
        )


def _parts(test: AcceptanceTest) -> tuple[NamedParts, list[NamedParts], dict[str, Outcome]]:
    """Parts of the test and of each run, and the outcomes that they are of, by what their files' names
    begin with.
    """
    outcomes: dict[str, Outcome] = {}
    runs = []
    for k, run in enumerate(test.runs, 1):
        outcome = analysis_outcome(run.analysis)
        outcomes[f"run_{k}_"] = outcome
        runs.append(_run_parts(k, run, outcome))
    items: dict[str, tuple[Item, ...]] = {"verdicts": (_verdicts(test),)}
    items["conclusion"] = tuple(map(Text, _conclusion(test)))
    if test.repeatability is not None:
        outcomes["repeatability_"] = repeated = repeatability_outcome(test.repeatability)
        items["repeatability"] = _items_of(repeated, f"Lines of {test.channel}")
        items["outliers"] = _items_of(repeated, "Outliers")
    if test.comparison is not None:
        outcomes["comparison_"] = compared = comparison_outcome(*test.comparison)
        items["comparison"] = compared.parts[0].items
    if test.hammer is not None:
        outcomes["table_"] = hit = hammer_outcome(test.hammer)
        items["table_resonances"] = hit.parts[0].items
        items["table_responses"] = _items_of(hit, "Responses")
        items["table_blows"] = _items_of(hit, "Blows left out")
    facts = {"verdict": test.verdict.upper() if test.verdict == "fail" else test.verdict}
    facts["channel"] = test.channel
    facts["compared"] = "" if test.comparison is None else "yes"
    facts["limit"] = "none" if test.limit is None else str(repr(test.limit))
    return NamedParts("test.", items, facts), runs, outcomes


def _run_parts(k: int, run: JudgedRun, outcome: Outcome) -> NamedParts:
    first = outcome.parts[0].items
    items: dict[str, tuple[Item, ...]] = {
        "about": tuple(x for x in first if isinstance(x, Pairs)),
        "spectrum": tuple(x for x in first if not isinstance(x, Pairs)),
        "lines": _items_of(outcome, "Lines"),
        "background": _items_of(outcome, "Lines with the drive off"),
        "density": _items_of(outcome, "Power spectral density"),
        "waterfall": _items_of(outcome, "Waterfall"),
        "bands": _items_of(outcome, "RMS in bands"),
    }
    if run.judgement is not None:
        items["limit"] = (Text(str(run.judgement)), *margin_tables(run.judgement))
    facts = {"name": file_name(run.run.name), "unit": run.run.unit, "verdict": run.verdict}
    return NamedParts(f"run {k}.", items, facts)


def _items_of(outcome: Outcome, title: str) -> tuple[Item, ...]:
    return next((tuple(part.shown) for part in outcome.parts if part.title == title), ())


@dataclass(frozen=True)
class _RunVerdict:
    run: Annotated[str, Column("run", "run")]
    unit: Annotated[str, Column("unit", "unit")]
    line: Annotated[str, Column("line", "smallest margin judged")]
    margin: Annotated[float, Column("margin_db", "margin", DECIBEL)]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]


def _verdicts(test: AcceptanceTest) -> Table:
    rows = []
    for one in test.runs:
        worst = None if one.judgement is None else one.judgement.worst
        name = "" if worst is None else worst.line.name
        margin = float("nan") if worst is None else worst.decibel
        rows.append(_RunVerdict(file_name(one.run.name), one.run.unit, name, margin, one.verdict))
    return Table.of("verdicts", _RunVerdict, rows)


def _conclusion(test: AcceptanceTest) -> Iterator[str]:
    """Sentences on what the test says, and what speaks against it."""
    if test.limit is None:
        yield "Nothing is judged: no limit was given."
    else:
        by = {v: sum(run.verdict == v for run in test.runs) for v in ("pass", "fail", "not judged")}
        told = ", ".join(f"{count} {verdict}" for verdict, count in by.items() if count)
        yield f"{test.limit!r}: {counted(len(test.runs), 'run')}, {told}."
        for run in test.runs:
            if run.judgement is not None and run.verdict != "pass":
                yield f"{file_name(run.run.name)}: {run.judgement}"
        passed = [run.judgement for run in test.runs if run.judgement and run.verdict == "pass"]
        yield from dict.fromkeys(one.assumption for one in passed if one.assumption)
    for warning in test.run_warnings:
        yield f"Not passed while this is open: {warning}"
    if test.repeatability is not None:
        for name, part in test.repeatability.outlying_runs.items():
            yield f"{file_name(name)} is an outlier in most of its lines ({100.0 * part:+.3g} %): it stays in."
    if test.comparison is not None:
        open_yet = "Not passed while this is open: " if test.is_misread else ""
        a, b = test.comparison.a.name, test.comparison.b.name
        for sentence in (*misread(*test.comparison), *test.lacking_in_band):
            yield f"{open_yet}of {file_name(a)} (A) and {file_name(b)} (B), {sentence}"


def conclusion_text(test: AcceptanceTest) -> str:
    """Verdict and conclusion for a terminal."""
    return "\n".join([f"Verdict: {test.verdict}", *_conclusion(test)])


def _facts(test: AcceptanceTest) -> Iterator[Fact]:
    status: document.Status = ""
    if test.verdict in ("pass", "fail"):
        status = "pass" if test.verdict == "pass" else "fail"
    yield Fact(test.verdict, "all runs against the limit", status)
    margins = [
        run.judgement.worst
        for run in test.runs
        if run.judgement is not None and run.judgement.worst
    ]
    if margins:
        worst = min(margins, key=lambda x: x.factor)
        yield Fact(DECIBEL.figure(worst.decibel), f"smallest margin judged, {worst.line.name}")
    yield Fact(str(len(test.runs)), "runs")


def _rendered(template: str, name: str, context: Mapping[str, Any]) -> str:
    """The template's text with marks in place of parts."""
    from jinja2 import StrictUndefined, TemplateError, TemplateSyntaxError
    from jinja2.sandbox import SandboxedEnvironment

    environment = SandboxedEnvironment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    try:
        return environment.from_string(template).render(context)
    except TemplateSyntaxError as error:
        raise MicrovibError(f"{name}, line {error.lineno}: {error.message}") from None
    except TemplateError as error:
        raise MicrovibError(f"{name}: {error}; a template has test, runs and data") from None
    except MicrovibError as error:
        raise MicrovibError(f"{name}: {error}") from None
    except (TypeError, ValueError, ArithmeticError) as error:
        raise MicrovibError(f"{name}: an expression of it fails ({error})") from None


def _picture_name(key: str, picture: Picture) -> str:
    return re.sub(r"\W+", "_", f"{key}_{picture.name}").strip("_")


def _as_markdown(
    text: str, every: Mapping[str, tuple[Item, ...]], names: Mapping[Picture, str]
) -> str:
    """The rendered text with its parts as Markdown."""

    def items(found: re.Match[str]) -> str:
        return "\n\n".join(_item_markdown(item, names) for item in every[found[1]])

    whole = _MARK.sub(items, text)
    return re.sub(r"\n{3,}", "\n\n", whole).strip() + "\n"


def _item_markdown(item: Item, names: Mapping[Picture, str]) -> str:
    if isinstance(item, Text):
        return item.text
    if isinstance(item, Pairs):
        return "\n".join(f"- {line}" for line in item.lines)
    if isinstance(item, Picture):
        return f"![{item.title}]({names[item]}.png)\n\n{item.caption}".rstrip()
    head = [column.title for column in item.shown]
    rows = [head, ["---"] * len(head), *item.texts()]
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + (f"\n\n{item.caption}" if item.caption else "")


def _as_sections(
    text: str, every: Mapping[str, tuple[Item, ...]], drawn: Mapping[Picture, Figure]
) -> tuple[str, list[Block], list[Section]]:
    """Title, first page and sections of the report by the headings of the rendered text."""
    title, heading = "", ""
    collected: list[tuple[str, list[Block]]] = [("", [])]
    for kind, content in _markdown_blocks(text):
        if kind == "title" and not title:
            title = content
        elif kind in ("title", "heading"):
            collected.append((content, []))
        elif kind == "part":
            collected[-1][1].extend(_block(item, drawn) for item in every[content])
        elif kind == "table":
            collected[-1][1].append(_plain_table(content))
        else:
            collected[-1][1].append(Text(content))
    heading, first = collected[0]
    return title, first, [Section(name, tuple(blocks)) for name, blocks in collected[1:]]


def _block(item: Item, drawn: Mapping[Picture, Figure]) -> Block:
    if isinstance(item, Picture):
        return figure_block(drawn[item], item.title, item.caption, item.turned)
    if isinstance(item, Table):
        return report_table(item)
    if isinstance(item, Pairs):
        return document.pairs(item.rows)
    return item


def _markdown_blocks(text: str) -> Iterator[tuple[str, Any]]:
    """Blocks of Markdown in their order: title, heading, text, table (rows of cells) and part (its name)."""
    from markdown_it import MarkdownIt

    tokens = MarkdownIt("commonmark").enable("table").parse(text)
    rows: list[list[str]] = []
    for k, token in enumerate(tokens):
        before = tokens[k - 1].type if k else ""
        if token.type == "tr_open":
            rows.append([])
        elif token.type == "table_close":
            yield "table", rows
            rows = []
        elif token.type in ("fence", "code_block"):
            yield "text", token.content
        elif token.type == "inline":
            if before in ("th_open", "td_open"):
                rows[-1].append(token.content)
            elif before == "heading_open":
                yield "title" if tokens[k - 1].tag == "h1" else "heading", _plain(token.content)
            else:
                yield from _paragraph(token.content, listed=token.level > 1)


def _paragraph(content: str, listed: bool) -> Iterator[tuple[str, str]]:
    """Texts of a paragraph or an entry of a list, and the parts that stand in it."""
    pieces = _MARK.split(content)
    for k, piece in enumerate(pieces):
        if k % 2:
            yield "part", piece
        elif piece.strip():
            yield "text", ("• " if listed else "") + _plain(piece.strip())


def _plain(text: str) -> str:
    """Text without marks of emphasis, its lines joined."""
    return re.sub(r"(\*\*|__)(.+?)\1", r"\2", text.replace("\n", " "))


def _plain_table(rows: Sequence[Sequence[str]]) -> document.Table:
    head, *others = rows
    return document.table(
        [_plain(cell) for cell in head], [[_plain(c) for c in row] for row in others]
    )


def read_template(path: Path) -> str:
    """Text of a template; MicrovibError where it cannot be read."""
    from microvib.io.named import read_text

    return read_text(path, "template", ())


def read_words(path: Path) -> dict[str, Any]:
    """The user's words of a YAML file; MicrovibError where it is no mapping."""
    from microvib.io.named import read_text

    return words_of(read_text(path, "data", ()), str(path))


def words_of(text: str, name: str) -> dict[str, Any]:
    """The user's words of a YAML text called ``name``; MicrovibError where it is no mapping."""
    from microvib.io.yaml_text import parse_yaml

    data = parse_yaml(text, name)
    if not isinstance(data, dict) or not all(isinstance(key, str) for key in data):
        raise MicrovibError(
            f"{name}: is not data of a report; lines such as 'unit: FM 2' are expected"
        )
    return data
