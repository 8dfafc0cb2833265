"""The hot loop by exact propagation: microsteps, and steps of suitable length that end at events.

A step is ``microvib.solve.collocation``'s. Read from the end: ``advance`` is the loop, and calls
what stands above it; ``advance_each`` calls it for many starts.
"""

import math

import numpy as np

from microvib.compiled import CountMatrix, Matrix, Unit, Vector
from microvib.solve.collocation import (
    N_SUMS,
    Work,
    error_estimate,
    extrapolate_deficits,
    fit_momentum,
    margins_at_nodes,
    set_error_weights,
    solve_collocation,
)
from microvib.solve.frame import (
    add_reference_offset,
    from_command_frame,
    references_in_command_frame,
    stick_pattern,
    to_command_frame,
)
from microvib.solve.kernel import (
    COMPILE,
    ENDLESS_EVENTS,
    FORCED,
    INLINE,
    MODES,
    N_CHANNELS,
    NOT_FINITE,
    NOW,
    OK,
    REJECTED,
    ROTOR_STICKS,
    STEP_TOO_SMALL,
    STEPS,
    STICKS,
    TM,
    WL,
    WM,
    Drive,
    Samples,
    State,
    backlash_side,
    before_pulse_ends,
    before_ramp_ends,
    decide_element,
    decide_friction,
    decide_winding,
    end_pulse,
    follow,
    follower,
    friction_torque,
    health,
    initial_friction,
    pass_time,
    pulse_is_over,
    start_pulse,
    take_microstep,
)
from microvib.solve.nodes import CUBES, FIRST_HALF, HALF, HIGHEST
from microvib.solve.propagators import (
    CONVERGED,
    GROW_BELOW,
    PATTERNS,
    N,
    Propagators,
)
from microvib.solve.samples import record_samples, record_step
from microvib.solve.step_events import (
    end_at_event,
    end_of_whole_step,
    first_root,
    solution_at,
)

code = Unit(__name__, "step_events.py", "samples.py")

# Kinds of a step, each with a memory of its own for each pattern: the first after a microstep or an
# event, the one after that, any other
AFTER_MICROSTEP, AFTER_EVENT, SECOND_AFTER_MICROSTEP, SECOND_AFTER_EVENT, FURTHER, KINDS = range(6)
SLOTS = KINDS * PATTERNS
FIRST_LEVEL = 4
"""Level at which steps of each kind are tried first."""
INITIAL_STEP_LEVELS = np.repeat([FIRST_LEVEL, 0], SLOTS)
"""``State.levels`` at first: for each kind and pattern a level; then how many steps shall pass
before a longer one is tried.
"""
PATIENCE = 16
"""Such steps after one that failed: motions nearly repeat from microstep to microstep, and so would
the failure.
"""
AFRESH = -1
"""In place of the step whose deficits go on in the next: none."""
FAR = 15.0
"""Rate over the Stribeck rate above which its excess is nothing."""
LAYER_ERROR = 0.3
"""Error that a step may be expected to have by Stribeck's excess alone, over the accuracy."""
DENSE_EVENTS, MAX_DENSE_EVENTS = 1e-3, 3_000_000
"""Spacing of events, over the longest step, below which they are dense; how many more of these than
fit into the time at that spacing there may be. Friction that sticks and breaks away without end lets
time pass, but hardly: the motion that it stands for is not one of these modes.
"""
UNRESOLVED = 1e-4
"""Change of the deficits, over what a microstep moves, that is accepted in the shortest steps:
where equations jump.
"""


