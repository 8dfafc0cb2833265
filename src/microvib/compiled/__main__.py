"""``python -m microvib.compiled [MODULE ...]``: make anew what is kept beside these modules, or
beside all that have it.

Where sources changed in nothing but comments and layout, what is kept stays and gets their digest.
"""

import lzma
import os
import platform
import sys
import time
from importlib import import_module
from pathlib import Path

from microvib.compiled import Unit

# LLVM chooses the length of vectors for a processor; made for one that is common, the code is the
# same from every computer.
COMMON = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}


def main(modules: list[str]) -> None:
    """Make what is kept beside modules."""
    for_common_processor()
    root = Path(__file__).parents[1]
    for name in modules or [
        ".".join(("microvib", *p.relative_to(root).with_suffix("").parts))
        for p in root.rglob("*.llvm")
    ]:
        begun = time.perf_counter()
        print(f"{name}: {renew(import_module(name).code)}, {time.perf_counter() - begun:.0f} s")


def for_common_processor() -> None:
    """Have numba make code for the common processor, if it has not been imported yet."""
    if platform.machine() in ("x86_64", "AMD64"):
        os.environ.update(COMMON)


def renew(unit: Unit) -> str:
    """Make what is kept of a unit, if it is of other sources; what was done."""
    stamps = unit.stamps()
    if unit.file.exists():
        old, _, content = unit.file.read_bytes().partition(b"\n")
    else:
        old, _, content = (b"", b"", b"")
    done = "as it was"
    if old.decode().split()[1:] != [stamps[1]]:
        from microvib.compiled.build import bitcode

        content, done = lzma.compress(bitcode(unit), preset=9), "made"
    unit.file.write_bytes(" ".join(stamps).encode() + b"\n" + content)
    return f"{done}, {len(content)} bytes"


if __name__ == "__main__":
    main(sys.argv[1:])
