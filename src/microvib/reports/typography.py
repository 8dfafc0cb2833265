"""Characters as print sets them: minus signs, powers of ten, and no folder of the machine that made
a report.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace

from microvib.reports.document import (
    AnimatedMarkup,
    Block,
    Code,
    Column,
    Document,
    Figure,
    Row,
    Table,
    Text,
)

_MINUS = re.compile(r"(?<![\w.)\]/-])-(?=\.?\d)|(?<= )-(?= )")
_POWER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-])0*(\d+)\b")
_UNIT = re.compile(
    r"(?<=\d) (?=(?:m?N|k?Hz|kg|mm|ms|dB|MPa|deg|rad|s|m|[%°J])(?![\w-]))|(?<=N) (?=m\b)|(?<=\bkg) (?=m²)"
)
"""Spaces before and within units, where no line is broken."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_FOLDERS = re.compile(
    r"(?<![^\s\"'(=,:;])(?:~|\.\.|[A-Za-z]:)?[\\/](?:[^\\/\s\"'()]+[\\/])+(?=[^\\/\s])"
)
_ENDING = re.compile(r"\.[A-Za-z]\w{0,5}[.,:;]*$")
_FOLDERS_OF_ARGUMENT = re.compile(
    r"^((?:--?)?[\w.-]+=)?(?:~|\.\.|[A-Za-z]:)?[\\/](?:[^\\/]+[\\/])*(?=[^\\/])"
)


def typeset(document: Document) -> Document:
    """The document with the characters of print; code keeps its own."""
    return replace(
        document,
        title=typeset_text(document.title),
        subtitle=typeset_text(document.subtitle),
        facts=tuple(
            replace(f, value=typeset_text(f.value), label=typeset_text(f.label))
            for f in document.facts
        ),
        first_page=_blocks(document.first_page),
        sections=tuple(
            replace(s, title=typeset_text(s.title), blocks=_blocks(s.blocks))
            for s in document.sections
        ),
    )


def typeset_text(text: str) -> str:
    """Text in which figures have real minus signs and powers of ten, and files no folders; code
    keeps its characters.
    """
    parts = without_folders(text).split("`")
    return "`".join(part if k % 2 else _figures(part) for k, part in enumerate(parts))


def _figures(text: str) -> str:
    text = (
        _POWER.sub(_power, _MINUS.sub("\u2212", text)).replace(" >= ", " ≥ ").replace(" <= ", " ≤ ")
    )
    return _UNIT.sub("\u00a0", text)


def _power(found: re.Match[str]) -> str:
    exponent = superscript((found[2] + found[3]).lstrip("+"))
    if found[1] == "1":
        return f"10{exponent}"
    return f"{found[1]}\u00a0×\u00a010{exponent}"


def superscript(exponent: str) -> str:
    """An exponent's figures as characters of their own, which need no markup."""
    return exponent.translate(_RAISED)


def without_folders(text: str) -> str:
    """Text in which absolute paths are names of files. A slash that leads nowhere, as in *phases
    /A/B*, is a text's own.
    """
    return _FOLDERS.sub(lambda found: "" if _is_path(found) else found[0], text)


def _is_path(found: re.Match[str]) -> bool:
    """Whether what begins with a slash is a path: its file has an ending, or its first folder is on
    this machine.
    """
    if not found[0].startswith(("/", "\\")):
        return True  # of a home, a drive, or the folder above
    file = re.match(r"[^\\/\s\"'()]+", found.string[found.end() :])
    first = re.split(r"[\\/]", found[0])[1]
    return (file is not None and _ENDING.search(file[0]) is not None) or os.path.isdir(f"/{first}")


def file_name(source: str) -> str:
    """Name of a source in titles and legends: of a path its last part."""
    name = re.split(r"[\\/]", source.rstrip("\\/"))[-1]
    return name or source


def command_without_folders(command: str) -> str:
    """A command line, as ``shlex.join`` writes it, in which absolute paths are names of files."""
    try:
        words = shlex.split(command)
    except ValueError:
        return without_folders(command)
    return shlex.join(
        _FOLDERS_OF_ARGUMENT.sub(lambda found: found[1] or "", word) for word in words
    )


def _blocks(blocks: Sequence[Block]) -> tuple[Block, ...]:
    made: dict[type, Callable[..., Block]] = {
        Text: lambda b: replace(b, text=typeset_text(b.text)),
        Code: lambda b: replace(b, text=command_without_folders(b.text)),
        Figure: lambda b: replace(b, alt=typeset_text(b.alt), caption=typeset_text(b.caption)),
        Table: _table,
        AnimatedMarkup: lambda b: b,
    }
    return tuple(made[type(block)](block) for block in blocks)


def _table(found: Table) -> Table:
    """A table without the columns that say nothing in any row."""
    whole = [r for r in found.rows if r.mark != "group"]
    kept = [k for k in range(len(found.columns)) if not whole or any(r.cells[k] for r in whole)]
    columns = tuple(
        replace(found.columns[k], title=typeset_text(found.columns[k].title)) for k in kept
    )

    def cell(text: str, column: Column) -> str:
        if column.kind == "code":
            return without_folders(text)
        return typeset_text(text)

    def row(r: Row) -> Row:
        if r.mark == "group":
            return replace(r, cells=tuple(map(typeset_text, r.cells)))
        return replace(
            r, cells=tuple(cell(r.cells[k], c) for k, c in zip(kept, columns, strict=True))
        )

    return replace(
        found,
        columns=columns,
        rows=tuple(map(row, found.rows)),
        caption=typeset_text(found.caption),
    )
