"""In a page's kernel (``%load_ext console``): ``%%console`` for shell commands, and figures that are shown."""

import io
import re
import shlex
import subprocess
import textwrap
from contextlib import redirect_stdout
from typing import Any

from microvib.cli.main import main

WIDTH = 102
"""Characters that a page has room for."""


def folded(printed: str) -> str:
    """What a command prints, sentences that are wider than a page in several lines; rows of tables keep their columns."""
    return "\n".join(line for whole in printed.split("\n") for line in _lines(whole))


def _lines(line: str) -> list[str]:
    is_row = re.search(r"\S {2,}\S", line) is not None
    if len(line) <= WIDTH or is_row:
        return [line]
    indent = re.match(" *", line)
    assert indent is not None
    return textwrap.wrap(
        line,
        WIDTH,
        subsequent_indent=indent[0] + "  ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def console(line: str, cell: str) -> None:
    """Run a cell as the shell would and print what it prints; a command that fails stops the page.

    A microvib command alone runs in this process, which has the libraries loaded that it would spend its time on.
    """
    words = shlex.split(cell.replace("\\\n", " "))
    if words[0] == "microvib" and not {"|", ">", "&&"} & set(words):
        _in_process(words[1:])
    else:
        print(
            folded(
                subprocess.run(
                    cell, shell=True, text=True, check=True, stdout=subprocess.PIPE
                ).stdout
            ),
            end="",
        )


def _in_process(arguments: list[str]) -> None:
    said = io.StringIO()
    with redirect_stdout(said):
        status = main(arguments, standalone_mode=False)
    print(folded(said.getvalue()), end="")
    if status:
        raise RuntimeError(f"microvib {shlex.join(arguments)}: status {status}")


def load_ipython_extension(shell: Any) -> None:
    shell.register_magic_function(console, "cell")
    shell.run_line_magic("matplotlib", "inline")
    shell.run_line_magic("config", "InlineBackend.figure_formats = ['retina']")
