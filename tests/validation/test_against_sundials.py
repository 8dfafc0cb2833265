"""The smooth equations of the drive, written a second time from the design note, and integrated by other solvers.

Nothing here is taken from the kernel but its state at given times: modes are in (eta, d eta/dt) with the full mass
matrix, microsteps come from Eq. 1 and 26, and CVODE (or SciPy's Radau) is started afresh at every microstep.
"""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sksundae.cvode import CVODE
from support.scenarios import ERROR, NO_FRICTION, RIGID, baseline
from support.stopped import rows_at

from microvib.solve import kernel

SMOOTH = {
    "sources": {},
    **NO_FRICTION,
    "motor.friction.viscous": 0.02,
    "reducer.stiffness": 6406.0,
    "reducer.damping": 0.275,
}
NO_MODES = {"array.modes": [], "array.rigid_inertia": None, "array.inertia": 0.16}
THREE_MODES = {
    "array.rigid_inertia": None,
    "array.modes": [
        {"frequency": 0.4, "damping": 0.005, "effective_inertia": 5.0},
        {"frequency": 1.19, "damping": 0.01, "participation": -1.5},
        {"frequency": 31.0, "damping": 0.02, "effective_inertia": 0.6},
    ],
}
# R I is 3.6 V; what is left of 4.5 V moves a current by 0.07 A/ms, so that a microstep's 0.06 A stays at the limit.
LIMITED = {"driver.supply_voltage": 4.5, "tracking.rate": math.radians(0.2)}
ERRORS = {
    "driver.imperfections": {
        "gain_b": 0.05,
        "offset_a": 0.03,
        "offset_b": -0.02,
        "quadrature": 0.04,
        "dac_bits": 8,
    },
    "driver.delay": 3e-3,
}
TABLE = {
    "driver.table": {
        "harmonics": [
            {"order": 1, "amplitude": 0.02, "phase": 0.4},
            {"order": 4, "amplitude": 0.011},
        ]
    }
}
RAMP = {"driver.microstep_ramp": 0.6, "tracking.clock_ratio": 1.0017}
PARTS = {
    "driver.microstep_shape": [
        {"fraction": 0.3},
        {"fraction": 0.45, "after": 0.004},
        {"fraction": 0.25, "after": 0.0131},
    ]
}
COMPENSATION = {
    "driver.compensation": [
        {"order": 2, "amplitude": 2e-4, "phase": 0.3},
        {"order": 200, "amplitude": 1e-5, "phase": -1.1},
    ]
}
"""That of ERROR."""
CASES = {
    "compliant reducer, one mode": {},
    "compliant reducer, three modes": THREE_MODES,
    "compliant reducer, rigid load": NO_MODES,
    "rigid reducer, one mode": RIGID,
    "rigid reducer, three modes": {**RIGID, **THREE_MODES},
    "rigid reducer, rigid load": {**RIGID, **NO_MODES},
    "inertia on the reducer's output": {"reducer.output_inertia": 0.05},
    "viscous friction on the output": {"friction.viscous": 3.0},
    "derivative gain": {"driver.derivative_gain": 0.02},
    "supply limit": LIMITED,
    "supply limit and derivative gain": {**LIMITED, "driver.derivative_gain": 0.02},
    "no integral gain": {"driver.integral_gain": 0.0},
    "turning back, slow clock": {
        "tracking.rate": -math.radians(0.1),
        "tracking.clock_ratio": 0.994,
    },
    "compliant reducer with transmission error": ERROR,
    "rigid reducer with transmission error": {**RIGID, **ERROR},
    "errors of the references": ERRORS,
    "errors of the references, no integral gain": {**ERRORS, "driver.integral_gain": 0.0},
    "errors of the references, supply limit": {**ERRORS, **LIMITED},
    "errors of the references, rigid reducer": {**ERRORS, **RIGID, **ERROR},
    "table of currents, dead band": {**TABLE, "driver.imperfections.dead_band": 0.06},
    "ramps": RAMP,
    "ramps over the whole microstep": {"driver.microstep_ramp": 1.0},
    "ramps, errors of the references": {**RAMP, **ERRORS, **TABLE},
    "short ramps, supply limit": {**LIMITED, "driver.microstep_ramp": 0.05},
    "microsteps in parts": PARTS,
    "microsteps in parts, supply limit": {
        **LIMITED,
        "driver.microstep_shape": [{}, {"fraction": 0.5, "after": 2e-3}],
    },
    "microsteps in parts, errors of the references, turning back": {
        **PARTS,
        **ERRORS,
        "tracking.rate": -math.radians(0.05),
    },
    "compensation": {**ERROR, **COMPENSATION},
    "compensation, microsteps in parts": {
        **ERROR,
        **COMPENSATION,
        **PARTS,
        "tracking.rate": -math.radians(0.04),
    },
    "compensation, ramps, rigid reducer": {
        **RAMP,
        **RIGID,
        **ERROR,
        **COMPENSATION,
        "driver.microstep_ramp": 0.3,
    },
    "ramps, no integral gain, rigid reducer": {**RAMP, **RIGID, "driver.integral_gain": 0.0},
}
LONG = ("rigid reducer, one mode", "supply limit")
"""Cases of which another has all that they have, and more."""
EACH = [pytest.param(case, marks=pytest.mark.long) if case in LONG else case for case in CASES]
END = 0.2  # eight microsteps and more; every quantity is by then far from where it began
TIMES = np.linspace(0.0, END, 21)[1:]


