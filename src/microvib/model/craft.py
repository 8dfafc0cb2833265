"""Drive, array and free hub as one linear structure with both hinges locked: its modes, and what
follows from its motion.

Coordinates are the hub's, q (displacement of its centre of mass, rotation, flexible modes), and the
array's fixed-interface modes eta. With u_I = Phi_I q the motion of the interface point, M and P
mass matrix and participation of the array about it, in hub axes and at the array's angle, a the
unit rotation about the drive axis (docs/theory/spacecraft.md):

    M_S = [[M_hub + Phi_I' (M + J_m a a') Phi_I, Phi_I' P], [P' Phi_I, 1]]
    in theta_l: [Phi_I' M a; P' a],     in theta_m: [J_m Phi_I' a; 0]

A second wing adds its own coordinates between q and eta: its array's modes, and both its shafts,
which its linearised drive holds.

Motions without stiffness (all six rigid ones, or the three displacements where the attitude is
controlled) are split off exactly: their momentum is conserved, so that they follow from the two
shafts' angles. The others, which damping couples, are the modes of the kernel once they are
decoupled (``microvib.model.decoupled``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from microvib.model.array import Array
from microvib.model.decoupled import DecoupledModes, decouple_modes
from microvib.model.drive_matrices import coordinates, drive_matrices
from microvib.model.driver import motor_of_mean_spring
from microvib.model.friction import Friction
from microvib.model.load import Load
from microvib.model.motor import Motor
from microvib.model.reducer import Reducer
from microvib.model.rigid import block_rotation, rigid_motion_at, tensor
from microvib.model.spacecraft import CENTER, INTERFACE, SECOND_INTERFACE, Interface, Spacecraft


@dataclass(frozen=True)
class OutputMatrix:
    """Outputs, (k, ...): combinations of the coordinates, of their accelerations, and of
    those of output and rotor.
    """

    position: np.ndarray
    """By q, eta, (k, n)."""
    acceleration: np.ndarray
    """By their second derivatives, (k, n)."""
    direct: np.ndarray
    """By alpha_l, alpha_m, (k, 2)."""

    def through(self, rows: np.ndarray) -> OutputMatrix:
        """Combinations ``rows`` (m, k) of these."""
        return OutputMatrix(rows @ self.position, rows @ self.acceleration, rows @ self.direct)


@dataclass(frozen=True)
class ModalOutputMatrix:
    """Outputs by the kernel's modes and shafts, (k, ...), which turn samples into samples."""

    eta: np.ndarray
    """By the modes, (k, s)."""
    rate: np.ndarray
    """By their rates, (k, s)."""
    shafts: np.ndarray
    """By angle, acceleration and rate of output and rotor: theta_l, theta_m, alpha_l, alpha_m,
    omega_l, omega_m, (k, 6).
    """

    def of(self, eta: np.ndarray, rate: np.ndarray, shafts: np.ndarray) -> np.ndarray:
        """Values (..., k) for a motion: modes and their rates (..., s), shafts (..., 6).

        Angles of the shafts count from their mean motion, which the command makes.
        """
        return np.asarray(eta @ self.eta.T + rate @ self.rate.T + shafts @ self.shafts.T)


@dataclass(frozen=True)
class HeldWing:
    """A wing whose shaft is held by its linearised drive: coordinates x that the interface's
    acceleration excites.

    M x'' + C x' + K x = -G' a, and the load on the hub is -(mass a + G x''); x are theta_m, theta_l
    (not if rigid), modes.
    """

    mass: np.ndarray
    """With x = 0, about the interface point, hub axes, (6, 6)."""
    G: np.ndarray
    """Momentum at the interface by the rates of the coordinates, (6, n)."""
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    """Stiffness of the coordinates, (n, n)."""


