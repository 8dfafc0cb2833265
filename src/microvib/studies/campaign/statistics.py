"""Statistics of a campaign's lines: distributions, level by level, with their uncertainty;
worst cases.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from microvib.analysis.margins import ABOVE_PASSBAND_FACTOR, GROWTH_FACTOR, frequency_error_bound
from microvib.analysis.start import VARIATION_FACTOR
from microvib.model.line_names import LineName, is_sideband, is_unlisted
from microvib.model.record import PASSBAND
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve, in_band
from microvib.signals.line_fit import NOT_SEPARABLE
from microvib.signals.line_table import BELOW_FLOOR, NOISE_DRIVEN
from microvib.studies.campaign.cases import HELD_RECORD, LEAVES_OPEN, PART_OF_CYCLE, VERDICTS
from microvib.studies.campaign.design import Design, limit_of
from microvib.studies.campaign.results import DONE, FAILED, MISSING, Results
from microvib.units import within_band

CONFIDENCE = 0.95
BELOW, ABOVE, UNKNOWN, ABSENT = range(4)
"""States of a case or line against a limit; ABSENT where a case has no such line in the
band.
"""
LARGEST_LINE = "any line"
"""Name of the largest line of a case, whichever it is."""


@dataclass(frozen=True)
class Estimate:
    """A figure and its confidence interval."""

    value: float
    low: float
    high: float


NO_ESTIMATE = Estimate(math.nan, math.nan, math.nan)
"""Estimate for which the draws are too few."""


@dataclass(frozen=True)
class Level:
    """A combination of levels: one cell of the grid that a study spans. Draws are counted within
    it, never across.
    """

    number: int
    text: str
    """Its keys and values as a person reads them; empty where there is only one."""
    draws: int
    """Distinct independent draws that were computed; of one, nothing is said about a distribution."""
    failed: int
    """Cases without figures, failed or not computed."""


@dataclass(frozen=True)
class LineStatistics:
    """Distribution of one line's amplitude [N m] over the independent draws of one level that have
    it.
    """

    line: str
    level: Level
    frequency: tuple[float, float]
    """Smallest and largest frequency [Hz]."""
    count: int
    mean: float
    deviation: float
    median: Estimate
    p95: Estimate
    p99: Estimate
    largest: float
    """Largest of all cases of the level, also those that are not independent draws."""
    worst: int
    """Number of the case with the largest amplitude."""
    above: int | None
    """How many of the draws are above the limit; None without a limit."""
    exceedance: Estimate | None
    """Probability of being above the limit; None without a limit, or without a distribution. Its
    upper end counts draws that could not be judged as above."""
    unknown: int = 0
    """How many of the draws could not be judged, though what is known of them is not above the
    limit: those, too, in which the line has no amplitude of its own, or that failed."""
    judged: int = 0
    """Number of draws to which ``above`` and ``unknown`` refer: those with an amplitude, and those without
    that are unknown.
    """
    unseen: int = 0
    """How many draws have it above the passband of their record, which are no part of the mean."""


def amplitudes_in_band(results: Results, line: str, band: tuple[float, float]) -> np.ndarray:
    """Amplitudes of a line (cases,); nan where it is outside of ``band`` [Hz] by more than CLOCK,
    absent or not computed.
    """
    f = results.of(line, "frequency")  # comparisons with nan are false
    return np.where(
        within_band(f, *band, frequency_error_bound(f)) & (results.state == DONE),
        results.of(line),
        np.nan,
    )


def above_passband(results: Results, line: str, band: tuple[float, float]) -> np.ndarray:
    """Cases in which a line of the clock is in ``band`` [Hz] and above the passband of the record, bool
    (cases,): these do not show it, and it is not 0 there.
    """
    absent = (results.state == DONE) & (results.status(line) == "")
    if not np.any(absent) or not _is_of_clock(line):
        return np.zeros(absent.size, dtype=bool)
    place = results.clock_lines.get(line, np.full(absent.size, np.nan))
    return absent & (place > PASSBAND * _sample_rates(results)) & within_band(place, *band)


def _is_of_clock(line: str) -> bool:
    return not is_unlisted(line) and not LineName.parse(line).is_mode


def _sample_rates(results: Results) -> np.ndarray:
    """Samples per second of each case's record, (cases,)."""
    design, key = results.campaign.design, "record.sample_rate"
    if key in design.keys:
        return results.scalar(key)
    return np.full(results.state.size, design.base.record.sample_rate)


