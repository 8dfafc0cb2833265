"""A RODAS4 step: its Jacobian, the linear systems of its stages, and its continuous extension.

RODAS4 is an L-stable Rosenbrock method of order 4(3) with an embedded error estimate (E. Hairer, G.
Wanner, *Solving Ordinary Differential Equations II*, section IV.7). ``support.rodas4.loop`` makes a
run of such steps.
"""

import math
from typing import NamedTuple

import numpy as np

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve import kernel
from microvib.solve.kernel import (
    FORCED,
    IA,
    IB,
    INLINE,
    MODES,
    RATE_A,
    RATE_B,
    TL,
    TM,
    WL,
    WM,
    XA,
    XB,
    derivative,
    flux_shapes,
    follower,
    friction_angle_factor,
    friction_torque,
    references_after,
    transmission_error,
    varies,
    winding_rates,
)
from microvib.solve.vector import sincos, where

code = Unit(__name__, kernel.code)


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
    scale: Vector  # 1 / (tolerance x size) of each state


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
        [
            8.083246795921522,
            -7.981132988064893,
            -31.52159432874371,
            16.31930543123136,
            -6.058818238834054,
        ],
    ]
)
DENSE = np.array(
    [
        [
            10.12623508344586,
            -7.487995877610167,
            -34.80091861555747,
            -7.992771707568823,
            1.025137723295662,
        ],
        [
            -0.6762803392801253,
            6.087714651680015,
            16.43084320892478,
            24.76722511418386,
            -6.594389125716872,
        ],
    ]
)
AT = np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0])  # fraction of the step at which each stage is
BY_TIME = np.array(
    [0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0]
)  # weight of the derivative by time in each stage, over the step


# ---- Jacobian and linear systems ----
#
# Each stage of a step solves (g I - df/dy) u = r with g = 1 / (GAMMA h). The matrix is sparse, and
# one elimination in closed form serves all stages: ``_factor`` works out the coefficients,
# ``_solve`` applies them to a right-hand side r. Cost is linear in the number of modes. Write u_i,
# u_x for a phase's current and its integral, u_theta, u_m for the rotor's angle and rate, u_tl, u_l
# for the output's, u_eta, u_w for a mode; G = epsilon' - 1/h is d theta_l/d theta_m where the gear
# does not twist, e2 = epsilon''.
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
#    of its own, (g + K_I/K_P) u_x = r_x. Phase B has -K_m c and z K_m omega_m s. With flux harmonics s and c are s_A and c_B of
#    ``kernel.flux_shapes``, and c and s of theta_A and theta_B their slopes, the second with its sign changed.
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
#    Friction that varies with the angle is a spring on the output, of stiffness s: a22 gains s/g, b2 loses s r_tl/g.
#    On a craft omega_m drives the modes too, by R, and both rates by V_l and V_m: in 3. H u_l becomes H u_l + R u_m, u_w gains
#    -(V_l u_l + V_m u_m)/delta, and H (...) loses V_l (r_w - Lam r_eta/g)/delta. In place of H^2 kappa g/delta a22 has
#    (H^2 kappa g - 2 H V_l g - V_l^2)/delta, a11 gains the same of R and V_m, a12 and a21 J_c g and
#    (H R kappa g - (H V_m + R V_l) g - V_l V_m)/delta, b1 the sum of R (...) less V_m (...) and J_c r_l, b2 J_c r_m.
#    with rotor = K_m (s beta_A - c beta_B) - stiffness/g + slope_m. ``stiffness`` is the slope of the rotor's torque by theta_m at
#    fixed currents and gear twist, ``slope_m`` and ``slope_l`` those of the frictions by the rates. A stuck body has no equation:
#    its u is zero. The angles, windings and modes then follow from u_m and u_l by 1. to 3.
#
# With a rigid reducer omega_l = G omega_m, so that u_l = lead u_m + shift with lead = G + e2
# omega_m/g and shift = e2 omega_m r_theta/g, and a single equation is left, with the inertia J_m +
# 2 G J_c + G^2 J_L.


