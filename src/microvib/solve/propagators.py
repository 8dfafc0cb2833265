"""Linear part of a drive, as tables of its exact propagators: x(t) = E(t) x(0) + integrals of E
with polynomials.

``microvib.solve.collocation`` says what they are for. Their lengths are the longest step over
powers of two, made from the shortest by doubling.
"""

import math
from typing import NamedTuple

import numpy as np

from microvib.compiled import Cube, Matrix, Unit, Vector
from microvib.solve.kernel import (
    COMPILE,
    HARNESS,
    IA,
    IB,
    INLINE,
    MODES,
    TL,
    TM,
    WL,
    WM,
    XA,
    XB,
    Drive,
    State,
    body_of,
    drive_derivative,
    references_after,
)  # fmt: skip
from microvib.solve.nodes import CUBES, LAGRANGE

code = Unit(__name__, "kernel.py", "nodes.py")

MOST_LEVELS = 40
"""Lengths of steps: the longest over powers of two, at most so many, until what is linear changes
little over the shortest.
"""
PATTERNS = 4
N = MODES  # states of the drive itself
INPUTS = np.array([IA, IB, WM, WL, XA, XB])
"""States of which the derivative has a deficit; the last two only where the supply limits the
voltage, or where they are currents of switched windings.
"""
NODE_ROWS, PIECE_ROWS, SUM_ROWS = (N + 24) * N, 2 * (N + 24), 20
# rows of the sums over modes, four each: by the output's rate at each node, torque on it and
# momentum; on a craft also torque on the rotor (which is that on the output by the rotor's rate);
# by the rotor's rate, torque on it and momentum
S_OUTPUT, S_MOMENTUM, S_BOTH, S_ROTOR, S_ROTOR_MOMENTUM = 0, 4, 8, 12, 16
# rows of a mode: by its eta and its w at the start, torque, momentum, exp(A t) (2, 2) for the end
# of a step, eta, w; by the rate of the output at each node, or by the moments of it, eta and w at
# the end of a step; at each node by that rate. On a craft the same BY_ROTOR rows further on by the
# rotor's rate; and torque on the rotor by eta and w.
M_TORQUE, M_MOMENTUM, M_E, M_ETA, M_W, M_ETA_END, M_W_END, M_ETA_PART, M_W_PART, M_ETA_BY, M_W_BY = (
    0, 2, 4, 5, 7, 9, 10, 11, 12, 13, 17,
)  # fmt: skip
BY_ROTOR, M_ON_ROTOR, MODE_ROWS = 12, 33, 35
ITERATIONS = 10
CONVERGED = 0.1
"""Last change of the deficits, over the accuracy, at which an iteration ends."""
GROW_BELOW = 0.05
"""Error, over the accuracy, below which the next step is twice as long: sixteen times less than the
accuracy, and a margin.
"""


class Propagators(NamedTuple):
    """Tables of one drive. Rows of four are the nodes of a step, unless said otherwise."""

    longest: float  # length of a step of level 0
    accuracy: float
    current: float  # holding current and its windup, from which those in x are counted
    windup: float
    inputs: int
    levels: int
    A: Cube  # (PATTERNS, N, N); pattern 1: output stuck, 2: rotor stuck
    columns: Matrix  # its columns, in two rows of four each
    per_size: Vector  # (6,), 1 / (what a microstep moves) of the states with deficits
    # the same near a stop: of rotor and output at most the rate within which friction falls
    per_layer: Vector
    nodes: Matrix  # for each pattern and level the columns of E and of K (6, 4), N rows each
    # for each pattern and level the columns of E and of the moments (6, 4), in two rows of four
    # each
    pieces: Matrix
    modes: Matrix  # for each level and mode the rows that M_... name
    sums: Matrix  # for each level the rows that S_... name
    # (16, 4): coefficients of the momentum's polynomial by its values and slopes, two rows each
    momentum: Matrix
    onwards: Matrix  # (16, 4): deficits at the nodes of another step
    fractions: Matrix  # (1, 4): where in a step the nodes are
    # (4, 4): by powers of a fraction of a step, from the first on, integrals of the cubics l_j up
    # to there
    integrals: Matrix


class Moments(NamedTuple):
    """Propagators of dx/dt = A x + B r over some time, with r a polynomial of that time."""

    A: Matrix  # (n, n)
    B: Matrix  # (n, k)
    E: Matrix  # exp(A t) - 1
    P: Cube  # (4, n, k): integrals of exp(A (t - t')) B (t' / t)^m / m!
    swap: Matrix
    power: Matrix


@code.inner(**COMPILE)
def _largest_row_sum(A, T):
    """The largest sum of the magnitudes in a row of ``A``, times ``T``."""
    norm = 0.0
    for i in range(A.shape[0]):
        total = 0.0
        for j in range(A.shape[1]):
            total += math.fabs(A[i, j])
        norm = max(norm, total * T)
    return norm


