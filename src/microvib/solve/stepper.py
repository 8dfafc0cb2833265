"""Many drives in parallel: the kernel's step on lanes, one trial step of every drive at a time.

Arithmetic (``_attempt``) is done for all lanes at once, by the kernel's own functions. Decisions (accept, locate an event, take the
next microstep, close a sample) are made lane by lane, with the functions that decide for a single drive. Where the kernel's
``advance`` nests loops, a drive here has a phase, which says what its next trial is for. A lane whose drive has ended keeps
computing and its results are discarded; its neighbours cannot tell.

Only the disturbance torque is sampled. By momentum, its mean over an interval is the change of angular momentum divided by the
interval's length, so that the continuous extension at the ends of the interval is all that is needed.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from microvib.compiled import CountMatrix, Cube, Matrix, Unit
from microvib.solve import kernel
from microvib.solve.vector import WIDTH, rows, where

code = Unit(__name__, "kernel.py", "vector.py", "vector_type.py", types="microvib.solve.vector_type")

# PHASE: begin a step, try it, try half of it, locate an event in it. STATUS. Entries of DriveGroup.flags
BEGIN, TRY, HALVED, LOCATE = range(4)
RUNNING, DONE, WANTS_MICROSTEPS, FAILED, IDLE = range(5)
(
    STATUS, PHASE, CODE, EVENT, EVENTS, STALLED, COMING, KNOWN, FACTOR, TAPS, MISSING, ROWS, CLOSED, FILLED, SAMPLES, MADE, N_FLAGS,
) = range(17)  # fmt: skip
# entries of DriveGroup.control; a search for an event follows
(
    REQUESTED, LEFT, TARGET, KNOWN_UNTIL, END, FIRST, INTERVAL, RECORD_START, RECORD_END, OPEN, WEIGHT, LARGEST, STUCK, IMPULSE,
    SEARCH,
) = range(15)  # fmt: skip
N_CONTROL = SEARCH + kernel.N_SEARCH
# rows of DriveGroup.verdict: error, margins in the middle and at the end, angular momentum and its extension
ERROR, MIDDLE_M, MIDDLE_L, AFTER_M, AFTER_L, L_0, L_1, L_2, L_3, N_VERDICT = range(10)
ARRAYS = ("H", "D", "Lam", "te", "scale")
UNIFORM = ("rigid", "shaped")
NUMBERS = tuple(name for name in kernel.Drive._fields if name not in ARRAYS + UNIFORM)
LAYER, MAX_STEP = NUMBERS.index("layer"), NUMBERS.index("max_step")
Y1, BETWEEN, F0, F, DENSE, K = 0, 1, 2, 3, 4, 6  # blocks of n rows in the scratch of all lanes; what is left follows K
LEFT_OVER = K + kernel.STAGES
N_Q, N_JAC, N_LU = 7, 10, 17


class DriveGroup(NamedTuple):
    """WIDTH drives with as many modes and harmonics; rows are lanes unless said otherwise."""

    rigid: bool
    shaped: bool
    modes: int
    together: bool  # ``advance`` returns when no drive runs any more, instead of when the first one waits
    numbers: Matrix  # (numbers, WIDTH)
    arrays: Matrix  # (3 s + 3 h + n, WIDTH): H, D, Lam, te, scale
    numbers_of: Matrix  # the same by drive, (WIDTH, numbers)
    arrays_of: Matrix
    state: Matrix  # (n + 2 + N_CLOCK, WIDTH): y, stick, clock
    scratch: Matrix
    length: Matrix  # (1, WIDTH), of each drive's trial step
    taken: Matrix  # (1, WIDTH), 1 where that trial is accepted
    verdict: Matrix  # (N_VERDICT, WIDTH)
    one: Matrix  # scratch of one drive
    # by drive:
    control: Matrix
    flags: CountMatrix
    counters: CountMatrix
    times: Matrix  # (WIDTH, microsteps): times of the next microsteps
    references: Cube  # (WIDTH, microsteps, 3)
    taps: Matrix
    buffer: Matrix  # intervals that wait for the filter
    out: Matrix  # samples of T_d


def drive_group(
    rigid: bool, shaped: bool, modes: int, harmonics: int, *,
    taps: int, waiting: int, samples: int, microsteps: int, together: bool = False,
) -> DriveGroup:  # fmt: skip
    """Arrays for WIDTH drives of one kind, all lanes idle.

    For each drive there is room for ``samples`` results, a filter of ``taps`` with ``waiting`` more intervals, and ``microsteps``
    known in advance.
    """
    n, lane = kernel.MODES + 2 * modes, (WIDTH,)
    arrays = 3 * modes + 3 * harmonics + n
    scratch = LEFT_OVER * n + N_Q + N_JAC + N_LU + 2 * modes
    made = DriveGroup(
        rigid=rigid,
        shaped=shaped,
        modes=modes,
        together=together,
        numbers=np.zeros((len(NUMBERS), *lane)),
        arrays=np.zeros((arrays, *lane)),
        numbers_of=np.zeros((*lane, len(NUMBERS))),
        arrays_of=np.zeros((*lane, arrays)),
        state=np.zeros((n + 2 + kernel.N_CLOCK, *lane)),
        scratch=np.zeros((scratch, *lane)),
        length=np.zeros((1, *lane)),
        taken=np.zeros((1, *lane)),
        verdict=np.zeros((N_VERDICT, *lane)),
        one=np.zeros((9, max(n, kernel.N_CLOCK))),
        control=np.zeros((*lane, N_CONTROL)),
        flags=np.zeros((*lane, N_FLAGS), dtype=np.int64),
        counters=np.zeros((*lane, kernel.N_COUNTERS), dtype=np.int64),
        times=np.zeros((*lane, microsteps)),
        references=np.zeros((*lane, microsteps, 3)),
        taps=np.zeros((*lane, taps)),
        buffer=np.zeros((*lane, taps + waiting)),
        out=np.zeros((*lane, samples)),
    )
    made.flags[:, STATUS] = IDLE
    return made


def load_drive(c: DriveGroup, lane: int, drive: Any) -> None:
    """Give a lane its drive."""
    c.numbers[:, lane] = c.numbers_of[lane] = [getattr(drive, name) for name in NUMBERS]
    c.arrays[:, lane] = c.arrays_of[lane] = np.concatenate([getattr(drive, name) for name in ARRAYS])


@code.inner(**kernel.INLINE)
def _drive(v, rigid, shaped, H, D, Lam, te, scale):
    """Parameters from the numbers ``v``, in the order of NUMBERS."""
    return kernel.Drive(
        v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10], v[11], v[12], v[13], rigid, shaped,
        v[14], v[15], v[16], v[17], v[18], v[19], v[20], v[21], v[22], v[23],
        v[24], v[25], v[26], v[27], v[28], v[29], v[30], v[31], H, D, Lam, te, scale,
    )  # fmt: skip


@code.inner(**kernel.INLINE)
def _drive_of(lane, c):
    """Parameters of one drive, as floats."""
    s, v = c.modes, c.arrays_of[lane]
    te = v.size - kernel.MODES - 2 * s
    return _drive(c.numbers_of[lane], c.rigid, c.shaped, v[:s], v[s : 2 * s], v[2 * s : 3 * s], v[3 * s : te], v[te:])


@code.inner(**kernel.INLINE)
def _one(lane, c):
    """State and scratch for one drive."""
    n, one = kernel.MODES + 2 * c.modes, c.one
    x = kernel.State(one[0, :n], one[1, :2], one[2, : kernel.N_CLOCK], c.counters[lane], one[3])
    r = one[4]
    return x, kernel.Work(one[5, :n], one[6, :n], r, r, r, r, r, r, r, r, one[7:9], one[7:9], r)


@code.inner(**kernel.INLINE)
def _fetch(lane, c, y, x):
    """Copy a drive's state to ``x``, with ``y`` from an array of lanes."""
    n = x.y.size
    for j in range(n):
        x.y[j] = y[j, lane]
    x.stick[0], x.stick[1] = c.state[n, lane], c.state[n + 1, lane]
    for j in range(kernel.N_CLOCK):
        x.clock[j] = c.state[n + 2 + j, lane]


