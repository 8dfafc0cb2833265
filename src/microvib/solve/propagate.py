"""The hot loop by exact propagation: microsteps, steps of suitable length, their ends at events, and samples.

A step is ``microvib.solve.collocation``'s. Read from the end: ``advance`` is the loop, and calls what stands above it.
"""

import math

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve.collocation import (
    N_SUMS,
    Work,
    _begin,
    _continue,
    _error,
    _iterate,
    _judge,
    _momentum,
    _pattern,
    _see,
    _see_references,
    _uncount,
    _unsee,
    _weigh,
)
from microvib.solve.ends import (
    _end_at_event,
    _evaluate,
    _first_root,
    _whole,
)
from microvib.solve.kernel import (
    COMPILE,
    FORCED,
    IMPULSE,
    INLINE,
    LARGEST,
    MISMATCH,
    MODES,
    N_CHANNELS,
    N_POWERS,
    NOT_FINITE,
    NOW,
    OK,
    POWERS,
    REJECTED,
    STEP_TOO_SMALL,
    STEPS,
    T_D,
    T_D_FORCE,
    TM,
    WEIGHT,
    WL,
    WM,
    Drive,
    Samples,
    State,
    before_ramp_ends,
    channels,
    decide_element,
    decide_friction,
    follow,
    health,
    pass_time,
    references_after,
    sticks,
    take_microstep,
)
from microvib.solve.propagators import (
    CONVERGED,
    FIRST_HALF,
    GROW_BELOW,
    HALF,
    LAGRANGE,
    M_ETA,
    M_ETA_BY,
    M_W,
    M_W_BY,
    MODE_ROWS,
    PATTERNS,
    N,
    Propagators,
)
from microvib.solve.vector import rows

code = Unit(
    __name__,
    "kernel.py",
    "propagators.py",
    "collocation.py",
    "ends.py",
    "vector.py",
    "vector_type.py",
    types="microvib.solve.vector_type",
)

# ---- Samples ----


@code.inner(**FORCED)
def _channels_at_nodes(level, x, p, t, w):
    """All channels at the nodes, by node."""
    y, f, q = rows(w.y, 0, w.y.shape[0], 1), rows(w.f, 0, w.f.shape[0], 1), rows(w.q, 0, 7, 1)
    modes = rows(t.modes, level * p.H.size * MODE_ROWS, p.H.size * MODE_ROWS, MODE_ROWS)
    for k in range(p.H.size):
        eta, rate = x.y[MODES + 2 * k], x.y[MODES + 2 * k + 1]
        there_eta = modes[k, M_ETA] * eta + modes[k, M_ETA + 1] * rate
        there_w = modes[k, M_W] * eta + modes[k, M_W + 1] * rate
        for j in range(4):
            drive = w.at[WL, j]
            if p.H_m.size > 0:
                drive = p.H[k] * drive + p.H_m[k] * w.at[WM, j]
            there_eta += modes[k, M_ETA_BY + j] * drive
            there_w += modes[k, M_W_BY + j] * drive
        y[MODES + 2 * k], y[MODES + 2 * k + 1] = there_eta, there_w
    dt = t.longest * 0.5**level * rows(t.fractions, 0, 1, 1)[0]
    channels(
        y,
        references_after(dt, x.clock),
        rows(w.noise, 0, 1, 1)[0],
        x.stick,
        p,
        f,
        q,
        rows(w.values, 0, w.values.shape[0], 1),
    )
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


@code.inner(**FORCED)
def _add(u_a, u_b, T, stuck, all_channels, w, out):
    """Add to ``out.partial`` the integrals over the part of the step between two fractions of it."""
    partial = out.partial
    if all_channels:
        _weights(u_a, w.weights[0])
        _weights(u_b, w.weights[1])
        for j in range(4):
            weight, values = T * (w.weights[1, j] - w.weights[0, j]), w.by_node[j]
            for k in range(partial.size):
                partial[k] += weight * values[k]
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