@code.inner(**INLINE)
def work_of(x, margins, lanes, flat, by_node, room):
    """Scratch of a step in the memory given, with that many ``margins`` beside those of rotor and output;
    ``flat`` is that of ``lanes``.
    """
    n, modes = x.y.size, x.y.size - MODES
    count = N_CHANNELS + modes
    many = lanes[69 + n :]
    return Work(
        room[:N], flat[252:260], room[N : N + modes], room[N + modes : N + modes + n], lanes[:8], lanes[8:16],
        lanes[69 : 69 + n], many[:n], lanes[16:23], lanes[23:29], lanes[29:35], lanes[35 : 35 + N_SUMS],
        many[n + count + 3 + margins : n + count + 4 + margins], many[n + count + 3 : n + count + 3 + margins],
        many[n : n + count],
        by_node, lanes[45:53], lanes[53:61], lanes[63:65], lanes[61:63], flat[244:252], flat[268:274],
        flat[260:268], lanes[65:67], many[n + count : n + count + 1], many[n + count + 4 + margins :],
    )  # fmt: skip


@code.inner(**COMPILE)
def _layer_error(T, sign, rate, alpha, size, stribeck, inv_rate, shape, shaped):
    """Error that a step of length ``T`` will have by Stribeck's excess, where a body that slows
    down goes on at ``alpha``.

    ``size`` turns a torque over a time into what errors are measured in. Steps that ran into the
    layer where friction rises steeply would fail after all their iterations.
    """
    if sign * alpha >= 0.0 or stribeck == 0.0 or sign * (rate + alpha * T) * inv_rate > FAR:
        return 0.0
    total = 0.0
    for j in range(4):
        torque, _ = friction_torque(
            sign, rate + alpha * CUBES[j] * T, 0.0, stribeck, inv_rate, shape, 0.0, shaped
        )
        total += HIGHEST[j] * torque
    return math.fabs(total) * size * T


@code.inner(**INLINE)
def _expected_error(T, x, p, w):
    """The larger of these errors of rotor and output; ``alpha`` are those at the last step's end."""
    rate, alpha, size, J = w.x[WM], w.f[WM, 3], w.per_size[2], p.J_m
    if p.rigid:
        J += p.inv_h * p.inv_h * p.J_L
    own = _layer_error(
        T, x.stick[0], rate, alpha, size / J, p.m_stribeck, p.m_inv_rate, p.m_shape, p.shaped
    )
    sign, output, beta, of_output = x.stick[1], w.x[WL], w.f[WL, 3], w.per_size[3] * p.inv_J_L
    if p.rigid:
        sign, beta, of_output = (
            follower(x.stick[0], p),
            -p.inv_h * alpha,
            size / J * math.fabs(p.inv_h),
        )
    return max(
        own,
        _layer_error(
            T, sign, output, beta, of_output, p.l_stribeck, p.l_inv_rate, p.l_shape, p.shaped
        ),
    )


@code.inner(**INLINE)
def _time_in_gap(x, p, w):
    """Time in which teeth that touch nowhere cross half of their backlash at this rate; infinite
    where they touch.

    In a longer step they may cross all of it: that they leave one flank and meet the other could
    then not be told from each other.
    """
    if p.gap == 0.0 or backlash_side(x.stick, p) != 0.0:
        return math.inf
    return p.gap / (math.fabs(p.inv_h * w.x[WM] + w.x[WL]) + 1e-300)


@code.inner(**INLINE)
def _first_level(kind, left, x, p, t, w):
    """Level remembered from steps of this kind, and that to try first: at most the one that just
    reaches the end of what is ``left``, or that of which no failure is expected."""
    remembered = x.levels[kind * PATTERNS + stick_pattern(x.stick, p)]
    level = remembered
    while level < t.levels - 1 and t.longest * 0.5 ** (level + 1) >= left:
        level += 1
    while (
        level < t.levels - 1
        and _expected_error(t.longest * 0.5**level, x, p, w) > LAYER_ERROR * t.accuracy
    ):
        level += 1
    longest = _time_in_gap(x, p, w)
    while level < t.levels - 1 and t.longest * 0.5**level > longest:
        level += 1
    return remembered, level


