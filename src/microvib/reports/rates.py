"""Rate plans as text, tables and pictures: Campbell diagram, largest line over rate, forbidden
bands.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from microvib.analysis.margins import frequency_error_bound
from microvib.analysis.other_states import COUNTS
from microvib.reports import sheets
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text, plain_number
from microvib.reports.outcome import Item, Outcome, Part, Picture, Verdict
from microvib.results import (
    COUNT,
    FREQUENCY,
    MICROSTEPS,
    ORDER,
    RATE,
    TORQUE,
    TORQUE_LIMIT,
    TORQUE_UNCERTAINTY,
    Column,
    Table,
    columns_of,
)
from microvib.studies.rates import (
    ABOVE_LIMIT,
    Forbidden,
    RateCase,
    RateLine,
    RatePlan,
    Resonance,
    linear_error,
)
from microvib.studies.stepping_modes import SteppingMode, stepping_modes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from microvib.model.linear import CoupledMode

MIN_DRAWN_RATIO = 1e-3
"""Amplitude over the largest of the plan below which a Campbell diagram draws nothing."""
SHOWN = 12
_NO_END = 1e9
"""Frequency [Hz] for one that has no upper end, in files."""


def _deg(rate: float) -> str:
    return f"{math.degrees(rate):.5g}"


@dataclass(frozen=True)
class BestRate:
    """The best rate of one microstep count."""

    microsteps: Annotated[int, MICROSTEPS]
    rate: Annotated[float, Column("best_rate_deg_s", "best rate", RATE, absent="none")]
    largest: Annotated[float, Column("largest_n_m", "its largest line", TORQUE)]
    spread: Annotated[float, Column("spread_n_m", "± (ranges)", TORQUE_UNCERTAINTY)]
    """How far that line moves within the ranges that sources note."""
    worst: Annotated[float, Column("worst_n_m", "worst of the range", TORQUE)]


def rates_outcome(plan: RatePlan, note: str = "") -> Outcome:
    """A plan for those who read it: best rates, forbidden bands, the strongest resonances, Campbell
    diagram, and a ``note`` on how far it can be relied on.
    """
    first: list[Item] = [
        Table.of("best", BestRate, [_best_rate(plan, n) for n in plan.counts]),
        Text(best_text(plan)),
        *([Text(note, note=True)] if note else []),
        Picture("largest", lambda: draw_largest(plan), "Largest line over rate", _LARGEST_CAPTION),
    ]
    campbell = Picture(
        "campbell", lambda: draw_campbell(plan), "Campbell diagram", _CAMPBELL_CAPTION
    )
    return Outcome(
        "Rate plan",
        f"Rate plan: {plan.scenario.title or 'drive'}",
        _how(plan),
        _verdict(plan),
        tuple(_facts(plan)),
        (
            Part("", tuple(first)),
            Part("Campbell diagram", (campbell,), new_page=True),
            Part("Stepping modes over rate", _stepping_modes(plan)),
            Part(f"Forbidden rates, {_criteria(plan)}", _forbidden(plan)),
            Part("Resonances (line meets mode), strongest first", _resonances(plan)),
            Part("Without a steady state", tuple(map(Text, _unsolved(plan)))),
        ),
        plan.scenario,
        files=(_lines_at_rates(plan), Table.of("not_seen", NotSeen, _not_seen(plan))),
    )


_LARGEST_CAPTION = (
    "Largest line over rate. Shaded: forbidden; hatched: not solved. Dotted: not a steady state but"
    " time integration."
)
_CAMPBELL_CAPTION = "Dashed: modes as seen through the drive. Rings: where a line meets one."


def _best_rate(plan: RatePlan, microsteps: int) -> BestRate:
    found = plan.best(microsteps)
    if found is None:
        rate, largest, spread = math.nan, math.nan, math.nan
    else:
        case, largest = found
        line = case.largest(plan.band, limit=plan.curve)
        rate, spread = case.rate, math.nan if line is None else line.spread
    return BestRate(microsteps, rate, largest, spread, plan.worst(microsteps))


def _forbidden(plan: RatePlan) -> tuple[Item, ...]:
    if plan.limit is None and not plan.keep_away:
        return ()
    bands = Table.of("forbidden", Forbidden, plan.forbidden)
    between = Text(_between_rates(plan), note=True)
    if plan.forbidden:
        return (bands, between)
    return (bands, Text("None."), between)


def _between_rates(plan: RatePlan) -> str:
    """Sentence on what is not known between the rates that were solved."""
    part, step = plan.widest_step()
    if part == 0.0:
        return "Rates that were not solved are not judged."
    return (
        "Judged are the rates that were solved; between them a narrow resonance may be above the limit."
        f" Neighbours are at most {100 * part:.2g} % ({_deg(step)} deg/s) apart."
    )


def _stepping_modes(plan: RatePlan) -> tuple[Item, ...]:
    """Table of the microstep count to be used in each range of rates, where there are several."""
    found = stepping_modes(plan)
    if not found:
        return ()
    return (
        Table.of("stepping_modes", SteppingMode, found),
        Text(
            "A count changes with the rate only where it brings at least 3 dB, or keeps the limit. What a"
            " change of the count itself makes ring is not in it.",
            note=True,
        ),
    )


def _resonances(plan: RatePlan) -> tuple[Item, ...]:
    if not plan.resonances:
        return ()
    top = max((r.amplitude for r in plan.resonances if math.isfinite(r.amplitude)), default=0.0)
    strong = [
        r
        for r in strongest_resonances(plan.resonances, _MAX_RESONANCES)
        if not r.amplitude < _MIN_RELATIVE * top
    ]
    caption = "The strongest, to a hundredth of the largest; a plan's `resonances.csv` has all."
    return (
        Table.of(
            "resonances",
            Resonance,
            plan.resonances,
            for_readers=strong,
            brief=SHOWN,
            caption=caption,
        ),
    )


_MAX_RESONANCES = 40
_MIN_RELATIVE = 0.01
"""Part of the largest line at a resonance below which a report leaves a resonance to the file."""


def _verdict(plan: RatePlan) -> Verdict:
    """Whether some rate keeps the limit."""
    if plan.limit is None and not plan.keep_away:
        return ""
    if plan.best() is not None:
        return "pass"
    if _known_to_fail(plan) < len(plan.cases):
        return "not judged"
    return "fail"


def _known_to_fail(plan: RatePlan) -> int:
    """How many cases are above the limit or failed."""
    limit = math.inf if plan.judged_by is None else plan.judged_by
    return sum(x.verdict(plan.band, limit) in ("", ABOVE_LIMIT, "failed") for x in plan.cases)


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
        away = f"; the nearest resonance, {near[0].line} on {near[0].mode}, is {far} away"
    if plan.is_at_end(case):
        end = "; this is the end of the range, and rates beyond it may be better"
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
        in_time += f"; above {case.shown:.4g} Hz, the passband, there may be larger ones, such as {beyond.name}"
    what = (
        f"{_deg(case.rate)} deg/s with {case.microsteps} microsteps, {_top_words(plan, case)}{away}"
        f"{in_time}{end}."
    )
    if found:
        return f"Best: {what}"
    return f"Best: none {_criteria(plan)}. The rate with the smallest maximum line: {what}"


def _top_words(plan: RatePlan, case: RateCase) -> str:
    """The largest line of a rate, or with a limit over frequency that with the smallest margin."""
    line = plan.governing(case)
    if plan.curve is None or line is None:
        return f"largest line {TORQUE.figure(plan.top(case))}"
    margin = 20.0 * math.log10(plan.margin(case))
    return (
        f"smallest margin {margin:+.1f} dB ({line.name} at {line.frequency:.4g} Hz,"
        f" {TORQUE.figure(line.amplitude)} of {TORQUE.figure(plan.allowed_to(case))})"
    )


def _criteria(plan: RatePlan) -> str:
    if plan.limit is not None:
        parts = [f"for a limit of {_limit_words(plan)}{_in_band(plan)}"]
    else:
        parts = []
    if plan.keep_away:
        parts += [f"at least {100 * plan.keep_away:g} % away from resonances"]
    else:
        parts += []
    return " and ".join(parts) or "of those requested"


def _limit_words(plan: RatePlan) -> str:
    """The limit of a plan; of a curve over frequency its ends."""
    if plan.curve is None:
        return TORQUE_LIMIT.figure(plan.limit or math.nan)
    least, most = TORQUE_LIMIT.text(plan.curve.least), TORQUE_LIMIT.figure(plan.curve.most)
    return f"{least} to {most} from {plan.curve.low:g} to {plan.curve.high:g} Hz"


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
            " confirmed by a run from rest until it settled."
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


def _lines_at_rates(plan: RatePlan) -> Table:
    """Every line at every rate, with a row without a line for a case that failed."""
    of_line = columns_of(RateLine)
    nothing = RateLine("", "", math.nan, math.nan, math.nan)
    columns = (
        Column("rate_deg_s", measure=RATE),
        Column("microsteps", measure=COUNT),
        *of_line.values(),
        Column("status"),
    )
    rows = []
    for case in plan.cases:
        status = f"failed: {case.reason}" if case.failed else _how_solved(plan, case)
        for line in (nothing,) if case.failed else case.lines:
            figures = (getattr(line, field) for field in of_line)
            rows.append((case.rate, case.microsteps, *figures, status))
    return Table("rates", columns, tuple(rows), for_readers=())


@dataclass(frozen=True)
class NotSeen:
    """Something that may be at a rate beside the lines that the plan has, for those who judge its lines later."""

    rate: Annotated[float, Column("rate_deg_s", measure=RATE)]
    microsteps: Annotated[int, Column("microsteps", measure=COUNT)]
    what: Annotated[str, Column("what")]
    low: Annotated[float, Column("from_hz", measure=FREQUENCY)]
    high: Annotated[float, Column("to_hz", measure=FREQUENCY)]
    """Empty (nan) where it has no end."""
    at_most: Annotated[float, Column("at_most_n_m", measure=TORQUE)]
    """Empty (nan) where that is not known."""
    overstated: Annotated[float, Column("overstated", measure=ORDER)] = 1.0
    """Times by which the record may show the lines too large."""


def _not_seen(plan: RatePlan) -> Iterator[NotSeen]:
    """All that is not seen at each rate that did not fail: lines that are hidden, with what they may have at most,
    all above the passband, and what the record lacks.
    """
    for case in plan.cases:
        if case.failed:
            continue
        at = case.rate, case.microsteps
        for x in case.hidden:
            reach = max(float(frequency_error_bound(x.frequency)), x.away)
            low, high = max(x.frequency - reach, 0.0), x.frequency + reach
            yield NotSeen(*at, x.name, low, high, x.amplitude)
        yield from _in_other_states(case)
        if case.shown > 0.0:
            what = "lines above the passband"
        else:
            what = "lines that the linearised drive lacks"
        yield NotSeen(*at, what, min(case.shown, _NO_END), math.nan, math.nan)
        if case.gap is not None:
            yield NotSeen(*at, case.gap.why, 0.0, math.nan, math.nan, case.gap.overstated)


def _in_other_states(case: RateCase) -> Iterator[NotSeen]:
    """Lines that are larger in another state of the other wing's hinge, and by how much any may be smaller."""
    if not case.hinge:
        return
    at, smaller = (case.rate, case.microsteps), 1.0
    for x in case.lines:
        reach = float(frequency_error_bound(x.frequency))
        what = f"{x.name} in another state of the other wing's hinge"
        if x.most > (1.0 + COUNTS) * x.amplitude:
            yield NotSeen(*at, what, x.frequency - reach, x.frequency + reach, x.most)
        if (1.0 + COUNTS) * x.least < x.amplitude:
            smaller = max(smaller, x.amplitude / x.least if x.least > 0.0 else math.inf)
    if smaller > 1.0:
        yield NotSeen(*at, case.hinge, 0.0, math.nan, 0.0, smaller)


