"""A drive as seen from its command: the frame in which it is nearly linear, and the pattern of what
sticks in it.
"""

from microvib.compiled import Unit
from microvib.solve.kernel import (
    COMPILE,
    IA,
    IB,
    INLINE,
    RATE_A,
    RATE_B,
    REF_A,
    REF_B,
    SEEN_D,
    SEEN_Q,
    SEEN_RATE_D,
    SEEN_RATE_Q,
    THETA_E,
    TL,
    TM,
    WL,
    WM,
    XA,
    XB,
    elements_of,
    follow,
)  # fmt: skip
from microvib.solve.vector import sincos

code = Unit(__name__, "kernel.py")


@code.inner(**INLINE)
def references_in_command_frame(s, c, x, p):
    """How the references are off those of an ideal driver, seen from the command, and how fast they
    ramp.
    """
    clock = x.clock
    clock[SEEN_D] = clock[REF_A] * c + clock[REF_B] * s - p.current
    clock[SEEN_Q] = clock[REF_B] * c - clock[REF_A] * s
    clock[SEEN_RATE_D] = clock[RATE_A] * c + clock[RATE_B] * s
    clock[SEEN_RATE_Q] = clock[RATE_B] * c - clock[RATE_A] * s


@code.inner(**INLINE)
def reference_offset(dt, clock, s, c):
    """How the references of both phases are off those of an ideal driver, ``dt`` after now."""
    d, q = clock[SEEN_D] + dt * clock[SEEN_RATE_D], clock[SEEN_Q] + dt * clock[SEEN_RATE_Q]
    return d * c - q * s, q * c + d * s


@code.inner(**INLINE)
def command_direction(x, p):
    """Sine and cosine of the electrical angle from which currents are seen: that of the command, or
    none of windings that are switched, which stay apart.
    """
    if p.windings > 0:
        return 0.0, 1.0
    return sincos(x.clock[THETA_E])


@code.inner(**INLINE)
def to_command_frame(x, p, t, w):
    """The drive's state as seen from its command, into ``w.x``; a windup or current of the holding
    drive is 0 there.

    Currents are counted from their references, also where these are not ideal or ramp, so that the
    loop's integral is linear.
    """
    s, c = command_direction(x, p)
    y, angle = x.y, x.clock[THETA_E] * p.inv_z
    w.x[IA], w.x[IB] = y[IA] * c + y[IB] * s - t.current, y[IB] * c - y[IA] * s
    w.x[XA], w.x[XB] = y[XA] * c + y[XB] * s - t.windup, y[XB] * c - y[XA] * s
    w.x[TM], w.x[WM], w.x[TL], w.x[WL] = y[TM] - angle, y[WM], y[TL] + angle * p.inv_h, y[WL]
    if not p.ideal:
        references_in_command_frame(s, c, x, p)
        w.x[IA] -= x.clock[SEEN_D]
        w.x[IB] -= x.clock[SEEN_Q]
    return s, c


@code.inner(**INLINE)
def add_reference_offset(v, dt, x, p):
    """Count the currents in ``v`` from those of the ideal driver again, ``dt`` after now."""
    if not p.ideal:
        v[IA] += x.clock[SEEN_D] + dt * x.clock[SEEN_RATE_D]
        v[IB] += x.clock[SEEN_Q] + dt * x.clock[SEEN_RATE_Q]


@code.inner(**INLINE)
def from_command_frame(v, y, x, p, t):
    """The drive's state ``y`` from ``v``, as seen from its command; the angle of what sticks stays
    what it was, to the last bit.
    """
    s, c = command_direction(x, p)
    i_d, x_d, angle = v[IA] + t.current, v[XA] + t.windup, x.clock[THETA_E] / p.z
    y[IA], y[IB] = i_d * c - v[IB] * s, v[IB] * c + i_d * s
    y[XA], y[XB] = x_d * c - v[XB] * s, v[XB] * c + x_d * s
    y[TM] = x.y[TM] if x.stick[0] == 0.0 else v[TM] + angle
    y[TL] = x.y[TL] if x.stick[1] == 0.0 else v[TL] - angle * p.inv_h
    y[WM], y[WL] = v[WM], v[WL]
    follow(y, p)


@code.inner(**INLINE)
def stick_pattern(stick, p):
    """Which bodies stick; those with elements where most of their stiffness does."""
    if p.rigid:
        return 2 if stick[0] == 0.0 else 0
    on_rotor, on_output = stick[0] == 0.0, stick[1] == 0.0
    if p.m_elements > 0:
        on_rotor = _mostly_sticks(0, stick, p)
    if p.l_elements > 0:
        on_output = _mostly_sticks(1, stick, p)
    return (2 if on_rotor else 0) + (1 if on_output else 0)


@code.inner(**COMPILE)
def _mostly_sticks(body, stick, p):
    """Whether more than half the stiffness of a body's elements sticks."""
    balance = 0.0
    for e in elements_of(body, p):
        balance += p.elements[e, 0] if stick[2 + e] == 0.0 else -p.elements[e, 0]
    return balance > 0.0
