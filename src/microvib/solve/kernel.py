"""The one hot loop: the drive's equations, integrated with exact stick and slip.

Between two events (a microstep of the command, a friction that sticks, breaks away or reverses) the motion is smooth. It is
advanced by RODAS4, an L-stable Rosenbrock method of order 4(3) with an embedded error estimate (E. Hairer, G. Wanner,
*Solving Ordinary Differential Equations II*, section IV.7). Events end a step, so that no step crosses one: microsteps are
known in advance, a friction event is located by repeating the step with other lengths until it ends on the event.

Friction is set-valued: a stuck body has exactly zero velocity, and no smoothed friction law appears anywhere.

Read from the end: ``advance`` is the loop, and calls what stands above it, section by section: the equations of motion
(``derivative``), their Jacobian and the linear systems of a step (``linearise``, ``_factor``, ``_solve``), one step (``step``)
and its continuous extension, friction events (``margins``, ``first_trial``, ``next_trial``, ``decide_friction``), samples
(``_record``) and the length of steps. docs/numerics.md has the method in words, docs/theory the equations.

The functions take floats, for one drive, or lanes, for many at once (``microvib.solve.vector``, ``microvib.solve.stepper``).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from microvib.compiled import Counts, Matrix, Unit, Vector
from microvib.solve.vector import exp, is_single, sincos, some, where

code = Unit(__name__, "vector.py", "vector_type.py", types="microvib.solve.vector_type")

# No exceptions inside (a division by zero gives inf, which step control catches); products may be fused; no reference
# counting, which would take half the time: the loop allocates no arrays, its scratch comes from outside.
COMPILE: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "_nrt": False, "fastmath": {"contract", "arcp"},
}  # fmt: skip
INLINE: dict[str, Any] = COMPILE | {"inline": "always"}
FORCED: dict[str, Any] = COMPILE | {"forceinline": True}  # a call would copy its tuples, a quarter of the time

# ---- State, channels and parameters ----

# State y: currents, integrals of their errors, rotor (angle, rate), output (angle, rate); then eta and w of each mode. With
# w = d eta/dt + H omega_l, the mode's absolute momentum, in place of d eta/dt the mass matrix is diagonal.
IA, IB, XA, XB, TM, WM, TL, WL, MODES = range(9)

# Channels of a sample; the modal coordinates and their rates follow. The last four are powers, integrated over the run.
CHANNELS = (
    "i_A", "i_B", "u_A", "u_B", "i_ref_A", "i_ref_B",
    "theta_m", "omega_m", "alpha_m", "theta_l", "omega_l", "alpha_l",
    "T_e", "T_f_m", "T_f", "T_g", "T_l", "T_d", "T_d_force",
    "stuck_rotor", "stuck_output", "E_kinetic", "E_magnetic", "E_elastic",
    "P_electrical", "P_joule", "P_friction", "P_damping",
)  # fmt: skip
N_CHANNELS = len(CHANNELS)
T_D, T_D_FORCE, ENERGIES, POWERS = 17, 18, 21, 24
N_POWERS = N_CHANNELS - POWERS

OK, LOST_SYNCHRONISM, STEP_TOO_SMALL, NOT_FINITE = range(4)
# entries of State.counters and State.clock
STEPS, REJECTED, MICROSTEPS, STICKS, ROTOR_STICKS, BREAKAWAYS, EVENT_STEPS, N_COUNTERS = range(8)
NOW, NEXT_STEP, REF_A, REF_B, THETA_E, MISMATCH, LARGEST, IMPULSE, WEIGHT, N_CLOCK = range(10)
# entries of the search for an event: bracket [LO, HI] in the length of the step, margins there, tolerance, trials so far
LO, HI, E_LO, E_HI, ENOUGH, TRIALS, N_SEARCH = range(7)
MAX_TRIALS, MAX_EVENTS = 80.0, 4
SCRATCH_ROWS = 19


class Drive(NamedTuple):
    """Parameters of one drive, in SI units; all scalars are floats."""

    z: float
    K_m: float
    K_d: float
    R: float
    L: float
    K_P: float
    K_I: float
    K_D: float
    U_max: float
    J_m: float
    J_L: float  # J_flex + J_h: all that is rigid on the output
    J_h: float
    K_g: float
    C_g: float
    rigid: bool
    shaped: bool  # a Stribeck shape is not 1
    # friction of rotor and output: sliding level (Coulomb and slip ring), Stribeck excess, 1 / rate, shape, viscous
    m_slide: float
    m_stribeck: float
    m_inv_rate: float
    m_shape: float
    m_viscous: float
    l_slide: float
    l_stribeck: float
    l_inv_rate: float
    l_shape: float
    l_viscous: float
    # reciprocals, so that the loop divides little
    inv_K_P: float  # 0 without a proportional gain
    inv_L: float
    inv_L_D: float  # 1 / (L + K_D): the derivative acts on the measured current
    inv_J_m: float
    inv_J_L: float
    inv_h: float
    max_step: float
    layer: float  # first step after a microstep: a part of the current loop's time constant
    H: Vector  # (s,)
    D: Vector
    Lam: Vector
    te: Vector  # order, sine and cosine amplitude of the transmission error, for each of its harmonics
    scale: Vector  # 1 / (tolerance x size) of each state


class State(NamedTuple):
    """What the integration updates: state, friction modes (-1, 0 stuck, 1), times and references, counters, energies [J]."""

    y: Vector
    stick: Vector
    clock: Vector
    counters: Counts
    energy: Vector


class Samples(NamedTuple):
    """Where samples go: interval means of all channels, one row each; with a width of 0 none are taken."""

    first: float  # start of the first interval
    width: float
    rows: Matrix
    partial: Vector  # integrals over the current interval so far
    cursor: Counts  # rows filled here, rows filled before


class Work(NamedTuple):
    """Scratch of one step."""

    y1: Vector  # state at the end of the step
    between: Vector  # state inside it, from the continuous extension
    f0: Vector  # derivative at its start
    f: Vector
    q: Vector  # torques and voltages of ``derivative``
    jac: Vector  # entries of the Jacobian that vary, from ``linearise``
    lu: Vector  # pivots of ``_factor``; of the modes kappa and 1 / delta
    kappa: Vector
    inv_delta: Vector
    channels: Vector
    K: Matrix  # stages, (STAGES, n)
    dense: Matrix  # coefficients of the continuous extension, (2, n)
    search: Vector


# ---- The method ----

# RODAS4 in the form without matrix products, and its continuous extension of order 3:
# y(s) = (1-s) y0 + s (y1 + (1-s) (d2 + s d3)), d2 = DENSE[0] . K, d3 = DENSE[1] . K
STAGES = 6
GAMMA = 0.25
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
    ]
)
C = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.6688, 0.0, 0.0, 0.0, 0.0],
        [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0],
        [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
    ]
)
DENSE = np.array(
    [
        [10.12623508344586, -7.487995877610167, -34.80091861555747, -7.992771707568823, 1.025137723295662],
        [-0.6762803392801253, 6.087714651680015, 16.43084320892478, 24.76722511418386, -6.594389125716872],
    ]
)
GAUSS = 0.5 / math.sqrt(3.0)  # nodes of the two-point rule, from the middle, over the length


# ---- Equations of motion ----


@code.inner(**INLINE)
def _friction(sign, rate, slide, stribeck, inv_rate, shape, viscous, shaped):
    """Friction torque and its slope by the rate while slipping in the direction ``sign`` (Eq. 5-7); continued past zero rate."""
    torque, slope = slide, viscous
    if some(stribeck != 0.0):
        x = sign * rate * inv_rate
        # Only stages that overshoot a stop have x <= 0; the step is then repeated so that it ends at the stop.
        torque = where(x <= 0.0, torque + stribeck, torque)
        fading = (x > 0.0) & (x < 700.0)
        if some(fading):
            power = x**shape if shaped else x
            e = stribeck * exp(-power)
            torque = where(fading, torque + e, torque)
            steeper = e * shape * power / x * inv_rate if shaped else e * inv_rate
            slope = where(fading, slope - steeper, slope)
    return sign * torque + viscous * rate, slope


@code.inner(**INLINE)
def transmission_error(theta_m, te):
    """Kinematic error epsilon(theta_m) of the reducer [rad at the output] and its first three derivatives."""
    e0 = e1 = e2 = e3 = 0.0
    for j in range(te.size // 3):
        n = te[3 * j]
        s, c = sincos(n * theta_m)
        value, quarter = te[3 * j + 1] * s + te[3 * j + 2] * c, te[3 * j + 1] * c - te[3 * j + 2] * s
        e0 += value
        e1 += n * quarter
        e2 -= n * n * value
        e3 -= n * n * n * quarter
    return e0, e1, e2, e3


@code.inner(**INLINE)
def _winding(i, x, reference, back_emf, p):
    """Voltage, di/dt, dx/dt and whether the supply limits the phase (Eq. 2, 3); anti-windup by back-calculation."""
    demand, dx = p.K_P * (reference - i) + p.K_I * x, reference - i
    di = (demand - p.R * i + back_emf) * p.inv_L_D
    u = demand - p.K_D * di
    limited = math.fabs(u) > p.U_max
    if some(limited):
        u = where(limited, math.copysign(p.U_max, u), u)
        dx = where(limited, (u - p.K_I * x) * p.inv_K_P, dx)
        di = where(limited, (u - p.R * i + back_emf) * p.inv_L, di)
    return u, di, dx, limited


@code.inner(**INLINE)
def derivative(y, clock, stick, p, f, q):
    """Right-hand side ``f`` and instantaneous ``q`` = T_e, T_f,m, T_f, T_g, u_A, u_B, alpha_l (Eq. 2-7, 16-18)."""
    theta_m, omega_m = y[TM], y[WM]
    s, c = sincos(p.z * theta_m)
    u_A, f[IA], f[XA], _ = _winding(y[IA], y[XA], clock[REF_A], p.K_m * omega_m * s, p)
    u_B, f[IB], f[XB], _ = _winding(y[IB], y[XB], clock[REF_B], -p.K_m * omega_m * c, p)
    sin4 = 4.0 * s * c * (c * c - s * s)  # sin(4 z theta_m)
    T_e = p.K_m * (y[IB] * c - y[IA] * s) - p.K_d * sin4
    e0, e1, e2, _ = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h  # d theta_l / d theta_m where the gear does not twist
    omega_l = G * omega_m if p.rigid else y[WL]

    modal = 0.0  # torque of the modes on the output shaft
    for k in range(p.H.size):
        rate = y[MODES + 2 * k + 1] - p.H[k] * omega_l
        pull = p.D[k] * rate + p.Lam[k] * y[MODES + 2 * k]
        f[MODES + 2 * k] = rate
        f[MODES + 2 * k + 1] = -pull
        modal += p.H[k] * pull

    T_fm, _ = _friction(stick[0], omega_m, p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous, p.shaped)
    sign_l = -stick[0] if p.rigid else stick[1]
    T_f, _ = _friction(sign_l, omega_l, p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous, p.shaped)
    if p.rigid:
        stuck = stick[0] == 0.0
        bias = G * e2 * p.J_L * omega_m * omega_m
        alpha_m = where(stuck, 0.0, (T_e - T_fm + G * (modal - T_f) - bias) / (p.J_m + G * G * p.J_L))
        if some(stuck):
            # One degree of freedom, two frictions: the hold is shared in proportion to what each can hold.
            limit_m, limit_l = p.m_slide + p.m_stribeck, math.fabs(G) * (p.l_slide + p.l_stribeck)
            T_fm = where(stuck, (T_e + G * modal) * limit_m / (limit_m + limit_l), T_fm)
            T_f = where(stuck, (T_e + G * modal - T_fm) / G, T_f)
        alpha_l = G * alpha_m + e2 * omega_m * omega_m
        T_g = p.J_L * alpha_l + T_f - modal
        f[TL], f[WL] = 0.0, 0.0  # follow from the rotor
    else:
        T_g = p.K_g * (e0 - theta_m * p.inv_h - y[TL]) + p.C_g * (G * omega_m - omega_l)
        T_fm = where(stick[0] == 0.0, T_e - G * T_g, T_fm)
        T_f = where(stick[1] == 0.0, T_g + modal, T_f)
        alpha_m = where(stick[0] == 0.0, 0.0, (T_e - T_fm - G * T_g) * p.inv_J_m)
        alpha_l = where(stick[1] == 0.0, 0.0, (T_g - T_f + modal) * p.inv_J_L)
        f[TL], f[WL] = omega_l, alpha_l
    f[TM], f[WM] = omega_m, alpha_m
    q[0], q[1], q[2], q[3], q[4], q[5], q[6] = T_e, T_fm, T_f, T_g, u_A, u_B, alpha_l


@code.inner(**INLINE)
def _channels(y, clock, stick, p, f, q, out):
    """All channels at one instant. ``T_d`` from momentum (Eq. 20), ``T_d_force`` from the torques on the housing."""
    derivative(y, clock, stick, p, f, q)
    T_e, T_fm, T_f, T_g, u_A, u_B, alpha_l = q[0], q[1], q[2], q[3], q[4], q[5], q[6]
    theta_m, omega_m, alpha_m, theta_l, omega_l = y[TM], y[WM], f[WM], y[TL], y[WL]
    e0, e1, _, _ = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h
    if p.rigid:
        theta_l, omega_l = e0 - theta_m * p.inv_h, G * omega_m
    twist, slip = e0 - theta_m * p.inv_h - theta_l, G * omega_m - omega_l
    kinetic = 0.5 * (p.J_m * omega_m**2 + p.J_L * omega_l**2)
    elastic = 0.5 * p.K_g * twist**2 - 0.25 * p.K_d / p.z * math.cos(4.0 * p.z * theta_m)
    damping = p.C_g * slip * slip
    modal_rate = 0.0
    for k in range(p.H.size):
        eta, rate = y[MODES + 2 * k], f[MODES + 2 * k]
        kinetic += 0.5 * y[MODES + 2 * k + 1] ** 2
        elastic += 0.5 * p.Lam[k] * eta * eta
        damping += p.D[k] * rate * rate
        modal_rate += p.H[k] * f[MODES + 2 * k + 1]
        out[N_CHANNELS + k] = eta
        out[N_CHANNELS + p.H.size + k] = rate
    out[0], out[1], out[2], out[3], out[4], out[5] = y[IA], y[IB], u_A, u_B, clock[REF_A], clock[REF_B]
    out[6], out[7], out[8], out[9], out[10], out[11] = theta_m, omega_m, alpha_m, theta_l, omega_l, alpha_l
    out[12], out[13], out[14], out[15] = T_e, T_fm, T_f, T_g
    out[16] = p.J_h * alpha_l + modal_rate
    out[17] = -(p.J_L * alpha_l + modal_rate + p.J_m * alpha_m)
    out[18] = -T_e + T_fm + T_f - T_g * (1.0 - G)
    out[19] = 1.0 if stick[0] == 0.0 else 0.0
    out[20] = 1.0 if (stick[0] if p.rigid else stick[1]) == 0.0 else 0.0
    out[21], out[22], out[23] = kinetic, 0.5 * p.L * (y[IA] ** 2 + y[IB] ** 2), elastic
    out[24], out[25] = u_A * y[IA] + u_B * y[IB], p.R * (y[IA] ** 2 + y[IB] ** 2)
    out[26], out[27] = T_fm * omega_m + T_f * omega_l, damping


# ---- Jacobian and linear systems ----
#
# Each stage of a step solves (g I - df/dy) u = r with g = 1 / (GAMMA h). The matrix is sparse, and one elimination in closed
# form serves all stages: ``_factor`` works out the coefficients, ``_solve`` applies them to a right-hand side r. Cost is linear in
# the number of modes. Write u_i, u_x for a phase's current and its integral, u_theta, u_m for the rotor's angle and rate, u_tl, u_l
# for the output's, u_eta, u_w for a mode; G = epsilon' - 1/h is d theta_l/d theta_m where the gear does not twist, e2 = epsilon''.
#
# 1. Angles:  g u_theta - u_m = r_theta  gives  u_theta = (r_theta + u_m) / g;  likewise u_tl.
#
# 2. Windings, phase A, with L_D = L + K_D and s, c = sin, cos(z theta_m):
#        g u_x + u_i = r_x
#        (g + (K_P + R)/L_D) u_i - (K_I/L_D) u_x - theta_A u_theta - (K_m s/L_D) u_m = r_i,    theta_A = K_m z omega_m c/L_D
#    give, with b = K_I/(L_D g) and pivot_A = 1 / (g + (K_P + R)/L_D + b),
#        u_i = alpha_A + beta_A u_m,    beta_A  = pivot_A (K_m s/L_D + theta_A/g)
#                                       alpha_A = pivot_A (r_i + b r_x + theta_A r_theta/g)
#        u_x = (r_x - u_i) / g
#    Where the supply limits the voltage, it is constant: L and R in place of L_D and K_P + R, b = 0, and the integral has a row
#    of its own, (g + K_I/K_P) u_x = r_x. Phase B has -K_m c and z K_m omega_m s.
#
# 3. Modes, from d eta/dt = w - H omega_l and dw/dt = -D (w - H omega_l) - Lam eta, with kappa = D + Lam/g, delta = g + kappa:
#        u_eta = (r_eta + u_w - H u_l) / g
#        u_w   = (r_w - Lam r_eta/g + kappa H u_l) / delta
#    The torque of all modes on the shaft then changes by
#        sum of H (kappa (r_w - Lam r_eta/g)/delta + Lam r_eta/g)  -  (sum of H^2 kappa g/delta) u_l
#    (both sums are called ``modal`` below).
#
# 4. Gear:  dT_g = gear_theta u_theta - K_g u_tl + C_g (G u_m - u_l)  with  gear_theta = K_g G + C_g e2 omega_m,  that is
#        dT_g = gear_m u_m - gear_l u_l + gear,    gear_m = gear_theta/g + C_g G,   gear_l = K_g/g + C_g
#                                                  gear   = (gear_theta r_theta - K_g r_tl)/g
#
# 5. What is left are the two equations of motion,
#        a11 u_m + a12 u_l = b1,    a11 = J_m g + rotor + G gear_m,    a12 = -G gear_l
#        a21 u_m + a22 u_l = b2,    a21 = -gear_m,    a22 = J_L g + gear_l + slope_l + sum of H^2 kappa g/delta
#                                   b1 = J_m r_m + K_m (c alpha_B - s alpha_A) + stiffness r_theta/g - G gear
#                                   b2 = J_L r_l + gear + sum of H (...) as in 3.
#    with rotor = K_m (s beta_A - c beta_B) - stiffness/g + slope_m. ``stiffness`` is the slope of the rotor's torque by theta_m at
#    fixed currents and gear twist, ``slope_m`` and ``slope_l`` those of the frictions by the rates. A stuck body has no equation:
#    its u is zero. The angles, windings and modes then follow from u_m and u_l by 1. to 3.
#
# With a rigid reducer omega_l = G omega_m, so that u_l = lead u_m + shift with lead = G + e2 omega_m/g and
# shift = e2 omega_m r_theta/g, and a single equation is left, with the inertia J_m + G^2 J_L.


@code.inner(**INLINE)
def linearise(x, p, w):
    """Varying entries of the Jacobian, into ``w.jac``, at the state whose derivative is in ``w.f0`` and ``w.q``."""
    y, clock, stick, q, jac = x.y, x.clock, x.stick, w.q, w.jac
    theta_m, omega_m = y[TM], y[WM]
    s, c = sincos(p.z * theta_m)
    _, _, _, limited_A = _winding(y[IA], y[XA], clock[REF_A], p.K_m * omega_m * s, p)
    _, _, _, limited_B = _winding(y[IB], y[XB], clock[REF_B], -p.K_m * omega_m * c, p)
    cos4 = 1.0 - 8.0 * s * s * c * c
    stiffness = -p.z * p.K_m * (y[IB] * s + y[IA] * c) - 4.0 * p.z * p.K_d * cos4
    _, e1, e2, e3 = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h
    _, slope_m = _friction(stick[0], omega_m, p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous, p.shaped)
    omega_l, sign_l = (G * omega_m, -stick[0]) if p.rigid else (y[WL], stick[1])
    _, slope_l = _friction(sign_l, omega_l, p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous, p.shaped)
    if p.rigid:
        modal = p.J_L * q[6] + q[2] - q[3]
        stiffness += (
            e2 * (modal - q[2]) - (e2 * e2 + G * e3) * p.J_L * omega_m * omega_m - 2.0 * G * e2 * p.J_L * w.f0[WM]
        )
        slope_m += 2.0 * G * e2 * p.J_L * omega_m
    else:
        stiffness -= e2 * q[3]
    jac[0], jac[1], jac[2], jac[3], jac[4], jac[5], jac[6] = s, c, stiffness, slope_m, slope_l, G, e2 * omega_m
    jac[7], jac[8], jac[9] = where(limited_A, 1.0, 0.0), where(limited_B, 1.0, 0.0), omega_m


@code.inner(**INLINE)
def _winding_pivot(g, inv_g, limited, p):
    """Elimination of one phase (2.): 1 / pivot, b, 1 / the integral's pivot, its coupling to the current, 1 / L."""
    b = p.K_I * p.inv_L_D * inv_g
    resistance = where(limited, p.R * p.inv_L, (p.K_P + p.R) * p.inv_L_D + b)
    integral = where(limited, 1.0 / (g + p.K_I * p.inv_K_P), inv_g)
    return (
        1.0 / (g + resistance),
        where(limited, 0.0, b),
        integral,
        where(limited, 0.0, 1.0),
        where(limited, p.inv_L, p.inv_L_D),
    )


