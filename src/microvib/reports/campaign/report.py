"""The report of a campaign: its contents, its figures, its document."""

from __future__ import annotations

import math
import re
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from microvib.analysis.limits import Limit
from microvib.analysis.seeds import seeds_of
from microvib.model.line_names import is_sideband
from microvib.model.scenario import Scenario
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.campaign import figures
from microvib.reports.document import Block, Document, Fact, Section, Table, Text, table
from microvib.reports.numbers import (
    brief_milli,
    count_text,
    plain_number,
    torque,
    torque_as_given,
    truncate,
)
from microvib.studies.campaign import statistics
from microvib.studies.campaign.design import limit_of
from microvib.studies.campaign.effects import Indices, Tornado, sobol, tornado
from microvib.studies.campaign.folder import Campaign
from microvib.studies.campaign.results import DONE, FAILED, MISSING, Results
from microvib.studies.campaign.statistics import (
    LARGEST_LINE,
    AnyLevel,
    Estimate,
    LineStatistics,
    draws_needed,
)
from microvib.units import Si

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

MAX_WORST_CASES = 5
"""Worst cases that are listed for each line."""
MAX_LEVELS = 20
MAX_REASONS = 10
"""Levels, those with the largest lines, that are listed in a report; all of them are in
statistics.csv.
"""


@dataclass(frozen=True)
class Summary:
    """The contents of a campaign report."""

    results: Results
    limit: float | None
    band: tuple[float, float]
    rows: list[LineStatistics]
    """Level by level."""
    any_level: AnyLevel | None
    """Draws that are above the limit at one of several levels; None without a limit, or with one
    level.
    """
    lines: list[str]
    """Lines of the pictures."""
    worst: dict[str, list[tuple[int, float]]]
    tornados: list[Tornado]
    indices: list[Indices]

    @property
    def by_level(self) -> list[LineStatistics]:
        """The largest line of each level, the highest first."""
        return sorted(
            (row for row in self.rows if row.line == LARGEST_LINE), key=lambda row: -row.largest
        )

    @property
    def several(self) -> bool:
        """Whether there are several levels."""
        design = self.results.campaign.design
        return design.cases > len(design.samples)


def summarise(results: Results, limit: float | None, band: tuple[float, float]) -> Summary:
    """Statistics, worst cases, effects and Sobol indices of merged results."""
    rows = statistics.line_statistics(results, limit, band)
    lines = statistics.main_lines(rows) or list(results.lines[:4])
    shown = [LARGEST_LINE, *lines]
    tornados = [t for line in shown[:4] if (t := tornado(results, line, band)) and t.effects]
    indices = [i for line in shown[:4] if (i := sobol(results, line, band))]
    worst = {line: statistics.worst_cases(results, line, band, MAX_WORST_CASES) for line in shown}
    if limit is not None and len({r.level for r in rows}) > 1:
        any_level = statistics.at_any_level(results, limit, band)
    else:
        any_level = None
    return Summary(results, limit, band, rows, any_level, lines, worst, tornados, indices)


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


def frequency_text(r: LineStatistics) -> str:
    """Frequency of a line, or its range over the cases [Hz]."""
    low, high = r.frequency
    if not math.isfinite(low):
        return ""
    if high - low < 1e-4 * high:
        return f"{low:.5g}"
    return f"{low:.4g} to {high:.4g}"


def interval(e: Estimate) -> str:
    """An interval; empty where the draws are too few for it."""
    if math.isfinite(e.value):
        return f"{brief_milli(e.low)} to {brief_milli(e.high)}"
    return ""


def above_limit(r: LineStatistics) -> str:
    """Draws above the limit, with the probability that this says of the next one and its interval."""
    if r.above is None:
        return ""
    if r.exceedance is None:
        if r.above:
            return "above"
        if r.unknown:
            return "not judged"
        return "below"
    e, doubt = r.exceedance, f", {r.unknown} not judged" if r.unknown else ""
    return f"{r.above} of {r.judged}{doubt}: {100 * e.value:.3g} % ({percents(e)})"


