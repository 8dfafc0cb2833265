"""Whether a recording is what its lines say: which of them count, what it holds beyond them, and
what that leaves of a verdict.

All lines of a recording come with this (``lines.lines_of_samples``), and all that judges them asks
here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from microvib.signals.clock import MAINS_BINS, near_mains
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_fit import NO_ORDER
from microvib.signals.line_table import Line, LineTable
from microvib.signals.orders import is_slower_than_full_steps
from microvib.signals.unaccounted import Excess, excesses, joined

RINGS = 2.0
"""Factor on modes that ring while they are recorded: they need not fall as exponentials do."""
_BESIDE = 1.25
"""Ratio of frequencies within which an unlisted line beside a larger one may be what a change of
rate or load makes of that: bursts of four periods and more, with pauses between them, make lines no further away.
"""
_BESIDE_BINS = 4.0
"""Bins of the record within which it is so, too: what lasts for half of the record or more."""
BLURRED = 0.3
"""Part of a line's amplitude from which what its band holds beyond the lines leaves open how large
it is.
"""
_LARGE = 0.1
"""Part of a recording's largest line from which others are worth a note."""


def with_excess(table: LineTable, x: np.ndarray) -> LineTable:
    """Lines of a recording's samples ``x`` (n,), with what these hold beyond the lines and the
    floor.
    """
    seen = [line for line in table if line.seen]
    counted = [_doubled(line) for line in seen if _counts(line, seen, table)]
    beyond = excesses(x, table.sample_rate, counted, seen)
    parted = _parted_lines(seen, table.duration)
    return replace(table, excess=tuple(sorted((*beyond, *parted), key=lambda one: one.low)))


def _parted_lines(seen: Sequence[Line], duration: float) -> Iterator[Excess]:
    """Lines beside larger ones that may be parts of one which is there for a part of the record, once
    or again and again: while it is, it is as large as all of them together.

    So it is where they are at fractions of the clock, too: a drive that starts and stops with its
    electrical periods has them as well as one whose steady motion repeats with several of these.
    """
    for group in _with_lines_beside(seen, duration):
        sizes = np.array([_largest_in_record(line, duration) for line in group])
        largest = float(sizes.max())
        together = float(sizes.sum())
        places = [line.frequency for line in group]
        yield Excess(
            min(places), max(places), math.sqrt(0.5 * (together**2 - largest**2)),
            math.sqrt(0.5) * together, math.sqrt(0.5) * largest, 0.0, duration, 1.0,
        )  # fmt: skip


def _with_lines_beside(seen: Sequence[Line], duration: float) -> list[list[Line]]:
    """Groups of lines: first one, then the unlisted ones beside it that may be parts of it, as it is
    the largest near them.
    """
    groups: dict[int, list[Line]] = {}
    for line in seen:
        near = _larger_beside(line, seen, duration)
        if not near or _of_each_full_step(line):
            continue
        largest = max(near, key=lambda k: seen[k].amplitude)
        groups.setdefault(largest, [seen[largest]]).append(line)
    return list(groups.values())


def _of_each_full_step(line: Line) -> bool:
    """Whether an unlisted line is one that the clock makes within a microstep or a full step, in which
    no drive starts and stops.
    """
    named = bool(line.origin) and line.origin != NO_ORDER
    return named and not is_slower_than_full_steps(line.origin)


def _largest_in_record(line: Line, duration: float) -> float:
    """Amplitude of a line at its largest, at the start of a record or, if it grows, at the end."""
    return replace(line, decay=abs(line.decay)).amplitude_at_start(duration)


def may_be_larger(table: LineTable, limit: LimitCurve) -> Iterator[str]:
    """Sentences on bands in which lines may be above the ``limit``, as nothing steady is: above the
    least that it allows in such a band.
    """
    above = [
        one
        for one in table.excess
        if one.high >= limit.low
        and one.low <= limit.high
        and _largest(table, one) > limit.strictest(one.low, one.high)
    ]
    for group in joined(above):
        yield max(group, key=lambda one: one.rms).sentence()


def blurred(table: LineTable, line: Line) -> bool:
    """Whether the amplitude of a line of the clock is uncertain because of what its band holds
    beyond the lines.
    """
    near = (
        one.amplitude for one in table.excess if one.certain and one.low <= line.place <= one.high
    )
    return line.of_clock and max(near, default=0.0) > BLURRED * line.amplitude


def steadiness_notes(table: LineTable) -> Iterator[str]:
    """Sentences on bands in which it leaves open how large the clock's larger lines are that a
    recording holds more than lines.
    """
    certain = [one for one in table.excess if one.certain]
    largest = max([table.largest, *(one.amplitude for one in certain)])
    bands = [one for one in certain if _hides_clock_line(table, one, _LARGE * largest)]
    for group in joined(bands):
        yield max(group, key=lambda one: one.rms).sentence()


def _hides_clock_line(table: LineTable, one: Excess, least: float) -> bool:
    """Whether a band leaves open how large one of the clock's lines in it is that is, or may be,
    larger than ``least``.
    """
    inside = [x for x in table if x.of_clock and one.low <= x.place <= one.high]
    if any(x.seen and x.amplitude > least and blurred(table, x) for x in inside):
        return True
    return one.amplitude > least and not all(x.seen for x in inside)


def _largest(table: LineTable, one: Excess) -> float:
    """Upper bound of a line in the band: the largest that is known, and all that is beyond them on
    top.
    """
    sizes = (x.amplitude for x in table if x.seen and one.low <= x.place <= one.high)
    return math.hypot(max(sizes, default=0.0), one.amplitude)


def _doubled(line: Line) -> Line:
    rings = line.is_mode and line.status == "decaying"
    if rings:
        return replace(line, amplitude=RINGS * line.amplitude)
    return line


def _counts(line: Line, seen: Sequence[Line], table: LineTable) -> bool:
    """Whether a line is one of its own: a listed one, or an unlisted one that the clock makes, or
    that no modulation of a larger one does.
    """
    if line.origin and line.origin != NO_ORDER:
        return True
    return not _larger_beside(line, seen, table.duration)


def _larger_beside(line: Line, seen: Sequence[Line], duration: float) -> list[int]:
    """Numbers of the larger lines beside an unlisted one.

    The mains may be beside a larger line of the drive. Of several lines at one of their multiples
    the largest counts alone, since what comes and goes there is parted into several, too.
    """
    if line.kind != "other":
        return []
    larger = [k for k, x in enumerate(seen) if x.amplitude > line.amplitude]
    if near_mains(line.frequency, duration) and not any(
        abs(seen[k].frequency - line.frequency) * duration < 2.0 * MAINS_BINS for k in larger
    ):
        return []
    return [k for k in larger if _is_beside(line, seen[k], duration)]


def _is_beside(line: Line, larger: Line, duration: float) -> bool:
    """Whether a line may be what a change in the record makes of a ``larger`` one."""
    if abs(larger.frequency - line.frequency) * duration < _BESIDE_BINS:
        return True
    return 1.0 / _BESIDE < larger.frequency / line.frequency < _BESIDE