@code.inner(**INLINE)
def _factor(g, stick, p, w):
    """Eliminate windings, angles and modes from ``g I - df/dy``; the coefficients are kept in ``w.lu``."""
    jac, lu = w.jac, w.lu
    s, c, stiffness, slope_m, slope_l, G = jac[0], jac[1], jac[2], jac[3], jac[4], jac[5]
    inv_g = 1.0 / g
    pivot_A, weight_A, integral_A, coupling_A, inv_L_A = _winding_pivot(g, inv_g, jac[7] != 0.0, p)
    pivot_B, weight_B, integral_B, coupling_B, inv_L_B = _winding_pivot(g, inv_g, jac[8] != 0.0, p)
    back_emf = p.K_m * p.z * jac[9]
    theta_A, theta_B = back_emf * c * inv_L_A, back_emf * s * inv_L_B
    beta_A = (p.K_m * s * inv_L_A + theta_A * inv_g) * pivot_A
    beta_B = (-p.K_m * c * inv_L_B + theta_B * inv_g) * pivot_B
    lu[0], lu[1], lu[2], lu[3], lu[4], lu[5] = pivot_A, weight_A, integral_A, coupling_A, theta_A, beta_A
    lu[6], lu[7], lu[8], lu[9], lu[10], lu[11] = pivot_B, weight_B, integral_B, coupling_B, theta_B, beta_B
    modal = 0.0
    for k in range(p.H.size):
        w.kappa[k] = p.D[k] + p.Lam[k] * inv_g
        w.inv_delta[k] = 1.0 / (g + w.kappa[k])
        modal += p.H[k] * p.H[k] * w.kappa[k] * g * w.inv_delta[k]
    rotor = p.K_m * (s * beta_A - c * beta_B) - stiffness * inv_g + slope_m
    if p.rigid:
        lead, drag, mass = G + jac[6] * inv_g, slope_l + modal, p.J_m + G * G * p.J_L
        lu[12], lu[13], lu[14], lu[15] = 1.0 / (mass * g + rotor + G * drag * lead), drag, lead, mass
        return
    gear_theta = p.K_g * G + p.C_g * jac[6]
    gear_m, gear_l = gear_theta * inv_g + p.C_g * G, p.C_g + p.K_g * inv_g
    a11, a12, a22 = p.J_m * g + rotor + G * gear_m, -G * gear_l, p.J_L * g + gear_l + slope_l + modal
    # Inverse of the 2 x 2 system (5.), a21 = -gear_m; a stuck body has no equation and is coupled to nothing.
    slips_m, slips_l = stick[0] != 0.0, stick[1] != 0.0
    a12, a21 = where(slips_m & slips_l, a12, 0.0), where(slips_m & slips_l, -gear_m, 0.0)
    inverse = 1.0 / (a11 * a22 - a12 * a21)
    lu[12], lu[13] = where(slips_m, a22 * inverse, 0.0), -a12 * inverse
    lu[14], lu[15] = -a21 * inverse, where(slips_l, a11 * inverse, 0.0)
    lu[16] = gear_theta


