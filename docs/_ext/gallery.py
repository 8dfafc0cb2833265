"""The gallery: every short script of ``examples/`` with what it prints and draws, run when the site is built."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

from console import folded
from sphinx.application import Sphinx

EXAMPLES = Path(__file__).parents[2] / "examples"
MARK = "<!-- gallery -->"
"""Where in ``gallery.md`` the scripts are shown."""
SAID = "said.txt"
ONE_AFTER_ANOTHER = f"""
import json, runpy, sys
from contextlib import chdir, redirect_stdout
from io import StringIO
from pathlib import Path
for script, folder in json.load(sys.stdin).items():
    with chdir(folder), redirect_stdout(StringIO()) as said:
        runpy.run_path(script, run_name="__main__")
    Path(folder, "{SAID}").write_text(said.getvalue(), encoding="utf-8")
"""
"""Runs scripts by their paths, and keeps what each prints when it has ended."""


def scripts() -> list[Path]:
    """Those of one idea each, by name: their first line is a comment that says which."""
    return [path for path in sorted(EXAMPLES.glob("*.py")) if path.read_text().startswith("# ")]


def show(app: Sphinx, page: str, source: list[str]) -> None:
    if page == "gallery":
        run(
            {
                script: place(app, script)
                for script in scripts()
                if not (place(app, script) / SAID).exists()
            }
        )
        source[0] = source[0].replace(MARK, "\n\n".join(entry(app, path) for path in scripts()))


def entry(app: Sphinx, script: Path) -> str:
    """Heading, script, what it printed and what it drew."""
    comment, _, code = script.read_text().partition("\n")
    title, _, rest = comment.removeprefix("# ").partition(": ")
    folder = place(app, script)
    said, pictures = (
        (folder / SAID).read_text(encoding="utf-8"),
        [path.name for path in sorted(folder.glob("*.png"))],
    )
    return "\n".join(
        [
            f"## {title.rstrip('.')}\n",
            f"{rest[:1].upper()}{rest[1:]}\n" if rest else "",
            f"```python\n# examples/{script.name}\n{code.strip()}\n```\n",
            f"```text\n{folded(said.strip())}\n```\n" if said.strip() else "",
            *(
                f"![{title.rstrip('.')}]({folder.relative_to(app.srcdir).as_posix()}/{name})\n"
                for name in pictures
            ),
        ]
    )


def place(app: Sphinx, script: Path) -> Path:
    """Folder of what a script prints and draws; kept by its text and the package's hash."""
    version = hashlib.sha256(
        script.read_bytes() + app.config.nb_execution_cache_path.encode()
    ).hexdigest()[:16]
    return Path(app.srcdir) / "_build" / "gallery" / f"{script.stem}-{version}"


def run(scripts: dict[Path, Path]) -> None:
    """Run scripts, each in its folder, one after another in one process, whose imports they share."""
    for folder in scripts.values():
        folder.mkdir(parents=True, exist_ok=True)
    told = json.dumps({str(script): str(folder) for script, folder in scripts.items()})
    subprocess.run(
        [sys.executable, "-c", ONE_AFTER_ANOTHER],
        input=told,
        text=True,
        check=True,
        env=_environment(),
    )


def _environment() -> dict[str, str]:
    """This one, with the package that the site is built of."""
    import microvib

    return {**os.environ, "PYTHONPATH": str(Path(microvib.__file__).parents[1])}


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", show)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