@code.entry(**kernel.COMPILE)
def initial_friction(c: DriveGroup) -> None:
    """Friction modes of each drive that is to run, from its state."""
    n = kernel.MODES + 2 * c.modes
    for lane in range(WIDTH):
        if c.flags[lane, STATUS] == RUNNING:
            x, _ = _one(lane, c)
            _fetch(lane, c, c.state, x)
            kernel.initial_friction(x, _drive_of(lane, c))
            c.state[n, lane], c.state[n + 1, lane] = x.stick[0], x.stick[1]


@code.inner(**kernel.FORCED)
def _begin(lane, c):
    """Take the microsteps that are due and choose the length of the next step."""
    k, g, clock = c.control[lane], c.flags[lane], kernel.MODES + 2 * c.modes + 2
    while True:
        now = c.state[clock + kernel.NOW, lane]
        if now >= k[END]:
            g[STATUS] = DONE
            return
        coming, target = g[COMING], k[END]
        if coming < g[KNOWN]:
            target = min(target, c.times[lane, coming])
        elif k[KNOWN_UNTIL] < k[END]:
            g[STATUS] = WANTS_MICROSTEPS
            return
        if target > now:
            break
        c.state[clock + kernel.REF_A, lane] = c.references[lane, coming, 0]
        c.state[clock + kernel.REF_B, lane] = c.references[lane, coming, 1]
        c.state[clock + kernel.THETA_E, lane] = c.references[lane, coming, 2]
        c.state[clock + kernel.NEXT_STEP, lane] = min(
            c.state[clock + kernel.NEXT_STEP, lane], c.numbers_of[lane, LAYER]
        )
        g[COMING] += 1
        c.counters[lane, kernel.MICROSTEPS] += 1
    k[TARGET], k[LEFT] = target, target - now
    k[REQUESTED] = kernel.first_length(c.state[clock + kernel.NEXT_STEP, lane], c.numbers_of[lane, MAX_STEP], k[LEFT])
    c.length[0, lane] = k[REQUESTED]
    g[PHASE] = TRY