def largest_line(results: Results, band: tuple[float, float]) -> np.ndarray:
    """Amplitude of each case's largest line in ``band``, (cases,); nan where it has none."""
    top = np.full(results.state.size, np.nan)
    for line in results.lines:
        top = np.fmax(top, amplitudes_in_band(results, line, band))
    return top


def amplitudes(results: Results, line: str, band: tuple[float, float]) -> np.ndarray:
    """Amplitudes of a line, or of each case's largest (ANY), in ``band`` [Hz], (cases,); nan if
    there is none.
    """
    if line == LARGEST_LINE:
        return largest_line(results, band)
    return amplitudes_in_band(results, line, band)


def levels_of(results: Results) -> tuple[Level, ...]:
    """All combinations of levels of a campaign, in the order of its cases."""
    design = results.campaign.design
    points = design.samples.shape[0]
    done = (results.state == DONE).reshape(-1, points)
    counted = independent_cases(design).reshape(-1, points)
    draws = [design.samples[good & known] for good, known in zip(done, counted, strict=True)]
    alike = design.uncertain and design.study.sampling.noise == "one"
    distinct = [len(np.unique(x, axis=0)) if alike else len(x) for x in draws]
    return tuple(
        Level(number=k, text=design.level_text(k), draws=n, failed=int(np.sum(~done[k])))
        for k, n in enumerate(distinct)
    )


def line_statistics(
    results: Results, limit: float | LimitCurve | None, band: tuple[float, float]
) -> list[LineStatistics]:
    """Statistics, level by level, of the largest line of each case and of every line in ``band``
    that any case has.

    Rows go level by level, in each the largest line of all (ANY) first, then the lines by falling
    mean. Levels are never pooled: which of them a unit runs at is not a matter of chance. Of a
    sample for Sobol indices only the independent part counts; nothing is told of one-at-a-time
    samples. Unexpected lines (``other_*``) count in ANY only: their names mean nothing across
    cases.
    """
    counted = independent_cases(results.campaign.design)
    points = results.campaign.design.samples.shape[0]
    levels = levels_of(results)
    names = [LARGEST_LINE, *(name for name in results.lines if not is_unlisted(name))]
    whole = None if limit is None else case_verdicts(results, limit, band)
    rows: list[list[LineStatistics]] = [[] for _ in levels]
    for name in names:
        amplitude = amplitudes(results, name, band)
        frequency, verdicts = np.full(amplitude.size, np.nan), whole
        unseen = np.zeros(amplitude.size, dtype=bool)
        if name == LARGEST_LINE:
            for each in results.lines:
                unseen |= above_passband(results, each, band)
        else:
            unseen |= above_passband(results, name, band)
            frequency = results.of(name, "frequency")
            if limit is not None and whole is not None:
                verdicts = line_verdicts(results, name, limit, band, whole)
        for level in levels:
            here = np.arange(level.number * points, (level.number + 1) * points)
            drawn = here[counted[here] & np.isfinite(amplitude[here])]
            hidden = int(np.sum(unseen[here] & counted[here]))
            computed = here[counted[here] & (results.state[here] != MISSING)]
            if drawn.size:
                line = _LineAtLevel(
                    amplitude[drawn],
                    frequency[drawn],
                    None if verdicts is None else verdicts[computed],
                    int(here[np.nanargmax(amplitude[here])]),
                    hidden,
                )
                largest = float(amplitude[line.worst])
                rows[level.number].append(_statistics_of_line(name, level, line, largest))
    return [
        row for each in rows for row in (*each[:1], *sorted(each[1:], key=lambda row: -row.mean))
    ]


