"""A run taken again with its own steps: as many, as long, with the same events at their ends.

Whether a step is accepted or halved changes its end by the error of integration. A run beside one
that was recorded (``kernel.STEP_COLUMNS``), with another state at its start or another drive,
therefore differs from it by that, too, unless it takes the same steps. Taken so, ends are smooth
functions of starts and parameters as long as the same events occur in the same order, and
differences of them are as exact as rounding allows.

The drive may be another than that of the propagators: however large a deficit is, it is no
approximation (``microvib.solve.collocation``). Only the modes of the array need tables of their own.
"""

import math

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve.collocation import fit_momentum, margins_at_nodes, solve_collocation
from microvib.solve.frame import (
    add_reference_offset,
    from_command_frame,
    references_in_command_frame,
    to_command_frame,
)
from microvib.solve.kernel import (
    COMPILE,
    FORCED,
    INLINE,
    NOT_FINITE,
    NOW,
    OK,
    STEP_DEFICITS,
    STEP_EVENT,
    STEP_LEVEL,
    STEP_PART,
    STEP_REACHES,
    Drive,
    State,
    before_ramp_ends,
    pass_time,
)
from microvib.solve.propagate import move, take, work_of
from microvib.solve.propagators import Propagators
from microvib.solve.step_events import end_of_whole_step, margin_within, solution_at

code = Unit(__name__, "propagate.py")

START, FREQUENCY, MOMENTUM, GAINED, N_SPAN = range(5)
"""Entries of ``span``: start of the period [s], its frequency [Hz], a momentum from which others are
counted [N m s], and what the period gains [N m s], which is a result."""
SEARCH_STEP = 1e-4
"""First step, in fractions of a step, of the search for an event about where it was."""
LOCATED = 1e-13
"""Fraction of a step to which an event is located."""
MOST_TRIALS = 8
# Gauss nodes in a step and their weights: exact for a polynomial of degree 7
_INNER, _OUTER = (
    0.5 * math.sqrt(3.0 / 7.0 - 2.0 / 7.0 * math.sqrt(1.2)),
    0.5 * math.sqrt(3.0 / 7.0 + 2.0 / 7.0 * math.sqrt(1.2)),
)
GAUSS_NODES = (0.5 - _OUTER, 0.5 - _INNER, 0.5 + _INNER, 0.5 + _OUTER)
GAUSS_WEIGHTS = (
    (18.0 - math.sqrt(30.0)) / 72.0,
    (18.0 + math.sqrt(30.0)) / 72.0,
    (18.0 + math.sqrt(30.0)) / 72.0,
    (18.0 - math.sqrt(30.0)) / 72.0,
)


@code.inner(**COMPILE)
def _locate(u, which, level, x, p, t, w):
    """Fraction of the step where the margin of ``which`` is spent, near ``u``, with the solution
    there; to rounding, by secants.
    """
    last, before = u, margin_within(u, which, level, x, p, t, w)
    u = last + SEARCH_STEP
    for _ in range(MOST_TRIALS):
        e = margin_within(u, which, level, x, p, t, w)
        if e == before:
            break
        way = u - last
        change = e * way / (before - e)
        last, before = u, e
        u += change
        # what is left is of the order of the product of the last two changes
        if math.fabs(change) * max(math.fabs(way), math.fabs(change)) < LOCATED:
            break
    margin_within(u, which, level, x, p, t, w)
    return u


@code.inner(**COMPILE)
def _momentum_at(u, poly):
    """Momentum at the fraction ``u`` of the step."""
    total = poly[7]
    for m in range(6, -1, -1):
        total = total * u + poly[m]
    return total


@code.inner(**INLINE)
def _moment_at(j, u, lasts, now, poly, span, n):
    """Interval of the period that a node of a step is in, the phase from the middle of that, and the
    momentum times the node's part of the time.
    """
    turns = (now - span[START] + GAUSS_NODES[j] * lasts) * span[FREQUENCY] * n
    interval = min(max(int(turns), 0), n - 1)
    part = GAUSS_WEIGHTS[j] * lasts * (_momentum_at(GAUSS_NODES[j] * u, poly) - span[MOMENTUM])
    return interval, 2.0 * math.pi * (turns - interval - 0.5) / n, part


@code.inner(**COMPILE)
def _add_moments(u, lasts, now, poly, span, moments):
    """Add the momentum over a step to its ``moments`` (n, m) about the middles of n equal intervals
    of the period: the integrals of it with the m-th powers of the phase from there.
    """
    n, terms = moments.shape
    i0, offset0, part0 = _moment_at(0, u, lasts, now, poly, span, n)
    i1, offset1, part1 = _moment_at(1, u, lasts, now, poly, span, n)
    i2, offset2, part2 = _moment_at(2, u, lasts, now, poly, span, n)
    i3, offset3, part3 = _moment_at(3, u, lasts, now, poly, span, n)
    for m in range(terms):  # side by side, because each power waits for the one before
        moments[i0, m] += part0
        moments[i1, m] += part1
        moments[i2, m] += part2
        moments[i3, m] += part3
        part0, part1, part2, part3 = (
            part0 * offset0,
            part1 * offset1,
            part2 * offset2,
            part3 * offset3,
        )


