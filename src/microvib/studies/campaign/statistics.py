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
from microvib.model.hub_edge import hub_edge
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
"""Estimate for which the draws are too few, or which those that are not known leave open."""


class Gap(NamedTuple):
    """Why a case does not tell how large a line is."""

    what: str
    remedy: str
    """Remedy that tells it; empty where none does in general."""


NONE, HIDDEN, CHANGING, ABOVE_PASSBAND, NO_FIGURES, OTHER = range(6)
"""Gaps of a case's line, by their places in GAPS."""
GAPS = (
    Gap("", ""),
    Gap("not separable from another line", "a longer record.duration or solve: steady"),
    Gap("dying away or growing within the record", "a longer record.settle or solve: steady"),
    Gap("above the passband of the record", "a higher record.sample_rate"),
    Gap("of a case that failed", ""),
    Gap("without an amplitude of its own", "a longer record.duration"),
)


class Bounds(NamedTuple):
    """Amplitudes [N m] that a line has in each case, (cases,) each: nan where a case has none in the
    band, or is not computed.
    """

    least: np.ndarray
    most: np.ndarray
    """Infinite where nothing bounds it."""
    gap: np.ndarray
    """Place in GAPS of why the two differ."""

    def of(self, cases: np.ndarray) -> Bounds:
        """The part of some cases that have the line, or may have it."""
        kept = cases[np.isfinite(self.least[cases])]
        return Bounds(self.least[kept], self.most[kept], self.gap[kept])

    def quantile(self, q: float) -> Estimate:
        """Quantile of all cases: its interval reaches from the least that they may be to the most,
        with a figure between where both agree; none where the most is not bounded.
        """
        low, high = quantile(self.least, q), quantile(self.most, q)
        if not math.isfinite(high.high):
            return NO_ESTIMATE
        return Estimate(low.value if low.value == high.value else math.nan, low.low, high.high)

    def gaps(self) -> tuple[tuple[Gap, int], ...]:
        """The gaps and how many cases each has, the most frequent first."""
        number = np.bincount(self.gap, minlength=len(GAPS))
        found = [(GAPS[k], int(number[k])) for k in range(1, len(GAPS)) if number[k]]
        return tuple(sorted(found, key=lambda one: -one[1]))


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
    it, or may have it.
    """

    line: str
    level: Level
    frequency: tuple[float, float]
    """Smallest and largest frequency [Hz]."""
    count: int
    """How many of the draws have it with an amplitude."""
    drawn: int
    """How many have it, or may have it: those that percentiles are over."""
    mean: float
    """nan where a draw has no amplitude but may have the line, as the standard deviation."""
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
    gaps: tuple[tuple[Gap, int], ...] = ()
    """Why it is not known in some draws, and in how many of them, the most frequent first."""

    @property
    def not_known(self) -> int:
        """In how many of the draws its amplitude is not known, or to within bounds only."""
        return sum(count for _, count in self.gaps)


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
    rates = _of_record(results, "sample_rate")
    return absent & (place > PASSBAND * rates) & within_band(place, *band)


def _is_of_clock(line: str) -> bool:
    return not is_unlisted(line) and not LineName.parse(line).is_mode


def _of_record(results: Results, name: str) -> np.ndarray:
    """A number of each case's record, (cases,): ``sample_rate`` [Hz] or ``duration`` [s]."""
    design, key = results.campaign.design, f"record.{name}"
    if key in design.keys:
        return results.scalar(key)
    return np.full(results.state.size, getattr(design.base.record, name))


