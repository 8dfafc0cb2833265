"""The one hot loop: the drive's equations, integrated with exact stick and slip.

Between two events (a microstep of the command, a friction that sticks, breaks away or reverses, a phase
that meets its supply limit) the motion is smooth, and is advanced by RODAS4, an L-stable Rosenbrock method of
order 4(3) with an embedded error estimate (E. Hairer, G. Wanner, *Solving Ordinary Differential Equations II*,
section IV.7). Events end a step, so that no step crosses one:

* microsteps are known in advance;
* a friction event is located by repeating the step until the sign change is met to rounding.

Friction is set-valued: a stuck body has velocity zero exactly and no law with a smoothing width appears anywhere.

The linear systems of the method are solved by block elimination: windings, angles and array modes are eliminated
in closed form and a 2 x 2 system in the two velocities is left. Cost is linear in the number of modes.

Everything that the loop calls lives in this file, because the compiled cache is keyed on it.

State ``y``: i_A, i_B, x_A, x_B (integrals of the current errors), theta_m, omega_m, theta_l, omega_l, and for each mode
``eta, w`` with ``w = d eta/dt + H omega_l`` (the mode's absolute momentum), in which the mass matrix is diagonal.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

# No exceptions inside (a division by zero gives inf and is caught by the step control); products may be fused; no
# reference counts, for no array is made inside.
COMPILE = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False, "fastmath": {"contract", "arcp"}}


class Parameters(NamedTuple):
    """Numbers of one drive, in SI units, as the kernel takes them. All are floats; ``rigid`` is a flag."""

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
    h: float
    K_g: float
    C_g: float
    rigid: bool
    # friction: sliding level (Coulomb and slip ring), Stribeck excess, rate, shape, viscous
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
    inv_L: float
    inv_L_D: float  # 1 / (L + K_D): the derivative acts on the measured current
    inv_J_m: float
    inv_J_L: float
    inv_h: float
    max_step: float
    layer: float  # first step after a microstep: a part of the current loop's time constant


IA, IB, XA, XB, TM, WM, TL, WL, MODES = range(9)

# --- channels of a sample; the modal coordinates and their rates follow ----------------------------------------------
CHANNELS = (
    "i_A", "i_B", "u_A", "u_B", "i_ref_A", "i_ref_B",
    "theta_m", "omega_m", "alpha_m", "theta_l", "omega_l", "alpha_l",
    "T_e", "T_f_m", "T_f", "T_g", "T_l", "T_d", "T_d_force",
    "stuck_rotor", "stuck_output",
    "E_kinetic", "E_magnetic", "E_elastic",
    "P_electrical", "P_joule", "P_friction", "P_damping",
)  # fmt: skip
N_CHANNELS = len(CHANNELS)
C_KINETIC, C_MAGNETIC, C_ELASTIC = 21, 22, 23
C_TD, C_TDF = 17, 18
N_POWERS = 4  # the last four channels are powers, integrated over the whole run
POWERS = N_CHANNELS - N_POWERS

# --- what `advance` reports ------------------------------------------------------------------------------------------
OK, LOST_SYNCHRONISM, STEP_TOO_SMALL, NOT_FINITE = range(4)
# counters
N_STEPS, N_REJECTED, N_MICROSTEPS, N_STICK, N_BREAKAWAY, N_EVENT_STEPS = range(6)
N_COUNTERS = 6
# entries of the running-time vector
T_NOW, H_NEXT, REF_A, REF_B, THETA_E, MAX_MISMATCH, MAX_TORQUE, IMPULSE = range(8)
N_CLOCK = 8
# rows of the scratch array
N_SCRATCH = 18

# RODAS4 (order 4, L-stable, stiffly accurate), in the form without matrix products; same source as above.
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
# Continuous extension of order 3: y(s) = (1-s) y0 + s (y1 + (1-s) (d2 + s d3)), d2 = DENSE[0] . K, d3 = DENSE[1] . K
DENSE = np.array(
    [
        [10.12623508344586, -7.487995877610167, -34.80091861555747, -7.992771707568823, 1.025137723295662],
        [-0.6762803392801253, 6.087714651680015, 16.43084320892478, 24.76722511418386, -6.594389125716872],
    ]
)

GAUSS = 0.5 / math.sqrt(3.0)


@njit(inline="always", **COMPILE)
def _friction(sign, rate, slide, stribeck, inv_rate, shape, viscous):
    """Friction torque and its slope while slipping towards ``sign`` (Eq. 5-7); continued past zero rate."""
    speed = sign * rate
    torque = slide
    slope = viscous
    if stribeck != 0.0:
        x = speed * inv_rate
        if x <= 0.0:
            # Only stages that overshoot a stop come here, and the step is then repeated up to the stop.
            torque += stribeck
        elif x < 700.0:
            if shape == 1.0:
                e = math.exp(-x)
                slope -= stribeck * e * inv_rate
            else:
                power = x**shape
                e = math.exp(-power)
                slope -= stribeck * e * shape * power / x * inv_rate
            torque += stribeck * e
    return sign * torque + viscous * rate, slope


@njit(inline="always", **COMPILE)
def _transmission_error(theta_m, te):
    """Kinematic error epsilon(theta_m) of the reducer [rad at the output] and its first three derivatives."""
    e0 = e1 = e2 = e3 = 0.0
    for j in range(te.shape[1]):
        n = te[0, j]
        s, c = math.sin(n * theta_m), math.cos(n * theta_m)
        value, quarter = te[1, j] * s + te[2, j] * c, te[1, j] * c - te[2, j] * s
        e0 += value
        e1 += n * quarter
        e2 -= n * n * value
        e3 -= n * n * n * quarter
    return e0, e1, e2, e3


@njit(inline="always", **COMPILE)
def _winding(i, x, reference, back_emf, p):
    """Voltage, di/dt, dx/dt and whether the supply limits the phase (Eq. 2, 3). Back-calculation anti-windup."""
    demand = p.K_P * (reference - i) + p.K_I * x
    di = (demand - p.R * i + back_emf) * p.inv_L_D
    u = demand - p.K_D * di
    if math.fabs(u) <= p.U_max:
        return u, di, reference - i, False
    u = math.copysign(p.U_max, u)
    dx = 0.0
    if p.K_P > 0.0:
        dx = (u - p.K_I * x) / p.K_P
    return u, (u - p.R * i + back_emf) * p.inv_L, dx, True


@njit(inline="always", **COMPILE)
def _derivative(y, clock, stick, p, H, D, Lam, te, f, q):
    """Right-hand side ``f`` and the instantaneous torques ``q`` = T_e, T_f,m, T_f, T_g, u_A, u_B (Eq. 2-7, 16-18)."""
    theta_m, omega_m = y[TM], y[WM]
    s, c = math.sin(p.z * theta_m), math.cos(p.z * theta_m)
    u_A, f[IA], f[XA], _ = _winding(y[IA], y[XA], clock[REF_A], p.K_m * omega_m * s, p)
    u_B, f[IB], f[XB], _ = _winding(y[IB], y[XB], clock[REF_B], -p.K_m * omega_m * c, p)
    sin4 = 4.0 * s * c * (c * c - s * s)  # sin(4 z theta_m)
    T_e = p.K_m * (y[IB] * c - y[IA] * s) - p.K_d * sin4

    e0, e1, e2, _ = _transmission_error(theta_m, te)
    G = e1 - p.inv_h  # d theta_l / d theta_m of the rigid reducer
    rigid = p.rigid
    omega_l = G * omega_m if rigid else y[WL]

    modal = 0.0  # torque of the modes on the shaft
    for k in range(H.size):
        eta, w = y[MODES + 2 * k], y[MODES + 2 * k + 1]
        rate = w - H[k] * omega_l
        pull = D[k] * rate + Lam[k] * eta
        f[MODES + 2 * k] = rate
        f[MODES + 2 * k + 1] = -pull
        modal += H[k] * pull

    if rigid:
        sign_l = -stick[0]
        mass = p.J_m + G * G * p.J_L
        bias = -G * e2 * p.J_L * omega_m * omega_m
        if stick[0] == 0.0:
            # One degree of freedom, two frictions: the hold is shared in proportion to what each can hold.
            hold = T_e + G * modal
            limit_m = p.m_slide + p.m_stribeck
            limit_l = math.fabs(G) * (p.l_slide + p.l_stribeck)
            T_fm = hold * limit_m / (limit_m + limit_l)
            T_f = (hold - T_fm) / G
            alpha_m = 0.0
        else:
            T_fm, _ = _friction(stick[0], omega_m, p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous)
            T_f, _ = _friction(sign_l, omega_l, p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous)
            alpha_m = (T_e - T_fm + G * (modal - T_f) + bias) / mass
        alpha_l = G * alpha_m + e2 * omega_m * omega_m
        T_g = p.J_L * alpha_l + T_f - modal
        f[TL] = 0.0
        f[WL] = 0.0
        q[6] = alpha_l
    else:
        gamma = e0 - theta_m * p.inv_h - y[TL]
        T_g = p.K_g * gamma + p.C_g * (G * omega_m - omega_l)
        if stick[0] == 0.0:
            T_fm = T_e - G * T_g
            alpha_m = 0.0
        else:
            T_fm, _ = _friction(stick[0], omega_m, p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous)
            alpha_m = (T_e - T_fm - G * T_g) * p.inv_J_m
        if stick[1] == 0.0:
            T_f = T_g + modal
            f[WL] = 0.0
        else:
            T_f, _ = _friction(stick[1], omega_l, p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous)
            f[WL] = (T_g - T_f + modal) * p.inv_J_L
        f[TL] = omega_l
        q[6] = f[WL]
    f[TM] = omega_m
    f[WM] = alpha_m
    q[0], q[1], q[2], q[3], q[4], q[5] = T_e, T_fm, T_f, T_g, u_A, u_B


@njit(inline="always", **COMPILE)
def _channels(y, clock, stick, p, H, D, Lam, te, f, q, out):
    """All channels of one instant, from the state. ``T_d`` by momentum (Eq. 20), ``T_d_force`` from the housing."""
    _derivative(y, clock, stick, p, H, D, Lam, te, f, q)
    T_e, T_fm, T_f, T_g, u_A, u_B, alpha_l = q[0], q[1], q[2], q[3], q[4], q[5], q[6]
    theta_m, omega_m, alpha_m = y[TM], y[WM], f[WM]
    e0, e1, _, _ = _transmission_error(theta_m, te)
    G = e1 - p.inv_h
    theta_l, omega_l = y[TL], y[WL]
    gamma = e0 - theta_m * p.inv_h - theta_l
    if p.rigid:
        theta_l, omega_l = e0 - theta_m * p.inv_h, G * omega_m
        gamma = 0.0

    kinetic = 0.5 * (p.J_m * omega_m**2 + p.J_L * omega_l**2)
    elastic = -0.25 * p.K_d / p.z * math.cos(4.0 * p.z * theta_m)
    damping = 0.0
    slip = G * omega_m - omega_l
    if not p.rigid:
        elastic += 0.5 * p.K_g * gamma**2
        damping = p.C_g * slip * slip
    modal_rate = 0.0
    n = H.size
    for k in range(n):
        eta, w = y[MODES + 2 * k], y[MODES + 2 * k + 1]
        rate = f[MODES + 2 * k]
        kinetic += 0.5 * w * w
        elastic += 0.5 * Lam[k] * eta * eta
        damping += D[k] * rate * rate
        modal_rate += H[k] * f[MODES + 2 * k + 1]
        out[N_CHANNELS + k] = eta
        out[N_CHANNELS + n + k] = rate
    out[0], out[1], out[2], out[3], out[4], out[5] = y[IA], y[IB], u_A, u_B, clock[REF_A], clock[REF_B]
    out[6], out[7], out[8] = theta_m, omega_m, alpha_m
    out[9], out[10], out[11] = theta_l, omega_l, alpha_l
    out[12], out[13], out[14], out[15] = T_e, T_fm, T_f, T_g
    out[16] = p.J_h * alpha_l + modal_rate
    out[17] = -(p.J_L * alpha_l + modal_rate + p.J_m * alpha_m)
    out[18] = -T_e + T_fm + T_f - T_g * (1.0 - G)
    out[19] = 1.0 if stick[0] == 0.0 else 0.0
    out[20] = 1.0 if (stick[0] if p.rigid else stick[1]) == 0.0 else 0.0
    out[21] = kinetic
    out[22] = 0.5 * p.L * (y[IA] ** 2 + y[IB] ** 2)
    out[23] = elastic
    out[24] = u_A * y[IA] + u_B * y[IB]
    out[25] = p.R * (y[IA] ** 2 + y[IB] ** 2)
    out[26] = T_fm * omega_m + T_f * omega_l
    out[27] = damping


@njit(inline="always", **COMPILE)
def _linearise(y, clock, stick, p, H, D, Lam, te, f, q, jac):
    """What the Jacobian needs besides constants, at the state whose derivative is ``f, q``."""
    theta_m, omega_m = y[TM], y[WM]
    s, c = math.sin(p.z * theta_m), math.cos(p.z * theta_m)
    _, _, _, sat_A = _winding(y[IA], y[XA], clock[REF_A], p.K_m * omega_m * s, p)
    _, _, _, sat_B = _winding(y[IB], y[XB], clock[REF_B], -p.K_m * omega_m * c, p)
    cos4 = 1.0 - 8.0 * s * s * c * c
    stiffness = -p.z * p.K_m * (y[IB] * s + y[IA] * c) - 4.0 * p.z * p.K_d * cos4
    _, e1, e2, e3 = _transmission_error(theta_m, te)
    G = e1 - p.inv_h
    _, slope_m = _friction(stick[0], omega_m, p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous)
    if p.rigid:
        omega_l = G * omega_m
        _, slope_l = _friction(-stick[0], omega_l, p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous)
        modal = p.J_L * q[6] + q[2] - q[3]
        stiffness += e2 * (modal - q[2]) - (e2 * e2 + G * e3) * p.J_L * omega_m**2 - 2.0 * G * e2 * p.J_L * f[WM]
        slope_m += 2.0 * G * e2 * p.J_L * omega_m
    else:
        _, slope_l = _friction(stick[1], y[WL], p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous)
        stiffness -= e2 * q[3]
    jac[0], jac[1], jac[2], jac[3] = s, c, stiffness, slope_m
    jac[4], jac[5], jac[6] = slope_l, G, e2 * omega_m
    jac[7] = 1.0 if sat_A else 0.0
    jac[8] = 1.0 if sat_B else 0.0
    jac[9] = omega_m


@njit(inline="always", **COMPILE)
def _winding_pivot(g, inv_g, saturated, p):
    """Elimination of one phase: pivot of its current, weight of its integral's residual, and the two integral terms."""
    if saturated:
        rate = p.K_I / p.K_P if p.K_P > 0.0 else 0.0
        return 1.0 / (g + p.R * p.inv_L), 0.0, 1.0 / (g + rate), 0.0, p.inv_L
    b = p.K_I * p.inv_L_D * inv_g
    return 1.0 / (g + (p.K_P + p.R) * p.inv_L_D + b), b, inv_g, 1.0, p.inv_L_D


