"""A quieter drive as text, tables, pictures, and the files that its driver takes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from microvib.analysis.noise import is_negligible
from microvib.analysis.start import record_gap, rounded_up
from microvib.io.current_table import integer_columns
from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import rows_csv
from microvib.model.driven import noise_bands
from microvib.model.torque_margin import ResistingTorque, lag_of_array, torque_margin
from microvib.reports import sheets
from microvib.reports.document import Fact, Text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture, Verdict
from microvib.results import COUNT, Column, Measure, Table
from microvib.studies.campaign.statistics import draws_needed
from microvib.studies.quiet.levers import Setting, levels_of, with_levers
from microvib.studies.quiet.objective import OF_LIMIT
from microvib.studies.quiet.starts import SEARCHED, STARTS
from microvib.studies.quiet.study import (
    P95,
    LeverAlone,
    LineChange,
    QuietDrive,
    Spread,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_LINES = 12
"""Lines that a report shows, the largest first."""
CASES_OF_QUANTILE = 19
"""Cases of which the largest is exceeded by a further one with a probability of 5 %."""


def quiet_outcome(found: QuietDrive, target: float | None = None) -> Outcome:
    """A quieter drive for those who decide: what to change, what it brings over the cases, what it
    costs.

    With a ``target``, in SI, the verdict is on the 95 % quantile over the cases; objectives that are
    parts of a limit have it.
    """
    if found.objective.measure == OF_LIMIT:
        target = 1.0
    title = found.scenario.title or "drive"
    first: list[Item] = [
        Text(_decision(found)),
        *(Text(text) for text in _verdict_text(found, target)),
        _designs(found),
        *(Text(text) for text in _warnings(found)),
        Picture(
            "cases", lambda: draw_cases(found), "Before and after over the cases", _CASES_CAPTION
        ),
    ]
    return Outcome(
        "Quieter drive",
        f"Quieter drive: {title}",
        _summary(found),
        _verdict(found, target),
        tuple(_facts(found, target)),
        (
            Part("", tuple(first)),
            Part("Each lever alone, on the nominal drive", tuple(_alone(found))),
            Part("Line by line", tuple(_lines(found))),
            Part("Torque margin", tuple(_margins(found))),
            Part("What was tried", tuple(_tried(found)), new_page=False),
            Part("Cases", (Pairs(tuple(_cases(found))),)),
        ),
        found.scenario,
        data={"levers": _data(found)},
        other_files=dict(_handed_over(found)),
    )


_CASES_CAPTION = (
    "Each step is a drawn case, from its worst start. Dashed: the 95 % quantile. What is far right"
    " slips and sticks, or found another motion."
)


def _summary(found: QuietDrive) -> str:
    starts = len(STARTS)
    return (
        f"Objective: {found.objective.text}. Judged on {found.after.cases.size} drawn cases, each from"
        f" {starts} starts; {found.runs} runs were simulated."
    )


def _decision(found: QuietDrive) -> str:

    def figure(value: float) -> str:
        return found.objective.measure.figure(value) or _absent(value)

    before, after = found.before, found.after
    change = _change(before.p95, after.p95)
    verb = "Set" if found.setting is not None else "Judged"
    return (
        f"{verb}: {found.setting_text}. 95 % of cases: {figure(before.p95)} before,"
        f" {figure(after.p95)} after{change}; the nominal drive: {figure(before.nominal)} before,"
        f" {figure(after.nominal)} after{_change(before.nominal, after.nominal)}.{_not_told(found)}"
    )


def _not_told(found: QuietDrive) -> str:
    """Sentence on figures that the records leave open, and what to do; empty without one."""
    before, after = found.before, found.after
    if not (before.unknown or after.unknown or math.isnan(before.nominal + after.nominal)):
        return ""
    return (
        f" Not known in {before.unknown} of {before.cases.size} cases before and {after.unknown} of"
        f" {after.cases.size} after: {_record_reason(found)}."
    )


def _change(before: float, after: float) -> str:
    if not (0.0 < before < math.inf and 0.0 < after < math.inf):
        return ""
    return f" ({20.0 * math.log10(after / before):+z.1f} dB)"


def _absent(*figures: float) -> str:
    """Text for a figure that is not finite: of a drive that does not come to its rate, or of
    one whose record does not tell.
    """
    return "not known" if any(map(math.isnan, figures)) else "fails"


def _spread_columns(measure: Measure, designs: Sequence[Spread]) -> tuple[Column, ...]:
    absent = _absent(*(x for one in designs for x in (one.nominal, one.worst)))
    return (
        Column("design", "design"),
        Column("nominal", "nominal", measure, absent=absent),
        Column("median", "median", measure, absent=absent),
        Column("p95", "P95", measure, absent=absent),
        Column("p95_most", "P95 at most", measure, absent="not bounded"),
        Column("worst", "worst case", measure, absent=absent),
        Column("several_motions", "cases with several motions", COUNT),
        Column("failed", "cases that fail", COUNT),
        Column("unknown", "cases not known", COUNT),
    )


def _spread_row(one: Spread) -> tuple[Any, ...]:
    return (
        one.design,
        one.nominal,
        one.median,
        one.p95,
        one.p95_most,
        one.worst,
        one.coexisting,
        one.failed,
        one.unknown,
    )


def _designs(found: QuietDrive) -> Table:
    designs = [found.before, found.after, *([found.best_nominal] if found.best_nominal else [])]
    columns = _spread_columns(found.objective.measure, designs)
    return Table(
        "designs",
        columns,
        tuple(map(_spread_row, designs)),
        caption="Each case counts from its worst start. P95 at most: upper end of the 95 % confidence"
        " interval of the quantile.",
    )


def _warnings(found: QuietDrive) -> Iterator[str]:
    figure = found.objective.measure.figure
    best = found.best_nominal
    if found.why_not:
        yield f"Not allowed: {found.why_not}."
    if found.trap and best is not None:
        yield (
            f"The trap: the setting that is best for the nominal drive ({found.best_nominal_text})"
            f" gives {figure(best.from_rest)} from rest, and {figure(best.p95)} in 95 % of the cases;"
            f" {best.coexisting} of {best.cases.size} cases have several motions there."
        )
    if found.after.coexisting:
        yield (
            f"In {found.after.coexisting} of {found.after.cases.size} cases the start decides which of"
            " several motions the quieter drive has; the table has the loudest."
        )
    needed = draws_needed(P95)
    if found.after.cases.size < needed:
        yield (
            f"{found.after.cases.size} cases do not bound a 95 % quantile; {needed} cases or more do."
        )
    if found.after.cases.size < CASES_OF_QUANTILE:
        yield (
            f"The largest of {found.after.cases.size} cases stands for their 95 % quantile; a further"
            f" case exceeds it with a probability of {100.0 / (found.after.cases.size + 1):.2g} %."
        )
    if found.cases.assumed:
        yield (
            "The spread of the cases is assumed, not measured: a study file states yours"
            " (`microvib quiet --study`; on the page under Scatter and constraints)."
        )
    at_end = list(_at_end(found))
    if at_end:
        yield f"At the end of its range, beyond which it was not tried: {', '.join(at_end)}."


def _at_end(found: QuietDrive) -> Iterator[str]:
    if found.setting is None:
        return
    for lever, numbers in zip(found.levers, found.setting.numbers, strict=True):
        hard_end = lever.name == "ramp"
        if (
            not lever.choices
            and lever.name != "table"
            and not hard_end
            and numbers[0] in (0.0, 1.0)
        ):
            yield lever.name


def _verdict(found: QuietDrive, target: float | None) -> Verdict:
    if target is None:
        return ""
    if found.why_not or found.after.p95_least > target:
        return "fail"
    return "not judged" if _why_not_judged(found, target) else "pass"


def _why_not_judged(found: QuietDrive, target: float) -> str:
    """Reason why a design that does not fail does not pass, a clause; empty where it passes.

    Of the line of sight only a budget knows other sources and gaps, no record shows what lies above
    its passband, and one draw says little of noise.
    """
    objective, scenario, after = found.objective, found.scenario, found.after
    most = target * (1.0 if objective.curve is None else objective.curve.least)
    if objective.sees_pointing:
        return "these are the drive's lines alone; a budget (`microvib budget`) judges the line of sight"
    if noise_bands(scenario) and not is_negligible(scenario, scenario.record.duration, most):
        return "each case has one draw of the noise, which another draw may exceed"
    # what rings from the start is left out here, so that only the length of the record is asked for
    if gap := record_gap(found.quieter, scenario.record.duration, simulated=False):
        return gap.why
    if after.cases.size < draws_needed(P95):
        needed = draws_needed(P95)
        return f"{after.cases.size} cases do not bound a 95 % quantile; {needed} or more do"
    if after.p95_most > target and after.unknown:
        return _why_unknown(found)
    if after.p95_most > target:
        upper = objective.measure.figure(after.p95_most) or "infinity"
        return (
            f"the quantile's confidence interval reaches up to {upper}; more cases make it narrower"
        )
    return ""


def _why_unknown(found: QuietDrive) -> str:
    """Clause on cases in which the record does not tell what is asked for."""
    after = found.after
    return f"in {after.unknown} of {after.cases.size} cases {_record_reason(found)}"


def _record_reason(found: QuietDrive) -> str:
    """Clause on what a record does not tell, why, and what to do."""
    needed = [x.duration for x in (found.before, found.after) if math.isfinite(x.duration)]
    longer = "use a longer record.settle or record.duration"
    if needed:
        longer = f"use record.duration >= {rounded_up(max(needed))} s, and a longer record.settle"
    return (
        f"the record of {found.scenario.record.duration:g} s does not tell the {found.objective.text} (still"
        f" changing, not resolved from its mean or other lines, or above the passband); {longer}"
    )


def _verdict_text(found: QuietDrive, target: float | None) -> Iterator[str]:
    """Verdict of a limit on the design, a sentence."""
    verdict = _verdict(found, target)
    if target is None or not verdict:
        return
    allowed = found.objective.measure.figure(target)
    why = ""
    if verdict == "not judged":
        why = f": {_why_not_judged(found, target)}"
    elif found.why_not:
        why = f": {found.why_not}"
    yield f"Limit, {allowed} for 95 % of the cases: {verdict}{why}."


def _facts(found: QuietDrive, target: float | None) -> Iterator[Fact]:
    measure = found.objective.measure
    after, before = found.after.p95, found.before.p95
    yield Fact(measure.figure(after) or _absent(after), f"95 % of cases, {found.objective.text}")
    yield Fact(measure.figure(before) or _absent(before), "before")
    yield Fact(f"{found.margins[1].margin:+.2f}", "torque margin with its factors")
    if target is not None:
        verdict = _verdict(found, target)
        status: Literal["", "pass", "fail"] = "" if verdict == "not judged" else verdict
        yield Fact(verdict.capitalize(), f"P95 at most {measure.figure(target)}", status)


def _alone(found: QuietDrive) -> Iterator[Item]:
    if not found.alone:
        return
    measure = found.objective.measure
    columns = (
        Column("lever", "lever", role="key"),
        Column("figure", "worst start", measure, absent="fails"),
        Column("from_rest", "from rest", measure, absent="fails"),
        Column("setting", "setting"),
    )
    rows = [(x.lever, x.figure, x.from_rest, _setting_or_reason(x)) for x in found.alone]
    yield Table("levers_alone", columns, tuple(rows))


def _setting_or_reason(one: LeverAlone) -> str:
    return one.setting or f"not allowed: {one.why_not}"


def _lines(found: QuietDrive) -> Iterator[Item]:
    yield Picture("lines", lambda: draw_lines(found), "Lines before and after", _LINES_CAPTION)
    yield Table.of(
        "lines", LineChange, found.lines, for_readers=found.lines[:SHOWN_LINES], brief=SHOWN_LINES
    )


_LINES_CAPTION = "Bars: the nominal drive, from rest. Ticks: 95 % quantile over the cases."


def _margins(found: QuietDrive) -> Iterator[Item]:
    before, after = found.margins
    yield Text(
        f"Motor torque {_torque(after.available)}, required {_torque(after.required)} with all factors:"
        f" margin {after.margin:+.2f} (before: {before.margin:+.2f}). The array stays"
        f" {math.degrees(lag_of_array(found.quieter)):.2g} deg behind its command by friction."
    )
    yield Table.of("torque_margin", ResistingTorque, after.resisting, caption=_FACTORS)


_FACTORS = (
    "Factors as ECSS-E-ST-33-01C is commonly quoted with for calculated torques; not compared with its"
    " text. The sum counts with a further factor."
)


def _torque(value: float) -> str:
    return Measure("mN m", 1e-3, ".4g").figure(value)


def _tried(found: QuietDrive) -> Iterator[Item]:
    if len(found.tried) < 2:
        return
    allowed = [one for one in found.tried if math.isfinite(one.worst)]
    refused = len(found.tried) - len(allowed)
    searched = ", ".join(start.name for start in SEARCHED)
    yield Text(
        f"{len(found.tried)} settings over {len(found.cases.searched)} cases, {searched}; {refused} of"
        " them are not allowed or do not come to their rate."
    )
    if _costs_torque(found):
        yield Picture(
            "pareto", lambda: draw_pareto(found), "Quietness against torque margin", _PARETO
        )
    columns = (
        Column("worst", "worst case", found.objective.measure, absent="fails"),
        Column("setting", "setting"),
    )
    from microvib.studies.quiet.study import in_words

    rows = [
        (one.worst, one.why_not or in_words(found.scenario, found.levers, one.setting))
        for one in found.tried
    ]
    yield Table("tried", columns, tuple(rows), for_readers=tuple(rows[:5]), brief=0)


_PARETO = (
    "Every setting that was tried: its worst case in the search against its torque margin; settings"
    " that were given up early are at lower bounds."
)


def _cases(found: QuietDrive) -> Iterator[tuple[str, str]]:
    for sentence in found.cases.text:
        name, _, text = sentence.partition(": ")
        yield name, text
    yield "starts", "; ".join(start.name for start in STARTS)


# ---- What is handed over ----


def _handed_over(found: QuietDrive) -> Iterator[tuple[str, str]]:
    yield "scenario.yaml", dump_scenario(_titled(found))
    table = found.quieter.driver.table
    if table is None or not table.currents:
        return
    rows = np.array(table.currents)
    if found.bits is None:
        yield "table.csv", rows_csv(["i_a", "i_b"], rows.tolist())
        return
    levels = levels_of(found.bits)
    whole = np.rint(rows * levels).astype(int)
    yield "table.csv", rows_csv(list(integer_columns(levels)), whole.tolist())


def _titled(found: QuietDrive) -> Any:
    title = found.scenario.title or "drive"
    return found.quieter.model_copy(update={"title": f"{title}, quieter"})


def _data(found: QuietDrive) -> dict[str, Any]:
    settings = {}
    if found.setting is not None:
        settings = {
            lever.name: {"setting": lever.show(found.scenario, numbers), "numbers": list(numbers)}
            for lever, numbers in zip(found.levers, found.setting.numbers, strict=True)
        }
    return {"objective": found.objective.text, "levers": settings}


# ---- Pictures ----


def draw_cases(found: QuietDrive) -> Figure:
    """Part of the cases up to each figure, before and after."""
    figure, ax = sheets.one_axes(3.0)
    measure = found.objective.measure
    designs = [(found.before, sheets.GREY), (found.after, sheets.BLUE)]
    if found.best_nominal is not None:
        designs.append((found.best_nominal, sheets.RED))
    for one, colour in designs:
        values = np.sort(one.cases[np.isfinite(one.cases)]) / measure.size
        parts = 100.0 * np.arange(1, values.size + 1) / one.cases.size
        label = f"{one.design} ({one.unknown} cases not known)" if one.unknown else one.design
        ax.step(values, parts, where="post", color=colour, label=label)
        if math.isfinite(one.p95):
            ax.axvline(one.p95 / measure.size, color=colour, linestyle="--", linewidth=0.8)
    ax.set_xscale("log")
    sheets.plain_numbers(ax.xaxis)
    ax.set_xlabel(f"{found.objective.text} [{measure.unit}]")
    ax.set_ylabel("cases up to it [%]")
    ax.set_ylim(0.0, 101.0)
    ax.legend(loc="best")
    return figure


def draw_lines(found: QuietDrive) -> Figure:
    """The largest lines before and after."""
    figure, ax = sheets.one_axes(3.2)
    rows = found.lines[:SHOWN_LINES]
    at = np.arange(len(rows))
    for offset, colour, label, bar, tick in (
        (-0.2, sheets.GREY, "before", "before", "before_p95"),
        (0.2, sheets.BLUE, "after", "after", "after_p95"),
    ):
        heights = np.array([getattr(row, bar) for row in rows]) * 1e3
        quantiles = np.array([getattr(row, tick) for row in rows]) * 1e3
        ax.bar(at + offset, _drawn(heights), 0.38, color=colour, label=label)
        ax.scatter(
            at + offset,
            _drawn(quantiles),
            marker="_",
            s=120,
            color="black",
            zorder=3,
        )
        for place in (at + offset)[np.isnan(heights)]:
            ax.text(
                place,
                0.02,
                "not known",
                rotation=90,
                ha="center",
                va="bottom",
                fontsize=7,
                color=colour,
                transform=ax.get_xaxis_transform(),
            )
    ax.set_yscale("log")
    sheets.plain_numbers(ax.yaxis)
    ax.set_ylabel("amplitude [mN m]")
    ax.set_xlim(-0.8, len(rows) - 0.2)
    ax.set_xticks(at, [row.name for row in rows], rotation=30, ha="right")
    ax.legend(loc="upper right")
    return figure


def _drawn(heights: np.ndarray) -> np.ndarray:
    """Heights that a logarithmic axis can show; nan for others."""
    shown: np.ndarray = np.where((heights > 0.0) & np.isfinite(heights), heights, np.nan)
    return shown


def draw_pareto(found: QuietDrive) -> Figure:
    """Worst figure of every setting against its torque margin."""
    figure, ax = sheets.one_axes(3.0)
    measure = found.objective.measure
    allowed = [one for one in found.tried if math.isfinite(one.worst)]
    margins = np.array([_margin(found, one.setting) for one in allowed])
    figures = np.array([one.worst for one in allowed]) / measure.size
    chosen = np.array([one.setting == found.setting for one in allowed])
    ax.scatter(margins, figures, s=16, facecolors="none", edgecolors=sheets.GREY)
    ax.scatter(margins[chosen], figures[chosen], s=40, color=sheets.BLUE, label="chosen")
    before = found.before.nominal / measure.size
    ax.axhline(before, color=sheets.GREY, linestyle=":", label="before, nominal")
    ax.set_yscale("log")
    sheets.plain_numbers(ax.yaxis)
    ax.set_xlabel("torque margin with its factors")
    ax.set_ylabel(f"worst case [{measure.unit}]")
    ax.legend(loc="best")
    return figure


def _margin(found: QuietDrive, setting: Setting) -> float:
    changed = with_levers(found.scenario, found.levers, setting)
    return torque_margin(changed, found.constraints.factors).margin


def _costs_torque(found: QuietDrive) -> bool:
    """Whether settings differ in their torque margins."""
    allowed = [one for one in found.tried if math.isfinite(one.worst)]
    margins = [_margin(found, one.setting) for one in allowed]
    return max(margins) - min(margins) > 1e-3
