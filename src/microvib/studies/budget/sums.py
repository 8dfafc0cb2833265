"""How sources add up, and verdicts: a figure of the line of sight between what it is at least and
what it may be at most.

Lines of unrelated frequencies add as mean squares. Lines of one frequency in several sources add by
a rule: ``rss``, the mean over unknown phases, ``coherent``, with their phases, or ``bound``, with
the worst. Sources of one clock keep their phases under every rule. A requirement is passed only if
the figure is within it with the worst phases, with what still rings and with all that was not
looked at, and failed only if it is above it with the best phases and without them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Literal, NamedTuple

import numpy as np

from microvib.analysis.margins import Verdict, frequency_error_bound
from microvib.analysis.pointing import FREQUENCY_TOLERANCE
from microvib.analysis.start import steady_start_advice
from microvib.signals.in_step import LOCKED, SLOW, bases
from microvib.signals.pointing import UNIFORM_INSTANTS, mean_square_of_lines, windowed_amplitudes
from microvib.studies.budget.errors import NO_ERRORS, reasons_against, sum_of_errors
from microvib.studies.budget.figures import (
    AXES,
    INCOHERENT,
    CombinedLines,
    Moved,
    SweptLines,
    beat_bounds,
    counts_in_band,
    crossing_bounds,
    evaluate,
    evaluate_errors,
    evaluate_lines,
    evaluate_metric,
    metric_bounds,
)
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.hub_edge import hub_edge_gaps, with_unknown_above
from microvib.studies.budget.side_lines import anywhere_together, reasons_together
from microvib.studies.budget.sources import Contribution, Unobserved, open_gap
from microvib.studies.campaign.statistics import Estimate, draws_needed, quantile

Rule = Literal["rss", "coherent", "bound"]
SIGNIFICANT_PART = 0.01
"""Part of a figure's square from which what it leaves open is told."""
_BELOW_CREST = 0.98
"""Part of the crests of lines that stands for them beside a level: both are known to 1e-3."""


@dataclass(frozen=True)
class Share:
    """Share of one line or source in a metric: its own rms [rad], and its part of the sum of
    squares, of a curve of the limit.
    """

    source: str
    line: str
    frequency: float
    rms: float
    share: float
    without: float = math.nan
    """Value of the requirement without it [rad]; nan where it was not computed."""


@dataclass(frozen=True)
class Assessment:
    """One requirement, and what was found; angles [rad]."""

    requirement: Requirement
    value: float
    """With the given rule; nan where the requirement says too little."""
    least: float
    most: float
    """Between which it lies, infinite where nothing bounds it."""
    lines: float
    noise: float
    """Lines alone, and densities alone."""
    limit: float
    """Limit; of a curve, that at its worst line."""
    verdict: Verdict
    why: tuple[str, ...]
    """Why it is not judged."""
    sources: tuple[Share, ...]
    ranking: tuple[Share, ...]
    """Lines of all sources, the most costly first."""
    spread: tuple[Estimate, Estimate, Estimate] | None = None
    """Median, P95 and P99 over the cases of a campaign."""
    angle: float | None = None
    """Angle of the array [rad] with the worst verdict, where several were looked at; None for that of
    the scenario.
    """
    value_angle: float | None = None
    """Angle of the array [rad] with the largest value, where several were looked at: that of the value
    and of what contributes to it; None for that of the scenario.
    """
    errors: float = 0.0
    """Errors of sources by their class alone."""

    def __repr__(self) -> str:
        return (
            f"requirement '{self.requirement.name}': {self.verdict}, {self.value:.4g} rad of"
            f" {self.limit:.4g} rad"
        )

    @property
    def margin(self) -> float:
        """Limit over value."""
        if self.value > 0.0:
            return self.limit / self.value
        return math.inf

    @property
    def margin_db(self) -> float:
        """Margin to the limit [dB]; nan where there is none."""
        if 0.0 < self.margin < math.inf:
            return 20.0 * math.log10(self.margin)
        return math.nan


class _SourceLine(NamedTuple):
    """A line of a source."""

    frequency: float
    los: np.ndarray
    clock: str | int
    """Clock of the line; a line without one has its own number."""
    relative_errors: np.ndarray
    """Relative errors of both angles, down and up, (2, 2)."""
    settled: bool
    """Whether it belongs to the settled motion."""
    off: float
    """By how much the frequency may be off."""
    source: int


def combine_lines(
    contributions: Iterable[Contribution], rule: Rule, *, with_errors: bool = True
) -> CombinedLines:
    """Lines of all sources by frequency, with their errors of other classes; without ``with_errors``
    amplitudes count as they are given.
    """
    contributions = list(contributions)
    parts = sorted(_source_lines(contributions, rule, with_errors), key=lambda part: part.frequency)
    groups = _lines_of_one_frequency(parts)
    found = [_group_amplitudes(group, rule) for group in groups]
    least, value, most = np.moveaxis(np.array([one.sizes for one in found]).reshape(-1, 3, 2), 1, 0)
    if with_errors:
        least = _least_of_coinciding(groups, least, most)
    tones = np.array([one.largest for one in found], dtype=complex).reshape(-1, 2)
    return CombinedLines(
        np.array([one.frequency for one in found]),
        least,
        value,
        most,
        np.exp(1j * np.angle(tones)),
        _clock_numbers([clock for one in found for clock in one.clocks]).reshape(-1, 2),
        np.array([max(part.off for part in group) for group in groups]),
        sum_of_errors(error for one in contributions for error in one.errors),
    )


