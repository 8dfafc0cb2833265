"""Lines of a run against a limit: pass, fail, or not judged, and then what would have to change."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.accuracy import unsound
from microvib.analysis.lines import clock_doubts
from microvib.analysis.margins import (
    BEYOND,
    ONE_DRAW,
    SEEDS_NEEDED,
    Margin,
    Verdict,
    frequency_doubt,
    margin,
    may_have,
    when_settled,
)
from microvib.analysis.start import has_calmed, or_steady, rounded_up, still_held
from microvib.analysis.steadiness import may_be_larger
from microvib.analysis.unseen import unseen
from microvib.errors import OptionError, expect
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import SECOND_DRIVE
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.line_table import DRIVEN, Line, LineTable
from microvib.units import Band, Given, Si, band, inside, pretty, quantity

_SETTLED = 0.01
"""Fraction of the largest steady line below which ringing counts as settled."""
_ALL = Si(0.0), Si(math.inf)
"""The band of all frequencies [Hz]."""


@dataclass(frozen=True, init=False)
class Limit:
    """Largest amplitude, 0-to-peak [N m], that a line may have between two frequencies [Hz].

    ``Limit("10 mN*m")``, ``Limit("10 mN*m", "0.5 Hz", "150 Hz")``; OptionError for a bare number, and for what is no limit or band.
    """

    torque: float
    low: float
    high: float

    def __init__(self, torque: Given, low: Given = _ALL[0], high: Given = _ALL[1]) -> None:
        object.__setattr__(self, "torque", quantity("torque", torque, "N*m", positive=True))
        for name, end in zip(("low", "high"), band((low, high)), strict=True):
            object.__setattr__(self, name, end)

    @classmethod
    def of(cls, limit: Given | None, ends: Band | None) -> Limit | None:
        """The limit that a torque and the band state in which it holds; None without one. OptionError."""
        if limit is None:
            if ends is not None:
                raise OptionError("band", "says where a limit applies; give one, such as '10 mN*m'", remedy="limit")
            return None
        torque = quantity("limit", limit, "N*m", positive=True)
        return cls(torque, *(() if ends is None else band(ends)))

    @property
    def band(self) -> str:
        """The band in words; empty if the limit holds for all frequencies."""
        return f"from {self.low:g} to {self.high:g} Hz" if math.isfinite(self.high) else ""

    def holds(self, frequency: float, doubt: float = 0.0) -> bool:
        """Whether it holds at a frequency [Hz] that is known to ``doubt`` [Hz]; the ends of the band belong to it."""
        return inside(frequency, self.low, self.high, doubt)


@dataclass(frozen=True)
class Judgement:
    """All lines within the band against the limit, the smallest margin first, and what could not be judged.

    The limit is passed only if everything in its band was looked at, and failed if a line is above it.
    """

    limit: Limit
    margins: tuple[Margin, ...]
    unknown: tuple[Line, ...]
    """Lines without a known amplitude."""
    gaps: tuple[str, ...] = ()
    """What in the band was not judged, why, and what would have to change; a sentence without a stop each."""

    @property
    def verdict(self) -> Verdict:
        """The verdict on all together."""
        if self.above:
            return "fail"
        return "not judged" if self.gaps else "pass"

    @property
    def above(self) -> int:
        """How many lines are above the limit."""
        return sum(m.fails for m in self.margins)

    @property
    def worst(self) -> Margin | None:
        """The smallest margin that is judged; None without one."""
        return next((m for m in self.margins if m.verdict != "not judged"), None)

    def of(self, line: Line) -> Margin | None:
        """Margin of one line; None where it was not judged."""
        return next((m for m in self.margins if m.line.line == line.line), None)

    def __str__(self) -> str:
        band = f" {self.limit.band}" if self.limit.band else ""
        head = f"Limit {1e3 * self.limit.torque:.4g} mN m{band}: "
        if not self.margins and not self.gaps:
            return f"{head}no line{band} to judge."
        verdict = f"FAIL, {self.above} of {len(self.margins)} lines above" if self.above else self.verdict
        return f"{head}{verdict}{self._worst()}.{self.not_judged()}"

    def not_judged(self, most: int = 3) -> str:
        """What was not judged, as a sentence; empty if there is nothing."""
        if not self.gaps:
            return ""
        more = f"; and {len(self.gaps) - most} more" if len(self.gaps) > most else ""
        return f" Not judged: {'; '.join(self.gaps[:most])}{more}."

    def _worst(self) -> str:
        worst = self.worst
        if worst is None or math.isinf(worst.factor):
            return ""
        what = "smallest margin" if self.verdict != "not judged" else "smallest margin judged"
        return f"; {what} {worst.decibel:+.1f} dB, factor {worst.factor:.3g} ({worst.line.line})"


def judge(
    table: LineTable, limit: Limit, scenario: Scenario | None = None, second: LineTable | None = None
) -> Judgement:
    """Judge every line of the table within the band, also those too small for a report, and what the table does not list.

    The ``scenario`` of the table says what may be above the passband and how long a start rings; without it, nothing above the
    passband is judged. Where it has a second wing that is driven, the ``second`` table has that drive's lines, which are judged
    too. Lines of a motion whose invariants do not hold neither pass nor fail.
    """
    expect(table, LineTable, "a table of lines (mv.lines)")
    expect(limit, Limit, "a limit, such as mv.Limit('10 mN*m')")
    if table.unit != "N*m":
        raise OptionError(
            "limit", f"is a torque, and these lines are in {pretty(table.unit)}; lines of a torque are expected"
        )
    within = [x for x in table if limit.holds(*_place(x)) and x.status != TRANSIENT]
    ringing = [x for x in table if x.status in ("decaying", DRIVEN)]
    margins = [margin(x, limit.torque, table, ringing, scenario) for x in within if math.isfinite(x.amplitude_n_m)]
    margins.sort(key=lambda m: m.factor)
    unknown = tuple(x for x in within if not math.isfinite(x.amplitude_n_m))
    gaps = _held(table, scenario)
    gaps += [m.why for m in margins if m.verdict == "not judged"]
    gaps += [f"{x.line} ({x.status})" for x in unknown if not (has_calmed(x, scenario) or _is_small(x, limit))]
    gaps += _left(table, limit)
    if table.clock_ratio_uncertainty != 0.0:  # a recording's, whose clock was looked for
        gaps += clock_doubts(table)
    gaps += may_be_larger(table, limit.low, limit.high, limit.torque)
    if scenario is not None and scenario.rate is None:
        gaps.append("lines of the step clock, since the rate changes within the record (a record at one rate)")
    gaps += _above_passband(table, limit, scenario)
    if why := unsound(table.broken, scenario):
        margins = [replace(m, verdict="not judged", why=f"{m.line.line} ({why})") for m in margins]
        gaps.insert(0, why)
    judged = Judgement(limit, tuple(margins), unknown, tuple(gaps))
    other = None if scenario is None else scenario.driven_wing
    return judged if other is None else _both(judged, second, other.alone)


def _place(line: Line) -> tuple[float, float]:
    """Frequency of a line, found or expected, and to what it is known [Hz]."""
    return line.place_hz, float(frequency_doubt(line.place_hz, line.frequency_uncertainty_hz))


def _both(first: Judgement, table: LineTable | None, scenario: Scenario) -> Judgement:
    """The judgement of two drives on one craft, the second's lines called so."""
    if table is None:
        return replace(first, gaps=(*first.gaps, "the second wing's drive, whose lines are not here"))
    second = judge(table, first.limit, scenario)

    def called(line: Line) -> Line:
        return replace(line, line=f"{SECOND_DRIVE} {line.line}")

    theirs = (replace(m, line=called(m.line)) for m in second.margins)
    margins = sorted([*first.margins, *theirs], key=lambda m: m.factor)
    unknown = (*first.unknown, *map(called, second.unknown))
    gaps = (*first.gaps, *(f"{SECOND_DRIVE} {gap}" for gap in second.gaps))
    return replace(first, margins=tuple(margins), unknown=unknown, gaps=gaps)


