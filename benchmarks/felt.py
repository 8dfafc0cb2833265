"""How long a user waits: first run after installation, first steady run, and the same again with
warm caches.

``python benchmarks/felt.py [--tree FOLDER] [--rounds N] [--warm]``

Every row is a process of its own, from its start to its end, with microvib as pip installs it.
Seconds are of the processor (user and system) and of the clock, least and median of some rounds;
each first run has caches of its own, empty at first. ``--tree`` measures another checkout with the
libraries of this interpreter.
"""

from __future__ import annotations

import argparse
import compileall
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

MOTION = "import microvib as mv; mv.simulate(mv.load_scenario('state-1'))"
ROWS = (
    ("run state-1, with report", ("-m", "microvib", "run", "state-1", "--out")),
    (
        "run state-1 --steady, with report",
        ("-m", "microvib", "run", "state-1", "--steady", "--out"),
    ),
    ("import microvib to first motion", ("-c", MOTION)),
    ("--help", ("-m", "microvib", "--help")),
)


Row = tuple[str, Sequence[str]]
Time = tuple[float, float]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all and print a table for each checkout."""
    parser = argparse.ArgumentParser(description=__doc__)
    this = Path(__file__).parents[1]
    parser.add_argument(
        "--tree", type=Path, nargs="+", default=[this], help="checkouts to measure (default: this)"
    )
    parser.add_argument("--rounds", type=int, default=5, help="rounds (default: 5)")
    parser.add_argument(
        "--warm", action="store_true", help="with this user's own caches, without what comes first"
    )
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        places = [Place(Path(folder) / str(k), tree) for k, tree in enumerate(options.tree)]
        firsts = _measured(
            places, ROWS[:2], 1 if options.warm else options.rounds, fresh=not options.warm
        )
        warm = _measured(places, ROWS, options.rounds, fresh=False)
    for place in places:
        print(
            f"\n{place.tree}\n{'':44s} {'CPU s':>8s} {'median':>8s} {'clock s':>8s} {'median':>8s}"
        )
        for name, times in ({} if options.warm else firsts[place]).items():
            _print(f"first {name}", times)
        for name, times in warm[place].items():
            _print(name, times)


def _measured(
    places: Sequence[Place], rows: Sequence[Row], rounds: int, fresh: bool
) -> dict[Place, dict[str, list[Time]]]:
    """Times of each place and row, one a round, places in turn; ``fresh`` begins each round with
    empty caches.
    """
    times: dict[Place, dict[str, list[Time]]] = {
        place: {name: [] for name, _ in rows} for place in places
    }
    for _ in range(rounds):
        for place in places:
            if fresh:
                place.empty_caches()
            for name, words in rows:
                times[place][name].append(place.timed(words))
    return times


class Place:
    """A folder for results, for caches, and for a checkout's package as pip installs it."""

    def __init__(self, folder: Path, tree: Path) -> None:
        self.folder, self.tree, self.runs, self.caches = folder, tree, 0, 0
        package = folder / "site" / "microvib"
        shutil.copytree(
            tree / "src" / "microvib", package, ignore=shutil.ignore_patterns("__pycache__")
        )
        compileall.compile_dir(package, quiet=1)
        self.environment = {**os.environ, "PYTHONPATH": str(package.parent)}

    def empty_caches(self) -> None:
        """From now on caches that are empty at first, as after an installation, instead of this
        user's.
        """
        self.caches += 1
        names = ("XDG_CACHE_HOME", "LOCALAPPDATA", "NUMBA_CACHE_DIR")
        self.environment |= dict.fromkeys(names, str(self.folder / f"caches-{self.caches}"))

    def timed(self, words: Sequence[str]) -> Time:
        """Seconds of the processor and of the clock that Python takes with these words."""
        self.runs += 1
        out = [str(self.folder / f"run-{self.runs}")] if words[-1] == "--out" else []
        before, begun = os.times(), time.perf_counter()
        subprocess.run(
            [sys.executable, *words, *out],
            cwd=self.folder,
            env=self.environment,
            check=True,
            capture_output=True,
        )
        after, clock = os.times(), time.perf_counter() - begun
        return sum(after[2:4]) - sum(before[2:4]), clock


def _print(name: str, times: Sequence[Time]) -> None:
    words = [
        f"{of(column):8.2f}"
        for column in zip(*times, strict=True)
        for of in (min, statistics.median)
    ]
    print(f"{name:44s} {' '.join(words)}", flush=True)


if __name__ == "__main__":
    main()
