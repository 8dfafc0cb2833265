"""The drive linearised about tracking: the array's modes as seen through the drive.

The electromagnetic spring is taken without detent torque (whose stiffness changes sign several
times per electrical turn and averages to nothing), frictions by their viscous part, the
transmission error as nothing. Of a drive without a current loop the windings take part: a rotor
that turns against the command changes the currents by its back-EMF.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from microvib.model.array import Array
from microvib.model.craft import craft_of, shaft_load
from microvib.model.drive_matrices import coordinates, drive_matrices
from microvib.model.driver import motor_of_mean_spring, spring_factors
from microvib.model.friction import Friction
from microvib.model.load import Load
from microvib.model.mode_names import mode_names
from microvib.model.motor import Motor
from microvib.model.reducer import Reducer
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.model.spacecraft import Spacecraft

_MAX_ELEMENTS = 4_000_000
"""Elements of the matrices that are solved together, at most."""
# modes above which the damped eigenproblem, whose work grows with the third power, is not solved as
# a whole
MAX_DENSE_MODES = 300


@dataclass(frozen=True)
class CoupledMode:
    """A natural frequency of drive and array together."""

    name: str
    frequency: float
    damping: float
    fixed_frequency: float | None
    """Frequency with the interface clamped, on a craft with locked hinges [Hz]; None for a
    resonance of the drive itself.
    """

    @property
    def decay(self) -> float:
        """Rate [1/s] at which its ringing dies away."""
        return 2.0 * math.pi * self.frequency * self.damping

    @property
    def eigenvalue(self) -> complex:
        """Eigenvalue s [1/s] with which it rings as Re exp(s t)."""
        omega_d = 2.0 * math.pi * self.frequency
        return omega_d * complex(-self.damping / math.sqrt(1.0 - self.damping**2), 1.0)


def matrices(scenario: Scenario) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, damping and stiffness of the linearised drive; coordinates theta_m, theta_l (not if
    rigid), modes (Eq. 16-18).
    """
    return drive_matrices(held_motor(scenario), scenario.reducer, scenario.friction, scenario.load)


@dataclass(frozen=True)
class LinearLine:
    """A driving line of the linearised drive."""

    order: int
    frequency: float
    amplitude: complex
    """Complex amplitude of T_d, 0-to-peak [N m]; its phase is that of the cosine at a microstep."""
    deviation: complex
    """Complex amplitude of the electrical angle from the field to the rotor, 0-to-peak [rad]."""


def linear_lines(scenario: Scenario, harmonics: int = 8) -> tuple[LinearLine, ...]:
    """Driving lines of T_d in closed form: the microsteps' staircase through the linearised drive
    (Eq. 16-18, 20).

    The command is a ramp and a sawtooth of one microstep's height delta, whose order k has the
    amplitude delta/(pi k); it pulls at the rotor through the electromagnetic spring z K_m I.
    Currents are assumed to follow instantly, those of voltages by their windings, about a rotor
    without load; friction is viscous only, and detent torque, stick and errors of the driver do not
    exist, so that there are no full-step lines; of errors and of a table only the mean of their spring
    counts. A ramp over the part r of a microstep averages the
    staircase, whose order k falls by sinc(k r); what its currents, which go straight from one reference to the
    next, lack of the circle is added. Parts of a microstep multiply the staircase by the spectrum of
    their fractions. Compensation of the gear is left out. Empty where the rate is zero or changes, and of a
    pulse drive, between whose pulses nothing pulls.
    """
    f_d = scenario.driving_frequency
    if not f_d or scenario.driver.pulsed:
        return ()
    order, of_drive = np.arange(1, harmonics + 1), matrices(scenario)
    frequency, pull = order * f_d, staircase_torque(scenario, order)
    if scenario.driver.drive == "voltage":
        by_command = [
            _voltage_drive_stiffness(scenario, 2j * math.pi * f)[0] for f in frequency.tolist()
        ]
        pull *= np.array(by_command) / held_motor(scenario).electromagnetic_stiffness
    lines: list[LinearLine] = []
    for part in frequency_blocks(frequency.size, of_drive[0].shape[0]):
        motion = np.linalg.solve(
            _dynamic(scenario, *of_drive, frequency[part]),
            pull[part, None, None] * _unit_torque(0, of_drive),
        )
        moved = np.sum(momentum_row(scenario, frequency[part]) * motion[..., 0], axis=-1)
        torque = (2.0 * math.pi * frequency[part]) ** 2 * moved
        deviation = motion[:, 0, 0] - pull[part] / held_motor(scenario).electromagnetic_stiffness
        columns = order[part], frequency[part], torque, scenario.motor.rotor_teeth * deviation
        lines += map(LinearLine, *(column.tolist() for column in columns))
    return tuple(lines)


