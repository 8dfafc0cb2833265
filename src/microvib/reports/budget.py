"""A pointing budget for those who read it: verdicts, tables and pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from microvib.analysis.margins import Verdict
from microvib.analysis.pointing import LEFT_OUT, TORQUE_SPREAD
from microvib.analysis.start import start_sentence
from microvib.model.coupling import require_craft
from microvib.model.rigid import tensor
from microvib.reports import sheets
from microvib.reports.craft import hub_sentence
from microvib.reports.document import Fact, Status, Text
from microvib.reports.numbers import brief_number, count_text
from microvib.reports.outcome import Item, Outcome, Part, Picture
from microvib.results import (
    ARRAY_ANGLE,
    COUNT,
    DECIBEL,
    FREQUENCY,
    POINTING_ANGLE,
    SHARE,
    TIME,
    Column,
    Measure,
    Table,
)
from microvib.signals.pointing import Metric, mean_square_of_density, metric_name, metric_weight
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.left_out import left_out_of_lines
from microvib.studies.budget.load_check import MAX_LOAD_RATIO, off_clock_words
from microvib.studies.budget.sources import Contribution
from microvib.studies.budget.study import Budget, summary
from microvib.studies.budget.sums import LEFT_OUT_IN_TURN, Assessment, Share, combine_lines
from microvib.studies.campaign.statistics import NO_ESTIMATE
from microvib.units import convert, pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_REASONS = 4
"""Reasons that are told on the first page; all are in the tables."""
RANKED = 5
"""Lines that a ranking shows of each requirement."""
ON_TERMINAL = 25
"""Lines that a terminal shows of all."""
COMPARED = 20
"""Lines by which the blocked-load method is compared with the coupled run."""
_RULES = {
    "rss": "as mean squares, averaged over unknown phases",
    "coherent": "with their phases",
    "bound": "with the worst phases",
}
_WORDS: dict[Verdict, str] = {"fail": "FAIL", "not judged": "not judged", "pass": "pass"}


@dataclass(frozen=True)
class RequirementRow:
    """A requirement with what was found; angles [rad]."""

    name: Annotated[str, Column("name", "name")]
    limit: Annotated[float, Column("limit_rad", "limit", POINTING_ANGLE)]
    value: Annotated[float, Column("value_rad", "value", POINTING_ANGLE)]
    least: Annotated[float, Column("least_rad", measure=POINTING_ANGLE)]
    most: Annotated[float, Column("most_rad", "at most", POINTING_ANGLE, absent="not bounded")]
    lines: Annotated[float, Column("lines_rad", measure=POINTING_ANGLE)]
    noise: Annotated[float, Column("noise_rad", measure=POINTING_ANGLE)]
    errors: Annotated[float, Column("errors_rad", measure=POINTING_ANGLE)]
    median: Annotated[float, Column("median_rad", "median", POINTING_ANGLE)]
    p95: Annotated[float, Column("p95_rad", "P95", POINTING_ANGLE)]
    p99: Annotated[float, Column("p99_rad", "P99", POINTING_ANGLE)]
    margin: Annotated[float, Column("margin_db", "margin", DECIBEL)]
    angle: Annotated[float, Column("array_angle_deg", "array angle", ARRAY_ANGLE)]
    value_angle: Annotated[float, Column("value_angle_deg", "angle of value", ARRAY_ANGLE)]
    why: Annotated[str, Column("why")]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]
    requirement: Annotated[str, Column("requirement", "requirement")]


def budget_outcome(budget: Budget) -> Outcome:
    """A budget for those who read it: verdicts, largest contributors, windows, sources, and the
    blocked-load method against the coupled run.
    """
    required = budget.requirements
    title = (required.title if required else "") or budget.scenario.title or "craft"
    cumulative = Picture(
        "cumulative",
        lambda: draw_cumulative(budget),
        "Cumulative rms of the line of sight",
        _CUMULATIVE,
    )
    return Outcome(
        "Pointing budget",
        f"Pointing budget: {title}",
        _decision(budget),
        budget.verdict if budget.judged else "",
        tuple(_facts(budget)),
        (
            Part("", tuple(_first_page(budget))),
            Part("Basis and assumptions", (Text(_basis(budget)),)),
            Part("Largest contributors", (_contributors(budget),)),
            Part("Windows", (_windows(budget),)),
            Part("Cumulative rms", (cumulative,)),
            Part("Sources", (_sources(budget),), report_only=True),
            Part(
                "Blocked-load method compared with the coupled run",
                (_blocked_loads(budget),) if budget.short_way else (),
            ),
        ),
        budget.scenario,
        files=(_lines(budget),),
        data={"budget": summary(budget)},
        descriptions={} if required is None else {"requirements": required},
        units=(pointing_angle(budget),),
    )


def pointing_angle(budget: Budget) -> Measure:
    """How angles are given: in the unit that the first requirement is given in, or the one that
    suits the largest.
    """
    units = (one.requirement.unit for one in budget.judged)
    given = next(filter(None, units), "")
    if given:
        size = convert(f"1 {given}", "rad")
        names = (name for name, of in POINTING_ANGLE.units if math.isclose(of, size))
        return replace(POINTING_ANGLE, unit=next(names, pretty(given)), size=size)
    return POINTING_ANGLE.suited_to(
        [*(one.value for one in budget.judged), *(x for w in budget.windows for x in w.both)]
    )


def _first_page(budget: Budget) -> Iterator[Item]:
    yield _requirements(budget)
    yield from map(Text, reasons_not_judged(budget))
    yield _worst_sources(budget)
    title = "Lines by source, and rms over windows"
    yield Picture("budget", lambda: draw_budget(budget), title, _CAPTION)


_CAPTION = (
    "Left, lines by source, radial, 0-to-peak, and curves that limit them; where a curve limits"
    " one axis, lines about that axis have a marker of their own, as its legend says. Right, radial"
    " rms of the lines of all sources over the length of the window (the largest within each fortieth of a"
    " decade), dashed about x and dotted about y where a limit is on that axis; markers are limits"
    " on them."
)
_CUMULATIVE = (
    "Root of the sum of mean squares of lines and densities, from the lowest frequency up and from"
    " the highest down; errors by their class are not in it."
)


def _name(one: Assessment) -> str:
    return one.requirement.name or one.requirement.text


def _decision(budget: Budget) -> str:
    said = _verdict_counts(budget)
    if budget.judged:
        said = f"{_WORDS[budget.verdict]}: {said}"
    return f"{said[0].upper()}{said[1:]}, {budget.holds_at}."


def _verdict_counts(budget: Budget) -> str:
    if not budget.judged:
        return "no requirement was given, so nothing is judged"
    verdicts: dict[Verdict, int] = {
        v: sum(one.verdict == v for one in budget.judged) for v in _WORDS
    }
    said = ", ".join(f"{n} {v}" for v, n in verdicts.items() if n)
    return f"of {count_text(len(budget.judged), 'requirement')}, {said}"


def _requirements(budget: Budget) -> Table:
    caption = "At most: with the worst phases, all lines that still ring, and allowances for bands that were not examined."
    if any(one.spread for one in budget.judged):
        caption += " Percentiles over a campaign."
    several = bool(budget.angles)
    differ = any(one.value_angle != one.angle for one in budget.judged)
    if several:
        caption += " Of all array angles the worst: verdict, value, at most and margin each."
    if differ:
        caption += " Array angle is that of the verdict; angle of value that of value, margin and contributors."
    shown = [_requirement_row(budget, one, several, differ) for one in budget.judged]
    in_file = [_requirement_row(budget, one, True, True) for one in budget.judged]
    return Table.of("budget", RequirementRow, in_file, for_readers=shown, caption=caption)


def _requirement_row(
    budget: Budget, one: Assessment, with_angle: bool, with_value_angle: bool
) -> RequirementRow:
    """Row of a requirement, with the array angles of its verdict and of its value where they are asked
    for.
    """
    median, p95, p99 = one.spread or (NO_ESTIMATE,) * 3
    return RequirementRow(
        one.requirement.name,
        one.limit,
        one.value,
        one.least,
        one.most,
        one.lines,
        one.noise,
        one.errors,
        median.value,
        p95.value,
        p99.value,
        one.margin_db,
        math.radians(budget.angle_of(one)) if with_angle else math.nan,
        math.radians(budget.angle_of_value(one)) if with_value_angle else math.nan,
        "; ".join(one.why),
        one.verdict,
        one.requirement.text,
    )


def reasons_not_judged(budget: Budget) -> list[str]:
    """Why requirements are not judged, those of the same reasons together, the first MOST_REASONS
    of them.
    """
    groups: dict[tuple[str, ...], list[str]] = {}
    for one in budget.judged:
        if one.why:
            groups.setdefault(one.why, []).append(_name(one))
    more = {
        why: f"; and {len(why) - MAX_REASONS} more" if len(why) > MAX_REASONS else ""
        for why in groups
    }
    return [
        f"{', '.join(names)}, not judged: {'; '.join(why[:MAX_REASONS])}{more[why]}."
        for why, names in groups.items()
    ]


def _basis(budget: Budget) -> str:
    """How lines were added, which loads are recorded, who requires it, which drives have no steady
    state, and for which angles of the array the verdict holds, as sentences.
    """
    if budget.angles:
        at = ARRAY_ANGLE.figure(require_craft(budget.scenario).spacecraft.array_angle)
        shown = f"Windows, cumulative rms, lines and pictures are those at {at}."
        angles = " ".join([f"Each is {budget.holds_at}. {shown}", *budget.notes])
    else:
        angles = (
            f"This holds {budget.holds_at}; several angles, such as 0:330:30, or an orbit are judged at"
            " their worst where they are asked for."
        )
    said = [f"Lines of one frequency in several sources add {_RULES[budget.rule]}."]
    said += [hub_sentence(budget.scenario)]
    said += _recordings(budget)
    said += _ranges(budget)
    said += _spin(budget)
    said += _beating_orders(budget)
    said += _ends_of_densities(budget)
    said += _ends_of_curves(budget)
    if budget.requirements and budget.requirements.source:
        said += [f"Required by: {budget.requirements.source}."]
    said += [start_sentence(budget.scenario)]
    return " ".join([*filter(None, said), *budget.without_steady, angles])


def _recordings(budget: Budget) -> Iterator[str]:
    """Sentences on drives whose loads are recorded."""
    for one in budget.contributions:
        if one.recording:
            yield (
                f"Loads of {one.source} come from a recording on a force table ({one.recording}), by the"
                " blocked-load method; a run of the scenario beside it gives the error of this method, and"
                " least and most hold its phases between channels as well as the recording's. Loads up to"
                f" {MAX_LOAD_RATIO:g} times as small or as large as that run's are taken as they are."
            )
            if off := off_clock_words(one.step_clock):
                yield (
                    f"Their step clock is {off}: the drive's or the recorder's may be off, and least and most"
                    " hold for both."
                )
            if one.chain_assumption:
                yield one.chain_assumption


def _ranges(budget: Budget) -> Iterator[str]:
    """Sentences on the ranges that scenarios of drives note of their values."""
    told = list(dict.fromkeys(one.ranges for one in budget.contributions if one.ranges))
    yield from told
    if told:
        yield (
            "T_d ± (ranges) is that part of the drive's torque in the line, which the line of sight"
            " follows as far as it turns about the drive axis."
        )


def _ends_of_densities(budget: Budget) -> Iterator[str]:
    """Sentences on densities of sources that end within the band of a requirement."""
    bands = [(one.lowest, one.highest or math.inf) for one in _required(budget) if not one.curve]
    for one in budget.contributions:
        if one.density is None or one.scenario is not None or not bands:
            continue
        f, density = one.density
        given = f[np.any(density > 0.0, axis=1)]
        if not given.size:
            continue
        low, high = float(given[0]), float(given[-1])
        if any(lowest < low or highest > high for lowest, highest in bands):
            ends = f"{FREQUENCY.figure(low)} to {FREQUENCY.figure(high)}"
            yield f"The density of {one.source} is given from {ends}, and nothing of it counts outside."


def _ends_of_curves(budget: Budget) -> Iterator[str]:
    """Sentences on what curves do not limit."""
    curves = [one.allowed for one in _required(budget) if one.curve]
    if not curves:
        return
    low, high = (
        FREQUENCY.figure(x) for x in (min(c.low for c in curves), max(c.high for c in curves))
    )
    said = f"Curves limit nothing below {low} and above {high}"
    beside = [one.source for one in budget.contributions if one.density is not None or one.errors]
    if beside:
        said += f", and no densities and errors without lines: those of {', '.join(beside)}"
    yield f"{said}."


def _required(budget: Budget) -> Sequence[Requirement]:
    """Requirements of a budget; empty without any."""
    return () if budget.requirements is None else budget.requirements.requirements


_GYROSCOPIC = 0.1
"""Part of the hub's motion about one axis that a wheel's momentum turns about another, from which it is told."""


def _spin(budget: Budget) -> Iterator[str]:
    """Sentence on the momentum of wheels, which the craft does not have."""
    names = [one.source for one in budget.contributions if one.spins]
    if not names:
        return
    inertia = np.linalg.eigvalsh(tensor(require_craft(budget.scenario).spacecraft.hub.inertia))[0]
    momentum = _GYROSCOPIC * 2.0 * math.pi * float(inertia)
    yield (
        f"The craft does not have the spin momentum of {', '.join(names)}: of a hub that turns at f about an axis"
        " across the spin, a momentum H turns the part H/(2 pi I f) about the other one, which is"
        f" {100.0 * _GYROSCOPIC:g} % at 1 Hz from {momentum:.2g} N m s on (I = {inertia:.3g} kg m2, the least of the hub),"
        " and more below, in proportion."
    )


def _beating_orders(budget: Budget) -> Iterator[str]:
    """Sentence on crests of wheels' orders that may be two lines, where crests are required."""
    names = [one.source for one in budget.contributions if one.spins]
    if names and any(one.statistic != "rms" for one in _required(budget)):
        yield (
            f"Each order of {', '.join(names)} counts as one line. Two orders that a measurement did not separate"
            " have its rms together, and as they beat a crest of up to 1.41 times its amplitude, which bounds and"
            " levels do not hold: give both as harmonics where there may be two."
        )


