"""A campaign for those who read it: its statistics, tables, pictures and verdict."""

from __future__ import annotations

import math
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from microvib.analysis.seeds import seeds_of
from microvib.model.line_names import is_sideband
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.reports.campaign import figures
from microvib.reports.document import Fact, Status, Text
from microvib.reports.numbers import (
    count_text,
    plain_number,
    truncate,
)
from microvib.reports.outcome import Item, Outcome, Part, Picture, Verdict
from microvib.results import (
    COUNT,
    DECIBEL,
    LINE_FREQUENCY,
    SHARE,
    TORQUE,
    Column,
    Measure,
    Table,
)
from microvib.signals.limit_curve import Limit, LimitCurve, in_band, limit_words
from microvib.studies.campaign import statistics
from microvib.studies.campaign.design import limit_of
from microvib.studies.campaign.effects import Indices, Tornado, sobol, tornado
from microvib.studies.campaign.folder import Campaign
from microvib.studies.campaign.results import DONE, FAILED, MISSING, Results
from microvib.studies.campaign.statistics import (
    LARGEST_LINE,
    NO_ESTIMATE,
    AnyLevel,
    Estimate,
    Gap,
    LineStatistics,
    WorstCase,
    draws_needed,
)

MAX_WORST_CASES = 5
"""Worst cases that are listed for each line."""
MAX_RANK = 3
"""Largest number of them in a report."""
MAX_OPEN_LINES = 4
"""Further lines that are named of which not all draws are known."""
MAX_LEVELS = 20
"""Levels, those with the largest lines, that are listed; all of them are in statistics.csv."""
MAX_REASONS = 10
MAX_EFFECTS = 8
"""Keys whose effects on a line are listed; all of them are in effects.csv."""
MAX_FAILED = 20
"""Failed cases that a report lists; all of them are in failed.csv."""


@dataclass(frozen=True)
class Summary:
    """The contents of a campaign report."""

    results: Results
    limit: float | LimitCurve | None
    """One amplitude [N m] or a curve over frequency."""
    band: tuple[float, float]
    rows: list[LineStatistics]
    """Level by level."""
    any_level: AnyLevel | None
    """Draws that are above the limit at one of several levels; None without a limit, or with one
    level.
    """
    lines: list[str]
    """Lines of the pictures."""
    worst: dict[str, list[WorstCase]]
    """Worst cases of all lines and of each: the largest, by a limit over frequency those with the smallest
    margin.
    """
    tornados: list[Tornado]
    indices: list[Indices]

    @property
    def by_level(self) -> list[LineStatistics]:
        """The largest line of each level, the highest first."""
        return sorted(
            (row for row in self.rows if row.line == LARGEST_LINE), key=lambda row: -row.largest
        )

    @property
    def worst_case(self) -> int | None:
        """Number of the case with the largest line, or by a limit over frequency of that with the
        smallest margin; None where none is computed.
        """
        found = self.worst[LARGEST_LINE]
        return found[0].case if found else None

    @property
    def by_margin(self) -> bool:
        """Whether cases are ranked by their margins to a limit over frequency."""
        return isinstance(self.limit, LimitCurve) and not self.limit.is_flat

    @property
    def several(self) -> bool:
        """Whether there are several levels."""
        design = self.results.campaign.design
        return design.cases > len(design.samples)


def summarise(
    results: Results, limit: float | LimitCurve | None, band: tuple[float, float]
) -> Summary:
    """Statistics, worst cases, effects and Sobol indices of merged results."""
    rows = statistics.line_statistics(results, limit, band)
    lines = statistics.main_lines(rows) or list(results.lines[:4])
    shown = [LARGEST_LINE, *lines]
    tornados = [t for line in shown[:4] if (t := tornado(results, line, band)) and t.effects]
    indices = [i for line in shown[:4] if (i := sobol(results, line, band))]
    worst = {
        line: statistics.worst_cases(results, line, band, MAX_WORST_CASES, limit) for line in shown
    }
    if limit is not None and len({r.level for r in rows}) > 1:
        any_level = statistics.at_any_level(results, limit, band)
    else:
        any_level = None
    return Summary(results, limit, band, rows, any_level, lines, worst, tornados, indices)