@njit(inline="always", **COMPILE)
def _factor(g, stick, p, H, D, Lam, jac, lu, kappa, inv_delta):
    """Eliminate windings, angles and modes from ``g I - df/dy``; keep the pivots."""
    s, c, stiffness, slope_m, slope_l, G = jac[0], jac[1], jac[2], jac[3], jac[4], jac[5]
    inv_g = 1.0 / g
    pivot_A, xw_A, xd_A, xi_A, inv_L_A = _winding_pivot(g, inv_g, jac[7] != 0.0, p)
    pivot_B, xw_B, xd_B, xi_B, inv_L_B = _winding_pivot(g, inv_g, jac[8] != 0.0, p)
    back_emf = p.K_m * p.z * jac[9]
    theta_A = back_emf * c * inv_L_A
    theta_B = back_emf * s * inv_L_B
    beta_A = (p.K_m * s * inv_L_A + theta_A * inv_g) * pivot_A
    beta_B = (-p.K_m * c * inv_L_B + theta_B * inv_g) * pivot_B
    modal = 0.0
    for k in range(H.size):
        kappa[k] = D[k] + Lam[k] * inv_g
        inv_delta[k] = 1.0 / (g + kappa[k])
        modal += H[k] * H[k] * kappa[k] * g * inv_delta[k]
    rotor = p.K_m * (s * beta_A - c * beta_B) - stiffness * inv_g + slope_m
    lu[0], lu[1], lu[2], lu[3], lu[4], lu[5] = pivot_A, xw_A, xd_A, xi_A, theta_A, beta_A
    lu[6], lu[7], lu[8], lu[9], lu[10], lu[11] = pivot_B, xw_B, xd_B, xi_B, theta_B, beta_B
    if p.rigid:
        lead = G + jac[6] * inv_g
        drag = slope_l + modal
        mass = p.J_m + G * G * p.J_L
        lu[12], lu[13], lu[14], lu[15] = 1.0 / (mass * g + rotor + G * drag * lead), drag, lead, mass
        return
    gear_theta = p.K_g * G + p.C_g * jac[6]
    gear_m = gear_theta * inv_g + p.C_g * G
    gear_l = p.C_g + p.K_g * inv_g
    a11 = p.J_m * g + rotor + G * gear_m
    a12 = -G * gear_l
    a22 = p.J_L * g + gear_l + slope_l + modal
    # Inverse of the 2 x 2 system in the two accelerations; a stuck body has none.
    lu[12] = lu[13] = lu[14] = lu[15] = 0.0
    lu[16] = gear_theta
    if stick[0] != 0.0 and stick[1] != 0.0:
        inverse = 1.0 / (a11 * a22 + a12 * gear_m)
        lu[12], lu[13], lu[14], lu[15] = a22 * inverse, -a12 * inverse, gear_m * inverse, a11 * inverse
    elif stick[0] != 0.0:
        lu[12] = 1.0 / a11
    elif stick[1] != 0.0:
        lu[15] = 1.0 / a22


