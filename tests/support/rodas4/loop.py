"""RODAS4 steps (``support.rodas4.rosenbrock``) with located friction events.

Friction events end a step: each is located by repeating the step with other lengths until it ends
on the event. Nothing here rests on what is linear in a drive, so that this checks
``microvib.solve.propagate``.

Read from the end: ``advance`` is the loop, and calls what stands above it, section by section: the
search for an event (``first_trial``, ``next_trial``), samples (``_record``) and the length of
steps.
"""

import math

from microvib.compiled import Matrix, Unit, Vector
from microvib.solve.kernel import (
    COMPILE,
    EVENT_STEPS,
    IMPULSE,
    INLINE,
    LARGEST,
    MISMATCH,
    N_CHANNELS,
    N_POWERS,
    NEXT_STEP,
    NOT_FINITE,
    NOW,
    OK,
    POWERS,
    REJECTED,
    STEP_TOO_SMALL,
    STEPS,
    T_D,
    T_D_FORCE,
    THETA_E,
    TM,
    WEIGHT,
    WL,
    WM,
    Drive,
    Samples,
    State,
    before_ramp_ends,
    breakaway_torques,
    channels,
    decide_friction,
    derivative,
    follow,
    health,
    margins,
    pass_time,
    references_after,
    take_microstep,
)
from support.rodas4.rosenbrock import (
    STAGES,
    Work,
    dense,
    interpolate,
    linearise,
    step,
)

code = Unit(__name__, "rosenbrock.py")

# entries of the search for an event: bracket [LO, HI] in the length of the step, margins there,
# tolerance, trials so far
LO, HI, E_LO, E_HI, ENOUGH, TRIALS, N_SEARCH = range(7)
MAX_TRIALS, MAX_EVENTS = 80.0, 4
SCRATCH_ROWS = 19
GAUSS = 0.5 / math.sqrt(3.0)  # nodes of the two-point rule, from the middle, over the length


# ---- Search for an event ----
#
# A step is first made as if no friction's mode ended. If a margin (``microvib.solve.kernel``) is
# negative at its end, the event lies inside, and the step is repeated with shorter lengths until it
# ends where the margin is just spent (``_shorten_to_event``). ``first_trial`` takes the first
# length from the continuous extension, which costs no step; ``next_trial`` improves it by the ends
# of steps actually made, so that the time of the event is as accurate as the step.


@code.inner(**COMPILE)
def first_trial(which, h, e_hi, x, p, w):
    """Begin the search for the length, below ``h``, at which the margin ``which`` is just spent;
    returns the first trial.

    ``e_hi`` < 0 is the margin at the end of the step of length ``h``, whose continuous extension
    supplies the trial, by false position. The search starts with the bracket [0, h]. The event
    counts as found where the margin is at most ``enough`` below zero: a thousandth of the tolerance
    in rate, or a millionth of the breakaway torque.
    """
    search, slips = w.search, x.stick[which] != 0.0
    enough = (
        1e-3 / w.scale[WM if which == 0 else WL]
        if slips
        else 1e-6 * breakaway_torques(p, -p.inv_h, 1.0)[which]
    )
    e_lo = margins(x.y, 0.0, x.stick, p)[which]
    search[LO], search[HI], search[E_LO], search[E_HI], search[ENOUGH], search[TRIALS] = (
        0.0,
        h,
        e_lo,
        e_hi,
        enough,
        0.0,
    )
    s_lo, s_hi, g_lo, g_hi = 0.0, 1.0, e_lo, e_hi
    for _ in range(6):
        # The margin at the start is zero right after an event; false position would then stay
        # there.
        s = s_lo + (s_hi - s_lo) * (g_lo / (g_lo - g_hi) if g_lo > 0.0 else 0.25)
        interpolate(s, x.y, w)
        e = margins(w.between, 0.0, x.stick, p)[which]
        if e < 0.0:
            s_hi, g_hi = s, e
        else:
            s_lo, g_lo = s, e
        if math.fabs(e) < enough:
            break
    return h * s_hi


@code.inner(**COMPILE)
def next_trial(trial, e, search):
    """The next length to try, after the step of length ``trial`` ended with the margin ``e``;
    ``trial`` itself once it is found.

    False position in its Illinois variant: where the upper end moves again, the margin at the lower
    end is halved, which keeps the bracket from shrinking from one side only. It ends on the upper
    end of the bracket, just past the event.
    """
    lo, hi, e_lo, e_hi, enough = search[LO], search[HI], search[E_LO], search[E_HI], search[ENOUGH]
    if e < 0.0:
        hi, e_hi = trial, e
        e_lo *= 0.5 if search[TRIALS] > 0.0 else 1.0
    else:
        lo, e_lo = trial, e
    search[LO], search[HI], search[E_LO], search[E_HI] = lo, hi, e_lo, e_hi
    search[TRIALS] += 1.0
    if search[TRIALS] == MAX_TRIALS:
        return trial
    if e_hi >= -enough or hi - lo <= 1e-12 * hi:
        return hi
    if e_lo > 0.0:
        # Aim slightly past the root: the step must end on its far side, with the margin in
        # [-enough, 0].
        trial = lo + (hi - lo) * (e_lo + 0.5 * enough) / (e_lo - e_hi)
        return min(max(trial, lo + 1e-3 * (hi - lo)), hi - 1e-3 * (hi - lo))
    return 0.25 * hi  # no margin at the start, right after an event: nothing to interpolate