@dataclass(frozen=True)
class Craft:
    """The structure with locked hinges: its modes zeta, undamped and mass-normalised, and its free
    motions.
    """

    spacecraft: Spacecraft
    load: Load
    shapes: np.ndarray
    """Coordinates q, eta by the modes, (n, s)."""
    squares: np.ndarray
    """Squares of their frequencies, (s,) [1/s^2] ascending."""
    damping: np.ndarray
    """Their damping, (s, s) [1/s]."""
    participation_of_shafts: np.ndarray
    """Their participation in the motion of output and rotor, (s, 2)."""
    modes: DecoupledModes
    """Modes as the kernel takes them."""
    by_output: np.ndarray
    """Coordinates by theta_l, through the free motions, (n,)."""
    by_rotor: np.ndarray
    """Coordinates by theta_m, (n,)."""
    array_mass: np.ndarray
    """Mass matrix of the array about the interface point, hub axes, with the reducer's output about
    the drive axis, (6, 6).
    """
    participation: np.ndarray
    """Participation of the array's modes, hub axes, (6, s_array)."""
    rotor_inertia: float
    second: HeldWing | None
    """The second wing."""

    @property
    def frequency(self) -> np.ndarray:
        """Natural frequencies with locked hinges [Hz], (s,) ascending; free motions are not among
        them.
        """
        return np.asarray(np.sqrt(self.squares) / (2.0 * np.pi))

    @property
    def axis(self) -> np.ndarray:
        """Unit rotation about the drive axis, hub axes, (6,)."""
        return _unit_rotation(self.spacecraft.interface.axis)

    def at(self, point: str) -> np.ndarray:
        """Motion of a named point by the coordinates, (6, n): displacement and rotation, hub axes."""
        of_hub = _motion_of_point(self.spacecraft, point)
        return np.hstack([of_hub, np.zeros((6, self.shapes.shape[0] - of_hub.shape[1]))])

    def motion(self, point: str) -> OutputMatrix:
        """Displacement [m] and rotation [rad] of a named point, hub axes, less the mean motion that
        the command makes.
        """
        there = self.at(point)
        return OutputMatrix(there, np.zeros_like(there), np.zeros((6, 2)))

    def acceleration(self, point: str) -> OutputMatrix:
        """Its second derivative [m/s^2, rad/s^2]."""
        there = self.at(point)
        return OutputMatrix(np.zeros_like(there), there, np.zeros((6, 2)))

    def loads(self) -> OutputMatrix:
        """Loads on the hub at the interface point, Fx Fy Fz [N], Mx My Mz [N m], hub axes.

        Minus the rate of momentum of array, reducer output and rotor,
        -(M (u_I'' + a alpha_l) + P eta'') - a J_m (alpha_m + a'u_I'').
        """
        at_root, a, J_m, M = self.at(INTERFACE), self.axis, self.rotor_inertia, self.array_mass
        of_modes = np.zeros_like(at_root)
        of_modes[:, at_root.shape[1] - self.participation.shape[1] :] = self.participation
        acceleration = -(M + J_m * np.outer(a, a)) @ at_root - of_modes
        return OutputMatrix(
            np.zeros_like(at_root), acceleration, -np.column_stack([M @ a, J_m * a])
        )

    def second_loads(self) -> OutputMatrix:
        """Loads of the second wing at its interface point."""
        if self.second is None:
            raise ValueError("this spacecraft has no second wing")
        there, before = self.at(SECOND_INTERFACE), 6 + len(self.spacecraft.hub.modes)
        acceleration = -self.second.mass @ there
        acceleration[:, before : before + self.second.G.shape[1]] -= self.second.G
        return OutputMatrix(np.zeros_like(there), acceleration, np.zeros((6, 2)))

    def line_of_sight(self, *, accelerations: bool = False) -> OutputMatrix:
        """Two angles of the line of sight [rad], or their ``accelerations`` [rad/s^2]; see
        ``LineOfSight``.
        """
        move, los = (
            self.acceleration if accelerations else self.motion,
            self.spacecraft.line_of_sight,
        )
        if los is None:
            raise ValueError("this spacecraft has no line of sight")
        if los.rows is None:
            return move(los.point).through(np.hstack([np.zeros((2, 3)), los.axes()]))
        parts = [
            move(row.point).through(np.outer([row.axis == "x", row.axis == "y"], row.by))
            for row in los.rows
        ]
        return OutputMatrix(
            np.sum([part.position for part in parts], axis=0),
            np.sum([part.acceleration for part in parts], axis=0),
            np.sum([part.direct for part in parts], axis=0),
        )

    def outputs(self, rows: OutputMatrix) -> ModalOutputMatrix:
        """Outputs by the kernel's modes and shafts; accelerations by the equations of
        motion of zeta.
        """
        y, free = self.modes, np.column_stack([self.by_output, self.by_rotor])
        by_acceleration = rows.acceleration @ self.shapes
        by_zeta = rows.position @ self.shapes - by_acceleration * self.squares
        by_rate = -by_acceleration @ self.damping
        by_alpha = (
            rows.direct + rows.acceleration @ free - by_acceleration @ self.participation_of_shafts
        )
        # zeta = p y + q y' + q a' omega,   zeta' = p y' - q (d y' + k y + g' omega)
        return ModalOutputMatrix(
            by_zeta @ y.p - by_rate @ (y.q * y.k),
            by_zeta @ y.q + by_rate @ (y.p - y.q * y.d),
            np.hstack([rows.position @ free, by_alpha, by_zeta @ y.q @ y.a - by_rate @ y.q @ y.g]),
        )

    def transfer(self, rows: OutputMatrix, frequency: np.ndarray) -> np.ndarray:
        """Outputs by alpha_l and alpha_m at each ``frequency`` (m,) [Hz], (m, k, 2)."""
        free = np.column_stack([self.by_output, self.by_rotor])
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[:, None, None]
        dynamic = (
            np.diag(self.squares) - omega**2 * np.eye(self.squares.size) + 1j * omega * self.damping
        )
        drive = np.broadcast_to(
            self.participation_of_shafts, (len(frequency), *self.participation_of_shafts.shape)
        )
        x = -self.shapes @ np.linalg.solve(dynamic, drive) - free / omega**2
        return np.asarray(rows.position @ x - omega**2 * (rows.acceleration @ x) + rows.direct)