@code.inner(**COMPILE)
def _multiply_power(A, t, swap, power):
    """``power`` times ``A t``, in place."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            swap[i, j] = 0.0
            for q in range(n):
                swap[i, j] += power[i, q] * A[q, j] * t
    for i in range(n):
        for j in range(n):
            power[i, j] = swap[i, j]


@code.inner(**COMPILE)
def _add_integrals(order, factor, t, B, power, P):
    """Add the term of an order of Taylor's series to the integrals ``P``."""
    n, k = B.shape
    factorial = factor
    for m in range(4):
        factorial /= order + m + 1
        for i in range(n):
            for c in range(k):
                for j in range(n):
                    P[m, i, c] += t * factorial * power[i, j] * B[j, c]


@code.inner(**COMPILE)
def _start(m, T):
    """Fill ``E`` and ``P`` for a time ``T`` by Taylor's series of a short time, doubled."""
    A, B, E, P, swap, power = m
    n = B.shape[0]
    norm = _largest_row_sum(A, T)
    doublings, t = 0, T
    while norm > 0.25 and doublings < 1000:
        norm, t, doublings = 0.5 * norm, 0.5 * t, doublings + 1
    for i in range(n):
        for j in range(n):
            power[i, j], E[i, j] = (1.0 if i == j else 0.0), 0.0
    P[:] = 0.0
    factor = 1.0
    for order in range(14):  # ``power`` is (A t)^order, ``factor`` 1 / order!
        _add_integrals(order, factor, t, B, power, P)
        factor /= order + 1
        _multiply_power(A, t, swap, power)
        for i in range(n):
            for j in range(n):
                E[i, j] += factor * power[i, j]
    for _ in range(doublings):
        _double(E, P, swap)


@code.inner(**COMPILE)
def _double(E, P, swap):
    """Twice the time: exp(2 A t) = exp(A t)^2, and each integral over 2 t follows from those over
    t.

    ``E`` is exp(A t) - 1, so that what changes little over a short time is not lost in rounding.
    """
    n, k = P.shape[1], P.shape[2]
    for m in range(3, -1, -1):  # the higher ones need the lower ones of before
        for c in range(k):
            for i in range(n):
                total, inverse = 2.0 * P[m, i, c], 1.0
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
            swap[i, j] = 2.0 * E[i, j]
            for q in range(n):
                swap[i, j] += E[i, q] * E[q, j]
    for i in range(n):
        for j in range(n):
            E[i, j] = swap[i, j]


@code.inner(**COMPILE)
def _by_node(P, i, c, j, until):
    """Integral of the cubic that is 1 at node ``j``, up to the fraction ``until`` of a step over
    which ``P`` is.
    """
    total, factor = 0.0, 1.0
    for m in range(4):
        total += LAGRANGE[j, m] * factor * P[m, i, c]
        factor *= until * (m + 1)
    return total


@code.inner(**INLINE)
def occurs(pattern, p):
    """Whether friction can make this pattern of sticking bodies."""
    on_rotor, on_output = p.m_slide + p.m_stribeck > 0.0, p.l_slide + p.l_stribeck > 0.0
    if p.rigid:
        return pattern == 0 or (pattern == 2 and (on_rotor or on_output))
    return (pattern < 2 or on_rotor) and (pattern % 2 == 0 or on_output)


@code.inner(**INLINE)
def holds(pattern, p):
    """Whether rotor and output stand still in a pattern; with elements a body moves on their
    springs.
    """
    return pattern >= 2 and (p.m_elements == 0 or p.rigid), pattern % 2 == 1 and p.l_elements == 0


@code.entry(**COMPILE)
def linear_part(
    x: State, p: Drive, modes: Drive, steps: Vector, A: Cube, up: Vector, down: Vector, q: Vector
) -> None:
    """Derivative of the equations of motion by the state, at rest, for each pattern of what sticks,
    by differences.

    ``p`` is without what is not linear, ``modes`` the drive with its modes. Errors of differences
    do not matter: what A lacks is a deficit. The rest is scratch.
    """
    references = references_after(0.0, x.clock)
    for pattern in range(PATTERNS):
        holds_m, holds_l = holds(pattern, p)
        x.stick[0], x.stick[1] = (0.0 if holds_m else 1.0), (0.0 if holds_l else 1.0)
        for e in range(p.elements.shape[0]):
            body = body_of(e, p)
            x.stick[2 + e] = (
                0.0
                if body == 2
                or body == HARNESS
                or (body == 0 and pattern >= 2)
                or (body == 1 and pattern % 2 == 1)
                else 1.0
            )
        for j in range(N):
            held = (
                (j == WM and holds_m) or (j == WL and (holds_l or p.rigid)) or (j == TL and p.rigid)
            )
            here = x.y[j]
            x.y[j] = here + steps[j]
            drive_derivative(x.y, 0.0, 0.0, references, x.stick, p, up, q)
            x.y[j] = here - steps[j]
            drive_derivative(x.y, 0.0, 0.0, references, x.stick, p, down, q)
            x.y[j] = here
            for i in range(N):
                follows = p.rigid and i in (TL, WL)
                A[pattern, i, j] = 0.0 if held or follows else (up[i] - down[i]) / (2.0 * steps[j])
        _add_modes(pattern, modes, p, A)