def percents(e: Estimate) -> str:
    """An interval of probabilities in per cent."""
    return f"{100 * e.low:.3g} to {100 * e.high:.3g}"


def counts(results: Results) -> list[int]:
    """Number of cases in each state: MISSING, DONE, FAILED."""
    return [int(n) for n in np.bincount(results.state, minlength=3)]


class Picture(NamedTuple):
    """A drawing with its caption."""

    title: str
    drawing: Drawing
    caption: str


def draw(s: Summary) -> dict[str, Picture]:
    """All pictures of a campaign, by the names of their files."""
    results, design = s.results, s.results.campaign.design
    made: dict[str, Picture] = {}
    if not counts(results)[DONE]:
        return made  # every case failed, or none is computed
    if s.rows:
        if s.several:
            where = " Each line at the level at which it is largest."
        else:
            where = ""
        text = f"Median, 95 % and 99 % point where the draws carry them, and the largest amplitude.{where}"
        made["envelopes"] = Picture(
            "Envelopes", figures.envelopes(shown_rows(s)[:16], s.limit), text
        )
    if s.rows and s.by_level[0].level.draws > 1:
        level = s.by_level[0].level
        if s.several:
            where = f" At {level.text}, the level with the largest line."
        else:
            where = ""
        given = results, [LARGEST_LINE, *s.lines][:6], s.limit, s.band, level
        text = f"Fraction of the draws in which a line exceeds an amplitude.{where}"
        made["exceedance"] = Picture("Exceedance", figures.exceedances(*given), text)
        text = f"Draws by amplitude of each line. Full, dashed and dotted: median, 95 % and 99 % point.{where}"
        made["histograms"] = Picture("Histograms", figures.histograms(*given), text)
    if any(len(levels.values) > 1 for levels in design.levels):
        text = "Median over the levels of a key, the largest where other keys have levels too; shaded, all cases at it."
        drawing = figures.over_levels(results, [LARGEST_LINE, *s.lines][:4], s.band)
        made["levels"] = Picture("Over the levels", drawing, text)
    if s.tornados:
        text = "From the 5 % to the 95 % point of each key, the others at their means; levels from lowest to highest mean"
        made["tornado"] = Picture("What moves the lines", figures.tornados(s.tornados), f"{text}.")
    if s.indices:
        text = "Fraction of the variance that a key explains alone (first order) and with all others (total), 95 % bootstrap."
        made["sobol"] = Picture("Sobol indices", figures.sobol_bars(s.indices), text)
    scatter = figures.scatters(results, LARGEST_LINE, s.band)
    if scatter is not None:
        made["scatter"] = Picture("Cases", scatter, "Largest line of each case over what varies.")
    return made


def campaign_report(s: Summary, pictures: dict[str, Picture]) -> Document:
    """The report of a campaign; its first page says what was varied, the lines against the limit,
    and the envelopes.
    """
    campaign, base = s.results.campaign, s.results.campaign.design.base
    figure = {
        name: figure_block(drawing, title, caption)
        for name, (title, drawing, caption) in pictures.items()
    }
    envelopes = figure.pop("envelopes", None)
    lines: list[Block] = [*([_lines(s)] if s.rows else []), *([envelopes] if envelopes else [])]
    by_level = (
        s.rows and s.several
    )  # then the first page has the levels, and the lines the next one
    first_page: list[Block] = [_levels(s)] if by_level else lines
    sections = [
        *([Section("Lines", tuple(lines), new_page=True)] if by_level else []),
        Section("Worst cases", tuple(_worst(s)), new_page=True),
        Section("What is varied", (_varied(campaign), Text(_sampling(campaign, s)))),
        Section("How to read the figures", (Text(_how_to_read(s)),)),
        *(Section(pictures[name].title, (block,)) for name, block in figure.items()),
        *([Section("Failed cases", _failed(s.results))] if FAILED in s.results.state else []),
        Section(
            "Identity",
            (Text(f"Campaign SHA-256 `{campaign.identity}`, over the scenario and all cases."),),
        ),
    ]
    done, cases = counts(s.results)[DONE], campaign.design.cases
    subtitle = f"{done} of {cases} cases of {base.title or campaign.design.study.scenario}"
    title = campaign.design.study.title or f"Campaign {campaign.folder.name}"
    return study_report(
        "Campaign", title, subtitle, facts=_facts(s), first_page=first_page, sections=sections, scenario=base
    )  # fmt: skip


