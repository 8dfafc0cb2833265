"""Lines beside those of other sources, which drives that turn make of them.

The spring of a motor that turns changes over its electrical turn: by errors of the currents, by flux
harmonics and by detent torque. The linearised drive, whose rotor moves by theta_m relative to the hub,
then has periodic coefficients. With K(t) = K_0 + sum of K_m exp(j m omega_e t), over all orders m of
either sign, a load at f moves the rotor at f + k f_e by u_k,

    u_k + Y(f + k f_e) sum_m K'_m u_(k-m) = u where k = 0, else 0,

where Y is the motion of the rotor of the linearised drive by a torque on it, u its motion by the load,
and K' the spring less that of the linearised drive. It is solved for the orders that count
(harmonic balance, Hill's determinant); the line of sight at f + k f_e is that by the torque
-sum_m K'_m u_(k-m) on the rotor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microvib.model.drive_states import DriveStates
from microvib.model.driver import motor_of_mean_spring
from microvib.model.linear import frequency_blocks
from microvib.model.scenario import Scenario
from microvib.model.turning import SpringOverTurn, spring_over_turn

_LEAST_PART = 1e-5
"""Part of the mean spring below which what varies is left out."""
_RISE = 3.0
"""By how much a resonance is taken to raise motion, for which orders count."""
_LEAST_WEIGHT = 1e-4
"""Part of the rotor's linear motion below which an order is left out."""
_MOST_ORDERS = 49
"""Orders that are solved together, at most."""
_MARGIN, _MARGIN_OF_VARIATION = 1.03, 0.2
"""By how much lines may be larger than the linearised drive makes them, and by how much more for a
spring that varies by all of itself; assumed: the current loop is left out, and the rotor's own motion
by what varies is that of a constant spring."""
_LARGEST_LOOP = 0.02
"""Torque of back-EMF at f_e over that of the spring above which side lines have no bound: with a slow
current loop lines in time were up to 1.8 times as large as by harmonic balance."""
_LARGEST_MOTION = 0.35
"""Electrical angle [rad] by which what varies moves the rotor, above which side lines have no bound:
full steps, half steps, and steps on a resonance of the rotor. There lines in time were up to five
times as large as by harmonic balance."""
_LEAST_PULL = 0.05
"""Part of the largest torque that any side line is given besides: small ones are known less well
(``benchmarks/side_lines.py``)."""
_ROUNDING = 1e-12
_SLOWEST = 1e-3
"""Frequency [Hz] in place of one that is zero."""


@dataclass(frozen=True)
class SideResponse:
    """Response at other frequencies to loads at frequencies (m,)."""

    orders: np.ndarray
    """Electrical turns k by which frequencies are moved, (k,); 0 is what comes beside the linear response."""
    frequency: np.ndarray
    """Frequencies |f + k f_e| [Hz], (k, m)."""
    los: np.ndarray
    """Largest line of sight [rad] by 1 rad of the rotor's linear motion at f, (k, m, 2); infinite
    where nothing bounds it."""
    electrical: float
    """Electrical turns per second f_e [Hz]."""