@code.inner(**COMPILE)
def _add_modes(pattern, modes, p, A):
    """Effect of the modes on the output over short times: the spring and the damper of an array that
    stands still.

    Their motion is no part of A; without this the iteration would have to find heavy modes on a
    light shaft.
    """
    spring = damper = 0.0
    for k in range(modes.H.size):
        spring += modes.H[k] * modes.H[k] * modes.Lam[k]
        damper += modes.H[k] * modes.H[k] * modes.D[k]
        if modes.V.size > 0:
            spring += modes.V[k] * (2.0 * modes.D[k] * modes.H[k] - modes.V[k])
            damper -= 2.0 * modes.H[k] * modes.V[k]
    if p.rigid and pattern < 2:
        share = p.inv_h * p.inv_h / (p.J_m + p.inv_h * p.inv_h * p.J_L)
        A[pattern, WM, TM] -= share * spring
        A[pattern, WM, WM] -= share * damper
    elif not p.rigid and not holds(pattern, p)[1]:
        A[pattern, WL, TL] -= p.inv_J_L * spring
        A[pattern, WL, WL] -= p.inv_J_L * damper


@code.inner(**COMPILE)
def _tabulate_pattern(pattern, shortest, t, p, drive):
    """Tables of the drive's states for one pattern of what sticks."""
    for i in range(N):
        for j in range(N):
            drive.A[i, j] = t.A[pattern, i, j]
    drive.B[:] = 0.0
    for k in range(6):
        i = INPUTS[k]
        holds_m, holds_l = holds(pattern, p)
        held = (i == WL and (p.rigid or holds_l)) or (i == WM and holds_m)
        drive.B[i, k] = 0.0 if held else 1.0
    for node in range(4):
        _start(drive, CUBES[node] * shortest)
        for level in range(t.levels - 1, -1, -1):
            if level < t.levels - 1:
                _double(drive.E, drive.P, drive.swap)
            _tabulate_drive(pattern * t.levels + level, node, drive.E, drive.P, t)


@code.inner(**COMPILE)
def _tabulate_oscillator(k, shortest, t, p, mode):
    """Tables of one mode of the array."""
    H, D, Lam = p.H[k], p.D[k], p.Lam[k]
    mode.A[0, 0], mode.A[0, 1], mode.A[1, 0], mode.A[1, 1] = 0.0, 1.0, -Lam, -D
    mode.B[0, 0], mode.B[1, 0] = -H, D * H
    if p.H_m.size > 0:
        mode.B[1, 0] -= p.V[k]
        mode.B[0, 1], mode.B[1, 1] = -p.H_m[k], D * p.H_m[k] - p.V_m[k]
    for node in range(4):
        _start(mode, CUBES[node] * shortest)
        for level in range(t.levels - 1, -1, -1):
            if level < t.levels - 1:
                _double(mode.E, mode.P, mode.swap)
            _tabulate_mode(level, k, node, mode.E, mode.P, t, p)


@code.entry(**COMPILE)
def tabulate(t: Propagators, p: Drive, drive: Moments, mode: Moments) -> None:
    """Fill the tables of a drive whose ``A`` is known; ``drive`` and ``mode`` are scratch for N
    states and for 2.
    """
    shortest = t.longest * 0.5 ** (t.levels - 1)
    for pattern in range(PATTERNS):
        if occurs(pattern, p):
            _tabulate_pattern(pattern, shortest, t, p, drive)
    tabulate_modes_into(t, p, mode)


@code.inner(**COMPILE)
def tabulate_modes_into(t, p, mode):
    """Fill the tables of all modes; sums over them must be 0 before."""
    shortest = t.longest * 0.5 ** (t.levels - 1)
    for k in range(p.H.size):
        _tabulate_oscillator(k, shortest, t, p, mode)


@code.entry(**COMPILE)
def tabulate_modes(t: Propagators, p: Drive, mode: Moments) -> None:
    """Fill the tables of the modes alone, for a drive that differs from that of ``t``."""
    tabulate_modes_into(t, p, mode)


