"""``python -m microvib``."""

from microvib.app.cli import main

main(prog_name="microvib")
