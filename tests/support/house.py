"""How the package's text reads, in figures: density, conditional expressions, private imports, words."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "src" / "microvib"
NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
BANNED = {
    "calm": "settled",
    "stirs": "excites",
    "ledger": "best so far",
    "costliest": "largest contributor",
    "drawn anew": "with a new seed",
    "surely": "single axis",
    "doubt": "error bound, tolerance or warning",
    "doubts": "error bounds or warnings",
    "doubtful": "questionable or uncertain",
    "misfits": "consistency errors",
    "deadly": "crashing",
    "mended": "repaired",
    "rivals": "alternative optima",
    "firm ground": "fixed base",
    "stand out": "are above the noise floor",
    "stands out": "is above the noise floor",
}
"""Words that a native engineer of the field would not guess, and plain ones; the list grows."""


@dataclass(frozen=True)
class Module:
    """One file of the package."""

    path: Path
    text: str

    @cached_property
    def tree(self) -> ast.Module:
        """Its syntax, read where a test asks for it: of all files that takes seconds."""
        return ast.parse(self.text)

    @property
    def room(self) -> str:
        """The package in which it is."""
        return self.path.relative_to(PACKAGE).parts[0]

    @property
    def is_compiled(self) -> bool:
        """Whether numba compiles it: there a choice between two numbers is an expression."""
        return "microvib.compiled import" in self.text and "Unit(" in self.text

    @property
    def nodes(self) -> int:
        """Nodes of the syntax tree."""
        return sum(1 for _ in ast.walk(self.tree))

    @property
    def code_lines(self) -> int:
        """Lines that have code, docstrings and comments left out."""
        lines: set[int] = set()
        for token in tokenize.generate_tokens(io.StringIO(self.text).readline):
            if token.type not in NO_CODE:
                lines.update(range(token.start[0], token.end[0] + 1))
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Expr) and _is_text(node.value):
                lines.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        return len(lines)

    @property
    def conditional_expressions(self) -> int:
        """How often ``a if b else c`` is written."""
        return sum(isinstance(node, ast.IfExp) for node in ast.walk(self.tree))

    def complexities(self) -> Iterator[Complexity]:
        """Every function with its complexity."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.FunctionDef):
                yield Complexity(self, node.name, node.lineno, complexity(node))

    def nested_conditionals(self) -> Iterator[str]:
        """Places of conditional expressions inside others."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.IfExp) and any(isinstance(x, ast.IfExp) for x in _below(node)):
                yield f"{self.path.name}:{node.lineno}"

    def private_imports(self) -> Iterator[str]:
        """Names with an underscore that come from other modules."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom):
                for name in node.names:
                    if name.name.startswith("_") and not name.name.startswith("__"):
                        yield f"{self.path.name}:{node.lineno} {name.name}"

    def banned_words(self) -> Iterator[str]:
        """Banned words in names and docstrings."""
        for node in ast.walk(self.tree):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                yield from self._banned(node.name.replace("_", " "), node.lineno)
            elif isinstance(node, ast.Expr) and _is_text(node.value):
                yield from self._banned(str(node.value.value), node.lineno)  # type: ignore[attr-defined]

    def vague_docstrings(self) -> Iterator[str]:
        """Docstrings that begin neither with a noun nor with a verb."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Expr) and _is_text(node.value):
                text = str(node.value.value).lstrip()  # type: ignore[attr-defined]
                if re.match(r"(What|Of|The same|Those|That of)\b", text):
                    yield f"{self.path.name}:{node.lineno} {text[:40]!r}"

    def _banned(self, text: str, line: int) -> Iterator[str]:
        for word, plain in BANNED.items():
            if re.search(rf"\b{word}\b", text.lower()):
                yield f"{self.path.name}:{line} '{word}'; plain is '{plain}'"


@dataclass(frozen=True)
class Complexity:
    """A function and its complexity."""

    module: Module
    name: str
    line: int
    value: int

    def __str__(self) -> str:
        return f"{self.value} {self.module.path.relative_to(PACKAGE)}:{self.line} {self.name}"


def complexity(function: ast.FunctionDef) -> int:
    """One, and one for each place at which a reader has to think of two ways.

    These are branches, loops, exceptions that are caught, ``and`` and ``or``, conditional
    expressions, the loops of comprehensions with what they select, cases of a match, and those of
    functions within it. ruff's C901 counts neither boolean operators nor expressions.
    """
    return 1 + sum(_ways(node) for node in ast.walk(function))


_BRANCHES = (
    ast.If,
    ast.For,
    ast.While,
    ast.ExceptHandler,
    ast.IfExp,
    ast.comprehension,
    ast.match_case,
)


def _ways(node: ast.AST) -> int:
    if isinstance(node, ast.BoolOp):
        return len(node.values) - 1
    return int(isinstance(node, _BRANCHES))


def modules() -> list[Module]:
    """All files of the package."""
    texts = ((path, path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py")))
    return [Module(path, text) for path, text in texts]


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _below(node: ast.AST) -> Iterator[ast.AST]:
    return (x for child in ast.iter_child_nodes(node) for x in ast.walk(child))
