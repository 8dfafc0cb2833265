"""Linearised drive with its array, and the craft that carries them, as a state space with named channels.

    M q'' + C q' + K q = F u,   y = P q + S q'' + E u   =>   x' = A x + B u,   y = C x + D u

The coordinates are theta_m, theta_l (not if the gear is rigid) and the modes of the array, on a craft
also the hub's own and those of a second wing; windings that are driven by voltages add two currents. All
are deviations from smooth turning at the commanded rate, as in ``microvib.model.linear``: frictions by
their viscous part, no detent torque, no transmission error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.export.source import own_axes
from microvib.io.files import library
from microvib.model.craft import Craft, LockedStructure, held_wing, locked_structure
from microvib.model.drive_matrices import coordinates, drive_matrices
from microvib.model.linear import held_motor, voltage_windings
from microvib.model.load import Load
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.model.spacecraft import INTERFACE
from microvib.solve.channels import CHANNELS, LINE_OF_SIGHT, LOADS, SECOND_LOADS, Channel

_MOTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
_SHAFTS = ("theta_m", "theta_l")
_COMMAND = Channel("command", "rad", "commanded angle of the rotor, less its smooth turning")
_TORQUES = (
    Channel("rotor_torque", "N*m", "torque on the rotor"),
    Channel("output_torque", "N*m", "torque on the output shaft, such as minus its friction"),
)
_ACCELERATIONS = tuple(
    Channel(f"base_{name}", unit, f"acceleration of the interface, {name}")
    for name, unit in zip(
        ("ax", "ay", "az", "arx", "ary", "arz"), ("m/s^2",) * 3 + ("rad/s^2",) * 3, strict=True
    )
)
_HUB_LOADS = tuple(
    Channel(f"hub_{name}", load.unit, f"{name} on the hub at the interface point")
    for name, load in LOADS.items()
)
_INTERFACE_MOTION = tuple(
    Channel(f"interface_{name}", unit, f"motion of the interface point, {name}")
    for name, unit in zip(_MOTIONS, ("m",) * 3 + ("rad",) * 3, strict=True)
)


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B u, y = C x + D u with the names, units and meanings of x, u and y."""

    A: np.ndarray
    """(n, n)."""
    B: np.ndarray
    """(n, inputs)."""
    C: np.ndarray
    """(outputs, n)."""
    D: np.ndarray
    """(outputs, inputs)."""
    states: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    title: str = ""

    def __repr__(self) -> str:
        names = (
            ", ".join(channel.name for channel in each) for each in (self.inputs, self.outputs)
        )
        inputs, outputs = names
        return (
            f"StateSpace of {self.title or 'a scenario'}: {len(self.states)} states\n"
            f"  inputs: {inputs}\n  outputs: {outputs}"
        )

    def response(self, frequency: float | np.ndarray) -> np.ndarray:
        """Frequency response, outputs by inputs.

        Parameters
        ----------
        frequency : float or ndarray
            Frequencies [Hz], (m,).

        Returns
        -------
        ndarray
            Complex, (m, outputs, inputs).
        """
        s = 2j * math.pi * np.atleast_1d(np.asarray(frequency, dtype=float))
        unit, found = np.eye(self.A.shape[0]), []
        for each in s:
            found.append(self.C @ np.linalg.solve(each * unit - self.A, self.B) + self.D)
        return np.array(found)

    def index(self, name: str) -> int:
        """Place of an input or output by its name; MicrovibError where there is none of it."""
        for channels in (self.inputs, self.outputs):
            names = [channel.name for channel in channels]
            if name in names:
                return names.index(name)
        known = ", ".join(channel.name for channel in (*self.inputs, *self.outputs))
        raise MicrovibError(f"{name}: is no input or output; there are {known}")

    def to_scipy(self) -> Any:
        """Convert to a ``scipy.signal.StateSpace``, which has no names."""
        from scipy.signal import StateSpace as Plain

        return Plain(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Convert to a ``control.StateSpace`` of python-control, with the names of its channels.

        Raises
        ------
        MicrovibError
            Where python-control is not installed.
        """
        control = library("control")
        return control.ss(
            self.A,
            self.B,
            self.C,
            self.D,
            states=[channel.name for channel in self.states],
            inputs=[channel.name for channel in self.inputs],
            outputs=[channel.name for channel in self.outputs],
        )


@dataclass(frozen=True)
class _SecondOrder:
    """M q'' + C q' + K q = F u; y = P q + R q' + S q'' + E u."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    F: np.ndarray
    P: np.ndarray
    R: np.ndarray
    S: np.ndarray
    E: np.ndarray

    def of(self, T: np.ndarray) -> _SecondOrder:
        """System in fewer coordinates, q = T q_new."""
        return _SecondOrder(
            T.T @ self.M @ T,
            T.T @ self.C @ T,
            T.T @ self.K @ T,
            T.T @ self.F,
            self.P @ T,
            self.R @ T,
            self.S @ T,
            self.E,
        )

    def first_order(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, B, C, D of the states q, q'."""
        n = self.M.shape[0]
        solved = np.linalg.solve(self.M, np.hstack([self.K, self.C, self.F]))
        by_state, by_input = -solved[:, : 2 * n], solved[:, 2 * n :]
        A = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), by_state])
        B = np.vstack([np.zeros_like(self.F), by_input])
        return A, B, np.hstack([self.P, self.R]) + self.S @ by_state, self.S @ by_input + self.E


