"""The hot loop: what is linear in a drive is propagated exactly, and what is not enters as a polynomial.

Between two events a drive is nearly linear, if it is seen from its command: with the currents turned by the commanded electrical
angle and the angles counted from it, dx/dt = A x + r, with a matrix A that only depends on which bodies stick, and a deficit
r = f - A x that is left of the equations of motion f (``kernel.drive_derivative``): the sine of the electromagnetic spring beyond
its slope, detent torque, friction, transmission error, the supply's limit. However large r is, this is no approximation.

A step takes r as the cubic through its values at four nodes (Lobatto's: both ends are nodes). The states there are then

    x(c T) = E(c T) x(0) + sum over nodes j of K_j(c T) r_j,      E(t) = exp(A t),  K_j = integral of E(c T - t) l_j(t / T) dt

with l_j the cubic that is 1 at node j and 0 at the others; E and K come from tables (``tabulate``), for lengths T of the longest
step over powers of two. r depends on x, so the equation is iterated; that contracts, because A has taken what is stiff. The nodes
are the four lanes of a vector (``microvib.solve.vector``), so that f is evaluated at all of them at once. The highest Legendre
coefficient of r, over what a microstep moves, is the error estimate.

Wherever a step has to end, at a microstep or where a friction sticks or breaks away, its solution is taken there
(``_evaluate``): the propagators of shorter and shorter lengths lead to any instant of it. So an event costs no further step.

The modes of the array are no part of A, so that their number costs no more than their sum: they move as free oscillators, driven by
the cubic through the output's rate at the nodes, and their torque is a part of f.
"""

import math
from typing import NamedTuple

import numpy as np

from microvib.compiled import Cube, Matrix, Unit, Vector
from microvib.solve.kernel import (
    COMPILE, FORCED, IA, IB, IMPULSE, INLINE, LARGEST, MICROSTEPS, MISMATCH, MODES, N_CHANNELS, N_POWERS, NOT_FINITE, NOW, OK, POWERS,
    REF_A, REF_B, REJECTED, STEP_TOO_SMALL, STEPS, T_D, T_D_FORCE, THETA_E, TL, TM, WEIGHT, WL, WM, XA, XB, Drive, Samples, State,
    channels, decide_friction, drive_derivative, drive_margins, follow, health, margins, transmission_error,
)  # fmt: skip
from microvib.solve.vector import rows, sincos

code = Unit(__name__, "kernel.py", "vector.py", "vector_type.py", types="microvib.solve.vector_type")

LEVELS = 17
"""Lengths of steps: the longest over 2^0 ... 2^16."""
DEEPEST = 13
"""Level of the shortest step; deeper ones serve to end steps anywhere."""
PATTERNS = 4
N = MODES  # states of the drive itself
INPUTS = np.array([IA, IB, WM, WL, XA, XB])
"""States of which the derivative has a deficit; the last two only where the supply limits the voltage."""
NODE_ROWS, PIECE_ROWS, SUM_ROWS = N * N + N * 24, 2 * (N + 24), 8
# rows of a mode: by its eta and its w at the start, torque, momentum, eta, w; by the output's rate at each node, eta and w; then
# numbers for the end of a step: exp(A t) (2, 2); eta and w by the rate at each node; by the moments of the rate
M_TORQUE, M_MOMENTUM, M_ETA, M_W, M_ETA_BY, M_W_BY, M_E, M_ETA_END, M_W_END, M_ETA_PART, M_W_PART, MODE_ROWS = (
    0, 2, 4, 6, 8, 12, 16, 17, 18, 19, 20, 21,
)  # fmt: skip
ITERATIONS = 10
CONVERGED = 0.05
"""Last change of the deficits, over the accuracy, at which an iteration ends."""
GROW_BELOW = 0.02
"""Error, over the accuracy, below which the next step is twice as long: sixteen times less than the accuracy, and a margin."""

CUBES = np.array([0.0, 0.5 - math.sqrt(0.05), 0.5 + math.sqrt(0.05), 1.0])
"""Nodes of a step."""
LAGRANGE = np.linalg.inv(np.vander(CUBES, 4, increasing=True)).T.copy()
"""Coefficients of the cubics l_j, (node, power)."""
HIGHEST = np.array([1.0, -math.sqrt(5.0), math.sqrt(5.0), -1.0]) * -0.5
"""Weights of the highest Legendre coefficient of a cubic, by its values at the nodes."""


def _hermite() -> np.ndarray:
    """Coefficients of the polynomial of degree 7 with given values and slopes at the nodes, (power, 4 values and 4 slopes)."""
    powers = np.arange(8)
    values = CUBES[:, None] ** powers
    slopes = powers * CUBES[:, None] ** np.maximum(powers - 1, 0)
    return np.linalg.inv(np.vstack([values, slopes]))


HERMITE = _hermite()