@lru_cache(maxsize=8)  # as often as a motion is compared with another
def shaft_load(
    array: Array, spacecraft: Spacecraft | None, output_inertia: float, rotor_inertia: float
) -> Load:
    """Structure on the two shafts: an array on a fixed base, or with the craft that carries the
    drive.
    """
    craft = craft_of(array, spacecraft, output_inertia, rotor_inertia)
    if craft is not None:
        return craft.load
    return Load(
        H=array.H,
        R=np.zeros(len(array.modes)),
        V_l=np.zeros(len(array.modes)),
        V_m=np.zeros(len(array.modes)),
        D=array.D,
        Omega=np.array([2.0 * math.pi * mode.frequency for mode in array.modes]),
        Lambda=array.Lambda,
        output=output_inertia + array.inertia,
        rotor=rotor_inertia,
        cross=0.0,
        output_left=output_inertia + array.J_h,
        array_left=array.J_h,
    )


@lru_cache(maxsize=8)  # an eigenproblem, asked for at every turn
def craft_of(
    array: Array, spacecraft: Spacecraft | None, output_inertia: float, rotor_inertia: float
) -> Craft | None:
    """The craft of an array on a hub, None on a fixed base; inertias J_flex and J_m [kg m^2] as in a
    ``Scenario``.
    """
    if spacecraft is None:
        return None
    return _assemble_craft(array, spacecraft, output_inertia, rotor_inertia)


@dataclass(frozen=True)
class LockedStructure:
    """Hub, second wing and array with both hinges locked: coordinates q, those of the second wing, eta."""

    M: np.ndarray
    """Mass, (n, n)."""
    K: np.ndarray
    """Stiffness, (n, n)."""
    C: np.ndarray
    """Damping, (n, n)."""
    free: int
    """How many of the first coordinates have neither stiffness nor damping."""
    in_output: np.ndarray
    """Inertia force on them by a unit acceleration of the output, (n,)."""
    in_rotor: np.ndarray
    """By one of the rotor, (n,)."""
    output: float
    """Inertia of the output about the drive axis with all of them held [kg m^2]."""
    array_mass: np.ndarray
    """As in ``Craft``, (6, 6)."""
    participation: np.ndarray
    """As in ``Craft``, (6, s)."""
    second: HeldWing | None


