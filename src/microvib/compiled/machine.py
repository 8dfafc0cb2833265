"""From LLVM's code to functions of this machine, kept for the next process.

LLVM makes the code for the very processor (its vectors, its fused products) and links it in memory.
What it makes is kept in the user's cache folder under a digest of all that it depends on: the code,
LLVM, the processor. Only a folder that is the user's and that no one else can write to is trusted;
without one, every process makes its own.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from microvib.compiled import ahead, codegen
from microvib.compiled.layout import sound

MAX_KEPT_VERSIONS = 8
"""Versions of one unit that are kept."""
LIBRARY = (
    "sqrt", "sin", "cos", "sincos", "exp", "expm1", "pow", "hypot", "floor", "rint", "fma",
    "malloc", "free", "memcpy", "memmove", "memset",
)  # fmt: skip
"""Functions of C that compiled code may call."""

_linker: Any = None
_loaded: list[Any] = []  # the code lives as long as these


def begin(name: str, code: bytes, meanwhile: Sequence[Callable[[], object]]) -> None:
    """Have another process make machine code of ``code``, if there is none, for ``load``, which
    calls ``meanwhile`` as it waits.
    """
    file = _file(name, code)
    if kept(file) is None:
        ahead.begin(file, code, meanwhile)


def load(name: str, code: bytes, functions: list[str]) -> dict[str, int]:
    """Addresses of functions in ``code``, LLVM's bitcode, which may be compressed. Raises an error
    of LLVM's where it cannot be read or linked."""
    global _linker
    file = _file(name, code)
    machine_code = kept(file)
    if machine_code is None:
        machine_code = ahead.take(file) or codegen.object_file(code, *codegen.host())
        keep(file, machine_code)
    _linker = _linker or llvm.create_lljit_compiler()
    library = llvm.JITLibraryBuilder().add_object_img(machine_code).add_current_process()
    for symbol, address in _c_library().items():
        library.import_symbol(symbol, address)
    for function in functions:
        library.export_symbol(function)
    _loaded.append(library.link(_linker, f"{name}-{len(_loaded)}"))
    return {function: _loaded[-1][function] for function in functions}


def _file(name: str, code: bytes) -> str:
    """Name of the file that machine code of ``code`` is kept in, by all that it depends on."""
    if ctypes.sizeof(ctypes.c_void_p) != 8 or sys.byteorder != "little" or not sound():
        raise RuntimeError("stored code requires a 64-bit, little-endian CPython")
    return f"{name}-{digest(code, *(text.encode() for text in (llvmlite.__version__, *codegen.host())))}.o"


def _c_library() -> dict[str, int]:
    """Addresses of the functions of C that there are."""
    libraries = []
    for library_name in (
        ("ucrtbase", "vcruntime140") if sys.platform == "win32" else (None, "libm.so.6")
    ):
        with contextlib.suppress(OSError):
            libraries.append(ctypes.CDLL(library_name))
    found: dict[str, int] = {}
    for name in LIBRARY:
        for library in libraries:
            if name not in found and hasattr(library, name):
                found[name] = ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
    return found


def digest(*parts: bytes) -> str:
    """A digest of parts."""
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[
        :32
    ]


def cache_folder() -> Path:
    """Where this user's caches are."""
    if sys.platform == "win32":
        return (
            Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local") / "microvib/cache"
        )
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches/microvib"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "microvib"


def own_folder(name: str) -> Path | None:
    """Folder ``name`` among this user's caches, made where it is missing; None where it cannot be made,
    or others can write to it.
    """
    folder = cache_folder() / name
    with contextlib.suppress(OSError, RuntimeError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _trusted(folder.parent) and _trusted(folder):
            return folder
    return None


def _trusted(path: Path) -> bool:
    """Whether what is there was put there by this user: on Windows, where the folder is, nobody
    else may write.
    """
    if sys.platform == "win32":
        return True
    status = path.stat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


def kept(name: str) -> bytes | None:
    """Stored data of ``keep`` under this name, if it is whole and this user's own."""
    with contextlib.suppress(OSError, RuntimeError):
        path = cache_folder() / name
        if _trusted(path.parent) and _trusted(path):
            content = path.read_bytes()
            if content[:32] == hashlib.sha256(content[32:]).digest():
                return content[32:]
    return None


def keep(name: str, content: bytes) -> None:
    """Put content aside for other processes: whole or not at all."""
    with contextlib.suppress(OSError, RuntimeError):
        folder = cache_folder()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _trusted(folder):
            return
        handle, temporary = tempfile.mkstemp(dir=folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(content).digest() + content)
            os.replace(temporary, folder / name)
        except BaseException:
            os.unlink(temporary)
            raise
        alike = folder.glob(f"{name.rpartition('-')[0]}-*{Path(name).suffix}")
        for old in sorted(alike, key=lambda path: path.stat().st_mtime)[:-MAX_KEPT_VERSIONS]:
            old.unlink()