@code.inner(**INLINE)
def _learn(kind, failed, grows, remembered, level, x, p):
    """Remember at which level to try the next step of this kind, and any other; ``grows``: this one
    could have been longer.
    """
    slot = kind * PATTERNS + stick_pattern(x.stick, p)
    if failed and kind != FURTHER:
        x.levels[SLOTS + slot] = PATIENCE
    waits = grows and x.levels[SLOTS + slot] > 0
    if waits:
        x.levels[SLOTS + slot] -= 1
    x.levels[slot] = max(min(remembered, level) - 1, 0) if grows and not waits else remembered
    x.levels[FURTHER * PATTERNS + stick_pattern(x.stick, p)] = max(level - 1, 0) if grows else level


@code.inner(**FORCED)
def _solved_step(kind, left, last_level, s, c, x, p, t, w, out):
    """Solve a step short enough for its iteration to converge and its error to pass; its level, and
    a status code.

    ``last_level`` is that of the step before, whose deficits go on in this one, or -1.
    """
    (remembered, level), onwards, failed = _first_level(kind, left, x, p, t, w), AFRESH, False
    if (
        kind >= SECOND_AFTER_MICROSTEP
        and last_level >= 0
        and last_level - 1 <= level <= last_level + 1
    ):
        onwards = HALF + last_level + 1 - level
    while True:
        if onwards >= 0:
            extrapolate_deficits(onwards, t, w)
        change, shortest = (
            solve_collocation(level, onwards < 0, s, c, x, p, t, w),
            level >= t.levels - 1,
        )
        set_error_weights(x, p, t, w)  # by the end of the step
        error, converged = error_estimate(level, t, w, out), change <= CONVERGED * t.accuracy
        if converged and error <= t.accuracy:
            break
        if shortest and (converged or change <= UNRESOLVED):
            break  # a kink, such as the supply's limit, inside the shortest step
        x.counters[REJECTED] += 1
        failed = True
        if shortest:
            return level, STEP_TOO_SMALL if math.isfinite(change) and math.isfinite(
                error
            ) else NOT_FINITE
        if converged and error <= 30.0 * t.accuracy:
            level, onwards = level + 1, FIRST_HALF
        else:
            level, onwards = (
                min(level + (2 if not error <= 1e3 * t.accuracy else 1), t.levels - 1),
                AFRESH,
            )
        remembered = level
    _learn(kind, failed, error < GROW_BELOW * t.accuracy, remembered, level, x, p)
    return level, OK


@code.inner(**FORCED)
def _end_step(level, left, x, p, t, w):
    """End the solved step at its first friction event or where nothing is ``left``: its fraction
    there, which friction or -1.
    """
    T = t.longest * 0.5**level
    u = left / T if left * (1.0 + 1e-12) < T else 1.0
    margins_at_nodes(p, x, w)
    first, event = 2.0, -1
    for which in range(2 + p.elements.shape[0] + p.windings):
        root = first_root(which, u, T, x, p, w)
        if root <= u and root <= first:
            first, event = root, which
    if event >= 0:
        return end_at_event(first, event, level, x, p, t, w), event
    if u == 1.0:
        end_of_whole_step(level, p, x, t, w)
    else:
        solution_at(u, level, x, p, t, w)
    return u, -1


@code.inner(**FORCED)
def move(event, x, p, t, w):
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
        elif event < 2 + p.elements.shape[0]:
            decide_element(event - 2, x, p)
        else:
            decide_winding(event - 2 - p.elements.shape[0], x, p)
        follow(x.y, p)
        to_command_frame(x, p, t, w)


@code.inner(**INLINE)
def _slip(event, x):
    """Direction in which the friction of an ``event`` slips; 0 where it sticks or there is none."""
    if event == 0 or event == 1:
        return x.stick[event]
    return 0.0


@code.inner(**INLINE)
def _shorten_after_event(level, x, p, t):
    """Try the next step after an event shorter than this one, which found a body at rest that is
    pushed on the way it went.

    A body comes to rest where it is held back. That the equations push it on there says that the
    torque, torque noise say, changes faster than the step's cubic through it tells. Steps of the
    same length would find it at rest again and again, each time sooner, and time would stand still.
    """
    slot = AFTER_EVENT * PATTERNS + stick_pattern(x.stick, p)
    x.levels[slot] = min(max(x.levels[slot], level + 1), t.levels - 1)


