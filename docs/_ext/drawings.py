"""What the repository's files show or link to for their readers, as the site has it: pictures are drawn anew."""

import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from sphinx.application import Sphinx

from microvib.app.cli import main

FOLDER = Path("_build") / "drawings"


def draw_simulator(path: Path) -> None:
    """The drawing of ``microvib sas size --inertia 8.18 --frequency 1.19``."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        out = Path(folder) / "sas"
        main(["sas", "size", "--inertia", "8.18", "--frequency", "1.19", "--out", str(out)], standalone_mode=False)
        path.write_bytes((out / "drawing.png").read_bytes())


DRAWINGS: dict[str, Callable[[Path], None]] = {"sas.png": draw_simulator}
PAGES = {"../benchmarks/README.md": "benchmarks.md"}


def draw(app: Sphinx) -> None:
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in DRAWINGS.items():
        make(folder / name)


def show_ours(app: Sphinx, page: str, source: list[str]) -> None:
    for name, ours in {**PAGES, **{name: (FOLDER / name).as_posix() for name in DRAWINGS}}.items():
        source[0] = source[0].replace(f"]({name})", f"]({ours})")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", draw)
    app.connect("source-read", show_ours)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
