"""How long a user waits: first run after installation, first steady run, and the same again with warm caches.

``python benchmarks/felt.py [--tree FOLDER] [--rounds N] [--warm]``

Every row is a process of its own, from its start to its end. Seconds are of the processor (user and system) and of the clock, the
least of some rounds; what comes first happens once. ``--tree`` measures another checkout with the libraries of this interpreter.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

MOTION = "import microvib as mv; mv.simulate(mv.load_scenario('state-1'))"
ROWS = (
    ("run state-1, with report", ("-m", "microvib", "run", "state-1", "--out")),
    ("run state-1 --steady, with report", ("-m", "microvib", "run", "state-1", "--steady", "--out")),
    ("import microvib to first motion", ("-c", MOTION)),
    ("--help", ("-m", "microvib", "--help")),
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--tree", type=Path, default=Path(__file__).parents[1], help="checkout to measure (default: this)"
    )
    parser.add_argument("--rounds", type=int, default=5, help="rounds, of which the least time counts (default: 5)")
    parser.add_argument("--warm", action="store_true", help="with this user's own caches, without what comes first")
    options = parser.parse_args(arguments)
    print(f"{'':44s} {'CPU s':>8s} {'clock s':>8s}")
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder), options.tree, fresh=not options.warm)
        for name, words in ROWS[:2]:
            first = place.timed(words)
            if not options.warm:
                _print(f"first {name}", [first])
        rounds = [[place.timed(words) for _, words in ROWS] for _ in range(options.rounds)]
    for k, (name, _) in enumerate(ROWS):
        _print(name, [times[k] for times in rounds])


class Place:
    """A folder for results, and for ``fresh`` caches that are empty at first, as after an installation."""

    def __init__(self, folder: Path, tree: Path, fresh: bool) -> None:
        self.folder, self.runs = folder, 0
        self.environment = {**os.environ, "PYTHONPATH": str(tree.resolve() / "src")}
        if fresh:
            names = ("XDG_CACHE_HOME", "LOCALAPPDATA", "NUMBA_CACHE_DIR")
            self.environment |= dict.fromkeys(names, str(folder / "caches"))

    def timed(self, words: Sequence[str]) -> tuple[float, float]:
        """Seconds of the processor and of the clock that Python takes with these words."""
        self.runs += 1
        out = [str(self.folder / f"run-{self.runs}")] if words[-1] == "--out" else []
        before, begun = os.times(), time.perf_counter()
        subprocess.run(
            [sys.executable, *words, *out], cwd=self.folder, env=self.environment, check=True, capture_output=True
        )
        after, clock = os.times(), time.perf_counter() - begun
        return sum(after[2:4]) - sum(before[2:4]), clock


def _print(name: str, times: Sequence[tuple[float, float]]) -> None:
    cpu, clock = (min(column) for column in zip(*times, strict=True))
    print(f"{name:44s} {cpu:8.2f} {clock:8.2f}", flush=True)


if __name__ == "__main__":
    main()