class Propagators(NamedTuple):
    """Tables of one drive. Rows of four are the nodes of a step, unless said otherwise."""

    longest: float  # length of a step of level 0
    accuracy: float
    current: float  # holding current and its windup, from which those in x are counted
    windup: float
    inputs: int
    A: Cube  # (PATTERNS, N, N); pattern 1: output stuck, 2: rotor stuck
    per_size: Vector  # (6,), 1 / (what a microstep moves) of the states with deficits
    nodes: Matrix  # for each pattern and level E (N, N) and K (N, 6, 4)
    pieces: Matrix  # for each pattern and level the columns of E and of the moments (6, 4), in two rows of four each
    modes: Matrix  # for each level and mode the rows that M_... name
    sums: Matrix  # for each level, by the output's rate at each node: torque and momentum of all modes


class Moments(NamedTuple):
    """Propagators of dx/dt = A x + B r over some time, with r a polynomial of that time."""

    A: Matrix  # (n, n)
    B: Matrix  # (n, k)
    E: Matrix  # exp(A t)
    P: Cube  # (4, n, k): integrals of exp(A (t - t')) B (t' / t)^m / m!
    swap: Matrix
    power: Matrix


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
    sums: Matrix  # lanes: torque and momentum of the modes as free oscillators; torque; T_d; momentum; margins; change
    values: Matrix  # lanes: channels
    by_node: Matrix  # channels, (4, channels)
    cubic: Matrix  # coefficients of the deficits, (7, 4), the last of the output's rate
    poly: Vector  # coefficients of the momentum, (8,)
    weights: Matrix  # (2, 4)


FREE_TORQUE, FREE_MOMENTUM, TORQUE, TORQUE_D, MOMENTUM, MARGIN_M, MARGIN_L, CHANGE, N_SUMS = range(9)


# ---- Tables ----


@code.inner(**COMPILE)
def _start(m, T):
    """Fill ``E`` and ``P`` for a time ``T`` by Taylor's series of a short time, doubled."""
    A, B, E, P, swap, power = m
    n, k = B.shape
    norm = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += math.fabs(A[i, j])
        norm = max(norm, total * T)
    doublings, t = 0, T
    while norm > 0.25 and doublings < 1000:
        norm, t, doublings = 0.5 * norm, 0.5 * t, doublings + 1
    for i in range(n):
        for j in range(n):
            E[i, j] = power[i, j] = 1.0 if i == j else 0.0
    P[:] = 0.0
    factor = 1.0
    for order in range(14):  # ``power`` is (A t)^order, ``factor`` 1 / order!
        factorial = factor
        for m in range(4):
            factorial /= order + m + 1
            for i in range(n):
                for c in range(k):
                    for j in range(n):
                        P[m, i, c] += t * factorial * power[i, j] * B[j, c]
        factor /= order + 1
        for i in range(n):
            for j in range(n):
                swap[i, j] = 0.0
                for l in range(n):
                    swap[i, j] += power[i, l] * A[l, j] * t
        for i in range(n):
            for j in range(n):
                power[i, j] = swap[i, j]
                E[i, j] += factor * power[i, j]
    for _ in range(doublings):
        _double(E, P, swap)


@code.inner(**COMPILE)
def _double(E, P, swap):
    """Twice the time: exp(2 A t) = exp(A t)^2, and each integral over 2 t follows from those over t."""
    n, k = P.shape[1], P.shape[2]
    for m in range(3, -1, -1):  # the higher ones need the lower ones of before
        for c in range(k):
            for i in range(n):
                total, inverse = P[m, i, c], 1.0
                for lower in range(m - 1, -1, -1):
                    inverse /= m - lower
                    total += P[lower, i, c] * inverse
                for j in range(n):
                    total += E[i, j] * P[m, j, c]
                swap[i, 0] = total * 0.5**m
            for i in range(n):
                P[m, i, c] = swap[i, 0]
    for i in range(n):
        for j in range(n):
            swap[i, j] = 0.0
            for l in range(n):
                swap[i, j] += E[i, l] * E[l, j]
    for i in range(n):
        for j in range(n):
            E[i, j] = swap[i, j]


@code.inner(**COMPILE)
def _by_node(P, i, c, j, until):
    """Integral of the cubic that is 1 at node ``j``, up to the fraction ``until`` of a step over which ``P`` is."""
    total, factor = 0.0, 1.0
    for m in range(4):
        total += LAGRANGE[j, m] * factor * P[m, i, c]
        factor *= until * (m + 1)
    return total


