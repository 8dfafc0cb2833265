"""Basilisk's spinning body on a free hub against the craft: a rigid array at an angle, turned by a
torque on its hinge.

``python benchmarks/spinning_body.py --basilisk PYTHON``, with the interpreter of an environment of
its own (``pip install bsk``). Of both: how the hub turns and its centre of mass moves for each
radian of the hinge, and the inertia that the torque feels.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from typing import Any

TORQUE, SECONDS, STEP = 1e-6, 1.0, 1e-3
CENTER, MASS = [0.1, -0.2, 2.4], 30.0
INERTIA = [[190.0, 2.0, -9.0], [2.0, 185.0, 11.0], [-9.0, 11.0, 14.0]]
HUB_MASS, HUB = 120.0, [[40.0, 3.0, -4.0], [3.0, 35.0, 2.5], [-4.0, 2.5, 30.0]]
PLACE, AXIS, REFERENCE, ANGLE = [0.2, 0.5, -0.3], [0.48, 0.6, -0.64], [0.8, -0.6, 0.0375], 137.0


def basilisk(told: dict[str, Any]) -> dict[str, Any]:
    """Runs where Basilisk is: hinge, hub rate and velocity after a short push, the array as a body
    about its hinge.
    """
    import numpy as np
    from Basilisk.architecture import messaging
    from Basilisk.simulation import spacecraft, spinningBodyOneDOFStateEffector
    from Basilisk.utilities import SimulationBaseClass

    simulation = SimulationBaseClass.SimBaseClass()
    nanoseconds = round(1e9 * STEP)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", nanoseconds))
    craft, array = (
        spacecraft.Spacecraft(),
        spinningBodyOneDOFStateEffector.SpinningBodyOneDOFStateEffector(),
    )
    craft.hub.mHub, craft.hub.r_BcB_B, craft.hub.IHubPntBc_B = HUB_MASS, [[0.0]] * 3, HUB
    array.mass, array.r_SB_B = MASS, [[x] for x in PLACE]
    array.r_ScS_S, array.IPntSc_S = [[x] for x in CENTER], told["about_center"]
    array.dcm_S0B, array.sHat_S = told["turn"], [[0.0], [0.0], [1.0]]
    array.k = array.c = array.thetaInit = array.thetaDotInit = 0.0
    command = messaging.ArrayMotorTorqueMsg().write(
        messaging.ArrayMotorTorqueMsgPayload(motorTorque=[TORQUE])
    )
    array.motorTorqueInMsg.subscribeTo(command)
    craft.addStateEffector(array)
    for model in (craft, array):
        simulation.AddModelToTask("task", model)
    hinge, hub = array.spinningBodyOutMsg.recorder(), craft.scStateOutMsg.recorder()
    for recorder in (hinge, hub):
        simulation.AddModelToTask("task", recorder)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(round(1e9 * SECONDS))
    simulation.ExecuteSimulation()
    rate = float(hinge.thetaDot[-1])
    return {
        "turn": (hub.omega_BN_B[-1] / rate).tolist(),
        "move": (np.asarray(hub.v_BN_N[-1]) / rate).tolist(),
        "inertia": TORQUE * float(hub.times()[-1]) * 1e-9 / rate,
    }


def craft() -> tuple[dict[str, Any], dict[str, Any]]:
    """The same of microvib, and what Basilisk is told: the array's axes at the angle, its inertia
    about its own centre.
    """
    import numpy as np

    import microvib as mv
    from microvib.model.rigid import elements, inertia_about_center

    inertia = np.array(INERTIA)
    changes = {
        "array": {
            "inertia": INERTIA[2][2],
            "modes": [],
            "rigid_body": {"mass": MASS, "center_of_mass": CENTER, "inertia": elements(inertia)},
        },
        "reducer.output_inertia": 0.0,
        "spacecraft": {
            "hub": {"mass": HUB_MASS, "inertia": elements(np.array(HUB))},
            "array_angle": np.radians(ANGLE),
            "interface": {
                "position": PLACE,
                "drive_axis": AXIS,
                "reference": told_reference().tolist(),
            },
        },
    }
    scenario = mv.load_scenario("state-1").with_si(changes)
    found, spacecraft = scenario.craft, scenario.spacecraft
    assert found is not None
    assert spacecraft is not None
    turn = spacecraft.interface.turn("z", spacecraft.array_angle)
    ours = {
        "turn": found.by_output[3:6].tolist(),
        "move": found.by_output[:3].tolist(),
        "inertia": found.load.output,
    }
    return ours, {
        "turn": turn.T.tolist(),
        "about_center": inertia_about_center(MASS, CENTER, inertia).tolist(),
    }


def told_reference() -> Any:
    """The reference made perpendicular to the drive axis."""
    import numpy as np

    axis, first = np.array(AXIS), np.array(REFERENCE)
    return first - (first @ axis) / (axis @ axis) * axis


def main() -> None:
    """Both, side by side."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--basilisk", required=True, help="interpreter that has Basilisk")
    ours, told = craft()
    interpreter = parser.parse_args().basilisk
    done = subprocess.run(
        [interpreter, __file__],
        input=json.dumps(told),
        text=True,
        stdout=subprocess.PIPE,
        check=True,
    )
    theirs = json.loads(done.stdout.splitlines()[-1])
    largest = 0.0
    for key, mine in ours.items():
        a, b = (x if isinstance(x, list) else [x] for x in (mine, theirs[key]))
        off = max(abs(x - y) for x, y in zip(a, b, strict=True)) / max(abs(y) for y in b)
        largest = max(largest, off)
        print(f"{key:8} microvib {a}  Basilisk {b}  off by {off:.1e}")
    sys.exit(largest > 0.01)


if __name__ == "__main__":
    if sys.argv[1:]:
        main()
    else:
        print(json.dumps(basilisk(json.load(sys.stdin))))