def allowed_by(limit: Limit | None, band: tuple[float, float]) -> float | LimitCurve | None:
    """The largest torque that a limit allows to lines in ``band`` [Hz]: one amplitude [N m], or a curve; None without
    one.
    """
    if limit is None:
        return None
    curve = limit.torque_curve("a campaign")
    if limit.is_one_number and curve.low <= band[0] and curve.high >= band[1]:
        return curve.least
    return in_band(curve, band)


def shown_rows(s: Summary) -> list[LineStatistics]:
    """Each line at the level at which it is largest: the largest of all, lines of the pictures, and
    what else is at least a hundredth of the largest."""
    rows = statistics.governing_levels(s.rows)
    top = rows[0].largest
    return [
        r
        for r in rows
        if r.line in (LARGEST_LINE, *s.lines)
        or (not is_sideband(r.line) and r.largest > 0.01 * top)
    ]


def _frequency(r: LineStatistics) -> float | str:
    """Frequency of a line [Hz], or its range over the cases in words."""
    low, high = r.frequency
    if not math.isfinite(low) or high - low < 1e-4 * high:
        return low
    return f"{LINE_FREQUENCY.text(low)} to {LINE_FREQUENCY.text(high)}"


def above_limit(r: LineStatistics) -> str:
    """Draws above the limit, with the probability that this says of the next one and its interval."""
    if r.above is None:
        return ""
    if not r.judged:
        return "outside"  # of what is limited, as a run says
    if r.exceedance is None:
        if r.above:
            return "above"
        if r.unknown:
            return "not judged"
        return "below"
    e, not_judged = r.exceedance, f", {r.unknown} not judged" if r.unknown else ""
    return f"{r.above} of {r.judged}{not_judged}: {100 * e.value:.3g} % ({percents(e)})"


def percents(e: Estimate) -> str:
    """An interval of probabilities in per cent."""
    return f"{100 * e.low:.3g} to {100 * e.high:.3g}"


def counts(results: Results) -> list[int]:
    """Number of cases in each state: MISSING, DONE, FAILED."""
    return [int(n) for n in np.bincount(results.state, minlength=3)]


def campaign_outcome(s: Summary) -> Outcome:
    """A campaign for those who read it: its lines against the limit, level by level where there are
    several, worst cases, what was varied, distributions and effects.
    """
    campaign, base = s.results.campaign, s.results.campaign.design.base
    done, failed, missing = (counts(s.results)[k] for k in (DONE, FAILED, MISSING))
    lines = tuple(_lines(s))
    return Outcome(
        "Campaign",
        campaign.design.study.title or f"Campaign {campaign.folder.name}",
        f"{done} of {campaign.design.cases} cases of {base.title or campaign.design.study.scenario},"
        f" {failed} failed, {missing} not computed yet.",
        _verdict(s),
        tuple(_facts(s)),
        (
            Part(
                "",
                (
                    _up_to_the_passband(s),
                    *map(Text, not_known(s)),
                    *(_levels(s) if s.several else lines),
                    *map(Text, _against_limit(s)),
                ),
            ),
            Part("Lines", lines if s.several else (), new_page=True),
            Part("Worst cases", tuple(_worst(s)), new_page=True, report_only=True),
            Part("Varied parameters", (_varied(campaign), Text(_sampling(campaign, s)))),
            Part("How to read the figures", (Text(_how_to_read(s)),), report_only=True),
            Part("Distributions", tuple(_distributions(s))),
            Part("Over the levels", tuple(_over_levels(s))),
            Part("Sensitivity of the lines", tuple(_effects(s))),
            Part("Sobol indices", tuple(_sobol(s))),
            Part("Cases", tuple(_scatter(s))),
            Part("Failed cases", tuple(_failed(s)), report_only=True),
            Part(
                "Identity",
                (
                    Text(
                        f"Campaign SHA-256 `{campaign.identity}`, over the scenario and all cases."
                    ),
                ),
                report_only=True,
            ),
        ),
        base,
        files=(_statistics(s.rows), _effects_file(s)),
    )


def _verdict(s: Summary) -> Verdict:
    if s.limit is None or not s.rows:
        return ""
    if any(row.above for row in s.by_level):
        return "fail"
    if any(row.unknown or row.level.failed for row in s.by_level):
        return "not judged"
    return "pass"


