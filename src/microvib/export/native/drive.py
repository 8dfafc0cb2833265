"""From a scenario to the image of its drive: what is called, what is asked of it, and by which names."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.export.native.image import Call, image
from microvib.export.native.parameters import (
    packing_numbers,
    parameters_of,
    with_spare_levels,
)
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.solve import kernel, propagate, propagators
from microvib.solve.channels import CHANNELS, LOADS, MODAL, Channel
from microvib.solve.command import MAX_MICROSTEP_RATE, Command
from microvib.solve.pack import Packed, linear_part_arguments, moments, pack
from microvib.solve.sampling import sample_buffer

MOST_DUE = 1024
"""Microsteps that one call of the compiled loop takes at most; the wrapper calls it again."""
MOST_KNOTS = 2048
"""Knots of the torque that the spacecraft's motion makes, in one such call."""
HUB_KNOTS_PER_PERIOD = 64.0
"""Such knots in a period of the highest mode: cubics between them are good to 3e-7."""
LEAST_HUB_KNOT_RATE = 100.0
"""Such knots a second [1/s] where there are no modes, and at least."""
(
    INSTANT,
    MEAN,
    LOAD,
    LOAD_MEAN,
    ENERGY,
    COMMANDED,
    COUNTED,
) = range(7)
"""Kinds of outputs: a channel at the instant or its mean, a sum of channels or its mean, an energy,
the number of microsteps, a counter of the equations."""
STEPS = {
    "steps_judged": (kernel.STEPS_JUDGED, "full steps judged, each when the next one begins"),
    "steps_lost": (kernel.STEPS_LOST, "full steps lost of those judged"),
    "steps_gained": (kernel.STEPS_GAINED, "full steps gained beyond those commanded"),
}
"""Counters of a pulse drive that are outputs: their index and meaning, by name."""
CHANGED = (
    "x.y", "x.stick", "x.clock", "x.counters", "x.energy", "x.levels", "out.rows", "out.partial",
    "out.cursor", "lanes", "flat", "by_node", "room", "wrapper.state", "wrapper.hub",
)  # fmt: skip
"""Arrays that make up the state of a run. Scratch is among them: the length of the first step of a
call goes by accelerations that the last call left there."""
EMPTY = (
    "up", "down", "q", "t.nodes", "t.pieces", "t.modes", "t.sums", "steps_t", "steps_ref", "scratch", "out", "hub.knots",
    *(f"{part}.{name}" for part in ("drive", "mode") for name in propagators.Moments._fields),
)  # fmt: skip
"""Arrays that are made or filled where the image is opened."""
STATE_WORDS = 32
"""Words that the wrapper keeps for itself, beside those of the spacecraft's motion."""


@dataclass(frozen=True)
class Output:
    """Something that an exported drive tells: its description, and where it comes from."""

    channel: Channel
    kind: int
    index: int


def exportable(scenario: GivenScenario) -> Scenario:
    """The scenario as one that can be exported; MicrovibError, a sentence, for one that cannot."""
    found = as_scenario(scenario)
    reasons = {
        "spacecraft": (
            found.craft is not None,
            "the exported drive stands on a spacecraft that its host moves; leave spacecraft out",
        ),
        "driver.compensation": (
            bool(found.driver.compensation),
            "microsteps that come earlier or later are not exported; leave compensation out",
        ),
        "driver.microstep_shape": (
            bool(found.driver.microstep_shape),
            "microsteps in parts are not exported; leave microstep_shape out",
        ),
    }
    for key, (present, reason) in reasons.items():
        if present:
            raise MicrovibError(f"{key}: {reason}")
    return found


def without_modes(scenario: Scenario) -> Scenario:
    """The scenario with no more of its array than what is rigid on the shaft, for hosts that have
    the rest; MicrovibError where nothing is.
    """
    rigid = scenario.array.J_h
    if not rigid > 0.0:
        raise MicrovibError(
            "kind drive: all of the array's inertia is in its modes; export the source, which has"
            " these, or give array.rigid_inertia"
        )
    changes: dict[str, Any] = {
        "array.modes": [],
        "array.inertia": f"{rigid!r} kg*m^2",
        "array.rigid_inertia": None,
        "array.rigid_body": None,
        "array.interface_inertia": None,
    }
    return scenario.with_(changes)


