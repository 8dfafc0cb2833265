"""Modes of the reference hub that are left out: what residual modes make of them.

    .venv/bin/python benchmarks/hub_modes.py

prints the first modes of the mesh with a heavy body at its root, of the whole mesh and of its free
modes with and without residual modes; then by how much responses of the payload to loads at a point
are off, over the largest, up to a part of the first mode that is left out.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_matrix

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.hub_responses import payload_rotations

from microvib.io.hub_sources import hub_from
from microvib.io.named import catalog_text
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validate_part
from microvib.structures.fem.assembly import assemble
from microvib.structures.fem.hub_mesh import free_modes, structure_of
from microvib.structures.fem.modes import lowest_modes
from microvib.structures.hub_design import HubDesign

NAME = "reference-hub"
BODY = np.diag([36.0, 36.0, 36.0, 420.0, 12.0, 430.0])
"""Mass matrix of the body at the root [kg, kg m^2]."""
PARTS = (0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
MANY = 400


def with_body(frequency: np.ndarray, at_root: np.ndarray) -> np.ndarray:
    """Frequencies [Hz] of free modes (s,), which move the root by (6, s), with the body on it."""
    squares = (2.0 * np.pi * frequency) ** 2
    squares[:6] = 0.0
    found = eigh(np.diag(squares), np.eye(squares.size) + at_root.T @ BODY @ at_root)[0]
    return np.asarray(np.sqrt(np.maximum(found[6:], 0.0)) / (2.0 * np.pi))


def main() -> None:
    """Print both tables."""
    design = validate_part(HubDesign, parse_yaml(catalog_text(f"hubs/{NAME}"), NAME), origin=NAME)
    structure, points = structure_of(design)
    system = assemble(structure, clamped=False)
    root = system.T.tocsr()[6 * points["root"] + np.arange(6)].T
    mass = (system.M + root @ csc_matrix(BODY) @ root.T).tocsc()
    whole = np.sqrt(lowest_modes(system.K, mass, 12)[0][6:]) / (2.0 * np.pi)
    print("first modes with the body [Hz]: whole mesh", np.round(whole, 3))
    for count in (10, 30, 120):
        modes = free_modes(design, count)
        kept = 6 + count
        alone = with_body(modes.frequency[:kept], modes.shapes[0, :, :kept])
        found = with_body(modes.frequency, modes.shapes[0])
        print(
            f"{count} modes: alone {np.round(alone[:6], 3)}, with residual {np.round(found[:6], 3)}"
        )

    many, f = hub_from({"modes": NAME, "count": MANY}), np.geomspace(5.0, 900.0, 6000)
    for count in (10, 20, 30, 60, 120):
        few = hub_from({"modes": NAME, "count": count})
        assert few.left_out_from is not None
        for point in ("root", "wheels"):
            true, found = (payload_rotations(hub, f, point) for hub in (many, few))
            off = np.abs(found - true).max(axis=(1, 2)) / np.abs(true).max(axis=(1, 2))
            told = (f"{part}: {off[f <= part * few.left_out_from].max():.2g}" for part in PARTS)
            print(
                f"{count} modes, first left out {few.left_out_from:.1f} Hz, {point}:",
                ", ".join(told),
            )


if __name__ == "__main__":
    main()