def _facts(s: Summary) -> Iterator[Fact]:
    found = counts(s.results)
    if s.rows:
        yield from _limit_facts(s)
    yield Fact(str(found[DONE]), "cases")
    if found[FAILED]:
        yield Fact(str(found[FAILED]), "failed", "fail")
    if found[MISSING]:
        yield Fact(str(found[MISSING]), "not computed yet", "fail")
    if not s.rows:
        return
    top = s.by_level[0]
    at = f" at {truncate(top.level.text, 80)}" if s.several else ""
    if math.isfinite(top.p95.value):
        yield Fact(TORQUE.figure(top.p95.value), f"largest line, 95 % of the draws below{at}")
    if s.by_margin and s.worst[LARGEST_LINE]:
        worst = s.worst[LARGEST_LINE][0]
        what = f"smallest margin, case number {worst.case}, {worst.line}"
        yield Fact(DECIBEL.figure(_margin(worst)), what)
    else:
        yield Fact(TORQUE.figure(top.largest), f"worst case, number {top.worst}{at}")


def _margin(one: WorstCase) -> float:
    """Margin to a limit over frequency [dB]; infinite where nothing is limited, or there is no amplitude."""
    if one.part > 0.0:
        return -20.0 * math.log10(one.part)
    return math.nan if math.isnan(one.part) else math.inf


_STATUS: dict[Verdict, Status] = {"pass": "pass", "fail": "fail"}


def _limit_facts(s: Summary) -> Iterator[Fact]:
    """Facts on the limit, of every level by itself and of units that pass through
    all levels.
    """
    if s.limit is None:
        return
    allowed, status = limit_words(s.limit) + _band_words(s.band), _STATUS.get(_verdict(s), "")
    if s.several:
        fails = sum(bool(row.above) for row in s.by_level)
        open_ones = sum(bool(row.unknown) for row in s.by_level)
        not_judged = f"; cases that could not be judged at {open_ones}" if open_ones else ""
        label = f"with cases above {allowed}{not_judged}"
        yield Fact(f"{fails} of {len(s.by_level)} levels", label, status)
    chance = s.any_level if s.several else s.by_level[0]
    if chance is not None and chance.exceedance is not None:
        total = chance.count if isinstance(chance, AnyLevel) else chance.judged
        where = " at one level or more" if s.several else ""
        not_judged = f", {chance.unknown} not judged" if chance.unknown else ""
        e = chance.exceedance
        label = (
            f"of {total} draws above {allowed}{where}{not_judged} (95 % interval {percents(e)} %)"
        )
        yield Fact(SHARE.figure(e.value), label, status)
    elif not s.several:
        yield Fact(above_limit(s.by_level[0]), allowed, status)


def _band_words(band: tuple[float, float]) -> str:
    """The band in which a limit counts, behind the limit; empty where that is at all frequencies."""
    low, high = band
    if math.isfinite(high):
        return f" from {low:g} to {high:g} Hz"
    return f" from {low:g} Hz" if low > 0.0 else ""


def not_known(s: Summary) -> Iterator[str]:
    """Sentence on the draws in which a line is not known, what tells it and what its percentiles are then."""
    open_rows = [row for row in shown_rows(s) if row.gaps] if s.rows else []
    if not open_rows:
        return
    first, *others = open_rows
    why = "; ".join(_gap_words(gap, number, s) for gap, number in first.gaps)
    also = ", ".join(row.line for row in others[:MAX_OPEN_LINES])
    more = " ..." if len(others) > MAX_OPEN_LINES else ""
    likewise = (
        f" Likewise {also}{more}, in up to {max(x.not_known for x in others)} draws."
        if others
        else ""
    )
    yield (
        f"In {first.not_known} of {first.drawn} draws the amplitude of {first.line} is not known:"
        f" {why}. Percentiles reach over all that these may have, without a figure where they"
        f" decide it; where nothing bounds them from above, none is given.{likewise}"
    )


def _gap_words(gap: Gap, number: int, s: Summary) -> str:
    """How many draws have a gap, and what closes it."""
    study = s.results.campaign.design.study
    remedy = gap.remedy.removesuffix(" or solve: steady") if study.solve == "steady" else gap.remedy
    return f"{number} {gap.what}" + (f" ({remedy} tells it)" if remedy else "")


def missing_percentile_reason(row: LineStatistics, q: float) -> str:
    """Why a percentile of a line is not given; empty where its draws bound it."""
    if row.drawn < draws_needed(q):
        return "too few draws"
    return f"open: not known in {count_text(row.not_known, 'draw')}" if row.gaps else ""


