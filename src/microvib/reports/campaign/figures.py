"""Pictures of a campaign: envelopes, histograms, exceedance, tornado, scatter, Sobol indices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.reports import sheets
from microvib.signals.limit_curve import LimitCurve
from microvib.studies.campaign import statistics
from microvib.studies.campaign.design import Design
from microvib.studies.campaign.effects import Indices, Tornado
from microvib.studies.campaign.results import MISSING, Results
from microvib.studies.campaign.statistics import Level, LineStatistics, amplitudes
from microvib.studies.campaign.variation import Levels, Varied
from microvib.units import convert, pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Band = tuple[float, float]
LOW, BETWEEN = "#9ecae8", "#b0b0b0"
MAX_KEYS = 12
MAX_POINTS = 5000
"""Points of a scatter plot; more would only hide each other."""


def envelopes(rows: Sequence[LineStatistics], limit: float | LimitCurve | None) -> Figure:
    """Median, 95 % and 99 % point and largest amplitude of each line."""
    figure, ax = sheets.one_axes(1.3 + 0.27 * len(rows))
    y = np.arange(len(rows))[::-1]
    median, p95, p99 = (
        1e3 * np.array([getattr(r, name).value for r in rows]) for name in ("median", "p95", "p99")
    )
    if np.isfinite(p95).any():
        ax.barh(y, p95 - median, left=median, height=0.5, color=LOW, label="median to 95 % point")
    ax.plot(median, y, "|", color=sheets.BLUE, markersize=13, markeredgewidth=2.2, label="median")
    if np.isfinite(p99).any():
        ax.plot(p99, y, "d", color=sheets.RED, markersize=5, label="99 % point")
    ax.plot([1e3 * r.largest for r in rows], y, "x", color="#333333", markersize=5, label="largest")
    if isinstance(limit, LimitCurve):
        _limits_of_lines(ax, rows, y, limit)
    else:
        _limit(ax, limit)
    ax.set_yticks(y, [_name(r) for r in rows])
    ax.set(xlabel="amplitude, 0-to-peak [mN m]", xscale="log")
    _plain_decades(ax.xaxis)
    return _with_legend(figure, 5)


def _name(row: LineStatistics) -> str:
    low, high = row.frequency
    if not math.isfinite(low):
        return row.line
    if high - low < 1e-3 * high:
        return f"{row.line}  {low:.4g} Hz"
    return f"{row.line}  {low:.3g} to {high:.3g} Hz"


def _limits_of_lines(
    ax: Axes, rows: Sequence[LineStatistics], y: np.ndarray, limit: LimitCurve
) -> None:
    """The least that a limit over frequency allows to each line, where it stands in any case."""
    allowed = np.array([statistics.least_allowed(row, limit) for row in rows])
    shown = np.where(np.isfinite(allowed), 1e3 * allowed, np.nan)
    style: dict[str, Any] = {"color": sheets.RED, "markersize": 15, "markeredgewidth": 1.6}
    ax.plot(shown, y, "|", label="limit at its frequency", **style)


def _limit(ax: Axes, limit: float | None, label: str = "limit {:g} mN m") -> None:
    if limit is not None:
        height = 1e3 * limit
        ax.axvline(
            height, color=sheets.RED, linestyle="-.", linewidth=1.4, label=label.format(height)
        )


def _with_legend(figure: Figure, columns: int, handles: Sequence[Any] | None = None) -> Figure:
    """The figure with a legend below it: of all its axes, or of these handles."""
    if handles is None:
        given = {}
    else:
        given = {"handles": handles}
    figure.legend(loc="outside lower center", ncols=columns, fontsize=7, frameon=False, **given)
    return figure


def _plain_decades(axis: Any) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _of_level(results: Results, level: Level) -> np.ndarray:
    """Which cases are independent draws of one level, (cases,)."""
    design = results.campaign.design
    return statistics.independent_cases(design) & (
        np.arange(design.cases) // design.samples.shape[0] == level.number
    )


def _computed(results: Results, counted: np.ndarray) -> np.ndarray:
    """Numbers of those of the ``counted`` cases, bool (cases,), that were computed."""
    return np.flatnonzero(counted & (results.state != MISSING))


def histograms(
    results: Results,
    lines: Sequence[str],
    limit: float | LimitCurve | None,
    band: Band,
    level: Level,
) -> Figure:
    """Histogram of each line's amplitude over the draws of one level."""
    counted = _of_level(results, level)
    figure, axes = sheets.panels(len(lines))
    for ax, line in zip(axes, lines, strict=True):
        x = amplitudes(results, line, band)[counted]
        x = 1e3 * x[np.isfinite(x)]
        drawn = statistics.bounds_of(results, line, band).of(_computed(results, counted))
        bins = int(np.clip(math.sqrt(x.size), 5, 60))
        ax.hist(x, bins=bins, color=sheets.BLUE, edgecolor="white", linewidth=0.4)
        for q, style in ((0.5, "-"), (0.95, "--"), (0.99, ":")):
            point = 1e3 * drawn.quantile(q).value
            if math.isfinite(point):
                ax.axvline(
                    point, color="#333333", linestyle=style, linewidth=1.0, label=f"{100 * q:g} %"
                )
        most = _limit_of_line(results, line, limit)
        if most is not None and 1e3 * most < 3.0 * float(
            x.max(initial=0.0)
        ):  # else the picture would shrink
            _limit(ax, most, "limit")
        ax.set(title=line, xlabel="amplitude, 0-to-peak [mN m]", ylabel="draws")
    return _with_legend(figure, 4, axes[0].get_legend_handles_labels()[0])


