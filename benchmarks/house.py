"""Syntax nodes a line of code and conditional expressions per 1000 lines, of each room and of all,
and the functions that are hardest to read.

``python benchmarks/house.py``
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.house import Module, modules

LIMIT = 12
"""Complexity above which a function is listed."""


def main() -> None:
    """Print the table."""
    rooms: dict[str, list[Module]] = defaultdict(list)
    for module in modules():
        rooms[module.room].append(module)
        rooms["all"].append(module)
    print(f"{'room':16s} {'lines':>7s} {'nodes a line':>13s} {'conditionals per 1000':>22s}")
    for room, found in sorted(rooms.items(), key=lambda item: -sum(x.code_lines for x in item[1])):
        lines = sum(module.code_lines for module in found)
        nodes = sum(module.nodes for module in found)
        conditionals = sum(module.conditional_expressions for module in found)
        if lines:
            print(
                f"{room:16s} {lines:7d} {nodes / lines:13.2f} {1000 * conditionals / lines:22.1f}"
            )
    found = sorted(
        (each for module in modules() for each in module.complexities()),
        key=lambda each: -each.value,
    )
    hard = [each for each in found if each.value > LIMIT]
    compiled = sum(each.module.is_compiled for each in hard)
    print(
        f"\ncomplexity above {LIMIT}: {len(hard)} of {len(found)} functions, {compiled} of them in"
        " compiled modules"
    )
    for each in hard:
        print(each)


if __name__ == "__main__":
    main()
