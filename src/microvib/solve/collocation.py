"""One step of a drive: what is linear is propagated exactly, and what is not enters as a
polynomial.

Between two events a drive is nearly linear, if it is seen from its command: with the currents
turned by the commanded electrical angle and the angles counted from it, dx/dt = A x + r, with a
matrix A that only depends on which bodies stick, and a deficit r = f - A x that is left of the
equations of motion f (``kernel.drive_derivative``): the sine of the electromagnetic spring beyond
its slope, detent torque, friction, transmission error, the supply's limit. However large r is, this
is no approximation.

A step takes r as the cubic through its values at four nodes (Lobatto's: both ends are nodes). The
states there are then

    x(c T) = E(c T) x(0) + sum over nodes j of K_j(c T) r_j,      E(t) = exp(A t),  K_j = integral of E(c T - t) l_j(t / T) dt

with l_j the cubic that is 1 at node j and 0 at the others; E and K come from tables (``tabulate``),
for lengths T of the longest step over powers of two. r depends on x, so the equation is iterated;
that contracts, because A has taken what is stiff. The nodes are the four lanes of a vector
(``microvib.solve.vector``), so that f is evaluated at all of them at once. The highest Legendre
term of r, peak to peak over what a microstep moves, is the error estimate.

Wherever a step has to end, at a microstep or where a friction sticks or breaks away, its solution
is taken there (``solution_at``): the propagators of shorter and shorter lengths lead to any instant
of it. So an event costs no further step.

The modes of the array are no part of A, so that their number costs no more than their sum: they
move as free oscillators, driven by the cubic through the output's rate at the nodes, and their
torque is a part of f.
"""

import math
from typing import NamedTuple

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve.frame import reference_offset, stick_pattern
from microvib.solve.kernel import (
    FORCED,
    IA,
    IB,
    INLINE,
    ITERATIONS_MADE,
    MODES,
    NOW,
    SEEN_RATE_D,
    SEEN_RATE_Q,
    THETA_E,
    TL,
    TM,
    WL,
    WM,
    XA,
    XB,
    drive_derivative,
    element_margin,
    margins_known,
    modal_torques,
    noise_at,
    output_rate,
    references_after,
    winding_margin,
)
from microvib.solve.nodes import CUBES, HIGHEST
from microvib.solve.propagators import (
    CONVERGED,
    INPUTS,
    ITERATIONS,
    M_MOMENTUM,
    M_ON_ROTOR,
    M_TORQUE,
    MODE_ROWS,
    NODE_ROWS,
    S_BOTH,
    S_MOMENTUM,
    S_OUTPUT,
    S_ROTOR,
    S_ROTOR_MOMENTUM,
    SUM_ROWS,
    N,
)
from microvib.solve.vector import rows, where

LAYER = 5.0
"""Rate over the Stribeck rate below which friction falls."""

code = Unit(__name__, "propagators.py", "frame.py")


class Work(NamedTuple):
    """Scratch of a step; matrices of lanes have a row of four for each quantity."""

    x: Vector  # state seen from the command, (N,)
    end: Vector  # the same at the end of the step
    modes: Vector  # states of the modes at the end of the step
    there: Vector  # both, not seen from the command
    free: Matrix  # lanes: E x
    at: Matrix  # lanes: states at the nodes
    y: Matrix  # lanes: the same, and the modes', not seen from the command
    f: Matrix  # lanes
    q: Matrix  # lanes
    r: Matrix  # lanes: deficits
    before: Matrix  # lanes: the same of the last iterate
    sums: Matrix  # lanes: what FREE_TORQUE ... name
    noise: Matrix  # lanes: torque noise
    margins: Matrix  # lanes: of the elements of frictions with memory, and of switched windings
    values: Matrix  # lanes: channels
    by_node: Matrix  # what is sampled, (4, channels)
    powers: Matrix  # coefficients of the deficits' cubics, two rows for each power
    shifted: Matrix  # the same about another instant
    halves: Matrix  # ``end`` as two rows of lanes
    both: Matrix  # ``poly`` as two rows of lanes
    poly: Vector  # coefficients of the momentum, (8,)
    per_size: Vector  # of this step
    term: Vector  # (N,)
    term_halves: Matrix
    weights: Matrix  # lanes: of the nodes, in an integral; a row
    flows: Matrix  # lanes of the powers: a row for each node, and their running integrals


