"""Samples of a run by propagators: means over intervals, integrated over each step, and the
energies and impulses beside them.
"""

import math

from microvib.compiled import Unit
from microvib.solve.collocation import CHANGE, N_SUMS
from microvib.solve.kernel import (
    FORCED,
    IMPULSE,
    INLINE,
    LARGEST,
    MISMATCH,
    MODES,
    N_POWERS,
    NOW,
    POWERS,
    STEP_DEFICITS,
    STEP_EVENT,
    STEP_LEVEL,
    STEP_PART,
    STEP_REACHES,
    T_D,
    T_D_FORCE,
    WEIGHT,
    WL,
    WM,
    channels,
    references_after,
    sticks,
)
from microvib.solve.propagators import BY_ROTOR, M_ETA, M_ETA_BY, M_W, M_W_BY, MODE_ROWS
from microvib.solve.vector import WIDTH, rows

code = Unit(__name__, "collocation.py")


@code.inner(**FORCED)
def _modes_at_nodes(level, x, p, t, w, y):
    """Angles and rates of the modes at the nodes, into ``y``."""
    modes = rows(t.modes, level * p.H.size * MODE_ROWS, p.H.size * MODE_ROWS, MODE_ROWS)
    for k in range(p.H.size):
        eta, rate = x.y[MODES + 2 * k], x.y[MODES + 2 * k + 1]
        there_eta = modes[k, M_ETA] * eta + modes[k, M_ETA + 1] * rate
        there_w = modes[k, M_W] * eta + modes[k, M_W + 1] * rate
        for j in range(4):
            there_eta += modes[k, M_ETA_BY + j] * w.at[WL, j]
            there_w += modes[k, M_W_BY + j] * w.at[WL, j]
        if p.H_m.size > 0:
            for j in range(4):
                there_eta += modes[k, BY_ROTOR + M_ETA_BY + j] * w.at[WM, j]
                there_w += modes[k, BY_ROTOR + M_W_BY + j] * w.at[WM, j]
        y[MODES + 2 * k], y[MODES + 2 * k + 1] = there_eta, there_w


@code.inner(**FORCED)
def _columns_by_node(values, w, out):
    """The columns of a row, channels or sums of them, by node."""
    sums = rows(w.sums, 0, N_SUMS, 1)
    if out.mix.shape[0] == 0:
        for k in range(w.values.shape[0]):
            for j in range(4):
                w.by_node[j, k] = w.values[k, j]
    for k in range(out.mix.shape[0]):
        total = values[0] * out.mix[k, 0]
        for c in range(1, w.values.shape[0]):
            total += values[c] * out.mix[k, c]
        sums[CHANGE] = total
        for j in range(4):
            w.by_node[j, k] = w.sums[CHANGE, j]


@code.inner(**FORCED)
def _channels_at_nodes(level, sampled, x, p, t, w, out):
    """All channels at the nodes; where some of the step is ``sampled``, also the columns of a row,
    by node.
    """
    y, f, q = rows(w.y, 0, w.y.shape[0], 1), rows(w.f, 0, w.f.shape[0], 1), rows(w.q, 0, 7, 1)
    _modes_at_nodes(level, x, p, t, w, y)
    dt = t.longest * 0.5**level * rows(t.fractions, 0, 1, 1)[0]
    values = rows(w.values, 0, w.values.shape[0], 1)
    channels(
        y,
        references_after(dt, x.clock),
        rows(w.noise, 0, 1, 1)[0],
        x.stick,
        p,
        f,
        q,
        values,
    )
    for j in range(4):
        for k in range(N_POWERS):
            w.flows[j, k] = w.values[POWERS + k, j]
    if sampled:
        _columns_by_node(values, w, out)


@code.inner(**INLINE)
def _weights(u, t):
    """Lanes: integrals of the four cubics l_j from 0 to ``u``."""
    by = rows(t.integrals, 0, 4, 1)
    return u * (by[0] + u * (by[1] + u * (by[2] + u * by[3])))


