"""What the repository's files show or link to for their readers, as the site has it: pictures are drawn anew."""

import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from sphinx.application import Sphinx

import microvib
from microvib.cli.main import main


def folder(app: Sphinx) -> Path:
    """Where drawings are kept, relative to the pages: by the package's hash, as executed pages are."""
    return Path("_build") / "drawings" / Path(app.config.nb_execution_cache_path).name


def draw_simulator(path: Path) -> None:
    """The drawing of ``microvib sas size --inertia 8.18 --frequency 1.19``."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        out = Path(folder) / "sas"
        main(
            ["sas", "size", "--inertia", "8.18", "--frequency", "1.19", "--out", str(out)],
            standalone_mode=False,
        )
        path.write_bytes((out / "drawing.png").read_bytes())


def draw_state_1(path: Path) -> None:
    """The picture of the notebook lines in the README."""
    microvib.plot(microvib.simulate(microvib.load_scenario("state-1"))).savefig(path)


DRAWINGS: dict[str, Callable[[Path], None]] = {
    "sas.png": draw_simulator,
    "state-1.png": draw_state_1,
}
PAGES = {"../benchmarks/README.md": "benchmarks.md"}


def draw(app: Sphinx) -> None:
    place = Path(app.srcdir) / folder(app)
    place.mkdir(parents=True, exist_ok=True)
    for name, make in DRAWINGS.items():
        if not (place / name).exists():
            make(place / name)


def show_ours(app: Sphinx, page: str, source: list[str]) -> None:
    drawn = {name: (folder(app) / name).as_posix() for name in DRAWINGS}
    for name, ours in {**PAGES, **drawn}.items():
        source[0] = source[0].replace(f"]({name})", f"]({ours})")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", draw)
    app.connect("source-read", show_ours)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
