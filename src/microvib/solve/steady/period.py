"""The drive over one period of its command, as a map from the state at its start to the state at
its end (Poincaré map).

States are compared as seen from the command: turned back by the angle that the command has
advanced. The drive is unchanged when its motor turns by a quarter of an electrical period, because
that exchanges the phases and is a period of the detent torque; so the state may repeat after that
many microsteps. Where the phases are not equal it takes a whole electrical turn.
"""

from __future__ import annotations

import math
from copy import copy
from typing import Any, NamedTuple

import numpy as np

from microvib.errors import SimulationError
from microvib.model.driver import motor_of_mean_spring
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.pack import Packed, pack
from microvib.solve.propagate import INITIAL_STEP_LEVELS
from microvib.solve.sampling import FILTER_HALF_LENGTH, empty_sample_buffer

SECTION_PHASE = 0.1
"""The map starts this part of a microstep period before a microstep, when the last transient has
decayed longest; a smaller one where the last part of a microstep comes late.
"""


OF_COMMAND = ("motor", "driver", "reducer", "tracking", "record")
"""Parts of a scenario that microsteps follow from."""


class NotPeriodic(SimulationError):
    """No steady state that repeats with the command was found; the message says why."""


def common_period(scenario: Scenario) -> tuple[int, int]:
    """Microsteps after which drive and command are as before, but turned; and those of the motor
    and its driver alone.
    """
    own = scenario.driver.repeats_after(scenario.motor)
    turn = scenario.driver.beats * scenario.driver.microsteps * scenario.motor.rotor_teeth
    orders = [e.order for e in scenario.rotor_harmonics if e.amplitude > 0.0]
    return math.lcm(own, *((order / turn).denominator for order in orders)), own


def _section_phase(scenario: Scenario) -> float:
    """Part of a microstep period before a microstep, halfway at least from the last part of the one
    before."""
    lasts = scenario.driver.shape.lasts * scenario.highest_driving_frequency
    return min(SECTION_PHASE, 0.5 * (1.0 - lasts))


class CommandRotation(NamedTuple):
    """Rotor angles [rad] by which drives are turned, (k,), and what turns currents and their
    integrals, two complex numbers each, by the electrical angles, (k, 1)."""

    angle: np.ndarray
    electrical: np.ndarray


