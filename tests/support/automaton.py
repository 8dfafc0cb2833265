"""A drive whose output's friction has memory or noise, or whose gear has backlash, integrated by
SciPy from event to event.

It shares nothing with the kernel, beside which ``both`` puts it.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.pack import pack
from microvib.solve.sampling import empty_sample_buffer


class Automaton:
    """The drive of a scenario with elements as states of their own, integrated by SciPy from event
    to event.

    Forces of elements that stick are integrated, dF/dt = k omega_l; those that slip are s(omega_l)
    times their share.
    """

    def __init__(self, scenario, noise=lambda t: 0.0, grip=lambda angle: 1.0):
        self.s, self.noise, self.grip, f = scenario, noise, grip, scenario.friction
        self.harness = f.harness
        in_harness = f.harness.memory if f.harness else ()
        self.k, self.nu = np.array([*f.memory, *in_harness]).reshape(-1, 2).T
        self.of_harness = np.arange(self.k.size) >= len(f.memory)
        self.mode, self.side, self.gap = (
            np.zeros(self.k.size),
            0.0,
            0.5 * (scenario.reducer.backlash or 0.0),
        )
        self.contacts, self.modes = 0, set()
        self.H, self.D, self.Lam = scenario.array.H, scenario.array.D, scenario.array.Lambda
        self.slide, self.excess, self.rate = f.sliding_torque, f.stribeck_torque, f.stribeck_rate

    def curve(self, omega):
        return self.slide + self.excess * math.exp(-abs(omega) / self.rate)

    def limits(self, omega, angle):
        """Torque at which each element slides."""
        own = self.nu * self.curve(omega) * self.grip(angle)
        return (
            np.where(self.of_harness, self.nu * self.harness.friction, own) if self.harness else own
        )

    def friction(self, angle, omega, F):
        slides = self.mode * self.limits(omega, angle)
        torque = np.where(self.mode == 0.0, F, slides).sum()
        if self.harness:
            torque += self.harness.stiffness * (angle - self.harness.neutral_angle)
        return torque + self.s.friction.viscous * omega * self.grip(angle)

    def __call__(self, t, y, ref):
        s, n = self.s, self.H.size
        motor, driver, g = s.motor, s.driver, s.reducer
        iA, iB, xA, xB, tm, wm, tl, wl = y[:8]
        eta, w, F = y[8 : 8 + n], y[8 + n : 8 + 2 * n], y[8 + 2 * n :]
        z, K, L = (
            motor.rotor_teeth,
            motor.torque_constant,
            motor.winding_inductance + driver.derivative_gain,
        )
        s_, c_ = math.sin(z * tm), math.cos(z * tm)
        uA = driver.proportional_gain * (ref[0] - iA) + driver.integral_gain * xA
        uB = driver.proportional_gain * (ref[1] - iB) + driver.integral_gain * xB
        T_e = K * (iB * c_ - iA * s_) - motor.detent_torque * math.sin(4 * z * tm)
        rate = w - self.H * wl
        pull = self.D * rate + self.Lam * eta
        T_g = g.stiffness * (-tm / g.ratio - tl - self.side * self.gap) + g.damping * (
            -wm / g.ratio - wl
        )
        if self.gap and self.side == 0.0:
            T_g = 0.0
        m = motor.friction
        T_fm = (
            math.copysign(m.sliding_torque, wm) + m.viscous * wm
            if m.breakaway_torque
            else m.viscous * wm
        )
        am = (T_e - T_fm + T_g / g.ratio) / s.rotor_inertia
        al = (T_g - self.friction(tl, wl, F) - self.noise(t) + self.H @ pull) / s.output_inertia
        dF = np.where(self.mode == 0.0, self.k * wl, 0.0)
        return np.concatenate(
            [[(uA - motor.winding_resistance * iA + K * wm * s_) / L, (uB - motor.winding_resistance * iB - K * wm * c_) / L],
             [ref[0] - iA, ref[1] - iB, wm, am, wl, al], rate, -pull, dF]
        )  # fmt: skip

    def through(self, y, begin, end, ref):
        """The state at ``end``, from event to event."""
        first = y.size - self.k.size
        while begin < end:
            events = []
            for e in range(self.k.size):
                if self.mode[e] == 0.0:

                    def reaches(t, y, ref, e=e):
                        outward = max(math.copysign(1.0, y[first + e]) * y[7], 0.0)
                        return self.limits(outward, y[6])[e] - abs(y[first + e])
                else:

                    def reaches(t, y, ref, e=e):
                        return self.mode[e] * y[7]

                events.append(reaches)
            if self.gap:

                def meets(t, y, ref):
                    twist = -y[4] / self.s.reducer.ratio - y[6]
                    return 1e6 * (
                        self.side * twist - self.gap if self.side else self.gap - abs(twist)
                    )

                events.append(meets)
            for event in events:
                event.terminal, event.direction = True, -1
            out = solve_ivp(
                self, (begin, end), y, "LSODA", rtol=1e-10, atol=1e-14, events=events, args=(ref,)
            )
            begin, y = out.t[-1], out.y[:, -1].copy()
            if out.status != 1:
                break
            e = next(e for e, times in enumerate(out.t_events) if times.size)
            if e == self.k.size:
                self.side = (
                    0.0 if self.side else math.copysign(1.0, -y[4] / self.s.reducer.ratio - y[6])
                )
                self.contacts += abs(self.side)
            elif self.mode[e] == 0.0:
                self.mode[e] = math.copysign(1.0, y[first + e])
            else:
                slips = self.mode != 0.0
                y[first:][slips] = ((1.0 - 1e-9) * self.mode * self.limits(0.0, y[6]))[slips]
                self.mode[slips] = 0.0
                y[7] = 0.0
        self.modes.add(tuple(self.mode))
        return y


def both(automaton, end):
    """State of the automaton at ``end`` [s], and the kernel's packed drive, which began alike."""
    packed = pack(automaton.s)
    times, refs = Command(automaton.s).microsteps(0.0, end)
    y = np.concatenate(
        [packed.state.y[:8], packed.state.y[8::2], packed.state.y[9::2], np.zeros(automaton.k.size)]
    )
    now, first = 0.0, packed.state.clock[kernel.REF_A : kernel.REF_A + 2].copy()
    for stop, ref in zip([*times, end], [first, *refs[:, :2]], strict=True):
        y, now = automaton.through(y, now, stop, ref), stop
    assert packed.advance(end, empty_sample_buffer(packed.channels), times, refs) == kernel.OK
    return y, packed


def alike(automaton, y, packed):
    """The kernel's state is the automaton's, to parts of a microstep."""
    own, step, ratio = (
        packed.state.y,
        automaton.s.driver.microstep(automaton.s.motor),
        automaton.s.reducer.ratio,
    )
    n = automaton.H.size
    assert own[4] == pytest.approx(y[4], abs=1e-5 * step)
    assert own[6] == pytest.approx(y[6], abs=1e-5 * step / ratio)
    assert own[7] == pytest.approx(y[7], abs=1e-4 * step / ratio * 200.0)
    assert own[8 : 8 + 2 * n : 2] == pytest.approx(y[8 : 8 + n], abs=1e-6 * step / ratio)
