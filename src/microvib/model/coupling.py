"""The blocked-load method to a craft: blocked loads of drive and array, apparent masses of both sides,
coupled at the interface point.

In the frequency domain, about the interface point and in hub axes, with F_b the loads of the source
on a fixed base (``lines`` of a run without ``spacecraft``, a force table, or in closed
form):

    AM_src a = F_b - F,   F = AM_hub a   =>   a = (AM_hub + AM_src)^-1 F_b

F is the load on the hub. AM_src = D_0 + sum p'p (w_k^2 + 2j z w_k w) / (w_k^2 - w^2 + 2j z w_k w)
where all hinges are locked; with the drive in it the modes are those of ``model.linear``:
electromagnetic and gear springs in series on the drive axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.craft import Craft, HeldWing, held_wing, hub_matrices, locked_wing
from microvib.model.drive_matrices import coordinates
from microvib.model.driven import noise_bands
from microvib.model.driven import noise_density as density_of_friction
from microvib.model.driver import motor_of_mean_spring
from microvib.model.linear import coupled_modes, staircase_torque
from microvib.model.rigid import block_rotation, rigid_motion_at
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import INTERFACE, SECOND_INTERFACE
from microvib.units import Si

MIN_FREQUENCY_WITHOUT_CONTROL = 0.05
"""Frequency [Hz] below which the lines of a hub without attitude control mean nothing, and are left
out.
"""
_ROUNDING = 1e-9
"""Part by which a frequency may be a rounding off another."""
_RESONANCE_OFFSETS = np.linspace(-30.0, 30.0, 241)
"""Frequencies about a resonance, in parts of its damping."""
SEMIDEFINITE = 1e-6
"""Part of a source's own mass by which what its modes leave of it may be negative, for rounding."""