@code.inner(**COMPILE)
def _whole_intervals(count, u, T, stuck, all_channels, w, out):
    """Rows of ``count`` intervals that lie in the step, from its fraction ``u`` on; returns the fraction after them."""
    first, d = out.cursor[0], out.width / T
    if not all_channels:
        L_a, inverse = _momentum_at(u, w.poly), 1.0 / out.width
        for m in range(count):
            L_b = _momentum_at(u + (m + 1) * d, w.poly)
            out.rows[first + m, 0], out.rows[first + m, 1] = (L_a - L_b) * inverse, stuck
            L_a = L_b
    else:
        before, after = w.weights[0], w.weights[1]
        n0, n1, n2, n3 = w.by_node[0], w.by_node[1], w.by_node[2], w.by_node[3]
        _weights(u, before)
        for m in range(count):
            _weights(u + (m + 1) * d, after)
            w0, w1 = (after[0] - before[0]) / d, (after[1] - before[1]) / d
            w2, w3 = (after[2] - before[2]) / d, (after[3] - before[3]) / d
            row = out.rows[first + m]
            for k in range(row.size):
                row[k] = w0 * n0[k] + w1 * n1[k] + w2 * n2[k] + w3 * n3[k]
            before, after = after, before
    out.cursor[0] += count
    return u + count * d


@code.inner(**COMPILE)
def _record(u, end, level, x, p, t, w, out):
    """Integrate the channels over the step to the time ``end``, its fraction ``u``; close every sample interval that ends inside.

    A sample is the mean over its interval. Where ``out`` has two columns, only the torque, by the change of momentum, and the
    output's stick are recorded. Steps end at events, so jumps are averaged exactly, not sampled.
    """
    clock, cursor = x.clock, out.cursor
    T, all_channels = t.longest * 0.5**level, out.rows.shape[1] > 2
    if all_channels:
        _channels_at_nodes(level, x, p, t, w)
    now, stuck = clock[NOW], sticks(1, x.stick, p)
    first_row = cursor[0]
    if end > out.first and cursor[0] < out.rows.shape[0]:
        u_a = max((out.first - now) / T, 0.0) if clock[WEIGHT] == 0.0 else 0.0
        boundary = out.first + (cursor[0] + cursor[1] + 1) * out.width
        if boundary <= end + 1e-6 * out.width:  # the last digits of two sums may differ
            u_b = min((boundary - now) / T, u)
            _add(u_a, u_b, T, stuck, all_channels, w, out)
            clock[WEIGHT] += (u_b - u_a) * T
            _close(x, out)
            count = min(int((end - boundary) / out.width + 1e-6), out.rows.shape[0] - cursor[0])
            u_a = _whole_intervals(count, u_b, T, stuck, all_channels, w, out) if count > 0 else u_b
        if cursor[0] < out.rows.shape[0] and u - u_a > 1e-6 * out.width / T:
            _add(u_a, u, T, stuck, all_channels, w, out)
            clock[WEIGHT] += (u - u_a) * T
    if all_channels:
        _integrate(u, now, T, first_row, x, w, out)
    else:
        clock[IMPULSE] += w.poly[0] - _momentum_at(u, w.poly)


@code.inner(**COMPILE)
def _integrate(u, now, T, first_row, x, w, out):
    """Energies over the step, also at the middles of the intervals closed in it, and the balance of momentum."""
    clock = x.clock
    for row in range(first_row, out.cursor[0]):
        until = min((out.first + (row + out.cursor[1] + 1) * out.width - now) / T, u)
        _weights(until, w.weights[0])
        for k in range(N_POWERS):
            energy = x.energy[k] - 0.5 * out.width * out.rows[row, POWERS + k]
            for j in range(4):
                energy += T * w.weights[0, j] * w.by_node[j, POWERS + k]
            out.rows[row, POWERS + k] = energy
    _weights(u, w.weights[0])
    for j in range(4):
        values = w.by_node[j]
        for k in range(N_POWERS):
            x.energy[k] += T * w.weights[0, j] * values[POWERS + k]
        clock[IMPULSE] += T * w.weights[0, j] * values[T_D_FORCE]
        clock[MISMATCH] = max(clock[MISMATCH], math.fabs(values[T_D] - values[T_D_FORCE]))
        clock[LARGEST] = max(clock[LARGEST], math.fabs(values[T_D]))