@code.inner(**INLINE)
def next_event(which, after_m, after_l):
    """The friction whose event the step must end at, -1 if none: once that of ``which`` is located,
    only the other is earlier.
    """
    if which < 0:
        return 0 if after_m < 0.0 else (1 if after_l < 0.0 else -1)
    other = after_l if which == 0 else after_m
    return 1 - which if other < 0.0 else -1


@code.inner(**COMPILE)
def _shorten_to_event(which, h, e_hi, x, p, w):
    """Repeat the step until it ends where the margin ``which`` is just spent; returns its length
    and its error.

    An error above 1 ends the search: where friction falls steeply with the rate, a shorter step may
    be singular although the longer one was not.
    """
    trial = first_trial(which, h, e_hi, x, p, w)
    while True:
        error = step(trial, x, p, w)
        x.counters[EVENT_STEPS] += 1
        if not error <= 1.0:
            return trial, error
        following = next_trial(trial, margins(w.y1, 0.0, x.stick, p)[which], w.search)
        if following == trial:
            return trial, error
        trial = following


@code.inner(**COMPILE)
def _end_at_first_event(h, x, p, w):
    """Shorten the step in ``w`` so that it ends at its first friction event; its length, which
    friction or -1, and its error.

    Margins are checked in the middle and at the end of the step: a margin spent in the middle and
    regained at the end (a body that reverses twice) is met by halving the step. Locating one event
    may bring the other friction's to light, which is then earlier; so both are checked again. A
    step with an error above 1 must not be taken.
    """
    interpolate(0.5, x.y, w)
    middle, after, error = margins(w.between, 0.0, x.stick, p), margins(w.y1, 0.0, x.stick, p), 0.0
    if min(middle[0], middle[1]) < 0.0 <= min(after[0], after[1]):
        h *= 0.5
        error = step(h, x, p, w)
        dense(w)
        after = margins(w.y1, 0.0, x.stick, p)
    event = -1
    for _ in range(MAX_EVENTS):
        which = next_event(event, after[0], after[1])
        if which < 0 or not error <= 1.0:
            break
        event = which
        h, error = _shorten_to_event(event, h, after[event], x, p, w)
        dense(w)
        after = margins(w.y1, 0.0, x.stick, p)
    return h, event, error


# ---- Samples ----


@code.inner(**INLINE)
def _record(h, end, x, p, w, out):
    """Integrate all channels over the step to ``end``; close every sample interval that ends inside
    it.

    A sample is the mean over its interval, by Gauss quadrature on each piece of it: two points, or
    one where a piece is less than a tenth of a step. Pieces end where steps end and steps end at
    events, so jumps are averaged exactly, not sampled.
    """
    clock, cursor, values = x.clock, out.cursor, w.channels
    t = a = clock[NOW]
    while a < end:
        recording = cursor[0] < out.rows.shape[0]
        inside = recording and a >= out.first
        boundary = out.first + (cursor[0] + cursor[1] + 1) * out.width if inside else out.first
        reaches = (
            recording and boundary <= end + 1e-6 * out.width
        )  # the last digits of two sums may differ
        b = min(boundary, end) if reaches else end
        nodes = 1 if b - a < 0.1 * h else 2
        weight = (b - a) / nodes
        for node in range(nodes):
            point = 0.5 * (a + b) + (0.0 if nodes == 1 else (2.0 * node - 1.0) * GAUSS * (b - a))
            interpolate((point - t) / h, x.y, w)
            channels(
                w.between, references_after(point - t, clock), 0.0, x.stick, p, w.f, w.q, values
            )
            for j in range(N_POWERS):
                x.energy[j] += weight * values[POWERS + j]
            clock[IMPULSE] += weight * values[T_D_FORCE]
            clock[MISMATCH] = max(clock[MISMATCH], math.fabs(values[T_D] - values[T_D_FORCE]))
            clock[LARGEST] = max(clock[LARGEST], math.fabs(values[T_D]))
            if inside:
                clock[WEIGHT] += weight
                for j in range(values.size):
                    out.partial[j] += weight * values[j]
        if reaches and inside:
            for j in range(values.size):
                out.rows[cursor[0], j] = (
                    out.partial[j] / clock[WEIGHT]
                )  # not the width: late in a run it is rounded
                out.partial[j] = 0.0
            clock[WEIGHT] = 0.0
            for j in range(N_POWERS):  # energies: their values at the middle of the interval
                out.rows[cursor[0], POWERS + j] = (
                    x.energy[j] - 0.5 * out.width * out.rows[cursor[0], POWERS + j]
                )
            cursor[0] += 1
        a = b


