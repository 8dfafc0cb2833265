"""From object files and the C wrapper to a library, by Zig's compiler or, for this machine, its own."""

from __future__ import annotations

import importlib.util
import platform as this_machine
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from microvib.errors import MicrovibError
from microvib.export.native.objects import PLATFORMS, Platform

SOURCES = Path(__file__).parent
WRAPPER = ("microvib.c", "command.c", "hub.c", "steps.c", "outputs.c", "parameters.c")
"""Files of the wrapper of a drive, in C."""
FLAGS = ("-O2", "-ffp-contract=off", "-fno-strict-aliasing", "-fvisibility=hidden")
"""No fused products: the wrapper shall give the same microsteps everywhere."""
COMPILERS = ("cc", "gcc", "clang")
"""Names of compilers that a machine may have of its own."""
MOST_SECONDS = 600.0
"""Time [s] that linking may take: Zig makes parts of a C library for each platform once."""


def host() -> str:
    """Name of this machine's platform; empty where none of ``PLATFORMS`` is it."""
    word = {"x86_64": "64", "AMD64": "64", "aarch64": "-arm64", "arm64": "-arm64"}
    system = {"linux": "linux", "darwin": "darwin", "win32": "win"}.get(sys.platform, "")
    name = system + word.get(this_machine.machine(), "?")
    return name if name in PLATFORMS else ""


def compiler(platform: Platform) -> list[str]:
    """Command of a compiler for a platform; MicrovibError, a sentence, where there is none."""
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc", "-target", platform.zig]
    own = next(filter(None, map(shutil.which, COMPILERS)), None)
    if own is not None and platform.name == host() and sys.platform != "win32":
        return [own]
    raise MicrovibError(
        f"platform {platform.name}: this needs ziglang, which is not installed;"
        " pip install 'microvib[export]'"
    )


def link(
    platform: Platform, sources: Sequence[str], objects: Mapping[str, bytes], defines: Sequence[str]
) -> bytes:
    """The shared library of C ``sources``, which lie beside this file, and object files.

    Raises MicrovibError with what the compiler said where it fails.
    """
    command = [*compiler(platform), *FLAGS, *_shared(platform)]
    command += [f"-D{name}" for name in defines]
    if len(platform.processors) > 1:
        command.append("-DMICROVIB_TWO_PROCESSORS")
    with tempfile.TemporaryDirectory(prefix="microvib-") as folder:
        made = Path(folder) / platform.library.format("library")
        files = [str(SOURCES / source) for source in sources]
        for name, content in objects.items():
            path = Path(folder) / f"{name}.o"
            path.write_bytes(content)
            files.append(str(path))
        _run([*command, "-o", str(made), *files, *_libraries(platform)])
        return made.read_bytes()


def _shared(platform: Platform) -> tuple[str, ...]:
    if platform.name == "wasm32":
        exported = ("--export-dynamic", "--export=malloc", "--export=free", "--strip-all")
        return ("-mexec-model=reactor", *(f"-Wl,{flag}" for flag in exported))
    if platform.name.startswith("darwin"):
        return ("-shared", "-fPIC", "-s", "-Wl,-install_name,@rpath/microvib-drive.dylib")
    if platform.name.startswith("win"):
        return ("-shared", "-fPIC", "-Wl,-s")
    # Of two libraries in one process each calls itself, however they are loaded.
    return ("-shared", "-fPIC", "-Wl,-s", "-Wl,-Bsymbolic")


def _libraries(platform: Platform) -> tuple[str, ...]:
    return () if platform.name.startswith("win") else ("-lm",)


def _run(command: list[str]) -> None:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=MOST_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MicrovibError(f"the compiler could not be run: {error}") from None
    if done.returncode != 0:
        said = " ".join(done.stderr.split())[:400] or f"it ended with {done.returncode}"
        raise MicrovibError(f"the library could not be linked: {said}")
