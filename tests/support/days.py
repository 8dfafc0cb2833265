"""The two days of the docs: their command lines, and what their first ones make."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from support.commands import microvib

ROOT = Path(__file__).parents[2]
EXAMPLES = {
    "docs/howto/test-day.md": ROOT / "examples" / "acceptance",
    "docs/howto/systems-evening.md": ROOT / "examples",
}
"""The folder whose files a page tells its reader to copy."""


def blocks(page: str) -> Iterator[tuple[str, str, str]]:
    """What a page prints, in its order: ("file", name, text), ("command", line, what is quoted of its answer)."""
    text = (ROOT / page).read_text("utf-8").replace("\\\n", " ")
    pattern = re.compile(
        r"^```(?:yaml|text)\n# (?P<file>\S+\.(?:yaml|csv))\n(?P<content>.*?)^```$"
        r"|^    (?P<line>(?:microvib|python) [^\n]*)$(?:\n\n```text\n(?P<quoted>.*?)^```$)?",
        re.M | re.S,
    )
    for found in pattern.finditer(text):
        if found["file"]:
            yield "file", found["file"], found["content"]
        else:
            yield "command", found["line"], found["quoted"] or ""


def run(line: str, folder: Path) -> str:
    """The answers of a command line in a folder."""
    return "\n".join(_run(part.strip(), folder) for part in line.split("&&"))


def _run(line: str, folder: Path) -> str:
    """The answer of a command; what stands behind > goes into a file."""
    line, _, into = line.partition(" > ")
    program, *words = shlex.split(line)
    if program == "python":
        command = [sys.executable, *words]
        return subprocess.run(
            command, cwd=folder, check=True, capture_output=True, text=True
        ).stdout
    done = microvib(*words, cwd=folder)
    assert done.exit_code == 0, (line, done.output)
    if into:
        (folder / into.strip()).write_text(done.stdout)
    return done.output


def begun(page: str, folder: Path) -> Path:
    """A folder with the examples that the page begins with."""
    for path in EXAMPLES[page].iterdir():
        if path.suffix in (".yaml", ".md", ".py"):
            shutil.copy(path, folder)
    return folder


def prepared(page: str, folder: Path) -> Path:
    """The folder of a page with its files, after the commands that come before its first task."""
    head = (ROOT / page).read_text("utf-8").partition("\n## 1. ")[0]
    begun(page, folder)
    for kind, name, text in blocks(page):
        if kind == "file":
            (folder / name).write_text(text)
        elif name.strip() in head.replace("\\\n", " "):
            run(name, folder)
    return folder