@code.inner(**INLINE)
def linearise(x, p, w):
    """Varying entries of the Jacobian, into ``w.jac``, at the state whose derivative is in ``w.f0``
    and ``w.q``.
    """
    y, stick, q, jac = x.y, x.stick, w.q, w.jac
    ref_A, ref_B = references_after(0.0, x.clock)
    theta_m, omega_m = y[TM], y[WM]
    s, c = sincos(p.z * theta_m)
    s_A, c_B = flux_shapes(s, c, p)
    rise_A, rise_B = _flux_slopes(p.z * theta_m, s, c, p)
    _, _, _, limited_A = winding_rates(y[IA], y[XA], ref_A, p.K_m * omega_m * s_A, p)
    _, _, _, limited_B = winding_rates(y[IB], y[XB], ref_B, -p.K_m * omega_m * c_B, p)
    _, detent = sincos(p.detent * p.z * theta_m)
    stiffness = p.z * p.K_m * (y[IB] * rise_B - y[IA] * rise_A)
    stiffness -= p.detent * p.z * p.K_d * detent + _detent_slope(theta_m, p)
    e0, e1, e2, e3 = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h
    _, slope_m = friction_torque(
        stick[0], omega_m, p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous, p.shaped
    )
    omega_l, sign_l = (G * omega_m, follower(stick[0], p)) if p.rigid else (y[WL], stick[1])
    T_f, slope_l = friction_torque(
        sign_l, omega_l, p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous, p.shaped
    )
    by_angle = 0.0
    if varies(p):
        friction_factor, steepness = friction_angle_factor(
            e0 - theta_m * p.inv_h if p.rigid else y[TL], p
        )
        slope_l, by_angle = slope_l * friction_factor, T_f * steepness
    if p.rigid:
        modal = p.J_L * q[6] + p.J_c * w.f0[WM] + q[2] - q[3]
        lever = G * p.J_L + p.J_c
        stiffness += (
            e2 * (modal - q[2])
            - (e2 * e2 * p.J_L + lever * e3) * omega_m * omega_m
            - 2.0 * e2 * lever * w.f0[WM]
        )
        slope_m += 2.0 * lever * e2 * omega_m
        stiffness -= G * G * by_angle
    else:
        stiffness -= e2 * q[3]
    jac[0], jac[1], jac[2], jac[3], jac[4], jac[5], jac[6] = (
        s_A,
        c_B,
        stiffness,
        slope_m,
        slope_l,
        G,
        e2 * omega_m,
    )
    jac[7], jac[8], jac[9] = where(limited_A, 1.0, 0.0), where(limited_B, 1.0, 0.0), omega_m
    jac[10] = by_angle
    jac[11], jac[12] = rise_A, -rise_B