def _place(results: Results, line: str) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest frequency [Hz] that a line may have in each case, (cases,) each; nan where
    that is not known.

    Where it was not found a line of the clock is where it was expected, and any other one where
    it is in other cases.
    """
    f, status = results.of(line, "frequency"), results.status(line)
    known = f[np.isfinite(f)]
    low, high = (np.where(np.isfinite(f), f, x) for x in _ends(known))
    lost = ~np.isfinite(f) & (status != "")
    if np.any(lost) and _is_of_clock(line):
        expected = results.clock_lines.get(line, f)
        low, high = (np.where(lost & np.isfinite(expected), expected, x) for x in (low, high))
    return low - frequency_error_bound(low), high + frequency_error_bound(high)


def _ends(known: np.ndarray) -> tuple[float, float]:
    return (float(known.min()), float(known.max())) if known.size else (math.nan, math.nan)


def _may_be_there(results: Results, line: str, band: tuple[float, float]) -> np.ndarray:
    """Cases that have a line in ``band`` [Hz], or may have it there, bool (cases,)."""
    status, (low, high) = results.status(line), _place(results, line)
    there = (status != "") & (status != TRANSIENT)
    return there & (
        np.isnan(low) | (within_band(high, band[0], math.inf) & within_band(low, 0.0, band[1]))
    )


def _largest_in_record(results: Results, line: str) -> np.ndarray:
    """Amplitude of a line where it is largest within its record [N m], (cases,): at the start of one
    that dies away, and of one that grows what it may end with; nan where it has none.
    """
    amplitude, status = results.of(line), results.status(line)
    fold = results.of(line, "decay") * _of_record(results, "duration")
    fold = np.where(np.abs(fold) > 1e-9, fold, 1e-9)
    start = np.maximum(amplitude, amplitude * fold / -np.expm1(-fold))
    return np.select(
        [status == "decaying", status == "growing"], [start, GROWTH_FACTOR * amplitude], amplitude
    )


def _is_hidden(status: np.ndarray) -> np.ndarray:
    return np.char.startswith(status.astype(str), NOT_SEPARABLE)


def line_bounds(results: Results, line: str, band: tuple[float, float]) -> Bounds:
    """Bounds of a line's amplitude in each case that has it in ``band`` [Hz], or may have it there.

    A line that others hide is at most ABOVE_PASSBAND_FACTOR times its bin; of one above the passband
    of its record, and of a case that failed, nothing is known.
    """
    amplitude, status = results.of(line), results.status(line)
    there = _may_be_there(results, line, band)
    in_bin = ABOVE_PASSBAND_FACTOR * results.of(line, "bin_amplitude")
    hidden, faint = _is_hidden(status), status == BELOW_FLOOR
    found, bounded = np.isfinite(amplitude), (hidden | faint) & np.isfinite(in_bin)
    start = _largest_in_record(results, line)
    least = np.select([~there, found], [math.nan, amplitude], 0.0)
    most = np.select([~there, found, bounded], [math.nan, start, in_bin], math.inf)
    gap = np.select(
        [~there | (found & (start <= amplitude)), found, hidden],
        [NONE, CHANGING, HIDDEN],
        OTHER,
    )
    for cases, why in (
        (above_passband(results, line, band), ABOVE_PASSBAND),
        (results.state == FAILED, NO_FIGURES),
    ):
        least[cases], most[cases], gap[cases] = 0.0, math.inf, why
    return Bounds(least, most, gap)


def largest_bounds(results: Results, band: tuple[float, float]) -> Bounds:
    """Bounds of each case's largest line in ``band`` [Hz]: from the largest that is known to the most
    that any may be.
    """
    size = results.state.size
    least, most, gap = np.full(size, math.nan), np.full(size, math.nan), np.full(size, NONE)
    for line in results.lines:
        of_line = line_bounds(results, line, band)
        larger = np.isfinite(of_line.least) & ~(of_line.most <= most)
        gap = np.where(larger, of_line.gap, gap)
        least, most = np.fmax(least, of_line.least), np.fmax(most, of_line.most)
    return Bounds(least, most, np.where(least == most, NONE, gap))


def bounds_of(results: Results, line: str, band: tuple[float, float]) -> Bounds:
    """Bounds of a line, or of each case's largest (LARGEST_LINE), in ``band`` [Hz]."""
    if line == LARGEST_LINE:
        return largest_bounds(results, band)
    return line_bounds(results, line, band)


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
    amplitude. Levels are never pooled: which of them a unit runs at is not a matter of chance. Of a
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
        amplitude, bounds = amplitudes(results, name, band), bounds_of(results, name, band)
        frequency, verdicts = np.full(amplitude.size, np.nan), whole
        if name != LARGEST_LINE:
            frequency = results.of(name, "frequency")
            if limit is not None and whole is not None:
                verdicts = line_verdicts(results, name, limit, band, whole)
        for level in levels:
            here = np.arange(level.number * points, (level.number + 1) * points)
            drawn = here[counted[here] & np.isfinite(amplitude[here])]
            computed = here[counted[here] & (results.state[here] != MISSING)]
            if drawn.size:
                line = _LineAtLevel(
                    amplitude[drawn],
                    frequency[drawn],
                    bounds.of(computed),
                    None if verdicts is None else verdicts[computed],
                    int(here[np.nanargmax(amplitude[here])]),
                )
                largest = float(amplitude[line.worst])
                rows[level.number].append(_statistics_of_line(name, level, line, largest))
    return [
        row for each in rows for row in (*each[:1], *sorted(each[1:], key=lambda row: -row.largest))
    ]