def frequency_blocks(count: int, size: int) -> Iterator[slice]:
    """Parts of ``count`` frequencies whose matrices of ``size`` rows are solved together, in little
    memory.
    """
    step = max(_MAX_ELEMENTS // size**2, 1)
    yield from (slice(first, first + step) for first in range(0, count, step))


def _unit_torque(coordinate: int, matrices: tuple[np.ndarray, ...]) -> np.ndarray:
    """A torque of 1 on one coordinate, as a column."""
    return np.eye(matrices[0].shape[0])[:, [coordinate]]


def disturbance_torque_response(
    scenario: Scenario, frequency: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """Size of T_d by torques on the coordinates of ``matrices`` at each ``frequency`` of (m,) [Hz].

    Parameters
    ----------
    frequency : ndarray
        Frequencies [Hz], (m,).
    torque : ndarray
        Torque on each coordinate [N m], (n,).

    Returns
    -------
    ndarray
        Amplitudes of T_d [N m], (m,).
    """
    of_drive, found = matrices(scenario), np.zeros(frequency.size)
    for part in frequency_blocks(frequency.size, torque.size):
        motion = np.linalg.solve(_dynamic(scenario, *of_drive, frequency[part]), torque[:, None])[
            ..., 0
        ]
        found[part] = np.abs(np.sum(momentum_row(scenario, frequency[part]) * motion, axis=-1))
    return np.asarray((2.0 * math.pi * frequency) ** 2 * found)


@dataclass(frozen=True)
class GearErrorResponse:
    """Response to a transmission error of the output's angle at some frequencies, by the linearised
    drive; all over the error.
    """

    rotor: np.ndarray
    """Motion of the rotor [rad/rad], (m,)."""
    torque: np.ndarray
    """Size of T_d [N m/rad], (m,)."""


def gear_error_response(scenario: Scenario, frequency: np.ndarray) -> GearErrorResponse:
    """Response to a transmission error e at each ``frequency`` of (m,) [Hz].

    With theta_l = e - theta_m/h of a rigid gear the error moves what is on the output; a gear that
    gives is twisted by it.
    """
    reducer, modes = scenario.reducer, scenario.load.H.size
    omega = 2.0 * math.pi * np.asarray(frequency, dtype=float)[:, None, None]
    loose = reducer.model_copy(update={"stiffness": 0.0, "damping": 0.0})
    M, C, K = drive_matrices(held_motor(scenario), loose, scenario.friction, scenario.load)
    dynamic = _dynamic(scenario, M, C, K, frequency)
    if reducer.rigid:
        T = coordinates(reducer, modes)
        moved = np.linalg.solve(T.T @ dynamic @ T, -T.T @ dynamic[..., :, [1]])
        moved = T @ moved
        moved[:, 1] += 1.0
    else:
        twist = np.zeros((M.shape[0], 1))
        twist[:2, 0] = -1.0 / reducer.h, -1.0
        gear = float(reducer.stiffness) + 1j * omega * reducer.damping
        moved = np.linalg.solve(dynamic + gear * (twist @ twist.T), -gear * twist)
    momentum = np.sum(_momentum_of_shafts(scenario, frequency) * moved[..., 0], axis=-1)
    return GearErrorResponse(np.abs(moved[:, 0, 0]), omega[:, 0, 0] ** 2 * np.abs(momentum))


def dynamic_stiffness(
    scenario: Scenario,
    frequency: float | np.ndarray,
    known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Torques by motions in the coordinates of ``matrices``, which may be ``known``, at a ``frequency``
    (...) [Hz], complex, (..., n, n).
    """
    return _dynamic(scenario, *(known or matrices(scenario)), frequency)


def _dynamic(
    scenario: Scenario, M: np.ndarray, C: np.ndarray, K: np.ndarray, frequency: float | np.ndarray
) -> np.ndarray:
    omega = 2.0 * math.pi * np.asarray(frequency, dtype=float)[..., None, None]
    dynamic: np.ndarray = K - omega**2 * M + 1j * omega * C
    if scenario.driver.drive == "voltage":
        by_angle = np.vectorize(
            lambda w: _voltage_drive_stiffness(scenario, 1j * w)[1], otypes=[complex]
        )
        dynamic[..., 0, 0] += (
            by_angle(omega[..., 0, 0]) - held_motor(scenario).electromagnetic_stiffness
        )
    return dynamic


def staircase_torque(scenario: Scenario, order: np.ndarray) -> np.ndarray:
    """Torque of the command's staircase on the rotor at each ``order`` of the driving frequency,
    complex amplitude [N m].
    """
    step = -math.copysign(
        scenario.driver.microstep(scenario.motor), (scenario.rate or 0.0) * scenario.reducer.h
    )
    ramp, teeth = scenario.driver.microstep_ramp, scenario.motor.rotor_teeth
    late = np.exp(-1j * math.pi * order * ramp)
    sawtooth = -1j * step / (math.pi * order) * np.sinc(order * ramp) * late
    if ramp > 0.0:
        sawtooth += late * _chord(teeth * step, order, ramp, _sine_of_lag(scenario)) / teeth
    if scenario.driver.microstep_shape:
        frequency = order * (scenario.driving_frequency or 0.0)
        sawtooth = sawtooth * scenario.driver.shape.spectrum(frequency)
    mean = spring_factors(scenario.driver, scenario.motor).mean
    return np.asarray(mean * scenario.motor.electromagnetic_stiffness * sawtooth)


def _chord(step: float, order: np.ndarray, ramp: float, sine_of_lag: float) -> np.ndarray:
    """Torque at each ``order`` of the driving frequency, over K_m I, by what a ramp on the straight way between
    references a ``step`` [rad, electrical] apart lacks of one on the circle.

    Currents I exp(j theta_e) that step, seen from the mean field, have the orders sin(pi n)/(pi (k + n)), with
    n = step/(2 pi). At rest these are k + n periods in a microstep, which the mean over the part r of one
    multiplies by sinc(r (k + n)); the staircase of angles has sinc(r k) in its place. The torque is that of
    the currents across the field, and of those along it by the sine of the rotor's lag.
    """
    n = step / (2.0 * math.pi)
    up, down = ((np.sinc(ramp * k) - np.sinc(ramp * order)) / k for k in (order + n, order - n))
    part = math.sin(math.pi * n) / math.pi
    return np.asarray(part * (-1j * (up + down) + sine_of_lag * (up - down)))


def _sine_of_lag(scenario: Scenario) -> float:
    """Sine of the electrical angle by which the mean friction keeps the rotor behind the field."""
    motor, rate = scenario.motor, scenario.rate or 0.0
    omega = -scenario.reducer.h * rate
    load = motor.friction.torque(omega) + (motor.eddy_damping or 0.0) * omega
    load -= scenario.friction.torque(rate) / scenario.reducer.h
    stiffness = held_motor(scenario).electromagnetic_stiffness
    return min(max(load * motor.rotor_teeth / stiffness, -1.0), 1.0)


def _voltage_drive_stiffness(scenario: Scenario, s: complex) -> tuple[complex, complex]:
    """Torque on the rotor [N m/rad] by the angle of the commanded voltage over z, and against the
    rotor's own; at s = j omega.

    Seen from a rotor that turns evenly without load, at the angle a (electrical) from the voltage:
    |i| = I cos a, and of small changes (R + s L + j omega_e L) i = j R I exp(-j a) z command - j
    K_m (s + j omega_e) angle.
    """
    circuit = voltage_windings(scenario)
    by_command = circuit.by_command
    by_angle = circuit.by_angle + s * circuit.by_rate
    q = np.linalg.solve(
        circuit.resistance + s * circuit.inductance * np.eye(2),
        np.column_stack([by_command, by_angle]),
    )[1]
    K_m = circuit.torque_constant
    return complex(K_m * q[0]), complex(circuit.spring - K_m * q[1])


@dataclass(frozen=True)
class VoltageWindings:
    """Windings of a drive by voltages about a rotor that turns evenly without load, in the frame of the
    rotor: L i' = -R i + by_command u + by_angle theta_m + by_rate theta_m', and the torque on the
    rotor is K_m i_q - spring theta_m.

    u is the angle of the commanded voltage over z, as an angle of the rotor [rad].
    """

    resistance: np.ndarray
    """Resistance with the turning's reactance [ohm], (2, 2)."""
    inductance: float
    """[H]."""
    by_command: np.ndarray
    """Voltage by the command [V/rad], (2,)."""
    by_angle: np.ndarray
    """Voltage by the rotor's angle [V/rad], (2,)."""
    by_rate: np.ndarray
    """Voltage by its rate [V s/rad], (2,)."""
    torque_constant: float
    """[N m/A]."""
    spring: float
    """[N m/rad]."""


def voltage_windings(scenario: Scenario) -> VoltageWindings:
    """The windings of a scenario whose driver gives voltages, at its rate."""
    motor, omega = held_motor(scenario), -scenario.reducer.h * (scenario.rate or 0.0)
    z, K_m, current = motor.rotor_teeth, motor.axis_torque_constant, motor.axis_current
    R, X = motor.winding_resistance, z * omega * motor.winding_inductance
    a = math.asin(max(-1.0, min(1.0, -K_m * omega / (current * math.hypot(R, X))))) - math.atan2(
        X, R
    )
    return VoltageWindings(
        resistance=np.array([[R, -X], [X, R]]),
        inductance=motor.winding_inductance,
        by_command=R * current * z * np.array([math.sin(a), math.cos(a)]),
        by_angle=K_m * np.array([z * omega, 0.0]),
        by_rate=np.array([0.0, -K_m]),
        torque_constant=K_m,
        spring=z * K_m * current * math.cos(a),
    )


def momentum_row(scenario: Scenario, frequency: float | np.ndarray) -> np.ndarray:
    """Angular momentum about the drive axis for unit rates at a ``frequency`` (...) [Hz], which may
    be complex, of the coordinates of ``matrices`` (Eq. 20), complex, (..., n)."""
    shafts = _momentum_of_shafts(scenario, frequency)
    if not scenario.reducer.rigid:
        return shafts
    return shafts @ coordinates(scenario.reducer, scenario.load.H.size)


def _momentum_of_shafts(scenario: Scenario, frequency: float | np.ndarray) -> np.ndarray:
    """Angular momentum as ``momentum_row``, of rotor, output and modes, whether or not the gear is rigid."""
    load = scenario.load
    modes = (
        load.H + load.R + (load.V_l + load.V_m) / (2j * math.pi * np.asarray(frequency)[..., None])
    )
    shafts = [load.rotor + load.cross, load.output + load.cross]
    return np.concatenate([np.broadcast_to(shafts, (*modes.shape[:-1], 2)), modes], axis=-1)


_CIRCLE_POINTS = 16
_CIRCLE_RADIUS = 1e-3
"""Points and radius, over the eigenvalue's size, of the circle on which a residue is found."""


def rate_step_response(scenario: Scenario, modes: tuple[CoupledMode, ...]) -> np.ndarray:
    """Response of modes to a step of the commanded rate by one in the linearised drive.

    After the step at t = 0 a mode with the eigenvalue s makes T_d = Re(g exp(s t)). With the
    response G of T_d to the commanded angle, g = 2 Res(G, s)/s^2; the residue is the mean of
    G(s + d) d over a circle about s.

    Parameters
    ----------
    scenario : Scenario
        The drive, its currents held; microsteps are taken as infinitely small.
    modes : tuple of CoupledMode
        Some of its ``coupled_modes``.

    Returns
    -------
    ndarray
        g of each mode [N m s/rad], complex (n,).
    """
    of_drive = matrices(scenario)
    turn = np.exp(2j * math.pi * np.arange(_CIRCLE_POINTS) / _CIRCLE_POINTS)
    every = [mode.eigenvalue for mode in coupled_modes(scenario)]
    found = np.zeros(len(modes), dtype=complex)
    for k, mode in enumerate(modes):
        s = mode.eigenvalue
        apart = min((abs(s - x) for x in every if abs(s - x) > 1e-9 * abs(s)), default=abs(s))
        circle = min(_CIRCLE_RADIUS * abs(s), 0.1 * apart) * turn
        values = [_response_to_command(scenario, of_drive, complex(s + d)) for d in circle]
        found[k] = 2.0 * np.mean(np.array(values) * circle) / s**2
    return found


def _response_to_command(
    scenario: Scenario, of_drive: tuple[np.ndarray, np.ndarray, np.ndarray], s: complex
) -> complex:
    """T_d by the commanded angle of the array at a complex frequency [N m/rad]."""
    M, C, K = of_drive
    dynamic = K + s * C + s**2 * M + 0j
    mean = spring_factors(scenario.driver, scenario.motor).mean
    pull = mean * scenario.motor.electromagnetic_stiffness
    if scenario.driver.drive == "voltage":
        by_command, by_angle = _voltage_drive_stiffness(scenario, s)
        dynamic[0, 0] += by_angle - pull
    else:
        by_command = complex(pull)
    rotor = -scenario.reducer.h * by_command * np.eye(M.shape[0])[0]
    motion = np.linalg.solve(dynamic, rotor)
    row = momentum_row(scenario, np.array(s / (2j * math.pi)))
    return complex(-(s**2) * (row @ motion))


def coupled_modes(scenario: GivenScenario) -> tuple[CoupledMode, ...]:
    """Find the natural frequencies of drive and array together.

    Array modes come first, named ``array_mode_1`` and so on, in the order of their frequencies; on
    a craft also ``hub_mode_1``, ``control_mode_1`` and so on, by what holds most of their energy
    (``mode_names``). What holds least of its energy in the array are resonances of the drive (rotor
    on the electromagnetic spring, hub on the reducer), named ``drive_resonance_1`` and so on if
    they oscillate. With more than ``MAX_DENSE_MODES`` modes, those that the drive's damping hardly
    mixes are taken one by one.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive: a scenario, a name of the catalog, or the path of a scenario file.

    Returns
    -------
    tuple of CoupledMode
        Name, frequency [Hz] and damping ratio of each, and its frequency with the interface
        clamped.

    Raises
    ------
    ScenarioError
        Where a name stands for no scenario.
    """
    s = as_scenario(scenario)
    return _coupled_modes(
        held_motor(s), s.reducer, s.friction, s.array, s.mounted, s.driver.drive == "voltage"
    )


def held_motor(scenario: Scenario) -> Motor:
    """The motor with what holds its rotor on average: that of a pulse drive is free between pulses but
    for its detent torque, as if so small a current held it. Where references have errors or a table, the
    current is that whose spring is the mean over an electrical turn.
    """
    motor = scenario.motor
    if not scenario.driver.pulsed:
        return motor_of_mean_spring(scenario.driver, motor)
    alike = motor.current * motor.detent_stiffness / motor.electromagnetic_stiffness
    return motor.model_copy(update={"current": alike})


@lru_cache(maxsize=16)
def _coupled_modes(
    motor: Motor,
    reducer: Reducer,
    friction: Friction,
    array: Array,
    spacecraft: Spacecraft | None,
    voltage: bool = False,
) -> tuple[CoupledMode, ...]:
    J_flex, J_m = reducer.output_inertia, motor.rotor_inertia + reducer.input_inertia
    craft = craft_of(array, spacecraft, J_flex, J_m)
    load = shaft_load(array, spacecraft, J_flex, J_m)
    if craft is None:
        locked = [mode.frequency for mode in array.modes]
    else:
        locked = craft.frequency.tolist()
    names = (
        [f"array_mode_{k + 1}" for k in range(len(locked))] if craft is None else mode_names(craft)
    )
    values, vectors, K = _damped_eigenvalues(motor, reducer, friction, load, voltage)
    n, s = K.shape[0], len(locked)
    keep = values.imag > 1e-9 * np.abs(values)
    values, vectors = values[keep], vectors[:, keep]
    elastic = np.sum(vectors.conj() * _product(K, vectors), axis=0).real
    share = load.Lambda @ np.abs(vectors[n - s :]) ** 2 / np.maximum(elastic, 1e-300)
    # What holds least of its energy in the array is the drive's own; the rest goes by frequency, as
    # the array's modes do.
    by_share = np.argsort(-share, kind="stable")
    oscillates = np.sqrt(load.Lambda) > 0.5 * load.D  # attitude control may not
    order = [k for k in np.argsort(load.Lambda, kind="stable") if oscillates[k]]
    array_columns = sorted(by_share[: len(order)], key=lambda c: abs(values[c]))
    modes = {
        int(k): _mode(names[int(k)], values[c], locked[int(k)])
        for k, c in zip(order, array_columns, strict=False)
    }
    rest = sorted((values[c] for c in by_share[len(order) :]), key=abs)
    drive = [_mode(f"drive_resonance_{i + 1}", value, None) for i, value in enumerate(rest)]
    return (*(modes[k] for k in sorted(modes)), *drive)


def _damped_eigenvalues(
    motor: Motor, reducer: Reducer, friction: Friction, load: Load, voltage: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues [1/s] of drive and load, their shapes (n, ...), and the stiffness (n, n)."""
    M, C, K = drive_matrices(motor, reducer, friction, load)
    # torque of the rotor's motion through the windings, K_m i with L di/dt = -R i - K_m omega: none
    # of a current loop
    windings = (
        np.eye(M.shape[0])[0] * motor.axis_torque_constant * voltage,
        motor.winding_resistance,
        motor.winding_inductance,
    )
    if load.Lambda.size > MAX_DENSE_MODES:
        return *_eigenvalues_large(M, C, K, windings), K
    return *_eigenvalues(M, C, K, windings), K


_GROWTH_NOISE = 10.0
"""Times the largest real part of eigenvalues that, but for rounding, have none above zero."""


def sliding_growth(scenario: Scenario) -> float:
    """Rate [1/s] at which the fastest deviation from smooth sliding grows, both shafts at the rate
    that is commanded; 0 where all die away.

    Friction that falls with the rate takes damping away. Where it takes away more than there is,
    the drive cannot slide evenly: it goes on to a motion of its own, with stick or reversals.
    """
    rate, friction, on_rotor = scenario.rate, scenario.friction, scenario.motor.friction
    if not rate or on_rotor.stribeck_torque == friction.stribeck_torque == 0.0:
        return 0.0
    falling = friction.model_copy(update={"viscous": friction.slope(rate)})
    rotor_rate = rate * scenario.reducer.ratio
    falling_on_rotor = on_rotor.model_copy(update={"viscous": on_rotor.slope(rotor_rate)})
    growth, rounding = (
        _largest_real_part(
            held_motor(scenario).model_copy(update={"friction": rotor}),
            scenario.reducer,
            output,
            scenario.array,
            scenario.mounted,
            scenario.driver.drive == "voltage",
        )
        for output, rotor in ((falling, falling_on_rotor), (friction, on_rotor))
    )
    return growth if growth > _GROWTH_NOISE * max(rounding, 0.0) + 1e-9 else 0.0


def undamped_rounding(scenario: Scenario) -> float:
    """Largest real part [1/s] that rounding gives eigenvalues of the drive about rest, none of which
    is above zero.
    """
    largest = _largest_real_part(
        held_motor(scenario),
        scenario.reducer,
        scenario.friction,
        scenario.array,
        scenario.mounted,
        scenario.driver.drive == "voltage",
    )
    return max(largest, 0.0)


@lru_cache(maxsize=16)
def _largest_real_part(
    motor: Motor,
    reducer: Reducer,
    friction: Friction,
    array: Array,
    spacecraft: Spacecraft | None,
    voltage: bool,
) -> float:
    """Largest real part of the eigenvalues of drive and load [1/s]."""
    J_m = motor.rotor_inertia + reducer.input_inertia
    load = shaft_load(array, spacecraft, reducer.output_inertia, J_m)
    values, _, _ = _damped_eigenvalues(motor, reducer, friction, load, voltage)
    return float(np.max(values.real))


Windings = tuple[np.ndarray, float, float]


def _eigenvalues(
    M: np.ndarray, C: np.ndarray, K: np.ndarray, windings: Windings
) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues [1/s] of the damped system, (2n,) or one more, and its shapes, (n, ...).

    ``windings`` are the torques of their current on the coordinates (n,), resistance and
    inductance; without torques none.
    """
    n, (K_m, R, L) = M.shape[0], windings
    state = np.zeros((2 * n + 1, 2 * n + 1))
    state[:n, n : 2 * n] = np.eye(n)
    state[n : 2 * n, : 2 * n] = -np.linalg.solve(M, np.hstack([K, C]))
    if np.any(K_m):
        state[n : 2 * n, 2 * n] = np.linalg.solve(M, K_m)
        state[2 * n, n:] = np.r_[-K_m / L, -R / L]
    else:
        state = state[:-1, :-1]
    values, vectors = np.linalg.eig(state)
    return values, vectors[:n]


def _eigenvalues_large(
    M: np.ndarray, C: np.ndarray, K: np.ndarray, windings: Windings
) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues in a tenth of the time and less: from the undamped shapes, of which the damping
    mixes few.

    The ``MAX_DENSE_MODES`` shapes that it mixes most are solved together; of each other the damping
    is phi^T C phi / 2.
    """
    from scipy.linalg import eigh

    squares, shapes = eigh(K, M)
    squares = np.maximum(squares, 0.0)
    K_m, R, L = windings
    damping = shapes.T @ _product(C, shapes) + np.outer(K_m @ shapes, K_m @ shapes) / R
    apart = np.abs(np.subtract.outer(squares, squares))
    np.fill_diagonal(apart, np.inf)
    mixing = np.abs(damping) * np.sqrt(squares) / np.maximum(apart, 1e-12 * squares[-1])
    order = np.argsort(-mixing.max(axis=1), kind="stable")
    mixed, alone = order[:MAX_DENSE_MODES], order[MAX_DENSE_MODES:]
    inner = (
        damping[np.ix_(mixed, mixed)] - np.outer(K_m @ shapes[:, mixed], K_m @ shapes[:, mixed]) / R
    )
    values, vectors = _eigenvalues(
        np.eye(MAX_DENSE_MODES), inner, np.diag(squares[mixed]), (K_m @ shapes[:, mixed], R, L)
    )
    sigma = 0.5 * damping[alone, alone]
    single = -sigma + 1j * np.sqrt(np.maximum(squares[alone] - sigma**2, 0.0))
    return np.concatenate([values, single]), np.hstack(
        [shapes[:, mixed] @ vectors, shapes[:, alone]]
    )


def _product(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """``matrix @ vectors``; of many modes, whose matrices are diagonal but for the shafts, without
    their zeros.
    """
    if matrix.shape[0] <= MAX_DENSE_MODES:
        return matrix @ vectors
    from scipy.sparse import csr_array

    return np.asarray(csr_array(matrix) @ vectors)


def _mode(name: str, value: complex, fixed: float | None) -> CoupledMode:
    return CoupledMode(
        name, float(abs(value.imag)) / (2.0 * math.pi), float(-value.real / abs(value)), fixed
    )