def _against_limit(s: Summary) -> Iterator[str]:
    """Sentences on the limit for the text beside the table."""
    if s.any_level is not None and s.limit is not None:
        found, e = s.any_level, s.any_level.exceedance
        yield (
            f"Above {limit_words(s.limit)} at one level or more: {found.above} of {found.count}"
            f" draws, {found.unknown} not judged, {SHARE.figure(e.value)} (95 % interval"
            f" {percents(e)} %)."
        )
    if why := why_not_judged(s):
        yield why


def why_not_judged(s: Summary) -> str:
    """Why cases could not be judged, the most common reason first; empty where all were."""
    if s.limit is None or not any(row.unknown for row in s.by_level):
        return ""
    own = limit_of(s.results.campaign.design.study)
    if own is None or own.curve != in_band(s.limit, s.band):
        return (
            "Cases are judged as runs are only against the study's own limit and band; of another"
            " limit it is only known what"
            " is above it."
        )
    reasons = Counter(text for text in s.results.gaps if text)
    total = count_text(reasons.total(), "case")
    if reasons:
        return f"{reasons.most_common(1)[0][0]} (of {total}, the most common reason)"
    return ""


_MEDIAN = Column("median_n_m", "median", TORQUE)
_P95 = Column("p95_n_m", "P95", TORQUE)
_P99 = Column("p99_n_m", "P99", TORQUE)
_CASE = Column("worst_case", "case", COUNT)


def _above_column(s: Summary) -> Column:
    limit = "the limit" if s.limit is None else limit_words(s.limit)
    return Column("above", f"above {limit}", COUNT)


def _lines(s: Summary) -> Iterator[Item]:
    """Each line at the level at which it is largest, and the envelopes."""
    if not s.rows:
        return
    columns = (
        Column("line", "line"),
        Column("frequency_hz", "frequency", LINE_FREQUENCY),
        _MEDIAN,
        _P95,
        Column("p95_low_n_m", "P95 from", TORQUE),
        Column("p95_high_n_m", "P95 to", TORQUE),
        _P99,
        Column("largest_n_m", "largest", TORQUE),
        _CASE,
        _above_column(s),
        Column("level", "at level", words=lambda text: truncate(text, 60)),
    )
    rows = tuple(
        (
            r.line,
            _frequency(r),
            r.median.value,
            r.p95.value,
            r.p95.low,
            r.p95.high,
            r.p99.value,
            r.largest,
            r.worst,
            above_limit(r),
            r.level.text,
        )
        for r in shown_rows(s)
    )
    where = ", each at the level at which it is largest" if s.several else ""
    yield Table("", columns, rows, caption=f"Lines{where}; 0-to-peak.")
    if counts(s.results)[DONE]:
        caption = (
            "Median, 95 % and 99 % point where the draws carry them, and the largest amplitude."
            + (" Each line at the level at which it is largest." if s.several else "")
        )
        drawn = shown_rows(s)[:16]
        yield Picture("envelopes", partial(figures.envelopes, drawn, s.limit), "Envelopes", caption)


def _levels(s: Summary) -> Iterator[Item]:
    """The largest line at each level."""
    columns = (
        Column("level", "level", words=lambda text: truncate(text, 80)),
        Column("draws", "draws", COUNT),
        _MEDIAN,
        _P95,
        _P99,
        Column("largest_n_m", "largest line", TORQUE),
        _CASE,
        _above_column(s),
    )
    rows = tuple(
        (
            r.level.text,
            r.level.draws,
            r.median.value,
            r.p95.value,
            r.p99.value,
            r.largest,
            r.worst,
            above_limit(r),
        )
        for r in s.by_level
    )
    caption = "The largest line at each level, the highest first."
    yield Table("", columns, rows[:MAX_LEVELS], caption=caption)
    if len(rows) > MAX_LEVELS:
        yield Text(f"{len(rows) - MAX_LEVELS} more levels are in `statistics.csv`.")