# torques and momentum of the modes as free oscillators; torques; T_d; momentum; margins; change
(
    FREE_TORQUE,
    FREE_MOMENTUM,
    TORQUE,
    TORQUE_D,
    MOMENTUM,
    MARGIN_M,
    MARGIN_L,
    CHANGE,
    FREE_ON_ROTOR,
    ON_ROTOR,
    N_SUMS,
) = range(11)


@code.inner(**FORCED)
def _evaluate_deficits(T, s, c, modal, on_rotor, x, p, t, w):
    """States at the nodes not seen from the command, the derivative there, and the deficits
    ``w.r``; of a step of length ``T``.
    """
    at, y, f = rows(w.at, 0, N, 1), rows(w.y, 0, w.y.shape[0], 1), rows(w.f, 0, w.f.shape[0], 1)
    r, sums, A = rows(w.r, 0, 6, 1), rows(w.sums, 0, N_SUMS, 1), t.A[stick_pattern(x.stick, p)]
    a0, a1, a2, a3, a4, a5, a6, a7 = at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7]
    i_d, x_d, angle = a0 + t.current, a2 + t.windup, x.clock[THETA_E] * p.inv_z
    y[IA], y[IB] = i_d * c - a1 * s, a1 * c + i_d * s
    y[XA], y[XB] = x_d * c - a3 * s, a3 * c + x_d * s
    y[TM], y[WM], y[TL], y[WL] = a4 + angle, a5, a6 - angle * p.inv_h, a7
    dt = T * rows(t.fractions, 0, 1, 1)[0]
    if not p.ideal:
        off_A, off_B = reference_offset(dt, x.clock, s, c)
        y[IA], y[IB] = y[IA] + off_A, y[IB] + off_B
    noise = rows(w.noise, 0, 1, 1)[0]
    drive_derivative(
        y, modal - noise, on_rotor, references_after(dt, x.clock), x.stick, p, f, rows(w.q, 0, 7, 1)
    )
    sums[TORQUE], sums[ON_ROTOR] = modal, on_rotor
    f_d, f_q = f[IA] * c + f[IB] * s, f[IB] * c - f[IA] * s
    r[0] = (
        f_d
        - ((A[IA, 0] * a0 + A[IA, 1] * a1) + (A[IA, 2] * a2 + A[IA, 3] * a3))
        - ((A[IA, 4] * a4 + A[IA, 5] * a5) + (A[IA, 6] * a6 + A[IA, 7] * a7))
    )
    r[1] = (
        f_q
        - ((A[IB, 0] * a0 + A[IB, 1] * a1) + (A[IB, 2] * a2 + A[IB, 3] * a3))
        - ((A[IB, 4] * a4 + A[IB, 5] * a5) + (A[IB, 6] * a6 + A[IB, 7] * a7))
    )
    if not p.ideal:
        r[0], r[1] = r[0] - x.clock[SEEN_RATE_D], r[1] - x.clock[SEEN_RATE_Q]
    for k in range(2, 4):
        i = WM if k == 2 else WL
        r[k] = (
            f[i]
            - ((A[i, 0] * a0 + A[i, 1] * a1) + (A[i, 2] * a2 + A[i, 3] * a3))
            - ((A[i, 4] * a4 + A[i, 5] * a5) + (A[i, 6] * a6 + A[i, 7] * a7))
        )
    if t.inputs > 4:
        r[4], r[5] = f[XA] * c + f[XB] * s, f[XB] * c - f[XA] * s
        for j in range(N):
            r[4] = r[4] - A[XA, j] * at[j]
            r[5] = r[5] - A[XB, j] * at[j]