def unsettled(table: LineTable, scenario: Scenario) -> list[str]:
    """Sentences: an array that does not turn yet, and tones that decay from above a hundredth of the largest steady line."""
    largest = max((x.amplitude_n_m for x in table if x.status == "ok"), default=math.inf)
    starts = [(x, x.starting(table.duration)) for x in table if x.status == "decaying"]
    told = [f"{why[0].upper()}{why[1:]}." for why in _held(table, scenario)]
    told += [_drawn(x, table) for x in table if x.status == DRIVEN and x.is_mode]
    return told + [
        f"{x.line} decays, {1e3 * start:.4g} mN m at the start of the record and {1e3 * x.amplitude_n_m:.4g} mN m on average:"
        f" {when_settled(x, start / (_SETTLED * largest), scenario)} to fall to a hundredth of the largest steady"
        f" line{or_steady(scenario)}."
        for x, start in starts
        if start > _SETTLED * largest
    ]


def _held(table: LineTable, scenario: Scenario | None) -> list[str]:
    """Why a run's lines are not those of tracking; of a recording the scenario does not know the start."""
    if scenario is None or table.clock_ratio_uncertainty != 0.0 or any(x.status == TRANSIENT for x in table):
        return []
    return list(filter(None, [still_held(scenario)]))


def _drawn(line: Line, table: LineTable) -> str:
    """What is known of a line of which the record is one draw."""
    seeds = table.over_seeds(line.line)
    if seeds is not None:
        told = f"{line.line}: {DRIVEN}; over {seeds.draws} seeds {1e3 * seeds.mean_n_m:.4g} ± {1e3 * seeds.deviation_n_m:.2g} mN m"
        if math.isnan(seeds.p95_high_n_m):
            return f"{told}; so few draws do not bound what 95 % stay below, {SEEDS_NEEDED} or more do."
        return f"{told}, 95 % of them below {1e3 * seeds.p95_n_m:.4g} mN m."
    alone = (
        f" the linearised drive gives {1e3 * line.noise_mean_n_m:.3g} ± {1e3 * line.noise_deviation_n_m:.2g} mN m by noise alone,"
        f" 95 % of the draws below {1e3 * line.noise_p95_n_m:.3g} mN m;"
        if math.isfinite(line.noise_mean_n_m)
        else ""
    )
    return f"{line.line}: {ONE_DRAW};{alone} --seeds N runs others."