def _facts(s: Summary) -> list[Fact]:
    found = counts(s.results)
    facts = [Fact(str(found[DONE]), "cases")]
    if found[FAILED]:
        facts += [Fact(str(found[FAILED]), "failed", "fail")]
    else:
        facts += []
    if found[MISSING]:
        facts += [Fact(str(found[MISSING]), "not computed yet", "fail")]
    else:
        facts += []
    if not s.rows:
        return facts
    top = s.by_level[0]
    if s.several:
        at = f" at {truncate(top.level.text, 80)}"
    else:
        at = ""
    if math.isfinite(top.p95.value):
        facts.append(Fact(torque(top.p95.value), f"largest line, 95 % of the draws below{at}"))
    facts.append(Fact(torque(top.largest), f"worst case, number {top.worst}{at}"))
    return _limit_facts(s) + facts


def _limit_facts(s: Summary) -> list[Fact]:
    """What may be said against the limit, of every level by itself and of units that pass through
    all levels.
    """
    if s.limit is None:
        return []
    allowed, facts = torque_as_given(s.limit), []
    fails, open_ones = (
        [row for row in s.by_level if row.above],
        [row for row in s.by_level if row.unknown],
    )
    incomplete = any(row.level.failed for row in s.by_level)
    if fails:
        kind: Literal["", "pass", "fail"] = "fail"
    elif open_ones or incomplete:
        kind = ""
    else:
        kind = "pass"
    if s.several:
        if open_ones:
            doubt = f"; cases that could not be judged at {len(open_ones)}"
        else:
            doubt = ""
        facts.append(
            Fact(
                f"{len(fails)} of {len(s.by_level)} levels",
                f"with cases above {allowed}{doubt}",
                kind,
            )
        )
    chance = s.any_level if s.several else s.by_level[0]
    if chance is not None and chance.exceedance is not None:
        if chance.unknown:
            doubt = f", {chance.unknown} not judged"
        else:
            doubt = ""
        if isinstance(chance, AnyLevel):
            total = chance.count
        else:
            total = chance.judged
        text = (
            f"of {total} draws above {allowed}{' at one level or more' if s.several else ''}{doubt}"
        )
        e = chance.exceedance
        facts.append(
            Fact(f"{100 * e.value:.3g} %", f"{text} (95 % interval {percents(e)} %)", kind)
        )
    return facts or [Fact(above_limit(s.by_level[0]), allowed, kind)]


def why_not_judged(s: Summary) -> str:
    """Why cases could not be judged, the commonest reason first; empty where all were."""
    if s.limit is None or not any(row.unknown for row in s.by_level):
        return ""
    own = limit_of(s.results.campaign.design.study)
    if own != Limit(Si(s.limit), *map(Si, s.band)):
        return (
            "Cases are judged as runs are only against the study's own limit and band; of another"
            " limit it is only known what"
            " is above it."
        )
    reasons = Counter(text for text in s.results.gaps if text)
    total = count_text(reasons.total(), "case")
    if reasons:
        return f"{reasons.most_common(1)[0][0]} (of {total}, the commonest reason)"
    return ""


def _lines(s: Summary) -> Table:
    header = ["line", "frequency [Hz]", "median [mN m]", "P95 [mN m]", "its interval [mN m]", "P99 [mN m]", "largest [mN m]",
              "case [1]", "above the limit [1]", "at level"]  # fmt: skip
    rows = [
        [
            r.line,
            frequency_text(r),
            brief_milli(r.median.value),
            brief_milli(r.p95.value),
            interval(r.p95),
            brief_milli(r.p99.value),
            brief_milli(r.largest),
            str(r.worst),
            above_limit(r),
            truncate(r.level.text, 60),
        ]
        for r in shown_rows(s)
    ]
    if s.several:
        where = ", each at the level at which it is largest"
    else:
        where = ""
    return table(header, rows, f"Lines{where}; 0-to-peak.", {0: "strong"})