# ---- The loop ----

# Kinds of a step, by which the level of the last one of its kind is remembered: the first after a microstep, after an event,
# any other; for each pattern
AFTER_MICROSTEP, AFTER_EVENT, FURTHER, KINDS = range(4)
TORQUE_SHOWN = 0.2
"""Weight of what moves inside a step where nothing but the torque is sampled, which is that of polynomials of degree 7."""
UNRESOLVED = 1e-4
"""Change of the deficits, over what a microstep moves, that is accepted in the shortest steps: where equations jump."""


@code.inner(**INLINE)
def _work(x, elements, lanes, flat, by_node, room):
    """Scratch of a step in the memory given; ``flat`` is that of ``lanes``."""
    n, modes = x.y.size, x.y.size - MODES
    count = N_CHANNELS + modes
    many = lanes[69 + n :]
    return Work(
        room[:N], flat[252:260], room[N : N + modes], room[N + modes : N + modes + n], lanes[:8], lanes[8:16],
        lanes[69 : 69 + n], many[:n], lanes[16:23], lanes[23:29], lanes[29:35], lanes[35 : 35 + N_SUMS],
        many[n + count + 3 + elements : n + count + 4 + elements], many[n + count + 3 : n + count + 3 + elements],
        many[n : n + count],
        by_node, lanes[45:53], lanes[53:61], lanes[63:65], lanes[61:63], flat[244:252], flat[268:274],
        flat[260:268], lanes[65:67], many[n + count : n + count + 3],
    )  # fmt: skip


@code.inner(**INLINE)
def _first_level(kind, left, x, p, t):
    """Level at which the last step of this kind succeeded, or the one that just reaches the end of what is ``left``."""
    remembered = x.levels[kind * PATTERNS + _pattern(x.stick, p)]
    level = remembered
    while level < t.levels - 1 and t.longest * 0.5 ** (level + 1) >= left:
        level += 1
    return remembered, level


@code.inner(**FORCED)
def _solved_step(kind, left, last_level, shown, s, c, x, p, t, w):
    """Solve a step short enough for its iteration to converge and its error to pass; its level, and a status code.

    ``last_level`` is that of the step before, whose deficits go on in this one, or -1.
    """
    remembered, level = _first_level(kind, left, x, p, t)
    if kind == FURTHER and last_level >= 0 and last_level - 1 <= level <= last_level + 1:
        _continue(HALF + last_level + 1 - level, t, w)
    else:
        _begin(s, c, x, p, t, w)
    while True:
        _weigh(x, p, t, w)  # by the start, for the iteration
        change, shortest = _iterate(level, s, c, x, p, t, w), level >= t.levels - 1
        _weigh(x, p, t, w)  # by the end
        error, converged = _error(level, shown, t, w), change <= CONVERGED * t.accuracy
        if converged and error <= t.accuracy:
            break
        if shortest and (converged or change <= UNRESOLVED):
            break  # a kink, such as the supply's limit, inside the shortest step
        x.counters[REJECTED] += 1
        if shortest:
            return level, STEP_TOO_SMALL if math.isfinite(change) and math.isfinite(error) else NOT_FINITE
        if converged and error <= 30.0 * t.accuracy:
            level += 1
            _continue(FIRST_HALF, t, w)
        else:
            level = min(level + (2 if not error <= 1e3 * t.accuracy else 1), t.levels - 1)
            _begin(s, c, x, p, t, w)
        remembered = level
    grows = 1 if error < GROW_BELOW * t.accuracy else 0
    pattern = _pattern(x.stick, p)
    x.levels[kind * PATTERNS + pattern] = max((min(remembered, level) if grows else remembered) - grows, 0)
    x.levels[FURTHER * PATTERNS + pattern] = max(level - grows, 0)
    return level, OK


