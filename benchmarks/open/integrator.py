"""An integrator of a solar array drive that shares no code with microvib: fourth-order Runge-Kutta
between events, compiled by numba.

The equations are those of ``docs/model.md``: two windings with PI current loops, flux linkages with
harmonics, detent torque, a rotor, a compliant gear, set-valued friction of the output with a
Stribeck curve, and an array of modes on the shaft. Events are microsteps, at their exact times, and
stops and breakaways of the output, located by a root search on the length of a step.

The result is the angular momentum about the drive axis at chosen times. What moves takes the
disturbance torque T_d = -dL/dt, so that the mean of the torque between two times is exact whatever
jumps it has in between: -(L_2 - L_1)/(t_2 - t_1).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

LONGEST_STEP = 1.0 / 32768.0
"""Longest step [s]; a current loop of 25 000 1/s is stable up to 3.6 of them."""
_TOLERANCE = 1e-13
"""Length [s] to which an event is located."""
_ROOT_STEPS = 60


class Parameters(NamedTuple):
    """A drive in SI units; symbols as in the paper."""

    z: float
    """Rotor teeth."""
    K_m: float
    K_d: float
    R: float
    L: float
    J_m: float
    rotor_viscous: float
    flux: np.ndarray
    """Harmonics of the flux linkages, (m, 3): order, part of K_m, phase [rad]."""
    K_P: float
    K_I: float
    h: float
    K_g: float
    C_g: float
    sliding: float
    """Friction of the output that slides [N m]."""
    excess: float
    """Breakaway torque above it [N m]."""
    stribeck_rate: float
    viscous: float
    J_h: float
    """Inertia that is rigid on the shaft [kg m2]."""
    H: np.ndarray
    """Participation of the array's modes, (s,)."""
    Lambda: np.ndarray
    """Squares of their frequencies [1/s2], (s,)."""
    D: np.ndarray
    """2 xi Omega [1/s], (s,)."""


_compiled = numba.njit(cache=True, error_model="numpy")


@_compiled
def _linkages(p, s, c, d):
    """k_A and k_B at an electrical angle ``p``, whose sine and cosine are known."""
    k_a, k_b = s, -c
    for m in range(d.flux.shape[0]):
        order, part, phase = d.flux[m]
        k_a += part * math.sin(order * p + phase)
        k_b += part * math.sin(order * (p - 0.5 * math.pi) + phase)
    return -d.K_m * k_a, -d.K_m * k_b


@_compiled
def _derivative(y, ref_a, ref_b, side, d, dy):
    """Slopes of a state; the torque that the output's friction must hold where it sticks.

    State: i_A, i_B, integrals of both errors, theta_m, omega_m, theta_l, omega_l, eta, eta_rate.
    ``side`` is the sense in which the output slides, 0 where it sticks.
    """
    n = d.H.size
    e_a, e_b = ref_a - y[0], ref_b - y[1]
    p = d.z * y[4]
    s, c = math.sin(p), math.cos(p)
    k_a, k_b = _linkages(p, s, c, d)
    dy[0] = (d.K_P * e_a + d.K_I * y[2] - d.R * y[0] - k_a * y[5]) / d.L
    dy[1] = (d.K_P * e_b + d.K_I * y[3] - d.R * y[1] - k_b * y[5]) / d.L
    dy[2], dy[3] = e_a, e_b
    T_e = y[0] * k_a + y[1] * k_b - d.K_d * 4.0 * s * c * (1.0 - 2.0 * s * s)
    T_g = -d.K_g * (y[4] / d.h + y[6]) - d.C_g * (y[5] / d.h + y[7])
    dy[4], dy[5] = y[5], (T_e - d.rotor_viscous * y[5] + T_g / d.h) / d.J_m
    net = T_g - d.viscous * y[7]
    for i in range(n):
        net += d.H[i] * (d.D[i] * y[8 + n + i] + d.Lambda[i] * y[8 + i])
    dy[6] = y[7]
    if side == 0.0:
        dy[7] = 0.0
    else:
        grip = d.sliding + d.excess * math.exp(-abs(y[7]) / d.stribeck_rate)
        dy[7] = (net - side * grip) / d.J_h
    for i in range(n):
        dy[8 + i] = y[8 + n + i]
        dy[8 + n + i] = -d.D[i] * y[8 + n + i] - d.Lambda[i] * y[8 + i] - d.H[i] * dy[7]
    return net