def _left(table: LineTable, limit: Limit) -> list[str]:
    """Peaks above the limit that are not lines of the table."""
    if table.rest is None:
        return ["lines that are not in the table were not sought"]
    frequency, amplitude = table.rest.within(limit.low, limit.high)
    peak = f"up to {1e3 * amplitude:.4g} mN m at {frequency:.5g} Hz"
    more = "more members of each family, --harmonics N, or a longer record.duration"
    told = [f"{peak} that no line of the table accounts for ({more})"] if amplitude > limit.torque else []
    lowest = float(table.rest.frequency.min(initial=math.inf))
    if limit.low < lowest and BEYOND * table.rest.slow > limit.torque:
        ends = f"below {lowest:.3g} Hz" if math.isfinite(lowest) else "between its mean and its highest frequency"
        told.append(f"what is {ends}, for which the record is too short (a longer record.duration)")
    return told


def _above_passband(table: LineTable, limit: Limit, scenario: Scenario | None) -> list[str]:
    """What the drive may have above the highest frequency examined."""
    top = PASSBAND * table.sample_rate
    if limit.high <= top:
        return []
    start = max(top, limit.low)
    if scenario is None:
        return [f"what is above {start:.4g} Hz (a higher record.sample_rate)"]
    large = [
        (one, np.flatnonzero(one.most > limit.torque))
        for one in unseen(scenario, table, start, limit.high)
        if np.any(one.most > limit.torque)
    ]
    if not large:
        return []
    highest = max(float(one.frequency[there[-1]]) for one, there in large)
    reaches = min(highest + 0.5 * (scenario.driving_frequency or 0.0), limit.high)
    first = dict(reversed([(one.what, one.frequency[there[0]]) for one, there in large]))
    named = "; ".join(
        f"{what} at {first[what]:.4g} Hz" for what in list(dict.fromkeys(one.what for one, _ in large))[:2]
    )
    return [
        f"what is above {start:.4g} Hz (record.sample_rate >= {rounded_up(reaches / PASSBAND)} Hz), such as {named}"
    ]


def _is_small(line: Line, limit: Limit) -> bool:
    """Whether a line that others hide is small all the same."""
    return line.status.startswith("not separable") and may_have(line) <= limit.torque
