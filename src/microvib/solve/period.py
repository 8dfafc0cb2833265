"""The drive over one period of its command, as a map from the state at its start to the state at its end (Poincaré map).

States are compared as seen from the command: turned back by the angle that the command has gone. The drive does not change when its
motor turns by a quarter electrical turn, for that exchanges the phases and is a period of the detent torque, so that the state
may repeat after so many microsteps.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from microvib.errors import SimulationError
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.decimate import LOBES
from microvib.solve.pack import no_samples, pack

SECTION = 0.1
"""The map starts this part of a microstep's time before a microstep, when the motion has had the longest to calm."""
NUDGE = 0.03
"""Step of differences, over what a microstep moves: well above the solver's tolerance, below what changes the motion."""


class NotPeriodic(SimulationError):
    """No steady state that repeats with the command was found; the text says why."""


def repeats_after(scenario: Scenario) -> tuple[int, int]:
    """Microsteps after which drive and command are as before, but turned; and those of a quarter electrical turn alone.

    Where no whole number of microsteps makes a quarter turn, the least multiple of it is meant that one makes.
    """
    electrical = scenario.driver.beats * scenario.driver.microsteps
    turn = electrical * scenario.motor.rotor_teeth
    quarter = electrical // math.gcd(electrical, 4)
    orders = [e.order for e in scenario.reducer.transmission_error if e.amplitude > 0.0]
    return math.lcm(quarter, *(turn // math.gcd(turn, order) for order in orders)), quarter


class PeriodMap:
    """``microsteps`` microsteps at the rate of the record, from just before one of them."""

    def __init__(self, scenario: Scenario, microsteps: int) -> None:
        driver, motor = scenario.driver, scenario.motor
        f_d = scenario.driving_frequency
        if not f_d:
            raise NotPeriodic("the rate changes in the record" if f_d is None else "the rate is zero")
        self.scenario, self.microsteps = scenario, microsteps
        self.packed = pack(scenario)
        self.frequency = f_d / microsteps
        self.command = Command.lasting(scenario, scenario.record.settle)
        rate = -math.copysign(f_d, scenario.rate or 0.0)  # in microsteps per second
        count = float(self.command.count(np.array([scenario.record.settle]))[0])
        turned = math.copysign(1.0, rate)
        before = 2 + math.ceil(f_d * (LOBES + 1) / scenario.record.sample_rate)  # the record's filter begins before it
        self._count = round(count) - before * turned
        self.start = scenario.record.settle + (self._count + (0.5 - SECTION) * turned - count) / rate
        self.command = Command.lasting(scenario, self.start)
        self._times, self._references = self.command.microsteps(self.start, self.start + microsteps / f_d)
        self._step, self._turned = driver.microstep(motor), turned
        self.sizes = _sizes(self.packed.drive.scale, scenario)
        p = self.packed.drive
        self._idle = [kernel.TL, kernel.WL] * bool(p.rigid) + [kernel.XA, kernel.XB] * (p.K_I == 0.0)
        self._unseen = no_samples(self.packed.channels)._replace(width=0.0)
        self.evaluations = 0.0

    def guess(self) -> np.ndarray:
        """State at the start if the drive followed its command evenly: mean loads, currents turning steadily."""
        scenario, p = self.scenario, self.packed.drive
        y: np.ndarray = np.zeros_like(self.packed.state.y)
        rate = float(scenario.rate or 0.0)
        omega, commanded = -scenario.reducer.ratio * rate, self._count * self._step
        on_rotor, on_output = scenario.motor.friction.torque(omega), scenario.friction.torque(rate)
        y[kernel.TM] = commanded - (on_rotor - p.inv_h * on_output) / scenario.motor.electromagnetic_stiffness
        y[kernel.TL] = -p.inv_h * y[kernel.TM] - (0.0 if p.rigid else on_output / p.K_g)
        y[kernel.MODES + 1 :: 2] = p.H * rate
        if scenario.friction.breakaway_torque == 0.0:
            y[kernel.WL] = rate
        current, integral = _turning_currents(p, scenario.motor.current, p.z * omega)
        turn = np.exp(1j * p.z * commanded)
        y[kernel.IA], y[kernel.IB] = (current * turn).real, (current * turn).imag
        y[kernel.XA], y[kernel.XB] = (integral * turn).real, (integral * turn).imag
        return y

    def put(self, y: np.ndarray) -> None:
        """Make ``y`` the state at the start of the period."""
        state, p = self.packed.state, self.packed.drive
        state.y[:] = y
        if p.rigid:
            state.y[kernel.TL] = self.scenario.reducer.kinematic_error(y[kernel.TM]) - y[kernel.TM] * p.inv_h
            state.y[kernel.WL] = -y[kernel.WM] * p.inv_h
        angle = p.z * self._count * self._step
        current = self.scenario.motor.current
        state.clock[:] = 0.0
        state.energy[:] = 0.0
        state.clock[kernel.NOW], state.clock[kernel.NEXT_STEP] = self.start, p.max_step
        state.clock[kernel.REF_A], state.clock[kernel.REF_B] = current * math.cos(angle), current * math.sin(angle)
        state.clock[kernel.THETA_E] = angle
        kernel.start(state, p)

    def advance(self, y: np.ndarray, microsteps: int | None = None, samples: Any = None) -> np.ndarray:
        """State after the period, or after ``microsteps``, turned back by what the command has gone."""
        count = self.microsteps if microsteps is None else microsteps
        self.put(y)
        stop = self.start + count / (self.frequency * self.microsteps)
        status = self.packed.advance(stop, samples or self._unseen, self._times[:count], self._references[:count])
        self.evaluations += count / self.microsteps
        if status == kernel.LOST_SYNCHRONISM:
            raise NotPeriodic("the rotor loses synchronism")
        if status != kernel.OK:
            raise NotPeriodic("the solution is not finite, or its step became too small")
        return self._turn_back(self.packed.state.y, count, y)

    def _turn_back(self, end: np.ndarray, count: int, y: np.ndarray) -> np.ndarray:
        p = self.packed.drive
        gone = self._turned * count * self._step
        c, s = math.cos(p.z * gone), math.sin(p.z * gone)
        back = end.copy()
        for a, b in ((kernel.IA, kernel.IB), (kernel.XA, kernel.XB)):
            back[a], back[b] = c * end[a] + s * end[b], c * end[b] - s * end[a]
        back[kernel.TM] -= gone
        back[kernel.TL] += gone * p.inv_h
        back[self._idle] = y[self._idle]
        return back

    def monodromy(self, y: np.ndarray) -> np.ndarray:
        """Derivative of the map at ``y``, both in units of ``sizes``, (n, n).

        That of a sixteenth of the period, or of one microstep, by differences, to the power of their number: the parts
        differ by the detent torque only.
        """
        count = math.gcd(self.microsteps, max(self.microsteps // 16, 1))
        base = self.advance(y, count)
        stuck = self.stuck
        change = np.zeros((y.size, y.size))
        for j in range(y.size):
            if j in self._idle or (j == kernel.WM and stuck[0]) or (j == kernel.WL and stuck[1]):
                continue
            nudged = y.copy()
            nudged[j] += NUDGE * self.sizes[j]
            change[:, j] = (self.advance(nudged, count) - base) / (NUDGE * self.sizes)
        with np.errstate(over="ignore", invalid="ignore"):
            result: np.ndarray = np.linalg.matrix_power(change, self.microsteps // count)
        if not np.all(np.isfinite(result)):
            raise NotPeriodic("what repeats with the command is far from stable")
        return result

    @property
    def stuck(self) -> tuple[bool, bool]:
        """Whether rotor and output stick at the end of the last stretch."""
        stick = self.packed.state.stick
        return bool(stick[0] == 0.0), bool(stick[1] == 0.0) and not self.packed.drive.rigid


def _sizes(scale: np.ndarray, scenario: Scenario) -> np.ndarray:
    """What one microstep moves, for each state."""
    tolerance = scenario.solver.tolerance / scenario.solver.refinement**4
    return 1.0 / np.where(scale > 0.0, scale * tolerance, 1.0)


def _turning_currents(p: Any, current: float, omega: float) -> tuple[complex, complex]:
    """Current i_A + j i_B [A] and integral of its error [A s] seen from the command, turning at ``omega`` [rad/s] (Eq. 2, 3)."""
    winding = p.R + 1j * omega / p.inv_L_D
    back_emf = 1j * p.K_m * omega / p.z
    error = (winding * current + back_emf) / (p.K_P + p.K_I / (1j * omega) + winding)
    return current - error, error / (1j * omega) if p.K_I > 0.0 else 0.0