@dataclass(frozen=True)
class _LineAtLevel:
    """One line in the cases of a level."""

    amplitude: np.ndarray
    """Amplitudes of the cases that have it, (n,), as the frequency."""
    frequency: np.ndarray
    bounds: Bounds
    """Bounds of all computed cases that have it, or may have it."""
    verdicts: np.ndarray | None
    """Verdicts of all computed cases; None without a limit."""
    worst: int
    """Case in which it is largest, of all."""

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
    whole = x.size == line.bounds.least.size
    return LineStatistics(
        line=name,
        level=level,
        frequency=(float(f.min()), float(f.max())) if f.size else (math.nan, math.nan),
        count=int(x.size),
        drawn=int(line.bounds.least.size),
        mean=float(x.mean()) if whole else math.nan,
        deviation=float(x.std(ddof=1)) if chance and whole else math.nan,
        median=line.bounds.quantile(0.5),
        p95=line.bounds.quantile(0.95),
        p99=line.bounds.quantile(0.99),
        largest=largest,
        worst=line.worst,
        above=above,
        exceedance=exceeds,
        unknown=unknown,
        judged=judged,
        gaps=line.bounds.gaps(),
    )


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
    amplitude, status = results.of(line), results.status(line)
    curve, (low, high) = in_band(limit, band), _place(results, line)
    there = _may_be_there(results, line, (curve.low, curve.high))
    strict, lenient = (
        np.where(np.isnan(low), of_all, of(low, high))
        for of_all, of in ((curve.least, curve.strictest), (curve.most, curve.most_lenient))
    )
    start = _largest_in_record(results, line)
    sure = np.isin(status, ("ok", BELOW_FLOOR, NOISE_DRIVEN))
    in_bin = ABOVE_PASSBAND_FACTOR * results.of(line, "bin_amplitude")
    small = _is_hidden(status) & (in_bin <= strict)
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
    if results.campaign.design.base.other_wing is not None:
        verdict[_is_open_to_other_wing(results, verdict, curve)] = UNKNOWN
    if (edge := hub_edge(results.campaign.design.base)) is not None:
        may_exceed = (high > edge.frequency) & (edge.factor * amplitude > strict)
        verdict[(verdict != ABSENT) & may_exceed] = UNKNOWN
    verdict[(verdict == UNKNOWN) & (whole == BELOW)] = BELOW
    return verdict


def _is_open_to_other_wing(results: Results, verdict: np.ndarray, limit: LimitCurve) -> np.ndarray:
    """Cases (cases,) in which a line's ``verdict`` is not known, as its amplitude in other states of the other
    wing's hinge is not kept, nor with the other drive stepping: it is above only where the case fails by the
    same limit, and below where it passes.
    """
    own = limit_of(results.campaign.design.study)
    fails = results.verdicts == VERDICTS.index("fail")
    if own is None or own.curve != limit:
        fails = np.zeros_like(fails)
    return (verdict == BELOW) | ((verdict == ABOVE) & ~fails)


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
    """Sorted amplitudes, (n,), and the part of cases that is larger than each, (n,); infinite ones
    count as cases and are left out.
    """
    x = np.sort(amplitude[~np.isnan(amplitude)])
    part = 1.0 - np.arange(1, x.size + 1) / max(x.size, 1)
    finite = np.isfinite(x)
    return x[finite], part[finite]


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