def _torque_spread(budget: Budget, source: str, line: str) -> float:
    """How far the torque of a source moves in a line within the ranges of its values, over the line;
    nan where that is not known.
    """
    for one in budget.contributions:
        if one.source == source and line in one.torque_spreads:
            return one.torque_spreads[line]
    return math.nan


def _facts(budget: Budget) -> Iterator[Fact]:
    word = _WORDS[budget.verdict]
    status: Status = "pass" if budget.verdict == "pass" else "fail"
    yield Fact(word[0].upper() + word[1:], _verdict_counts(budget), status)
    known = [
        one
        for one in budget.judged
        if math.isfinite(one.margin) and one.value > 0.0 and one.verdict != "not judged"
    ]
    if not known:
        return
    worst = min(known, key=lambda one: one.margin)
    yield Fact(DECIBEL.figure(worst.margin_db), f"smallest margin judged: {_name(worst)}")
    if worst.ranking:
        top = worst.ranking[0]
        if worst.requirement.curve:
            what = "what its curve allows"
        else:
            what = "its mean square"
        label = f"of {what}: {top.line} of {top.source}"
        if math.isfinite(top.frequency):
            label = f"{label}, {FREQUENCY.figure(top.frequency)}"
        yield Fact(SHARE.figure(top.share), label)


