"""A document as HTML (one file, no network) and as PDF (A4, by Typst); both draw the same data."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from dataclasses import asdict
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from microvib.io.writing import write_folder
from microvib.reports.document import Block, Contents, Document, Form, Table
from microvib.reports.fonts import fallback_for, package_fonts
from microvib.reports.moving import markup
from microvib.reports.typography import typeset


def report_files(document: Document, form: Form) -> dict[str, str | bytes]:
    """``report.html``, and ``report.pdf`` where that was asked for, as ``write_folder`` takes them."""
    document = document.in_form(form)
    files: dict[str, str | bytes] = {"report.html": html(document)}
    if form.pdf:
        files["report.pdf"] = pdf(document)
    return files


def write_study(out: Path, contents: Contents, form: Form, overwrite: bool) -> tuple[str, ...]:
    """Write the folder of a study, its files and then its report, all or nothing; their names."""
    files = contents[0] | report_files(contents[1], form)
    write_folder(out, files, overwrite)
    return tuple(files)


def html(document: Document) -> str:
    """The document as one HTML file."""
    from jinja2 import Environment

    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"address": address, "inline": _inline, "symbols": _symbols, "key": _key}
    style = Markup(_template("style.css"))
    beside = not any(_is_wide(block) for block in document.first_page if isinstance(block, Table))
    template = environment.from_string(_template("report.html"))
    return template.render(style=style, beside=beside, policy=_policy(), **_data(document))


def _policy() -> str:
    """Content security policy of the file, whose texts are other people's: show it, and run the one
    script that is ours.
    """
    script = re.search(r'<script type="module">(.*?)</script>', markup({}, ()), re.DOTALL)
    assert script is not None
    ours = base64.b64encode(sha256(script[1].encode()).digest()).decode()
    allowed = f"script-src 'sha256-{ours}'; style-src 'unsafe-inline'; img-src data:"
    return f"default-src 'none'; {allowed}; base-uri 'none'; form-action 'none'"


def _is_wide(found: Table) -> bool:
    """Whether a table asks for more than half of a screen: its figures and names do not wrap, its
    texts do.
    """
    cells = [
        [row.cells[k] for row in found.rows if row.mark != "group"]
        for k in range(len(found.columns))
    ]
    longest = [max(map(len, texts), default=0) for texts in cells]
    wraps = [column.kind == "text" for column in found.columns]
    return sum(min(n, 20) + 3 if w else n + 3 for n, w in zip(longest, wraps, strict=True)) > 72


def pdf(document: Document) -> bytes:
    """The document as PDF, A4. Needs the library typst."""
    import typst

    # Texts reach the template as data, so that nothing in them is taken for markup.
    content = _data(document)
    fallback = fallback_for(_texts(content))
    data = json.dumps(
        {**content, "fonts": fallback.families, "notice": fallback.sentence}, ensure_ascii=False
    )
    made = typst.compile(  # type: ignore[misc]  # its stub ties the kind of the fonts' paths to that of the input
        _template("report.typ").encode(),
        font_paths=[str(package_fonts()), *fallback.folders],
        ignore_system_fonts=True,
        sys_inputs={"document": data},
        timestamp=0,
    )
    assert isinstance(made, bytes)
    return made


def _template(name: str) -> str:
    return (resources.files("microvib.reports") / "templates" / name).read_text(encoding="utf-8")


def _data(document: Document) -> dict[str, Any]:
    """The tree as plain data, each block with its kind, in the characters of print."""
    document = typeset(document)
    sections = [{**asdict(s), "blocks": [_block(b) for b in s.blocks]} for s in document.sections]
    block = {"facts": document.title_block.facts, "signatures": document.title_block.signatures}
    return {
        **asdict(document),
        "title_block": block,
        "first_page": [_block(b) for b in document.first_page],
        "sections": sections,
    }


def _texts(data: Any) -> Iterator[str]:
    """All texts of plain data but pictures, whose letters are outlines."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, dict):
        yield from (
            text
            for key, value in data.items()
            if key not in ("svg", "html")
            for text in _texts(value)
        )
    elif isinstance(data, (list, tuple)):
        yield from (text for value in data for text in _texts(value))


def _block(block: Block) -> dict[str, Any]:
    return {"block": type(block).__name__, **asdict(block)}


_SYMBOL = re.compile(r"\b([TJKf])_(d|e|f,m|f|g|l|h|m|flex)\b")
"""Symbols of the model that print sets with an index."""


def _symbols(text: str) -> Any:
    """Text for HTML, symbols with their index set low."""
    return Markup(_SYMBOL.sub(r"<i>\1</i><sub>\2</sub>", str(escape(text))))


def _inline(text: str) -> Any:
    """Inline markup, with text between backticks as code."""
    parts = text.split("`")
    return Markup("").join(
        Markup(f"<code>{escape(x)}</code>") if k % 2 else _symbols(x) for k, x in enumerate(parts)
    )


def _key(text: str) -> Any:
    """A dotted key that may break after its dots and underscores."""
    return Markup(re.sub(r"([._])", r"\1<wbr>", str(escape(text))))


def address(svg: str) -> str:
    """A picture as a data address, so that the page needs no other file."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()
