"""Stick and slip against an automaton written from the design note, with SciPy's LSODA and its event location.

Each friction is -1, 0 or +1: slipping towards that sign, or stuck. A slip ends where its velocity is zero: the body
sticks if T_s + N_c p mu r can hold it, else it slips the way it is pushed. A stick ends where more must be held.
"""

import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.scenarios import NO_FRICTION, ON_ROTOR, RIGID, THREE_MODES, baseline
from support.stopped import rows_at

from microvib.solve import kernel

NO_OUTPUT = {**NO_FRICTION, "friction.viscous": 0.0}
CASES = {
    "Table 3": {},
    "Table 3, light damping in the reducer": {
        "reducer.stiffness": 6406.0,
        "reducer.damping": 0.275,
    },
    "Table 3, rigid reducer": RIGID,
    "Table 3, three modes": THREE_MODES,
    "friction on rotor and output": ON_ROTOR,
    "friction on rotor and output, rigid reducer": {**ON_ROTOR, **RIGID},
    "friction on the rotor": {**ON_ROTOR, **NO_OUTPUT},
    "Stribeck exponent 2, turning back": {
        "friction.stribeck_shape": 2.0,
        "tracking.rate": -math.radians(0.06),
    },
}
END = 0.3
TIMES = np.arange(1, 601) * (END / 600)
NAMES = ("theta_m", "omega_m", "theta_l", "omega_l", "T_d")


class Law:
    """Eq. 5-7 on one shaft."""

    def __init__(self, f):
        ring = f.slip_ring
        self.ring = (
            ring.contact_pairs * ring.contact_force * ring.friction_factor * ring.ring_radius
            if ring
            else 0.0
        )
        self.f = f
        self.breakaway = f.breakaway + self.ring

    def torque(self, way, omega):
        f, speed = self.f, max(way * omega, 0.0)
        falling = (f.breakaway - f.coulomb) * math.exp(
            -((speed / f.stribeck_rate) ** f.stribeck_shape)
        )
        return way * (f.coulomb + falling + self.ring) + f.viscous * omega