_CONTRIBUTORS = (
    Column("name", "requirement", role="group"),
    Column("requirement"),
    Column("source", "source"),
    Column("line", "line"),
    Column("frequency_hz", "frequency", FREQUENCY),
    Column("rms_rad", "rms", POINTING_ANGLE),
    Column("share", "share", SHARE),
    Column(TORQUE_SPREAD, "T_d ± (ranges)", SHARE),
    Column("without_rad", "value without it", POINTING_ANGLE),
)


def _contributors(budget: Budget) -> Table:
    """Lines, densities and errors that contribute most to each requirement; a terminal shows those of
    the first requirements.
    """

    def row(one: Assessment, x: Share) -> tuple[Any, ...]:
        said = one.requirement.text
        spread = _torque_spread(budget, x.source, x.line)
        return (_name(one), said, x.source, x.line, x.frequency, x.rms, x.share, spread, x.without)

    ranked = [one for one in budget.judged if one.ranking]
    brief = 0
    for one in ranked:
        more = len(one.ranking[:RANKED])
        if brief and brief + more > ON_TERMINAL:
            break
        brief += more
    return Table(
        "contributors",
        _CONTRIBUTORS,
        tuple(row(one, x) for one in ranked for x in one.ranking),
        tuple(row(one, x) for one in ranked for x in one.ranking[:RANKED]),
        brief=brief if ranked else None,
        caption="Share: fraction of the mean square; for a curve, amplitude over the curve. Value"
        " without it: of the requirement, for the largest.",
    )


