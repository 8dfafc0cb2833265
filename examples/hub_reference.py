# A hub from finite elements: the reference hub, a small Earth-observation craft with its payload on a bench, every value assumed.
from pathlib import Path

import microvib as mv

changes = {
    "spacecraft.hub": {"modes": "reference-hub", "count": 20},  # or a description of your own, hub.yaml
    "spacecraft.interface.position": "root",  # a named point of the hub
    "spacecraft.line_of_sight.point": "payload",
    "record.duration": "8 s",
}
scenario = mv.load_scenario(Path(__file__).parent / "spacecraft.yaml", changes)
hub = scenario.spacecraft.hub
print(f"{hub.mass:.1f} kg, first modes", ", ".join(f"{mode.frequency:.1f} Hz" for mode in hub.modes[:3]))

found = mv.run_scenario(scenario)
for name, rms in found.hub.ranking("rpe", 0.01)[:4]:
    print(f"{name}: {1e9 * rms:.3g} nrad in a window of 10 ms")
