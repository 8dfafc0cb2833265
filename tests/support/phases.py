"""Windings integrated phase by phase by SciPy; nothing here is taken from the kernel."""

import math

import numpy as np
from scipy.integrate import solve_ivp


class Phases:
    """A drive with a winding for each phase, their axes spread evenly over the electrical turn (of two phases, a quarter apart).

    Each phase has its own loop, or its own voltage. Windings are connected in star, whose neutral floats to where the currents add up
    to nothing, or are fed apart. Motion is that of rotor and output on the gear.
    """

    def __init__(self, scenario, connection):
        self.s, self.star = scenario, connection == "star"
        m = scenario.motor.phases
        self.axes = np.array([0.0, math.pi / 2]) if m == 2 else 2 * math.pi * np.arange(m) / m
        self.m = m
        each = [(h.order, h.amplitude, h.phase) for h in scenario.motor.flux_harmonics]
        order, amplitude, phase = np.array(each).reshape(-1, 3).T
        self.flux = order[:, None], amplitude, phase[:, None]

    def goal(self, k):
        """References of the phases after the microstep ``k`` [A]."""
        driver, errors = self.s.driver, self.s.driver.imperfections
        angle = 2 * math.pi * k / (driver.beats * driver.microsteps) - self.axes
        angle[1] += errors.quadrature
        x = np.cos(angle)
        x[1] *= 1 + errors.gain_b
        x[0] += errors.offset_a
        x[1] += errors.offset_b
        if errors.dac_bits:
            x = np.round(x, 12)  # a half of the current is one
            x = np.rint(x * (2 ** (errors.dac_bits - 1) - 1)) / (2 ** (errors.dac_bits - 1) - 1)
        return self.s.motor.current * x

    def __call__(self, t, y):
        s, m, motor, driver = self.s, self.m, self.s.motor, self.s.driver
        i, x, (tm, wm, tl, wl) = y[:m], y[m : 2 * m], y[2 * m :]
        begun, before, after, ramp = self.way
        reference = before + (after - before) * (min((t - begun) / ramp, 1.0) if ramp else 1.0)
        electrical = motor.rotor_teeth * tm - self.axes
        order, amplitude, phase = self.flux
        shape = np.sin(electrical) + amplitude @ np.sin(order * electrical + phase)
        emf = motor.torque_constant * wm * shape
        if driver.drive == "voltage":
            u = motor.winding_resistance * reference
        else:
            u = driver.proportional_gain * (reference - i) + driver.integral_gain * x
        across = u - motor.winding_resistance * i + emf
        if self.star:
            across = across - across.mean()
        T_e = -motor.torque_constant * i @ shape
        T_e -= motor.detent_torque * math.sin(
            (motor.detent_order or 2 * m) * motor.rotor_teeth * tm
        )
        for h in motor.detent:
            T_e -= h.amplitude * math.sin(h.order * motor.rotor_teeth * tm + h.phase)
        braked = (motor.friction.viscous + (motor.eddy_damping or 0.0)) * wm
        g = s.reducer
        T_g = g.stiffness * (-tm / g.ratio - tl) + g.damping * (-wm / g.ratio - wl)
        am = (T_e - braked + T_g / g.ratio) / s.rotor_inertia
        al = (T_g - s.friction.viscous * wl) / s.output_inertia
        return np.concatenate([across / motor.winding_inductance, reference - i, [wm, am, wl, al]])

    def run(self, times):
        """Rows of theta_m, omega_m, theta_l, omega_l, T_d, power of the sources and energy in the windings at ``times``."""
        s, m = self.s, self.m
        ratio = (
            s.driver.beats
            * s.motor.rotor_teeth
            * s.driver.microsteps
            * s.reducer.ratio
            / (2 * math.pi)
        )
        per_second = -ratio * s.tracking.rate * s.tracking.clock_ratio
        ramp = s.driver.microstep_ramp / abs(per_second)
        y, t = np.zeros(2 * m + 4), 0.0
        y[:m] = self.goal(0)
        if self.star:
            y[:m] -= y[:m].mean()
        if s.driver.integral_gain:
            y[m : 2 * m] = s.motor.winding_resistance * self.goal(0) / s.driver.integral_gain
        self.way, rows, k = (0.0, self.goal(0), self.goal(0), 0.0), [], 0
        while t < times[-1]:
            stop = (abs(k) + 0.5) / abs(per_second)
            breaks = [x for x in (self.way[0] + self.way[3], stop) if t + 1e-12 < x < times[-1]] + [
                times[-1]
            ]
            end = min(breaks)
            inside = times[(times > t) & (times <= end)]
            out = solve_ivp(
                self, (t, end), y, "LSODA", t_eval=np.unique([*inside, end]), rtol=1e-10, atol=1e-13
            )
            rows += [
                self.row(when, state)
                for when, state in zip(out.t, out.y.T, strict=True)
                if when in inside
            ]
            y, t = out.y[:, -1], end
            if end == stop:
                k += int(math.copysign(1, per_second))
                self.way = (t, self.way[2], self.goal(k), ramp)
        return np.array(rows)

    def row(self, t, y):
        f, s, m = self(t, y), self.s, self.m
        T_d = -s.output_inertia * f[2 * m + 3] - s.rotor_inertia * f[2 * m + 1]
        return [*y[2 * m :], T_d, 0.5 * s.motor.winding_inductance * y[:m] @ y[:m]]