@code.inner(**INLINE)
def _zero_lanes(t):
    """Lanes of zeros, of numbers that are finite whatever an iteration came to."""
    return rows(t.fractions, 0, 1, 1)[0] * 0.0


@code.inner(**FORCED)
def _free_modes(level, x, p, t, w):
    """Torques and momentum of the modes as free oscillators."""
    sums, modes = (
        rows(w.sums, 0, N_SUMS, 1),
        rows(t.modes, level * p.H.size * MODE_ROWS, p.H.size * MODE_ROWS, MODE_ROWS),
    )
    torque = momentum = on_rotor = _zero_lanes(t)
    for k in range(p.H.size):
        eta, rate = x.y[MODES + 2 * k], x.y[MODES + 2 * k + 1]
        torque += modes[k, M_TORQUE] * eta + modes[k, M_TORQUE + 1] * rate
        momentum += modes[k, M_MOMENTUM] * eta + modes[k, M_MOMENTUM + 1] * rate
        if p.H_m.size > 0:
            on_rotor += modes[k, M_ON_ROTOR] * eta + modes[k, M_ON_ROTOR + 1] * rate
    sums[FREE_TORQUE], sums[FREE_MOMENTUM], sums[FREE_ON_ROTOR] = torque, momentum, on_rotor


@code.inner(**INLINE)
def _noise_at_nodes(T, x, p, w):
    """Torque noise at the nodes of a step of length ``T``."""
    if p.noise.size > 0:
        for j in range(4):
            w.noise[0, j] = noise_at(x.clock[NOW] + CUBES[j] * T, p)


@code.inner(**FORCED)
def solve_collocation(level, afresh, s, c, x, p, t, w):
    """Solve the step's equation; the last change of the deficits, over what a microstep moves.

    It begins from the deficits in ``w.r`` or, ``afresh``, from those at the start of the step,
    taken for all of it.
    """
    r, before, sums = rows(w.r, 0, 6, 1), rows(w.before, 0, 6, 1), rows(w.sums, 0, N_SUMS, 1)
    T, block = t.longest * 0.5**level, (stick_pattern(x.stick, p) * t.levels + level) * NODE_ROWS
    E, K = rows(t.nodes, block, N * N, N), rows(t.nodes, block + N * N, 24 * N, N)
    coupling = rows(t.sums, level * SUM_ROWS, SUM_ROWS, 1)
    _free_states(E, t, w)
    _free_modes(level, x, p, t, w)
    last, change, first = math.inf, math.inf, 0 if afresh else 1
    if afresh:
        _noise_at_nodes(0.0, x, p, w)
    else:
        _noise_at_nodes(T, x, p, w)
    for n in range(first, ITERATIONS + 1):
        if n == 0:
            modal, on_rotor = _at_start(x, p, t, w)
        else:
            if n == 1:
                set_error_weights(x, p, t, w)  # by the start of the step
            _states_at_nodes(K, x, p, t, w)
            modal, on_rotor = sums[FREE_TORQUE], sums[FREE_ON_ROTOR]
            for j in range(4):
                modal += coupling[S_OUTPUT + j] * w.at[WL, j]
            if p.H_m.size > 0:
                for j in range(4):
                    modal += coupling[S_BOTH + j] * w.at[WM, j]
                    on_rotor += (
                        coupling[S_BOTH + j] * w.at[WL, j] + coupling[S_ROTOR + j] * w.at[WM, j]
                    )
        for k in range(t.inputs):
            before[k] = r[k]
        # One copy of the equations serves both: it is most of what is compiled.
        _evaluate_deficits(T if n > 0 else 0.0, s, c, modal, on_rotor, x, p, t, w)
        if n == 0:
            _noise_at_nodes(T, x, p, w)
            continue
        x.counters[ITERATIONS_MADE] += 1
        largest = math.fabs(r[0] - before[0]) * w.per_size[0]
        for k in range(1, t.inputs):
            size = math.fabs(r[k] - before[k]) * w.per_size[k]
            largest = where(size > largest, size, largest)
        sums[CHANGE] = largest
        change = T * max(
            max(w.sums[CHANGE, 0], w.sums[CHANGE, 1]), max(w.sums[CHANGE, 2], w.sums[CHANGE, 3])
        )
        if not change > CONVERGED * t.accuracy or not change < 0.7 * last:
            break
        last = change
    _states_at_nodes(K, x, p, t, w)
    return change