@dataclass(frozen=True)
class _LineAtLevel:
    """One line in the cases of a level."""

    amplitude: np.ndarray
    """Amplitudes of the cases that have it, (n,), as the frequency."""
    frequency: np.ndarray
    verdicts: np.ndarray | None
    """Verdicts of all computed cases; None without a limit."""
    worst: int
    """Case in which it is largest, of all."""
    unseen: int = 0
    """In how many cases it is above the passband."""

    def count(self, verdict: int) -> int:
        """In how many cases it was judged so."""
        return 0 if self.verdicts is None else int(np.sum(self.verdicts == verdict))


def _statistics_of_line(
    name: str, level: Level, line: _LineAtLevel, largest: float
) -> LineStatistics:
    x, f = line.amplitude, line.frequency[np.isfinite(line.frequency)]
    above = None if line.verdicts is None else line.count(ABOVE)
    unknown = line.count(UNKNOWN)
    judged = 0 if line.verdicts is None else line.verdicts.size - line.count(ABSENT)
    chance = x.size > 1 and level.draws > 1
    exceeds = None
    if above is not None and chance and judged:  # a line is not judged where nothing is limited
        exceeds = proportion(above, judged, unknown)
    return LineStatistics(
        line=name,
        level=level,
        frequency=(float(f.min()), float(f.max())) if f.size else (math.nan, math.nan),
        count=int(x.size),
        mean=float(x.mean()),
        deviation=float(x.std(ddof=1)) if chance else math.nan,
        median=_quantile_with_unseen(x, 0.5, line.unseen),
        p95=_quantile_with_unseen(x, 0.95, line.unseen),
        p99=_quantile_with_unseen(x, 0.99, line.unseen),
        largest=largest,
        worst=line.worst,
        above=above,
        exceedance=exceeds,
        unknown=unknown,
        judged=judged,
        unseen=line.unseen,
    )


def _quantile_with_unseen(x: np.ndarray, q: float, unseen: int) -> Estimate:
    """Quantile of amplitudes (n,), of which further draws are not known: the interval reaches over
    all that these may be, without a figure between; none where they leave it open upwards.
    """
    if not unseen:
        return quantile(x, q)
    least, most = (
        quantile(np.concatenate([x, np.full(unseen, value)]), q) for value in (0.0, math.inf)
    )
    if not math.isfinite(most.high):
        return NO_ESTIMATE
    return Estimate(least.value if least.value == most.value else math.nan, least.low, most.high)


def case_verdicts(
    results: Results, limit: float | LimitCurve, band: tuple[float, float]
) -> np.ndarray:
    """BELOW, ABOVE or UNKNOWN of each case as a whole, (cases,): ABOVE where its run would fail, or
    any line of it does.

    Cases were judged against the study's own limit when they were computed. Of another limit it is
    known what is above it, and that a case which passed below it passes; the rest is not.
    """
    own, asked = limit_of(results.campaign.design.study), in_band(limit, band)
    verdict = np.full(results.state.size, UNKNOWN)
    if own is not None and own.curve is not None and asked.allows_all_of(own.curve):
        verdict[results.verdicts == VERDICTS.index("pass")] = BELOW
    if own is not None and own.curve == asked:
        verdict[results.verdicts == VERDICTS.index("fail")] = ABOVE
    for line in results.lines:
        verdict[line_verdicts(results, line, limit, band, verdict) == ABOVE] = ABOVE
    return verdict