@code.inner(**INLINE)
def _solve(inv_g, stick, p, w, r):
    """Solve ``(g I - df/dy) u = r`` in place with the coefficients of ``_factor``."""
    jac, lu = w.jac, w.lu
    s, c, G = jac[0], jac[1], jac[5]
    alpha_A = (r[IA] + lu[1] * r[XA] + lu[4] * r[TM] * inv_g) * lu[0]
    alpha_B = (r[IB] + lu[7] * r[XB] + lu[10] * r[TM] * inv_g) * lu[6]
    rotor = p.K_m * (c * alpha_B - s * alpha_A) + jac[2] * r[TM] * inv_g
    modal = 0.0
    for k in range(p.H.size):
        stiff = p.Lam[k] * r[MODES + 2 * k] * inv_g
        modal += p.H[k] * (w.kappa[k] * (r[MODES + 2 * k + 1] - stiff) * w.inv_delta[k] + stiff)
    if p.rigid:
        shift = jac[6] * r[TM] * inv_g
        u_m = (lu[15] * r[WM] + rotor + G * (modal - lu[13] * shift)) * lu[12]
        u_m = where(stick[0] == 0.0, 0.0, u_m)
        u_l = where(stick[0] == 0.0, 0.0, lu[14] * u_m + shift)
        r[TL], r[WL] = 0.0, 0.0
    else:
        gear = (lu[16] * r[TM] - p.K_g * r[TL]) * inv_g
        b1 = p.J_m * r[WM] + rotor - G * gear
        b2 = p.J_L * r[WL] + gear + modal
        u_m, u_l = lu[12] * b1 + lu[13] * b2, lu[14] * b1 + lu[15] * b2
        r[TL] = where(stick[1] == 0.0, 0.0, (r[TL] + u_l) * inv_g)
        r[WL] = u_l
    r[IA] = alpha_A + lu[5] * u_m
    r[IB] = alpha_B + lu[11] * u_m
    r[XA] = (r[XA] - lu[3] * r[IA]) * lu[2]
    r[XB] = (r[XB] - lu[9] * r[IB]) * lu[8]
    r[TM] = where(stick[0] == 0.0, 0.0, (r[TM] + u_m) * inv_g)
    r[WM] = u_m
    for k in range(p.H.size):
        r_eta = r[MODES + 2 * k]
        u_w = (r[MODES + 2 * k + 1] - p.Lam[k] * r_eta * inv_g + w.kappa[k] * p.H[k] * u_l) * w.inv_delta[k]
        r[MODES + 2 * k] = (r_eta + u_w - p.H[k] * u_l) * inv_g
        r[MODES + 2 * k + 1] = u_w