class Reference:
    """Section 1 of the design note. State: i_A, i_B, x_A, x_B, theta_m, theta_l, eta, omega_m, omega_l, d eta/dt."""

    def __init__(self, scenario):
        self.s = s = scenario
        self.rigid = s.reducer.rigid  # asked for at every evaluation
        # state-1 leaves the one participation to J_h = J - H^2
        left = s.array.inertia - (s.array.rigid_inertia or 0.0)
        self.H = np.array(
            [m.participation or math.sqrt(m.effective_inertia or left) for m in s.array.modes]
        )
        omega = 2 * math.pi * np.array([m.frequency for m in s.array.modes])
        self.Lambda, self.D = omega**2, 2 * np.array([m.damping for m in s.array.modes]) * omega
        self.J_m = s.motor.rotor_inertia + s.reducer.wave_generator_inertia
        self.J = s.reducer.output_inertia + s.array.inertia
        n = self.H.size
        M = np.eye(1 + n)
        M[0, 0], M[0, 1:], M[1:, 0] = self.J, self.H, self.H
        self.M_inverse = np.linalg.inv(M)
        self.limited = 0

    def microsteps(self, end):
        """Times at which the references change, the count round(n theta_cmd / Delta theta) after the
        microstep, and the part of it that is made."""
        s = self.s
        turned = -s.reducer.ratio * s.tracking.rate * s.tracking.clock_ratio
        per_second = (
            s.driver.microsteps * turned / (2 * math.pi / (s.driver.beats * s.motor.rotor_teeth))
        )
        way = math.copysign(1.0, per_second)
        parts = [(p.after, p.fraction) for p in s.driver.microstep_shape] or [(0.0, 1.0)]
        parts[0] = 0.0, 1.0 - sum(fraction for _, fraction in parts[1:])
        times = []
        for j in range(1, int(abs(per_second) * (end + 0.2)) + 30):
            # the output stands where it should while the rotor passes the middle of the microstep
            rotor = way * (j - 0.5) * abs(turned / per_second)
            made_up_for = self.compensated(rotor) - self.compensated(0.0)
            times.append(s.driver.delay + (rotor - s.reducer.ratio * made_up_for) / turned)
        found = []
        self.ramps = {0: 0.0}
        for j, (t, following) in enumerate(pairwise(times), 1):
            self.ramps[way * j] = s.driver.microstep_ramp * (following - t)
            found += [(t + after, way * j, fraction) for after, fraction in parts]
        return sorted(event for event in found if event[0] < end)

    def compensated(self, rotor):
        return sum(
            c.amplitude * math.sin(c.order * rotor + c.phase) for c in self.s.driver.compensation
        )

    def goal(self, k):
        """References after the microstep k, with the driver's errors."""
        driver, current = self.s.driver, self.s.motor.current
        errors, angle = driver.imperfections, 2 * math.pi * k / (driver.beats * driver.microsteps)
        if driver.table is not None:
            angle += sum(
                h.amplitude * math.sin(h.order * angle + h.phase) for h in driver.table.harmonics
            )
        a = math.cos(angle) + errors.offset_a
        b = (1 + errors.gain_b) * math.sin(angle + errors.quadrature) + errors.offset_b
        found = []
        for x in (a, b):
            x = 0.0 if abs(x) < errors.dead_band else x
            if errors.dac_bits is not None:
                size = 1.0 / (2 ** (errors.dac_bits - 1) - 1)
                x = size * round(x / size)
            found.append(current * x)
        return found

    def command(self, k, t=0.0, part=1.0):
        """From the time t on, on the way from what references were to what they are after the microstep k, or
        a part of it."""
        before = self.goal(k) if k == 0 else self.references(t)
        after = self.goal(k)
        if part != 1.0:
            last = self.goal(k - int(math.copysign(1, k)))
            after = [b + part * (x - y) for b, x, y in zip(before, after, last, strict=True)]
        self.way, self.ramp = (t, before, after), self.ramps[k]

    def references(self, t):
        begun, before, after = self.way
        part = min((t - begun) / self.ramp, 1.0) if self.ramp else 1.0
        return [a + part * (b - a) for a, b in zip(before, after, strict=True)]

    def start(self):
        s, n = self.s, self.H.size
        y = np.zeros(8 + 2 * n)
        K_P, K_I = s.driver.proportional_gain, s.driver.integral_gain
        R = s.motor.winding_resistance
        # Eq. 2 and 3 at rest: u = R i, and with an integral there is no error.
        for i, held in enumerate(self.goal(0)):
            y[i] = held if K_I else K_P * held / (K_P + R)
            y[2 + i] = R * held / K_I if K_I else 0.0
        y[5] = self.epsilon(0.0)[0]
        return y

    def epsilon(self, theta_m):
        if not self.s.reducer.transmission_error:
            return 0.0, 0.0, 0.0
        parts = [
            (e.order, e.amplitude, e.order * theta_m + e.phase)
            for e in self.s.reducer.transmission_error
        ]
        return (
            sum(a * math.sin(x) for _, a, x in parts),
            sum(n * a * math.cos(x) for n, a, x in parts),
            -sum(n * n * a * math.sin(x) for n, a, x in parts),
        )

    def winding(self, i, x, reference, emf):
        """di/dt and the rate of the integral; at the limit the integral tracks what the limited voltage asks for."""
        d, m = self.s.driver, self.s.motor
        wanted = d.proportional_gain * (reference - i) + d.integral_gain * x
        di = (wanted - m.winding_resistance * i + emf) / (m.winding_inductance + d.derivative_gain)
        u = wanted - d.derivative_gain * di
        limit = d.supply_voltage or math.inf
        if abs(u) <= limit:
            return di, reference - i
        self.limited += 1
        u = math.copysign(limit, u)
        di = (u - m.winding_resistance * i + emf) / m.winding_inductance
        return di, (u - d.integral_gain * x) / d.proportional_gain

    def rates(self, t, y):
        s, m, n, f = self.s, self.s.motor, self.H.size, np.empty(y.size)
        i_A, i_B, x_A, x_B, theta_m, theta_l = y[:6]
        eta, (omega_m, omega_l), eta_rate = y[6 : 6 + n], y[6 + n : 8 + n], y[8 + n :]
        sin, cos = math.sin(m.rotor_teeth * theta_m), math.cos(m.rotor_teeth * theta_m)
        epsilon, slope, curvature = self.epsilon(theta_m)
        G = slope - 1.0 / s.reducer.ratio
        if self.rigid:
            omega_l = G * omega_m
        reference = self.references(t)
        di_A, dx_A = self.winding(i_A, x_A, reference[0], m.torque_constant * omega_m * sin)
        di_B, dx_B = self.winding(i_B, x_B, reference[1], -m.torque_constant * omega_m * cos)
        T_e = m.torque_constant * (i_B * cos - i_A * sin) - m.detent_torque * math.sin(
            4 * m.rotor_teeth * theta_m
        )
        T_fm, T_f = m.friction.viscous * omega_m, s.friction.viscous * omega_l
        elastic = -self.D * eta_rate - self.Lambda * eta
        if self.rigid:
            # Virtual work along theta_l = epsilon(theta_m) - theta_m/h; alpha_l = G alpha_m + epsilon'' omega_m^2.
            bend = curvature * omega_m**2
            M = np.eye(1 + n)
            M[0, 0], M[0, 1:], M[1:, 0] = self.J_m + G * G * self.J, G * self.H, G * self.H
            force = np.append(T_e - T_fm - G * (T_f + self.J * bend), elastic - self.H * bend)
            acceleration = np.linalg.solve(M, force)
            alpha_m = acceleration[0]
            alpha_l, eta_acc = G * alpha_m + bend, acceleration[1:]
        else:
            T_g = s.reducer.stiffness * (epsilon - theta_m / s.reducer.ratio - theta_l)
            T_g += s.reducer.damping * (G * omega_m - omega_l)
            alpha_m = (T_e - T_fm - G * T_g) / self.J_m
            acceleration = self.M_inverse @ np.append(T_g - T_f, elastic)
            alpha_l, eta_acc = acceleration[0], acceleration[1:]
        f[:6], f[6 : 6 + n] = (di_A, di_B, dx_A, dx_B, omega_m, omega_l), eta_rate
        f[6 + n], f[7 + n], f[8 + n :] = alpha_m, alpha_l, eta_acc
        return f

    def row(self, t, y):
        n = self.H.size
        theta_l, omega_l = y[5], y[7 + n]
        if self.rigid:
            epsilon, slope, _ = self.epsilon(y[4])
            theta_l, omega_l = (
                epsilon - y[4] / self.s.reducer.ratio,
                (slope - 1 / self.s.reducer.ratio) * y[6 + n],
            )
        f = self.rates(t, y)
        T_d = -(self.J * f[7 + n] + self.H @ f[8 + n :] + self.J_m * f[6 + n])
        return np.concatenate(
            [[y[0], y[1], y[4], y[6 + n], theta_l, omega_l, T_d], y[6 : 6 + n], y[8 + n :]]
        )

    def run(self, times, leg):
        """Rows of (i_A, i_B, theta_m, omega_m, theta_l, omega_l, T_d, eta..., eta_rate...) at ``times``."""
        microsteps = self.microsteps(times[-1])
        ends = [
            (t + self.ramps[k], None, 1.0)
            for t, k, _ in microsteps
            if self.ramps[k] > 0.0 and t + self.ramps[k] < times[-1]
        ]
        self.command(0)
        y, t, rows = self.start(), 0.0, []
        for stop, k, part in [
            *sorted([*microsteps, *ends], key=lambda event: event[0]),
            (times[-1], None, 1.0),
        ]:
            inside = times[(times > t) & (times <= stop)]
            if stop - t > 1e-12:
                states = leg(self.rates, t, y, np.unique([*inside, stop]))
                rows += [self.row(when, states[q]) for q, when in enumerate(inside)]
                y, t = states[-1], stop
            if k is not None:
                self.command(k, stop, part)
        return np.array(rows)

    def names(self):
        n = self.H.size
        modal = [f"eta_{k}" for k in range(n)] + [f"eta_rate_{k}" for k in range(n)]
        return ["i_A", "i_B", "theta_m", "omega_m", "theta_l", "omega_l", "T_d", *modal]

    def scales(self, rows):
        """Angles count in microsteps (they only grow), all else in its own largest value."""
        step = (
            2
            * math.pi
            / (self.s.driver.beats * self.s.motor.rotor_teeth * self.s.driver.microsteps)
        )
        sizes = np.abs(rows).max(axis=0)
        sizes[2], sizes[4] = step, step / self.s.reducer.ratio
        return sizes


