"""Evidence of one member of an envelope on one channel: its lines, what others may have at most, where
nothing was looked at, and its own verdict against a limit.

The verdict of a run or a recording is that of ``microvib run`` and ``analyse``; here it is only asked
about parts of the limit. Of tables of lines it is made of what they state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from microvib.analysis.limits import Judgement
from microvib.analysis.margins import (
    CLOCK_UNCERTAINTY,
    MIN_RELATIVE_ERROR,
    NoVerdict,
    Verdict,
    amplitude_bound,
    amplitude_error_bound,
    frequency_error_bound,
    line_range,
)
from microvib.analysis.noise import NOISE
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_table import Line, LineTable, part_ends

NO_SEARCH = "a table of lines does not tell what else its record holds"


@dataclass(frozen=True)
class SeenLine:
    """A line with its amplitude, and the range in which its frequency lies."""

    name: str
    frequency: float
    """[Hz]."""
    low: float
    high: float
    amplitude: float
    """0-to-peak, in the unit of its channel; of one that decays that at the start of the record."""
    error: float = 0.0
    """By how much the amplitude may be off."""
    allowed: float = math.nan
    """The least that a limit allows in its range; nan without a limit."""
    lenient: float = math.nan
    """The most that it allows there."""
    verdict: Verdict | NoVerdict = ""
    seen: bool = True
    """Whether it was found; else the amplitude is what it may have at most."""


@dataclass(frozen=True)
class Bound:
    """Bound on what stands in a range of frequencies [Hz] beside the lines that are seen."""

    low: float
    high: float
    at_most: float
    """Amplitude; infinite where nothing was looked at."""
    what: str


@dataclass(frozen=True)
class Judged:
    """A member's own verdict against a part of a limit."""

    verdict: Verdict
    why: str
    """Why it is not judged; empty where it is."""
    lines: tuple[SeenLine, ...]
    """Lines with what is allowed to them."""
    complete: bool
    """Whether all in that part was looked at."""


Judge = Callable[[LimitCurve], Judged]


@dataclass(frozen=True)
class Evidence:
    """All that one member tells of one channel."""

    unit: str
    lines: tuple[SeenLine, ...]
    bounds: tuple[Bound, ...]
    low: float
    high: float
    """Range of frequencies [Hz] that was looked at."""
    judge: Judge = field(compare=False, repr=False)
    missing: str = ""
    """Why nothing of the channel was looked at; empty where it was."""
    duration: float = math.nan
    """Length of the record [s]; nan of a table."""
    sample_rate: float = math.nan

    @classmethod
    def none(cls, unit: str, why: str) -> Evidence:
        """The evidence of a member that tells nothing of the channel, and ``why``."""
        return cls(
            unit, (), (), math.inf, 0.0, lambda curve: Judged("not judged", why, (), False), why
        )

    def at_most(self, low: float, high: float) -> float:
        """The most that may stand between two frequencies [Hz] beside the lines that are seen."""
        if low < self.low * (1.0 - 1e-9) or high > self.high * (1.0 + 1e-9):
            return math.inf
        there = (x.at_most for x in self.bounds if x.low <= high and x.high >= low)
        return max(there, default=0.0)

    def hidden_over(self, curve: LimitCurve) -> float:
        """The most of what may stand beside the lines, over what a limit allows there, in all of the
        limit's range.
        """
        if curve.low < self.low * (1.0 - 1e-9) or curve.high > self.high * (1.0 + 1e-9):
            return math.inf
        there = [x for x in self.bounds if x.low <= curve.high and x.high >= curve.low]
        if not there:
            return 0.0
        low, high, most = np.array([(x.low, x.high, x.at_most) for x in there]).T
        return float(np.max(most / curve.strictest(low, high)))


def evidence_of_table(table: LineTable, scenario: Scenario | None, judge: Judge) -> Evidence:
    """The evidence of a record's lines, or of those of a steady state."""
    lines = tuple(_seen_lines(table, scenario))
    low, high = _looked_at(table)
    return Evidence(
        table.unit,
        lines,
        tuple(_bounds(table, scenario)),
        low,
        high,
        judge,
        duration=table.duration,
        sample_rate=table.sample_rate,
    )


def _looked_at(table: LineTable) -> tuple[float, float]:
    """Frequencies [Hz] between which lines were looked for."""
    if table.rest is None or not table.sample_rate > 0.0:
        return math.inf, 0.0
    return table.rest.resolution, PASSBAND * table.sample_rate


def _seen_lines(table: LineTable, scenario: Scenario | None) -> Iterator[SeenLine]:
    for line in table:
        if not line.seen or not math.isfinite(line.amplitude):
            continue
        size = line.amplitude
        if math.isfinite(table.duration) and math.isfinite(line.decay):
            size = max(size, line.amplitude_at_start(table.duration))
        low, high = line_range(line, table, scenario)
        error = amplitude_error_bound(line, table)
        yield SeenLine(line.name, line.place, low, high, size, error)


