# A hub from Nastran: punched eigenvectors of a free-free run (SOL 103) and its GRID entries; OP2 and OP4 are named the same way.
from pathlib import Path

import numpy as np

import microvib as mv

# Stand-ins for what the run leaves: a free beam of two masses along y, in mm, t and s; grids 101 (root) and 205 (payload).
places = {101: np.array([0.0, 900.0, 0.0]), 205: np.array([0.0, -500.0, 200.0])}
m, J, body = 0.4, np.array([2e5, 1.6e5, 1.9e5]), np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
modes = [(0.0, {g: [*e / np.sqrt(m), 0, 0, 0] for g in places}) for e in body]
modes += [(1e-4, {g: [*np.cross(e, at), *e] / np.sqrt(J[k]) for g, at in places.items()}) for k, e in enumerate(body)]
modes += [(41.0, {101: [0, 0, 0.8, 2e-3, 0, 0], 205: [0, 0, -0.6, 1e-3, 0, 0]})]
text = ""
for k, (f, shape) in enumerate(modes, 1):
    text += f"$EIGENVECTOR\n$REAL OUTPUT\n$EIGENVALUE = {(2 * np.pi * f) ** 2:14.7E}  MODE = {k:5d}\n"
    for grid, v in shape.items():
        text += f"{grid:10d}       G" + "".join(f"{x:18.6E}" for x in v[:3])
        text += "\n" + f"{'-CONT-':18}" + "".join(f"{x:18.6E}" for x in v[3:]) + "\n"
Path("hub.pch").write_text(text)
Path("hub.bdf").write_text("".join("GRID,{},,{},{},{}\n".format(g, *at) for g, at in places.items()))

hub = {"modes": "hub.pch", "units": "mm-t-s", "points": {"root": 101, "payload": 205}, "damping": "0.5 percent"}
changes = {"spacecraft.hub": hub, "spacecraft.interface.position": "root", "spacecraft.line_of_sight.point": "payload"}
scenario = mv.load_scenario(Path(__file__).parent / "spacecraft.yaml", changes)
print(f"hub of {scenario.spacecraft.hub.mass:.0f} kg;", ", ".join(f"{f:.4g} Hz" for f in scenario.craft.frequency))
