"""Growth and decay of small deviations from smooth turning, while the motor's stiffness varies with
the angle.

The drive is linearised about a rotor that follows its command evenly, in the frame of the command:
windings with the current loop at the electrical frequency, where a rotor's swing may take energy out
of the currents (mid-range instability), friction by its slope at the rate. Detent
torque, flux harmonics and the steps of the references make the motor's stiffness and the coupling of
its currents periodic over the electrical angle. By Floquet's theory deviations x of such a drive are
multiplied over each period T by the eigenvalues mu of the monodromy matrix,

    x(T) = Phi x(0),    growth = ln |mu| / T

A mode grows where the variation meets twice its frequency, or a sum of two (parametric resonance),
and decays more slowly nearby. The rotor's own motion by what varies is that of the drive with a
constant stiffness. Errors of a gear, and friction over the angle, are not in it
(``microvib.model.parametric``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from microvib.model.drive_matrices import drive_matrices
from microvib.model.driver import references_over_electrical_period
from microvib.model.linear import (
    coupled_modes,
    undamped_rounding,
)
from microvib.model.load import Load
from microvib.model.scenario import Scenario

GROWN_EFOLDINGS = 36.0
"""e-foldings in which a deviation grows from rounding to all that it becomes."""
_STEPS_PER_CYCLE = 96
"""Steps of the monodromy matrix in a cycle of the highest harmonic."""
_STEPS_PER_MICROSTEP = 24
"""Steps in a microstep, where the references' steps are large enough to count."""
_SAMPLES_PER_CYCLE = 32
"""Samples of a cycle of the highest harmonic in the spring over an electrical turn."""
_MOST_STEPS = 4096
_MOST_WORK = 1e9
"""Steps times the third power of the states, at most."""
_LARGE_MICROSTEP = 0.03
"""Electrical angle [rad] of a microstep from which its staircase varies the stiffness by a ten
thousandth.
"""
_MANY_MODES = 30
"""Array modes of which the drive moves most that are taken into account."""
_PARTICIPATION = 0.1
"""Participation in a mode from which a multiplier is one of its own."""
_MOTION_ITERATIONS = 4
"""Times that the rotor's own motion is found from what varies at its angles."""
_LARGEST_MOTION = 0.5
"""Electrical angle [rad] by which the rotor is taken to move at most by what varies."""
_SLOWEST = 1e-9j
"""Complex frequency [rad/s] in place of 0 behind an integrator."""
_LARGEST_EXPONENT = 300.0
"""Growth over a period, as exponent of e, that can be computed."""
_ROUNDING = 10.0
"""Times the rounding of eigenvalues that, but for it, are zero."""


@dataclass(frozen=True)
class TurningDrive:
    """Fate of small deviations from smooth turning."""

    growth: float
    """Rate [1/s] at which the fastest grows; 0 where all die away."""
    varying: bool
    """Whether it is the variation of the stiffness over the angle that makes it grow."""
    decay: dict[str, float]
    """Decay rates [1/s] of modes by name, the slowest in which each takes part, with frictions by their
    viscous part; negative where it grows.
    """
    decay_on_slope: dict[str, float]
    """Decay rates with frictions by their slope at the rate."""


SLIDING = TurningDrive(0.0, False, {}, {})
"""A drive of which nothing is known beyond its modes."""


def turning_drive(scenario: Scenario) -> TurningDrive:
    """Find what becomes of small deviations from smooth turning at the rate of the record.

    Nothing is said of a drive without a rate in its record, of one by pulses, or of one that cannot
    carry its friction.
    """
    if not scenario.rate or scenario.driver.pulsed:
        return SLIDING
    return _turning_drive(_Turning(scenario))


class SpringOverTurn(NamedTuple):
    """Stiffness of a motor's spring over an electrical turn of a drive that turns evenly."""

    frequency: float
    """Electrical turns per second [Hz]."""
    mean: float
    """[N m/rad]."""
    orders: np.ndarray
    """Cycles per electrical turn, from 1 on, (k,)."""
    amplitude: np.ndarray
    """Complex amplitudes K_k [N m/rad], (k,), of K = mean + sum of K_k exp(2j pi k f_e t) and its
    conjugate."""
    motion: float
    """Largest electrical angle [rad] by which what varies moves the rotor against even motion; at
    most 0.5, beyond which the stiffness is not known."""
    behind: float = 0.0
    """Electrical angle [rad] of the rotor against the command, on average."""