def no_state_space(scenario: Scenario) -> str:
    """Sentence on why a scenario has no state space; empty where it has one."""
    if not scenario.driver.pulsed:
        return ""
    return (
        "driver.drive: a pulse drive has no linearised form, since nothing holds its rotor between"
        " pulses; current or voltage is expected"
    )


def state_space(scenario: GivenScenario) -> StateSpace:
    """Linearise a scenario's drive and array, and its spacecraft if it has one.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive: a scenario, a name of the catalog, or the path of a scenario file.

    Returns
    -------
    StateSpace
        Inputs are the commanded angle of the rotor and torques on both shafts; on a fixed base whose array
        has a ``rigid_body``, accelerations of the interface; on a craft, loads on the hub there. Outputs
        are T_d, both shafts, the six loads where they are known, on a craft also the motion of the
        interface point and the line of sight.

    Raises
    ------
    MicrovibError
        For a pulse drive, which nothing holds between its pulses.
    ScenarioError
        Where a name stands for no scenario.
    """
    s = as_scenario(scenario)
    refusal = no_state_space(s)
    if refusal:
        raise MicrovibError(refusal)
    if s.craft is None:
        system, inputs, outputs, names = _on_fixed_base(s)
    else:
        system, inputs, outputs, names = _on_craft(s, s.craft)
    states = [*names, *(_rate_of(channel) for channel in names)]
    if s.driver.drive == "voltage":
        A, B, C, D = _with_windings(s, system, len(inputs))
        states += [
            Channel(f"i_{axis}", "A", f"current of axis {axis} of the rotor's frame")
            for axis in "dq"
        ]
    else:
        A, B, C, D = system.first_order()
    return StateSpace(A, B, C, D, tuple(states), tuple(inputs), tuple(outputs), s.title)


_Assembled = tuple[_SecondOrder, list[Channel], list[Channel], list[Channel]]
"""System, inputs, outputs and coordinates."""


def _rate_of(channel: Channel) -> Channel:
    known = {"theta_m": "omega_m", "theta_l": "omega_l"}
    name = known.get(channel.name, f"{channel.name}_rate")
    return Channel(name, f"{channel.unit}/s", f"rate of: {channel.meaning}")


def _shaft_channels(rigid: bool) -> list[Channel]:
    return [CHANNELS[name] for name in _SHAFTS[: 1 if rigid else 2]]


def _modes(stem: str, count: int, meaning: str) -> list[Channel]:
    return [Channel(f"{stem}_{k + 1}", "kg^0.5*m", meaning) for k in range(count)]


def _drive_of(scenario: Scenario, load: Load) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices with both shafts' coordinates whether or not the gear is rigid."""
    reducer = scenario.reducer
    if reducer.rigid:
        reducer = reducer.model_copy(update={"stiffness": 0.0, "damping": 0.0})
    return drive_matrices(held_motor(scenario), reducer, scenario.friction, load)


