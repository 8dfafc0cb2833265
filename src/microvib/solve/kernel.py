"""The drive's equations: motion, friction with exact stick and slip, channels. Every integration
takes them from here.

Between two events (a microstep of the command, a friction that sticks, breaks away or reverses) the
motion is smooth, and is advanced by ``microvib.solve.propagate``. Events end a step, so that no
step crosses one.

Friction is set-valued: a stuck body has exactly zero velocity, and no smoothed friction law appears
anywhere. docs/theory has the equations, docs/numerics.md the methods.

The functions take floats, for one state, or lanes, for the four nodes of a step at once
(``microvib.solve.vector``).
"""

import math
from typing import Any, NamedTuple

from microvib.compiled import Counts, Matrix, Unit, Vector
from microvib.solve.vector import exp, floor, picked, sincos, some, where

code = Unit(__name__, "vector.py", "vector_type.py", types="microvib.solve.vector_type")

# No exceptions inside (a division by zero gives inf, which step control catches); products may be
# fused; no reference counting, which would take half the time: the loop allocates no arrays, its
# scratch comes from outside.
COMPILE: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "_nrt": False, "fastmath": {"contract", "arcp"},
}  # fmt: skip
INLINE: dict[str, Any] = COMPILE | {"inline": "always"}
FORCED: dict[str, Any] = COMPILE | {
    "forceinline": True
}  # a call would copy its tuples, a quarter of the time

# ---- State, channels and parameters ----

# State y: currents, integrals of their errors, rotor (angle, rate), output (angle, rate); then eta
# and w of each mode. Of a pulsed drive with four windings the second two are the currents of those
# that are wound against A and B. With w = d eta/dt + H omega_l, the mode's absolute momentum, in place of d
# eta/dt the mass matrix is diagonal. On a craft w = d eta/dt + H omega_l + R omega_m, and what is
# left is the matrix [[J_m, J_c], [J_c, J_L]] of the two shafts. There damping may couple a mode
# with the shafts' rates too (``microvib.model.decoupled``).
IA, IB, XA, XB, TM, WM, TL, WL, MODES = range(9)

# Channels of a sample; the modal coordinates and their rates follow. The last four are powers,
# integrated over the run.
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

# Bodies with elements of friction with memory: 0 rotor, 1 output, 2 gear; and
HARNESS, BACKLASH = 3, 4

STEP_LEVEL, STEP_EVENT, STEP_REACHES, STEP_PART, STEP_DEFICITS, STEP_COLUMNS = 0, 1, 2, 3, 4, 28
"""Columns of a row that describes a step (``samples.record_step``): level, event at its end or -1,
whether it reaches its target, the fraction taken, and 24 deficits."""

YIELD = 1e-3
"""Part of its limit by which an element yields at a time that is pulled back to where it holds less."""
ROUNDED = 1e-12
"""Times that differ by less, over themselves, are the same."""
OK, LOST_SYNCHRONISM, STEP_TOO_SMALL, NOT_FINITE, ENDLESS_EVENTS = range(5)
# entries of State.counters and State.clock
(
    STEPS,
    REJECTED,
    MICROSTEPS,
    STICKS,
    ROTOR_STICKS,
    BREAKAWAYS,
    EVENT_STEPS,
    ITERATIONS_MADE,
    STEPS_JUDGED,
    STEPS_LOST,
    STEPS_GAINED,
    FIRST_NOT_MADE,
    N_COUNTERS,
) = range(13)
(
    NOW, NEXT_STEP, REF_A, REF_B, THETA_E, MISMATCH, LARGEST, IMPULSE, WEIGHT, RATE_A, RATE_B, GOAL_A, GOAL_B, RAMP_END,
    SEEN_D, SEEN_Q, SEEN_RATE_D, SEEN_RATE_Q, PULSE_END, BEHIND, DIRECTION, N_CLOCK,
) = range(22)  # fmt: skip
DRIVEN, IS_OPEN = 2.0, 0.0
"""Modes of a winding that is switched; 1 and -1 are those of one that conducts a current of that sign
through its diodes.
"""
HAIR = 1e-9
"""Part of the diodes' voltage within which a winding that has just opened stays open."""
AT_LIMIT = 1e-8
"""Part of its breakaway torque by which a body may be pushed beyond it and still comes to rest; at rest, it breaks
away at twice as much. One that creeps to rest ends at this torque itself, where it would slip and stick without end.
"""


class Drive(NamedTuple):
    """Parameters of one drive, in SI units; all scalars are floats."""

    z: float
    current: float  # amplitude of the references
    ideal: bool  # references of the current I in the direction of the command
    K_m: float
    K_d: float
    detent: int  # periods of the detent torque per electrical turn
    # factors of sine and cosine of each odd multiple of the electrical angle, from the third on: two
    # of phase A's flux rate, two of phase B's
    flux: Vector
    # order, sine and cosine amplitude of each further harmonic of the detent torque
    detent_harmonics: Vector
    R: float
    L: float
    K_P: float
    K_I: float
    K_D: float
    K_V: float  # voltage by the references themselves, of a drive without a current loop
    U_max: float
    # 2 of a pulsed drive, whose windings are switched; 4 where those wound against them conduct as
    # well; else 0
    windings: int
    diode_voltage: float  # against which they conduct when no switch drives them
    step: float  # full step of the rotor
    J_m: float  # on a craft, what of it is in no mode, as J_L and J_h
    J_L: float  # J_flex + J_h: all that is rigid on the output
    J_h: float
    J_c: float  # what couples the accelerations of rotor and output through a craft
    K_g: float
    C_g: float
    rigid: bool
    shaped: bool  # a Stribeck shape is not 1
    # friction of rotor and output: sliding level (Coulomb and slip ring), Stribeck excess, 1 /
    # rate, shape, viscous
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
    inv_J_both: float  # 1 / (J_L - J_c^2 / J_m): where the rotor is free too
    inv_h: float  # negative where the output turns with the rotor
    inv_z: float
    max_step: float
    layer: float  # first step after a microstep: a part of the current loop's time constant
    gap: float  # half the backlash; its element is the last
    # friction with memory: how many elements act on rotor, output, gear and harness, and of each its
    # stiffness and its share of the limit
    m_elements: int
    l_elements: int
    g_elements: int
    harness_elements: int
    g_limit: float
    harness_limit: float  # friction torque of the harness at the output
    harness_stiffness: float
    harness_angle: float  # of the output, at which the harness's spring is relaxed
    elements: Matrix  # (number of elements, 2), and a row for backlash
    noise: Vector  # torque noise of the output's friction: value and slope at each knot
    noise_rate: float  # knots per second
    # order, cosine and sine amplitude of each harmonic of the output's friction over its angle
    friction_harmonics: Vector
    rough: Vector  # what is random in it: value and slope at each knot of a turn
    rough_rate: float  # knots per radian
    H: Vector  # (s,)
    H_m: Vector  # participation in the rotor's motion, (s,) on a craft, else (0,)
    V: Vector  # viscous participation in the output's motion, (s,) on a craft, else (0,)
    V_m: Vector  # the same in the rotor's
    D: Vector
    Lam: Vector
    # order, sine and cosine amplitude of the transmission error, for each of its harmonics
    te: Vector