@code.entry(**COMPILE)
def tabulate(t: Propagators, p: Drive, drive: Moments, mode: Moments) -> None:
    """Fill the tables of a drive whose ``A`` is known; ``drive`` and ``mode`` are scratch for N states and for 2."""
    shortest = t.longest * 0.5 ** (LEVELS - 1)
    for pattern in range(PATTERNS):
        for i in range(N):
            for j in range(N):
                drive.A[i, j] = t.A[pattern, i, j]
        drive.B[:] = 0.0
        for k in range(6):
            i = INPUTS[k]
            held = (i == WL and (p.rigid or pattern % 2 == 1)) or (i == WM and pattern >= 2)
            drive.B[i, k] = 0.0 if held else 1.0
        for node in range(4):
            _start(drive, CUBES[node] * shortest)
            for level in range(LEVELS - 1, -1, -1):
                if level < LEVELS - 1:
                    _double(drive.E, drive.P, drive.swap)
                _tabulate_drive(pattern * LEVELS + level, node, drive.E, drive.P, t)
    for k in range(p.H.size):
        H, D, Lam = p.H[k], p.D[k], p.Lam[k]
        mode.A[0, 0], mode.A[0, 1], mode.A[1, 0], mode.A[1, 1] = 0.0, 1.0, -Lam, -D
        mode.B[0, 0], mode.B[1, 0] = -H, D * H
        for node in range(4):
            _start(mode, CUBES[node] * shortest)
            for level in range(LEVELS - 1, -1, -1):
                if level < LEVELS - 1:
                    _double(mode.E, mode.P, mode.swap)
                _tabulate_mode(level, k, node, mode.E, mode.P, t, p)


@code.inner(**COMPILE)
def _tabulate_drive(block, node, E, P, t):
    """Entries of a pattern and level for one node, which is also the end for node 3."""
    nodes, pieces = block * NODE_ROWS, block * PIECE_ROWS
    for i in range(N):
        for j in range(N):
            t.nodes[nodes + N * i + j, node] = E[i, j]
        for k in range(6):
            for j in range(4):
                t.nodes[nodes + N * N + 24 * i + 4 * k + j, node] = _by_node(P, i, k, j, CUBES[node])
    if node == 3:
        for i in range(N):
            half, lane = i // 4, i % 4
            for j in range(N):
                t.pieces[pieces + 2 * j + half, lane] = E[i, j]
            for k in range(6):
                factor = 1.0
                for m in range(4):
                    t.pieces[pieces + 2 * (N + 4 * k + m) + half, lane] = factor * P[m, i, k]
                    factor *= m + 1


@code.inner(**COMPILE)
def _tabulate_mode(level, k, node, E, P, t, p):
    """Entries of a level and mode for one node."""
    H, D, Lam = p.H[k], p.D[k], p.Lam[k]
    row, total = (level * p.H.size + k) * MODE_ROWS, level * SUM_ROWS
    for j in range(2):
        t.modes[row + M_TORQUE + j, node] = H * (Lam * E[0, j] + D * E[1, j])
        t.modes[row + M_MOMENTUM + j, node] = H * E[1, j]
        t.modes[row + M_ETA + j, node] = E[0, j]
        t.modes[row + M_W + j, node] = E[1, j]
    for j in range(4):
        eta, w = _by_node(P, 0, 0, j, CUBES[node]), _by_node(P, 1, 0, j, CUBES[node])
        t.modes[row + M_ETA_BY + j, node] = eta
        t.modes[row + M_W_BY + j, node] = w
        t.sums[total + j, node] += H * (Lam * eta + D * (w - (H if j == node else 0.0)))
        t.sums[total + 4 + j, node] += H * w
        if node == 3:
            t.modes[row + M_ETA_END, j], t.modes[row + M_W_END, j] = eta, w
    if node == 3:
        factor = 1.0
        for m in range(4):
            t.modes[row + M_ETA_PART, m], t.modes[row + M_W_PART, m] = factor * P[m, 0, 0], factor * P[m, 1, 0]
            factor *= m + 1
        for j in range(2):
            t.modes[row + M_E, j], t.modes[row + M_E, 2 + j] = E[0, j], E[1, j]


# ---- The frame of the command ----


@code.inner(**INLINE)
def _see(x, p, t, w):
    """The drive's state as seen from its command, into ``w.x``; a windup or current of the holding drive is 0 there."""
    s, c = sincos(x.clock[THETA_E])
    y, angle = x.y, x.clock[THETA_E] / p.z
    w.x[IA], w.x[IB] = y[IA] * c + y[IB] * s - t.current, y[IB] * c - y[IA] * s
    w.x[XA], w.x[XB] = y[XA] * c + y[XB] * s - t.windup, y[XB] * c - y[XA] * s
    w.x[TM], w.x[WM], w.x[TL], w.x[WL] = y[TM] - angle, y[WM], y[TL] + angle * p.inv_h, y[WL]
    return s, c


@code.inner(**INLINE)
def _unsee(v, y, x, p, t):
    """The drive's state ``y`` from ``v``, as seen from its command; the angle of what sticks stays what it was, to the last bit."""
    s, c = sincos(x.clock[THETA_E])
    i_d, x_d, angle = v[IA] + t.current, v[XA] + t.windup, x.clock[THETA_E] / p.z
    y[IA], y[IB] = i_d * c - v[IB] * s, v[IB] * c + i_d * s
    y[XA], y[XB] = x_d * c - v[XB] * s, v[XB] * c + x_d * s
    y[TM] = x.y[TM] if x.stick[0] == 0.0 else v[TM] + angle
    y[TL] = x.y[TL] if x.stick[1] == 0.0 else v[TL] - angle * p.inv_h
    y[WM], y[WL] = v[WM], v[WL]
    follow(y, p)