def _statistics(rows: Sequence[LineStatistics]) -> Table:
    """Every line at every level, for a file."""
    keys = ["level", "line", "cases", "lowest_hz", "highest_hz", "mean_n_m", "deviation_n_m"]
    keys += [
        f"{name}{end}_n_m" for name in ("median", "p95", "p99") for end in ("", "_low", "_high")
    ]
    keys += ["largest_n_m", "worst_case", "above"]
    keys += ["exceedance", "exceedance_low", "exceedance_high", "cases_not_known"]

    def cells(e: Estimate | None) -> tuple[float, float, float]:
        known = e or NO_ESTIMATE
        return known.value, known.low, known.high

    return Table("statistics", tuple(map(Column, keys)), tuple(
        (r.level.text, r.line, r.count, *r.frequency, r.mean, r.deviation, *cells(r.median), *cells(r.p95), *cells(r.p99),
         r.largest, r.worst, "" if r.above is None else r.above, *cells(r.exceedance), r.not_known)
        for r in rows
    ))  # fmt: skip


def _distributions(s: Summary) -> Iterator[Picture]:
    if not s.rows or s.by_level[0].level.draws < 2:
        return
    level = s.by_level[0].level
    where = f" At {level.text}, the level with the largest line." if s.several else ""
    given = s.results, [LARGEST_LINE, *s.lines][:6], s.limit, s.band, level
    caption = (
        "Fraction of the draws in which a line exceeds an amplitude; a thin curve beside a thick one is"
        f" the most that it may be where draws do not tell it.{where}"
    )
    yield Picture("exceedance", partial(figures.exceedances, *given), "Exceedance", caption)
    caption = (
        "Draws by amplitude of each line. Full, dashed and dotted: median, 95 % and 99 % point."
        f"{where}"
    )
    yield Picture("histograms", partial(figures.histograms, *given), "Histograms", caption)


def _over_levels(s: Summary) -> Iterator[Picture]:
    if not counts(s.results)[DONE]:
        return
    if any(len(levels.values) > 1 for levels in s.results.campaign.design.levels):
        caption = (
            "Median over the levels of a key, the largest where other keys have levels too; shaded,"
            " all cases at it."
        )
        lines = [LARGEST_LINE, *s.lines][:4]
        draw = partial(figures.over_levels, s.results, lines, s.band)
        yield Picture("levels", draw, "Over the levels", caption)


def _effects(s: Summary) -> Iterator[Item]:
    """Effect of each key on the lines, the strongest first."""
    if not s.tornados:
        return
    columns = (
        Column("line", "line", role="group"),
        Column("key", "parameter", role="key"),
        Column("low_n_m", "low end", TORQUE),
        Column("high_n_m", "high end", TORQUE),
        Column("explained", "plane explains", Measure("%", 0.01, ".0f")),
    )
    rows = tuple(
        (t.line, e.key, e.low, e.high, t.explained)
        for t in s.tornados
        for e in t.effects[:MAX_EFFECTS]
    )
    first = len(s.tornados[0].effects[:MAX_EFFECTS])
    yield Table("", columns, rows, brief=first)
    caption = (
        "From the 5 % to the 95 % point of each key, the others at their means; levels from lowest"
        " to highest mean."
    )
    left_out = max(t.left_out for t in s.tornados)
    if left_out:
        caption += f" Cases without an amplitude of a line, up to {left_out}, are left out."
    draw = partial(figures.tornados, s.tornados)
    yield Picture("tornado", draw, "Sensitivity of the lines", caption)


def _sobol(s: Summary) -> Iterator[Item]:
    if not s.indices:
        return
    index = Measure(form=".2f")
    columns = (
        Column("line", "line", role="group"),
        Column("key", "parameter", role="key"),
        Column("first", "first order", index),
        Column("total", "total", index),
    )
    rows = []
    for found in s.indices:
        order = np.argsort([-t.value for t in found.total])[:MAX_EFFECTS]
        rows += [
            (found.line, found.keys[k], found.first[k].value, found.total[k].value) for k in order
        ]
    yield Table("", columns, tuple(rows), brief=min(len(s.indices[0].keys), MAX_EFFECTS))
    caption = (
        "Fraction of the variance that a key explains alone (first order) and with all others"
        " (total), 95 % bootstrap."
    )
    yield Picture("sobol", partial(figures.sobol_bars, s.indices), "Sobol indices", caption)


def _effects_file(s: Summary) -> Table:
    """Effects and Sobol indices with their intervals, for a file."""
    rows: list[tuple[Any, ...]] = [
        ("tornado", t.line, e.key, e.low, e.high, "") for t in s.tornados for e in t.effects
    ]
    for found in s.indices:
        for kind, estimates in (("sobol first order", found.first), ("sobol total", found.total)):
            pairs = zip(found.keys, estimates, strict=True)
            rows += [(kind, found.line, key, e.low, e.high, e.value) for key, e in pairs]
    keys = ("kind", "line", "key", "low", "high", "value")
    return Table("effects", tuple(map(Column, keys)), tuple(rows))


