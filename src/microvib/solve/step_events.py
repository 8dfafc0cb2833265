"""Where a step ends: at its end, at a microstep, or where a friction sticks or breaks away.

The solution of a step (``microvib.solve.collocation``) is known at any instant inside it, not only
at its nodes.
"""

import math

from microvib.compiled import Unit
from microvib.solve.collocation import MARGIN_M
from microvib.solve.frame import add_reference_offset, from_command_frame, stick_pattern
from microvib.solve.kernel import (
    AT_LIMIT,
    BACKLASH,
    COMPILE,
    FORCED,
    HAIR,
    HARNESS,
    INLINE,
    IS_OPEN,
    MODES,
    NOW,
    TL,
    TM,
    WL,
    WM,
    body_of,
    element_margin,
    margins,
    noise_at,
    winding_margin,
    winding_mode,
)
from microvib.solve.nodes import CUBES, HERMITE, LAGRANGE
from microvib.solve.propagators import (
    BY_ROTOR,
    INPUTS,
    M_E,
    M_ETA_END,
    M_ETA_PART,
    M_W_END,
    M_W_PART,
    MODE_ROWS,
    PIECE_ROWS,
    N,
)
from microvib.solve.vector import rows

code = Unit(__name__, "collocation.py")


@code.inner(**INLINE)
def _margin_of(which, x, p, w):
    """Values of a margin at the nodes; where it is a rate, the row of that rate and its sign in the
    margin, else 0.

    Margins are those of rotor and output, of the elements of frictions with memory and of switched
    windings.
    """
    if which < 2:
        return w.sums[MARGIN_M + which], WM if which == 0 else WL, x.stick[which]
    if which >= 2 + p.elements.shape[0]:
        return w.margins[which - 2], WM, 0.0
    body = body_of(which - 2, p)
    if body == 2 or body == BACKLASH or (body != 0 and p.rigid):
        sign = 0.0
    else:
        sign = x.stick[which]
    return w.margins[which - 2], WM if body == 0 else WL, sign


@code.inner(**COMPILE)
def _fit_margin(which, T, x, p, w):
    """Coefficients of the margin of friction ``which`` over the step, into ``w.poly``.

    A polynomial through its values at the nodes; that of a friction that slips has its slopes as
    well.
    """
    values, row, sign = _margin_of(which, x, p, w)
    poly = w.poly
    for m in range(8):
        poly[m] = 0.0
        for j in range(4):
            if sign != 0.0:
                poly[m] += sign * (
                    HERMITE[m, j] * w.at[row, j] + HERMITE[m, 4 + j] * T * w.f[row, j]
                )
            elif m < 4:
                poly[m] += LAGRANGE[j, m] * values[j]


@code.inner(**INLINE)
def _inside(u, lo, hi):
    """``u``, or the middle of the interval where it is not inside."""
    if lo < u < hi:
        return u
    return 0.5 * (lo + hi)


@code.inner(**INLINE)
def _value_and_slopes(u, poly):
    """A polynomial of degree 7 and its first two derivatives at ``u``."""
    value = slope = curvature = 0.0
    for m in range(7, -1, -1):
        curvature = curvature * u + 2.0 * slope
        slope = slope * u + value
        value = value * u + poly[m]
    return value, slope, curvature


@code.inner(**COMPILE)
def _grazes(which, T, x, p, w):
    """Node before which, and fraction where, a rate that is positive at all nodes is lowest between
    two, if negative; else 0, 2.
    """
    values, row, sign = _margin_of(which, x, p, w)
    for node in range(1, 4):
        lo, hi = CUBES[node - 1], CUBES[node]
        if values[node - 1] == 0.0:
            continue  # it has just broken away
        falls, rises = (
            sign * w.f[row, node - 1] * T * (hi - lo),
            sign * w.f[row, node] * T * (hi - lo),
        )
        if falls < 0.0 < rises and min(values[node - 1] + falls, values[node] - rises) < 0.0:
            _fit_margin(which, T, x, p, w)
            u = lo + (hi - lo) * falls / (falls - rises)
            for _ in range(60):
                _, slope, curvature = _value_and_slopes(u, w.poly)
                if slope < 0.0:
                    lo = u
                else:
                    hi = u
                following = _inside(u - slope / curvature if curvature > 0.0 else hi, lo, hi)
                if math.fabs(following - u) < 1e-9:
                    break
                u = following
            if _value_and_slopes(u, w.poly)[0] < 0.0:
                return node, u
    return 0, 2.0