def _limit_of_line(results: Results, line: str, limit: float | LimitCurve | None) -> float | None:
    """Amplitude that a limit allows to a line at the median of its frequencies; None where there is none."""
    if not isinstance(limit, LimitCurve):
        return limit
    if line == statistics.LARGEST_LINE:
        return None
    f = results.of(line, "frequency")
    f = f[np.isfinite(f)]
    if not f.size:
        return None
    most = float(limit.at(float(np.median(f))))
    return most if math.isfinite(most) else None


def exceedances(
    results: Results,
    lines: Sequence[str],
    limit: float | LimitCurve | None,
    band: Band,
    level: Level,
) -> Figure:
    """Part of the draws of one level in which a line is larger than an amplitude, at least and, thin, at
    most where some do not tell it.
    """
    counted = _of_level(results, level)
    figure, ax = sheets.one_axes(3.4)
    styles = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1, 1, 1)))
    for k, line in enumerate(lines):
        drawn = statistics.bounds_of(results, line, band).of(_computed(results, counted))
        style: dict[str, Any] = {
            "where": "post",
            "color": sheets.COLOURS[k % len(sheets.COLOURS)],
            "linestyle": styles[k % len(styles)],
        }
        x, part = statistics.exceedance(drawn.least)
        ax.step(1e3 * x, part, linewidth=1.5, label=line, **style)
        if drawn.gap.any():
            x, part = statistics.exceedance(drawn.most)
            ax.step(1e3 * x, part, linewidth=0.7, **style)
    if not isinstance(limit, LimitCurve):  # each line has its own
        _limit(ax, limit)
    ax.set(
        yscale="log",
        xscale="log",
        xlabel="amplitude, 0-to-peak [mN m]",
        ylabel="fraction of the draws above it",
    )
    _plain_decades(ax.xaxis)
    ax.set_ylim(0.5 / max(int(counted.sum()), 1), 1.2)
    return _with_legend(figure, 4)


def tornados(found: Sequence[Tornado]) -> Figure:
    """Effect of every key on each line, the strongest on top."""
    from matplotlib.patches import Patch

    keys = min(max(len(t.effects) for t in found), MAX_KEYS)
    figure, axes = sheets.panels(len(found), height=0.9 + 0.2 * keys, columns=2)
    for ax, item in zip(axes, found, strict=True):
        shown = item.effects[:MAX_KEYS]
        y = np.arange(len(shown))[::-1]
        for end, colour in (("low", LOW), ("high", sheets.BLUE)):
            moved = np.array([1e3 * (getattr(e, end) - item.centre) for e in shown])
            colours = [BETWEEN if e.levels else colour for e in shown]
            ax.barh(y, moved, left=1e3 * item.centre, height=0.6, color=colours)
        ax.axvline(1e3 * item.centre, color="#333333", linewidth=0.9)
        ax.set_yticks(y, [e.key for e in shown], fontsize=6.5)
        if math.isfinite(item.explained):
            explained = f" (R² {item.explained:.2f})"
        else:
            explained = ""
        ax.set(title=f"{item.line}{explained}", xlabel="amplitude, 0-to-peak [mN m]")
    texts = {"at its low end": LOW, "at its high end": sheets.BLUE, "between its levels": BETWEEN}
    return _with_legend(
        figure, 3, [Patch(color=colour, label=text) for text, colour in texts.items()]
    )


def scattered_keys(design: Design) -> list[Varied]:
    """The keys that are numbers, over which cases may be drawn."""
    return [x for x in (*design.uncertain, *design.levels) if x.numeric][:MAX_KEYS]