class Automaton:
    """Section 1 of the design note with the modes of friction ``way``; y as in ``layout``."""

    def __init__(self, scenario):
        self.s = s = scenario
        left = s.array.inertia - (s.array.rigid_inertia or 0.0)
        self.H = np.array([math.sqrt(m.effective_inertia or left) for m in s.array.modes])
        omega = 2 * math.pi * np.array([m.frequency for m in s.array.modes])
        self.Lambda, self.D = omega**2, 2 * np.array([m.damping for m in s.array.modes]) * omega
        self.J_m = s.motor.rotor_inertia + s.reducer.wave_generator_inertia
        self.h, self.n = s.reducer.ratio, self.H.size
        J = s.array.inertia + s.reducer.output_inertia
        # With a rigid reducer theta_l is the coordinate and the rotor adds h^2 J_m (rigid limit of Eq. 16-18).
        M = np.eye(1 + self.n)
        M[0, 0] = J + (self.h**2 * self.J_m if s.reducer.rigid else 0.0)
        M[0, 1:] = M[1:, 0] = self.H
        self.J, self.M_inverse = J, np.linalg.inv(M)
        self.rotor, self.output = Law(s.motor.friction), Law(s.friction)
        self.reference = (s.motor.current, 0.0)
        self.way = [0, 0]
        self.changes = []  # (time, which friction, whether it sticks from then on)

    def start(self):
        s, y = self.s, np.zeros(8 + 2 * self.n)
        y[0] = s.motor.current
        y[2] = s.motor.winding_resistance * s.motor.current / s.driver.integral_gain
        return y

    def microsteps(self):
        s = self.s
        per_second = -self.h * s.tracking.rate * s.tracking.clock_ratio * s.driver.microsteps
        per_second /= 2 * math.pi / (s.driver.beats * s.motor.rotor_teeth)
        count = int(abs(per_second) * END + 0.5)
        return [
            ((j - 0.5) / abs(per_second), math.copysign(j, per_second)) for j in range(1, count + 1)
        ]

    def command(self, k):
        angle = 2 * math.pi * k / (self.s.driver.beats * self.s.driver.microsteps)
        self.reference = (
            self.s.motor.current * math.cos(angle),
            self.s.motor.current * math.sin(angle),
        )

    def loads(self, y):
        """Torques but friction: T_e, T_g (0 if rigid), elastic force of the modes."""
        m, r, n = self.s.motor, self.s.reducer, self.n
        T_e = m.torque_constant * (
            y[1] * math.cos(m.rotor_teeth * y[4]) - y[0] * math.sin(m.rotor_teeth * y[4])
        )
        T_e -= m.detent_torque * math.sin(4 * m.rotor_teeth * y[4])
        T_g = 0.0
        if not r.rigid:
            T_g = r.stiffness * (-y[4] / self.h - y[5]) + r.damping * (
                -y[6 + n] / self.h - y[7 + n]
            )
        return T_e, T_g, -self.D * y[8 + n :] - self.Lambda * y[6 : 6 + n]

    def held(self, y):
        """Torque to be held on rotor and output: J_h alpha_l = T_g - T_f + sum H (D d eta/dt + Lambda eta)."""
        T_e, T_g, elastic = self.loads(y)
        shaft = T_g - self.H @ elastic
        return (0.0, shaft - self.h * T_e) if self.s.reducer.rigid else (T_e + T_g / self.h, shaft)

    def limits(self):
        if self.s.reducer.rigid:
            return 0.0, self.output.breakaway + self.h * self.rotor.breakaway
        return self.rotor.breakaway, self.output.breakaway

    def rates(self, t, y):
        s, d, m, n = self.s, self.s.driver, self.s.motor, self.n
        sin, cos = math.sin(m.rotor_teeth * y[4]), math.cos(m.rotor_teeth * y[4])
        omega_m, omega_l, eta_rate = y[6 + n], y[7 + n], y[8 + n :]
        e_A, e_B = self.reference[0] - y[0], self.reference[1] - y[1]
        u_A = d.proportional_gain * e_A + d.integral_gain * y[2]
        u_B = d.proportional_gain * e_B + d.integral_gain * y[3]
        R, L, K_m = m.winding_resistance, m.winding_inductance, m.torque_constant
        f = np.empty_like(y)
        f[0] = (u_A - R * y[0] + K_m * omega_m * sin) / L
        f[1] = (u_B - R * y[1] - K_m * omega_m * cos) / L
        f[2:6] = e_A, e_B, omega_m, omega_l
        f[6 : 6 + n] = eta_rate
        T_e, T_g, elastic = self.loads(y)
        T_fl = self.output.torque(self.way[1], omega_l)
        if s.reducer.rigid:
            T_fm = self.rotor.torque(-self.way[1], omega_m)
            push, alpha_m = -self.h * (T_e - T_fm) - T_fl, None
        else:
            push = T_g - T_fl
            alpha_m = (
                (T_e - self.rotor.torque(self.way[0], omega_m) + T_g / self.h) / self.J_m
                if self.way[0]
                else 0.0
            )
        if self.way[1]:
            acceleration = self.M_inverse @ np.concatenate([[push], elastic])
            f[7 + n], f[8 + n :] = acceleration[0], acceleration[1:]
        else:
            f[7 + n], f[8 + n :] = 0.0, elastic
        f[6 + n] = -self.h * f[7 + n] if alpha_m is None else alpha_m
        return f

    def decide(self, which, y):
        """Mode of a friction whose body is at rest."""
        held, limit = self.held(y)[which], self.limits()[which]
        self.way[which] = 0 if abs(held) <= limit else int(math.copysign(1, held))

    def margin(self, which):
        """Event function of a friction, falling through zero when its mode ends; None where there is no friction."""
        limit, velocity = self.limits()[which], 6 + self.n + which
        if limit == 0.0:
            return None
        way = self.way[which]

        def left(t, y):
            return way * y[velocity] if way else limit - abs(self.held(y)[which])

        left.terminal, left.direction = True, -1
        return left

    def row(self, y):
        f, n = self.rates(0.0, y), self.n
        T_d = -(self.J * f[7 + n] + self.H @ f[8 + n :] + self.J_m * f[6 + n])
        return [y[4], y[6 + n], y[5], y[7 + n], T_d]

    def run(self, times):
        self.command(0)
        y, t = self.start(), 0.0
        for which in (0, 1):
            self.decide(which, y)
            if self.limits()[which] == 0.0:
                self.way[which] = 1  # no friction to stick by: always free
        rows = []
        for stop, k in [*self.microsteps(), (END, None)]:
            while t < stop:
                margins = [(which, self.margin(which)) for which in (0, 1)]
                margins = [(which, event) for which, event in margins if event]
                inside = times[(times > t) & (times <= stop)]
                solution = solve_ivp(
                    self.rates, (t, stop), y, method="LSODA", rtol=1e-10, atol=1e-14, first_step=min(1e-7, stop - t),
                    events=[event for _, event in margins], dense_output=True,
                )  # fmt: skip
                assert solution.status >= 0
                rows += [self.row(solution.sol(x)) for x in inside[inside <= solution.t[-1]]]
                t, y = solution.t[-1], solution.y[:, -1].copy()
                for (which, _), found in zip(margins, solution.t_events, strict=True):
                    if found.size:
                        y[6 + self.n + which] = 0.0
                        if self.s.reducer.rigid:
                            y[6 + self.n] = 0.0
                        was = self.way[which]
                        self.decide(which, y)
                        if (
                            was == 0
                        ):  # the torque is at the limit to rounding; it goes the way it is pushed
                            self.way[which] = int(math.copysign(1, self.held(y)[which]))
                        if (was == 0) != (self.way[which] == 0):
                            self.changes.append((t, which, self.way[which] == 0))
            if k is not None:
                self.command(k)
        return np.array(rows)


