"""Elements of a drive that turns and always slides, whose torque is no constant linear function of how
it moves: the one place that says what each makes of other sources' loads.

About its own motion such an element is linear with coefficients that change as the drive turns. Of
motions q along a few directions, rotor, output and twist of the gear, it makes the torques

    p(t) = -K(t) q - B(t) dq/dt - d/dt (A(t) q)

with K, B and A sums of exp(j k omega_e t) over cycles k per electrical turn, of either sign, that need
not be whole numbers. ``model.side_lines`` solves for all of them together (harmonic balance).

- The motor's spring, over the angle: ``model.turning``.
- Friction whose slope changes with the rate (breakaway above Coulomb friction), over the rates that the
  run has within an electrical turn; what of these does not repeat is a remainder, which is bounded.
- Friction over the angle of the output: its rise over the angle is a spring, and its slope varies.
- Errors of the gear: the twist is eps(theta_m) - theta_m/h - theta_l, so that the rotor has another
  ratio at each angle.
- Windings: a rotor that swings drives currents by its back-EMF, more where the loop's gain is small.

What is none of these is linear (inertias, springs and dampers), is bounded elsewhere
(``model.drive_states``: elements that stick) or makes nothing known, and says so (``reasons``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from microvib.model.driver import motor_of_mean_spring
from microvib.model.friction import Friction
from microvib.model.scenario import Scenario
from microvib.model.shaft_rates import ShaftRates
from microvib.model.turning import SpringOverTurn, dynamic_stiffness_of_windings

DIRECTIONS = ("rotor", "output", "twist")
ROTOR, OUTPUT, TWIST = range(3)
ORDER_DIGITS = 9
"""Digits of cycles per electrical turn that tell orders apart."""
_FAINT = 1e-6
"""Part of the largest harmonic below which one is left out."""
_MOST_HARMONICS = 200
"""Harmonics of a slope over the electrical turn that count, at most."""
_RATES = 33
"""Rates at which the slope of a friction is taken where its motion is not known."""
_LARGEST_RATIO_ERROR = 1e-3
"""Part by which the ratio of a rigid gear may change with the angle and be taken for constant."""
_SIGMAS = 3.0
"""Standard deviations of roughness that count as its largest."""


class Varying(NamedTuple):
    """Coefficients of one order by directions, (3, 3) each."""

    spring: np.ndarray
    """K [N m/rad]."""
    before: np.ndarray
    """B [N m s/rad]."""
    after: np.ndarray
    """A [N m s/rad]."""

    def at(self, omega_in: np.ndarray, omega_out: np.ndarray) -> np.ndarray:
        """Torques against motions at ``omega_in`` (...) that are at ``omega_out`` [rad/s], (..., 3, 3)."""
        before, after = (1j * np.asarray(x)[..., None, None] for x in (omega_in, omega_out))
        return np.asarray(self.spring + before * self.before + after * self.after)


class Remainder(NamedTuple):
    """Coefficients along a direction of which is known how large they are, but not when."""

    direction: int
    spring: float
    """[N m/rad]."""
    damping: float
    """[N m s/rad]."""
    why: str


@dataclass(frozen=True, eq=False)
class SlidingElements:
    """Elements of one drive."""

    drive: Scenario
    spring: SpringOverTurn
    rates: ShaftRates | None
    """Over an electrical turn; None where nobody looked."""
    slides: tuple[bool, bool]
    """Whether rotor and output always slide; what friction that sticks makes is bounded otherwise."""
    slowest: tuple[float, float] = (math.inf, math.inf)
    """Least rates of rotor and output [rad/s]; infinite where nobody looked."""

    @cached_property
    def varying(self) -> dict[float, Varying]:
        """Coefficients by cycles per electrical turn, of either sign; 0 is what of the motor's spring is
        beside that of the linearised drive, and what gear errors leave on average.
        """
        found: dict[float, Varying] = {}
        for order, one in (*self._of_spring(), *self._of_friction(), *self._of_gear()):
            key = round(order, ORDER_DIGITS)
            before = found.get(key)
            found[key] = one if before is None else Varying(*(a + b for a, b in zip(before, one, strict=True)))  # fmt: skip
        return found

    @cached_property
    def mean_damping(self) -> tuple[float, float]:
        """Mean of what the slopes of the frictions of rotor and output are beside their viscous parts
        [N m s/rad].
        """
        return self._slopes[0].mean, self._slopes[1].mean

    @cached_property
    def linear(self) -> float:
        """Spring of the linearised drive [N m/rad]."""
        motor = motor_of_mean_spring(self.drive.driver, self.drive.motor)
        return motor.electromagnetic_stiffness

    def windings(self, omega: np.ndarray) -> np.ndarray:
        """Stiffness [N m/rad] that back-EMF and current loop add on the rotor at ``omega`` [rad/s]."""
        return dynamic_stiffness_of_windings(self.drive, omega)

    @property
    def remainders(self) -> tuple[Remainder, ...]:
        """Coefficients that are known by their size alone."""
        found = []
        for direction, one in enumerate(self._slopes):
            if one.remainder > 0.0:
                found.append(
                    Remainder(direction, 0.0, one.remainder, _OF_RATES.format(_GROUPS[direction]))
                )
        rough = self._roughness
        return (*found, *([] if rough is None else [rough]))

    @property
    def reasons(self) -> Iterator[str]:
        """Why it is not known what an element makes of loads, a sentence each."""
        reducer, driver = self.drive.reducer, self.drive.driver
        part = reducer.ratio * math.fsum(float(e.order) * e.amplitude for e in reducer.errors)
        if reducer.rigid and part > _LARGEST_RATIO_ERROR:
            yield (
                f"errors of a rigid gear change its ratio by {part:.2g} of itself as it turns, and what"
                " they make of these loads is not known (reducer.stiffness in N*m/rad instead of rigid,"
                " or no reducer.transmission_error)"
            )
        if reducer.backlash and (self.rates is None or self.rates.least_gear_torque == 0.0):
            yield (
                "teeth part and meet as the drive turns, and what they make of these loads is not known"
                " (reducer.backlash: 0, or more friction on the output, which keeps them together)"
            )
        if self.rates is not None and self.rates.at_supply_limit:
            yield (
                "the supply limits the voltage of the windings, and what they make of these loads is not"
                f" known (driver.supply_voltage above {driver.supply_voltage} V, or a slower rate)"
            )

    # ---- The motor's spring ----

    def _of_spring(self) -> Iterator[tuple[float, Varying]]:
        yield 0.0, _on(ROTOR, spring=self.spring.mean - self.linear)
        size = np.abs(self.spring.amplitude)
        for k in np.flatnonzero(size > _FAINT * size.max(initial=0.0)).tolist():
            order, amplitude = float(self.spring.orders[k]), complex(self.spring.amplitude[k])
            yield order, _on(ROTOR, spring=amplitude)
            yield -order, _on(ROTOR, spring=amplitude.conjugate())

    # ---- Frictions ----

    @cached_property
    def _slopes(self) -> tuple[_Slope, _Slope]:
        """Slopes of the frictions of rotor and output, beside their viscous parts."""
        drive, rates = self.drive, self.rates
        commanded = abs(float(drive.rate or 0.0))
        rotor_turn = output_turn = None
        if rates is not None:
            rotor_turn = rates.rotor, rates.rotor_remainder
            output_turn = rates.output, rates.output_remainder
        shafts = (
            (drive.motor.friction, rotor_turn, self.slides[0], (self.slowest[0], drive.reducer.ratio * commanded)),
            (drive.friction, output_turn, self.slides[1], (self.slowest[1], commanded)),
        )  # fmt: skip
        rotor, output = (_slope_of(*shaft) for shaft in shafts)
        return rotor, output

    def _of_friction(self) -> Iterator[tuple[float, Varying]]:
        later = self._later
        for direction, one in ((ROTOR, self._slopes[0]), (OUTPUT, self._slopes[1])):
            for k, amplitude in one.harmonics.items():
                turned = amplitude * complex(np.exp(1j * k * later))
                yield k, _on(direction, before=turned)
                yield -k, _on(direction, before=turned.conjugate())
        if self.slides[1]:
            yield from self._of_position()

    @property
    def _later(self) -> float:
        """Electrical angle [rad] by which the instant 0 of the spring is behind that of the rates."""
        return math.copysign(1.0, self._rotor_rate) * self.spring.behind

    @property
    def _rotor_rate(self) -> float:
        return -self.drive.reducer.h * float(self.drive.rate or 0.0)

    @property
    def _rotor_angle(self) -> float:
        """Angle of the rotor [rad] at the instant 0 of the spring."""
        return self.spring.behind / self.drive.motor.rotor_teeth

    def _of_position(self) -> Iterator[tuple[float, Varying]]:
        """Friction over the angle: its rise, and the slope that goes with it."""
        friction, rate = self.drive.friction, float(self.drive.rate or 0.0)
        if friction.position is None:
            return
        torque, slope = friction.torque(rate), friction.viscous + self._slopes[1].mean
        start = 0.0 if self.rates is None else self.rates.output_angle
        start -= self._rotor_angle / self.drive.reducer.h
        for one in friction.position.harmonics:
            order = one.order / (self.drive.motor.rotor_teeth * self.drive.reducer.ratio)
            phase = one.order * start + one.phase
            factor = 0.5 * one.amplitude * complex(np.exp(1j * phase))
            rise = 1j * one.order * factor
            if rate < 0.0:
                factor, rise = factor.conjugate(), rise.conjugate()
            yield order, _on(OUTPUT, spring=torque * rise, before=slope * factor)
            yield -order, _on(OUTPUT, spring=torque * rise.conjugate(), before=slope * factor.conjugate())  # fmt: skip
            for k, amplitude in self._slopes[1].harmonics.items():
                turned = amplitude * complex(np.exp(1j * k * self._later))
                for at, both in ((k + order, turned * factor), (k - order, turned * factor.conjugate())):  # fmt: skip
                    yield at, _on(OUTPUT, before=both)
                    yield -at, _on(OUTPUT, before=both.conjugate())

    @cached_property
    def _roughness(self) -> Remainder | None:
        """Roughness of the output's friction: its rise over the angle, and the slope that goes with it."""
        friction = self.drive.friction
        if not self.slides[1] or friction.position is None or friction.position.roughness is None:
            return None
        rough = friction.position.roughness
        order = np.arange(1.0, math.floor(min(rough.band[1], 1e6)) + 1.0)
        rise = math.sqrt(float(np.sum(order**2 * rough.at(order))))
        torque = abs(friction.torque(float(self.drive.rate or 0.0)))
        slope = friction.viscous + self._slopes[1].largest
        spring, damping = torque * rise, slope * rough.deviation
        return Remainder(OUTPUT, _SIGMAS * spring, _SIGMAS * damping, _OF_ROUGHNESS)

    # ---- The gear ----

    def _of_gear(self) -> Iterator[tuple[float, Varying]]:
        """Changes of a gear's spring and damper by its errors, with s = eps - theta_m/h - theta_l its twist:
        d s/d theta_m has a = d eps/d theta_m besides, and the gear's torque the lever d a/d theta_m.
        """
        reducer = self.drive.reducer
        if reducer.rigid or not reducer.errors:
            return
        K, C, rate = float(reducer.stiffness), reducer.damping, self._rotor_rate
        torque = self.drive.friction.torque(float(self.drive.rate or 0.0))
        teeth, slopes = self.drive.motor.rotor_teeth, dict[float, complex]()
        for e in reducer.errors:
            order = float(e.order)
            own = 0.5 * order * e.amplitude * complex(np.exp(1j * (order * self._rotor_angle + e.phase)))  # fmt: skip
            if rate < 0.0:
                own = own.conjugate()
            for k, a in ((order / teeth, own), (-order / teeth, own.conjugate())):
                slopes[k] = slopes.get(k, 0.0) + a
                yield k, _between(K * a, C * a)
                yield k, _on(ROTOR, spring=1j * k * teeth * math.copysign(torque, rate) * a)
        for k, a in slopes.items():
            for j, b in slopes.items():
                turning = 1j * j * teeth * abs(rate)
                yield k + j, _on(ROTOR, spring=(K + C * turning) * a * b, before=C * a * b)