def _worst_sources(budget: Budget) -> Table:
    """Sources by what they contribute to each requirement, the largest on the first page of a report;
    a terminal has their lines.
    """
    columns = tuple(
        x for x in _CONTRIBUTORS if x.key not in ("line", "frequency_hz", TORQUE_SPREAD)
    )

    def row(one: Assessment, x: Share) -> tuple[Any, ...]:
        return (one.requirement.name, one.requirement.text, x.source, x.rms, x.share, x.without)

    def shown(one: Assessment, x: Share) -> tuple[Any, ...]:
        return (_name(one), *row(one, x)[1:])

    return Table(
        "sources",
        columns,
        tuple(row(one, x) for one in budget.judged for x in one.sources),
        tuple(
            shown(one, x) for one in budget.judged for x in one.sources[:LEFT_OUT_IN_TURN] if x.rms
        ),
        brief=0,
        caption="Worst contributors to each requirement, with their share of the mean square and its"
        " value without them.",
    )


_PARTS = ("both", "lines", "noise", "errors")
_AXES = ("x", "y", "radial")
_WINDOW_HEADINGS = {
    "both_x_rad": "x",
    "both_y_rad": "y",
    "both_radial_rad": "radial",
    "lines_radial_rad": "lines, radial",
    "noise_radial_rad": "noise, radial",
    "errors_radial_rad": "errors, radial",
}