def scatters(results: Results, line: str, band: Band) -> Figure:
    """Amplitude of a line over every key that is a number."""
    keys = scattered_keys(results.campaign.design)
    y = 1e3 * amplitudes(results, line, band)
    shown = np.flatnonzero(np.isfinite(y))
    shown = shown[:: max(shown.size // MAX_POINTS, 1)]
    figure, axes = sheets.panels(len(keys))
    for ax, item in zip(axes, keys, strict=True):
        x = results.scalar(item.key)[shown] * _per_display(item)
        ax.plot(x, y[shown], ".", color=sheets.BLUE, markersize=3, alpha=0.6)
        ax.set(xlabel=_label(item), ylabel=f"{line} [mN m]")
        ax.xaxis.label.set_fontsize(6.5)
    return figure


def _label(item: Varied) -> str:
    if item.display:
        return f"{item.key} [{pretty(item.display)}]"
    return item.key


def _per_display(item: Varied) -> float:
    if item.display and item.display != item.unit:
        return 1.0 / convert(f"1 {item.display}", item.unit)
    return 1.0


def sobol_bars(found: Sequence[Indices]) -> Figure:
    """First-order and total Sobol indices with their intervals."""
    figure, axes = sheets.panels(len(found), height=0.9 + 0.28 * len(found[0].keys), columns=2)
    for ax, item in zip(axes, found, strict=True):
        order = np.argsort([-t.value for t in item.total])
        y = np.arange(order.size)[::-1]
        for estimates, shift, colour, label in (
            (item.first, 0.18, LOW, "first order"), (item.total, -0.18, sheets.BLUE, "total"),
        ):  # fmt: skip
            chosen = [estimates[k] for k in order]
            value = np.array([e.value for e in chosen])
            ends = np.abs(np.array([[e.low for e in chosen], [e.high for e in chosen]]) - value)
            ax.barh(
                y + shift,
                value,
                height=0.34,
                color=colour,
                label=label,
                xerr=ends,
                error_kw={"elinewidth": 0.9},
            )
        ax.set_yticks(y, [item.keys[k] for k in order], fontsize=6.5)
        ax.set(title=f"{item.line}, {item.points} points", xlabel="fraction of the variance")
        ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
    return _with_legend(figure, 2, axes[0].get_legend_handles_labels()[0])


def over_levels(results: Results, lines: Sequence[str], band: Band) -> Figure:
    """Median and 5 to 95 % of each line over the levels of every key that has some."""
    keys = [x for x in results.campaign.design.levels if len(x.values) > 1][:6]
    figure, axes = sheets.panels(len(keys), height=2.8, columns=2)
    for ax, levels in zip(axes, keys, strict=True):
        _over(ax, results, lines, levels, band)
    axes[0].legend(fontsize=7)
    return figure


def _medians(bounds: statistics.Bounds, levels: int) -> np.ndarray:
    """Median of the cases of each level, (levels,); nan where those that are not known decide it."""
    found = np.full(levels, math.nan)
    for k, (least, most) in enumerate(
        zip(*(x.reshape(levels, -1) for x in (bounds.least, bounds.most)), strict=True)
    ):
        known = np.isfinite(least)
        if known.any() and np.median(least[known]) == np.median(most[known]):
            found[k] = np.median(least[known])
    return found


def _over(ax: Axes, results: Results, lines: Sequence[str], levels: Levels, band: Band) -> None:
    design, numeric = results.campaign.design, levels.numeric
    x = np.arange(len(levels.values), dtype=float)
    if numeric:
        x = np.array(levels.values, dtype=float) * _per_display(levels)
    level = design.level_numbers(levels.key)[:: design.samples.shape[0]]
    for k, line in enumerate(lines):
        cells = amplitudes(results, line, band).reshape(level.size, -1)
        middle = _medians(statistics.bounds_of(results, line, band), level.size)
        seen = np.isfinite(cells).any(axis=1)
        groups = [seen & (level == n) for n in range(x.size)]
        # a level that no case has an amplitude at is left out of the curves
        median, low, high = (
            1e3 * np.array([of(values[g]) if g.any() else math.nan for g in groups])
            for of, values in ((np.max, middle), (np.nanmin, cells), (np.nanmax, cells))
        )
        colour = sheets.COLOURS[k % len(sheets.COLOURS)]
        ax.plot(
            x, median, marker="os^Dv*"[k % 6], markersize=4, color=colour, linewidth=1.2, label=line
        )
        ax.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    if not numeric or x.size <= 8:
        ax.set_xticks(x, [f"{v:g}" for v in x] if numeric else levels.labels)
    ax.set(
        yscale="log",
        xlabel=_label(levels) if numeric else levels.key,
        ylabel="amplitude, 0-to-peak [mN m]",
    )
    _plain_decades(ax.yaxis)
