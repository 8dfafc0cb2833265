"""Digests of the sources that kept code is made from, the same on every Python.

They are asked for in a checkout, where sources are edited; an installed package is as it was built.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


def editable() -> bool:
    """Whether this package runs from a checkout, with the project's file beside its sources."""
    return PACKAGE.parent.name == "src" and (PACKAGE.parents[1] / "pyproject.toml").is_file()


def text_digest(files: Sequence[Path]) -> str:
    """Digest of what is written in files."""
    return _digest(_text(file) for file in files)


def semantic_digest(files: Sequence[Path]) -> str:
    """Digest of what is meant in files: without comments, docstrings and layout. It takes a tenth
    of a second.
    """
    return _digest(repr(_meaning(ast.parse(_text(file)))) for file in files)


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def _digest(texts: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


def _meaning(node: object) -> object:
    """A node of a syntax tree as tuples. Fields that are empty are left out, since each Python has
    others.
    """
    if isinstance(node, list):
        return [_meaning(part) for part in node]
    if not isinstance(node, ast.AST):
        return node
    fields = dict(ast.iter_fields(node))
    if (
        isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
        and ast.get_docstring(node, clean=False) is not None
    ):
        fields["body"] = node.body[1:]
    if isinstance(node, ast.JoinedStr):  # Python 3.12 has empty strings in it
        fields["values"] = [
            part for part in node.values if not isinstance(part, ast.Constant) or part.value != ""
        ]
    return (
        type(node).__name__,
        *((name, _meaning(value)) for name, value in fields.items() if value not in (None, [])),
    )
