"""Entries of a data sheet: one list for the options of the command line, its questions, and the
page's form.
"""

from __future__ import annotations

from typing import NamedTuple


class Question(NamedTuple):
    """An entry of a data sheet: how its value is called in the help, what it is, and an example
    where its form is not evident.
    """

    metavar: str
    words: str
    example: str = ""

    def __str__(self) -> str:
        if self.example:
            return f"{self.words}, e.g. '{self.example}'"
        return self.words


QUESTIONS = {
    "holding_torque": Question("TORQUE", "Holding torque of the motor", "0.5 N*m"),
    "phases": Question("2|3|5", "Phases of the motor [usual: 2]"),
    "phases_on": Question("1|2|...", "Phases on at the holding torque [usual: 2 of two phases]"),
    "current": Question("CURRENT", "Current per phase at the holding torque", "0.6 A"),
    "detent": Question(
        "DETENT", "Detent torque, or its fraction of the holding torque", "5 percent"
    ),
    "step_angle": Question("ANGLE", "Full step at the output", "0.018 deg"),
    "ratio": Question("NUMBER", "Reduction ratio", "100"),
    "resistance": Question("RESISTANCE", "Resistance of one winding", "6 ohm"),
    "inductance": Question("INDUCTANCE", "Inductance of one winding", "13 mH"),
    "rotor_inertia": Question("INERTIA", "Moment of inertia of the rotor", "0.2 kg*cm^2"),
    "drive": Question(
        "current|voltage|pulse",
        "What the driver commands: current, voltage without a current loop, or voltage pulses",
    ),
    "supply_voltage": Question(
        "VOLTAGE", "Supply voltage; of a pulse drive that of a pulse", "28 V"
    ),
    "on_time": Question("TIME", "Of a pulse drive: on-time of the pulse of a step", "60 ms"),
    "diode_voltage": Question("VOLTAGE", "Of a pulse drive: voltage of its diodes or clamp", "8 V"),
    "clamp": Question(
        "unidirectional|bidirectional",
        "Of a pulse drive: unidirectional as diodes, or either way on each of four windings",
    ),
    "microsteps": Question("NUMBER", "Microsteps per full step", "16"),
    "gear": Question(
        "GEAR", "A harmonic gear of the catalog, planetary, or none", "size 14 ratio 100"
    ),
    "third_harmonic": Question(
        "FRACTION", "Third harmonic of the back-EMF over its fundamental", "2 percent"
    ),
}
"""In the order in which it is asked for; the keys are those of ``io.data_sheet.DataSheet``."""