@code.inner(**FORCED)
def take(row, x, p):
    """Take a microstep, or a step of a pulsed drive."""
    if p.windings > 0:
        start_pulse(row, x, p)
    else:
        take_microstep(row, x)


@code.inner(**FORCED)
def _pulse_ends(x, p, t, w):
    """Whether a pulse ends now; its windings are then left."""
    if p.windings == 0 or not pulse_is_over(x.clock):
        return False
    from_command_frame(w.x, x.y, x, p, t)
    end_pulse(x, p)
    return True


@code.inner(**INLINE)
def _lag(p, w):
    """Electrical angle by which the rotor is off its command; none of a pulsed drive, whose lost
    steps are counted.
    """
    return 0.0 if p.windings > 0 else p.z * w.x[TM]


@code.inner(**FORCED)
def _record(u, end, event, reaches, level, x, p, t, w, out):
    """Samples of the step that ends at the time ``end``, its fraction ``u``; or the step itself."""
    if out.width > 0.0:
        fit_momentum(level, p, t, w)
        record_samples(u, end, level, x, p, t, w, out)
    elif out.cursor[0] < out.rows.shape[0]:
        record_step(u, event, reaches, level, w, out)


@code.inner(**INLINE)
def _crowd_after(event, lasted, crowd, t):
    """Events that are more than the time holds at the densest spacing, after a step that ``lasted`` so
    long.
    """
    if event >= 0:
        crowd += 1.0
    return max(0.0, crowd - lasted / (DENSE_EVENTS * t.longest))


@code.inner(**INLINE)
def _kind_after(event, u, kind, level):
    """Kind of the step after one that took its fraction ``u``, and the level to go on from, or -1."""
    if event >= 0:
        return AFTER_EVENT, -1
    if u < 1.0:
        return FURTHER, -1
    return kind + 2 if kind <= AFTER_EVENT else FURTHER, level


@code.entry(**COMPILE)
def advance(
    stop: float, x: State, p: Drive, t: Propagators, out: Samples, steps_t: Vector, steps_ref: Matrix,
    lanes: Matrix, flat: Vector, by_node: Matrix, room: Vector,
) -> int:  # fmt: skip
    """Advance the drive ``p`` to the time ``stop``; state ``x`` and samples ``out`` are updated in
    place.

    Each turn of the loop either takes a microstep that is due, or one step: shortened until its
    iteration converges and its error estimate passes, and ended at the next microstep or at the
    first friction event inside it.

    ``steps_t`` (n,) are the times of the microsteps before ``stop``, ``steps_ref`` (n, 4) the
    references i_A*, i_B*, the electrical angle after each and the time of the ramp there;
    ``lanes``, ``flat`` (the same memory), ``by_node`` (4, channels) and ``room`` are scratch.
    Returns a status code.
    """
    w, clock, coming, stalled, crowd, status = (
        work_of(x, p.elements.shape[0] + p.windings, lanes, flat, by_node, room),
        x.clock,
        0,
        0,
        0.0,
        OK,
    )
    s, c = to_command_frame(x, p, t, w)
    kind, last_level = FURTHER, -1
    while clock[NOW] < stop:
        target = stop
        if coming < steps_t.size and steps_t[coming] < stop:
            target = steps_t[coming]
        target = before_pulse_ends(before_ramp_ends(target, clock), clock)
        left = target - clock[NOW]
        if left <= 0.0:
            add_reference_offset(w.x, 0.0, x, p)
            from_command_frame(w.x, x.y, x, p, t)
            take(steps_ref[coming], x, p)
            coming += 1
            s, c = to_command_frame(x, p, t, w)
            kind = AFTER_MICROSTEP
            continue
        level, status = _solved_step(kind, left, last_level, s, c, x, p, t, w, out)
        if status != OK:
            break
        u, event = _end_step(level, left, x, p, t, w)
        T = t.longest * 0.5**level
        # A step that reaches its target ends there to the last digit, so that sample intervals
        # close where they should.
        reaches = event < 0 and left * (1.0 - 1e-12) <= T
        end = target if reaches else clock[NOW] + u * T
        _record(u, end, event, reaches, level, x, p, t, w, out)
        x.counters[STEPS] += 1
        lasted = end - clock[NOW]
        ramp_ends = pass_time(end, clock)
        slipped = _slip(event, x)
        move(event, x, p, t, w)
        if slipped != 0.0 and _slip(event, x) == slipped:
            _shorten_after_event(level, x, p, t)
        if not p.ideal:
            references_in_command_frame(s, c, x, p)
        kind, last_level = _kind_after(event, u, kind, level)
        if _pulse_ends(x, p, t, w) or ramp_ends:
            kind, last_level = AFTER_MICROSTEP, -1
        status, stalled = health(_lag(p, w), lasted, clock[NOW], stalled)
        crowd = _crowd_after(event, lasted, crowd, t)
        if crowd > MAX_DENSE_EVENTS:
            status = ENDLESS_EVENTS
        if status != OK:
            break
    add_reference_offset(w.x, 0.0, x, p)
    from_command_frame(w.x, x.y, x, p, t)
    return status