def _drive_forces(scenario: Scenario, size: int) -> np.ndarray:
    """Forces on the coordinates by command and both torques, (size, 3)."""
    F = np.zeros((size, 3))
    if scenario.driver.drive == "current":
        F[0, 0] = held_motor(scenario).electromagnetic_stiffness
    F[0, 1] = F[1, 2] = 1.0
    return F


def _shaft_outputs(size: int) -> tuple[list[Channel], np.ndarray, np.ndarray]:
    """theta_m, omega_m, theta_l, omega_l: channels, and rows by coordinates and by their rates."""
    channels = [CHANNELS[name] for name in ("theta_m", "omega_m", "theta_l", "omega_l")]
    P, R = np.zeros((4, size)), np.zeros((4, size))
    P[0, 0] = P[2, 1] = R[1, 0] = R[3, 1] = 1.0
    return channels, P, R


def _on_fixed_base(scenario: Scenario) -> _Assembled:
    array, load = scenario.array, scenario.load
    M, C, K = _drive_of(scenario, load)
    n, inputs, F = M.shape[0], [_COMMAND, *_TORQUES], _drive_forces(scenario, M.shape[0])
    momentum = np.concatenate([[load.rotor, load.output], load.H])[None, :]
    outputs, S, axis = [CHANNELS["T_d"]], -momentum, 3 + "xyz".index(array.drive_axis)
    E = np.zeros((1, 3))
    by_array = array.interface
    if by_array is not None:
        coupling = array.coupling
        by_output = np.zeros(6) if coupling is None else np.array(coupling)
        G = np.column_stack([np.zeros(6), by_output, by_array])
        G[axis] = momentum
        outputs, S = [*outputs, *LOADS.values()], np.vstack([S, -G])
        E = np.zeros((7, 3))
    if by_array is not None and array.mass is not None:
        loose = scenario.reducer.model_copy(update={"stiffness": 1.0})  # both shafts
        held = held_wing(
            held_motor(scenario), loose, scenario.friction, array, own_axes(array.drive_axis), 0.0
        )
        inputs, F = [*inputs, *_ACCELERATIONS], np.hstack([F, -held.G.T])
        S = np.vstack([-held.G[[axis]], -held.G])
        E = np.hstack([E, -np.vstack([held.mass[[axis]], held.mass])])
    shafts, P, R = _shaft_outputs(n)
    outputs = [outputs[0], *shafts, *outputs[1:]]
    rows = len(outputs)
    place = np.array([0, *range(5, rows)])
    whole = [np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n))]
    whole[0][1:5], whole[1][1:5], whole[2][place] = P, R, S
    fed = np.zeros((rows, len(inputs)))
    fed[place] = E
    system = _SecondOrder(M, C, K, F, whole[0], whole[1], whole[2], fed)
    modes = _modes("array_mode", load.H.size, "coordinate of an array mode")
    names = [*_shaft_channels(scenario.reducer.rigid), *modes]
    return _reduced(scenario, system), inputs, outputs, names


def _reduced(scenario: Scenario, system: _SecondOrder) -> _SecondOrder:
    if not scenario.reducer.rigid:
        return system
    return system.of(coordinates(scenario.reducer, system.M.shape[0] - 2))


