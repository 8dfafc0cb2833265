"""Modes of the reference array beside those of CalculiX: `python benchmarks/calculix.py`, where
``ccx`` is installed.

Its own mesh is of quadratic bricks, rigid bodies and springs; the figures are those of docs/fem.md.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.calculix import in_calculix

from microvib.io.modal_sources import load_design
from microvib.structures.fem.array_mesh import kinds
from microvib.structures.fem.described import solve_design


def main() -> None:
    design = load_design("reference-array")
    with tempfile.TemporaryDirectory() as folder:
        f, effective, total = in_calculix(design, Path(folder))
    modes = solve_design(design, 12)
    print("mode kind  microvib  CalculiX  difference %   effective inertia")
    for k, kind in enumerate(kinds(modes)[:10]):
        print(
            f"{k + 1:4d} {kind:4s} {modes.frequency[k]:9.4f} {f[k]:9.4f} {100 * (modes.frequency[k] / f[k] - 1):+8.2f}"
            f" {modes.participation[3, k] ** 2:12.4g} {effective[k]:12.4g}"
        )
    print("total inertia", modes.mass[3, 3], total)


if __name__ == "__main__":
    main()