def _levels(s: Summary) -> Table:
    header = ["level", "draws [1]", "median [mN m]", "P95 [mN m]", "P99 [mN m]", "largest [mN m]", "case [1]",
              "above the limit [1]"]  # fmt: skip
    rows = [
        [truncate(r.level.text, 80), str(r.level.draws), brief_milli(r.median.value), brief_milli(r.p95.value),
         brief_milli(r.p99.value), brief_milli(r.largest), str(r.worst), above_limit(r)]
        for r in s.by_level[:MAX_LEVELS]
    ]  # fmt: skip
    more = len(s.by_level) - len(rows)
    if more > 0:
        rest = f" {more} more are in `statistics.csv`."
    else:
        rest = ""
    return table(
        header, rows, f"The largest line at each level, the highest first.{rest}", {0: "strong"}
    )


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
    )
    if s.several:
        text += (
            " Levels are judged one by one: at which of them a unit runs is not a matter of chance."
        )
    failed, why = sum(r.level.failed for r in s.by_level), why_not_judged(s)
    if failed:
        text += f" {count_text(failed, 'case')} without figures (failed, or not computed) are not in them."
    else:
        text += ""
    text += f" {why}" if why else ""
    return f"{text}{band} All figures are the model's, for the assumed spread; they are not those of a measured batch."


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
        [x.key, truncate(f"{count_text(len(x.values), 'level')}: {', '.join(x.labels)}", 120)]
        for x in design.levels
    ]
    rows += [[x.key, x.text] for x in design.uncertain]
    rows += [
        [" and ".join(c.keys), f"correlation {c.coefficient:g}"] for c in design.study.correlations
    ]
    rows += [
        [f"combination {k}", truncate(str(item), 120)]
        for k, item in enumerate(design.combinations)
        if item
    ]
    return table(["`key`", "how"], rows)


def _worst(s: Summary) -> list[Block]:
    """The cases with the largest lines and what is varied in them, a column each; the worst cases
    of every line.
    """
    found = s.worst[LARGEST_LINE][:MAX_WORST_CASES]
    if not found:
        return [Text("No case has been computed yet.")]
    design = s.results.campaign.design
    labels = [design.labels(case) for case, _ in found]
    which = {
        case: line
        for line, cases in reversed(s.worst.items())
        if line != LARGEST_LINE
        for case in cases
    }
    header = ["what", "unit", *(f"case {case} [1]" for case, _ in found), "scenario [1]"]
    rows = [
        ["largest line", "mN m", *(brief_milli(amplitude) for _, amplitude in found), ""],
        ["which line", "", *(which.get(case, "") for case in found), ""],
    ]
    varied = {key: [x.get(key, "") for x in labels] for key in design.keys}
    rows += [_varied_row(design.base, key, texts) for key, texts in varied.items() if any(texts)]
    caption = "Cases with the largest lines, worst first; scenario: what the study starts from."
    folder = s.results.campaign.folder
    again = f"`microvib campaign case {shlex.quote(folder.name or str(folder))} CASE`. All digits are in `worst.csv`."
    note = Text(f"Each case runs again alone: {again}", note=True)
    return [table(header, rows, caption, {0: "strong"}), _worst_of_lines(s), note]


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
    header, rows = ["line"], []
    for what in ("worst case", "second", "third"):
        header += [f"{what} [1]", "its amplitude [mN m]"]
    for line, found in s.worst.items():
        cells = [
            cell for case, amplitude in found[:3] for cell in (str(case), brief_milli(amplitude))
        ]
        rows.append([line, *cells, *[""] * (6 - len(cells))])
    return table(header, rows, "The worst cases of each line.", {0: "strong"})


def _failed(results: Results) -> tuple[Block, ...]:
    rows = [[str(case), reason] for case, reason in enumerate(results.reasons) if reason]
    if len(rows) > 20:
        more = [Text("All of them are in `failed.csv`.")]
    else:
        more = []
    return table(["case [1]", "reason"], rows[:20]), *more