def spring_over_turn(scenario: Scenario) -> SpringOverTurn | None:
    """Find how the motor's spring changes as the drive turns at the rate of the record.

    It is that of the currents that the driver makes, of flux harmonics and of detent torque together,
    at the rotor's own angle: behind the command by the load, and moved by what varies.
    None where the rate changes or is zero, of a pulse drive, and where the motor cannot carry its
    friction.
    """
    if not scenario.rate or scenario.driver.pulsed:
        return None
    return _spring_over_turn(_Turning(scenario))


@lru_cache(maxsize=32)
def _spring_over_turn(turning: _Turning) -> SpringOverTurn | None:
    scenario = turning.scenario
    windings = _Windings.of(scenario)
    if windings is None:
        return None
    count = scenario.driver.beats * scenario.driver.microsteps
    highest = max(scenario.motor.stiffness_orders, default=0)
    each = max(_STEPS_PER_MICROSTEP, math.ceil(_SAMPLES_PER_CYCLE * highest / count))
    samples = each * count
    angle = (np.arange(samples) + 0.5) * (2.0 * math.pi / samples)
    frequency = abs(windings.omega_e) / (2.0 * math.pi)
    at = windings.moved(
        *_mechanics(scenario, False),
        math.copysign(1.0, windings.omega_e) * angle,
        1.0 / (frequency * samples),
    )
    series = np.fft.rfft(windings.coupling(at, True)[0]) / samples
    orders = np.arange(1, samples // 2)
    motion = float(np.abs(at.rotor - at.command - windings.behind).max())
    mean, varying = float(series[0].real), series[1 : samples // 2]
    return SpringOverTurn(frequency, mean, orders, varying, motion, windings.behind)


def dynamic_stiffness_of_windings(
    scenario: Scenario, omega: np.ndarray, *, stands: bool = False
) -> np.ndarray:
    """Stiffness [N m/rad] that windings with their current loop add to the motor's spring where the rotor
    swings at ``omega`` [rad/s] of either sign, complex, (n,); of a drive that turns, or ``stands``.

    Its back-EMF -K_m F (s + j omega_e) theta drives currents through the impedance Z of winding and loop:
    K_m^2/2 (s_+/Z(s_+) + conj(s_-/Z(s_-))) with s_+- = j (omega_e +- omega), of sinusoidal flux.
    """
    motor, rate = scenario.motor, 0.0 if stands else float(scenario.rate or 0.0)
    omega_e = -motor.rotor_teeth * scenario.reducer.h * rate
    own, w = _Windings(scenario, omega_e, 0.0, 1.0, 0.0), np.asarray(omega, dtype=float)
    with_turn, against = (1j * (omega_e + x) / own.impedance(x) for x in (w, -w))
    return np.asarray(0.5 * motor.axis_torque_constant**2 * (with_turn + against.conj()))


class _Turning:
    """A scenario's drive at its rate, one where all that acts is alike."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        motor, reducer = scenario.motor, scenario.reducer
        load = scenario.friction, scenario.array, scenario.mounted
        self._parts = (motor, scenario.driver, reducer, *load, scenario.rate)

    def __hash__(self) -> int:
        return hash(self._parts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Turning) and self._parts == other._parts


@lru_cache(maxsize=32)
def _turning_drive(turning: _Turning) -> TurningDrive:
    scenario = turning.scenario
    system = _System.of(scenario)
    if system is None:
        return SLIDING
    rounding = _ROUNDING * undamped_rounding(scenario) + 1e-9
    growth, constant_growth, decay = _fate_of_deviations(system, scenario)
    on_slope = decay
    if max(scenario.motor.friction.stribeck_torque, scenario.friction.stribeck_torque) > 0.0:
        falling = _System.of(scenario, falling=True)
        assert falling is not None  # the same load
        growth, constant_growth, on_slope = _fate_of_deviations(falling, scenario)
    if growth <= rounding:
        return TurningDrive(0.0, False, decay, on_slope)
    return TurningDrive(growth, constant_growth <= rounding, decay, on_slope)


def _fate_of_deviations(
    system: _System, scenario: Scenario
) -> tuple[float, float, dict[str, float]]:
    """Growth [1/s] of the deviation that grows fastest, that without what varies, and decay of each mode."""
    values, shapes = np.linalg.eig(system.constant)
    exponents, participation = system.exponents(values, shapes)
    decay = {}
    for mode in coupled_modes(scenario):
        own = -mode.decay + 2j * math.pi * mode.frequency
        k = int(np.argmin(np.abs(values - own)))
        parts = exponents[participation[k] > _PARTICIPATION]
        if parts.size:
            decay[mode.name] = -float(np.max(parts))
    return float(np.max(exponents)), float(np.max(values.real)), decay


@dataclass(frozen=True)
class _System:
    """The linear drive with periodic coefficients, x' = (constant + varying(t)) x.

    States are the coordinates of ``drive_matrices``, their rates, and currents and integrals of their
    errors in the frame of the command, real and imaginary.
    """

    constant: np.ndarray
    """(n, n)."""
    varying: np.ndarray
    """In the middles of equal steps of the period, (steps, n, n); empty where nothing varies."""
    period: float
    """[s]."""

    @staticmethod
    def of(scenario: Scenario, falling: bool = False) -> _System | None:
        """System of a scenario, with frictions by their viscous part or, ``falling``, by their slope at
        the rate; None where its motor cannot carry the friction.
        """
        windings = _Windings.of(scenario)
        if windings is None:
            return None
        mechanics = _mechanics(scenario, falling)
        driver = scenario.driver
        microsteps = driver.repeats_after(scenario.motor)
        steps = _steps(scenario, microsteps)
        angle = (np.arange(max(steps, 1)) + 0.5) * (
            2.0 * math.pi * microsteps / (driver.beats * driver.microsteps) / max(steps, 1)
        )
        angle *= math.copysign(1.0, windings.omega_e)
        period = microsteps / float(scenario.driving_frequency or 1.0)
        constant, varying = windings.matrices(
            *mechanics, angle if steps else angle[:0], period / max(steps, 1)
        )
        return _System(constant, varying, period)

    def exponents(self, constant: np.ndarray, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Growth [1/s] of each of the deviations that keep their shape, (n,), and how much the
        ``shapes`` (n, n) of the constant system, with its eigenvalues (n,), take part in them, (n, n).
        """
        if not len(self.varying):
            return constant.real, np.eye(constant.size)
        step = self.period / len(self.varying)
        unit = np.eye(constant.size)
        inverse = np.linalg.inv(shapes)
        if float(np.max(constant.real)) * self.period > _LARGEST_EXPONENT:
            return constant.real, unit  # it grows without what varies, and by too much for figures
        half = ((shapes * np.exp(0.5 * step * constant)) @ inverse).real
        kicks = unit + step * self.varying + (0.5 * step**2) * (self.varying @ self.varying)
        multipliers, vectors = np.linalg.eig(_product(half @ kicks @ half))
        taken = np.abs((inverse @ vectors) * np.linalg.pinv(inverse @ vectors).T)
        with np.errstate(divide="ignore"):
            return np.log(np.abs(multipliers)) / self.period, taken


def _product(factors: np.ndarray) -> np.ndarray:
    """Product of matrices (k, n, n), the first of which acts first."""
    while len(factors) > 1:
        odd = factors[-1:] if len(factors) % 2 else factors[:0]
        pairs = factors[: len(factors) // 2 * 2]
        factors = np.concatenate([pairs[1::2] @ pairs[::2], odd])
    return np.asarray(factors[0])


def _steps(scenario: Scenario, microsteps: int) -> int:
    """Steps of a period of ``microsteps``; 0 where nothing varies in it."""
    driver, motor = scenario.driver, scenario.motor
    turn = driver.beats * driver.microsteps
    highest = max(motor.stiffness_orders, default=0)
    steps = math.ceil(_STEPS_PER_CYCLE * highest * microsteps / turn)
    if 2.0 * math.pi / turn > _LARGE_MICROSTEP or driver.distorted:
        each = max(_STEPS_PER_MICROSTEP, math.ceil(steps / microsteps))
        steps = each * microsteps
    states = 2 * min(scenario.load.H.size, _MANY_MODES) + 8
    return min(steps, _MOST_STEPS, int(_MOST_WORK / states**3))


def _mechanics(scenario: Scenario, falling: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, damping and stiffness without the motor's."""
    motor, reducer, friction = scenario.motor, scenario.reducer, scenario.friction
    if falling:
        rate = float(scenario.rate or 0.0)
        on_rotor = motor.friction.slope(rate * reducer.ratio)
        friction = friction.model_copy(update={"viscous": friction.slope(rate)})
        slid = motor.friction.model_copy(update={"viscous": on_rotor})
        motor = motor.model_copy(update={"friction": slid})
    M, C, K = drive_matrices(motor, reducer, friction, _main_modes(scenario.load))
    K[0, 0] -= motor.electromagnetic_stiffness
    return M, C, K


def _main_modes(load: Load) -> Load:
    """The structure with those of its modes that the shafts move most, if it has many."""
    if load.H.size <= _MANY_MODES:
        return load
    kept = np.sort(np.argsort(-(load.H**2 / load.output + load.R**2 / load.rotor))[:_MANY_MODES])
    names = ("H", "R", "V_l", "V_m", "D", "Omega", "Lambda")
    return Load(
        **{name: getattr(load, name)[kept] for name in names},
        output=load.output,
        rotor=load.rotor,
        cross=load.cross,
        output_left=load.output_left,
        array_left=load.array_left,
    )


class _Angle(NamedTuple):
    """Electrical angles [rad] of command and rotor, and the current in the frame [A], (steps,)."""

    command: np.ndarray
    rotor: np.ndarray
    current: np.ndarray


def _forced_motion(A: np.ndarray, M: np.ndarray, torque: np.ndarray, step: float) -> np.ndarray:
    """Motion of the rotor [rad] about its mean by a periodic ``torque`` [N m] on it, of which a
    value is given every ``step`` [s], (steps,).
    """
    n = M.shape[0]
    pull = np.zeros(A.shape[0])
    pull[n : 2 * n] = np.linalg.inv(M)[:, 0]
    values, shapes = np.linalg.eig(A)
    by_torque = shapes[0] * np.linalg.solve(shapes, pull.astype(complex))
    s = 2j * math.pi * np.fft.rfftfreq(torque.size, step)
    response = np.sum(by_torque / (s[:, None] - values), axis=1)
    return np.fft.irfft(np.fft.rfft(torque) * response, torque.size)


@dataclass(frozen=True)
class _Windings:
    """Currents of the two axes as one complex number, in the frame of the command, where the motor
    turns evenly at the electrical rate ``omega_e``.

    L i' = u - (R + j omega_e L) i - K_m omega F, T_e = K_m Re(i conj F) - detent torque; F are the flux
    shapes, j exp(j z theta) of sinusoidal flux. The loop has u = K_P (i* - i) + K_I x, with x' +
    j omega_e x = i* - i.
    """

    scenario: Scenario
    omega_e: float
    """[rad/s]."""
    behind: float
    """Electrical angle [rad] of the rotor against the command."""
    carried: complex
    """Part of the reference current that flows, over it."""
    driven: complex
    """Current [A] by the back-EMF."""
    load: float = 0.0
    """Torque [N m] that the motor carries on average."""

    @staticmethod
    def of(scenario: Scenario) -> _Windings | None:
        motor, h = scenario.motor, scenario.reducer.h
        rate = float(scenario.rate or 0.0)
        omega = -h * rate
        omega_e = motor.rotor_teeth * omega
        own = _Windings(scenario, omega_e, 0.0, 1.0, 0.0)
        carried = own.response(0.0)
        total = own.impedance(0.0)
        by_emf = -motor.axis_torque_constant * omega * 1j / total
        load = motor.friction.torque(omega) + (motor.eddy_damping or 0.0) * omega
        load -= scenario.friction.torque(rate) / h
        wanted = load / motor.axis_torque_constant - by_emf.imag
        size = abs(carried) * motor.axis_current
        if abs(wanted) >= size:
            return None
        behind = math.atan2(carried.imag, carried.real) - math.asin(wanted / size)
        return _Windings(scenario, omega_e, behind, carried, by_emf * np.exp(1j * behind), load)

    def impedance(self, omega: float | np.ndarray) -> Any:
        """Voltage over current [ohm], loop included, at ``omega`` [rad/s] in the frame."""
        motor, driver = self.scenario.motor, self.scenario.driver
        s = 1j * (np.asarray(omega) + self.omega_e)
        inductance = motor.winding_inductance + driver.derivative_gain
        return motor.winding_resistance + s * inductance + self._loop(s)

    def _loop(self, s: Any) -> Any:
        driver = self.scenario.driver
        if driver.integral_gain == 0.0:
            return driver.proportional_gain
        return driver.proportional_gain + driver.integral_gain / np.where(s == 0.0, _SLOWEST, s)

    def response(self, omega: float | np.ndarray) -> Any:
        """Current over its reference at ``omega`` [rad/s] in the frame."""
        motor, driver = self.scenario.motor, self.scenario.driver
        s = 1j * (np.asarray(omega) + self.omega_e)
        forward = motor.winding_resistance if driver.drive == "voltage" else 0.0
        return (self._loop(s) + forward) / self.impedance(omega)

    def currents(self, angle: np.ndarray) -> np.ndarray:
        """Current [A] in the frame at angles (n,) of the command [rad], with the references' steps
        where there are angles.
        """
        motor, driver = self.scenario.motor, self.scenario.driver
        turn = references_over_electrical_period(driver, motor.axis_current, motor.phases)
        count = driver.beats * driver.microsteps
        fine = _STEPS_PER_MICROSTEP * count
        at = (np.arange(fine) + 0.5) * (2.0 * math.pi / fine)
        step = (np.rint(at * count / (2.0 * math.pi)) % count).astype(int)
        reference = (turn[step, 0] + 1j * turn[step, 1]) * np.exp(-1j * at)
        order = np.fft.fftfreq(fine, 1.0 / fine)
        series = np.fft.fft(reference) / fine * self.response(order * abs(self.omega_e))
        flows = np.fft.ifft(series) * fine
        found = [
            np.interp(angle % (2.0 * math.pi), at, part, period=2.0 * math.pi)
            for part in (flows.real, flows.imag)
        ]
        return np.asarray(found[0] + 1j * found[1] + self.driven)

    def matrices(
        self, M: np.ndarray, C: np.ndarray, K: np.ndarray, angle: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The constant matrix and what varies about it at each ``angle`` (steps,) of the command,
        one every ``step`` [s]; without angles the constant one alone.
        """
        if not angle.size:
            mean = self.carried * self.scenario.motor.axis_current + self.driven
            smooth = _Angle(np.zeros(1), np.full(1, self.behind), np.array([mean]))
            return self._assembled(M, C, K, self.coupling(smooth, False))[0], np.zeros((0, 0, 0))
        at = self.moved(M, C, K, angle, step)
        each = self._assembled(M, C, K, self.coupling(at, True))
        mean = each.mean(axis=0)
        return mean, each - mean

    def moved(
        self, M: np.ndarray, C: np.ndarray, K: np.ndarray, angle: np.ndarray, step: float
    ) -> _Angle:
        """Where the rotor is at each ``angle`` (steps,) of the command, one every ``step`` [s]."""
        current = self.currents(angle)
        rotor = np.full(angle.size, self.behind)
        for _ in range(_MOTION_ITERATIONS):
            at = _Angle(angle, angle + rotor, current)
            stiffness, F, slope = (x.mean(keepdims=True) for x in self.coupling(at, True))
            mean = self._assembled(M, C, K, (stiffness, F, slope))[0]
            moved = _forced_motion(mean, M, self._missing_torque(at), step)
            rotor = self.behind + np.clip(
                self.scenario.motor.rotor_teeth * moved, -_LARGEST_MOTION, _LARGEST_MOTION
            )
        return _Angle(angle, angle + rotor, current)

    def coupling(self, at: _Angle, harmonics: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness [N m/rad], flux shapes and their slope over the electrical angle, (steps,)."""
        motor = self.scenario.motor
        z, p = motor.rotor_teeth, at.rotor
        F, slope = self._flux_shapes(at, harmonics)
        stiffness = -motor.axis_torque_constant * z * (at.current * slope.conj()).real
        if harmonics:
            for order, size, phase in self._detent():
                stiffness += z * order * size * np.cos(order * p + phase)
        return stiffness, F, slope

    def _flux_shapes(self, at: _Angle, harmonics: bool) -> tuple[np.ndarray, np.ndarray]:
        """Flux shapes in the frame and their slope over the rotor's electrical angle, (steps,)."""
        turned = np.exp(1j * (at.rotor - at.command))
        F, slope = 1j * turned, -turned
        if harmonics:
            for one in self.scenario.motor.axis_flux_harmonics:
                turned = one.amplitude * np.exp(
                    1j * (one.sequence * (one.order * at.rotor + one.phase) - at.command)
                )
                F, slope = F + 1j * one.sequence * turned, slope - one.order * turned
        return F, slope

    def _detent(self) -> list[tuple[int, float, float]]:
        """Order, amplitude [N m] and phase [rad] of each harmonic of the detent torque."""
        motor = self.scenario.motor
        further = [(one.order, one.amplitude, one.phase) for one in motor.detent]
        return [(motor.detent_periods, motor.detent_torque, 0.0), *further]

    def _missing_torque(self, at: _Angle) -> np.ndarray:
        """Torque on the rotor [N m] beside the load and that of its mean stiffness, (steps,)."""
        motor = self.scenario.motor
        F, _ = self._flux_shapes(at, True)
        torque = motor.axis_torque_constant * (at.current * F.conj()).real
        for order, size, phase in self._detent():
            torque -= size * np.sin(order * at.rotor + phase)
        stiffness = float(np.mean(self.coupling(at, True)[0]))
        moved = (at.rotor - at.command - self.behind) / motor.rotor_teeth
        return np.asarray(torque - self.load + stiffness * moved)

    def _assembled(
        self,
        M: np.ndarray,
        C: np.ndarray,
        K: np.ndarray,
        coupling: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> np.ndarray:
        """The matrices of the drive for each of the couplings, (steps, n, n)."""
        motor, driver = self.scenario.motor, self.scenario.driver
        n, (stiffness, F, slope) = M.shape[0], coupling
        K_m, L = motor.axis_torque_constant, motor.winding_inductance + driver.derivative_gain
        size = 2 * n + (4 if driver.integral_gain else 2)
        d, x = 2 * n, 2 * n + 2
        A = np.zeros((stiffness.size, size, size))
        inverse = np.linalg.inv(M)
        A[:, :n, n : 2 * n] = np.eye(n)
        A[:, n : 2 * n, :n], A[:, n : 2 * n, n : 2 * n] = -inverse @ K, -inverse @ C
        A[:, n : 2 * n, 0] -= stiffness[:, None] * inverse[:, 0]
        A[:, n : 2 * n, d] = K_m * F.real[:, None] * inverse[:, 0]
        A[:, n : 2 * n, d + 1] = K_m * F.imag[:, None] * inverse[:, 0]
        by_angle = -K_m * self.omega_e * slope / L
        A[:, d, 0], A[:, d + 1, 0] = by_angle.real, by_angle.imag
        A[:, d, n], A[:, d + 1, n] = -K_m * F.real / L, -K_m * F.imag / L
        turn = np.array([[0.0, self.omega_e], [-self.omega_e, 0.0]])
        resistance = motor.winding_resistance + driver.proportional_gain
        A[:, d : d + 2, d : d + 2] = turn - resistance / L * np.eye(2)
        if driver.integral_gain:
            A[:, d : d + 2, x : x + 2] = driver.integral_gain / L * np.eye(2)
            A[:, x : x + 2, d : d + 2] = -np.eye(2)
            A[:, x : x + 2, x : x + 2] = turn
        return A