# ---- One step and its continuous extension ----


@code.inner(**FORCED)
def _combine(stage, weight, table, y, K, out):
    """``out = y + weight x`` (sum of the stages so far, with the coefficients in row ``stage`` of ``table``).

    For one drive the inner loop runs over the states, and the compiler vectorises it; lanes are vectors already, and their sums
    stay in registers.
    """
    if is_single(y):
        for j in range(y.size):
            out[j] = y[j]
        for m in range(stage):
            scaled = weight * table[stage, m]
            for j in range(y.size):
                out[j] += scaled * K[m, j]
    else:
        for j in range(y.size):
            total = y[j]
            for m in range(stage):
                total += weight * table[stage, m] * K[m, j]
            out[j] = total


@code.inner(**FORCED)
def step(h, x, p, w):
    """One RODAS4 step of size ``h`` from ``x.y`` (whose derivative is ``w.f0``) to ``w.y1``; returns the scaled error."""
    y, y1, f, K, n = x.y, w.y1, w.f, w.K, x.y.size
    inv_g, ih = GAMMA * h, 1.0 / h
    _factor(1.0 / inv_g, x.stick, p, w)
    for stage in range(STAGES):
        if stage == 0:
            for j in range(n):
                f[j] = w.f0[j]
        else:
            _combine(stage, 1.0, A, y, K, y1)
            derivative(y1, x.clock, x.stick, p, f, w.q)
            _combine(stage, ih, C, f, K, f)
        _solve(inv_g, x.stick, p, w, f)
        for j in range(n):
            K[stage, j] = f[j]
    error = 0.0
    for j in range(n):  # y1 still is the argument of the last stage; that stage itself is the error estimate
        y1[j] += K[STAGES - 1, j]
        part = K[STAGES - 1, j] * p.scale[j]
        error += part * part
    # The mean is over 10 states, those of a drive with one mode: many modes must not dilute the error of the drive.
    return math.sqrt(error / 10.0)


