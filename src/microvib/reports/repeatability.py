"""Repeated tests for those who read it: mean and spread of each line, outliers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from microvib.reports import sheets
from microvib.reports.analysis_units import table_in_unit
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.reports.typography import file_name
from microvib.results import DIFFERENCE, SHARE, Table
from microvib.studies.repeatability import RULE, LineScatter, Repeatability, RunDeviation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 24
"""Lines of a table on the terminal."""
_DRAWN = 10
"""Lines of a picture."""
_MOST_NOTES = 12


def repeatability_outcome(found: Repeatability) -> Outcome:
    """Repeated tests for those who read it: mean and spread of each line, scatter from run to run and from
    unit to unit beyond the uncertainties of estimates, and outliers by a stated rule.
    """
    units = [unit for unit in found.groups if unit]
    of = f" of {count_text(len(units), 'unit')}" if units else ""
    parts = [Part("", (Pairs(tuple(_about(found))), *map(Text, _sentences(found))))]
    for channel in found.channels:
        own = [row for row in found.lines if row.channel == channel]
        items: list[Item] = [Text("No line is in two runs.")]
        if own:
            table = Table.of(
                f"repeatability_{channel}", LineScatter, own, brief=_SHOWN, caption=_CAPTION
            )
            title = f"{channel}: lines of each run over their median"
            items = [
                table_in_unit(table, found.units_of[channel]),
                Picture(
                    f"repeatability_{channel}",
                    lambda channel=channel: draw_runs(found, channel),  # type: ignore[misc]
                    title,
                    _PICTURE_CAPTION,
                ),
            ]
        parts.append(Part(f"Lines of {channel}", tuple(items)))
    out = [x for x in found.deviations if x.outlier]
    parts.append(
        Part(
            "Outliers",
            (Text(RULE), *((Table.of("", RunDeviation, out, brief=_SHOWN),) if out else ())),
        )
    )
    if found.notes or found.not_judged:
        texts = [*found.not_judged, *found.notes]
        left = [f"and {len(texts) - _MOST_NOTES} more"] if len(texts) > _MOST_NOTES else []
        parts.append(
            Part("Notes", tuple(Text(f"{x}.", note=True) for x in [*texts[:_MOST_NOTES], *left]))
        )
    files = (Table.of("deviations", RunDeviation, found.deviations, for_readers=()),)
    return Outcome(
        "Repeatability",
        "Repeatability of disturbance lines",
        f"{count_text(len(found.runs), 'run')}{of}, {count_text(len(found.lines), 'line')}.",
        "",
        tuple(_facts(found)),
        tuple(parts),
        files=files,
    )


_CAPTION = (
    "Estimate: standard uncertainty of one estimate. Run to run, unit to unit: standard deviations beyond it, as"
    " parts of the mean (Paule-Mandel); at most: upper end of their 95 % interval (Q-profile), 0 where runs"
    " differ by less than their uncertainties, ? where they set no bound. ± is the standard uncertainty of the"
    " mean, of all of them and of the table, whose part is common to all runs and makes no scatter."
)
_PICTURE_CAPTION = "Amplitude over the median of all runs; bars are standard uncertainties of the estimates; rings, outliers."


def _about(found: Repeatability) -> Iterator[tuple[str, str]]:
    for unit in found.groups:
        names = ", ".join(file_name(run.name) for run in found.runs if run.unit == unit)
        yield unit or "Runs", names


def _sentences(found: Repeatability) -> Iterator[str]:
    yield from found.run_warnings
    for name, part in found.outlying_runs.items():
        yield (
            f"{file_name(name)} is an outlier in most of its lines, {DIFFERENCE.figure(part)} against its"
            " unit's median: look at its gain, its channels and what was mounted before its lines."
        )
    few = [unit for unit in found.groups if sum(run.unit == unit for run in found.runs) < 3]
    if few:
        of = f" of {', '.join(few)}" if any(few) else ""
        yield f"Runs{of}: fewer than three, of which no outlier can be told."
    if found.not_judged:
        yield (
            f"{count_text(len(found.not_judged), 'line')} of single runs left out: not the drive's as the"
            " table shows them, or ringing; see the notes."
        )


def _facts(found: Repeatability) -> Iterator[Fact]:
    if not found.lines:
        return
    largest = max(found.lines, key=lambda row: row.mean)
    if math.isfinite(largest.run):
        yield Fact(SHARE.figure(largest.run), f"run to run, {largest.line}")
    if math.isfinite(largest.unit):
        yield Fact(SHARE.figure(largest.unit), f"unit to unit, {largest.line}")
    yield Fact(str(sum(x.outlier for x in found.deviations)), "outliers")


def _draw_run(ax: Axes, deviations: Mapping[float, RunDeviation], colour: str) -> None:
    """Deviations of one run at their places, with uncertainties; outliers in rings."""
    own = deviations.values()
    part = [100.0 * x.part for x in own]
    bars = [100.0 * x.uncertainty * (1.0 + x.part) / x.amplitude for x in own]
    ax.errorbar([*deviations], part, bars, fmt="o", ms=3.5, color=colour, elinewidth=0.9)
    rings = [(at, 100.0 * x.part) for at, x in deviations.items() if x.outlier]
    if rings:
        ax.plot(*zip(*rings, strict=True), "o", ms=9, mfc="none", color="k")


def draw_runs(found: Repeatability, channel: str) -> Figure:
    """Largest lines of each run over their median, with uncertainties; a colour for each unit."""
    rows = [row for row in found.lines if row.channel == channel][:_DRAWN]
    drawing, axes = sheets.plain_sheet(4.0)
    ax = axes[0, 0]
    place = {row.line: k for k, row in enumerate(rows)}
    colour = {unit: f"C{k}" for k, unit in enumerate(found.groups)}
    for j, run in enumerate(found.runs):
        own = [x for x in found.deviations if x.run == run.name and x.channel == channel]
        aside = 0.6 * ((j + 0.5) / len(found.runs) - 0.5)
        at = {place[x.line] + aside: x for x in own if x.line in place}
        _draw_run(ax, at, colour[run.unit])
    for unit in found.groups:
        if unit:
            ax.plot([], [], "o", ms=3.5, color=colour[unit], label=unit)
    if any(found.groups):
        ax.legend(fontsize=7.5)
    ax.axhline(0.0, color="0.5", lw=0.8)
    ax.set_xticks(range(len(rows)), [row.line for row in rows], rotation=25, ha="right", fontsize=8)
    ax.set_ylabel(f"{channel} over its median, less one [%]")
    drawing.subplots_adjust(bottom=0.2)
    return drawing