@code.inner(**INLINE)
def _pattern(stick, p):
    """Which bodies stick."""
    return (2 if stick[0] == 0.0 else 0) + (1 if stick[1] == 0.0 and not p.rigid else 0)


# ---- One step ----


@code.inner(**INLINE)
def _lanes(w):
    """The matrices of lanes as such."""
    return (
        rows(w.free, 0, N, 1), rows(w.at, 0, N, 1), rows(w.y, 0, w.y.shape[0], 1), rows(w.f, 0, w.f.shape[0], 1),
        rows(w.q, 0, 7, 1), rows(w.r, 0, 6, 1), rows(w.sums, 0, N_SUMS, 1),
    )  # fmt: skip


@code.inner(**FORCED)
def _evaluate_deficits(s, c, x, p, t, w, modal, A):
    """States at the nodes not seen from the command, the derivative there, and the deficits ``w.r``."""
    _, at, y, f, q, r, sums = _lanes(w)
    i_d, x_d, angle = at[IA] + t.current, at[XA] + t.windup, x.clock[THETA_E] / p.z
    y[IA], y[IB] = i_d * c - at[IB] * s, at[IB] * c + i_d * s
    y[XA], y[XB] = x_d * c - at[XB] * s, at[XB] * c + x_d * s
    y[TM], y[WM], y[TL], y[WL] = at[TM] + angle, at[WM], at[TL] - angle * p.inv_h, at[WL]
    drive_derivative(y, modal, x.clock, x.stick, p, f, q)
    sums[TORQUE] = modal
    for k in range(t.inputs):
        i = INPUTS[k]
        if k == 0:
            total = f[IA] * c + f[IB] * s
        elif k == 1:
            total = f[IB] * c - f[IA] * s
        elif k == 4:
            total = f[XA] * c + f[XB] * s
        elif k == 5:
            total = f[XB] * c - f[XA] * s
        else:
            total = f[i]
        for j in range(N):
            total -= A[i, j] * at[j]
        r[k] = total


@code.inner(**FORCED)
def _free_modes(level, x, p, t, w):
    """Torque and momentum of the modes as free oscillators."""
    sums, modes = rows(w.sums, 0, N_SUMS, 1), rows(t.modes, level * p.H.size * MODE_ROWS, p.H.size * MODE_ROWS, MODE_ROWS)
    torque = momentum = sums[CHANGE] * 0.0
    for k in range(p.H.size):
        eta, rate = x.y[MODES + 2 * k], x.y[MODES + 2 * k + 1]
        torque += modes[k, M_TORQUE] * eta + modes[k, M_TORQUE + 1] * rate
        momentum += modes[k, M_MOMENTUM] * eta + modes[k, M_MOMENTUM + 1] * rate
    sums[FREE_TORQUE], sums[FREE_MOMENTUM] = torque, momentum


@code.inner(**FORCED)
def _iterate(level, s, c, x, p, t, w):
    """Solve the step's equation from the deficits in ``w.r``; the last change of the deficits, over what a microstep moves."""
    free, at, _, _, _, r, sums = _lanes(w)
    pattern, T = _pattern(x.stick, p), t.longest * 0.5**level
    A, block = t.A[pattern], (pattern * LEVELS + level) * NODE_ROWS
    E, K = rows(t.nodes, block, N * N, N), rows(t.nodes, block + N * N, 24 * N, 24)
    coupling = rows(t.sums, level * SUM_ROWS, SUM_ROWS, 1)
    for i in range(N):
        total = E[i, 0] * w.x[0]
        for j in range(1, N):
            total += E[i, j] * w.x[j]
        free[i] = total
    _free_modes(level, x, p, t, w)
    before = math.inf
    for _ in range(ITERATIONS):
        for i in range(N):
            total = free[i]
            for k in range(t.inputs):
                for j in range(4):
                    total += K[i, 4 * k + j] * w.r[k, j]
            at[i] = total
        if p.rigid:
            _, e1, _, _ = transmission_error(at[TM] + x.clock[THETA_E] / p.z, p.te)
            at[WL] = (e1 - p.inv_h) * at[WM]
        modal = sums[FREE_TORQUE]
        for j in range(4):
            modal += coupling[j] * w.at[WL, j]
        for k in range(t.inputs):
            for j in range(4):
                w.cubic[k, j] = w.r[k, j]
        _evaluate_deficits(s, c, x, p, t, w, modal, A)
        change = 0.0
        for k in range(t.inputs):
            size = T * t.per_size[k]
            for j in range(4):
                change = max(change, math.fabs(w.r[k, j] - w.cubic[k, j]) * size)
        if not change > CONVERGED * t.accuracy or not change < 0.9 * before:
            break
        before = change
    return change