def _windows(budget: Budget) -> Table:
    keys = [f"{part}_{axis}_rad" for part in _PARTS for axis in _AXES]
    columns = (
        Column("metric", "metric", words=metric_name),
        Column("window_s", "window", TIME),
        *(Column(key, _WINDOW_HEADINGS.get(key, ""), POINTING_ANGLE) for key in keys),
    )
    rows = tuple(
        (w.metric, w.window, *w.both, *w.lines, *w.noise, *w.errors) for w in budget.windows
    )
    return Table("windows", columns, rows, caption="Rms of all sources.")


def _sources(budget: Budget) -> Table:
    """Where each source comes from, for a report."""
    columns = (
        Column("source", "source"),
        Column("how", "how it was found"),
        Column("lines", "lines", COUNT),
        Column("not_known", "what is not known about it"),
    )

    def row(reasons: int | None) -> Iterator[tuple[Any, ...]]:
        for c in budget.contributions:
            unknown = list(dict.fromkeys(gap.why for gap in c.gaps))[:reasons]
            yield c.source, c.how, len(c.names), "; ".join(unknown)

    return Table("source_list", columns, tuple(row(None)), tuple(row(6)))


def _blocked_loads(budget: Budget) -> Table:
    columns = (
        Column("line", "line"),
        Column("frequency_hz", "frequency", FREQUENCY),
        Column("short_rad", "blocked loads", POINTING_ANGLE),
        Column("coupled_rad", "coupled run", POINTING_ANGLE),
        Column("los_error", "line of sight", SHARE),
        Column("load_error", "moments", SHARE),
        Column("share"),
    )
    rows = tuple(
        (d.line, d.frequency, *d.los, d.los_error, d.load_error, d.share) for d in budget.short_way
    )
    caption = (
        "Blocked loads and apparent masses against the coupled run: differences of "
        "complex amplitudes, relative to the coupled run."
    )
    return Table("blocked_loads", columns, rows, rows[:COMPARED], caption=caption)