@code.inner(**FORCED)
def _end_step(level, left, x, p, t, w):
    """End the solved step at its first friction event or where nothing is ``left``: its fraction there, which friction or -1."""
    T = t.longest * 0.5**level
    u = left / T if left * (1.0 + 1e-12) < T else 1.0
    _judge(p, x, w)
    first, event = 2.0, -1
    for which in range(2 + p.elements.shape[0]):
        root = _first_root(which, u, T, x, p, w)
        if root <= u and root <= first:
            first, event = root, which
    if event >= 0:
        return _end_at_event(first, event, level, x, p, t, w), event
    if u == 1.0:
        _whole(level, p, x, t, w)
    else:
        _evaluate(u, level, x, p, t, w)
    return u, -1


@code.inner(**FORCED)
def _move(event, x, p, t, w):
    """Move the state to the end of the step, with the friction event there."""
    for j in range(N):
        w.x[j] = w.end[j]
    for j in range(w.modes.size):
        x.y[MODES + j] = w.modes[j]
    if event >= 0:
        for j in range(N):
            x.y[j] = w.there[j]
        if event < 2:
            decide_friction(event, x, p)
        else:
            decide_element(event - 2, x, p)
        follow(x.y, p)
        _see(x, p, t, w)


@code.entry(**COMPILE)
def advance(
    stop: float, x: State, p: Drive, t: Propagators, out: Samples, steps_t: Vector, steps_ref: Matrix,
    lanes: Matrix, flat: Vector, by_node: Matrix, room: Vector,
) -> int:  # fmt: skip
    """Advance the drive ``p`` to the time ``stop``; state ``x`` and samples ``out`` are updated in place.

    Each turn of the loop either takes a microstep that is due, or one step: shortened until its iteration converges and its error
    estimate passes, and ended at the next microstep or at the first friction event inside it.

    ``steps_t`` (n,) are the times of the microsteps before ``stop``, ``steps_ref`` (n, 4) the references i_A*, i_B*, the
    electrical angle after each and the time of the ramp there; ``lanes``, ``flat`` (the same memory), ``by_node`` (4, channels)
    and ``room`` are scratch. Returns a status code.
    """
    w, clock, coming, stalled, status = _work(x, p.elements.shape[0], lanes, flat, by_node, room), x.clock, 0, 0, OK
    shown = 1.0 if out.rows.shape[1] > 2 else TORQUE_SHOWN
    s, c = _see(x, p, t, w)
    kind, last_level = FURTHER, -1
    while clock[NOW] < stop:
        target = stop
        if coming < steps_t.size and steps_t[coming] < stop:
            target = steps_t[coming]
        target = before_ramp_ends(target, clock)
        left = target - clock[NOW]
        if left <= 0.0:
            _uncount(w.x, 0.0, x, p)
            _unsee(w.x, x.y, x, p, t)
            take_microstep(steps_ref[coming], x)
            coming += 1
            s, c = _see(x, p, t, w)
            kind = AFTER_MICROSTEP
            continue
        level, status = _solved_step(kind, left, last_level, shown, s, c, x, p, t, w)
        if status != OK:
            break
        u, event = _end_step(level, left, x, p, t, w)
        T = t.longest * 0.5**level
        # A step that reaches its target ends there to the last digit, so that sample intervals close where they should.
        end = target if event < 0 and left * (1.0 - 1e-12) <= T else clock[NOW] + u * T
        if out.width > 0.0:
            _momentum(level, p, t, w)
            _record(u, end, level, x, p, t, w, out)
        x.counters[STEPS] += 1
        lasted = end - clock[NOW]
        ramp_ends = pass_time(end, clock)
        _move(event, x, p, t, w)
        if not p.ideal:
            _see_references(s, c, x, p)
        kind, last_level = (AFTER_EVENT, -1) if event >= 0 else (FURTHER, level if u == 1.0 else -1)
        if ramp_ends:
            kind, last_level = AFTER_MICROSTEP, -1
        status, stalled = health(p.z * w.x[TM], lasted, clock[NOW], stalled)
        if status != OK:
            break
    _uncount(w.x, 0.0, x, p)
    _unsee(w.x, x.y, x, p, t)
    return status