@code.inner(**INLINE)
def dense(w):
    """Coefficients of the continuous extension of the step just made."""
    for i in range(2):
        for j in range(w.y1.size):
            total = 0.0
            for m in range(STAGES - 1):
                total += DENSE[i, m] * w.K[m, j]
            w.dense[i, j] = total


@code.inner(**INLINE)
def extension(s, y0, y1, d2, d3):
    """Continuous extension at the fraction ``s`` of a step, of a state or of anything linear in states."""
    r = 1.0 - s
    return r * y0 + s * (y1 + r * (d2 + s * d3))


@code.inner(**INLINE)
def interpolate(s, y, w):
    """State at the fraction ``s`` of the last step, into ``w.between`` (order 3)."""
    for j in range(y.size):
        w.between[j] = extension(s, y[j], w.y1[j], w.dense[0, j], w.dense[1, j])


# ---- Friction events ----
#
# A friction is in one of three modes: slipping forward (1), slipping backward (-1) or stuck (0), ``stick[0]`` for the rotor and
# ``stick[1]`` for the output. Within a mode the motion is smooth, and a *margin* says how far the mode is from its end:
#
#     slipping:  stick x rate                        ends where the body comes to rest
#     stuck:     breakaway torque - |hold torque|    ends where friction can no longer hold the body
#
# A step is first made as if no mode ended (``step``). If a margin is negative at its end, the event lies inside the step, and the
# step is repeated with shorter lengths until it ends where the margin is just spent (``_shorten_to_event``). ``first_trial`` takes
# the first length from the continuous extension of the step, which costs no new step; ``next_trial`` improves it by the ends of
# steps actually made, so that the time of the event is as accurate as the step. There ``decide_friction`` sets the rate to
# exactly zero and chooses the next mode from the hold torque, and the next step starts in that mode.


