# A hub from a Craig-Bampton model: modes with the interface clamped and their participation; it is freed at the interface.
import csv
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

import microvib as mv

# A table as `microvib modes` writes it; results of Nastran and Ansys with the interface clamped are taken as they are.
mass = np.diag([420.0, 420.0, 420.0, 560.0, 180.0, 590.0])  # about the interface point, 0.9 m from the centre of mass
mass[0, 5] = mass[5, 0] = 378.0
mass[2, 3] = mass[3, 2] = -378.0
modes = {21.0: [3.0, 0, 0, 0, 0.5, 2.0], 34.0: [0, 1.0, 4.0, -3.0, 0, 0]}  # Hz, and participation in six components
axes = ("fx", "fy", "fz", "mx", "my", "mz")
couplings = [f"rigid_{first}_{second}" for first, second in combinations_with_replacement(axes, 2)]
with Path("hub.csv").open("w", newline="") as file:
    table = csv.writer(file)
    table.writerow(["frequency_hz", "damping", *(f"participation_{axis}" for axis in axes), *couplings])
    for frequency, participation in modes.items():
        table.writerow([frequency, 0.005, *participation, *mass[np.triu_indices(6)]])

hub = {"modes": "hub.csv", "interface": "root"}
root = "root"  # the one point whose motion such a model knows
changes = {"spacecraft.hub": hub, "spacecraft.interface.position": root, "spacecraft.line_of_sight.point": root}
scenario = mv.load_scenario(Path(__file__).parent / "spacecraft.yaml", changes)
print("free hub:", ", ".join(f"{mode.frequency:.4g} Hz" for mode in scenario.spacecraft.hub.modes))
print("locked modes:", ", ".join(f"{frequency:.4g} Hz" for frequency in scenario.craft.frequency))
