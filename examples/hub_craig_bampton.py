# A hub from a Craig-Bampton model: modes with the interface clamped and their participation; it is freed at the interface.
from pathlib import Path

import numpy as np

import microvib as mv
from microvib.io.modal_table import modes_csv
from microvib.structures.modal import ModalModel

# A table as `microvib modes` writes it; results of Nastran and Ansys with the interface clamped are taken as they are.
mass = np.diag([420.0, 420.0, 420.0, 560.0, 180.0, 590.0])  # about the interface point, 0.9 m from the centre of mass
mass[0, 5], mass[2, 3] = 378.0, -378.0
mass[5, 0], mass[3, 2] = 378.0, -378.0
clamped = ModalModel(
    frequency=np.array([21.0, 34.0]),
    damping=np.array([0.005, 0.005]),
    participation=np.array([[3.0, 0, 0, 0, 0.5, 2.0], [0, 1.0, 4.0, -3.0, 0, 0]]).T,
    mass=mass,
)
Path("hub.csv").write_text(modes_csv(clamped))
changes = {
    "spacecraft.hub": {"modes": "hub.csv", "interface": "root"},
    "spacecraft.interface.position": "root",
    "spacecraft.line_of_sight.point": "root",  # the one point whose motion such a model knows
}
scenario = mv.load_scenario(Path(__file__).parent / "spacecraft.yaml", changes)
print("free hub:", ", ".join(f"{mode.frequency:.4g} Hz" for mode in scenario.spacecraft.hub.modes))
print("locked modes:", ", ".join(f"{f:.4g} Hz" for f in scenario.craft.frequency))