class State(NamedTuple):
    """State that the integration updates: state, friction modes (-1, 0 stuck, 1), times and references,
    counters, energies [J].
    """

    y: Vector
    # modes of rotor and output; then those of all elements, and the angle at which each that sticks
    # is relaxed; then those of windings that are switched
    stick: Vector
    clock: Vector
    counters: Counts
    energy: Vector
    levels: Counts  # of the last steps of each kind (``microvib.solve.propagate``)


class Samples(NamedTuple):
    """Where samples go: interval means, one row each; with a width of 0 the steps themselves, as many
    as there are rows.

    They are of all channels; of sums of channels, ``mix``; or, in two columns, of the torque and
    the output's stick alone.
    """

    first: float  # start of the first interval
    width: float
    rows: Matrix
    partial: Vector  # integrals over the current interval so far
    cursor: Counts  # rows filled here, rows filled before
    # weights of the channels in each column, (columns, channels); (0, 0) where columns are no sums
    mix: Matrix
    # weights of the errors of rates and of currents between the ends of a step, where propagators
    # sample
    rates_shown: float
    currents_shown: float


# ---- Equations of motion ----


@code.inner(**INLINE)
def friction_torque(sign, rate, slide, stribeck, inv_rate, shape, viscous, shaped):
    """Friction torque and its slope by the rate while slipping in the direction ``sign`` (Eq. 5-7);
    continued past zero rate.
    """
    torque, slope = slide, viscous
    if some(stribeck != 0.0):
        x = sign * rate * inv_rate
        if shaped:
            # Only steps that overshoot a stop have x <= 0; they are then cut so that they end at
            # the stop.
            torque = where(x <= 0.0, torque + stribeck, torque)
            fading = (x > 0.0) & (x < 700.0)
            if some(fading):
                power = x**shape
                e = stribeck * exp(-power)
                torque = where(fading, torque + e, torque)
                slope = where(fading, slope - e * shape * power / x * inv_rate, slope)
        else:
            e = stribeck * exp(-where(x > -1.0, x, -1.0))
            torque = torque + e
            slope = slope - where(x > -1.0, e * inv_rate, 0.0)
    return sign * torque + viscous * rate, slope


@code.inner(**INLINE)
def elements_of(body, p):
    """Numbers of the elements of a body: 0 rotor, 1 output, 2 gear, 3 harness."""
    if body == 0:
        return range(p.m_elements)
    if body == 1:
        return range(p.m_elements, p.m_elements + p.l_elements)
    before_harness = p.m_elements + p.l_elements + p.g_elements
    if body == HARNESS:
        return range(before_harness, before_harness + p.harness_elements)
    return range(p.m_elements + p.l_elements, before_harness)


@code.inner(**COMPILE)
def maxwell_slip_torque(body, angle, stick, p):
    """Torque of the elements of a body that stick, and the share of the limit at which the others
    slip, with their direction.
    """
    torque, share, count = 0.0 * angle, 0.0, p.elements.shape[0]
    for e in elements_of(body, p):
        if stick[2 + e] == 0.0:
            torque += p.elements[e, 0] * (angle - stick[2 + count + e])
        else:
            share += stick[2 + e] * p.elements[e, 1]
    return torque, share


@code.inner(**COMPILE)
def gear_hysteresis(twist, stick, p):
    """Torque of the elements beside the gear's spring."""
    torque, share = maxwell_slip_torque(2, twist, stick, p)
    return torque + share * p.g_limit


@code.inner(**INLINE)
def has_harness(p):
    """Whether a harness acts on the output."""
    return p.harness_elements > 0 or p.harness_stiffness > 0.0


@code.inner(**COMPILE)
def harness_torque(theta_l, stick, p):
    """Torque of the harness against the output: its spring, and its friction with memory."""
    torque, share = maxwell_slip_torque(HARNESS, theta_l, stick, p)
    spring = p.harness_stiffness * (theta_l - p.harness_angle)
    return spring + (torque + share * p.harness_limit)


@code.inner(**COMPILE)
def backlash_side(stick, p):
    """Which flanks of teeth with backlash touch: 1 or -1, 0 in the gap; 1 without backlash."""
    return stick[1 + p.elements.shape[0]] if p.gap > 0.0 else 1.0


@code.inner(**INLINE)
def gear_torque(twist, slip, stick, p):
    """Torque of the gear at the output, by its twist and the rate of that."""
    T_g = p.K_g * twist + p.C_g * slip
    if p.g_elements > 0:
        T_g = T_g + gear_hysteresis(twist, stick, p)
    if p.gap > 0.0:
        side = backlash_side(stick, p)
        T_g = T_g - (
            0.0 * twist + p.K_g * p.gap * side if side != 0.0 else p.K_g * twist + p.C_g * slip
        )
    return T_g


@code.inner(**INLINE)
def follower(sign, p):
    """Direction of an output that a rigid reducer moves, by the rotor's."""
    return -sign if p.inv_h > 0.0 else sign


@code.inner(**COMPILE)
def sliding_signs(stick, p):
    """Directions in which rotor and output slide: those of their modes, or of their elements that
    slip.
    """
    sign_m, sign_l = stick[0], follower(stick[0], p) if p.rigid else stick[1]
    if p.m_elements > 0:
        sign_m = _direction(0, stick, p)
    if p.l_elements > 0:
        sign_l = _direction(1, stick, p)
    return sign_m, sign_l


@code.inner(**COMPILE)
def _direction(body, stick, p):
    """In which direction elements of a body slip; forward if none does."""
    for e in elements_of(body, p):
        if stick[2 + e] != 0.0:
            return stick[2 + e]
    return 1.0


