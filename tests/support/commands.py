"""Ways to run ``microvib``: in the test's own process, and several commands in one process of their own."""

from contextlib import chdir
from pathlib import Path

from click.testing import CliRunner, Result

from microvib.cli.main import main

ONE_AFTER_ANOTHER = """
import json, sys
from microvib.cli.main import main
for name, arguments in json.loads(sys.argv[1]).items():
    status = 0
    try:
        main(arguments, prog_name="microvib")
    except SystemExit as end:
        status = end.code
    print(f"== {name} == {status}", flush=True)
"""
"""A program that runs commands by name, and says with which status each has ended."""


def microvib(*arguments: str, cwd: Path) -> Result:
    """A command in a folder, in this process, whose imports it shares; test_commands.py runs each as a program, too."""
    with chdir(cwd):
        return CliRunner().invoke(main, arguments, prog_name="microvib")
