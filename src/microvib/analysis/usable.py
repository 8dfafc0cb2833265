"""Lines of a recording as its force table shows them: those outside its usable band or near its
resonances are marked, the others have their bias in their uncertainties.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from microvib.signals.line_table import (
    BEYOND_RESPONSE,
    BEYOND_USABLE,
    DISTORTED,
    NEAR_RESONANCE,
    Line,
    LineTable,
    UnusableRange,
)
from microvib.testdata.force_table import ForceTable
from microvib.testdata.recording import Recording

_MOST_TOLD = 3
"""Lines near a resonance of which each has a sentence, those of the drive first."""
_MOST_NAMED = 6
"""Lines that one sentence names."""


def with_force_table(table: LineTable, recording: Recording, channel: str) -> LineTable:
    """Lines of a recording's channel with what is known of its force table.

    A line outside the usable band, near a resonance, or where readings could not be corrected is marked
    and counts as not estimated. Of the others, what the table's resonances change, or how well its
    response is known that readings were corrected by, goes into the uncertainties.
    """
    known = recording.table
    if known is None or channel not in known.made_of:
        return table
    ranges = tuple(UnusableRange(*one) for one in known.unusable(channel))
    lines = tuple(_with_bias(line, known, channel) for line in table)
    return replace(table, lines=lines, unusable=ranges)


def _with_bias(line: Line, known: ForceTable, channel: str) -> Line:
    """A line with the table's part in its uncertainties, or marked where that is too much."""
    if not (line.seen and math.isfinite(line.amplitude) and line.frequency > 0.0):
        return line
    low, high = known.usable
    if not low <= line.frequency <= high:
        return replace(line, status=BEYOND_USABLE)
    if known.objection(channel, line.frequency):
        return replace(line, status=BEYOND_RESPONSE if known.corrected else NEAR_RESONANCE)
    there = (channel, line.frequency, line.amplitude)
    return replace(
        line,
        amplitude_uncertainty=math.hypot(
            line.amplitude_uncertainty, known.amplitude_uncertainty(*there)
        ),
        phase_uncertainty=math.hypot(line.phase_uncertainty, known.phase_uncertainty(*there)),
    )


def force_table_notes(table: LineTable, recording: Recording, channel: str) -> Iterator[str]:
    """Sentences on the lines that the force table does not show as they are, by their reasons."""
    known = recording.table
    if known is None:
        return
    near = [line for line in table if line.status in (NEAR_RESONANCE, BEYOND_RESPONSE)]
    for line in sorted(near, key=lambda x: (x.kind == "other", -x.amplitude))[:_MOST_TOLD]:
        why = known.objection(channel, line.frequency)
        yield f"{line.name} at {line.frequency:.5g} Hz is not judged: {why}"
    if len(near) > _MOST_TOLD:
        where = (
            "where the table was not corrected"
            if known.corrected
            else "near the table's resonances"
        )
        yield f"{len(near) - _MOST_TOLD} further lines {where} are not judged"
    beyond = [line for line in table if line.status == BEYOND_USABLE]
    if beyond:
        names = ", ".join(line.name for line in beyond[:_MOST_NAMED])
        more = " ..." if len(beyond) > _MOST_NAMED else ""
        why = known.objection(channel, beyond[0].frequency)
        yield f"{names}{more} not judged: {why}"


def unusable_gaps(table: LineTable, low: float, high: float) -> Iterator[str]:
    """Parts of a band [Hz] in which the force table does not show what there is, a clause each."""
    for one in table.unusable:
        if one.low < high and low < one.high:
            yield one.sentence(low, high)


def undecided_reason(line: Line) -> str:
    """Why a line neither passes nor fails for its force table; empty where it may."""
    return line.status if line.status in DISTORTED else ""