def _how_solved(plan: RatePlan, case: RateCase) -> str:
    if plan.linear:
        return "linear"
    if case.reason:
        return f"in time: {case.reason}"
    return "steady"


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
        facts.append(Fact(TORQUE.figure(top), _governing_words(plan, case)))
        if plan.limit is not None and top > 0.0:
            margin = 20 * math.log10(plan.margin(case))
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
        where = (
            f"smallest maximum line, at {_deg(case.rate)} deg/s with {case.microsteps} microsteps"
        )
        facts = [
            Fact(
                "None",
                f"no rate {_criteria(plan)}",
                "fail" if _verdict(plan) == "fail" else "",
            ),
            Fact(TORQUE.figure(top), where),
        ]
    if plan.limit is not None:
        facts.append(
            Fact(
                _limit_words(plan),
                f"limit: {count_text(len(plan.forbidden), 'forbidden band')}",
            )
        )
    return facts


def _governing_words(plan: RatePlan, case: RateCase) -> str:
    """Which line of the best rate its figure is of."""
    line = plan.governing(case)
    if plan.curve is None or line is None:
        return "its largest line"
    allowed = TORQUE.figure(plan.allowed_to(case))
    return (
        f"its line with the smallest margin, {line.name} at {line.frequency:.4g} Hz, where {allowed}"
        " are allowed"
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
    shown = {id(case): case.largest(plan.band, limit=plan.curve) for case in plan.cases}
    tops = [1e3 * line.amplitude for line in shown.values() if line is not None]
    if tops:
        low, high = (0.5 * min(tops), 3.0 * max(tops))
    else:
        low, high = (1e-3, 1e3)
    if plan.limit is not None:
        most = 1e3 * (plan.limit if plan.curve is None else plan.curve.most)
        low, high = min(low, 0.5 * 1e3 * plan.limit), max(high, 2.0 * most)
    for ax, n in zip(axes[:, 0], plan.counts, strict=True):
        cases = plan.of(n)
        rate = [math.degrees(case.rate) for case in cases]
        top = [1e3 * line.amplitude if (line := shown[id(case)]) else math.nan for case in cases]
        ax.semilogy(rate, top, color=sheets.BLUE, linewidth=1.0, marker=".", markersize=3)
        ax.set_ylim(low, high)
        for in_time in (degrees for degrees, case in zip(rate, cases, strict=True) if case.reason):
            ax.axvline(in_time, color=sheets.GREY, linewidth=0.8, linestyle=":")
        _draw_plan_limit(ax, plan, rate, cases)
        for b in (b for b in plan.forbidden if b.microsteps == n):
            ends, hatch = (
                (math.degrees(b.low), math.degrees(b.high)),
                None if b.why == ABOVE_LIMIT else "///",
            )
            ax.axvspan(*ends, color=sheets.RED, alpha=0.15, linewidth=0, hatch=hatch)
        what = "largest line" if plan.curve is None else "line nearest to the limit"
        ax.set(ylabel=f"{what} [mN m]", title=f"{n} microsteps per full step{_in_band(plan)}")
        ax.set_xlim(min(rate), max(rate))
    axes[-1, 0].set_xlabel("rate of the array [deg/s]")
    return figure


def _draw_plan_limit(
    ax: Axes, plan: RatePlan, rate: Sequence[float], cases: Sequence[RateCase]
) -> None:
    """The limit over rate; of one over frequency what it allows to the line of each rate."""
    if plan.limit is None:
        return
    style: dict[str, Any] = {"color": "black", "linewidth": 1.2, "linestyle": "--"}
    if plan.curve is None:
        limit = 1e3 * plan.limit
        ax.axhline(limit, label=f"limit {limit:.4g} mN m", **style)
    else:
        allowed = [
            1e3 * plan.allowed_to(case) if plan.governing(case) else math.nan for case in cases
        ]
        ax.plot(rate, allowed, label="limit at the frequency of that line", **style)
    ax.legend(loc="upper right", fontsize=7.5)