def line_verdicts(
    results: Results,
    line: str,
    limit: float | LimitCurve,
    band: tuple[float, float],
    whole: np.ndarray,
) -> np.ndarray:
    """BELOW, ABOVE, UNKNOWN or ABSENT of one line in each case, (cases,), of which ``whole``
    (cases,) is known.

    A line that others hide, or that dies away from above the limit, is UNKNOWN; so is any of a case
    that failed or whose array does not turn, and one within the limit of a record that does not show
    all lines; where it holds a part of a slow cycle, one not far above the limit, too.
    """
    amplitude, f, status = results.of(line), results.of(line, "frequency"), results.status(line)
    known = f[np.isfinite(f)]
    place = np.where(np.isfinite(f), f, np.median(known) if known.size else np.nan)
    curve, off = in_band(limit, band), frequency_error_bound(place)
    there = (status != "") & (status != TRANSIENT)
    there &= within_band(place, curve.low, curve.high) | np.isnan(place)
    strict, lenient = (
        np.where(np.isnan(place), of_all, of(place - off, place + off))
        for of_all, of in ((curve.least, curve.strictest), (curve.most, curve.most_lenient))
    )
    falls = np.isin(status, ("decaying", "growing"))
    fold = (
        np.where(falls, results.of(line, "decay"), 0.0)
        * results.campaign.design.base.record.duration
    )
    fold = np.where(np.abs(fold) > 1e-9, fold, 1e-9)
    start = np.maximum(amplitude, amplitude * fold / -np.expm1(-fold))
    start = np.where(status == "growing", GROWTH_FACTOR * amplitude, start)
    sure = np.isin(status, ("ok", BELOW_FLOOR, NOISE_DRIVEN))
    hidden = np.char.startswith(status.astype(str), NOT_SEPARABLE)
    small = hidden & (ABOVE_PASSBAND_FACTOR * results.of(line, "bin_amplitude") <= strict)
    verdict = np.select(
        [
            ~there,
            sure & (amplitude > lenient),
            (sure & ~(amplitude > strict)) | small | (start <= strict),
        ],
        [ABSENT, ABOVE, BELOW],
        UNKNOWN,
    )
    verdict[above_passband(results, line, (curve.low, curve.high))] = UNKNOWN
    verdict[results.state == FAILED] = UNKNOWN
    verdict[(verdict != ABSENT) & (results.records == HELD_RECORD)] = UNKNOWN
    of_part = results.records == PART_OF_CYCLE
    verdict[(verdict == BELOW) & (of_part | (results.records == LEAVES_OPEN))] = UNKNOWN
    verdict[(verdict == ABOVE) & of_part & (amplitude <= VARIATION_FACTOR * lenient)] = UNKNOWN
    verdict[(verdict == UNKNOWN) & (whole == BELOW)] = BELOW
    return verdict


def least_allowed(row: LineStatistics, limit: LimitCurve) -> float:
    """The least that a limit allows to a line between the frequencies that it has [N m]; infinite
    where that is not limited, nan of the largest line of all, whichever it is.
    """
    low, high = row.frequency
    if math.isnan(low):
        return math.nan
    off = float(frequency_error_bound(high))
    return float(limit.strictest(low - off, high + off))


def governing_levels(rows: Sequence[LineStatistics]) -> list[LineStatistics]:
    """Row of each line at the level at which it is largest; the largest of all (ANY) first,
    then by falling amplitude.
    """
    worst: dict[str, LineStatistics] = {}
    for row in sorted(rows, key=lambda row: -row.largest):
        worst.setdefault(row.line, row)
    return sorted(worst.values(), key=lambda row: row.line != LARGEST_LINE)


@dataclass(frozen=True)
class AnyLevel:
    """Draws that are above the limit at one level at least, and those of which this is not known."""

    above: int
    unknown: int
    count: int
    exceedance: Estimate


def at_any_level(
    results: Results, limit: float | LimitCurve, band: tuple[float, float]
) -> AnyLevel | None:
    """How many draws, such as units of a batch, are above ``limit`` at one level or more; None
    without a distribution.
    """
    design = results.campaign.design
    points = design.samples.shape[0]
    counted = independent_cases(design)[:points]
    if not design.random or counted.sum() < 2:
        return None
    table = case_verdicts(results, limit, band).reshape(-1, points)[:, counted]
    fails = (table == ABOVE).any(axis=0)
    above, unknown = int(fails.sum()), int((~fails & (table == UNKNOWN).any(axis=0)).sum())
    return AnyLevel(above, unknown, fails.size, proportion(above, fails.size, unknown))


def independent_cases(design: Design) -> np.ndarray:
    """Which cases are independent draws, (cases,): for Sobol indices the two base samples, for
    one-at-a-time none.
    """
    points, sampling = design.samples.shape[0], design.study.sampling
    known = {"sobol-indices": 2 * sampling.count, "one-at-a-time": 0}.get(sampling.method, points)
    return np.arange(design.cases) % points < (known if design.uncertain else points)