@code.inner(**INLINE)
def _flux_slopes(angle, s, c, p):
    """Derivatives of ``flux_shapes`` by the electrical angle."""
    rise_A, rise_B = c, -s
    for j in range(p.flux.size // 4):
        n = 2.0 * j + 3.0
        s_n, c_n = sincos(n * angle)
        rise_A += n * (p.flux[4 * j] * c_n - p.flux[4 * j + 1] * s_n)
        rise_B += n * (p.flux[4 * j + 2] * c_n - p.flux[4 * j + 3] * s_n)
    return rise_A, rise_B


@code.inner(**INLINE)
def _detent_slope(theta_m, p):
    """Derivative of the further harmonics of the detent torque by the rotor's angle."""
    slope = 0.0
    for j in range(p.detent_harmonics.size // 3):
        order = p.detent_harmonics[3 * j] * p.z
        s, c = sincos(order * theta_m)
        slope += order * (p.detent_harmonics[3 * j + 1] * c - p.detent_harmonics[3 * j + 2] * s)
    return slope


@code.inner(**INLINE)
def _winding_pivot(g, inv_g, limited, p):
    """Elimination of one phase (2.): 1 / pivot, b, 1 / the integral's pivot, its coupling to the
    current, 1 / L.
    """
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
    """Eliminate windings, angles and modes from ``g I - df/dy``; the coefficients are kept in
    ``w.lu``.
    """
    jac, lu = w.jac, w.lu
    s, c, stiffness, slope_m, slope_l, G = jac[0], jac[1], jac[2], jac[3], jac[4], jac[5]
    inv_g = 1.0 / g
    pivot_A, weight_A, integral_A, coupling_A, inv_L_A = _winding_pivot(g, inv_g, jac[7] != 0.0, p)
    pivot_B, weight_B, integral_B, coupling_B, inv_L_B = _winding_pivot(g, inv_g, jac[8] != 0.0, p)
    back_emf = p.K_m * p.z * jac[9]
    theta_A, theta_B = back_emf * jac[11] * inv_L_A, back_emf * jac[12] * inv_L_B
    beta_A = (p.K_m * s * inv_L_A + theta_A * inv_g) * pivot_A
    beta_B = (-p.K_m * c * inv_L_B + theta_B * inv_g) * pivot_B
    lu[0], lu[1], lu[2], lu[3], lu[4], lu[5] = (
        pivot_A,
        weight_A,
        integral_A,
        coupling_A,
        theta_A,
        beta_A,
    )
    lu[6], lu[7], lu[8], lu[9], lu[10], lu[11] = (
        pivot_B,
        weight_B,
        integral_B,
        coupling_B,
        theta_B,
        beta_B,
    )
    modal, both, on_rotor = 0.0, p.J_c * g, 0.0
    for k in range(p.H.size):
        w.kappa[k] = p.D[k] + p.Lam[k] * inv_g
        w.inv_delta[k] = 1.0 / (g + w.kappa[k])
        modal += p.H[k] * p.H[k] * w.kappa[k] * g * w.inv_delta[k]
        if p.H_m.size > 0:
            H, H_m, V, V_m = p.H[k], p.H_m[k], p.V[k], p.V_m[k]
            modal -= (2.0 * H * g + V) * V * w.inv_delta[k]
            both += (H * H_m * w.kappa[k] * g - (H * V_m + H_m * V) * g - V * V_m) * w.inv_delta[k]
            on_rotor += (H_m * H_m * w.kappa[k] * g - (2.0 * H_m * g + V_m) * V_m) * w.inv_delta[k]
    rotor = p.K_m * (s * beta_A - c * beta_B) - stiffness * inv_g + slope_m + on_rotor
    if p.rigid:
        lead, drag, mass = (
            G + jac[6] * inv_g,
            slope_l + modal,
            p.J_m + 2.0 * G * p.J_c + G * G * p.J_L,
        )
        across = both - p.J_c * g  # of the modes; that of the shafts is in the mass
        lu[12] = 1.0 / (mass * g + rotor + across * (G + lead) + G * drag * lead)
        lu[13], lu[14], lu[15], lu[16] = drag, lead, mass, across
        return
    gear_theta = p.K_g * G + p.C_g * jac[6]
    gear_m, gear_l = gear_theta * inv_g + p.C_g * G, p.C_g + p.K_g * inv_g
    a11, a12, a22 = (
        p.J_m * g + rotor + G * gear_m,
        both - G * gear_l,
        p.J_L * g + gear_l + slope_l + modal,
    )
    a22 += jac[10] * inv_g
    # Inverse of the 2 x 2 system (5.); a stuck body has no equation and is coupled to nothing.
    slips_m, slips_l = stick[0] != 0.0, stick[1] != 0.0
    a12, a21 = where(slips_m & slips_l, a12, 0.0), where(slips_m & slips_l, both - gear_m, 0.0)
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
    modal = on_rotor = 0.0
    for k in range(p.H.size):
        stiff = p.Lam[k] * r[MODES + 2 * k] * inv_g
        free = (r[MODES + 2 * k + 1] - stiff) * w.inv_delta[k]
        modal += p.H[k] * (w.kappa[k] * free + stiff)
        if p.H_m.size > 0:
            modal -= p.V[k] * free
            on_rotor += p.H_m[k] * (w.kappa[k] * free + stiff) - p.V_m[k] * free
    rotor += on_rotor
    if p.rigid:
        shift = jac[6] * r[TM] * inv_g
        u_m = (lu[15] * r[WM] + rotor - lu[16] * shift + G * (modal - lu[13] * shift)) * lu[12]
        u_m = where(stick[0] == 0.0, 0.0, u_m)
        u_l = where(stick[0] == 0.0, 0.0, lu[14] * u_m + shift)
        r[TL], r[WL] = 0.0, 0.0
    else:
        gear = (lu[16] * r[TM] - p.K_g * r[TL]) * inv_g
        b1 = p.J_m * r[WM] + rotor - G * gear + p.J_c * r[WL]
        b2 = p.J_L * r[WL] + gear + modal + p.J_c * r[WM] - jac[10] * r[TL] * inv_g
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
        turned = p.H[k] * u_l
        u_w = r[MODES + 2 * k + 1] - p.Lam[k] * r_eta * inv_g
        if p.H_m.size > 0:
            turned += p.H_m[k] * u_m
            u_w -= p.V[k] * u_l + p.V_m[k] * u_m
        u_w = (u_w + w.kappa[k] * turned) * w.inv_delta[k]
        r[MODES + 2 * k] = (r_eta + u_w - turned) * inv_g
        r[MODES + 2 * k + 1] = u_w


# ---- One step and its continuous extension ----


@code.inner(**FORCED)
def _combine(stage, weight, table, y, K, out):
    """``out = y + weight x`` (sum of the stages so far, with the coefficients in row ``stage`` of
    ``table``).
    """
    for j in range(y.size):
        out[j] = y[j]
    for m in range(stage):
        scaled = weight * table[stage, m]
        for j in range(y.size):
            out[j] += scaled * K[m, j]


@code.inner(**INLINE)
def _add_ramp(weight, clock, p, jac, f):
    """Add ``weight`` times the derivative of the right-hand side by time, that of ramping
    references, to ``f``.
    """
    if jac[7] == 0.0:
        f[IA] += weight * (p.K_P + p.K_V) * p.inv_L_D * clock[RATE_A]
        f[XA] += weight * clock[RATE_A]
    if jac[8] == 0.0:
        f[IB] += weight * (p.K_P + p.K_V) * p.inv_L_D * clock[RATE_B]
        f[XB] += weight * clock[RATE_B]


@code.inner(**FORCED)
def step(h, x, p, w):
    """One RODAS4 step of size ``h`` from ``x.y`` (whose derivative is ``w.f0``) to ``w.y1``;
    returns the scaled error.
    """
    y, y1, f, K, n = x.y, w.y1, w.f, w.K, x.y.size
    inv_g, ih = GAMMA * h, 1.0 / h
    _factor(1.0 / inv_g, x.stick, p, w)
    for stage in range(STAGES):
        if stage == 0:
            for j in range(n):
                f[j] = w.f0[j]
        else:
            _combine(stage, 1.0, A, y, K, y1)
            derivative(y1, references_after(AT[stage] * h, x.clock), 0.0, x.stick, p, f, w.q)
            _combine(stage, ih, C, f, K, f)
        _add_ramp(BY_TIME[stage] * h, x.clock, p, w.jac, f)
        _solve(inv_g, x.stick, p, w, f)
        for j in range(n):
            K[stage, j] = f[j]
    error = 0.0
    for j in range(
        n
    ):  # y1 still is the argument of the last stage; that stage itself is the error estimate
        y1[j] += K[STAGES - 1, j]
        part = K[STAGES - 1, j] * w.scale[j]
        error += part * part
    # The mean is over 10 states, those of a drive with one mode: many modes must not dilute the
    # error of the drive.
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
    """Continuous extension at the fraction ``s`` of a step, of a state or of anything linear in
    states.
    """
    r = 1.0 - s
    return r * y0 + s * (y1 + r * (d2 + s * d3))


@code.inner(**INLINE)
def interpolate(s, y, w):
    """State at the fraction ``s`` of the last step, into ``w.between`` (order 3)."""
    for j in range(y.size):
        w.between[j] = extension(s, y[j], w.y1[j], w.dense[0, j], w.dense[1, j])