def _scatter(s: Summary) -> Iterator[Picture]:
    if counts(s.results)[DONE] and figures.scattered_keys(s.results.campaign.design):
        caption = "Largest line of each case over what varies."
        draw = partial(figures.scatters, s.results, LARGEST_LINE, s.band)
        yield Picture("scatter", draw, "Cases", caption)


def _how_to_read(s: Summary) -> str:
    if s.band == (0.0, math.inf):
        band = ""
    else:
        band = f" Lines from {s.band[0]:g} to {s.band[1]:g} Hz."
    text = (
        "P95 and P99 are amplitudes that 95 % and 99 % of the draws stay below. Intervals hold with"
        " 95 % confidence whatever the"
        f" distribution, for independent draws. A percentile is given where the draws bound it: the"
        " median from"
        f" {draws_needed(0.5)} on, P95 from {draws_needed(0.95)}, P99 from {draws_needed(0.99)}."
        " A draw that does not tell how large a line is counts with the least and the most that it may be."
    )
    if s.several:
        text += " Levels are judged one by one: a unit runs at a chosen level, not a random one."
    failed = sum(r.level.failed for r in s.by_level)
    if failed:
        text += (
            f" {count_text(failed, 'case')} without figures: failed ones may have any amplitude, and those"
            " that are not computed are not counted."
        )
    return f"{text}{band} All figures are the model's, for the assumed spread; they are not those of a measured batch."


def _up_to_the_passband(s: Summary) -> Text:
    """Up to which frequency lines are listed."""
    top = PASSBAND * s.results.campaign.design.base.record.sample_rate
    return Text(
        f"Lines are listed up to {top:.4g} Hz, the edge of the passband, also of steady states: what"
        " lies above is in the verdicts and in no figure, and so not in the largest line."
    )


def _sampling(campaign: Campaign, s: Summary) -> str:
    design = campaign.design
    sampling, record = design.study.sampling, design.base.record
    points = design.samples.shape[0]
    if design.random:
        how = f"Sampling: {sampling.method}, {count_text(points, 'point')}, seed {sampling.seed}. "
    else:
        how = ""
    if seeds_of(design.base, 0):
        if sampling.noise == "each":
            each = "Every point has its own draw"
        else:
            each = "All cases have one draw"
        how += f"{each} of the friction's noise. "
    recorded = f"a record of {record.duration:g} s after {record.settle:g} s"
    if design.study.solve != "steady" and design.base.record.start != "steady":
        return f"{how}Of each case: {recorded}."
    integrated = integrated_text(s)
    return f"{how}Of each case: its steady state{f', where it has one. {integrated}' if integrated else '.'}"


def integrated_text(s: Summary) -> str:
    """How many cases have no steady state and were integrated in time, with the reasons counted;
    empty where all have one.
    """
    why = Counter(reason_without_values(note) for note in s.results.notes if note)
    if not why:
        return ""
    reasons = "; ".join(f"{number} x {kind}" for kind, number in why.most_common(MAX_REASONS))
    return f"{why.total()} of {len(s.results.notes)} cases have no steady state and were integrated from rest instead: {reasons}."


def reason_without_values(reason: str) -> str:
    """A reason without its figures, so that alike ones are counted together."""
    words = ["..." if any(c.isdigit() for c in word) else word for word in reason.split()]
    return " ".join(
        word for k, word in enumerate(words) if word != "..." or k == 0 or words[k - 1] != "..."
    )[:200]


def _varied(campaign: Campaign) -> Table:
    design = campaign.design
    rows = [
        (x.key, truncate(f"{count_text(len(x.values), 'level')}: {', '.join(x.labels)}", 120))
        for x in design.levels
    ]
    rows += [(x.key, x.text) for x in design.uncertain]
    rows += [
        (" and ".join(c.keys), f"correlation {c.coefficient:g}") for c in design.study.correlations
    ]
    rows += [
        (f"combination {k}", truncate(str(item), 120))
        for k, item in enumerate(design.combinations)
        if item
    ]
    columns = (Column("key", "parameter", role="key"), Column("how", "how"))
    return Table("", columns, tuple(rows))