@dataclass(frozen=True)
class VaryingDrive:
    """A drive that turns, by its number on the craft, and the spring of its motor."""

    craft: DriveStates
    """The craft, with the springs that are not known besides."""
    wing: int
    """0 the first drive, 1 that of the second wing."""
    spring: SpringOverTurn
    linear: float
    """Stiffness of the linearised drive [N m/rad]."""
    loop: float = 0.0
    """Torque that back-EMF makes at f_e of the rotor's motion, over that of the spring."""
    with_margins: bool = True
    """Whether lines are as large as they may be, or as harmonic balance has them."""

    @cached_property
    def _varying(self) -> dict[int, complex]:
        """Stiffness K'_m by order of either sign [N m/rad]."""
        found: dict[int, complex] = {0: complex(self.spring.mean - self.linear)}
        size = np.abs(self.spring.amplitude)
        for k in np.flatnonzero(size > _LEAST_PART * self.linear).tolist():
            order, amplitude = int(self.spring.orders[k]), complex(self.spring.amplitude[k])
            found[order], found[-order] = amplitude, amplitude.conjugate()
        return found

    @property
    def varies(self) -> bool:
        """Whether the spring changes by more than is left out."""
        return len(self._varying) > 1

    @cached_property
    def margin(self) -> float:
        """Factor on lines; infinite where the spring may be without stiffness at some angle, or is
        not known because the rotor moves far by its steps or the current loop is slow.
        """
        if self.spring.motion > _LARGEST_MOTION or self.loop > _LARGEST_LOOP:
            return math.inf
        part = math.fsum(abs(K) for m, K in self._varying.items() if m) / self.linear
        return _MARGIN + _MARGIN_OF_VARIATION * part if part < 1.0 else math.inf

    @cached_property
    def orders(self) -> np.ndarray:
        """Orders k of f + k f_e that count, ascending, (k,)."""
        parts = {m: abs(K) / self.linear for m, K in self._varying.items() if m}
        weights, new = {0: 1.0}, {0: 1.0}
        while new:
            reached: dict[int, float] = {}
            for k, weight in new.items():
                for m, part in parts.items():
                    reached[k + m] = max(reached.get(k + m, 0.0), weight * min(_RISE * part, 0.9))
            new = {
                k: weight
                for k, weight in reached.items()
                if weight > _LEAST_WEIGHT and weight > weights.get(k, 0.0)
            }
            weights.update(new)
            largest = sorted(weights, key=lambda k: -weights[k])[:_MOST_ORDERS]
            new = {k: weight for k, weight in new.items() if k in largest}
        return np.array(sorted(sorted(weights, key=lambda k: -weights[k])[:_MOST_ORDERS]))

    def rotor_motion(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Largest motion of the rotor [rad] by ``forces`` on the coordinates (n, c), or at each
        frequency (m, n, c), of the linearised drives, in any state, (m, c).
        """
        row = self._rotor[None, :]
        return self.craft.extremes(frequency, forces, rows=row)[1][:, 0]

    @cached_property
    def _rotor(self) -> np.ndarray:
        return self.craft.on_rotor_of(self.wing)[:, 0]

    def response(self, frequency: np.ndarray) -> SideResponse:
        """Response to loads at frequencies (m,) [Hz], by the linear motion of the rotor."""
        each = [self._part(frequency[x]) for x in frequency_blocks(frequency.size, 256)]
        moved = self.orders[:, None] * self.spring.frequency + frequency
        none = np.zeros((self.orders.size, 0, 2))
        los = np.concatenate([none, *each], axis=1)
        return SideResponse(self.orders, np.abs(moved), los, self.spring.frequency)

    def _part(self, frequency: np.ndarray) -> np.ndarray:
        k, m = self.orders.size, frequency.size
        if self.with_margins and math.isinf(self.margin):
            return np.full((k, m, 2), math.inf)
        at = (self.orders[:, None] * self.spring.frequency + frequency).ravel()
        size = np.maximum(np.abs(at), _SLOWEST)
        torque = self._rotor[:, None]
        if self.craft.springs:
            los = self.craft.extremes(size, torque)[1][:, :, 0].reshape(k, m, 2)
            moved = self.rotor_motion(size, torque)[:, 0].reshape(k, m)
            return los * self._pull_at_most(moved)[:, :, None] * self.margin
        rows = np.vstack([self.craft.line_of_sight, self._rotor])
        by = self.craft.response(size, torque, rows)[:, :, 0].reshape(k, m, 3)
        by = np.where((at < 0.0).reshape(k, m, 1), by.conj(), by)
        pull = np.abs(self._pull(by[:, :, 2]))
        if not self.with_margins:
            return np.abs(by[:, :, :2]) * pull[:, :, None]
        least = np.where(self.orders == 0, 0.0, _LEAST_PULL)[:, None] * pull.max(axis=0)
        return np.abs(by[:, :, :2]) * (pull * self.margin + least)[:, :, None]

    @cached_property
    def _between(self) -> np.ndarray:
        """K'_(k-j) from order j to order k, (k, k)."""
        found = [[self._varying.get(int(k - j), 0.0) for j in self.orders] for k in self.orders]
        return np.array(found, dtype=complex)

    def _pull(self, Y: np.ndarray) -> np.ndarray:
        """Torques on the rotor (k, m) [N m] at f + k f_e by a linear motion of 1 rad at f, with the
        rotor's motion by torque Y (k, m).
        """
        unit = (self.orders == 0).astype(complex)
        whole = np.eye(unit.size) + Y.T[:, :, None] * self._between
        u = np.linalg.solve(whole, np.tile(unit[:, None], (Y.shape[1], 1, 1)))[:, :, 0]
        return np.asarray(self._between @ u.T)

    def _pull_at_most(self, Y: np.ndarray) -> np.ndarray:
        """Bound on these where Y (k, m) is known at most: repeated mixing, each time with the worst
        phases; infinite where the series does not converge.
        """
        K = np.abs(self._between)
        unit = (self.orders == 0).astype(float)
        known = np.where(np.isfinite(Y), Y, 0.0)
        left = np.eye(unit.size) - known.T[:, :, None] * K
        u = np.linalg.solve(left, np.tile(unit[:, None], (Y.shape[1], 1, 1)))[:, :, 0].T
        # of matrices without negative elements the series converges where no sum of it is negative
        bounded = np.all(u >= -_ROUNDING, axis=0) & np.all(np.isfinite(Y), axis=0)
        pull = K @ np.where(bounded, np.maximum(u, 0.0), 0.0)
        return np.where(bounded, pull, math.inf)


def varying_drives(
    scenario: Scenario, craft: DriveStates, second: Scenario | None = None
) -> list[VaryingDrive]:
    """Drives of a craft that turn and whose springs vary.

    Parameters
    ----------
    scenario : Scenario
        The first drive on its craft; the second wing's counts where it steps.
    craft : DriveStates
        The same craft, with what is not known of its springs besides.
    second : Scenario, optional
        How the drive of the second wing steps, whatever the scenario says.
    """
    found = []
    for wing, drive in enumerate([scenario, second or scenario.driven_wing]):
        spring = None if drive is None else spring_over_turn(drive)
        if drive is None or spring is None:
            continue
        linear = motor_of_mean_spring(drive.driver, drive.motor).electromagnetic_stiffness
        motor = drive.motor
        resistance = motor.winding_resistance + drive.driver.proportional_gain
        emf = motor.axis_torque_constant**2 / resistance * 2.0 * math.pi * spring.frequency
        one = VaryingDrive(craft, wing, spring, linear, emf / linear)
        if one.varies:
            found.append(one)
    return found


def unknown_drives(scenario: Scenario) -> Sequence[str]:
    """Why it is not known how springs of drives that turn vary, a sentence each."""
    names = {0: "the drive", 1: "the second wing's drive"}
    found = []
    for wing, drive in enumerate([scenario, scenario.driven_wing]):
        if drive is None or drive.rate == 0.0 or spring_over_turn(drive) is not None:
            continue
        what = "changes its rate" if drive.rate is None else "cannot carry its friction"
        found.append(f"{names[wing]} {what}, and what its spring makes of lines is not known")
    return found