class PeriodMap:
    """``microsteps`` microsteps at the rate of the record, from just before one of them."""

    def __init__(self, scenario: Scenario, microsteps: int) -> None:
        driver, motor = scenario.driver, scenario.motor
        f_d = scenario.driving_frequency
        if not f_d:
            raise NotPeriodic(
                "the rate changes in the record" if f_d is None else "the rate is zero"
            )
        if driver.pulsed:
            raise NotPeriodic("the steady state of a drive by voltage pulses is not searched for")
        if scenario.friction.torque_noise is not None:
            raise NotPeriodic(
                "torque noise does not repeat with the command (friction.torque_noise: null leaves"
                " it out)"
            )
        if scenario.friction.position is not None and scenario.friction.position.acts:
            raise NotPeriodic(
                "friction that varies with the angle does not repeat with the command"
                " (friction.position: null leaves it out)"
            )
        if scenario.friction.harness is not None and scenario.friction.harness.stiffness > 0.0:
            raise NotPeriodic(
                "a harness with stiffness does not repeat with the command, since its torque grows"
                " with the angle (friction.harness: null leaves it out)"
            )
        self.scenario, self.microsteps = scenario, microsteps
        self.packed = pack(scenario)
        self._rest = [x.copy() for x in self.packed.state]
        self.frequency, self.microstep_time = f_d / microsteps, 1.0 / f_d
        self.command = Command.lasting(scenario, scenario.record.settle)
        self._section_phase = _section_phase(scenario)
        rate = -math.copysign(
            f_d, (scenario.rate or 0.0) * scenario.reducer.h
        )  # in microsteps per second
        count = float(self.command.count(np.array([scenario.record.settle]))[0])
        turned = math.copysign(1.0, rate)
        before = 2 + math.ceil(
            f_d * (FILTER_HALF_LENGTH + 1) / scenario.record.sample_rate
        )  # the record's filter begins before it
        # The same place of the period whatever the settling time is, so that what is found does not
        # depend on it.
        gone = turned * microsteps * math.floor((round(count) * turned - before) / microsteps)
        section = float(
            self.command.compensated.commanded(
                np.asarray(gone + (0.5 - self._section_phase) * turned)
            )
        )
        self.start = scenario.record.settle + (section - count) / rate
        evenly = gone + (0.5 - SECTION_PHASE) * turned
        self.after_clock = self.start - (scenario.record.settle + (evenly - count) / rate)
        """Time [s] from where an ordinary period begins, which the step clock alone says, to ``start``."""
        self.command = Command.lasting(scenario, self.start)
        self.times, self.commands = self.command.microsteps(
            self.start, self.start + microsteps / f_d
        )
        step = driver.microstep(motor)
        self._begun, self._step = gone * step, turned * step
        self._references = np.column_stack(
            self.references(self.angle(np.arange(-1, microsteps + 1)))
        )
        self._ramp = self._last_ramp(gone, turned, section)
        self.sizes = np.where(np.isfinite(self.packed.sizes), self.packed.sizes, 1.0)
        p = self.packed.drive
        self.idle = [kernel.TL, kernel.WL] * bool(p.rigid) + [kernel.XA, kernel.XB] * (p.K_I == 0.0)
        self.unseen = empty_sample_buffer(self.packed.channels)._replace(width=0.0)
        self.evaluations = 0.0

    @property
    def parts(self) -> int:
        """Parts of a microstep: rows of ``times`` and ``commands`` for each."""
        return max(len(self.scenario.driver.microstep_shape), 1)

    def _last_ramp(self, gone: float, turned: float, section: float) -> tuple[float, float]:
        """Time [s] that the ramp lasts which was last begun before the section, and since when."""
        ramp, compensated = self.scenario.driver.microstep_ramp, self.command.compensated
        if not compensated.acts:
            return (
                ramp * self.microstep_time,
                (1.0 - self._section_phase) * self.microstep_time,
            )
        last, coming = compensated.commanded(np.array([gone - 0.5 * turned, gone + 0.5 * turned]))
        return (
            ramp * abs(coming - last) * self.microstep_time,
            abs(section - last) * self.microstep_time,
        )

    def beside(self, scenario: Scenario, packed: Packed) -> PeriodMap:
        """Map of another drive over the same microsteps, from the same start; its rate may differ a
        little, and ``packed`` has its parameters and the state of this one.
        """
        if all(getattr(scenario, x) is getattr(self.scenario, x) for x in OF_COMMAND):
            other = copy(self)
            other.scenario, other.packed = scenario, packed
            return other
        f_d = scenario.driving_frequency
        assert f_d
        if self.parts > 1 or self.command.compensated.acts:
            other = PeriodMap(scenario, self.microsteps)
            other.packed = packed
            return other
        other = copy(self)
        other.scenario, other.packed = scenario, packed
        other.frequency, other.microstep_time = f_d / self.microsteps, 1.0 / f_d
        slower = other.microstep_time / self.microstep_time
        other.times = self.start + (self.times - self.start) * slower
        other._references = np.column_stack(
            other.references(other.angle(np.arange(-1, self.microsteps + 1)))
        )
        other.commands = self.commands.copy()
        other.commands[:, :2] = np.column_stack(
            other.references(self.commands[:, 2] / packed.drive.z)
        )
        other.commands[:, 3] *= slower
        return other

    def guess(self) -> np.ndarray:
        """State just before a microstep, seen from the command, of a drive that follows its command
        smoothly.

        The windup is that of the mean loads, and the currents rotate steadily.
        """
        scenario, p = self.scenario, self.packed.drive
        y: np.ndarray = np.zeros_like(self.packed.state.y)
        rate = float(scenario.rate or 0.0)
        omega, commanded = -scenario.reducer.h * rate, float(self.angle(0))
        on_rotor, on_output = scenario.motor.friction.torque(omega), scenario.friction.torque(rate)
        if scenario.motor.eddy_damping is not None:
            on_rotor += scenario.motor.eddy_damping * omega
        spring = motor_of_mean_spring(scenario.driver, scenario.motor).electromagnetic_stiffness
        y[kernel.TM] = commanded - (on_rotor - p.inv_h * on_output) / spring
        y[kernel.TL] = -p.inv_h * y[kernel.TM] - (0.0 if p.rigid else on_output / p.K_g)
        load = scenario.load
        y[kernel.MODES :: 2] = -(load.V_l * rate + load.V_m * omega) / load.Lambda
        y[kernel.MODES + 1 :: 2] = p.H * rate + load.R * omega
        if scenario.friction.breakaway_torque == 0.0:
            y[kernel.WL] = rate
        current, integral = _turning_currents(p, p.z * omega)
        turn = np.exp(1j * p.z * commanded)
        y[kernel.IA], y[kernel.IB] = (current * turn).real, (current * turn).imag
        y[kernel.XA], y[kernel.XB] = (integral * turn).real, (integral * turn).imag
        return y

    def rest(self) -> None:
        """Put the drive at rest at t = 0, where every run begins."""
        for part, value in zip(self.packed.state, self._rest, strict=True):
            part[:] = value

    def angle(self, microstep: Any) -> Any:
        """Commanded rotor angle [rad] before a ``microstep`` of the period."""
        return self._begun + microstep * self._step

    @property
    def commanded_output(self) -> float:
        """Angle of the output [rad] by the command at the start of the period."""
        return -self._begun * float(self.packed.drive.inv_h)

    def references(self, angle: Any) -> tuple[Any, Any]:
        """Commanded currents [A] at a rotor angle [rad]."""
        return self.scenario.driver.references(self.scenario.motor, self.packed.drive.z * angle)

    def turn(self, microsteps: Any) -> CommandRotation:
        """The turn that ``microsteps`` (k,) of the command make."""
        return self._by(self._step * np.asarray(microsteps, dtype=float))

    def _by(self, angle: np.ndarray) -> CommandRotation:
        return CommandRotation(angle, np.exp(1j * self.packed.drive.z * angle)[:, None])

    def absolute(self, x: np.ndarray, turn: CommandRotation) -> np.ndarray:
        """States (k, n) of the drive from those seen from the command, which has made ``turn``
        since the start of the period.
        """
        y = self._turned(x, turn)
        p = self.packed.drive
        if p.rigid:
            errors = [self.scenario.reducer.kinematic_error(theta_m) for theta_m in y[:, kernel.TM]]
            y[:, kernel.TL] = errors - y[:, kernel.TM] * p.inv_h
            y[:, kernel.WL] = -y[:, kernel.WM] * p.inv_h
        return y

    def from_command(
        self, y: np.ndarray, turn_back: CommandRotation, idle: np.ndarray
    ) -> np.ndarray:
        """States (k, n) of the drive as seen from the command; entries that are not integrated are
        taken from ``idle``.
        """
        x = self._turned(y, turn_back)
        x[:, self.idle] = idle[:, self.idle]
        return x

    def _turned(self, y: np.ndarray, turn: CommandRotation) -> np.ndarray:
        """States with rotor, output and currents turned."""
        turned = y.copy()
        pairs = turned[:, kernel.IA : kernel.XB + 1].view(complex)
        pairs *= turn.electrical
        turned[:, kernel.TM] += turn.angle
        turned[:, kernel.TL] -= turn.angle * self.packed.drive.inv_h
        return turned

    def put(self, x: np.ndarray, stick: np.ndarray | None = None) -> None:
        """Make ``x``, seen from the command, the state at the start of the period.

        ``stick`` are the modes of all frictions and the angles at which their elements are relaxed,
        seen from the command (``stick_turned``); without it they follow from ``x``, and elements
        are relaxed.
        """
        state = self.packed.state
        if self.packed.drive.rigid:
            state.y[:] = self.absolute(x[None], self.turn([0]))[0]
        else:  # nothing has turned yet
            state.y[:] = x
        state.clock[:] = self.clocks(np.array([0]))[0]
        state.levels[:], state.energy[:] = INITIAL_STEP_LEVELS, 0.0
        if stick is None:
            kernel.initial_friction(state, self.packed.drive)
        else:
            state.stick[:] = stick

    def stick_turned(self, stick: np.ndarray, microsteps: int) -> np.ndarray:
        """Modes and memory of the frictions with the angles that elements remember turned by
        ``microsteps`` of the command.
        """
        turned, p = stick.copy(), self.packed.drive
        angles, by = turned[2 + len(p.elements) :], microsteps * self._step
        angles[: p.m_elements] += by
        angles[p.m_elements : p.m_elements + p.l_elements] -= by * p.inv_h
        before_harness = p.m_elements + p.l_elements + p.g_elements
        angles[before_harness : before_harness + p.harness_elements] -= by * p.inv_h
        return turned

    def clocks(self, microsteps: np.ndarray) -> np.ndarray:
        """The clocks before some ``microsteps`` (k,) of the period, with references and a ramp on
        its way there, (k, N_CLOCK).
        """
        clock, p = np.zeros((microsteps.size, kernel.N_CLOCK)), self.packed.drive
        clock[:, kernel.NOW] = self.start + microsteps * self.microstep_time
        clock[:, kernel.NEXT_STEP] = p.max_step
        clock[:, kernel.THETA_E] = p.z * self.angle(microsteps)
        goal = clock[:, kernel.REF_A : kernel.REF_B + 1] = self._references[microsteps + 1]
        lasts, begun = self._ramp
        left = lasts - begun
        if left > 0.0:
            rate = (goal - self._references[microsteps]) / lasts
            (
                clock[:, kernel.GOAL_A : kernel.GOAL_B + 1],
                clock[:, kernel.RATE_A : kernel.RATE_B + 1],
            ) = goal, rate
            clock[:, kernel.REF_A : kernel.REF_B + 1] = goal - left * rate
            clock[:, kernel.RAMP_END] = clock[:, kernel.NOW] + left
        return clock

    def advance(self, x: np.ndarray, samples: Any = None) -> np.ndarray:
        """State after the period, seen from the command."""
        self.put(x)
        self.go_on(samples)
        end: np.ndarray = self.from_command(
            self.packed.state.y[None], self.turn([-self.microsteps]), x[None]
        )[0]
        return end

    def go_on(self, samples: Any = None) -> None:
        """Advance over the period from the state that was put at its start."""
        stop = self.start + 1.0 / self.frequency
        status = self.packed.advance(stop, samples or self.unseen, self.times, self.commands)
        self.evaluations += 1.0
        if status != kernel.OK:
            raise search_error(status)


def search_error(status: int) -> NotPeriodic:
    """The kernel's status as an error of the search."""
    if status == kernel.LOST_SYNCHRONISM:
        return NotPeriodic(
            "an iteration of the steady-state search lost synchronism (this does not mean that the"
            " drive does)"
        )
    return NotPeriodic("the solution is not finite, or its step became too small")


def _turning_currents(p: Any, omega: float) -> tuple[complex, complex]:
    """Current i_A + j i_B [A] and integral of its error [A s] seen from the command, turning at
    ``omega`` [rad/s] (Eq. 2, 3).
    """
    winding = p.R + 1j * omega / p.inv_L_D
    back_emf = 1j * p.K_m * omega / p.z
    error = ((winding - p.K_V) * p.current + back_emf) / (p.K_P + p.K_I / (1j * omega) + winding)
    return p.current - error, error / (1j * omega) if p.K_I > 0.0 else 0.0