@code.inner(**INLINE)
def _holds(y, p):
    """Torque that friction must supply to keep each body at rest (rotor, output), and G."""
    theta_m = y[TM]
    s, c = sincos(p.z * theta_m)
    T_e = p.K_m * (y[IB] * c - y[IA] * s) - p.K_d * 4.0 * s * c * (c * c - s * s)
    e0, e1, _, _ = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h
    omega_l = G * y[WM] if p.rigid else y[WL]
    modal = 0.0
    for k in range(p.H.size):
        modal += p.H[k] * (p.D[k] * (y[MODES + 2 * k + 1] - p.H[k] * omega_l) + p.Lam[k] * y[MODES + 2 * k])
    T_g = p.K_g * (e0 - theta_m * p.inv_h - y[TL]) + p.C_g * (G * y[WM] - omega_l)
    hold_m, hold_l = (T_e + G * modal, 0.0) if p.rigid else (T_e - G * T_g, T_g + modal)
    return hold_m, hold_l, G


@code.inner(**INLINE)
def _limits(p, G):
    """Breakaway torques of rotor and output; with a rigid reducer both act on the one degree of freedom."""
    limit_m, limit_l = p.m_slide + p.m_stribeck, p.l_slide + p.l_stribeck
    return (limit_m + math.fabs(G) * limit_l, 0.0) if p.rigid else (limit_m, limit_l)


@code.inner(**FORCED)
def margins(y, stick, p):
    """What stays positive as long as the friction modes last: slip speed, or the reserve below the breakaway torque.

    Rotor and output; always 1 where there is no friction.
    """
    slips_m, slips_l = stick[0] != 0.0, stick[1] != 0.0
    e_m, e_l = stick[0] * y[WM], stick[1] * y[WL]
    limit_m, limit_l = _limits(p, -p.inv_h)
    if some((stick[0] == 0.0) | (stick[1] == 0.0)):
        hold_m, hold_l, G = _holds(y, p)
        limit_m, limit_l = _limits(p, G)
        e_m = where(slips_m, e_m, limit_m - math.fabs(hold_m))
        e_l = where(slips_l, e_l, limit_l - math.fabs(hold_l))
    return where(limit_m > 0.0, e_m, 1.0), where(limit_l > 0.0, e_l, 1.0)


@code.inner(**COMPILE)
def decide_friction(which, x, p):
    """The mode that follows at an event of friction ``which``: stuck if it can hold, else slipping the way it is pushed."""
    was_stuck = x.stick[which] == 0.0
    x.y[WM if which == 0 else WL] = 0.0
    hold_m, hold_l, G = _holds(x.y, p)
    limit_m, limit_l = _limits(p, G)
    hold, limit = (hold_m, limit_m) if which == 0 else (hold_l, limit_l)
    if math.fabs(hold) <= limit:
        x.stick[which] = 0.0
        x.counters[STICKS] += 1
        x.counters[ROTOR_STICKS] += 1 if which == 0 else 0
    else:
        x.stick[which] = math.copysign(1.0, hold)
        x.counters[BREAKAWAYS] += 1 if was_stuck else 0


@code.entry(**COMPILE)
def initial_friction(x: State, p: Drive) -> None:
    """Friction modes at the start: slipping where there is motion or no friction, stuck where friction can hold."""
    hold_m, hold_l, G = _holds(x.y, p)
    limit_m, limit_l = _limits(p, G)
    for which in range(2):
        hold, limit, rate = (hold_m, limit_m, x.y[WM]) if which == 0 else (hold_l, limit_l, x.y[WL])
        if rate == 0.0 and limit > 0.0:
            x.stick[which] = 0.0 if math.fabs(hold) <= limit else math.copysign(1.0, hold)
        else:
            x.stick[which] = math.copysign(1.0, rate) if limit > 0.0 else 1.0


@code.inner(**COMPILE)
def first_trial(which, h, e_hi, x, p, w, search):
    """Begin the search for the length, below ``h``, at which the margin ``which`` is just spent; returns the first trial.

    ``e_hi`` < 0 is the margin at the end of the step of length ``h``, whose continuous extension supplies the trial, by false
    position. The search starts with the bracket [0, h]. The event counts as found where the margin is at most ``enough`` below
    zero: a thousandth of the tolerance in rate, or a millionth of the breakaway torque.
    """
    slips = x.stick[which] != 0.0
    enough = 1e-3 / p.scale[WM if which == 0 else WL] if slips else 1e-6 * _limits(p, -p.inv_h)[which]
    e_lo = margins(x.y, x.stick, p)[which]
    search[LO], search[HI], search[E_LO], search[E_HI], search[ENOUGH], search[TRIALS] = 0.0, h, e_lo, e_hi, enough, 0.0
    s_lo, s_hi, g_lo, g_hi = 0.0, 1.0, e_lo, e_hi
    for _ in range(6):
        # The margin at the start is zero right after an event; false position would then stay there.
        s = s_lo + (s_hi - s_lo) * (g_lo / (g_lo - g_hi) if g_lo > 0.0 else 0.25)
        interpolate(s, x.y, w)
        e = margins(w.between, x.stick, p)[which]
        if e < 0.0:
            s_hi, g_hi = s, e
        else:
            s_lo, g_lo = s, e
        if math.fabs(e) < enough:
            break
    return h * s_hi


