"""Lines of a recording as its force table and its preparation show them: those outside of the usable band,
near resonances of the table, beyond the measuring chain or in a removed trend are marked, the others have
the table's bias in their uncertainties.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from microvib.signals.line_table import (
    BEYOND_CHAIN,
    BEYOND_RESPONSE,
    BEYOND_USABLE,
    BY_TREND,
    DISTORTED,
    NEAR_RESONANCE,
    OF_UNKNOWN_SCALE,
    Line,
    LineTable,
    UnusableRange,
)
from microvib.testdata.force_table import ForceTable, UnusableBand
from microvib.testdata.recording import Recording

_STATUS = {"chain": BEYOND_CHAIN, "trend": BY_TREND, "scale": OF_UNKNOWN_SCALE}
"""Statuses of lines that reading or preparing leaves uncertain, by the causes of it."""
_MOST_TOLD = 3
"""Lines near a resonance of which each has a sentence, those of the drive first."""
_MOST_NAMED = 6
"""Lines that one sentence names."""


def with_force_table(table: LineTable, recording: Recording, channel: str) -> LineTable:
    """Lines of a recording's channel with what is known of its force table and its preparation.

    A line outside the usable band, near a resonance, where readings could not be corrected, beyond the
    measuring chain or in a removed trend is marked and counts as not estimated. Of the others, what the
    table's resonances change, or how well its response is known that readings were corrected by, goes
    into the uncertainties.
    """
    ranges = tuple(UnusableRange(one.low, one.high, one.why) for one in recording.unusable(channel))
    if recording.table is None and not ranges:
        return table
    lines = tuple(_marked(line, recording, channel) for line in table)
    return replace(table, lines=lines, unusable=ranges)


def _marked(line: Line, recording: Recording, channel: str) -> Line:
    """A line with the table's part in its uncertainties, or marked where its load is not shown."""
    if not (line.seen and math.isfinite(line.amplitude) and line.frequency > 0.0):
        return line
    lost = _lost_at(recording, line.frequency)
    if lost is not None:
        return replace(line, status=_STATUS[lost.cause])
    if recording.table is None:
        return line
    return _with_bias(line, recording.table, channel)


def _lost_at(recording: Recording, frequency: float) -> UnusableBand | None:
    """The band at a ``frequency`` [Hz] in which preparing left too little of the loads."""
    inside = (one for one in recording.lost if one.low <= frequency <= one.high)
    return next(inside, None)


def _with_bias(line: Line, known: ForceTable, channel: str) -> Line:
    """A line with the table's part in its uncertainties, or marked where that is too much."""
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
    """Sentences on the lines that the force table, or what preparing left, does not show as they are, by
    their reasons.
    """
    for status in _STATUS.values():
        there = [line for line in table if line.status == status]
        lost = _lost_at(recording, there[0].frequency) if there else None
        if lost is not None:
            yield f"{_names(there)} not judged: {lost.why}"
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
        why = known.objection(channel, beyond[0].frequency)
        yield f"{_names(beyond)} not judged: {why}"


def _names(lines: Sequence[Line]) -> str:
    """Names of the first lines."""
    more = " ..." if len(lines) > _MOST_NAMED else ""
    return ", ".join(line.name for line in lines[:_MOST_NAMED]) + more


def unusable_gaps(table: LineTable, low: float, high: float) -> Iterator[str]:
    """Parts of a band [Hz] in which the recording does not show what there is, a clause each."""
    for one in table.unusable:
        if one.low < high and low < one.high:
            yield one.sentence(low, high)


def undecided_reason(line: Line) -> str:
    """Why a line neither passes nor fails for its force table or its preparation; empty where it may."""
    return line.status if line.status in DISTORTED else ""