@code.inner(**INLINE)
def _momentum_at(u, poly):
    """Momentum at the fraction ``u`` of the step."""
    total = poly[7]
    for m in range(6, -1, -1):
        total = total * u + poly[m]
    return total


@code.inner(**FORCED)
def _add(u_a, u_b, T, stuck, all_channels, t, w, out):
    """Add to ``out.partial`` the integrals over the part of the step between two fractions of it."""
    partial = out.partial
    if all_channels:
        rows(w.weights, 0, 1, 1)[0] = T * (_weights(u_b, t) - _weights(u_a, t))
        w0, w1, w2, w3 = w.weights[0, 0], w.weights[0, 1], w.weights[0, 2], w.weights[0, 3]
        columns, of = partial.size // WIDTH, w.by_node.shape[1] // WIDTH
        n, total = rows(w.by_node, 0, 4 * of, of), rows(partial, 0, columns, 1)
        for k in range(columns):
            total[k] = total[k] + ((n[0, k] * w0 + n[1, k] * w1) + (n[2, k] * w2 + n[3, k] * w3))
    else:
        partial[0] += _momentum_at(u_a, w.poly) - _momentum_at(u_b, w.poly)
        partial[1] += (u_b - u_a) * T * stuck


@code.inner(**FORCED)
def _close(x, out):
    """A row from what has been added up."""
    row, partial = out.rows[out.cursor[0]], out.partial
    inverse = 1.0 / x.clock[WEIGHT]  # not the width: late in a run it is rounded
    for k in range(partial.size):
        row[k] = partial[k] * inverse
        partial[k] = 0.0
    x.clock[WEIGHT] = 0.0
    out.cursor[0] += 1


@code.inner(**FORCED)
def _whole_intervals(count, u, T, stuck, all_channels, t, w, out):
    """Rows of ``count`` intervals that lie in the step, from its fraction ``u`` on; returns the
    fraction after them.
    """
    first, d = out.cursor[0], out.width / T
    if not all_channels:
        L_a, inverse = _momentum_at(u, w.poly), 1.0 / out.width
        for m in range(count):
            L_b = _momentum_at(u + (m + 1) * d, w.poly)
            out.rows[first + m, 0], out.rows[first + m, 1] = (L_a - L_b) * inverse, stuck
            L_a = L_b
    else:
        before, inverse, weights = _weights(u, t), 1.0 / d, rows(w.weights, 0, 1, 1)
        columns, of = out.rows.shape[1] // WIDTH, w.by_node.shape[1] // WIDTH
        n, to = (
            rows(w.by_node, 0, 4 * of, of),
            rows(out.rows, 0, out.rows.shape[0] * columns, columns),
        )
        for m in range(count):
            after = _weights(u + (m + 1) * d, t)
            weights[0], before = inverse * (after - before), after
            w0, w1, w2, w3 = w.weights[0, 0], w.weights[0, 1], w.weights[0, 2], w.weights[0, 3]
            for k in range(columns):
                to[first + m, k] = (n[0, k] * w0 + n[1, k] * w1) + (n[2, k] * w2 + n[3, k] * w3)
            if out.mix.shape[0] == 0:
                _powers_to_energy(first + m, out.width, w, out)
    out.cursor[0] += count
    return u + count * d


@code.inner(**FORCED)
def _energy_at(u, T, x, t, w):
    """Lanes: the energies at the fraction ``u`` of the step, by the powers at its nodes."""
    flows = rows(w.flows, 0, 4, 1)
    rows(w.weights, 0, 1, 1)[0] = T * _weights(u, t)
    w0, w1, w2, w3 = w.weights[0, 0], w.weights[0, 1], w.weights[0, 2], w.weights[0, 3]
    return rows(x.energy, 0, 1, 1)[0] + (
        (flows[0] * w0 + flows[1] * w1) + (flows[2] * w2 + flows[3] * w3)
    )