@code.inner(**INLINE)
def _error(level, t, w):
    """The highest Legendre coefficient of the deficits, over what a microstep moves."""
    error = 0.0
    for k in range(t.inputs):
        total = 0.0
        for j in range(4):
            total += HIGHEST[j] * w.r[k, j]
        error = max(error, math.fabs(total) * t.per_size[k])
    return error * t.longest * 0.5**level


@code.inner(**FORCED)
def _begin(s, c, x, p, t, w):
    """Deficits at the start of a step, taken for all of it."""
    _, at, _, _, _, _, sums = _lanes(w)
    modal = sums[CHANGE] * 0.0
    total = 0.0
    rate = w.x[WL]
    if p.rigid:
        _, e1, _, _ = transmission_error(w.x[TM] + x.clock[THETA_E] / p.z, p.te)
        rate = (e1 - p.inv_h) * w.x[WM]
    for k in range(p.H.size):
        total += p.H[k] * (p.D[k] * (x.y[MODES + 2 * k + 1] - p.H[k] * rate) + p.Lam[k] * x.y[MODES + 2 * k])
    for i in range(N):
        at[i] = modal + w.x[i]
    _evaluate_deficits(s, c, x, p, t, w, modal + total, t.A[_pattern(x.stick, p)])


@code.inner(**FORCED)
def _judge(p, x, w):
    """Margins of both frictions, momentum and disturbance torque at the nodes."""
    _, at, y, f, q, _, sums = _lanes(w)
    sums[MARGIN_M], sums[MARGIN_L] = drive_margins(y, sums[TORQUE], x.stick, p)
    sums[TORQUE_D] = sums[TORQUE] - p.J_L * q[6] - p.J_m * f[WM]


@code.inner(**FORCED)
def _momentum(level, p, t, w):
    """Momentum at the nodes, and the polynomial of degree 7 through it and the torque, into ``w.poly``."""
    at, sums = rows(w.at, 0, N, 1), rows(w.sums, 0, N_SUMS, 1)
    coupling = rows(t.sums, level * SUM_ROWS, SUM_ROWS, 1)
    total = p.J_m * at[WM] + p.J_L * at[WL] + sums[FREE_MOMENTUM]
    for j in range(4):
        total += coupling[4 + j] * w.at[WL, j]
    sums[MOMENTUM] = total
    T = t.longest * 0.5**level
    for m in range(8):
        value = 0.0
        for j in range(4):
            value += HERMITE[m, j] * w.sums[MOMENTUM, j] - HERMITE[m, 4 + j] * T * w.sums[TORQUE_D, j]
        w.poly[m] = value


# ---- Ends of steps ----


@code.inner(**COMPILE)
def _first_root(values, until):
    """First fraction of the step, up to ``until``, where the cubic through ``values`` at the nodes falls below zero; else 2."""
    node = 1
    while node < 4 and values[node] >= 0.0:
        node += 1
    if node == 4 or CUBES[node - 1] >= until:
        return 2.0
    lo, hi = CUBES[node - 1], CUBES[node]
    if values[node - 1] < 0.0:
        return lo
    c0 = c1 = c2 = c3 = 0.0
    for j in range(4):
        c0 += LAGRANGE[j, 0] * values[j]
        c1 += LAGRANGE[j, 1] * values[j]
        c2 += LAGRANGE[j, 2] * values[j]
        c3 += LAGRANGE[j, 3] * values[j]
    u = lo + (hi - lo) * values[node - 1] / (values[node - 1] - values[node])
    for _ in range(60):
        value, slope = c0 + u * (c1 + u * (c2 + u * c3)), c1 + u * (2.0 * c2 + u * 3.0 * c3)
        if value < 0.0:
            hi = u
        else:
            lo = u
        following = u - value / slope if slope < 0.0 else 0.5 * (lo + hi)
        if not lo < following < hi:
            following = 0.5 * (lo + hi)
        if math.fabs(following - u) < 1e-12:
            break
        u = following
    return u if u < until else 2.0


@code.inner(**COMPILE)
def _evaluate(u, level, x, p, t, w):
    """The step's solution at its fraction ``u``: the drive into ``w.end``, the modes into ``w.modes``."""
    pattern, inputs = _pattern(x.stick, p), t.inputs
    cubic, values, end = w.cubic, w.r, w.end
    for k in range(inputs + 1):
        for m in range(4):
            total = 0.0
            for j in range(4):
                total += LAGRANGE[j, m] * (values[k, j] if k < inputs else w.at[WL, j])
            cubic[k, m] = total
    for i in range(N):
        end[i] = w.x[i]
    for j in range(w.modes.size):
        w.modes[j] = x.y[MODES + j]
    for deeper in range(level + 1, LEVELS):
        u *= 2.0
        for k in range(inputs + 1):
            cubic[k, 1] *= 0.5
            cubic[k, 2] *= 0.25
            cubic[k, 3] *= 0.125
        if u >= 1.0:
            u -= 1.0
            _pass(deeper, pattern, p, t, w)
    dt = u * t.longest * 0.5 ** (LEVELS - 1)
    for i in range(N):
        total = 0.0
        for j in range(N):
            total += t.A[pattern, i, j] * end[j]
        w.poly[i] = total
    for k in range(inputs):
        w.poly[INPUTS[k]] += cubic[k, 0]
    for k in range(p.H.size):
        rate = w.modes[2 * k + 1] - p.H[k] * cubic[inputs, 0]
        pull = p.D[k] * rate + p.Lam[k] * w.modes[2 * k]
        w.modes[2 * k] += dt * rate
        w.modes[2 * k + 1] -= dt * pull
    for i in range(N):
        end[i] += dt * w.poly[i]
    if x.stick[0] == 0.0:
        end[TM], end[WM] = w.x[TM], 0.0
    if x.stick[1] == 0.0:
        end[TL], end[WL] = w.x[TL], 0.0


