"""Rate plans as text, tables and pictures: Campbell diagram, largest line over rate, forbidden
bands.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.io.tables import tables_csv
from microvib.reports import sheets
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import Contents, Document, Fact, Section, Table, Text, table
from microvib.reports.numbers import (
    brief_milli,
    brief_number,
    count_text,
    milli,
    plain_number,
    torque,
    torque_as_given,
)
from microvib.studies.rates import ABOVE_LIMIT, HIDDEN_LINE, RatePlan, Resonance, linear_error
from microvib.text_tables import text_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from microvib.model.linear import CoupledMode

MIN_DRAWN_RATIO = 1e-3
"""Amplitude over the largest of the plan below which a Campbell diagram draws nothing."""
SHOWN = 12


def _deg(rate: float) -> str:
    return f"{math.degrees(rate):.5g}"


def plan_text(plan: RatePlan) -> str:
    """Best rates, forbidden bands and the strongest resonances, as text."""
    ranked: list[tuple[str, ...]] = []
    for n in plan.counts:
        best = plan.best(n)
        if best:
            shown = (_deg(best[0].rate), torque(best[1]))
        else:
            shown = ("none", "")
        ranked.append((str(n), *shown, torque(plan.worst(n))))
    head = ("microsteps", "best deg/s", "its largest line", "worst of the range")
    lines = [_how(plan), "", text_table(head, ranked), best_text(plan)]
    if plan.limit is not None or plan.keep_away:
        said = {ABOVE_LIMIT: "{0.line} reaches {1}", HIDDEN_LINE: "{0.why} ({0.line}, up to {1})"}
        what = (
            (b, said.get(b.why, "{0.why}").format(b, torque(b.largest))) for b in plan.forbidden
        )
        bands = [(str(b.microsteps), f"{_deg(b.low)} to {_deg(b.high)}", text) for b, text in what]
        if bands:
            table = text_table(("microsteps", "deg/s", "why"), bands, last_left=True)
        else:
            table = "none"
        lines += ["", f"Forbidden, {_criteria(plan)}:", table]
    if plan.resonances:
        lines += ["", "Where lines meet modes, strongest first:"]
        met = [
            (
                str(r.microsteps),
                _deg(r.rate),
                f"{r.frequency:.4g}",
                brief_milli(r.amplitude),
                f"{r.line} on {r.mode}",
            )
            for r in strongest_resonances(plan.resonances, SHOWN)
        ]
        lines.append(
            text_table(("microsteps", "deg/s", "Hz", "mN m", "line on mode"), met, last_left=True)
        )
    return "\n".join([*lines, *(text for found in _unsolved(plan) for text in ("", found))])


def best_text(plan: RatePlan) -> str:
    """The best rate with what it is worth, or that there is none and what comes nearest."""
    found, least = plan.best(), plan.least()
    if least is None:
        return "Best: none; all cases failed."
    case, top = found or least
    near = plan.nearest(case)
    away = ""
    if near is not None:
        if near[1] < 1.0:
            far = f"{100 * near[1]:.2g} % of the rate"
        else:
            far = "more than its own rate"
        away = f"; {near[0].line} on {near[0].mode} is {far} away"
    if plan.is_at_end(case):
        end = "; it lies at the end of the range, beyond which there may be better ones"
    else:
        end = ""
    if case.reason:
        in_time = "; not a steady state but time integration"
    else:
        in_time = ""
    if plan.linear:
        beyond = None
    else:
        beyond = case.largest_unseen(plan.band)
    if beyond is not None and beyond.amplitude > top:
        in_time += f"; above {case.shown:.4g} Hz, the passband, there may be larger ones, such as {beyond.line}"
    what = f"{_deg(case.rate)} deg/s with {case.microsteps} microsteps, largest line {torque(top)}{away}{in_time}{end}."
    if found:
        return f"Best: {what}"
    return f"Best: none {_criteria(plan)}. The smallest largest line: {what}"


def _criteria(plan: RatePlan) -> str:
    if plan.limit is not None:
        parts = [f"for a limit of {torque_as_given(plan.limit)}{_in_band(plan)}"]
    else:
        parts = []
    if plan.keep_away:
        parts += [f"at least {100 * plan.keep_away:g} % away from resonances"]
    else:
        parts += []
    return " and ".join(parts) or "of those requested"


def _how(plan: RatePlan) -> str:
    rates = [case.rate for case in plan.cases]
    return (
        f"{len(plan.cases)} cases, {_deg(min(rates))} to {_deg(max(rates))} deg/s,"
        f" {', '.join(map(str, plan.counts))}"
        f" microsteps per full step: {solution_counts_text(plan)}{_in_band(plan)}."
    )


def solution_counts_text(plan: RatePlan) -> str:
    """How the cases were found, counted."""
    if plan.linear:
        return "linearised drive, driving lines only"
    failed = sum(case.failed for case in plan.cases)
    in_time = sum(bool(case.reason) for case in plan.cases) - failed
    parts = [f"{len(plan.cases) - failed - in_time} steady states of the full model"]
    if in_time:
        parts += [f"{in_time} time integrations"]
    else:
        parts += []
    parts += [f"{failed} failed"] if failed else []
    return ", ".join(parts)


def _in_band(plan: RatePlan) -> str:
    low, high = plan.band
    if math.isfinite(high):
        return f", lines from {low:g} to {high:g} Hz"
    return ""


def strongest_resonances(resonances: Iterable[Resonance], count: int) -> list[Resonance]:
    """Resonances by amplitude, those without one first: there, nothing is known."""
    return sorted(
        resonances, key=lambda r: -r.amplitude if math.isfinite(r.amplitude) else -math.inf
    )[:count]


def _unsolved(plan: RatePlan) -> list[str]:
    texts = []
    if confirmed := sum(case.confirmed for case in plan.cases):
        texts.append(
            f"{count_text(confirmed, 'steady state')} next to rates with self-excited vibration"
            " (the largest line is not a clock line)"
            " confirmed by a run from rest until it has arrived."
        )
    for failed, what in (
        (False, "have no steady state and were integrated in time"), (True, "failed"),
    ):  # fmt: skip
        reasons = [c.reason for c in plan.cases if c.reason and c.failed is failed]
        if reasons:
            why = "; ".join(list(dict.fromkeys(reasons))[:4])
            texts.append(
                f"{len(reasons)} of {len(plan.cases)} cases {what} (see rates.csv): {why}."
            )
    return texts


def linear_text(plan: RatePlan) -> str:
    """The linear plan's error against the full model, as text."""
    parts = [
        f"{n} microsteps: median {plain_number(100 * median, 3)} %, largest"
        f" {plain_number(100 * top, 3)} % of {lines} lines"
        for n, (median, top, lines) in linear_error(plan).items()
    ]
    return "Linear against full model, drive_1 to drive_3 at five rates: " + "; ".join(parts) + "."