def cvode(rates, t, y, times):
    def fill(t, y, yp):
        yp[:] = rates(t, y)

    solution = CVODE(fill, rtol=1e-12, atol=1e-17, max_num_steps=100_000).solve(
        np.concatenate([[t], times]), y
    )
    assert solution.success
    return (
        solution.y[1:] if times.size > 1 else solution.y[-1:]
    )  # two times mean: every internal step between


def radau(rates, t, y, times):
    solution = solve_ivp(
        rates, (t, times[-1]), y, method="Radau", t_eval=times, rtol=1e-9, atol=1e-14
    )
    assert solution.success
    return solution.y.T


def kernel_rows(scenario, times):
    """The same rows from the kernel, which is stopped at ``times``."""
    names = ["i_A", "i_B", "theta_m", "omega_m", "theta_l", "omega_l", "T_d"]
    rows, packed = rows_at(scenario, times)
    return rows[
        :,
        [
            *(kernel.CHANNELS.index(name) for name in names),
            *range(kernel.N_CHANNELS, packed.channels),
        ],
    ]


@cache
def cvode_rows(case):
    reference = Reference(scenario_of(case))
    return reference, reference.run(TIMES, cvode)


def scenario_of(case, accuracy=5e-4):
    return baseline().with_si({**SMOOTH, "solver.accuracy": accuracy, **CASES[case]})