def _source_lines(
    contributions: Iterable[Contribution], rule: Rule, with_errors: bool
) -> Iterator[_SourceLine]:
    """Lines of all sources one by one, those without a clock each with one of its own."""
    own = count()
    for source, one in enumerate(contributions):
        relative_errors = one.relative_errors if with_errors else np.zeros_like(one.relative_errors)
        for k, frequency in enumerate(one.frequency):
            yield _SourceLine(
                float(frequency),
                one.los[k],
                _clock_of(one, k, rule) or next(own),
                relative_errors[:, k],
                bool(one.settled[k]),
                float(one.off[k]),
                source,
            )


def _lines_of_one_frequency(parts: Sequence[_SourceLine]) -> list[list[_SourceLine]]:
    """Lines, given by frequency, in groups of one."""
    groups: list[list[_SourceLine]] = []
    for part in parts:
        tolerance = FREQUENCY_TOLERANCE * part.frequency
        if groups and part.frequency - groups[-1][0].frequency <= tolerance:
            groups[-1].append(part)
        else:
            groups.append([part])
    return groups


def _clock_numbers(clocks: Sequence[str | int | None]) -> np.ndarray:
    """Clocks by number; INCOHERENT for a line that has none with a name."""
    named = dict.fromkeys(clock for clock in clocks if isinstance(clock, str))
    numbers: dict[str | int | None, int] = {clock: k for k, clock in enumerate(named)}
    return np.array([numbers.get(clock, INCOHERENT) for clock in clocks], dtype=int)


def _clock_of(one: Contribution, k: int, rule: Rule) -> str:
    """The clock to which a line of a source keeps its phase; empty where it keeps none."""
    if rule == "coherent" and one.phased and (one.unlocked is None or not one.unlocked[k]):
        return "all"
    return one.clocks[k]