def plan_folder(plan: RatePlan, text: str) -> Contents:
    """Tables, pictures and report of a plan."""
    campbell, largest = draw_campbell(plan), draw_largest(plan)
    met = [
        (r.microsteps, math.degrees(r.rate), r.mode, r.mode_frequency, r.line, r.frequency, r.amplitude) for r in plan.resonances
    ]  # fmt: skip
    bands = [
        (x.microsteps, math.degrees(x.low), math.degrees(x.high), x.why, x.line, x.largest)
        for x in plan.forbidden
    ]
    tables = tables_csv({
        "rates": ("rate_deg_s microsteps line kind order frequency_hz amplitude_n_m status", _case_rows(plan)),
        "resonances": ("microsteps rate_deg_s mode mode_hz line frequency_hz amplitude_n_m", met),
        "forbidden": ("microsteps from_deg_s to_deg_s why line largest_n_m", bands),
    })  # fmt: skip
    pictures = {"campbell.png": sheets.png(campbell), "largest.png": sheets.png(largest)}
    return tables | pictures, plan_report(plan, text, campbell, largest)


def _case_rows(plan: RatePlan) -> Iterable[Sequence[Any]]:
    for case in plan.cases:
        head = (math.degrees(case.rate), case.microsteps)
        if plan.linear:
            status = "linear"
        elif case.reason:
            status = f"in time: {case.reason}"
        else:
            status = "steady"
        if case.failed:
            yield (*head, "", "", math.nan, math.nan, math.nan, f"failed: {case.reason}")
        for x in case.lines:
            yield (*head, x.line, x.kind, x.order, x.frequency, x.amplitude, status)


def plan_report(plan: RatePlan, text: str, campbell: Figure, largest: Figure) -> Document:
    """The report of a plan: best rates and what to keep away from, largest line over rate, Campbell
    diagram.
    """
    over = "Largest line over rate"
    shades = f"{over}. Shaded: forbidden; hatched: not solved. Dotted: not a steady state but time integration."
    rings = "Dashed: modes as seen through the drive. Rings: where a line meets one."
    strong = Text("The strongest, to a hundredth of the largest; all are in `resonances.csv`.")
    sections = [
        Section(
            "Campbell diagram", (figure_block(campbell, "Campbell diagram", rings),), new_page=True
        )
    ]
    if plan.forbidden:
        sections += [Section("Forbidden rates", (_forbidden(plan),))]
    else:
        sections += []
    if plan.resonances:
        sections += [Section("Resonances", (strong, _resonance_rows(plan)))]
    else:
        sections += []
    if unsolved := _unsolved(plan):
        sections += [Section("Without a steady state", tuple(map(Text, unsolved)))]
    else:
        sections += []
    return study_report(
        "Rate plan",
        f"Rate plan: {plan.scenario.title or 'drive'}",
        _how(plan),
        facts=_facts(plan),
        first_page=(
            _best(plan), Text(best_text(plan)), *([Text(text, note=True)] if text else []), figure_block(largest, over, shades),
        ),
        sections=sections,
        scenario=plan.scenario,
    )  # fmt: skip