def _lines(budget: Budget) -> Table:
    """All lines of all sources, for a file: with the bounds on their amplitudes, and with what is
    left out. Lines without phases have none.
    """
    keys = (
        "source", "line", "frequency_hz", "los_x_rad", "los_y_rad", "los_x_phase_rad",
        "los_y_phase_rad", "settled", "los_x_least_rad", "los_y_least_rad", "los_x_most_rad",
        "los_y_most_rad", TORQUE_SPREAD, LEFT_OUT,
    )  # fmt: skip
    left_out = left_out_of_lines(budget.contributions, len(budget.angles))
    rows = tuple(
        (*row, said)
        for c, said in zip(budget.contributions, left_out, strict=True)
        for row in _rows_of_lines(c)
    )
    return Table("lines", tuple(map(Column, keys)), rows)


def _rows_of_lines(one: Contribution) -> Iterator[tuple[Any, ...]]:
    """Rows of a source's lines: source, name and frequency, both amplitudes and phases, whether they
    are settled, the amplitudes at least and at most, and the spread of the drive's torque.
    """
    size, phase = np.abs(one.los), np.angle(one.los)
    if not one.phased:
        phase = np.full_like(phase, np.nan)
    less, more = one.relative_errors
    ends = np.hstack([size * np.maximum(1.0 - less, 0.0), size * (1.0 + more)])
    ends[~np.isfinite(ends)] = np.nan  # then the row says so
    figures = np.hstack([one.frequency[:, None], size, phase])
    for k, name in enumerate(one.names):
        spread = one.torque_spreads.get(name, math.nan)
        settled = bool(one.settled[k])
        yield one.source, name, *figures[k].tolist(), settled, *ends[k].tolist(), spread


_DRAWN: tuple[Metric, ...] = ("rpe", "mpe", "smear", "jitter")
_STEP, _STEP_PLACES = 0.025, 0.5 + 0.5 * np.sin(np.arange(16.0) ** 2)
"""Steps of windows in decades, and places in a step, unlike each other: the largest figure is
drawn, as weights fall to nothing.
"""


_SIZE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "radial": lambda A: np.hypot(*A.T),
    "x": lambda A: A[:, 0],
    "y": lambda A: A[:, 1],
}
"""Amplitude (k,) that a limit on an axis is compared with, from amplitudes (k, 2)."""
_MARKERS = {
    "radial": ("o", "-", "dots"),
    "x": (">", "--", "pointing right"),
    "y": ("^", ":", "pointing up"),
}
"""Marker of lines, style of the curve that limits them, and the marker in words."""


