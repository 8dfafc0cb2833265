"""Variables of an FMU: what it tells, what it takes, by which names and value references."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microvib.export.native.drive import Output, accelerated_in_six, outputs_of
from microvib.export.native.parameters import parameters_of
from microvib.model.scenario import Scenario
from microvib.solve.pack import pack

(
    HUB_ACCELERATION, ARRAY_RATE, MICROSTEPS, COMMAND, TIME, INDEPENDENT, SHAFT_TORQUE,
    ACCELERATIONS, PARAMETERS,
) = (
    10_000, 10_001, 10_002, 10_003, 10_004, 10_005, 10_006, 10_010, 20_000,
)  # fmt: skip
"""Value references (``fmu.h``): inputs, the parameter that says who commands, time, the parameter that
says how steps are made, the torque on the shaft, the interface's acceleration along x, the first parameter
of the drive. Outputs count from 0."""
COMMANDS = ("profile", "array_rate", "microstep_command")
"""Who commands, by the value of ``command``."""
FIRST_SHOWN = ("T_d", "T_d_mean", "Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""Outputs that a host shows first."""


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU."""

    name: str
    reference: int
    causality: str
    """As FMI says it: output, input, parameter or independent."""
    unit: str
    meaning: str
    kind: str = "Real"
    """Real or Integer."""
    start: float | None = None
    variability: str = ""
    """As FMI says it; empty for what is usual."""
    lowest: float | None = None
    highest: float | None = None


def variables_of(scenario: Scenario) -> list[Variable]:
    """All variables of an FMU of a drive's source."""
    made = list(enumerate(outputs_of(scenario)))
    first = {name: k for k, name in enumerate(FIRST_SHOWN)}
    made.sort(key=lambda each: first.get(each[1].channel.name, len(first)))
    outputs = [_output(number, output) for number, output in made]
    return [*outputs, *inputs(), *_accelerations(scenario), *_parameters(scenario)]


def _accelerations(scenario: Scenario) -> list[Variable]:
    """Accelerations of the interface beside that about the drive axis, where they are known to act."""
    if not accelerated_in_six(scenario):
        return []
    found = []
    for component in range(6):
        axis = "xyz"[component % 3]
        if component < 3:
            name, unit, way = f"interface_acceleration_{axis}", "m/s^2", "along"
        else:
            name, unit, way = f"interface_angular_acceleration_{axis}", "rad/s^2", "about"
        if component == 3 + "xyz".index(scenario.array.drive_axis):
            continue  # hub_acceleration
        meaning = f"acceleration of the interface {way} {axis} of the array, constant over a step"
        found.append(Variable(name, ACCELERATIONS + component, "input", unit, meaning, start=0.0))
    return found


def _parameters(scenario: Scenario) -> list[Variable]:
    """Parameters that a host may set before the start."""
    return [
        Variable(
            one.name,
            PARAMETERS + number,
            "parameter",
            one.unit,
            one.meaning,
            start=one.value,
            variability="fixed",
            lowest=None if math.isinf(one.lowest) else one.lowest,
            highest=None if math.isinf(one.highest) else one.highest,
        )
        for number, one in enumerate(parameters_of(scenario, pack(scenario)))
    ]


def inputs() -> list[Variable]:
    """Variables that a host gives, and the time."""
    return [
        Variable(
            "hub_acceleration",
            HUB_ACCELERATION,
            "input",
            "rad/s^2",
            "angular acceleration of the spacecraft about the drive axis, constant over a step",
            start=0.0,
        ),
        Variable(
            "shaft_torque",
            SHAFT_TORQUE,
            "input",
            "N*m",
            "torque on the output shaft by what the host has on it, constant over a step",
            start=0.0,
        ),
        Variable(
            "array_rate",
            ARRAY_RATE,
            "input",
            "rad/s",
            "commanded rate of the array, which counts where command is 1",
            start=0.0,
        ),
        Variable(
            "microstep_command",
            MICROSTEPS,
            "input",
            "",
            "number of microsteps that the rotor is commanded to, which counts where command is 2",
            kind="Integer",
            start=0,
        ),
        Variable(
            "command",
            COMMAND,
            "parameter",
            "",
            "who commands: 0 the rate profile of the scenario, 1 array_rate, 2 microstep_command",
            kind="Integer",
            start=0,
            variability="fixed",
            lowest=0,
            highest=len(COMMANDS) - 1,
        ),
        Variable(
            "independent_steps",
            INDEPENDENT,
            "parameter",
            "",
            "1: internal steps do not end where communication steps do, as long as no input changes",
            kind="Integer",
            start=0,
            variability="fixed",
            lowest=0,
            highest=1,
        ),
        Variable("time", TIME, "independent", "s", "time"),
    ]


def _output(number: int, output: Output) -> Variable:
    channel = output.channel
    return Variable(channel.name, number, "output", channel.unit, channel.meaning)