_GROUPS = ("motor.friction", "friction")
_OF_RATES = (
    "the slope of {} changes within a step, as the shaft's rate does, and not in the same way in each"
    " (record.start: steady, a longer record.settle, or finer microsteps)"
)
_OF_ROUGHNESS = (
    "the roughness of the friction (friction.position.roughness) makes lines of these loads at"
    " frequencies that are not known"
)


def _on(direction: int, spring: complex = 0.0, before: complex = 0.0) -> Varying:
    """A spring and a damper along one direction."""
    place = np.zeros((3, 3), dtype=complex)
    place[direction, direction] = 1.0
    return Varying(spring * place, before * place, 0.0 * place)


def _between(spring: complex, damping: complex) -> Varying:
    """Spring and damper of a gear with another lever on the rotor: by the rotor's motion on the twist,
    whose lever changes before it is differentiated, and by the twist on the rotor.
    """
    on_twist, on_rotor = np.zeros((3, 3), dtype=complex), np.zeros((3, 3), dtype=complex)
    on_twist[TWIST, ROTOR], on_rotor[ROTOR, TWIST] = 1.0, 1.0
    return Varying(spring * (on_twist + on_rotor), damping * on_rotor, damping * on_twist)


class _Slope(NamedTuple):
    """Slope of a friction beside its viscous part [N m s/rad], over the electrical turn."""

    mean: float = 0.0
    harmonics: Mapping[float, complex] = MappingProxyType({})
    """By whole cycles per turn, from 1 on."""
    remainder: float = 0.0
    """By how much it is off these at most."""

    @property
    def largest(self) -> float:
        """As large as it may be."""
        return abs(self.mean) + 2.0 * math.fsum(map(abs, self.harmonics.values())) + self.remainder


