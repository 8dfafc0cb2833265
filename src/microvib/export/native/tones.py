"""Lines of a drive as a table of cosines, for an FMU without a state."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

from microvib.analysis.lines import find_lines
from microvib.errors import MicrovibError
from microvib.export.native.variables import TIME, Variable
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.line_table import Line
from microvib.solve.channels import ALL_CHANNELS
from microvib.solve.motion import Motion
from microvib.solve.simulate import simulate
from microvib.solve.steady.state import SteadyState, find_steady

MAGIC = int.from_bytes(b"MVTONES\0", "little")
VERSION = 1
HEADER_WORDS = 8


def with_lines(scenario: GivenScenario) -> Scenario:
    """The scenario as one whose lines can be exported; MicrovibError for one with two drives, and for
    a pulse drive, whose torque is not in the lines that are listed.
    """
    found = as_scenario(scenario)
    if found.driver.pulsed:
        raise MicrovibError(
            "driver.drive: pulse has bursts at each step, whose lines go on over a broad band and are"
            " not all listed; kind tones cannot have them, source or drive can"
        )
    if found.driven_wing is not None:
        raise MicrovibError(
            "spacecraft.second_wing: lines of two drives are not exported together; leave it out"
        )
    return found


def channels_of(scenario: Scenario) -> list[str]:
    """Names of the channels whose lines are given."""
    if scenario.array.interface is None:
        return ["T_d"]
    return ["T_d", *COMPONENTS]


def lines_of(scenario: Scenario) -> dict[str, list[Line]]:
    """Lines that last, by channel: of the steady state, or of a run from rest where there is none."""
    source: SteadyState | Motion | None = find_steady(scenario)[0]
    if source is None:
        source = simulate(scenario, start="rest")
    found = {
        name: [line for line in find_lines(source, name) if line.seen and not line.decay > 0.0]
        for name in channels_of(scenario)
    }
    if not found["T_d"]:
        raise MicrovibError(
            "kind tones: this drive has no line that lasts; export its source instead"
        )
    return found


def tone_table(lines: dict[str, list[Line]]) -> bytes:
    """Table that ``tones.c`` takes."""
    rows = [
        struct.pack("<4d", float(k), line.frequency, line.amplitude, line.phase)
        for k, each in enumerate(lines.values())
        for line in each
    ]
    words = HEADER_WORDS + 4 * len(rows)
    head = struct.pack("<8q", MAGIC, VERSION, words, len(lines), len(rows), 0, 0, 0)
    return head + b"".join(rows)


def tone_variables(names: list[str]) -> list[Variable]:
    """Outputs, each with its mean over the last communication step; and the time."""
    values = [
        Variable(
            name,
            k,
            "output",
            ALL_CHANNELS[name].unit,
            f"{ALL_CHANNELS[name].meaning}: sum of its lines",
        )
        for k, name in enumerate(names)
    ]
    means = [
        replace(
            one,
            name=f"{one.name}_mean",
            reference=len(names) + k,
            meaning=f"{one.meaning}; mean over the last communication step",
        )
        for k, one in enumerate(values)
    ]
    return [*values, *means, Variable("time", TIME, "independent", "s", "time")]


def tone_results(lines: dict[str, list[Line]], times: list[float]) -> str:
    """Sums of the lines at some times, as CSV."""
    rows = [",".join(["time", *lines])]
    for time in times:
        sums = [
            sum(
                line.amplitude * math.cos(2.0 * math.pi * line.frequency * time + line.phase)
                for line in each
            )
            for each in lines.values()
        ]
        rows.append(",".join(f"{number:.17g}" for number in (time, *sums)))
    return "\n".join(rows) + "\n"
