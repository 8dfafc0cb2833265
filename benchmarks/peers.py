"""The drive's equations as general-purpose solvers take them, and the runs of those solvers.

Nothing here comes from microvib's own solver: the right-hand side is written anew from the
equations, in the variables of the paper, so that its lines check microvib's as well as its speed.
Two things are done as an engineer would do them who has a library integrator at hand:

* friction is smoothed, sign(omega) becoming tanh(omega / epsilon), since these integrators know no set-valued law;
* integration is restarted at each microstep, where the reference currents jump.

The disturbance torque is minus the rate of angular momentum, so its mean over an interval follows
from the states at both ends: no jump of the torque is sampled, and nothing is differentiated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numba import njit

from microvib import Scenario

RATE = 16_384.0
"""Intervals per second over which the torque is averaged [Hz]; what folds onto the lines is then
below 1e-4 of them.
"""

IA, IB, XA, XB, TM, WM, TL, WL, MODES = range(9)

Advance = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(times from the microstep on, state at the first of them, reference currents) -> states at the
times, (m, n).
"""


@dataclass(frozen=True)
class Settings:
    """What an engineer would have to choose, and to check by trial."""

    epsilon: float = 1e-6
    """Width of the smoothed friction [rad/s]; it shifts the lines in proportion."""
    rtol: float = 1e-6
    """Relative tolerance."""
    atol: float = 1e-6
    """Absolute tolerance of each state, as a fraction of what one microstep moves of it."""


@dataclass(frozen=True)
class Drive:
    """Compiled right-hand side of one scenario, with what a solver needs beside it."""

    rhs: Callable[[np.ndarray, np.ndarray, np.ndarray], None]
    """``rhs(y, references, f)`` fills ``f``."""
    start: np.ndarray
    rtol: float
    atol: np.ndarray
    momentum: np.ndarray
    """Angular momentum of all that moves is this vector times the state."""


def drive(scenario: Scenario, settings: Settings) -> Drive:
    """The equations of ``scenario``: compliant reducer, PI current loop without voltage limit,
    constant rate.
    """
    reducer, driver = scenario.reducer, scenario.driver
    if (
        reducer.rigid
        or reducer.transmission_error
        or driver.supply_voltage
        or driver.derivative_gain
    ):
        raise ValueError(
            "the peers' right-hand side knows a plain compliant reducer and a PI loop without limit only"
        )
    rhs = _right_hand_side(scenario, settings.epsilon)
    return Drive(
        rhs, _start(scenario), settings.rtol, settings.atol * _sizes(scenario), _momentum(scenario)
    )


def _start(scenario: Scenario) -> np.ndarray:
    """At rest at theta = 0; phase A carries its holding current, which the integral term upholds."""
    y = np.zeros(MODES + 2 * len(scenario.array.modes))
    y[IA] = scenario.motor.current
    y[XA] = (
        scenario.motor.winding_resistance * scenario.motor.current / scenario.driver.integral_gain
    )
    return y


def _sizes(scenario: Scenario) -> np.ndarray:
    """What one microstep moves of each state."""
    motor, driver, array = scenario.motor, scenario.driver, scenario.array
    step = driver.microstep(motor)
    angle = step / scenario.reducer.ratio
    rotor_rate = math.sqrt(motor.electromagnetic_stiffness / scenario.rotor_inertia)
    output_rate = math.sqrt(float(scenario.reducer.stiffness) / scenario.output_inertia)
    integral = motor.winding_resistance * motor.current / driver.integral_gain
    sizes = [
        motor.current,
        motor.current,
        integral,
        integral,
        step,
        step * rotor_rate,
        angle,
        angle * output_rate,
    ]
    for H in array.H:
        sizes += [abs(H) * angle, abs(H) * angle * output_rate]
    return np.array(sizes)


def _momentum(scenario: Scenario) -> np.ndarray:
    """L = J_m omega_m + (J_flex + J) omega_l + H eta' (Eq. 20)."""
    weights = np.zeros(MODES + 2 * len(scenario.array.modes))
    weights[WM] = scenario.rotor_inertia
    weights[WL] = scenario.reducer.output_inertia + scenario.array.inertia
    weights[MODES + 1 :: 2] = scenario.array.H
    return weights