@njit(inline="always", **COMPILE)
def _solve(g, stick, p, H, Lam, jac, lu, kappa, inv_delta, r):
    """Solve ``(g I - df/dy) u = r`` in place with the pivots of ``_factor``."""
    s, c, G = jac[0], jac[1], jac[5]
    inv_g = 1.0 / g
    stuck_m = stick[0] == 0.0
    alpha_A = (r[IA] + lu[1] * r[XA] + lu[4] * r[TM] * inv_g) * lu[0]
    alpha_B = (r[IB] + lu[7] * r[XB] + lu[10] * r[TM] * inv_g) * lu[6]
    rotor = p.K_m * (c * alpha_B - s * alpha_A) + jac[2] * r[TM] * inv_g
    modal = 0.0
    for k in range(H.size):
        r_eta = r[MODES + 2 * k]
        rho = r[MODES + 2 * k + 1] - Lam[k] * r_eta * inv_g
        modal += H[k] * (kappa[k] * rho * inv_delta[k] + Lam[k] * r_eta * inv_g)
    u_m = u_l = 0.0
    if p.rigid:
        shift = jac[6] * r[TM] * inv_g
        if not stuck_m:
            u_m = (lu[15] * r[WM] + rotor + G * (modal - lu[13] * shift)) * lu[12]
            u_l = lu[14] * u_m + shift
        r[TL] = 0.0
        r[WL] = 0.0
    else:
        stuck_l = stick[1] == 0.0
        gear = (lu[16] * r[TM] - p.K_g * r[TL]) * inv_g
        b1 = p.J_m * r[WM] + rotor - G * gear
        b2 = p.J_L * r[WL] + gear + modal
        u_m = lu[12] * b1 + lu[13] * b2
        u_l = lu[14] * b1 + lu[15] * b2
        r[TL] = 0.0 if stuck_l else (r[TL] + u_l) * inv_g
        r[WL] = u_l
    r[IA] = alpha_A + lu[5] * u_m
    r[IB] = alpha_B + lu[11] * u_m
    r[XA] = (r[XA] - lu[3] * r[IA]) * lu[2]
    r[XB] = (r[XB] - lu[9] * r[IB]) * lu[8]
    r[TM] = 0.0 if stuck_m else (r[TM] + u_m) * inv_g
    r[WM] = u_m
    for k in range(H.size):
        r_eta = r[MODES + 2 * k]
        rho = r[MODES + 2 * k + 1] - Lam[k] * r_eta * inv_g
        u_w = (rho + kappa[k] * H[k] * u_l) * inv_delta[k]
        r[MODES + 2 * k] = (r_eta + u_w - H[k] * u_l) * inv_g
        r[MODES + 2 * k + 1] = u_w


