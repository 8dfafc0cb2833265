"""In a page's kernel (``%load_ext console``): ``%%console`` for shell commands, and figures that are shown."""

import io
import shlex
import subprocess
from contextlib import redirect_stdout
from typing import Any

from microvib.cli.main import main


def console(line: str, cell: str) -> None:
    """Run a cell as the shell would and print what it prints; a command that fails stops the page.

    A microvib command alone runs in this process, which has the libraries loaded that it would spend its time on.
    """
    words = shlex.split(cell.replace("\\\n", " "))
    if words[0] == "microvib" and not {"|", ">", "&&"} & set(words):
        _in_process(words[1:])
    else:
        print(subprocess.run(cell, shell=True, text=True, check=True, stdout=subprocess.PIPE).stdout, end="")


def _in_process(arguments: list[str]) -> None:
    said = io.StringIO()
    with redirect_stdout(said):
        status = main(arguments, standalone_mode=False)
    print(said.getvalue(), end="")
    if status:
        raise RuntimeError(f"microvib {shlex.join(arguments)}: status {status}")


def load_ipython_extension(shell: Any) -> None:
    shell.register_magic_function(console, "cell")
    shell.run_line_magic("matplotlib", "inline")
    shell.run_line_magic("config", "InlineBackend.figure_formats = ['retina']")