@code.inner(**FORCED)
def _powers_to_energy(row, lasted, w, out):
    """Replace the mean powers in a row by the energies in the middle of its interval, of which
    ``lasted`` [s] are in this step.

    The running energies are those where this part of it begins, and then those at its end.
    """
    columns, running = out.rows.shape[1] // WIDTH, rows(w.flows, 4, 1, 1)
    to = rows(out.rows, 0, out.rows.shape[0] * columns, columns)
    mean = to[row, POWERS // WIDTH]
    end = running[0] + lasted * mean
    to[row, POWERS // WIDTH], running[0] = end - (0.5 * out.width) * mean, end


@code.inner(**FORCED)
def record_samples(u, end, level, x, p, t, w, out):
    """Integrate the channels over the step to the time ``end``, its fraction ``u``; close every
    sample interval that ends inside.

    A sample is the mean over its interval. Where ``out`` has two columns and no sums, only the
    torque, by the change of momentum, and the output's stick are recorded. Steps end at events, so
    jumps are averaged exactly, not sampled.
    """
    clock, cursor = x.clock, out.cursor
    T, all_channels = t.longest * 0.5**level, out.rows.shape[1] > 2 or out.mix.shape[0] > 0
    sampled = end > out.first and cursor[0] < out.rows.shape[0]
    if all_channels:
        _channels_at_nodes(level, sampled, x, p, t, w, out)
    now, stuck = clock[NOW], sticks(1, x.stick, p)
    if sampled:
        u_a = max((out.first - now) / T, 0.0) if clock[WEIGHT] == 0.0 else 0.0
        boundary = out.first + (cursor[0] + cursor[1] + 1) * out.width
        if boundary <= end + 1e-6 * out.width:  # the last digits of two sums may differ
            u_b = min((boundary - now) / T, u)
            _add(u_a, u_b, T, stuck, all_channels, t, w, out)
            clock[WEIGHT] += (u_b - u_a) * T
            _close(x, out)
            if all_channels and out.mix.shape[0] == 0:
                rows(w.flows, 4, 1, 1)[0] = _energy_at(u_b, T, x, t, w)
                _powers_to_energy(cursor[0] - 1, 0.0, w, out)
            count = min(int((end - boundary) / out.width + 1e-6), out.rows.shape[0] - cursor[0])
            u_a = (
                _whole_intervals(count, u_b, T, stuck, all_channels, t, w, out)
                if count > 0
                else u_b
            )
        if cursor[0] < out.rows.shape[0] and u - u_a > 1e-6 * out.width / T:
            _add(u_a, u, T, stuck, all_channels, t, w, out)
            clock[WEIGHT] += (u - u_a) * T
    if all_channels:
        _balance(u, T, x, t, w)
    else:
        clock[IMPULSE] += w.poly[0] - _momentum_at(u, w.poly)


@code.inner(**FORCED)
def record_step(u, event, reaches, level, w, out):
    """A row of the step itself, from which it can be taken again (``microvib.solve.replay``)."""
    row = out.rows[out.cursor[0]]
    row[STEP_LEVEL], row[STEP_EVENT], row[STEP_REACHES] = level, event, 1.0 if reaches else 0.0
    row[STEP_PART] = u
    for k in range(6):
        for j in range(4):
            row[STEP_DEFICITS + 4 * k + j] = w.r[k, j]
    out.cursor[0] += 1


@code.inner(**FORCED)
def _balance(u, T, x, t, w):
    """Energies over the step, and the balance of momentum."""
    clock = x.clock
    rows(x.energy, 0, 1, 1)[0] = _energy_at(u, T, x, t, w)
    for j in range(4):  # the weights are those of the energies
        T_d, T_d_force = w.values[T_D, j], w.values[T_D_FORCE, j]
        clock[IMPULSE] += w.weights[0, j] * T_d_force
        clock[MISMATCH] = max(clock[MISMATCH], math.fabs(T_d - T_d_force))
        clock[LARGEST] = max(clock[LARGEST], math.fabs(T_d))