@code.inner(**kernel.FORCED)
def _judge(lane, c):
    """Decide what follows a drive's trial step: another one, with another length, or the end of its step."""
    k, g, v, n = c.control[lane], c.flags[lane], c.verdict, kernel.MODES + 2 * c.modes
    h, error = c.length[0, lane], v[ERROR, lane]
    if not error <= 1.0:  # also while locating an event: a shorter step may be singular where a longer one was not
        c.counters[lane, kernel.REJECTED] += 1
        c.length[0, lane] = h = kernel.shortened(h, error)
        g[PHASE], g[CODE] = TRY, kernel.too_small(h, c.state[n + 2 + kernel.NOW, lane], error)
        g[STATUS] = FAILED if g[CODE] != kernel.OK else RUNNING
        return
    if g[PHASE] == TRY:
        factor = kernel.growth(error)
        proposed = c.state[n + 2 + kernel.NEXT_STEP, lane]
        c.state[n + 2 + kernel.NEXT_STEP, lane] = kernel.proposal(proposed, h, k[REQUESTED], k[LEFT], factor)
        g[EVENT], g[EVENTS] = -1, 0
        if min(v[MIDDLE_M, lane], v[MIDDLE_L, lane]) < 0.0 <= min(v[AFTER_M, lane], v[AFTER_L, lane]):
            c.length[0, lane] = 0.5 * h
            g[PHASE] = HALVED
            return
    elif g[PHASE] == LOCATE:
        c.counters[lane, kernel.EVENT_STEPS] += 1
        c.length[0, lane] = kernel.next_trial(h, v[AFTER_M + g[EVENT], lane], k[SEARCH:])
        if c.length[0, lane] != h:
            return
    event = kernel.next_event(g[EVENT], v[AFTER_M, lane], v[AFTER_L, lane])
    if event >= 0 and g[EVENTS] < kernel.MAX_EVENTS:
        g[EVENT], g[PHASE] = event, LOCATE
        g[EVENTS] += 1
        x, w = _one(lane, c)
        _fetch(lane, c, c.state, x)
        for j in range(n):
            w.y1[j] = c.scratch[Y1 * n + j, lane]
            w.dense[0, j], w.dense[1, j] = c.scratch[DENSE * n + j, lane], c.scratch[DENSE * n + n + j, lane]
        c.length[0, lane] = kernel.first_trial(event, h, v[AFTER_M + event, lane], x, _drive_of(lane, c), w, k[SEARCH:])
    else:
        _finish(lane, c, h)