def _worst(s: Summary) -> Iterator[Item]:
    """The cases with the largest lines and what is varied in them, a column each; the worst cases
    of every line.
    """
    found = s.worst[LARGEST_LINE][:MAX_WORST_CASES]
    if found:
        yield _largest_cases(s, found)
    else:
        yield Text("No case has been computed yet.")
    yield _worst_of_lines(s)
    if found:
        folder = s.results.campaign.folder
        again = f"microvib campaign case {shlex.quote(folder.name or str(folder))} CASE"
        text = f"Each case runs again alone: `{again}`. All digits are in `worst.csv`."
        yield Text(text, note=True)


def _largest_cases(s: Summary, found: Sequence[WorstCase]) -> Table:
    """Values of what is varied in some cases, a column each."""
    design = s.results.campaign.design
    labels = [design.labels(one.case) for one in found]
    columns = (
        Column("what", "what"),
        Column("unit", "unit"),
        *(Column(f"case_{one.case}", f"case {one.case}", COUNT) for one in found),
        Column("scenario", "scenario", COUNT),
    )
    what = "its amplitude" if s.by_margin else "largest line"
    rows = [
        (what, TORQUE.unit, *(TORQUE.text(one.amplitude) for one in found), ""),
        ("which line", "", *(one.line for one in found), ""),
    ]
    if s.by_margin:
        margins = [DECIBEL.text(_margin(one)) for one in found]
        rows.insert(0, ("smallest margin", DECIBEL.unit, *margins, ""))
    varied = {key: [x.get(key, "") for x in labels] for key in design.keys}
    rows += [
        tuple(_varied_row(design.base, key, texts)) for key, texts in varied.items() if any(texts)
    ]
    which = "smallest margins to the limit" if s.by_margin else "largest lines"
    caption = f"Cases with the {which}, worst first; scenario: what the study starts from."
    return Table("", columns, tuple(rows), caption=caption)


def _varied_row(base: Scenario, key: str, labels: Sequence[str]) -> list[str]:
    """A key, its unit, its values in some cases and in the scenario; figures with four digits."""
    value = next((value for name, value, _ in base.entries() if name == key), "")
    texts = [*labels, base.shown(key, value)]
    parts = [_NUMBER.match(text) for text in texts]
    units = {m[2] or "" for m in parts if m}
    if len(units) != 1 or not all(parts):
        return [key, "", *(truncate(text, 24) for text in texts)]
    return [key, units.pop(), *(plain_number(float(m[1])) for m in parts if m)]


_NUMBER = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?)(?:\s+(\D\S*(?: \S+)*))?$")


def _worst_of_lines(s: Summary) -> Table:
    """The worst cases of each line; what is varied in them is in the file."""
    columns = (
        Column("line", "line", role="group"),
        Column("rank", "rank", COUNT),
        Column("case", "case", COUNT),
        Column("amplitude_n_m", "amplitude", TORQUE),
        *((Column("margin_db", "margin", DECIBEL),) if s.by_margin else ()),
        *map(Column, s.results.campaign.design.keys),
    )

    def margin(one: WorstCase) -> tuple[float, ...]:
        return (_margin(one),) if s.by_margin else ()

    def rows(most: int) -> tuple[tuple[Any, ...], ...]:
        return tuple(
            (line, rank, one.case, one.amplitude, *margin(one), *_labels(s, one.case))
            for line, found in s.worst.items()
            for rank, one in enumerate(found[:most], 1)
        )

    caption = "The worst cases of each line"
    caption += ", by the smallest margin to the limit." if s.by_margin else "."
    return Table("worst", columns, rows(MAX_WORST_CASES), rows(MAX_RANK), caption=caption)


def _labels(s: Summary, case: int) -> list[str]:
    """Varied values of a case, by the keys of the study."""
    design = s.results.campaign.design
    found = design.labels(case)
    return [found.get(key, "") for key in design.keys]


def _failed(s: Summary) -> Iterator[Item]:
    columns = (
        Column("case", "case", COUNT),
        Column("reason", "reason"),
        *map(Column, s.results.campaign.design.keys),
    )
    rows = tuple(
        (case, reason, *_labels(s, case)) for case, reason in enumerate(s.results.reasons) if reason
    )
    yield Table("failed", columns, rows, rows[:MAX_FAILED])
    if len(rows) > MAX_FAILED:
        yield Text("All of them are in `failed.csv`.")