@njit(**COMPILE)
def _step(h, y, y1, K, f0, q, clock, stick, p, H, D, Lam, te, jac, lu, kappa, inv_delta, scale, f):
    """One RODAS4 step of size ``h`` from ``y`` (whose derivative is ``f0``); the scaled error is returned."""
    n = y.size
    g = 1.0 / (GAMMA * h)
    ih = 1.0 / h
    _factor(g, stick, p, H, D, Lam, jac, lu, kappa, inv_delta)
    for stage in range(STAGES):
        for j in range(n):
            y1[j] = y[j]
        for m in range(stage):
            for j in range(n):
                y1[j] += A[stage, m] * K[m, j]
        if stage == 0:
            for j in range(n):
                f[j] = f0[j]
        else:
            _derivative(y1, clock, stick, p, H, D, Lam, te, f, q)
        for m in range(stage):
            weight = ih * C[stage, m]
            for j in range(n):
                f[j] += weight * K[m, j]
        _solve(g, stick, p, H, Lam, jac, lu, kappa, inv_delta, f)
        for j in range(n):
            K[stage, j] = f[j]
    error = 0.0
    for j in range(n):
        y1[j] += K[STAGES - 1, j]
        error += (K[STAGES - 1, j] * scale[j]) ** 2
    return math.sqrt(error / n)