@code.inner(**kernel.FORCED)
def _finish(lane, c, h):
    """Accept the step of length ``h``, with the event at its end."""
    k, g, n = c.control[lane], c.flags[lane], kernel.MODES + 2 * c.modes
    clock, p = n + 2, _drive_of(lane, c)
    now = c.state[clock + kernel.NOW, lane]
    # A step that reaches its target ends there to the last digit, so that sample intervals close where they should.
    end = k[TARGET] if h == k[LEFT] else now + h
    _sample(lane, c, now, end, h, p)
    c.state[clock + kernel.NOW, lane] = end
    c.counters[lane, kernel.STEPS] += 1
    if g[EVENT] >= 0 or p.rigid:
        x, _ = _one(lane, c)
        _fetch(lane, c, c.scratch, x)
        if g[EVENT] >= 0:
            kernel.decide_friction(g[EVENT], x, p)
        kernel.follow(x, p)
        for j in range(n):
            c.scratch[Y1 * n + j, lane] = x.y[j]
        c.state[n, lane], c.state[n + 1, lane] = x.stick[0], x.stick[1]
    lag = p.z * c.scratch[Y1 * n + kernel.TM, lane] - c.state[clock + kernel.THETA_E, lane]
    g[CODE], g[STALLED] = kernel.health(lag, h, end, g[STALLED])
    g[STATUS] = FAILED if g[CODE] != kernel.OK else RUNNING
    g[PHASE] = BEGIN
    c.taken[0, lane] = 1.0


@code.inner(**kernel.FORCED)
def _take(c):
    """Move the state of every drive whose step was accepted to the end of that step."""
    n = kernel.MODES + 2 * c.modes
    y, y1, taken = rows(c.state, 0, n, 1), rows(c.scratch, Y1 * n, n, 1), rows(c.taken, 0, 1, 1)
    for j in range(n):
        y[j] = where(taken[0] > 0.0, y1[j], y[j])
    taken[0] = 0.0


@code.inner(**kernel.INLINE)
def _momentum(s, lane, c, p):
    """Angular momentum at the fraction ``s`` of the step."""
    v, n, y = c.verdict, kernel.MODES + 2 * c.modes, c.scratch
    L = kernel.extension(s, v[L_0, lane], v[L_1, lane], v[L_2, lane], v[L_3, lane])
    if p.rigid:
        two, three = DENSE * n, DENSE * n + n
        theta = kernel.extension(
            s, c.state[kernel.TM, lane], y[kernel.TM, lane], y[two + kernel.TM, lane], y[three + kernel.TM, lane]
        )
        omega = kernel.extension(
            s, c.state[kernel.WM, lane], y[kernel.WM, lane], y[two + kernel.WM, lane], y[three + kernel.WM, lane]
        )
        _, e1, _, _ = kernel.transmission_error(theta, p.te)
        L += p.J_L * (e1 - p.inv_h) * omega
    return L


@code.inner(**kernel.FORCED)
def _sample(lane, c, now, end, h, p):
    """Close every sample interval that ends in the step; the momentum that an event removes is in none of them."""
    k, g = c.control[lane], c.flags[lane]
    L_a, L_end = _momentum(0.0, lane, c, p), _momentum(1.0, lane, c, p)
    k[IMPULSE] += L_a - L_end
    if c.state[kernel.MODES + 2 * c.modes + (0 if p.rigid else 1), lane] == 0.0:
        k[STUCK] += max(min(end, k[RECORD_END]) - max(now, k[RECORD_START]), 0.0)
    first, interval = k[FIRST], k[INTERVAL]
    if end <= first:
        return
    a, closed, change, weight = now, g[CLOSED], k[OPEN], k[WEIGHT]
    while a < end and closed < g[ROWS]:
        inside = a >= first
        boundary = first + (closed + 1) * interval if inside else first
        reaches = boundary <= end + 1e-6 * interval  # the last digits of two sums may differ
        b = min(boundary, end) if reaches else end
        L_b = _momentum((b - now) / h, lane, c, p) if b < end else L_end
        if inside:
            change += L_a - L_b
            weight += b - a
        if inside and reaches:
            closed += 1
            _close(lane, c, change / weight, closed)  # not the width: late in a run it is rounded
            change = weight = 0.0
        a, L_a = b, L_b
    g[CLOSED], k[OPEN], k[WEIGHT] = closed, change, weight


@code.inner(**kernel.FORCED)
def _close(lane, c, mean, closed):
    """Store an interval's mean; the first one also stands for the intervals before it."""
    k, g = c.control[lane], c.flags[lane]
    k[LARGEST] = max(k[LARGEST], math.fabs(mean))
    if closed == 1:
        for j in range(g[MISSING]):
            c.buffer[lane, j] = mean
        g[FILLED] = g[MISSING]
    c.buffer[lane, g[FILLED]] = mean
    g[FILLED] += 1
    if g[FILLED] == c.buffer.shape[1] or closed == g[ROWS]:
        _decimate(g, c.taps[lane], c.buffer[lane], c.out[lane])


