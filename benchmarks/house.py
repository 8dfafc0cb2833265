"""Syntax nodes a line of code and conditional expressions per 1000 lines, of each room and of all.

``python benchmarks/house.py``
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.house import Module, modules


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


if __name__ == "__main__":
    main()
