"""``python -m microvib``."""

from microvib.cli.main import main

main(prog_name="microvib")
