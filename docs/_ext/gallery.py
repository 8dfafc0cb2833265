"""The gallery: every short script of ``examples/`` with what it prints and draws, run when the site is built."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

from sphinx.application import Sphinx

EXAMPLES = Path(__file__).parents[2] / "examples"
MARK = "<!-- gallery -->"
"""Where in ``gallery.md`` the scripts are shown."""


def scripts() -> list[Path]:
    """Those of one idea each, by name: their first line is a comment that says which."""
    return [path for path in sorted(EXAMPLES.glob("*.py")) if path.read_text().startswith("# ")]


def show(app: Sphinx, page: str, source: list[str]) -> None:
    if page == "gallery":
        source[0] = source[0].replace(MARK, "\n\n".join(entry(app, path) for path in scripts()))


def entry(app: Sphinx, script: Path) -> str:
    """Heading, script, what it printed and what it drew."""
    comment, _, code = script.read_text().partition("\n")
    title, _, rest = comment.removeprefix("# ").partition(": ")
    said, pictures = run(app, script)
    return "\n".join(
        [
            f"## {title.rstrip('.')}\n",
            f"{rest[:1].upper()}{rest[1:]}\n" if rest else "",
            f"```python\n# examples/{script.name}\n{code.strip()}\n```\n",
            f"```text\n{said.strip()}\n```\n" if said.strip() else "",
            *(f"![{title.rstrip('.')}]({picture})\n" for picture in pictures),
        ]
    )


def run(app: Sphinx, script: Path) -> tuple[str, list[str]]:
    """What a script prints, and its pictures, relative to the pages; kept by its text and the package's hash."""
    version = hashlib.sha256(script.read_bytes() + app.config.nb_execution_cache_path.encode()).hexdigest()[:16]
    place = Path("_build") / "gallery" / f"{script.stem}-{version}"
    folder = Path(app.srcdir) / place
    said = folder / "said.txt"
    if not said.exists():
        folder.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(
            [sys.executable, script], cwd=folder, text=True, check=True, stdout=subprocess.PIPE, env=_environment()
        )
        said.write_text(done.stdout)
    return said.read_text(), [(place / path.name).as_posix() for path in sorted(folder.glob("*.png"))]


def _environment() -> dict[str, str]:
    """This one, with the package that the site is built of."""
    import microvib

    return {**os.environ, "PYTHONPATH": str(Path(microvib.__file__).parents[1])}


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", show)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