@njit(inline="always", **COMPILE)
def _dense(K, dense):
    """Coefficients of the step's continuous extension."""
    for i in range(2):
        for j in range(K.shape[1]):
            total = 0.0
            for m in range(STAGES - 1):
                total += DENSE[i, m] * K[m, j]
            dense[i, j] = total


@njit(inline="always", **COMPILE)
def _interpolate(s, y, y1, dense, out):
    """State at the fraction ``s`` of the last step (order 3)."""
    r = 1.0 - s
    for j in range(y.size):
        out[j] = r * y[j] + s * (y1[j] + r * (dense[0, j] + s * dense[1, j]))


@njit(inline="always", **COMPILE)
def _holds(y, p, H, D, Lam, te):
    """Torque that each friction must hold for its body to stay at rest: rotor, output."""
    theta_m = y[TM]
    s, c = math.sin(p.z * theta_m), math.cos(p.z * theta_m)
    T_e = p.K_m * (y[IB] * c - y[IA] * s) - p.K_d * 4.0 * s * c * (c * c - s * s)
    e0, e1, _, _ = _transmission_error(theta_m, te)
    G = e1 - p.inv_h
    rigid = p.rigid
    omega_l = G * y[WM] if rigid else y[WL]
    modal = 0.0
    for k in range(H.size):
        modal += H[k] * (D[k] * (y[MODES + 2 * k + 1] - H[k] * omega_l) + Lam[k] * y[MODES + 2 * k])
    if rigid:
        return T_e + G * modal, 0.0, G
    T_g = p.K_g * (e0 - theta_m * p.inv_h - y[TL]) + p.C_g * (G * y[WM] - omega_l)
    return T_e - G * T_g, T_g + modal, G