def locked_structure(
    array: Array, spacecraft: Spacecraft, output_inertia: float, rotor_inertia: float
) -> LockedStructure:
    """The structure of an array on a spacecraft; inertias J_flex and J_m [kg m^2] as in a ``Scenario``."""
    a = _unit_rotation(spacecraft.interface.axis)
    M, P = array_on_hub(array, spacecraft.interface, spacecraft.array_angle)
    M = M + output_inertia * np.outer(a, a)
    hub_mass, hub_stiffness, hub_damping, free = hub_matrices(spacecraft)
    root, second = _motion_of_point(spacecraft, INTERFACE), second_wing(spacecraft)
    if second is not None:
        there = _motion_of_point(spacecraft, SECOND_INTERFACE)
        carried, stirred = there.T @ second.mass @ there, there.T @ second.G
        hub_mass = np.block([[hub_mass + carried, stirred], [stirred.T, second.M]])
        apart = np.zeros_like(stirred)
        hub_stiffness, hub_damping = (
            np.block([[X, apart], [apart.T, Y]])
            for X, Y in ((hub_stiffness, second.K), (hub_damping, second.C))
        )
        root = np.hstack([root, np.zeros((6, len(second.M)))])
    # Both hinges locked: hub and second wing (n), array (s).
    n, s = root.shape[1], P.shape[1]
    M_S = np.block(
        [
            [hub_mass + root.T @ (M + rotor_inertia * np.outer(a, a)) @ root, root.T @ P],
            [P.T @ root, np.eye(s)],
        ]
    )
    K = np.concatenate([np.zeros(n), array.Lambda])
    C = np.concatenate([np.zeros(n), array.D])
    K_S, C_S = np.diag(K), np.diag(C)
    K_S[:n, :n], C_S[:n, :n] = hub_stiffness, hub_damping
    in_output = np.concatenate([root.T @ (M @ a), P.T @ a])
    in_rotor = np.concatenate([rotor_inertia * (root.T @ a), np.zeros(s)])
    return LockedStructure(M_S, K_S, C_S, free, in_output, in_rotor, float(a @ M @ a), M, P, second)


def _assemble_craft(
    array: Array, spacecraft: Spacecraft, output_inertia: float, rotor_inertia: float
) -> Craft:
    locked = locked_structure(array, spacecraft, output_inertia, rotor_inertia)
    M_S, free, M, P = locked.M, locked.free, locked.array_mass, locked.participation
    in_output, in_rotor, n = locked.in_output, locked.in_rotor, locked.M.shape[0]
    shapes, squares = _modes(M_S, locked.K, free)
    damping, in_shafts = (
        shapes.T @ locked.C @ shapes,
        shapes.T @ np.column_stack([in_output, in_rotor]),
    )
    # Modes that damping couples, as uncoupled ones that also feel the shafts' rates; what that adds
    # is inertia of the shafts.
    y = decouple_modes(damping, squares, in_shafts)
    viscous, (H, R, V_l, V_m) = (y.g.T / y.k) @ y.g, np.vstack([y.a.T, y.g.T]).copy()
    # Free motions keep their momentum, M_ff x_f + (in_output theta_l + in_rotor theta_m)_f = 0.
    by_output, by_rotor = np.zeros(n), np.zeros(n)
    by_output[:free] = -np.linalg.solve(M_S[:free, :free], in_output[:free])
    by_rotor[:free] = -np.linalg.solve(M_S[:free, :free], in_rotor[:free])
    # What is left of the output's inertia once all modes are taken out: what turns with it at the
    # highest frequencies.
    whole = np.linalg.solve(M_S, np.column_stack([in_output, in_rotor]))
    J = locked.output
    left = J - float(in_output @ whole[:, 0])
    load = Load(
        H=H,
        R=R,
        V_l=V_l,
        V_m=V_m,
        D=y.d,
        Omega=np.sqrt(y.k),
        Lambda=y.k,
        output=J + float(in_output @ by_output) + float(viscous[0, 0]),
        rotor=rotor_inertia + float(in_rotor @ by_rotor) + float(viscous[1, 1]),
        cross=float(in_rotor @ by_output) + float(viscous[0, 1]),
        output_left=left,
        array_left=left - output_inertia,
    )
    return Craft(
        spacecraft,
        load,
        shapes,
        squares,
        damping,
        in_shafts,
        y,
        by_output,
        by_rotor,
        M,
        P,
        rotor_inertia,
        locked.second,
    )


def second_wing(spacecraft: Spacecraft) -> HeldWing | None:
    """The second wing as its drive holds it; None where there is none. The spacecraft has all its
    groups (``Scenario.mounted``).
    """
    wing = spacecraft.second_wing
    if wing is None:
        return None
    assert wing.motor is not None
    assert wing.driver is not None
    assert wing.reducer is not None
    assert wing.friction is not None
    assert wing.array is not None
    assert wing.array_angle is not None
    motor = motor_of_mean_spring(wing.driver, wing.motor)
    held = held_wing(
        motor, wing.reducer, wing.friction, wing.array, wing.interface, wing.array_angle
    )
    if wing.drive == "locked":
        return locked_wing(held, wing.array, wing.interface, wing.array_angle)
    return held