@code.inner(**COMPILE)
def _copy(source, target):
    for i in range(source.size):
        target[i] = source[i]


@code.entry(**COMPILE)
def advance_each(
    y: Matrix, begun: Matrix, steps: CountMatrix, stops: Vector, sticks: Matrix, sticking: CountMatrix,
    x: State, p: Drive, t: Propagators, out: Samples, steps_t: Vector, steps_ref: Matrix,
    lanes: Matrix, flat: Vector, by_node: Matrix, room: Vector,
) -> int:  # fmt: skip
    """Advance the drive from each of the states ``y`` (k, n), which the ends replace, with its
    clock ``begun`` (k, N_CLOCK).

    Each makes the microsteps between two numbers, ``steps`` (k, 2), and ends at one of the times
    ``stops`` (k,); ``out`` has as many rows for every microstep made, or none. ``sticks`` (k, 4)
    becomes the modes of rotor and output at the beginning and at the end, ``sticking`` (k, 2) how
    often the rotor and how often either has come to rest. Returns the first status that is not OK.
    """
    made, done = 0, 0
    for j in range(stops.size):
        made += steps[j, 1] - steps[j, 0]
    each = out.rows.shape[0] // max(made, 1)
    for j in range(stops.size):
        _copy(y[j], x.y)
        _copy(begun[j], x.clock)
        _copy(INITIAL_STEP_LEVELS, x.levels)
        x.energy[:] = 0.0
        out.partial[:] = 0.0
        out.cursor[:] = 0
        initial_friction(x, p)
        rotor, either = x.counters[ROTOR_STICKS], x.counters[STICKS]
        sticks[j, 0], sticks[j, 1] = x.stick[0], x.stick[1]
        first, last = steps[j, 0], steps[j, 1]
        rows = each * (last - first)
        own = Samples(
            begun[j, NOW], out.width, out.rows[done : done + rows], out.partial, out.cursor, out.mix,
            out.rates_shown, out.currents_shown,
        )  # fmt: skip
        status = advance(
            stops[j],
            x,
            p,
            t,
            own,
            steps_t[first:last],
            steps_ref[first:last],
            lanes,
            flat,
            by_node,
            room,
        )
        if status != OK:
            return status
        done += rows
        _copy(x.y, y[j])
        sticks[j, 2], sticks[j, 3] = x.stick[0], x.stick[1]
        sticking[j, 0], sticking[j, 1] = (
            x.counters[ROTOR_STICKS] - rotor,
            x.counters[STICKS] - either,
        )
    return OK