@_compiled
def _step(y, h, ref_a, ref_b, side, d, out, k):
    """State after one step, in ``out``; ``k`` (5, states) is scratch."""
    _derivative(y, ref_a, ref_b, side, d, k[0])
    for j in range(y.size):
        k[4, j] = y[j] + 0.5 * h * k[0, j]
    _derivative(k[4], ref_a, ref_b, side, d, k[1])
    for j in range(y.size):
        k[4, j] = y[j] + 0.5 * h * k[1, j]
    _derivative(k[4], ref_a, ref_b, side, d, k[2])
    for j in range(y.size):
        k[4, j] = y[j] + h * k[2, j]
    _derivative(k[4], ref_a, ref_b, side, d, k[3])
    for j in range(y.size):
        out[j] = y[j] + h / 6.0 * (k[0, j] + 2.0 * (k[1, j] + k[2, j]) + k[3, j])


@_compiled
def _beyond(y, ref_a, ref_b, side, d, scratch):
    """Above 0 where the output has gone beyond its mode: slid backwards, or held too much."""
    if side == 0.0:
        return abs(_derivative(y, ref_a, ref_b, side, d, scratch)) - (d.sliding + d.excess)
    return -side * y[7]


@_compiled
def _locate(y, h, ref_a, ref_b, side, d, out, k):
    """Length of the step to the event within one of length ``h``, just beyond it; its state is in
    ``out``."""
    low, high = 0.0, h
    for _ in range(_ROOT_STEPS):
        if high - low <= _TOLERANCE:
            break
        middle = 0.5 * (low + high)
        _step(y, middle, ref_a, ref_b, side, d, out, k)
        if _beyond(out, ref_a, ref_b, side, d, k[4]) > 0.0:
            high = middle
        else:
            low = middle
    _step(y, high, ref_a, ref_b, side, d, out, k)
    return high


@_compiled
def _after_event(y, ref_a, ref_b, side, d, scratch):
    """Mode of the output after an event; a stop is exactly at rest."""
    if side != 0.0:
        y[7] = 0.0
    net = _derivative(y, ref_a, ref_b, 0.0, d, scratch)
    if abs(net) <= d.sliding + d.excess:
        return 0.0
    return 1.0 if net > 0.0 else -1.0


@_compiled
def _momentum(y, d):
    n, total, modes = d.H.size, d.J_h, 0.0
    for i in range(n):
        total += d.H[i] * d.H[i]
        modes += d.H[i] * y[8 + n + i]
    return total * y[7] + modes + d.J_m * y[5]


@_compiled
def integrate(d, references, f_d, times):
    """Angular momentum at ascending ``times`` (n,) [s] of a drive that starts from rest at 0.

    The references (m, 2) [A] are those of each microstep of an electrical period; microsteps follow
    at ``f_d`` [Hz], the first after half a period, backwards, for the gear turns the sense round.
    Also gives the number of events, and whether the rotor was ever half an electrical turn away.
    """
    n = d.H.size
    y, out = np.zeros(8 + 2 * n), np.zeros(8 + 2 * n)
    k = np.zeros((5, 8 + 2 * n))
    m, count, events, lost = references.shape[0], 0, 0, False
    ref_a, ref_b = references[0]
    y[0], y[1] = ref_a, ref_b
    y[2], y[3] = d.R * ref_a / d.K_I, d.R * ref_b / d.K_I
    t, side, next_step = 0.0, 0.0, 0.5 / f_d
    found = np.zeros(times.size)
    for j in range(times.size):
        while t < times[j]:
            if t >= next_step:
                count += 1
                next_step = (count + 0.5) / f_d
                ref_a, ref_b = references[(-count) % m]
                lost = lost or abs(d.z * y[4] + 2.0 * math.pi * count / m) > math.pi
                continue
            end = min(times[j], next_step)
            h = min(end - t, LONGEST_STEP)
            whole = h == end - t
            _step(y, h, ref_a, ref_b, side, d, out, k)
            if _beyond(out, ref_a, ref_b, side, d, k[4]) > 0.0:
                h = _locate(y, h, ref_a, ref_b, side, d, out, k)
                side = _after_event(out, ref_a, ref_b, side, d, k[4])
                events += 1
                whole = False
            y[:] = out
            t = end if whole else t + h
        found[j] = _momentum(y, d)
    return found, events, lost