def _bounds(table: LineTable, scenario: Scenario | None) -> Iterator[Bound]:
    for line in table:
        if (line.seen and math.isfinite(line.amplitude)) or not math.isfinite(line.place):
            continue
        if line.status != TRANSIENT:
            low, high = line_range(line, table, scenario)
            yield Bound(low, high, _hidden(line), line.name)
    for one in table.masked:
        yield Bound(one.low, one.high, one.amplitude, "what a line of the background may hide")
    if table.rest is None:
        yield Bound(0.0, math.inf, math.inf, NO_SEARCH)
        return
    parts = part_ends(table.rest.frequency)
    most = table.rest.factor * table.rest.amplitude
    for low, high, size in zip(*(x.tolist() for x in (*parts, most)), strict=True):
        yield Bound(low, high, size, "peaks without a line")
    for part in table.unusable:
        yield Bound(part.low, part.high, math.inf, part.why)


def _hidden(line: Line) -> float:
    """The most that the drive may have in a line that was not found, or is not known to be its own;
    infinite where that is not known.
    """
    most = amplitude_bound(line)
    return most if math.isfinite(most) else math.inf


def judged_of(
    judgement: Judgement, tables: Iterable[tuple[LineTable, Scenario | None]], curve: LimitCurve
) -> Judged:
    """A judgement by a ``curve`` as the verdict of a member; the lines' ranges are those of their
    ``tables``.
    """
    known = list(tables)
    lines = []
    for one in judgement.each:
        for m in one.margins:
            low, high = m.line.place, m.line.place
            error = 0.0
            for table, scenario in known:
                if any(x.name == m.line.name for x in table):
                    low, high = line_range(m.line, table, scenario)
                    error = amplitude_error_bound(m.line, table)
                    break
            lenient = float(curve.most_lenient(low, high))
            told = (m.line.name, m.line.place, low, high, m.amplitude, error, m.limit, lenient)
            lines.append(SeenLine(*told, m.verdict, m.line.seen and m.line.name != NOISE))
    why = "; ".join(judgement.all_gaps[:2])
    if len(judgement.all_gaps) > 2:
        why += f"; and {len(judgement.all_gaps) - 2} more"
    return Judged(
        judgement.verdict,
        why if judgement.verdict == "not judged" else "",
        tuple(lines),
        not judgement.all_gaps,
    )


@dataclass(frozen=True)
class StatedLines:
    """Lines as a table states them, without their record."""

    unit: str
    lines: tuple[tuple[str, float, float], ...]
    """Names, frequencies [Hz] and amplitudes."""
    bounds: tuple[Bound, ...]
    low: float = 0.0
    high: float = math.inf
    undecided: str = ""
    """Why a line above a limit does not fail; empty where it does."""

    def evidence(self) -> Evidence:
        """The evidence of these lines: they fail where one is above a limit, and pass where what else
        may be there is below it, too.
        """
        return Evidence(
            self.unit, tuple(self._seen()), self.bounds, self.low, self.high, self._judge
        )

    def _seen(self) -> Iterator[SeenLine]:
        for name, frequency, amplitude in self.lines:
            off = float(frequency_error_bound(frequency))
            error = MIN_RELATIVE_ERROR * amplitude
            yield SeenLine(name, frequency, frequency - off, frequency + off, amplitude, error)

    def _judge(self, curve: LimitCurve) -> Judged:
        lines = self.judged_lines(curve)
        gaps = [f"{x.name} at {x.frequency:.5g} Hz" for x in lines if x.verdict == "not judged"]
        gaps += self._gaps(curve)
        fails = any(x.verdict == "fail" for x in lines)
        verdict: Verdict = "not judged" if gaps else "pass"
        if fails:
            verdict = "fail"
        return Judged(
            verdict, "; ".join(gaps[:2]) if verdict == "not judged" else "", lines, not gaps
        )

    def judged_lines(self, curve: LimitCurve) -> tuple[SeenLine, ...]:
        """The lines in the range of a limit, each with what is allowed to it and its verdict."""
        return tuple(self._judged_lines(curve))

    def _judged_lines(self, curve: LimitCurve) -> Iterator[SeenLine]:
        for x in self._seen():
            if not curve.holds(0.5 * (x.low + x.high), 0.5 * (x.high - x.low)):
                continue
            strict, lenient = curve.strictest(x.low, x.high), curve.most_lenient(x.low, x.high)
            verdict: Verdict = "not judged"
            if x.amplitude + x.error <= strict:
                verdict = "pass"
            elif (
                x.amplitude - x.error > lenient
                and not self.undecided
                and all(curve.holds(f, 2.0 * CLOCK_UNCERTAINTY * f) for f in (x.low, x.high))
            ):
                verdict = "fail"
            yield replace(x, allowed=float(strict), lenient=float(lenient), verdict=verdict)

    def _gaps(self, curve: LimitCurve) -> Iterator[str]:
        if self.undecided:
            yield self.undecided
        if curve.low < self.low:
            yield f"lines below {self.low:.4g} Hz"
        if curve.high > self.high:
            yield f"lines above {max(self.high, curve.low):.4g} Hz"
        for x in self.bounds:
            here = x.low <= curve.high and x.high >= curve.low
            if here and x.at_most > curve.strictest(x.low, x.high):
                yield x.what