@code.inner(**FORCED)
def _end_step(row, left, level, x, p, t, w):
    """End the solved step as the recorded one of ``row`` ended: its fraction there."""
    if row[STEP_EVENT] >= 0.0:
        return _locate(row[STEP_PART], int(row[STEP_EVENT]), level, x, p, t, w)
    u = left / (t.longest * 0.5**level) if row[STEP_REACHES] != 0.0 else 1.0
    if u == 1.0:
        end_of_whole_step(level, p, x, t, w)
    else:
        solution_at(u, level, x, p, t, w)
    return u


@code.inner(**COMPILE)
def _take_up(row, off, w):
    """The recorded deficits, to begin from, with what they were ``off`` at the end of the last step."""
    for k in range(6):
        for j in range(4):
            w.r[k, j] = row[STEP_DEFICITS + 4 * k + j] + off[k]


@code.inner(**INLINE)
def _off_at_end(row, w):
    """Differences of the deficits from the recorded ones at the end of a step from which motion goes on
    smoothly; else nothing.
    """
    if row[STEP_EVENT] >= 0.0 or row[STEP_REACHES] != 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    last = STEP_DEFICITS + 3
    return (
        w.r[0, 3] - row[last],
        w.r[1, 3] - row[last + 4],
        w.r[2, 3] - row[last + 8],
        w.r[3, 3] - row[last + 12],
        w.r[4, 3] - row[last + 16],
        w.r[5, 3] - row[last + 20],
    )


@code.inner(**COMPILE)
def _note(u, row, w):
    """Note deficits and fraction of the step in its row."""
    row[STEP_PART] = u
    for k in range(6):
        for j in range(4):
            row[STEP_DEFICITS + 4 * k + j] = w.r[k, j]


@code.entry(**COMPILE)
def replay(
    stop: float, plan: Matrix, noted: bool, modes: Vector, moments: Matrix, span: Vector,
    x: State, p: Drive, t: Propagators, steps_t: Vector, steps_ref: Matrix,
    lanes: Matrix, flat: Vector, by_node: Matrix, room: Vector,
) -> int:  # fmt: skip
    """Advance the drive ``p`` to the time ``stop`` by the recorded steps ``plan`` (n, STEP_COLUMNS).

    ``noted``, deficits and fractions go back to ``plan``, from which others then begin. ``modes``
    (n,) become those of what had its event at the end of each step; where they are not those of the
    recorded run, another motion follows. ``moments`` (k, m) get those of the momentum and ``span``
    (N_SPAN,) what it gains. All else as ``propagate.advance``, ``t`` with an accuracy at which no
    iteration stops early. Returns a status code.
    """
    w, clock, coming = (
        work_of(x, p.elements.shape[0] + p.windings, lanes, flat, by_node, room),
        x.clock,
        0,
    )
    s, c = to_command_frame(x, p, t, w)
    off = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(plan.shape[0]):
        while coming < steps_t.size and steps_t[coming] <= clock[NOW]:
            add_reference_offset(w.x, 0.0, x, p)
            from_command_frame(w.x, x.y, x, p, t)
            take(steps_ref[coming], x, p)
            coming += 1
            s, c = to_command_frame(x, p, t, w)
        row, level = plan[i], int(plan[i, STEP_LEVEL])
        target = steps_t[coming] if coming < steps_t.size and steps_t[coming] < stop else stop
        target = before_ramp_ends(target, clock)
        _take_up(row, off, w)
        change = solve_collocation(level, False, s, c, x, p, t, w)
        if not math.isfinite(change):
            return NOT_FINITE
        u = _end_step(row, target - clock[NOW], level, x, p, t, w)
        off = _off_at_end(row, w)
        if noted:
            _note(u, row, w)
        end = target if row[STEP_REACHES] != 0.0 else clock[NOW] + u * t.longest * 0.5**level
        margins_at_nodes(p, x, w)
        fit_momentum(level, p, t, w)
        _add_moments(u, end - clock[NOW], clock[NOW], w.poly, span, moments)
        if i == 0:
            span[GAINED] = -w.poly[0]
        if i + 1 == plan.shape[0]:
            span[GAINED] += _momentum_at(u, w.poly)
        pass_time(end, clock)
        event = int(row[STEP_EVENT])
        move(event, x, p, t, w)
        modes[i] = x.stick[event] if event >= 0 else 0.0
        if not p.ideal:
            references_in_command_frame(s, c, x, p)
    add_reference_offset(w.x, 0.0, x, p)
    from_command_frame(w.x, x.y, x, p, t)
    return OK