@code.inner(**COMPILE)
def first_root(which, until, T, x, p, w):
    """First fraction of the step, up to ``until``, where the margin of friction ``which`` falls
    below zero; else 2.
    """
    values, _, sign = _margin_of(which, x, p, w)
    node = 1
    while node < 4 and values[node] >= 0.0:
        node += 1
    lo, hi = CUBES[node - 1], 2.0
    if node < 4:
        hi = CUBES[node]
    elif sign != 0.0:
        node, hi = _grazes(which, T, x, p, w)
        lo = CUBES[node - 1]
    if hi == 2.0 or lo >= until:
        return 2.0
    if values[node - 1] < 0.0:
        return lo
    _fit_margin(which, T, x, p, w)
    at_lo, at_hi = values[node - 1], _value_and_slopes(hi, w.poly)[0]
    u = lo + (hi - lo) * at_lo / (at_lo - at_hi)
    for _ in range(60):
        value, slope, _ = _value_and_slopes(u, w.poly)
        if value < 0.0:
            hi = u
        else:
            lo = u
        following = _inside(u - value / slope if slope < 0.0 else hi, lo, hi)
        if math.fabs(following - u) < 1e-13:
            break
        u = following
    if u < until:
        return u
    return 2.0


@code.inner(**FORCED)
def _shift(done, piece, t, w):
    """Coefficients of the deficits' cubics about the fraction ``done`` of the step, in units of a
    ``piece`` of it.
    """
    powers, shifted = rows(w.powers, 0, 8, 2), rows(w.shifted, 0, 8, 2)
    for half in range(t.inputs // 4 + t.inputs % 4 // 2):
        c0, c1, c2, c3 = powers[0, half], powers[1, half], powers[2, half], powers[3, half]
        shifted[0, half] = c0 + done * (c1 + done * (c2 + done * c3))
        shifted[1, half] = piece * (c1 + done * (2.0 * c2 + done * 3.0 * c3))
        shifted[2, half] = piece * piece * (c2 + done * 3.0 * c3)
        shifted[3, half] = piece * piece * piece * c3


@code.inner(**COMPILE)
def solution_at(u, level, x, p, t, w):
    """The step's solution at its fraction ``u``: the drive into ``w.end``, the modes into
    ``w.modes``.

    Pieces of half, a quarter, ... of the step lead there, and a Taylor series over what is left.
    """
    pattern, inputs = stick_pattern(x.stick, p), t.inputs
    for m in range(4):
        for k in range(inputs):
            w.powers[2 * m + k // 4, k % 4] = (
                LAGRANGE[0, m] * w.r[k, 0]
                + LAGRANGE[1, m] * w.r[k, 1]
                + (LAGRANGE[2, m] * w.r[k, 2] + LAGRANGE[3, m] * w.r[k, 3])
            )
    for i in range(N):
        w.end[i] = w.x[i]
    for j in range(w.modes.size):
        w.modes[j] = x.y[MODES + j]
    done, piece, end = 0.0, 1.0, rows(w.halves, 0, 2, 1)
    for deeper in range(level + 1, t.levels):
        piece *= 0.5
        if done + piece <= u:
            _shift(done, piece, t, w)
            block = rows(t.pieces, (pattern * t.levels + deeper) * PIECE_ROWS, PIECE_ROWS, 2)
            # four sums, because each addition waits for the one before
            lower, upper = block[0, 0] * w.end[0], block[0, 1] * w.end[0]
            for j in range(1, N):
                lower += block[j, 0] * w.end[j]
                upper += block[j, 1] * w.end[j]
            for k in range(0, inputs, 2):
                first, second = k // 4, k % 4
                below, above = (
                    block[N + 4 * k, 0] * w.shifted[first, second],
                    block[N + 4 * k, 1] * w.shifted[first, second],
                )
                for m in range(1, 4):
                    below += block[N + 4 * k + m, 0] * w.shifted[2 * m + first, second]
                    above += block[N + 4 * k + m, 1] * w.shifted[2 * m + first, second]
                for m in range(4):
                    below += block[N + 4 * k + 4 + m, 0] * w.shifted[2 * m + first, second + 1]
                    above += block[N + 4 * k + 4 + m, 1] * w.shifted[2 * m + first, second + 1]
                lower += below
                upper += above
            end[0], end[1] = lower, upper
            _advance_modes(deeper, done, piece, p, t, w)
            done += piece
    _taylor_remainder(pattern, done, u - done, t.longest * 0.5**level, x, p, t, w)


@code.inner(**FORCED)
def _advance_modes(level, done, piece, p, t, w):
    """Move ``w.modes`` on by a piece of a step."""
    b0, b1, b2, b3 = _moments(WL, done, piece, w)
    m0, m1, m2, m3 = _moments(WM, done, piece, w)
    modes, s = t.modes, p.H.size
    for k in range(s):
        row = (level * s + k) * MODE_ROWS
        eta, rate, M = w.modes[2 * k], w.modes[2 * k + 1], modes[row : row + MODE_ROWS]
        by_eta, by_w = M[M_ETA_PART], M[M_W_PART]
        w.modes[2 * k] = (
            M[M_E, 0] * eta
            + M[M_E, 1] * rate
            + by_eta[0] * b0
            + by_eta[1] * b1
            + by_eta[2] * b2
            + by_eta[3] * b3
        )
        w.modes[2 * k + 1] = (
            M[M_E, 2] * eta
            + M[M_E, 3] * rate
            + by_w[0] * b0
            + by_w[1] * b1
            + by_w[2] * b2
            + by_w[3] * b3
        )
        if p.H_m.size > 0:
            by_eta, by_w = M[BY_ROTOR + M_ETA_PART], M[BY_ROTOR + M_W_PART]
            w.modes[2 * k] += by_eta[0] * m0 + by_eta[1] * m1 + by_eta[2] * m2 + by_eta[3] * m3
            w.modes[2 * k + 1] += by_w[0] * m0 + by_w[1] * m1 + by_w[2] * m2 + by_w[3] * m3


@code.inner(**FORCED)
def _moments(shaft, done, piece, w):
    """Coefficients of that cubic about the fraction ``done`` of the step, in units of a ``piece``
    of it.
    """
    c0, c1, c2, c3 = _rate_cubic(shaft, w)
    return (
        c0 + done * (c1 + done * (c2 + done * c3)),
        piece * (c1 + done * (2.0 * c2 + done * 3.0 * c3)),
        piece * piece * (c2 + done * 3.0 * c3),
        piece * piece * piece * c3,
    )


@code.inner(**FORCED)
def _rate_cubic(shaft, w):
    """Coefficients of the cubic through the rate of a shaft, WL or WM, at the nodes."""
    r0, r1, r2, r3 = w.at[shaft, 0], w.at[shaft, 1], w.at[shaft, 2], w.at[shaft, 3]
    return (
        LAGRANGE[0, 0] * r0 + LAGRANGE[1, 0] * r1 + LAGRANGE[2, 0] * r2 + LAGRANGE[3, 0] * r3,
        LAGRANGE[0, 1] * r0 + LAGRANGE[1, 1] * r1 + LAGRANGE[2, 1] * r2 + LAGRANGE[3, 1] * r3,
        LAGRANGE[0, 2] * r0 + LAGRANGE[1, 2] * r1 + LAGRANGE[2, 2] * r2 + LAGRANGE[3, 2] * r3,
        LAGRANGE[0, 3] * r0 + LAGRANGE[1, 3] * r1 + LAGRANGE[2, 3] * r2 + LAGRANGE[3, 3] * r3,
    )


@code.inner(**FORCED)
def _taylor_remainder(pattern, done, left, T, x, p, t, w):
    """The last part of the step's solution, shorter than the shortest piece, by Taylor: x_(m+1) =
    (A x_m + c_m) dt/(m+1).
    """
    _shift(done, left, t, w)
    dt, A, term, end = (
        left * T,
        rows(t.columns, pattern * 2 * N, 2 * N, 2),
        rows(w.term_halves, 0, 2, 1),
        rows(w.halves, 0, 2, 1),
    )
    term[0], term[1] = end[0], end[1]
    for m in range(4):
        lower, upper = A[0, 0] * w.term[0], A[0, 1] * w.term[0]
        below, above = A[1, 0] * w.term[1], A[1, 1] * w.term[1]
        for j in range(2, N, 2):
            lower += A[j, 0] * w.term[j]
            upper += A[j, 1] * w.term[j]
            below += A[j + 1, 0] * w.term[j + 1]
            above += A[j + 1, 1] * w.term[j + 1]
        term[0], term[1] = lower + below, upper + above
        factor = dt / (m + 1)
        for k in range(t.inputs):
            w.term[INPUTS[k]] += w.shifted[2 * m + k // 4, k % 4]
        term[0], term[1] = term[0] * factor, term[1] * factor
        end[0], end[1] = end[0] + term[0], end[1] + term[1]
    output, change, _, _ = _moments(WL, done, left, w)
    rotor, rotor_change, _, _ = _moments(WM, done, left, w)
    for k in range(p.H.size):  # two terms: modes are slow
        rate = w.modes[2 * k + 1] - p.H[k] * output
        if p.H_m.size > 0:
            rate -= p.H_m[k] * rotor
        d_eta = dt * rate
        d_w = -p.D[k] * d_eta - dt * p.Lam[k] * w.modes[2 * k]
        viscous = 0.0
        if p.H_m.size > 0:
            d_w -= dt * (p.V[k] * output + p.V_m[k] * rotor)
            viscous = p.V[k] * change + p.V_m[k] * rotor_change
        moved = d_w - p.H[k] * change
        if p.H_m.size > 0:
            moved -= p.H_m[k] * rotor_change
        w.modes[2 * k] += d_eta + 0.5 * dt * moved
        w.modes[2 * k + 1] += d_w - 0.5 * dt * (p.D[k] * moved + p.Lam[k] * d_eta + viscous)
    if x.stick[0] == 0.0:
        w.end[TM], w.end[WM] = w.x[TM], 0.0
    if x.stick[1] == 0.0:
        w.end[TL], w.end[WL] = w.x[TL], 0.0


@code.inner(**FORCED)
def end_of_whole_step(level, p, x, t, w):
    """The end of a whole step, which is its last node."""
    for i in range(N):
        w.end[i] = w.at[i, 3]
    modes, s = t.modes, p.H.size
    for k in range(s):
        row = (level * s + k) * MODE_ROWS
        eta, rate = x.y[MODES + 2 * k], x.y[MODES + 2 * k + 1]
        after_eta = modes[row + M_E, 0] * eta + modes[row + M_E, 1] * rate
        after_rate = modes[row + M_E, 2] * eta + modes[row + M_E, 3] * rate
        for j in range(4):
            after_eta += modes[row + M_ETA_END, j] * w.at[WL, j]
            after_rate += modes[row + M_W_END, j] * w.at[WL, j]
        if p.H_m.size > 0:
            for j in range(4):
                after_eta += modes[row + BY_ROTOR + M_ETA_END, j] * w.at[WM, j]
                after_rate += modes[row + BY_ROTOR + M_W_END, j] * w.at[WM, j]
        w.modes[2 * k], w.modes[2 * k + 1] = after_eta, after_rate


@code.inner(**INLINE)
def _margin_there(dt, which, x, p, w):
    """Margin of rotor or output in the state ``w.there``, ``dt`` after now."""
    return margins(w.there, noise_at(x.clock[NOW] + dt, p), x.stick, p)[which]


@code.inner(**COMPILE)
def _spent_within(which, x, p, t, w):
    """Size of a margin that is as good as zero."""
    winding = which - 2 - p.elements.shape[0]
    if winding >= 0:
        own = p.diode_voltage
        if winding_mode(winding, x.stick, p) != IS_OPEN:
            own = own / p.R
        return HAIR * own
    if which < 2:
        body = which
    else:
        body = body_of(which - 2, p)
    scale = w.per_size[2 if body == 0 or p.rigid else 3]
    limit = (p.m_slide + p.m_stribeck) + (p.l_slide + p.l_stribeck)
    if body >= 2:
        if body == 2:
            limit = p.g_limit
        elif body == HARNESS:
            limit = p.harness_limit
        else:
            limit = p.K_g * p.gap
    # rates that are left are set to 0: momentum lost, where elements come to rest often
    if x.stick[which] != 0.0 and body != BACKLASH:
        return (1e-4 if which < 2 else 1e-8) * t.accuracy / scale
    return AT_LIMIT * limit


@code.inner(**FORCED)
def margin_within(u, which, level, x, p, t, w):
    """Margin of friction or winding ``which`` at the fraction ``u`` of the step, with the solution
    there in ``w.end``, ``w.modes`` and ``w.there``.
    """
    length = t.longest * 0.5**level
    solution_at(u, level, x, p, t, w)
    add_reference_offset(w.end, u * length, x, p)
    from_command_frame(w.end, w.there, x, p, t)
    for j in range(w.modes.size):
        w.there[MODES + j] = w.modes[j]
    if which >= 2 + p.elements.shape[0]:
        return winding_margin(which - 2 - p.elements.shape[0], w.there, x.stick, p)
    if which >= 2:
        return element_margin(which - 2, w.there, x.stick, p)
    return _margin_there(u * length, which, x, p, w)


@code.inner(**COMPILE)
def end_at_event(u, which, level, x, p, t, w):
    """End the step where the margin of friction or winding ``which`` is just spent, near its fraction
    ``u``; returns where.

    ``u`` comes from the cubic through the nodes; the solution itself corrects it.
    """
    enough = _spent_within(which, x, p, t, w)
    below, above = 0.0, 1.0
    last_u, last_e = 0.0, math.inf
    for _ in range(8):
        e = margin_within(u, which, level, x, p, t, w)
        if e < 0.0:
            above = u
        else:
            below = u
        if math.fabs(e) <= enough or above - below < 1e-9:
            break
        step = 1e-3 if e > 0.0 else -1e-3
        if math.isfinite(last_e) and last_e != e:
            step = e * (u - last_u) / (last_e - e)
        last_u, last_e = u, e
        u = _inside(u + step, below, above)
    return u