@code.inner(**COMPILE)
def next_trial(trial, e, search):
    """The next length to try, after the step of length ``trial`` ended with the margin ``e``; ``trial`` itself once it is found.

    False position in its Illinois variant: where the upper end moves again, the margin at the lower end is halved, which
    keeps the bracket from shrinking from one side only. It ends on the upper end of the bracket, just past the event.
    """
    lo, hi, e_lo, e_hi, enough = search[LO], search[HI], search[E_LO], search[E_HI], search[ENOUGH]
    if e < 0.0:
        hi, e_hi = trial, e
        e_lo *= 0.5 if search[TRIALS] > 0.0 else 1.0
    else:
        lo, e_lo = trial, e
    search[LO], search[HI], search[E_LO], search[E_HI] = lo, hi, e_lo, e_hi
    search[TRIALS] += 1.0
    if search[TRIALS] == MAX_TRIALS:
        return trial
    if e_hi >= -enough or hi - lo <= 1e-12 * hi:
        return hi
    if e_lo > 0.0:
        # Aim slightly past the root: the step must end on its far side, with the margin in [-enough, 0].
        trial = lo + (hi - lo) * (e_lo + 0.5 * enough) / (e_lo - e_hi)
        return min(max(trial, lo + 1e-3 * (hi - lo)), hi - 1e-3 * (hi - lo))
    return 0.25 * hi  # no margin at the start, right after an event: nothing to interpolate


@code.inner(**INLINE)
def next_event(which, after_m, after_l):
    """The friction whose event the step must end at, -1 if none: once that of ``which`` is located, only the other is earlier."""
    if which < 0:
        return 0 if after_m < 0.0 else (1 if after_l < 0.0 else -1)
    other = after_l if which == 0 else after_m
    return 1 - which if other < 0.0 else -1


@code.inner(**COMPILE)
def _shorten_to_event(which, h, e_hi, x, p, w):
    """Repeat the step until it ends where the margin ``which`` is just spent; returns its length and its error.

    An error above 1 ends the search: where friction falls steeply with the rate, a shorter step may be singular although the
    longer one was not.
    """
    trial = first_trial(which, h, e_hi, x, p, w, w.search)
    while True:
        error = step(trial, x, p, w)
        x.counters[EVENT_STEPS] += 1
        if not error <= 1.0:
            return trial, error
        following = next_trial(trial, margins(w.y1, x.stick, p)[which], w.search)
        if following == trial:
            return trial, error
        trial = following


@code.inner(**COMPILE)
def _end_at_first_event(h, x, p, w):
    """Shorten the step in ``w`` so that it ends at its first friction event; its length, which friction or -1, and its error.

    Margins are checked in the middle and at the end of the step: a margin spent in the middle and regained at the end (a body
    that reverses twice) is met by halving the step. Locating one event may bring the other friction's to light, which is then
    earlier; so both are checked again. A step with an error above 1 must not be taken.
    """
    interpolate(0.5, x.y, w)
    middle, after, error = margins(w.between, x.stick, p), margins(w.y1, x.stick, p), 0.0
    if min(middle[0], middle[1]) < 0.0 <= min(after[0], after[1]):
        h *= 0.5
        error = step(h, x, p, w)
        dense(w)
        after = margins(w.y1, x.stick, p)
    event = -1
    for _ in range(MAX_EVENTS):
        which = next_event(event, after[0], after[1])
        if which < 0 or not error <= 1.0:
            break
        event = which
        h, error = _shorten_to_event(event, h, after[event], x, p, w)
        dense(w)
        after = margins(w.y1, x.stick, p)
    return h, event, error


# ---- Samples ----


@code.inner(**INLINE)
def _record(h, end, x, p, w, out):
    """Integrate all channels over the step to ``end``; close every sample interval that ends inside it.

    A sample is the mean over its interval, by Gauss quadrature on each piece of it: two points, or one where a piece is
    less than a tenth of a step. Pieces end where steps end and steps end at events, so jumps are averaged exactly, not sampled.
    """
    clock, cursor, channels = x.clock, out.cursor, w.channels
    t = a = clock[NOW]
    while a < end:
        recording = cursor[0] < out.rows.shape[0]
        inside = recording and a >= out.first
        boundary = out.first + (cursor[0] + cursor[1] + 1) * out.width if inside else out.first
        reaches = recording and boundary <= end + 1e-6 * out.width  # the last digits of two sums may differ
        b = min(boundary, end) if reaches else end
        nodes = 1 if b - a < 0.1 * h else 2
        weight = (b - a) / nodes
        for node in range(nodes):
            point = 0.5 * (a + b) + (0.0 if nodes == 1 else (2.0 * node - 1.0) * GAUSS * (b - a))
            interpolate((point - t) / h, x.y, w)
            _channels(w.between, clock, x.stick, p, w.f, w.q, channels)
            for j in range(N_POWERS):
                x.energy[j] += weight * channels[POWERS + j]
            clock[IMPULSE] += weight * channels[T_D_FORCE]
            clock[MISMATCH] = max(clock[MISMATCH], math.fabs(channels[T_D] - channels[T_D_FORCE]))
            clock[LARGEST] = max(clock[LARGEST], math.fabs(channels[T_D]))
            if inside:
                clock[WEIGHT] += weight
                for j in range(channels.size):
                    out.partial[j] += weight * channels[j]
        if reaches and inside:
            for j in range(channels.size):
                out.rows[cursor[0], j] = out.partial[j] / clock[WEIGHT]  # not the width: late in a run it is rounded
                out.partial[j] = 0.0
            clock[WEIGHT] = 0.0
            for j in range(N_POWERS):  # energies: their values at the middle of the interval
                out.rows[cursor[0], POWERS + j] = x.energy[j] - 0.5 * out.width * out.rows[cursor[0], POWERS + j]
            cursor[0] += 1
        a = b


# ---- Length of steps ----


@code.inner(**INLINE)
def first_length(proposed, longest, left):
    """Length to try first, with ``left`` to go to the target; a remainder of less than 1.5 steps is halved, not cut short."""
    h = min(proposed, longest)
    if h >= left:
        return left
    return 0.5 * left if 1.5 * h > left else h