@code.inner(**FORCED)
def _pass(level, pattern, p, t, w):
    """Move ``w.end`` and ``w.modes`` on by the length of a level, and the deficits' cubics with them."""
    cubic, end, inputs = w.cubic, w.end, t.inputs
    block = rows(t.pieces, (pattern * LEVELS + level) * PIECE_ROWS, PIECE_ROWS, 2)
    upper, lower = block[0, 0] * end[0], block[0, 1] * end[0]
    for j in range(1, N):
        upper += block[j, 0] * end[j]
        lower += block[j, 1] * end[j]
    for k in range(inputs):
        for m in range(4):
            upper += block[N + 4 * k + m, 0] * cubic[k, m]
            lower += block[N + 4 * k + m, 1] * cubic[k, m]
    halves = rows(w.weights, 0, 2, 1)
    halves[0], halves[1] = upper, lower
    for i in range(N):
        end[i] = w.weights[i // 4, i % 4]
    modes, s = t.modes, p.H.size
    for k in range(s):
        row = (level * s + k) * MODE_ROWS
        eta, rate = w.modes[2 * k], w.modes[2 * k + 1]
        after_eta = modes[row + M_E, 0] * eta + modes[row + M_E, 1] * rate
        after_rate = modes[row + M_E, 2] * eta + modes[row + M_E, 3] * rate
        for m in range(4):
            after_eta += modes[row + M_ETA_PART, m] * cubic[inputs, m]
            after_rate += modes[row + M_W_PART, m] * cubic[inputs, m]
        w.modes[2 * k], w.modes[2 * k + 1] = after_eta, after_rate
    for k in range(inputs + 1):  # about the end of the piece
        c1, c2, c3 = cubic[k, 1], cubic[k, 2], cubic[k, 3]
        cubic[k, 0] += c1 + c2 + c3
        cubic[k, 1] = c1 + 2.0 * c2 + 3.0 * c3
        cubic[k, 2] = c2 + 3.0 * c3


@code.inner(**FORCED)
def _whole(level, p, x, t, w):
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
        w.modes[2 * k], w.modes[2 * k + 1] = after_eta, after_rate


@code.inner(**COMPILE)
def _end_at_event(u, which, level, x, p, t, w):
    """End the step where the margin of friction ``which`` is just spent, near its fraction ``u``; returns where.

    ``u`` comes from the cubic through the nodes; the solution itself corrects it.
    """
    scale = t.per_size[2 if which == 0 else 3]
    limit = (p.m_slide + p.m_stribeck) + (p.l_slide + p.l_stribeck)
    enough = 1e-4 * t.accuracy / scale if x.stick[which] != 0.0 else 1e-8 * limit
    below, above = 0.0, 1.0
    last_u, last_e = 0.0, math.inf
    for _ in range(8):
        _evaluate(u, level, x, p, t, w)
        _unsee(w.end, w.there, x, p, t)
        for j in range(w.modes.size):
            w.there[MODES + j] = w.modes[j]
        e = margins(w.there, x.stick, p)[which]
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
        following = u + step
        u = following if below < following < above else 0.5 * (below + above)
    return u


# ---- Samples ----


@code.inner(**FORCED)
def _channels_at_nodes(level, x, p, t, w):
    """All channels at the nodes, by node."""
    _, at, y, f, q, _, _ = _lanes(w)
    modes = rows(t.modes, level * p.H.size * MODE_ROWS, p.H.size * MODE_ROWS, MODE_ROWS)
    for k in range(p.H.size):
        eta, rate = x.y[MODES + 2 * k], x.y[MODES + 2 * k + 1]
        there_eta = modes[k, M_ETA] * eta + modes[k, M_ETA + 1] * rate
        there_w = modes[k, M_W] * eta + modes[k, M_W + 1] * rate
        for j in range(4):
            there_eta += modes[k, M_ETA_BY + j] * w.at[WL, j]
            there_w += modes[k, M_W_BY + j] * w.at[WL, j]
        y[MODES + 2 * k], y[MODES + 2 * k + 1] = there_eta, there_w
    channels(y, x.clock, x.stick, p, f, q, rows(w.values, 0, w.values.shape[0], 1))
    for k in range(w.values.shape[0]):
        for j in range(4):
            w.by_node[j, k] = w.values[k, j]


@code.inner(**INLINE)
def _weights(u, out):
    """Integrals of the four cubics l_j from 0 to ``u``."""
    for j in range(4):
        l0, l1, l2, l3 = LAGRANGE[j, 0], LAGRANGE[j, 1], LAGRANGE[j, 2], LAGRANGE[j, 3]
        out[j] = u * (l0 + u * (l1 / 2.0 + u * (l2 / 3.0 + u * l3 / 4.0)))


@code.inner(**INLINE)
def _momentum_at(u, poly):
    """Momentum at the fraction ``u`` of the step."""
    total = poly[7]
    for m in range(6, -1, -1):
        total = total * u + poly[m]
    return total


@code.inner(**COMPILE)
def _record(u, end, level, x, p, t, w, out):
    """Integrate the channels over the step to the time ``end``, its fraction ``u``; close every sample interval that ends inside.

    A sample is the mean over its interval. The torque's is that of the change of momentum; where ``out`` has two columns, only
    the torque and the output's stick are recorded. Steps end at events, so jumps are averaged exactly, not sampled.
    """
    clock, cursor, partial = x.clock, out.cursor, out.partial
    T, all_channels = t.longest * 0.5**level, out.rows.shape[1] > 2
    torque = T_D if all_channels else 0
    if all_channels:
        _channels_at_nodes(level, x, p, t, w)
        _weights(u, w.weights[0])
        for j in range(4):
            values = w.by_node[j]
            for k in range(N_POWERS):
                x.energy[k] += T * w.weights[0, j] * values[POWERS + k]
            clock[IMPULSE] += T * w.weights[0, j] * values[T_D_FORCE]
            clock[MISMATCH] = max(clock[MISMATCH], math.fabs(values[T_D] - values[T_D_FORCE]))
            clock[LARGEST] = max(clock[LARGEST], math.fabs(values[T_D]))
    if end <= out.first:
        return
    start = a = clock[NOW]
    L_a, u_a = _momentum_at(0.0, w.poly), 0.0
    before, after = w.weights[0], w.weights[1]
    before[:] = 0.0
    stuck = 1.0 if (x.stick[0] if p.rigid else x.stick[1]) == 0.0 else 0.0
    while a < end:
        recording = cursor[0] < out.rows.shape[0]
        inside = recording and a >= out.first
        boundary = out.first + (cursor[0] + cursor[1] + 1) * out.width if inside else out.first
        reaches = recording and boundary <= end + 1e-6 * out.width  # the last digits of two sums may differ
        b = min(boundary, end) if reaches else end
        u_b = u if b == end else (b - start) / T
        L_b = _momentum_at(u_b, w.poly)
        if all_channels:
            _weights(u_b, after)
        if inside:
            clock[WEIGHT] += b - a
            if all_channels:
                w0, w1, w2, w3 = T * (after[0] - before[0]), T * (after[1] - before[1]), T * (after[2] - before[2]), T * (after[3] - before[3])
                n0, n1, n2, n3 = w.by_node[0], w.by_node[1], w.by_node[2], w.by_node[3]
                kept = partial[T_D]
                for k in range(partial.size):
                    partial[k] += w0 * n0[k] + w1 * n1[k] + w2 * n2[k] + w3 * n3[k]
                partial[T_D] = kept
            else:
                partial[1] += (b - a) * stuck
            partial[torque] += L_a - L_b
        if reaches and inside:
            row = out.rows[cursor[0]]
            inverse = 1.0 / clock[WEIGHT]  # not the width: late in a run it is rounded
            for k in range(partial.size):
                row[k] = partial[k] * inverse
                partial[k] = 0.0
            clock[WEIGHT] = 0.0
            if all_channels:
                _weights(u, w.cubic[0])
                for k in range(N_POWERS):  # energies: their values at the middle of the interval
                    rest = 0.0
                    for j in range(4):
                        rest += T * (w.cubic[0, j] - after[j]) * w.by_node[j, POWERS + k]
                    row[POWERS + k] = x.energy[k] - rest - 0.5 * out.width * row[POWERS + k]
            cursor[0] += 1
        before, after = after, before
        a, L_a, u_a = b, L_b, u_b


# ---- The loop ----

# Kinds of a step, by which the level of the last one of its kind is remembered: the first after a microstep, after an event,
# any other; for each pattern
AFTER_MICROSTEP, AFTER_EVENT, FURTHER, KINDS = range(4)


@code.entry(**COMPILE)
def advance(
    stop: float, x: State, p: Drive, t: Propagators, out: Samples, steps_t: Vector, steps_ref: Matrix, lanes: Matrix, room: Vector
) -> int:
    """Advance the drive ``p`` to the time ``stop``; state ``x`` and samples ``out`` are updated in place.

    Each turn of the loop either takes a microstep that is due, or one step: shortened until its iteration converges and its error
    estimate passes, and ended at the next microstep or at the first friction event inside it.

    ``steps_t`` (n,) are the times of the microsteps before ``stop``, ``steps_ref`` (n, 3) the references i_A*, i_B* and the
    electrical angle after each; ``lanes`` (``lane_rows``, 4) and ``room`` (``room_size``,) scratch. Returns a status code.
    """
    n, modes = x.y.size, x.y.size - MODES
    count = N_CHANNELS + modes
    w = Work(
        room[:N], room[N : 2 * N], room[2 * N : 2 * N + modes], room[2 * N + modes : 2 * N + modes + n],
        lanes[:8], lanes[8:16], lanes[16 : 16 + n], lanes[16 + n : 16 + 2 * n], lanes[16 + 2 * n : 23 + 2 * n],
        lanes[23 + 2 * n : 29 + 2 * n], lanes[29 + 2 * n : 29 + 2 * n + N_SUMS], lanes[40 + 2 * n : 40 + 2 * n + count],
        lanes[40 + 2 * n + count : 40 + 2 * n + 2 * count].reshape(4, count), lanes[40 + 2 * n + 2 * count : 47 + 2 * n + 2 * count],
        room[2 * N + modes + n : 2 * N + modes + n + 8], lanes[47 + 2 * n + 2 * count : 49 + 2 * n + 2 * count],
    )  # fmt: skip
    clock, coming, stalled, status = x.clock, 0, 0, OK
    s, c = _see(x, p, t, w)
    kind = FURTHER
    while clock[NOW] < stop:
        target = stop
        if coming < steps_t.size and steps_t[coming] < stop:
            target = steps_t[coming]
        if target <= clock[NOW]:
            _unsee(w.x, x.y, x, p, t)
            clock[REF_A], clock[REF_B], clock[THETA_E] = (
                steps_ref[coming, 0],
                steps_ref[coming, 1],
                steps_ref[coming, 2],
            )
            coming += 1
            x.counters[MICROSTEPS] += 1
            s, c = _see(x, p, t, w)
            kind = AFTER_MICROSTEP
            continue
        left = target - clock[NOW]
        pattern = _pattern(x.stick, p)
        remembered = x.levels[kind * PATTERNS + pattern]
        level = remembered
        while level < DEEPEST and t.longest * 0.5 ** (level + 1) >= left:
            level += 1
        _begin(s, c, x, p, t, w)
        while True:
            change = _iterate(level, s, c, x, p, t, w)
            error = _error(level, t, w)
            if change <= CONVERGED * t.accuracy and error <= t.accuracy:
                break
            x.counters[REJECTED] += 1
            if level >= DEEPEST:
                status = STEP_TOO_SMALL if math.isfinite(change) and math.isfinite(error) else NOT_FINITE
                break
            level += 1
            remembered = level
            _begin(s, c, x, p, t, w)
        if status != OK:
            break
        following = FURTHER * PATTERNS + pattern
        if error < GROW_BELOW * t.accuracy:
            x.levels[kind * PATTERNS + pattern] = max(min(remembered, level) - 1, 0)
            x.levels[following] = max(level - 1, 0)
        else:
            x.levels[kind * PATTERNS + pattern] = remembered
            x.levels[following] = level
        T = t.longest * 0.5**level
        u, event = 1.0, -1
        if T > left * (1.0 + 1e-12):
            u = left / T
        _judge(p, x, w)
        root_m, root_l = _first_root(w.sums[MARGIN_M], u), _first_root(w.sums[MARGIN_L], u)
        whole = u == 1.0
        if min(root_m, root_l) < 1.0 or (min(root_m, root_l) <= u):
            event = 0 if root_m < root_l else 1
            found = _end_at_event(min(root_m, root_l), event, level, x, p, t, w)
            end = clock[NOW] + found * T
            u = found
        elif whole:
            _whole(level, p, x, t, w)
            end = target if math.fabs(T - left) <= 1e-12 * left else clock[NOW] + T
        else:
            _evaluate(u, level, x, p, t, w)
            end = target
        if out.width > 0.0:
            _momentum(level, p, t, w)
            _record(u, end, level, x, p, t, w, out)
        x.counters[STEPS] += 1
        lasted = end - clock[NOW]
        clock[NOW] = end
        for j in range(N):
            w.x[j] = w.end[j]
        for j in range(modes):
            x.y[MODES + j] = w.modes[j]
        kind = FURTHER
        if event >= 0:
            for j in range(N):
                x.y[j] = w.there[j]
            decide_friction(event, x, p)
            follow(x.y, p)
            s, c = _see(x, p, t, w)
            kind = AFTER_EVENT
        status, stalled = health(p.z * w.x[TM], lasted, clock[NOW], stalled)
        if status != OK:
            break
    _unsee(w.x, x.y, x, p, t)
    return status