@njit(inline="always", **COMPILE)
def _limits(p, G):
    """Breakaway torques of rotor and output; with a rigid reducer both act on the one degree of freedom."""
    limit_m, limit_l = p.m_slide + p.m_stribeck, p.l_slide + p.l_stribeck
    if p.rigid:
        return limit_m + math.fabs(G) * limit_l, 0.0
    return limit_m, limit_l


@njit(**COMPILE)
def _margins(y, stick, p, H, D, Lam, te):
    """What must stay positive while the modes of friction last: slip speed, or what is left of the breakaway torque."""
    hold_m = hold_l = 0.0
    G = -p.inv_h
    if stick[0] == 0.0 or stick[1] == 0.0:
        hold_m, hold_l, G = _holds(y, p, H, D, Lam, te)
    limit_m, limit_l = _limits(p, G)
    e_m = e_l = 1.0
    if limit_m > 0.0:
        e_m = stick[0] * y[WM] if stick[0] != 0.0 else limit_m - math.fabs(hold_m)
    if limit_l > 0.0:
        e_l = stick[1] * y[WL] if stick[1] != 0.0 else limit_l - math.fabs(hold_l)
    return e_m, e_l


@njit(**COMPILE)
def _settle_friction(which, y, stick, p, H, D, Lam, te, counters):
    """Decide what a friction does at its event: stick if it can hold, else slip the way it is pushed."""
    velocity = WM if which == 0 else WL
    was_stuck = stick[which] == 0.0
    y[velocity] = 0.0
    hold_m, hold_l, G = _holds(y, p, H, D, Lam, te)
    limit_m, limit_l = _limits(p, G)
    hold, limit = (hold_m, limit_m) if which == 0 else (hold_l, limit_l)
    if math.fabs(hold) <= limit:
        stick[which] = 0.0
        counters[N_STICK] += 1
    else:
        stick[which] = math.copysign(1.0, hold)
        if was_stuck:
            counters[N_BREAKAWAY] += 1


@njit(**COMPILE)
def start(y, stick, p, H, D, Lam, te):
    """Modes of friction at the start: stuck where a friction exists and holds, else slipping the way it is pushed."""
    hold_m, hold_l, G = _holds(y, p, H, D, Lam, te)
    limit_m, limit_l = _limits(p, G)
    for which in range(2):
        hold, limit, rate = (hold_m, limit_m, y[WM]) if which == 0 else (hold_l, limit_l, y[WL])
        if limit == 0.0:
            stick[which] = 1.0
        elif rate != 0.0:
            stick[which] = math.copysign(1.0, rate)
        else:
            stick[which] = 0.0 if math.fabs(hold) <= limit else math.copysign(1.0, hold)