def outputs_of(scenario: Scenario) -> list[Output]:
    """Outputs of an exported drive, in its order."""
    named = list(CHANNELS.values())
    found = [Output(channel, INSTANT, k) for k, channel in enumerate(named[: kernel.POWERS])]
    found += [Output(channel, ENERGY, k) for k, channel in enumerate(named[kernel.POWERS :])]
    count = int(scenario.load.H.size)
    for block, channel in enumerate(MODAL.values()):
        for mode in range(count):
            one = Channel(
                f"{channel.name}[{mode + 1}]", channel.unit, f"{channel.meaning}, mode {mode + 1}"
            )
            found.append(Output(one, INSTANT, kernel.N_CHANNELS + block * count + mode))
    found.append(Output(_mean_of(CHANNELS["T_d"]), MEAN, kernel.T_D))
    if scenario.array.interface is not None:
        loads = [LOADS[name] for name in COMPONENTS]
        found += [Output(load, LOAD, k) for k, load in enumerate(loads)]
        found += [Output(_mean_of(load), LOAD_MEAN, k) for k, load in enumerate(loads)]
    commanded = Channel("microsteps", "1", "microsteps that the rotor is commanded to")
    found.append(Output(commanded, COMMANDED, 0))
    if scenario.driver.pulsed:
        found += [
            Output(Channel(name, "1", meaning), COUNTED, index)
            for name, (index, meaning) in STEPS.items()
        ]
    return found


def _mean_of(channel: Channel) -> Channel:
    """The mean of a channel since the last communication."""
    return replace(
        channel,
        name=f"{channel.name}_mean",
        meaning=f"{channel.meaning}; mean over the last communication step",
    )


def load_weights(scenario: Scenario) -> np.ndarray:
    """Weights of the channels in the loads at the interface, (6, channels); (0, 0) where there are
    none (``solve.motion.interface_loads``)."""
    array = scenario.array
    P = array.interface
    if P is None:
        return np.zeros((0, 0))
    count = array.H.size
    weights = np.zeros((6, kernel.N_CHANNELS + 2 * count))
    weights[:, list(CHANNELS).index("alpha_l")] = P @ array.H
    if array.coupling is not None:
        weights[:, list(CHANNELS).index("alpha_l")] -= array.coupling
    weights[:, kernel.N_CHANNELS : kernel.N_CHANNELS + count] = P * array.Lambda
    weights[:, kernel.N_CHANNELS + count :] = P * array.D
    axis = 3 + "xyz".index(array.drive_axis)
    weights[axis] = 0.0
    weights[axis, kernel.T_D] = 1.0
    return weights


def drive_image(scenario: Scenario) -> bytes:
    """Image of the drive of a scenario, at rest at time 0."""
    packed = pack(scenario)
    x, p = packed.state, packed.drive
    t = with_spare_levels(packed.propagators, int(p.H.size))
    samples = sample_buffer(np.zeros((1, packed.columns)), 0.0, 1.0)
    due = np.zeros(MOST_DUE), np.zeros((MOST_DUE, 4))
    square, pair = moments(kernel.MODES, 6), moments(2, 2 if p.H_m.size else 1)
    calls = {
        "advance": Call(
            propagate.advance, (0.0, x, p, t, samples, *due, *packed.lanes, packed.scratch.ravel())
        ),
        "snapshot": Call(
            kernel.snapshot, (x, p, np.zeros_like(packed.scratch), np.zeros(packed.channels))
        ),
        "tabulate": Call(propagators.tabulate, (t, p, square, pair)),
        "linear_part": Call(
            propagators.linear_part,
            linear_part_arguments(p, x._replace(y=packed.held), t.A),
        ),
        "initial_friction": Call(kernel.initial_friction, (x, p)),
    }
    return image(calls, _beside(scenario, packed), CHANGED, EMPTY)


def _beside(scenario: Scenario, packed: Packed) -> dict[str, np.ndarray]:
    """Arrays that the wrapper takes, beside those of the compiled functions."""
    outputs = outputs_of(scenario)
    count = int(packed.drive.H.size)
    names = [*CHANNELS, *(f"{name}[{k + 1}]" for name in MODAL for k in range(count))]
    names += [""] * (packed.columns - len(names))
    legs = Command(scenario).legs
    described = [(o.channel.name, o.channel.unit, o.channel.meaning) for o in outputs]
    return {
        "outputs.places": np.array([(o.kind, o.index) for o in outputs], dtype=np.int64),
        "outputs.texts": _texts([text for each in described for text in each]),
        "outputs.weights": load_weights(scenario),
        "channels.texts": _texts(names),
        **_parameters_beside(scenario, packed),
        "command.legs": legs,
        "command.profile": legs.copy(),
        "command.references": _references(scenario),
        "command.numbers": np.array(
            [
                scenario.driver.beats * scenario.driver.microsteps,
                scenario.motor.axis_current,
                scenario.driver.microstep_ramp,
                scenario.driver.on_time or 0.0,
                _microsteps_per_angle(scenario),
                _highest_microstep_rate(scenario),
            ]
        ),
        **_hub_beside(scenario, packed),
        "hub.knots": np.zeros((MOST_KNOTS, 2)),
        "wrapper.state": np.zeros(STATE_WORDS),
        "wrapper.hub": np.zeros(3 * count + 2 * len(COMPONENTS)),
    }


