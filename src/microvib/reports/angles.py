"""A sweep over angles of the array: its table and picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from microvib.analysis.limits import Judgement
from microvib.analysis.margins import NoVerdict, Verdict, worst_verdict
from microvib.analysis.pointing import HubLines
from microvib.model.coupling import driving_line_map, require_craft
from microvib.reports import sheets
from microvib.reports.document import Fact, Status, Text
from microvib.reports.numbers import count_text, window_text
from microvib.reports.outcome import Item, Outcome, Part, Picture
from microvib.reports.run.margins import judgement_data
from microvib.results import (
    ARRAY_ANGLE,
    DECIBEL,
    FREQUENCY,
    LINE_FREQUENCY,
    POINTING_ANGLE,
    Column,
    Measure,
    Table,
)
from microvib.signals.pointing import METRICS, Metric
from microvib.solve.channels import LOAD_COLUMNS, LOS_COLUMNS
from microvib.studies.angles import AngleSweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 6
"""Lines of a picture."""


def angles_outcome(sweep: AngleSweep) -> Outcome:
    """A sweep for those who read it: worst and best angle, largest line and rms at each, lines over
    the angle.
    """
    over = _angles_table(sweep)
    los = over.measure("ape_radial_rad")
    title = "Lines over the array's angle"
    picture = Picture("angles", lambda: draw_angles(sweep, los), title, _CAPTION)
    return Outcome(
        "Angles",
        f"Angles of the array: {sweep.scenario.title or 'drive'}",
        f"Lines of the line of sight at {len(sweep.angles)} angles of the array, one run each.",
        worst_verdict(one.verdict for one in sweep.judgements),
        (*limit_facts(sweep), *_facts(sweep, los)),
        (
            Part("", (*limit_items(sweep), picture, *map(Text, _fallbacks(sweep)))),
            Part("Every angle", (over,)),
        ),
        sweep.scenario,
        files=(lines_table("angles", sweep, angle_deg=np.degrees(sweep.angles)),),
        data={"angles": _data(sweep)},
    )


_CAPTION = (
    "Left, lines of the line of sight, radial, 0-to-peak; dotted, driving lines of the linearised"
    " drive. Right, rms of all lines."
)


@dataclass(frozen=True)
class AngleMargin:
    """The run at one angle against a limit, with the line that is nearest to it or farthest above."""

    angle: Annotated[float, Column("angle_deg", "angle", ARRAY_ANGLE)]
    verdict: Annotated[Verdict | NoVerdict, Column("verdict", "verdict", role="verdict")]
    component: Annotated[str, Column("component", "of")]
    line: Annotated[str, Column("line", "nearest line")]
    frequency: Annotated[float, Column("frequency_hz", "at", LINE_FREQUENCY)]
    decibel: Annotated[float, Column("margin_db", "margin", DECIBEL)]
    not_judged: Annotated[str, Column("not_judged", "not judged")]


def angle_margins(sweep: AngleSweep) -> list[AngleMargin]:
    """Margins of a sweep that was judged, a row for each angle."""
    return [
        _angle_margin(float(angle), judged)
        for angle, judged in zip(sweep.angles, sweep.judgements, strict=False)
    ]


def _angle_margin(angle: float, judged: Judgement) -> AngleMargin:
    judged_lines = [(one.worst, one.component) for one in judged.each]
    known = [(margin, of) for margin, of in judged_lines if margin is not None]
    gap = "; ".join(judged.all_gaps)
    if not known:
        return AngleMargin(angle, judged.verdict, "", "", math.nan, math.nan, gap)
    nearest, component = min(known, key=lambda x: x[0].factor)
    line = nearest.line
    return AngleMargin(
        angle, judged.verdict, component or "T_d", line.name, line.place, nearest.decibel, gap
    )


def limit_facts(sweep: AngleSweep) -> Iterator[Fact]:
    """The verdict over all angles; nothing where there is no limit."""
    rows = angle_margins(sweep)
    verdict = worst_verdict(row.verdict for row in rows)
    for row in _nearest(rows):
        at = f"{row.line}{_of(row)} at {ARRAY_ANGLE.figure(row.angle)}"
        status: Status = "pass" if verdict == "pass" else "fail"
        yield Fact(DECIBEL.figure(row.decibel), f"{verdict}, smallest margin: {at}", status)


def limit_items(sweep: AngleSweep) -> Iterator[Item]:
    """Sentence and table on the limit; nothing where there is none."""
    rows = angle_margins(sweep)
    if not rows:
        return
    verdict = worst_verdict(row.verdict for row in rows)
    worst = next(one for one in sweep.judgements if one.verdict == verdict)
    count = sum(row.verdict == verdict for row in rows)
    at = f"at {count} of {count_text(len(rows), 'angle')}"
    limit = sweep.judgements[0].limit
    band = f" {limit.band}" if limit.band else ""
    allowed = limit.words if limit.is_one_number else "over frequency"
    said = f"Limit {allowed}{band}: {'FAIL' if verdict == 'fail' else verdict} {at}"
    for row in _nearest(rows):
        said += f"; smallest margin {row.decibel:+.1f} dB ({row.line}{_of(row)} at {ARRAY_ANGLE.figure(row.angle)})"
    reason = f" Reason: {worst.all_gaps[0]}." if verdict == "not judged" else ""
    yield Text(f"{said}.{reason} Nothing is judged between these angles.")
    yield Table.of("margins", AngleMargin, rows)


def _nearest(rows: list[AngleMargin]) -> list[AngleMargin]:
    """The row with the smallest margin, where one is known."""
    known = [row for row in rows if math.isfinite(row.decibel)]
    return sorted(known, key=lambda row: row.decibel)[:1]


def _of(row: AngleMargin) -> str:
    return "" if row.component == "T_d" else f" of {row.component}"


def _fallbacks(sweep: AngleSweep) -> list[str]:
    """Sentences on angles where a steady state was asked for and not found."""
    found = zip(sweep.angles, sweep.fallbacks, strict=True)
    return [f"{math.degrees(angle):g} deg: no steady state: {why}." for angle, why in found if why]


def _angles_table(sweep: AngleSweep) -> Table:
    """The largest line and the rms at each angle; for readers then over all of them."""
    rms = {"APE": ("ape_radial_rad", sweep.rms("ape", 1.0))} | {
        f"RPE {window_text(w)}": (f"rpe_{w:g}s_radial_rad", sweep.rms("rpe", w))
        for w in sweep.lines[0].windows
    }
    columns = (
        Column("angle_deg", "angle", ARRAY_ANGLE),
        Column("line", "largest line"),
        Column("frequency_hz", "frequency", FREQUENCY),
        Column("amplitude_rad", "its amplitude", POINTING_ANGLE),
        *(Column(key, heading, POINTING_ANGLE) for heading, (key, _) in rms.items()),
    )
    each = [x for _, x in rms.values()]
    rows = tuple(
        (float(angle), *_largest_line(one), *(float(x[k]) for x in each))
        for k, (angle, one) in enumerate(zip(sweep.angles, sweep.lines, strict=True))
    )
    over_all = (
        ("all", "rms over angles", "", "", *(math.sqrt(np.mean(x**2)) for x in each)),
        ("worst", "", "", "", *(float(x.max()) for x in each)),
    )
    return Table("summary", columns, rows, (*rows, *over_all))


def _largest_line(lines: HubLines) -> tuple[str, float, float]:
    """Name, frequency [Hz] and radial amplitude [rad] of the largest line."""
    size = np.linalg.norm(lines.amplitude, axis=1)
    if not size.size:
        return "none", math.nan, math.nan
    top = int(np.argmax(size))
    return lines.names[top], float(lines.frequency[top]), float(size[top])


def lines_table(name: str, sweep: AngleSweep, **before: np.ndarray) -> Table:
    """Every line at each angle, behind columns with one value an angle, for a file."""
    keys = (*before, "line", "frequency_hz", *LOAD_COLUMNS, *LOS_COLUMNS)
    rows = tuple(
        (*at, name, float(one.frequency[k]), *np.abs(one.loads[k]).tolist(), *one.amplitude[k].tolist())
        for *at, one in zip(*(x.tolist() for x in before.values()), sweep.lines, strict=True) for k, name in enumerate(one.names)
    )  # fmt: skip
    return Table(name, tuple(map(Column, keys)), rows)


def _data(sweep: AngleSweep) -> dict[str, Any]:
    """Rms of every metric in each window, over the angles."""
    rms = [
        {"window_s": w, "metric": metric, "radial_rad": sweep.rms(metric, w).tolist()}
        for w in sweep.lines[0].windows for metric in METRICS
    ]  # fmt: skip
    return {
        "angles_deg": np.degrees(sweep.angles).tolist(),
        "windows": rms,
        "no_steady_state": list(sweep.fallbacks),
        "judgements": [judgement_data(one) for one in sweep.judgements],
    }


def _facts(sweep: AngleSweep, los: Measure) -> Iterator[Fact]:
    ape = sweep.rms("ape", 1.0)
    for what, k in (("worst", int(np.argmax(ape))), ("best", int(np.argmin(ape)))):
        angle = ARRAY_ANGLE.figure(float(sweep.angles[k]))
        yield Fact(angle, f"{what} angle, {los.figure(float(ape[k]))} rms")
    whole = los.figure(math.sqrt(np.mean(ape**2)))
    yield Fact(whole, "rms over all angles, each for the same time")


def draw_angles(sweep: AngleSweep, los: Measure) -> Figure:
    """The largest lines over the angle, and the rms in each window, in the unit of ``los``."""
    drawing, axes = sheets.sheet(3.0, 1, 2)
    left, right = axes[0]
    degrees, shown = np.degrees(sweep.angles), sweep.names[:SHOWN]
    for k, name in enumerate(shown):
        left.plot(
            degrees,
            sweep.los(name) / los.size,
            "o-",
            color=sheets.COLOURS[k],
            markersize=3,
            linewidth=0.9,
            label=name,
        )
    _draw_linear(left, sweep, shown, los)
    draw_rms(right, degrees, sweep.lines[0].windows, sweep.rms, los, "o-")
    label_axes(left, right, "angle of the array [deg]", los)
    return drawing


def draw_rms(
    ax: Axes,
    x: np.ndarray,
    windows: Iterable[float],
    rms: Callable[[Metric, float], np.ndarray],
    los: Measure,
    style: str,
) -> None:
    """The rms (n,) [rad] that ``rms`` gives of all lines over ``x``, in each window and in none, in
    the unit of ``los``.
    """
    for k, window in enumerate(windows):
        ax.plot(x, rms("rpe", window) / los.size, style, color=sheets.COLOURS[k % 7], markersize=3, linewidth=0.9,
                label=f"RPE {window_text(window)}")  # fmt: skip
    ax.plot(
        x,
        rms("ape", 1.0) / los.size,
        style,
        color="black",
        markersize=3,
        linewidth=0.9,
        label="APE",
    )


def label_axes(left: Axes, right: Axes, over: str, los: Measure) -> None:
    """Names of axes that show lines and their rms."""
    for ax, what in (
        (left, f"amplitude, radial [{los.unit}]"),
        (right, f"rms of all lines, radial [{los.unit}]"),
    ):
        ax.set(xlabel=over, ylabel=what, yscale="log")
        ax.legend(
            fontsize=6.5, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3
        )


def _draw_linear(ax: Axes, sweep: AngleSweep, shown: tuple[str, ...], los: Measure) -> None:
    """Driving lines of the linearised drive, in closed form, at many angles; not of two, which add
    with their phases.
    """
    scenario = sweep.scenario
    if scenario.driven_wing is not None:
        return
    orders = [
        int(name.removeprefix("drive_")) for name in shown if name.removeprefix("drive_").isdigit()
    ]
    if (
        not orders
        or not scenario.rate
        or require_craft(scenario).spacecraft.line_of_sight is None
        or sweep.angles.size < 2
    ):
        return
    psi = np.linspace(sweep.angles.min(), sweep.angles.max(), 121)
    found = driving_line_map(scenario, np.array([scenario.rate]), psi, max(orders))
    assert found.los is not None
    for order in orders:
        size = np.linalg.norm(found.los[:, 0, order - 1], axis=1)
        ax.plot(
            np.degrees(psi),
            size / los.size,
            ":",
            color=sheets.COLOURS[shown.index(f"drive_{order}")],
            linewidth=1.0,
        )