def _on_craft(scenario: Scenario, craft: Craft) -> _Assembled:
    locked = _structure(scenario)
    n = locked.M.shape[0]
    apart, none = np.zeros((n, 2)), np.zeros(0)
    alone = Load(none, none, none, none, none, none, none, locked.output, scenario.rotor_inertia, 0.0, 0.0, 0.0)  # fmt: skip
    of_shafts = _drive_of(scenario, alone)
    by_shafts = np.column_stack([locked.in_rotor, locked.in_output])
    M = np.block([[of_shafts[0], by_shafts.T], [by_shafts, locked.M]])
    C = np.block([[of_shafts[1], apart.T], [apart, locked.C]])
    K = np.block([[of_shafts[2], apart.T], [apart, locked.K]])
    size, at_interface = n + 2, craft.at(INTERFACE)
    on_hub = np.vstack([np.zeros((2, 6)), at_interface.T])
    F = np.hstack([_drive_forces(scenario, size), on_hub])
    inputs = [_COMMAND, *_TORQUES, *_HUB_LOADS]
    shafts, P_shafts, R_shafts = _shaft_outputs(size)
    loads = craft.loads()
    parts = [(list(LOADS.values()), loads), (list(_INTERFACE_MOTION), craft.motion(INTERFACE))]
    if craft.second is not None:
        parts.append((list(SECOND_LOADS.values()), craft.second_loads()))
    if craft.spacecraft.line_of_sight is not None:
        parts.append(([LINE_OF_SIGHT["los_x"], LINE_OF_SIGHT["los_y"]], craft.line_of_sight()))
    parts.insert(0, ([CHANNELS["T_d"]], loads.through(craft.axis[None, :])))
    P, S = [], []
    for _, rows in parts:
        P.append(np.hstack([np.zeros((len(rows.position), 2)), rows.position]))
        S.append(np.hstack([rows.direct[:, ::-1], rows.acceleration]))
    outputs = [*parts[0][0], *shafts, *(c for channels, _ in parts[1:] for c in channels)]
    P = [P[0], P_shafts, *P[1:]]
    S = [S[0], np.zeros_like(P_shafts), *S[1:]]
    R = np.zeros((len(outputs), size))
    R[1:5] = R_shafts
    fed = np.zeros((len(outputs), len(inputs)))
    system = _SecondOrder(M, C, K, F, np.vstack(P), R, np.vstack(S), fed)
    names = [*_shaft_channels(scenario.reducer.rigid), *_structure_names(craft, locked)]
    return _reduced(scenario, system), inputs, outputs, names


def _structure(scenario: Scenario) -> LockedStructure:
    spacecraft = scenario.mounted
    assert spacecraft is not None
    return locked_structure(
        scenario.array, spacecraft, scenario.reducer.output_inertia, scenario.rotor_inertia
    )


def _structure_names(craft: Craft, locked: LockedStructure) -> list[Channel]:
    """Coordinates of hub, second wing and array."""
    hub = [
        Channel(f"hub_{name}", unit, "rigid motion of the hub about its centre of mass")
        for name, unit in zip(_MOTIONS, ("m",) * 3 + ("rad",) * 3, strict=True)
    ]
    flexible = _modes(
        "hub_mode", len(craft.spacecraft.hub.modes), "coordinate of a mode of the hub"
    )
    array = _modes("array_mode", locked.participation.shape[1], "coordinate of an array mode")
    others = locked.M.shape[0] - len(hub) - len(flexible) - len(array)
    second = [
        Channel(
            f"second_wing_{k + 1}",
            "rad",
            "coordinate of the second wing: its shafts, then its modes",
        )
        for k in range(others)
    ]
    return [*hub, *flexible, *second, *array]


def _with_windings(
    scenario: Scenario, system: _SecondOrder, inputs: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C, D with the currents of both axes as two more states."""
    windings = voltage_windings(scenario)
    stiffness = system.K.copy()
    stiffness[0, 0] += windings.spring - held_motor(scenario).electromagnetic_stiffness
    n = system.M.shape[0]
    pulled = np.zeros((n, 1))
    pulled[0] = windings.torque_constant
    with_current = _SecondOrder(
        system.M, system.C, stiffness, np.hstack([system.F, pulled]), system.P, system.R, system.S,
        np.hstack([system.E, np.zeros((len(system.E), 1))]),
    )  # fmt: skip
    A, B, C, D = with_current.first_order()
    L = windings.inductance
    whole = np.zeros((2 * n + 2, 2 * n + 2))
    whole[: 2 * n, : 2 * n] = A
    whole[: 2 * n, 2 * n + 1] = B[:, -1]
    whole[2 * n :, 0], whole[2 * n :, n] = windings.by_angle / L, windings.by_rate / L
    whole[2 * n :, 2 * n :] = -windings.resistance / L
    fed = np.vstack([B[:, :inputs], np.zeros((2, inputs))])
    fed[2 * n :, 0] = windings.by_command / L
    seen = np.hstack([C, np.zeros((len(C), 1)), D[:, [-1]]])
    return whole, fed, seen, D[:, :inputs]


def channel_table(channels: Sequence[Channel]) -> dict[str, list[str]]:
    """Names, units and meanings of channels, a list of each."""
    return {
        "names": [channel.name for channel in channels],
        "units": [channel.unit for channel in channels],
        "meanings": [channel.meaning for channel in channels],
    }