@code.inner(**COMPILE)
def _tabulate_drive(block, node, E, P, t):
    """Entries of a pattern and level for one node, which is also the end for node 3."""
    nodes, pieces = block * NODE_ROWS, block * PIECE_ROWS
    for i in range(N):
        for j in range(N):
            t.nodes[nodes + N * j + i, node] = E[i, j] + (1.0 if i == j else 0.0)
        for k in range(6):
            for j in range(4):
                t.nodes[nodes + N * (N + 4 * k + j) + i, node] = _by_node(P, i, k, j, CUBES[node])
    if node == 3:
        for i in range(N):
            half, lane = i // 4, i % 4
            for j in range(N):
                t.pieces[pieces + 2 * j + half, lane] = E[i, j] + (1.0 if i == j else 0.0)
            for k in range(6):
                factor = 1.0
                for m in range(4):
                    t.pieces[pieces + 2 * (N + 4 * k + m) + half, lane] = factor * P[m, i, k]
                    factor *= m + 1


@code.inner(**COMPILE)
def _tabulate_driven(row, j, node, eta, w, t):
    """States of a mode at one node by the rate at the node ``j`` of a shaft."""
    t.modes[row + M_ETA_BY + j, node] = eta
    t.modes[row + M_W_BY + j, node] = w
    if node == 3:
        t.modes[row + M_ETA_END, j], t.modes[row + M_W_END, j] = eta, w


@code.inner(**COMPILE)
def _tabulate_mode(level, k, node, E, P, t, p):
    """Entries of a level and mode for one node."""
    H, D, Lam = p.H[k], p.D[k], p.Lam[k]
    row, total = (level * p.H.size + k) * MODE_ROWS, level * SUM_ROWS
    for j in range(2):
        by_eta, by_w = E[0, j] + (1.0 if j == 0 else 0.0), E[1, j] + (1.0 if j == 1 else 0.0)
        t.modes[row + M_TORQUE + j, node] = H * (Lam * by_eta + D * by_w)
        t.modes[row + M_MOMENTUM + j, node] = H * by_w
        t.modes[row + M_ETA + j, node] = by_eta
        t.modes[row + M_W + j, node] = by_w
        if p.H_m.size > 0:
            t.modes[row + M_TORQUE + j, node] -= p.V[k] * by_w
            t.modes[row + M_MOMENTUM + j, node] += p.H_m[k] * by_w + (p.V[k] + p.V_m[k]) * by_eta
            t.modes[row + M_ON_ROTOR + j, node] = (
                p.H_m[k] * (Lam * by_eta + D * by_w) - p.V_m[k] * by_w
            )
        if node == 3:
            t.modes[row + M_E, j], t.modes[row + M_E, 2 + j] = by_eta, by_w
    for j in range(4):
        eta, w = _by_node(P, 0, 0, j, CUBES[node]), _by_node(P, 1, 0, j, CUBES[node])
        _tabulate_driven(row, j, node, eta, w, t)
        rate = w - (H if j == node else 0.0)
        if p.H_m.size > 0:
            pull = Lam * eta + D * rate + (p.V[k] if j == node else 0.0)
            t.sums[total + S_OUTPUT + j, node] += H * pull - p.V[k] * rate
            t.sums[total + S_BOTH + j, node] += p.H_m[k] * pull - p.V_m[k] * rate
            t.sums[total + S_MOMENTUM + j, node] += (H + p.H_m[k]) * w + (p.V[k] + p.V_m[k]) * eta
            eta, w = _by_node(P, 0, 1, j, CUBES[node]), _by_node(P, 1, 1, j, CUBES[node])
            _tabulate_driven(row + BY_ROTOR, j, node, eta, w, t)
            rate = w - (p.H_m[k] if j == node else 0.0)
            pull = Lam * eta + D * rate + (p.V_m[k] if j == node else 0.0)
            t.sums[total + S_ROTOR + j, node] += p.H_m[k] * pull - p.V_m[k] * rate
            t.sums[total + S_ROTOR_MOMENTUM + j, node] += (H + p.H_m[k]) * w + (
                p.V[k] + p.V_m[k]
            ) * eta
        else:
            t.sums[total + S_OUTPUT + j, node] += H * (Lam * eta + D * rate)
            t.sums[total + S_MOMENTUM + j, node] += H * w
    if node == 3:
        factor = 1.0
        for m in range(4):
            t.modes[row + M_ETA_PART, m], t.modes[row + M_W_PART, m] = (
                factor * P[m, 0, 0],
                factor * P[m, 1, 0],
            )
            if p.H_m.size > 0:
                t.modes[row + BY_ROTOR + M_ETA_PART, m] = factor * P[m, 0, 1]
                t.modes[row + BY_ROTOR + M_W_PART, m] = factor * P[m, 1, 1]
            factor *= m + 1
