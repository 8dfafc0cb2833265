"""Phases of lines against others of their clock, which no choice of time zero changes."""

from __future__ import annotations

import math

from microvib.model.line_names import (
    DRIVE,
    ELECTRICAL,
    FULL_STEP,
    LineName,
    driving_line,
    full_step_line,
)
from microvib.signals.line_table import Line

_REFERENCES = {DRIVE: driving_line(1), ELECTRICAL: full_step_line(1)}
"""Line against which phases of a family of lines are taken."""


def phase_reference(line: str) -> str:
    """The line against which the phase of another is taken; empty for those, sidebands among them,
    of which none is.
    """
    name = LineName.parse(line)
    if name.sideband or not name.order:
        return ""
    return _REFERENCES.get(name.family, "")


def relative_phase(line: Line, against: Line) -> tuple[float, float]:
    """Phase [rad] of a line against another one of its clock, as no choice of time zero changes it,
    and its uncertainty.

    With the orders j and k of both, and their least common multiple m: (m/j) phi_j - (m/k) phi_k.
    The full step is the order 4 of the electrical period, with three phases 6, with five 10.
    """
    mine, its = LineName.parse(line.name), LineName.parse(against.name)
    steps = 1
    if mine.family != its.family and FULL_STEP in (mine.family, its.family):
        # one is the electrical period's
        per_turn = [line.frequency / mine.order, against.frequency / its.order]
        if not math.isfinite(sum(per_turn)):  # one of them is not there
            return math.nan, math.nan
        steps = round(max(per_turn) / min(per_turn))
    m, n = phase_multiples(line.name, against.name, steps)
    value = m * line.phase - n * against.phase
    return value, math.hypot(m * line.phase_uncertainty, n * against.phase_uncertainty)


def phase_multiples(line: str, against: str, steps: int) -> tuple[int, int]:
    """m/j and m/k of two lines, with ``steps`` full steps in an electrical period where they are of
    both.
    """
    first, other = LineName.parse(line), LineName.parse(against)
    mine, its = first.order, other.order
    if first.family != other.family:
        mine, its = (
            name.order * steps if name.family == FULL_STEP else name.order
            for name in (first, other)
        )
    common = math.lcm(mine, its)
    return common // mine, common // its