@dataclass(frozen=True)
class Source(HeldWing):
    """Structure at the interface: a mass matrix, and coordinates that its acceleration excites."""

    def __post_init__(self) -> None:
        """MicrovibError where D_0, what the coordinates leave of the mass, is not positive
        semi-definite.
        """
        scale = np.sqrt(np.maximum(np.diag(self.mass), 1e-300))
        least = float(np.linalg.eigvalsh(self.residual / np.outer(scale, scale)).min())
        if least < -SEMIDEFINITE:
            raise MicrovibError(
                f"D_0: the residual mass of the source has the eigenvalue {least:.3g} of its"
                " diagonal, and must have none"
                " below 0; mass, participation and reference point are inconsistent"
            )

    @property
    def residual(self) -> np.ndarray:
        """D_0 = mass - G M^-1 G', what moves with the interface at the highest frequencies, (6, 6)."""
        if self.M.size:
            return np.asarray(self.mass - self.G @ np.linalg.solve(self.M, self.G.T))
        return self.mass

    def _moved(self, frequency: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Accelerations of the coordinates, (m, n, k), by loads on them, (m or 1, n, k), at each
        frequency (m,) [Hz].
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[:, None, None]
        dynamic = self.K - omega**2 * self.M + 1j * omega * self.C
        shape = (omega.shape[0], *loads.shape[1:])
        return np.asarray(-(omega**2) * np.linalg.solve(dynamic, np.broadcast_to(loads, shape)))

    def apparent_mass(self, frequency: np.ndarray) -> np.ndarray:
        """Load that moves the interface by its acceleration at each frequency (m,) [Hz], (m, 6, 6)."""
        return np.asarray(self.mass - self.G @ self._moved(frequency, self.G.T[None]))

    def coordinates_by_acceleration(
        self, frequency: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Coordinates, (m, n), by complex accelerations of the interface, (m, 6), at each frequency
        (m,) [Hz].
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[:, None]
        return self._moved(frequency, -(self.G.T @ acceleration[:, :, None]))[:, :, 0] / -(omega**2)

    def blocked(
        self, frequency: np.ndarray, torque: np.ndarray, by: np.ndarray | None = None
    ) -> np.ndarray:
        """Loads on a fixed base, (m, 6), of complex torques (m,) [N m].

        They act on the rotor, the first coordinate, or on what turns by ``by`` (n,) with the
        coordinates.
        """
        if by is None:
            way = np.eye(self.M.shape[0])[0]
        else:
            way = by
        on = np.asarray(torque, dtype=complex)[:, None, None] * way[:, None]
        return np.asarray(-(self.G @ self._moved(frequency, on))[:, :, 0])

    def turned(self, turn: np.ndarray) -> Source:
        """Source in other axes, by the congruence of ``turn`` (3, 3), whose columns are its axes
        there.
        """
        T = block_rotation(turn)
        return Source(T @ self.mass @ T.T, T @ self.G, self.M, self.C, self.K)

    def about(self, position: np.ndarray) -> Source:
        """Source about another point, from which the interface lies at ``position`` (3,) [m]: u =
        T u_there, T' mass T.
        """
        T = rigid_motion_at(np.asarray(position, dtype=float))
        return Source(T.T @ self.mass @ T, T.T @ self.G, self.M, self.C, self.K)


def source_of(scenario: Scenario, *, powered: bool = True) -> Source:
    """Drive and array of a scenario with a ``spacecraft``, linearised as in ``model.linear``; not
    ``powered``: locked hinges.

    MicrovibError for a powered drive without a current loop, whose windings are no springs and
    dampers.
    """
    if powered and scenario.driver.drive != "current":
        raise MicrovibError(
            f"driver.drive: closed-form coupling does not support {scenario.driver.drive} drive; run a time"
            " simulation of the spacecraft instead"
        )
    spacecraft, s = require_craft(scenario).spacecraft, scenario
    motor = motor_of_mean_spring(s.driver, s.motor)
    found = held_wing(
        motor, s.reducer, s.friction, s.array, spacecraft.interface, spacecraft.array_angle
    )
    if powered:
        return Source(found.mass, found.G, found.M, found.C, found.K)
    found = locked_wing(found, s.array, spacecraft.interface, spacecraft.array_angle)
    return Source(found.mass, found.G, found.M, found.C, found.K)


@dataclass(frozen=True)
class Receiver:
    """The hub, and what is looked at: coordinates q with M (q'' + damping q' + squares q) = root' F
    + second_root' F_2.
    """

    root: np.ndarray
    """Motion of the interface point by the coordinates, (6, n)."""
    M: np.ndarray
    """(n, n)."""
    squares: np.ndarray
    """[rad^2/s^2], (n,): zero for free motions, those of the attitude control and of the hub's
    modes.
    """
    damping: np.ndarray
    """[1/s], (n,)."""
    los: np.ndarray | None
    """Both angles of the line of sight by the coordinates, (2, n)."""
    lowest: float
    """Frequency [Hz] below which its motion means nothing."""
    coupled: np.ndarray | None = None
    """Damping that couples the coordinates besides, (n, n); None where there is none."""
    second: Source | None = None
    """The second wing, which puts F_2 on the hub."""
    second_root: np.ndarray | None = None
    """Motion of its interface point by the coordinates, (6, n)."""

    def too_slow(self, frequency: np.ndarray) -> np.ndarray:
        """Frequencies (...) [Hz] of which the motion means nothing; the lowest itself, but for a
        rounding, is none.
        """
        return np.asarray(np.asarray(frequency) < self.lowest * (1.0 - _ROUNDING))

    def moved(self, frequency: np.ndarray, place: np.ndarray | None = None) -> np.ndarray:
        """Coordinates by loads at the interface at each frequency (m,) [Hz], (m, n, 6).

        ``place`` is another place where they act: its motion by the coordinates, (6, n).
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[:, None]
        on = (self.root if place is None else place).T
        dynamic = self.squares - omega**2 + 1j * omega * self.damping
        if self.second is None and self.coupled is None:
            return np.asarray(np.linalg.solve(self.M, on) / dynamic[:, :, None])
        whole = self.M * dynamic[:, None, :]
        if self.coupled is not None:
            whole = whole + 1j * omega[:, :, None] * self.coupled
        if self.second is not None and self.second_root is not None:
            carried = self.second_root.T @ self.second.apparent_mass(frequency) @ self.second_root
            whole = whole - omega[:, :, None] ** 2 * carried
        return np.asarray(np.linalg.solve(whole, on))

    def accelerance(self, frequency: np.ndarray) -> np.ndarray:
        """Acceleration of the interface point by loads there, (m, 6, 6); its inverse is the
        apparent mass.
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[:, None, None]
        return np.asarray(-(omega**2) * (self.root @ self.moved(frequency)))

    def transfer(self, frequency: np.ndarray) -> np.ndarray | None:
        """Line of sight by loads at the interface, (m, 2, 6); nan where it means nothing, None
        where there is none.
        """
        if self.los is None:
            return None
        found = np.asarray(self.los @ self.moved(frequency))
        found[self.too_slow(frequency)] = np.nan
        return found


def receiver_of(scenario: Scenario) -> Receiver:
    """The hub of a scenario with a ``spacecraft``, with its second wing."""
    craft, other = require_craft(scenario), scenario.other_wing
    M, K, C, _ = hub_matrices(craft.spacecraft)
    n, control = M.shape[0], craft.spacecraft.attitude_control
    root = craft.at(INTERFACE)[:, :n]
    # Attitude control is in proportion to the hub's inertia and a mode has its own, so that K = M
    # squares, C = M damping + coupled.
    squares, damping = (np.diag(np.linalg.solve(M, X)) for X in (K, C))
    if craft.spacecraft.line_of_sight is None:
        los = None
    else:
        los = craft.line_of_sight().position[:, :n]
    if control is None:
        lowest = MIN_FREQUENCY_WITHOUT_CONTROL
    else:
        lowest = 0.0
    second: tuple[Source | None, np.ndarray | None] = (None, None)
    if other is not None:
        powered = not scenario.second_is_locked
        second = source_of(other, powered=powered), craft.at(SECOND_INTERFACE)[:, :n]
    coupled = np.zeros_like(C)
    coupled[6:, 6:] = C[6:, 6:] - np.diag(np.diag(C[6:, 6:]))
    return Receiver(
        root, M, squares, damping, los, lowest, coupled if np.any(coupled) else None, *second
    )


@dataclass(frozen=True)
class CoupledResponse:
    """Motion of the interface and loads on the hub at each frequency, (m,) [Hz]; complex amplitudes,
    0-to-peak, hub axes.
    """

    frequency: np.ndarray
    acceleration: np.ndarray
    """Acceleration of the interface point, (m, 6) [m/s^2, rad/s^2]."""
    loads: np.ndarray
    """On the hub at the interface point, (m, 6) [N, N m]."""
    los: np.ndarray | None
    """Both angles of the line of sight, (m, 2) [rad]; nan where they mean nothing."""


def couple_source_to_hub(
    frequency: np.ndarray, blocked: np.ndarray, source_mass: np.ndarray, hub: Receiver
) -> CoupledResponse:
    """Blocked loads (m, 6) of a source of apparent mass (m, 6, 6) on a hub, at each frequency (m,)
    [Hz].

    a = (AM_hub + AM_src)^-1 F_b = (1 + Y AM_src)^-1 Y F_b with the accelerance Y = AM_hub^-1;
    AM_hub a = F_b - AM_src a.
    """
    frequency = np.asarray(frequency, dtype=float)
    return _solve_coupled_response(
        frequency, blocked, source_mass, hub.accelerance(frequency), hub.transfer(frequency)
    )


def _solve_coupled_response(
    f: np.ndarray, blocked: np.ndarray, mass: np.ndarray, Y: np.ndarray, los: np.ndarray | None
) -> CoupledResponse:
    free = np.asarray(blocked)[:, :, None]
    a = np.linalg.solve(np.eye(6) + Y @ mass, Y @ free)
    loads = free - mass @ a
    return CoupledResponse(
        f, a[:, :, 0], loads[:, :, 0], None if los is None else (los @ loads)[:, :, 0]
    )


def line_of_sight_transfer(
    scenario: Scenario, frequency: np.ndarray, place: np.ndarray
) -> np.ndarray:
    """Line of sight by loads at a place of the hub with its drive and array on it, at each
    frequency (m,) [Hz], (m, 2, 6).

    ``place`` is its motion by the hub's coordinates, (6, n).
    """
    f, hub = np.asarray(frequency, dtype=float), receiver_of(scenario)
    omega, mass, free = (
        2.0 * np.pi * f[:, None, None],
        source_of(scenario).apparent_mass(f),
        hub.moved(f, place),
    )
    a = np.linalg.solve(np.eye(6) + hub.accelerance(f) @ mass, -(omega**2) * (hub.root @ free))
    seen = hub.transfer(f)
    assert seen is not None
    found = np.asarray(hub.los @ free - seen @ (mass @ a))
    found[hub.too_slow(f)] = np.nan
    return found


def blocked_load_method(
    scenario: Scenario, frequency: np.ndarray, blocked: np.ndarray
) -> CoupledResponse:
    """Blocked loads (m, 6) on the hub of a scenario, in hub axes about the interface point, with
    its own drive and array.
    """
    frequency = np.asarray(frequency, dtype=float)
    return couple_source_to_hub(
        frequency, blocked, source_of(scenario).apparent_mass(frequency), receiver_of(scenario)
    )


def line_of_sight_noise_density(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """One-sided densities of both angles of the line of sight (m, 2) [rad^2/Hz] by the noise of the
    output's friction.

    Torque noise and roughness, through the linearised drive, as if the shaft always slid: where it
    sticks, friction takes it up.
    """
    f = np.asarray(frequency, dtype=float)
    if not noise_bands(scenario):
        return np.zeros((f.size, 2))
    source = source_of(scenario)
    output = coordinates(scenario.reducer, len(scenario.array.modes))[1]
    los = blocked_load_method(scenario, f, source.blocked(f, np.ones(f.size), output)).los
    if los is None:
        raise MicrovibError("spacecraft.line_of_sight: missing; it is required for its density")
    return np.asarray(np.nan_to_num(np.abs(los)) ** 2 * density_of_friction(scenario, f)[:, None])


def line_of_sight_noise_spectrum(scenario: Scenario) -> tuple[np.ndarray, np.ndarray] | None:
    """``line_of_sight_noise_density`` (n, 2) at frequencies (n,) [Hz] that resolve its resonances;
    None without noise.
    """
    bands = noise_bands(scenario).values()
    if not bands:
        return None
    low = max(min(low for low, _ in bands), receiver_of(scenario).lowest, 1e-3)
    high = max(low, *(high for _, high in bands))
    ends = [
        beside
        for band in bands
        for end in band
        for beside in (end, np.nextafter(end, 0.0), np.nextafter(end, np.inf))
    ]
    near = np.concatenate([resonance_frequency_grid(scenario), ends])
    grid = np.unique(
        np.concatenate([[low], np.geomspace(low, high, 4000), near[(near > low) & (near < high)]])
    )
    return grid, line_of_sight_noise_density(scenario, grid)


def resonance_frequency_grid(
    scenario: Scenario, parts: np.ndarray = _RESONANCE_OFFSETS
) -> np.ndarray:
    """Frequencies [Hz] about each natural mode, at ``parts`` of its damping from it, that resolve
    its resonance.
    """
    modes = coupled_modes(scenario)
    return np.concatenate(
        [m.frequency * (1.0 + max(m.damping, 1e-5) * parts) for m in modes] or [np.zeros(0)]
    )


@dataclass(frozen=True)
class DrivingLineMap:
    """Driving lines of the linearised drive on a craft, by angle, rate and order, (angles, rates,
    orders, ...).
    """

    angles: np.ndarray
    """[rad]."""
    rates: np.ndarray
    """[rad/s]."""
    frequency: np.ndarray
    """[Hz], (rates, orders)."""
    loads: np.ndarray
    los: np.ndarray | None


def driving_line_map(
    scenario: Scenario, rates: np.ndarray, angles: np.ndarray | None = None, harmonics: int = 8
) -> DrivingLineMap:
    """Loads and line of sight over rates (r,) [rad/s] and angles (p,) [rad] of the array, in closed
    form.

    Without ``angles`` at the scenario's own. Masses are computed once and turned to each angle by
    congruence. MicrovibError where the rate is zero or changes.
    """
    f_d, spacecraft = scenario.driving_frequency, require_craft(scenario).spacecraft
    if not f_d or not scenario.rate:
        raise MicrovibError(
            "tracking: a line map over rates starts from a constant rate; one greater than 0 deg/s is expected"
        )
    if angles is None:
        psi = np.array([spacecraft.array_angle])
    else:
        psi = np.asarray(angles, dtype=float)
    order, rates = np.arange(1, harmonics + 1), np.asarray(rates, dtype=float)
    frequency = np.abs(rates[:, None] / scenario.rate) * f_d * order
    f, torque = frequency.ravel(), np.tile(staircase_torque(scenario, order), rates.size)
    source, hub = source_of(scenario), receiver_of(scenario)
    mass, loads = source.apparent_mass(f), source.blocked(f, torque)
    Y, seen = hub.accelerance(f), hub.transfer(f)
    found = []
    for angle in psi:
        if hub.second is not None:  # which may turn, too
            there = receiver_of(scenario.at_angle(Si(angle)))
            Y, seen = there.accelerance(f), there.transfer(f)
        turn = block_rotation(
            rotation_about_axis(spacecraft.interface.axis, float(angle) - spacecraft.array_angle)
        )
        found.append(_solve_coupled_response(f, loads @ turn.T, turn @ mass @ turn.T, Y, seen))
    shape = (psi.size, *frequency.shape)
    if hub.los is None:
        los = None
    else:
        los = np.array([one.los for one in found]).reshape(*shape, 2)
    return DrivingLineMap(
        psi, rates, frequency, np.array([one.loads for one in found]).reshape(*shape, 6), los
    )


def rotation_about_axis(axis: np.ndarray, angle: float) -> np.ndarray:
    """Turn about a unit vector ``axis`` (3,) by an ``angle`` [rad], (3, 3)."""
    along, across = np.outer(axis, axis), np.cross(np.eye(3), axis)
    return np.asarray(along + math.cos(angle) * (np.eye(3) - along) + math.sin(angle) * across)


def rotation_to_hub_axes(scenario: Scenario) -> np.ndarray:
    """Turn of loads from the axes of a scenario's array into those of the hub that carries it, (6,
    6).
    """
    spacecraft = require_craft(scenario).spacecraft
    return block_rotation(
        spacecraft.interface.turn(scenario.array.drive_axis, spacecraft.array_angle)
    )


def require_craft(scenario: Scenario) -> Craft:
    """The craft of a scenario; MicrovibError where it stands on a fixed base."""
    if scenario.craft is None:
        raise MicrovibError(
            "spacecraft: missing; a scenario on a spacecraft is expected, as examples/spacecraft.yaml"
        )
    return scenario.craft