@code.inner(**INLINE)
def growth(error):
    """Factor on the length of a step that would bring its ``error`` to 1, with a safety margin, from 0.2 to 5."""
    return min(5.0, max(0.2, 0.9 / math.sqrt(math.sqrt(error)))) if error > 0.0 else 5.0


@code.inner(**INLINE)
def shortened(h, error):
    """Length of the next trial after one of length ``h`` was rejected."""
    return h * (growth(error) if math.isfinite(error) else 0.1)


@code.inner(**INLINE)
def proposal(proposed, h, requested, left, factor):
    """Length for the next step. A step cut short by its target says nothing against the length proposed before."""
    return h * factor if h < requested or h < left else max(h * factor, proposed)


@code.inner(**INLINE)
def too_small(h, now, error):
    """Status after a rejected step that is to be repeated with the length ``h``."""
    if h < 1e-14 * max(1.0, now):
        return STEP_TOO_SMALL if math.isfinite(error) else NOT_FINITE
    return OK


@code.inner(**INLINE)
def follow(x, p):
    """With a rigid reducer, set the output from the rotor."""
    if p.rigid:
        e0, e1, _, _ = transmission_error(x.y[TM], p.te)
        x.y[TL], x.y[WL] = e0 - x.y[TM] * p.inv_h, (e1 - p.inv_h) * x.y[WM]


@code.inner(**INLINE)
def health(lag, h, now, stalled):
    """Status after a step of length ``h`` with the rotor an electrical angle ``lag`` off; count of vanishing steps in a row."""
    stalled = stalled + 1 if h < 1e-12 * max(1.0, now) else 0
    if math.fabs(lag) > math.pi:
        return LOST_SYNCHRONISM, stalled
    return (STEP_TOO_SMALL if stalled > 1000 else OK), stalled


@code.inner(**INLINE)
def _accepted_step(left, x, p, w):
    """Step from ``x.y`` that passes the error test, at most ``left`` long, into ``w``; its length, and a status code."""
    h = requested = first_length(x.clock[NEXT_STEP], p.max_step, left)
    while True:
        error = step(h, x, p, w)
        factor = growth(error)
        if error <= 1.0:
            break
        x.counters[REJECTED] += 1
        h = shortened(h, error)
        status = too_small(h, x.clock[NOW], error)
        if status != OK:
            return h, status
    x.clock[NEXT_STEP] = proposal(x.clock[NEXT_STEP], h, requested, left, factor)
    return h, OK


# ---- The loop ----


@code.entry(**COMPILE)
def advance(stop: float, x: State, p: Drive, out: Samples, steps_t: Vector, steps_ref: Matrix, scratch: Matrix) -> int:
    """Advance the drive ``p`` to the time ``stop``; state ``x`` and samples ``out`` are updated in place.

    Each turn of the loop either takes a microstep that is due (new current references, and a step short enough for the
    transient that follows), or one step: to the next microstep at most, shortened until its error estimate passes, shortened
    again to the first friction event inside it. Only then are samples integrated and the state moved on.

    ``steps_t`` (n,) are the times of the microsteps before ``stop``, ``steps_ref`` (n, 3) the references i_A*, i_B* and the
    electrical angle after each, ``scratch`` (SCRATCH_ROWS, wide enough). Returns a status code.
    """
    n, s = x.y.size, p.H.size
    w = Work(
        scratch[0, :n], scratch[1, :n], scratch[2, :n], scratch[3, :n], scratch[4], scratch[5], scratch[6],
        scratch[7], scratch[8], scratch[9, : N_CHANNELS + 2 * s], scratch[10 : 10 + STAGES, :n], scratch[16:18, :n], scratch[18],
    )  # fmt: skip
    clock, coming, stalled = x.clock, 0, 0
    while clock[NOW] < stop:
        target = stop
        if coming < steps_t.size and steps_t[coming] < stop:
            target = steps_t[coming]
        if target <= clock[NOW]:
            clock[REF_A], clock[REF_B], clock[THETA_E] = (
                steps_ref[coming, 0],
                steps_ref[coming, 1],
                steps_ref[coming, 2],
            )
            coming += 1
            x.counters[MICROSTEPS] += 1
            clock[NEXT_STEP] = min(clock[NEXT_STEP], p.layer)
            continue
        derivative(x.y, clock, x.stick, p, w.f0, w.q)
        linearise(x, p, w)
        left = target - clock[NOW]
        h, status = _accepted_step(left, x, p, w)
        if status != OK:
            return status
        dense(w)
        h, event, error = _end_at_first_event(h, x, p, w)
        if not error <= 1.0:
            x.counters[REJECTED] += 1
            clock[NEXT_STEP] = shortened(h, error)
            status = too_small(clock[NEXT_STEP], clock[NOW], error)
            if status != OK:
                return status
            continue
        # A step that reaches its target ends there to the last digit, so that sample intervals close where they should.
        end = target if h == left else clock[NOW] + h
        if out.width > 0.0:
            _record(h, end, x, p, w, out)
        x.counters[STEPS] += 1
        clock[NOW] = end
        for j in range(n):
            x.y[j] = w.y1[j]
        if event >= 0:
            decide_friction(event, x, p)
        follow(x, p)
        status, stalled = health(p.z * x.y[TM] - clock[THETA_E], h, clock[NOW], stalled)
        if status != OK:
            return status
    return OK


@code.entry(**COMPILE)
def snapshot(x: State, p: Drive, scratch: Matrix, out: Vector) -> None:
    """All channels at the present state, into ``out``."""
    _channels(x.y, x.clock, x.stick, p, scratch[0, : x.y.size], scratch[1], out)


@code.entry(**COMPILE)
def filter_and_decimate(rows: Matrix, taps: Vector, factor: int, out: Matrix) -> None:
    """``out[m] = sum over k of taps[k] rows[factor m + k]`` for each channel; rows (n, channels), out (m, channels)."""
    for m in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[m, j] = 0.0
        for k in range(taps.size):
            for j in range(out.shape[1]):
                out[m, j] += taps[k] * rows[factor * m + k, j]