def _friction(friction: Any, epsilon: float) -> Callable[[float], float]:
    """Eq. 5-7 with the sign smoothed."""
    slide, stribeck, viscous = friction.sliding_torque, friction.stribeck_torque, friction.viscous
    inv_rate, shape, inv_epsilon = (
        1.0 / friction.stribeck_rate,
        friction.stribeck_shape,
        1.0 / epsilon,
    )

    @njit(error_model="numpy")
    def torque(rate: float) -> float:
        level = slide
        if stribeck > 0.0:
            x = abs(rate) * inv_rate
            level += stribeck * math.exp(-(x if shape == 1.0 else x**shape))
        smooth = math.tanh(rate * inv_epsilon) if level > 0.0 else 0.0
        return level * smooth + viscous * rate

    return torque


def _right_hand_side(
    scenario: Scenario, epsilon: float
) -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
    """Eq. 2-4 and 16-18 with a compliant reducer; all parameters become constants of the compiled
    code.
    """
    motor, driver, reducer, array = (
        scenario.motor,
        scenario.driver,
        scenario.reducer,
        scenario.array,
    )
    z, K_m, K_d = float(motor.rotor_teeth), motor.torque_constant, motor.detent_torque
    R, inv_L = motor.winding_resistance, 1.0 / motor.winding_inductance
    K_P, K_I = driver.proportional_gain, driver.integral_gain
    inv_J_m, inv_J_L = 1.0 / scenario.rotor_inertia, 1.0 / scenario.output_inertia
    inv_h, K_g, C_g = 1.0 / reducer.ratio, float(reducer.stiffness), reducer.damping
    H, D, Lam, modes = array.H, array.D, array.Lambda, len(array.modes)
    rotor_friction, output_friction = (
        _friction(motor.friction, epsilon),
        _friction(scenario.friction, epsilon),
    )

    @njit(error_model="numpy")
    def rhs(y: np.ndarray, references: np.ndarray, f: np.ndarray) -> None:
        s, c = math.sin(z * y[TM]), math.cos(z * y[TM])
        f[XA], f[XB] = references[0] - y[IA], references[1] - y[IB]
        f[IA] = (K_P * f[XA] + K_I * y[XA] - R * y[IA] + K_m * y[WM] * s) * inv_L
        f[IB] = (K_P * f[XB] + K_I * y[XB] - R * y[IB] - K_m * y[WM] * c) * inv_L
        T_e = K_m * (y[IB] * c - y[IA] * s) - K_d * math.sin(4.0 * z * y[TM])
        T_g = -K_g * (y[TM] * inv_h + y[TL]) - C_g * (y[WM] * inv_h + y[WL])
        pull = 0.0
        for k in range(modes):
            pull += H[k] * (D[k] * y[MODES + 2 * k + 1] + Lam[k] * y[MODES + 2 * k])
        # Eq. 17 with eta'' of Eq. 16 put in: what is left of the inertia is the part rigidly on the
        # shaft.
        alpha = (T_g - output_friction(y[WL]) + pull) * inv_J_L
        f[TM], f[TL] = y[WM], y[WL]
        f[WM] = (T_e - rotor_friction(y[WM]) + T_g * inv_h) * inv_J_m
        f[WL] = alpha
        for k in range(modes):
            eta, rate = y[MODES + 2 * k], y[MODES + 2 * k + 1]
            f[MODES + 2 * k] = rate
            f[MODES + 2 * k + 1] = -D[k] * rate - Lam[k] * eta - H[k] * alpha

    return rhs


# --- solvers ----------------------------------------------------------------------------------------------------------


def lsoda(d: Drive) -> Advance:
    """LSODA through ``odeint``, whose loop over steps is compiled."""
    from scipy.integrate import odeint

    rhs = d.rhs

    @njit
    def f(y: np.ndarray, t: float, references: np.ndarray) -> np.ndarray:
        out = np.empty_like(y)
        rhs(y, references, out)
        return out

    def advance(times: np.ndarray, y: np.ndarray, references: np.ndarray) -> np.ndarray:
        return odeint(f, y, times, args=(references,), rtol=d.rtol, atol=d.atol, mxstep=100_000)

    return advance


def solve_ivp(method: str) -> Callable[[Drive], Advance]:
    """Maker of a run through ``solve_ivp``, whose loop over steps is Python."""
    return partial(_solve_ivp, method)