@code.inner(**INLINE)
def _cubic_at(x, table):
    """Value and slope by ``x``, in knots, of cubics through values and slopes at knots, round and
    round.
    """
    count = float(table.size // 2)
    knot = floor(x)
    u, first = x - knot, knot - count * floor(knot / count)
    after = where(first + 1.0 < count, first + 1.0, 0.0 * x)
    v0, d0 = picked(table, 2.0 * first), picked(table, 2.0 * first + 1.0)
    v1, d1 = picked(table, 2.0 * after), picked(table, 2.0 * after + 1.0)
    rise = v1 - v0
    square, cube = 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise
    return v0 + u * (d0 + u * (square + u * cube)), d0 + u * (2.0 * square + 3.0 * u * cube)


@code.inner(**INLINE)
def varies(p):
    """Whether the output's friction varies with its angle."""
    return p.friction_harmonics.size + p.rough.size > 0


@code.inner(**COMPILE)
def friction_angle_factor(theta_l, p):
    """Factor on the output's friction at an angle, and its slope: harmonics and
    roughness of slip ring and bearing.

    Never negative.
    """
    value, slope = 1.0 + 0.0 * theta_l, 0.0 * theta_l
    for j in range(p.friction_harmonics.size // 3):
        n = p.friction_harmonics[3 * j]
        s, c = sincos(n * theta_l)
        value += p.friction_harmonics[3 * j + 1] * c + p.friction_harmonics[3 * j + 2] * s
        slope += n * (p.friction_harmonics[3 * j + 2] * c - p.friction_harmonics[3 * j + 1] * s)
    if p.rough.size > 0:
        more, rise = _cubic_at(theta_l * p.rough_rate, p.rough)
        value, slope = value + more, slope + rise * p.rough_rate
    return where(value > 0.0, value, 0.0 * value), where(value > 0.0, slope, 0.0 * slope)


@code.inner(**COMPILE)
def _grip_in(y, p):
    angle = y[TL]
    if p.rigid:
        e0, _, _, _ = transmission_error(y[TM], p.te)
        angle = e0 - y[TM] * p.inv_h
    return friction_angle_factor(angle, p)[0]


@code.inner(**INLINE)
def friction_factor_in(y, p):
    """Factor on the output's friction in the state ``y``; 1 where friction does not vary."""
    value = 0.0 * y[TM] + 1.0
    if varies(p):
        value = _grip_in(y, p)
    return value


@code.inner(**COMPILE)
def with_memory(theta_m, omega_m, theta_l, omega_l, e0, friction_factor, stick, p, T_fm, T_f):
    """Friction of rotor and output with generalised Maxwell-slip elements; it stays where there are
    none.

    Elements that stick are springs; those that slip have their shares of ``T_fm`` and ``T_f``,
    frictions that slide. ``friction_factor`` is the output's friction there over its mean.
    """
    turned = e0 - theta_m * p.inv_h
    if p.m_elements > 0:
        torque, share = maxwell_slip_torque(0, theta_m, stick, p)
        viscous = p.m_viscous * omega_m
        T_fm = torque + math.fabs(share) * (T_fm - viscous) + viscous
    if p.l_elements > 0:
        torque, share = maxwell_slip_torque(1, turned if p.rigid else theta_l, stick, p)
        viscous = friction_factor * p.l_viscous * omega_l
        T_f = torque + math.fabs(share) * (T_f - viscous) + viscous
    return T_fm, T_f


@code.inner(**INLINE)
def transmission_error(theta_m, te):
    """Kinematic error epsilon(theta_m) of the reducer [rad at the output] and its first three
    derivatives.
    """
    e0 = e1 = e2 = e3 = 0.0
    for j in range(te.size // 3):
        n = te[3 * j]
        s, c = sincos(n * theta_m)
        value, quarter = (
            te[3 * j + 1] * s + te[3 * j + 2] * c,
            te[3 * j + 1] * c - te[3 * j + 2] * s,
        )
        e0 += value
        e1 += n * quarter
        e2 -= n * n * value
        e3 -= n * n * n * quarter
    return e0, e1, e2, e3


@code.inner(**INLINE)
def winding_rates(i, x, reference, back_emf, p):
    """Voltage, di/dt, dx/dt and whether the supply limits the phase (Eq. 2, 3); anti-windup by
    back-calculation.
    """
    demand, dx = p.K_P * (reference - i) + p.K_I * x + p.K_V * reference, reference - i
    di = (demand - p.R * i + back_emf) * p.inv_L_D
    u = demand - p.K_D * di
    limited = math.fabs(u) > p.U_max
    if some(limited):
        u = where(limited, math.copysign(p.U_max, u), u)
        dx = where(limited, (u - p.K_I * x) * p.inv_K_P, dx)
        di = where(limited, (u - p.R * i + back_emf) * p.inv_L, di)
    return u, di, dx, limited


@code.inner(**INLINE)
def winding_mode(which, stick, p):
    """Mode of a winding that is switched: 0 of phase A, 1 of phase B."""
    return stick[2 + 2 * p.elements.shape[0] + which]


@code.inner(**INLINE)
def switched_rates(mode, i, back_emf, driven, rate, p):
    """Voltage and di/dt of a winding that is switched; ``driven`` and ``rate`` are those of one that
    is driven.

    Through its diodes a current flows against their voltage, whichever way; without one the winding
    is open, and its voltage that of its back-EMF.
    """
    if mode == DRIVEN:
        return driven, rate
    if mode == IS_OPEN:
        return -back_emf, 0.0 * i
    u = 0.0 * i - mode * p.diode_voltage
    return u, (u - p.R * i + back_emf) * p.inv_L


@code.inner(**INLINE)
def opposite_voltage(which, reference, stick, p):
    """Voltage of a winding that is wound against phase A (2) or B (3) and not open; ``reference`` is
    that of the phase.
    """
    mode = winding_mode(which, stick, p)
    if mode == DRIVEN:
        return -p.K_V * reference
    return 0.0 * reference - mode * p.diode_voltage


@code.inner(**INLINE)
def opposite_rate(which, i, reference, back_emf, stick, p):
    """di/dt of a winding that is wound against phase A (2) or B (3), whose reference and back-EMF
    are given.
    """
    if winding_mode(which, stick, p) == IS_OPEN:
        return 0.0 * i
    return (opposite_voltage(which, reference, stick, p) - p.R * i - back_emf) * p.inv_L


@code.inner(**INLINE)
def phase_currents(y, p):
    """Currents of both phases; of two windings each that of the first less that of the other."""
    i_A, i_B = y[IA], y[IB]
    if p.windings > 2:
        i_A, i_B = i_A - y[XA], i_B - y[XB]
    return i_A, i_B


@code.inner(**INLINE)
def detent_sine(theta_m, s, c, p):
    """Sine of the detent torque's angle, by sine and cosine of the electrical angle."""
    if p.detent == 4:
        return 4.0 * s * c * (c * c - s * s)
    return sincos(p.detent * p.z * theta_m)[0]


@code.inner(**INLINE)
def detent_harmonics_torque(theta_m, p):
    """Torque of the further harmonics of the detent torque, against the rotor's motion where it is
    positive.
    """
    torque = 0.0 * theta_m
    for j in range(p.detent_harmonics.size // 3):
        s, c = sincos(p.detent_harmonics[3 * j] * p.z * theta_m)
        torque = torque + (p.detent_harmonics[3 * j + 1] * s + p.detent_harmonics[3 * j + 2] * c)
    return torque


@code.inner(**INLINE)
def detent_harmonics_energy(theta_m, p):
    """Potential of the further harmonics of the detent torque."""
    energy = 0.0 * theta_m
    for j in range(p.detent_harmonics.size // 3):
        order = p.detent_harmonics[3 * j] * p.z
        s, c = sincos(order * theta_m)
        part = p.detent_harmonics[3 * j + 2] * s - p.detent_harmonics[3 * j + 1] * c
        energy = energy + part / order
    return energy


@code.inner(**INLINE)
def flux_shapes(s, c, p):
    """Rates of the flux linkages of both phases by the electrical angle over K_m, from its sine and
    cosine: -k_A / K_m and k_B / K_m, which are sine and cosine without harmonics.

    Torque and back-EMF are both made of them, so that power is conserved. Odd multiples of the angle
    follow one from another.
    """
    s_A, c_B = s, c
    if p.flux.size > 0:
        s_2, c_2 = 2.0 * s * c, c * c - s * s
        s_n, c_n = s, c
        for j in range(p.flux.size // 4):
            s_n, c_n = s_n * c_2 + c_n * s_2, c_n * c_2 - s_n * s_2
            s_A = s_A + (p.flux[4 * j] * s_n + p.flux[4 * j + 1] * c_n)
            c_B = c_B + (p.flux[4 * j + 2] * s_n + p.flux[4 * j + 3] * c_n)
    return s_A, c_B


@code.inner(**INLINE)
def motor_torque(y, s, c, s_A, c_B, p):
    """Electromagnetic and detent torque (Eq. 4), by sine and cosine of the electrical angle and
    ``flux_shapes``.
    """
    i_A, i_B = phase_currents(y, p)
    T_e = p.K_m * (i_B * c_B - i_A * s_A) - p.K_d * detent_sine(y[TM], s, c, p)
    if p.detent_harmonics.size > 0:
        T_e = T_e - detent_harmonics_torque(y[TM], p)
    return T_e


@code.inner(**INLINE)
def output_angle(y, e0, p):
    """The output's angle, which a rigid reducer sets; ``e0`` is the transmission error."""
    if p.rigid:
        return e0 - y[TM] * p.inv_h
    return y[TL]


@code.inner(**INLINE)
def output_rate(theta_m, omega_m, omega_l, p):
    """The output's rate, which a rigid reducer sets."""
    if p.rigid:
        _, e1, _, _ = transmission_error(theta_m, p.te)
        omega_l = (e1 - p.inv_h) * omega_m
    return omega_l


@code.inner(**INLINE)
def _mode(k, y, omega_l, p):
    """Rate and pull of a mode (Eq. 16, 17), and its torques on output and rotor; the output turns
    at ``omega_l``.
    """
    rate = y[MODES + 2 * k + 1] - p.H[k] * omega_l
    if p.H_m.size == 0:
        pull = p.D[k] * rate + p.Lam[k] * y[MODES + 2 * k]
        return rate, pull, p.H[k] * pull, 0.0
    rate -= p.H_m[k] * y[WM]
    pull = p.D[k] * rate + p.Lam[k] * y[MODES + 2 * k] + (p.V[k] * omega_l + p.V_m[k] * y[WM])
    return rate, pull, p.H[k] * pull - p.V[k] * rate, p.H_m[k] * pull - p.V_m[k] * rate


@code.inner(**INLINE)
def derivative(y, references, noise, stick, p, f, q):
    """Right-hand side ``f`` and instantaneous ``q`` = T_e, T_f,m, T_f, T_g, u_A, u_B, alpha_l (Eq.
    2-7, 16-18).

    ``references`` are i_A* and i_B*.
    """
    omega_l, modal, on_rotor = output_rate(y[TM], y[WM], y[WL], p), 0.0, 0.0
    for k in range(p.H.size):
        f[MODES + 2 * k], pull, on_output, on_the_rotor = _mode(k, y, omega_l, p)
        f[MODES + 2 * k + 1] = -pull
        modal += on_output
        on_rotor += on_the_rotor
    drive_derivative(y, modal - noise, on_rotor, references, stick, p, f, q)


@code.inner(**INLINE)
def drive_derivative(y, modal, on_rotor, references, stick, p, f, q):
    """Derivative of the drive alone, with the torques of the modes on its output, ``modal``, less
    torque noise, and on its rotor.
    """
    theta_m, omega_m = y[TM], y[WM]
    s, c = sincos(p.z * theta_m)
    s_A, c_B = flux_shapes(s, c, p)
    u_A, f[IA], f[XA], _ = winding_rates(y[IA], y[XA], references[0], p.K_m * omega_m * s_A, p)
    u_B, f[IB], f[XB], _ = winding_rates(y[IB], y[XB], references[1], -p.K_m * omega_m * c_B, p)
    if p.windings > 0:
        emf_A, emf_B = p.K_m * omega_m * s_A, -p.K_m * omega_m * c_B
        u_A, f[IA] = switched_rates(winding_mode(0, stick, p), y[IA], emf_A, u_A, f[IA], p)
        u_B, f[IB] = switched_rates(winding_mode(1, stick, p), y[IB], emf_B, u_B, f[IB], p)
        if p.windings > 2:
            f[XA] = opposite_rate(2, y[XA], references[0], emf_A, stick, p)
            f[XB] = opposite_rate(3, y[XB], references[1], emf_B, stick, p)
    T_e = motor_torque(y, s, c, s_A, c_B, p)
    e0, e1, e2, _ = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h  # d theta_l / d theta_m where the gear does not twist
    omega_l = G * omega_m if p.rigid else y[WL]
    if has_harness(p):
        modal = modal - harness_torque(output_angle(y, e0, p), stick, p)

    sign_m, sign_l = stick[0], follower(stick[0], p) if p.rigid else stick[1]
    if p.elements.shape[0] > 0:
        sign_m, sign_l = sliding_signs(stick, p)
    T_fm, _ = friction_torque(
        sign_m, omega_m, p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous, p.shaped
    )
    T_f, _ = friction_torque(
        sign_l, omega_l, p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous, p.shaped
    )
    friction_factor = friction_factor_in(y, p)
    if varies(p):
        T_f = T_f * friction_factor
    if p.elements.shape[0] > 0:
        T_fm, T_f = with_memory(
            theta_m, omega_m, y[TL], omega_l, e0, friction_factor, stick, p, T_fm, T_f
        )
    if p.rigid:
        stuck = stick[0] == 0.0
        bias = G * e2 * p.J_L * omega_m * omega_m
        pull = T_e + on_rotor - T_fm + G * (modal - T_f) - bias - p.J_c * e2 * omega_m * omega_m
        alpha_m = where(stuck, 0.0, pull / (p.J_m + 2.0 * G * p.J_c + G * G * p.J_L))
        if some(stuck):
            # One degree of freedom, two frictions: the hold is shared in proportion to what each
            # can hold.
            limit_m, limit_l = held_m(p), math.fabs(G) * held_l(p) * friction_factor
            held = T_e + on_rotor + G * modal
            if p.m_elements > 0 or p.l_elements > 0:
                held = held - (T_fm if p.m_elements > 0 else G * T_f)
            share = held * limit_m / (limit_m + limit_l)
            T_fm = where(stuck, T_fm + share if p.m_elements > 0 else share, T_fm)
            T_f = where(stuck, (T_e + on_rotor + G * modal - T_fm) / G, T_f)
        alpha_l = G * alpha_m + e2 * omega_m * omega_m
        T_g = p.J_L * alpha_l + T_f - modal + p.J_c * alpha_m
        f[TL], f[WL] = 0.0, 0.0  # follow from the rotor
    else:
        twist = e0 - theta_m * p.inv_h - y[TL]
        T_g = gear_torque(twist, G * omega_m - omega_l, stick, p)
        if p.J_c == 0.0:
            T_fm = where(stick[0] == 0.0, T_e + on_rotor - G * T_g, T_fm)
            T_f = where(stick[1] == 0.0, T_g + modal, T_f)
            alpha_m = where(stick[0] == 0.0, 0.0, (T_e + on_rotor - T_fm - G * T_g) * p.inv_J_m)
            alpha_l = where(stick[1] == 0.0, 0.0, (T_g - T_f + modal) * p.inv_J_L)
        else:
            pull_m, pull_l = T_e + on_rotor - T_fm - G * T_g, T_g - T_f + modal
            alpha_m, alpha_l = coupled_accelerations(pull_m, pull_l, stick, p)
            T_fm = where(stick[0] == 0.0, T_e + on_rotor - G * T_g - p.J_c * alpha_l, T_fm)
            T_f = where(stick[1] == 0.0, T_g + modal - p.J_c * alpha_m, T_f)
        f[TL], f[WL] = omega_l, alpha_l
    f[TM], f[WM] = omega_m, alpha_m
    q[0], q[1], q[2], q[3], q[4], q[5], q[6] = T_e, T_fm, T_f, T_g, u_A, u_B, alpha_l


@code.inner(**COMPILE)
def sticks(body, stick, p):
    """1 where a body (0 rotor, 1 output) sticks, in all its elements if it has some; else 0."""
    own = elements_of(body, p)
    if len(own) > 0:
        for e in own:
            if stick[2 + e] != 0.0:
                return 0.0
        return 1.0
    return 1.0 if stick[0 if p.rigid else body] == 0.0 else 0.0


@code.inner(**INLINE)
def coupled_accelerations(pull_m, pull_l, stick, p):
    """Accelerations of rotor and output on a craft by the torques that pull at them; what sticks
    has none.
    """
    stuck_m, stuck_l = stick[0] == 0.0, stick[1] == 0.0
    with_rotor = (pull_l - p.J_c * p.inv_J_m * pull_m) * p.inv_J_both
    alpha_l = where(stuck_l, 0.0, where(stuck_m, pull_l * p.inv_J_L, with_rotor))
    return where(stuck_m, 0.0, (pull_m - p.J_c * alpha_l) * p.inv_J_m), alpha_l


@code.inner(**INLINE)
def channels(y, references, noise, stick, p, f, q, out):
    """All channels at one instant. ``T_d`` from momentum (Eq. 20), ``T_d_force`` from the torques
    on the housing.
    """
    derivative(y, references, noise, stick, p, f, q)
    T_e, T_fm, T_f, T_g, u_A, u_B, alpha_l = q[0], q[1], q[2] + noise, q[3], q[4], q[5], q[6]
    theta_m, omega_m, alpha_m, theta_l, omega_l = y[TM], y[WM], f[WM], y[TL], y[WL]
    e0, e1, _, _ = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h
    if p.rigid:
        theta_l, omega_l = e0 - theta_m * p.inv_h, G * omega_m
    twist, slip = e0 - theta_m * p.inv_h - theta_l, G * omega_m - omega_l
    kinetic = (
        0.5 * (p.J_m * omega_m * omega_m + p.J_L * omega_l * omega_l) + p.J_c * omega_m * omega_l
    )
    _, c = sincos(p.detent * p.z * theta_m)
    side = backlash_side(stick, p)
    bent = twist - p.gap * side if side != 0.0 else 0.0 * twist
    elastic = 0.5 * p.K_g * bent * bent - p.K_d / (p.detent * p.z) * c
    if p.detent_harmonics.size > 0:
        elastic = elastic + detent_harmonics_energy(theta_m, p)
    spring = 0.0 * theta_l
    if has_harness(p):
        spring = p.harness_stiffness * (theta_l - p.harness_angle)
        elastic = elastic + 0.5 * spring * (theta_l - p.harness_angle)
        T_f = T_f + harness_torque(theta_l, stick, p)
    damping = p.C_g * slip * slip if side != 0.0 else 0.0 * slip
    if p.g_elements > 0:
        damping = damping + gear_hysteresis(twist, stick, p) * slip
    modal_rate = rotor_rate = 0.0
    for k in range(p.H.size):
        eta, rate = y[MODES + 2 * k], f[MODES + 2 * k]
        w = y[MODES + 2 * k + 1]
        kinetic += 0.5 * w * w
        elastic += 0.5 * p.Lam[k] * eta * eta
        damping += p.D[k] * rate * rate
        modal_rate += p.H[k] * f[MODES + 2 * k + 1]
        if p.H_m.size > 0:
            damping += 2.0 * rate * (p.V[k] * omega_l + p.V_m[k] * omega_m)
            modal_rate += p.V[k] * rate
            rotor_rate += p.H_m[k] * f[MODES + 2 * k + 1] + p.V_m[k] * rate
        out[N_CHANNELS + k] = eta
        out[N_CHANNELS + p.H.size + k] = rate
    i_A, i_B = phase_currents(y, p)
    out[0], out[1], out[2], out[3], out[4], out[5] = (
        i_A,
        i_B,
        u_A,
        u_B,
        references[0],
        references[1],
    )
    out[6], out[7], out[8], out[9], out[10], out[11] = (
        theta_m,
        omega_m,
        alpha_m,
        theta_l,
        omega_l,
        alpha_l,
    )
    out[12], out[13], out[14], out[15] = T_e, T_fm, T_f, T_g
    out[16] = p.J_h * alpha_l + modal_rate + p.J_c * alpha_m
    out[17] = -(
        p.J_L * alpha_l + modal_rate + p.J_m * alpha_m + rotor_rate + p.J_c * (alpha_l + alpha_m)
    )
    out[18] = -T_e + T_fm + T_f - T_g * (1.0 - G)
    out[19], out[20] = sticks(0, stick, p), sticks(1, stick, p)
    squares = y[IA] * y[IA] + y[IB] * y[IB]
    electrical = u_A * y[IA] + u_B * y[IB]
    if p.windings > 2:
        squares = squares + (y[XA] * y[XA] + y[XB] * y[XB])
        electrical = electrical + opposite_voltage(2, references[0], stick, p) * y[XA]
        electrical = electrical + opposite_voltage(3, references[1], stick, p) * y[XB]
    out[21], out[22], out[23] = kinetic, 0.5 * p.L * squares, elastic
    out[24], out[25] = electrical, p.R * squares
    out[26], out[27] = T_fm * omega_m + (T_f - spring) * omega_l, damping


# ---- References of the currents ----
#
# A microstep sets a goal for both references. An ideal driver is there at once; one that
# interpolates ramps to it, and the end of a ramp ends a step as a microstep does, so that
# references are linear in time within every step.


@code.inner(**INLINE)
def references_after(dt, clock):
    """References i_A* and i_B* the time ``dt`` after now, within the step."""
    return clock[REF_A] + dt * clock[RATE_A], clock[REF_B] + dt * clock[RATE_B]


@code.inner(**INLINE)
def take_microstep(row, x):
    """Take a microstep: ``row`` has the references and the electrical angle after it, and how long
    a ramp there lasts.
    """
    clock, lasts = x.clock, row[3]
    clock[THETA_E] = row[2]
    clock[GOAL_A], clock[GOAL_B] = row[0], row[1]
    if lasts > 0.0:
        clock[RATE_A], clock[RATE_B] = (
            (row[0] - clock[REF_A]) / lasts,
            (row[1] - clock[REF_B]) / lasts,
        )
        clock[RAMP_END] = clock[NOW] + lasts
    else:
        clock[REF_A], clock[REF_B], clock[RATE_A], clock[RATE_B] = row[0], row[1], 0.0, 0.0
    x.counters[MICROSTEPS] += 1


@code.inner(**INLINE)
def _ramps(clock):
    return clock[RATE_A] != 0.0 or clock[RATE_B] != 0.0


@code.inner(**INLINE)
def before_ramp_ends(target, clock):
    """``target``, or the end of a ramp where that is earlier by more than rounding."""
    if _ramps(clock) and clock[RAMP_END] < target - ROUNDED * max(target, 1.0):
        return clock[RAMP_END]
    return target


@code.inner(**INLINE)
def pass_time(end, clock):
    """Move time and references on to ``end``; whether a ramp ends there."""
    dt = end - clock[NOW]
    clock[NOW] = end
    if not _ramps(clock):
        return False
    if end < clock[RAMP_END] - ROUNDED * max(end, 1.0):
        clock[REF_A], clock[REF_B] = references_after(dt, clock)
        return False
    clock[REF_A], clock[REF_B], clock[RATE_A], clock[RATE_B] = (
        clock[GOAL_A],
        clock[GOAL_B],
        0.0,
        0.0,
    )
    return True


@code.inner(**COMPILE)
def noise_at(t, p):
    """Torque noise on the output at the time ``t``: cubics through values and slopes at knots,
    round and round.
    """
    count = p.noise.size // 2
    if count == 0:
        return 0.0
    x = t * p.noise_rate
    knot = math.floor(x)
    u, a, b = x - knot, 2 * (int(knot) % count), 2 * ((int(knot) + 1) % count)
    v0, d0, v1, d1 = p.noise[a], p.noise[a + 1], p.noise[b], p.noise[b + 1]
    rise = v1 - v0
    return v0 + u * (d0 + u * (3.0 * rise - 2.0 * d0 - d1 + u * (d0 + d1 - 2.0 * rise)))


# ---- Friction events ----
#
# A friction is in one of three modes: slipping forward (1), slipping backward (-1) or stuck (0),
# ``stick[0]`` for the rotor and ``stick[1]`` for the output. Within a mode the motion is smooth,
# and a *margin* says how far the mode is from its end:
#
#     slipping:  stick x rate                        ends where the body comes to rest
#     stuck:     breakaway torque - |hold torque|    ends where friction can no longer hold the body
#
# Where a margin is negative inside a step or at its end, the step is made to end where it is just
# spent (by ``microvib.solve.step_events``). There ``decide_friction`` sets the rate to exactly zero
# and chooses the next mode from the hold torque, and the next step starts in that mode.


@code.inner(**INLINE)
def modal_torques(y, omega_l, p):
    """Torques of the modes on the output, which turns at the rate ``omega_l``, and on the rotor."""
    modal = on_rotor = 0.0
    for k in range(p.H.size):
        _, _, on_output, on_the_rotor = _mode(k, y, omega_l, p)
        modal += on_output
        on_rotor += on_the_rotor
    return modal, on_rotor


@code.inner(**INLINE)
def _holds(y, modal, on_rotor, stick, p):
    """Torque that friction must supply to keep each body at rest (rotor, output) while the other
    does as it does, and G.
    """
    theta_m = y[TM]
    s, c = sincos(p.z * theta_m)
    s_A, c_B = flux_shapes(s, c, p)
    T_e = motor_torque(y, s, c, s_A, c_B, p)
    e0, e1, _, _ = transmission_error(theta_m, p.te)
    G = e1 - p.inv_h
    twist = e0 - theta_m * p.inv_h - y[TL]
    if has_harness(p):
        modal = modal - harness_torque(output_angle(y, e0, p), stick, p)
    T_g = gear_torque(twist, G * y[WM] - y[WL], stick, p)
    pull_m, pull_l = T_e + on_rotor, T_g + modal
    hold_m, hold_l = (pull_m + G * modal, 0.0 * T_g) if p.rigid else (pull_m - G * T_g, pull_l)
    if p.J_c != 0.0 and not p.rigid:
        sign_m, sign_l = sliding_signs(stick, p)
        T_fm, _ = friction_torque(
            sign_m, y[WM], p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape, p.m_viscous, p.shaped
        )
        T_f, _ = friction_torque(
            sign_l, y[WL], p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape, p.l_viscous, p.shaped
        )
        friction_factor = friction_factor_in(y, p)
        if varies(p):
            T_f = T_f * friction_factor
        if p.elements.shape[0] > 0:
            T_fm, T_f = with_memory(
                theta_m, y[WM], y[TL], y[WL], e0, friction_factor, stick, p, T_fm, T_f
            )
        alpha_m = where(stick[0] == 0.0, 0.0, (hold_m - T_fm) * p.inv_J_m)
        alpha_l = where(stick[1] == 0.0, 0.0, (hold_l - T_f) * p.inv_J_L)
        hold_m, hold_l = hold_m - p.J_c * alpha_l, hold_l - p.J_c * alpha_m
    if p.rigid and p.m_elements > 0:
        hold_m = hold_m - maxwell_slip_torque(0, theta_m, stick, p)[0]
    if p.rigid and p.l_elements > 0:
        hold_m = hold_m - G * maxwell_slip_torque(1, e0 - theta_m * p.inv_h, stick, p)[0]
    return hold_m, hold_l, G


@code.inner(**INLINE)
def _slope(y, p):
    """How the output turns with the rotor where the gear does not twist; where both have one degree
    of freedom, at this angle.
    """
    if p.rigid:
        _, e1, _, _ = transmission_error(y[TM], p.te)
        return e1 - p.inv_h
    return 0.0 * y[TM] - p.inv_h


@code.inner(**INLINE)
def held_m(p):
    """Torque that the rotor's friction holds at rest, without memory."""
    return 0.0 if p.m_elements > 0 else p.m_slide + p.m_stribeck


@code.inner(**INLINE)
def held_l(p):
    """Torque that the output's friction holds at rest, without memory."""
    return 0.0 if p.l_elements > 0 else p.l_slide + p.l_stribeck


@code.inner(**INLINE)
def breakaway_torques(p, G, friction_factor):
    """Breakaway torques of rotor and output; with a rigid reducer both act on the one degree of
    freedom.
    """
    limit_m, limit_l = held_m(p), held_l(p) * friction_factor
    return (limit_m + math.fabs(G) * limit_l, 0.0) if p.rigid else (limit_m, limit_l)


@code.inner(**FORCED)
def margins(y, noise, stick, p):
    """Margins that stay positive as long as the friction modes last: slip speed, or the reserve below the
    breakaway torque.

    Rotor and output; always 1 where there is no friction.
    """
    hold_m = hold_l = 0.0 * y[WM]
    if stick[0] == 0.0 or stick[1] == 0.0:
        modal, on_rotor = modal_torques(y, output_rate(y[TM], y[WM], y[WL], p), p)
        hold_m, hold_l, _ = _holds(y, modal - noise, on_rotor, stick, p)
    return _margins(y, hold_m, hold_l, stick, p)


@code.inner(**FORCED)
def margins_known(y, q, stick, p):
    """Margins with the instantaneous ``q`` of ``derivative``: the friction of what sticks is the
    torque that holds it.
    """
    hold_m, hold_l = q[1], q[2]
    if p.rigid:
        on_rotor = _slope(y, p) * q[2]
        hold_m = (0.0 if p.m_elements > 0 else q[1]) + (
            0.0 * on_rotor if p.l_elements > 0 else on_rotor
        )
    return _margins(y, hold_m, hold_l, stick, p)


@code.inner(**INLINE)
def _margins(y, hold_m, hold_l, stick, p):
    limit_m, limit_l = breakaway_torques(p, _slope(y, p), friction_factor_in(y, p))
    breaks = 1.0 + 2.0 * AT_LIMIT
    e_m = where(stick[0] != 0.0, stick[0] * y[WM], breaks * limit_m - math.fabs(hold_m))
    e_l = where(stick[1] != 0.0, stick[1] * y[WL], breaks * limit_l - math.fabs(hold_l))
    acts_m, acts_l = breakaway_torques(p, -p.inv_h, 1.0)
    return where(acts_m > 0.0, e_m, 1.0), where(acts_l > 0.0, e_l, 1.0)


@code.inner(**COMPILE)
def decide_friction(which, x, p):
    """The mode that follows at an event of friction ``which``: stuck if it can hold, else slipping
    the way it is pushed.
    """
    was_stuck = x.stick[which] == 0.0
    x.y[WM if which == 0 else WL] = 0.0
    if p.rigid and not was_stuck:
        _stick_elements(0, x, p)
        _stick_elements(1, x, p)
    if (p.rigid or which == 1) and not was_stuck:
        _stick_elements(HARNESS, x, p)
    modal, on_rotor = modal_torques(x.y, output_rate(x.y[TM], x.y[WM], x.y[WL], p), p)
    hold_m, hold_l, G = _holds(x.y, modal - noise_at(x.clock[NOW], p), on_rotor, x.stick, p)
    limit_m, limit_l = breakaway_torques(p, G, friction_factor_in(x.y, p))
    hold, limit = (hold_m, limit_m) if which == 0 else (hold_l, limit_l)
    if math.fabs(hold) <= (1.0 + AT_LIMIT) * limit and not was_stuck:
        x.stick[which] = 0.0
        x.counters[STICKS] += 1
        x.counters[ROTOR_STICKS] += 1 if which == 0 else 0
    else:
        x.stick[which] = math.copysign(1.0, hold)
        x.counters[BREAKAWAYS] += 1 if was_stuck else 0


@code.entry(**COMPILE)
def initial_friction(x: State, p: Drive) -> None:
    """Friction modes at the start: slipping where there is motion or no friction, stuck where
    friction can hold.
    """
    modal, on_rotor = modal_torques(x.y, output_rate(x.y[TM], x.y[WM], x.y[WL], p), p)
    hold_m, hold_l, G = _holds(x.y, modal - noise_at(x.clock[NOW], p), on_rotor, x.stick, p)
    limit_m, limit_l = breakaway_torques(p, G, friction_factor_in(x.y, p))
    for which in range(2):
        hold, limit, rate = (hold_m, limit_m, x.y[WM]) if which == 0 else (hold_l, limit_l, x.y[WL])
        if rate == 0.0 and limit > 0.0:
            x.stick[which] = 0.0 if math.fabs(hold) <= limit else math.copysign(1.0, hold)
        else:
            x.stick[which] = math.copysign(1.0, rate) if limit > 0.0 else 1.0
    for e in range(p.elements.shape[0]):
        body = body_of(e, p)
        angle, _ = _angle_and_rate(body, x.y, p)
        x.stick[2 + e] = (
            math.copysign(1.0, angle) if body == BACKLASH and math.fabs(angle) > p.gap else 0.0
        )
        x.stick[2 + p.elements.shape[0] + e] = angle


# Elements of a friction with memory stick or slip as the bodies do above: a stuck one is a spring,
# which slips where it reaches its share of the limit; all that slip on a body stick where its rate
# passes zero. Backlash is an element, too: it is in its gap, 0, or one of the flanks touches; its
# margin is the torque of the gear's spring over the way that is left.


@code.inner(**INLINE)
def body_of(e, p):
    """On what an element acts: 0 rotor, 1 output, 2 gear, 3 harness, 4 the gear's backlash."""
    before_gear = p.m_elements + p.l_elements
    before_harness = before_gear + p.g_elements
    return (
        (1 if e >= p.m_elements else 0)
        + (1 if e >= before_gear else 0)
        + (1 if e >= before_harness else 0)
        + (1 if e >= before_harness + p.harness_elements else 0)
    )


@code.inner(**INLINE)
def _angle_and_rate(body, y, p):
    """Angle and rate at the elements of a body; those of the gear see its twist."""
    if body == 0:
        return y[TM], y[WM]
    e0, e1, _, _ = transmission_error(y[TM], p.te)
    angle, rate = e0 - y[TM] * p.inv_h, (e1 - p.inv_h) * y[WM]
    if body == 2 or body == BACKLASH:
        return angle - y[TL], rate - y[WL]
    if p.rigid:
        return angle, rate
    return y[TL], y[WL]


@code.inner(**COMPILE)
def element_margin(e, y, stick, p):
    """Margin that stays positive as long as the mode of an element lasts: its slip, or what its spring
    lacks of its limit.
    """
    body = body_of(e, p)
    angle, rate = _angle_and_rate(body, y, p)
    if body == BACKLASH:
        into = math.fabs(angle) if stick[2 + e] == 0.0 else stick[2 + e] * angle
        return p.K_g * (p.gap - into if stick[2 + e] == 0.0 else into - p.gap)
    if stick[2 + e] != 0.0:
        return stick[2 + e] * rate
    torque = p.elements[e, 0] * (angle - stick[2 + p.elements.shape[0] + e])
    outward = torque * rate  # pulled back, it cannot slip: its limit is that at rest
    speed = where(outward > 0.0, math.fabs(rate), 0.0 * rate)
    if body >= 2:
        constant = p.g_limit if body == 2 else p.harness_limit
        return p.elements[e, 1] * constant - math.fabs(torque)
    curve = p.m_slide, p.m_stribeck, p.m_inv_rate, p.m_shape
    if body == 1:
        curve = p.l_slide, p.l_stribeck, p.l_inv_rate, p.l_shape
    limit, _ = friction_torque(1.0, speed, curve[0], curve[1], curve[2], curve[3], 0.0, p.shaped)
    if body == 1 and varies(p):
        limit = limit * friction_factor_in(y, p)
    return p.elements[e, 1] * limit - math.fabs(torque)


@code.inner(**COMPILE)
def _stick_elements(body, x, p):
    """All elements of a body that slip stick, a hair below their limit, so that rounding does not
    make them slip at once.
    """
    count, (angle, _) = p.elements.shape[0], _angle_and_rate(body, x.y, p)
    limit = p.m_slide + p.m_stribeck
    if body == 1:
        limit = (p.l_slide + p.l_stribeck) * friction_factor_in(x.y, p)
    elif body == 2:
        limit = p.g_limit
    elif body == HARNESS:
        limit = p.harness_limit
    for e in elements_of(body, p):
        if x.stick[2 + e] != 0.0:
            torque = x.stick[2 + e] * (1.0 - 1e-9) * p.elements[e, 1] * limit
            x.stick[2 + count + e] = angle - torque / p.elements[e, 0]
            x.stick[2 + e] = 0.0
            x.counters[STICKS] += 1


@code.inner(**COMPILE)
def decide_element(e, x, p):
    """The mode after an event of an element: at its limit it slips; where its body comes to rest,
    all that slip on it stick.
    """
    body = body_of(e, p)
    angle, rate = _angle_and_rate(body, x.y, p)
    if body == BACKLASH:
        x.stick[2 + e] = math.copysign(1.0, angle) if x.stick[2 + e] == 0.0 else 0.0
    elif x.stick[2 + e] == 0.0:
        sign = math.copysign(1.0, angle - x.stick[2 + p.elements.shape[0] + e])
        if body == 1 and varies(p) and sign * rate < 0.0:
            _yield_inward(e, sign, angle, x, p)
        else:
            x.stick[2 + e] = sign
        x.counters[BREAKAWAYS] += 1
    elif (
        p.rigid and breakaway_torques(p, -p.inv_h, 1.0)[0] > 0.0
    ):  # rotor and output come to rest together, and so do both frictions
        decide_friction(0, x, p)
    elif (
        body == HARNESS and x.stick[1] != 0.0 and breakaway_torques(p, -p.inv_h, 1.0)[1] > 0.0
    ):  # the output comes to rest, and so do its frictions
        decide_friction(1, x, p)
    else:
        _stick_at_rest(body, x, p)


@code.inner(**COMPILE)
def _yield_inward(e, sign, angle, x, p):
    """An element of the output that is pulled back yields by ``YIELD`` of its limit.

    The friction there falls with the angle faster than the element's spring relaxes, so that it
    would carry more than its limit. It slides against the motion, in steps that are that small.
    """
    limit = (p.l_slide + p.l_stribeck) * friction_factor_in(x.y, p)
    torque = sign * (1.0 - YIELD) * p.elements[e, 1] * limit
    x.stick[2 + p.elements.shape[0] + e] = angle - torque / p.elements[e, 0]


@code.inner(**COMPILE)
def _stick_at_rest(body, x, p):
    """All elements stick that act on the same motion as those of a body, which comes to rest."""
    _stick_elements(body, x, p)
    if p.rigid:
        for other in (0, 1, HARNESS):
            _stick_elements(other, x, p)
    elif body == 1 or body == HARNESS:
        _stick_elements(1, x, p)
        _stick_elements(HARNESS, x, p)
    if body == 0 or p.rigid:
        x.y[WM] = 0.0
    elif body != 2:
        x.y[WL] = 0.0


# ---- Pulses ----
#
# A pulsed drive puts a voltage on a winding for the first part of each step, and then leaves it. A
# winding is driven, or conducts through its diodes (1 or -1, the sign of its current), or is open.
# Its margin is what is left of that current, or what the back-EMF lacks of the diodes' voltage. Of
# four windings 2 and 3 are wound against A (0) and B (1), and each is driven one way.


@code.inner(**INLINE)
def winding_back_emf(which, y, p):
    """Back-EMF of a winding, positive where it drives a positive current."""
    s, c = sincos(p.z * y[TM])
    s_A, c_B = flux_shapes(s, c, p)
    emf = p.K_m * y[WM] * s_A
    if which % 2 == 1:
        emf = -p.K_m * y[WM] * c_B
    if which > 1:
        emf = -emf
    return emf


@code.inner(**COMPILE)
def winding_margin(which, y, stick, p):
    """Margin that stays positive as long as the mode of a winding lasts."""
    mode = winding_mode(which, stick, p)
    if mode == DRIVEN:
        return 0.0 * y[TM] + 1.0
    if mode != IS_OPEN:
        return mode * y[IA + which]
    return (1.0 + 2.0 * HAIR) * p.diode_voltage - math.fabs(winding_back_emf(which, y, p))


@code.inner(**COMPILE)
def decide_winding(which, x, p):
    """The mode after an event of a winding: its current has ended, or its back-EMF has reached the
    diodes' voltage.
    """
    slot = 2 + 2 * p.elements.shape[0] + which
    ended = x.stick[slot] != IS_OPEN
    x.y[IA + which] = 0.0
    emf = winding_back_emf(which, x.y, p)
    if ended and math.fabs(emf) <= (1.0 + HAIR) * p.diode_voltage:
        x.stick[slot] = IS_OPEN
    else:
        x.stick[slot] = math.copysign(1.0, emf)


@code.inner(**COMPILE)
def _switch_off(which, x, p):
    """No switch drives a winding any longer: its current goes on through the diodes."""
    slot = 2 + 2 * p.elements.shape[0] + which
    if x.y[IA + which] != 0.0:
        x.stick[slot] = math.copysign(1.0, x.y[IA + which])
    else:
        x.stick[slot] = 1.0
        decide_winding(which, x, p)


@code.inner(**COMPILE)
def _judge_step(x, p):
    """Count the full steps that the rotor has lost or gained since the last pulse began."""
    clock, counters = x.clock, x.counters
    behind = math.floor((clock[THETA_E] * p.inv_z - x.y[TM]) / p.step + 0.5)
    if clock[DIRECTION] != 0.0:
        counters[STEPS_JUDGED] += 1
        lost = int(clock[DIRECTION] * (behind - clock[BEHIND]))
        if lost > 0:
            counters[STEPS_LOST] += lost
        else:
            counters[STEPS_GAINED] -= lost
        if lost != 0 and counters[FIRST_NOT_MADE] == 0:
            counters[FIRST_NOT_MADE] = counters[STEPS_JUDGED]
    clock[BEHIND] = behind


@code.inner(**INLINE)
def pulse_drives(which, row, p):
    """Whether a pulse is on a winding: of four those of A and B by currents that are positive."""
    if p.windings == 2:
        return row[which] != 0.0
    if which < 2:
        return row[which] > 0.0
    return row[which - 2] < 0.0


@code.inner(**COMPILE)
def start_pulse(row, x, p):
    """Take a full step: ``row`` has the currents to which the voltages of the pulse would lead, the
    electrical angle after it, and how long the pulse lasts.
    """
    _judge_step(x, p)
    clock = x.clock
    clock[DIRECTION] = math.copysign(1.0, row[2] - clock[THETA_E])
    clock[THETA_E], clock[REF_A], clock[REF_B] = row[2], row[0], row[1]
    clock[PULSE_END] = clock[NOW] + row[3]
    for which in range(p.windings):
        slot = 2 + 2 * p.elements.shape[0] + which
        if pulse_drives(which, row, p):
            x.stick[slot] = DRIVEN
        elif x.stick[slot] == DRIVEN:
            _switch_off(which, x, p)
    x.counters[MICROSTEPS] += 1


@code.inner(**INLINE)
def before_pulse_ends(target, clock):
    """``target``, or the end of a pulse where that is earlier by more than rounding."""
    end = clock[PULSE_END]
    if clock[NOW] < end < target - ROUNDED * max(target, 1.0):
        return end
    return target


@code.inner(**INLINE)
def pulse_is_over(clock):
    """Whether a pulse ends now."""
    end = clock[PULSE_END]
    return end != 0.0 and clock[NOW] >= end - ROUNDED * max(clock[NOW], 1.0)


@code.inner(**COMPILE)
def end_pulse(x, p):
    """Leave the windings of a pulse that is over."""
    clock = x.clock
    clock[REF_A], clock[REF_B], clock[PULSE_END] = 0.0, 0.0, 0.0
    for which in range(p.windings):
        if winding_mode(which, x.stick, p) == DRIVEN:
            _switch_off(which, x, p)


@code.inner(**INLINE)
def follow(y, p):
    """With a rigid reducer, set the output from the rotor."""
    if p.rigid:
        e0, e1, _, _ = transmission_error(y[TM], p.te)
        y[TL], y[WL] = e0 - y[TM] * p.inv_h, (e1 - p.inv_h) * y[WM]


@code.inner(**INLINE)
def health(lag, h, now, stalled):
    """Status after a step of length ``h`` with the rotor an electrical angle ``lag`` off; count of
    vanishing steps in a row.
    """
    stalled = stalled + 1 if h < ROUNDED * max(1.0, now) else 0
    if math.fabs(lag) > math.pi:
        return LOST_SYNCHRONISM, stalled
    return (STEP_TOO_SMALL if stalled > 1000 else OK), stalled


@code.entry(**COMPILE)
def snapshot(x: State, p: Drive, scratch: Matrix, out: Vector) -> None:
    """All channels at the present state, into ``out``."""
    channels(
        x.y,
        references_after(0.0, x.clock),
        noise_at(x.clock[NOW], p),
        x.stick,
        p,
        scratch[0, : x.y.size],
        scratch[1],
        out,
    )
