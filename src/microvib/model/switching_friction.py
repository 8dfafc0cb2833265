"""Bounds on what friction that sticks at times makes of loads on a craft, at any frequency.

While a shaft sticks, its friction takes up part of a load, and while it slides, none: a load then has
lines at its frequency plus and minus multiples of whatever makes the shaft stick, and multiples of its
own. Which, depends on the motion. How much all of them are together does not, as long as the torque of
friction never falls as its rate grows (Coulomb's, and elements that are springs up to their limits):
of two motions, with the load and without, tau is by how much the torques of friction differ and w by
how much the rates do, and the mean of tau w is not negative. With the velocity v that the load makes
without friction, and the mobility Y there, w = v - Y tau, so that with R = Re Y

    sum over all frequencies of tau' R tau <= (sum over the load's frequencies of v' R^-1 v) / 4

For several frictions tau, v are columns and Y, R matrices; springs that are not known belong to
them, since they take no energy either. The line of sight by tau is l tau, whose square is no more than l R^-1 l'
times tau' R tau. Beside that the torque of a friction is never outside its limits: tau is no more than
twice the largest torque.

The torque of a motor is a sine of its rotor's angle, and that of flux harmonics and detent torque a
sum of sines. Beside its spring, which is their slope, it has sin(s + d) - sin s - d cos s by a swing d
of the electrical angle, no more than d^2/2 + |d|^3/6.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microvib.model.drive_states import DriveStates
from microvib.model.driver import references_over_electrical_period
from microvib.model.scenario import Scenario
from microvib.model.turning import spring_over_turn

_MARGIN = 1.25
"""By how much motion may be larger than the linearised drives make it; assumed: the current loop is
left out, and springs of motors vary as they turn."""
_ROUNDING = 1e-13
_NEAR = np.sinh(np.linspace(-6.0, 6.0, 81))
"""Frequencies about a resonance, in half-widths."""
_LOWEST, _LEAST_HIGHEST, _BEYOND = 1e-3, 100.0, 5.0
"""Lowest frequency that is looked at [Hz], and the highest: times the highest natural frequency."""
_PER_DECADE = 120


@dataclass(frozen=True)
class SwitchingFriction:
    """Frictions of a craft's drives of which some stick and slide in turn."""

    craft: DriveStates

    @property
    def switches(self) -> bool:
        """Whether any friction sticks and slides in turn."""
        return any(spring.switches for spring in self.craft.springs)

    @cached_property
    def on(self) -> np.ndarray:
        """Elongations by the coordinates, (n, e), each once."""
        found: list[np.ndarray] = []
        for spring in self.craft.springs:
            if not any(np.array_equal(spring.on, one) for one in found):
                found.append(spring.on)
        return np.array(found).T

    @property
    def by_energy(self) -> float:
        """Factor on the bound by energy; infinite where none holds."""
        return max(spring.above_energy for spring in self.craft.springs)

    def norm_of_forces(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Root of v' R^-1 v [W^1/2] of amplitudes by ``forces`` on the coordinates (n, c), or at each
        frequency (m, n, c), at frequencies (m,) [Hz], (m, c).
        """
        if not frequency.size:
            return np.zeros((0, forces.shape[-1]))
        moved = self.craft.response(frequency, forces, self.on.T)
        return self.norm_of_motion(frequency, moved)

    def norm_of_motion(self, frequency: np.ndarray, elongation: np.ndarray) -> np.ndarray:
        """Norm of elongations (m, e, c) [rad] that loads make without friction, (m, c)."""
        omega = 2.0 * np.pi * frequency[:, None, None]
        own = 1j * omega * self.craft.response(frequency, self.on, self.on.T)
        parts = _whitened(own, 1j * omega * elongation)
        return np.asarray(np.linalg.norm(parts, axis=1))

    @cached_property
    def frequency(self) -> np.ndarray:
        """Frequencies [Hz] at which the response is looked at, ascending, (m,)."""
        return frequencies_of_response(self.craft.natural_frequencies)

    @cached_property
    def _by_energy(self) -> np.ndarray:
        """Largest amplitude of the line of sight at each frequency by a norm of 1, (m, 2)."""
        rows = np.vstack([self.craft.line_of_sight, self.on.T])
        moved = self.craft.response(self.frequency, self.on, rows)
        own = 2j * np.pi * self.frequency[:, None, None] * moved[:, 2:]
        parts = _whitened(own, moved[:, :2].conj().transpose(0, 2, 1))
        return np.asarray(0.5 * np.linalg.norm(parts, axis=1))

    @cached_property
    def _by_limits(self) -> np.ndarray:
        """Largest amplitude of the line of sight at each frequency whatever the load, (m, 2)."""
        each = [s for s in self.craft.springs if s.switches]
        on = np.array([s.on for s in each]).T
        twice = (
            2.0 * math.sqrt(2.0) * np.array([s.largest for s in each])
        )  # of an rms, as amplitude
        return np.asarray(self.craft.extremes(self.frequency, on)[1] @ twice)

    def los(self, norm: float) -> np.ndarray:
        """Amplitude (m, 2) [rad] that a line at each frequency has at most beside those of a load of a
        ``norm``, and above the root mean square of all such lines if all had the response at their worst
        frequency.

        Energy bounds lines where they are smaller by it, and limits bound others, both as if all were
        there: hence root 2.
        """
        if norm == 0.0:
            return np.zeros((self.frequency.size, 2))
        most = self._by_limits
        if math.isfinite(self.by_energy):
            most = np.minimum(most, self.by_energy * norm * self._by_energy)
        return _MARGIN * math.sqrt(2.0) * most


def _whitened(mobility: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """R^-1/2 v of vectors (m, e, c), with R the dissipative part of mobilities (m, e, e)."""
    R = 0.5 * (mobility + mobility.conj().transpose(0, 2, 1))
    values, directions = np.linalg.eigh(R)
    least = _ROUNDING * np.abs(mobility).max(axis=(1, 2))[:, None]
    scale = 1.0 / np.sqrt(np.maximum(values, least))
    return np.asarray(scale[:, :, None] * (directions.conj().transpose(0, 2, 1) @ vectors))


def frequencies_of_response(modes: np.ndarray) -> np.ndarray:
    """Frequencies [Hz] that resolve resonances by their natural frequencies and half-widths (k, 2)."""
    highest = max(_BEYOND * float(modes[:, 0].max(initial=0.0)), _LEAST_HIGHEST)
    even = np.geomspace(_LOWEST, highest, round(_PER_DECADE * math.log10(highest / _LOWEST)))
    near = modes[:, :1] + np.maximum(modes[:, 1:], 1e-5 * modes[:, :1]) * _NEAR
    grid = np.union1d(even, near)
    return grid[(grid >= _LOWEST) & (grid <= highest)]


@dataclass(frozen=True)
class MotorSine:
    """Torque of a motor whose rotor swings too far for a spring."""

    craft: DriveStates
    wing: int
    """0 the first drive, 1 that of the second wing."""
    teeth: int
    second: float
    third: float
    """Largest second and third derivatives of the torque over the electrical angle [N m]."""

    def motion(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Largest motion of the rotor [rad] by ``forces`` on the coordinates (n, c), or at each
        frequency (m, n, c), at frequencies (m,) [Hz], in any state, (m, c).
        """
        return np.asarray(self.craft.extremes(frequency, forces, rows=self.on[None, :])[1][:, 0])

    @property
    def on(self) -> np.ndarray:
        """Angle of the rotor by the coordinates, (n,)."""
        return self.craft.on_rotor_of(self.wing)[:, 0]

    @cached_property
    def frequency(self) -> np.ndarray:
        """Frequencies [Hz] at which the response is looked at, ascending, (m,)."""
        return frequencies_of_response(self.craft.natural_frequencies)

    @cached_property
    def _los(self) -> np.ndarray:
        """Largest line of sight at each frequency by 1 N m on the rotor, (m, 2)."""
        on = self.craft.on_rotor_of(self.wing)
        return np.asarray(self.craft.extremes(self.frequency, on)[1][:, :, 0])

    def los(self, swing: float, peak: float) -> np.ndarray:
        """Amplitude (m, 2) [rad] that a line at each frequency has at most by loads that swing the rotor
        by ``swing`` (root mean square) and ``peak`` [rad], and above the root mean square of all.
        """
        d, most = self.teeth * swing, self.teeth * peak
        torque = 0.5 * self.second * most * d + self.third * most**2 * d / 6.0
        return _MARGIN * math.sqrt(2.0) * torque * self._los


def motor_sines(
    scenario: Scenario, craft: DriveStates, second: Scenario | None = None
) -> list[MotorSine]:
    """Motors of a craft that turn at a constant rate, or hold; ``second`` is how the drive of the second
    wing steps, whatever the scenario says.
    """
    turn_or_hold = [*drives_that_turn(scenario, second), *drives_that_stand(scenario, second)]
    return [
        MotorSine(craft, wing, drive.motor.rotor_teeth, *_curvatures(drive))
        for wing, drive in sorted(turn_or_hold, key=lambda one: one[0])
    ]


def drives_that_turn(
    scenario: Scenario, second: Scenario | None = None
) -> Iterator[tuple[int, Scenario]]:
    """Drives of a craft at a constant rate with the number of their wings; ``second`` is how the drive of
    the second wing steps, whatever the scenario says.
    """
    for wing, drive in enumerate([scenario, second or scenario.driven_wing]):
        if drive is not None and drive.rate:
            yield wing, drive


def drives_that_stand(
    scenario: Scenario, second: Scenario | None = None
) -> Iterator[tuple[int, Scenario]]:
    """Drives of a craft that are parked or hold, with the number of their wings; arguments as for
    ``drives_that_turn``.
    """
    if scenario.rate == 0.0:
        yield 0, scenario
    driven, other = second or scenario.driven_wing, scenario.other_wing
    if scenario.second_is_locked or other is None:
        return
    if driven is None or driven.rate == 0.0:
        yield 1, other


def _curvatures(drive: Scenario) -> tuple[float, float]:
    """Largest second and third derivatives of a motor's torque over the electrical angle [N m], where its
    rotor lags by its load and by the microsteps.
    """
    motor, driver, rate = drive.motor, drive.driver, abs(float(drive.rate or 0.0))
    turn = references_over_electrical_period(driver, 1.0, motor.phases)
    full = motor.electromagnetic_stiffness / motor.rotor_teeth
    full *= float(np.hypot(turn[:, 0], turn[:, 1]).max())
    on_rotor = motor.friction.largest_torque + motor.viscous * rate * drive.reducer.ratio
    on_output = drive.friction.largest_torque + drive.friction.viscous * rate
    spring = spring_over_turn(drive)
    microstep = 2.0 * math.pi / (driver.beats * driver.microsteps)
    motion = 1.0 if spring is None else max(spring.motion, microstep)
    by_load = (on_rotor + on_output / drive.reducer.ratio) / full
    lag = min(1.0, by_load + 0.5 * microstep + motion)
    orders = motor.torque_orders
    second = full * lag + math.fsum(order**2 * size for order, size in orders.items())
    return second, full + math.fsum(order**3 * size for order, size in orders.items())