def kernel_rows(scenario, times):
    """NAMES, then which of rotor and output stick, from the kernel stopped at ``times``; and its counters."""
    rows, packed = rows_at(scenario, times)
    return rows[
        :, [kernel.CHANNELS.index(name) for name in (*NAMES, "stuck_rotor", "stuck_output")]
    ], packed.state.counters


def scenario_of(case, accuracy=5e-4):
    changes = {"sources": {}, "solver.accuracy": accuracy, **CASES[case]}
    return baseline().with_si(changes)


@cache
def reference_of(case):
    automaton = Automaton(scenario_of(case))
    return automaton, automaton.run(TIMES)


def deviations(expected, found):
    """Per quantity; angles count in microsteps, as they only grow, all else in its own largest value."""
    sizes = np.abs(expected).max(axis=0)
    sizes[[0, 2]] = 2 * math.pi / 3200, 2 * math.pi / 3200 / 100
    return dict(
        zip(NAMES, np.abs(found[:, : len(NAMES)] - expected).max(axis=0) / sizes, strict=True)
    )


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    ("accuracy", "smooth", "jumping"), [(2.5e-9, 2e-8, 2e-7), (5e-4, 5e-4, 2e-3)]
)
def test_motion_with_friction_is_the_automatons(case, accuracy, smooth, jumping):
    automaton, expected = reference_of(case)
    found, _ = kernel_rows(scenario_of(case, accuracy), TIMES)
    # T_d falls by the excess of breakaway over Coulomb torque within 0.1 ms of a breakaway, so it is the least sure.
    # Worst measured: 4e-9 and 3e-8 at the tight accuracy, 5e-5 and 8e-5 at the default.
    for name, deviation in deviations(expected, found).items():
        assert deviation < (jumping if name == "T_d" else smooth), name


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("accuracy", "apart"), [(2.5e-9, 1e-8), (5e-4, 3e-5)])
def test_sticks_begin_and_end_with_the_automatons(case, accuracy, apart):
    """Worst measured 1e-9 s at the tight accuracy and 1.1e-5 s at the default; sticks last milliseconds."""
    automaton, _ = reference_of(case)
    begin = np.array([0.0, *(t for t, _, _ in automaton.changes), END])
    alone = np.minimum(np.diff(begin)[1:], np.diff(begin)[:-1]) > 2 * apart
    assert np.sum(~alone) <= 4  # two changes of the rotor alone come within 60 us of the one before
    changes = [change for change, far in zip(automaton.changes, alone, strict=True) if far]
    times = [t + side * apart for t, _, _ in changes for side in (-1, 1)]
    found, counters = kernel_rows(scenario_of(case, accuracy), [*times, END])
    for k, (t, which, sticks) in enumerate(changes):
        before, after = found[2 * k, len(NAMES) + which], found[2 * k + 1, len(NAMES) + which]
        assert (before, after) == (1 - sticks, sticks), f"{t:.7f} s"
    # and there are no others
    assert counters[kernel.BREAKAWAYS] == sum(not sticks for _, _, sticks in automaton.changes)


@pytest.mark.parametrize("case", CASES)
def test_the_cases_do_stick_and_break_away(case):
    automaton, _ = reference_of(case)
    assert len(automaton.changes) > 8