@njit(inline="always", **COMPILE)
def _record(
    t, h, y, y1, dense, clock, stick, p, H, D, Lam, te, energy, sampling, rows, partial, cursor, work, f, q, chan
):
    """Integrate all channels over the step; close every sample interval that ends inside it.

    A sample is the mean over its interval, by Gauss quadrature on each piece of it: two points, or one where a piece is
    a small part of a step. Pieces end at steps and steps end at events, so jumps are averaged exactly, not sampled.
    """
    first, width = sampling[0], sampling[1]
    n_chan = chan.size
    end = t + h
    a = t
    while a < end:
        recording = cursor[0] < rows.shape[0]
        inside = recording and a >= first
        b = end
        closes = False
        if recording:
            boundary = first + (cursor[0] + cursor[1] + 1) * width if inside else first
            if boundary <= end:
                b = boundary
                closes = inside
        length = b - a
        nodes = 1 if length < 0.25 * h else 2
        weight = length / nodes
        for node in range(nodes):
            x = 0.5 * (a + b) + (0.0 if nodes == 1 else (2.0 * node - 1.0) * GAUSS * length)
            _interpolate((x - t) / h, y, y1, dense, work)
            _channels(work, clock, stick, p, H, D, Lam, te, f, q, chan)
            for j in range(N_POWERS):
                energy[j] += weight * chan[POWERS + j]
            clock[IMPULSE] += weight * chan[C_TDF]
            clock[MAX_MISMATCH] = max(clock[MAX_MISMATCH], math.fabs(chan[C_TD] - chan[C_TDF]))
            clock[MAX_TORQUE] = max(clock[MAX_TORQUE], math.fabs(chan[C_TD]))
            if inside:
                for j in range(n_chan):
                    partial[j] += weight * chan[j]
        if closes:
            row = rows[cursor[0]]
            for j in range(n_chan):
                row[j] = partial[j] / width
                partial[j] = 0.0
            for j in range(N_POWERS):  # energies, as they stand at the middle of the interval
                row[POWERS + j] = energy[j] - 0.5 * width * row[POWERS + j]
            cursor[0] += 1
        a = b


@njit(**COMPILE)
def _shorten_to_event(
    event,
    h,
    e_hi,
    y,
    y1,
    K,
    dense,
    work,
    f0,
    q,
    clock,
    stick,
    p,
    H,
    D,
    Lam,
    te,
    jac,
    lu,
    kappa,
    inv_delta,
    scale,
    f,
    counters,
):
    """Repeat the step with the length at which the margin ``event`` is just spent; return that length.

    The first trial comes from the continuous extension, the others from the Illinois variant of false position on the
    step's own end, so that the accuracy of the event is that of the step.
    """
    velocity = WM if event == 0 else WL
    slips = stick[event] != 0.0
    enough = 1e-3 / scale[velocity] if slips else 1e-6 * _limits(p, -p.inv_h)[event]
    lo, hi = 0.0, h
    e_lo = _margins(y, stick, p, H, D, Lam, te)[event]
    s_lo, s_hi, g_lo, g_hi = 0.0, 1.0, e_lo, e_hi
    for _ in range(6):
        s = s_lo + (s_hi - s_lo) * (g_lo / (g_lo - g_hi) if g_lo > 0.0 else 0.25)
        _interpolate(s, y, y1, dense, work)
        e = _margins(work, stick, p, H, D, Lam, te)[event]
        if e < 0.0:
            s_hi, g_hi = s, e
        else:
            s_lo, g_lo = s, e
        if math.fabs(e) < enough:
            break
    x = hi * s_hi
    e = e_hi
    for iteration in range(80):
        _step(x, y, y1, K, f0, q, clock, stick, p, H, D, Lam, te, jac, lu, kappa, inv_delta, scale, f)
        counters[N_EVENT_STEPS] += 1
        e = _margins(y1, stick, p, H, D, Lam, te)[event]
        if e < 0.0:
            hi, e_hi = x, e
            if iteration > 0:
                e_lo *= 0.5
        else:
            lo, e_lo = x, e
        spent = e_hi >= -enough or hi - lo <= 1e-12 * hi
        if spent and x == hi:
            return hi
        if spent:
            x = hi
        elif e_lo > 0.0:
            # aim a little past the root: the step must end on its far side
            x = lo + (hi - lo) * (e_lo + 0.5 * enough) / (e_lo - e_hi)
            x = min(max(x, lo + 1e-3 * (hi - lo)), hi - 1e-3 * (hi - lo))
        else:
            x = 0.25 * hi
    return x


