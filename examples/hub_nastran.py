# A hub from Nastran: punched eigenvectors of a free-free run (SOL 103) and its GRID entries; OP2 and OP4 are named the same way.
from pathlib import Path

import numpy as np

import microvib as mv

# Stand-ins for what the run leaves: a free beam of two masses along y, in mm, t and s; grids 101 (root) and 205 (payload).
places = {101: np.array([0.0, 900.0, 0.0]), 205: np.array([0.0, -500.0, 200.0])}
mass, inertias, directions = 0.4, (2e5, 1.6e5, 1.9e5), np.eye(3)
modes = [(0.0, {grid: [*axis / np.sqrt(mass), 0, 0, 0] for grid in places}) for axis in directions]
for axis, inertia in zip(directions, inertias, strict=True):
    modes += [(1e-4, {grid: [*np.cross(axis, at), *axis] / np.sqrt(inertia) for grid, at in places.items()})]
modes += [(41.0, {101: [0, 0, 0.8, 2e-3, 0, 0], 205: [0, 0, -0.6, 1e-3, 0, 0]})]
text = ""
for number, (frequency, shape) in enumerate(modes, 1):
    text += f"$EIGENVECTOR\n$REAL OUTPUT\n$EIGENVALUE = {(2 * np.pi * frequency) ** 2:14.7E}  MODE = {number:5d}\n"
    for grid, motion in shape.items():
        cells = [f"{part:18.6E}" for part in motion]
        text += f"{grid:10d}       G{''.join(cells[:3])}\n{'-CONT-':18}{''.join(cells[3:])}\n"
Path("hub.pch").write_text(text)
Path("hub.bdf").write_text("".join("GRID,{},,{},{},{}\n".format(grid, *at) for grid, at in places.items()))

hub = {"modes": "hub.pch", "units": "mm-t-s", "points": {"root": 101, "payload": 205}, "damping": "0.5 percent"}
changes = {"spacecraft.hub": hub, "spacecraft.interface.position": "root", "spacecraft.line_of_sight.point": "payload"}
scenario = mv.load_scenario(Path(__file__).parent / "spacecraft.yaml", changes)
print(
    f"hub of {scenario.spacecraft.hub.mass:.0f} kg;",
    ", ".join(f"{frequency:.4g} Hz" for frequency in scenario.craft.frequency),
)