def _facts(plan: RatePlan) -> list[Fact]:
    facts = []
    if found := plan.best():
        case, top = found
        if plan.is_at_end(case):
            end = ", at the end of the range"
        else:
            end = ""
        facts.append(
            Fact(f"{_deg(case.rate)} deg/s", f"best rate, with {case.microsteps} microsteps{end}")
        )
        facts.append(Fact(torque(top), "its largest line"))
        if plan.limit is not None and top > 0.0:
            margin = 20 * math.log10(plan.limit / top)
            facts.append(
                Fact(
                    f"{margin:+.1f} dB",
                    "its margin to the limit",
                    "pass" if margin >= 0.0 else "fail",
                )
            )
        elif plan.limit is not None:
            facts.append(Fact("Pass", "no line at the best rate", "pass"))
    elif least := plan.least():
        case, top = least
        if plan.limit is None:
            limit = math.inf
        else:
            limit = plan.limit
        known_to_fail = sum(
            x.verdict(plan.band, limit) in ("", ABOVE_LIMIT, "failed") for x in plan.cases
        )
        where = (
            f"smallest largest line, at {_deg(case.rate)} deg/s with {case.microsteps} microsteps"
        )
        facts = [
            Fact(
                "None",
                f"no rate {_criteria(plan)}",
                "" if known_to_fail < len(plan.cases) else "fail",
            ),
            Fact(torque(top), where),
        ]
    if plan.limit is not None:
        facts.append(
            Fact(
                torque_as_given(plan.limit),
                f"limit: {count_text(len(plan.forbidden), 'forbidden band')}",
            )
        )
    return facts


def _best(plan: RatePlan) -> Table:
    header = [
        "microsteps [1]",
        "best rate [deg/s]",
        "its largest line [mN m]",
        "worst of the range [mN m]",
    ]
    best = {
        n: (_deg(found[0].rate), milli(found[1])) if (found := plan.best(n)) else ("none", "")
        for n in plan.counts
    }
    return table(header, [[str(n), *cells, milli(plan.worst(n))] for n, cells in best.items()])


def _forbidden(plan: RatePlan) -> Table:
    rows = [
        [str(b.microsteps), _deg(b.low), _deg(b.high), milli(b.largest), b.line, b.why]
        for b in plan.forbidden
    ]
    return table(
        ["microsteps [1]", "from [deg/s]", "to [deg/s]", "largest [mN m]", "line", "why"], rows
    )


_MIN_RELATIVE = 0.01
"""Part of the largest line at a resonance below which a report leaves a resonance to the file."""


def _resonance_rows(plan: RatePlan) -> Table:
    top = max((r.amplitude for r in plan.resonances if math.isfinite(r.amplitude)), default=0.0)
    rows = [
        [
            str(r.microsteps),
            _deg(r.rate),
            brief_number(r.frequency),
            milli(r.amplitude),
            r.line,
            r.mode,
        ]
        for r in strongest_resonances(plan.resonances, 40)
        if not r.amplitude < _MIN_RELATIVE * top
    ]
    return table(
        ["microsteps [1]", "rate [deg/s]", "frequency [Hz]", "line there [mN m]", "line", "mode"],
        rows,
    )


def draw_campbell(plan: RatePlan) -> Figure:
    """Lines over rate and frequency, coloured by amplitude; one panel for each microstep count."""
    from matplotlib.colors import LogNorm

    figure, axes = sheets.panels(len(plan.counts), 2.9 if len(plan.counts) > 1 else 3.9, 2)
    top = max((1e3 * x.amplitude for case in plan.cases for x in case.lines), default=1.0)
    norm = LogNorm(MIN_DRAWN_RATIO * top, top)
    for ax, n in zip(axes, plan.counts, strict=True):
        points = _draw_order_lines(ax, plan, n, norm)
    figure.colorbar(points, ax=figure.axes, label="amplitude, 0-to-peak [mN m]", pad=0.01)
    return figure


