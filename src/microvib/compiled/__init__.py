"""Compiled functions that need no compiler when they run.

numba takes most of a minute to understand functions as large as the kernel, LLVM a second to make
machine code of what comes out. So what comes out, LLVM's code for any machine, is kept beside each
module (``kernel.py``, ``kernel.llvm``), and a run imports no numba:

    code = Unit(__name__, "a_file_it_depends_on.py")

    @code.inner(**OPTIONS)                # for compiled functions to call
    def square(x): ...

    @code.entry(**OPTIONS)                # for Python to call, with the types that it says
    def norm(x: Vector) -> float: ...

Kept code carries digests of its sources. Where those are others, because somebody edits them in a
checkout, or where this LLVM cannot read it, numba compiles as ever, which is said, and what it
makes goes the same way, by the user's cache (``microvib.compiled.machine``). ``python -m
microvib.compiled`` makes anew what is kept.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any

from microvib.compiled import sources as digests
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
        if name not in (
            "_numba_type_",
            "targetoptions",
            "py_func",
        ):  # what numba asks what it is to call or to inline
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

    def __init__(self, module: str, *sources: str | Unit, types: str | None = None) -> None:
        """``sources`` are files of its folder, or other units, that the code is made from, and with
        each what that is made from.

        ``types`` is a module that numba needs, unless that of one of those units.
        """
        self.module, self.types = module, types
        self.file = Path(str(sys.modules[module].__file__)).with_suffix(".llvm")
        self.sources = [self.file.with_suffix(".py")]
        for name in sources:
            unit = name if isinstance(name, Unit) else self._imported(name)
            self.types = self.types or (unit.types if unit else None)
            if unit:
                self.sources += unit.sources
            else:
                self.sources += [self.file.parent / str(name)]
        self.sources += [Path(__file__).parent / name for name in _OWN]
        self.sources = list(dict.fromkeys(self.sources))
        self.entries: dict[str, Entry] = {}

    def _imported(self, name: str) -> Unit | None:
        """The unit of another file of the folder, which the module has imported; None where it has
        none.
        """
        package, _, _ = self.module.rpartition(".")
        unit = getattr(sys.modules.get(f"{package}.{Path(name).stem}"), "code", None)
        if isinstance(unit, Unit):
            return unit
        return None

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
        """Addresses of the entries, and of ``deliver``; none where only numba can run them,
        whatever the reason.
        """
        with _LOCK:
            if "addresses" in self.__dict__:  # by another thread, meanwhile
                return self.__dict__["addresses"]  # type: ignore[no-any-return]
            for code in (self.kept, self._made):
                try:
                    from microvib.compiled import machine

                    return machine.load(self.module, code(), [*self.entries, "deliver"])
                except Exception as error:
                    if code == self.kept:
                        _say_refused(self.file, error)
            return {}

    def begin(self, *meanwhile: Unit) -> None:
        """Have another process make machine code of what is kept, if there is none; ``meanwhile``
        are units whose turn comes while one waits for it."""
        with suppress(Exception):  # then it is made when it is needed
            from microvib.compiled import machine

            machine.begin(
                self.module,
                self.kept(),
                [partial(getattr, unit, "addresses") for unit in meanwhile],
            )

    def kept(self) -> bytes:
        """The code beside the module, compressed; in a checkout, if it is of these sources, and
        otherwise EditedSourcesError.
        """
        stamps, _, content = self.file.read_bytes().partition(b"\n")
        if digests.editable() and not self.fits(*stamps.decode().split()):
            raise EditedSourcesError
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
        return digests.text_digest(self.sources), digests.semantic_digest(self.sources)

    def fits(self, text: str, meaning: str) -> bool:
        """Whether digests are those of the sources; their meaning takes a tenth of a second, and is
        asked for last.
        """
        return (
            digests.text_digest(self.sources) == text
            or digests.semantic_digest(self.sources) == meaning
        )


class EditedSourcesError(ValueError):
    """Kept code was made from other sources than those that are there."""


_said: set[type[Exception]] = set()


def _say_refused(file: Path, error: Exception) -> None:
    """A note on standard error that kept code is not used: one for each reason, and none from
    worker processes.
    """
    from multiprocessing import parent_process

    if type(error) in _said or parent_process() is not None:
        return
    _said.add(type(error))
    if isinstance(error, EditedSourcesError):
        text = (
            f"{file.name} was compiled from other sources than those in {file.parent}, so that"
            " numba compiles them, for minutes "
            "after each edit; when the edit is done, run `python -m microvib.compiled` to renew"
            " what is kept"
        )
    else:
        reason = str(error).partition("\n")[0] or type(error).__name__
        text = (
            f"the compiled code in {file} cannot be used ({reason}), so that numba compiles it, for"
            " minutes the first time; "
            "installing microvib again with the present llvmlite and numba may help"
        )
    print(f"Note: {text}.", file=sys.stderr, flush=True)