# ---- Length of steps ----


@code.inner(**INLINE)
def first_length(proposed, longest, left):
    """Length to try first, with ``left`` to go to the target; a remainder of less than 1.5 steps is
    halved, not cut short.
    """
    h = min(proposed, longest)
    if h >= left:
        return left
    return 0.5 * left if 1.5 * h > left else h


@code.inner(**INLINE)
def growth(error):
    """Factor on the length of a step that would bring its ``error`` to 1, with a safety margin,
    from 0.2 to 5.
    """
    return min(5.0, max(0.2, 0.9 / math.sqrt(math.sqrt(error)))) if error > 0.0 else 5.0


@code.inner(**INLINE)
def shortened(h, error):
    """Length of the next trial after one of length ``h`` was rejected."""
    return h * (growth(error) if math.isfinite(error) else 0.1)


@code.inner(**INLINE)
def proposal(proposed, h, requested, left, factor):
    """Length for the next step. A step cut short by its target says nothing against the length
    proposed before.
    """
    return h * factor if h < requested or h < left else max(h * factor, proposed)


@code.inner(**INLINE)
def too_small(h, now, error):
    """Status after a rejected step that is to be repeated with the length ``h``."""
    if h < 1e-14 * max(1.0, now):
        return STEP_TOO_SMALL if math.isfinite(error) else NOT_FINITE
    return OK


@code.inner(**INLINE)
def _accepted_step(left, x, p, w):
    """Step from ``x.y`` that passes the error test, at most ``left`` long, into ``w``; its length,
    and a status code.
    """
    h = requested = first_length(x.clock[NEXT_STEP], p.max_step, left)
    while True:
        error = step(h, x, p, w)
        factor = growth(error)
        if error <= 1.0:
            break
        x.counters[REJECTED] += 1
        h = shortened(h, error)
        status = too_small(h, x.clock[NOW], error)
        if status != OK:
            return h, status
    x.clock[NEXT_STEP] = proposal(x.clock[NEXT_STEP], h, requested, left, factor)
    return h, OK


# ---- The loop ----


@code.entry(**COMPILE)
def advance(
    stop: float,
    x: State,
    p: Drive,
    scale: Vector,
    out: Samples,
    steps_t: Vector,
    steps_ref: Matrix,
    scratch: Matrix,
) -> int:
    """Advance the drive ``p`` to the time ``stop``; state ``x`` and samples ``out`` are updated in
    place.

    Each turn of the loop either takes a microstep that is due (new current references, and a step
    short enough for the transient that follows), or one step: to the next microstep at most,
    shortened until its error estimate passes, shortened again to the first friction event inside
    it. Only then are samples integrated and the state moved on.

    ``steps_t`` (n,) are the times of the microsteps before ``stop``, ``steps_ref`` (n, 4) the
    references i_A*, i_B*, the electrical angle after each and the time of the ramp there,
    ``scratch`` (SCRATCH_ROWS, wide enough). Returns a status code.
    """
    n, s = x.y.size, p.H.size
    w = Work(
        scratch[0, :n], scratch[1, :n], scratch[2, :n], scratch[3, :n], scratch[4], scratch[5], scratch[6],
        scratch[7], scratch[8], scratch[9, : N_CHANNELS + 2 * s], scratch[10 : 10 + STAGES, :n], scratch[16:18, :n], scratch[18], scale,
    )  # fmt: skip
    clock, coming, stalled = x.clock, 0, 0
    while clock[NOW] < stop:
        target = stop
        if coming < steps_t.size and steps_t[coming] < stop:
            target = steps_t[coming]
        if target <= clock[NOW]:
            take_microstep(steps_ref[coming], x)
            coming += 1
            clock[NEXT_STEP] = min(clock[NEXT_STEP], p.layer)
            continue
        target = before_ramp_ends(target, clock)
        derivative(x.y, references_after(0.0, clock), 0.0, x.stick, p, w.f0, w.q)
        linearise(x, p, w)
        left = target - clock[NOW]
        h, status = _accepted_step(left, x, p, w)
        if status != OK:
            return status
        dense(w)
        h, event, error = _end_at_first_event(h, x, p, w)
        if not error <= 1.0:
            x.counters[REJECTED] += 1
            clock[NEXT_STEP] = shortened(h, error)
            status = too_small(clock[NEXT_STEP], clock[NOW], error)
            if status != OK:
                return status
            continue
        # A step that reaches its target ends there to the last digit, so that sample intervals
        # close where they should.
        end = target if h == left else clock[NOW] + h
        if out.width > 0.0:
            _record(h, end, x, p, w, out)
        x.counters[STEPS] += 1
        if pass_time(end, clock):
            clock[NEXT_STEP] = min(clock[NEXT_STEP], p.layer)
        for j in range(n):
            x.y[j] = w.y1[j]
        if event >= 0:
            decide_friction(event, x, p)
        follow(x.y, p)
        status, stalled = health(p.z * x.y[TM] - clock[THETA_E], h, clock[NOW], stalled)
        if status != OK:
            return status
    return OK