def _draw_order_lines(ax: Axes, plan: RatePlan, n: int, norm: Any) -> Any:
    found = [
        (math.degrees(c.rate), x.frequency, 1e3 * x.amplitude) for c in plan.of(n) for x in c.lines
    ]
    shown = sorted((point for point in found if point[2] >= norm.vmin), key=lambda point: point[2])
    rate, frequency, amplitude = np.array(shown).reshape(-1, 3).T
    points = ax.scatter(
        rate,
        frequency,
        c=amplitude,
        norm=norm,
        cmap="viridis_r",
        s=5.0,
        linewidths=0,
        rasterized=True,
    )
    frequencies = [*frequency, *(m.frequency for m in plan.modes)]
    ax.set_yscale("log")
    ax.set_ylim(0.7 * min(frequencies, default=1.0), 1.6 * max(frequencies, default=10.0))
    rates = [math.degrees(case.rate) for case in plan.of(n)]
    ax.set_xlim(min(rates), max(rates))
    for mode in plan.modes:
        ax.axhline(mode.frequency, color=sheets.GREY, linestyle="--", linewidth=0.9)
        _name_mode(ax, mode, rate, frequency)
    met = [(math.degrees(r.rate), r.frequency) for r in plan.resonances if r.microsteps == n]
    ax.plot(
        *np.array(met).reshape(-1, 2).T,
        "o",
        color=sheets.RED,
        fillstyle="none",
        markersize=7,
        zorder=6,
    )
    ax.set(
        xlabel="rate of the array [deg/s]",
        ylabel="frequency [Hz]",
        title=f"{n} microsteps per full step",
    )
    return points


_MODE_NAME_SIZE = (0.5, 0.08)
"""Room that a mode's name takes in a panel: parts of its width and of its height."""


def _name_mode(ax: Axes, mode: CoupledMode, rate: np.ndarray, frequency: np.ndarray) -> None:
    """The mode's name at its line: at the end and on the side where it covers the fewest points."""
    inside = ax.transData + ax.transAxes.inverted()
    x, y = inside.transform(np.column_stack([rate, frequency])).T
    at = float(inside.transform((0.0 if not rate.size else rate[0], mode.frequency))[1])
    wide, high = _MODE_NAME_SIZE

    def covered(place: tuple[float, int]) -> int:
        end, way = place
        return int(
            np.sum((np.abs(x - end) < wide) & (way * (y - at) > -0.01) & (way * (y - at) < high))
        )

    end, way = min(((1.0, 1), (0.0, 1), (1.0, -1), (0.0, -1)), key=covered)
    ax.annotate(
        f"{mode.name} {mode.frequency:.3g} Hz", (end, mode.frequency), xycoords=("axes fraction", "data"),
        xytext=(-3 if end else 3, 3 * way), textcoords="offset points", ha="right" if end else "left",
        va="bottom" if way > 0 else "top", fontsize=6.5, color="#333333",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )  # fmt: skip


def draw_largest(plan: RatePlan) -> Figure:
    """Largest line over rate, with the limit and what it forbids; one panel for each microstep
    count.
    """
    figure, axes = sheets.sheet(min(0.6 + 2.0 * len(plan.counts), 7.6), len(plan.counts))
    tops = [1e3 * line.amplitude for case in plan.cases if (line := case.largest(plan.band))]
    if tops:
        low, high = (0.5 * min(tops), 3.0 * max(tops))
    else:
        low, high = (1e-3, 1e3)
    if plan.limit is None:
        limit = None
    else:
        limit = 1e3 * plan.limit
    if limit is not None:
        low, high = min(low, 0.5 * limit), max(high, 2.0 * limit)
    for ax, n in zip(axes[:, 0], plan.counts, strict=True):
        cases = plan.of(n)
        rate = [math.degrees(case.rate) for case in cases]
        top = [
            1e3 * line.amplitude if (line := case.largest(plan.band)) else math.nan
            for case in cases
        ]
        ax.semilogy(rate, top, color=sheets.BLUE, linewidth=1.0, marker=".", markersize=3)
        ax.set_ylim(low, high)
        for in_time in (degrees for degrees, case in zip(rate, cases, strict=True) if case.reason):
            ax.axvline(in_time, color=sheets.GREY, linewidth=0.8, linestyle=":")
        if limit is not None:
            ax.axhline(
                limit, color="black", linewidth=1.2, linestyle="--", label=f"limit {limit:.4g} mN m"
            )
            ax.legend(loc="upper right", fontsize=7.5)
        for b in (b for b in plan.forbidden if b.microsteps == n):
            ends, hatch = (
                (math.degrees(b.low), math.degrees(b.high)),
                None if b.why == ABOVE_LIMIT else "///",
            )
            ax.axvspan(*ends, color=sheets.RED, alpha=0.15, linewidth=0, hatch=hatch)
        ax.set(ylabel="largest line [mN m]", title=f"{n} microsteps per full step{_in_band(plan)}")
        ax.set_xlim(min(rate), max(rate))
    axes[-1, 0].set_xlabel("rate of the array [deg/s]")
    return figure