@njit(**COMPILE)
def advance(
    t_stop,
    y,
    stick,
    clock,
    counters,
    steps_t,
    steps_ref,
    p,
    H,
    D,
    Lam,
    te,
    scale,
    energy,
    sampling,
    rows,
    partial,
    cursor,
    scratch,
):
    """Advance the drive to ``t_stop``; everything but the parameters is updated in place.

    ``steps_t`` (n,) are the times of the microsteps before ``t_stop``, ``steps_ref`` (n, 3) the references i_A*, i_B* and
    the electrical angle after each. ``scale`` is 1 / (tolerance x magnitude) of each state. ``sampling`` holds the
    start of the first sample interval and the intervals' width, ``cursor`` the rows filled here and before. Returns a
    status code.
    """
    n = y.size
    # Scratch comes from outside: a loop that makes no arrays needs no reference counts, which took half its time.
    y1, work, f0, f = scratch[0, :n], scratch[1, :n], scratch[2, :n], scratch[3, :n]
    q, jac, lu = scratch[4], scratch[5], scratch[6]
    kappa, inv_delta = scratch[7], scratch[8]
    K, dense = scratch[9 : 9 + STAGES, :n], scratch[15:17, :n]
    chan = scratch[17, : N_CHANNELS + 2 * H.size]
    next_microstep = 0
    stalled = 0
    t = clock[T_NOW]
    while t < t_stop:
        target = t_stop
        if next_microstep < steps_t.size and steps_t[next_microstep] < t_stop:
            target = steps_t[next_microstep]
        if target <= t:
            clock[REF_A], clock[REF_B], clock[THETA_E] = steps_ref[next_microstep]
            next_microstep += 1
            counters[N_MICROSTEPS] += 1
            clock[H_NEXT] = min(clock[H_NEXT], p.layer)
            continue
        _derivative(y, clock, stick, p, H, D, Lam, te, f0, q)
        _linearise(y, clock, stick, p, H, D, Lam, te, f0, q, jac)
        left = target - t
        h = min(clock[H_NEXT], p.max_step)
        if h >= left:
            h = left
        elif 1.5 * h > left:
            h = 0.5 * left
        whole = h
        while True:
            error = _step(h, y, y1, K, f0, q, clock, stick, p, H, D, Lam, te, jac, lu, kappa, inv_delta, scale, f)
            factor = min(5.0, max(0.2, 0.9 * error**-0.25)) if error > 0.0 else 5.0
            if error <= 1.0:
                break
            counters[N_REJECTED] += 1
            h *= factor if math.isfinite(error) else 0.1
            if h < 1e-14 * max(1.0, t):
                clock[T_NOW] = t
                return STEP_TOO_SMALL if math.isfinite(error) else NOT_FINITE
        clock[H_NEXT] = h * factor if h < whole or h < left else max(h * factor, clock[H_NEXT])

        _dense(K, dense)
        _interpolate(0.5, y, y1, dense, work)
        middle = _margins(work, stick, p, H, D, Lam, te)
        after = _margins(y1, stick, p, H, D, Lam, te)
        event = -1
        if middle[0] < 0.0 or middle[1] < 0.0 or after[0] < 0.0 or after[1] < 0.0:
            if (middle[0] < 0.0 or middle[1] < 0.0) and after[0] >= 0.0 and after[1] >= 0.0:
                h *= 0.5
                _step(h, y, y1, K, f0, q, clock, stick, p, H, D, Lam, te, jac, lu, kappa, inv_delta, scale, f)
                _dense(K, dense)
                after = _margins(y1, stick, p, H, D, Lam, te)
            for _ in range(4):
                if after[0] >= 0.0 and after[1] >= 0.0:
                    break
                event = 1 - event if event >= 0 and after[1 - event] < 0.0 else (0 if after[0] < 0.0 else 1)
                h = _shorten_to_event(
                    event, h, after[event], y, y1, K, dense, work, f0, q, clock, stick, p, H, D, Lam, te,
                    jac, lu, kappa, inv_delta, scale, f, counters,
                )  # fmt: skip
                _dense(K, dense)
                after = _margins(y1, stick, p, H, D, Lam, te)
                if after[1 - event] >= 0.0:
                    break

        _record(
            t,
            h,
            y,
            y1,
            dense,
            clock,
            stick,
            p,
            H,
            D,
            Lam,
            te,
            energy,
            sampling,
            rows,
            partial,
            cursor,
            work,
            f,
            q,
            chan,
        )
        counters[N_STEPS] += 1
        stalled = stalled + 1 if h < 1e-12 * max(1.0, t) else 0
        t = target if h == left else t + h
        for j in range(n):
            y[j] = y1[j]
        if event >= 0:
            _settle_friction(event, y, stick, p, H, D, Lam, te, counters)
        if p.rigid:
            e0, e1, _, _ = _transmission_error(y[TM], te)
            y[TL] = e0 - y[TM] * p.inv_h
            y[WL] = (e1 - p.inv_h) * y[WM]
        if math.fabs(p.z * y[TM] - clock[THETA_E]) > math.pi or stalled > 1000:
            clock[T_NOW] = t
            return STEP_TOO_SMALL if stalled > 1000 else LOST_SYNCHRONISM
    clock[T_NOW] = t
    return OK


@njit(**COMPILE)
def snapshot(y, stick, clock, p, H, D, Lam, te, scratch, out):
    """All channels of the present state, into ``out``."""
    _channels(y, clock, stick, p, H, D, Lam, te, scratch[0, : y.size], scratch[1], out)