def draw_budget(budget: Budget) -> Figure:
    """Lines by source, and rms over the length of the window with the limits on it."""
    drawing, axes = sheets.sheet(3.0, 1, 2)
    angle = pointing_angle(budget)
    _draw_lines(axes[0, 0], budget, angle)
    _draw_windows(axes[0, 1], budget, angle)
    return drawing


def _draw_lines(ax: Axes, budget: Budget, angle: Measure) -> None:
    """Lines of each source, and the curves that limit them."""
    top = max(
        (
            float(np.hypot(*np.abs(c.los[c.settled]).T).max(initial=0.0))
            for c in budget.contributions
        ),
        default=0.0,
    )
    curves = [one for one in budget.judged if one.requirement.curve]
    seen = sorted({"radial", *(one.requirement.axis for one in curves)}, key=list(_SIZE).index)
    for k, one in enumerate(budget.contributions):
        for axis in seen:
            _draw_source(ax, one, axis, angle, top, sheets.COLOURS[k % 7])
    for required in curves:
        _draw_curve(ax, required, angle)
    if seen == ["radial"]:
        what = f"amplitude, radial [{angle.unit}]"
    else:
        what = f"amplitude, radial and by axis [{angle.unit}]"
    if not top and not curves:  # logarithmic scales need numbers above 0
        ax.set(xlim=(1.0, 1e3), ylim=(1e-3, 1.0))
        ax.text(
            0.5, 0.5, "no settled lines above 0", transform=ax.transAxes, ha="center", fontsize=6.5
        )
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=what)
    if top:
        ax.set_ylim(1e-5 * top / angle.size, 60 * top / angle.size)  # with room for names
        sheets.name_points(ax, _governing_lines(budget, angle))
    ax.legend(fontsize=6.5, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _draw_source(
    ax: Axes, one: Contribution, axis: str, angle: Measure, top: float, colour: str
) -> None:
    """Settled lines of a source on one axis of the line of sight, down to a part of ``top`` [rad]."""
    size = _SIZE[axis](np.abs(one.los))
    shown = one.settled & (size > 1e-5 * top)
    f, shown_size = one.frequency[shown], size[shown] / angle.size
    if axis == "radial":
        ax.vlines(f, 1e-3 * top, shown_size, color=colour, linewidth=0.8)
    ax.plot(
        f,
        shown_size,
        marker=_MARKERS[axis][0],
        color=colour,
        markersize=3,
        linestyle="",
        label=one.source if axis == "radial" and not one.errors else "_",
    )


def _draw_curve(ax: Axes, required: Assessment, angle: Measure) -> None:
    """The curve that limits lines on one axis."""
    curve, axis = required.requirement.curve or (), required.requirement.axis
    f, allowed = [p.frequency for p in curve], [p.amplitude / angle.size for p in curve]
    label = _name(required)
    if axis != "radial":
        label = f"{label}: los_{axis} ({_MARKERS[axis][2]})"
    ax.plot(f, allowed, color="black", linestyle=_MARKERS[axis][1], linewidth=0.9, label=label)


def _governing_lines(budget: Budget, angle: Measure) -> list[tuple[float, float, str, bool]]:
    """The most costly line of each requirement as (frequency [Hz], amplitude in the unit of
    ``angle``, name, whether it fails), failures first.
    """
    largest = {
        (c.source, name): float(np.hypot(*np.abs(los))) / angle.size
        for c in budget.contributions for name, los in zip(c.names, c.los, strict=True)
    }  # fmt: skip
    named: dict[str, tuple[float, float, str, bool]] = {}
    for one in sorted(
        (one for one in budget.judged if one.ranking),
        key=lambda one: list(_WORDS).index(one.verdict),
    ):
        top = one.ranking[0]
        amplitude = largest.get((top.source, top.line), 0.0)
        text = f"{top.line}\n{brief_number(top.frequency)} Hz"
        if amplitude > 0.0:
            named.setdefault(text, (top.frequency, amplitude, text, one.verdict == "fail"))
    return list(named.values())


def _draw_windows(ax: Axes, budget: Budget, angle: Measure) -> None:
    """Rms of all lines over the length of the window, the largest in each step of lengths, and the
    limits on it.
    """
    T = 10.0 ** np.arange(-4.0, 2.0, _STEP)
    tried = (T[:, None] * 10.0 ** (_STEP * _STEP_PLACES)).ravel()
    tones = combine_lines(budget.contributions, budget.rule, with_errors=False)
    for k, metric in enumerate(_DRAWN):
        asked = [one.requirement for one in budget.judged if one.requirement.metric == metric]
        limits = [
            (r.axis, r.window, r.limit / angle.size, r.name)
            for r in asked
            if r.window and r.limit and r.statistic == "rms"
        ]
        for axis in sorted({"radial", *(axis for axis, *_ in limits)}, key=list(_SIZE).index):
            size, (marker, line, _) = _SIZE[axis](tones.value), _MARKERS[axis]
            cycles = tones.frequency[:, None] * tried  # these metrics know f T only
            squares = 0.5 * size**2 @ metric_weight(metric, cycles, 1.0)
            rms = np.sqrt(squares.reshape(T.size, -1).max(axis=1))
            if axis == "radial":
                label = metric_name(metric)
            else:
                label = f"{metric_name(metric)} los_{axis}"
            style: dict[str, Any] = (
                {"linewidth": 4.0, "alpha": 0.35} if metric == "rpe" else {"linewidth": 1.1}
            )  # smear lies on it
            rms[rms == 0.0] = np.nan  # which logarithmic scales do not have
            ax.plot(
                T, rms / angle.size, color=sheets.COLOURS[k], linestyle=line, label=label, **style
            )
            for _, window, limit, name in (one for one in limits if one[0] == axis):
                ax.plot(window, limit, marker, color=sheets.COLOURS[k], markersize=4)
                said = f"limit {name}".rstrip() + "  "
                ax.annotate(
                    said,
                    (window, limit),
                    ha="right",
                    va="center",
                    fontsize=6.5,
                    annotation_clip=True,
                )
    largest = math.sqrt(0.5 * float(np.sum(tones.value**2))) / angle.size or 1.0
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="window [s]",
        ylabel=f"rms of lines [{angle.unit}]",
        ylim=(1e-5 * largest, 30 * largest),
    )
    ax.legend(fontsize=6.5, frameon=False)