def _least_of_coinciding(
    groups: Sequence[Sequence[_SourceLine]], least: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """Least amplitudes (k, 2) of lines, of which those of several sources may be of one frequency,
    and cancel.

    Of lines that may meet, one after another, the largest counts, less what those may have that may
    meet it.
    """
    meets = _coinciding_lines(groups)
    found, told = least.copy(), set[int]()
    for k in range(len(groups)):
        if k in told or not meets[k]:
            continue
        cluster = _connected_lines(k, meets)
        told.update(cluster)
        left = np.array([least[j] - most[meets[j]].sum(axis=0) for j in cluster])
        found[cluster] = 0.0
        for axis, first in enumerate(np.argmax(left, axis=0)):
            found[cluster[first], axis] = max(left[first, axis], 0.0)
    return found


def _coinciding_lines(groups: Sequence[Sequence[_SourceLine]]) -> list[list[int]]:
    """Numbers of those that may be of the frequency of each line."""
    frequency = np.array([group[0].frequency for group in groups])
    off = np.array([max(part.off for part in group) for group in groups])
    meets: list[list[int]] = []
    for k, group in enumerate(groups):
        near = np.flatnonzero(np.abs(frequency - frequency[k]) <= off + off[k])
        meets.append([j for j in near.tolist() if j != k and _may_coincide(group, groups[j])])
    return meets


def _connected_lines(start: int, meets: Sequence[Sequence[int]]) -> list[int]:
    """Numbers of lines that ``start`` meets, those that these meet, and so on."""
    found, new = [start], [start]
    while new:
        new = sorted({j for k in new for j in meets[k]} - set(found))
        found += new
    return found


def _may_coincide(one: Sequence[_SourceLine], other: Sequence[_SourceLine]) -> bool:
    """Whether lines of two sources may be of one frequency, by what these may be off; of one clock
    they are known.
    """
    return any(
        a.source != b.source
        and a.clock != b.clock
        and abs(a.frequency - b.frequency) <= a.off + b.off
        for a in one
        for b in other
    )


class _Sum(NamedTuple):
    """Lines of one frequency."""

    sizes: np.ndarray
    """Least, given and largest amplitude, (3, 2)."""
    frequency: float
    """Frequency of the largest line."""
    largest: np.ndarray
    """About each axis the largest line of one clock, (2,)."""
    clocks: list[str | int | None]
    """Whose it is; None where it is not quite of the frequency."""


def _group_amplitudes(group: Sequence[_SourceLine], rule: Rule) -> _Sum:
    """The sum of lines of one frequency; what rings counts in the largest only."""
    clocks: dict[tuple[str | int, float], np.ndarray] = {}
    relative_error, ringing = np.zeros((2, 2)), np.zeros(2)
    for part in group:
        los, size = part.los, np.abs(part.los)
        # Those of one clock that are not quite of one frequency drift against each other.
        f = next((f for _, f in clocks if abs(part.frequency - f) <= LOCKED * f), part.frequency)
        clocks[part.clock, f] = clocks.get((part.clock, f), 0.0) + (
            los if part.settled else 0.0 * los
        )
        relative_error, ringing = (
            relative_error + part.relative_errors * size,
            ringing + (0.0 * size if part.settled else size),
        )
    given = np.abs(list(clocks.values()))
    total = given.sum(axis=0)
    least = np.maximum(2.0 * given.max(axis=0) - total - relative_error[0], 0.0)
    if rule == "bound":
        value = total
    else:
        value = np.sqrt(np.sum(given**2, axis=0))
    largest = np.argmax(given, axis=0)
    of = [list(clocks)[k] for k in largest]
    _, frequency = list(clocks)[int(np.argmax(given.max(axis=1)))]
    return _Sum(
        np.array([least, value, total + relative_error[1] + ringing]),
        frequency,
        np.array(list(clocks.values()))[largest, [0, 1]],
        [clock if f == frequency else None for clock, f in of],
    )


def assess(
    requirement: Requirement, contributions: Sequence[Contribution], rule: Rule
) -> Assessment:
    """A requirement against the sum of all sources."""
    if requirement.incomplete:
        return _incomplete(requirement)
    chosen = [
        with_unknown_above(worst_alternative(requirement, one), one.edge) for one in contributions
    ]
    if requirement.curve is not None:
        return _assess_by_curve(requirement, chosen, contributions, rule)
    tones = combine_lines(chosen, rule)
    densities = [one.density for one in chosen if one.density is not None]
    tones = with_side_lines(requirement, tones, chosen)
    chosen = _with_gaps(requirement, chosen, contributions)
    value = evaluate_lines(requirement, tones, densities)
    least, known = _bounds_about(requirement, tones, chosen, rule)
    beyond = _anywhere(requirement, chosen)
    most = _raised(
        requirement,
        lambda r: known if r is requirement else _bounds_about(r, tones, chosen, rule)[1],
        beyond,
    )
    figure = _Figure(least, value, most)
    cases = _case_figures(requirement, chosen, contributions, rule)
    lacking = _percentile_gaps(requirement, chosen, cases)
    why = [
        *_open_reasons(requirement, chosen, value),
        *_reasons_of(beyond, known, most, requirement.limit or math.nan, value),
        *_unknown_phase_reasons(requirement, chosen, rule, value),
        *lacking,
    ]
    if requirement.percentile is not None:
        figure = figure.at(None if lacking else cases, requirement.percentile)
    limit = requirement.limit or math.nan
    verdict = figure.verdict(limit)
    lines = figure.value
    if densities or tones.errors:
        lines = evaluate_lines(requirement, replace(tones, errors=NO_ERRORS))
    noise = evaluate_metric(requirement, np.zeros(0), np.zeros((0, 2)), densities)
    return Assessment(
        requirement,
        figure.value,
        figure.least,
        figure.most,
        lines,
        noise,
        limit,
        verdict,
        tuple(why or [WITHIN_UNCERTAINTY]) if verdict == "not judged" else (),
        *_with_values_without(requirement, chosen, rule, _rank_shares(requirement, chosen)),
        spread=None if any(one.cases_lack for one in chosen) else _spread(cases),
        errors=evaluate_errors(requirement, tones.errors) if tones.errors else 0.0,
    )


def _reasons_of(
    beyond: _Beyond, known: float, most: float, limit: float, value: float
) -> tuple[str, ...]:
    """Reasons of motion at unknown frequencies, where it raises what is ``known`` above the limit or is
    a good part of the value.
    """
    counts = known <= limit or most - known > math.sqrt(SIGNIFICANT_PART) * value
    return beyond.why if counts else ()


def _bounds_about(
    requirement: Requirement,
    tones: CombinedLines,
    chosen: Sequence[Contribution],
    rule: Rule,
) -> tuple[float, float]:
    """The least and the most of a metric over all sources [rad]."""
    gaps = [gap for one in chosen for gap in one.gaps]
    smallest = [x for one in chosen if (x := _least_density(one)) is not None]
    largest, beside = None, side_densities(chosen)
    if beside or any(one.density_bounds is not None for one in chosen):
        largest = [one.most_density for one in chosen if one.most_density is not None] + beside
    return metric_bounds(requirement, tones, gaps, smallest, _swept_sources(chosen, rule), largest)


def _least_density(one: Contribution) -> tuple[np.ndarray, np.ndarray] | None:
    """Density of a source as small as it may be, with what drives that turn take off it."""
    least, beside = one.least_density, None if one.side is None else one.side.beside
    if least is None or beside is None:
        return least
    f, S = least
    off = np.array([np.interp(f, beside[0], column) for column in beside[1].T]).T
    return f, np.maximum(np.sqrt(S) - np.sqrt(off), 0.0) ** 2


class _CaseFigures(NamedTuple):
    """The figure of each case of a campaign [rad], (cases,) each."""

    value: np.ndarray
    least: np.ndarray
    most: np.ndarray
    """Between which it lies on the craft of the case; nan where no percentile is asked for."""
    beyond: float
    """The most that side lines make in any case."""


def _spread(cases: _CaseFigures | None) -> tuple[Estimate, Estimate, Estimate] | None:
    """Median, P95 and P99 over the cases of a campaign."""
    if cases is None:
        return None
    return quantile(cases.value, 0.5), quantile(cases.value, 0.95), quantile(cases.value, 0.99)


class _Figure(NamedTuple):
    """Metric of the line of sight [rad] with its bounds."""

    least: float
    value: float
    most: float

    def at(self, cases: _CaseFigures | None, percentile: float) -> _Figure:
        """The figure at a percentile of a campaign; nan where that is not known.

        What is open in the nominal case is as much of the figure in all of them, and what is open on
        the craft of each case counts there: another source may be all of it in some.
        """
        if cases is None or not math.isfinite(quantile(cases.value, percentile).value):
            return _Figure(math.nan, math.nan, math.nan)
        found = quantile(cases.value, percentile)
        least, most = quantile(cases.least, percentile).low, quantile(cases.most, percentile).high
        if self.value > 0.0:
            least = min(least, self.least * (found.low / self.value))
            most = max(most, self.most * (found.high / self.value))
        else:
            most = max(most, self.most)
        return _Figure(least, found.value, most + cases.beyond)

    def verdict(self, limit: float) -> Verdict:
        """On a limit [rad]."""
        if self.most <= limit:
            return "pass"
        if self.least > limit:
            return "fail"
        return "not judged"


def _incomplete(requirement: Requirement) -> Assessment:
    """Sentence on an incomplete requirement."""
    key = requirement.incomplete
    return Assessment(
        requirement,
        math.nan,
        math.nan,
        math.nan,
        math.nan,
        math.nan,
        requirement.limit or math.nan,
        "not judged",
        (f"{key}: missing; {requirement.metric} needs it, such as {key}: 10 ms",),
        (),
        (),
    )


def _swept_sources(chosen: Sequence[Contribution], rule: Rule) -> SweptLines | None:
    """Bounds on sources whose lines are at one of several frequencies; None without any."""
    crests = [one.crests for one in chosen if one.crests is not None]
    if not crests:
        return None
    x, y, together = np.sum(crests, axis=0).tolist()
    return SweptLines(
        combine_lines([one for one in chosen if one.crests is None], rule), x, y, together
    )


def worst_alternative(requirement: Requirement, one: Contribution) -> Contribution:
    """Alternative of a source with the largest contribution."""
    if not one.alternatives or requirement.incomplete:
        return one
    if one.sweep is not None:
        return one.sweep.worst(requirement, lambda x: _metric_of_source(requirement, x))
    if requirement.curve is not None:
        return max(
            one.alternatives,
            key=lambda x: ratio_to_curve(requirement, x.frequency, np.abs(x.los)).max(initial=0.0),
        )
    rms, most = _rms_and_bounds(requirement, one.alternatives)
    if requirement.statistic != "level":
        return one.alternatives[int(np.argmax(rms if requirement.statistic == "rms" else most))]
    # A level lies between both, and takes long: it is computed of those that come first in either.
    near = {int(k) for sizes in (rms, most) for k in np.argsort(-sizes)[:3]}
    return max(
        (one.alternatives[k] for k in near),
        key=lambda x: evaluate_metric(requirement, x.frequency, np.abs(x.los)),
    )


_SIDE_LINES = "side lines that varying elements of a drive make as it turns"


def side_line_gaps(r: Requirement, one: Contribution) -> Iterator[Unobserved]:
    """Gap of what drives that turn make of a source's lines at other frequencies."""
    if one.side is None:
        return
    for why in one.side.unknown:
        yield open_gap(why)
    f, most = one.side.worst(r)
    counts = most.any(axis=1)
    if counts.any():
        why = _SIDE_LINES
        if not np.all(np.isfinite(most)):
            why = "; ".join((f"{why} have no bound", *one.side.unbounded))
        yield Unobserved(why, 0.0, math.inf, f[counts], most[counts])


_LEVEL_OVER_PART, _ROUNDED_PART = 3.0, 1e-6
"""Half of one over the slope of a level's logarithm over that of the part of the time beyond it, about,
for the part that is given to what is beside; and the least such part."""


class _Beyond(NamedTuple):
    """Motion at frequencies that are not known: by how much it may raise a figure, and why."""

    most: float
    """Root mean square [rad]; of a curve the largest line as part of it."""
    crest: float
    """[rad]."""
    why: tuple[str, ...]

    def of(self, statistic: str) -> float:
        """By how much a figure other than a level is raised at most."""
        return self.crest if statistic == "bound" else self.most


def _anywhere(r: Requirement, chosen: Sequence[Contribution]) -> _Beyond:
    """Motion that sources make at frequencies that are not known, as a root mean square; whatever its phases,
    such as add to all the rest.
    """
    each = [
        (anywhere.largest(r), anywhere.crest_in(r.metric), f"{one.source}: {anywhere.why}")
        for one in chosen
        if one.side is not None
        for anywhere in one.side.anywhere
    ]
    each += [
        (anywhere.largest(r), anywhere.crest_in(r.metric), f"all sources: {anywhere.why}")
        for anywhere in anywhere_together([one.side for one in chosen])
    ]
    total = math.fsum(size for size, _, _ in each)
    crest = math.fsum(size * crest for size, crest, _ in each)
    return _Beyond(total, crest, tuple(why for size, _, why in each if size > 0.1 * total))


def _raised(r: Requirement, most: Callable[[Requirement], float], beyond: _Beyond) -> float:
    """Figure that is ``most`` of what is known, with motion at unknown frequencies beside it.

    Of a level a part of the time goes to either: what is above s for longer than a part p of it has a
    mean square of more than p s^2.
    """
    if beyond.most == 0.0:
        return most(r)
    if r.statistic == "level" and r.interpretation != "ensemble":
        rest = 1.0 - r.confidence
        size = beyond.most / (max(most(r), 1e-300) * math.sqrt(rest))
        part = min(max((_LEVEL_OVER_PART * size) ** (2.0 / 3.0), _ROUNDED_PART), 0.5) * rest
        stricter = r.model_copy(update={"confidence": r.confidence + part})
        by_part = most(stricter) + beyond.most / math.sqrt(part)
        return min(by_part, most(r) + beyond.crest)
    return most(r) + (beyond.most if r.statistic == "rms" else beyond.crest)


def with_side_lines(
    r: Requirement, tones: CombinedLines, chosen: Sequence[Contribution]
) -> CombinedLines:
    """Lines of all sources, in the most of which side lines that may be of their frequency, or beat
    with them, add with the worst phases; what comes beside a line at its own frequency may take off as
    much of its least.
    """
    least, most = tones.least.copy(), tones.most.copy()
    for one in chosen:
        if one.side is None:
            continue
        f, size = one.side.worst(r)
        reach = np.maximum(tones.off[:, None] + frequency_error_bound(f), SLOW)
        near = np.abs(tones.frequency[:, None] - f) <= reach
        known = np.where(np.isfinite(size), size, 0.0)
        most += near @ known
        least -= (near & one.side.at_source) @ known
    return replace(tones, least=np.maximum(least, 0.0), most=most)


def side_densities(chosen: Sequence[Contribution]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Densities that drives that turn make of those of sources, at most."""
    sides = (one.side for one in chosen)
    return [side.density for side in sides if side is not None and side.density is not None]


def most_of_sources(r: Requirement, contributions: Sequence[Contribution], rule: Rule) -> float:
    """The most that lines and densities of sources make of what a requirement asks for; of a curve
    their largest part of it, of a level the rms, which takes less time and grows with it.
    """
    chosen = [worst_alternative(r, one) for one in contributions]
    tones = with_side_lines(r, combine_lines(chosen, rule), chosen)
    gaps = [gap for one in chosen for gap in side_line_gaps(r, one)]
    f = np.concatenate([tones.frequency, *(gap.frequency for gap in gaps)])
    most = np.concatenate([tones.most, *(gap.most for gap in gaps)])
    known = np.isfinite(most).all(axis=1)
    f, most = f[known], most[known]
    beyond = _anywhere(r, chosen)
    if r.curve is not None:
        return float(ratio_to_curve(r, f, most).max(initial=0.0)) + beyond.most
    plain = r if r.statistic != "level" else r.model_copy(update={"statistic": "rms"})
    densities = [one.most_density for one in chosen if one.most_density is not None]
    moved = Moved(f, most, densities + side_densities(chosen))
    if r.statistic != "level":  # whose rms beside errors would not grow with the lines as it does
        moved = moved._replace(errors=tones.errors)
    return evaluate(plain, moved) + beyond.of(plain.statistic)


def _metric_of_source(r: Requirement, one: Contribution) -> float:
    """Metric of the lines of one source; for a curve, the largest ratio to it."""
    if r.curve is not None:
        return float(ratio_to_curve(r, one.frequency, np.abs(one.los)).max(initial=0.0))
    return evaluate_metric(r, one.frequency, np.abs(one.los))


def metric_exceeds(r: Requirement, frequency: np.ndarray, los: np.ndarray, least: float) -> bool:
    """Whether the metric of lines is above ``least`` [rad].

    A level takes long: it is computed only where neither crests nor the mean square tell. What is
    within L for a part c of the time has a mean square of at most c L^2 + (1 - c) crest^2.
    """
    if r.statistic == "level":
        crest = evaluate_metric(r.model_copy(update={"statistic": "bound"}), frequency, los)
        if crest < _BELOW_CREST * least:
            return False
        rms = evaluate_metric(r.model_copy(update={"statistic": "rms"}), frequency, los)
        if rms**2 - (1.0 - r.confidence) * crest**2 > (least / _BELOW_CREST) ** 2:
            return True
    return evaluate_metric(r, frequency, los) > least


def _rms_and_bounds(
    r: Requirement, alternatives: Sequence[Contribution]
) -> tuple[np.ndarray, np.ndarray]:
    """Rms and bound of each of a source's alternatives [rad], (n,) each."""
    f = np.concatenate([one.frequency for one in alternatives])
    A = (
        np.abs(np.concatenate([one.los for one in alternatives]))[:, AXES[r.axis]]
        * counts_in_band(r, f)[:, None]
    )
    starts, window = (
        np.cumsum([0, *(len(one.names) for one in alternatives[:-1])]),
        r.window or r.apart or 1.0,
    )
    squares = mean_square_of_lines(r.metric, f, A, window, r.apart).sum(axis=1)
    crests = [
        np.add.reduceat(
            np.abs(windowed_amplitudes(r.metric, f, column, window, r.apart, UNIFORM_INSTANTS)),
            starts,
            axis=1,
        ).max(axis=0)
        for column in A.T
    ]
    return np.sqrt(np.add.reduceat(squares, starts)), np.sqrt(np.sum(np.square(crests), axis=0))


def _with_gaps(
    r: Requirement, chosen: Sequence[Contribution], contributions: Sequence[Contribution]
) -> list[Contribution]:
    """Chosen contributions with their gaps in the band and the lines that they may meet when swept."""
    highest, found = math.inf if r.highest is None else r.highest, []
    of_all = [error for one in chosen for error in one.errors]
    together = [open_gap(why) for why in reasons_together([one.side for one in chosen])]
    for k, (one, source) in enumerate(zip(chosen, contributions, strict=True)):
        gaps = (
            *one.gaps,
            *hub_edge_gaps(source),
            *side_line_gaps(r, one),
            *map(open_gap, reasons_against(r, one.errors, of_all)),
            *crossing_bounds(r, source, contributions),
            *beat_bounds(r, one, chosen[k:]),
            *(together if one.side is not None and one.side.shafts else ()),
        )
        there = (
            gap.inside(r.lowest, highest).about(AXES[r.axis])
            for gap in gaps
            if gap.high >= r.lowest and gap.low <= highest
        )
        found.append(replace(one, gaps=tuple(gap for gap in there if gap.most.any())))
    return found


def _open_reasons(r: Requirement, chosen: Sequence[Contribution], value: float) -> list[str]:
    """Reasons that may reverse the verdict, a sentence without a stop each."""
    least = math.sqrt(SIGNIFICANT_PART) * value
    found = []
    for one in chosen:
        for gap in one.gaps:
            bounded = value > 0.0 and np.all(np.isfinite(gap.most))
            if not bounded or metric_exceeds(r, gap.frequency, gap.most, least):
                found.append(f"{one.source}: {gap.why}")
        at_edge = one.settled & (
            counts_in_band(r, one.frequency - one.off) != counts_in_band(r, one.frequency + one.off)
        )
        whole_band = r.model_copy(update={"lowest": 0.0, "highest": None})
        if metric_exceeds(whole_band, one.frequency[at_edge], one.los[at_edge], least):
            names = ", ".join(np.array(one.names)[at_edge])
            found.append(f"{one.source}: {names} within frequency uncertainty of a band edge")
        ringing = ~one.settled & counts_in_band(r, one.frequency)
        if metric_exceeds(r, one.frequency[ringing], np.abs(one.los[ringing]), least):
            names = ", ".join(np.array(one.names)[ringing])
            remedy = f"a longer record.settle{steady_start_advice(one.scenario)}"
            found.append(f"{one.source}: {names} rings or is driven by noise ({remedy})")
    return list(dict.fromkeys(found))


def _unknown_phase_reasons(
    r: Requirement, chosen: Sequence[Contribution], rule: Rule, value: float
) -> list[str]:
    """Why a level is not known where lines have no known phases to each other, a sentence without a
    stop each.
    """
    if r.statistic != "level":
        return []
    whose: dict[str | int, list[tuple[str, float, float]]] = {}
    own = count()
    for one in chosen:
        for k in np.flatnonzero(one.settled & counts_in_band(r, one.frequency)):
            size = evaluate_metric(
                r.model_copy(update={"statistic": "bound"}), one.frequency[[k]], one.los[[k]]
            )
            if size**2 > SIGNIFICANT_PART * value**2:
                clock = _clock_of(one, int(k), rule) or next(own)
                whose.setdefault(clock, []).append((one.source, float(one.frequency[k]), size))
    why = []
    for lines in whose.values():
        sources, frequencies, sizes = zip(*lines, strict=True)
        if len(bases(np.array(frequencies), np.array(sizes))) > 1:
            why.append(
                f"{', '.join(dict.fromkeys(sources))}: frequencies of one clock that are not whole"
                f" multiples of one of {SLOW:g} Hz"
                f" or more, within {LOCKED:g} of each; phases drift, and all may crest together"
                " (give harmonics with all digits;"
                " statistic: rms does not depend on phases)"
            )
    if len(whose) < 2:
        return why
    names = ", ".join(dict.fromkeys(lines[0][0] for lines in whose.values()))
    return [
        *why,
        f"{names}: relative phases of the lines are unknown, and all peaks may coincide"
        " (give phases and a clock where they are known; statistic: rms does not depend on them)",
    ]


WITHIN_UNCERTAINTY = "within the uncertainty of phases, amplitudes and frequencies of the limit"


def _rank_shares(
    r: Requirement, chosen: Sequence[Contribution]
) -> tuple[tuple[Share, ...], tuple[Share, ...]]:
    """Sources, and their lines, by what they add to the mean square of the required metric."""
    plain = r.model_copy(update={"statistic": "rms"})
    sources, lines = [], []
    for one in chosen:
        A = np.abs(one.los) * one.settled[:, None]
        if one.density is None:
            own = []
        else:
            own = [one.density]
        errors = sum_of_errors(one.errors)
        whole = evaluate(plain, Moved(one.frequency, A, own, errors=errors))
        sources.append(Share(one.source, one.how, math.nan, whole, 0.0))
        for k, name in enumerate(one.names):
            rms = evaluate_metric(plain, one.frequency[[k]], A[[k]])
            lines.append(Share(one.source, name, float(one.frequency[k]), rms, 0.0))
        if own:
            noise = evaluate_metric(plain, np.zeros(0), np.zeros((0, 2)), own)
            lines.append(Share(one.source, DENSITY, math.nan, noise, 0.0))
        if errors:
            lines.append(Share(one.source, one.how, math.nan, evaluate_errors(plain, errors), 0.0))
    squares = sum(x.rms**2 for x in sources) or 1.0
    shared = [
        tuple(replace(x, share=x.rms**2 / squares) for x in sorted(each, key=lambda x: -x.rms))
        for each in (sources, lines)
    ]
    return shared[0], shared[1]


DENSITY = "density"
"""Name of a source's density among its lines."""
LEFT_OUT_IN_TURN = 3
"""Contributors of each requirement, the largest, without which its value is told."""


def _with_values_without(
    r: Requirement,
    chosen: Sequence[Contribution],
    rule: Rule,
    ranks: tuple[tuple[Share, ...], tuple[Share, ...]],
) -> tuple[tuple[Share, ...], tuple[Share, ...]]:
    """Sources and lines with the value of the requirement without each, the largest of them."""
    sources, lines = ranks
    if r.percentile is not None:  # of a campaign's cases, not of what sources are given as
        return ranks

    def without_source(x: Share) -> list[Contribution]:
        return [one for one in chosen if one.source != x.source]

    def without_line(x: Share) -> list[Contribution]:
        return [_without_part(one, x.line) if one.source == x.source else one for one in chosen]

    found = []
    for each, others in ((sources, without_source), (lines, without_line)):
        told = [replace(x, without=_value_of(r, others(x), rule)) for x in each[:LEFT_OUT_IN_TURN]]
        found.append((*told, *each[LEFT_OUT_IN_TURN:]))
    return found[0], found[1]


def _without_part(one: Contribution, name: str) -> Contribution:
    """A source without one of its lines, its density or its error, as to its value."""
    if name in one.names:
        los = one.los * (np.array(one.names) != name)[:, None]
        return replace(one, los=los)
    if name == DENSITY:
        return replace(one, density=None)
    return replace(one, errors=())


def _value_of(r: Requirement, chosen: Sequence[Contribution], rule: Rule) -> float:
    """The figure that is required of what sources are given as; of a curve, that of its worst
    line.
    """
    tones = combine_lines(chosen, rule, with_errors=False)
    if r.curve is not None:
        return _size_and_limit_of_worst_line(r, tones)[0]
    return evaluate_lines(r, tones, [one.density for one in chosen if one.density is not None])


# ---- Curves over frequency ----


def _rank_shares_by_curve(
    r: Requirement, chosen: Sequence[Contribution]
) -> tuple[tuple[Share, ...], tuple[Share, ...]]:
    """Sources by their lines, for densities do not count; lines by their part of what the curve
    allows each.
    """
    sources, lines = _rank_shares(r, [replace(one, density=None, errors=()) for one in chosen])
    of = {(one.source, name): k for one in chosen for k, name in enumerate(one.names)}
    over = {
        one.source: ratio_to_curve(r, one.frequency, np.abs(one.los) * one.settled[:, None])
        for one in chosen
    }
    parts = (replace(x, share=float(over[x.source][of[x.source, x.line]])) for x in lines)
    return sources, tuple(sorted(parts, key=lambda x: -x.share))


def ratio_to_curve(
    r: Requirement, frequency: np.ndarray, amplitude: np.ndarray, *, single_axis: bool = False
) -> np.ndarray:
    """Amplitudes over what the curve allows, (k,); 0 outside of the curve and of the band;
    ``single_axis`` as in ``figure``.
    """
    size = {
        "x": amplitude[:, 0],
        "y": amplitude[:, 1],
        "radial": amplitude.max(axis=1) if single_axis else np.hypot(*amplitude.T),
    }[r.axis]
    return np.where(counts_in_band(r, frequency), size / r.allowed.at(frequency), 0.0)


def _assess_by_curve(
    r: Requirement,
    chosen: Sequence[Contribution],
    contributions: Sequence[Contribution],
    rule: Rule,
) -> Assessment:
    tones = with_side_lines(r, combine_lines(chosen, rule), chosen)
    curve = r.curve or ()
    own = r.model_copy(
        update={
            "lowest": max(r.lowest, curve[0].frequency),
            "highest": min(r.highest or math.inf, curve[-1].frequency),
        }
    )
    chosen = _with_gaps(own, chosen, contributions)
    gaps = [gap for one in chosen for gap in one.gaps]
    edges = np.array([*(point.frequency for point in curve), own.lowest, own.highest])
    low, high = tones.frequency_bounds
    maybe = [tones.frequency, low, high, *np.clip(edges[:, None], low, high)]
    over_least = np.min(
        [ratio_to_curve(r, f, tones.least, single_axis=True) for f in maybe], axis=0
    )
    over_most = np.max([ratio_to_curve(r, f, tones.most) for f in maybe], axis=0)
    size, limit = _size_and_limit_of_worst_line(own, tones)
    beyond = _anywhere(own, chosen)
    known = limit * max(float(over_most.max(initial=0.0)), _hidden_ratio_to_curve(r, gaps))
    most = known + limit * beyond.most
    figure = _Figure(limit * float(over_least.max(initial=0.0)), size, most)
    verdict = figure.verdict(limit)
    why: list[str] = []
    if verdict == "not judged":
        why = [
            *_open_reasons(own, chosen, size),
            *_reasons_of(beyond, known, most, limit, size),
        ] or [WITHIN_UNCERTAINTY]
    return Assessment(
        r,
        size,
        figure.least,
        figure.most,
        size,
        math.nan,
        limit,
        verdict,
        tuple(why),
        *_with_values_without(own, chosen, rule, _rank_shares_by_curve(own, chosen)),
    )


def _size_and_limit_of_worst_line(r: Requirement, tones: CombinedLines) -> tuple[float, float]:
    """Size of the line that comes nearest to a curve, and what that allows there [rad]; where no
    line counts, 0 and the least that the curve allows.
    """
    over = ratio_to_curve(r, tones.frequency, tones.value)
    if not over.any():
        return 0.0, float(min(point.amplitude for point in r.curve or ()))
    worst = [int(np.argmax(over))]
    bound = r.model_copy(update={"statistic": "bound"})
    size = evaluate_metric(bound, tones.frequency[worst], tones.value[worst])
    return size, size / float(over[worst[0]])


def _hidden_ratio_to_curve(r: Requirement, gaps: Sequence[Unobserved]) -> float:
    """The most of what is not known over what a curve allows; infinite where nothing bounds it."""
    if any(not np.all(np.isfinite(gap.most)) for gap in gaps):
        return math.inf
    return max(
        (float(ratio_to_curve(r, gap.frequency, gap.most).max(initial=0.0)) for gap in gaps),
        default=0.0,
    )


# ---- Campaigns ----


def _case_figures(
    r: Requirement,
    chosen: Sequence[Contribution],
    contributions: Sequence[Contribution],
    rule: Rule,
) -> _CaseFigures | None:
    """The figure of each case of a campaign, with the phases of the nominal one and with what other
    sources are on the craft of the case; None without a campaign, and of levels.
    """
    k, drawn = next(((k, one) for k, one in enumerate(chosen) if one.cases is not None), (0, None))
    if drawn is None or drawn.cases is None or r.statistic == "level":
        return None
    more = drawn.cases.shape[1] - len(drawn.names)
    phases = np.vstack([np.exp(1j * np.angle(drawn.los)), np.ones((more, 2))])
    loose = np.array([not clock for clock in drawn.clocks], dtype=bool)
    own = replace(
        drawn,
        rings=np.append(~drawn.settled, np.zeros(more, dtype=bool)),
        unlocked=np.append(loose, np.ones(more, dtype=bool)),
        relative_error=0.0,
        frequency_error=None,  # of the nominal lines alone, and a case counts as it was found
    )
    found, beyond = [], 0.0
    at = zip(_frequencies_of_cases(drawn), drawn.cases, strict=True)
    for number, (f, case) in enumerate(at):
        sources, each = _sources_in_case(r, number, chosen, contributions)
        each[k] = replace(own, frequency=f, los=case * phases, density=each[k].density)
        densities = [one.density for one in each if one.density is not None]
        tones = combine_lines(each, rule, with_errors=False)
        moved = Moved(tones.frequency, tones.value, densities, errors=tones.errors)
        value = evaluate(r, moved)
        bounds = math.nan, math.nan
        if r.percentile is not None:
            each[k] = replace(each[k], relative_error=_errors_in_case(drawn, case))
            sources[k] = each[k]
            bounds = _bounds_in_case(r, each, sources, rule)
            beyond = max(beyond, _side_lines_in_case(r, contributions, number))
        found.append((bounds[0], value, bounds[1]))
    least, values, most = np.array(found).reshape(-1, 3).T
    return _CaseFigures(values, least, most, beyond)


def _sources_in_case(
    r: Requirement,
    number: int,
    chosen: Sequence[Contribution],
    contributions: Sequence[Contribution],
) -> tuple[list[Contribution], list[Contribution]]:
    """Sources on the craft of a case, and each at the alternative that is worst there; where they are
    the same in all cases, as they are ``chosen``.
    """
    there = [one if one.in_case is None else one.in_case(number) for one in contributions]
    each = [
        one if source.in_case is None else worst_alternative(r, own)
        for one, source, own in zip(chosen, contributions, there, strict=True)
    ]
    return there, each


def _frequencies_of_cases(drawn: Contribution) -> Sequence[np.ndarray]:
    """Frequencies [Hz] of the lines of a drive in each case."""
    assert drawn.cases is not None
    if drawn.cases_frequency is None:
        return [drawn.frequency] * len(drawn.cases)
    return list(drawn.cases_frequency)


def _errors_in_case(drawn: Contribution, case: np.ndarray) -> np.ndarray:
    """By which part lines of a drive may be smaller and larger in a case of a campaign, (2, k, 2), of
    amplitudes ``case`` (k, 2): large lines by the same part as in the nominal case, others and those
    that only cases have as those of them that are known least.
    """
    size, errors = np.abs(drawn.los), drawn.relative_errors
    large = size > SIGNIFICANT_PART * size.max(initial=0.0)
    others = np.where(large, errors, 0.0).max(axis=(1, 2), initial=0.0)
    found = np.broadcast_to(others[:, None, None], (2, *case.shape)).copy()
    found[:, : size.shape[0]] = np.where(large, errors, found[:, : size.shape[0]])
    return found


def _bounds_in_case(
    r: Requirement, chosen: Sequence[Contribution], sources: Sequence[Contribution], rule: Rule
) -> tuple[float, float]:
    """Between which the figure lies in a case of a campaign [rad]: phases that are not known, lines
    that beat or meet, frequencies that may be off.
    """
    gapped = _with_gaps(r, [replace(one, side=None) for one in chosen], sources)
    gaps = [gap for one in gapped for gap in one.gaps]
    smallest = [one.least_density for one in chosen if one.least_density is not None]
    largest = [one.most_density for one in chosen if one.most_density is not None]
    tones = combine_lines(chosen, rule)
    return metric_bounds(r, tones, gaps, smallest, _swept_sources(chosen, rule), largest)


def _side_lines_in_case(
    r: Requirement, contributions: Sequence[Contribution], number: int
) -> float:
    """The most that side lines make in a case of a campaign [rad], where crafts differ."""
    there = [one.in_case(number) for one in contributions if one.in_case is not None]
    if not there:
        return 0.0
    gaps = [gap for one in there for gap in side_line_gaps(r, one)]
    f = np.concatenate([np.zeros(0), *(gap.frequency for gap in gaps)])
    most = np.concatenate([np.zeros((0, 2)), *(gap.most for gap in gaps)])
    if not np.all(np.isfinite(most)):
        return math.inf
    if reasons_together([one.side for one in there]):
        return math.inf
    beyond = _anywhere(r, there).of(r.statistic)
    return evaluate_metric(r, f, most, side_densities(there)) + beyond


def _percentile_gaps(
    r: Requirement, chosen: Sequence[Contribution], cases: _CaseFigures | None
) -> list[str]:
    """Why a percentile that is required cannot be judged."""
    if r.percentile is None:
        return []
    if cases is None:
        return ["percentile: needs an ensemble; name a campaign of the scenario"]
    why = [f"percentile: {one.cases_lack}" for one in chosen if one.cases_lack]
    if len(cases.value) < draws_needed(r.percentile):
        needed = draws_needed(r.percentile)
        why += [
            f"percentile: P{100 * r.percentile:g} needs {needed} cases, and the campaign has"
            f" {len(cases.value)}"
        ]
    return why
