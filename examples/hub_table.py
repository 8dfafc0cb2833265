# A hub from a table of free-free modes, the six rigid ones among them, as any finite-element program can write it.
import csv
from pathlib import Path

import numpy as np

import microvib as mv

mass, inertia = 300.0, np.diag([150.0, 120.0, 180.0])
points = {"root": np.array([0.35, 0.9, -0.2]), "payload": np.array([0.0, 0.1, 0.7])}
bending = {"root": [0, 2e-3, 9e-3, 2e-2, 0, 0], "payload": [0, -1e-3, 0.03, 1e-2, 4e-3, 0]}  # mass-normalised

with Path("hub.csv").open("w", newline="") as file:
    table = csv.writer(file)
    table.writerow(
        ["mode", "frequency_hz", "damping", "point", "x_m", "y_m", "z_m", "tx", "ty", "tz", "rx", "ry", "rz"]
    )
    for name, at in points.items():
        for axis, direction in enumerate(np.eye(3)):  # a rigid body's displacements, and its rotations about the origin
            table.writerow([axis + 1, 0.0, 0.0, name, *at, *direction / np.sqrt(mass), 0, 0, 0])
            turn = direction / np.sqrt(inertia[axis, axis])
            table.writerow([axis + 4, 0.0, 0.0, name, *at, *np.cross(turn, at), *turn])
        table.writerow([7, 38.0, 0.005, name, *at, *bending[name]])

changes = {"spacecraft.hub": {"modes": "hub.csv"}, "spacecraft.line_of_sight.point": "payload"}
scenario = mv.load_scenario(Path(__file__).parent / "spacecraft.yaml", {**changes, "record.duration": "4 s"})
print("locked modes:", ", ".join(f"{frequency:.4g} Hz" for frequency in scenario.craft.frequency))
motion = mv.simulate(scenario)
print(f"payload: {1e6 * motion.hub('payload', accelerations=True)[:, 2].std():.3g} um/s^2 rms along z")