def draw_cumulative(budget: Budget) -> Figure:
    """Cumulative rms of lines and densities about both axes, both ways."""
    drawing, axes = sheets.sheet(2.4, 1, 2)
    angle = pointing_angle(budget)
    tones = combine_lines(budget.contributions, budget.rule, with_errors=False)
    for k, (ax, axis) in enumerate(zip(axes[0], "xy", strict=True)):
        f, squares = tones.frequency, 0.5 * tones.value[:, k] ** 2
        for one in budget.contributions:
            if one.density is not None:
                grid, S = one.density
                parts = [
                    mean_square_of_density("ape", grid[i : i + 2], S[i : i + 2, k], 1.0)
                    for i in range(grid.size - 1)
                ]
                f, squares = np.r_[f, 0.5 * (grid[1:] + grid[:-1])], np.r_[squares, parts]
        order = np.argsort(f)
        up = np.sqrt(np.cumsum(squares[order]))
        down = np.sqrt(np.cumsum(squares[order][::-1])[::-1])
        for rms, where, colour, label in (
            (up, "post", sheets.BLUE, "from low to high"),
            (down, "pre", sheets.RED, "from high to low"),
        ):
            ax.step(
                f[order], rms / angle.size, where=where, color=colour, linewidth=1.1, label=label
            )
        ax.set(xscale="log", xlabel="frequency [Hz]", ylabel=f"rms of los_{axis} [{angle.unit}]")
        ax.legend(fontsize=6.5, frameon=False)
    return drawing