def draws_needed(q: float) -> int:
    """Draws from which on both ends of a quantile's interval exist: 6 for the median, 72 for P95,
    368 for P99.
    """
    tail, extreme = 0.5 * (1.0 - CONFIDENCE), max(q, 1.0 - q)
    return math.ceil(math.log(tail) / math.log(extreme))


def quantile(x: np.ndarray, q: float) -> Estimate:
    """Quantile of ``x`` (n,) with the interval between order statistics that covers it, whatever
    the distribution.

    NONE where the draws are too few to bound it: an extreme of the sample is not a percentile.
    """
    ordered, n = np.sort(x), x.size
    if n < draws_needed(q):
        return NO_ESTIMATE
    from scipy.stats import binom

    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = int(binom.ppf(tail, n, q)) - 1, int(binom.ppf(1.0 - tail, n, q))
    with np.errstate(invalid="ignore"):  # between two infinite draws it is not known
        value = float(np.quantile(ordered, q))
    return Estimate(
        value,
        float(ordered[max(low, 0)]),
        float(ordered[min(high, n - 1)]),
    )


def proportion(count: int, n: int, unknown: int = 0) -> Estimate:
    """``count`` of ``n`` as a probability, with the exact interval of Clopper and Pearson;
    ``unknown`` ones may be either.
    """
    from scipy.stats import binomtest

    low = binomtest(count, n).proportion_ci(CONFIDENCE, "exact").low
    high = binomtest(count + unknown, n).proportion_ci(CONFIDENCE, "exact").high
    return Estimate(count / n, float(low), float(high))


def exceedance(amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sorted amplitudes, (n,), and the part of cases that is larger than each, (n,)."""
    x = np.sort(amplitude[np.isfinite(amplitude)])
    return x, 1.0 - np.arange(1, x.size + 1) / max(x.size, 1)


class WorstCase(NamedTuple):
    """A case among the worst of a line, or of all lines."""

    case: int
    amplitude: float
    """[N m]."""
    line: str
    """The line itself, or which of all lines it is."""
    part: float
    """Part of what a limit over frequency allows to it; nan without one."""


def worst_cases(
    results: Results,
    line: str,
    band: tuple[float, float],
    count: int = 5,
    limit: float | LimitCurve | None = None,
) -> list[WorstCase]:
    """The cases in which a line, or any line, is largest; by a limit over frequency those in which it
    has the smallest margin.
    """
    names = list(results.lines) if line == LARGEST_LINE else [line]
    each = np.array([amplitudes_in_band(results, name, band) for name in names])
    each = each.reshape(len(names), results.state.size)
    part = np.full(each.shape, np.nan)
    if isinstance(limit, LimitCurve) and not limit.is_flat:
        curve = in_band(limit, band)
        for k, name in enumerate(names):
            f = results.of(name, "frequency")
            place = np.where(np.isfinite(each[k]), f, 0.5 * (curve.low + curve.high))
            off = frequency_error_bound(place)
            part[k] = each[k] / curve.strictest(place - off, place + off)
        ranks = part
    else:
        ranks = each
    ranks = np.nan_to_num(ranks, nan=-1.0)
    if not len(names):
        return []
    governing = np.argmax(ranks, axis=0)
    order = np.argsort(-np.max(ranks, axis=0), kind="stable")
    found = [
        WorstCase(
            int(k), float(each[governing[k], k]), names[governing[k]], float(part[governing[k], k])
        )
        for k in order[:count]
    ]
    return [one for one in found if math.isfinite(one.amplitude)]


def main_lines(rows: Sequence[LineStatistics]) -> list[str]:
    """Lines worth a picture: the six largest; sidebands only where they are as large as a fifth of
    the largest.
    """
    singles = [row for row in governing_levels(rows) if row.line != LARGEST_LINE]
    top = max((row.largest for row in singles), default=0.0)
    worth = [r for r in singles if r.largest >= (0.2 if is_sideband(r.line) else 1e-2) * top]
    return [row.line for row in worth[:6]]
