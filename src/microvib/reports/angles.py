"""A sweep over angles of the array as text, tables, picture and report."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from microvib.io.tables import rows_csv, to_json
from microvib.model.coupling import driving_line_map, require_craft
from microvib.reports import sheets
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import Contents, Document, Fact, Section, Table, table
from microvib.reports.numbers import angle_text, angle_unit, brief_number, window_text
from microvib.signals.pointing import METRICS, Metric
from microvib.solve.channels import LOAD_COLUMNS, LOS_COLUMNS
from microvib.studies.angles import AngleSweep
from microvib.text_tables import text_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 6
"""Lines of a picture."""


def angles_text(sweep: AngleSweep) -> str:
    """Largest line and rms of the line of sight at each angle, and over all angles."""
    head, rows = angles_table(sweep)
    title = sweep.scenario.title or "Angles"
    parts = [
        f"{title}: lines of the line of sight at {len(sweep.angles)} angles of the array.",
        text_table(head, rows),
    ]
    return "\n\n".join([*parts, *fallbacks(sweep)])


def fallbacks(sweep: AngleSweep) -> list[str]:
    """Sentences on angles where a steady state was asked for and not found."""
    found = zip(sweep.angles, sweep.fallbacks, strict=True)
    return [f"{math.degrees(angle):g} deg: no steady state: {why}." for angle, why in found if why]


def angles_table(sweep: AngleSweep) -> tuple[list[str], list[list[str]]]:
    """Head, unit at the end of each name, and rows: the largest line and the rms at each angle,
    then over all of them.
    """
    windows = sweep.lines[0].windows
    columns = {"APE": sweep.rms("ape", 1.0)} | {
        f"RPE {window_text(w)}": sweep.rms("rpe", w) for w in windows
    }
    unit, one_unit = angle_unit([float(np.max(columns["APE"], initial=0.0))])

    def sized(values: Iterable[float]) -> list[str]:
        return [brief_number(x / one_unit) for x in values]

    head = [
        "angle deg",
        "largest line",
        "Hz",
        f"its amplitude {unit}",
        *(f"{name} {unit}" for name in columns),
    ]
    rows = []
    for k, (angle, one) in enumerate(zip(sweep.angles, sweep.lines, strict=True)):
        size = np.linalg.norm(one.amplitude, axis=1)
        if size.size:
            top = int(np.argmax(size))
        else:
            top = -1
        if top >= 0:
            largest = [one.names[top], f"{one.frequency[top]:.4g}", *sized(size[[top]])]
        else:
            largest = ["none", "", ""]
        rows.append([f"{math.degrees(angle):g}", *largest, *sized(x[k] for x in columns.values())])
    rows.append(
        [
            "all",
            "rms over angles",
            "",
            "",
            *sized(math.sqrt(np.mean(x**2)) for x in columns.values()),
        ]
    )
    rows.append(["worst", "", "", "", *sized(x.max() for x in columns.values())])
    return head, rows


def angles_folder(sweep: AngleSweep) -> Contents:
    """Tables, JSON, picture and report."""
    picture = draw_angles(sweep)
    return {**angles_texts(sweep), "angles.png": sheets.png(picture)}, angles_report(sweep, picture)


def angles_texts(sweep: AngleSweep) -> dict[str, str]:
    """The files of a sweep that are text, by name: lines at each angle, and sums over them."""
    rms = [
        {"window_s": w, "metric": metric, "radial_rad": sweep.rms(metric, w).tolist()}
        for w in sweep.lines[0].windows for metric in METRICS
    ]  # fmt: skip
    said = {
        "angles_deg": np.degrees(sweep.angles).tolist(),
        "windows": rms,
        "no_steady_state": list(sweep.fallbacks),
    }
    return {
        "angles.csv": lines_csv(sweep, angle_deg=np.degrees(sweep.angles)),
        "angles.json": to_json(said),
    }


def lines_csv(sweep: AngleSweep, **before: np.ndarray) -> str:
    """Every line at each angle, behind columns with one value an angle."""
    rows = [
        (*at, name, float(one.frequency[k]), *np.abs(one.loads[k]).tolist(), *one.amplitude[k].tolist())
        for *at, one in zip(*(x.tolist() for x in before.values()), sweep.lines, strict=True) for k, name in enumerate(one.names)
    ]  # fmt: skip
    return rows_csv([*before, "line", "frequency_hz", *LOAD_COLUMNS, *LOS_COLUMNS], rows)


def angles_report(sweep: AngleSweep, picture: Figure) -> Document:
    """The report: worst angle, picture, table."""
    ape = sweep.rms("ape", 1.0)
    worst, least = int(np.argmax(ape)), int(np.argmin(ape))
    facts = [
        Fact(
            f"{math.degrees(sweep.angles[worst]):g}°",
            f"worst angle, {angle_text(float(ape[worst]))} rms",
        ),
        Fact(
            f"{math.degrees(sweep.angles[least]):g}°",
            f"best angle, {angle_text(float(ape[least]))} rms",
        ),
        Fact(angle_text(math.sqrt(np.mean(ape**2))), "rms over all angles, each for the same time"),
    ]
    head, rows = angles_table(sweep)
    heads = [unit_in_brackets(x) for x in head]
    said: Table = table(heads, rows)
    first = table([*heads[:2], f"all lines, {heads[4]}"], [[r[0], r[1], r[4]] for r in rows])
    caption = (
        "Left, lines of the line of sight, radial, 0-to-peak; dotted, driving lines of the"
        " linearised drive. Right, rms of all"
        " lines."
    )
    title = sweep.scenario.title or "drive"
    return study_report(
        "Angles",
        f"Angles of the array: {title}",
        f"{len(sweep.angles)} angles, one run each",
        facts=facts,
        first_page=(first, figure_block(picture, "Lines over the array's angle", caption)),
        sections=[Section("Every angle", (said,))],
        scenario=sweep.scenario,
    )


def unit_in_brackets(text: str) -> str:
    """A head of the text table as a report writes it, unit in brackets."""
    stem, _, unit = text.rpartition(" ")
    if unit in ("deg", "mrad", "µrad", "nrad"):
        return f"{stem} [{unit}]"
    if text == "Hz":
        return "frequency [Hz]"
    return text


def draw_angles(sweep: AngleSweep) -> Figure:
    """The largest lines over the angle, and the rms in each window."""
    drawing, axes = sheets.sheet(3.0, 1, 2)
    left, right = axes[0]
    degrees, shown = np.degrees(sweep.angles), sweep.names[:SHOWN]
    for k, name in enumerate(shown):
        left.plot(
            degrees,
            1e6 * sweep.los(name),
            "o-",
            color=sheets.COLOURS[k],
            markersize=3,
            linewidth=0.9,
            label=name,
        )
    _draw_linear(left, sweep, shown)
    draw_rms(right, degrees, sweep.lines[0].windows, sweep.rms, "o-")
    label_axes(left, right, "angle of the array [deg]")
    return drawing


def draw_rms(
    ax: Axes,
    x: np.ndarray,
    windows: Iterable[float],
    rms: Callable[[Metric, float], np.ndarray],
    style: str,
) -> None:
    """The rms (n,) [rad] that ``rms`` gives of all lines over ``x``, in each window and in none."""
    for k, window in enumerate(windows):
        ax.plot(x, 1e6 * rms("rpe", window), style, color=sheets.COLOURS[k % 7], markersize=3, linewidth=0.9,
                label=f"RPE {window_text(window)}")  # fmt: skip
    ax.plot(
        x, 1e6 * rms("ape", 1.0), style, color="black", markersize=3, linewidth=0.9, label="APE"
    )


def label_axes(left: Axes, right: Axes, over: str) -> None:
    """Names of axes that show lines and their rms."""
    for ax, what in (
        (left, "amplitude, radial [µrad]"),
        (right, "rms of all lines, radial [µrad]"),
    ):
        ax.set(xlabel=over, ylabel=what, yscale="log")
        ax.legend(
            fontsize=6.5, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3
        )


def _draw_linear(ax: Axes, sweep: AngleSweep, shown: tuple[str, ...]) -> None:
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
            1e6 * size,
            ":",
            color=sheets.COLOURS[shown.index(f"drive_{order}")],
            linewidth=1.0,
        )
