# A second wing: the line of sight over the phase between both drives' steps, and with the second drive held.
from pathlib import Path

import microvib as mv

scenario = mv.load_scenario(Path(__file__).parent / "spacecraft.yaml")
place = {"position": ["0.35 m", "-0.9 m", "-0.2 m"], "drive_axis": [0, -1, 0], "reference": [1, 0, 0]}
cases = {f"driven, stagger {stagger:g}": {"drive": "driven", "stagger": stagger} for stagger in (0.0, 0.25, 0.5)} | {
    "held": {"drive": "held"}
}
print("second wing           drive_1: los_x, los_y [nrad]   loads about the drive axes [mN m]")
for name, keys in cases.items():
    changed = scenario.with_({"spacecraft.second_wing": {"interface": place, **keys}})
    lines = mv.run_scenario(changed, start="steady", lines_only=True).hub
    row = lines.names.index("drive_1")
    about_x, about_y = 1e9 * lines.amplitude[row]
    first, second = (1e3 * abs(loads[row, 4]) for loads in (lines.loads, lines.second))
    print(f"{name:22s} {about_x:14.3f} {about_y:8.3f} {first:22.2f} {second:8.2f}")
