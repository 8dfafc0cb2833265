"""A pointing budget as text, tables, pictures and a report whose first page has the decision."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.analysis.margins import Verdict
from microvib.io.tables import tables_csv, to_json
from microvib.reports import sheets
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import (
    Contents,
    Document,
    Fact,
    Mark,
    Section,
    Status,
    Table,
    Text,
    table,
)
from microvib.reports.numbers import angle_text, angle_unit, brief_number, count_text
from microvib.signals.pointing import Metric, mean_square_of_density, metric_weight
from microvib.studies.budget.study import Budget, summary
from microvib.studies.budget.sums import Assessment, combine_lines
from microvib.studies.campaign.statistics import NO_ESTIMATE
from microvib.text_tables import text_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_REASONS = 4
"""Reasons that are told on the first page; all are in the tables."""
RANKED = 8
"""Lines that a ranking shows."""
_RULES = {
    "rss": "as mean squares, averaged over unknown phases",
    "coherent": "with their phases",
    "bound": "with the worst phases",
}
_WORDS: dict[Verdict, str] = {"fail": "FAIL", "not judged": "not judged", "pass": "pass"}


def _margin(one: Assessment) -> str:
    if 0.0 < one.margin < math.inf:
        return f"{20.0 * math.log10(one.margin):+.1f}"
    return ""


def _upper_bound_text(one: Assessment) -> str:
    if math.isinf(one.most):
        return "not bounded"
    return angle_text(one.most)


def budget_text(budget: Budget) -> str:
    """Requirements with verdicts, sources, ranked lines, as text."""
    parts = [f"{budget.scenario.title or 'Pointing budget'}: {_decision(budget)}"]
    unit, size = angle_unit(x for w in budget.windows for x in (*w.both, w.lines[2], w.noise[2]))
    windows = [
        (
            _metric_label(w.metric),
            f"{w.window:g}",
            *(f"{x[2] / size:.4g}" for x in (w.lines, w.noise, w.both)),
        )
        for w in budget.windows
    ]
    head = ["metric", "window s", *(f"{what} {unit}" for what in ("lines", "noise", "both"))]
    parts.append("Radial rms of all sources:\n" + text_table(head, windows))
    for one in budget.judged[:1]:
        unit, rows = _ranked(one)
        if one.requirement.curve:
            share = "of limit %"
        else:
            share = "share %"
        parts.append(
            f"Largest contributors to {_name(one)}:\n"
            + text_table(("source", "line", "Hz", f"rms {unit}", share), rows)
        )
    if budget.short_way:
        parts.append(short_way_text(budget))
    parts += [_angle_notes(budget), *budget.without_steady]
    if (
        budget.judged
    ):  # last, where a terminal shows it, and what is required in words after the figures
        spread = _spread(budget)
        head = [
            "",
            "limit",
            "value",
            "at most",
            *spread,
            "dB",
            *(["at deg"] if budget.angles else []),
            "verdict",
            "",
        ]
        parts.append(
            text_table(head, [_row(one, bool(spread)) for one in budget.judged], last_left=True)
        )
        parts += _not_judged(budget)
    return "\n\n".join(parts)


def _angle_notes(budget: Budget) -> str:
    """For which angles of the array the verdict holds, and what to ask for the others, as
    sentences.
    """
    if not budget.angles:
        return f"This holds {budget.holds_at}; --angles 0:330:30 or --orbit judges the worst."
    return " ".join([f"Each is {budget.holds_at}.", *budget.notes])


def _at(one: Assessment) -> list[str]:
    if one.angle is None:
        return []
    return [f"{math.degrees(one.angle):.4g}"]


def _spread(budget: Budget) -> list[str]:
    """Heads of the percentiles, where there are any."""
    if any(one.spread for one in budget.judged):
        return ["median", "P95", "P99"]
    return []


def _row(one: Assessment, spread: bool) -> list[str]:
    _, *figures, margin, median, p95, p99 = _cells(one)
    percentiles = (median, p95, p99) if spread else ()
    return [
        one.requirement.name,
        *figures,
        *percentiles,
        margin,
        *_at(one),
        _WORDS[one.verdict],
        one.requirement.text,
    ]


def _not_judged(budget: Budget) -> list[str]:
    """Why requirements are not judged, those of the same reasons together, the first MOST_REASONS
    of them.
    """
    groups: dict[tuple[str, ...], list[str]] = {}
    for one in budget.judged:
        if one.why:
            groups.setdefault(one.why, []).append(_name(one))
    more = {
        why: f"; and {len(why) - MOST_REASONS} more" if len(why) > MOST_REASONS else ""
        for why in groups
    }
    return [
        f"{', '.join(names)}, not judged: {'; '.join(why[:MOST_REASONS])}{more[why]}."
        for why, names in groups.items()
    ]


def short_way_text(budget: Budget) -> str:
    """The short way against the coupled run, line by line."""
    head = ("line", "Hz", "short rad", "coupled rad", "line of sight %", "moments %")
    return "Blocked-load method compared with the coupled run:\n" + text_table(
        head, _short_rows(budget)
    )


def _short_rows(budget: Budget) -> list[list[str]]:
    return [
        [d.line, f"{d.frequency:.5g}", *(f"{x:.4g}" for x in d.los), *(f"{100 * x:.3g}" for x in (d.los_error, d.load_error))]
        for d in budget.short_way[:20]
    ]  # fmt: skip


def _name(one: Assessment) -> str:
    return one.requirement.name or one.requirement.text


def _cells(one: Assessment) -> list[str]:
    if one.spread is None:
        spread = ["", "", ""]
    else:
        spread = [angle_text(e.value) for e in one.spread]
    r = one.requirement
    if r.name:
        what = f"{r.name}: {r.text}"
    else:
        what = r.text
    return [
        what,
        angle_text(one.limit),
        angle_text(one.value),
        _upper_bound_text(one),
        _margin(one),
        *spread,
    ]


def _metric_label(metric: str) -> str:
    """A metric as requirements name it: abbreviations in capitals."""
    if len(metric) == 3:
        return metric.upper()
    return metric


def _ranked(one: Assessment) -> tuple[str, list[list[str]]]:
    """Unit of their rms, and rows of the lines that contribute most."""
    kept = one.ranking[:RANKED]
    unit, size = angle_unit(c.rms for c in kept)
    return unit, [
        [c.source, c.line, brief_number(c.frequency), f"{c.rms / size:.4g}", f"{100 * c.share:.3g}"]
        for c in kept
    ]


def _decision(budget: Budget) -> str:
    if budget.judged:
        said = f"{_WORDS[budget.verdict]} ({_counted_sources(budget)})"
    else:
        said = _counted_sources(budget)
    return f"{said}, {budget.holds_at}"


def _counted_sources(budget: Budget) -> str:
    if not budget.judged:
        return "no requirement was given, so nothing is judged"
    verdicts: dict[Verdict, int] = {
        v: sum(one.verdict == v for one in budget.judged) for v in _WORDS
    }
    said = ", ".join(f"{n} {v}" for v, n in verdicts.items() if n)
    return f"{said}, of {count_text(len(budget.judged), 'requirement')}"


_BUDGET_CSV = (
    "name requirement limit_rad value_rad least_rad most_rad lines_rad noise_rad median_rad p95_rad"
    " p99_rad verdict why"
    " array_angle_deg"
)


def budget_folder(budget: Budget) -> Contents:
    """Tables, JSON, picture and report of a budget."""
    picture = draw_budget(budget)
    judged = [
        (one.requirement.name, one.requirement.text, one.limit, one.value, one.least, one.most, one.lines, one.noise,
         *(e.value for e in one.spread or (NO_ESTIMATE,) * 3), one.verdict, "; ".join(one.why), budget.angle_of(one))
        for one in budget.judged
    ]  # fmt: skip
    costs = [
        (x.requirement.name, x.requirement.text, c.source, c.rms, c.share)
        for x in budget.judged
        for c in x.sources
    ]
    lines = [
        (c.source, c.names[k], float(c.frequency[k]), *np.abs(c.los[k]).tolist(), *np.angle(c.los[k]).tolist(), bool(c.settled[k]))
        for c in budget.contributions for k in range(len(c.names))
    ]  # fmt: skip
    tables = tables_csv({
        "budget": (_BUDGET_CSV, judged),
        "sources": ("name requirement source rms_rad share", costs),
        "lines": ("source line frequency_hz los_x_rad los_y_rad los_x_phase_rad los_y_phase_rad settled", lines),
    })  # fmt: skip
    files = {"budget.json": to_json(summary(budget)), "budget.png": sheets.png(picture)}
    return tables | files, budget_report(budget, picture)


def budget_report(budget: Budget, picture: Figure) -> Document:
    """The report of a budget: decision, requirements and sources on the first page."""
    notes = [
        Text(text, note=True)
        for text in (*_not_judged(budget), _angle_notes(budget), *budget.without_steady)
    ]
    caption = (
        "Left, lines by source, radial, 0-to-peak, and curves that limit them; where a curve limits"
        " one axis, lines about that axis"
        " have a marker of their own, as its legend says. Right, radial rms of all sources over the"
        " length"
        " of the window (the largest within each fortieth of a decade), dashed about x and dotted"
        " about y where a limit is on that"
        " axis; markers are limits on them."
    )
    required = budget.requirements
    if required and required.source:
        source = f" Required by: {required.source}."
    else:
        source = ""
    how = Text(
        f"Lines of one frequency in several sources add {_RULES[budget.rule]}.{source}", note=True
    )
    if budget.judged:
        sections = [
            Section(
                "What costs most",
                tuple(_contributor_tables(one) for one in budget.judged if one.ranking),
            )
        ]
    else:
        sections = []
    sections.append(Section("Windows", (_windows(budget),)))
    sections.append(
        Section(
            "Cumulative rms",
            (
                figure_block(
                    draw_cumulative(budget), "Cumulative rms of the line of sight", _CUMULATIVE
                ),
            ),
        )
    )
    sections.append(Section("Sources", (_sources(budget),)))
    if budget.short_way:
        head = [
            "line",
            "frequency [Hz]",
            "short way [rad]",
            "coupled [rad]",
            "line of sight [%]",
            "moments [%]",
        ]
        told = Text(
            "Blocked loads and apparent masses against the coupled run: differences of complex"
            " amplitudes, part of the latter."
        )
        sections.append(Section("The short way", (told, table(head, _short_rows(budget)))))
    return study_report(
        "Pointing budget",
        f"Pointing budget: {(required.title if required else '') or budget.scenario.title or 'craft'}",
        _decision(budget),
        facts=_facts(budget),
        first_page=(
            _requirements(budget),
            *notes,
            how,
            figure_block(picture, "Lines by source, and rms over windows", caption),
        ),
        sections=sections,
        scenario=budget.scenario,
        parts={} if required is None else {"requirements": required},
    )


_CUMULATIVE = "Root of the sum of mean squares of lines and densities, from the lowest frequency up and from the highest down."


def _facts(budget: Budget) -> list[Fact]:
    if budget.verdict == "pass":
        status: Status = "pass"
    else:
        status = "fail"
    word = _WORDS[budget.verdict]
    facts = [Fact(word[0].upper() + word[1:], _counted_sources(budget), status)]
    known = [
        one
        for one in budget.judged
        if math.isfinite(one.margin) and one.value > 0.0 and one.verdict != "not judged"
    ]
    if known:
        worst = min(known, key=lambda one: one.margin)
        facts.append(Fact(f"{_margin(worst)} dB", f"smallest margin judged: {_name(worst)}"))
        if worst.ranking:
            top = worst.ranking[0]
            if worst.requirement.curve:
                what = "what its curve allows"
            else:
                what = "its mean square"
            facts.append(
                Fact(
                    f"{100 * top.share:.3g} %",
                    f"of {what}: {top.line} of {top.source}, {brief_number(top.frequency)} Hz",
                )
            )
    return facts


def _requirements(budget: Budget) -> Table:
    mark_of: dict[str, Mark] = {"pass": "pass", "fail": "fail"}
    marks: dict[int, Mark] = {
        k: mark_of.get(one.verdict, "off") for k, one in enumerate(budget.judged)
    }
    if not budget.judged:
        return table(["requirement"], [["none was given"]])
    spread = any(one.spread for one in budget.judged)
    head = [
        "requirement",
        "limit [1]",
        "value [1]",
        "at most [1]",
        "margin [dB]",
        *(["median [1]", "P95 [1]", "P99 [1]"] if spread else []),
    ]
    rows = [[*_cells(one)[: len(head)], *_at(one), _WORDS[one.verdict]] for one in budget.judged]
    if budget.angles:
        head += ["array angle [deg]"]
    else:
        head += []
    caption = (
        "At most: with the worst phases, all that still rings, and allowances for what was not"
        " examined." + (" Percentiles over a campaign." if spread else "")
    )
    return table([*head, "verdict"], rows, caption, marks)


def _contributor_tables(one: Assessment) -> Table:
    if one.requirement.curve:
        share = "part of what the curve allows [%]"
    else:
        share = "share of the mean square [%]"
    unit, rows = _ranked(one)
    head = ["source", "line", "frequency [Hz]", f"rms [{unit}]", share]
    return table(head, rows, f"{_name(one)}: {one.requirement.text}.")


def _windows(budget: Budget) -> Table:
    unit, size = angle_unit(x for w in budget.windows for x in (*w.both, w.lines[2], w.noise[2]))
    what = ("x", "y", "radial", "lines, radial", "noise, radial")
    rows = [
        [
            _metric_label(w.metric),
            f"{w.window:g}",
            *(f"{x / size:.4g}" for x in (*w.both, w.lines[2], w.noise[2])),
        ]
        for w in budget.windows
    ]
    return table(
        ["metric", "window [s]", *(f"{name} [{unit}]" for name in what)],
        rows,
        "Rms of all sources.",
    )


def _sources(budget: Budget) -> Table:
    rows = [
        [
            c.source,
            c.how,
            str(len(c.names)),
            "; ".join(list(dict.fromkeys(gap.why for gap in c.gaps))[:6]),
        ]
        for c in budget.contributions
    ]
    return table(["source", "how it was found", "lines [1]", "what is not known about it"], rows)


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
"""Of amplitudes (k, 2) those that a limit on an axis is held against, (k,)."""
_MARKERS = {
    "radial": ("o", "-", "dots"),
    "x": (">", "--", "pointing right"),
    "y": ("^", ":", "pointing up"),
}
"""Marker of lines, style of the curve that limits them, and the marker in words."""


def draw_budget(budget: Budget) -> Figure:
    """Lines by source, and rms over the length of the window with the limits on it."""
    drawing, axes = sheets.sheet(3.0, 1, 2)
    _draw_lines(axes[0, 0], budget)
    _draw_windows(axes[0, 1], budget)
    return drawing


def _draw_lines(ax: Axes, budget: Budget) -> None:
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
            size = _SIZE[axis](np.abs(one.los))
            shown, colour = one.settled & (size > 1e-5 * top), sheets.COLOURS[k % 7]
            if axis == "radial":
                ax.vlines(
                    one.frequency[shown], 1e-3 * top, 1e6 * size[shown], color=colour, linewidth=0.8
                )
            label = one.source if axis == "radial" else "_"
            style: dict[str, Any] = {
                "marker": _MARKERS[axis][0],
                "color": colour,
                "markersize": 3,
                "linestyle": "",
                "label": label,
            }
            ax.plot(one.frequency[shown], 1e6 * size[shown], **style)
    for required in curves:
        curve, axis = required.requirement.curve or (), required.requirement.axis
        f, allowed = [p.frequency for p in curve], [1e6 * p.amplitude for p in curve]
        if axis == "radial":
            label = _name(required)
        else:
            label = f"{_name(required)}: los_{axis} ({_MARKERS[axis][2]})"
        ax.plot(f, allowed, color="black", linestyle=_MARKERS[axis][1], linewidth=0.9, label=label)
    if seen == ["radial"]:
        what = "amplitude, radial [µrad]"
    else:
        what = "amplitude, radial and by axis [µrad]"
    if not top and not curves:  # logarithmic scales need numbers above 0
        ax.set(xlim=(1.0, 1e3), ylim=(1e-3, 1.0))
        ax.text(
            0.5, 0.5, "no settled lines above 0", transform=ax.transAxes, ha="center", fontsize=6.5
        )
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=what)
    if top:
        ax.set_ylim(1e6 * 1e-5 * top, 1e6 * 60 * top)  # with room for names
        sheets.name_points(ax, _governing_lines(budget))
    ax.legend(fontsize=6.5, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _governing_lines(budget: Budget) -> list[tuple[float, float, str, bool]]:
    """The most costly line of each requirement as (frequency [Hz], amplitude [µrad], name, whether
    it fails), failures first.
    """
    largest = {
        (c.source, name): 1e6 * float(np.hypot(*np.abs(los)))
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


def _draw_windows(ax: Axes, budget: Budget) -> None:
    """Rms of all lines over the length of the window, the largest in each step of lengths, and the
    limits on it.
    """
    T = 10.0 ** np.arange(-4.0, 2.0, _STEP)
    tried = (T[:, None] * 10.0 ** (_STEP * _STEP_PLACES)).ravel()
    tones = combine_lines(budget.contributions, budget.rule, doubtful=False)
    for k, metric in enumerate(_DRAWN):
        asked = [one.requirement for one in budget.judged if one.requirement.metric == metric]
        limits = [
            (r.axis, r.window, 1e6 * r.limit, r.name)
            for r in asked
            if r.window and r.limit and r.statistic == "rms"
        ]
        for axis in sorted({"radial", *(axis for axis, *_ in limits)}, key=list(_SIZE).index):
            size, (marker, line, _) = _SIZE[axis](tones.value), _MARKERS[axis]
            cycles = tones.frequency[:, None] * tried  # these metrics know f T only
            squares = 0.5 * size**2 @ metric_weight(metric, cycles, 1.0)
            rms = np.sqrt(squares.reshape(T.size, -1).max(axis=1))
            if axis == "radial":
                label = _metric_label(metric)
            else:
                label = f"{_metric_label(metric)} los_{axis}"
            style: dict[str, Any] = (
                {"linewidth": 4.0, "alpha": 0.35} if metric == "rpe" else {"linewidth": 1.1}
            )  # smear lies on it
            rms[rms == 0.0] = np.nan  # which logarithmic scales do not have
            ax.plot(T, 1e6 * rms, color=sheets.COLOURS[k], linestyle=line, label=label, **style)
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
    largest = 1e6 * math.sqrt(0.5 * float(np.sum(tones.value**2))) or 1.0
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="window [s]",
        ylabel="rms of lines [µrad]",
        ylim=(1e-5 * largest, 30 * largest),
    )
    ax.legend(fontsize=6.5, frameon=False)


def draw_cumulative(budget: Budget) -> Figure:
    """Cumulative rms of lines and densities about both axes, both ways."""
    drawing, axes = sheets.sheet(2.4, 1, 2)
    tones = combine_lines(budget.contributions, budget.rule, doubtful=False)
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
            ax.step(f[order], 1e6 * rms, where=where, color=colour, linewidth=1.1, label=label)
        ax.set(xscale="log", xlabel="frequency [Hz]", ylabel=f"rms of los_{axis} [µrad]")
        ax.legend(fontsize=6.5, frameon=False)
    return drawing