@code.inner(**INLINE)
def _at_start(x, p, t, w):
    """States at the nodes as at the start of the step; torques of the modes there."""
    at = rows(w.at, 0, N, 1)
    nothing, rate = (
        _zero_lanes(t),
        output_rate(w.x[TM] + x.clock[THETA_E] * p.inv_z, w.x[WM], w.x[WL], p),
    )
    for i in range(N):
        at[i] = nothing + w.x[i]
    modal, on_rotor = modal_torques(x.y, rate, p)
    return nothing + modal, nothing + on_rotor


@code.inner(**FORCED)
def _add_products(a, M, m, value):
    """Eight sums with one product more each; side by side, because each addition waits for the one
    before.
    """
    return (
        a[0] + M[m, 0] * value, a[1] + M[m, 1] * value, a[2] + M[m, 2] * value, a[3] + M[m, 3] * value,
        a[4] + M[m, 4] * value, a[5] + M[m, 5] * value, a[6] + M[m, 6] * value, a[7] + M[m, 7] * value,
    )  # fmt: skip


@code.inner(**FORCED)
def _free_states(E, t, w):
    """States at the nodes without deficits."""
    free, nothing = rows(w.free, 0, N, 1), _zero_lanes(t)
    a = nothing, nothing, nothing, nothing, nothing, nothing, nothing, nothing
    for j in range(N):
        a = _add_products(a, E, j, w.x[j])
    free[0], free[1], free[2], free[3], free[4], free[5], free[6], free[7] = a


@code.inner(**FORCED)
def _states_at_nodes(K, x, p, t, w):
    """States at the nodes by the deficits ``w.r``."""
    free, at = rows(w.free, 0, N, 1), rows(w.at, 0, N, 1)
    a = free[0], free[1], free[2], free[3], free[4], free[5], free[6], free[7]
    for k in range(t.inputs):
        for j in range(4):
            a = _add_products(a, K, 4 * k + j, w.r[k, j])
    at[0], at[1], at[2], at[3], at[4], at[5], at[6] = a[0], a[1], a[2], a[3], a[4], a[5], a[6]
    at[7] = output_rate(a[4] + x.clock[THETA_E] * p.inv_z, a[5], a[7], p)


@code.inner(**INLINE)
def error_estimate(level, t, w, out):
    """The highest Legendre term of the deficits, peak to peak, over what a microstep moves;
    weighted, that of rates and currents.

    The ends of steps are exact where deficits are cubics; what is sampled inside is a cubic only
    where the motion itself is.
    """
    error, T = 0.0, t.longest * 0.5**level
    for k in range(t.inputs):
        total = 0.0
        for j in range(4):
            total += HIGHEST[j] * w.r[k, j]
        error = max(error, math.fabs(total) * w.per_size[k] * T)
    for k in range(4):
        total = 0.0
        for j in range(4):
            total += HIGHEST[j] * w.at[INPUTS[k], j]
        weight = out.rates_shown if k >= 2 else out.currents_shown
        error = max(error, weight * math.fabs(total) * t.per_size[k])
    return error


@code.inner(**INLINE)
def _error_growth(rate, stribeck, inv_rate, inertia, alpha):
    """How much an error of a rate grows while friction falls or rises on the way out of its layer
    or into it.

    There an error grows as the acceleration does, which changes by the Stribeck excess.
    """
    if stribeck > 0.0 and math.fabs(rate) * inv_rate < LAYER:
        return 1.0 + stribeck / (inertia * math.fabs(alpha) + 1e-300)
    return 1.0