def deviations(reference, expected, found):
    return dict(
        zip(
            reference.names(),
            np.abs(found - expected).max(axis=0) / reference.scales(expected),
            strict=True,
        )
    )


@pytest.mark.parametrize("case", EACH)
def test_kernel_converges_to_what_cvode_finds(case):
    reference, expected = cvode_rows(case)
    found = kernel_rows(scenario_of(case, 2.5e-9), TIMES)
    for name, deviation in deviations(reference, expected, found).items():
        assert deviation < 5e-9, (
            name
        )  # worst measured 2.1e-9, with a supply limit and a derivative gain


@pytest.mark.parametrize("case", EACH)
def test_default_settings_are_within_three_parts_in_ten_thousand_of_cvode(case):
    reference, expected = cvode_rows(case)
    found = kernel_rows(scenario_of(case), TIMES)
    # Worst measured 4.5e-5, with a supply limit and a derivative gain.
    for name, deviation in deviations(reference, expected, found).items():
        assert deviation < 3e-4, name


def test_kernel_converges_to_what_radau_finds():
    reference = Reference(scenario_of("compliant reducer, three modes"))
    expected = reference.run(TIMES[:8], radau)
    found = kernel_rows(scenario_of("compliant reducer, three modes", 1e-10), TIMES[:8])
    for name, deviation in deviations(reference, expected, found).items():
        assert deviation < 5e-9, name  # worst measured 7e-10


@pytest.mark.parametrize("case", [case for case in CASES if "limit" in case and case not in LONG])
def test_the_limited_cases_do_reach_the_limit(case):
    reference, expected = cvode_rows(case)
    assert reference.limited > 1000


def test_reference_and_kernel_disagree_where_an_equation_is_changed():
    """The comparison can fail: without detent torque in one of the two it is off by far more than the tolerance."""
    reference, expected = cvode_rows("compliant reducer, one mode")
    found = kernel_rows(
        scenario_of("compliant reducer, one mode").with_si({"motor.detent_torque": 0.0}), TIMES
    )
    assert deviations(reference, expected, found)["T_d"] > 1e-2
