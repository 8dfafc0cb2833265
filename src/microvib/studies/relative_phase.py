"""Phases of lines against others of their clock, which no choice of time zero changes."""

from __future__ import annotations

import math

from microvib.signals.line_table import Line

PHASE_OF = {"drive": "drive_1", "electrical": "full_step_1"}
"""Line against which phases of a family of lines are taken."""


def family(line: str) -> str:
    """What the name of a driving line or of one of the electrical period begins with; of others,
    sidebands too, nothing.
    """
    stem, _, order = line.rpartition("_")
    if stem in PHASE_OF and order.isdigit():
        return stem
    return ""


def relative_phase(line: Line, against: Line) -> tuple[float, float]:
    """Phase [rad] of a line against another one of its clock, as no choice of time zero changes it,
    and its uncertainty.

    With the orders j and k of both, and their least common multiple m: (m/j) phi_j - (m/k) phi_k.
    The full step is the order 4 of the electrical period, with three phases 6, with five 10.
    """
    (family, _), (other, _) = map(_order, (line.line, against.line))
    steps = 1
    if family != other and "full_step" in (family, other):  # one is the electrical period's
        per_turn = [one.frequency_hz / _order(one.line)[1] for one in (line, against)]
        if not math.isfinite(sum(per_turn)):  # one of them is not there
            return math.nan, math.nan
        steps = round(max(per_turn) / min(per_turn))
    mine, its = phase_multiples(line.line, against.line, steps)
    value = mine * line.phase_rad - its * against.phase_rad
    return value, math.hypot(mine * line.phase_uncertainty_rad, its * against.phase_uncertainty_rad)


def phase_multiples(line: str, against: str, steps: int) -> tuple[int, int]:
    """m/j and m/k of two lines, with ``steps`` full steps in an electrical period where they are of
    both.
    """
    (family, mine), (other, its) = map(_order, (line, against))
    if family != other:
        mine, its = (
            order * steps if name == "full_step" else order
            for name, order in ((family, mine), (other, its))
        )
    common = math.lcm(mine, its)
    return common // mine, common // its


def _order(name: str) -> tuple[str, int]:
    """Family and order of a line."""
    stem, _, order = name.rpartition("_")
    return stem, int(order)