@code.inner(**INLINE)
def set_error_weights(x, p, t, w):
    """Sizes over which errors count: near a stop less, by what an error grows; at most the rate
    that friction takes to fall.
    """
    grown_m = grown_l = 1.0
    if x.stick[0] != 0.0:
        J = p.J_m + p.inv_h * p.inv_h * p.J_L if p.rigid else p.J_m
        grown_m = _error_growth(w.at[WM, 3], p.m_stribeck, p.m_inv_rate, J, w.f[WM, 3])
        if p.rigid:
            grown_m = max(
                grown_m,
                _error_growth(
                    w.at[WL, 3], p.l_stribeck * math.fabs(p.inv_h), p.l_inv_rate, J, w.f[WM, 3]
                ),
            )
    if x.stick[1] != 0.0 and not p.rigid:
        grown_l = _error_growth(w.at[WL, 3], p.l_stribeck, p.l_inv_rate, p.J_L, w.f[WL, 3])
    for k in range(6):
        w.per_size[k] = t.per_size[k]
    w.per_size[2] = min(t.per_size[2] * grown_m, t.per_layer[2])
    w.per_size[3] = min(t.per_size[3] * grown_l, t.per_layer[3])


@code.inner(**FORCED)
def extrapolate_deficits(how, t, w):
    """Deficits of another step, from those of the last."""
    r, by = rows(w.r, 0, 6, 1), rows(t.onwards, 4 * how, 4, 1)
    for k in range(t.inputs):
        r[k] = by[0] * w.r[k, 0] + by[1] * w.r[k, 1] + by[2] * w.r[k, 2] + by[3] * w.r[k, 3]


@code.inner(**FORCED)
def margins_at_nodes(p, x, w):
    """Margins of both frictions, momentum and disturbance torque at the nodes."""
    y, f, q = rows(w.y, 0, w.y.shape[0], 1), rows(w.f, 0, w.f.shape[0], 1), rows(w.q, 0, 7, 1)
    sums, margins = rows(w.sums, 0, N_SUMS, 1), rows(w.margins, 0, w.margins.shape[0], 1)
    sums[MARGIN_M], sums[MARGIN_L] = margins_known(y, q, x.stick, p)
    for e in range(p.elements.shape[0]):
        margins[e] = element_margin(e, y, x.stick, p)
    for which in range(p.windings):
        margins[p.elements.shape[0] + which] = winding_margin(which, y, x.stick, p)
    sums[TORQUE_D] = sums[TORQUE] - p.J_L * q[6] - p.J_m * f[WM]
    if p.H_m.size > 0:
        sums[TORQUE_D] = sums[TORQUE_D] + sums[ON_ROTOR] - p.J_c * (q[6] + f[WM])


@code.inner(**FORCED)
def fit_momentum(level, p, t, w):
    """Momentum at the nodes, and the polynomial of degree 7 through it and the torque, into
    ``w.poly``.
    """
    at, sums = rows(w.at, 0, N, 1), rows(w.sums, 0, N_SUMS, 1)
    coupling = rows(t.sums, level * SUM_ROWS, SUM_ROWS, 1)
    total = p.J_m * at[WM] + p.J_L * at[WL] + sums[FREE_MOMENTUM]
    for j in range(4):
        total += coupling[S_MOMENTUM + j] * w.at[WL, j]
    if p.H_m.size > 0:
        total += p.J_c * (at[WM] + at[WL])
        for j in range(4):
            total += coupling[S_ROTOR_MOMENTUM + j] * w.at[WM, j]
    sums[MOMENTUM] = total
    T, by = -t.longest * 0.5**level, rows(t.momentum, 0, 16, 2)
    lower, upper = by[0, 0] * w.sums[MOMENTUM, 0], by[0, 1] * w.sums[MOMENTUM, 0]
    for j in range(1, 4):
        lower += by[j, 0] * w.sums[MOMENTUM, j]
        upper += by[j, 1] * w.sums[MOMENTUM, j]
    for j in range(4):
        lower += by[4 + j, 0] * (T * w.sums[TORQUE_D, j])
        upper += by[4 + j, 1] * (T * w.sums[TORQUE_D, j])
    both = rows(w.both, 0, 2, 1)
    both[0], both[1] = lower, upper
