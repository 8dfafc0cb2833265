"""Tables for the terminal: one way of making them, and of folding them where it is narrow."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from typing import NamedTuple

_GAP = "  "
_UNDER = 4
"""Columns by which a last cell is indented that stands below its row."""
_LEAST = 20
"""Columns below which no table is folded."""
_WORD = 8
"""Letters of a last cell that count as a word, such as a verdict."""
_SOLID = str.maketrans(" ", "\N{NO-BREAK SPACE}")
_UNIT = re.compile(
    r"(?:\d |\b)[mµn]?N m\b|\bkg m\b|\d (?:%|(?:[mµnk]?(?:N|Hz|rad|s|J|V|A|W|m)|deg(?:/s)?|dB)(?![A-Za-z]))"
)
"""Texts kept on one line: a figure and its unit, and a unit of two words."""

_terminal: ContextVar[int | None] = ContextVar("_terminal", default=None)


def counted(count: int, noun: str) -> str:
    """A number and what it counts, such as ``1 line`` or ``3 lines``."""
    if count == 1:
        return f"1 {noun}"
    return f"{count} {noun}s"


def set_columns(columns: int | None) -> None:
    """Say how many columns the terminal has that tables are printed to; None where lines may have
    any length.
    """
    _terminal.set(columns)


def columns() -> int | None:
    """Columns of a line: what the environment's ``COLUMNS`` says, or else the terminal that was
    told; None without limit.
    """
    said = os.environ.get("COLUMNS", "")
    if said.isdigit() and int(said) > 0:
        return int(said)
    return _terminal.get()


def text_table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    left: int = 0,
    last_left: bool = False,
    indent: int = 0,
) -> str:
    """A table for the terminal, cells to the right under their heads, each column as wide as its
    widest cell.

    Words may stand to the ``left`` in so many columns at the beginning, and in the last one
    (``last_left``). The caller adds an ``indent`` of so many columns. Where the terminal is
    narrower than the table, words fold and figures never do: heads and words at the beginning; a
    last cell of words goes below its row; and columns for which there is no room go on in a table
    below, behind the first ones again.
    """
    single = [tuple([text] for text in row) for row in (header, *rows)]
    whole = _Block(single[0], tuple(single[1:]), left, last_left)
    limit = columns()
    if limit is None or whole.width <= limit - indent:
        return "\n".join(whole.lines(None))
    most = max(limit - indent, _LEAST)
    blocks = _blocks(_folded(header, rows, left, last_left, most), left, last_left, most)
    return "\n\n".join("\n".join(block.lines(most)) for block in blocks)


class _Block(NamedTuple):
    """Heads and cells as lines of text, how many columns stand to the left, and whether the last
    one does.
    """

    header: tuple[list[str], ...]
    rows: tuple[tuple[list[str], ...], ...]
    left: int
    last_left: bool

    @property
    def widths(self) -> list[int]:
        """Width of each column."""
        return [
            max(len(text) for cell in column for text in cell)
            for column in zip(self.header, *self.rows, strict=True)
        ]

    @property
    def width(self) -> int:
        """Width of the table."""
        return sum(self.widths) + len(_GAP) * (len(self.header) - 1)

    def lines(self, most: int | None) -> Iterator[str]:
        """The table line by line; last cells of words go below their rows where they do not fit in
        ``most`` columns.
        """
        yield from self._row(_at_bottom(self.header), most)
        for row in self.rows:
            yield from self._row(row, most)

    def _row(self, row: Sequence[list[str]], most: int | None) -> Iterator[str]:
        widths = self.widths
        end = len(widths) - self.last_left
        if most is None:
            room = None
        else:
            room = most - sum(widths[:end]) - len(_GAP) * end
        last = row[-1] if self.last_left else []
        below = room is not None and any(len(text) > room for text in last)
        shown = row
        if below:
            shown = [*row[:end], []]
        for k in range(max(1, *map(len, shown))):
            cells = [cell[k] if k < len(cell) else "" for cell in shown]
            yield _GAP.join(self._placed(c, text, widths) for c, text in enumerate(cells)).rstrip()
        if below and most is not None:
            yield from (" " * _UNDER + line for line in wrapped(" ".join(last), most - _UNDER))

    def _placed(self, column: int, text: str, widths: Sequence[int]) -> str:
        if self.last_left and column == len(widths) - 1:
            return text
        if column < self.left:
            return text.ljust(widths[column])
        return text.rjust(widths[column])


def _at_bottom(header: Sequence[list[str]]) -> list[list[str]]:
    """Heads of one height, which stand at the bottom."""
    high = max(map(len, header))
    return [[""] * (high - len(lines)) + lines for lines in header]


def wrapped(text: str, width: int, indent: int = 0) -> list[str]:
    """Lines between words, the later ones behind an ``indent``; a figure stays with its unit, and
    longer words stay whole.
    """
    fold = textwrap.TextWrapper(
        max(width, 1),
        subsequent_indent=" " * indent,
        replace_whitespace=False,
        break_long_words=False,
        break_on_hyphens=False,
    )
    lines = fold.wrap(_UNIT.sub(lambda found: found[0].translate(_SOLID), text))
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines] or [""]


def _folded(
    header: Sequence[str], rows: Sequence[Sequence[str]], left: int, last_left: bool, most: int
) -> list[list[list[str]]]:
    """Columns with their heads as lines of text: heads are as wide as their cells, words at the
    beginning a part of the line.
    """
    found = []
    for k, (head, *cells) in enumerate(zip(header, *rows, strict=True)):
        lines = [wrapped(cell, 2 * most // 5) if k < left else [cell] for cell in cells]
        widest = max((len(text) for cell in lines for text in cell), default=0)
        found.append([wrapped(head, max(widest, max(map(len, wrapped(head, 1))))), *lines])
    if last_left:
        found[-1][0] = [header[-1]]
    return found


def _blocks(
    folded: list[list[list[str]]], left: int, last_left: bool, most: int
) -> Iterator[_Block]:
    """Tables one below the other, each of as many columns as fit behind the first ones."""
    wide = [max(len(text) for cell in column for text in cell) + len(_GAP) for column in folded]
    end = len(folded) - last_left
    keys = min(max(left, 1), end)
    room = most + len(_GAP) - sum(wide[:keys])
    groups: list[list[int]] = [[]]
    for k in range(keys, end):
        needed = sum(wide[c] for c in groups[-1]) + wide[k]
        if last_left and k == end - 1:
            needed += _short(folded[-1])
        if groups[-1] and needed > room:
            groups.append([])
        groups[-1].append(k)
    if last_left:
        groups[-1].append(end)
    for group in groups:
        header, *rows = zip(*(folded[c] for c in [*range(keys), *group]), strict=True)
        yield _Block(header, tuple(rows), left, last_left and end in group)


def _short(column: list[list[str]]) -> int:
    """Room that most cells of a last column need, where these are single words; others may go below
    their rows.
    """
    sizes = sorted(len(" ".join(cell)) for cell in column[1:])
    middle = sizes[len(sizes) // 2] if sizes else 0
    if middle <= _WORD:
        return len(_GAP) + middle
    return 0