def held_wing(
    motor: Motor,
    reducer: Reducer,
    friction: Friction,
    array: Array,
    interface: Interface,
    angle: float,
) -> HeldWing:
    """A wing at an ``angle`` [rad] of its array on its ``interface``, its shaft held by the
    linearised drive.
    """
    a, J_m = _unit_rotation(interface.axis), motor.rotor_inertia + reducer.input_inertia
    M, P = array_on_hub(array, interface, angle)
    M = M + reducer.output_inertia * np.outer(a, a)
    on_ground = shaft_load(array, None, reducer.output_inertia, J_m)
    G = np.column_stack([J_m * a, M @ a, P]) @ coordinates(reducer, P.shape[1])
    M_x, C_x, K_x = drive_matrices(motor, reducer, friction, on_ground)
    return HeldWing(M + J_m * np.outer(a, a), G, M_x, C_x, K_x)


def locked_wing(held: HeldWing, array: Array, interface: Interface, angle: float) -> HeldWing:
    """A wing as ``held`` by its drive whose shaft does not turn: its array's modes alone."""
    _, P = array_on_hub(array, interface, angle)
    return HeldWing(held.mass, P, np.eye(P.shape[1]), np.diag(array.D), np.diag(array.Lambda))


def array_on_hub(array: Array, interface: Interface, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix (6, 6) and participation (6, s) of an array about its interface point, at its
    angle, hub axes.
    """
    mass, participation = array.mass, array.interface
    if mass is None or participation is None:
        raise ValueError("the array has no six components")
    turn = block_rotation(interface.turn(array.drive_axis, angle))
    return turn @ mass @ turn.T, turn @ participation


def hub_matrices(spacecraft: Spacecraft) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Mass, stiffness and damping of the hub's coordinates, (n, n), and how many of the first are
    free.
    """
    hub, control = spacecraft.hub, spacecraft.attitude_control
    n = 6 + len(hub.modes)
    M, K, C = np.eye(n), np.zeros((n, n)), np.zeros((n, n))
    inertia = tensor(hub.inertia)
    M[:3, :3], M[3:6, 3:6] = hub.mass * np.eye(3), inertia
    for k, mode in enumerate(hub.modes, 6):
        Omega = 2.0 * math.pi * mode.frequency
        K[k, k] = Omega**2
    C[6:, 6:] = hub.damping
    if control is None:
        return M, K, C, 6
    omega = 2.0 * math.pi * control.bandwidth
    K[3:6, 3:6], C[3:6, 3:6] = omega**2 * inertia, 2.0 * control.damping * omega * inertia
    return M, K, C, 3


def _motion_of_point(spacecraft: Spacecraft, point: str) -> np.ndarray:
    """Displacement and rotation of a named point by the hub's coordinates, (6, n)."""
    hub = spacecraft.hub
    names = [p.name for p in hub.points]
    interfaces = {INTERFACE: spacecraft.interface}
    if spacecraft.second_wing is not None:
        interfaces[SECOND_INTERFACE] = spacecraft.second_wing.interface
    if point in interfaces:
        index = spacecraft.point_at(interfaces[point])
    else:
        index = None
    if point in names:
        index = names.index(point)
    if point in interfaces:
        position = interfaces[point].position
    else:
        position = (0.0, 0.0, 0.0)
    if index is not None:
        position = hub.points[index].position
    elif point not in (CENTER, *interfaces):
        raise KeyError(point)
    flexible = np.array(
        [mode.shapes[index] if index is not None else np.zeros(6) for mode in hub.modes]
    )
    return np.hstack([rigid_motion_at(np.array(position)), flexible.reshape(len(hub.modes), 6).T])


def _modes(M: np.ndarray, K: np.ndarray, free: int) -> tuple[np.ndarray, np.ndarray]:
    """Shapes (n, s), mass-normalised, and squares of frequencies (s,) ascending of all but the
    first ``free`` coordinates.

    Those have no stiffness; they are taken out by their momentum, so that no rounding gives them a
    frequency.
    """
    held = np.linalg.solve(M[:free, :free], M[:free, free:])
    reduced = M[free:, free:] - M[free:, :free] @ held
    lower = np.linalg.cholesky(0.5 * (reduced + reduced.T))
    inner = np.linalg.solve(lower, np.linalg.solve(lower, K[free:, free:]).T)
    squares, vectors = np.linalg.eigh(0.5 * (inner + inner.T))
    elastic = np.linalg.solve(lower.T, vectors)
    return np.vstack([-held @ elastic, elastic]), squares


def _unit_rotation(axis: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros(3), axis])
