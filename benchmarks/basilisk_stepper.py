"""Basilisk's stepper motor at the step rate of a scenario; run with the interpreter that has
Basilisk.

``python basilisk_stepper.py STEP_ANGLE_RAD STEPS_PER_SECOND SECONDS RATE_HZ`` prints one line of
JSON. The model is kinematic: the rotor follows a prescribed acceleration over each step, whatever
the load, so that there is no friction, no compliance, no array mode and no torque to take lines
from.
"""

from __future__ import annotations

import json
import math
import sys
import time
from typing import Any


def run(step_angle: float, step_rate: float, seconds: float, rate: float) -> dict[str, Any]:
    """Step for ``seconds`` at ``step_rate`` [1/s], updated and recorded about ``rate`` times a
    second.
    """
    from Basilisk.architecture import messaging
    from Basilisk.simulation import stepperMotor
    from Basilisk.utilities import SimulationBaseClass

    # A step must be a whole number of ticks: the motor was seen to run away where it was not.
    ticks = max(round(rate / step_rate), 1)
    tick = round(1e9 / step_rate / ticks)
    steps = math.floor(seconds * step_rate)
    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", tick))
    motor = stepperMotor.StepperMotor()
    motor.setThetaInit(0.0)
    motor.setStepAngle(step_angle)
    motor.setStepTime(tick * ticks * 1e-9)
    command = messaging.MotorStepCommandMsg().write(
        messaging.MotorStepCommandMsgPayload(stepsCommanded=steps)
    )
    motor.motorStepCommandInMsg.subscribeTo(command)
    recorder = motor.stepperMotorOutMsg.recorder()
    simulation.AddModelToTask("task", motor)
    simulation.AddModelToTask("task", recorder)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(round(seconds * 1e9))
    begun = time.perf_counter()
    simulation.ExecuteSimulation()
    wall = time.perf_counter() - begun
    missed = abs(float(recorder.theta[-1]) - steps * step_angle) / step_angle
    return {
        "wall_s": wall,
        "simulated_s": seconds,
        "updates": len(recorder.times()),
        "steps_missed": missed,
    }


if __name__ == "__main__":
    print(json.dumps(run(*(float(argument) for argument in sys.argv[1:5]))))