def _solve_ivp(method: str, d: Drive) -> Advance:
    from scipy.integrate import solve_ivp

    rhs = d.rhs

    @njit
    def f(t: float, y: np.ndarray, references: np.ndarray) -> np.ndarray:
        out = np.empty_like(y)
        rhs(y, references, out)
        return out

    def advance(times: np.ndarray, y: np.ndarray, references: np.ndarray) -> np.ndarray:
        span = (times[0], times[-1])
        solution = solve_ivp(
            f, span, y, method=method, t_eval=times, args=(references,), rtol=d.rtol, atol=d.atol
        )
        if not solution.success:
            raise RuntimeError(solution.message)
        return solution.y.T

    return advance


def cvode(d: Drive) -> Advance:
    """CVODE of SUNDIALS, variable-order BDF with Newton iteration, through scikit-sundae."""
    from sksundae.cvode import CVODE

    rhs = d.rhs

    @njit
    def f(t: float, y: np.ndarray, yp: np.ndarray, user: tuple[np.ndarray]) -> None:
        rhs(y, user[0], yp)

    # One solver for the whole run; userdata is read at each call, so the references are changed in
    # place.
    current = np.zeros(2)
    solver = CVODE(
        f, userdata=(current,), method="BDF", rtol=d.rtol, atol=d.atol, max_num_steps=100_000
    )

    def advance(times: np.ndarray, y: np.ndarray, references: np.ndarray) -> np.ndarray:
        current[:] = references
        # With a middle time the solver returns the states at these times; with two times, all of
        # its own steps.
        between = times.size == 2
        solution = solver.solve(np.insert(times, 1, times.mean()) if between else times, y)
        if not solution.success:
            raise RuntimeError(str(solution.message))
        return np.delete(solution.y, 1, axis=0) if between else solution.y

    return advance


SOLVERS: dict[str, tuple[str, Callable[[Drive], Advance]]] = {
    "SciPy LSODA (odeint)": ("scipy", lsoda),
    "SciPy LSODA (solve_ivp)": ("scipy", solve_ivp("LSODA")),
    "SciPy Radau (solve_ivp)": ("scipy", solve_ivp("Radau")),
    "scikit-sundae CVODE": ("sksundae", cvode),
}
"""Name -> (module that it needs, maker of its ``Advance``)."""
INSTALL = {"scipy": "scipy", "sksundae": "scikit-sundae"}

# --- one run ----------------------------------------------------------------------------------------------------------


def intervals(scenario: Scenario, stop: float) -> Iterator[tuple[float, float, np.ndarray]]:
    """Times between microsteps up to ``stop`` [s], with the reference currents that hold there (Eq.
    1, 25).
    """
    motor, driver = scenario.motor, scenario.driver
    rate = (
        -scenario.reducer.ratio * float(scenario.rate or 0.0) / driver.microstep(motor)
    )  # microsteps per second
    begin, k = 0.0, 0
    while begin < stop:
        end = min((k + 0.5) / abs(rate), stop)
        yield begin, end, np.array(driver.reference_currents(motor, int(math.copysign(k, rate))))
        begin, k = end, k + 1


def prepare(
    scenario: Scenario, maker: Callable[[Drive], Advance], settings: Settings
) -> Callable[[], np.ndarray]:
    """A run of ``scenario``, compiled and ready: called, it returns the mean torques of its record,
    at RATE.
    """
    d = drive(scenario, settings)
    advance = maker(d)
    _warm_up(scenario, d, advance)

    def run() -> np.ndarray:
        record = scenario.record
        edges = record.settle + (np.arange(round(record.duration * RATE) + 1) - 0.5) / RATE
        at_edges = np.empty(edges.size)
        y, done = d.start, 0
        for begin, end, references in intervals(scenario, edges[-1]):
            last = int(np.searchsorted(edges, end, side="right"))
            inside = edges[done:last]
            times = np.unique(np.concatenate([[begin], inside, [end]]))
            states = advance(times, y, references)
            at_edges[done:last] = states[np.searchsorted(times, inside)] @ d.momentum
            y, done = states[-1].copy(), last
        return -np.diff(at_edges) * RATE

    return run


def _warm_up(scenario: Scenario, d: Drive, advance: Advance) -> None:
    """Compile before the clock runs."""
    begin, end, references = next(intervals(scenario, 1e-4))
    advance(np.linspace(begin, end, 4), d.start, references)