@code.inner(**kernel.FORCED)
def _decimate(g, taps, buffer, out):
    """Compute the samples that the buffer completes; what later ones need moves to its beginning."""
    used = 0
    while used + g[TAPS] <= g[FILLED] and g[MADE] < g[SAMPLES]:
        # four sums, because each addition waits for the one before
        s0 = s1 = s2 = s3 = 0.0
        for j in range(0, g[TAPS] - 3, 4):
            s0 += taps[j] * buffer[used + j]
            s1 += taps[j + 1] * buffer[used + j + 1]
            s2 += taps[j + 2] * buffer[used + j + 2]
            s3 += taps[j + 3] * buffer[used + j + 3]
        for j in range(g[TAPS] - g[TAPS] % 4, g[TAPS]):
            s0 += taps[j] * buffer[used + j]
        out[g[MADE]] = (s0 + s1) + (s2 + s3)
        g[MADE] += 1
        used += g[FACTOR]
    for j in range(g[FILLED] - used):
        buffer[j] = buffer[used + j]
    g[FILLED] -= used


@code.inner(**kernel.FORCED)
def _attempt(c):
    """One trial step of every drive, from its state, with its length."""
    s, S, V = c.modes, c.scratch, c.verdict
    n = kernel.MODES + 2 * s
    rest = LEFT_OVER * n
    y, te = rows(c.state, 0, n, 1), c.arrays.shape[0] - n
    x = kernel.State(y, rows(c.state, n, 2, 1), rows(c.state, n + 2, kernel.N_CLOCK, 1), c.counters[0], c.one[3])
    p = _drive(
        rows(c.numbers, 0, c.numbers.shape[0], 1), c.rigid, c.shaped, rows(c.arrays, 0, s, 1), rows(c.arrays, s, s, 1),
        rows(c.arrays, 2 * s, s, 1), rows(c.arrays, 3 * s, te - 3 * s, 1), rows(c.arrays, te, n, 1),
    )  # fmt: skip
    q = rows(S, rest, N_Q, 1)
    rest += N_Q
    w = kernel.Work(
        rows(S, Y1 * n, n, 1), rows(S, BETWEEN * n, n, 1), rows(S, F0 * n, n, 1), rows(S, F * n, n, 1), q,
        rows(S, rest, N_JAC, 1), rows(S, rest + N_JAC, N_LU, 1),
        rows(S, rest + N_JAC + N_LU, s, 1), rows(S, rest + N_JAC + N_LU + s, s, 1), q, rows(S, K * n, kernel.STAGES * n, n),
        rows(S, DENSE * n, 2 * n, n), q,
    )  # fmt: skip
    verdict = rows(V, 0, N_VERDICT, 1)
    kernel.derivative(y, x.clock, x.stick, p, w.f0, w.q)
    kernel.linearise(x, p, w)
    verdict[ERROR] = kernel.step(rows(c.length, 0, 1, 1)[0], x, p, w)
    kernel.dense(w)
    kernel.interpolate(0.5, y, w)
    verdict[MIDDLE_M], verdict[MIDDLE_L] = kernel.margins(w.between, x.stick, p)
    verdict[AFTER_M], verdict[AFTER_L] = kernel.margins(w.y1, x.stick, p)
    verdict[L_0], verdict[L_1] = _linear_momentum(y, p), _linear_momentum(w.y1, p)
    verdict[L_2] = _linear_momentum(rows(S, DENSE * n, n, 1), p)
    verdict[L_3] = _linear_momentum(rows(S, DENSE * n + n, n, 1), p)


@code.inner(**kernel.INLINE)
def _linear_momentum(y, p):
    """The part of the angular momentum that is linear in the state; that of a rigidly geared output is not."""
    L = p.J_m * y[kernel.WM]
    if not p.rigid:
        L += p.J_L * y[kernel.WL]
    for k in range(p.H.size):
        L += p.H[k] * y[kernel.MODES + 2 * k + 1]
    return L


@code.entry(**kernel.COMPILE)
def advance(c: DriveGroup) -> None:
    """Advance all running drives until one of them (if ``together``, all) has ended or needs more microsteps."""
    judged, waits = False, False
    while True:
        runs = False
        for lane in range(WIDTH):
            g = c.flags[lane]
            if g[STATUS] == RUNNING:
                if judged and g[PHASE] != BEGIN:
                    _judge(lane, c)
                if g[STATUS] == RUNNING and g[PHASE] == BEGIN:
                    _begin(lane, c)
                waits |= g[STATUS] != RUNNING
                runs |= g[STATUS] == RUNNING
        _take(c)
        if (waits and not c.together) or not runs:
            return
        _attempt(c)
        judged = True