def _slope_of(
    friction: Friction,
    turn: tuple[np.ndarray, float] | None,
    slides: bool,
    rates: tuple[float, float],
) -> _Slope:
    """Slope of a friction over a ``turn`` of rates (n,) with their remainder; without it anything between the
    slowest of ``rates`` and as far above the commanded one, the other.
    """
    if not slides or friction.stribeck_torque == 0.0:
        return _Slope()
    slope = _beside_viscous(friction)
    if turn is None:
        slowest, commanded = min(rates), rates[1]
        each = slope(np.linspace(slowest, 2.0 * commanded - slowest, _RATES))
        mean = 0.5 * float(each.min() + each.max())
        return _Slope(mean, remainder=0.5 * float(each.max() - each.min()))
    speed, off = turn
    each = slope(np.abs(speed))
    series = np.fft.rfft(each) / each.size
    size = np.abs(series)
    size[0] = 0.0
    largest = np.argsort(-size)[:_MOST_HARMONICS]
    kept = [k for k in largest.tolist() if size[k] > _FAINT * size.max(initial=0.0)]
    kept = [k for k in kept if 0 < k < (each.size + 1) // 2]
    made = np.zeros_like(series)
    made[[0, *kept]] = series[[0, *kept]]
    left = float(np.max(np.abs(each - np.fft.irfft(made * each.size, each.size))))
    beside = [slope(np.abs(np.abs(speed) + part * off)) - each for part in (-1.0, -0.5, 0.5, 1.0)]
    remainder = left + float(np.max(np.abs(beside)))
    return _Slope(float(series[0].real), {float(k): complex(series[k]) for k in kept}, remainder)


def _beside_viscous(friction: Friction) -> Callable[[np.ndarray], np.ndarray]:
    """Slope beside the viscous part by rates (n,) [rad/s]; steep where a rate is 0."""
    least = 1e-6 * friction.stribeck_rate

    def slope(rate: np.ndarray) -> np.ndarray:
        return np.array([friction.slope(max(x, least)) - friction.viscous for x in rate.tolist()])

    return slope