def _highest_microstep_rate(scenario: Scenario) -> float:
    """Most microsteps per second [1/s] that a host's command is followed at; of a pulse drive no pulse
    is cut short by the next step, within the rounding that a scenario's own check allows.
    """
    if not scenario.driver.on_time:
        return MAX_MICROSTEP_RATE
    return (1.0 + 1e-9) / scenario.driver.on_time


def _microsteps_per_angle(scenario: Scenario) -> float:
    """Microsteps per commanded angle of the array [1/rad], by the step clock."""
    angle = -scenario.reducer.h / scenario.driver.microstep(scenario.motor)
    return float(angle * scenario.tracking.clock_ratio)


def _parameters_beside(scenario: Scenario, packed: Packed) -> dict[str, np.ndarray]:
    """Parameters: texts, kinds, and values with the lowest and highest that are allowed, and as exported."""
    found = parameters_of(scenario, packed)
    texts = [text for one in found for text in (one.name, one.unit, one.meaning, one.field)]
    return {
        "parameters.texts": _texts(texts),
        "parameters.places": np.array(
            [(one.kind, one.index, one.positive) for one in found], dtype=np.int64
        ),
        "parameters.values": np.array(
            [(one.value, one.lowest, one.highest, one.value) for one in found]
        ),
        "parameters.packing": packing_numbers(scenario, packed, _microsteps_per_angle(scenario)),
    }


def _texts(texts: list[str]) -> np.ndarray:
    """Texts one after the other, each with a zero at its end, as words."""
    content = b"".join(text.encode() + b"\0" for text in texts)
    return np.frombuffer(content.ljust(-(-len(content) // 8) * 8, b"\0"), dtype=np.int64)


def _references(scenario: Scenario) -> np.ndarray:
    """References after each microstep of an electrical turn [A], (m, 2); (0, 2) where they are
    cosine and sine."""
    driver = scenario.driver
    if not (driver.distorted or driver.pulsed):
        return np.zeros((0, 2))
    turn = np.arange(driver.beats * driver.microsteps)
    return np.column_stack(driver.reference_currents(scenario.motor, turn))


def _hub_knot_rate(scenario: Scenario, packed: Packed) -> float:
    """Knots a second [1/s] of the torque by the spacecraft's motion; of a drive with torque noise a
    whole multiple of its own knots."""
    highest = float(np.sqrt(np.max(scenario.load.Lambda, initial=0.0))) / (2.0 * np.pi)
    wanted = max(HUB_KNOTS_PER_PERIOD * highest, LEAST_HUB_KNOT_RATE)
    if packed.drive.noise.size == 0:
        return wanted
    own = float(packed.drive.noise_rate)
    return own * max(np.ceil(wanted / own), 1.0)


def accelerated_in_six(scenario: Scenario) -> bool:
    """Whether what the interface's acceleration makes is known in all its components."""
    return scenario.array.interface is not None and scenario.array.mass is not None


def _hub_beside(scenario: Scenario, packed: Packed) -> dict[str, np.ndarray]:
    """Arrays for the spacecraft's motion: participation of the modes, (6, s); residual mass in the
    drive axis, (6,); loads by the modes' second derivatives and by the accelerations, (6, s + 6).
    """
    array, p = scenario.array, packed.drive
    axis, count = 3 + "xyz".index(array.drive_axis), int(array.H.size)
    participation, mass, loads = np.zeros((6, count)), np.zeros((6, 6)), np.zeros((0, 0))
    participation[axis] = array.H
    if array.interface is not None:
        participation = np.ascontiguousarray(array.interface)
        if array.mass is not None:
            mass = np.array(array.mass)
        elif array.coupling is not None:
            mass[:, axis] = array.coupling
        loads = np.column_stack([-participation, -mass])
    residual = np.zeros(6)
    if accelerated_in_six(scenario):
        residual = mass[axis] - participation[axis] @ participation.T
    residual[axis] = p.J_L
    six = float(accelerated_in_six(scenario))
    return {
        "hub.numbers": np.array([_hub_knot_rate(scenario, packed), p.J_L, p.J_m, axis, six]),
        "hub.participation": participation,
        "hub.residual": residual,
        "hub.loads": loads,
    }
