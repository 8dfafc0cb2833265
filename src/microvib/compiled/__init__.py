"""Compiled functions that need no compiler when they run.

numba takes most of a minute to understand functions as large as the kernel, LLVM a second to make machine code of what comes
out. So what comes out, LLVM's code for any machine, is kept beside each module (``kernel.py``, ``kernel.llvm``), and a run
imports no numba:

    code = Unit(__name__, "a_file_it_depends_on.py")

    @code.inner(**OPTIONS)                # for compiled functions to call
    def square(x): ...

    @code.entry(**OPTIONS)                # for Python to call, with the types that it says
    def norm(x: Vector) -> float: ...

Kept code carries a digest of its sources. Where that is another one, because somebody edits them, or where this LLVM cannot
read it, numba compiles as ever, and what it makes goes the same way, by the user's cache (``microvib.compiled.machine``).
``python -m microvib.compiled`` makes anew what is kept.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cached_property, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any

from microvib.compiled.layout import Complexes, CountMatrix, Counts, Cube, Matrix, Signature, Vector

__all__ = ["Complexes", "CountMatrix", "Counts", "Cube", "Matrix", "Unit", "Vector"]

_LOCK = RLock()  # one thread at a time compiles and loads
_OWN = ("layout.py", "build.py")


class Function:
    """A function to be compiled by numba, for which it takes it."""

    def __init__(self, unit: Unit, python: Callable[..., Any], options: dict[str, Any]) -> None:
        self.unit, self.python, self.options = unit, python, options
        self.name, self.__doc__ = python.__name__, python.__doc__

    @cached_property
    def dispatcher(self) -> Any:
        """numba's own."""
        from numba import njit

        self.unit.prepare()
        return njit(**self.options)(self.python)

    def __call__(self, *arguments: Any) -> Any:
        """Call it, compiled on the spot."""
        return self.dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        if name not in ("_numba_type_", "targetoptions", "py_func"):  # what numba asks what it is to call or to inline
            raise AttributeError(name)
        return getattr(self.dispatcher, name)


class Entry(Function):
    """A function that Python calls; its annotations are its signature."""

    @cached_property
    def signature(self) -> Signature:
        """Arguments and result."""
        return Signature(self.python)

    @cached_property
    def _compiled(self) -> Callable[..., Any]:
        addresses = self.unit.addresses
        if not addresses:
            return self.dispatcher  # type: ignore[no-any-return]
        return self.signature.caller(addresses[self.name], addresses["deliver"])

    def __call__(self, *arguments: Any) -> Any:
        """Call the kept code."""
        return self._compiled(*arguments)


class Unit:
    """The compiled functions of one module, made and kept together."""

    def __init__(self, module: str, *sources: str, types: str | None = None) -> None:
        """``sources`` are files of its folder that the code is made from, and with each what its own unit is made from.

        ``types`` is a module that numba needs, unless that of one of those units.
        """
        self.module, self.types = module, types
        self.file = Path(str(sys.modules[module].__file__)).with_suffix(".llvm")
        self.sources = [self.file.with_suffix(".py")]
        for name in sources:
            unit = self._imported(name)
            self.types = self.types or (unit.types if unit else None)
            self.sources += unit.sources if unit else [self.file.parent / name]
        self.sources += [Path(__file__).parent / name for name in _OWN]
        self.sources = list(dict.fromkeys(self.sources))
        self.entries: dict[str, Entry] = {}

    def _imported(self, name: str) -> Unit | None:
        """The unit of another file of the folder, which the module has imported; None where it has none."""
        package, _, _ = self.module.rpartition(".")
        unit = getattr(sys.modules.get(f"{package}.{Path(name).stem}"), "code", None)
        return unit if isinstance(unit, Unit) else None

    def inner(self, **options: Any) -> Callable[[Callable[..., Any]], Any]:
        """Decorator of a function that compiled functions call; ``options`` are numba's."""
        return lambda python: Function(self, python, options)

    def entry(self, **options: Any) -> Callable[[Callable[..., Any]], Any]:
        """Decorator of a function that Python calls, too."""
        return lambda python: self.entries.setdefault(python.__name__, Entry(self, python, options))

    def prepare(self) -> None:
        """Tell numba what the functions rely on."""
        if self.types:
            import_module(self.types)

    @cached_property
    def addresses(self) -> dict[str, int]:
        """Addresses of the entries, and of ``deliver``; none where only numba can run them, whatever the reason."""
        with _LOCK:
            if "addresses" in self.__dict__:  # by another thread, meanwhile
                return self.__dict__["addresses"]  # type: ignore[no-any-return]
            for code in (self._kept, self._made):
                try:
                    from microvib.compiled import machine

                    return machine.load(self.module, code(), [*self.entries, "deliver"])
                except Exception:
                    continue
            return {}

    def begin(self, *meanwhile: Unit) -> None:
        """Have another process make machine code of what is kept, if there is none; ``meanwhile`` are units whose turn comes while
        one waits for it."""
        with suppress(Exception):  # then it is made when it is needed
            from microvib.compiled import machine

            machine.begin(self.module, self._kept(), [partial(getattr, unit, "addresses") for unit in meanwhile])

    def _kept(self) -> bytes:
        """The code beside the module, compressed, if it is of these sources, or these are not there to be edited."""
        stamps, _, content = self.file.read_bytes().partition(b"\n")
        if all(path.exists() for path in self.sources) and not self.fits(*stamps.decode().split()):
            raise ValueError(f"{self.file.name} was made from other sources")
        return content

    def _made(self) -> bytes:
        """The code made here, kept for this user's next process."""
        from microvib.compiled import machine

        versions = "".join(version(package) for package in ("numba", "llvmlite"))
        name = f"{self.module}-{machine.digest(self.stamps()[1].encode(), versions.encode())}.llvm"
        code = machine.kept(name)
        if code is None:
            from microvib.compiled.build import bitcode

            code = bitcode(self)
            machine.keep(name, code)
        return code

    def stamps(self) -> tuple[str, str]:
        """Digest of the sources, and of what they mean: without comments, docstrings and layout."""
        texts = self._texts()
        return _digest(texts), _digest(_meaning(text) for text in texts)

    def fits(self, text: str, meaning: str) -> bool:
        """Whether digests are those of the sources; their meaning takes a tenth of a second, and is asked for last."""
        return _digest(self._texts()) == text or self.stamps()[1] == meaning

    def _texts(self) -> list[str]:
        return [path.read_text(encoding="utf-8") for path in self.sources]


def _digest(texts: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


def _meaning(text: str) -> str:
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node) is not None:
            node.body = [*node.body[1:], ast.Pass()]
    return ast.unparse(tree)
